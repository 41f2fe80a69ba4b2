//! ROS 2 bag in SQLite (rosbag2 storage `sqlite3`): one file, or several that make up one flight.
//!
//! The pages are read by a walk of our own. SQLite itself ends at the first page that is damaged,
//! cannot say what became of which byte, wants to write beside a database that was not closed, and
//! executes what a hostile one brings along; for an intact bag both give the same rows.
//!
//! Of every row its bytes are decoded or skipped; the rest of the file (trees, indexes, unused room,
//! topics and definitions) is structure.

mod content;
mod pages;
mod tree;
mod wal;
mod walk;

use self::content::{Gather, MessageColumns, Messages, Owned, PassOver, looks_like_text};
use self::pages::Pages;
use self::tree::Cell;
use self::wal::{Beside, Wal};
use self::walk::Walk;
use crate::decode::{Definition, Route, Topics};
use crate::error::IngestError;
use crate::format::Reading;
use crate::format::bag_folder::{self, Metadata};
use crate::format::file::LogFile;
use crate::ledger::{Fate, Ledger};
use crate::reader::{Extra, Log, LogReader, ReadContext, Select};
use crate::table::TopicInfo;
use flight::{Notices, Severity};
use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

const WRONG_START: &str = "the file does not begin as a SQLite database does";

/// Reads ROS 2 bags in SQLite. A `metadata.yaml` among the files is what the others are compared with.
#[derive(Debug, Clone)]
pub struct Db3Reader {
    files: Vec<PathBuf>,
}

impl Db3Reader {
    /// A reader of these files. Nothing is opened yet.
    #[must_use]
    pub fn new(files: Vec<PathBuf>) -> Db3Reader {
        Db3Reader { files }
    }
}

impl LogReader for Db3Reader {
    fn read(&mut self, want: &dyn Select, context: &ReadContext<'_>) -> Result<Log, IngestError> {
        let (metadata, rest) = Metadata::split_off(&self.files)?;
        let databases: Vec<&PathBuf> = rest.iter().filter(|path| !is_beside(path, &rest)).collect();
        let mut sources = databases.iter().map(|path| Source::open(path, context)).collect::<Result<Vec<_>, _>>()?;
        let size = sources.iter().map(Source::size).sum::<u64>() + metadata.as_ref().map_or(0, |m| m.bytes);
        let mut ledger = Ledger::new(size, context.limits.listed_damage);
        let mut notices = Notices::new();
        let mut topics = Topics::new(want, context.limits.topics, size);
        let mut log = Log::default();
        let several = sources.len() > 1;
        for source in &mut sources {
            let refused = std::mem::replace(&mut source.refused, Ok(()));
            if !several {
                refused?;
            } else if super::is_foreign_part(refused, source.size(), &mut ledger, &mut notices)? {
                continue;
            }
            source.tell_missing_wal(metadata.is_some(), &mut notices);
            log.health.undecodable += source.read(&mut ledger, &mut notices, &mut topics, context)?;
        }
        // What is neither a row nor damaged.
        ledger.count(Fate::Structure, ledger.open());
        log.health.format = "ROS 2 bag (SQLite)".to_owned();
        let files = sources.into_iter().map(|source| source.file).collect();
        let mut log = Reading { files, ledger, notices, topics }.conclude(log)?;
        match metadata {
            Some(metadata) => metadata.compare(&rest, &mut log),
            None => bag_folder::tell_gaps(&rest, &mut log.notices),
        }
        Ok(log)
    }
}

/// Whether a file is the log or the journal beside another one.
fn is_beside(path: &Path, others: &[PathBuf]) -> bool {
    let name = path.as_os_str().to_string_lossy();
    let database = ["-wal", "-shm", "-journal"].iter().find_map(|end| name.strip_suffix(end));
    database.is_some_and(|database| others.iter().any(|other| other.as_os_str().to_string_lossy() == database))
}

/// A file of the bag and what stands beside it.
struct Source {
    path: PathBuf,
    file: LogFile,
    beside: Beside,
    /// The database was kept with a write-ahead log.
    write_ahead: bool,
    /// Why it is no database, nor a damaged one.
    refused: Result<(), IngestError>,
}

impl Source {
    fn open(path: &Path, context: &ReadContext<'_>) -> Result<Source, IngestError> {
        let mut file = LogFile::open(path)?;
        let head = file.up_to(0, pages::HEADER_BYTES)?.to_vec();
        let header = pages::Header::parse(&head);
        let beside = Wal::beside(path, header.map(|header| header.page_bytes))?;
        let refused = match beside {
            Beside::Wal(_) => Ok(()),
            _ => super::refuse_foreign(&mut file, WRONG_START, context),
        };
        let write_ahead = header.is_some_and(|header| header.write_ahead);
        Ok(Source { path: path.to_owned(), file, beside, write_ahead, refused })
    }

    /// A write-ahead log that was not copied along leaves no trace in the database. A recorder that closes its bag takes the
    /// log away, and then describes the bag in `metadata.yaml`, whose counts are compared.
    fn tell_missing_wal(&self, described: bool, notices: &mut Notices) {
        let is_there = wal::path_of(&self.path).exists();
        if self.write_ahead && !is_there && !described {
            let text = "the recorder kept a write-ahead log (-wal), and none stands beside the bag: unless the recorder closed \
                        it, its last messages are missing, which the file itself cannot show";
            notices.push(Severity::Warning, "no-write-ahead-log", self.file.name(), 1, text);
        }
    }

    fn size(&self) -> u64 {
        let beside = match &self.beside {
            Beside::Nothing => 0,
            Beside::Wal(wal) => wal.size,
            Beside::Useless(size, _) => *size,
        };
        self.file.size() + beside
    }

    /// Reads the database. Gives back how many messages could not be unpacked or placed.
    fn read(
        &mut self,
        ledger: &mut Ledger,
        notices: &mut Notices,
        topics: &mut Topics<'_>,
        context: &ReadContext<'_>,
    ) -> Result<u64, IngestError> {
        let name = self.file.name().to_owned();
        let wal = match std::mem::replace(&mut self.beside, Beside::Nothing) {
            Beside::Nothing => None,
            Beside::Wal(wal) => {
                raise_wal(&wal, notices);
                Some(wal)
            }
            Beside::Useless(size, why) => {
                let wal = wal::path_of(Path::new(&name)).to_string_lossy().into_owned();
                ledger.damaged(&wal, 0, size, format!("the write-ahead log is of no use: {why}"));
                None
            }
        };
        raise_journal(&self.path, &name, notices);
        let size = self.file.size();
        let tail = size + wal.as_ref().map_or(0, |wal| wal.size);
        let (pages, sound) = Pages::open(open(&self.path, &name)?, name.clone(), size, wal)?;
        if !sound {
            let text = "the head of the database is damaged; what pages could be found by their look were read";
            notices.push(Severity::Loss, "damaged-head", name, 1, text);
        }
        read_database(pages, sound, tail, ledger, notices, topics, context)
    }
}

fn open(path: &Path, name: &str) -> Result<File, IngestError> {
    File::open(path).map_err(|source| IngestError::Io { file: name.to_owned(), offset: 0, source })
}

fn raise_wal(wal: &Wal, notices: &mut Notices) {
    let text = "the recorder did not close this bag: its newest pages were read from the write-ahead log beside it";
    notices.push(Severity::Info, "write-ahead-log", wal.name.as_str(), 1, text);
    if wal.unfinished > 0 {
        let text = "pages at the end of the write-ahead log belong to a transaction that was never finished, or are \
                    damaged; they were not used";
        notices.push(Severity::Loss, "write-ahead-log-cut", wal.name.as_str(), wal.unfinished, text);
    }
}

/// A journal holds what the database was before a transaction that did not end.
fn raise_journal(path: &Path, name: &str, notices: &mut Notices) {
    let mut journal = path.as_os_str().to_owned();
    journal.push("-journal");
    let hot = File::open(journal).is_ok_and(|mut file| {
        let mut magic = [0; 8];
        file.metadata().is_ok_and(|about| about.is_file()) && file.read_exact(&mut magic).is_ok() && magic != [0; 8]
    });
    if hot {
        let text = "a journal beside the database shows that its last transaction did not end: it was read as it is";
        notices.push(Severity::Warning, "unfinished-transaction", name, 1, text);
    }
}

/// The tables of a bag, by the leaves of their trees.
#[derive(Default)]
struct Tables {
    topics: Vec<u32>,
    definitions: Vec<u32>,
    messages: Vec<u32>,
    others: Vec<u32>,
    columns: Option<MessageColumns>,
}

/// Reads one database. Gives back how many of its messages could not be unpacked or placed.
fn read_database(
    pages: Pages,
    sound: bool,
    size: u64,
    ledger: &mut Ledger,
    notices: &mut Notices,
    topics: &mut Topics<'_>,
    context: &ReadContext<'_>,
) -> Result<u64, IngestError> {
    let name = pages.place(1).0.to_owned();
    let (utf16, write_ahead) = (pages.header.utf16, pages.header.write_ahead);
    let mut walk = Walk::new(pages, ledger, context);
    walk.astray |= !sound;
    walk.unused()?;
    let mut tables = tables(&mut walk, utf16)?;
    let texts = |walk: &mut Walk<'_, '_>, leaves: &mut Vec<u32>, third: fn(&[u8]) -> bool| {
        if leaves.is_empty() && walk.astray {
            leaves.extend(walk.found(|cell| looks_like_text(cell, third))?.iter().map(|(_, page)| page));
        }
        gather(walk, leaves, utf16)
    };
    let definitions = texts(&mut walk, &mut tables.definitions, |text| text == b"ros2msg" || text == b"ros2idl")?;
    let named = texts(&mut walk, &mut tables.topics, |text| text.windows(5).any(|w| w == b"/msg/"))?;
    let columns = tables.columns.unwrap_or(MessageColumns::USUAL);
    let like_message = |cell: &Cell<'_>| columns.look_like(cell);
    if walk.astray {
        let found = walk.found(like_message)?;
        tables.messages = merged(walk.spans(&tables.messages)?, found);
    }
    let routes = announce(&named, &definitions, topics);
    let mut messages = Messages::new(topics, columns, routes, context.limits.chunk_bytes);
    walk.read(&tables.messages, &mut messages)?;
    walk.read(&tables.others, &mut PassOver)?;
    let late = walk.account(like_message)?;
    let late: Vec<u32> = late.into_iter().map(|(_, page)| page).collect();
    walk.read(&late, &mut messages)?;
    walk.conclude()?;
    let Messages { unplaced, packed, found, .. } = messages;
    let (lost, told) = (std::mem::take(&mut walk.lost), walk.told());
    let tail = walk.pages.tail();
    context.advance(size.saturating_sub(told))?;
    if tail.1 > 0 {
        ledger.damaged(&name, tail.0, tail.1, "the file ends inside a page");
    }
    let mut raise = |severity, code: &str, count, text: &str| {
        if count > 0 {
            notices.push(severity, code, name.as_str(), count, text);
        }
    };
    let text = "the file was cut: the database has more pages than there are in it";
    raise(Severity::Loss, "missing-pages", lost.missing_pages, text);
    raise(Severity::Loss, "bad-rows", lost.bad_rows, "rows that cannot be read");
    let text = format!("messages that belong to no known topic; the first: {}", unplaced.first);
    raise(Severity::Loss, "unknown-topic", unplaced.count, &text);
    let text = format!("messages whose compression is broken; the first: {}", packed.first);
    raise(Severity::Loss, "undecodable", packed.count, &text);
    let text = "pages of messages that nothing leads to any more were found by their look, and read";
    raise(Severity::Warning, "found-pages", lost.found_pages, text);
    if found == 0 && tables.columns.is_none() {
        let text = match write_ahead {
            true => {
                "there is no table of messages: its recorder kept a write-ahead log (-wal), which belongs beside it"
            }
            false => "there is no table of messages: is this a ROS 2 bag?",
        };
        raise(Severity::Loss, "no-messages", 1, text);
    }
    Ok(unplaced.count + packed.count)
}

/// The trees that the first table lists.
fn tables(walk: &mut Walk<'_, '_>, utf16: Option<bool>) -> Result<Tables, IngestError> {
    let first = walk.leaves(1, true)?;
    let mut tables = Tables::default();
    for (_, row) in gather(walk, &first, utf16)? {
        let text = |column: usize| row.get(column).and_then(Owned::text).unwrap_or_default();
        let root = row.get(3).and_then(Owned::integer).and_then(|root| u32::try_from(root).ok());
        let Some(root) = root.filter(|&root| root > 0) else { continue };
        let is_table = text(0) == "table" && !walk.is_index(root)?;
        let leaves = walk.leaves(root, is_table)?;
        match (is_table, text(1)) {
            (false, _) => {}
            (_, "topics") => tables.topics = leaves,
            (_, "message_definitions") => tables.definitions = leaves,
            (_, "messages") => {
                tables.messages = leaves;
                tables.columns = MessageColumns::of(text(4));
            }
            _ => tables.others.extend(leaves),
        }
    }
    Ok(tables)
}

fn gather(walk: &mut Walk<'_, '_>, leaves: &[u32], utf16: Option<bool>) -> Result<Vec<(i64, Vec<Owned>)>, IngestError> {
    let mut gather = Gather::new(utf16);
    walk.read(leaves, &mut gather)?;
    walk.lost.bad_rows += gather.turned_away;
    Ok(gather.rows)
}

/// Leaves in the order of their rows. A page that was found is left out if another holds its rows.
fn merged(mut listed: Vec<(i64, i64, u32)>, found: Vec<(i64, u32)>) -> Vec<u32> {
    listed.sort_by_key(|(first, ..)| *first);
    let holds = |rowid: i64| {
        let after = listed.partition_point(|(first, ..)| *first <= rowid);
        after.checked_sub(1).and_then(|i| listed.get(i)).is_some_and(|(_, last, _)| rowid <= *last)
    };
    let found = found.into_iter().filter(|(rowid, _)| !holds(*rowid));
    let mut all: Vec<(i64, u32)> = listed.iter().map(|(first, _, page)| (*first, *page)).chain(found).collect();
    all.sort_by_key(|(rowid, _)| *rowid);
    all.into_iter().map(|(_, page)| page).collect()
}

/// Where the messages of each topic go.
fn announce(
    named: &[(i64, Vec<Owned>)],
    definitions: &[(i64, Vec<Owned>)],
    topics: &mut Topics<'_>,
) -> BTreeMap<i64, Route> {
    let text = |row: &[Owned], column: usize| row.get(column).and_then(Owned::text).unwrap_or_default().to_owned();
    let known: HashMap<String, (String, String)> =
        definitions.iter().map(|(_, row)| (text(row, 1), (text(row, 2), text(row, 3)))).collect();
    let mut routes = BTreeMap::new();
    for (id, row) in named {
        let info = TopicInfo { name: text(row, 1), type_name: text(row, 2), encoding: text(row, 3) };
        // As rosbag2 calls them in an MCAP.
        let beside = [("offered_qos_profiles", text(row, 4)), ("topic_type_hash", text(row, 5))];
        let beside = beside.into_iter().filter(|(_, value)| !value.is_empty());
        let entries = beside.map(|(name, value)| (name.to_owned(), value)).collect();
        topics.extra(&Extra::OfTopic { topic: &info.name, entries: &entries });
        let (encoding, own) = known.get(&info.type_name).map_or(("", ""), |(encoding, text)| (encoding, text));
        if let Ok(route) = topics.route(info, Some(Definition { encoding, text: own.as_bytes() })) {
            routes.insert(*id, route);
        }
    }
    routes
}
