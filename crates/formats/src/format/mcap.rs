//! MCAP (<https://mcap.dev/spec>), streamed: memory for one chunk, every checksum checked.
//!
//! The `mcap` crate reads single records. Framing, chunks and recovery are ours (`records`), because the
//! crate's own readers trust the lengths stated by a damaged file.

mod mcap_record;
mod mcap_records;
mod original;
mod summary;

pub use self::original::{OriginalLog, OriginalTopic};

use self::mcap_record::{AttachmentHead, WRONG_START};
use self::mcap_records::Records;
use self::original::Originals;
use self::summary::{Summary, Trust};
use crate::bytes::Bytes;
use crate::decode::{Definition, NAMED, Route, Tally, Times, Topics};
use crate::error::LogError;
use crate::format::bag_folder::{self, Metadata};
use crate::format::inflate::{Inflater, is_packed};
use crate::format::{Reading, compare_count, report_broken, report_unplaced};
use crate::reader::{Extra, Log, ReadContext, Select};
use crate::table::TopicInfo;
use flight::{Code, Notices};
use logscan::{Fate, LogFile, Source, scan};
use mcap::records::{MessageIndex, Record, op};
use std::collections::HashMap;
use std::path::PathBuf;

/// Maximum memory for the definitions and channels of a file, bytes.
const MOST_DEFINITIONS: usize = 64 << 20;
/// Maximum definitions and channels of one file that replace others.
const MOST_REDEFINED: u64 = 1000;
/// Maximum attachments and metadata listed by name.
const MOST_EXTRAS: usize = 100;
/// Channel, sequence and two timestamps: the part of a message before its payload.
const MESSAGE_HEAD_BYTES: usize = 22;

/// Reads one MCAP file, or several that make up one flight.
pub(crate) fn read(files: &[PathBuf], want: &dyn Select, context: &ReadContext<'_>) -> Result<Log, LogError> {
    let (metadata, rest) = Metadata::split_off(files)?;
    let mut files = files.iter().map(|path| LogFile::open(path)).collect::<Result<Vec<_>, _>>()?;
    let Reading { name, mut ledger, mut notices, mut topics } = Reading::begin(&files, want, context);
    files.retain(|file| metadata.is_none() || file.name() != bag_folder::NAME);
    ledger.count(Fate::Structure, metadata.as_ref().map_or(0, |metadata| metadata.bytes));
    let mut log = Log::default();
    let mut headers = vec![];
    let mut extras = Extras::default();
    let mut originals = Originals::default();
    let several = files.len() > 1;
    for file in &mut files {
        let size = file.size();
        let refused = super::refuse_foreign(file, WRONG_START, context);
        if !several {
            refused?;
        } else if super::is_foreign_part(refused, size, &mut ledger, &mut notices)? {
            continue;
        }
        let mut channels = Channels::new(&mut topics, &mut extras, &mut originals, context.limits.chunk_bytes);
        let summary = Summary::read(file, context.limits.record_bytes, &mut channels)?;
        let mut records = Records::new(file, context, &mut notices, &mut channels, summary);
        scan(file, &mut ledger, context, &mut records)?;
        records.finish();
        log.health.undecodable += channels.unplaced.count + channels.broken.count;
        headers.push(channels.header);
    }
    log.health.format = format_name(&headers);
    log.health.extras = extras.finish();
    let mut log = Reading { name, ledger, notices, topics }.conclude(log)?;
    originals.restore(want, &mut log);
    match metadata {
        Some(metadata) => metadata.compare(&rest, &mut log),
        None => bag_folder::report_gaps(&rest, &mut log.notices),
    }
    Ok(log)
}

/// `MCAP`, with what the header says about its writer.
fn format_name(headers: &[String]) -> String {
    match headers.iter().find(|h| !h.is_empty()) {
        Some(header) => format!("MCAP ({header})"),
        None => "MCAP".to_owned(),
    }
}

/// Names of the entries in a file other than messages.
#[derive(Debug, Default)]
struct Extras {
    listed: Vec<String>,
    unlisted: u64,
}

impl Extras {
    fn add(&mut self, extra: String) {
        if self.listed.len() < MOST_EXTRAS { self.listed.push(extra) } else { self.unlisted += 1 }
    }

    fn finish(mut self) -> Vec<String> {
        if self.unlisted > 0 {
            self.listed.push(format!("and {} more", self.unlisted));
        }
        self.listed
    }
}

struct StoredSchema {
    name: String,
    encoding: String,
    text: Vec<u8>,
}

/// The relevant part of a channel: other metadata are not kept.
#[derive(PartialEq, Eq)]
struct Channel {
    topic: String,
    schema_id: u16,
    encoding: String,
    /// The MD5 sum by which ROS 1 identifies its type.
    md5sum: Option<String>,
    /// How its topic is to be read.
    original: Option<OriginalTopic>,
}

impl Channel {
    fn info(&self, schema: Option<&StoredSchema>) -> TopicInfo {
        let name = self.topic.clone();
        match &self.original {
            Some(OriginalTopic { type_name, encoding, .. }) => {
                TopicInfo { name, type_name: type_name.clone(), encoding: encoding.clone() }
            }
            None => {
                let type_name = schema.map(|s| s.name.clone()).unwrap_or_default();
                TopicInfo { name, type_name, encoding: self.encoding.clone() }
            }
        }
    }

    /// Bytes.
    fn weight(&self) -> usize {
        let original = self.original.as_ref().map_or(0, |o| o.type_name.len() + o.encoding.len());
        self.topic.len() + self.encoding.len() + self.md5sum.as_ref().map_or(0, String::len) + original
    }

    fn definition<'s>(&self, schema: &'s StoredSchema) -> Definition<'s> {
        let named = self.original.is_some() && (self.encoding.as_str(), schema.encoding.as_str()) == ("cdr", "ros2msg");
        Definition { encoding: if named { NAMED } else { &schema.encoding }, text: &schema.text }
    }
}

/// Where the messages of a channel go, as far as known.
#[derive(Clone, Copy)]
enum Way {
    Unknown,
    /// Its channel record was read; its schema is looked up with the first message.
    Announced,
    Open(Route, Stamped),
    /// Its topic cannot be taken. Kept because looking up a long name again for each message is expensive.
    Refused,
}

/// The source of a message's log timestamp.
#[derive(Clone, Copy)]
enum Stamped {
    AsLogged,
    /// The publish time, in a recovered log: its log time continues where the log's own clock restarted. The number
    /// is that of the original topic.
    AsPublished(usize),
}

/// Channels and schemas of one file; routes messages to the topics.
struct Channels<'t, 'w> {
    topics: &'t mut Topics<'w>,
    extras: &'t mut Extras,
    originals: &'t mut Originals,
    schemas: HashMap<u16, StoredSchema>,
    channels: HashMap<u16, Channel>,
    /// Size of all schemas and channels so far, bytes.
    definition_bytes: usize,
    ways: Vec<Way>,
    header: String,
    found: u64,
    unplaced: Tally,
    inflater: Inflater,
    /// Maximum decompressed size of an individually compressed message, bytes.
    most: u64,
    /// Messages whose own compression is corrupt.
    broken: Tally,
    /// Why a known channel has no topic.
    refusal: Option<String>,
    redefined: Tally,
    /// Wanted attachments that exceed the maximum record length.
    too_long: Tally,
    late_stamps: u64,
}

impl<'t, 'w> Channels<'t, 'w> {
    fn new(
        topics: &'t mut Topics<'w>,
        extras: &'t mut Extras,
        originals: &'t mut Originals,
        most: u64,
    ) -> Channels<'t, 'w> {
        Channels {
            topics,
            extras,
            originals,
            schemas: HashMap::new(),
            channels: HashMap::new(),
            definition_bytes: 0,
            ways: vec![],
            header: String::new(),
            found: 0,
            unplaced: Tally::default(),
            inflater: Inflater::default(),
            most,
            broken: Tally::default(),
            refusal: None,
            redefined: Tally::default(),
            too_long: Tally::default(),
            late_stamps: 0,
        }
    }

    fn message(&mut self, body: &[u8]) -> Result<Fate, String> {
        let Some((head, payload)) = body.split_at_checked(MESSAGE_HEAD_BYTES) else {
            return Err("a message is shorter than its own header".to_owned());
        };
        let mut head = Bytes(head);
        let (Some(channel), Some(sequence), Some(logged), Some(published)) =
            (head.u16(), head.u32(), head.u64(), head.u64())
        else {
            return Err("a message is shorter than its own header".to_owned());
        };
        self.found += 1;
        let Some((route, stamped)) = self.way(channel) else {
            let why = self.refusal.as_deref().unwrap_or("which no record defines");
            self.unplaced.add(|| format!("channel {channel}, {why}"));
            return Ok(Fate::Skipped);
        };
        let original = match stamped {
            Stamped::AsLogged => {
                let times = Times { logged_ns: self.stamp(logged), published_ns: Some(self.stamp(published)) };
                if route.is_wanted() && self.is_packed(channel, payload) {
                    return Ok(self.packed(route, times, sequence, payload));
                }
                return Ok(self.topics.numbered(route, times, Some(sequence), payload));
            }
            Stamped::AsPublished(original) => original,
        };
        let times = Times { logged_ns: self.stamp(published), published_ns: None };
        let fate = self.topics.message(route, times, payload);
        if fate == Fate::Decoded {
            self.originals.row(original, sequence);
        }
        Ok(fate)
    }

    fn is_packed(&self, channel: u16, payload: &[u8]) -> bool {
        is_packed(payload) && self.channels.get(&channel).is_some_and(|channel| channel.encoding == "cdr")
    }

    /// A message that rosbag2 compressed individually.
    fn packed(&mut self, route: Route, times: Times, sequence: u32, payload: &[u8]) -> Fate {
        match self.inflater.message(payload, self.most) {
            Ok(plain) => self.topics.numbered(route, times, Some(sequence), plain),
            Err(why) => {
                self.broken.add(|| why);
                self.topics.unread(route, times, payload.len() as u64)
            }
        }
    }

    /// Unsigned nanoseconds reach the year 2554, ours 2262.
    fn stamp(&mut self, nanos: u64) -> i64 {
        i64::try_from(nanos).unwrap_or_else(|_| {
            self.late_stamps += 1;
            i64::MAX
        })
    }

    fn route(&mut self, channel: u16) -> Option<Route> {
        self.way(channel).map(|(route, _)| route)
    }

    fn way(&mut self, channel: u16) -> Option<(Route, Stamped)> {
        match self.ways.get(usize::from(channel)) {
            Some(Way::Open(route, stamped)) => Some((*route, *stamped)),
            Some(Way::Announced) => self.open(channel),
            Some(Way::Unknown | Way::Refused) | None => None,
        }
    }

    /// Looks up the channel's schema and what is wanted of its topic.
    fn open(&mut self, id: u16) -> Option<(Route, Stamped)> {
        let channel = self.channels.get(&id)?;
        let schema = self.schemas.get(&channel.schema_id);
        let info = channel.info(schema);
        let definition = schema.map(|schema| channel.definition(schema));
        let route = self.topics.route_with_sum(info.clone(), definition, channel.md5sum.as_deref());
        let way = route.and_then(|route| Ok((route, self.originals.topic(info, channel.original.as_ref())?)));
        match way {
            Ok((route, original)) => {
                let stamped = original.map_or(Stamped::AsLogged, Stamped::AsPublished);
                self.set_way(id, Way::Open(route, stamped));
                Some((route, stamped))
            }
            Err(refusal) => {
                self.refusal.get_or_insert(refusal);
                self.set_way(id, Way::Refused);
                None
            }
        }
    }

    fn set_way(&mut self, id: u16, way: Way) {
        let id = usize::from(id);
        if self.ways.len() <= id {
            self.ways.resize(id + 1, Way::Unknown);
        }
        if let Some(place) = self.ways.get_mut(id) {
            *place = way;
        }
    }

    fn announce(&mut self, id: u16, channel: Channel) -> Result<(), String> {
        let known = self.channels.get(&id);
        if known == Some(&channel) {
            return Ok(());
        }
        if known.is_some() {
            self.redefined.add(|| format!("channel {id}, {:.200}", channel.topic));
            // If there is no room for the new channel, its messages must not go to the old one.
            self.channels.remove(&id);
            self.set_way(id, Way::Unknown);
        }
        self.make_room(channel.weight())?;
        self.channels.insert(id, channel);
        self.set_way(id, Way::Announced);
        Ok(())
    }

    fn make_room(&mut self, bytes: usize) -> Result<(), String> {
        self.definition_bytes += bytes;
        if self.definition_bytes > MOST_DEFINITIONS {
            return Err(format!("the definitions of this file are longer than {MOST_DEFINITIONS} bytes in total"));
        }
        if self.redefined.count > MOST_REDEFINED {
            return Err(format!("more than {MOST_REDEFINED} definitions of this file replace others"));
        }
        Ok(())
    }

    fn store(&mut self, id: u16, schema: StoredSchema) -> Result<(), String> {
        if let Some(known) = self.schemas.get(&id) {
            if known.name == schema.name && known.encoding == schema.encoding && known.text == schema.text {
                return Ok(());
            }
            self.redefined.add(|| format!("schema {id}, {:.200}", schema.name));
            self.schemas.remove(&id);
            self.reopen(id);
        }
        self.make_room(schema.text.len() + schema.name.len())?;
        self.schemas.insert(id, schema);
        Ok(())
    }

    /// Makes the channels of this schema look it up again.
    fn reopen(&mut self, schema: u16) {
        let affected: Vec<u16> =
            self.channels.iter().filter(|(_, c)| c.schema_id == schema).map(|(id, _)| *id).collect();
        for id in affected {
            self.set_way(id, Way::Announced);
        }
    }

    fn other(&mut self, opcode: u8, body: &[u8]) -> Result<Fate, String> {
        let unreadable = |e| format!("a {} that cannot be read: {e}", mcap_record::name(opcode));
        match mcap_record::parse(opcode, body).map_err(unreadable)? {
            Record::Header(header) => {
                let parts = [header.profile, header.library];
                let parts: Vec<String> = parts.iter().filter(|p| !p.is_empty()).map(|p| format!("{p:.100}")).collect();
                self.header = parts.join(", ");
            }
            Record::Schema { header, data } => {
                let schema = StoredSchema { name: header.name, encoding: header.encoding, text: data.into_owned() };
                self.store(header.id, schema)?;
            }
            Record::Channel(channel) => {
                let mcap::records::Channel { id, schema_id, topic, message_encoding: encoding, metadata } = channel;
                self.topics.extra(&Extra::OfTopic { topic: &topic, entries: &metadata });
                // Receivers of raw messages get them unconverted here.
                let original = OriginalTopic::of(&metadata).filter(|_| !self.topics.takes_extras());
                let md5sum = metadata.get("md5sum").cloned();
                self.announce(id, Channel { topic, schema_id, encoding, md5sum, original })?;
            }
            Record::Metadata(metadata) => {
                self.topics.extra(&Extra::Metadata { name: &metadata.name, entries: &metadata.metadata });
                self.originals.metadata(&metadata.name, &metadata.metadata);
                self.extras.add(format!("metadata {:.200}", metadata.name));
            }
            Record::MessageIndex(index) => self.index(&index),
            _ => {}
        }
        Ok(Fate::Structure)
    }

    /// An attachment with a valid checksum.
    fn attachment(&mut self, body: &[u8]) {
        let Some(head) = AttachmentHead::parse(body, u64::MAX) else { return };
        let AttachmentHead { name, media_type, logged_ns, created_ns, data } = &head;
        let (logged_ns, created_ns) = (*logged_ns, *created_ns);
        match head.data_in(body) {
            Some(data) => self.topics.extra(&Extra::Attachment { name, media_type, logged_ns, created_ns, data }),
            None if self.topics.takes_extras() => self.too_long.add(|| format!("{name:.200}")),
            None => {}
        }
        let bytes = data.end - data.start;
        self.extras.add(format!("attachment {name:.200} ({media_type:.100}, {bytes} bytes)"));
    }

    /// The messages of a skipped chunk.
    fn index(&mut self, index: &MessageIndex) {
        let Some(route) = self.route(index.channel_id) else { return };
        let mut entries = index.records.clone();
        entries.sort_by_key(|e| e.offset);
        for entry in entries {
            self.found += 1;
            let logged_ns = self.stamp(entry.log_time);
            self.topics.indexed(route, logged_ns);
        }
    }

    /// Compares with the summary, and reports oddities.
    fn conclude(&mut self, file: &str, summary: &Summary, notices: &mut Notices) {
        // Topics without messages are topics too. In order, because there may be more than the limit.
        let mut ids: Vec<u16> = self.channels.keys().copied().collect();
        ids.sort_unstable();
        for id in ids {
            self.route(id);
        }
        let stated = summary.messages.filter(|_| summary.trust != Trust::Bad).unwrap_or(self.found);
        compare_count("summary", stated, self.found, file, notices);
        report_unplaced(&self.unplaced, file, notices);
        report_broken(&self.broken, file, notices);
        let text = "definitions were replaced by others with the same number";
        self.redefined.report(Code::Redefined, file, text, notices);
        self.too_long.report(
            Code::TooMuchData,
            file,
            "attachments longer than the limit of a record were not read",
            notices,
        );
        if self.late_stamps > 0 {
            let text = "timestamps after the year 2262 were set to the last possible instant";
            notices.push(Code::UnreliableStamps, file, self.late_stamps, text);
        }
    }

    /// A record, from the top level or from within an intact chunk. For an attachment that is not wanted or
    /// exceeds the maximum record length, the first megabyte. The error is for users.
    fn record(&mut self, opcode: u8, body: &[u8]) -> Result<Fate, String> {
        match opcode {
            op::MESSAGE => self.message(body),
            // A chunk that was opened adds nothing, but its index must be valid.
            op::MESSAGE_INDEX if is_message_index(body, body.len() as u64) => Ok(Fate::Structure),
            op::ATTACHMENT => {
                self.attachment(body);
                Ok(Fate::Skipped)
            }
            _ => self.other(opcode, body),
        }
    }

    /// Whether messages of this channel are wanted; true if the channel is not known.
    fn may_want(&mut self, channel: u16) -> bool {
        // A summary may repeat channels without their schemas: the walk learns those when it reaches them.
        let waits = |c: &Channel| c.schema_id != 0 && !self.schemas.contains_key(&c.schema_id);
        self.channels.get(&channel).is_some_and(waits) || self.route(channel).is_none_or(Route::is_wanted)
    }

    /// Whether a message of this channel can be placed.
    fn knows(&self, channel: u16) -> bool {
        !matches!(self.ways.get(usize::from(channel)), Some(Way::Unknown) | None)
    }

    fn takes_attachments(&self) -> bool {
        self.topics.takes_extras()
    }

    /// A message index of a skipped chunk: nothing else reports what it lists.
    fn index_of_skipped(&mut self, body: &[u8]) -> Result<Fate, String> {
        self.other(op::MESSAGE_INDEX, body)
    }
}

/// Whether the first bytes of a record's content, `length` bytes long, are those of a message index.
fn is_message_index(start: &[u8], length: u64) -> bool {
    let mut rest = Bytes(start);
    let entries = rest.u16().and_then(|_channel| rest.u32());
    entries.is_some_and(|entries| entries % 16 == 0 && 6 + u64::from(entries) <= length)
}
