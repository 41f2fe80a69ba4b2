//! The largest step or excursion of the bins (Part A S5). It decides nothing, because whole flights are not as white as it
//! assumes (Part B S5). It shows whether a delay changes when no window has a usable level.

use nalgebra::{DMatrix, DVector};

/// Chi-squared of the largest step or excursion, from `a` and `z` of the flexible fit; `None` if they carry no
/// information.
pub(crate) fn step_or_excursion(a: &DMatrix<f64>, z: &DVector<f64>) -> Option<f64> {
    let bins = z.len();
    if bins < 3 {
        return None;
    }
    let row = DVector::from_fn(bins, |i, _| a.row(i).sum());
    let total = row.sum();
    if total.is_nan() || total <= 0.0 {
        return None;
    }
    let score = z - &row * (z.sum() / total);
    let partial = running(score.iter().copied());
    let row_sums = running(row.iter().copied());
    let blocks = block_sums(a);
    let of_step = |s: usize| blocks[(s, s)] - row_sums[s] * row_sums[s] / total;
    let last = bins - 1;
    let steps = (0..last).map(|s| (partial[s] * partial[s], of_step(s)));
    let mut widest = steps.filter(|s| s.1 > 0.25e-3 * total).map(|s| s.0 / s.1).fold(0.0, f64::max);
    for i in 0..last {
        for j in i + 1..last {
            let between = row_sums[j] - row_sums[i];
            let h = blocks[(j, j)] - 2.0 * blocks[(i, j)] + blocks[(i, i)] - between * between / total;
            if h > 2e-3 * total {
                widest = widest.max((partial[j] - partial[i]).powi(2) / h);
            }
        }
    }
    Some(widest)
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
