//! Headers between the rows, as found where a logger restarted or logs were concatenated. The same header may be
//! repeated. Rows below another header are not read.

use super::fields::{BLANKS, Cell, Fields, number};
use flight::{Code, Notices, Severity};
use std::collections::HashSet;

/// The header of a table as written.
#[derive(Debug, Default)]
pub(super) struct Header {
    /// The line of the header.
    line: Vec<u8>,
    pub(super) delimiter: u8,
    /// The names in the header.
    names: Vec<Vec<u8>>,
    known: HashSet<Vec<u8>>,
    /// First bytes of the names.
    first_bytes: FirstBytes,
    /// Which columns are numeric, as far as the first rows show.
    numbers: Vec<bool>,
    /// The first numeric column. A row with a word in it is a header or irregular.
    first_number: Option<usize>,
    /// Start of the units line, if there is one.
    units: Vec<u8>,
}

#[derive(Debug)]
struct FirstBytes([bool; 256]);

impl Default for FirstBytes {
    fn default() -> FirstBytes {
        FirstBytes([false; 256])
    }
}

/// Other headers found in a file, and lines that resemble headers or rows.
#[derive(Debug, Default)]
pub(super) struct HeaderFindings {
    /// The number of other headers, and the line of the first.
    others: (u64, u64),
    /// The number of rows that may be headers of other tables, and the line of the first.
    like_headers: (u64, u64),
    /// The number of remarks with as many fields as the table has columns, and the line of the first.
    remarks: (u64, u64),
}

impl HeaderFindings {
    /// Counts a row that is read as a row and may be the header of another table.
    pub(super) fn count_like_header(&mut self, line: u64) {
        count_from(&mut self.like_headers, line);
    }

    /// Counts a remark that resembles a row.
    pub(super) fn count_remark(&mut self, line: u64) {
        count_from(&mut self.remarks, line);
    }

    pub(super) fn count_other(&mut self, line: u64) {
        count_from(&mut self.others, line);
    }

    pub(super) fn report(&self, file: &str, notices: &mut Notices) {
        let mut warn = |(count, line): (u64, u64), text: &str| {
            if count > 0 {
                notices.push(Code::IrregularTable.at(Severity::Warning), format!("{file}, line {line}"), count, text);
            }
        };
        let text = "a row has words where the others have numbers, like the header of another table; this row and \
            the rows after it are read as rows of this table";
        warn(self.like_headers, text);
        let text = "comments with as many fields as the table has columns; they are not read as rows";
        warn(self.remarks, text);
        if self.others.0 > 0 {
            let text = "another header is between the rows; the rows after it are not read until the first header comes \
                 again";
            let place = format!("{file}, line {}", self.others.1);
            notices.push(Code::IrregularTable.at(Severity::Loss), place, self.others.0, text);
        }
    }
}

/// Counts a finding, and remembers the line of the first.
fn count_from((count, first): &mut (u64, u64), line: u64) {
    if *count == 0 {
        *first = line;
    }
    *count += 1;
}

fn is_number(cell: &[u8]) -> bool {
    matches!(number(cell), Cell::Integer(_) | Cell::Float(_) | Cell::NotFinite)
}

/// A word that can be a name: it does not begin with a digit.
fn is_word(cell: &[u8]) -> bool {
    let begins_so = cell.first().is_some_and(|byte| !byte.is_ascii_digit());
    begins_so && number(cell) == Cell::Bad && cell.iter().any(u8::is_ascii_alphabetic)
}

impl Header {
    /// From a line, its fields and delimiter, and which columns are numeric.
    pub(super) fn new(line: &[u8], fields: &Fields, delimiter: u8, numbers: Vec<bool>) -> Header {
        let names: Vec<Vec<u8>> = (0..fields.len()).map(|index| fields.get(index).to_vec()).collect();
        let known: HashSet<Vec<u8>> = names.iter().filter(|name| !name.is_empty()).cloned().collect();
        let mut first_bytes = FirstBytes::default();
        for first in names.iter().filter_map(|name| name.first()) {
            if let Some(begin) = first_bytes.0.get_mut(usize::from(*first)) {
                *begin = true;
            }
        }
        let first_number = numbers.iter().position(|of_numbers| *of_numbers);
        Header { line: line.to_vec(), delimiter, names, known, first_bytes, numbers, first_number, units: vec![] }
    }

    /// Whether the fields are the names of this header, with or without quotes.
    pub(super) fn has_names(&self, fields: &Fields) -> bool {
        fields.len() == self.names.len() && (0..).zip(&self.names).all(|(index, name)| fields.get(index) == name)
    }

    /// Whether the line is this header.
    pub(super) fn is(&self, line: &[u8]) -> bool {
        !line.is_empty() && line == self.line
    }

    /// Whether a line may be something other than a row, as [`Header::may_be_header`]. A line with quotes always may.
    pub(super) fn may_begin(&self, line: &[u8]) -> bool {
        let blanks = self.delimiter == BLANKS;
        let between = |byte: &u8| if blanks { byte.is_ascii_whitespace() } else { *byte == self.delimiter };
        let mut cells = line.split(between).map(<[u8]>::trim_ascii).filter(|cell| !blanks || !cell.is_empty());
        let first = cells.clone().next().unwrap_or_default();
        let first_number = self.first_number.and_then(|column| cells.clone().nth(column)).unwrap_or_default();
        let last = cells.next_back().unwrap_or_default();
        memchr::memchr(b'"', line).is_some() || self.may_be_header(first, last, first_number)
    }

    /// Sets the first cell of the units line below the header.
    pub(super) fn set_units(&mut self, begin: &[u8]) {
        self.units = begin.to_vec();
    }

    /// The first numeric column, which is examined in every row.
    pub(super) fn first_number(&self) -> Option<usize> {
        self.first_number
    }

    /// Whether a row may be a header or the units below one, by its first and last field and that of the
    /// [first numeric column](Header::first_number).
    #[inline]
    pub(super) fn may_be_header(&self, first: &[u8], last: &[u8], first_number: &[u8]) -> bool {
        const BOM: u8 = 0xef;
        let is_name = |cell: &[u8]| {
            let begin = cell.first().and_then(|byte| self.first_bytes.0.get(usize::from(*byte)));
            begin == Some(&true) && self.known.contains(cell)
        };
        let word = match first_number {
            // A number may begin with a decimal point.
            [b'.', digit, ..] if digit.is_ascii_digit() => false,
            [first, ..] => first.is_ascii_alphabetic() || *first >= 0x80 || b"_.".contains(first),
            // Names may be missing.
            [] => self.first_number.is_some(),
        };
        word || is_name(first)
            || is_name(last)
            || first.first() == Some(&BOM)
            || (!first.is_empty() && first == self.units)
    }

    /// Whether a row is another header: it has words where the first rows have numbers, and half of its fields, at least
    /// two, are names of this header. Instead of half, one such name in its own column is enough if all fields are
    /// distinct words and the width is that of the table. Without a numeric column the names alone decide.
    pub(super) fn is_other_header(&self, fields: &Fields) -> bool {
        let filled: Vec<(usize, &[u8])> =
            (0..fields.len()).map(|i| (i, fields.get(i))).filter(|f| !f.1.is_empty()).collect();
        let is_known = |cell: &[u8]| self.known.contains(cell);
        let known = filled.iter().filter(|(_, cell)| is_known(cell)).count();
        let is_in_place = |(index, cell): &(usize, &[u8])| self.names.get(*index).is_some_and(|name| name == cell);
        let of_numbers = |(index, cell): &(usize, &[u8])| {
            self.numbers.get(*index) == Some(&true) && (is_known(cell) || is_word(cell))
        };
        // Rows of another width are rejected anyway.
        let width = self.width_of(fields);
        let is_as_wide = width == self.names.len() || width == self.numbers.len();
        let distinct = || filled.iter().map(|(_, cell)| cell).collect::<HashSet<_>>().len() == filled.len();
        let all_words = || 2 * filled.len() >= fields.len() && filled.iter().all(|(_, cell)| is_word(cell));
        let has_words = filled.iter().any(of_numbers);
        let half = known >= 2 && 2 * known >= filled.len() && (has_words || self.first_number.is_none());
        half || has_words && known > 0 && is_as_wide && filled.iter().any(is_in_place) && all_words() && distinct()
    }

    /// Whether a row may be the header of another table: distinct words in all columns, of which at least two are
    /// numeric.
    pub(super) fn looks_like_header(&self, fields: &Fields) -> bool {
        let words = || (0..fields.len()).map(|index| fields.get(index));
        let of_numbers = self.numbers.iter().filter(|of_numbers| **of_numbers).count();
        of_numbers >= 2
            && fields.len() == self.numbers.len()
            && words().all(is_word)
            && words().collect::<HashSet<_>>().len() == fields.len()
    }

    /// Whether a remark has as many fields as the table, all but the first of them numbers or empty.
    pub(super) fn is_like_row(&self, fields: &Fields) -> bool {
        let others = || (1..fields.len()).map(|index| fields.get(index)).filter(|cell| !cell.is_empty());
        fields.len() == self.names.len() && others().next().is_some() && others().all(is_number)
    }

    /// The number of columns of a header. A delimiter at the end of the line adds none, unless the table has that many
    /// columns.
    fn width_of(&self, fields: &Fields) -> usize {
        let last = fields.len().saturating_sub(1);
        let trails = last > 0 && fields.len() != self.numbers.len() && fields.get(last).is_empty();
        fields.len() - usize::from(trails)
    }

    /// Whether a comment that may be a header is one, and not a remark with some of its words. It then begins with the
    /// first name, or has only names of this header.
    pub(super) fn is_header_comment(&self, fields: &Fields) -> bool {
        let mut filled = (0..fields.len()).map(|i| fields.get(i)).filter(|cell| !cell.is_empty());
        self.names.first().is_some_and(|name| name == fields.get(0)) || filled.all(|cell| self.known.contains(cell))
    }

    /// Number of columns.
    pub(super) fn width(&self) -> usize {
        self.names.len()
    }
}
