//! The second file of a flight: its location, and the channels that it adds.

use crate::config::Pipeline;
use crate::error::CampaignError;
use crate::known_lateness;
use crate::logs::Library;
use crate::manifest::FoundReference;
use crate::reference_rule::ReferenceRule;
use crate::reference_rule::STEM;
use compensation_replay::{Likeness, join_reference, likeness, relate_clocks};
use flight::{Flight, Notice, Severity};
use ingest::{FlightUnit, IngestError, LogError, ReadContext, ScanError};
use record::{ChannelLateness, DelayNetwork, FlightLateness, ReferenceClock, ReferenceFile};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Two files show the same motion if the correlation of their velocities is at least this,
const LEAST_ALIKE: f64 = 0.9;
/// exceeds that with any other axes by this,
const DECIDES: f64 = 0.05;
/// and their speeds agree within this, as a logarithm.
const SAME_SCALE: f64 = 0.15;

/// Prefix of the places in notices of a reference file.
pub(crate) const OF_REFERENCE_FILE: &str = "reference file";
/// Introduces what was bound by the motion of the log.
const AXES_ARE: &str = "; its columns were bound by the motion of the log: ";

/// The files of a flight and of its reference.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FlightFiles {
    pub(crate) unit: FlightUnit,
    /// `None` without a rule.
    pub(crate) reference: Option<FoundReference>,
}

impl FlightFiles {
    /// All files.
    pub(crate) fn all(&self) -> impl Iterator<Item = &PathBuf> {
        let reference = match &self.reference {
            Some(FoundReference::There(unit)) => unit.files.as_slice(),
            _ => &[],
        };
        self.unit.files.iter().chain(reference)
    }
}

/// Assigns every flight its reference file. A file that is the reference of another flight is not a flight.
pub(crate) fn with_references(
    units: Vec<FlightUnit>,
    rule: Option<&ReferenceRule>,
    library: &Library,
) -> Result<Vec<FlightFiles>, CampaignError> {
    let Some(rule) = rule else {
        return Ok(units.into_iter().map(|unit| FlightFiles { unit, reference: None }).collect());
    };
    let found: Vec<Result<PathBuf, (String, String)>> = units.iter().map(|unit| rule.file_of(unit)).collect();
    let paths: BTreeSet<&PathBuf> = found.iter().flatten().collect();
    let is_reference =
        |unit: &FlightUnit| unit.files.iter().all(|f| f.canonicalize().is_ok_and(|f| paths.contains(&f)));
    let flights = || units.iter().zip(&found).filter(|(unit, _)| !is_reference(unit));
    if flights().all(|(_, found)| found.is_err())
        && let Some((_, Err((file, reason)))) = flights().next()
    {
        return Err(CampaignError::Asked(rule.none_found(file, reason)));
    }
    let mut out = vec![];
    for (unit, found) in flights() {
        let reference = match found {
            Ok(path) => read_as(path, &units, library)?,
            Err((file, reason)) => FoundReference::Missing { file: file.clone(), reason: reason.clone() },
        };
        out.push(FlightFiles { unit: unit.clone(), reference: Some(reference) });
    }
    if out.len() > 1 && !rule.is_pattern() {
        return Err(CampaignError::Asked(format!(
            "{}: one reference file for {} other flights; give a pattern in which {STEM} is the name of the log, such as \
             {STEM}.pos",
            rule.file,
            out.len()
        )));
    }
    Ok(out)
}

/// The log of a reference file: found as a flight already, or else examined now.
fn read_as(path: &Path, units: &[FlightUnit], library: &Library) -> Result<FoundReference, CampaignError> {
    let is_it = |unit: &&FlightUnit| unit.files.iter().any(|f| f.canonicalize().is_ok_and(|f| f == path));
    if let Some(unit) = units.iter().find(is_it) {
        return Ok(FoundReference::There(unit.clone()));
    }
    let found = library.discover(path).map_err(CampaignError::Ingest)?;
    let file = path.display().to_string();
    let reason = || {
        let why = found.ignored.iter().chain(&found.unreadable).map(|(_, why)| why.clone()).next();
        why.unwrap_or_else(|| "no log".to_owned())
    };
    Ok(match found.units.into_iter().next() {
        Some(unit) => FoundReference::There(unit),
        None => FoundReference::Missing { reason: reason(), file },
    })
}

/// A loaded reference file, or why it is unreadable.
pub(crate) struct ReferenceLog {
    files: Vec<String>,
    read: Result<Flight, String>,
    /// If its table does not define its axes: the possible orientations, and what each binds.
    orientations: Vec<(Flight, String)>,
}

impl ReferenceLog {
    /// Reads the reference file.
    ///
    /// # Errors
    /// Only if the user stopped.
    pub(crate) fn read(
        found: &FoundReference,
        library: &Library,
        context: &ReadContext<'_>,
    ) -> Result<ReferenceLog, IngestError> {
        let unit = match found {
            FoundReference::There(unit) => unit,
            FoundReference::Missing { file, reason } => {
                return Ok(ReferenceLog { files: vec![file.clone()], read: Err(reason.clone()), orientations: vec![] });
            }
        };
        let name = |f: &PathBuf| f.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let read = match library.load(unit, None, context) {
            Err(IngestError::Log(LogError::Read(ScanError::Cancelled))) => {
                return Err(IngestError::Log(LogError::Read(ScanError::Cancelled)));
            }
            Err(error) => Err(error.to_string()),
            Ok(loaded) => loaded.binding.map(|_| loaded.flight),
        };
        let orientations = match &read {
            Err(_) => ingest::load_orientations(unit, context).or_else(|error| match error {
                IngestError::Log(LogError::Read(ScanError::Cancelled)) => Err(error),
                _ => Ok(vec![]),
            })?,
            Ok(_) => vec![],
        };
        Ok(ReferenceLog { files: unit.files.iter().map(name).collect(), read, orientations })
    }

    /// The reference with the axes that match the log, and what was bound if the log had to decide.
    fn judged(&self, flight: &Flight, wanted: &[String]) -> Result<(&Flight, Option<&str>), String> {
        let why = match &self.read {
            Ok(reference) => return Ok((reference, None)),
            Err(why) => why,
        };
        let mut alike: Vec<(Likeness, &Flight, &str)> = vec![];
        for (orientation, summary) in &self.orientations {
            alike.extend(likeness(flight, orientation, wanted).map(|found| (found, orientation, summary.as_str())));
        }
        alike.sort_by(|a, b| b.0.correlation.total_cmp(&a.0.correlation));
        let Some((best, orientation, summary)) = alike.first() else { return Err(why.clone()) };
        let next = alike.get(1).map_or(-1.0, |(next, ..)| next.correlation);
        if best.correlation < LEAST_ALIKE || best.correlation - next < DECIDES {
            return Err(format!(
                "{why}. The comparison with the log is also not conclusive: no order and sign of its axes fits the \
                 motion clearly better than the others (best correlation of the velocities {:.2}, next {next:.2})",
                best.correlation
            ));
        }
        if best.scale.ln().abs() > SAME_SCALE {
            return Err(format!(
                "read as {summary}, it moves {:.2} times as fast as the log: state the unit in the name of its column, \
                 such as vn_kmh",
                best.scale
            ));
        }
        Ok((orientation, Some(summary)))
    }

    /// Adds its channels to the flight, with the clock relation from the pipeline.
    pub(crate) fn join(&self, flight: &mut Flight, pipeline: &Pipeline) -> ReferenceFile {
        let rule = pipeline.reference_file().map(|rule| rule.clock).unwrap_or_default();
        let (positions, settings) = (pipeline.position_and_velocity().0, pipeline.measure_settings());
        let clock = match self.judged(flight, positions) {
            Ok((reference, _)) => relate_clocks(flight, reference, positions, rule, &settings),
            Err(reason) => ReferenceClock::Unknown { reason },
        };
        self.join_as(flight, pipeline, clock)
    }

    /// Adds its channels to the flight, with the clock relation found before.
    pub(crate) fn join_as(&self, flight: &mut Flight, pipeline: &Pipeline, clock: ReferenceClock) -> ReferenceFile {
        let wanted = pipeline.position_and_velocity().0;
        let Ok((reference, said)) = self.judged(flight, wanted) else {
            let words = words(&self.files, &clock);
            return ReferenceFile { files: self.files.clone(), channels: vec![], clock, words };
        };
        let said = said.map(|said| format!("{AXES_ARE}{said}"));
        let channels = join_reference(flight, reference, wanted, &clock);
        for n in reference.notices.iter().filter(|n| n.severity != Severity::Info && said.is_none()) {
            let place = format!("{OF_REFERENCE_FILE}, {}", n.place);
            flight.notices.add(Notice { place, ..n.clone() });
        }
        let words = words(&self.files, &clock) + said.as_deref().unwrap_or_default();
        ReferenceFile { files: self.files.clone(), channels, clock, words }
    }
}

/// Sets the final clock of the reference file once the network is solved. A reference whose clock is contradicted leaves
/// the flight: it judges nothing.
pub(crate) fn settle(
    flight: &mut Flight,
    reference: Option<&ReferenceLog>,
    lateness: &FlightLateness,
    pipeline: &Pipeline,
) {
    if let Some((reference, known)) = reference.zip(lateness.reference_file.as_ref()) {
        reference.join_as(flight, pipeline, known.clock.clone());
    }
    if known_lateness::is_contradicted(lateness) {
        let of_file = lateness.reference_file.iter().flat_map(|file| &file.channels);
        for name in of_file.chain(pipeline.reference()) {
            flight.channels.remove(name);
        }
    }
}

/// The reference with its lateness according to the network removed from its clock offset. It is then on time if the
/// network has a datum, else as late as the channel that counts as on time.
pub(crate) fn settled(reference: ReferenceFile, network: Option<&DelayNetwork>) -> ReferenceFile {
    let ReferenceClock::Own(offset) = &reference.clock else { return reference };
    let channel = reference.channels.iter().find_map(|name| network?.channel(name));
    let Some(ChannelLateness { lateness_s, relative_to, .. }) = channel else { return reference };
    let mut offset = offset.clone();
    offset.offset_ns = offset.offset_ns.saturating_sub((1e9 * lateness_s.value).round() as i64);
    offset.standard_uncertainty_s = lateness_s.standard_uncertainty.unwrap_or(offset.standard_uncertainty_s);
    offset.by = relative_to.clone().unwrap_or_else(|| "the IMU".to_owned());
    let clock = ReferenceClock::Own(offset);
    let axes = reference.words.find(AXES_ARE).and_then(|at| reference.words.get(at..)).unwrap_or_default();
    ReferenceFile { words: words(&reference.files, &clock) + axes, clock, ..reference }
}

fn words(files: &[String], clock: &ReferenceClock) -> String {
    let files = files.join(", ");
    match clock {
        ReferenceClock::Same => format!("{files}: it uses the clock of the log"),
        ReferenceClock::Own(offset) => {
            let expanded_ms = 2e3 * offset.standard_uncertainty_s;
            let drift = offset.drift.map_or(String::new(), |drift| {
                let u = drift.standard_uncertainty.map_or(String::new(), |u| format!(" ± {:.0}", 2e6 * u));
                format!("; the clock of the log gains {:.0}{u} µs per second", 1e6 * drift.value)
            });
            format!(
                "{files}: it has its own clock; the clock of the log minus this clock is {:.4} s ± {expanded_ms:.1} \
                 ms (k = 2), with {} on time{drift}",
                offset.offset_ns as f64 * 1e-9,
                offset.by
            )
        }
        ReferenceClock::Unknown { reason } => format!("{files} is not used: {reason}"),
    }
}
