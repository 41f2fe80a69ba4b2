//! Noise of each channel from the uncertainties of its pairs.

use crate::graph::Graph;
use nalgebra::{DMatrix, DVector};

/// Weight of the rows that make the split between the two channels of a pair unique.
const RIDGE: f64 = 1e-3;

/// Variances `c² ≥ 0` of the channels' noise, s²: `c_a² + c_b² ≈ ρu²`, rows weighted by `1/(ρu²)` (section 2).
pub(crate) fn channel_noise(graph: &Graph, shared_noise: f64) -> Vec<f64> {
    let (pairs, channels) = (graph.edges.len(), graph.nodes.len());
    let shared: Vec<f64> =
        graph.edges.iter().map(|edge| (shared_noise * edge.uncertainty_s.powi(2)).max(f64::MIN_POSITIVE)).collect();
    let scale = signal::median_by_selection(&shared).unwrap_or_default();
    let mut a = DMatrix::zeros(pairs + channels, channels);
    let mut y = DVector::zeros(pairs + channels);
    for (row, (edge, shared)) in graph.edges.iter().zip(&shared).enumerate() {
        a[(row, edge.first)] = scale / shared;
        a[(row, edge.second)] = scale / shared;
        y[row] = 1.0;
    }
    for channel in 0..channels {
        a[(pairs + channel, channel)] = RIDGE;
    }
    non_negative_least_squares(&a, &y).iter().map(|x| x * scale).collect()
}

/// Median; the mean of the middle two for an even count, 0 for an empty list.
/// `x ≥ 0` that minimises `‖Ax − y‖`, by the active sets of Lawson and Hanson (1974), chapter 23.
fn non_negative_least_squares(a: &DMatrix<f64>, y: &DVector<f64>) -> DVector<f64> {
    let size = a.ncols();
    let mut x = DVector::zeros(size);
    let mut free = vec![false; size];
    for _ in 0..3 * size {
        let gradient = a.transpose() * (y - a * &x);
        let next = (0..size).filter(|&j| !free[j]).max_by(|&i, &j| gradient[i].total_cmp(&gradient[j]));
        match next {
            Some(j) if gradient[j] > 1e-10 => free[j] = true,
            _ => break,
        }
        for _ in 0..size {
            let Some(wanted) = least_squares(a, y, &free) else { return x };
            let step = (0..size)
                .filter(|&j| free[j] && wanted[j] <= 0.0)
                .map(|j| x[j] / (x[j] - wanted[j]))
                .fold(1.0, f64::min);
            let moved = &x + (&wanted - &x) * step;
            x = moved;
            if step >= 1.0 {
                break;
            }
            for j in 0..size {
                if free[j] && x[j] <= 1e-14 {
                    x[j] = 0.0;
                    free[j] = false;
                }
            }
        }
    }
    x
}

/// Least squares over the free columns; the others are zero.
fn least_squares(a: &DMatrix<f64>, y: &DVector<f64>, free: &[bool]) -> Option<DVector<f64>> {
    let columns: Vec<usize> = (0..free.len()).filter(|&j| free[j]).collect();
    let qr = a.select_columns(&columns).qr();
    let solved = qr.r().solve_upper_triangular(&(qr.q().transpose() * y))?;
    let mut x = DVector::zeros(free.len());
    for (&column, value) in columns.iter().zip(solved.iter()) {
        x[column] = *value;
    }
    Some(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn non_negative_least_squares_meets_the_karush_kuhn_tucker_conditions() {
        let a = DMatrix::from_row_slice(4, 3, &[1.0, 2.0, 0.5, 0.3, 1.0, 1.0, 2.0, 0.1, 1.5, 0.7, 0.9, 0.2]);
        let y = DVector::from_vec(vec![1.0, -2.0, 3.0, 0.5]);
        let x = non_negative_least_squares(&a, &y);
        let gradient = a.transpose() * (&y - &a * &x);
        for j in 0..3 {
            assert!(x[j] >= 0.0);
            assert!(gradient[j] < 1e-9, "going up does not help");
            assert!(x[j] == 0.0 || gradient[j].abs() < 1e-9, "nor does going down where it can");
        }
    }
}
