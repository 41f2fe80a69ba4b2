//! Detects what a file is from its first bytes; the name only helps if these are inconclusive.

use crate::format::{
    Packing, looks_like_dataflash, looks_like_nmea, looks_like_table, looks_like_tlog, looks_like_ubx, named_text,
};
use crate::reader::ReadContext;
use std::path::Path;

/// A supported format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LogKind {
    /// Text tables.
    Csv,
    /// MCAP.
    Mcap,
    /// ROS 1 bag.
    Bag,
    /// PX4 ULog.
    Ulog,
    /// ArduPilot DataFlash, binary or text.
    DataFlash,
    /// MAVLink telemetry log.
    Tlog,
    /// ROS 2 bag in SQLite.
    Db3,
    /// NMEA 0183 sentences.
    Nmea,
    /// u-blox binary.
    Ubx,
}

/// The number of bytes examined.
pub const HEAD: usize = 64 << 10;

/// A log that we can read, or what the file is instead.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Content {
    /// A format that separates its topics.
    Log(LogKind),
    /// A text table.
    Table {
        /// It names its topics itself.
        flysight2: bool,
        /// A header names its columns.
        named: bool,
    },
    /// Packed: the content decides.
    Packed(Packing),
    /// Why it is not a flight.
    Other(String),
}

/// First bytes of logs.
const LOGS: &[(&[u8], LogKind)] = &[
    (b"\x89MCAP0\r\n", LogKind::Mcap),
    (b"#ROSBAG V", LogKind::Bag),
    (b"ULog\x01\x12\x35", LogKind::Ulog),
    (b"\xa3\x95", LogKind::DataFlash),
    (b"FMT, 128, 89, FMT", LogKind::DataFlash),
    (b"SQLite format 3\0", LogKind::Db3),
    (b"\xb5\x62", LogKind::Ubx),
];

/// File name extensions of logs: with one, a file stays a log even if its first bytes are damaged.
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
    ("nma", LogKind::Nmea),
];

/// First bytes of other files, with the reason for not reading them.
const MAGIC: &[(&[u8], &str)] = &[
    (b"\xfd7zXZ\0", "xz file; unpack it first"),
    (b"7z\xbc\xaf\x27\x1c", "7-Zip archive; unpack it first"),
    (b"\x93NUMPY", "NumPy array; logs of NumPy files are not supported"),
    (b"version https://git-lfs", "Git LFS pointer, not the log itself; fetch the log with git lfs pull"),
    (b"<!DOCTYPE html", "HTML page, not a log"),
    (b"<html", "HTML page, not a log"),
    (b"<?xml", "XML, not a log"),
    (b"%PDF", "PDF, not a log"),
    (b"\x89PNG", "PNG image, not a log"),
];

/// Extensions of text files that are not logs even if they contain a table.
const NO_LOG: &[&str] = &[
    "c", "cfg", "cpp", "css", "h", "htm", "html", "ini", "ipynb", "js", "json", "lock", "m", "md", "params", "py",
    "rs", "rst", "sh", "svg", "toml", "xml", "yaml", "yml",
];

/// Detects what a file is. One with the extension of a log stays a log, so that its damage is reported.
pub fn content_of(path: &Path, head: &[u8], context: &ReadContext<'_>) -> Content {
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    if let Some((_, kind)) = LOGS.iter().find(|(magic, _)| head.starts_with(magic)) {
        return Content::Log(*kind);
    }
    if let Some((_, what)) = MAGIC.iter().find(|(magic, _)| head.starts_with(magic)) {
        return Content::Other((*what).to_owned());
    }
    if head.get(257..).is_some_and(|rest| rest.starts_with(b"ustar")) {
        return Content::Other("tar archive; unpack it first".to_owned());
    }
    if let Some(packing) = Packing::of(head, named_text(path)) {
        return Content::Packed(packing);
    }
    if let Some((_, kind)) = ENDINGS.iter().find(|(e, _)| *e == ending) {
        // A receiver may mix both, and the UBX reader handles both.
        let mixed = *kind == LogKind::Nmea && looks_like_ubx(head);
        return Content::Log(if mixed { LogKind::Ubx } else { *kind });
    }
    match ending.as_str() {
        "csv" => Content::Table { flysight2: head.starts_with(b"$FLYS"), named: true },
        _ if NO_LOG.contains(&ending.as_str()) => Content::Other(format!("a .{ending} file, not a log")),
        _ if looks_like_dataflash(head) => Content::Log(LogKind::DataFlash),
        _ if looks_like_tlog(head) => Content::Log(LogKind::Tlog),
        _ if looks_like_ubx(head) => Content::Log(LogKind::Ubx),
        _ if looks_like_nmea(head) => Content::Log(LogKind::Nmea),
        _ if head.is_empty() => Content::Other("empty file".into()),
        _ => match looks_like_table(intact(head), context) {
            Ok(named) => Content::Table { flysight2: head.starts_with(b"$FLYS"), named },
            Err(_) if memchr::memchr(0, head).is_some() => Content::Other("binary file of an unknown format".into()),
            Err(what) => Content::Other(format!("text, but {what}")),
        },
    }
}

/// The lines before the first zero byte: those of a table that is damaged later. A few lines prove nothing, because a
/// binary format may start with some text.
fn intact(head: &[u8]) -> &[u8] {
    const FEWEST: usize = 8;
    let Some(zero) = memchr::memchr(0, head) else { return head };
    let text = head.get(..zero).unwrap_or_default();
    let lines = text.get(..memchr::memrchr(b'\n', text).map_or(0, |end| end + 1)).unwrap_or_default();
    if memchr::memchr_iter(b'\n', lines).count() >= FEWEST { lines } else { b"" }
}
