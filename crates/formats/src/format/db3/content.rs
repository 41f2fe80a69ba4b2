//! The tables of a ROS 2 bag: topics, definitions, messages. Nothing is read from any other database.

use super::tree::{Cell, Row, Value};
use super::walk::{Look, Sink};
use crate::decode::{Route, Tally, Times, Topics};
use crate::format::inflate::{Inflater, is_packed};
use logscan::Fate;
use std::collections::HashMap;

/// Maximum memory for topics and definitions of one file, bytes.
const MOST_TEXT: u64 = 64 << 20;

/// A copied value.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Owned {
    Integer(i64),
    /// In the encoding of the database.
    Text(Vec<u8>),
    Other,
}

/// A copied row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct OwnedRow {
    pub(super) rowid: i64,
    values: Vec<Owned>,
}

impl OwnedRow {
    /// The text in a column, empty if absent. It is UTF-16 if `utf16` is set, big-endian if that is true.
    pub(super) fn text(&self, column: usize, utf16: Option<bool>) -> String {
        let Some(Owned::Text(bytes)) = self.values.get(column) else { return String::new() };
        let Some(big_endian) = utf16 else { return String::from_utf8_lossy(bytes).into_owned() };
        let unit = |b: &[u8; 2]| if big_endian { u16::from_be_bytes(*b) } else { u16::from_le_bytes(*b) };
        let units: Vec<u16> = bytes.as_chunks::<2>().0.iter().map(unit).collect();
        String::from_utf16_lossy(&units)
    }

    pub(super) fn integer(&self, column: usize) -> Option<i64> {
        match self.values.get(column)? {
            Owned::Integer(number) => Some(*number),
            _ => None,
        }
    }
}

/// Copies the rows of a small table.
pub(super) struct Gather {
    pub(super) rows: Vec<OwnedRow>,
    /// The columns with text in every row.
    texts: [usize; 2],
    bytes: u64,
    pub(super) turned_away: u64,
}

impl Gather {
    pub(super) fn new(texts: [usize; 2]) -> Gather {
        Gather { rows: vec![], texts, bytes: 0, turned_away: 0 }
    }
}

fn owned(value: Value<'_>) -> Owned {
    match value {
        Value::Integer(number) => Owned::Integer(number),
        Value::Text(bytes) => Owned::Text(bytes.to_vec()),
        Value::Null | Value::Real | Value::Blob(_) => Owned::Other,
    }
}

impl Sink for Gather {
    fn look(&mut self, cell: &Cell<'_>) -> Look {
        let Some(row) = Row::parse(cell) else { return Look::Bad("it is not a row") };
        if !self.texts.iter().all(|&column| row.is_text(column)) {
            return Look::Bad("it does not belong to this table");
        }
        self.bytes = self.bytes.saturating_add(cell.length);
        if self.bytes > MOST_TEXT {
            self.turned_away += 1;
            return Look::Unwanted;
        }
        Look::Wanted
    }

    fn whole(&mut self, cell: &Cell<'_>, row: &[u8]) -> Fate {
        if let Some(columns) = Row::parse(cell) {
            let values = (0..columns.len()).map(|c| columns.value(c, row).map_or(Owned::Other, owned)).collect();
            self.rows.push(OwnedRow { rowid: cell.rowid, values });
        }
        Fate::Structure
    }
}

/// Rows of a table that is not part of a bag.
pub(super) struct PassOver;

impl Sink for PassOver {
    fn look(&mut self, _cell: &Cell<'_>) -> Look {
        Look::Unwanted
    }

    fn whole(&mut self, _cell: &Cell<'_>, _row: &[u8]) -> Fate {
        Fate::Skipped
    }
}

/// The names of the stored columns in a `CREATE TABLE`, in order, in lower case.
pub(super) fn column_names(sql: &str) -> Vec<String> {
    let sql = without_remarks(sql);
    let Some((_, body)) = sql.split_once('(') else { return vec![] };
    let (mut depth, mut quote) = (0, None);
    let parts = body.split(|c: char| {
        match (quote, c) {
            (Some(end), _) => quote = Some(end).filter(|&end| end != c),
            (None, '\'' | '"' | '`') => quote = Some(c),
            (None, '[') => quote = Some(']'),
            (None, '(') => depth += 1,
            (None, ')') => depth -= 1,
            _ => {}
        }
        quote.is_none() && ((c == ',' && depth == 0) || depth < 0)
    });
    let bare = |word: &str| word.trim_matches(['"', '`', '\'', '[', ']']).to_owned();
    let column = |part: &str| {
        let words: Vec<String> =
            part.to_lowercase().replace('(', " ( ").split_whitespace().map(str::to_owned).collect();
        let first = words.first()?;
        let is_constraint = ["primary", "unique", "check", "foreign", "constraint"].contains(&first.as_str());
        // A computed column: rows do not store it.
        let is_virtual = words.windows(2).any(|pair| pair == ["as", "("]) && !words.iter().any(|word| word == "stored");
        (!is_constraint && !is_virtual).then(|| bare(first))
    };
    parts.filter_map(column).collect()
}

/// SQL without comments (after `--` or between `/*` and `*/`), except in quoted text.
fn without_remarks(sql: &str) -> String {
    let (mut plain, mut rest, mut quote) = (String::new(), sql, None);
    while let Some(next) = rest.chars().next() {
        let behind = match quote {
            None if rest.starts_with("--") => rest.split_once('\n').map_or("", |(_, behind)| behind),
            None if rest.starts_with("/*") => rest.split_once("*/").map_or("", |(_, behind)| behind),
            _ => {
                quote = match (quote, next) {
                    (Some(end), _) => Some(end).filter(|&end| end != next),
                    (None, '\'' | '"' | '`') => Some(next),
                    (None, '[') => Some(']'),
                    (None, _) => None,
                };
                plain.push(next);
                rest = rest.get(next.len_utf8()..).unwrap_or_default();
                continue;
            }
        };
        plain.push(' ');
        rest = behind;
    }
    plain
}

/// Positions of the columns of topics or definitions, from the SQL that created the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Places<const N: usize>([Option<usize>; N]);

impl<const N: usize> Places<N> {
    /// In the order of `names`. A column that the table does not name is at its usual position, counted from `first`.
    /// If another column is there, the SQL that created the table is corrupt: all are at their usual positions.
    pub(super) fn of(sql: &str, names: [&str; N], first: usize) -> Places<N> {
        let there = column_names(sql);
        let found = names.map(|name| there.iter().position(|n| n == name));
        let usual: [usize; N] = std::array::from_fn(|index| first + index);
        let is_taken = |place: &usize| found.contains(&Some(*place));
        let is_damaged = found.iter().zip(&usual).any(|(found, usual)| found.is_none() && is_taken(usual));
        Places(std::array::from_fn(|index| {
            let found = found.get(index).copied().flatten().filter(|_| !is_damaged);
            found.or(usual.get(index).copied())
        }))
    }

    pub(super) fn get(&self, index: usize) -> Option<usize> {
        self.0.get(index).copied().flatten()
    }

    /// Positions of the first two, which are required.
    pub(super) fn texts(&self) -> [usize; 2] {
        [0, 1].map(|index| self.get(index).unwrap_or_default())
    }

    /// The text of each in a row, empty where absent.
    pub(super) fn read(&self, row: &OwnedRow, utf16: Option<bool>) -> [String; N] {
        self.0.map(|column| column.map_or(String::new(), |column| row.text(column, utf16)))
    }
}

/// Positions of the columns in the messages table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct MessageColumns {
    topic: usize,
    logged: usize,
    published: Option<usize>,
    data: usize,
}

impl MessageColumns {
    /// As in all versions of rosbag2 so far.
    pub(super) const USUAL: MessageColumns = MessageColumns { topic: 1, logged: 2, published: None, data: 3 };

    /// From the SQL that created the table.
    pub(super) fn of(sql: &str) -> Option<MessageColumns> {
        let names = column_names(sql);
        let place = |name: &str| names.iter().position(|n| n == name);
        let logged = place("timestamp").or_else(|| place("recv_timestamp"))?;
        let (topic, data) = (place("topic_id")?, place("data")?);
        Some(MessageColumns { topic, logged, published: place("send_timestamp"), data })
    }

    fn of_row(self, cell: &Cell<'_>) -> Option<Found> {
        let row = Row::parse(cell)?;
        let topic = row.integer(self.topic, cell.local)?;
        let logged_ns = row.integer(self.logged, cell.local)?;
        let published_ns = self.published.and_then(|column| row.integer(column, cell.local));
        let data = row.place(self.data)?;
        Some(Found { topic, times: Times { logged_ns, published_ns }, data })
    }
}

/// The part of a message on its page.
struct Found {
    topic: i64,
    times: Times,
    data: std::ops::Range<u64>,
}

/// Routes messages to the topics.
pub(super) struct Messages<'t, 'w> {
    pub(super) topics: &'t mut Topics<'w>,
    columns: MessageColumns,
    routes: HashMap<i64, Route>,
    /// The route of a row that was examined, `None` if its topic is not announced.
    current: Option<(Found, Option<Route>)>,
    inflater: Inflater,
    most: u64,
    pub(super) unplaced: Tally,
    /// Messages whose own compression is corrupt.
    pub(super) packed: Tally,
    pub(super) found: u64,
}

impl<'t, 'w> Messages<'t, 'w> {
    pub(super) fn new(
        topics: &'t mut Topics<'w>,
        columns: MessageColumns,
        routes: HashMap<i64, Route>,
        most: u64,
    ) -> Messages<'t, 'w> {
        let (unplaced, packed) = (Tally::default(), Tally::default());
        let inflater = Inflater::default();
        Messages { topics, columns, routes, current: None, inflater, most, unplaced, packed, found: 0 }
    }

    fn message(&mut self, route: Route, found: &Found, data: &[u8]) -> Fate {
        if !is_packed(data) {
            return self.topics.message(route, found.times, data);
        }
        match self.inflater.message(data, self.most) {
            Ok(plain) => self.topics.message(route, found.times, plain),
            Err(why) => {
                self.packed.add(|| why);
                self.topics.unread(route, found.times, data.len() as u64)
            }
        }
    }
}

impl Sink for Messages<'_, '_> {
    fn look(&mut self, cell: &Cell<'_>) -> Look {
        let Some(found) = self.columns.of_row(cell) else { return Look::Bad("it is not a message") };
        let route = self.routes.get(&found.topic).copied();
        self.current = Some((found, route));
        if route.is_some_and(Route::is_wanted) { Look::Wanted } else { Look::Unwanted }
    }

    fn whole(&mut self, _cell: &Cell<'_>, row: &[u8]) -> Fate {
        self.found += 1;
        let Some((found, Some(route))) = self.current.take() else { return Fate::Skipped };
        let range = usize::try_from(found.data.start).ok().zip(usize::try_from(found.data.end).ok());
        let data = range.and_then(|(from, to)| row.get(from..to)).unwrap_or_default();
        self.message(route, &found, data)
    }

    fn unwanted(&mut self, cell: &Cell<'_>) {
        self.found += 1;
        match self.current.take() {
            Some((found, Some(route))) => {
                self.topics.unread(route, found.times, found.data.end - found.data.start);
            }
            Some((found, None)) => self.unplaced.add(|| format!("row {}, topic {}", cell.rowid, found.topic)),
            None => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_found_by_name_in_any_surrounding_sql() {
        let sql = "CREATE TABLE messages(\n id INTEGER PRIMARY KEY,\n \"topic_id\" INTEGER NOT NULL CHECK (topic_id > 0),\
                   \n timestamp INTEGER NOT NULL,\n data BLOB NOT NULL, UNIQUE (id, topic_id))";
        assert_eq!(column_names(sql), ["id", "topic_id", "timestamp", "data"]);
        assert_eq!(MessageColumns::of(sql), Some(MessageColumns::USUAL));
        let newer = "CREATE TABLE messages(id INTEGER, data BLOB, recv_timestamp INTEGER, send_timestamp INTEGER, topic_id INTEGER)";
        let columns = MessageColumns { topic: 4, logged: 2, published: Some(3), data: 1 };
        assert_eq!(MessageColumns::of(newer), Some(columns));
        let remarks = "CREATE TABLE messages /* (v4) */ (id INTEGER, -- the row's number\n topic_id INTEGER DEFAULT '--', /* ns, \
                       (UTC) */ timestamp INTEGER,\n data BLOB) -- end";
        assert_eq!(MessageColumns::of(remarks), Some(MessageColumns::USUAL));
        for bad in ["", "CREATE TABLE messages", "CREATE TABLE messages(a, b)", "((((", "))))", "a(/*", "--"] {
            assert_eq!(MessageColumns::of(bad), None);
        }
    }
}
