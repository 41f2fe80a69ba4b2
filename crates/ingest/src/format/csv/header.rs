//! A header that stands again between the rows, as it does where a logger was started anew or logs were put together: the
//! same, or one with the columns in another order or of another number.

use super::fields::Fields;
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
    pub(super) fn new(line: &[u8], fields: &Fields, delimiter: u8) -> Header {
        let names: Vec<Vec<u8>> = (0..fields.len()).map(|index| fields.get(index).to_vec()).collect();
        let known: HashSet<Vec<u8>> = names.iter().filter(|name| !name.is_empty()).cloned().collect();
        let mut begins = Begins::default();
        for first in names.iter().filter_map(|name| name.first()) {
            if let Some(begin) = begins.0.get_mut(usize::from(*first)) {
                *begin = true;
            }
        }
        Header { line: line.to_vec(), delimiter, names, known, begins }
    }

    /// Whether the line is this one.
    pub(super) fn is(&self, line: &[u8]) -> bool {
        !line.is_empty() && line == self.line
    }

    /// Whether a line may be a header, by its ends: quotes hide nothing there but quotes.
    pub(super) fn may_begin(&self, line: &[u8]) -> bool {
        let plain = |cell: &[u8]| -> Vec<u8> { cell.trim_ascii().iter().copied().filter(|b| *b != b'"').collect() };
        let line = line.trim_ascii();
        let first = line.split(|b| *b == self.delimiter).next().unwrap_or_default();
        let last = line.rsplit(|b| *b == self.delimiter).find(|cell| !cell.is_empty()).unwrap_or_default();
        let digit = |cell: &[u8]| cell.first().is_none_or(|b| b.is_ascii_digit() || b"+-.".contains(b));
        !(digit(first) && digit(last)) && self.may_be(&plain(first), &plain(last))
    }

    /// Whether a row with this first and this last field may be a header.
    #[inline]
    pub(super) fn may_be(&self, first: &[u8], last: &[u8]) -> bool {
        [first, last].into_iter().any(|cell| {
            let begin = cell.first().and_then(|byte| self.begins.0.get(usize::from(*byte)));
            begin == Some(&true) && self.known.contains(cell)
        })
    }

    /// What a row says if it is another header: at least two names of this one, and they are half of its fields.
    pub(super) fn other(&self, fields: &Fields) -> Option<Other> {
        let cell = |index: usize| fields.get(index);
        let filled: Vec<usize> = (0..fields.len()).filter(|index| !cell(*index).is_empty()).collect();
        let known = filled.iter().filter(|index| self.known.contains(cell(**index))).count();
        if known < 2 || 2 * known < filled.len() {
            return None;
        }
        // Of equal names the first stands for the first.
        let mut left: HashMap<&[u8], VecDeque<usize>> = HashMap::new();
        filled.iter().for_each(|index| left.entry(cell(*index)).or_default().push_back(*index));
        let places = self.names.iter().map(|name| left.get_mut(name.as_slice())?.pop_front()).collect();
        let mut new: Vec<usize> = left.into_values().flatten().collect();
        new.sort_unstable();
        let new = new.into_iter().map(|index| super::fields::text_of(cell(index))).collect();
        // A delimiter at the end of the line makes no column.
        let trails = fields.len() > 1 && cell(fields.len() - 1).is_empty();
        Some(Other { places, width: fields.len() - usize::from(trails), new })
    }
}
