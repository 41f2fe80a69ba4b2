//! Expected shape of a channel for any rig: combinations of functions of the encoder's angle alone.
//!
//! Sign, zero, azimuth, lever arm, bias and scale all enter these combinations as coefficients, so a channel can be
//! aligned in time and used as evidence before any of them is known.

use crate::gap::Hidden;
use crate::kinematics::BarState;
use crate::motion::Motion;
use signal::{Regression, least_between, orthonormal, regress, residuals_of, sum_of_squares};

/// Functions of the bar's motion that make up a component.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Pattern {
    /// 1, sin ξ, cos ξ, t: position and height.
    CircleWithDrift,
    /// 1, sin ξ, cos ξ: magnetic field.
    Circle,
    /// 1, ξ′ sin ξ, ξ′ cos ξ: velocity.
    CircleRate,
    /// 1, ξ: swing angle.
    Angle,
    /// 1, ξ′: angular rate.
    Rate,
    /// 1, sin ξ, cos ξ, ξ″, ξ′²: specific force.
    Force,
}

impl Pattern {
    pub(crate) fn names(self) -> &'static [&'static str] {
        match self {
            Pattern::CircleWithDrift => &["offset", "sine", "cosine", "drift"],
            Pattern::Circle => &["offset", "sine", "cosine"],
            Pattern::CircleRate => &["offset", "rate · sine", "rate · cosine"],
            Pattern::Angle => &["offset", "angle"],
            Pattern::Rate => &["offset", "rate"],
            Pattern::Force => &["offset", "sine", "cosine", "acceleration", "rate²"],
        }
    }

    /// The functions at one instant, one per name. `t` is seconds from the middle of the channel.
    pub(crate) fn at(self, state: &BarState, t: f64) -> [f64; MOST_FUNCTIONS] {
        let (s, c) = state.angle.sin_cos();
        match self {
            Pattern::CircleWithDrift => [1.0, s, c, t, 0.0],
            Pattern::Circle => [1.0, s, c, 0.0, 0.0],
            Pattern::CircleRate => [1.0, state.rate * s, state.rate * c, 0.0, 0.0],
            Pattern::Angle => [1.0, state.angle, 0.0, 0.0, 0.0],
            Pattern::Rate => [1.0, state.rate, 0.0, 0.0, 0.0],
            Pattern::Force => [1.0, s, c, state.acceleration, state.rate * state.rate],
        }
    }
}

/// Maximum number of functions of a pattern.
const MOST_FUNCTIONS: usize = 5;

/// Components of a channel with their own timestamps.
#[derive(Debug, Clone)]
pub(crate) struct Samples {
    /// s after the encoder's origin.
    pub(crate) t: Vec<f64>,
    /// Each as long as `t`.
    pub(crate) components: Vec<Vec<f64>>,
}

impl Samples {
    pub(crate) fn of_rows(&self, rows: &[usize]) -> Samples {
        let of = |x: &Vec<f64>| rows.iter().map(|&row| x[row]).collect();
        Samples { t: of(&self.t), components: self.components.iter().map(of).collect() }
    }

    fn middle(&self) -> f64 {
        0.5 * (self.t.first().copied().unwrap_or(0.0) + self.t.last().copied().unwrap_or(0.0))
    }
}

/// A channel aligned with the motion.
#[derive(Debug, Clone)]
pub(crate) struct PatternFit {
    /// Best delay, s. Coarse: good to about a millisecond, without interval.
    pub(crate) delay_s: f64,
    /// Rows of the samples inside the motion at this delay.
    pub(crate) rows: Vec<usize>,
    /// The motion (not delayed) at these rows.
    pub(crate) states: Vec<BarState>,
    /// One regression for each component.
    pub(crate) fits: Vec<Regression>,
    /// For each component, the share of its variance that the pattern explains.
    pub(crate) explained: Vec<f64>,
}

/// Number of rows used on the grid and in the refinement.
const GRID_SAMPLES: usize = 400;
const REFINED_SAMPLES: usize = 2000;
const GRID_STEP_S: f64 = 0.02;
const REFINED_TO_S: f64 = 2e-5;
/// Of all minima whose residual variance is within this factor of the smallest, and that explain nine tenths of what
/// the best explains, the one with the smallest delay is taken: a regular swing repeats after each half period.
const NEARLY_AS_GOOD: f64 = 1.1;
const LEAST_SHARE_LOST: f64 = 0.1;
/// Minimum number of rows.
const LEAST_ROWS: usize = 20;

/// Aligns `samples` with the motion: the delay (within `search_s`) and the coefficients at which the pattern fits best.
/// `None` if too few rows are inside the motion, or no fit is possible.
pub(crate) fn fit_pattern(
    motion: &Motion,
    samples: &Samples,
    pattern: Pattern,
    search_s: (f64, f64),
) -> Option<PatternFit> {
    let delay_s = best_delay(motion, samples, pattern, search_s)?;
    fit_at(motion, samples, pattern, delay_s)
}

/// The coefficients at a given delay.
pub(crate) fn fit_at(motion: &Motion, samples: &Samples, pattern: Pattern, delay_s: f64) -> Option<PatternFit> {
    let (rows, states) = inside(motion, samples, delay_s);
    if rows.len() < LEAST_ROWS {
        return None;
    }
    let middle = samples.middle();
    let functions: Vec<[f64; MOST_FUNCTIONS]> =
        rows.iter().zip(&states).map(|(&row, state)| pattern.at(state, samples.t[row] - middle)).collect();
    let columns: Vec<Vec<f64>> = (0..pattern.names().len()).map(|k| functions.iter().map(|f| f[k]).collect()).collect();
    let columns: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
    let mut fits = vec![];
    let mut explained = vec![];
    for component in &samples.components {
        let y: Vec<f64> = rows.iter().map(|&row| component[row]).collect();
        let fit = regress(&columns, pattern.names(), &y).ok()?;
        let rest = fit.residuals.iter().map(|r| r * r).sum::<f64>() / y.len() as f64;
        let all = variance(&y);
        explained.push(if all > 0.0 { (1.0 - rest / all).max(0.0) } else { 0.0 });
        fits.push(fit);
    }
    Some(PatternFit { delay_s, rows, states, fits, explained })
}

fn inside(motion: &Motion, samples: &Samples, delay_s: f64) -> (Vec<usize>, Vec<BarState>) {
    samples.t.iter().enumerate().filter_map(|(row, t)| Some((row, motion.seen_at(t - delay_s)?))).unzip()
}

fn variance(y: &[f64]) -> f64 {
    let mean = y.iter().sum::<f64>() / y.len() as f64;
    y.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / y.len() as f64
}

fn best_delay(motion: &Motion, samples: &Samples, pattern: Pattern, (from, to): (f64, f64)) -> Option<f64> {
    let coarse = thinned(motion, samples, GRID_SAMPLES, (from, to));
    let steps = ((to - from) / GRID_STEP_S).round().max(1.0) as usize;
    let delays: Vec<f64> = (0..=steps).map(|k| from + (to - from) * k as f64 / steps as f64).collect();
    let misfit: Vec<f64> = delays.iter().map(|d| misfit(motion, &coarse, pattern, *d)).collect();
    let least = misfit.iter().copied().fold(f64::INFINITY, f64::min);
    if !least.is_finite() {
        return None;
    }
    // The grid is too coarse to decide which of two sharp minima is lower.
    let step = (to - from) / steps as f64;
    let minima: Vec<(f64, f64)> = (0..delays.len())
        .filter(|&k| is_minimum(&misfit, k))
        .map(|k| least_between(|d| self::misfit(motion, &coarse, pattern, d), around(delays[k], step), REFINED_TO_S))
        .collect();
    let least = minima.iter().map(|m| m.1).fold(least, f64::min);
    let flat = coarse.components.iter().map(|c| variance(c).max(f64::MIN_POSITIVE).ln()).sum::<f64>()
        / coarse.components.len().max(1) as f64;
    let limit = least + NEARLY_AS_GOOD.ln().min(LEAST_SHARE_LOST * (flat - least).max(0.0));
    let near = minima.iter().filter(|m| m.1 <= limit).min_by(|a, b| a.0.abs().total_cmp(&b.0.abs()))?.0;
    let fine = thinned(motion, samples, REFINED_SAMPLES, (from, to));
    let refined = least_between(|d| self::misfit(motion, &fine, pattern, d), around(near, 0.25 * step), REFINED_TO_S);
    Some(refined.0)
}

fn around(middle: f64, half: f64) -> (f64, f64) {
    (middle - half, middle + half)
}

fn is_minimum(misfit: &[f64], k: usize) -> bool {
    let lower_than = |other: Option<&f64>| other.is_none_or(|o| misfit[k] <= *o);
    lower_than(k.checked_sub(1).map(|b| &misfit[b])) && lower_than(misfit.get(k + 1))
}

/// At most `most` rows, evenly spread over those inside the motion at every delay of the search.
fn thinned(motion: &Motion, samples: &Samples, most: usize, (from, to): (f64, f64)) -> Samples {
    let (first, last) = motion.span();
    let always: Vec<usize> =
        (0..samples.t.len()).filter(|&r| samples.t[r] - to >= first && samples.t[r] - from <= last).collect();
    let hidden = Hidden { gaps: motion.gaps(), delay_s: (from, to) };
    let seen: Vec<usize> = always.iter().copied().filter(|&r| !hidden.hides(samples.t[r])).collect();
    let always = if 2 * seen.len() >= always.len() { seen } else { always };
    let stride = always.len().div_ceil(most).max(1);
    let rows: Vec<usize> = always.into_iter().step_by(stride).collect();
    samples.of_rows(&rows)
}

/// Mean over the components of the log of the residual variance: half of −2 log likelihood per row.
fn misfit(motion: &Motion, samples: &Samples, pattern: Pattern, delay_s: f64) -> f64 {
    let n = samples.t.len();
    let width = pattern.names().len();
    if n < LEAST_ROWS.max(2 * width) {
        return f64::INFINITY;
    }
    let middle = samples.middle();
    let mut columns = vec![Vec::with_capacity(n); width];
    for t in &samples.t {
        let Some(state) = motion.at(t - delay_s) else { return f64::INFINITY };
        for (column, value) in columns.iter_mut().zip(pattern.at(&state, t - middle)) {
            column.push(value);
        }
    }
    let basis = orthonormal(&columns);
    let log_rest = |component: &Vec<f64>| {
        let rest = sum_of_squares(&residuals_of(component, &basis));
        // A channel without noise must not produce an infinite logarithm.
        (rest.max(1e-14 * sum_of_squares(component)) / n as f64).max(f64::MIN_POSITIVE).ln()
    };
    samples.components.iter().map(log_rest).sum::<f64>() / samples.components.len().max(1) as f64
}
