//! Remembers the content hash of a file by its path, size and timestamps, so that a second run reads no log.

use crate::error::CampaignError;
use crate::file_stamp::FileStamp;
use crate::store::Store;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::time::SystemTime;

const MEMORY: &str = ".flightlag/inputs.json";
const MEMORY_VERSION: u32 = 2;

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Known {
    stamp: FileStamp,
    blake3: String,
}

/// Hashes of the files of one folder, by path below it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Memory {
    version: u32,
    root: String,
    files: BTreeMap<String, Known>,
}

impl Memory {
    /// Hashes from earlier runs on this output for the folder `root`. Empty if unreadable or for
    /// another folder: it only saves time.
    pub(crate) fn recall(store: &Store, root: &Path) -> Memory {
        let root = root.to_string_lossy().into_owned();
        let memory: Option<Memory> = store.read_sealed(MEMORY);
        let fits = memory.filter(|m| m.version == MEMORY_VERSION && m.root == root);
        fits.unwrap_or(Memory { version: MEMORY_VERSION, root, files: BTreeMap::new() })
    }

    /// The hash of an unchanged file.
    pub(crate) fn hash_of(&self, path: &str, stamp: &FileStamp) -> Option<&str> {
        self.files.get(path).filter(|k| k.stamp == *stamp).map(|k| k.blake3.as_str())
    }

    /// The hash of a file when it was last read.
    pub(crate) fn latest_hash_of(&self, path: &str) -> Option<&str> {
        self.files.get(path).map(|known| known.blake3.as_str())
    }

    /// Adds the hash of a file. Its metadata was taken before reading.
    pub(crate) fn learn(&mut self, path: &str, stamp: &FileStamp, blake3: &str) {
        // A path with bytes that are not text cannot be distinguished from other such paths.
        if path.contains(char::REPLACEMENT_CHARACTER) || stamp.is_too_fresh(SystemTime::now()) {
            self.files.remove(path);
            return;
        }
        self.files.insert(path.to_owned(), Known { stamp: *stamp, blake3: blake3.to_owned() });
    }

    /// Forgets files that are gone.
    pub(crate) fn retain(&mut self, exists: impl Fn(&str) -> bool) {
        self.files.retain(|path, _| exists(path));
    }

    /// Saves the memory.
    pub(crate) fn save(&self, store: &Store) -> Result<(), CampaignError> {
        Ok(store.write_sealed(MEMORY, self)?)
    }
}

/// BLAKE3 of a file, read through `buffer`. `None` if `advance` reports that the user wants to stop.
pub(crate) fn hash_file(
    path: &Path,
    buffer: &mut [u8],
    mut advance: impl FnMut(u64) -> bool,
) -> std::io::Result<Option<String>> {
    let mut file = File::open(path)?;
    let mut hasher = blake3::Hasher::new();
    loop {
        let n = match file.read(buffer) {
            Ok(0) => return Ok(Some(hasher.finalize().to_hex().to_string())),
            Ok(n) => n,
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => continue,
            Err(e) => return Err(e),
        };
        hasher.update(buffer.get(..n).unwrap_or_default());
        if !advance(n as u64) {
            return Ok(None);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    fn old_file(folder: &Path, content: &str) -> std::path::PathBuf {
        let path = folder.join("a.csv");
        std::fs::write(&path, content).unwrap();
        std::thread::sleep(Duration::from_millis(60));
        path
    }

    #[test]
    fn a_file_is_known_until_rewritten_even_with_the_same_size_and_time() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        let path = old_file(folder.path(), "one");
        let stamp = FileStamp::of(&path).unwrap();
        let mut memory = Memory::recall(&store, folder.path());
        memory.learn("a.csv", &stamp, "h1");
        memory.save(&store).unwrap();
        let memory = Memory::recall(&store, folder.path());
        assert_eq!(memory.hash_of("a.csv", &FileStamp::of(&path).unwrap()), Some("h1"));

        let modified = std::fs::metadata(&path).unwrap().modified().unwrap();
        std::fs::write(&path, "two").unwrap();
        File::options().write(true).open(&path).unwrap().set_modified(modified).unwrap();
        assert_eq!(memory.hash_of("a.csv", &FileStamp::of(&path).unwrap()), None);
        assert_eq!(Memory::recall(&store, Path::new("/elsewhere")).hash_of("a.csv", &stamp), None);
    }

    #[test]
    #[cfg(feature = "s3")]
    fn an_object_is_known_by_its_size_and_tag_with_any_quoting() {
        let stamp = FileStamp::of_object(7, "\"d41d8cd98f00b204e9800998ecf8427e\"");
        assert_eq!(stamp, FileStamp::of_object(7, "d41d8cd98f00b204e9800998ecf8427e"));
        assert_ne!(stamp, FileStamp::of_object(7, "d41d8cd98f00b204e9800998ecf8427f"));
        assert_ne!(stamp, FileStamp::of_object(8, "d41d8cd98f00b204e9800998ecf8427e"));
        assert!(!stamp.is_too_fresh(SystemTime::UNIX_EPOCH));
        let text = serde_json::to_string(&stamp).unwrap();
        assert_eq!(serde_json::from_str::<FileStamp>(&text).unwrap(), stamp);
    }

    #[test]
    fn a_file_written_at_this_moment_is_not_trusted_next_time() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        let path = folder.path().join("b.csv");
        std::fs::write(&path, "one").unwrap();
        File::options()
            .write(true)
            .open(&path)
            .unwrap()
            .set_modified(SystemTime::now() + Duration::from_secs(9))
            .unwrap();
        let stamp = FileStamp::of(&path).unwrap();
        let mut memory = Memory::recall(&store, folder.path());
        memory.learn("b.csv", &stamp, "h1");
        assert_eq!(memory.hash_of("b.csv", &stamp), None);
    }

    #[test]
    fn the_hash_does_not_depend_on_the_buffer() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("c.bin");
        let content: Vec<u8> = (0..100_000u32).map(|i| (i * 7919 % 251) as u8).collect();
        std::fs::write(&path, &content).unwrap();
        let mut total = 0;
        let hash = hash_file(&path, &mut [0; 777], |n| {
            total += n;
            true
        });
        assert_eq!(hash.unwrap().unwrap(), blake3::hash(&content).to_hex().to_string());
        assert_eq!(total, 100_000);
        assert!(hash_file(&path, &mut [0; 777], |_| false).unwrap().is_none());
    }
}
