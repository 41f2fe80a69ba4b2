//! Writes every column of a log for a comparison with other readers: `dump_topics LOG [TOPIC=FIELD,FIELD ...]`.
//!
//! Without fields whole messages are decoded. Standard output is a line of JSON (the log's health, its notices, and each
//! table with its columns and their texts), then the numbers in the order of that line: stamps and columns of 8 bytes a
//! row, little-endian, each column with a byte a row before it that says whether there is a value.

use ingest::{
    Column, ColumnData, FieldRequest, Limits, MapLibrary, ReadContext, Selection, Table, TopicInfo, ValueKind,
};
use serde_json::{Value, json};
use std::error::Error;
use std::io::{self, BufWriter, Write};
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = PathBuf::from(arguments.next().ok_or("usage: dump_topics LOG [TOPIC=FIELD,FIELD ...]")?);
    let wanted: Vec<(String, Selection)> = arguments.filter_map(|a| wanted(&a)).collect();
    let want = |topic: &TopicInfo| match wanted.iter().find(|(name, _)| *name == topic.name) {
        Some((_, fields)) => fields.clone(),
        None if wanted.is_empty() => Selection::All,
        None => Selection::Skip,
    };
    let cancel = AtomicBool::new(false);
    let context = ReadContext { limits: Limits::default(), cancel: &cancel, on_bytes: &|_| {} };
    let found = ingest::discover(&path, &MapLibrary::shipped()?)?;
    let unit = found.units.first().ok_or_else(|| format!("no log: {:?}", found.ignored))?;
    let log = ingest::open(unit).read(&want, &context)?;
    let mut out = BufWriter::new(io::stdout().lock());
    let tables: Vec<Value> = log.tables.iter().map(head).collect();
    let notices: Vec<_> = log.notices.iter().collect();
    let line = json!({ "health": log.health, "notices": notices, "loss": log.notices.any_loss(), "tables": tables });
    serde_json::to_writer(&mut out, &line)?;
    out.write_all(b"\n")?;
    log.tables.iter().try_for_each(|table| numbers(table, &mut out))?;
    Ok(out.flush()?)
}

/// `TOPIC=FIELD,FIELD`; a field that begins with a quotation mark is text.
fn wanted(argument: &str) -> Option<(String, Selection)> {
    let (topic, fields) = argument.split_once('=')?;
    let field = |path: &str| match path.strip_prefix('"') {
        Some(path) => FieldRequest { path: path.to_owned(), kind: ValueKind::Text },
        None => FieldRequest { path: path.to_owned(), kind: ValueKind::Number },
    };
    Some((topic.to_owned(), Selection::Fields(fields.split(',').map(field).collect())))
}

fn head(table: &Table) -> Value {
    let column = |column: &Column| {
        let (kind, texts) = match &column.data {
            ColumnData::F64(_) => ("f64", None),
            ColumnData::I64(_) => ("i64", None),
            ColumnData::Text(_) => ("text", Some((0..table.rows).map(|row| column.text(row)).collect::<Vec<_>>())),
        };
        json!({ "path": column.path, "kind": kind, "texts": texts })
    };
    json!({
        "topic": table.topic.name,
        "type": table.topic.type_name,
        "encoding": table.topic.encoding,
        "rows": table.rows,
        "logged": table.logged_ns.is_some(),
        "published": table.published_ns.is_some(),
        "columns": table.columns.iter().map(column).collect::<Vec<_>>(),
    })
}

fn numbers(table: &Table, out: &mut impl Write) -> io::Result<()> {
    for stamps in [&table.logged_ns, &table.published_ns].into_iter().flatten() {
        stamps.iter().try_for_each(|stamp| out.write_all(&stamp.to_le_bytes()))?;
    }
    for column in &table.columns {
        let values: Vec<[u8; 8]> = match &column.data {
            ColumnData::F64(values) => values.iter().map(|x| x.to_le_bytes()).collect(),
            ColumnData::I64(values) => values.iter().map(|x| x.to_le_bytes()).collect(),
            ColumnData::Text(_) => continue,
        };
        let valid: Vec<u8> = (0..table.rows).map(|row| u8::from(column.number(row).is_some())).collect();
        out.write_all(&valid)?;
        values.iter().try_for_each(|value| out.write_all(value))?;
    }
    Ok(())
}
