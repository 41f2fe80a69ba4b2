//! Measured values overlaid on the reference: without offset, drift and slow wander, at the fitted delay and at others.

use crate::curves::curve;
use record::{Overlay, ShiftCurve, WanderTaken};
use signal::{ComponentFit, HannMean, Reference};

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
        let wander = HannMean::new(&self.fit.t_used, &self.fit.weights, window_s).of(&self.fit.residuals);
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
        let shifts: Vec<f64> = (0..steps).map(|k| k as f64 * STEP_S - reach).collect();
        let slow = HannMean::new(&t, &weights, window_s);
        let rms = slow.rms_by_shift((&t, &measured), (self.reference, self.fit.gain.value), &shifts);
        let rms = rms.into_iter().map(significant).collect();
        ShiftCurve { from_s: -reach, step_s: STEP_S, rms }
    }
}

/// Root mean square; 0 without values.
pub(crate) fn rms(values: impl Iterator<Item = f64>) -> f64 {
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
