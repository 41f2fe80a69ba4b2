//! Acceptance vectors, closed formulas and odd input.

use super::block::Block;
use super::block::Lateness;
use super::descent::Alignment;
use super::uncertainty::{Conditions, uncertainties};
use super::*;
use std::f64::consts::TAU;

/// A sum of sines: amplitude, frequency (Hz), phase.
pub(crate) struct Sines {
    pub(crate) terms: Vec<[f64; 3]>,
    pub(crate) span: (f64, f64),
}

impl Reference for Sines {
    fn span(&self) -> (f64, f64) {
        self.span
    }

    fn value_and_rate(&self, t: f64) -> (f64, f64) {
        self.terms.iter().fold((0.0, 0.0), |(value, rate), [a, f, p]| {
            let (sin, cos) = (TAU * f * t + p).sin_cos();
            (value + a * sin, rate + a * TAU * f * cos)
        })
    }
}

pub(crate) fn swing() -> Sines {
    Sines { terms: vec![[0.9, 0.53, 0.0], [0.25, 0.81, 0.7], [0.1, 1.37, -1.1]], span: (-5.0, 80.0) }
}

fn vectors() -> serde_json::Value {
    serde_json::from_str(include_str!("../../tests/delay_vectors.json")).unwrap()
}

const POSITIVE: Gain = Gain::Free { sign: Sign::Positive };

fn white() -> DelaySettings {
    DelaySettings { noise: NoiseRule::White, robust: false, ..DelaySettings::default() }
}

fn deterministic() -> (Vec<f64>, Vec<f64>) {
    let t: Vec<f64> = (0..240).map(|k| 3.0 + 0.25 * f64::from(k)).collect();
    let noise = |k: usize| 0.1 * (1.2345 * (k * k) as f64).sin();
    let y = t.iter().enumerate().map(|(k, t)| 1.02 * swing().value_and_rate(t - 0.4).0 + 0.5 + noise(k)).collect();
    (t, y)
}

/// `delay_fit_deterministic` of the project's acceptance vectors.
#[test]
fn the_deterministic_record_matches_the_acceptance_vector() {
    let case = &vectors()["delay_fit_deterministic"];
    let number = |key: &str| case[key].as_f64().unwrap();
    let list = |key: &str| -> Vec<f64> { serde_json::from_value(case[key].clone()).unwrap() };
    let (t, y) = deterministic();
    for (found, expected) in y.iter().zip(list("y_first5")) {
        assert!((found - expected).abs() < 1e-12);
    }
    let reference = swing();
    let measurements = [Measurement { t: &t, y: &y, reference: &reference, gain: POSITIVE, drift: false }];
    let fit = fit_delay(&measurements, &white()).unwrap();
    let component = &fit.components[0];
    assert!(fit.converged && (fit.delay_s - number("tau")).abs() < number("tol_tau"), "{}", fit.delay_s);
    assert!((component.gain.value - number("gain")).abs() < 1e-8, "{:?}", component.gain);
    assert!((component.offset.value - number("bias")).abs() < 1e-8, "{:?}", component.offset);
    let sse: f64 = component.residuals.iter().map(|e| e * e).sum();
    assert!((sse / number("sse") - 1.0).abs() < 1e-10, "{sse}");
}

/// The same with the textbook sandwich.
#[test]
fn deterministic_record_uncertainties_match_the_acceptance_vector() {
    let case = &vectors()["delay_fit_deterministic"];
    let list = |key: &str| -> Vec<f64> { serde_json::from_value(case[key].clone()).unwrap() };
    let (t, y) = deterministic();
    let reference = swing();
    let measurements = [Measurement { t: &t, y: &y, reference: &reference, gain: POSITIVE, drift: false }];
    let fit = fit_delay(&measurements, &white()).unwrap();
    let rows = (0..t.len()).collect();
    let block = Block::new(&measurements[0], rows, &fit.components[0].noise, None, 1);
    let mut alignment = Alignment { measurements: &measurements, blocks: vec![block], middle_s: fit.middle_s };
    let at = Lateness { delay_s: fit.delay_s, skew: 0.0 };
    let normal = alignment.normal(&at);
    let conditions = Conditions { weights: None, known_scale: false, textbook_lags: Some(10) };
    let found = uncertainties(&alignment, &at, &normal, &conditions).unwrap();
    for k in 0..3 {
        assert!((found.hessian[k] / list("se_ols")[k] - 1.0).abs() < 1e-5, "{:?}", found.hessian);
        assert!((found.hac[k] / list("se_hac")[k] - 1.0).abs() < 1e-5, "{:?}", found.hac);
    }
    assert!((fit.hessian_s / list("se_ols")[0] - 1.0).abs() < 1e-5);
}

#[test]
fn a_100_hz_spline_reference_gives_the_same_delay_within_tolerance() {
    let case = &vectors()["delay_fit_deterministic"];
    let (t, y) = deterministic();
    let knots: Vec<f64> = (0..7000).map(|k| 0.01 * f64::from(k)).collect();
    let values: Vec<f64> = knots.iter().map(|t| swing().value_and_rate(*t).0).collect();
    let reference = crate::CubicSpline::new(&knots, &values).unwrap();
    let measurement = Measurement { t: &t, y: &y, reference: &reference, gain: POSITIVE, drift: false };
    let fit = fit_delay(&[measurement], &white()).unwrap();
    let tolerance = case["tol_tau_with_spline_reference_100Hz"].as_f64().unwrap();
    assert!((fit.delay_s - case["tau"].as_f64().unwrap()).abs() < tolerance, "{}", fit.delay_s);
}

/// `crlb_sine` of the project's acceptance vectors.
#[test]
fn the_bound_of_a_sine_is_the_closed_formula() {
    let case = &vectors()["crlb_sine"];
    let number = |key: &str| case[key].as_f64().unwrap();
    let (a, f, rate, length) = (number("A"), number("f"), number("fs"), number("T"));
    let reference = Sines { terms: vec![[a, f, 0.0]], span: (-10.0, 100.0) };
    let t: Vec<f64> = (0..(rate * length) as usize).map(|k| k as f64 / rate).collect();
    let bound = delay_crlb(&t, &reference, 0.4, 1.0, &NoiseModel::white(number("sigma")), false).unwrap();
    assert!((bound / number("value") - 1.0).abs() < number("tol_rel"), "{bound}");
}

/// `skew` of the project's acceptance vectors, with a sine of whole periods for which it holds to 1/N².
#[test]
fn skew_and_delay_are_fitted_together_with_the_predicted_skew_error() {
    let case = &vectors()["skew"]["example"];
    let number = |key: &str| case[key].as_f64().unwrap();
    let formula = number("sigma_tau") * 12f64.sqrt() / number("T");
    assert!((formula / number("sigma_eps") - 1.0).abs() < 1e-12);

    let reference = Sines { terms: vec![[1.0, 0.5, 0.3]], span: (-10.0, 100.0) };
    let t: Vec<f64> = (0..6000).map(|k| 5.0 + 0.01 * f64::from(k)).collect();
    let middle = 0.5 * (t[0] + t[5999]);
    let y: Vec<f64> =
        t.iter().map(|t| 1.1 * reference.value_and_rate(t - 0.4 + 80e-6 * (t - middle)).0 - 3.0).collect();
    let noise = NoiseModel::white(1e-3);
    let settings = DelaySettings { noise: NoiseRule::Known(noise), skew: true, ..DelaySettings::default() };
    let measurement = Measurement { t: &t, y: &y, reference: &reference, gain: POSITIVE, drift: false };
    let fit = fit_delay(&[measurement], &settings).unwrap();
    let skew = fit.skew.unwrap();
    assert!((fit.delay_s - 0.4).abs() < 1e-9 && (skew.value - 80e-6).abs() < 1e-11, "{} {skew:?}", fit.delay_s);
    assert!((fit.middle_s - middle).abs() < 1e-9);
    let ratio = skew.standard_uncertainty / (fit.hessian_s * 12f64.sqrt() / 60.0);
    assert!((ratio - 1.0).abs() < 0.01, "{ratio}");
}

#[test]
fn a_late_sensor_has_positive_delay_and_an_early_one_negative_delay() {
    let reference = swing();
    let t: Vec<f64> = (0..300).map(|k| 3.0 + 0.1 * f64::from(k) + 0.02 * f64::from(k * 7 % 5)).collect();
    for delay in [0.4, 0.012, 0.0, -0.005, -0.7, 1.2] {
        for (gain, sign) in [(1.02, Sign::Positive), (-0.8, Sign::Negative), (-0.8, Sign::Any)] {
            let y: Vec<f64> = t.iter().map(|t| gain * reference.value_and_rate(t - delay).0 + 2.0 - 0.1 * t).collect();
            let m = Measurement { t: &t, y: &y, reference: &reference, gain: Gain::Free { sign }, drift: true };
            let fit = fit_delay(&[m], &DelaySettings::default()).unwrap();
            assert!((fit.delay_s - delay).abs() < 1e-8, "{delay} {sign:?}: {}", fit.delay_s);
            assert!((fit.components[0].gain.value - gain).abs() < 1e-7);
            assert!((fit.components[0].drift.unwrap().value + 0.1).abs() < 1e-8);
            let at_middle = 2.0 - 0.1 * fit.middle_s;
            assert!((fit.components[0].offset.value - at_middle).abs() < 1e-6);
        }
    }
}

#[test]
fn components_with_own_timestamps_share_one_delay_but_not_the_gain() {
    let (north, east) = (swing(), Sines { terms: vec![[0.4, 0.62, 0.2]], span: (0.0, 50.0) });
    let t_north: Vec<f64> = (0..400).map(|k| 3.0 + 0.1 * f64::from(k)).collect();
    let t_east: Vec<f64> = (0..150).map(|k| 4.0 + 0.25 * f64::from(k)).collect();
    let y_north: Vec<f64> = t_north.iter().map(|t| 1.2 * north.value_and_rate(t - 0.3).0).collect();
    let y_east: Vec<f64> = t_east.iter().map(|t| 0.5 * east.value_and_rate(t - 0.3).0 + 7.0).collect();
    let measurements = [
        Measurement { t: &t_north, y: &y_north, reference: &north, gain: POSITIVE, drift: false },
        Measurement { t: &t_east, y: &y_east, reference: &east, gain: Gain::Fixed(0.5), drift: false },
    ];
    let fit = fit_delay(&measurements, &DelaySettings::default()).unwrap();
    assert!((fit.delay_s - 0.3).abs() < 1e-8, "{}", fit.delay_s);
    assert!((fit.components[0].gain.value - 1.2).abs() < 1e-7);
    assert_eq!(fit.components[1].gain, Uncertain { value: 0.5, standard_uncertainty: 0.0 });
    assert!((fit.components[1].offset.value - 7.0).abs() < 1e-7);
}

#[test]
fn rows_outside_the_reference_are_skipped() {
    let reference = Sines { span: (3.0, 33.0), ..swing() };
    let t: Vec<f64> = (0..600).map(|k| 0.1 * f64::from(k)).collect();
    // Outside the reference's span the sensor shows what the reference cannot know.
    let within = |t: f64| (3.0..=33.0).contains(&(t - 0.4));
    let y: Vec<f64> = t.iter().map(|t| if within(*t) { swing().value_and_rate(t - 0.4).0 } else { 40.0 }).collect();
    let m = Measurement { t: &t, y: &y, reference: &reference, gain: POSITIVE, drift: false };
    let fit = fit_delay(&[m], &DelaySettings::default()).unwrap();
    assert!((fit.delay_s - 0.4).abs() < 1e-7, "{}", fit.delay_s);
    let used = &fit.components[0].t_used;
    assert!(used[0] >= 3.4 && used[used.len() - 1] <= 33.4 && used.len() > 290, "{}", used.len());
}

#[test]
fn a_delay_one_period_longer_is_reported_as_second_minimum() {
    let reference = Sines { terms: vec![[1.0, 1.0, 0.0], [0.2, 0.93, 1.0]], span: (-5.0, 80.0) };
    let t: Vec<f64> = (0..2000).map(|k| 3.0 + 0.02 * f64::from(k)).collect();
    let noise = |k: usize| 0.2 * (1.2345 * (k * k) as f64).sin();
    let y: Vec<f64> = t.iter().enumerate().map(|(k, t)| reference.value_and_rate(t - 0.4).0 + noise(k)).collect();
    let m = Measurement { t: &t, y: &y, reference: &reference, gain: POSITIVE, drift: false };
    let fit = fit_delay(&[m], &DelaySettings::default()).unwrap();
    let other = fit.second_minimum.unwrap();
    assert!((fit.delay_s - 0.4).abs() < 0.01 && other.excess > 0.0, "{fit:?}");
    assert!((other.delay_s + 0.6).abs() < 0.1 || (other.delay_s - 1.4).abs() < 0.1, "{other:?}");
    let curve = delay_objective(&[m], &fit, &[other.delay_s, fit.delay_s]);
    assert!((curve[0] - curve[1] - other.excess).abs() < 0.1 * other.excess, "{curve:?} {other:?}");
}

#[test]
fn outliers_are_downweighted_and_counted() {
    let (t, mut y) = deterministic();
    let clean = y.clone();
    for k in (5..240).step_by(23) {
        y[k] += if k % 2 == 0 { 5.0 } else { -3.0 };
    }
    let reference = swing();
    let fit = |y: &[f64], robust: bool| {
        let m = Measurement { t: &t, y, reference: &reference, gain: POSITIVE, drift: false };
        fit_delay(&[m], &DelaySettings { robust, ..DelaySettings::default() }).unwrap()
    };
    let (robust, plain) = (fit(&y, true), fit(&y, false));
    assert!(fit(&clean, true).downweighted_share == 0.0);
    assert!(robust.downweighted_share >= 11.0 / 240.0 && plain.downweighted_share == 0.0);
    let spoiled = (5..240).step_by(23).all(|k| robust.components[0].weights[k] < 0.2);
    assert!(spoiled, "every spoiled row is downweighted");
    assert!(robust.standard_uncertainty_s < 0.4 * plain.standard_uncertainty_s);
    assert!((robust.delay_s - 0.4).abs() < 3.0 * robust.standard_uncertainty_s, "{}", robust.delay_s);
}

/// The last piece is 0.3 s later than the others: its samples are downweighted and do not determine its offset.
#[test]
fn a_fully_downweighted_piece_does_not_affect_the_others() {
    let reference = swing();
    let noise = |k: usize| 0.0002 * (1.2345 * (k * k) as f64).sin();
    let piece = |from: f64, samples: u32, late: f64| -> (Vec<f64>, Vec<f64>) {
        let t: Vec<f64> = (0..samples).map(|k| from + 0.05 * f64::from(k)).collect();
        let y = t.iter().enumerate().map(|(k, t)| reference.value_and_rate(t - late).0 + noise(k)).collect();
        (t, y)
    };
    let pieces = [piece(3.0, 500, 0.4), piece(29.0, 500, 0.4), piece(55.0, 60, 0.7)];
    let mut measurements = vec![];
    for (t, y) in &pieces {
        measurements.push(Measurement { t, y, reference: &reference, gain: Gain::Fixed(1.0), drift: true });
    }
    let settings = DelaySettings { noise: NoiseRule::Known(NoiseModel::white(0.00015)), ..DelaySettings::default() };
    let fit = fit_delay(&measurements, &settings).unwrap();
    assert!(fit.components[2].weights.iter().all(|w| *w < 1.0), "{:?}", fit.components[2].weights);
    assert!((fit.delay_s - 0.4).abs() < 3.0 * fit.standard_uncertainty_s + 0.002, "{}", fit.delay_s);
    assert!(fit.standard_uncertainty_s < 0.05, "{}", fit.standard_uncertainty_s);
}

#[test]
fn a_delay_that_changes_midway_is_not_homogeneous() {
    let reference = swing();
    let t: Vec<f64> = (0..1200).map(|k| 3.0 + 0.05 * f64::from(k)).collect();
    let noise = |k: usize| 0.05 * (1.2345 * (k * k) as f64).sin();
    let record = |late: f64| -> Vec<f64> {
        let delay = |t: f64| if t > 33.0 { late } else { 0.4 };
        t.iter().enumerate().map(|(k, t)| reference.value_and_rate(t - delay(*t)).0 + noise(k)).collect()
    };
    let p = |late: f64| {
        let y = record(late);
        let m = Measurement { t: &t, y: &y, reference: &reference, gain: POSITIVE, drift: false };
        let fit = fit_delay(&[m], &DelaySettings::default()).unwrap();
        let segments = delay_by_segment(&[m], &fit, 10.0, 0.0);
        assert_eq!(segments.len(), 6);
        (homogeneity(&segments).unwrap().1, segments)
    };
    let (same, _) = p(0.4);
    let (changed, segments) = p(0.42);
    assert!(same > 0.01 && changed < 1e-4, "{same} {changed}");
    assert!((segments[1].delay_s - 0.4).abs() < 0.01 && (segments[4].delay_s - 0.42).abs() < 0.01, "{segments:?}");
}

fn error_of(t: &[f64], y: &[f64], reference: &dyn Reference) -> DelayError {
    let m = Measurement { t, y, reference, gain: POSITIVE, drift: true };
    fit_delay(&[m], &DelaySettings::default()).unwrap_err()
}

#[test]
fn invalid_input_is_a_descriptive_error() {
    let reference = swing();
    let t: Vec<f64> = (0..100).map(|k| 3.0 + 0.1 * f64::from(k)).collect();
    assert_eq!(fit_delay(&[], &DelaySettings::default()).unwrap_err(), DelayError::NoComponent);
    assert!(matches!(error_of(&[], &[], &reference), DelayError::TooFewSamples { samples: 0, of: 0, .. }));
    assert!(matches!(error_of(&[1.0, 2.0], &[1.0, 2.0], &reference), DelayError::TooFewSamples { samples: 2, .. }));
    assert!(matches!(error_of(&t, &t[1..], &reference), DelayError::LengthsDiffer { stamps: 100, values: 99, .. }));
    assert!(matches!(error_of(&[1.0, 1.0], &[0.0; 2], &reference), DelayError::StampsNotRising { row: 1, .. }));
    let m = Measurement { t: &t, y: &t, reference: &reference, gain: POSITIVE, drift: false };
    let settings = DelaySettings { search_s: (1.0, -1.0), ..DelaySettings::default() };
    assert!(matches!(fit_delay(&[m], &settings), Err(DelayError::SearchRange { .. })));
    assert_eq!(delay_crlb(&[], &reference, 0.0, 1.0, &NoiseModel::white(1.0), false), None);
}

#[test]
fn a_still_or_non_overlapping_reference_is_a_descriptive_error() {
    let t: Vec<f64> = (0..100).map(|k| 3.0 + 0.1 * f64::from(k)).collect();
    assert!(matches!(error_of(&t, &[4.0; 100], &swing()), DelayError::DoesNotFollow { .. }));
    let still = Sines { terms: vec![], span: (0.0, 80.0) };
    assert_eq!(error_of(&t, &t, &still), DelayError::NoExcitation);
    let level = Sines { terms: vec![[1.0, 0.0, 1.0]], span: (0.0, 80.0) };
    assert_eq!(error_of(&t, &t, &level), DelayError::NoExcitation);
    let elsewhere = Sines { span: (200.0, 300.0), ..swing() };
    assert!(matches!(error_of(&t, &t, &elsewhere), DelayError::TooFewSamples { samples: 0, of: 100, .. }));
    assert_eq!(delay_crlb(&t, &still, 0.0, 1.0, &NoiseModel::white(1.0), false), None);
}

#[test]
fn noise_free_values_and_a_still_component_do_not_break_the_fit() {
    let reference = swing();
    let still = Sines { terms: vec![], span: (-5.0, 80.0) };
    let t: Vec<f64> = (0..100).map(|k| 3.0 + 0.1 * f64::from(k)).collect();
    let y: Vec<f64> = t.iter().map(|t| reference.value_and_rate(t - 0.25).0).collect();
    let noise: Vec<f64> = (0..100).map(|k: u32| (1.2345 * f64::from(k * k)).sin()).collect();
    let measurements = [
        Measurement { t: &t, y: &y, reference: &reference, gain: POSITIVE, drift: false },
        Measurement { t: &t, y: &noise, reference: &still, gain: Gain::Fixed(1.0), drift: false },
    ];
    let fit = fit_delay(&measurements, &DelaySettings::default()).unwrap();
    assert!((fit.delay_s - 0.25).abs() < 1e-9, "{}", fit.delay_s);
}

/// The unit of the measured values changes gain, offset and noise by its factor, and nothing else.
#[test]
fn a_delay_does_not_depend_on_the_unit() {
    let (t, y) = deterministic();
    let reference = swing();
    let fit = |unit: f64, settings: &DelaySettings| {
        let y: Vec<f64> = y.iter().map(|y| unit * y).collect();
        let measurement = Measurement { t: &t, y: &y, reference: &reference, gain: POSITIVE, drift: true };
        fit_delay(&[measurement], settings).unwrap()
    };
    for settings in [white(), DelaySettings::default()] {
        let metre = fit(1.0, &settings);
        for unit in [1e3, 1e-3] {
            let other = fit(unit, &settings);
            let near = |a: f64, b: f64, by: f64| assert!((a - b).abs() < by * b.abs(), "{a} instead of {b}");
            near(other.delay_s, metre.delay_s, 1e-5);
            near(other.standard_uncertainty_s, metre.standard_uncertainty_s, 1e-2);
            let [other, metre] = [&other, &metre].map(|fit| &fit.components[0]);
            near(other.gain.value, unit * metre.gain.value, 1e-5);
            near(other.gain.standard_uncertainty, unit * metre.gain.standard_uncertainty, 1e-2);
            near(other.noise.white_std, unit * metre.noise.white_std, 1e-2);
        }
    }
}
