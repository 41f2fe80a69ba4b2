//! The bar's angle at encoder zero.

use super::clue::{Circle, Clue};
use super::estimate;
use super::force::ForceFit;
use crate::kinematics::wrapped;
use crate::motion::Motion;
use crate::rig::{MountKind, Rig};
use flight::{Code, Notices, Quantity};
use record::Estimate;

/// Alignment accuracy of the axes of a calibrated MEMS accelerometer (0.1°).
const ACCELEROMETER_AXES_RAD: f64 = 1.7e-3;
/// Pitch accuracy of an INS with MEMS sensors (0.5°).
const ATTITUDE_RAD: f64 = 8.7e-3;
/// Accuracy of north, east and down of a velocity or position (0.2°).
const CIRCLE_RAD: f64 = 3.5e-3;
/// A zero more uncertain than this is rejected (10°).
const LEAST_USEFUL_RAD: f64 = 0.17;
/// Deviation of a hanging bar from the vertical due to friction (0.5°).
const REST_RAD: f64 = 8.7e-3;
/// A bar at rest moves less than this, in counts per second, for at least [`REST_S`] seconds.
const REST_COUNTS_PER_S: f64 = 1.0;
const REST_S: f64 = 5.0;
/// Uncertainty of the assumption that the bar swings about the vertical (10°).
const GUESS_RAD: f64 = 0.17;

/// The zero according to each channel alone, rad.
pub(super) fn zeros(clues: &[Clue], sign: f64, azimuth: Option<f64>) -> Vec<(String, Estimate)> {
    let of = |clue: &Clue| {
        let (value, u) = match clue.quantity {
            Quantity::SpecificForce => from_force(clue, sign)?,
            Quantity::Attitude => from_attitude(clue, sign)?,
            Quantity::PositionGeodetic | Quantity::PositionNed | Quantity::VelocityNed | Quantity::Height => {
                from_circle(clue, sign, azimuth)?
            }
            _ => return None,
        };
        (u < LEAST_USEFUL_RAD).then(|| (clue.name.clone(), estimate(wrapped(value), u)))
    };
    clues.iter().filter_map(of).collect()
}

/// The zero to use, and its source.
pub(super) fn zero(
    zeros: &[(String, Estimate)],
    motion: &Motion,
    sign: f64,
    rig: &Rig,
    notices: &mut Notices,
) -> (Estimate, String) {
    if let Some(stated) = rig.encoder.zero_rad {
        return (Estimate { value: wrapped(stated), standard_uncertainty: None }, "rig file".to_owned());
    }
    let surest = zeros.iter().min_by(|a, b| uncertainty(&a.1).total_cmp(&uncertainty(&b.1)));
    if let Some((channel, zero)) = surest {
        return (*zero, format!("fitted: from {channel}, the most certain of {} channels", zeros.len()));
    }
    if let Some(zero) = from_rest(motion, sign, rig) {
        return (zero, "from the bar hanging at rest".to_owned());
    }
    let zero = from_the_middle(motion, sign);
    let text = "no channel shows the bar's angle at encoder zero: the swing is assumed to be symmetric about the \
                vertical";
    notices.push(Code::Assumption, "", 1, text);
    (zero, "assumed: the swing is symmetric about the vertical".to_owned())
}

fn uncertainty(e: &Estimate) -> f64 {
    e.standard_uncertainty.unwrap_or(f64::INFINITY)
}

/// The stacked fit of an accelerometer for the current sign.
pub(crate) fn force_fit(clue: &Clue, sign: f64) -> Option<&ForceFit> {
    clue.force.as_ref().map(|[plus, minus]| if sign > 0.0 { plus } else { minus })
}

/// Direction of gravity: biases and lever arm are fitted as well, so neither affects it.
fn from_force(clue: &Clue, sign: f64) -> Option<(f64, f64)> {
    let fit = force_fit(clue, sign)?;
    let [u, w, ..] = fit.coefficients;
    let r2 = u * u + w * w;
    Some((w.atan2(u), fit.spread_of_gravity(-w / r2, u / r2).hypot(ACCELEROMETER_AXES_RAD)))
}

/// Swing angle minus encoder, both at the middle of the swing, where the slope's error has no effect.
fn from_attitude(clue: &Clue, sign: f64) -> Option<(f64, f64)> {
    let measured = clue.samples.components.first()?;
    let n = clue.fit.rows.len() as f64;
    let mean =
        clue.fit.rows.iter().zip(&clue.fit.states).map(|(&row, b)| measured[row] - sign * b.angle).sum::<f64>() / n;
    let u = clue.regression(0)?.residuals.iter().map(|r| r * r).sum::<f64>() / n;
    Some((mean, (u / n).sqrt().hypot(ATTITUDE_RAD)))
}

/// Phase of the sensor's circle relative to its lever arm.
fn from_circle(clue: &Clue, sign: f64, azimuth: Option<f64>) -> Option<(f64, f64)> {
    let horizontal = azimuth.and_then(|e| Circle::from_horizontal(clue, sign, e));
    let circle = Circle::combined(Circle::from_down(clue, sign), horizontal)?;
    let [x, _, z] = clue.mount.lever_arm_m;
    let (phase, u) = circle.phase();
    Some((phase - x.atan2(z), u.hypot(CIRCLE_RAD)))
}

/// A hanging bar comes to rest with the sensor straight below the pivot.
fn from_rest(motion: &Motion, sign: f64, rig: &Rig) -> Option<Estimate> {
    if rig.bar.mount != MountKind::Hanging {
        return None;
    }
    let (t, rate): (Vec<f64>, Vec<f64>) = motion.states().map(|(t, b)| (t, b.rate)).unzip();
    let threshold = REST_COUNTS_PER_S * motion.encoder().lsb_rad();
    let rests = signal::static_segments(&t, &rate, threshold, REST_S);
    let angles: Vec<f64> =
        rests.into_iter().flatten().filter_map(|row| motion.encoder().angle_rad.get(row).copied()).collect();
    if angles.is_empty() {
        return None;
    }
    let mean = angles.iter().sum::<f64>() / angles.len() as f64;
    Some(estimate(wrapped(-sign * mean), REST_RAD.hypot(motion.encoder().variance().sqrt())))
}

/// Assumes angle zero, as defined by the rig file, in the middle of the swing.
fn from_the_middle(motion: &Motion, sign: f64) -> Estimate {
    let mut angles: Vec<f64> = motion.states().map(|(_, b)| b.angle).collect();
    let middle = signal::median_in_place(&mut angles).unwrap_or(0.0);
    estimate(wrapped(-sign * middle), GUESS_RAD)
}
