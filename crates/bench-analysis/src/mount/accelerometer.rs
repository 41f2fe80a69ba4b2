//! Lever arm, scale, biases and misalignment from the accelerometer.

use super::{ARM_TOLERANCE_M, Inputs, MISALIGNMENT_TOLERANCE_RAD, Side, check, coefficient, scale_check, u, unknown};
use crate::alignment::{Clue, ForceFit, estimate, force_fit};
use crate::kinematics::specific_force;
use record::{Estimate, MountCheck};
use signal::regress;

/// Minimum length of the lever arm in standard uncertainties to determine its side.
const CLEAR: f64 = 5.0;

/// Side of the pivot that the accelerometer is on: its arm against the direction of gravity.
pub(super) fn side(inputs: &Inputs<'_>, clue: &Clue) -> Option<Side> {
    let fit = force_fit(clue, inputs.alignment.sign).filter(|fit| fit.arm_is_fitted)?;
    let (z, x) = (fit.estimate(2), fit.estimate(3));
    let [cos_0, sin_0, ..] = fit.coefficients;
    let zero = sin_0.atan2(cos_0);
    let n = clue.fit.states.len().max(1) as f64;
    let (mut down, mut upward) = (0.0, 0.0);
    for state in &clue.fit.states {
        let (s, c) = (inputs.alignment.sign * state.angle + zero).sin_cos();
        down += (z.value * c - x.value * s) / n;
        upward += c / n;
    }
    (down.abs() > CLEAR * u(&z).hypot(u(&x))).then_some(Side { below: down > 0.0, upside_down: Some(upward < 0.0) })
}

pub(super) fn checks(inputs: &Inputs<'_>, clue: &Clue) -> Vec<MountCheck> {
    let mut checks = vec![];
    if let Some(fit) = force_fit(clue, inputs.alignment.sign) {
        checks.extend(in_plane(inputs, clue, fit));
    }
    checks.extend(across(inputs, clue).unwrap_or_default());
    checks
}

fn in_plane(inputs: &Inputs<'_>, clue: &Clue, fit: &ForceFit) -> Vec<MountCheck> {
    let name = &clue.name;
    let [x, _, z] = clue.mount.lever_arm_m;
    let [cos_0, sin_0, ..] = fit.coefficients;
    let size = cos_0.hypot(sin_0);
    // Gravity shows the scale of the accelerometer, which is no length.
    let unscaled = |e: Estimate| {
        let factor = 1.0 / size;
        estimate(factor * e.value, factor * u(&e))
    };
    let (fitted_z, fitted_x) = (unscaled(fit.estimate(2)), unscaled(fit.estimate(3)));
    let pitch = fitted_x.value.atan2(fitted_z.value) - x.atan2(z);
    let arm = |axis: &str, fitted, stated, text: String| {
        let label = format!("lever arm {axis} of {name}");
        let why = "at a single frequency, acceleration and gravity vary alike: vary the pace, or swing wider";
        if fit.arm_is_fitted {
            inputs.length_check(label, fitted, stated, x.hypot(z), (ARM_TOLERANCE_M, text))
        } else {
            unknown(label, "m", why)
        }
    };
    let scale = estimate(size, fit.spread_of_gravity(cos_0 / size, sin_0 / size));
    let pitched = format!(
        "off the bar's line by {}°: a lever arm off the axis, or the sensor pitched by that angle",
        flight::fixed(crate::kinematics::wrapped(pitch).to_degrees(), 2)
    );
    let gravity =
        format!("gravity as measured over {:.5} m/s² ({})", inputs.around.gravity_mps2, inputs.around.gravity_source);
    let bias = |axis: &str, k: usize| {
        let text = "offset after gravity and motion are removed";
        check(format!("bias {axis} of {name}"), "m/s²", fit.estimate(k), None, 0.0, text.to_owned())
    };
    vec![
        arm(
            "z",
            fitted_z,
            z,
            "from the angular acceleration and the square of the rate; a bar that bends raises it too".to_owned(),
        ),
        arm("x", fitted_x, x, pitched),
        scale_check(format!("scale of {name}"), scale, gravity),
        bias("x", 4),
        bias("z", 5),
    ]
}

/// The axis across the swing reads `−φ_z f_X + φ_x f_Z + b`, where a level, aligned one reads nothing.
fn across(inputs: &Inputs<'_>, clue: &Clue) -> Option<Vec<MountCheck>> {
    let k = clue.component.iter().position(|c| *c == 1)?;
    let arm = clue.mount.lever_arm_m;
    let (sign, zero) = (inputs.alignment.sign, inputs.alignment.zero_rad.value);
    let forces: Vec<[f64; 3]> = clue
        .fit
        .states
        .iter()
        .map(|raw| {
            let state = crate::kinematics::BarState {
                angle: sign * raw.angle + zero,
                rate: sign * raw.rate,
                acceleration: sign * raw.acceleration,
                jerk: sign * raw.jerk,
            };
            specific_force(&state, arm, inputs.around.gravity_mps2).value
        })
        .collect();
    let column = |axis: usize| forces.iter().map(|f| f[axis]).collect::<Vec<f64>>();
    let y: Vec<f64> = clue.fit.rows.iter().map(|&row| clue.samples.components[k][row]).collect();
    let (one, x, z) = (vec![1.0; y.len()], column(0), column(2));
    let fit = regress(&[&one, &x, &z], &["bias", "x", "z"], &y).ok()?;
    let name = &clue.name;
    let angle = |leak: f64, k| estimate(leak.clamp(-1.0, 1.0).asin(), fit.standard_uncertainty(k));
    let misalignment = |axis: &str, value, text: &str| {
        check(
            format!("misalignment about {axis} of {name}"),
            "rad",
            value,
            Some(0.0),
            MISALIGNMENT_TOLERANCE_RAD,
            text.to_owned(),
        )
    };
    Some(vec![
        misalignment("z", angle(-fit.coefficients[1], 1), "leakage of the x axis into y"),
        misalignment(
            "x",
            angle(fit.coefficients[2], 2),
            "leakage of the z axis into y: a rolled sensor, or an axis of rotation that is not level",
        ),
        check(
            format!("bias y of {name}"),
            "m/s²",
            coefficient(&fit, 0),
            None,
            0.0,
            "the swing does not excite y".to_owned(),
        ),
    ])
}
