//! The one place where outputs are written.
//!
//! Every write goes to a temporary name in the file's own folder, is synced, and renamed over the
//! final name: a file is absent, the old one, or the new one, whole. The folder is not synced:
//! a power cut may take back a name, never leave one without its content, and what is missing
//! is made again. (Syncing folders too made a campaign of small flights wait for the disk as long as it computed.)
//! A plain rename, because NFS knows no `RENAME_NOREPLACE`; a second writer of a result writes
//! the same bytes, so that it does not matter who comes last.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Component, Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, SystemTime};

/// Ends the name of a temporary file, `.name.host.pid.number.flightlag-tmp`.
const TEMPORARY: &str = "flightlag-tmp";

/// Temporary files of other hosts are taken for leftovers after this time.
const ABANDONED: Duration = Duration::from_secs(24 * 3600);

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
    /// Synced before the rename: results, and the memory of what is done.
    Synced,
    /// Renamed only: pages, whose sizes are checked at the next run and which can be made again.
    Renewable,
}

/// An output folder.
#[derive(Debug)]
pub(crate) struct Store {
    root: PathBuf,
    host: String,
    number: AtomicU64,
}

impl Store {
    /// Opens the folder, makes it if it is missing, and shows by a test file that it can be written to.
    pub(crate) fn open(root: &Path) -> Result<Store, StoreError> {
        fs::create_dir_all(root).map_err(|e| failed(root, "make this folder", e))?;
        let store = Store { root: root.to_owned(), host: host_name(), number: AtomicU64::new(0) };
        let probe = store.temporary_name(&root.join("probe"));
        let written = fs::write(&probe, b"flightlag\n").map_err(|e| failed(root, "write to this folder", e));
        let removed = fs::remove_file(&probe).map_err(|e| failed(&probe, "remove", e));
        written.and(removed).map(|()| store)
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
    pub(crate) fn write(&self, name: &str, bytes: &[u8], keep: Keep) -> Result<(), StoreError> {
        self.write_with(name, keep, |file| file.write_all(bytes))
    }

    /// Writes a file whole, whose content `fill` makes.
    pub(crate) fn write_with(
        &self,
        name: &str,
        keep: Keep,
        fill: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
    ) -> Result<(), StoreError> {
        self.place(name, keep, |temporary| {
            let mut file = BufWriter::new(File::create_new(temporary).map_err(|e| failed(temporary, "make", e))?);
            fill(&mut file).and_then(|()| file.flush()).map_err(|e| failed(temporary, "write", e))?;
            match keep {
                Keep::Synced => file.get_ref().sync_all().map_err(|e| failed(temporary, "sync", e)),
                Keep::Renewable => Ok(()),
            }
        })
    }

    /// Puts the file `from` also under `name`: a hard link, or a copy where there are none.
    pub(crate) fn link(&self, from: &str, name: &str) -> Result<(), StoreError> {
        let from = self.path(from)?;
        self.place(name, Keep::Renewable, |temporary| {
            let linked = fs::hard_link(&from, temporary).or_else(|_| fs::copy(&from, temporary).map(drop));
            linked.map_err(|e| failed(&from, "link", e))
        })
    }

    /// Size of an output, if it is there.
    pub(crate) fn size(&self, name: &str) -> Option<u64> {
        let found = fs::metadata(self.path(name).ok()?).ok()?;
        found.is_file().then_some(found.len())
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
            false => u64::from(self.is_leftover(&path) && fs::remove_file(&path).is_ok()),
        };
        entries(folder).map(of_entry).sum()
    }

    /// Whether the process that wrote this temporary file is gone.
    fn is_leftover(&self, path: &Path) -> bool {
        let Some(name) = path.file_name().and_then(|n| n.to_str()) else { return false };
        let mut parts = name.rsplit('.');
        if parts.next() != Some(TEMPORARY) {
            return false;
        }
        let (_number, pid, host) = (parts.next(), parts.next(), parts.next());
        match host == Some(self.host.as_str()) {
            true => !pid.is_some_and(|p| p == std::process::id().to_string() || is_alive(p)),
            false => age(path).is_some_and(|a| a > ABANDONED),
        }
    }

    /// Lets `make` fill a temporary file beside `name` and renames it into place.
    fn place(
        &self,
        name: &str,
        keep: Keep,
        make: impl FnOnce(&Path) -> Result<(), StoreError>,
    ) -> Result<(), StoreError> {
        let path = self.path(name)?;
        let folder = path.parent().unwrap_or(&self.root);
        fs::create_dir_all(folder).map_err(|e| failed(folder, "make this folder", e))?;
        let temporary = self.temporary_name(&path);
        let placed =
            make(&temporary).and_then(|()| fs::rename(&temporary, &path).map_err(|e| failed(&path, "rename", e)));
        if let Err(error) = placed {
            let _ = fs::remove_file(&temporary);
            // People know the file by its final name.
            return Err(StoreError { path, ..error });
        }
        // Renaming one hard link of a file over another does nothing and leaves both.
        if keep == Keep::Renewable {
            let _ = fs::remove_file(&temporary);
        }
        Ok(())
    }

    /// A name in the same folder that nobody else uses: pids repeat across hosts, so the host is part of it.
    fn temporary_name(&self, path: &Path) -> PathBuf {
        let base = path.file_name().unwrap_or_default().to_string_lossy();
        let short: String = base.chars().take(40).collect();
        let (pid, number) = (std::process::id(), self.number.fetch_add(1, Ordering::Relaxed));
        let salt = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default().subsec_nanos();
        path.with_file_name(format!(".{short}.{}.{pid}.{number}-{salt:x}.{TEMPORARY}", self.host))
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

/// Whether a process of this host lives. Where there is no `/proc`, every one is taken to be dead:
/// the lock of the output folder then says whether a run is on.
fn is_alive(pid: &str) -> bool {
    pid.bytes().all(|b| b.is_ascii_digit()) && Path::new("/proc").join(pid).exists()
}

/// Whether this is the name of a temporary file of ours.
pub(crate) fn is_temporary(name: &std::ffi::OsStr) -> bool {
    Path::new(name).extension().is_some_and(|e| e == TEMPORARY)
}

/// Name of this machine, without characters that separate parts of a temporary name.
pub(crate) fn host_name() -> String {
    let from_kernel = fs::read_to_string("/proc/sys/kernel/hostname").ok();
    let name = from_kernel.or_else(|| std::env::var("HOSTNAME").ok()).unwrap_or_default();
    let plain: String = name.trim().chars().filter(|c| c.is_ascii_alphanumeric() || *c == '-').take(40).collect();
    if plain.is_empty() { "host".to_owned() } else { plain }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn store() -> (tempfile::TempDir, Store) {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        (folder, store)
    }

    #[test]
    fn a_write_that_fails_leaves_the_old_file_and_nothing_else() {
        let (folder, store) = store();
        store.write("a/record.json", b"old", Keep::Synced).unwrap();
        let disk_full = |f: &mut BufWriter<File>| {
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

    #[test]
    fn leftovers_of_a_dead_process_go_and_files_of_a_live_one_stay() {
        let (folder, store) = store();
        let name = |pid: &str| format!(".record.json.{}.{pid}.0-1f.{TEMPORARY}", host_name());
        // No process has a number above the largest that Linux allows, 2^22.
        fs::create_dir(folder.path().join("by-key")).unwrap();
        fs::write(folder.path().join("by-key").join(name("99999999")), "half").unwrap();
        fs::write(folder.path().join(name("1")), "in work").unwrap();
        fs::write(folder.path().join("notes.txt"), "mine").unwrap();
        assert_eq!(store.clean(), 1);
        assert!(folder.path().join(name("1")).exists() && folder.path().join("notes.txt").exists());
    }

    #[test]
    fn linking_twice_leaves_one_file_and_no_temporary() {
        let (_folder, store) = store();
        store.write("by-key/record.json", b"r", Keep::Synced).unwrap();
        store.link("by-key/record.json", "flights/a/record.json").unwrap();
        store.link("by-key/record.json", "flights/a/record.json").unwrap();
        assert_eq!(store.list("flights"), ["flights/a/record.json", "flights/a", "flights"]);
        assert_eq!(store.read("flights/a/record.json").unwrap().unwrap(), b"r");
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
