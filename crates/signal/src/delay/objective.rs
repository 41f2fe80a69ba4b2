//! The objective as a curve.

use super::block::Block;
use super::block::Lateness;
use super::descent::Alignment;
use super::{DelayFit, Measurement};

/// −2 log likelihood (without its constants) at each of `delays` (s), gain, offset and drift profiled out; noise,
/// weights and skew as in `fit`. The rows are those of the fit that lie within the reference for all requested delays
/// (all rows of the fit if that would leave less than half of them), so that the curve has no steps.
#[must_use]
pub fn delay_objective(components: &[Measurement], fit: &DelayFit, delays: &[f64]) -> Vec<f64> {
    let (mut alignment, skew) = aligned(components, fit, delays, usize::MAX, 0);
    delays.iter().map(|&delay_s| alignment.normal(&Lateness { delay_s, skew }).rss).collect()
}

/// [`delay_objective`] relative to its value at the delay of the fit, from at most `most_samples` of each component.
/// Fewer samples carry less information about the delay; the curve is scaled up accordingly.
#[must_use]
pub fn delay_objective_above(
    components: &[Measurement],
    fit: &DelayFit,
    delays: &[f64],
    most_samples: usize,
) -> Vec<f64> {
    let mut all = delays.to_vec();
    all.push(fit.delay_s);
    let (mut few, skew) = aligned(components, fit, &all, most_samples, 0);
    let here = Lateness { delay_s: fit.delay_s, skew };
    let least = few.normal(&here).rss;
    let longest = fit.components.iter().map(|c| c.t_used.len()).max().unwrap_or(0);
    let information = |most: usize| aligned(components, fit, &all, most, 1).0.normal(&here).hessian[0][0];
    let stretch = if longest > most_samples { information(usize::MAX) / information(most_samples) } else { 1.0 };
    let stretch = if stretch.is_finite() && stretch > 0.0 { stretch } else { 1.0 };
    delays.iter().map(|&delay_s| stretch * (few.normal(&Lateness { delay_s, skew }).rss - least)).collect()
}

/// The rows of the fit that lie within the reference for all `delays`, every n-th of them, and the skew of the fit.
fn aligned<'a>(
    components: &'a [Measurement<'a>],
    fit: &DelayFit,
    delays: &[f64],
    most_samples: usize,
    derivatives: usize,
) -> (Alignment<'a>, f64) {
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
        let every = kept.len().div_ceil(most_samples.max(1)).max(1);
        kept = kept.into_iter().step_by(every).collect();
        let weights: Vec<f64> = kept.iter().map(|&k| f.weights[k]).collect();
        let held_back = weights.iter().any(|w| *w < 1.0).then_some(weights.as_slice());
        Block::new(m, kept.iter().map(|&k| f.used_rows[k]).collect(), &f.noise, held_back, derivatives)
    });
    let alignment = Alignment { measurements: components, blocks: blocks.collect(), middle_s: fit.middle_s };
    (alignment, skew)
}
