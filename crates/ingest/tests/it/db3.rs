//! ROS 2 bags in SQLite: agreement with SQLite itself and with other containers, and handling of damage.

use crate::made::{
    CAMERA, Encoding, FIX, OnDisk, Sent, assert_balanced, assert_received, assert_subset, each_damage, flight, is_loss,
    lost, notice,
};
use crate::support::{in_context, real_logs, with_limits};
use flight::Severity;
use ingest::{FlightUnit, Limits, Log, LogError, LogKind, MapLibrary, ScanError, Selection, TopicInfo, discover};
use rusqlite::{Connection, MAIN_DB, params};
use simulate::{Container, Db3Compression, Db3Layout, Db3Settings, FlightSettings, McapEncoding, McapSettings};
use std::fs;
use std::path::{Path, PathBuf};

const TABLES: &str = "CREATE TABLE topics(id INTEGER PRIMARY KEY,name TEXT NOT NULL,type TEXT NOT NULL,\
    serialization_format TEXT NOT NULL,offered_qos_profiles TEXT NOT NULL);\
    CREATE TABLE message_definitions(id INTEGER PRIMARY KEY,topic_type TEXT NOT NULL,encoding TEXT NOT NULL,\
    encoded_message_definition TEXT NOT NULL,type_description_hash TEXT NOT NULL);\
    CREATE TABLE messages(id INTEGER PRIMARY KEY,topic_id INTEGER NOT NULL,timestamp INTEGER NOT NULL, data BLOB NOT NULL);\
    CREATE INDEX timestamp_idx ON messages (timestamp ASC);";
const FIX_TYPE: &str = "test_msgs/msg/Fix";

/// Fills a database with the messages. Images are `image` bytes longer than their definition needs.
fn fill(connection: &Connection, sent: &[Sent], image: usize) {
    connection.execute_batch(TABLES).unwrap();
    connection
        .execute("INSERT INTO message_definitions VALUES (1,?1,'ros2msg',?2,'')", params![FIX_TYPE, definition()])
        .unwrap();
    for (id, topic) in [(1, FIX), (2, CAMERA)] {
        connection.execute("INSERT INTO topics VALUES (?1,?2,?3,'cdr','')", params![id, topic, FIX_TYPE]).unwrap();
    }
    connection.execute_batch("BEGIN").unwrap();
    add(connection, sent, image);
    connection.execute_batch("COMMIT").unwrap();
}

fn add(connection: &Connection, sent: &[Sent], image: usize) {
    let mut insert = connection.prepare("INSERT INTO messages (topic_id, timestamp, data) VALUES (?1,?2,?3)").unwrap();
    for one in sent {
        let mut data = Encoding::Cdr.payload(one);
        let camera = one.topic == CAMERA;
        if camera {
            data.resize(data.len() + image, 7);
        }
        insert.execute(params![1 + i64::from(camera), one.logged_ns, data]).unwrap();
    }
}

fn definition() -> String {
    "std_msgs/Header header\nint32 status\nfloat64 latitude\nfloat64[3] variance\nuint8[] raw\n===\nMSG: std_msgs/Header\n\
     builtin_interfaces/Time stamp\nstring frame_id\n"
        .to_owned()
}

/// A bag in memory.
fn bag(sent: &[Sent], image: usize, pragmas: &str) -> Vec<u8> {
    let mut connection = Connection::open_in_memory().unwrap();
    connection.execute_batch(pragmas).unwrap();
    fill(&connection, sent, image);
    connection.serialize(MAIN_DB).unwrap().to_vec()
}

fn read_files(files: &[PathBuf]) -> Result<Log, LogError> {
    let want = |topic: &TopicInfo| if topic.name == FIX { Selection::All } else { Selection::Skip };
    let log = crate::support::read_files(Limits::default(), ingest::LogKind::Db3, files, &want)?;
    assert_balanced(&log);
    Ok(log)
}

/// Writes a bag to a new file and reads it.
fn read(content: &[u8]) -> Result<Log, LogError> {
    let disk = OnDisk::new(content, false);
    read_files(&[disk.path()])
}

fn messages_of(log: &Log, topic: &str) -> u64 {
    log.health.topics.iter().find(|t| t.name == topic).map_or(0, |t| t.messages)
}

#[test]
fn every_page_size_and_kind_of_database_is_read_as_written() {
    let sent = flight(60);
    let pragmas = [
        "PRAGMA page_size=512",
        "PRAGMA page_size=1024; PRAGMA auto_vacuum=FULL",
        "PRAGMA page_size=4096",
        "PRAGMA page_size=4096; PRAGMA encoding='UTF-16le'",
        "PRAGMA page_size=8192; PRAGMA encoding='UTF-16be'",
        "PRAGMA page_size=65536; PRAGMA auto_vacuum=INCREMENTAL",
    ];
    for pragma in pragmas {
        for image in [0, 700, 30_000] {
            let log = read(&bag(&sent, image, pragma)).unwrap();
            assert_received(&log, &sent, false);
            assert!(!lost(&log), "{pragma} {image}: {:?}", log.notices);
            assert_eq!((log.health.messages, messages_of(&log, CAMERA)), (180, 120), "{pragma} {image}");
            assert!(log.health.damage.is_empty());
        }
    }
}

#[test]
fn bytes_of_rows_are_decoded_or_skipped_and_the_rest_is_structure() {
    let sent = flight(50);
    let content = bag(&sent, 9000, "");
    let log = read(&content).unwrap();
    let payload = |topic: &str| {
        let of = sent.iter().filter(|s| s.topic == topic);
        of.map(|s| Encoding::Cdr.payload(s).len() as u64 + if topic == CAMERA { 9000 } else { 0 }).sum::<u64>()
    };
    let bytes = log.health.bytes;
    assert_eq!(bytes.size, content.len() as u64);
    // A row has its own header, of at least nine and at most sixteen bytes here.
    for (counted, topic, rows) in [(bytes.decoded, FIX, 50), (bytes.skipped, CAMERA, 100)] {
        let extra = counted - payload(topic);
        assert!((9 * rows..=16 * rows).contains(&extra), "{topic}: {extra}");
    }
}

#[test]
fn other_database_content_is_neither_executed_nor_damage() {
    let sent = flight(40);
    let mut connection = Connection::open_in_memory().unwrap();
    connection.execute_batch("PRAGMA page_size=512").unwrap();
    fill(&connection, &sent, 2000);
    let long = "x".repeat(3000);
    // Enough for entries above the leaves.
    let pairs: Vec<String> = (100..140).map(|i| format!("('{i}{long}', 'x')")).collect();
    let pairs = pairs.join(",");
    connection
        .execute_batch(&format!(
            "CREATE TABLE notes(id INTEGER PRIMARY KEY, text TEXT); CREATE INDEX by_text ON notes (text);\
             INSERT INTO notes (text) VALUES ('{long}a'),('{long}b'),('c');\
             CREATE TABLE pairs(a TEXT PRIMARY KEY, b TEXT) WITHOUT ROWID; INSERT INTO pairs VALUES {pairs};\
             CREATE VIEW everything AS SELECT * FROM messages a, messages b;\
             CREATE TRIGGER gone AFTER INSERT ON messages BEGIN DELETE FROM messages; END;\
             DROP TRIGGER gone; DELETE FROM messages WHERE id > 60;"
        ))
        .unwrap();
    let content = connection.serialize(MAIN_DB).unwrap().to_vec();
    let log = read(&content).unwrap();
    assert!(!lost(&log), "{:?}", log.notices);
    assert_received(&log, &sent[..60], false);
    assert_eq!(log.health.bytes.damaged, 0);
}

#[test]
fn a_database_that_is_not_a_bag_is_reported_as_such() {
    let mut connection = Connection::open_in_memory().unwrap();
    connection
        .execute_batch("CREATE TABLE t(a); INSERT INTO t VALUES (1); CREATE VIEW messages AS SELECT 1 AS topic_id")
        .unwrap();
    let error = read(&connection.serialize(MAIN_DB).unwrap()).unwrap_err();
    assert!(error.to_string().contains("no table of messages"), "{error}");
}

/// A bag whose recorder was killed: part of it is only in the write-ahead log.
pub fn killed(folder: &Path, sent: &[Sent]) -> PathBuf {
    let path = folder.join("live.db3");
    let connection = Connection::open(&path).unwrap();
    connection.execute_batch("PRAGMA journal_mode=WAL; PRAGMA wal_autocheckpoint=0").unwrap();
    fill(&connection, &sent[..sent.len() / 2], 5000);
    connection.execute_batch("PRAGMA wal_checkpoint(TRUNCATE)").unwrap();
    for part in sent[sent.len() / 2..].chunks(10) {
        connection.execute_batch("BEGIN").unwrap();
        add(&connection, part, 5000);
        connection.execute_batch("COMMIT").unwrap();
    }
    let bag = folder.join("bag.db3");
    fs::copy(&path, &bag).unwrap();
    fs::copy(folder.join("live.db3-wal"), folder.join("bag.db3-wal")).unwrap();
    drop(connection);
    fs::remove_file(path).unwrap();
    bag
}

#[test]
fn rows_only_in_the_write_ahead_log_are_read_without_touching_the_bag() {
    let folder = tempfile::tempdir().unwrap();
    let sent = flight(60);
    let bag = killed(folder.path(), &sent);
    let before = fs::read(&bag).unwrap();
    let log = read_files(std::slice::from_ref(&bag)).unwrap();
    assert_received(&log, &sent, false);
    assert!(!lost(&log), "{:?}", log.notices);
    assert_eq!(notice(&log, "incomplete-recording").severity, Severity::Info);
    let wal = fs::metadata(folder.path().join("bag.db3-wal")).unwrap().len();
    assert_eq!(log.health.bytes.size, before.len() as u64 + wal);
    assert!(fs::read(&bag).unwrap() == before && !folder.path().join("bag.db3-shm").exists());
    // Discovery lists it as part of the flight, so that the flight's key covers it.
    let found = discover(folder.path(), &MapLibrary::shipped().unwrap()).unwrap();
    assert_eq!((found.units.len(), found.units[0].files.len(), found.ignored.len()), (1, 2, 0), "{found:?}");
}

#[test]
fn a_bag_whose_data_is_all_in_a_missing_write_ahead_log_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let (path, bag) = (folder.path().join("live.db3"), folder.path().join("bag.db3"));
    let connection = Connection::open(&path).unwrap();
    connection.execute_batch("PRAGMA journal_mode=WAL; PRAGMA wal_autocheckpoint=0").unwrap();
    fill(&connection, &flight(5), 0);
    fs::copy(&path, &bag).unwrap();
    let error = read_files(std::slice::from_ref(&bag)).unwrap_err().to_string();
    assert!(error.contains("no table of messages") && error.contains("-wal"), "{error}");
}

#[test]
fn a_possibly_missing_write_ahead_log_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let sent = flight(60);
    let bag = killed(folder.path(), &sent);
    fs::remove_file(folder.path().join("bag.db3-wal")).unwrap();
    let log = read_files(std::slice::from_ref(&bag)).unwrap();
    assert_eq!(notice(&log, "incomplete-recording").severity, Severity::Warning);
    // An empty one may have been truncated.
    fs::write(folder.path().join("bag.db3-wal"), []).unwrap();
    let log = read_files(std::slice::from_ref(&bag)).unwrap();
    assert_eq!(notice(&log, "incomplete-recording").severity, Severity::Warning);
    fs::remove_file(folder.path().join("bag.db3-wal")).unwrap();
    let metadata = folder.path().join("metadata.yaml");
    for (counted, code) in [(messages_of(&log, FIX), None), (60, Some("index-differs"))] {
        let text = format!(
            "rosbag2_bagfile_information:\n  relative_file_paths: [bag.db3]\n  topics_with_message_count:\n  \
             - {{message_count: {counted}, topic_metadata: {{name: {FIX}}}}}\n"
        );
        fs::write(&metadata, text).unwrap();
        let log = read_files(&[bag.clone(), metadata.clone()]).unwrap();
        assert_eq!(log.notices.iter().next().map(|n| n.code.as_str()), code, "{:?}", log.notices);
    }
}

#[test]
fn a_damaged_write_ahead_log_gives_whole_transactions_and_a_loss() {
    let folder = tempfile::tempdir().unwrap();
    let sent = flight(60);
    let bag = killed(folder.path(), &sent);
    let wal = folder.path().join("bag.db3-wal");
    let whole = fs::read(&wal).unwrap();
    let mut seen = vec![];
    for share in [0.3, 0.6, 0.9] {
        let cut = (whole.len() as f64 * share) as usize;
        fs::write(&wal, &whole[..cut]).unwrap();
        let log = read_files(std::slice::from_ref(&bag)).unwrap();
        seen.push(assert_subset(&log, &sent, false));
        let mut flipped = whole.clone();
        flipped[cut] ^= 1;
        fs::write(&wal, &flipped).unwrap();
        let log = read_files(std::slice::from_ref(&bag)).unwrap();
        // As SQLite has it, the log ends with the frame before the damaged one.
        assert_eq!(assert_subset(&log, &sent, false), *seen.last().unwrap());
        assert!(is_loss(&log, "incomplete-recording"), "{:?}", log.notices);
    }
    assert!(seen[0] >= 30 && seen[0] < seen[1] && seen[1] < seen[2] && seen[2] < 60, "{seen:?}");
    // Without its header it is unusable.
    for useless in [[&[0xff; 32][..], &whole[32..]].concat(), vec![0xff; whole.len()]] {
        fs::write(&wal, useless).unwrap();
        let log = read_files(std::slice::from_ref(&bag)).unwrap();
        assert_eq!((assert_subset(&log, &sent, false), log.health.bytes.damaged), (30, whole.len() as u64));
    }
}

/// Pages of the database by what they are: leaves with rows of messages, and the pages above them.
fn pages(content: &[u8], kind: u8) -> Vec<usize> {
    let size = usize::from(u16::from_be_bytes([content[16], content[17]]));
    (2..content.len() / size).map(|page| page * size).filter(|&at| content[at] == kind).collect()
}

#[test]
fn a_lost_page_of_rows_costs_only_its_rows() {
    let sent = flight(200);
    let content = bag(&sent, 0, "PRAGMA page_size=1024");
    let intact = read(&content).unwrap().health.messages;
    let leaves = pages(&content, 0x0d);
    assert!(leaves.len() > 50);
    for &leaf in leaves.iter().step_by(7).skip(1) {
        let mut damaged = content.clone();
        let rows = u64::from(u16::from_be_bytes([content[leaf + 3], content[leaf + 4]]));
        damaged[leaf..leaf + 1024].fill(0);
        let log = read(&damaged).unwrap();
        assert!(lost(&log) && log.health.bytes.damaged >= 1024, "{:?}", log.notices);
        assert_eq!(log.health.messages, intact - rows);
        assert_subset(&log, &sent, false);
    }
}

#[test]
fn rows_below_a_lost_tree_page_are_lost_and_counted() {
    let sent = flight(400);
    for image in [0, 3000] {
        let content = bag(&sent, image, "PRAGMA page_size=512");
        let above = pages(&content, 0x05);
        assert!(above.len() > 1);
        for page in above {
            let mut damaged = content.clone();
            damaged[page..page + 512].fill(0xee);
            // The root of the messages may be among them.
            let Ok(log) = read(&damaged) else { continue };
            assert_subset(&log, &sent, false);
            assert!(log.health.messages < 1200 && lost(&log), "{:?}", log.notices);
            // The page, and the pages below it that nothing else refers to.
            assert!(log.health.bytes.damaged >= 10 * 512, "{:?}", log.health.bytes);
        }
    }
}

#[test]
fn a_bag_without_its_first_page_is_refused() {
    let mut content = bag(&flight(100), 200, "PRAGMA page_size=4096");
    content[..4096].fill(0xee);
    let error = read(&content).unwrap_err().to_string();
    assert!(error.contains("the header of the database is damaged"), "{error}");
}

#[test]
fn a_cut_anywhere_gives_a_prefix_or_an_error_and_always_a_loss() {
    let sent = flight(40);
    let content = bag(&sent, 600, "PRAGMA page_size=512");
    let disk = OnDisk::new(&content, false);
    let mut most = 0;
    for cut in (1..content.len()).rev().step_by(149) {
        disk.set_len(cut as u64);
        match read_files(&[disk.path()]) {
            Ok(log) => {
                assert!(lost(&log), "cut at {cut}: {:?}", log.notices);
                most = most.max(assert_subset(&log, &sent, false));
            }
            Err(error) => assert!(!error.to_string().is_empty()),
        }
    }
    assert!(most > 35, "{most}");
}

#[test]
fn every_byte_is_counted_whatever_the_damage() {
    let sent = flight(40);
    for pragma in ["PRAGMA page_size=512", "PRAGMA page_size=1024; PRAGMA auto_vacuum=FULL"] {
        let content = bag(&sent, 1500, pragma);
        let mut read_all = 0;
        each_damage(&content, 300, |damaged| {
            if let Ok(log) = read(damaged) {
                read_all += u64::from(log.health.messages >= 110);
            }
        });
        // In a third of the cases bytes are removed or inserted: all later pages are then misaligned.
        assert!(read_all > 150, "{read_all}");
    }
}

#[test]
fn circular_trees_end() {
    let sent = flight(400);
    let content = bag(&sent, 0, "PRAGMA page_size=512");
    let number = |at: usize| (at as u32 / 512 + 1).to_be_bytes();
    for page in pages(&content, 0x05) {
        // Its last child is the page itself, or the root of all.
        for child in [number(page), 1_u32.to_be_bytes(), u32::MAX.to_be_bytes(), [0; 4]] {
            let mut circular = content.clone();
            circular[page + 8..page + 12].copy_from_slice(&child);
            let log = read(&circular).unwrap();
            assert_subset(&log, &sent, false);
            assert!(lost(&log), "{:?}", log.notices);
        }
    }
}

/// Rows of the camera and of the fixes, and how many there should be of both.
fn rows_of(log: &Log, sent: &[Sent]) -> (usize, u64) {
    (assert_subset(log, sent, false), log.health.messages)
}

#[test]
fn a_misplaced_page_is_never_read_twice_or_lost_silently() {
    let sent = flight(200);
    for page_bytes in [512, 4096] {
        let content = bag(&sent, 0, &format!("PRAGMA page_size={page_bytes}"));
        let leaves = pages(&content, 0x0d);
        let of_messages = &leaves[leaves.len() / 4..];
        let above = pages(&content, 0x05);
        let rows = |page: usize| u64::from(u16::from_be_bytes([content[page + 3], content[page + 4]]));
        for (index, &page) in of_messages.iter().enumerate().step_by(5) {
            for &other in of_messages.iter().skip(index % 3).step_by(7).chain(&above).filter(|&&other| other != page) {
                let mut mixed = content.clone();
                mixed.copy_within(other..other + page_bytes, page);
                let log = read(&mixed).unwrap();
                let (_, messages) = rows_of(&log, &sent);
                assert!(lost(&log), "{page} is {other}: {messages}, {:?}", log.notices);
                assert_eq!(messages, 600 - rows(page), "{page} is {other}");
            }
        }
    }
}

#[test]
fn trees_are_trusted_over_the_list_of_unused_pages() {
    let sent = flight(300);
    for page_bytes in [512_usize, 1024] {
        let content = bag(&sent, 900, &format!("PRAGMA page_size={page_bytes}"));
        let last = (content.len() / page_bytes) as u32;
        let first_unused = (1..=last).step_by(3).map(|page| (32, page));
        for (at, number) in first_unused.chain([(36, 1), (36, 40)]) {
            let mut lying = content.clone();
            lying[at..at + 4].copy_from_slice(&number.to_be_bytes());
            let log = read(&lying).unwrap();
            assert_received(&log, &sent, false);
            assert_eq!((log.health.messages, log.health.bytes.damaged), (900, 0), "{at} {number}: {:?}", log.notices);
            assert!(notice(&log, "read-leniently").count > 0);
        }
        // The file claims to have pointer-map pages: rows may be on them.
        for number in [1_u32, 1 << 20] {
            let mut lying = content.clone();
            lying[52..56].copy_from_slice(&number.to_be_bytes());
            let log = read(&lying).unwrap();
            assert_received(&log, &sent, false);
            assert!(lost(&log) && log.health.messages >= 880, "{:?}", log.notices);
        }
    }
}

#[test]
fn one_bit_in_the_schema_costs_nothing_silently() {
    let sent = flight(60);
    let content = bag(&sent, 0, "PRAGMA page_size=4096");
    let whole = read(&content).unwrap().health.messages;
    let (mut tried, mut silent) = (0, vec![]);
    for at in (100..4096).filter(|&at| content[at] != 0) {
        for bit in [0, 2, 5, 7] {
            let mut lying = content.clone();
            lying[at] ^= 1 << bit;
            tried += 1;
            let Ok(log) = read(&lying) else { continue };
            let is_reported = lost(&log) || log.notices.iter().any(|n| n.code == "not-decoded");
            let is_whole = rows_of(&log, &sent) == (60, whole);
            if !(is_whole || is_reported) {
                silent.push((at, bit));
            }
        }
    }
    assert!(tried > 2000 && silent.is_empty(), "{} of {tried}: {silent:?}", silent.len());
}

#[test]
fn rows_of_one_page_are_each_read_once_despite_wrong_pointers() {
    let sent = flight(100);
    let content = bag(&sent, 0, "PRAGMA page_size=4096");
    let leaf = pages(&content, 0x0d)[5];
    let rows = usize::from(u16::from_be_bytes([content[leaf + 3], content[leaf + 4]]));
    assert!(rows > 10);
    let with = |change: &dyn Fn(&mut [u8])| {
        let mut lying = content.clone();
        change(&mut lying[leaf..leaf + 4096]);
        let log = read(&lying).unwrap();
        (300 - rows_of(&log, &sent).1, lost(&log))
    };
    for (one, other) in [(0, 1), (1, 0), (rows - 1, 2), (3, rows - 1)] {
        let (missing, is_reported) = with(&|page| page.copy_within(8 + 2 * other..10 + 2 * other, 8 + 2 * one));
        assert!((1..rows as u64).contains(&missing) && is_reported, "{one} {other}: {missing}");
    }
    assert_eq!(with(&|page| page[3..5].fill(0)), (rows as u64, true));
    assert_eq!(with(&|page| page[4] -= 1), (1, true));
    // With a wrong key in an interior page, rows seem to belong elsewhere.
    for above in pages(&content, 0x05) {
        let cell = usize::from(u16::from_be_bytes([content[above + 12], content[above + 13]]));
        for bit in 0..7 {
            let mut lying = content.clone();
            lying[above + cell + 4] ^= 1 << bit;
            let log = read(&lying).unwrap();
            let (_, messages) = rows_of(&log, &sent);
            assert!(messages == 300 || messages > 280 && lost(&log), "{messages}: {:?}", log.notices);
        }
    }
}

#[test]
fn a_table_is_read_by_column_names_in_any_order() {
    let sent = flight(40);
    let plain = read(&bag(&sent, 0, "")).unwrap();
    let changes = [
        "CREATE TABLE t AS SELECT * FROM topics ORDER BY id DESC; DROP TABLE topics; ALTER TABLE t RENAME TO topics",
        "CREATE TABLE m AS SELECT * FROM messages; DROP TABLE messages; ALTER TABLE m RENAME TO messages",
        "CREATE TABLE m AS SELECT data, timestamp, topic_id, id FROM messages; DROP TABLE messages; ALTER TABLE m RENAME TO messages",
        "CREATE TABLE t AS SELECT offered_qos_profiles, type, id, serialization_format, name FROM topics; DROP TABLE topics; ALTER TABLE t RENAME TO topics",
        "CREATE TABLE d AS SELECT encoding, type_description_hash, topic_type, encoded_message_definition FROM message_definitions;\
         DROP TABLE message_definitions; ALTER TABLE d RENAME TO message_definitions",
    ];
    for change in changes {
        let mut connection = Connection::open_in_memory().unwrap();
        fill(&connection, &sent, 0);
        connection.execute_batch(change).unwrap();
        let log = read(&connection.serialize(MAIN_DB).unwrap()).unwrap();
        assert_received(&log, &sent, false);
        assert!(log.notices.is_empty(), "{change}: {:?}", log.notices);
        assert_eq!(log.tables, plain.tables, "{change}");
    }
    // Where data come first, topic and time of a long row are on other pages: such rows are a loss.
    let mut connection = Connection::open_in_memory().unwrap();
    fill(&connection, &sent, 6000);
    connection.execute_batch(changes[2]).unwrap();
    let log = read(&connection.serialize(MAIN_DB).unwrap()).unwrap();
    assert!(lost(&log), "{:?}", log.notices);
    assert_received(&log, &sent, false);
}

#[test]
fn tiny_databases_and_those_with_trailing_space_are_intact() {
    let sent = flight(40);
    let mut connection = Connection::open_in_memory().unwrap();
    let tables: Vec<&str> = TABLES.split(';').filter(|made| !made.contains("definitions")).collect();
    connection.execute_batch(&format!("PRAGMA page_size=512; {}", tables.join(";"))).unwrap();
    connection.execute("INSERT INTO topics VALUES (1,?1,?2,'cdr','')", params![FIX, FIX_TYPE]).unwrap();
    add(&connection, &sent[..1], 0);
    let small = connection.serialize(MAIN_DB).unwrap().to_vec();
    assert!(small.len() < 4096, "{}", small.len());
    let log = read(&small).unwrap();
    assert_eq!((log.health.messages, log.health.bytes.damaged, lost(&log)), (1, 0, false), "{:?}", log.notices);
    let log = read(&[bag(&sent, 0, ""), vec![0; 5 * 4096]].concat()).unwrap();
    assert_received(&log, &sent, false);
    assert!(log.notices.is_empty() && log.health.bytes.damaged == 0, "{:?}", log.notices);
}

#[test]
fn a_restarted_write_ahead_log_hides_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (path, bag) = (folder.path().join("live.db3"), folder.path().join("bag.db3"));
    let sent = flight(60);
    let connection = Connection::open(&path).unwrap();
    connection.execute_batch("PRAGMA journal_mode=WAL").unwrap();
    fill(&connection, &sent, 0);
    connection.execute_batch("PRAGMA wal_checkpoint(RESTART)").unwrap();
    let before = fs::read(folder.path().join("live.db3-wal")).unwrap();
    fs::copy(&path, &bag).unwrap();
    connection.execute_batch("INSERT INTO topics VALUES (9,'/nine','a/msg/B','cdr','')").unwrap();
    let begun = fs::read(folder.path().join("live.db3-wal")).unwrap();
    assert_ne!(begun[..32], before[..32]);
    // With a damaged header no frame of an earlier round is used: its pages are older than the database.
    let head = |at: usize| [&begun[..at], &[begun[at] ^ 16], &begun[at + 1..]].concat();
    for at in 0..32 {
        fs::write(folder.path().join("bag.db3-wal"), head(at)).unwrap();
        let log = read_files(std::slice::from_ref(&bag)).unwrap();
        assert_received(&log, &sent, false);
        assert!(lost(&log), "{at}");
    }
    // Killed between the new header and its first frame.
    for wal in [begun[..32].to_vec(), [&begun[..32], &before[32..]].concat()] {
        fs::write(folder.path().join("bag.db3-wal"), &wal).unwrap();
        let log = read_files(std::slice::from_ref(&bag)).unwrap();
        assert_received(&log, &sent, false);
        assert!(!lost(&log) && log.health.bytes.damaged == 0, "{:?}", log.notices);
        assert_eq!(log.health.bytes.size, fs::metadata(&bag).unwrap().len() + wal.len() as u64);
    }
}

#[test]
fn no_bit_of_a_write_ahead_log_frame_costs_anything_silently() {
    let folder = tempfile::tempdir().unwrap();
    let sent = flight(60);
    let bag = killed(folder.path(), &sent);
    let wal = folder.path().join("bag.db3-wal");
    let whole = fs::read(&wal).unwrap();
    for at in (0..24).chain((32 + 4120..).take(24)).chain((32 + 3 * 4120..).take(24)) {
        let mut lying = whole.clone();
        lying[at] ^= 4;
        fs::write(&wal, &lying).unwrap();
        let log = read_files(std::slice::from_ref(&bag)).unwrap();
        let read = assert_subset(&log, &sent, false);
        assert!(read >= 30 && (read == 60 || lost(&log)), "byte {at}: {read}, {:?}", log.notices);
    }
    // A block that is lost, be it zeros or missing.
    for block in 0..whole.len() / 4096 {
        let (from, to) = (block * 4096, (block + 1) * 4096);
        let missing = [&whole[..from], &whole[to..]].concat();
        for lying in [[&whole[..from], &[0; 4096], &whole[to..]].concat(), missing] {
            fs::write(&wal, &lying).unwrap();
            let log = read_files(std::slice::from_ref(&bag)).unwrap();
            let read = assert_subset(&log, &sent, false);
            assert!(read >= 30 && (read == 60 || lost(&log)), "block {block}: {read}, {:?}", log.notices);
        }
    }
    // Frames of this log repeated after it are older than what they would replace.
    fs::write(&wal, [&whole[..], &whole[32..32 + 5 * 4120]].concat()).unwrap();
    assert_received(&read_files(std::slice::from_ref(&bag)).unwrap(), &sent, false);
    fs::write(&wal, &whole).unwrap();
    // Only the beginning of the database exists: the log's content counts, and no nonexistent byte.
    let database = fs::read(&bag).unwrap();
    fs::write(&bag, &database[..8 * 4096]).unwrap();
    let log = read_files(std::slice::from_ref(&bag)).unwrap();
    assert!(assert_subset(&log, &sent, false) >= 30 && lost(&log));
}

#[test]
fn pages_freed_by_a_write_ahead_log_are_not_read() {
    let folder = tempfile::tempdir().unwrap();
    let (path, bag) = (folder.path().join("live.db3"), folder.path().join("bag.db3"));
    let sent = flight(60);
    let connection = Connection::open(&path).unwrap();
    connection.execute_batch("PRAGMA auto_vacuum=INCREMENTAL; PRAGMA journal_mode=WAL").unwrap();
    fill(&connection, &sent, 0);
    let shrink =
        "PRAGMA wal_checkpoint(TRUNCATE); PRAGMA wal_autocheckpoint=0; DELETE FROM messages WHERE id > 30; VACUUM";
    connection.execute_batch(shrink).unwrap();
    fs::copy(&path, &bag).unwrap();
    fs::copy(folder.path().join("live.db3-wal"), folder.path().join("bag.db3-wal")).unwrap();
    let log = read_files(std::slice::from_ref(&bag)).unwrap();
    assert_eq!((log.health.messages, log.health.bytes.damaged, lost(&log)), (30, 0, false), "{:?}", log.notices);
}

#[test]
fn a_row_that_claims_too_much_costs_only_itself() {
    let sent = flight(30);
    let content = bag(&sent, 9000, "PRAGMA page_size=4096");
    let leaf = pages(&content, 0x0d)
        .into_iter()
        .find(|&at| u16::from_be_bytes([content[at + 3], content[at + 4]]) > 3)
        .unwrap();
    let cell = leaf + usize::from(u16::from_be_bytes([content[leaf + 8], content[leaf + 9]]));
    for length in [&[0xff; 9][..], &[0xff, 0xff, 0xff, 0x7f], &[0x81, 0x80, 0x80, 0x80, 0x80, 0x00]] {
        let mut lying = content.clone();
        lying[cell..cell + length.len()].copy_from_slice(length);
        let log = read(&lying).unwrap();
        assert!(lost(&log));
        assert!(assert_subset(&log, &sent, false) >= 28);
    }
    let limits = Limits { record_bytes: 1000, ..Limits::default() };
    let disk = OnDisk::new(&content, false);
    let log = with_limits(limits, |c| {
        ingest::read_files(ingest::LogKind::Db3, &[disk.path()], &|_: &TopicInfo| Selection::All, c)
    })
    .unwrap();
    assert!(notice(&log, "corrupt").count >= 60, "{:?}", log.notices);
    assert_balanced(&log);
}

#[test]
fn a_bag_without_definitions_uses_common_ones_if_they_fit() {
    let stamp = [5_u32, 7].map(u32::to_le_bytes).concat();
    let vector = [
        &[0, 1, 0, 0][..],
        &stamp,
        &4_u32.to_le_bytes(),
        b"imu\0",
        &[1.5_f64, -2.0, 3.25].map(f64::to_le_bytes).concat(),
    ]
    .concat();
    let mut connection = Connection::open_in_memory().unwrap();
    connection.execute_batch(&TABLES.replace("message_definitions", "something_else")).unwrap();
    let types = [
        "geometry_msgs/msg/Vector3Stamped",
        "geometry_msgs/msg/QuaternionStamped",
        "my_msgs/msg/Own",
        "geometry_msgs/msg/PointStamped",
    ];
    for (id, type_name) in types.iter().enumerate() {
        let row = params![id as i64 + 1, format!("/{id}"), type_name];
        connection.execute("INSERT INTO topics VALUES (?1,?2,?3,'cdr','')", row).unwrap();
        let mut data = vector.clone();
        if id == 3 {
            data.extend([0; 8]);
        }
        connection.execute("INSERT INTO messages VALUES (NULL,?1,?2,?3)", params![id as i64 + 1, 10, data]).unwrap();
    }
    let disk = OnDisk::new(&connection.serialize(MAIN_DB).unwrap(), false);
    let log =
        in_context(|c| ingest::read_files(ingest::LogKind::Db3, &[disk.path()], &|_: &TopicInfo| Selection::All, c))
            .unwrap();
    assert_eq!(log.tables.len(), 1);
    let column = |path: &str| log.tables[0].column(path).unwrap();
    assert_eq!(column("vector.z").number(0), Some(3.25));
    assert_eq!(column("header.stamp").integer(0), Some(5_000_000_007));
    let reasons: Vec<&str> = log.health.topics.iter().map(|t| t.reason.as_str()).collect();
    assert!(
        reasons[1].contains("ends inside") && reasons[2].contains("the message definition is missing"),
        "{reasons:?}"
    );
    assert!(reasons[3].contains("longer than the built-in definition"), "{reasons:?}");
    assert_eq!(notice(&log, "definition-supplied").count, 3);
}

#[test]
fn a_broken_compressed_message_is_a_loss_and_a_bomb_is_rejected() {
    let sent = flight(20);
    let mut connection = Connection::open_in_memory().unwrap();
    fill(&connection, &sent, 0);
    let bomb = zstd::bulk::compress(&vec![0; 40 << 20], 1).unwrap();
    let good = zstd::bulk::compress(&Encoding::Cdr.payload(&sent[0]), 1).unwrap();
    let mut lying = bomb.clone();
    // The frame says that it holds fewer bytes than it does.
    lying[5..9].copy_from_slice(&100_u32.to_le_bytes());
    for data in [&good, &bomb, &lying, &good[..good.len() - 1].to_vec(), &good[..5].to_vec()] {
        connection.execute("INSERT INTO messages VALUES (NULL,1,10,?1)", params![data]).unwrap();
    }
    let limits = Limits { chunk_bytes: 1 << 20, ..Limits::default() };
    let disk = OnDisk::new(&connection.serialize(MAIN_DB).unwrap(), false);
    let want = |topic: &TopicInfo| if topic.name == FIX { Selection::All } else { Selection::Skip };
    let log = with_limits(limits, |c| ingest::read_files(ingest::LogKind::Db3, &[disk.path()], &want, c)).unwrap();
    assert_eq!((log.tables[0].rows, log.health.undecodable, notice(&log, "undecodable").count), (21, 4, 4));
    assert_eq!(log.health.messages, 65);
}

fn simulated() -> simulate::SimulatedFlight {
    simulate::simulate(&FlightSettings { duration_s: 10.0, ..FlightSettings::default() }).unwrap()
}

fn discovered(folder: &Path) -> FlightUnit {
    let found = discover(folder, &MapLibrary::shipped().unwrap()).unwrap();
    assert_eq!((found.units.len(), found.ignored.len()), (1, 0), "{found:?}");
    found.units.into_iter().next().unwrap()
}

fn written(container: Container) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for file in container.files(&simulated(), "f").unwrap() {
        let path = folder.path().join(&file.path);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, &file.bytes).unwrap();
    }
    folder
}

fn whole(unit: &FlightUnit) -> Log {
    let log = in_context(|context| ingest::read(unit, &|_: &TopicInfo| Selection::All, context)).unwrap();
    assert_balanced(&log);
    log
}

#[test]
fn one_flight_in_every_kind_of_bag_equals_the_mcap_bit_for_bit() {
    use {Db3Compression as C, Db3Layout as L};
    let mcap = |encoding| written(Container::Mcap(McapSettings { encoding, ..McapSettings::default() }));
    let truth = whole(&discovered(mcap(McapEncoding::Cdr).path()));
    assert_eq!(truth.tables.len(), 4);
    let unpublished = |log: &Log| {
        let mut tables = log.tables.clone();
        tables.iter_mut().for_each(|table| table.published_ns = None);
        tables
    };
    for compression in [C::None, C::ZstdMessages, C::ZstdFile] {
        for layout in [L::Bare, L::Folder(1), L::Folder(3)] {
            for definitions in [true, false] {
                let settings = Db3Settings { compression, layout, definitions };
                let folder = written(Container::Db3(settings));
                let unit = discovered(folder.path());
                let files = match layout {
                    L::Bare => 1,
                    L::Folder(files) => usize::from(files) + 1,
                };
                assert_eq!((unit.kind, unit.files.len()), (LogKind::Db3, files));
                assert_eq!(Path::new(&unit.id), Container::Db3(settings).path("f"));
                let log = whole(&unit);
                assert!(!lost(&log), "{settings:?}: {:?}", log.notices);
                assert!(unpublished(&log) == unpublished(&truth), "{settings:?}");
            }
        }
    }
    let idl = whole(&discovered(mcap(McapEncoding::Idl).path()));
    assert!(idl.tables == truth.tables);
}

#[test]
fn the_recorders_counts_are_compared_with_the_content() {
    let settings = Db3Settings { layout: Db3Layout::Folder(3), ..Db3Settings::default() };
    let folder = written(Container::Db3(settings));
    let second = folder.path().join("f/f_1.db3");
    let content = fs::read(&second).unwrap();
    fs::remove_file(&second).unwrap();
    let log = whole(&discovered(folder.path()));
    assert!(notice(&log, "incomplete-recording").text.contains("f_1.db3"));
    let fewer = notice(&log, "index-differs");
    assert_eq!((fewer.severity, fewer.count + log.health.messages), (Severity::Loss, whole_count()));
    // Without recorder metadata, the numbers in the names give the order.
    fs::write(&second, content).unwrap();
    let metadata = folder.path().join("f/metadata.yaml");
    let text = fs::read_to_string(&metadata).unwrap();
    fs::remove_file(&metadata).unwrap();
    let unit = discovered(folder.path());
    assert_eq!((unit.id.as_str(), unit.files.len()), ("f", 3));
    assert_eq!(whole(&unit).health.messages, whole_count());
    fs::write(&metadata, text.replace("message_count: 51", "message_count: 50")).unwrap();
    let log = whole(&discovered(folder.path()));
    assert_eq!(notice(&log, "index-differs").count, 1);
    assert!(!lost(&log));
}

fn whole_count() -> u64 {
    whole(&discovered(written(Container::Db3(Db3Settings::default())).path())).health.messages
}

#[test]
fn several_mcaps_of_one_recording_are_one_flight() {
    let folder = tempfile::tempdir().unwrap();
    let sent = flight(30);
    let bag = folder.path().join("run");
    fs::create_dir(&bag).unwrap();
    for (name, part) in ["run_0.mcap", "run_1.mcap", "run_10.mcap"].iter().zip(sent.chunks(30)) {
        fs::write(bag.join(name), crate::made::mcap(part, Encoding::Cdr, crate::made::Layout::ZSTD)).unwrap();
    }
    let read = |unit: &FlightUnit| {
        let want = |topic: &TopicInfo| if topic.name == FIX { Selection::All } else { Selection::Skip };
        let log = in_context(|context| ingest::read(unit, &want, context)).unwrap();
        assert_balanced(&log);
        log
    };
    let unit = discovered(folder.path());
    assert_eq!((unit.id.as_str(), unit.kind, unit.files.len()), ("run", LogKind::Mcap, 3));
    assert_received(&read(&unit), &sent, true);
    let names = "    - run_0.mcap\n    - run_1.mcap\n    - run_10.mcap\n    - ../run_11.mcap\n";
    let text = format!(
        "rosbag2_bagfile_information:\n  relative_file_paths:\n{names}  topics_with_message_count:\n    - topic_metadata:\n        name: {FIX}\n      message_count: 31\n"
    );
    fs::write(bag.join("metadata.yaml"), text).unwrap();
    let unit = discovered(folder.path());
    assert_eq!(unit.files.len(), 4);
    let log = read(&unit);
    assert_received(&log, &sent, true);
    assert_eq!((notice(&log, "index-differs").count, notice(&log, "incomplete-recording").count), (1, 1));
}

#[test]
fn progress_adds_up_to_the_bag_and_its_write_ahead_log() {
    let read = std::sync::atomic::AtomicU64::new(0);
    let on_bytes = |bytes| {
        read.fetch_add(bytes, std::sync::atomic::Ordering::Relaxed);
    };
    let cancel = std::sync::atomic::AtomicBool::new(false);
    let context = ingest::ReadContext { limits: Limits::default(), cancel: &cancel, on_bytes: &on_bytes };
    let progress = |bag: PathBuf| {
        ingest::read_files(ingest::LogKind::Db3, &[bag], &|_: &TopicInfo| Selection::Skip, &context).unwrap();
        read.swap(0, std::sync::atomic::Ordering::Relaxed)
    };
    // More than a MiB is reported in parts.
    for images in [100, 200_000] {
        let content = bag(&flight(5), images, "");
        assert_eq!(progress(OnDisk::new(&content, false).path()), content.len() as u64);
    }
    let folder = tempfile::tempdir().unwrap();
    let bag = killed(folder.path(), &flight(60));
    let size_of = |name: &str| fs::metadata(folder.path().join(name)).unwrap().len();
    assert_eq!(progress(bag), size_of("bag.db3") + size_of("bag.db3-wal"));
}

#[test]
fn a_reader_stops_on_request() {
    let disk = OnDisk::new(&bag(&flight(400), 20_000, ""), false);
    let cancel = std::sync::atomic::AtomicBool::new(false);
    let stop = |_| cancel.store(true, std::sync::atomic::Ordering::Relaxed);
    let context = ingest::ReadContext { limits: Limits::default(), cancel: &cancel, on_bytes: &stop };
    let result = ingest::read_files(ingest::LogKind::Db3, &[disk.path()], &|_: &TopicInfo| Selection::All, &context);
    assert!(matches!(result, Err(LogError::Read(ScanError::Cancelled))));
}

#[test]
fn real_bags_have_the_messages_and_values_that_python_reads() {
    // rosbags 0.11.9, AnyReader with the types of ROS 2 Foxy, and math.fsum.
    let alfa = ["alfa_db3", "alfa_db3_msgzstd", "alfa_db3_filezstd"].map(|name| format!("derived-alfa/{name}"));
    for folder in alfa {
        let Some(path) = real_logs(&folder) else { continue };
        let log = whole(&discovered(&path));
        assert!(!lost(&log));
        assert_eq!(log.health.messages, 2196);
        let fix = log.tables.iter().find(|t| t.topic.name == "/mavros/global_position/raw/fix").unwrap();
        assert_eq!(crate::made::sum(fix, "latitude"), (662, 26_871.748_662_5));
        assert_eq!(crate::made::sum(fix, "position_covariance[8]"), (662, 951.038_346_605_160_1));
        assert_eq!(crate::made::whole_sum(fix, "header.stamp"), 1_014_146_846_606_356_856_315);
    }
    // One of 2020, without definitions, with an empty write-ahead log next to it.
    let Some(path) = real_logs("PlotJuggler/datasamples/rosbag2_test") else { return };
    let found = discover(&path, &MapLibrary::shipped().unwrap()).unwrap();
    let log = whole(&found.units[0]);
    assert!(!lost(&log) && log.health.messages == 4695);
    let table = |topic: &str| log.tables.iter().find(|t| t.topic.name == topic).unwrap();
    assert_eq!(crate::made::sum(table("/imu"), "angular_velocity.z"), (1565, 208_145.0));
    assert_eq!(crate::made::sum(table("/imu"), "orientation.y"), (1565, 175_280.0));
    assert_eq!(crate::made::whole_sum(table("/imu"), "header.stamp"), 2_486_022_694_861_769_984_797);
    assert_eq!(crate::made::sum(table("/pose"), "pose.position.x"), (1565, -0.235_530_402_764_092_65));
    assert_eq!(crate::made::sum(table("/battery"), "voltage"), (1565, -4.986_199_341_989_05));
}

#[test]
fn a_flipped_bit_loses_no_message_silently() {
    let sent = flight(12);
    let content = bag(&sent, 500, "PRAGMA page_size=512");
    let disk = OnDisk::new(&content, false);
    for bit in (0..content.len() * 8).step_by(101) {
        let at = bit / 8;
        disk.write_at(at as u64, &[content[at] ^ 1 << (bit % 8)]);
        if let Ok(log) = read_files(&[disk.path()]) {
            // Without checksums a changed value or topic name can go undetected. No row may be lost.
            assert!(log.health.messages >= 36 || lost(&log), "bit {bit}: {:?}", log.health);
            assert!(log.health.messages <= 36, "bit {bit}");
        }
        disk.write_at(at as u64, &[content[at]]);
    }
}
