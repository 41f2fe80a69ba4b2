//! Temporary names for files being written, and cleanup of what killed processes left.
//!
//! A process holds a lock on what it is writing. The system releases it when the process ends, however it ends.

use std::ffi::{OsStr, OsString};
use std::fs::{self, File, OpenOptions};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::SystemTime;

const ENDING: &str = ".flightlag-tmp";

/// The folder that contains a path.
pub(crate) fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// A new temporary name next to `path`, to be renamed to `path`.
pub(crate) fn temporary_name(path: &Path) -> PathBuf {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let salt = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default().subsec_nanos();
    let (count, pid) = (COUNT.fetch_add(1, Ordering::Relaxed), std::process::id());
    let mut name = beginning(path);
    name.push(format!("{pid}-{salt:x}-{count}{ENDING}"));
    path.with_file_name(name)
}

fn beginning(path: &Path) -> OsString {
    let mut name = OsString::from(".");
    name.push(path.file_name().unwrap_or(OsStr::new("out")));
    name.push(".");
    name
}

/// Files next to `path` with names that [`temporary_name`] gives.
pub(crate) fn temporaries_of(path: &Path) -> Vec<PathBuf> {
    let beginning = beginning(path);
    let is_temporary = |name: &OsStr| {
        let (name, beginning) = (name.as_encoded_bytes(), beginning.as_encoded_bytes());
        name.starts_with(beginning) && name.ends_with(ENDING.as_bytes())
    };
    let entries = fs::read_dir(folder_of(path)).into_iter().flatten().flatten();
    entries.filter(|entry| is_temporary(&entry.file_name())).map(|entry| entry.path()).collect()
}

/// Marks the file as being written by this process. Not on systems other than Unix: a lock would block our own readers.
pub(crate) fn claim(file: &File) {
    if cfg!(unix) {
        // Without locks, nothing is treated as a leftover.
        let _ = file.try_lock();
    }
}

/// Whether no process is writing to it any more.
pub(crate) fn is_abandoned(file: &Path) -> bool {
    cfg!(unix) && OpenOptions::new().read(true).write(true).open(file).is_ok_and(|file: File| file.try_lock().is_ok())
}
