//! What the compensators are worth: with a reference and without one, where they help, and how that compares with what
//! the aircraft itself computed.

use crate::{Estimate, Finding};
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The scores of one replay.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ReplayScores {
    /// One for each compensator of the replay, in its order: raw first.
    pub compensators: Vec<CompensatorScore>,
    /// What velocity alone predicts for raw − compensated north and east, rms, m: one velocity, half way back, over Td
    /// and the age of the fix.
    pub predicted_axes_rms_m: [f64; 2],
    /// Straight legs that were looked at.
    pub straight_legs: Finding<StraightLegs>,
    /// Passes over the same place in opposite directions.
    pub opposite_passes: Finding<OppositePasses>,
    /// Delay of the velocity itself, s: what is late against the reference beyond what is late against the integrated
    /// velocity.
    pub velocity_delay_s: Finding<Estimate>,
    /// How the motion is spread over frequency.
    pub motion: Finding<MotionSpectrum>,
    /// Frequency bands of [`ReferenceScore::bands_rms_m`], Hz, from and to.
    pub bands_hz: Vec<[f64; 2]>,
    /// Ground speeds of [`ReferenceScore::by_speed`], m/s, from and to.
    pub speeds_mps: Vec<[f64; 2]>,
}

/// Stretches on which velocity keeps its direction.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct StraightLegs {
    /// How many.
    pub legs: u64,
    /// Seconds in all.
    pub duration_s: f64,
    /// Largest lateral acceleration that still counts as straight, m/s².
    pub lateral_limit_mps2: f64,
}

/// Pairs of passes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct OppositePasses {
    /// How many pairs.
    pub pairs: u64,
    /// Fixes in all pairs.
    pub fixes: u64,
    /// Largest distance between the two passes that still counts as the same place, m.
    pub within_m: f64,
    /// Mean sum of both ground speeds, m/s: along the track a position that is late by T stands apart by T times it,
    /// which is 2 U T.
    pub closing_speed_mps: f64,
}

/// One compensator, raw included.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct CompensatorScore {
    /// Name as in [`CompensatorResult::name`](crate::CompensatorResult::name).
    pub name: String,
    /// How late the output still is against the integrated velocity.
    pub residual_delay: Finding<ResidualDelay>,
    /// Along-track way of the output before raw over the way flown in a second, s: should be
    /// [`expected_lead_s`](Self::expected_lead_s).
    pub lead_s: Finding<Estimate>,
    /// The delay that this compensator was given, s.
    pub expected_lead_s: f64,
    /// Correlation (−1 to 1) of the output's steps at the fixes with the way flown between them: 1 for raw, 0 after
    /// compensation.
    pub step_correlation: Finding<Estimate>,
    /// Offset between opposite passes.
    pub hysteresis: Finding<Hysteresis>,
    /// Raw − this, north and east, rms, m.
    pub raw_minus_this_axes_rms_m: [Estimate; 2],
    /// Whether it does harm where there is nothing to do but to move ahead.
    pub straight: Finding<StraightScore>,
    /// Against the reference.
    pub reference: Finding<ReferenceScore>,
    /// What its error should be.
    pub budget: ErrorBudget,
    /// Where it helps.
    pub band: Finding<HelpfulBand>,
}

/// How late the output is against the integral of velocity; a right compensation leaves minus what the velocity is
/// late. A delay set wrongly by e leaves e times the cosine of what the track turns in Td: the way missed was flown then, not
/// now.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ResidualDelay {
    /// s; positive is late still, negative too early.
    pub delay_s: Estimate,
    /// 95 % interval, s.
    pub interval_95_s: [f64; 2],
    /// Samples of both axes used.
    pub samples: u64,
    /// What is expected, s: position minus velocity, less the delay removed (of raw nothing is removed); for a filter that
    /// does not know the age of a fix also its mean at the rows looked at, for a Padé filter what its truncation looks like in
    /// this motion, known to a half of it for the estimator weighs fast motion more.
    pub expected_s: Estimate,
}

/// Offset between passes over the same place in opposite directions, mean over the pairs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct Hysteresis {
    /// Along the track, m: positive if each pass stands behind, as a late position does.
    pub along_m: Estimate,
    /// Across the track, m.
    pub across_m: Estimate,
    /// What is expected along the track, m: the closing speed times what is left of position minus velocity.
    pub expected_along_m: f64,
}

/// The output on straight legs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct StraightScore {
    /// Output − raw along the track less the way flown in the delay given, mean, m.
    pub along_excess_m: Estimate,
    /// Output − raw across the track, rms, m.
    pub across_rms_m: Estimate,
    /// Noise of the output over that of raw at the fixes, both about a parabola for each leg.
    pub noise_ratio: Estimate,
}

/// The output beside an independent reference, horizontal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ReferenceScore {
    /// Rows compared.
    pub rows: u64,
    /// 2-D rms, m.
    pub rms_m: Estimate,
    /// 2-D error that half, 68, 95 and 99 % of the rows stay below, m.
    pub percentiles_m: [f64; 4],
    /// Largest 2-D error, m.
    pub max_m: f64,
    /// Along the track, mean and rms, m; ahead is positive.
    pub along_m: [Estimate; 2],
    /// Across the track, mean and rms, m; to the right is positive.
    pub across_m: [Estimate; 2],
    /// North, mean and rms, m.
    pub north_m: [Estimate; 2],
    /// East, mean and rms, m.
    pub east_m: [Estimate; 2],
    /// 2-D rms by ground speed, m, as in [`ReplayScores::speeds_mps`].
    pub by_speed: Vec<Option<Estimate>>,
    /// 2-D rms in each frequency band, m, as in [`ReplayScores::bands_hz`].
    pub bands_rms_m: Finding<Vec<f64>>,
    /// How late it is against the reference, s: regression of the error on the velocity.
    pub residual_delay_s: Finding<Estimate>,
}

/// Terms of the error of a compensated position, and their sum.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ErrorBudget {
    /// All terms, also those that are not known.
    pub terms: Vec<BudgetTerm>,
    /// Root of the sum of the squares of all terms, 2-D rms, m; `None` where one of them is not known, for then nobody knows
    /// the sum.
    pub total_m: Option<f64>,
    /// Root of the sum of the squares of those that are known, 2-D rms, m: the error is at least about this.
    #[serde(default)]
    pub known_m: f64,
    /// Measured against the reference, 2-D rms, m.
    pub measured_m: Option<Estimate>,
}

/// One term.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct BudgetTerm {
    /// What errs.
    pub name: String,
    /// 2-D rms, m, or why it is not known.
    pub size_m: Finding<f64>,
    /// Formula and where its numbers come from.
    pub source: String,
}

/// Between which frequencies a compensator is of use.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct HelpfulBand {
    /// The error must be below this share of the raw one to count as help.
    pub factor: f64,
    /// It helps below, Hz; `None` if not even slow motion is helped.
    pub helps_below_hz: Option<f64>,
    /// At least half of the raw error is removed below, Hz.
    pub halves_below_hz: Option<f64>,
    /// Worse than raw above, Hz; `None` if never below one over the delay.
    pub worse_above_hz: Option<f64>,
    /// Delays that this is for, s: of the position, of the velocity, and the one removed.
    pub delays_s: [f64; 3],
    /// Shares of the power of the flight's velocity that are helped, in between, and made worse; they add to 1.
    pub motion_share: Option<[f64; 3]>,
}

/// Power of the horizontal velocity over frequency.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct MotionSpectrum {
    /// Edges of the bins, Hz, in equal ratios; one more than bins.
    pub edges_hz: Vec<f64>,
    /// Share of the power in each bin.
    pub share: Vec<f64>,
    /// Seconds that the spectrum is from.
    pub duration_s: f64,
    /// One-sided noise floor of the velocity, (m/s)²/Hz, north and east.
    pub noise_floor: [f64; 2],
}

/// What the aircraft computed in flight beside what the replay computes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct OnboardComparison {
    /// The channel.
    pub channel: String,
    /// Its samples.
    pub samples: u64,
    /// Those with a row of the replay to compare with.
    pub compared: u64,
    /// Whether they carry the stamps of the replay's rows; if not, rows are interpolated between.
    pub same_stamps: bool,
    /// What rounding allows, m.
    pub tolerance_m: f64,
    /// Why so much.
    pub tolerance_source: String,
    /// Seconds after the first sample that count as the start.
    pub start_s: f64,
    /// One for each compensator of the replay, raw first.
    pub against: Vec<OnboardAgainst>,
    /// The compensator that reproduces it: the closest, if within the tolerance.
    pub reproduced_by: Finding<String>,
}

/// On-board less one compensator.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct OnboardAgainst {
    /// Name of the compensator.
    pub name: String,
    /// 2-D rms after the start, m.
    pub rms_m: f64,
    /// 95 % stay below, m.
    pub p95_m: f64,
    /// Largest, m.
    pub max_m: f64,
    /// Largest during the start, m; `None` if it was not seen.
    pub start_max_m: Option<f64>,
    /// How late the on-board position is against this one, s.
    pub delay_s: Finding<Estimate>,
}
