//! The system calls that the store uses to put a file in place. Tests insert a recorder.

use std::error::Error;
use std::fmt;
use std::fs::{self, File};
use std::io;
use std::path::Path;

/// Creates, syncs and renames.
pub(crate) trait Disk: fmt::Debug + Send + Sync {
    /// Creates a file that does not exist yet.
    fn create(&self, path: &Path) -> io::Result<File>;
    /// Waits until the content of a file is on the disk.
    fn sync(&self, file: &File, path: &Path) -> io::Result<()>;
    /// Gives a file its final name, atomically replacing an earlier file of that name.
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()>;
    /// Waits until the names in a folder are on the disk.
    fn sync_folder(&self, path: &Path) -> io::Result<()>;
}

/// Whether a system error may be temporary: a full or unavailable disk, but not a missing permission. Examines wrapped
/// errors too, because libraries wrap system errors in their own.
#[must_use]
pub fn may_heal(error: &io::Error) -> bool {
    let mut chain = std::iter::successors(Some(error as &(dyn Error + 'static)), |e| inside(*e));
    chain.any(|e| e.downcast_ref::<io::Error>().is_some_and(is_passing))
}

/// The error inside an error.
fn inside<'a>(error: &'a (dyn Error + 'static)) -> Option<&'a (dyn Error + 'static)> {
    match error.downcast_ref::<io::Error>() {
        Some(error) => error.get_ref().map(|inner| inner as &(dyn Error + 'static)),
        None => error.source(),
    }
}

fn is_passing(error: &io::Error) -> bool {
    use io::ErrorKind::{
        HostUnreachable, NetworkDown, NetworkUnreachable, NotConnected, QuotaExceeded, ResourceBusy,
        StaleNetworkFileHandle, StorageFull, TimedOut,
    };
    let kinds = [
        HostUnreachable,
        NetworkDown,
        NetworkUnreachable,
        NotConnected,
        QuotaExceeded,
        ResourceBusy,
        StaleNetworkFileHandle,
        StorageFull,
        TimedOut,
    ];
    kinds.contains(&error.kind()) || is_input_output_error(error)
}

#[cfg(unix)]
fn is_input_output_error(error: &io::Error) -> bool {
    error.raw_os_error() == Some(5)
}

#[cfg(not(unix))]
fn is_input_output_error(_error: &io::Error) -> bool {
    false
}

/// The disk of a newly opened store. Tests replace it with a faulty one.
#[cfg(not(test))]
pub(crate) fn disk() -> Box<dyn Disk> {
    Box::new(System)
}
#[cfg(test)]
pub(crate) use crate::engine_tests::faults::disk;

/// The operating system.
#[derive(Debug, Clone, Copy)]
pub(crate) struct System;

impl Disk for System {
    fn create(&self, path: &Path) -> io::Result<File> {
        File::create_new(path)
    }

    fn sync(&self, file: &File, _path: &Path) -> io::Result<()> {
        file.sync_all()
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        fs::rename(from, to)
    }

    #[cfg(unix)]
    fn sync_folder(&self, path: &Path) -> io::Result<()> {
        // Some network file systems cannot sync a folder. They write its names immediately.
        let unsupported = |e: &io::Error| matches!(e.kind(), io::ErrorKind::InvalidInput | io::ErrorKind::Unsupported);
        match File::open(path)?.sync_all() {
            Err(e) if !unsupported(&e) => Err(e),
            _ => Ok(()),
        }
    }

    /// Other systems cannot open a folder; they keep the order of names themselves.
    #[cfg(not(unix))]
    fn sync_folder(&self, _path: &Path) -> io::Result<()> {
        Ok(())
    }
}
