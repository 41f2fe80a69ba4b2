//! A recovered log is read as the log that it comes from.

use crate::flight::{in_context, library, read, unit};
use crate::recover::wrapped_dataflash;
use convert::recover;
use flight::{ChannelHealth, Flight, LogHealth, Severity, StampKind, TopicHealth};
use ingest::{Loaded, Selection, Table, TopicInfo};
use simulate::{Container, Seed, seeds};
use std::path::{Path, PathBuf};

/// All that is found in a log, its container aside.
fn tables(log: &Path) -> Vec<Table> {
    let unit = unit(log);
    in_context(|c| ingest::open(&unit).read(&|_: &TopicInfo| Selection::All, c)).unwrap().tables
}

/// Those of a recovered log as the original has them. Two things differ: MCAP has a time of publishing also where the log had
/// none, and what is not decoded of a receiver's messages is a table of its own.
fn twins(before: &mut [Table], after: &mut Vec<Table>) {
    let decoded = |twin: &Table| before.iter().any(|table| table.topic == twin.topic);
    after.retain(|twin| !["nmea", "ubx", "mavlink"].contains(&twin.topic.encoding.as_str()) || decoded(twin));
    for (table, twin) in before.iter_mut().zip(after) {
        let origins = |table: &Table| -> Vec<u64> { (0..table.rows).map(|row| table.origin_of(row)).collect() };
        (table.origin, twin.origin) = (Some(origins(table)), Some(origins(twin)));
        if table.published_ns.is_none() {
            assert!(twin.published_ns.is_none() || twin.published_ns == twin.logged_ns);
            twin.published_ns = None;
        }
    }
}

/// As text, for floats that are NaN are no equals.
fn shown(tables: &[Table]) -> Vec<String> {
    tables.iter().map(|table| format!("{table:?}")).collect()
}

/// Topics but for the size of their messages, and for times of publishing, which MCAP has also where the log had none.
fn topics(health: &LogHealth) -> Vec<TopicHealth> {
    let bare = |topic: &TopicHealth| {
        let mut topic = TopicHealth { payload_bytes: 0, ..topic.clone() };
        if topic.encoding == "csv" {
            // A table without a wanted column says so; a message that is read for none of its fields does not.
            (topic.decoded, topic.reason) = (true, String::new());
        }
        topic.stamps.retain(|stamps| stamps.kind != StampKind::Published);
        topic
    };
    health.topics.iter().map(bare).collect()
}

/// What it cost to bind channels, but for times of publishing.
fn channels(channels: &[ChannelHealth]) -> Vec<ChannelHealth> {
    let bare = |channel: &ChannelHealth| {
        let mut channel = channel.clone();
        channel.offsets.retain(|offset| ![offset.of, offset.against].contains(&StampKind::Published));
        channel
    };
    channels.iter().map(bare).collect()
}

/// How two flights and what is known of their logs differ; the containers' own things are left out.
fn differences(before: &Loaded, after: &Loaded) -> Vec<String> {
    let mut found = vec![];
    let mut compare = |what: &str, same: bool| {
        if !same {
            found.push(what.to_owned());
        }
    };
    compare("channels", before.flight.channels == after.flight.channels);
    compare("UTC", before.flight.utc == after.flight.utc && before.health.utc == after.health.utc);
    compare("what the log says of itself", before.health.about == after.health.about);
    for (a, b) in topics(&before.health).iter().zip(&topics(&after.health)).filter(|(a, b)| a != b) {
        compare(&format!("topic {a:?} is {b:?}"), false);
    }
    compare("topics", topics(&before.health) == topics(&after.health));
    let bound = |loaded: &Loaded| loaded.binding.as_ref().map_or(vec![], |binding| channels(&binding.channels));
    for (a, b) in bound(before).iter().zip(&bound(after)).filter(|(a, b)| a != b) {
        compare(&format!("channel {a:?} is {b:?}"), false);
    }
    compare("map", before.binding.as_ref().ok().map(|b| &b.map) == after.binding.as_ref().ok().map(|b| &b.map));
    let heard = |flight: &Flight| -> Vec<String> {
        let told = flight.notices.iter().filter(|n| n.severity != Severity::Info && n.code != "damaged");
        told.map(|n| format!("{} {} {} {}", n.code, n.place, n.count, n.text)).collect()
    };
    let after_heard = heard(&after.flight);
    for notice in heard(&before.flight) {
        compare(&notice, after_heard.contains(&notice));
    }
    found
}

fn write_seed(seed: &Seed, folder: &Path) -> PathBuf {
    for file in &seed.files {
        let path = folder.join(&file.path);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, &file.bytes).unwrap();
    }
    folder.join(seed.container.path(seed.name))
}

/// Recovers a log and reads both: how they differ, and whether something was lost on the way.
fn recovered(log: &Path, out: &Path) -> (Vec<String>, bool) {
    let report = in_context(|context| recover(&unit(log), library(), out, context)).unwrap();
    let mut found = differences(&read(log), &read(out));
    let (mut before, mut after) = (tables(log), tables(out));
    twins(&mut before, &mut after);
    if before.len() != after.len() {
        found.push(format!("{} tables are {}", before.len(), after.len()));
    }
    let differ = shown(&before).into_iter().zip(shown(&after)).find(|(a, b)| a != b);
    found.extend(differ.map(|(a, b)| format!("{a:.1000}\nis\n{b:.1000}")));
    (found, report.any_loss())
}

fn all_seeds_are_read_as_they_were(of: impl Fn(Container) -> bool) {
    for seed in seeds().unwrap().iter().filter(|seed| of(seed.container)) {
        let folder = tempfile::tempdir().unwrap();
        let log = write_seed(seed, folder.path());
        let (differences, lost) = recovered(&log, &folder.path().join("recovered.mcap"));
        // What the missing index says of a bag is said of no MCAP.
        let no_index = seed.name == "bag-unindexed";
        let told = if no_index { vec!["no-end"] } else { vec![] };
        let kinds: Vec<&str> = differences.iter().filter_map(|d| d.split(' ').next()).collect();
        assert_eq!((kinds, lost), (told, no_index), "{}: {differences:#?}", seed.name);
    }
}

#[test]
fn a_recovered_mcap_is_read_as_the_original_bit_for_bit() {
    all_seeds_are_read_as_they_were(|container| matches!(container, Container::Mcap(_)));
}

#[test]
fn a_recovered_bag_is_read_as_the_original_bit_for_bit() {
    all_seeds_are_read_as_they_were(|container| matches!(container, Container::Bag(_) | Container::Db3(_)));
}

#[test]
fn a_recovered_log_of_any_other_format_is_read_as_the_original_bit_for_bit() {
    let other = |c| !matches!(c, Container::Mcap(_) | Container::Bag(_) | Container::Db3(_));
    all_seeds_are_read_as_they_were(other);
}

#[test]
fn where_the_clock_of_the_log_began_anew_the_recovered_log_has_its_stamps_all_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let (log, out) = (folder.path().join("log.bin"), folder.path().join("out.mcap"));
    std::fs::write(&log, wrapped_dataflash()).unwrap();
    in_context(|context| recover(&unit(&log), library(), &out, context)).unwrap();
    let before = tables(&log);
    assert!(before.iter().flat_map(|t| t.logged_ns.iter().flatten()).any(|ns| *ns < 30_000_000_000));
    assert_eq!(shown(&before), shown(&tables(&out)));
}

#[test]
fn a_log_that_was_recovered_twice_is_read_as_the_original() {
    for seed in seeds().unwrap().iter().filter(|seed| ["dataflash-binary", "csv-wide"].contains(&seed.name)) {
        let folder = tempfile::tempdir().unwrap();
        let log = write_seed(seed, folder.path());
        let (once, twice) = (folder.path().join("once.mcap"), folder.path().join("twice.mcap"));
        for (log, out) in [(&log, &once), (&once, &twice)] {
            in_context(|context| recover(&unit(log), library(), out, context)).unwrap();
        }
        let (before, after) = (read(&log), read(&twice));
        assert_eq!(before.flight.channels, after.flight.channels, "{}", seed.name);
        assert_eq!(before.health.about, after.health.about, "{}", seed.name);
    }
}

#[test]
fn what_was_lost_of_the_original_is_told_of_the_recovered_log_and_is_no_loss_of_it() {
    for seed in seeds().unwrap().iter().filter(|seed| ["ulog", "tlog", "mcap-cdr-none"].contains(&seed.name)) {
        let folder = tempfile::tempdir().unwrap();
        let log = write_seed(seed, folder.path());
        let bytes = std::fs::read(&log).unwrap();
        std::fs::write(&log, &bytes[..bytes.len() * 3 / 4]).unwrap();
        let out = folder.path().join("out.mcap");
        assert!(in_context(|context| recover(&unit(&log), library(), &out, context)).unwrap().any_loss());
        let (before, after) = (read(&log), read(&out));
        assert_eq!(before.flight.channels, after.flight.channels, "{}", seed.name);
        assert!(!after.flight.notices.any_loss(), "{:?}", after.flight.notices);
        let told = after.flight.notices.iter().filter(|n| n.text.starts_with("when the log was recovered: "));
        let losses = before.flight.notices.iter().filter(|n| n.severity == Severity::Loss);
        assert_eq!(
            told.map(|n| (&n.code, n.count)).collect::<Vec<_>>(),
            losses.map(|n| (&n.code, n.count)).collect::<Vec<_>>()
        );
    }
}

/// Messages of a recovered log as any reader of MCAP finds them: topic, log time, bytes.
fn messages(out: &Path) -> Vec<(String, u64, Vec<u8>)> {
    let bytes = std::fs::read(out).unwrap();
    let messages = mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap);
    messages.map(|m| (m.channel.topic.clone(), m.log_time, m.data.into_owned())).collect()
}

#[test]
fn sentences_that_are_not_read_are_carried_as_text_and_only_a_damaged_one_is_lost() {
    let sentence = |body: &str| format!("${body}*{:02X}\r\n", body.bytes().fold(0, |sum, byte| sum ^ byte));
    let view = "GPGSV,1,1,02,05,45,120,40,12,30,200,38";
    let epoch = |second: u64| {
        let date = format!("GPRMC,12000{second}.00,A,4717.11,N,00833.91,E,1.5,77.5,221126,,,A");
        [&date, view, "GPGSA,A,3,05,12,,,,,,,,,,,2.5,1.3,2.1", "PASHR,1,2,3"].map(sentence).concat()
    };
    let whole: String = (0..3).map(epoch).collect();
    let damaged = whole.replacen("GPGSA,A,3,05", "GPGSA,A,3,06", 1);
    let folder = tempfile::tempdir().unwrap();
    let (log, out) = (folder.path().join("log.nmea"), folder.path().join("out.mcap"));
    for (text, lost) in [(whole, 0), (damaged, 1)] {
        std::fs::write(&log, text).unwrap();
        let report = in_context(|context| recover(&unit(&log), library(), &out, context)).unwrap();
        assert_eq!(report.any_loss(), lost > 0, "{:?}", report.notices);
        let found = messages(&out);
        assert_eq!(found.len(), 12 - lost);
        let views: Vec<_> = found.iter().filter(|(topic, ..)| topic == "GPGSV").collect();
        assert_eq!(views.len(), 3);
        for (second, (_, at, bytes)) in views.iter().enumerate() {
            // From 2026-11-22 12:00:00 UTC on.
            assert_eq!(*at, (1_795_348_800 + second as u64) * 1_000_000_000);
            assert!(bytes.windows(view.len()).any(|part| part == view.as_bytes()));
        }
        assert_eq!(read(&log).flight.channels, read(&out).flight.channels);
    }
}

#[test]
fn frames_that_are_not_read_are_carried_byte_for_byte_with_the_time_of_their_epoch() {
    let frame = |class: u8, number: u8, payload: &[u8]| {
        let body = [&[class, number][..], &(payload.len() as u16).to_le_bytes(), payload].concat();
        let (mut a, mut b) = (0_u8, 0_u8);
        for byte in &body {
            a = a.wrapping_add(*byte);
            b = b.wrapping_add(a);
        }
        [&[0xb5, 0x62][..], &body, &[a, b]].concat()
    };
    // Week 2446, second 18: 2026-11-22 00:00:00 UTC.
    let week = [&18_000_u32.to_le_bytes()[..], &[0; 4], &2446_u16.to_le_bytes(), &[18, 7], &[0; 4]].concat();
    let raw: Vec<u8> = (0..=255).collect();
    let log_bytes = [frame(1, 0x20, &week), frame(2, 0x15, &raw), frame(1, 7, &[]), frame(1, 0x20, &week)].concat();
    let folder = tempfile::tempdir().unwrap();
    let (log, out) = (folder.path().join("log.ubx"), folder.path().join("out.mcap"));
    std::fs::write(&log, log_bytes).unwrap();
    let report = in_context(|context| recover(&unit(&log), library(), &out, context)).unwrap();
    assert!(!report.any_loss(), "{:?}", report.notices);
    let found = messages(&out);
    let topics: Vec<&str> = found.iter().map(|(topic, ..)| topic.as_str()).collect();
    assert_eq!((topics.len(), topics.contains(&"NAV-PVT-poll")), (4, true), "{topics:?}");
    assert!(found.iter().all(|(_, at, _)| *at == 1_795_305_600_000_000_000), "{found:?}");
    let (_, _, bytes) = found.iter().find(|(topic, ..)| topic == "RXM-0x15").unwrap();
    assert!(bytes.windows(256).any(|part| part == raw));
}
