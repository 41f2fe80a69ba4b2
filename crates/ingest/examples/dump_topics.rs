//! Writes columns of a log for a comparison with other readers: `dump_topics LOG [TOPIC[=FIELD,FIELD] ...]`, no topic for
//! all. Without fields whole messages are decoded; a field that begins with a quotation mark is text.
//!
//! Standard output is a line of JSON (the log's health, its notices, and each table with its columns and their texts),
//! then the numbers in the order of that line: stamps and columns of 8 bytes a row, little-endian, each column with a byte
//! a row before it that says whether there is a value.

mod asked;

use ingest::{Column, ColumnData, Table};
use serde_json::{Value, json};
use std::error::Error;
use std::io::{self, BufWriter, Write};

fn main() -> Result<(), Box<dyn Error>> {
    let log = asked::read()?;
    let mut out = BufWriter::new(io::stdout().lock());
    let tables: Vec<Value> = log.tables.iter().map(head).collect();
    let notices: Vec<_> = log.notices.iter().collect();
    let line = json!({ "health": log.health, "notices": notices, "loss": log.notices.any_loss(), "tables": tables });
    serde_json::to_writer(&mut out, &line)?;
    out.write_all(b"\n")?;
    log.tables.iter().try_for_each(|table| numbers(table, &mut out))?;
    Ok(out.flush()?)
}

fn head(table: &Table) -> Value {
    let column = |column: &Column| {
        let (kind, texts) = match &column.data {
            ColumnData::F64(_) => ("f64", None),
            ColumnData::I64(_) => ("i64", None),
            ColumnData::U64(_) => ("u64", None),
            ColumnData::Text(_) => {
                ("text", Some((0..table.rows).map(|row| Some(column.text(row)?.to_string())).collect::<Vec<_>>()))
            }
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
            ColumnData::U64(values) => values.iter().map(|x| x.to_le_bytes()).collect(),
            ColumnData::Text(_) => continue,
        };
        let valid: Vec<u8> = (0..table.rows).map(|row| u8::from(column.number(row).is_some())).collect();
        out.write_all(&valid)?;
        values.iter().try_for_each(|value| out.write_all(value))?;
    }
    Ok(())
}
