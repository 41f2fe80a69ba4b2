//! The second file of a flight: where it is, and what it adds to the flight.

use crate::config::Pipeline;
use crate::error::CampaignError;
use crate::logs::Library;
use compensation_replay::{ClockRule, join_reference, relate_clocks};
use flight::{Flight, Severity};
use ingest::{FlightUnit, IngestError, ReadContext};
use record::{ChannelLateness, DelayNetwork, ReferenceClock, ReferenceFile};
use serde::{Serialize, Serializer};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Stands for the name of the log without its ending.
const STEM: &str = "{stem}";

/// Where the second file of each flight is, and how its clock is treated.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct ReferenceRule {
    /// Path, relative to the folder of the log; `{stem}` is the log's name without its ending, `*` anything.
    #[serde(serialize_with = "without_place")]
    pub(crate) file: String,
    pub(crate) clock: ClockRule,
}

/// Where a file lies is no part of the meaning; what is in it is.
fn without_place<S: Serializer>(file: &str, serializer: S) -> Result<S::Ok, S::Error> {
    let path = Path::new(file);
    let name = path.file_name().filter(|_| path.is_absolute()).map(|name| name.to_string_lossy());
    serializer.serialize_str(name.as_deref().unwrap_or(file))
}

/// The files of a flight and of its reference.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FlightFiles {
    pub(crate) unit: FlightUnit,
    /// `None` without a rule.
    pub(crate) reference: Option<FoundReference>,
}

/// The reference file of a flight.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum FoundReference {
    /// As it is read.
    There(FlightUnit),
    /// There is none.
    Missing { file: String, reason: String },
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

/// Gives every flight its reference file. A file that is the reference of another flight is no flight.
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
    let mut out = vec![];
    for (unit, found) in units.iter().zip(&found).filter(|(unit, _)| !is_reference(unit)) {
        let reference = match found {
            Ok(path) => read_as(path, &units, library)?,
            Err((file, reason)) => FoundReference::Missing { file: file.clone(), reason: reason.clone() },
        };
        out.push(FlightFiles { unit: unit.clone(), reference: Some(reference) });
    }
    if out.len() > 1 && !rule.is_pattern() {
        return Err(CampaignError::Asked(format!(
            "{}: one reference file for {} flights; give a pattern in which {STEM} stands for the name of the log, as {STEM}.pos",
            rule.file,
            out.len()
        )));
    }
    Ok(out)
}

/// The log of a reference file: one that was found as a flight, or else is looked at now.
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

impl ReferenceRule {
    fn is_pattern(&self) -> bool {
        self.file.contains(STEM) || self.file.contains('*')
    }

    /// The reference file of a flight; else its name and why there is none.
    fn file_of(&self, unit: &FlightUnit) -> Result<PathBuf, (String, String)> {
        let first = unit.files.first().map(PathBuf::as_path).unwrap_or(Path::new(""));
        let stem = match unit.files.as_slice() {
            [one] => one.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
            // Several files have what their names share.
            _ => unit.id.rsplit('/').next().unwrap_or_default().to_owned(),
        };
        let wanted = self.file.replace(STEM, &stem);
        let path = first.parent().unwrap_or(Path::new("")).join(&wanted);
        let missing = |reason: &str| (wanted.clone(), reason.to_owned());
        let path = if wanted.contains('*') { only_match(&path, &unit.files).map_err(|r| missing(&r))? } else { path };
        let path = path.canonicalize().map_err(|e| match e.kind() {
            std::io::ErrorKind::NotFound => missing("there is no such file"),
            _ => missing(&e.to_string()),
        })?;
        let is_own = unit.files.iter().any(|f| f.canonicalize().is_ok_and(|f| f == path));
        if is_own { Err(missing("it is the log itself")) } else { Ok(path) }
    }
}

/// The one file whose name fits, beside those of the flight.
fn only_match(pattern: &Path, own: &[PathBuf]) -> Result<PathBuf, String> {
    let name = pattern.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let folder = pattern.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let entries = std::fs::read_dir(folder).map_err(|e| e.to_string())?;
    let fits = |path: &PathBuf| {
        path.file_name().is_some_and(|f| matches(&name, &f.to_string_lossy())) && !own.contains(path) && path.is_file()
    };
    let mut found: Vec<PathBuf> = entries.flatten().map(|e| e.path()).filter(fits).collect();
    found.sort();
    match found.as_slice() {
        [] => Err("no file has such a name".to_owned()),
        [one] => Ok(one.clone()),
        [first, second, ..] => Err(format!(
            "{} files have such a name, among them {} and {}",
            found.len(),
            first.file_name().unwrap_or_default().display(),
            second.file_name().unwrap_or_default().display()
        )),
    }
}

/// Whether a name fits a pattern in which `*` stands for any text.
fn matches(pattern: &str, name: &str) -> bool {
    match pattern.split_once('*') {
        None => pattern == name,
        Some((begin, rest)) => name.strip_prefix(begin).is_some_and(|name| {
            let starts = name.char_indices().map(|(at, _)| at).chain([name.len()]);
            starts.into_iter().any(|at| name.get(at..).is_some_and(|tail| matches(rest, tail)))
        }),
    }
}

/// A reference file that was read, or why it could not be.
pub(crate) struct ReferenceLog {
    files: Vec<String>,
    read: Result<Flight, String>,
}

impl ReferenceLog {
    /// Reads it.
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
                return Ok(ReferenceLog { files: vec![file.clone()], read: Err(reason.clone()) });
            }
        };
        let name = |f: &PathBuf| f.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let read = match library.load(unit, None, context) {
            Err(IngestError::Cancelled) => return Err(IngestError::Cancelled),
            Err(error) => Err(error.to_string()),
            Ok(loaded) => loaded.binding.map(|_| loaded.flight),
        };
        Ok(ReferenceLog { files: unit.files.iter().map(name).collect(), read })
    }

    /// Adds its channels to the flight; their clock is related as the pipeline says.
    pub(crate) fn join(&self, flight: &mut Flight, pipeline: &Pipeline) -> ReferenceFile {
        let rule = pipeline.reference_file().map(|rule| rule.clock).unwrap_or_default();
        let (positions, settings) = (pipeline.position_and_velocity().0, pipeline.measure_settings());
        let clock = match &self.read {
            Ok(reference) => relate_clocks(flight, reference, positions, rule, &settings),
            Err(reason) => ReferenceClock::Unknown { reason: reason.clone() },
        };
        self.join_as(flight, pipeline, clock)
    }

    /// Adds its channels to the flight, with the clock that was found before.
    pub(crate) fn join_as(&self, flight: &mut Flight, pipeline: &Pipeline, clock: ReferenceClock) -> ReferenceFile {
        let channels = match &self.read {
            Ok(reference) => join_reference(flight, reference, pipeline.position_and_velocity().0, &clock),
            Err(_) => vec![],
        };
        if let Ok(reference) = &self.read {
            for n in reference.notices.iter().filter(|n| n.severity != Severity::Info) {
                flight.notices.push(
                    n.severity,
                    &n.code,
                    format!("reference file, {}", n.place),
                    n.count,
                    n.text.clone(),
                );
            }
        }
        let words = words(&self.files, &clock);
        ReferenceFile { files: self.files.clone(), channels, clock, words }
    }
}

/// The reference with the lateness of its channels taken out of the offset of its clock, as the network found it: it is then
/// on time where the network has a datum, else it is as late as the channel that counts as on time.
pub(crate) fn settled(reference: ReferenceFile, network: Option<&DelayNetwork>) -> ReferenceFile {
    let ReferenceClock::Own(offset) = &reference.clock else { return reference };
    let channel = reference.channels.iter().find_map(|name| network?.channel(name));
    let Some(ChannelLateness { lateness_s, relative_to, .. }) = channel else { return reference };
    let mut offset = offset.clone();
    offset.offset_ns = offset.offset_ns.saturating_sub((1e9 * lateness_s.value).round() as i64);
    offset.standard_uncertainty_s = lateness_s.standard_uncertainty.unwrap_or(offset.standard_uncertainty_s);
    offset.by = relative_to.clone().unwrap_or_else(|| "the IMU".to_owned());
    let clock = ReferenceClock::Own(offset);
    ReferenceFile { words: words(&reference.files, &clock), clock, ..reference }
}

fn words(files: &[String], clock: &ReferenceClock) -> String {
    let files = files.join(", ");
    match clock {
        ReferenceClock::Same => format!("{files}: its clock is that of the log"),
        ReferenceClock::Own(offset) => {
            let expanded_ms = 2e3 * offset.standard_uncertainty_s;
            let drift = offset.drift.map_or(String::new(), |drift| {
                let u = drift.standard_uncertainty.map_or(String::new(), |u| format!(" ± {:.0}", 2e6 * u));
                format!(", and gains {:.0}{u} µs each second", 1e6 * drift.value)
            });
            format!(
                "{files}: it has a clock of its own; that of the log less this one is {:.4} s ± {expanded_ms:.1} ms (k = 2), with {} \
                 on time{drift}",
                offset.offset_ns as f64 * 1e-9,
                offset.by
            )
        }
        ReferenceClock::Unknown { reason } => format!("{files} is not used: {reason}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_star_stands_for_anything() {
        for (pattern, name, fits) in [
            ("a*.pos", "a.pos", true),
            ("a*.pos", "a_1.pos", true),
            ("a*.pos", "b.pos", false),
            ("*", "", true),
            ("*é*", "caffé.csv", true),
            ("a*b*c", "a-bb-c", true),
            ("a*b*c", "a-c", false),
        ] {
            assert_eq!(matches(pattern, name), fits, "{pattern} {name}");
        }
    }
}
