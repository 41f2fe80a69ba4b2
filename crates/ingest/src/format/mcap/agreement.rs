//! What the headers of chunks and the summary say of the data, against what the data are. No row depends on it, for the data
//! are followed; but whoever believes the index reads something else.

use super::Tally;
use super::record::{self, ChunkHead, Head};
use crate::bytes::Bytes;
use crate::error::IngestError;
use crate::format::inflate::Codec;
use logscan::LogFile;
use mcap::records::{ChunkIndex, Record, Statistics, op};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::{Debug, Display};

/// Chunks that are remembered; of more nothing is said.
const MOST_CHUNKS: usize = 1 << 16;
/// Numbers of channels up to which messages are counted chunk by chunk.
const MOST_COUNTED: usize = 1 << 12;
/// Groups of the summary, of which there are as many as types of records.
const MOST_GROUPS: usize = 16;

/// Characters of what differs that are told.
const LONGEST_TOLD: usize = 100;

/// First and last log time, ns.
type Times = Option<(u64, u64)>;

/// What a log holds, and what it says that it holds.
#[derive(Default)]
pub(super) struct Agreement {
    /// By their places in the file.
    chunks: BTreeMap<u64, SeenChunk>,
    /// Where the last one is.
    last: u64,
    schemas: BTreeSet<u16>,
    channels: BTreeSet<u16>,
    attachments: u64,
    metadata: u64,
    /// Messages by the number of their channel.
    messages: Vec<u64>,
    /// The same in front of the last chunk, if that was opened to its end.
    before: Option<Vec<u64>>,
    times: Times,
    /// Of the messages of the chunk that is being read.
    times_in_chunk: Times,
    /// Not everything was read.
    is_partial: bool,
    /// There are more chunks than are remembered.
    is_full: bool,
    /// The summary repeats schemas and channels.
    repeats: (bool, bool),
    indexed: BTreeSet<u64>,
    attachments_indexed: u64,
    metadata_indexed: u64,
    statistics: Option<Statistics>,
    groups: Vec<(u8, u64)>,
    differences: Tally,
}

struct SeenChunk {
    length: u64,
    codec: Codec,
    compressed: u64,
    uncompressed: u64,
    times: (u64, u64),
    /// As far as it was opened: of one without messages writers state any times.
    has_messages: bool,
    /// Message indexes behind it, and their bytes.
    indexes: usize,
    index_bytes: u64,
    /// The channels of these, as one number that is the same for the same channels in any order.
    channels: u64,
}

/// A number that few other channels together come to.
fn mark(channel: u16) -> u64 {
    (u64::from(channel) + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29).wrapping_mul(0xbf58_476d_1ce4_e5b9)
}

fn spread(times: &mut Times, time: u64) {
    *times = Some(times.map_or((time, time), |(first, last)| (first.min(time), last.max(time))));
}

impl Agreement {
    /// A chunk, before its records.
    pub(super) fn chunk(&mut self, head: &Head, chunk: &ChunkHead) {
        if self.chunks.len() >= MOST_CHUNKS {
            self.is_full = true;
            return;
        }
        (self.last, self.times_in_chunk) = (head.start, None);
        let is_counted = self.messages.len() <= MOST_COUNTED;
        self.before = is_counted.then(|| self.messages.clone());
        let seen = SeenChunk {
            length: head.end - head.start,
            codec: chunk.codec,
            compressed: chunk.compressed,
            uncompressed: chunk.uncompressed,
            times: chunk.times,
            has_messages: false,
            indexes: 0,
            index_bytes: 0,
            channels: 0,
        };
        self.chunks.insert(head.start, seen);
    }

    /// A chunk that was left closed.
    pub(super) fn closed(&mut self) {
        self.is_partial = true;
        self.before = None;
    }

    /// A chunk whose records have all been seen.
    pub(super) fn end_of_chunk(&mut self) {
        let Some((chunk, found)) = self.chunks.get_mut(&self.last).zip(self.times_in_chunk) else { return };
        chunk.has_messages = true;
        let place = format_args!("chunk at byte {}: ", self.last);
        compare(&mut self.differences, place, "times", chunk.times, found);
    }

    /// A message index in the data, with the bytes of its channel and of the length of its entries.
    pub(super) fn message_index(&mut self, head: &Head, frame: Option<[u8; 6]>) {
        const ENTRY: u64 = 16;
        let Some(chunk) = self.chunks.get_mut(&self.last) else { return };
        chunk.indexes += 1;
        chunk.index_bytes += head.end - head.start;
        let Some(frame) = frame else { return };
        let mut rest = Bytes(&frame);
        let (Some(channel), Some(bytes)) = (rest.u16(), rest.u32()) else { return };
        chunk.channels = chunk.channels.wrapping_add(mark(channel));
        let Some(before) = &self.before else { return };
        let count = |messages: &[u64]| messages.get(usize::from(channel)).copied().unwrap_or_default();
        let place = format_args!("message index at byte {}: ", head.start);
        let found = count(&self.messages) - count(before);
        compare(&mut self.differences, place, "messages", u64::from(bytes) / ENTRY, found);
    }

    /// A record of the data, in a chunk or in none.
    #[inline]
    pub(super) fn data(&mut self, opcode: u8, body: &[u8]) {
        let mut rest = Bytes(body);
        match opcode {
            op::MESSAGE => {
                let (Some(channel), Some(_), Some(time)) = (rest.u16(), rest.u32(), rest.u64()) else { return };
                let channel = usize::from(channel);
                if self.messages.len() <= channel {
                    self.messages.resize(channel + 1, 0);
                }
                if let Some(count) = self.messages.get_mut(channel) {
                    *count += 1;
                }
                spread(&mut self.times_in_chunk, time);
                spread(&mut self.times, time);
            }
            op::SCHEMA => self.schemas.extend(rest.u16()),
            op::CHANNEL => self.channels.extend(rest.u16()),
            op::ATTACHMENT => self.attachments += 1,
            op::METADATA => self.metadata += 1,
            _ => {}
        }
    }

    /// A record of the summary of a log that begins at `start`.
    pub(super) fn summary(&mut self, opcode: u8, body: &[u8], start: u64) {
        match opcode {
            op::SCHEMA | op::CHANNEL => {
                self.data(opcode, body);
                self.repeats.0 |= opcode == op::SCHEMA;
                self.repeats.1 |= opcode == op::CHANNEL;
            }
            op::ATTACHMENT_INDEX => self.attachments_indexed += 1,
            op::METADATA_INDEX => self.metadata_indexed += 1,
            op::SUMMARY_OFFSET if self.groups.len() < MOST_GROUPS => {
                let mut rest = Bytes(body);
                // Some writers list groups that are empty.
                if let (Some(group), Some(at), Some(1..)) = (rest.u8(), rest.u64(), rest.u64()) {
                    self.groups.push((group, start.saturating_add(at)));
                }
            }
            op::STATISTICS => {
                if let Ok(Record::Statistics(statistics)) = record::parse(opcode, body) {
                    self.statistics = Some(statistics);
                }
            }
            op::CHUNK_INDEX => {
                if let Ok(Record::ChunkIndex(index)) = record::parse(opcode, body) {
                    self.chunk_index(&index, start);
                }
            }
            _ => {}
        }
    }

    fn chunk_index(&mut self, index: &ChunkIndex, start: u64) {
        let at = start.saturating_add(index.chunk_start_offset);
        let Some(chunk) = self.chunks.get(&at) else {
            return self.differences.add(|| format!("a chunk is listed at byte {at}, where none is"));
        };
        let codec = match chunk.codec {
            Codec::Zstd => "zstd",
            Codec::Lz4 => "lz4",
            Codec::None | Codec::Bz2 => "",
        };
        let behind = at + chunk.length..at + chunk.length + chunk.index_bytes;
        let offsets = &index.message_index_offsets;
        let lead_there = offsets.values().all(|&offset| behind.contains(&start.saturating_add(offset)));
        // Writers may leave the message indexes out.
        let listed = if index.message_index_length == 0 { (0, 0) } else { (chunk.index_bytes, chunk.indexes) };
        let place = format_args!("index of the chunk at byte {at}: ");
        let told = &mut self.differences;
        compare(told, place, "length", index.chunk_length, chunk.length);
        compare(told, place, "compressed size", index.compressed_size, chunk.compressed);
        compare(told, place, "uncompressed size", index.uncompressed_size, chunk.uncompressed);
        if chunk.has_messages {
            compare(told, place, "times", (index.message_start_time, index.message_end_time), chunk.times);
        }
        compare(told, place, "compression", index.compression.as_str(), codec);
        compare(told, place, "bytes of message indexes", index.message_index_length, listed.0);
        compare(told, place, "message indexes", offsets.len(), listed.1);
        compare(told, place, "all of them behind the chunk", lead_there, true);
        let channels = offsets.keys().fold(0, |sum: u64, &channel| sum.wrapping_add(mark(channel)));
        compare(told, place, "the channels of these", offsets.is_empty() || channels == chunk.channels, true);
        if !self.indexed.insert(at) {
            self.differences.add(|| format!("the chunk at byte {at} is listed twice"));
        }
    }

    /// Where what was said differs from what was found.
    pub(super) fn conclude(mut self, file: &mut LogFile) -> Result<Tally, IngestError> {
        if self.is_full {
            return Ok(Tally::default());
        }
        let told = &mut self.differences;
        for (group, at) in self.groups {
            let there = file.peek::<1>(at)?.map_or("nothing".to_owned(), |[opcode]| record::name(opcode));
            compare(told, format_args!("summary offset of byte {at}: "), "group", record::name(group), there);
        }
        let chunks = self.chunks.len() as u64;
        for (what, listed, found) in [
            ("chunks listed", self.indexed.len() as u64, chunks),
            ("attachments listed", self.attachments_indexed, self.attachments),
            ("metadata listed", self.metadata_indexed, self.metadata),
        ] {
            if listed > 0 {
                compare(told, "", what, listed, found);
            }
        }
        let Some(stated) = self.statistics else { return Ok(self.differences) };
        let place = "statistics: ";
        compare(told, place, "attachments", u64::from(stated.attachment_count), self.attachments);
        compare(told, place, "metadata", u64::from(stated.metadata_count), self.metadata);
        compare(told, place, "chunks", u64::from(stated.chunk_count), chunks);
        if self.is_partial {
            return Ok(self.differences);
        }
        // Those that nothing uses stand nowhere else than in the summary.
        let (schemas, channels) = (usize::from(stated.schema_count), stated.channel_count as usize);
        if self.repeats.0 || schemas < self.schemas.len() {
            compare(told, place, "schemas", schemas, self.schemas.len());
        }
        if self.repeats.1 || channels < self.channels.len() {
            compare(told, place, "channels", channels, self.channels.len());
        }
        // For the writer in Go 0 is no time.
        if let Some(found) = self.times.filter(|(first, _)| *first > 0) {
            compare(told, place, "times", (stated.message_start_time, stated.message_end_time), found);
        }
        let counts = self.messages.iter().enumerate().filter(|(_, count)| **count > 0);
        let counts: BTreeMap<u16, u64> =
            counts.filter_map(|(channel, count)| Some((u16::try_from(channel).ok()?, *count))).collect();
        let stated: BTreeMap<u16, u64> =
            stated.channel_message_counts.into_iter().filter(|(_, count)| *count > 0).collect();
        // Writers may leave them out.
        if !stated.is_empty() {
            compare(told, place, "messages by channel", stated, counts);
        }
        Ok(self.differences)
    }
}

/// Notes where what is stated is not what was found.
fn compare<T: PartialEq + Debug>(told: &mut Tally, place: impl Display, what: &str, stated: T, found: T) {
    if stated != found {
        let short = |value: &T| -> String { format!("{value:?}").chars().take(LONGEST_TOLD).collect() };
        told.add(|| format!("{place}{what} {} is stated, {} found", short(&stated), short(&found)));
    }
}
