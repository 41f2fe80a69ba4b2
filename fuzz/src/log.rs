//! Targets that read a log.

use crate::Target;
use flight::ByteLedger;
use ingest::{FlightUnit, IngestError, Limits, LogKind, MapLibrary, ReadContext, Select, Selection, TopicInfo};
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;

/// Far below the default, so that a few bytes cannot take a second and a quarter of a gigabyte by asking for them.
const LIMITS: Limits = Limits {
    record_bytes: 16 << 20,
    chunk_bytes: 16 << 20,
    unpacked_bytes: 16 << 20,
    topics: 4096,
    listed_damage: 100,
    line_bytes: 1 << 20,
};

/// Reads all fields of a log of this kind.
pub fn of(kind: LogKind) -> Target {
    let disk = Mutex::new(Disk::new("log.csv"));
    Box::new(move |data| disk.lock().unwrap().read(kind, data, &|_: &TopicInfo| Selection::All))
}

/// What a campaign does with a file: told by its content, read for the shipped maps, bound.
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

/// A file in memory that every input is written to.
struct Disk {
    folder: tempfile::TempDir,
    name: &'static str,
    file: File,
}

impl Disk {
    fn new(name: &'static str) -> Disk {
        let shared = Path::new("/dev/shm");
        let folder = if shared.is_dir() { tempfile::tempdir_in(shared) } else { tempfile::tempdir() };
        let folder = folder.expect("a folder for the input");
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
        let unit = FlightUnit { id: "fuzz".into(), files: vec![self.folder.path().join(self.name)], kind };
        if let Ok(log) = in_context(|context| ingest::open(&unit).read(want, context)) {
            assert_adds_up(&log.health.bytes);
        }
    }
}

fn in_context<T>(read: impl FnOnce(&ReadContext<'_>) -> Result<T, IngestError>) -> Result<T, IngestError> {
    read(&ReadContext { limits: LIMITS, cancel: &AtomicBool::new(false), on_bytes: &|_| () })
}

/// Every byte has one fate.
fn assert_adds_up(bytes: &ByteLedger) {
    assert_eq!(bytes.decoded + bytes.skipped + bytes.structure + bytes.damaged, bytes.size, "{bytes:?}");
}
