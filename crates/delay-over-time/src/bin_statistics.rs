//! Statistics on bins (Part A S5). They decide nothing, because whole flights are not as white as they assume (Part B
//! S5). They show whether a delay changes when no window has a usable level.

use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// Variances of a walk that are tried: from, to, and count.
const WALKS: (f64, f64, usize) = (1e-6, 0.3, 10);

/// Test statistics that are large if bins disagree.
#[derive(Debug, Clone, Copy)]
#[cfg_attr(not(test), expect(dead_code, reason = "the acceptance vectors check all of them"))]
pub(crate) struct BinStatistics {
    /// Best constant, s, and its standard uncertainty, s.
    pub(crate) level_s: f64,
    pub(crate) level_uncertainty_s: f64,
    /// Chi-squared of the largest step.
    pub(crate) step: f64,
    /// Chi-squared of the largest step or excursion.
    pub(crate) step_or_excursion: f64,
    /// Chi-squared of the trend.
    pub(crate) trend: f64,
    /// Nyblom's mean of squared partial sums.
    pub(crate) nyblom: f64,
    /// Twice the log likelihood ratio of a random walk.
    pub(crate) walk_ratio: f64,
    /// Chi-squared of all bins.
    pub(crate) chi_squared: f64,
}

/// From `a` and `z` of the flexible fit; `None` if they carry no information.
pub(crate) fn bin_statistics(a: &DMatrix<f64>, z: &DVector<f64>, middle_s: &[f64]) -> Option<BinStatistics> {
    let bins = z.len();
    if bins < 3 {
        return None;
    }
    let row = DVector::from_fn(bins, |i, _| a.row(i).sum());
    let total = row.sum();
    if total.is_nan() || total <= 0.0 {
        return None;
    }
    let level = z.sum() / total;
    let score = z - &row * level;
    let partial = running(score.iter().copied());
    let row_sums = running(row.iter().copied());
    let blocks = block_sums(a);
    let of_step = |s: usize| blocks[(s, s)] - row_sums[s] * row_sums[s] / total;
    let last = bins - 1;
    let steps = (0..last).map(|s| (partial[s] * partial[s], of_step(s)));
    let step = steps.clone().filter(|s| s.1 > 0.25e-3 * total).map(|s| s.0 / s.1).fold(0.0, f64::max);
    let mut widest = step;
    for i in 0..last {
        for j in i + 1..last {
            let between = row_sums[j] - row_sums[i];
            let h = blocks[(j, j)] - 2.0 * blocks[(i, j)] + blocks[(i, i)] - between * between / total;
            if h > 2e-3 * total {
                widest = widest.max((partial[j] - partial[i]).powi(2) / h);
            }
        }
    }
    let (squares, information) = steps.fold((0.0, 0.0), |s, x| (s.0 + x.0, s.1 + x.1));
    let mean = middle_s.iter().sum::<f64>() / bins as f64;
    let x = DVector::from_iterator(bins, middle_s.iter().map(|m| m - mean));
    let h = x.dot(&(a * &x)) - x.dot(&row).powi(2) / total;
    let (walk_ratio, chi_squared) = walk_statistics(a, &row, total, &score);
    Some(BinStatistics {
        level_s: level,
        level_uncertainty_s: total.sqrt().recip(),
        step,
        step_or_excursion: widest,
        trend: score.dot(&x).powi(2) / h.max(1e-12),
        nyblom: squares / information.max(1e-12),
        walk_ratio,
        chi_squared,
    })
}

fn running(values: impl Iterator<Item = f64>) -> Vec<f64> {
    values
        .scan(0.0, |sum, v| {
            *sum += v;
            Some(*sum)
        })
        .collect()
}

/// Cumulative sums of `a` over the first rows and columns.
fn block_sums(a: &DMatrix<f64>) -> DMatrix<f64> {
    let mut sums = a.clone();
    for i in 0..a.nrows() {
        for j in 0..a.ncols() {
            let above = if i > 0 { sums[(i - 1, j)] } else { 0.0 };
            let left = if j > 0 { sums[(i, j - 1)] } else { 0.0 };
            let both = if i > 0 && j > 0 { sums[(i - 1, j - 1)] } else { 0.0 };
            sums[(i, j)] += above + left - both;
        }
    }
    sums
}

/// Likelihood ratio of a walk and chi-squared, from the eigenvalues of the increments' information.
fn walk_statistics(a: &DMatrix<f64>, row: &DVector<f64>, total: f64, score: &DVector<f64>) -> (f64, f64) {
    let bins = score.len();
    // An increment moves its own bin and all later ones.
    let increments = DMatrix::from_fn(bins, bins - 1, |i, s| if i > s { 1.0 } else { 0.0 });
    let with_level = increments.tr_mul(row);
    let mut h = increments.tr_mul(&(a * &increments));
    h -= &with_level * with_level.transpose() / total;
    let eigen = SymmetricEigen::new((&h + h.transpose()) * 0.5);
    let scores = eigen.eigenvectors.tr_mul(&increments.tr_mul(score));
    let largest = eigen.eigenvalues.max();
    let known: Vec<(f64, f64)> = eigen
        .eigenvalues
        .iter()
        .zip(scores.iter())
        .filter(|(l, _)| **l > 1e-6 * largest)
        .map(|(l, g)| (*l, g * g / l))
        .collect();
    let ratio = |q: f64| -> f64 { known.iter().map(|(l, g)| g * (q * l / (1.0 + q * l)) - (q * l).ln_1p()).sum() };
    let (from, to, count) = WALKS;
    let grid = (0..count).map(|k| from * (to / from).powf(k as f64 / (count - 1) as f64));
    (grid.map(ratio).fold(f64::MIN, f64::max), known.iter().map(|k| k.1).sum())
}
