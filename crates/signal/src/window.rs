//! The most active window of a record.

/// A range of rows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window {
    /// First row.
    pub first: usize,
    /// Row after the last.
    pub end: usize,
    /// Sum of the values over these rows.
    pub sum: f64,
}

/// The window of at most `length_s` seconds (starting at a row) with the largest sum of `y`. With `y = rate · step`
/// this is the largest integral: motion hidden by a gap does not count. Windows truncated by the end of the record are
/// not considered, unless the whole record is shorter. `None` without rows.
#[must_use]
pub fn largest_sum(t: &[f64], y: &[f64], length_s: f64) -> Option<Window> {
    let last = *t.last()?;
    let mut prefix = Vec::with_capacity(y.len() + 1);
    prefix.push(0.0);
    for value in y {
        prefix.push(prefix[prefix.len() - 1] + value);
    }
    let mut best: Option<Window> = None;
    let mut end = 0;
    for first in 0..t.len() {
        while end < t.len() && t[end] <= t[first] + length_s {
            end += 1;
        }
        let sum = prefix[end] - prefix[first];
        if best.is_none_or(|b| sum > b.sum) {
            best = Some(Window { first, end, sum });
        }
        if t[first] + length_s >= last {
            break;
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_window_with_the_peak_is_found() {
        let t: Vec<f64> = (0..1000).map(|i| f64::from(i) * 0.125).collect();
        let y: Vec<f64> = t.iter().map(|t| (-(t - 40.0).powi(2) / 20.0).exp()).collect();
        let window = largest_sum(&t, &y, 10.0).unwrap();
        assert!(t[window.first] == 35.0 && t[window.end - 1] == 45.0);
    }

    #[test]
    fn a_record_shorter_than_the_window_is_the_whole_window() {
        let window = largest_sum(&[0.0, 1.0], &[1.0, 3.0], 60.0).unwrap();
        assert_eq!((window.first, window.end, window.sum), (0, 2, 4.0));
        assert_eq!(largest_sum(&[], &[], 1.0), None);
    }
}
