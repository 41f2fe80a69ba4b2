//! Shape of the position's noise, from windows whose delays and scales are their own.

use crate::fixes::Fixes;
use crate::motion::Motion;
use crate::whitening::NoiseShape;
use crate::windows::{Scratch, Starts, columns, fit_window, tile, window_likelihood};
use std::ops::Range;

/// Length of a window, s.
const LENGTH_S: f64 = 20.0;
/// Fixes that are enough to know the shape.
const ENOUGH_FIXES: usize = 1500;
/// Windows that move, if there are this many; else all.
const LEAST_MOVING: usize = 4;
const WANDER: (f64, f64) = (0.02, 100.0);
const TIME_CONSTANT_S: (f64, f64) = (0.3, 300.0);
const EVALUATIONS: usize = 32;

/// First guess, with which windows find their delays.
pub(crate) const GUESS: NoiseShape = NoiseShape { wander: 3.0, time_constant_s: 15.0, jitter: 0.0 };

/// Windows at their own delays: what the likelihood of a shape is summed over.
pub(crate) struct Sample {
    windows: Vec<SampleWindow>,
}

struct SampleWindow {
    rows: Range<usize>,
    delay_s: f64,
    /// Its columns at that delay, whatever the noise.
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

    /// The most likely shape; the jitter is held. Compass search in logarithms, from the best of a grid.
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

/// Steps that halve where none of them gains.
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
