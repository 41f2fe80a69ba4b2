//! Splits a record into fields and reads numbers from them.

/// The fields of one record, unquoted and without padding. Reused from record to record.
#[derive(Debug, Default)]
pub(super) struct Fields {
    text: Vec<u8>,
    spans: Vec<(usize, usize)>,
}

impl Fields {
    /// Takes the fields of `record`.
    pub(super) fn split(&mut self, record: &[u8], delimiter: u8) {
        self.text.clear();
        self.spans.clear();
        if memchr::memchr(b'"', record).is_some() {
            self.split_quoted(record, delimiter);
        } else {
            self.split_plain(record, delimiter);
        }
    }

    fn split_plain(&mut self, record: &[u8], delimiter: u8) {
        self.text.extend_from_slice(record);
        let mut from = 0;
        for at in memchr::memchr_iter(delimiter, record) {
            self.spans.push((from, at));
            from = at + 1;
        }
        self.spans.push((from, record.len()));
    }

    /// The `csv` crate knows the rules of quoting.
    fn split_quoted(&mut self, record: &[u8], delimiter: u8) {
        let mut reader = csv::ReaderBuilder::new()
            .has_headers(false)
            .flexible(true)
            .delimiter(delimiter)
            .terminator(csv::Terminator::Any(0))
            .buffer_capacity(record.len().max(64))
            .from_reader(record);
        let mut row = csv::ByteRecord::new();
        if reader.read_byte_record(&mut row).unwrap_or(false) {
            self.text.extend_from_slice(row.as_slice());
            self.spans.extend((0..row.len()).filter_map(|i| row.range(i)).map(|r| (r.start, r.end)));
        }
    }

    /// How many.
    pub(super) fn len(&self) -> usize {
        self.spans.len()
    }

    /// One field without padding; empty if there are not so many.
    pub(super) fn get(&self, index: usize) -> &[u8] {
        let span = self.spans.get(index).copied().unwrap_or_default();
        self.text.get(span.0..span.1).unwrap_or_default().trim_ascii()
    }

    /// All of them as text; bytes that are no UTF-8 become replacement characters.
    pub(super) fn texts(&self) -> Vec<String> {
        (0..self.len()).map(|i| String::from_utf8_lossy(self.get(i)).into_owned()).collect()
    }
}

/// A cell that was asked for as a number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Cell {
    /// Nothing there.
    Empty,
    /// An integer that fits.
    Integer(i64),
    /// Any other finite number, correctly rounded.
    Float(f64),
    /// `nan`, `inf` or beyond the range of a double.
    NotFinite,
    /// No number.
    Bad,
}

/// Reads a trimmed cell as a number.
pub(super) fn number(cell: &[u8]) -> Cell {
    if cell.is_empty() {
        return Cell::Empty;
    }
    let Ok(text) = std::str::from_utf8(cell) else { return Cell::Bad };
    // "-0" must keep its sign, so it is no integer here.
    if let Ok(integer) = text.parse::<i64>()
        && (integer != 0 || !text.starts_with('-'))
    {
        return Cell::Integer(integer);
    }
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() => Cell::Float(value),
        Ok(_) => Cell::NotFinite,
        Err(_) => Cell::Bad,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn split(record: &str, delimiter: u8) -> Vec<String> {
        let mut fields = Fields::default();
        fields.split(record.as_bytes(), delimiter);
        fields.texts()
    }

    #[test]
    fn padding_goes_and_empty_fields_stay() {
        assert_eq!(split(" a ,, b,", b','), ["a", "", "b", ""]);
        assert_eq!(split("1;2,5;3", b';'), ["1", "2,5", "3"]);
    }

    #[test]
    fn quotes_hide_delimiters_line_ends_and_doubled_quotes() {
        assert_eq!(split("\"a,b\",\"c\nd\",\"e\"\"f\",g", b','), ["a,b", "c\nd", "e\"f", "g"]);
    }

    #[test]
    fn a_number_is_read_as_the_nearest_double_and_an_integer_exactly() {
        assert_eq!(number(b"1531943812200143162"), Cell::Integer(1_531_943_812_200_143_162));
        assert_eq!(number(b"1e5"), Cell::Float(1e5));
        assert_eq!(number(b"1E+05"), Cell::Float(1e5));
        // 2^53 + 1 is half-way between two doubles; ties go to the even one.
        assert_eq!(number(b"9007199254740993.0"), Cell::Float(9_007_199_254_740_992.0));
        assert!(matches!(number(b"-0"), Cell::Float(zero) if zero.is_sign_negative()));
    }

    #[test]
    fn what_is_no_finite_number_is_told_apart() {
        assert_eq!(number(b""), Cell::Empty);
        for text in ["nan", "NaN", "inf", "-inf", "1e999"] {
            assert_eq!(number(text.as_bytes()), Cell::NotFinite, "{text}");
        }
        for text in ["N/A", "0x12", "1,234", "1.2.3", "12:30", "1 2", "\u{ff}", "-"] {
            assert_eq!(number(text.as_bytes()), Cell::Bad, "{text}");
        }
        assert_eq!(number(b"\xff"), Cell::Bad);
    }
}
