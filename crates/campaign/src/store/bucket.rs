//! Outputs in an S3 bucket.
//!
//! A put is atomic, and durable once it is answered, so that there are neither temporary names nor renames. Some
//! objects must not be overwritten by another writer. They are written under a condition, which the server decides:
//!
//! - the list that completes a result (`files.json`) only if it does not exist: the first writer wins;
//! - the notes on the last run (`state.json`) only over those that this run has read;
//! - the lock (`lock/bucket.rs`) only if it does not exist, or over one of an owner that is gone.
//!
//! Pages, tables and parts of a result are written without a condition: the writer holds the lock, or writes the same
//! bytes. A writer that has lost the lock, or could not renew it, stops writing.
//!
//! A server that ignores conditions would let two runs overwrite each other, and is rejected at the start.

use super::{Fill, Hashing, Keep, Kept, Only, Sink, Storage, StoreError, failed};
use crate::file_stamp::FileStamp;
use crate::process::Process;
use crate::s3::{Bucket, Object, Written};
use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Write};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime};

/// Folder of objects that only test the server.
const PROBES: &str = ".flightlag/probes";

/// An owner that could not renew its lock for this long stops writing. Others wait a minute longer.
const UNSURE: Duration = Duration::from_secs(4 * 60);

/// Outputs below a prefix of a bucket.
#[derive(Debug)]
pub(crate) struct BucketStorage {
    bucket: Bucket,
    /// Tags of the notes as this store last read or wrote them; `None` for a missing one.
    read: Mutex<BTreeMap<String, Option<String>>>,
    fence: Fence,
}

/// Whether the lock is still held; open while no lock is taken.
#[derive(Debug, Clone, Default)]
pub(crate) struct Fence(Arc<Mutex<Option<Renewed>>>);

#[derive(Debug, Clone, Copy)]
enum Renewed {
    At(Instant),
    TakenOver,
}

impl Fence {
    /// The lock was renewed by a request sent at this time.
    pub(crate) fn renew(&self, sent: Instant) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(Renewed::At(sent));
    }

    /// Another run has the lock.
    pub(crate) fn shut(&self) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(Renewed::TakenOver);
    }

    /// The lock was released.
    pub(crate) fn open(&self) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }

    fn check(&self) -> io::Result<()> {
        let what = match *self.0.lock().unwrap_or_else(PoisonError::into_inner) {
            Some(Renewed::TakenOver) => {
                "another flightlag took over this output, because this one was silent for \
                too long"
            }
            Some(Renewed::At(at)) if at.elapsed() > UNSURE => "the lock of this output could not be renewed",
            _ => return Ok(()),
        };
        Err(io::Error::new(io::ErrorKind::ResourceBusy, what))
    }
}

impl BucketStorage {
    /// Opens it, and checks that it is writable and that the server honours conditions.
    pub(super) fn open(root: &Path) -> Result<BucketStorage, StoreError> {
        let bucket = Bucket::of_url(root).map_err(|e| failed(root, "use", e))?;
        let storage = BucketStorage { bucket, read: Mutex::default(), fence: Fence::default() };
        storage.probe().map_err(|e| failed(root, "write to this bucket", e))?;
        Ok(storage)
    }

    fn probe(&self) -> io::Result<()> {
        let name = self.probe_name("probe");
        let first = self.bucket.write(&name, b"one", Written::IfAbsent)?;
        let honoured = first.is_some()
            && self.bucket.write(&name, b"two", Written::IfAbsent)?.is_none()
            && self.bucket.write(&name, b"three", Written::IfTagged("\"0\""))?.is_none();
        self.bucket.remove(&name)?;
        let what = "the server ignores If-None-Match and If-Match on writes, so two runs could overwrite each other; \
            use a server that supports them (AWS S3 does)";
        honoured.then_some(()).ok_or_else(|| io::Error::new(io::ErrorKind::Unsupported, what))
    }

    fn probe_name(&self, what: &str) -> String {
        let Process { host, system, pid, started } = Process::this();
        let salt = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default().as_nanos();
        format!("{PROBES}/{what}-{host}-{system}-{pid}-{started}-{salt:x}")
    }

    /// The time by the clock of the server.
    pub(crate) fn server_time(&self) -> io::Result<SystemTime> {
        let name = self.probe_name("clock");
        self.bucket.write(&name, b"", Written::Always)?;
        let object = self.bucket.describe(&name)?;
        self.bucket.remove(&name)?;
        object.map(|object| object.modified).ok_or_else(|| io::Error::other("an object disappeared"))
    }

    pub(crate) fn fence(&self) -> Fence {
        self.fence.clone()
    }

    /// The bucket that was opened; for use in another thread.
    pub(crate) fn objects(&self) -> &Bucket {
        &self.bucket
    }

    fn note(&self, name: &str, tag: Option<String>) {
        // There are many results, and a result that was read is never overwritten.
        if !name.starts_with(".flightlag/") {
            return;
        }
        self.read.lock().unwrap_or_else(PoisonError::into_inner).insert(name.to_owned(), tag);
    }

    fn write(&self, name: &str, bytes: &[u8], only: Only) -> io::Result<Option<String>> {
        self.fence.check()?;
        let known = self.read.lock().unwrap_or_else(PoisonError::into_inner).get(name).cloned();
        let written = match (only, &known) {
            (Only::Always, _) | (Only::IfAsRead, None) => self.bucket.write(name, bytes, Written::Always),
            (Only::IfAbsent, _) | (Only::IfAsRead, Some(None)) => self.bucket.write(name, bytes, Written::IfAbsent),
            (Only::IfAsRead, Some(Some(tag))) => self.bucket.write(name, bytes, Written::IfTagged(tag)),
        }?;
        if let Some(tag) = &written {
            self.note(name, Some(tag.clone()));
        }
        Ok(written)
    }

    fn below(&self, folder: &str) -> io::Result<BTreeMap<String, Object>> {
        Ok(self.bucket.list(folder)?.into_iter().collect())
    }
}

impl Storage for BucketStorage {
    fn read(&self, name: &str) -> io::Result<Option<Vec<u8>>> {
        let found = self.bucket.read(name)?;
        self.note(name, found.as_ref().map(|(_, object)| object.tag.clone()));
        Ok(found.map(|(bytes, _)| bytes))
    }

    fn hash(&self, name: &str) -> io::Result<String> {
        let (bytes, _) = self.bucket.read(name)?.ok_or(io::ErrorKind::NotFound)?;
        Ok(blake3::hash(&bytes).to_hex().to_string())
    }

    fn put(&self, name: &str, _keep: Keep, only: Only, fill: Fill<'_>) -> Result<Option<Kept>, StoreError> {
        let path = self.bucket.url_of(name);
        let failed = |doing| move |e| failed(Path::new(&path), doing, e);
        let mut file = Hashing::new(Sink::Memory(vec![]));
        fill(&mut file).and_then(|()| file.flush()).map_err(failed.clone()("make"))?;
        let Sink::Memory(bytes) = &file.get_ref().sink else { return Ok(None) };
        let tag = self.write(name, bytes, only).map_err(failed("write"))?;
        let kept = |tag: String| Kept {
            stamp: FileStamp::of_object(bytes.len() as u64, &tag),
            blake3: file.get_ref().blake3(),
        };
        Ok(tag.map(kept))
    }

    fn describe(&self, name: &str) -> io::Result<Option<FileStamp>> {
        Ok(self.bucket.describe(name)?.map(|object| object.stamp()))
    }

    fn describe_all(&self) -> io::Result<Option<BTreeMap<String, FileStamp>>> {
        let all = self.below("")?;
        Ok(Some(all.into_iter().map(|(name, object)| (name, object.stamp())).collect()))
    }

    /// By this machine's clock, which is good enough for ages in days.
    fn age(&self, name: &str) -> Option<Duration> {
        self.bucket.describe(name).ok()??.modified.elapsed().ok()
    }

    fn remove(&self, name: &str) -> io::Result<()> {
        self.fence.check()?;
        self.bucket.remove(name)?;
        self.note(name, None);
        Ok(())
    }

    fn list(&self, folder: &str) -> io::Result<Vec<String>> {
        let mut names: Vec<String> = self.below(folder)?.into_keys().collect();
        let above = |name: &str| -> Vec<String> {
            let ends = name.match_indices('/').map(|(at, _)| at);
            ends.filter_map(|at| name.get(..at)).filter(|f| f.starts_with(folder)).map(str::to_owned).collect()
        };
        let folders: BTreeSet<String> = names.iter().flat_map(|name| above(name)).collect();
        // A folder sorts before its content, and so after it in reverse order.
        names.extend(folders.into_iter().rev());
        Ok(names)
    }

    fn files_of_root(&self) -> Vec<String> {
        let all = self.below("").unwrap_or_default();
        all.into_keys().filter(|name| !name.contains('/')).collect()
    }

    /// A bucket has no folders, only names with slashes.
    fn remove_empty_folder(&self, _name: &str) {}

    /// A bucket has no temporary names. A probe of a killed run has at most five bytes, and is removed when a day old.
    fn clean(&self) -> u64 {
        let old = |(name, object): (String, Object)| {
            let is_old = object.modified.elapsed().is_ok_and(|age| age > super::folder::ABANDONED);
            u64::from(is_old && self.bucket.remove(&name).is_ok())
        };
        self.bucket.list(PROBES).unwrap_or_default().into_iter().map(old).sum()
    }

    fn bucket(&self) -> Option<&BucketStorage> {
        Some(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_writer_that_lost_or_could_not_renew_the_lock_stops_writing() {
        let fence = Fence::default();
        let seen_elsewhere = fence.clone();
        fence.check().unwrap();
        fence.renew(Instant::now());
        seen_elsewhere.check().unwrap();
        fence.renew(Instant::now().checked_sub(UNSURE + Duration::from_secs(1)).unwrap());
        let error = seen_elsewhere.check().unwrap_err();
        assert!(error.to_string().contains("could not be renewed") && crate::disk::may_heal(&error), "{error}");
        fence.shut();
        let error = seen_elsewhere.check().unwrap_err();
        assert!(error.to_string().contains("took over") && crate::disk::may_heal(&error), "{error}");
    }
}
