//! An MCAP that is written message by message, and what was put into it.

use crate::error::ConvertError;
use ingest::TopicInfo;
use mcap::records::{MessageHeader, Metadata};
use mcap::{Compression, McapError, WriteOptions, Writer};
use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};

/// Messages of a topic, and a sum over their bytes and times that does not depend on their order.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Tally {
    pub(crate) messages: u64,
    sum: u64,
}

impl Tally {
    pub(crate) fn add(&mut self, logged_ns: u64, payload: &[u8]) {
        let mut hash = crc32fast::Hasher::new();
        hash.update(&logged_ns.to_le_bytes());
        hash.update(payload);
        self.messages += 1;
        self.sum = self.sum.wrapping_add(u64::from(hash.finalize()));
    }
}

/// A message to write.
pub(crate) struct Entry<'m> {
    pub(crate) topic: &'m TopicInfo,
    /// Encoding of the messages as MCAP calls it.
    pub(crate) encoding: &'m str,
    pub(crate) schema_encoding: &'m str,
    pub(crate) schema: &'m [u8],
    pub(crate) logged_ns: i64,
    pub(crate) published_ns: Option<i64>,
    pub(crate) payload: &'m [u8],
}

struct Channel {
    schema_encoding: String,
    schema: Vec<u8>,
    id: u16,
    sequence: u32,
}

/// The file under way.
pub(crate) struct Recording {
    path: PathBuf,
    writer: Writer<BufWriter<File>>,
    channels: HashMap<TopicInfo, Vec<Channel>>,
    pub(crate) tallies: BTreeMap<String, Tally>,
    /// Stamps before 1970, which MCAP does not know: written as 0.
    pub(crate) before_epoch: u64,
}

impl Recording {
    pub(crate) fn begin(path: &Path, file: File, profile: &str) -> Result<Recording, ConvertError> {
        let options = WriteOptions::new()
            .library(concat!("flightlag ", env!("CARGO_PKG_VERSION")))
            .profile(profile)
            .compression(Some(Compression::Zstd));
        let writer = options.create(BufWriter::new(file)).map_err(failed(path))?;
        Ok(Recording {
            path: path.to_owned(),
            writer,
            channels: HashMap::new(),
            tallies: BTreeMap::new(),
            before_epoch: 0,
        })
    }

    pub(crate) fn write(&mut self, entry: &Entry<'_>) -> Result<(), ConvertError> {
        let logged = u64::try_from(entry.logged_ns).unwrap_or_else(|_| {
            self.before_epoch += 1;
            0
        });
        let published = entry.published_ns.map_or(logged, |t| u64::try_from(t).unwrap_or_default());
        let (channel_id, sequence) = self.channel(entry)?;
        let header = MessageHeader { channel_id, sequence, log_time: logged, publish_time: published };
        self.writer.write_to_known_channel(&header, entry.payload).map_err(failed(&self.path))?;
        match self.tallies.get_mut(&entry.topic.name) {
            Some(tally) => tally.add(logged, entry.payload),
            None => self.tallies.entry(entry.topic.name.clone()).or_default().add(logged, entry.payload),
        }
        Ok(())
    }

    /// The channel of a message and its next sequence number.
    fn channel(&mut self, entry: &Entry<'_>) -> Result<(u16, u32), ConvertError> {
        let known = self.channels.get_mut(entry.topic);
        let same = |c: &&mut Channel| c.schema_encoding == entry.schema_encoding && c.schema == entry.schema;
        if let Some(channel) = known.and_then(|all| all.iter_mut().find(same)) {
            channel.sequence = channel.sequence.wrapping_add(1);
            return Ok((channel.id, channel.sequence));
        }
        let TopicInfo { name, type_name, .. } = entry.topic;
        let schema = if entry.schema_encoding.is_empty() && entry.schema.is_empty() {
            0
        } else {
            self.writer.add_schema(type_name, entry.schema_encoding, entry.schema).map_err(failed(&self.path))?
        };
        let id = self.writer.add_channel(schema, name, entry.encoding, &BTreeMap::new()).map_err(failed(&self.path))?;
        let channel = Channel {
            schema_encoding: entry.schema_encoding.to_owned(),
            schema: entry.schema.to_vec(),
            id,
            sequence: 0,
        };
        self.channels.entry(entry.topic.clone()).or_default().push(channel);
        Ok((id, 0))
    }

    /// A named set of texts beside the messages.
    pub(crate) fn note(&mut self, name: &str, texts: BTreeMap<String, String>) -> Result<(), ConvertError> {
        self.writer.write_metadata(&Metadata { name: name.to_owned(), metadata: texts }).map_err(failed(&self.path))
    }

    /// Ends the file; what it holds.
    pub(crate) fn end(mut self) -> Result<BTreeMap<String, Tally>, ConvertError> {
        self.writer.finish().map_err(failed(&self.path))?;
        let path = self.path;
        self.writer.into_inner().into_inner().map(drop).map_err(|e| ConvertError::Write {
            path,
            doing: "write",
            source: e.into_error(),
        })?;
        Ok(self.tallies)
    }
}

fn failed(path: &Path) -> impl FnOnce(McapError) -> ConvertError {
    let path = path.to_owned();
    move |e| {
        let source = match e {
            McapError::Io(source) => source,
            other => io::Error::other(other.to_string()),
        };
        ConvertError::Write { path, doing: "write", source }
    }
}
