//! Provenance of an export: the log with its hashes, the map, the clocks, every table, all notices.

use super::{About, ExportOrder, ExportTo, ExportedSheet, Read, Source};
use crate::error::ConvertError;
use crate::guard::Unchanged;
use crate::sheet::SheetColumn;
use flight::{LogHealth, UtcTie};
use ingest::ReadContext;
use serde::ser::Error as _;
use serde::{Serialize, Serializer};
use serde_json::{Value, json};
use std::io::{self, Read as _};
use std::path::Path;

const MADE_BY: &str = concat!("flightlag ", env!("CARGO_PKG_VERSION"));

/// Bytes of the log hashed between two checks for a stop request.
const HASHED_AT_ONCE: u64 = 16 << 20;

/// What all tables share.
pub(super) struct Head {
    command: String,
    inputs: Vec<Value>,
    map: Option<Value>,
    utc: Option<Value>,
}

impl Head {
    /// Hashes the log, which must be the one that was read.
    pub(super) fn of(
        order: &ExportOrder<'_>,
        read: &Read,
        unchanged: &Unchanged,
        context: &ReadContext<'_>,
    ) -> Result<Head, ConvertError> {
        let input = |path: &Path| -> io::Result<Value> {
            let (mut hash, mut file, mut bytes) = (blake3::Hasher::new(), std::fs::File::open(path)?, 0);
            while let part @ 1.. = io::copy(&mut file.by_ref().take(HASHED_AT_ONCE), &mut hash)? {
                context.advance(0).map_err(io::Error::other)?;
                bytes += part;
            }
            let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
            Ok(json!({ "name": name, "bytes": bytes, "blake3": hash.finalize().to_hex().as_str() }))
        };
        let files = order.unit.files.iter();
        let inputs =
            files.map(|path| input(path).map_err(|e| ConvertError::write(path, "read")(e).or_stopped(context)));
        let inputs = inputs.collect::<Result<_, _>>()?;
        // Tables and hash are from the same content.
        unchanged.check()?;
        let map = read.binding.as_ref().map(|b| json!({ "name": b.map, "why": b.why }));
        Ok(Head { command: order.command.to_owned(), inputs, map, utc: read.utc.as_ref().map(about_tie) })
    }

    /// The part of the provenance that belongs to one sheet.
    pub(super) fn of_sheet(&self, about: &Value) -> String {
        let Head { command, inputs, map, utc } = self;
        let part =
            json!({ "made_by": MADE_BY, "command": command, "inputs": inputs, "map": map, "utc": utc, "sheet": about });
        part.to_string()
    }
}

/// Descriptions of the written sheets.
#[derive(Default)]
pub(super) struct Sheets {
    about: Vec<Packed>,
    pub(super) exported: Vec<ExportedSheet>,
}

impl Sheets {
    /// Adds a sheet, and returns its description.
    pub(super) fn add(&mut self, source: &Source, place: &str, to: ExportTo) -> Value {
        let columns = &source.sheet.columns;
        let mut about = json!({
            "name": source.name,
            "place": place,
            "rows": source.sheet.rows(),
            "columns": columns.iter().map(|c| about_column(c, &source.columns)).collect::<Vec<_>>(),
            "from": source.about,
        });
        if to == ExportTo::Mcap {
            about["log_time"] = source.log_time_how.as_str().into();
        }
        self.exported.push(ExportedSheet {
            name: source.name.clone(),
            place: place.to_owned(),
            rows: source.sheet.rows() as u64,
            columns: columns.len() as u64,
        });
        self.about.push(Packed(about.to_string().into_boxed_str()));
        about
    }
}

/// JSON as text: for tens of thousands of sheets the trees would take hundreds of megabytes.
struct Packed(Box<str>);

impl Serialize for Packed {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serde_json::from_str::<Value>(&self.0).map_err(S::Error::custom)?.serialize(serializer)
    }
}

/// The whole provenance; keys in alphabetical order, as in every JSON of flightlag.
#[derive(Serialize)]
pub(super) struct Provenance<'e> {
    bytes: Value,
    command: &'e str,
    damage: Value,
    format: &'e str,
    inputs: &'e [Value],
    made_by: &'static str,
    map: &'e Option<Value>,
    notices: Value,
    sheets: &'e [Packed],
    utc: &'e Option<Value>,
}

impl<'e> Provenance<'e> {
    pub(super) fn of(head: &'e Head, read: &'e Read, sheets: &'e Sheets) -> Provenance<'e> {
        let Head { command, inputs, map, utc } = head;
        let LogHealth { format, bytes, damage, .. } = &read.health;
        let (bytes, damage, notices) = (json!(bytes), json!(damage), json!(read.notices));
        let sheets = &sheets.about;
        Provenance { bytes, command, damage, format, inputs, made_by: MADE_BY, map, notices, sheets, utc }
    }
}

/// A column's name and description.
fn about_column(column: &SheetColumn, about: &About) -> Value {
    let mut described = about.get(&column.name).cloned().unwrap_or_else(|| json!({}));
    described["name"] = column.name.as_str().into();
    described
}

/// How a clock is tied to UTC, and how accurately.
pub(crate) fn about_tie(tie: &UtcTie) -> Value {
    let mut about = json!(tie);
    about["uncertainty_s"] = (tie.spread_s.p99 - tie.spread_s.p01).into();
    about["remark"] =
        "utc_ns = the clock's ns + offset_ns. uncertainty_s is the spread of the pairs, percentiles 1 to 99. The \
         delay of the messages that state UTC, usually 0.1 to 0.3 s, adds to it."
            .into();
    about
}
