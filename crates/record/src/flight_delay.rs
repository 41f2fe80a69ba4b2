//! How late the channels of a flight are against each other, estimated from the flight itself.

use crate::bench::{Finding, ObjectiveCurve};
use crate::delay_over_time::DelayOverTime;
use crate::replay::Estimate;
use flight::Clock;
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The quantities that a pair of channels compares.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum DelayPairKind {
    /// Position against the integral of velocity: δ = Tp − Tv.
    PositionAgainstVelocity,
    /// Velocity against the integral of acceleration (specific force rotated by attitude, less gravity): δ = Tv − Ta.
    VelocityAgainstAcceleration,
    /// Position against a reference position, which is on time by definition: δ = Tp.
    PositionAgainstReference,
    /// Velocity against a reference position, which is on time by definition: δ = Tv.
    VelocityAgainstReference,
    /// Two receivers: δ is the difference of their position delays.
    BetweenReceivers,
}

/// All delays that one flight can provide. Every pair that was tried is listed, whether measured or not.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct FlightDelays {
    /// Pairs, sorted by [`DelayPairKind`], then by name.
    pub pairs: Vec<PairDelay>,
}

/// Results of one pair.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct PairDelay {
    /// Kind of comparison.
    pub kind: DelayPairKind,
    /// Channel whose lateness is measured, such as `position.gps`. Positive δ: this channel is late against the second.
    pub first: String,
    /// What it is compared with: one channel, or two such as `attitude.ins + specific-force.imu`.
    pub second: String,
    /// What δ means, and what this pair cannot show, in words.
    pub meaning: String,
    /// Time zero of the pair's seconds; `None` if it has no samples.
    pub origin: Option<DelayOrigin>,
    /// What the flight offers for measuring it; `None` if the analysis did not get that far.
    pub excitation: Option<DelayExcitation>,
    /// The delay, or why it is unknown and which manoeuvre would show it.
    pub delay: Finding<MeasuredDelay>,
    /// Whether the delay stays the same; `None` where that was not tested.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub varies: Option<DelayOverTime>,
    /// Why the pair must not be used in the delay network; `None` if it may be used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub not_for_network: Option<String>,
    /// Whether no gyro shows how late the attitude is that rotates the specific force.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_attitude_untested: bool,
    /// Change of the delay for each 0.1 m by which the antenna is ahead of the point at which velocity is measured, s;
    /// `None` if the lever arm is known or does not matter.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lever_arm_s_per_decimetre: Option<f64>,
}

/// What the flown path reveals about a delay, independent of noise (design note 4).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelayExcitation {
    /// Samples of the first channel that could be compared.
    pub samples: u64,
    /// Seconds that they cover, without gaps.
    pub duration_s: f64,
    /// Pieces with their own offset: the integral is unknown across gaps, the position across resets.
    pub pieces: u64,
    /// 95th percentile of the ground speed, m/s.
    pub speed_p95_mps: f64,
    /// Σ‖P⊥v‖²/Σ‖v‖² with offset and drift of every piece projected out: 0 in straight and steady flight. (For velocity
    /// against acceleration, the same of the acceleration.)
    pub moving_share: f64,
    /// Share of the displacement over some seconds (rms) that the second channel does not explain; 0 if it explains
    /// all.
    pub unexplained_share: Option<f64>,
    /// Standard uncertainty of the delay achievable with this motion and the noise found, s; `None` if nothing was
    /// fitted.
    pub predicted_s: Option<f64>,
}

/// A delay measured from a flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct MeasuredDelay {
    /// δ, s; positive if the first channel is late against the second.
    pub delay_s: Estimate,
    /// 95 % interval, s.
    pub interval_95_s: [f64; 2],
    /// Standard uncertainty from the curvature alone, s.
    pub hessian_s: f64,
    /// Standard uncertainty from the sandwich that allows for autocorrelation, s.
    pub hac_s: f64,
    /// Part of the standard uncertainty due to effects that a constant delay does not explain (slow or fast motion,
    /// operating point, time), s. The rest is due to noise.
    #[serde(default)]
    pub widened_s: f64,
    /// Cramér–Rao bound at the fitted noise, s.
    pub crlb_s: f64,
    /// 2.8 standard uncertainties, s: the change of the delay that a test at the 5 % level detects with 80 %
    /// probability.
    pub smallest_detectable_s: f64,
    /// Samples of both axes used.
    pub samples: u64,
    /// Share of the samples down-weighted by the robust fit, 0 to 1; 0.179 for normal noise.
    pub downweighted_share: f64,
    /// Another delay that explains the data almost as well (within three units of chi-squared times the noise), s.
    pub rival_s: Option<f64>,
    /// The objective that was minimised.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub objective: Option<ObjectiveCurve>,
    /// Pieces with their own offset.
    pub pieces: Vec<DelayPiece>,
    /// Delay over time, in windows that do not overlap and carry about equal information.
    pub over_time: Vec<WindowDelay>,
    /// Whether all windows agree; `None` with fewer than two.
    pub homogeneity: Option<DelayHomogeneity>,
    /// What a reader must know about a delay that changes; `None` if it stays the same.
    pub alarm: Option<String>,
    /// Delay by operating point: speed, and quality channels where logged.
    pub splits: Vec<DelaySplit>,
    /// Known delays injected into the second half of the flight and recovered.
    pub injections: Vec<FlightInjection>,
    /// Corrections of the delay after the fit, such as for a lever arm.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub remarks: Vec<String>,
    /// Other doubts about the delay, the most serious first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub alarms: Vec<String>,
}

impl MeasuredDelay {
    /// Share of normal noise that Huber's weights (k = 1.345) down-weight although it is not an outlier.
    const HELD_BACK_BY_CHANCE: f64 = 0.179;

    /// Share of the samples that are outliers: the down-weighted share in excess of that of normal noise.
    #[must_use]
    pub fn outlier_share(&self) -> f64 {
        ((self.downweighted_share - Self::HELD_BACK_BY_CHANCE) / (1.0 - Self::HELD_BACK_BY_CHANCE)).max(0.0)
    }
}

/// A segment with its own offset and drift.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelayPiece {
    /// First sample, s after the origin.
    pub start_s: f64,
    /// Last sample.
    pub end_s: f64,
    /// Why it starts here, in words; empty for the first.
    pub begun_by: String,
    /// Drift north and east, m/s (m/s² for velocity against acceleration): the bias of the second channel.
    pub drift: [Estimate; 2],
    /// Noise north and east, m or m/s.
    pub noise: [DelayNoise; 2],
}

/// Noise about the fit: an Ornstein–Uhlenbeck wander plus white noise.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelayNoise {
    /// Standard deviation of the wander; `None` without wander.
    pub wander_std: Option<f64>,
    /// Correlation time of the wander, s.
    pub time_constant_s: Option<f64>,
    /// Standard deviation of the white part.
    pub white_std: f64,
}

/// The delay in one window of time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct WindowDelay {
    /// Start, s after the origin.
    pub start_s: f64,
    /// End.
    pub end_s: f64,
    /// Delay, s.
    pub delay_s: Estimate,
}

/// A test of one delay for all windows.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelayHomogeneity {
    /// Chi-squared.
    pub chi2: f64,
    /// Degrees of freedom.
    pub degrees_of_freedom: u64,
    /// Probability of a chi-squared at least this large by chance.
    pub p: f64,
    /// The split of the flight into the two parts whose delays differ most.
    pub largest_step: DelayStep,
}

impl DelayHomogeneity {
    /// Whether the windows differ by more than their uncertainties: p < 0.01. The uncertainty of the delay then
    /// includes their scatter.
    #[must_use]
    pub fn scatters(&self) -> bool {
        self.p < 0.01
    }
}

/// A step of the delay.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelayStep {
    /// When, s after the origin: the boundary of two windows.
    pub at_s: f64,
    /// Mean delay before, s.
    pub before_s: Estimate,
    /// Mean delay after, s.
    pub after_s: Estimate,
    /// Probability of a step at least this large by chance, corrected for the number of places searched.
    pub p: f64,
}

/// The delay by operating point.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelaySplit {
    /// Quantity that it is split by: `ground speed, m/s`, or the name of a channel.
    pub by: String,
    /// Groups, in ascending order.
    pub groups: Vec<DelayGroup>,
    /// Probability of differences at least this large by chance; `None` with fewer than two groups.
    pub p: Option<f64>,
}

/// One operating point.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelayGroup {
    /// Smallest and largest value in the group.
    pub range: [f64; 2],
    /// Samples of both axes.
    pub samples: u64,
    /// Delay, s.
    pub delay_s: Estimate,
}

/// A known delay injected into the second half of the flight (half of its information, not of its time).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct FlightInjection {
    /// Delay injected, s.
    pub injected_s: f64,
    /// Delay of the second half less that of the first, less the injected delay, s: zero within its uncertainty.
    pub error_s: Estimate,
    /// 95 % interval of the error, s.
    pub interval_95_s: [f64; 2],
    /// Boundary of the halves, s after the origin.
    pub split_s: f64,
}

/// Time zero of a pair's seconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelayOrigin {
    /// Timestamp, ns.
    pub origin_ns: i64,
    /// Its clock.
    pub clock: Clock,
}

/// Whether a channel such as `velocity.ekf-2` is the output of a filter on other channels: EKF, AHRS, odometry, INS.
///
/// Inferred from the start of the source's name, ignoring case. A channel map that says `measured` takes precedence.
#[must_use]
pub fn is_filter_output(channel: &str) -> bool {
    const FILTERS: [&str; 13] = [
        "ekf",
        "ahrs",
        "local",
        "ins",
        "odom",
        "fused",
        "core",
        "global",
        "filtered",
        "estimat",
        "vio",
        "nav",
        "compensated",
    ];
    let source = channel.split_once('.').map_or(channel, |(_, source)| source).to_ascii_lowercase();
    FILTERS.iter().any(|filter| source.starts_with(filter))
}
