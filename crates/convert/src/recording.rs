//! Writes an MCAP message by message, and keeps account of its contents.

use crate::error::ConvertError;
use flight::{Code, Notices};
use ingest::{Extra, OriginalTopic, TopicInfo};
use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, Compression, McapError, WriteOptions, Writer};
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};
use std::rc::Rc;

/// A count of items, and a sum over their bytes and times that does not depend on their order.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Tally {
    pub(crate) count: u64,
    sum: u64,
}

impl Tally {
    fn add(&mut self, parts: &[&[u8]]) {
        let mut hash = crc32fast::Hasher::new();
        parts.iter().for_each(|part| hash.update(part));
        self.count += 1;
        self.sum = self.sum.wrapping_add(u64::from(hash.finalize()));
    }
}

/// Contents of an MCAP, as written or as read back.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Content {
    /// Messages by topic.
    pub(crate) topics: BTreeMap<String, Tally>,
    /// Attachments and metadata by name, kind and size.
    pub(crate) extras: BTreeMap<String, Tally>,
    /// Metadata of topics other than their types.
    pub(crate) of_topics: BTreeMap<String, OfTopic>,
}

/// Texts by name, shared: a log may have tens of thousands of topics.
type OfTopic = Rc<BTreeMap<String, String>>;

impl Content {
    pub(crate) fn message(&mut self, topic: &str, logged_ns: u64, payload: &[u8]) {
        let parts: [&[u8]; 2] = [&logged_ns.to_le_bytes(), payload];
        match self.topics.get_mut(topic) {
            Some(tally) => tally.add(&parts),
            None => self.topics.entry(topic.to_owned()).or_default().add(&parts),
        }
    }

    pub(crate) fn extra(&mut self, extra: &Extra<'_>) {
        match extra {
            Extra::Attachment { name, media_type, logged_ns, created_ns, data } => {
                let what = format!("attachment {name} ({media_type}, {} bytes)", data.len());
                let tally = self.extras.entry(what).or_default();
                tally.add(&[&logged_ns.to_le_bytes(), &created_ns.to_le_bytes(), data]);
            }
            Extra::Metadata { name, entries } => {
                let texts = if entries.len() == 1 { "text" } else { "texts" };
                let what = format!("metadata {name} ({} {texts})", entries.len());
                // A zero byte between texts, so that different splits give different hashes.
                let parts = entries.iter().flat_map(|(key, text)| [key.as_bytes(), b"\0", text.as_bytes(), b"\0"]);
                self.extras.entry(what).or_default().add(&parts.collect::<Vec<&[u8]>>());
            }
            Extra::OfTopic { topic, entries } => self.of_topic(topic, &Rc::new((*entries).clone())),
        }
    }

    fn of_topic(&mut self, topic: &str, entries: &OfTopic) {
        if !entries.is_empty() && !self.of_topics.contains_key(topic) {
            self.of_topics.insert(topic.to_owned(), Rc::clone(entries));
        }
    }
}

/// A chunk ends when its definitions exceed this: one chunk would otherwise hold those of tens of thousands of topics.
const MOST_DEFINED: usize = 4 << 20;

/// A message to write.
pub(crate) struct Entry<'m> {
    pub(crate) topic: &'m TopicInfo,
    /// The original topic, in a log whose messages are rewritten.
    pub(crate) original: Option<&'m OriginalTopic>,
    /// Encoding of the messages as MCAP calls it.
    pub(crate) encoding: &'m str,
    pub(crate) schema_encoding: &'m str,
    pub(crate) schema: &'m [u8],
    pub(crate) logged_ns: i64,
    pub(crate) published_ns: Option<i64>,
    /// Position in its log; counted if absent.
    pub(crate) sequence: Option<u32>,
    pub(crate) payload: &'m [u8],
}

struct Channel {
    original: Option<OriginalTopic>,
    schema_encoding: String,
    schema: Rc<[u8]>,
    id: u16,
    sequence: u32,
}

/// The file being written.
pub(crate) struct Recording {
    path: PathBuf,
    writer: Writer<BufWriter<File>>,
    channels: HashMap<TopicInfo, Vec<Channel>>,
    /// Channel metadata, by topic.
    of_topics: HashMap<String, OfTopic>,
    /// Shared, because many topics may have the same definition.
    schemas: HashSet<Rc<[u8]>>,
    /// Bytes of definitions in the current chunk, which the writer does not count.
    defined: usize,
    pub(crate) content: Content,
    /// Topics with contradictory statements in the log: the first is kept.
    pub(crate) several: BTreeSet<String>,
    /// Timestamps before 1970, which MCAP cannot represent: written as 0.
    before_epoch: u64,
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
            of_topics: HashMap::new(),
            schemas: HashSet::new(),
            defined: 0,
            content: Content::default(),
            several: BTreeSet::new(),
            before_epoch: 0,
        })
    }

    pub(crate) fn write(&mut self, entry: &Entry<'_>) -> Result<(), ConvertError> {
        let logged = u64::try_from(entry.logged_ns).unwrap_or_else(|_| {
            self.before_epoch += 1;
            0
        });
        let published = entry.published_ns.map_or(logged, |t| u64::try_from(t).unwrap_or_default());
        let (channel_id, counted) = self.channel(entry)?;
        let sequence = entry.sequence.unwrap_or(counted);
        let header = MessageHeader { channel_id, sequence, log_time: logged, publish_time: published };
        self.writer.write_to_known_channel(&header, entry.payload).map_err(failed(&self.path))?;
        self.content.message(&entry.topic.name, logged, entry.payload);
        Ok(())
    }

    /// Registers a topic that may have no messages.
    pub(crate) fn announce(&mut self, entry: &Entry<'_>) -> Result<(), ConvertError> {
        self.channel(entry).map(drop)
    }

    /// The channel of a message and its next sequence number, from 1.
    fn channel(&mut self, entry: &Entry<'_>) -> Result<(u16, u32), ConvertError> {
        let known = self.channels.get_mut(entry.topic);
        let same = |c: &&mut Channel| {
            c.original.as_ref() == entry.original
                && c.schema_encoding == entry.schema_encoding
                && *c.schema == *entry.schema
        };
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
        let mut entries = self.of_topics.get(name).cloned().unwrap_or_default();
        if let Some(original) = entry.original {
            Rc::make_mut(&mut entries).extend(original.entries());
        }
        let id = self.writer.add_channel(schema, name, entry.encoding, &entries).map_err(failed(&self.path))?;
        self.content.of_topic(name, &entries);
        let schema = self.schema(entry.schema);
        let channel = Channel {
            original: entry.original.cloned(),
            schema_encoding: entry.schema_encoding.to_owned(),
            schema,
            id,
            sequence: 1,
        };
        self.channels.entry(entry.topic.clone()).or_default().push(channel);
        self.defined += entry.schema.len() + entry.topic.name.len();
        if self.defined > MOST_DEFINED {
            self.defined = 0;
            self.writer.flush().map_err(failed(&self.path))?;
        }
        Ok((id, 1))
    }

    fn schema(&mut self, text: &[u8]) -> Rc<[u8]> {
        if let Some(known) = self.schemas.get(text) {
            return Rc::clone(known);
        }
        let schema: Rc<[u8]> = text.into();
        self.schemas.insert(Rc::clone(&schema));
        schema
    }

    /// Writes an attachment or metadata record.
    pub(crate) fn extra(&mut self, extra: &Extra<'_>) -> Result<(), ConvertError> {
        let written = match *extra {
            Extra::Attachment { name, media_type, logged_ns, created_ns, data } => self.writer.attach(&Attachment {
                log_time: logged_ns,
                create_time: created_ns,
                name: name.to_owned(),
                media_type: media_type.to_owned(),
                data: Cow::Borrowed(data),
            }),
            Extra::Metadata { name, entries } => {
                self.writer.write_metadata(&Metadata { name: name.to_owned(), metadata: entries.clone() })
            }
            Extra::OfTopic { topic, entries } => {
                self.of_topic(topic, entries);
                return Ok(());
            }
        };
        self.content.extra(extra);
        written.map_err(failed(&self.path))
    }

    fn of_topic(&mut self, topic: &str, entries: &BTreeMap<String, String>) {
        match self.of_topics.get(topic) {
            Some(known) if **known != *entries => _ = self.several.insert(topic.to_owned()),
            Some(_) => {}
            None => _ = self.of_topics.insert(topic.to_owned(), Rc::new(entries.clone())),
        }
    }

    /// Reports that timestamps before 1970 were written as 0.
    pub(crate) fn note_before_epoch(&self, notices: &mut Notices) {
        if self.before_epoch > 0 {
            let text = "messages were logged before 1970, which MCAP cannot represent: their log time was set to 0";
            notices.push(Code::UnreliableStamps, "", self.before_epoch, text);
        }
    }

    /// Frees the state of a topic that has no more messages.
    pub(crate) fn forget(&mut self, topic: &TopicInfo) {
        self.channels.remove(topic);
        self.of_topics.remove(&topic.name);
        self.content.topics.remove(&topic.name);
        self.content.of_topics.remove(&topic.name);
        self.schemas.clear();
    }

    /// Writes metadata about the whole file, which may be long.
    pub(crate) fn metadata(&mut self, name: &str, metadata: BTreeMap<String, String>) -> Result<(), ConvertError> {
        let metadata = Metadata { name: name.to_owned(), metadata };
        self.writer.write_metadata(&metadata).map_err(failed(&self.path))
    }

    /// Finishes the file; returns its contents.
    pub(crate) fn end(mut self) -> Result<Content, ConvertError> {
        self.writer.finish().map_err(failed(&self.path))?;
        let path = self.path;
        self.writer.into_inner().into_inner().map(drop).map_err(|e| ConvertError::Write {
            path,
            doing: "write",
            source: e.into_error(),
        })?;
        Ok(self.content)
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

#[cfg(test)]
mod tests {
    use super::*;

    fn entry<'m>(topic: &'m TopicInfo, schema: &'m [u8], logged_ns: i64) -> Entry<'m> {
        Entry {
            topic,
            original: None,
            encoding: "cdr",
            schema_encoding: "ros2msg",
            schema,
            logged_ns,
            published_ns: None,
            sequence: None,
            payload: b"payload",
        }
    }

    /// The bytes of a recording.
    fn written(work: impl FnOnce(&mut Recording)) -> Vec<u8> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        let mut recording = Recording::begin(&path, File::create(&path).unwrap(), "").unwrap();
        work(&mut recording);
        recording.end().unwrap();
        std::fs::read(path).unwrap()
    }

    #[test]
    fn a_chunk_ends_only_when_its_definitions_are_long() {
        let chunks = |topics: u8| {
            let bytes = written(|recording| {
                for number in 0..topics {
                    let topic = TopicInfo { name: format!("t{number}"), ..TopicInfo::default() };
                    recording.announce(&entry(&topic, &vec![number; 1 << 20], 1)).unwrap();
                }
            });
            let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
            assert_eq!(summary.channels.len(), usize::from(topics));
            summary.chunk_indexes.len()
        };
        // The fourth definition exceeds 4 MiB with the names of the topics.
        assert_eq!([2, 5].map(chunks), [1, 2]);
    }

    #[test]
    fn messages_of_a_channel_are_counted_unless_they_have_a_number() {
        let topics = ["a", "b"].map(|name| TopicInfo { name: name.to_owned(), ..TopicInfo::default() });
        let mut notices = Notices::new();
        let bytes = written(|recording| {
            for (topic, sequence, logged_ns) in
                [(0, None, 5), (1, None, 6), (0, None, -7), (0, Some(70), 8), (1, None, 9)]
            {
                let entry = Entry {
                    sequence,
                    published_ns: Some(4),
                    schema_encoding: "",
                    ..entry(&topics[topic], b"", logged_ns)
                };
                recording.write(&entry).unwrap();
            }
            recording.note_before_epoch(&mut notices);
        });
        let messages = mcap::MessageStream::new(&bytes).unwrap().map(|message| {
            let message = message.unwrap();
            assert!(message.channel.schema.is_none() && message.publish_time == 4);
            (message.channel.topic.clone(), message.sequence, message.log_time)
        });
        let expected = [("a", 1, 5), ("b", 1, 6), ("a", 2, 0), ("a", 70, 8), ("b", 2, 9)];
        assert_eq!(
            messages.collect::<Vec<_>>(),
            expected.map(|(topic, sequence, at)| (topic.to_owned(), sequence, at))
        );
        assert_eq!(notices.iter().map(|n| n.count).collect::<Vec<_>>(), [1], "one message is from before 1970");
    }
}
