//! A header that stands again between the rows, as it does where a logger was started anew or logs were put together: the
//! same, or one with the columns in another order or of another number.

use super::fields::{Cell, Fields, number};
use super::layout::is_unit;
use flight::{Notices, Severity};
use std::collections::{HashMap, HashSet, VecDeque};

/// The header of a table as it is written.
#[derive(Debug, Default)]
pub(super) struct Header {
    /// Its line.
    line: Vec<u8>,
    pub(super) delimiter: u8,
    /// The names in it.
    names: Vec<Vec<u8>>,
    known: HashSet<Vec<u8>>,
    /// What names begin with, by byte.
    begins: Begins,
    /// Which columns are of numbers, as far as the first rows tell.
    numbers: Vec<bool>,
}

#[derive(Debug)]
struct Begins([bool; 256]);

impl Default for Begins {
    fn default() -> Begins {
        Begins([false; 256])
    }
}

/// Another header: where the columns of the first one stand in it.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Other {
    pub(super) places: Vec<Option<usize>>,
    pub(super) width: usize,
    /// Names that the first one does not have.
    pub(super) new: Vec<String>,
}

/// What other headers of a file there were.
#[derive(Debug, Default)]
pub(super) struct Changes {
    count: u64,
    first_line: u64,
    /// The first names that the first header does not have, and how many there are.
    new: Vec<String>,
    all_new: u64,
}

impl Changes {
    pub(super) fn add(&mut self, line: u64, new: Vec<String>) {
        const LISTED: usize = 20;
        if self.count == 0 {
            self.first_line = line;
        }
        self.count += 1;
        self.all_new += new.len() as u64;
        let room = LISTED.saturating_sub(self.new.len());
        self.new.extend(new.into_iter().take(room));
    }

    pub(super) fn tell(&self, file: &str, notices: &mut Notices) {
        if self.count == 0 {
            return;
        }
        let place = format!("{file}, line {}", self.first_line);
        let text = "another header stands between the rows: those below it are read by its order of columns";
        notices.push(Severity::Info, "header-changed", place.as_str(), self.count, text);
        if self.all_new > 0 {
            let more = if self.all_new > self.new.len() as u64 { ", ..." } else { "" };
            let names = self.new.join(", ");
            let text = format!("columns that the first header does not have are not read: {names}{more}");
            notices.push(Severity::Loss, "columns-not-read", place, self.all_new, text);
        }
    }
}

impl Header {
    /// Of a line, its fields, and what stands between them.
    pub(super) fn new(line: &[u8], fields: &Fields, delimiter: u8, numbers: Vec<bool>) -> Header {
        let names: Vec<Vec<u8>> = (0..fields.len()).map(|index| fields.get(index).to_vec()).collect();
        let known: HashSet<Vec<u8>> = names.iter().filter(|name| !name.is_empty()).cloned().collect();
        let mut begins = Begins::default();
        for first in names.iter().filter_map(|name| name.first()) {
            if let Some(begin) = begins.0.get_mut(usize::from(*first)) {
                *begin = true;
            }
        }
        Header { line: line.to_vec(), delimiter, names, known, begins, numbers }
    }

    /// Whether the line is this one.
    pub(super) fn is(&self, line: &[u8]) -> bool {
        !line.is_empty() && line == self.line
    }

    /// Whether a line may be a header, by its ends.
    pub(super) fn may_begin(&self, line: &[u8]) -> bool {
        let line = line.trim_ascii();
        let first = line.split(|b| *b == self.delimiter).next().unwrap_or_default();
        let last = line.rsplit(|b| *b == self.delimiter).find(|cell| !cell.is_empty()).unwrap_or_default();
        // Quotes may hide delimiters.
        line.first() == Some(&b'"') || last.ends_with(b"\"") || self.may_be(first.trim_ascii(), last.trim_ascii())
    }

    /// Whether a row with this first and this last field may be a header.
    #[inline]
    pub(super) fn may_be(&self, first: &[u8], last: &[u8]) -> bool {
        let is_name = |cell: &[u8]| {
            let begin = cell.first().and_then(|byte| self.begins.0.get(usize::from(*byte)));
            begin == Some(&true) && self.known.contains(cell)
        };
        is_name(first) || is_name(last) || (self.begins_as_word(first, true) || self.begins_as_word(last, false))
    }

    /// Whether the first or the last field begins as words do although its column is one of numbers.
    #[inline]
    fn begins_as_word(&self, cell: &[u8], is_first: bool) -> bool {
        let word = |byte: &u8| byte.is_ascii_alphabetic() || *byte == b'_' || *byte == b'"' || *byte >= 0x80;
        let column = || if is_first { self.numbers.first() } else { self.numbers.last() };
        cell.first().is_some_and(word) && column() == Some(&true)
    }

    /// Whether a row is another header: half of its fields are names of this one, and two at least, or all are words where
    /// numbers are expected.
    pub(super) fn is_other(&self, fields: &Fields) -> bool {
        let filled: Vec<(usize, &[u8])> =
            (0..fields.len()).map(|i| (i, fields.get(i))).filter(|f| !f.1.is_empty()).collect();
        let known = filled.iter().filter(|(_, cell)| self.known.contains(*cell)).count();
        if known >= 2 && 2 * known >= filled.len() {
            return true;
        }
        let is_word = |cell: &[u8]| number(cell) == Cell::Bad && cell.iter().any(u8::is_ascii_alphabetic);
        let of_numbers = filled.iter().filter(|(i, _)| self.numbers.get(*i) == Some(&true)).count();
        let distinct = || filled.iter().map(|f| f.1).collect::<HashSet<_>>().len() == filled.len();
        of_numbers + known.min(1) >= 2
            && 2 * filled.len() >= fields.len()
            && filled.iter().all(|(_, cell)| is_word(cell))
            && !filled.iter().all(|(_, cell)| std::str::from_utf8(cell).is_ok_and(is_unit))
            && distinct()
    }

    /// How many columns there are.
    pub(super) fn width(&self) -> usize {
        self.names.len()
    }

    /// What another header says; `None` if it has no column of this one.
    pub(super) fn other(&self, fields: &Fields) -> Option<Other> {
        let cell = |index: usize| fields.get(index);
        // A delimiter at the end of the line makes no column, unless there are as many as in the first.
        let trails = fields.len() > 1 && fields.len() != self.names.len() && cell(fields.len() - 1).is_empty();
        let width = fields.len() - usize::from(trails);
        // Of equal names the first stands for the first, and so it is of columns without a name.
        let mut left: HashMap<&[u8], VecDeque<usize>> = HashMap::new();
        (0..width).for_each(|index| left.entry(cell(index)).or_default().push_back(index));
        let places: Vec<Option<usize>> =
            self.names.iter().map(|name| left.get_mut(name.as_slice())?.pop_front()).collect();
        if places.iter().flatten().all(|&place| cell(place).is_empty()) {
            return None;
        }
        left.remove(&[][..]);
        let mut new: Vec<usize> = left.into_values().flatten().collect();
        new.sort_unstable();
        let new = new.into_iter().map(|index| super::fields::text_of(cell(index))).collect();
        Some(Other { places, width, new })
    }
}
