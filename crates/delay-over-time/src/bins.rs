//! The flexible fit (S3): a delay that is constant within each bin and follows a random walk from bin to bin.

use crate::fixes::Fixes;
use crate::motion::Motion;
use crate::whitening::{NoiseShape, Step, steps};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// A bin's column is dropped once the filter retains less than this share of it.
const FORGOTTEN: f64 = 1e-7;
/// Most bins whose columns are kept at a time: bounds the cost if the filter forgets slowly.
const MOST_ACTIVE: usize = 24;
/// Prevents division by zero for nuisance parameters that the data do not determine, as a share of their information.
const RIDGE: f64 = 1e-12;

/// Noise of the position with its scale.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Noise {
    pub(crate) shape: NoiseShape,
    /// Standard deviation of the white part, m.
    pub(crate) white_m: f64,
}

/// Whitened residuals and bin columns, with offset and drift of every piece projected out.
pub(crate) struct Normal {
    /// Products of the bin columns.
    pub(crate) a: DMatrix<f64>,
    /// Products with the residuals.
    pub(crate) b: DVector<f64>,
    /// Square of the whitened residuals.
    pub(crate) rss: f64,
    /// Logarithm of the determinants of noise and nuisances.
    pub(crate) log_det: f64,
}

/// Rows for [`normal`]: residuals and velocities at the linearisation, and the bin of each.
pub(crate) struct Rows<'a> {
    pub(crate) t: &'a [f64],
    pub(crate) e: &'a [[f64; 2]],
    pub(crate) v: &'a [[f64; 2]],
    pub(crate) bin: &'a [usize],
    /// First row of each piece, and the number of rows.
    pub(crate) starts: &'a [usize],
}

/// Normal equations of `bins` bins, without any prior.
pub(crate) fn normal(rows: &Rows, bins: usize, noise: &Noise) -> Normal {
    let mut out = Normal { a: DMatrix::zeros(bins, bins), b: DVector::zeros(bins), rss: 0.0, log_det: 0.0 };
    let mut filter = vec![];
    for w in rows.starts.windows(2) {
        let piece = w[0]..w[1];
        for axis in 0..2 {
            if axis == 0 || noise.shape.jitter > 0.0 {
                let extra = |k: usize| (noise.shape.jitter * rows.v[piece.start + k][axis]).powi(2);
                out.log_det += steps(&rows.t[piece.clone()], &noise.shape, extra, &mut filter);
            } else {
                out.log_det += filter_log_det(&filter);
            }
            out.log_det += 2.0 * piece.len() as f64 * noise.white_m.ln();
            add_axis(&mut out, rows, piece.clone(), axis, &filter, noise.white_m);
        }
    }
    let bins = out.a.nrows();
    for i in 0..bins {
        for j in i + 1..bins {
            out.a[(i, j)] = out.a[(j, i)];
        }
    }
    out
}

fn filter_log_det(filter: &[Step]) -> f64 {
    filter.iter().map(|s| -2.0 * s.weight.ln()).sum()
}

/// Columns of the bins that the filter still retains.
struct Active {
    /// First bin, and number of bins.
    lo: usize,
    held: usize,
    /// Filter state of each, and its whitened value.
    wander: [f64; MOST_ACTIVE + 1],
    white: [f64; MOST_ACTIVE + 1],
}

impl Active {
    /// Adds the columns up to that of `bin`. If there are too many, drops the first.
    #[inline]
    fn reach(&mut self, bin: usize) {
        while self.lo + self.held <= bin {
            if self.held == MOST_ACTIVE {
                self.wander.copy_within(1..self.held, 0);
                self.lo += 1;
                self.held -= 1;
            }
            self.wander[self.held] = 0.0;
            self.held += 1;
        }
    }

    /// A fix of velocity `v` in `bin`.
    #[inline]
    fn whiten(&mut self, bin: usize, v: f64, step: &Step, weight: f64) {
        for i in 0..self.held {
            let column = if self.lo + i == bin { -v } else { 0.0 };
            let innovation = column - self.wander[i];
            self.white[i] = innovation * weight;
            self.wander[i] = step.decay * (self.wander[i] + step.gain * innovation);
        }
    }

    /// Drops the first columns whose remainder is negligible.
    #[inline]
    fn forget(&mut self, v: f64) {
        let mut gone = 0;
        while gone + 1 < self.held && self.wander[gone].abs() < FORGOTTEN * (v.abs() + 0.1) {
            gone += 1;
        }
        if gone > 0 {
            self.wander.copy_within(gone..self.held, 0);
            self.lo += gone;
            self.held -= gone;
        }
    }
}

/// Contribution of one axis of one piece; lower triangle of `a` only.
fn add_axis(out: &mut Normal, rows: &Rows, piece: std::ops::Range<usize>, axis: usize, filter: &[Step], white_m: f64) {
    let Some(&first) = rows.bin.get(piece.start) else { return };
    let (start, end) = crate::input::span(&rows.t[piece.clone()]);
    let length = (end - start).max(1e-9);
    let scale = 1.0 / white_m;
    let mut active = Active { lo: first, held: 1, wander: [0.0; MOST_ACTIVE + 1], white: [0.0; MOST_ACTIVE + 1] };
    let (mut wander, mut drift) = ([0.0; 2], 0.0);
    let last = rows.bin[piece.end - 1];
    let mut with = vec![[0.0; 2]; last + 1 - first];
    let (mut products, mut with_residual) = ([0.0; 3], [0.0; 2]);
    for (k, step) in piece.zip(filter) {
        active.reach(rows.bin[k]);
        let weight = step.weight * scale;
        let v = rows.v[k][axis];
        active.whiten(rows.bin[k], v, step, weight);
        let white = |value: f64, wander: &mut f64| {
            let innovation = value - *wander;
            *wander = step.decay * (*wander + step.gain * innovation);
            innovation * weight
        };
        let e = white(rows.e[k][axis], &mut drift);
        let one = white(1.0, &mut wander[0]);
        let slope = white((rows.t[k] - start) / length - 0.5, &mut wander[1]);
        out.rss += e * e;
        products = [products[0] + one * one, products[1] + one * slope, products[2] + slope * slope];
        with_residual = [with_residual[0] + one * e, with_residual[1] + slope * e];
        let (lo, x) = (active.lo, &active.white[..active.held]);
        for (i, of_bin) in x.iter().enumerate() {
            out.b[lo + i] += of_bin * e;
            with[lo + i - first][0] += of_bin * one;
            with[lo + i - first][1] += of_bin * slope;
            for (j, other) in x[..=i].iter().enumerate() {
                out.a[(lo + i, lo + j)] += of_bin * other;
            }
        }
        active.forget(v);
    }
    project(out, first, &with, products, with_residual);
}

/// Projects out offset and drift of one axis of one piece.
fn project(out: &mut Normal, first: usize, with: &[[f64; 2]], products: [f64; 3], with_residual: [f64; 2]) {
    let d = [1.0 / (products[0] + 1e-300).sqrt(), 1.0 / (products[2] + 1e-300).sqrt()];
    let (aa, ab, bb) =
        (products[0] * d[0] * d[0] + RIDGE, products[1] * d[0] * d[1], products[2] * d[1] * d[1] + RIDGE);
    let det = aa * bb - ab * ab;
    let inverse = [bb / det, -ab / det, aa / det];
    let solve = |x: [f64; 2]| [inverse[0] * x[0] + inverse[1] * x[1], inverse[1] * x[0] + inverse[2] * x[1]];
    let m = [with_residual[0] * d[0], with_residual[1] * d[1]];
    let solved_m = solve(m);
    out.rss -= m[0] * solved_m[0] + m[1] * solved_m[1];
    out.log_det += det.ln() - 2.0 * (d[0].ln() + d[1].ln());
    for (i, w) in with.iter().enumerate() {
        let w = [w[0] * d[0], w[1] * d[1]];
        out.b[first + i] -= w[0] * solved_m[0] + w[1] * solved_m[1];
        let s = solve(w);
        for (j, u) in with[..=i].iter().enumerate() {
            out.a[(first + i, first + j)] -= s[0] * u[0] * d[0] + s[1] * u[1] * d[1];
        }
    }
}

/// The most likely delays under a random walk from bin to bin.
pub(crate) struct Walk {
    /// −2 log restricted likelihood.
    pub(crate) cost: f64,
    /// Delay of each bin, s.
    pub(crate) delay_s: DVector<f64>,
    factor: Cholesky<f64, Dyn>,
}

impl Walk {
    /// Standard uncertainty of each bin's delay, s.
    pub(crate) fn uncertainty_s(&self) -> Vec<f64> {
        self.factor.inverse().diagonal().iter().map(|v| v.max(0.0).sqrt()).collect()
    }
}

/// The walk of variance `q` (s²) per bin; `z = b + A θ` at the linearisation θ, `c` the constant part of the cost.
pub(crate) fn walk(a: &DMatrix<f64>, z: &DVector<f64>, c: f64, q: f64) -> Option<Walk> {
    let bins = z.len();
    let mut sum = a.clone();
    for i in 0..bins {
        let neighbours = usize::from(i > 0) + usize::from(i + 1 < bins);
        sum[(i, i)] += neighbours as f64 / q + 1e-12;
        // The factorisation reads the lower half only.
        if i + 1 < bins {
            sum[(i + 1, i)] -= 1.0 / q;
        }
    }
    let factor = sum.cholesky()?;
    let delay_s = factor.solve(z);
    let log_det: f64 = factor.l_dirty().diagonal().iter().map(|d| d.ln()).sum();
    let cost = c - z.dot(&delay_s) + 2.0 * log_det + (bins as f64 - 1.0) * q.ln() - (bins as f64).ln();
    (cost.is_finite() && delay_s.iter().all(|d| d.is_finite())).then_some(Walk { cost, delay_s, factor })
}

/// The flexible fit.
pub(crate) struct Flexible {
    pub(crate) middle_s: Vec<f64>,
    /// Products of the bin columns, and A θ + b: sufficient for all descriptions.
    pub(crate) a: DMatrix<f64>,
    pub(crate) z: DVector<f64>,
    pub(crate) delay_s: Vec<f64>,
    pub(crate) uncertainty_s: Vec<f64>,
    pub(crate) cost: f64,
    /// Number of fixes used.
    used: usize,
}

/// Variances of the walk that are tried, s² per bin.
const WALKS: [f64; 8] = [1e-9, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1];
const ROUNDS: usize = 4;
const LARGEST_STEP_S: f64 = 0.4;
const STEADY_S: f64 = 3e-3;
/// Guard at the ends of the velocity's record, s.
const GUARD_S: f64 = 0.3;

/// Fits bins of `length_s` starting from the delay `start`; `None` if too few fixes are within the velocity's record.
pub(crate) fn fit(
    fixes: &Fixes,
    motion: &Motion,
    noise: &Noise,
    start: &dyn Fn(f64) -> f64,
    length_s: f64,
) -> Option<Flexible> {
    let binned = Binned::new(fixes, motion, start, length_s)?;
    let starts: Vec<f64> = binned.t.iter().map(|t| start(*t)).collect();
    let mut base = bin_means(&binned.bin, binned.middle_s.len(), &starts, &binned.middle_s, start);
    let mut best: Option<(Normal, DVector<f64>, Walk)> = None;
    for _ in 0..ROUNDS {
        let (of, z, found) = binned.most_likely(fixes, motion, noise, &base)?;
        let mut largest = 0.0f64;
        for (b, d) in base.iter_mut().zip(found.delay_s.iter()) {
            let step = (d - *b).clamp(-LARGEST_STEP_S, LARGEST_STEP_S);
            largest = largest.max(step.abs());
            *b += step;
        }
        best = Some((of, z, found));
        if largest < STEADY_S {
            break;
        }
    }
    let (of, z, found) = best?;
    Some(Flexible {
        middle_s: binned.middle_s,
        uncertainty_s: found.uncertainty_s(),
        delay_s: found.delay_s.iter().copied().collect(),
        cost: found.cost,
        a: of.a,
        z,
        used: binned.rows.len(),
    })
}

/// Fixes within the velocity's record, and the bin of each.
struct Binned {
    rows: Vec<usize>,
    t: Vec<f64>,
    bin: Vec<usize>,
    /// First of these rows of each piece, and the number of rows.
    starts: Vec<usize>,
    middle_s: Vec<f64>,
}

impl Binned {
    fn new(fixes: &Fixes, motion: &Motion, start: &dyn Fn(f64) -> f64, length_s: f64) -> Option<Binned> {
        let known = |t: f64| motion.knows(t - start(t) - GUARD_S) && motion.knows(t - start(t) + GUARD_S);
        let rows: Vec<usize> = (0..fixes.len()).filter(|k| known(fixes.t[*k])).collect();
        let (first, last) = (fixes.t[*rows.first()?], fixes.t[*rows.last()?]);
        if rows.len() < 12 || last - first < length_s {
            return None;
        }
        let bins = ((last - first) / length_s).ceil().max(1.0) as usize;
        let t: Vec<f64> = rows.iter().map(|k| fixes.t[*k]).collect();
        let bin: Vec<usize> = t.iter().map(|t| (((t - first) / length_s) as usize).min(bins - 1)).collect();
        let mut starts: Vec<usize> = fixes.starts.iter().map(|s| rows.partition_point(|r| r < s)).collect();
        starts.dedup();
        let middle_s: Vec<f64> = (0..bins).map(|b| first + length_s * (b as f64 + 0.5)).collect();
        Some(Binned { rows, t, bin, starts, middle_s })
    }

    /// Normal equations linearised at the delays `base`, A θ + b, and the most likely walk.
    fn most_likely(
        &self,
        fixes: &Fixes,
        motion: &Motion,
        noise: &Noise,
        base: &[f64],
    ) -> Option<(Normal, DVector<f64>, Walk)> {
        let (e, v) = residuals(fixes, &self.rows, motion, &self.bin, base);
        let rows = Rows { t: &self.t, e: &e, v: &v, bin: &self.bin, starts: &self.starts };
        let of = normal(&rows, self.middle_s.len(), noise);
        let at = DVector::from_vec(base.to_vec());
        let z = &of.b + &of.a * &at;
        let c = of.rss + 2.0 * of.b.dot(&at) + at.dot(&(&of.a * &at)) + of.log_det;
        let found = WALKS.iter().filter_map(|q| walk(&of.a, &z, c, *q)).min_by(|a, b| a.cost.total_cmp(&b.cost))?;
        Some((of, z, found))
    }
}

#[cfg(test)]
impl Flexible {
    /// Built from these sufficient statistics, as if the most likely walk were the least-squares level of each bin.
    pub(crate) fn example(middle_s: Vec<f64>, a: DMatrix<f64>, z: DVector<f64>) -> Flexible {
        let delay_s: Vec<f64> = z.iter().zip(a.diagonal().iter()).map(|(z, a)| z / a).collect();
        let uncertainty_s = a.diagonal().iter().map(|a| 1.0 / a.sqrt()).collect();
        Flexible { middle_s, a, z, delay_s, uncertainty_s, cost: 0.0, used: 100 }
    }
}

impl Flexible {
    /// Whether this fits better than `other` on at least as many fixes.
    pub(crate) fn beats(&self, other: &Flexible) -> bool {
        let more = self.used as f64 / other.used.max(1) as f64;
        if (more - 1.0).abs() < 0.02 {
            self.cost / self.used as f64 <= other.cost / other.used as f64
        } else {
            more > 1.0
        }
    }
}

fn bin_means(bin: &[usize], bins: usize, start: &[f64], middle_s: &[f64], of: &dyn Fn(f64) -> f64) -> Vec<f64> {
    let mut sums = vec![(0.0, 0.0); bins];
    for (b, s) in bin.iter().zip(start) {
        sums[*b].0 += s;
        sums[*b].1 += 1.0;
    }
    sums.iter().zip(middle_s).map(|(s, m)| if s.1 > 0.0 { s.0 / s.1 } else { of(*m) }).collect()
}

type Pairs = Vec<[f64; 2]>;

fn residuals(fixes: &Fixes, rows: &[usize], motion: &Motion, bin: &[usize], base: &[f64]) -> (Pairs, Pairs) {
    let mut hint = 0;
    let mut origin = None;
    rows.iter()
        .zip(bin)
        .map(|(k, b)| {
            let s = motion.at(fixes.t[*k] - base[*b], &mut hint);
            let e = [fixes.y[*k][0] - s.place[0], fixes.y[*k][1] - s.place[1]];
            let o = *origin.get_or_insert(e);
            ([e[0] - o[0], e[1] - o[1]], s.velocity)
        })
        .unzip()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bin_statistics::step_or_excursion;
    use crate::dense::{Dense, Random, near, turning};

    fn vectors() -> serde_json::Value {
        serde_json::from_str(include_str!("../tests/vectors.json")).unwrap()
    }

    fn close(found: f64, expected: &serde_json::Value, what: &str) {
        let expected = expected.as_f64().unwrap();
        let tolerance = 1e-9 * expected.abs().max(1.0);
        assert!((found - expected).abs() < tolerance, "{what}: {found} instead of {expected}");
    }

    /// Normal equations of the acceptance vectors.
    fn of_the_vectors() -> Normal {
        let t: Vec<f64> = (0..24).map(|k| 0.5 * f64::from(k) + 0.05 * (1.7 * f64::from(k)).sin()).collect();
        let vel: Vec<[f64; 2]> = t.iter().map(|t| [15.0 * (0.5 * t).cos(), 15.0 * (0.5 * t).sin()]).collect();
        let e: Vec<[f64; 2]> = (0..24)
            .map(|k| {
                let k = f64::from(k);
                [0.3 * (2.1 * k).sin() + 0.2 * (0.3 * k).cos(), 0.25 * (1.3 * k).cos() - 0.1 * (0.2 * k).sin()]
            })
            .collect();
        let bin: Vec<usize> = t.iter().map(|x| (((x - t[0]) / 2.0) as usize).min(5)).collect();
        let shape = NoiseShape { wander: 0.8 / 0.3, time_constant_s: 15.0, jitter: 0.0 };
        let rows = Rows { t: &t, e: &e, v: &vel, bin: &bin, starts: &[0, 24] };
        normal(&rows, 6, &Noise { shape, white_m: 0.3 })
    }

    /// `algebra` of the acceptance vectors.
    #[test]
    fn the_normal_equations_and_the_walk_equal_the_acceptance_vectors() {
        let all = vectors();
        let v = &all["algebra"];
        let n = of_the_vectors();
        for i in 0..6 {
            for j in 0..6 {
                close(n.a[(i, j)], &v["A_projected"][i][j], "A");
            }
            close(n.b[i], &v["b_projected"][i], "b");
        }
        close(n.rss, &v["rss_projected"], "rss");
        let theta: DVector<f64> = DVector::from_vec(serde_json::from_value(v["theta_lin"].clone()).unwrap());
        let z = &n.b + &n.a * &theta;
        let c = n.rss + 2.0 * n.b.dot(&theta) + theta.dot(&(&n.a * &theta)) + n.log_det;
        let w = walk(&n.a, &z, c, 0.002).unwrap();
        let band = w.uncertainty_s();
        for i in 0..6 {
            close(z[i], &v["z"][i], "z");
            close(w.delay_s[i], &v["theta"][i], "theta");
            close(band[i], &v["band"][i], "band");
        }
        close(n.log_det, &v["logdet_plus_nuisance"], "log det");
        close(w.cost, &v["neg2_log_likelihood"], "-2 log L");
        let widest = step_or_excursion(&n.a, &z).unwrap();
        close(widest, &v["statistics"]["step_or_excursion"], "step or excursion");
    }

    #[test]
    fn dropping_a_forgotten_column_changes_nothing() {
        let t: Vec<f64> = (0..400).map(|k| 0.2 * f64::from(k)).collect();
        let v: Vec<[f64; 2]> = t.iter().map(|t| [15.0 * (0.5 * t).cos(), 15.0 * (0.5 * t).sin()]).collect();
        let e: Vec<[f64; 2]> = t.iter().map(|t| [(3.1 * t).sin(), (2.3 * t).cos()]).collect();
        let bin: Vec<usize> = t.iter().map(|t| (t / 4.0) as usize).collect();
        let shape = NoiseShape { wander: 4.0, time_constant_s: 20.0, jitter: 0.0 };
        let rows = Rows { t: &t, e: &e, v: &v, bin: &bin, starts: &[0, 400] };
        let fine = normal(&rows, 20, &Noise { shape, white_m: 0.3 });
        let one = normal(&Rows { bin: &[0; 400], ..rows }, 1, &Noise { shape, white_m: 0.3 });
        assert!((fine.a.sum() - one.a[(0, 0)]).abs() < 1e-5 * one.a[(0, 0)]);
        assert!((fine.b.sum() - one.b[0]).abs() < 1e-5 * one.a[(0, 0)].sqrt());
    }

    /// Products of the bin columns, with and of the residuals, and the determinants, from full matrices.
    fn dense_normal(rows: &Rows, bins: usize, noise: &Noise) -> Normal {
        let mut out = Normal { a: DMatrix::zeros(bins, bins), b: DVector::zeros(bins), rss: 0.0, log_det: 0.0 };
        for w in rows.starts.windows(2) {
            let piece = w[0]..w[1];
            for axis in 0..2 {
                let dense = Dense::new(&rows.t[piece.clone()], &noise.shape, |k| {
                    (noise.shape.jitter * rows.v[piece.start + k][axis]).powi(2)
                });
                let of_bin = |b: usize| {
                    let column: Vec<f64> =
                        piece.clone().map(|k| if rows.bin[k] == b { -rows.v[k][axis] } else { 0.0 }).collect();
                    dense.free(&column) / noise.white_m
                };
                let columns: Vec<DVector<f64>> = (0..bins).map(of_bin).collect();
                let e: Vec<f64> = piece.clone().map(|k| rows.e[k][axis]).collect();
                let e = dense.free(&e) / noise.white_m;
                out.a += DMatrix::from_fn(bins, bins, |i, j| columns[i].dot(&columns[j]));
                out.b += DVector::from_fn(bins, |i, _| columns[i].dot(&e));
                out.rss += e.norm_squared();
                // XᵀV⁻¹X of two columns is divided by the variance of the white noise twice.
                out.log_det += dense.log_det_noise + 2.0 * piece.len() as f64 * noise.white_m.ln();
                out.log_det += dense.log_det_nuisance - 4.0 * noise.white_m.ln();
            }
        }
        out
    }

    /// Three pieces that share bins, irregular timestamps, noise with and without jitter, and a bin without a fix.
    #[test]
    fn the_normal_equations_match_the_dense_formula() {
        let mut random = Random::new(5);
        for (jitter, white_m, wander) in [(0.0, 0.3, 3.0), (0.4, 0.7, 0.5), (0.1, 2.0, 20.0)] {
            let t = random.stamps(70, 500.0);
            let (e, v) = (random.pairs(70, 1.5), random.pairs(70, 9.0));
            let bin: Vec<usize> =
                t.iter().map(|x| ((x - t[0]) / 3.0) as usize).map(|b| b + usize::from(b > 4)).collect();
            let bins = bin[69] + 1;
            let rows = Rows { t: &t, e: &e, v: &v, bin: &bin, starts: &[0, 21, 48, 70] };
            let noise = Noise { shape: NoiseShape { wander, time_constant_s: 5.0, jitter }, white_m };
            let (fast, dense) = (normal(&rows, bins, &noise), dense_normal(&rows, bins, &noise));
            let size = dense.a.amax();
            assert!((&fast.a - &dense.a).amax() < 1e-7 * size, "{}", &fast.a - &dense.a);
            assert!((&fast.b - &dense.b).amax() < 1e-7 * dense.b.amax(), "{}", &fast.b - &dense.b);
            assert!(near(fast.rss, dense.rss, 1e-9), "{} {}", fast.rss, dense.rss);
            assert!(near(fast.log_det, dense.log_det, 1e-9), "{} {}", fast.log_det, dense.log_det);
        }
    }

    /// With the first noise the filter remembers one fix, with the second about twelve: 24 bins have 96.
    #[test]
    fn more_bins_than_are_kept_cost_little_accuracy() {
        let mut random = Random::new(6);
        let t = random.stamps(160, 0.0);
        let (e, v) = (random.pairs(160, 0.5), random.pairs(160, 9.0));
        let bin: Vec<usize> = (0..160).map(|k| k / 4).collect();
        let rows = Rows { t: &t, e: &e, v: &v, bin: &bin, starts: &[0, 160] };
        for (wander, time_constant_s) in [(0.05, 0.3), (1.0, 100.0)] {
            let noise = Noise { shape: NoiseShape { wander, time_constant_s, jitter: 0.0 }, white_m: 0.5 };
            let (fast, dense) = (normal(&rows, 40, &noise), dense_normal(&rows, 40, &noise));
            assert!((&fast.a - &dense.a).amax() < 1e-3 * dense.a.amax(), "{wander}");
            assert!((&fast.b - &dense.b).amax() < 1e-3 * dense.b.amax(), "{wander}");
        }
    }

    /// Prior of a walk: (θᵢ₊₁ − θᵢ)² / q, and an unknown level.
    #[test]
    fn the_walk_is_the_posterior_of_a_random_walk() {
        let mut random = Random::new(7);
        let n = 7;
        let root = DMatrix::from_fn(n, n, |_, _| random.normal());
        let a = &root * root.transpose() * 50.0;
        let z = DVector::from_fn(n, |_, _| 20.0 * random.normal());
        let increments = DMatrix::from_fn(n - 1, n, |i, j| f64::from(j == i + 1) - f64::from(j == i));
        let mut shift = None;
        for q in [1e-6, 1e-4, 0.01, 3.0] {
            let sum = &a + increments.transpose() * &increments / q;
            let inverse = sum.clone().try_inverse().unwrap();
            let found = walk(&a, &z, 11.0, q).unwrap();
            let expected = &inverse * &z;
            assert!((&found.delay_s - &expected).amax() < 1e-7 * expected.amax(), "{q}");
            for (u, v) in found.uncertainty_s().iter().zip(inverse.diagonal().iter()) {
                assert!(near(*u, v.sqrt(), 1e-8), "{q}");
            }
            // −2 log L: quadratic form, posterior and prior determinant. The prior of n − 1 increments in θ is flat in
            // the level; det DDᵀ = n.
            let ddt = &increments * increments.transpose();
            let prior = -(ddt.determinant().ln() - (n as f64 - 1.0) * q.ln());
            let cost = 11.0 - z.dot(&expected) + sum.determinant().ln() + prior;
            let difference = found.cost - cost;
            assert!(near(difference, *shift.get_or_insert(difference), 1e-6), "{q}: {difference}");
            assert!(difference.abs() < 1e-6, "{q}: {difference}");
        }
        assert!(walk(&a, &z.map(|_| f64::NAN), 0.0, 1.0).is_none());
    }

    fn late(delay: impl Fn(f64) -> f64, noise: f64, motion: &Motion) -> Fixes {
        let mut random = Random::new(8);
        let t: Vec<f64> = (0..600).map(|k| 0.2 * f64::from(k)).collect();
        let y = t.iter().map(|t| motion.at(t - delay(*t), &mut 0).place.map(|p| p + 30.0 + noise * random.normal()));
        Fixes { y: y.collect(), t, starts: vec![0, 200, 600] }
    }

    /// A delay that climbs from 0.1 s to 0.4 s, with noise of 0.1 m at 15 m/s.
    #[test]
    fn the_flexible_fit_follows_a_climbing_delay() {
        let motion = turning(120.0);
        let truth = |t: f64| 0.1 + 0.3 * t / 120.0;
        let fixes = late(truth, 0.1, &motion);
        let shape = NoiseShape { wander: 0.2, time_constant_s: 10.0, jitter: 0.0 };
        let found = fit(&fixes, &motion, &Noise { shape, white_m: 0.1 }, &|_| 0.3, 4.0).unwrap();
        assert_eq!(found.middle_s.len(), 30);
        let mut squares = 0.0;
        for ((t, d), u) in found.middle_s.iter().zip(&found.delay_s).zip(&found.uncertainty_s) {
            assert!((2e-4..0.01).contains(u), "{u}");
            // Within a bin the delay climbs by 10 ms. Its mean is the value at the middle.
            squares += ((d - truth(*t)) / (u + 1e-3)).powi(2);
        }
        assert!(squares < 60.0, "chi-squared with 30 degrees of freedom: {squares}");
        assert!((found.middle_s[0] - 2.0).abs() < 1e-9 && (found.middle_s[29] - 118.0).abs() < 1e-9);
        let worse = fit(&fixes, &motion, &Noise { shape, white_m: 0.1 }, &|_| 9.0, 4.0).unwrap();
        assert!(found.beats(&worse) && !worse.beats(&found));
    }

    #[test]
    fn a_distant_position_does_not_change_the_delay() {
        let motion = turning(120.0);
        let fixes = late(|_| 0.25, 0.2, &motion);
        let shape = NoiseShape { wander: 1.0, time_constant_s: 10.0, jitter: 0.01 };
        let delays =
            |fixes: &Fixes| fit(fixes, &motion, &Noise { shape, white_m: 0.2 }, &|_| 0.2, 4.0).unwrap().delay_s;
        let here = delays(&fixes);
        let mut moved = fixes.clone();
        for (k, y) in moved.y.iter_mut().enumerate() {
            // Each piece has its own offset and drift.
            let drift = if k < 200 { 0.01 } else { -0.02 } * moved.t[k];
            *y = [y[0] + 4000.0 + drift, y[1] - 300.0 * f64::from(u8::from(k >= 200)) - drift];
        }
        assert!(here.iter().zip(&delays(&moved)).all(|(a, b)| (a - b).abs() < 1e-5));
    }
}
