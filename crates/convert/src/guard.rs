//! What is never written over: the log itself, and whatever is no plain file.

use crate::error::ConvertError;
use std::fs::{self, Metadata};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Whether `path` may be written: it is absent, or a plain file that is none of `log`, by whatever name or link.
///
/// # Errors
/// [`ConvertError::Refused`], or that the system does not let us look.
pub(crate) fn may_write(path: &Path, log: &[PathBuf]) -> Result<(), ConvertError> {
    let refused = |what: &str| Err(ConvertError::Refused { path: path.to_owned(), what: what.to_owned() });
    match fs::symlink_metadata(path) {
        Err(e) if e.kind() == ErrorKind::NotFound => return Ok(()),
        Err(e) => return Err(ConvertError::write(path, "look at")(e)),
        Ok(_) => {}
    }
    match fs::metadata(path) {
        Err(_) => refused("a link that leads nowhere; name another output"),
        Ok(about) if about.is_dir() => refused("a folder; name another output"),
        Ok(about) if !about.is_file() => refused("a device, a pipe or a socket; only a plain file is written over"),
        Ok(about) if is_of(path, &about, log) => refused(LOG),
        Ok(_) => Ok(()),
    }
}

const LOG: &str = "a file of the log itself, which is only read; name another output";

/// Whether a path is one of the log's files.
pub(crate) fn is_of_log(path: &Path, log: &[PathBuf]) -> bool {
    fs::metadata(path).is_ok_and(|about| is_of(path, &about, log))
}

fn is_of(path: &Path, about: &Metadata, log: &[PathBuf]) -> bool {
    let same = |file: &Path| fs::metadata(file).is_ok_and(|other| is_same((path, about), (file, &other)));
    log.iter().any(|file| same(file) || beside(file).any(|file| same(&file)))
}

/// What SQLite keeps beside a database, and what is read with it.
fn beside(file: &Path) -> impl Iterator<Item = PathBuf> {
    ["-wal", "-shm", "-journal"].into_iter().map(|end| {
        let mut name = file.as_os_str().to_owned();
        name.push(end);
        PathBuf::from(name)
    })
}

/// One file, whatever links lead to it.
#[cfg(unix)]
fn is_same((_, a): (&Path, &Metadata), (_, b): (&Path, &Metadata)) -> bool {
    use std::os::unix::fs::MetadataExt;
    (a.dev(), a.ino()) == (b.dev(), b.ino())
}

#[cfg(not(unix))]
fn is_same((a, _): (&Path, &Metadata), (b, _): (&Path, &Metadata)) -> bool {
    a.canonicalize().is_ok_and(|a| b.canonicalize().is_ok_and(|b| a == b))
}
