//! Whose report an output folder holds: that of the logs which it was made from, and of no others of the same name.

use crate::error::CampaignError;
use crate::lock::while_unused;
use crate::s3;
use crate::store::{Keep, Store, look_into};
use std::path::{Path, PathBuf};

/// Where the logs of the report lie: a path in each line.
const SOURCE: &str = ".flightlag/source";

/// What a run that failed before its first result leaves in a new folder.
const LEFTOVERS: [&str; 5] = ["source", "lock", "id", "found.json", "inputs.json"];

/// Refuses a folder that holds the report of other logs, unless that may be replaced. A report of a bench goes on as long as
/// one of its records is among the new ones.
///
/// # Errors
/// Says whose report it is, and what to do.
pub(crate) fn check(out: &Path, inputs: &[PathBuf], replace: bool) -> Result<(), CampaignError> {
    let Some(known) = look_into(out, SOURCE)? else { return Ok(()) };
    let known = String::from_utf8_lossy(&known);
    let now = lines(inputs);
    if replace || known.lines().any(|line| now.iter().any(|new| new == line)) {
        return Ok(());
    }
    let (out, was) = (out.display(), known.lines().next().unwrap_or_default());
    let is = now.first().map(String::as_str).unwrap_or_default();
    Err(CampaignError::Asked(format!(
        "{out}: holds the report of {was}, and not of {is}; give another --out, or --replace to put the new report in its place"
    )))
}

/// Writes down whose report this is.
///
/// # Errors
/// The file cannot be written.
pub(crate) fn claim(store: &Store, inputs: &[PathBuf]) -> Result<(), CampaignError> {
    let text: String = lines(inputs).iter().map(|line| format!("{line}\n")).collect();
    Ok(store.write(SOURCE, text.as_bytes(), Keep::Synced).map(drop)?)
}

/// Where the logs of the report in `out` lie; `None` if it does not say.
pub(crate) fn of(out: &Path) -> Option<String> {
    let known = std::fs::read_to_string(out.join(SOURCE)).ok()?;
    let (first, more) = (known.lines().next()?, known.lines().count() - 1);
    Some(if more == 0 { first.to_owned() } else { format!("{first} and {more} more") })
}

fn lines(inputs: &[PathBuf]) -> Vec<String> {
    let whole = |path: &PathBuf| path.canonicalize().unwrap_or_else(|_| path.clone());
    inputs.iter().map(|path| whole(path).display().to_string().replace(['\n', '\r'], "?")).collect()
}

/// Runs `work`, which may make the folder `out`. If it fails before there is any result, what it made is removed, and the folders
/// above too. A run that the user stopped keeps what it has hashed.
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
        // Another run may be at work there by now.
        while_unused(out, || remove_leftovers(out, &missing));
    }
    ended
}

/// Removes what a run writes before its first result, and the folders that it made, if there is nothing else.
fn remove_leftovers(out: &Path, made: &[&Path]) {
    if !holds_no_more_than_leftovers(out) {
        return;
    }
    let own = out.join(".flightlag");
    LEFTOVERS.iter().for_each(|name| drop(std::fs::remove_file(own.join(name))));
    [own.as_path()].iter().chain(made).for_each(|folder| drop(std::fs::remove_dir(folder)));
}

/// A bucket has no folders. Where a run failed before any result, only its claim goes: another run may have the lock by now.
fn disclaim(out: &Path) {
    let Ok(store) = Store::open(out) else { return };
    let is_leftover = |name: &String| name.strip_prefix(".flightlag/").is_some_and(|name| LEFTOVERS.contains(&name));
    // What cannot be listed or removed stays; the next run says whose report it is.
    if store.all_files().is_ok_and(|names| names.iter().all(is_leftover)) {
        let _ = store.remove(SOURCE);
    }
}

/// Whether there is nothing in `out` but what a run writes before its first result. With anything else the lock stays too: it
/// tells the next run that the folder is ours.
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
    fn a_report_of_other_logs_is_refused_by_name_unless_it_may_be_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| {
            let path = folder.path().join(name);
            std::fs::create_dir_all(&path).unwrap();
            path.canonicalize().unwrap()
        };
        let (first, second, out) = (at("may/data"), at("june/data"), at("reports/data"));
        check(&out, std::slice::from_ref(&first), false).unwrap();
        claim(&Store::open(&out).unwrap(), std::slice::from_ref(&first)).unwrap();
        check(&out, std::slice::from_ref(&first), false).unwrap();
        check(&out, &[second.clone(), first.clone()], false).unwrap();
        check(&out, std::slice::from_ref(&second), true).unwrap();
        let told = check(&out, std::slice::from_ref(&second), false).unwrap_err().to_string();
        let (first, second) = (first.display(), second.display());
        assert!(told.contains(&format!("holds the report of {first}, and not of {second}; ")), "{told}");
    }

    #[test]
    fn a_run_that_fails_leaves_no_empty_folder_and_never_a_file_less() {
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
    fn a_run_that_is_refused_removes_nothing_of_the_run_that_made_the_folder_first() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("reports/data");
        let cancel = std::sync::atomic::AtomicBool::new(false);
        let desk = crate::plan::Desk { threads: 1, cancel: &cancel, events: &|_: &crate::Event| {} };
        let take = || OutputLock::take(&Store::open(&out).unwrap(), &desk);
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
