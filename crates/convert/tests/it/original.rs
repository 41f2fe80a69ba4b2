//! A recovered log reads the same as its original.

use crate::flight::{in_context, library, read, unit};
use crate::recover::wrapped_dataflash;
use convert::recover;
use flight::{ChannelHealth, Flight, LogHealth, Severity, StampKind, TopicHealth};
use ingest::{Loaded, Selection, Table, TopicInfo};
use simulate::{Container, Seed, seeds};
use std::path::{Path, PathBuf};

/// Everything found in a log, except its container.
fn tables(log: &Path) -> Vec<Table> {
    let unit = unit(log);
    in_context(|c| ingest::read(&unit, &|_: &TopicInfo| Selection::All, c)).unwrap().tables
}

/// Makes the tables of a recovered log comparable with the original. Two things differ: MCAP has a publish time even if
/// the log had none, and undecoded messages of a receiver become a table of their own.
fn twins(before: &mut [Table], after: &mut Vec<Table>) {
    let decoded = |twin: &Table| before.iter().any(|table| table.topic == twin.topic);
    after.retain(|twin| !["nmea", "ubx", "mavlink"].contains(&twin.topic.encoding.as_str()) || decoded(twin));
    for (table, twin) in before.iter_mut().zip(after) {
        if table.published_ns.is_none() {
            assert!(twin.published_ns.is_none() || twin.published_ns == twin.logged_ns);
            twin.published_ns = None;
        }
    }
}

/// As text, because NaN floats do not compare equal.
fn shown(tables: &[Table]) -> Vec<String> {
    tables.iter().map(|table| format!("{table:?}")).collect()
}

/// Topics without message sizes, which belong to the container, and without publish times, which
/// MCAP has even if the log had none.
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

/// The cost of binding channels, except publish times.
fn channels(channels: &[ChannelHealth]) -> Vec<ChannelHealth> {
    let bare = |channel: &ChannelHealth| {
        let mut channel = channel.clone();
        channel.offsets.retain(|offset| ![offset.of, offset.against].contains(&StampKind::Published));
        channel
    };
    channels.iter().map(bare).collect()
}

/// Differences between two flights and their health; what belongs to the container is excluded.
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
        let reported = flight.notices.iter().filter(|n| n.severity != Severity::Info && n.code != "damaged");
        reported.map(|n| format!("{} {} {} {}", n.code, n.place, n.count, n.text)).collect()
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

/// Recovers a log and reads both: the differences, and whether anything was lost on the way.
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
        // The notice about a bag's missing index does not apply to an MCAP.
        let no_index = seed.name == "bag-unindexed";
        let reported = if no_index { vec!["incomplete-recording"] } else { vec![] };
        let kinds: Vec<&str> = differences.iter().filter_map(|d| d.split(' ').next()).collect();
        assert_eq!((kinds, lost), (reported, no_index), "{}: {differences:#?}", seed.name);
    }
}

#[test]
fn a_recovered_mcap_reads_as_the_original_bit_for_bit() {
    all_seeds_are_read_as_they_were(|container| matches!(container, Container::Mcap(_)));
}

#[test]
fn a_recovered_bag_reads_as_the_original_bit_for_bit() {
    all_seeds_are_read_as_they_were(|container| matches!(container, Container::Bag(_) | Container::Db3(_)));
}

#[test]
fn a_recovered_log_of_any_other_format_reads_as_the_original() {
    let other = |c| !matches!(c, Container::Mcap(_) | Container::Bag(_) | Container::Db3(_));
    all_seeds_are_read_as_they_were(other);
}

#[test]
fn a_recovered_log_keeps_its_stamps_across_a_clock_wraparound() {
    let folder = tempfile::tempdir().unwrap();
    let (log, out) = (folder.path().join("log.bin"), folder.path().join("out.mcap"));
    std::fs::write(&log, wrapped_dataflash()).unwrap();
    in_context(|context| recover(&unit(&log), library(), &out, context)).unwrap();
    let before = tables(&log);
    assert!(before.iter().flat_map(|t| t.logged_ns.iter().flatten()).any(|ns| *ns < 30_000_000_000));
    assert_eq!(shown(&before), shown(&tables(&out)));
}

#[test]
fn a_log_recovered_twice_reads_as_the_original() {
    let mut replaced = 0;
    for seed in seeds().unwrap().iter().filter(|seed| ["dataflash-binary", "csv-wide"].contains(&seed.name)) {
        let folder = tempfile::tempdir().unwrap();
        let log = write_seed(seed, folder.path());
        let (once, twice) = (folder.path().join("once.mcap"), folder.path().join("twice.mcap"));
        for (log, out) in [(&log, &once), (&once, &twice)] {
            let reported = in_context(|context| recover(&unit(log), library(), out, context)).unwrap().notices;
            replaced += reported.iter().filter(|n| n.code == "values-replaced").map(|n| n.count).sum::<u64>();
        }
        let (before, after) = (read(&log), read(&twice));
        assert_eq!(before.flight.channels, after.flight.channels, "{}", seed.name);
        assert_eq!(before.health.about, after.health.about, "{}", seed.name);
        let (mut before, mut after) = (tables(&log), tables(&twice));
        twins(&mut before, &mut after);
        assert_eq!(shown(&before), shown(&after));
    }
    assert!(replaced > 0, "cells that not every row has are placeholders in what is written");
}

/// A text table and its recovered log.
fn of_text(text: &str) -> (Loaded, Loaded) {
    let folder = tempfile::tempdir().unwrap();
    let (log, out) = (folder.path().join("log.csv"), folder.path().join("out.mcap"));
    std::fs::write(&log, text).unwrap();
    in_context(|context| recover(&unit(&log), library(), &out, context)).unwrap();
    (read(&log), read(&out))
}

fn stamps(loaded: &Loaded, channel: &str) -> Vec<i64> {
    loaded.flight.channels[channel].series.timeline().stamps().iter().map(|stamp| stamp.0).collect()
}

#[test]
fn decimals_beyond_float_precision_give_the_same_stamps_once_recovered() {
    let nanos = |row: i64| row * 3_333_331 + 123;
    let row = |row| format!("1700000000.{:09},{}\n", nanos(row), row);
    let text = (0..100).map(row).collect::<String>();
    let (before, after) = of_text(&format!("time_unix_s,encoder_angle_deg\n{text}"));
    let truth: Vec<i64> = (0..100).map(|row| 1_700_000_000_000_000_000 + nanos(row)).collect();
    assert_eq!(stamps(&after, "encoder.angle"), truth);
    assert_eq!(before.flight.channels, after.flight.channels);
}

#[test]
fn numeric_dates_and_offsets_date_the_recovered_log_too() {
    let row = |row: u32| format!("20210605,09:30:0{row}.5,{},8.5,500\n", 47.3 + 1e-5 * f64::from(row));
    let rows = (0..10).map(row).collect::<String>();
    let (_, after) = of_text(&format!("Date,Time,PosLat,PosLon,PosAlt\n{rows}"));
    // date -u -d '2021-06-05T09:30:00Z' +%s
    let truth: Vec<i64> = (0..10).map(|row| 1_622_885_400_500_000_000 + row * 1_000_000_000).collect();
    assert_eq!(stamps(&after, "position.ins"), truth);
    for offset in ["+0200", "+02", "+02:00", "-0330"] {
        let rows =
            (0..10).map(|row| format!("2021-06-05,09:30:0{row},{offset},47.{row},8.5,500\n")).collect::<String>();
        let (before, after) = of_text(&format!("Lcl Date,Lcl Time,UTCOfst,Latitude,Longitude,AltGPS\n{rows}"));
        assert_eq!(before.flight.channels, after.flight.channels, "{offset}");
        assert_eq!(stamps(&after, "position.gps").len(), 10, "{offset}");
    }
}

/// An MCAP with one channel for each of these: its metadata, and the sequence numbers of its messages.
fn of_channels(out: &Path, log: &str, channels: &[(Option<&str>, &[u32])]) {
    let mut writer = mcap::Writer::new(std::fs::File::create(out).unwrap()).unwrap();
    let entries = |key: &str, value: &str| [(key.to_owned(), value.to_owned())].into();
    let metadata = mcap::records::Metadata { name: "flightlag-original".to_owned(), metadata: entries("log", log) };
    writer.write_metadata(&metadata).unwrap();
    let schema = writer.add_schema("flightlag/msg/A", "ros2msg", b"uint64 a # \"A\"\n").unwrap();
    for (number, (original, sequences)) in (1_u64..).zip(channels) {
        let mut entries: std::collections::BTreeMap<String, String> =
            original.map_or_else(Default::default, |original| entries("flightlag-original", original));
        // The writer merges identical channels.
        entries.insert("number".to_owned(), number.to_string());
        let channel_id = writer.add_channel(schema, "A", "cdr", &entries).unwrap();
        for (time, sequence) in (1_u64..).zip(*sequences) {
            let (log_time, publish_time) = (1_000_000_000 * time, 1_000_000 * time);
            let header = mcap::records::MessageHeader { channel_id, sequence: *sequence, log_time, publish_time };
            writer.write_to_known_channel(&header, &[&[0, 1, 0, 0][..], &time.to_le_bytes()].concat()).unwrap();
        }
    }
    writer.finish().unwrap();
}

#[test]
fn copied_messages_keep_their_sequence_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let (log, out) = (folder.path().join("log.mcap"), folder.path().join("out.mcap"));
    of_channels(&log, "", &[(None, &[7, 3, u32::MAX])]);
    in_context(|context| recover(&unit(&log), library(), &out, context)).unwrap();
    let bytes = std::fs::read(&out).unwrap();
    let sequences: Vec<u32> = mcap::MessageStream::new(&bytes).unwrap().map(|m| m.unwrap().sequence).collect();
    assert_eq!(sequences, [7, 3, u32::MAX]);
}

#[test]
fn channels_that_disagree_on_their_original_topic_are_a_loss_but_one() {
    let original = |clock: &str| format!(r#"{{"type_name":"flightlag/msg/A","encoding":"cdr","clock":{clock}}}"#);
    let (boot, unix, none) = (original("\"boot\""), original("\"unix\""), original("null"));
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("log.mcap");
    let plain = None;
    for (first, second) in [
        (Some(boot.as_str()), Some(unix.as_str())),
        (Some(&boot), Some(&none)),
        (Some(&none), Some(&boot)),
        (Some(&boot), plain),
        (plain, Some(&boot)),
    ] {
        of_channels(&log, "", &[(first, &[1, 2]), (second, &[3, 4, 5]), (first, &[6])]);
        let table = tables(&log).remove(0);
        assert_eq!(table.rows, 3, "{first:?} {second:?}");
        assert_eq!(table.published_ns.is_some(), first.is_none());
        let lost = read(&log).flight.notices.iter().find(|n| n.severity == Severity::Loss).cloned().unwrap();
        assert_eq!((lost.code.as_str(), lost.count), ("undecodable", 3));
        assert!(lost.text.contains("another channel of the same topic"), "{}", lost.text);
    }
}

#[test]
fn excessive_metadata_is_truncated_and_reported() {
    let notice = r#"{"severity":"loss","code":"c","place":"","count":1,"text":"t"}"#;
    let many = |what: &str| vec![what; 2000].join(",");
    let log = format!(
        r#"{{"format":"{}","extras":[{}],"about":{{"texts":[{}]}},"units":[],"restarts":[],"notices":[{}]}}"#,
        "F".repeat(10_000),
        many("\"e\""),
        many("\"t\""),
        many(notice)
    );
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.mcap");
    of_channels(&path, &log, &[(None, &[1])]);
    let loaded = read(&path);
    // The metadata record itself is listed, too.
    assert_eq!((loaded.health.extras.len(), loaded.health.about.texts.len()), (1001, 1000));
    assert!(loaded.health.format.len() < 300);
    let count = |code: &str| loaded.flight.notices.iter().filter(|n| n.code == code).map(|n| n.count).sum::<u64>();
    assert_eq!((count("c"), count("index-differs")), (1000, 3000));
    assert!(!loaded.flight.notices.any_loss());
}

#[test]
fn losses_of_the_original_are_reported_but_are_not_losses_of_the_copy() {
    for seed in seeds().unwrap().iter().filter(|seed| ["ulog", "tlog", "mcap-cdr-none"].contains(&seed.name)) {
        let folder = tempfile::tempdir().unwrap();
        let log = write_seed(seed, folder.path());
        let mut bytes = std::fs::read(&log).unwrap();
        let middle = bytes.len() / 2;
        // Removing a piece of the only chunk would leave nothing; truncating its end is enough.
        match seed.name {
            "mcap-cdr-none" => bytes.truncate(bytes.len() * 3 / 4),
            _ => drop(bytes.drain(middle..middle + bytes.len() / 20)),
        }
        std::fs::write(&log, &bytes).unwrap();
        let out = folder.path().join("out.mcap");
        assert!(in_context(|context| recover(&unit(&log), library(), &out, context)).unwrap().any_loss());
        let (before, after) = (read(&log), read(&out));
        assert_eq!(before.flight.channels, after.flight.channels, "{}", seed.name);
        assert!(!after.flight.notices.any_loss(), "{:?}", after.flight.notices);
        let reported = after.flight.notices.iter().filter(|n| n.text.starts_with("when the log was recovered: "));
        let losses = before.flight.notices.iter().filter(|n| n.severity == Severity::Loss);
        assert_eq!(
            reported.map(|n| (&n.code, n.count)).collect::<Vec<_>>(),
            losses.map(|n| (&n.code, n.count)).collect::<Vec<_>>()
        );
    }
}

/// Messages of a recovered log as any MCAP reader finds them: topic, log time, bytes.
fn messages(out: &Path) -> Vec<(String, u64, Vec<u8>)> {
    let bytes = std::fs::read(out).unwrap();
    let messages = mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap);
    messages.map(|m| (m.channel.topic.clone(), m.log_time, m.data.into_owned())).collect()
}

#[test]
fn undecoded_sentences_are_copied_as_text_and_only_damaged_ones_lost() {
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
            // Starts at 2026-11-22 12:00:00 UTC.
            assert_eq!(*at, (1_795_348_800 + second as u64) * 1_000_000_000);
            assert!(bytes.windows(view.len()).any(|part| part == view.as_bytes()));
        }
        assert_eq!(read(&log).flight.channels, read(&out).flight.channels);
    }
}

#[test]
fn undecoded_frames_are_copied_byte_for_byte_with_their_epoch_time() {
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
