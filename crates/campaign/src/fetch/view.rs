//! The objects below a prefix as local files: names and sizes always, content only while being read.

use super::cache::Cache;
use crate::error::CampaignError;
use crate::error::StoreError;
use crate::file_stamp::FileStamp;
use crate::s3::{Bucket, Object};
use crate::work::Workers;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::SystemTime;

/// Size of the start of a log that ingest needs to recognise it, bytes.
const HEAD: u64 = 64 << 10;
/// The same for compressed logs: a block of the supported compressions is smaller.
const PACKED_HEAD: u64 = 2 << 20;
/// Texts up to this size are read completely with the heads, bytes: test cards, and the metadata of a bag.
const TEXT: u64 = 1 << 20;
const PACKED: [&str; 5] = ["gz", "zst", "zstd", "bz2", "lz4"];

/// A local folder, or file, that represents the objects below an address.
pub(crate) struct View {
    bucket: Bucket,
    cache: &'static Cache,
    /// The address.
    shown: PathBuf,
    /// Folder of this view alone; removed with it.
    own: PathBuf,
    /// Local path that represents the address.
    root: PathBuf,
    /// Objects by local path, from the last listing.
    objects: Mutex<BTreeMap<PathBuf, Object>>,
    /// Number of readers of each local file.
    readers: Mutex<BTreeMap<PathBuf, Arc<Mutex<usize>>>>,
    /// Whether the heads are fetched.
    has_heads: AtomicBool,
    /// Archives with their directory at the end, kept complete until the heads are dropped.
    whole: Mutex<Vec<PathBuf>>,
}

impl Drop for View {
    fn drop(&mut self) {
        // If this fails, the next process removes it.
        let _ = fs::remove_dir_all(&self.own);
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl View {
    /// A view without any known file yet.
    pub(super) fn empty(address: &Path) -> Result<View, CampaignError> {
        let failed = |doing| move |source| StoreError { path: address.to_owned(), doing, source };
        let bucket = Bucket::of_url(address).map_err(failed("use"))?;
        let cache = Cache::open().map_err(failed("read"))?;
        let own = cache.new_view().map_err(failed("make a local folder for"))?;
        let text = address.to_str().unwrap_or_default().trim_end_matches('/');
        let shown = PathBuf::from(text);
        let root = own.join(shown.file_name().unwrap_or_default());
        let view = View {
            bucket,
            cache,
            shown,
            own,
            root,
            objects: Mutex::default(),
            readers: Mutex::default(),
            has_heads: AtomicBool::new(false),
            whole: Mutex::default(),
        };
        Ok(view)
    }

    /// A view of all objects below an address, or of the one object at it.
    pub(super) fn listed(address: &Path) -> Result<View, CampaignError> {
        let view = View::empty(address)?;
        let failed = |doing| move |source| StoreError { path: address.to_owned(), doing, source };
        let mut found = view.bucket.list("").map_err(failed("list"))?;
        if found.is_empty() {
            let one = view.bucket.describe("").map_err(failed("read the status of"))?;
            found.extend(one.map(|object| (String::new(), object)));
        }
        if found.is_empty() {
            let what = "no object has this name or this prefix";
            return Err(CampaignError::Asked(format!("{}: {what}", address.display())));
        }
        let above: BTreeSet<String> = found.iter().flat_map(|(name, _)| folders_of(name)).collect();
        // Some programs mark a folder with an empty object of its name.
        found.retain(|(name, object)| object.bytes > 0 || !above.contains(name));
        if let Some((name, _)) = found.iter().find(|(name, _)| above.contains(name)) {
            let what = "is both an object and a prefix of others; no file can be both";
            return Err(CampaignError::Asked(format!("{}: {what}", view.bucket.url_of(name))));
        }
        for (name, object) in found {
            view.add(&name, object).map_err(|source| {
                let path = PathBuf::from(view.bucket.url_of(&name));
                StoreError { path, doing: "make a local file for", source }
            })?;
        }
        Ok(view)
    }

    fn add(&self, name: &str, object: Object) -> io::Result<()> {
        let local = if name.is_empty() { self.root.clone() } else { self.root.join(name) };
        make_stub(&local, object.bytes)?;
        let is_settings = local.extension().is_some_and(|ending| ending == "toml") && object.bytes <= TEXT;
        if is_settings {
            self.write_head(&local, &object, object.bytes)?;
        }
        locked(&self.objects).insert(local, object);
        Ok(())
    }

    pub(super) fn root(&self) -> &Path {
        &self.root
    }

    /// Whether a local file belongs to this view.
    pub(super) fn has(&self, local: &Path) -> bool {
        local.starts_with(&self.root)
    }

    /// Name of the object below the address.
    fn name_of(&self, local: &Path) -> String {
        local.strip_prefix(&self.root).unwrap_or(Path::new("")).to_string_lossy().into_owned()
    }

    pub(super) fn shown(&self, local: &Path) -> PathBuf {
        match local.strip_prefix(&self.root) {
            Ok(below) if below.as_os_str().is_empty() => self.shown.clone(),
            Ok(below) => self.shown.join(below),
            Err(_) => local.to_owned(),
        }
    }

    pub(super) fn local(&self, shown: &Path) -> PathBuf {
        match shown.strip_prefix(&self.shown) {
            Ok(below) if below.as_os_str().is_empty() => self.root.clone(),
            Ok(below) => self.root.join(below),
            Err(_) => shown.to_owned(),
        }
    }

    pub(super) fn with_shown_names(&self, text: &str) -> String {
        text.replace(&*self.root.to_string_lossy(), &self.shown.to_string_lossy())
    }

    pub(super) fn listing(&self) -> String {
        let objects = locked(&self.objects);
        let line = |(local, object): (&PathBuf, &Object)| {
            format!("{}\0{}\0{}\n", self.name_of(local), object.bytes, object.tag)
        };
        objects.iter().map(line).collect()
    }

    fn object(&self, local: &Path) -> io::Result<Object> {
        let known = locked(&self.objects).get(local).cloned();
        known.map_or_else(|| self.look_at(local), Ok)
    }

    fn look_at(&self, local: &Path) -> io::Result<Object> {
        let gone = || io::Error::new(io::ErrorKind::NotFound, "the object no longer exists");
        let object = self.bucket.describe(&self.name_of(local))?.ok_or_else(gone)?;
        locked(&self.objects).insert(local.to_owned(), object.clone());
        Ok(object)
    }

    pub(super) fn stamp(&self, local: &Path) -> io::Result<FileStamp> {
        self.object(local).map(|object| object.stamp())
    }

    pub(super) fn stamp_now(&self, local: &Path) -> io::Result<FileStamp> {
        self.look_at(local).map(|object| object.stamp())
    }

    pub(super) fn modified(&self, local: &Path) -> Option<SystemTime> {
        self.object(local).ok().map(|object| object.modified)
    }

    /// Writes the first bytes of an object into its local file.
    fn write_head(&self, local: &Path, object: &Object, bytes: u64) -> io::Result<Vec<u8>> {
        let bytes = bytes.min(object.bytes);
        if bytes == 0 {
            return Ok(vec![]);
        }
        let head = self.bucket.read_piece(&self.name_of(local), &object.tag, 0..bytes)?;
        File::options().write(true).open(local)?.write_all(&head)?;
        Ok(head)
    }

    pub(super) fn fetch_heads(&self, threads: usize, cancel: &AtomicBool) -> Result<(), CampaignError> {
        if self.has_heads.swap(true, Ordering::Relaxed) {
            return Ok(());
        }
        let objects: Vec<(PathBuf, Object)> =
            locked(&self.objects).iter().map(|(path, object)| (path.clone(), object.clone())).collect();
        let fetch = |(): &mut (), (local, object): &(PathBuf, Object)| self.fetch_head(local, object, cancel);
        let answers = Workers::start(threads)?.each(&objects, cancel, || (), fetch);
        for ((local, _), answer) in objects.iter().zip(answers) {
            match answer {
                Some(Ok(())) => {}
                None => return Err(CampaignError::Cancelled),
                Some(Err(e)) if e.kind() == io::ErrorKind::Interrupted => return Err(CampaignError::Cancelled),
                Some(Err(source)) => {
                    return Err(StoreError { path: self.shown(local), doing: "read the beginning of", source }.into());
                }
            }
        }
        Ok(())
    }

    fn fetch_head(&self, local: &Path, object: &Object, cancel: &AtomicBool) -> io::Result<()> {
        let ending = local.extension().map(|ending| ending.to_string_lossy().to_lowercase()).unwrap_or_default();
        let bytes = match ending.as_str() {
            "yaml" | "toml" => TEXT,
            ending if PACKED.contains(&ending) => PACKED_HEAD,
            _ => HEAD,
        };
        let head = self.write_head(local, object, bytes)?;
        let packed: [&[u8]; 4] = [b"\x1f\x8b", b"\x28\xb5\x2f\xfd", b"BZh", b"\x04\x22\x4d\x18"];
        if packed.iter().any(|magic| head.starts_with(magic)) && bytes < PACKED_HEAD {
            self.write_head(local, object, PACKED_HEAD)?;
        } else if head.starts_with(b"PK") {
            // A ZIP archive has its directory at the end.
            self.hold(local, cancel)?;
            locked(&self.whole).push(local.to_owned());
        }
        Ok(())
    }

    pub(super) fn drop_heads(&self) {
        if !self.has_heads.swap(false, Ordering::Relaxed) {
            return;
        }
        for local in std::mem::take(&mut *locked(&self.whole)) {
            self.release(&local);
        }
        for (local, object) in locked(&self.objects).iter() {
            let is_read = self.reader_of(local).try_lock().map_or(true, |count| *count > 0);
            if !is_read {
                // If it stays, it only uses space.
                let _ = make_stub(local, object.bytes);
            }
        }
    }

    fn reader_of(&self, local: &Path) -> Arc<Mutex<usize>> {
        Arc::clone(locked(&self.readers).entry(local.to_owned()).or_default())
    }

    /// Fetches the content of a local file, and keeps it until the returned value is dropped.
    pub(super) fn bring(&self, local: &Path, cancel: &AtomicBool) -> io::Result<Brought<'_>> {
        self.hold(local, cancel)?;
        Ok(Brought { view: self, local: local.to_owned() })
    }

    /// Fetches the content of a local file, and keeps it until released as often as held.
    fn hold(&self, local: &Path, cancel: &AtomicBool) -> io::Result<()> {
        let readers = self.reader_of(local);
        let mut count = locked(&readers);
        if *count == 0 {
            let object = self.object(local)?;
            if let Some(folder) = local.parent() {
                fs::create_dir_all(folder)?;
            }
            let name = self.name_of(local);
            self.cache.put((&self.bucket, &name, &object), local, cancel)?;
        }
        *count += 1;
        Ok(())
    }

    fn release(&self, local: &Path) {
        let readers = self.reader_of(local);
        let mut count = locked(&readers);
        *count = count.saturating_sub(1);
        if *count == 0 {
            let bytes = locked(&self.objects).get(local).map_or(0, |object| object.bytes);
            // A copy that stays uses space until the end of this process.
            let _ = make_stub(local, bytes);
        }
    }
}

/// A local file that has its content until this is dropped.
pub(crate) struct Brought<'a> {
    view: &'a View,
    local: PathBuf,
}

impl Drop for Brought<'_> {
    fn drop(&mut self) {
        self.view.release(&self.local);
    }
}

/// Replaces a file by a sparse one of this size.
fn make_stub(local: &Path, bytes: u64) -> io::Result<()> {
    if let Some(folder) = local.parent() {
        fs::create_dir_all(folder)?;
    }
    match fs::remove_file(local) {
        Err(e) if e.kind() != io::ErrorKind::NotFound => return Err(e),
        _ => {}
    }
    File::create_new(local)?.set_len(bytes)
}

fn folders_of(name: &str) -> Vec<String> {
    name.match_indices('/').filter_map(|(at, _)| name.get(..at)).map(str::to_owned).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_of_a_name_are_listed_from_the_outermost() {
        assert_eq!(folders_of("2026/05/a.mcap"), ["2026", "2026/05"]);
        assert_eq!(folders_of("a.mcap"), [""; 0]);
    }
}
