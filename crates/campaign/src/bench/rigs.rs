//! The rig of each record: one for all, or the file next to it.

use super::bench_logs::ReadLog;
use super::pair::{MadeOf, Swing};
use crate::error::CampaignError;
use crate::plan::why_no_logs;
use bench_analysis::Rig;
use std::path::{Path, PathBuf};

const ENDING: &str = ".rig.toml";

/// The rig of every record.
pub(super) fn of(swings: &[Swing], logs: &[ReadLog], shared: Option<Rig>) -> Result<Vec<Rig>, CampaignError> {
    no_record(swings, logs)?;
    if let Some(rig) = shared {
        return Ok(vec![rig; swings.len()]);
    }
    swings.iter().map(|swing| Ok(Rig::read(&sidecar(swing, logs)?)?)).collect()
}

/// The rig file of a record: named like the record or like one of its logs, or the only one in the folder.
fn sidecar(swing: &Swing, logs: &[ReadLog]) -> Result<PathBuf, CampaignError> {
    let mut tried = vec![];
    for log in swing.logs().into_iter().filter_map(|i| logs.get(i)) {
        let folder = log.source.folder();
        let stems = [log.source.stem(), swing.stem.clone()];
        tried.extend(stems.iter().map(|stem| folder.join(format!("{stem}{ENDING}"))));
        // A folder that is a record may have its rig file next to it.
        if let (Some(parent), Some(name)) = (folder.parent(), folder.file_name()) {
            tried.push(parent.join(format!("{}{ENDING}", name.to_string_lossy())));
        }
        tried.extend(only_one(&folder));
    }
    if let Some(found) = tried.iter().find(|path| path.is_file()) {
        return Ok(found.clone());
    }
    let looked_for = tried.first().map(|p| p.display().to_string()).unwrap_or_default();
    let what =
        format!("{}: no rig file: give --rig FILE, or put a rig file into its folder ({looked_for})", swing.name);
    Err(CampaignError::Asked(what))
}

/// If no log of a folder is of a bench, reports why for each: a rig file would not help.
fn no_record(swings: &[Swing], logs: &[ReadLog]) -> Result<(), CampaignError> {
    let why = |swing: &Swing| match &swing.made_of {
        MadeOf::Nothing { reason, .. } => Some((swing.name.clone(), reason.clone())),
        MadeOf::One(_) | MadeOf::Two { .. } => None,
    };
    let reasons: Option<Vec<(String, String)>> = swings.iter().map(why).collect();
    match reasons {
        // For a single log, its row gives the reason.
        Some(reasons) if logs.len() > 1 => Err(CampaignError::Asked(format!(
            "none of the {} logs is a bench record: {}",
            logs.len(),
            why_no_logs(reasons.iter().map(|(name, why)| (name.as_str(), why.as_str())))
        ))),
        _ => Ok(()),
    }
}

/// The rig file of a folder that contains exactly one.
fn only_one(folder: &Path) -> Option<PathBuf> {
    let entries = std::fs::read_dir(folder).ok()?.flatten().map(|e| e.path());
    let is_rig = |p: &PathBuf| p.file_name().is_some_and(|n| n.to_string_lossy().ends_with(ENDING));
    let rigs: Vec<PathBuf> = entries.filter(is_rig).collect();
    if let [only] = rigs.as_slice() { Some(only.clone()) } else { None }
}
