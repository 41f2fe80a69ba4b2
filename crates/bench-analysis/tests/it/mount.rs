//! Side of the pivot, lever arm, misalignment, scales and biases from the record.

use crate::support::{LENGTH, Sensor, Swing, encoder_channel, everything, motion, rig};
use bench_analysis::{GainAt, Rig, Surroundings, align, flexibility, mount_finding};
use flight::{Flight, Notices, Series};
use record::{Estimate, Finding, MountCheck, MountFinding};
use std::f64::consts::PI;

fn found(swing: &Swing, sensor: &Flight, rig: &Rig) -> (MountFinding, Notices) {
    let raw = motion(&encoder_channel(swing, 100.0, 2000.0, 1.0, 0.3), rig);
    let (around, _) = Surroundings::of(rig, None, None);
    let alignment = align(&raw, sensor, rig, &around);
    mount_finding(rig, &around, &alignment, &[], &[], &Finding::CannotTell("not checked".to_owned()))
}

fn check<'a>(finding: &'a MountFinding, name: &str) -> &'a MountCheck {
    let names: Vec<&str> = finding.checks.iter().map(|c| c.name.as_str()).collect();
    finding.checks.iter().find(|c| c.name == name).unwrap_or_else(|| panic!("{name} is not in {names:?}"))
}

fn value(finding: &MountFinding, name: &str) -> Estimate {
    *check(finding, name).fitted.found().unwrap()
}

/// Within four standard uncertainties, which must not exceed `most`.
fn is(finding: &MountFinding, name: &str, truth: f64, most: f64) {
    let e = value(finding, name);
    let u = e.standard_uncertainty.unwrap();
    assert!((e.value - truth).abs() < 4.0 * u && u < most, "{name}: {} ± {u}, true {truth}", e.value);
}

#[test]
fn upright_hanging_and_upside_down_are_distinguished() {
    let cases = [
        (0.05, -LENGTH, "upright", "upright"),
        (0.05, LENGTH, "hanging", "hanging"),
        (PI + 0.05, -LENGTH, "upright", "hanging, sensor upside down"),
    ];
    for (middle, z, stated, expected) in cases {
        let swing = Swing::by_hand(middle);
        let sensor = everything(&swing, &Sensor { arm: [0.0, 0.0, z], ..Sensor::upright(0.5) });
        let (finding, notices) = found(&swing, &sensor, &rig(&format!("mount = \"{stated}\""), "", ""));
        assert_eq!(finding.detected, Finding::Found(expected.to_owned()));
        assert_eq!(finding.stated, stated);
        assert!(notices.is_empty(), "{notices:?}");
    }
}

#[test]
fn velocity_alone_shows_the_side_and_a_magnetometer_does_not() {
    let swing = Swing::by_hand(0.05);
    let mut sensor = everything(&swing, &Sensor { arm: [0.0, 0.0, LENGTH], ..Sensor::upright(0.5) });
    sensor.channels.remove("specific-force.imu");
    let (finding, _) = found(&swing, &sensor, &rig("mount = \"hanging\"", "", ""));
    assert_eq!(finding.detected, Finding::Found("hanging".to_owned()));
    let (_, notices) = found(&swing, &sensor, &rig("mount = \"upright\"", "", ""));
    let of_side = notices.iter().find(|n| n.place == record::SIDE_OF_PIVOT).unwrap();
    assert_eq!(of_side.text, "the record shows a bar that is hanging, but the rig file says upright");
    sensor.channels.retain(|name, _| name.starts_with("magnetic"));
    let (finding, _) = found(&swing, &sensor, &rig("mount = \"hanging\"", "", ""));
    assert!(matches!(finding.detected, Finding::CannotTell(_)));
}

#[test]
fn a_rig_with_the_sensor_on_the_wrong_side_is_reported() {
    let swing = Swing::by_hand(0.05);
    let sensor = everything(&swing, &Sensor { arm: [0.0, 0.0, LENGTH], ..Sensor::upright(0.5) });
    let (finding, notices) = found(&swing, &sensor, &rig("mount = \"upright\"", "", ""));
    assert_eq!(finding.detected, Finding::Found("hanging".to_owned()));
    assert_eq!(check(&finding, "lever arm z of specific-force.imu").agrees, Some(false));
    let parts: Vec<&str> = notices.iter().filter(|n| n.code == "rig-contradicted").map(|n| n.place.as_str()).collect();
    assert_eq!(parts, ["mount", "side of the pivot"]);
}

/// Former bug: half the counts were a clean card with exit code 0, because a scale was always the sensor's.
#[test]
fn a_wrong_number_of_counts_is_shown_by_gyro_and_attitude() {
    let swing = Swing::by_hand(0.05);
    let sensor = everything(&swing, &Sensor::upright(0.5));
    for stated in [1000.0, 8000.0] {
        let mut rig = rig("", "", "");
        rig.encoder.counts_per_rev = Some(stated);
        let (finding, notices) = found(&swing, &sensor, &rig);
        for name in ["counts per revolution by angular-rate.imu", "counts per revolution by attitude.ins"] {
            assert!(check(&finding, name).contradicts_rig(), "{stated}: {:?}", check(&finding, name));
            is(&finding, name, 2000.0, 20.0);
        }
        let text = &notices.iter().find(|n| n.code == "rig-contradicted").unwrap().text;
        assert!(text.starts_with("record and rig file disagree on counts per revolution"), "{text}");
    }
}

/// Former bug: 2048 for 2000 passed, and the record named the bar's length as the cause.
#[test]
fn counts_that_scale_rotation_and_translation_alike_are_named_and_the_length_is_not() {
    let swing = Swing::by_hand(0.05);
    let mut rig = rig("", "", "");
    rig.encoder.counts_per_rev = Some(2048.0);
    let raw = motion(&encoder_channel(&swing, 100.0, 2000.0, 1.0, 0.3), &rig);
    let (around, _) = Surroundings::of(&rig, None, None);
    let alignment = align(&raw, &everything(&swing, &Sensor::upright(0.5)), &rig, &around);
    let raised = flexibility(&[gain(1.024, 5e-4)], &[gain(1.024, 5e-4)], None);
    let (finding, _) = mount_finding(&rig, &around, &alignment, &[], &[], &raised);
    for name in ["counts per revolution by angular-rate.imu", "counts per revolution by attitude.ins"] {
        assert!(check(&finding, name).contradicts_rig(), "{:?}", check(&finding, name));
    }
    let length = check(&finding, "distance from the axis by velocity.ins");
    assert_eq!(length.agrees, Some(false), "{length:?}");
    assert!(!length.of_rig && length.text.ends_with("the counts per revolution explain it"), "{length:?}");
}

/// The rig file does not state a first mode.
#[test]
fn bending_that_the_gains_show_explains_a_longer_circle() {
    let swing = Swing::by_hand(0.05);
    let sensor = everything(&swing, &Sensor { arm: [0.0, 0.0, -1.03 * LENGTH], ..Sensor::upright(0.5) });
    let rig = rig("", "", "");
    let raw = motion(&encoder_channel(&swing, 100.0, 2000.0, 1.0, 0.3), &rig);
    let (around, _) = Surroundings::of(&rig, None, None);
    let alignment = align(&raw, &sensor, &rig, &around);
    let bending = flexibility(&[gain(1.030, 5e-4)], &[gain(1.043, 5e-4)], None);
    let (finding, notices) = mount_finding(&rig, &around, &alignment, &[], &[], &bending);
    assert_eq!(check(&finding, "distance from the axis by velocity.ins").agrees, None, "{:?}", finding.checks);
    assert!(notices.is_empty(), "{notices:?}");
}

#[test]
fn a_correctly_mounted_sensor_passes_every_check() {
    let swing = Swing::by_hand(0.05);
    let (finding, notices) = found(&swing, &everything(&swing, &Sensor::upright(0.5)), &rig("", "", ""));
    for check in &finding.checks {
        assert_ne!(check.agrees, Some(false), "{check:?}");
    }
    assert!(notices.is_empty(), "{notices:?}");
    // Design note 1.6: sigma_f/(rms(ξ″) √N) = 0.05/(6 √4000) = 0.13 mm.
    is(&finding, "lever arm z of specific-force.imu", -LENGTH, 2e-3);
    is(&finding, "lever arm x of specific-force.imu", 0.0, 2e-3);
    is(&finding, "scale of specific-force.imu", 1.0, 2e-3);
    is(&finding, "scale y of angular-rate.imu", 1.0, 1e-3);
    is(&finding, "distance from the axis by velocity.ins", LENGTH, 5e-3);
}

/// Lever arm off the axis, misalignment about all axes, biases and a scale.
#[test]
fn sensor_errors_are_found_with_their_size() {
    let swing = Swing::by_hand(0.05);
    let (roll, yaw) = (0.03, -0.05);
    let sensor = Sensor { arm: [0.06, 0.0, -1.25], turned: [roll, 0.0, yaw], ..Sensor::upright(0.5) };
    let mut flight = everything(&swing, &sensor);
    let change = |flight: &mut Flight, name: &str, by: &dyn Fn(usize, f64) -> f64| {
        let channel = flight.channels.get_mut(name).unwrap();
        let changed = (channel.series.components().iter().enumerate())
            .map(|(k, c)| c.iter().map(|v| by(k, *v)).collect())
            .collect();
        channel.series = Series::new(channel.series.timeline().clone(), changed).unwrap();
    };
    let bias = [0.2, -0.1, 0.15];
    // Former bug: this scale was taken for a longer lever arm.
    change(&mut flight, "specific-force.imu", &|k, v| 1.01 * v + bias[k]);
    change(&mut flight, "angular-rate.imu", &|k, v| 1.02 * v + [0.01, -0.02, 0.005][k]);
    let (finding, notices) = found(&swing, &flight, &rig("", "", ""));
    // Small angles: second-order terms of 0.03 · 0.05 and cos of each are 2 mrad and 2 ‰.
    let near = |name: &str, truth: f64, tolerance: f64| {
        let e = value(&finding, name);
        assert!((e.value - truth).abs() < tolerance, "{name}: {e:?}, true {truth}");
    };
    near("lever arm x of specific-force.imu", 0.06, 5e-3);
    near("lever arm z of specific-force.imu", -1.25, 5e-3);
    near("misalignment about z of angular-rate.imu", 1.02 * yaw, 3e-3);
    near("misalignment about x of angular-rate.imu", 1.02 * roll, 3e-3);
    near("misalignment about z of specific-force.imu", yaw, 4e-3);
    near("misalignment about x of specific-force.imu", roll, 4e-3);
    near("scale y of angular-rate.imu", 1.02, 3e-3);
    near("scale of specific-force.imu", 1.01, 3e-3);
    near("bias x of angular-rate.imu", 0.01, 1e-3);
    near("bias y of angular-rate.imu", -0.02, 1e-3);
    near("bias x of specific-force.imu", 0.2, 0.03);
    near("bias z of specific-force.imu", 0.15, 0.03);
    let notice = notices.iter().find(|n| n.code == "rig-contradicted").unwrap();
    for name in ["lever arm x", "lever arm z", "misalignment about z"] {
        assert!(notice.text.contains(name), "{}", notice.text);
    }
}

/// A length above the rig's contradicts it, unless bending is known and explains it, or it comes from a barometer.
#[test]
fn a_longer_arm_contradicts_a_stiff_rig_but_not_a_bending_one() {
    let swing = Swing::by_hand(0.05);
    for (longer, bar, contradicts) in
        [(1.0, "", false), (1.03, "", true), (1.03, "first_mode_hz = 5.0", false), (1.12, "first_mode_hz = 5.0", true)]
    {
        let sensor = everything(&swing, &Sensor { arm: [0.0, 0.0, -LENGTH * longer], ..Sensor::upright(0.5) });
        let (finding, _) = found(&swing, &sensor, &rig(bar, "", ""));
        for name in ["lever arm z of specific-force.imu", "distance from the axis by velocity.ins"] {
            let check = check(&finding, name);
            // Bending explains the 3 %.
            let is_excused = longer == 1.03 && !bar.is_empty();
            assert_eq!(check.agrees, Some(longer == 1.0).filter(|_| !is_excused), "{check:?}");
            assert_eq!(check.of_rig && check.agrees == Some(false), contradicts, "{longer} {bar}: {check:?}");
        }
        assert!(finding.checks.iter().all(|c| !c.of_rig || !c.name.contains("height.baro")), "{:?}", finding.checks);
    }
}

fn gain(value: f64, u: f64) -> GainAt {
    gain_at(0.55, value, u)
}

fn gain_at(frequency_hz: f64, value: f64, u: f64) -> GainAt {
    GainAt { gain: Estimate { value, standard_uncertainty: Some(u) }, frequency_hz }
}

#[test]
fn gains_of_a_bending_bar_give_its_first_mode() {
    // 4 Hz bar at 0.55 Hz with a light tip: Γ = 1.06, κ = 1.45.
    let (p, _) = bench_analysis::bending_response(0.55, 4.0, 0.02, 1.06);
    let (r, _) = bench_analysis::bending_response(0.55, 4.0, 0.02, 1.06 * 1.45);
    let found = flexibility(&[gain(p, 4e-4), gain(p, 6e-4)], &[gain(r, 3e-4)], Some(4.0));
    let found = found.found().unwrap();
    let mode = found.first_mode_hz.found().unwrap();
    assert!((mode.value - 4.0).abs() < 2.0 * mode.standard_uncertainty.unwrap(), "{mode:?}");
    assert!(mode.standard_uncertainty.unwrap() < 0.15, "{mode:?}");
    let ratio = found.ratio.found().unwrap();
    assert!((ratio.value - 1.45).abs() < 0.01 && found.text.contains("bends"), "{found:?}");
}

#[test]
fn gains_of_motion_at_different_frequencies_give_the_same_first_mode() {
    let at = |hz: f64, factor: f64| gain_at(hz, bench_analysis::bending_response(hz, 5.0, 0.02, factor).0, 3e-4);
    let found = flexibility(&[at(0.5, 1.031), at(0.7, 1.031)], &[at(0.65, 1.031 * 1.4767)], None);
    let found = found.found().unwrap();
    let mode = found.first_mode_hz.found().unwrap();
    assert!((mode.value - 5.0).abs() < 2.0 * mode.standard_uncertainty.unwrap(), "{mode:?}");
    let ratio = found.ratio.found().unwrap();
    assert!((ratio.value - 1.4767).abs() < 0.02, "{ratio:?}");
}

#[test]
fn a_scale_error_is_not_mistaken_for_bending() {
    let found = flexibility(&[gain(1.02, 5e-4)], &[gain(1.02, 5e-4)], None);
    let found = found.found().unwrap();
    assert!(found.text.contains("scale"), "{}", found.text);
    assert!(matches!(found.first_mode_hz, Finding::CannotTell(_)));
}

#[test]
fn a_stiff_bar_states_which_frequencies_it_excludes() {
    let found = flexibility(&[gain(1.0002, 5e-4)], &[gain(0.9998, 3e-4)], None);
    let found = found.found().unwrap();
    assert!(matches!(&found.ratio, Finding::CannotTell(_)));
    // Three standard uncertainties of 3e-4 against κΓ (0.55/f)²: f = 0.55 √(1.54/9e-4) = 22.7 Hz.
    let Finding::CannotTell(why) = &found.first_mode_hz else { panic!("{found:?}") };
    assert!(why.contains("22.7 Hz") || why.contains("22.8 Hz"), "{why}");
    assert!(matches!(flexibility(&[], &[gain(1.0, 1e-3)], None), Finding::CannotTell(_)));
}
