//! Metadata of a file that shows whether its content may have changed.

use serde::{Deserialize, Serialize};
use std::fs::{File, Metadata};
use std::path::Path;
use std::time::{Duration, SystemTime};

/// Metadata of a file. If any field differs, the content may differ.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "(u64, i64, i64, u64)", into = "(u64, i64, i64, u64)")]
pub(crate) struct FileStamp {
    pub(crate) bytes: u64,
    /// Last modification, ns since 1970.
    modified_ns: i64,
    /// Last change of the inode, ns since 1970; zero on systems without it. Copies
    /// that preserve the modification time do not preserve this.
    changed_ns: i64,
    /// Inode number; zero on systems without it.
    number: u64,
}

impl From<(u64, i64, i64, u64)> for FileStamp {
    fn from((bytes, modified_ns, changed_ns, number): (u64, i64, i64, u64)) -> FileStamp {
        FileStamp { bytes, modified_ns, changed_ns, number }
    }
}

impl From<FileStamp> for (u64, i64, i64, u64) {
    fn from(stamp: FileStamp) -> (u64, i64, i64, u64) {
        (stamp.bytes, stamp.modified_ns, stamp.changed_ns, stamp.number)
    }
}

impl FileStamp {
    /// Reads the metadata from the file system.
    pub(crate) fn of(path: &Path) -> std::io::Result<FileStamp> {
        std::fs::metadata(path).map(|found| FileStamp::from_metadata(&found))
    }

    /// Metadata of an object in a bucket: its size, and the tag that the server assigns to each content. Contains no
    /// timestamps: rewriting the same bytes changes nothing, and the bytes cannot change without a new tag.
    #[cfg(feature = "s3")]
    pub(crate) fn of_object(bytes: u64, tag: &str) -> FileStamp {
        let hash = blake3::hash(tag.trim_matches('"').as_bytes());
        let mut parts = hash.as_bytes().chunks_exact(8).map(|part| part.try_into().map_or(0, u64::from_le_bytes));
        let number = parts.next().unwrap_or_default();
        // Negative, so never a timestamp that is too fresh.
        let changed_ns = i64::try_from(parts.next().unwrap_or_default() >> 1).map_or(-1, |n| -1 - n);
        FileStamp { bytes, modified_ns: i64::MIN, changed_ns, number }
    }

    fn from_metadata(found: &Metadata) -> FileStamp {
        let (changed_ns, number) = entry_change(found);
        let modified_ns = found.modified().map(nanos).unwrap_or_default();
        FileStamp { bytes: found.len(), modified_ns, changed_ns, number }
    }

    /// Whether the file could be written again without new timestamps: then they prove nothing, and
    /// the content is read again next time.
    pub(crate) fn is_too_fresh(&self, now: SystemTime) -> bool {
        let latest = self.modified_ns.max(self.changed_ns);
        // Timestamps without fractions of a millisecond come from a file system with a resolution of one or two
        // seconds.
        let tick = if latest % 1_000_000 == 0 { Duration::from_secs(2) } else { Duration::from_millis(50) };
        latest.saturating_add_unsigned(tick.as_nanos() as u64) > nanos(now)
    }
}

#[cfg(unix)]
fn entry_change(found: &Metadata) -> (i64, u64) {
    use std::os::unix::fs::MetadataExt;
    (found.ctime().saturating_mul(1_000_000_000).saturating_add(found.ctime_nsec()), found.ino())
}

#[cfg(not(unix))]
fn entry_change(_found: &Metadata) -> (i64, u64) {
    (0, 0)
}

/// Whether the file at a path is still the one that was opened there. On systems without inode numbers, whether any
/// file is there.
pub(crate) fn is_still_at(file: &File, path: &Path) -> bool {
    let number = |found: std::io::Result<Metadata>| found.map(|found| entry_change(&found).1).ok();
    let opened = number(file.metadata());
    opened.is_some() && opened == number(std::fs::metadata(path))
}

/// Nanoseconds since 1970, saturating in the year 2262.
fn nanos(time: SystemTime) -> i64 {
    let whole = |span: Duration| i64::try_from(span.as_nanos()).unwrap_or(i64::MAX);
    match time.duration_since(SystemTime::UNIX_EPOCH) {
        Ok(after) => whole(after),
        Err(before) => -whole(before.duration()),
    }
}
