//! A smoother for coarsely measured motion: value, rate, acceleration, jerk and their uncertainties, at every timestamp
//! and between.

mod backward;
mod chain;
mod filter;

use crate::hermite;
use crate::minimise::least_between;
use backward::smooth_back;
use chain::{Matrix, Symmetric, Transition, full, process_noise, symmetric_part, with_variances_not_negative};
use filter::{Filtered, Score, Series};
use thiserror::Error;

/// Why a series cannot be smoothed.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum SmoothError {
    /// Fewer samples than needed for four states.
    #[error("{samples} samples are too few to smooth: at least {least}", least = LEAST_SAMPLES)]
    TooShort {
        /// Number of samples.
        samples: usize,
    },
    /// Numbers of timestamps and values differ.
    #[error("{stamps} timestamps for {values} values")]
    Lengths {
        /// Number of timestamps.
        stamps: usize,
        /// Number of values.
        values: usize,
    },
    /// A timestamp or value is not finite.
    #[error("sample {row} is not finite")]
    NotFinite {
        /// Row, from 0.
        row: usize,
    },
    /// Timestamps must not go back. Equal timestamps are allowed.
    #[error("the timestamp of sample {row} goes backwards")]
    GoesBack {
        /// Row, from 0.
        row: usize,
    },
    /// All timestamps are the same.
    #[error("all samples have the same timestamp")]
    NoDuration,
    /// The variance of the measurement, or q, is not a positive finite number.
    #[error("the measurement's variance and q must be positive and finite")]
    Setting,
}

/// Minimum number of samples to smooth.
const LEAST_SAMPLES: usize = 8;

/// Intervals within this share of the usual one count as usual.
const SAME_INTERVAL: f64 = 1e-6;

/// A four-state smoother.
///
/// Model: x⁗ is white noise of spectral density q (unit²/s⁷, "white snap"), and z = x + noise of variance R. The
/// smoothed x is the septic smoothing spline of the samples. Timestamps may be irregular; equal timestamps are two
/// measurements of one instant; over a gap the motion is extrapolated and its covariance grows. If x is only known to
/// 10⁵ measurement deviations after a gap, the smoother restarts. Intervals within 10⁻⁶ of the median one count as
/// equal to it, so that rounded timestamps of a regular record stay regular; rates are then right to a relative 10⁻⁶.
///
/// Method: Kalman filter and the backward pass of Rauch, Tung and Striebel in covariance form, on states scaled by
/// hⁱ/i! (Nordsieck 1962), numerically sound from 10 Hz to above 1 kHz. Q is never inverted. Once the covariances of a
/// regular record have settled, they are reused.
///
/// Accuracy, measured in `tests/smoother_accuracy.rs`: a bar pushed or waved by hand, 2000 counts per revolution at 100
/// Hz, lever 1.3 m: rms error of the acceleration 0.10 and 0.08 m/s², where second differences have 29; 8000 counts:
/// 0.05 and 0.03 m/s². The stated deviation is an upper bound in practice: 1.0 to 1.8 times the error of angle and
/// rate, 1.2 to 2.4 times that of the acceleration.
///
/// Tried and rejected (design note 2): likelihood for q (over-estimates it if the motion is smoother than the model: up
/// to 1.6 times the error), three or five states, a pendulum model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Smoother {
    /// Prior variances of x, x′, x″, x‴ at the first timestamp, about the first value and zero: unit², unit²/s²,
    /// unit²/s⁴, unit²/s⁶. They must be large compared with what is expected.
    pub prior_variance: [f64; 4],
}

impl Default for Smoother {
    /// A prior for angles in radians and lengths in metres of hand-moved objects.
    fn default() -> Smoother {
        Smoother { prior_variance: [1.0, 1e4, 1e4, 1e4] }
    }
}

/// Motion with value, rate, acceleration and jerk at each timestamp.
#[derive(Debug, Clone, PartialEq)]
pub struct SmoothedMotion {
    /// The given timestamps, s.
    pub t: Vec<f64>,
    /// x, x′, x″, x‴ at each timestamp.
    pub state: Vec<[f64; 4]>,
    /// Upper triangle of the covariance of each state, row by row:
    /// 00 01 02 03 11 12 13 22 23 33.
    pub covariance: Vec<[f64; 10]>,
    /// log10 of the spectral density of the white snap, unit²/s⁷.
    pub log10_q: f64,
    /// Rms of measured − smoothed.
    pub residual_rms: f64,
    /// Trace of the smoother's influence matrix: its effective number of parameters.
    pub trace: f64,
    /// Rows at which the motion restarted after a gap, because the gap was too long to carry it across.
    pub anew: Vec<usize>,
    /// Intervals longer than two usual ones, rising: the previous row, and the covariance of the state there with the
    /// state after.
    across: Vec<(usize, Matrix)>,
}

impl Smoother {
    /// Smooths `z` (unit) measured at `t` (s) with the measurement's variance (unit²) and log10 of q
    /// (unit²/s⁷).
    ///
    /// # Errors
    /// [`SmoothError`]: fewer than 8 samples, timestamps that go back, or a number that is not finite.
    pub fn smooth(&self, t: &[f64], z: &[f64], variance: f64, log10_q: f64) -> Result<SmoothedMotion, SmoothError> {
        let record = Scaled::new(self, t, z, variance)?;
        record.smoothed(t, log10_q)
    }

    /// Smooths with the q of generalised cross-validation (Craven and Wahba 1979): the minimum of GCV(q) = n·RSS/(n −
    /// tr H)². It depends on q/R alone, so R need not be known well; but the covariance scales with R.
    ///
    /// The search starts from the likelihood's q and covers 4 decades below to 1.5 above, to 0.01 in log10 q; cut-off
    /// frequencies (q/(R h))^⅛/2π stay between half a cycle of the record and the Nyquist frequency. A series without
    /// motion ends at the low bound.
    ///
    /// If readings are so coarse that a value is usually held over m samples, every m-th sample is independent of the
    /// others: the search uses those, and the smoother gives each sample m times the variance. (If taken as
    /// independent, the steps of a slow motion would be followed one by one: at 1 kHz and an amplitude of 10 counts,
    /// 100 times the acceleration itself.)
    ///
    /// # Errors
    /// As [`Smoother::smooth`].
    pub fn smooth_by_gcv(&self, t: &[f64], z: &[f64], variance: f64) -> Result<SmoothedMotion, SmoothError> {
        let held = usual_run(z);
        let log10_q = self.log10_q_by_gcv(t, z, variance)?;
        Scaled::new(self, t, z, variance * held as f64)?.smoothed(t, log10_q)
    }

    /// log10 of q (unit²/s⁷) by generalised cross-validation, without smoothing.
    ///
    /// # Errors
    /// As [`Smoother::smooth`].
    pub fn log10_q_by_gcv(&self, t: &[f64], z: &[f64], variance: f64) -> Result<f64, SmoothError> {
        let record = Scaled::new(self, t, z, variance)?;
        let held = usual_run(z);
        if held == 1 {
            return Ok(record.log10_q_by_gcv());
        }
        let thinned = |x: &[f64]| -> Vec<f64> { x.iter().step_by(held).copied().collect() };
        Ok(Scaled::new(self, &thinned(t), &thinned(z), variance)?.log10_q_by_gcv())
    }
}

/// [`Smoother::smooth`] with the usual prior.
///
/// # Errors
/// [`SmoothError`].
pub fn smooth(t: &[f64], z: &[f64], variance: f64, log10_q: f64) -> Result<SmoothedMotion, SmoothError> {
    Smoother::default().smooth(t, z, variance, log10_q)
}

/// [`Smoother::smooth_by_gcv`] with the usual prior.
///
/// # Errors
/// [`SmoothError`].
pub fn smooth_by_gcv(t: &[f64], z: &[f64], variance: f64) -> Result<SmoothedMotion, SmoothError> {
    Smoother::default().smooth_by_gcv(t, z, variance)
}

/// A validated record in scaled units.
#[derive(Debug, Clone)]
struct Scaled {
    series: Series,
    step_s: f64,
    duration_s: f64,
    first: f64,
    variance: f64,
}

impl Scaled {
    fn new(smoother: &Smoother, t: &[f64], z: &[f64], variance: f64) -> Result<Scaled, SmoothError> {
        check(t, z)?;
        let positive = |x: f64| x.is_finite() && x > 0.0;
        if !positive(variance) || !smoother.prior_variance.iter().all(|&p| positive(p)) {
            return Err(SmoothError::Setting);
        }
        let step_s = usual_interval(t).ok_or(SmoothError::NoDuration)?;
        let ratio = |w: &[f64]| {
            let ratio = (w[1] - w[0]) / step_s;
            if (ratio - 1.0).abs() <= SAME_INTERVAL { 1.0 } else { ratio }
        };
        let (first, deviation) = (z[0], variance.sqrt());
        let scale = state_scale(step_s);
        let series = Series {
            z: z.iter().map(|z| (z - first) / deviation).collect(),
            ratio: std::iter::once(0.0).chain(t.windows(2).map(ratio)).collect(),
            prior: std::array::from_fn(|i| smoother.prior_variance[i] * scale[i] * scale[i] / variance),
        };
        Ok(Scaled { series, step_s, duration_s: t[t.len() - 1] - t[0], first, variance })
    }

    /// ρ = q h⁷/(36 R).
    fn rho(&self, log10_q: f64) -> f64 {
        10f64.powf(log10_q) * self.step_s.powi(7) / (36.0 * self.variance)
    }

    fn smoothed(&self, t: &[f64], log10_q: f64) -> Result<SmoothedMotion, SmoothError> {
        let rho = self.rho(log10_q);
        if !rho.is_finite() || rho <= 0.0 {
            return Err(SmoothError::Setting);
        }
        let mut filtered = Filtered::default();
        filtered.run(&self.series, rho, true);
        let smoothed = smooth_back(&self.series, &filtered, rho);
        let rss: f64 = self.series.z.iter().zip(&smoothed.states).map(|(z, x)| (z - x[0]).powi(2)).sum();
        let trace = smoothed.covariances.iter().map(|p| p[0]).sum();
        let scale = state_scale(self.step_s).map(|s| 1.0 / s);
        let unit = UnitOf { state: scale.map(|s| s * self.variance.sqrt()) };
        let across = smoothed.across.iter().rev().map(|(k, m)| (*k, unit.matrix(m))).collect();
        Ok(SmoothedMotion {
            t: t.to_vec(),
            state: smoothed.states.iter().map(|x| unit.state(x, self.first)).collect(),
            covariance: smoothed.covariances.iter().map(|p| unit.covariance(p)).collect(),
            log10_q,
            residual_rms: (rss * self.variance / self.series.z.len() as f64).sqrt(),
            trace,
            anew: smoothed.restarts.into_iter().rev().collect(),
            across,
        })
    }

    fn log10_q_by_gcv(&self) -> f64 {
        let mut filtered = Filtered::default();
        let log10_q_at_cut_off = |omega: f64| 8.0 * omega.log10() + (self.variance * self.step_s).log10();
        let low = log10_q_at_cut_off(std::f64::consts::PI / self.duration_s);
        let high = log10_q_at_cut_off(std::f64::consts::PI / self.step_s).max(low + 1.0);
        let mut minus_two_log_likelihood = |log10_q: f64| {
            filtered.run(&self.series, self.rho(log10_q), false);
            filtered.minus_two_log_likelihood
        };
        let (likely, _) = least_between(&mut minus_two_log_likelihood, (low, high), 0.1);
        let log_gcv = |x| self.score(&mut filtered, x).log_gcv(self.series.z.len());
        least_between(log_gcv, ((likely - 4.0).max(low), likely + 1.5), 0.01).0
    }

    fn score(&self, filtered: &mut Filtered, log10_q: f64) -> Score {
        filtered.run(&self.series, self.rho(log10_q), false);
        filtered.score(&self.series)
    }
}

impl Score {
    /// ln GCV in measurement variances. Residuals are floored at a millionth of the measurement's deviation: if every
    /// sample is fitted exactly, the smoother with the fewest parameters is best.
    fn log_gcv(&self, samples: usize) -> f64 {
        let n = samples as f64;
        if self.freedom <= 1e-9 * n {
            return f64::INFINITY;
        }
        (n * self.rss.max(1e-12 * n) / (self.freedom * self.freedom)).ln()
    }
}

fn check(t: &[f64], z: &[f64]) -> Result<(), SmoothError> {
    if t.len() != z.len() {
        return Err(SmoothError::Lengths { stamps: t.len(), values: z.len() });
    }
    if t.len() < LEAST_SAMPLES {
        return Err(SmoothError::TooShort { samples: t.len() });
    }
    if let Some(row) = t.iter().zip(z).position(|(t, z)| !t.is_finite() || !z.is_finite()) {
        return Err(SmoothError::NotFinite { row });
    }
    match t.windows(2).position(|w| w[1] < w[0]) {
        Some(before) => Err(SmoothError::GoesBack { row: before + 1 }),
        None => Ok(()),
    }
}

/// Median of the intervals that are not zero.
fn usual_interval(t: &[f64]) -> Option<f64> {
    let mut intervals: Vec<f64> = t.windows(2).map(|w| w[1] - w[0]).filter(|&dt| dt > 0.0).collect();
    let middle = intervals.len() / 2;
    (!intervals.is_empty()).then(|| *intervals.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Number of samples over which a value is usually held: the median over all whole runs, limited so that enough samples
/// remain.
#[must_use]
pub fn usual_run(z: &[f64]) -> usize {
    let mut lengths: Vec<usize> = z.chunk_by(|a, b| a == b).map(<[f64]>::len).collect();
    let last = lengths.len().saturating_sub(1);
    match lengths.get_mut(1..last) {
        Some(whole) if !whole.is_empty() => {
            let middle = (whole.len() - 1) / 2;
            (*whole.select_nth_unstable(middle).1).min(z.len() / FEWEST_INDEPENDENT).max(1)
        }
        _ => 1,
    }
}

/// Minimum number of samples used by the search for q, if available.
const FEWEST_INDEPENDENT: usize = 64;

/// hⁱ/i!.
fn state_scale(h: f64) -> [f64; 4] {
    [1.0, h, 0.5 * h * h, h * h * h / 6.0]
}

/// Converts scaled states to the caller's unit.
struct UnitOf {
    state: [f64; 4],
}

impl UnitOf {
    fn state(&self, x: &[f64; 4], first: f64) -> [f64; 4] {
        let s = &self.state;
        [first + x[0] * s[0], x[1] * s[1], x[2] * s[2], x[3] * s[3]]
    }

    fn matrix(&self, m: &Matrix) -> Matrix {
        std::array::from_fn(|i| std::array::from_fn(|j| m[i][j] * self.state[i] * self.state[j]))
    }

    fn covariance(&self, p: &Symmetric) -> Symmetric {
        symmetric_part(&self.matrix(&full(p)))
    }
}

impl SmoothedMotion {
    /// First and last timestamp, s.
    #[must_use]
    pub fn span(&self) -> (f64, f64) {
        (self.t[0], self.t[self.t.len() - 1])
    }

    /// x, x′, x″, x‴ at `t` (s); `None` outside the span. Between timestamps the polynomial of degree 7 through both
    /// states, which is the smoother's own conditional mean there.
    #[must_use]
    pub fn at(&self, t: f64) -> Option<[f64; 4]> {
        let k = self.interval(t)?;
        if self.t[k] == t {
            return Some(self.state[k]);
        }
        Some(hermite::septic_hermite(self.t[k], &self.state[k], self.t[k + 1], &self.state[k + 1], t))
    }

    /// Covariance of [`SmoothedMotion::at`], upper triangle as in [`SmoothedMotion::covariance`]; `None` outside the
    /// span. Exact inside intervals longer than two usual ones, linear in others.
    #[must_use]
    pub fn covariance_at(&self, t: f64) -> Option<[f64; 10]> {
        let k = self.interval(t)?;
        if self.t[k] == t {
            return Some(self.covariance[k]);
        }
        let length = self.t[k + 1] - self.t[k];
        let share = (t - self.t[k]) / length;
        let (start, end) = (&self.covariance[k], &self.covariance[k + 1]);
        match self.across.binary_search_by_key(&k, |(row, _)| *row) {
            Ok(found) => Some(self.inside(start, end, &self.across[found].1, length, share)),
            Err(_) => Some(std::array::from_fn(|i| start[i] + share * (end[i] - start[i]))),
        }
    }

    /// Standard deviations of x, x′, x″, x‴ at sample `row`.
    ///
    /// # Panics
    /// If there is no such row.
    #[must_use]
    pub fn standard_deviation(&self, row: usize) -> [f64; 4] {
        let p = &self.covariance[row];
        [p[0].sqrt(), p[4].sqrt(), p[7].sqrt(), p[9].sqrt()]
    }

    /// Row of the last timestamp not after `t`; at the end, the start of the last interval.
    fn interval(&self, t: f64) -> Option<usize> {
        let (first, last) = self.span();
        let inside = t >= first && t <= last;
        inside.then(|| self.t.partition_point(|&s| s <= t) - 1)
    }

    /// Covariance at a fraction of an interval whose ends are not independent: with the interpolation x = A xₛ + B xₑ,
    /// the ends' own covariance through A and B, and that of the bridge between them, Q₁ − B F₂ Q₁.
    fn inside(&self, start: &Symmetric, end: &Symmetric, across: &Matrix, length: f64, share: f64) -> Symmetric {
        let to_share = UnitOf { state: state_scale(length) };
        let basis = |of_end: bool| -> Matrix {
            let columns: Matrix = std::array::from_fn(|j| {
                let mut unit = [0.0; 4];
                unit[j] = 1.0;
                if of_end {
                    hermite::at_share(&[0.0; 4], &unit, share)
                } else {
                    hermite::at_share(&unit, &[0.0; 4], share)
                }
            });
            std::array::from_fn(|i| std::array::from_fn(|j| columns[j][i]))
        };
        let (a, b) = (basis(false), basis(true));
        let crossed = multiply(&multiply(&a, &to_share.matrix(across)), &transposed(&b));
        let ends = chain::sum(
            &chain::sandwich(&a, &to_share.covariance(start)),
            &chain::sandwich(&b, &to_share.covariance(end)),
        );
        let rho = 10f64.powf(self.log10_q) * length.powi(7) / 36.0;
        let first = full(&process_noise(share, rho));
        let onward = transposed(&first.map(|column| Transition::new(1.0 - share).apply(&column)));
        let taken = multiply(&b, &onward);
        let bridge: Matrix = std::array::from_fn(|i| std::array::from_fn(|j| first[i][j] - taken[i][j]));
        let crossed_twice: Matrix = std::array::from_fn(|i| std::array::from_fn(|j| crossed[i][j] + crossed[j][i]));
        let total = chain::sum(&ends, &chain::sum(&symmetric_part(&bridge), &symmetric_part(&crossed_twice)));
        let back = UnitOf { state: state_scale(length).map(|s| 1.0 / s) };
        with_variances_not_negative(back.covariance(&total))
    }
}

fn transposed(m: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| m[j][i]))
}

fn multiply(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..4).map(|k| a[i][k] * b[k][j]).sum()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};
    use std::f64::consts::TAU;

    fn vectors() -> serde_json::Value {
        serde_json::from_str(include_str!("../tests/smoother_vectors.json")).unwrap()
    }

    fn numbers(value: &serde_json::Value) -> Vec<f64> {
        value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
    }

    const LSB: f64 = TAU / 2000.0;
    const VARIANCE: f64 = LSB * LSB / 12.0;

    /// `rts_m4`: ten samples whose smoothed states were computed with 60 digits.
    #[test]
    fn smoothed_states_equal_a_solution_with_sixty_digits() {
        let case = &vectors()["rts_m4"];
        let z = numbers(&case["z"]);
        let t: Vec<f64> = (0..z.len()).map(|k| k as f64 * 0.01).collect();
        let smoother = Smoother { prior_variance: [1.0, 1e2, 1e4, 1e6] };
        let found = smoother.smooth(&t, &z, case["R"].as_f64().unwrap(), 4.0).unwrap();
        let expected: Vec<Vec<f64>> = case["smoothed"].as_array().unwrap().iter().map(numbers).collect();
        for i in 0..4 {
            let largest = expected.iter().map(|x| x[i].abs()).fold(0.0, f64::max);
            for (found, expected) in found.state.iter().zip(&expected) {
                assert!((found[i] - expected[i]).abs() <= 1e-7 * largest, "x({i}) {} {}", found[i], expected[i]);
            }
        }
    }

    /// `rts_gcv`, 40 samples: trace and residual sum, of the smoother and of the adjoint that the search uses.
    #[test]
    fn trace_residuals_and_gcv_equal_the_acceptance_vector() {
        let case = &vectors()["rts_gcv"];
        let z: Vec<f64> = numbers(&case["counts_n40"]).iter().map(|n| n * LSB).collect();
        let t: Vec<f64> = (0..z.len()).map(|k| k as f64 * 0.01).collect();
        let expected = |key: &str| case["n40_q1e3"][key].as_f64().unwrap();
        let near = |found: f64, key: &str| {
            assert!((found / expected(key) - 1.0).abs() < 1e-6, "{key}: {found} instead of {}", expected(key));
        };
        let motion = smooth(&t, &z, VARIANCE, 3.0).unwrap();
        near(motion.trace, "trace");
        near(motion.residual_rms.powi(2) * 40.0, "rss");
        let record = Scaled::new(&Smoother::default(), &t, &z, VARIANCE).unwrap();
        let score = record.score(&mut Filtered::default(), 3.0);
        near(40.0 - score.freedom, "trace");
        near(score.rss * VARIANCE, "rss");
        near(score.log_gcv(40) + VARIANCE.ln(), "log_gcv");
    }

    /// `rts_gcv`, 1000 samples: the resulting q and acceleration.
    #[test]
    fn cross_validation_finds_the_q_of_the_acceptance_vector() {
        let case = &vectors()["rts_gcv"]["n1000"];
        let t: Vec<f64> = (0..1000).map(|k| f64::from(k) * 0.01).collect();
        let (slow, fast) = (TAU * 0.5, TAU * 1.7);
        let z: Vec<f64> =
            t.iter().map(|t| (((slow * t).sin() + 0.05 * (fast * t + 0.3).sin()) / LSB).round() * LSB).collect();
        let motion = smooth_by_gcv(&t, &z, VARIANCE).unwrap();
        assert!((motion.log10_q - case["argmin_log10_q"].as_f64().unwrap()).abs() < 0.02, "{}", motion.log10_q);
        let truth = |t: f64| -slow * slow * (slow * t).sin() - 0.05 * fast * fast * (fast * t + 0.3).sin();
        let squares: f64 = (100..900).map(|k| (motion.state[k][2] - truth(t[k])).powi(2)).sum();
        let (rms, expected) = ((squares / 800.0).sqrt(), case["acc_rms_error_rad_s2"].as_f64().unwrap());
        assert!((rms / expected - 1.0).abs() < 0.02, "{rms} instead of {expected}, without a second at each end");
        assert!((motion.trace / case["trace"].as_f64().unwrap() - 1.0).abs() < 0.002, "{}", motion.trace);
    }

    /// Covariance of (x, x′, x″, x‴) at `s` with that at `t` ≥ `s`, both after the first timestamp 0, from the
    /// definition of the model and independent of the smoother.
    fn prior_between(prior: &[f64; 4], q: f64, s: f64, t: f64) -> DMatrix<f64> {
        let power = |x: f64, n: usize| x.powi(n as i32) / (1..=n).map(|m| m as f64).product::<f64>();
        let flow = |dt: f64| DMatrix::from_fn(4, 4, |i, j| if j >= i { power(dt, j - i) } else { 0.0 });
        let noise = DMatrix::from_fn(4, 4, |i, j| {
            let (a, b) = (3 - i, 3 - j);
            q * power(s, a) * power(s, b) * s / (a + b + 1) as f64
        });
        let start = DMatrix::from_diagonal(&DVector::from_row_slice(prior));
        flow(s) * start * flow(t).transpose() + noise * flow(t - s).transpose()
    }

    /// States and covariances by dense Gaussian regression.
    fn dense(prior: &[f64; 4], t: &[f64], z: &[f64], variance: f64, q: f64, at: f64) -> (DVector<f64>, DMatrix<f64>) {
        let n = t.len();
        let between = |a: f64, b: f64| {
            if a <= b { prior_between(prior, q, a, b) } else { prior_between(prior, q, b, a).transpose() }
        };
        let k = DMatrix::from_fn(n, n, |i, j| between(t[i], t[j])[(0, 0)] + if i == j { variance } else { 0.0 });
        let cross = DMatrix::from_fn(4, n, |i, j| between(at, t[j])[(i, 0)]);
        let centred = DVector::from_iterator(n, z.iter().map(|v| v - z[0]));
        let factor = k.cholesky().unwrap();
        let mut mean = &cross * factor.solve(&centred);
        mean[0] += z[0];
        (mean, between(at, at) - &cross * factor.solve(&cross.transpose()))
    }

    /// Irregular timestamps, one of them twice, a lost sample, a gap of 17 intervals: compares states and covariances
    /// at the timestamps, and between them inside the gap, with dense regression with the model's kernel.
    #[test]
    fn irregular_and_repeated_timestamps_and_a_gap_match_dense_regression() {
        let mut t: Vec<f64> = (0..14).map(|k| 0.1 * f64::from(k) + 0.02 * (f64::from(k) * 2.3).sin()).collect();
        t[0] = 0.0;
        t[6] = t[5];
        t.remove(10);
        t.extend((0..14).map(|k| 3.0 + 0.1 * f64::from(k)));
        let z: Vec<f64> = t.iter().enumerate().map(|(k, t)| (2.0 * t).sin() + 0.01 * (k as f64 * 7.7).cos()).collect();
        let prior = [1.0, 10.0, 30.0, 100.0];
        let (variance, q) = (1e-3, 50.0_f64);
        let motion = Smoother { prior_variance: prior }.smooth(&t, &z, variance, q.log10()).unwrap();
        let inside = [t[12] + 0.01, 1.7, 2.2, 2.9, 2.999];
        for at in t.iter().chain(&inside) {
            let (mean, covariance) = dense(&prior, &t, &z, variance, q, *at);
            let state = motion.at(*at).unwrap();
            let found = full(&motion.covariance_at(*at).unwrap());
            for i in 0..4 {
                let deviation = covariance[(i, i)].sqrt();
                assert!((state[i] - mean[i]).abs() < 1e-6 * deviation, "x({i}) at {at}: {} {}", state[i], mean[i]);
                for j in 0..4 {
                    let scale = deviation * covariance[(j, j)].sqrt();
                    let (f, e) = (found[i][j], covariance[(i, j)]);
                    assert!((f - e).abs() < 1e-5 * scale, "P{i}{j} at {at}: {f} {e}");
                }
            }
        }
        assert_eq!(motion.at(-0.1), None);
        assert_eq!(motion.covariance_at(t[t.len() - 1] + 0.1), None);
    }

    /// If a regular record lets the filter settle, the remainder is not computed; a record with timestamps just outside
    /// the tolerance is computed in full. Both must agree.
    #[test]
    fn settled_gains_do_not_change_the_result() {
        for (rate, cut_off_hz) in [(100.0, 0.3), (100.0, 4.0), (1000.0, 4.0), (1000.0, 100.0)] {
            let regular: Vec<f64> = (0..3000).map(|k| f64::from(k) / rate).collect();
            let uneven: Vec<f64> = (0..3000).map(|k| (f64::from(k) + f64::from(k % 2) * 2e-6) / rate).collect();
            let z: Vec<f64> = regular.iter().map(|t| ((3.0 * t).sin() / LSB).round() * LSB).collect();
            let log10_q = 8.0 * f64::log10(TAU * cut_off_hz) + f64::log10(VARIANCE / rate);
            let quick = smooth(&regular, &z, VARIANCE, log10_q).unwrap();
            let whole = smooth(&uneven, &z, VARIANCE, log10_q).unwrap();
            assert!((quick.trace / whole.trace - 1.0).abs() < 1e-5, "{} {}", quick.trace, whole.trace);
            for k in 0..3000 {
                for i in 0..4 {
                    let deviation = whole.standard_deviation(k)[i];
                    let difference = quick.state[k][i] - whole.state[k][i];
                    assert!(
                        difference.abs() < 0.01 * deviation,
                        "x({i}) of {k} at {rate} Hz: {difference}, {deviation}"
                    );
                    let ratio = quick.standard_deviation(k)[i] / deviation;
                    assert!((ratio - 1.0).abs() < 1e-4, "deviation {i} of {k} at {rate} Hz: ratio {ratio}");
                }
            }
            let score = |t: &[f64]| {
                Scaled::new(&Smoother::default(), t, &z, VARIANCE).unwrap().score(&mut Filtered::default(), log10_q)
            };
            let (quick, whole) = (score(&regular), score(&uneven));
            assert!((quick.freedom / whole.freedom - 1.0).abs() < 1e-6 && (quick.rss / whole.rss - 1.0).abs() < 1e-3);
        }
    }

    /// The search and the smoother use different recursions for trace and residuals.
    #[test]
    fn adjoint_and_smoother_agree_on_trace_and_residuals() {
        let mut t: Vec<f64> = (0..2000).map(|k| f64::from(k) * 0.001).collect();
        t[700] = t[699];
        t.iter_mut().skip(1200).for_each(|t| *t += 2.5);
        let z: Vec<f64> = t.iter().map(|t| ((3.0 * t).sin() / LSB).round() * LSB).collect();
        for log10_q in [-16.0, -12.0, -8.0, -4.0, -2.0, 0.0, 2.0, 4.0, 5.0, 6.0, 8.0, 10.0, 14.0, 22.0] {
            let motion = smooth(&t, &z, VARIANCE, log10_q).unwrap();
            let record = Scaled::new(&Smoother::default(), &t, &z, VARIANCE).unwrap();
            let score = record.score(&mut Filtered::default(), log10_q);
            let trace = 2000.0 - score.freedom;
            assert!((motion.trace - trace).abs() < 1e-6 * trace, "{log10_q}: {} {trace}", motion.trace);
            let rms = (score.rss * VARIANCE / 2000.0).sqrt();
            assert!((motion.residual_rms / rms - 1.0).abs() < 1e-6, "{log10_q}: {} {rms}", motion.residual_rms);
        }
    }

    fn assert_sane(name: &str, motion: &SmoothedMotion) {
        assert!(motion.log10_q.is_finite() && motion.trace.is_finite() && motion.residual_rms.is_finite(), "{name}");
        for k in 0..motion.t.len() {
            assert!(motion.state[k].iter().all(|x| x.is_finite()), "{name}: state {k} {:?}", motion.state[k]);
            assert!(motion.standard_deviation(k).iter().all(|s| s.is_finite()), "{name}: {:?}", motion.covariance[k]);
        }
    }

    #[test]
    fn a_bar_at_rest_is_at_rest() {
        for n in [8, 100, 6000] {
            let t: Vec<f64> = (0..n).map(|k| f64::from(k) * 0.01).collect();
            let motion = smooth_by_gcv(&t, &vec![0.7; n as usize], VARIANCE).unwrap();
            assert_sane("rest", &motion);
            let low = 8.0 * (std::f64::consts::PI / t[t.len() - 1]).log10() + (VARIANCE * 0.01).log10();
            assert!((motion.log10_q - low).abs() < 0.05, "{} is not the low bound {low}", motion.log10_q);
            assert!(motion.state.iter().all(|x| (x[0] - 0.7).abs() < 1e-12 && x[1].abs() + x[2].abs() < 1e-9));
        }
    }

    #[test]
    fn unusual_records_give_finite_numbers() {
        let staircase: Vec<f64> = (0..6000).map(|k| f64::from(k / 700) * LSB).collect();
        let chatter: Vec<f64> = (0..6000).map(|k| f64::from(k % 2) * LSB).collect();
        let jump: Vec<f64> = (0..6000).map(|k| if k < 3000 { 0.0 } else { 1.0 }).collect();
        let rest_then_swing: Vec<f64> =
            (0..6000).map(|k| if k < 4000 { 0.0 } else { ((0.03 * f64::from(k)).sin() / LSB).round() * LSB }).collect();
        for (name, z) in [("staircase", staircase), ("chatter", chatter), ("jump", jump), ("swing", rest_then_swing)] {
            for rate in [10.0, 100.0, 2000.0] {
                let t: Vec<f64> = (0..6000).map(|k| f64::from(k) / rate).collect();
                assert_sane(name, &smooth_by_gcv(&t, &z, VARIANCE).unwrap());
                let doubled: Vec<f64> = (0..6000).map(|k| f64::from(k / 3) / rate).collect();
                assert_sane(name, &smooth_by_gcv(&doubled, &z, VARIANCE).unwrap());
                let holed: Vec<f64> = t.iter().map(|t| if *t > 1.0 { t + 30.0 } else { *t }).collect();
                let motion = smooth_by_gcv(&holed, &z, VARIANCE).unwrap();
                assert_sane(name, &motion);
                assert!(motion.covariance_at(16.0).unwrap().iter().all(|p| p.is_finite()));
            }
        }
        let fastest = smooth_by_gcv(&[0.0, 1e-9, 2e-9, 3e-9, 4e-9, 5e-9, 6e-9, 1.0], &[0.0; 8], 1e-9).unwrap();
        assert_sane("nanoseconds", &fastest);
    }

    #[test]
    fn the_covariance_grows_inside_a_gap() {
        let t: Vec<f64> = (0..1000).map(|k| f64::from(k) * 0.01 + if k < 500 { 0.0 } else { 3.0 }).collect();
        let z: Vec<f64> = t.iter().map(|t| (2.0 * t).sin()).collect();
        let motion = smooth(&t, &z, VARIANCE, 3.0).unwrap();
        let deviation = |t: f64| motion.covariance_at(t).unwrap()[0].sqrt();
        assert!(deviation(6.5) > 30.0 * deviation(5.2) && deviation(5.2) > 2.0 * deviation(4.0), "{}", deviation(6.5));
        assert!(((motion.at(6.5).unwrap()[0] - 13f64.sin()) / deviation(6.5)).abs() < 3.0);
    }

    #[test]
    fn bad_input_is_an_error_that_says_where() {
        let t: Vec<f64> = (0..20).map(f64::from).collect();
        let z = vec![0.0; 20];
        assert_eq!(smooth_by_gcv(&t[..7], &z[..7], 1.0).unwrap_err(), SmoothError::TooShort { samples: 7 });
        assert_eq!(smooth_by_gcv(&t, &z[..9], 1.0).unwrap_err(), SmoothError::Lengths { stamps: 20, values: 9 });
        let with = |row: usize, value: f64, x: &[f64]| {
            let mut x = x.to_vec();
            x[row] = value;
            x
        };
        assert_eq!(smooth(&t, &with(4, f64::NAN, &z), 1.0, 0.0).unwrap_err(), SmoothError::NotFinite { row: 4 });
        assert_eq!(smooth(&with(4, 1.5, &t), &z, 1.0, 0.0).unwrap_err(), SmoothError::GoesBack { row: 4 });
        assert_eq!(smooth(&[3.0; 20], &z, 1.0, 0.0).unwrap_err(), SmoothError::NoDuration);
        for (variance, log10_q) in [(0.0, 1.0), (f64::NAN, 1.0), (1.0, f64::INFINITY), (1.0, f64::NAN), (1.0, 400.0)] {
            assert_eq!(smooth(&t, &z, variance, log10_q).unwrap_err(), SmoothError::Setting);
        }
    }
}
