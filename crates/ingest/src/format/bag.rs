//! ROS 1 bags, version 2.0 (<http://wiki.ros.org/Bags/Format/2.0>), by a walk over the records.
//!
//! The index at the end only lends its connections and counts: a bag whose recorder crashed has
//! none, and reads the same.

mod record;
mod walk;

use self::record::{Fields, Kind, Record, Source};
use self::walk::{Visit, WRONG_START, Walk};
use crate::bytes::Bytes;
use crate::decode::{Definition, MD5_OF_NOTHING, Route, Tally, Times, Topics};
use crate::error::IngestError;
use crate::format::Reading;
use crate::format::unpacker::{MOST_PLACES, Unpacker};
use crate::reader::{Extra, Log, LogReader, ReadContext, Select};
use crate::table::TopicInfo;
use flight::{Code, Notices, Severity};
use logscan::LogFile;
use logscan::{Fate, Ledger};
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::PathBuf;

/// The first line of a bag.
const MAGIC: &[u8] = b"#ROSBAG V2.0\n";
/// Bags one behind another in one file.
const MOST_BAGS: u64 = 1000;
/// Connections in one bag.
const MOST_CONNECTIONS: usize = 65_536;
/// Memory that the definitions of a bag may take, bytes.
const MOST_DEFINITIONS: usize = 64 << 20;

/// Reads one ROS 1 bag, or several that make up one flight.
#[derive(Debug, Clone)]
pub struct BagReader {
    files: Vec<PathBuf>,
}

impl BagReader {
    /// A reader of these files. Nothing is opened yet.
    #[must_use]
    pub fn new(files: Vec<PathBuf>) -> BagReader {
        BagReader { files }
    }
}

impl LogReader for BagReader {
    fn read(&mut self, want: &dyn Select, context: &ReadContext<'_>) -> Result<Log, IngestError> {
        let Reading { mut files, mut ledger, mut notices, mut topics } = Reading::begin(&self.files, want, context)?;
        let mut log = Log::default();
        for file in &mut files {
            log.health.undecodable += read_file(file, context, &mut ledger, &mut topics, &mut notices)?;
        }
        log.health.format = "ROS 1 bag 2.0".to_owned();
        Reading { files, ledger, notices, topics }.conclude(log)
    }
}

/// Reads one file, which may be several bags one behind another; the number of messages that belong to no connection.
fn read_file(
    file: &mut LogFile,
    context: &ReadContext<'_>,
    ledger: &mut Ledger,
    topics: &mut Topics<'_>,
    notices: &mut Notices,
) -> Result<u64, IngestError> {
    let (name, size) = (file.name().to_owned(), file.size());
    check_version(file, context)?;
    check_encryption(file)?;
    let mut unpacker = Unpacker::new(file, context.limits.chunk_bytes);
    let (mut at, mut bags, mut tried, mut unplaced) = (0, 0, 0, 0);
    // Of many bags each may say that its index is the same long one.
    let mut index_bytes = size.saturating_mul(logscan::MOST_IN_VAIN);
    while tried == 0 || at < size && tried < MOST_BAGS {
        let mut connections = Connections::new(topics);
        let mut walk = Walk {
            source: &mut *file,
            name: &name,
            context,
            ledger,
            visit: &mut connections,
            unpacker: Some(&mut unpacker),
            at,
            messages: 0,
            padding: 0,
            padding_of_messages: 0,
            behind_message: false,
            seen: None,
            found_any: false,
            in_vain: 0,
            swallowed: 0,
        };
        let (index, chunks) = Index::read(&mut walk, &mut index_bytes)?;
        walk.expect(chunks);
        walk.begin()?;
        walk.run()?;
        let (found, padding, suspect) = (walk.messages, walk.padding, walk.padding_of_messages);
        let found_any = walk.found_any;
        (at, tried, bags) = (walk.at, tried + 1, bags + u64::from(found_any));
        if suspect > 0 {
            let text = "zero bytes behind messages: their lengths may be wrong, and messages swallowed by them";
            notices.push(Code::Corrupt, name.as_str(), suspect, text);
        }
        if padding > 0 {
            notices.push(Code::ExtraBytes, name.as_str(), padding, "zero bytes between records");
        }
        // What stands before the first bag is damage, and nothing else.
        if found_any || at == size {
            index.conclude(&name, found, notices);
        }
        connections.conclude(&name, notices);
        unplaced += connections.unplaced.count;
    }
    if at < size {
        ledger.damaged(&name, at, size - at, "more bags in one file than are read");
    }
    super::tell_logs(&name, bags, notices);
    Ok(unplaced)
}

fn check_version(file: &mut LogFile, context: &ReadContext<'_>) -> Result<(), IngestError> {
    let first = String::from_utf8_lossy(file.up_to(0, 16)?).into_owned();
    match first.strip_prefix("#ROSBAG V") {
        Some(version) if version.starts_with('1') => Err(IngestError::NotALog {
            file: file.name().to_owned(),
            what: "a ROS bag of version 1, which is not read; rosbag fix makes a newer one of it".to_owned(),
        }),
        _ => super::refuse_foreign(file, WRONG_START, context),
    }
}

/// The bag header of an encrypted bag names the plugin (rosbag, `Encryptor`): then chunks and connections are no records.
fn check_encryption(file: &mut LogFile) -> Result<(), IngestError> {
    let mut source = &mut *file;
    match Record::read(&mut source, MAGIC.len() as u64)?.map(|record| record.kind) {
        Some(Kind::BagHeader { encryptor: Some(plugin), .. }) => Err(IngestError::NotALog {
            file: file.name().to_owned(),
            what: format!("an encrypted ROS bag ({plugin:.100}), which is not read; decrypt it with its key first"),
        }),
        _ => Ok(()),
    }
}

/// What the end of the bag says of the rest.
#[derive(Debug)]
enum Index {
    /// The bag header says that there is none: the recorder did not close the bag.
    None,
    /// It should reach beyond the end of the file.
    CutOff,
    /// It is there but cannot be read, or the bag header cannot.
    Unreadable,
    /// Messages in all chunks.
    Counts(u64),
}

/// A walk through a file that has not begun.
type IndexWalk<'w, 'c, 'f, 't, 'q> = Walk<'w, 'c, &'f mut LogFile, Connections<'t, 'q>>;

impl Index {
    /// Of the bag that `walk` is to begin with; `left` bytes may be read for it, and then as many fewer. With it the places of
    /// the chunks that it lists.
    fn read(walk: &mut IndexWalk<'_, '_, '_, '_, '_>, left: &mut u64) -> Result<(Index, Vec<u64>), IngestError> {
        let start = walk.at;
        let header = Record::read(&mut walk.source, start + MAGIC.len() as u64)?;
        let Some(Kind::BagHeader { index_at, chunks, .. }) = header.map(|r| r.kind) else {
            return Ok((Index::Unreadable, vec![]));
        };
        match start.saturating_add(index_at) {
            _ if index_at == 0 => Ok((Index::None, vec![])),
            at if at > walk.source.size() => Ok((Index::CutOff, vec![])),
            at => {
                let mut places = vec![];
                let index = Index::records(walk, start..at, left, chunks, &mut places)?;
                Ok((index, places))
            }
        }
    }

    fn records(
        walk: &mut IndexWalk<'_, '_, '_, '_, '_>,
        log: Range<u64>,
        left: &mut u64,
        chunks: Option<u32>,
        places: &mut Vec<u64>,
    ) -> Result<Index, IngestError> {
        let mut at = log.end;
        let (mut messages, mut seen, mut is_damaged) = (0_u64, 0_u64, false);
        // Another bag may follow.
        while at < walk.source.size() && walk.source.bytes(at, MAGIC.len())? != Some(MAGIC) {
            let longest = walk.context.limits.record_bytes.min(walk.source.size().saturating_sub(at));
            let intact = |record: &Record| record.end() - at <= longest && record.fits_its_count();
            let record = Record::read(&mut walk.source, at)?.filter(intact);
            let end = match &record {
                Some(record) => record.end(),
                // Behind one that is damaged others may be intact.
                None => walk.search(at + 1)?,
            };
            let Some(fewer) = left.checked_sub(end - at) else { return Ok(Index::Unreadable) };
            *left = fewer;
            at = end;
            let Some(record) = record else {
                is_damaged = true;
                continue;
            };
            let Some(data) = walk.source.bytes(record.data_at, record.data_length as usize)? else {
                return Ok(Index::Unreadable);
            };
            match &record.kind {
                // What is wrong with a connection is said when the walk comes by.
                Kind::Connection { connection, topic } => drop(walk.visit.connection(*connection, topic, data)),
                Kind::ChunkInfo { chunk_at, .. } => {
                    places.extend(log.start.checked_add(*chunk_at).filter(|_| seen < MOST_PLACES as u64));
                    seen += 1;
                    messages = messages.saturating_add(counts(data));
                }
                _ => return Ok(Index::Unreadable),
            }
        }
        let whole = chunks.is_none_or(|chunks| seen >= u64::from(chunks));
        Ok(if is_damaged {
            Index::Unreadable
        } else if whole {
            Index::Counts(messages)
        } else {
            Index::CutOff
        })
    }

    fn conclude(&self, file: &str, found: u64, notices: &mut Notices) {
        match self {
            Index::None => {
                let text = "the bag has no index: its recorder was stopped before it could close it";
                notices.push(Code::IncompleteFile, file, 1, text);
            }
            Index::CutOff => {
                notices.push(Code::IncompleteFile, file, 1, "the bag was cut before the end of its index");
            }
            Index::Unreadable => {
                let text = "the index cannot be read, so nothing says whether messages are missing";
                notices.push(Code::IndexDiffers.at(Severity::Loss), file, 1, text);
            }
            Index::Counts(stated) if *stated > found => {
                let text = format!("messages are missing: the index counts {stated}, {found} were found");
                notices.push(Code::MissingMessages, file, stated - found, text);
            }
            Index::Counts(stated) if *stated < found => {
                let text = format!("messages more than the index counts ({stated})");
                notices.push(Code::IndexDiffers, file, found - stated, text);
            }
            Index::Counts(_) => {}
        }
    }
}

/// Messages that a chunk info lists: pairs of connection and count.
fn counts(data: &[u8]) -> u64 {
    let mut rest = Bytes(data);
    let mut sum = 0;
    while let (Some(_connection), Some(count)) = (rest.u32(), rest.u32()) {
        sum += u64::from(count);
    }
    sum
}

struct Connection {
    info: TopicInfo,
    definition: Option<Vec<u8>>,
    md5sum: Option<String>,
    route: Route,
}

/// Connections of one bag; gives messages to the topics.
struct Connections<'t, 'w> {
    topics: &'t mut Topics<'w>,
    known: BTreeMap<u32, Connection>,
    definition_bytes: usize,
    unplaced: Tally,
    redefined: Tally,
}

impl<'t, 'w> Connections<'t, 'w> {
    fn new(topics: &'t mut Topics<'w>) -> Connections<'t, 'w> {
        Connections {
            topics,
            known: BTreeMap::new(),
            definition_bytes: 0,
            unplaced: Tally::default(),
            redefined: Tally::default(),
        }
    }

    /// `definition` is absent where the recorder had none: that of a message without fields is an empty text.
    fn add(
        &mut self,
        id: u32,
        info: TopicInfo,
        definition: Option<&[u8]>,
        md5sum: Option<String>,
    ) -> Result<(), String> {
        if let Some(known) = self.known.get(&id) {
            if known.info == info && known.definition.as_deref() == definition && known.md5sum == md5sum {
                return Ok(());
            }
            self.redefined.add(|| format!("connection {id}, {:.200}", info.name));
            // If there is no room for the new one, messages are not to be taken for the old one's.
            self.known.remove(&id);
        }
        self.definition_bytes += definition.map_or(0, <[u8]>::len);
        if self.known.len() >= MOST_CONNECTIONS || self.definition_bytes > MOST_DEFINITIONS {
            return Err(format!(
                "the bag has more than {MOST_CONNECTIONS} connections or {MOST_DEFINITIONS} bytes of definitions"
            ));
        }
        let text = definition.map(|text| Definition { encoding: "ros1msg", text });
        let route = self.topics.route_with_sum(info.clone(), text, md5sum.as_deref())?;
        self.known.insert(id, Connection { info, definition: definition.map(<[u8]>::to_vec), md5sum, route });
        Ok(())
    }

    fn conclude(&self, file: &str, notices: &mut Notices) {
        if self.unplaced.count > 0 {
            let text = format!("messages that belong to no known topic; the first: {}", self.unplaced.first);
            notices.push(Code::UnknownChannel, file, self.unplaced.count, text);
        }
        if self.redefined.count > 0 {
            let text =
                format!("connections were replaced by others of the same number; the first: {}", self.redefined.first);
            notices.push(Code::Redefined, file, self.redefined.count, text);
        }
    }
}

impl Visit for Connections<'_, '_> {
    fn connection(&mut self, connection: u32, topic: &str, data: &[u8]) -> Result<(), String> {
        let fields = Fields::parse(data).ok_or("the fields of a connection are damaged")?;
        let type_name = fields.text("type").ok_or("a connection without a type")?;
        let definition = fields.get("message_definition").unwrap_or_default();
        let md5sum = fields.text("md5sum");
        let is_whole = !definition.is_empty() || md5sum.as_deref() == Some(MD5_OF_NOTHING);
        let info = TopicInfo { name: topic.to_owned(), type_name, encoding: "ros1".to_owned() };
        let beside = ["callerid", "latching", "md5sum"].iter();
        let entries = beside.filter_map(|name| Some(((*name).to_owned(), fields.text(name)?))).collect();
        self.topics.extra(&Extra::OfTopic { topic, entries: &entries });
        self.add(connection, info, is_whole.then_some(definition), md5sum)
    }

    fn route(&self, connection: u32) -> Option<Route> {
        self.known.get(&connection).map(|known| known.route)
    }

    fn message(&mut self, route: Route, logged_ns: i64, payload: &[u8]) -> Fate {
        self.topics.message(route, Times { logged_ns, published_ns: None }, payload)
    }

    fn unread(&mut self, connection: u32, route: Option<Route>, logged_ns: i64, length: u32) -> Fate {
        let Some(route) = route else {
            self.unplaced.add(|| format!("connection {connection}"));
            return Fate::Skipped;
        };
        self.topics.unread(route, Times { logged_ns, published_ns: None }, u64::from(length))
    }
}
