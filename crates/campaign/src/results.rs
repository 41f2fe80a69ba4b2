//! Files of the results of a flight.
//!
//! `by-key/ab/<key>/` of a replay holds `track.parquet`, `explorer.json` (its rows in few bytes), `points.bin` (the
//! points of its figures) and `record.json.gz`. For a record longer than 64 kB, `details.json.gz` holds its long lists.
//! The folder of a measurement holds `measured.json.gz` and the short `lateness.json`, the only input of the decision
//! over many flights. Both hold `files.json`, written last: the hash of every file of the result. A result with that
//! list is complete, and every file read from it is compared with its hash. `trouble.json` instead records an attempt
//! that may succeed next time.

use crate::details;
use crate::error::CampaignError;
use crate::points;
use crate::rows::{gunzip, gzip};
use crate::store::{Check, Files, Keep, Kept, Store};
use crate::study::Studied;
use crate::table;
use record::{ExplorerRows, FlightLateness, FlightRecord, MeasuredFlight, Outcome, PipelineUse, RECORD_VERSION};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use std::io;
use std::path::Path;

/// The compensated track.
pub(crate) const TRACK: &str = "track.parquet";
/// The record of a flight, under its key and next to its page.
pub(crate) const RECORD: &str = "record.json.gz";
/// The long lists of a record that would be longer than 64 kB, in a file next to it.
pub(crate) const DETAILS: &str = "details.json.gz";
/// The rows for the zoom on the flight's page.
const EXPLORER: &str = "explorer.json";
/// The points of its figures.
const POINTS: &str = "points.bin";
const MEASURED: &str = "measured.json.gz";
const LATENESS: &str = "lateness.json";
const FILES: &str = "files.json";
const TROUBLE: &str = "trouble.json";

/// Maximum inflated size of a record.
const MOST_BYTES: u64 = 1 << 30;

/// Folder of a result below the output folder.
pub(crate) fn folder(key: &str) -> String {
    format!("by-key/{}/{key}", key.get(..2).unwrap_or("--"))
}

fn name(key: &str, base: &str) -> String {
    format!("{}/{base}", folder(key))
}

/// The list of files of a result: exists if and only if the result is complete.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct ResultFiles {
    key: String,
    record_version: u32,
    /// By name in the folder of the result.
    files: BTreeMap<String, ResultFile>,
}

#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct ResultFile {
    bytes: u64,
    blake3: String,
}

impl ResultFiles {
    /// The list of a result; `None` if it is missing or of another version.
    pub(crate) fn of(store: &Store, key: &str) -> Option<ResultFiles> {
        let bytes = store.read(&name(key, FILES)).ok().flatten()?;
        let list = serde_json::from_slice::<ResultFiles>(&bytes).ok()?;
        (list.key == key && list.record_version == RECORD_VERSION).then_some(list)
    }

    fn blake3(&self, base: &str) -> Option<&str> {
        self.files.get(base).map(|file| file.blake3.as_str())
    }

    /// Whether a file of the list exists with its size; with [`Check::Full`], with its content.
    fn has(&self, store: &Store, base: &str, check: Check) -> bool {
        let Some(file) = self.files.get(base) else { return false };
        let name = name(&self.key, base);
        store.size(&name) == Some(file.bytes)
            && (check == Check::Quick || store.hash(&name).as_ref() == Some(&file.blake3))
    }

    fn is_whole(&self, store: &Store, check: Check) -> bool {
        self.files.keys().all(|base| self.has(store, base, check))
    }

    /// The current files including the list, with the hashes that they should have.
    pub(crate) fn kept(&self, store: &Store) -> Files {
        let listed = self.files.iter().map(|(base, file)| (name(&self.key, base), file.blake3.clone()));
        let list = name(&self.key, FILES);
        let own = store.hash(&list).map(|blake3| (list, blake3));
        listed.chain(own).filter_map(|(name, blake3)| Some((name.clone(), store.kept(&name, &blake3)?))).collect()
    }
}

/// Whether the result or measurement exists and is complete.
pub(crate) fn is_there(store: &Store, key: &str, check: Check) -> bool {
    ResultFiles::of(store, key).is_some_and(|list| list.is_whole(store, check))
}

/// Whether an earlier attempt ended in trouble.
pub(crate) fn had_trouble(store: &Store, key: &str) -> bool {
    store.size(&name(key, TROUBLE)).is_some()
}

/// A result being written.
struct Writer<'a> {
    store: &'a Store,
    list: ResultFiles,
}

impl Writer<'_> {
    fn begin<'a>(store: &'a Store, key: &str) -> Writer<'a> {
        let list = ResultFiles { key: key.to_owned(), record_version: RECORD_VERSION, files: BTreeMap::new() };
        Writer { store, list }
    }

    fn add(&mut self, base: &str, kept: Kept) {
        let file = ResultFile { bytes: kept.stamp.bytes, blake3: kept.blake3 };
        self.list.files.insert(base.to_owned(), file);
    }

    fn write(&mut self, base: &str, bytes: &[u8]) -> Result<(), CampaignError> {
        let kept = self.store.write(&name(&self.list.key, base), bytes, Keep::Part)?;
        self.add(base, kept);
        Ok(())
    }

    /// Removes a file that an earlier writer may have left under this name.
    fn without(&self, base: &str) -> Result<(), CampaignError> {
        Ok(self.store.remove(&name(&self.list.key, base))?)
    }

    /// Writes the list, which completes the result. In a bucket, an existing list of a complete result stays, and this
    /// one, with the same bytes, is dropped.
    fn finish(self) -> Result<(), CampaignError> {
        let (files, list) = (name(&self.list.key, FILES), line_of(&self.list));
        if self.store.write_first(&files, &list)?.is_none() {
            let first = ResultFiles::of(self.store, &self.list.key);
            let is_whole = |first: ResultFiles| first == self.list || first.is_whole(self.store, Check::Full);
            if !first.is_some_and(is_whole) {
                // Another writer's list names files that are gone or changed. The files of this writer exist.
                self.store.write(&files, &list, Keep::Synced)?;
            }
        }
        self.without(TROUBLE)
    }
}

/// Writes a result. Its record identifies the settings only by hash, because the result may be reused under another
/// title.
pub(crate) fn write(store: &Store, studied: &Studied) -> Result<(), CampaignError> {
    let Studied { record, track, explorer } = studied;
    let mut writer = Writer::begin(store, &record.key);
    match track {
        Some(track) => {
            let kept = table::write_track(store, &name(&record.key, TRACK), record, track.as_ref())?;
            writer.add(TRACK, kept);
        }
        None => writer.without(TRACK)?,
    }
    match explorer {
        Some(rows) => writer.write(EXPLORER, &line_of(rows))?,
        None => writer.without(EXPLORER)?,
    }
    let pipeline = PipelineUse { title: String::new(), blake3: String::new(), toml: String::new() };
    let (lean, points) = without_points(FlightRecord { pipeline, ..record.clone() });
    let (short, details) = without_details(lean);
    for (base, part) in [(POINTS, points), (DETAILS, details)] {
        match part {
            Some(part) => writer.write(base, &part)?,
            None => writer.without(base)?,
        }
    }
    writer.write(RECORD, &short)?;
    writer.finish()
}

/// A record with the points of its figures replaced by empty lists, and these points.
fn without_points(record: FlightRecord) -> (FlightRecord, Option<Vec<u8>>) {
    let Ok(mut value) = record.to_value() else { return (record, None) };
    let points = points::take(&mut value);
    match FlightRecord::from_value(value) {
        Ok(lean) if points.is_some() => (lean, points),
        _ => (record, None),
    }
}

/// The file of a record, and the file of its long lists if they would make it too long.
fn without_details(record: FlightRecord) -> (Vec<u8>, Option<Vec<u8>>) {
    let json = record.to_json();
    let shortened = || {
        let mut value = record.to_value().ok()?;
        let details = details::take(&mut value)?;
        Some((FlightRecord::from_value(value).ok()?.to_json(), details))
    };
    match (json.len() > details::MOST).then(shortened).flatten() {
        Some((short, details)) => (gzip(&short), Some(gzip(&details))),
        None => (gzip(&json), None),
    }
}

/// A record from its JSON, its long lists and the points of its figures.
fn with_parts(mut record: Value, details: Option<&[u8]>, points: Option<&[u8]>) -> Option<FlightRecord> {
    if let Some(details) = details {
        details::put_back(&mut record, &gunzip(details, MOST_BYTES).ok()?)?;
    }
    if let Some(points) = points {
        points::put_back(&mut record, points)?;
    }
    FlightRecord::from_value(record).ok()
}

/// Writes a measurement.
pub(crate) fn write_measured(store: &Store, measured: &MeasuredFlight) -> Result<(), CampaignError> {
    let mut writer = Writer::begin(store, &measured.key);
    writer.write(MEASURED, &gzip(&measured.to_json()))?;
    writer.write(LATENESS, &line_of(&measured.lateness))?;
    writer.finish()
}

/// An unchanged file of a result; `None` if it is missing or was changed. Then the list of the result is removed, so
/// that it is made again.
fn read_checked(store: &Store, key: &str, base: &str, blake3: Option<&str>) -> Result<Option<Vec<u8>>, CampaignError> {
    let bytes = store.read(&name(key, base))?;
    let whole = bytes.filter(|bytes| Some(blake3::hash(bytes).to_hex().as_str()) == blake3);
    if whole.is_none() {
        remove(store, key)?;
    }
    Ok(whole)
}

/// Invalidates a result, so that it is made again.
pub(crate) fn remove(store: &Store, key: &str) -> Result<(), CampaignError> {
    Ok(store.remove(&name(key, FILES))?)
}

/// The part of a measurement that the decision needs; `None` if it is missing or damaged. `known` are its files, if in
/// the state.
pub(crate) fn read_lateness(
    store: &Store,
    key: &str,
    known: Option<&Files>,
) -> Result<Option<FlightLateness>, CampaignError> {
    let blake3 = match known.and_then(|files| files.get(&name(key, LATENESS))) {
        Some(kept) => Some(kept.blake3.clone()),
        None => match ResultFiles::of(store, key) {
            Some(list) => list.blake3(LATENESS).map(str::to_owned),
            None => return Ok(None),
        },
    };
    let bytes = read_checked(store, key, LATENESS, blake3.as_deref())?;
    Ok(bytes.and_then(|bytes| FlightLateness::from_json(&bytes).ok()).filter(|l| l.key == key))
}

/// A measurement; `None` if it is missing or damaged.
pub(crate) fn read_measured(store: &Store, key: &str) -> Result<Option<MeasuredFlight>, CampaignError> {
    let Some(list) = ResultFiles::of(store, key) else { return Ok(None) };
    let bytes = read_checked(store, key, MEASURED, list.blake3(MEASURED))?;
    let text = bytes.and_then(|bytes| gunzip(&bytes, MOST_BYTES).ok());
    Ok(text.and_then(|text| MeasuredFlight::from_json(&text).ok()).filter(|m| m.key == key))
}

/// Writes the record of an attempt without a lasting result.
pub(crate) fn write_trouble(store: &Store, key: &str, record: &FlightRecord) -> Result<(), CampaignError> {
    Ok(store.write_sealed(&name(key, TROUBLE), &record.to_value().unwrap_or_default())?)
}

/// The record of an attempt without a lasting result.
pub(crate) fn read_trouble(store: &Store, key: &str) -> Option<FlightRecord> {
    FlightRecord::from_value(store.read_sealed(&name(key, TROUBLE))?).ok()
}

/// The record of a result, with its current files; `None` if the result is missing, of another version or damaged.
pub(crate) fn read(store: &Store, key: &str) -> Result<Option<(FlightRecord, ResultFiles)>, CampaignError> {
    let Some(list) = ResultFiles::of(store, key) else { return Ok(None) };
    let bytes = read_checked(store, key, RECORD, list.blake3(RECORD))?;
    let text = bytes.and_then(|bytes| gunzip(&bytes, MOST_BYTES).ok());
    let value = text.and_then(|text| serde_json::from_slice::<Value>(&text).ok());
    let mut parts = [None, None];
    for (part, base) in parts.iter_mut().zip([DETAILS, POINTS]) {
        let Some(blake3) = list.blake3(base) else { continue };
        *part = read_checked(store, key, base, Some(blake3))?;
        if part.is_none() {
            return Ok(None);
        }
    }
    let [details, points] = parts;
    let fits = |r: &FlightRecord| {
        let has_track = list.has(store, TRACK, Check::Quick);
        r.key == key && r.record_version == RECORD_VERSION && (r.outcome != Outcome::Compensated || has_track)
    };
    let record = value.and_then(|value| with_parts(value, details.as_deref(), points.as_deref())).filter(fits);
    match record {
        Some(record) => Ok(Some((record, list))),
        None => {
            remove(store, key)?;
            Ok(None)
        }
    }
}

/// The rows for the zoom on the flight's page; `None` if the result has none.
///
/// # Errors
/// They were changed. The result is removed.
pub(crate) fn read_explorer(
    store: &Store,
    list: &ResultFiles,
) -> Result<Result<Option<ExplorerRows>, Damaged>, CampaignError> {
    let Some(blake3) = list.blake3(EXPLORER) else { return Ok(Ok(None)) };
    let bytes = read_checked(store, &list.key, EXPLORER, Some(blake3))?;
    let rows = bytes.and_then(|bytes| serde_json::from_slice(&bytes).ok());
    Ok(rows.map(Some).ok_or(Damaged))
}

/// A file of a result was changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Damaged;

/// Path of the track, for a link from the flight's page; `None` if the result has none.
///
/// # Errors
/// The track was changed. The result is removed.
pub(crate) fn track_of(store: &Store, list: &ResultFiles) -> Result<Result<Option<String>, Damaged>, CampaignError> {
    let Some(blake3) = list.blake3(TRACK) else { return Ok(Ok(None)) };
    let track = name(&list.key, TRACK);
    if store.hash(&track).as_deref() == Some(blake3) {
        return Ok(Ok(Some(track)));
    }
    remove(store, &list.key)?;
    Ok(Err(Damaged))
}

/// The record file next to the flight's page, without the points, which are in the files of the figures; and the file
/// of its long lists.
pub(crate) fn for_page(record: &FlightRecord) -> (Vec<u8>, Option<Vec<u8>>) {
    without_details(without_points(record.clone()).0)
}

/// The JSON of the record next to a flight's page, with the lists of `details.json.gz` but without the points of its
/// figures; `None` if there is none.
///
/// # Errors
/// A file cannot be read, is not a gzip file, or the lists do not belong to the record.
pub fn record_of_page(page: &Path) -> io::Result<Option<Vec<u8>>> {
    let read = |base: &str| match std::fs::read(page.with_file_name(base)) {
        Ok(bytes) => gunzip(&bytes, MOST_BYTES).map(Some),
        Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(e) => Err(e),
    };
    let (Some(record), details) = (read(RECORD)?, read(DETAILS)?) else { return Ok(None) };
    let Some(details) = details else { return Ok(Some(record)) };
    let mut value = serde_json::from_slice::<Value>(&record)?;
    match details::put_back(&mut value, &details) {
        Some(()) => Ok(Some(line_of(&value))),
        None => Err(io::Error::new(io::ErrorKind::InvalidData, format!("{DETAILS} does not belong to this record"))),
    }
}

fn line_of(value: &impl Serialize) -> Vec<u8> {
    // The record's types have text keys and cannot fail.
    let mut text = serde_json::to_vec(value).unwrap_or_default();
    text.push(b'\n');
    text
}
