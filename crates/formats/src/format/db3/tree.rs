//! B-tree pages and the rows on them (<https://www.sqlite.org/fileformat2.html>, sections 1.6 and 2.1).

use super::pages::HEADER_BYTES;

/// Columns of a row that are examined.
const MOST_COLUMNS: usize = 24;
/// Minimum size of a cell, bytes.
const LEAST_CELL: usize = 4;

/// The type of a b-tree page.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// Rows.
    TableLeaf,
    /// Pages of rows.
    TableInterior,
    IndexLeaf,
    IndexInterior,
}

/// A b-tree page with its parsed header.
#[derive(Debug, Clone, Copy)]
pub(super) struct Node<'p> {
    pub(super) kind: Kind,
    bytes: &'p [u8],
    usable: usize,
    cells: usize,
    /// Start of the cell pointers.
    pointers: usize,
    /// The last child of an interior page.
    right: u32,
}

/// The part of a row on its page.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cell<'p> {
    pub(super) rowid: i64,
    /// Length of the whole row, bytes.
    pub(super) length: u64,
    /// Its start.
    pub(super) local: &'p [u8],
    /// The page with the next bytes; 0 if there is none.
    pub(super) overflow: u32,
    /// Bytes used on its page.
    pub(super) extent: usize,
}

impl<'p> Node<'p> {
    /// `None` if the page is not a b-tree page.
    pub(super) fn parse(page: u32, bytes: &'p [u8], usable: u32) -> Option<Node<'p>> {
        let start = if page == 1 { HEADER_BYTES } else { 0 };
        let head = bytes.get(start..start + 12)?;
        let kind = match head.first()? {
            0x0d => Kind::TableLeaf,
            0x05 => Kind::TableInterior,
            0x0a => Kind::IndexLeaf,
            0x02 => Kind::IndexInterior,
            _ => return None,
        };
        let interior = matches!(kind, Kind::TableInterior | Kind::IndexInterior);
        let pointers = start + if interior { 12 } else { 8 };
        let cells = usize::from(u16_at(head, 3)?);
        let usable = (usable as usize).min(bytes.len());
        let right = head.get(8..)?.first_chunk().map_or(0, |b| u32::from_be_bytes(*b));
        let fits = pointers + 2 * cells <= usable;
        fits.then_some(Node { kind, bytes, usable, cells, pointers, right: if interior { right } else { 0 } })
    }

    pub(super) fn len(&self) -> usize {
        self.cells
    }

    /// Whether it is a page of an index: tables without row numbers are also stored so.
    pub(super) fn is_index(&self) -> bool {
        matches!(self.kind, Kind::IndexLeaf | Kind::IndexInterior)
    }

    /// Start of a cell.
    fn at(&self, cell: usize) -> Option<usize> {
        let at = usize::from(u16_at(self.bytes, self.pointers + 2 * cell)?);
        (at >= self.pointers + 2 * self.cells && at < self.usable).then_some(at)
    }

    /// The pages below an interior page, in order, each with the greatest row number below it (for a table; the last
    /// has no number); `None` for an impossible pointer.
    pub(super) fn children(&self) -> impl Iterator<Item = Option<(u32, Option<i64>)>> + use<'p> {
        let node = *self;
        let left = (0..node.cells).map(move |cell| {
            let (page, mut rest) = node.bytes.get(node.at(cell)?..)?.split_first_chunk()?;
            Some((u32::from_be_bytes(*page), varint(&mut rest).map(|key| key as i64)))
        });
        left.chain(std::iter::once(Some((node.right, None))))
    }

    /// A row; `None` if it is invalid.
    pub(super) fn row(&self, cell: usize) -> Option<Cell<'p>> {
        let at = self.at(cell)?;
        let mut rest = self.bytes.get(at..self.usable)?;
        let room = rest.len();
        let length = varint(&mut rest)?;
        let rowid = varint(&mut rest)? as i64;
        let head = room - rest.len();
        let cell = self.cell(rowid, length, rest, self.usable - 35)?;
        Some(Cell { extent: (head + cell.extent).max(LEAST_CELL), ..cell })
    }

    /// Bytes of the page's content that are neither in `cells` bytes of cells nor marked free: room for a cell
    /// that the page does not list (section 1.6).
    pub(super) fn unlisted(&self, cells: usize) -> usize {
        let head = self.pointers - 8;
        let start = u16_at(self.bytes, head + 5).map_or(0, |at| if at == 0 { 65_536 } else { usize::from(at) });
        let fragments = self.bytes.get(head + 7).copied().map_or(0, usize::from);
        let mut free = 0;
        let mut block = u16_at(self.bytes, head + 1).map_or(0, usize::from);
        while block != 0 {
            free += u16_at(self.bytes, block + 2).map_or(0, usize::from);
            // Free blocks are in page order.
            block = u16_at(self.bytes, block).map(usize::from).filter(|next| *next > block).unwrap_or(0);
        }
        self.usable.saturating_sub(start).saturating_sub(cells + fragments + free)
    }

    /// The content of an index.
    pub(super) fn entry(&self, cell: usize) -> Option<Cell<'p>> {
        let at = self.at(cell)? + if self.kind == Kind::IndexInterior { 4 } else { 0 };
        let mut rest = self.bytes.get(at..self.usable)?;
        let length = varint(&mut rest)?;
        self.cell(0, length, rest, (self.usable - 12) * 64 / 255 - 23)
    }

    /// Up to `most` bytes stay on a page; of longer cells, a number that fills the last overflow page well.
    fn cell(&self, rowid: i64, length: u64, rest: &'p [u8], most: usize) -> Option<Cell<'p>> {
        if length <= most as u64 {
            let local = rest.get(..length as usize)?;
            return Some(Cell { rowid, length, local, overflow: 0, extent: local.len() });
        }
        let least = (self.usable - 12) * 32 / 255 - 23;
        let wished = least as u64 + (length - least as u64) % (self.usable as u64 - 4);
        let local = if wished <= most as u64 { wished as usize } else { least };
        let (local, after) = rest.split_at_checked(local)?;
        let overflow = after.first_chunk().map(|b| u32::from_be_bytes(*b)).filter(|&page| page > 0)?;
        Some(Cell { rowid, length, local, overflow, extent: local.len() + 4 })
    }
}

impl Cell<'_> {
    /// Overflow pages of the row.
    pub(super) fn overflow_pages(&self, usable: u32) -> u64 {
        (self.length - self.local.len() as u64).div_ceil(u64::from(usable) - 4)
    }
}

fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    bytes.get(at..)?.first_chunk().map(|b| u16::from_be_bytes(*b))
}

/// Seven bits a byte, high ones first; the ninth byte has eight.
fn varint(rest: &mut &[u8]) -> Option<u64> {
    let mut value = 0;
    for index in 0..9 {
        let (&byte, after) = rest.split_first()?;
        *rest = after;
        if index == 8 {
            return Some(value << 8 | u64::from(byte));
        }
        value = value << 7 | u64::from(byte & 0x7f);
        if byte < 0x80 {
            break;
        }
    }
    Some(value)
}

/// A value of a row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Value<'p> {
    Null,
    Integer(i64),
    Real,
    Text(&'p [u8]),
    Blob(&'p [u8]),
}

/// The layout of a row.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row {
    columns: [(u64, u64); MOST_COLUMNS],
    count: usize,
}

impl Row {
    /// From the start of a row; `None` if it is not a row.
    pub(super) fn parse(cell: &Cell<'_>) -> Option<Row> {
        let mut rest = cell.local;
        let header = usize::try_from(varint(&mut rest)?).ok()?;
        let mut types = rest.get(..header.checked_sub(cell.local.len() - rest.len())?)?;
        let mut row = Row { columns: [(0, 0); MOST_COLUMNS], count: 0 };
        let mut at = header as u64;
        while !types.is_empty() {
            let column = varint(&mut types)?;
            if let Some(place) = row.columns.get_mut(row.count) {
                *place = (column, at);
                row.count += 1;
            }
            at = at.checked_add(size(column)?)?;
        }
        (at == cell.length).then_some(row)
    }

    pub(super) fn len(&self) -> usize {
        self.count
    }

    /// Position of the bytes of a blob or text in the row.
    pub(super) fn place(&self, column: usize) -> Option<std::ops::Range<u64>> {
        let (kind, at) = *self.columns.get(..self.count)?.get(column)?;
        (kind >= 12).then(|| at..at + size(kind).unwrap_or_default())
    }

    pub(super) fn is_text(&self, column: usize) -> bool {
        self.columns
            .get(..self.count)
            .and_then(|columns| columns.get(column))
            .is_some_and(|(kind, _)| *kind >= 13 && kind % 2 == 1)
    }

    /// The value, from the available part of the row. `None` if the column is absent, or too little is available.
    pub(super) fn value<'p>(&self, column: usize, row: &'p [u8]) -> Option<Value<'p>> {
        let (kind, at) = *self.columns.get(..self.count)?.get(column)?;
        let bytes = row.get(usize::try_from(at).ok()?..)?.get(..usize::try_from(size(kind)?).ok()?)?;
        Some(match kind {
            0 => Value::Null,
            1..=6 => Value::Integer(signed(bytes)),
            7 => Value::Real,
            8 | 9 => Value::Integer(kind as i64 - 8),
            _ if kind % 2 == 0 => Value::Blob(bytes),
            _ => Value::Text(bytes),
        })
    }

    /// A whole number; `None` for any other value.
    pub(super) fn integer(&self, column: usize, row: &[u8]) -> Option<i64> {
        match self.value(column, row)? {
            Value::Integer(number) => Some(number),
            _ => None,
        }
    }
}

/// Bytes of a value by its type; `None` for types that are reserved.
fn size(kind: u64) -> Option<u64> {
    Some(match kind {
        0 | 8 | 9 => 0,
        1..=4 => kind,
        5 => 6,
        6 | 7 => 8,
        10 | 11 => return None,
        blob => (blob - 12) / 2,
    })
}

fn signed(bytes: &[u8]) -> i64 {
    let negative = bytes.first().is_some_and(|b| *b >= 0x80);
    bytes.iter().fold(if negative { -1 } else { 0 }, |number, &byte| number << 8 | i64::from(byte))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_varint_has_up_to_nine_bytes() {
        for (bytes, value) in [
            (&[0x05][..], 5),
            (&[0x81, 0x00], 128),
            (&[0xff; 9], u64::MAX),
            (&[0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x01], 1),
        ] {
            let mut rest = bytes;
            assert_eq!((varint(&mut rest), rest.len()), (Some(value), 0));
        }
        assert_eq!(varint(&mut &[0x81][..]), None);
    }

    #[test]
    fn whole_numbers_have_one_to_eight_bytes_and_a_sign() {
        assert_eq!(signed(&[0xff, 0xfe]), -2);
        assert_eq!(signed(&[0x01, 0x00, 0x00]), 65_536);
        assert_eq!(signed(&i64::MIN.to_be_bytes()), i64::MIN);
    }

    #[test]
    fn a_row_whose_types_do_not_match_its_length_is_rejected() {
        // Header of three bytes: NULL, one byte; then the byte.
        let cell = |local: &'static [u8], length| Cell { rowid: 1, length, local, overflow: 0, extent: local.len() };
        let row = Row::parse(&cell(&[3, 0, 1, 42], 4)).unwrap();
        assert_eq!(row.value(0, &[3, 0, 1, 42]), Some(Value::Null));
        assert_eq!((row.integer(1, &[3, 0, 1, 42]), row.value(2, &[])), (Some(42), None));
        assert!(Row::parse(&cell(&[3, 0, 1, 42], 5)).is_none());
        assert!(Row::parse(&cell(&[3, 0, 10, 42], 4)).is_none());
        assert!(Row::parse(&cell(&[9, 0, 1, 42], 4)).is_none());
        assert!(Row::parse(&cell(&[0, 0, 1, 42], 4)).is_none());
    }
}
