//! The state of the last run, so that the next one can report what changed and reuse the rest.
//!
//! Losing it only costs time. It never claims more than is on disk: before a page is
//! replaced, its entry is removed.

use crate::error::CampaignError;
use crate::file_stamp::FileStamp;
use crate::manifest::{Manifest, Planned, Stage, Why};
use crate::results;
use crate::run_context::RunContext;
use crate::store::{Check, Files, Kept, Store};
use crate::work::Workers;
use record::Decision;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

const STATE: &str = ".flightlag/state.json";
const STATE_VERSION: u32 = 3;

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
    pub(crate) results: BTreeMap<String, Files>,
    /// Up-to-date pages, by folder name.
    pub(crate) pages: BTreeMap<String, PageState>,
    /// The outputs of the campaign as a whole, if they are up to date.
    pub(crate) whole: Option<WholeState>,
    /// Hash of the campaign's record, whose rows may be reused.
    pub(crate) record_blake3: String,
    /// How thoroughly results unknown to this folder are compared.
    #[serde(skip)]
    check: Check,
    /// A file has new metadata and unchanged content.
    #[serde(skip)]
    pub(crate) refreshed: bool,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct KnownFlight {
    content: Option<String>,
    measure_key: Option<String>,
    decision: Option<Decision>,
    key: Option<String>,
}

/// An up-to-date page of a flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct PageState {
    /// Hash of all its inputs.
    pub(crate) made_from: String,
    /// Its files.
    pub(crate) files: Files,
    /// Whether the campaign's record has its row. It does not if a reduction was stopped after the page.
    pub(crate) has_row: bool,
}

/// Table, index and record of the campaign.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct WholeState {
    /// Hash of all their inputs.
    pub(crate) made_from: String,
    /// The files.
    pub(crate) files: Files,
}

impl State {
    /// Reads the state of the last run; empty if unreadable.
    pub(crate) fn recall(store: &Store) -> State {
        let state: Option<State> = store.read_sealed(STATE);
        // The next run continues a first run that was stopped, so its state has a version from the start.
        let first = || State { version: STATE_VERSION, ..State::default() };
        state.filter(|s| s.version == STATE_VERSION).unwrap_or_else(first)
    }

    /// Writes the state.
    pub(crate) fn save(&self, store: &Store) -> Result<(), CampaignError> {
        Ok(store.rewrite_sealed(STATE, self)?)
    }

    /// Whether the last run had a result for this flight.
    pub(crate) fn has_flight(&self, flight: &str) -> bool {
        self.flights.get(flight).is_some_and(|known| known.key.is_some())
    }

    /// The last run's decision for a flight, and the key of its result.
    pub(crate) fn latest_of(&self, flight: &str) -> Option<(Decision, String)> {
        let known = self.flights.get(flight)?;
        Some((known.decision.clone()?, known.key.clone()?))
    }

    /// Keys of the results and measurements of the last run.
    pub(crate) fn keys(&self) -> impl Iterator<Item = &str> {
        self.flights.values().flat_map(|f| [&f.measure_key, &f.key]).flatten().map(String::as_str)
    }

    /// Compares every known file with the disk. Changed outputs are made again: pages and tables are forgotten, results
    /// are removed. Returns the names of such files.
    pub(crate) fn compare(
        &mut self,
        store: &Store,
        check: Check,
        context: &RunContext<'_>,
    ) -> Result<Vec<String>, CampaignError> {
        self.check = check;
        let of_results = self.results.values_mut().flatten();
        let of_pages = self.pages.values_mut().flat_map(|page| &mut page.files);
        let of_whole = self.whole.iter_mut().flat_map(|whole| &mut whole.files);
        let files: Vec<(&String, &mut Kept)> = of_results.chain(of_pages).chain(of_whole).collect();
        let (changed, refreshed) = compared(files, store, check, context)?;
        self.refreshed = refreshed;
        if changed.is_empty() {
            return Ok(vec![]);
        }
        let is_changed = |files: &Files| files.keys().any(|name| changed.contains(name));
        for (key, _) in self.results.iter().filter(|(_, files)| is_changed(files)) {
            results::remove(store, key)?;
        }
        self.results.retain(|_, files| !is_changed(files));
        self.pages.retain(|_, page| !is_changed(&page.files));
        self.whole = None;
        Ok(changed.into_iter().collect())
    }

    /// Takes over the flights of the current plan.
    pub(crate) fn learn(&mut self, manifest: &Manifest) {
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

    /// Why the work of a stage is necessary for `flight`, given that its result is missing.
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
            let [was, is] = [&known.decision, &flight.decision].map(|d| described(d.as_ref()));
            why.push(Why::DelayChanged { was, is });
        }
        if why.is_empty() { vec![Why::ResultMissing] } else { why }
    }

    /// Why a flight has a different result from the last run.
    pub(crate) fn causes(&self, flight: &Planned, manifest: &Manifest) -> Vec<String> {
        if !self.flights.contains_key(&flight.flight) {
            return vec!["unknown: the state of the last run is lost".to_owned()];
        }
        self.why(flight, manifest, Stage::Replay, false).iter().map(ToString::to_string).collect()
    }

    /// Whether a result exists and is unchanged. Removes a changed one.
    pub(crate) fn has_result(&self, store: &Store, key: &str) -> Result<bool, CampaignError> {
        if self.results.contains_key(key) {
            return Ok(true);
        }
        let is_there = results::is_there(store, key, self.check);
        if !is_there && self.check == Check::Full {
            results::remove(store, key)?;
        }
        Ok(is_there)
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

/// Names of the changed files, and whether any other file has new metadata.
fn compared(
    files: Vec<(&String, &mut Kept)>,
    store: &Store,
    check: Check,
    context: &RunContext<'_>,
) -> Result<(BTreeSet<String>, bool), CampaignError> {
    if check == Check::Quick {
        let (mut changed, mut refreshed) = (BTreeSet::new(), false);
        let before: Vec<FileStamp> = files.iter().map(|(_, kept)| kept.stamp).collect();
        let mut files = files;
        for (name, is_as_kept) in store.are_as_kept(files.iter_mut().map(|(name, kept)| (*name, &mut **kept)))? {
            if !is_as_kept {
                changed.insert(name.clone());
            }
        }
        refreshed |= files.iter().zip(before).any(|((_, kept), before)| kept.stamp != before);
        return Ok((changed, refreshed));
    }
    let differs =
        |(): &mut (), (name, kept): &(&String, &mut Kept)| !store.is_as_kept(name, &mut (**kept).clone(), check);
    let answers = Workers::start(context.threads)?.each(&files, context.cancel, || (), differs);
    context.stopped()?;
    let changed = files.iter().zip(answers).filter(|(_, differs)| *differs == Some(true));
    Ok((changed.map(|((name, _), _)| (*name).clone()).collect(), false))
}

/// A decision in a few words.
fn described(decision: Option<&Decision>) -> String {
    match decision.and_then(|d| Some((d.delay_s?, d.used?))) {
        Some((delay_s, used)) => format!("{:.1} ms ({})", 1e3 * delay_s, used.name()),
        None => "none".to_owned(),
    }
}
