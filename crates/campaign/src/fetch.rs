//! The logs of a campaign as local files: in their folder, or as local copies of the objects of a bucket.
//!
//! Readers only open local files. So the logs of a bucket have a local folder with their names and sizes, in which a
//! log has its content while it is being read ([`Logs::bring`]).

#[cfg(feature = "s3")]
mod cache;
#[cfg(feature = "s3")]
mod view;

use crate::error::CampaignError;
use crate::file_stamp::FileStamp;
use crate::s3;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::AtomicBool;
use std::time::SystemTime;

/// Where copies of logs from buckets are kept on this machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LogCache {
    /// Folder; `None` for the cache folder of the system.
    pub folder: Option<PathBuf>,
    /// Maximum size, bytes. Copies not being read are removed, the least recently used first, until the rest fits.
    pub most_bytes: u64,
}

impl Default for LogCache {
    fn default() -> LogCache {
        LogCache { folder: None, most_bytes: 10_000_000_000 }
    }
}

static CACHE: OnceLock<LogCache> = OnceLock::new();

/// Sets where copies of logs are kept. Call once, before any are read. A property of the machine that affects no
/// result.
pub fn keep_logs_in(cache: LogCache) {
    // If called twice, the first counts: logs may exist already.
    let _ = CACHE.set(cache);
}

/// The logs below a folder or an address.
pub(crate) enum Logs {
    /// A local folder: readers open the logs in place.
    Folder(PathBuf),
    #[cfg(feature = "s3")]
    Bucket(Box<view::View>),
}

impl Logs {
    /// The logs below a path. For a bucket, lists all objects.
    pub(crate) fn below(path: &Path) -> Result<Logs, CampaignError> {
        match s3::is_in_bucket(path) {
            false => Ok(Logs::Folder(path.to_owned())),
            #[cfg(feature = "s3")]
            true => Ok(Logs::Bucket(Box::new(view::View::listed(path)?))),
            #[cfg(not(feature = "s3"))]
            true => Err(CampaignError::Asked(format!("{}: {}", path.display(), s3::not_built()))),
        }
    }

    /// Logs with names from a plan.
    pub(crate) fn planned(path: &Path) -> Result<Logs, CampaignError> {
        match s3::is_in_bucket(path) {
            #[cfg(feature = "s3")]
            true => Ok(Logs::Bucket(Box::new(view::View::empty(path)?))),
            _ => Logs::below(path),
        }
    }

    /// The local folder or file to search.
    pub(crate) fn root(&self) -> &Path {
        match self {
            Logs::Folder(root) => root,
            #[cfg(feature = "s3")]
            Logs::Bucket(view) => view.root(),
        }
    }

    /// Fetches what is needed to recognise each log: the start of its content.
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

    /// Frees the disk space of [`Logs::fetch_heads`].
    pub(crate) fn drop_heads(&self) {
        #[cfg(feature = "s3")]
        if let Logs::Bucket(view) = self {
            view.drop_heads();
        }
    }

    /// Names, sizes and tags of all objects, as text; `None` for a folder.
    pub(crate) fn listing(&self) -> Option<String> {
        match self {
            Logs::Folder(_) => None,
            #[cfg(feature = "s3")]
            Logs::Bucket(view) => Some(view.listing()),
        }
    }

    /// Metadata of a log from the last listing; for a local file, the current metadata.
    pub(crate) fn stamp(&self, local: &Path) -> io::Result<FileStamp> {
        match self {
            #[cfg(feature = "s3")]
            Logs::Bucket(view) if view.has(local) => view.stamp(local),
            _ => FileStamp::of(local),
        }
    }

    /// Current metadata of a log.
    pub(crate) fn stamp_now(&self, local: &Path) -> io::Result<FileStamp> {
        match self {
            #[cfg(feature = "s3")]
            Logs::Bucket(view) if view.has(local) => view.stamp_now(local),
            _ => FileStamp::of(local),
        }
    }

    /// Modification time of a log, if known.
    pub(crate) fn modified(&self, local: &Path) -> Option<SystemTime> {
        match self {
            #[cfg(feature = "s3")]
            Logs::Bucket(view) if view.has(local) => view.modified(local),
            _ => std::fs::metadata(local).and_then(|about| about.modified()).ok(),
        }
    }

    /// The displayed name of a local file, which plans also use.
    pub(crate) fn shown(&self, local: &Path) -> PathBuf {
        match self {
            Logs::Folder(_) => local.to_owned(),
            #[cfg(feature = "s3")]
            Logs::Bucket(view) => view.shown(local),
        }
    }

    /// The local file of a displayed name.
    pub(crate) fn local(&self, shown: &Path) -> PathBuf {
        match self {
            Logs::Folder(_) => shown.to_owned(),
            #[cfg(feature = "s3")]
            Logs::Bucket(view) => view.local(shown),
        }
    }

    /// Replaces local file names in a text by displayed names.
    pub(crate) fn with_shown_names(&self, text: String) -> String {
        match self {
            Logs::Folder(_) => text,
            #[cfg(feature = "s3")]
            Logs::Bucket(view) => view.with_shown_names(&text),
        }
    }

    /// Whether an unavailable log may become available later.
    pub(crate) fn may_heal(&self, error: &io::Error) -> bool {
        match self {
            // The folder may not be mounted here.
            Logs::Folder(_) => error.kind() != io::ErrorKind::PermissionDenied,
            #[cfg(feature = "s3")]
            Logs::Bucket(_) => crate::disk::may_heal(error),
        }
    }

    /// Fetches the content of local files, and keeps it until the returned values are dropped.
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

/// A log with its content; those of a folder always have it.
#[cfg(not(feature = "s3"))]
pub(crate) struct Brought<'a>(std::marker::PhantomData<&'a ()>);
