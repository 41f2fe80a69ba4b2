//! Reads the timestamps of a table from their source, and corrects known clock faults.

use super::conditions::is_met;
use super::counter_dates::date_by_counter;
use super::date_columns::{stamps_of_dates, without_zone};
use super::repair::Repair;
use super::time_of_day::{DAY_NS, days_of_year, times_of_day, zone_ns};
use crate::map::{TieRule, TimeSource, USUAL_BITS};
use flight::{
    Clock, Code, GPS_EPOCH_UNIX_S, NANOS_PER_SECOND, Severity, Stamp, StampKind, UtcTie, WEEK_S, gps_of_unix,
};
use formats::civil::{Tick, calendar_to_unix_ns, local_to_unix_ns, says_zone};
use formats::time::{Week, WeekCount, redate_weeks, tie, unwrap};
use formats::{Column, ColumnData, Log, Table, Values};
use std::ops::Range;
use std::rc::Rc;

/// Receivers without a fix count from 1970, 1980 or the year of their firmware; no log that ties is from before 2000.
pub(super) const NO_UTC_BEFORE_NS: i64 = 946_684_800 * NANOS_PER_SECOND;

/// The timestamps of one kind for all rows.
pub(super) struct Stamps {
    pub(super) kind: StampKind,
    pub(super) clock: Clock,
    pub(super) label: String,
    /// Shared by the channels of one table.
    pub(super) nanos: Rc<Values<i64>>,
    pub(super) repairs: Vec<Repair>,
    /// The counters that the timestamps may wrap around at; empty for 64-bit ones, containers, and seconds since boot.
    pub(super) counters: Vec<Counter>,
    /// The counter that wrapped around.
    pub(super) wrapped_at: Option<Counter>,
}

/// A counter that wraps around.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Counter {
    /// Its length, ns.
    pub(super) range: i64,
    /// The unit counted; `None` for a time of day as text.
    tick: Option<Tick>,
}

impl Stamps {
    /// Shares the memory of equal timestamps of the same rows.
    pub(super) fn share(&mut self, other: &Stamps) {
        if self.nanos == other.nanos {
            self.nanos = Rc::clone(&other.nanos);
        }
    }

    /// Takes the timestamps of another source of the same clock for rows without one, if no row has both: devices of
    /// two generations may have written one log. A source that was never filled in is ignored.
    pub(super) fn fill(&mut self, other: Stamps) {
        let both = self.nanos.iter().zip(other.nanos.iter()).any(|(own, other)| own.is_some() && other.is_some());
        if both || other.clock != self.clock || is_constant(&other.nanos) {
            return;
        }
        self.wrapped_at = self.wrapped_at.or(other.wrapped_at);
        self.counters.retain(|counter| other.counters.contains(counter));
        let filled: Vec<Option<i64>> =
            self.nanos.iter().zip(other.nanos.iter()).map(|(own, other)| own.or(other)).collect();
        self.nanos = Rc::new(filled.into());
        self.label = format!("{} or {}", self.label, other.label);
        self.repairs.extend(other.repairs);
    }
}

/// A timestamp that was never filled in is not a timestamp.
pub(super) fn is_constant(nanos: &Values<i64>) -> bool {
    let mut values = nanos.given();
    let first = values.next();
    nanos.len() > 1 && values.all(|v| Some(v) == first)
}

/// When the rows of a table were written according to another clock of the log, ns since 1970: the median of the first
/// of `sources` that counts UTC, or else of the container's timestamps.
pub(super) fn written_at<'s>(sources: impl Iterator<Item = &'s TimeSource>, table: &Table) -> Option<i64> {
    let utc = sources.filter(|s| s.clock() == Clock::Unix).chain([&TimeSource::ContainerLogged]);
    utc.filter_map(|source| {
        let mut stamps: Vec<i64> = nanos_of(source, table, &mut vec![])?.given().collect();
        stamps.sort_unstable();
        let median = *stamps.get(stamps.len() / 2)?;
        // A container may count from boot.
        (median > NO_UTC_BEFORE_NS).then_some(median)
    })
    .next()
}

/// One timestamp for each row; `None` if the table has no such source or it is empty. `written_at` is [`written_at`].
pub(super) fn read_stamps(
    kind: StampKind,
    source: &TimeSource,
    table: &Table,
    written_at: impl Fn() -> Option<i64>,
) -> Option<Stamps> {
    let mut repairs = vec![];
    let mut nanos = match source {
        TimeSource::GpsWeek { .. } => gps_time(source, table, written_at(), &mut repairs)?,
        _ => nanos_of(source, table, &mut repairs)?,
    };
    date_by_counter(source, table, &mut nanos, &mut repairs);
    let mut counters = counters_of(source);
    let mut wrapped_at = repair(source, &counters, &mut nanos, &mut repairs);
    if matches!(source, TimeSource::TimeOfDay { .. }) && repairs.iter().any(|r| r.what.code() == Code::StampWrap) {
        wrapped_at = counters.first().copied();
    }
    if is_wide(source, table) {
        counters.clear();
    }
    nanos.given().next()?;
    let clock = clock_of(source, table, &nanos);
    let silent = if clock == Clock::Unix { without_zone(source, table) } else { 0 };
    if silent > 0 {
        repairs.push(Repair { what: Code::DateInferred.into(), count: silent, text: NO_ZONE.into() });
    }
    if clock != source.clock() && source.clock() == Clock::Boot {
        note_inferred(&mut repairs, nanos.given().count() as u64, UNIX_STAMPS);
    }
    Some(Stamps { kind, clock, label: source.label(), nanos: Rc::new(nanos), repairs, counters, wrapped_at })
}

/// GPS time from weeks, with ten-bit weeks resolved by when the log was written, and its nanoseconds.
fn gps_time(
    source: &TimeSource,
    table: &Table,
    written_at: Option<i64>,
    repairs: &mut Vec<Repair>,
) -> Option<Values<i64>> {
    let TimeSource::GpsWeek { week, field, tick, nanos } = source else { return None };
    let logged = written_at.and_then(|unix| Some(gps_of_unix(Stamp(unix))?.0 / (WEEK_S * NANOS_PER_SECOND)));
    let (mut stamps, ten_bit) = gps_weeks(table.numbers(week)?, field, *tick, logged, table)?;
    let rule = if logged.is_some() { NEAREST_TO_LOG } else { NEAREST_TO_RELEASE };
    note_inferred(repairs, ten_bit, rule);
    if let Some(nanos) = nanos.as_ref().and_then(|nanos| table.numbers(nanos)) {
        stamps.change(|stamps| add(nanos, stamps));
    }
    Some(stamps)
}

const NO_ZONE: &str = "no time zone is stated; read as UTC";
const UNIX_STAMPS: &str = "read as UTC and not as a time since boot, which would be more than thirty years";
/// Longer than any uptime, and later than any log: 2001 to 2096, ns since 1970.
const UNIX_AND_NOT_BOOT: Range<i64> = 1_000_000_000 * NANOS_PER_SECOND..4_000_000_000 * NANOS_PER_SECOND;

/// Encodings of containers whose log time counts since boot.
const LOGGED_SINCE_BOOT: [&str; 2] = ["dataflash", "ulog"];

/// The clock of the timestamps. MAVLink's `time_usec` is "UNIX Epoch time or time since system boot", distinguished by
/// its size (<https://mavlink.io/en/messages/common.html>); the median of the rows decides for all of them.
fn clock_of(source: &TimeSource, table: &Table, nanos: &Values<i64>) -> Clock {
    let clock = source.clock();
    if matches!(source, TimeSource::ContainerLogged) && LOGGED_SINCE_BOOT.contains(&table.topic.encoding.as_str()) {
        return Clock::Boot;
    }
    if let TimeSource::DayOfYear { field, year, zone } = source {
        let stamps = days_of_year(field, *year, zone.as_deref(), table, &mut vec![]);
        return stamps.map_or(clock, |(clock, _)| clock);
    }
    if clock != Clock::Boot || table.topic.encoding != "mavlink" {
        return clock;
    }
    let mut stamps: Vec<i64> = nanos.given().collect();
    let middle = stamps.len() / 2;
    let median = (middle < stamps.len()).then(|| *stamps.select_nth_unstable(middle).1);
    if median.is_some_and(|median| UNIX_AND_NOT_BOOT.contains(&median)) { Clock::Unix } else { clock }
}

const NEAREST_TO_LOG: &str =
    "GPS weeks below 1024 are ten-bit counters: the week nearest to the date of the log's other clock is used";
const NEAREST_TO_RELEASE: &str = "GPS weeks below 1024 are ten-bit counters: the week nearest to this release is used";

fn note_inferred(repairs: &mut Vec<Repair>, count: u64, text: &'static str) {
    if count > 0 {
        repairs.push(Repair { what: Code::DateInferred.at(Severity::Warning), count, text: text.into() });
    }
}

/// The counters that a source may use.
fn counters_of(source: &TimeSource) -> Vec<Counter> {
    let TimeSource::Number { tick, clock: clock @ (Clock::Boot | Clock::Elapsed), bits, .. } = source else {
        let of_day = matches!(source, TimeSource::TimeOfDay { .. });
        return of_day.then_some(Counter { range: DAY_NS, tick: None }).into_iter().collect();
    };
    let wraps = matches!(tick, Tick::Millis | Tick::TenthMillis | Tick::Micros) || *bits < USUAL_BITS;
    let counter = tick.nanos().checked_mul(1 << bits).filter(|_| wraps);
    let of_days = [WEEK_S * NANOS_PER_SECOND, DAY_NS].into_iter().filter(|_| *clock == Clock::Elapsed);
    counter.into_iter().chain(of_days).map(|range| Counter { range, tick: Some(*tick) }).collect()
}

/// Whether the type of a column is wider than a counter that the map does not describe.
fn is_wide(source: &TimeSource, table: &Table) -> bool {
    const WITHOUT_TYPES: [&str; 2] = ["csv", "json"];
    let TimeSource::Number { field, bits: USUAL_BITS, .. } = source else { return false };
    let long = |column: &Column| matches!(column.data, ColumnData::I64(_) | ColumnData::U64(_));
    table.numbers(field).is_some_and(long) && !WITHOUT_TYPES.contains(&table.topic.encoding.as_str())
}

/// Corrects the known clock faults of a source. Returns the counter that wrapped around.
fn repair(
    source: &TimeSource,
    counters: &[Counter],
    nanos: &mut Values<i64>,
    repairs: &mut Vec<Repair>,
) -> Option<Counter> {
    let TimeSource::Number { clock, bits, .. } = source else {
        if matches!(source, TimeSource::GpsWeek { .. }) {
            note_inferred(repairs, redate_weeks(nanos), WEEK_OFF);
        }
        return None;
    };
    if !matches!(clock, Clock::Boot | Clock::Elapsed) {
        note_inferred(repairs, redate_weeks(nanos), WEEK_OFF);
        return None;
    }
    let days = if *clock == Clock::Elapsed { 2 } else { 0 };
    let names = std::iter::repeat_n(format!("the {bits}-bit counter"), counters.len().saturating_sub(days));
    let mut wrapped_at = None;
    for (counter, what) in counters.iter().zip(names.chain(["the time of week", "the time of day"].map(str::to_owned)))
    {
        let times = unwrap(nanos, counter.range);
        if times > 0 {
            wrapped_at = Some(*counter);
            let text = format!(
                "{what} wrapped around, and the timestamps continue; a restart shortly before the wrap would look \
                 the same"
            );
            repairs.push(Repair { what: Code::StampWrap.into(), count: times, text: text.into() });
        }
    }
    wrapped_at
}

const WEEK_OFF: &str = "timestamps a week away from their neighbours were corrected by a week";

fn nanos_of(source: &TimeSource, table: &Table, repairs: &mut Vec<Repair>) -> Option<Values<i64>> {
    let rows = 0..table.rows;
    Some(match source {
        TimeSource::ContainerLogged => table.logged_ns.clone()?.into(),
        // Writers without a publish time repeat the log time there.
        TimeSource::ContainerPublished if table.published_ns == table.logged_ns => return None,
        // Other messages of the log place it.
        TimeSource::LoggedOnBoot => return None,
        TimeSource::ContainerPublished => table.published_ns.clone()?.into(),
        TimeSource::Number { field, tick, zero_s, .. } => ticks(field, *tick, *zero_s, table)?,
        TimeSource::Iso { field, zone } => {
            let column = table.texts(field)?;
            let offset = zone.as_deref().unwrap_or("Z");
            rows.map(|row| local_to_unix_ns(column.text(row)?, offset)).collect()
        }
        TimeSource::GpsText { field } => {
            let column = table.texts(field)?;
            let gps = |row| {
                let text = column.text(row).filter(|text| !says_zone(text))?;
                local_to_unix_ns(text, "Z")?.checked_sub(GPS_EPOCH_UNIX_S * NANOS_PER_SECOND)
            };
            rows.map(gps).collect()
        }
        TimeSource::Civil { .. } => stamps_of_dates(source, table, repairs)?.into(),
        TimeSource::DayOfYear { field, year, zone } => days_of_year(field, *year, zone.as_deref(), table, repairs)?.1,
        TimeSource::TimeOfDay { field } => times_of_day(field, table, repairs)?,
        TimeSource::Calendar { fields, zone, .. } => {
            let columns: Vec<&Column> = fields.iter().map(|f| table.numbers(f)).collect::<Option<_>>()?;
            let east_ns = zone_ns(zone.as_deref());
            rows.map(|row| calendar(&columns, row)?.checked_sub(east_ns)).collect()
        }
        TimeSource::GpsWeek { week, field, tick, .. } => gps_weeks(table.numbers(week)?, field, *tick, None, table)?.0,
    })
}

/// A number of ticks for each row since `zero_s`.
fn ticks(field: &str, tick: Tick, zero_s: i64, table: &Table) -> Option<Values<i64>> {
    let rows = 0..table.rows;
    match (table.texts(field), table.numbers(field)) {
        (Some(text), _) => Some(rows.map(|row| tick.text_since(text.text(row)?, zero_s)).collect()),
        (None, Some(number)) => {
            let nanos = |row| match number.integer(row) {
                Some(integer) => tick.integer_since(integer, zero_s),
                None => tick.float_since(number.number(row)?, zero_s),
            };
            Some(rows.map(nanos).collect())
        }
        (None, None) => None,
    }
}

/// GPS time from a week and the time of week, and how many weeks were ten-bit counters. `logged` is the week in which
/// the log was written, if another clock gives it.
fn gps_weeks(week: &Column, field: &str, tick: Tick, logged: Option<i64>, table: &Table) -> Option<(Values<i64>, u64)> {
    let in_week = ticks(field, tick, 0, table)?;
    let count = WeekCount::of((0..table.rows).filter_map(|row| week.integer(row)), logged);
    let mut ten_bit = 0;
    let nanos = in_week.iter().enumerate().map(|(row, in_week)| {
        let in_week = in_week.filter(|ns| (0..WEEK_S * NANOS_PER_SECOND).contains(ns))?;
        let week = count.week(week.integer(row)?)?;
        ten_bit += u64::from(matches!(week, Week::TenBit(_)));
        Some(week.start_ns() + in_week)
    });
    let nanos = nanos.collect();
    Some((nanos, ten_bit))
}

/// Adds a column of nanoseconds; a row without nanoseconds has no timestamp.
fn add(nanos: &Column, stamps: &mut [Option<i64>]) {
    for (row, stamp) in stamps.iter_mut().enumerate() {
        *stamp = stamp.zip(nanos.integer(row)).and_then(|(stamp, nanos)| stamp.checked_add(nanos));
    }
}

/// Seconds may have a fraction where there is no column of nanoseconds.
fn calendar(columns: &[&Column], row: usize) -> Option<i64> {
    let (&[year, month, day, hour, minute, second], nanos) = columns.split_first_chunk::<6>()?;
    let (second, nanos) = match nanos {
        [nanos, ..] => (second.integer(row)?, nanos.integer(row)?),
        [] => {
            let seconds = second.number(row)?;
            let fraction = (seconds.rem_euclid(1.0) * NANOS_PER_SECOND as f64).round();
            (seconds.floor() as i64, fraction as i64)
        }
    };
    let whole = |column: &Column| column.integer(row);
    calendar_to_unix_ns([whole(year)?, whole(month)?, whole(day)?, whole(hour)?, whole(minute)?, second], nanos)
}

/// The tie of a clock to UTC, and its notices.
pub(super) struct Tied {
    pub(super) tie: UtcTie,
    /// UTC was computed from GPS time.
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

/// Timestamps of a clock with UTC, row by row.
pub(super) struct Pairs {
    clock: Clock,
    /// Topic and fields.
    source: String,
    /// Row, timestamp and UTC, ns.
    pairs: Vec<(usize, i64, i64)>,
    pub(super) from_gps: bool,
    pub(super) repairs: Vec<Repair>,
}

impl Pairs {
    /// The tie from the rows of each session; `None` for one without any.
    pub(super) fn ties(&self, sessions: usize, session_of: impl Fn(usize) -> Option<usize>) -> Vec<Option<UtcTie>> {
        let mut pairs = vec![vec![]; sessions];
        for (row, stamp, utc) in &self.pairs {
            let session = session_of(*row).and_then(|session| pairs.get_mut(session));
            session.into_iter().for_each(|pairs| pairs.push((*stamp, *utc)));
        }
        pairs.iter().map(|pairs| tie(self.clock, self.source.clone(), pairs)).collect()
    }
}

/// The tables in which a rule finds pairs, the closest name first.
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
        rule.require.iter().all(|r| table.numbers(&r.field).and_then(|c| c.number(row)).is_none_or(|v| is_met(r, v)))
    };
    if stamps.clock != rule.clock {
        return None;
    }
    let pair = |row: usize| {
        let unix = utc.clock.unix(Stamp(utc.nanos.get(row)?))?.0;
        Some((row, stamps.nanos.get(row)?, unix)).filter(|_| unix > NO_UTC_BEFORE_NS && meets(row))
    };
    let pairs = (0..table.rows).filter_map(pair).collect();
    let source = format!("{}: {} and {}", table.topic.name, stamps.label, utc.label);
    let repairs = stamps.repairs.into_iter().chain(utc.repairs).collect();
    Some(Pairs { clock: rule.clock, source, pairs, from_gps: utc.clock == Clock::Gps, repairs })
}

#[cfg(test)]
mod tests {
    use super::*;
    use formats::{Places, TopicInfo};

    const BOOT_NS: i64 = 60 * NANOS_PER_SECOND;
    const UNIX_NS: i64 = 1_700_000_000 * NANOS_PER_SECOND;

    fn table(encoding: &str) -> Table {
        let topic = TopicInfo { encoding: encoding.to_owned(), ..TopicInfo::default() };
        let origin = Places::default();
        Table { topic, rows: 0, logged_ns: None, published_ns: None, origin, columns: vec![] }
    }

    #[test]
    fn most_rows_decide_whether_a_mavlink_time_is_since_boot_or_since_1970() {
        let source = |clock| TimeSource::Number {
            field: "time_usec".to_owned(),
            tick: Tick::Micros,
            clock,
            zero_s: 0,
            bits: USUAL_BITS,
        };
        let clock = |stamped, encoding: &str, nanos: &[Option<i64>]| {
            clock_of(&source(stamped), &table(encoding), &nanos.to_vec().into())
        };
        let [boot, unix] = [Some(BOOT_NS), Some(UNIX_NS)];
        for (nanos, expected) in [
            (&[unix, unix, unix][..], Clock::Unix),
            (&[boot, boot, unix, unix, unix], Clock::Unix),
            (&[unix, boot, unix, None, None, None], Clock::Unix),
            (&[boot, boot, boot, unix, unix], Clock::Boot),
            (&[None, boot], Clock::Boot),
            (&[None], Clock::Boot),
            (&[], Clock::Boot),
            // Less than thirty years after 1970, and more than any log.
            (&[Some(999_999_999 * NANOS_PER_SECOND)], Clock::Boot),
            (&[Some(1_000_000_000 * NANOS_PER_SECOND)], Clock::Unix),
            (&[Some(4_000_000_000 * NANOS_PER_SECOND)], Clock::Boot),
        ] {
            assert_eq!(clock(Clock::Boot, "mavlink", nanos), expected, "{nanos:?}");
            assert_eq!(clock(Clock::Boot, "ulog", nanos), Clock::Boot);
            assert_eq!(clock(Clock::Elapsed, "mavlink", nanos), Clock::Elapsed);
        }
    }

    #[test]
    fn log_times_of_autopilots_count_since_boot() {
        for (encoding, expected) in
            [("dataflash", Clock::Boot), ("ulog", Clock::Boot), ("mavlink", Clock::Unix), ("cdr", Clock::Unix)]
        {
            assert_eq!(clock_of(&TimeSource::ContainerLogged, &table(encoding), &vec![UNIX_NS].into()), expected);
        }
    }
}
