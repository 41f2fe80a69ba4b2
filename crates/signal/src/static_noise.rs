//! Properties of a series at rest: noise, resolution, held samples.

use crate::statistics::{median_in_place, robust_sigma};
use std::ops::Range;

/// Rows of segments in which |rate| stays at or below `threshold` (unit of the rate) for at least `least_s` seconds. A
/// gap of half that length ends a segment. Values that are not finite count as motion.
#[must_use]
pub fn static_segments(t: &[f64], rate: &[f64], threshold: f64, least_s: f64) -> Vec<Range<usize>> {
    let rows = t.len().min(rate.len());
    let still = |row: usize| rate[row].abs() <= threshold;
    let mut segments = vec![];
    let mut first = 0;
    while first < rows {
        if !still(first) {
            first += 1;
            continue;
        }
        let mut end = first + 1;
        while end < rows && still(end) && t[end] - t[end - 1] <= 0.5 * least_s {
            end += 1;
        }
        if t[end - 1] - t[first] >= least_s {
            segments.push(first..end);
        }
        first = end;
    }
    segments
}

/// Standard deviation of `y` over segments of rows, each about its own median: robust (1.4826 · MAD) unless most values
/// are identical, as in coarse records; then the plain one. `None` without rows; rows outside `y` are ignored.
#[must_use]
pub fn static_deviation(y: &[f64], segments: &[Range<usize>]) -> Option<f64> {
    let mut residuals = vec![];
    for segment in segments {
        let Some(values) = y.get(segment.clone()) else { continue };
        let Some(middle) = median_in_place(&mut values.to_vec()) else { continue };
        residuals.extend(values.iter().map(|v| v - middle));
    }
    let robust = robust_sigma(&residuals)?;
    if robust > 0.0 {
        return Some(robust);
    }
    let n = residuals.len() as f64;
    let mean = residuals.iter().sum::<f64>() / n;
    Some((residuals.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / n).sqrt())
}

/// Steps larger than this many resolutions do not show the grid.
const NEAR: f64 = 50.0;

/// The step of the grid on which all values lie; `None` if the values are constant or there is no grid.
///
/// The candidate is the smallest distance between different values (to rounding, 10⁻¹³ of the largest). It is a grid if
/// 95 % of the distances between neighbouring values are whole multiples of it, to a tenth. The returned step is their
/// mean.
#[must_use]
pub fn resolution(y: &[f64]) -> Option<f64> {
    let mut values: Vec<f64> = y.iter().copied().filter(|v| v.is_finite()).collect();
    values.sort_unstable_by(f64::total_cmp);
    let rounding = 1e-13 * values.first()?.abs().max(values.last()?.abs());
    let steps: Vec<f64> = values.windows(2).map(|w| w[1] - w[0]).filter(|&d| d > rounding).collect();
    let least = steps.iter().copied().fold(f64::INFINITY, f64::min);
    let near: Vec<f64> = steps.iter().copied().filter(|d| *d <= NEAR * least).collect();
    let on_grid = |d: &&f64| (**d / least - (**d / least).round()).abs() <= 0.1;
    let fitting: Vec<f64> = near.iter().filter(on_grid).copied().collect();
    let grid = !near.is_empty() && 20 * fitting.len() >= 19 * near.len() && 2 * near.len() >= steps.len();
    let multiples: f64 = fitting.iter().map(|d| (d / least).round()).sum();
    grid.then(|| fitting.iter().sum::<f64>() / multiples)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;

    fn noise(n: usize, seed: u64) -> Vec<f64> {
        let mut random = Pcg64::seed_from_u64(seed);
        (0..n).map(|_| StandardNormal.sample(&mut random)).collect()
    }

    #[test]
    fn periods_of_rest_exclude_short_ones_and_gaps() {
        let t: Vec<f64> = (0..3000).map(|k| 0.01 * f64::from(k) + if k < 2500 { 0.0 } else { 100.0 }).collect();
        let rate: Vec<f64> =
            (0..3000).map(|k| if (700..1000).contains(&k) || k == 1800 { 1.0 } else { 0.01 }).collect();
        assert_eq!(static_segments(&t, &rate, 0.02, 5.0), [0..700, 1000..1800, 1801..2500]);
        assert_eq!(static_segments(&t, &rate, 0.001, 5.0), [0..0; 0]);
        assert_eq!(static_segments(&[], &[], 1.0, 1.0), [0..0; 0]);
    }

    /// σ is known to 1.17/√(2n) · √2.7: 0.8 % here; gate at 4 σ. Offsets between segments do not count.
    #[test]
    fn the_deviation_at_rest_is_that_of_the_noise() {
        let mut y: Vec<f64> = noise(20_000, 5).iter().map(|v| 0.3 * v).collect();
        y.iter_mut().skip(10_000).for_each(|v| *v += 50.0);
        y[77] = 1e6;
        let found = static_deviation(&y, &[0..10_000, 10_000..20_000]).unwrap();
        assert!((found / 0.3 - 1.0).abs() < 0.04, "{found}");
        assert_eq!(static_deviation(&y, &[]), None);
        assert_eq!(static_deviation(&y, &[19_000..30_000, 40_000..50_000]), None);
    }

    #[test]
    fn a_coarse_record_at_rest_has_a_deviation() {
        let y: Vec<f64> = (0..1000).map(|k| if k % 10 == 0 { 1.0 } else { 0.0 }).collect();
        assert!((static_deviation(&y, &[0..500, 500..1000]).unwrap() - 0.3).abs() < 1e-12);
        assert_eq!(static_deviation(&[2.0; 50], &[0..20, 20..50]), Some(0.0));
    }

    #[test]
    fn the_resolution_is_the_grid_and_noise_has_no_grid() {
        let lsb = std::f64::consts::TAU / 2000.0;
        let swing: Vec<f64> = (0..3000).map(|k| (f64::from(k) * 0.031).sin()).collect();
        let coarse: Vec<f64> = swing.iter().map(|x| (x / lsb).round() * lsb + 0.123).collect();
        assert!((resolution(&coarse).unwrap() / lsb - 1.0).abs() < 1e-9);
        let few: Vec<f64> = swing.iter().step_by(10).map(|x| (x / lsb).round() * lsb).collect();
        assert!((resolution(&few).unwrap() / lsb - 1.0).abs() < 1e-9);
        assert_eq!(resolution(&noise(3000, 8)), None);
        assert_eq!(resolution(&swing), None);
        assert_eq!(resolution(&[4.0; 30]), None);
        assert_eq!(resolution(&[]), None);
        assert_eq!(resolution(&[1.0, 3.0, 1.0, f64::NAN]), Some(2.0));
    }
}
