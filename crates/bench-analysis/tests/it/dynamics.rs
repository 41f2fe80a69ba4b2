//! Results of whole records for their channels.

use crate::golden::bench;
use bench_analysis::{BenchInput, Rig};
use flight::{Flight, Quantity, Series, Timeline};
use rayon::prelude::*;
use record::{BenchFindings, ChannelDynamics, DelayFinding, Estimate};
use simulate::{BenchChannel, BenchSensor, BenchSettings, FlexibleBar, RigText, SimulatedBench, simulate_bench};
use std::path::Path;

/// One gyro on the paper's bench.
fn gyro(settings: BenchSettings, sensor: BenchSensor) -> ChannelDynamics {
    alone(BenchChannel::AngularRate, settings, sensor)
}

/// One channel on the paper's bench.
fn alone(channel: BenchChannel, settings: BenchSettings, sensor: BenchSensor) -> ChannelDynamics {
    let settings = settings.only(&[channel]).with(channel, sensor);
    measured(&settings).channels.into_iter().next().unwrap()
}

fn measured(settings: &BenchSettings) -> BenchFindings {
    let simulated = simulate_bench(settings).unwrap();
    measured_of(&simulated.to_flight().unwrap(), &simulated)
}

fn measured_of(flight: &Flight, simulated: &SimulatedBench) -> BenchFindings {
    let what = RigText { model: "M".into(), serial: "1".into(), to_be_fitted: false };
    let mut rig = Rig::parse(&simulated.rig_text(&what), Path::new("simulated.rig.toml")).unwrap();
    rig.analysis.inject_s = vec![];
    bench(&BenchInput { encoder: flight, sensor: flight, one_log: true }, &rig).unwrap().findings
}

/// Former bug: the dead half was a bar at rest, and the record named a wrong number of counts as the cause.
#[test]
fn an_encoder_that_freezes_while_the_sensor_moves_is_used_without_that_part() {
    const DEAD_S: f64 = 45.0;
    let settings = BenchSettings { seed: 5, ..BenchSettings::default() }
        .only(&[BenchChannel::AngularRate])
        .with(BenchChannel::VelocityIns, BenchSensor::noisy(100.0, 0.05).late(0.030));
    let simulated = simulate_bench(&settings).unwrap();
    let mut flight = simulated.to_flight().unwrap();
    let encoder = flight.channels.get_mut("encoder.bar").unwrap();
    let timeline = encoder.series.timeline().clone();
    let t = timeline.seconds_since(timeline.first().unwrap());
    let mut last = 0.0;
    let count = |(t, count): (&f64, &f64)| {
        last = if *t >= DEAD_S { last } else { *count };
        last
    };
    let frozen: Vec<f64> = t.iter().zip(encoder.series.component(0)).map(count).collect();
    let at = t.iter().position(|t| *t >= DEAD_S).unwrap();
    let last_change = (0..at).rfind(|&row| frozen[row] != frozen[at]).unwrap();
    encoder.series = Series::new(timeline, vec![frozen]).unwrap();
    let found = measured_of(&flight, &simulated);
    // The first reading of the constant part is real.
    assert_eq!(found.reference.samples as usize, last_change + 2);
    let check = found.gate.checks.iter().find(|c| c.name == "encoder alive").unwrap();
    assert!(!check.passed && check.text.contains("while angular-rate.imu moves"), "{check:?}");
    let velocity = found.channels.iter().find(|c| c.quantity == Quantity::VelocityNed).unwrap();
    let delay = velocity.delay.as_ref().unwrap();
    let (delay_s, u) = (delay.delay.seconds(), delay.standard_uncertainty_s);
    assert!((delay_s - 0.030).abs() < 3.0 * u && u < 2e-3, "{delay_s} ± {u}");
    assert!(found.mount.checks.iter().all(|c| c.agrees != Some(false)), "{:?}", found.mount.checks);
}

/// Former bug: updates during the gap were not counted, and their rows had the age of the last update before: 60 ms more
/// for 3 s of 80.
#[test]
fn a_gap_of_the_encoder_does_not_make_the_held_value_older() {
    let settings = BenchSettings { seed: 6, ..BenchSettings::default() }
        .only(&[BenchChannel::AngularRate, BenchChannel::PositionGps]);
    let simulated = simulate_bench(&settings).unwrap();
    let mut flight = simulated.to_flight().unwrap();
    let encoder = flight.channels.get_mut("encoder.bar").unwrap();
    let timeline = encoder.series.timeline().clone();
    let t = timeline.seconds_since(timeline.first().unwrap());
    let rows: Vec<usize> = (0..t.len()).filter(|&row| !(33.0..36.0).contains(&t[row])).collect();
    let stamps = rows.iter().map(|&row| timeline.stamps()[row]).collect();
    let counts = rows.iter().map(|&row| encoder.series.component(0)[row]).collect();
    let timeline = Timeline::new(timeline.kind(), timeline.clock(), stamps).unwrap();
    encoder.series = Series::new(timeline, vec![counts]).unwrap();
    encoder.held = vec![false; rows.len()];
    let found = measured_of(&flight, &simulated);
    let position = found.channels.iter().find(|c| c.name == "position.gps").unwrap();
    let delay = position.delay.as_ref().unwrap();
    let age_s = delay.as_seen_s.unwrap().value - delay.delay.seconds();
    // 4 Hz in rows of 100 Hz: ages of 0 to 240 ms.
    assert!((age_s - 0.120).abs() < 1e-3, "{age_s}");
}

/// Former bug: 4.3 ± 0.3 Hz for a true 5 Hz, because every gain was taken at the rms frequency of the bar's angle.
#[test]
fn a_bending_bar_has_its_first_mode_and_the_ratio_of_a_cantilever() {
    for (frequency_hz, seed) in [(4.0, 1), (6.0, 2)] {
        let mut settings = BenchSettings { seed, ..BenchSettings::default() }.only(&[
            BenchChannel::VelocityIns,
            BenchChannel::Attitude,
            BenchChannel::AngularRate,
        ]);
        settings.bar.flexible =
            Some(FlexibleBar { frequency_hz, damping: 0.02, participation: 1.031, slope_ratio: 1.4767 });
        let found = measured(&settings).flexibility;
        let bar = found.found().unwrap();
        let (mode, ratio) = (*bar.first_mode_hz.found().unwrap(), *bar.ratio.found().unwrap());
        assert!(mode.standard_uncertainty.unwrap() < 0.05 * frequency_hz, "{}", bar.text);
        // One of the four intervals of 99 % misses in 4 of 100 such tests.
        for (e, truth) in [(mode, frequency_hz), (ratio, 1.4767)] {
            assert!((e.value - truth).abs() <= 2.6 * e.standard_uncertainty.unwrap(), "{e:?}: {}", bar.text);
        }
    }
}

/// A gyro that is 2 ms late, against an encoder of few counts: the reported delay and lag.
fn pure_delay(seed: u64) -> (Option<String>, bool) {
    let mut settings = BenchSettings { seed, ..BenchSettings::default() };
    settings.encoder.lines = 500;
    let found = gyro(settings, BenchSensor::noisy(100.0, 0.01).late(0.002));
    let model = found.model.found().unwrap();
    let negative = model.candidates.iter().any(|c| c.delay_s.is_some_and(|d| d.value < 0.0) && !c.lags_s.is_empty());
    (model.chosen.clone(), negative)
}

fn wrong_of(trials: u64) -> usize {
    let answers: Vec<(Option<String>, bool)> = (0..trials).into_par_iter().map(pure_delay).collect();
    answers.iter().filter(|(chosen, negative)| *negative || !matches!(chosen.as_deref(), None | Some("D"))).count()
}

/// Former bug: "−12 ms and a lag of 14 ms" was the best model of 7 in 40, because a reference of few counts has too
/// much high-frequency content and `e^{sT}/(1 + sT)` is a low pass. Under the old rule, 24 of 24 correct happens once
/// in 100 runs.
#[test]
fn a_pure_delay_is_not_reported_as_negative_delay_and_lag() {
    assert_eq!(wrong_of(24), 0);
}

#[test]
#[ignore = "40 s: cargo test -p flightlag-bench-analysis --test it -- --ignored of_200_gyros"]
fn of_200_gyros_with_a_pure_delay_at_most_one_in_a_hundred_is_wrong() {
    let wrong = wrong_of(200);
    assert!(wrong <= 2, "{wrong} of 200");
}

/// If the timestamps of a sensor overcompensate its lag, the data require a negative delay, and it is reported.
#[test]
fn a_negative_delay_with_a_lag_is_found_if_the_data_require_it() {
    let mut settings = BenchSettings { seed: 3, ..BenchSettings::default() };
    settings.encoder.lines = 8000;
    let sensor = BenchSensor { lags_s: vec![0.06], ..BenchSensor::noisy(100.0, 0.003).late(-0.04) };
    let found = gyro(settings, sensor);
    let model = found.model.found().unwrap();
    let best = &model.candidates[0];
    let excess = |name: &str| model.candidates.iter().find(|c| c.name == name).unwrap().delta_bic;
    assert!(best.name == "DL" && excess("D") > 1000.0 && excess("L") > 1000.0, "{model:?}");
    let near = |found: Estimate, truth: f64| (found.value - truth).abs() < 0.003;
    assert!(near(best.delay_s.unwrap(), -0.04) && near(best.lags_s[0], 0.06), "{best:?}");
    assert!(near(model.sum_s, 0.02), "{model:?}");
}

/// A channel that is 30 ms late, at an azimuth that moves north and east alike, against an encoder of few counts.
fn late_by_30_ms(channel: BenchChannel, lines: u32, noise: f64, seed: u64) -> DelayFinding {
    let mut settings = BenchSettings { seed, swing_s: 40.0, rest_s: [2.0, 2.0], ..BenchSettings::default() };
    settings.encoder.lines = lines;
    settings.bar.azimuth_rad = 0.7;
    alone(channel, settings, BenchSensor::noisy(100.0, noise).late(0.03)).delay.unwrap()
}

/// With a position error of a tenth of a millimetre only the encoder's steps remain: their effect on the delay must be
/// as large as stated. North, east and down share the error, so the fit alone understates its uncertainty.
#[test]
fn the_encoders_steps_move_the_delay_by_as_much_as_stated() {
    let trials = 16;
    let found: Vec<DelayFinding> =
        (0..trials).into_par_iter().map(|seed| late_by_30_ms(BenchChannel::PositionIns, 500, 1e-4, seed)).collect();
    let rms =
        |of: &dyn Fn(&DelayFinding) -> f64| (found.iter().map(|d| (of(d)).powi(2)).sum::<f64>() / trials as f64).sqrt();
    // Sixteen records know an rms to 18 %, and each states it to 18 %: three standard deviations.
    let ratio = rms(&|d| (d.delay.seconds() - 0.03) / d.reference_s);
    assert!((0.45..1.55).contains(&ratio), "{ratio}");
    assert!(found.iter().all(|d| d.standard_uncertainty_s >= d.reference_s), "{found:?}");
    let of_the_fit = rms(&|d| d.hessian_s.max(d.hac_s) / d.standard_uncertainty_s);
    assert!(of_the_fit < 0.9, "the reference must widen it: {of_the_fit}");
}

/// Coverage of 60 records each, before and with the reference's own uncertainty: position against 250 counts 91.7 and
/// 95.0 %, against 1000 counts 85.0 and 95.0 %, specific force against 250 counts 93.3 and 96.7 %; velocity and gyro 98
/// % or more.
#[test]
#[ignore = "5 min: cargo test -p flightlag-bench-analysis --test it -- --ignored intervals_cover_the_truth_against_a_coarse_encoder"]
fn intervals_cover_the_truth_against_a_coarse_encoder() {
    use BenchChannel::{AngularRate, PositionIns, SpecificForce, VelocityIns};
    let trials = 150;
    for (channel, noise) in [(PositionIns, 0.002), (VelocityIns, 0.002), (SpecificForce, 0.02), (AngularRate, 0.002)] {
        for lines in [250, 1000] {
            let inside = |seed: u64| {
                let [low, high] = late_by_30_ms(channel, lines, noise, seed).interval_95_s;
                (low..=high).contains(&0.03)
            };
            let held = (0..trials).into_par_iter().map(inside).filter(|held| *held).count();
            println!("{channel:?}, {lines} lines: {held} of {trials}");
            // 93 % minus two standard deviations of 150 trials.
            assert!(held >= 133, "{channel:?}, {lines} lines: {held} of {trials}");
        }
    }
}

/// Former bug: a lag of 300 ms was reported as "204 ms late", the pure delay that fits this swing.
#[test]
fn a_lag_is_reported_with_its_own_numbers_first() {
    let mut settings = BenchSettings { seed: 5, ..BenchSettings::default() };
    settings.bar.azimuth_rad = 0.7;
    let sensor = BenchSensor { lags_s: vec![0.3], ..BenchSensor::noisy(50.0, 0.01) };
    let found = alone(BenchChannel::VelocityIns, settings, sensor);
    assert_eq!(found.model.found().unwrap().chosen.as_deref(), Some("L"), "{}", found.reason);
    let said = found.reason.strip_prefix("a first-order lag of ").unwrap();
    let value: f64 = said.split(' ').next().unwrap().parse().unwrap();
    assert!((value - 300.0).abs() < 5.0 && said.contains("fits this swing best"), "{}", found.reason);
}

/// A barometer with a lag, in wander as large as its signal: a small gain alone does not indicate a delay outside the
/// search.
#[test]
fn a_slow_barometer_in_wander_keeps_its_number() {
    for seed in 0..4 {
        let settings = BenchSettings { seed, ..BenchSettings::default() };
        let sensor = BenchSensor { lags_s: vec![0.15], ..BenchSensor::noisy(25.0, 0.1).wandering(0.4, 20.0) };
        let found = alone(BenchChannel::Height, settings, sensor);
        assert!(found.delay.is_some(), "{}", found.reason);
    }
}

/// The chosen model of a magnetometer in an unknown field, and the errors of its delay and lag over their U (k = 1).
fn of_a_magnetometer(delay_s: f64, lag_s: f64, seed: u64) -> (Option<String>, [f64; 2]) {
    let lags_s = if lag_s > 0.0 { vec![lag_s] } else { vec![] };
    let soft_iron = Some([[0.9, 0.05, 0.0], [0.05, 1.1, 0.02], [0.0, 0.02, 1.0]]);
    let sensor = BenchSensor { lags_s, soft_iron, ..BenchSensor::noisy(100.0, 2e-7) }.late(delay_s);
    let found = alone(BenchChannel::MagneticField, BenchSettings { seed, ..BenchSettings::default() }, sensor);
    let model = found.model.found().unwrap();
    let best = &model.candidates[0];
    let error =
        |e: Option<Estimate>, truth: f64| e.map_or(0.0, |e| (e.value - truth) / e.standard_uncertainty.unwrap());
    (model.chosen.clone(), [error(best.delay_s, delay_s), error(best.lags_s.first().copied(), lag_s)])
}

/// Former bug: field, iron and mount were fitted without the lag, so a lag of 200 ms came out 2 to 7 ms too short, and one
/// of 400 ms was "no sensor".
#[test]
fn the_lag_of_a_magnetometer_in_an_unknown_field_is_within_its_uncertainty() {
    for (right, delay_s, lag_s) in [("D", 0.1, 0.0), ("DL", 0.03, 0.1), ("L", 0.0, 0.2), ("L", 0.0, 0.4)] {
        let found: Vec<_> = (0..4).into_par_iter().map(|seed| of_a_magnetometer(delay_s, lag_s, seed)).collect();
        for (chosen, errors) in found {
            assert_eq!(chosen.as_deref(), Some(right), "{delay_s} s and {lag_s} s");
            // One of 24 normal errors is outside of 4.1 once in 1000 runs.
            assert!(errors.iter().all(|z| z.abs() < 4.1), "{right}: {errors:?}");
        }
    }
}

/// Former bug: the U of a lag was that of the fit, without the reference: up to six of ten records were outside.
#[test]
fn a_lag_is_within_its_uncertainty_with_that_of_the_reference() {
    use BenchChannel::{AngularRate, Attitude, SpecificForce, VelocityIns};
    const LAG_S: f64 = 0.1;
    let cases = [(VelocityIns, 0.02), (Attitude, 1e-3), (AngularRate, 5e-3), (SpecificForce, 0.05)];
    let error = |(channel, noise): (BenchChannel, f64), seed: u64| {
        let sensor = BenchSensor { lags_s: vec![LAG_S], ..BenchSensor::noisy(100.0, noise) };
        let found = alone(channel, BenchSettings { seed, ..BenchSettings::default() }, sensor);
        let slow = found.model.found().unwrap().sum_s;
        (slow.value - LAG_S) / slow.standard_uncertainty.unwrap()
    };
    let errors: Vec<f64> = (0..16).into_par_iter().map(|k| error(cases[k % 4], k as u64)).collect();
    // Of 16 normal errors, more than four are outside of k = 2 once in 1000 runs.
    let outside = errors.iter().filter(|z| z.abs() > 2.0).count();
    assert!(outside <= 4 && errors.iter().all(|z| z.abs() < 4.0), "{outside} outside: {errors:?}");
}
