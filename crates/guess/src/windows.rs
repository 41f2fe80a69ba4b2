//! Tests whether a velocity agrees with the motion of a position: compares displacements with the integral of the
//! velocity over the same windows, and searches for the delay between them.

/// Range of delays tried, s: a position is rarely early.
const EARLIEST_S: f64 = -1.0;
const LATEST_S: f64 = 3.0;
const TRIED: usize = 100;
/// The shortest window, s.
const WINDOW_S: f64 = 1.0;
const MOST_WINDOWS: usize = 2000;
/// The fewest windows that are evaluated.
pub(super) const FEWEST_WINDOWS: usize = 10;
/// The shortest displacement in a window that counts as motion, m.
const LEAST_MOTION_M: f64 = 0.2;

/// Columns of one table with the times of their rows.
#[derive(Debug, Clone, Default)]
pub(super) struct Trace<const N: usize> {
    pub(super) times_s: Vec<f64>,
    pub(super) values: Vec<[f64; N]>,
}

impl<const N: usize> Trace<N> {
    /// Sorts the rows by time, without repeated times.
    pub(super) fn new(mut rows: Vec<(f64, [f64; N])>) -> Trace<N> {
        rows.retain(|(t, values)| t.is_finite() && values.iter().all(|v| v.is_finite()));
        rows.sort_by(|a, b| a.0.total_cmp(&b.0));
        rows.dedup_by(|b, a| b.0 <= a.0);
        let (times_s, values) = rows.into_iter().unzip();
        Trace { times_s, values }
    }

    /// Drops rows whose first two values repeat those before: held values are not measurements.
    pub(super) fn updates(mut self) -> Trace<N> {
        let mut last: Option<[f64; N]> = None;
        self.retain(|value| {
            let is_new = last.is_none_or(|last| last.iter().take(2).ne(value.iter().take(2)));
            last = if is_new { Some(*value) } else { last };
            is_new
        });
        self
    }

    /// Keeps the rows whose values pass.
    pub(super) fn retain(&mut self, mut is_kept: impl FnMut(&[f64; N]) -> bool) {
        let kept: Vec<bool> = self.values.iter().map(&mut is_kept).collect();
        let mut of_times = kept.iter();
        self.times_s.retain(|_| of_times.next().copied().unwrap_or_default());
        let mut of_values = kept.iter();
        self.values.retain(|_| of_values.next().copied().unwrap_or_default());
    }

    /// The integral, by trapezoids; unknown across a hole of more than `hole_s`.
    pub(super) fn integral(self, hole_s: f64) -> Integral<N> {
        let (mut sum, mut holes) = ([0.0; N], 0_u32);
        let mut at = vec![(sum, holes)];
        for ((t, a), (u, b)) in self.rows().zip(self.rows().skip(1)) {
            holes += u32::from(u - t > hole_s);
            for ((sum, a), b) in sum.iter_mut().zip(a).zip(b) {
                *sum += 0.5 * (a + b) * (u - t);
            }
            at.push((sum, holes));
        }
        Integral { times_s: self.times_s, at }
    }

    fn rows(&self) -> impl Iterator<Item = (f64, &[f64; N])> {
        self.times_s.iter().copied().zip(&self.values)
    }

    /// The values at a time, interpolated linearly between the rows before and after it; `None` across more than
    /// `hole_s`.
    pub(super) fn at(&self, time_s: f64, hole_s: f64) -> Option<[f64; N]> {
        let next = self.times_s.partition_point(|t| *t <= time_s);
        let previous = next.checked_sub(1)?;
        let (t, a) = (self.times_s.get(previous)?, self.values.get(previous)?);
        let (u, b) = (self.times_s.get(next)?, self.values.get(next)?);
        let share = (time_s - t) / (u - t);
        let mut values = *a;
        values.iter_mut().zip(b).for_each(|(a, b)| *a += share * (b - *a));
        (u - t <= hole_s).then_some(values)
    }

    /// The median step, s.
    pub(super) fn median_step_s(&self) -> Option<f64> {
        let mut steps: Vec<f64> = self.times_s.iter().zip(self.times_s.iter().skip(1)).map(|(a, b)| b - a).collect();
        steps.sort_by(f64::total_cmp);
        steps.get(steps.len() / 2).copied()
    }
}

pub(super) struct Integral<const N: usize> {
    times_s: Vec<f64>,
    at: Vec<([f64; N], u32)>,
}

impl<const N: usize> Integral<N> {
    /// The integral up to a time, and the number of holes before it.
    pub(super) fn of(&self, time_s: f64) -> Option<([f64; N], u32)> {
        let next = self.times_s.partition_point(|t| *t <= time_s);
        let previous = next.checked_sub(1)?;
        let (t, (a, holes)) = (self.times_s.get(previous)?, self.at.get(previous)?);
        let (u, (b, _)) = (self.times_s.get(next)?, self.at.get(next)?);
        let share = (time_s - t) / (u - t);
        let mut values = *a;
        values.iter_mut().zip(b).for_each(|(a, b)| *a += share * (b - *a));
        Some((values, *holes))
    }
}

/// Displacements and integrated velocities of the same windows.
#[derive(Debug, Clone, Default)]
pub(super) struct Windows {
    pub(super) moved: Vec<[f64; 3]>,
    pub(super) flown: Vec<[f64; 3]>,
    /// How late the position is, within the resolution of this comparison, s.
    pub(super) late_s: f64,
    pub(super) length_s: f64,
}

/// How well velocities give displacements for one assignment of the axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Match {
    /// Which column is north, and which is east.
    pub(super) swapped: bool,
    /// Signs of north and east.
    pub(super) signs: [f64; 2],
    /// Velocity over displacement.
    pub(super) scale: f64,
    /// 1 for complete agreement.
    pub(super) agreement: f64,
}

impl Windows {
    /// Compares a position in metres with a velocity in any unit. `None` if there is too little motion or common time.
    pub(super) fn new(position: Trace<3>, velocity: Trace<3>) -> Option<Windows> {
        let position = position.updates();
        let hole_s = (5.0 * velocity.median_step_s()?).max(1.0);
        let integral = velocity.integral(hole_s);
        let step_s = position.median_step_s()?;
        let length_s = WINDOW_S.max(step_s);
        let pairs = without_jumps(&position, pairs(&position, length_s));
        let mut best: Option<(f64, Windows)> = None;
        for i in 0..=TRIED {
            let late_s = EARLIEST_S + (LATEST_S - EARLIEST_S) * i as f64 / TRIED as f64;
            let windows = of_delay(&position, &integral, &pairs, late_s, length_s);
            let score = windows.best().map_or(0.0, |m| m.agreement);
            if windows.moved.len() >= FEWEST_WINDOWS && best.as_ref().is_none_or(|(known, _)| score > *known) {
                best = Some((score, windows));
            }
        }
        let (_, best) = best?;
        let sum: f64 = best.moved.iter().map(|d| d[0] * d[0] + d[1] * d[1]).sum();
        ((sum / best.moved.len() as f64).sqrt() > LEAST_MOTION_M).then_some(best)
    }

    /// One assignment of the axes.
    pub(super) fn try_axes(&self, swapped: bool, signs: [f64; 2]) -> Match {
        let (mut cross, mut moved, mut flown) = (0.0, 0.0, 0.0);
        for (d, v) in self.moved.iter().zip(&self.flown) {
            let (a, b) = if swapped { (v[1], v[0]) } else { (v[0], v[1]) };
            cross += signs[0] * a * d[0] + signs[1] * b * d[1];
            moved += d[0] * d[0] + d[1] * d[1];
            flown += a * a + b * b;
        }
        let agreement = cross / (moved * flown).sqrt().max(f64::MIN_POSITIVE);
        // Both may be noisy: neither is taken as the reference.
        Match { swapped, signs, scale: (flown / moved.max(f64::MIN_POSITIVE)).sqrt(), agreement }
    }

    /// All eight assignments, the best first.
    pub(super) fn all(&self) -> Vec<Match> {
        let signs = [[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]];
        let mut all: Vec<Match> =
            [false, true].into_iter().flat_map(|swapped| signs.map(|signs| self.try_axes(swapped, signs))).collect();
        all.sort_by(|a, b| b.agreement.total_cmp(&a.agreement));
        all
    }

    pub(super) fn best(&self) -> Option<Match> {
        self.all().into_iter().next()
    }

    /// Agreement, negative where the signs are opposite, and scale of heights and the third velocity.
    pub(super) fn vertical(&self) -> Option<(f64, f64)> {
        let (mut cross, mut moved, mut flown) = (0.0, 0.0, 0.0);
        for (d, v) in self.moved.iter().zip(&self.flown) {
            cross += d[2] * v[2];
            moved += d[2] * d[2];
            flown += v[2] * v[2];
        }
        let enough = moved > 0.0 && flown > 0.0;
        enough.then(|| (cross / (moved * flown).sqrt(), (flown / moved).sqrt()))
    }
}

/// First and last row of each window.
fn pairs(position: &Trace<3>, length_s: f64) -> Vec<(usize, usize)> {
    let times = &position.times_s;
    let all: Vec<(usize, usize)> = times
        .iter()
        .enumerate()
        .filter_map(|(first, t)| {
            let last = times.partition_point(|u| *u < t + 0.999 * length_s);
            let is_short = times.get(last).is_some_and(|u| u - t < 2.5 * length_s);
            is_short.then_some((first, last))
        })
        .collect();
    let step = all.len().div_ceil(MOST_WINDOWS).max(1);
    all.into_iter().step_by(step).collect()
}

/// Drops windows that are far longer than nearly all others: a few wrong fixes must not decide.
fn without_jumps(position: &Trace<3>, mut pairs: Vec<(usize, usize)>) -> Vec<(usize, usize)> {
    let distance_m = |(first, last): &(usize, usize)| match (position.values.get(*first), position.values.get(*last)) {
        (Some(a), Some(b)) => (b[0] - a[0]).hypot(b[1] - a[1]),
        _ => 0.0,
    };
    let mut distances_m: Vec<f64> = pairs.iter().map(distance_m).collect();
    distances_m.sort_by(f64::total_cmp);
    if let Some(&long_m) = distances_m.get(distances_m.len() * 99 / 100) {
        pairs.retain(|pair| distance_m(pair) <= 5.0 * long_m);
    }
    pairs
}

fn of_delay(
    position: &Trace<3>,
    integral: &Integral<3>,
    pairs: &[(usize, usize)],
    late_s: f64,
    length_s: f64,
) -> Windows {
    let mut windows = Windows { late_s, length_s, ..Windows::default() };
    for (first, last) in pairs {
        let place = |row: &usize| Some((*position.times_s.get(*row)?, *position.values.get(*row)?));
        let (Some((t, a)), Some((u, b))) = (place(first), place(last)) else { continue };
        let ends = integral.of(t - late_s).zip(integral.of(u - late_s));
        let Some(((from, holes), (to, later))) = ends.filter(|((_, a), (_, b))| a == b) else { continue };
        debug_assert_eq!(holes, later);
        windows.moved.push([b[0] - a[0], b[1] - a[1], b[2] - a[2]]);
        windows.flown.push([to[0] - from[0], to[1] - from[1], to[2] - from[2]]);
    }
    windows
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A climbing circle, with the position late by `late_s`.
    fn flight(late_s: f64) -> (Trace<3>, Trace<3>) {
        let place = |t: f64| [30.0 * (0.3 * t).sin(), 20.0 - 30.0 * (0.3 * t).cos(), 2.0 * t + 5.0 * (0.2 * t).sin()];
        let speed = |t: f64| [9.0 * (0.3 * t).cos(), 9.0 * (0.3 * t).sin(), 2.0 + (0.2 * t).cos()];
        let times = || (0..600).map(|i| 0.1 * f64::from(i));
        let position = Trace::new(times().map(|t| (t, place(t - late_s))).collect());
        (position, Trace::new(times().map(|t| (t, speed(t))).collect()))
    }

    #[test]
    fn a_trace_keeps_the_times_of_the_rows_that_it_keeps() {
        let mut trace = Trace::new((0..6).map(|i| (f64::from(i), [f64::from(i * i)])).collect());
        trace.retain(|[value]| *value != 4.0 && *value != 25.0);
        assert_eq!(trace.times_s, [0.0, 1.0, 3.0, 4.0]);
        assert_eq!(trace.values, [[0.0], [1.0], [9.0], [16.0]]);
    }

    #[test]
    fn simulated_axes_signs_scale_and_delay_are_recovered() {
        let (position, mut velocity) = flight(0.4);
        for v in &mut velocity.values {
            *v = [-3.6 * v[1], 3.6 * v[0], -3.6 * v[2]];
        }
        let windows = Windows::new(position, velocity).unwrap();
        let best = windows.best().unwrap();
        assert_eq!((best.swapped, best.signs), (true, [1.0, -1.0]));
        assert!((best.scale / 3.6 - 1.0).abs() < 0.01 && best.agreement > 0.999, "{best:?}");
        assert!((windows.late_s - 0.4).abs() < 0.05, "{}", windows.late_s);
        let (agreement, scale) = windows.vertical().unwrap();
        assert!(agreement < -0.99 && (scale / 3.6 - 1.0).abs() < 0.02, "{agreement} {scale}");
    }

    #[test]
    fn one_wrong_fix_does_not_decide() {
        let (mut position, velocity) = flight(0.4);
        let middle = position.values.len() / 2;
        position.values[middle][0] += 5000.0;
        let best = Windows::new(position, velocity).unwrap().best().unwrap();
        assert_eq!((best.swapped, best.signs), (false, [1.0, 1.0]));
        assert!(best.agreement > 0.999, "{best:?}");
    }

    #[test]
    fn without_motion_there_is_no_comparison() {
        let (mut position, velocity) = flight(0.0);
        position.values.iter_mut().enumerate().for_each(|(i, v)| *v = [1e-3 * (i % 7) as f64, 0.0, 0.0]);
        assert!(Windows::new(position, velocity).is_none());
    }

    /// ∫ of 2t from 1 to 3 is 8; the hole from 3 to 9 counts, and the integral after it goes on.
    #[test]
    fn an_integral_counts_the_holes_before_a_time() {
        let trace = Trace::new([1.0, 2.0, 3.0, 9.0, 10.0].map(|t| (t, [2.0 * t])).to_vec());
        let integral = trace.integral(5.0);
        assert_eq!(integral.of(0.9), None);
        assert_eq!(integral.of(1.0), Some(([0.0], 0)));
        assert_eq!(integral.of(2.0), Some(([3.0], 0)));
        assert_eq!(integral.of(2.5), Some(([5.5], 0)), "linear between the rows");
        let ([after], holes) = integral.of(9.5).unwrap();
        assert_eq!((after, holes), (8.0 + 72.0 + 9.5, 1));
        assert_eq!(integral.of(10.0), None, "nothing follows the last row");
    }
}
