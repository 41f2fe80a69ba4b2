//! MCAP, using the `mcap` crate: CRCs of chunks, data and summary are written.

use super::camera::is_heavy;
use super::message::Message;
use super::{Logbook, Topic, idl, protobuf};
use crate::error::SimulateError;
use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions, Writer};
use std::collections::BTreeMap;
use std::io::Cursor;

/// Options for writing an MCAP file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct McapSettings {
    /// Encoding of messages and schemas.
    pub encoding: McapEncoding,
    /// Compression of the chunks.
    pub compression: McapCompression,
    /// Whether there is a summary section, as written by a properly closed recorder.
    pub summary: bool,
}

/// Encoding of messages and schemas.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum McapEncoding {
    /// ROS 1: messages `ros1`, schemas `ros1msg`.
    Ros1,
    /// ROS 2: messages `cdr`, schemas `ros2msg`.
    Cdr,
    /// ROS 2: messages `cdr`, schemas `ros2idl`.
    Idl,
    /// Messages `json`, schemas `jsonschema`.
    Json,
    /// Messages and schemas `protobuf`.
    Protobuf,
}

/// Packing of messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum McapCompression {
    /// Uncompressed chunks.
    None,
    /// LZ4 frames.
    #[cfg(feature = "every-format")]
    Lz4,
    /// Zstandard.
    Zstd,
    /// No chunks: messages are directly in the data section.
    Unchunked,
}

impl Default for McapSettings {
    /// As a ROS 2 recorder writes: CDR, zstd, with summary.
    fn default() -> McapSettings {
        McapSettings { encoding: McapEncoding::Cdr, compression: McapCompression::Zstd, summary: true }
    }
}

/// Uncompressed bytes of a chunk: small, so that short flights have several.
const CHUNK_BYTES: u64 = 256 << 10;

pub(super) fn write(log: &Logbook, settings: McapSettings) -> Result<Vec<u8>, SimulateError> {
    write_groups(log, settings, settings.options(), &[log.messages.iter().collect()])
}

/// Heavy topics in chunks of their own, and no checksum over the data section.
pub(super) fn write_apart(log: &Logbook, settings: McapSettings) -> Result<Vec<u8>, SimulateError> {
    write_groups(log, settings, settings.options().calculate_data_section_crc(false), &apart(log))
}

/// Messages in groups that are either heavy or not, each about the size of a chunk.
fn apart(log: &Logbook) -> Vec<Vec<&Message>> {
    let (mut groups, mut open) = (vec![], [(2000, vec![]), (5, vec![])]);
    for message in &log.messages {
        let (most, group) = &mut open[usize::from(is_heavy(&log.topics[message.topic]))];
        group.push(message);
        if group.len() == *most {
            groups.push(std::mem::take(group));
        }
    }
    groups.extend(open.map(|(_, group)| group));
    groups
}

/// A chunk ends at the latest with its group.
fn write_groups(
    log: &Logbook,
    settings: McapSettings,
    options: WriteOptions,
    groups: &[Vec<&Message>],
) -> Result<Vec<u8>, SimulateError> {
    let mut writer = options.create(Cursor::new(vec![]))?;
    let channels = settings.add_channels(log, &mut writer)?;
    for group in groups {
        write_messages(group, settings, &channels, &mut writer)?;
        writer.flush()?;
    }
    writer.finish()?;
    Ok(writer.into_inner().into_inner())
}

fn write_messages(
    messages: &[&Message],
    settings: McapSettings,
    channels: &[u16],
    writer: &mut Writer<Cursor<Vec<u8>>>,
) -> Result<(), SimulateError> {
    for message in messages {
        let time_ns = u64::try_from(message.logged.0).unwrap_or(0);
        let header = MessageHeader {
            channel_id: channels[message.topic],
            sequence: message.sequence,
            log_time: time_ns,
            // As in ROS recorders, which do not know any other time of the message.
            publish_time: time_ns,
        };
        writer.write_to_known_channel(&header, &settings.encoding.payload(message)?)?;
    }
    Ok(())
}

impl McapSettings {
    fn options(self) -> WriteOptions {
        WriteOptions::new()
            .library("flightlag simulate")
            .profile(self.encoding.profile())
            .compression(self.compression.algorithm())
            .use_chunks(self.compression != McapCompression::Unchunked)
            .chunk_size(Some(CHUNK_BYTES))
            // More threads would split the frames elsewhere and give different bytes on another machine.
            .compression_threads(0)
            .emit_summary_records(self.summary)
            .emit_summary_offsets(self.summary)
            .emit_message_indexes(self.summary)
    }

    fn add_channels(self, log: &Logbook, writer: &mut Writer<Cursor<Vec<u8>>>) -> Result<Vec<u16>, SimulateError> {
        let none = BTreeMap::new();
        let mut channels = vec![];
        for (index, Topic { name: topic, definition }) in log.topics.iter().enumerate() {
            let example = log.messages.iter().find(|message| message.topic == index);
            let (name, encoding, text) = match self.encoding {
                McapEncoding::Ros1 => (definition.ros1_name(), "ros1msg", definition.ros1_text().into_bytes()),
                McapEncoding::Cdr => (definition.ros2_name(), "ros2msg", definition.ros2_text().into_bytes()),
                McapEncoding::Idl => (definition.ros2_name(), "ros2idl", idl::text(definition).into_bytes()),
                McapEncoding::Json => (definition.ros1_name(), "jsonschema", br#"{"type":"object"}"#.to_vec()),
                McapEncoding::Protobuf => {
                    let set = protobuf::descriptor(definition, example);
                    (protobuf::type_name(definition), "protobuf", set)
                }
            };
            let schema = writer.add_schema(&name, encoding, &text)?;
            channels.push(writer.add_channel(schema, topic, self.encoding.name(), &none)?);
        }
        Ok(channels)
    }
}

impl McapEncoding {
    fn name(self) -> &'static str {
        match self {
            McapEncoding::Ros1 => "ros1",
            McapEncoding::Cdr | McapEncoding::Idl => "cdr",
            McapEncoding::Json => "json",
            McapEncoding::Protobuf => "protobuf",
        }
    }

    fn profile(self) -> &'static str {
        match self {
            McapEncoding::Ros1 => "ros1",
            McapEncoding::Cdr | McapEncoding::Idl => "ros2",
            McapEncoding::Json | McapEncoding::Protobuf => "",
        }
    }

    fn payload(self, message: &Message) -> Result<Vec<u8>, SimulateError> {
        match self {
            McapEncoding::Ros1 => Ok(message.ros1()),
            McapEncoding::Cdr | McapEncoding::Idl => Ok(message.cdr()),
            McapEncoding::Json => message.json(),
            McapEncoding::Protobuf => Ok(protobuf::payload(message)),
        }
    }
}

impl McapCompression {
    fn algorithm(self) -> Option<Compression> {
        match self {
            McapCompression::None | McapCompression::Unchunked => None,
            #[cfg(feature = "every-format")]
            McapCompression::Lz4 => Some(Compression::Lz4),
            McapCompression::Zstd => Some(Compression::Zstd),
        }
    }
}
