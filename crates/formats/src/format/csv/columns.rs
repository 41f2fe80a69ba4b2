//! Collects the rows of one topic in columns.

use super::extent::Extent;
use super::fields::{Cell, Decimal, EXACT, Row};
use crate::reader::{FieldRequest, Selection, TableHead, ValueKind};
use crate::table::{Column, ColumnData, Places, Table, TopicInfo};
use crate::texts::Texts;
use flight::{Code, Notices, Severity, TopicHealth};

/// If more than one in this many cells of a numeric column is not a number, the cells are reported as a loss.
const TOLERATED: u64 = 100;

/// The most lines of non-numeric cells that are remembered per column.
const LISTED_BAD: usize = 100;

/// Seconds since 1970 or 1980 are larger than this. A float of them is not exact to the nanosecond.
const LARGE: f64 = 1e8;

/// One topic while its rows are read.
#[derive(Debug, Default)]
pub(super) struct Topic {
    pub(super) info: TopicInfo,
    /// The column names of the header.
    pub(super) names: Vec<String>,
    /// The cells of the units line.
    pub(super) units: Vec<String>,
    /// As in [`TableHead`].
    pub(super) unused_names: Option<u64>,
    /// The number of fields per row.
    pub(super) width: usize,
    /// Decimal separator.
    pub(super) decimal: Decimal,
    /// Whether the rows are below another header: the meaning of their fields is unknown.
    pub(super) is_below_other_header: bool,
    /// Whether a wanted field exists.
    pub(super) decoded: bool,
    /// The number of intact rows.
    pub(super) rows: u64,
    payload_bytes: u64,
    /// Why nothing is decoded although something was wanted.
    reason: String,
    columns: Vec<ColumnBuilder>,
    lines: Places,
    unended_line: Option<u64>,
}

/// One column while its cells are read.
#[derive(Debug)]
struct ColumnBuilder {
    path: String,
    /// The index among the columns of the header.
    index: usize,
    cells: Cells,
    rows: usize,
    /// Empty as long as every cell holds a value.
    valid: Vec<bool>,
    filled: u64,
    not_finite: u64,
    bad: u64,
    bad_lines: Vec<u64>,
    bad_example: String,
}

/// Rows of a topic that are parsed separately, until the rows before them have been added.
#[derive(Debug, Default)]
pub(super) struct Part {
    rows: Topic,
    /// The type of each column of the topic before these rows.
    began: Vec<Kind>,
}

/// Where every column is wanted, a numeric column may hold one broken cell, and one more per this many numbers.
const NUMBERS_PER_BROKEN: u64 = 1000;
/// At the end of the log it must hold this many numbers per broken cell, otherwise it is a text column.
const LEAST_NUMBERS: u64 = 10;

/// How the next cell of a column is interpreted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Integer { long: bool },
    Float,
    Text,
}

/// The cells of a column: integers until the first cell that is not an integer, so that timestamps of 19 digits stay
/// exact.
#[derive(Debug)]
enum Cells {
    Integers(Integers),
    Floats(Vec<f64>),
    Text(Texts),
    /// For [`Selection::All`]: numbers until there are too many cells that are not numbers, and the cells as written.
    Undecided(Box<Cells>, Written),
}

#[derive(Debug, Default)]
struct Integers {
    values: Vec<i64>,
    /// Whether one of them is too large for a double to hold exactly.
    long: bool,
}

impl Integers {
    fn push(&mut self, value: i64) {
        self.long |= value.unsigned_abs() > EXACT;
        self.values.push(value);
    }

    /// The values as floats, in the memory of the integers: a column is not held twice.
    fn into_floats(self) -> Vec<f64> {
        self.values.into_iter().map(|i| i as f64).collect()
    }
}

/// Cells as written in the log. The first cells are integers in the usual form ([`plain_integer`]), and only their
/// number is kept. The texts of the others follow.
#[derive(Debug, Default)]
struct Written {
    integers: usize,
    others: Texts,
}

impl Written {
    /// `numbers` begin with the integers.
    fn texts(&self, numbers: &Cells) -> Texts {
        let mut texts = Texts::default();
        (0..self.integers).for_each(|i| match numbers {
            Cells::Integers(held) => texts.push(&held.values.get(i).map(i64::to_string).unwrap_or_default()),
            // None of them was too long for a float.
            Cells::Floats(held) => texts.push(&held.get(i).map(f64::to_string).unwrap_or_default()),
            Cells::Text(_) | Cells::Undecided(..) => texts.push(""),
        });
        self.others.iter().for_each(|text| texts.push(text));
        texts
    }
}

/// The value of an integer cell that formatting reproduces exactly, and that a double can hold.
#[inline]
fn plain_integer(cell: &[u8]) -> Option<i64> {
    let (negative, digits) = cell.strip_prefix(b"-").map_or((false, cell), |rest| (true, rest));
    let leading = digits.first()?;
    if digits.len() > 15 || (*leading == b'0' && cell.len() > 1) {
        return None;
    }
    let number = digits.iter().try_fold(0_i64, |number, byte| match byte {
        b'0'..=b'9' => Some(10 * number + i64::from(byte - b'0')),
        _ => None,
    })?;
    Some(if negative { -number } else { number })
}

impl Topic {
    pub(super) fn new(info: TopicInfo, names: Vec<String>, selection: &Selection) -> Topic {
        let index_of = |path: &str| names.iter().position(|n| n == path);
        let columns: Vec<ColumnBuilder> = match selection {
            Selection::Skip => vec![],
            Selection::All | Selection::Raw => {
                names.iter().enumerate().map(|(i, n)| ColumnBuilder::new(n, i, Cells::undecided())).collect()
            }
            Selection::Fields(requests) => {
                requests.iter().filter_map(|r| Some(ColumnBuilder::requested(r, index_of(&r.path)?))).collect()
            }
        };
        let nothing = columns.is_empty() && *selection != Selection::Skip;
        let reason =
            if nothing { format!("none of the wanted columns is among {}", first_of(&names)) } else { String::new() };
        Topic { info, decoded: !columns.is_empty(), width: names.len(), names, columns, reason, ..Topic::default() }
    }

    /// Keeps a column as text even if numbers are requested.
    pub(super) fn keep_text(&mut self, path: &str) {
        let undecided =
            |column: &&mut ColumnBuilder| column.path == path && matches!(column.cells, Cells::Undecided(..));
        self.columns.iter_mut().filter(undecided).for_each(|column| column.cells = Cells::Text(Texts::default()));
    }

    /// Whether a row with this many fields fits this header; a trailing delimiter adds one.
    pub(super) fn fits(&self, fields: usize, last_is_empty: impl FnOnce() -> bool) -> bool {
        fields == self.width || (fields == self.width + 1 && last_is_empty())
    }

    /// The indices of the wanted fields of a row.
    pub(super) fn places(&self) -> Vec<usize> {
        self.columns.iter().map(|column| column.index).collect()
    }

    /// Counts a row.
    pub(super) fn count(&mut self, extent: Extent) {
        self.rows += 1;
        self.payload_bytes += extent.text as u64;
    }

    /// Adds a row. Its first `skip` fields are not columns.
    pub(super) fn push(&mut self, row: Row<'_>, skip: usize, line: u64, extent: Extent) {
        self.lines.push(self.rows as usize, line);
        self.count(extent);
        if !extent.ended {
            self.unended_line = Some(line);
        }
        let last = row.len().saturating_sub(1);
        let decimal = self.decimal;
        for column in &mut self.columns {
            let place = column.index + skip;
            // The last value of a file without a line end may have lost digits.
            let cell = if place != last || extent.ended { row.get(place) } else { b"" };
            column.push(cell, decimal, line);
        }
    }

    /// Whether other threads may parse its rows in parts.
    pub(super) fn can_be_parsed_in_parts(&self) -> bool {
        self.decoded && self.columns.iter().all(|column| column.cells.kind().is_some())
    }

    /// Adds the rows of a part; the first one is at line `first`. Returns `false` and adds nothing if previous cells
    /// have changed the type of a column.
    pub(super) fn append(&mut self, part: &mut Part, first: u64) -> bool {
        if !self.columns.iter().map(|column| column.cells.kind()).eq(part.began.iter().copied().map(Some)) {
            return false;
        }
        if part.rows.rows > 0 {
            self.lines.push(self.rows as usize, first);
        }
        self.rows += part.rows.rows;
        self.payload_bytes += part.rows.payload_bytes;
        for (column, part) in self.columns.iter_mut().zip(&mut part.rows.columns) {
            column.append(part, first);
        }
        true
    }

    /// Reports problems with the cells.
    pub(super) fn report(&mut self, file: &str, listed: usize, notices: &mut Notices) {
        self.columns.iter_mut().for_each(ColumnBuilder::settle);
        self.drop_numbers_that_are_text();
        if let Some(line) = self.unended_line {
            let text = "the last row has no line end: its last value may be truncated and is not used";
            notices.push(Code::RejectedCell, format!("{file}, line {line}"), 1, text);
        }
        for column in &self.columns {
            column.report(file, listed, notices);
        }
    }

    /// A path requested both ways, as two channel maps may, is numeric only if some cell is a number.
    fn drop_numbers_that_are_text(&mut self) {
        let texts: Vec<String> =
            self.columns.iter().filter(|c| matches!(c.cells, Cells::Text(_))).map(|c| c.path.clone()).collect();
        self.columns.retain(|c| matches!(c.cells, Cells::Text(_)) || c.filled > 0 || !texts.contains(&c.path));
    }

    pub(super) fn health(&self) -> TopicHealth {
        TopicHealth {
            name: self.info.name.clone(),
            type_name: self.info.type_name.clone(),
            encoding: self.info.encoding.clone(),
            messages: self.rows,
            payload_bytes: self.payload_bytes,
            stamps: vec![],
            decoded: self.decoded,
            reason: self.reason.clone(),
        }
    }

    /// The columns of large decimals as written, where every column is wanted.
    pub(super) fn written(&self) -> Vec<(TopicInfo, Column)> {
        let columns = self.columns.iter().filter_map(|column| column.written());
        columns.map(|column| (self.info.clone(), column)).collect()
    }

    /// The header.
    pub(super) fn head(&self) -> TableHead {
        TableHead {
            topic: self.info.name.clone(),
            names: self.names.clone(),
            units: self.units.clone(),
            unused_names: self.unused_names,
        }
    }

    /// The table, if any of it was wanted.
    pub(super) fn into_table(self) -> Option<Table> {
        if !self.decoded {
            return None;
        }
        let mut columns: Vec<Column> = self.columns.into_iter().map(|column| column.finish(self.decimal)).collect();
        columns.sort_by(|a, b| (&a.path, is_text(a)).cmp(&(&b.path, is_text(b))));
        Some(Table {
            topic: self.info,
            rows: self.rows as usize,
            logged_ns: None,
            published_ns: None,
            origin: self.lines,
            columns,
        })
    }
}

impl Part {
    /// Restarts with rows of `topic`, whose columns are as they are now.
    pub(super) fn renew(&mut self, topic: &Topic) {
        let columns = std::mem::take(&mut self.rows.columns);
        let mut used = columns.into_iter();
        let columns = topic.columns.iter().map(|column| column.successor(used.next())).collect();
        self.rows = Topic { width: topic.width, decimal: topic.decimal, columns, ..Topic::default() };
        self.began.clear();
        self.began.extend(topic.columns.iter().filter_map(|column| column.cells.kind()));
    }

    /// Like [`Topic::push`], at a line counted from 1.
    #[inline]
    pub(super) fn push(&mut self, row: Row<'_>, line: u64, extent: Extent) {
        self.rows.push(row, 0, line, extent);
    }
}

/// At most ten of the names.
fn first_of(names: &[String]) -> String {
    let more = if names.len() > 10 { ", ..." } else { "" };
    format!("{}{more}", names.iter().take(10).map(String::as_str).collect::<Vec<_>>().join(", "))
}

/// Whether a non-numeric cell has digits, and commas among them.
fn has_separators(cell: &str) -> bool {
    let digits = cell.strip_prefix(['+', '-']).unwrap_or(cell);
    let plain = |c: char| c.is_ascii_digit() || c == ',' || c == '.';
    digits.contains(',') && digits.starts_with(|c: char| c.is_ascii_digit()) && digits.chars().all(plain)
}

/// Whether each text is not empty.
fn filled(texts: &Texts) -> Vec<bool> {
    texts.iter().map(|text| !text.is_empty()).collect()
}

fn is_text(column: &Column) -> bool {
    matches!(column.data, ColumnData::Text(_))
}

impl ColumnBuilder {
    fn new(path: &str, index: usize, cells: Cells) -> ColumnBuilder {
        ColumnBuilder {
            path: path.to_owned(),
            index,
            cells,
            rows: 0,
            valid: vec![],
            filled: 0,
            not_finite: 0,
            bad: 0,
            bad_lines: vec![],
            bad_example: String::new(),
        }
    }

    /// An empty column of the same type for the cells that follow, with the memory of a used column.
    fn successor(&self, used: Option<ColumnBuilder>) -> ColumnBuilder {
        let mut next = used.unwrap_or_else(|| ColumnBuilder::new("", self.index, Cells::Text(Texts::default())));
        let room = std::mem::replace(&mut next.cells, Cells::Text(Texts::default()));
        let cells = match (self.cells.kind(), room) {
            (Some(Kind::Integer { long }), Cells::Integers(Integers { mut values, .. })) => {
                values.clear();
                Cells::Integers(Integers { values, long })
            }
            (Some(Kind::Integer { long }), _) => Cells::Integers(Integers { values: vec![], long }),
            (Some(Kind::Float), Cells::Floats(mut values)) => {
                values.clear();
                Cells::Floats(values)
            }
            (Some(Kind::Float), _) => Cells::Floats(vec![]),
            (Some(Kind::Text) | None, Cells::Text(mut texts)) => {
                texts.clear();
                Cells::Text(texts)
            }
            (Some(Kind::Text) | None, _) => Cells::Text(Texts::default()),
        };
        next.valid.clear();
        ColumnBuilder { valid: next.valid, ..ColumnBuilder::new("", self.index, cells) }
    }

    /// Adds the cells of a part, which began with this column's current type.
    fn append(&mut self, part: &mut ColumnBuilder, first: u64) {
        if !part.valid.is_empty() && self.valid.is_empty() {
            self.valid.resize(self.rows, true);
        }
        self.rows += part.rows;
        if part.valid.is_empty() && !self.valid.is_empty() {
            self.valid.resize(self.rows, true);
        }
        self.valid.append(&mut part.valid);
        self.filled += part.filled;
        self.not_finite += part.not_finite;
        if self.bad == 0 {
            self.bad_example = std::mem::take(&mut part.bad_example);
        }
        self.bad += part.bad;
        let room = LISTED_BAD.saturating_sub(self.bad_lines.len());
        self.bad_lines.extend(part.bad_lines.iter().take(room).map(|line| first + line - 1));
        self.cells.append(&mut part.cells);
    }

    fn requested(request: &FieldRequest, index: usize) -> ColumnBuilder {
        let cells = match request.kind {
            ValueKind::Number => Cells::Integers(Integers::default()),
            ValueKind::Text => Cells::Text(Texts::default()),
        };
        ColumnBuilder::new(&request.path, index, cells)
    }

    #[inline]
    fn push(&mut self, cell: &[u8], decimal: Decimal, line: u64) {
        let valid = match &mut self.cells {
            Cells::Text(texts) => {
                texts.push(&decimal.text(cell));
                !cell.is_empty()
            }
            Cells::Undecided(..) => {
                let value = self.cells.push_undecided(cell, decimal);
                match value {
                    Cell::Bad => self.push_word(cell, line),
                    value => matches!(value, Cell::Integer(_) | Cell::Float(_)),
                }
            }
            Cells::Integers(_) | Cells::Floats(_) => {
                let value = decimal.number(cell);
                self.cells.push_fitting(value) || self.push_odd(value, cell, line)
            }
        };
        self.filled += u64::from(valid);
        if !valid && self.valid.is_empty() {
            self.valid.resize(self.rows, true);
        }
        self.rows += 1;
        if !valid || !self.valid.is_empty() {
            self.valid.push(valid);
        }
    }

    /// Adds a non-numeric cell to a column that is numeric so far. A few such cells are broken numbers; with more, it is
    /// a text column.
    #[cold]
    fn push_word(&mut self, cell: &[u8], line: u64) -> bool {
        self.note(Cell::Bad, cell, line);
        if self.bad <= 1 + self.filled / NUMBERS_PER_BROKEN {
            return false;
        }
        self.take_as_text();
        // The caller adds its details of this cell.
        self.valid.pop();
        true
    }

    /// Converts all cells to text as written.
    fn take_as_text(&mut self) {
        let Cells::Undecided(numbers, written) = &self.cells else { return };
        let texts = written.texts(numbers);
        // In a text column `N/A` is a word like any other.
        self.valid = Some(filled(&texts)).filter(|valid| valid.contains(&false)).unwrap_or_default();
        self.cells = Cells::Text(texts);
        (self.bad, self.bad_example) = (0, String::new());
        self.bad_lines.clear();
    }

    /// Decides at the end of the log whether a column has enough numbers to be numeric.
    fn settle(&mut self) {
        if self.bad * LEAST_NUMBERS > self.filled {
            self.take_as_text();
        }
    }

    /// Adds a cell that is not a number of the column's type.
    #[cold]
    fn push_odd(&mut self, value: Cell, cell: &[u8], line: u64) -> bool {
        let value = self.cells.fitting(value);
        self.note(value, cell, line);
        self.cells.push_number(value)
    }

    fn note(&mut self, value: Cell, cell: &[u8], line: u64) {
        match value {
            Cell::NotFinite | Cell::Missing => self.not_finite += 1,
            Cell::Bad => {
                if self.bad == 0 {
                    self.bad_example = String::from_utf8_lossy(cell).chars().take(40).collect();
                }
                if self.bad_lines.len() < LISTED_BAD {
                    self.bad_lines.push(line);
                }
                self.bad += 1;
            }
            Cell::Empty | Cell::Integer(_) | Cell::Float(_) => {}
        }
    }

    fn report(&self, file: &str, listed: usize, notices: &mut Notices) {
        let place = |line: Option<&u64>| line.map_or(file.to_owned(), |line| format!("{file}, line {line}"));
        if self.bad > 0 {
            let lines: Vec<String> = self.bad_lines.iter().take(listed).map(u64::to_string).collect();
            let more = if self.bad > lines.len() as u64 { ", ..." } else { "" };
            let (path, example, lines) = (&self.path, &self.bad_example, lines.join(", "));
            let text = match self.bad {
                1 => format!("column {path}: a cell that is not a number, {example:?}; line {lines}"),
                _ => {
                    format!("column {path}: cells that are not numbers, the first is {example:?}; lines {lines}{more}")
                }
            };
            // A column without any number was not meant as numbers, unless it has thousands separators.
            let numbers = self.filled > 0 || has_separators(&self.bad_example);
            let lost = numbers && self.bad * TOLERATED > self.rows as u64;
            let severity = if lost { Severity::Loss } else { Severity::Warning };
            notices.push(Code::RejectedCell.at(severity), place(self.bad_lines.first()), self.bad, text);
        }
        if self.not_finite > 0 {
            let text = format!(
                "column {}: cells that are nan, infinite, or words for a missing value such as N/A count as missing",
                self.path
            );
            notices.push(Code::RejectedCell.at(Severity::Info), place(None), self.not_finite, text);
        }
    }

    /// The cells of an undecided column whose first number is so large that a float loses nanoseconds.
    fn written(&self) -> Option<Column> {
        let Cells::Undecided(numbers, written) = &self.cells else { return None };
        let Cells::Floats(values) = &**numbers else { return None };
        let is_valid = |row: usize| self.valid.get(row).copied().unwrap_or(true);
        let (_, first) = values.iter().enumerate().find(|(row, _)| is_valid(*row))?;
        let data = || ColumnData::Text(written.texts(numbers));
        let valid = || (!self.valid.is_empty()).then(|| self.valid.clone());
        (first.abs() >= LARGE).then(|| Column { path: self.path.clone(), data: data(), valid: valid() })
    }

    fn finish(self, decimal: Decimal) -> Column {
        if let Cells::Undecided(numbers, written) = &self.cells
            && self.filled == 0
            && self.rows > 0
        {
            // A column with only words for missing values may be a text column.
            let texts = written.texts(numbers);
            if texts.iter().any(|text| decimal.number(text.as_bytes()) == Cell::Missing) {
                let valid = Some(filled(&texts)).filter(|valid| valid.contains(&false));
                return Column { path: self.path, data: ColumnData::Text(texts), valid };
            }
        }
        let valid = (!self.valid.is_empty()).then_some(self.valid);
        Column { path: self.path, data: self.cells.finish(), valid }
    }
}

impl Cells {
    fn undecided() -> Cells {
        Cells::Undecided(Box::new(Cells::Integers(Integers::default())), Written::default())
    }

    /// The type of the column. `None` if the next cell depends on more than that.
    fn kind(&self) -> Option<Kind> {
        match self {
            Cells::Integers(held) => Some(Kind::Integer { long: held.long }),
            Cells::Floats(_) => Some(Kind::Float),
            Cells::Text(_) => Some(Kind::Text),
            Cells::Undecided(..) => None,
        }
    }

    /// Appends cells that began with the type that these have now. They may have changed from integers to floats.
    fn append(&mut self, part: &mut Cells) {
        if let (Cells::Integers(held), Cells::Floats(_)) = (&mut *self, &*part) {
            *self = Cells::Floats(std::mem::take(held).into_floats());
        }
        match (self, part) {
            (Cells::Integers(held), Cells::Integers(more)) => {
                held.long |= more.long;
                held.values.append(&mut more.values);
            }
            (Cells::Floats(held), Cells::Floats(more)) => held.append(more),
            (Cells::Text(held), Cells::Text(more)) => held.append(more),
            _ => {}
        }
    }

    /// A number as the column can hold it. Among integers too long for a float, a number that is not an integer is bad:
    /// one broken cell must not round the 19-digit timestamps in all others.
    fn fitting(&self, value: Cell) -> Cell {
        match (self, value) {
            (Cells::Integers(integers), Cell::Float(float)) if integers.long => {
                if float.fract() == 0.0 && float.abs() < i64::MAX as f64 {
                    Cell::Integer(float as i64)
                } else {
                    Cell::Bad
                }
            }
            _ => value,
        }
    }

    /// Appends a number if it has the same kind as the previous ones, as nearly all have.
    #[inline]
    fn push_fitting(&mut self, value: Cell) -> bool {
        match (self, value) {
            (Cells::Integers(held), Cell::Integer(x)) => held.push(x),
            (Cells::Floats(held), Cell::Float(x)) => held.push(x),
            (Cells::Floats(held), Cell::Integer(x)) => held.push(x as f64),
            _ => return false,
        }
        true
    }

    /// Appends a number, or a placeholder. Returns whether it is a value.
    fn push_number(&mut self, value: Cell) -> bool {
        if let (Cells::Integers(integers), Cell::Float(_)) = (&mut *self, value) {
            *self = Cells::Floats(std::mem::take(integers).into_floats());
        }
        if self.push_fitting(value) {
            return true;
        }
        match self {
            Cells::Integers(held) => held.push(0),
            Cells::Floats(held) => held.push(0.0),
            Cells::Text(_) | Cells::Undecided(..) => {}
        }
        false
    }

    /// Appends a cell as written, and as a number or a placeholder. Returns how it was interpreted.
    fn push_undecided(&mut self, cell: &[u8], decimal: Decimal) -> Cell {
        let Cells::Undecided(numbers, written) = self else { return Cell::Empty };
        if let (Cells::Integers(held), true, Some(integer)) =
            (&mut **numbers, written.others.is_empty(), plain_integer(cell))
        {
            written.integers += 1;
            held.values.push(integer);
            return Cell::Integer(integer);
        }
        written.others.push(&decimal.text(cell));
        let value = decimal.number(cell);
        if !numbers.push_fitting(value) {
            let value = numbers.fitting(value);
            numbers.push_number(value);
            return value;
        }
        value
    }

    fn finish(self) -> ColumnData {
        match self {
            Cells::Text(v) => ColumnData::Text(v),
            Cells::Floats(v) => ColumnData::F64(v),
            Cells::Integers(v) if v.long => ColumnData::I64(v.values),
            Cells::Integers(v) => ColumnData::F64(v.into_floats()),
            Cells::Undecided(numbers, written) => {
                drop(written);
                numbers.finish()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_integer_is_not_searched_for_again_at_every_cell() {
        // If searched for each time, these would be 1e11 steps.
        const CELLS: usize = 300_000;
        let mut column = ColumnBuilder::new("t", 0, Cells::Integers(Integers::default()));
        let cells = std::iter::repeat_n(&b"1"[..], CELLS).chain([&b"1700000000123456789"[..]]);
        for (line, cell) in cells.chain(std::iter::repeat_n(&b"1e300"[..], CELLS)).enumerate() {
            column.push(cell, Decimal::Point, line as u64);
        }
        assert_eq!((column.bad, column.filled), (CELLS as u64, CELLS as u64 + 1));
        let column = column.finish(Decimal::Point);
        assert!(matches!(&column.data, ColumnData::I64(v) if v[CELLS] == 1_700_000_000_123_456_789));
        assert_eq!(column.valid.map(|valid| valid.iter().filter(|v| **v).count()), Some(CELLS + 1));
    }

    #[test]
    fn cells_of_a_text_column_are_kept_as_written() {
        let long = "9".repeat(40_000);
        let odd = ["1,5", "", "007", "+4", "-0", "00", "-05", &long, &"8".repeat(128)];
        let plain = ["0", "-1", "12", "9007199254740993", "-9223372036854775808"];
        // Of the second, the first odd cell makes floats of the plain ones; of the others some are too long for that.
        let each_first = (0..odd.len()).map(|i| (&plain[..3], &odd[i..]));
        let all = [(&plain[..0], &odd[..]), (&plain, &odd), (&plain, &odd[1..]), (&plain, &[])];
        for (plain, odd) in all.into_iter().chain(each_first) {
            let mut column = ColumnBuilder::new("t", 0, Cells::undecided());
            let cells: Vec<&str> = plain.iter().chain(odd).chain(&["x", "y", "3"]).copied().collect();
            cells.iter().zip(1..).for_each(|(cell, line)| column.push(cell.as_bytes(), Decimal::Comma, line));
            let ColumnData::Text(texts) = column.finish(Decimal::Comma).data else { panic!("a column of numbers") };
            assert_eq!(texts, cells.iter().map(|cell| cell.replace(',', ".")).collect());
        }
    }

    #[test]
    fn a_few_broken_cells_are_counted_and_more_make_a_text_column() {
        let column = |cells: &[&str]| {
            let mut column = ColumnBuilder::new("t", 0, Cells::undecided());
            cells.iter().zip(1..).for_each(|(cell, line)| column.push(cell.as_bytes(), Decimal::Point, line));
            column.settle();
            column
        };
        let one = column(&["1", "2", "x", "4", "5", "6", "7", "8", "9", "10", "11"]);
        assert_eq!((one.bad, one.filled, one.bad_example.as_str()), (1, 10, "x"));
        assert!(matches!(one.finish(Decimal::Point).data, ColumnData::F64(v) if v[3] == 4.0));
        let words = column(&["1", "2", "x", "y", "5"]);
        assert_eq!(words.bad, 0);
        assert!(
            matches!(words.finish(Decimal::Point).data, ColumnData::Text(v) if v.iter().eq(["1", "2", "x", "y", "5"]))
        );
        let single = column(&["x"]);
        assert_eq!(single.bad, 0);
        assert!(matches!(single.finish(Decimal::Point).data, ColumnData::Text(v) if v.iter().eq(["x"])));
    }
}
