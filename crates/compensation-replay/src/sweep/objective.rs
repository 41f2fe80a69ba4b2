//! What the delay estimator minimises, as a curve.

use record::ObjectiveCurve;
use signal::{DelayFit, Measurement, delay_objective};

/// Points over the whole search, and near the minimum.
const WIDE_POINTS: usize = 51;
const NEAR_POINTS: usize = 21;
/// The near curve reaches so many standard uncertainties to either side.
const NEAR_U: f64 = 5.0;

/// −2 ln L above its least, over the search and near the minimum; noise as fitted, offsets and drifts free.
pub(crate) fn objective(measurements: &[Measurement<'_>], fit: &DelayFit, (from, to): (f64, f64)) -> ObjectiveCurve {
    let half = NEAR_U * fit.standard_uncertainty_s;
    let above = |delays: &[f64]| -> Vec<f64> {
        let mut all = delays.to_vec();
        all.push(fit.delay_s);
        let mut values = delay_objective(measurements, fit, &all);
        let least = values.pop().unwrap_or(0.0);
        values.into_iter().map(|v| v - least).collect()
    };
    let delay_s = grid(from, to, WIDE_POINTS);
    let near_delay_s = grid(fit.delay_s - half, fit.delay_s + half, NEAR_POINTS);
    ObjectiveCurve { value: above(&delay_s), near_value: above(&near_delay_s), delay_s, near_delay_s }
}

fn grid(from: f64, to: f64, points: usize) -> Vec<f64> {
    (0..points).map(|k| from + (to - from) * k as f64 / (points - 1) as f64).collect()
}
