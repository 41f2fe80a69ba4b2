//! The stamps of a table: read from their source, and put right where a clock is known to go wrong.

use super::counted::date_by_counter;
use super::dated::dated;
use super::repair::Repair;
use crate::civil::{Tick, calendar_to_unix_ns, iso_to_unix_ns};
use crate::map::{TieRule, TimeSource};
use crate::reader::Log;
use crate::table::{Column, Table, numbers, texts};
use crate::time::{Week, WeekCount, redate_weeks, tie, unwrap};
use flight::{Clock, NANOS_PER_SECOND, Severity, Stamp, StampKind, UtcTie, WEEK_S, gps_of_unix};
use std::ops::Range;

/// Receivers without a fix count from 1970, 1980 or the year of their firmware; no log that ties is from before 2000.
pub(super) const NO_UTC_BEFORE_NS: i64 = 946_684_800 * NANOS_PER_SECOND;

/// The stamps of one kind for all rows.
pub(super) struct Stamps {
    pub(super) kind: StampKind,
    pub(super) clock: Clock,
    pub(super) label: String,
    pub(super) nanos: Vec<Option<i64>>,
    pub(super) repairs: Vec<Repair>,
}

/// A stamp that was never filled in is no stamp.
pub(super) fn is_constant(nanos: &[Option<i64>]) -> bool {
    let mut values = nanos.iter().flatten();
    let first = values.next();
    nanos.len() > 1 && values.all(|v| Some(v) == first)
}

/// When another clock of the log says that the rows of a table were written, ns since 1970: the median of the first of
/// `sources` that counts UTC, or else of the container's stamps.
pub(super) fn written_at<'s>(sources: impl Iterator<Item = &'s TimeSource>, table: &Table) -> Option<i64> {
    let utc = sources.filter(|s| s.clock() == Clock::Unix).chain([&TimeSource::ContainerLogged]);
    utc.filter_map(|source| {
        let mut stamps: Vec<i64> = nanos_of(source, table)?.into_iter().flatten().collect();
        stamps.sort_unstable();
        let median = *stamps.get(stamps.len() / 2)?;
        // A container may count from boot.
        (median > NO_UTC_BEFORE_NS).then_some(median)
    })
    .next()
}

/// One stamp for each row; `None` if the table has no such source or nothing in it. `written_at` is [`written_at`].
pub(super) fn read_stamps(
    kind: StampKind,
    source: &TimeSource,
    table: &Table,
    written_at: impl Fn() -> Option<i64>,
) -> Option<Stamps> {
    let mut repairs = vec![];
    let mut nanos = match source {
        TimeSource::GpsWeek { week, field, tick, nanos } => {
            let logged = written_at().and_then(|unix| Some(gps_of_unix(Stamp(unix))?.0 / (WEEK_S * NANOS_PER_SECOND)));
            let (mut stamps, ten_bit) = gps_weeks(numbers(table, week)?, field, *tick, logged, table)?;
            let rule = if logged.is_some() { NEAREST_TO_LOG } else { NEAREST_TO_RELEASE };
            note(&mut repairs, "week-rollover", ten_bit, rule);
            if let Some(nanos) = nanos.as_ref().and_then(|nanos| numbers(table, nanos)) {
                add(nanos, &mut stamps);
            }
            stamps
        }
        TimeSource::Civil { .. } => dated(source, table, &mut repairs)?,
        _ => nanos_of(source, table)?,
    };
    date_by_counter(source, table, &mut nanos, &mut repairs);
    repair(source, &mut nanos, &mut repairs);
    let any = nanos.iter().any(Option::is_some);
    let clock = clock_of(source, table, &nanos);
    if clock != source.clock() {
        note(&mut repairs, "unix-stamps", nanos.iter().flatten().count() as u64, UNIX_STAMPS);
    }
    any.then(|| Stamps { kind, clock, label: source.label(), nanos, repairs })
}

const UNIX_STAMPS: &str = "taken as UTC and not as a time since boot, for that would be more than thirty years";
/// Nothing has run since boot for so long, and no log is from so late: 2001 to 2096, ns since 1970.
const UNIX_AND_NOT_BOOT: Range<i64> = 1_000_000_000 * NANOS_PER_SECOND..4_000_000_000 * NANOS_PER_SECOND;

/// What the stamps count. MAVLink's `time_usec` is "UNIX Epoch time or time since system boot", to be told apart by its
/// size (<https://mavlink.io/en/messages/common.html>); the median of the rows decides for all of them.
fn clock_of(source: &TimeSource, table: &Table, nanos: &[Option<i64>]) -> Clock {
    let clock = source.clock();
    if clock != Clock::Boot || table.topic.encoding != "mavlink" {
        return clock;
    }
    let mut stamps: Vec<i64> = nanos.iter().flatten().copied().collect();
    let middle = stamps.len() / 2;
    let median = (middle < stamps.len()).then(|| *stamps.select_nth_unstable(middle).1);
    if median.is_some_and(|median| UNIX_AND_NOT_BOOT.contains(&median)) { Clock::Unix } else { clock }
}

const NEAREST_TO_LOG: &str =
    "GPS weeks below 1024 are counters of ten bits: taken as the week nearest to the date of the log's other clock";
const NEAREST_TO_RELEASE: &str =
    "GPS weeks below 1024 are counters of ten bits: taken as the week nearest to this release";

fn note(repairs: &mut Vec<Repair>, code: &'static str, count: u64, text: &'static str) {
    if count > 0 {
        repairs.push(Repair { severity: Severity::Warning, code, count, text: text.into() });
    }
}

/// Puts right what the clock of a source is known to do wrong.
fn repair(source: &TimeSource, nanos: &mut [Option<i64>], repairs: &mut Vec<Repair>) {
    let TimeSource::Number { tick, clock, .. } = source else {
        if matches!(source, TimeSource::GpsWeek { .. }) {
            note(repairs, "week-glitch", redate_weeks(nanos), WEEK_OFF);
        }
        return;
    };
    if !matches!(clock, Clock::Boot | Clock::Elapsed) {
        return note(repairs, "week-glitch", redate_weeks(nanos), WEEK_OFF);
    }
    if matches!(tick, Tick::Millis | Tick::TenthMillis | Tick::Micros) {
        let wraps = unwrap(nanos, tick.nanos() << 32);
        note(
            repairs,
            "stamp-wrap",
            wraps,
            "the counter of 32 bits began anew and the stamps run on; a restart of the device within a minute of its end would look the same",
        );
    }
    if *clock == Clock::Elapsed {
        let weeks = unwrap(nanos, WEEK_S * NANOS_PER_SECOND);
        note(repairs, "stamp-wrap", weeks, "the time of week began anew; the stamps run on");
        let days = unwrap(nanos, DAY_S * NANOS_PER_SECOND);
        note(repairs, "stamp-wrap", days, "the time of day began anew; the stamps run on");
    }
}

const WEEK_OFF: &str = "stamps a week off their neighbours were put back";
const DAY_S: i64 = 86_400;

fn nanos_of(source: &TimeSource, table: &Table) -> Option<Vec<Option<i64>>> {
    let rows = 0..table.rows;
    Some(match source {
        TimeSource::ContainerLogged => table.logged_ns.as_ref()?.iter().copied().map(Some).collect(),
        // Writers that know no publish time repeat the log time there.
        TimeSource::ContainerPublished if table.published_ns == table.logged_ns => return None,
        TimeSource::ContainerPublished => table.published_ns.as_ref()?.iter().copied().map(Some).collect(),
        TimeSource::Number { field, tick, .. } => ticks(field, *tick, table, rows)?,
        TimeSource::Iso { field } => {
            let column = texts(table, field)?;
            rows.map(|row| iso_to_unix_ns(column.text(row)?)).collect()
        }
        TimeSource::Civil { .. } => dated(source, table, &mut vec![])?,
        TimeSource::Calendar { fields, .. } => {
            let columns: Vec<&Column> = fields.iter().map(|f| numbers(table, f)).collect::<Option<_>>()?;
            rows.map(|row| calendar(&columns, row)).collect()
        }
        TimeSource::GpsWeek { week, field, tick, .. } => gps_weeks(numbers(table, week)?, field, *tick, None, table)?.0,
    })
}

/// A number of ticks for each row.
fn ticks(field: &str, tick: Tick, table: &Table, rows: Range<usize>) -> Option<Vec<Option<i64>>> {
    match (texts(table, field), numbers(table, field)) {
        (Some(text), _) => Some(rows.map(|row| tick.of_text(text.text(row)?)).collect()),
        (None, Some(number)) => {
            let nanos = |row| match number.integer(row) {
                Some(integer) => tick.of_integer(integer),
                None => tick.of_float(number.number(row)?),
            };
            Some(rows.map(nanos).collect())
        }
        (None, None) => None,
    }
}

/// GPS time from a week and the time in it, and how many weeks were counters of ten bits. `logged` is the week in which
/// the log was written, if another clock says it.
fn gps_weeks(
    week: &Column,
    field: &str,
    tick: Tick,
    logged: Option<i64>,
    table: &Table,
) -> Option<(Vec<Option<i64>>, u64)> {
    let in_week = ticks(field, tick, table, 0..table.rows)?;
    let count = WeekCount::of((0..table.rows).filter_map(|row| week.integer(row)), logged);
    let mut ten_bit = 0;
    let nanos = in_week.into_iter().enumerate().map(|(row, in_week)| {
        let in_week = in_week.filter(|ns| (0..WEEK_S * NANOS_PER_SECOND).contains(ns))?;
        let week = count.week(week.integer(row)?)?;
        ten_bit += u64::from(matches!(week, Week::TenBit(_)));
        Some(week.start_ns() + in_week)
    });
    let nanos = nanos.collect();
    Some((nanos, ten_bit))
}

/// Adds a column of nanoseconds; without one of them there is no stamp.
fn add(nanos: &Column, stamps: &mut [Option<i64>]) {
    for (row, stamp) in stamps.iter_mut().enumerate() {
        *stamp = stamp.zip(nanos.integer(row)).and_then(|(stamp, nanos)| stamp.checked_add(nanos));
    }
}

fn calendar(columns: &[&Column], row: usize) -> Option<i64> {
    let mut parts = [0; 7];
    for (part, column) in parts.iter_mut().zip(columns) {
        *part = column.integer(row)?;
    }
    let [year, month, day, hour, minute, second, nanos] = parts;
    calendar_to_unix_ns([year, month, day, hour, minute, second], nanos)
}

/// What ties a clock to UTC, and what is to be said of it.
pub(super) struct Tied {
    pub(super) tie: UtcTie,
    /// UTC was reckoned from GPS time.
    pub(super) from_gps: bool,
    pub(super) repairs: Vec<Repair>,
}

/// The first of the rules that ties a clock to UTC in this log.
pub(super) fn tie_of(rules: &[TieRule], log: &Log) -> Option<Tied> {
    rules.iter().find_map(|rule| {
        pairs_of(rule, log).into_iter().find_map(|(_, pairs)| {
            let tie = pairs.ties(1, |_| Some(0)).pop()??;
            Some(Tied { tie, from_gps: pairs.from_gps, repairs: pairs.repairs })
        })
    })
}

/// Stamps of a clock with UTC, row by row.
pub(super) struct Pairs {
    clock: Clock,
    /// Topic and fields.
    source: String,
    /// Row, stamp and UTC, ns.
    pairs: Vec<(usize, i64, i64)>,
    pub(super) from_gps: bool,
    pub(super) repairs: Vec<Repair>,
}

impl Pairs {
    /// The tie by the rows of each of so many sessions; `None` of one without any.
    pub(super) fn ties(&self, sessions: usize, session_of: impl Fn(usize) -> Option<usize>) -> Vec<Option<UtcTie>> {
        let mut pairs = vec![vec![]; sessions];
        for (row, stamp, utc) in &self.pairs {
            let session = session_of(*row).and_then(|session| pairs.get_mut(session));
            session.into_iter().for_each(|pairs| pairs.push((*stamp, *utc)));
        }
        pairs.iter().map(|pairs| tie(self.clock, self.source.clone(), pairs)).collect()
    }
}

/// The tables in which a rule finds pairs, that of the closest name first.
pub(super) fn pairs_of<'l>(rule: &TieRule, log: &'l Log) -> Vec<(&'l Table, Pairs)> {
    let mut tables: Vec<_> = log.tables.iter().filter_map(|t| Some((rule.meets(&t.topic)?, t))).collect();
    tables.sort_by_key(|(closeness, _)| *closeness);
    tables.into_iter().filter_map(|(_, table)| Some((table, pairs_in(rule, table)?))).collect()
}

fn pairs_in(rule: &TieRule, table: &Table) -> Option<Pairs> {
    let written_at = || written_at([].into_iter(), table);
    let stamps = read_stamps(StampKind::Logged, &rule.stamp, table, written_at)?;
    let utc = read_stamps(StampKind::Measured, &rule.utc, table, written_at)?;
    let meets = |row: usize| {
        rule.require.iter().all(|r| numbers(table, &r.field).and_then(|c| c.number(row)).is_none_or(|v| r.met_by(v)))
    };
    if stamps.clock != rule.clock {
        return None;
    }
    let pair = |row: usize| {
        let unix = utc.clock.unix(Stamp(utc.nanos.get(row).copied().flatten()?))?.0;
        Some((row, stamps.nanos.get(row).copied().flatten()?, unix)).filter(|_| unix > NO_UTC_BEFORE_NS && meets(row))
    };
    let pairs = (0..table.rows).filter_map(pair).collect();
    let source = format!("{}: {} and {}", table.topic.name, stamps.label, utc.label);
    let repairs = stamps.repairs.into_iter().chain(utc.repairs).collect();
    Some(Pairs { clock: rule.clock, source, pairs, from_gps: utc.clock == Clock::Gps, repairs })
}
