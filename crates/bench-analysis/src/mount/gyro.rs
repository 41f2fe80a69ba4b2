//! Scale, biases and misalignment from the gyro.

use super::{Inputs, MISALIGNMENT_TOLERANCE_RAD, check, coefficient, scale_check};
use crate::alignment::{Clue, estimate};
use record::MountCheck;

/// A turned gyro reads `Rᵀ (0, ξ′, 0)`: about x `φ_z ξ′`, about z `−φ_x ξ′`.
pub(super) fn checks(inputs: &Inputs<'_>, clue: &Clue) -> Vec<MountCheck> {
    let name = &clue.name;
    let sign = inputs.alignment.sign;
    let mut checks = vec![];
    if let Some(y) = clue.regression(1) {
        let scale = estimate(sign * y.coefficients[1], y.standard_uncertainty(1));
        let text = "rate as measured over that of the encoder; a bar that bends raises it too".to_owned();
        checks.push(scale_check(format!("scale y of {name}"), scale, text));
    }
    // The share of the rate that remains on y; 1 without y.
    let along = clue.regression(1).map_or(1.0, |y| (sign * y.coefficients[1]).max(0.0));
    for (axis, about, factor) in [(0, "z", sign), (2, "x", -sign)] {
        if let Some(fit) = clue.regression(axis) {
            let angle = estimate((factor * fit.coefficients[1]).atan2(along), fit.standard_uncertainty(1));
            let text = format!("leakage of the swing's rate into {}", ["x", "y", "z"][axis]);
            let label = format!("misalignment about {about} of {name}");
            checks.push(check(label, "rad", angle, Some(0.0), MISALIGNMENT_TOLERANCE_RAD, text));
        }
    }
    for (axis, letter) in ["x", "y", "z"].into_iter().enumerate() {
        if let Some(fit) = clue.regression(axis) {
            let text = "rate at rest, including the Earth's 15°/h".to_owned();
            checks.push(check(format!("bias {letter} of {name}"), "rad/s", coefficient(fit, 0), None, 0.0, text));
        }
    }
    checks
}
