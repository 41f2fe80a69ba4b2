//! Performance of the compensators with and without a reference, where they help, and comparison with the position that
//! the aircraft computed in flight.

use crate::{Estimate, Finding};
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The scores of one replay.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ReplayScores {
    /// One score per compensator, in the order of the replay: raw first.
    pub compensators: Vec<CompensatorScore>,
    /// Raw − compensated north and east as predicted from velocity alone, rms, m: one velocity, half way back, times Td
    /// plus the age of the fix.
    pub predicted_axes_rms_m: [f64; 2],
    /// Straight legs that were evaluated.
    pub straight_legs: Finding<StraightLegs>,
    /// Passes over the same place in opposite directions.
    pub opposite_passes: Finding<OppositePasses>,
    /// Delay of the velocity itself, s: lateness against the reference in excess of the lateness against the integrated
    /// velocity.
    pub velocity_delay_s: Finding<Estimate>,
    /// Distribution of the motion over frequency.
    pub motion: Finding<MotionSpectrum>,
    /// Frequency bands of [`ReferenceScore::bands_rms_m`], Hz, from and to.
    pub bands_hz: Vec<[f64; 2]>,
    /// Ground speeds of [`ReferenceScore::by_speed`], m/s, from and to.
    pub speeds_mps: Vec<[f64; 2]>,
}

/// Segments on which velocity keeps its direction.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct StraightLegs {
    /// Number of legs.
    pub legs: u64,
    /// Total duration, s.
    pub duration_s: f64,
    /// Largest lateral acceleration that still counts as straight, m/s².
    pub lateral_limit_mps2: f64,
}

/// Pairs of passes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct OppositePasses {
    /// Number of pairs.
    pub pairs: u64,
    /// Fixes in all pairs.
    pub fixes: u64,
    /// Largest distance between the two passes that still counts as the same place, m.
    pub within_m: f64,
    /// Mean sum of both ground speeds, m/s: along the track, a position that is late by T is displaced by T times this
    /// sum, which is 2 U T.
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
    /// Along-track lead of the output over raw, divided by the distance flown in a second, s: should be
    /// [`expected_lead_s`](Self::expected_lead_s).
    pub lead_s: Finding<Estimate>,
    /// The delay set for this compensator, s.
    pub expected_lead_s: f64,
    /// Correlation (−1 to 1) of the output's steps at the fixes with the distance flown between them: 1 for raw, 0
    /// after compensation.
    pub step_correlation: Finding<Estimate>,
    /// Offset between opposite passes.
    pub hysteresis: Finding<Hysteresis>,
    /// Raw − this, north and east, rms, m.
    pub raw_minus_this_axes_rms_m: [Estimate; 2],
    /// Whether it does harm on straight legs, where it only has to move ahead.
    pub straight: Finding<StraightScore>,
    /// Score against the reference.
    pub reference: Finding<ReferenceScore>,
    /// Its predicted error.
    pub budget: ErrorBudget,
    /// Frequencies at which it helps.
    pub band: Finding<HelpfulBand>,
}

/// How late the output is against the integral of velocity; a correct compensation leaves minus the velocity's own
/// lateness. A delay set wrong by e leaves e times the cosine of the turn of the track during Td, because the missing
/// distance was flown then, not now.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ResidualDelay {
    /// Remaining lateness, s; positive is still late, negative is too early.
    pub delay_s: Estimate,
    /// 95 % interval, s.
    pub interval_95_s: [f64; 2],
    /// Samples of both axes used.
    pub samples: u64,
    /// Expected value, s: position minus velocity, less the delay removed (no delay is removed for raw). For a filter
    /// that does not know the age of a fix, it includes the mean age at the evaluated rows. For a Padé filter, it
    /// includes the apparent delay of its truncation in this motion, known to half its size because the estimator gives
    /// fast motion more weight.
    pub expected_s: Estimate,
}

/// Offset between passes over the same place in opposite directions, mean over the pairs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct Hysteresis {
    /// Along the track, m: positive if each pass lags, as a late position does.
    pub along_m: Estimate,
    /// Across the track, m.
    pub across_m: Estimate,
    /// Expected value along the track, m: the closing speed times the remaining delay of position minus velocity.
    pub expected_along_m: f64,
}

/// The output on straight legs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct StraightScore {
    /// Output − raw along the track, less the distance flown during the set delay, mean, m.
    pub along_excess_m: Estimate,
    /// Output − raw across the track, rms, m.
    pub across_rms_m: Estimate,
    /// Noise of the output divided by that of raw at the fixes, both about a parabola for each leg.
    pub noise_ratio: Estimate,
}

/// The output compared with an independent reference, horizontal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ReferenceScore {
    /// Number of rows compared.
    pub rows: u64,
    /// 2-D rms, m.
    pub rms_m: Estimate,
    /// 50th, 68th, 95th and 99th percentile of the 2-D error, m.
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
    /// All terms, including unknown ones.
    pub terms: Vec<BudgetTerm>,
    /// Root of the sum of the squares of all terms, 2-D rms, m; `None` where a term is unknown, because the sum is then
    /// unknown.
    pub total_m: Option<f64>,
    /// Root of the sum of the squares of the known terms, 2-D rms, m: the error is at least about this.
    #[serde(default)]
    pub known_m: f64,
    /// Measured against the reference, 2-D rms, m.
    pub measured_m: Option<Estimate>,
}

/// One term.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct BudgetTerm {
    /// Source of the error.
    pub name: String,
    /// 2-D rms, m, or why it is unknown.
    pub size_m: Finding<f64>,
    /// Formula and the source of its numbers.
    pub source: String,
}

/// The frequencies at which a compensator helps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct HelpfulBand {
    /// The error must be below this share of the raw one to count as help.
    pub factor: f64,
    /// It helps below this frequency, Hz; `None` if it does not help even slow motion.
    pub helps_below_hz: Option<f64>,
    /// At least half of the raw error is removed below this frequency, Hz.
    pub halves_below_hz: Option<f64>,
    /// Worse than raw above this frequency, Hz; `None` if it is never worse below 1/delay.
    pub worse_above_hz: Option<f64>,
    /// Delays to which this applies, s: of the position, of the velocity, and the one removed.
    pub delays_s: [f64; 3],
    /// Shares of the power of the flight's velocity that are improved, in between, and made worse; they add up to 1.
    pub motion_share: Option<[f64; 3]>,
}

/// Power of the horizontal velocity over frequency.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct MotionSpectrum {
    /// Edges of the bins, Hz, logarithmically spaced; one more than bins.
    pub edges_hz: Vec<f64>,
    /// Share of the power in each bin.
    pub share: Vec<f64>,
    /// Duration of the data for the spectrum, s.
    pub duration_s: f64,
    /// One-sided noise floor of the velocity, (m/s)²/Hz, north and east.
    pub noise_floor: [f64; 2],
}

/// The position that the aircraft computed in flight, compared with the replay.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct OnboardComparison {
    /// The channel.
    pub channel: String,
    /// Number of its samples.
    pub samples: u64,
    /// Number of samples with a matching row of the replay.
    pub compared: u64,
    /// Whether their timestamps are those of the replay's rows; otherwise rows are interpolated.
    pub same_stamps: bool,
    /// Tolerance due to rounding, m.
    pub tolerance_m: f64,
    /// Reason for the tolerance.
    pub tolerance_source: String,
    /// Seconds after the first sample that count as the start.
    pub start_s: f64,
    /// One difference per compensator of the replay, raw first.
    pub against: Vec<OnboardAgainst>,
    /// The compensator that reproduces it: the closest one within the tolerance.
    pub reproduced_by: Finding<String>,
}

/// On-board position less one compensator's.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct OnboardAgainst {
    /// Name of the compensator.
    pub name: String,
    /// 2-D rms after the start, m.
    pub rms_m: f64,
    /// 95th percentile, m.
    pub p95_m: f64,
    /// Largest, m.
    pub max_m: f64,
    /// Largest during the start, m; `None` if the start was not recorded.
    pub start_max_m: Option<f64>,
    /// How late the on-board position is against this one, s.
    pub delay_s: Finding<Estimate>,
}
