//! Scatter of the delay from fix to fix (S4): does the scatter along the track grow with speed?
//!
//! Each fix is compared with the mean of its neighbours. Where the motion changes much from fix to fix, other errors do
//! not cancel. A velocity with a wrong scale or wrong axes leaves a share of the second difference of the path. The
//! delay of the coarse map is up to half a step off and may switch between two steps, which leaves a share of the
//! second difference of the velocity. Such fixes are excluded.

use crate::coarse;
use crate::motion::{State, speed};
use statrs::distribution::{ContinuousCDF, StudentsT};

const SLOW_MPS: f64 = 2.0;
const BLOCK_S: f64 = 10.0;
/// Squares are clipped at this many variances.
const CUT: f64 = 400.0;
const LEAST_FIXES: usize = 40;
const SIGNIFICANCE: f64 = 1e-3;
const LEAST_S: f64 = 0.01;
/// Largest second difference of the path, in seconds at its speed: a 1 % error of it is half of [`LEAST_S`].
const MOST_BENT_S: f64 = 0.5;
/// Largest second difference of the velocity, as a share of the speed: with it, a delay that is half a map step off
/// produces half of [`LEAST_S`].
const MOST_TURNED: f64 = 0.5 * LEAST_S / (0.5 * coarse::STEP_S);

/// Estimated scatter.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Jitter {
    /// Standard deviation, s, if scatter was detected.
    pub(crate) found_s: Option<f64>,
    /// Standard deviation that would have been detected, s, if the motion allows a test.
    pub(crate) limit_s: Option<f64>,
}

/// Examines the residuals `e` (m) of neighbouring fixes; `state` is the motion of each fix at the delay `late_s`.
pub(crate) fn jitter(t: &[f64], e: &[[f64; 2]], state: &[State], late_s: &[f64]) -> Jitter {
    let n = t.len();
    if n < LEAST_FIXES {
        return Jitter::default();
    }
    let high: Vec<[f64; 2]> = e.windows(3).map(|w| [0, 1].map(|a| second([w[0][a], w[1][a], w[2][a]]))).collect();
    let variance = typical_variance(&high);
    let mut blocks: Vec<(f64, f64)> = vec![];
    let mut current = None;
    let mut used = 0;
    let neighbours = state.windows(3).zip(late_s.windows(3));
    for ((h, (near, late)), t_k) in high.iter().zip(neighbours).zip(&t[1..]) {
        let s = near[1];
        let speed = s.speed();
        if speed <= SLOW_MPS || bends(near, late, speed) {
            continue;
        }
        used += 1;
        let block = ((t_k - t[0]) / BLOCK_S) as usize;
        if current != Some(block) {
            current = Some(block);
            blocks.push((0.0, 0.0));
        }
        let u = [s.velocity[0] / speed, s.velocity[1] / speed];
        let along = (u[0] * h[0] + u[1] * h[1]).powi(2).min(CUT * variance);
        let across = (u[0] * h[1] - u[1] * h[0]).powi(2).min(CUT * variance);
        if let Some(b) = blocks.last_mut() {
            b.0 += speed * speed * (along - across);
            b.1 += 1.5 * speed.powi(4);
        }
    }
    if used < LEAST_FIXES || blocks.len() < 3 { Jitter::default() } else { judge(&blocks) }
}

/// Difference between a value and the mean of its neighbours.
fn second([before, here, after]: [f64; 3]) -> f64 {
    here - 0.5 * (before + after)
}

/// Whether the motion, or the delay of the map, changes too much between three fixes.
fn bends(near: &[State], late_s: &[f64], speed_mps: f64) -> bool {
    let of = |value: &dyn Fn(usize) -> f64| second([0, 1, 2].map(value));
    let [north, east] = [0, 1].map(|a| of(&|k| near[k].place[a]));
    let [faster_north, faster_east] = [0, 1].map(|a| of(&|k| near[k].velocity[a]));
    speed(north, east) > MOST_BENT_S * speed_mps
        || speed(faster_north, faster_east) > MOST_TURNED * speed_mps
        || of(&|k| late_s[k]).abs() > 0.5 * LEAST_S
}

fn typical_variance(high: &[[f64; 2]]) -> f64 {
    let of = |axis: usize| {
        let mut sizes: Vec<f64> = high.iter().map(|h| h[axis].abs()).collect();
        let middle = sizes.len() / 2;
        1.4826 * *sizes.select_nth_unstable_by(middle, f64::total_cmp).1 + 1e-6
    };
    of(0) * of(1)
}

fn judge(blocks: &[(f64, f64)]) -> Jitter {
    let (gain, weight) = blocks.iter().fold((0.0, 0.0), |s, b| (s.0 + b.0, s.1 + b.1));
    let square = gain / weight;
    let free = (blocks.len() - 1) as f64;
    let scatter: f64 = blocks.iter().map(|b| (b.0 - square * b.1).powi(2)).sum();
    let sigma = (scatter * blocks.len() as f64 / free).sqrt() / weight;
    if !(sigma.is_finite() && sigma > 0.0) {
        return Jitter::default();
    }
    let p = StudentsT::new(0.0, 1.0, free).map_or(1.0, |s| s.sf(square / sigma));
    let found = (p < SIGNIFICANCE && square > LEAST_S * LEAST_S).then(|| square.sqrt());
    Jitter { found_s: found, limit_s: Some((2.8 * sigma).sqrt()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;

    fn scattered(jitter_s: f64) -> Jitter {
        let mut random = rand_pcg::Pcg64::seed_from_u64(4);
        let mut normal = move || random.sample::<f64, _>(StandardNormal);
        let t: Vec<f64> = (0..1200).map(|k| 0.2 * f64::from(k)).collect();
        let state: Vec<State> = t
            .iter()
            .map(|t| State { place: [0.0; 2], velocity: [15.0 * (0.4 * t).cos(), 15.0 * (0.4 * t).sin()] })
            .collect();
        let e: Vec<[f64; 2]> = state
            .iter()
            .map(|s| {
                let late = jitter_s * normal();
                s.velocity.map(|v| 0.3 * normal() - late * v)
            })
            .collect();
        jitter(&t, &e, &state, &vec![0.0; t.len()])
    }

    #[test]
    fn a_scatter_of_eighty_milliseconds_is_measured() {
        let found = scattered(0.08).found_s.unwrap();
        assert!((found - 0.08).abs() < 0.006, "{found}");
    }

    #[test]
    fn noise_alone_shows_no_jitter_and_gives_a_limit() {
        let none = scattered(0.0);
        assert!(none.found_s.is_none());
        assert!((0.001..0.02).contains(&none.limit_s.unwrap()), "{none:?}");
    }

    /// Ten blocks of equal weight with squares of `square` ± `apart`: the mean has an uncertainty of apart / 3.
    fn of_blocks(square: f64, apart: f64) -> Jitter {
        let weight = 3e4;
        let blocks: Vec<(f64, f64)> =
            (0..10).map(|k| (weight * (square + if k % 2 == 0 { apart } else { -apart }), weight)).collect();
        judge(&blocks)
    }

    /// Student's t with nine degrees of freedom exceeds 4.297 with a probability of 0.1 %.
    #[test]
    fn jitter_is_found_if_significant_and_at_least_ten_milliseconds() {
        let apart = 1e-4;
        for (times, found) in [(4.2, false), (4.4, true), (-9.0, false)] {
            let square = times * apart / 3.0;
            let jitter = of_blocks(square, apart);
            assert_eq!(jitter.found_s.is_some(), found, "{times}");
            assert!(jitter.found_s.is_none_or(|s| (s - square.sqrt()).abs() < 1e-12));
            assert!((jitter.limit_s.unwrap() - (2.8 * apart / 3.0).sqrt()).abs() < 1e-12);
        }
        assert!(
            of_blocks(0.0099 * 0.0099, 1e-6).found_s.is_none() && of_blocks(0.0101 * 0.0101, 1e-6).found_s.is_some()
        );
        assert!(of_blocks(0.01, 0.0).limit_s.is_none(), "blocks that agree to all digits say nothing of their scatter");
    }

    #[test]
    fn a_fix_is_compared_with_the_mean_of_its_neighbours() {
        assert_eq!(second([1.0, 5.0, 3.0]), 3.0);
        assert_eq!(second([1.0, 2.0, 3.0]), 0.0);
        // Of a normal distribution the median size is 0.6745 standard deviations.
        let high: Vec<[f64; 2]> =
            (0..9).map(|k| [0.6745 * 2.0, -0.6745 * 3.0 * if k % 2 == 0 { 1.0 } else { -1.0 }]).collect();
        assert!((typical_variance(&high) - 6.0).abs() < 1e-3);
    }
}
