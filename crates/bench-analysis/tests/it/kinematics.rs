//! Checks the formulas of design note 1 against its acceptance vectors, and against each other.

use crate::support::{close, numbers, vectors};
use bench_analysis::{
    BarState, MagneticModel, acceleration, angular_rate, attitude, bending_response, decimal_year, first_mode_of_gain,
    magnetic_field, ned_from_body, normal_gravity, position, rotation, specific_force, swing_angle, swing_azimuth,
    velocity,
};
use nalgebra::Vector3;
use serde_json::Value;
use std::f64::consts::{PI, TAU};

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

fn triple(value: &Value) -> [f64; 3] {
    numbers(value).try_into().unwrap()
}

#[test]
fn all_six_families_equal_the_acceptance_vectors() {
    let vectors = vectors();
    let cases = vectors["kinematics"]["cases"].as_array().unwrap();
    assert_eq!(cases.len(), 10);
    for case in cases {
        let input = &case["input"];
        let state = BarState {
            angle: number(&input["xi"]),
            rate: number(&input["xi_dot"]),
            acceleration: number(&input["xi_ddot"]),
            jerk: 0.0,
        };
        let (eta, arm, g) = (number(&input["eta"]), triple(&input["r_B"]), number(&input["g"]));
        let matrix = ned_from_body(eta, state.angle);
        for row in 0..3 {
            close(&numbers(&case["C_B_to_NED"][row]), &[0, 1, 2].map(|c| matrix[(row, c)]), 1e-12);
        }
        close(&numbers(&case["p_NED"]), &position(&state, eta, arm).value, 1e-12);
        close(&numbers(&case["v_NED"]), &velocity(&state, eta, arm).value, 1e-12);
        close(&numbers(&case["a_NED"]), &acceleration(&state, eta, arm), 1e-12);
        close(&numbers(&case["f_B"]), &specific_force(&state, arm, g).value, 1e-12);
        close(&numbers(&case["omega_B"]), &angular_rate(&state, eta, None).value, 1e-12);
        close(&numbers(&case["mag_B"]), &magnetic_field(&state, eta, triple(&input["b_NED"])).value, 1e-12);
        // A quaternion and its negative are one attitude.
        let expected = numbers(&case["quat_wxyz_B_to_NED"]);
        let found = attitude(state.angle, eta);
        let same_sign = expected.iter().zip(&found).map(|(a, b)| a * b).sum::<f64>().signum();
        close(&expected, &found.map(|q| same_sign * q), 1e-12);
    }
}

#[test]
fn a_misaligned_sensor_reads_the_acceptance_vector() {
    let case = &vectors()["misalignment"];
    let turn = rotation(triple(&case["phi"]));
    for row in 0..3 {
        close(&numbers(&case["R"][row]), &[0, 1, 2].map(|c| turn[(row, c)]), 1e-12);
    }
    let sensed: [f64; 3] = (turn.transpose() * Vector3::from(triple(&case["f_B"]))).into();
    close(&numbers(&case["f_S"]), &sensed, 1e-12);
}

#[test]
fn gravity_equals_the_acceptance_vectors() {
    for case in vectors()["gravity_somigliana"]["cases"].as_array().unwrap() {
        let found = normal_gravity(number(&case["lat_deg"]).to_radians(), number(&case["h_m"]));
        assert!((found - number(&case["g"])).abs() < 1e-9, "{case}: {found}");
    }
}

#[test]
fn a_bending_bar_matches_the_acceptance_vectors() {
    for row in vectors()["flex_bar"]["rows"].as_array().unwrap() {
        let [fn_hz, f, zeta, gamma] = ["fn", "f", "zeta", "Gamma"].map(|k| number(&row[k]));
        let (magnitude, argument) = bending_response(f, fn_hz, zeta, gamma);
        assert!((magnitude - number(&row["mag"])).abs() < 1e-12, "{row}: {magnitude}");
        assert!((argument - number(&row["arg"])).abs() < 1e-12, "{row}: {argument}");
        // Without damping, the mode is recovered from the gain.
        let (gain, _) = bending_response(f, fn_hz, 0.0, gamma);
        assert!((first_mode_of_gain(gain, gamma, f).unwrap() - fn_hz).abs() < 1e-9);
    }
}

#[test]
fn the_field_at_goyang_equals_the_acceptance_vectors() {
    for case in vectors()["wmm_goyang"]["cases"].as_array().unwrap() {
        let year = number(&case["decimal_year"]);
        let place = flight::Geodetic::from_degrees(number(&case["lat_deg"]), number(&case["lon_deg"]), 0.0);
        let model = MagneticModel::for_year(year);
        assert_eq!(model.name(), case["model"].as_str().unwrap());
        let [north, east, down] = model.field(place, year).map(|t| t * 1e9);
        close(&["X_nT", "Y_nT", "Z_nT"].map(|k| number(&case[k])), &[north, east, down], 1e-4);
        let horizontal = north.hypot(east);
        let angles = [down.atan2(horizontal).to_degrees(), east.atan2(north).to_degrees()];
        close(&["incl_deg", "decl_deg"].map(|k| number(&case[k])), &angles, 1e-6);
    }
    assert!((decimal_year(jiff::civil::date(2010, 10, 25)) - 2010.8137).abs() < 1e-4);
}

/// Poses all around: azimuth and bar angle over the full circle, including gimbal lock and hanging upside down.
fn poses() -> impl Iterator<Item = (f64, f64)> {
    (0..24).flat_map(|e| (0..48).map(move |x| (-PI + f64::from(e) * TAU / 24.0, -PI + f64::from(x) * TAU / 48.0)))
}

fn turn_between(a: f64, b: f64) -> f64 {
    (a - b + PI).rem_euclid(TAU) - PI
}

#[test]
fn the_swing_angle_of_an_attitude_is_the_bar_angle_in_every_pose() {
    for (azimuth, angle) in poses() {
        let quaternion = attitude(angle, azimuth);
        assert!(turn_between(swing_angle(quaternion), angle).abs() < 1e-12, "{azimuth} {angle}");
        assert!(turn_between(swing_azimuth(quaternion), azimuth).abs() < 1e-12, "{azimuth} {angle}");
    }
}

#[test]
fn a_wrong_heading_does_not_change_the_swing_angle() {
    for (azimuth, angle) in poses() {
        // Heading error about the vertical: q_z(0.3) q.
        let [w, x, y, z] = attitude(angle, azimuth);
        let (s, c) = 0.15f64.sin_cos();
        let turned = [c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w];
        assert!(turn_between(swing_angle(turned), angle).abs() < 1e-12);
    }
}

#[test]
fn velocity_and_acceleration_are_derivatives_of_position() {
    let arm = [0.1, 0.02, -1.3];
    let state = |t: f64| BarState {
        angle: 1.1 * (2.9 * t).sin(),
        rate: 1.1 * 2.9 * (2.9 * t).cos(),
        acceleration: -1.1 * 2.9f64.powi(2) * (2.9 * t).sin(),
        jerk: 0.0,
    };
    let h = 1e-5;
    for k in 0..20 {
        let t = f64::from(k) * 0.11;
        let slope = |of: &dyn Fn(f64) -> [f64; 3]| {
            let (a, b) = (of(t - h), of(t + h));
            [0, 1, 2].map(|c| (b[c] - a[c]) / (2.0 * h))
        };
        // Central differences of 1e-5 s: truncation 1e-10 times the third derivative, below 1e-7.
        close(&slope(&|t| position(&state(t), 0.7, arm).value), &velocity(&state(t), 0.7, arm).value, 1e-7);
        close(&slope(&|t| velocity(&state(t), 0.7, arm).value), &acceleration(&state(t), 0.7, arm), 1e-7);
    }
}

#[test]
fn specific_force_is_acceleration_minus_gravity_in_body_axes() {
    for (azimuth, angle) in poses() {
        let state = BarState { angle, rate: 1.7, acceleration: -5.2, jerk: 0.0 };
        let arm = [0.12, 0.0, -1.3];
        let [n, e, d] = acceleration(&state, azimuth, arm);
        let body = ned_from_body(azimuth, angle).transpose() * Vector3::new(n, e, d - 9.8);
        close(&<[f64; 3]>::from(body), &specific_force(&state, arm, 9.8).value, 1e-12);
    }
}

#[test]
fn a_gyro_that_measures_earth_rate_sees_it_rotate_with_the_bar() {
    let latitude = 0.6f64;
    let earth = Vector3::new(latitude.cos(), 0.0, -latitude.sin()) * bench_analysis::EARTH_RATE;
    for (azimuth, angle) in poses() {
        let state = BarState { angle, rate: 0.4, ..BarState::default() };
        let body = ned_from_body(azimuth, angle).transpose() * earth + Vector3::new(0.0, 0.4, 0.0);
        close(&<[f64; 3]>::from(body), &angular_rate(&state, azimuth, Some(latitude)).value, 1e-15);
    }
}

#[test]
fn slopes_of_all_families_are_derivatives_by_the_state() {
    let (azimuth, arm) = (0.9, [0.08, 0.01, -1.25]);
    let families: [&dyn Fn(&BarState) -> bench_analysis::Sensed; 5] = [
        &|s| position(s, azimuth, arm),
        &|s| velocity(s, azimuth, arm),
        &|s| specific_force(s, arm, 9.8),
        &|s| angular_rate(s, azimuth, Some(0.6)),
        &|s| magnetic_field(s, azimuth, [0.58, -0.08, 0.81]),
    ];
    let state = BarState { angle: 0.7, rate: -1.3, acceleration: 4.1, jerk: 0.0 };
    let h = 1e-6;
    for family in families {
        let changed = |k: usize, by: f64| {
            let mut s = state;
            *[&mut s.angle, &mut s.rate, &mut s.acceleration][k] += by;
            family(&s).value
        };
        for k in 0..3 {
            let (low, high) = (changed(k, -h), changed(k, h));
            for c in 0..3 {
                let slope = (high[c] - low[c]) / (2.0 * h);
                assert!((slope - family(&state).slope[c][k]).abs() < 1e-8, "{slope} {:?}", family(&state));
            }
        }
    }
}

/// One-σ steps along the columns of the covariance's Cholesky factor change a linear function by its contributions.
#[test]
fn the_standard_deviation_of_a_reading_is_that_of_the_linearised_family() {
    // P = L Lᵀ for (ξ, ξ′, ξ″), no jerk.
    let l = [[2e-4, 0.0, 0.0], [1e-3, 5e-3, 0.0], [-4e-3, 2e-2, 8e-2]];
    let p = |i: usize, j: usize| (0..3).map(|k| l[i][k] * l[j][k]).sum::<f64>();
    let covariance = [p(0, 0), p(0, 1), p(0, 2), 0.0, p(1, 1), p(1, 2), 0.0, p(2, 2), 0.0, 0.0];
    let state = BarState { angle: 0.5, rate: 2.0, acceleration: -3.0, jerk: 0.0 };
    let sensed = specific_force(&state, [0.05, 0.0, -1.3], 9.8);
    let expected = sensed
        .slope
        .map(|row| (0..3).map(|k| (0..3).map(|i| row[i] * l[i][k]).sum::<f64>().powi(2)).sum::<f64>().sqrt());
    close(&expected, &sensed.standard_deviation(&covariance), 1e-14);
    assert_eq!(sensed.standard_deviation(&covariance)[1], 0.0);
}
