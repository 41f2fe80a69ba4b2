//! A first delay that is robust against offsets, resets and outliers.

use super::pieces::Stretch;
use crate::horizontal::{AXES, Horizontal};
use signal::Reference;

/// Displacements span at least this, s, and at most three times this.
const BASE_S: f64 = 3.0;
/// Number of displacements that are compared.
const ENOUGH: usize = 400;
/// Least number of displacements for a result.
const LEAST: usize = 5;
/// Step of the delays and of the grid of the second channel, s.
const STEP_S: f64 = 0.05;
/// Minima closer to each other than this count as one, s.
const APART_S: f64 = 0.5;
/// A minimum within this factor of the lowest is equally good; the one nearest to zero delay is used.
const AS_GOOD: f64 = 1.1;
/// The same as an absolute limit, m or m/s: rounding.
const ROUNDING: f64 = 1e-3;

/// Number of points of the second channel that are computed at once.
const POINTS_OF_A_PART: usize = 1 << 14;

/// Coarse delay at which a pair of channels agrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Coarse {
    /// s
    pub(crate) delay_s: f64,
    /// Another delay that fits equally well, s, for example when the motion repeats itself.
    pub(crate) rival_s: Option<f64>,
    /// Whether the best is at the end of the search range.
    pub(crate) at_edge: bool,
}

/// The delay from `search_s.0` to `search_s.1` at which displacements over three seconds agree best, by the mean of
/// their absolute differences. `None` if there are no displacements.
pub(crate) fn coarse_delay(first: &Horizontal, stretches: &[Stretch], search_s: (f64, f64)) -> Option<Coarse> {
    let curve = misfits(first, stretches, search_s);
    let value = |k: usize| curve.get(k).copied().unwrap_or(f64::INFINITY);
    let lowest = (0..curve.len()).filter(|&k| value(k).is_finite()).min_by(|a, b| value(*a).total_cmp(&value(*b)))?;
    let is_minimum = |k: &usize| {
        let around = k.saturating_sub((APART_S / STEP_S) as usize)..=(k + (APART_S / STEP_S) as usize);
        value(*k).is_finite() && around.into_iter().all(|j| value(j) >= value(*k))
    };
    // A minimum may be half a step away from its grid point and lower by up to the rise to a neighbour.
    let floor = |k: usize| {
        let neighbours = [k.checked_sub(1).map_or(f64::INFINITY, value), value(k + 1)];
        let steepest = neighbours.into_iter().filter(|v| v.is_finite()).fold(value(k), f64::max);
        value(k) - 0.5 * (steepest - value(k))
    };
    let bar = AS_GOOD * value(lowest) + ROUNDING;
    let mut good: Vec<usize> = (0..curve.len()).filter(is_minimum).filter(|k| floor(*k) <= bar).collect();
    let delay = |k: usize| search_s.0 + STEP_S * k as f64;
    good.sort_by(|a, b| delay(*a).abs().total_cmp(&delay(*b).abs()));
    let best = good.first().copied().unwrap_or(lowest);
    let rival_s = good.iter().copied().find(|k| k.abs_diff(best) as f64 * STEP_S > APART_S).map(delay);
    let at_edge = best < 2 || best + 2 >= curve.len();
    Some(Coarse { delay_s: vertex(&value, best).mul_add(STEP_S, delay(best)), rival_s, at_edge })
}

/// Minimum of the parabola through a point of a curve and its neighbours, in steps from the point.
fn vertex(value: &dyn Fn(usize) -> f64, k: usize) -> f64 {
    let Some(before) = k.checked_sub(1).map(value) else { return 0.0 };
    let (here, after) = (value(k), value(k + 1));
    let bend = before - 2.0 * here + after;
    if bend > 0.0 && bend.is_finite() { (0.5 * (before - after) / bend).clamp(-0.5, 0.5) } else { 0.0 }
}

/// Mean absolute difference of displacements at each delay; infinite if too few can be compared.
fn misfits(first: &Horizontal, stretches: &[Stretch], (from, to): (f64, f64)) -> Vec<f64> {
    let points = ((to - from) / STEP_S).round().clamp(0.0, 1e5) as usize + 1;
    let ends = ends(first);
    let grids: Vec<Grid> = stretches.iter().map(Grid::of).collect();
    let (mut sums, mut counts) = (vec![0.0; points], vec![0_usize; points]);
    for &(a, b) in &ends {
        let (ta, tb) = (first.t[a], first.t[b]);
        let moved = AXES.map(|axis| first.axes[axis][b] - first.axes[axis][a]);
        let near = grids.partition_point(|g| g.end < ta - to);
        for grid in grids[near..].iter().take_while(|g| g.start <= tb - from) {
            // Delays at which both ends are within the stretch.
            let lowest = ((tb - grid.end - from) / STEP_S).ceil().max(0.0);
            let highest = ((ta - grid.start - from) / STEP_S).floor().min(points as f64 - 1.0);
            if lowest > highest {
                continue;
            }
            let (places_a, places_b) = (grid.place(ta - from), grid.place(tb - from));
            for k in lowest as usize..=highest as usize {
                let apart = |axis: usize| {
                    let predicted = grid.value(axis, places_b, k) - grid.value(axis, places_a, k);
                    (moved[axis] - predicted).abs()
                };
                sums[k] += apart(0) + apart(1);
                counts[k] += 1;
            }
        }
    }
    let enough = |count: usize| count >= LEAST && 4 * count >= ends.len().min(ENOUGH);
    sums.iter().zip(&counts).map(|(s, n)| if enough(*n) { s / *n as f64 } else { f64::INFINITY }).collect()
}

/// Rows between which displacements are taken.
fn ends(first: &Horizontal) -> Vec<(usize, usize)> {
    let mut ends: Vec<(usize, usize)> = vec![];
    let mut after = 0;
    for before in 0..first.t.len() {
        while after < first.t.len() && first.t[after] - first.t[before] < BASE_S {
            after += 1;
        }
        if after < first.t.len() && first.t[after] - first.t[before] < 3.0 * BASE_S {
            ends.push((before, after));
        }
    }
    let every = ends.len().div_ceil(ENOUGH).max(1);
    ends.into_iter().step_by(every).collect()
}

/// The second channel over one stretch, on an even grid.
struct Grid {
    start: f64,
    end: f64,
    values: [Vec<f64>; 2],
}

impl Grid {
    fn of(stretch: &Stretch) -> Grid {
        let (start, end) = stretch[0].span();
        let points = ((end - start) / STEP_S).ceil().clamp(0.0, 1e7) as usize + 2;
        let values = AXES.map(|axis| {
            let mut values = vec![0.0; points];
            let reference: &dyn Reference = &*stretch[axis];
            // Part by part: for days of flight the instants and rates alone would take hundreds of megabytes.
            for (part, values) in values.chunks_mut(POINTS_OF_A_PART).enumerate() {
                let instant = |k: usize| start + STEP_S * (part * POINTS_OF_A_PART + k) as f64;
                let instants: Vec<f64> = (0..values.len()).map(|k| instant(k).min(end)).collect();
                let mut rates = vec![0.0; values.len()];
                reference.fill(&instants, values, &mut rates);
                // Extrapolated after the end with the last slope, so that interpolation is right up to the end.
                for (k, (value, rate)) in values.iter_mut().zip(rates).enumerate() {
                    let beyond = instant(k) - end;
                    if beyond > 0.0 {
                        *value += beyond * rate;
                    }
                }
            }
            values
        });
        Grid { start, end, values }
    }

    /// Grid point and fraction of a step for the instant `t` at zero delay.
    fn place(&self, t: f64) -> (i64, f64) {
        let steps = (t - self.start) / STEP_S;
        (steps.floor() as i64, steps - steps.floor())
    }

    /// Value `k` steps before a place.
    #[inline]
    fn value(&self, axis: usize, (point, share): (i64, f64), k: usize) -> f64 {
        let at = (point - k as i64).max(0) as usize;
        let values = &self.values[axis];
        match (values.get(at), values.get(at + 1)) {
            (Some(a), Some(b)) => a + share * (b - a),
            _ => values.last().copied().unwrap_or(0.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::pieces::references;
    use super::*;

    /// Turns that do not repeat, at 15 m/s; fixes at 5 Hz that are `late` s late, velocity at 20 Hz.
    fn flown(late: f64, repeat: bool) -> (Horizontal, Horizontal) {
        let heading =
            move |t: f64| if repeat { 0.6 * t } else { 0.9 * (0.31 * t).sin() + 0.7 * (0.117 * t).cos() * t.sqrt() };
        let step = 0.01;
        let mut track = vec![[0.0; 2]];
        for k in 0..12_000 {
            let (sin, cos) = heading((f64::from(k) + 0.5) * step).sin_cos();
            let last = track[track.len() - 1];
            track.push([last[0] + 15.0 * step * cos, last[1] + 15.0 * step * sin]);
        }
        let at = |t: f64, axis: usize| track[((t / step).round().max(0.0) as usize).min(track.len() - 1)][axis];
        let fixes: Vec<f64> = (0..500).map(|k| 15.0 + 0.2 * f64::from(k)).collect();
        let axis = |axis: usize| fixes.iter().map(|t| at(t - late, axis)).collect();
        let first = Horizontal { axes: [axis(0), axis(1)], t: fixes };
        let t: Vec<f64> = (0..2400).map(|k| 0.05 * f64::from(k)).collect();
        let second = Horizontal {
            axes: [
                t.iter().map(|t| 15.0 * heading(*t).cos()).collect(),
                t.iter().map(|t| 15.0 * heading(*t).sin()).collect(),
            ],
            t,
        };
        (first, second)
    }

    fn found(first: &Horizontal, second: &Horizontal, search_s: (f64, f64)) -> Coarse {
        coarse_delay(first, &references(second, std::slice::from_ref(&(0..second.t.len())), true, None), search_s)
            .unwrap()
    }

    #[test]
    fn delays_from_minus_two_to_twelve_seconds_are_found_to_50_ms() {
        for late in [-2.0, -0.51, 0.0, 0.17, 0.4, 2.5, 6.0, 12.0] {
            let (first, second) = flown(late, false);
            let coarse = found(&first, &second, (-2.5, 13.0));
            assert!(
                (coarse.delay_s - late).abs() < 0.05 && !coarse.at_edge && coarse.rival_s.is_none(),
                "{late} {coarse:?}"
            );
        }
    }

    #[test]
    fn resets_and_wild_fixes_do_not_mislead() {
        let (mut first, second) = flown(0.4, false);
        first.axes[0].iter_mut().skip(200).for_each(|x| *x += 300.0);
        first.axes[1].iter_mut().step_by(40).for_each(|x| *x -= 500.0);
        assert!((found(&first, &second, (-2.5, 13.0)).delay_s - 0.4).abs() < 0.06);
    }

    #[test]
    fn circles_have_a_rival_one_turn_later_and_the_delay_near_zero_wins() {
        let (first, second) = flown(0.4, true);
        let coarse = found(&first, &second, (-2.5, 13.0));
        let turn = std::f64::consts::TAU / 0.6;
        assert!((coarse.delay_s - 0.4).abs() < 0.05, "{coarse:?}");
        assert!(coarse.rival_s.is_some_and(|r| (r - 0.4 - turn).abs() < 0.1), "{coarse:?}");
    }

    #[test]
    fn a_delay_outside_the_search_is_at_its_edge() {
        let (first, second) = flown(3.0, false);
        assert!(found(&first, &second, (-1.0, 1.5)).at_edge);
    }

    #[test]
    fn records_without_overlap_have_no_delay() {
        let (first, mut second) = flown(0.4, false);
        second.t.iter_mut().for_each(|t| *t += 1e4);
        assert_eq!(
            coarse_delay(&first, &references(&second, std::slice::from_ref(&(0..2400)), true, None), (-2.5, 13.0)),
            None
        );
        assert_eq!(coarse_delay(&first, &[], (-2.5, 13.0)), None);
    }
}
