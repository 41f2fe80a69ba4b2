//! One flight: log in, record and track out.

use crate::config::{FlightCase, Pipeline};
use crate::delay::measured_pair;
use crate::error::CampaignError;
use crate::event::Event;
use crate::logs::Library;
use crate::manifest::{Manifest, Planned};
use crate::plan::Desk;
use compensation_replay::{FlightDelaySettings, Replay, Sweeper, Track, measure_delays, replay};
use flight::{Binding, Flight, LogHealth, Notices};
use ingest::{IngestError, Limits, ReadContext};
use record::{FlightRecord, Outcome};

/// What was found in a flight, for good: the same log and settings always give it.
#[derive(Debug)]
pub(crate) struct Studied {
    pub(crate) record: FlightRecord,
    pub(crate) track: Option<Track>,
}

/// Why there is no lasting result.
#[derive(Debug)]
pub(crate) enum Interrupted {
    /// The user stopped.
    Cancelled,
    /// Something that may be over next time: a disk that does not answer, a file that is being written.
    Trouble(String),
}

/// Makes the record of one flight. There is one real study; tests put others in its place.
pub(crate) trait Study: Sync {
    fn study(&self, flight: &Planned, manifest: &Manifest, desk: &Desk<'_>) -> Result<Studied, Interrupted>;
}

/// Reads the log and replays the compensators.
pub(crate) struct Replaying {
    library: Library,
    pipeline: Pipeline,
}

impl Replaying {
    /// Gets everything ready that the manifest asks for.
    pub(crate) fn prepare(manifest: &Manifest) -> Result<Replaying, CampaignError> {
        let pipeline = Pipeline::of_manifest(&manifest.pipeline.toml, &manifest.cards)?;
        let library = Library::open(manifest.maps_folder.as_deref(), pipeline.forced_map())?;
        if library.blake3() != manifest.maps_blake3 {
            return Err(CampaignError::TryAgain("channel maps have changed since the plan: plan again".to_owned()));
        }
        Ok(Replaying { library, pipeline })
    }

    fn replayed(&self, flight: Flight, health: LogHealth, binding: Binding, draft: FlightRecord) -> Studied {
        let mut notices = flight.notices.clone();
        let (delays, of_delays) = measure_delays(&flight, &FlightDelaySettings::default());
        notices.extend(of_delays);
        let done = self.compensated(&FlightCase { flight: &flight, binding: &binding, delays: &delays }, &mut notices);
        let mut draft =
            FlightRecord { log: Some(health), binding: Some(binding), delays: Some(delays), notices, ..draft };
        match done {
            Ok(done) => {
                draft.notices.extend_unsaid(done.notices);
                let record = FlightRecord { outcome: Outcome::Compensated, replay: Some(done.record), ..draft };
                Studied { record, track: Some(done.track) }
            }
            Err(reason) => {
                let outcome = Outcome::NotMeasurable { reason };
                Studied { record: FlightRecord { outcome, ..draft }, track: None }
            }
        }
    }

    /// Decides which delay is removed, removes it, and says what others would have done.
    fn compensated(&self, case: &FlightCase<'_>, notices: &mut Notices) -> Result<Replay, String> {
        let (settings, decided) = self.pipeline.settings_for(case)?;
        notices.extend_unsaid(decided.found.notices);
        let mut done = replay(case.flight, &settings).map_err(|refusal| refusal.to_string())?;
        done.record.sweep = Sweeper::of(case.flight, &settings).ok().and_then(|sweeper| {
            let pair = &done.record.pair;
            let measured = measured_pair(case.delays, &pair.position, &pair.velocity);
            let candidates = decided.choice.candidates.iter();
            let found: Vec<_> = candidates.filter_map(|c| Some((c.source, *c.delay_s.found()?))).collect();
            sweeper.sweep(&found, decided.optimum.unwrap_or_else(|| sweeper.best(&measured)))
        });
        done.record.choice = Some(decided.choice);
        Ok(done)
    }
}

impl Study for Replaying {
    fn study(&self, planned: &Planned, manifest: &Manifest, desk: &Desk<'_>) -> Result<Studied, Interrupted> {
        let on_bytes = |bytes| desk.tell(Event::Read { bytes });
        let context = ReadContext { limits: Limits::default(), cancel: desk.cancel, on_bytes: &on_bytes };
        let trouble = || Interrupted::Trouble("its format is not known".to_owned());
        let unit = planned.unit().ok_or_else(trouble)?;
        let failed = |reason| failed_record(planned, manifest, reason);
        match self.library.load(&unit, self.pipeline.forced_map(), &context) {
            Ok(loaded) => Ok(match loaded.binding {
                Ok(binding) => self.replayed(loaded.flight, loaded.health, binding, failed(String::new())),
                Err(reason) => {
                    let (log, notices) = (Some(loaded.health), loaded.flight.notices);
                    Studied { record: FlightRecord { log, notices, ..failed(reason) }, track: None }
                }
            }),
            Err(IngestError::Cancelled) => Err(Interrupted::Cancelled),
            Err(e @ (IngestError::Io { .. } | IngestError::Changed { .. })) => Err(Interrupted::Trouble(e.to_string())),
            Err(e) => Ok(Studied { record: failed(e.to_string()), track: None }),
        }
    }
}

/// The record of a flight that could not be used.
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
        delays: None,
        criteria: None,
        notices: Notices::new(),
    }
}
