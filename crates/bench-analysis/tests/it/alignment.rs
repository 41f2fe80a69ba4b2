//! Fits what the rig file leaves open from the sensor, including late channels.

use crate::support::{LENGTH, Sensor, Swing, encoder_channel, everything, flight_of, motion, rig, sensed};
use bench_analysis::{Alignment, Rig, Surroundings, align};
use flight::{Flight, Quantity};
use std::f64::consts::{PI, TAU};

fn turn(a: f64, b: f64) -> f64 {
    (a - b + PI).rem_euclid(TAU) - PI
}

fn aligned(swing: &Swing, sensor: &Flight, rig: &Rig, sign: f64, zero: f64) -> Alignment {
    let raw = motion(&encoder_channel(swing, 100.0, 2000.0, sign, zero), rig);
    let (around, _) = Surroundings::of(rig, None, None);
    align(&raw, sensor, rig, &around)
}

fn codes(alignment: &Alignment) -> Vec<&str> {
    alignment.notices.iter().map(|n| n.code.as_str()).collect()
}

/// Zero within `sigmas` of the stated uncertainty, and of 1°.
fn zero_is(alignment: &Alignment, zero: f64) {
    let off = turn(alignment.zero_rad.value, zero);
    let u = alignment.zero_rad.standard_uncertainty.unwrap();
    assert!(off.abs() < 4.0 * u && u < 0.0175, "{}: {off} ± {u}", alignment.zero_source);
}

fn azimuth_is(alignment: &Alignment, azimuth: f64) {
    let found = alignment.azimuth_rad.unwrap();
    let (off, u) = (turn(found.value, azimuth), found.standard_uncertainty.unwrap());
    assert!(off.abs() < 4.0 * u && u < 0.0175, "{}: {off} ± {u}", alignment.azimuth_source);
}

#[test]
fn sign_zero_and_azimuth_are_found_for_any_encoder_and_plane() {
    let swing = Swing::by_hand(0.05);
    for (azimuth, sign, zero) in [(0.5, 1.0, 0.0), (-2.8, -1.0, 2.0), (3.1, 1.0, 3.1)] {
        let sensor = everything(&swing, &Sensor::upright(azimuth));
        let found = aligned(&swing, &sensor, &rig("", "", ""), sign, zero);
        assert_eq!(found.sign, sign, "{}", found.sign_source);
        zero_is(&found, zero);
        azimuth_is(&found, azimuth);
        assert!(found.notices.is_empty(), "{:?}", found.notices);
    }
}

#[test]
fn each_channel_is_aligned_with_the_encoder_at_its_own_delay() {
    let swing = Swing::by_hand(0.05);
    let sensor = everything(&swing, &Sensor::upright(0.5));
    let found = aligned(&swing, &sensor, &rig("", "", ""), 1.0, 0.0);
    // Noise-free truth and about four standard errors of each (design note 3.3), at least 2 ms for the coarse search.
    for (channel, delay, tolerance) in [
        ("position.gps", 0.4, 0.02),
        ("velocity.ins", 0.02, 0.002),
        ("attitude.ins", 0.01, 0.002),
        ("angular-rate.imu", 0.003, 0.002),
        ("specific-force.imu", 0.003, 0.002),
        ("magnetic-field.imu", 0.006, 0.002),
        ("height.baro", 0.15, 0.12),
    ] {
        let coarse = found.coarse_delay_s[channel];
        assert!((coarse - delay).abs() < tolerance, "{channel}: {coarse}");
    }
}

/// One channel alone, a second late.
fn alone(name: &str, quantity: Quantity, rate: f64, sigma: f64, rig: &Rig) -> Alignment {
    let swing = Swing::by_hand(0.05);
    let channel = sensed(&swing, &Sensor::upright(0.5), quantity, rate, 1.0, sigma);
    aligned(&swing, &flight_of(vec![(name, channel)]), rig, -1.0, 0.7)
}

#[test]
fn an_accelerometer_a_second_late_gives_sign_and_zero() {
    let found = alone("specific-force.imu", Quantity::SpecificForce, 100.0, 0.05, &rig("", "", ""));
    assert_eq!(found.sign, -1.0);
    zero_is(&found, 0.7);
    assert!(found.azimuth_rad.is_none() && found.azimuth_source.contains("unknown"));
    assert!(found.sign_source.contains("specific-force.imu") && found.zero_source.contains("specific-force.imu"));
}

#[test]
fn an_attitude_a_second_late_gives_sign_zero_and_a_rough_azimuth() {
    let found = alone("attitude.ins", Quantity::Attitude, 50.0, 0.005, &rig("", "", ""));
    assert_eq!(found.sign, -1.0);
    zero_is(&found, 0.7);
    let azimuth = found.azimuth_rad.unwrap();
    assert!(turn(azimuth.value, 0.5).abs() < 0.01 && azimuth.standard_uncertainty.unwrap() > 0.05);
}

#[test]
fn velocity_and_position_give_zero_and_azimuth_once_the_sign_is_known() {
    let rig = rig("", "sign = -1", "");
    for (name, quantity, rate, sigma) in [
        ("velocity.ins", Quantity::VelocityNed, 100.0, 0.05),
        ("position.ins", Quantity::PositionNed, 100.0, 0.02),
        ("position.gps", Quantity::PositionGeodetic, 10.0, 0.02),
    ] {
        let found = alone(name, quantity, rate, sigma, &rig);
        zero_is(&found, 0.7);
        azimuth_is(&found, 0.5);
        assert_eq!(found.sign_source, "rig file");
    }
}

#[test]
fn a_magnetometer_alone_shows_neither_and_assumptions_are_reported() {
    let found = alone("magnetic-field.imu", Quantity::MagneticField, 50.0, 2e-7, &rig("", "", ""));
    assert_eq!(codes(&found), ["assumption", "assumption"]);
    assert!(found.zero_rad.standard_uncertainty.unwrap() > 0.1);
    assert!(found.zero_source.starts_with("assumed"), "{}", found.zero_source);
}

#[test]
fn a_hanging_lever_arm_and_an_upside_down_sensor_are_handled() {
    // Hanging, sensor upright.
    let swing = Swing::by_hand(0.05);
    let below = Sensor { arm: [0.0, 0.0, LENGTH], ..Sensor::upright(0.5) };
    let found = aligned(&swing, &everything(&swing, &below), &rig("mount = \"hanging\"", "", ""), -1.0, 0.3);
    zero_is(&found, 0.3);
    azimuth_is(&found, 0.5);
    // Hanging with Park & Lee's mounting: the bar swings about 180°.
    let hanging = Swing::by_hand(PI);
    let found = aligned(&hanging, &everything(&hanging, &Sensor::upright(0.5)), &rig("", "", ""), 1.0, PI - 0.2);
    zero_is(&found, PI - 0.2);
    azimuth_is(&found, 0.5);
}

#[test]
fn rig_values_are_used_and_a_contradiction_is_reported() {
    let swing = Swing::by_hand(0.05);
    let sensor = everything(&swing, &Sensor::upright(0.5));
    let stated = rig("azimuth_deg = 30.0", "sign = 1\nzero_deg = 10.0", "");
    let found = aligned(&swing, &sensor, &stated, -1.0, 10f64.to_radians());
    assert_eq!((found.sign, found.sign_source.as_str()), (1.0, "rig file"));
    assert_eq!(codes(&found), ["rig-contradicted"]);
    assert!((found.zero_rad.value - 10f64.to_radians()).abs() < 1e-12);
    assert_eq!(found.zero_rad.standard_uncertainty, None);
    assert_eq!(found.azimuth_source, "rig file");
}

#[test]
fn a_bar_hanging_at_rest_gives_the_zero_if_no_sensor_does() {
    // 8 s of rest before the swing.
    let swing = Swing::by_hand(0.0);
    let counts: Vec<f64> = (0..3200)
        .map(|k| {
            let t = f64::from(k) * 0.01 - 8.0;
            let ramp = (t / 2.0).clamp(0.0, 1.0);
            let angle = ramp * ramp * (3.0 - 2.0 * ramp) * (swing.at(t).angle);
            (-(angle - 0.4) / TAU * 2000.0).round()
        })
        .collect();
    let t: Vec<f64> = (0..3200).map(|k| f64::from(k) * 0.01).collect();
    let rig = rig("mount = \"hanging\"", "sign = -1", "");
    let raw = motion(&crate::support::channel(Quantity::EncoderCount, &t, vec![counts]), &rig);
    let (around, _) = Surroundings::of(&rig, None, None);
    let found = align(&raw, &Flight::default(), &rig, &around);
    assert_eq!(found.zero_source, "from the bar hanging at rest");
    zero_is(&found, 0.4);
}

/// A single sine repeats, mirrored, after every half period (0.91 s): both fit, and the smaller delay is taken.
#[test]
fn a_single_frequency_swing_is_not_confused_with_its_mirror_image() {
    for amplitude in [0.7, 0.1] {
        let swing = Swing { middle: 0.03, sines: vec![(amplitude, 0.55, 0.2)], duration: 40.0 };
        for (name, quantity, delay, sigma) in [
            ("attitude.ins", Quantity::Attitude, 0.01, 0.005),
            ("angular-rate.imu", Quantity::AngularRate, 0.003, 0.01),
            ("specific-force.imu", Quantity::SpecificForce, 0.2, 0.05),
        ] {
            let channel = sensed(&swing, &Sensor::upright(0.5), quantity, 100.0, delay, sigma);
            let found = aligned(&swing, &flight_of(vec![(name, channel)]), &rig("", "", ""), -1.0, 0.4);
            assert_eq!(found.sign, -1.0, "{name}: {}", found.sign_source);
            assert!((found.coarse_delay_s[name] - delay).abs() < 0.002, "{name}: {:?}", found.coarse_delay_s);
        }
    }
}

/// At 6° and one frequency, acceleration and gravity are one signal: the rig's arm is used, and the zero is still
/// right.
#[test]
fn the_zero_is_fitted_even_if_the_lever_arm_cannot_be() {
    let swing = Swing { middle: 0.03, sines: vec![(0.1, 0.55, 0.2)], duration: 40.0 };
    for z in [-LENGTH, LENGTH] {
        let sensor = Sensor { arm: [0.0, 0.0, z], ..Sensor::upright(0.5) };
        let channel = sensed(&swing, &sensor, Quantity::SpecificForce, 100.0, 0.003, 0.05);
        let side = if z > 0.0 { "mount = \"hanging\"" } else { "" };
        let found = aligned(&swing, &flight_of(vec![("specific-force.imu", channel)]), &rig(side, "", ""), -1.0, 0.4);
        zero_is(&found, 0.4);
    }
}

/// Ten seeds; a Gaussian error within its stated standard uncertainty (statistical part: the accelerometer's axes are
/// perfect here) passes 3 σ in all of them with a probability of 97 %, 3.5 σ with 99.5 %.
#[test]
fn the_azimuth_has_an_honest_uncertainty() {
    let swing = Swing::by_hand(0.05);
    let rig = rig("", "sign = 1\nzero_deg = 0.0", "");
    let mut squares = 0.0;
    for seed in 0..10 {
        let sensor = Sensor { seed, ..Sensor::upright(0.5) };
        let channel = sensed(&swing, &sensor, Quantity::VelocityNed, 20.0, 0.1, 0.05);
        let found = aligned(&swing, &flight_of(vec![("velocity.ins", channel)]), &rig, 1.0, 0.0);
        let azimuth = found.azimuth_rad.unwrap();
        squares += (turn(azimuth.value, 0.5) / azimuth.standard_uncertainty.unwrap()).powi(2);
    }
    // χ² of ten degrees of freedom: 2.16 to 25.2 contain 99 %.
    assert!((2.1..25.2).contains(&squares), "{squares}");
}
