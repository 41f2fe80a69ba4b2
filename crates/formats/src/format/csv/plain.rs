//! Splits rows of plain text, block by block. Without quotes and zero bytes, one search finds the ends of fields and of
//! lines.

use super::extent::Extent;
use super::fields::Row;
use super::header::Header;
use wide::u8x16;

/// Bytes searched in one step: a bit for each byte.
const STEP: usize = u64::BITS as usize;

/// Splits the rows of a table. Made once for a header, with reusable memory, because there may be many short lines and
/// many columns.
#[derive(Clone, Default)]
pub(super) struct RowSplitter {
    delimiter: u8,
    /// The number of fields of a row.
    width: usize,
    /// The fields that are examined: the wanted ones, and those that show whether a line is a row.
    looked_at: Vec<usize>,
    /// The numbers of the delimiters around these fields.
    needed: Vec<usize>,
    delimiters: Vec<usize>,
    spans: Vec<(usize, usize)>,
}

impl RowSplitter {
    pub(super) fn new(delimiter: u8, width: usize, wanted: &[usize], header: &Header) -> RowSplitter {
        let first_number = [Some(0), Some(width.saturating_sub(1)), header.first_number()];
        let mut looked_at: Vec<usize> =
            wanted.iter().copied().chain(first_number.into_iter().flatten()).filter(|&field| field < width).collect();
        looked_at.sort_unstable();
        looked_at.dedup();
        // Field n is between delimiters n - 1 and n.
        let around = |&field: &usize| [field.checked_sub(1), Some(field)];
        let mut needed: Vec<usize> = looked_at.iter().flat_map(around).flatten().collect();
        needed.dedup();
        RowSplitter { delimiter, width, looked_at, needed, delimiters: vec![0; width], spans: vec![(0, 0); width] }
    }

    /// Takes the rows that a block of whole lines begins with, up to the first line that may be something else: the
    /// header again, or a line longer than `longest`. Returns one extent for all of them. Rows have only the examined
    /// fields.
    pub(super) fn rows(
        &mut self,
        block: &[u8],
        header: &Header,
        longest: usize,
        mut take: impl FnMut(Row<'_>, Extent),
    ) -> Extent {
        let (mut line, mut lines) = (0, 0);
        let mut search = Search::new(block, self.delimiter);
        while let Some(Line { fields, end }) = search.line(&self.needed, &mut self.delimiters) {
            // The LF of a CR LF.
            if end < line {
                continue;
            }
            let next = match (block.get(end), block.get(end + 1)) {
                (Some(b'\n'), _) => end + 1,
                (_, Some(b'\n')) => end + 2,
                _ => break,
            };
            if fields != self.width {
                break;
            }
            self.locate(line, end);
            let (row, text) = (Row::new(block, &self.spans), end - line);
            if text > longest || !is_row(row, header) {
                break;
            }
            take(row, Extent { text, whole: next - line, lines: 1, ended: true, broken: false });
            (line, lines) = (next, lines + 1);
        }
        Extent { text: line, whole: line, lines, ended: true, broken: false }
    }

    /// Finds the positions of the examined fields in the row with this start and end.
    fn locate(&mut self, line: usize, end: usize) {
        let delimiter = |number: usize| self.delimiters.get(number).copied();
        for &field in &self.looked_at {
            let from = field.checked_sub(1).and_then(delimiter).map_or(line, |at| at + 1);
            let to = if field + 1 == self.width { end } else { delimiter(field).unwrap_or(end) };
            if let Some(span) = self.spans.get_mut(field) {
                *span = (from, to);
            }
        }
    }
}

fn is_row(row: Row<'_>, header: &Header) -> bool {
    let cell = row.get(0);
    let last = row.get(row.len().saturating_sub(1));
    let first_number = header.first_number().map_or(&b""[..], |column| row.get(column));
    !(cell.is_empty() || comment_mark(cell) > 0 || header.may_be_header(cell, last, first_number))
}

/// A search for delimiters and line ends from one end of a block to the other.
struct Search<'b> {
    block: &'b [u8],
    delimiter: u8x16,
    /// The start of the current step.
    step: usize,
    /// The delimiters of the step that are left, as bits.
    delimiters: u64,
    ends: u64,
}

/// The number of fields of a line, and where it ends.
struct Line {
    fields: usize,
    end: usize,
}

impl Search<'_> {
    fn new(block: &[u8], delimiter: u8) -> Search<'_> {
        let delimiter = u8x16::splat(delimiter);
        let (delimiters, ends) = marks_at(block, delimiter);
        Search { block, delimiter, step: 0, delimiters, ends }
    }

    /// Finds the next line that has an end, and writes the positions of its `needed` delimiters to `places`. The needed
    /// numbers ascend.
    #[inline]
    fn line(&mut self, needed: &[usize], places: &mut [usize]) -> Option<Line> {
        let all = needed.len() + 1 >= places.len();
        let mut needed = needed.iter().copied().peekable();
        let mut passed = 0;
        loop {
            // All bits are set if the line does not end in this step.
            let before_end = (self.ends & self.ends.wrapping_neg()).wrapping_sub(1);
            let mut left = self.delimiters & before_end;
            let found = passed + left.count_ones() as usize;
            let mut number = passed;
            while all && left != 0 {
                if let Some(place) = places.get_mut(number) {
                    *place = self.step + left.trailing_zeros() as usize;
                }
                left &= left.wrapping_sub(1);
                number += 1;
            }
            while !all && let Some(wanted) = needed.next_if(|&wanted| wanted < found) {
                for _ in number..wanted {
                    left &= left.wrapping_sub(1);
                }
                number = wanted;
                if let Some(place) = places.get_mut(wanted) {
                    *place = self.step + left.trailing_zeros() as usize;
                }
            }
            passed = found;
            self.delimiters &= !before_end;
            if self.ends != 0 {
                let end = self.step + self.ends.trailing_zeros() as usize;
                self.ends &= self.ends.wrapping_sub(1);
                return Some(Line { fields: passed + 1, end });
            }
            self.step += STEP;
            (self.delimiters, self.ends) =
                marks_at(self.block.get(self.step..).filter(|rest| !rest.is_empty())?, self.delimiter);
        }
    }
}

/// A bit for each delimiter, and one for each LF and CR, of the first step.
#[inline]
fn marks_at(rest: &[u8], delimiter: u8x16) -> (u64, u64) {
    match rest.first_chunk() {
        Some(step) => marks(step, delimiter),
        None => {
            let mut step = [0; STEP];
            step.iter_mut().zip(rest).for_each(|(to, from)| *to = *from);
            marks(&step, delimiter)
        }
    }
}

#[inline]
fn marks(step: &[u8; STEP], delimiter: u8x16) -> (u64, u64) {
    const LANES: usize = 16;
    let (lf, cr) = (u8x16::splat(b'\n'), u8x16::splat(b'\r'));
    let (parts, _) = step.as_chunks::<LANES>();
    let (mut delimiters, mut ends) = (0, 0);
    for (part, bytes) in parts.iter().enumerate() {
        let bytes = u8x16::new(*bytes);
        delimiters |= u64::from(bytes.simd_eq(delimiter).to_bitmask()) << (LANES * part);
        ends |= u64::from((bytes.simd_eq(lf) | bytes.simd_eq(cr)).to_bitmask()) << (LANES * part);
    }
    (delimiters, ends)
}

/// Length of the mark that makes a line a comment, `#` or `//`; 0 if there is none.
pub(super) fn comment_mark(line: &[u8]) -> usize {
    match line {
        [b'#', ..] => 1,
        [b'/', b'/', ..] => 2,
        _ => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::super::fields::Fields;
    use super::*;

    fn header_of(line: &str) -> Header {
        let mut fields = Fields::default();
        fields.split(line.as_bytes(), b',');
        Header::new(line.as_bytes(), &fields, b',', vec![])
    }

    fn taken(text: &str, header: &str) -> (Vec<Vec<String>>, usize) {
        let mut all = vec![];
        let header = header_of(header);
        let mut splitter = RowSplitter::new(b',', 3, &[0, 1, 2], &header);
        let extent = splitter.rows(text.as_bytes(), &header, 200, |row, extent| {
            all.push((0..row.len()).map(|i| String::from_utf8_lossy(row.get(i)).into_owned()).collect());
            assert!((1..=2).contains(&(extent.whole - extent.text)));
        });
        assert_eq!(extent.lines as usize, all.len());
        (all, extent.whole)
    }

    #[test]
    fn rows_are_what_splitting_at_line_ends_and_delimiters_gives() {
        for size in [1, 2, 7, 20, 60] {
            let row = |i: usize| format!("{i}, {},{}", "9".repeat(i % size), i * i);
            let lines: Vec<String> = (0..200).map(row).collect();
            for end in ["\n", "\r\n"] {
                let text = lines.join(end) + end;
                let expected = lines.iter().map(|l| l.split(',').map(|cell| cell.trim().to_owned()).collect());
                assert_eq!(taken(&text, "t,a,b"), (expected.collect(), text.len()));
            }
        }
    }

    #[test]
    fn a_wanted_field_is_the_same_whatever_else_is_wanted() {
        let line = |i: usize| (0..90).map(|f| "7".repeat((i * f) % 5)).collect::<Vec<_>>().join(",");
        let text: String = (0..50).map(|i| format!("{i}x{}\n", line(i))).collect();
        let every: Vec<usize> = (0..90).collect();
        for wanted in [&[][..], &[0], &[89], &[88], &[3, 4, 5], &[63, 64, 65], &[1, 40, 89], &[7, 95], &every] {
            let header = header_of("t");
            let mut splitter = RowSplitter::new(b',', 90, wanted, &header);
            let mut lines = text.lines();
            let all = splitter.rows(text.as_bytes(), &header, 1000, |row, _| {
                let fields: Vec<&str> = lines.next().unwrap().split(',').collect();
                assert_eq!(row.len(), 90);
                for &field in wanted {
                    assert_eq!(row.get(field), fields.get(field).map_or(&b""[..], |f| f.as_bytes()), "{field}");
                }
            });
            assert_eq!((all.whole, all.lines), (text.len(), 50));
        }
    }

    #[test]
    fn every_place_of_a_step_is_marked() {
        for byte in [b',', b'\n', b'\r'] {
            for at in 0..STEP {
                let mut step = [b'-'; STEP];
                step[at] = byte;
                let expected = if byte == b',' { (1 << at, 0) } else { (0, 1 << at) };
                assert_eq!(marks(&step, u8x16::splat(b',')), expected);
                assert_eq!(marks_at(&step[..=at], u8x16::splat(b',')), expected);
            }
        }
    }

    #[test]
    fn lines_that_may_not_be_rows_end_the_block() {
        let long = format!("{},2,3", "1".repeat(200));
        for odd in [
            "1,2",
            "1,2,3,",
            "# 1,2,3",
            "//1,2,3",
            "",
            " ",
            ",2,3",
            "t,a,b",
            "t,2,3",
            "1,2,a",
            "\r",
            "1,2,3\r4,5,6",
            &long,
        ] {
            let text = format!("1,2,3\n4,5,6\r\n{odd}\n7,8,9\n");
            assert_eq!(taken(&text, "t,a,b").1, 13, "{odd:?}");
        }
        assert_eq!(taken("", "t,a,b").1, 0);
    }
}
