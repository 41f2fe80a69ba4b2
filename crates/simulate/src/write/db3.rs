//! ROS 2 bag in SQLite, as rosbag2 writes it: topics, message definitions, messages in order of arrival with an index
//! over their timestamps, and `metadata.yaml` next to it.

use super::{LogFile, Logbook, Topic};
use crate::error::SimulateError;
use flight::Stamp;
use rusqlite::{Connection, MAIN_DB, params};
use std::fmt::Write;

/// Options for writing a ROS 2 bag.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Db3Settings {
    /// Compression.
    pub compression: Db3Compression,
    /// A bare file, or a folder with `metadata.yaml` and a number of files.
    pub layout: Db3Layout,
    /// Whether message definitions are stored, as recorders do since 2023.
    pub definitions: bool,
}

/// Compression of a ROS 2 bag.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Db3Compression {
    /// Nothing.
    None,
    /// Each message individually with Zstandard.
    ZstdMessages,
    /// Each file as a whole with Zstandard.
    ZstdFile,
}

/// Files of the bag.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Db3Layout {
    /// One file, without the recorder's metadata.
    Bare,
    /// A folder with `metadata.yaml` and this many files, consecutive in time.
    Folder(u8),
}

impl Default for Db3Settings {
    /// As `ros2 bag record -s sqlite3` writes: a folder with one uncompressed file.
    fn default() -> Db3Settings {
        Db3Settings { compression: Db3Compression::None, layout: Db3Layout::Folder(1), definitions: true }
    }
}

/// As `rosbag2_storage_sqlite3` creates them, schema version 4.
const TABLES: &str = "CREATE TABLE schema(schema_version INTEGER PRIMARY KEY,ros_distro TEXT NOT NULL);\
    CREATE TABLE metadata(id INTEGER PRIMARY KEY,metadata_version INTEGER NOT NULL,metadata TEXT NOT NULL);\
    CREATE TABLE topics(id INTEGER PRIMARY KEY,name TEXT NOT NULL,type TEXT NOT NULL,\
    serialization_format TEXT NOT NULL,offered_qos_profiles TEXT NOT NULL,type_description_hash TEXT NOT NULL);\
    CREATE TABLE messages(id INTEGER PRIMARY KEY,topic_id INTEGER NOT NULL,timestamp INTEGER NOT NULL, data BLOB NOT NULL);\
    CREATE INDEX timestamp_idx ON messages (timestamp ASC);\
    INSERT INTO schema VALUES (4,'jazzy');";
/// Missing from recorders before 2023.
const DEFINITIONS: &str = "CREATE TABLE message_definitions(id INTEGER PRIMARY KEY,topic_type TEXT NOT NULL,\
    encoding TEXT NOT NULL,encoded_message_definition TEXT NOT NULL,type_description_hash TEXT NOT NULL);";
const LEVEL: i32 = 1;

impl Db3Settings {
    fn ending(self) -> &'static str {
        match self.compression {
            Db3Compression::ZstdFile => "db3.zstd",
            Db3Compression::None | Db3Compression::ZstdMessages => "db3",
        }
    }

    /// Paths of the data; `stem` is that of the flight.
    pub(super) fn paths(self, stem: &str) -> Vec<String> {
        let name = stem.rsplit('/').next().unwrap_or(stem);
        match self.layout {
            Db3Layout::Bare => vec![format!("{stem}.{}", self.ending())],
            Db3Layout::Folder(files) => {
                (0..files.max(1)).map(|i| format!("{stem}/{name}_{i}.{}", self.ending())).collect()
            }
        }
    }
}

pub(super) fn write(log: &Logbook, stem: &str, settings: Db3Settings) -> Result<Vec<LogFile>, SimulateError> {
    let paths = settings.paths(stem);
    let share = log.messages.len().div_ceil(paths.len()).max(1);
    let mut files = vec![];
    for (index, path) in paths.iter().enumerate() {
        let messages = log.messages.iter().skip(index * share).take(share);
        let bytes = database(&log.topics, messages, settings)?;
        let bytes = if settings.compression == Db3Compression::ZstdFile { packed(&bytes)? } else { bytes };
        files.push(LogFile { path: path.into(), bytes });
    }
    if settings.layout != Db3Layout::Bare {
        let bytes = metadata(log, &paths, settings).into_bytes();
        files.push(LogFile { path: format!("{stem}/metadata.yaml").into(), bytes });
    }
    Ok(files)
}

fn packed(bytes: &[u8]) -> Result<Vec<u8>, SimulateError> {
    zstd::bulk::compress(bytes, LEVEL).map_err(|source| SimulateError::Compress { what: "Zstandard", source })
}

fn database<'m>(
    topics: &[Topic],
    messages: impl Iterator<Item = &'m super::message::Message>,
    settings: Db3Settings,
) -> Result<Vec<u8>, SimulateError> {
    let mut connection = Connection::open_in_memory()?;
    connection.execute_batch(TABLES)?;
    let transaction = connection.transaction()?;
    for (index, Topic { name, definition }) in topics.iter().enumerate() {
        let row = params![index as i64 + 1, name, definition.ros2_name()];
        transaction.execute("INSERT INTO topics VALUES (?1,?2,?3,'cdr','','')", row)?;
    }
    if settings.definitions {
        transaction.execute_batch(DEFINITIONS)?;
        for Topic { definition, .. } in topics {
            let row = params![definition.ros2_name(), definition.ros2_text()];
            transaction.execute("INSERT INTO message_definitions VALUES (NULL,?1,'ros2msg',?2,'')", row)?;
        }
    }
    {
        let mut insert = transaction.prepare("INSERT INTO messages (topic_id, timestamp, data) VALUES (?1,?2,?3)")?;
        for message in messages {
            let cdr = message.cdr();
            let data = if settings.compression == Db3Compression::ZstdMessages { packed(&cdr)? } else { cdr };
            insert.execute(params![message.topic as i64 + 1, message.logged.0, data])?;
        }
    }
    transaction.commit()?;
    Ok(connection.serialize(MAIN_DB)?.to_vec())
}

/// The metadata that rosbag2 writes when it closes the bag, version 8.
fn metadata(log: &Logbook, paths: &[String], settings: Db3Settings) -> String {
    let (format, mode) = match settings.compression {
        Db3Compression::None => ("''", "''"),
        Db3Compression::ZstdMessages => ("zstd", "message"),
        Db3Compression::ZstdFile => ("zstd", "file"),
    };
    let first = log.messages.first().map_or(Stamp(0), |m| m.logged);
    let last = log.messages.last().map_or(first, |m| m.logged);
    let mut text = format!(
        "rosbag2_bagfile_information:\n  compression_format: {format}\n  compression_mode: {mode}\n  duration:\n    \
         nanoseconds: {}\n  message_count: {}\n  relative_file_paths:\n",
        last.0 - first.0,
        log.messages.len()
    );
    for path in paths {
        // Writing to a String cannot fail.
        let _ = writeln!(text, "  - {}", path.rsplit('/').next().unwrap_or(path));
    }
    let _ = writeln!(
        text,
        "  starting_time:\n    nanoseconds_since_epoch: {}\n  storage_identifier: sqlite3\n  topics_with_message_count:",
        first.0
    );
    for (index, Topic { name, definition }) in log.topics.iter().enumerate() {
        let count = log.messages.iter().filter(|message| message.topic == index).count();
        let _ = writeln!(
            text,
            "  - message_count: {count}\n    topic_metadata:\n      name: {name}\n      offered_qos_profiles: ''\n      \
             serialization_format: cdr\n      type: {}",
            definition.ros2_name()
        );
    }
    text + "  version: 8\n"
}
