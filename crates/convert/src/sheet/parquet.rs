//! Sheets as Parquet files. The only file that uses the `parquet` crate.

use super::{Cells, Sheet, SheetColumn};
use ingest::Values;
use parquet::basic::{Compression, Encoding, LogicalType, Repetition, Type as Stored, ZstdLevel};
use parquet::column::reader::get_typed_column_reader;
use parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter};
use parquet::schema::types::{ColumnPath, Type, TypePtr};
use std::collections::{BTreeMap, HashSet};
use std::fs::File;
use std::io::{self, Write};
use std::ops::Range;
use std::sync::Arc;

/// Rows of a row group: a reader of part of a long table reads no more than these at a time.
pub const ROWS_OF_A_GROUP: usize = 1 << 18;

/// Values of a column examined to choose its encoding. Shorter columns use a dictionary.
const LOOKED_AT: usize = 256;

/// Writes a sheet. The bytes depend only on the sheet and the build.
///
/// # Errors
/// Write errors, and columns of unequal length.
pub fn write_parquet(sheet: &Sheet, file: impl Write + Send) -> io::Result<()> {
    write_parquet_about(sheet, &[], file)
}

/// As [`write_parquet`], with texts by name in the file's metadata.
///
/// # Errors
/// As [`write_parquet`].
pub fn write_parquet_about(sheet: &Sheet, about: &[(String, String)], file: impl Write + Send) -> io::Result<()> {
    let rows = sheet.rows();
    let mut writer = begun(sheet, about, file)?;
    for from in (0..rows).step_by(ROWS_OF_A_GROUP) {
        write_group(&mut writer, sheet, from..rows.min(from + ROWS_OF_A_GROUP))?;
    }
    writer.close()?;
    Ok(())
}

/// As [`write_parquet_about`], for a table in parts with the same columns: each becomes a row group. The first part,
/// which may be the only one, determines the encodings.
///
/// # Errors
/// As [`write_parquet`], and a part with different columns from the first.
pub fn write_parquet_parts(
    first: &Sheet,
    others: impl Iterator<Item = Sheet>,
    about: &[(String, String)],
    file: impl Write + Send,
) -> io::Result<()> {
    let mut writer = begun(first, about, file)?;
    write_group(&mut writer, first, 0..first.rows())?;
    for part in others {
        let names = |sheet: &Sheet| sheet.columns.iter().map(|c| c.name.clone()).collect::<Vec<_>>();
        if names(&part) != names(first) {
            return Err(io::Error::other("a part of the table has other columns than the first part"));
        }
        write_group(&mut writer, &part, 0..part.rows())?;
    }
    writer.close()?;
    Ok(())
}

/// A file with the columns of a sheet, without rows so far.
fn begun<W: Write + Send>(sheet: &Sheet, about: &[(String, String)], file: W) -> io::Result<SerializedFileWriter<W>> {
    let about: Vec<KeyValue> = about.iter().map(|(key, text)| KeyValue::new(key.clone(), text.clone())).collect();
    let properties = sheet.columns.iter().fold(
        WriterProperties::builder()
            .set_compression(Compression::ZSTD(ZstdLevel::default()))
            .set_key_value_metadata((!about.is_empty()).then_some(about)),
        |properties, column| match encoding(&column.cells) {
            Some(encoding) => {
                let path = ColumnPath::from(column.name.as_str());
                properties.set_column_dictionary_enabled(path.clone(), false).set_column_encoding(path, encoding)
            }
            None => properties,
        },
    );
    let properties = properties.build();
    Ok(SerializedFileWriter::new(file, schema(sheet)?, Arc::new(properties))?)
}

fn write_group<W: Write + Send>(
    writer: &mut SerializedFileWriter<W>,
    sheet: &Sheet,
    rows: Range<usize>,
) -> io::Result<()> {
    let all = sheet.rows();
    if let Some(other) = sheet.columns.iter().find(|c| c.cells.len() != all) {
        return Err(io::Error::other(format!("column {} has {} rows, not {all}", other.name, other.cells.len())));
    }
    let mut group = writer.next_row_group()?;
    for column in &sheet.columns {
        let Some(mut out) = group.next_column()? else { break };
        match &column.cells {
            Cells::I64(v) => write_column::<Int64Type, _>(&mut out, rows.clone().map(|row| v.get(row)), |x| x)?,
            Cells::U64(v) => {
                write_column::<Int64Type, _>(&mut out, rows.clone().map(|row| v.get(row)), u64::cast_signed)?;
            }
            Cells::F64(v) => write_column::<DoubleType, _>(&mut out, rows.clone().map(|row| v.get(row)), |x| x)?,
            Cells::Text(v) => {
                let texts = rows.clone().map(|row| v.get(row));
                write_column::<ByteArrayType, _>(&mut out, texts, ByteArray::from)?;
            }
        }
        out.close()?;
    }
    group.close()?;
    Ok(())
}

/// The encoding of a column; `None` for a dictionary. Timestamps increase by nearly constant steps, and neighbouring
/// numbers share their first bytes, so these encodings save a quarter.
fn encoding(cells: &Cells) -> Option<Encoding> {
    // Not for a held column, nor for one with few distinct values.
    let is_varied = |values: &Values<f64>| {
        let moves = values.iter().zip(values.iter().skip(1)).filter(|(before, now)| before != now).count();
        let step = values.len() / LOOKED_AT + 1;
        let seen: HashSet<u64> = values.iter().step_by(step).flatten().map(|value| value.to_bits()).collect();
        2 * moves > values.len() && 4 * seen.len() > LOOKED_AT
    };
    match cells {
        Cells::I64(values) if values.len() > LOOKED_AT => Some(Encoding::DELTA_BINARY_PACKED),
        Cells::F64(values) if values.len() > LOOKED_AT && is_varied(values) => Some(Encoding::BYTE_STREAM_SPLIT),
        _ => None,
    }
}

fn schema(sheet: &Sheet) -> io::Result<TypePtr> {
    let field = |column: &SheetColumn| {
        let (stored, meant) = match &column.cells {
            Cells::I64(_) => (Stored::INT64, None),
            Cells::U64(_) => (Stored::INT64, Some(LogicalType::integer(64, false))),
            Cells::F64(_) => (Stored::DOUBLE, None),
            Cells::Text(_) => (Stored::BYTE_ARRAY, Some(LogicalType::String)),
        };
        let builder = Type::primitive_type_builder(&column.name, stored);
        builder.with_repetition(Repetition::OPTIONAL).with_logical_type(meant).build().map(Arc::new)
    };
    let fields: Vec<TypePtr> = sheet.columns.iter().map(field).collect::<Result<_, _>>()?;
    Ok(Arc::new(Type::group_type_builder("root").with_fields(fields).build()?))
}

/// The present cells, and for each cell its definition level: 1 if present, otherwise 0.
fn write_column<T: DataType, C>(
    out: &mut SerializedColumnWriter<'_>,
    cells: impl Iterator<Item = Option<C>> + Clone,
    stored: impl Fn(C) -> T::T,
) -> io::Result<()> {
    let levels: Vec<i16> = cells.clone().map(|cell| i16::from(cell.is_some())).collect();
    let values: Vec<T::T> = cells.flatten().map(stored).collect();
    out.typed::<T>().write_batch(&values, Some(&levels), None)?;
    Ok(())
}

/// A table that was read, with the metadata of its file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ReadTable {
    /// The table.
    pub sheet: Sheet,
    /// Texts of the file's metadata, by name.
    pub about: BTreeMap<String, String>,
}

/// Reads a flat table of integers, numbers and texts, as [`write_parquet`] writes it.
///
/// # Errors
/// The file is not a Parquet file, is damaged, or has columns of other types.
pub fn read_parquet(file: File) -> io::Result<ReadTable> {
    read_parquet_columns(file, &|_| true)
}

/// As [`read_parquet`], but decodes only the wanted columns.
///
/// # Errors
/// As [`read_parquet`].
pub fn read_parquet_columns(file: File, is_wanted: &dyn Fn(&str) -> bool) -> io::Result<ReadTable> {
    let reader = SerializedFileReader::new(file)?;
    let metadata = reader.metadata().file_metadata();
    let about = metadata.key_value_metadata().into_iter().flatten();
    let about = about.filter_map(|pair| Some((pair.key.clone(), pair.value.clone()?))).collect();
    let mut sheet = Sheet::default();
    for (number, column) in metadata.schema_descr().columns().iter().enumerate() {
        if !is_wanted(column.name()) {
            continue;
        }
        let unsigned = matches!(column.logical_type_ref(), Some(LogicalType::Integer(i)) if !i.is_signed);
        let cells = match column.physical_type() {
            Stored::INT64 if unsigned => {
                Cells::U64(read_column::<Int64Type, _>(&reader, number, |x| Ok(x.cast_unsigned()))?.into())
            }
            Stored::INT64 => Cells::I64(read_column::<Int64Type, _>(&reader, number, |x| Ok(*x))?.into()),
            Stored::DOUBLE => Cells::F64(read_column::<DoubleType, _>(&reader, number, |x| Ok(*x))?.into()),
            Stored::BYTE_ARRAY => {
                let texts = read_column::<ByteArrayType, _>(&reader, number, |x| Ok(x.as_utf8()?.to_owned()))?;
                Cells::Text(texts.into_iter().collect())
            }
            other => return Err(io::Error::other(format!("column {} holds {other} values", column.name()))),
        };
        sheet.push(column.name(), cells);
    }
    Ok(ReadTable { sheet, about })
}

/// One column of all row groups.
fn read_column<T: DataType, C>(
    reader: &SerializedFileReader<File>,
    number: usize,
    meant: impl Fn(&T::T) -> io::Result<C>,
) -> io::Result<Vec<Option<C>>> {
    let mut cells = vec![];
    for group in 0..reader.num_row_groups() {
        let mut column = get_typed_column_reader::<T>(reader.get_row_group(group)?.get_column_reader(number)?);
        let (mut levels, mut values) = (vec![], vec![]);
        column.read_records(usize::MAX, Some(&mut levels), None, &mut values)?;
        if levels.is_empty() {
            // A non-nullable column has no levels.
            levels.resize(values.len(), 1);
        }
        let mut values = values.iter();
        for level in levels {
            cells.push(if level == 0 { None } else { values.next().map(&meant).transpose()? });
        }
    }
    Ok(cells)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sheet::TextCells;

    fn every_kind() -> Sheet {
        let mut sheet = Sheet::default();
        sheet
            .push("stamp_ns", Cells::I64(vec![Some(i64::MIN), None, Some(1_700_000_000_123_456_789), Some(-1)].into()));
        sheet.push("count", Cells::U64(vec![Some(u64::MAX), Some(0), None, Some(7)].into()));
        sheet.push("north_m", Cells::F64(vec![Some(-0.0), Some(f64::NAN), None, Some(0.1 + 0.2)].into()));
        let text = |s: &str| Some(s.to_owned());
        sheet.push("text", Cells::Text([text(""), text("Grüße, 高度"), None, text("=1+1")].into_iter().collect()));
        sheet.push("nothing_m", Cells::F64(vec![None; 4].into()));
        sheet
    }

    /// Timestamps with jitter, a track, and the same track held for 20 rows, with missing values in some rows.
    fn long_table() -> Sheet {
        let count = 6000_i32;
        let track = |i: i32| 100.0 * (f64::from(i) / 300.0).sin();
        let mut sheet = Sheet::default();
        let stamp = |i: i32| i64::from(i) * 10_000_000 + i64::from(i % 7);
        sheet.push("stamp_ns", Cells::I64((0..count).map(|i| (i % 50 != 9).then(|| stamp(i))).collect()));
        sheet.push("north_m", Cells::F64((0..count).map(|i| (i % 90 > 3).then(|| track(i))).collect()));
        sheet.push("held_m", Cells::F64((0..count).map(|i| Some(track(i / 20))).collect()));
        sheet
    }

    fn written(sheet: &Sheet) -> (File, Vec<u8>) {
        let mut bytes = vec![];
        write_parquet_about(sheet, &[("about".to_owned(), "a text".to_owned())], &mut bytes).unwrap();
        let mut file = tempfile::tempfile().unwrap();
        file.write_all(&bytes).unwrap();
        (file, bytes)
    }

    /// Numeric cells as bits, because NaN does not equal NaN.
    fn bits(sheet: &Sheet) -> Vec<(String, Vec<Option<u64>>)> {
        let of = |c: &SheetColumn| match &c.cells {
            Cells::F64(v) => v.iter().map(|x| x.map(f64::to_bits)).collect(),
            Cells::I64(v) => v.iter().map(|x| x.map(i64::cast_unsigned)).collect(),
            Cells::U64(v) => v.iter().collect(),
            Cells::Text(_) => vec![],
        };
        sheet.columns.iter().map(|c| (c.name.clone(), of(c))).collect()
    }

    #[test]
    fn a_table_is_read_back_to_the_bit() {
        let sheet = every_kind();
        let read = read_parquet(written(&sheet).0).unwrap();
        assert_eq!(bits(&read.sheet), bits(&sheet));
        assert_eq!(read.sheet.cells("text"), sheet.cells("text"));
        assert_eq!(read.about.get("about").map(String::as_str), Some("a text"));
    }

    #[test]
    fn a_long_table_is_compressed_and_read_back_to_the_bit() {
        let sheet = long_table();
        let bytes = |name: &str| {
            let mut one = Sheet::default();
            one.push(name, sheet.cells(name).unwrap().clone());
            written(&one).1.len()
        };
        // Eight bytes per value; with a dictionary 5,733, 44,786 and 3,141 bytes.
        let sizes = ["stamp_ns", "north_m", "held_m"].map(bytes);
        println!("{sizes:?} bytes");
        assert!(sizes[0] < 3_000 && sizes[1] < 38_000 && sizes[2] < 4_000, "{sizes:?}");
        let (file, _) = written(&sheet);
        assert_eq!(bits(&read_parquet(file).unwrap().sheet), bits(&sheet));
    }

    #[test]
    fn a_table_of_two_row_groups_keeps_its_order() {
        let stamps: Vec<Option<i64>> = (0..ROWS_OF_A_GROUP as i64 + 3).map(Some).collect();
        let mut sheet = Sheet::default();
        sheet.push("stamp_ns", Cells::I64(stamps.into()));
        let (file, bytes) = written(&sheet);
        assert_eq!(read_parquet(file).unwrap().sheet, sheet);
        assert_eq!(bytes, written(&sheet).1, "the same table gives the same bytes");
    }

    #[test]
    fn a_table_written_in_parts_reads_back_as_one() {
        let part = |range: std::ops::Range<i64>| {
            let mut sheet = Sheet::default();
            sheet.push("stamp_ns", Cells::I64(range.clone().map(Some).collect()));
            sheet.push("text", Cells::Text(range.map(|i| (i % 3 > 0).then(|| i.to_string())).collect()));
            sheet
        };
        let file = |parts: Vec<Sheet>| {
            let mut file = tempfile::tempfile().unwrap();
            let (first, others) = parts.split_first().unwrap();
            write_parquet_parts(first, others.iter().cloned(), &[], &mut file).map(|()| file)
        };
        let read = |file: File| read_parquet(file).unwrap().sheet;
        let parts = vec![part(0..400), part(400..700), part(700..701)];
        assert_eq!(read(file(parts).unwrap()), part(0..701));
        let mut other = part(400..700);
        other.columns.pop();
        let error = file(vec![part(0..400), other]).unwrap_err().to_string();
        assert_eq!(error, "a part of the table has other columns than the first part");
    }

    #[test]
    fn a_table_without_rows_keeps_its_columns() {
        let mut sheet = Sheet::default();
        sheet.push("stamp_ns", Cells::I64(vec![None; 0].into()));
        sheet.push("text", Cells::Text(TextCells::default()));
        assert_eq!(read_parquet(written(&sheet).0).unwrap().sheet, sheet);
    }

    #[test]
    fn columns_of_unequal_length_and_truncated_files_are_rejected() {
        let mut sheet = every_kind();
        sheet.push("short", Cells::I64(vec![1].into()));
        let error = write_parquet(&sheet, vec![]).unwrap_err().to_string();
        assert_eq!(error, "column short has 1 rows, not 4");
        let (_, bytes) = written(&every_kind());
        for length in [0, 3, 8, bytes.len() / 2, bytes.len() - 1] {
            let mut file = tempfile::tempfile().unwrap();
            file.write_all(&bytes[..length]).unwrap();
            assert!(read_parquet(file).is_err(), "{length} bytes");
        }
    }
}
