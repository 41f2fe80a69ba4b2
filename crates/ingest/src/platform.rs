//! Platform-specific code: whether two names are the same file. The only file of this crate that may name an operating
//! system.

use std::path::Path;

/// Equal for all names of a file.
#[cfg(unix)]
pub(crate) type FileIdentity = (u64, u64);
/// Equal for every symbolic link to a file: its canonical path. Hard links count as separate files here.
#[cfg(not(unix))]
pub(crate) type FileIdentity = std::path::PathBuf;

/// `None` for a file that cannot be examined.
#[cfg(unix)]
pub(crate) fn identity(path: &Path) -> Option<FileIdentity> {
    use std::os::unix::fs::MetadataExt;
    std::fs::metadata(path).ok().map(|m| (m.dev(), m.ino()))
}

#[cfg(not(unix))]
pub(crate) fn identity(path: &Path) -> Option<FileIdentity> {
    path.canonicalize().ok()
}
