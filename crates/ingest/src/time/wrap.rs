//! Counts that begin anew: 32 bits of microseconds after 71.6 minutes, of milliseconds after 49.7 days; 16 bits of
//! milliseconds after a minute; a time of week on Sunday, a time of day at midnight.

use crate::values::Values;
use flight::NANOS_PER_SECOND;

/// Across the end of the count, stamps follow one another within this time, or a quarter of the count; a longer step is a new
/// start of the device, which cannot be told from a wrap with a hole.
const CLOSE_NS: i64 = 60 * NANOS_PER_SECOND;
/// Of so many stamps one may lie beyond the count: it is a wrong one, and left as it stands.
pub(crate) const TOLERATED: usize = 100;

/// Makes the stamps of a count from 0 to `range`, ns, run on where it begins anew, and says how often it did; stamps in
/// the order of the log.
///
/// The log must show the wrap: a step back by nearly the whole range. One that stays below is taken as it stands.
pub(crate) fn unwrap(stamps: &mut Values<i64>, range: i64) -> u64 {
    let counts = |s: &i64| (0..range).contains(s);
    let (all, beyond) = stamps.given().fold((0, 0), |(all, n), s| (all + 1, n + usize::from(!counts(&s))));
    if TOLERATED * beyond > all {
        return 0;
    }
    let close = CLOSE_NS.min(range / 4);
    let (mut wraps, mut most, mut before) = (0_i64, 0, None);
    for stamp in stamps.given_mut().filter(|s| counts(s)) {
        let raw = *stamp;
        // Forward across the end, or back again for a row that came late.
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

    /// 32 bits of ticks.
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
    fn microseconds_and_milliseconds_run_on_across_the_end_of_32_bits() {
        for (tick, step) in [(MICRO, 200_000), (MILLI, 200)] {
            let (truth, mut stamps) = wrapped((1 << 32) - 10 * step, step, 50, tick);
            assert_eq!(unwrap(&mut stamps, tick), 1);
            assert_eq!(stamps, truth);
        }
    }

    #[test]
    fn a_time_of_week_and_a_time_of_day_run_on_across_their_end() {
        for range_s in [604_800, 86_400] {
            let truth: Vec<Option<i64>> = (0..40).map(|i| Some((range_s - 4) * S + i * S / 5)).collect();
            let mut stamps: Vec<Option<i64>> = truth.iter().map(|s| s.map(|s| s % (range_s * S))).collect();
            assert_eq!(unwrap_range(&mut stamps, range_s * S), 1);
            assert_eq!(stamps, truth);
        }
    }

    #[test]
    fn every_wrap_of_a_long_log_is_counted_and_a_late_row_across_one_is_in_its_place() {
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
    fn a_counter_of_16_bits_runs_on_over_many_ends_and_gaps_of_a_quarter_of_it() {
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
    fn one_wrong_stamp_in_a_hundred_does_not_keep_a_count_from_running_on() {
        let (mut truth, mut stamps) = wrapped((1 << 32) - 100 * 200, 200, 200, MILLI);
        for (at, wrong) in [(30, -1), (150, i64::MAX)] {
            (truth[at], stamps[at]) = (Some(wrong), Some(wrong));
        }
        assert_eq!(unwrap(&mut stamps, MILLI), 1);
        assert_eq!(stamps, truth);
    }

    #[test]
    fn a_device_that_starts_anew_and_a_wider_counter_are_left_alone() {
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
