//! Statistics of rows that are correlated in time, with a standard uncertainty that allows for it.

use record::Estimate;

const BLOCKS: usize = 20;

/// A function of sums over rows, with its standard uncertainty from a delete-one-block jackknife over 20 consecutive
/// blocks (Künsch 1989): honest as long as the correlation is short against a twentieth of the record. `None` without
/// rows or where the function is not finite; no uncertainty with fewer than 40 rows.
pub(crate) fn jackknife<const K: usize>(rows: &[[f64; K]], of: impl Fn([f64; K]) -> f64) -> Option<Estimate> {
    let sum = |rows: &[[f64; K]]| {
        rows.iter().fold([0.0; K], |mut sum, row| {
            sum.iter_mut().zip(row).for_each(|(s, x)| *s += x);
            sum
        })
    };
    let n = rows.len();
    let total = sum(rows);
    let value = Some(of(total)).filter(|v| n > 0 && v.is_finite())?;
    if n < 2 * BLOCKS {
        return Some(Estimate { value, standard_uncertainty: None });
    }
    let without: Vec<f64> = (0..BLOCKS)
        .map(|b| {
            let part = sum(&rows[b * n / BLOCKS..(b + 1) * n / BLOCKS]);
            of(std::array::from_fn(|k| total[k] - part[k]))
        })
        .collect();
    let mean = without.iter().sum::<f64>() / BLOCKS as f64;
    let spread: f64 = without.iter().map(|w| (w - mean).powi(2)).sum();
    let u = (spread * (BLOCKS - 1) as f64 / BLOCKS as f64).sqrt();
    Some(Estimate { value, standard_uncertainty: Some(u).filter(|u| u.is_finite()) })
}

/// Mean of values.
pub(crate) fn mean(values: impl Iterator<Item = f64>) -> Option<Estimate> {
    let rows: Vec<[f64; 2]> = values.map(|x| [x, 1.0]).collect();
    jackknife(&rows, |[x, n]| x / n)
}

/// Root mean square of values.
pub(crate) fn rms(values: impl Iterator<Item = f64>) -> Option<Estimate> {
    let rows: Vec<[f64; 2]> = values.map(|x| [x * x, 1.0]).collect();
    jackknife(&rows, |[xx, n]| (xx.max(0.0) / n).sqrt())
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
            white += u(mean(values.iter().copied())).powi(2) / f64::from(trials);
            held += u(mean(values.iter().flat_map(|x| [*x; 10]))).powi(2) / f64::from(trials);
        }
        // 19 degrees of freedom and 100 trials: the variance is known to √(2/1900) = 3.2 %; gate at 4 σ.
        let truth = sigma * sigma / 400.0;
        assert!((white / truth - 1.0).abs() < 0.13 && (held / truth - 1.0).abs() < 0.13, "{white} {held} {truth}");
    }

    #[test]
    fn without_rows_there_is_no_number() {
        assert_eq!(mean(std::iter::empty()), None);
        assert_eq!(rms([3.0, 4.0].into_iter()), Some(Estimate { value: 12.5_f64.sqrt(), standard_uncertainty: None }));
    }
}
