//! `reports/index.html`: one page with links to every report below a folder named `reports`. It is rewritten whenever a
//! report below that folder is written.

use crate::error::StoreError;
use crate::event::Event;
use crate::plan::BENCH_MARK;
use crate::run_context::RunContext;
use crate::source;
use crate::store::{Keep, Store};
use report::{REPORTS_TITLE, ReportEntry, reports_page};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Name of the folder that gets a page over its reports.
const FOLDER: &str = "reports";
/// Folder levels below it that are searched for reports: the demo's are in `reports/demo/report`.
const DEPTH: usize = 3;
/// File with the summary of a report for that page.
const SUMMARY: &str = ".flightlag/summary.json";
const INDEX: &str = "index.html";

/// Short summary of a report.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Summary {
    /// Number of flights or records.
    pub(crate) size: u64,
    /// Findings, one sentence each.
    pub(crate) answers: Vec<String>,
}

/// Writes the summary of the report in `store`, and the page over it and its neighbours, if it is in a folder named
/// `reports`. A failure to write that page is a remark: the report itself is complete.
///
/// # Errors
/// The summary cannot be written.
pub(crate) fn list(store: &Store, summary: &Summary, context: &RunContext<'_>) -> Result<(), StoreError> {
    // A summary has text keys and cannot fail.
    let text = serde_json::to_vec(summary).unwrap_or_default();
    store.write(SUMMARY, &text, Keep::Renewable)?;
    let Some(folder) = folder_of(store.root()) else { return Ok(()) };
    if let Err(error) = write(&folder) {
        context.send(Event::Remark { text: format!("the page of all reports was not written: {error}") });
    }
    Ok(())
}

/// Whether the page over the reports that include this folder is missing.
pub(crate) fn is_unlisted(store: &Store) -> bool {
    store.size(SUMMARY).is_none() || folder_of(store.root()).is_some_and(|folder| !folder.join(INDEX).exists())
}

/// The nearest folder above the report that is named `reports`.
fn folder_of(report: &Path) -> Option<PathBuf> {
    let report = report.canonicalize().ok()?;
    let mut above = report.ancestors().skip(1).take(DEPTH);
    above.find(|path| path.file_name().is_some_and(|name| name == FOLDER)).map(Path::to_owned)
}

fn write(folder: &Path) -> Result<(), StoreError> {
    let there = std::fs::read_to_string(folder.join(INDEX));
    let is_foreign = there.is_ok_and(|page| !page.contains(&format!("<title>{REPORTS_TITLE}</title>")));
    // The user's own page, or that of a report written to the folder itself.
    if is_foreign {
        return Ok(());
    }
    let mut found = vec![];
    collect(folder, folder, DEPTH, &mut found);
    found.sort_by(|(a, one), (b, other)| b.cmp(a).then_with(|| one.path.cmp(&other.path)));
    let entries: Vec<ReportEntry> = found.into_iter().map(|(_, entry)| entry).collect();
    Store::open(folder)?.write(INDEX, reports_page(&entries).as_bytes(), Keep::Renewable).map(drop)
}

/// Reports below `folder` with their last modification times. A report does not contain another.
fn collect(root: &Path, folder: &Path, depth: usize, found: &mut Vec<(SystemTime, ReportEntry)>) {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let folders = entries.filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_dir()));
    for path in folders.map(|entry| entry.path()) {
        match entry_of(root, &path) {
            Some(entry) => found.push(entry),
            None if depth > 1 => collect(root, &path, depth - 1, found),
            None => {}
        }
    }
}

fn entry_of(root: &Path, report: &Path) -> Option<(SystemTime, ReportEntry)> {
    let changed = std::fs::metadata(report.join(INDEX)).and_then(|file| file.modified()).ok()?;
    if !report.join(".flightlag").is_dir() {
        return None;
    }
    let summary = std::fs::read(report.join(SUMMARY)).ok();
    let summary: Option<Summary> = summary.and_then(|text| serde_json::from_slice(&text).ok());
    let utc = jiff::Timestamp::try_from(changed).map(|t| t.strftime("%Y-%m-%d %H:%M").to_string());
    let entry = ReportEntry {
        path: report.strip_prefix(root).ok()?.to_string_lossy().into_owned(),
        kind: if report.join(BENCH_MARK).exists() { "bench" } else { "campaign" }.to_owned(),
        size: summary.as_ref().map(|summary| summary.size),
        answers: summary.map(|summary| summary.answers).unwrap_or_default(),
        source: source::of(report).unwrap_or_default(),
        changed: utc.unwrap_or_default(),
    };
    Some((changed, entry))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicBool;

    fn report(folder: &Path, name: &str, answer: &str) {
        let store = Store::open(&folder.join(name)).unwrap();
        store.write(INDEX, b"<p>a report", Keep::Renewable).unwrap();
        let cancel = AtomicBool::new(false);
        let context = RunContext { threads: 1, cancel: &cancel, events: &|_: &Event| {} };
        let summary = Summary { size: 2, answers: vec![answer.to_owned()] };
        assert!(is_unlisted(&store));
        list(&store, &summary, &context).unwrap();
    }

    #[test]
    fn one_page_links_to_every_report_below_the_folder_of_reports() {
        let folder = tempfile::tempdir().unwrap();
        let reports = folder.path().join("reports");
        report(&reports, "may", "position 201 ms late");
        report(&reports, "demo/report", "position 400 ms late");
        std::fs::create_dir_all(reports.join("notes")).unwrap();
        let page = std::fs::read_to_string(reports.join(INDEX)).unwrap();
        assert!(page.contains("href=\"may/index.html\"") && page.contains("201 ms late"), "{page}");
        assert!(page.contains("href=\"demo/report/index.html\"") && page.contains("400 ms late"), "{page}");
        assert!(!page.contains("notes"), "{page}");
    }

    #[test]
    fn a_foreign_page_is_unchanged_and_other_folders_get_none() {
        let folder = tempfile::tempdir().unwrap();
        let reports = folder.path().join("reports");
        std::fs::create_dir_all(&reports).unwrap();
        std::fs::write(reports.join(INDEX), "mine").unwrap();
        report(&reports, "may", "x");
        assert_eq!(std::fs::read_to_string(reports.join(INDEX)).unwrap(), "mine");
        let other = folder.path().join("elsewhere");
        let store = Store::open(&other.join("june")).unwrap();
        assert_eq!(folder_of(store.root()), None);
    }
}
