//! How a delay changes during a flight.

use crate::replay::Estimate;
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The word for a delay over a flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum DelayKind {
    /// The level is not known: too little motion, or too much noise.
    CannotTell,
    /// The level is known. The flight is too short, or moves too little, to say whether the delay stays the same.
    NotTested,
    /// Constant, and zero within the margin.
    OnTime,
    /// Constant, and the position is late, or later than the channel that it is relative to.
    Constant,
    /// Constant, and the velocity is later than the position.
    Early,
    /// Jumps between levels.
    Steps,
    /// Jumps between two levels, to and fro.
    Switches,
    /// Changes slowly.
    Drifts,
    /// Grows, and falls back at once or slowly: messages wait in a queue.
    Queues,
    /// Grows by more than 0.3 s and does not fall back.
    BuildsUp,
    /// Changes, and no simple description fits.
    Wanders,
}

impl DelayKind {
    /// Whether the delay was seen to change.
    #[must_use]
    pub fn varies(self) -> bool {
        matches!(
            self,
            DelayKind::Steps
                | DelayKind::Switches
                | DelayKind::Drifts
                | DelayKind::Queues
                | DelayKind::BuildsUp
                | DelayKind::Wanders
        )
    }

    /// The word as a person reads it: "on time", "builds up".
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            DelayKind::CannotTell => "cannot tell",
            DelayKind::NotTested => "not tested",
            DelayKind::OnTime => "on time",
            DelayKind::Constant => "constant",
            DelayKind::Early => "early",
            DelayKind::Steps => "steps",
            DelayKind::Switches => "switches",
            DelayKind::Drifts => "drifts",
            DelayKind::Queues => "queues",
            DelayKind::BuildsUp => "builds up",
            DelayKind::Wanders => "wanders",
        }
    }
}

/// What is known of the delay of a position against a velocity over one flight. Positive is late:
/// `position(t) = truth(t − delay)`, with the velocity as the clock.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelayOverTime {
    /// The word.
    pub kind: DelayKind,
    /// One plain sentence, to be read first.
    pub words: String,
    /// Mean level, s. The uncertainty is `None` if the motion says nothing.
    pub level_s: Estimate,
    /// Standard uncertainty to add in quadrature to that of a constant fit, s: 0 unless the delay differs between
    /// parts of the flight.
    pub level_widening_s: f64,
    /// Whether the delay stays the same, and how small a change would have been seen.
    pub constancy: Constancy,
    /// Scatter of the delay from fix to fix; `None` if none was found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub jitters: Option<DelayJitter>,
    /// Standard deviation of a scatter of the delay from fix to fix that would have been found, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub jitter_limit_s: Option<f64>,
    /// Single fixes far behind the others; empty unless they lie behind more often than chance gives.
    pub late_fixes: Vec<LateFix>,
    /// Fixes that lie off for no known reason and were left out of all fits.
    pub odd_fixes: u64,
    /// Fixes that arrived at once after a hold.
    pub bursts: Vec<Burst>,
    /// Delay over the flight, at most 200 points.
    pub curve: Vec<CurvePoint>,
    /// Steps and bends that describe the curve; empty unless the delay varies.
    pub terms: Vec<DelayTerm>,
    /// Largest less smallest delay of the description, s; 0 unless the delay varies.
    pub span_s: f64,
    /// Antenna ahead of the point whose velocity is known, m, where the motion tells it from a delay (beyond 3 standard
    /// uncertainties).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lever_arm_m: Option<Estimate>,
    /// Seconds by which the speed follows later than the direction, where this is beyond 3 standard uncertainties.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed_after_direction_s: Option<Estimate>,
    /// Other reasons that could look like this delay, and what rests on them: lever arm, clock skew, resets. Each a sentence.
    pub remarks: Vec<String>,
    /// Two delays that explain the flight equally well, s; `None` if one is clearly better.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub two_delays_fit: Option<[f64; 2]>,
    /// Whether the kind is `cannot-tell`, and parts of a few seconds show surely that the delay changes, or that the position was
    /// reset along the track.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub unplaced_change: bool,
    /// Delays that were searched, s: first and last.
    pub search_s: [f64; 2],
    /// Whether the best delay lies at the edge of the search even after it was widened.
    pub edge_hit: bool,
    /// What follows for a compensation, a sentence or two.
    pub advice: String,
    /// What to fly to learn more; `None` if nothing is missing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub what_to_fly: Option<String>,
    /// Why the configured delay is refuted by this flight; `None` if it is not, or if none is configured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub configured_contradicted: Option<String>,
    /// Comparison with the device's own time; `None` if it is not logged.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub device_time: Option<DeviceTime>,
    /// Fixes used, after bursts, odd fixes and thinning.
    pub fixes_used: u64,
    /// Fixes given.
    pub fixes_given: u64,
}

/// Whether the windows of a flight agree on one delay.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct Constancy {
    /// Whether enough windows know their delay. `false`: nothing is said of constancy.
    pub tested: bool,
    /// Whether the delay changes: by more than [`Constancy::limit_s`], surely, and not because of one window.
    pub varies: bool,
    /// Windows that know their delay to 250 ms.
    pub windows: u64,
    /// Length of a window, s.
    pub window_s: f64,
    /// Probability that a constant delay differs this much; `None` if not tested. Never to be worded alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub p: Option<f64>,
    /// Largest difference between parts of the flight, s, with its standard uncertainty; where all rests on one window, its
    /// difference from the others.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub difference_s: Option<Estimate>,
    /// Least difference that counts, s.
    pub limit_s: f64,
    /// Scatter from window to window beyond their uncertainties, s; `None` if not tested.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scatter_s: Option<f64>,
    /// A lasting change of this size or more would have been seen, s; `None` if not tested.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub detectable_s: Option<f64>,
    /// From when to when such a change would have been seen, s; nothing is promised before and after.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub detectable_between_s: Option<[f64; 2]>,
    /// Window without which the change would not have been called one, s from and to; `None` if there is no such window.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub left_out_window_s: Option<[f64; 2]>,
    /// Delay of each window, in order of time.
    pub window_delays: Vec<CurvePoint>,
    /// What a reader must know although it is no alarm, a sentence; `None` if all is well.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
}

/// Scatter of a delay from fix to fix.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelayJitter {
    /// Standard deviation, s.
    pub standard_deviation_s: f64,
    /// Error of a position that remains after the mean delay is removed, rms at the rms speed of the flight, m.
    pub remains_m: f64,
    /// Half-width that holds 95 % of the fixes, s.
    pub half_width_95_s: f64,
}

/// A single fix far behind its neighbours.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct LateFix {
    /// Stamp, s.
    pub t_s: f64,
    /// How much later than its neighbours, s.
    pub late_s: f64,
}

/// Fixes that arrived at once.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct Burst {
    /// Stamp of the first, s.
    pub start_s: f64,
    /// Number of fixes.
    pub fixes: u64,
    /// Pause before them, s.
    pub hold_s: f64,
}

/// A point of the curve of the delay.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct CurvePoint {
    /// Instant, s, on the clock of the position's stamps.
    pub t_s: f64,
    /// Delay, s.
    pub delay_s: f64,
    /// Standard uncertainty, s.
    pub standard_uncertainty_s: f64,
}

/// What a term of a description does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum DelayTermKind {
    /// The delay jumps.
    Step,
    /// The slope of the delay changes.
    Bend,
}

/// A term of the description of a delay that varies.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelayTerm {
    /// What it does.
    pub kind: DelayTermKind,
    /// When, s.
    pub at_s: f64,
    /// Interval of 95 % of that instant, s; `None` for a bend.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at_interval_s: Option<[f64; 2]>,
    /// Size: s for a step, s/s for a bend.
    pub size: f64,
    /// Standard uncertainty of the size, same unit.
    pub standard_uncertainty: f64,
}

/// Lateness from the device's own time, which needs no motion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DeviceTime {
    /// Rate of the arrival's clock against the device's less 1, s/s.
    pub skew: f64,
    /// Median lateness above the least, s.
    pub median_s: f64,
    /// 95th percentile of the lateness above the least, s.
    pub percentile_95_s: f64,
    /// Largest lateness above the least, s.
    pub largest_s: f64,
    /// Difference between late and early parts that the motion shows as well, s; `None` if it cannot be compared.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub disagreement_rms_s: Option<f64>,
}
