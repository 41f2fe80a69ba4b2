//! Order statistics, and an rms that knows how well it is known.

/// The `share` quantile (0 to 1) of ascending values, linear between order statistics (type 7 of
/// Hyndman and Fan, as NumPy's default). `None` without values.
#[must_use]
pub fn percentile_of_sorted(sorted: &[f64], share: f64) -> Option<f64> {
    let last = sorted.len().checked_sub(1)?;
    let position = share.clamp(0.0, 1.0) * last as f64;
    let below = position.floor() as usize;
    let above = (below + 1).min(last);
    Some(sorted[below] + (position - below as f64) * (sorted[above] - sorted[below]))
}

/// The median; the slice is left sorted. `None` without values.
#[must_use]
pub fn median_in_place(values: &mut [f64]) -> Option<f64> {
    values.sort_unstable_by(f64::total_cmp);
    percentile_of_sorted(values, 0.5)
}

/// 1.4826 · median |x − median x|: the standard deviation of the Gaussian core. `None` without values.
#[must_use]
pub fn robust_sigma(values: &[f64]) -> Option<f64> {
    let mut copy = values.to_vec();
    let centre = median_in_place(&mut copy)?;
    for value in &mut copy {
        *value = (*value - centre).abs();
    }
    median_in_place(&mut copy).map(|mad| 1.482_602_218_505_602 * mad)
}

/// A root mean square and its standard error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RmsEstimate {
    /// Root of the mean of the squares.
    pub value: f64,
    /// Standard error from a delete-one-block jackknife; `None` when there are too few rows for blocks.
    pub standard_error: Option<f64>,
}

const BLOCKS: usize = 20;

/// The rms of values given as squares, with a standard error that stays honest for correlated
/// rows: a delete-one jackknife over 20 consecutive blocks (Künsch 1989). Valid as long as the
/// correlation is short against a twentieth of the record. `None` without rows.
#[must_use]
pub fn block_jackknife_rms(squares: &[f64]) -> Option<RmsEstimate> {
    let n = squares.len();
    let total: f64 = squares.iter().sum();
    let value = (n > 0).then(|| (total / n as f64).sqrt())?;
    if n < 2 * BLOCKS {
        return Some(RmsEstimate { value, standard_error: None });
    }
    let without: Vec<f64> = (0..BLOCKS)
        .map(|b| {
            let block = &squares[b * n / BLOCKS..(b + 1) * n / BLOCKS];
            ((total - block.iter().sum::<f64>()).max(0.0) / (n - block.len()) as f64).sqrt()
        })
        .collect();
    let mean = without.iter().sum::<f64>() / BLOCKS as f64;
    let spread: f64 = without.iter().map(|w| (w - mean).powi(2)).sum();
    let standard_error = (spread * (BLOCKS - 1) as f64 / BLOCKS as f64).sqrt();
    Some(RmsEstimate { value, standard_error: Some(standard_error) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_agree_with_numpy() {
        // numpy.percentile([1, 2, 4, 8], [0, 25, 50, 99, 100]) = 1, 1.75, 3, 7.88, 8
        let x = [1.0, 2.0, 4.0, 8.0];
        for (share, expected) in [(0.0, 1.0), (0.25, 1.75), (0.5, 3.0), (0.99, 7.88), (1.0, 8.0)] {
            assert!((percentile_of_sorted(&x, share).unwrap() - expected).abs() < 1e-12);
        }
        assert_eq!(percentile_of_sorted(&[], 0.5), None);
    }

    #[test]
    fn the_robust_sigma_ignores_outliers() {
        let mut x: Vec<f64> = (-500..=500).map(f64::from).collect();
        let clean = robust_sigma(&x).unwrap();
        x.extend([1e9; 20]);
        assert!((robust_sigma(&x).unwrap() / clean - 1.0).abs() < 0.05);
    }

    /// White Gaussian noise has var(mean square) = 2σ⁴/n, so the rms of n rows has standard error σ/√(2n).
    #[test]
    fn the_standard_error_of_white_noise_is_the_textbook_one() {
        let mut state = 0x2545_f491_4f6c_dd1d_u64;
        let mut uniform = || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        let n = 4000;
        let trials = 200;
        let mut ratio = 0.0;
        for _ in 0..trials {
            let squares: Vec<f64> = (0..n)
                .map(|_| {
                    let radius2 = -2.0 * (1.0 - uniform()).ln();
                    radius2 * (std::f64::consts::TAU * uniform()).cos().powi(2)
                })
                .collect();
            let found = block_jackknife_rms(&squares).unwrap().standard_error.unwrap();
            ratio += (found * (2.0 * f64::from(n)).sqrt()).powi(2) / f64::from(trials);
        }
        // Each trial's variance estimate has 19 degrees of freedom: relative sd √(2/19)/√200 = 2.3 %; gate at 4 σ.
        assert!((ratio - 1.0).abs() < 0.092, "{ratio}");
    }

    #[test]
    fn too_few_rows_have_an_rms_and_no_error() {
        assert_eq!(block_jackknife_rms(&[4.0; 10]), Some(RmsEstimate { value: 2.0, standard_error: None }));
        assert_eq!(block_jackknife_rms(&[]), None);
    }
}
