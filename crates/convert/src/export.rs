//! Channels or topics of a log as tables.

use crate::error::ConvertError;
use crate::message_type::MessageType;
use crate::output::Output;
use crate::recording::{Entry, Recording};
use crate::sheet::{Cells, Sheet, write_csv, write_parquet};
use flight::{Binding, Channel, Flight, LogHealth, Notices, Quantity, Stamp};
use ingest::{Column, ColumnData, Extra, FlightUnit, MapLibrary, ReadContext, Selection, Table, TopicInfo, load};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::io::{self, BufWriter, Write};
use std::path::Path;

/// Written last: a folder with it is whole.
const PROVENANCE: &str = "provenance.json";

/// What is exported.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExportWhat {
    /// The channels that a map binds: SI units (angles of places in degrees), checked stamps.
    Channels,
    /// Every topic with every field, as it stands in the log.
    Topics,
}

/// As what.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExportTo {
    /// One Parquet file for each channel or topic, in a folder.
    Parquet,
    /// One CSV file for each, in a folder.
    Csv,
    /// One MCAP file with a typed topic for each.
    Mcap,
}

/// An export that is wanted.
#[derive(Debug, Clone, Copy)]
pub struct ExportOrder<'a> {
    /// The log.
    pub unit: &'a FlightUnit,
    /// Channel maps to choose from.
    pub library: &'a MapLibrary,
    /// The map, if it is not to be found by content.
    pub map: Option<&'a str>,
    /// What.
    pub what: ExportWhat,
    /// As what.
    pub to: ExportTo,
    /// Folder, or with [`ExportTo::Mcap`] the file.
    pub out: &'a Path,
    /// Command that makes it again, for the provenance.
    pub command: &'a str,
}

/// What was exported.
#[derive(Debug)]
pub struct Exported {
    /// Files or topics written.
    pub sheets: Vec<ExportedSheet>,
    /// How the log was read.
    pub health: LogHealth,
    /// What was lost or assumed.
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

/// A sheet with where it came from.
struct Source {
    name: String,
    sheet: Sheet,
    about: Value,
}

/// Writes channels or topics. Tables of an earlier export in the folder are removed, other files stay. Beside tables stands `provenance.json` with the log's hashes, the map, units, clocks and
/// all notices; an MCAP holds the same as metadata `flightlag-export`.
///
/// # Errors
/// [`ConvertError::Log`], [`ConvertError::Nothing`] if no map fits or nothing was decoded, [`ConvertError::Write`].
pub fn export(order: &ExportOrder<'_>, context: &ReadContext<'_>) -> Result<Exported, ConvertError> {
    let (sources, health, notices, binding) = match order.what {
        ExportWhat::Channels => channels(order, context)?,
        ExportWhat::Topics => topics(order, context)?,
    };
    if sources.is_empty() {
        let what = format!("{}: nothing in it could be decoded", order.unit.id);
        return Err(ConvertError::Nothing(what));
    }
    let places = places(&sources, order.to);
    let provenance = provenance(order, &sources, &places, &health, &notices, binding.as_ref())?;
    match order.to {
        ExportTo::Parquet | ExportTo::Csv => write_folder(order, &sources, &places, &provenance)?,
        ExportTo::Mcap => write_mcap(order, &sources, &places, &provenance)?,
    }
    let sheet = |(source, place): (&Source, &String)| ExportedSheet {
        name: source.name.clone(),
        place: place.clone(),
        rows: source.sheet.rows() as u64,
        columns: source.sheet.columns.len() as u64,
    };
    Ok(Exported { sheets: sources.iter().zip(&places).map(sheet).collect(), health, notices })
}

type Read = (Vec<Source>, LogHealth, Notices, Option<Binding>);

fn channels(order: &ExportOrder<'_>, context: &ReadContext<'_>) -> Result<Read, ConvertError> {
    let loaded = load(order.unit, order.library, order.map, context)?;
    let binding = loaded.binding.map_err(|reason| {
        ConvertError::Nothing(format!(
            "{}: {reason}. `--topics` exports what the log holds as it stands",
            order.unit.id
        ))
    })?;
    let Flight { channels, notices, .. } = loaded.flight;
    let source = |(name, channel): (&String, &Channel)| Source {
        name: name.clone(),
        sheet: channel_sheet(channel),
        about: json!({
            "quantity": channel.quantity,
            "topic": channel.source.topic,
            "type": channel.source.type_name,
            "fields": channel.source.fields,
            "clock": channel.series.timeline().clock(),
            "stamps": channel.series.timeline().kind(),
        }),
    };
    Ok((channels.iter().map(source).collect(), loaded.health, notices, Some(binding)))
}

fn topics(order: &ExportOrder<'_>, context: &ReadContext<'_>) -> Result<Read, ConvertError> {
    let log = ingest::open(order.unit).read(&|_: &TopicInfo| Selection::All, context)?;
    let source = |table: &Table| Source {
        name: table.topic.name.clone(),
        sheet: table_sheet(table),
        about: json!({ "type": table.topic.type_name, "encoding": table.topic.encoding }),
    };
    Ok((log.tables.iter().map(source).collect(), log.health, log.notices, None))
}

/// Stamps, seconds since the first, components with their units, and 1 where a value was held since an earlier row.
fn channel_sheet(channel: &Channel) -> Sheet {
    let mut sheet = Sheet::default();
    let timeline = channel.series.timeline();
    let nanos = |stamps: &[Stamp]| Cells::I64(stamps.iter().map(|s| Some(s.0)).collect());
    sheet.push(format!("{}_ns", timeline.kind()), nanos(timeline.stamps()));
    let origin = timeline.first().unwrap_or(Stamp(0));
    sheet.push("t_s", Cells::F64(timeline.seconds_since(origin).into_iter().map(Some).collect()));
    for (kind, _, stamps) in &channel.other_stamps {
        sheet.push(format!("{kind}_ns"), nanos(stamps));
    }
    let components = channel.quantity.components().iter().zip(&channel.present).enumerate();
    for (k, (name, _)) in components.filter(|(_, (_, present))| **present) {
        let (unit, scale) = unit(channel.quantity, name);
        let values = channel.series.component(k).iter().map(|x| Some(x * scale)).collect();
        sheet.push(format!("{name}{unit}"), Cells::F64(values));
    }
    if channel.is_held() {
        sheet.push("held", Cells::I64(channel.held.iter().map(|h| Some(i64::from(*h))).collect()));
    }
    sheet
}

/// The end of a component's name, and what its SI value is multiplied by.
fn unit(quantity: Quantity, component: &str) -> (&'static str, f64) {
    match (quantity, component) {
        (Quantity::PositionGeodetic, "latitude" | "longitude") => ("_deg", 180.0 / std::f64::consts::PI),
        (Quantity::PositionGeodetic | Quantity::PositionNed | Quantity::Height, _) => ("_m", 1.0),
        (Quantity::VelocityNed, _) => ("_mps", 1.0),
        (Quantity::AngularRate, _) => ("_radps", 1.0),
        (Quantity::SpecificForce, _) => ("_mps2", 1.0),
        (Quantity::MagneticField, _) => ("_nt", 1e9),
        (Quantity::EncoderAngle, _) => ("_rad", 1.0),
        (Quantity::Pulse, _) => ("_s", 1.0),
        _ => ("", 1.0),
    }
}

/// The container's stamps, then the fields by their own names.
fn table_sheet(table: &Table) -> Sheet {
    let mut sheet = Sheet::default();
    let mut taken = BTreeSet::new();
    let nanos = |stamps: &[i64]| Cells::I64(stamps.iter().copied().map(Some).collect());
    if let Some(logged) = &table.logged_ns {
        sheet.push(free(&mut taken, "logged_ns", str::to_owned), nanos(logged));
    }
    if let Some(published) = &table.published_ns {
        sheet.push(free(&mut taken, "published_ns", str::to_owned), nanos(published));
    }
    for column in &table.columns {
        sheet.push(free(&mut taken, &column.path, str::to_owned), cells(column, table.rows));
    }
    sheet
}

fn cells(column: &Column, rows: usize) -> Cells {
    match column.data {
        ColumnData::F64(_) => Cells::F64((0..rows).map(|row| column.number(row)).collect()),
        ColumnData::I64(_) => Cells::I64((0..rows).map(|row| column.integer(row)).collect()),
        ColumnData::Text(_) => Cells::Text((0..rows).map(|row| column.text(row).map(str::to_owned)).collect()),
    }
}

/// A file name for each source, or its topic: no two are the same; those of files not even in capitals.
fn places(sources: &[Source], to: ExportTo) -> Vec<String> {
    let mut taken = BTreeSet::new();
    let place = |source: &Source| match ending(to) {
        None => free(&mut taken, &source.name, str::to_owned),
        Some(ending) => free(&mut taken, &file_stem(&source.name), str::to_lowercase) + ending,
    };
    sources.iter().map(place).collect()
}

fn ending(to: ExportTo) -> Option<&'static str> {
    match to {
        ExportTo::Parquet => Some(".parquet"),
        ExportTo::Csv => Some(".csv"),
        ExportTo::Mcap => None,
    }
}

/// `name`, with a number behind it if there is one that is the same by `key`.
fn free(taken: &mut BTreeSet<String>, name: &str, key: fn(&str) -> String) -> String {
    let mut free = name.to_owned();
    let mut count = 1;
    while !taken.insert(key(&free)) {
        count += 1;
        free = format!("{name}~{count}");
    }
    free
}

/// A name that every file system takes and that stays in its folder.
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

/// What Windows takes for a device, whatever ends the name.
fn is_device(stem: &str) -> bool {
    let first = stem.split('.').next().unwrap_or_default().to_ascii_lowercase();
    let numbered =
        |of: &str| first.strip_prefix(of).is_some_and(|n| n.len() == 1 && n.starts_with(|c: char| c.is_ascii_digit()));
    matches!(first.as_str(), "con" | "prn" | "aux" | "nul") || numbered("com") || numbered("lpt")
}

fn provenance(
    order: &ExportOrder<'_>,
    sources: &[Source],
    places: &[String],
    health: &LogHealth,
    notices: &Notices,
    binding: Option<&Binding>,
) -> Result<Value, ConvertError> {
    let input = |path: &Path| -> io::Result<Value> {
        let mut hash = blake3::Hasher::new();
        let bytes = io::copy(&mut std::fs::File::open(path)?, &mut hash)?;
        let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
        Ok(json!({ "name": name, "bytes": bytes, "blake3": hash.finalize().to_hex().as_str() }))
    };
    let inputs: Vec<Value> = order
        .unit
        .files
        .iter()
        .map(|path| input(path).map_err(ConvertError::write(path, "read")))
        .collect::<Result<_, _>>()?;
    let sheet = |(source, place): (&Source, &String)| {
        json!({
            "name": source.name,
            "place": place,
            "rows": source.sheet.rows(),
            "columns": source.sheet.columns.iter().map(|c| c.name.as_str()).collect::<Vec<_>>(),
            "from": source.about,
        })
    };
    Ok(json!({
        "made_by": concat!("flightlag ", env!("CARGO_PKG_VERSION")),
        "command": order.command,
        "inputs": inputs,
        "format": health.format,
        "bytes": health.bytes,
        "damage": health.damage,
        "map": binding.map(|b| json!({ "name": b.map, "why": b.why })),
        "sheets": sources.iter().zip(places).map(sheet).collect::<Vec<_>>(),
        "notices": notices,
    }))
}

fn write_folder(
    order: &ExportOrder<'_>,
    sources: &[Source],
    places: &[String],
    provenance: &Value,
) -> Result<(), ConvertError> {
    std::fs::create_dir_all(order.out).map_err(ConvertError::write(order.out, "make this folder"))?;
    remove_earlier(order.out)?;
    for (source, place) in sources.iter().zip(places) {
        write_file(&order.out.join(place), |file| match order.to {
            ExportTo::Csv => write_csv(&source.sheet, file),
            _ => caught(|| write_parquet(&source.sheet, file)),
        })?;
    }
    write_file(&order.out.join(PROVENANCE), |file| {
        serde_json::to_writer_pretty(&mut *file, provenance)?;
        file.write_all(b"\n")
    })
}

/// Whether this can be a table that was exported: [`file_stem`] and [`free`] leave nothing that leads elsewhere.
fn is_table(stem: &str, ending: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || ".-_~".contains(c);
    ["csv", "parquet"].contains(&ending) && !stem.starts_with('.') && stem.chars().all(plain)
}

/// The tables of an earlier export would look like part of this one. Only what its provenance lists goes, and only
/// tables in this folder.
fn remove_earlier(folder: &Path) -> Result<(), ConvertError> {
    let provenance = folder.join(PROVENANCE);
    let Ok(text) = std::fs::read_to_string(&provenance) else { return Ok(()) };
    let earlier: Value = serde_json::from_str(&text).unwrap_or_default();
    std::fs::remove_file(&provenance).map_err(ConvertError::write(&provenance, "remove"))?;
    for sheet in earlier["sheets"].as_array().into_iter().flatten() {
        let Some((stem, ending)) = sheet["place"].as_str().and_then(|place| place.rsplit_once('.')) else { continue };
        let table = folder.join(format!("{stem}.{ending}"));
        if !is_table(stem, ending) {
            continue;
        }
        match std::fs::remove_file(&table) {
            Err(e) if e.kind() != io::ErrorKind::NotFound => return Err(ConvertError::write(&table, "remove")(e)),
            _ => {}
        }
    }
    Ok(())
}

fn write_file(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<std::fs::File>) -> io::Result<()>,
) -> Result<(), ConvertError> {
    let output = Output::begin(path)?;
    let mut file = BufWriter::new(output.file()?);
    fill(&mut file).and_then(|()| file.flush()).map_err(ConvertError::write(path, "write"))?;
    output.keep()
}

/// A panic within polars is an error.
fn caught(work: impl FnOnce() -> io::Result<()>) -> io::Result<()> {
    let panicked = |_| Err(io::Error::other("the writer of Parquet panicked"));
    std::panic::catch_unwind(std::panic::AssertUnwindSafe(work)).unwrap_or_else(panicked)
}

fn write_mcap(
    order: &ExportOrder<'_>,
    sources: &[Source],
    places: &[String],
    provenance: &Value,
) -> Result<(), ConvertError> {
    let output = Output::begin(order.out)?;
    let mut recording = Recording::begin(order.out, output.file()?, "")?;
    let entries = [("provenance".to_owned(), provenance.to_string())].into();
    recording.extra(&Extra::Metadata { name: "flightlag-export", entries: &entries })?;
    for (source, place) in sources.iter().zip(places) {
        write_topic(&mut recording, source, place)?;
    }
    recording.end()?;
    output.keep()
}

/// Rows are logged at their first stamp; rows without one at 0.
fn write_topic(recording: &mut Recording, source: &Source, place: &str) -> Result<(), ConvertError> {
    let stamps = source.sheet.columns.iter().find_map(|c| match &c.cells {
        Cells::I64(v) if c.name.ends_with("_ns") => Some(v),
        _ => None,
    });
    let table = as_table(&source.sheet, TopicInfo { name: place.to_owned(), ..TopicInfo::default() });
    let kind = MessageType::of(&table);
    let topic = kind.topic();
    let mut payload = vec![];
    for row in 0..table.rows {
        kind.payload(row, &mut payload);
        recording.write(&Entry {
            topic: &topic,
            encoding: "cdr",
            schema_encoding: "ros2msg",
            schema: kind.definition(),
            logged_ns: stamps.and_then(|s| s.get(row).copied().flatten()).unwrap_or_default(),
            published_ns: None,
            payload: &payload,
        })?;
    }
    Ok(())
}

fn as_table(sheet: &Sheet, topic: TopicInfo) -> Table {
    let column = |c: &crate::sheet::SheetColumn| {
        let (data, valid) = match &c.cells {
            Cells::I64(v) => (ColumnData::I64(v.iter().map(|x| x.unwrap_or_default()).collect()), validity(v)),
            Cells::F64(v) => (ColumnData::F64(v.iter().map(|x| x.unwrap_or(f64::NAN)).collect()), validity(v)),
            Cells::Text(v) => {
                (ColumnData::Text(v.iter().map(|x| x.clone().unwrap_or_default()).collect()), validity(v))
            }
        };
        Column { path: c.name.clone(), data, valid: Some(valid) }
    };
    Table {
        topic,
        rows: sheet.rows(),
        logged_ns: None,
        published_ns: None,
        origin: None,
        columns: sheet.columns.iter().map(column).collect(),
    }
}

fn validity<T>(cells: &[Option<T>]) -> Vec<bool> {
    cells.iter().map(Option::is_some).collect()
}
