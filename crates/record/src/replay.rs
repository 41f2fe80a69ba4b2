//! What the compensators made of a flight.

use crate::{CardUse, DelayChoice, DelaySweep, Finding, OnboardComparison, ReplayScores};
use flight::Delay;
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A number with how well it is known.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct Estimate {
    /// Best value.
    pub value: f64,
    /// Standard uncertainty (k = 1), same unit; `None` only where a page says why.
    pub standard_uncertainty: Option<f64>,
}

impl Estimate {
    /// E_n = (a − b)/√(U_a² + U_b²) with U = 2u (ISO 13528): up to 1 in size they agree. An uncertainty that is not stated
    /// counts as none; `None` if neither is stated.
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
    /// The first velocity has always been flown: output starts at `Td · v0`.
    Warm,
    /// State zero, as a naive implementation.
    Cold,
    /// No output until Td of velocity has been seen.
    InvalidUntilTd,
}

/// Settings of the replay as they were used.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ReplaySettings {
    /// Delay that was removed.
    pub delay: Delay,
    /// Its standard uncertainty, s, if the pipeline or the sensor card states one.
    pub delay_uncertainty_s: Option<f64>,
    /// Where the delay comes from, in words.
    pub delay_source: String,
    /// The sensor card that the delay comes from; `None` if the pipeline states the number itself.
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
    /// Independent position to score against, if the log holds one.
    pub reference: Option<String>,
}

/// Seconds of the flight by what the output is worth.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct Coverage {
    /// From the first to the last output row, s.
    pub duration_s: f64,
    /// Output rows in all.
    pub rows: u64,
    /// Rows with a valid compensated position.
    pub valid_rows: u64,
    /// Seconds up to the next row that these rows stand for; where rows are missing there is none.
    pub valid_s: f64,
    /// Rows without one, by reason.
    pub invalid: Vec<flight::RejectCount>,
    /// Velocity gaps that were bridged.
    pub bridged_gaps: u64,
    /// Velocity gaps too long to bridge: the compensators started anew.
    pub restarts: u64,
    /// Position fixes used.
    pub fixes: u64,
    /// Fixes that jump against the integrated velocity by more than five sigma of the fixes around: passed on and counted.
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
    /// The delay it was given, s (with half the update interval where it runs on held fixes).
    pub delay: Delay,
    /// 2-D rms of raw − this, m; zero for raw.
    pub raw_minus_this_rms_m: Estimate,
    /// Step of the output at a position fix, 2-D rms, m: what the next fix disagrees with.
    pub step_at_fix_rms_m: Option<Estimate>,
    /// 2-D rms error against the reference, m.
    pub error_rms_m: Option<Estimate>,
    /// 2-D 95th percentile of the error against the reference, m.
    pub error_p95_m: Option<Estimate>,
}

/// A curve for a figure, decimated so that every extreme is kept. In `record.json` its lists are empty: the file of the figure
/// holds the points.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct Curve {
    /// Name in the legend.
    pub name: String,
    /// Seconds after the flight's origin. A gap is where `breaks` says, not NaN.
    pub t_s: Vec<f64>,
    /// Values, in the figure's unit.
    pub y: Vec<f64>,
    /// Rows before which the pen is lifted.
    pub breaks: Vec<u32>,
    /// How many samples these rows stand for.
    pub stands_for: u64,
}

/// A curve in the horizontal plane, thinned so that what is left out lies within a thousandth of its extent. In `record.json`
/// its lists are empty: the file of the figure holds the points.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct PathCurve {
    /// Name in the legend.
    pub name: String,
    /// Metres east of the origin.
    pub east_m: Vec<f64>,
    /// Metres north of the origin.
    pub north_m: Vec<f64>,
    /// Rows before which the pen is lifted.
    pub breaks: Vec<u32>,
    /// How many samples these rows stand for.
    pub stands_for: u64,
}

/// How far other positions are ahead of raw along the track, at the first row of every fix, less what was flown since the fix:
/// its age is no part of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct LeadCurves {
    /// The compensated position first, then the reference, if there is one.
    pub of: Vec<Lead>,
    /// Below this ground speed a lead is no time, m/s.
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
    /// Largest in size, m.
    pub largest_m: f64,
    /// Median over the ground speed, ms; `None` if the aircraft is nowhere fast enough.
    pub median_ms: Option<f64>,
    /// Over the flight, m.
    pub over_time_m: Curve,
    /// Over the flight, over the ground speed, ms.
    pub over_time_ms: Curve,
}

/// A ground track with the lead at each of its points. In `record.json` its lists are empty: the file of the figure holds the
/// points.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct LeadTrack {
    /// Metres east of the origin.
    pub east_m: Vec<f64>,
    /// Metres north of the origin.
    pub north_m: Vec<f64>,
    /// Lead of the compensated position over raw along the track, m.
    pub lead_m: Vec<f64>,
    /// Rows before which the pen is lifted.
    pub breaks: Vec<u32>,
    /// How many samples these rows stand for.
    pub stands_for: u64,
}

/// North or east: the curves of the paper's Fig. 7.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct AxisCurves {
    /// `north` or `east`.
    pub axis: String,
    /// Position, m from the origin: raw first, then one curve for each compensator.
    pub position_m: Vec<Curve>,
    /// Raw − compensated, m, by compensator, and what velocity alone predicts.
    pub difference_m: Vec<Curve>,
}

/// The hardest manoeuvre, drawn without decimation where it fits.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct Zoom {
    /// Start, s after the origin.
    pub start_s: f64,
    /// End.
    pub end_s: f64,
    /// Why this window.
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
    /// Time zero of all `t_s`: a stamp, ns, in the clock beside it.
    pub origin_ns: i64,
    /// Clock of the origin.
    pub clock: flight::Clock,
    /// Origin of north and east. `None` if the log gives local coordinates only.
    pub origin: Option<flight::Geodetic>,
    /// How much of the flight the numbers cover.
    pub coverage: Coverage,
    /// Ground speed: median, percentiles, m/s.
    pub speed_mps: flight::Distribution,
    /// 2-D distance that one velocity, half way back, flies in Td and the age of the fix, rms, m: what raw −
    /// compensated should be.
    pub predicted_rms_m: Estimate,
    /// Raw first, then the compensators.
    pub compensators: Vec<CompensatorResult>,
    /// What they are worth, with a reference and without; `None` in records from before this was looked at.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scores: Option<ReplayScores>,
    /// The compensated position that the aircraft computed in flight beside these; `None` if the log holds none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub onboard: Option<Finding<OnboardComparison>>,
    /// Whole flight, north then east.
    pub axes: Vec<AxisCurves>,
    /// The hardest manoeuvre.
    pub zoom: Option<Zoom>,
    /// Ground track, raw first, then the compensators.
    pub track: Vec<PathCurve>,
    /// How far the compensated position is ahead of raw; `None` in records from before this was looked at.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lead: Option<LeadCurves>,
    /// Which delay was removed, and why this one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub choice: Option<DelayChoice>,
    /// What other delays would have done.
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
        // 12 ms over √(3² + 4²) ms, over 3 ms, and over nothing.
        let e_n = |other| found.normalised_difference(&other);
        assert!((e_n(estimate(0.4, Some(0.002))).unwrap() - 2.4).abs() < 1e-12);
        assert!((e_n(estimate(0.4, None)).unwrap() - 4.0).abs() < 1e-12);
        assert_eq!(estimate(0.4, None).normalised_difference(&estimate(0.4, None)), None);
    }
}
