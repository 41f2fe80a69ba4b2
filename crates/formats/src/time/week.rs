//! GPS weeks: ten-bit counters, and epochs a week off.

use crate::values::Values;
use flight::{NANOS_PER_SECOND, WEEK_S};

/// A ten-bit week counter wraps around after this many weeks.
const ROLLOVER: i64 = 1024;
/// The last week that a ten-bit counter can mean: about a year after this release, which was made in week 2445
/// (November 2026). The number is fixed, so that a log means the same tomorrow.
const LATEST: i64 = 2497;
/// The last valid week: in 2248, because nanoseconds since 1970 in 64 bits end in 2262.
const LAST: i64 = 14_000;
/// Epochs this close to a week off are a receiver glitch, ns.
const NEAR_NS: u64 = 3600 * NANOS_PER_SECOND as u64;
const WEEK_NS: i64 = WEEK_S * NANOS_PER_SECOND;

/// A GPS week as logged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Week {
    /// The true week.
    Full(i64),
    /// A ten-bit week, resolved by [`WeekCount`].
    TenBit(i64),
}

impl Week {
    /// Nanoseconds of GPS time at its start.
    pub fn start_ns(self) -> i64 {
        let (Week::Full(week) | Week::TenBit(week)) = self;
        week * WEEK_NS
    }
}

/// How the weeks of a log are counted, inferred from all of them together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WeekCount {
    /// No week is above 1023.
    ten_bit: bool,
    /// A week is 1023, so that 0 may follow.
    ends: bool,
    /// The last week that a ten-bit counter can mean.
    latest: i64,
}

impl WeekCount {
    /// Weeks that are all below 1024 come from a ten-bit counter, because no log that we read is from before 1999.
    /// `logged` is the week in which the log was written according to another of its clocks, if there is one.
    pub fn of(weeks: impl Iterator<Item = i64>, logged: Option<i64>) -> WeekCount {
        let latest = logged.map_or(LATEST, |week| week + ROLLOVER / 2);
        let mut count = WeekCount { ten_bit: true, ends: false, latest };
        for week in weeks {
            count.ten_bit &= week < ROLLOVER;
            count.ends |= week == ROLLOVER - 1;
        }
        count
    }

    /// Resolves a week: of those that a ten-bit counter can mean, the one nearest to the log's own date; without such a
    /// date, the one among the 1024 that end about a year after this release.
    ///
    /// Receivers without a fix leave the field at week 0. It starts a ten-bit count only where the log also has week
    /// 1023. Otherwise, and for invalid weeks, the result is `None`.
    pub fn week(self, week: i64) -> Option<Week> {
        match week {
            0 if !(self.ten_bit && self.ends) => None,
            0..=LAST if self.ten_bit => Some(Week::TenBit(self.latest - (self.latest - week).rem_euclid(ROLLOVER))),
            0..=LAST => Some(Week::Full(week)),
            _ => None,
        }
    }
}

/// How many ten-bit wraps a week is early if it cannot be before `first`; `None` if it is not before, or if no number
/// of wraps makes it a week that a counter can mean.
pub(crate) fn counts_early(week: i64, first: i64) -> Option<i64> {
    let counts = (first - week + ROLLOVER - 1).div_euclid(ROLLOVER);
    (counts > 0 && week + counts * ROLLOVER <= LATEST).then_some(counts)
}

/// Weeks in this many ten-bit wraps.
pub(crate) fn weeks_of(counts: i64) -> i64 {
    counts * ROLLOVER
}

/// Corrects epochs that are a week off, and returns how many. At midnight from Saturday to Sunday a receiver may give
/// the new time of week with the old week, or vice versa, for some epochs (ArduPilot#31914). The week of most epochs is
/// the right one; of two equally frequent ones the later.
pub fn redate_weeks(stamps: &mut Values<i64>) -> u64 {
    // Whole weeks to add to each stamp so that none steps by a week from the one before.
    let shifts = stamps.given().scan((0_i64, None), |(shift, before), stamp| {
        let step = before.map_or(0, |before: i64| stamp.saturating_sub(before));
        if step.saturating_add(WEEK_NS).unsigned_abs() <= NEAR_NS {
            *shift += 1;
        } else if step.saturating_sub(WEEK_NS).unsigned_abs() <= NEAR_NS {
            *shift -= 1;
        }
        *before = Some(stamp);
        Some(*shift)
    });
    if shifts.clone().all(|shift| shift == 0) {
        return 0;
    }
    let weeks: Vec<i64> = shifts.collect();
    let Some(right) = most_frequent(&weeks) else { return 0 };
    let mut moved = 0;
    for (stamp, weeks) in stamps.given_mut().zip(weeks) {
        if weeks != right {
            moved += 1;
            *stamp = stamp.saturating_add((weeks - right).saturating_mul(WEEK_NS));
        }
    }
    moved
}

/// Of equally frequent ones the smallest: the fewest weeks added, so the latest time.
fn most_frequent(values: &[i64]) -> Option<i64> {
    let mut sorted = values.to_vec();
    sorted.sort_unstable();
    let runs = sorted.chunk_by(|a, b| a == b);
    runs.max_by_key(|run| (run.len(), run.first().map(|v| -v))).and_then(|run| run.first().copied())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn redate_weeks(stamps: &mut [Option<i64>]) -> u64 {
        let mut values = Values::from(stamps.to_vec());
        let moved = super::redate_weeks(&mut values);
        stamps.iter_mut().zip(values.iter()).for_each(|(stamp, value)| *stamp = value);
        moved
    }

    #[test]
    fn a_ten_bit_week_resolves_near_this_release_and_a_full_one_is_kept() {
        let alone = |week| WeekCount::of([week].into_iter(), None).week(week);
        for (week, meant) in [(1023, 2047), (1, 2049), (395, 2443), (449, 2497), (450, 1474)] {
            assert_eq!(alone(week), Some(Week::TenBit(meant)));
        }
        for full in [1024, 2047, 2048, 3071, 3072] {
            assert_eq!(alone(full), Some(Week::Full(full)));
        }
        for none in [-1, 0, 65_536] {
            assert_eq!(alone(none), None);
        }
    }

    #[test]
    fn a_ten_bit_week_resolves_nearest_to_the_date_of_the_log() {
        let near = |logged| WeekCount::of([900].into_iter(), Some(logged)).week(900);
        for (logged, meant) in [(1924, 1924), (1500, 1924), (2400, 1924), (2437, 2948), (3000, 2948), (1411, 900)] {
            assert_eq!(near(logged), Some(Week::TenBit(meant)), "{logged}");
        }
        // A full week is unaffected.
        assert_eq!(WeekCount::of([1924].into_iter(), Some(2900)).week(1924), Some(Week::Full(1924)));
    }

    #[test]
    fn an_impossible_week_is_early_by_whole_ten_bit_wraps() {
        // 2002-09-15, 2022-05-01 and 2012-06-03 are the starts of weeks 1184, 2208 and 1691.
        for (week, first, counts) in [
            (1184, 1691, Some(1)),
            (160, 1691, Some(2)),
            (1690, 1691, None),
            (1691, 1691, None),
            (2208, 1691, None),
            (1473, 1691, Some(1)),
            (1474, 1691, None),
            (1000, 1024, Some(1)),
        ] {
            assert_eq!(counts_early(week, first), counts, "{week}");
        }
    }

    #[test]
    fn time_continues_across_a_wrap_of_the_week_counter() {
        for (before, after) in [(1023, 0), (1023, 1024), (2047, 2048)] {
            let count = WeekCount::of([before, after].into_iter(), None);
            let start = |week| count.week(week).unwrap().start_ns();
            assert_eq!(start(after) - start(before), WEEK_NS, "{before} {after}");
        }
    }

    #[test]
    fn epochs_a_week_early_or_late_are_corrected_and_counted() {
        let good: Vec<Option<i64>> = (0..50).map(|i| Some(2400 * WEEK_NS + i * 200_000_000)).collect();
        for glitch in [0..5, 20..21, 20..25, 45..50] {
            for weeks in [-1, 1] {
                let mut stamps = good.clone();
                stamps[glitch.clone()].iter_mut().flatten().for_each(|s| *s += weeks * WEEK_NS);
                assert_eq!(redate_weeks(&mut stamps), glitch.len() as u64, "{glitch:?} {weeks}");
                assert_eq!(stamps, good, "{glitch:?} {weeks}");
            }
        }
        let mut untouched = good.clone();
        assert_eq!(redate_weeks(&mut untouched), 0);
        assert_eq!(untouched, good);
        assert_eq!(redate_weeks(&mut []), 0);
    }

    #[test]
    fn other_jumps_and_missing_timestamps_are_not_changed() {
        let jumps = [Some(0), Some(WEEK_NS / 2), None, Some(-2 * WEEK_NS), Some(i64::MAX), Some(i64::MIN)];
        let mut stamps = jumps;
        assert_eq!(redate_weeks(&mut stamps), 0);
        assert_eq!(stamps, jumps);
    }
}
