//! Offsets of a seed's records, found independently of the reader.

use simulate::{BagCompression, BagSettings, Container, Db3Compression, Db3Settings, Seed};
use std::iter::once;
use std::ops::Range;

/// Where a log may end without anything missing: after a whole record, if the format has no end marker.
pub enum Ends {
    Nowhere,
    At(Vec<usize>),
}

impl Ends {
    pub fn of(seed: &Seed, damaged: usize) -> Ends {
        let bytes = &seed.files[damaged].bytes;
        match seed.container {
            Container::Ulog => Ends::At(ulog_ends(bytes)),
            Container::DataFlash => Ends::At(dataflash_ends(bytes)),
            // A line is complete with or without its line end.
            Container::DataFlashText | Container::CsvWide | Container::CsvFolder | Container::Nmea => {
                let ends = bytes.iter().enumerate().filter(|(_, b)| **b == b'\n').map(|(at, _)| at + 1);
                let returns = usize::from(seed.container == Container::Nmea);
                Ends::At([0].into_iter().chain(ends.flat_map(|end| end - 1 - returns..=end)).collect())
            }
            Container::Ubx => Ends::At(ubx_ends(bytes)),
            Container::Tlog => Ends::At(tlog_ends(bytes)),
            // The recorder's sidecar is only a hint, damaged or not.
            Container::Db3(_) if seed.files[damaged].path.ends_with("metadata.yaml") => {
                Ends::At((0..bytes.len()).collect())
            }
            // A bag without an index already reports a loss, and no other.
            Container::Bag(BagSettings { indexed: false, .. }) => Ends::At((0..bytes.len()).collect()),
            Container::Mcap(_) | Container::Bag(_) | Container::Db3(_) => Ends::Nowhere,
        }
    }

    pub fn allow(&self, length: usize) -> bool {
        match self {
            Ends::Nowhere => false,
            Ends::At(places) => places.binary_search(&length).is_ok(),
        }
    }
}

/// Walks records that each state their own length.
fn walk(bytes: &[u8], start: usize, mut length: impl FnMut(&[u8]) -> usize) -> Vec<usize> {
    let mut ends = vec![start];
    let mut at = start;
    while at < bytes.len() {
        at += length(&bytes[at..]);
        ends.push(at);
    }
    assert_eq!(at, bytes.len(), "the seed is whole");
    ends
}

fn ulog_ends(bytes: &[u8]) -> Vec<usize> {
    walk(bytes, 16, |rest| 3 + usize::from(u16::from_le_bytes([rest[0], rest[1]])))
}

fn dataflash_ends(bytes: &[u8]) -> Vec<usize> {
    let mut lengths = [0_usize; 256];
    lengths[128] = 89;
    walk(bytes, 0, |rest| {
        if rest[2] == 128 {
            lengths[usize::from(rest[3])] = rest[4].into();
        }
        lengths[usize::from(rest[2])]
    })
}

fn ubx_ends(bytes: &[u8]) -> Vec<usize> {
    walk(bytes, 0, |rest| 8 + usize::from(u16::from_le_bytes([rest[4], rest[5]])))
}

/// A timestamp of eight bytes, then a frame of MAVLink 1 or 2.
fn tlog_ends(bytes: &[u8]) -> Vec<usize> {
    walk(bytes, 0, |rest| match rest[8] {
        0xfe => 8 + 8 + usize::from(rest[9]),
        0xfd => 8 + 12 + usize::from(rest[9]) + if rest[10] & 1 == 1 { 13 } else { 0 },
        other => panic!("no frame begins with {other:x}"),
    })
}

/// Ranges that define how other bytes are read: damage there may change all of those.
pub fn definitions(seed: &Seed, damaged: usize) -> Vec<Range<usize>> {
    let bytes = &seed.files[damaged].bytes;
    match seed.container {
        Container::Ulog => {
            records(&ulog_ends(bytes)).filter(|r| bytes[r.start + 2] != b'D').chain(once(0..16)).collect()
        }
        Container::DataFlash => {
            let types: Vec<u8> = records(&dataflash_ends(bytes))
                .filter(|r| {
                    bytes[r.start + 2] == 128
                        && [&b"FMTU"[..], b"UNIT", b"MULT"].contains(&&bytes[r.start + 5..r.start + 9])
                })
                .map(|r| bytes[r.start + 3])
                .chain([128])
                .collect();
            records(&dataflash_ends(bytes)).filter(|r| types.contains(&bytes[r.start + 2])).collect()
        }
        Container::DataFlashText => {
            let defines = |line: &&[u8]| ["FMT", "UNIT", "MULT"].iter().any(|name| line.starts_with(name.as_bytes()));
            let length = bytes.split_inclusive(|b| *b == b'\n').take_while(defines).map(<[u8]>::len).sum();
            // A free text that loses its line end continues on the next line.
            let mut at = 0;
            let texts = bytes.split_inclusive(|b| *b == b'\n').filter_map(|line| {
                at += line.len();
                line.starts_with(b"MSG").then_some(at - 1..at)
            });
            once(0..length).chain(texts).collect()
        }
        Container::CsvWide | Container::CsvFolder => {
            // The first row decides between integer and float columns: a timestamp there that is too large for an
            // integer makes its column a float column.
            let lines = if seed.container == Container::CsvWide { 3 } else { 2 };
            once(0..bytes.split_inclusive(|b| *b == b'\n').take(lines).map(<[u8]>::len).sum()).collect()
        }
        Container::Bag(BagSettings { compression: BagCompression::None, .. }) => bag_definitions(bytes),
        // Recorders pack without a checksum, and one bit of a packed file can affect all later bytes.
        Container::Db3(Db3Settings { compression: Db3Compression::ZstdFile, .. }) => once(0..bytes.len()).collect(),
        Container::Db3(_) if damaged == 0 => db3_definitions(bytes),
        _ => vec![],
    }
}

/// The pages of the tables `topics` and `message_definitions`, as SQLite lays them out for the seeds: of 4096 bytes, the
/// fourth and from the seventh on.
fn db3_definitions(bytes: &[u8]) -> Vec<Range<usize>> {
    let page = |number: usize| (number - 1) * 4096..number * 4096;
    let topics = b"/gps/fix";
    assert!(bytes[page(4)].windows(topics.len()).any(|w| w == topics), "the topics are on another page");
    once(page(4)).chain(once(page(7).start..bytes.len())).collect()
}

fn records(ends: &[usize]) -> impl Iterator<Item = Range<usize>> {
    ends.windows(2).map(|pair| pair[0]..pair[1])
}

/// All but the messages: they say their type as the first field of their header.
fn bag_definitions(bytes: &[u8]) -> Vec<Range<usize>> {
    let places = bytes.windows(8).enumerate().filter(|(_, w)| w.starts_with(b"\x04\0\0\0op="));
    let starts: Vec<(usize, u8)> = places.map(|(at, w)| (at, w[7])).chain([(bytes.len(), 0)]).collect();
    starts.windows(2).filter(|pair| pair[0].1 != 2).map(|pair| pair[0].0 - 4..pair[1].0).collect()
}
