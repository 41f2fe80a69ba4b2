//! Fuzzing finds: kept in tests/regress, a folder for each target, read by every run.

use crate::lab::Lab;
use ingest::{ChannelMap, Limits, LogKind, MapLibrary, ReadContext, discover};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

fn finds(target: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/regress").join(target);
    let Ok(entries) = std::fs::read_dir(folder) else { return vec![] };
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    paths
}

#[test]
fn finds_in_logs_stay_fixed() {
    let mut lab = Lab::new();
    for (target, kind) in [
        ("mcap", LogKind::Mcap),
        ("definition", LogKind::Mcap),
        ("bag", LogKind::Bag),
        ("db3", LogKind::Db3),
        ("ulog", LogKind::Ulog),
        ("dataflash", LogKind::DataFlash),
        ("csv", LogKind::Csv),
        ("tlog", LogKind::Tlog),
        ("ubx", LogKind::Ubx),
        ("nmea", LogKind::Nmea),
    ] {
        for path in finds(target) {
            let subject = lab.single(kind, "log.csv");
            let _ = lab.read(&subject, &std::fs::read(&path).unwrap(), &path.display().to_string());
        }
    }
}

#[test]
fn finds_in_whole_flights_stay_fixed() {
    let library = MapLibrary::shipped().unwrap();
    let context = ReadContext { limits: Limits::default(), cancel: &AtomicBool::new(false), on_bytes: &|_| () };
    for path in finds("flight") {
        for unit in discover(&path, &library).unwrap().units {
            let _ = ingest::load(&unit, &library, None, &context);
        }
    }
}

#[test]
fn finds_in_channel_maps_stay_fixed() {
    for path in finds("channel-map") {
        let _ = ChannelMap::from_toml(&path, &String::from_utf8_lossy(&std::fs::read(&path).unwrap()));
    }
}

#[test]
fn a_length_spanning_two_messages_and_two_lines_in_one_are_reported() {
    let mut lab = Lab::new();
    for (find, kind, code) in [
        ("bag/length-that-swallows-two-messages.bag", LogKind::Bag, "damaged"),
        ("dataflash/two-lines-in-one.log", LogKind::DataFlash, "damaged"),
    ] {
        let bytes = std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/regress").join(find)).unwrap();
        let subject = lab.single(kind, "find.log");
        let log = lab.read(&subject, &bytes, find).unwrap();
        assert!(log.notices.iter().any(|n| n.code == code), "{find}: {:?}", log.notices);
    }
}
