//! Statistics of rows that are correlated in time, with an uncertainty that allows for it.

use crate::distributions::student_quantile;
use std::f64::consts::PI;

/// Rows are summed into at most this many bins; blocks are made of whole bins.
const BINS: usize = 240;
/// Numbers of blocks to try, finest first.
const BLOCKS: [usize; 5] = [20, 16, 12, 10, 8];
/// Minimum number of rows for an uncertainty.
const LEAST_ROWS: usize = 40;
/// A block is at least this many integrated correlation times long. The remaining correlation between neighbours lowers
/// the variance by an eighth, which [`shared`] corrects.
const TIMES: f64 = 4.0;
/// Neighbouring blocks that correlate by more than this are not independent.
const MOST_SHARED: f64 = 0.3;
/// Number of cosines used for the slow part; the slowest has half a period in the record.
const COSINES: usize = 8;

/// A number and its standard uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BlockEstimate {
    /// The statistic of all rows.
    pub value: f64,
    /// Half of the half width of its 95 % interval, so that `value ± 2u` is that interval. `None` if the record has
    /// fewer than 8 independent blocks, or if a few rows hold most of a magnitude.
    pub standard_uncertainty: Option<f64>,
}

/// Sums over consecutive bins of rows, for any number of statistics.
///
/// The uncertainty of a statistic is a delete-one-block jackknife (Künsch 1989). The block length follows from the
/// integrated autocorrelation time of the contributions of the bins (sum of the initial positive sequence, Geyer 1992):
/// four of them or more. Blocks whose neighbours still correlate are made longer (batch means, Fishman 1978). The
/// remaining correlation widens the variance by `(1 + ρ)/(1 − ρ)`, and it is never below what the eight slowest cosines
/// of the record show (Lazarus, Lewis, Stock and Watson 2018). The interval uses Student's quantile for the number of
/// blocks less one. With fewer than 8 blocks there is no uncertainty.
#[derive(Debug, Clone)]
pub struct BlockSums<const K: usize> {
    bins: Vec<[f64; K]>,
    rows: usize,
}

impl<const K: usize> BlockSums<K> {
    /// From `count` rows in time order.
    #[must_use]
    pub fn of(count: usize, rows: impl Iterator<Item = [f64; K]>) -> BlockSums<K> {
        let bins = count.min(BINS);
        let mut out = BlockSums { bins: vec![[0.0; K]; bins], rows: count };
        for (i, row) in rows.take(count).enumerate() {
            if let Some(sums) = out.bins.get_mut(i * bins / count) {
                sums.iter_mut().zip(row).for_each(|(s, x)| *s += x);
            }
        }
        out
    }

    /// A function of the sums of all rows. `None` without rows or if the result is not finite.
    pub fn estimate(&self, of: impl Fn([f64; K]) -> f64) -> Option<BlockEstimate> {
        let total = sum(&self.bins);
        let value = Some(of(total)).filter(|v| self.rows > 0 && v.is_finite())?;
        let standard_uncertainty = self.half_width(total, value, of).map(|half| 0.5 * half);
        Some(BlockEstimate { value, standard_uncertainty })
    }

    /// As [`BlockSums::estimate`], for a magnitude (a root mean square), whose logarithm is nearly normal. The interval
    /// reaches as far up as that of the logarithm, and as far down. A few rows that hold most of the sum give an interval
    /// that reaches zero: then the uncertainty is unknown.
    pub fn estimate_size(&self, of: impl Fn([f64; K]) -> f64) -> Option<BlockEstimate> {
        let plain = self.estimate(of)?;
        let upwards = |u: f64| if plain.value > 0.0 { 0.5 * plain.value * (2.0 * u / plain.value).exp_m1() } else { u };
        let is_usable = |u: &f64| plain.value <= 0.0 || 2.0 * u < plain.value;
        let standard_uncertainty = plain.standard_uncertainty.filter(is_usable).map(upwards).filter(|u| u.is_finite());
        Some(BlockEstimate { standard_uncertainty, ..plain })
    }

    /// Half width of the 95 % interval.
    fn half_width(&self, total: [f64; K], value: f64, of: impl Fn([f64; K]) -> f64) -> Option<f64> {
        if self.rows < LEAST_ROWS {
            return None;
        }
        let without = |part: [f64; K]| of(std::array::from_fn(|k| total[k] - part[k]));
        // Contribution of each bin, to first order.
        let shares: Vec<f64> = self.bins.iter().map(|bin| value - without(*bin)).collect();
        if !shares.iter().all(|s| s.is_finite()) {
            return None;
        }
        let shares = centred(&shares);
        let most = shares.len() as f64 / (TIMES * correlation_time(&shares));
        let independent = |blocks: usize| {
            let shared = shared(&shares, blocks);
            (blocks as f64 <= most && shared <= MOST_SHARED).then_some((blocks, shared))
        };
        let (blocks, shared) = BLOCKS.into_iter().find_map(independent)?;
        let deleted: Vec<f64> = cut(&self.bins, blocks).map(|block| without(sum(block))).collect();
        let n = blocks as f64;
        let jackknife = centred(&deleted).iter().map(|d| d * d).sum::<f64>() * (n - 1.0) / n;
        let variance = (jackknife * (1.0 + shared) / (1.0 - shared)).max(slow_variance(&shares));
        Some(student_quantile(0.975, n - 1.0) * variance.sqrt()).filter(|half| half.is_finite())
    }
}

fn sum<const K: usize>(parts: &[[f64; K]]) -> [f64; K] {
    parts.iter().fold([0.0; K], |sum, part| std::array::from_fn(|k| sum[k] + part[k]))
}

/// Consecutive parts of equal length, within one.
fn cut<T>(all: &[T], parts: usize) -> impl Iterator<Item = &[T]> {
    (0..parts).map(move |p| &all[p * all.len() / parts..(p + 1) * all.len() / parts])
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

fn centred(values: &[f64]) -> Vec<f64> {
    let mean = mean(values);
    values.iter().map(|v| v - mean).collect()
}

/// Sum of the autocorrelation over all lags, in bins: at least 1. Pairs of lags are added until one is not positive,
/// each capped at the previous one (Geyer's initial monotone sequence). The share removed with the mean is added back.
fn correlation_time(shares: &[f64]) -> f64 {
    let n = shares.len();
    let lagged = |lag: usize| {
        let products = shares.iter().zip(shares.iter().skip(lag)).map(|(a, b)| a * b);
        products.sum::<f64>() / (n - lag) as f64
    };
    let power = lagged(0);
    if power <= 0.0 {
        return 1.0;
    }
    let first = (lagged(1) / power).max(0.0);
    let mut time = 1.0 + 2.0 * first;
    let mut last = f64::INFINITY;
    let mut lag = 2;
    while first > 0.0 && lag + 1 < n / 2 {
        let pair = ((lagged(lag) + lagged(lag + 1)) / power).min(last);
        if pair <= 0.0 {
            break;
        }
        time += 2.0 * pair;
        last = pair;
        lag += 2;
    }
    time / (1.0 - time / n as f64).max(0.2)
}

/// Correlation of neighbouring blocks, 0 to 0.8, corrected for its bias of −1/blocks.
fn shared(shares: &[f64], blocks: usize) -> f64 {
    let means: Vec<f64> = cut(shares, blocks).map(mean).collect();
    let means = centred(&means);
    let power: f64 = means.iter().map(|m| m * m).sum();
    let product: f64 = means.windows(2).map(|pair| pair[0] * pair[1]).sum();
    if power > 0.0 { (product / power + 1.0 / blocks as f64).clamp(0.0, 0.8) } else { 0.0 }
}

/// Variance of the sum of all contributions, from the power in the slowest cosines.
fn slow_variance(shares: &[f64]) -> f64 {
    let n = shares.len() as f64;
    let power = |j: usize| {
        let turn = PI * j as f64 / n;
        let amplitude: f64 = shares.iter().enumerate().map(|(i, s)| s * (turn * (i as f64 + 0.5)).cos()).sum();
        2.0 * amplitude * amplitude
    };
    (1..=COSINES).map(power).sum::<f64>() / COSINES as f64
}

#[cfg(test)]
mod tests;
