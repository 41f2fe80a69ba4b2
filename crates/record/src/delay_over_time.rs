//! How a delay changes during a flight.

use crate::replay::Estimate;
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Kind of a delay over a flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum DelayKind {
    /// The level is unknown: too little motion, or too much noise.
    CannotTell,
    /// The level is known. The flight is too short, or has too little motion, to show whether the delay stays the same.
    NotTested,
    /// The level is known. The delay differs between windows by more than their uncertainties, and no change in time
    /// explains it.
    Scatters,
    /// Constant, and zero within the margin.
    OnTime,
    /// Constant, and the position is late, or later than the channel it is compared with.
    Constant,
    /// Constant, and the velocity is later than the position.
    Early,
    /// Jumps between levels.
    Steps,
    /// Jumps back and forth between two levels.
    Switches,
    /// Changes slowly.
    Drifts,
    /// Grows, then falls back suddenly or slowly: messages wait in a queue.
    Queues,
    /// Grows by more than 0.3 s and does not fall back.
    BuildsUp,
    /// Changes, and no simple description fits.
    Wanders,
}

impl DelayKind {
    /// Whether a change of the delay was detected.
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

    /// The kind as human-readable text: "on time", "builds up".
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            DelayKind::CannotTell => "cannot tell",
            DelayKind::NotTested => "not tested",
            DelayKind::Scatters => "scatters",
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

/// What is known about the delay of a position against a velocity over one flight. Positive is late: `position(t) =
/// truth(t − delay)`, with the velocity as the clock.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelayOverTime {
    /// The kind.
    pub kind: DelayKind,
    /// Summary in one plain sentence.
    pub words: String,
    /// Mean level, s. The uncertainty is `None` if the motion carries no information.
    pub level_s: Estimate,
    /// Standard uncertainty to add in quadrature to that of a constant fit, s: zero unless the delay differs between
    /// parts of the flight.
    pub level_widening_s: f64,
    /// Whether the delay stays the same, and how small a change would have been detected.
    pub constancy: Constancy,
    /// Scatter of the delay from fix to fix; `None` if no scatter was found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub jitters: Option<DelayJitter>,
    /// Smallest detectable scatter of the delay from fix to fix, standard deviation, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub jitter_limit_s: Option<f64>,
    /// Single fixes that are far later than the others; empty unless there are more than expected by chance.
    pub late_fixes: Vec<LateFix>,
    /// Outlier fixes without a known reason, excluded from all fits.
    pub odd_fixes: u64,
    /// Fixes that arrived together after a pause.
    pub bursts: Vec<Burst>,
    /// Delay over the flight, at most 200 points.
    pub curve: Vec<CurvePoint>,
    /// Steps and bends that describe the curve; empty unless the delay varies.
    pub terms: Vec<DelayTerm>,
    /// Largest less smallest delay of the description, s; zero unless the delay varies.
    pub span_s: f64,
    /// Distance of the antenna ahead of the point whose velocity is known, m, where the motion distinguishes it from a
    /// delay (by more than 3 standard uncertainties).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lever_arm_m: Option<Estimate>,
    /// Lateness of the speed relative to the direction, s, where it exceeds 3 standard uncertainties.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed_after_direction_s: Option<Estimate>,
    /// Other causes that could look like this delay (lever arm, clock skew, resets) and their consequences. One
    /// sentence each.
    pub remarks: Vec<String>,
    /// Two delays that explain the flight equally well, s; `None` if one is clearly better.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub two_delays_fit: Option<[f64; 2]>,
    /// Whether the kind is `cannot-tell`, but parts of a few seconds clearly show that the delay changes or that the
    /// position was reset along the track.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub unplaced_change: bool,
    /// Range of delays searched, s: first and last.
    pub search_s: [f64; 2],
    /// Whether the best delay is at the edge of the search range even after it was widened.
    pub edge_hit: bool,
    /// Consequences for compensation, in a sentence or two.
    pub advice: String,
    /// Recommended flight to learn more; `None` if nothing is missing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub what_to_fly: Option<String>,
    /// Number of fixes used, after excluding bursts and outliers and thinning.
    pub fixes_used: u64,
    /// Number of fixes in the input.
    pub fixes_given: u64,
}

/// Whether the windows of a flight agree on one delay.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct Constancy {
    /// Whether enough windows have a known delay. If `false`, constancy is unknown.
    pub tested: bool,
    /// Whether the delay changes: by more than [`Constancy::limit_s`], significantly, and not because of one window.
    pub varies: bool,
    /// Number of windows whose delay is known to within 250 ms.
    pub windows: u64,
    /// Length of a window, s.
    pub window_s: f64,
    /// Probability that a constant delay differs this much; `None` if not tested. Never report it alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub p: Option<f64>,
    /// Largest difference between parts of the flight, s, with its standard uncertainty. If it depends on one window,
    /// that window's difference from the others.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub difference_s: Option<Estimate>,
    /// Smallest difference that counts, s.
    pub limit_s: f64,
    /// Scatter from window to window in excess of their uncertainties, s; `None` if not tested.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scatter_s: Option<f64>,
    /// Smallest lasting change that would have been detected, s; `None` if not tested.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub detectable_s: Option<f64>,
    /// Period in which such a change would have been detected, s from and to. Changes before or after may be missed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub detectable_between_s: Option<[f64; 2]>,
    /// Window without which no change would have been detected, s from and to; `None` if there is no such window.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub left_out_window_s: Option<[f64; 2]>,
    /// Delay of each window, in chronological order.
    pub window_delays: Vec<CurvePoint>,
    /// A remark that the reader must know but that is not an alarm, one sentence; `None` if all is well.
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
    /// Half-width that contains 95 % of the fixes, s.
    pub half_width_95_s: f64,
}

/// A single fix that is far later than its neighbours.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct LateFix {
    /// Timestamp, s.
    pub t_s: f64,
    /// Lateness relative to its neighbours, s.
    pub late_s: f64,
}

/// Fixes that arrived together.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct Burst {
    /// Timestamp of the first, s.
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
    /// Instant, s, on the clock of the position's timestamps.
    pub t_s: f64,
    /// Delay, s.
    pub delay_s: f64,
    /// Standard uncertainty, s.
    pub standard_uncertainty_s: f64,
}

/// Kind of a term of a description.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum DelayTermKind {
    /// The delay jumps.
    Step,
    /// The slope of the delay changes.
    Bend,
}

/// A term of the description of a varying delay.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DelayTerm {
    /// Its kind.
    pub kind: DelayTermKind,
    /// Instant, s.
    pub at_s: f64,
    /// 95 % interval of that instant, s; `None` for a bend.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at_interval_s: Option<[f64; 2]>,
    /// Size: s for a step, s/s for a bend.
    pub size: f64,
    /// Standard uncertainty of the size, same unit.
    pub standard_uncertainty: f64,
}
