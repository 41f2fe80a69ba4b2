//! Hard and soft iron from one azimuth and from several.

use crate::support::{FIELD, Noise, Swing};
use bench_analysis::{BarState, FieldRule, MagneticSwing, Rig, Surroundings, calibrate_magnetometer, magnetic_field};
use nalgebra::{Matrix3, Vector3};
use record::{Estimate, Finding, MagnetometerFinding};

const HARD: [f64; 3] = [12e-6, -7e-6, 20e-6];

#[rustfmt::skip]
fn soft() -> Matrix3<f64> {
    Matrix3::new(
        1.05, 0.02, -0.03,
        0.01, 0.97, 0.04,
       -0.02, 0.03, 1.01,
    )
}

/// An azimuth without error.
fn known(azimuth_rad: f64) -> Estimate {
    Estimate { value: azimuth_rad, standard_uncertainty: Some(0.0) }
}

fn swing(azimuth: f64, soft: Matrix3<f64>, hard: [f64; 3], sigma: f64, seed: u64) -> MagneticSwing {
    let motion = Swing::by_hand(0.1);
    let mut noise = Noise::seeded(seed);
    let mut found = MagneticSwing {
        channel: "magnetic-field.imu".into(),
        azimuth: known(azimuth),
        angle_rad: vec![],
        field: Default::default(),
        is_tesla: true,
    };
    for k in 0..2000 {
        let state = BarState { angle: motion.at(f64::from(k) * 0.02).angle, ..BarState::default() };
        let read = soft * Vector3::from(magnetic_field(&state, azimuth, FIELD).value) + Vector3::from(hard);
        found.angle_rad.push(state.angle);
        for axis in 0..3 {
            found.field[axis].push(read[axis] + noise.gauss(sigma));
        }
    }
    found
}

fn around(with_model: bool) -> Surroundings {
    let text = crate::support::rig("", "", "field = { north_nt = 29579, east_nt = -4122, down_nt = 41280 }");
    let rig: Rig = text;
    assert!(matches!(rig.site.field, FieldRule::Stated(_)));
    let (mut around, _) = Surroundings::of(&rig, None, None);
    if !with_model {
        around.field_t = None;
    }
    around
}

fn calibrated(swings: &[MagneticSwing], with_model: bool) -> MagnetometerFinding {
    calibrate_magnetometer(swings, &around(with_model)).found().unwrap().clone()
}

#[test]
fn one_azimuth_gives_hard_iron_in_the_plane_and_y_is_unknown() {
    let found = calibrated(&[swing(0.5, Matrix3::identity(), HARD, 2e-7, 1)], true);
    assert_eq!((found.kind.as_str(), found.azimuths), ("planar", 1));
    for axis in [0, 2] {
        let e = found.hard_iron[axis].found().unwrap();
        let u = e.standard_uncertainty.unwrap();
        // The offset of one axis is known to a few times 2e-7/√2000, because the arc is shorter than a circle.
        assert!((e.value - HARD[axis]).abs() < 4.0 * u && u < 1e-7, "{axis}: {e:?}");
    }
    assert!(matches!(&found.hard_iron[1], Finding::CannotTell(why) if why.contains("three azimuths")));
    let ratio = found.magnitude_ratio.unwrap();
    assert!((ratio.value - 1.0).abs() < 4.0 * ratio.standard_uncertainty.unwrap(), "{ratio:?}");
    assert!((found.residual_rms / 2e-7 - 1.0).abs() < 0.05, "{}", found.residual_rms);
    for (row, expected) in found.soft_iron.iter().zip([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]) {
        for (s, e) in row.iter().zip(expected) {
            assert!((s - e).abs() < 3e-3, "{:?}", found.soft_iron);
        }
    }
}

/// Ten numbers and the field's direction, known or not.
#[test]
fn four_azimuths_give_full_hard_and_soft_iron_with_or_without_a_model() {
    let swings: Vec<MagneticSwing> =
        [0.2, 1.8, -2.0, -0.9].iter().enumerate().map(|(k, a)| swing(*a, soft(), HARD, 1e-7, 10 + k as u64)).collect();
    for with_model in [true, false] {
        let found = calibrated(&swings, with_model);
        assert_eq!((found.kind.as_str(), found.azimuths), ("full", 4));
        for (hard, truth) in found.hard_iron.iter().zip(HARD) {
            let e = hard.found().unwrap();
            let u = e.standard_uncertainty.unwrap();
            assert!((e.value - truth).abs() < 4.5 * u && u < 2e-7, "{e:?}, true {truth}");
        }
        let scale = soft().determinant().cbrt();
        for row in 0..3 {
            for column in 0..3 {
                let off = found.soft_iron[row][column] - soft()[(row, column)] / scale;
                assert!(off.abs() < 5e-3, "{row} {column}: {off}");
            }
        }
        assert!((found.residual_rms / 1e-7 - 1.0).abs() < 0.05, "{}", found.residual_rms);
        assert_eq!(found.magnitude_ratio.is_some(), with_model);
        if let (Some(ratio), Some(dip)) = (found.magnitude_ratio, found.dip_error_rad) {
            let (u_ratio, u_dip) = (ratio.standard_uncertainty.unwrap(), dip.standard_uncertainty.unwrap());
            assert!((ratio.value - scale).abs() < 4.5 * u_ratio && u_ratio < 5e-3, "{ratio:?}, true {scale}");
            assert!(dip.value.abs() < 4.5 * u_dip && u_dip < 5e-3, "{dip:?}");
        }
    }
}

#[test]
fn two_azimuths_are_not_a_full_fit_and_no_azimuth_is_reported() {
    let two = [swing(0.2, soft(), HARD, 1e-7, 1), swing(1.8, soft(), HARD, 1e-7, 2)];
    let found = calibrated(&two, true);
    assert_eq!((found.kind.as_str(), found.azimuths), ("planar", 2));
    assert!(matches!(calibrate_magnetometer(&[], &around(true)), Finding::CannotTell(_)));
}

#[test]
fn a_sensor_with_a_mirrored_axis_is_rejected_with_a_hint() {
    let mirrored = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, 1.0));
    let swings = [0.2, 1.8, -2.0, -0.9].map(|a| swing(a, mirrored, HARD, 1e-7, 4));
    let Finding::CannotTell(why) = calibrate_magnetometer(&swings, &around(true)) else { panic!() };
    assert!(why.contains("axes"), "{why}");
}
