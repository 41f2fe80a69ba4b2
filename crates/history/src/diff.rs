//! Two reports side by side.

use crate::collect::{Collecting, collect, read_campaign, texts_of};
use crate::compare::compare;
use crate::dataset::{Latest, Run, latest_of};
use crate::error::HistoryError;
use crate::fleet::Fleet;
use crate::row::Row;
use record::{CampaignRecord, ComparedReport, DiffRecord, NamedFlight, RECORD_VERSION, RunChanges};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};

/// Compares two reports of campaigns. `page_folder` is the folder of the page that will list the flights; links to
/// pages of flights are relative to it.
///
/// # Errors
/// A folder does not contain a campaign report, or a record in it is damaged.
pub fn diff(before: &Path, now: &Path, page_folder: Option<&Path>) -> Result<DiffRecord, HistoryError> {
    let records = (read_campaign(before)?, read_campaign(now)?);
    let (was, is) = (rows(&records.0, before)?, rows(&records.1, now)?);
    let from = page_folder.and_then(|folder| relative(folder, now));
    let page = |_: &str, page: &str| Some(format!("{}/{page}", from.as_ref()?));
    let names: BTreeSet<&str> = is.iter().map(|row| row.flight.as_str()).collect();
    let gone = was.iter().filter(|row| !names.contains(row.flight.as_str()));
    let gone =
        gone.map(|row| NamedFlight { campaign: String::new(), flight: row.flight.clone(), page: None }).collect();
    let changes = RunChanges { gone, ..compare(&latest_of(was), &is, &texts_of(&records.1, ""), &page) };
    Ok(DiffRecord {
        record_version: RECORD_VERSION,
        settings: settings_that_differ(&records.0.pipeline.toml, &records.1.pipeline.toml),
        moved_groups: campaign::moved_groups(&records.0.groups, &records.1.groups),
        before: compared(&records.0, before),
        now: compared(&records.1, now),
        changes,
    })
}

/// The rows of a report, without a campaign name: two reports may have different names.
fn rows(record: &CampaignRecord, report: &Path) -> Result<Vec<Row>, HistoryError> {
    let run = Run { id: report.display().to_string(), start_ns: 0 };
    let (fleet, known) = (Fleet::default(), Latest::new());
    collect(record, report, &Collecting { run: &run, campaign: "", fleet: &fleet, known: &known })
}

fn compared(record: &CampaignRecord, folder: &Path) -> ComparedReport {
    ComparedReport {
        folder: folder.display().to_string(),
        name: record.name.clone(),
        flights: record.totals.flights,
        flightlag_version: record.flightlag_version.clone(),
        analysis_version: record.analysis_version,
        settings: record.pipeline.title.clone(),
        settings_blake3: record.pipeline.blake3.clone(),
        criteria_blake3: record.criteria.as_ref().map(|c| c.criteria.blake3.clone()),
    }
}

/// `delay.position_s: was 0.4, is 0.35` for every key of the resolved settings that differs.
fn settings_that_differ(before: &str, now: &str) -> Vec<String> {
    let (was, is) = (flat(before), flat(now));
    let keys: BTreeSet<&String> = was.keys().chain(is.keys()).collect();
    let value =
        |of: &BTreeMap<String, String>, key: &String| of.get(key).map_or("not given", String::as_str).to_owned();
    let differs = keys.into_iter().filter(|key| was.get(*key) != is.get(*key));
    differs.map(|key| format!("{key}: was {}, is {}", value(&was, key), value(&is, key))).collect()
}

/// Dotted keys and their values.
fn flat(text: &str) -> BTreeMap<String, String> {
    fn walk(path: &str, value: &toml::Value, into: &mut BTreeMap<String, String>) {
        match value {
            toml::Value::Table(table) => table.iter().for_each(|(key, value)| {
                let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
                walk(&path, value, into);
            }),
            value => drop(into.insert(path.to_owned(), value.to_string())),
        }
    }
    let mut all = BTreeMap::new();
    match toml::from_str::<toml::Table>(text) {
        Ok(table) => walk("", &toml::Value::Table(table), &mut all),
        // Not TOML: keep the whole text.
        Err(_) => drop(all.insert("settings".to_owned(), text.to_owned())),
    }
    all
}

/// The relative path from one folder to another, with `/` as separator; `None` if there is none.
fn relative(from: &Path, to: &Path) -> Option<String> {
    let whole = |path: &Path| path.canonicalize().or_else(|_| std::path::absolute(path)).ok();
    let (from, to): (PathBuf, PathBuf) = (whole(from)?, whole(to)?);
    let (from, to): (Vec<Component<'_>>, Vec<Component<'_>>) = (from.components().collect(), to.components().collect());
    let shared = from.iter().zip(&to).take_while(|(a, b)| a == b).count();
    let up = std::iter::repeat_n("..".to_owned(), from.len() - shared);
    let down = to[shared..].iter().map(|part| part.as_os_str().to_string_lossy().into_owned());
    let parts: Vec<String> = up.chain(down).collect();
    Some(if parts.is_empty() { ".".to_owned() } else { parts.join("/") })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differing_settings_are_listed_with_both_values() {
        let before = "title = \"a\"\n[delay]\nposition_s = 0.4\n[replay]\nstep = 1\n";
        let now = "title = \"a\"\n[delay]\nposition_s = 0.35\nsource = \"card\"\n[replay]\nstep = 1\n";
        assert_eq!(
            settings_that_differ(before, now),
            ["delay.position_s: was 0.4, is 0.35", "delay.source: was not given, is \"card\""]
        );
    }

    #[test]
    fn a_page_links_from_one_folder_to_the_other() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir_all(at("reports/b")).unwrap();
        std::fs::create_dir_all(at("diff")).unwrap();
        assert_eq!(relative(&at("diff"), &at("reports/b")).as_deref(), Some("../reports/b"));
        assert_eq!(relative(&at("diff"), &at("diff")).as_deref(), Some("."));
    }
}
