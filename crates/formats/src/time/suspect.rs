//! Recognises known mistakes in the offset of two clocks that should agree.

use super::week::{counts_early, weeks_of};
use flight::{Distribution, NANOS_PER_SECOND, Stamp, TAI_LESS_GPS_S, WEEK_S, gps_ahead_of_utc_s, gps_of_unix};
use std::collections::BTreeMap;

/// Tolerance of a whole number of seconds plus a driver's delay.
const SLACK_S: f64 = 0.5;
/// One or two seconds are distinguished from a delay only if they are this exact.
const EXACT_S: f64 = 0.1;
/// Time zones differ by whole quarters of an hour, and at most by this much, s.
const QUARTER_S: f64 = 900.0;
const FARTHEST_ZONE_S: f64 = 14.0 * 3600.0;
const WEEK_NS: i64 = WEEK_S * NANOS_PER_SECOND;

/// The known mistake that explains the offset between two clocks that both claim UTC, if any. `at` is the time of the
/// flight.
pub fn suspicion(offset: &Distribution, at: Stamp) -> Option<String> {
    let leaps = gps_ahead_of_utc_s(at);
    let size = offset.median.abs();
    let near = |whole: i64, slack: f64| whole != 0 && (size - whole as f64).abs() <= slack;
    let steady = offset.p99 - offset.p01 <= 2.0 * EXACT_S;
    let quarters = (size / QUARTER_S).round();
    let counts = (size / (weeks_of(1) * WEEK_S) as f64).round() as i64;
    let text = if near(leaps, SLACK_S) {
        format!("one of them seems to be GPS time: leap seconds ({leaps}) not applied, or applied twice")
    } else if near(2 * leaps, SLACK_S) {
        format!("the {leaps} leap seconds seem to be applied twice, with the wrong sign")
    } else if near(leaps + TAI_LESS_GPS_S, SLACK_S) || near(TAI_LESS_GPS_S, SLACK_S) {
        "one of them seems to be atomic time (TAI)".to_owned()
    } else if steady && (near(1, EXACT_S) || near(2, EXACT_S)) {
        "one of them may have an outdated number of leap seconds".to_owned()
    } else if near(WEEK_S, QUARTER_S) {
        "one of them seems to have a wrong GPS week".to_owned()
    } else if near(counts * weeks_of(1) * WEEK_S, QUARTER_S) {
        format!(
            "one of them seems to have a wrong GPS week, {} weeks off: its ten-bit counter rolled over",
            weeks_of(counts)
        )
    } else if quarters >= 1.0 && size <= FARTHEST_ZONE_S + QUARTER_S && (size - quarters * QUARTER_S).abs() <= SLACK_S {
        format!("one of them seems to be local time, {} h away", quarters / 4.0)
    } else {
        return None;
    };
    Some(format!("the clocks differ by {:.3} s: {text}", offset.median))
}

/// The first day on which a receiver can have reported something, and why.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Since {
    /// GPS week.
    pub(crate) week: i64,
    /// Why it cannot be earlier.
    pub(crate) why: &'static str,
}

/// The dates that a receiver reports.
#[derive(Debug, Clone, Default)]
pub(crate) struct SaidDates {
    /// The earliest, UTC.
    earliest: Option<Stamp>,
    /// The number of dates in each GPS week.
    weeks: BTreeMap<i64, u64>,
}

impl SaidDates {
    /// One more date, UTC.
    pub(crate) fn add(&mut self, unix: Stamp) {
        let Some(gps) = gps_of_unix(unix) else { return };
        self.earliest = Some(self.earliest.map_or(unix, |earliest| earliest.min(unix)));
        *self.weeks.entry(gps.0.div_euclid(WEEK_NS)).or_default() += 1;
    }

    /// What dates before `since` look like, which a receiver cannot have reported, and their number. A ten-bit counter
    /// of GPS weeks wraps around every 1024 weeks, and the dates of a receiver that missed the last wrap are 19.6 years
    /// too early.
    pub(crate) fn suspicion(&self, since: Since) -> Option<(String, u64)> {
        let early: u64 = self.weeks.range(..since.week).map(|(_, count)| count).sum();
        let all: u64 = self.weeks.values().sum();
        let (earliest, week) = (self.earliest?, *self.weeks.keys().next()?);
        if early == 0 {
            return None;
        }
        let guess = counts_early(week, since.week).and_then(|counts| {
            // The day, whatever leap seconds were inserted in between.
            let later = Stamp(earliest.0.checked_add(weeks_of(counts) * WEEK_NS)?);
            Some(format!("its ten-bit count of GPS weeks may have rolled over: then it is {}", date(later)?))
        });
        let guess = guess.unwrap_or_else(|| "its date is wrong".to_owned());
        let (date, why) = (date(earliest)?, since.why);
        let text = format!(
            "the receiver reports {date}, the earliest of {early} such dates among {all}, but {why}; {guess}. The \
             dates are not changed"
        );
        Some((text, early))
    }

    /// Whether there are no dates.
    pub(crate) fn is_empty(&self) -> bool {
        self.weeks.is_empty()
    }
}

fn date(unix: Stamp) -> Option<String> {
    jiff::Timestamp::from_nanosecond(unix.0.into()).ok().map(|t| t.strftime("%Y-%m-%d").to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_impossibly_early_receiver_date_is_reported_with_its_likely_day() {
        let since = Since { week: 1691, why: "it is younger" };
        let said = |unix_s: &[i64]| {
            let mut dates = SaidDates::default();
            unix_s.iter().for_each(|s| dates.add(Stamp(s * NANOS_PER_SECOND)));
            dates.suspicion(since)
        };
        // date -u -d '2003-09-07T12:00:00Z' +%s; 7168 days later is 2023-04-23. The others: 2012-01-01 and 2012-06-04.
        let (early, recent, right) = (1_062_936_000, 1_325_376_000, 1_338_768_000);
        let text = "the receiver reports 2003-09-07, the earliest of 2 such dates among 5, but it is younger; its ten-bit \
                    count of GPS weeks may have rolled over: then it is 2023-04-23. The dates are not changed";
        assert_eq!(said(&[right, recent, right, early, right]), Some((text.to_owned(), 2)));
        assert!(said(&[recent]).unwrap().0.contains("its date is wrong"));
        assert_eq!((said(&[right, i64::MIN / NANOS_PER_SECOND]), said(&[])), (None, None));
    }

    fn suspicion_of(offset_s: f64) -> Option<String> {
        let d = Distribution {
            min: offset_s - 0.03,
            p01: offset_s - 0.02,
            median: offset_s,
            p99: offset_s + 0.02,
            max: offset_s + 0.03,
        };
        // 2024-05-10: 18 leap seconds.
        suspicion(&d, Stamp(1_715_362_064_000_000_000))
    }

    #[test]
    fn known_offsets_are_named() {
        for (offset, word) in [
            (18.05, "GPS time"),
            (-17.9, "GPS time"),
            (36.0, "twice"),
            (37.1, "TAI"),
            (19.0, "TAI"),
            (-7200.02, "local time, 2 h"),
            (-19_800.0, "local time, 5.5 h"),
            (1.01, "outdated"),
            (604_800.2, "GPS week"),
            (-619_315_200.0, "1024 weeks off"),
            (1_238_630_401.0, "2048 weeks off"),
        ] {
            let text = suspicion_of(offset).unwrap_or_default();
            assert!(text.contains(word), "{offset}: {text}");
        }
    }

    #[test]
    fn a_driver_delay_is_not_suspicious() {
        for offset in [0.0, 0.2, 0.85, -0.4, 1.4, 3.0, 60.0, 500.0, 100_000.0] {
            assert_eq!(suspicion_of(offset), None, "{offset}");
        }
    }
}
