//! The study of one flight: from the log to its delays, then to record and track.

use crate::answer;
use crate::config::{FlightCase, Pipeline};
use crate::delay::measured_pair;
use crate::error::CampaignError;
use crate::event::Event;
use crate::logs::Library;
use crate::manifest::{Manifest, Planned, PlannedReference};
use crate::reference::{ReferenceLog, settle};
use crate::run_context::RunContext;
use compensation_replay::{Replay, Sweeper, TrackRows, TruthEffect, effect, replay, sketch};
use flight::{Code, Notices};
use ingest::{IngestError, Limits, Loaded, LogError, ReadContext, ScanError};
use record::{Decision, DelaySource, Effect, ExplorerRows, FlightRecord, MeasuredFlight, Outcome, ReplayRecord};

/// The lasting result of a flight: the same log and settings always give the same.
#[derive(Debug)]
pub(crate) struct Studied {
    pub(crate) record: FlightRecord,
    pub(crate) track: Option<Box<dyn TrackRows>>,
    pub(crate) explorer: Option<ExplorerRows>,
}

impl Studied {
    fn without_track(record: FlightRecord) -> Studied {
        Studied { record, track: None, explorer: None }
    }
}

/// Why there is no lasting result.
#[derive(Debug)]
pub(crate) enum Interrupted {
    /// The user stopped.
    Cancelled,
    /// A temporary problem: a disk that does not respond.
    Trouble(String),
    /// A permanent problem.
    Lasting(String),
}

/// Makes the results of one flight. There is one real study; tests replace it.
pub(crate) trait Study: Sync {
    /// Measures the delays of the flight.
    fn measure(
        &self,
        flight: &Planned,
        manifest: &Manifest,
        context: &RunContext<'_>,
    ) -> Result<MeasuredFlight, Interrupted>;

    /// Its record with the delay removed that the plan decided.
    fn study(
        &self,
        flight: &Planned,
        measured: MeasuredFlight,
        manifest: &Manifest,
        context: &RunContext<'_>,
    ) -> Result<Studied, Interrupted>;
}

/// Reads the log and replays the compensators.
pub(crate) struct Replaying {
    library: Library,
    pipeline: Pipeline,
}

impl Replaying {
    /// Prepares everything that the manifest requires.
    pub(crate) fn prepare(manifest: &Manifest) -> Result<Replaying, CampaignError> {
        let pipeline = Pipeline::of_manifest(&manifest.pipeline.toml, &manifest.cards)?;
        let library = Library::open(manifest.maps_folder.as_deref(), pipeline.forced_map())?;
        if library.blake3() != manifest.maps_blake3 {
            return Err(CampaignError::Outdated("channel maps have changed since the plan".to_owned()));
        }
        Ok(Replaying { library, pipeline })
    }

    /// The flight, and its reference file if it has one.
    fn load(
        &self,
        planned: &Planned,
        context: &RunContext<'_>,
    ) -> Result<Result<(Loaded, Option<ReferenceLog>), String>, Interrupted> {
        let on_bytes = |bytes| context.send(Event::Read { bytes });
        let reading = ReadContext { limits: Limits::default(), cancel: context.cancel, on_bytes: &on_bytes };
        let trouble = || Interrupted::Lasting("its format is unknown".to_owned());
        let unit = planned.unit().ok_or_else(trouble)?;
        let read = |found: PlannedReference| ReferenceLog::read(&found.found(), &self.library, &reading);
        let both = self.library.load(&unit, self.pipeline.forced_map(), &reading).and_then(|loaded| {
            let reference = planned.reference.clone().map(read).transpose()?;
            Ok((loaded, reference))
        });
        match both {
            Ok(both) => Ok(Ok(both)),
            Err(IngestError::Log(LogError::Read(ScanError::Cancelled))) => Err(Interrupted::Cancelled),
            Err(e) if is_denied(&e) || matches!(e, IngestError::Log(LogError::Read(ScanError::Changed { .. }))) => {
                Err(Interrupted::Lasting(e.to_string()))
            }
            Err(e @ IngestError::Log(LogError::Read(ScanError::Io { .. }))) => Err(Interrupted::Trouble(e.to_string())),
            Err(e) => Ok(Err(e.to_string())),
        }
    }

    /// The result of a readable log; `base` is the record of a flight about which nothing is known.
    fn of_log(
        &self,
        loaded: Loaded,
        measured: MeasuredFlight,
        decision: Option<&Decision>,
        base: FlightRecord,
    ) -> Studied {
        let Loaded { flight, health, binding, companion } = loaded;
        let log = Some(health);
        if let Some(reason) = companion {
            let (lateness, notices) = (Some(measured.lateness), flight.notices);
            let outcome = Outcome::NotMeasurable { reason };
            return Studied::without_track(FlightRecord { outcome, log, lateness, notices, ..base });
        }
        let (binding, decision) = match (binding, decision) {
            (Ok(binding), Some(decision)) => (binding, decision),
            (binding, _) => {
                let reason = binding.err().unwrap_or_else(|| "it is not decided yet which delay is removed".to_owned());
                let (outcome, notices) = (Outcome::Failed { reason }, flight.notices);
                return Studied::without_track(FlightRecord { outcome, log, notices, ..base });
            }
        };
        let mut notices = flight.notices.clone();
        notices.extend(measured.notices);
        let delays = measured.delays.unwrap_or_default();
        let case =
            FlightCase { flight: &flight, binding: &binding, delays: &delays, lateness: &measured.lateness, decision };
        self.replayed(&case, FlightRecord { log, network: measured.network, notices, ..base })
    }

    /// The record of a flight; `draft` holds the parts that do not depend on the removed delay.
    fn replayed(&self, case: &FlightCase<'_>, draft: FlightRecord) -> Studied {
        let lateness = case.lateness;
        let mut draft = FlightRecord {
            binding: Some(case.binding.clone()),
            delays: Some(case.delays.clone()),
            lateness: Some(lateness.clone()),
            decision: Some(case.decision.clone()),
            ..draft
        };
        if let Some(reason) = &lateness.failed {
            return Studied::without_track(FlightRecord {
                outcome: Outcome::Failed { reason: reason.clone() },
                ..draft
            });
        }
        let done = self.compensated(case, &mut draft.notices);
        let removed_s = done.as_ref().ok().map(|done| done.record.settings.delay.seconds());
        draft.effect = self.effect(case, removed_s);
        if let Some(swept) = done.as_ref().ok().and_then(|done| swept(case.decision, done)) {
            draft.decision = Some(swept);
        }
        match done {
            Ok(done) => {
                draft.notices.extend_unsaid(done.notices);
                let record = FlightRecord { outcome: Outcome::Compensated, replay: Some(done.record), ..draft };
                Studied { record, track: Some(Box::new(done.track)), explorer: Some(done.explorer) }
            }
            Err(reason) => {
                // A delay that changes was measured, but is not one number.
                let outcome = match lateness.lateness.is_some() || lateness.kind.varies() {
                    true => Outcome::Uncompensated { reason },
                    false => Outcome::NotMeasurable { reason },
                };
                let (trial, explorer) = self.trial(case, &mut draft.notices).unzip();
                Studied { record: FlightRecord { outcome, trial, ..draft }, track: None, explorer }
            }
        }
    }

    /// Whether the removal helped; `None` if the channels cannot be compared.
    fn effect(&self, case: &FlightCase<'_>, removed_s: Option<f64>) -> Option<Effect> {
        let (lateness, decision) = (case.lateness, case.decision);
        let truth = TruthEffect::of(case.flight, &self.pipeline.provisional(), removed_s.unwrap_or(0.0)).ok().flatten();
        lateness.velocity.as_ref()?;
        let truth = truth.and_then(|truth| crate::known_lateness::judging(truth, lateness));
        Some(effect(
            truth.as_ref(),
            crate::known_lateness::known(lateness, decision).as_ref(),
            crate::known_lateness::motion(lateness),
            removed_s,
        ))
    }

    /// Replays as if the difference between position and velocity were removed, so that the page of a flight without
    /// removal can show its track. `None` if the position is not later.
    fn trial(&self, case: &FlightCase<'_>, notices: &mut Notices) -> Option<(ReplayRecord, ExplorerRows)> {
        let done = sketch(case.flight, &self.pipeline.trial_settings(case)?).ok()?;
        // Nothing was removed, so only the notices about what is drawn belong to the flight.
        let left_out = done.notices.iter().filter(|notice| notice.code == Code::SamplesLeftOut.name());
        left_out.for_each(|notice| notices.add(notice.clone()));
        Some((done.record, done.explorer))
    }

    /// Removes the decided delay, and sweeps others for comparison.
    fn compensated(&self, case: &FlightCase<'_>, notices: &mut Notices) -> Result<Replay, String> {
        let (settings, mut decided) = self.pipeline.settings_for(case)?;
        notices.extend_unsaid(decided.found.notices);
        // Before the replay: for a long record, memory does not suffice for both.
        let sweep = Sweeper::of(case.flight, &settings).ok().and_then(|sweeper| {
            let pair = sweeper.pair();
            let measured = measured_pair(case.delays, &pair.position, &pair.velocity);
            let candidates = decided.choice.candidates.iter();
            let found: Vec<_> = candidates.filter_map(|c| Some((c.source, *c.delay_s.found()?))).collect();
            sweeper.sweep(&found, decided.optimum.unwrap_or_else(|| sweeper.best(&measured)))
        });
        let mut done = replay(case.flight, &settings).map_err(|refusal| refusal.to_string())?;
        done.record.sweep = sweep;
        decided.choice.compare(done.record.sweep.as_ref());
        done.record.choice = Some(decided.choice);
        Ok(done)
    }
}

/// The decision where the replay removed the optimum of the flight's sweep, which is known only then.
fn swept(decision: &Decision, done: &Replay) -> Option<Decision> {
    let choice = done.record.choice.as_ref().filter(|choice| choice.used == DelaySource::Sweep)?;
    let settings = &done.record.settings;
    Some(Decision {
        used: Some(DelaySource::Sweep),
        delay_s: Some(settings.delay.seconds()),
        standard_uncertainty_s: settings.delay_uncertainty_s,
        circular: choice.circular,
        words: choice.why.clone(),
        ..decision.clone()
    })
}

impl Study for Replaying {
    fn measure(
        &self,
        planned: &Planned,
        _manifest: &Manifest,
        context: &RunContext<'_>,
    ) -> Result<MeasuredFlight, Interrupted> {
        let key = planned.measure_key.as_deref().unwrap_or_default();
        Ok(match self.load(planned, context)? {
            Ok((Loaded { companion: Some(what), .. }, _)) => answer::companion(key, what),
            Ok((Loaded { mut flight, health, binding: Ok(binding), .. }, reference)) => {
                let reference = reference.map(|reference| reference.join(&mut flight, &self.pipeline));
                answer::measure(key, &flight, &health, &binding, reference, &self.pipeline)
            }
            Ok((Loaded { binding: Err(reason), .. }, _)) | Err(reason) => answer::failed(key, reason),
        })
    }

    fn study(
        &self,
        planned: &Planned,
        measured: MeasuredFlight,
        manifest: &Manifest,
        context: &RunContext<'_>,
    ) -> Result<Studied, Interrupted> {
        let (mut loaded, reference) = match self.load(planned, context)? {
            Ok(both) => both,
            Err(reason) => return Ok(Studied::without_track(failed_record(planned, manifest, reason))),
        };
        settle(&mut loaded.flight, reference.as_ref(), &measured.lateness, &self.pipeline);
        drop(reference);
        let base = failed_record(planned, manifest, String::new());
        Ok(self.of_log(loaded, measured, planned.decision.as_ref(), base))
    }
}

/// Whether the system denies reading the log.
fn is_denied(error: &IngestError) -> bool {
    matches!(error, IngestError::Log(LogError::Read(ScanError::Io { source, .. })) if source.kind() == std::io::ErrorKind::PermissionDenied)
}

/// The record of an unusable flight.
pub(crate) fn failed_record(planned: &Planned, manifest: &Manifest, reason: String) -> FlightRecord {
    FlightRecord {
        record_version: manifest.record_version,
        analysis_version: manifest.analysis_version,
        key: planned.key.clone().unwrap_or_default(),
        inputs: planned.inputs(),
        pipeline: manifest.pipeline.clone(),
        outcome: Outcome::Failed { reason },
        log: None,
        binding: None,
        replay: None,
        trial: None,
        delays: None,
        lateness: None,
        network: None,
        decision: None,
        effect: None,
        criteria: None,
        test: None,
        notices: Notices::new(),
        details: vec![],
    }
}
