//! Decodes messages of any encoding into columns, and keeps the statistics of every topic.

pub(crate) mod cells;
mod common;
mod idl;
mod json;
mod left_out;
mod named;
pub(crate) mod packed;
mod protobuf;
mod ros;
pub(crate) mod rows;
pub(crate) mod schema;
mod type_sum;

use common::{COMMON, COMPLETED, COMPLETED_AS_GIVEN, GIVEN, borrowed};
pub(crate) use named::{NAMED, leave_out_placeholders};

use crate::reader::{Extra, Log, RawMessage, Select, Selection};
use crate::stamps::StampStats;
use crate::table::{Table, TopicInfo};
use flight::{Clock, Code, Graded, Notices, Severity, StampHealth, StampKind, TopicHealth};
use logscan::{Fate, LogTime};
use rows::Rows;
use schema::{Dialect, Schema};
use std::collections::{BTreeMap, BTreeSet, HashMap};
pub(crate) use type_sum::MD5_OF_NOTHING;

/// Longest message definition that is parsed, bytes.
const LONGEST_DEFINITION: usize = 1 << 20;
/// Memory that all definitions and decoding plans of a log may take, bytes.
const MOST_DEFINITIONS: usize = 64 << 20;
/// Longest topic or type name, bytes.
const LONGEST_NAME: usize = 4096;
/// The most notices about topics that are listed.
const MOST_NOTICES: usize = 200;
/// Topics whose timestamps are described in full; for the others only ends and jumps are counted.
const MOST_DESCRIBED: usize = 1024;

/// Which fields of a topic are wanted.
#[derive(Debug)]
pub(crate) enum Wanted {
    All,
    Paths(BTreeSet<String>),
}

impl Wanted {
    /// `None` if no field is wanted.
    fn of(selection: &Selection) -> Option<Wanted> {
        match selection {
            Selection::Skip => None,
            Selection::All | Selection::Raw => Some(Wanted::All),
            Selection::Fields(fields) => Some(Wanted::of_paths(fields.iter().map(|f| f.path.as_str()))),
        }
    }

    pub(crate) fn of_paths<'p>(paths: impl IntoIterator<Item = &'p str>) -> Wanted {
        Wanted::Paths(paths.into_iter().map(str::to_owned).collect())
    }

    pub(crate) fn has(&self, path: &str) -> bool {
        match self {
            Wanted::All => true,
            Wanted::Paths(paths) => paths.contains(path),
        }
    }

    /// Whether any field within the message at `path` is wanted.
    pub(crate) fn below(&self, path: &str) -> bool {
        match self {
            Wanted::All => true,
            Wanted::Paths(_) => self.continuing(path, '.').next().is_some(),
        }
    }

    /// The wanted elements of the array at `path`, ascending; the first `of_all` if everything is wanted.
    pub(crate) fn elements(&self, path: &str, of_all: u32) -> Vec<u32> {
        if matches!(self, Wanted::All) {
            return (0..of_all).collect();
        }
        let index = |rest: &str| rest.split_once(']').and_then(|(index, _)| index.parse::<u32>().ok());
        let indexes: BTreeSet<u32> = self.continuing(path, '[').filter_map(index).collect();
        indexes.into_iter().collect()
    }

    /// The rest of each wanted path after `path` and `with`.
    fn continuing(&self, path: &str, with: char) -> impl Iterator<Item = &str> {
        let start = format!("{path}{with}");
        let paths = match self {
            Wanted::All => None,
            Wanted::Paths(paths) => Some(paths),
        };
        let from = paths.map(|p| p.range(start.clone()..)).into_iter().flatten();
        from.map_while(move |p| p.strip_prefix(&start))
    }
}

/// The definition of a message type as a container holds it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Definition<'d> {
    /// `ros1msg`, `ros2msg`, `jsonschema`, ...
    pub(crate) encoding: &'d str,
    pub(crate) text: &'d [u8],
}

/// The destination of the messages of a channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Route {
    topic: u32,
    decoder: Option<u32>,
}

impl Route {
    /// Whether its messages are decoded.
    pub(crate) fn is_wanted(self) -> bool {
        self.decoder.is_some()
    }
}

/// The times at which a message was logged and published, as the container states them, ns.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Times {
    pub(crate) logged_ns: i64,
    pub(crate) published_ns: Option<i64>,
}

/// All topics of a log while it is read.
pub(crate) struct Topics<'w> {
    want: &'w dyn Select,
    most_topics: usize,
    most_value_bytes: u64,
    topics: Vec<Topic>,
    by_info: HashMap<TopicInfo, u32>,
    /// The clock of the container's timestamps.
    clock: Clock,
    definition_bytes: usize,
    value_bytes: u64,
    log_time: LogTime,
}

struct Topic {
    info: TopicInfo,
    wanted: Option<Wanted>,
    /// Whether its messages are wanted undecoded.
    raw: bool,
    /// The language of a definition from outside the log.
    borrowed: Option<&'static str>,
    refusal: Option<String>,
    decoders: Vec<Decoder>,
    /// The decoder that was used last.
    latest: usize,
    rows: Rows,
    messages: u64,
    payload_bytes: u64,
    logged: StampStats,
    /// `None` as long as every message was published when it was logged.
    published: Option<StampStats>,
    /// Messages counted from an index: their payload and publish time are unknown.
    only_indexed: u64,
    undecodable: Tally,
    too_long: Tally,
    beyond_memory: u64,
}

/// How often something happened, and where first.
#[derive(Debug, Default)]
pub(crate) struct Tally {
    pub(crate) count: u64,
    pub(crate) first: String,
}

impl Tally {
    pub(crate) fn add(&mut self, first: impl FnOnce() -> String) {
        if self.count == 0 {
            self.first = first();
        }
        self.count += 1;
    }

    /// Reports the event, if it happened.
    pub(crate) fn report(&self, what: impl Into<Graded>, place: &str, text: &str, notices: &mut Notices) {
        if self.count > 0 {
            notices.push(what, place, self.count, format!("{text}; the first: {}", self.first));
        }
    }

    /// Adds a later count.
    pub(crate) fn extend(&mut self, later: Tally) {
        if self.count == 0 {
            self.first = later.first;
        }
        self.count += later.count;
    }
}

struct Decoder {
    schema_encoding: String,
    definition: Vec<u8>,
    how: How,
}

enum How {
    /// Not decoded: messages go to the sink.
    Raw,
    Ros(ros::Plan),
    /// By a definition from outside the log. Every byte must fit it.
    Borrowed(ros::Plan),
    Protobuf(protobuf::Plan),
    Json,
    Packed(packed::Plan),
    Cells(cells::Plan),
}

impl<'w> Topics<'w> {
    /// For a log of `log_bytes` bytes: the memory allowed for values grows with it, so that a small file cannot claim
    /// all of it.
    pub(crate) fn new(want: &'w dyn Select, most_topics: usize, log_bytes: u64) -> Topics<'w> {
        let most_value_bytes = (64 << 20) + log_bytes.saturating_mul(64).min(8 << 30);
        Topics {
            want,
            most_topics,
            most_value_bytes,
            topics: vec![],
            by_info: HashMap::new(),
            clock: Clock::Unix,
            definition_bytes: 0,
            value_bytes: 0,
            log_time: LogTime::default(),
        }
    }

    /// The log time of the last message.
    pub(crate) fn log_time(&self) -> &LogTime {
        &self.log_time
    }

    /// Sets the clock of the container's timestamps, where it is not UTC.
    pub(crate) fn count_by(&mut self, clock: Clock) {
        self.clock = clock;
    }

    /// The route of messages of this topic and definition. Fails if there are too many topics.
    pub(crate) fn route(&mut self, info: TopicInfo, definition: Option<Definition<'_>>) -> Result<Route, String> {
        self.route_with_sum(info, definition, None)
    }

    /// As [`Topics::route`], with the MD5 sum that a ROS 1 log states for the type.
    pub(crate) fn route_with_sum(
        &mut self,
        info: TopicInfo,
        definition: Option<Definition<'_>>,
        md5sum: Option<&str>,
    ) -> Result<Route, String> {
        let own = definition.unwrap_or(Definition { encoding: "", text: &[] });
        let topic = self.topic(info.clone())?;
        let Some(topic) = self.topics.get_mut(topic as usize).filter(|topic| topic.raw || topic.wanted.is_some())
        else {
            return Ok(Route { topic, decoder: None });
        };
        let (borrowed, refusal) = match borrowed(&info, own, md5sum, self.want) {
            Ok(borrowed) => (borrowed, None),
            Err(refusal) => (None, Some(refusal)),
        };
        topic.borrowed = borrowed.as_ref().map(|(language, _)| *language).or(topic.borrowed);
        let raw = topic.raw;
        let definition =
            borrowed.as_ref().map_or(own, |(encoding, text)| Definition { encoding, text: text.as_bytes() });
        self.route_by(info, definition, |info, wanted, rows| match refusal {
            _ if raw => Ok(How::Raw),
            Some(refusal) => Err(refusal),
            None => How::of(info, definition, wanted, rows),
        })
    }

    /// The route of records of a fixed layout. `definition` identifies the layout, for example by the text that defines
    /// it in the log; `layout` is called only if the topic is wanted and the layout is new. Fails if there are too many
    /// topics.
    pub(crate) fn packed_route(
        &mut self,
        info: TopicInfo,
        definition: &[u8],
        layout: impl FnOnce(&Wanted) -> Result<packed::Layout, String>,
    ) -> Result<Route, String> {
        let definition = Definition { encoding: "packed", text: definition };
        self.route_by(info, definition, |_, wanted, rows| {
            Ok(How::Packed(packed::Plan::new(&layout(wanted)?, wanted, rows)))
        })
    }

    /// As [`Topics::packed_route`], for lines of comma-separated values.
    pub(crate) fn cells_route(
        &mut self,
        info: TopicInfo,
        definition: &[u8],
        layout: impl FnOnce() -> Result<cells::CellLayout, String>,
    ) -> Result<Route, String> {
        let definition = Definition { encoding: "cells", text: definition };
        self.route_by(info, definition, |_, wanted, rows| Ok(How::Cells(cells::Plan::new(&layout()?, wanted, rows))))
    }

    fn route_by(
        &mut self,
        info: TopicInfo,
        definition: Definition<'_>,
        how: impl FnOnce(&TopicInfo, &Wanted, &mut Rows) -> Result<How, String>,
    ) -> Result<Route, String> {
        let topic = self.topic(info)?;
        let Some(entry) = self.topics.get_mut(topic as usize) else { return Ok(Route { topic, decoder: None }) };
        let before = entry.definition_bytes();
        let decoder = match entry.decoder(definition, MOST_DEFINITIONS.saturating_sub(self.definition_bytes), how) {
            Ok(decoder) => decoder,
            Err(reason) => {
                entry.refusal.get_or_insert(reason);
                None
            }
        };
        self.definition_bytes += entry.definition_bytes() - before;
        Ok(Route { topic, decoder })
    }

    fn topic(&mut self, info: TopicInfo) -> Result<u32, String> {
        if let Some(&topic) = self.by_info.get(&info) {
            return Ok(topic);
        }
        if self.topics.len() >= self.most_topics {
            return Err(format!("there are more than {} topics", self.most_topics));
        }
        if info.name.len() > LONGEST_NAME || info.type_name.len() > LONGEST_NAME || info.encoding.len() > LONGEST_NAME {
            return Err(format!("a topic's name or type is longer than {LONGEST_NAME} bytes"));
        }
        let topic = self.topics.len() as u32;
        let described = self.topics.len() < MOST_DESCRIBED;
        self.topics.push(Topic::new(info.clone(), &self.want.select(&info), described));
        self.by_info.insert(info, topic);
        Ok(topic)
    }

    /// Counts an intact message and decodes it if it is wanted.
    pub(crate) fn message(&mut self, route: Route, times: Times, payload: &[u8]) -> Fate {
        self.numbered(route, times, None, payload)
    }

    /// As [`Topics::message`], with the container's message number.
    pub(crate) fn numbered(&mut self, route: Route, times: Times, sequence: Option<u32>, payload: &[u8]) -> Fate {
        let Some(topic) = self.topics.get_mut(route.topic as usize) else { return Fate::Skipped };
        self.log_time.passes(times.logged_ns);
        topic.count(times, payload.len() as u64);
        let Some(decoder) = route.decoder else { return Fate::Skipped };
        if let (Some(message), Some(sink)) = (topic.raw_message(decoder, times, payload), self.want.sink()) {
            sink.message(&RawMessage { sequence, ..message });
            return Fate::Decoded;
        }
        if self.value_bytes > self.most_value_bytes {
            topic.beyond_memory += 1;
            return Fate::Skipped;
        }
        let before = topic.rows.weight();
        let fate = topic.decode(decoder, times, payload);
        self.value_bytes += topic.rows.weight().saturating_sub(before);
        fate
    }

    /// Whether the sink takes data other than messages.
    pub(crate) fn takes_extras(&self) -> bool {
        self.want.sink().is_some()
    }

    /// Passes on data other than messages.
    pub(crate) fn extra(&self, extra: &Extra<'_>) {
        if let Some(sink) = self.want.sink() {
            sink.extra(extra);
        }
    }

    /// Counts a message that an index lists in a section that was not read.
    pub(crate) fn indexed(&mut self, route: Route, logged_ns: i64) {
        if let Some(topic) = self.topics.get_mut(route.topic as usize) {
            topic.messages += 1;
            topic.only_indexed += 1;
            topic.logged.push(logged_ns);
            self.log_time.passes(logged_ns);
        }
    }

    /// Counts an intact message of `length` bytes whose payload was not read because it is not wanted.
    pub(crate) fn unread(&mut self, route: Route, times: Times, length: u64) -> Fate {
        if let Some(topic) = self.topics.get_mut(route.topic as usize) {
            topic.count(times, length);
            self.log_time.passes(times.logged_ns);
        }
        Fate::Skipped
    }

    /// Writes topics, tables and notices into the log.
    pub(crate) fn finish(mut self, log: &mut Log) {
        self.topics.sort_by(|a, b| a.info.cmp(&b.info));
        let mut refused: BTreeMap<String, (u64, String)> = BTreeMap::new();
        let mut notices = Notices::new();
        let mut report_borrowed = |language: &str, what: &str| {
            let topics = self.topics.iter().filter(|topic| topic.borrowed == Some(language)).count() as u64;
            if topics > 0 {
                let text = format!("the log does not define the type of these topics; they were read with {what}");
                notices.push(Code::DefinitionSupplied, "", topics, text);
            }
        };
        report_borrowed(COMMON, "the built-in definition of that name");
        report_borrowed(GIVEN, "the definition of that name in the --maps folder");
        let completed = "built-in definitions of the missing types (the MD5 sums agree)";
        report_borrowed(COMPLETED, completed);
        let completed = "definitions of the missing types in the --maps folder (the MD5 sums agree)";
        report_borrowed(COMPLETED_AS_GIVEN, completed);
        for mut topic in self.topics {
            topic.deliver();
            if let Some(refusal) = &topic.refusal {
                refused.entry(refusal.clone()).or_insert((0, topic.info.name.clone())).0 += 1;
            }
            topic.raise(&mut notices);
            topic.finish(log, self.clock);
        }
        for (refusal, (topics, first)) in refused {
            let text = format!("wanted topics cannot be decoded: {refusal}; the first: {first}");
            notices.push(Code::NotDecoded, "", topics, text);
        }
        list(notices, &mut log.notices);
    }
}

impl Topic {
    fn new(info: TopicInfo, selection: &Selection, described: bool) -> Topic {
        Topic {
            info,
            wanted: Wanted::of(selection),
            raw: *selection == Selection::Raw,
            borrowed: None,
            refusal: None,
            decoders: vec![],
            latest: 0,
            rows: Rows::default(),
            messages: 0,
            payload_bytes: 0,
            logged: if described { StampStats::new() } else { StampStats::counts_only() },
            published: None,
            only_indexed: 0,
            undecodable: Tally::default(),
            too_long: Tally::default(),
            beyond_memory: 0,
        }
    }

    fn definition_bytes(&self) -> usize {
        self.decoders.iter().map(Decoder::weight).sum()
    }

    /// The decoder for this definition, created if it is new; `None` if nothing is wanted.
    fn decoder(
        &mut self,
        Definition { encoding, text }: Definition<'_>,
        budget: usize,
        how: impl FnOnce(&TopicInfo, &Wanted, &mut Rows) -> Result<How, String>,
    ) -> Result<Option<u32>, String> {
        let Some(wanted) = &self.wanted else { return Ok(None) };
        let same = |d: &Decoder| d.schema_encoding == encoding && d.definition == text;
        if let Some(decoder) = self.decoders.iter().position(same) {
            return Ok(Some(decoder as u32));
        }
        if text.len() > LONGEST_DEFINITION.min(budget) {
            return Err(format!("its definition of {} bytes is too long", text.len()));
        }
        let how = how(&self.info, wanted, &mut self.rows)?;
        // Usually it is the only one.
        self.decoders.reserve_exact(1);
        self.decoders.push(Decoder { schema_encoding: encoding.to_owned(), definition: text.to_vec(), how });
        Ok(Some(self.decoders.len() as u32 - 1))
    }

    fn count(&mut self, times: Times, length: u64) {
        self.messages += 1;
        self.payload_bytes += length;
        if self.published.is_none() && times.published_ns != Some(times.logged_ns) {
            self.published = Some(self.logged.clone());
        }
        self.logged.push(times.logged_ns);
        if let (Some(stats), Some(published)) = (&mut self.published, times.published_ns) {
            stats.push(published);
        }
    }

    /// The message for the sink, if it is wanted raw.
    fn raw_message<'m>(&'m self, decoder: u32, times: Times, payload: &'m [u8]) -> Option<RawMessage<'m>> {
        let decoder = self.decoders.get(decoder as usize)?;
        matches!(decoder.how, How::Raw).then_some(RawMessage {
            topic: &self.info,
            // Other readers know the language of the definition only by its standard name.
            schema_encoding: match decoder.schema_encoding.as_str() {
                COMMON | GIVEN => "ros2msg",
                COMPLETED | COMPLETED_AS_GIVEN => "ros1msg",
                own => own,
            },
            schema: &decoder.definition,
            logged_ns: times.logged_ns,
            published_ns: times.published_ns,
            sequence: None,
            payload,
        })
    }

    fn decode(&mut self, decoder: u32, times: Times, payload: &[u8]) -> Fate {
        let decoder = decoder as usize;
        if decoder != self.latest {
            self.deliver();
            self.latest = decoder;
        }
        let (Some(decoder), Some(wanted)) = (self.decoders.get_mut(decoder), &self.wanted) else {
            return Fate::Skipped;
        };
        let number = self.messages;
        match decoder.decode(payload, wanted, &mut self.rows) {
            Ok(beyond) => {
                self.rows.close(times.logged_ns, times.published_ns, number);
                if beyond > 0 {
                    self.too_long.add(|| format!("message {number} by {beyond} bytes"));
                }
                Fate::Decoded
            }
            Err(reason) => {
                self.rows.roll_back();
                self.undecodable.add(|| format!("message {number}: {reason}"));
                Fate::Skipped
            }
        }
    }

    /// Sets the values still held by the latest decoder.
    fn deliver(&mut self) {
        if let Some(Decoder { how: How::Packed(plan), .. }) = self.decoders.get_mut(self.latest) {
            plan.deliver(&mut self.rows);
        }
    }

    fn finish(self, log: &mut Log, clock: Clock) {
        log.health.messages += self.messages;
        log.health.undecodable += self.undecodable.count;
        log.health.topics.push(self.health(clock));
        if let (Some(Wanted::All), false) = (&self.wanted, self.raw) {
            let skipped = self.decoders.iter().flat_map(Decoder::left_out);
            log.left_out.extend(left_out::of(&self.info, skipped, &self.rows));
        }
        log.tables.extend(self.table());
    }

    fn raise(&self, notices: &mut Notices) {
        let place = format!("topic {}", self.info.name);
        self.undecodable.report(Code::Undecodable, &place, "messages that cannot be decoded", notices);
        self.too_long.report(Code::ReadLeniently, &place, "messages are longer than their definition", notices);
        let mut raise = |what: Graded, count, text: String| {
            if count > 0 {
                notices.push(what, place.as_str(), count, text);
            }
        };
        let text = "rows were not read: the values of this log need more memory than is allowed for a log of its \
            size"
            .to_owned();
        raise(Code::TooMuchData.into(), self.beyond_memory, text);
        let (misfits, field) = self.rows.misfits().unwrap_or_default();
        raise(Code::Redefined.into(), misfits, format!("values were not used: {field} changes its type"));
        let text = "fields or values were not read: there are too many columns".to_owned();
        raise(Code::TooMuchData.at(Severity::Warning), self.rows.turned_away(), text);
        if self.decoders.len() > 1 {
            let text =
                "different definitions of the same type in one log; each message is read with its own".to_owned();
            raise(Code::Redefined.into(), self.decoders.len() as u64, text);
        }
    }

    fn health(&self, clock: Clock) -> TopicHealth {
        let decoded = self.rows.len() > 0;
        TopicHealth {
            name: self.info.name.clone(),
            type_name: self.info.type_name.clone(),
            encoding: self.info.encoding.clone(),
            messages: self.messages,
            payload_bytes: self.payload_bytes,
            stamps: self.stamps(clock),
            decoded,
            reason: if decoded { String::new() } else { self.why_not() },
        }
    }

    fn why_not(&self) -> String {
        match (&self.refusal, self.undecodable.count) {
            (Some(refusal), _) => refusal.clone(),
            (None, 0) if self.wanted.is_some() && !self.raw => "there are no messages".to_owned(),
            (None, 0) => String::new(),
            (None, _) => self.undecodable.first.clone(),
        }
    }

    fn stamps(&self, clock: Clock) -> Vec<StampHealth> {
        let logged = self.logged.clone().finish(StampKind::Logged, clock, "log");
        // The publish time of messages known only from an index is unknown.
        let published = self.published.as_ref().unwrap_or(&self.logged);
        let published = (self.only_indexed == 0)
            .then(|| published.clone().finish(StampKind::Published, clock, "publish"))
            .flatten();
        logged.into_iter().chain(published).collect()
    }

    fn table(self) -> Option<Table> {
        (self.rows.len() > 0).then(|| self.rows.into_table(self.info))
    }
}

impl Decoder {
    /// The paths that it skips although all are wanted.
    fn left_out(&self) -> &[String] {
        match &self.how {
            How::Ros(plan) | How::Borrowed(plan) => &plan.left_out,
            How::Protobuf(plan) => &plan.left_out,
            How::Packed(_) | How::Cells(_) | How::Json | How::Raw => &[],
        }
    }

    fn weight(&self) -> usize {
        let plan = match &self.how {
            How::Ros(plan) | How::Borrowed(plan) => plan.weight(),
            How::Protobuf(plan) => plan.weight(),
            How::Packed(plan) => plan.weight(),
            How::Cells(plan) => plan.weight(),
            How::Json | How::Raw => 0,
        };
        plan + self.definition.len()
    }

    fn decode(&mut self, payload: &[u8], wanted: &Wanted, rows: &mut Rows) -> Result<usize, String> {
        match &mut self.how {
            How::Ros(plan) => plan.decode(payload, rows),
            How::Borrowed(plan) => match plan.decode(payload, rows)? {
                0 => Ok(0),
                _ if self.schema_encoding == GIVEN => {
                    Err("it is longer than the definition of its type in the --maps folder".to_owned())
                }
                _ => Err("it is longer than the built-in definition of its type".to_owned()),
            },
            How::Protobuf(plan) => plan.decode(payload, rows).map(|()| 0),
            How::Packed(plan) => plan.decode(payload, rows),
            How::Cells(plan) => plan.decode(payload, rows).map(|()| 0),
            How::Json => json::decode(payload, wanted, rows).map(|()| 0),
            How::Raw => Ok(0),
        }
    }
}

/// Passes notices on: the first in full, and the number of the others, because a hostile log has many topics.
fn list(notices: Notices, to: &mut Notices) {
    let mut unlisted: BTreeMap<Severity, u64> = BTreeMap::new();
    for (index, notice) in notices.iter().enumerate() {
        if index < MOST_NOTICES {
            to.add(notice.clone());
        } else {
            *unlisted.entry(notice.severity).or_default() += 1;
        }
    }
    for (severity, count) in unlisted {
        to.push(
            Code::NotListed.at(severity),
            "",
            count,
            "more notices about topics; they are counted, but not \
            listed",
        );
    }
}

impl How {
    /// By the encoding of the messages and of their definition.
    fn of(
        info: &TopicInfo,
        Definition { encoding, text }: Definition<'_>,
        wanted: &Wanted,
        rows: &mut Rows,
    ) -> Result<How, String> {
        let read = String::from_utf8_lossy;
        let mut plan = |schema: Result<Schema, String>| Ok(ros::Plan::new(&schema?, wanted, rows));
        let msg = |dialect| Schema::parse(&info.type_name, &read(text), dialect);
        match (info.encoding.as_str(), encoding) {
            (_, NAMED) => named::plan(&info.type_name, &read(text), wanted, rows).map(How::Ros),
            ("json", _) => Ok(How::Json),
            ("ros1", "ros1msg" | COMPLETED | COMPLETED_AS_GIVEN) => plan(msg(Dialect::Ros1)).map(How::Ros),
            ("cdr", "ros2msg") => plan(msg(Dialect::Ros2)).map(How::Ros),
            ("cdr", COMMON | GIVEN) => plan(msg(Dialect::Ros2)).map(How::Borrowed),
            ("cdr", "ros2idl" | "omgidl") => plan(Schema::parse_idl(&info.type_name, &read(text))).map(How::Ros),
            ("protobuf", "protobuf") => protobuf::Plan::new(&info.type_name, text, wanted, rows).map(How::Protobuf),
            ("cdr", "" | "unknown") => {
                Err("the message definition is missing (put it into the --maps folder, as PACKAGE/msg/TYPE.msg)"
                    .to_owned())
            }
            ("ros1" | "protobuf", "" | "unknown") => Err("the message definition is missing".to_owned()),
            ("ros1" | "cdr" | "protobuf", other) => Err(format!("definitions in {other} are not supported yet")),
            ("flatbuffer", _) => Err("FlatBuffers are not supported".to_owned()),
            ("", _) => Err("the encoding of its messages is not stated".to_owned()),
            (other, _) => Err(format!("{other} is not supported yet")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text_topic() -> TopicInfo {
        TopicInfo { name: "/t".to_owned(), type_name: "p/Text".to_owned(), encoding: "ros1".to_owned() }
    }

    const AT_ZERO: Times = Times { logged_ns: 0, published_ns: None };

    #[test]
    fn a_small_log_cannot_claim_all_memory_and_the_rest_is_a_loss() {
        let want = |_: &TopicInfo| Selection::All;
        let mut topics = Topics::new(&want, 10, 1000);
        let definition = Definition { encoding: "ros1msg", text: b"string s" };
        let route = topics.route(text_topic(), Some(definition)).unwrap();
        let megabyte = [&(1_u32 << 20).to_le_bytes()[..], &[b'x'; 1 << 20]].concat();
        for _ in 0..100 {
            topics.message(route, AT_ZERO, &megabyte);
        }
        let mut log = Log::default();
        topics.finish(&mut log);
        let rows = log.tables[0].rows as u64;
        assert!((64..=66).contains(&rows), "{rows}");
        let loss = log.notices.iter().find(|n| n.code == "too-much-data").unwrap();
        assert_eq!((loss.severity, loss.count, log.health.messages), (Severity::Loss, 100 - rows, 100));
    }

    #[test]
    fn packed_records_keep_their_rows_however_often_the_layout_changes() {
        use packed::{Layout, PackedField, PackedKind};
        let want = |_: &TopicInfo| Selection::All;
        let mut topics = Topics::new(&want, 10, 1 << 20);
        let mut route = |path: &str| {
            let kind = PackedKind::Number(schema::Number::U32);
            let fields = vec![PackedField { path: path.to_owned(), offset: 0, kind, scale: None }];
            let layout = |_: &Wanted| Ok(Layout { fields, shortest: 4, longest: 4 });
            topics.packed_route(text_topic(), path.as_bytes(), layout).unwrap()
        };
        let routes = [route("a"), route("b")];
        // Runs of 1, 2, 4, ... records: fewer and far more than are held.
        let which = |row: u32| (row + 1).ilog2() as usize % 2;
        for row in 0..20_000_u32 {
            topics.message(routes[which(row)], AT_ZERO, &row.to_le_bytes());
        }
        let mut log = Log::default();
        topics.finish(&mut log);
        let table = &log.tables[0];
        for row in 0..20_000_u32 {
            let values = ["a", "b"].map(|path| table.column(path).unwrap().number(row as usize));
            let mut truth = [None; 2];
            truth[which(row)] = Some(f64::from(row));
            assert_eq!(values, truth, "{row}");
        }
    }

    #[test]
    fn definitions_are_limited_individually_and_in_total() {
        let want = |_: &TopicInfo| Selection::All;
        let mut topics = Topics::new(&want, 1000, 1000);
        let reason = |topics: Topics<'_>, name: &str| {
            let mut log = Log::default();
            topics.finish(&mut log);
            log.health.topics.iter().find(|t| t.name == name).unwrap().reason.clone()
        };
        let long = vec![b'#'; LONGEST_DEFINITION + 1];
        topics.route(text_topic(), Some(Definition { encoding: "ros1msg", text: &long })).unwrap();
        assert!(reason(topics, "/t").contains("too long"));
        let mut topics = Topics::new(&want, 1000, 1000);
        let comment = &long[1..];
        for i in 0..80 {
            let info = TopicInfo { name: format!("/{i}"), ..text_topic() };
            topics.route(info, Some(Definition { encoding: "ros1msg", text: comment })).unwrap();
        }
        assert!(topics.definition_bytes <= MOST_DEFINITIONS);
        assert!(reason(topics, "/79").contains("too long"));
    }

    #[test]
    fn a_log_of_many_bad_topics_gets_few_notices() {
        let want = |_: &TopicInfo| Selection::All;
        let mut topics = Topics::new(&want, 65_536, 1000);
        for i in 0..5000 {
            let info = TopicInfo { name: format!("/{i}"), ..text_topic() };
            let definition = Definition { encoding: "ros1msg", text: b"string s" };
            let route = topics.route(info, Some(definition)).unwrap();
            topics.message(route, AT_ZERO, &[1]);
        }
        let mut log = Log::default();
        topics.finish(&mut log);
        assert_eq!(log.notices.len(), MOST_NOTICES + 1);
        let last = log.notices.iter().last().unwrap();
        assert_eq!(
            (last.code.as_str(), last.severity, last.count),
            ("not-listed", Severity::Loss, 5000 - MOST_NOTICES as u64)
        );
    }
}
