//! `flightlag delay`: lateness of the positions of some logs. Reads, measures, decides; writes nothing.

use crate::answer;
use crate::config::Pipeline;
use crate::decide::{self, Decided};
use crate::error::{CampaignError, Exit};
use crate::event::Event;
use crate::fetch::{Brought, Logs};
use crate::filter_values;
use crate::line::{DelayLine, LineParts, LineSetting};
use crate::logs::Library;
use crate::losses;
use crate::plan::why_no_logs;
use crate::reference::{FlightFiles, ReferenceLog, settle, with_references};
use crate::run_context::RunContext;
use crate::slug::slugs;
use crate::task::caught;
use crate::work::Workers;
use compensation_replay::{TruthEffect, effect};
use flight::{Code, Notice, Notices, Severity};
use ingest::{FlightUnit, IngestError, Limits, Loaded, LogError, ReadContext, ScanError};
use record::{
    Decision, DelayAlarm, DelaySource, Effect, EkfValues, FlightLateness, Gravity, GroupLateness, MeasuredFlight,
    ReferenceFile,
};
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

/// Logs up to this size stay in memory between measuring and judging, bytes. Larger ones are read again if a reference
/// judges them.
const KEPT_BYTES: u64 = 64 << 20;

/// The request of the user.
#[derive(Debug, Clone, PartialEq)]
pub struct DelayOrder {
    /// Logs and folders of logs.
    pub paths: Vec<PathBuf>,
    /// Settings.
    pub pipeline: Pipeline,
    /// Whether to include values for the design of a filter.
    pub filter_values: bool,
}

/// Lateness of the positions of some flights.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelayReport {
    /// Version of this layout: 1.
    pub schema: u32,
    /// One entry for each flight, sorted by name.
    pub flights: Vec<DelayLine>,
    /// One entry for each group of flights that may share a delay, the largest first.
    pub groups: Vec<GroupLine>,
    /// Values for the design of a filter by the folder name of each measured flight, if requested.
    #[serde(skip)]
    pub filter_values: BTreeMap<String, EkfValues>,
}

/// Lateness of the position in one group of flights.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct GroupLine {
    /// Receiver, firmware, rate, map and log kind.
    pub group: String,
    /// Number of flights, duplicates counted once.
    pub flights: u64,
    /// Number of flights in the mean.
    pub pooled: u64,
    /// Mean lateness, s.
    pub lateness_s: Option<f64>,
    /// Its standard uncertainty (k = 1), s.
    pub lateness_u_s: Option<f64>,
    /// Lower end of its 95 % interval, s.
    pub lateness_low_s: Option<f64>,
    /// Upper end of that interval, s.
    pub lateness_high_s: Option<f64>,
    /// Datum of the lateness.
    pub datum: String,
    /// Spread between flights beyond their own uncertainties, s.
    pub between_s: Option<f64>,
    /// Summary as a sentence.
    pub words: String,
    /// Flights that differ from the others.
    pub outliers: Vec<String>,
    /// Settings that remove the delay.
    pub set: Vec<LineSetting>,
}

impl GroupLine {
    /// The line of a group.
    #[must_use]
    pub fn of(group: &GroupLateness) -> GroupLine {
        GroupLine {
            group: group.group.name.clone(),
            flights: group.flights,
            pooled: group.pooled,
            lateness_s: group.lateness_s.map(|e| e.value),
            lateness_u_s: group.lateness_s.and_then(|e| e.standard_uncertainty),
            lateness_low_s: group.interval_95_s.map(|i| i[0]),
            lateness_high_s: group.interval_95_s.map(|i| i[1]),
            datum: group.against.clone(),
            between_s: group.between_s,
            words: group.words.clone(),
            outliers: group.outliers.clone(),
            set: group.advice.set.iter().cloned().map(LineSetting::of).collect(),
        }
    }
}

impl DelayReport {
    /// 4 if a flight is harmed by the delay that the pipeline states; else 3 if some failed, are damaged, have a
    /// changing delay or an unusable reference file; else 0. If the only log is unusable: 2 if the cause is a channel
    /// map of the user that does not fit it, else 1.
    #[must_use]
    pub fn exit(&self) -> Exit {
        let any = |of: &dyn Fn(&DelayLine) -> bool| self.flights.iter().any(of);
        if any(&|l| l.effect == "harmed") {
            Exit::CriterionFailed
        } else if self.flights.len() == 1 && any(&|l| l.alarms.iter().any(|a| a.code == Code::MapLacks)) {
            Exit::Wrong
        } else if self.flights.len() == 1 && any(&|l| l.data == "failed") {
            Exit::Failed
        } else if any(&|l| l.data == "damaged" || l.data == "failed" || l.varies() || l.lacks_reference()) {
            Exit::Incomplete
        } else {
            Exit::Well
        }
    }

    /// The flights as CSV.
    ///
    /// # Errors
    /// `out` cannot be written.
    pub fn write_csv(&self, out: &mut dyn std::io::Write) -> std::io::Result<()> {
        crate::table::write_lines(&self.flights, out)
    }
}

/// The JSON schema of [`DelayReport`], as text.
#[cfg(feature = "schema")]
pub(crate) fn delay_schema() -> String {
    let schema = schemars::schema_for!(DelayReport);
    serde_json::to_string_pretty(&schema).map(|text| text + "\n").unwrap_or_default()
}

/// A flight that was measured.
struct Measured {
    lateness: FlightLateness,
    damaged: bool,
    minor_loss: bool,
    tail_cut: bool,
    warnings: u64,
    warning_texts: Vec<String>,
    has_reference: bool,
    kept: Option<Loaded>,
    filter_values: Option<EkfValues>,
}

/// Measures the flights of `order`.
///
/// # Errors
/// A missing path, a folder without a flight, a wrong map, or the user stopped. An unreadable log is a line of the
/// report instead.
pub fn delay_report(order: &DelayOrder, context: &RunContext<'_>) -> Result<DelayReport, CampaignError> {
    let library = Library::open(order.pipeline.maps_folder(), order.pipeline.forced_map())?;
    library.check(&order.pipeline)?;
    let places: Vec<Logs> = order.paths.iter().map(|path| Logs::below(path)).collect::<Result<_, _>>()?;
    places.iter().try_for_each(|logs| logs.fetch_heads(context.threads, context.cancel))?;
    let (units, unreadable) = units_of(order, &places, &library)?;
    places.iter().for_each(Logs::drop_heads);
    let sizes: Vec<u64> = units.iter().map(|(_, unit)| size_of(unit)).collect();
    let bytes = sizes.iter().sum();
    let stage = Some(crate::manifest::Stage::Measure);
    context.send(Event::Planned { stage, flights: units.len(), reused: 0, to_run: units.len(), bytes });
    let reader = Reader { library: &library, places: &places, order, context, keep: bytes <= KEPT_BYTES };
    let workers = Workers::start(context.threads)?;
    let measured = reader.measure_all(&units, &sizes, &workers)?;
    let named: Vec<(&str, &FlightLateness)> =
        units.iter().zip(&measured).map(|((name, _), m)| (name.as_str(), &m.lateness)).collect();
    let decided = decide::over(&named, &order.pipeline);
    let all: Vec<(&(String, FlightFiles), &Measured)> = units.iter().zip(&measured).collect();
    let line =
        |(): &mut (), (unit, measured): &(&(String, FlightFiles), &Measured)| reader.line(unit, measured, &decided);
    let measured_lines = workers.each(&all, context.cancel, || (), line).into_iter().flatten();
    context.stopped()?;
    let unreadable_lines = unreadable.iter().map(|(name, reason)| failed_line(name, reason));
    let mut flights: Vec<DelayLine> = measured_lines.chain(unreadable_lines).collect();
    flights.sort_by(|a, b| a.flight.cmp(&b.flight));
    let groups = decided.groups.iter().map(GroupLine::of).collect();
    Ok(DelayReport { schema: 1, flights, groups, filter_values: by_folder(&units, &measured) })
}

/// The line of a file that may be a log and could not be opened.
fn failed_line(name: &str, reason: &str) -> DelayLine {
    let Measured { lateness, .. } = Measured::failed(reason);
    let (lateness, failed) = (Some(&lateness), Some(reason));
    DelayLine::of(&LineParts { flight: name, lateness, failed, ..LineParts::default() })
}

/// Values for the design of a filter by flight folder name, for flights that have some.
fn by_folder(units: &[(String, FlightFiles)], measured: &[Measured]) -> BTreeMap<String, EkfValues> {
    let folders = slugs(units.iter().map(|(name, _)| name.as_str()));
    let values = units.iter().zip(measured).filter_map(|((name, _), m)| Some((name, m.filter_values.clone()?)));
    values.filter_map(|(name, v)| Some((folders.get(name)?.clone(), v))).collect()
}

/// Total size of the files of a flight, bytes.
fn size_of(unit: &FlightFiles) -> u64 {
    unit.all().filter_map(|f| std::fs::metadata(f).ok()).map(|m| m.len()).sum()
}

/// Names of files that may be logs, and why each could not be opened.
type Unreadable = Vec<(String, String)>;

/// The flights of all paths with their names, sorted, and what could not be opened.
fn units_of(
    order: &DelayOrder,
    places: &[Logs],
    library: &Library,
) -> Result<(Vec<(String, FlightFiles)>, Unreadable), CampaignError> {
    let (mut units, mut unreadable) = (vec![], vec![]);
    for (path, logs) in order.paths.iter().zip(places) {
        let found = library.discover(logs.root()).map_err(|e| match e {
            IngestError::Log(LogError::Read(ScanError::Io { file, source, .. })) => {
                CampaignError::Asked(format!("{file}: {source}"))
            }
            other => CampaignError::Ingest(other),
        })?;
        if found.units.is_empty() {
            let files = found.ignored.iter().chain(&found.unreadable);
            let what = why_no_logs(files.map(|(file, why)| (file.as_str(), why.as_str())));
            return Err(CampaignError::NoFlights { path: path.clone(), what });
        }
        let several = order.paths.len() > 1 && logs.root().is_dir();
        let name = |id: &str| match several {
            true => format!("{}/{id}", path.display()),
            false => id.to_owned(),
        };
        unreadable.extend(found.unreadable.iter().map(|(file, why)| (name(file), why.clone())));
        units.extend(found.units.into_iter().map(|unit| (name(&unit.id), unit)));
    }
    units.sort_by(|a, b| a.0.cmp(&b.0));
    // The user may give a flight twice, by its folder and by its file.
    let mut known = BTreeSet::new();
    units.retain(|(_, unit)| known.insert(unit.files.clone()));
    let (names, units): (Vec<String>, Vec<FlightUnit>) = units.into_iter().unzip();
    let name_of: BTreeMap<Vec<PathBuf>, String> = units.iter().map(|u| u.files.clone()).zip(names).collect();
    let cases = with_references(units, order.pipeline.reference_file(), library)?;
    let named = cases.into_iter().filter_map(|case| Some((name_of.get(&case.unit.files)?.clone(), case))).collect();
    Ok((named, unreadable))
}

struct Reader<'a> {
    library: &'a Library,
    places: &'a [Logs],
    order: &'a DelayOrder,
    context: &'a RunContext<'a>,
    /// Whether logs stay in memory until they are judged.
    keep: bool,
}

impl Measured {
    fn failed(reason: &str) -> Measured {
        let lateness = answer::failed("", reason.to_owned()).lateness;
        Measured {
            lateness,
            damaged: false,
            minor_loss: false,
            tail_cut: false,
            warnings: 0,
            warning_texts: vec![],
            has_reference: false,
            kept: None,
            filter_values: None,
        }
    }
}

impl Measured {
    /// A vehicle at rest is not replayed, whatever the decision.
    fn may_be_replayed(&self, decision: &Decision) -> bool {
        let forced = decision.asked == DelaySource::Fixed;
        self.lateness.lateness.is_some() || forced || self.lateness.speed_rms_mps.is_some_and(|v| v > AT_REST_MPS)
    }
}

/// Below this rms speed a vehicle is at rest, m/s.
const AT_REST_MPS: f64 = 0.3;

impl Reader<'_> {
    fn load(&self, files: &FlightFiles) -> Result<(Loaded, Option<ReferenceLog>), String> {
        let on_bytes = |bytes| self.context.send(Event::Read { bytes });
        let reading = ReadContext { limits: Limits::default(), cancel: self.context.cancel, on_bytes: &on_bytes };
        let paths: Vec<PathBuf> = files.all().cloned().collect();
        // Each place provides the files below it; those of a folder are local already.
        let here = self.places.iter().map(|logs| logs.bring(&paths, self.context.cancel));
        let _here: Vec<Vec<Brought<'_>>> = here.collect::<Result<_, _>>().map_err(|e| e.to_string())?;
        let loaded = self.library.load(&files.unit, self.order.pipeline.forced_map(), &reading);
        let loaded = loaded.map_err(|e| e.to_string())?;
        let read = |found| ReferenceLog::read(found, self.library, &reading);
        let reference = files.reference.as_ref().map(read).transpose().map_err(|e| e.to_string())?;
        Ok((loaded, reference))
    }

    /// Measures all flights, the largest first.
    fn measure_all(
        &self,
        units: &[(String, FlightFiles)],
        sizes: &[u64],
        workers: &Workers,
    ) -> Result<Vec<Measured>, CampaignError> {
        let mut queue: Vec<usize> = (0..units.len()).collect();
        queue.sort_by_key(|&i| std::cmp::Reverse(sizes[i]));
        let one = |(): &mut (), &i: &usize| self.measure(&units[i].0, &units[i].1);
        let answers = workers.each(&queue, self.context.cancel, || (), one);
        self.context.stopped()?;
        let mut measured: Vec<Option<Measured>> = units.iter().map(|_| None).collect();
        for (&i, answer) in queue.iter().zip(answers) {
            measured[i] = answer;
        }
        Ok(measured.into_iter().map(|m| m.unwrap_or_else(|| Measured::failed("stopped"))).collect())
    }

    fn measure(&self, name: &str, files: &FlightFiles) -> Measured {
        let measured = caught(|| self.measured(files))
            .unwrap_or_else(|panic| Measured::failed(&format!("a defect in flightlag, please report it: {panic}")));
        let lateness = &measured.lateness;
        self.context.send(Event::DelayMeasured {
            flight: name.to_owned(),
            kind: lateness.kind,
            lateness_s: lateness.lateness_s(),
            words: lateness.words.clone(),
        });
        measured
    }

    fn measured(&self, files: &FlightFiles) -> Measured {
        let (mut loaded, reference) = match self.load(files) {
            Ok(both) => both,
            Err(reason) => return Measured::failed(&reason),
        };
        let joined = reference.as_ref().map(|reference| reference.join(&mut loaded.flight, &self.order.pipeline));
        let (damaged, tail_cut) = (loaded.flight.notices.any_loss(), loaded.health.bytes.tail_cut > 0);
        let minor_loss = loaded.flight.notices.iter().any(|notice| notice.code == Code::MinorLoss);
        let pipeline = &self.order.pipeline;
        let (mut measured, filter_values) = self.answer(&loaded, joined);
        settle(&mut loaded.flight, reference.as_ref(), &measured.lateness, pipeline);
        measured.lateness.alarms.extend(losses::alarm(&loaded.flight.notices, &loaded.health));
        measured.lateness.alarms.extend(wrong_map(&loaded.flight.notices));
        measured.lateness.alarms.sort();
        let mut notices = loaded.flight.notices.clone();
        notices.extend_unsaid(measured.notices);
        let warnings = notices.count_of(Severity::Warning);
        let warning_texts = warning_texts(&notices, &measured.lateness.alarms);
        let has_reference = loaded.flight.first_of(pipeline.reference()).is_some();
        let kept = (self.keep && has_reference).then_some(loaded);
        Measured {
            lateness: measured.lateness,
            damaged,
            minor_loss,
            tail_cut,
            warnings,
            warning_texts,
            has_reference,
            kept,
            filter_values,
        }
    }

    /// The delays of a log, with the values for the design of a filter if requested.
    fn answer(&self, loaded: &Loaded, joined: Option<ReferenceFile>) -> (MeasuredFlight, Option<EkfValues>) {
        let Loaded { flight, health, binding, companion } = loaded;
        match (companion, binding) {
            (Some(what), _) => (answer::companion("", what.clone()), None),
            (None, Ok(binding)) => {
                let measured = answer::measure("", flight, health, binding, joined, &self.order.pipeline);
                let wanted = self.order.filter_values.then(|| filter_values::of(&measured, binding)).flatten();
                (measured, wanted)
            }
            (None, Err(reason)) => (answer::failed("", reason.clone()), None),
        }
    }

    /// The line of a flight, with the effect of the removal.
    fn line(&self, (name, unit): &(String, FlightFiles), measured: &Measured, decided: &Decided<'_>) -> DelayLine {
        let decision = decided.decisions.get(name.as_str());
        let effect = decision.and_then(|decision| self.effect(unit, measured, decision));
        DelayLine::of(&LineParts {
            flight: name,
            lateness: Some(&measured.lateness),
            decision,
            effect: effect.as_ref(),
            failed: measured.lateness.failed.as_deref(),
            pending: None,
            damaged: measured.damaged,
            minor_loss: measured.minor_loss,
            tail_cut: measured.tail_cut,
            warnings: measured.warnings,
            warning_texts: &measured.warning_texts,
            replayed: decision.is_some_and(|d| measured.may_be_replayed(d)),
            duplicate_of: decided.duplicate_of.get(name.as_str()).copied(),
        })
    }

    /// The effect of the removal: against the reference if the log has one, else by the lateness.
    fn effect(&self, files: &FlightFiles, measured: &Measured, decision: &Decision) -> Option<Effect> {
        measured.lateness.velocity.as_ref()?;
        let read;
        let flight = match (&measured.kept, measured.has_reference) {
            (Some(kept), _) => Some(&kept.flight),
            (None, true) => {
                read = self.load(files).ok().map(|(mut loaded, reference)| {
                    settle(&mut loaded.flight, reference.as_ref(), &measured.lateness, &self.order.pipeline);
                    loaded.flight
                });
                read.as_ref()
            }
            (None, false) => None,
        };
        let settings = self.order.pipeline.provisional();
        let truth = |flight| TruthEffect::of(flight, &settings, decision.delay_s.unwrap_or(0.0)).ok().flatten();
        let truth = flight.and_then(|flight| caught(|| truth(flight)).ok().flatten());
        let truth = truth.and_then(|truth| crate::known_lateness::judging(truth, &measured.lateness));
        let known = crate::known_lateness::known(&measured.lateness, decision);
        let removed_s = decision.delay_s.filter(|_| measured.may_be_replayed(decision));
        Some(effect(truth.as_ref(), known.as_ref(), crate::known_lateness::motion(&measured.lateness), removed_s))
    }
}

/// The warnings that no alarm says, each once.
fn warning_texts(notices: &Notices, alarms: &[DelayAlarm]) -> Vec<String> {
    // A place that is empty or begins the text itself is not written before it.
    let words = |notice: &Notice| match notice.text.starts_with(&notice.place) {
        true => notice.text.clone(),
        false => format!("{}: {}", notice.place.trim_end_matches(", "), notice.text),
    };
    let is_alarm = |notice: &Notice| alarms.iter().any(|alarm| alarm.text.ends_with(&notice.text));
    let of_warnings = notices.iter().filter(|notice| notice.severity == Severity::Warning && !is_alarm(notice));
    let mut texts: Vec<String> = vec![];
    for text in of_warnings.map(words) {
        if !texts.contains(&text) {
            texts.push(text);
        }
    }
    texts
}

/// An alarm if a channel map of the user does not fit.
fn wrong_map(notices: &Notices) -> Option<DelayAlarm> {
    let notice = notices.iter().find(|notice| notice.code == Code::MapLacks)?;
    Some(DelayAlarm { gravity: Gravity::Red, code: notice.code.clone(), text: notice.text.clone() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_map_of_the_user_that_does_not_fit_is_a_red_alarm() {
        let mut notices = Notices::new();
        notices.push(Code::Assumption, "csv", 1, "altitude is taken as metres");
        assert_eq!(wrong_map(&notices), None);
        notices.push(Code::MapLacks, "own.toml", 1, "no column velocity_n");
        let alarm = wrong_map(&notices).unwrap();
        assert_eq!((alarm.gravity, alarm.text.as_str()), (Gravity::Red, "no column velocity_n"));
    }

    #[test]
    fn a_harmed_flight_outweighs_a_damaged_one() {
        let whole = DelayLine::of(&LineParts { flight: "a", ..LineParts::default() });
        let report = |flights: Vec<DelayLine>| DelayReport { schema: 1, flights, ..DelayReport::default() }.exit();
        let with = |change: &dyn Fn(&mut DelayLine)| {
            let mut line = whole.clone();
            change(&mut line);
            line
        };
        let harmed = with(&|l| l.effect = "harmed".into());
        let damaged = with(&|l| l.data = "damaged".into());
        let tail_cut = with(&|l| l.data = "tail-cut".into());
        let queues = with(&|l| l.kind = "queues+bursts".into());
        let failed = with(&|l| l.data = "failed".into());
        assert_eq!(report(vec![whole.clone()]), Exit::Well);
        assert_eq!(report(vec![tail_cut]), Exit::Well, "power goes off at the end of most logs");
        assert_eq!(report(vec![whole.clone(), damaged.clone()]), Exit::Incomplete);
        assert_eq!(report(vec![queues]), Exit::Incomplete, "a delay that changes is no result to rely on");
        let text = "a.pos is not used: the file does not exist".to_owned();
        let alarm = crate::line::LineAlarm { gravity: "amber".into(), code: "reference-not-used".into(), text };
        let alone = with(&|l| l.alarms.push(alarm.clone()));
        assert_eq!(report(vec![alone]), Exit::Incomplete, "what was asked for was not done");
        assert_eq!(report(vec![failed.clone()]), Exit::Failed);
        assert_eq!(report(vec![failed, whole.clone()]), Exit::Incomplete);
        assert_eq!(report(vec![damaged, harmed]), Exit::CriterionFailed);
    }
}
