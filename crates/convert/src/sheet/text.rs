//! Sheets as CSV that a spreadsheet opens without evaluating anything.

use super::{Cells, Sheet};
use ingest::inert;
use std::io::{self, Write};

/// Replaces a zero byte in a text: readers of text tables take zero bytes for corruption or the end of the file.
const ZERO: char = '\u{2400}';

/// Writes a sheet: a header, then rows, comma, LF. Numbers are the shortest text that reads back to the same bits,
/// absent cells are empty, and texts are made [`inert`], with `␀` for a zero byte.
///
/// # Errors
/// Write errors, and columns of unequal length.
pub fn write_csv(sheet: &Sheet, file: impl Write) -> io::Result<()> {
    let mut writer = csv::WriterBuilder::new().from_writer(file);
    writer.write_record(sheet.columns.iter().map(|c| text(&c.name)))?;
    let mut cell = String::new();
    for row in 0..sheet.rows() {
        for column in &sheet.columns {
            cell.clear();
            write_cell(&column.cells, row, &mut cell)?;
            writer.write_field(&cell)?;
        }
        writer.write_record(None::<&[u8]>)?;
    }
    writer.flush()
}

/// A text as written to a table.
fn text(text: &str) -> String {
    inert(text).replace('\0', ZERO.encode_utf8(&mut [0; 4]))
}

/// Number of texts in a sheet that contain zero bytes.
pub(crate) fn with_zero_bytes(sheet: &Sheet) -> u64 {
    let texts = sheet.columns.iter().filter_map(|column| match &column.cells {
        Cells::Text(texts) => Some(texts.iter().flatten()),
        _ => None,
    });
    texts.flatten().filter(|text| text.contains('\0')).count() as u64
}

fn write_cell(cells: &Cells, row: usize, out: &mut String) -> io::Result<()> {
    use std::fmt::Write;
    if row >= cells.len() {
        return Err(io::Error::other("columns of unequal length"));
    }
    let written = match cells {
        Cells::I64(v) => v.get(row).map_or(Ok(()), |x| write!(out, "{x}")),
        Cells::U64(v) => v.get(row).map_or(Ok(()), |x| write!(out, "{x}")),
        Cells::F64(v) => v.get(row).map_or(Ok(()), |x| write!(out, "{x:?}")),
        Cells::Text(v) => {
            out.push_str(&text(v.get(row).unwrap_or_default()));
            Ok(())
        }
    };
    written.map_err(io::Error::other)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zero_bytes_are_replaced_in_text_tables() {
        let mut sheet = Sheet::default();
        sheet.push("a\0", Cells::Text([Some("\0=1"), Some("x\0y"), Some("plain"), None].into_iter().collect()));
        let mut bytes = vec![];
        write_csv(&sheet, &mut bytes).unwrap();
        assert_eq!(String::from_utf8(bytes).unwrap(), "a␀\n'␀=1\nx␀y\nplain\n\"\"\n");
        assert_eq!(with_zero_bytes(&sheet), 2);
    }

    #[test]
    fn numbers_read_back_to_the_same_bits_and_absent_cells_are_empty() {
        let values = [0.1 + 0.2, -0.0, f64::MIN_POSITIVE, 1e308, f64::NAN, f64::INFINITY];
        let mut sheet = Sheet::default();
        sheet.push("x_m", Cells::F64(values.iter().map(|x| Some(*x)).chain([None]).collect()));
        sheet.push("=n", Cells::I64(vec![i64::MIN; 7].into()));
        sheet.push("t", Cells::Text([Some("=a,\"b\""); 7].into_iter().collect()));
        let mut bytes = vec![];
        write_csv(&sheet, &mut bytes).unwrap();
        let mut reader = csv::Reader::from_reader(bytes.as_slice());
        assert_eq!(reader.headers().unwrap().iter().collect::<Vec<_>>(), ["x_m", "'=n", "t"]);
        let rows: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
        for (row, value) in rows.iter().zip(values) {
            let read: f64 = row[0].parse().unwrap();
            assert!(read.to_bits() == value.to_bits() || (read.is_nan() && value.is_nan()), "{} {value}", &row[0]);
            assert_eq!((&row[1], &row[2]), ("-9223372036854775808", "'=a,\"b\""));
        }
        assert_eq!(&rows[6][0], "");
    }
}
