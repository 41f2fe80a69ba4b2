//! Decodes records of a fixed layout into columns: little-endian numbers and text, each at its own offset.
//!
//! ULog and DataFlash name the fields of a record once; after that a record is bytes in that order.

use crate::decode::Wanted;
use crate::decode::rows::{Rows, Value, ValueType};
use crate::decode::schema::Number;
use std::borrow::Cow;
use std::ops::Range;

/// The layout of a record.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Layout {
    /// In any order.
    pub(crate) fields: Vec<PackedField>,
    /// Shorter records cannot be decoded, bytes.
    pub(crate) shortest: usize,
    /// Bytes after this are counted as longer than defined.
    pub(crate) longest: usize,
}

/// A value in a record.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PackedField {
    /// Dotted path; elements of arrays as `q[0]`.
    pub(crate) path: String,
    /// Bytes before it.
    pub(crate) offset: usize,
    pub(crate) kind: PackedKind,
    /// For a number; `None` keeps it unscaled, and 64-bit integers exact.
    pub(crate) scale: Option<Scale>,
}

/// The type of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum PackedKind {
    Number(Number),
    /// IEEE 754 binary16.
    Half,
    /// Text in this many bytes, or up to the first zero in them. Invalid UTF-8 becomes U+FFFD.
    Text(usize),
}

/// `value · factor / divisor`. Two numbers, so that a decimal scale divides by an exact power of ten.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Scale {
    pub(crate) factor: f64,
    pub(crate) divisor: f64,
}

impl PackedKind {
    /// Bytes.
    pub(crate) fn size(self) -> usize {
        match self {
            PackedKind::Number(number) => number.size() as usize,
            PackedKind::Half => 2,
            PackedKind::Text(length) => length,
        }
    }

    fn value_type(self, scale: Option<Scale>) -> ValueType {
        match self {
            PackedKind::Text(_) => ValueType::Text,
            PackedKind::Number(Number::I64 | Number::U64) if scale.is_none() => ValueType::Integer,
            PackedKind::Number(_) | PackedKind::Half => ValueType::Float,
        }
    }
}

/// How to read the wanted fields of one layout.
///
/// Records are buffered, and decoded field by field once there are several: one loop for each number type, instead of a
/// branch for each value.
#[derive(Debug)]
pub(crate) struct Plan {
    steps: Vec<Step>,
    shortest: usize,
    longest: usize,
    /// The byte range of the wanted fields of a record.
    span: Range<usize>,
    /// The bytes of the records that have no values yet.
    held: Vec<u8>,
    /// The row of the first buffered record.
    first: usize,
}

#[derive(Debug)]
struct Step {
    column: usize,
    /// Within the span.
    offset: usize,
    kind: PackedKind,
    scale: Option<Scale>,
}

/// The most bytes of records that are buffered, plus one record: little compared with the first-level cache, even for
/// many topics.
const MOST_HELD: usize = 4 << 10;

impl Plan {
    /// Compiles the wanted fields; creates their columns in `rows`.
    pub(crate) fn new(layout: &Layout, wanted: &Wanted, rows: &mut Rows) -> Plan {
        let mut step = |field: &PackedField| {
            let PackedField { path, offset, kind, scale } = field;
            // An empty field has no value.
            let wanted = kind.size() > 0 && wanted.has(path);
            let column = wanted.then(|| rows.column(path, kind.value_type(*scale))).flatten()?;
            Some(Step { column, offset: *offset, kind: *kind, scale: *scale })
        };
        let mut steps: Vec<Step> = layout.fields.iter().filter_map(&mut step).collect();
        let start = steps.iter().map(|s| s.offset).min().unwrap_or_default();
        let end = steps.iter().map(|s| s.offset.saturating_add(s.kind.size())).max().unwrap_or_default();
        let shortest = layout.shortest.max(end);
        steps.iter_mut().for_each(|s| s.offset -= start);
        Plan { steps, shortest, longest: layout.longest.max(shortest), span: start..end, held: vec![], first: 0 }
    }

    /// Takes the record of the open row; its values are set by [`Plan::deliver`] at the latest. Until then no other
    /// plan may set values of these rows. Returns how many bytes the record has in excess of its layout.
    pub(crate) fn decode(&mut self, record: &[u8], rows: &mut Rows) -> Result<usize, String> {
        if record.len() < self.shortest {
            return Err(format!("{} bytes, but its format has {}", record.len(), self.shortest));
        }
        if self.held.is_empty() {
            self.first = rows.len();
        }
        self.held.extend_from_slice(record.get(self.span.clone()).unwrap_or_default());
        if self.held.len() >= MOST_HELD {
            self.deliver(rows);
        }
        Ok(record.len().saturating_sub(self.longest))
    }

    /// Sets the values of the buffered records.
    pub(crate) fn deliver(&mut self, rows: &mut Rows) {
        if !self.held.is_empty() {
            let records = Records { bytes: &self.held, length: self.span.len(), first: self.first };
            self.steps.iter().for_each(|step| step.deliver(records, rows));
            self.held.clear();
            self.held.shrink_to(2 * MOST_HELD);
        }
    }

    /// Approximate memory use of the plan, bytes.
    pub(crate) fn weight(&self) -> usize {
        self.steps.len() * size_of::<Step>()
    }
}

/// Records of one length, for consecutive rows.
#[derive(Debug, Clone, Copy)]
struct Records<'r> {
    bytes: &'r [u8],
    length: usize,
    first: usize,
}

impl<'r> Records<'r> {
    /// `N` bytes of each record.
    fn each<const N: usize>(self, at: usize) -> impl Iterator<Item = [u8; N]> + 'r
    where
        [u8; N]: Default,
    {
        // The plan has checked the length.
        self.bytes
            .chunks_exact(self.length)
            .map(move |record| record.get(at..).and_then(<[u8]>::first_chunk).copied().unwrap_or_default())
    }
}

impl Step {
    fn deliver(&self, records: Records<'_>, rows: &mut Rows) {
        let Step { column, offset: at, kind, scale } = *self;
        match kind {
            PackedKind::Text(length) => {
                for (i, record) in records.bytes.chunks_exact(records.length).enumerate() {
                    let text = text_of(record.get(at..at + length).unwrap_or_default());
                    rows.set_at(records.first + i, column, Value::Text(&text));
                }
            }
            PackedKind::Half => self.floats(records, rows, |bytes| half(u16::from_le_bytes(bytes))),
            PackedKind::Number(Number::I64) if scale.is_none() => {
                rows.integers(records.first, column, records.each(at).map(i64::from_le_bytes));
            }
            PackedKind::Number(Number::U64) if scale.is_none() => {
                let values = || records.each(at).map(u64::from_le_bytes);
                if values().all(|value| i64::try_from(value).is_ok()) {
                    return rows.integers(records.first, column, values().map(|value| value as i64));
                }
                for (i, value) in values().enumerate() {
                    rows.set_at(records.first + i, column, Value::unsigned(value));
                }
            }
            PackedKind::Number(number) => self.deliver_floats(number, records, rows),
        }
    }

    fn deliver_floats(&self, number: Number, records: Records<'_>, rows: &mut Rows) {
        match number {
            Number::Bool => self.floats(records, rows, |[byte]| f64::from(u8::from(byte != 0))),
            Number::U8 => self.floats(records, rows, |b| u8::from_le_bytes(b).into()),
            Number::I8 => self.floats(records, rows, |b| i8::from_le_bytes(b).into()),
            Number::U16 => self.floats(records, rows, |b| u16::from_le_bytes(b).into()),
            Number::I16 => self.floats(records, rows, |b| i16::from_le_bytes(b).into()),
            Number::U32 => self.floats(records, rows, |b| u32::from_le_bytes(b).into()),
            Number::I32 => self.floats(records, rows, |b| i32::from_le_bytes(b).into()),
            Number::U64 => self.floats(records, rows, |b| u64::from_le_bytes(b) as f64),
            Number::I64 => self.floats(records, rows, |b| i64::from_le_bytes(b) as f64),
            Number::F32 => self.floats(records, rows, |b| f32::from_le_bytes(b).into()),
            Number::F64 => self.floats(records, rows, f64::from_le_bytes),
        }
    }

    #[inline(always)]
    fn floats<const N: usize>(&self, records: Records<'_>, rows: &mut Rows, of: impl Fn([u8; N]) -> f64)
    where
        [u8; N]: Default,
    {
        let values = records.each(self.offset).map(of);
        match self.scale {
            None => rows.floats(records.first, self.column, values),
            Some(scale) => rows.floats(records.first, self.column, values.map(|x| x * scale.factor / scale.divisor)),
        }
    }
}

/// Up to the first zero.
pub(crate) fn text_of(bytes: &[u8]) -> Cow<'_, str> {
    let end = memchr::memchr(0, bytes).unwrap_or(bytes.len());
    String::from_utf8_lossy(bytes.get(..end).unwrap_or_default())
}

/// The number at the start of the bytes; `None` if there are too few.
#[inline(always)]
pub(crate) fn number_of(number: Number, bytes: &[u8]) -> Option<Value<'static>> {
    Some(match number {
        Number::Bool => Value::Float(f64::from(u8::from(*bytes.first()? != 0))),
        Number::U8 => Value::Float((*bytes.first()?).into()),
        Number::I8 => Value::Float((*bytes.first()? as i8).into()),
        Number::U16 => Value::Float(u16::from_le_bytes(*bytes.first_chunk()?).into()),
        Number::I16 => Value::Float(i16::from_le_bytes(*bytes.first_chunk()?).into()),
        Number::U32 => Value::Float(u32::from_le_bytes(*bytes.first_chunk()?).into()),
        Number::I32 => Value::Float(i32::from_le_bytes(*bytes.first_chunk()?).into()),
        Number::U64 => Value::unsigned(u64::from_le_bytes(*bytes.first_chunk()?)),
        Number::I64 => Value::Integer(i64::from_le_bytes(*bytes.first_chunk()?)),
        Number::F32 => Value::Float(f32::from_le_bytes(*bytes.first_chunk()?).into()),
        Number::F64 => Value::Float(f64::from_le_bytes(*bytes.first_chunk()?)),
    })
}

/// As [`number_of`], rounded to a double.
pub(crate) fn float_of(number: Number, bytes: &[u8]) -> Option<f64> {
    match number_of(number, bytes)? {
        Value::Float(x) => Some(x),
        Value::Integer(x) => Some(x as f64),
        Value::Large(x) => Some(x as f64),
        Value::Text(_) => None,
    }
}

/// IEEE 754 binary16: one sign bit, five of exponent, ten of fraction.
fn half(bits: u16) -> f64 {
    let fraction = f64::from(bits & 0x3ff) / 1024.0;
    let exponent = i32::from(bits >> 10 & 0x1f);
    let magnitude = match exponent {
        0 => fraction * 2f64.powi(-14),
        31 if fraction > 0.0 => f64::NAN,
        31 => f64::INFINITY,
        _ => (1.0 + fraction) * 2f64.powi(exponent - 15),
    };
    if bits >> 15 == 0 { magnitude } else { -magnitude }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::{ColumnData, Table, TopicInfo};

    fn field(path: &str, offset: usize, kind: PackedKind) -> PackedField {
        PackedField { path: path.to_owned(), offset, kind, scale: None }
    }

    fn layout(fields: Vec<PackedField>) -> Layout {
        let size = fields.iter().map(|f| f.offset + f.kind.size()).max().unwrap_or_default();
        Layout { fields, shortest: size, longest: size }
    }

    fn decoded(layout: &Layout, wanted: &Wanted, records: &[&[u8]]) -> Table {
        let mut rows = Rows::default();
        let mut plan = Plan::new(layout, wanted, &mut rows);
        for (i, record) in records.iter().enumerate() {
            plan.decode(record, &mut rows).unwrap();
            rows.close(0, None, i as u64 + 1);
        }
        plan.deliver(&mut rows);
        rows.into_table(TopicInfo::default())
    }

    #[test]
    fn values_of_every_kind_are_read_at_their_offset() {
        use Number::{Bool, F32, F64, I8, I16, I32, I64, U8, U16, U32, U64};
        let kinds = [Bool, U8, I8, U16, I16, U32, I32, U64, I64, F32, F64];
        let mut offset = 0;
        let mut fields = vec![];
        for (i, kind) in kinds.into_iter().enumerate() {
            fields.push(field(&format!("f[{i}]"), offset, PackedKind::Number(kind)));
            offset += kind.size() as usize;
        }
        fields.push(field("half", offset, PackedKind::Half));
        fields.push(field("text", offset + 2, PackedKind::Text(6)));
        let record = [
            &[7][..],
            &[250],
            &(-3_i8).to_le_bytes(),
            &60_000_u16.to_le_bytes(),
            &(-300_i16).to_le_bytes(),
            &4_000_000_000_u32.to_le_bytes(),
            &(-2_000_000_000_i32).to_le_bytes(),
            &(i64::MAX as u64).to_le_bytes(),
            &i64::MIN.to_le_bytes(),
            &1.5_f32.to_le_bytes(),
            &0.1_f64.to_le_bytes(),
            &0xc500_u16.to_le_bytes(),
            b"ab\0cde",
        ]
        .concat();
        let table = decoded(&layout(fields), &Wanted::All, &[&record]);
        let numbers: Vec<f64> =
            [0, 1, 2, 3, 4, 5, 6, 9, 10].map(|i| table.column(&format!("f[{i}]")).unwrap().number(0).unwrap()).into();
        assert_eq!(numbers, [1.0, 250.0, -3.0, 60_000.0, -300.0, 4e9, -2e9, 1.5, 0.1]);
        assert_eq!(table.column("f[7]").unwrap().integer(0), Some(i64::MAX));
        assert_eq!(table.column("f[8]").unwrap().integer(0), Some(i64::MIN));
        assert_eq!(table.column("half").unwrap().number(0), Some(-5.0));
        assert_eq!(table.column("text").unwrap().text(0), Some("ab"));
    }

    #[test]
    fn a_decimal_scale_gives_the_bits_of_the_decimal_text() {
        let scaled = PackedField {
            scale: Some(Scale { factor: 1.0, divisor: 1e7 }),
            ..field("lat", 0, PackedKind::Number(Number::I32))
        };
        let table = decoded(&layout(vec![scaled]), &Wanted::All, &[&423_585_499_i32.to_le_bytes()]);
        assert_eq!(table.column("lat").unwrap().number(0), Some(42.358_549_9));
    }

    #[test]
    fn only_wanted_fields_become_columns_and_the_largest_number_stays_exact() {
        let number = |path: &str, offset| field(path, offset, PackedKind::Number(Number::U64));
        let layout = layout(vec![number("a", 0), number("b", 8)]);
        let record = [5_u64.to_le_bytes(), u64::MAX.to_le_bytes()].concat();
        let table = decoded(&layout, &Wanted::of_paths(["b", "gone"]), &[&record, &[0; 16]]);
        assert_eq!(table.columns.len(), 1);
        assert_eq!(table.columns[0].data, ColumnData::U64(vec![u64::MAX, 0]));
    }

    #[test]
    fn short_records_are_rejected_and_excess_bytes_are_counted() {
        let layout = Layout { longest: 3, ..layout(vec![field("a", 0, PackedKind::Number(Number::U16))]) };
        let mut rows = Rows::default();
        let mut plan = Plan::new(&layout, &Wanted::All, &mut rows);
        assert!(plan.decode(&[1], &mut rows).is_err());
        assert_eq!([&[0; 2][..], &[0; 3], &[0; 5]].map(|r| plan.decode(r, &mut rows).unwrap()), [0, 0, 2]);
    }

    #[test]
    fn half_floats_of_all_kinds_match_ieee_754() {
        assert_eq!(
            [0x3c00, 0x8000, 0x0001, 0x7bff, 0x3555].map(half),
            [1.0, -0.0, 2f64.powi(-24), 65_504.0, 1365.0 / 4096.0]
        );
        assert!(half(0x7c00) == f64::INFINITY && half(0xfc00) == f64::NEG_INFINITY && half(0x7e01).is_nan());
    }
}
