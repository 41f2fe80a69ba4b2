//! What operating systems do in their own way: telling whether two names are one file. The only file of this crate that may
//! name one of them.

use std::path::Path;

/// What is the same for every name that a file has.
#[cfg(unix)]
pub(crate) type FileIdentity = (u64, u64);
/// What is the same for every link to a file: its canonical path. Hard links are files of their own here.
#[cfg(not(unix))]
pub(crate) type FileIdentity = std::path::PathBuf;

/// `None` for a file that cannot be looked at.
#[cfg(unix)]
pub(crate) fn identity(path: &Path) -> Option<FileIdentity> {
    use std::os::unix::fs::MetadataExt;
    std::fs::metadata(path).ok().map(|m| (m.dev(), m.ino()))
}

#[cfg(not(unix))]
pub(crate) fn identity(path: &Path) -> Option<FileIdentity> {
    path.canonicalize().ok()
}
