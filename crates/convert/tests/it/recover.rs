//! Everything recoverable from a log is recovered, and nothing else.

use crate::flight::{in_context, library, read, unit, write};
use convert::{ConvertError, How, Recovered, recover};
use flight::{Channel, Severity, Stamp};
use ingest::{Selection, Table, TopicInfo};
use simulate::{BagCompression, BagSettings, Container, McapSettings, cut_off, zero_block};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;

fn recovered(log: &Path, out: &Path) -> Result<Recovered, ConvertError> {
    in_context(|context| recover(&unit(log), library(), out, context))
}

fn containers() -> [Container; 3] {
    let bag = |compression| Container::Bag(BagSettings { compression, ..BagSettings::default() });
    [Container::Mcap(McapSettings::default()), bag(BagCompression::None), bag(BagCompression::Lz4Linked)]
}

#[test]
fn an_intact_log_is_recovered_with_identical_channels() {
    for container in containers() {
        let folder = tempfile::tempdir().unwrap();
        let log = write(container, folder.path());
        let out = folder.path().join("out.mcap");
        let report = recovered(&log, &out).unwrap();
        assert_eq!((report.how, report.any_loss()), (How::Copied, false));
        assert!(report.topics.iter().all(|t| t.found == t.written && t.written > 0), "{:?}", report.topics);
        let (before, after) = (read(&log), read(&out));
        assert_eq!(before.flight.channels, after.flight.channels, "{container:?}");
        assert_eq!(std::fs::metadata(&out).unwrap().len(), report.bytes);
    }
}

#[test]
fn a_damaged_log_is_recovered_and_its_losses_are_reported() {
    for container in containers() {
        let folder = tempfile::tempdir().unwrap();
        let log = write(container, folder.path());
        let mut bytes = std::fs::read(&log).unwrap();
        cut_off(&mut bytes, 0.8);
        zero_block(&mut bytes, 0.5, 600);
        std::fs::write(&log, &bytes).unwrap();
        let before = read(&log);
        assert!(before.health.bytes.damaged > 0 && before.health.messages > 0);
        let out = folder.path().join("out.mcap");
        let report = recovered(&log, &out).unwrap();
        assert!(report.any_loss());
        assert_eq!(report.topics.iter().map(|t| t.written).sum::<u64>(), before.health.messages);
        let after = read(&out);
        assert!(!after.flight.notices.any_loss(), "{:?}", after.flight.notices);
        assert_eq!(before.flight.channels, after.flight.channels, "{container:?}");
    }
}

#[test]
fn formats_with_private_messages_are_recovered_as_typed_tables() {
    for container in [Container::Ulog, Container::DataFlash] {
        let folder = tempfile::tempdir().unwrap();
        let log = write(container, folder.path());
        let out = folder.path().join("out.mcap");
        let report = recovered(&log, &out).unwrap();
        assert_eq!((report.how, report.any_loss()), (How::Rewritten, false), "{:?}", report.notices);
        assert!(report.topics.iter().all(|t| t.found == t.written), "{:?}", report.topics);
        let (before, after) = (tables(&log), tables(&out));
        assert_eq!(before.len(), after.len());
        for (table, twin) in before.iter().zip(&after) {
            assert_eq!(
                (&table.topic.name, table.rows, &table.logged_ns),
                (&twin.topic.name, twin.rows, &twin.logged_ns)
            );
            // Columns keep their order, whatever names ROS allows.
            let sum = |t: &Table| -> Vec<f64> {
                let of = |c: &ingest::Column| (0..t.rows).filter_map(|r| c.number(r)).filter(|x| x.is_finite()).sum();
                let mut sums: Vec<f64> = t.columns.iter().map(of).collect();
                sums.sort_by(f64::total_cmp);
                sums
            };
            assert_eq!(sum(table), sum(twin), "{}", table.topic.name);
        }
    }
}

fn tables(log: &Path) -> Vec<Table> {
    let unit = unit(log);
    in_context(|c| ingest::read(&unit, &|_: &TopicInfo| Selection::All, c)).unwrap().tables
}

#[test]
fn a_log_that_changes_while_read_is_not_recovered_and_old_output_stays() {
    for container in [Container::Mcap(McapSettings::default()), Container::Ulog] {
        for before in [None, Some(b"an earlier output".as_slice())] {
            let folder = tempfile::tempdir().unwrap();
            let log = write(container, folder.path());
            let out = folder.path().join("out.mcap");
            before.iter().for_each(|bytes| std::fs::write(&out, bytes).unwrap());
            let bytes = std::fs::read(&log).unwrap();
            // As a logger that continues, or another log copied to this name.
            let on_bytes = |_| std::fs::write(&log, [bytes.as_slice(), b"more"].concat()).unwrap();
            let cancel = std::sync::atomic::AtomicBool::new(false);
            let limits = ingest::Limits::default();
            let context = ingest::ReadContext { limits, cancel: &cancel, on_bytes: &on_bytes };
            let error = recover(&unit(&log), library(), &out, &context).unwrap_err().to_string();
            assert!(error.contains("changed while it was read"), "{container:?}: {error}");
            assert_eq!(std::fs::read(&out).ok().as_deref(), before, "{container:?}");
            let files = std::fs::read_dir(folder.path()).unwrap().count();
            assert_eq!(files, 1 + before.iter().len(), "no temporary file is left");
        }
    }
}

#[test]
fn a_log_without_messages_is_rejected_and_nothing_is_left() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.mcap");
    let mcap = write(Container::Mcap(McapSettings::default()), folder.path());
    let bytes = std::fs::read(&mcap).unwrap();
    std::fs::write(&mcap, &bytes[..40]).unwrap();
    assert!(recovered(&mcap, &out).is_err());
    let left: Vec<String> = std::fs::read_dir(folder.path())
        .unwrap()
        .map(|e| e.unwrap().file_name().to_string_lossy().into_owned())
        .filter(|name| name.contains("flightlag-tmp") || name == "out.mcap")
        .collect();
    assert!(left.is_empty(), "{left:?}");
}

/// An MCAP with one message, two attachments with the same name, and metadata.
fn with_extras(path: &Path) {
    let mut writer = mcap::Writer::new(std::fs::File::create(path).unwrap()).unwrap();
    let metadata = [("offered_qos_profiles".to_owned(), "- depth: 1".to_owned())].into();
    let channel = writer.add_channel(0, "/chatter", "json", &metadata).unwrap();
    let header = mcap::records::MessageHeader { channel_id: channel, sequence: 0, log_time: 5, publish_time: 6 };
    writer.write_to_known_channel(&header, b"{}").unwrap();
    for (log_time, data) in [(7, vec![0xA5; 3 << 20]), (8, b"second".to_vec())] {
        let (name, media_type, data) = ("../calib.bin".to_owned(), "application/x".to_owned(), Cow::Owned(data));
        writer.attach(&mcap::Attachment { log_time, create_time: 1, name, media_type, data }).unwrap();
    }
    for pilot in ["A", "=B"] {
        let metadata = [("pilot".to_owned(), pilot.to_owned())].into();
        writer.write_metadata(&mcap::records::Metadata { name: "crew".to_owned(), metadata }).unwrap();
    }
    writer.finish().unwrap();
}

/// Attachments and metadata as another reader finds them.
type Extras = (Vec<(String, u64, u64, Vec<u8>)>, Vec<BTreeMap<String, String>>);

fn extras(path: &Path) -> Extras {
    let mut found = (vec![], vec![]);
    let bytes = std::fs::read(path).unwrap();
    for record in mcap::read::LinearReader::new(&bytes).unwrap() {
        match record.unwrap() {
            mcap::records::Record::Attachment { header: h, data, .. } => {
                found.0.push((h.name, h.log_time, h.create_time, data.into_owned()));
            }
            mcap::records::Record::Metadata(m) if m.name == "crew" => found.1.push(m.metadata),
            mcap::records::Record::Channel(c) => {
                assert_eq!(c.metadata.get("offered_qos_profiles").map(String::as_str), Some("- depth: 1"));
            }
            _ => {}
        }
    }
    found
}

#[test]
fn attachments_and_metadata_are_copied_byte_for_byte() {
    let folder = tempfile::tempdir().unwrap();
    let (log, out) = (folder.path().join("log.mcap"), folder.path().join("out.mcap"));
    with_extras(&log);
    let report = recovered(&log, &out).unwrap();
    assert!(!report.any_loss());
    let whats: Vec<(&str, u64)> = report.extras.iter().map(|e| (e.what.as_str(), e.count)).collect();
    let (long, short) =
        ("attachment ../calib.bin (application/x, 3145728 bytes)", "attachment ../calib.bin (application/x, 6 bytes)");
    assert_eq!(whats, [(long, 1), (short, 1), ("metadata crew (1 text)", 2)]);
    assert_eq!(extras(&out), extras(&log));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
}

#[test]
fn intact_attachments_are_recovered_and_the_damaged_one_is_a_loss() {
    let folder = tempfile::tempdir().unwrap();
    let (log, out) = (folder.path().join("log.mcap"), folder.path().join("out.mcap"));
    with_extras(&log);
    let whole = extras(&log);
    let mut bytes = std::fs::read(&log).unwrap();
    bytes[1 << 20] ^= 1;
    let text = b"second";
    let second = bytes.windows(text.len()).position(|w| w == text).unwrap();
    bytes.truncate(second + 200);
    std::fs::write(&log, &bytes).unwrap();
    let report = recovered(&log, &out).unwrap();
    assert!(report.any_loss());
    assert!(report.health.damage.iter().any(|d| d.reason.contains("calib.bin")), "{:?}", report.health.damage);
    let (attachments, metadata) = extras(&out);
    assert_eq!(attachments, whole.0[1..]);
    assert_eq!(metadata, whole.1);
}

#[test]
fn ulog_content_other_than_topics_becomes_metadata() {
    let folder = tempfile::tempdir().unwrap();
    let message = |kind: u8, body: &[u8]| [&(body.len() as u16).to_le_bytes()[..], &[kind], body].concat();
    let entry = |key: &str, value: &[u8]| [&[key.len() as u8], key.as_bytes(), value].concat();
    let prefixed = |flag: u8, entry: Vec<u8>| [&[flag][..], &entry].concat();
    let data = |us: u64| message(b'D', &[&0_u16.to_le_bytes()[..], &us.to_le_bytes(), &1_f32.to_le_bytes()].concat());
    let log = [
        b"ULog\x01\x12\x35\x01\0\0\0\0\0\0\0\0".to_vec(),
        message(b'F', b"gps:uint64_t timestamp;float lat;"),
        message(b'I', &entry("char[3] sys_name", b"PX4")),
        message(b'I', &entry("uint64_t id", &u64::MAX.to_le_bytes())),
        message(b'M', &prefixed(0, entry("char[2] boot", b"ab"))),
        message(b'M', &prefixed(1, entry("char[2] boot", b"cd"))),
        message(b'P', &entry("float EKF2_GPS_DELAY", &110_f32.to_le_bytes())),
        message(b'Q', &prefixed(2, entry("int32_t A", &7_i32.to_le_bytes()))),
        message(b'A', &[&[0][..], &0_u16.to_le_bytes(), b"gps"].concat()),
        data(1_000_000),
        message(b'P', &entry("float EKF2_GPS_DELAY", &150_f32.to_le_bytes())),
        message(b'O', &12_u16.to_le_bytes()),
        message(b'L', &[&b"4"[..], &1_500_000_u64.to_le_bytes(), b"=low battery"].concat()),
        data(2_000_000),
    ];
    let (path, out) = (folder.path().join("log.ulg"), folder.path().join("out.mcap"));
    std::fs::write(&path, log.concat()).unwrap();
    let report = recovered(&path, &out).unwrap();
    assert_eq!((report.how, report.any_loss()), (How::Rewritten, false), "{:?}", report.notices);
    let bytes = std::fs::read(&out).unwrap();
    let mut found = BTreeMap::new();
    for record in mcap::read::LinearReader::new(&bytes).unwrap() {
        if let mcap::records::Record::Metadata(m) = record.unwrap() {
            found.insert(m.name, m.metadata.into_iter().collect::<Vec<_>>());
        }
    }
    let pairs = |pairs: &[(&str, &str)]| -> Vec<(String, String)> {
        pairs.iter().map(|(a, b)| ((*a).to_owned(), (*b).to_owned())).collect()
    };
    let information = [("boot #000001", "abcd"), ("id", "uint64_t 0xffffffffffffffff"), ("sys_name", "PX4")];
    assert_eq!(found["ulog information"], pairs(&information));
    assert_eq!(found["ulog parameters"], pairs(&[("EKF2_GPS_DELAY", "110.0")]));
    assert_eq!(found["ulog default parameters"], pairs(&[("A: configuration", "7")]));
    assert_eq!(found["ulog parameter changes"], pairs(&[("#000002 at 1.000000 s: EKF2_GPS_DELAY", "150.0")]));
    assert_eq!(found["ulog dropouts"], pairs(&[("#000003 at 1.000000 s", "12 ms")]));
    assert_eq!(found["ulog texts"], pairs(&[("#000004 at 1.500000 s: WARNING", "=low battery")]));
    // And what a reader needs to treat it as the original.
    assert_eq!(report.extras.len(), 7);
    assert!(found["flightlag-recover"].iter().any(|(key, value)| key == "inputs" && value == "log.ulg"));
}

/// Log times of all messages as any MCAP reader finds them.
fn log_times(out: &Path) -> Vec<i64> {
    let bytes = std::fs::read(out).unwrap();
    mcap::MessageStream::new(&bytes).unwrap().map(|message| message.unwrap().log_time as i64).collect()
}

#[test]
fn rows_without_log_times_are_recovered_with_their_own_utc() {
    for container in [Container::Ubx, Container::Nmea, Container::CsvWide, Container::CsvFolder] {
        let folder = tempfile::tempdir().unwrap();
        let log = write(container, folder.path());
        let out = folder.path().join("out.mcap");
        let report = recovered(&log, &out).unwrap();
        assert_eq!(report.how, How::Rewritten);
        assert!(report.topics.iter().all(|t| t.found == t.written && t.written > 0), "{:?}", report.topics);
        assert!(!report.any_loss(), "{container:?}: {:?}", report.notices);
        let flight = read(&log).flight;
        let unix = |channel: &Channel| {
            let timeline = channel.series.timeline();
            let unix = |stamp: Option<Stamp>| flight.unix(timeline.clock(), stamp.unwrap()).unwrap().0;
            [unix(timeline.first()), unix(timeline.last())]
        };
        let truth: Vec<i64> = flight.channels.values().flat_map(unix).collect();
        let logged = log_times(&out);
        let (first, last) = (*logged.iter().min().unwrap(), *logged.iter().max().unwrap());
        assert_eq!(logged.len() as u64, report.topics.iter().map(|t| t.found).sum::<u64>());
        // Rows that no channel could use are within a second of rows that one could.
        let near = |found: i64, truth: i64| found.abs_diff(truth) < 1_000_000_000;
        assert!(near(first, *truth.iter().min().unwrap()), "{container:?} {first}");
        assert!(near(last, *truth.iter().max().unwrap()), "{container:?} {last}");
        let notice = report.notices.iter().find(|n| n.code == "values-replaced").unwrap();
        assert!(notice.severity == Severity::Info && notice.text.contains("UTC: "), "{notice:?}");
        assert!(provenance(&out)["log_time"].contains("UTC: "));
    }
}

/// The `flightlag-recover` metadata.
fn provenance(out: &Path) -> BTreeMap<String, String> {
    let bytes = std::fs::read(out).unwrap();
    let records = mcap::read::LinearReader::new(&bytes).unwrap().map(Result::unwrap);
    let mut found = records.filter_map(|record| match record {
        mcap::records::Record::Metadata(m) if m.name == "flightlag-recover" => Some(m.metadata),
        _ => None,
    });
    found.next().unwrap()
}

#[test]
fn undated_rows_keep_their_order_with_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    let (log, out) = (folder.path().join("log.csv"), folder.path().join("out.mcap"));
    let rows: String = (0..30).map(|i| format!("{},{}\n", 30 - i, i * i)).collect();
    std::fs::write(&log, format!("rpm,volts\n{rows}")).unwrap();
    let report = recovered(&log, &out).unwrap();
    let table = tables(&out).remove(0);
    let rpm: Vec<f64> = (0..table.rows).filter_map(|row| table.column("rpm")?.number(row)).collect();
    assert_eq!(rpm, (1..=30).rev().map(f64::from).collect::<Vec<_>>());
    assert!(log_times(&out).windows(2).all(|pair| pair[0] < pair[1]));
    let notice = report.notices.iter().find(|n| n.code == "values-replaced").unwrap();
    assert!(notice.severity == Severity::Warning && notice.text.contains("only the order of the rows"), "{notice:?}");
}

#[test]
fn an_unbound_table_is_dated_by_a_known_stamp_field_if_it_is_a_date() {
    let folder = tempfile::tempdir().unwrap();
    let (log, out) = (folder.path().join("log.csv"), folder.path().join("out.mcap"));
    for (begin_ns, expected) in
        [(1_778_061_600_000_000_000_i64, "UTC: "), (5_000_000_000, "only the order of the rows")]
    {
        let rows: String = (0..30).map(|i| format!("{},{i}\n", begin_ns + i * 100_000_000)).collect();
        std::fs::write(&log, format!("%time,field.rpm\n{rows}")).unwrap();
        let report = recovered(&log, &out).unwrap();
        let notice = report.notices.iter().find(|n| n.code == "values-replaced").unwrap();
        assert!(notice.text.contains(expected), "{notice:?}");
        let first = log_times(&out)[0];
        assert!(first == begin_ns || expected != "UTC: ", "{first}");
    }
}

/// A DataFlash log of two types whose 32-bit milliseconds wrap around: every record holds its position in the log.
pub fn wrapped_dataflash() -> Vec<u8> {
    const HEAD: [u8; 2] = [0xa3, 0x95];
    let padded = |text: &str, size: usize| {
        let mut bytes = text.as_bytes().to_vec();
        bytes.resize(size, 0);
        bytes
    };
    let define = |id: u8, length: u8, name: &str, format: &str, columns: &str| {
        [&HEAD[..], &[128, id, length], &padded(name, 4), &padded(format, 16), &padded(columns, 64)].concat()
    };
    let mut log = define(128, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns");
    log.extend(define(130, 11, "FST", "II", "TimeMS,N"));
    log.extend(define(131, 11, "SLW", "II", "TimeMS,N"));
    for n in 0..600_u32 {
        let id = if n % 100 == 50 { 131 } else { 130 };
        let ms = (u32::MAX - 30_000).wrapping_add(n * 100);
        log.extend([&HEAD[..], &[id], &ms.to_le_bytes(), &n.to_le_bytes()].concat());
    }
    log
}

#[test]
fn a_recovered_log_keeps_its_order_across_a_clock_wraparound() {
    let folder = tempfile::tempdir().unwrap();
    let (log, out) = (folder.path().join("log.bin"), folder.path().join("out.mcap"));
    std::fs::write(&log, wrapped_dataflash()).unwrap();
    let report = recovered(&log, &out).unwrap();
    let bytes = std::fs::read(&out).unwrap();
    let mut found: Vec<(u64, u32)> = vec![];
    for message in mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap) {
        if message.channel.topic != "FMT" {
            // After the CDR header: N, then TimeMS.
            let place = f64::from_le_bytes(message.data[4..12].try_into().unwrap());
            found.push((message.log_time, place as u32));
        }
    }
    let places: Vec<u32> = found.iter().map(|(_, place)| *place).collect();
    assert_eq!(places, (0..600).collect::<Vec<_>>());
    assert!(found.windows(2).all(|pair| pair[1].0 - pair[0].0 == 100_000_000), "log_time is continuous");
    assert!(report.notices.iter().any(|n| n.code == "stamp-wrap"), "{:?}", report.notices);
}
