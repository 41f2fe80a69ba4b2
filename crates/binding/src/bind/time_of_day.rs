//! Timestamps from a day of the year, or from a time of day alone.

use super::repair::Repair;
use flight::{Clock, Code, NANOS_PER_SECOND};
use formats::civil::{DayOfYear, offset_seconds, since_midnight_ns, with_colons, year_begin_unix_ns};
use formats::time::{TOLERATED, unwrap};
use formats::{Column, Table, Values};

pub(super) const DAY_NS: i64 = 86_400 * NANOS_PER_SECOND;

/// Times of day as their column writes them.
#[derive(Clone, Copy)]
pub(super) struct TimesOfDay<'a> {
    column: &'a Column,
    /// Values without a colon may be `hhmmss`, except for one in a hundred, and one of them has too many digits for a
    /// smaller number.
    compact: bool,
}

impl<'a> TimesOfDay<'a> {
    /// `None` if the table has no such column. Where a log's columns have types, `hhmmss` is a number.
    pub(super) fn of(table: &'a Table, field: &str) -> Option<TimesOfDay<'a>> {
        let column = table.texts(field).or_else(|| table.numbers(field))?;
        let (mut all, mut wrong, mut long) = (0, 0, false);
        for text in (0..table.rows).filter_map(|row| cell_text(column, row)).filter(|text| is_compact(text)) {
            let fits = with_colons(&text).is_some();
            (all, wrong) = (all + 1, wrong + usize::from(!fits));
            long |= fits && text.bytes().take_while(u8::is_ascii_digit).count() >= 5;
        }
        Some(TimesOfDay { column, compact: long && TOLERATED * wrong <= all })
    }

    /// The time of a row, with colons.
    pub(super) fn at(self, row: usize) -> Option<String> {
        let text = cell_text(self.column, row)?;
        if is_compact(&text) {
            return with_colons(&text).filter(|_| self.compact);
        }
        Some(text)
    }
}

fn cell_text(column: &Column, row: usize) -> Option<String> {
    let number = || column.number(row).map(|number| number.to_string());
    column.text(row).map(|text| text.trim().to_owned()).or_else(number).filter(|text| !text.is_empty())
}

fn is_compact(text: &str) -> bool {
    text.starts_with(|c: char| c.is_ascii_digit()) && !text.contains(':')
}

/// Timestamps since the midnight before the first row; `None` if the table has no such column.
pub(super) fn times_of_day(field: &str, table: &Table, repairs: &mut Vec<Repair>) -> Option<Values<i64>> {
    let times = TimesOfDay::of(table, field)?;
    let mut stamps: Values<i64> = (0..table.rows).map(|row| since_midnight_ns(&times.at(row)?)).collect();
    note_wraps(unwrap(&mut stamps, DAY_NS), "the time of day passed midnight; the timestamps continue", repairs);
    Some(stamps)
}

/// Timestamps of days of the year, and their clock: UTC if most rows state the year, or if that of the first is known.
/// Where most state it, the others have no timestamp. A row with its own UTC offset is not in the zone of the map.
pub(super) fn days_of_year(
    field: &str,
    year: Option<i16>,
    zone: Option<&str>,
    table: &Table,
    repairs: &mut Vec<Repair>,
) -> Option<(Clock, Values<i64>)> {
    let column = table.texts(field)?;
    let days: Vec<Option<DayOfYear>> = (0..table.rows).map(|row| DayOfYear::of_text(column.text(row)?)).collect();
    let zone_ns = zone_ns(zone);
    let east_ns = |day: &DayOfYear| day.east_ns.unwrap_or(zone_ns);
    let known = || days.iter().flatten();
    let (with_year, all) = (known().filter(|day| day.year.is_some()).count(), known().count());
    if 2 * with_year > all || all == 0 {
        let stamp = |day: &DayOfYear| unix_ns(day)?.checked_sub(east_ns(day));
        return Some((Clock::Unix, days.iter().map(|day| day.as_ref().and_then(stamp)).collect()));
    }
    let begin = year.and_then(year_begin_unix_ns);
    let length = year_length_ns(year, &days);
    // A known year may lack such a day.
    let is_in_year = |ns: &i64| begin.is_none() || *ns < length;
    let mut stamps: Values<i64> = days.iter().map(|day| day.as_ref().map(since_begin).filter(is_in_year)).collect();
    note_wraps(unwrap(&mut stamps, length), "the day of the year wrapped around; the timestamps continue", repairs);
    let dated = |since: i64, day: &DayOfYear| since.checked_add(begin.unwrap_or(0))?.checked_sub(east_ns(day));
    let stamps = stamps.iter().zip(&days).map(|(since, day)| dated(since?, day.as_ref()?)).collect();
    let clock = if begin.is_some() { Clock::Unix } else { Clock::Elapsed };
    Some((clock, stamps))
}

/// The offset of a zone, or else of UTC, from UTC, ns.
pub(super) fn zone_ns(zone: Option<&str>) -> i64 {
    i64::from(zone.and_then(offset_seconds).unwrap_or(0)) * NANOS_PER_SECOND
}

/// For a day with its year, in the zone in which it is written.
fn unix_ns(day: &DayOfYear) -> Option<i64> {
    year_begin_unix_ns(day.year?)?.checked_add(since_begin(day))
}

fn since_begin(day: &DayOfYear) -> i64 {
    (day.day - 1) * DAY_NS + day.nanos
}

/// The length of the year of the first row; if unknown, as long as the rows require.
fn year_length_ns(year: Option<i16>, days: &[Option<DayOfYear>]) -> i64 {
    let begin_and_next = || {
        let year = year?;
        Some((year_begin_unix_ns(year)?, year_begin_unix_ns(year.checked_add(1)?)?))
    };
    match begin_and_next() {
        Some((begin, next)) => next - begin,
        None if days.iter().flatten().any(|day| day.day == 366) => 366 * DAY_NS,
        None => 365 * DAY_NS,
    }
}

fn note_wraps(count: u64, text: &'static str, repairs: &mut Vec<Repair>) {
    if count > 0 {
        repairs.push(Repair { what: Code::StampWrap.into(), count, text: text.into() });
    }
}
