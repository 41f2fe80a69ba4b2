//! Removes results that no report refers to: from earlier settings, logs and versions.

use crate::error::CampaignError;
use crate::lock::{LOCK, OutputLock};
use crate::manifest::Manifest;
use crate::plan::{BENCH_MARK, refuse_other_kind};
use crate::reduce::previous_record;
use crate::run_context::RunContext;
use crate::state::State;
use crate::store::{Store, read_unopened};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Removed results, or with a dry run, removable ones.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Garbage {
    /// Results and measurements that no report refers to.
    pub results: usize,
    /// Total size of their files.
    pub bytes: u64,
    /// Results and measurements that stay.
    pub kept: usize,
}

/// Removes every result in the output folder `out` that neither its report nor a recent plan refers to. With `dry_run`
/// only counts them: then the folder may be read-only, and it does not wait for a run that uses the folder.
///
/// # Errors
/// The folder holds no report, its record was changed, another process uses it, or a file cannot be removed.
pub fn gc(out: &Path, dry_run: bool, context: &RunContext<'_>) -> Result<Garbage, CampaignError> {
    let refused = |what: &str| CampaignError::Asked(format!("{}: {what}", out.display()));
    if read_unopened(out, LOCK)?.is_none() {
        return Err(CampaignError::Asked(format!("{} is not an output folder of flightlag", out.display())));
    }
    refuse_other_kind(out, BENCH_MARK, "a bench")?;
    let store = if dry_run { Store::open_to_read(out) } else { Store::open(out) }?;
    let _lock = if dry_run { None } else { Some(OutputLock::take(&store, context)?) };
    let state = State::recall(&store);
    let record = previous_record(&store).filter(|record| record.blake3 == state.record_blake3);
    let run_first = "its campaign.json is missing or was changed; run the campaign again first";
    let record = record.ok_or_else(|| refused(run_first))?.record;
    let mut used: BTreeSet<String> = record.flights.iter().map(|row| row.key.clone()).collect();
    used.extend(state.keys().map(str::to_owned));
    used.extend(Manifest::recent(&store).iter().flat_map(Manifest::keys).map(str::to_owned));
    if !dry_run {
        Manifest::remove_old(&store)?;
    }
    sweep(&store, &used, dry_run, context)
}

fn sweep(
    store: &Store,
    used: &BTreeSet<String>,
    dry_run: bool,
    context: &RunContext<'_>,
) -> Result<Garbage, CampaignError> {
    let mut garbage = Garbage::default();
    for (key, files) in by_key(store)? {
        context.stopped()?;
        if used.contains(&key) {
            garbage.kept += 1;
            continue;
        }
        garbage.results += 1;
        garbage.bytes += files.iter().filter_map(|name| store.size(name)).sum::<u64>();
        if !dry_run {
            // Without the list of its files, the rest of a result does not count as one.
            crate::results::remove(store, &key)?;
            files.iter().try_for_each(|name| store.remove(name))?;
            store.remove_empty_folder(&crate::results::folder(&key));
        }
    }
    Ok(garbage)
}

/// Files of every result, by its key.
fn by_key(store: &Store) -> Result<BTreeMap<String, Vec<String>>, CampaignError> {
    let mut results: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for name in store.try_list("by-key")? {
        if let [_, _, key, _] = name.split('/').collect::<Vec<_>>().as_slice() {
            results.entry((*key).to_owned()).or_default().push(name.clone());
        }
    }
    Ok(results)
}
