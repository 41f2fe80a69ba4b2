//! What the last run left behind, so that the next one can say what has changed and leave alone what has not.
//!
//! Losing it costs time and nothing else. It never claims more than is on disk: before a page is
//! replaced, the claim that it stands is withdrawn.

use crate::error::CampaignError;
use crate::manifest::{Manifest, Planned, Stage, Why};
use crate::store::{Keep, Store};
use record::{CampaignCriteria, CampaignTotals, Decision};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

const STATE: &str = ".flightlag/state.json";
const STATE_VERSION: u32 = 2;

/// Sizes of files by name below the output folder.
pub(crate) type Sizes = BTreeMap<String, u64>;

/// The last run.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct State {
    version: u32,
    pipeline_toml: String,
    maps_blake3: String,
    analysis_version: u32,
    record_version: u32,
    /// Every flight, by name.
    flights: BTreeMap<String, KnownFlight>,
    /// Files of every result, by key.
    pub(crate) results: BTreeMap<String, Sizes>,
    /// Pages that stand, by the folder's name.
    pub(crate) pages: BTreeMap<String, PageState>,
    /// The outputs of the whole, if they stand.
    pub(crate) whole: Option<WholeState>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct KnownFlight {
    content: Option<String>,
    measure_key: Option<String>,
    decision: Option<Decision>,
    key: Option<String>,
}

/// A flight's page that stands.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct PageState {
    /// Hash of everything that it was made from.
    pub(crate) made_from: String,
    /// Its files.
    pub(crate) files: Sizes,
}

/// Table, index and record of the campaign.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct WholeState {
    /// Hash of everything that they were made from.
    pub(crate) made_from: String,
    /// The files.
    pub(crate) files: Sizes,
    /// Hash of the campaign's record, whose rows may be used again.
    pub(crate) record_blake3: String,
    /// Counts, for the exit code.
    pub(crate) totals: CampaignTotals,
    /// What the criteria say, for the exit code too.
    #[serde(default)]
    pub(crate) criteria: Option<CampaignCriteria>,
    /// Flights without a lasting result.
    pub(crate) troubled: u64,
}

impl State {
    /// What the last run wrote down; nothing if that cannot be read.
    pub(crate) fn recall(store: &Store) -> State {
        let read = store.read(STATE).ok().flatten();
        let state = read.and_then(|bytes| serde_json::from_slice::<State>(&bytes).ok());
        state.filter(|s| s.version == STATE_VERSION).unwrap_or_default()
    }

    /// Writes it down.
    pub(crate) fn save(&self, store: &Store) -> Result<(), CampaignError> {
        let text = serde_json::to_vec(self).unwrap_or_default();
        Ok(store.write(STATE, &text, Keep::Synced)?)
    }

    /// Takes over what is planned now.
    pub(crate) fn learn(&mut self, manifest: &Manifest) {
        self.version = STATE_VERSION;
        self.pipeline_toml.clone_from(&manifest.pipeline.toml);
        self.maps_blake3.clone_from(&manifest.maps_blake3);
        self.analysis_version = manifest.analysis_version;
        self.record_version = manifest.record_version;
        let known = |f: &Planned| KnownFlight {
            content: f.content.clone(),
            measure_key: f.measure_key.clone(),
            decision: f.decision.clone(),
            key: f.key.clone(),
        };
        self.flights = manifest.flights.iter().map(|f| (f.flight.clone(), known(f))).collect();
    }

    /// Why the work of a stage has to be done for `flight`, given that its result is not there.
    pub(crate) fn why(&self, flight: &Planned, manifest: &Manifest, stage: Stage, had_trouble: bool) -> Vec<Why> {
        if had_trouble {
            return vec![Why::EarlierTrouble];
        }
        let Some(known) = self.flights.get(&flight.flight) else { return vec![Why::NewFlight] };
        let same = match stage {
            Stage::Measure => known.measure_key == flight.measure_key,
            Stage::Replay => known.key == flight.key,
        };
        if same {
            return vec![Why::ResultMissing];
        }
        let mut why = vec![];
        if known.content != flight.content {
            why.push(Why::LogChanged);
        }
        why.extend(self.what_changed(manifest));
        if why.is_empty() && stage == Stage::Replay && known.decision != flight.decision {
            let [was, is] = [&known.decision, &flight.decision].map(|d| told(d.as_ref()));
            why.push(Why::DelayChanged { was, is });
        }
        if why.is_empty() { vec![Why::ResultMissing] } else { why }
    }

    /// Why a flight has another result than in the last run, in words.
    pub(crate) fn causes(&self, flight: &Planned, manifest: &Manifest) -> Vec<String> {
        if !self.flights.contains_key(&flight.flight) {
            return vec!["unknown: the notes on the last run are lost".to_owned()];
        }
        self.why(flight, manifest, Stage::Replay, false).iter().map(ToString::to_string).collect()
    }

    /// Whether the files of a result are as they were left, as far as is known.
    pub(crate) fn stands(&self, store: &Store, key: &str) -> bool {
        self.results.get(key).is_none_or(|files| stand(store, files))
    }

    fn what_changed(&self, now: &Manifest) -> Vec<Why> {
        let settings = crate::config::differences(&self.pipeline_toml, &now.pipeline.toml);
        let mut why = vec![];
        if !settings.is_empty() {
            why.push(Why::SettingsChanged { settings });
        }
        if self.maps_blake3 != now.maps_blake3 {
            why.push(Why::MapsChanged);
        }
        if self.analysis_version != now.analysis_version {
            why.push(Why::AnalysisChanged { was: self.analysis_version, is: now.analysis_version });
        }
        if self.record_version != now.record_version {
            why.push(Why::RecordsChanged { was: self.record_version, is: now.record_version });
        }
        why
    }
}

/// Whether all files are there with the sizes they had.
pub(crate) fn stand(store: &Store, files: &Sizes) -> bool {
    files.iter().all(|(name, bytes)| store.size(name) == Some(*bytes))
}

/// A decision in a few words.
fn told(decision: Option<&Decision>) -> String {
    match decision.and_then(|d| Some((d.delay_s?, d.used?))) {
        Some((delay_s, used)) => format!("{:.1} ms ({})", 1e3 * delay_s, used.name()),
        None => "none".to_owned(),
    }
}
