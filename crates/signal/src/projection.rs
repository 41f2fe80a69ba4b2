//! Orthonormal bases, and projections on them.

/// An orthonormal basis of these columns (Gram and Schmidt, twice); columns that the others already span are left out.
#[must_use]
pub fn orthonormal(columns: &[Vec<f64>]) -> Vec<Vec<f64>> {
    columns.iter().fold(vec![], |mut basis, column| {
        basis.extend(orthonormal_to(column, &basis));
        basis
    })
}

/// `column` minus its projections on an orthonormal basis: the residuals of a least-squares fit.
#[must_use]
pub fn residuals_of(column: &[f64], basis: &[Vec<f64>]) -> Vec<f64> {
    let mut rest = column.to_vec();
    basis.iter().for_each(|q| remove(&mut rest, q));
    rest
}

/// The sum of squares.
#[must_use]
pub fn sum_of_squares(x: &[f64]) -> f64 {
    dot(x, x)
}

/// `column` minus its projections on the orthonormal `basis`, of length 1; `None` if almost nothing remains.
pub(crate) fn orthonormal_to(column: &[f64], basis: &[Vec<f64>]) -> Option<Vec<f64>> {
    let size = dot(column, column).sqrt();
    let mut rest = column.to_vec();
    for _ in 0..2 {
        basis.iter().for_each(|q| remove(&mut rest, q));
    }
    let left = dot(&rest, &rest).sqrt();
    (left > 1e-10 * size).then(|| {
        rest.iter_mut().for_each(|x| *x /= left);
        rest
    })
}

/// Removes the projection on the unit vector `q` from `column`.
pub(crate) fn remove(column: &mut [f64], q: &[f64]) {
    let along = dot(column, q);
    for (x, q) in column.iter_mut().zip(q) {
        *x -= along * q;
    }
}

/// Scalar product, as four sums that can run in parallel.
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let (a4, a_rest) = a.as_chunks::<4>();
    let (b4, b_rest) = b.as_chunks::<4>();
    let mut sums = [0.0; 4];
    for (x, y) in a4.iter().zip(b4) {
        for j in 0..4 {
            sums[j] += x[j] * y[j];
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(x, y)| x * y).sum();
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Residuals of a straight line through 0, 1, 4, 9: the parabola 1, −1, −1, 1.
    #[test]
    fn residuals_are_those_of_least_squares_and_spanned_columns_do_not_count() {
        let columns = [vec![1.0; 4], vec![0.0, 1.0, 2.0, 3.0], vec![3.0, 2.0, 1.0, 0.0]];
        let basis = orthonormal(&columns);
        assert_eq!(basis.len(), 2, "the third column is three minus the second");
        let rest = residuals_of(&[0.0, 1.0, 4.0, 9.0], &basis);
        for (rest, expected) in rest.iter().zip([1.0, -1.0, -1.0, 1.0]) {
            assert!((rest - expected).abs() < 1e-12, "{rest} {expected}");
        }
        assert!((sum_of_squares(&rest) - 4.0).abs() < 1e-12);
        assert!(basis.iter().all(|q| (sum_of_squares(q) - 1.0).abs() < 1e-12));
    }
}
