//! What is never overwritten: the log itself, and anything that is not a regular file.

use crate::error::ConvertError;
use ingest::{IngestError, LogError, ScanError};
use std::fs::{self, Metadata};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Whether `path` may be written: it is absent, or a regular file that is not part of `log` under any name or link.
///
/// # Errors
/// [`ConvertError::Refused`], or the system denies access.
pub(crate) fn may_write(path: &Path, log: &[PathBuf]) -> Result<(), ConvertError> {
    let refused = |what: &str| Err(ConvertError::Refused { path: path.to_owned(), what: what.to_owned() });
    match fs::symlink_metadata(path) {
        Err(e) if e.kind() == ErrorKind::NotFound => return Ok(()),
        Err(e) => return Err(ConvertError::write(path, "read the status of")(e)),
        Ok(_) => {}
    }
    match fs::metadata(path) {
        Err(_) => refused("a broken link; name another output"),
        Ok(about) if about.is_dir() => refused("a folder; name another output"),
        Ok(about) if !about.is_file() => refused("a device, a pipe or a socket; only a plain file is overwritten"),
        Ok(about) if is_of(path, &about, log) => refused(LOG),
        Ok(_) => Ok(()),
    }
}

const LOG: &str = "a file of the log itself, which flightlag never changes; name another output";

/// Whether a path is one of the log's files.
pub(crate) fn is_of_log(path: &Path, log: &[PathBuf]) -> bool {
    fs::metadata(path).is_ok_and(|about| is_of(path, &about, log))
}

fn is_of(path: &Path, about: &Metadata, log: &[PathBuf]) -> bool {
    let same = |file: &Path| fs::metadata(file).is_ok_and(|other| is_same((path, about), (file, &other)));
    log.iter().any(|file| same(file) || sidecars(file).any(|file| same(&file)))
}

/// The files that SQLite keeps next to a database and reads with it.
fn sidecars(file: &Path) -> impl Iterator<Item = PathBuf> {
    ["-wal", "-shm", "-journal"].into_iter().map(|end| {
        let mut name = file.as_os_str().to_owned();
        name.push(end);
        PathBuf::from(name)
    })
}

/// Metadata of the log's files, taken before they are read.
pub(crate) struct Unchanged {
    files: Vec<(PathBuf, Description)>,
}

/// Size, modification time, and where available the inode number and change time.
type Description = (u64, Option<std::time::SystemTime>, (u64, i64, i64));

impl Unchanged {
    /// Takes the metadata of the files.
    pub(crate) fn of(files: &[PathBuf]) -> Result<Unchanged, ConvertError> {
        let look = |path: &PathBuf| {
            Ok((
                path.clone(),
                description(path).map_err(ConvertError::write(
                    path,
                    "read the status \
                of",
                ))?,
            ))
        };
        Ok(Unchanged { files: files.iter().map(look).collect::<Result<_, ConvertError>>()? })
    }

    /// Rejects files that changed: what was read may be a mixture of two versions.
    pub(crate) fn check(&self) -> Result<(), ConvertError> {
        let changed = self.files.iter().find(|(path, before)| description(path).ok().as_ref() != Some(before));
        match changed {
            Some((path, _)) => {
                Err(IngestError::Log(LogError::Read(ScanError::Changed { file: path.display().to_string() })).into())
            }
            None => Ok(()),
        }
    }
}

fn description(path: &Path) -> std::io::Result<Description> {
    let about = fs::metadata(path)?;
    Ok((about.len(), about.modified().ok(), entry(&about)))
}

#[cfg(unix)]
fn entry(about: &Metadata) -> (u64, i64, i64) {
    use std::os::unix::fs::MetadataExt;
    (about.ino(), about.ctime(), about.ctime_nsec())
}

#[cfg(not(unix))]
fn entry(_about: &Metadata) -> (u64, i64, i64) {
    (0, 0, 0)
}

/// Whether both are the same file, through whatever links.
#[cfg(unix)]
fn is_same((_, a): (&Path, &Metadata), (_, b): (&Path, &Metadata)) -> bool {
    use std::os::unix::fs::MetadataExt;
    (a.dev(), a.ino()) == (b.dev(), b.ino())
}

#[cfg(not(unix))]
fn is_same((a, _): (&Path, &Metadata), (b, _): (&Path, &Metadata)) -> bool {
    a.canonicalize().is_ok_and(|a| b.canonicalize().is_ok_and(|b| a == b))
}
