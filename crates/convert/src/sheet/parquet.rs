//! Sheets as Parquet. The one file that knows polars, which can panic on odd input: callers run it where a panic is
//! caught.

use super::{Cells, Sheet};
use polars::prelude::{Column, DataFrame, IntoColumn, NamedFrom, ParquetWriter, Series};
use std::io::{self, Write};

/// Writes a sheet. Bytes depend on the sheet alone: one thread, and nothing in the metadata but the schema.
///
/// # Errors
/// What the writer says, and columns of unequal length.
pub fn write_parquet(sheet: &Sheet, file: impl Write) -> io::Result<()> {
    let columns: Vec<Column> = sheet.columns.iter().map(|c| column(&c.name, &c.cells)).collect();
    let mut frame = DataFrame::new(sheet.rows(), columns).map_err(io::Error::other)?;
    ParquetWriter::new(file).set_parallel(false).finish(&mut frame).map(drop).map_err(io::Error::other)
}

fn column(name: &str, cells: &Cells) -> Column {
    match cells {
        Cells::I64(v) => Series::new(name.into(), v.as_slice()).into_column(),
        Cells::F64(v) => Series::new(name.into(), v.as_slice()).into_column(),
        Cells::Text(v) => Series::new(name.into(), v.as_slice()).into_column(),
    }
}
