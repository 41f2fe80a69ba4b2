//! The record of one campaign.

use crate::{
    CampaignCriteria, CampaignTest, Decision, DelaySource, DelaySweep, Effect, Estimate, FlightLateness, GroupLateness,
    Outcome, RowCard, RowVerdicts,
};
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// One line of the table of flights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct FlightRow {
    /// Path relative to the campaign's folder: the name known to users.
    pub flight: String,
    /// Key of its result.
    pub key: String,
    /// Page of the flight, relative to the campaign's page.
    pub page: String,
    /// Its outcome.
    #[serde(flatten)]
    pub outcome: Outcome,
    /// Bytes or messages were lost, and the loss affects a result or is at least a thousandth of the log.
    pub lossy: bool,
    /// Less was lost, and no result is affected.
    #[serde(default)]
    pub minor_loss: bool,
    /// What was lost and where, if `lossy`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub damage: Option<String>,
    /// Bytes of cut tails, as at power-off: not a loss.
    #[serde(default)]
    pub tail_cut_bytes: u64,
    /// Format.
    pub format: String,
    /// Channel map.
    pub map: Option<String>,
    /// Size of its files, bytes.
    pub bytes: u64,
    /// Seconds that the replay covers, or between the first and the last position where nothing was replayed.
    pub duration_s: Option<f64>,
    /// Position channel.
    pub position: Option<String>,
    /// Velocity channel.
    pub velocity: Option<String>,
    /// Rate of the position, Hz: updates per second outside gaps.
    pub position_rate_hz: Option<f64>,
    /// Rate of the velocity, Hz: updates per second outside gaps.
    pub velocity_rate_hz: Option<f64>,
    /// Median ground speed, m/s.
    pub speed_median_mps: Option<f64>,
    /// Delay removed, s.
    pub delay_s: Option<f64>,
    /// Delay of the position against the velocity, measured from the flight itself, s.
    #[serde(default)]
    pub measured_delay_s: Option<Estimate>,
    /// Source of the removed delay.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub delay_from: Option<DelaySource>,
    /// The sensor card's value of this delay, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub card_delay_s: Option<Estimate>,
    /// UTC start time of the log, if its clock knows the date.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub flown_at: Option<String>,
    /// Thumbnail of the compensated ground track, m: `east,north` of its points separated by spaces, and `;` where
    /// fixes are missing. `None` where nothing was compensated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub track_sketch_m: Option<String>,
    /// The effect of other delays.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sweep: Option<DelaySweep>,
    /// Raw − exact compensation, 2-D rms, m.
    pub correction_rms_m: Option<Estimate>,
    /// Error against a reference, raw, 2-D rms, m.
    pub raw_error_rms_m: Option<Estimate>,
    /// Error against a reference, the paper's compensator, 2-D rms, m.
    pub pade_error_rms_m: Option<Estimate>,
    /// Error against a reference, exact asynchronous compensation, 2-D rms, m.
    pub exact_error_rms_m: Option<Estimate>,
    /// Share of the covered time with a valid compensated position, 0 to 1.
    pub valid_share: Option<f64>,
    /// Verdicts of the criteria; `None` without criteria.
    #[serde(default)]
    pub criteria: Option<RowVerdicts>,
    /// Test cards that were flown.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub cards: Vec<RowCard>,
    /// How late the position is; `None` if the log could not be read.
    #[serde(default)]
    pub lateness: Option<FlightLateness>,
    /// Delay removed, and why.
    #[serde(default)]
    pub decision: Option<Decision>,
    /// Whether removing it helped.
    #[serde(default)]
    pub effect: Option<Effect>,
    /// The flight with the same samples that counts instead; `None` if this one counts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub duplicate_of: Option<String>,
    /// Why this flight needs attention, in words: damage, contradictions, restarts.
    pub attention: Vec<String>,
    /// Number of notices of severity warning.
    pub warnings: u64,
    /// Number of notices of severity loss.
    pub losses: u64,
}

impl FlightRow {
    /// What was found, in one to three sentences: why there is no result, or the lateness and the effect of its removal.
    #[must_use]
    pub fn answer(&self) -> String {
        let reason = match &self.outcome {
            Outcome::Failed { reason } | Outcome::Pending { reason } => Some(reason),
            _ => None,
        };
        let lateness = self.lateness.as_ref().map(|lateness| &lateness.words);
        // An effect begins with its verdict, in lower case.
        let effect = self.effect.as_ref().and_then(|effect| {
            let first = effect.words.chars().next()?;
            Some(first.to_uppercase().chain(effect.words.chars().skip(1)).collect::<String>())
        });
        let sentences = reason.or(lateness).cloned().into_iter().chain(effect).filter(|text| !text.is_empty());
        let ended = |text: String| if text.ends_with('.') { text } else { text + "." };
        sentences.map(ended).collect::<Vec<_>>().join(" ")
    }
}

/// A file in the folder that is not a flight.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct IgnoredInput {
    /// Path relative to the campaign's folder.
    pub path: String,
    /// Reason.
    pub reason: String,
}

/// Counts over all flights.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct CampaignTotals {
    /// All flights.
    pub flights: u64,
    /// With a replay.
    pub compensated: u64,
    /// Measured, but no delay was removed.
    #[serde(default)]
    pub uncompensated: u64,
    /// Read, but cannot be measured.
    pub not_measurable: u64,
    /// Unusable.
    pub failed: u64,
    /// No result yet.
    #[serde(default)]
    pub pending: u64,
    /// With data loss.
    pub lossy: u64,
    /// Made worse by the removed delay.
    #[serde(default)]
    pub harmed: u64,
    /// Improved by the removed delay.
    #[serde(default)]
    pub helped: u64,
    /// With a delay that changes during the flight.
    #[serde(default)]
    pub varying: u64,
    /// Size of all logs, bytes.
    pub bytes: u64,
    /// Seconds flown in compensated flights.
    pub duration_s: f64,
}

/// A campaign: its settings, and one row for each flight. Its JSON does not contain the rows, which are in a JSON Lines
/// file of their own.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct CampaignRecord {
    /// [`crate::RECORD_VERSION`].
    pub record_version: u32,
    /// Analysis version of all flights.
    pub analysis_version: u32,
    /// Version of flightlag.
    pub flightlag_version: String,
    /// Name of the campaign, which is the folder's name.
    pub name: String,
    /// Settings.
    pub pipeline: crate::PipelineUse,
    /// Command that reproduces this.
    pub command: String,
    /// Results of the criteria over all flights; `None` without criteria.
    #[serde(default)]
    pub criteria: Option<CampaignCriteria>,
    /// Test cards; `None` without a card.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub test: Option<CampaignTest>,
    /// Flights, sorted by name.
    #[serde(skip)]
    pub flights: Vec<FlightRow>,
    /// Files that are not flights, sorted by path.
    pub ignored: Vec<IgnoredInput>,
    /// Counts.
    pub totals: CampaignTotals,
    /// Lateness by group of flights that may share a delay.
    #[serde(default)]
    pub groups: Vec<GroupLateness>,
}
