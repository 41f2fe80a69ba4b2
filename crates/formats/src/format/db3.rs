//! ROS 2 bag in SQLite (rosbag2 storage `sqlite3`): one file, or several that make up one flight.
//!
//! The pages are read by our own walk. SQLite itself stops at the first corrupt page,
//! cannot account for every byte, needs to write next to a database that was not closed, and
//! executes code in a hostile database. For an intact bag both give the same rows.
//!
//! The bytes of each row are decoded or skipped; the rest of the file (trees, indexes, unused room,
//! topics and definitions) is structure.

mod content;
mod pages;
mod tree;
mod wal;
mod walk;

pub use self::wal::path_of as write_ahead_log_of;

use self::content::{Gather, MessageColumns, Messages, OwnedRow, PassOver, Places, column_names};
use self::pages::Pages;
use self::wal::{Beside, Wal};
use self::walk::{Leaf, Lost, Walk};
use crate::decode::{Definition, Route, Tally, Topics};
use crate::error::LogError;
use crate::format::bag_folder::{self, Metadata};
use crate::format::{Reading, report_broken, report_unplaced};
use crate::reader::{Extra, Log, ReadContext, Select};
use crate::table::TopicInfo;
use flight::{Code, Notices, Severity};
use logscan::LogFile;
use logscan::{Fate, Ledger, ScanError, Source as _};
use std::collections::HashMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

const WRONG_START: &str = "the file does not begin like a SQLite database";

/// Reads ROS 2 bags in SQLite. The content is compared with `metadata.yaml`, if there is one among the files.
pub(crate) fn read(files: &[PathBuf], want: &dyn Select, context: &ReadContext<'_>) -> Result<Log, LogError> {
    let (metadata, rest) = Metadata::split_off(files)?;
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
        source.report_missing_wal(metadata.is_some(), &mut notices);
        log.health.undecodable += source.read(&mut ledger, &mut notices, &mut topics, context)?;
    }
    // Neither row nor damage.
    ledger.count(Fate::Structure, ledger.open());
    log.health.format = "ROS 2 bag (SQLite)".to_owned();
    let name = sources.first().map_or("", |source| source.file.name()).to_owned();
    let mut log = Reading { name, ledger, notices, topics }.conclude(log)?;
    match metadata {
        Some(metadata) => metadata.compare(&rest, &mut log),
        None => bag_folder::report_gaps(&rest, &mut log.notices),
    }
    Ok(log)
}

/// Whether a file is the write-ahead log or the journal of another one.
fn is_beside(path: &Path, others: &[PathBuf]) -> bool {
    let name = path.as_os_str().to_string_lossy();
    let database = ["-wal", "-shm", "-journal"].iter().find_map(|end| name.strip_suffix(end));
    database.is_some_and(|database| others.iter().any(|other| other.as_os_str().to_string_lossy() == database))
}

/// A file of the bag and its sidecars.
struct Source {
    path: PathBuf,
    file: LogFile,
    beside: Beside,
    /// The database was kept with a write-ahead log.
    write_ahead: bool,
    /// Why it is not a database, not even a corrupt one.
    refused: Result<(), LogError>,
}

impl Source {
    fn open(path: &Path, context: &ReadContext<'_>) -> Result<Source, LogError> {
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

    /// A write-ahead log that was not copied along leaves no trace in the database. A recorder that closes its bag
    /// removes the log, and then describes the bag in `metadata.yaml`, whose counts are compared.
    fn report_missing_wal(&self, described: bool, notices: &mut Notices) {
        let is_there = std::fs::metadata(wal::path_of(&self.path)).is_ok_and(|about| about.len() > 0);
        if self.write_ahead && !is_there && !described {
            let text = "the recorder used a write-ahead log (-wal), which is empty or not in the folder of the bag. \
                If the recorder did not close the bag, its last messages are missing; the file itself does not show \
                this";
            notices.push(Code::IncompleteRecording.at(Severity::Warning), self.file.name(), 1, text);
        }
    }

    fn size(&self) -> u64 {
        let beside = match &self.beside {
            Beside::Nothing => 0,
            Beside::Wal(wal) => wal.size,
            Beside::Idle(size) | Beside::Useless(size, _) => *size,
        };
        self.file.size() + beside
    }

    /// Reads the database. Returns how many messages could not be decompressed or placed.
    fn read(
        &mut self,
        ledger: &mut Ledger,
        notices: &mut Notices,
        topics: &mut Topics<'_>,
        context: &ReadContext<'_>,
    ) -> Result<u64, LogError> {
        let name = self.file.name().to_owned();
        let wal = match std::mem::replace(&mut self.beside, Beside::Nothing) {
            Beside::Nothing | Beside::Idle(_) => None,
            Beside::Wal(wal) => {
                raise_wal(&wal, notices);
                Some(wal)
            }
            Beside::Useless(size, why) => {
                let wal = wal::path_of(Path::new(&name)).to_string_lossy().into_owned();
                ledger.damaged(&wal, 0, size, format!("the write-ahead log cannot be used: {why}"));
                None
            }
        };
        raise_journal(&self.path, &name, notices);
        let size = self.file.size();
        let tail = size + wal.as_ref().map_or(0, |wal| wal.size);
        match Pages::open(open(&self.path, &name)?, name.clone(), size, wal)? {
            Some(pages) => read_database(pages, tail, ledger, notices, topics, context),
            None => {
                ledger.damaged(&name, 0, tail, "the header of the database is damaged; nothing was read");
                Ok(0)
            }
        }
    }
}

fn open(path: &Path, name: &str) -> Result<File, LogError> {
    File::open(path).map_err(|source| LogError::Read(ScanError::Io { file: name.to_owned(), offset: 0, source }))
}

fn raise_wal(wal: &Wal, notices: &mut Notices) {
    let text = "the recorder did not close this bag; its newest pages were read from its write-ahead log";
    notices.push(Code::IncompleteRecording.at(Severity::Info), wal.name.as_str(), 1, text);
    if wal.unfinished > 0 {
        let text = "pages at the end of the write-ahead log are damaged, or belong to an unfinished transaction; \
            they were not used";
        notices.push(Code::IncompleteRecording.at(Severity::Loss), wal.name.as_str(), wal.unfinished, text);
    }
}

/// A journal holds the state of the database before an unfinished transaction.
fn raise_journal(path: &Path, name: &str, notices: &mut Notices) {
    let mut journal = path.as_os_str().to_owned();
    journal.push("-journal");
    let hot = File::open(journal).is_ok_and(|mut file| {
        let mut magic = [0; 8];
        file.metadata().is_ok_and(|about| about.is_file()) && file.read_exact(&mut magic).is_ok() && magic != [0; 8]
    });
    if hot {
        let text = "the journal of the database shows an unfinished last transaction; the database was read without \
            rolling it back";
        notices.push(Code::IncompleteRecording.at(Severity::Warning), name, 1, text);
    }
}

/// The tables of a bag, by the leaves of their trees, and the SQL that created them.
#[derive(Default)]
struct Tables {
    topics: Vec<Leaf>,
    topics_sql: String,
    definitions: Vec<Leaf>,
    definitions_sql: String,
    messages: Vec<Leaf>,
    others: Vec<Leaf>,
    columns: Option<MessageColumns>,
    /// Text is UTF-16, big-endian if the inner value is true.
    utf16: Option<bool>,
}

/// Columns of name, type, serialization, QoS and hash of a topic, and of type, encoding and text of a definition.
struct Columns {
    topics: Places<5>,
    definitions: Places<3>,
    /// The column with the number that messages use for a topic.
    number: usize,
}

impl Columns {
    fn of(tables: &Tables) -> Columns {
        let sql = &tables.topics_sql;
        let names = ["name", "type", "serialization_format", "offered_qos_profiles", "type_description_hash"];
        let number = column_names(sql).iter().position(|name| name == "id").unwrap_or(0);
        let definition = ["topic_type", "encoding", "encoded_message_definition"];
        Columns {
            topics: Places::of(sql, names, 1),
            definitions: Places::of(&tables.definitions_sql, definition, 1),
            number,
        }
    }
}

/// Reads one database. Returns how many of its messages could not be decompressed or placed.
fn read_database(
    pages: Pages,
    size: u64,
    ledger: &mut Ledger,
    notices: &mut Notices,
    topics: &mut Topics<'_>,
    context: &ReadContext<'_>,
) -> Result<u64, LogError> {
    let name = pages.place(1).0.to_owned();
    let (utf16, write_ahead) = (pages.header.utf16, pages.header.write_ahead);
    let mut walk = Walk::new(pages, ledger, context);
    let tables = tables(&mut walk, utf16)?;
    walk.unused()?;
    let columns = Columns::of(&tables);
    let named = gather(&mut walk, &tables.topics, columns.topics.texts())?;
    let definitions = gather(&mut walk, &tables.definitions, columns.definitions.texts())?;
    let routes = announce(&named, &definitions, &columns, tables.utf16, topics);
    let columns = tables.columns.unwrap_or(MessageColumns::USUAL);
    let mut messages = Messages::new(topics, columns, routes, context.limits.chunk_bytes);
    walk.read(&tables.messages, &mut messages)?;
    walk.read(&tables.others, &mut PassOver)?;
    walk.account()?;
    let Messages { unplaced, packed, found, .. } = messages;
    let (lost, reported) = (std::mem::take(&mut walk.lost), walk.reported());
    let tail = walk.pages.tail();
    context.advance(size.saturating_sub(reported))?;
    if tail.1 > 0 {
        ledger.damaged(&name, tail.0, tail.1, "the file ends inside a page");
    }
    let has_messages = found > 0 || tables.columns.is_some();
    let all = Losses { lost: &lost, unplaced: &unplaced, packed: &packed, has_messages, write_ahead };
    all.report(&name, notices);
    Ok(unplaced.count + packed.count)
}

/// A row of the schema table.
struct Listed {
    name: String,
    /// Whether it is a table that is not stored as an index.
    has_rows: bool,
    root: u32,
    sql: String,
}

impl Listed {
    /// `None` for entries without a tree of their own, such as views.
    fn of(row: &OwnedRow, utf16: Option<bool>) -> Option<Listed> {
        let text = |column| row.text(column, utf16);
        let root = row.integer(3).and_then(|root| u32::try_from(root).ok()).filter(|root| *root > 0)?;
        let has_rows = text(0) == "table" && !text(4).to_lowercase().contains("without rowid");
        Some(Listed { name: text(1).to_lowercase(), has_rows, root, sql: text(4) })
    }
}

/// What was lost of a database, or read leniently.
struct Losses<'l> {
    lost: &'l Lost,
    unplaced: &'l Tally,
    packed: &'l Tally,
    has_messages: bool,
    write_ahead: bool,
}

impl Losses<'_> {
    fn report(&self, name: &str, notices: &mut Notices) {
        self.report_pages(name, notices);
        report_unplaced(self.unplaced, name, notices);
        report_broken(self.packed, name, notices);
        self.report_repairs(name, notices);
        if !self.has_messages {
            let text = match self.write_ahead {
                true => {
                    "there is no table of messages. The recorder used a write-ahead log (-wal): put it into the same \
                     folder"
                }
                false => "there is no table of messages: is this a ROS 2 bag?",
            };
            notices.push(Code::IncompleteRecording, name, 1, text);
        }
    }

    /// Losses in the pages of the database.
    fn report_pages(&self, name: &str, notices: &mut Notices) {
        let lost = self.lost;
        let mut raise = |count: u64, text: &str| {
            if count > 0 {
                notices.push(Code::Corrupt, name, count, text);
            }
        };
        let text = "the file is truncated: the database has more pages than the file";
        raise(lost.missing_pages, text);
        let text = "the database refers to pages that do not exist, or twice to the same page; their content is \
            missing";
        raise(if lost.missing_pages == 0 { lost.dead_ends } else { 0 }, text);
        raise(lost.bad_rows, "rows that cannot be read");
    }

    /// Data that were read although the database does not list them.
    fn report_repairs(&self, name: &str, notices: &mut Notices) {
        if self.lost.spare_pages {
            let text = "the list of unused pages of the database is damaged; the pages in use were read";
            notices.push(Code::ReadLeniently, name, 1, text);
        }
    }
}

/// The trees that the schema table lists.
fn tables(walk: &mut Walk<'_, '_>, utf16: Option<bool>) -> Result<Tables, LogError> {
    let first = walk.leaves(1, true)?;
    let rows = gather(walk, &first, [0, 1])?;
    let mut tables = Tables { utf16, ..Tables::default() };
    let mut others = vec![];
    for listed in rows.iter().filter_map(|row| Listed::of(row, utf16)) {
        let leaves = match (listed.has_rows, listed.name.as_str()) {
            (true, "messages") => {
                tables.columns = MessageColumns::of(&listed.sql);
                &mut tables.messages
            }
            (true, "topics") => {
                tables.topics_sql = listed.sql;
                &mut tables.topics
            }
            (true, "message_definitions") => {
                tables.definitions_sql = listed.sql;
                &mut tables.definitions
            }
            _ => {
                others.push(listed);
                continue;
            }
        };
        leaves.extend(walk.leaves(listed.root, true)?);
    }
    for listed in others {
        let leaves = walk.leaves(listed.root, listed.has_rows)?;
        tables.others.extend(leaves.into_iter().filter(|_| listed.has_rows));
    }
    Ok(tables)
}

fn gather(walk: &mut Walk<'_, '_>, leaves: &[Leaf], texts: [usize; 2]) -> Result<Vec<OwnedRow>, LogError> {
    let mut gather = Gather::new(texts);
    walk.read(leaves, &mut gather)?;
    walk.lost.bad_rows += gather.turned_away;
    Ok(gather.rows)
}

/// Where the messages of each topic go.
fn announce(
    named: &[OwnedRow],
    definitions: &[OwnedRow],
    columns: &Columns,
    utf16: Option<bool>,
    topics: &mut Topics<'_>,
) -> HashMap<i64, Route> {
    let mut known: HashMap<String, (String, String)> = HashMap::new();
    for row in definitions {
        let [of_type, encoding, text] = columns.definitions.read(row, utf16);
        known.entry(of_type).or_insert((encoding, text));
    }
    let mut routes = HashMap::new();
    for row in named {
        // Messages refer to the column, which is the row number unless the table was defined otherwise.
        let id = row.integer(columns.number).unwrap_or(row.rowid);
        if routes.contains_key(&id) {
            continue;
        }
        let [name, type_name, encoding, qos, hash] = columns.topics.read(row, utf16);
        let info = TopicInfo { name, type_name, encoding };
        // As rosbag2 names them in an MCAP.
        let beside = [("offered_qos_profiles", qos), ("topic_type_hash", hash)];
        let beside = beside.into_iter().filter(|(_, value)| !value.is_empty());
        let entries = beside.map(|(name, value)| (name.to_owned(), value)).collect();
        topics.extra(&Extra::OfTopic { topic: &info.name, entries: &entries });
        let (encoding, own) = known.get(&info.type_name).map_or(("", ""), |(encoding, text)| (encoding, text));
        if let Ok(route) = topics.route(info, Some(Definition { encoding, text: own.as_bytes() })) {
            routes.insert(id, route);
        }
    }
    routes
}
