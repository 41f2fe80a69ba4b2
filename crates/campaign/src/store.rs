//! The one place where outputs are written.
//!
//! Every write goes to a temporary name in the file's own folder, is synced, and renamed over the
//! final name: a file is absent, the old one, or the new one, whole. Of results the folder is synced too.
//! A plain rename, because NFS knows no `RENAME_NOREPLACE`; a second writer of a result writes
//! the same bytes, so that it does not matter who comes last.
//!
//! Every write returns what was written, with its hash. A later run compares.

use crate::disk::{Disk, disk};
use crate::error::CampaignError;
use crate::memory::FileStamp;
use crate::process::Process;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, BufWriter, Read, Write};
use std::path::{Component, Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, SystemTime};

/// Ends the name of a temporary file, `.name.host.system.pid-start.number.flightlag-tmp`.
const TEMPORARY: &str = "flightlag-tmp";

/// Temporary files of other hosts and containers are taken for leftovers after this time.
const ABANDONED: Duration = Duration::from_secs(24 * 3600);

/// What a note of our own begins with, and what comes between its hash and its content.
const SEAL: &str = "{\"blake3\":\"";
const CONTENT: &str = "\",\"content\":";

/// The name of an output folder.
const ID: &str = ".flightlag/id";

/// Size of the piece in which files are copied and hashed, bytes.
const PIECE: usize = 1 << 16;

/// An output could not be written, read or removed.
#[derive(Debug, thiserror::Error)]
#[error("{}: cannot {doing}: {source}", path.display())]
pub struct StoreError {
    /// The file or folder.
    pub path: PathBuf,
    /// What was tried.
    pub doing: &'static str,
    /// What the system says.
    pub source: io::Error,
}

/// Whether a file must survive a loss of power once it is there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Keep {
    /// Synced before the rename, and its folder after it: results, and the memory of what is done.
    Synced,
    /// Synced before the rename. A file of the same folder that is kept as [`Keep::Synced`] follows.
    Part,
    /// Renamed only: pages, which are checked at the next run and which can be made again.
    Renewable,
}

/// A file as it was written.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "(FileStamp, String)", into = "(FileStamp, String)")]
pub(crate) struct Kept {
    /// How the file system described it. While that is the same, the content is not read again.
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

/// Files as they were written, by name below the output folder.
pub(crate) type Files = BTreeMap<String, Kept>;

/// How thoroughly a file is compared with what was written.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) enum Check {
    /// By size, times and number of the file; by content if any of these differs.
    #[default]
    Quick,
    /// By content.
    Full,
}

/// An output folder.
#[derive(Debug)]
pub(crate) struct Store {
    root: PathBuf,
    disk: Box<dyn Disk>,
    number: AtomicU64,
}

impl Store {
    /// Opens the folder, makes it if it is missing, and shows by a test file that it can be written to.
    pub(crate) fn open(root: &Path) -> Result<Store, StoreError> {
        fs::create_dir_all(root).map_err(|e| failed(root, "make this folder", e))?;
        let store = Store { root: root.to_owned(), disk: disk(), number: AtomicU64::new(0) };
        let probe = store.temporary_name(&root.join("probe"));
        let written = fs::write(&probe, b"flightlag\n").map_err(|e| failed(root, "write to this folder", e));
        let removed = fs::remove_file(&probe).map_err(|e| failed(&probe, "remove", e));
        written.and(removed).map(|()| store)
    }

    /// Opens the folder of a plan. It is not made: on a node where it is not mounted, results would go nowhere.
    pub(crate) fn open_planned(root: &Path, id: &str) -> Result<Store, CampaignError> {
        let found = fs::read_to_string(root.join(ID)).unwrap_or_default();
        if found.trim() != id {
            let what = "is not the output folder of this plan; it may not be mounted here";
            return Err(CampaignError::TryAgain(format!("{}: {what}", root.display())));
        }
        Ok(Store::open(root)?)
    }

    /// The name that this folder got when it was first written to. A plan knows its folder by it.
    pub(crate) fn id(&self) -> Result<String, StoreError> {
        if let Some(id) =
            self.read(ID)?.and_then(|bytes| String::from_utf8(bytes).ok()).filter(|id| !id.trim().is_empty())
        {
            return Ok(id.trim().to_owned());
        }
        let name = self.temporary_name(&self.root).display().to_string();
        let id: String = blake3::hash(name.as_bytes()).to_hex().chars().take(16).collect();
        self.write(ID, format!("{id}\n").as_bytes(), Keep::Synced)?;
        Ok(id)
    }

    /// The folder.
    pub(crate) fn root(&self) -> &Path {
        &self.root
    }

    /// Where an output is or will be. A name that would lead out of the folder is refused.
    pub(crate) fn path(&self, name: &str) -> Result<PathBuf, StoreError> {
        let relative = Path::new(name);
        let inside = relative.components().all(|c| matches!(c, Component::Normal(_)));
        if inside && !name.is_empty() {
            return Ok(self.root.join(relative));
        }
        let odd = io::Error::new(io::ErrorKind::InvalidInput, "it is not below the output folder");
        Err(failed(relative, "use this name", odd))
    }

    /// Writes a file whole.
    pub(crate) fn write(&self, name: &str, bytes: &[u8], keep: Keep) -> Result<Kept, StoreError> {
        self.write_with(name, keep, |file| file.write_all(bytes))
    }

    /// Writes a file whole, whose content `fill` makes.
    pub(crate) fn write_with(
        &self,
        name: &str,
        keep: Keep,
        fill: impl FnOnce(&mut BufWriter<Hashing>) -> io::Result<()>,
    ) -> Result<Kept, StoreError> {
        let path = self.path(name)?;
        self.make_folder_of(&path, keep)?;
        let temporary = self.temporary_name(&path);
        let placed = self.place(&temporary, &path, keep, fill);
        placed.map_err(|error| {
            let _ = fs::remove_file(&temporary);
            // People know the file by its final name.
            StoreError { path, ..error }
        })
    }

    fn place(
        &self,
        temporary: &Path,
        path: &Path,
        keep: Keep,
        fill: impl FnOnce(&mut BufWriter<Hashing>) -> io::Result<()>,
    ) -> Result<Kept, StoreError> {
        let file = self.disk.create(temporary).map_err(|e| failed(temporary, "make", e))?;
        let mut file = BufWriter::new(Hashing { file, hasher: blake3::Hasher::new() });
        fill(&mut file).and_then(|()| file.flush()).map_err(|e| failed(temporary, "write", e))?;
        if keep != Keep::Renewable {
            self.disk.sync(&file.get_ref().file, temporary).map_err(|e| failed(temporary, "sync", e))?;
        }
        self.disk.rename(temporary, path).map_err(|e| failed(path, "rename", e))?;
        if keep == Keep::Synced {
            self.sync_folder_of(path)?;
        }
        let stamp = FileStamp::of(path).map_err(|e| failed(path, "look at", e))?;
        Ok(Kept { stamp, blake3: file.get_ref().hasher.finalize().to_hex().to_string() })
    }

    /// Makes the folder of a file, and the folders above it. Names of new folders of results are synced.
    fn make_folder_of(&self, path: &Path, keep: Keep) -> Result<(), StoreError> {
        let folder = path.parent().unwrap_or(&self.root);
        let is_missing = |above: &&Path| keep != Keep::Renewable && !above.exists();
        let missing: Vec<&Path> = folder.ancestors().take_while(is_missing).collect();
        fs::create_dir_all(folder).map_err(|e| failed(folder, "make this folder", e))?;
        missing.into_iter().try_for_each(|made| self.sync_folder_of(made))
    }

    fn sync_folder_of(&self, path: &Path) -> Result<(), StoreError> {
        let folder = path.parent().unwrap_or(&self.root);
        self.disk.sync_folder(folder).map_err(|e| failed(folder, "sync this folder", e))
    }

    /// Whether a file is as it was written. `kept` learns a new description of the same content.
    pub(crate) fn is_as_kept(&self, name: &str, kept: &mut Kept, check: Check) -> bool {
        let Some(stamp) = self.path(name).ok().and_then(|path| FileStamp::of(&path).ok()) else { return false };
        if check == Check::Quick && stamp == kept.stamp {
            return true;
        }
        let same = stamp.bytes == kept.stamp.bytes && self.hash(name).as_ref() == Some(&kept.blake3);
        if same {
            kept.stamp = stamp;
        }
        same
    }

    /// BLAKE3 of an output; `None` if it cannot be read.
    pub(crate) fn hash(&self, name: &str) -> Option<String> {
        let mut file = File::open(self.path(name).ok()?).ok()?;
        let mut hasher = blake3::Hasher::new();
        copy_all(&mut file, &mut hasher).ok()?;
        Some(hasher.finalize().to_hex().to_string())
    }

    /// An output as it is now.
    pub(crate) fn kept(&self, name: &str, blake3: &str) -> Option<Kept> {
        let stamp = FileStamp::of(&self.path(name).ok()?).ok()?;
        Some(Kept { stamp, blake3: blake3.to_owned() })
    }

    /// Size of an output, if it is there.
    pub(crate) fn size(&self, name: &str) -> Option<u64> {
        let found = fs::metadata(self.path(name).ok()?).ok()?;
        found.is_file().then_some(found.len())
    }

    /// How long ago an output was written, if that is known.
    pub(crate) fn age(&self, name: &str) -> Option<Duration> {
        age(&self.path(name).ok()?)
    }

    /// Content of an output; `None` if it is not there.
    pub(crate) fn read(&self, name: &str) -> Result<Option<Vec<u8>>, StoreError> {
        let path = self.path(name)?;
        match fs::read(&path) {
            Ok(bytes) => Ok(Some(bytes)),
            Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(e) => Err(failed(&path, "read", e)),
        }
    }

    /// Writes a note of our own with its hash in it.
    pub(crate) fn write_sealed(&self, name: &str, note: &impl Serialize) -> Result<(), StoreError> {
        let path = self.path(name)?;
        let text = serde_json::to_string(note).map_err(|e| failed(&path, "write", e.into()))?;
        let sealed = format!("{SEAL}{}{CONTENT}{text}}}\n", blake3::hash(text.as_bytes()).to_hex());
        self.write(name, sealed.as_bytes(), Keep::Synced).map(drop)
    }

    /// A note that [`Store::write_sealed`] wrote; `None` if it is not there, or not as it was written.
    pub(crate) fn read_sealed<T: serde::de::DeserializeOwned>(&self, name: &str) -> Option<T> {
        let bytes = self.read(name).ok().flatten()?;
        let text = std::str::from_utf8(&bytes).ok()?;
        let (hash, note) = text.strip_prefix(SEAL)?.strip_suffix("}\n")?.split_once(CONTENT)?;
        let is_whole = hash == blake3::hash(note.as_bytes()).to_hex().as_str();
        is_whole.then(|| serde_json::from_str(note).ok())?
    }

    /// Removes an output; that it is not there is fine.
    pub(crate) fn remove(&self, name: &str) -> Result<(), StoreError> {
        let path = self.path(name)?;
        match fs::remove_file(&path) {
            Err(e) if e.kind() != io::ErrorKind::NotFound => Err(failed(&path, "remove", e)),
            _ => Ok(()),
        }
    }

    /// Names of the files right in the output folder.
    pub(crate) fn files_of_root(&self) -> Vec<String> {
        let files = entries(&self.root).filter(|(_, kind)| kind.is_file());
        files.filter_map(|(path, _)| path.file_name()?.to_str().map(str::to_owned)).collect()
    }

    /// Names of the files below a folder, and afterwards of the folders, deepest first.
    pub(crate) fn list(&self, folder: &str) -> Vec<String> {
        let (mut files, mut folders) = (vec![], vec![]);
        if let Ok(path) = self.path(folder) {
            self.collect(&path, folder, &mut files, &mut folders);
        }
        files.append(&mut folders);
        files
    }

    fn collect(&self, path: &Path, name: &str, files: &mut Vec<String>, folders: &mut Vec<String>) {
        for (entry, kind) in entries(path) {
            let Some(base) = entry.file_name().and_then(|n| n.to_str()).map(str::to_owned) else { continue };
            match kind.is_dir() {
                true => self.collect(&entry, &format!("{name}/{base}"), files, folders),
                false => files.push(format!("{name}/{base}")),
            }
        }
        folders.push(name.to_owned());
    }

    /// Removes a folder if it is empty.
    pub(crate) fn remove_empty_folder(&self, name: &str) {
        if let Ok(path) = self.path(name) {
            // Whatever is still in it is not ours, and stays.
            let _ = fs::remove_dir(path);
        }
    }

    /// Removes temporary files that a killed run left behind; says how many.
    pub(crate) fn clean(&self) -> u64 {
        self.clean_folder(&self.root)
    }

    fn clean_folder(&self, folder: &Path) -> u64 {
        let of_entry = |(path, kind): (PathBuf, fs::FileType)| match kind.is_dir() {
            true => self.clean_folder(&path),
            false => u64::from(is_leftover(&path) && fs::remove_file(&path).is_ok()),
        };
        entries(folder).map(of_entry).sum()
    }

    /// A name in the same folder that no other process uses.
    fn temporary_name(&self, path: &Path) -> PathBuf {
        let base = path.file_name().unwrap_or_default().to_string_lossy();
        let short: String = base.chars().take(40).collect();
        let Process { host, system, pid, started } = Process::this();
        let number = self.number.fetch_add(1, Ordering::Relaxed);
        let salt = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default().subsec_nanos();
        path.with_file_name(format!(".{short}.{host}.{system}.{pid}-{started}.{number}-{salt:x}.{TEMPORARY}"))
    }
}

fn failed(path: &Path, doing: &'static str, source: io::Error) -> StoreError {
    StoreError { path: path.to_owned(), doing, source }
}

fn entries(folder: &Path) -> impl Iterator<Item = (PathBuf, fs::FileType)> {
    let found = fs::read_dir(folder).into_iter().flatten().flatten();
    found.filter_map(|e| e.file_type().ok().map(|kind| (e.path(), kind)))
}

fn age(path: &Path) -> Option<Duration> {
    fs::metadata(path).ok()?.modified().ok()?.elapsed().ok()
}

/// Whether a temporary file is one that nobody writes to any more: its process ended, or if that cannot be seen from here,
/// it is old.
fn is_leftover(path: &Path) -> bool {
    let Some(name) = path.file_name().and_then(|n| n.to_str()).filter(|n| n.ends_with(TEMPORARY)) else { return false };
    match writer_of(name).and_then(|process| process.has_ended()) {
        Some(ended) => ended,
        None => age(path).is_some_and(|a| a > ABANDONED),
    }
}

/// The process that made a temporary file, as its name says.
fn writer_of(name: &str) -> Option<Process> {
    let mut parts = name.rsplit('.').skip(2);
    let (pid, started) = parts.next()?.split_once('-')?;
    let (pid, started) = (pid.parse().ok()?, started.parse().ok()?);
    let (system, host) = (parts.next()?.to_owned(), parts.next()?.to_owned());
    Some(Process { host, system, pid, started })
}

/// A file on its way, and the hash of what was written to it so far.
pub(crate) struct Hashing {
    file: File,
    hasher: blake3::Hasher,
}

impl Write for Hashing {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.file.write(bytes)?;
        self.hasher.update(bytes.get(..written).unwrap_or_default());
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

fn copy_all(from: &mut File, to: &mut impl Write) -> io::Result<()> {
    let mut piece = vec![0; PIECE];
    loop {
        match from.read(&mut piece) {
            Ok(0) => return Ok(()),
            Ok(n) => to.write_all(piece.get(..n).unwrap_or_default())?,
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
}

/// Whether this is the name of a temporary file of ours.
pub(crate) fn is_temporary(name: &std::ffi::OsStr) -> bool {
    Path::new(name).extension().is_some_and(|e| e == TEMPORARY)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::disk::System;

    fn store() -> (tempfile::TempDir, Store) {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        (folder, store)
    }

    #[test]
    fn a_write_that_fails_leaves_the_old_file_and_nothing_else() {
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

    /// Writes down what is asked of the system, and does it.
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
    fn a_result_is_written_whole_then_synced_then_renamed_and_its_folder_is_synced_last() {
        let (folder, store) = store();
        let notes = std::sync::Arc::default();
        let store = Store { disk: Box::new(Recorder(std::sync::Arc::clone(&notes))), ..store };
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
        // The system refuses to sync what lies on no disk, so that a sync that asks nothing is noticed.
        let null = File::open("/dev/null").unwrap();
        assert_eq!(System.sync(&null, Path::new("null")).unwrap_err().kind(), io::ErrorKind::InvalidInput);
        assert_eq!(System.sync_folder(Path::new("/nowhere")).unwrap_err().kind(), io::ErrorKind::NotFound);
    }

    #[test]
    fn a_reader_of_the_old_file_goes_on_reading_the_old_content() {
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
    fn leftovers_of_a_dead_process_go_and_files_of_a_live_one_stay() {
        let (folder, store) = store();
        let Process { host, system, pid, started } = Process::this();
        let name = |pid: u32, started: u64| format!(".record.json.{host}.{system}.{pid}-{started}.0-1f.{TEMPORARY}");
        // No process has a number above the largest that Linux allows, 2^22.
        fs::create_dir(folder.path().join("by-key")).unwrap();
        fs::write(folder.path().join("by-key").join(name(99_999_999, 1)), "half").unwrap();
        fs::write(folder.path().join(name(*pid, started + 1)), "of an earlier process with this number").unwrap();
        fs::write(folder.path().join(name(*pid, *started)), "in work").unwrap();
        fs::write(folder.path().join("notes.txt"), "mine").unwrap();
        assert_eq!(store.clean(), 2);
        assert!(folder.path().join(name(*pid, *started)).exists() && folder.path().join("notes.txt").exists());
    }

    #[test]
    fn a_fresh_temporary_file_of_another_container_stays_and_an_old_one_goes() {
        let (folder, store) = store();
        // The same host name and process number, as two containers of one image have.
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
    fn a_file_is_as_it_was_kept_until_a_byte_of_it_changes() {
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
        // As if no time of the file had changed.
        kept.stamp = FileStamp::of(&path).unwrap();
        assert!(
            store.is_as_kept("a.bin", &mut kept, Check::Quick) && !store.is_as_kept("a.bin", &mut kept, Check::Full)
        );
    }

    #[test]
    fn a_sealed_note_comes_back_and_a_changed_one_does_not() {
        let (folder, store) = store();
        store.write_sealed("note.json", &vec![1, 2, 3]).unwrap();
        assert_eq!(store.read_sealed::<Vec<i32>>("note.json"), Some(vec![1, 2, 3]));
        let text = fs::read_to_string(folder.path().join("note.json")).unwrap();
        assert_eq!(serde_json::from_str::<serde_json::Value>(&text).unwrap()["content"][1], 2);
        fs::write(folder.path().join("note.json"), text.replace("1,2,3", "1,2,4")).unwrap();
        assert_eq!(store.read_sealed::<Vec<i32>>("note.json"), None);
    }

    #[test]
    fn a_folder_that_cannot_be_written_is_refused_before_any_work() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("report");
        fs::write(&file, "a file").unwrap();
        let error = Store::open(&file).unwrap_err();
        assert!(error.to_string().contains("report"), "{error}");
    }
}
