//! What changed in a campaign since the run before.

use crate::Estimate;
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A campaign against the one that the output folder held before. The only record that depends on earlier runs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct CampaignChanges {
    /// [`crate::RECORD_VERSION`].
    pub record_version: u32,
    /// Name of the campaign.
    pub name: String,
    /// What the run before was made with; `None` for the first run into a folder.
    pub before: Option<MadeWith>,
    /// What this run was made with.
    pub now: MadeWith,
    /// Flights that the run before did not have, by name.
    pub new: Vec<String>,
    /// Flights that are no longer in the folder, by name.
    pub gone: Vec<String>,
    /// Flights with another result than before, by name.
    pub rerun: Vec<RerunFlight>,
    /// Flights whose lateness moved by more than two standard uncertainties, the largest move first.
    pub moved: Vec<MovedDelay>,
    /// Groups whose mean lateness moved by more than two standard uncertainties, the largest move first.
    pub moved_groups: Vec<MovedDelay>,
    /// Flights that have a trouble that they did not have, by name.
    pub failing: Vec<TroubleChange>,
    /// Flights that lost a trouble that they had, by name.
    pub recovered: Vec<TroubleChange>,
}

/// What decides the numbers of a campaign besides its logs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct MadeWith {
    /// Version of flightlag.
    pub flightlag_version: String,
    /// Analysis version.
    pub analysis_version: u32,
    /// Hash of the pipeline.
    pub pipeline_blake3: String,
    /// Hash of the criteria; `None` without criteria.
    pub criteria_blake3: Option<String>,
}

/// A flight with another result than before.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct RerunFlight {
    /// Name of the flight.
    pub flight: String,
    /// Causes, in words: the log, settings, channel maps, the analysis, the delay to remove.
    pub causes: Vec<String>,
}

/// A delay that is another one than before.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct MovedDelay {
    /// Name of the flight or of the group.
    pub name: String,
    /// Lateness before, s.
    pub before_s: Estimate,
    /// Lateness now, s.
    pub now_s: Estimate,
    /// Difference over the root of the sum of both squared standard uncertainties, without sign.
    pub sigmas: f64,
}

/// Troubles of a flight that came or went.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct TroubleChange {
    /// Name of the flight.
    pub flight: String,
    /// Each in a word or two, as `harmed`.
    pub troubles: Vec<String>,
}

impl CampaignChanges {
    /// Whether the run before had the same flights, results and settings.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.before.as_ref() == Some(&self.now)
            && self.new.is_empty()
            && self.gone.is_empty()
            && self.rerun.is_empty()
            && self.moved.is_empty()
            && self.moved_groups.is_empty()
            && self.failing.is_empty()
            && self.recovered.is_empty()
    }
}
