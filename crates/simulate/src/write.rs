//! The same flight in every container.

mod bag;
mod camera;
mod csv;
#[cfg(feature = "every-format")]
mod dataflash;
#[cfg(feature = "every-format")]
mod db3;
pub(crate) mod definition;
mod flight_log;
mod idl;
mod mcap;
pub(crate) mod message;
#[cfg(feature = "every-format")]
mod nmea;
mod protobuf;
pub(crate) mod ros;
#[cfg(feature = "every-format")]
mod tlog;
#[cfg(feature = "every-format")]
mod ubx;
#[cfg(feature = "every-format")]
mod ulog;

pub use bag::{BagCompression, BagSettings};
#[cfg(feature = "every-format")]
pub use db3::{Db3Compression, Db3Layout, Db3Settings};
pub use mcap::{McapCompression, McapEncoding, McapSettings};

use self::definition::Definition;
use self::message::Message;
use crate::error::SimulateError;
use crate::simulated::SimulatedFlight;
use std::fs;
use std::path::{Path, PathBuf};

/// Format of a written flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Container {
    /// One table at the velocity's rate, the position held between its updates; a row of units below the header.
    CsvWide,
    /// A folder with a table for each topic, in the columns of `rostopic echo -p`.
    CsvFolder,
    /// MCAP.
    Mcap(McapSettings),
    /// ROS 1 bag 2.0.
    Bag(BagSettings),
    #[cfg(feature = "every-format")]
    /// PX4 ULog: topics of PX4, timestamps in whole µs since the autopilot was switched on, velocities, attitudes and
    /// vectors as 32-bit floats. Data without a PX4 topic is skipped.
    Ulog,
    #[cfg(feature = "every-format")]
    /// ArduPilot DataFlash. Only for flights.
    DataFlash,
    #[cfg(feature = "every-format")]
    /// ArduPilot DataFlash as text. Only for flights.
    DataFlashText,
    /// ROS 2 bag in SQLite.
    #[cfg(feature = "every-format")]
    Db3(Db3Settings),
    #[cfg(feature = "every-format")]
    /// NMEA 0183: no vertical speed and no truth. Only for flights.
    Nmea,
    #[cfg(feature = "every-format")]
    /// UBX of a u-blox receiver: no truth. Only for flights.
    Ubx,
    #[cfg(feature = "every-format")]
    /// MAVLink telemetry. Only for flights.
    Tlog,
}

/// A topic and the type of its messages.
#[derive(Debug, Clone)]
pub(crate) struct Topic {
    pub(crate) name: String,
    pub(crate) definition: &'static Definition,
}

/// Contents of a log: topics in the order of their connections, messages in order of arrival.
#[derive(Debug, Clone)]
pub(crate) struct Logbook {
    topics: Vec<Topic>,
    messages: Vec<Message>,
}

impl Logbook {
    pub(crate) fn new(topics: Vec<Topic>, mut messages: Vec<Message>) -> Logbook {
        messages.sort_by_key(|message| (message.logged, message.topic, message.sequence));
        Logbook { topics, messages }
    }
}

/// A file of a log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LogFile {
    /// Path relative to the campaign's folder.
    pub path: PathBuf,
    /// Content.
    pub bytes: Vec<u8>,
}

impl Container {
    /// The flight's files; `stem` is the path relative to the campaign's folder, without an extension.
    ///
    /// # Errors
    /// [`SimulateError::Mcap`], [`SimulateError::Json`] or [`SimulateError::Compress`] if a writer fails.
    pub fn files(self, flight: &SimulatedFlight, stem: &str) -> Result<Vec<LogFile>, SimulateError> {
        #[cfg(feature = "every-format")]
        if let Some(bytes) = self.own_format(flight) {
            return Ok(vec![LogFile { path: self.path(stem), bytes }]);
        }
        self.write(stem, || flight_log::logbook(flight), || csv::wide(flight))
    }

    /// A flight in a format that only flights have.
    #[cfg(feature = "every-format")]
    fn own_format(self, flight: &SimulatedFlight) -> Option<Vec<u8>> {
        Some(match self {
            Container::DataFlash => dataflash::binary(flight),
            Container::DataFlashText => dataflash::text(flight),
            Container::Nmea => nmea::write(flight),
            Container::Ubx => ubx::write(flight),
            Container::Tlog => tlog::write(flight),
            _ => return None,
        })
    }

    /// The flight's files including images of a camera and a laser scanner, about five times as many bytes as
    /// everything else. An MCAP can have them in separate chunks (`apart`), and then no checksum over its data section,
    /// so that a reader can skip them. For containers of ROS messages.
    ///
    /// # Errors
    /// As [`Container::files`].
    pub fn files_with_camera(
        self,
        flight: &SimulatedFlight,
        stem: &str,
        apart: bool,
    ) -> Result<Vec<LogFile>, SimulateError> {
        let log = camera::added(flight_log::logbook(flight), flight);
        match self {
            Container::Mcap(settings) if apart => {
                Ok(vec![LogFile { path: self.path(stem), bytes: mcap::write_apart(&log, settings)? }])
            }
            _ => self.write(stem, || log, || csv::wide(flight)),
        }
    }

    /// A log of messages, or of one wide table.
    pub(crate) fn write(
        self,
        stem: &str,
        log: impl FnOnce() -> Logbook,
        wide: impl FnOnce() -> Vec<u8>,
    ) -> Result<Vec<LogFile>, SimulateError> {
        let one = |extension: &str, bytes| vec![LogFile { path: format!("{stem}.{extension}").into(), bytes }];
        Ok(match self {
            Container::CsvWide => one("csv", wide()),
            Container::CsvFolder => csv::folder(&log(), stem),
            Container::Mcap(settings) => one("mcap", mcap::write(&log(), settings)?),
            Container::Bag(settings) => one("bag", bag::write(&log(), settings)?),
            #[cfg(feature = "every-format")]
            Container::Ulog => one("ulg", ulog::write(&log())),
            #[cfg(feature = "every-format")]
            Container::DataFlash | Container::DataFlashText => return Err(SimulateError::OnlyFlights("DataFlash")),
            #[cfg(feature = "every-format")]
            Container::Db3(settings) => db3::write(&log(), stem, settings)?,
            #[cfg(feature = "every-format")]
            Container::Nmea => return Err(SimulateError::OnlyFlights("NMEA")),
            #[cfg(feature = "every-format")]
            Container::Ubx => return Err(SimulateError::OnlyFlights("UBX")),
            #[cfg(feature = "every-format")]
            Container::Tlog => return Err(SimulateError::OnlyFlights("MAVLink telemetry")),
        })
    }

    /// Path of the flight relative to the campaign's folder: its file, or its folder.
    #[must_use]
    pub fn path(self, stem: &str) -> PathBuf {
        match self {
            Container::CsvWide => format!("{stem}.csv").into(),
            Container::CsvFolder => stem.into(),
            Container::Mcap(_) => format!("{stem}.mcap").into(),
            Container::Bag(_) => format!("{stem}.bag").into(),
            #[cfg(feature = "every-format")]
            Container::Ulog => format!("{stem}.ulg").into(),
            #[cfg(feature = "every-format")]
            Container::DataFlash => format!("{stem}.bin").into(),
            #[cfg(feature = "every-format")]
            Container::DataFlashText => format!("{stem}.log").into(),
            #[cfg(feature = "every-format")]
            Container::Nmea => format!("{stem}.nmea").into(),
            #[cfg(feature = "every-format")]
            Container::Ubx => format!("{stem}.ubx").into(),
            #[cfg(feature = "every-format")]
            Container::Tlog => format!("{stem}.tlog").into(),
            #[cfg(feature = "every-format")]
            Container::Db3(settings) => match settings.paths(stem).as_slice() {
                [only] => only.into(),
                _ => stem.into(),
            },
        }
    }
}

/// Writes files below `folder`, creating missing folders.
///
/// # Errors
/// [`SimulateError::Write`] with the first file that cannot be written.
pub(crate) fn save(folder: &Path, files: &[LogFile]) -> Result<(), SimulateError> {
    files.iter().try_for_each(|file| {
        let path = folder.join(&file.path);
        let saved = path.parent().map_or(Ok(()), fs::create_dir_all).and_then(|()| fs::write(&path, &file.bytes));
        saved.map_err(|source| SimulateError::Write { path, source })
    })
}

#[cfg(all(test, feature = "every-format"))]
mod tests {
    use super::*;
    use crate::sensor::SensorSettings;
    use crate::simulated::{FlightSettings, simulate};
    use ::mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
    use flight::Stamp;
    use std::collections::BTreeMap;
    use std::io::Write;

    fn short_flight() -> SimulatedFlight {
        let noisy = SensorSettings { white_std: 0.3, delay_s: 0.4, ..SensorSettings::clean(5.0) };
        simulate(&FlightSettings { duration_s: 30.0, position: noisy, ..FlightSettings::default() }).unwrap()
    }

    fn containers() -> Vec<Container> {
        use {BagCompression as B, McapCompression as C, McapEncoding as E};
        let mcaps = [E::Ros1, E::Cdr, E::Idl, E::Json, E::Protobuf].into_iter().flat_map(|encoding| {
            [C::None, C::Lz4, C::Zstd, C::Unchunked].into_iter().flat_map(move |compression| {
                [true, false].map(|summary| Container::Mcap(McapSettings { encoding, compression, summary }))
            })
        });
        let bags = [B::None, B::Bz2, B::Lz4Independent, B::Lz4Linked]
            .into_iter()
            .flat_map(|compression| [true, false].map(|indexed| Container::Bag(BagSettings { compression, indexed })));
        let db3s = [Db3Compression::None, Db3Compression::ZstdMessages, Db3Compression::ZstdFile].into_iter().flat_map(
            |compression| {
                [Db3Layout::Bare, Db3Layout::Folder(1), Db3Layout::Folder(3)]
                    .map(|layout| Container::Db3(Db3Settings { compression, layout, definitions: true }))
            },
        );
        let others =
            [Container::CsvWide, Container::CsvFolder, Container::Ulog, Container::DataFlash, Container::DataFlashText];
        others.into_iter().chain(mcaps).chain(bags).chain(db3s).collect()
    }

    fn only(container: Container, flight: &SimulatedFlight) -> Vec<u8> {
        let mut files = container.files(flight, "f").unwrap();
        assert_eq!(files.len(), 1);
        files.remove(0).bytes
    }

    /// Expected messages of each topic.
    fn expected_counts() -> BTreeMap<String, usize> {
        let counts = [("/gps/fix", 151), ("/gps/vel", 3001), ("/truth/fix", 3001), ("/operator/notes", 30)];
        counts.map(|(topic, count)| (topic.to_owned(), count)).into()
    }

    #[test]
    fn every_container_is_reproducible_and_depends_on_the_flight() {
        let (flight, again) = (short_flight(), short_flight());
        let other = simulate(&FlightSettings { seed: 2, ..flight.settings.clone() }).unwrap();
        for container in containers() {
            let files = container.files(&flight, "f").unwrap();
            assert_eq!(files, container.files(&again, "f").unwrap(), "{container:?}");
            assert_ne!(files, container.files(&other, "f").unwrap(), "{container:?}");
        }
    }

    #[test]
    fn the_mcap_crate_reads_every_mcap_with_all_its_checksums_on() {
        let flight = short_flight();
        for container in containers().into_iter().filter(|c| matches!(c, Container::Mcap(_))) {
            let bytes = only(container, &flight);
            let mut counts: BTreeMap<String, usize> = BTreeMap::new();
            for message in ::mcap::MessageStream::new(&bytes).unwrap() {
                *counts.entry(message.unwrap().channel.topic.clone()).or_default() += 1;
            }
            assert_eq!(counts, expected_counts(), "{container:?}");
            let options = LinearReaderOptions::default()
                .with_validate_chunk_crcs(true)
                .with_validate_data_section_crc(true)
                .with_validate_summary_section_crc(true);
            let mut reader = LinearReader::new_with_options(options);
            let mut rest = &bytes[..];
            while let Some(event) = reader.next_event() {
                if let LinearReadEvent::ReadRequest(wanted) = event.unwrap() {
                    let take = wanted.min(rest.len());
                    reader.insert(take).copy_from_slice(&rest[..take]);
                    reader.notify_read(take);
                    rest = &rest[take..];
                }
            }
        }
    }

    #[test]
    fn the_chunks_of_an_mcap_carry_a_checksum() {
        let bytes = only(Container::Mcap(McapSettings::default()), &short_flight());
        let chunks: Vec<u32> = ::mcap::read::LinearReader::new(&bytes)
            .unwrap()
            .filter_map(|record| match record.unwrap() {
                ::mcap::records::Record::Chunk { header, .. } => Some(header.uncompressed_crc),
                _ => None,
            })
            .collect();
        assert!(chunks.len() > 1 && chunks.iter().all(|crc| *crc != 0), "{chunks:?}");
    }

    #[test]
    fn an_mcap_without_summary_has_no_summary_section() {
        let settings = McapSettings { summary: false, ..McapSettings::default() };
        let bytes = only(Container::Mcap(settings), &short_flight());
        assert!(::mcap::Summary::read(&bytes).unwrap().is_none());
        let whole = only(Container::Mcap(McapSettings::default()), &short_flight());
        assert_eq!(::mcap::Summary::read(&whole).unwrap().unwrap().stats.unwrap().message_count, 6183);
    }

    /// Log time, ns, and bytes of a message.
    type Payload = (u64, Vec<u8>);

    /// Messages of a bag by topic, and the payloads of one topic, read by the `rosbag` crate.
    fn read_bag(bytes: &[u8], topic: &str) -> (BTreeMap<String, usize>, Vec<Payload>) {
        use rosbag::{ChunkRecord, IndexRecord, MessageRecord, RosBag};
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(bytes).unwrap();
        let bag = RosBag::new(file.path()).unwrap();
        let mut names = BTreeMap::new();
        for record in bag.index_records() {
            if let IndexRecord::Connection(connection) = record.unwrap() {
                names.insert(connection.id, connection.topic.to_owned());
            }
        }
        let (mut counts, mut payloads) = (BTreeMap::new(), vec![]);
        for record in bag.chunk_records() {
            let ChunkRecord::Chunk(chunk) = record.unwrap() else { continue };
            for message in chunk.messages() {
                let MessageRecord::MessageData(data) = message.unwrap() else { continue };
                *counts.entry(names[&data.conn_id].clone()).or_default() += 1;
                if names[&data.conn_id] == topic {
                    payloads.push((data.time, data.data.to_vec()));
                }
            }
        }
        (counts, payloads)
    }

    #[test]
    fn the_rosbag_crate_reads_every_indexed_bag_in_all_compressions() {
        let flight = short_flight();
        for compression in
            [BagCompression::None, BagCompression::Bz2, BagCompression::Lz4Independent, BagCompression::Lz4Linked]
        {
            let bytes = only(Container::Bag(BagSettings { compression, indexed: true }), &flight);
            let (counts, payloads) = read_bag(&bytes, "/gps/fix");
            assert_eq!(counts, expected_counts(), "{compression:?}");
            for (row, (logged, payload)) in payloads.iter().enumerate() {
                // seq, stamp, frame "gps", status, service: latitude starts at byte 22.
                let f64_at = |at: usize| f64::from_le_bytes(payload[at..at + 8].try_into().unwrap());
                assert_eq!([22, 30, 38].map(f64_at), flight.position.geodetic_deg[row]);
                assert_eq!(Stamp(*logged as i64), flight.position.logged[row]);
            }
        }
    }

    #[test]
    fn the_index_of_a_bag_points_at_its_messages() {
        use rosbag::{ChunkRecord, MessageRecord, RosBag};
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(&only(Container::Bag(BagSettings::default()), &short_flight())).unwrap();
        let bag = RosBag::new(file.path()).unwrap();
        let (mut entries, mut chunk) = (0, None);
        for record in bag.chunk_records() {
            match record.unwrap() {
                ChunkRecord::Chunk(found) => chunk = Some(found),
                // An index refers to the chunk before it.
                ChunkRecord::IndexData(index) => {
                    let mut messages = chunk.as_ref().unwrap().messages();
                    for entry in index.entries() {
                        messages.seek(entry.offset).unwrap();
                        let Some(Ok(MessageRecord::MessageData(message))) = messages.next() else {
                            panic!("no message")
                        };
                        assert_eq!((message.conn_id, message.time), (index.conn_id, entry.time));
                        entries += 1;
                    }
                }
            }
        }
        assert_eq!(entries, 6183);
    }

    #[test]
    fn lz4_chunks_come_with_linked_and_with_independent_blocks() {
        // Frame descriptor: magic, then a byte whose bit 5 says that blocks are independent.
        for (compression, independent) in [(BagCompression::Lz4Linked, 0), (BagCompression::Lz4Independent, 1)] {
            let bytes = only(Container::Bag(BagSettings { compression, indexed: true }), &short_flight());
            let frame = bytes.windows(4).position(|w| w == 0x184D_2204_u32.to_le_bytes()).unwrap();
            assert_eq!(bytes[frame + 4] >> 5 & 1, independent, "{compression:?}");
        }
    }

    #[test]
    fn sqlite_reads_every_message_of_a_bag_in_order() {
        use rusqlite::{Connection, MAIN_DB};
        let flight = short_flight();
        let layout = Db3Layout::Folder(2);
        let files = Container::Db3(Db3Settings { layout, ..Db3Settings::default() }).files(&flight, "f").unwrap();
        let (mut counts, mut logged) = (BTreeMap::new(), vec![]);
        for file in files.iter().filter(|file| file.path.extension().is_some_and(|e| e == "db3")) {
            let mut connection = Connection::open_in_memory().unwrap();
            connection.deserialize_read_exact(MAIN_DB, &file.bytes[..], file.bytes.len(), true).unwrap();
            let sql =
                "SELECT name, timestamp, data FROM messages JOIN topics ON topics.id = topic_id ORDER BY messages.id";
            let mut statement = connection.prepare(sql).unwrap();
            let mut rows = statement.query([]).unwrap();
            while let Some(row) = rows.next().unwrap() {
                let (topic, data): (String, Vec<u8>) = (row.get(0).unwrap(), row.get(2).unwrap());
                assert_eq!(data[..4], [0, 1, 0, 0]);
                *counts.entry(topic).or_default() += 1;
                logged.push(row.get::<_, i64>(1).unwrap());
            }
        }
        assert_eq!(counts, expected_counts());
        assert!(logged.is_sorted());
        assert!(files[2].bytes.windows(19).any(|w| w == b"message_count: 6183"));
    }

    #[test]
    fn an_unindexed_bag_is_marked_and_has_the_same_chunks() {
        let flight = short_flight();
        let whole = only(Container::Bag(BagSettings::default()), &flight);
        let crashed = only(Container::Bag(BagSettings { indexed: false, ..BagSettings::default() }), &flight);
        let index_position = |bytes: &[u8]| {
            let at = bytes.windows(10).position(|w| w == b"index_pos=").unwrap() + 10;
            u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
        };
        assert_eq!(index_position(&crashed), 0);
        assert_eq!(index_position(&whole), crashed.len() as u64);
        assert_eq!(whole[4096 + 13..crashed.len()], crashed[4096 + 13..]);
    }

    #[test]
    fn a_cell_of_a_table_is_read_back_bit_for_bit() {
        let flight = short_flight();
        let files = Container::CsvFolder.files(&flight, "f").unwrap();
        let file = files.iter().find(|file| file.path.ends_with("gps-vel.csv")).unwrap();
        let text = String::from_utf8(file.bytes.clone()).unwrap();
        let header: Vec<&str> = text.lines().next().unwrap().split(',').collect();
        let column = |name: &str| header.iter().position(|h| *h == name).unwrap();
        let axes = ["y", "x", "z"].map(|axis| column(&format!("field.twist.linear.{axis}")));
        let rows = text.lines().skip(1).map(|line| line.split(',').collect::<Vec<_>>());
        let ned: Vec<[f64; 3]> = rows.map(|row| axes.map(|at| row[at].parse().unwrap())).collect();
        let up = flight.velocity.ned.iter().map(|v| [v[0], v[1], -v[2]]).collect::<Vec<_>>();
        assert_eq!(ned, up);
    }

    #[test]
    fn the_wide_table_has_a_row_of_units_and_held_positions() {
        let flight = short_flight();
        let text = String::from_utf8(only(Container::CsvWide, &flight)).unwrap();
        let lines: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
        assert!(lines.iter().all(|cells| cells.len() == 10));
        assert_eq!(lines[1][..4], ["ns", "deg", "deg", "m"]);
        // 5 Hz over 100 Hz.
        let latitudes: Vec<&str> = lines[2..].iter().map(|cells| cells[1]).collect();
        assert_eq!(latitudes.len(), 3001);
        assert!(latitudes[..20].iter().all(|cell| *cell == latitudes[0]) && latitudes[20] != latitudes[0]);
    }
}
