//! From the files of a flight to the flight.

use crate::bind::bind;
use crate::companion::companion;
use crate::discover::FlightUnit;
use crate::error::IngestError;
use crate::format::{
    BagReader, CsvReader, DataFlashReader, Db3Reader, McapReader, NmeaReader, TlogReader, UbxReader, UlogReader,
    UnpackingReader,
};
use crate::map::MapLibrary;
use crate::reader::{Log, LogReader, ReadContext};
use crate::sniff::LogKind;
use flight::{Binding, Flight, LogHealth};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// A log that was read, and the flight in it.
#[derive(Debug)]
pub struct Loaded {
    /// The flight; without channels if no map fits.
    pub flight: Flight,
    /// How the reading went.
    pub health: LogHealth,
    /// Which map bound what, or why none did.
    pub binding: Result<Binding, String>,
    /// What the log is, if it is no flight but goes with one.
    pub companion: Option<String>,
}

/// A reader for the files of a flight, packed or not. The ledger of a packed log counts unpacked bytes.
#[must_use]
pub fn open(unit: &FlightUnit) -> Box<dyn LogReader> {
    Box::new(UnpackingReader::new(unit.clone()))
}

/// A reader for files that are not packed.
pub(crate) fn reader_of(kind: LogKind, files: Vec<PathBuf>) -> Box<dyn LogReader> {
    match kind {
        LogKind::Csv => Box::new(CsvReader::new(files)),
        LogKind::Mcap => Box::new(McapReader::new(files)),
        LogKind::Bag => Box::new(BagReader::new(files)),
        LogKind::Ulog => Box::new(UlogReader::new(files)),
        LogKind::DataFlash => Box::new(DataFlashReader::new(files)),
        LogKind::Tlog => Box::new(TlogReader::new(files)),
        LogKind::Db3 => Box::new(Db3Reader::new(files)),
        LogKind::Nmea => Box::new(NmeaReader::new(files)),
        LogKind::Ubx => Box::new(UbxReader::new(files)),
    }
}

/// Reads the files of a flight once and binds what they hold. `forced` names the channel map.
///
/// If no map fits, the health of the log comes back all the same, with the reason in the binding.
///
/// # Errors
/// As [`LogReader::read`]; [`IngestError::Changed`] if a file changed in the meantime;
/// [`IngestError::Map`] if there is no map of the name `forced`.
pub fn load(
    unit: &FlightUnit,
    library: &MapLibrary,
    forced: Option<&str>,
    context: &ReadContext<'_>,
) -> Result<Loaded, IngestError> {
    let select = library.select(forced)?;
    let before = states(&unit.files)?;
    let mut log = open(unit).read(&select, context)?;
    if let Some(file) = changed(&before, &states(&unit.files)?) {
        return Err(IngestError::Changed { file });
    }
    let (flight, binding) = match bind(&log, library, forced) {
        Ok((flight, binding)) => {
            note_stamps(&mut log, &binding);
            log.health.utc = flight.utc.clone();
            (flight, Ok(binding))
        }
        Err(IngestError::Map(reason)) => (Flight { notices: log.notices.clone(), ..Flight::default() }, Err(reason)),
        Err(error) => return Err(error),
    };
    let companion = companion(&log.health, &flight).map(str::to_owned);
    Ok(Loaded { flight, health: log.health, binding, companion })
}

/// Formats without stamps of their own get those of their bound channels.
fn note_stamps(log: &mut Log, binding: &Binding) {
    for channel in &binding.channels {
        let topic = log.health.topics.iter_mut().find(|t| t.name == channel.source.topic);
        if let (Some(topic), Some(stamps)) = (topic, &channel.stamps)
            && topic.stamps.iter().all(|s| s.kind != stamps.kind)
        {
            topic.stamps.push(stamps.clone());
        }
    }
}

/// What shows that a file was written to.
type State = (PathBuf, u64, Option<SystemTime>);

fn states(files: &[PathBuf]) -> Result<Vec<State>, IngestError> {
    let state = |path: &PathBuf| {
        let about =
            std::fs::metadata(path).map_err(|source| IngestError::Io { file: name_of(path), offset: 0, source })?;
        Ok((path.clone(), about.len(), about.modified().ok()))
    };
    files.iter().map(state).collect()
}

fn changed(before: &[State], after: &[State]) -> Option<String> {
    before.iter().zip(after).find(|(a, b)| a != b).map(|((path, ..), _)| name_of(path))
}

fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}
