//! Fewer points for a figure, without losing one extreme.

/// Rows kept of a curve, and what they stand for.
#[derive(Debug, Clone, PartialEq)]
pub struct Decimated {
    /// Rows kept, rising.
    pub rows: Vec<usize>,
    /// Rows before decimation.
    pub stands_for: usize,
}

/// Keeps, of every one of `bins` equal stretches of time, the first, lowest, highest and last row.
///
/// A spike of one sample stays visible, and a line through the kept rows covers the same
/// pixels as a line through all of them when `bins` is not less than the pixel columns.
/// A curve with no more than `4 · bins` rows is kept whole.
#[must_use]
pub fn min_max(t: &[f64], y: &[f64], bins: usize) -> Decimated {
    let stands_for = t.len().min(y.len());
    if stands_for <= 4 * bins || bins == 0 {
        return Decimated { rows: (0..stands_for).collect(), stands_for };
    }
    let (start, span) = (t[0], t[stands_for - 1] - t[0]);
    let bin_of = |row: usize| (((t[row] - start) / span * bins as f64) as usize).min(bins - 1);
    let mut rows = Vec::with_capacity(4 * bins);
    let mut first = 0;
    while first < stands_for {
        let bin = bin_of(first);
        let end = (first..stands_for).find(|&row| bin_of(row) != bin).unwrap_or(stands_for);
        let (mut low, mut high) = (first, first);
        for row in first..end {
            if y[row] < y[low] {
                low = row;
            }
            if y[row] > y[high] {
                high = row;
            }
        }
        let mut kept = [first, low, high, end - 1];
        kept.sort_unstable();
        for row in kept {
            if rows.last() != Some(&row) {
                rows.push(row);
            }
        }
        first = end;
    }
    Decimated { rows, stands_for }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spike_of_one_sample_survives() {
        let n = 100_000;
        let t: Vec<f64> = (0..n).map(|i| f64::from(i) * 0.01).collect();
        let mut y: Vec<f64> = t.iter().map(|t| t.sin()).collect();
        y[54_321] = 10.0;
        y[54_400] = -10.0;
        let kept = min_max(&t, &y, 1000);
        assert!(kept.rows.contains(&54_321) && kept.rows.contains(&54_400));
        assert!(kept.rows.len() <= 4000 && kept.stands_for == 100_000);
        assert!(kept.rows.windows(2).all(|w| w[0] < w[1]));
        assert_eq!((kept.rows[0], *kept.rows.last().unwrap()), (0, 99_999));
    }

    #[test]
    fn a_short_curve_is_kept_whole() {
        assert_eq!(min_max(&[0.0, 1.0], &[1.0, 1.0], 10).rows, [0, 1]);
        assert!(min_max(&[], &[], 10).rows.is_empty());
    }
}
