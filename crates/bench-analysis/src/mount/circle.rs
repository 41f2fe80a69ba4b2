//! Length of the bar from position and velocity.

use super::{Inputs, LENGTH_TOLERANCE, Side};
use crate::alignment::{Circle, Clue, estimate};
use flight::Quantity;
use record::MountCheck;

/// A length with a larger relative uncertainty is not reported.
const LEAST_USEFUL_SHARE: f64 = 0.2;
const CLEAR: f64 = 5.0;
/// Prefix of the name of such a check.
pub(super) const NAME: &str = "distance from the axis by";

fn circle(inputs: &Inputs<'_>, clue: &Clue) -> Option<Circle> {
    let sign = inputs.alignment.sign;
    let azimuth = inputs.alignment.azimuth_rad.map(|e| e.value);
    let horizontal = azimuth.and_then(|e| Circle::from_horizontal(clue, sign, e));
    Circle::combined(Circle::from_down(clue, sign), horizontal)
}

pub(super) fn checks(inputs: &Inputs<'_>, clue: &Clue) -> Vec<MountCheck> {
    let Some(circle) = circle(inputs, clue) else { return vec![] };
    let (radius, u) = circle.radius();
    if u > LEAST_USEFUL_SHARE * radius {
        return vec![];
    }
    let [x, _, z] = clue.mount.lever_arm_m;
    let stated = x.hypot(z);
    let text = "radius of the circle, times the sensor's gain; a bar that bends raises it too".to_owned();
    let label = format!("{NAME} {}", clue.name);
    let found = inputs.length_check(label, estimate(radius, u), stated, stated, (LENGTH_TOLERANCE * stated, text));
    if clue.quantity == Quantity::Height {
        let text = "not compared: a barometer is slow, and wind and tubes change its gain".to_owned();
        return vec![MountCheck { of_rig: false, agrees: None, text, ..found }];
    }
    vec![found]
}

/// Below or above the pivot in the middle of the swing, from the vertical component alone.
pub(super) fn side(inputs: &Inputs<'_>, clue: &Clue) -> Option<Side> {
    let sign = inputs.alignment.sign;
    let circle = Circle::from_down(clue, sign)?;
    let (radius, u) = circle.radius();
    let n = clue.fit.states.len().max(1) as f64;
    let down: f64 =
        clue.fit.states.iter().map(|raw| (circle.a * raw.angle.cos() - sign * circle.b * raw.angle.sin()) / n).sum();
    (radius > CLEAR * u && down.abs() > CLEAR * u).then_some(Side { below: down > 0.0, upside_down: None })
}
