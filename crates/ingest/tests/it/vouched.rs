//! Which topics are covered by a checksum, and how a log ends that was written until power-off.

use crate::support::{file, in_context, load};
use flight::Severity;
use ingest::{FlightUnit, Limits, Loaded, LogKind, MapLibrary, discover};
use simulate::seeds;
use std::collections::BTreeMap;

/// Every seed, read whole.
fn each_seed() -> BTreeMap<&'static str, Loaded> {
    let library = MapLibrary::shipped().unwrap();
    let read = |seed: simulate::Seed| {
        let folder = tempfile::tempdir().unwrap();
        for file in &seed.files {
            let path = folder.path().join(&file.path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, &file.bytes).unwrap();
        }
        let unit = discover(folder.path(), &library).unwrap().units.remove(0);
        let limits = Limits { may_leave_closed: false, ..Limits::default() };
        let loaded =
            crate::support::with_limits(limits, |context| ingest::load(&unit, &library, None, context)).unwrap();
        (seed.name, loaded)
    };
    seeds().unwrap().into_iter().map(read).collect()
}

#[test]
fn each_topic_reports_how_many_of_its_messages_have_a_checksum() {
    for (name, loaded) in each_seed() {
        let (messages, vouched): (u64, u64) =
            loaded.health.topics.iter().fold((0, 0), |(m, v), topic| (m + topic.messages, v + topic.vouched));
        let expected = match name.split('-').next().unwrap() {
            "mcap" | "tlog" | "ubx" | "nmea" => messages,
            _ => 0,
        };
        assert!(messages > 0, "{name}");
        assert_eq!(vouched, expected, "{name}");
    }
}

#[test]
fn only_sentences_with_a_checksum_count_as_verified() {
    let log = "$GPHDT,274.07,T\r\n$GPHDT,274.08,T\r\n$GPHDT,274.07,T*03\r\n".repeat(10);
    let (_folder, path) = file("a.nmea", log.as_bytes());
    let unit = FlightUnit { id: "a".into(), files: vec![path], kind: LogKind::Nmea };
    let library = MapLibrary::shipped().unwrap();
    let loaded = in_context(|context| ingest::load(&unit, &library, None, context)).unwrap();
    let topic = &loaded.health.topics[0];
    assert!(topic.vouched > 0 && topic.vouched < topic.messages, "{topic:?}");
}

/// Results for a log of this format truncated inside its last record, and inside a record in its first half.
fn cut(kind: LogKind, content: &[u8], by: usize) -> Loaded {
    let (_folder, path) = file("cut.bin", &content[..content.len() - by]);
    load(&FlightUnit { id: "cut".into(), files: vec![path], kind }).unwrap()
}

#[test]
fn a_log_without_a_stated_length_cut_in_its_last_record_lost_nothing() {
    let flight = simulate::simulate(&simulate::FlightSettings { duration_s: 60.0, ..Default::default() }).unwrap();
    let formats = [
        (simulate::Container::DataFlash, LogKind::DataFlash),
        (simulate::Container::DataFlashText, LogKind::DataFlash),
        (simulate::Container::Ulog, LogKind::Ulog),
        (simulate::Container::Tlog, LogKind::Tlog),
        (simulate::Container::Ubx, LogKind::Ubx),
        (simulate::Container::Nmea, LogKind::Nmea),
    ];
    for (container, kind) in formats {
        let content = container.files(&flight, "a").unwrap().remove(0).bytes;
        let loaded = cut(kind, &content, 5);
        let bytes = &loaded.health.bytes;
        assert!(bytes.tail_cut > 0 && bytes.damaged == 0, "{container:?}: {bytes:?}");
        assert_eq!(bytes.sum(), bytes.size, "{container:?}");
        assert!(!loaded.flight.notices.any_loss(), "{container:?}: {:?}", loaded.health.damage);
        let reported: Vec<_> = loaded.flight.notices.iter().filter(|n| n.code == "tail-cut").collect();
        assert_eq!(
            (reported.len(), reported[0].severity, reported[0].count),
            (1, Severity::Info, bytes.tail_cut),
            "{container:?}"
        );
    }
}

#[test]
fn a_log_that_states_its_end_and_lacks_it_has_lost_data() {
    let flight = simulate::simulate(&simulate::FlightSettings { duration_s: 60.0, ..Default::default() }).unwrap();
    let mcap = simulate::McapSettings {
        encoding: simulate::McapEncoding::Cdr,
        compression: simulate::McapCompression::None,
        summary: true,
    };
    let content = simulate::Container::Mcap(mcap).files(&flight, "a").unwrap().remove(0).bytes;
    for by in [5, content.len() * 2 / 5] {
        let loaded = cut(LogKind::Mcap, &content, by);
        assert!(
            loaded.flight.notices.any_loss() && loaded.health.bytes.tail_cut == 0,
            "{by}: {:?}",
            loaded.health.bytes
        );
    }
}

#[test]
fn healthy_flights_logged_until_power_off_are_not_damaged() {
    let Some(folder) = crate::support::real_logs("DeLorean/data") else { return };
    let mut tails: Vec<u64> = vec![];
    for entry in std::fs::read_dir(folder).unwrap().map(Result::unwrap) {
        let loaded = load(&FlightUnit { id: "a".into(), files: vec![entry.path()], kind: LogKind::DataFlash }).unwrap();
        assert!(!loaded.flight.notices.any_loss(), "{:?}: {:?}", entry.path(), loaded.health.damage);
        tails.push(loaded.health.bytes.tail_cut);
    }
    tails.sort_unstable();
    // The bytes that an independent walk over the records leaves at the end.
    assert_eq!(tails, [0, 0, 4, 13, 16, 18, 18, 21, 23, 25, 55]);
}
