//! The bytes of a table, and its next plain rows, which idle threads split and parse before the walk reaches them.

use super::columns::{Part, Topic};
use super::fields::Row;
use super::header::Header;
use super::lines::Extent;
use super::plain::Cutter;
use crate::format::crew::{Crew, Order, Outcome};
use std::collections::VecDeque;
use std::io::Read;
use std::sync::Arc;

/// Bytes read at once.
const STEP: usize = 256 << 10;

/// A file that is read from start to end, with what was read ahead.
pub(super) struct Source<R> {
    input: R,
    /// Position of the input in the file.
    pub(super) at: u64,
    ended: bool,
    /// Whole lines, in the order of the file.
    pieces: VecDeque<Arc<Order<Piece>>>,
    /// The bytes after them: a line without its end.
    tail: Vec<u8>,
    spare: Vec<Piece>,
}

/// Whole lines, and the rows at their start.
#[derive(Default)]
pub(super) struct Piece {
    pub(super) bytes: Vec<u8>,
    pub(super) part: Part,
    /// Columns of the rows; empty if no thread has parsed them.
    pub(super) extent: Extent,
    pub(super) rules: Rules,
}

/// How rows are split.
#[derive(Clone, Default)]
pub(super) struct Rules {
    /// Number of these rules within the file, from 1.
    pub(super) number: u64,
    pub(super) cutter: Cutter,
    pub(super) header: Arc<Header>,
    pub(super) longest: usize,
}

impl Rules {
    /// The rows at the start of a block of whole lines, without quotes and zero bytes.
    pub(super) fn rows(&mut self, block: &[u8], take: impl FnMut(Row<'_>, Extent)) -> Extent {
        self.cutter.rows(block, &self.header, self.longest, take)
    }
}

impl Piece {
    fn read(&mut self) {
        let Piece { bytes, rules, part, extent } = self;
        let block = if memchr::memchr2(b'"', 0, bytes).is_none() { bytes.as_slice() } else { &[] };
        let mut line = 0;
        *extent = rules.rows(block, |row, extent| {
            line += 1;
            part.push(row, line, extent);
        });
    }
}

impl<R: Read> Source<R> {
    pub(super) fn new(input: R) -> Source<R> {
        Source { input, at: 0, ended: false, pieces: VecDeque::new(), tail: vec![], spare: vec![] }
    }

    /// Whether everything that was read has been handed out.
    pub(super) fn is_empty(&self) -> bool {
        self.pieces.is_empty() && self.tail.is_empty()
    }

    /// Appends the next bytes to `buffer`. Returns how many of them were read now.
    pub(super) fn more(&mut self, buffer: &mut Vec<u8>) -> std::io::Result<u64> {
        if let Some(mut piece) = self.take()? {
            if buffer.is_empty() {
                std::mem::swap(buffer, &mut piece.bytes);
            } else {
                buffer.extend_from_slice(&piece.bytes);
            }
            self.spare.push(piece);
            return Ok(0);
        }
        buffer.append(&mut self.tail);
        self.read(buffer)
    }

    fn read(&mut self, buffer: &mut Vec<u8>) -> std::io::Result<u64> {
        let got = self.input.by_ref().take(STEP as u64).read_to_end(buffer)? as u64;
        self.at += got;
        self.ended = got == 0;
        Ok(got)
    }

    /// The content of `buffer` from `end` on, the start of a line, is returned with the next read.
    pub(super) fn put_back(&mut self, buffer: &mut Vec<u8>, end: usize) {
        self.tail.extend_from_slice(buffer.get(end..).unwrap_or_default());
        buffer.truncate(end);
    }

    /// Reads ahead as long as the crew has time, and leaves the rows of `topic` to it. Returns the number of bytes
    /// read.
    pub(super) fn read_ahead(&mut self, crew: &Crew, topic: &Topic, rules: &Rules) -> std::io::Result<u64> {
        let mut all = 0;
        while !self.ended && crew.has_time(self.pieces.len()) && self.tail.len() < STEP {
            let mut piece = self.spare.pop().unwrap_or_default();
            if piece.rules.number != rules.number {
                piece.rules = rules.clone();
            }
            piece.bytes.clear();
            piece.bytes.append(&mut self.tail);
            let known = piece.bytes.len();
            let got = self.read(&mut piece.bytes)?;
            all += got;
            let new = piece.bytes.get(known..).unwrap_or_default();
            let end = memchr::memrchr(b'\n', new).map_or(0, |at| known + at + 1);
            self.tail.extend_from_slice(piece.bytes.get(end..).unwrap_or_default());
            if end == 0 {
                self.spare.push(piece);
                continue;
            }
            piece.bytes.truncate(end);
            piece.part.renew(topic);
            self.pieces.push_back(crew.begin(piece, Piece::read));
        }
        Ok(all)
    }

    /// The next whole lines that were read ahead, with their rows.
    pub(super) fn next_piece(&mut self) -> std::io::Result<Option<Piece>> {
        // While a thread parses them, more lines can be read.
        while self.pieces.front().is_some_and(|order| order.is_under_way())
            && self.pieces.iter().skip(1).any(|order| order.carry_out(Piece::read))
        {}
        self.take()
    }

    fn take(&mut self) -> std::io::Result<Option<Piece>> {
        let Some(order) = self.pieces.pop_front() else { return Ok(None) };
        match order.wait() {
            Some(Outcome::Done(piece)) => Ok(Some(piece)),
            Some(Outcome::Open(mut piece) | Outcome::Failed(mut piece)) => {
                piece.extent = Extent::default();
                Ok(Some(piece))
            }
            // It is asked for once.
            None => Err(std::io::Error::other("what was read early is lost")),
        }
    }

    /// Acts as if the other threads were that fast.
    #[cfg(test)]
    pub(super) fn finish(&self) {
        for order in &self.pieces {
            order.carry_out(Piece::read);
        }
    }

    /// For other lines.
    pub(super) fn keep(&mut self, piece: Piece) {
        self.spare.push(piece);
    }
}

impl<R> Drop for Source<R> {
    fn drop(&mut self) {
        self.pieces.drain(..).for_each(|order| drop(order.revoke()));
    }
}

#[cfg(test)]
mod tests {
    use super::super::fields::Fields;
    use super::super::lines::{Lines, Next};
    use super::*;
    use crate::reader::{FieldRequest, Limits, ReadContext, Selection, ValueKind};
    use crate::table::{Table, TopicInfo};
    use std::sync::atomic::AtomicBool;

    const HEADER: &str = "a,b,word";

    /// Rows whose numbers are floats from `first_float` on, and long from `first_long` on.
    fn rows(count: usize, first_float: usize, first_long: usize) -> String {
        let long = |row: usize| if row < first_long { row as u64 } else { (1 << 60) + row as u64 };
        let float = |row: usize| if row < first_float { String::new() } else { format!(".{}", row % 1000) };
        (0..count).map(|row| format!("{}{},{},w{}\n", row, float(row), long(row), row % 5)).collect()
    }

    fn topic() -> Topic {
        let request = |path: &str, kind| FieldRequest { path: path.into(), kind };
        let wanted = [("a", ValueKind::Number), ("b", ValueKind::Number), ("word", ValueKind::Text)];
        let selection = Selection::Fields(wanted.map(|(path, kind)| request(path, kind)).to_vec());
        Topic::new(TopicInfo::default(), HEADER.split(',').map(str::to_owned).collect(), &selection)
    }

    fn rules(number: u64, topic: &Topic) -> Rules {
        let mut fields = Fields::default();
        fields.split(HEADER.as_bytes(), b',');
        let header = Arc::new(Header::new(HEADER.as_bytes(), &fields, b',', vec![]));
        Rules { number, cutter: Cutter::new(b',', 3, &topic.places(), &header), header, longest: 1 << 20 }
    }

    /// The table read by one thread, or by two of which the other is so fast that all is ready; and how many rows it
    /// parsed.
    fn read(text: &str, crew: Option<&Crew>, change: u64) -> (Table, u64, u64) {
        let cancel = AtomicBool::new(false);
        let context = ReadContext { limits: Limits::default(), cancel: &cancel, on_bytes: &|_| () };
        let mut lines = Lines::new(text.as_bytes(), "t.csv", &context);
        let (mut topic, mut taken) = (topic(), 0);
        let mut rules = rules(1, &topic);
        while lines.next(None).unwrap() != Next::End {
            loop {
                if let Some(crew) = crew.filter(|_| topic.rows > 0) {
                    lines.read_ahead(crew, &topic, &rules).unwrap();
                    rules.number += change;
                    lines.finish_what_is_ahead();
                }
                let mut line = lines.number;
                let held = rules.rows(lines.plain_block(), |row, extent| {
                    topic.push(row, 0, line, extent);
                    line += 1;
                });
                lines.pass(held);
                let Some(rows) = lines.take_rows(&mut topic, &rules).unwrap() else { break };
                taken += rows.lines;
            }
        }
        assert_eq!((lines.offset, lines.number), (text.len() as u64, topic.rows + 1));
        (topic.into_table().unwrap(), lines.number, taken)
    }

    #[test]
    fn rows_parsed_by_other_threads_are_the_rows_of_the_file() {
        let all = 200_000;
        rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap().install(|| {
            let crew = Crew::at_hand().unwrap();
            for (first_float, first_long) in [(all, all), (0, all), (1000, 0), (90_000, 90_000), (150_000, 3)] {
                let text = rows(all, first_float, first_long);
                let (one, lines, none) = read(&text, None, 0);
                assert_eq!((one.rows, none), (all, 0));
                let (two, lines_of_two, taken) = read(&text, Some(&crew), 0);
                assert_eq!((lines, lines_of_two), (all as u64 + 1, lines));
                assert!(one == two, "{first_float}, {first_long}");
                // All but the first block, and a few where a column changed its type.
                assert!(taken > all as u64 / 2, "{first_float}, {first_long}: {taken}");
                let (other, _, taken) = read(&text, Some(&crew), 1);
                assert!(other == one && taken == 0, "{taken}");
            }
        });
    }
}
