//! Statistics of rows that are correlated in time, with a standard uncertainty that allows for it.

use record::Estimate;

const BLOCKS: usize = 20;

/// Sums over 20 consecutive blocks of rows, for any number of statistics.
pub(crate) struct Blocks<const K: usize> {
    sums: [[f64; K]; BLOCKS],
    rows: usize,
}

impl<const K: usize> Blocks<K> {
    /// Of `count` rows in order of time.
    pub(crate) fn of(count: usize, rows: impl Iterator<Item = [f64; K]>) -> Blocks<K> {
        let mut out = Blocks { sums: [[0.0; K]; BLOCKS], rows: count };
        for (i, row) in rows.take(count).enumerate() {
            let sums = &mut out.sums[i * BLOCKS / count];
            sums.iter_mut().zip(row).for_each(|(s, x)| *s += x);
        }
        out
    }

    /// A function of the sums, with its standard uncertainty from a delete-one-block jackknife (Künsch 1989): honest as
    /// long as the correlation is short against a twentieth of the record. `None` without rows or where the function is
    /// not finite; no uncertainty with fewer than 40 rows.
    pub(crate) fn estimate(&self, of: impl Fn([f64; K]) -> f64) -> Option<Estimate> {
        let total: [f64; K] = std::array::from_fn(|k| self.sums.iter().map(|s| s[k]).sum());
        let value = Some(of(total)).filter(|v| self.rows > 0 && v.is_finite())?;
        if self.rows < 2 * BLOCKS {
            return Some(Estimate { value, standard_uncertainty: None });
        }
        let without = self.sums.map(|part| of(std::array::from_fn(|k| total[k] - part[k])));
        let mean = without.iter().sum::<f64>() / BLOCKS as f64;
        let spread: f64 = without.iter().map(|w| (w - mean).powi(2)).sum();
        let u = (spread * (BLOCKS - 1) as f64 / BLOCKS as f64).sqrt();
        Some(Estimate { value, standard_uncertainty: Some(u).filter(|u| u.is_finite()) })
    }
}

/// [`Blocks::estimate`] of rows at hand.
pub(crate) fn jackknife<const K: usize>(rows: &[[f64; K]], of: impl Fn([f64; K]) -> f64) -> Option<Estimate> {
    Blocks::of(rows.len(), rows.iter().copied()).estimate(of)
}

/// Mean of values.
pub(crate) fn mean(values: &[f64]) -> Option<Estimate> {
    Blocks::of(values.len(), values.iter().map(|x| [*x, 1.0])).estimate(|[x, n]| x / n)
}

/// Root mean square of values.
pub(crate) fn rms(values: &[f64]) -> Option<Estimate> {
    Blocks::of(values.len(), values.iter().map(|x| [x * x, 1.0])).estimate(root_mean)
}

/// Root of a mean square from its sum and count.
pub(crate) fn root_mean([xx, n]: [f64; 2]) -> f64 {
    (xx.max(0.0) / n).sqrt()
}

/// Quantiles of values as [`signal::percentile_of_sorted`] has them, without sorting all; `shares` rise. Empty without
/// values.
pub(crate) fn percentiles(values: &mut [f64], shares: &[f64]) -> Vec<f64> {
    let Some(last) = values.len().checked_sub(1) else { return vec![] };
    let mut end = values.len();
    let mut out: Vec<f64> = shares
        .iter()
        .rev()
        .map(|share| {
            let position = share.clamp(0.0, 1.0) * last as f64;
            let below = position.floor() as usize;
            // What is above was put aside by the quantile before.
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

#[cfg(test)]
mod tests {
    use super::*;

    /// The mean of white noise is known to σ/√n, that of noise held for k rows to √k times as much.
    #[test]
    fn correlated_rows_are_known_less_well_than_as_many_independent_ones() {
        let mut state = 1_u64;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        let sigma = 12.0_f64.sqrt().recip();
        let (mut white, mut held) = (0.0, 0.0);
        let trials = 100;
        for _ in 0..trials {
            let values: Vec<f64> = (0..400).map(|_| uniform()).collect();
            let u = |e: Option<Estimate>| e.unwrap().standard_uncertainty.unwrap();
            white += u(mean(&values)).powi(2) / f64::from(trials);
            held += u(mean(&values.iter().flat_map(|x| [*x; 10]).collect::<Vec<f64>>())).powi(2) / f64::from(trials);
        }
        // 19 degrees of freedom and 100 trials: the variance is known to √(2/1900) = 3.2 %; gate at 4 σ.
        let truth = sigma * sigma / 400.0;
        assert!((white / truth - 1.0).abs() < 0.13 && (held / truth - 1.0).abs() < 0.13, "{white} {held} {truth}");
    }

    #[test]
    fn quantiles_are_those_of_the_sorted_values() {
        let mut values: Vec<f64> = (0..1000).map(|k| f64::from((k * 7919) % 1009)).collect();
        let shares = [0.0, 0.5, 0.5, 0.68, 0.95, 0.9501, 0.99, 1.0];
        let found = percentiles(&mut values.clone(), &shares);
        values.sort_unstable_by(f64::total_cmp);
        let expected: Vec<f64> = shares.iter().map(|s| signal::percentile_of_sorted(&values, *s).unwrap()).collect();
        assert_eq!(found, expected);
        assert_eq!(percentiles(&mut [7.0], &[0.0, 1.0]), [7.0, 7.0]);
        assert!(percentiles(&mut [], &[0.5]).is_empty());
    }

    #[test]
    fn without_rows_there_is_no_number() {
        assert_eq!(mean(&[]), None);
        assert_eq!(rms(&[3.0, 4.0]), Some(Estimate { value: 12.5_f64.sqrt(), standard_uncertainty: None }));
    }
}
