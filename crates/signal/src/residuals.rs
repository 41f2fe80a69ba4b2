//! What residuals say of a fit.

/// Autocorrelation at the lags 1 to `lags` of values about their mean; empty if there are not more values than lags
/// or all are equal.
#[must_use]
pub fn autocorrelation(x: &[f64], lags: usize) -> Vec<f64> {
    let n = x.len();
    if n <= lags {
        return vec![];
    }
    let mean = x.iter().sum::<f64>() / n as f64;
    let power: f64 = x.iter().map(|v| (v - mean).powi(2)).sum();
    if power.is_nan() || power <= 0.0 {
        return vec![];
    }
    let at = |lag: usize| x[lag..].iter().zip(x).map(|(a, b)| (a - mean) * (b - mean)).sum::<f64>() / power;
    (1..=lags).map(at).collect()
}

/// p of Ljung and Box (1978): the probability that `n` white values have an autocorrelation as large as this.
#[must_use]
pub fn ljung_box(autocorrelation: &[f64], n: usize) -> f64 {
    let n = n as f64;
    let terms = autocorrelation.iter().enumerate().map(|(k, r)| r * r / (n - (k + 1) as f64));
    crate::chi_squared_tail(n * (n + 2.0) * terms.sum::<f64>(), autocorrelation.len() as f64)
}

/// Fourth moment over the square of the second, about the mean: 3 for Gaussian values. `None` if all are equal.
#[must_use]
pub fn kurtosis(x: &[f64]) -> Option<f64> {
    let n = x.len() as f64;
    let mean = x.iter().sum::<f64>() / n;
    let second = x.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n;
    let fourth = x.iter().map(|v| (v - mean).powi(4)).sum::<f64>() / n;
    (second > 0.0).then(|| fourth / (second * second))
}

/// Standard deviation (s) of the jitter of the latency, and its standard uncertainty: residuals are larger where the
/// signal is steep, `e² = noise² + jitter²·slope²` with `slope` the gain times the rate of the reference, unit/s
/// (design note 3.9). Weighted regression of e², with an uncertainty that allows for unequal and correlated terms.
///
/// `None` if the residuals do not grow with the slope by two standard uncertainties, or fewer than 30 are there.
#[must_use]
pub fn jitter_from_residuals(residuals: &[f64], slope: &[f64]) -> Option<(f64, f64)> {
    if residuals.len() != slope.len() || residuals.len() < 30 {
        return None;
    }
    let (e2, s2): (Vec<f64>, Vec<f64>) = residuals.iter().zip(slope).map(|(e, s)| (e * e, s * s)).unzip();
    let mut fitted = vec![1.0; e2.len()];
    let mut line = weighted_line(&s2, &e2, &fitted)?;
    for _ in 0..10 {
        // The variance of e² is twice the square of its mean; floored, so that no row gets an endless weight.
        let mean = (line.offset + line.slope * line.middle).max(0.0);
        for (f, x) in fitted.iter_mut().zip(&s2) {
            *f = (line.offset + line.slope * x).max(0.05 * mean);
        }
        line = weighted_line(&s2, &e2, &fitted)?;
    }
    let influence: Vec<f64> = e2
        .iter()
        .zip(&s2)
        .zip(&fitted)
        .map(|((e2, x), f)| (x - line.middle) * (e2 - line.offset - line.slope * x) / (f * f * line.spread))
        .collect();
    let error = crate::delay::bartlett_sum(&influence, crate::delay::andrews_lags(&influence)).max(0.0).sqrt();
    (line.slope > 2.0 * error).then(|| (line.slope.sqrt(), 0.5 * error / line.slope.sqrt()))
}

/// y = offset + slope·x with weights 1/size².
struct Line {
    offset: f64,
    slope: f64,
    /// Weighted mean of x, and weighted sum of squares about it.
    middle: f64,
    spread: f64,
}

fn weighted_line(x: &[f64], y: &[f64], size: &[f64]) -> Option<Line> {
    let sum = |f: &dyn Fn(usize) -> f64| (0..x.len()).map(|k| f(k) / (size[k] * size[k])).sum::<f64>();
    let weight = sum(&|_| 1.0);
    let (middle, mean) = (sum(&|k| x[k]) / weight, sum(&|k| y[k]) / weight);
    let spread = sum(&|k| (x[k] - middle).powi(2));
    let slope = sum(&|k| (x[k] - middle) * y[k]) / spread;
    slope.is_finite().then_some(Line { offset: mean - slope * middle, slope, middle, spread })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;
    use rand_pcg::Pcg64;

    fn normal(n: usize, seed: u64) -> Vec<f64> {
        let mut rng = Pcg64::seed_from_u64(seed);
        (0..n).map(|_| rng.sample::<f64, _>(StandardNormal)).collect()
    }

    #[test]
    fn an_alternating_series_has_the_autocorrelation_of_its_definition() {
        let x: Vec<f64> = (0..100).map(|k| if k % 2 == 0 { 1.0 } else { -1.0 }).collect();
        let r = autocorrelation(&x, 3);
        assert!((r[0] + 0.99).abs() < 1e-12 && (r[1] - 0.98).abs() < 1e-12 && (r[2] + 0.97).abs() < 1e-12, "{r:?}");
        assert!(autocorrelation(&[1.0; 50], 3).is_empty() && autocorrelation(&[1.0, 2.0], 2).is_empty());
    }

    /// R: `Box.test(x, lag = 3, type = "Ljung-Box")` is Q = n(n + 2) Σ r²/(n − k); chi-squared 7.815 has p = 0.05.
    #[test]
    fn ljung_box_has_p_of_the_chi_squared_table() {
        let n = 100.0_f64;
        let r1 = (7.814_727_903_251_18 * (n - 1.0) / (n * (n + 2.0))).sqrt();
        assert!((ljung_box(&[r1, 0.0, 0.0], 100) - 0.05).abs() < 1e-9);
    }

    #[test]
    fn white_values_pass_and_a_moving_mean_fails_the_test_for_whiteness() {
        let x = normal(2000, 1);
        let smooth: Vec<f64> = x.windows(2).map(|w| w[0] + w[1]).collect();
        let p = |x: &[f64]| ljung_box(&autocorrelation(x, 20), x.len());
        assert!(p(&x) > 1e-3 && p(&smooth) < 1e-9, "{} {}", p(&x), p(&smooth));
    }

    #[test]
    fn kurtosis_is_one_for_two_values_and_three_for_gauss() {
        assert!((kurtosis(&[1.0, -1.0, 1.0, -1.0]).unwrap() - 1.0).abs() < 1e-12);
        // Standard error √(24/n) = 0.022; gate at 4.5 of them.
        assert!((kurtosis(&normal(50_000, 2)).unwrap() - 3.0).abs() < 0.1);
        assert_eq!(kurtosis(&[2.0; 9]), None);
    }

    /// Design note 3.9: 6 ms are found as 5.99 ± 0.18 ms from 3000 samples with 0.01 m of noise.
    #[test]
    fn six_milliseconds_of_jitter_are_found_with_an_honest_uncertainty() {
        let (trials, n) = (60, 3000);
        let slope: Vec<f64> =
            (0..n).map(|k| 3.0 * (0.07 * f64::from(k)).cos() + (0.031 * f64::from(k)).sin()).collect();
        let (mut mean, mut square) = (0.0, 0.0);
        for trial in 0..trials {
            let (late, noise) = (normal(n as usize, 100 + trial), normal(n as usize, 900 + trial));
            let e: Vec<f64> = (0..n as usize).map(|k| 0.006 * slope[k] * late[k] + 0.01 * noise[k]).collect();
            let (jitter, error) = jitter_from_residuals(&e, &slope).unwrap();
            assert!(error < 3e-4, "{error}");
            mean += (jitter - 0.006) / error / trials as f64;
            square += ((jitter - 0.006) / error).powi(2) / trials as f64;
        }
        // Mean of 60 standard normal numbers: 0.13; their mean square: 1 ± 0.18. Gates at 3.5 of these.
        assert!(mean.abs() < 0.45 && (square - 1.0).abs() < 0.65, "{mean} {square}");
    }

    #[test]
    fn without_jitter_there_is_none_to_report() {
        let slope: Vec<f64> = (0..500).map(|k| (0.07 * f64::from(k)).cos()).collect();
        let found = (0..40).filter(|s| jitter_from_residuals(&normal(500, *s), &slope).is_some()).count();
        // One in forty is expected beyond two standard uncertainties; more than five has a chance of 1 in 1000.
        assert!(found <= 5, "{found} of 40");
        assert_eq!(jitter_from_residuals(&[1.0; 10], &[1.0; 10]), None);
        assert_eq!(jitter_from_residuals(&[0.0; 100], &slope[..100]), None);
        assert_eq!(jitter_from_residuals(&[1.0; 100], &[1.0; 100]), None);
    }
}
