//! Channels or topics of a log as tables.

mod channel_sheet;
mod folder;
mod provenance;
mod tables_map;

use self::folder::Folder;
pub(crate) use self::provenance::about_tie;
use self::provenance::{Head, Provenance, Sheets};
pub use self::tables_map::TABLES_MAP;
use self::tables_map::TablesMap;
use crate::error::ConvertError;
use crate::guard::{Unchanged, may_write};
use crate::message_type::MessageType;
use crate::output::Output;
use crate::recording::{Entry, Recording};
use crate::row_time::{self, LogTime, LogTimes, RowTime};
use crate::sheet::{Cells, Sheet, SheetColumn, with_zero_bytes, write_csv, write_parquet_about};
use flight::{Binding, Clock, Code, Flight, LogHealth, Notices, Severity, UtcTie};
use ingest::{
    Column, ColumnData, Extra, FlightUnit, IngestError, LeftOut, Log, MapLibrary, ReadContext, Table, TopicInfo,
    Values, load,
};
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::io::{self, Write};
use std::path::Path;

/// Name of the metadata in an MCAP and in Parquet.
const METADATA: &str = "flightlag-export";

/// Rows written between two checks for a stop request.
pub(crate) const ROWS_AT_ONCE: usize = 4096;

/// What to export.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExportWhat {
    /// The channels that a map binds: SI units (angles of positions in degrees), checked timestamps.
    Channels,
    /// Every topic with every field, unconverted.
    Topics,
}

/// Output format.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExportTo {
    /// One Parquet file for each channel or topic, in a folder.
    Parquet,
    /// One CSV file for each, in a folder.
    Csv,
    /// One MCAP file with a typed topic for each.
    Mcap,
}

/// An export request.
#[derive(Debug, Clone, Copy)]
pub struct ExportOrder<'a> {
    /// The log.
    pub unit: &'a FlightUnit,
    /// Channel maps to choose from.
    pub library: &'a MapLibrary,
    /// The map, if it is not to be chosen by content.
    pub map: Option<&'a str>,
    /// What to export.
    pub what: ExportWhat,
    /// Output format.
    pub to: ExportTo,
    /// The folder, or with [`ExportTo::Mcap`] the file.
    pub out: &'a Path,
    /// The command that repeats the export, for the provenance.
    pub command: &'a str,
}

/// The result of an export.
#[derive(Debug)]
pub struct Exported {
    /// Files or topics written.
    pub sheets: Vec<ExportedSheet>,
    /// How the log was read.
    pub health: LogHealth,
    /// What was lost or assumed on the way.
    pub notices: Notices,
}

/// One file or topic written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ExportedSheet {
    /// Channel or topic.
    pub name: String,
    /// File name in the folder, or topic of the MCAP.
    pub place: String,
    /// Rows.
    pub rows: u64,
    /// Columns.
    pub columns: u64,
}

/// Descriptions of columns, by name.
type About = BTreeMap<String, Value>;

/// A sheet with its source.
struct Source {
    name: String,
    sheet: Sheet,
    columns: About,
    about: Value,
    /// Time of each row, ns, for an MCAP; `log_time_how` describes it.
    log_time: Vec<i64>,
    log_time_how: String,
}

/// What was read for an export.
struct Read {
    /// Channels or topics, in the order in which they are written.
    names: Vec<String>,
    /// One at a time: memory is freed after writing, so that a log of very many topics needs no more than its columns.
    sources: Box<dyn Iterator<Item = Source>>,
    health: LogHealth,
    notices: Notices,
    binding: Option<Binding>,
    /// UTC tie of a log clock that does not know UTC.
    utc: Option<UtcTie>,
}

/// Writes channels or topics. Tables come with a `provenance.json` with the log's hashes, the map, units, clocks and
/// all notices. An MCAP holds the same as metadata `flightlag-export`, a Parquet file its part under that key. The
/// log's own clock stays unchanged. Where its UTC is known, tables add it as `utc_ns`, and an MCAP uses it as log time.
///
/// Channels as CSV come with a map that reads the tables again, [`TABLES_MAP`].
///
/// The files of an export appear together and replace those of an earlier export. Other files in the folder stay.
///
/// # Errors
/// [`ConvertError::Log`] also if the log changed while it was read, [`ConvertError::Nothing`] if no map fits or nothing
/// was decoded, [`ConvertError::Refused`] if an output is a file of the log or not a regular file,
/// [`ConvertError::Write`]. Nothing of this export is left then.
pub fn export(order: &ExportOrder<'_>, context: &ReadContext<'_>) -> Result<Exported, ConvertError> {
    if order.to == ExportTo::Mcap {
        may_write(order.out, &order.unit.files)?;
    }
    let unchanged = Unchanged::of(&order.unit.files)?;
    let mut read = match order.what {
        ExportWhat::Channels => channels(order, context)?,
        ExportWhat::Topics => topics(order, context)?,
    };
    if read.names.is_empty() {
        let what = format!("{}: nothing in it could be decoded", order.unit.id);
        return Err(ConvertError::Nothing(what));
    }
    let places = places(&read.names, order.to);
    let sheets = match order.to {
        ExportTo::Parquet | ExportTo::Csv => write_folder(order, &mut read, &places, &unchanged, context)?,
        ExportTo::Mcap => write_mcap(order, &mut read, &places, &unchanged, context)?,
    };
    Ok(Exported { sheets, health: read.health, notices: read.notices })
}

fn channels(order: &ExportOrder<'_>, context: &ReadContext<'_>) -> Result<Read, ConvertError> {
    let loaded = load(order.unit, order.library, order.map, context)?;
    let binding = loaded.binding.map_err(|reason| {
        ConvertError::Nothing(format!(
            "{}: {reason}. `--topics` exports the topics of the log, unconverted",
            order.unit.id
        ))
    })?;
    let Flight { channels, notices, utc } = loaded.flight;
    let names = channels.keys().cloned().collect();
    let tie = utc.clone();
    let zeros = channel_sheet::zeros(channels.values());
    let to = order.to;
    let source = move |(name, channel)| channel_sheet::source(name, channel, to, &zeros, tie.as_ref());
    let sources = Box::new(channels.into_iter().map(source));
    Ok(Read { names, sources, health: loaded.health, notices, binding: Some(binding), utc })
}

fn topics(order: &ExportOrder<'_>, context: &ReadContext<'_>) -> Result<Read, ConvertError> {
    let mut log = ingest::read(order.unit, &order.library.select_all(), context)?;
    note_left_out(&mut log);
    note_empty(&mut log);
    let log_times = row_time::of_log(&log, order.library)?;
    log_times.note(&mut log.notices);
    let LogTimes { tables: times, utc, .. } = log_times;
    // No longer needed.
    log.health.topics.iter_mut().for_each(|topic| topic.stamps = vec![]);
    if order.to == ExportTo::Mcap {
        let log_times: Vec<LogTime> = times.iter().map(RowTime::in_utc).collect();
        let names = log.tables.iter().map(|table| table.topic.name.as_str());
        row_time::report(names.zip(&log_times), &mut log.notices);
    }
    let names = log.tables.iter().map(|table| table.topic.name.clone()).collect();
    let stated: StatedUnits = log.units.into_iter().map(|u| ((u.type_name, u.path), u.text)).collect();
    let to = order.to;
    let source = move |(table, time): (Table, RowTime)| topic_source(table, &time, to, &stated);
    let sources = Box::new(log.tables.into_iter().zip(times).map(source));
    Ok(Read { names, sources, health: log.health, notices: log.notices, binding: None, utc })
}

/// Reports which fields are in no column; if there are very many, the first ones and the number of the others.
fn note_left_out(log: &mut Log) {
    const LISTED: usize = 200;
    let what = Code::NotWritten.at(Severity::Warning);
    for LeftOut { topic, fields, names } in log.left_out.iter().take(LISTED) {
        let text = format!("fields without a column, because they are variable-length or too long: {names}");
        log.notices.push(what, format!("topic {topic}"), *fields, text);
    }
    let others = log.left_out.len().saturating_sub(LISTED) as u64;
    if others > 0 {
        log.notices.push(what, "", others, "more topics have fields without a column");
    }
}

/// Reports which topics have no table because the log has no messages of them.
fn note_empty(log: &mut Log) {
    const LISTED: usize = 10;
    let empty: Vec<&str> = log.health.topics.iter().filter(|t| t.messages == 0).map(|t| t.name.as_str()).collect();
    if let Some(listed) = empty.get(..empty.len().min(LISTED)).filter(|listed| !listed.is_empty()) {
        let more = if empty.len() > LISTED { ", ..." } else { "" };
        let text = format!("topics without messages have no table: {}{more}", listed.join(", "));
        log.notices.push(Code::NoRows, "", empty.len() as u64, text);
    }
}

/// Reports zero bytes, which a text table cannot hold.
fn note_zero_bytes(source: &Source, notices: &mut Notices) {
    let texts = with_zero_bytes(&source.sheet);
    if texts > 0 {
        let text = "zero bytes in texts were replaced by \u{2400}, because CSV cannot hold them";
        notices.push(Code::ValuesReplaced.at(Severity::Warning), format!("topic {}", source.name), texts, text);
    }
}

/// The units that the log states, by type and field.
type StatedUnits = HashMap<(String, String), String>;

fn topic_source(table: Table, time: &RowTime, to: ExportTo, units: &StatedUnits) -> Source {
    let log_time_how = time.how_in_utc();
    let log_time = if to == ExportTo::Mcap { time.in_utc().nanos } else { vec![] };
    let utc = time.utc_beside().map(|_| log_time_how.as_str());
    let about = json!({ "type": table.topic.type_name, "encoding": table.topic.encoding, "utc": utc });
    let mut columns = About::new();
    let name = table.topic.name.clone();
    let sheet = table_sheet(table, time, to, units, &mut columns);
    Source { name, sheet, columns, about, log_time, log_time_how }
}

/// The container's timestamps, UTC if they are not UTC, then the fields under their own names.
fn table_sheet(table: Table, time: &RowTime, to: ExportTo, units: &StatedUnits, about: &mut About) -> Sheet {
    const UTC: &str = "utc_ns";
    let mut sheet = Sheet::default();
    let mut taken = BTreeSet::new();
    let nanos = |stamps: &[i64]| Cells::I64(stamps.to_vec().into());
    if let Some(logged) = &table.logged_ns {
        sheet.push(free(&mut taken, "logged_ns", str::to_owned), nanos(logged));
    }
    if let Some(published) = &table.published_ns {
        sheet.push(free(&mut taken, "published_ns", str::to_owned), nanos(published));
    }
    if let Some(utc) = time.utc_beside().filter(|_| table.column(UTC).is_none()) {
        let name = free(&mut taken, UTC, str::to_owned);
        about.insert(name.clone(), json!({ "unit": "ns", "clock": Clock::Unix, "added": true }));
        sheet.push(name, Cells::I64(utc.clone()));
    }
    for column in table.columns {
        let name = free(&mut taken, &column.path, str::to_owned);
        let unit = units.get(&(table.topic.type_name.clone(), column.path.clone()));
        let cells = cells(column, table.rows);
        let cells = if to == ExportTo::Csv { cells.whole() } else { cells };
        if let Some(unit) = unit {
            about.insert(name.clone(), json!({ "unit": unit }));
        }
        sheet.push(name, cells);
    }
    sheet
}

fn cells(column: Column, rows: usize) -> Cells {
    match column.data {
        ColumnData::F64(_) => Cells::F64((0..rows).map(|row| column.number(row)).collect()),
        ColumnData::I64(_) => Cells::I64((0..rows).map(|row| column.integer(row)).collect()),
        ColumnData::U64(_) => Cells::U64((0..rows).map(|row| column.unsigned(row)).collect()),
        ColumnData::Text(_) => Cells::Text((0..rows).map(|row| column.text(row)).collect()),
    }
}

/// A unique file name or MCAP topic for each source; file names also differ without regard to case.
fn places(names: &[String], to: ExportTo) -> Vec<String> {
    let mut taken = BTreeSet::new();
    let place = |name: &String| match ending(to) {
        None => free(&mut taken, name, str::to_owned),
        Some(ending) => free(&mut taken, &file_stem(name), str::to_lowercase) + ending,
    };
    names.iter().map(place).collect()
}

fn ending(to: ExportTo) -> Option<&'static str> {
    match to {
        ExportTo::Parquet => Some(".parquet"),
        ExportTo::Csv => Some(".csv"),
        ExportTo::Mcap => None,
    }
}

/// `name`, with a number appended if its `key` is already taken.
fn free(taken: &mut BTreeSet<String>, name: &str, key: fn(&str) -> String) -> String {
    let mut free = name.to_owned();
    let mut count = 1;
    while !taken.insert(key(&free)) {
        count += 1;
        free = format!("{name}~{count}");
    }
    free
}

/// A name that every file system accepts and that cannot leave its folder.
fn file_stem(name: &str) -> String {
    const LONGEST: usize = 120;
    let plain = |c: char| if c.is_ascii_alphanumeric() || ".-_".contains(c) { c } else { '-' };
    let stem: String = name.trim_matches('/').chars().map(plain).take(LONGEST).collect();
    let stem = stem.trim_start_matches(['.', '-']).trim_end_matches('.');
    match stem {
        "" => "unnamed".to_owned(),
        stem if is_device(stem) => format!("topic-{stem}"),
        stem => stem.to_owned(),
    }
}

/// Names that Windows takes for a device, whatever the file extension.
fn is_device(stem: &str) -> bool {
    let first = stem.split('.').next().unwrap_or_default().to_ascii_lowercase();
    let numbered =
        |of: &str| first.strip_prefix(of).is_some_and(|n| n.len() == 1 && n.starts_with(|c: char| c.is_ascii_digit()));
    matches!(first.as_str(), "con" | "prn" | "aux" | "nul") || numbered("com") || numbered("lpt")
}

fn write_folder(
    order: &ExportOrder<'_>,
    read: &mut Read,
    places: &[String],
    unchanged: &Unchanged,
    context: &ReadContext<'_>,
) -> Result<Vec<ExportedSheet>, ConvertError> {
    let mut folder = Folder::begin(order.out, places, &order.unit.files)?;
    let head = Head::of(order, read, unchanged, context)?;
    let mut sheets = Sheets::default();
    let mut map = TablesMap::new(&order.unit.id);
    for (source, place) in read.sources.by_ref().zip(places) {
        context.advance(0).map_err(IngestError::from)?;
        if order.to == ExportTo::Csv {
            note_zero_bytes(&source, &mut read.notices);
        }
        let about = sheets.add(&source, place, order.to);
        map.add(&source, place);
        folder.write(place, context, |file| match order.to {
            ExportTo::Csv => write_csv(&source.sheet, file),
            _ => write_parquet_about(&source.sheet, &[(METADATA.to_owned(), head.of_sheet(&about))], file),
        })?;
    }
    if order.to == ExportTo::Csv && order.what == ExportWhat::Channels {
        folder.write(TABLES_MAP, context, |file| file.write_all(map.finish().as_bytes()))?;
    }
    folder.keep(&Provenance::of(&head, read, &sheets), context)?;
    Ok(sheets.exported)
}

fn write_mcap(
    order: &ExportOrder<'_>,
    read: &mut Read,
    places: &[String],
    unchanged: &Unchanged,
    context: &ReadContext<'_>,
) -> Result<Vec<ExportedSheet>, ConvertError> {
    let output = Output::begin(order.out)?;
    let mut recording = Recording::begin(order.out, output.file()?, "")?;
    let mut sheets = Sheets::default();
    for (source, place) in read.sources.by_ref().zip(places) {
        sheets.add(&source, place, order.to);
        write_topic(&mut recording, source, place, &mut read.notices, context)?;
    }
    recording.note_before_epoch(&mut read.notices);
    // After the messages: it includes what was found while writing them.
    let head = Head::of(order, read, unchanged, context)?;
    let provenance = serde_json::to_string(&Provenance::of(&head, read, &sheets));
    let provenance = provenance.map_err(|e| ConvertError::write(order.out, "write")(io::Error::other(e)))?;
    let exported = sheets.exported;
    recording.metadata(METADATA, [("provenance".to_owned(), provenance)].into())?;
    recording.end()?;
    output.keep()?;
    Ok(exported)
}

fn write_topic(
    recording: &mut Recording,
    source: Source,
    place: &str,
    notices: &mut Notices,
    context: &ReadContext<'_>,
) -> Result<(), ConvertError> {
    let Source { sheet, log_time, log_time_how, .. } = source;
    let table = as_table(sheet, TopicInfo { name: place.to_owned(), ..TopicInfo::default() });
    let kind = MessageType::of(&table, vec![]);
    kind.note_absent(notices);
    let topic = kind.topic();
    recording.extra(&Extra::OfTopic { topic: place, entries: &[("log_time".to_owned(), log_time_how)].into() })?;
    let mut payload = vec![];
    for (row, logged_ns) in log_time.into_iter().enumerate() {
        if row.is_multiple_of(ROWS_AT_ONCE) {
            context.advance(0).map_err(IngestError::from)?;
        }
        kind.payload(row, &mut payload);
        recording.write(&Entry {
            topic: &topic,
            original: None,
            encoding: "cdr",
            schema_encoding: "ros2msg",
            schema: kind.definition(),
            logged_ns,
            published_ns: None,
            sequence: None,
            payload: &payload,
        })?;
    }
    recording.forget(&topic);
    Ok(())
}

fn as_table(sheet: Sheet, topic: TopicInfo) -> Table {
    let rows = sheet.rows();
    let column = |c: SheetColumn| {
        let (data, valid) = match c.cells {
            Cells::I64(v) => of_parts(v, ColumnData::I64),
            Cells::U64(v) => of_parts(v, ColumnData::U64),
            Cells::F64(v) => of_parts(v, ColumnData::F64),
            Cells::Text(v) => {
                let (texts, given) = v.into_parts();
                (ColumnData::Text(texts), given)
            }
        };
        Column { path: c.name, data, valid }
    };
    Table {
        topic,
        rows,
        logged_ns: None,
        published_ns: None,
        origin: ingest::Places::default(),
        columns: sheet.columns.into_iter().map(column).collect(),
    }
}

fn of_parts<T: Copy + Default>(values: Values<T>, data: fn(Vec<T>) -> ColumnData) -> (ColumnData, Option<Vec<bool>>) {
    let (values, valid) = values.into_parts();
    (data(values), valid)
}
