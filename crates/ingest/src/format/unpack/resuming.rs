//! Packed files of several members, frames or streams, one behind the other: one that is damaged costs no other.

use super::{Packing, decoder, fault_of};
use crate::bytes::is_zero;
use crate::decode::Tally;
use crate::format::MOST_ZEROS;
use std::cell::{Cell, RefCell};
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::os::unix::fs::FileExt;

/// Read, and searched for the next begin, in one go.
const STEP: usize = super::STEP;
/// Bytes by which a begin is told.
const TELLING: usize = 10;
/// So many damaged members are passed over: there may be as many wrong begins as one likes.
const MOST_HOLES: u64 = 1000;

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
    /// Where in the file the unpacking is.
    at: &'r Cell<u64>,
    bad: &'r Cell<u64>,
    holes: &'r RefCell<Holes>,
    decoder: Box<dyn Read + 'r>,
    /// Where that began.
    from: u64,
    /// What is unpacked has lines: a line end stands for what is missing, lest two halves become a row.
    lines: bool,
    owes_line_end: bool,
}

impl<'r> Resuming<'r> {
    pub(super) fn new(
        file: &'r File,
        packing: Packing,
        lines: bool,
        (at, bad): (&'r Cell<u64>, &'r Cell<u64>),
        holes: &'r RefCell<Holes>,
    ) -> Result<Resuming<'r>, String> {
        let decoder = decoder(packing, Packed::new(file, 0, at), bad)?;
        Ok(Resuming { file, packing, at, bad, holes, decoder, from: 0, lines, owes_line_end: false })
    }

    /// Begins anew at the next member behind the damage; `false` if there is none.
    fn go_on(&mut self, error: &io::Error) -> io::Result<bool> {
        let damaged_at = self.at.get();
        if error.raw_os_error().is_some() || self.holes.borrow().count.count >= MOST_HOLES {
            return Ok(false);
        }
        let Some(next) = next_begin(self.file, self.packing, damaged_at.max(self.from + 1))? else { return Ok(false) };
        let Ok(decoder) = decoder(self.packing, Packed::new(self.file, next, self.at), self.bad) else {
            return Ok(false);
        };
        let mut holes = self.holes.borrow_mut();
        if holes.count.count == 0 {
            holes.first_at = damaged_at;
        }
        holes.count.add(|| fault_of(error, self.packing));
        holes.bytes += next - damaged_at;
        (self.decoder, self.from, self.owes_line_end) = (decoder, next, self.lines);
        Ok(true)
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
                    let place = self.at.get();
                    if !self.go_on(&error)? {
                        self.at.set(place);
                        return Err(error);
                    }
                }
                other => return other,
            }
        }
    }
}

/// Where, at or behind `from`, something packed begins.
fn next_begin(file: &File, packing: Packing, from: u64) -> io::Result<Option<u64>> {
    let Some(magic) = magic(packing) else { return Ok(None) };
    let finder = memchr::memmem::Finder::new(magic);
    let (mut at, mut zeros) = (from, 0);
    let mut block = vec![];
    while zeros <= MOST_ZEROS {
        block.clear();
        Packed::new(file, at, &Cell::default()).take(STEP as u64).read_to_end(&mut block)?;
        let is_begin = |hit: &usize| block.get(*hit..).is_some_and(|bytes| begins(packing, bytes));
        if let Some(hit) = finder.find_iter(&block).find(is_begin) {
            return Ok(Some(at + hit as u64));
        }
        if block.len() < STEP {
            break;
        }
        zeros = if is_zero(&block) { zeros + STEP as u64 } else { 0 };
        at += (STEP - TELLING) as u64;
    }
    Ok(None)
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
        let got = self.file.read_at(buffer, self.next)?;
        self.next += got as u64;
        Ok(got)
    }
}
