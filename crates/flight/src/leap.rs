//! Leap seconds, and the conversion from GPS time to UTC. The only place that counts leap seconds.
//!
//! Source: IERS Bulletin C, as the time-zone database carries it (`leap-seconds.list`).

use crate::time::{Clock, NANOS_PER_SECOND, Stamp};

/// 1980-01-06, the epoch of GPS time, as Unix counts, s.
pub const GPS_EPOCH_UNIX_S: i64 = 315_964_800;
/// Seconds in a GPS week.
pub const WEEK_S: i64 = 604_800;
/// TAI is always ahead of GPS time by this much, s.
pub const TAI_LESS_GPS_S: i64 = 19;

/// The midnights (UTC, as Unix counts, s) before which a leap second was inserted, since the GPS epoch.
/// From the n-th on, counted from 1, GPS time is n seconds ahead of UTC.
const LEAPS_UNIX_S: [i64; 18] = [
    362_793_600,   // 1981-07-01
    394_329_600,   // 1982-07-01
    425_865_600,   // 1983-07-01
    489_024_000,   // 1985-07-01
    567_993_600,   // 1988-01-01
    631_152_000,   // 1990-01-01
    662_688_000,   // 1991-01-01
    709_948_800,   // 1992-07-01
    741_484_800,   // 1993-07-01
    773_020_800,   // 1994-07-01
    820_454_400,   // 1996-01-01
    867_715_200,   // 1997-07-01
    915_148_800,   // 1999-01-01
    1_136_073_600, // 2006-01-01
    1_230_768_000, // 2009-01-01
    1_341_100_800, // 2012-07-01
    1_435_708_800, // 2015-07-01
    1_483_228_800, // 2017-01-01
];

/// The table is known to be complete until this instant, as a Unix count, s: expiry of the list as of July 2026.
const KNOWN_UNTIL_UNIX_S: i64 = 1_814_140_800;

/// The day until which the table is known to be complete, for people.
pub const LEAPS_KNOWN_UNTIL: &str = "2027-06-28";

/// How far GPS time is ahead of UTC at an instant of UTC, s.
///
/// Before 1980 there is no GPS time and the answer is 0; after [`LEAPS_KNOWN_UNTIL`] it is the last one known.
#[must_use]
pub fn gps_ahead_of_utc_s(unix: Stamp) -> i64 {
    let second = unix.0.div_euclid(NANOS_PER_SECOND);
    LEAPS_UNIX_S.partition_point(|&leap| leap <= second) as i64
}

/// Whether the table is known to be complete at an instant of UTC.
#[must_use]
pub fn leaps_are_known_at(unix: Stamp) -> bool {
    unix.0.div_euclid(NANOS_PER_SECOND) < KNOWN_UNTIL_UNIX_S
}

/// UTC of GPS time, as a Unix count. A leap second counts as the second after it, as in POSIX, so the two share
/// a number; everywhere else [`gps_of_unix`] is the exact inverse. `None` outside the range of `i64`.
#[must_use]
pub fn unix_of_gps(gps: Stamp) -> Option<Stamp> {
    let second = gps.0.div_euclid(NANOS_PER_SECOND);
    // During the leap second the old offset still applies: it ends where the new one starts.
    let begins = |index: usize, leap: i64| leap - GPS_EPOCH_UNIX_S + index as i64 + 1;
    let ahead = LEAPS_UNIX_S.iter().enumerate().take_while(|&(i, &leap)| begins(i, leap) <= second).count() as i64;
    gps.0.checked_add((GPS_EPOCH_UNIX_S - ahead) * NANOS_PER_SECOND).map(Stamp)
}

/// GPS time of UTC given as a Unix count. `None` outside the range of `i64`.
#[must_use]
pub fn gps_of_unix(unix: Stamp) -> Option<Stamp> {
    unix.0.checked_sub((GPS_EPOCH_UNIX_S - gps_ahead_of_utc_s(unix)) * NANOS_PER_SECOND).map(Stamp)
}

impl Clock {
    /// UTC of a timestamp of this clock, as a Unix count; `None` for clocks without a date.
    #[must_use]
    pub fn unix(self, stamp: Stamp) -> Option<Stamp> {
        match self {
            Clock::Unix => Some(stamp),
            Clock::Gps => unix_of_gps(stamp),
            Clock::Boot | Clock::Elapsed => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: i64 = NANOS_PER_SECOND;

    #[test]
    fn gps_seconds_convert_to_the_utc_of_other_tools() {
        // GPS 1 450 000 000 s is 2025-12-17 09:46:22 UTC (hifitime; date -u -d '2025-12-17 09:46:22' +%s).
        assert_eq!(unix_of_gps(Stamp(1_450_000_000 * S)), Some(Stamp(1_765_964_782 * S)));
        // GPS 0 is its epoch; 1 000 000 000 s is 2011-09-14 01:46:25 UTC, 15 leap seconds ahead.
        assert_eq!(unix_of_gps(Stamp(0)), Some(Stamp(GPS_EPOCH_UNIX_S * S)));
        assert_eq!(unix_of_gps(Stamp(1_000_000_000 * S)), Some(Stamp(1_315_964_785 * S)));
    }

    #[test]
    fn around_every_leap_second_gps_time_runs_on_and_utc_repeats_one_second() {
        for (index, &midnight) in LEAPS_UNIX_S.iter().enumerate() {
            let before = index as i64;
            let gps = |utc: i64, ahead: i64| Stamp((utc - GPS_EPOCH_UNIX_S + ahead) * S + 250_000_000);
            let utc = |second: i64| Some(Stamp(second * S + 250_000_000));
            // 23:59:59, then 23:59:60, which Unix counts as the second after, then 00:00:00, then 00:00:01.
            assert_eq!(unix_of_gps(gps(midnight - 1, before)), utc(midnight - 1));
            assert_eq!(unix_of_gps(gps(midnight, before)), utc(midnight));
            assert_eq!(unix_of_gps(gps(midnight, before + 1)), utc(midnight));
            assert_eq!(unix_of_gps(gps(midnight + 1, before + 1)), utc(midnight + 1));
            for second in [midnight - 1, midnight, midnight + 1] {
                let unix = Stamp(second * S + 250_000_000);
                assert_eq!(unix_of_gps(gps_of_unix(unix).unwrap()), Some(unix));
            }
            assert_eq!(gps_ahead_of_utc_s(Stamp(midnight * S - 1)), before);
            assert_eq!(gps_ahead_of_utc_s(Stamp(midnight * S)), before + 1);
        }
    }

    #[test]
    fn every_leap_second_precedes_a_first_of_january_or_july() {
        // Days since 1970 of a civil date (H. Hinnant's days_from_civil, in its simplest form).
        let days = |year: i64, july: bool| {
            let leap = |y: i64| (y % 4 == 0 && y % 100 != 0) || y % 400 == 0;
            let to_year: i64 = (1970..year).map(|y| if leap(y) { 366 } else { 365 }).sum();
            to_year + if july { 181 + i64::from(leap(year)) } else { 0 }
        };
        let known: Vec<i64> =
            (1981..2018).flat_map(|y| [days(y, false), days(y, true)]).map(|day| day * 86_400).collect();
        assert!(LEAPS_UNIX_S.iter().all(|leap| known.contains(leap)));
        assert!(LEAPS_UNIX_S.windows(2).all(|pair| pair[0] < pair[1]));
        assert!(!leaps_are_known_at(Stamp(i64::MAX)) && leaps_are_known_at(Stamp(1_750_000_000 * S)));
    }

    #[test]
    fn clocks_without_a_date_have_no_utc_and_extremes_do_not_overflow() {
        assert_eq!(Clock::Boot.unix(Stamp(1)), None);
        assert_eq!(Clock::Unix.unix(Stamp(1)), Some(Stamp(1)));
        assert_eq!(Clock::Gps.unix(Stamp(i64::MAX)), None);
        assert_eq!(gps_of_unix(Stamp(i64::MIN)), None);
    }
}
