//! Outputs in a folder.
//!
//! Every write goes to a temporary name in the file's own folder, is synced, and renamed to the
//! final name. For results the folder is synced too.
//! The rename is a plain one, because NFS does not support `RENAME_NOREPLACE`. A second writer of a
//! result writes the same bytes, so the order does not matter.

use super::{Fill, Hashing, Keep, Kept, Only, Sink, Storage, failed};
use crate::disk::{Disk, disk};
use crate::error::StoreError;
use crate::file_stamp::FileStamp;
use crate::process::Process;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, SystemTime};

/// Suffix of a temporary file, `.name.host.system.pid-start.number.flightlag-tmp`.
pub(super) const TEMPORARY: &str = "flightlag-tmp";

/// Temporary files of other hosts and containers count as leftovers after this time.
pub(super) const ABANDONED: Duration = Duration::from_secs(24 * 3600);

/// Size of the buffer for copying and hashing files, bytes.
const PIECE: usize = 1 << 16;

/// An output folder.
#[derive(Debug)]
pub(super) struct Folder {
    pub(super) root: PathBuf,
    pub(super) disk: Box<dyn Disk>,
}

impl Folder {
    /// Opens the folder, creates it if missing, and checks with a test file that it is writable.
    pub(super) fn open(root: &Path) -> Result<Folder, StoreError> {
        fs::create_dir_all(root).map_err(|e| failed(root, "make this folder", e))?;
        let probe = temporary_name(&root.join("probe"));
        let written = fs::write(&probe, b"flightlag\n").map_err(|e| failed(root, "write to this folder", e));
        let removed = fs::remove_file(&probe).map_err(|e| failed(&probe, "remove", e));
        written.and(removed).map(|()| Folder::to_read(root))
    }

    /// An existing folder. Does not test whether it is writable.
    pub(super) fn to_read(root: &Path) -> Folder {
        Folder { root: root.to_owned(), disk: disk() }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.root.join(name)
    }

    fn place(&self, temporary: &Path, path: &Path, keep: Keep, fill: Fill<'_>) -> Result<Kept, StoreError> {
        let file = self.disk.create(temporary).map_err(|e| failed(temporary, "make", e))?;
        let mut file = Hashing::new(Sink::File(file));
        fill(&mut file).and_then(|()| file.flush()).map_err(|e| failed(temporary, "write", e))?;
        if let (true, Sink::File(file)) = (keep != Keep::Renewable, &file.get_ref().sink) {
            self.disk.sync(file, temporary).map_err(|e| failed(temporary, "sync", e))?;
        }
        self.disk.rename(temporary, path).map_err(|e| failed(path, "rename", e))?;
        if keep == Keep::Synced {
            self.sync_folder_of(path)?;
        }
        let stamp = FileStamp::of(path).map_err(|e| failed(path, "read the status of", e))?;
        Ok(Kept { stamp, blake3: file.get_ref().blake3() })
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
}

impl Storage for Folder {
    fn read(&self, name: &str) -> io::Result<Option<Vec<u8>>> {
        found(fs::read(self.path(name)))
    }

    fn hash(&self, name: &str) -> io::Result<String> {
        let mut file = File::open(self.path(name))?;
        let mut hasher = blake3::Hasher::new();
        copy_all(&mut file, &mut hasher)?;
        Ok(hasher.finalize().to_hex().to_string())
    }

    fn put(&self, name: &str, keep: Keep, _only: Only, fill: Fill<'_>) -> Result<Option<Kept>, StoreError> {
        let path = self.path(name);
        self.make_folder_of(&path, keep)?;
        let temporary = temporary_name(&path);
        let placed = self.place(&temporary, &path, keep, fill);
        placed.map(Some).map_err(|error| {
            let _ = fs::remove_file(&temporary);
            // Errors name the file as users know it: by its final name.
            StoreError { path, ..error }
        })
    }

    fn describe(&self, name: &str) -> io::Result<Option<FileStamp>> {
        found(FileStamp::of(&self.path(name)))
    }

    fn describe_all(&self) -> io::Result<Option<BTreeMap<String, FileStamp>>> {
        Ok(None)
    }

    fn age(&self, name: &str) -> Option<Duration> {
        age(&self.path(name))
    }

    fn remove(&self, name: &str) -> io::Result<()> {
        found(fs::remove_file(self.path(name))).map(drop)
    }

    fn list(&self, folder: &str) -> io::Result<Vec<String>> {
        let (mut files, mut folders) = (vec![], vec![]);
        self.collect(&self.path(folder), folder, &mut files, &mut folders);
        files.append(&mut folders);
        Ok(files)
    }

    fn files_of_root(&self) -> Vec<String> {
        let files = entries(&self.root).filter(|(_, kind)| kind.is_file());
        files.filter_map(|(path, _)| path.file_name()?.to_str().map(str::to_owned)).collect()
    }

    fn remove_empty_folder(&self, name: &str) {
        // Fails if it contains files that are not ours, which stay.
        let _ = fs::remove_dir(self.path(name));
    }

    fn clean(&self) -> u64 {
        clean_folder(&self.root)
    }
}

fn found<T>(answer: io::Result<T>) -> io::Result<Option<T>> {
    match answer {
        Ok(found) => Ok(Some(found)),
        Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(e) => Err(e),
    }
}

/// Removes abandoned temporary files below a folder; returns their number.
pub(crate) fn clean_folder(folder: &Path) -> u64 {
    let of_entry = |(path, kind): (PathBuf, fs::FileType)| match kind.is_dir() {
        true => clean_folder(&path),
        false => u64::from(is_leftover(&path) && fs::remove_file(&path).is_ok()),
    };
    entries(folder).map(of_entry).sum()
}

/// A name in the same folder that no other process uses.
pub(crate) fn temporary_name(path: &Path) -> PathBuf {
    static NUMBER: AtomicU64 = AtomicU64::new(0);
    let base = path.file_name().unwrap_or_default().to_string_lossy();
    let short: String = base.chars().take(40).collect();
    let Process { host, system, pid, started } = Process::this();
    let number = NUMBER.fetch_add(1, Ordering::Relaxed);
    let salt = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default().subsec_nanos();
    path.with_file_name(format!(".{short}.{host}.{system}.{pid}-{started}.{number}-{salt:x}.{TEMPORARY}"))
}

pub(crate) fn entries(folder: &Path) -> impl Iterator<Item = (PathBuf, fs::FileType)> {
    let found = fs::read_dir(folder).into_iter().flatten().flatten();
    found.filter_map(|e| e.file_type().ok().map(|kind| (e.path(), kind)))
}

fn age(path: &Path) -> Option<Duration> {
    fs::metadata(path).ok()?.modified().ok()?.elapsed().ok()
}

/// Whether a temporary file or folder is abandoned: its process has ended, or if that is not visible from here, it is
/// old.
pub(crate) fn is_leftover(path: &Path) -> bool {
    let Some(name) = path.file_name().and_then(|n| n.to_str()).filter(|n| n.ends_with(TEMPORARY)) else { return false };
    match writer_of(name).and_then(|process| process.has_ended()) {
        Some(ended) => ended,
        None => age(path).is_some_and(|a| a > ABANDONED),
    }
}

/// The process that made a temporary file, parsed from its name.
fn writer_of(name: &str) -> Option<Process> {
    let mut parts = name.rsplit('.').skip(2);
    let (pid, started) = parts.next()?.split_once('-')?;
    let (pid, started) = (pid.parse().ok()?, started.parse().ok()?);
    let (system, host) = (parts.next()?.to_owned(), parts.next()?.to_owned());
    Some(Process { host, system, pid, started })
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

/// Whether this is the name of one of our temporary files.
pub(crate) fn is_temporary(name: &std::ffi::OsStr) -> bool {
    Path::new(name).extension().is_some_and(|e| e == TEMPORARY)
}
