//! Measured values overlaid on the reference: without offset, drift and slow wander, at the fitted delay and at others.

use crate::curves::curve;
use record::{Overlay, ShiftCurve, WanderTaken};
use signal::{ComponentFit, Reference};
use std::f64::consts::TAU;

/// Minimum range of the shifts to either side, s.
const LEAST_SHIFT_S: f64 = 0.5;
/// Range above the fitted delay, s.
const BEYOND_DELAY_S: f64 = 0.2;
/// Step between shifts, s.
const STEP_S: f64 = 0.005;
/// Number of rows sufficient for an rms.
const MOST_ROWS: usize = 4000;
/// Periods of the swing in the window of the slow wander.
const PERIODS: f64 = 4.0;
/// Rows per second of the drawn reference.
const REFERENCE_HZ: f64 = 100.0;

/// One fitted component, and its view.
pub(crate) struct Laid<'a> {
    pub(crate) reference: &'a dyn Reference,
    pub(crate) fit: &'a ComponentFit,
    pub(crate) delay_s: f64,
    /// Drawn segment, s.
    pub(crate) zoom: (f64, f64),
    /// Mean period of the bar's angle, s.
    pub(crate) period_s: f64,
}

impl Laid<'_> {
    pub(crate) fn overlay(&self) -> Overlay {
        let wanders = self.fit.noise.wander_std > 0.0 && self.period_s > 0.0;
        let window_s = if wanders { PERIODS * self.period_s } else { f64::INFINITY };
        let wander = slow_part(&self.fit.t_used, &self.fit.residuals, &self.fit.weights, window_s);
        let (start, end) = self.zoom;
        let rows = self.rows_between(start, end);
        let measured: Vec<f64> = rows.clone().map(|k| self.without_offset(k) - wander[k]).collect();
        let reach = self.reach_s();
        Overlay {
            reference: self.reference_between(start - reach, end + reach),
            measured: curve("measured", &self.fit.t_used[rows.clone()], &measured),
            wander: wanders.then(|| WanderTaken {
                window_s,
                rms: significant(rms(wander.iter().copied())),
                range_in_view: significant(range(&wander[rows])),
            }),
            shifts: self.shifts(reach, window_s),
        }
    }

    fn rows_between(&self, start: f64, end: f64) -> std::ops::Range<usize> {
        let t = &self.fit.t_used;
        t.partition_point(|&x| x < start)..t.partition_point(|&x| x <= end)
    }

    /// Largest shift, s: a whole number of steps.
    fn reach_s(&self) -> f64 {
        let least = LEAST_SHIFT_S.max(self.delay_s.abs() + BEYOND_DELAY_S);
        (least / STEP_S - 1e-9).ceil() * STEP_S
    }

    fn reference_between(&self, start: f64, end: f64) -> record::Curve {
        let (first, last) = self.reference.span();
        let steps = ((end - start) * REFERENCE_HZ).floor().max(0.0) as usize;
        let grid = (0..=steps).map(|k| start + k as f64 / REFERENCE_HZ).filter(|t| (first..=last).contains(t));
        let (t, r): (Vec<f64>, Vec<f64>) = grid.map(|t| (t, self.reference.value_and_rate(t).0)).unzip();
        curve("reference", &t, &r)
    }

    /// Measured minus fitted offset and drift: the scaled, delayed reference and noise.
    fn without_offset(&self, row: usize) -> f64 {
        self.fit.residuals[row] + self.scaled(self.fit.t_used[row] - self.delay_s)
    }

    fn scaled(&self, t: f64) -> f64 {
        self.fit.gain.value * self.reference.value_and_rate(t).0
    }

    /// The same rows at every shift: those whose shifted instant is always within the reference.
    fn shifts(&self, reach: f64, window_s: f64) -> ShiftCurve {
        let (first, last) = self.reference.span();
        let rows = self.rows_between(first + reach, last - reach);
        let every = rows.len().div_ceil(MOST_ROWS).max(1);
        let rows: Vec<usize> = rows.step_by(every).collect();
        let t: Vec<f64> = rows.iter().map(|&k| self.fit.t_used[k]).collect();
        let weights: Vec<f64> = rows.iter().map(|&k| self.fit.weights[k]).collect();
        let measured: Vec<f64> = rows.iter().map(|&k| self.without_offset(k)).collect();
        let steps = if rows.is_empty() { 0 } else { (2.0 * reach / STEP_S).round() as usize + 1 };
        let left = |shift: f64| {
            let e: Vec<f64> = t.iter().zip(&measured).map(|(&t, y)| y - self.scaled(t - shift)).collect();
            let slow = slow_part(&t, &e, &weights, window_s);
            rms(e.iter().zip(slow).map(|(e, slow)| e - slow))
        };
        let rms = (0..steps).map(|k| significant(left(k as f64 * STEP_S - reach))).collect();
        ShiftCurve { from_s: -reach, step_s: STEP_S, rms }
    }
}

/// Mean of `e` around each timestamp with a Hann window of full width `window_s`, by running sums; the plain mean for
/// an infinite window.
fn slow_part(t: &[f64], e: &[f64], weights: &[f64], window_s: f64) -> Vec<f64> {
    let half = 0.5 * window_s;
    let omega = if window_s.is_finite() { TAU / window_s } else { 0.0 };
    // (1 + cos ω(t − t₀))/2 splits into sums that do not depend on t₀.
    let terms = t.iter().zip(e).zip(weights).map(|((&t, &e), &w)| {
        let (sin, cos) = (omega * t).sin_cos();
        [w * e, w * e * cos, w * e * sin, w, w * cos, w * sin]
    });
    let mut sums = vec![[0.0; 6]];
    for term in terms {
        let last = sums[sums.len() - 1];
        sums.push(std::array::from_fn(|i| last[i] + term[i]));
    }
    let mean = |&at: &f64| {
        let (from, to) = (t.partition_point(|&x| x < at - half), t.partition_point(|&x| x <= at + half));
        let s: [f64; 6] = std::array::from_fn(|i| sums[to][i] - sums[from][i]);
        let (sin, cos) = (omega * at).sin_cos();
        let weight = s[3] + cos * s[4] + sin * s[5];
        if weight > 0.0 { (s[0] + cos * s[1] + sin * s[2]) / weight } else { 0.0 }
    };
    t.iter().map(mean).collect()
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0u32), |(sum, n), v| (sum + v * v, n + 1));
    if n == 0 { 0.0 } else { (sum / f64::from(n)).sqrt() }
}

fn range(values: &[f64]) -> f64 {
    let (low, high) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), &v| (l.min(v), h.max(v)));
    if high >= low { high - low } else { 0.0 }
}

/// Five significant digits: the resolution of a figure.
fn significant(value: f64) -> f64 {
    format!("{value:.4e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slow_ramp_is_removed_and_the_swing_remains() {
        let t: Vec<f64> = (0..6000).map(|k| f64::from(k) * 0.01).collect();
        let period = 1.7;
        let swing: Vec<f64> = t.iter().map(|t| (TAU * t / period).sin()).collect();
        let e: Vec<f64> = t.iter().zip(&swing).map(|(t, s)| 0.3 * t + s).collect();
        let slow = slow_part(&t, &e, &vec![1.0; t.len()], PERIODS * period);
        for k in 400..5600 {
            assert!((slow[k] - 0.3 * t[k]).abs() < 2e-3, "{} at {}", slow[k] - 0.3 * t[k], t[k]);
        }
    }

    #[test]
    fn an_infinite_window_gives_the_weighted_mean() {
        let slow = slow_part(&[0.0, 1.0, 2.0], &[1.0, 2.0, 100.0], &[1.0, 1.0, 0.0], f64::INFINITY);
        assert_eq!(slow, [1.5; 3]);
    }
}
