//! Statistics of rows that are correlated in time, with a standard uncertainty that accounts for it.

use record::Estimate;
use signal::{BlockEstimate, BlockSums};

/// Sums over consecutive blocks of rows, for any number of statistics, as in [`BlockSums`].
pub(crate) struct Blocks<const K: usize>(BlockSums<K>);

impl<const K: usize> Blocks<K> {
    /// From `count` rows in order of time.
    pub(crate) fn of(count: usize, rows: impl Iterator<Item = [f64; K]>) -> Blocks<K> {
        Blocks(BlockSums::of(count, rows))
    }

    /// A function of the sums, with its standard uncertainty, which is missing if the record is too short for the
    /// correlation time of its errors. `None` without rows or if the function is not finite.
    pub(crate) fn estimate(&self, of: impl Fn([f64; K]) -> f64) -> Option<Estimate> {
        self.0.estimate(of).map(recorded)
    }

    /// The same for a root mean square or another magnitude.
    pub(crate) fn size(&self, of: impl Fn([f64; K]) -> f64) -> Option<Estimate> {
        self.0.estimate_size(of).map(recorded)
    }
}

pub(crate) fn recorded(found: BlockEstimate) -> Estimate {
    Estimate { value: found.value, standard_uncertainty: found.standard_uncertainty }
}

/// [`Blocks::estimate`] for rows in memory.
pub(crate) fn jackknife<const K: usize>(rows: &[[f64; K]], of: impl Fn([f64; K]) -> f64) -> Option<Estimate> {
    Blocks::of(rows.len(), rows.iter().copied()).estimate(of)
}

/// Mean of values.
pub(crate) fn mean(values: &[f64]) -> Option<Estimate> {
    Blocks::of(values.len(), values.iter().map(|x| [*x, 1.0])).estimate(|[x, n]| x / n)
}

/// Root mean square of values.
pub(crate) fn rms(values: &[f64]) -> Option<Estimate> {
    Blocks::of(values.len(), values.iter().map(|x| [x * x, 1.0])).size(root_mean)
}

/// Root of a mean square from its sum and count.
pub(crate) fn root_mean([xx, n]: [f64; 2]) -> f64 {
    (xx.max(0.0) / n).sqrt()
}

/// Quantiles of values as in [`signal::percentile_of_sorted`], without sorting all; `shares` rise. Empty without
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_match_those_of_sorted_values() {
        let mut values: Vec<f64> = (0..1000).map(|k| f64::from((k * 7919) % 1009)).collect();
        let shares = [0.0, 0.5, 0.5, 0.68, 0.95, 0.9501, 0.99, 1.0];
        let found = percentiles(&mut values.clone(), &shares);
        values.sort_unstable_by(f64::total_cmp);
        let expected: Vec<f64> = shares.iter().map(|s| signal::percentile_of_sorted(&values, *s).unwrap()).collect();
        assert_eq!(found, expected);
        assert_eq!(percentiles(&mut [7.0], &[0.0, 1.0]), [7.0, 7.0]);
        assert!(percentiles(&mut [], &[0.5]).is_empty());
    }

    /// An error that changes once in the flight counts as two errors, however many rows it has.
    #[test]
    fn a_nearly_constant_error_has_no_uncertainty() {
        let step = |low: f64, high: f64| (0..900).map(|k| if k < 450 { low } else { high }).collect::<Vec<f64>>();
        assert_eq!(rms(&step(1.0, 3.0)), Some(Estimate { value: 5.0_f64.sqrt(), standard_uncertainty: None }));
        assert_eq!(mean(&step(1.0, 3.0)), Some(Estimate { value: 2.0, standard_uncertainty: None }));
    }

    #[test]
    fn no_rows_give_no_number() {
        assert_eq!(mean(&[]), None);
        assert_eq!(rms(&[3.0, 4.0]), Some(Estimate { value: 12.5_f64.sqrt(), standard_uncertainty: None }));
    }
}
