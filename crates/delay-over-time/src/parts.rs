//! Normal equations of delay changes on a stretch of fixes, with offset and drift projected out (S7).

use crate::bins::Noise;
use crate::whitening::{Step, offset_and_drift, steps};
use nalgebra::{DMatrix, DVector};

/// Least number of fixes that carry information.
const LEAST_FIXES: usize = 8;

/// Residual, m, and velocity, m/s, of a fix at a given delay: north, east.
#[derive(Clone, Copy)]
pub(crate) struct Seen {
    pub(crate) e: [f64; 2],
    pub(crate) v: [f64; 2],
}

/// Fixes of a stretch, evaluated at a given delay.
#[derive(Default)]
pub(crate) struct Sight {
    t: Vec<f64>,
    seen: Vec<Seen>,
    /// Column values of each change, fix by fix.
    pub(crate) columns: Vec<f64>,
}

impl Sight {
    pub(crate) fn push(&mut self, t: f64, seen: &Seen) {
        self.t.push(t);
        self.seen.push(*seen);
    }

    pub(crate) fn clear(&mut self) {
        self.t.clear();
        self.seen.clear();
        self.columns.clear();
    }
}

/// Whitening of the timestamps `t`; reused from one delay to the next while it stays the same.
#[derive(Default, Clone)]
pub(crate) struct Filters {
    t: Vec<f64>,
    filter: Vec<Step>,
    basis: Vec<[f64; 2]>,
}

impl Filters {
    /// Prepares for `axis`. Jitter depends on the velocity, so then nothing can be reused.
    fn prepare(&mut self, sight: &Sight, noise: &Noise, axis: usize) {
        let jitter = noise.shape.jitter;
        if jitter == 0.0 && self.t == sight.t {
            return;
        }
        self.t.clone_from(&sight.t);
        steps(&self.t, &noise.shape, |k| (jitter * sight.seen[k].v[axis]).powi(2), &mut self.filter);
        offset_and_drift(&self.t, &self.filter, &mut self.basis);
    }
}

/// Normal equations of some fixes.
pub(crate) struct Part {
    pub(crate) normal: DMatrix<f64>,
    pub(crate) right: DVector<f64>,
    pub(crate) rss: f64,
}

impl Part {
    /// Equations of no fixes.
    pub(crate) fn none(n: usize) -> Part {
        Part { normal: DMatrix::zeros(n, n), right: DVector::zeros(n), rss: 0.0 }
    }

    /// Adds the equations of other fixes, with their own offset and drift.
    pub(crate) fn join(&mut self, other: &Part) {
        self.normal += &other.normal;
        self.right += &other.right;
        self.rss += other.rss;
    }

    pub(crate) fn of(sight: &Sight, n: usize, noise: &Noise, filters: &mut Filters) -> Part {
        let mut part = Part::none(n);
        if sight.t.len() < LEAST_FIXES {
            return part;
        }
        for axis in 0..2 {
            filters.prepare(sight, noise, axis);
            part.add(sight, axis, n, filters);
        }
        let scale = 1.0 / (noise.white_m * noise.white_m);
        part.normal *= scale;
        part.right *= scale;
        part.rss *= scale;
        part
    }

    /// Adds one axis.
    fn add(&mut self, sight: &Sight, axis: usize, n: usize, filters: &Filters) {
        // Residuals are relative to the first, so sums over long flights stay small.
        let origin = sight.seen[0].e[axis];
        // For each column, and the residual at the end: the filter state, the whitened value, and the products with the
        // offset and the drift.
        let mut columns = vec![Column::default(); n + 1];
        let mut white = vec![0.0; n + 1];
        let rows = sight.seen.iter().zip(sight.columns.chunks_exact(n)).zip(filters.filter.iter().zip(&filters.basis));
        for ((seen, shares), (step, q)) in rows {
            let (v, e) = (-seen.v[axis], seen.e[axis] - origin);
            for ((column, share), white) in columns.iter_mut().zip(shares).zip(&mut white) {
                *white = column.whiten(v * share, step, q);
            }
            let residual = columns[n].whiten(e, step, q);
            for (i, x) in white[..n].iter().enumerate().filter(|w| *w.1 != 0.0) {
                let rest = self.normal.as_mut_slice()[i * n + i..(i + 1) * n].iter_mut();
                rest.zip(&white[i..n]).for_each(|(sum, y)| *sum += x * y);
                self.right[i] += x * residual;
            }
            self.rss += residual * residual;
        }
        let with: Vec<[f64; 2]> = columns.iter().map(|c| c.with).collect();
        let dot = |a: usize, b: usize| with[a][0] * with[b][0] + with[a][1] * with[b][1];
        for j in 0..n {
            for i in j..n {
                self.normal[(i, j)] -= dot(i, j);
                self.normal[(j, i)] = self.normal[(i, j)];
            }
            self.right[j] -= dot(j, n);
        }
        self.rss -= dot(n, n);
    }

    /// Sum of squared residuals with the optimal columns.
    pub(crate) fn least(&self) -> f64 {
        let mut ridged = self.normal.clone();
        for i in 0..ridged.nrows() {
            ridged[(i, i)] += 1e-9 * ridged[(i, i)].max(1e-12);
        }
        ridged.cholesky().map_or(self.rss, |f| self.rss - self.right.dot(&f.solve(&self.right)))
    }
}

/// Filter state of one column.
#[derive(Clone, Default)]
struct Column {
    wander: f64,
    /// Products with offset and drift.
    with: [f64; 2],
}

impl Column {
    #[inline]
    fn whiten(&mut self, value: f64, step: &Step, q: &[f64; 2]) -> f64 {
        let innovation = value - self.wander;
        self.wander = step.decay * (self.wander + step.gain * innovation);
        let white = innovation * step.weight;
        self.with = [self.with[0] + white * q[0], self.with[1] + white * q[1]];
        white
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense::{Dense, Random, near};
    use crate::whitening::NoiseShape;

    fn sight(random: &mut Random, n: usize, from: f64, columns: usize) -> Sight {
        let mut sight = Sight::default();
        let (e, v) = (random.pairs(n, 2.0), random.pairs(n, 8.0));
        for (k, t) in random.stamps(n, from).into_iter().enumerate() {
            sight.push(t, &Seen { e: [e[k][0] + 5000.0, e[k][1] - 800.0], v: v[k] });
            // A level, a step in the middle and a bend, as in the fits.
            let all = [1.0, f64::from(u8::from(k >= n / 2)), k as f64 / n as f64];
            sight.columns.extend_from_slice(&all[..columns]);
        }
        sight
    }

    fn dense_part(sight: &Sight, n: usize, noise: &Noise) -> Part {
        let mut part = Part::none(n);
        let rows = sight.t.len();
        for axis in 0..2 {
            let v = |k: usize| sight.seen[k].v[axis];
            let dense = Dense::new(&sight.t, &noise.shape, |k| (noise.shape.jitter * v(k)).powi(2));
            let free = |f: &dyn Fn(usize) -> f64| dense.free(&(0..rows).map(f).collect::<Vec<f64>>()) / noise.white_m;
            let columns: Vec<DVector<f64>> = (0..n).map(|i| free(&|k| -v(k) * sight.columns[k * n + i])).collect();
            let e = free(&|k| sight.seen[k].e[axis]);
            part.normal += DMatrix::from_fn(n, n, |i, j| columns[i].dot(&columns[j]));
            part.right += DVector::from_fn(n, |i, _| columns[i].dot(&e));
            part.rss += e.norm_squared();
        }
        part
    }

    fn agree(a: &Part, b: &Part) {
        assert!((&a.normal - &b.normal).amax() < 1e-8 * b.normal.amax(), "{} {}", a.normal, b.normal);
        assert!((&a.right - &b.right).amax() < 1e-7 * b.right.amax(), "{} {}", a.right, b.right);
        assert!(near(a.rss, b.rss, 1e-7), "{} {}", a.rss, b.rss);
        let least = b.rss - b.right.dot(&(b.normal.clone().try_inverse().unwrap() * &b.right));
        assert!(near(a.least(), least, 1e-6), "{} {least}", a.least());
    }

    /// The filters are reused between stretches, and must fit each.
    #[test]
    fn the_normal_equations_of_a_stretch_match_the_dense_formula() {
        let mut random = Random::new(11);
        for (jitter, wander, time_constant_s) in [(0.0, 3.0, 15.0), (0.05, 0.5, 2.0), (0.3, 10.0, 1.0)] {
            let noise = Noise { shape: NoiseShape { wander, time_constant_s, jitter }, white_m: 0.4 };
            let mut filters = Filters::default();
            for columns in [1, 3, 2] {
                let stretch = sight(&mut random, 40, 100.0, columns);
                let found = Part::of(&stretch, columns, &noise, &mut filters);
                agree(&found, &dense_part(&stretch, columns, &noise));
                // The same timestamps at another delay: other velocities and residuals.
                let mut again = sight(&mut random, 40, 100.0, columns);
                again.t.clone_from(&stretch.t);
                let found = Part::of(&again, columns, &noise, &mut filters);
                agree(&found, &dense_part(&again, columns, &noise));
            }
        }
    }

    #[test]
    fn stretches_join_by_addition_and_a_short_one_adds_nothing() {
        let mut random = Random::new(12);
        let noise = Noise { shape: NoiseShape { wander: 2.0, time_constant_s: 5.0, jitter: 0.0 }, white_m: 0.4 };
        let stretches = [30, 8, 7].map(|n| sight(&mut random, n, 0.0, 2));
        let [a, b, short] = stretches.each_ref().map(|s| Part::of(s, 2, &noise, &mut Filters::default()));
        assert!(b.rss > 0.0 && short.rss == 0.0 && short.normal.amax() == 0.0);
        let mut joined = Part::none(2);
        [&a, &b, &short].into_iter().for_each(|part| joined.join(part));
        assert!((joined.normal - (&a.normal + &b.normal)).amax() < 1e-12);
        assert!((joined.right - (&a.right + &b.right)).amax() < 1e-12 && joined.rss == a.rss + b.rss);
        assert_eq!(Part::none(1).least(), 0.0);
    }
}
