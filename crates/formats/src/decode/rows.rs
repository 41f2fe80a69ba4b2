//! Rows that grow message by message and become a [`Table`].

use crate::table::{Column, ColumnData, Places, Table, TopicInfo};
use crate::texts::Texts;
use std::collections::HashMap;

/// The most columns of one topic.
const MOST_COLUMNS: usize = 4096;
/// Longest path of a column, bytes.
const LONGEST_PATH: usize = 1024;

/// A decoded value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Value<'v> {
    Float(f64),
    Integer(i64),
    /// Above `i64::MAX`.
    Large(u64),
    Text(&'v str),
}

/// The type that a column starts with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ValueType {
    Float,
    Integer,
    Text,
}

impl Value<'_> {
    /// For an unsigned number.
    #[inline(always)]
    pub(crate) fn unsigned(number: u64) -> Value<'static> {
        i64::try_from(number).map_or(Value::Large(number), Value::Integer)
    }

    pub(crate) fn value_type(self) -> ValueType {
        match self {
            Value::Float(_) => ValueType::Float,
            Value::Integer(_) | Value::Large(_) => ValueType::Integer,
            Value::Text(_) => ValueType::Text,
        }
    }
}

/// The rows of one topic. A message sets the values of the open row, then the row is closed, or rolled back if the
/// message proves unreadable.
#[derive(Debug, Default)]
pub(crate) struct Rows {
    closed: usize,
    columns: Vec<Growing>,
    by_path: HashMap<String, usize>,
    /// The number of columns that are presence flags.
    flag_columns: usize,
    logged_ns: Vec<i64>,
    published_ns: Option<Vec<i64>>,
    origin: Places,
    text_bytes: u64,
    misfits: u64,
    first_misfit: Option<String>,
    turned_away: u64,
}

#[derive(Debug)]
struct Growing {
    path: String,
    data: ColumnData,
    valid: Option<Vec<bool>>,
}

impl Rows {
    pub(crate) fn len(&self) -> usize {
        self.closed
    }

    /// The column of `path`, created if it is new; `None`, and counted, if there are too many.
    pub(crate) fn column(&mut self, path: &str, value_type: ValueType) -> Option<usize> {
        if let Some(&column) = self.by_path.get(path) {
            return Some(column);
        }
        if self.columns.len() - self.flag_columns >= MOST_COLUMNS || path.len() > LONGEST_PATH {
            self.turned_away += 1;
            return None;
        }
        let data = match value_type {
            ValueType::Float => ColumnData::F64(vec![]),
            ValueType::Integer => ColumnData::I64(vec![]),
            ValueType::Text => ColumnData::Text(Texts::default()),
        };
        Some(self.push_column(path, data))
    }

    /// The column of a presence flag. It does not count towards the limit, because without its flag an absent field
    /// would have a value.
    pub(super) fn flag_column(&mut self, path: &str) -> Option<usize> {
        if let Some(&column) = self.by_path.get(path) {
            return Some(column);
        }
        if self.flag_columns >= MOST_COLUMNS {
            return None;
        }
        self.flag_columns += 1;
        Some(self.push_column(path, ColumnData::F64(vec![])))
    }

    fn push_column(&mut self, path: &str, data: ColumnData) -> usize {
        self.by_path.insert(path.to_owned(), self.columns.len());
        self.columns.push(Growing { path: path.to_owned(), data, valid: None });
        self.columns.len() - 1
    }

    /// Paths of the columns.
    pub(crate) fn paths(&self) -> impl Iterator<Item = &str> {
        self.columns.iter().map(|column| column.path.as_str())
    }

    /// Sets a value of the open row. One that does not fit the column's type is dropped and counted.
    #[inline(always)]
    pub(crate) fn set(&mut self, column: usize, value: Value<'_>) {
        self.set_at(self.closed, column, value);
    }

    /// As [`Rows::set`], for a row after which the column has no value yet.
    #[inline(always)]
    pub(crate) fn set_at(&mut self, row: usize, column: usize, value: Value<'_>) {
        let Some(growing) = self.columns.get_mut(column) else { return };
        if !growing.set(row, value) {
            self.misfits += 1;
            self.first_misfit.get_or_insert_with(|| growing.path.clone());
        }
        if let Value::Text(text) = value {
            self.text_bytes += text.len() as u64;
        }
    }

    /// Sets the values of rows from `first` on, after which the column has none yet.
    #[inline(always)]
    pub(crate) fn floats(&mut self, first: usize, column: usize, values: impl Iterator<Item = f64>) {
        match self.columns.get_mut(column) {
            Some(Growing { data: ColumnData::F64(held), valid: None, .. }) if held.len() == first => {
                held.extend(values)
            }
            _ => values.enumerate().for_each(|(i, x)| self.set_at(first + i, column, Value::Float(x))),
        }
    }

    /// As [`Rows::floats`].
    #[inline(always)]
    pub(crate) fn integers(&mut self, first: usize, column: usize, values: impl Iterator<Item = i64>) {
        match self.columns.get_mut(column) {
            Some(Growing { data: ColumnData::I64(held), valid: None, .. }) if held.len() == first => {
                held.extend(values)
            }
            _ => values.enumerate().for_each(|(i, x)| self.set_at(first + i, column, Value::Integer(x))),
        }
    }

    /// Closes the open row. `number` is that of its message within the topic, from 1.
    pub(crate) fn close(&mut self, logged_ns: i64, published_ns: Option<i64>, number: u64) {
        if let Some(published) = published_ns {
            self.published_ns.get_or_insert_default().push(published);
        }
        self.origin.push(self.closed, number);
        self.logged_ns.push(logged_ns);
        self.closed += 1;
    }

    /// Discards what was set since the last row was closed.
    pub(crate) fn roll_back(&mut self) {
        for column in &mut self.columns {
            column.truncate(self.closed);
        }
    }

    /// Memory use of the values, bytes.
    pub(crate) fn weight(&self) -> u64 {
        self.closed as u64 * (16 + 8 * self.columns.len() as u64) + self.text_bytes
    }

    /// The number of values of another type than their column, and the field of the first.
    pub(crate) fn misfits(&self) -> Option<(u64, &str)> {
        self.first_misfit.as_deref().map(|field| (self.misfits, field))
    }

    /// The number of values without a column, because there were too many.
    pub(crate) fn turned_away(&self) -> u64 {
        self.turned_away
    }

    pub(crate) fn into_table(self, topic: TopicInfo) -> Table {
        let rows = self.closed;
        let mut columns: Vec<Column> = self.columns.into_iter().filter_map(|c| c.finish(rows)).collect();
        columns.sort_by(|a, b| a.path.cmp(&b.path));
        let Rows { logged_ns, published_ns, origin, .. } = Rows { columns: vec![], ..self };
        // If some rows lack a publish time, it is dropped for all.
        let published_ns = published_ns.filter(|published| published.len() == logged_ns.len());
        Table { topic, rows, logged_ns: Some(logged_ns), published_ns, origin, columns }
    }
}

impl Growing {
    fn len(&self) -> usize {
        match &self.data {
            ColumnData::F64(v) => v.len(),
            ColumnData::I64(v) => v.len(),
            ColumnData::U64(v) => v.len(),
            ColumnData::Text(v) => v.len(),
        }
    }

    #[inline(always)]
    fn set(&mut self, row: usize, value: Value<'_>) -> bool {
        // Nearly always the value fits its column and follows the one before.
        match (&mut self.data, value) {
            (ColumnData::F64(v), Value::Float(x)) if v.len() == row => v.push(x),
            (ColumnData::I64(v), Value::Integer(x)) if v.len() == row => v.push(x),
            _ => return self.set_out_of_line(row, value),
        }
        if let Some(valid) = &mut self.valid {
            valid.push(true);
        }
        true
    }

    #[cold]
    fn set_out_of_line(&mut self, row: usize, value: Value<'_>) -> bool {
        if self.len() > row {
            self.truncate(row);
        }
        self.leave_out_until(row);
        self.widen_for(value);
        match (&mut self.data, value) {
            (ColumnData::F64(v), Value::Float(x)) => v.push(x),
            (ColumnData::F64(v), Value::Integer(x)) => v.push(x as f64),
            (ColumnData::F64(v), Value::Large(x)) => v.push(x as f64),
            (ColumnData::I64(v), Value::Integer(x)) => v.push(x),
            (ColumnData::U64(v), Value::Integer(x)) => v.push(x as u64),
            (ColumnData::U64(v), Value::Large(x)) => v.push(x),
            (ColumnData::Text(v), Value::Text(x)) => v.push(x),
            _ => return false,
        }
        if let Some(valid) = &mut self.valid {
            valid.push(true);
        }
        true
    }

    /// A column of whole numbers becomes unsigned when the first large one arrives, and float when the first fraction
    /// does, or when it has both a sign and a large number.
    fn widen_for(&mut self, value: Value<'_>) {
        let negative = |x: &i64| *x < 0;
        self.data = match (std::mem::replace(&mut self.data, ColumnData::F64(vec![])), value) {
            (ColumnData::I64(whole), Value::Large(_)) if !whole.iter().any(negative) => {
                ColumnData::U64(whole.into_iter().map(|x| x as u64).collect())
            }
            (ColumnData::I64(whole), Value::Float(_) | Value::Large(_)) => {
                ColumnData::F64(whole.into_iter().map(|x| x as f64).collect())
            }
            (ColumnData::U64(large), Value::Float(_)) => floats_of(large),
            (ColumnData::U64(large), Value::Integer(x)) if negative(&x) => floats_of(large),
            (data, _) => data,
        };
    }

    fn leave_out_until(&mut self, row: usize) {
        let len = self.len();
        if len >= row {
            return;
        }
        self.valid.get_or_insert_with(|| vec![true; len]).resize(row, false);
        match &mut self.data {
            ColumnData::F64(v) => v.resize(row, 0.0),
            ColumnData::I64(v) => v.resize(row, 0),
            ColumnData::U64(v) => v.resize(row, 0),
            ColumnData::Text(v) => v.resize(row),
        }
    }

    fn truncate(&mut self, rows: usize) {
        match &mut self.data {
            ColumnData::F64(v) => v.truncate(rows),
            ColumnData::I64(v) => v.truncate(rows),
            ColumnData::U64(v) => v.truncate(rows),
            ColumnData::Text(v) => v.truncate(rows),
        }
        if let Some(valid) = &mut self.valid {
            valid.truncate(rows);
        }
    }

    /// `None` if no row ever had a value: then the field is absent.
    fn finish(mut self, rows: usize) -> Option<Column> {
        self.truncate(rows);
        if self.len() == 0 {
            return None;
        }
        self.leave_out_until(rows);
        Some(Column { path: self.path, data: self.data, valid: self.valid })
    }
}

fn floats_of(large: Vec<u64>) -> ColumnData {
    ColumnData::F64(large.into_iter().map(|x| x as f64).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows_of(values: &[Option<Value<'_>>]) -> Column {
        let mut rows = Rows::default();
        for (i, value) in values.iter().enumerate() {
            if let Some(value) = value {
                let column = rows.column("a", value.value_type()).unwrap();
                rows.set(column, *value);
            }
            rows.close(i as i64, None, i as u64 + 1);
        }
        rows.into_table(TopicInfo::default()).columns.remove(0)
    }

    #[test]
    fn a_value_missing_from_a_message_is_absent_and_not_zero() {
        let column = rows_of(&[None, Some(Value::Float(2.5)), None, Some(Value::Float(0.0))]);
        let numbers: Vec<_> = (0..4).map(|row| column.number(row)).collect();
        assert_eq!(numbers, [None, Some(2.5), None, Some(0.0)]);
    }

    #[test]
    fn whole_numbers_stay_exact_until_a_fraction_arrives() {
        let stamp = 1_700_000_000_123_456_789;
        let whole = rows_of(&[Some(Value::Integer(stamp)), Some(Value::Integer(1))]);
        assert_eq!(whole.integer(0), Some(stamp));
        let mixed = rows_of(&[Some(Value::Integer(3)), Some(Value::Float(0.5))]);
        assert_eq!((mixed.number(0), mixed.number(1)), (Some(3.0), Some(0.5)));
    }

    #[test]
    fn numbers_without_sign_stay_exact_up_to_the_largest() {
        let column =
            rows_of(&[Some(Value::unsigned(5)), None, Some(Value::unsigned(u64::MAX)), Some(Value::unsigned(7))]);
        assert_eq!(column.data, ColumnData::U64(vec![5, 0, u64::MAX, 7]));
        assert_eq!((column.integer(0), column.integer(1), column.integer(2)), (Some(5), None, None));
        assert_eq!(column.number(2), Some(18_446_744_073_709_551_615.0));
        let signed = rows_of(&[Some(Value::Large(1 << 63)), Some(Value::Integer(-1))]);
        assert_eq!(signed.data, ColumnData::F64(vec![9_223_372_036_854_775_808.0, -1.0]));
        let fraction = rows_of(&[Some(Value::Integer(-2)), Some(Value::Large(1 << 63)), Some(Value::Float(0.5))]);
        assert_eq!(fraction.data, ColumnData::F64(vec![-2.0, 9_223_372_036_854_775_808.0, 0.5]));
    }

    #[test]
    fn a_row_rolled_back_leaves_no_trace() {
        let mut rows = Rows::default();
        let a = rows.column("a", ValueType::Float).unwrap();
        let b = rows.column("b", ValueType::Text).unwrap();
        rows.set(a, Value::Float(1.0));
        rows.set(b, Value::Text("one"));
        rows.close(10, Some(11), 1);
        rows.set(a, Value::Float(99.0));
        rows.roll_back();
        rows.set(b, Value::Text("three"));
        rows.close(30, Some(31), 3);
        let table = rows.into_table(TopicInfo::default());
        assert_eq!((table.rows, table.origin_of(0), table.origin_of(1)), (2, 1, 3));
        assert_eq!(table.published_ns, Some(vec![11, 31]));
        let a = table.column("a").unwrap();
        assert_eq!((a.number(0), a.number(1)), (Some(1.0), None));
        assert_eq!(table.column("b").unwrap().text(1), Some("three"));
    }

    #[test]
    fn text_in_a_column_of_numbers_is_dropped_and_counted() {
        let mut rows = Rows::default();
        let a = rows.column("a", ValueType::Float).unwrap();
        rows.set(a, Value::Float(1.0));
        rows.close(0, None, 1);
        rows.set(a, Value::Text("high"));
        rows.close(0, None, 2);
        assert_eq!(rows.misfits(), Some((1, "a")));
        assert_eq!(rows.into_table(TopicInfo::default()).columns[0].number(1), None);
    }
}
