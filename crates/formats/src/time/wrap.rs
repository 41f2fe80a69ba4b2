//! Unwraps counters: 32 bits of microseconds wrap around after 71.6 minutes, of milliseconds after 49.7 days; 16 bits
//! of milliseconds after a minute; a time of week on Sunday, a time of day at midnight.

use crate::values::Values;
use flight::NANOS_PER_SECOND;

/// Across a wrap, successive timestamps are within this time, or a quarter of the range. A longer step is a restart of
/// the device, which cannot be distinguished from a wrap with a hole.
const CLOSE_NS: i64 = 60 * NANOS_PER_SECOND;
/// One of this many timestamps may exceed the range: it is wrong, and not changed.
pub const TOLERATED: usize = 100;

/// Makes the timestamps of a counter from 0 to `range`, ns, continue where it wraps around, and returns how often it
/// did; timestamps in the order of the log.
///
/// The log must show the wrap: a step back by nearly the whole range. A smaller step is not changed.
pub fn unwrap(stamps: &mut Values<i64>, range: i64) -> u64 {
    let counts = |s: &i64| (0..range).contains(s);
    let (all, beyond) = stamps.given().fold((0, 0), |(all, n), s| (all + 1, n + usize::from(!counts(&s))));
    if TOLERATED * beyond > all {
        return 0;
    }
    let close = CLOSE_NS.min(range / 4);
    let (mut wraps, mut most, mut before) = (0_i64, 0, None);
    for stamp in stamps.given_mut().filter(|s| counts(s)) {
        let raw = *stamp;
        // Forward across the wrap, or back again for a row that arrived late.
        let step = before.map_or(0, |before: i64| raw - before);
        if step + range <= close {
            wraps += 1;
        } else if wraps > 0 && range - step <= close {
            wraps -= 1;
        }
        most = most.max(wraps);
        before = Some(raw);
        *stamp = raw.saturating_add(wraps.saturating_mul(range));
    }
    u64::try_from(most).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unwrap_range(stamps: &mut [Option<i64>], range: i64) -> u64 {
        let mut values = Values::from(stamps.to_vec());
        let wraps = super::unwrap(&mut values, range);
        stamps.iter_mut().zip(values.iter()).for_each(|(stamp, value)| *stamp = value);
        wraps
    }

    /// A 32-bit count of ticks.
    fn unwrap(stamps: &mut [Option<i64>], tick: i64) -> u64 {
        unwrap_range(stamps, tick << 32)
    }

    const MICRO: i64 = 1000;
    const MILLI: i64 = 1_000_000;
    const S: i64 = NANOS_PER_SECOND;

    fn wrapped(start: u64, step: u64, count: u64, tick: i64) -> (Vec<Option<i64>>, Vec<Option<i64>>) {
        let truth = |i: u64| (start + i * step) as i64;
        let whole = (0..count).map(|i| Some(truth(i) * tick)).collect();
        (whole, (0..count).map(|i| Some((truth(i) & 0xffff_ffff) * tick)).collect())
    }

    #[test]
    fn microseconds_and_milliseconds_continue_across_a_32_bit_wrap() {
        for (tick, step) in [(MICRO, 200_000), (MILLI, 200)] {
            let (truth, mut stamps) = wrapped((1 << 32) - 10 * step, step, 50, tick);
            assert_eq!(unwrap(&mut stamps, tick), 1);
            assert_eq!(stamps, truth);
        }
    }

    #[test]
    fn a_time_of_week_and_a_time_of_day_continue_across_their_wrap() {
        for range_s in [604_800, 86_400] {
            let truth: Vec<Option<i64>> = (0..40).map(|i| Some((range_s - 4) * S + i * S / 5)).collect();
            let mut stamps: Vec<Option<i64>> = truth.iter().map(|s| s.map(|s| s % (range_s * S))).collect();
            assert_eq!(unwrap_range(&mut stamps, range_s * S), 1);
            assert_eq!(stamps, truth);
        }
    }

    #[test]
    fn every_wrap_is_counted_and_a_late_row_is_placed_before_it() {
        let (truth, mut stamps) = wrapped(0, 20_000_000, 1000, MICRO);
        assert_eq!(unwrap(&mut stamps, MICRO), 4);
        assert_eq!(stamps, truth);
        let (mut truth, mut stamps) = wrapped((1 << 32) - 3, 1, 10, MICRO);
        truth.swap(2, 3);
        stamps.swap(2, 3);
        assert_eq!(unwrap(&mut stamps, MICRO), 1);
        assert_eq!(stamps, truth);
    }

    #[test]
    fn a_16_bit_counter_continues_over_many_wraps_and_quarter_range_gaps() {
        let mut now = 60_000;
        let truth: Vec<Option<i64>> = (0..2000)
            .map(|i| {
                now += if i % 100 == 99 { 15_000 } else { 200 };
                Some(now * MILLI)
            })
            .collect();
        let mut stamps: Vec<Option<i64>> = truth.iter().map(|s| s.map(|s| s % (MILLI << 16))).collect();
        assert_eq!(unwrap_range(&mut stamps, MILLI << 16), (now >> 16) as u64);
        assert_eq!(stamps, truth);
    }

    #[test]
    fn one_wrong_timestamp_in_a_hundred_does_not_prevent_unwrapping() {
        let (mut truth, mut stamps) = wrapped((1 << 32) - 100 * 200, 200, 200, MILLI);
        for (at, wrong) in [(30, -1), (150, i64::MAX)] {
            (truth[at], stamps[at]) = (Some(wrong), Some(wrong));
        }
        assert_eq!(unwrap(&mut stamps, MILLI), 1);
        assert_eq!(stamps, truth);
    }

    #[test]
    fn a_restarted_device_and_a_wider_counter_are_not_unwrapped() {
        let restart = [Some(3_000_000_000 * MICRO), Some(10 * MICRO)];
        let wide = [Some((1 << 33) * MICRO), Some(0)];
        for stamps in [restart, wide] {
            let mut same = stamps;
            assert_eq!(unwrap(&mut same, MICRO), 0);
            assert_eq!(same, stamps);
        }
        assert_eq!(unwrap(&mut [Some(-1), None], MICRO), 0);
    }
}
