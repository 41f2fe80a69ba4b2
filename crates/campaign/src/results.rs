//! Where the results of a flight lie, and what belongs to them.
//!
//! `by-key/ab/<key>/` of a replay holds `track.parquet`, `explorer.json` (its rows in few bytes) and, written last, `record.json`: a result with a
//! record is whole. That of a measurement holds `measured.json` and, written last, the short `lateness.json`, which is all that the
//! decision over many flights reads. `trouble.json` instead tells of an attempt that may end otherwise next time.

use crate::error::CampaignError;
use crate::state::Sizes;
use crate::store::{Keep, Store};
use crate::study::Studied;
use crate::table;
use record::{ExplorerRows, FlightLateness, FlightRecord, MeasuredFlight, Outcome};
use serde::Serialize;

/// Folder of a result below the output folder.
pub(crate) fn folder(key: &str) -> String {
    format!("by-key/{}/{key}", key.get(..2).unwrap_or("--"))
}

/// The record: there if and only if the result is whole.
pub(crate) fn record_name(key: &str) -> String {
    format!("{}/record.json", folder(key))
}

/// The compensated track.
pub(crate) fn track_name(key: &str) -> String {
    format!("{}/track.parquet", folder(key))
}

/// The rows that the flight's page lets a reader zoom into.
fn explorer_name(key: &str) -> String {
    format!("{}/explorer.json", folder(key))
}

fn measured_name(key: &str) -> String {
    format!("{}/measured.json", folder(key))
}

fn lateness_name(key: &str) -> String {
    format!("{}/lateness.json", folder(key))
}

fn trouble_name(key: &str) -> String {
    format!("{}/trouble.json", folder(key))
}

/// Whether the result is there.
pub(crate) fn is_there(store: &Store, key: &str) -> bool {
    store.size(&record_name(key)).is_some_and(|bytes| bytes > 0)
}

/// Whether the measurement is there.
pub(crate) fn is_measured(store: &Store, key: &str) -> bool {
    store.size(&lateness_name(key)).is_some_and(|bytes| bytes > 0)
}

/// Whether an earlier attempt ended in trouble.
pub(crate) fn had_trouble(store: &Store, key: &str) -> bool {
    store.size(&trouble_name(key)).is_some()
}

/// Files of a result that is there, with their sizes.
pub(crate) fn sizes(store: &Store, key: &str) -> Sizes {
    let names = [track_name(key), explorer_name(key), record_name(key), measured_name(key), lateness_name(key)];
    names.into_iter().filter_map(|n| store.size(&n).map(|bytes| (n, bytes))).collect()
}

/// Writes a result: the track first, the record last.
pub(crate) fn write(store: &Store, studied: &Studied) -> Result<(), CampaignError> {
    let Studied { record, track, explorer } = studied;
    let name = track_name(&record.key);
    match track {
        Some(track) => table::write_track(store, &name, record, track)?,
        None => store.remove(&name)?,
    }
    let name = explorer_name(&record.key);
    match explorer {
        Some(rows) => store.write(&name, &line_of(rows), Keep::Synced)?,
        None => store.remove(&name)?,
    }
    store.write(&record_name(&record.key), &text_of(record), Keep::Synced)?;
    Ok(store.remove(&trouble_name(&record.key))?)
}

/// Writes a measurement: the whole first, what the decision reads last.
pub(crate) fn write_measured(store: &Store, measured: &MeasuredFlight) -> Result<(), CampaignError> {
    store.write(&measured_name(&measured.key), &line_of(measured), Keep::Synced)?;
    store.write(&lateness_name(&measured.key), &line_of(&measured.lateness), Keep::Synced)?;
    Ok(store.remove(&trouble_name(&measured.key))?)
}

/// What the decision needs of a measurement; `None` if it is missing or not whole. What is left of one that is not whole
/// is removed, so that it is made again.
pub(crate) fn read_lateness(store: &Store, key: &str) -> Result<Option<FlightLateness>, CampaignError> {
    let Some(bytes) = store.read(&lateness_name(key))? else { return Ok(None) };
    let whole = serde_json::from_slice::<FlightLateness>(&bytes).ok().filter(|l| l.key == key);
    if whole.is_none() {
        store.remove(&lateness_name(key))?;
    }
    Ok(whole)
}

/// A measurement; `None` if it is missing or not whole, in which case what is left of it is removed.
pub(crate) fn read_measured(store: &Store, key: &str) -> Result<Option<MeasuredFlight>, CampaignError> {
    let bytes = store.read(&measured_name(key))?.unwrap_or_default();
    let whole = serde_json::from_slice::<MeasuredFlight>(&bytes).ok().filter(|m| m.key == key);
    if whole.is_none() {
        store.remove(&lateness_name(key))?;
    }
    Ok(whole)
}

/// Writes down an attempt that gave no lasting result.
pub(crate) fn write_trouble(store: &Store, key: &str, record: &FlightRecord) -> Result<(), CampaignError> {
    Ok(store.write(&trouble_name(key), &text_of(record), Keep::Synced)?)
}

/// The record of an attempt that gave no lasting result.
pub(crate) fn read_trouble(store: &Store, key: &str) -> Option<FlightRecord> {
    store.read(&trouble_name(key)).ok().flatten().and_then(|bytes| serde_json::from_slice(&bytes).ok())
}

/// The record of a result; `None` if the result is missing or not whole. What is left of a
/// result that is not whole is removed, so that the next plan makes it anew.
pub(crate) fn read(store: &Store, key: &str) -> Result<Option<FlightRecord>, CampaignError> {
    let Some(bytes) = store.read(&record_name(key))? else { return Ok(None) };
    let record = serde_json::from_slice::<FlightRecord>(&bytes).ok().filter(|r| r.key == key);
    let track_fits = |r: &FlightRecord| r.outcome != Outcome::Compensated || store.size(&track_name(key)).is_some();
    match record.filter(track_fits) {
        Some(record) => Ok(Some(record)),
        None => {
            store.remove(&record_name(key))?;
            Ok(None)
        }
    }
}

/// The rows that the flight's page lets a reader zoom into; `None` if there are none or the file is not whole.
pub(crate) fn read_explorer(store: &Store, key: &str) -> Result<Option<ExplorerRows>, CampaignError> {
    let bytes = store.read(&explorer_name(key))?.unwrap_or_default();
    Ok(serde_json::from_slice(&bytes).ok())
}

/// The record as it is written.
pub(crate) fn text_of(record: &FlightRecord) -> Vec<u8> {
    line_of(record)
}

fn line_of(value: &impl Serialize) -> Vec<u8> {
    // The record's types have text keys and no way to fail.
    let mut text = serde_json::to_vec(value).unwrap_or_default();
    text.push(b'\n');
    text
}
