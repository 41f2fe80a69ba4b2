//! Reads the bytes of a table. Idle threads split and parse its next plain rows before the reader reaches them.

use super::columns::{Part, Topic};
use super::extent::Extent;
use super::fields::Row;
use super::header::Header;
use super::plain::RowSplitter;
use crate::format::workers::{Job, Outcome, Workers};
use std::collections::VecDeque;
use std::io::Read;
use std::sync::Arc;

/// Bytes of one read.
const STEP: usize = 256 << 10;

/// A file that is read from start to end, and the lines that were read ahead.
pub(super) struct AheadReader<R> {
    input: R,
    /// Position of the input in the file.
    pub(super) at: u64,
    ended: bool,
    /// Whole lines, in the order of the file.
    pieces: VecDeque<Arc<Job<Piece>>>,
    /// The bytes after these lines: a line without its end.
    tail: Vec<u8>,
    spare: Vec<Piece>,
}

/// Whole lines, and the rows that they begin with.
#[derive(Default)]
pub(super) struct Piece {
    pub(super) bytes: Vec<u8>,
    pub(super) part: Part,
    /// The extent of the parsed rows; empty if no thread has parsed them.
    pub(super) extent: Extent,
    pub(super) rules: Rules,
}

/// How rows are split.
#[derive(Clone, Default)]
pub(super) struct Rules {
    /// The number of these rules within the file, from 1.
    pub(super) number: u64,
    pub(super) splitter: RowSplitter,
    pub(super) header: Arc<Header>,
    pub(super) longest: usize,
}

impl Rules {
    /// The rows at the start of a block of whole lines, without quotes and zero bytes.
    pub(super) fn rows(&mut self, block: &[u8], take: impl FnMut(Row<'_>, Extent)) -> Extent {
        self.splitter.rows(block, &self.header, self.longest, take)
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

impl<R: Read> AheadReader<R> {
    pub(super) fn new(input: R) -> AheadReader<R> {
        AheadReader { input, at: 0, ended: false, pieces: VecDeque::new(), tail: vec![], spare: vec![] }
    }

    /// Whether all bytes that were read have been taken.
    pub(super) fn is_empty(&self) -> bool {
        self.pieces.is_empty() && self.tail.is_empty()
    }

    /// Appends the next bytes to `buffer`. Returns the number of bytes read by this call.
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

    /// Puts the content of `buffer` from `end` on, the start of a line, back for the next read.
    pub(super) fn put_back(&mut self, buffer: &mut Vec<u8>, end: usize) {
        self.tail.extend_from_slice(buffer.get(end..).unwrap_or_default());
        buffer.truncate(end);
    }

    /// Reads ahead as long as the workers have capacity, and lets them parse the rows of `topic`. Returns the number of
    /// bytes read.
    pub(super) fn read_ahead(&mut self, workers: &Workers, topic: &Topic, rules: &Rules) -> std::io::Result<u64> {
        let mut all = 0;
        while !self.ended && workers.has_capacity(self.pieces.len()) && self.tail.len() < STEP {
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
            self.pieces.push_back(workers.begin(piece, Piece::read));
        }
        Ok(all)
    }

    /// The next whole lines that were read ahead, with their rows.
    pub(super) fn next_piece(&mut self) -> std::io::Result<Option<Piece>> {
        // While a thread parses them, more lines can be read.
        while self.pieces.front().is_some_and(|job| job.is_running())
            && self.pieces.iter().skip(1).any(|job| job.run(Piece::read))
        {}
        self.take()
    }

    fn take(&mut self) -> std::io::Result<Option<Piece>> {
        let Some(job) = self.pieces.pop_front() else { return Ok(None) };
        match job.wait() {
            Some(Outcome::Done(piece)) => Ok(Some(piece)),
            Some(Outcome::Open(mut piece) | Outcome::Failed(mut piece)) => {
                piece.extent = Extent::default();
                Ok(Some(piece))
            }
            // Cannot happen: each job is taken once.
            None => Err(std::io::Error::other("what was read early is lost")),
        }
    }

    /// Runs all jobs, as if the other threads had been fast enough.
    #[cfg(test)]
    pub(super) fn run_all(&self) {
        for job in &self.pieces {
            job.run(Piece::read);
        }
    }

    /// Keeps the memory of a piece for other lines.
    pub(super) fn recycle(&mut self, piece: Piece) {
        self.spare.push(piece);
    }
}

impl<R> Drop for AheadReader<R> {
    fn drop(&mut self) {
        self.pieces.drain(..).for_each(|job| drop(job.withdraw()));
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
        Rules { number, splitter: RowSplitter::new(b',', 3, &topic.places(), &header), header, longest: 1 << 20 }
    }

    /// Reads the table with one thread, or with two where the other one has finished all its jobs. Returns the table, the
    /// line number at its end, and the number of rows that the other thread parsed.
    fn read(text: &str, workers: Option<&Workers>, change: u64) -> (Table, u64, u64) {
        let cancel = AtomicBool::new(false);
        let context = ReadContext { limits: Limits::default(), cancel: &cancel, on_bytes: &|_| () };
        let mut lines = Lines::new(text.as_bytes(), "t.csv", &context);
        let (mut topic, mut taken) = (topic(), 0);
        let mut rules = rules(1, &topic);
        while lines.next(None).unwrap() != Next::End {
            loop {
                if let Some(workers) = workers.filter(|_| topic.rows > 0) {
                    lines.read_ahead(workers, &topic, &rules).unwrap();
                    rules.number += change;
                    lines.finish_read_ahead();
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
            let workers = Workers::available().unwrap();
            for (first_float, first_long) in [(all, all), (0, all), (1000, 0), (90_000, 90_000), (150_000, 3)] {
                let text = rows(all, first_float, first_long);
                let (one, lines, none) = read(&text, None, 0);
                assert_eq!((one.rows, none), (all, 0));
                let (two, lines_of_two, taken) = read(&text, Some(&workers), 0);
                assert_eq!((lines, lines_of_two), (all as u64 + 1, lines));
                assert!(one == two, "{first_float}, {first_long}");
                // All but the first block, and a few where a column changed its type.
                assert!(taken > all as u64 / 2, "{first_float}, {first_long}: {taken}");
                let (other, _, taken) = read(&text, Some(&workers), 1);
                assert!(other == one && taken == 0, "{taken}");
            }
        });
    }
}
