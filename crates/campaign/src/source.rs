//! The source of a report: which logs it was made from, so that logs of the same name elsewhere are not confused.

use crate::error::CampaignError;
use crate::lock::while_unused;
use crate::s3;
use crate::store::{Keep, Store, read_unopened};
use std::path::{Path, PathBuf};

/// Paths of the logs of the report, one per line.
const SOURCE: &str = ".flightlag/source";

/// Files that a run which failed before its first result leaves in a new folder.
const LEFTOVERS: [&str; 5] = ["source", "lock", "id", "found.json", "inputs.json"];

/// Rejects a folder that holds the report of other logs, unless it may be replaced. A bench report continues as long as
/// one of its records is among the new ones.
///
/// # Errors
/// The source of the existing report, and what to do.
pub(crate) fn check(out: &Path, inputs: &[PathBuf], replace: bool) -> Result<(), CampaignError> {
    let Some(known) = read_unopened(out, SOURCE)? else { return Ok(()) };
    let known = String::from_utf8_lossy(&known);
    let now = lines(inputs);
    if replace || known.lines().any(|line| now.iter().any(|new| new == line)) {
        return Ok(());
    }
    let (out, was) = (out.display(), known.lines().next().unwrap_or_default());
    let is = now.first().map(String::as_str).unwrap_or_default();
    Err(CampaignError::Asked(format!(
        "{out}: holds the report of {was}, not of {is}; give another output folder, or replace this report (--replace of campaign, plan and bench)"
    )))
}

/// Writes the source of the report.
///
/// # Errors
/// The file cannot be written.
pub(crate) fn claim(store: &Store, inputs: &[PathBuf]) -> Result<(), CampaignError> {
    let text: String = lines(inputs).iter().map(|line| format!("{line}\n")).collect();
    Ok(store.write(SOURCE, text.as_bytes(), Keep::Synced).map(drop)?)
}

/// The source of the report in `out`; `None` if unknown.
pub(crate) fn of(out: &Path) -> Option<String> {
    let known = std::fs::read_to_string(out.join(SOURCE)).ok()?;
    let (first, more) = (known.lines().next()?, known.lines().count() - 1);
    Some(if more == 0 { first.to_owned() } else { format!("{first} and {more} more") })
}

fn lines(inputs: &[PathBuf]) -> Vec<String> {
    let whole = |path: &PathBuf| path.canonicalize().unwrap_or_else(|_| path.clone());
    inputs.iter().map(|path| whole(path).display().to_string().replace(['\n', '\r'], "?")).collect()
}

/// Runs `work`, which may create the folder `out`. If it fails before any result, removes what it created, including
/// parent folders. A run that the user stopped keeps its hashes.
///
/// # Errors
/// Those of `work`.
pub(crate) fn leaving_no_empty_folder<T>(
    out: &Path,
    work: impl FnOnce() -> Result<T, CampaignError>,
) -> Result<T, CampaignError> {
    if s3::is_in_bucket(out) {
        let ended = work();
        let is_ours =
            !matches!(ended, Err(CampaignError::Cancelled | CampaignError::TryAgain(_) | CampaignError::Busy { .. }));
        if ended.is_err() && is_ours {
            disclaim(out);
        }
        return ended;
    }
    let missing: Vec<&Path> = out.ancestors().take_while(|p| !p.as_os_str().is_empty() && !p.exists()).collect();
    let ended = work();
    let stopped = matches!(ended, Err(CampaignError::Cancelled | CampaignError::TryAgain(_)));
    if ended.is_err() && !stopped && !missing.is_empty() {
        // Another run may use the folder by now.
        while_unused(out, || remove_leftovers(out, &missing));
    }
    ended
}

/// Removes files that a run writes before its first result, and the folders that it created, if there is nothing else.
fn remove_leftovers(out: &Path, made: &[&Path]) {
    if !holds_no_more_than_leftovers(out) {
        return;
    }
    let own = out.join(".flightlag");
    LEFTOVERS.iter().for_each(|name| drop(std::fs::remove_file(own.join(name))));
    [own.as_path()].iter().chain(made).for_each(|folder| drop(std::fs::remove_dir(folder)));
}

/// Removes the source from a bucket after a run that failed before any result. Nothing else: another run may have the
/// lock.
fn disclaim(out: &Path) {
    let Ok(store) = Store::open(out) else { return };
    let is_leftover = |name: &String| name.strip_prefix(".flightlag/").is_some_and(|name| LEFTOVERS.contains(&name));
    // What cannot be listed or removed stays; the next run reports the source.
    if store.all_files().is_ok_and(|names| names.iter().all(is_leftover)) {
        let _ = store.remove(SOURCE);
    }
}

/// Whether `out` holds only files that a run writes before its first result. With anything else the lock stays too: it
/// marks the folder as an output folder.
fn holds_no_more_than_leftovers(out: &Path) -> bool {
    let only = |folder: &Path, known: &[&str]| {
        let mut entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        entries.all(|entry| known.iter().any(|name| entry.file_name() == *name))
    };
    only(out, &[".flightlag"]) && only(&out.join(".flightlag"), &LEFTOVERS)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lock::OutputLock;

    #[test]
    fn a_report_of_other_logs_is_rejected_unless_it_may_be_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| {
            let path = folder.path().join(name);
            std::fs::create_dir_all(&path).unwrap();
            path.canonicalize().unwrap()
        };
        let (first, second, out) = (at("may/data"), at("june/data"), at("reports/data"));
        check(&out, std::slice::from_ref(&first), false).unwrap();
        claim(&Store::open(&out).unwrap(), std::slice::from_ref(&first)).unwrap();
        assert_eq!(of(&out), Some(first.display().to_string()));
        check(&out, std::slice::from_ref(&first), false).unwrap();
        check(&out, &[second.clone(), first.clone()], false).unwrap();
        check(&out, std::slice::from_ref(&second), true).unwrap();
        let error = check(&out, std::slice::from_ref(&second), false).unwrap_err().to_string();
        let (first, second) = (first.display(), second.display());
        assert!(error.contains(&format!("holds the report of {first}, not of {second}; ")), "{error}");
    }

    #[test]
    fn a_failed_run_leaves_no_empty_folder_and_removes_no_other_file() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("reports/data");
        let fails = |out: &Path, also: Option<&str>| {
            leaving_no_empty_folder(out, || -> Result<(), CampaignError> {
                claim(&Store::open(out)?, &[])?;
                also.iter().for_each(|name| std::fs::write(out.join(name), "x").unwrap());
                Err(CampaignError::Asked("no".to_owned()))
            })
            .unwrap_err()
        };
        fails(&out, None);
        assert!(!folder.path().join("reports").exists() && folder.path().exists());
        fails(&out, Some("index.html"));
        assert!(out.join("index.html").exists() && out.join(SOURCE).exists(), "a folder that stays is known as ours");
        std::fs::create_dir_all(folder.path().join("mine")).unwrap();
        fails(&folder.path().join("mine"), None);
        assert!(folder.path().join("mine").exists());
    }
    #[test]
    fn a_rejected_run_removes_nothing_of_the_run_that_created_the_folder() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("reports/data");
        let cancel = std::sync::atomic::AtomicBool::new(false);
        let context = crate::run_context::RunContext { threads: 1, cancel: &cancel, events: &|_: &crate::Event| {} };
        let take = || OutputLock::take(&Store::open(&out).unwrap(), &context);
        let mut first = None;
        let refused = leaving_no_empty_folder(&out, || {
            first = Some(take()?);
            claim(&Store::open(&out)?, &[])?;
            take().map(drop)
        });
        assert!(matches!(refused, Err(CampaignError::Busy { .. })), "{refused:?}");
        assert!(out.join(SOURCE).exists() && out.join(".flightlag/lock").exists());
        drop(first);
        take().unwrap();
    }
}
