//! Columns of one topic, with rows in the order of the log.

use crate::texts::Texts;

/// The column of undecoded messages: their bytes in hexadecimal digits.
pub const PAYLOAD_HEX: &str = "payload_hex";

/// A topic as the log announces it.
#[derive(Debug, Clone, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TopicInfo {
    /// Name.
    pub name: String,
    /// Message type; empty if the format has none.
    pub type_name: String,
    /// Encoding of the messages: `ros1`, `cdr`, `json`, `csv`, ...
    pub encoding: String,
}

/// The decoded messages of one topic in file order.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// The topic.
    pub topic: TopicInfo,
    /// Number of rows.
    pub rows: usize,
    /// Log time of each row by the container, ns; `None` for formats without.
    pub logged_ns: Option<Vec<i64>>,
    /// Publish time of each row by the container, ns; `None` for formats without.
    pub published_ns: Option<Vec<i64>>,
    /// Line (text formats) or message number (binary formats) of each row, both from 1.
    pub origin: Places,
    /// Columns in the order of their names.
    pub columns: Vec<Column>,
}

/// The line or message number of each row in a log. Consecutive rows take no memory.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Places {
    /// Rows that do not follow the one before, and their numbers; before them row `i` is number `i + 1`.
    jumps: Vec<(usize, u64)>,
}

impl Places {
    /// Sets the number of a row after all rows whose number is set.
    #[inline]
    pub fn push(&mut self, row: usize, number: u64) {
        if number != self.of(row) {
            self.jumps.push((row, number));
        }
    }

    /// The number of a row, from 1. A row without one follows the row before.
    #[must_use]
    #[inline]
    pub fn of(&self, row: usize) -> u64 {
        let last = self.jumps.last().filter(|(from, _)| *from <= row);
        let (from, number) = last.copied().unwrap_or_else(|| self.jump_before(row));
        number + (row - from) as u64
    }

    fn jump_before(&self, row: usize) -> (usize, u64) {
        let after = self.jumps.partition_point(|(from, _)| *from <= row);
        after.checked_sub(1).and_then(|at| self.jumps.get(at)).copied().unwrap_or((0, 1))
    }
}

impl FromIterator<u64> for Places {
    fn from_iter<I: IntoIterator<Item = u64>>(numbers: I) -> Places {
        let mut places = Places::default();
        numbers.into_iter().enumerate().for_each(|(row, number)| places.push(row, number));
        places
    }
}

/// One field of all rows.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// Dotted path of the field.
    pub path: String,
    /// Values; a missing one holds a placeholder.
    pub data: ColumnData,
    /// Which rows have a value; `None` if all.
    pub valid: Option<Vec<bool>>,
}

/// Values of a column by type.
#[derive(Debug, Clone, PartialEq)]
pub enum ColumnData {
    /// Floats and integers of up to 32 bits, exactly.
    F64(Vec<f64>),
    /// 64-bit integers and ROS times in ns.
    I64(Vec<i64>),
    /// Unsigned 64-bit integers, at least one of them above `i64::MAX`.
    U64(Vec<u64>),
    /// Text.
    Text(Texts),
}

impl Table {
    /// The column of a field.
    #[must_use]
    pub fn column(&self, path: &str) -> Option<&Column> {
        self.columns.iter().find(|c| c.path == path)
    }

    /// The column of a field, if it holds numbers.
    #[must_use]
    pub fn numbers(&self, path: &str) -> Option<&Column> {
        self.columns.iter().find(|c| c.path == path && !matches!(c.data, ColumnData::Text(_)))
    }

    /// The column of a field, if it holds text.
    #[must_use]
    pub fn texts(&self, path: &str) -> Option<&Column> {
        self.columns.iter().find(|c| c.path == path && matches!(c.data, ColumnData::Text(_)))
    }

    /// Line or message number of a row, from 1.
    #[must_use]
    pub fn origin_of(&self, row: usize) -> u64 {
        self.origin.of(row)
    }
}

impl Column {
    fn is_valid(&self, row: usize) -> bool {
        self.valid.as_ref().is_none_or(|v| v.get(row).copied().unwrap_or(false))
    }

    /// The value as a float. 64-bit integers are rounded to the nearest double.
    #[must_use]
    pub fn number(&self, row: usize) -> Option<f64> {
        if !self.is_valid(row) {
            return None;
        }
        match &self.data {
            ColumnData::F64(v) => v.get(row).copied(),
            ColumnData::I64(v) => v.get(row).map(|&x| x as f64),
            ColumnData::U64(v) => v.get(row).map(|&x| x as f64),
            ColumnData::Text(_) => None,
        }
    }

    /// The value as an exact integer, if it is one and fits.
    #[must_use]
    pub fn integer(&self, row: usize) -> Option<i64> {
        if !self.is_valid(row) {
            return None;
        }
        match &self.data {
            ColumnData::I64(v) => v.get(row).copied(),
            ColumnData::U64(v) => v.get(row).and_then(|&x| i64::try_from(x).ok()),
            ColumnData::F64(v) => {
                v.get(row).copied().filter(|x| x.fract() == 0.0 && x.abs() < 9.007_199_254_740_992e15).map(|x| x as i64)
            }
            ColumnData::Text(_) => None,
        }
    }

    /// The value as an exact unsigned integer, if it is a 64-bit integer.
    #[must_use]
    pub fn unsigned(&self, row: usize) -> Option<u64> {
        match &self.data {
            ColumnData::U64(v) if self.is_valid(row) => v.get(row).copied(),
            _ => self.integer(row).and_then(|x| u64::try_from(x).ok()),
        }
    }

    /// The value as text.
    #[must_use]
    pub fn text(&self, row: usize) -> Option<&str> {
        if !self.is_valid(row) {
            return None;
        }
        match &self.data {
            ColumnData::Text(v) => v.get(row),
            ColumnData::F64(_) | ColumnData::I64(_) | ColumnData::U64(_) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_row_has_its_given_number_and_a_run_of_rows_is_one_entry() {
        for numbers in [vec![], vec![1, 2, 3], vec![2, 3, 4], vec![1, 3, 4, 9, 10], vec![5, 5, 4, 3], vec![7, 0, 1, 2]]
        {
            let places: Places = numbers.iter().copied().collect();
            assert_eq!((0..numbers.len()).map(|row| places.of(row)).collect::<Vec<u64>>(), numbers);
            assert_eq!(places.of(numbers.len()), numbers.last().map_or(1, |last| last + 1));
        }
        assert_eq!((2..1_000_002).collect::<Places>().jumps.len(), 1);
        assert_eq!((1..1_000_001).collect::<Places>().jumps.len(), 0);
    }
}
