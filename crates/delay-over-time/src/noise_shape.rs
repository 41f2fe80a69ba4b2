//! Shape of the position's noise, from windows with their own delays and scales.

use crate::fixes::Fixes;
use crate::motion::Motion;
use crate::whitening::NoiseShape;
use crate::windows::{Scratch, Starts, columns, fit_window, tile, window_likelihood};
use std::ops::Range;

/// Length of a window, s.
const LENGTH_S: f64 = 20.0;
/// Number of fixes that is enough to estimate the shape.
const ENOUGH_FIXES: usize = 1500;
/// Only moving windows are used if there are at least this many; else all.
const LEAST_MOVING: usize = 4;
const WANDER: (f64, f64) = (0.02, 100.0);
const TIME_CONSTANT_S: (f64, f64) = (0.3, 300.0);
const EVALUATIONS: usize = 32;

/// First guess, used to find the delays of windows.
pub(crate) const GUESS: NoiseShape = NoiseShape { wander: 3.0, time_constant_s: 15.0, jitter: 0.0 };

/// Windows at their own delays: the likelihood of a shape is summed over them.
pub(crate) struct Sample {
    windows: Vec<SampleWindow>,
}

struct SampleWindow {
    rows: Range<usize>,
    delay_s: f64,
    /// Its columns at that delay, independent of the noise.
    columns: Vec<[f64; 4]>,
}

impl Sample {
    pub(crate) fn new(
        fixes: &Fixes,
        motion: &Motion,
        starts: &Starts,
        interval_s: f64,
        scratch: &mut Scratch,
    ) -> Sample {
        let all = tile(fixes, starts, LENGTH_S.max(25.0 * interval_s));
        let total: usize = all.iter().map(Range::len).sum();
        let every = (total / ENOUGH_FIXES).max(1);
        let fit = |rows: Range<usize>| {
            fit_window(fixes, rows.clone(), motion, &GUESS, starts, scratch).map(|w| (rows, w.delay_s, w.speed_mps))
        };
        let fitted: Vec<(Range<usize>, f64, f64)> = all.into_iter().step_by(every).filter_map(fit).collect();
        let moving = |w: &&(Range<usize>, f64, f64)| w.2 > motion.slow_mps;
        let enough = fitted.iter().filter(moving).count() >= LEAST_MOVING;
        let window = |w: &(Range<usize>, f64, f64)| {
            let (rows, delay_s) = (w.0.clone(), w.1);
            let mut at_delay = vec![];
            columns(&fixes.t[rows.clone()], &fixes.y[rows.clone()], motion, delay_s, &mut at_delay);
            SampleWindow { rows, delay_s, columns: at_delay }
        };
        Sample { windows: fitted.iter().filter(|w| !enough || moving(w)).map(window).collect() }
    }

    /// The most likely shape, with fixed jitter. Compass search in logarithms, from the best of a grid.
    pub(crate) fn shape(&self, fixes: &Fixes, motion: &Motion, jitter: f64, scratch: &mut Scratch) -> NoiseShape {
        let shape_at = |at: [f64; 2]| NoiseShape { wander: at[0].exp(), time_constant_s: at[1].exp(), jitter };
        let mut cost = |at: [f64; 2]| -> f64 {
            let shape = shape_at(at);
            let of = |w: &SampleWindow| {
                window_likelihood(&fixes.t[w.rows.clone()], &w.columns, motion, &shape, w.delay_s, scratch)
            };
            self.windows.iter().filter_map(of).sum()
        };
        let start = best_of_grid(&mut cost);
        shape_at(compass(&mut cost, start))
    }
}

/// Logarithms of wander and time constant, and their cost.
type Place = ([f64; 2], f64);

fn best_of_grid(cost: &mut dyn FnMut([f64; 2]) -> f64) -> Place {
    let mut best = ([GUESS.wander.ln(), GUESS.time_constant_s.ln()], f64::MAX);
    for wander in [0.4f64, 3.0, 20.0] {
        for time_constant in [2.0f64, 20.0] {
            let at = [wander.ln(), time_constant.ln()];
            let value = cost(at);
            if value < best.1 {
                best = (at, value);
            }
        }
    }
    best
}

/// Compass search with steps that halve when none of them gains.
fn compass(cost: &mut dyn FnMut([f64; 2]) -> f64, mut best: Place) -> [f64; 2] {
    let bounds = [WANDER, TIME_CONSTANT_S].map(|(a, b)| (a.ln(), b.ln()));
    let mut used = 6;
    let mut size = 0.9;
    while used < EVALUATIONS && size > 0.15 {
        let moves = [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0], [1.0, 1.0], [-1.0, -1.0]];
        let mut moved = false;
        for m in moves {
            let at = [0, 1].map(|i| (best.0[i] + size * m[i]).clamp(bounds[i].0, bounds[i].1));
            if at == best.0 {
                continue;
            }
            used += 1;
            let value = cost(at);
            if value < best.1 - 1e-3 {
                best = (at, value);
                moved = true;
                break;
            }
        }
        if !moved {
            size *= 0.5;
        }
    }
    best.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense::{Random, turning};

    /// Fixes at 5 Hz with a delay of 0.3 s, white noise of 0.2 m, and a wander of `wander` times that.
    fn found(wander: f64, time_constant_s: f64, seed: u64) -> NoiseShape {
        let (motion, mut random) = (turning(300.0), Random::new(seed));
        let t: Vec<f64> = (0..1500).map(|k| 0.2 * f64::from(k)).collect();
        let decay = (-0.2 / time_constant_s).exp();
        let mut now = [0.2 * wander * random.normal(), 0.2 * wander * random.normal()];
        let y = t.iter().map(|t| {
            let place = motion.at(t - 0.3, &mut 0).place;
            [0, 1].map(|a| {
                now[a] = decay * now[a] + 0.2 * wander * (1.0 - decay * decay).sqrt() * random.normal();
                place[a] + now[a] + 0.2 * random.normal()
            })
        });
        let fixes = Fixes { y: y.collect(), starts: vec![0, 1500], t };
        let mut scratch = Scratch::default();
        let late = |_: f64| 0.3;
        let starts = Starts::new(&fixes, &motion, 0.3, &late);
        Sample::new(&fixes, &motion, &starts, 0.2, &mut scratch).shape(&fixes, &motion, 0.0, &mut scratch)
    }

    /// Windows of 20 s determine how fast the noise wanders, 2 σ² / τ; σ and τ alone are less certain.
    #[test]
    fn the_wander_rate_of_simulated_noise_is_found() {
        for (wander, time_constant_s, seed) in [(4.0, 4.0, 1), (1.0, 2.0, 2), (10.0, 8.0, 3)] {
            let shape = found(wander, time_constant_s, seed);
            let fast = |wander: f64, time_constant_s: f64| 2.0 * wander * wander / time_constant_s;
            let share = fast(shape.wander, shape.time_constant_s) / fast(wander, time_constant_s);
            assert!((0.5..2.0).contains(&share), "{wander}, {time_constant_s} s: {shape:?}");
        }
        let shape = found(0.0, 5.0, 4);
        assert!(shape.wander < 0.5, "where there is none: {shape:?}");
    }

    /// A bowl whose minimum is next to the best point of the grid.
    #[test]
    fn the_search_finds_the_minimum_and_stays_within_bounds() {
        for bottom in [[2.0f64, 3.0], [-2.0, 1.0], [0.5, 4.5]] {
            let mut used = 0;
            let mut bowl = |at: [f64; 2]| {
                used += 1;
                (at[0] - bottom[0]).powi(2) + (at[1] - bottom[1]).powi(2)
            };
            let start = best_of_grid(&mut bowl);
            assert!((start.1 - bowl(start.0)).abs() < 1e-12);
            let end = compass(&mut bowl, start);
            assert!((0..2).all(|i| (end[i] - bottom[i]).abs() < 0.5), "{end:?} {bottom:?}");
            assert!(used <= EVALUATIONS + 8, "{used}");
        }
        let mut slope = |at: [f64; 2]| at[0] - at[1];
        let start = best_of_grid(&mut slope);
        assert_eq!(start.0, [0.4f64.ln(), 20f64.ln()]);
        let end = compass(&mut slope, start);
        assert!((end[0] - 0.02f64.ln()).abs() < 1e-9 && (end[1] - 300f64.ln()).abs() < 1e-9, "{end:?}");
    }
}
