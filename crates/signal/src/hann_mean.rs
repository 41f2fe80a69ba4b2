//! The slow part of a series: its mean in a moving window.

use crate::reference::Reference;
use std::f64::consts::TAU;

/// Weighted mean around each timestamp with a Hann window, by running sums.
///
/// The window and the weights are prepared once, for many series at the same timestamps.
///
/// ```
/// let mean = signal::HannMean::new(&[0.0, 1.0, 2.0], &[1.0, 1.0, 0.0], f64::INFINITY);
/// assert_eq!(mean.of(&[1.0, 2.0, 100.0]), [1.5; 3]);
/// ```
#[derive(Debug, Clone)]
pub struct HannMean {
    rows: Vec<Row>,
}

#[derive(Debug, Clone, Copy)]
struct Row {
    weight: f64,
    sin: f64,
    cos: f64,
    /// The rows in its window.
    from: usize,
    to: usize,
    /// Sum of the window times the weights.
    total: f64,
}

impl HannMean {
    /// For timestamps `t` (s, increasing) with `weights`. The window is `window_s` seconds wide in all; infinite gives
    /// the plain weighted mean.
    #[must_use]
    pub fn new(t: &[f64], weights: &[f64], window_s: f64) -> HannMean {
        let half = 0.5 * window_s;
        let omega = if window_s.is_finite() { TAU / window_s } else { 0.0 };
        let (mut from, mut to) = (0, 0);
        let windows = t.iter().map(|&at| {
            from += t[from..].iter().take_while(|x| **x < at - half).count();
            to += t[to..].iter().take_while(|x| **x <= at + half).count();
            (from, to)
        });
        let windows: Vec<(usize, usize)> = windows.collect();
        let row = |((&t, &weight), (from, to)): ((&f64, &f64), (usize, usize))| {
            let (sin, cos) = (omega * t).sin_cos();
            Row { weight, sin, cos, from, to, total: 0.0 }
        };
        let mut rows: Vec<Row> = t.iter().zip(weights).zip(windows).map(row).collect();
        // (1 + cos ω(t − t₀))/2 splits into sums that do not depend on t₀.
        let sums = running_sums(rows.iter().map(|r| r.weight), &rows);
        for row in &mut rows {
            row.total = windowed(row, &sums);
        }
        HannMean { rows }
    }

    /// The mean of `e` around each timestamp; 0 where the window holds no weight.
    ///
    /// # Panics
    /// If `e` is shorter than the timestamps.
    #[must_use]
    pub fn of(&self, e: &[f64]) -> Vec<f64> {
        let sums = running_sums(self.rows.iter().zip(&e[..self.rows.len()]).map(|(r, e)| r.weight * e), &self.rows);
        self.rows.iter().map(|row| if row.total > 0.0 { windowed(row, &sums) / row.total } else { 0.0 }).collect()
    }

    /// Rms of `y` (at the timestamps `t` of `new`) minus `gain` times the reference `shift` seconds before, without the
    /// slow part, for each shift. Every shifted timestamp must be within the reference's span.
    ///
    /// # Panics
    /// If `t` or `y` differs in length from the timestamps of `new`.
    #[must_use]
    pub fn rms_by_shift(
        &self,
        (t, y): (&[f64], &[f64]),
        (reference, gain): (&dyn Reference, f64),
        shifts_s: &[f64],
    ) -> Vec<f64> {
        let n = self.rows.len();
        assert!(t.len() == n && y.len() == n, "{} and {} values for {n} timestamps", t.len(), y.len());
        let (mut instants, mut values, mut rates) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        let rms = |shift: &f64| {
            for (instant, t) in instants.iter_mut().zip(t) {
                *instant = t - shift;
            }
            reference.fill(&instants, &mut values, &mut rates);
            for (value, y) in values.iter_mut().zip(y) {
                *value = y - gain * *value;
            }
            let square = values.iter().zip(self.of(&values)).map(|(e, slow)| (e - slow).powi(2)).sum::<f64>();
            if n == 0 { 0.0 } else { (square / n as f64).sqrt() }
        };
        shifts_s.iter().map(rms).collect()
    }
}

/// The sums of `terms`, and of `terms` times the cosine and the sine of their rows, before each row and after the last.
fn running_sums(terms: impl Iterator<Item = f64>, rows: &[Row]) -> Vec<[f64; 3]> {
    let mut sums = Vec::with_capacity(rows.len() + 1);
    let mut sum = [0.0; 3];
    sums.push(sum);
    for (term, row) in terms.zip(rows) {
        sum = [sum[0] + term, sum[1] + term * row.cos, sum[2] + term * row.sin];
        sums.push(sum);
    }
    sums
}

fn windowed(row: &Row, sums: &[[f64; 3]]) -> f64 {
    let (from, to) = (sums[row.from], sums[row.to]);
    (to[0] - from[0]) + row.cos * (to[1] - from[1]) + row.sin * (to[2] - from[2])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CubicSpline;

    const PERIOD_S: f64 = 1.7;

    fn swing(t: f64) -> f64 {
        (TAU * t / PERIOD_S).sin()
    }

    #[test]
    fn a_slow_ramp_is_removed_and_the_swing_remains() {
        let t: Vec<f64> = (0..6000).map(|k| f64::from(k) * 0.01).collect();
        let e: Vec<f64> = t.iter().map(|t| 0.3 * t + swing(*t)).collect();
        let slow = HannMean::new(&t, &vec![1.0; t.len()], 4.0 * PERIOD_S).of(&e);
        for k in 400..5600 {
            assert!((slow[k] - 0.3 * t[k]).abs() < 2e-3, "{} at {}", slow[k] - 0.3 * t[k], t[k]);
        }
    }

    #[test]
    fn the_mean_is_the_weighted_sum_over_the_window() {
        let t: Vec<f64> = (0..40).map(|k| f64::from(k) + 0.1 * f64::from(k % 3)).collect();
        let e: Vec<f64> = t.iter().map(|t| t * t).collect();
        let weights: Vec<f64> = (0..40).map(|k| f64::from(k % 4)).collect();
        let slow = HannMean::new(&t, &weights, 7.0).of(&e);
        for (at, slow) in t.iter().zip(slow) {
            let near = |k: &usize| (t[*k] - at).abs() <= 3.5;
            let window = |k: usize| weights[k] * (1.0 + (TAU * (t[k] - at) / 7.0).cos());
            let sum = |of: &dyn Fn(usize) -> f64| (0..40).filter(near).map(|k| window(k) * of(k)).sum::<f64>();
            assert!((slow - sum(&|k| e[k]) / sum(&|_| 1.0)).abs() < 1e-9 * (1.0 + slow.abs()), "{slow} at {at}");
        }
    }

    #[test]
    fn the_rms_by_shift_is_that_of_two_sines() {
        let knots: Vec<f64> = (0..=7000).map(|k| f64::from(k) * 0.01).collect();
        let reference = CubicSpline::new(&knots, &knots.iter().map(|t| swing(*t)).collect::<Vec<_>>()).unwrap();
        // 20 whole periods.
        let t: Vec<f64> = (0..3400).map(|k| 10.0 + f64::from(k) * 0.01).collect();
        let y: Vec<f64> = t.iter().map(|t| 2.0 * swing(t - 0.4)).collect();
        let mean = HannMean::new(&t, &vec![1.0; t.len()], f64::INFINITY);
        let shifts = [0.0, 0.4, 1.0];
        for (shift, rms) in shifts.iter().zip(mean.rms_by_shift((&t, &y), (&reference, 2.0), &shifts)) {
            // sin(a − d) − sin(a − s) = 2 cos(…) sin((s − d)/2)
            let expected = 2.0 * 2.0 * (TAU * (shift - 0.4) / PERIOD_S / 2.0).sin().abs() / 2f64.sqrt();
            assert!((rms - expected).abs() < 1e-6, "{rms} for {expected} at {shift}");
        }
    }
}
