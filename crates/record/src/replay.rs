//! Results of the compensators on a flight.

use crate::{CardUse, DelayChoice, DelaySweep, Finding, OnboardComparison, ReplayScores};
use flight::Delay;
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A number with its uncertainty.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct Estimate {
    /// Best value.
    pub value: f64,
    /// Standard uncertainty (k = 1), same unit; `None` only where a page states why.
    pub standard_uncertainty: Option<f64>,
}

impl Estimate {
    /// E_n = (a − b)/√(U_a² + U_b²) with U = 2u (ISO 13528): they agree if |E_n| is at most 1. A missing uncertainty
    /// counts as zero; `None` if both are missing.
    #[must_use]
    pub fn normalised_difference(&self, other: &Self) -> Option<f64> {
        let [u, v] = [self, other].map(|e| e.standard_uncertainty.unwrap_or(0.0));
        Some((self.value - other.value) / (2.0 * u.hypot(v))).filter(|e_n| e_n.is_finite())
    }
}

/// What a compensator assumes before its first sample (design note 5.8).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum StartRule {
    /// The first velocity is assumed for all earlier time: output starts at `Td · v0`.
    Warm,
    /// State zero, as in a naive implementation.
    Cold,
    /// No output until velocity has been available for Td.
    InvalidUntilTd,
}

/// Settings used for the replay.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ReplaySettings {
    /// Delay that was removed.
    pub delay: Delay,
    /// Its standard uncertainty, s, if the pipeline or the sensor card states one.
    pub delay_uncertainty_s: Option<f64>,
    /// Source of the delay, in words.
    pub delay_source: String,
    /// The sensor card that the delay comes from; `None` if the pipeline states the value itself.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub card: Option<CardUse>,
    /// Start rule.
    pub start: StartRule,
    /// Velocity gaps up to this long are bridged, s.
    pub bridge_s: f64,
}

/// Which channels were replayed against each other.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct PairUse {
    /// Late position.
    pub position: String,
    /// Velocity that is on time.
    pub velocity: String,
    /// Independent position to score against, if the log contains one.
    pub reference: Option<String>,
}

/// Coverage of the flight by validity of the output.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct Coverage {
    /// Duration from the first to the last output row, s.
    pub duration_s: f64,
    /// Total number of output rows.
    pub rows: u64,
    /// Number of rows with a valid compensated position.
    pub valid_rows: u64,
    /// Time covered by these rows, s, each up to the next row; missing rows cover no time.
    pub valid_s: f64,
    /// Rows without a valid compensated position, by reason.
    pub invalid: Vec<flight::RejectCount>,
    /// Number of velocity gaps that were bridged.
    pub bridged_gaps: u64,
    /// Number of velocity gaps too long to bridge: the compensators were restarted.
    pub restarts: u64,
    /// Number of position fixes used.
    pub fixes: u64,
    /// Fixes that jump against the integrated velocity by more than five standard deviations of the surrounding fixes:
    /// passed on and counted.
    pub position_resets: u64,
    /// Longest time without a position fix, s.
    pub longest_position_gap_s: f64,
}

/// One compensator on this flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct CompensatorResult {
    /// Short name, such as `raw`, `pade-1-1`, `exact-async`.
    pub name: String,
    /// What it is, in words.
    pub title: String,
    /// The delay set for it, s (plus half the update interval where it runs on held fixes).
    pub delay: Delay,
    /// 2-D rms of raw − this, m; zero for raw.
    pub raw_minus_this_rms_m: Estimate,
    /// Step of the output at a position fix, 2-D rms, m: the disagreement with the next fix.
    pub step_at_fix_rms_m: Option<Estimate>,
    /// 2-D rms error against the reference, m.
    pub error_rms_m: Option<Estimate>,
    /// 2-D 95th percentile of the error against the reference, m.
    pub error_p95_m: Option<Estimate>,
}

/// A curve for a figure, decimated so that every extreme is kept. In `record.json` its lists are empty: the figure's
/// file contains the points.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct Curve {
    /// Name in the legend.
    pub name: String,
    /// Seconds after the flight's origin. Gaps are marked by `breaks`, not by NaN.
    pub t_s: Vec<f64>,
    /// Values, in the figure's unit.
    pub y: Vec<f64>,
    /// Rows before which the line is interrupted.
    pub breaks: Vec<u32>,
    /// Number of samples that these rows represent.
    pub stands_for: u64,
}

/// How far other positions are ahead of raw along the track, at the first row of every fix, less the distance flown
/// since the fix, so that its age is not included.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct LeadCurves {
    /// The compensated position first, then the reference, if any.
    pub of: Vec<Lead>,
    /// Ground speed below which a lead is not expressed as time, m/s.
    pub least_speed_mps: f64,
    /// Ground track of the compensated position.
    pub track: LeadTrack,
}

/// How far a position is ahead of raw.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct Lead {
    /// Median, m.
    pub median_m: f64,
    /// Curve over the flight, m.
    pub over_time_m: Curve,
    /// Curve over the flight, divided by ground speed, ms.
    pub over_time_ms: Curve,
}

/// A ground track with the lead at each of its points. In `record.json` its lists are empty: the figure's file contains
/// the points.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct LeadTrack {
    /// Metres east of the origin.
    pub east_m: Vec<f64>,
    /// Metres north of the origin.
    pub north_m: Vec<f64>,
    /// Lead of the compensated position over raw along the track, m.
    pub lead_m: Vec<f64>,
    /// Rows before which the line is interrupted.
    pub breaks: Vec<u32>,
    /// Number of samples that these rows represent.
    pub stands_for: u64,
}

/// North or east: the curves of the paper's Fig. 7.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct AxisCurves {
    /// `north` or `east`.
    pub axis: String,
    /// Position, m from the origin: raw first, then one curve per compensator.
    pub position_m: Vec<Curve>,
}

/// The hardest manoeuvre, drawn without decimation if it fits.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct Zoom {
    /// Start, s after the origin.
    pub start_s: f64,
    /// End, s after the origin.
    pub end_s: f64,
    /// Reason for choosing this window.
    pub why: String,
    /// The axes in this window.
    pub axes: Vec<AxisCurves>,
}

/// The replay of one flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ReplayRecord {
    /// Settings used.
    pub settings: ReplaySettings,
    /// Channels used.
    pub pair: PairUse,
    /// Time zero of all `t_s`: a timestamp, ns, on `clock`.
    pub origin_ns: i64,
    /// Clock of the origin.
    pub clock: flight::Clock,
    /// Origin of north and east. `None` if the log has only local coordinates.
    pub origin: Option<flight::Geodetic>,
    /// Coverage of the flight by the numbers.
    pub coverage: Coverage,
    /// Ground speed: median, percentiles, m/s.
    pub speed_mps: flight::Distribution,
    /// 2-D distance flown with one velocity, half way back, during Td plus the age of the fix, rms, m: the expected
    /// value of raw − compensated.
    pub predicted_rms_m: Estimate,
    /// Raw first, then the compensators.
    pub compensators: Vec<CompensatorResult>,
    /// Their scores, with and without a reference; `None` in records of earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scores: Option<ReplayScores>,
    /// Comparison with the compensated position that the aircraft computed in flight; `None` if the log does not
    /// contain one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub onboard: Option<Finding<OnboardComparison>>,
    /// Whole flight, north then east.
    pub axes: Vec<AxisCurves>,
    /// The hardest manoeuvre.
    pub zoom: Option<Zoom>,
    /// How far the compensated position is ahead of raw; `None` in records of earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lead: Option<LeadCurves>,
    /// The delay that was removed, and why.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub choice: Option<DelayChoice>,
    /// The effect of other delays.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sweep: Option<DelaySweep>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_normalised_difference_is_that_of_iso_13528() {
        let estimate = |value, standard_uncertainty| Estimate { value, standard_uncertainty };
        let found = estimate(0.412, Some(0.0015));
        // 12 ms divided by √(3² + 4²) ms, by 3 ms, and without an uncertainty.
        let e_n = |other| found.normalised_difference(&other);
        assert!((e_n(estimate(0.4, Some(0.002))).unwrap() - 2.4).abs() < 1e-12);
        assert!((e_n(estimate(0.4, None)).unwrap() - 4.0).abs() < 1e-12);
        assert_eq!(estimate(0.4, None).normalised_difference(&estimate(0.4, None)), None);
    }
}
