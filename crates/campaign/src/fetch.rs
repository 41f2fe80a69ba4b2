//! The logs of a campaign, where readers can open them: in their folder, or as local copies of the objects of a bucket.
//!
//! Readers open local files only. So the logs of a bucket have a local folder with their names and sizes, in which a log is whole
//! while somebody reads it ([`Logs::bring`]).

#[cfg(feature = "s3")]
mod cache;
#[cfg(feature = "s3")]
mod view;

use crate::error::CampaignError;
use crate::memory::FileStamp;
use crate::s3;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::AtomicBool;
use std::time::SystemTime;

/// Where copies of logs that lie in a bucket are kept on this machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LogCache {
    /// Folder; that of the system for such things if it is `None`.
    pub folder: Option<PathBuf>,
    /// Copies that nobody reads are removed, the least recently used first, until the rest has at most this size, bytes.
    pub most_bytes: u64,
}

impl Default for LogCache {
    fn default() -> LogCache {
        LogCache { folder: None, most_bytes: 10_000_000_000 }
    }
}

static CACHE: OnceLock<LogCache> = OnceLock::new();

/// Says where copies of logs are kept, once, before any are read. It is a property of the machine and changes no result.
pub fn keep_logs_in(cache: LogCache) {
    // Said twice, the first counts: logs may be there already.
    let _ = CACHE.set(cache);
}

/// The logs below a folder or an address.
pub(crate) enum Logs {
    /// Readers open them where they are.
    Folder(PathBuf),
    #[cfg(feature = "s3")]
    Bucket(Box<view::View>),
}

impl Logs {
    /// The logs below a path. Of a bucket, all objects are listed.
    pub(crate) fn below(path: &Path) -> Result<Logs, CampaignError> {
        match s3::is_in_bucket(path) {
            false => Ok(Logs::Folder(path.to_owned())),
            #[cfg(feature = "s3")]
            true => Ok(Logs::Bucket(Box::new(view::View::listed(path)?))),
            #[cfg(not(feature = "s3"))]
            true => Err(CampaignError::Asked(format!("{}: {}", path.display(), s3::not_built()))),
        }
    }

    /// Logs whose names a plan knows.
    pub(crate) fn planned(path: &Path) -> Result<Logs, CampaignError> {
        match s3::is_in_bucket(path) {
            #[cfg(feature = "s3")]
            true => Ok(Logs::Bucket(Box::new(view::View::empty(path)?))),
            _ => Logs::below(path),
        }
    }

    /// The local folder or file to look through.
    pub(crate) fn root(&self) -> &Path {
        match self {
            Logs::Folder(root) => root,
            #[cfg(feature = "s3")]
            Logs::Bucket(view) => view.root(),
        }
    }

    /// Gets what is needed to recognise each log: the beginning of its content.
    pub(crate) fn fetch_heads(&self, threads: usize, cancel: &AtomicBool) -> Result<(), CampaignError> {
        match self {
            Logs::Folder(_) => {
                let _ = (threads, cancel);
                Ok(())
            }
            #[cfg(feature = "s3")]
            Logs::Bucket(view) => view.fetch_heads(threads, cancel),
        }
    }

    /// Gives back the room of what [`Logs::fetch_heads`] got.
    pub(crate) fn drop_heads(&self) {
        #[cfg(feature = "s3")]
        if let Logs::Bucket(view) = self {
            view.drop_heads();
        }
    }

    /// Names, sizes and tags of all objects, as text; `None` of a folder.
    pub(crate) fn listing(&self) -> Option<String> {
        match self {
            Logs::Folder(_) => None,
            #[cfg(feature = "s3")]
            Logs::Bucket(view) => Some(view.listing()),
        }
    }

    /// A log as it was when it was looked at last; of a file, as it is now.
    pub(crate) fn stamp(&self, local: &Path) -> io::Result<FileStamp> {
        match self {
            #[cfg(feature = "s3")]
            Logs::Bucket(view) if view.has(local) => view.stamp(local),
            _ => FileStamp::of(local),
        }
    }

    /// A log as it is now.
    pub(crate) fn stamp_now(&self, local: &Path) -> io::Result<FileStamp> {
        match self {
            #[cfg(feature = "s3")]
            Logs::Bucket(view) if view.has(local) => view.stamp_now(local),
            _ => FileStamp::of(local),
        }
    }

    /// When a log was written, if that is known.
    pub(crate) fn modified(&self, local: &Path) -> Option<SystemTime> {
        match self {
            #[cfg(feature = "s3")]
            Logs::Bucket(view) if view.has(local) => view.modified(local),
            _ => std::fs::metadata(local).and_then(|about| about.modified()).ok(),
        }
    }

    /// How people and plans call a local file.
    pub(crate) fn shown(&self, local: &Path) -> PathBuf {
        match self {
            Logs::Folder(_) => local.to_owned(),
            #[cfg(feature = "s3")]
            Logs::Bucket(view) => view.shown(local),
        }
    }

    /// The local file of what is called so.
    pub(crate) fn local(&self, shown: &Path) -> PathBuf {
        match self {
            Logs::Folder(_) => shown.to_owned(),
            #[cfg(feature = "s3")]
            Logs::Bucket(view) => view.local(shown),
        }
    }

    /// A text for people in which a local file may be named.
    pub(crate) fn told(&self, text: String) -> String {
        match self {
            Logs::Folder(_) => text,
            #[cfg(feature = "s3")]
            Logs::Bucket(view) => view.told(&text),
        }
    }

    /// Whether a log that cannot be had now may be had later.
    pub(crate) fn may_heal(&self, error: &io::Error) -> bool {
        match self {
            // It may not be mounted here.
            Logs::Folder(_) => error.kind() != io::ErrorKind::PermissionDenied,
            #[cfg(feature = "s3")]
            Logs::Bucket(_) => crate::disk::may_heal(error),
        }
    }

    /// Makes local files whole, until what is returned goes.
    pub(crate) fn bring(&self, files: &[PathBuf], cancel: &AtomicBool) -> io::Result<Vec<Brought<'_>>> {
        match self {
            Logs::Folder(_) => {
                let _ = (files, cancel);
                Ok(vec![])
            }
            #[cfg(feature = "s3")]
            Logs::Bucket(view) => files.iter().filter(|file| view.has(file)).map(|f| view.bring(f, cancel)).collect(),
        }
    }
}

#[cfg(feature = "s3")]
pub(crate) use view::Brought;

/// A log that is whole; those of a folder always are.
#[cfg(not(feature = "s3"))]
pub(crate) struct Brought<'a>(std::marker::PhantomData<&'a ()>);
