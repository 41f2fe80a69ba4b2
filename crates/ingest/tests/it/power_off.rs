//! How a log ends that was written until power-off.

use crate::support::{file, load};
use flight::Severity;
use ingest::{FlightUnit, Loaded, LogKind};

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
