//! Scored items: the rows of each fix against a reference, or the step at each fix.

use super::Sweeper;
use crate::score::Reference;
use delay_from_flight::AXES;

/// ∫ y from the first sample on, linear between samples.
pub(super) fn integral(t: &[f64], y: &[f64]) -> Vec<f64> {
    let mut sum = 0.0;
    let steps = t.windows(2).zip(y.windows(2)).map(|(t, y)| 0.5 * (y[0] + y[1]) * (t[1] - t[0]));
    std::iter::once(0.0)
        .chain(steps.map(|step| {
            sum += step;
            sum
        }))
        .collect()
}

/// The rows of one fix, or the step from the previous fix.
#[derive(Debug, Clone)]
struct Item {
    /// The fix: index into the timestamps.
    at: u32,
    /// End of its rows, which start at the end of the previous item's.
    until: u32,
    /// Mean target value of the integral over the rows, north and east, m.
    mean: [f64; 2],
    /// Σ of the squared distances from that mean, m².
    scatter: f64,
}

/// Scored items, for every delay.
#[derive(Debug, Clone)]
pub(super) struct Items {
    /// Whether errors are scored, or steps from the previous timestamp.
    pub(super) against_reference: bool,
    /// Timestamps of the fixes used, rising, s.
    stamps: Vec<f64>,
    items: Vec<Item>,
    /// Target value of the integral at each row, m.
    rows: Vec<[f64; 2]>,
}

impl Items {
    pub(super) fn len(&self) -> usize {
        self.items.len()
    }

    /// Number of rows or fixes.
    pub(super) fn samples(&self) -> usize {
        self.rows.len()
    }

    fn add(&mut self, at: u32, targets: &[[f64; 2]]) {
        let n = targets.len() as f64;
        let mean = AXES.map(|k| targets.iter().map(|a| a[k]).sum::<f64>() / n);
        let scatter = targets.iter().map(|a| AXES.map(|k| (a[k] - mean[k]).powi(2)).iter().sum::<f64>()).sum();
        self.rows.extend_from_slice(targets);
        self.items.push(Item { at, until: self.rows.len() as u32, mean, scatter });
    }

    /// Each item with its rows.
    fn each(&self) -> impl Iterator<Item = (&Item, &[[f64; 2]])> {
        let mut from = 0;
        self.items.iter().map(move |item| {
            let rows = from..item.until as usize;
            from = rows.end;
            (item, &self.rows[rows])
        })
    }

    /// Every n-th item, so that about `most` remain.
    pub(super) fn thinned(&self, most: usize) -> Items {
        let every = self.items.len().div_ceil(most.max(1)).max(1);
        let mut out = Items { stamps: vec![], items: vec![], rows: vec![], ..*self };
        for (item, rows) in self.each().step_by(every) {
            if !self.against_reference {
                out.stamp(self.stamps[item.at as usize - 1]);
            }
            let at = out.stamp(self.stamps[item.at as usize]);
            out.add(at, rows);
        }
        out
    }

    /// Index of a timestamp that is not before the last one.
    fn stamp(&mut self, t: f64) -> u32 {
        if self.stamps.last() != Some(&t) {
            self.stamps.push(t);
        }
        self.stamps.len() as u32 - 1
    }
}

/// Error of the integral in one item, and its derivative by the delay.
#[derive(Debug, Clone, Copy)]
pub(super) struct Miss {
    /// Number of rows.
    pub(super) rows: f64,
    /// Mean over the rows, north and east, m.
    pub(super) error: [f64; 2],
    /// Its derivative by the delay, m/s.
    pub(super) rate: [f64; 2],
}

/// Integral of velocity up to an instant, m, and the velocity there, m/s.
#[derive(Debug, Clone, Copy, Default)]
struct Flown {
    displacement: [f64; 2],
    velocity: [f64; 2],
}

/// The newest of at least two samples at `instant`, never the last one; searched from `at` on, in growing strides.
fn newest(t: &[f64], at: usize, instant: f64) -> usize {
    let mut stride = 1;
    while at + stride < t.len() && t[at + stride] <= instant {
        stride *= 2;
    }
    let ahead = &t[at + stride / 2..(at + stride).min(t.len())];
    (at + stride / 2 + ahead.partition_point(|x| *x <= instant)).saturating_sub(1).clamp(at, t.len() - 2)
}

impl Sweeper {
    /// Rows of each fix that the reference covers, for delays from `low` to `high`; `None` without a reference.
    pub(super) fn errors(&self, (low, high): (f64, f64)) -> Option<Items> {
        let rows = &self.rows;
        let inside = |&row: &usize| {
            let t = self.input.position.t[rows.fix(row)];
            rows.segment(row).is_some_and(|s| rows.age_s(&self.input, row) >= 0.0 && self.holds(s, t - high, t - low))
        };
        let reference = Reference::at(self.input.reference.as_ref()?, rows, (0..rows.t.len()).filter(inside));
        let flown = self.flown_by(reference.row.iter().map(|&row| rows.t[row]));
        let mut items = Items { against_reference: true, stamps: vec![], items: vec![], rows: vec![] };
        let targets: Vec<[f64; 2]> = reference
            .row
            .iter()
            .zip(flown)
            .enumerate()
            .map(|(i, (&row, flown))| {
                AXES.map(|k| self.input.position.axes[k][rows.fix(row)] + flown.displacement[k] - reference.axes[k][i])
            })
            .collect();
        let group = |row: usize| (rows.fix(row), rows.segment(row));
        let mut from = 0;
        for of_fix in reference.row.chunk_by(|a, b| group(*a) == group(*b)) {
            let at = items.stamp(self.input.position.t[rows.fix(of_fix[0])]);
            items.add(at, &targets[from..from + of_fix.len()]);
            from += of_fix.len();
        }
        Some(items)
    }

    /// Steps at the fixes with velocity for the whole flight since the previous fix, for delays from `low` to `high`.
    pub(super) fn steps(&self, (low, high): (f64, f64)) -> Items {
        let position = &self.input.position;
        let mut items = Items { against_reference: false, stamps: vec![], items: vec![], rows: vec![] };
        let mut s = 0;
        for j in 1..position.t.len() {
            let (from, to) = (position.t[j - 1] - high, position.t[j] - low);
            while s + 1 < self.segments.len() && self.end(s) < to {
                s += 1;
            }
            if self.holds(s, from, to) {
                let step = AXES.map(|k| position.axes[k][j] - position.axes[k][j - 1]);
                items.stamp(position.t[j - 1]);
                let at = items.stamp(position.t[j]);
                items.add(at, &[step]);
            }
        }
        items
    }

    fn end(&self, segment: usize) -> f64 {
        self.input.velocity.t[self.segments[segment].end - 1]
    }

    fn holds(&self, segment: usize, from: f64, to: f64) -> bool {
        let range = &self.segments[segment];
        self.input.velocity.t[range.start] <= from && to <= self.end(segment)
    }

    /// Integral and velocity at rising instants inside the segments: one walk over the velocity.
    fn flown_by<'a>(&'a self, instants: impl Iterator<Item = f64> + 'a) -> impl Iterator<Item = Flown> + 'a {
        let (t, v) = (&self.input.velocity.t, &self.input.velocity.axes);
        let mut at = 0;
        instants.map(move |instant| {
            at = newest(t, at, instant);
            let (since, step) = (instant - t[at], t[at + 1] - t[at]);
            let slope = AXES.map(|k| (v[k][at + 1] - v[k][at]) / step);
            let velocity = AXES.map(|k| v[k][at] + slope[k] * since);
            Flown { displacement: AXES.map(|k| self.flown[k][at] + 0.5 * since * (v[k][at] + velocity[k])), velocity }
        })
    }

    /// Errors of all items with this delay.
    pub(super) fn misses<'a>(&'a self, items: &'a Items, delay_s: f64) -> impl Iterator<Item = Miss> + 'a {
        let mut flown = self.flown_by(items.stamps.iter().map(move |t| t - delay_s));
        let (mut walked, mut before, mut now) = (0, Flown::default(), Flown::default());
        items.each().map(move |(item, rows)| {
            while walked <= item.at
                && let Some(next) = flown.next()
            {
                (before, now, walked) = (now, next, walked + 1);
            }
            let from = if items.against_reference { Flown::default() } else { before };
            Miss {
                rows: rows.len() as f64,
                error: AXES.map(|k| item.mean[k] - (now.displacement[k] - from.displacement[k])),
                rate: AXES.map(|k| now.velocity[k] - from.velocity[k]),
            }
        })
    }

    /// Mean of the squared 2-D score over all rows, m².
    pub(super) fn mean_square(&self, items: &Items, delay_s: f64) -> f64 {
        let of_means = self.misses(items, delay_s).map(|m| m.rows * square(m.error)).sum::<f64>();
        (of_means + items.items.iter().map(|i| i.scatter).sum::<f64>()) / items.rows.len() as f64
    }

    /// Squared 2-D score of every row, m².
    pub(super) fn squares(&self, items: &Items, delay_s: f64) -> Vec<f64> {
        let of = |((item, rows), missed): ((&'_ Item, &'_ [[f64; 2]]), Miss)| {
            let mean = item.mean;
            rows.iter().map(move |a| square(AXES.map(|k| missed.error[k] + a[k] - mean[k]))).collect::<Vec<f64>>()
        };
        items.each().zip(self.misses(items, delay_s)).flat_map(of).collect()
    }
}

fn square([north, east]: [f64; 2]) -> f64 {
    north * north + east * east
}
