//! Gaps of the encoder: the smoother continues the motion, but it was not measured.

use crate::kinematics::BarState;

/// A step between samples longer than this share of the swing's period is a gap, and so is one of a second.
const OF_PERIOD: f64 = 0.25;
const LONGEST_S: f64 = 1.0;
/// A slow encoder does not consist of gaps only.
const OF_USUAL_STEP: f64 = 3.0;
/// Samples this close to a gap are also rejected, s: the motion is hardly known at its edges.
const EDGE_S: f64 = 0.1;

/// Gaps of an encoder with samples at `t` (s), rising: the instants before and after each. `states`: motion there.
pub(crate) fn gaps<'a>(t: &[f64], states: impl Iterator<Item = &'a [f64; 4]> + Clone) -> Vec<(f64, f64)> {
    let mean_square = |k: usize, about: f64| states.clone().map(|s| (s[k] - about).powi(2)).sum::<f64>();
    let mean = states.clone().map(|s| s[0]).sum::<f64>() / t.len().max(1) as f64;
    let rms_frequency_hz = (mean_square(1, 0.0) / mean_square(0, mean)).sqrt() / std::f64::consts::TAU;
    let of_period_s = if rms_frequency_hz > 0.0 { OF_PERIOD / rms_frequency_hz } else { LONGEST_S };
    let usual_s = signal::median_step(t).unwrap_or(0.0);
    let limit_s = of_period_s.min(LONGEST_S).max(OF_USUAL_STEP * usual_s);
    t.windows(2).filter(|w| w[1] - w[0] > limit_s).map(|w| (w[0], w[1])).collect()
}

/// Timestamps of a channel whose true instant is within a gap.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Hidden<'a> {
    pub(crate) gaps: &'a [(f64, f64)],
    /// Smallest and largest delay of the channel, s.
    pub(crate) delay_s: (f64, f64),
}

impl<'a> Hidden<'a> {
    /// With the delay at which the channel was aligned with the motion, good to a few milliseconds; without it, any
    /// delay of the search. After another such delay the effect of the gap on a lag has decayed.
    pub(crate) fn of(gaps: &'a [(f64, f64)], coarse_delay_s: Option<f64>, search_s: (f64, f64)) -> Hidden<'a> {
        let about = |d: f64| (d - EDGE_S, d + d.abs().max(EDGE_S));
        Hidden { gaps, delay_s: coarse_delay_s.map_or(search_s, about) }
    }

    /// Whether the true instant of a sample with timestamp `t` (s) is within a gap.
    pub(crate) fn hides(&self, t: f64) -> bool {
        self.gaps.iter().any(|(before, after)| t > before + self.delay_s.0 && t < after + self.delay_s.1)
    }
}

/// Whether an instant lies within a gap.
pub(crate) fn contains(gaps: &[(f64, f64)], t: f64) -> bool {
    gaps.iter().any(|(before, after)| t > *before && t < *after)
}

/// A state, unless it is within a gap.
pub(crate) fn outside(gaps: &[(f64, f64)], t: f64, state: Option<BarState>) -> Option<BarState> {
    state.filter(|_| !contains(gaps, t))
}
