//! What a file is, by its first bytes; the name only helps where they do not decide.

use crate::format::looks_like_table;
use crate::reader::ReadContext;
use std::path::Path;

/// Bytes that are looked at.
pub(crate) const HEAD: usize = 64 << 10;

/// A log that we read, or what the file is instead.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Content {
    Mcap,
    Bag,
    /// A text table; `flysight2` if it names its topics itself.
    Table {
        flysight2: bool,
    },
    /// Why it is no flight.
    Other(String),
}

/// First bytes, and what they mean for us.
const MAGIC: &[(&[u8], &str)] = &[
    (b"ULog\x01\x12\x35", "PX4 ULog, a format that is not read yet; ulog2csv makes tables of it that are"),
    (b"\xa3\x95\x80\x59", "ArduPilot DataFlash log, a format that is not read yet"),
    (b"SQLite format 3\0", "SQLite database (rosbag2 db3), a format that is not read yet"),
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
    if head.starts_with(b"\x89MCAP0\r\n") {
        return Content::Mcap;
    }
    if head.starts_with(b"#ROSBAG V") {
        return Content::Bag;
    }
    if let Some((_, what)) = MAGIC.iter().find(|(magic, _)| head.starts_with(magic)) {
        return Content::Other((*what).to_owned());
    }
    match ending.as_str() {
        "mcap" => Content::Mcap,
        "bag" | "active" => Content::Bag,
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
