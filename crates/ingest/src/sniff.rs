//! What a file is, by its first bytes; the name only helps where they do not decide.

use crate::discover::LogKind;
use crate::format::looks_like_table;
use crate::reader::ReadContext;
use std::path::Path;

/// Bytes that are looked at.
pub(crate) const HEAD: usize = 64 << 10;

/// A log that we read, or what the file is instead.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Content {
    /// A format that keeps its topics apart.
    Log(LogKind),
    /// A text table; `flysight2` if it names its topics itself.
    Table { flysight2: bool },
    /// Why it is no flight.
    Other(String),
}

/// First bytes of logs.
const LOGS: &[(&[u8], LogKind)] = &[
    (b"\x89MCAP0\r\n", LogKind::Mcap),
    (b"#ROSBAG V", LogKind::Bag),
    (b"ULog\x01\x12\x35", LogKind::Ulog),
    (b"\xa3\x95\x80", LogKind::DataFlash),
    (b"FMT, 128, 89, FMT", LogKind::DataFlash),
    (b"SQLite format 3\0", LogKind::Db3),
    (b"\xb5\x62", LogKind::Ubx),
];

/// Endings of logs: what has one stays a log where its first bytes are damaged.
const ENDINGS: &[(&str, LogKind)] = &[
    ("mcap", LogKind::Mcap),
    ("bag", LogKind::Bag),
    ("active", LogKind::Bag),
    ("ulg", LogKind::Ulog),
    ("ulog", LogKind::Ulog),
    ("db3", LogKind::Db3),
    ("tlog", LogKind::Tlog),
    ("ubx", LogKind::Ubx),
    ("nmea", LogKind::Nmea),
];

/// First bytes, and what they mean for us.
const MAGIC: &[(&[u8], &str)] = &[
    (b"PK\x03\x04", "ZIP archive; unpack it first"),
    (b"\x1f\x8b", "gzip file; unpack it first"),
    (b"\x28\xb5\x2f\xfd", "Zstandard file; unpack it first"),
    (b"BZh", "bzip2 file; unpack it first"),
    (b"\xfd7zXZ\0", "xz file; unpack it first"),
    (b"version https://git-lfs", "Git-LFS pointer, not the log itself; fetch it with git lfs pull"),
    (b"<!DOCTYPE html", "HTML page, not a log"),
    (b"<html", "HTML page, not a log"),
    (b"<?xml", "XML, not a log"),
    (b"%PDF", "PDF, not a log"),
    (b"\x89PNG", "PNG image, not a log"),
];

/// Endings of text files that are no logs even where they hold a table.
const NO_LOG: &[&str] = &[
    "c", "cfg", "cpp", "css", "h", "htm", "html", "ini", "ipynb", "js", "json", "lock", "m", "md", "params", "py",
    "rs", "rst", "sh", "svg", "toml", "xml", "yaml", "yml",
];

/// Says what a file is. One with the ending of a log stays a log, so that its damage is reported.
pub(crate) fn content_of(path: &Path, head: &[u8], context: &ReadContext<'_>) -> Content {
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    if let Some((_, kind)) = LOGS.iter().find(|(magic, _)| head.starts_with(magic)) {
        return Content::Log(*kind);
    }
    if let Some((_, what)) = MAGIC.iter().find(|(magic, _)| head.starts_with(magic)) {
        return Content::Other((*what).to_owned());
    }
    if let Some((_, kind)) = ENDINGS.iter().find(|(e, _)| *e == ending) {
        return Content::Log(*kind);
    }
    match ending.as_str() {
        "csv" => Content::Table { flysight2: head.starts_with(b"$FLYS") },
        _ if NO_LOG.contains(&ending.as_str()) => Content::Other(format!("a .{ending} file, not a log")),
        _ if head.is_empty() => Content::Other("empty file".into()),
        _ if memchr::memchr(0, head).is_some() => Content::Other("binary file of an unknown format".into()),
        _ => match looks_like_table(head, context) {
            Ok(()) => Content::Table { flysight2: head.starts_with(b"$FLYS") },
            Err(what) => Content::Other(format!("text, but {what}")),
        },
    }
}
