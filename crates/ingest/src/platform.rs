//! What operating systems do in their own way: reading at a place, and telling whether two names are one file. The only
//! file of this crate that may name one of them.

use std::fs::File;
use std::io;
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

/// Reads into `buffer` from `offset`, whatever was read before; gives how much.
#[cfg(unix)]
pub(crate) fn read_at(file: &File, buffer: &mut [u8], offset: u64) -> io::Result<usize> {
    std::os::unix::fs::FileExt::read_at(file, buffer, offset)
}

/// Reads into `buffer` from `offset`; gives how much. Only reads by position are made of these files.
#[cfg(windows)]
pub(crate) fn read_at(file: &File, buffer: &mut [u8], offset: u64) -> io::Result<usize> {
    std::os::windows::fs::FileExt::seek_read(file, buffer, offset)
}

/// Fills `buffer` from `offset`.
///
/// # Errors
/// The file cannot be read, or ends before.
pub(crate) fn read_exact_at(file: &File, mut buffer: &mut [u8], mut offset: u64) -> io::Result<()> {
    while !buffer.is_empty() {
        match read_at(file, buffer, offset) {
            Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(read) => {
                buffer = buffer.get_mut(read..).unwrap_or_default();
                offset += read as u64;
            }
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
    Ok(())
}
