//! Order statistics, and an rms with its uncertainty.

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

/// The median; sorts the slice. `None` without values.
#[must_use]
pub fn median_in_place(values: &mut [f64]) -> Option<f64> {
    values.sort_unstable_by(f64::total_cmp);
    percentile_of_sorted(values, 0.5)
}

/// The median, as [`median_in_place`], but in O(n) and without changing the values. `None` without values.
#[must_use]
pub fn median_by_selection(values: &[f64]) -> Option<f64> {
    median_of_keys(&mut values.iter().map(|x| key(*x)).collect::<Vec<i64>>())
}

/// 1.4826 · median |x − median x|: the standard deviation of the Gaussian core. `None` without values.
#[must_use]
pub fn robust_sigma(values: &[f64]) -> Option<f64> {
    let mut keys: Vec<i64> = values.iter().map(|x| key(*x)).collect();
    let centre = median_of_keys(&mut keys)?;
    for (key_of, value) in keys.iter_mut().zip(values) {
        *key_of = key((value - centre).abs());
    }
    median_of_keys(&mut keys).map(|mad| 1.482_602_218_505_602 * mad)
}

/// An integer for each number, in the order of [`f64::total_cmp`]: selection on integers takes half the time.
fn key(x: f64) -> i64 {
    let bits = x.to_bits().cast_signed();
    bits ^ ((bits >> 63).cast_unsigned() >> 1).cast_signed()
}

/// The number with this key: [`key`] is its own inverse, as it leaves the sign unchanged.
fn number(key_of: i64) -> f64 {
    f64::from_bits((key_of ^ ((key_of >> 63).cast_unsigned() >> 1).cast_signed()).cast_unsigned())
}

fn median_of_keys(keys: &mut [i64]) -> Option<f64> {
    let last = keys.len().checked_sub(1)?;
    let (below, middle, _) = keys.select_nth_unstable(keys.len() / 2);
    let middle = number(*middle);
    if last.is_multiple_of(2) {
        return Some(middle);
    }
    let before = number(*below.iter().max()?);
    Some(before + 0.5 * (middle - before))
}

/// The rms of values given as squares, in time order, with an uncertainty that allows for their correlation
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
            let values: Vec<f64> = (0..n).map(|k| f64::from((k * 7919 + n) % 17) - 8.0).collect();
            assert_eq!(median_by_selection(&values), median_in_place(&mut values.clone()));
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
    fn the_rms_of_squares_equals_that_of_the_values() {
        let found = block_jackknife_rms(&[9.0, 16.0]);
        assert_eq!(found, Some(BlockEstimate { value: 12.5f64.sqrt(), standard_uncertainty: None }));
        assert_eq!(block_jackknife_rms(&[]), None);
    }
}
