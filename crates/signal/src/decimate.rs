//! Fewer points for a figure, without losing any extreme.

/// Rows kept of a curve, and how many rows they represent.
#[derive(Debug, Clone, PartialEq)]
pub struct Decimated {
    /// Indices of the rows kept, rising.
    pub rows: Vec<usize>,
    /// Rows before decimation.
    pub stands_for: usize,
}

/// Keeps the first, lowest, highest and last row of each of `bins` equal time intervals.
///
/// A spike of one sample stays visible, and a line through the kept rows covers the same pixels as a line through all
/// of them if `bins` is not less than the number of pixel columns. If a curve has no more than `4 · bins` rows, all are
/// candidates. A row is skipped if it is within `1 / STEPS` of the curve's height from the straight line between its
/// neighbours, unless it is an extreme.
#[must_use]
pub fn min_max(t: &[f64], y: &[f64], bins: usize) -> Decimated {
    let stands_for = t.len().min(y.len());
    if bins == 0 {
        return Decimated { rows: (0..stands_for).collect(), stands_for };
    }
    let rows = if stands_for <= 4 * bins { (0..stands_for).collect() } else { of_bins(t, y, stands_for, bins) };
    Decimated { rows: without_straight_runs(t, y, rows), stands_for }
}

/// The first, lowest, highest and last row of each of `bins` equal time intervals.
fn of_bins(t: &[f64], y: &[f64], stands_for: usize, bins: usize) -> Vec<usize> {
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
    rows
}

/// A figure is a few hundred pixels high: a step of this share of the height of a curve cannot be seen.
const STEPS: f64 = 4000.0;

/// Skips rows that a straight line replaces, except extremes. From each kept row, the range of slopes that pass all
/// rows so far within the tolerance is narrowed until it is empty; then the previous row is kept.
fn without_straight_runs(t: &[f64], y: &[f64], rows: Vec<usize>) -> Vec<usize> {
    let [low, high] = rows.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], &r| [l.min(y[r]), h.max(y[r])]);
    let tolerance = (high - low) / STEPS;
    let is_extreme = |[a, b, c]: [usize; 3]| (y[b] - y[a]) * (y[c] - y[b]) < 0.0;
    let (mut kept, mut slopes) = (vec![], [f64::NEG_INFINITY, f64::INFINITY]);
    for (n, &row) in rows.iter().enumerate() {
        let Some(&anchor) = kept.last() else {
            kept.push(row);
            continue;
        };
        let slope = |from: usize, dy: f64| (y[row] + dy - y[from]) / (t[row] - t[from]);
        let before = rows[n - 1];
        let must_stay = before != anchor && n > 1 && is_extreme([rows[n - 2], before, row]);
        let is_straight = (slopes[0]..=slopes[1]).contains(&slope(anchor, 0.0));
        if before != anchor && (must_stay || !is_straight) {
            kept.push(before);
            slopes = [slope(before, -tolerance), slope(before, tolerance)];
        } else {
            slopes = [slopes[0].max(slope(anchor, -tolerance)), slopes[1].min(slope(anchor, tolerance))];
        }
    }
    if let Some(&last) = rows.last().filter(|last| kept.last() != Some(last)) {
        kept.push(last);
    }
    kept
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
    fn skipped_rows_lie_on_the_line_between_their_neighbours() {
        let t: Vec<f64> = (0..4000).map(|i| f64::from(i) * 0.01).collect();
        let y: Vec<f64> = t.iter().map(|t| 50.0 * (0.5 * t).sin() + if *t > 20.0 { 7.0 } else { 0.0 }).collect();
        let kept = min_max(&t, &y, 1000).rows;
        assert!(kept.len() < 400, "{}", kept.len());
        let line = |a: usize, b: usize, r: usize| y[a] + (y[b] - y[a]) * (t[r] - t[a]) / (t[b] - t[a]);
        let distance =
            |pair: &[usize]| (pair[0]..pair[1]).map(|r| (y[r] - line(pair[0], pair[1], r)).abs()).fold(0.0, f64::max);
        let [low, high] = y.iter().fold([f64::MAX, f64::MIN], |[l, h], &y| [l.min(y), h.max(y)]);
        let worst = kept.windows(2).map(distance).fold(0.0, f64::max);
        assert!(worst <= (high - low) / STEPS * 1.000_001, "{worst}");
        let extremes = (1..3999).filter(|&r| (y[r] - y[r - 1]) * (y[r + 1] - y[r]) < 0.0);
        extremes.for_each(|r| assert!(kept.contains(&r), "{r}"));
    }

    #[test]
    fn corners_of_steps_and_all_rows_of_noise_are_kept() {
        let t: Vec<f64> = (0..100).map(f64::from).collect();
        let steps: Vec<f64> = t.iter().map(|t| (t / 10.0).floor()).collect();
        let corners: Vec<usize> = (0..10).flat_map(|k| [10 * k, 10 * k + 9]).collect();
        assert_eq!(min_max(&t, &steps, 1000).rows, corners);
        let noise: Vec<f64> = (0..100).map(|k| f64::from(k % 2)).collect();
        assert_eq!(min_max(&t, &noise, 1000).rows, (0..100).collect::<Vec<_>>());
    }

    #[test]
    fn a_short_curve_is_kept_whole() {
        assert_eq!(min_max(&[0.0, 1.0], &[1.0, 1.0], 10).rows, [0, 1]);
        assert!(min_max(&[], &[], 10).rows.is_empty());
    }
}
