//! Rows of plain text, block by block: where there are neither quotes nor zero bytes, one search finds the ends of fields
//! and lines alike.

use super::fields::Row;
use super::header::Header;
use super::lines::{Extent, comment_mark};

/// What a search looks at in one step: a bit for each byte.
const STEP: usize = u64::BITS as usize;

/// How the rows of a table are told from other lines.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shape<'h> {
    pub(super) delimiter: u8,
    /// Fields of a row.
    pub(super) width: usize,
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
        row.len() == self.width && bytes <= self.longest && !other
    }
}

/// Takes the rows that a block of whole lines begins with, up to the first line that may be something else. All of them as
/// one extent. `spans` is room for the places of fields.
pub(super) fn rows(
    block: &[u8],
    shape: Shape<'_>,
    spans: &mut Vec<(usize, usize)>,
    mut take: impl FnMut(Row<'_>, Extent),
) -> Extent {
    spans.clear();
    let (mut line, mut field, mut lines) = (0, 0, 0);
    for at in (Separators { block, delimiter: shape.delimiter, step: 0, found: separators(block, shape.delimiter) }) {
        // The LF of a CR LF.
        if at < field {
            continue;
        }
        spans.push((field, at));
        field = at + 1;
        let ends = match block.get(at) {
            Some(b'\n') => true,
            Some(b'\r') if block.get(field) == Some(&b'\n') => {
                field += 1;
                true
            }
            Some(b'\r') => break,
            _ => false,
        };
        if !ends {
            continue;
        }
        let (row, text) = (Row::new(block, spans), at - line);
        if !shape.is_row(row, text) {
            break;
        }
        take(row, Extent { text, whole: field - line, lines: 1, ended: true, broken: false });
        spans.clear();
        (line, lines) = (field, lines + 1);
    }
    Extent { text: line, whole: line, lines, ended: true, broken: false }
}

/// Places of delimiters, CR and LF in a block.
struct Separators<'b> {
    block: &'b [u8],
    delimiter: u8,
    /// Where the step begins.
    step: usize,
    /// Those of the step that are left.
    found: u64,
}

impl Iterator for Separators<'_> {
    type Item = usize;

    #[inline]
    fn next(&mut self) -> Option<usize> {
        while self.found == 0 {
            self.step += STEP;
            self.found = separators(self.block.get(self.step..).filter(|rest| !rest.is_empty())?, self.delimiter);
        }
        let at = self.step + self.found.trailing_zeros() as usize;
        self.found &= self.found - 1;
        Some(at)
    }
}

/// A bit for each separator of the first step.
#[inline]
fn separators(rest: &[u8], delimiter: u8) -> u64 {
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
fn marks(step: &[u8; STEP], delimiter: u8) -> u64 {
    /// Brings the lowest bits of eight bytes together in the highest byte.
    const GATHER: u64 = 0x0102_0408_1020_4080;
    let is_one = step.map(|byte| u8::from((byte == delimiter) | (byte == b'\n') | (byte == b'\r')));
    let (eights, _) = is_one.as_chunks();
    let gathered = eights.iter().map(|eight| u64::from_le_bytes(*eight).wrapping_mul(GATHER) >> 56);
    gathered.enumerate().fold(0, |marks, (at, bits)| marks | bits << (8 * at))
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
        let shape = Shape { delimiter: b',', width: 3, header: &header_of(header), longest: 200 };
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
    fn every_place_of_a_step_is_marked() {
        for byte in [b',', b'\n', b'\r'] {
            for at in 0..STEP {
                let mut step = [b'-'; STEP];
                step[at] = byte;
                assert_eq!(marks(&step, b','), 1 << at);
                assert_eq!(separators(&step[..=at], b','), 1 << at);
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
