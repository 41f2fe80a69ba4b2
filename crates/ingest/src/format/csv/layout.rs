//! Finds the delimiter, the header and the units of a table from its first lines.

use super::fields::{Cell, Fields, number};
use super::lines::{Lines, Next};
use crate::error::IngestError;
use crate::reader::ReadContext;
use std::sync::atomic::AtomicBool;

/// Records that are looked at.
const SAMPLE: usize = 64;
/// In order of preference where two fit equally.
const DELIMITERS: [u8; 3] = *b",;\t";

/// How a text file is laid out.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Layout {
    /// One table.
    Table(TableLayout),
    /// FlySight 2: several tables, each row named.
    FlySight2,
}

/// Where things stand in a table.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct TableLayout {
    /// Between fields.
    pub(super) delimiter: u8,
    /// Column names, unique.
    pub(super) names: Vec<String>,
    /// Names that were empty or repeated and were changed.
    pub(super) renamed: usize,
    /// Line of the header, if there is one.
    pub(super) header_line: Option<u64>,
    /// Line of the units, if there is one.
    pub(super) units_line: Option<u64>,
    /// Rows begin at this line.
    pub(super) first_row_line: u64,
    /// There is a header, a row with a number, and all rows looked at have the same number of fields.
    pub(super) regular: bool,
}

impl TableLayout {
    /// In words, for the health of the log.
    pub(super) fn describe(&self) -> String {
        let delimiter = match self.delimiter {
            b'\t' => "TAB".to_owned(),
            other => format!("'{}'", char::from(other)),
        };
        let header = self.header_line.map_or("no header".to_owned(), |line| format!("header in line {line}"));
        let units = self.units_line.map_or(String::new(), |line| format!(", units in line {line}"));
        format!("{delimiter} delimited, {header}{units}")
    }
}

struct Sampled {
    line: u64,
    comment: bool,
    fields: Vec<String>,
}

impl Sampled {
    fn has_number(&self) -> bool {
        self.fields.iter().any(|f| !matches!(number(f.as_bytes()), Cell::Empty | Cell::Bad))
    }

    fn names_columns(&self) -> bool {
        let filled = self.fields.iter().filter(|f| !f.is_empty()).count();
        !self.has_number() && 2 * filled >= self.fields.len() && !self.states_units()
    }

    /// `(deg)`, `[m/s]` or a plain unit in every cell that is not empty, and at least one such cell.
    fn states_units(&self) -> bool {
        let mut filled = self.fields.iter().filter(|f| !f.is_empty()).peekable();
        filled.peek().is_some() && filled.all(|f| is_unit(f))
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
        return Err("this is UTF-16 text; save it as UTF-8".into());
    }
    if head.starts_with(b"$FLYS") {
        return Ok(Layout::FlySight2);
    }
    // These bytes are read again by the reader, which reports them and hears a wish to stop.
    let never = AtomicBool::new(false);
    let quiet = ReadContext { limits: context.limits, cancel: &never, on_bytes: &|_| () };
    let mut best: Option<(usize, usize, TableLayout)> = None;
    for delimiter in DELIMITERS {
        let sample = sample(head, delimiter, &quiet).map_err(|e| e.to_string())?;
        if let Some((agree, layout)) = lay_out(&sample, delimiter) {
            let width = layout.names.len();
            if best.as_ref().is_none_or(|(a, w, _)| (agree, width) > (*a, *w)) {
                best = Some((agree, width, layout));
            }
        }
    }
    best.map(|(_, _, layout)| Layout::Table(layout)).ok_or_else(|| {
        "no table: no delimiter (comma, semicolon or TAB) gives most of the first lines the same number of fields"
            .into()
    })
}

fn sample(head: &[u8], delimiter: u8, context: &ReadContext<'_>) -> Result<Vec<Sampled>, IngestError> {
    let mut lines = Lines::new(head, "", context);
    let mut fields = Fields::default();
    let mut sampled = vec![];
    while sampled.len() < SAMPLE
        && let Next::Record(extent) = lines.next(Some(delimiter))?
    {
        let text = lines.text(extent).trim_ascii();
        let comment = text.starts_with(b"#");
        // A record without its line end may be cut anywhere, so it says nothing of the layout.
        if !text.is_empty() && extent.ended {
            let row = if comment { text.get(1..).unwrap_or_default() } else { lines.text(extent) };
            fields.split(row, delimiter);
            sampled.push(Sampled { line: lines.number, comment, fields: fields.texts() });
        }
        lines.pass(extent);
    }
    Ok(sampled)
}

/// The layout with one delimiter, and how many records agree with it. `None` if it makes no table.
fn lay_out(sample: &[Sampled], delimiter: u8) -> Option<(usize, TableLayout)> {
    let rows: Vec<&Sampled> = sample.iter().filter(|s| !s.comment).collect();
    let (width, agree) = common_width(&rows)?;
    if width < 2 || 2 * agree < rows.len() {
        return None;
    }
    let data_at = rows.iter().position(|r| r.fields.len() == width && !r.names_columns() && !r.states_units());
    let before_data = rows.get(..data_at.unwrap_or(rows.len()))?;
    let header = before_data.iter().find(|r| fits_width(&r.fields, width, &rows) && r.names_columns());
    let data_line = data_at.and_then(|i| rows.get(i)).map_or(u64::MAX, |r| r.line);
    let comments = || sample.iter().filter(|s| s.comment && s.line < data_line && s.fields.len() == width);
    let header = header.copied().or_else(|| comments().rfind(|c| c.names_columns()));
    let units = before_data.iter().copied().find(|r| r.states_units() && r.fields.len().abs_diff(width) < 2);
    let units = units.or_else(|| comments().rfind(|c| header.is_some_and(|h| h.line != c.line)));
    let last_before = [header, units].into_iter().flatten().map(|s| s.line).max().unwrap_or(0);
    let mut named = header.map_or_else(|| vec![String::new(); width], |h| h.fields.clone());
    // A delimiter at the end of the lines makes no column.
    let unnamed_last = named.last().is_some_and(String::is_empty);
    if named.len() == width + 1 || (header.is_some() && unnamed_last && rows_trail(&rows, width)) {
        named.pop();
    }
    let (names, renamed) = unique(named);
    let rows_looked_at = rows.iter().filter(|r| r.line > last_before);
    let regular = header.is_some()
        && rows_looked_at.clone().all(|r| r.fields.len() == width)
        && rows_looked_at.clone().any(|r| r.has_number());
    Some((
        agree,
        TableLayout {
            delimiter,
            names,
            renamed,
            header_line: header.map(|h| h.line),
            units_line: units.map(|u| u.line),
            first_row_line: if header.is_none() { 1 } else { last_before + 1 },
            regular,
        },
    ))
}

/// The most frequent number of fields, the larger where two are as frequent, and how often it occurs.
fn common_width(rows: &[&Sampled]) -> Option<(usize, usize)> {
    let count = |width: usize| rows.iter().filter(|r| r.fields.len() == width).count();
    rows.iter().map(|r| r.fields.len()).max_by_key(|&width| (count(width), width)).map(|width| (width, count(width)))
}

/// Whether a header has a name for each field: one more or less is a delimiter at the end of the line.
fn fits_width(header: &[String], width: usize, rows: &[&Sampled]) -> bool {
    header.len() == width
        || (header.len() == width + 1 && header.last().is_some_and(String::is_empty))
        || (header.len() + 1 == width && rows_trail(rows, width))
}

/// Whether all rows of this width end in a delimiter.
fn rows_trail(rows: &[&Sampled], width: usize) -> bool {
    rows.iter().filter(|r| r.fields.len() == width).all(|r| r.fields.last().is_some_and(String::is_empty))
}

/// Gives every column a name of its own, and says how many had none. `rostopic echo -p` puts
/// `field.` before each path.
pub(super) fn unique(named: Vec<String>) -> (Vec<String>, usize) {
    let echo = named.first().is_some_and(|n| n == "%time");
    let mut taken = std::collections::HashSet::new();
    let mut renamed = 0;
    let mut names = Vec::with_capacity(named.len());
    for (index, name) in named.iter().enumerate() {
        let plain = if echo { name.strip_prefix("field.").unwrap_or(name) } else { name };
        let mut unique = if plain.is_empty() { format!("column_{}", index + 1) } else { plain.to_owned() };
        renamed += usize::from(plain.is_empty() || taken.contains(&unique));
        while !taken.insert(unique.clone()) {
            unique = format!("{unique}#{}", index + 1);
        }
        names.push(unique);
    }
    (names, renamed)
}
