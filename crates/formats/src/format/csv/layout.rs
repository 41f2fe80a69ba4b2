//! Finds the delimiter, the header and the units of a table from its first lines.

use super::fields::{BLANKS, Cell, CommaCell, Decimal, Fields, comma_cell};
use super::formula::restored;
use super::lines::{Lines, Next};
use super::novatel;
use super::plain::comment_mark;
use crate::error::LogError;
use crate::reader::ReadContext;
use std::sync::atomic::AtomicBool;

/// The number of records that are examined.
const SAMPLE: usize = 64;
/// Delimiters, in order of preference if two fit equally well.
const DELIMITERS: [u8; 5] = [b',', b';', b'\t', b'|', BLANKS];
/// The most table names in the first lines of a tagged file. More different words are values.
const MOST_TAGS: usize = 16;
/// The fewest rows without a header that show a table.
const FEWEST_ROWS: usize = 4;

/// The end of a preamble of a LabVIEW measurement file. The file has one preamble, and each segment has one.
const END_OF_PREAMBLE: &[u8] = b"***End_of_Header***";
/// The last name in the header of such a segment. Its rows may lack that column.
const REMARKS: &str = "Comment";

/// How a text file is laid out.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Layout {
    /// One table.
    Table(TableLayout),
    /// FlySight 2: several tables, each row named.
    FlySight2,
    /// NovAtel ASCII: a named message with a checksum in each line.
    Novatel,
    /// Comma delimited without a header. The second field of each row names its table, and each table has its own width.
    Tagged,
}

/// Positions of the parts of a table.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct TableLayout {
    /// Field delimiter.
    pub(super) delimiter: u8,
    /// Decimal separator.
    pub(super) decimal: Decimal,
    /// Column names, unique.
    pub(super) names: Vec<String>,
    /// Names that were empty or repeated and were changed.
    pub(super) renamed: usize,
    /// Line of the header, if there is one.
    pub(super) header_line: Option<u64>,
    /// Line of the units, if there is one.
    pub(super) units_line: Option<u64>,
    /// The line that names the columns, if it is not the header because of a line above it.
    pub(super) unused_names: Option<u64>,
    /// The line of the first row.
    pub(super) first_row_line: u64,
    /// The first line and the number of rows of another table before the header.
    pub(super) other_rows: Option<(u64, u64)>,
    /// Whether there are a header and a row with a number, and all examined rows have the same number of fields.
    pub(super) regular: bool,
    /// Which columns are numeric in most of the examined rows.
    pub(super) numbers: Vec<bool>,
    /// Whether there is no header, all examined rows have the same number of fields, and every cell is a number.
    pub(super) only_numbers: bool,
}

impl TableLayout {
    /// A description for the health of the log.
    pub(super) fn describe(&self) -> String {
        let delimiter = match self.delimiter {
            b'\t' => "TAB".to_owned(),
            BLANKS => "blank".to_owned(),
            other => format!("'{}'", char::from(other)),
        };
        let header = self.header_line.map_or("no header".to_owned(), |line| format!("header in line {line}"));
        let units = self.units_line.map_or(String::new(), |line| format!(", units in line {line}"));
        let decimal = if self.decimal == Decimal::Comma { ", decimal comma" } else { "" };
        format!("{delimiter} delimited{decimal}, {header}{units}")
    }
}

struct Sampled {
    line: u64,
    comment: bool,
    fields: Vec<String>,
}

impl Sampled {
    fn has_number(&self, decimal: Decimal) -> bool {
        self.fields.iter().any(|f| !matches!(decimal.number(f.as_bytes()), Cell::Empty | Cell::Missing | Cell::Bad))
    }

    fn is_all_numbers(&self, decimal: Decimal) -> bool {
        self.fields.iter().all(|f| decimal.number(f.as_bytes()) != Cell::Bad) && self.has_number(decimal)
    }

    /// Whether a cell is a date or a time: digits and their separators.
    fn has_moment(&self) -> bool {
        let is_moment = |f: &String| {
            f.starts_with(|c: char| c.is_ascii_digit())
                && f.contains([':', '-', '/'])
                && f.bytes().all(|b| b.is_ascii_digit() || b":-/.+ TZ".contains(&b))
        };
        self.fields.iter().any(is_moment)
    }

    fn names_columns(&self, decimal: Decimal) -> bool {
        let filled = self.fields.iter().filter(|f| !f.is_empty()).count();
        !self.has_number(decimal) && 2 * filled >= self.fields.len() && !self.states_units()
    }

    /// `(deg)`, `[m/s]` or a plain unit in every cell that is not empty, and at least one such cell.
    fn states_units(&self) -> bool {
        let mut filled = self.fields.iter().filter(|f| !f.is_empty()).peekable();
        filled.peek().is_some() && filled.all(|f| is_unit(f))
    }
}

impl Sampled {
    /// Whether a row below the header has the units of the columns in words, as `sec` and `degrees`: it has text in
    /// columns where all later rows have numbers. No such text begins with a digit, as dates and times do.
    fn describes(&self, data: &[&Sampled], width: usize, decimal: Decimal) -> bool {
        let whole: Vec<&&Sampled> = data.iter().filter(|r| r.fields.len() == width).collect();
        let number = |cell: &String| decimal.number(cell.as_bytes());
        let is_none = |cell: &String| matches!(number(cell), Cell::Empty | Cell::Missing);
        let is_number = |cell: &String| matches!(number(cell), Cell::Integer(_) | Cell::Float(_));
        let all = |column: usize, fits: &dyn Fn(&String) -> bool| {
            whole.iter().all(|r| r.fields.get(column).is_some_and(fits))
        };
        let numbers = |column: usize| all(column, &is_number);
        // If columns have gaps, a row of words may be an event. Units are in several such columns, and only there.
        let gappy = |column: usize| {
            let filled = whole.iter().filter_map(|r| r.fields.get(column)).any(is_number);
            filled && all(column, &|cell| is_number(cell) || is_none(cell))
        };
        let is_word = |cell: &String| decimal.number(cell.as_bytes()) == Cell::Bad;
        let of_numbers = || self.fields.iter().enumerate().filter(|(column, _)| numbers(*column));
        let of_gappy = || {
            let (over, others): (Vec<_>, Vec<_>) =
                self.fields.iter().enumerate().partition(|(column, _)| gappy(*column));
            over.iter().filter(|(_, cell)| is_word(cell)).count() > 1 && others.iter().all(|(_, cell)| is_none(cell))
        };
        self.fields.len() == width
            && whole.len() > 1
            && !self.fields.iter().any(|f| f.starts_with(|c: char| c.is_ascii_digit()))
            && (of_numbers().any(|(_, cell)| is_word(cell)) || of_gappy())
    }
}

fn is_unit(cell: &str) -> bool {
    let bracketed = |open, close| cell.starts_with(open) && cell.ends_with(close);
    bracketed('(', ')') || bracketed('[', ']') || cell.parse::<flight::Unit>().is_ok_and(|u| u.symbol() != "1")
}

/// Finds the layout from the first bytes of a file.
///
/// # Errors
/// What the text is instead of a table.
pub(super) fn find(head: &[u8], context: &ReadContext<'_>) -> Result<Layout, String> {
    if head.starts_with(b"\xff\xfe") || head.starts_with(b"\xfe\xff") {
        return Err("UTF-16 text; save it as UTF-8".into());
    }
    if head.starts_with(b"$FLYS") {
        return Ok(Layout::FlySight2);
    }
    if novatel::looks_like(head) {
        return Ok(Layout::Novatel);
    }
    // The reader reads these bytes again. It counts them and can be cancelled.
    let never = AtomicBool::new(false);
    let quiet = ReadContext { limits: context.limits, cancel: &never, on_bytes: &|_| () };
    let mut best: Option<(Rank, TableLayout)> = None;
    let first_line = head.split(|b| b"\r\n".contains(b)).next().unwrap_or_default();
    let hinted = is_hint(super::without_bom(first_line).trim_ascii());
    for delimiter in DELIMITERS {
        // Blanks also occur as padding, so they count only if nothing else fits.
        if delimiter == BLANKS && best.is_some() {
            continue;
        }
        let sample = sample(head, delimiter, &quiet).map_err(|e| e.to_string())?;
        if delimiter == b',' && is_tagged(&sample) {
            return Ok(Layout::Tagged);
        }
        if let Some((agree, layout)) = lay_out(&sample, delimiter) {
            let first_row_line = layout.first_row_line + u64::from(hinted && layout.header_line.is_none());
            let layout = TableLayout { first_row_line, ..layout };
            let rank = (layout.regular, agree, layout.names.len());
            if best.as_ref().is_none_or(|(known, _)| rank > *known) {
                best = Some((rank, layout));
            }
        }
    }
    best.filter(|(_, layout)| layout.delimiter != BLANKS || layout.regular || layout.only_numbers)
        .map(|(_, layout)| Layout::Table(layout))
        .ok_or_else(|| {
            "not a table: no delimiter (comma, semicolon, TAB, bar or blanks) gives most of the first lines the same \
             number of fields"
                .into()
        })
}

/// Whether the layout is regular, the number of records that agree with it, and its width. The larger is the better.
type Rank = (bool, usize, usize);

/// Whether every row begins with a timestamp and one of a few words, and rows with the same word have the same width.
/// There is no header: the word names the table of the row.
fn is_tagged(sample: &[Sampled]) -> bool {
    let mut widths: Vec<(&str, usize)> = vec![];
    let mut irregular = 0;
    for row in sample {
        let [stamp, word, _, ..] = row.fields.as_slice() else { return false };
        let plain = |b: u8| b.is_ascii_alphanumeric() || b == b'_';
        let named = word.starts_with(|c: char| c.is_ascii_alphabetic()) && word.bytes().all(plain);
        let timed = matches!(Decimal::Point.number(stamp.as_bytes()), Cell::Integer(_) | Cell::Float(_));
        if !named || !timed {
            return false;
        }
        match widths.iter().find(|(known, _)| known == word) {
            Some((_, width)) => irregular += usize::from(*width != row.fields.len()),
            None => widths.push((word, row.fields.len())),
        }
    }
    // A few corrupt rows are tolerated.
    8 * irregular <= sample.len() && widths.len() <= MOST_TAGS && sample.len() >= FEWEST_ROWS
}

fn sample(head: &[u8], delimiter: u8, context: &ReadContext<'_>) -> Result<Vec<Sampled>, LogError> {
    let mut lines = Lines::new(head, "", context);
    let mut fields = Fields::default();
    let mut sampled = vec![];
    while sampled.len() < SAMPLE
        && let Next::Record(extent) = lines.next(Some(delimiter))?
    {
        let text = lines.text(extent).trim_ascii();
        let comment = comment_mark(text);
        // A record without a line end may be truncated anywhere, and is not used.
        if text.starts_with(END_OF_PREAMBLE) {
            sampled.clear();
        } else if !text.is_empty() && extent.ended && !(lines.number == 1 && is_hint(text)) {
            // Names may be missing at the end of the line.
            let line = lines.text(extent);
            let row = if comment > 0 { super::unmarked(line.trim_ascii_start()) } else { line };
            fields.split(row, delimiter);
            sampled.push(Sampled { line: lines.number, comment: comment > 0, fields: fields.texts() });
        }
        lines.pass(extent);
    }
    Ok(sampled)
}

/// Whether a first line only states the delimiter for a spreadsheet: `sep=;`.
fn is_hint(line: &[u8]) -> bool {
    matches!(line, [b's' | b'S', b'e' | b'E', b'p' | b'P', b'=', _])
}

/// Decimal separator. It is a comma if some cell proves it and none has decimals after a point;
/// if all cells with commas may also be thousands, it is unknown, and they are not numbers.
fn decimal_of(rows: &[&Sampled], delimiter: u8) -> Decimal {
    let cells = || rows.iter().flat_map(|r| &r.fields);
    let of_thousands = |cell: &str| comma_cell(&cell.replace('.', ",")) == Some(CommaCell::Either);
    let pointed = |cell: &String| {
        let number = matches!(Decimal::Point.number(cell.as_bytes()), Cell::Float(_));
        number && cell.contains('.') && !of_thousands(cell)
    };
    let certain = cells().any(|cell| comma_cell(cell) == Some(CommaCell::Decimals));
    if delimiter != b',' && certain && !cells().any(pointed) { Decimal::Comma } else { Decimal::Point }
}

/// The records of a table except remarks, the most frequent number of fields, and the decimal separator.
struct Rows<'s> {
    all: Vec<&'s Sampled>,
    width: usize,
    decimal: Decimal,
}

impl<'s> Rows<'s> {
    /// The line above the first number that names the columns, below others, such as groups of columns.
    fn unused_names(&self) -> Option<u64> {
        let words = self.all.iter().take_while(|row| !row.has_number(self.decimal));
        words.filter(|row| self.fits(&row.fields) && row.names_columns(self.decimal)).last().map(|row| row.line)
    }

    /// The lines with the names and units of the columns.
    fn head(&self, sample: &'s [Sampled]) -> (Option<&'s Sampled>, Option<&'s Sampled>) {
        // If a remark names the columns, dates and times in words below it are not names.
        let first_line = self.all.first().map_or(0, |r| r.line);
        let is_marked_header = |s: &Sampled| s.comment && s.line < first_line && self.fits(&s.fields);
        let marked = sample.iter().any(|s| is_marked_header(s) && s.names_columns(self.decimal));
        let names = |r: &Sampled| r.names_columns(self.decimal) && !(marked && r.has_moment());
        let is_data = |r: &&Sampled| r.fields.len() == self.width && !names(r) && !r.states_units();
        let data_at = self.all.iter().position(is_data);
        let before_data = self.all.get(..data_at.unwrap_or(self.all.len())).unwrap_or_default();
        let header = before_data.iter().copied().find(|r| self.fits(&r.fields) && names(r));
        let data_line = data_at.and_then(|i| self.all.get(i)).map_or(u64::MAX, |r| r.line);
        let is_remark = |s: &&Sampled| s.comment && s.line < data_line && self.fits(&s.fields);
        let comments: Vec<&Sampled> = sample.iter().filter(is_remark).collect();
        let header = header.or_else(|| comments.iter().copied().rfind(|c| c.names_columns(self.decimal)));
        (header, self.units_below(header, before_data, &comments))
    }

    /// The line with the units of the columns.
    fn units_below(
        &self,
        header: Option<&'s Sampled>,
        before_data: &[&'s Sampled],
        comments: &[&'s Sampled],
    ) -> Option<&'s Sampled> {
        let width = self.width;
        let units = before_data.iter().copied().find(|r| r.states_units() && r.fields.len().abs_diff(width) < 2);
        let is_other = |s: &Sampled| header.is_some_and(|h| h.line != s.line);
        // A remark above the header without units is the last choice.
        let is_below = |c: &Sampled| header.is_some_and(|h| h.comment || c.line > h.line);
        let no_row = |c: &&Sampled| !c.has_number(self.decimal);
        let fits = |c: &&Sampled| is_other(c) && (c.states_units() || (is_below(c) && no_row(c)));
        let comments = || comments.iter().copied();
        let units = units.or_else(|| comments().rfind(fits));
        let units = units.or_else(|| {
            let below = before_data.iter().copied().find(|r| header.is_some_and(|h| r.line > h.line))?;
            // The header may be repeated between the rows, followed by the units.
            let is_header = |r: &Sampled| header.is_some_and(|h| h.fields == r.fields);
            let again = |before: &Sampled, r: &Sampled| is_header(r) || (is_header(before) && r.fields == below.fields);
            let pairs = self.all.iter().zip(self.all.iter().skip(1)).filter(|(_, r)| r.line > below.line);
            let data: Vec<&Sampled> = pairs.filter(|(before, r)| !again(before, r)).map(|(_, r)| *r).collect();
            below.describes(&data, width, self.decimal).then_some(below)
        });
        units.or_else(|| comments().filter(no_row).rfind(|c| is_other(c)))
    }

    /// The names of the columns, empty if there are none.
    fn names(&self, header: Option<&Sampled>) -> Vec<String> {
        let mut named = header.map_or_else(|| vec![String::new(); self.width], |h| h.fields.clone());
        // A delimiter at the end of the lines does not make a column.
        let unnamed_last = named.last().is_some_and(String::is_empty);
        if named.len() == self.width + 1 || (header.is_some() && unnamed_last && self.trail()) {
            named.pop();
        }
        named
    }

    /// Whether a column is numeric in the rows after a line. Other headers may be among them.
    fn is_of_numbers(&self, column: usize, line: u64) -> bool {
        let rows = self.all.iter().filter(|r| r.line > line);
        let cells = rows.filter_map(|r| r.fields.get(column)).map(|cell| self.decimal.number(cell.as_bytes()));
        let (mut numbers, mut bad) = (0, 0);
        for cell in cells {
            numbers += usize::from(matches!(cell, Cell::Integer(_) | Cell::Float(_)));
            bad += usize::from(cell == Cell::Bad);
        }
        numbers > bad
    }

    /// Whether a header has a name for each field: one more or less is a delimiter at the end of the line.
    fn fits(&self, header: &[String]) -> bool {
        header.len() == self.width
            || (header.len() == self.width + 1 && header.last().is_some_and(|last| last.is_empty() || last == REMARKS))
            || (header.len() + 1 == self.width && self.trail())
    }

    /// Whether all rows of this width end in a delimiter.
    fn trail(&self) -> bool {
        let mut rows = self.all.iter().filter(|r| r.fields.len() == self.width);
        rows.all(|r| r.fields.last().is_some_and(String::is_empty))
    }
}

/// The layout with one delimiter, and how many records agree with it. `None` if it makes no table.
fn lay_out(sample: &[Sampled], delimiter: u8) -> Option<(usize, TableLayout)> {
    let all: Vec<&Sampled> = sample.iter().filter(|s| !s.comment).collect();
    let (width, agree) = common_width(&all)?;
    if width < 2 || 2 * agree < all.len() {
        return None;
    }
    let decimal = decimal_of(&all, delimiter);
    let rows = Rows { all, width, decimal };
    let (header, units) = rows.head(sample);
    let last_before = [header, units].into_iter().flatten().map(|s| s.line).max().unwrap_or(0);
    let (names, renamed) = unique(rows.names(header));
    let looked_at = || rows.all.iter().filter(|r| r.line > last_before);
    let regular =
        header.is_some() && looked_at().all(|r| r.fields.len() == width) && looked_at().any(|r| r.has_number(decimal));
    let only_numbers = header.is_none()
        && rows.all.len() >= FEWEST_ROWS
        && rows.all.iter().all(|r| r.fields.len() == width && r.is_all_numbers(decimal));
    let layout = TableLayout {
        delimiter,
        decimal,
        numbers: (0..names.len()).map(|column| rows.is_of_numbers(column, last_before)).collect(),
        names,
        renamed,
        header_line: header.map(|h| h.line),
        units_line: units.map(|u| u.line),
        unused_names: rows.unused_names().filter(|_| header.is_none()),
        first_row_line: if header.is_none() { 1 } else { last_before + 1 },
        other_rows: header.and_then(|h| other_rows(rows.all.iter().take_while(|r| r.line < h.line), decimal)),
        regular,
        only_numbers,
    };
    Some((agree, layout))
}

/// The first line and the number of rows before a header that are not remarks: they have at least three cells, half of
/// them numbers or more.
fn other_rows<'s>(rows: impl Iterator<Item = &'s &'s Sampled>, decimal: Decimal) -> Option<(u64, u64)> {
    let numbers = |row: &Sampled| {
        row.fields.iter().filter(|f| matches!(decimal.number(f.as_bytes()), Cell::Integer(_) | Cell::Float(_))).count()
    };
    let rows: Vec<&Sampled> =
        rows.copied().filter(|r| r.fields.len() >= 3 && 2 * numbers(r) >= r.fields.len()).collect();
    (rows.len() >= FEWEST_ROWS).then(|| Some((rows.first()?.line, rows.len() as u64)))?
}

/// The most frequent number of fields, the larger of two that are equally frequent, and how often it occurs.
fn common_width(rows: &[&Sampled]) -> Option<(usize, usize)> {
    let count = |width: usize| rows.iter().filter(|r| r.fields.len() == width).count();
    rows.iter().map(|r| r.fields.len()).max_by_key(|&width| (count(width), width)).map(|width| (width, count(width)))
}

/// Gives every column a unique name, and returns how many had none. `rostopic echo -p` puts
/// `field.` before each path.
pub(super) fn unique(named: Vec<String>) -> (Vec<String>, usize) {
    let echo = named.first().is_some_and(|n| n == "%time");
    let mut taken = std::collections::HashSet::new();
    let mut renamed = 0;
    let mut names = Vec::with_capacity(named.len());
    for (index, name) in named.iter().enumerate() {
        let plain = if echo { name.strip_prefix("field.").unwrap_or(name) } else { restored(name) };
        let mut unique = if plain.is_empty() { format!("column_{}", index + 1) } else { plain.to_owned() };
        renamed += usize::from(plain.is_empty() || taken.contains(&unique));
        while !taken.insert(unique.clone()) {
            unique = format!("{unique}#{}", index + 1);
        }
        names.push(unique);
    }
    (names, renamed)
}
