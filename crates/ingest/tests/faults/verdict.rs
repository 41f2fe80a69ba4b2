//! What a damaged log gave, beside what the intact one gives.

use flight::Severity;
use ingest::{Column, ColumnData, IngestError, Log, Table};
use std::collections::BTreeMap;

/// The difference that damage made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verdict {
    /// Same rows, bit for bit.
    Same,
    /// A loss is told, or the log refused.
    Told,
    /// Nothing told; so many rows hold other values.
    Values(usize),
    /// Nothing told; as many rows as before, in tables of other names or columns.
    Renamed,
    /// Nothing told, and rows are missing or too many.
    Rows(i64),
}

/// Whether a loss is told.
pub fn told(log: &Log) -> bool {
    log.notices.iter().any(|n| n.severity == Severity::Loss)
}

impl Verdict {
    pub fn of(read: &Result<Log, IngestError>, intact: &Log) -> Verdict {
        let Ok(log) = read else { return Verdict::Told };
        if told(log) {
            return Verdict::Told;
        }
        let more = rows(log) as i64 - rows(intact) as i64;
        if more != 0 {
            return Verdict::Rows(more);
        }
        let same = |(a, b): (&Table, &Table)| a.topic == b.topic && a.rows == b.rows && paths(a).eq(paths(b));
        let pairs = || log.tables.iter().filter(|t| t.rows > 0).zip(intact.tables.iter().filter(|t| t.rows > 0));
        if log.tables.len() != intact.tables.len() || !pairs().all(same) {
            return Verdict::Renamed;
        }
        match pairs().map(|(a, b)| (0..a.rows).filter(|&row| !same_row(a, b, row)).count()).sum() {
            0 => Verdict::Same,
            changed => Verdict::Values(changed),
        }
    }
}

/// Rows of all tables.
pub fn rows(log: &Log) -> usize {
    log.tables.iter().map(|table| table.rows).sum()
}

fn paths(table: &Table) -> impl Iterator<Item = &str> {
    table.columns.iter().map(|c| c.path.as_str())
}

fn same_row(a: &Table, b: &Table, row: usize) -> bool {
    let at = |stamps: &Option<Vec<i64>>| stamps.as_ref().map(|s| s[row]);
    at(&a.logged_ns) == at(&b.logged_ns)
        && at(&a.published_ns) == at(&b.published_ns)
        && a.columns.iter().zip(&b.columns).all(|(a, b)| same_cell(a, b, row))
}

fn same_cell(a: &Column, b: &Column, row: usize) -> bool {
    let valid = |c: &Column| c.valid.as_ref().is_none_or(|v| v[row]);
    if valid(a) != valid(b) {
        return false;
    }
    !valid(a)
        || match (&a.data, &b.data) {
            (ColumnData::F64(a), ColumnData::F64(b)) => a[row].to_bits() == b[row].to_bits(),
            (ColumnData::I64(a), ColumnData::I64(b)) => a[row] == b[row],
            (ColumnData::Text(a), ColumnData::Text(b)) => a[row] == b[row],
            // A column whose only number is missing has no type of its own.
            _ => a.number(row) == b.number(row) && a.text(row) == b.text(row),
        }
}

/// The first row of `log` that is not the row of the same place in `intact`.
pub fn first_foreign_row(log: &Log, intact: &Log) -> Option<String> {
    let by_topic: BTreeMap<_, _> = intact.tables.iter().map(|t| (&t.topic, t)).collect();
    log.tables.iter().filter(|t| t.rows > 0).find_map(|table| {
        let topic = &table.topic.name;
        let Some(whole) = by_topic.get(&table.topic) else { return Some(format!("{topic} is a new topic")) };
        if table.rows > whole.rows {
            return Some(format!("{topic} has {} rows of {}", table.rows, whole.rows));
        }
        if !paths(table).eq(paths(whole)) {
            return Some(format!("{topic} has other columns"));
        }
        (0..table.rows).find(|&row| !same_row(table, whole, row)).map(|row| format!("{topic}: row {row} differs"))
    })
}
