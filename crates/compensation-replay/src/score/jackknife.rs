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

#[cfg(test)]
mod tests {
    use super::*;

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
