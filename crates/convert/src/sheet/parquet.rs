//! Sheets as Parquet. The one file that knows polars, which can panic on odd input: callers run it where a panic is
//! caught.

use super::{Cells, Sheet};
use polars::prelude::{Column, DataFrame, IntoColumn, KeyValueMetadata, NamedFrom, ParquetWriter, Series};
use std::io::{self, Write};

/// Writes a sheet. Bytes depend on the sheet alone: one thread, and nothing in the metadata but the schema.
///
/// # Errors
/// What the writer says, and columns of unequal length.
pub fn write_parquet(sheet: &Sheet, file: impl Write) -> io::Result<()> {
    write_parquet_about(sheet, &[], file)
}

/// As [`write_parquet`], with texts by name in the file's metadata.
pub(crate) fn write_parquet_about(sheet: &Sheet, about: &[(String, String)], file: impl Write) -> io::Result<()> {
    let about = (!about.is_empty()).then(|| KeyValueMetadata::from_static(about.to_vec()));
    let columns: Vec<Column> = sheet.columns.iter().map(|c| column(&c.name, &c.cells)).collect();
    let mut frame = DataFrame::new(sheet.rows(), columns).map_err(io::Error::other)?;
    ParquetWriter::new(file)
        .set_parallel(false)
        .with_key_value_metadata(about)
        .finish(&mut frame)
        .map(drop)
        .map_err(io::Error::other)
}

fn column(name: &str, cells: &Cells) -> Column {
    match cells {
        Cells::I64(v) => Series::new(name.into(), v.as_slice()).into_column(),
        Cells::U64(v) => Series::new(name.into(), v.as_slice()).into_column(),
        Cells::F64(v) => Series::new(name.into(), v.as_slice()).into_column(),
        Cells::Text(v) => Series::new(name.into(), v.as_slice()).into_column(),
    }
}
