//! The rows with a new fix, used by all scores without a reference.

use crate::compensator::CompensatorKind;
use crate::estimate::{EXACT_ASYNC, Positions};
use crate::input::Input;
use crate::rows::Rows;
use delay_from_flight::{AXES, Horizontal};
use signal::CumulativeIntegral;
use std::ops::Range;

/// Maximum number of fixes: an hour at 1.6 Hz, ten minutes at 10 Hz; with more, every second, third, … is used.
const MOST: usize = 6_000;

/// Valid rows with a new fix.
pub(crate) struct Updates<'a> {
    pub(crate) rows: Vec<usize>,
    input: &'a Input,
    all: &'a Rows,
    /// Velocity at each.
    pub(crate) velocity: Vec<[f64; 2]>,
    /// Displacement from the start of the segment, m: the position from velocity alone.
    pub(crate) place: Vec<[f64; 2]>,
    /// For each segment, with its first and last timestamp.
    integrals: Vec<([CumulativeIntegral<'a>; 2], [f64; 2])>,
}

impl<'a> Updates<'a> {
    pub(crate) fn of(input: &'a Input, all: &'a Rows, segments: &[Range<usize>]) -> Updates<'a> {
        let rows: Vec<usize> = all.valid().filter(|row| all.has_new_fix(*row)).collect();
        let every = rows.len().div_ceil(MOST).max(1);
        let rows: Vec<usize> = rows.into_iter().step_by(every).collect();
        let velocity = rows.iter().map(|&r| both_at(&input.velocity, all.t[r])).collect();
        let integral = |s: &Range<usize>| {
            let t = &input.velocity.t[s.clone()];
            let of_axis = |k: usize| CumulativeIntegral::new(t, &input.velocity.axes[k][s.clone()]);
            (AXES.map(of_axis), [t[0], t[t.len() - 1]])
        };
        let integrals: Vec<_> = segments.iter().map(integral).collect();
        let at = |row: usize| all.segment(row).map_or([0.0; 2], |s| AXES.map(|k| integrals[s].0[k].at(all.t[row])));
        let place = rows.iter().map(|&r| at(r)).collect();
        Updates { rows, input, all, velocity, place, integrals }
    }

    pub(crate) fn t(&self, i: usize) -> f64 {
        self.all.t[self.rows[i]]
    }

    pub(crate) fn segment(&self, i: usize) -> Option<usize> {
        self.all.segment(self.rows[i])
    }

    /// North and east of a track.
    pub(crate) fn at(&self, track: &Positions, i: usize) -> [f64; 2] {
        AXES.map(|k| track.axes[k][self.rows[i]])
    }

    pub(crate) fn has_own_output(&self, track: &Positions, i: usize) -> bool {
        track.has_own_output(self.rows[i])
    }

    /// Time over which a track extrapolates its raw position, s: the given delay, plus the age of the fix if the
    /// compensator knows it.
    pub(crate) fn extrapolated_s(&self, track: &Positions, i: usize) -> f64 {
        let age = if knows_age(track) { self.all.age_s(self.input, self.rows[i]) } else { 0.0 };
        track.delay.seconds() + age
    }

    /// Mean age of the fixes that a track does not account for, s.
    pub(crate) fn unknown_age_s(&self, track: &Positions) -> f64 {
        if knows_age(track) || track.is_raw() || self.rows.is_empty() {
            return 0.0;
        }
        self.rows.iter().map(|&r| self.all.age_s(self.input, r)).sum::<f64>() / self.rows.len() as f64
    }

    /// Displacement from velocity in the last `over_s` seconds before a row, m: Simpson's rule over three velocities,
    /// independent of any integral that a compensator uses.
    pub(crate) fn travelled(&self, i: usize, over_s: f64) -> [f64; 2] {
        let t = self.t(i);
        let middle = both_at(&self.input.velocity, t - 0.5 * over_s);
        let first = both_at(&self.input.velocity, t - over_s);
        AXES.map(|k| over_s / 6.0 * (first[k] + 4.0 * middle[k] + self.velocity[i][k]))
    }

    /// Acceleration from the positions `half_s` before and after, m/s²; `None` at the ends of a segment.
    pub(crate) fn acceleration(&self, i: usize, half_s: f64) -> Option<[f64; 2]> {
        let ([north, east], [first, last]) = &self.integrals[self.segment(i)?];
        let t = self.t(i);
        let bend = |x: &CumulativeIntegral| (x.at(t + half_s) - 2.0 * x.at(t) + x.at(t - half_s)) / (half_s * half_s);
        (t - half_s >= *first && t + half_s <= *last).then(|| [bend(north), bend(east)])
    }

    /// A track as input to the estimator.
    pub(crate) fn horizontal(&self, track: &Positions) -> Horizontal {
        let shown: Vec<usize> = self.rows.iter().copied().filter(|&r| track.has_own_output(r)).collect();
        let t = shown.iter().map(|&r| self.all.t[r]).collect();
        let axes = AXES.map(|k| shown.iter().map(|&r| track.axes[k][r]).collect());
        // A raw fix belongs to its own timestamp, not to the first row that sees it.
        let t = if track.is_raw() {
            shown.iter().map(|&r| self.all.t[r] - self.all.age_s(self.input, r)).collect()
        } else {
            t
        };
        Horizontal { t, axes }
    }
}

/// Whether a compensator accounts for the age of its fix, and carries it to the row.
pub(crate) fn knows_age(track: &Positions) -> bool {
    match track.further {
        Some(CompensatorKind::Pade { .. } | CompensatorKind::ExactFir) => false,
        Some(_) => true,
        None => track.name == EXACT_ASYNC,
    }
}

/// Both axes at an instant, linear between samples.
pub(crate) fn both_at(samples: &Horizontal, t: f64) -> [f64; 2] {
    let after = samples.t.partition_point(|&x| x <= t);
    match (after.checked_sub(1), samples.t.get(after)) {
        (None, _) => AXES.map(|k| samples.axes[k][0]),
        (Some(k), None) => AXES.map(|axis| samples.axes[axis][k]),
        (Some(k), Some(next)) => {
            let share = (t - samples.t[k]) / (next - samples.t[k]);
            AXES.map(|axis| samples.axes[axis][k] + share * (samples.axes[axis][after] - samples.axes[axis][k]))
        }
    }
}

/// Length of a vector.
pub(crate) fn length(a: [f64; 2]) -> f64 {
    dot(a, a).sqrt()
}

/// `a · b`.
pub(crate) fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

/// Component of `b` to the right of `a`, times the length of `a`.
pub(crate) fn to_the_right(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

pub(crate) fn minus(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}
