//! Noise that wanders, and a filter to whiten it.

use crate::log_product::LogProduct;

/// Stationary noise: an Ornstein–Uhlenbeck process plus white noise, in the unit of the series.
///
/// Covariance of the samples i and j: `wander_std² exp(−|tᵢ − tⱼ| / time_constant_s) + white_std² δᵢⱼ`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseModel {
    /// Standard deviation of the wander; 0 for white noise only.
    pub wander_std: f64,
    /// Its correlation time, s. Meaningless if `wander_std` is 0.
    pub time_constant_s: f64,
    /// Standard deviation of the white part.
    pub white_std: f64,
}

impl NoiseModel {
    /// White noise only.
    #[must_use]
    pub fn white(std: f64) -> NoiseModel {
        NoiseModel { wander_std: 0.0, time_constant_s: 1.0, white_std: std }
    }

    /// Standard deviation of one sample.
    #[must_use]
    pub fn std(&self) -> f64 {
        self.wander_std.hypot(self.white_std)
    }
}

/// Whitens columns of samples at the timestamps `t` under `noise`, in place: multiplies each by the inverse of the
/// lower Cholesky factor of the noise's covariance. Returns the logarithm of the determinant of the covariance.
///
/// Exact for any timestamps, in O(n): a scalar Kalman filter predicts the wander from the past. The remainder over its
/// standard deviation is white (design note 3.5).
///
/// ```
/// use signal::{NoiseModel, whiten};
/// let noise = NoiseModel { wander_std: 3.0, time_constant_s: 2.0, white_std: 4.0 };
/// let mut column = vec![10.0, 10.0];
/// let log_det = whiten(&[0.0, 0.5], &mut [&mut column], &noise);
/// let shared = 9.0 * (-0.25f64).exp();
/// assert!((column[0] - 10.0 / 5.0).abs() < 1e-12);
/// assert!((log_det - (25.0 * 25.0 - shared * shared).ln()).abs() < 1e-12);
/// ```
pub fn whiten(t: &[f64], columns: &mut [&mut [f64]], noise: &NoiseModel) -> f64 {
    let filter = WhiteningFilter::new(t, noise, None);
    for column in columns {
        filter.apply([column]);
    }
    filter.log_det
}

/// State of the filter at one sample.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Step {
    /// Share of the innovation that is wander.
    pub(crate) gain: f64,
    /// Decay of the wander to the next sample.
    pub(crate) decay: f64,
    /// One over the standard deviation of the innovation.
    pub(crate) weight: f64,
}

/// The steps of the filter, sample by sample. The decay of recurring intervals is cached, and once nothing changes any
/// more the last step is reused.
pub(crate) struct Steps {
    noise: NoiseModel,
    /// Variance of the unknown part of the wander before the sample.
    known: f64,
    last: Step,
    pub(crate) variance: f64,
    interval: f64,
    steady: bool,
}

impl Steps {
    pub(crate) fn new(noise: &NoiseModel) -> Steps {
        let last = Step { gain: 0.0, decay: 0.0, weight: 0.0 };
        let known = noise.wander_std * noise.wander_std;
        Steps { noise: *noise, known, last, variance: 1.0, interval: f64::NAN, steady: false }
    }

    /// The step of the next sample. `interval` (s) is the time to the sample after it (infinite for the last one); its
    /// variance is divided by `weight`.
    #[inline]
    pub(crate) fn next(&mut self, interval: f64, weight: Option<f64>) -> Step {
        let same = interval == self.interval || (interval - self.interval).abs() <= SAME * interval;
        if self.steady && same {
            return self.last;
        }
        let (wander, white) =
            (self.noise.wander_std * self.noise.wander_std, self.noise.white_std * self.noise.white_std);
        if !same {
            self.interval = interval;
            self.last.decay = if wander > 0.0 { (-interval / self.noise.time_constant_s).exp() } else { 0.0 };
        }
        let decay = self.last.decay;
        let before = self.known;
        let variance = (before + white) / weight.unwrap_or(1.0);
        let gain = before / variance;
        self.known = wander + decay * decay * ((1.0 - gain) * before - wander);
        self.last = Step { gain, decay, weight: 1.0 / variance.sqrt() };
        self.variance = variance;
        self.steady = same && weight.is_none() && (self.known - before).abs() <= 1e-16 * before;
        self.last
    }
}

/// The whitening of one set of timestamps under one noise, for any number of columns.
#[derive(Debug, Clone)]
pub(crate) struct WhiteningFilter {
    steps: Vec<Step>,
    white: bool,
    /// Logarithm of the determinant of the covariance.
    pub(crate) log_det: f64,
}

/// Intervals that differ by less than this share use the same decay.
const SAME: f64 = 1e-10;

impl WhiteningFilter {
    /// `weights` (0 to 1) multiply the square of a whitened row: the variance of that innovation counts as
    /// proportionally larger, and the wander learns proportionally less from it.
    pub(crate) fn new(t: &[f64], noise: &NoiseModel, weights: Option<&[f64]>) -> WhiteningFilter {
        let mut determinant = LogProduct::default();
        let mut all = Steps::new(noise);
        let steps = (0..t.len())
            .map(|k| {
                let interval = t.get(k + 1).map_or(f64::INFINITY, |next| next - t[k]);
                let step = all.next(interval, weights.map(|w| w[k]));
                determinant.times(all.variance);
                step
            })
            .collect();
        WhiteningFilter { steps, white: noise.wander_std == 0.0, log_det: determinant.sum() }
    }

    /// Whitens `N` columns in parallel, which hides the latency of one multiplication with the next column's.
    pub(crate) fn apply<const N: usize>(&self, columns: [&mut [f64]; N]) {
        if self.white {
            for column in columns {
                for (x, step) in column.iter_mut().zip(&self.steps) {
                    *x *= step.weight;
                }
            }
            return;
        }
        let mut wander = [0.0; N];
        for (k, step) in self.steps.iter().enumerate() {
            for j in 0..N {
                let innovation = columns[j][k] - wander[j];
                columns[j][k] = innovation * step.weight;
                wander[j] = step.decay * (wander[j] + step.gain * innovation);
            }
        }
    }

    /// [`WhiteningFilter::apply`] for a number of columns known only at run time.
    pub(crate) fn apply_all(&self, columns: &mut [Vec<f64>]) {
        match columns {
            [a, b, c] => self.apply([a, b, c]),
            [a, b] => self.apply([a, b]),
            columns => columns.iter_mut().for_each(|c| self.apply([c])),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `whitening_ou_white` of the project's acceptance vectors.
    #[test]
    fn six_irregular_samples_are_whitened_as_in_the_acceptance_vector() {
        let vectors: serde_json::Value = serde_json::from_str(include_str!("../tests/delay_vectors.json")).unwrap();
        let case = &vectors["whitening_ou_white"];
        let numbers = |key: &str| -> Vec<f64> { serde_json::from_value(case[key].clone()).unwrap() };
        let number = |key: &str| case[key].as_f64().unwrap();
        let noise = NoiseModel { wander_std: number("s_ou"), time_constant_s: number("Tc"), white_std: number("s_w") };
        let mut x = numbers("x");
        let log_det = whiten(&numbers("t"), &mut [&mut x], &noise);
        for (found, expected) in x.iter().zip(numbers("whitened")) {
            assert!((found - expected).abs() < 1e-12, "{found} instead of {expected}");
        }
        assert!((log_det - number("logdet_C")).abs() < 1e-12, "{log_det}");
    }

    #[test]
    fn columns_are_whitened_in_parallel_as_one_by_one() {
        let t: Vec<f64> = (0..50).map(|k| 0.1 * f64::from(k) + 0.01 * f64::from(k % 3)).collect();
        let noise = NoiseModel { wander_std: 0.3, time_constant_s: 1.0, white_std: 0.1 };
        let filter = WhiteningFilter::new(&t, &noise, None);
        let column = |phase: f64| -> Vec<f64> { t.iter().map(|t| (t + phase).sin()).collect() };
        let mut together = [column(0.0), column(1.0), column(2.0)];
        filter.apply_all(&mut together);
        for (j, whitened) in together.iter().enumerate() {
            let mut alone = column(j as f64);
            filter.apply([&mut alone]);
            assert_eq!(&alone, whitened);
        }
    }
}
