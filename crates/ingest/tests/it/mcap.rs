//! MCAP: conformance, agreement with what was written, and handling of damage.

use crate::made::{
    CAMERA, Encoding, FIX, Layout, OnDisk, Sent, assert_balanced, assert_received, assert_subset, check_cuts,
    each_damage, flight, lost, mcap, mcap_with, notice, read_at,
};
use crate::support::{in_context, real_logs, with_limits};
use ingest::{FieldRequest, Limits, LogError, MapLibrary, ReadContext, ScanError, Selection, TopicInfo, ValueKind};
use mcap::records::{MessageHeader, op};
use serde_json::Value;
use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

fn with_extension(folder: &Path, extension: &str) -> Vec<PathBuf> {
    let mut found = vec![];
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(with_extension(&path, extension));
        } else if path.extension().is_some_and(|e| e == extension) {
            found.push(path);
        }
    }
    found.sort();
    found
}

fn expected(mcap: &Path) -> Vec<Value> {
    let text = std::fs::read(mcap.with_extension("json")).unwrap();
    let parsed: Value = serde_json::from_slice(&text).unwrap();
    parsed["records"].as_array().unwrap().clone()
}

#[test]
fn the_conformance_files_are_whole_for_the_reader_too() {
    let Some(folder) = real_logs("mcap-conformance") else { return };
    let files = with_extension(&folder, "mcap");
    assert_eq!(files.len(), 416);
    for file in files {
        let log = in_context(|c| read_at(file.clone(), false, &|_: &TopicInfo| Selection::All, c)).unwrap();
        assert_balanced(&log);
        assert!(!lost(&log), "{}: {:?}", file.display(), log.notices);
        let messages = expected(&file).iter().filter(|r| r["type"] == "Message").count() as u64;
        assert_eq!(log.health.messages, messages, "{}", file.display());
    }
}

const LAYOUTS: [Layout; 6] = [
    Layout::PLAIN,
    Layout::UNCHUNKED,
    Layout::ZSTD,
    Layout::LZ4,
    Layout { summary: false, data_crc: false, ..Layout::ZSTD },
    Layout { repeat_schemas: false, ..Layout::ZSTD },
];

#[test]
fn written_data_is_read_back_bit_for_bit_from_every_encoding_and_layout() {
    let sent = flight(40);
    for encoding in Encoding::ALL {
        for layout in LAYOUTS {
            let log = OnDisk::new(&mcap(&sent, encoding, layout), false).read().unwrap();
            assert_received(&log, &sent, true);
            assert!(log.notices.iter().all(|n| n.severity == flight::Severity::Info), "{:?}", log.notices);
            assert_eq!(log.health.messages, 120);
            let camera = log.health.topics.iter().find(|t| t.name == CAMERA).unwrap();
            assert_eq!((camera.messages, camera.decoded, camera.reason.as_str()), (80, false, ""));
            assert_eq!(log.health.bytes.damaged, 0);
        }
    }
}

#[test]
fn only_wanted_fields_become_columns() {
    let sent = flight(5);
    let field = |path: &str| FieldRequest { path: path.to_owned(), kind: ValueKind::Number };
    for encoding in Encoding::ALL {
        let log = OnDisk::new(&mcap(&sent, encoding, Layout::ZSTD), false)
            .read_where(|t| match t.name.as_str() {
                FIX => Selection::Fields(vec![field("header.stamp"), field("variance[1]"), field("no.such.field")]),
                _ => Selection::Skip,
            })
            .unwrap();
        let paths: Vec<&str> = log.tables[0].columns.iter().map(|c| c.path.as_str()).collect();
        assert_eq!(paths, ["header.stamp", "variance[1]"], "{encoding:?}");
        assert_eq!(log.tables[0].columns[1].number(2), Some(sent[6].latitude));
    }
}

#[test]
fn health_reports_counts_bytes_and_times_of_every_topic() {
    let sent = flight(30);
    let log = OnDisk::new(&mcap(&sent, Encoding::Ros1, Layout::ZSTD), false).read().unwrap();
    let names: Vec<&str> = log.health.topics.iter().map(|t| t.name.as_str()).collect();
    assert_eq!(names, [CAMERA, FIX]);
    for topic in &log.health.topics {
        let of_topic: Vec<&Sent> = sent.iter().filter(|s| s.topic == topic.name).collect();
        let bytes: usize = of_topic.iter().map(|s| Encoding::Ros1.payload(s).len()).sum();
        assert_eq!((topic.messages, topic.payload_bytes), (of_topic.len() as u64, bytes as u64));
        let [logged, published] = topic.stamps.as_slice() else { panic!("{:?}", topic.stamps) };
        assert_eq!((logged.first_ns, logged.last_ns), (of_topic[0].logged_ns, of_topic.last().unwrap().logged_ns));
        assert_eq!(published.first_ns, of_topic[0].published_ns);
    }
    let rate = log.health.topics[1].stamps[0].rate_hz.unwrap();
    assert!((rate - 1e9 / 99_999_999.0).abs() < 1e-9, "{rate}");
    assert_eq!(log.health.format, "MCAP (test)");
}

#[test]
fn attachments_and_metadata_are_listed_and_a_damaged_attachment_is_a_loss() {
    let attach = |writer: &mut mcap::Writer<_>| {
        let (name, media_type) = ("notes.txt".to_owned(), "text/plain".to_owned());
        let data = Cow::Borrowed(&b"remember the milk"[..]);
        writer.attach(&mcap::Attachment { log_time: 1, create_time: 2, name, media_type, data }).unwrap();
        let metadata = [("pilot".to_owned(), "A".to_owned())].into();
        writer.write_metadata(&mcap::records::Metadata { name: "crew".to_owned(), metadata }).unwrap();
    };
    let content = mcap_with(&flight(3), Encoding::Ros1, Layout { data_crc: false, ..Layout::ZSTD }, attach);
    let disk = OnDisk::new(&content, false);
    let log = disk.read().unwrap();
    assert_eq!(log.health.extras, ["attachment notes.txt (text/plain, 17 bytes)", "metadata crew"]);
    assert!(!lost(&log));
    let milk = content.windows(4).position(|w| w == b"milk").unwrap();
    disk.write_at(milk as u64, b"M");
    let log = disk.read().unwrap();
    assert!(notice(&log, "damaged").text.contains("attachment notes.txt"), "{:?}", log.notices);
    assert_received(&log, &flight(3), true);
}

/// Every other chunk holds images only.
fn with_separate_chunks(sent: &[Sent], layout: Layout) -> Vec<u8> {
    let mut sorted = sent.to_vec();
    sorted.sort_by_key(|s| s.topic == FIX);
    mcap(&sorted, Encoding::Ros1, layout)
}

#[test]
fn damage_in_unwanted_topics_is_found_if_no_chunk_may_be_skipped() {
    let sent = flight(60);
    let mut content = with_separate_chunks(&sent, Layout { data_crc: false, ..Layout::ZSTD });
    // The camera's chunks come first.
    content[1000..1040].fill(0);
    let disk = OnDisk::new(&content, false);
    let read = |may_leave_closed| {
        let want = |topic: &TopicInfo| if topic.name == FIX { Selection::All } else { Selection::Skip };
        let limits = Limits { may_leave_closed, ..Limits::default() };
        with_limits(limits, |context| ingest::read_files(ingest::LogKind::Mcap, &[disk.path()], &want, context))
            .unwrap()
    };
    let (quick, whole) = (read(true), read(false));
    assert!(notice(&quick, "skipped").count > 10 && quick.health.bytes.damaged == 0 && !lost(&quick));
    assert!(whole.health.bytes.damaged > 0 && lost(&whole));
    assert!(whole.notices.iter().all(|n| n.code != "skipped"));
    assert_eq!(quick.tables, whole.tables);
}

#[test]
fn chunks_without_a_wanted_topic_are_skipped_and_still_counted() {
    let sent = flight(60);
    let closed = OnDisk::new(&with_separate_chunks(&sent, Layout { data_crc: false, ..Layout::ZSTD }), false);
    let log = closed.read().unwrap();
    assert_received(&log, &sent, true);
    assert!(notice(&log, "skipped").count > 10);
    assert!(!lost(&log));
    let without_index = Layout { summary: false, ..Layout::ZSTD };
    let opened = OnDisk::new(&with_separate_chunks(&sent, without_index), false).read().unwrap();
    assert!(opened.notices.iter().all(|n| n.code != "skipped"));
    assert_eq!(log.tables, opened.tables);
    for (a, b) in log.health.topics.iter().zip(&opened.health.topics) {
        assert_eq!((&a.name, a.messages, &a.stamps[0]), (&b.name, b.messages, &b.stamps[0]));
    }
}

#[test]
fn a_false_summary_is_not_trusted() {
    let sent = flight(60);
    let content = with_separate_chunks(&sent, Layout { data_crc: false, ..Layout::ZSTD });
    let disk = OnDisk::new(&content, false);
    // The channel in the first entry of each chunk index is replaced by another one.
    let footer = content.len() - 37;
    let start = u64::from_le_bytes(content[footer + 9..footer + 17].try_into().unwrap()) as usize;
    let mut at = start;
    while at < footer {
        let length = u64::from_le_bytes(content[at + 1..at + 9].try_into().unwrap()) as usize;
        if content[at] == op::CHUNK_INDEX {
            let channel = at + 9 + 8 * 4 + 4;
            disk.write_at(channel as u64, &[content[channel] ^ 1]);
        }
        at += 9 + length;
    }
    let log = disk.read().unwrap();
    assert_received(&log, &sent, true);
    assert!(lost(&log));
    notice(&log, "corrupt");
}

#[test]
fn messages_without_a_channel_or_a_schema_are_counted_with_the_reason() {
    let content = mcap_with(&flight(4), Encoding::Ros1, Layout::ZSTD, |writer| {
        let channel = writer.add_channel(0, "/bare", "ros1", &Default::default()).unwrap();
        let header = MessageHeader { channel_id: channel, sequence: 0, log_time: u64::MAX, publish_time: 7 };
        writer.write_to_known_channel(&header, &[1, 2, 3]).unwrap();
        let proto = writer.add_schema("a.B", "protobuf", b"x").unwrap();
        let channel = writer.add_channel(proto, "/proto", "protobuf", &Default::default()).unwrap();
        writer.write_to_known_channel(&MessageHeader { channel_id: channel, ..header }, &[1]).unwrap();
        let flat = writer.add_schema("a.C", "flatbuffer", b"x").unwrap();
        let channel = writer.add_channel(flat, "/flat", "flatbuffer", &Default::default()).unwrap();
        writer.write_to_known_channel(&MessageHeader { channel_id: channel, ..header }, &[1]).unwrap();
    });
    let log = OnDisk::new(&content, false).read_where(|_| Selection::All).unwrap();
    let reason = |name: &str| log.health.topics.iter().find(|t| t.name == name).unwrap().reason.clone();
    assert_eq!(reason("/bare"), "the message definition is missing");
    assert_eq!(reason("/proto"), "its descriptor is truncated or damaged");
    assert!(reason("/flat").starts_with("FlatBuffers are not supported"));
    let bare = log.health.topics.iter().find(|t| t.name == "/bare").unwrap();
    assert_eq!(bare.stamps[0].first_ns, i64::MAX);
    assert_eq!(notice(&log, "unreliable-stamps").count, 3);
    assert!(!lost(&log));
    // An unreadable channel record also costs its messages.
    let unchunked = Layout { summary: false, data_crc: false, ..Layout::UNCHUNKED };
    let content = mcap(&flight(4), Encoding::Ros1, unchunked);
    let topic = content.windows(FIX.len()).position(|w| w == FIX.as_bytes()).unwrap();
    let disk = OnDisk::new(&content, false);
    disk.write_at(topic as u64, &[0xff]);
    let log = disk.read().unwrap();
    assert_eq!((notice(&log, "undecodable").count, log.health.undecodable), (4, 4));
}

#[test]
fn undecodable_messages_leave_no_row_and_are_a_counted_loss() {
    let sent = flight(6);
    let content = mcap_with(&sent, Encoding::Ros1, Layout::ZSTD, |writer| {
        let header = MessageHeader { channel_id: 1, sequence: 0, log_time: 5, publish_time: 7 };
        writer.write_to_known_channel(&header, &[1, 2, 3]).unwrap();
        let longer = [Encoding::Ros1.payload(&sent[0]), vec![0; 9]].concat();
        writer.write_to_known_channel(&MessageHeader { log_time: 6, ..header }, &longer).unwrap();
    });
    let log = OnDisk::new(&content, false).read().unwrap();
    let table = &log.tables[0];
    assert_eq!((table.rows, table.origin_of(5), table.origin_of(6)), (7, 6, 8));
    assert_eq!((log.health.undecodable, log.health.messages), (1, 20));
    let bad = notice(&log, "undecodable");
    assert!(bad.text.contains("message 7: header.seq: the message ends inside it"), "{}", bad.text);
    assert!(lost(&log));
    assert!(notice(&log, "read-leniently").text.contains("message 8 by 9 bytes"));
}

#[test]
fn two_definitions_of_one_topic_each_decode_their_own_messages() {
    let content = mcap_with(&[], Encoding::Ros1, Layout::ZSTD, |writer| {
        for (time, text, payload) in [
            (1, "float32 a", 1.5_f32.to_le_bytes().to_vec()),
            (2, "uint8 b\nfloat64 a", [vec![9], 2.5_f64.to_le_bytes().to_vec()].concat()),
        ] {
            let schema = writer.add_schema("p/T", "ros1msg", text.as_bytes()).unwrap();
            let channel_id = writer.add_channel(schema, "/t", "ros1", &Default::default()).unwrap();
            let header = MessageHeader { channel_id, sequence: 0, log_time: time, publish_time: time };
            writer.write_to_known_channel(&header, &payload).unwrap();
        }
    });
    let log = OnDisk::new(&content, false).read_where(|_| Selection::All).unwrap();
    let table = log.tables.iter().find(|t| t.topic.name == "/t").unwrap();
    let (a, b) = (table.column("a").unwrap(), table.column("b").unwrap());
    assert_eq!((a.number(0), a.number(1)), (Some(1.5), Some(2.5)));
    assert_eq!((b.number(0), b.number(1)), (None, Some(9.0)));
    assert_eq!(notice(&log, "redefined").count, 2);
}

#[test]
fn a_damaged_chunk_costs_only_its_messages_with_and_without_summary() {
    let sent = flight(100);
    for layout in [Layout::ZSTD, Layout::LZ4, Layout::PLAIN, Layout { summary: false, data_crc: false, ..Layout::ZSTD }]
    {
        let content = mcap(&sent, Encoding::Cdr, layout);
        let chunks = chunk_places(&content);
        assert!(chunks.len() > 10);
        let (start, end) = chunks[chunks.len() / 2];
        let fixes_in = |whole: usize| 100 - whole;
        let worst = (end - start) / 100 + 2;
        // In its data; in its type and length; all of its header.
        for (place, bytes) in [(start + 80, vec![0x55; 8]), (start, vec![0xff; 9]), (start, vec![0; 64])] {
            let disk = OnDisk::new(&content, false);
            disk.write_at(place as u64, &bytes);
            let log = disk.read().unwrap();
            let rows = assert_subset(&log, &sent, true);
            assert!(lost(&log));
            assert!(fixes_in(rows) > 0 && fixes_in(rows) <= worst.min(10), "{layout:?} at {place}: {rows} rows");
            // The message index before it is lost too, as nothing shows that it is whole, unless its length is intact.
            let more = if place > start + 9 { 0 } else { 200 };
            let (chunk, start) = ((end - start) as u64, start as u64);
            assert!((chunk..=chunk + more).contains(&log.health.bytes.damaged), "{:?}", log.health.damage);
            assert!((start - more..=start).contains(&log.health.damage[0].offset), "{:?}", log.health.damage);
            let after = log.health.damage[0].after_ns.unwrap();
            let [before, next] = around_the_gap(log.tables[0].logged_ns.as_ref().unwrap());
            assert!((before..next).contains(&after), "{layout:?} at {place}: {before} to {next}, {after}");
        }
    }
}

#[test]
fn wrong_lengths_cost_no_other_chunk_even_before_other_damage() {
    let sent = flight(200);
    let content = mcap(&sent, Encoding::Cdr, Layout { summary: false, data_crc: false, ..Layout::ZSTD });
    let chunks = chunk_places(&content);
    assert!(chunks.len() > 40);
    let rows = |damaged: &[u8]| OnDisk::new(damaged, false).read().unwrap().tables[0].rows;
    let with = |flipped: usize, blackened: usize| {
        let mut damaged = content.clone();
        for &(start, _) in chunks.iter().skip(1).step_by(2).take(flipped) {
            // The highest bit with which the end is still inside the file.
            let length = u64::from_le_bytes(content[start + 1..start + 9].try_into().unwrap());
            let fits =
                |bit: &u32| length >> bit & 1 == 0 && start as u64 + 9 + (length | 1 << bit) < content.len() as u64;
            let longer = length | 1 << (0..40).rev().find(fits).unwrap();
            damaged[start + 1..start + 9].copy_from_slice(&longer.to_le_bytes());
        }
        for &(start, _) in chunks.iter().rev().skip(1).step_by(3).take(blackened) {
            damaged[start..start + 9].fill(0);
        }
        rows(&damaged)
    };
    let lost = |flipped, blackened| 200 - with(flipped, blackened);
    let most = 200 / chunks.len() + 2;
    assert!((1..=12 * most).contains(&lost(12, 0)) && (1..=4 * most).contains(&lost(0, 4)));
    assert_eq!(lost(12, 4), lost(12, 0) + lost(0, 4));
}

#[test]
fn a_length_reaching_a_later_records_end_costs_no_other_record() {
    let sent = flight(60);
    let open = Layout { summary: false, data_crc: false, chunk_bytes: 3000, ..Layout::ZSTD };
    let mut lies = 0;
    for layout in [open, Layout { chunk_bytes: 3000, ..Layout::PLAIN }, Layout { chunked: false, ..open }] {
        let content = mcap(&sent, Encoding::Cdr, layout);
        let records = records_of(&content);
        let data = records.iter().position(|record| record.0 == op::DATA_END).unwrap();
        for (index, &(opcode, start, length)) in records.iter().enumerate().take(data) {
            // Only its length field states how long a message is.
            for later in records[index + 1..data].iter().take(if opcode == op::MESSAGE { 0 } else { 4 }) {
                let mut lying = content.clone();
                lying[start - 8..start].copy_from_slice(&((later.1 + later.2 - start) as u64).to_le_bytes());
                let Ok(log) = OnDisk::new(&lying, false).read() else { continue };
                let rows = assert_subset(&log, &sent, true);
                // A lost chunk or definition costs its messages.
                let kept = if [op::SCHEMA, op::CHANNEL].contains(&opcode) { 0 } else { 50 };
                assert!(lost(&log) && rows >= kept, "{opcode} at {start}: {:?}", log.notices);
                let most = (later.1 + later.2 - start + 9) as u64;
                assert!(log.health.bytes.damaged <= most, "{opcode} at {start}: {:?}", log.notices);
                lies += 1;
            }
            // This many bytes of it are missing.
            for missing in [1, 3, 8].into_iter().filter(|&missing| opcode == op::MESSAGE_INDEX && missing < length) {
                let mut cut = content.clone();
                cut.drain(start + length - missing..start + length);
                let log = OnDisk::new(&cut, false).read().unwrap();
                assert_received(&log, &sent, true);
                assert!(lost(&log));
                lies += 1;
            }
        }
    }
    assert!(lies > 200, "{lies}");
}

#[test]
fn an_attached_log_is_not_read_when_the_next_record_is_damaged() {
    let sent = flight(60);
    let layout = Layout { summary: false, data_crc: false, chunk_bytes: 3000, ..Layout::ZSTD };
    let (log, inner) = (mcap(&sent, Encoding::Cdr, layout), mcap(&flight(9), Encoding::Cdr, layout));
    let (_, attached) = chunk_places(&log)[2];
    let name = [&4_u32.to_le_bytes()[..], b"a.mc", &0_u32.to_le_bytes(), &(inner.len() as u64).to_le_bytes()].concat();
    let attachment = unchunked_record(op::ATTACHMENT, &[&[0; 16][..], &name, &inner, &[0; 4]].concat());
    // After the message indexes of the chunk.
    let insert_at =
        records_of(&log).into_iter().find(|record| record.1 > attached && record.0 == op::CHUNK).unwrap().1 - 9;
    let whole = [&log[..insert_at], &attachment, &log[insert_at..]].concat();
    assert_received(&OnDisk::new(&whole, false).read().unwrap(), &sent, true);
    for opcode in [0, 46] {
        let mut damaged = whole.clone();
        damaged[insert_at + attachment.len()] = opcode;
        let log = OnDisk::new(&damaged, false).read().unwrap();
        let rows = assert_subset(&log, &sent, true);
        assert!(lost(&log) && log.tables[0].rows == rows && rows >= 50, "{opcode}: {rows}, {:?}", log.health.damage);
    }
}

#[test]
fn a_chunk_index_that_hides_a_channel_is_not_followed() {
    let sent = flight(60);
    let content = with_separate_chunks(&sent, Layout { data_crc: false, ..Layout::ZSTD });
    let records = records_of(&content);
    let ends_data = records.iter().position(|record| record.0 == op::DATA_END).unwrap();
    let (summary, footer) = (records[ends_data + 1].1 - 9, records.last().unwrap().1);
    let channel_of = |index: &(u8, usize, usize)| content[index.1 + 36];
    // Those of one channel.
    let is_single = |record: &&(u8, usize, usize)| record.0 == op::CHUNK_INDEX && content[record.1 + 32] == 10;
    let listed: Vec<_> = records.iter().filter(is_single).collect();
    let (camera, fix) = (channel_of(listed[0]), channel_of(listed[listed.len() - 1]));
    assert_ne!(camera, fix);
    let mut lying = content.clone();
    for index in listed.iter().filter(|index| channel_of(index) == fix) {
        lying[index.1 + 36] = camera;
    }
    let sum = crc32fast::hash(&lying[summary..footer + 16]);
    lying[footer + 16..footer + 20].copy_from_slice(&sum.to_le_bytes());
    let log = OnDisk::new(&lying, false).read().unwrap();
    assert_received(&log, &sent, true);
    assert!(notice(&log, "skipped").count > 10);
}

#[test]
fn the_report_on_a_chunk_does_not_depend_on_earlier_chunks() {
    let sent = flight(100);
    let content = mcap(&sent, Encoding::Cdr, Layout { chunk_crc: false, data_crc: false, ..Layout::ZSTD });
    let chunks = chunk_places(&content);
    let mut lying = content.clone();
    // It declares ten bytes, after a chunk that allocated more.
    for &(start, _) in chunks.iter().skip(1).step_by(2) {
        lying[start + 25..start + 33].copy_from_slice(&10_u64.to_le_bytes());
    }
    let log = OnDisk::new(&lying, false).read().unwrap();
    assert!(log.health.damage.len() > 3);
    let reason = "the zstd data hold more than the declared 10 bytes, or are damaged";
    assert!(log.health.damage.iter().all(|damage| damage.reason == reason), "{:?}", log.health.damage);
}

/// The rows before and after the longest pause, ns after the first row.
fn around_the_gap(logged: &[i64]) -> [i64; 2] {
    let pair = logged.windows(2).max_by_key(|pair| pair[1] - pair[0]).unwrap();
    [pair[0] - logged[0], pair[1] - logged[0]]
}

/// First and last byte of every chunk record.
fn chunk_places(content: &[u8]) -> Vec<(usize, usize)> {
    let mut found = vec![];
    let mut at = 8;
    while at + 17 < content.len() {
        let length = u64::from_le_bytes(content[at + 1..at + 9].try_into().unwrap()) as usize;
        if content[at] == op::CHUNK {
            found.push((at, at + 9 + length));
        }
        at += 9 + length;
    }
    found
}

#[test]
fn messages_inside_a_corrupt_uncompressed_chunk_are_not_trusted() {
    let sent = flight(30);
    let content = mcap(&sent, Encoding::Ros1, Layout { summary: false, data_crc: false, ..Layout::PLAIN });
    let (start, _) = chunk_places(&content)[3];
    let disk = OnDisk::new(&content, false);
    disk.write_at(start as u64 + 5, &[9]);
    let latitude = content[start..].windows(8).position(|w| {
        let value = f64::from_le_bytes(w.try_into().unwrap());
        (46.9..47.1).contains(&value)
    });
    disk.write_at((start + latitude.unwrap()) as u64, &[0, 1, 2]);
    let log = disk.read().unwrap();
    assert!(assert_subset(&log, &sent, true) >= 20);
    assert!(lost(&log));
}

#[test]
fn an_unchunked_file_resyncs_at_the_next_message() {
    let sent = flight(100);
    let content = mcap(&sent, Encoding::Ros1, Layout { data_crc: false, ..Layout::UNCHUNKED });
    let disk = OnDisk::new(&content, false);
    disk.write_at(content.len() as u64 / 2, &[0xee; 64]);
    let log = disk.read().unwrap();
    assert!(lost(&log));
    let fixes = log.tables[0].rows;
    assert!((97..=100).contains(&fixes), "{fixes}");
    assert!(log.health.messages >= 297, "{}", log.health.messages);
}

#[test]
fn faults_at_the_ends_of_a_file_are_reported() {
    let sent = flight(20);
    let content = mcap(&sent, Encoding::Ros1, Layout::ZSTD);
    let read = |bytes: &[u8]| OnDisk::new(bytes, false).read();
    let junk = read(&[&content[..], b"some bytes more"].concat()).unwrap();
    assert_received(&junk, &sent, true);
    assert_eq!((junk.health.bytes.damaged, junk.health.damage[0].offset), (15, content.len() as u64));
    let no_magic = read(&content[..content.len() - 8]).unwrap();
    assert_received(&no_magic, &sent, true);
    assert!(notice(&no_magic, "incomplete-recording").text.contains("directly after its footer"));
    let bad_start = read(&[b"\x89MCXP0\r\n", &content[8..]].concat()).unwrap();
    assert_received(&bad_start, &sent, true);
    assert_eq!(bad_start.health.bytes.damaged, 8);
    let no_summary = content.len() - 200;
    assert!(lost(&read(&content[..no_summary]).unwrap()));
    for (bytes, what) in [
        (&b""[..], "empty"),
        (&[0; 5000], "zero bytes"),
        (&content[..8], "no footer"),
        (b"<!DOCTYPE html><html><head><title>404</title></head></html>", "first eight bytes of the file are wrong"),
        (b"\x89", "first eight bytes of the file are wrong"),
    ] {
        let error = read(bytes).unwrap_err().to_string();
        assert!(error.contains(what), "{error}");
    }
}

#[test]
fn any_cut_gives_a_prefix_of_the_flight_and_is_reported() {
    let sent = flight(12);
    for (layout, stride) in [(Layout::ZSTD, 2), (Layout::PLAIN, 5), (Layout::UNCHUNKED, 5)] {
        let content = mcap(&sent, Encoding::Cdr, layout);
        check_cuts(&content, false, (0..content.len()).rev().step_by(stride), &sent, &format!("{layout:?}"));
    }
}

#[test]
fn no_flipped_bit_changes_a_value_silently() {
    let sent = flight(6);
    for (layout, stride) in [
        (Layout::ZSTD, 3),
        (Layout::LZ4, 5),
        (Layout::PLAIN, 5),
        (Layout::UNCHUNKED, 3),
        // Without these checksums some flips look like data, but none may go wrong silently here:
        // the chunks still have theirs.
        (Layout { data_crc: false, ..Layout::ZSTD }, 3),
        (Layout { data_crc: false, summary: false, ..Layout::PLAIN }, 5),
    ] {
        let content = mcap(&sent, Encoding::Ros1, layout);
        let disk = OnDisk::new(&content, false);
        let mut silent = 0;
        for bit in (0..content.len() * 8).step_by(stride) {
            let (at, mask) = (bit / 8, 1 << (bit % 8));
            disk.write_at(at as u64, &[content[at] ^ mask]);
            if let Ok(log) = disk.read()
                && !lost(&log)
            {
                silent += 1;
                assert_received(&log, &sent, true);
            }
            disk.write_at(at as u64, &content[at..=at]);
        }
        assert!(silent < content.len() * 8 / stride, "nothing was ever noticed");
    }
}

#[test]
fn hostile_lengths_neither_abort_nor_hang() {
    let sent = flight(4);
    for layout in [Layout::ZSTD, Layout::UNCHUNKED, Layout { summary: false, data_crc: false, ..Layout::PLAIN }] {
        let content = mcap(&sent, Encoding::Ros1, layout);
        let disk = OnDisk::new(&content, false);
        let lengths = [0, 1, 1 << 31, (1 << 32) - 1, 1 << 62, 1 << 63, u64::MAX, u64::MAX - 8];
        for at in 0..content.len() - 8 {
            let length = lengths[at % lengths.len()];
            disk.write_at(at as u64, &u64::to_le_bytes(length));
            if let Ok(log) = disk.read()
                && !lost(&log)
            {
                assert_received(&log, &sent, true);
            }
            disk.write_at(at as u64, &content[at..at + 8]);
        }
    }
}

#[test]
fn a_chunk_beyond_the_limit_is_rejected_and_the_limit_named() {
    let sent = flight(40);
    let content = mcap(&sent, Encoding::Ros1, Layout { chunk_bytes: 1 << 20, ..Layout::ZSTD });
    let disk = OnDisk::new(&content, false);
    let limits = Limits { chunk_bytes: 1000, ..Limits::default() };
    let error = with_limits(limits, |c| read_at(disk.path(), false, &|_: &TopicInfo| Selection::All, c)).unwrap_err();
    assert!(matches!(error, LogError::Unusable { .. }));
    assert!(error.to_string().contains("larger than the limit of 1000"), "{error}");
}

#[test]
fn topics_beyond_the_limit_are_rejected_and_their_messages_counted() {
    let disk = OnDisk::new(&mcap(&flight(5), Encoding::Ros1, Layout::UNCHUNKED), false);
    let limits = Limits { topics: 1, ..Limits::default() };
    let log = with_limits(limits, |c| read_at(disk.path(), false, &|_: &TopicInfo| Selection::All, c)).unwrap();
    let refused = notice(&log, "undecodable");
    assert!(refused.text.contains("more than 1 topics"), "{}", refused.text);
    assert_eq!(log.health.messages + refused.count, 15);
    assert!(lost(&log));
}

#[test]
fn text_named_mcap_is_distinguished_from_a_damaged_log() {
    for (text, what) in [
        (&b"time,lat\n1.5,47.25\n2.5,47.5\n"[..], "it looks like a table"),
        ("Z\u{fc}rich, 5 May\nWe flew well.\n".as_bytes(), "its first line \"Z\u{fc}rich, 5 May\""),
    ] {
        let error = OnDisk::new(text, false).read().unwrap_err();
        assert!(matches!(error, LogError::NotALog { .. }));
        assert!(error.to_string().contains("are wrong: it is text") && error.to_string().contains(what), "{error}");
    }
    let error = OnDisk::new(&[b"time,lat\n1.5,47.25\n2.5,47.5\n", &[0x89, 1, 0][..]].concat(), false).read();
    assert!(matches!(error.unwrap_err(), LogError::Unusable { .. }));
}

fn unchunked_record(opcode: u8, body: &[u8]) -> Vec<u8> {
    [&[opcode][..], &(body.len() as u64).to_le_bytes(), body].concat()
}

/// A channel of JSON messages without a schema, with one pair of metadata.
fn unchunked_channel(id: u16, topic: &str, metadata: &str) -> Vec<u8> {
    let text = |t: &str| [&(t.len() as u32).to_le_bytes()[..], t.as_bytes()].concat();
    let pair = [text("key"), text(metadata)].concat();
    let head = [id.to_le_bytes(), [0, 0]].concat();
    unchunked_record(4, &[head, text(topic), text("json"), (pair.len() as u32).to_le_bytes().to_vec(), pair].concat())
}

#[test]
fn endless_channel_records_take_bounded_memory() {
    // Names of 4 kB each: together more than the 64 MB that are held.
    let channels = (0..17_000).flat_map(|id| unchunked_channel(id, &format!("/{id:04095}"), "any"));
    let content: Vec<u8> = b"\x89MCAP0\r\n".iter().copied().chain(channels).collect();
    let error = OnDisk::new(&content, false).read().unwrap_err();
    assert!(error.to_string().contains("definitions of this file are longer than"), "{error}");
}

#[test]
fn a_message_of_a_channel_with_a_failed_redefinition_is_not_read() {
    let content = |redefinitions: usize| {
        let channels = (0..=redefinitions).flat_map(|i| unchunked_channel(7, &format!("/{i}"), ""));
        let message = unchunked_record(5, &[&[7, 0][..], &[0; 20], b"{\"x\":1}"].concat());
        b"\x89MCAP0\r\n".iter().copied().chain(channels).chain(message).collect::<Vec<u8>>()
    };
    let read = |content: &[u8]| {
        let disk = OnDisk::new(content, false);
        with_limits(Limits::default(), |c| read_at(disk.path(), false, &|_: &TopicInfo| Selection::All, c))
    };
    let log = read(&content(1000)).unwrap();
    assert_eq!(log.tables.iter().map(|t| t.topic.name.as_str()).collect::<Vec<_>>(), ["/1000"]);
    let error = read(&content(1001)).unwrap_err();
    assert!(error.to_string().contains("definitions of this file replace others"), "{error}");
}

#[test]
fn damage_of_any_kind_is_reported_without_a_panic() {
    let sent = flight(8);
    for layout in [Layout::ZSTD, Layout::PLAIN, Layout::UNCHUNKED] {
        let content = mcap(&sent, Encoding::Cdr, layout);
        each_damage(&content, 250, |damaged| {
            if let Ok(log) = OnDisk::new(damaged, false).read()
                && !lost(&log)
            {
                assert_received(&log, &sent, true);
            }
        });
    }
}

#[test]
fn progress_adds_up_to_the_file_and_a_stop_request_is_honoured() {
    let sent: Vec<Sent> = flight(10_000);
    let content = mcap(&sent, Encoding::Ros1, Layout { chunk_bytes: 100_000, ..Layout::PLAIN });
    let disk = OnDisk::new(&content, false);
    let (reported, cancel) = (AtomicU64::new(0), AtomicBool::new(false));
    let on_bytes = |more| {
        reported.fetch_add(more, Ordering::Relaxed);
    };
    let context = ReadContext { limits: Limits::default(), cancel: &cancel, on_bytes: &on_bytes };
    read_at(disk.path(), false, &|_: &TopicInfo| Selection::Skip, &context).unwrap();
    assert_eq!(reported.swap(0, Ordering::Relaxed), content.len() as u64);
    let stop = |more| {
        reported.fetch_add(more, Ordering::Relaxed);
        cancel.store(true, Ordering::Relaxed);
    };
    let context = ReadContext { on_bytes: &stop, ..context };
    let result = read_at(disk.path(), false, &|_: &TopicInfo| Selection::Skip, &context);
    assert!(matches!(result, Err(LogError::Read(ScanError::Cancelled))));
    assert!(reported.load(Ordering::Relaxed) < 2 << 20);
}

#[test]
fn a_sparse_file_of_a_terabyte_is_handled_quickly() {
    let sent = flight(5);
    let content = mcap(&sent, Encoding::Ros1, Layout::ZSTD);
    let disk = OnDisk::new(&content, false);
    disk.set_len(1 << 40);
    let log = disk.read().unwrap();
    assert_received(&log, &sent, true);
    assert_eq!(log.health.bytes.damaged, (1 << 40) - content.len() as u64);
    // Cut in the middle and then zero: the search for a record must end.
    let disk = OnDisk::new(&content[..content.len() / 2], false);
    disk.set_len(1 << 40);
    let log = disk.read().unwrap();
    assert!(assert_subset(&log, &sent, true) > 0);
    assert!(lost(&log));
}

#[test]
fn the_other_real_files_have_the_counts_of_the_python_library() {
    // mcap 1.6.0 (PyPI): messages, payload bytes, topics.
    for (file, messages, bytes, topics) in [
        ("keelson/test.mcap", 2172, 276_770, 649),
        ("mcap-crate/compressed.mcap", 826, 106_628, 2),
        ("mcap-crate/uncompressed.mcap", 826, 106_628, 2),
        ("keelson/test_old_303B.mcap", 0, 0, 0),
    ] {
        let Some(path) = real_logs(file) else { continue };
        // Without JSON fields the topics of keelson are wanted and refused, so its chunks stay closed.
        let log = in_context(|c| read_at(path, false, &|_: &TopicInfo| Selection::All, c)).unwrap();
        assert_balanced(&log);
        assert!(!lost(&log), "{file}: {:?}", log.notices);
        let payload: u64 = log.health.topics.iter().map(|t| t.payload_bytes).sum();
        assert_eq!((log.health.messages, log.health.topics.len()), (messages, topics), "{file}");
        assert!(payload == bytes || file.starts_with("keelson"), "{file}: {payload}");
    }
    let Some(path) = real_logs("mcap-crate/chunk_not_closed.mcap") else { return };
    let error = in_context(|c| read_at(path, false, &|_: &TopicInfo| Selection::All, c)).unwrap_err();
    assert!(error.to_string().contains("a truncated chunk"), "{error}");
}

/// An unchunked file of one channel `/gps/fix` with these messages.
fn of_channel(
    (type_name, schema_encoding, text): (&str, &str, &[u8]),
    encoding: &str,
    sent: &[(Sent, Vec<u8>)],
) -> Vec<u8> {
    let mut writer = mcap::Writer::new(std::io::Cursor::new(vec![])).unwrap();
    let schema = writer.add_schema(type_name, schema_encoding, text).unwrap();
    let channel_id = writer.add_channel(schema, FIX, encoding, &std::collections::BTreeMap::new()).unwrap();
    for (sent, payload) in sent {
        let (log_time, publish_time) = (sent.logged_ns as u64, sent.published_ns as u64);
        writer
            .write_to_known_channel(&MessageHeader { channel_id, sequence: 0, log_time, publish_time }, payload)
            .unwrap();
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

/// As `ros2 bag record -s mcap --compression-mode message --compression-format zstd` writes it.
#[test]
fn messages_that_rosbag2_compressed_one_by_one_are_read() {
    let fixes: Vec<Sent> = flight(20).into_iter().filter(|s| s.topic == FIX).collect();
    let packed = |s: &Sent| zstd::bulk::compress(&Encoding::Cdr.payload(s), 3).unwrap();
    let definition = "std_msgs/Header header\nint32 status\nfloat64 latitude\nfloat64[3] variance\nuint8[] raw\n===\n\
        MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n";
    let schema = ("test_msgs/msg/Fix", "ros2msg", definition.as_bytes());
    let mut sent: Vec<(Sent, Vec<u8>)> = fixes.iter().map(|s| (s.clone(), packed(s))).collect();
    let log = OnDisk::new(&of_channel(schema, "cdr", &sent), false).read().unwrap();
    assert_received(&log, &fixes, true);
    assert!(log.notices.is_empty(), "{:?}", log.notices);

    sent[7].1.truncate(30);
    let log = OnDisk::new(&of_channel(schema, "cdr", &sent), false).read().unwrap();
    assert_eq!((log.tables[0].rows, log.health.messages, log.health.undecodable), (19, 20, 1));
    assert!(notice(&log, "undecodable").text.contains("zstd"), "{:?}", log.notices);
}

#[test]
fn a_message_that_begins_like_a_compressed_one_is_read_uncompressed() {
    let number = 0xfd2f_b528_u32;
    let sent = [(flight(1)[0].clone(), number.to_le_bytes().to_vec())];
    let log = OnDisk::new(&of_channel(("p/A", "ros1msg", b"uint32 x"), "ros1", &sent), false).read().unwrap();
    assert_eq!(log.tables[0].column("x").unwrap().number(0), Some(f64::from(number)));
}

#[test]
fn a_type_the_recorder_did_not_find_uses_the_common_definition() {
    let one = flight(1)[0].clone();
    let vector = [&[0, 1, 0, 0][..], &[1.5_f64, -2.0, 3.25].map(f64::to_le_bytes).concat()].concat();
    for (encoding, text) in [("", ""), ("unknown", ""), ("unknown", "no such package"), ("ros2msg", "")] {
        let read = |type_name: &str, payload: &[u8]| {
            let content = of_channel((type_name, encoding, text.as_bytes()), "cdr", &[(one.clone(), payload.to_vec())]);
            OnDisk::new(&content, false).read().unwrap()
        };
        let log = read("geometry_msgs/msg/Vector3", &vector);
        assert_eq!(log.tables[0].column("y").unwrap().number(0), Some(-2.0), "{encoding}");
        assert_eq!(notice(&log, "definition-supplied").count, 1);
        // One that does not fit to the byte is not of that type.
        let log = read("geometry_msgs/msg/Vector3", &vector[..20]);
        assert!(log.tables.is_empty() && lost(&log), "{:?}", log.notices);
        if encoding != "ros2msg" {
            let log = read("my_msgs/msg/Own", &vector);
            assert!(
                log.health.topics[0].reason.contains("the message definition is missing"),
                "{:?}",
                log.health.topics
            );
        }
    }
}

/// Keeps the languages of the definitions that come with the messages.
#[derive(Default)]
struct Languages(std::sync::Mutex<Vec<(String, usize)>>);

impl ingest::MessageSink for Languages {
    fn message(&self, message: &ingest::RawMessage<'_>) {
        self.0.lock().unwrap().push((message.schema_encoding.to_owned(), message.schema.len()));
    }
}

impl ingest::Select for Languages {
    fn select(&self, _: &TopicInfo) -> Selection {
        Selection::Raw
    }

    fn sink(&self) -> Option<&dyn ingest::MessageSink> {
        Some(self)
    }
}

#[test]
fn a_definition_in_a_map_folder_is_read_with_its_dependencies() {
    let folder = tempfile::tempdir().unwrap();
    let write = |path: &str, text: &str| {
        let path = folder.path().join(path);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    };
    // As in a workspace: packages below others' folders, types by their own name, and common ones.
    write(
        "stack/my_msgs/msg/Own.msg",
        "uint8 KIND=3\nPart[2] parts # both\ngeometry_msgs/Vector3 at\nother_msgs/Side side\n",
    );
    write("stack/my_msgs/msg/Part.msg", "float32 x\n");
    write("other_msgs/msg/Side.msg", "uint8 left\n");
    write("other_msgs/msg/README.md", "no definition");
    write("other_msgs/Stray.msg", "in no package");
    let library = MapLibrary::default().with_folder(folder.path()).unwrap();
    let names: Vec<&str> = library.definitions().map(|(name, _)| name).collect();
    assert_eq!(names, ["my_msgs/Own", "my_msgs/Part", "other_msgs/Side"]);
    let one = flight(1)[0].clone();
    let own = [
        &[0, 1, 0, 0][..],
        &[0.5_f32, -1.5].map(f32::to_le_bytes).concat(),
        &[1.0_f64, 2.0, 3.0].map(f64::to_le_bytes).concat(),
        &[7],
    ]
    .concat();
    let read = |type_name: &str, payload: &[u8]| {
        let content = of_channel((type_name, "", b""), "cdr", &[(one.clone(), payload.to_vec())]);
        in_context(|c| {
            ingest::read_files(ingest::LogKind::Mcap, &[OnDisk::new(&content, false).path()], &library.select_all(), c)
        })
        .unwrap()
    };
    let log = read("my_msgs/msg/Own", &own);
    let value = |path: &str| log.tables[0].column(path).unwrap().number(0);
    assert_eq!([value("parts[1].x"), value("at.z"), value("side.left")], [Some(-1.5), Some(3.0), Some(7.0)]);
    assert_eq!(notice(&log, "definition-supplied").count, 1);
    // Another version of the type is refused and not read wrongly.
    for other in [&own[..own.len() - 1], &[&own[..], &[0; 8]].concat()] {
        let log = read("my_msgs/msg/Own", other);
        assert!(log.tables.is_empty() && lost(&log), "{:?}", log.notices);
    }
    let log = read("my_msgs/msg/Unknown", &own);
    assert!(log.health.topics[0].reason.contains("PACKAGE/msg/TYPE.msg"), "{:?}", log.health.topics);
}

#[test]
fn other_text_encodings_are_read_and_endless_definitions_rejected() {
    let library = |bytes: &[u8]| {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir_all(folder.path().join("p/msg")).unwrap();
        std::fs::write(folder.path().join("p/msg/A.msg"), bytes).unwrap();
        MapLibrary::default().with_folder(folder.path())
    };
    let latin = library(b"float32 x # \xb0C\n").unwrap();
    assert!(latin.definitions().any(|(name, text)| name == "p/A" && text.starts_with("float32 x")));
    let error = library(&vec![b' '; (1 << 20) + 1]).unwrap_err().to_string();
    assert!(error.contains("A.msg"), "{error}");
}

#[test]
fn copied_messages_get_a_common_definition_in_a_portable_language() {
    let one = flight(1)[0].clone();
    let content = of_channel(("geometry_msgs/msg/Vector3", "", b""), "cdr", &[(one, vec![0, 1, 0, 0])]);
    let (disk, languages) = (OnDisk::new(&content, false), Languages::default());
    in_context(|c| read_at(disk.path(), false, &languages, c)).unwrap();
    let got = languages.0.into_inner().unwrap();
    assert!(matches!(got.as_slice(), [(language, length)] if language == "ros2msg" && *length > 20), "{got:?}");
}

#[test]
fn the_last_message_before_the_end_a_cut_or_a_private_record_is_kept() {
    let message = |body: &[u8]| unchunked_record(5, &[&[7, 0][..], &[0; 20], body].concat());
    let start = [&b"\x89MCAP0\r\n"[..], &unchunked_record(1, &[0; 8]), &unchunked_channel(7, "/t", "")].concat();
    let ten = message(b"{\"x\":1}").repeat(10);
    let cut_attachment = [&[9][..], &(10_u64 << 30).to_le_bytes(), &[3; 60]].concat();
    let private = unchunked_record(0x90, b"hello");
    let cut_private = [&[0x90][..], &(10_u64 << 30).to_le_bytes(), b"hello"].concat();
    let tails = [
        ("nothing", vec![], 0),
        ("a cut attachment", cut_attachment, 0),
        ("a cut message", ten[..20].to_vec(), 0),
        ("a cut head", ten[..4].to_vec(), 0),
        ("a cut private record", cut_private, 0),
        ("a private record", [private, ten.clone()].concat(), 10),
    ];
    for (what, tail, more) in &tails {
        let bytes = [&start, &ten, &message(b"{\"x\":2}"), tail].map(Vec::as_slice).concat();
        let disk = OnDisk::new(&bytes, false);
        let all = |_: &TopicInfo| Selection::All;
        let log = with_limits(Limits::default(), |c| read_at(disk.path(), false, &all, c)).unwrap();
        let case = format!("before {what}: {:?}", log.notices);
        assert_eq!(log.health.topics[0].messages, 11 + more, "{case}");
        let damaged = if *more > 0 { 0 } else { tail.len() as u64 };
        assert_eq!(log.health.bytes.damaged, damaged, "{case}");
    }
}

#[test]
fn a_wrong_length_into_a_black_image_costs_only_its_own_message() {
    let message = |channel: u8, body: &[u8]| unchunked_record(5, &[&[channel, 0][..], &[0; 20], body].concat());
    let mut bytes = [&b"\x89MCAP0\r\n"[..], &unchunked_record(1, &[0; 8])].concat();
    bytes.extend([unchunked_channel(7, "/t", ""), unchunked_channel(8, "/depth", "")].concat());
    let mut hurt_at = 0;
    for n in 0..60 {
        if n % 10 == 0 {
            bytes.extend(message(8, &[0; 20_000]));
        }
        hurt_at = if n == 35 { bytes.len() } else { hurt_at };
        bytes.extend(message(7, format!("{{\"x\":{n}}}").as_bytes()));
    }
    let end = [unchunked_record(15, &[0; 4]), unchunked_record(2, &[0; 20]), b"\x89MCAP0\r\n".to_vec()].concat();
    for (end, bit) in [vec![], end].iter().flat_map(|end| (0..40).map(move |bit| (end, bit))) {
        let mut hurt = [bytes.as_slice(), end].concat();
        hurt[hurt_at + 1 + bit / 8] ^= 1 << (bit % 8);
        let disk = OnDisk::new(&hurt, false);
        let wanted = |topic: &TopicInfo| if topic.name == "/t" { Selection::All } else { Selection::Skip };
        let log = with_limits(Limits::default(), |c| read_at(disk.path(), false, &wanted, c)).unwrap();
        let found = log.tables[0].column("x").unwrap();
        let found: Vec<f64> = (0..log.tables[0].rows).filter_map(|row| found.number(row)).collect();
        let expected: Vec<f64> = (0..60).filter(|n| *n != 35).map(f64::from).collect();
        assert_eq!(found, expected, "bit {bit}: {:?}", log.notices);
        assert!(lost(&log), "bit {bit}");
    }
}

/// Where the contents of the records at the top level begin, by type.
fn records_of(content: &[u8]) -> Vec<(u8, usize, usize)> {
    let (mut at, mut all) = (8, vec![]);
    while at + 9 <= content.len() - 8 {
        let length = u64::from_le_bytes(content[at + 1..at + 9].try_into().unwrap()) as usize;
        all.push((content[at], at + 9, length));
        at += 9 + length;
    }
    all
}
