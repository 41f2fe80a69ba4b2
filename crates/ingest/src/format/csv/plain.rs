//! Rows of plain text, block by block: where there are neither quotes nor zero bytes, one search finds the ends of fields
//! and lines alike.

use super::fields::Row;
use super::header::Header;
use super::lines::{Extent, comment_mark};
use wide::u8x16;

/// What a search looks at in one step: a bit for each byte.
const STEP: usize = u64::BITS as usize;

/// How the rows of a table are told from other lines.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shape<'h> {
    pub(super) delimiter: u8,
    /// Fields of a row.
    pub(super) width: usize,
    /// Those that are looked at.
    pub(super) wanted: &'h [usize],
    /// The header, which may stand again between the rows.
    pub(super) header: &'h Header,
    /// A longer line is none, bytes.
    pub(super) longest: usize,
}

impl Shape<'_> {
    fn is_row(&self, row: Row<'_>, bytes: usize) -> bool {
        let cell = row.get(0);
        let last = row.get(row.len().saturating_sub(1));
        let other = cell.is_empty() || comment_mark(cell) > 0 || self.header.may_be(cell, last);
        bytes <= self.longest && !other
    }

    /// The wanted fields, and those at both ends, which tell whether it is a row.
    fn looked_at(&self) -> Vec<usize> {
        let ends = [0, self.width.saturating_sub(1)];
        let mut fields: Vec<usize> = self.wanted.iter().copied().chain(ends).filter(|&f| f < self.width).collect();
        fields.sort_unstable();
        fields.dedup();
        fields
    }
}

/// Takes the rows that a block of whole lines begins with, up to the first line that may be something else. All of them as
/// one extent. Of a row only the wanted fields are there. `spans` is room for the places of fields.
pub(super) fn rows(
    block: &[u8],
    shape: Shape<'_>,
    spans: &mut Vec<(usize, usize)>,
    mut take: impl FnMut(Row<'_>, Extent),
) -> Extent {
    let looked_at = shape.looked_at();
    // A field lies between the delimiter of its own number and the one before.
    let mut needed: Vec<usize> =
        looked_at.iter().flat_map(|&field| [field.checked_sub(1), Some(field)]).flatten().collect();
    needed.dedup();
    let mut delimiters = vec![0; shape.width];
    spans.clear();
    spans.resize(shape.width, (0, 0));
    let (mut line, mut lines) = (0, 0);
    let mut search = Search::new(block, shape.delimiter);
    while let Some(Line { fields, end }) = search.line(&needed, &mut delimiters) {
        // The LF of a CR LF.
        if end < line {
            continue;
        }
        let next = match (block.get(end), block.get(end + 1)) {
            (Some(b'\n'), _) => end + 1,
            (_, Some(b'\n')) => end + 2,
            _ => break,
        };
        if fields != shape.width {
            break;
        }
        for &field in &looked_at {
            let delimiter = |number: Option<usize>| number.and_then(|number| delimiters.get(number)).copied();
            let from = delimiter(field.checked_sub(1)).map_or(line, |at| at + 1);
            let to = if field + 1 == fields { end } else { delimiter(Some(field)).unwrap_or(end) };
            if let Some(span) = spans.get_mut(field) {
                *span = (from, to);
            }
        }
        let (row, text) = (Row::new(block, spans), end - line);
        if !shape.is_row(row, text) {
            break;
        }
        take(row, Extent { text, whole: next - line, lines: 1, ended: true, broken: false });
        (line, lines) = (next, lines + 1);
    }
    Extent { text: line, whole: line, lines, ended: true, broken: false }
}

/// A search for delimiters and line ends from one end of a block to the other.
struct Search<'b> {
    block: &'b [u8],
    delimiter: u8x16,
    /// Where the step begins.
    step: usize,
    /// Those of the step that are left.
    delimiters: u64,
    ends: u64,
}

/// Fields of a line, and where it ends.
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

    /// The next line that has an end; where its delimiters of the `needed` numbers, which ascend, are.
    #[inline]
    fn line(&mut self, needed: &[usize], places: &mut [usize]) -> Option<Line> {
        let mut needed = needed.iter().copied().peekable();
        let mut passed = 0;
        loop {
            // All bits, if the line does not end here.
            let before_end = (self.ends & self.ends.wrapping_neg()).wrapping_sub(1);
            let mut left = self.delimiters & before_end;
            let behind = passed + left.count_ones() as usize;
            let mut number = passed;
            while let Some(wanted) = needed.next_if(|&wanted| wanted < behind) {
                for _ in number..wanted {
                    left &= left.wrapping_sub(1);
                }
                number = wanted;
                if let Some(place) = places.get_mut(wanted) {
                    *place = self.step + left.trailing_zeros() as usize;
                }
            }
            passed = behind;
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

#[cfg(test)]
mod tests {
    use super::super::fields::Fields;
    use super::*;

    fn header_of(line: &str) -> Header {
        let mut fields = Fields::default();
        fields.split(line.as_bytes(), b',');
        Header::new(line.as_bytes(), &fields, b',')
    }

    fn taken(text: &str, header: &str) -> (Vec<Vec<String>>, usize) {
        let mut all = vec![];
        let shape = Shape { delimiter: b',', width: 3, wanted: &[0, 1, 2], header: &header_of(header), longest: 200 };
        let extent = rows(text.as_bytes(), shape, &mut vec![], |row, extent| {
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
        for wanted in [&[][..], &[0], &[89], &[88], &[3, 4, 5], &[63, 64, 65], &[1, 40, 89], &[7, 95]] {
            let shape = Shape { delimiter: b',', width: 90, wanted, header: &header_of("t"), longest: 1000 };
            let mut lines = text.lines();
            let all = rows(text.as_bytes(), shape, &mut vec![], |row, _| {
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
    fn lines_that_may_be_no_rows_end_the_block() {
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
