//! Tables in a folder: all of them appear together, or none.

use crate::error::ConvertError;
use crate::guard::{is_of_log, may_write};
use crate::leftover::{claim, folder_of, is_abandoned, temporaries_of, temporary_name};
use crate::swap::exchange;
use ingest::ReadContext;
use serde::Serialize;
use serde_json::Value;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// Comes last: a folder with it is whole.
pub(super) const PROVENANCE: &str = "provenance.json";

/// Held by the run that writes; absent from a folder that is whole.
const LOCK: &str = ".lock";

/// Tables on the way to their folder: gone if it is dropped before.
pub(super) struct Folder {
    path: PathBuf,
    /// Folders above it that were not there, the nearest first.
    made: Vec<PathBuf>,
    /// Beside the folder, until it takes its place.
    staging: PathBuf,
    _lock: File,
    /// Names of what is written, in order.
    names: Vec<String>,
    is_kept: bool,
}

impl Folder {
    /// Begins tables that will be in `path`, if nothing of the log stands in their way. Removes what killed runs left.
    pub(super) fn begin(path: &Path, places: &[String], log: &[PathBuf]) -> Result<Folder, ConvertError> {
        for place in places.iter().map(String::as_str).chain([PROVENANCE]) {
            may_write(&path.join(place), log)?;
        }
        if let Some(table) = earlier(path).into_iter().find(|table| is_of_log(table, log)) {
            let what = "a table of an earlier export that is also the log; it would be removed; name another folder";
            return Err(ConvertError::Refused { path: table, what: what.to_owned() });
        }
        // Of a link, the folder that it leads to is meant.
        let path = path.canonicalize().unwrap_or_else(|_| path.to_owned());
        let above = folder_of(&path).to_owned();
        let made =
            above.ancestors().take_while(|p| !p.as_os_str().is_empty() && !p.exists()).map(Path::to_owned).collect();
        fs::create_dir_all(&above).map_err(ConvertError::write(&above, "make this folder"))?;
        clear_leftovers(&path);
        let staging = if can_be_swapped(&path) { temporary_name(&path) } else { temporary_name(&path.join("tables")) };
        let lock = fs::create_dir(&staging).and_then(|()| File::create_new(staging.join(LOCK)));
        let lock = lock.map_err(ConvertError::write(folder_of(&staging), "write to this folder"))?;
        claim(&lock);
        Ok(Folder { path, made, staging, _lock: lock, names: vec![], is_kept: false })
    }

    /// Writes a file.
    pub(super) fn write(
        &mut self,
        name: &str,
        context: &ReadContext<'_>,
        fill: impl FnOnce(&mut BufWriter<Heeding<'_>>) -> io::Result<()>,
    ) -> Result<(), ConvertError> {
        let written = File::create_new(self.staging.join(name)).and_then(|file| {
            let mut file = BufWriter::new(Heeding { file, context });
            fill(&mut file)?;
            file.into_inner().map_err(io::IntoInnerError::into_error)?.file.sync_all()
        });
        let place = self.path.join(name);
        written.map_err(|e| ConvertError::write(&place, "write")(e).or_stopped(context))?;
        self.names.push(name.to_owned());
        Ok(())
    }

    /// Writes the provenance and puts everything in its place. The tables of an earlier export go in the same step; what
    /// somebody else put into the folder stays.
    pub(super) fn keep(mut self, provenance: &impl Serialize, context: &ReadContext<'_>) -> Result<(), ConvertError> {
        self.write(PROVENANCE, context, |file| {
            serde_json::to_writer_pretty(&mut *file, provenance)?;
            file.write_all(b"\n")
        })?;
        fs::remove_file(self.staging.join(LOCK)).map_err(ConvertError::write(&self.path, "write"))?;
        let failed = || ConvertError::write(&self.path, "rename to");
        if !self.path.exists() {
            fs::rename(&self.staging, &self.path).map_err(failed())?;
        } else if can_be_swapped(&self.path) && self.swap().is_ok() {
            give_back(&self.staging, &self.path);
        } else {
            self.place_one_by_one()?;
        }
        self.is_kept = true;
        Ok(())
    }

    /// The new folder takes the place of the old one. What others have in the old one is linked into the new one before, so
    /// that it is there at any moment.
    fn swap(&self) -> io::Result<()> {
        let tables: Vec<PathBuf> = earlier(&self.path).into_iter().chain([self.path.join(PROVENANCE)]).collect();
        for entry in fs::read_dir(&self.path)? {
            let entry = entry?;
            if !tables.contains(&entry.path()) && !self.staging.join(entry.file_name()).exists() {
                // Of a folder there is no such link.
                fs::hard_link(entry.path(), self.staging.join(entry.file_name()))?;
            }
        }
        fs::set_permissions(&self.staging, fs::metadata(&self.path)?.permissions())?;
        exchange(&self.staging, &self.path)
    }

    /// Where the folder cannot be swapped: first the old tables go, the provenance comes last. A folder with it is whole.
    fn place_one_by_one(&self) -> Result<(), ConvertError> {
        remove_earlier(&self.path)?;
        let mut placed = vec![];
        for name in &self.names {
            let place = self.path.join(name);
            if let Err(e) = fs::rename(self.staging.join(name), &place) {
                // What cannot be removed has no provenance beside it.
                placed.iter().for_each(|table: &PathBuf| drop(fs::remove_file(table)));
                return Err(ConvertError::write(&place, "rename to")(e));
            }
            placed.push(place);
        }
        let _ = fs::remove_dir_all(&self.staging);
        Ok(())
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        if !self.is_kept {
            let _ = fs::remove_dir_all(&self.staging);
            // Not if somebody has put something into them.
            self.made.iter().for_each(|folder| drop(fs::remove_dir(folder)));
        }
    }
}

/// Not a mount point's or the user's own working folder: who stands in it would stay in the old one.
fn can_be_swapped(path: &Path) -> bool {
    let here = std::env::current_dir().and_then(|here| here.canonicalize());
    path.file_name().is_some() && !here.is_ok_and(|here| here.starts_with(path))
}

/// Removes what killed runs left beside the folder. What others had in an old folder goes back to where it was.
fn clear_leftovers(path: &Path) {
    for leftover in temporaries_of(path).into_iter().chain(temporaries_of(&path.join("tables"))) {
        let lock = leftover.join(LOCK);
        match (leftover.is_dir(), lock.exists()) {
            (true, true) if is_abandoned(&lock) => drop(fs::remove_dir_all(&leftover)),
            (true, false) => give_back(&leftover, path),
            _ => {}
        }
    }
}

/// Of an old folder, removes the tables that its provenance lists, and moves everything else into the new one.
fn give_back(old: &Path, new: &Path) {
    if remove_earlier(old).is_err() {
        return;
    }
    for entry in fs::read_dir(old).into_iter().flatten().flatten() {
        let place = new.join(entry.file_name());
        let _ = match place.exists() {
            true if is_of_log(&place, &[entry.path()]) => fs::remove_file(entry.path()),
            true => Ok(()),
            false => fs::rename(entry.path(), place),
        };
    }
    let _ = fs::remove_dir(old);
}

/// A file that is written until somebody wishes to stop: what is half done is then taken away, for nothing of it would be
/// if the process just ended.
pub(super) struct Heeding<'c> {
    file: File,
    context: &'c ReadContext<'c>,
}

impl Write for Heeding<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.context.advance(0).map_err(io::Error::other)?;
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// Whether this can be a table that was exported: their names leave nothing that leads elsewhere.
fn is_table(stem: &str, ending: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || ".-_~".contains(c);
    ["csv", "parquet"].contains(&ending) && !stem.starts_with('.') && stem.chars().all(plain)
}

/// The tables of an earlier export: only what its provenance lists, and only in this folder.
fn earlier(folder: &Path) -> Vec<PathBuf> {
    let text = fs::read_to_string(folder.join(PROVENANCE)).unwrap_or_default();
    let earlier: Value = serde_json::from_str(&text).unwrap_or_default();
    let table = |sheet: &Value| {
        let (stem, ending) = sheet["place"].as_str()?.rsplit_once('.')?;
        is_table(stem, ending).then(|| folder.join(format!("{stem}.{ending}")))
    };
    earlier["sheets"].as_array().into_iter().flatten().filter_map(table).collect()
}

/// The tables of an earlier export would look like part of this one.
fn remove_earlier(folder: &Path) -> Result<(), ConvertError> {
    let tables = earlier(folder);
    for path in std::iter::once(folder.join(PROVENANCE)).chain(tables) {
        match fs::remove_file(&path) {
            Err(e) if e.kind() != io::ErrorKind::NotFound => return Err(ConvertError::write(&path, "remove")(e)),
            _ => {}
        }
    }
    Ok(())
}
