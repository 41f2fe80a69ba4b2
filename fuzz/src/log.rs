//! Targets that read a log.

use crate::Target;
use flight::ByteLedger;
use ingest::{FlightUnit, Limits, LogKind, MapLibrary, ReadContext, Select, Selection, TopicInfo};
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;

/// Far below the default, so that a few bytes cannot take a second and a quarter of a gigabyte by requesting them.
fn limits() -> Limits {
    Limits {
        record_bytes: 16 << 20,
        chunk_bytes: 16 << 20,
        unpacked_bytes: 16 << 20,
        topics: 4096,
        ..Limits::default()
    }
}

/// Reads all fields of a log of this kind.
pub fn of(kind: LogKind) -> Target {
    let disk = Mutex::new(Disk::new("log.csv"));
    Box::new(move |data| disk.lock().unwrap().read(kind, data, &|_: &TopicInfo| Selection::All))
}

/// Reads a ROS 2 bag with its accompanying files: length of the metadata, metadata, length of the database, database,
/// its write-ahead log.
pub fn bag_folder() -> Target {
    let folder = scratch();
    let unit = FlightUnit {
        id: "fuzz".into(),
        files: ["metadata.yaml", "log.db3"].map(|name| folder.path().join(name)).into(),
        kind: LogKind::Db3,
    };
    let in_turn = Mutex::new(folder);
    Box::new(move |data| {
        let folder = in_turn.lock().unwrap();
        let mut rest = data;
        for (name, width) in [("metadata.yaml", 2), ("log.db3", 4), ("log.db3-wal", 0)] {
            let (length, tail) = rest.split_at(width.min(rest.len()));
            let length = length.iter().rev().fold(0, |length, &byte| length << 8 | usize::from(byte));
            let (content, tail) = tail.split_at(if width == 0 { tail.len() } else { length.min(tail.len()) });
            std::fs::write(folder.path().join(name), content).expect("room for the input");
            rest = tail;
        }
        read(&unit, &|_: &TopicInfo| Selection::All);
    })
}

/// What a campaign does with a file: detected by content, read for the shipped maps, bound.
pub fn whole() -> Target {
    let disk = Mutex::new(Disk::new("log"));
    let library = MapLibrary::shipped().expect("the shipped maps are sound");
    Box::new(move |data| {
        let disk = disk.lock().unwrap();
        disk.write(data);
        let path = disk.folder.path().join(disk.name);
        for unit in ingest::discover(&path, &library).expect("the file is there").units {
            if let Ok(loaded) = in_context(|context| ingest::load(&unit, &library, None, context)) {
                assert_adds_up(&loaded.health.bytes);
            }
        }
    })
}

/// Reads a message by a definition: encoding, length of the definition, definition, payload.
pub fn definition() -> Target {
    let disk = Mutex::new(Disk::new("log.mcap"));
    Box::new(move |data| {
        let [encoding, low, high, rest @ ..] = data else { return };
        let (text, payload) = rest.split_at(usize::from(u16::from_le_bytes([*low, *high])).min(rest.len()));
        const ENCODINGS: [[&str; 2]; 5] = [
            ["ros1msg", "ros1"],
            ["ros2msg", "cdr"],
            ["ros2idl", "cdr"],
            ["protobuf", "protobuf"],
            ["jsonschema", "json"],
        ];
        let [schema, message] = ENCODINGS[usize::from(*encoding) % ENCODINGS.len()];
        let bytes = mcap_of(schema, message, text, payload);
        disk.lock().unwrap().read(LogKind::Mcap, &bytes, &|_: &TopicInfo| Selection::All);
    })
}

/// An MCAP of one schema, one channel and one message.
fn mcap_of(schema: &str, message: &str, definition: &[u8], payload: &[u8]) -> Vec<u8> {
    let sized = |bytes: &[u8]| [&(bytes.len() as u32).to_le_bytes(), bytes].concat();
    let record = |opcode: u8, content: &[u8]| [&[opcode][..], &(content.len() as u64).to_le_bytes(), content].concat();
    let one = &1_u16.to_le_bytes()[..];
    let schema = [one, &sized(b"test_msgs/msg/Fix"), &sized(schema.as_bytes()), &sized(definition)].concat();
    let channel = [one, one, &sized(b"/topic"), &sized(message.as_bytes()), &[0; 4]].concat();
    let sent = [one, &[0; 20], payload].concat();
    let magic = b"\x89MCAP0\r\n";
    [magic, &record(1, &[0; 8])[..], &record(3, &schema), &record(4, &channel), &record(5, &sent), magic].concat()
}

/// A file in memory to which every input is written.
struct Disk {
    folder: tempfile::TempDir,
    name: &'static str,
    file: File,
}

impl Disk {
    fn new(name: &'static str) -> Disk {
        let folder = scratch();
        let file = File::create(folder.path().join(name)).expect("a file for the input");
        Disk { folder, name, file }
    }

    fn write(&self, data: &[u8]) {
        self.file
            .set_len(data.len() as u64)
            .and_then(|()| self.file.write_all_at(data, 0))
            .expect("room for the input");
    }

    fn read(&self, kind: LogKind, data: &[u8], want: &dyn Select) {
        self.write(data);
        read(&FlightUnit { id: "fuzz".into(), files: vec![self.folder.path().join(self.name)], kind }, want);
    }
}

/// A folder in memory, if available.
fn scratch() -> tempfile::TempDir {
    let shared = Path::new("/dev/shm");
    let folder = if shared.is_dir() { tempfile::tempdir_in(shared) } else { tempfile::tempdir() };
    folder.expect("a folder for the input")
}

fn read(unit: &FlightUnit, want: &dyn Select) {
    if let Ok(log) = in_context(|context| ingest::read(unit, want, context)) {
        assert_adds_up(&log.health.bytes);
    }
}

fn in_context<T>(read: impl FnOnce(&ReadContext<'_>) -> T) -> T {
    read(&ReadContext { limits: limits(), cancel: &AtomicBool::new(false), on_bytes: &|_| () })
}

/// Every byte has one fate.
fn assert_adds_up(bytes: &ByteLedger) {
    assert_eq!(bytes.sum(), bytes.size, "{bytes:?}");
}
