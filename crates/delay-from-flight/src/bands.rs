//! The delay in slow and in fast motion separately.
//!
//! A pure delay is the same at every frequency; that of a filter is not. Whitened residuals and their derivatives by
//! the delay are smoothed by a moving average. Its length is chosen so that the smooth part and the rest carry about
//! equal information on the delay.

use signal::{ComponentFit, DelayFit};

/// The delay in two bands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Bands {
    /// s
    pub(crate) slow_s: f64,
    /// s
    pub(crate) fast_s: f64,
    /// Standard uncertainty of their difference, s.
    pub(crate) apart_u_s: f64,
    /// Frequency at which the moving average halves the power, Hz.
    pub(crate) border_hz: f64,
}

/// A band with less than this share of the information is not used.
const LEAST_SHARE: f64 = 0.1;
/// Candidate lengths of the moving average, samples to each side.
const HALF_LENGTHS: [usize; 11] = [1, 2, 3, 5, 8, 12, 20, 32, 50, 80, LONGEST];
const LONGEST: usize = 120;
/// Whitened residuals are clipped here.
const CUT: f64 = 3.0;

impl Bands {
    /// `None` if nearly all information is in one band.
    pub(crate) fn of(fit: &DelayFit) -> Option<Bands> {
        let series: Vec<Series> = fit.components.iter().filter_map(Series::of).collect();
        let averages: Vec<Average> = series.iter().map(|s| Average::of(&s.derivative)).collect();
        let (half, share) = HALF_LENGTHS
            .into_iter()
            .map(|half| (half, slow_share(&averages, half)))
            .min_by(|a, b| (a.1 - 0.5).abs().total_cmp(&(b.1 - 0.5).abs()))?;
        if !(LEAST_SHARE..=1.0 - LEAST_SHARE).contains(&share) {
            return None;
        }
        // δ_slow − δ_fast = Σ w e with e white: its variance is Σ w².
        let (mut slow, mut fast) = (Sums::default(), Sums::default());
        let mut parts = vec![];
        for s in &series {
            let smooth = Average::of(&s.derivative).over(half);
            let rest: Vec<f64> = s.derivative.iter().zip(&smooth).map(|(d, l)| d - l).collect();
            // The transpose of the average, applied to the smoothed derivative: the factor of e.
            let by_slow = Average::of(&smooth).over(half);
            let by_fast: Vec<f64> = rest.iter().zip(Average::of(&rest).over(half)).map(|(r, l)| r - l).collect();
            slow.add(&smooth, &by_slow, &s.residual);
            fast.add(&rest, &by_fast, &s.residual);
            parts.push((by_slow, by_fast));
        }
        let variance: f64 = parts
            .iter()
            .flat_map(|(a, b)| a.iter().zip(b))
            .map(|(a, b)| (a / slow.information - b / fast.information).powi(2))
            .sum();
        let scale = scale(&series);
        let inflation = fit.standard_uncertainty_s / fit.hessian_s;
        let apart_u_s = variance.sqrt() * scale * inflation;
        let step_s = series.iter().map(|s| s.step_s).fold(f64::INFINITY, f64::min);
        let border_hz = 0.443 / ((2 * half + 1) as f64 * step_s);
        let found = Bands {
            slow_s: fit.delay_s + slow.product / slow.information,
            fast_s: fit.delay_s + fast.product / fast.information,
            apart_u_s,
            border_hz,
        };
        (apart_u_s > 0.0 && apart_u_s.is_finite()).then_some(found)
    }
}

#[derive(Default)]
struct Sums {
    information: f64,
    product: f64,
}

impl Sums {
    fn add(&mut self, derivative: &[f64], weight: &[f64], residual: &[f64]) {
        self.information += derivative.iter().map(|d| d * d).sum::<f64>();
        self.product += weight.iter().zip(residual).map(|(w, e)| w * e).sum::<f64>();
    }
}

/// For one component: whitened residual and derivative by the delay, with offset and drift removed.
struct Series {
    residual: Vec<f64>,
    derivative: Vec<f64>,
    step_s: f64,
}

impl Series {
    fn of(fit: &ComponentFit) -> Option<Series> {
        let (first, last) = (fit.t_used.first()?, fit.t_used.last()?);
        let n = fit.t_used.len();
        let middle = 0.5 * (first + last);
        let mut columns = [
            vec![1.0; n],
            fit.t_used.iter().map(|t| t - middle).collect::<Vec<f64>>(),
            fit.residuals.clone(),
            fit.slope.iter().map(|v| -v).collect(),
        ];
        let mut slices: Vec<&mut [f64]> = columns.iter_mut().map(Vec::as_mut_slice).collect();
        signal::whiten(&fit.t_used, &mut slices, &fit.noise);
        let [mut offset, mut drift, mut residual, mut derivative] = columns;
        take_out(&mut drift, &offset);
        for column in [&mut residual, &mut derivative] {
            take_out(column, &offset);
            if fit.drift.is_some() {
                take_out(column, &drift);
            }
        }
        offset.clear();
        residual.iter_mut().for_each(|e| *e = e.clamp(-CUT, CUT));
        let step_s = (last - first) / (n.max(2) - 1) as f64;
        (n > 2 * HALF_LENGTHS[0] + 1).then_some(Series { residual, derivative, step_s })
    }
}

fn take_out(column: &mut [f64], q: &[f64]) {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let length2 = dot(q, q);
    if length2 > 0.0 {
        let share = dot(q, column) / length2;
        column.iter_mut().zip(q).for_each(|(x, q)| *x -= share * q);
    }
}

fn scale(series: &[Series]) -> f64 {
    let all: Vec<f64> = series.iter().flat_map(|s| &s.residual).copied().collect();
    (all.iter().map(|e| e * e).sum::<f64>() / all.len().max(1) as f64).sqrt()
}

/// Share of the information in the smooth part.
fn slow_share(averages: &[Average], half: usize) -> f64 {
    let (mut slow, mut fast) = (0.0, 0.0);
    for average in averages {
        for (d, smooth) in average.values.iter().zip(average.over(half)) {
            slow += smooth * smooth;
            fast += (d - smooth).powi(2);
        }
    }
    if slow + fast > 0.0 { slow / (slow + fast) } else { 0.0 }
}

/// Moving averages of a series with any length.
struct Average<'a> {
    values: &'a [f64],
    /// Cumulative sums, with leading zeros before the first value and the total repeated after the last, as far as the
    /// longest average reaches.
    sums: Vec<f64>,
}

impl Average<'_> {
    fn of(values: &[f64]) -> Average<'_> {
        let mut sum = 0.0;
        let mut sums = Vec::with_capacity(values.len() + 1 + 2 * LONGEST);
        sums.resize(LONGEST + 1, sum);
        for x in values {
            sum += x;
            sums.push(sum);
        }
        sums.resize(values.len() + 1 + 2 * LONGEST, sum);
        Average { values, sums }
    }

    /// Mean over `half` samples to each side, with zeros outside the ends: symmetric, so it is its own transpose.
    fn over(&self, half: usize) -> Vec<f64> {
        let n = self.values.len();
        let length = (2 * half + 1) as f64;
        let (from, to) = (&self.sums[LONGEST - half..][..n], &self.sums[LONGEST + half + 1..][..n]);
        to.iter().zip(from).map(|(to, from)| (to - from) / length).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rms of 3, 4 and 0, 0 of two series: 2.5.
    #[test]
    fn the_scale_is_the_rms_of_all_residuals() {
        let series = |residual: [f64; 2]| Series { residual: residual.to_vec(), derivative: vec![], step_s: 1.0 };
        assert_eq!(scale(&[series([3.0, 4.0]), series([0.0, 0.0])]), 2.5);
        assert_eq!(scale(&[]), 0.0);
    }
}
