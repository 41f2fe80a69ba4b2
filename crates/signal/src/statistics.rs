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

/// Quantiles of values as in [`percentile_of_sorted`], without sorting all; `shares` rise. Reorders the values. Empty
/// without values.
pub fn percentiles(values: &mut [f64], shares: &[f64]) -> Vec<f64> {
    let Some(last) = values.len().checked_sub(1) else { return vec![] };
    let mut end = values.len();
    let mut out: Vec<f64> = shares
        .iter()
        .rev()
        .map(|share| {
            let position = share.clamp(0.0, 1.0) * last as f64;
            let below = position.floor() as usize;
            // Larger values were already partitioned off by the previous quantile.
            let above = values[end..].iter().copied().fold(f64::INFINITY, f64::min);
            let (_, low, high) = values[..end].select_nth_unstable_by(below, f64::total_cmp);
            let next = high.iter().copied().fold(above, f64::min);
            let value = if below < last { *low + (position - below as f64) * (next - *low) } else { *low };
            end = below + 1;
            value
        })
        .collect();
    out.reverse();
    out
}

/// One quantile of values in any order, as [`percentile_of_sorted`]. `None` without values.
#[must_use]
pub fn percentile(values: &[f64], share: f64) -> Option<f64> {
    percentiles(&mut values.to_vec(), &[share]).pop()
}

/// The median step of rising times. `None` for fewer than two.
#[must_use]
pub fn median_step(t: &[f64]) -> Option<f64> {
    let steps: Vec<f64> = t.windows(2).map(|pair| pair[1] - pair[0]).collect();
    median_by_selection(&steps)
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
    fn quantiles_match_those_of_sorted_values() {
        let mut values: Vec<f64> = (0..1000).map(|k| f64::from((k * 7919) % 1009)).collect();
        let shares = [0.0, 0.5, 0.5, 0.68, 0.95, 0.9501, 0.99, 1.0];
        let found = percentiles(&mut values.clone(), &shares);
        values.sort_unstable_by(f64::total_cmp);
        let expected: Vec<f64> = shares.iter().map(|s| percentile_of_sorted(&values, *s).unwrap()).collect();
        assert_eq!(found, expected);
        assert_eq!(percentiles(&mut [7.0], &[0.0, 1.0]), [7.0, 7.0]);
        assert!(percentiles(&mut [], &[0.5]).is_empty());
        assert_eq!(percentile(&[8.0, 1.0, 4.0, 2.0], 0.25), Some(1.75));
        assert_eq!(percentile(&[], 0.25), None);
    }

    #[test]
    fn the_median_step_needs_two_times() {
        assert_eq!(median_step(&[0.0, 1.0, 3.0, 4.0]), Some(1.0));
        assert_eq!(median_step(&[5.0]), None);
    }

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
