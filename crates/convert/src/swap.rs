//! Exchanges the names of two folders in one step, where the system supports it.

use std::io;
use std::path::Path;

/// Gives each of two folders the other's name.
///
/// # Errors
/// One of them cannot be renamed, or the file system does not support the exchange.
#[cfg(target_os = "linux")]
pub(crate) fn exchange(one: &Path, other: &Path) -> io::Result<()> {
    use rustix::fs::{CWD, RenameFlags, renameat_with};
    Ok(renameat_with(CWD, one, CWD, other, RenameFlags::EXCHANGE)?)
}

/// On other systems the standard library offers no such operation.
#[cfg(not(target_os = "linux"))]
pub(crate) fn exchange(_one: &Path, _other: &Path) -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
}
