//! The time of each row of a table as far as the log itself states it: for tables whose rows have no log time, or one
//! by a clock that restarted.

use super::plan::Plan;
use super::restarts::{self, Joined};
use super::stamp_columns::{NO_UTC_BEFORE_NS, Stamps, tie_of};
use super::trial::{Trial, stamps_of};
use super::wraps;
use crate::error::IngestError;
use crate::map::{ChannelMap, ChannelRule, MapLibrary};
use flight::{Clock, Notices, Stamp, UtcTie};
use formats::{Column, Log, Places, Table, Values};
use std::collections::HashSet;
use std::rc::Rc;

/// The times of a log's rows, by the channel map that fits it best.
#[derive(Debug, Default)]
pub struct RowTimes {
    /// For each table of the log, in order; `None` where no timestamp is found, and for tables whose rows the container
    /// logged, unless its clock since boot restarted: then its timestamps on the clock of the first session.
    pub tables: Vec<Option<TableTimes>>,
    /// The tie to UTC of a clock of the log that does not count UTC.
    pub utc: Option<UtcTie>,
    /// Corrections of timestamps.
    pub notices: Notices,
}

/// The times of the rows of one table.
#[derive(Debug, Clone, PartialEq)]
pub struct TableTimes {
    /// The clock.
    pub clock: Clock,
    /// The fields that they were read from.
    pub source: String,
    /// For each row. Counters that wrap around are unwrapped.
    pub nanos: Values<i64>,
}

/// Finds the times of all rows. The map is the one that [`bind`](crate::bind) would choose, or the nearest one if none
/// fits. Its timestamp sources for its own topics are tried on the other tables too, because all messages of a receiver
/// have them alike. Dated timestamps come before others.
///
/// # Errors
/// [`IngestError::Map`] for a library that cannot be used.
pub fn row_times(log: &Log, library: &MapLibrary) -> Result<RowTimes, IngestError> {
    let trials = Trial::of_all(&library.candidates(None)?, log);
    let best = trials.into_iter().filter(|t| !t.plans.is_empty()).max_by_key(Trial::rank);
    let Some(Trial { map, mut plans, .. }) = best else { return Ok(without_map(log, library)) };
    let stamps = |table: &Table| {
        let exact = exact(log, library, table);
        let table = exact.as_ref().unwrap_or(table);
        times_of(map, table).or_else(|| dated_by_any(library, table))
    };
    let of_rows = |table: &Table| {
        let mut own = if table.logged_ns.is_none() { stamps(table)? } else { return None };
        let of_table = plans.iter().filter(|plan| std::ptr::eq(plan.table, table));
        of_table.flat_map(|plan| &plan.stamps).for_each(|other| own.share(other));
        Some(own)
    };
    let mut of_tables: Vec<Option<Stamps>> = log.tables.iter().map(of_rows).collect();
    align(&mut plans, log, &mut of_tables);
    let notices = repairs(log, &of_tables);
    let joined = restarts::join(&plans, &map.ties, log);
    drop(plans);
    let times = |(table, stamps): (&Table, Option<Stamps>)| match (&table.logged_ns, &joined) {
        (None, _) => stamps.map(TableTimes::of),
        (Some(logged), Some(joined)) => Some(joined_times(joined, table, logged)),
        (Some(_), None) => None,
    };
    let tables = log.tables.iter().zip(of_tables).map(times).collect();
    let tied = match joined {
        Some(joined) => joined.into_tie(),
        None => tie_of(&map.ties, log),
    };
    Ok(RowTimes { tables, utc: tied.map(|tied| tied.tie), notices })
}

/// The times of a log in which no map finds anything.
fn without_map(log: &Log, library: &MapLibrary) -> RowTimes {
    let dated = |table| dated_by_any(library, exact(log, library, table).as_ref().unwrap_or(table));
    let stamps: Vec<Option<Stamps>> = log.tables.iter().map(dated).collect();
    let notices = repairs(log, &stamps);
    let tables = stamps.into_iter().map(|stamps| stamps.map(TableTimes::of)).collect();
    RowTimes { tables, utc: None, notices }
}

/// Aligns the timestamps of each table with the wrap count that [`bind`](crate::bind) gives its channels, and then
/// tables without channels with the others.
fn align(plans: &mut [Plan<'_>], log: &Log, stamps: &mut [Option<Stamps>]) {
    let bound: Vec<bool> = log.tables.iter().map(|table| plans.iter().any(|p| p.table.topic == table.topic)).collect();
    let of_plans = plans.iter_mut().flat_map(|plan| &mut plan.stamps);
    let of_bound = stamps.iter_mut().zip(bound).filter(|(_, bound)| *bound).filter_map(|(stamps, _)| stamps.as_mut());
    wraps::align(of_plans.chain(of_bound));
    wraps::align(stamps.iter_mut().flatten());
}

/// The corrections of the tables' own timestamps.
fn repairs(log: &Log, stamps: &[Option<Stamps>]) -> Notices {
    let mut notices = Notices::new();
    for (table, stamps) in log.tables.iter().zip(stamps).filter_map(|(table, stamps)| Some((table, stamps.as_ref()?))) {
        for repair in &stamps.repairs {
            // Timestamps are aligned first with the channels and then with all tables, so a repair may occur twice.
            let mut of_repair = Notices::new();
            let text = format!("timestamps in {}: {}", stamps.label, repair.text);
            of_repair.push(repair.what, table.topic.name.as_str(), repair.count, text);
            notices.extend_unsaid(of_repair);
        }
    }
    notices
}

/// A table with its large decimals as written, if it has any, and otherwise the columns that maps know.
fn exact(log: &Log, library: &MapLibrary, table: &Table) -> Option<Table> {
    let written = log.written.iter().filter(|(topic, _)| *topic == table.topic).map(|(_, column)| column);
    let mut columns: Vec<Column> = written.cloned().collect();
    if columns.is_empty() {
        return None;
    }
    let known: HashSet<String> =
        library.iter().flat_map(|map| &map.rules).flat_map(ChannelRule::requests).map(|r| r.path).collect();
    columns.extend(table.columns.iter().filter(|column| known.contains(&column.path)).cloned());
    let Table { topic, rows, .. } = table;
    Some(Table {
        topic: topic.clone(),
        rows: *rows,
        logged_ns: None,
        published_ns: None,
        origin: Places::default(),
        columns,
    })
}

/// The container's timestamps, with all sessions on the clock of the first.
fn joined_times(joined: &Joined, table: &Table, logged: &[i64]) -> TableTimes {
    let mut nanos: Vec<Option<i64>> = logged.iter().copied().map(Some).collect();
    joined.shift(table, Clock::Boot, &mut nanos);
    TableTimes { clock: Clock::Boot, source: "log".to_owned(), nanos: nanos.into() }
}

/// From the rules made for the table, then from all others.
fn times_of(map: &ChannelMap, table: &Table) -> Option<Stamps> {
    let own = map.rules.iter().filter(|rule| rule.meets(&table.topic).is_some());
    let found =
        own.chain(&map.rules).filter_map(|rule| stamps_of(rule, table, |_| None).ok()).flat_map(|(stamps, _)| stamps);
    let mut first = None;
    for stamps in found {
        if matches!(stamps.clock, Clock::Unix | Clock::Gps) {
            return Some(stamps);
        }
        first.get_or_insert(stamps);
    }
    first
}

/// Timestamps by any map's sources, for tables that no map reads further. Only dates count: a column may be named like
/// a timestamp and not be one.
fn dated_by_any(library: &MapLibrary, table: &Table) -> Option<Stamps> {
    if table.logged_ns.is_some() {
        return None;
    }
    let maps = library.candidates(None).unwrap_or_default();
    let found = maps.iter().flat_map(|map| &map.rules).filter_map(|rule| stamps_of(rule, table, |_| None).ok());
    found.flat_map(|(stamps, _)| stamps).find(is_dated)
}

/// Whether timestamps are UTC or GPS time, and of this century.
fn is_dated(stamps: &Stamps) -> bool {
    let unix = |ns: i64| stamps.clock.unix(Stamp(ns)).is_some_and(|unix| unix.0 > NO_UTC_BEFORE_NS);
    stamps.nanos.given().all(unix) && stamps.nanos.given().next().is_some()
}

impl TableTimes {
    fn of(stamps: Stamps) -> TableTimes {
        TableTimes { clock: stamps.clock, source: stamps.label, nanos: Rc::unwrap_or_clone(stamps.nanos) }
    }
}
