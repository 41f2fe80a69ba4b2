//! The only place that writes outputs: to a folder, or to an S3 bucket.
//!
//! An output is absent, the old one, or the complete new one. [`folder`] and `bucket` describe how they guarantee that.
//!
//! Every write returns what was written, with its hash, for comparison by a later run.

#[cfg(feature = "s3")]
pub(crate) mod bucket;
pub(crate) mod folder;

use crate::error::CampaignError;
use crate::error::StoreError;
use crate::file_stamp::FileStamp;
use crate::s3;
use folder::Folder;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fmt;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Component, Path, PathBuf};
use std::time::Duration;

pub(crate) use folder::is_temporary;

/// Start of a sealed note, and the text between its hash and its content.
const SEAL: &str = "{\"blake3\":\"";
const CONTENT: &str = "\",\"content\":";

/// File with the identifier of an output folder.
const ID: &str = ".flightlag/id";

/// Whether a file must survive a power loss once it is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Keep {
    /// File synced before the rename, and its folder after it: results, and the state of finished work.
    Synced,
    /// File synced before the rename. A [`Keep::Synced`] file of the same folder follows.
    Part,
    /// Only renamed: pages, which the next run checks and can make again.
    Renewable,
}

/// Description of a file at the time it was written.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "(FileStamp, String)", into = "(FileStamp, String)")]
pub(crate) struct Kept {
    /// Metadata from the file system. While it is unchanged, the content is not read again.
    pub(crate) stamp: FileStamp,
    /// BLAKE3 of its content.
    pub(crate) blake3: String,
}

impl From<(FileStamp, String)> for Kept {
    fn from((stamp, blake3): (FileStamp, String)) -> Kept {
        Kept { stamp, blake3 }
    }
}

impl From<Kept> for (FileStamp, String) {
    fn from(kept: Kept) -> (FileStamp, String) {
        (kept.stamp, kept.blake3)
    }
}

/// Written files by name below the output folder.
pub(crate) type Files = BTreeMap<String, Kept>;

/// How thoroughly a file is compared with its [`Kept`] description.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) enum Check {
    /// By size, timestamps and inode number; by content if any of these differs.
    #[default]
    Quick,
    /// By content.
    Full,
}

/// Condition for writing an output. A folder ignores it: it has a system lock, and a rename has no conditions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Only {
    /// No condition.
    Always,
    /// The output does not exist: for the file that completes a result.
    IfAbsent,
    /// Unchanged since this store last read or wrote it: for the notes on the last run.
    IfAsRead,
}

/// Writes the content of an output.
pub(crate) type Fill<'a> = &'a mut dyn FnMut(&mut BufWriter<Hashing>) -> io::Result<()>;

/// Storage of outputs. Names are relative to the output folder, with `/` as separator.
pub(crate) trait Storage: fmt::Debug + Send + Sync {
    /// Content of an output; `None` if it does not exist.
    fn read(&self, name: &str) -> io::Result<Option<Vec<u8>>>;
    /// BLAKE3 of an output.
    fn hash(&self, name: &str) -> io::Result<String>;
    /// Writes an output atomically; `None` if the condition `only` is not met.
    fn put(&self, name: &str, keep: Keep, only: Only, fill: Fill<'_>) -> Result<Option<Kept>, StoreError>;
    /// Current metadata of an output; `None` if it does not exist.
    fn describe(&self, name: &str) -> io::Result<Option<FileStamp>>;
    /// Current metadata of all outputs; `None` if asking for each one is as cheap.
    fn describe_all(&self) -> io::Result<Option<BTreeMap<String, FileStamp>>>;
    /// Time since an output was written, if known.
    fn age(&self, name: &str) -> Option<Duration>;
    /// Removes an output, if it exists.
    fn remove(&self, name: &str) -> io::Result<()>;
    /// Names of the files below a folder, then of the folders, deepest first.
    fn list(&self, folder: &str) -> io::Result<Vec<String>>;
    /// Names of the files at the top level of the output folder.
    fn files_of_root(&self) -> Vec<String>;
    /// Removes a folder if it is empty.
    fn remove_empty_folder(&self, name: &str);
    /// Removes the leftovers of a killed run; returns the number of files.
    fn clean(&self) -> u64;
    /// The bucket, if this is one.
    #[cfg(feature = "s3")]
    fn bucket(&self) -> Option<&bucket::BucketStorage> {
        None
    }
}

/// An output folder.
#[derive(Debug)]
pub(crate) struct Store {
    root: PathBuf,
    storage: Box<dyn Storage>,
}

impl Store {
    /// Opens the folder, creates it if missing, and checks with a test file that it is writable.
    pub(crate) fn open(root: &Path) -> Result<Store, StoreError> {
        Store::with(root, Folder::open)
    }

    /// Opens the folder, which may be read-only.
    pub(crate) fn open_to_read(root: &Path) -> Result<Store, StoreError> {
        Store::with(root, |root| Ok(Folder::to_read(root)))
    }

    fn with(root: &Path, folder: impl FnOnce(&Path) -> Result<Folder, StoreError>) -> Result<Store, StoreError> {
        let storage: Box<dyn Storage> = match s3::is_in_bucket(root) {
            false => Box::new(folder(root)?),
            #[cfg(feature = "s3")]
            true => Box::new(bucket::BucketStorage::open(root)?),
            #[cfg(not(feature = "s3"))]
            true => return Err(failed(root, "use", s3::not_built())),
        };
        Ok(Store { root: root.to_owned(), storage })
    }

    /// Opens the folder of a plan. Does not create it: on a node where it is not mounted, results would be lost.
    pub(crate) fn open_planned(root: &Path, id: &str) -> Result<Store, CampaignError> {
        let found = read_unopened(root, ID)?.unwrap_or_default();
        if String::from_utf8_lossy(&found).trim() != id {
            let what = "is not the output folder of this plan; it may not be mounted here";
            return Err(CampaignError::TryAgain(format!("{}: {what}", root.display())));
        }
        Ok(Store::open(root)?)
    }

    /// The identifier that this folder got at its first write. A plan identifies its folder by it.
    pub(crate) fn id(&self) -> Result<String, StoreError> {
        if let Some(id) =
            self.read(ID)?.and_then(|bytes| String::from_utf8(bytes).ok()).filter(|id| !id.trim().is_empty())
        {
            return Ok(id.trim().to_owned());
        }
        let name = folder::temporary_name(&self.root).display().to_string();
        let id: String = blake3::hash(name.as_bytes()).to_hex().chars().take(16).collect();
        self.write(ID, format!("{id}\n").as_bytes(), Keep::Synced)?;
        Ok(id)
    }

    /// The folder.
    pub(crate) fn root(&self) -> &Path {
        &self.root
    }

    /// The bucket, if the outputs are in one.
    #[cfg(feature = "s3")]
    pub(crate) fn bucket(&self) -> Option<&bucket::BucketStorage> {
        self.storage.bucket()
    }

    /// Path of an output. Rejects a name that leads out of the folder.
    pub(crate) fn path(&self, name: &str) -> Result<PathBuf, StoreError> {
        let relative = Path::new(name);
        let inside = relative.components().all(|c| matches!(c, Component::Normal(_)));
        if inside && !name.is_empty() {
            return Ok(self.root.join(relative));
        }
        let error = io::Error::new(io::ErrorKind::InvalidInput, "it is outside of the output folder");
        Err(failed(relative, "use this name", error))
    }

    /// Writes a file atomically.
    pub(crate) fn write(&self, name: &str, bytes: &[u8], keep: Keep) -> Result<Kept, StoreError> {
        self.write_with(name, keep, |file| file.write_all(bytes))
    }

    /// Writes a file atomically with content from `fill`.
    pub(crate) fn write_with(
        &self,
        name: &str,
        keep: Keep,
        fill: impl FnOnce(&mut BufWriter<Hashing>) -> io::Result<()>,
    ) -> Result<Kept, StoreError> {
        let kept = self.put(name, keep, Only::Always, fill)?;
        kept.ok_or_else(|| failed(Path::new(name), "write", io::ErrorKind::Other.into()))
    }

    /// Writes a file that completes a result, unless it exists: then `None`. In a folder the later writer wins: both
    /// write the same bytes.
    pub(crate) fn write_first(&self, name: &str, bytes: &[u8]) -> Result<Option<Kept>, StoreError> {
        self.put(name, Keep::Synced, Only::IfAbsent, |file| file.write_all(bytes))
    }

    fn put(
        &self,
        name: &str,
        keep: Keep,
        only: Only,
        fill: impl FnOnce(&mut BufWriter<Hashing>) -> io::Result<()>,
    ) -> Result<Option<Kept>, StoreError> {
        self.path(name)?;
        let mut fill = Some(fill);
        self.storage.put(name, keep, only, &mut |file| fill.take().map_or(Ok(()), |fill| fill(file)))
    }

    /// Whether a file is unchanged. If only its metadata changed, updates `kept`.
    pub(crate) fn is_as_kept(&self, name: &str, kept: &mut Kept, check: Check) -> bool {
        let Some(stamp) = self.stamp(name) else { return false };
        self.is_still(name, kept, stamp, check)
    }

    /// The same for many files, by name. Lists all metadata at once where that is cheaper.
    pub(crate) fn are_as_kept<'a>(
        &self,
        files: impl Iterator<Item = (&'a String, &'a mut Kept)>,
    ) -> Result<Vec<(&'a String, bool)>, StoreError> {
        let all = self.storage.describe_all().map_err(|e| failed(&self.root, "list", e))?;
        let mut answers = vec![];
        for (name, kept) in files {
            let stamp = match &all {
                Some(all) => all.get(name.as_str()).copied(),
                None => self.stamp(name),
            };
            answers.push((name, stamp.is_some_and(|stamp| self.is_still(name, kept, stamp, Check::Quick))));
        }
        Ok(answers)
    }

    fn is_still(&self, name: &str, kept: &mut Kept, stamp: FileStamp, check: Check) -> bool {
        if check == Check::Quick && stamp == kept.stamp {
            return true;
        }
        let same = stamp.bytes == kept.stamp.bytes && self.hash(name).as_ref() == Some(&kept.blake3);
        if same {
            kept.stamp = stamp;
        }
        same
    }

    fn stamp(&self, name: &str) -> Option<FileStamp> {
        self.path(name).ok()?;
        self.storage.describe(name).ok().flatten()
    }

    /// BLAKE3 of an output; `None` if it cannot be read.
    pub(crate) fn hash(&self, name: &str) -> Option<String> {
        self.path(name).ok()?;
        self.storage.hash(name).ok()
    }

    /// Current description of an output.
    pub(crate) fn kept(&self, name: &str, blake3: &str) -> Option<Kept> {
        Some(Kept { stamp: self.stamp(name)?, blake3: blake3.to_owned() })
    }

    /// Size of an output, if it exists.
    pub(crate) fn size(&self, name: &str) -> Option<u64> {
        self.stamp(name).map(|stamp| stamp.bytes)
    }

    /// Time since an output was written, if known.
    pub(crate) fn age(&self, name: &str) -> Option<Duration> {
        self.path(name).ok()?;
        self.storage.age(name)
    }

    /// Content of an output; `None` if it is not there.
    pub(crate) fn read(&self, name: &str) -> Result<Option<Vec<u8>>, StoreError> {
        let path = self.path(name)?;
        self.storage.read(name).map_err(|e| failed(&path, "read", e))
    }

    /// Writes a note that contains its own hash.
    pub(crate) fn write_sealed(&self, name: &str, note: &impl Serialize) -> Result<(), StoreError> {
        self.write_with(name, Keep::Synced, |file| write_note(file, note)).map(drop)
    }

    /// The same for a note that this store has read before. Fails if another writer has changed it since.
    pub(crate) fn rewrite_sealed(&self, name: &str, note: &impl Serialize) -> Result<(), StoreError> {
        let kept = self.put(name, Keep::Synced, Only::IfAsRead, |file| write_note(file, note))?;
        let taken = || io::Error::new(io::ErrorKind::ResourceBusy, "another flightlag wrote it in the meantime");
        kept.map(drop).ok_or_else(|| failed(&self.root.join(name), "write", taken()))
    }

    /// A note that [`Store::write_sealed`] wrote; `None` if it is missing or was changed.
    pub(crate) fn read_sealed<T: serde::de::DeserializeOwned>(&self, name: &str) -> Option<T> {
        let bytes = self.read(name).ok().flatten()?;
        let text = std::str::from_utf8(&bytes).ok()?;
        let (hash, note) = text.strip_prefix(SEAL)?.strip_suffix("}\n")?.split_once(CONTENT)?;
        let is_whole = hash == blake3::hash(note.as_bytes()).to_hex().as_str();
        is_whole.then(|| serde_json::from_str(note).ok())?
    }

    /// Removes an output, if it exists.
    pub(crate) fn remove(&self, name: &str) -> Result<(), StoreError> {
        let path = self.path(name)?;
        self.storage.remove(name).map_err(|e| failed(&path, "remove", e))
    }

    /// Names of the files at the top level of the output folder.
    pub(crate) fn files_of_root(&self) -> Vec<String> {
        self.storage.files_of_root()
    }

    /// Names of the files below a folder, then of the folders, deepest first.
    pub(crate) fn list(&self, folder: &str) -> Vec<String> {
        self.try_list(folder).unwrap_or_default()
    }

    /// The same, but an unreadable folder is an error and not an empty list.
    pub(crate) fn try_list(&self, folder: &str) -> Result<Vec<String>, StoreError> {
        let path = self.path(folder)?;
        self.storage.list(folder).map_err(|e| failed(&path, "list", e))
    }

    /// Names of all files of a bucket; empty for a folder.
    pub(crate) fn all_files(&self) -> io::Result<Vec<String>> {
        Ok(self.storage.describe_all()?.unwrap_or_default().into_keys().collect())
    }

    /// Removes a folder if it is empty.
    pub(crate) fn remove_empty_folder(&self, name: &str) {
        if self.path(name).is_ok() {
            self.storage.remove_empty_folder(name);
        }
    }

    /// Removes temporary files of a killed run; returns their number.
    pub(crate) fn clean(&self) -> u64 {
        self.storage.clean()
    }
}

/// Reads a file of an output folder without opening the store; `None` if it is missing. Writes nothing.
pub(crate) fn read_unopened(root: &Path, name: &str) -> Result<Option<Vec<u8>>, StoreError> {
    let path = root.join(name);
    #[cfg(feature = "s3")]
    if s3::is_in_bucket(root) {
        return s3::read_url(&path).map_err(|e| failed(&path, "read", e));
    }
    #[cfg(not(feature = "s3"))]
    if s3::is_in_bucket(root) {
        return Err(failed(root, "use", s3::not_built()));
    }
    // An unreadable folder is not writable either, which is reported later.
    Ok(std::fs::read(path).ok())
}

/// Names of the top-level entries of an output folder, which may not exist.
pub(crate) fn first_names(root: &Path) -> Result<Vec<OsString>, StoreError> {
    #[cfg(feature = "s3")]
    if s3::is_in_bucket(root) {
        let names = s3::Bucket::of_url(root).and_then(|bucket| bucket.first_names());
        return names.map_err(|e| failed(root, "list", e));
    }
    let entries = std::fs::read_dir(root).into_iter().flatten().flatten();
    Ok(entries.map(|entry| entry.file_name()).collect())
}

fn failed(path: &Path, doing: &'static str, source: io::Error) -> StoreError {
    StoreError { path: path.to_owned(), doing, source }
}

/// Writes what [`Store::read_sealed`] reads. Serializes the note twice, for its hash and for the file: the note of a
/// large campaign has many megabytes, which are never entirely in memory.
fn write_note(file: &mut impl Write, note: &impl Serialize) -> io::Result<()> {
    let mut hasher = BufWriter::new(blake3::Hasher::new());
    serde_json::to_writer(&mut hasher, note)?;
    let hash = hasher.into_inner()?.finalize().to_hex();
    write!(file, "{SEAL}{hash}{CONTENT}")?;
    serde_json::to_writer(&mut *file, note)?;
    file.write_all(b"}\n")
}

/// A file being written, and the hash of its content so far.
pub(crate) struct Hashing {
    sink: Sink,
    hasher: blake3::Hasher,
}

enum Sink {
    File(File),
    #[cfg(feature = "s3")]
    Memory(Vec<u8>),
}

impl Hashing {
    fn new(sink: Sink) -> BufWriter<Hashing> {
        BufWriter::new(Hashing { sink, hasher: blake3::Hasher::new() })
    }

    fn blake3(&self) -> String {
        self.hasher.finalize().to_hex().to_string()
    }
}

impl Write for Hashing {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = match &mut self.sink {
            Sink::File(file) => file.write(bytes)?,
            #[cfg(feature = "s3")]
            Sink::Memory(content) => content.write(bytes)?,
        };
        self.hasher.update(bytes.get(..written).unwrap_or_default());
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        match &mut self.sink {
            Sink::File(file) => file.flush(),
            #[cfg(feature = "s3")]
            Sink::Memory(_) => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::folder::{ABANDONED, TEMPORARY};
    use super::*;
    use crate::disk::{Disk, System};
    use crate::process::Process;
    use std::fs;
    use std::io::Read;
    use std::time::SystemTime;

    fn store() -> (tempfile::TempDir, Store) {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        (folder, store)
    }

    #[test]
    fn a_failed_write_leaves_only_the_old_file() {
        let (folder, store) = store();
        store.write("a/record.json", b"old", Keep::Synced).unwrap();
        let disk_full = |f: &mut BufWriter<Hashing>| {
            f.write_all(b"half of the n")?;
            Err(io::Error::from(io::ErrorKind::StorageFull))
        };
        let error = store.write_with("a/record.json", Keep::Synced, disk_full).unwrap_err();
        assert_eq!(error.source.kind(), io::ErrorKind::StorageFull);
        assert!(error.to_string().contains("record.json"), "{error}");
        assert_eq!(fs::read(folder.path().join("a/record.json")).unwrap(), b"old");
        assert_eq!(store.list("a"), ["a/record.json", "a"]);
    }

    #[test]
    fn no_name_leads_out_of_the_folder() {
        let (_folder, store) = store();
        for name in ["../x", "/etc/x", "a/../../x", "", ".", "a/./../.."] {
            assert!(store.write(name, b"x", Keep::Synced).is_err(), "{name}");
        }
    }

    /// Records the calls to the system, and executes them.
    #[derive(Debug, Default)]
    struct Recorder(std::sync::Arc<std::sync::Mutex<Vec<String>>>);

    impl Recorder {
        fn note(&self, what: String) {
            self.0.lock().unwrap().push(what);
        }
    }

    fn base(path: &Path) -> String {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if is_temporary(name.as_ref()) { "temporary".to_owned() } else { name }
    }

    impl Disk for Recorder {
        fn create(&self, path: &Path) -> io::Result<File> {
            self.note(format!("create {}", base(path)));
            System.create(path)
        }
        fn sync(&self, file: &File, path: &Path) -> io::Result<()> {
            self.note(format!("sync {} bytes of {}", file.metadata()?.len(), base(path)));
            System.sync(file, path)
        }
        fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
            self.note(format!("rename {} {}", base(from), base(to)));
            System.rename(from, to)
        }
        fn sync_folder(&self, path: &Path) -> io::Result<()> {
            self.note(format!("sync folder {}", base(path)));
            System.sync_folder(path)
        }
    }

    #[test]
    fn a_result_is_written_synced_renamed_and_then_its_folder_is_synced() {
        let (folder, store) = store();
        let notes = std::sync::Arc::default();
        let recorded = Folder { root: store.root.clone(), disk: Box::new(Recorder(std::sync::Arc::clone(&notes))) };
        let store = Store { storage: Box::new(recorded), ..store };
        let steps = || std::mem::take(&mut *notes.lock().unwrap());
        store.write("a/b/track", b"1234567", Keep::Part).unwrap();
        let of_folder = base(folder.path());
        let made = ["sync folder a".to_owned(), format!("sync folder {of_folder}")];
        let track = ["create temporary", "sync 7 bytes of temporary", "rename temporary track"].map(str::to_owned);
        assert_eq!(steps(), [made.as_slice(), &track].concat());
        store.write("a/b/record", b"12", Keep::Synced).unwrap();
        let record = ["create temporary", "sync 2 bytes of temporary", "rename temporary record", "sync folder b"];
        assert_eq!(steps(), record);
        store.write("a/b/page", b"1", Keep::Renewable).unwrap();
        assert_eq!(steps(), ["create temporary", "rename temporary page"]);
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn a_sync_asks_the_system_to_sync() {
        // The system rejects a sync of /dev/null, so a sync that does not reach the system is detected.
        let null = File::open("/dev/null").unwrap();
        assert_eq!(System.sync(&null, Path::new("null")).unwrap_err().kind(), io::ErrorKind::InvalidInput);
        assert_eq!(System.sync_folder(Path::new("/nowhere")).unwrap_err().kind(), io::ErrorKind::NotFound);
    }

    #[test]
    fn a_reader_of_the_old_file_keeps_reading_the_old_content() {
        let (folder, store) = store();
        store.write("record.json", b"the old record", Keep::Synced).unwrap();
        let mut reader = File::open(folder.path().join("record.json")).unwrap();
        let mut text = [0; 4];
        reader.read_exact(&mut text).unwrap();
        store.write("record.json", b"new", Keep::Synced).unwrap();
        let mut rest = String::new();
        reader.read_to_string(&mut rest).unwrap();
        assert_eq!(rest, "old record");
        assert_eq!(fs::read(folder.path().join("record.json")).unwrap(), b"new");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file is left");
    }

    #[test]
    fn leftovers_of_a_dead_process_are_removed_and_files_of_a_live_one_stay() {
        let (folder, store) = store();
        let Process { host, system, pid, started } = Process::this();
        let name = |pid: u32, started: u64| format!(".record.json.{host}.{system}.{pid}-{started}.0-1f.{TEMPORARY}");
        // No process has a number above the Linux limit of 2^22.
        fs::create_dir(folder.path().join("by-key")).unwrap();
        fs::write(folder.path().join("by-key").join(name(99_999_999, 1)), "half").unwrap();
        fs::write(folder.path().join(name(*pid, started + 1)), "of an earlier process with this number").unwrap();
        fs::write(folder.path().join(name(*pid, *started)), "in work").unwrap();
        fs::write(folder.path().join("notes.txt"), "mine").unwrap();
        assert_eq!(store.clean(), 2);
        assert!(folder.path().join(name(*pid, *started)).exists() && folder.path().join("notes.txt").exists());
    }

    #[test]
    fn a_temporary_file_of_another_container_is_removed_only_when_old() {
        let (folder, store) = store();
        // The same host name and process number, as in two containers of one image.
        let Process { host, pid, started, .. } = Process::this();
        let name = |n: u32| folder.path().join(format!(".r.{host}.0badcafe.{pid}-{started}.{n}-1f.{TEMPORARY}"));
        let gone = |n: u32| folder.path().join(format!(".r.{host}.0badcafe.99999999-1.{n}-1f.{TEMPORARY}"));
        for path in [name(0), name(1), gone(2)] {
            fs::write(path, "in work").unwrap();
        }
        let two_days_ago = SystemTime::now() - 2 * ABANDONED;
        File::options().write(true).open(name(1)).unwrap().set_modified(two_days_ago).unwrap();
        assert_eq!(store.clean(), 1);
        assert!(name(0).exists() && !name(1).exists() && gone(2).exists());
    }

    #[test]
    fn a_file_is_unchanged_until_a_byte_of_it_changes() {
        let (folder, store) = store();
        let mut kept = store.write("a.bin", b"12345678", Keep::Renewable).unwrap();
        assert!(
            store.is_as_kept("a.bin", &mut kept, Check::Quick) && store.is_as_kept("a.bin", &mut kept, Check::Full)
        );
        let path = folder.path().join("a.bin");
        fs::copy(&path, folder.path().join("b.bin")).unwrap();
        fs::rename(folder.path().join("b.bin"), &path).unwrap();
        assert!(store.is_as_kept("a.bin", &mut kept, Check::Quick), "another file with the same content is fine");
        assert_eq!(kept.stamp, FileStamp::of(&path).unwrap());
        fs::write(&path, b"12345679").unwrap();
        assert!(!store.is_as_kept("a.bin", &mut kept.clone(), Check::Quick));
        // As if no timestamp of the file had changed.
        kept.stamp = FileStamp::of(&path).unwrap();
        assert!(
            store.is_as_kept("a.bin", &mut kept, Check::Quick) && !store.is_as_kept("a.bin", &mut kept, Check::Full)
        );
    }

    #[test]
    fn a_sealed_note_is_read_back_and_a_changed_one_is_rejected() {
        let (folder, store) = store();
        store.write_sealed("note.json", &vec![1, 2, 3]).unwrap();
        assert_eq!(store.read_sealed::<Vec<i32>>("note.json"), Some(vec![1, 2, 3]));
        let text = fs::read_to_string(folder.path().join("note.json")).unwrap();
        assert_eq!(serde_json::from_str::<serde_json::Value>(&text).unwrap()["content"][1], 2);
        fs::write(folder.path().join("note.json"), text.replace("1,2,3", "1,2,4")).unwrap();
        assert_eq!(store.read_sealed::<Vec<i32>>("note.json"), None);
    }

    #[test]
    fn a_read_only_folder_is_rejected_before_any_work() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("report");
        fs::write(&file, "a file").unwrap();
        let error = Store::open(&file).unwrap_err();
        assert!(error.to_string().contains("report"), "{error}");
    }
}
