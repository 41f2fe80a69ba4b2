//! Least squares with uncertainties that remain valid for correlated residuals. It refuses columns that cannot be
//! distinguished.

use nalgebra::{DMatrix, DVector};
use thiserror::Error;

/// Why there is no regression.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum RegressionError {
    /// Lengths of columns, names and y differ.
    #[error("column {name} has {rows} rows, y has {expected}")]
    Shape {
        /// Column.
        name: String,
        /// Number of its rows.
        rows: usize,
        /// Number of rows of y.
        expected: usize,
    },
    /// Numbers of names and columns differ.
    #[error("{names} names for {columns} columns")]
    Names {
        /// Number of names.
        names: usize,
        /// Number of columns.
        columns: usize,
    },
    /// No more rows than columns.
    #[error("{rows} rows are too few for {columns} columns")]
    TooFewRows {
        /// Number of rows.
        rows: usize,
        /// Number of columns.
        columns: usize,
    },
    /// A number is not finite.
    #[error("row {row} of {name} is not finite")]
    NotFinite {
        /// Column, or `y`.
        name: String,
        /// Row, from 0.
        row: usize,
    },
    /// These columns cannot be distinguished.
    #[error("cannot be distinguished: {}", names.join(", "))]
    NotDistinguishable {
        /// Their names; one name alone is a column of zeros.
        names: Vec<String>,
    },
}

/// A least-squares fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Regression {
    /// Coefficients, one for each column.
    pub coefficients: Vec<f64>,
    /// Covariance of the coefficients, row by row, consistent under heteroscedastic and
    /// autocorrelated residuals.
    pub covariance: Vec<Vec<f64>>,
    /// y − fit.
    pub residuals: Vec<f64>,
    /// Condition number of the columns scaled to unit length: 1 is orthogonal; a coefficient is about that many times
    /// less certain than if its column were the only one.
    pub condition: f64,
    /// Number of rows minus columns.
    pub degrees_of_freedom: usize,
    /// Number of rows after which the Bartlett kernel is zero; 1 ignores correlation.
    pub bandwidth: usize,
}

impl Regression {
    /// Standard uncertainty of coefficient `column`.
    ///
    /// # Panics
    /// If there is no such column.
    #[must_use]
    pub fn standard_uncertainty(&self, column: usize) -> f64 {
        self.covariance[column][column].sqrt()
    }
}

/// Columns whose condition number, scaled to unit length, exceeds this are not distinguished.
const WORST_CONDITION: f64 = 1e9;

/// Least squares of `y` on `columns` (of its length, rows in the order of time, named for errors), by
/// QR of the columns scaled to unit length.
///
/// The covariance is the sandwich of Newey and West (1987): Bartlett kernel, bandwidth of Andrews
/// (1991, eq. 6.2 and 6.4, first-order autoregressions), factor n/(n − p). Lags count rows, not time.
///
/// # Errors
/// [`RegressionError`]; if columns are linearly dependent to 10⁻⁹, it names them.
pub fn regress(columns: &[&[f64]], names: &[&str], y: &[f64]) -> Result<Regression, RegressionError> {
    fit(columns, names, y, None)
}

/// [`regress`] with a bandwidth, or Andrews'.
fn fit(columns: &[&[f64]], names: &[&str], y: &[f64], bandwidth: Option<usize>) -> Result<Regression, RegressionError> {
    check(columns, names, y)?;
    let (n, p) = (y.len(), columns.len());
    let lengths: Vec<f64> = columns.iter().map(|c| c.iter().map(|x| x * x).sum::<f64>().sqrt()).collect();
    if let Some(zero) = lengths.iter().position(|l| *l == 0.0) {
        return Err(RegressionError::NotDistinguishable { names: vec![names[zero].to_owned()] });
    }
    let scaled = DMatrix::from_fn(n, p, |i, j| columns[j][i] / lengths[j]);
    let qr = scaled.clone().qr();
    let (q, r) = (qr.q(), qr.r());
    let condition = condition_or_culprits(&r, names)?;
    let y_vector = DVector::from_column_slice(y);
    let Some(inverse) = r.clone().try_inverse() else {
        return Err(RegressionError::NotDistinguishable { names: names.iter().map(|&n| n.to_owned()).collect() });
    };
    let coefficients = &inverse * q.tr_mul(&y_vector);
    let residuals = y_vector - &scaled * &coefficients;
    let scores = |of: &DMatrix<f64>| DMatrix::from_fn(n, p, |i, j| of[(i, j)] * residuals[i]);
    let bandwidth = bandwidth.unwrap_or_else(|| andrews_bandwidth(&scores(&scaled)));
    let middle = long_run_sum(&scores(&q), bandwidth) * (n as f64 / (n - p) as f64);
    let covariance = &inverse * middle * inverse.transpose();
    Ok(Regression {
        coefficients: coefficients.iter().zip(&lengths).map(|(c, l)| c / l).collect(),
        covariance: (0..p).map(|i| (0..p).map(|j| covariance[(i, j)] / lengths[i] / lengths[j]).collect()).collect(),
        residuals: residuals.iter().copied().collect(),
        condition,
        degrees_of_freedom: n - p,
        bandwidth,
    })
}

fn check(columns: &[&[f64]], names: &[&str], y: &[f64]) -> Result<(), RegressionError> {
    if names.len() != columns.len() {
        return Err(RegressionError::Names { names: names.len(), columns: columns.len() });
    }
    for (column, name) in columns.iter().zip(names) {
        if column.len() != y.len() {
            return Err(RegressionError::Shape { name: (*name).to_owned(), rows: column.len(), expected: y.len() });
        }
    }
    if y.len() <= columns.len() || columns.is_empty() {
        return Err(RegressionError::TooFewRows { rows: y.len(), columns: columns.len() });
    }
    for (column, name) in columns.iter().zip(names).chain([(&y, &"y")]) {
        if let Some(row) = column.iter().position(|x| !x.is_finite()) {
            return Err(RegressionError::NotFinite { name: (*name).to_owned(), row });
        }
    }
    Ok(())
}

/// The condition number, or the names of the columns that take part in a dependence.
fn condition_or_culprits(r: &DMatrix<f64>, names: &[&str]) -> Result<f64, RegressionError> {
    let svd = r.clone().svd(false, true);
    let largest = svd.singular_values.max();
    let lost: Vec<usize> = (0..names.len()).filter(|&k| svd.singular_values[k] * WORST_CONDITION <= largest).collect();
    if lost.is_empty() {
        return Ok(largest / svd.singular_values.min());
    }
    let takes_part = |column: usize| {
        let share = |&k: &usize| svd.v_t.as_ref().map_or(1.0, |v| v[(k, column)].abs());
        lost.iter().map(share).fold(0.0, f64::max) > 0.05
    };
    let culprits = names.iter().enumerate().filter(|(column, _)| takes_part(*column));
    Err(RegressionError::NotDistinguishable { names: culprits.map(|(_, name)| (*name).to_owned()).collect() })
}

/// Andrews' bandwidth for the Bartlett kernel, 1.1447 (α(1) n)^⅓, from first-order autoregressions of
/// each column of scores, each with the same weight; at most a quarter of the rows.
fn andrews_bandwidth(scores: &DMatrix<f64>) -> usize {
    let n = scores.nrows();
    let (mut above, mut below) = (0.0, 0.0);
    for column in scores.column_iter() {
        let s = column.as_slice();
        let power: f64 = s.iter().map(|s| s * s).sum();
        if power <= 0.0 {
            continue;
        }
        let rho = (s.windows(2).map(|w| w[0] * w[1]).sum::<f64>() / power).clamp(-0.97, 0.97);
        // In units of the column's own power, so that units do not affect the weights.
        let innovation4 = (1.0 - rho * rho).powi(2);
        above += 4.0 * rho * rho * innovation4 / ((1.0 - rho).powi(6) * (1.0 + rho).powi(2));
        below += innovation4 / (1.0 - rho).powi(4);
    }
    let alpha = if below > 0.0 { above / below } else { 0.0 };
    let bandwidth = 1.1447 * (alpha * n as f64).cbrt();
    (bandwidth.ceil() as usize).clamp(1, (n / 4).max(1))
}

/// Σₗ (1 − |l|/M) Γₗ with Γₗ = Σₜ sₜ sₜ₋ₗᵀ. The kernel is a triangle, so this is the mean over all windows of M rows,
/// including those over the ends, of the square of their sum: O(n), never negative.
fn long_run_sum(scores: &DMatrix<f64>, bandwidth: usize) -> DMatrix<f64> {
    let (n, p) = scores.shape();
    let mut window = DVector::zeros(p);
    let mut total = DMatrix::zeros(p, p);
    for last in 0..n + bandwidth - 1 {
        if last < n {
            window += scores.row(last).transpose();
        }
        if last >= bandwidth {
            window -= scores.row(last - bandwidth).transpose();
        }
        total.ger(1.0, &window, &window, 1.0);
    }
    total / bandwidth as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;

    fn noise(n: usize, seed: u64) -> Vec<f64> {
        let mut random = Pcg64::seed_from_u64(seed);
        (0..n).map(|_| StandardNormal.sample(&mut random)).collect()
    }

    /// `delay_fit_deterministic` of the project's acceptance vectors, as the linear problem at its
    /// solution: the HAC errors at 10 lags, and the delay itself.
    /// For one column, α(1) = 4ρ²/((1 − ρ)²(1 + ρ)²) (Andrews 1991, eq. 6.4).
    #[test]
    fn the_bandwidth_of_one_column_is_that_of_its_autoregression() {
        let scores: Vec<f64> = (0..400).map(|k| (0.3 * f64::from(k)).cos()).collect();
        let products: f64 = scores.windows(2).map(|pair| pair[0] * pair[1]).sum();
        let rho = products / scores.iter().map(|s| s * s).sum::<f64>();
        let alpha = 4.0 * rho * rho / (1.0 - rho * rho).powi(2);
        let expected = (1.1447 * (alpha * 400.0).cbrt()).ceil() as usize;
        // Neither bound applies.
        assert!((2..100).contains(&expected), "{expected}");
        assert_eq!(andrews_bandwidth(&DMatrix::from_column_slice(400, 1, &scores)), expected);
    }

    #[test]
    fn hac_errors_equal_the_acceptance_vector() {
        let (tau, gain, bias) = (0.397_155_633_998_200_2, 1.024_867_844_819_326, 0.501_078_116_038_849_3);
        let sines = [(0.9, 0.53, 0.0), (0.25, 0.81, 0.7), (0.1, 1.37, -1.1)];
        let omega = |f: f64| std::f64::consts::TAU * f;
        let r = |t: f64| sines.iter().map(|(a, f, p)| a * (omega(*f) * t + p).sin()).sum::<f64>();
        let rate = |t: f64| sines.iter().map(|(a, f, p)| a * omega(*f) * (omega(*f) * t + p).cos()).sum::<f64>();
        let t: Vec<f64> = (0..240).map(|k| 3.0 + 0.25 * f64::from(k)).collect();
        let slope: Vec<f64> = t.iter().map(|t| -gain * rate(t - tau)).collect();
        let shape: Vec<f64> = t.iter().map(|t| r(t - tau)).collect();
        let y: Vec<f64> = t
            .iter()
            .enumerate()
            .map(|(k, t)| {
                let measured = 1.02 * r(t - 0.4) + 0.5 + 0.1 * (1.2345 * (k * k) as f64).sin();
                measured - gain * r(t - tau) - bias
            })
            .collect();
        let found = fit(&[&slope, &shape, &[1.0; 240]], &["delay", "gain", "offset"], &y, Some(11)).unwrap();
        let expected = [0.001_956_332_184_645_168_4, 0.006_469_859_838_285_206, 0.004_540_465_368_403_052];
        for (k, expected) in expected.into_iter().enumerate() {
            assert!(found.coefficients[k].abs() < 1e-8, "not at the minimum: {}", found.coefficients[k]);
            assert!((found.standard_uncertainty(k) / expected - 1.0).abs() < 1e-6, "{}", found.standard_uncertainty(k));
        }
    }

    #[test]
    fn an_exact_relation_is_found_exactly_whatever_the_units() {
        let t: Vec<f64> = (0..50).map(f64::from).collect();
        let huge: Vec<f64> = t.iter().map(|t| 1e9 * (0.3 * t).sin()).collect();
        let y: Vec<f64> = t.iter().zip(&huge).map(|(t, h)| 3.0 - 2.0 * t + 1e-9 * h).collect();
        let found = regress(&[&[1.0; 50], &t, &huge], &["one", "time", "huge"], &y).unwrap();
        for (found, expected) in found.coefficients.iter().zip([3.0, -2.0, 1e-9]) {
            assert!((found / expected - 1.0).abs() < 1e-10, "{found} {expected}");
        }
        assert!(found.condition < 10.0 && found.residuals.iter().all(|r| r.abs() < 1e-10));
    }

    /// White residuals have the textbook uncertainty. Each of 100 trials knows its variance to √(2/500); the mean ratio
    /// is known to 0.7 %, and HAC lowers it by a few per cent.
    #[test]
    fn white_residuals_have_the_textbook_error() {
        let x: Vec<f64> = (0..500).map(|k| (0.1 * f64::from(k)).sin()).collect();
        let textbook = 1.0 / x.iter().map(|x| x * x).sum::<f64>().sqrt();
        let mean: f64 = (0..100)
            .map(|seed| regress(&[&x, &[1.0; 500]], &["x", "one"], &noise(500, seed)).unwrap())
            .map(|found| found.standard_uncertainty(0) / textbook / 100.0)
            .sum();
        assert!((0.94..1.03).contains(&mean), "{mean}");
    }

    /// The mean of a first-order autoregression with ρ = 0.8 has an error 3 times that of white noise of the same
    /// power. Over 300 trials, the estimated error matches the observed spread.
    #[test]
    fn correlated_residuals_have_an_honest_uncertainty() {
        let (trials, n, rho) = (300, 2000, 0.8_f64);
        let (mut spread, mut stated) = (0.0, 0.0);
        for seed in 0..trials {
            let mut state = 0.0;
            let y: Vec<f64> = noise(n, 1000 + seed)
                .iter()
                .map(|e| {
                    state = rho * state + (1.0 - rho * rho).sqrt() * e;
                    state
                })
                .collect();
            let found = regress(&[&vec![1.0; n]], &["mean"], &y).unwrap();
            spread += found.coefficients[0].powi(2) / trials as f64;
            stated += found.covariance[0][0] / trials as f64;
        }
        // Spread is known to √(2/300) = 8 % in variance; Bartlett's kernel is low by about as much.
        let ratio = (stated / spread).sqrt();
        assert!((0.8..1.12).contains(&ratio), "stated/made {ratio}");
        let white = (1.0 / n as f64).sqrt();
        assert!(spread.sqrt() / white > 2.5, "{}", spread.sqrt() / white);
    }

    #[test]
    fn indistinguishable_columns_are_named_and_give_no_coefficients() {
        let a: Vec<f64> = (0..40).map(|k| (0.4 * f64::from(k)).sin()).collect();
        let b: Vec<f64> = (0..40).map(|k| (0.7 * f64::from(k)).cos()).collect();
        let mix: Vec<f64> = a.iter().map(|a| 3.0 * a - 2.0).collect();
        let one = [1.0; 40];
        let culprits = |columns: &[&[f64]], names: &[&str]| match regress(columns, names, &a) {
            Err(RegressionError::NotDistinguishable { names }) => names,
            other => panic!("{other:?}"),
        };
        assert_eq!(culprits(&[&a, &b, &one, &mix], &["a", "b", "one", "mix"]), ["a", "one", "mix"]);
        assert_eq!(culprits(&[&a, &[0.0; 40]], &["a", "nothing"]), ["nothing"]);
        assert!(regress(&[&a, &b, &one], &["a", "b", "one"], &mix).is_ok());
    }

    #[test]
    fn bad_input_is_an_error_that_says_where() {
        let y = [1.0, 2.0, 3.0];
        let error = |columns: &[&[f64]], names: &[&str]| regress(columns, names, &y).unwrap_err().to_string();
        assert_eq!(error(&[&[1.0; 2]], &["a"]), "column a has 2 rows, y has 3");
        assert_eq!(error(&[&[1.0; 3], &[2.0; 3], &y], &["a", "b", "c"]), "3 rows are too few for 3 columns");
        assert_eq!(error(&[&[1.0, f64::NAN, 1.0]], &["a"]), "row 1 of a is not finite");
        assert_eq!(error(&[&y], &[]), "0 names for 1 columns");
        assert_eq!(error(&[], &[]), "3 rows are too few for 0 columns");
    }
}
