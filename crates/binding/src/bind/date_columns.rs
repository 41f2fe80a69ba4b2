//! Timestamps from a date column and a time-of-day column.

use super::repair::Repair;
use super::time_of_day::{DAY_NS, TimesOfDay};
use crate::map::TimeSource;
use flight::{Code, GPS_EPOCH_UNIX_S, NANOS_PER_SECOND, Severity};
use formats::civil::{DateOrder, DayOfYear, plain_date, says_zone, unix_ns};
use formats::time::redate_days;
use formats::{Column, Table};
use jiff::civil::Date;
use std::borrow::Cow;

/// No zone is further from UTC: a larger number is hours and minutes, `0530`.
const MOST_HOURS: u64 = 14;
const STALE: &str = "rows after midnight that still have the old date are dated a day later";

/// The columns of [`TimeSource::Civil`].
///
/// Where a log's columns have types, as in a recovered table, a date of digits and an offset of digits are numbers.
struct Civil<'a> {
    date: &'a Column,
    time: TimesOfDay<'a>,
    offset: Option<&'a Column>,
    /// The offset of rows for which no column gives it.
    zone: &'a str,
    order: Option<DateOrder>,
}

impl<'a> Civil<'a> {
    fn of(source: &'a TimeSource, table: &'a Table) -> Option<Civil<'a>> {
        let TimeSource::Civil { date, time, offset, zone, order, .. } = source else { return None };
        let either = |path: &str| table.texts(path).or_else(|| table.numbers(path));
        let offset = offset.as_ref().and_then(|offset| either(offset));
        let zone = zone.as_deref().unwrap_or("Z");
        Some(Civil { date: either(date)?, time: TimesOfDay::of(table, time)?, offset, zone, order: *order })
    }

    /// The date of a row; `order` is the order for ambiguous dates.
    fn date(&self, row: usize, order: Option<DateOrder>) -> Option<Date> {
        match self.date.text(row) {
            Some(text) => date_in(order, text),
            None => date_in(order, &format!("{:06}", self.date.integer(row)?)),
        }
    }

    /// The offset of a row from UTC; `+02` and `+0200` are both two hours east.
    fn offset(&self, row: usize) -> Option<Cow<'a, str>> {
        let Some(column) = self.offset else { return Some(self.zone.into()) };
        if let Some(text) = column.text(row) {
            return Some(text.to_string().into());
        }
        let digits = column.integer(row)?;
        let width = if digits.unsigned_abs() <= MOST_HOURS { 3 } else { 5 };
        Some(format!("{digits:+0width$}").into())
    }

    /// The order of ambiguous dates, and the date that proves it if the map does not state it.
    fn order(&self, rows: usize) -> Result<Option<(DateOrder, Option<&'a str>)>, &'a str> {
        match self.order {
            Some(order) => Ok(Some((order, None))),
            None => {
                let shown = DateOrder::shown_by((0..rows).filter_map(|row| self.date.text(row)))?;
                Ok(shown.map(|(order, shows)| (order, Some(shows))))
            }
        }
    }
}

/// Seven digits with the year last, `2062021`, have lost the leading zero of eight. Without an order they are a year
/// and a day of the year.
fn date_in(order: Option<DateOrder>, text: &str) -> Option<Date> {
    let seven = text.len() == 7 && text.bytes().all(|b| b.is_ascii_digit());
    match order {
        Some(order) if seven && order != DateOrder::YearMonthDay => order.date(&format!("0{text}")),
        order => order.and_then(|order| order.date(text)).or_else(|| plain_date(text)),
    }
}

/// A timestamp for each row, ns since 1970; `None` if the table has no such columns, or the order of its dates is
/// unknown.
pub(super) fn stamps_of_dates(
    source: &TimeSource,
    table: &Table,
    repairs: &mut Vec<Repair>,
) -> Option<Vec<Option<i64>>> {
    let civil = Civil::of(source, table)?;
    let order = civil.order(table.rows).ok()?;
    let (mut stamps, mut days) = (Vec::with_capacity(table.rows), Vec::with_capacity(table.rows));
    for row in 0..table.rows {
        let date = civil.date(row, order.map(|(order, _)| order));
        let instant = |time: &str| unix_ns(date?, time, &civil.offset(row)?);
        days.push(date.and_then(|date| unix_ns(date, "00:00:00", "Z")).map(|midnight| midnight / DAY_NS));
        stamps.push(civil.time.at(row).and_then(|time| instant(&time)));
    }
    // A date with dots and a four-digit year has only one order in use.
    if let Some((order, Some(shows))) = order.filter(|(_, shows)| !shows.as_deref().is_some_and(is_plain)) {
        let text = format!("the dates are read with the {} first: {shows} shows this", order.word());
        repairs.push(Repair { what: Code::DateInferred.into(), count: table.rows as u64, text: text.into() });
    }
    let stale = redate_days(&mut stamps, &days);
    if stale > 0 {
        let what = Code::DateInferred.at(Severity::Warning);
        repairs.push(Repair { what, count: stale, text: STALE.into() });
    }
    if matches!(source, TimeSource::Civil { is_gps: true, .. }) {
        let gps = |unix_ns: &mut Option<i64>| {
            *unix_ns = unix_ns.and_then(|ns| ns.checked_sub(GPS_EPOCH_UNIX_S * NANOS_PER_SECOND))
        };
        stamps.iter_mut().for_each(gps);
    }
    Some(stamps)
}

/// The number of rows that state an instant without a zone, where neither the map nor a column name says that it is
/// UTC.
pub(super) fn without_zone(source: &TimeSource, table: &Table) -> u64 {
    let (field, is_silent): (_, fn(&str) -> bool) = match source {
        TimeSource::DayOfYear { field, zone: None, .. } => {
            (field, |text| DayOfYear::of_text(text).is_some_and(|day| day.east_ns.is_none()))
        }
        TimeSource::Iso { field, zone: None }
        | TimeSource::Civil { time: field, offset: None, zone: None, is_gps: false, .. } => {
            (field, |text| !text.trim().is_empty() && !says_zone(text))
        }
        _ => return 0,
    };
    let label = source.label();
    let named = ["utc", "gmt", "zulu"].iter().any(|zone| label.to_ascii_lowercase().contains(zone));
    let Some(column) = table.texts(field).filter(|_| !named) else { return 0 };
    (0..table.rows).filter(|row| column.text(*row).is_some_and(&is_silent)).count() as u64
}

fn is_plain(date: &str) -> bool {
    date.rsplit_once('.').is_some_and(|(_, year)| year.len() == 4)
}

/// The first value in place of an instant that is not an instant.
pub(super) fn example(source: &TimeSource, table: &Table) -> Option<String> {
    let first = |column: &Column| {
        let mut texts = (0..table.rows).filter_map(|row| column.text(row));
        texts.find(|text| !text.trim().is_empty()).map(|text| format!("{}: {:.40}", column.path, text.trim()))
    };
    let cells = match source {
        TimeSource::Iso { field, .. }
        | TimeSource::GpsText { field }
        | TimeSource::DayOfYear { field, .. }
        | TimeSource::TimeOfDay { field } => first(table.texts(field)?)?,
        TimeSource::Civil { date, time, .. } => {
            let columns = [date, time].map(|field| table.texts(field).and_then(first));
            columns.into_iter().flatten().collect::<Vec<_>>().join(", ")
        }
        _ => return None,
    };
    (!cells.is_empty()).then(|| format!("this cannot be read: {cells}"))
}

/// Why there are no timestamps although the table has the columns.
pub(super) fn unclear(source: &TimeSource, table: &Table) -> Option<String> {
    let civil = Civil::of(source, table)?;
    let date = civil.order(table.rows).err()?;
    Some(format!(
        "{} is ambiguous: which number of {date} is the day? Write order = \"day-month-year\", \"month-day-year\" or \
         \"year-month-day\" next to date in the channel map",
        civil.date.path
    ))
}
