//! What the tables of a ROS 2 bag hold: topics, definitions, messages. Of any other database nothing is read.

use super::tree::{Cell, Row, Value};
use super::walk::{Look, Sink};
use crate::decode::{Route, Tally, Times, Topics};
use crate::format::inflate::{Inflater, is_packed};
use crate::ledger::Fate;
use std::collections::BTreeMap;

/// Memory that topics and definitions of one file may take, bytes.
const MOST_TEXT: u64 = 64 << 20;

/// A value that was copied.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Owned {
    Integer(i64),
    Text(String),
    Other,
}

impl Owned {
    pub(super) fn text(&self) -> Option<&str> {
        match self {
            Owned::Text(text) => Some(text),
            _ => None,
        }
    }

    pub(super) fn integer(&self) -> Option<i64> {
        match self {
            Owned::Integer(number) => Some(*number),
            _ => None,
        }
    }
}

/// Copies the rows of a small table.
pub(super) struct Gather {
    pub(super) rows: Vec<(i64, Vec<Owned>)>,
    /// Text is UTF-16, big-endian if the inner value is true.
    utf16: Option<bool>,
    bytes: u64,
    pub(super) turned_away: u64,
}

impl Gather {
    pub(super) fn new(utf16: Option<bool>) -> Gather {
        Gather { rows: vec![], utf16, bytes: 0, turned_away: 0 }
    }

    fn owned(&self, value: Value<'_>) -> Owned {
        match value {
            Value::Integer(number) => Owned::Integer(number),
            Value::Text(bytes) => Owned::Text(match self.utf16 {
                None => String::from_utf8_lossy(bytes).into_owned(),
                Some(big_endian) => {
                    let unit = |b: &[u8; 2]| if big_endian { u16::from_be_bytes(*b) } else { u16::from_le_bytes(*b) };
                    let units: Vec<u16> = bytes.as_chunks::<2>().0.iter().map(unit).collect();
                    String::from_utf16_lossy(&units)
                }
            }),
            Value::Null | Value::Real | Value::Blob(_) => Owned::Other,
        }
    }
}

impl Sink for Gather {
    fn look(&mut self, cell: &Cell<'_>) -> Look {
        if Row::parse(cell).is_none() {
            return Look::Bad("it is no row");
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
            let values = (0..columns.len()).map(|c| columns.value(c, row).map_or(Owned::Other, |v| self.owned(v)));
            let values = values.collect();
            self.rows.push((cell.rowid, values));
        }
        Fate::Structure
    }

    fn unwanted(&mut self, _cell: &Cell<'_>) {}
}

/// Rows of a table that is not ours.
pub(super) struct PassOver;

impl Sink for PassOver {
    fn look(&mut self, _cell: &Cell<'_>) -> Look {
        Look::Unwanted
    }

    fn whole(&mut self, _cell: &Cell<'_>, _row: &[u8]) -> Fate {
        Fate::Skipped
    }

    fn unwanted(&mut self, _cell: &Cell<'_>) {}
}

/// The names of the columns in a `CREATE TABLE`, in order.
pub(super) fn column_names(sql: &str) -> Vec<String> {
    let Some((_, body)) = sql.split_once('(') else { return vec![] };
    let mut depth = 0;
    let parts = body.split(|c: char| {
        match c {
            '(' => depth += 1,
            ')' => depth -= 1,
            _ => {}
        }
        (c == ',' && depth == 0) || depth < 0
    });
    let first_word = |part: &str| part.split_whitespace().next().unwrap_or_default().to_lowercase();
    let bare = |word: String| word.trim_matches(['"', '`', '\'', '[', ']']).to_owned();
    let is_column = |word: &String| {
        !word.is_empty() && !["primary", "unique", "check", "foreign", "constraint"].contains(&word.as_str())
    };
    parts.map(first_word).filter(is_column).map(bare).collect()
}

/// Where the columns of the messages' table are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct MessageColumns {
    topic: usize,
    logged: usize,
    published: Option<usize>,
    data: usize,
}

impl MessageColumns {
    /// As all versions of rosbag2 so far have it.
    pub(super) const USUAL: MessageColumns = MessageColumns { topic: 1, logged: 2, published: None, data: 3 };

    /// From the text that made the table.
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

    /// Whether a row on a page that nothing leads to looks like a message.
    pub(super) fn look_like(self, cell: &Cell<'_>) -> bool {
        self.of_row(cell).is_some() && Row::parse(cell).is_some_and(|row| row.value(0, cell.local) == Some(Value::Null))
    }
}

/// Whether a row on a page that nothing leads to looks like a topic, or else like a definition.
pub(super) fn looks_like_text(cell: &Cell<'_>, third: fn(&[u8]) -> bool) -> bool {
    let text = |row: &Row, column| match row.value(column, cell.local) {
        Some(Value::Text(text)) => Some(text.to_vec()),
        _ => None,
    };
    Row::parse(cell).is_some_and(|row| {
        row.value(0, cell.local) == Some(Value::Null)
            && text(&row, 1).is_some()
            && text(&row, 2).is_some_and(|text| third(&text))
            && row.place(3).is_some()
    })
}

/// A message as far as its page tells.
struct Found {
    topic: i64,
    times: Times,
    data: std::ops::Range<u64>,
}

/// Gives messages to the topics.
pub(super) struct Messages<'t, 'w> {
    pub(super) topics: &'t mut Topics<'w>,
    columns: MessageColumns,
    routes: BTreeMap<i64, Route>,
    /// The route of a row that was looked at, `None` if nobody announces its topic.
    current: Option<(Found, Option<Route>)>,
    inflater: Inflater,
    most: u64,
    pub(super) unplaced: Tally,
    /// Messages whose own compression is broken.
    pub(super) packed: Tally,
    pub(super) found: u64,
}

impl<'t, 'w> Messages<'t, 'w> {
    pub(super) fn new(
        topics: &'t mut Topics<'w>,
        columns: MessageColumns,
        routes: BTreeMap<i64, Route>,
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
        let Some(found) = self.columns.of_row(cell) else { return Look::Bad("it is no message") };
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
    fn columns_are_found_by_name_whatever_stands_around_them() {
        let sql = "CREATE TABLE messages(\n id INTEGER PRIMARY KEY,\n \"topic_id\" INTEGER NOT NULL CHECK (topic_id > 0),\
                   \n timestamp INTEGER NOT NULL,\n data BLOB NOT NULL, UNIQUE (id, topic_id))";
        assert_eq!(column_names(sql), ["id", "topic_id", "timestamp", "data"]);
        assert_eq!(MessageColumns::of(sql), Some(MessageColumns::USUAL));
        let newer = "CREATE TABLE messages(id INTEGER, data BLOB, recv_timestamp INTEGER, send_timestamp INTEGER, topic_id INTEGER)";
        let columns = MessageColumns { topic: 4, logged: 2, published: Some(3), data: 1 };
        assert_eq!(MessageColumns::of(newer), Some(columns));
        for bad in ["", "CREATE TABLE messages", "CREATE TABLE messages(a, b)", "((((", "))))"] {
            assert_eq!(MessageColumns::of(bad), None);
        }
    }
}
