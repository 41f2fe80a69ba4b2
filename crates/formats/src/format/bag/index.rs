//! The index at the end of a bag: connections, chunk offsets and message counts.

use super::bag_record::{Kind, LONGEST, Record};
use super::connections::Connections;
use crate::bytes::Bytes;
use crate::format::compare_count;
use crate::format::unpacker::MOST_PLACES;
use flight::{Code, Notices, Severity};
use logscan::{LogFile, ScanError, Source};

/// What the end of the bag says about the rest.
#[derive(Debug, Default)]
pub(super) enum Index {
    /// The bag header says that there is no index: the recorder did not close the bag.
    None,
    /// It should extend past the end of the file.
    CutOff,
    /// The index or the bag header cannot be read.
    #[default]
    Unreadable,
    /// Messages in all chunks.
    Counts(u64),
}

/// An index being read.
pub(super) struct IndexReader<'i, 'b, 't> {
    pub(super) file: &'i mut LogFile,
    pub(super) connections: &'i mut Connections<'b, 't>,
    /// Maximum record length.
    pub(super) most: u64,
    /// Offsets of the chunks that it lists.
    pub(super) places: Vec<u64>,
}

impl IndexReader<'_, '_, '_> {
    /// Reads the index from this offset on; the bag header gives the number of chunks.
    pub(super) fn read(&mut self, start: u64, chunks: Option<u32>) -> Result<Index, ScanError> {
        let (mut at, mut messages, mut seen) = (start, 0_u64, 0_u64);
        while at < self.file.size() {
            let head = self.file.up_to(at, LONGEST)?;
            let intact = |record: &Record<'_>| record.fits_its_count() != Some(false);
            let length = Record::of(head).filter(intact).map(|record| record.length());
            let Some(length) = length.filter(|length| *length <= self.most) else { return Ok(Index::Unreadable) };
            let Some(bytes) = self.file.bytes(at, length as usize)? else { return Ok(Index::Unreadable) };
            let Some(record) = Record::of(bytes) else { return Ok(Index::Unreadable) };
            let data = bytes.get(record.head..).unwrap_or_default();
            match record.kind {
                // The scan reports connection errors when it gets there.
                Kind::Connection { connection, topic } => drop(self.connections.announce(connection, topic, data)),
                Kind::ChunkInfo { chunk_at, .. } => {
                    self.places.extend(Some(chunk_at).filter(|_| seen < MOST_PLACES as u64));
                    seen += 1;
                    messages = messages.saturating_add(counts(data));
                }
                _ => return Ok(Index::Unreadable),
            }
            at += length;
        }
        let whole = chunks.is_none_or(|chunks| seen >= u64::from(chunks));
        Ok(if whole { Index::Counts(messages) } else { Index::CutOff })
    }
}

impl Index {
    pub(super) fn conclude(&self, file: &str, found: u64, notices: &mut Notices) {
        match self {
            Index::None => {
                let text = "the bag has no index: the recorder was stopped before it closed the bag";
                notices.push(Code::IncompleteRecording, file, 1, text);
            }
            Index::CutOff => {
                notices.push(Code::IncompleteRecording, file, 1, "the bag is truncated before the end of its index");
            }
            Index::Unreadable => {
                let text = "the index cannot be read, so it is unknown whether messages are missing";
                notices.push(Code::IndexDiffers.at(Severity::Loss), file, 1, text);
            }
            Index::Counts(stated) => compare_count("index", *stated, found, file, notices),
        }
    }
}

/// Messages that a chunk info lists, as pairs of connection and count.
fn counts(data: &[u8]) -> u64 {
    let mut rest = Bytes(data);
    let mut sum = 0;
    while let (Some(_connection), Some(count)) = (rest.u32(), rest.u32()) {
        sum += u64::from(count);
    }
    sum
}
