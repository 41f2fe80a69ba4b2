//! The history as a folder: one Parquet file for each run, written atomically and never changed.

use crate::error::HistoryError;
use crate::row::{Row, column, rows_of, sheet_of};
use crate::schema::{HISTORY_SCHEMA, SCHEMA_KEY, current};
use convert::{read_parquet, read_parquet_columns, write_parquet_about};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

/// Ending of a history file.
const ENDING: &str = "parquet";

/// Maximum number of runs that may start within one second.
const MOST_RUNS_A_SECOND: u32 = 1000;

/// The start of a run, and the name derived from it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Run {
    /// Its name: the start without colons, such as `2026-11-25T220512Z`.
    pub id: String,
    /// Its start, ns UTC since 1970.
    pub start_ns: i64,
}

impl Run {
    /// A run that starts at an instant.
    #[must_use]
    pub fn at(start: jiff::Timestamp) -> Run {
        let second = start.as_second();
        let whole = jiff::Timestamp::from_second(second).unwrap_or(start);
        let id = whole.to_string().replace(':', "");
        Run { id, start_ns: i64::try_from(start.as_nanosecond()).unwrap_or(i64::MAX) }
    }

    /// A run that starts at an instant, with a number appended to its name if a run of that name `exists`.
    #[must_use]
    pub fn unused(start: jiff::Timestamp, exists: &dyn Fn(&str) -> bool) -> Run {
        let first = Run::at(start);
        let other = (2..=MOST_RUNS_A_SECOND).map(|number| format!("{}-{number}", first.id));
        let id = std::iter::once(first.id.clone()).chain(other).find(|id| !exists(id)).unwrap_or(first.id);
        Run { id, ..first }
    }
}

/// A folder of history files.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct History {
    folder: PathBuf,
}

/// The latest row of each flight, by campaign and flight.
pub type Latest = BTreeMap<(String, String), Row>;

impl History {
    /// The history in a folder, which need not exist yet.
    #[must_use]
    pub fn new(folder: &Path) -> History {
        History { folder: folder.to_owned() }
    }

    /// The folder.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Its files, earliest run first. Empty if the folder does not exist.
    ///
    /// # Errors
    /// The folder cannot be listed.
    pub fn files(&self) -> Result<Vec<PathBuf>, HistoryError> {
        let entries = match std::fs::read_dir(&self.folder) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(vec![]),
            entries => entries.map_err(|e| HistoryError::io(&self.folder, "list this folder", e))?,
        };
        let mut files = vec![];
        for entry in entries {
            let path = entry.map_err(|e| HistoryError::io(&self.folder, "list this folder", e))?.path();
            let is_hidden = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
            if path.extension().is_some_and(|ending| ending == ENDING) && !is_hidden {
                files.push(path);
            }
        }
        files.sort_by_cached_key(|path| order_of(path));
        Ok(files)
    }

    /// Name of the latest run, if any. A run that found nothing new has a file without rows.
    ///
    /// # Errors
    /// The folder cannot be listed.
    pub fn last_run(&self) -> Result<Option<String>, HistoryError> {
        let files = self.files()?;
        Ok(files.last().and_then(|path| path.file_stem()).map(|name| name.to_string_lossy().into_owned()))
    }

    /// Writes the rows of a run as a new file. It is written under a temporary name, synced and renamed, so it is
    /// complete or absent. An existing file is never changed: a second run within the same second gets a number.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn append(&self, run: &Run, rows: &[Row]) -> Result<PathBuf, HistoryError> {
        std::fs::create_dir_all(&self.folder).map_err(|e| HistoryError::io(&self.folder, "make this folder", e))?;
        let failed = |e| HistoryError::io(&self.folder, "write a file in this folder", e);
        let mut file =
            tempfile::Builder::new().prefix(".").suffix(".flightlag-tmp").tempfile_in(&self.folder).map_err(failed)?;
        let about = [(SCHEMA_KEY.to_owned(), HISTORY_SCHEMA.to_string())];
        write_parquet_about(&sheet_of(rows), &about, file.as_file_mut()).map_err(failed)?;
        readable_by_all(file.as_file()).and_then(|()| file.as_file().sync_all()).map_err(failed)?;
        let mut open = file;
        for number in 1..=MOST_RUNS_A_SECOND {
            let end = if number == 1 { String::new() } else { format!("-{number}") };
            let path = self.folder.join(format!("{}{end}.{ENDING}", run.id));
            match open.persist_noclobber(&path) {
                Ok(_) => return sync_folder(&self.folder).map(|()| path).map_err(failed),
                Err(e) if e.error.kind() == io::ErrorKind::AlreadyExists => open = e.file,
                Err(e) => return Err(failed(e.error)),
            }
        }
        Err(failed(io::Error::new(
            io::ErrorKind::AlreadyExists,
            format!("{} runs are called {}", MOST_RUNS_A_SECOND, run.id),
        )))
    }

    /// The latest row of each of these flights of a campaign. Files that cannot be read are skipped:
    /// [`History::briefs`] lists them.
    ///
    /// # Errors
    /// The folder cannot be listed.
    pub fn latest(&self, campaign: &str, flights: &BTreeSet<&str>) -> Result<Latest, HistoryError> {
        let mut latest = Latest::new();
        for path in self.files()? {
            let is_named = |names: &(String, String)| names.0 == campaign && flights.contains(names.1.as_str());
            // Most files contain none of them, and two of fifty columns are enough to see that.
            if names_in(&path).is_ok_and(|names| !names.iter().any(is_named)) {
                continue;
            }
            let rows = read_file(&path).unwrap_or_default().into_iter();
            rows.filter(|row| row.campaign == campaign && flights.contains(row.flight.as_str()))
                .for_each(|row| keep_later(&mut latest, row));
        }
        Ok(latest)
    }
}

/// Campaign and flight of each row of a file.
fn names_in(path: &Path) -> Result<Vec<(String, String)>, String> {
    let file = File::open(path).map_err(|e| e.to_string())?;
    let table =
        read_parquet_columns(file, &|name| ["campaign", "flight"].contains(&name)).map_err(|e| e.to_string())?;
    let mut sheet = table.sheet;
    let (campaigns, flights) = (column(&mut sheet, "campaign")?, column(&mut sheet, "flight")?);
    Ok(std::iter::zip(campaigns, flights).collect())
}

/// The second of a file's run, and the number of the run within that second.
fn order_of(path: &Path) -> (String, u32) {
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let numbered =
        name.rsplit_once("Z-").and_then(|(second, number)| Some((format!("{second}Z"), number.parse().ok()?)));
    numbered.unwrap_or((name, 1))
}

/// Replaces an earlier row of the same flight.
fn keep_later(latest: &mut Latest, row: Row) {
    let name = (row.campaign.clone(), row.flight.clone());
    if latest.get(&name).is_none_or(|known| known.run_ns <= row.run_ns) {
        latest.insert(name, row);
    }
}

/// The latest of these rows for each flight.
#[must_use]
pub fn latest_of(rows: impl IntoIterator<Item = Row>) -> Latest {
    let mut latest = Latest::new();
    rows.into_iter().for_each(|row| keep_later(&mut latest, row));
    latest
}

pub(crate) fn read_file(path: &Path) -> Result<Vec<Row>, String> {
    let file = File::open(path).map_err(|e| format!("cannot be opened: {e}"))?;
    let table =
        read_parquet(file).map_err(|e| format!("cannot be read: {e}. Restore it, or move it out of the history"))?;
    rows_of(current(table)?)
}

/// Temporary files are private; a history is read by the team.
#[cfg(unix)]
pub(crate) fn readable_by_all(file: &File) -> io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    file.set_permissions(std::fs::Permissions::from_mode(0o644))
}

#[cfg(not(unix))]
pub(crate) fn readable_by_all(_file: &File) -> io::Result<()> {
    Ok(())
}

/// After this a new file name survives a power loss.
#[cfg(unix)]
fn sync_folder(folder: &Path) -> io::Result<()> {
    File::open(folder)?.sync_all()
}

#[cfg(not(unix))]
fn sync_folder(_folder: &Path) -> io::Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(second: i64) -> Run {
        Run::at(jiff::Timestamp::from_second(second).unwrap())
    }

    fn row(run: &Run, flight: &str, lateness_s: f64) -> Row {
        Row {
            run_id: run.id.clone(),
            run_ns: run.start_ns,
            campaign: "c".into(),
            flight: flight.into(),
            lateness_s: Some(lateness_s),
            ..Row::default()
        }
    }

    #[test]
    fn the_latest_run_counts_and_earlier_files_stay_unchanged() {
        let folder = tempfile::tempdir().unwrap();
        let history = History::new(&folder.path().join("history"));
        assert_eq!(history.files().unwrap(), [] as [PathBuf; 0]);
        let (first, second) = (run(1_795_644_000), run(1_795_730_400));
        let file = history.append(&first, &[row(&first, "a", 0.1), row(&first, "b", 0.2)]).unwrap();
        let bytes = std::fs::read(&file).unwrap();
        history.append(&second, &[row(&second, "a", 0.3)]).unwrap();
        assert_eq!(std::fs::read(&file).unwrap(), bytes);
        let names: Vec<String> =
            history.files().unwrap().iter().map(|f| f.file_name().unwrap().to_string_lossy().into_owned()).collect();
        assert_eq!(names, ["2026-11-25T220000Z.parquet", "2026-11-26T220000Z.parquet"]);
        let late = |flights: &[&str]| {
            let latest = history.latest("c", &flights.iter().copied().collect()).unwrap();
            latest.into_values().filter_map(|row| row.lateness_s).collect::<Vec<f64>>()
        };
        assert_eq!((late(&["a", "b"]), late(&["b"]), late(&["none"])), (vec![0.3, 0.2], vec![0.2], vec![]));
        assert_eq!(history.briefs(&|_| true).unwrap().rows.len(), 3);
    }

    #[test]
    fn a_second_run_in_the_same_second_writes_its_own_file() {
        let folder = tempfile::tempdir().unwrap();
        let history = History::new(folder.path());
        let run = run(1_795_644_000);
        let files = [0.1, 0.2].map(|late| history.append(&run, &[row(&run, "a", late)]).unwrap());
        assert!(files[0] != files[1] && files[1].ends_with("2026-11-25T220000Z-2.parquet"), "{files:?}");
        assert_eq!(history.files().unwrap(), files, "in the order of the runs");
        assert_eq!(history.last_run().unwrap().as_deref(), Some("2026-11-25T220000Z-2"));
        let left = std::fs::read_dir(folder.path()).unwrap().count();
        assert_eq!(left, 2, "no temporary file is left");
    }

    #[test]
    fn a_damaged_file_is_reported_and_the_others_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let history = History::new(folder.path());
        let (first, second) = (run(1_795_644_000), run(1_795_730_400));
        let file = history.append(&first, &[row(&first, "a", 0.1)]).unwrap();
        history.append(&second, &[row(&second, "b", 0.2)]).unwrap();
        let bytes = std::fs::read(&file).unwrap();
        std::fs::write(&file, &bytes[..bytes.len() / 2]).unwrap();
        assert_eq!(history.latest("c", &["a", "b"].into()).unwrap().len(), 1);
        let read = history.briefs(&|_| true).unwrap();
        assert_eq!(read.rows.len(), 1);
        assert!(read.unreadable[0].contains("2026-11-25T220000Z.parquet: cannot be read"), "{:?}", read.unreadable);
    }
}
