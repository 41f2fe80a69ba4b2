//! Tables in a folder: all of them appear together, or none does.

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

/// Written last: a folder that has it is complete.
pub(super) const PROVENANCE: &str = "provenance.json";

/// Held by the process that writes; absent from a complete folder.
const LOCK: &str = ".lock";

/// Tables in a temporary folder: removed if it is dropped before it is kept.
pub(super) struct Folder {
    path: PathBuf,
    /// Parent folders that had to be created, the nearest first.
    made: Vec<PathBuf>,
    /// Next to the folder, until it replaces it.
    staging: PathBuf,
    _lock: File,
    /// File names written, in order.
    names: Vec<String>,
    is_kept: bool,
}

impl Folder {
    /// Starts tables for `path`, unless that would overwrite files of the log. Removes what killed processes left.
    pub(super) fn begin(path: &Path, places: &[String], log: &[PathBuf]) -> Result<Folder, ConvertError> {
        for place in places.iter().map(String::as_str).chain([PROVENANCE]) {
            may_write(&path.join(place), log)?;
        }
        if let Some(table) = earlier(path).into_iter().find(|table| is_of_log(table, log)) {
            let what = "this table of an earlier export is the log itself and would be removed; name another folder";
            return Err(ConvertError::Refused { path: table, what: what.to_owned() });
        }
        // For a link, use its target folder.
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

    /// Writes the provenance and moves everything into place. The tables of an earlier export are removed in the same
    /// step; files that others put into the folder stay.
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

    /// The new folder replaces the old one. Other people's files in the old one are first linked into the new one, so
    /// that they exist at every moment.
    fn swap(&self) -> io::Result<()> {
        let tables: Vec<PathBuf> = earlier(&self.path).into_iter().chain([self.path.join(PROVENANCE)]).collect();
        for entry in fs::read_dir(&self.path)? {
            let entry = entry?;
            if !tables.contains(&entry.path()) && !self.staging.join(entry.file_name()).exists() {
                // Folders cannot be linked in this way.
                fs::hard_link(entry.path(), self.staging.join(entry.file_name()))?;
            }
        }
        fs::set_permissions(&self.staging, fs::metadata(&self.path)?.permissions())?;
        exchange(&self.staging, &self.path)
    }

    /// Where the folder cannot be swapped: removes the old tables first, writes the provenance last. A folder with it
    /// is complete.
    fn place_one_by_one(&self) -> Result<(), ConvertError> {
        remove_earlier(&self.path)?;
        let mut placed = vec![];
        for name in &self.names {
            let place = self.path.join(name);
            if let Err(e) = fs::rename(self.staging.join(name), &place) {
                // What cannot be removed has no provenance with it.
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

/// Not a mount point, and not the working folder: processes in it would stay in the old one.
fn can_be_swapped(path: &Path) -> bool {
    let here = std::env::current_dir().and_then(|here| here.canonicalize());
    path.file_name().is_some() && !here.is_ok_and(|here| here.starts_with(path))
}

/// Removes what killed processes left next to the folder. Other people's files in an old folder are moved back.
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

/// Removes from an old folder the tables that its provenance lists, and moves everything else into the new one.
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

/// A file whose writing stops when the user requests it: the unfinished part is then removed, which would not happen
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

/// Whether this can be an exported table: such names cannot lead outside the folder.
fn is_table(stem: &str, ending: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || ".-_~".contains(c);
    ["csv", "parquet"].contains(&ending) && !stem.starts_with('.') && stem.chars().all(plain)
}

/// The tables of an earlier export: only those listed in its provenance, and only in this folder.
fn earlier(folder: &Path) -> Vec<PathBuf> {
    let text = fs::read_to_string(folder.join(PROVENANCE)).unwrap_or_default();
    let earlier: Value = serde_json::from_str(&text).unwrap_or_default();
    let table = |sheet: &Value| {
        let (stem, ending) = sheet["place"].as_str()?.rsplit_once('.')?;
        is_table(stem, ending).then(|| folder.join(format!("{stem}.{ending}")))
    };
    earlier["sheets"].as_array().into_iter().flatten().filter_map(table).collect()
}

/// Removes the tables of an earlier export, which would look like part of this one.
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
