//! For a damaged log the ledger adds up, the damage is reported, and 99 % of the rest is kept.

use crate::fingerprint::read;
use crate::{flight, written};
use flight::Severity;
use ingest::Log;
use simulate::{BagCompression, BagSettings, Container, McapCompression, McapEncoding, McapSettings};

/// The longest unit that one wrong byte may cost: a record, a line, or all of a chunk that has one checksum.
const RECORD: usize = 1000;

fn containers() -> [Container; 8] {
    let (encoding, compression) = (McapEncoding::Cdr, McapCompression::Unchunked);
    [
        Container::Mcap(McapSettings { encoding, compression, summary: true }),
        Container::Bag(BagSettings { compression: BagCompression::None, indexed: true }),
        Container::Ulog,
        Container::DataFlash,
        Container::DataFlashText,
        Container::Tlog,
        Container::Ubx,
        Container::Nmea,
    ]
}

fn rows(log: &Log) -> usize {
    log.tables.iter().map(|table| table.rows).sum()
}

fn noise(seed: usize, count: usize) -> Vec<u8> {
    let mut state = seed as u64 + 1;
    let next = |_| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as u8
    };
    (0..count).map(next).collect()
}

/// The bytes of a log with damage at a place, by name, and how many of its bytes are hurt.
fn damaged(bytes: &[u8], at: usize) -> [(&'static str, usize, Vec<u8>); 4] {
    let hit = |with: &[u8]| [&bytes[..at], with, &bytes[at + with.len()..]].concat();
    [
        ("512 zeros", 512, hit(&[0; 512])),
        ("512 random bytes", 512, hit(&noise(at, 512))),
        ("100 bytes deleted", 100, [&bytes[..at], &bytes[at + 100..]].concat()),
        ("cut", bytes.len() - at, bytes[..at].to_vec()),
    ]
}

#[test]
fn damage_is_reported_and_the_rest_is_kept() {
    let simulated = flight();
    for container in containers() {
        let folder = tempfile::tempdir().unwrap();
        let unit = written(container, &simulated, folder.path());
        let file = unit.files[0].clone();
        let bytes = std::fs::read(&file).unwrap();
        let whole = rows(&read(&unit).unwrap());
        for place in 1..6 {
            let at = bytes.len() * place / 6 + 37;
            for (what, hurt, content) in damaged(&bytes, at) {
                let case = format!("{container:?}: {what} at {at} of {}", bytes.len());
                std::fs::write(&file, &content).unwrap();
                let log = read(&unit).unwrap_or_else(|error| panic!("{case}: {error}"));
                let fates = &log.health.bytes;
                assert_eq!((fates.sum(), fates.size), (fates.size, content.len() as u64), "{case}: {fates:?}");
                let reported = log.notices.iter().any(|n| n.severity == Severity::Loss || n.code == "tail-cut");
                // A cut between two frames is an end.
                assert!(reported || what == "cut", "{case}: {:?}", log.notices);
                let share = (bytes.len() - hurt).saturating_sub(2 * RECORD) as f64 / bytes.len() as f64;
                let least = 0.99 * share * whole as f64;
                assert!(rows(&log) as f64 >= least, "{case}: {} rows of {whole}, at least {least:.0}", rows(&log));
            }
        }
    }
}
