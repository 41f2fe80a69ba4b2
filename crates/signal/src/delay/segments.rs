//! Checks whether the delay is constant over the record.

use super::block::Block;
use super::block::Lateness;
use super::descent::Alignment;
use super::{DelayFit, LEAST_SAMPLES, Measurement};

/// The delay in one segment of the record.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SegmentDelay {
    /// Middle of the segment, s.
    pub middle_s: f64,
    /// Delay, s; excludes the part explained by the skew of the fit, if it has one.
    pub delay_s: f64,
    /// Its standard uncertainty, s.
    pub standard_uncertainty_s: f64,
}

/// The delay in windows of `window_s` seconds that overlap by `overlap` (0 to below 1) of their length, starting at the
/// first used row. A last window that would be shorter is skipped, as is a window without enough samples or movement.
/// Each window fits its own gain, offset and drift; the noise is that of the whole. Uncertainties are from the
/// curvature, times the ratio of the whole fit's uncertainty to its curvature's.
#[must_use]
pub fn delay_by_segment(components: &[Measurement], fit: &DelayFit, window_s: f64, overlap: f64) -> Vec<SegmentDelay> {
    let stamps = || fit.components.iter().flat_map(|c| c.t_used.first().into_iter().chain(c.t_used.last()));
    let first = stamps().copied().fold(f64::INFINITY, f64::min);
    let last = stamps().copied().fold(f64::NEG_INFINITY, f64::max);
    let most = fit.components.iter().map(|c| c.t_used.len()).max().unwrap_or(0);
    let step_s = window_s * (1.0 - overlap.clamp(0.0, 0.99));
    if !(window_s > 0.0 && first < last && most > 1) {
        return vec![];
    }
    // A record of n samples lasts n intervals; the last one has only a start.
    let length_s = (last - first) * most as f64 / (most - 1) as f64;
    let windows = ((length_s - window_s) / step_s + 1e-6).floor();
    if windows < 0.0 {
        return vec![];
    }
    (0..=windows.min(1e5) as usize)
        .filter_map(|k| segment(components, fit, first + step_s * k as f64, window_s))
        .collect()
}

fn segment(components: &[Measurement], fit: &DelayFit, from: f64, window_s: f64) -> Option<SegmentDelay> {
    let mut measurements = vec![];
    let mut blocks = vec![];
    for (m, f) in components.iter().zip(&fit.components) {
        let (a, b) = (f.t_used.partition_point(|t| *t < from), f.t_used.partition_point(|t| *t < from + window_s));
        if b - a >= LEAST_SAMPLES {
            measurements.push(*m);
            blocks.push(Block::new(m, f.used_rows[a..b].to_vec(), &f.noise, Some(&f.weights[a..b]), 1));
        }
    }
    let mut alignment = Alignment { measurements: &measurements, blocks, middle_s: fit.middle_s };
    if alignment.blocks.is_empty() {
        return None;
    }
    let start = Lateness { delay_s: fit.delay_s, skew: fit.skew.map_or(0.0, |s| s.value) };
    let descent = alignment.descend(start, 1e-3).filter(|d| d.converged && d.normal.follows())?;
    let inflation = if fit.hessian_s > 0.0 { fit.standard_uncertainty_s / fit.hessian_s } else { 1.0 };
    let standard_uncertainty_s = descent.hessian_s * inflation;
    standard_uncertainty_s.is_finite().then_some(SegmentDelay {
        middle_s: from + 0.5 * window_s,
        delay_s: descent.at.delay_s,
        standard_uncertainty_s,
    })
}

/// Chi-squared of the hypothesis that all (non-overlapping) segments have one delay, and the probability of a value at
/// least as large by chance; `None` with fewer than two.
#[must_use]
pub fn homogeneity(segments: &[SegmentDelay]) -> Option<(f64, f64)> {
    if segments.len() < 2 {
        return None;
    }
    let weight = |s: &SegmentDelay| s.standard_uncertainty_s.powi(-2);
    let total: f64 = segments.iter().map(weight).sum();
    let mean = segments.iter().map(|s| weight(s) * s.delay_s).sum::<f64>() / total;
    let chi2: f64 = segments.iter().map(|s| weight(s) * (s.delay_s - mean).powi(2)).sum();
    chi2.is_finite().then(|| (chi2, crate::chi_squared_tail(chi2, (segments.len() - 1) as f64)))
}
