//! Windows with their own offset and drift (B S5 a): the best delay of each and its uncertainty.

use crate::fixes::Fixes;
use crate::motion::{Motion, speed};
use crate::whitening::{NoiseShape, Step, offset_and_drift, steps, whiten_rows};
use std::ops::Range;

/// Least number of fixes in a window.
const LEAST_FIXES: usize = 15;
const ROUNDS: usize = 4;
const LARGEST_STEP_S: f64 = 0.3;
const STEADY_S: f64 = 1e-3;
/// A start at the path must win by this much in −2 log likelihood with the window's own noise.
const PATH_MUST_WIN: f64 = 12.0;
/// Difference of path and constant above which both are starts, s.
const STARTS_APART_S: f64 = 0.03;
/// Span of the Bartlett sum of the scores, s.
const SCORE_SPAN_S: f64 = 2.0;

/// Results of a window.
#[derive(Debug, Clone)]
pub(crate) struct Window {
    /// First and last timestamp, s.
    pub(crate) from_s: f64,
    pub(crate) to_s: f64,
    /// Mean timestamp, s.
    pub(crate) middle_s: f64,
    /// Best delay, s.
    pub(crate) delay_s: f64,
    /// Information about the delay, 1/s², at white noise of standard deviation 1 m.
    pub(crate) information: f64,
    /// Mean square of the whitened residuals: the white noise's variance, m².
    pub(crate) variance: f64,
    /// Degrees of freedom of that variance.
    pub(crate) free: f64,
    /// Bartlett sum of the scores.
    pub(crate) score_variance: f64,
    /// Mean speed, m/s.
    pub(crate) speed_mps: f64,
    /// Products of the columns delay, speed later than direction, antenna ahead: upper triangle by rows.
    pub(crate) products: [f64; 6],
    /// Products of these columns with the residual.
    pub(crate) scores: [f64; 3],
}

/// Share of time in the measure that equalises windows; the rest is change of velocity.
const TIME_SHARE: f64 = 0.5;
/// Shortest window, as a share of the requested length.
const SHORTEST_SHARE: f64 = 0.6;
/// Interval over which changes of velocity are measured, s.
const CHANGE_SPAN_S: f64 = 1.0;

/// Rows of the windows that tile every piece. They are about `length_s` long, shorter if the velocity changes much and
/// longer if not, so that all carry about the same information.
pub(crate) fn tile(fixes: &Fixes, starts: &Starts, length_s: f64) -> Vec<Range<usize>> {
    let mut out = vec![];
    for piece in fixes.pieces() {
        let t = &fixes.t[piece.clone()];
        let (first, last) = crate::input::span(t);
        let count = ((last - first) / length_s).round().max(1.0);
        let shortest = SHORTEST_SHARE * length_s.min(last - first);
        let (mut from, mut cut) = (0, 1.0);
        for (k, m) in starts.measure[piece.clone()].iter().enumerate() {
            let enough = k - from >= LEAST_FIXES && t[k] - t[from] >= shortest;
            let rest = t.len() - k >= LEAST_FIXES && last - t[k] >= shortest;
            if *m * count >= cut && enough && rest {
                out.push(piece.start + from..piece.start + k);
                from = k;
                cut = (*m * count).floor() + 1.0;
            }
        }
        if t.len() - from >= LEAST_FIXES {
            out.push(piece.start + from..piece.start + t.len());
        }
    }
    out
}

/// Rises from 0 to 1 over the timestamps, with time and with the change of the velocity.
fn measure(t: &[f64], motion: &Motion, delay: &dyn Fn(f64) -> f64) -> Vec<f64> {
    let (first, last) = crate::input::span(t);
    let mut hints = [0, 0];
    let mut sum = 0.0;
    let mut before = first;
    let changes: Vec<f64> = t
        .iter()
        .map(|t| {
            let q = t - delay(*t);
            let now = motion.at(q, &mut hints[0]);
            let then = motion.at(q - CHANGE_SPAN_S, &mut hints[1]);
            if now.speed().min(then.speed()) > motion.slow_mps {
                let change = speed(now.velocity[0] - then.velocity[0], now.velocity[1] - then.velocity[1]);
                sum += change * (t - before).min(CHANGE_SPAN_S);
            }
            before = *t;
            sum
        })
        .collect();
    let length = (last - first).max(1e-9);
    let share = if sum > 0.0 { TIME_SHARE } else { 1.0 };
    let of =
        |(t, c): (&f64, &f64)| share * (t - first) / length + if sum > 0.0 { (1.0 - share) * c / sum } else { 0.0 };
    t.iter().zip(&changes).map(of).collect()
}

/// Starting points of windows: their rows, and their search.
pub(crate) struct Starts<'a> {
    /// Best constant delay, s.
    pub(crate) constant_s: f64,
    /// Delay of the coarse path.
    path: &'a dyn Fn(f64) -> f64,
    /// At each fix: rises from 0 to 1 over its piece, by the same amount over each window.
    measure: Vec<f64>,
}

impl<'a> Starts<'a> {
    /// For windows of any length on these fixes.
    pub(crate) fn new(fixes: &Fixes, motion: &Motion, constant_s: f64, path: &'a dyn Fn(f64) -> f64) -> Starts<'a> {
        let measure = fixes.pieces().flat_map(|piece| measure(&fixes.t[piece], motion, path)).collect();
        Starts { constant_s, path, measure }
    }
}

/// Buffers that windows share.
#[derive(Default)]
pub(crate) struct Scratch {
    steps: [Vec<Step>; 2],
    basis: [Vec<[f64; 2]>; 2],
    /// Delay column and residual of both axes: v north, v east, e north, e east.
    rows: Vec<[f64; 4]>,
    full: [Vec<[f64; 4]>; 2],
    scores: Vec<f64>,
}

/// Fits one window; `None` if it does not move, or if no start is within the velocity's record.
pub(crate) fn fit_window(
    fixes: &Fixes,
    rows: Range<usize>,
    motion: &Motion,
    shape: &NoiseShape,
    starts: &Starts,
    scratch: &mut Scratch,
) -> Option<Window> {
    let t = &fixes.t[rows.clone()];
    let y = &fixes.y[rows];
    let path = (starts.path)(t[t.len() / 2]);
    let apart = (path - starts.constant_s).abs() > STARTS_APART_S;
    prepare(t, motion, shape, starts.constant_s, scratch);
    let constant = descend(t, y, motion, starts.constant_s, scratch);
    let moved = if apart { descend(t, y, motion, path, scratch) } else { None };
    let free = (2 * t.len() - 5) as f64;
    let best = match (constant, moved) {
        (Some(c), Some(m)) if m.rss < c.rss * (1.0 - PATH_MUST_WIN / free) => m,
        (Some(c), _) => c,
        (None, Some(m)) => m,
        (None, None) => return None,
    };
    Some(summarise(t, y, motion, &best, scratch))
}

/// Filter, offset and drift of a window; jitter is applied at the speed for the delay `delay_s`. Returns the logarithm
/// of the determinants of both axes.
fn prepare(t: &[f64], motion: &Motion, shape: &NoiseShape, delay_s: f64, scratch: &mut Scratch) -> f64 {
    let mut log_det = 0.0;
    for axis in 0..2 {
        if axis == 1 && shape.jitter == 0.0 {
            let [first, second] = &mut scratch.steps;
            second.clone_from(first);
            let [first, second] = &mut scratch.basis;
            second.clone_from(first);
            return 2.0 * log_det;
        }
        let mut hint = motion_start(motion, t[0] - delay_s);
        let variance = |k: usize| match shape.jitter {
            0.0 => 0.0,
            jitter => (jitter * motion.at(t[k] - delay_s, &mut hint).velocity[axis]).powi(2),
        };
        log_det += steps(t, shape, variance, &mut scratch.steps[axis]);
        log_det += offset_and_drift(t, &scratch.steps[axis], &mut scratch.basis[axis]);
    }
    log_det
}

/// −2 log restricted likelihood of a window with these timestamps and [`columns`] at `delay_s`, with its scale profiled
/// out; `None` if it does not move.
pub(crate) fn window_likelihood(
    t: &[f64],
    columns: &[[f64; 4]],
    motion: &Motion,
    shape: &NoiseShape,
    delay_s: f64,
    scratch: &mut Scratch,
) -> Option<f64> {
    let log_det = prepare(t, motion, shape, delay_s, scratch);
    let (information, score, square) = projected(columns, &scratch.steps, &scratch.basis)?;
    let free = (2 * t.len() - 5) as f64;
    let rss = (square - score * score / information).max(1e-12);
    Some(free * (rss / free).ln() + log_det + information.ln())
}

/// End of a descent: the linearisation, and its next step.
struct Descent {
    at_s: f64,
    step_s: f64,
    rss: f64,
}

fn descend(t: &[f64], y: &[[f64; 2]], motion: &Motion, start_s: f64, scratch: &mut Scratch) -> Option<Descent> {
    let mut at_s = start_s;
    let mut last = None;
    for _ in 0..ROUNDS {
        if !(motion.knows(t[0] - at_s) && motion.knows(t[t.len() - 1] - at_s)) {
            return None;
        }
        let (information, score, square) = linearise(t, y, motion, at_s, scratch)?;
        let wanted = score / information;
        let step_s = wanted.clamp(-LARGEST_STEP_S, LARGEST_STEP_S);
        last = Some(Descent { at_s, step_s, rss: (square - wanted * wanted * information).max(0.0) });
        if step_s.abs() < STEADY_S {
            break;
        }
        at_s += step_s;
    }
    last
}

/// Information, score and sum of squared whitened residuals, with offset and drift projected out.
fn linearise(t: &[f64], y: &[[f64; 2]], motion: &Motion, at_s: f64, scratch: &mut Scratch) -> Option<(f64, f64, f64)> {
    columns(t, y, motion, at_s, &mut scratch.rows);
    projected(&scratch.rows, &scratch.steps, &scratch.basis)
}

/// Delay column and residual of both axes at the delay `at_s`, not yet whitened. Residuals are relative to the first.
pub(crate) fn columns(t: &[f64], y: &[[f64; 2]], motion: &Motion, at_s: f64, rows: &mut Vec<[f64; 4]>) {
    rows.clear();
    let mut hint = motion_start(motion, t[0] - at_s);
    let mut origin = None;
    for (t, y) in t.iter().zip(y) {
        let s = motion.at(t - at_s, &mut hint);
        let e = [y[0] - s.place[0], y[1] - s.place[1]];
        let o = *origin.get_or_insert(e);
        let v = if s.speed() > motion.slow_mps { s.velocity } else { [0.0; 2] };
        rows.push([-v[0], -v[1], e[0] - o[0], e[1] - o[1]]);
    }
}

/// The same for these rows, whitened in the process.
fn projected(rows: &[[f64; 4]], steps: &[Vec<Step>; 2], basis: &[Vec<[f64; 2]>; 2]) -> Option<(f64, f64, f64)> {
    let [north, east] = steps;
    let mut wander = [0.0; 4];
    let mut sums = [0.0; 6];
    let mut with = [[0.0; 2]; 4];
    let bases = basis[0].iter().zip(&basis[1]);
    for (((row, n), e), (q_n, q_e)) in rows.iter().zip(north).zip(east).zip(bases) {
        let steps = [n, e, n, e];
        let mut w = [0.0; 4];
        for c in 0..4 {
            let innovation = row[c] - wander[c];
            w[c] = innovation * steps[c].weight;
            wander[c] = steps[c].decay * (wander[c] + steps[c].gain * innovation);
        }
        sums[0] += w[0] * w[0];
        sums[1] += w[1] * w[1];
        sums[2] += w[0] * w[2];
        sums[3] += w[1] * w[3];
        sums[4] += w[2] * w[2];
        sums[5] += w[3] * w[3];
        for c in 0..2 {
            with[0][c] += w[0] * q_n[c];
            with[1][c] += w[1] * q_e[c];
            with[2][c] += w[2] * q_n[c];
            with[3][c] += w[3] * q_e[c];
        }
    }
    let dot = |a: usize, b: usize| with[a][0] * with[b][0] + with[a][1] * with[b][1];
    let information = sums[0] + sums[1] - dot(0, 0) - dot(1, 1);
    let score = sums[2] + sums[3] - dot(0, 2) - dot(1, 3);
    let square = sums[4] + sums[5] - dot(2, 2) - dot(3, 3);
    (information > 1e-6 * (sums[0] + sums[1]).max(1e-6)).then_some((information, score, square.max(0.0)))
}

fn motion_start(motion: &Motion, q: f64) -> usize {
    let mut hint = usize::MAX;
    motion.at(q, &mut hint);
    hint
}

/// All columns at the end of a descent: products, scores, and the correlation of the scores.
fn summarise(t: &[f64], y: &[[f64; 2]], motion: &Motion, best: &Descent, scratch: &mut Scratch) -> Window {
    let n = t.len();
    let speed = gather(t, y, motion, best.at_s, scratch);
    let (products, with_residual) = products_of(scratch);
    let information = products[0];
    let step = with_residual[0] / information;
    let rss = (with_residual[3] - step * with_residual[0]).max(0.0);
    let free = (2 * n - 5) as f64;
    let scores = [0.0, with_residual[1] - step * products[1], with_residual[2] - step * products[2]];
    Window {
        from_s: t[0],
        to_s: t[n - 1],
        middle_s: t.iter().sum::<f64>() / n as f64,
        delay_s: best.at_s + best.step_s,
        information,
        variance: rss / free,
        free,
        score_variance: bartlett(scratch, step, span_in_samples(t)) * (2 * n) as f64 / free,
        speed_mps: speed / n as f64,
        products,
        scores,
    }
}

/// Puts all columns at the delay `at_s` into the scratch, not yet whitened, and sums the speeds.
fn gather(t: &[f64], y: &[[f64; 2]], motion: &Motion, at_s: f64, scratch: &mut Scratch) -> f64 {
    let mut speed = 0.0;
    let mut hint = motion_start(motion, t[0] - at_s);
    let mut origin: Option<([f64; 2], [[f64; 2]; 2])> = None;
    scratch.full.iter_mut().for_each(Vec::clear);
    for (t, y) in t.iter().zip(y) {
        let q = t - at_s;
        let s = motion.at(q, &mut hint);
        let like = motion.resembling_at(q, &mut hint);
        let e = [y[0] - s.place[0], y[1] - s.place[1]];
        let (o, first) = *origin.get_or_insert((e, like));
        speed += s.speed();
        let v = if s.speed() > motion.slow_mps { s.velocity } else { [0.0; 2] };
        for a in 0..2 {
            scratch.full[a].push([-v[a], like[a][0] - first[a][0], like[a][1], e[a] - o[a]]);
        }
    }
    speed
}

/// Whitens the columns and removes offset and drift. Returns the products of delay, lag and lever, and those of these
/// and the residual with the residual.
fn products_of(scratch: &mut Scratch) -> ([f64; 6], [f64; 4]) {
    let mut products = [0.0; 6];
    let mut with_residual = [0.0; 4];
    for a in 0..2 {
        whiten_rows(&scratch.steps[a], &mut scratch.full[a]);
        project_out(&scratch.basis[a], &mut scratch.full[a]);
        for r in &scratch.full[a] {
            let [d, s, l, e] = *r;
            let of = [d * d, d * s, d * l, s * s, s * l, l * l];
            products.iter_mut().zip(of).for_each(|(p, x)| *p += x);
            let of = [d * e, s * e, l * e, e * e];
            with_residual.iter_mut().zip(of).for_each(|(p, x)| *p += x);
        }
    }
    (products, with_residual)
}

fn span_in_samples(t: &[f64]) -> usize {
    let interval = (t[t.len() - 1] - t[0]) / (t.len() - 1) as f64;
    ((SCORE_SPAN_S / interval.max(1e-6)).round() as usize).clamp(1, t.len() - 1)
}

fn bartlett(scratch: &mut Scratch, step: f64, lags: usize) -> f64 {
    let score = |r: &[f64; 4]| r[0] * (r[3] - step * r[0]);
    scratch.scores.clear();
    scratch.scores.extend(scratch.full[0].iter().zip(&scratch.full[1]).map(|(n, e)| score(n) + score(e)));
    let g = &scratch.scores;
    let mut sum: f64 = g.iter().map(|g| g * g).sum();
    for lag in 1..=lags.min(g.len() - 1) {
        let product: f64 = g[lag..].iter().zip(g).map(|(a, b)| a * b).sum();
        sum += 2.0 * (1.0 - lag as f64 / (lags + 1) as f64) * product;
    }
    sum.max(0.0)
}

fn project_out<const C: usize>(basis: &[[f64; 2]], rows: &mut [[f64; C]]) {
    let mut with = [[0.0; 2]; C];
    for (q, row) in basis.iter().zip(rows.iter()) {
        for c in 0..C {
            with[c][0] += row[c] * q[0];
            with[c][1] += row[c] * q[1];
        }
    }
    for (q, row) in basis.iter().zip(rows) {
        for c in 0..C {
            row[c] -= with[c][0] * q[0] + with[c][1] * q[1];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense::{Dense, Random, near, turning};
    use nalgebra::DVector;

    /// Fixes that are late by `late`, with an offset, a drift, a wander and white noise (m).
    fn fixes(t: Vec<f64>, motion: &Motion, late: f64, [wander, white]: [f64; 2], seed: u64) -> Fixes {
        let mut random = Random::new(seed);
        let mut now = [wander * random.normal(), wander * random.normal()];
        let mut before = t[0];
        let y = t
            .iter()
            .map(|t| {
                let decay = (-(t - before) / 5.0f64).exp();
                before = *t;
                let place = motion.at(t - late, &mut 0).place;
                [0, 1].map(|a| {
                    now[a] = decay * now[a] + wander * (1.0 - decay * decay).sqrt() * random.normal();
                    place[a] + [40.0, -7.0][a] + [0.02, -0.05][a] * t + now[a] + white * random.normal()
                })
            })
            .collect();
        Fixes { starts: vec![0, t.len()], y, t }
    }

    fn fitted(fixes: &Fixes, motion: &Motion, shape: &NoiseShape, [constant_s, path_s]: [f64; 2]) -> Option<Window> {
        let path = move |_: f64| path_s;
        let starts = Starts::new(fixes, motion, constant_s, &path);
        fit_window(fixes, 0..fixes.len(), motion, shape, &starts, &mut Scratch::default())
    }

    const SHAPE: NoiseShape = NoiseShape { wander: 2.0, time_constant_s: 5.0, jitter: 0.0 };

    #[test]
    fn a_noise_free_window_finds_its_delay_with_any_offset_and_drift() {
        let motion = turning(60.0);
        let mut random = Random::new(1);
        for (late, jitter) in [(0.2, 0.0), (-0.15, 0.05), (0.43, 0.0)] {
            let of = fixes(random.stamps(70, 5.0), &motion, late, [0.0; 2], 1);
            let w = fitted(&of, &motion, &NoiseShape { jitter, ..SHAPE }, [0.1, 0.1]).unwrap();
            assert!((w.delay_s - late).abs() < 1e-5, "{w:?}");
            assert!(w.variance < 1e-8 && w.free == 135.0);
            assert_eq!((w.from_s, w.to_s), (of.t[0], of.t[69]));
            assert!((w.middle_s - of.t.iter().sum::<f64>() / 70.0).abs() < 1e-9);
            let speed = of.t.iter().map(|t| motion.at(t - late, &mut 0).speed()).sum::<f64>() / 70.0;
            assert!((w.speed_mps - speed).abs() < 1e-3, "{} {speed}", w.speed_mps);
        }
    }

    /// The path is 4 s from the constant, further than four steps reach.
    #[test]
    fn a_window_starts_where_it_fits_better() {
        let motion = turning(60.0);
        let t = Random::new(2).stamps(70, 10.0);
        for (late, starts) in [(4.2, [0.2, 4.1]), (0.2, [0.25, 4.2]), (4.2, [4.1, 0.2])] {
            let of = fixes(t.clone(), &motion, late, [0.1, 0.1], 2);
            let w = fitted(&of, &motion, &SHAPE, starts).unwrap();
            assert!((w.delay_s - late).abs() < 0.03, "{starts:?}: {w:?}");
        }
        // Outside the velocity's record one start remains, or none.
        let of = fixes(t, &motion, 0.2, [0.1, 0.1], 2);
        assert!((fitted(&of, &motion, &SHAPE, [0.1, 90.0]).unwrap().delay_s - 0.2).abs() < 0.03);
        assert!((fitted(&of, &motion, &SHAPE, [90.0, 0.1]).unwrap().delay_s - 0.2).abs() < 0.03);
        assert!(fitted(&of, &motion, &SHAPE, [90.0, -90.0]).is_none());
    }

    /// Σ over all pairs of (1 − lag / (lags + 1)) gᵢ gⱼ.
    fn bartlett_by_pairs(g: &[f64], lags: usize) -> f64 {
        let share = |i: usize, j: usize| (1.0 - i.abs_diff(j) as f64 / (lags + 1) as f64).max(0.0);
        (0..g.len()).map(|i| (0..g.len()).map(|j| share(i, j) * g[i] * g[j]).sum::<f64>()).sum()
    }

    /// Delay column, lag, lever and residual of both axes at the delay `at`, white and orthogonal to offset and drift.
    fn dense_columns(of: &Fixes, motion: &Motion, shape: &NoiseShape, at: f64) -> [[DVector<f64>; 4]; 2] {
        let state = |k: usize| motion.at(of.t[k] - at, &mut 0);
        [0, 1].map(|axis| {
            let dense = Dense::new(&of.t, shape, |k| (shape.jitter * state(k).velocity[axis]).powi(2));
            let free = |f: &dyn Fn(usize) -> f64| dense.free(&(0..of.len()).map(f).collect::<Vec<f64>>());
            let like = |k: usize, c: usize| motion.resembling_at(of.t[k] - at, &mut 0)[axis][c];
            [
                free(&|k| -state(k).velocity[axis]),
                free(&|k| like(k, 0)),
                free(&|k| like(k, 1)),
                free(&|k| of.y[k][axis] - state(k).place[axis]),
            ]
        })
    }

    /// The least-squares delay, and all columns there, whitened and orthogonal to offset and drift, by full matrices.
    #[test]
    fn a_window_is_generalised_least_squares() {
        let motion = turning(60.0);
        for (seed, jitter) in [(3, 0.0), (4, 0.06), (5, 0.0)] {
            let t = Random::new(seed).stamps(60, 8.0);
            let lags = (2.0 * 59.0 / (t[59] - t[0])).round() as usize;
            let (of, shape) = (fixes(t, &motion, 0.3, [0.6, 0.3], seed), NoiseShape { jitter, ..SHAPE });
            let at = (0..6).fold(0.25, |at, _| fitted(&of, &motion, &shape, [at; 2]).unwrap().delay_s);
            let w = fitted(&of, &motion, &shape, [at; 2]).unwrap();
            assert!((w.delay_s - at).abs() < 1e-6, "{} {at}", w.delay_s);
            let columns = dense_columns(&of, &motion, &shape, at);
            let product = |i: usize, j: usize| columns.iter().map(|c| c[i].dot(&c[j])).sum::<f64>();
            let score = product(0, 3) / (product(0, 0) * product(3, 3)).sqrt();
            assert!(score.abs() < 1e-6, "nothing more is to be gained by another delay: {score}");
            let expected = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|(i, j)| product(i, j));
            for (found, expected) in w.products.iter().zip(expected).chain([(&w.information, expected[0])]) {
                assert!(near(*found, expected, 1e-5), "{:?} {expected:?}", w.products);
            }
            for (found, expected) in w.scores.iter().zip([0.0, product(1, 3), product(2, 3)]) {
                assert!((found - expected).abs() < 1e-3, "{:?} {expected}", w.scores);
            }
            assert!(near(w.variance, product(3, 3) / 115.0, 1e-6), "{} {}", w.variance, product(3, 3));
            let scores: Vec<f64> = (0..60).map(|k| columns.iter().map(|c| c[0][k] * c[3][k]).sum()).collect();
            let expected = bartlett_by_pairs(&scores, lags) * 120.0 / 115.0;
            assert!(near(w.score_variance, expected, 1e-4), "{} {expected}", w.score_variance);
        }
    }

    #[test]
    fn the_likelihood_of_a_window_matches_the_dense_formula() {
        let motion = turning(60.0);
        let t = Random::new(6).stamps(50, 3.0);
        let of = fixes(t.clone(), &motion, 0.3, [0.6, 0.3], 6);
        let mut scratch = Scratch::default();
        for (wander, time_constant_s, jitter) in
            [(0.5, 2.0, 0.0), (3.0, 30.0, 0.0), (2.0, 5.0, 0.08), (20.0, 0.7, 0.01)]
        {
            let shape = NoiseShape { wander, time_constant_s, jitter };
            let mut rows = vec![];
            columns(&t, &of.y, &motion, 0.28, &mut rows);
            let found = window_likelihood(&t, &rows, &motion, &shape, 0.28, &mut scratch).unwrap();
            let columns = dense_columns(&of, &motion, &shape, 0.28);
            let product = |i: usize, j: usize| columns.iter().map(|c| c[i].dot(&c[j])).sum::<f64>();
            let (information, score, square) = (product(0, 0), product(0, 3), product(3, 3));
            let log_det: f64 = [0, 1]
                .map(|axis| {
                    let velocity = |k: usize| motion.at(t[k] - 0.28, &mut 0).velocity[axis];
                    let dense = Dense::new(&t, &shape, |k| (jitter * velocity(k)).powi(2));
                    dense.log_det_noise + dense.log_det_nuisance
                })
                .iter()
                .sum();
            let rss = square - score * score / information;
            let expected = 95.0 * (rss / 95.0).ln() + log_det + information.ln();
            assert!(near(found, expected, 1e-7), "{shape:?}: {found} {expected}");
        }
    }

    /// Errors over uncertainties of a hundred windows: chi-squared with a hundred degrees of freedom is within 60 to
    /// 150 with 99.9 %.
    #[test]
    fn uncertainties_of_windows_are_calibrated() {
        let motion = turning(60.0);
        let square = |seed: u64| {
            let of = fixes(Random::new(seed).stamps(60, 2.0 + 0.2 * seed as f64), &motion, 0.3, [0.6, 0.3], seed);
            let w = fitted(&of, &motion, &SHAPE, [0.25; 2]).unwrap();
            (w.delay_s - 0.3).powi(2) * w.information / w.variance
        };
        let squares: f64 = (100..200).map(square).sum();
        assert!((60.0..150.0).contains(&squares), "{squares}");
    }

    /// The world turned by a quarter: north becomes east, and east becomes south.
    #[test]
    fn a_window_is_the_same_in_a_turned_world() {
        let grid: Vec<f64> = (0..1500).map(|k| 0.04 * f64::from(k) - 5.0).collect();
        let here = turning(60.0);
        let velocity: Vec<[f64; 2]> = grid.iter().map(|t| here.at(*t, &mut 0).velocity).collect();
        let [north, east]: [Vec<f64>; 2] = [0, 1].map(|a| velocity.iter().map(|v| v[a]).collect());
        let south: Vec<f64> = east.iter().map(|e| -e).collect();
        let (motion, turned) = (Motion::new(&grid, &north, &east), Motion::new(&grid, &south, &north));
        let of = fixes(Random::new(7).stamps(60, 2.0), &motion, 0.3, [0.6, 0.3], 7);
        let of_turned = Fixes { y: of.y.iter().map(|y| [-y[1], y[0]]).collect(), ..of.clone() };
        let shape = NoiseShape { jitter: 0.05, ..SHAPE };
        let (a, b) =
            (fitted(&of, &motion, &shape, [0.2; 2]).unwrap(), fitted(&of_turned, &turned, &shape, [0.2; 2]).unwrap());
        assert!((a.delay_s - b.delay_s).abs() < 1e-9 && near(a.score_variance, b.score_variance, 1e-8));
        assert!(a.products.iter().zip(b.products).all(|(x, y)| near(*x, y, 1e-8)), "{a:?} {b:?}");
        assert!(a.scores.iter().zip(b.scores).all(|(x, y)| (x - y).abs() < 1e-6), "{a:?} {b:?}");
    }

    fn circling(turns: impl Fn(f64) -> bool) -> Motion {
        let t: Vec<f64> = (0..6000).map(|k| 0.04 * f64::from(k) - 20.0).collect();
        let mut heading = 0.0;
        let headings: Vec<f64> = t
            .iter()
            .map(|t| {
                heading += if turns(*t) { 0.02 } else { 0.0 };
                heading
            })
            .collect();
        let of = |f: fn(f64) -> f64| headings.iter().map(|h| 15.0 * f(*h)).collect::<Vec<f64>>();
        Motion::new(&t, &of(f64::cos), &of(f64::sin))
    }

    /// Half of the measure is time, half the change of the velocity; on a straight line it is all time.
    #[test]
    fn the_measure_rises_with_time_and_with_turns() {
        let t: Vec<f64> = (0..=400).map(|k| 0.25 * f64::from(k)).collect();
        let of = |turns: fn(f64) -> bool| measure(&t, &circling(turns), &|_| 0.0);
        for (turns, at_half, at_three_quarters) in [
            ((|_| true) as fn(f64) -> bool, 0.5, 0.75),
            (|_| false, 0.5, 0.75),
            (|t| t > 50.0, 0.25, 0.625),
            (|t| t < 50.0, 0.75, 0.875),
        ] {
            let m = of(turns);
            assert!(m[0].abs() < 0.01 && (m[400] - 1.0).abs() < 1e-9 && m.windows(2).all(|w| w[1] >= w[0]));
            assert!((m[200] - at_half).abs() < 0.01, "{} {at_half}", m[200]);
            assert!((m[300] - at_three_quarters).abs() < 0.01, "{} {at_three_quarters}", m[300]);
        }
        let late = measure(&t, &circling(|t| t > 50.0), &|_| 10.0);
        assert!(late[200] < 0.26 && (late[239] - late[200] - 0.5 * 0.0975).abs() < 0.01, "the turn is seen 10 s later");
    }

    #[test]
    fn windows_tile_every_piece_and_are_shorter_where_it_turns() {
        let t: Vec<f64> = (0..500).map(|k| 0.25 * f64::from(k)).collect();
        let of = Fixes { y: vec![[0.0; 2]; 500], starts: vec![0, 400, 410, 500], t };
        let tiled = |motion: &Motion, length_s: f64| {
            let late = |_: f64| 0.0;
            tile(&of, &Starts::new(&of, motion, 0.0, &late), length_s)
        };
        let even = tiled(&circling(|_| true), 10.0);
        // 100 s make ten windows; ten fixes are too few; 22 s make two.
        assert_eq!(even.len(), 12);
        assert!(even.iter().all(|w| w.len() >= LEAST_FIXES));
        assert!(even[..10].iter().all(|w| w.len().abs_diff(40) <= 2), "{even:?}");
        assert_eq!((even[9].end, even[10].start, even[11].end), (400, 410, 500));
        assert!(even[..10].windows(2).all(|w| w[0].end == w[1].start) && even[0].start == 0);
        let late = tiled(&circling(|t| t > 50.0), 10.0);
        let [before, after] = [late[0].len(), late[7].len()];
        assert!(before > 60 && (24..34).contains(&after), "{late:?}");
        assert!(late.iter().all(|w| (w.len() - 1) as f64 * 0.25 >= 0.6 * 10.0 - 0.51), "{late:?}");
    }

    #[test]
    fn a_stationary_window_gives_no_result() {
        let grid: Vec<f64> = (0..1000).map(|k| 0.04 * f64::from(k)).collect();
        let speed: Vec<f64> = grid.iter().map(|t| if *t > 30.0 { 20.0 } else { 0.1 * t.sin() }).collect();
        let motion = Motion::new(&grid, &speed, &vec![0.0; 1000]);
        let t: Vec<f64> = (0..60).map(|k| 1.0 + 0.2 * f64::from(k)).collect();
        let of = Fixes { y: Random::new(9).pairs(60, 0.3), starts: vec![0, 60], t };
        assert!(fitted(&of, &motion, &SHAPE, [0.2; 2]).is_none());
    }
}
