//! How far apart two recordings of one motion are, when their clocks have nothing in common.

use rustfft::FftPlanner;
use rustfft::num_complex::Complex64;

/// Least share of the shorter recording that must overlap the other.
const LEAST_OVERLAP: f64 = 0.5;
/// Longest grid, samples: about a day at 50 Hz.
const LONGEST_GRID: usize = 1 << 22;
/// Peaks closer than this to the best are the same peak, s.
const SAME_PEAK_S: f64 = 0.25;

/// The lag at which two recordings look most alike.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CoarseLag {
    /// Add this to the stamps of `b` to put it over `a`, s; as fine as the grid.
    pub shift_s: f64,
    /// Correlation coefficient there, over the rows in which both are known.
    pub correlation: f64,
    /// Best correlation coefficient further than a quarter of a second away.
    pub runner_up: f64,
    /// Where that is, s.
    pub runner_up_s: f64,
}

/// The shift of `b` against `a` with the highest correlation coefficient, over all shifts at which at least half
/// of the shorter recording overlaps. Both are put on a grid of `rate_hz` first, linear between their samples.
///
/// `None` with fewer than 16 grid points in either, with a recording that does not move, or with more than
/// 2²² grid points.
#[must_use]
pub fn coarse_lag(t_a: &[f64], a: &[f64], t_b: &[f64], b: &[f64], rate_hz: f64) -> Option<CoarseLag> {
    let (start_a, start_b) = (*t_a.first()?, *t_b.first()?);
    let a = on_grid(t_a, a, rate_hz)?;
    let b = on_grid(t_b, b, rate_hz)?;
    let correlations = correlations(&a, &b);
    let shift_of = |k: usize| start_a - start_b + (k as f64 - (b.len() as f64 - 1.0)) / rate_hz;
    let best = |skip: &dyn Fn(f64) -> bool| {
        let kept = correlations.iter().enumerate().filter(|(k, r)| !skip(shift_of(*k)) && r.is_finite());
        kept.max_by(|x, y| x.1.total_cmp(y.1)).map(|(k, r)| (shift_of(k), *r))
    };
    let (shift_s, correlation) = best(&|_| false)?;
    let (runner_up_s, runner_up) =
        best(&|s: f64| (s - shift_s).abs() <= SAME_PEAK_S).unwrap_or((shift_s, f64::NEG_INFINITY));
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
    // Sums of squares about the mean keep their digits.
    let mean = grid.iter().sum::<f64>() / grid.len() as f64;
    let centred: Vec<f64> = grid.iter().map(|v| v - mean).collect();
    centred.iter().any(|v| *v != 0.0).then_some(centred)
}

/// Correlation coefficients over the overlap, by the shift `k − (b.len() − 1)` of `b`; −∞ where too little overlaps.
fn correlations(a: &[f64], b: &[f64]) -> Vec<f64> {
    let length = a.len() + b.len() - 1;
    let products = cross_products(a, b, length);
    let (sum_a, square_a) = prefix_sums(a);
    let (sum_b, square_b) = prefix_sums(b);
    let least = (LEAST_OVERLAP * a.len().min(b.len()) as f64).max(8.0);
    (0..length)
        .map(|k| {
            // Row i of b lies over row i + k − (b.len() − 1) of a.
            let from_a = (k + 1).saturating_sub(b.len());
            let from_b = (b.len() - 1).saturating_sub(k);
            let n = (a.len() - from_a).min(b.len() - from_b);
            if (n as f64) < least {
                return f64::NEG_INFINITY;
            }
            let over = |sums: &[f64], from: usize| sums[from + n] - sums[from];
            let (mean_a, mean_b) = (over(&sum_a, from_a) / n as f64, over(&sum_b, from_b) / n as f64);
            let variance_a = over(&square_a, from_a) - n as f64 * mean_a * mean_a;
            let variance_b = over(&square_b, from_b) - n as f64 * mean_b * mean_b;
            let floor_a = 1e-9 * square_a[a.len()] * n as f64 / a.len() as f64;
            let floor_b = 1e-9 * square_b[b.len()] * n as f64 / b.len() as f64;
            if variance_a <= floor_a || variance_b <= floor_b {
                return f64::NEG_INFINITY;
            }
            (products[k] - n as f64 * mean_a * mean_b) / (variance_a * variance_b).sqrt()
        })
        .collect()
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

    /// A swing whose rhythm wanders.
    fn swing(t: f64) -> f64 {
        (3.4 * t + 2.0 * (0.21 * t).sin()).sin().abs() * (1.0 + 0.3 * (0.5 * t).cos())
    }

    fn recording(from: f64, to: f64, step: f64) -> (Vec<f64>, Vec<f64>) {
        let t: Vec<f64> = (0..).map(|i| from + f64::from(i) * step).take_while(|t| *t < to).collect();
        let y = t.iter().map(|t| swing(*t)).collect();
        (t, y)
    }

    #[test]
    fn a_recording_with_another_clock_is_put_back_over_the_first() {
        let (t_a, a) = recording(0.0, 60.0, 0.01);
        let (t_b, b) = recording(7.3, 52.1, 0.013);
        let far: Vec<f64> = t_b.iter().map(|t| t + 1.7e5).collect();
        let lag = coarse_lag(&t_a, &a, &far, &b, 50.0).unwrap();
        assert!((lag.shift_s + 1.7e5).abs() < 0.02, "{lag:?}");
        assert!(lag.correlation > 0.99 && lag.runner_up < 0.95, "{lag:?}");
    }

    #[test]
    fn gain_and_offset_do_not_matter() {
        let (t, a) = recording(0.0, 30.0, 0.02);
        let b: Vec<f64> = a.iter().map(|v| 40.0 + 0.02 * v).collect();
        assert!(coarse_lag(&t, &a, &t, &b, 50.0).unwrap().shift_s.abs() < 1e-9);
    }

    #[test]
    fn a_recording_that_does_not_move_has_no_lag() {
        let (t, a) = recording(0.0, 30.0, 0.02);
        assert!(coarse_lag(&t, &a, &t, &vec![3.0; t.len()], 50.0).is_none());
        assert!(coarse_lag(&t[..3], &a[..3], &t, &a, 50.0).is_none());
    }
}
