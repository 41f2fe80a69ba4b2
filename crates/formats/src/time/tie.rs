//! Ties a clock since boot to UTC, from messages that state both.

use crate::stamps::distribution;
use flight::{Clock, NANOS_PER_SECOND, UtcTie};

/// Pairs further than this from their median are ignored, ns.
const OUTLIER_NS: u64 = NANOS_PER_SECOND as u64;

/// Ties a clock to UTC from pairs of its timestamp and UTC, both ns; `None` without a pair.
///
/// Uses the median of the differences, and their spread; pairs more than a second off are counted and skipped. A
/// receiver's message is late by its own delay, so the tie is early by as much: usually 0.1 to 0.3 s. That is good
/// enough for a date and a displayed time, and it is used for nothing else.
pub fn tie(clock: Clock, source: String, pairs: &[(i64, i64)]) -> Option<UtcTie> {
    let mut offsets: Vec<i64> = pairs.iter().filter_map(|(stamp, utc)| utc.checked_sub(*stamp)).collect();
    offsets.sort_unstable();
    let offset_ns = *offsets.get(offsets.len() / 2)?;
    let all = offsets.len();
    offsets.retain(|o| o.abs_diff(offset_ns) <= OUTLIER_NS);
    let off: Vec<f64> = offsets.iter().map(|o| (o - offset_ns) as f64 / NANOS_PER_SECOND as f64).collect();
    let outliers = (all - offsets.len()) as u64;
    Some(UtcTie { clock, source, offset_ns, spread_s: distribution(&off)?, pairs: offsets.len() as u64, outliers })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clock_is_tied_by_the_median_and_outliers_are_counted() {
        let boot = |i: i64| i * 200_000_000;
        let utc = |i: i64| 1_700_000_000_000_000_000 + boot(i) - 1_000_000 * (100 + i % 5);
        let mut pairs: Vec<(i64, i64)> = (0..101).map(|i| (boot(i), utc(i))).collect();
        pairs[7].1 -= 604_800 * NANOS_PER_SECOND;
        pairs[8].1 = i64::MIN;
        let tie = tie(Clock::Boot, "gps".into(), &pairs).unwrap();
        assert_eq!(tie.offset_ns, 1_700_000_000_000_000_000 - 102_000_000);
        assert_eq!((tie.pairs, tie.outliers), (99, 1));
        assert_eq!((tie.spread_s.min, tie.spread_s.max), (-0.002, 0.002));
    }

    #[test]
    fn without_a_pair_there_is_no_tie() {
        assert_eq!(tie(Clock::Boot, String::new(), &[]), None);
    }
}
