//! The direction of the swing's plane.

use super::clue::{Circle, Clue};
use super::estimate;
use crate::kinematics::wrapped;
use crate::rig::Rig;
use flight::Quantity;
use nalgebra::{Matrix2, Vector2};
use record::Estimate;
use signal::Regression;

/// An azimuth more uncertain than this is rejected (10°).
const LEAST_USEFUL_RAD: f64 = 0.17;
/// Accuracy of the heading of an INS indoors, where steel bends the field (5°).
const HEADING_RAD: f64 = 0.087;

/// The azimuth according to each channel alone, rad.
pub(super) fn azimuths(clues: &[Clue], sign: f64, zero: f64) -> Vec<(String, Estimate)> {
    let of = |clue: &Clue| {
        let (value, u) = match clue.quantity {
            Quantity::VelocityNed | Quantity::PositionGeodetic | Quantity::PositionNed => {
                from_horizontal(clue, sign, zero)?
            }
            Quantity::Attitude => clue.heading.map(|(value, u)| (value, u.hypot(HEADING_RAD)))?,
            _ => return None,
        };
        (u < LEAST_USEFUL_RAD).then(|| (clue.name.clone(), estimate(wrapped(value), u)))
    };
    clues.iter().filter_map(of).collect()
}

/// The azimuth to use, and its source.
pub(super) fn azimuth(azimuths: &[(String, Estimate)], rig: &Rig) -> (Option<Estimate>, String) {
    if let Some(stated) = rig.bar.azimuth_rad {
        return (Some(Estimate { value: wrapped(stated), standard_uncertainty: None }), "rig file".to_owned());
    }
    let u = |e: &Estimate| e.standard_uncertainty.unwrap_or(f64::INFINITY);
    match azimuths.iter().min_by(|a, b| u(&a.1).total_cmp(&u(&b.1))) {
        Some((channel, azimuth)) => {
            (Some(*azimuth), format!("fitted: from {channel}, the most certain of {} channels", azimuths.len()))
        }
        None => (None, "unknown: no velocity, position or attitude shows it well enough".to_owned()),
    }
}

/// The principal direction of (north, east). Its 180° ambiguity is resolved by the sign of the encoder and the side of
/// the pivot that the sensor is on: from the channel's own down component, with rig and zero as fallback.
fn from_horizontal(clue: &Clue, sign: f64, zero: f64) -> Option<(f64, f64)> {
    let (north, east) = (clue.regression(0)?, clue.regression(1)?);
    let [x, _, z] = clue.mount.lever_arm_m;
    let (sin_0, cos_0) = zero.sin_cos();
    let by_rig = (z * cos_0 - x * sin_0, z * sin_0 + x * cos_0);
    let (a, b) = Circle::from_down(clue, sign).map_or(by_rig, |own| {
        let (radius, u) = own.radius();
        if radius > 5.0 * u { (own.a, own.b) } else { by_rig }
    });
    // The coefficients of sine and cosine are proportional to these, for north and east alike.
    let shape = match clue.quantity {
        Quantity::VelocityNed => Vector2::new(-b, sign * a),
        _ => Vector2::new(sign * a, b),
    };
    let weights = (covariance(north) + covariance(east)).try_inverse()? * shape;
    let (n, e) = (weighted(north, weights), weighted(east, weights));
    let size2 = n.0 * n.0 + e.0 * e.0;
    let across = (e.0 * e.0 * n.1 + n.0 * n.0 * e.1) / (size2 * size2);
    Some((e.0.atan2(n.0), across.sqrt()))
}

/// Covariance of the coefficients of sine and cosine.
fn covariance(fit: &Regression) -> Matrix2<f64> {
    let p = &fit.covariance;
    Matrix2::new(p[1][1], p[1][2], p[2][1], p[2][2])
}

/// Weighted sum of the coefficients of sine and cosine, and its variance.
fn weighted(fit: &Regression, weights: Vector2<f64>) -> (f64, f64) {
    let value = weights[0] * fit.coefficients[1] + weights[1] * fit.coefficients[2];
    (value, (weights.transpose() * covariance(fit) * weights)[0].max(0.0))
}
