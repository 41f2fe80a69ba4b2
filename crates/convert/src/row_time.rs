//! The time of each row of a log: from the container's timestamps, from fields of the row, or from its position alone.

use crate::error::ConvertError;
use flight::{Clock, Code, NANOS_PER_SECOND, Notices, Severity, Stamp, StampKind, UtcTie};
use ingest::{Log, MapLibrary, RowTimes, Table, TableTimes, Values, row_times};
use std::collections::{BTreeMap, HashMap};

/// Across a 32-bit wraparound, successive timestamps are within this time of each other, ns.
const CLOSE_NS: i64 = 60 * NANOS_PER_SECOND;
/// Ranges of 32-bit counters of microseconds and of milliseconds, ns.
const RANGES_NS: [i64; 2] = [1000 << 32, 1_000_000 << 32];

/// The times of all rows of a log.
pub(crate) struct LogTimes {
    /// One for each table, in the order of the log.
    pub(crate) tables: Vec<RowTime>,
    /// UTC tie of a log clock that does not know UTC.
    pub(crate) utc: Option<UtcTie>,
    /// Rows whose timestamps were unwrapped because the log's 32-bit counter wrapped around.
    run_on: u64,
    /// Corrections made to row timestamps.
    repairs: Notices,
}

/// The times of the rows of a table.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct RowTime {
    basis: Basis,
    /// In the clock of the basis, ns.
    own_ns: Values<i64>,
    /// UTC as Unix counts, ns; `None` where the clock has no tie to UTC.
    utc_ns: Option<Values<i64>>,
}

/// The source of the times.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Basis {
    /// Timestamps of the container.
    Log(Clock),
    /// Fields of the rows.
    Fields(Clock, String),
    /// This table has no times, but others do: the first time in the log.
    Begin,
    /// No table has times: the line or row number, as nanoseconds.
    Order,
}

/// The container's timestamps of a table's rows, ns, and their clock.
type Logged = (Clock, Vec<i64>);

/// The log time of each row in the MCAP.
pub(crate) struct LogTime {
    pub(crate) nanos: Vec<i64>,
    /// Description for people.
    pub(crate) how: String,
    /// Rows without a time of their own: they take that of the previous row, the first ones that of the next row.
    pub(crate) lent: u64,
    /// Only the order is known.
    pub(crate) by_order: bool,
    /// The container's own timestamps, unchanged.
    pub(crate) as_logged: bool,
}

/// Determines the times of all rows of a log.
pub(crate) fn of_log(log: &Log, library: &MapLibrary) -> Result<LogTimes, ConvertError> {
    let RowTimes { tables, utc, notices: repairs } = row_times(log, library)?;
    let (logged, run_on) = logged(log);
    let time = |((table, fields), logged)| RowTime::of(table, logged, fields, utc.as_ref());
    let mut tables: Vec<RowTime> = log.tables.iter().zip(tables).zip(logged).map(time).collect();
    let begin =
        tables.iter().filter(|t| t.basis != Basis::Order).filter_map(|t| t.in_utc().nanos.into_iter().min()).min();
    for time in tables.iter_mut().filter(|t| t.basis == Basis::Order) {
        time.begin_at(begin);
    }
    Ok(LogTimes { tables, utc, run_on, repairs })
}

impl LogTimes {
    /// Reports where times differ from the log's own.
    pub(crate) fn note(&self, notices: &mut Notices) {
        notices.extend(self.repairs.clone());
        if self.run_on > 0 {
            let text = "rows after the wrap of the log's 32-bit counter; their log_time continues";
            notices.push(Code::StampWrap.at(Severity::Info), "", self.run_on, text);
        }
    }
}

/// The container's timestamps of each table, unwrapped after a 32-bit wraparound, and the number of rows after one.
fn logged(log: &Log) -> (Vec<Option<Logged>>, u64) {
    let mut clocks: HashMap<[&str; 3], Clock> = HashMap::new();
    for topic in &log.health.topics {
        if let Some(stamps) = topic.stamps.iter().find(|s| s.kind == StampKind::Logged) {
            clocks.insert([&topic.name, &topic.type_name, &topic.encoding], stamps.clock);
        }
    }
    let clock_of = |table: &Table| {
        let topic = &table.topic;
        let clock = clocks.get(&[topic.name.as_str(), topic.type_name.as_str(), topic.encoding.as_str()]);
        clock.copied().unwrap_or(Clock::Unix)
    };
    let mut logged: Vec<Option<Logged>> =
        log.tables.iter().map(|table| Some((clock_of(table), table.logged_ns.clone()?))).collect();
    let of_boot = logged.iter_mut().flatten().filter(|(clock, _)| *clock == Clock::Boot);
    let run_on = unwrap(&mut of_boot.map(|(_, stamps)| stamps).collect::<Vec<_>>());
    (logged, run_on)
}

impl RowTime {
    fn of(table: &Table, logged: Option<Logged>, fields: Option<TableTimes>, tie: Option<&UtcTie>) -> RowTime {
        let (basis, own_ns, joined_ns) = match (logged, fields) {
            (Some((clock, stamps)), fields) => {
                // If the clock restarted: all sessions, on the clock of the first.
                let joined = fields.filter(|fields| fields.clock == clock).map(|fields| fields.nanos);
                (Basis::Log(clock), stamps.into(), joined)
            }
            (None, Some(TableTimes { clock, source, nanos })) => (Basis::Fields(clock, source), nanos, None),
            (None, None) => {
                let place = |row| i64::try_from(table.origin_of(row)).ok();
                (Basis::Order, (0..table.rows).map(place).collect(), None)
            }
        };
        let utc_ns = basis.clock().and_then(|clock| utc_of(clock, joined_ns.as_ref().unwrap_or(&own_ns), tie));
        RowTime { basis, own_ns, utc_ns }
    }

    /// Puts rows without any time at the start of the log, if that is known.
    fn begin_at(&mut self, begin: Option<i64>) {
        if let Some(begin) = begin {
            self.basis = Basis::Begin;
            self.own_ns = vec![begin; self.own_ns.len()].into();
        }
    }

    /// Clock of the container's timestamps of the rows.
    pub(crate) fn logged_by(&self) -> Option<Clock> {
        if let Basis::Log(clock) = self.basis { Some(clock) } else { None }
    }

    /// UTC of each row, unless the container's timestamps already are UTC or it is unknown.
    pub(crate) fn utc_beside(&self) -> Option<&Values<i64>> {
        if self.basis == Basis::Log(Clock::Unix) { None } else { self.utc_ns.as_ref() }
    }

    /// UTC where known, otherwise the log's own clock.
    pub(crate) fn in_utc(&self) -> LogTime {
        self.log_time(self.utc_ns.as_ref().unwrap_or(&self.own_ns), self.how_in_utc())
    }

    /// Description of [`RowTime::in_utc`] for people.
    pub(crate) fn how_in_utc(&self) -> String {
        if self.utc_ns.is_some() { self.basis.in_utc() } else { self.basis.on_its_own() }
    }

    /// The container's timestamps unchanged; for rows without, as [`RowTime::in_utc`].
    pub(crate) fn as_logged(&self) -> LogTime {
        match self.basis {
            Basis::Log(_) => self.log_time(&self.own_ns, self.basis.on_its_own()),
            _ => self.in_utc(),
        }
    }

    fn log_time(&self, nanos: &Values<i64>, how: String) -> LogTime {
        let (nanos, lent) = fill_gaps(nanos);
        let (by_order, as_logged) = (self.basis.clock().is_none(), matches!(self.basis, Basis::Log(_)));
        LogTime { nanos, how, lent, by_order, as_logged }
    }
}

impl Basis {
    fn clock(&self) -> Option<Clock> {
        match self {
            Basis::Log(clock) | Basis::Fields(clock, _) => Some(*clock),
            Basis::Begin | Basis::Order => None,
        }
    }

    fn source(&self) -> &str {
        match self {
            Basis::Log(_) => "the log's timestamps",
            Basis::Fields(_, source) => source,
            Basis::Begin => "the first time in the log",
            Basis::Order => "the order of the rows",
        }
    }

    fn in_utc(&self) -> String {
        format!("UTC: {}{}", self.source(), self.clock().map_or("", way_to_utc))
    }

    fn on_its_own(&self) -> String {
        match self.clock() {
            Some(Clock::Unix) => self.in_utc(),
            Some(clock) => format!("{}, clock {clock}, not UTC", self.source()),
            None if *self == Basis::Begin => self.source().to_owned(),
            None => "only the order of the rows, counted in nanoseconds".to_owned(),
        }
    }
}

/// How UTC is derived from a clock, as a suffix to its source.
pub(crate) fn way_to_utc(clock: Clock) -> &'static str {
    match clock {
        Clock::Unix => "",
        Clock::Gps => ", GPS time minus leap seconds",
        Clock::Boot | Clock::Elapsed => ", by the tie of that clock to UTC",
    }
}

/// UTC of timestamps of this clock; `None` without a tie.
pub(crate) fn utc_of(clock: Clock, nanos: &Values<i64>, tie: Option<&UtcTie>) -> Option<Values<i64>> {
    let tie = tie.filter(|tie| tie.clock == clock);
    let unix = |ns: i64| clock.unix(Stamp(ns)).or_else(|| tie?.unix(Stamp(ns))).map(|stamp| stamp.0);
    let utc: Values<i64> = nanos.iter().map(|ns| unix(ns?)).collect();
    let any = utc.given().next().is_some();
    any.then_some(utc)
}

/// A time for every row, and the number of rows that had none.
fn fill_gaps(nanos: &Values<i64>) -> (Vec<i64>, u64) {
    let mut last = nanos.given().next().unwrap_or_default();
    let lent = nanos.iter().filter(|ns| ns.is_none()).count() as u64;
    let whole = nanos.iter().map(|ns| {
        last = ns.unwrap_or(last);
        last
    });
    (whole.collect(), lent)
}

/// Reports how rows without container timestamps are timed, and returns all topics grouped by their source of time.
pub(crate) fn report<'t>(
    times: impl Iterator<Item = (&'t str, &'t LogTime)>,
    notices: &mut Notices,
) -> BTreeMap<String, Vec<String>> {
    let mut topics: BTreeMap<String, Vec<String>> = BTreeMap::new();
    // Number of rows, and of those that borrow a time.
    let mut reported: BTreeMap<&str, (u64, u64, bool)> = BTreeMap::new();
    for (topic, time) in times {
        topics.entry(time.how.clone()).or_default().push(topic.to_owned());
        if !time.as_logged {
            let (rows, lent, _) = reported.get(time.how.as_str()).copied().unwrap_or_default();
            reported.insert(&time.how, (rows + time.nanos.len() as u64, lent + time.lent, time.by_order));
        }
    }
    for (how, (rows, lent, by_order)) in reported {
        let severity = if by_order { Severity::Warning } else { Severity::Info };
        let known = match by_order {
            true => "no timestamp of these rows is known without a channel map; their columns are kept as fields",
            false => "the log has no timestamps for these rows",
        };
        let text = format!("{known}; log_time is {how}");
        let of_topics = topics.get(how).map_or(&[][..], Vec::as_slice);
        notices.push(Code::ValuesReplaced.at(severity), place(of_topics), rows, text);
        if lent > 0 {
            let text = "rows without a time get that of the row before; rows before the first time get that of the \
                next row";
            notices.push(Code::ValuesReplaced, place(of_topics), lent, text);
        }
    }
    topics
}

fn place(topics: &[String]) -> String {
    match topics {
        [] => String::new(),
        [one] => format!("topic {one}"),
        [first, more @ ..] => format!("topic {first} and {} more", more.len()),
    }
}

/// Unwraps timestamps after a 32-bit wraparound; tables in the order of the log, each in its own order.
///
/// At least one table must show it: a step back by nearly the whole range. Tables with too few rows to show it are
/// placed relative to the start of the log. Leading zeros are those of records before the first timestamp. Returns the
/// number of timestamps changed.
fn unwrap(tables: &mut [&mut Vec<i64>]) -> u64 {
    for range in RANGES_NS {
        if tables.iter().any(|t| t.iter().any(|ns| !(0..range).contains(ns))) {
            continue;
        }
        let wraps = |t: &[i64]| t.windows(2).any(|pair| matches!(pair, [a, b] if b - a + range <= CLOSE_NS));
        let begin = tables.iter().filter(|t| wraps(t)).filter_map(|t| t.iter().find(|ns| **ns > 0)).min();
        let Some(begin) = begin.copied() else { continue };
        return tables.iter_mut().map(|table| unwrap_table(table, begin, range)).sum();
    }
    0
}

/// Unwraps the timestamps of one table in a log that starts at `begin`.
fn unwrap_table(stamps: &mut [i64], begin: i64, range: i64) -> u64 {
    let (mut wraps, mut before, mut changed) = (0_i64, None, 0);
    for stamp in stamps.iter_mut().skip_while(|ns| **ns == 0) {
        let raw = *stamp;
        let step = before.map_or(0, |before: i64| raw - before);
        if before.is_none() && raw < begin - CLOSE_NS {
            wraps = 1;
        } else if step < -range / 2 {
            wraps += 1;
        } else if step > range / 2 && wraps > 0 {
            wraps -= 1;
        }
        before = Some(raw);
        changed += u64::from(wraps > 0);
        *stamp = raw.saturating_add(wraps.saturating_mul(range));
    }
    changed
}

#[cfg(test)]
mod tests {
    use super::*;
    use ingest::TopicInfo;

    const MS: i64 = 1_000_000;

    fn wrapped(ms: &[i64]) -> Vec<i64> {
        ms.iter().map(|ms| (ms & 0xffff_ffff) * MS).collect()
    }

    fn whole(ms: &[i64]) -> Vec<i64> {
        ms.iter().map(|ms| ms * MS).collect()
    }

    #[test]
    fn stamps_are_unwrapped_also_in_tables_too_sparse_to_show_it() {
        let end = 1 << 32;
        // The second has rows far before and after, the third only one after, the fourth only one before.
        let truth: [Vec<i64>; 4] = [
            (end - 300_000..end + 300_000).step_by(200).collect(),
            vec![end - 290_000, end + 100_000],
            vec![end + 5000],
            vec![end - 5000],
        ];
        let mut tables: Vec<Vec<i64>> = truth.iter().map(|ms| wrapped(ms)).collect();
        tables.push([vec![0, 0], wrapped(&[end - 300_000, end + 1])].concat());
        unwrap(&mut tables.iter_mut().collect::<Vec<_>>());
        assert_eq!(tables[..4], truth.map(|ms| whole(&ms)));
        assert_eq!(tables[4], [vec![0, 0], whole(&[end - 300_000, end + 1])].concat());
    }

    #[test]
    fn other_backward_clock_steps_are_left_alone() {
        let tables = [vec![5 * MS, 3 * MS, 90_000_000 * MS, 0], vec![1, i64::MAX, 2], vec![]];
        for table in tables {
            let mut same = table.clone();
            unwrap(&mut [&mut same]);
            assert_eq!(same, table);
        }
    }

    #[test]
    fn a_row_without_a_time_takes_its_neighbours_and_is_counted() {
        assert_eq!(fill_gaps(&vec![None, Some(7), None, Some(5), None].into()), (vec![7, 7, 7, 5, 5], 3));
        assert_eq!(fill_gaps(&vec![None, None].into()), (vec![0, 0], 2));
    }

    #[test]
    fn rows_without_any_time_are_in_line_order_with_a_warning() {
        let table = Table {
            topic: TopicInfo::default(),
            rows: 3,
            logged_ns: None,
            published_ns: None,
            origin: ingest::Places::from_iter([2, 4, 5]),
            columns: vec![],
        };
        let time = RowTime::of(&table, None, None, None).in_utc();
        assert_eq!((time.nanos.as_slice(), time.by_order), (&[2, 4, 5][..], true));
        let mut notices = Notices::new();
        report([("a", &time), ("b", &time)].into_iter(), &mut notices);
        let notice = notices.iter().next().unwrap();
        assert_eq!(
            (notice.severity, notice.count, notice.place.as_str()),
            (Severity::Warning, 6, "topic a and 1 more")
        );
    }

    #[test]
    fn rows_that_borrow_a_time_are_counted_over_all_topics_of_the_source() {
        let table = Table {
            topic: TopicInfo::default(),
            rows: 4,
            logged_ns: None,
            published_ns: None,
            origin: ingest::Places::default(),
            columns: vec![],
        };
        let of_fields = |clock, nanos: Vec<Option<i64>>| {
            let fields = TableTimes { clock, source: "t".to_owned(), nanos: nanos.into() };
            RowTime::of(&table, None, Some(fields), None).in_utc()
        };
        let two_lent = of_fields(Clock::Unix, vec![None, Some(7), None, Some(9)]);
        let one_lent = of_fields(Clock::Unix, vec![Some(7), Some(8), None, Some(9)]);
        let complete = of_fields(Clock::Boot, vec![Some(1), Some(2), Some(3), Some(4)]);
        let logged = RowTime::of(&table, Some((Clock::Unix, vec![1, 2, 3, 4])), None, None).in_utc();
        let mut notices = Notices::new();
        let times = [("a", &two_lent), ("b", &one_lent), ("c", &complete), ("d", &logged)];
        let topics = report(times.into_iter(), &mut notices);
        let sources = [
            ("UTC: t", vec!["a", "b"]),
            ("UTC: the log's timestamps", vec!["d"]),
            ("t, clock since boot, not UTC", vec!["c"]),
        ];
        assert_eq!(
            topics
                .iter()
                .map(|(how, of)| (how.as_str(), of.iter().map(String::as_str).collect()))
                .collect::<Vec<(_, Vec<_>)>>(),
            sources
        );
        let reported: Vec<_> =
            notices.iter().map(|n| (n.place.as_str(), n.count, n.text.split(';').next().unwrap())).collect();
        let without = "the log has no timestamps for these rows";
        let mut expected = [
            ("topic a and 1 more", 8, without),
            ("topic a and 1 more", 3, "rows without a time get that of the row before"),
            ("topic c", 4, without),
        ];
        let mut reported = reported;
        reported.sort_unstable();
        expected.sort_unstable();
        assert_eq!(reported, expected);
    }

    #[test]
    fn after_a_clock_restart_each_session_has_its_own_utc() {
        let table = Table {
            topic: TopicInfo::default(),
            rows: 3,
            logged_ns: None,
            published_ns: None,
            origin: ingest::Places::default(),
            columns: vec![],
        };
        let spread_s = ingest::stamps::distribution(&[0.0]).unwrap();
        let tie =
            UtcTie { clock: Clock::Boot, source: String::new(), offset_ns: 1000, spread_s, pairs: 1, outliers: 0 };
        let joined =
            TableTimes { clock: Clock::Boot, source: "log".to_owned(), nanos: vec![Some(5), Some(700), None].into() };
        let time = RowTime::of(&table, Some((Clock::Boot, vec![5, 20, 30])), Some(joined), Some(&tie));
        assert_eq!(time.utc_beside(), Some(&vec![Some(1005), Some(1700), None].into()));
        assert_eq!(time.as_logged().nanos, [5, 20, 30]);
    }

    #[test]
    fn gps_time_becomes_utc_by_leap_seconds_and_boot_time_by_its_tie() {
        // 2026-11-22 00:00:00 UTC is 18 s into GPS week 2446.
        let gps = (2446 * 604_800 + 18) * NANOS_PER_SECOND;
        let unix = 1_795_305_600 * NANOS_PER_SECOND;
        assert_eq!(utc_of(Clock::Gps, &vec![Some(gps), None].into(), None), Some(vec![Some(unix), None].into()));
        assert_eq!(utc_of(Clock::Boot, &vec![gps].into(), None), None);
    }
}
