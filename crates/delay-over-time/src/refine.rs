//! The description fitted to the fixes themselves (S7): sizes, and steps placed to the nearest fix.

use crate::bins::Noise;
use crate::describe::{Description, Term};
use crate::fixes::Fixes;
use crate::motion::Motion;
use crate::parts::{Filters, Part, Seen, Sight};
use nalgebra::{DMatrix, DVector};
use record::DelayTermKind;
use std::ops::Range;

const ROUNDS: usize = 4;
const LARGEST_STEP_S: f64 = 0.5;
const STEADY: f64 = 1e-4;
/// Half-width of the first search of an edge, s, and of the widest.
const SCAN_S: f64 = 3.0;
const WIDEST_SCAN_S: f64 = 40.0;
/// Range on each side of a search from which fixes are used, s.
const MARGIN_S: f64 = 20.0;
/// Step of a search, s.
const SCAN_STEP_S: f64 = 0.2;
/// Rise of −2 log likelihood at the ends of a 95 % interval.
const INTERVAL_RISE: f64 = 3.84;
/// Least rise when two steps within a few bins are merged, for them to stay separate.
const PRICE: f64 = 16.0;
const NEAR_BINS: f64 = 3.2;
/// Bends are tried at steps within this number of bins.
const BEND_BINS: f64 = 5.0;

/// Description with uncertainties.
#[derive(Debug, Clone)]
pub(crate) struct Refined {
    pub(crate) description: Description,
    /// Covariance of level and sizes.
    covariance: DMatrix<f64>,
    /// Interval of each step's instant, s.
    pub(crate) when: Vec<Option<[f64; 2]>>,
}

impl Refined {
    pub(crate) fn size_uncertainty(&self, term: usize) -> f64 {
        self.covariance[(term + 1, term + 1)].max(0.0).sqrt()
    }

    /// Standard uncertainty of the curve at `t`, s.
    pub(crate) fn uncertainty_at(&self, t: f64) -> f64 {
        let column: Vec<f64> = std::iter::once(1.0).chain(self.description.terms.iter().map(|x| x.column(t))).collect();
        let x = DVector::from_vec(column);
        x.dot(&(&self.covariance * &x)).max(0.0).sqrt()
    }
}

#[cfg(test)]
impl Refined {
    /// A level known to 1 ms and sizes known to 2 ms, all independent; no step's instant is known.
    pub(crate) fn example(description: Description) -> Refined {
        let n = description.terms.len();
        let variances = DVector::from_fn(n + 1, |i, _| if i == 0 { 1e-6 } else { 4e-6 });
        Refined { description, covariance: DMatrix::from_diagonal(&variances), when: vec![None; n] }
    }
}

/// Fixes, motion and noise.
pub(crate) struct Refinement<'a> {
    pub(crate) fixes: &'a Fixes,
    pub(crate) motion: &'a Motion,
    pub(crate) noise: Noise,
    /// Inflation of variances by autocorrelation.
    pub(crate) inflation: f64,
    /// Length of the bins on which the description was found, s.
    pub(crate) bin_s: f64,
}

/// Merges bends at the same instant.
fn joined_bends(mut d: Description) -> Description {
    let mut joined: Vec<Term> = vec![];
    for term in d.terms {
        let is_same = |t: &&mut Term| t.kind == DelayTermKind::Bend && t.kind == term.kind && t.at_s == term.at_s;
        match joined.iter_mut().find(is_same) {
            Some(bend) => bend.size += term.size,
            None => joined.push(term),
        }
    }
    d.terms = joined;
    d
}

impl Refinement<'_> {
    /// `None` if the fixes do not determine the terms.
    pub(crate) fn refine(&self, first: Description) -> Option<Refined> {
        let mut now = self.descend(first)?;
        now = self.join_near_steps(now);
        self.place_edges(&mut now);
        now = self.descend(now.description)?;
        now = self.without_weak_terms(now)?;
        now = self.ramps(now);
        now = self.bends_to_steps(now);
        now = self.descend(joined_bends(now.description))?;
        now = self.without_weak_terms(now)?;
        let mut last = self.descend(now.description.clone())?;
        last.when = (0..last.description.terms.len()).map(|i| self.edge_interval(&last.description, i)).collect();
        Some(last)
    }

    /// Removes the weakest term repeatedly until all terms are worth their price.
    fn without_weak_terms(&self, mut now: Refined) -> Option<Refined> {
        for _ in 0..now.description.terms.len() {
            let weakest = (0..now.description.terms.len())
                .map(|i| (i, (now.description.terms[i].size / now.size_uncertainty(i).max(1e-12)).powi(2)))
                .min_by(|a, b| a.1.total_cmp(&b.1));
            let Some((i, strength)) = weakest.filter(|w| w.1 < PRICE) else { break };
            if now.description.terms.len() == 1 && strength > 0.5 * PRICE {
                break;
            }
            now.description.terms.remove(i);
            now = self.descend(now.description)?;
            self.place_edges(&mut now);
        }
        Some(now)
    }

    /// Gauss–Newton on level and sizes, with fixed instants.
    pub(crate) fn descend(&self, mut now: Description) -> Option<Refined> {
        let mut covariance = None;
        for _ in 0..ROUNDS {
            let (normal, right) = self.normal_equations(&now);
            let n = right.len();
            let scale: Vec<f64> = (0..n).map(|i| normal[(i, i)].max(1e-300).sqrt().recip()).collect();
            let scaled =
                DMatrix::from_fn(n, n, |i, j| normal[(i, j)] * scale[i] * scale[j] + if i == j { 1e-10 } else { 0.0 });
            let factor = scaled.cholesky()?;
            let solved = factor.solve(&DVector::from_fn(n, |i, _| right[i] * scale[i]));
            let mut largest = 0.0f64;
            let mut change = |i: usize| {
                let step = (solved[i] * scale[i]).clamp(-LARGEST_STEP_S, LARGEST_STEP_S);
                largest = largest.max(step.abs());
                step
            };
            now.level_s += change(0);
            for i in 1..n {
                now.terms[i - 1].size += change(i);
            }
            let inverse = factor.inverse();
            covariance = Some(DMatrix::from_fn(n, n, |i, j| inverse[(i, j)] * scale[i] * scale[j] * self.inflation));
            if largest < STEADY {
                break;
            }
        }
        let covariance = covariance.filter(|c| c.iter().all(|x| x.is_finite()))?;
        let when = vec![None; now.terms.len()];
        Some(Refined { description: now, covariance, when })
    }

    fn normal_equations(&self, now: &Description) -> (DMatrix<f64>, DVector<f64>) {
        let n = now.terms.len() + 1;
        let mut all = Part::none(n);
        for piece in self.fixes.pieces() {
            let columns = |t: f64, out: &mut Vec<f64>| {
                out.push(1.0);
                out.extend(now.terms.iter().map(|x| x.column(t)));
            };
            all.join(&self.part(piece, &|t| now.at(t), n, &columns));
        }
        (all.normal, all.right)
    }

    /// Sum of squared whitened residuals between two instants at the delay `at`, with their own offset and drift, and
    /// the number of fixes.
    pub(crate) fn squares_between(&self, from_s: f64, to_s: f64, at: &dyn Fn(f64) -> f64) -> (f64, usize) {
        let t = &self.fixes.t;
        let rows = t.partition_point(|t| *t < from_s)..t.partition_point(|t| *t <= to_s);
        (self.part(rows.clone(), at, 1, &|_, x| x.push(1.0)).rss, rows.len())
    }

    /// Normal equations of `n` delay changes on `rows`, about the delay `at`, with offset and drift projected out.
    pub(crate) fn part(
        &self,
        rows: Range<usize>,
        at: &dyn Fn(f64) -> f64,
        n: usize,
        columns: &dyn Fn(f64, &mut Vec<f64>),
    ) -> Part {
        let mut sight = Sight::default();
        let mut hint = 0;
        for k in rows {
            let stamp = self.fixes.t[k];
            if let Some(seen) = self.seen(k, stamp - at(stamp), &mut hint) {
                sight.push(stamp, &seen);
                columns(stamp, &mut sight.columns);
            }
        }
        Part::of(&sight, n, &self.noise, &mut Filters::default())
    }

    /// Residual and velocity of fix `k` for the motion at `q`; `None` outside the velocity's record.
    fn seen(&self, k: usize, q: f64, hint: &mut usize) -> Option<Seen> {
        let s = self.motion.knows(q).then(|| self.motion.at(q, hint))?;
        let y = self.fixes.y[k];
        Some(Seen { e: [y[0] - s.place[0], y[1] - s.place[1]], v: s.velocity })
    }

    /// Two steps within a few bins may be a single step within a bin: decides by the fit to the fixes.
    fn join_near_steps(&self, mut now: Refined) -> Refined {
        let near = |d: &Description| {
            let is_step = |i: &usize| d.terms[*i].kind == DelayTermKind::Step;
            let steps: Vec<usize> = (0..d.terms.len()).filter(is_step).collect();
            let close = |w: &&[usize]| d.terms[w[1]].at_s - d.terms[w[0]].at_s <= NEAR_BINS * self.bin_s;
            steps.windows(2).filter(close).map(|w| [w[0], w[1]]).collect::<Vec<_>>()
        };
        let mut refused = vec![];
        while let Some([i, k]) = near(&now.description).into_iter().find(|p| !refused.contains(p)) {
            let (first, second) = (now.description.terms[i], now.description.terms[k]);
            let mut joined = now.description.clone();
            joined.terms[i].size = first.size + second.size;
            joined.terms.remove(k);
            let range = [first.at_s - self.bin_s, second.at_s + self.bin_s];
            let scan = self.scan(&joined, i, range);
            let Some(best) = scan.iter().min_by(|a, b| a.1.total_cmp(&b.1)) else { break };
            joined.terms[i].at_s = best.0;
            let both = self.cost_between(&now.description, range);
            match self.descend(joined).filter(|j| self.cost_between(&j.description, range) - both < PRICE) {
                Some(better) => {
                    now = better;
                    refused.clear();
                }
                None => refused.push([i, k]),
            }
        }
        now
    }

    /// A growth often ends where it falls back, but bins near a jump were excluded. Moves bends to a nearby step if
    /// that fits the fixes better.
    fn bends_to_steps(&self, mut now: Refined) -> Refined {
        for i in 0..now.description.terms.len() {
            let Term { kind: DelayTermKind::Bend, at_s, .. } = now.description.terms[i] else { continue };
            let steps = now.description.terms.iter().filter(|t| t.kind == DelayTermKind::Step).map(|t| t.at_s);
            let near = steps.min_by(|a, b| (a - at_s).abs().total_cmp(&(b - at_s).abs()));
            let Some(step) = near.filter(|s| (s - at_s).abs() < BEND_BINS * self.bin_s) else { continue };
            let range = [at_s.min(step) - self.bin_s, at_s.max(step) + self.bin_s];
            let mut moved = now.description.clone();
            moved.terms[i].at_s = step;
            let before = self.cost_between(&now.description, range);
            if let Some(moved) = self.descend(moved).filter(|m| self.cost_between(&m.description, range) < before) {
                now = moved;
            }
        }
        now
    }

    /// −2 log likelihood of a description over `range`, with its own offset and drift.
    fn cost_between(&self, d: &Description, range: [f64; 2]) -> f64 {
        let squares = |rows| self.part(rows, &|t| d.at(t), 1, &|_, x| x.push(1.0)).rss;
        self.rows_about(range).into_iter().map(squares).sum::<f64>() / self.inflation
    }

    /// −2 log likelihood of a description on all fixes, plus the price of its terms.
    pub(crate) fn cost(&self, d: &Description) -> f64 {
        let squares = |rows| self.part(rows, &|t| d.at(t), 1, &|_, x| x.push(1.0)).rss;
        self.fixes.pieces().map(squares).sum::<f64>() / self.inflation + PRICE * d.terms.len() as f64
    }

    /// Moves every step to where it fits best.
    pub(crate) fn place_edges(&self, now: &mut Refined) {
        let scan_s = SCAN_S.max(1.2 * self.bin_s);
        for i in 0..now.description.terms.len() {
            let Term { kind: DelayTermKind::Step, at_s, .. } = now.description.terms[i] else { continue };
            let scan = self.scan(&now.description, i, self.between(&now.description, i, at_s, scan_s));
            if let Some(best) = scan.iter().min_by(|a, b| a.1.total_cmp(&b.1)) {
                now.description.terms[i].at_s = best.0;
            }
        }
    }

    /// The range `half_s` about `at_s`, limited by the neighbouring steps.
    fn between(&self, d: &Description, i: usize, at_s: f64, half_s: f64) -> [f64; 2] {
        let others = || d.terms.iter().enumerate().filter(|(k, x)| *k != i && x.kind == DelayTermKind::Step);
        let before = others().map(|o| o.1.at_s).filter(|t| *t < at_s).fold(f64::MIN, f64::max);
        let after = others().map(|o| o.1.at_s).filter(|t| *t > at_s).fold(f64::MAX, f64::min);
        [(at_s - half_s).max(before + 0.5), (at_s + half_s).min(after - 0.5)]
    }

    fn edge_interval(&self, d: &Description, i: usize) -> Option<[f64; 2]> {
        let Term { kind: DelayTermKind::Step, at_s, .. } = *d.terms.get(i)? else { return None };
        let mut half_s = SCAN_S;
        loop {
            let range = self.between(d, i, at_s, half_s);
            let scan = self.scan(d, i, range);
            let least = scan.iter().map(|s| s.1).fold(f64::MAX, f64::min);
            let within: Vec<f64> = scan.iter().filter(|s| s.1 < least + INTERVAL_RISE).map(|s| s.0).collect();
            let (from, to) = (*within.first()?, *within.last()?);
            let inner = from > range[0] + SCAN_STEP_S && to < range[1] - SCAN_STEP_S;
            if inner || half_s >= WIDEST_SCAN_S {
                // The edge is anywhere between two fixes.
                return Some([from - SCAN_STEP_S, to + SCAN_STEP_S]);
            }
            half_s *= 2.5;
        }
    }

    /// Fixes in and near `range`, per piece: a step often comes with a reset, and both pieces constrain its instant.
    fn rows_about(&self, range: [f64; 2]) -> Vec<Range<usize>> {
        let t = &self.fixes.t;
        let from = t.partition_point(|t| *t < range[0] - MARGIN_S);
        let to = t.partition_point(|t| *t <= range[1] + MARGIN_S);
        let near = self.fixes.pieces().map(|p| p.start.max(from)..p.end.min(to));
        near.filter(|rows| !rows.is_empty()).collect()
    }

    /// −2 log likelihood with the edge of term `i` at instants in `range`. Level and size of the step are free nearby.
    fn scan(&self, d: &Description, i: usize, range: [f64; 2]) -> Vec<(f64, f64)> {
        if range[1] <= range[0] {
            return vec![];
        }
        let pieces = self.rows_about(range);
        let (Some(first), Some(last)) = (pieces.first(), pieces.last()) else { return vec![] };
        let (start, rows) = (first.start, first.start..last.end);
        let interval = crate::motion::usual_interval(&self.fixes.t[rows.clone()]);
        let step = SCAN_STEP_S.max(interval).max((range[1] - range[0]) / 100.0);
        let count = ((range[1] - range[0]) / step) as usize;
        // Each fix shows one of two motions: that before the edge or that after it.
        let (edge, mut hints) = (d.terms[i], [0, 0]);
        let mut without = d.clone();
        without.terms.remove(i);
        let both = |k: usize| {
            let q = self.fixes.t[k] - without.at(self.fixes.t[k]);
            [self.seen(k, q, &mut hints[0]), self.seen(k, q - edge.size, &mut hints[1])]
        };
        let seen: Vec<[Option<Seen>; 2]> = rows.map(both).collect();
        let (mut sight, mut filters) = (Sight::default(), vec![Filters::default(); pieces.len()]);
        let mut cost = |k: usize| {
            let at_s = range[0] + step * k as f64;
            let mut all = Part::none(2);
            for (rows, filters) in pieces.iter().zip(&mut filters) {
                sight.clear();
                for (t, seen) in self.fixes.t[rows.clone()].iter().zip(&seen[rows.start - start..]) {
                    let after = *t >= at_s;
                    if let Some(seen) = &seen[usize::from(after)] {
                        sight.push(*t, seen);
                        sight.columns.extend([1.0, f64::from(after)]);
                    }
                }
                all.join(&Part::of(&sight, 2, &self.noise, filters));
            }
            (at_s, all.least() / self.inflation)
        };
        (0..=count).map(&mut cost).filter(|c| c.1.is_finite()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense::{Random, turning};
    use crate::whitening::NoiseShape;

    const NOISE: Noise = Noise { shape: NoiseShape { wander: 1.0, time_constant_s: 8.0, jitter: 0.0 }, white_m: 0.1 };

    /// Fixes at 5 Hz over 120 s, late by `late`, with white noise and wander of 0.1 m; a reset at each of `resets`.
    fn flight(late: impl Fn(f64) -> f64, motion: &Motion, resets: &[f64], seed: u64) -> Fixes {
        let mut random = Random::new(seed);
        let t: Vec<f64> = (0..600).map(|k| 0.2 * f64::from(k)).collect();
        let mut wander = [0.1 * random.normal(), 0.1 * random.normal()];
        let decay = (-0.2 / 8.0f64).exp();
        let y = t.iter().map(|t| {
            let place = motion.at(t - late(*t), &mut 0).place;
            let moved = 25.0 * resets.iter().filter(|r| *r <= t).count() as f64;
            [0, 1].map(|a| {
                wander[a] = decay * wander[a] + 0.1 * (1.0 - decay * decay).sqrt() * random.normal();
                place[a] + moved + wander[a] + 0.1 * random.normal()
            })
        });
        let y = y.collect();
        let edges = resets.iter().map(|r| t.partition_point(|t| t < r));
        Fixes { starts: std::iter::once(0).chain(edges).chain([600]).collect(), y, t }
    }

    fn refinement<'a>(fixes: &'a Fixes, motion: &'a Motion) -> Refinement<'a> {
        Refinement { fixes, motion, noise: NOISE, inflation: 1.0, bin_s: 2.0 }
    }

    fn term(kind: DelayTermKind, at_s: f64, size: f64) -> Term {
        Term { kind, at_s, size }
    }

    use DelayTermKind::{Bend, Step};

    /// From the edge of a bin and a wrong size to the nearest fix, with and without a reset at the same instant.
    #[test]
    fn a_step_is_placed_between_two_fixes_and_sized() {
        let motion = turning(120.0);
        for (seed, by, resets) in [(1, 0.2, &[][..]), (2, -0.3, &[]), (3, 0.2, &[61.3]), (4, 0.5, &[30.0])] {
            let fixes = flight(|t| if t < 61.3 { 0.3 } else { 0.3 + by }, &motion, resets, seed);
            let first = Description { level_s: 0.25, terms: vec![term(Step, 62.5, 0.5 * by)] };
            let found = refinement(&fixes, &motion).refine(first).unwrap();
            let [step] = found.description.terms[..] else { panic!("{:?}", found.description) };
            assert!((step.at_s - 61.3).abs() < 0.4, "{step:?}");
            let u = found.size_uncertainty(0);
            assert!((1e-4..0.02).contains(&u) && (step.size - by).abs() < 4.0 * u, "{step:?} {u}");
            assert!((found.description.level_s - 0.3).abs() < 4.0 * found.uncertainty_at(0.0));
            let [from, to] = found.when[0].unwrap();
            assert!(from <= 61.3 && 61.3 <= to + 0.2 && to - from < 4.0, "{from} {to}");
            assert!((found.uncertainty_at(100.0) / found.uncertainty_at(0.0) - 1.0).abs() < 1.0);
        }
    }

    /// Errors over uncertainties of the sizes of forty steps, chi-squared with 40 degrees of freedom: 16 to 73 with 99.8 %.
    #[test]
    fn uncertainties_of_levels_and_sizes_are_calibrated() {
        let motion = turning(120.0);
        let (mut sizes, mut levels) = (0.0, 0.0);
        for seed in 100..140 {
            let fixes = flight(|t| if t < 60.1 { 0.3 } else { 0.4 }, &motion, &[], seed);
            let first = Description { level_s: 0.2, terms: vec![term(Step, 60.1, 0.0)] };
            let found = refinement(&fixes, &motion).descend(first).unwrap();
            sizes += ((found.description.terms[0].size - 0.1) / found.size_uncertainty(0)).powi(2);
            levels += ((found.description.level_s - 0.3) / found.uncertainty_at(0.0)).powi(2);
        }
        assert!((16.0..73.0).contains(&sizes) && (16.0..73.0).contains(&levels), "{sizes} {levels}");
    }

    /// Variance with a level column and one column per term: cᵀ C c.
    #[test]
    fn the_uncertainty_of_the_curve_combines_its_terms() {
        let d = Description { level_s: 0.2, terms: vec![term(Step, 10.0, 1.0), term(Bend, 20.0, 0.5)] };
        let covariance = DMatrix::from_row_slice(3, 3, &[4.0, -1.0, 0.5, -1.0, 9.0, 0.25, 0.5, 0.25, 1.0]);
        let r = Refined { description: d, covariance, when: vec![None; 2] };
        assert!((r.uncertainty_at(5.0) - 2.0).abs() < 1e-12);
        assert!((r.uncertainty_at(15.0) - (4.0 + 9.0 - 2.0f64).sqrt()).abs() < 1e-12);
        // At 23 s the bend has lasted 3 s: 4 + 9 + 9 − 2 + 3 + 1.5.
        assert!((r.uncertainty_at(23.0) - 24.5f64.sqrt()).abs() < 1e-12);
        assert_eq!((r.size_uncertainty(0), r.size_uncertainty(1)), (3.0, 1.0));
        assert!((r.description.at(23.0) - 2.7).abs() < 1e-12);
    }

    /// An inflation of four: uncertainties twice as large, sizes unchanged.
    #[test]
    fn autocorrelation_widens_but_moves_nothing() {
        let motion = turning(120.0);
        let fixes = flight(|t| if t < 60.1 { 0.3 } else { 0.4 }, &motion, &[], 5);
        let first = Description { level_s: 0.3, terms: vec![term(Step, 60.1, 0.1)] };
        let of = |inflation: f64| Refinement { inflation, ..refinement(&fixes, &motion) };
        let (one, four) = (of(1.0).descend(first.clone()).unwrap(), of(4.0).descend(first).unwrap());
        assert!((four.size_uncertainty(0) / one.size_uncertainty(0) - 2.0).abs() < 1e-9);
        assert!((four.uncertainty_at(90.0) / one.uncertainty_at(90.0) - 2.0).abs() < 1e-9);
        assert_eq!(one.description.terms[0].size, four.description.terms[0].size);
    }

    /// White residuals independent of the fit: Σ squares has twice the number of fixes less the fitted parameters.
    #[test]
    fn squares_at_the_truth_are_chi_squared() {
        let motion = turning(120.0);
        let fixes = flight(|_| 0.3, &motion, &[], 6);
        let refinement = refinement(&fixes, &motion);
        let (squares, count) = refinement.squares_between(20.0, 100.0, &|_| 0.3);
        assert_eq!(count, 401);
        let free = (2 * count - 4) as f64;
        assert!((squares - free).abs() < 4.0 * (2.0 * free).sqrt(), "{squares} {free}");
        assert!(refinement.squares_between(20.0, 100.0, &|_| 0.5).0 > 2.0 * squares);
    }

    #[test]
    fn two_steps_within_a_bin_merge_but_distant_ones_stay() {
        let motion = turning(120.0);
        let one = flight(|t| if t < 60.9 { 0.3 } else { 0.5 }, &motion, &[], 7);
        let first =
            |second: f64| Description { level_s: 0.3, terms: vec![term(Step, 60.0, 0.1), term(Step, second, 0.1)] };
        let found = refinement(&one, &motion).refine(first(62.0)).unwrap().description;
        assert_eq!(found.terms.len(), 1, "{found:?}");
        assert!((found.terms[0].at_s - 60.9).abs() < 0.4 && (found.terms[0].size - 0.2).abs() < 0.02, "{found:?}");
        let two = flight(
            |t| {
                if t < 60.1 {
                    0.3
                } else if t < 90.1 {
                    0.4
                } else {
                    0.5
                }
            },
            &motion,
            &[],
            8,
        );
        let found = refinement(&two, &motion).refine(first(90.0)).unwrap().description;
        assert_eq!(found.terms.len(), 2, "{found:?}");
        assert!((found.terms[1].at_s - 90.1).abs() < 0.6 && (found.at(75.0) - 0.4).abs() < 0.02, "{found:?}");
    }

    /// A term of size zero is dropped, and a real one is kept.
    #[test]
    fn a_term_unsupported_by_the_fixes_is_dropped() {
        let motion = turning(120.0);
        let fixes = flight(|t| if t < 40.1 { 0.3 } else { 0.5 }, &motion, &[], 9);
        let first = Description {
            level_s: 0.3,
            terms: vec![term(Step, 40.0, 0.2), term(Step, 80.0, 0.05), term(Bend, 100.0, 0.01)],
        };
        let found = refinement(&fixes, &motion).refine(first).unwrap().description;
        assert_eq!(found.terms.len(), 1, "{found:?}");
        assert!(found.terms[0].kind == Step && (found.terms[0].size - 0.2).abs() < 0.02);
    }

    /// Growth from 30 s on that falls back at 70.1 s: first described by a bend that ends 6 s too early.
    #[test]
    fn a_bend_moves_to_the_step_where_the_growth_ends() {
        let motion = turning(120.0);
        let fixes = flight(|t| if (30.0..70.1).contains(&t) { 0.3 + 0.02 * (t - 30.0) } else { 0.3 }, &motion, &[], 10);
        let terms = vec![term(Bend, 30.0, 0.02), term(Bend, 65.0, -0.02), term(Step, 70.0, -0.7)];
        let found = refinement(&fixes, &motion).refine(Description { level_s: 0.3, terms }).unwrap().description;
        let bends: Vec<&Term> = found.terms.iter().filter(|t| t.kind == Bend).collect();
        assert!(bends.len() == 2 && (bends[1].at_s - 70.1).abs() < 0.5, "{found:?}");
        assert!((found.at(69.0) - 1.08).abs() < 0.03 && (found.at(80.0) - 0.3).abs() < 0.03, "{found:?}");
    }

    #[test]
    fn a_search_ends_half_a_second_from_the_neighbouring_steps() {
        let motion = turning(120.0);
        let fixes = flight(|_| 0.3, &motion, &[], 11);
        let terms = vec![term(Step, 40.0, 0.1), term(Bend, 58.0, 0.1), term(Step, 60.0, 0.1), term(Step, 62.0, 0.1)];
        let d = Description { level_s: 0.3, terms };
        let r = refinement(&fixes, &motion);
        assert_eq!(r.between(&d, 2, 60.0, 3.0), [57.0, 61.5]);
        assert_eq!(r.between(&d, 2, 60.0, 30.0), [40.5, 61.5]);
        assert_eq!(r.between(&d, 3, 62.0, 3.0), [60.5, 65.0]);
        assert!(r.scan(&d, 2, [61.0, 61.0]).is_empty());
    }

    #[test]
    fn bends_at_one_instant_are_added_and_steps_are_not() {
        let term = |kind, at_s, size| Term { kind, at_s, size };
        let (bend, step) = (DelayTermKind::Bend, DelayTermKind::Step);
        let terms = vec![
            term(bend, 10.0, 0.25),
            term(step, 10.0, 0.5),
            term(bend, 10.0, 0.5),
            term(step, 10.0, 0.5),
            term(bend, 20.0, 1.0),
        ];
        let joined = joined_bends(Description { level_s: 0.1, terms });
        let found: Vec<(f64, f64)> = joined.terms.iter().map(|t| (t.at_s, t.size)).collect();
        assert_eq!(found, [(10.0, 0.75), (10.0, 0.5), (10.0, 0.5), (20.0, 1.0)]);
    }
}
