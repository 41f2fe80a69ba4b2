//! Dates rows that have no date by a device's own counter.

use super::order::FAR_NS;
use super::repair::Repair;
use crate::map::TimeSource;
use flight::{Code, Severity};
use formats::time::unwrap;
use formats::{Table, Values};

const COUNTED: &str = "rows without a date, or with a date more than a day away from most others, are dated by the \
    device's counter, counted from the nearest dated row";

/// Dates the rows of a calendar with a counter that have no date, and those whose date differs by more than a day from
/// that of most rows: a device counts from a date of its own until it receives the time.
pub(super) fn date_by_counter(source: &TimeSource, table: &Table, dates: &mut Values<i64>, repairs: &mut Vec<Repair>) {
    let TimeSource::Calendar { counter: Some((field, tick)), .. } = source else { return };
    let Some(column) = table.numbers(field) else { return };
    let mut counts: Values<i64> =
        (0..table.rows).map(|row| tick.integer_since(column.integer(row)?, 0).filter(|ns| *ns >= 0)).collect();
    unwrap(&mut counts, tick.nanos() << 32);
    let counts: Vec<Option<i64>> = counts.iter().collect();
    let mut count = 0;
    dates.change(|dates| count = date_rows(dates, &counts));
    if count > 0 {
        repairs.push(Repair { what: Code::DateInferred.at(Severity::Warning), count, text: COUNTED.into() });
    }
}

/// The number of rows dated. The counter is assumed to continue from one dated row to the next unless it goes back.
fn date_rows(dates: &mut [Option<i64>], counts: &[Option<i64>]) -> u64 {
    let begin = |(date, count): (&Option<i64>, &Option<i64>)| date.zip(*count).map(|(date, count)| date - count);
    let mut begins: Vec<i64> = dates.iter().zip(counts).filter_map(begin).collect();
    let middle = begins.len() / 2;
    if middle >= begins.len() {
        return 0;
    }
    let usual = *begins.select_nth_unstable(middle).1;
    let mut dated: Vec<Option<(i64, i64)>> = dates.iter().zip(counts).map(|(d, c)| d.zip(*c)).collect();
    dated.iter_mut().for_each(|pair| *pair = pair.filter(|(date, count)| (date - count).abs_diff(usual) <= FAR_NS));
    let after = nearest(dated.iter().rev());
    let before = nearest(dated.iter());
    let mut moved = 0;
    for (row, (date, count)) in dates.iter_mut().zip(counts).enumerate() {
        let (Some(count), None) = (*count, dated.get(row).copied().flatten()) else { continue };
        let at = |of: &[Option<(i64, i64)>], row: usize| of.get(row).copied().flatten();
        let from = at(&before, row).filter(|(_, known)| *known <= count);
        let from = from.or_else(|| at(&after, dated.len() - 1 - row).filter(|(_, known)| *known >= count));
        if let Some((known_date, known)) = from {
            *date = Some(known_date + (count - known));
            moved += 1;
        }
    }
    moved
}

/// For each index, the last pair up to it.
fn nearest<'p>(pairs: impl Iterator<Item = &'p Option<(i64, i64)>>) -> Vec<Option<(i64, i64)>> {
    let mut last = None;
    pairs
        .map(|pair| {
            last = pair.or(last);
            last
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_before_between_and_after_dated_rows_are_dated_by_the_counter() {
        let counts: Vec<Option<i64>> = (0..8).map(|i| Some(50 + 10 * i)).collect();
        // Exact relative to the row before, or at the start to the first: here the date gains two on the counter.
        let mut dates = [None, None, Some(1020), None, Some(1042), Some(1052), None, None];
        assert_eq!(date_rows(&mut dates, &counts), 5);
        assert_eq!(dates.map(Option::unwrap), [1000, 1010, 1020, 1030, 1042, 1052, 1062, 1072]);
    }

    #[test]
    fn a_default_date_of_the_device_is_replaced_by_that_of_most_rows() {
        let counts: Vec<Option<i64>> = (0..6).map(|i| Some(10 * i)).collect();
        let day = 1_700_000_000_000_000_000;
        let mut dates = [0, 10, day + 20, day + 30, day + 40, day + 50].map(Some);
        assert_eq!(date_rows(&mut dates, &counts), 2);
        assert_eq!(dates.map(Option::unwrap), [0, 10, 20, 30, 40, 50].map(|ns| day + ns));
    }

    #[test]
    fn rows_across_a_counter_restart_or_without_a_counter_stay_undated() {
        let counts = [Some(900), Some(910), Some(0), Some(10), None];
        let mut dates = [None, None, None, Some(500), None];
        assert_eq!(date_rows(&mut dates, &counts), 1);
        assert_eq!(dates, [None, None, Some(490), Some(500), None]);
        assert_eq!(date_rows(&mut [None, None], &[Some(1), Some(2)]), 0);
        assert_eq!(date_rows(&mut [], &[]), 0);
    }
}
