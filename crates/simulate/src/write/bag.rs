//! ROS 1 bag, format 2.0.
//!
//! A bag is `#ROSBAG V2.0\n` and records: `u32` length of a header of `u32`-counted `name=value` fields, the header,
//! `u32` length of the data, the data. A chunk holds connections and messages. It is followed by an index for each
//! connection in it. At the end are all connections and a summary of each chunk; the first record points there.

use super::message::{Message, ros_time};
use super::{Logbook, Topic};
use crate::error::SimulateError;
use flight::Stamp;
use lz4_flex::frame::{BlockMode, BlockSize, FrameEncoder, FrameInfo};
use std::io::Write;

/// Options for writing a bag.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct BagSettings {
    /// Compression of the chunks.
    pub compression: BagCompression,
    /// Whether it was closed properly. Otherwise it has no index at its end and an index position of zero, as left by a
    /// killed recorder.
    pub indexed: bool,
}

/// Compression of the chunks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum BagCompression {
    /// Uncompressed.
    None,
    /// bzip2.
    Bz2,
    /// LZ4 frames with independent blocks.
    Lz4Independent,
    /// LZ4 frames whose blocks refer to previous ones, as `rosbag` writes.
    Lz4Linked,
}

impl Default for BagSettings {
    /// As `rosbag record` writes: uncompressed, indexed.
    fn default() -> BagSettings {
        BagSettings { compression: BagCompression::None, indexed: true }
    }
}

/// Uncompressed bytes of a chunk: small, so that short flights have several.
const CHUNK_BYTES: usize = 256 << 10;
/// Size of the first record including its two lengths, by convention of the format.
const BAG_HEADER_BYTES: usize = 4096;
const MAGIC: &[u8] = b"#ROSBAG V2.0\n";

const OP_MESSAGE: u8 = 2;
const OP_BAG_HEADER: u8 = 3;
const OP_INDEX: u8 = 4;
const OP_CHUNK: u8 = 5;
const OP_CHUNK_INFO: u8 = 6;
const OP_CONNECTION: u8 = 7;

pub(super) fn write(log: &Logbook, settings: BagSettings) -> Result<Vec<u8>, SimulateError> {
    let topics = &log.topics;
    let mut bag = Bag { settings, topics, bytes: MAGIC.to_vec(), known: vec![false; topics.len()], chunks: vec![] };
    bag.bytes.extend(bag_header(0, 0, 0));
    let mut chunk = Chunk::of(topics.len());
    for message in &log.messages {
        bag.add(&mut chunk, message);
        if chunk.bytes.len() > CHUNK_BYTES {
            bag.close(std::mem::replace(&mut chunk, Chunk::of(topics.len())))?;
        }
    }
    bag.close(chunk)?;
    Ok(bag.finish())
}

struct Bag<'a> {
    settings: BagSettings,
    topics: &'a [Topic],
    bytes: Vec<u8>,
    known: Vec<bool>,
    chunks: Vec<(u64, Chunk)>,
}

struct Chunk {
    bytes: Vec<u8>,
    /// Time and offset of each message, by connection.
    index: Vec<Vec<(Stamp, u32)>>,
}

impl Bag<'_> {
    /// Appends a message; the first one of a topic adds its connection.
    fn add(&mut self, chunk: &mut Chunk, message: &Message) {
        if !std::mem::replace(&mut self.known[message.topic], true) {
            chunk.bytes.extend(self.connection(message.topic));
        }
        chunk.index[message.topic].push((message.logged, chunk.bytes.len() as u32));
        let header = [
            ("op", &[OP_MESSAGE][..]),
            ("conn", &(message.topic as u32).to_le_bytes()),
            ("time", &ros_time(message.logged)),
        ];
        chunk.bytes.extend(record(&header, &message.ros1()));
    }

    fn close(&mut self, chunk: Chunk) -> Result<(), SimulateError> {
        if chunk.bytes.is_empty() {
            return Ok(());
        }
        let position = self.bytes.len() as u64;
        let (name, packed) = self.settings.compression.pack(&chunk.bytes)?;
        let size = (chunk.bytes.len() as u32).to_le_bytes();
        let header = [("op", &[OP_CHUNK][..]), ("compression", name.as_bytes()), ("size", &size)];
        self.bytes.extend(record(&header, &packed));
        self.bytes.extend(chunk.index_records());
        self.chunks.push((position, Chunk { bytes: vec![], ..chunk }));
        Ok(())
    }

    /// Connections and chunk summaries, then the first record again with its final numbers.
    fn finish(mut self) -> Vec<u8> {
        if !self.settings.indexed {
            return self.bytes;
        }
        let index_position = self.bytes.len() as u64;
        let connections: Vec<usize> = (0..self.topics.len()).filter(|&topic| self.known[topic]).collect();
        let again: Vec<u8> = connections.iter().flat_map(|&topic| self.connection(topic)).collect();
        self.bytes.extend(again);
        let summaries: Vec<u8> = self.chunks.iter().flat_map(|(position, chunk)| chunk.summary(*position)).collect();
        self.bytes.extend(summaries);
        let first = bag_header(index_position, connections.len() as u32, self.chunks.len() as u32);
        self.bytes[MAGIC.len()..MAGIC.len() + BAG_HEADER_BYTES].copy_from_slice(&first);
        self.bytes
    }

    fn connection(&self, index: usize) -> Vec<u8> {
        let Topic { name, definition } = &self.topics[index];
        let header =
            [("op", &[OP_CONNECTION][..]), ("conn", &(index as u32).to_le_bytes()), ("topic", name.as_bytes())];
        let (type_name, text) = (definition.ros1_name(), definition.ros1_text());
        let data = header_bytes(&[
            ("topic", name.as_bytes()),
            ("type", type_name.as_bytes()),
            ("md5sum", definition.md5.as_bytes()),
            ("message_definition", text.as_bytes()),
        ]);
        record(&header, &data)
    }
}

impl Chunk {
    fn of(topics: usize) -> Chunk {
        Chunk { bytes: vec![], index: vec![vec![]; topics] }
    }

    fn index_records(&self) -> Vec<u8> {
        let index_record = |(topic, entries): (usize, &Vec<(Stamp, u32)>)| {
            let (conn, count) = ((topic as u32).to_le_bytes(), (entries.len() as u32).to_le_bytes());
            let header = [("op", &[OP_INDEX][..]), ("ver", &1_u32.to_le_bytes()), ("conn", &conn), ("count", &count)];
            let data: Vec<u8> =
                entries.iter().flat_map(|(time, at)| [&ros_time(*time)[..], &at.to_le_bytes()].concat()).collect();
            record(&header, &data)
        };
        self.used().flat_map(index_record).collect()
    }

    fn summary(&self, position: u64) -> Vec<u8> {
        let times = || self.index.iter().flatten().map(|(time, _)| *time);
        let (first, last) = (times().min().unwrap_or(Stamp(0)), times().max().unwrap_or(Stamp(0)));
        let header = [
            ("op", &[OP_CHUNK_INFO][..]),
            ("ver", &1_u32.to_le_bytes()),
            ("chunk_pos", &position.to_le_bytes()),
            ("start_time", &ros_time(first)),
            ("end_time", &ros_time(last)),
            ("count", &(self.used().count() as u32).to_le_bytes()),
        ];
        let counts = self
            .used()
            .flat_map(|(topic, entries)| [(topic as u32).to_le_bytes(), (entries.len() as u32).to_le_bytes()].concat());
        record(&header, &counts.collect::<Vec<u8>>())
    }

    /// Connections with messages in this chunk.
    fn used(&self) -> impl Iterator<Item = (usize, &Vec<(Stamp, u32)>)> {
        self.index.iter().enumerate().filter(|(_, entries)| !entries.is_empty())
    }
}

impl BagCompression {
    fn pack(self, bytes: &[u8]) -> Result<(&'static str, Vec<u8>), SimulateError> {
        let failed = |what| move |source| SimulateError::Compress { what, source };
        Ok(match self {
            BagCompression::None => ("none", bytes.to_vec()),
            BagCompression::Bz2 => {
                let mut encoder = bzip2::write::BzEncoder::new(vec![], bzip2::Compression::best());
                encoder
                    .write_all(bytes)
                    .and_then(|()| encoder.finish())
                    .map(|packed| ("bz2", packed))
                    .map_err(failed("bzip2"))?
            }
            BagCompression::Lz4Independent => ("lz4", lz4(bytes, BlockMode::Independent).map_err(failed("LZ4"))?),
            BagCompression::Lz4Linked => ("lz4", lz4(bytes, BlockMode::Linked).map_err(failed("LZ4"))?),
        })
    }
}

/// A frame of 64 KiB blocks, so that a chunk has more than one, with a checksum of its content.
fn lz4(bytes: &[u8], mode: BlockMode) -> std::io::Result<Vec<u8>> {
    let frame = FrameInfo::new().block_mode(mode).block_size(BlockSize::Max64KB).content_checksum(true);
    let mut encoder = FrameEncoder::with_frame_info(frame, vec![]);
    encoder.write_all(bytes)?;
    Ok(encoder.finish()?)
}

fn bag_header(index_position: u64, connections: u32, chunks: u32) -> Vec<u8> {
    let fields = header_bytes(&[
        ("op", &[OP_BAG_HEADER][..]),
        ("index_pos", &index_position.to_le_bytes()),
        ("conn_count", &connections.to_le_bytes()),
        ("chunk_count", &chunks.to_le_bytes()),
    ]);
    let padding = vec![b' '; BAG_HEADER_BYTES - 8 - fields.len()];
    counted(&fields).chain(counted(&padding)).collect()
}

fn record(header: &[(&str, &[u8])], data: &[u8]) -> Vec<u8> {
    counted(&header_bytes(header)).chain(counted(data)).collect()
}

fn header_bytes(fields: &[(&str, &[u8])]) -> Vec<u8> {
    fields
        .iter()
        .flat_map(|(name, value)| counted(&[name.as_bytes(), b"=", value].concat()).collect::<Vec<u8>>())
        .collect()
}

/// The bytes after their length as `u32`.
fn counted(bytes: &[u8]) -> impl Iterator<Item = u8> {
    (bytes.len() as u32).to_le_bytes().into_iter().chain(bytes.iter().copied())
}
