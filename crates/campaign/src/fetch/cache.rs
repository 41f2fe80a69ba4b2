//! Complete copies of objects, named by the object. Processes on one machine share them.

use super::CACHE;
use crate::s3::{Bucket, Object};
use crate::store::folder::{clean_folder, entries, is_leftover, is_temporary, temporary_name};
use std::fs::{self, File, FileTimes, Metadata};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::SystemTime;

/// Objects are fetched in pieces of this size to limit memory, bytes.
const PIECE: u64 = 8 << 20;

/// The cache of this machine.
#[derive(Debug)]
pub(super) struct Cache {
    folder: PathBuf,
    most_bytes: u64,
}

impl Cache {
    /// Opens the cache and removes leftovers of killed processes.
    pub(super) fn open() -> io::Result<&'static Cache> {
        static OPEN: OnceLock<Cache> = OnceLock::new();
        if let Some(cache) = OPEN.get() {
            return Ok(cache);
        }
        let wanted = CACHE.get().cloned().unwrap_or_default();
        let folder = wanted.folder.or_else(usual_folder).ok_or_else(|| {
            io::Error::other("no folder for copies of logs: XDG_CACHE_HOME and HOME are not set; give --cache DIR")
        })?;
        let cache = Cache::new(&folder, wanted.most_bytes)
            .map_err(|e| io::Error::new(e.kind(), format!("the cache of logs {}: {e}", folder.display())))?;
        Ok(OPEN.get_or_init(|| cache))
    }

    fn new(folder: &Path, most_bytes: u64) -> io::Result<Cache> {
        fs::create_dir_all(folder.join("objects"))?;
        fs::create_dir_all(folder.join("views"))?;
        let cache = Cache { folder: folder.canonicalize()?, most_bytes };
        clean_folder(&cache.objects());
        for (view, _) in entries(&cache.folder.join("views")).filter(|(path, _)| is_leftover(path)) {
            // Another process may remove it at the same time.
            let _ = fs::remove_dir_all(view);
        }
        Ok(cache)
    }

    fn objects(&self) -> PathBuf {
        self.folder.join("objects")
    }

    /// Creates a folder for the names and sizes of one process.
    pub(super) fn new_view(&self) -> io::Result<PathBuf> {
        let folder = temporary_name(&self.folder.join("views/view"));
        fs::create_dir(&folder)?;
        Ok(folder)
    }

    /// Puts a complete copy of an object at `place`, which must be in a view of this cache.
    pub(super) fn put(
        &self,
        (bucket, name, object): (&Bucket, &str, &Object),
        place: &Path,
        cancel: &AtomicBool,
    ) -> io::Result<()> {
        let copy = self.copy_of(bucket, name, object);
        let link = temporary_name(place);
        loop {
            if !is_copy(&copy, object) {
                self.fetch(bucket, name, object, &copy, cancel)?;
            }
            match fs::hard_link(&copy, &link) {
                Ok(()) => break,
                // Another process needed the space.
                Err(e) if e.kind() == io::ErrorKind::NotFound => continue,
                Err(_) => {
                    fs::copy(&copy, &link)?;
                    break;
                }
            }
        }
        // Sets the last use. Keeps the modification time: another reader would take the file for changed.
        let used = FileTimes::new().set_accessed(SystemTime::now());
        let _ = File::open(&copy).and_then(|file| file.set_times(used));
        fs::rename(&link, place)
    }

    fn copy_of(&self, bucket: &Bucket, name: &str, object: &Object) -> PathBuf {
        let text = format!("{}\0{}\0{}", bucket.place(), bucket.url_of(name), object.tag);
        let hash: String = blake3::hash(text.as_bytes()).to_hex().chars().take(32).collect();
        self.objects().join(format!("{hash}-{}", object.bytes))
    }

    fn fetch(&self, bucket: &Bucket, name: &str, object: &Object, copy: &Path, cancel: &AtomicBool) -> io::Result<()> {
        let (temporary, mut file) = self.reserve(copy, object.bytes)?;
        let mut fill = || {
            let mut from = 0;
            while from < object.bytes {
                if cancel.load(Ordering::Relaxed) {
                    return Err(io::ErrorKind::Interrupted.into());
                }
                let to = object.bytes.min(from + PIECE);
                let piece = bucket.read_piece(name, &object.tag, from..to)?;
                if piece.len() as u64 != to - from {
                    return Err(io::Error::new(
                        io::ErrorKind::TimedOut,
                        "the answer of the server is too short; try \
                        again",
                    ));
                }
                file.write_all(&piece)?;
                from = to;
            }
            // A name that exists after a power loss must have its content.
            file.sync_data()
        };
        let fetched = fill().and_then(|()| fs::rename(&temporary, copy));
        if fetched.is_err() {
            let _ = fs::remove_file(&temporary);
        }
        fetched
    }

    /// Creates a file of the full size to fetch into. Makes space first by removing copies not being read, the least
    /// recently used first. An object larger than the cache is still fetched, alone.
    fn reserve(&self, copy: &Path, bytes: u64) -> io::Result<(PathBuf, File)> {
        let lock = File::options().create(true).truncate(false).write(true).open(self.folder.join("lock"))?;
        // On a file system without locks, two processes may use a little more space.
        let _ = lock.lock();
        let with_metadata = |(path, _): (PathBuf, _)| Some((fs::metadata(&path).ok()?, path));
        let mut copies: Vec<(Metadata, PathBuf)> = entries(&self.objects()).filter_map(with_metadata).collect();
        copies.sort_by_key(|(about, _)| about.accessed().ok());
        let mut taken: u64 = copies.iter().map(|(about, _)| about.len()).sum();
        for (about, path) in copies {
            if taken.saturating_add(bytes) <= self.most_bytes {
                break;
            }
            let in_use = links(&about) > 1 || path.file_name().is_some_and(is_temporary);
            if !in_use && fs::remove_file(&path).is_ok() {
                taken -= about.len();
            }
        }
        let temporary = temporary_name(copy);
        let file = File::create_new(&temporary)?;
        file.set_len(bytes)?;
        Ok((temporary, file))
    }
}

fn is_copy(copy: &Path, object: &Object) -> bool {
    fs::metadata(copy).is_ok_and(|about| about.len() == object.bytes)
}

#[cfg(unix)]
fn links(about: &Metadata) -> u64 {
    std::os::unix::fs::MetadataExt::nlink(about)
}

#[cfg(not(unix))]
fn links(_about: &Metadata) -> u64 {
    1
}

/// The cache folder of the system.
fn usual_folder() -> Option<PathBuf> {
    let set = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    let cache = set("XDG_CACHE_HOME").or_else(|| Some(set("HOME")?.join(".cache")))?;
    Some(cache.join("flightlag"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn least_recently_used_copies_are_removed_but_none_in_use() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(folder.path(), 100).unwrap();
        let long_ago = |seconds| SystemTime::now() - Duration::from_secs(seconds);
        for (name, age) in [("read", 400), ("old", 300), ("newer", 200)] {
            let path = cache.objects().join(name);
            fs::write(&path, [0; 30]).unwrap();
            let used = FileTimes::new().set_accessed(long_ago(age));
            File::options().write(true).open(&path).unwrap().set_times(used).unwrap();
        }
        fs::hard_link(cache.objects().join("read"), folder.path().join("views/reader")).unwrap();
        let is_there = |name: &str| cache.objects().join(name).exists();
        let (first, _file) = cache.reserve(&cache.objects().join("a"), 30).unwrap();
        assert!(is_there("read") && !is_there("old") && is_there("newer"));
        let (second, _file) = cache.reserve(&cache.objects().join("b"), 1000).unwrap();
        assert!(is_there("read") && !is_there("newer"), "an object that is larger than the cache has it alone");
        assert!(first.exists() && second.exists());
    }
}
