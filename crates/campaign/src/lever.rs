//! Corrects the delays of positions against velocities for the lever arm of the antenna.

use compensation_replay::{AntennaArm, LeverMotion, LeverSensitivity, VelocityPoint, antenna_arm, lever_sensitivity};
use delay_network::{Lineage, lineage_from_name};
use flight::{About, Flight, Stamp};
use record::{DelayPairKind, Finding, FlightDelays, MeasuredDelay};

use crate::group::receiver_number;

/// Maximum number of velocities examined.
const MOST_ROWS: usize = 20_000;

/// Position of the antenna according to the pipeline.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Antenna {
    /// Distance ahead of the point where velocity is measured, m.
    pub(crate) ahead_m: Option<f64>,
    /// Its standard uncertainty, m.
    pub(crate) uncertainty_m: Option<f64>,
}

/// Removes the effect of the lever arm from every pair of a receiver's position and a velocity that is not of the
/// antenna. If the length is unknown, the pair states the effect of each decimetre.
pub(crate) fn take_out(delays: &mut FlightDelays, flight: &Flight, about: &About, antenna: Antenna) {
    for pair in delays.pairs.iter_mut().filter(|p| p.kind == DelayPairKind::PositionAgainstVelocity) {
        let measured = lineage_from_name(&pair.first) == Lineage::Measured;
        let Finding::Found(found) = &mut pair.delay else { continue };
        if !measured || is_of_antenna(flight, &pair.first, &pair.second) {
            if measured && (antenna.ahead_m.is_some() || antenna.uncertainty_m.is_some()) {
                let text = format!("antenna_ahead_m is not used: {} counts as measured at the antenna", pair.second);
                found.remarks.push(text);
            }
            continue;
        }
        let Some(sensitivity) = sensitivity(flight, &pair.second) else { continue };
        // The parameters of an autopilot are about its own estimate of the velocity.
        let is_filter = lineage_from_name(&pair.second) == Lineage::Derived;
        let of_log = || antenna_arm(about, receiver_number(&pair.first), VelocityPoint::Origin);
        let stated = is_filter.then(of_log).flatten();
        match arm_of(antenna, stated) {
            Some(arm) => take(found, &sensitivity, &arm),
            None => pair.lever_arm_s_per_decimetre = Some(0.1 * sensitivity.shift_s_per_m),
        }
    }
}

/// A velocity with more than this many updates for each of the position is not of its receiver.
const MOST_UPDATES: f64 = 4.0;

/// Whether the velocity is measured at the antenna: it is not a filter's output, and not much faster than the position.
fn is_of_antenna(flight: &Flight, position: &str, velocity: &str) -> bool {
    let updates = |name: &str| flight.channels.get(name).map_or(0.0, |channel| channel.update_count() as f64);
    lineage_from_name(velocity) != Lineage::Derived && updates(velocity) <= MOST_UPDATES * updates(position)
}

/// The arm from the pipeline, else from the log's parameters.
fn arm_of(antenna: Antenna, stated: Option<AntennaArm>) -> Option<AntennaArm> {
    let uncertainty_m = antenna.uncertainty_m.unwrap_or(0.0);
    // Half-width of the rectangular distribution with this standard uncertainty.
    let tolerance_m = uncertainty_m * 3_f64.sqrt();
    match (antenna.ahead_m, stated) {
        (Some(forward_m), _) => {
            Some(AntennaArm { forward_m, right_m: 0.0, tolerance_m, from: "the pipeline".to_owned() })
        }
        (None, Some(stated)) => Some(AntennaArm { tolerance_m, ..stated }),
        (None, None) if uncertainty_m > 0.0 => {
            Some(AntennaArm { forward_m: 0.0, right_m: 0.0, tolerance_m, from: "the pipeline".to_owned() })
        }
        (None, None) => None,
    }
}

fn take(found: &mut MeasuredDelay, sensitivity: &LeverSensitivity, arm: &AntennaArm) {
    let before = found.delay_s;
    found.delay_s = sensitivity.corrected(before, arm);
    let shift = found.delay_s.value - before.value;
    let wider = sensitivity.shift_s(arm).standard_uncertainty.unwrap_or(0.0);
    let middle = before.value;
    for end in &mut found.interval_95_s {
        let half = *end - middle;
        *end = middle + shift + half.signum() * half.hypot(1.96 * wider);
    }
    for window in &mut found.over_time {
        window.delay_s.value += shift;
    }
    if shift != 0.0 {
        found.remarks.push(sensitivity.words_of(arm));
    }
}

fn sensitivity(flight: &Flight, velocity: &str) -> Option<LeverSensitivity> {
    let channel = flight.channels.get(velocity)?;
    let rows = channel.update_rows();
    let every = rows.len().div_ceil(MOST_ROWS).max(1);
    let rows: Vec<usize> = rows.into_iter().step_by(every).collect();
    let stamps = channel.series.timeline().stamps();
    let origin = stamps.first().copied().unwrap_or(Stamp(0));
    let time_s: Vec<f64> = rows.iter().map(|&r| stamps[r].seconds_since(origin)).collect();
    let axis = |k: usize| rows.iter().map(|&r| channel.series.component(k)[r]).collect::<Vec<f64>>();
    let (north, east) = (axis(0), axis(1));
    lever_sensitivity(&LeverMotion { time_s: &time_s, velocity_mps: [&north, &east], ..LeverMotion::default() })
}
