//! Where the second file of each flight is, according to the pipeline.

use crate::pattern::matches;
use compensation_replay::ClockRule;
use ingest::FlightUnit;
use serde::{Serialize, Serializer};
use std::path::{Path, PathBuf};

/// Placeholder for the name of the log without its extension.
pub(crate) const STEM: &str = "{stem}";

/// Location of the second file of each flight, and treatment of its clock.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct ReferenceRule {
    /// Path, relative to the folder of the log; `{stem}` is the log's name without its extension, `*` matches anything.
    #[serde(serialize_with = "without_place")]
    pub(crate) file: String,
    pub(crate) clock: ClockRule,
}

/// Removes the folder: the content of a file is part of the settings, its location is not.
fn without_place<S: Serializer>(file: &str, serializer: S) -> Result<S::Ok, S::Error> {
    let path = Path::new(file);
    let name = path.file_name().filter(|_| path.is_absolute()).map(|name| name.to_string_lossy());
    serializer.serialize_str(name.as_deref().unwrap_or(file))
}

impl ReferenceRule {
    pub(crate) fn is_pattern(&self) -> bool {
        self.file.contains(STEM) || self.file.contains('*')
    }

    /// The message if no flight has a reference file.
    pub(crate) fn none_found(&self, file: &str, reason: &str) -> String {
        match self.is_pattern() {
            true => format!(
                "reference file {}: no flight has one; flightlag looked first for {file:?}: {reason}",
                self.file
            ),
            false => {
                format!(
                    "reference file {file}: {reason}; a relative path starts in the current folder or in the \
                    folder of the log"
                )
            }
        }
    }

    /// The reference file of a flight; else its name and why it is missing.
    pub(crate) fn file_of(&self, unit: &FlightUnit) -> Result<PathBuf, (String, String)> {
        let first = unit.files.first().map(PathBuf::as_path).unwrap_or(Path::new(""));
        let stem = match unit.files.as_slice() {
            [one] => one.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
            // A flight of several files has their common name.
            _ => unit.id.rsplit('/').next().unwrap_or_default().to_owned(),
        };
        let wanted = self.file.replace(STEM, &stem);
        let path = first.parent().unwrap_or(Path::new("")).join(&wanted);
        let missing = |reason: &str| (wanted.clone(), reason.to_owned());
        let path = if wanted.contains('*') { only_match(&path, &unit.files).map_err(|r| missing(&r))? } else { path };
        let path = path.canonicalize().map_err(|e| match e.kind() {
            std::io::ErrorKind::NotFound => missing("the file does not exist"),
            _ => missing(&e.to_string()),
        })?;
        let is_own = unit.files.iter().any(|f| f.canonicalize().is_ok_and(|f| f == path));
        if is_own { Err(missing("it is the log itself")) } else { Ok(path) }
    }
}

/// The only file with a matching name, except those of the flight.
fn only_match(pattern: &Path, own: &[PathBuf]) -> Result<PathBuf, String> {
    let name = pattern.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let folder = pattern.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let entries = std::fs::read_dir(folder).map_err(|e| e.to_string())?;
    let fits = |path: &PathBuf| {
        path.file_name().is_some_and(|f| matches(&name, &f.to_string_lossy())) && !own.contains(path) && path.is_file()
    };
    let mut found: Vec<PathBuf> = entries.flatten().map(|e| e.path()).filter(fits).collect();
    found.sort();
    match found.as_slice() {
        [] => Err("no file has a matching name".to_owned()),
        [one] => Ok(one.clone()),
        [first, second, ..] => Err(format!(
            "{} files have a matching name, among them {} and {}",
            found.len(),
            first.file_name().unwrap_or_default().display(),
            second.file_name().unwrap_or_default().display()
        )),
    }
}
