//! Order statistics, and an rms that knows how well it is known.

use crate::blocks::{BlockEstimate, BlockSums};

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

/// The median, as [`median_in_place`], but the slice is left in no particular order, and in O(n). `None` without values.
#[must_use]
pub fn median_by_selection(values: &mut [f64]) -> Option<f64> {
    let last = values.len().checked_sub(1)?;
    let (below, middle, _) = values.select_nth_unstable_by(values.len() / 2, f64::total_cmp);
    let middle = *middle;
    if last.is_multiple_of(2) {
        return Some(middle);
    }
    let before = below.iter().copied().max_by(f64::total_cmp)?;
    Some(before + 0.5 * (middle - before))
}

/// 1.4826 · median |x − median x|: the standard deviation of the Gaussian core. `None` without values.
#[must_use]
pub fn robust_sigma(values: &[f64]) -> Option<f64> {
    let mut copy = values.to_vec();
    let centre = median_by_selection(&mut copy)?;
    for value in &mut copy {
        *value = (*value - centre).abs();
    }
    median_by_selection(&mut copy).map(|mad| 1.482_602_218_505_602 * mad)
}

/// The rms of values given as squares, in order of time, with an uncertainty that allows for their correlation
/// ([`BlockSums`]). `None` without rows.
#[must_use]
pub fn block_jackknife_rms(squares: &[f64]) -> Option<BlockEstimate> {
    let rows = squares.iter().map(|square| [*square, 1.0]);
    BlockSums::of(squares.len(), rows).estimate_size(|[sum, n]| (sum.max(0.0) / n).sqrt())
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
    fn the_median_is_the_same_by_sorting_and_by_selection() {
        for n in 0..40_u32 {
            let values: Vec<f64> = (0..n).map(|k| f64::from((k * 7919 + n) % 17)).collect();
            assert_eq!(median_by_selection(&mut values.clone()), median_in_place(&mut values.clone()));
        }
    }

    #[test]
    fn the_robust_sigma_ignores_outliers() {
        let mut x: Vec<f64> = (-500..=500).map(f64::from).collect();
        let clean = robust_sigma(&x).unwrap();
        x.extend([1e9; 20]);
        assert!((robust_sigma(&x).unwrap() / clean - 1.0).abs() < 0.05);
    }

    #[test]
    fn the_rms_of_squares_is_that_of_the_values() {
        let found = block_jackknife_rms(&[9.0, 16.0]);
        assert_eq!(found, Some(BlockEstimate { value: 12.5f64.sqrt(), standard_uncertainty: None }));
        assert_eq!(block_jackknife_rms(&[]), None);
    }
}
