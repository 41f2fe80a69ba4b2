//! References equal the truth at each sensor's place, and report what the swing cannot show.

use crate::support::{FIELD, LENGTH, Sensor, Swing, encoder_channel, everything, flight_of, motion, rig, sensed};
use bench_analysis::{
    ChannelReference, Motion, References, Rig, Surroundings, align, angular_rate, magnetic_field, position,
    specific_force, velocity,
};
use flight::{Flight, Quantity};
use signal::{DelaySettings, Gain, Measurement, Reference, Sign, fit_delay};

fn references(swing: &Swing, sensor: &Flight, rig: &Rig) -> (References, Motion) {
    let raw = motion(&encoder_channel(swing, 100.0, 2000.0, -1.0, 0.4), rig);
    let (around, _) = Surroundings::of(rig, None, None);
    let alignment = align(&raw, sensor, rig, &around);
    let motion = raw.oriented(alignment.sign, alignment.zero_rad.value);
    (References::of(sensor, &motion, rig, &around, &alignment), motion)
}

fn of<'a>(references: &'a References, name: &str) -> &'a ChannelReference {
    references.channels.iter().find(|c| c.name == name).unwrap()
}

/// Worst deviation of a component from the truth, excluding one second at the ends.
fn worst(channel: &ChannelReference, component: usize, swing: &Swing, truth: &dyn Fn(f64) -> f64) -> f64 {
    let reference = &channel.components[component].reference;
    (0..1000)
        .map(|k| 1.0 + (swing.duration - 2.0) * f64::from(k) / 1000.0)
        .map(|t| (reference.value_and_rate(t).0 - truth(t)).abs())
        .fold(0.0, f64::max)
}

const AZIMUTH: f64 = 0.5;
const ARM: [f64; 3] = [0.0, 0.0, -LENGTH];

/// The field of a `wmm` rig would be the model's; the stated one is that of the simulation.
fn stated_rig() -> Rig {
    let field = "field = { north_nt = 29579, east_nt = -4122, down_nt = 41280 }";
    rig("azimuth_deg = 28.64788975654116", "sign = -1\nzero_deg = 22.918311805232928", field)
}

#[test]
fn every_reference_equals_the_truth_within_encoder_accuracy() {
    let swing = Swing::by_hand(0.05);
    let (found, _) = references(&swing, &everything(&swing, &Sensor::upright(AZIMUTH)), &stated_rig());
    assert!(found.notices.is_empty());
    type Truth<'a> = &'a dyn Fn(f64, usize) -> f64;
    let state = |t| swing.at(t);
    // Smoothed encoder at 2000 counts, 100 Hz: 0.25 mrad, 4 mrad/s, 0.07 rad/s² rms; peaks of about five times that,
    // at 1.3 m.
    let cases: [(&str, f64, Truth); 6] = [
        ("position.gps", 2e-3, &|t, k| position(&state(t), AZIMUTH, ARM).value[k]),
        ("velocity.ins", 2.5e-2, &|t, k| velocity(&state(t), AZIMUTH, ARM).value[k]),
        ("attitude.ins", 1.5e-3, &|t, _| state(t).angle),
        ("angular-rate.imu", 2e-2, &|t, k| angular_rate(&state(t), AZIMUTH, None).value[k]),
        ("specific-force.imu", 0.5, &|t, k| specific_force(&state(t), ARM, crate::support::GRAVITY).value[k]),
        ("magnetic-field.imu", 6e-8, &|t, k| magnetic_field(&state(t), AZIMUTH, FIELD).value[k]),
    ];
    for (name, tolerance, truth) in cases {
        let channel = of(&found, name);
        for component in 0..channel.components.len() {
            let off = worst(channel, component, &swing, &|t| truth(t, component));
            let claimed = channel.components[component].uncertainty;
            assert!(off < tolerance, "{name} {component}: {off}");
            assert!(off < 8.0 * claimed + 1e-12, "{name} {component}: {off}, claimed {claimed}");
        }
    }
    let height = of(&found, "height.baro");
    assert!(worst(height, 0, &swing, &|t| -position(&state(t), AZIMUTH, ARM).value[2]) < 2e-3);
}

#[test]
fn measured_values_are_in_si_with_all_their_timestamps() {
    let swing = Swing::by_hand(0.05);
    let sensor = everything(&swing, &Sensor::upright(AZIMUTH));
    let (found, _) = references(&swing, &sensor, &stated_rig());
    for channel in &found.channels {
        assert_eq!(channel.t_s.len(), sensor.channels[&channel.name].series.len());
        for component in &channel.components {
            assert_eq!(component.measured.len(), channel.t_s.len());
        }
    }
    let position = of(&found, "position.gps");
    let names: Vec<&str> = position.components.iter().map(|c| c.name.as_str()).collect();
    assert_eq!(names, ["north", "east", "down"]);
    assert_eq!(position.components[0].unit, "m");
    assert_eq!(position.components[0].measured[0], 0.0);
    assert!(position.components.iter().all(|c| c.drift));
    let angle = &of(&found, "attitude.ins").components[0];
    assert_eq!((angle.name.as_str(), angle.unit.as_str(), angle.drift), ("swing angle", "rad", false));
}

#[test]
fn unexcited_components_are_named_with_the_reason() {
    let swing = Swing::by_hand(0.05);
    let (found, _) = references(&swing, &everything(&swing, &Sensor::upright(0.0)), &rig("", "", ""));
    let excited = |name: &str| -> Vec<bool> { of(&found, name).components.iter().map(|c| c.excited.is_ok()).collect() };
    // At azimuth 0 nothing moves east.
    assert_eq!(excited("velocity.ins"), [true, false, true]);
    assert_eq!(excited("angular-rate.imu"), [false, true, false]);
    assert_eq!(excited("specific-force.imu"), [true, false, true]);
    assert_eq!(excited("magnetic-field.imu"), [true, false, true]);
    assert_eq!(excited("attitude.ins"), [true]);
    let why = of(&found, "angular-rate.imu").components[0].excited.clone().unwrap_err();
    assert!(why.contains("does not move it"), "{why}");
}

/// A free point-mass pendulum below its pivot: `L ξ″ = −g sin ξ`, so `f_X = r_z ξ″ + g sin ξ = 0`.
#[test]
fn the_tangential_axis_of_a_free_pendulum_is_reported_as_unexcited() {
    let small = (0.05f64, (crate::support::GRAVITY / LENGTH).sqrt() / std::f64::consts::TAU, 0.0);
    let swing = Swing { middle: 0.0, sines: vec![small], duration: 40.0 };
    let sensor = Sensor { arm: [0.0, 0.0, LENGTH], ..Sensor::upright(0.5) };
    let channel = sensed(&swing, &sensor, Quantity::SpecificForce, 100.0, 0.0, 0.02);
    let rig = rig("mount = \"hanging\"\nazimuth_deg = 0.0", "sign = -1\nzero_deg = 22.918311805232928", "");
    let (found, _) = references(&swing, &flight_of(vec![("specific-force.imu", channel)]), &rig);
    let x = &of(&found, "specific-force.imu").components[0];
    let why = x.excited.clone().unwrap_err();
    assert!(why.contains("pendulum") || why.contains("reference is uncertain"), "{why}");
}

#[test]
fn a_fitted_field_follows_a_magnetometer_with_iron_at_gain_one() {
    let swing = Swing::by_hand(0.05);
    let mut channel = sensed(&swing, &Sensor::upright(AZIMUTH), Quantity::MagneticField, 100.0, 0.3, 1e-7);
    // Hard iron of 20 µT and a scale of 0.8 on x.
    let timeline = channel.series.timeline().clone();
    let iron: Vec<Vec<f64>> = channel
        .series
        .components()
        .iter()
        .enumerate()
        .map(|(k, c)| c.iter().map(|v| if k == 0 { 0.8 * v + 20e-6 } else { *v }).collect())
        .collect();
    channel.series = flight::Series::new(timeline, iron).unwrap();
    let (found, _) = references(&swing, &flight_of(vec![("magnetic-field.imu", channel)]), &stated_rig_with_fit());
    let x = &of(&found, "magnetic-field.imu").components[0];
    assert!(x.unit_gain && x.excited.is_ok());
    let off = worst(of(&found, "magnetic-field.imu"), 0, &swing, &|t| {
        0.8 * magnetic_field(&swing.at(t), AZIMUTH, FIELD).value[0] + 20e-6
    });
    // 1e-7 T of noise in 4000 rows: a few nT, and 0.25 mrad of 50 µT is 12 nT.
    assert!(off < 1e-7, "{off}");
}

/// The noise contained in the fitted reference does not bias the delay: it equals that of the true field.
#[test]
fn a_fitted_field_gives_the_same_delay_as_the_true_field() {
    let swing = Swing::by_hand(0.05);
    let channel = sensed(&swing, &Sensor::upright(AZIMUTH), Quantity::MagneticField, 100.0, 0.012, 2e-7);
    let flight = flight_of(vec![("magnetic-field.imu", channel)]);
    let delay = |rig: &Rig| {
        let (found, _) = references(&swing, &flight, rig);
        let channel = &found.channels[0];
        let excited = channel.components.iter().filter(|c| c.excited.is_ok());
        let measurements: Vec<Measurement> = excited
            .map(|c| Measurement {
                t: &channel.t_s,
                y: &c.measured,
                reference: &c.reference,
                gain: Gain::Free { sign: Sign::Positive },
                drift: false,
            })
            .collect();
        fit_delay(&measurements, &DelaySettings::default()).unwrap()
    };
    let (fitted, stated) = (delay(&stated_rig_with_fit()), delay(&stated_rig()));
    let u = stated.standard_uncertainty_s;
    assert!((fitted.delay_s - stated.delay_s).abs() < 0.2 * u, "{} {} ± {u}", fitted.delay_s, stated.delay_s);
    assert!((stated.delay_s - 0.012).abs() < 4.0 * u && u < 1e-4, "{} ± {u}", stated.delay_s);
}

fn stated_rig_with_fit() -> Rig {
    rig("azimuth_deg = 28.64788975654116", "sign = -1\nzero_deg = 22.918311805232928", "field = \"fit\"")
}

#[test]
fn without_an_azimuth_only_the_vertical_is_compared() {
    let swing = Swing::by_hand(0.05);
    // One component of three: the log has no north and east.
    let mut channel = sensed(&swing, &Sensor::upright(0.5), Quantity::VelocityNed, 50.0, 0.1, 0.05);
    channel.present = vec![false, false, true];
    let (sensor, rig) = (flight_of(vec![("velocity.gps", channel)]), rig("", "sign = -1", ""));
    let (found, motion) = references(&swing, &sensor, &rig);
    let (around, _) = Surroundings::of(&rig, None, None);
    let said = align(&motion, &sensor, &rig, &around).notices;
    assert!(said.iter().any(|n| n.code == "no-reference" && n.text.contains("azimuth")), "{said:?}");
    let velocity = of(&found, "velocity.gps");
    assert_eq!(velocity.components.iter().map(|c| c.name.as_str()).collect::<Vec<_>>(), ["down"]);
}

#[test]
fn a_rotated_mount_is_rotated_back_before_comparison() {
    let swing = Swing::by_hand(0.05);
    let straight = everything(&swing, &Sensor::upright(AZIMUTH));
    let turned =
        everything(&swing, &Sensor { turned: [0.0, 0.0, std::f64::consts::FRAC_PI_2], ..Sensor::upright(AZIMUTH) });
    // The sensor's x is the body's y, its y the body's −x.
    let mount = "[[mount]]\nchannels = [\"*\"]\naxes = [\"-y\", \"x\", \"z\"]";
    let (plain, _) = references(&swing, &straight, &rig("", "", ""));
    let (back, _) = references(&swing, &turned, &rig("", "", mount));
    for name in ["specific-force.imu", "angular-rate.imu"] {
        for k in 0..3 {
            let (a, b) = (&of(&plain, name).components[k].measured, &of(&back, name).components[k].measured);
            // The signals are equal; the noise differs by axis.
            let rms = (a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / a.len() as f64).sqrt();
            let sigma = if name.starts_with("spec") { 0.05 } else { 0.01 };
            assert!(rms < 1.5 * sigma, "{name} {k}: {rms}");
        }
    }
}
