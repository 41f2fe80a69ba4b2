//! The write-ahead log next to a database: pages that were committed and not yet copied back
//! (<https://www.sqlite.org/fileformat2.html#the_write_ahead_log>).

use crate::error::{LogError, file_name};
use logscan::{ScanError, read_exactly};
use std::collections::HashMap;
use std::fs::File;
use std::path::{Path, PathBuf};

const HEADER_BYTES: usize = 32;
const FRAME_HEAD_BYTES: usize = 24;
/// The last bit gives the byte order of the checksums.
const MAGIC: u32 = 0x377f_0682;

/// The committed pages of a log.
#[derive(Debug)]
pub(super) struct Wal {
    pub(super) file: File,
    pub(super) name: String,
    /// Bytes of the file.
    pub(super) size: u64,
    pub(super) page_bytes: u32,
    /// Pages of the database after the last commit.
    pub(super) pages: u32,
    /// Position of the newest content of each page.
    places: HashMap<u32, u64>,
    /// Frames of unfinished transactions, or with a wrong checksum in the same round of the log.
    pub(super) unfinished: u64,
}

/// The log next to a database.
pub(super) enum Beside {
    Nothing,
    Wal(Wal),
    /// A log that was restarted, with no commit since; its size in bytes.
    Idle(u64),
    /// An unusable log; its size in bytes and the reason.
    Useless(u64, String),
}

/// The path of the log of a database.
pub fn path_of(database: &Path) -> PathBuf {
    let mut path = database.as_os_str().to_owned();
    path.push("-wal");
    path.into()
}

/// Sums 32-bit words in pairs, section 4.2 of the format.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Sum {
    big_endian: bool,
    value: (u32, u32),
}

impl Sum {
    fn add(&mut self, bytes: &[u8]) {
        let word = |b: &[u8]| {
            let word = b.first_chunk().copied().unwrap_or_default();
            if self.big_endian { u32::from_be_bytes(word) } else { u32::from_le_bytes(word) }
        };
        let (mut a, mut b) = self.value;
        for pair in bytes.chunks_exact(8) {
            a = a.wrapping_add(word(pair)).wrapping_add(b);
            b = b.wrapping_add(word(pair.get(4..).unwrap_or_default())).wrapping_add(a);
        }
        self.value = (a, b);
    }
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    bytes.get(at..).and_then(|b| b.first_chunk()).map_or(0, |b| u32::from_be_bytes(*b))
}

/// The checksum of a frame, continued from the previous one, and the one that it states.
fn sum_of(frame: &[u8], mut sum: Sum) -> (u32, u32) {
    sum.add(frame.get(..8).unwrap_or_default());
    sum.add(frame.get(FRAME_HEAD_BYTES..).unwrap_or_default());
    sum.value
}

fn stated_in(frame: &[u8]) -> (u32, u32) {
    (u32_at(frame, 16), u32_at(frame, 20))
}

/// The page size, which must match that of the database if known, and the checksum that the frames continue.
fn parse_header(head: &[u8], page_bytes: Option<u32>) -> Result<(u32, Sum), &'static str> {
    let magic = u32_at(head, 0);
    let mut sum = Sum { big_endian: magic & 1 == 1, value: (0, 0) };
    sum.add(head.get(..24).unwrap_or_default());
    if magic & !1 != MAGIC || sum.value != (u32_at(head, 24), u32_at(head, 28)) {
        return Err("its header is damaged");
    }
    let own = u32_at(head, 8);
    let is_size = own.is_power_of_two() && (512..=65_536).contains(&own);
    if page_bytes.unwrap_or(own) != own || !is_size {
        return Err("its pages do not have the size of those of the database");
    }
    Ok((own, sum))
}

impl Wal {
    /// The log next to `database`, whose pages have `page_bytes` bytes if its header is readable.
    pub(super) fn beside(database: &Path, page_bytes: Option<u32>) -> Result<Beside, LogError> {
        let path = path_of(database);
        let name = file_name(&path);
        // Examined before it is opened: opening a pipe would wait for its writer.
        let size = match std::fs::metadata(&path) {
            Ok(about) if about.is_file() && about.len() > 0 => about.len(),
            _ => return Ok(Beside::Nothing),
        };
        let failed = |source| LogError::Read(ScanError::Io { file: name.clone(), offset: 0, source });
        let file = File::open(&path).map_err(failed)?;
        let mut head = [0; HEADER_BYTES];
        if size < HEADER_BYTES as u64 {
            return Ok(Beside::Useless(size, "it is shorter than its own header".to_owned()));
        }
        read_exactly(&file, &name, &mut head, 0)?;
        let (page_bytes, sum) = match parse_header(&head, page_bytes) {
            Ok(known) => known,
            Err(why) => return Ok(Beside::Useless(size, why.to_owned())),
        };
        let mut wal = Wal { file, name, size, page_bytes, pages: 0, places: HashMap::new(), unfinished: 0 };
        wal.walk(head.get(16..24).unwrap_or_default(), sum)?;
        Ok(match wal.places.len() {
            0 if wal.unfinished > 0 => Beside::Useless(size, "it holds no complete transaction".to_owned()),
            0 => Beside::Idle(size),
            _ => Beside::Wal(wal),
        })
    }

    fn frame_bytes(&self) -> u64 {
        FRAME_HEAD_BYTES as u64 + u64::from(self.page_bytes)
    }

    /// Takes the frames up to the first corrupt one, as SQLite does. Each checksum continues the previous one.
    ///
    /// A log is rewritten from its start: after the last frame of a round there are frames of an earlier one, with
    /// another salt. Frames with the salt of this round, after a corrupt one, are lost.
    fn walk(&mut self, salt: &[u8], mut sum: Sum) -> Result<(), LogError> {
        let frame_bytes = self.frame_bytes();
        let mut frame = vec![0; frame_bytes as usize];
        let mut open: Vec<(u32, u64)> = vec![];
        let (mut at, mut is_sound) = (HEADER_BYTES as u64, true);
        // Rejected frames, and how many of them are known to be of this round.
        let (mut passed, mut lost) = (0, 0);
        while at + frame_bytes <= self.size {
            read_exactly(&self.file, &self.name, &mut frame, at)?;
            let (page, commit) = (u32_at(&frame, 0), u32_at(&frame, 4));
            let is_of_round = frame.get(8..16) == Some(salt);
            sum.value = sum_of(&frame, sum);
            is_sound &= is_of_round && page != 0 && sum.value == stated_in(&frame);
            if is_sound {
                open.push((page, at + FRAME_HEAD_BYTES as u64));
            } else {
                passed += 1;
                lost = if is_of_round { passed } else { lost };
            }
            if is_sound && commit > 0 {
                self.places.extend(open.drain(..));
                self.pages = commit;
            }
            at += frame_bytes;
        }
        // A frame that is truncated by the end of the file.
        let cut = u64::from(at < self.size);
        self.unfinished = lost + open.len() as u64 + cut;
        Ok(())
    }

    /// Position of the newest content of a page in the log.
    pub(super) fn place(&self, page: u32) -> Option<u64> {
        if page > self.pages { None } else { self.places.get(&page).copied() }
    }

    /// The pages after `last` in the log, in order.
    pub(super) fn pages_behind(&self, last: u32) -> Vec<u32> {
        let mut pages: Vec<u32> =
            self.places.keys().copied().filter(|page| (last + 1..=self.pages).contains(page)).collect();
        pages.sort_unstable();
        pages
    }
}
