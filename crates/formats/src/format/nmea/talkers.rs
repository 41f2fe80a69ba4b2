//! Receivers that change their talker: `GP` while only GPS satellites are used, `GN` with others as well. Sentences
//! of one type under several addresses become one topic, named after the type alone.

use super::kind::Kind;
use crate::reader::Log;
use crate::table::{Column, ColumnData, Places, Table, TopicInfo};
use crate::texts::Texts;
use flight::{Code, Graded, Notices, Severity};
use std::collections::BTreeMap;

/// Satellite systems, single and combined.
const TALKERS: [&str; 8] = ["BD", "GA", "GB", "GI", "GL", "GN", "GP", "GQ"];
/// Timestamps that distinguish epochs; the first one that a table has is used.
const STAMPS: [&str; 2] = ["elapsed_ns", "utc_ns"];
/// Column with the talker of each row.
const TALKER: &str = "talker";

/// Merges the topics that one receiver sent under changing addresses.
pub(super) fn unite(log: &mut Log) {
    let mut by_type: BTreeMap<String, Vec<Table>> = BTreeMap::new();
    let (ours, mut tables): (Vec<Table>, Vec<Table>) = std::mem::take(&mut log.tables).into_iter().partition(is_said);
    ours.into_iter().for_each(|table| by_type.entry(table.topic.type_name.clone()).or_default().push(table));
    for (name, said) in by_type {
        let speech = if said.len() < 2 { Speech::AtOnce } else { Speech::of(&said) };
        report(&name, speech, &said, &mut log.notices);
        if speech == Speech::InTurn {
            of_health(&name, &said, log);
            tables.push(united(name, &said));
        } else {
            tables.extend(said);
        }
    }
    tables.sort_by(|a, b| a.topic.cmp(&b.topic));
    log.tables = tables;
}

/// Whether the topic belongs to a satellite system, has a type that is read, and has a time.
fn is_said(table: &Table) -> bool {
    let talker = table.topic.name.strip_suffix(&table.topic.type_name);
    let read = table.topic.encoding == "nmea" && Kind::of(&table.topic.type_name).is_some();
    read && talker.is_some_and(|t| TALKERS.contains(&t)) && stamps(table).next().is_some()
}

fn stamps(table: &Table) -> impl Iterator<Item = i64> + '_ {
    let column = STAMPS.iter().find_map(|path| table.column(path));
    column.into_iter().flat_map(|column| (0..table.rows).filter_map(|row| column.integer(row)))
}

/// How the talkers of a type alternate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Speech {
    /// Each epoch has one talker, and epochs are no closer together than those of each talker: it is one receiver.
    InTurn,
    /// No epoch has two talkers, but epochs are closer than those of each: there may be several receivers.
    Between,
    /// Epochs have several talkers: one receiver sends one per system. Or there is only one talker.
    AtOnce,
}

impl Speech {
    fn of(tables: &[Table]) -> Speech {
        let least = |sorted: &[i64]| sorted.windows(2).filter_map(|pair| Some(pair.last()? - pair.first()?)).min();
        let (mut all, mut own_least) = (vec![], i64::MAX);
        for table in tables {
            let mut own: Vec<i64> = stamps(table).collect();
            own.sort_unstable();
            own.dedup();
            own_least = own_least.min(least(&own).unwrap_or(i64::MAX));
            all.extend(own);
        }
        all.sort_unstable();
        match least(&all) {
            None | Some(..=0) => Speech::AtOnce,
            // Tolerance for a rounded timestamp.
            Some(least) if own_least == i64::MAX || least >= own_least / 4 * 3 => Speech::InTurn,
            Some(_) => Speech::Between,
        }
    }
}

fn talker(table: &Table) -> &str {
    table.topic.name.strip_suffix(&table.topic.type_name).unwrap_or_default()
}

fn report(name: &str, speech: Speech, tables: &[Table], notices: &mut Notices) {
    let said: Vec<String> = tables.iter().map(|table| format!("{} ({})", table.topic.name, table.rows)).collect();
    let (said, rows) = (said.join(", "), tables.iter().map(|table| table.rows as u64).sum());
    let mut say = |what: Graded, text| notices.push(what, name, rows, text);
    match speech {
        Speech::InTurn => {
            let text = format!(
                "the receiver changed its talker ID: the sentences of {said} are joined into one \
                topic"
            );
            say(Code::SeveralSources.into(), text);
        }
        Speech::Between => {
            let text = format!(
                "{said} have different times and may be of several receivers: a channel uses only one \
                of them"
            );
            say(Code::SeveralSources.at(Severity::Warning), text);
        }
        Speech::AtOnce => {}
    }
}

/// One entry in place of several.
fn of_health(name: &str, tables: &[Table], log: &mut Log) {
    let is_one = |topic: &str| tables.iter().any(|table| table.topic.name == topic);
    let topics = std::mem::take(&mut log.health.topics);
    let (ours, mut topics): (Vec<_>, Vec<_>) =
        topics.into_iter().partition(|t| t.encoding == "nmea" && is_one(&t.name));
    let one = ours.into_iter().reduce(|mut one, other| {
        one.messages += other.messages;
        one.payload_bytes += other.payload_bytes;
        one
    });
    topics.extend(one.map(|one| flight::TopicHealth { name: name.to_owned(), ..one }));
    topics.sort_by(|a, b| a.name.cmp(&b.name));
    log.health.topics = topics;
}

/// The rows of all tables, each as its table and row number: those of a table keep their order, and are interleaved
/// by timestamp, which is the order of the log.
fn in_order(tables: &[Table]) -> Vec<(usize, usize)> {
    let mut rows: Vec<(i64, usize, usize)> = vec![];
    for (at, table) in tables.iter().enumerate() {
        let stamps = STAMPS.iter().find_map(|path| table.column(path));
        let mut last = i64::MIN;
        for row in 0..table.rows {
            last = last.max(stamps.and_then(|column| column.integer(row)).unwrap_or(last));
            rows.push((last, at, row));
        }
    }
    rows.sort_unstable();
    rows.into_iter().map(|(_, at, row)| (at, row)).collect()
}

/// One table from several.
fn united(name: String, tables: &[Table]) -> Table {
    let rows = in_order(tables);
    let from = |at: usize| tables.get(at);
    let mut paths: BTreeMap<&str, &ColumnData> = BTreeMap::new();
    for column in tables.iter().flat_map(|table| &table.columns) {
        paths.entry(&column.path).or_insert(&column.data);
    }
    let mut columns: Vec<Column> = vec![];
    for (path, kind) in paths {
        let cells = rows.iter().map(|&(at, row)| (from(at).and_then(|table| table.column(path)), row));
        columns.push(column(path, kind, cells));
    }
    let who = rows.iter().map(|&(at, _)| from(at).map(talker).unwrap_or_default()).collect();
    columns.push(Column { path: TALKER.to_owned(), data: ColumnData::Text(who), valid: None });
    columns.sort_by(|a, b| a.path.cmp(&b.path));
    let numbers = |of: fn(&Table) -> Option<&Vec<i64>>| -> Option<Vec<i64>> {
        rows.iter().map(|&(at, row)| of(from(at)?)?.get(row).copied()).collect()
    };
    Table {
        topic: TopicInfo { name: name.clone(), type_name: name, encoding: "nmea".to_owned() },
        rows: rows.len(),
        logged_ns: numbers(|table| table.logged_ns.as_ref()),
        published_ns: numbers(|table| table.published_ns.as_ref()),
        origin: Places::default(),
        columns,
    }
}

/// A column of the kind that one of the tables has; a table without it contributes no values.
fn column<'t>(path: &str, kind: &ColumnData, cells: impl Iterator<Item = (Option<&'t Column>, usize)>) -> Column {
    fn parts<T: Default>(cells: impl Iterator<Item = Option<T>>) -> (Vec<T>, Vec<bool>) {
        cells.map(|cell| (cell.is_some(), cell.unwrap_or_default())).map(|(is, cell)| (cell, is)).unzip()
    }
    let (data, valid) = match kind {
        ColumnData::F64(_) => {
            let (values, valid) = parts(cells.map(|(column, row)| column?.number(row)));
            (ColumnData::F64(values), valid)
        }
        ColumnData::I64(_) | ColumnData::U64(_) => {
            let (values, valid) = parts(cells.map(|(column, row)| column?.integer(row)));
            (ColumnData::I64(values), valid)
        }
        ColumnData::Text(_) => {
            let (mut texts, mut valid) = (Texts::default(), vec![]);
            for text in cells.map(|(column, row)| column?.text(row)) {
                valid.push(text.is_some());
                texts.push(text.unwrap_or_default());
            }
            (ColumnData::Text(texts), valid)
        }
    };
    let valid = valid.contains(&false).then_some(valid);
    Column { path: path.to_owned(), data, valid }
}
