//! The bar's angle at encoder zero.

use super::clue::{Circle, Clue};
use super::estimate;
use super::force::ForceFit;
use crate::kinematics::wrapped;
use crate::motion::Motion;
use crate::rig::{MountKind, Rig};
use flight::{Code, Notices, Quantity};
use record::Estimate;

/// Axes of a calibrated MEMS accelerometer are true to about this (0.1°).
const ACCELEROMETER_AXES_RAD: f64 = 1.7e-3;
/// Pitch of an INS on MEMS sensors is true to about this (0.5°).
const ATTITUDE_RAD: f64 = 8.7e-3;
/// North, east and down of a velocity or position are true to about this (0.2°).
const CIRCLE_RAD: f64 = 3.5e-3;
/// A zero less well known than this is no zero (10°).
const LEAST_USEFUL_RAD: f64 = 0.17;
/// Friction holds a hanging bar this far from the vertical (0.5°).
const REST_RAD: f64 = 8.7e-3;
/// A bar at rest moves less than this, in counts per second, for at least so many seconds.
const REST_COUNTS_PER_S: f64 = 1.0;
const REST_S: f64 = 5.0;
/// How far a guess that the bar swings about the vertical may be off (10°).
const GUESS_RAD: f64 = 0.17;

/// The zero as each channel alone shows it, rad.
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

/// The zero to work with, and where it comes from.
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
    let text = "no channel shows the bar's angle at encoder zero: the swing is assumed to be even about the vertical";
    notices.push(Code::Assumption, "", 1, text);
    (zero, "assumed: the swing is even about the vertical".to_owned())
}

fn uncertainty(e: &Estimate) -> f64 {
    e.standard_uncertainty.unwrap_or(f64::INFINITY)
}

/// The stacked fit of an accelerometer for the sign in use.
pub(crate) fn force_fit(clue: &Clue, sign: f64) -> Option<&ForceFit> {
    clue.force.as_ref().map(|[plus, minus]| if sign > 0.0 { plus } else { minus })
}

/// Direction of gravity: biases and lever arm are fitted along, so neither spoils it.
fn from_force(clue: &Clue, sign: f64) -> Option<(f64, f64)> {
    let fit = force_fit(clue, sign)?;
    let [u, w, ..] = fit.coefficients;
    let r2 = u * u + w * w;
    Some((w.atan2(u), fit.spread_of_gravity(-w / r2, u / r2).hypot(ACCELEROMETER_AXES_RAD)))
}

/// Swing angle less encoder, both at the middle of the swing, where the slope's error does not enter.
fn from_attitude(clue: &Clue, sign: f64) -> Option<(f64, f64)> {
    let measured = clue.samples.components.first()?;
    let n = clue.fit.rows.len() as f64;
    let mean =
        clue.fit.rows.iter().zip(&clue.fit.states).map(|(&row, b)| measured[row] - sign * b.angle).sum::<f64>() / n;
    let u = clue.regression(0)?.residuals.iter().map(|r| r * r).sum::<f64>() / n;
    Some((mean, (u / n).sqrt().hypot(ATTITUDE_RAD)))
}

/// Phase of the sensor's circle against its lever arm.
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

/// Angle zero, as the rig defines it, in the middle of the swing.
fn from_the_middle(motion: &Motion, sign: f64) -> Estimate {
    let mut angles: Vec<f64> = motion.states().map(|(_, b)| b.angle).collect();
    let middle = signal::median_in_place(&mut angles).unwrap_or(0.0);
    estimate(wrapped(-sign * middle), GUESS_RAD)
}
