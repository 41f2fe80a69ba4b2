//! The list of runs of a history.

use crate::dataset::History;
use crate::error::HistoryError;
use crate::row::Row;
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::Serialize;
use std::collections::BTreeSet;

/// One run: a file of the history.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct RunLine {
    /// Name of its file without the extension.
    pub run: String,
    /// Campaigns with a new or changed finding.
    pub campaigns: Vec<String>,
    /// Flights with a new or changed finding.
    pub flights: u64,
    /// Those that failed.
    pub failed: u64,
    /// Those that were harmed or fail a criterion.
    pub harmed_or_criterion_failed: u64,
    /// First flight, UTC.
    pub flown_from: Option<String>,
    /// Last flight, UTC.
    pub flown_to: Option<String>,
    /// Builds of flightlag used.
    pub builds: Vec<String>,
    /// Why the file cannot be read; `null` if it can.
    pub unreadable: Option<String>,
}

/// Every run, earliest first. A file that cannot be read is also a line.
///
/// # Errors
/// The folder cannot be listed.
pub fn runs(history: &History) -> Result<Vec<RunLine>, HistoryError> {
    let line = |path: std::path::PathBuf| {
        let run = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        match crate::dataset::read_file(&path) {
            Ok(rows) => line_of(run, &rows, None),
            Err(what) => line_of(run, &[], Some(what)),
        }
    };
    Ok(history.files()?.into_iter().map(line).collect())
}

fn line_of(run: String, rows: &[Row], unreadable: Option<String>) -> RunLine {
    let texts = |of: &dyn Fn(&Row) -> String| rows.iter().map(of).collect::<BTreeSet<_>>().into_iter().collect();
    let count = |of: &dyn Fn(&&Row) -> bool| rows.iter().filter(of).count() as u64;
    let flown = || rows.iter().filter_map(|row| row.flown_ns);
    RunLine {
        run,
        campaigns: texts(&|row| row.campaign.clone()),
        flights: rows.len() as u64,
        failed: count(&|row| row.outcome == "failed"),
        harmed_or_criterion_failed: count(&|row| {
            row.effect.as_deref() == Some("harmed") || row.criteria.as_deref() == Some("fail")
        }),
        flown_from: flown().min().and_then(crate::trend::instant),
        flown_to: flown().max().and_then(crate::trend::instant),
        builds: texts(&|row| row.build.clone()),
        unreadable,
    }
}
