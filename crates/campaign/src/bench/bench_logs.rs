//! The logs of a bench: found, hashed, read, bound.

use super::BenchOrder;
use crate::error::CampaignError;
use crate::event::Event;
use crate::file_stamp::FileStamp;
use crate::logs::Library;
use crate::memory::hash_file;
use crate::plan::why_no_logs;
use crate::run_context::RunContext;
use crate::work::Workers;
use flight::Quantity;
use ingest::{FlightUnit, IngestError, Limits, Loaded, LogError, ReadContext, ScanError};
use record::InputFile;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

/// Size of the buffer for hashing files, bytes.
const PIECE: usize = 1 << 20;

/// A log that was found.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Source {
    pub(super) unit: FlightUnit,
    /// Logs with the same neighbourhood may form a record together.
    pub(super) neighbourhood: PathBuf,
    /// Whether the user gave it as the encoder's log.
    pub(super) is_stated_encoder: bool,
}

impl Source {
    /// The folder of its files.
    pub(super) fn folder(&self) -> PathBuf {
        self.unit.files.first().and_then(|f| f.parent()).unwrap_or(Path::new("")).to_owned()
    }

    /// Its name without folder and extension.
    pub(super) fn stem(&self) -> String {
        let name = self.unit.id.rsplit('/').next().unwrap_or_default();
        Path::new(name).file_stem().unwrap_or_default().to_string_lossy().into_owned()
    }
}

/// A log that was read.
pub(super) struct ReadLog {
    pub(super) source: Source,
    pub(super) inputs: Vec<InputFile>,
    /// The loaded log, or why it is unusable.
    pub(super) loaded: Result<Loaded, String>,
}

impl ReadLog {
    /// Its role on the bench, or why it has none.
    pub(super) fn role(&self) -> Result<Role, String> {
        let loaded = self.loaded.as_ref().map_err(Clone::clone)?;
        loaded.binding.as_ref().map_err(Clone::clone)?;
        let quantities = || loaded.flight.channels.values().map(|c| c.quantity);
        let is_encoder = |q: Quantity| matches!(q, Quantity::EncoderCount | Quantity::EncoderAngle);
        let is_sensor = |q: Quantity| !is_encoder(q) && !matches!(q, Quantity::Pulse | Quantity::Scalar);
        match (quantities().any(is_encoder), quantities().any(is_sensor)) {
            (true, true) => Ok(Role::Both),
            (true, false) => Ok(Role::Encoder),
            (false, true) => Ok(Role::Sensor),
            (false, false) => Err("this log has neither an encoder nor a sensor channel".to_owned()),
        }
    }
}

/// Role of a log on the bench.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Role {
    Both,
    Encoder,
    Sensor,
}

/// The logs below the given paths, in their order.
pub(super) fn find(order: &BenchOrder, library: &Library) -> Result<Vec<Source>, CampaignError> {
    let mut sources = vec![];
    for path in &order.records {
        sources.extend(below(path, order.records.len() > 1, false, library)?);
    }
    if let Some(path) = &order.encoder {
        if sources.len() != 1 {
            let what = format!("--encoder is for one log of a sensor, but there are {}", sources.len());
            return Err(CampaignError::Asked(what));
        }
        let encoder = below(path, false, true, library)?;
        if encoder.len() != 1 {
            return Err(CampaignError::Asked(format!("{}: --encoder must be one log", path.display())));
        }
        sources.extend(encoder);
    }
    Ok(sources)
}

/// The logs below a path. Their names are prefixed with that of the path where they would be ambiguous: if there are
/// `several` paths, or no more logs than one record needs.
fn below(path: &Path, several: bool, is_stated_encoder: bool, library: &Library) -> Result<Vec<Source>, CampaignError> {
    let wrong = |what: &str| CampaignError::Asked(format!("{}: {what}", path.display()));
    let root = path.canonicalize().map_err(|e| wrong(&e.to_string()))?;
    let found = library.discover(path).map_err(|e| wrong(&e.to_string()))?;
    if let Some((name, reason)) = found.unreadable.first() {
        return Err(CampaignError::TryAgain(format!("{}: {name}: {reason}", path.display())));
    }
    if found.units.is_empty() {
        let reason = found.ignored.first().filter(|_| path.is_file()).map(|(_, reason)| reason.clone());
        let why = || why_no_logs(found.ignored.iter().map(|(file, why)| (file.as_str(), why.as_str())));
        return Err(wrong(&reason.unwrap_or_else(|| format!("no log found in this folder: {}", why()))));
    }
    let is_one_log = matches!(found.units.as_slice(), [only] if root.is_file() || only.files.len() > 1);
    let folder = root.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let is_prefixed = !is_one_log && (several || found.units.len() <= 2);
    let source = |mut unit: FlightUnit| {
        let neighbourhood = neighbourhood(&root, is_one_log, &unit);
        if is_prefixed {
            unit.id = format!("{folder}/{}", unit.id);
        }
        Source { unit, neighbourhood, is_stated_encoder }
    };
    Ok(found.units.into_iter().map(source).collect())
}

/// The folder that contains a log: a file, or a folder that is one log.
fn neighbourhood(root: &Path, is_one_log: bool, unit: &FlightUnit) -> PathBuf {
    match (is_one_log, unit.id.rsplit_once('/')) {
        (true, _) => root.parent().unwrap_or(root).to_owned(),
        (false, Some((folder, _))) => root.join(folder),
        (false, None) => root.to_owned(),
    }
}

/// Reads every log once.
pub(super) fn read(
    sources: &[Source],
    library: &Library,
    forced: Option<&str>,
    context: &RunContext<'_>,
) -> Result<Vec<ReadLog>, CampaignError> {
    let files = sources.iter().flat_map(|s| &s.unit.files);
    let bytes = files.filter_map(|f| std::fs::metadata(f).ok()).map(|about| about.len()).sum();
    context.send(Event::Logs { logs: sources.len(), bytes });
    let one = |piece: &mut Vec<u8>, source: &Source| read_one(source, library, forced, context, piece);
    let logs = Workers::start(context.threads)?.each(sources, context.cancel, || vec![0; PIECE], one);
    context.stopped()?;
    logs.into_iter().map(|log| log.unwrap_or(Err(CampaignError::Cancelled))).collect()
}

fn read_one(
    source: &Source,
    library: &Library,
    forced: Option<&str>,
    context: &RunContext<'_>,
    piece: &mut [u8],
) -> Result<ReadLog, CampaignError> {
    let stamps: Vec<_> = source.unit.files.iter().map(|f| FileStamp::of(f).ok()).collect();
    let (inputs, trouble) = hash_inputs(source, &stamps, context, piece)?;
    let on_bytes = |bytes| context.send(Event::Read { bytes });
    let reading = ReadContext { limits: Limits::default(), cancel: context.cancel, on_bytes: &on_bytes };
    let loaded = match (trouble, library.load(&source.unit, forced, &reading)) {
        (Some(trouble), _) => Err(trouble),
        (None, Err(IngestError::Log(LogError::Read(ScanError::Cancelled)))) => return Err(CampaignError::Cancelled),
        (None, Err(e)) => Err(e.to_string()),
        (None, Ok(loaded)) => Ok(loaded),
    };
    let changed = || source.unit.files.iter().zip(&stamps).any(|(f, stamp)| FileStamp::of(f).ok() != *stamp);
    let loaded = loaded.and_then(|loaded| match changed() {
        true => Err("the log changed while it was read".to_owned()),
        false => Ok(loaded),
    });
    Ok(ReadLog { source: source.clone(), inputs, loaded })
}

/// The files of a log with their hashes, and why one of them is unreadable.
fn hash_inputs(
    source: &Source,
    stamps: &[Option<FileStamp>],
    context: &RunContext<'_>,
    piece: &mut [u8],
) -> Result<(Vec<InputFile>, Option<String>), CampaignError> {
    let mut inputs = vec![];
    let mut trouble = None;
    for (path, stamp) in source.unit.files.iter().zip(stamps) {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        match hash_file(path, piece, |_| !context.cancel.load(Ordering::Relaxed)) {
            Ok(Some(blake3)) => {
                let bytes = stamp.as_ref().map(|s| s.bytes).unwrap_or_default();
                inputs.push(InputFile { name, bytes, blake3 });
            }
            Ok(None) => return Err(CampaignError::Cancelled),
            Err(e) => trouble = Some(format!("{name}: {e}")),
        }
    }
    Ok((inputs, trouble))
}
