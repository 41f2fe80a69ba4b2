//! Checks every step from the Hessian to the interval against its closed formula.
//!
//! The reference is the parabola ½ a t², sampled at times symmetric about zero; the residuals are even in t with mean
//! zero. The derivative by the delay, −a t, is odd, so delay 0 and offset 0 are the solution for residuals of any size,
//! and all sums have closed forms.

use super::*;
use crate::delay::windows::delay_windows;
use crate::student_quantile;

const A: f64 = 2.0;

struct Parabola;

impl Reference for Parabola {
    fn span(&self) -> (f64, f64) {
        (-100.0, 100.0)
    }

    fn value_and_rate(&self, t: f64) -> (f64, f64) {
        (0.5 * A * t * t, A * t)
    }
}

/// 61 timestamps 0.5 s apart, centred on zero; residuals depend on the distance from zero, with their mean removed.
fn record(residual: impl Fn(f64) -> f64) -> (Vec<f64>, Vec<f64>) {
    let t: Vec<f64> = (-30..=30).map(|k| 0.5 * f64::from(k)).collect();
    let mut e: Vec<f64> = t.iter().map(|t| residual(t.abs())).collect();
    let mean = e.iter().sum::<f64>() / e.len() as f64;
    e.iter_mut().for_each(|e| *e -= mean);
    (t, e)
}

/// Residuals without a pattern in time, and residuals in long runs.
fn ragged(t: f64) -> f64 {
    0.1 * (97.0 * t * t + 13.0 * t).sin()
}

fn in_runs(t: f64) -> f64 {
    0.1 * (0.5 * t).cos()
}

fn fitted(t: &[f64], e: &[f64], noise: NoiseRule) -> DelayFit {
    let y: Vec<f64> = t.iter().zip(e).map(|(t, e)| 0.5 * A * t * t + e).collect();
    let measurement = Measurement { t, y: &y, reference: &Parabola, gain: Gain::Fixed(1.0), drift: false };
    let settings = DelaySettings { search_s: (-0.3, 0.3), noise, robust: false, ..DelaySettings::default() };
    fit_delay(&[measurement], &settings).unwrap()
}

fn near(found: f64, expected: f64) {
    assert!((found / expected - 1.0).abs() < 1e-6, "{found} instead of {expected}");
}

fn squares(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum()
}

/// H⁻¹ Jᵀe row by row, each over √(1 − leverage): the score of the delay.
fn scores(t: &[f64], e: &[f64]) -> Vec<f64> {
    let (tt, n) = (squares(t), t.len() as f64);
    t.iter().zip(e).map(|(t, e)| -t * e / (A * tt) / (1.0 - t * t / tt - 1.0 / n).sqrt()).collect()
}

/// Newey and West's sum as a double sum.
fn newey_west(s: &[f64], lags: usize) -> f64 {
    let weight = |i: usize, j: usize| (1.0 - i.abs_diff(j) as f64 / (lags + 1) as f64).max(0.0);
    (0..s.len()).flat_map(|i| (0..s.len()).map(move |j| (i, j))).map(|(i, j)| weight(i, j) * s[i] * s[j]).sum()
}

/// Andrews' lag of a series that is an AR(1), at most a quarter of its length.
fn andrews(s: &[f64]) -> usize {
    let (n, mean) = (s.len() as f64, s.iter().sum::<f64>() / s.len() as f64);
    let power: f64 = s.iter().map(|s| (s - mean).powi(2)).sum();
    let rho = s.windows(2).map(|w| (w[0] - mean) * (w[1] - mean)).sum::<f64>() / power;
    let alpha = 4.0 * rho * rho / ((1.0 - rho) * (1.0 + rho)).powi(2);
    ((1.1447 * (alpha * n).cbrt()).ceil() as usize).clamp(1, s.len() / 4)
}

#[test]
fn the_curvature_is_sigma_over_the_root_of_the_squared_slopes() {
    let (t, e) = record(ragged);
    let root = A * squares(&t).sqrt();
    let known = fitted(&t, &e, NoiseRule::Known(NoiseModel::white(0.05)));
    assert!(known.delay_s.abs() < 1e-9, "{}", known.delay_s);
    near(known.hessian_s, 0.05 / root);
    near(known.crlb_s, 0.05 / root);
    // With unknown noise the scale comes from the residuals: 61 of them, minus offset and delay.
    let own = fitted(&t, &e, NoiseRule::White);
    near(own.hessian_s, (squares(&e) / 59.0).sqrt() / root);
    near(own.degrees_of_freedom, if own.hac_s > own.hessian_s { own.degrees_of_freedom } else { 59.0 });
}

#[test]
fn the_sandwich_equals_the_double_sum_of_newey_and_west() {
    for residual in [ragged as fn(f64) -> f64, in_runs] {
        let (t, e) = record(residual);
        let fit = fitted(&t, &e, NoiseRule::White);
        let s = scores(&t, &e);
        assert_eq!(fit.hac_lags, andrews(&s));
        near(fit.hac_s, newey_west(&s, fit.hac_lags).sqrt());
    }
}

/// Runs of residuals of one sign: the curvature assumes 61 samples, the sandwich only the few runs.
#[test]
fn residuals_in_runs_report_the_sandwich_uncertainty() {
    let (t, e) = record(in_runs);
    let fit = fitted(&t, &e, NoiseRule::White);
    assert!(fit.hac_s > 1.3 * fit.hessian_s, "{} {}", fit.hac_s, fit.hessian_s);
    assert_eq!(fit.standard_uncertainty_s, fit.hac_s);
    // Satterthwaite: 2 V²/var V with var V = ⅔ Σ s⁴ + 4 Σ_l w_l² Σ s_k² s_{k−l}², V the sum of the squares.
    let q: Vec<f64> = scores(&t, &e).iter().map(|s| s * s).collect();
    let mut variance = 2.0 / 3.0 * squares(&q);
    for l in 1..=fit.hac_lags {
        let weight = 1.0 - l as f64 / (fit.hac_lags + 1) as f64;
        variance += 4.0 * weight * weight * q[l..].iter().zip(&q).map(|(a, b)| a * b).sum::<f64>();
    }
    near(fit.degrees_of_freedom, (2.0 * q.iter().sum::<f64>().powi(2) / variance).clamp(3.0, 59.0));
}

#[test]
fn the_curvature_uncertainty_is_reported_where_it_is_larger() {
    // Large where the slope is small: the scores are smaller than the curvature assumes.
    let (t, e) = record(|t| ragged(t) / (1.0 + t));
    let fit = fitted(&t, &e, NoiseRule::White);
    assert!(fit.hac_s < 0.8 * fit.hessian_s, "{} {}", fit.hac_s, fit.hessian_s);
    assert_eq!((fit.standard_uncertainty_s, fit.degrees_of_freedom), (fit.hessian_s, 59.0));
}

/// Quantiles from Student's table.
#[test]
fn the_interval_is_students_quantile_times_the_uncertainty() {
    for (degrees, level, quantile) in [
        (10.0, 0.95, 2.228_138_852),
        (59.0, 0.95, 2.000_995_378),
        (59.0, 0.9, 1.671_093_033),
        (3.0, 0.95, 3.182_446_305),
    ] {
        near(student_quantile(0.5 + 0.5 * level, degrees), quantile);
        let (t, e) = record(|t| ragged(t) / (1.0 + t));
        let fit = fitted(&t, &e, NoiseRule::White);
        let fit = DelayFit { delay_s: 0.3, degrees_of_freedom: degrees, ..fit };
        let [low, high] = fit.interval(level);
        near(0.5 * (low + high), 0.3);
        near(0.5 * (high - low), quantile * fit.standard_uncertainty_s);
    }
}

/// A part of the record with its own offset has σ/(a √Σ(t − t̄)²), times the ratio of the whole fit's uncertainty to
/// its curvature's.
#[test]
fn a_part_has_its_curvature_uncertainty_scaled_as_the_whole() {
    let (t, e) = record(in_runs);
    let fit = fitted(&t, &e, NoiseRule::White);
    let inflation = fit.hac_s / fit.hessian_s;
    assert!(inflation > 1.3);
    let y: Vec<f64> = t.iter().zip(&e).map(|(t, e)| 0.5 * A * t * t + e).collect();
    let measurement = Measurement { t: &t, y: &y, reference: &Parabola, gain: Gain::Fixed(1.0), drift: false };
    let sigma = fit.components[0].noise.std();
    let expected = |rows: std::ops::Range<usize>| {
        let part = &t[rows];
        let mean = part.iter().sum::<f64>() / part.len() as f64;
        let spread: f64 = part.iter().map(|t| (t - mean).powi(2)).sum();
        inflation * sigma / (A * spread.sqrt())
    };
    let segments = delay_by_segment(&[measurement], &fit, 10.0, 0.0);
    assert_eq!(segments.len(), 3);
    for (k, segment) in segments.iter().enumerate() {
        let first = t.partition_point(|x| *x < -15.0 + 10.0 * k as f64);
        let end = t.partition_point(|x| *x < -5.0 + 10.0 * k as f64);
        assert!((segment.standard_uncertainty_s / expected(first..end) - 1.0).abs() < 0.05, "{segment:?}");
    }
    for window in delay_windows(&fit, 3.0 * fit.standard_uncertainty_s, 10) {
        let rows = t.partition_point(|x| *x < window.start_s)..t.partition_point(|x| *x <= window.end_s);
        near(window.standard_uncertainty_s, expected(rows));
    }
}

/// Two components with the same timestamps and residuals are one measurement, not two: their scores are added before
/// squaring.
#[test]
fn residuals_shared_by_two_components_count_once() {
    let (t, e) = record(ragged);
    let y: Vec<f64> = t.iter().zip(&e).map(|(t, e)| 0.5 * A * t * t + e).collect();
    let one = Measurement { t: &t, y: &y, reference: &Parabola, gain: Gain::Fixed(1.0), drift: false };
    let settings =
        DelaySettings { search_s: (-0.3, 0.3), noise: NoiseRule::White, robust: false, ..DelaySettings::default() };
    let (alone, both) = (fit_delay(&[one], &settings).unwrap(), fit_delay(&[one, one], &settings).unwrap());
    // The curvature counts them twice: information is doubled, and rss/(n − p) is 2 rss/(122 − 3) instead of rss/(61 −
    // 2).
    near(both.hessian_s, alone.hessian_s * (0.5_f64 * 2.0 * 59.0 / 119.0).sqrt());
    // Leverages differ by 1/(2 Σ): the sandwich stays within a percent.
    assert!((both.hac_s / alone.hac_s - 1.0).abs() < 0.02, "{} {}", both.hac_s, alone.hac_s);
}
