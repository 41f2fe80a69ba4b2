//! The integral of velocity over the recent past.

use std::collections::VecDeque;

#[derive(Debug, Clone, Copy)]
struct Knot {
    t: f64,
    v: f64,
    integral: f64,
}

/// `I(t) = ∫ v dτ` from the first sample, with `v` linear between samples and constant after the newest one, kept for a
/// given time. It uses the same operations as [`signal::CumulativeIntegral`], so it gives the same bits.
#[derive(Debug, Clone)]
pub(crate) struct VelocityIntegral {
    keep_s: f64,
    knots: VecDeque<Knot>,
    /// Velocity before the first sample, m/s: the first one if warm, zero if cold.
    before: f64,
    whole: bool,
}

impl VelocityIntegral {
    /// Empty; will keep the last `keep_s` seconds.
    pub(crate) fn new(keep_s: f64) -> VelocityIntegral {
        VelocityIntegral { keep_s, knots: VecDeque::new(), before: 0.0, whole: true }
    }

    /// Takes the first sample; `before` is the velocity before it.
    pub(crate) fn start(&mut self, t: f64, v: f64, before: f64) {
        self.knots.clear();
        self.knots.push_back(Knot { t, v, integral: 0.0 });
        (self.before, self.whole) = (before, true);
    }

    /// Timestamp of the newest sample, s.
    pub(crate) fn newest(&self) -> Option<f64> {
        self.knots.back().map(|k| k.t)
    }

    /// Start of the stored range, s; minus infinity as long as nothing was dropped.
    pub(crate) fn known_from(&self) -> f64 {
        if self.whole { f64::NEG_INFINITY } else { self.knots.front().map_or(f64::NEG_INFINITY, |k| k.t) }
    }

    /// Takes the next sample, later than the newest.
    pub(crate) fn push(&mut self, t: f64, v: f64) {
        let integral = self.knots.back().map_or(0.0, |k| k.integral + 0.5 * (k.v + v) * (t - k.t));
        self.knots.push_back(Knot { t, v, integral });
        while self.knots.len() > 2 && self.knots[1].t <= t - self.keep_s {
            self.knots.pop_front();
            self.whole = false;
        }
    }

    /// `I(t)`, m; `None` before the stored range.
    pub(crate) fn at(&self, t: f64) -> Option<f64> {
        let (first, last) = (self.knots.front()?, self.knots.back()?);
        if t >= last.t {
            return Some(last.integral + (t - last.t) * last.v);
        }
        if t < first.t {
            return self.whole.then_some(self.before * (t - first.t));
        }
        // With even steps the first guess is right, with uneven ones the search walks.
        let share = (t - first.t) / (last.t - first.t);
        let mut k = ((share * (self.knots.len() - 1) as f64) as usize).min(self.knots.len() - 2);
        while self.knots[k].t > t {
            k -= 1;
        }
        while self.knots[k + 1].t <= t {
            k += 1;
        }
        let (a, b) = (self.knots[k], self.knots[k + 1]);
        let (d, slope) = (t - a.t, (b.v - a.v) / (b.t - a.t));
        Some(a.integral + d * (a.v + 0.5 * slope * d))
    }
}
