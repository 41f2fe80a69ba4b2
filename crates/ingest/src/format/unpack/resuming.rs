//! Packed files of several members, frames or streams, one behind the other: one that is damaged costs no other.

use super::{Packing, decoder, fault_of};
use crate::bytes::is_zero;
use crate::decode::Tally;
use logscan::MOST_ZEROS;
use std::cell::{Cell, RefCell};
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};

/// Read, and searched for the next begin, in one go.
const STEP: usize = super::STEP;
/// Bytes by which a begin is told.
const TELLING: usize = 10;
/// So many damaged members are passed over: there may be as many wrong begins as one likes.
const MOST_HOLES: u64 = 1000;
/// Blocks of frames that are walked over to see whether a begin is one.
const MOST_BLOCKS: u64 = 1 << 18;
/// What a wrong length took along is read again up to this multiple of the file.
const MOST_AGAIN: u64 = 2;

/// How far a file is unpacked.
#[derive(Debug, Default)]
pub(super) struct Marks {
    /// Bytes of it that were used.
    pub(super) at: Cell<u64>,
    /// Where the member began that was begun last, where that is known.
    pub(super) begun: Cell<u64>,
    /// Characters of UTF-16 that are none.
    pub(super) bad: Cell<u64>,
}

/// What was passed over.
#[derive(Debug, Default)]
pub(super) struct Holes {
    /// How often, and the first: why.
    pub(super) count: Tally,
    /// Where the first is.
    pub(super) first_at: u64,
    /// Packed bytes.
    pub(super) bytes: u64,
}

/// Unpacks a file, and where that fails goes on with the next member in it.
pub(super) struct Resuming<'r> {
    file: &'r File,
    packing: Packing,
    marks: &'r Marks,
    holes: &'r RefCell<Holes>,
    decoder: Box<dyn Read + 'r>,
    /// Where that began.
    from: u64,
    /// What is unpacked has lines: a line end stands for what is missing, lest two halves become a row.
    lines: bool,
    owes_line_end: bool,
    size: u64,
    /// Bytes that were read again, and blocks that were walked over.
    again: u64,
    blocks: u64,
}

impl<'r> Resuming<'r> {
    pub(super) fn new(
        file: &'r File,
        packing: Packing,
        lines: bool,
        marks: &'r Marks,
        holes: &'r RefCell<Holes>,
    ) -> Result<Resuming<'r>, String> {
        let size = file.metadata().map_err(|e| e.to_string())?.len();
        let decoder = decoder(packing, Packed::new(file, 0, &marks.at), marks)?;
        let (from, owes_line_end, again, blocks) = (0, false, 0, 0);
        Ok(Resuming { file, packing, marks, holes, decoder, from, lines, owes_line_end, size, again, blocks })
    }

    /// Begins anew at the next member behind the damage; `false` if there is none.
    fn go_on(&mut self, error: &io::Error) -> io::Result<bool> {
        let damaged_at = self.marks.at.get();
        if error.raw_os_error().is_some() || self.holes.borrow().count.count >= MOST_HOLES {
            return Ok(false);
        }
        // A wrong length may have taken whole members along.
        let known = self.packing != Packing::Zstd;
        let may_read_again = known && self.again <= MOST_AGAIN * self.size;
        let from = if may_read_again { self.marks.begun.get() + 1 } else { damaged_at.max(self.from + 1) };
        // The library takes nothing of a frame of Zstandard that fails at once.
        let is_own = self.packing == Packing::Zstd && self.begins_at(from)?;
        let Some(next) = self.next_begin(from + u64::from(is_own))? else { return Ok(false) };
        let packed = Packed::new(self.file, next, &self.marks.at);
        let Ok(decoder) = decoder(self.packing, packed, self.marks) else { return Ok(false) };
        self.again += damaged_at.saturating_sub(next);
        let mut holes = self.holes.borrow_mut();
        if holes.count.count == 0 {
            holes.first_at = damaged_at.min(next);
        }
        holes.count.add(|| fault_of(error, self.packing));
        holes.bytes += next.saturating_sub(from);
        (self.decoder, self.from, self.owes_line_end) = (decoder, next, self.lines);
        Ok(true)
    }

    /// Where, at or behind `from`, something packed begins.
    fn next_begin(&mut self, from: u64) -> io::Result<Option<u64>> {
        let Some(magic) = magic(self.packing) else { return Ok(None) };
        let finder = memchr::memmem::Finder::new(magic);
        let (mut at, mut zeros) = (from, 0);
        while zeros <= MOST_ZEROS {
            let block = self.look(at, STEP)?;
            for hit in finder.find_iter(&block) {
                let begins = block.get(hit..).is_some_and(|bytes| begins(self.packing, bytes));
                if begins && self.is_member(at + hit as u64)? {
                    return Ok(Some(at + hit as u64));
                }
            }
            if block.len() < STEP {
                break;
            }
            zeros = if is_zero(&block) { zeros + STEP as u64 } else { 0 };
            at += (STEP - TELLING) as u64;
        }
        Ok(None)
    }

    fn look(&self, at: u64, most: usize) -> io::Result<Vec<u8>> {
        let mut bytes = vec![];
        At { file: self.file, next: at }.take(most as u64).read_to_end(&mut bytes)?;
        Ok(bytes)
    }

    fn begins_at(&self, at: u64) -> io::Result<bool> {
        let bytes = self.look(at, TELLING)?;
        Ok(magic(self.packing).is_some_and(|magic| bytes.starts_with(magic)) && begins(self.packing, &bytes))
    }

    /// Whether a begin is that of a member, and not of something packed within one: the file ends where it does, or in it, or
    /// another one follows.
    fn is_member(&mut self, at: u64) -> io::Result<bool> {
        let end = match self.packing {
            Packing::Zstd => self.end_of_zstd(at)?,
            Packing::Lz4 => self.end_of_lz4(at)?,
            Packing::Gzip | Packing::Bzip2 | Packing::Zip | Packing::Utf16 { .. } => return Ok(true),
        };
        let Some(end) = end else { return Ok(false) };
        let is_skippable = || {
            let next = self.look(end, 4)?;
            Ok::<_, io::Error>(matches!(*next, [0x50..=0x5f, 0x2a, 0x4d, 0x18]))
        };
        Ok(end >= self.size || self.begins_at(end)? || is_skippable()?)
    }

    /// Where a frame ends, or a place behind the end of the file; `None` if it is none (RFC 8878, 3.1.1).
    fn end_of_zstd(&mut self, at: u64) -> io::Result<Option<u64>> {
        const LONGEST: u64 = 128 << 10;
        let descriptor = self.look(at + 4, 1)?.first().copied().unwrap_or_default();
        let single = descriptor >> 5 & 1;
        let dictionary = [0, 1, 2, 4].get(usize::from(descriptor & 3)).copied().unwrap_or(0);
        let content = [u64::from(single), 2, 4, 8].get(usize::from(descriptor >> 6)).copied().unwrap_or(0);
        let mut end = at + 5 + u64::from(1 - single) + dictionary + content;
        loop {
            self.blocks += 1;
            let &[low, middle, high] = &*self.look(end, 3)? else { return Ok(Some(self.size)) };
            let head = u64::from(u32::from_le_bytes([low, middle, high, 0]));
            let (is_last, kind, size) = (head & 1 == 1, head >> 1 & 3, head >> 3);
            if kind == 3 || size > LONGEST {
                return Ok(None);
            }
            end += 3 + if kind == 1 { 1 } else { size };
            if is_last {
                return Ok(Some(end + if descriptor >> 2 & 1 == 1 { 4 } else { 0 }));
            }
            if end >= self.size || self.blocks > MOST_BLOCKS {
                return Ok(Some(self.size));
            }
        }
    }

    /// As [`Resuming::end_of_zstd`], of LZ4 (`lz4_Frame_format.md`).
    fn end_of_lz4(&mut self, at: u64) -> io::Result<Option<u64>> {
        let &[flags, sizes] = &*self.look(at + 4, 2)? else { return Ok(Some(self.size)) };
        let [has_sums, has_size, has_sum, has_dictionary] = [4, 3, 2, 0].map(|bit| u64::from(flags >> bit & 1));
        let longest = 1_u64 << (8 + 2 * u64::from(sizes >> 4 & 7));
        let mut end = at + 6 + 8 * has_size + 4 * has_dictionary + 1;
        loop {
            self.blocks += 1;
            let head = self.look(end, 4)?;
            let Some(head) = head.first_chunk().map(|four| u64::from(u32::from_le_bytes(*four))) else {
                return Ok(Some(self.size));
            };
            let size = head & 0x7fff_ffff;
            if size > longest {
                return Ok(None);
            }
            end += 4 + size + if size > 0 { 4 * has_sums } else { 0 };
            if size == 0 {
                return Ok(Some(end + 4 * has_sum));
            }
            if end >= self.size || self.blocks > MOST_BLOCKS {
                return Ok(Some(self.size));
            }
        }
    }
}

impl Read for Resuming<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        loop {
            if let Some(first) = buffer.first_mut().filter(|_| self.owes_line_end) {
                *first = b'\n';
                self.owes_line_end = false;
                return Ok(1);
            }
            match self.decoder.read(buffer) {
                Err(error) if error.kind() != io::ErrorKind::Interrupted => {
                    let place = self.marks.at.get();
                    if !self.go_on(&error)? {
                        self.marks.at.set(place);
                        return Err(error);
                    }
                }
                other => return other,
            }
        }
    }
}

/// What a member begins with; `None` for what has no members.
fn magic(packing: Packing) -> Option<&'static [u8]> {
    match packing {
        Packing::Gzip => Some(b"\x1f\x8b\x08"),
        Packing::Zstd => Some(b"\x28\xb5\x2f\xfd"),
        Packing::Bzip2 => Some(b"BZh"),
        Packing::Lz4 => Some(b"\x04\x22\x4d\x18"),
        Packing::Zip | Packing::Utf16 { .. } => None,
    }
}

/// Whether these bytes, which begin with the magic, are the begin of a member: what is reserved is zero (RFC 1952, 2.3; RFC
/// 8878, 3.1.1.1; the frame format of LZ4), and a stream of bzip2 has a block.
fn begins(packing: Packing, bytes: &[u8]) -> bool {
    const BLOCK: &[u8] = b"1AY&SY";
    match (packing, bytes) {
        (Packing::Gzip, [_, _, _, flags, _, _, _, _, extra, system, ..]) => {
            flags & 0xe0 == 0 && matches!(extra, 0 | 2 | 4) && matches!(system, 0..=13 | 255)
        }
        (Packing::Zstd, [_, _, _, _, descriptor, ..]) => descriptor & 0x08 == 0,
        (Packing::Bzip2, [_, _, _, b'1'..=b'9', block @ ..]) => block.starts_with(BLOCK),
        (Packing::Lz4, [_, _, _, _, flags, sizes, ..]) => flags & 0xc2 == 0x40 && sizes & 0x8f == 0 && sizes >> 4 >= 4,
        _ => false,
    }
}

/// A file from some place on, and how far of it was used.
struct Packed<'r> {
    inner: BufReader<At<'r>>,
    at: &'r Cell<u64>,
}

impl<'r> Packed<'r> {
    fn new(file: &'r File, from: u64, at: &'r Cell<u64>) -> Packed<'r> {
        at.set(from);
        Packed { inner: BufReader::with_capacity(STEP, At { file, next: from }), at }
    }
}

impl Read for Packed<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let got = self.fill_buf()?.read(buffer)?;
        self.consume(got);
        Ok(got)
    }
}

impl BufRead for Packed<'_> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        self.inner.fill_buf()
    }

    fn consume(&mut self, bytes: usize) {
        self.inner.consume(bytes);
        self.at.set(self.at.get() + bytes as u64);
    }
}

struct At<'r> {
    file: &'r File,
    next: u64,
}

impl Read for At<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let got = logscan::read_at(self.file, buffer, self.next)?;
        self.next += got as u64;
        Ok(got)
    }
}
