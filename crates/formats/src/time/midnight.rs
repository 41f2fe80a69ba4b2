//! Corrects a date that stays the old one for some time after midnight while the time of day runs on.

use flight::NANOS_PER_SECOND;

const DAY_NS: i64 = 86_400 * NANOS_PER_SECOND;
/// Across midnight, successive timestamps are within this time, ns.
const CLOSE_NS: i64 = 60 * NANOS_PER_SECOND;

/// Moves rows after midnight that still have the old date a day later, and returns their number. `days` are the dates of
/// the timestamps, in days since any epoch. Both are in the order of the log.
///
/// The log must show it: the time of day falls by nearly 24 h from one row to the next and the date stays the same.
/// Unsorted rows, and two halves of a day with the later one first, are not changed.
pub fn redate_days(stamps: &mut [Option<i64>], days: &[Option<i64>]) -> u64 {
    let rows: Vec<(i64, i64)> = stamps.iter().zip(days).filter_map(|(stamp, day)| stamp.zip(*day)).collect();
    let days_to_add = days_to_add_of(&rows);
    let moved = days_to_add.iter().filter(|days| **days > 0).count() as u64;
    if moved == 0 || !runs_on(&rows, &days_to_add) {
        return 0;
    }
    let dated = stamps.iter_mut().zip(days).filter_map(|(stamp, day)| stamp.as_mut().filter(|_| day.is_some()));
    dated.zip(days_to_add).for_each(|(stamp, days)| *stamp = stamp.saturating_add(days.saturating_mul(DAY_NS)));
    moved
}

/// The number of days by which the date of each row is too early. A row is a timestamp and its date.
fn days_to_add_of(rows: &[(i64, i64)]) -> Vec<i64> {
    let close = |step: i64| (0..=CLOSE_NS).contains(&step);
    let (mut days_to_add, mut before) = (0, None);
    let mut each = Vec::with_capacity(rows.len());
    for (stamp, day) in rows {
        if let Some((last, last_day)) = before.replace((*stamp, *day)) {
            let step = stamp.saturating_sub(last);
            if *day != last_day {
                days_to_add = (days_to_add - (day - last_day)).max(0) * i64::from(*day > last_day);
            } else if close(step.saturating_add(DAY_NS)) {
                days_to_add += 1;
            } else if days_to_add > 0 && close(DAY_NS.saturating_sub(step)) {
                // Undone for a row that arrived late.
                days_to_add -= 1;
            }
        }
        each.push(days_to_add);
    }
    each
}

/// Whether the rows with their new dates are in order, and would not fit as well before all others.
fn runs_on(rows: &[(i64, i64)], days_to_add: &[i64]) -> bool {
    let dated: Vec<i64> = rows
        .iter()
        .zip(days_to_add)
        .map(|((stamp, _), days)| stamp.saturating_add(days.saturating_mul(DAY_NS)))
        .collect();
    let (Some((first, _)), Some((last, _)), Some(last_to_add)) = (rows.first(), rows.last(), days_to_add.last()) else {
        return false;
    };
    let in_front = *last_to_add > 0 && (0..=CLOSE_NS).contains(&first.saturating_sub(*last));
    !in_front && dated.windows(2).all(|pair| matches!(pair, [a, b] if b.saturating_sub(*a) >= -CLOSE_NS))
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: i64 = NANOS_PER_SECOND;

    /// Rows once a second from `start` seconds of day 0, each with its true date.
    fn flight(start: i64, rows: i64) -> (Vec<Option<i64>>, Vec<Option<i64>>) {
        let stamps: Vec<i64> = (start..start + rows).map(|second| second * S).collect();
        (stamps.iter().copied().map(Some).collect(), stamps.iter().map(|stamp| Some(stamp / DAY_NS)).collect())
    }

    /// The same, with the old date in this range of rows.
    fn stale(rows: std::ops::Range<usize>, of: &(Vec<Option<i64>>, Vec<Option<i64>>)) -> [Vec<Option<i64>>; 2] {
        let (mut stamps, mut days) = of.clone();
        for row in rows {
            stamps[row] = stamps[row].map(|stamp| stamp - DAY_NS);
            days[row] = days[row].map(|day| day - 1);
        }
        [stamps, days]
    }

    #[test]
    fn rows_after_midnight_with_the_old_date_are_moved_a_day_later() {
        let truth = flight(86_390, 100);
        for until in [11, 12, 40, 100] {
            let [mut stamps, days] = stale(10..until, &truth);
            assert_eq!(redate_days(&mut stamps, &days), until as u64 - 10);
            assert_eq!(stamps, truth.0, "{until}");
        }
    }

    #[test]
    fn a_date_that_misses_two_midnights_and_then_runs_a_day_behind_is_corrected_by_what_is_missing() {
        // Two days and a half, once a minute. The date stays the first until noon of the last day, then it is one behind.
        let noon = 2 * DAY_NS + DAY_NS / 2;
        let truth: Vec<i64> = (0..3600).map(|minute| 60 * S * minute).collect();
        let shown = |stamp: &i64| if *stamp < noon { 0 } else { 1 };
        let days: Vec<Option<i64>> = truth.iter().map(|stamp| Some(shown(stamp))).collect();
        let mut stamps: Vec<Option<i64>> =
            truth.iter().map(|stamp| Some(stamp % DAY_NS + shown(stamp) * DAY_NS)).collect();
        assert_eq!(redate_days(&mut stamps, &days), 3600 - 1440);
        assert_eq!(stamps, truth.into_iter().map(Some).collect::<Vec<_>>());
    }

    #[test]
    fn late_undated_and_correct_rows_at_midnight_change_nothing_else() {
        let truth = flight(86_390, 30);
        let (mut same, days) = truth.clone();
        assert_eq!(redate_days(&mut same, &days), 0);
        let [mut stamps, mut days] = stale(10..30, &truth);
        (stamps[15], days[20]) = (None, None);
        stamps.swap(9, 10);
        days.swap(9, 10);
        assert_eq!(redate_days(&mut stamps, &days), 18);
        assert_eq!((stamps[9], stamps[10], stamps[29]), (truth.0[10], truth.0[9], truth.0[29]));
        assert_eq!(stamps[20], truth.0[20].map(|stamp| stamp - DAY_NS));
    }

    #[test]
    fn unsorted_rows_are_not_redated() {
        let (stamps, days) = flight(0, 86_400);
        let check = |order: &dyn Fn(usize) -> usize| {
            let ordered = |v: &[Option<i64>]| (0..86_400).map(|i| v[order(i)]).collect::<Vec<_>>();
            let mut log = ordered(&stamps);
            assert_eq!(redate_days(&mut log, &ordered(&days)), 0);
            assert_eq!(log, ordered(&stamps));
        };
        // The second half of a day before the first, a day backwards, and a day shuffled.
        check(&|i| (i + 43_200) % 86_400);
        check(&|i| 86_399 - i);
        check(&|i| i * 43_201 % 86_400);
        assert_eq!(redate_days(&mut [], &[]), 0);
    }
}
