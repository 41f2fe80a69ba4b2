//! Compares the result of a damaged log with that of the intact one.

use flight::Severity;
use ingest::{Column, ColumnData, Log, LogError, Table};
use std::collections::{BTreeMap, BTreeSet};

/// The difference that damage made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verdict {
    /// Same rows, bit for bit.
    Same,
    /// A loss is reported, or the log rejected.
    Reported,
    /// Nothing reported; one row has other values, or is in another table.
    OneRow,
    /// Nothing reported, and several rows differ; no row is missing.
    ManyRows,
    /// Nothing reported, and there are fewer rows.
    Fewer,
    /// Nothing reported, and there are more rows.
    More,
}

/// Notices that are not losses but still report the damage: a truncated last record, a wanted topic without
/// a usable definition, a last cell that may have lost digits, a file among several that is not a table or has no rows.
const TELLING: [&str; 4] = ["tail-cut", "not-decoded", "rejected-cell", "no-rows"];

/// Rows of all tables.
pub fn rows(log: &Log) -> usize {
    log.tables.iter().map(|table| table.rows).sum()
}

/// Whether damage is reported that the intact log does not have.
pub fn is_reported(read: &Result<Log, LogError>, intact: &Log) -> bool {
    read.as_ref().map_or(true, |log| losses(log) != losses(intact))
}

/// Kinds of losses and their counts.
fn losses(log: &Log) -> BTreeMap<&str, u64> {
    let mut losses = BTreeMap::new();
    for notice in log.notices.iter().filter(|n| n.severity == Severity::Loss || TELLING.contains(&n.code.as_str())) {
        *losses.entry(notice.code.as_str()).or_default() += notice.count;
    }
    losses
}

impl Verdict {
    pub fn of(read: &Result<Log, LogError>, intact: &Log) -> Verdict {
        let Ok(log) = read else { return Verdict::Reported };
        if is_reported(read, intact) {
            return Verdict::Reported;
        }
        // Rows that the intact log has count up, others down.
        let mut rows: BTreeMap<String, i64> = BTreeMap::new();
        rows_of(intact).for_each(|row| *rows.entry(row).or_default() += 1);
        rows_of(log).for_each(|row| *rows.entry(row).or_default() -= 1);
        let missing: i64 = rows.values().filter(|n| **n > 0).sum();
        let new: i64 = -rows.values().filter(|n| **n < 0).sum::<i64>();
        match (missing, new) {
            (0, 0) => Verdict::Same,
            (1, 1) => Verdict::OneRow,
            _ if missing == new => Verdict::ManyRows,
            _ if missing > new => Verdict::Fewer,
            _ => Verdict::More,
        }
    }
}

fn rows_of(log: &Log) -> impl Iterator<Item = String> {
    log.tables.iter().flat_map(|table| (0..table.rows).map(|row| as_text(table, row)))
}

/// The content of a row. A number is written by its value, whatever the type of its column: what a text
/// table takes a column for depends on all of its cells.
fn as_text(table: &Table, row: usize) -> String {
    let stamp = |stamps: &Option<Vec<i64>>| stamps.as_ref().map(|s| s[row]);
    let stamps = (stamp(&table.logged_ns), stamp(&table.published_ns));
    format!("{} {stamps:?} {}", table.topic.name, cells(table, row).join(" "))
}

fn cells(table: &Table, row: usize) -> Vec<String> {
    table.columns.iter().filter_map(|c| Some(format!("{}={}", c.path, cell(c, row)?))).collect()
}

fn cell(column: &Column, row: usize) -> Option<String> {
    if column.valid.as_ref().is_some_and(|valid| !valid[row]) {
        return None;
    }
    let number = |x: f64| if x.fract() == 0.0 && x.abs() < 9e15 { (x as i64).to_string() } else { format!("{x:?}") };
    Some(match &column.data {
        ColumnData::F64(v) => number(v[row]),
        ColumnData::U64(v) => v[row].to_string(),
        ColumnData::I64(v) => v[row].to_string(),
        ColumnData::Text(v) => {
            let text = v.get(row)?.to_string();
            let real = || text.parse().map_or_else(|_| text.clone(), number);
            text.parse().map_or_else(|_| real(), |integer: i64| integer.to_string())
        }
    })
}

/// A row of `log` that is not in `intact`.
pub fn first_unknown_row(log: &Log, intact: &Log) -> Option<String> {
    let known: BTreeSet<String> = rows_of(intact).collect();
    rows_of(log).find(|row| !known.contains(row))
}

/// The first row of `log` that differs from the same row of `intact`.
pub fn first_foreign_row(log: &Log, intact: &Log) -> Option<String> {
    log.tables.iter().filter(|t| t.rows > 0).find_map(|table| {
        let topic = &table.topic.name;
        let Some(whole) = intact.tables.iter().find(|t| t.topic == table.topic) else {
            return Some(format!("{topic} is a new topic"));
        };
        if table.rows > whole.rows {
            return Some(format!("{topic} has {} rows of {}", table.rows, whole.rows));
        }
        // The last cell of a text that ends inside it is skipped, as it may have lost digits.
        let cut_short = |row: usize| {
            let (cut, whole) = (cells(table, row), cells(whole, row));
            row + 1 == table.rows && cut.len() + 1 == whole.len() && cut.iter().all(|cell| whole.contains(cell))
        };
        let differs = |row: &usize| as_text(table, *row) != as_text(whole, *row) && !cut_short(*row);
        (0..table.rows)
            .find(differs)
            .map(|row| format!("row {row} of {topic} differs:\n{}\n{}", as_text(table, row), as_text(whole, row)))
    })
}
