//! Text tables: one table per file, one file per topic, or FlySight 2 with several tables in one file.

mod columns;
mod device_columns;
mod extent;
mod fields;
mod formula;
mod header;
mod layout;
mod lines;
mod novatel;
mod one_table;
mod plain;
mod read_ahead;

pub use self::formula::inert;

use self::columns::Topic;
use self::device_columns::DeviceColumns;
use self::extent::Extent;
use self::fields::Fields;
use self::header::{Header, HeaderFindings};
use self::layout::{Layout, TableLayout};
use self::lines::{Lines, Next};
use self::one_table::OneTable;
use self::plain::comment_mark;
use self::read_ahead::Rules;
use crate::error::{LogError, file_name};
use crate::format::identity::{GARMIN, of_table_head};
use crate::format::workers::Workers;
use crate::reader::{Limits, Log, ReadContext, Select, Selection};
use crate::table::{Table, TopicInfo};
use flight::{Code, LogHealth, Notices, Severity};
use logscan::{Fate, Ledger, ScanError};
use std::collections::{HashMap, HashSet};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Bytes from which the layout is found, unless a line is longer.
const HEAD: u64 = 256 << 10;

/// `$VAR` lines of FlySight 2 files and remarks of others that are listed.
const EXTRAS: usize = 256;
/// The longest comment that is a remark, bytes.
const LONGEST_REMARK: usize = 200;

/// The smallest file with rows shared with idle threads, bytes.
const LEAST_SHARED: u64 = 1 << 20;

const SHORTER: &str = "the file became shorter while it was read";

/// The UTF-8 byte order mark.
const BOM: &[u8] = b"\xef\xbb\xbf";

/// Reads one text log, or several that hold one topic each and make up one flight.
///
/// A file is one topic named after the file, except for FlySight 2 files, whose rows name their topic.
/// Line numbers count from 1.
pub(crate) fn read(files: &[PathBuf], want: &dyn Select, context: &ReadContext<'_>) -> Result<Log, LogError> {
    // A file may grow or shrink later: its size at the start counts.
    let sizes = files.iter().map(|path| Ok(open(path)?.1)).collect::<Result<Vec<u64>, LogError>>()?;
    let ledger = Ledger::new(sizes.iter().sum(), context.limits.listed_damage);
    let accounting =
        Accounting { ledger, health: LogHealth::default(), notices: Notices::new(), limits: context.limits };
    let mut reading = Reading {
        want,
        context,
        accounting,
        topics: vec![],
        devices: HashMap::new(),
        formats: vec![],
        taken: HashSet::new(),
    };
    for (path, size) in files.iter().zip(sizes) {
        reading.file(path, size, files.len() == 1)?;
    }
    reading.finish()
}

/// Whether the first bytes of a file look like a log in a text table, and if not, why. Stricter than
/// the reader, because many texts have the same number of commas in most lines. `false` if the table has only
/// numbers and no header: then only the file name can identify it.
///
/// # Errors
/// What the file is instead.
pub(crate) fn looks_like(head: &[u8], context: &ReadContext<'_>) -> Result<bool, String> {
    match layout::find(without_bom(head), context)? {
        Layout::Table(table) if table.only_numbers => Ok(false),
        Layout::Table(table) if !table.regular => {
            Err("its first lines are not a table of numbers below a header".into())
        }
        Layout::Table(_) | Layout::FlySight2 | Layout::Novatel | Layout::Tagged => Ok(true),
    }
}

/// The text after the comment mark and one space.
fn unmarked(comment: &[u8]) -> &[u8] {
    let text = comment.get(comment_mark(comment)..).unwrap_or_default();
    text.strip_prefix(b" ").unwrap_or(text)
}

/// A header without the spaces around it, for comparison. TABs stay, because a name between them may be missing.
fn trimmed_header(line: &[u8]) -> &[u8] {
    let mut line = without_bom(line);
    while let Some(rest) = line.strip_prefix(b" ").or_else(|| line.strip_suffix(b" ")) {
        line = rest;
    }
    line
}

fn without_bom(head: &[u8]) -> &[u8] {
    head.strip_prefix(BOM).unwrap_or(head)
}

fn open(path: &Path) -> Result<(File, u64), LogError> {
    let failed = |source| LogError::of_file(path, source);
    let file = File::open(path).map_err(failed)?;
    let size = file.metadata().map_err(failed)?.len();
    Ok((file, size))
}

/// One pass over all files.
struct Reading<'a> {
    want: &'a dyn Select,
    context: &'a ReadContext<'a>,
    accounting: Accounting,
    topics: Vec<Topic>,
    /// By topic name: the columns that depend on the device, and the wanted fields.
    devices: HashMap<String, (DeviceColumns, Selection)>,
    formats: Vec<String>,
    /// Names of the topics.
    taken: HashSet<String>,
}

/// The account of every byte and row so far.
struct Accounting {
    ledger: Ledger,
    health: LogHealth,
    notices: Notices,
    limits: Limits,
}

/// A line between the rows of a table.
enum RowOrHeader {
    Header,
    /// A row, or a remark.
    Row {
        is_split: bool,
    },
}

/// A file while its records are read.
struct Open<'a> {
    name: &'a str,
    lines: Lines<'a, std::io::Take<File>>,
    size: u64,
    fields: Fields,
}

impl<'a> Open<'a> {
    fn new(path: &Path, name: &'a str, size: u64, context: &'a ReadContext<'a>) -> Result<Open<'a>, LogError> {
        let (mut file, _) = open(path)?;
        let failed = |source| LogError::Read(ScanError::Io { file: name.to_owned(), offset: 0, source });
        let mut first = vec![];
        file.by_ref().take(BOM.len() as u64).read_to_end(&mut first).map_err(failed)?;
        let skipped = if first == BOM { BOM.len() as u64 } else { 0 };
        file.seek(SeekFrom::Start(skipped)).map_err(failed)?;
        let lines = Lines::new(file.take(size - skipped.min(size)), name, context).from(skipped);
        Ok(Open { name, lines, size, fields: Fields::default() })
    }
}

impl Reading<'_> {
    fn file(&mut self, path: &Path, size: u64, alone: bool) -> Result<(), LogError> {
        let name = file_name(path);
        let stem = path.file_stem().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
        let (file, _) = open(path)?;
        let head = head_of(&file, &name, self.context)?;
        let layout = match layout::find(without_bom(&head), self.context) {
            Ok(layout) => layout,
            Err(_) if head.is_empty() && alone => {
                return Err(LogError::NotALog { file: name, what: "the file is empty".into() });
            }
            Err(what) if alone => return Err(LogError::NotALog { file: name, what }),
            Err(what) => {
                let held = if head.len() as u64 >= HEAD { size } else { size.min(head.len() as u64) };
                self.accounting.ledger.count(Fate::Skipped, held);
                if held < size {
                    self.accounting.ledger.damaged(&name, held, size - held, SHORTER);
                }
                self.accounting.notices.push(Code::NoRows.at(Severity::Warning), name, 1, what);
                return Ok(self.context.advance(size)?);
            }
        };
        let mut open = Open::new(path, &name, size, self.context)?;
        self.accounting.ledger.count(Fate::Structure, open.lines.offset);
        match layout {
            Layout::Table(table) => self.table(&mut open, &table, stem)?,
            Layout::FlySight2 => self.flysight2(&mut open, &stem)?,
            Layout::Novatel => self.novatel(&mut open)?,
            Layout::Tagged => self.tagged(&mut open)?,
        }
        // Bytes are left over here only if the file shrank while it was read.
        let missing = size.saturating_sub(open.lines.offset);
        if missing > 0 {
            self.accounting.ledger.damaged(&name, open.lines.offset, missing, SHORTER);
        }
        Ok(())
    }

    fn table(&mut self, open: &mut Open<'_>, layout: &TableLayout, stem: String) -> Result<(), LogError> {
        self.formats.push(format!("CSV, {}", layout.describe()));
        if layout.header_line.is_none() {
            let severity = if layout.only_numbers { Severity::Info } else { Severity::Warning };
            let text = match layout.unused_names {
                None => "no header row: columns are called column_1, column_2, ...".to_owned(),
                Some(line) => format!(
                    "line {line} names the columns and is not used, because of the line above it: delete what is above \
                     line {line}; columns are called column_1, column_2, ..."
                ),
            };
            self.accounting.notices.push(Code::ColumnRenamed.at(severity), open.name, 1, text);
        }
        if layout.renamed > 0 && layout.header_line.is_some() {
            let text = "columns without a unique name were given one";
            self.accounting.notices.push(Code::ColumnRenamed, open.name, layout.renamed as u64, text);
        }
        let topic = self.topic_of(open, layout, stem);
        let workers =
            if open.size > LEAST_SHARED && topic.can_be_parsed_in_parts() { Workers::available() } else { None };
        let mut table = OneTable::new(layout, topic, self.context.limits.line_bytes);
        table.read(&mut self.accounting, open, workers.as_ref())?;
        table.report(open.name, &mut self.accounting.notices);
        table.topic.report(open.name, self.context.limits.listed_damage, &mut self.accounting.notices);
        self.topics.push(table.topic);
        Ok(())
    }

    /// The topic of the only table of a file, without rows yet.
    fn topic_of(&mut self, open: &Open<'_>, layout: &TableLayout, stem: String) -> Topic {
        let info =
            TopicInfo { name: self.free_name(stem, open.name), type_name: String::new(), encoding: "csv".into() };
        let selection = self.want.select(&info);
        let mut device = DeviceColumns::of(&layout.names);
        if let Some(text) = device.notice.take() {
            self.accounting.notices.push(Code::SeveralSources, open.name, 1, text);
        }
        let names = std::mem::take(&mut device.names);
        let mut topic = Topic::new(info, names, &device.sources(&selection));
        device.kept_as_text().into_iter().for_each(|path| topic.keep_text(path));
        self.devices.insert(topic.info.name.clone(), (device, selection));
        topic.decimal = layout.decimal;
        topic.unused_names = layout.unused_names;
        topic
    }

    /// FlySight 2: `$COL` lines name the columns of a table, `$UNIT` lines their units, and below
    /// `$DATA` every row begins with the name of its table.
    fn flysight2(&mut self, open: &mut Open<'_>, stem: &str) -> Result<(), LogError> {
        self.formats.push("FlySight 2 CSV".into());
        let first = self.topics.len();
        let mut by_name: HashMap<Vec<u8>, usize> = HashMap::new();
        while let Some((extent, line)) = self.accounting.next_record(open, b',')? {
            open.fields.split(open.lines.text(extent), b',');
            let tag = open.fields.get(0).strip_prefix(b"$").unwrap_or_default().to_vec();
            match tag.as_slice() {
                b"COL" if extent.ended => {
                    self.flysight2_table(&open.fields, stem, line, &mut by_name);
                    self.accounting.structure(open, extent);
                }
                b"VAR" => {
                    if self.accounting.health.extras.len() < EXTRAS {
                        self.accounting
                            .health
                            .extras
                            .push(open.fields.texts().get(1..).unwrap_or_default().join(" = "));
                    }
                    self.accounting.structure(open, extent);
                }
                b"UNIT" => {
                    let known = by_name.get(open.fields.get(1)).and_then(|&i| self.topics.get_mut(i));
                    let units = || open.fields.texts().into_iter().skip(2).collect();
                    known.into_iter().for_each(|topic| topic.units = units());
                    self.accounting.structure(open, extent);
                }
                b"FLYS" | b"DATA" | b"COL" => self.accounting.structure(open, extent),
                b"" if open.lines.text(extent).trim_ascii().is_empty() => self.accounting.structure(open, extent),
                _ => match by_name.get(&tag).and_then(|&i| self.topics.get_mut(i)) {
                    Some(topic) => self.accounting.row(open, extent, topic, 1, b',', false),
                    None => {
                        self.accounting.reject(open, extent, format!("line {line}: no $COL line announces this row"))
                    }
                },
            }
        }
        self.report(first, open.name);
        Ok(())
    }

    /// Reports problems with the cells of the topics from `first` on.
    fn report(&mut self, first: usize, file: &str) {
        for topic in self.topics.get_mut(first..).unwrap_or_default() {
            topic.report(file, self.context.limits.listed_damage, &mut self.accounting.notices);
        }
    }

    /// The topic that rows name. A new one is created with `columns` and the type `kind/name`; `None` if
    /// there are too many.
    fn named_topic(
        &mut self,
        name: &[u8],
        kind: &str,
        columns: impl FnOnce() -> Vec<String>,
        file: &str,
        by_name: &mut HashMap<Vec<u8>, usize>,
    ) -> Option<usize> {
        if let Some(known) = by_name.get(name) {
            return Some(*known);
        }
        if self.topics.len() >= self.context.limits.topics {
            return None;
        }
        let plain = fields::text_of(name).into_owned();
        let type_name = format!("{kind}/{plain}");
        let info = TopicInfo { name: self.free_name(plain, file), type_name, encoding: "csv".into() };
        let selection = self.want.select(&info);
        by_name.insert(name.to_vec(), self.topics.len());
        self.topics.push(Topic::new(info, columns(), &selection));
        Some(self.topics.len() - 1)
    }

    /// Reads rows that begin with a timestamp and the name of their table, as PX4 ECL replays its sensors. Columns are
    /// numbered.
    fn tagged(&mut self, open: &mut Open<'_>) -> Result<(), LogError> {
        self.formats.push("CSV, ',' delimited, no header, tables named by the second field".into());
        let first = self.topics.len();
        let mut by_name = HashMap::new();
        while let Some((extent, line)) = self.accounting.next_record(open, b',')? {
            if open.lines.text(extent).trim_ascii().is_empty() {
                self.accounting.structure(open, extent);
                continue;
            }
            open.fields.split(open.lines.text(extent), b',');
            let name = open.fields.get(1).to_vec();
            let width = open.fields.len();
            // A row truncated at the end of the log does not show the width of its table.
            let whole = extent.ended && name.iter().any(u8::is_ascii_alphabetic);
            let columns = || (1..=width).map(|i| format!("column_{i}")).collect();
            let known = by_name.get(&name).copied();
            let topic = if whole { self.named_topic(&name, "tagged", columns, open.name, &mut by_name) } else { known };
            match topic.and_then(|i| self.topics.get_mut(i)) {
                Some(topic) => self.accounting.row(open, extent, topic, 0, b',', false),
                None => self.accounting.reject(
                    open,
                    extent,
                    format!(
                        "line {line}: the second field is not the name of a \
                    table"
                    ),
                ),
            }
        }
        self.report(first, open.name);
        Ok(())
    }

    /// Reads NovAtel messages. Other lines between them, such as replies of the receiver, are skipped and counted.
    fn novatel(&mut self, open: &mut Open<'_>) -> Result<(), LogError> {
        self.formats.push("NovAtel ASCII".into());
        let first = self.topics.len();
        let mut by_name = HashMap::new();
        let mut others = 0;
        while let Some((extent, line)) = self.accounting.next_record(open, b',')? {
            let text = open.lines.text(extent).trim_ascii();
            if !text.starts_with(b"#") && !text.starts_with(b"%") {
                others += u64::from(!text.is_empty());
                self.accounting.structure(open, extent);
                continue;
            }
            let message = match novatel::parse(text) {
                Ok(message) => message,
                Err(what) => {
                    self.accounting.reject(open, extent, format!("line {line}: {what}"));
                    continue;
                }
            };
            let columns = || message.columns();
            let Some(topic) = self.named_topic(message.name.as_bytes(), "novatel", columns, open.name, &mut by_name)
            else {
                self.accounting.reject(open, extent, format!("line {line}: one topic too many"));
                continue;
            };
            open.fields.split(message.row.as_bytes(), b',');
            if let Some(topic) = self.topics.get_mut(topic) {
                self.accounting.message(open, extent, topic, line);
            }
        }
        if others > 0 {
            let text = "lines that are not NovAtel messages were skipped";
            self.accounting.notices.push(Code::Skipped, open.name, others, text);
        }
        self.report(first, open.name);
        Ok(())
    }

    /// A `$COL` line. One that repeats a known definition continues its table; one that gives a known
    /// table other columns starts another topic.
    fn flysight2_table(&mut self, fields: &Fields, stem: &str, line: u64, by_name: &mut HashMap<Vec<u8>, usize>) {
        let mut names = fields.texts();
        let mut name = names.get(1).cloned().unwrap_or_default();
        names.drain(..names.len().min(2));
        let names = layout::unique(names).0;
        match by_name.get(fields.get(1)).and_then(|&known| self.topics.get(known)) {
            Some(known) if known.names == names => return,
            Some(_) => name += &format!(" from line {line}"),
            None => {}
        }
        if self.topics.len() >= self.context.limits.topics {
            return;
        }
        let info = TopicInfo { name: self.free_name(name, stem), type_name: String::new(), encoding: "csv".into() };
        let selection = self.want.select(&info);
        by_name.insert(fields.get(1).to_vec(), self.topics.len());
        self.topics.push(Topic::new(info, names, &selection));
    }

    /// `name`, unless another table already has it.
    fn free_name(&mut self, name: String, file: &str) -> String {
        let mut free = name;
        while !self.taken.insert(free.clone()) {
            free = format!("{file}/{free}");
        }
        free
    }

    fn finish(mut self) -> Result<Log, LogError> {
        let others = self.formats.len().saturating_sub(1);
        let others = match others {
            0 => String::new(),
            1 => " (and 1 more file)".to_owned(),
            n => format!(" (and {n} more files)"),
        };
        self.accounting.health.format = format!("{}{others}", self.formats.first().map_or("no table", String::as_str));
        self.accounting.health.about.receiver_identities = of_table_head(&self.accounting.health.extras);
        self.topics.sort_by(|a, b| a.info.cmp(&b.info));
        self.accounting.health.topics = self.topics.iter().map(Topic::health).collect();
        self.accounting.health.messages = self.topics.iter().map(|t| t.rows).sum();
        self.accounting.ledger.finish(&mut self.accounting.health, &mut self.accounting.notices);
        let written = self.topics.iter().flat_map(Topic::written).collect();
        let heads = self.topics.iter().map(Topic::head).collect();
        let mut tables: Vec<Table> = self.topics.into_iter().filter_map(Topic::into_table).collect();
        for table in &mut tables {
            if let Some((device, selection)) = self.devices.get(&table.topic.name) {
                device.add_derived(table, selection, &mut self.accounting.notices);
            }
        }
        Ok(Log {
            health: self.accounting.health,
            tables,
            written,
            heads,
            notices: self.accounting.notices,
            ..Log::default()
        })
    }
}

impl Accounting {
    /// The next record that fits into memory, with its line number.
    fn next_record(&mut self, open: &mut Open<'_>, delimiter: u8) -> Result<Option<(Extent, u64)>, LogError> {
        loop {
            let (offset, line) = (open.lines.offset, open.lines.number);
            match open.lines.next(Some(delimiter))? {
                Next::Record(extent) => return Ok(Some((extent, line))),
                Next::TooLong => {
                    let (bytes, given_up) = open.lines.pass_too_long()?;
                    let limit = self.limits.line_bytes;
                    self.health.undecodable += 1;
                    if given_up {
                        let reason = format!("line {line}: zero bytes; nothing after them was read");
                        self.ledger.damaged(open.name, offset, open.size - offset, reason);
                        open.lines.offset = open.size;
                        return Ok(None);
                    }
                    self.ledger.damaged(open.name, offset, bytes, format!("line {line}: longer than {limit} bytes"));
                }
                Next::End => return Ok(None),
            }
        }
    }

    /// The next rows, as long as they are all regular.
    fn plain_rows(
        &mut self,
        open: &mut Open<'_>,
        topic: &mut Topic,
        rules: &mut Rules,
        workers: Option<&Workers>,
    ) -> Result<(), LogError> {
        loop {
            // The first rows show the column types.
            if let Some(workers) = workers.filter(|_| topic.rows > 0) {
                open.lines.read_ahead(workers, topic, rules)?;
            }
            let mut line = open.lines.number;
            let held = rules.rows(open.lines.plain_block(), |row, extent| {
                topic.push(row, 0, line, extent);
                line += 1;
            });
            open.lines.pass(held);
            let others = open.lines.take_rows(topic, rules)?;
            self.ledger.count(Fate::Decoded, (held.whole + others.map_or(0, |rows| rows.whole)) as u64);
            if others.is_none() {
                return Ok(());
            }
        }
    }

    /// Whether the record is a header, usually of another table: rows below that are not read. `open.fields` hold the
    /// record if the result is marked as split.
    fn other_header(
        &mut self,
        open: &mut Open<'_>,
        extent: Extent,
        topic: &mut Topic,
        header: &Header,
        findings: &mut HeaderFindings,
    ) -> RowOrHeader {
        let line = open.lines.number;
        let text = without_bom(open.lines.text(extent));
        let mark = comment_mark(text.trim_ascii_start());
        let names = if mark > 0 { unmarked(text.trim_ascii_start()) } else { text };
        if header.width() == 0 || extent.broken || (mark == 0 && !header.may_begin(names)) {
            return RowOrHeader::Row { is_split: false };
        }
        open.fields.split(names, header.delimiter);
        if !header.is_other_header(&open.fields) || (mark > 0 && !header.is_header_comment(&open.fields)) {
            let is_split = mark == 0 && names.len() == extent.text;
            if mark == 0 && header.looks_like_header(&open.fields) {
                findings.count_like_header(line);
            }
            return RowOrHeader::Row { is_split };
        }
        topic.is_below_other_header = !header.has_names(&open.fields);
        if topic.is_below_other_header {
            findings.count_other(line);
            self.reject(open, extent, format!("line {line}: another header"));
        } else {
            self.structure(open, extent);
        }
        RowOrHeader::Header
    }

    /// Reads a data row: the first `skip` fields are not columns. `open.fields` hold the row already if it `is_split`.
    fn row(
        &mut self,
        open: &mut Open<'_>,
        extent: Extent,
        topic: &mut Topic,
        skip: usize,
        delimiter: u8,
        is_split: bool,
    ) {
        let text = open.lines.text(extent);
        let line = open.lines.number;
        if !topic.decoded && self.limits.may_leave_closed {
            // Nothing is wanted, so the fields are not parsed.
            topic.count(extent);
            self.ledger.count(Fate::Skipped, extent.whole as u64);
            return open.lines.pass(extent);
        }
        if let Some(reason) = unusable(open, extent, topic) {
            return self.reject(open, extent, reason);
        }
        if !is_split {
            open.fields.split_with(text, delimiter, open.lines.may_hold_quotes());
        }
        let width = open.fields.len().saturating_sub(skip);
        if topic.fits(width, || open.fields.get(open.fields.len().saturating_sub(1)).is_empty()) {
            let fate = if topic.decoded {
                topic.push(open.fields.row(), skip, line, extent);
                Fate::Decoded
            } else {
                topic.count(extent);
                Fate::Skipped
            };
            self.ledger.count(fate, extent.whole as u64);
            return open.lines.pass(extent);
        }
        let extent = open.lines.first_line_of(extent);
        let expected = topic.width;
        let cut = if extent.ended { "" } else { ", and no line end: the log is truncated here" };
        let fields = if width == 1 { "field" } else { "fields" };
        self.reject(open, extent, format!("line {line}: {width} {fields}, but the header has {expected}{cut}"));
    }

    /// Reads a message. `open.fields` hold it already.
    fn message(&mut self, open: &mut Open<'_>, extent: Extent, topic: &mut Topic, line: u64) {
        if !topic.decoded {
            topic.count(extent);
            self.ledger.count(Fate::Skipped, extent.whole as u64);
        } else if topic.fits(open.fields.len(), || false) {
            // Its checksum is right, so it is not truncated.
            topic.push(open.fields.row(), 0, line, Extent { ended: true, ..extent });
            self.ledger.count(Fate::Decoded, extent.whole as u64);
        } else {
            let (width, expected) = (open.fields.len(), topic.names.len());
            let fields = if width == 1 { "field" } else { "fields" };
            return self.reject(
                open,
                extent,
                format!("line {line}: {width} {fields}, but the first row of this table has {expected}"),
            );
        }
        open.lines.pass(extent);
    }

    fn structure(&mut self, open: &mut Open<'_>, extent: Extent) {
        self.ledger.count(Fate::Structure, extent.whole as u64);
        open.lines.pass(extent);
    }

    fn reject(&mut self, open: &mut Open<'_>, extent: Extent, reason: String) {
        let (offset, length) = (open.lines.offset, extent.whole as u64);
        if extent.ended || offset + length < open.size {
            self.health.undecodable += 1;
            self.ledger.damaged(open.name, offset, length, reason);
        } else {
            self.health.undecodable += u64::from(self.ledger.cut(open.name, offset, length, reason));
        }
        open.lines.pass(extent);
    }
}

/// Why the cells of a row are not examined.
#[inline]
fn unusable(open: &Open<'_>, extent: Extent, topic: &Topic) -> Option<String> {
    let line = open.lines.number;
    if extent.broken {
        return Some(format!("line {line}: quotes that do not match"));
    }
    if topic.is_below_other_header {
        return Some(format!("line {line}: a row after another header"));
    }
    let has_zeros = open.lines.may_hold_zeros() && memchr::memchr(0, open.lines.text(extent)).is_some();
    has_zeros.then(|| format!("line {line}: zero bytes in the row"))
}

/// `name = text` of a comment `// name: text`.
fn remark_of(line: &[u8]) -> Option<String> {
    const LONGEST_OF_GARMIN: usize = 1000;
    let comment = line.get(comment_mark(line)..).filter(|comment| *comment != line)?;
    let longest = if comment.starts_with(GARMIN.as_bytes()) { LONGEST_OF_GARMIN } else { LONGEST_REMARK };
    let comment = std::str::from_utf8(comment).ok().filter(|comment| comment.len() <= longest)?;
    let of_garmin = comment.strip_prefix(GARMIN).map(|rest| (GARMIN, rest.trim_start_matches(',')));
    let (name, text) = of_garmin.or_else(|| comment.split_once(':'))?;
    let (name, text) = (name.trim(), text.trim());
    (!name.is_empty() && !text.is_empty()).then(|| format!("{name} = {text}"))
}

/// The start of a file: enough for the layout, even if its first line is long.
fn head_of(file: &File, name: &str, context: &ReadContext<'_>) -> Result<Vec<u8>, LogError> {
    let mut head = vec![];
    let read = |bytes: u64, head: &mut Vec<u8>| {
        let offset = head.len() as u64;
        file.take(bytes)
            .read_to_end(head)
            .map_err(|source| LogError::Read(ScanError::Io { file: name.to_owned(), offset, source }))
    };
    read(HEAD, &mut head)?;
    if memchr::memchr2(b'\n', b'\r', &head).is_none() {
        read(context.limits.line_bytes as u64, &mut head)?;
    }
    Ok(head)
}
