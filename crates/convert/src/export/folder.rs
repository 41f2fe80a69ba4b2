//! Tables in a folder: all of them appear together, or none.

use crate::error::ConvertError;
use crate::guard::{is_of_log, may_write};
use ingest::ReadContext;
use serde_json::Value;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Comes last: a folder with it is whole.
pub(super) const PROVENANCE: &str = "provenance.json";

/// Tables on the way to their folder: gone if it is dropped before.
pub(super) struct Folder<'p> {
    path: &'p Path,
    /// The folder was not there.
    made: bool,
    staging: Option<TempDir>,
    /// Names of what is written, in order.
    names: Vec<String>,
}

impl<'p> Folder<'p> {
    /// Begins tables in `path`, if nothing of the log stands in their way.
    pub(super) fn begin(path: &'p Path, places: &[String], log: &[PathBuf]) -> Result<Folder<'p>, ConvertError> {
        for place in places.iter().map(String::as_str).chain([PROVENANCE]) {
            may_write(&path.join(place), log)?;
        }
        if let Some(table) = earlier(path).into_iter().find(|table| is_of_log(table, log)) {
            let what = "a table of an earlier export, which would be removed, and the log itself; name another folder";
            return Err(ConvertError::Refused { path: table, what: what.to_owned() });
        }
        let made = !path.exists();
        fs::create_dir_all(path).map_err(ConvertError::write(path, "make this folder"))?;
        let mut folder = Folder { path, made, staging: None, names: vec![] };
        let staging = tempfile::Builder::new().prefix(".flightlag-").suffix(".flightlag-tmp").tempdir_in(path);
        folder.staging = Some(staging.map_err(ConvertError::write(path, "write to this folder"))?);
        Ok(folder)
    }

    /// Writes a file.
    pub(super) fn write(
        &mut self,
        name: &str,
        context: &ReadContext<'_>,
        fill: impl FnOnce(&mut BufWriter<Heeding<'_>>) -> io::Result<()>,
    ) -> Result<(), ConvertError> {
        let Some(staging) = &self.staging else { return Ok(()) };
        let written = File::create_new(staging.path().join(name)).and_then(|file| {
            let mut file = BufWriter::new(Heeding { file, context });
            fill(&mut file)?;
            file.into_inner().map_err(io::IntoInnerError::into_error)?.file.sync_all()
        });
        let place = self.path.join(name);
        written.map_err(|e| ConvertError::write(&place, "write")(e).or_stopped(context))?;
        self.names.push(name.to_owned());
        Ok(())
    }

    /// Writes the provenance and puts everything in its place, that last. The tables of an earlier export go.
    pub(super) fn keep(mut self, provenance: &Value, context: &ReadContext<'_>) -> Result<(), ConvertError> {
        self.write(PROVENANCE, context, |file| {
            serde_json::to_writer_pretty(&mut *file, provenance)?;
            file.write_all(b"\n")
        })?;
        remove_earlier(self.path)?;
        let Some(staging) = self.staging.take() else { return Ok(()) };
        let mut placed = vec![];
        for name in &self.names {
            let place = self.path.join(name);
            if let Err(e) = fs::rename(staging.path().join(name), &place) {
                // What cannot be removed has no provenance beside it.
                placed.iter().for_each(|table: &PathBuf| drop(fs::remove_file(table)));
                self.staging = Some(staging);
                return Err(ConvertError::write(&place, "rename to")(e));
            }
            placed.push(place);
        }
        self.made = false;
        Ok(())
    }
}

impl Drop for Folder<'_> {
    fn drop(&mut self) {
        drop(self.staging.take());
        if self.made {
            // Not if somebody has put something into it.
            let _ = fs::remove_dir(self.path);
        }
    }
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
