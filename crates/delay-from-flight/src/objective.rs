//! The objective of the delay estimator, as a curve.

use record::ObjectiveCurve;
use signal::{DelayFit, Measurement, delay_objective_above};

/// Points over the whole search, and near the minimum.
const WIDE_POINTS: usize = 51;
const NEAR_POINTS: usize = 11;
/// Number of samples of a component for the curve over the whole search.
const WIDE_SAMPLES: usize = 600;
/// The near curve extends this many standard uncertainties to each side.
const NEAR_U: f64 = 5.0;

/// −2 ln L above its minimum, over the search and near the minimum; noise as fitted, offsets and drifts free.
pub(crate) fn objective(measurements: &[Measurement<'_>], fit: &DelayFit, (from, to): (f64, f64)) -> ObjectiveCurve {
    let half = NEAR_U * fit.standard_uncertainty_s;
    let delay_s = grid(from, to, WIDE_POINTS, fit.delay_s);
    let near_delay_s = grid(fit.delay_s - half, fit.delay_s + half, NEAR_POINTS, fit.delay_s);
    ObjectiveCurve {
        value: from_zero(delay_objective_above(measurements, fit, &delay_s, WIDE_SAMPLES)),
        near_value: from_zero(delay_objective_above(measurements, fit, &near_delay_s, usize::MAX)),
        delay_s,
        near_delay_s,
    }
}

/// Delays from `from` to `to`, with `best` among them.
fn grid(from: f64, to: f64, points: usize, best: f64) -> Vec<f64> {
    let mut all: Vec<f64> = (0..points).map(|k| from + (to - from) * k as f64 / (points - 1) as f64).collect();
    all.push(best);
    all.sort_unstable_by(f64::total_cmp);
    all.dedup();
    all
}

/// The same curve with its minimum at 0: with fewer samples the minimum may differ from that of the fit.
fn from_zero(mut values: Vec<f64>) -> Vec<f64> {
    let least = values.iter().copied().fold(f64::INFINITY, f64::min);
    values.iter_mut().for_each(|v| *v -= least);
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_grid_covers_the_search_evenly_with_the_best_delay_on_it() {
        assert_eq!(grid(-1.0, 3.0, 5, 0.3), [-1.0, 0.0, 0.3, 1.0, 2.0, 3.0]);
        assert_eq!(grid(-1.0, 3.0, 5, 1.0), [-1.0, 0.0, 1.0, 2.0, 3.0]);
    }

    #[test]
    fn the_least_value_becomes_zero() {
        assert_eq!(from_zero(vec![7.0, 4.0, 5.0]), [3.0, 0.0, 1.0]);
    }
}
