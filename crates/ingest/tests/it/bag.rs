//! ROS 1 bags: agreement with what was written and with other readers, and handling of damage.

use crate::made::{
    BagCodec, CAMERA, Encoding, FIX, OnDisk, Sent, assert_balanced, assert_received, assert_subset, bag, check_cuts,
    each_damage, flight, lost, notice, read_at,
};
use crate::support::{in_context, real_logs};
use ingest::{Log, Selection, TopicInfo};
use std::path::Path;

fn read_all(path: &Path) -> Log {
    let is_bag = path.extension().is_some_and(|e| e == "bag");
    let log = in_context(|c| read_at(path.to_owned(), is_bag, &|_: &TopicInfo| Selection::All, c)).unwrap();
    assert_balanced(&log);
    log
}

#[test]
fn written_data_is_read_back_bit_for_bit_with_any_compression() {
    let sent = flight(40);
    for codec in BagCodec::ALL {
        for in_chunks in [true, false] {
            let log = OnDisk::new(&bag(&sent, codec, 17, in_chunks, true), true).read().unwrap();
            assert_received(&log, &sent, false);
            assert!(log.notices.is_empty(), "{codec:?}: {:?}", log.notices);
            let [camera, fix] = log.health.topics.as_slice() else { panic!("{:?}", log.health.topics) };
            assert_eq!((camera.name.as_str(), camera.messages, camera.decoded), (CAMERA, 80, false));
            let bytes: usize = sent.iter().filter(|s| s.topic == CAMERA).map(|s| Encoding::Ros1.payload(s).len()).sum();
            assert_eq!(camera.payload_bytes, bytes as u64);
            assert_eq!((fix.messages, fix.stamps.len(), fix.stamps[0].first_ns), (40, 1, sent[0].logged_ns));
            assert_eq!(log.tables[0].published_ns, None);
        }
    }
}

#[test]
fn a_bag_that_was_never_closed_is_read_whole_and_reported() {
    let sent = flight(20);
    for codec in BagCodec::ALL {
        let log = OnDisk::new(&bag(&sent, codec, 9, true, false), true).read().unwrap();
        assert_received(&log, &sent, false);
        assert!(notice(&log, "incomplete-recording").text.contains("no index"));
    }
}

#[test]
fn any_cut_gives_a_prefix_of_the_flight_and_is_reported() {
    let sent = flight(12);
    for (codec, stride) in
        [(BagCodec::None, 1), (BagCodec::Lz4Linked, 3), (BagCodec::Lz4Independent, 3), (BagCodec::Bz2, 7)]
    {
        let content = bag(&sent, codec, 9, true, true);
        check_cuts(&content, true, (4200..content.len()).rev().step_by(stride), &sent, &format!("{codec:?}"));
    }
}

#[test]
fn a_cut_inside_an_uncompressed_chunk_costs_one_message() {
    let sent = flight(30);
    let content = bag(&sent, BagCodec::None, 1000, true, true);
    let disk = OnDisk::new(&content, true);
    let end = content.windows(8).rposition(|w| w == 50.0_f64.to_le_bytes()).unwrap_or(content.len() / 2);
    disk.set_len(end as u64);
    let log = disk.read().unwrap();
    let kept = log.health.messages as usize;
    let per_message = (content.len() - 4117) / 90;
    assert!(kept + 2 >= (end - 4117 - 1200) / per_message, "{kept}");
    assert!(log.health.bytes.damaged < 500, "{:?}", log.health.bytes);
}

#[test]
fn damage_in_one_chunk_leaves_the_others() {
    let sent = flight(100);
    for codec in BagCodec::ALL {
        let content = bag(&sent, codec, 30, true, true);
        let chunk = content.windows(12).enumerate().filter(|(_, w)| w.starts_with(b"compression=")).nth(5).unwrap().0;
        // In the data; in the chunk's own header; in the length of its header.
        for (place, bytes) in [(chunk + 60, [0x55; 16]), (chunk - 2, [0xee; 16]), (chunk - 8, [0xff; 16])] {
            let disk = OnDisk::new(&content, true);
            disk.write_at(place as u64, &bytes);
            let log = disk.read().unwrap();
            assert!(lost(&log), "{codec:?} {place}");
            assert!(log.health.messages >= 270, "{codec:?} {place}: {}", log.health.messages);
            assert!(assert_subset(&log, &sent, false) >= 90);
        }
    }
}

#[test]
fn a_wrong_length_costs_one_message_but_not_its_neighbours() {
    let sent = flight(20);
    let content = bag(&sent, BagCodec::None, 1000, true, true);
    let message = content.windows(5).enumerate().filter(|(_, w)| *w == b"time=").nth(21).unwrap().0;
    let length = message + 5 + 8;
    for bytes in [[0xff, 0xff, 0xff, 0x7f], [0, 1, 0, 0], [0, 4, 0, 0], [1, 0, 0, 0]] {
        let disk = OnDisk::new(&content, true);
        disk.write_at(length as u64, &bytes);
        let log = disk.read().unwrap();
        assert!(lost(&log));
        assert_eq!(log.health.messages, 59, "{bytes:?}");
        assert_eq!(assert_subset(&log, &sent, false), 19);
    }
}

#[test]
fn no_flipped_bit_panics_or_loses_the_count_of_the_bytes() {
    let sent = flight(5);
    for (codec, stride) in [(BagCodec::None, 7), (BagCodec::Lz4Linked, 11), (BagCodec::Bz2, 31)] {
        let content = bag(&sent, codec, 6, true, true);
        let disk = OnDisk::new(&content, true);
        // The padding of the bag header is the same byte four thousand times.
        let bits = (0..content.len() * 8).filter(|bit| !(120 * 8..4100 * 8).contains(bit));
        for bit in bits.step_by(stride) {
            let (at, mask) = (bit / 8, 1 << (bit % 8));
            disk.write_at(at as u64, &[content[at] ^ mask]);
            if let Ok(log) = disk.read()
                && !lost(&log)
            {
                // Values are unprotected and may differ; missing ones must be reported.
                assert_eq!(log.health.messages, 15, "{codec:?} bit {bit}");
            }
            disk.write_at(at as u64, &content[at..=at]);
        }
    }
}

#[test]
fn hostile_lengths_neither_abort_nor_hang() {
    let sent = flight(3);
    for codec in [BagCodec::None, BagCodec::Lz4Linked] {
        let content = bag(&sent, codec, 4, false, true);
        let disk = OnDisk::new(&content, true);
        let lengths = [0, 1, 1 << 16, i32::MAX as u32, 1 << 31, u32::MAX, u32::MAX - 8];
        for at in (0..content.len() - 4).filter(|at| !(120..4090).contains(at)) {
            disk.write_at(at as u64, &lengths[at % lengths.len()].to_le_bytes());
            drop(disk.read());
            disk.write_at(at as u64, &content[at..at + 4]);
        }
    }
}

#[test]
fn damage_of_any_kind_is_reported_without_a_panic() {
    let sent = flight(8);
    for codec in BagCodec::ALL {
        let content = bag(&sent, codec, 7, true, true);
        each_damage(&content, 250, |damaged| {
            if let Ok(log) = OnDisk::new(damaged, true).read()
                && !lost(&log)
            {
                // Without checksums changed values are undetectable, but missing messages are not.
                assert!(
                    log.health.messages >= 24,
                    "{codec:?}: {} {:?} {:?}",
                    log.health.messages,
                    log.notices,
                    log.health.bytes
                );
            }
        });
    }
}

#[test]
fn a_file_that_is_not_a_bag_is_rejected_by_name() {
    let content = bag(&flight(3), BagCodec::None, 4, true, true);
    for (bytes, what) in [
        (&b"#ROSBAG V1.2\nsomething"[..], "version 1"),
        (b"", "empty"),
        (&[0; 10_000], "zero bytes"),
        (&content[..4109], "truncated before the end of its index"),
        (b"<html><body>Not found</body></html>", "first line of the file is wrong"),
        (b"<html><body>Not found</body></html>", "it is text, its first line \"<html><body>Not"),
        (b"time,lat\n1.5,47.25\n2.5,47.5\n", "it looks like a table"),
    ] {
        let error = OnDisk::new(bytes, true).read().unwrap_err().to_string();
        assert!(error.contains(what), "{error}");
    }
}

#[test]
fn a_broken_first_line_does_not_hide_the_rest() {
    let sent = flight(10);
    let mut content = bag(&sent, BagCodec::Lz4Linked, 9, true, true);
    content[3] = b'?';
    let log = OnDisk::new(&content, true).read().unwrap();
    assert_received(&log, &sent, false);
    assert_eq!(log.health.bytes.damaged, 13);
}

#[test]
fn messages_whose_connection_is_lost_are_counted() {
    let sent = flight(10);
    let log_of = |content: &[u8]| OnDisk::new(content, true).read();
    // Connections only at the end, and the end is truncated.
    let content = bag(&sent, BagCodec::Bz2, 9, false, false);
    let error = log_of(&content).unwrap_err().to_string();
    assert!(error.contains("nothing in the file is intact"), "{error}");
}

/// Messages, payload bytes and topics as the PyPI package rosbags 0.11.9 counts them.
const COUNTED: [(&str, u64, u64, usize); 12] = [
    ("embag/test/array_test.bag", 20, 11_690, 1),
    ("embag/test/array_test_old_lz4.bag", 20, 5100, 1),
    ("embag/test/test.bag", 15, 5_794_674, 3),
    ("embag/test/test_2.bag", 2, 14, 1),
    ("embag/test/test_old_lz4.bag", 3454, 2_574_957, 2),
    ("robot_localization/test/test1.bag", 16_806, 6_733_256, 3),
    ("robot_localization/test/test2.bag", 6121, 3_164_361, 2),
    ("PlotJuggler/datasamples/example.bag", 8647, 338_842, 9),
    ("PlotJuggler/datasamples/fake_joint_state.bag", 2725, 659_450, 1),
    ("PlotJuggler/datasamples/out.bag", 194, 25_244, 1),
    ("PlotJuggler/datasamples/tilt_laser.bag", 4093, 1_154_586, 9),
    ("derived-alfa/alfa_bz2.bag", 2196, 268_840, 4),
];

#[test]
fn real_bags_have_the_counts_of_the_python_reader() {
    for (file, messages, bytes, topics) in COUNTED {
        let Some(path) = real_logs(file) else { continue };
        let log = read_all(&path);
        let payload: u64 = log.health.topics.iter().map(|t| t.payload_bytes).sum();
        assert_eq!((log.health.messages, payload, log.health.topics.len()), (messages, bytes, topics), "{file}");
        assert!(!lost(&log) && log.health.bytes.damaged == 0, "{file}: {:?}", log.notices);
        assert!(log.health.topics.iter().all(|t| t.decoded), "{file}");
        assert!(log.notices.iter().all(|n| n.code != "read-leniently"), "{file}: {:?}", log.notices);
    }
}

#[test]
fn intact_bags_have_the_messages_of_the_rosbag_crate() {
    use rosbag::{ChunkRecord, MessageRecord, RosBag};
    // The crate does not read the zeros between two records of this one.
    for (file, ..) in COUNTED.iter().filter(|c| !c.0.ends_with("fake_joint_state.bag")) {
        let Some(path) = real_logs(file) else { continue };
        let other = RosBag::new(&path).unwrap();
        let (mut messages, mut bytes) = (0, 0);
        for chunk in other.chunk_records() {
            let ChunkRecord::Chunk(chunk) = chunk.unwrap_or_else(|e| panic!("{file}: {e}")) else { continue };
            for record in chunk.messages() {
                if let MessageRecord::MessageData(message) = record.unwrap_or_else(|e| panic!("{file}: {e}")) {
                    messages += 1;
                    bytes += message.data.len() as u64;
                }
            }
        }
        let log = read_all(&path);
        let payload: u64 = log.health.topics.iter().map(|t| t.payload_bytes).sum();
        assert_eq!((log.health.messages, payload), (messages, bytes), "{file}");
    }
}

#[test]
fn all_ten_containers_of_one_flight_give_the_same_columns() {
    let Some(folder) = real_logs("derived-alfa") else { return };
    let intact = [
        "alfa_none.bag",
        "alfa_lz4.bag",
        "alfa_bz2.bag",
        "alfa_lz4_unindexed.bag",
        "alfa_ros1_none.mcap",
        "alfa_ros1_zstd.mcap",
        "alfa_ros1_lz4.mcap",
        "alfa_ros1_nosummary.mcap",
        "alfa_ros1_unchunked.mcap",
        "alfa_ros1_none_tailjunk.mcap",
        "alfa_mcap_ros2/alfa_mcap_ros2.mcap",
    ];
    let first = read_all(&folder.join(intact[0]));
    for file in intact {
        let log = read_all(&folder.join(file));
        assert_eq!((log.health.messages, log.health.undecodable), (2196, 0), "{file}");
        for (a, b) in first.tables.iter().zip(&log.tables) {
            assert_eq!((&a.topic.name, a.rows, &a.logged_ns), (&b.topic.name, b.rows, &b.logged_ns), "{file}");
            // ROS 2 headers have no sequence number.
            for column in a.columns.iter().filter(|c| c.path != "header.seq") {
                assert_eq!(Some(column), b.column(&column.path), "{file} {}", a.topic.name);
            }
        }
    }
}

#[test]
fn the_damaged_copies_give_what_can_be_recovered_and_are_marked() {
    let Some(folder) = real_logs("derived-alfa") else { return };
    // Recoverable messages according to these files' notes; from uncompressed and later chunks we get more.
    for (file, recoverable) in [
        ("alfa_none_trunc60.bag", 1149),
        ("alfa_bz2_trunc60.bag", 1149),
        ("alfa_lz4_unindexed.bag", 2196),
        ("alfa_bz2_bitflip.bag", 1809),
        ("alfa_ros1_none_trunc60.mcap", 1266),
        ("alfa_ros1_zstd_trunc60.mcap", 1266),
        ("alfa_ros1_zstd_bitflip.mcap", 837),
        ("alfa_ros1_none_tailjunk.mcap", 2196),
    ] {
        let log = read_all(&folder.join(file));
        assert!(log.health.messages >= recoverable, "{file}: {}", log.health.messages);
        assert!(lost(&log), "{file}");
        let rows: usize = log.tables.iter().map(|t| t.rows).sum();
        assert_eq!(rows as u64, log.health.messages, "{file}");
    }
}

#[test]
fn a_topic_of_two_types_makes_two_tables() {
    let sent: Vec<Sent> = flight(4);
    let content = bag(&sent, BagCodec::None, 100, true, false);
    // The camera's connection renamed to the topic of the fixes, with another type.
    let mut text = content.clone();
    let name = CAMERA.as_bytes();
    let places: Vec<usize> =
        content.windows(name.len()).enumerate().filter(|(_, w)| *w == name).map(|(i, _)| i).collect();
    for place in places {
        text[place..place + name.len()].copy_from_slice(b"/camerb");
    }
    let log = OnDisk::new(&text, true).read_where(|_| Selection::All).unwrap();
    let names: Vec<&str> = log.tables.iter().map(|t| t.topic.name.as_str()).collect();
    assert_eq!(names, ["/camerb", FIX]);
}

/// A field of a record's header: its length, `name=value`.
fn field(name: &str, value: &[u8]) -> Vec<u8> {
    [&((name.len() + 1 + value.len()) as u32).to_le_bytes()[..], name.as_bytes(), b"=", value].concat()
}

fn record(fields: &[(&str, &[u8])], data: &[u8]) -> Vec<u8> {
    let header: Vec<u8> = fields.iter().flat_map(|(name, value)| field(name, value)).collect();
    let length = |bytes: &[u8]| (bytes.len() as u32).to_le_bytes();
    [&length(&header)[..], &header, &length(data), data].concat()
}

/// A bag without an index that holds one connection and a message of eight bytes; `encryptor` is a field of its header.
fn small(type_name: &str, md5: &str, definition: &str, encryptor: Option<&str>) -> Vec<u8> {
    let mut head: Vec<(&str, &[u8])> =
        vec![("op", &[3]), ("index_pos", &[0; 8]), ("conn_count", &[0; 4]), ("chunk_count", &[0; 4])];
    head.extend(encryptor.map(|plugin| ("encryptor", plugin.as_bytes())));
    let parts = [("topic", FIX), ("type", type_name), ("md5sum", md5), ("message_definition", definition)];
    let data: Vec<u8> = parts.iter().flat_map(|(name, value)| field(name, value.as_bytes())).collect();
    let connection = record(&[("op", &[7]), ("conn", &[0; 4]), ("topic", FIX.as_bytes())], &data);
    let message =
        record(&[("op", &[2]), ("conn", &[0; 4]), ("time", &[1, 0, 0, 0, 0, 0, 0, 0])], &2.5_f64.to_le_bytes());
    [b"#ROSBAG V2.0\n".to_vec(), record(&head, &[b' '; 4000]), connection, message].concat()
}

#[test]
fn an_encrypted_bag_is_reported_as_such() {
    let read = |encryptor| OnDisk::new(&small("p/A", "*", "float64 x", encryptor), true).read();
    let error = read(Some("rosbag/AesCbcEncryptor")).unwrap_err().to_string();
    assert!(error.contains("encrypted") && error.contains("rosbag/AesCbcEncryptor"), "{error}");
    for plain in [None, Some(""), Some("rosbag/NoEncryptor")] {
        assert_eq!(read(plain).unwrap().tables[0].column("x").unwrap().number(0), Some(2.5));
    }
}

#[test]
fn a_connection_without_a_definition_is_not_an_empty_message_type() {
    let read =
        |type_name, md5| OnDisk::new(&small(type_name, md5, "", None), true).read().unwrap().health.topics.remove(0);
    for (type_name, md5) in [("*", "*"), ("my_msgs/Fix", "2d3a8cd499b9b4a0249fb98fd05cfa48")] {
        let topic = read(type_name, md5);
        assert!(!topic.decoded && topic.reason.starts_with("the message definition of"), "{topic:?}");
    }
    // The checksum of an empty text.
    assert!(read("std_msgs/Empty", "d41d8cd98f00b204e9800998ecf8427e").decoded);
}

/// Offsets of the records, of their data lengths and of their data ends, with their types.
fn records_of(bag: &[u8]) -> Vec<(u8, usize, usize, usize)> {
    let u32_at = |at: usize| u32::from_le_bytes(bag[at..at + 4].try_into().unwrap()) as usize;
    let (mut at, mut all) = (13, vec![]);
    while at < bag.len() {
        let length_at = at + 4 + u32_at(at);
        let header = &bag[at + 4..length_at];
        let op = header.windows(4).find(|w| w.starts_with(b"op=")).unwrap()[3];
        let end = length_at + 4 + u32_at(length_at);
        all.push((op, at, length_at, end));
        at = end;
    }
    all
}

#[test]
fn one_flipped_length_bit_costs_no_more_than_its_own_record() {
    let mut led_over = [0, 0];
    for (codec, per_chunk) in [(BagCodec::Lz4Independent, 3), (BagCodec::Lz4Linked, 5), (BagCodec::Bz2, 3)] {
        let sent = flight(120);
        for closed in [true, false] {
            let content = bag(&sent, codec, per_chunk, true, closed);
            let records = records_of(&content);
            let disk = OnDisk::new(&content, true);
            for &(op, _, length_at, end) in records.iter().filter(|record| [4, 5].contains(&record.0)) {
                for bit in 0..24 {
                    let length = (end - length_at - 4) ^ (1 << bit);
                    let new_end = length_at + 4 + length;
                    if new_end < end || !records.iter().any(|record| record.1 == new_end) {
                        continue;
                    }
                    led_over[usize::from(op == 5)] += 1;
                    disk.write_at(length_at as u64, &(length as u32).to_le_bytes());
                    let log = disk.read().unwrap();
                    assert_subset(&log, &sent, false);
                    let own = if op == 5 { per_chunk } else { 0 };
                    assert!(log.health.messages as usize + own >= sent.len(), "{codec:?}, {length_at}, bit {bit}");
                    assert!(log.health.bytes.damaged > 0 && lost(&log), "{codec:?}, {length_at}, bit {bit}");
                    disk.write_at(length_at as u64, &content[length_at..length_at + 4]);
                }
            }
        }
    }
    assert!(led_over.iter().all(|&cases| cases > 3), "{led_over:?}");
}

#[test]
fn chunks_with_wrong_lengths_do_not_rule_out_long_headers_after_them() {
    let (int, md5, definition) = ("std_msgs/Int32", "da5909fbe378aeaf85e547e830cc1bb7", "int32 data\n");
    let mut content = small(int, md5, definition, None);
    let long = "x".repeat(1500);
    let connection = |id: u32| {
        let topic = format!("/{long}{id}");
        let parts = [("topic", topic.as_str()), ("type", int), ("md5sum", md5), ("message_definition", definition)];
        let about: Vec<u8> = parts.iter().flat_map(|(name, value)| field(name, value.as_bytes())).collect();
        record(&[("op", &[7]), ("conn", &id.to_le_bytes()), ("topic", topic.as_bytes())], &about)
    };
    for _ in 0..12 {
        let mut chunk = record(&[("op", &[5]), ("compression", b"lz4"), ("size", &[9, 0, 0, 0])], &[7; 40]);
        let length_at = chunk.len() - 44;
        chunk[length_at..length_at + 4].copy_from_slice(&(1_u32 << 31).to_le_bytes());
        content.extend(chunk);
    }
    for id in 100..150_u32 {
        content.extend(connection(id));
        let header: [(&str, &[u8]); 3] =
            [("op", &[2]), ("conn", &id.to_le_bytes()), ("time", &[1, 0, 0, 0, 0, 0, 0, 0])];
        content.extend(record(&header, &id.to_le_bytes()));
    }
    let disk = OnDisk::new(&content, true);
    let log = disk.read_where(|topic| if topic.name.len() > 1000 { Selection::All } else { Selection::Skip }).unwrap();
    assert_eq!(log.tables.iter().map(|table| table.rows).sum::<usize>(), 50);
}
