//! Finds the time shift between two recordings of one motion whose clocks are unrelated.

use rustfft::FftPlanner;
use rustfft::num_complex::Complex64;

/// Minimum share of the shorter recording that must overlap the other.
const LEAST_OVERLAP: f64 = 0.5;
/// Longest grid, samples: about a day at 50 Hz.
const LONGEST_GRID: usize = 1 << 22;
/// The lag at which two recordings are most alike.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CoarseLag {
    /// Add this to the timestamps of `b` to align it with `a`, s; resolution is that of the grid.
    pub shift_s: f64,
    /// Correlation coefficient there, over the rows known in both.
    pub correlation: f64,
    /// Best correlation coefficient further than `same_peak_s` away.
    pub runner_up: f64,
    /// Lag of that second peak, s.
    pub runner_up_s: f64,
}

/// The shift of `b` against `a` with the highest correlation coefficient, over all shifts at which at least half of the
/// shorter recording overlaps. Both are resampled to `rate_hz` first, linear between their samples.
///
/// Each recording has one or more components; all components have the same weight. Peaks closer than `same_peak_s` to
/// the best are the same peak.
///
/// `None` with fewer than 16 grid points in either, if a recording does not move, or with more than 2²² grid points.
#[must_use]
pub fn coarse_lag<const N: usize>(
    (t_a, a): (&[f64], [&[f64]; N]),
    (t_b, b): (&[f64], [&[f64]; N]),
    rate_hz: f64,
    same_peak_s: f64,
) -> Option<CoarseLag> {
    let (start_a, start_b) = (*t_a.first()?, *t_b.first()?);
    let on_grids = |t: &[f64], all: [&[f64]; N]| -> Option<Vec<Vec<f64>>> {
        let grids: Vec<Vec<f64>> = all.iter().map(|y| on_grid(t, y, rate_hz)).collect::<Option<_>>()?;
        // A component that does not move carries no information next to one that does.
        grids.iter().flatten().any(|v| *v != 0.0).then_some(grids)
    };
    let (a, b) = (on_grids(t_a, a)?, on_grids(t_b, b)?);
    let correlations = correlations(&a, &b);
    let length_b = b.first()?.len() as f64;
    let shift_of = |k: usize| start_a - start_b + (k as f64 - (length_b - 1.0)) / rate_hz;
    let best = |skip: &dyn Fn(f64) -> bool| {
        let kept = correlations.iter().enumerate().filter(|(k, r)| !skip(shift_of(*k)) && r.is_finite());
        kept.max_by(|x, y| x.1.total_cmp(y.1)).map(|(k, r)| (shift_of(k), *r))
    };
    let (shift_s, correlation) = best(&|_| false)?;
    let (runner_up_s, runner_up) =
        best(&|s: f64| (s - shift_s).abs() <= same_peak_s).unwrap_or((shift_s, f64::NEG_INFINITY));
    Some(CoarseLag { shift_s, correlation, runner_up: runner_up.max(-1.0), runner_up_s })
}

fn on_grid(t: &[f64], y: &[f64], rate_hz: f64) -> Option<Vec<f64>> {
    let (first, last) = (*t.first()?, *t.last()?);
    let n = ((last - first) * rate_hz).floor() + 1.0;
    if !(16.0..=LONGEST_GRID as f64).contains(&n) || t.len() != y.len() {
        return None;
    }
    let mut k = 0;
    let grid = (0..n as usize).map(|i| {
        let at = first + i as f64 / rate_hz;
        while k + 2 < t.len() && t[k + 1] < at {
            k += 1;
        }
        let share = ((at - t[k]) / (t[k + 1] - t[k])).clamp(0.0, 1.0);
        y[k] + share * (y[k + 1] - y[k])
    });
    let grid: Vec<f64> = grid.collect();
    // Sums of squares about the mean, to keep precision.
    let mean = grid.iter().sum::<f64>() / grid.len() as f64;
    Some(grid.iter().map(|v| v - mean).collect())
}

/// Sums over the components at one shift.
#[derive(Clone, Copy, Default)]
struct Sums {
    product: f64,
    variance_a: f64,
    variance_b: f64,
}

/// Correlation coefficients over the overlap, indexed by the shift `k − (b.len() − 1)` of `b`; −∞ if the overlap is too
/// short.
fn correlations(a: &[Vec<f64>], b: &[Vec<f64>]) -> Vec<f64> {
    let (rows_a, rows_b) = (a.first().map_or(0, Vec::len), b.first().map_or(0, Vec::len));
    let mut sums = vec![Sums::default(); rows_a + rows_b - 1];
    a.iter().zip(b).for_each(|(a, b)| add_component(a, b, &mut sums));
    let square = |all: &[Vec<f64>]| all.iter().flatten().map(|v| v * v).sum::<f64>();
    let (square_a, square_b) = (square(a) / rows_a as f64, square(b) / rows_b as f64);
    let least = (LEAST_OVERLAP * rows_a.min(rows_b) as f64).max(8.0);
    let coefficient = |(k, s): (usize, &Sums)| {
        let (.., n) = overlap(rows_a, rows_b, k);
        let still = s.variance_a <= 1e-9 * square_a * n as f64 || s.variance_b <= 1e-9 * square_b * n as f64;
        if (n as f64) < least || still {
            return f64::NEG_INFINITY;
        }
        s.product / (s.variance_a * s.variance_b).sqrt()
    };
    sums.iter().enumerate().map(coefficient).collect()
}

/// First overlapping rows of `a` and of `b` at shift `k`, and the length of the overlap: row `i` of `b` is aligned with
/// row `i + k − (b.len() − 1)` of `a`.
fn overlap(rows_a: usize, rows_b: usize, k: usize) -> (usize, usize, usize) {
    let from_a = (k + 1).saturating_sub(rows_b);
    let from_b = (rows_b - 1).saturating_sub(k);
    (from_a, from_b, (rows_a - from_a).min(rows_b - from_b))
}

fn add_component(a: &[f64], b: &[f64], sums: &mut [Sums]) {
    let products = cross_products(a, b, sums.len());
    let (sum_a, square_a) = prefix_sums(a);
    let (sum_b, square_b) = prefix_sums(b);
    for (k, (total, product)) in sums.iter_mut().zip(products).enumerate() {
        let (from_a, from_b, n) = overlap(a.len(), b.len(), k);
        let over = |sums: &[f64], from: usize| sums[from + n] - sums[from];
        let (mean_a, mean_b) = (over(&sum_a, from_a) / n as f64, over(&sum_b, from_b) / n as f64);
        total.product += product - n as f64 * mean_a * mean_b;
        total.variance_a += over(&square_a, from_a) - n as f64 * mean_a * mean_a;
        total.variance_b += over(&square_b, from_b) - n as f64 * mean_b * mean_b;
    }
}

/// `out[k] = Σ a[i + k − (b.len() − 1)] b[i]`, by fast Fourier transform.
fn cross_products(a: &[f64], b: &[f64], length: usize) -> Vec<f64> {
    let size = length.next_power_of_two();
    let mut planner = FftPlanner::new();
    let (forward, backward) = (planner.plan_fft_forward(size), planner.plan_fft_inverse(size));
    let transformed = |values: &mut dyn Iterator<Item = f64>| {
        let mut buffer: Vec<Complex64> = values.map(|v| Complex64::new(v, 0.0)).collect();
        buffer.resize(size, Complex64::new(0.0, 0.0));
        forward.process(&mut buffer);
        buffer
    };
    let mut product = transformed(&mut a.iter().copied());
    let reversed = transformed(&mut b.iter().rev().copied());
    product.iter_mut().zip(reversed).for_each(|(p, r)| *p *= r);
    backward.process(&mut product);
    product[..length].iter().map(|c| c.re / size as f64).collect()
}

fn prefix_sums(values: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let running = |f: fn(f64) -> f64| {
        let mut sum = 0.0;
        let sums = values.iter().map(move |v| {
            sum += f(*v);
            sum
        });
        std::iter::once(0.0).chain(sums).collect()
    };
    (running(|v| v), running(|v| v * v))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A swing with a varying period.
    fn swing(t: f64) -> f64 {
        (3.4 * t + 2.0 * (0.21 * t).sin()).sin().abs() * (1.0 + 0.3 * (0.5 * t).cos())
    }

    fn recording(from: f64, to: f64, step: f64) -> (Vec<f64>, Vec<f64>) {
        let t: Vec<f64> = (0..).map(|i| from + f64::from(i) * step).take_while(|t| *t < to).collect();
        let y = t.iter().map(|t| swing(*t)).collect();
        (t, y)
    }

    #[test]
    fn a_recording_with_another_clock_is_aligned_with_the_first() {
        let (t_a, a) = recording(0.0, 60.0, 0.01);
        let (t_b, b) = recording(7.3, 52.1, 0.013);
        let far: Vec<f64> = t_b.iter().map(|t| t + 1.7e5).collect();
        let lag = coarse_lag((&t_a, [&a]), (&far, [&b]), 50.0, 0.25).unwrap();
        assert!((lag.shift_s + 1.7e5).abs() < 0.02, "{lag:?}");
        assert!(lag.correlation > 0.99 && lag.runner_up < 0.95, "{lag:?}");
    }

    #[test]
    fn gain_and_offset_do_not_matter() {
        let (t, a) = recording(0.0, 30.0, 0.02);
        let b: Vec<f64> = a.iter().map(|v| 40.0 + 0.02 * v).collect();
        assert!(coarse_lag((&t, [&a]), (&t, [&b]), 50.0, 0.25).unwrap().shift_s.abs() < 1e-9);
    }

    /// On a circle the speed alone does not change.
    #[test]
    fn two_components_show_a_lag_that_their_magnitude_does_not() {
        let angle = |t: f64| 0.3 * t + 2.0 * (0.05 * t).sin();
        let turn = |from: f64, to: f64| {
            let t: Vec<f64> = (0..).map(|i| from + f64::from(i) * 0.1).take_while(|t| *t < to).collect();
            let north: Vec<f64> = t.iter().map(|t| 15.0 * angle(*t).cos()).collect();
            let east: Vec<f64> = t.iter().map(|t| 15.0 * angle(*t).sin()).collect();
            (t, north, east)
        };
        let (t_a, n_a, e_a) = turn(0.0, 200.0);
        let (t_b, n_b, e_b) = turn(31.0, 180.0);
        let far: Vec<f64> = t_b.iter().map(|t| t + 5000.0).collect();
        let lag = coarse_lag((&t_a, [&n_a, &e_a]), (&far, [&n_b, &e_b]), 5.0, 5.0).unwrap();
        assert!((lag.shift_s + 5000.0).abs() <= 0.1 && lag.correlation > 0.99 && lag.runner_up < 0.9, "{lag:?}");
    }

    #[test]
    fn a_recording_that_does_not_move_has_no_lag() {
        let (t, a) = recording(0.0, 30.0, 0.02);
        assert!(coarse_lag((&t, [&a]), (&t, [&vec![3.0; t.len()]]), 50.0, 0.25).is_none());
        assert!(coarse_lag((&t[..3], [&a[..3]]), (&t, [&a]), 50.0, 0.25).is_none());
    }
}
