//! The objective above its minimum, for figures.

use crate::delay::{DelayFit, Measurement, delay_objective};

/// The curve uses the rows that lie within the reference for all its delays, the fit uses all its rows. For that reason
/// alone the curve's minimum may differ slightly from the fit. An excess above this limit is significant.
const OF_ROWS: f64 = 1.0;

/// [`delay_objective`] above its minimum at `delays` (s, rising) and at the delay of the fit, which is inserted: delays
/// (s) and excesses. The smallest excess is exactly 0, at the delay of the fit unless another delay is better by more
/// than 1.
#[must_use]
pub fn delay_excess(components: &[Measurement], fit: &DelayFit, delays: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let mut delay_s: Vec<f64> = delays.iter().copied().filter(|d| (*d - fit.delay_s).abs() > 1e-12).collect();
    let place = delay_s.partition_point(|d| *d < fit.delay_s);
    delay_s.insert(place, fit.delay_s);
    let values = delay_objective(components, fit, &delay_s);
    let least = values.iter().copied().fold(f64::INFINITY, f64::min);
    let own = values.get(place).copied().unwrap_or(least);
    let zero = if own - least < OF_ROWS { own } else { least };
    (delay_s, values.into_iter().map(|v| (v - zero).max(0.0)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{CubicSpline, DelaySettings, Gain, Sign, fit_delay};

    /// A record that loses a fifth of its rows at the ends of the search: their squares do not count towards the
    /// excess.
    #[test]
    fn the_minimum_is_zero_at_the_fit_however_many_rows_a_curve_loses() {
        let knots: Vec<f64> = (0..=1000).map(|k| 0.02 * f64::from(k)).collect();
        let truth: Vec<f64> = knots.iter().map(|t| (3.4 * t + 2.0 * (0.21 * t).sin()).sin()).collect();
        let reference = CubicSpline::new(&knots, &truth).unwrap();
        let t: Vec<f64> = (0..190).map(|k| 0.6 + 0.1 * f64::from(k)).collect();
        let noise = |k: usize| 0.1 * (1.2345 * (k * k) as f64).sin() + if k > 170 { 0.4 } else { 0.0 };
        let y: Vec<f64> = t.iter().enumerate().map(|(k, t)| reference.value(t - 0.4) + noise(k)).collect();
        let gain = Gain::Free { sign: Sign::Positive };
        let m = [Measurement { t: &t, y: &y, reference: &reference, gain, drift: false }];
        let fit = fit_delay(&m, &DelaySettings::default()).unwrap();
        let wide: Vec<f64> = (0..=50).map(|k| -1.0 + 0.05 * f64::from(k)).collect();
        let near: Vec<f64> =
            (-10..=10).map(|k| fit.delay_s + 0.5 * fit.standard_uncertainty_s * f64::from(k)).collect();
        // The former bug: zero was the objective of all rows, far above that of the curve's.
        let of_all = delay_objective(&m, &fit, &[fit.delay_s])[0];
        assert!(delay_objective(&m, &fit, &wide).iter().any(|v| *v < of_all - 5.0));
        for delays in [wide, near] {
            let (delay_s, excess) = delay_excess(&m, &fit, &delays);
            assert!(delay_s.is_sorted() && delay_s.len() == excess.len());
            let best = delay_s.iter().position(|d| *d == fit.delay_s).unwrap();
            assert_eq!((excess[best], excess.iter().copied().fold(f64::INFINITY, f64::min)), (0.0, 0.0));
            assert!(excess.iter().filter(|v| **v > 3.84).count() > excess.len() / 3, "{excess:?}");
        }
    }

    #[test]
    fn a_better_delay_elsewhere_is_the_minimum() {
        let knots: Vec<f64> = (0..=1000).map(|k| 0.02 * f64::from(k)).collect();
        let truth: Vec<f64> = knots.iter().map(|t| (3.4 * t + 2.0 * (0.21 * t).sin()).sin()).collect();
        let reference = CubicSpline::new(&knots, &truth).unwrap();
        let t: Vec<f64> = (0..150).map(|k| 2.0 + 0.1 * f64::from(k)).collect();
        let y: Vec<f64> = t.iter().map(|t| reference.value(t - 0.4) + 0.01 * (90.0 * t).sin()).collect();
        let gain = Gain::Free { sign: Sign::Positive };
        let m = [Measurement { t: &t, y: &y, reference: &reference, gain, drift: false }];
        let fit = fit_delay(&m, &DelaySettings::default()).unwrap();
        let elsewhere = DelayFit { delay_s: -0.3, ..fit };
        let (delay_s, excess) = delay_excess(&m, &elsewhere, &[0.3, 0.4, 0.5]);
        assert_eq!((delay_s[0], excess[2]), (-0.3, 0.0));
        assert!(excess[0] > 10.0, "{excess:?}");
    }
}
