//! The summary at the end of a file: hints for the walk, trusted as far as its checksum allows.

use super::Channels;
use super::mcap_record::{self, HEAD_BYTES, Head, MAGIC};
use crate::bytes::Bytes;
use logscan::{LogFile, ScanError, Source};
use mcap::records::{Record, op};
use std::ops::Range;

/// Content of the footer.
const FOOTER_BYTES: u64 = 20;
/// Content of the record that ends the data section.
const DATA_END_BYTES: u64 = 4;
/// Maximum chunk indexes held; with more of them nothing is skipped.
const MOST_CHUNKS: usize = 1 << 20;
/// Chunks are skipped only if they make up at least this fraction (one in N) of the bytes.
const WORTH_CLOSING: u128 = 10;
/// Bytes of the summary checksummed in one go.
const BLOCK: usize = 256 << 10;

/// How far the summary can be trusted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum Trust {
    /// There is no summary, or the end of the file is missing.
    #[default]
    Absent,
    /// It has no checksum.
    Unchecked,
    /// Its checksum is valid.
    Good,
    /// Its checksum is wrong, or it cannot be read.
    Bad,
}

/// A chunk as listed in the summary.
#[derive(Debug, Clone, Copy)]
pub(super) struct IndexedChunk {
    pub(super) offset: u64,
    pub(super) length: u64,
    /// Whether it holds, or may hold, wanted messages.
    pub(super) wanted: bool,
}

/// What the end of a log states about the rest of it.
#[derive(Debug, Default)]
pub(super) struct Summary {
    pub(super) trust: Trust,
    /// Checksum of the data section: 0 means that there is nothing to check.
    pub(super) data_crc: Option<u32>,
    /// Chunks, by offset.
    pub(super) chunks: Vec<IndexedChunk>,
    /// There are some, whether or not their offsets are known.
    pub(super) has_chunks: bool,
    /// Message count of the file, from the statistics.
    pub(super) messages: Option<u64>,
}

impl Summary {
    /// Reads the summary at the end of a file; channels of a trusted summary are passed to `channels`. No record may be longer than `most`.
    pub(super) fn read(file: &mut LogFile, most: u64, channels: &mut Channels<'_, '_>) -> Result<Summary, ScanError> {
        let Some(place) = Place::find(file)? else { return Ok(Summary::default()) };
        let mut summary = Summary::default();
        let data_end = place.start.unwrap_or(place.footer).checked_sub(HEAD_BYTES + DATA_END_BYTES);
        summary.data_crc = match data_end {
            Some(at) => data_crc(file, at)?,
            None => None,
        };
        let Some(start) = place.start else { return Ok(summary) };
        summary.trust = place.check(file, start)?;
        let is_bad = summary.trust == Trust::Bad;
        if is_bad || summary.read_records(file, start..place.footer, most, channels)?.is_none() {
            return Ok(Summary { trust: Trust::Bad, ..Summary::default() });
        }
        Ok(summary)
    }

    /// Two passes over the records, because an index may come before the channels that it refers to.
    fn read_records(
        &mut self,
        file: &mut LogFile,
        place: Range<u64>,
        most: u64,
        channels: &mut Channels<'_, '_>,
    ) -> Result<Option<()>, ScanError> {
        let good = self.trust == Trust::Good;
        let read = each_record(file, place.clone(), most, |opcode, body| {
            if good && matches!(opcode, op::SCHEMA | op::CHANNEL) {
                // The walk reports unreadable records when it reaches them.
                let _ = channels.record(opcode, body);
            }
            Some(())
        })?;
        if read.is_none() {
            return Ok(None);
        }
        let indexes = each_record(file, place, most, |opcode, body| self.index(opcode, body, channels))?;
        self.chunks.sort_by_key(|c| c.offset);
        self.has_chunks = !self.chunks.is_empty();
        if self.chunks.len() >= MOST_CHUNKS {
            self.chunks.clear();
        }
        self.open_all_unless_it_pays();
        Ok(indexes)
    }

    /// The message sizes in a skipped chunk remain unknown, so skipping little is not worth it.
    fn open_all_unless_it_pays(&mut self) {
        let bytes = |chunk: &IndexedChunk| u128::from(chunk.length);
        let all: u128 = self.chunks.iter().map(bytes).sum();
        let closed: u128 = self.chunks.iter().filter(|c| !c.wanted).map(bytes).sum();
        if closed * WORTH_CLOSING < all {
            self.chunks.iter_mut().for_each(|chunk| chunk.wanted = true);
        }
    }

    fn index(&mut self, opcode: u8, body: &[u8], channels: &mut Channels<'_, '_>) -> Option<()> {
        match opcode {
            op::STATISTICS => {
                let Ok(Record::Statistics(statistics)) = mcap_record::parse(opcode, body) else { return None };
                self.messages = Some(statistics.message_count);
            }
            op::CHUNK_INDEX if self.chunks.len() < MOST_CHUNKS => {
                let Ok(Record::ChunkIndex(index)) = mcap_record::parse(opcode, body) else { return None };
                // Without message indexes the content of the chunk is unknown.
                let listed = &index.message_index_offsets;
                let wanted = self.trust != Trust::Good
                    || listed.is_empty()
                    || listed.keys().any(|&channel| channels.may_want(channel));
                let (offset, length) = (index.chunk_start_offset, index.chunk_length);
                self.chunks.push(IndexedChunk { offset, length, wanted });
            }
            _ => {}
        }
        Some(())
    }

    /// The chunk that should start at `offset`.
    pub(super) fn chunk_at(&self, offset: u64) -> Option<IndexedChunk> {
        let found = self.chunks.binary_search_by_key(&offset, |c| c.offset).ok()?;
        self.chunks.get(found).copied()
    }
}

/// Calls `visit` for all records in `place`; `None` as soon as one is corrupt or longer than `most`.
fn each_record(
    file: &mut LogFile,
    place: Range<u64>,
    most: u64,
    mut visit: impl FnMut(u8, &[u8]) -> Option<()>,
) -> Result<Option<()>, ScanError> {
    let mut at = place.start;
    while at < place.end {
        let Some(head) = Head::read(file, at)?.filter(|head| head.end <= place.end && head.length <= most) else {
            return Ok(None);
        };
        let Some(body) = file.bytes(at + HEAD_BYTES, head.length as usize)? else { return Ok(None) };
        if visit(head.opcode, body).is_none() {
            return Ok(None);
        }
        at = head.end;
    }
    Ok(Some(()))
}

fn data_crc(file: &mut LogFile, at: u64) -> Result<Option<u32>, ScanError> {
    let Some(head) = Head::read(file, at)? else { return Ok(None) };
    if head.opcode != op::DATA_END || head.length != DATA_END_BYTES {
        return Ok(None);
    }
    Ok(file.bytes(at + HEAD_BYTES, DATA_END_BYTES as usize)?.and_then(|b| Bytes(b).u32()))
}

/// Positions of the footer and the summary.
struct Place {
    footer: u64,
    start: Option<u64>,
    crc: u32,
}

impl Place {
    /// `None` if the log does not end properly.
    fn find(file: &mut LogFile) -> Result<Option<Place>, ScanError> {
        let tail = HEAD_BYTES + FOOTER_BYTES + MAGIC.len() as u64;
        let Some(footer) = file.size().checked_sub(tail) else { return Ok(None) };
        let Some(bytes) = file.bytes(footer, tail as usize)? else { return Ok(None) };
        Ok(Place::parse(footer, bytes))
    }

    fn parse(footer: u64, bytes: &[u8]) -> Option<Place> {
        let mut rest = Bytes(bytes);
        let head = (rest.u8()?, rest.u64()?);
        let (start, _offsets, crc) = (rest.u64()?, rest.u64()?, rest.u32()?);
        let whole = head == (op::FOOTER, FOOTER_BYTES) && rest.0 == MAGIC;
        let start = (start != 0).then_some(start);
        whole.then_some(Place { footer, start, crc })
    }

    /// The checksum covers the summary and the footer up to the checksum itself.
    fn check(&self, file: &mut LogFile, start: u64) -> Result<Trust, ScanError> {
        if start > self.footer {
            return Ok(Trust::Bad);
        }
        if self.crc == 0 {
            return Ok(Trust::Unchecked);
        }
        let end = self.footer + HEAD_BYTES + FOOTER_BYTES - 4;
        let mut hasher = crc32fast::Hasher::new();
        let mut at = start;
        while at < end {
            let block = file.up_to(at, BLOCK.min((end - at) as usize))?;
            hasher.update(block);
            at += block.len().max(1) as u64;
        }
        Ok(if hasher.finalize() == self.crc { Trust::Good } else { Trust::Bad })
    }
}
