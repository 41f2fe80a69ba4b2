//! What changed in a campaign since the previous run.

use crate::Estimate;
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A campaign compared with the previous one in the output folder. This is the only record that depends on earlier
/// runs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct CampaignChanges {
    /// [`crate::RECORD_VERSION`].
    pub record_version: u32,
    /// Name of the campaign.
    pub name: String,
    /// Versions and settings of the previous run; `None` for the first run into a folder.
    pub before: Option<MadeWith>,
    /// Versions and settings of this run.
    pub now: MadeWith,
    /// Flights that the previous run did not have, by name.
    pub new: Vec<String>,
    /// Flights that are no longer in the folder, by name.
    pub gone: Vec<String>,
    /// Flights whose result changed, by name.
    pub rerun: Vec<RerunFlight>,
    /// Flights whose lateness moved by more than two standard uncertainties, the largest move first.
    pub moved: Vec<MovedDelay>,
    /// Groups whose mean lateness moved by more than two standard uncertainties, the largest move first.
    pub moved_groups: Vec<MovedDelay>,
    /// Flights with a new problem, by name.
    pub failing: Vec<TroubleChange>,
    /// Flights with a problem that is gone, by name.
    pub recovered: Vec<TroubleChange>,
}

/// Everything except the logs that determines the numbers of a campaign.
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

/// A flight whose result changed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct RerunFlight {
    /// Name of the flight.
    pub flight: String,
    /// Causes, in words: the log, settings, channel maps, the analysis, the delay to remove.
    pub causes: Vec<String>,
}

/// A delay that changed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct MovedDelay {
    /// Name of the flight or of the group.
    pub name: String,
    /// Lateness before, s.
    pub before_s: Estimate,
    /// Lateness now, s.
    pub now_s: Estimate,
    /// Absolute difference divided by the root sum of squares of both standard uncertainties.
    pub sigmas: f64,
}

/// Problems of a flight that are new or gone.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct TroubleChange {
    /// Name of the flight.
    pub flight: String,
    /// Each in a word or two, such as `harmed`.
    pub troubles: Vec<String>,
}

/// A problem that is gone: `was harmed`.
#[must_use]
pub fn in_the_past(trouble: &str) -> String {
    match trouble {
        "log damaged" => "log was damaged".to_owned(),
        "failed" => "had failed".to_owned(),
        _ if trouble.starts_with("criterion ") => trouble.to_owned(),
        _ => format!("was {trouble}"),
    }
}

impl CampaignChanges {
    /// Whether the previous run had the same flights, results and settings.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_problem_that_is_gone_is_in_the_past() {
        let all = ["not measurable", "harmed", "failed", "log damaged", "criterion late failed"].map(in_the_past);
        let past = ["was not measurable", "was harmed", "had failed", "log was damaged", "criterion late failed"];
        assert_eq!(all, past);
    }
}
