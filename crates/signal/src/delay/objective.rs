//! The objective as a curve.

use super::block::Block;
use super::descent::{Alignment, Lateness};
use super::{DelayFit, Measurement};

/// −2 log likelihood (without its constants) at each of `delays` (s), gain, offset and drift profiled out, noise,
/// weights and skew as in `fit`. The rows are those of the fit that lie within the reference for all delays asked for
/// (all rows of the fit, if that would leave less than half of them), so that the curve has no steps.
#[must_use]
pub fn delay_objective(components: &[Measurement], fit: &DelayFit, delays: &[f64]) -> Vec<f64> {
    let earliest = delays.iter().copied().fold(f64::INFINITY, f64::min);
    let latest = delays.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let skew = fit.skew.map_or(0.0, |s| s.value);
    let blocks = components.iter().zip(&fit.components).map(|(m, f)| {
        let (first, last) = m.reference.span();
        let instant = |t: f64, delay_s: f64| Lateness { delay_s, skew }.true_instant(t, fit.middle_s);
        let always = |k: &usize| instant(f.t_used[*k], latest) >= first && instant(f.t_used[*k], earliest) <= last;
        let mut kept: Vec<usize> = (0..f.t_used.len()).filter(always).collect();
        if 2 * kept.len() < f.t_used.len() {
            kept = (0..f.t_used.len()).collect();
        }
        let weights: Vec<f64> = kept.iter().map(|&k| f.weights[k]).collect();
        Block::new(m, kept.iter().map(|&k| f.used_rows[k]).collect(), &f.noise, Some(&weights), 0)
    });
    let mut alignment = Alignment { measurements: components, blocks: blocks.collect(), middle_s: fit.middle_s };
    delays.iter().map(|&delay_s| alignment.normal(&Lateness { delay_s, skew }).rss).collect()
}
