//! Splits a text file into lines and quoted records, and accounts for every byte.

use super::columns::Topic;
use super::extent::Extent;
use super::plain::comment_mark;
use super::read_ahead::{AheadReader, Rules};
use crate::error::LogError;
use crate::format::workers::Workers;
use crate::reader::ReadContext;
use logscan::{MOST_ZEROS, ScanError};
use memchr::{memchr, memchr2, memrchr};
use std::io::Read;

/// The most consecutive CRs of one line end.
const MOST_RETURNS: usize = 8;
/// Limits the bytes that are searched in vain for the end of a quoted record: to this many times the longest line, and
/// this many bytes for each byte of the file. Beyond that, quoted fields no longer span lines. Without this limit a
/// hostile file could cause a search up to the longest line for each of its lines.
const VAIN: u64 = 16;

/// A reader of lines with bounded memory. Line ends are LF, CR, CR LF and CR CR LF, mixed at will.
pub(super) struct Lines<'a, R> {
    source: AheadReader<R>,
    context: &'a ReadContext<'a>,
    file: &'a str,
    buffer: Vec<u8>,
    start: usize,
    /// The ends of the parts of the buffer with quotes and with zero bytes. Rows after them need no search.
    quotes_end: usize,
    zeros_end: usize,
    /// The end of the whole lines in the buffer.
    lines_end: usize,
    ended: bool,
    /// The number of bytes searched in vain for the end of quoted records.
    searched_in_vain: u64,
    /// The offset of the current line in the file, bytes.
    pub(super) offset: u64,
    /// The number of the current line, from 1.
    pub(super) number: u64,
}

/// The next item in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Next {
    /// A record.
    Record(Extent),
    /// A line longer than the limit.
    TooLong,
    /// The end of the file.
    End,
}

impl<'a, R: Read> Lines<'a, R> {
    pub(super) fn new(input: R, file: &'a str, context: &'a ReadContext<'a>) -> Lines<'a, R> {
        Lines {
            source: AheadReader::new(input),
            context,
            file,
            buffer: vec![],
            start: 0,
            quotes_end: 0,
            zeros_end: 0,
            lines_end: 0,
            ended: false,
            searched_in_vain: 0,
            offset: 0,
            number: 1,
        }
    }

    /// Sets the position in the file.
    pub(super) fn from(mut self, offset: u64) -> Self {
        (self.offset, self.source.at) = (offset, offset);
        self
    }

    /// Finds the next record. With a delimiter, a quoted field may span lines; without one every line is a record.
    pub(super) fn next(&mut self, delimiter: Option<u8>) -> Result<Next, LogError> {
        loop {
            let limit = self.context.limits.line_bytes;
            let quotes = self.may_hold_quotes().then_some(delimiter).flatten();
            let several_lines = self.may_span_lines();
            let rest = self.within_reach();
            let ended = self.ended && rest.len() == self.rest().len();
            if let Some(extent) = find(rest, quotes, several_lines, ended) {
                return Ok(if extent.text > limit { Next::TooLong } else { Next::Record(extent) });
            }
            if rest.len() == self.reach() {
                return Ok(self.oversized(delimiter));
            }
            if self.ended {
                return Ok(self.last(delimiter));
            }
            self.fill()?;
        }
    }

    /// The number of bytes needed to decide whether a record is too long.
    fn reach(&self) -> usize {
        self.context.limits.line_bytes + MOST_RETURNS + 1
    }

    /// At most [`Lines::reach`] of the next bytes, so that the result does not depend on how much was read at once.
    fn within_reach(&self) -> &[u8] {
        let rest = self.rest();
        rest.get(..self.reach()).unwrap_or(rest)
    }

    /// The text of a record found by [`Lines::next`].
    pub(super) fn text(&self, extent: Extent) -> &[u8] {
        self.rest().get(..extent.text).unwrap_or_default()
    }

    /// Whether the next record may hold a quote.
    pub(super) fn may_hold_quotes(&self) -> bool {
        self.start < self.quotes_end
    }

    /// Whether the next record may hold a zero byte.
    pub(super) fn may_hold_zeros(&self) -> bool {
        self.start < self.zeros_end
    }

    /// Whole lines in the buffer, if they contain neither quotes nor zero bytes.
    pub(super) fn plain_block(&self) -> &[u8] {
        let plain = !self.may_hold_quotes() && !self.may_hold_zeros();
        plain.then(|| self.buffer.get(self.start..self.lines_end)).flatten().unwrap_or_default()
    }

    /// The first line of a record over several lines that is not a row: a stray quote joined the others to it.
    pub(super) fn first_line_of(&mut self, record: Extent) -> Extent {
        if record.lines == 1 {
            return record;
        }
        self.searched_in_vain += record.whole as u64;
        find_line(self.rest(), self.ended).unwrap_or(record)
    }

    /// Whether quoted fields may still hold line ends.
    fn may_span_lines(&self) -> bool {
        self.searched_in_vain <= VAIN * (self.context.limits.line_bytes as u64 + self.offset)
    }

    /// Moves past a record.
    pub(super) fn pass(&mut self, extent: Extent) {
        self.start += extent.whole;
        self.offset += extent.whole as u64;
        self.number += extent.lines;
    }

    /// Moves past a line that is too long for memory. Returns its length, and whether the search for its end was given
    /// up, as in a sparse file of only zeros.
    pub(super) fn pass_too_long(&mut self) -> Result<(u64, bool), LogError> {
        let (from, mut zeros) = (self.offset, 0);
        loop {
            let rest = self.rest();
            let found = find_line(rest, self.ended).map(|e| e.whole);
            // An LF may follow a CR at the end of the buffer and belong to it.
            let step = found.or_else(|| memchr(b'\r', rest)).unwrap_or(rest.len());
            let passed = rest.get(..step).unwrap_or_default();
            let others = |byte: &u8| *byte != 0;
            let leading = passed.iter().position(others).unwrap_or(step) as u64;
            let given_up = zeros + leading >= MOST_ZEROS;
            zeros = passed.iter().rposition(others).map_or(zeros + leading, |at| (step - at - 1) as u64);
            self.start += step;
            self.offset += step as u64;
            if found.is_some() || self.ended || given_up {
                self.number += 1;
                return Ok((self.offset - from, given_up));
            }
            self.fill()?;
        }
    }

    /// Lets other threads parse the next rows of `topic`, if the buffer holds whole lines.
    pub(super) fn read_ahead(&mut self, workers: &Workers, topic: &Topic, rules: &Rules) -> Result<(), LogError> {
        if self.source.is_empty() {
            if self.ended || self.lines_end <= self.start {
                return Ok(());
            }
            self.source.put_back(&mut self.buffer, self.lines_end);
            self.quotes_end = self.quotes_end.min(self.lines_end);
            self.zeros_end = self.zeros_end.min(self.lines_end);
        }
        let offset = self.source.at;
        let got = self.source.read_ahead(workers, topic, rules).map_err(|source| self.failed(offset, source))?;
        Ok(self.context.advance(got)?)
    }

    /// Takes the next rows of `topic` that other threads have parsed. `None` if the buffer is not used up, or nothing was
    /// read ahead.
    pub(super) fn take_rows(&mut self, topic: &mut Topic, rules: &Rules) -> Result<Option<Extent>, LogError> {
        if !self.rest().is_empty() {
            return Ok(None);
        }
        let offset = self.offset;
        let next = self.source.next_piece().map_err(|source| self.failed(offset, source))?;
        let Some(mut piece) = next else { return Ok(None) };
        let is_wanted = piece.extent.whole > 0 && piece.rules.number == rules.number;
        let taken = is_wanted && topic.append(&mut piece.part, self.number);
        let extent = if taken { piece.extent } else { Extent::default() };
        std::mem::swap(&mut self.buffer, &mut piece.bytes);
        self.source.recycle(piece);
        (self.start, self.quotes_end, self.zeros_end, self.lines_end) = (0, 0, 0, 0);
        self.pass(extent);
        if self.start < self.buffer.len() {
            self.scan(0);
        }
        Ok(Some(extent))
    }

    #[cfg(test)]
    pub(super) fn finish_read_ahead(&self) {
        self.source.run_all();
    }

    fn rest(&self) -> &[u8] {
        self.buffer.get(self.start..).unwrap_or_default()
    }

    /// Handles a record that does not end within the limit. Of a record with an unclosed quote the first line is returned.
    fn oversized(&mut self, delimiter: Option<u8>) -> Next {
        match delimiter.and_then(|_| find_line(self.within_reach(), false)) {
            Some(line) if line.text <= self.context.limits.line_bytes => self.unclosed(line),
            _ => Next::TooLong,
        }
    }

    fn unclosed(&mut self, line: Extent) -> Next {
        self.searched_in_vain += self.within_reach().len() as u64;
        Next::Record(Extent { broken: true, ..line })
    }

    /// The text after the last line end of the file, or after a quote that is never closed.
    fn last(&mut self, delimiter: Option<u8>) -> Next {
        let whole = self.rest().len();
        if whole == 0 {
            return Next::End;
        }
        if let Some(line) = delimiter.and_then(|_| find_line(self.rest(), true)) {
            return self.unclosed(line);
        }
        Next::Record(Extent { text: whole, whole, lines: 1, ended: false, broken: false })
    }

    fn fill(&mut self) -> Result<(), LogError> {
        self.buffer.drain(..self.start);
        self.quotes_end = self.quotes_end.saturating_sub(self.start);
        self.zeros_end = self.zeros_end.saturating_sub(self.start);
        self.lines_end = self.lines_end.saturating_sub(self.start);
        self.start = 0;
        let held = self.buffer.len();
        let offset = self.source.at;
        let got = self.source.more(&mut self.buffer).map_err(|source| self.failed(offset, source))?;
        self.ended = self.buffer.len() == held;
        self.scan(held);
        Ok(self.context.advance(got)?)
    }

    /// Examines what the buffer holds from `held` on.
    fn scan(&mut self, held: usize) {
        let new = self.buffer.get(held..).unwrap_or_default();
        self.quotes_end = memrchr(b'"', new).map_or(self.quotes_end, |at| held + at + 1);
        self.zeros_end = memrchr(0, new).map_or(self.zeros_end, |at| held + at + 1);
        self.lines_end = memrchr(b'\n', new).map_or(self.lines_end, |at| held + at + 1);
    }

    fn failed(&self, offset: u64, source: std::io::Error) -> LogError {
        LogError::Read(ScanError::Io { file: self.file.to_owned(), offset, source })
    }
}

/// The first record of `data`, if its end is certain. `ended`: nothing follows `data`. Quotes have no meaning in comments,
/// and without a delimiter in no line.
fn find(data: &[u8], delimiter: Option<u8>, several_lines: bool, ended: bool) -> Option<Extent> {
    let line = find_line(data, ended)?;
    let text = data.get(..line.text)?;
    match delimiter {
        Some(delimiter) if memchr(b'"', text).is_some() && comment_mark(text.trim_ascii_start()) == 0 => {
            // A record of one line ends with its line.
            let (data, ended) = if several_lines { (data, ended) } else { (data.get(..line.whole)?, true) };
            match find_quoted(data, delimiter, ended) {
                Some(Quoted::Ends(extent)) => Some(extent),
                None if several_lines => None,
                Some(Quoted::Broken) | None => Some(Extent { broken: true, ..line }),
            }
        }
        _ => Some(line),
    }
}

enum Quoted {
    Ends(Extent),
    /// There is text between a closing quote and the delimiter.
    Broken,
}

fn find_line(data: &[u8], ended: bool) -> Option<Extent> {
    let text = memchr2(b'\n', b'\r', data)?;
    let whole = text + line_end(data.get(text..)?, ended)?;
    Some(Extent { text, whole, lines: 1, ended: true, broken: false })
}

/// Bytes of the line end at the start of `data`: a few CR before one LF, or one LF or CR.
/// `None` while more data could make it longer.
fn line_end(data: &[u8], ended: bool) -> Option<usize> {
    let returns = data.iter().take(MOST_RETURNS).take_while(|b| **b == b'\r').count();
    match data.get(returns) {
        Some(b'\n') => Some(returns + 1),
        Some(_) => Some(1),
        None => ended.then_some(1),
    }
}

/// Like [`find_line`], but line ends inside quotes belong to the field. A quote opens a field only at
/// the field's start, and only a delimiter, a line end or padding may follow the one that closes it (RFC 4180).
fn find_quoted(data: &[u8], delimiter: u8, ended: bool) -> Option<Quoted> {
    let (mut place, mut lines) = (Place::FieldStart, 1);
    let mut at = 0;
    while let Some(&byte) = data.get(at) {
        if matches!(byte, b'\n' | b'\r') {
            let size = line_end(data.get(at..)?, ended)?;
            if place != Place::Inside {
                return Some(Quoted::Ends(Extent { text: at, whole: at + size, lines, ended: true, broken: false }));
            }
            (at, lines) = (at + size, lines + 1);
            continue;
        }
        place = match (place, byte) {
            (Place::Inside, b'"') => Place::Closed,
            (Place::Inside, _) => Place::Inside,
            (Place::FieldStart | Place::Closed, b'"') => Place::Inside,
            (_, b) if b == delimiter => Place::FieldStart,
            (Place::Closed, b) if !b.is_ascii_whitespace() => return Some(Quoted::Broken),
            (Place::Closed, _) => Place::Padding,
            (Place::Padding, b) if !b.is_ascii_whitespace() => return Some(Quoted::Broken),
            (Place::Padding, _) => Place::Padding,
            (Place::FieldStart | Place::Plain, _) => Place::Plain,
        };
        at += 1;
    }
    // The last record of a file need not have a line end.
    let extent = Extent { text: at, whole: at, lines, ended: false, broken: false };
    (ended && place != Place::Inside).then_some(Quoted::Ends(extent))
}

/// Position of a byte within a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Place {
    FieldStart,
    Plain,
    Inside,
    /// After a quote that closes the field, or is the first of two.
    Closed,
    Padding,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reader::Limits;
    use std::sync::atomic::AtomicBool;

    fn records(text: &[u8], delimiter: Option<u8>, line_bytes: usize) -> Vec<(u64, String)> {
        let cancel = AtomicBool::new(false);
        let limits = Limits { line_bytes, ..Limits::default() };
        let context = ReadContext { limits, cancel: &cancel, on_bytes: &|_| () };
        let mut lines = Lines::new(text, "t.csv", &context);
        let mut found = vec![];
        loop {
            let number = lines.number;
            match lines.next(delimiter).unwrap() {
                Next::Record(extent) => {
                    found.push((number, String::from_utf8_lossy(lines.text(extent)).into_owned()));
                    lines.pass(extent);
                }
                Next::TooLong => {
                    let (bytes, given_up) = lines.pass_too_long().unwrap();
                    found.push((number, format!("<{bytes} bytes>")));
                    if given_up {
                        break;
                    }
                }
                Next::End => break,
            }
        }
        found
    }

    fn texts(text: &str) -> Vec<(u64, String)> {
        records(text.as_bytes(), Some(b','), 1 << 20)
    }

    fn numbered(expected: &[(u64, &str)]) -> Vec<(u64, String)> {
        expected.iter().map(|(n, t)| (*n, (*t).to_owned())).collect()
    }

    #[test]
    fn every_kind_of_line_end_ends_one_line() {
        assert_eq!(texts("a\nb\r\nc\r\r\nd\re"), numbered(&[(1, "a"), (2, "b"), (3, "c"), (4, "d"), (5, "e")]));
    }

    #[test]
    fn a_quoted_field_may_hold_line_ends_and_quotes() {
        assert_eq!(texts("a,\"b\nc\"\"\n\",d\ne"), numbered(&[(1, "a,\"b\nc\"\"\n\",d"), (4, "e")]));
    }

    #[test]
    fn a_quote_inside_a_field_is_only_a_character() {
        assert_eq!(texts("5\" pipe,1\n6,2\n"), numbered(&[(1, "5\" pipe,1"), (2, "6,2")]));
    }

    #[test]
    fn an_unclosed_quote_affects_only_its_own_line() {
        assert_eq!(texts("\"a,1\nb,2\nc,3"), numbered(&[(1, "\"a,1"), (2, "b,2"), (3, "c,3")]));
    }

    #[test]
    fn the_last_record_needs_no_line_end_even_with_one_in_a_field() {
        assert_eq!(texts("a,b\n1,\"c\nd\""), numbered(&[(1, "a,b"), (2, "1,\"c\nd\"")]));
    }

    #[test]
    fn unclosed_quotes_and_endless_carriage_returns_take_no_time() {
        // Every line opens a quote, whether or not the line before did: searched through to the limit
        // each time, this would be 4e11 steps.
        let lines = 400_000;
        assert_eq!(records("y\",\"\n".repeat(lines).as_bytes(), Some(b','), 1 << 20).len(), lines);
        assert_eq!(records("\r".repeat(lines).as_bytes(), Some(b','), 1 << 20).len(), lines);
    }

    #[test]
    fn a_line_over_the_limit_is_skipped_without_keeping_it() {
        let text = format!("a\n{}\nb\n", "x".repeat(900_000));
        let expected = [(1, "a"), (2, "<900001 bytes>"), (3, "b")];
        assert_eq!(records(text.as_bytes(), Some(b','), 1000), numbered(&expected));
    }

    #[test]
    fn reading_continues_after_a_hole_of_zeros_but_not_after_a_huge_one() {
        let with = |zeros: usize| [b"a\n", vec![0; zeros].as_slice(), b"\nb\n"].concat();
        let expected = [(1, "a"), (2, "<3145729 bytes>"), (3, "b")];
        assert_eq!(records(&with(3 << 20), Some(b','), 1 << 20), numbered(&expected));
        let sea = records(&with(MOST_ZEROS as usize + 1000), Some(b','), 1 << 20);
        assert_eq!((sea.len(), &sea[0]), (2, &(1, "a".to_owned())));
    }
}
