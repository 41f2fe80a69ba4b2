//! The layout of a record: its header, its definition by `FMT`, and single values from it.

use crate::decode::cells::{CellField, CellKind, CellLayout};
use crate::decode::packed::{self, Layout, PackedField, PackedKind, Scale};
use crate::decode::rows::Value;
use crate::decode::schema::Number;
use crate::decode::{Wanted, cells};
use std::borrow::Cow;

/// The first two bytes of every binary record.
pub(super) const SYNC: [u8; 2] = [0xa3, 0x95];
/// Sync bytes and the type.
pub(super) const HEADER: usize = 3;
/// The type of `FMT` records, and their length: the only type known from the start.
pub(super) const FMT_ID: u8 = 128;
pub(super) const FMT_LENGTH: usize = 89;
/// A length is one byte.
pub(super) const LONGEST_RECORD: usize = 255;
/// Characters of a text of type `Z`: names in `Columns` may be truncated there.
const LONGEST_TEXT: usize = 64;
/// Numbers in an array of type `a`.
const ARRAY: u32 = 32;

/// A type of records, as an `FMT` describes it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Format {
    pub(super) name: String,
    /// As written: format characters, a line feed, field names.
    pub(super) definition: String,
    /// Length stated by the `FMT`, header included.
    stated: usize,
    /// Total length of the format characters, header included; `None` if one of them is unknown.
    described: Option<usize>,
    pub(super) fields: Vec<Field>,
    /// Why its records cannot be decoded.
    pub(super) fault: Option<String>,
    pub(super) time: Option<TimeField>,
}

/// A field of a record.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Field {
    pub(super) name: String,
    /// Its format character.
    pub(super) code: u8,
    /// Offset after the header, bytes.
    offset: usize,
}

/// The field with the time of a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct TimeField {
    pub(super) field: usize,
    /// Offset after the header, bytes.
    pub(super) offset: usize,
    /// 64 bits wide; otherwise 32.
    pub(super) wide: bool,
    /// Nanoseconds in its unit.
    pub(super) tick_ns: i64,
}

impl Format {
    /// From the contents of an `FMT`. Fails if they are invalid.
    pub(super) fn new(length: u8, name: &str, codes: &str, columns: &str) -> Result<Format, String> {
        if name.is_empty() || !name.bytes().all(|b| b.is_ascii_graphic()) {
            return Err("a definition of a type without a valid name".to_owned());
        }
        let mut offset = 0;
        let mut names = columns.split(',').map(str::trim).filter(|n| !n.is_empty());
        let mut fields = vec![];
        let mut fault = None;
        for code in codes.bytes() {
            let Some(size) = size_of(code) else {
                fault = Some(format!("its format has the unknown character {:?}", char::from(code)));
                break;
            };
            if let Some(name) = names.next() {
                fields.push(Field { name: name.to_owned(), code, offset });
            }
            offset += size;
        }
        if fault.is_none() && HEADER + offset > LONGEST_RECORD {
            fault = Some(format!(
                "its format adds up to {} bytes, but a record has at most {LONGEST_RECORD}",
                HEADER + offset
            ));
        }
        let described = fault.is_none().then_some(HEADER + offset);
        let missing = codes.len().saturating_sub(fields.len());
        if fault.is_none() && (names.next().is_some() || (missing > 0 && columns.len() < LONGEST_TEXT)) {
            fault = Some(format!("it has {} values, but another number of names ({columns})", codes.len()));
        }
        let time = time_field(name, &fields);
        let definition = format!("{codes}\n{columns}");
        Ok(Format { name: name.to_owned(), definition, stated: length.into(), described, fields, fault, time })
    }

    /// Whether an `FMT` is self-consistent: it describes records of the length that it states. Then nothing
    /// after it needs to vouch for it.
    pub(super) fn agrees(record: &[u8]) -> bool {
        let Some(&length) = record.get(HEADER + 1) else { return false };
        // Name and format characters first: where sync bytes are consecutive, much looks like an `FMT`.
        let plain = |b: &u8| *b == 0 || b.is_ascii_graphic();
        if !record.get(HEADER + 2..HEADER + 22).is_some_and(|texts| texts.iter().all(plain)) {
            return false;
        }
        let text =
            |from: usize, to: usize| record.get(HEADER + from..HEADER + to).map(packed::text_of).unwrap_or_default();
        let format = Format::new(length, &text(2, 6), &text(6, 22), &text(22, 86));
        format.is_ok_and(|f| f.fault.is_none() && !f.fields.is_empty() && f.described == Some(f.stated))
    }

    /// The definition of definitions.
    pub(super) fn of_formats() -> Format {
        let columns = "Type,Length,Name,Format,Columns";
        let fields = [(b'B', 0), (b'B', 1), (b'n', 2), (b'N', 6), (b'Z', 22)];
        let fields = columns.split(',').zip(fields);
        Format {
            name: "FMT".to_owned(),
            definition: format!("BBnNZ\n{columns}"),
            stated: FMT_LENGTH,
            described: Some(FMT_LENGTH),
            fields: fields.map(|(name, (code, offset))| Field { name: name.to_owned(), code, offset }).collect(),
            fault: None,
            time: None,
        }
    }

    /// Length of a record, header included: the total of the format characters, or else the length stated by the `FMT`.
    pub(super) fn length(&self) -> Option<usize> {
        self.described.or(Some(self.stated).filter(|stated| *stated >= HEADER))
    }

    /// Whether records of this length match the format characters.
    fn describes(&self, length: usize) -> bool {
        self.described == Some(length)
    }

    /// Whether a record of this length is to be read, or is unreadable in any case.
    pub(super) fn fits(&self, length: usize) -> bool {
        self.fault.is_some() || self.describes(length)
    }

    /// Number of format characters.
    pub(super) fn codes(&self) -> usize {
        self.definition.find('\n').unwrap_or_default()
    }

    pub(super) fn field(&self, name: &str) -> Option<usize> {
        self.fields.iter().position(|f| f.name == name)
    }

    /// The field with the instance if no `FMTU` names it: by ArduPilot's naming.
    pub(super) fn usual_instance(&self) -> Option<usize> {
        let estimator = ["XK", "NK"].iter().any(|start| self.name.starts_with(start));
        self.fields.iter().position(|f| match f.name.as_str() {
            "I" | "Instance" => b"BbHhiI".contains(&f.code),
            "C" => estimator && b"BbHhiI".contains(&f.code),
            "Inst" => b"Bb".contains(&f.code),
            "IMU" => self.name == "VIBE" && b"Bb".contains(&f.code),
            _ => false,
        })
    }

    /// Positions of the values in a binary record.
    pub(super) fn packed_layout(&self, wanted: &Wanted) -> Result<Layout, String> {
        self.decodable()?;
        let size = self.described.unwrap_or(HEADER) - HEADER;
        let fields = self.fields.iter().flat_map(|field| field.packed(wanted)).collect();
        Ok(Layout { fields, shortest: size, longest: size })
    }

    /// The cells of a line that hold the values.
    pub(super) fn cell_layout(&self) -> Result<CellLayout, String> {
        self.decodable()?;
        let field = |(cell, f): (usize, &Field)| CellField { path: f.name.clone(), cell, kind: f.cell_kind() };
        let fields = self.fields.iter().enumerate().map(field).collect();
        Ok(CellLayout { fields, cells: self.fields.len() })
    }

    fn decodable(&self) -> Result<(), String> {
        self.fault.as_ref().map_or(Ok(()), |fault| Err(fault.clone()))
    }

    /// Whether the last value of a line is text, which may contain commas.
    pub(super) fn ends_in_text(&self) -> bool {
        self.fields.last().is_some_and(|f| f.cell_kind() == CellKind::Text)
    }

    /// Whether the text that ends a line is longer than its field: a lost line end merges two lines.
    pub(super) fn text_is_too_long(&self, values: &str) -> bool {
        let last = values.splitn(self.fields.len(), ',').last().unwrap_or_default();
        match self.fields.last().and_then(|f| kind_of(f.code)) {
            Some((PackedKind::Text(length), _)) => characters(last.trim()) > length,
            _ => false,
        }
    }
}

impl Field {
    fn packed(&self, wanted: &Wanted) -> Vec<PackedField> {
        let one = |path: String, offset, kind, scale| PackedField { path, offset, kind, scale };
        if self.code == b'a' {
            let element = |i: u32| {
                one(format!("{}[{i}]", self.name), self.offset + 2 * i as usize, PackedKind::Number(Number::I16), None)
            };
            return wanted.elements(&self.name, ARRAY).into_iter().filter(|i| *i < ARRAY).map(element).collect();
        }
        let Some((kind, divisor)) = kind_of(self.code) else { return vec![] };
        let scale = divisor.map(|divisor| Scale { factor: 1.0, divisor });
        vec![one(self.name.clone(), self.offset, kind, scale)]
    }

    fn cell_kind(&self) -> CellKind {
        match self.code {
            b'n' | b'N' | b'Z' | b'M' | b'a' => CellKind::Text,
            b'q' | b'Q' => CellKind::Whole,
            _ => CellKind::Number,
        }
    }

    pub(super) fn is_text(&self) -> bool {
        self.cell_kind() == CellKind::Text
    }

    /// Whether its format character has its own scale, which is applied.
    pub(super) fn is_scaled(&self) -> bool {
        kind_of(self.code).is_some_and(|(_, divisor)| divisor.is_some())
    }
}

/// The stored type of a format character, and the divisor of the number.
fn kind_of(code: u8) -> Option<(PackedKind, Option<f64>)> {
    let number = |number, divisor| Some((PackedKind::Number(number), divisor));
    match code {
        b'b' => number(Number::I8, None),
        b'B' | b'M' => number(Number::U8, None),
        b'h' => number(Number::I16, None),
        b'H' => number(Number::U16, None),
        b'i' => number(Number::I32, None),
        b'I' => number(Number::U32, None),
        b'q' => number(Number::I64, None),
        b'Q' => number(Number::U64, None),
        b'f' => number(Number::F32, None),
        b'd' => number(Number::F64, None),
        b'c' => number(Number::I16, Some(1e2)),
        b'C' => number(Number::U16, Some(1e2)),
        b'e' => number(Number::I32, Some(1e2)),
        b'E' => number(Number::U32, Some(1e2)),
        b'L' => number(Number::I32, Some(1e7)),
        b'g' => Some((PackedKind::Half, None)),
        b'n' => Some((PackedKind::Text(4), None)),
        b'N' => Some((PackedKind::Text(16), None)),
        b'Z' => Some((PackedKind::Text(LONGEST_TEXT), None)),
        _ => None,
    }
}

fn size_of(code: u8) -> Option<usize> {
    match code {
        b'a' => Some(2 * ARRAY as usize),
        _ => kind_of(code).map(|(kind, _)| kind.size()),
    }
}

/// `TimeUS` since 2014, milliseconds before. The `TimeMS` of an old GPS record is the receiver's time of week; its
/// `T` is when the autopilot received it. PX4's sdlog2 logs the time in a separate record before the others; one
/// type of ArduPilot has another name for it.
fn time_field(name: &str, fields: &[Field]) -> Option<TimeField> {
    let new = match name {
        "TIME" => "StartTime",
        "AIS4" => "US",
        _ => "TimeUS",
    };
    let old = if name.starts_with("GPS") { "T" } else { "TimeMS" };
    [(new, b'Q', 1000), (old, b'I', 1_000_000)].into_iter().find_map(|(wanted, code, tick_ns)| {
        let field = fields.iter().position(|f| f.name == wanted && f.code == code)?;
        let offset = fields.get(field)?.offset;
        Some(TimeField { field, offset, wide: code == b'Q', tick_ns })
    })
}

/// The values of one record.
#[derive(Debug, Clone, Copy)]
pub(super) enum Body<'r> {
    /// Bytes after the header.
    Packed(&'r [u8]),
    /// What follows the name and its comma on the line.
    Line(&'r str),
}

impl<'r> Body<'r> {
    /// The bytes that are decoded.
    pub(super) fn payload(self) -> &'r [u8] {
        match self {
            Body::Packed(bytes) => bytes,
            Body::Line(line) => line.as_bytes(),
        }
    }

    /// A whole number of one byte.
    pub(super) fn byte(self, format: &Format, field: usize) -> Option<u8> {
        match (self, format.fields.get(field)?) {
            (Body::Packed(bytes), Field { code: b'B', offset, .. }) => bytes.get(*offset).copied(),
            _ => self.integer(format, field).and_then(|number| u8::try_from(number).ok()),
        }
    }

    /// A whole number.
    pub(super) fn integer(self, format: &Format, field: usize) -> Option<i64> {
        match self.value(format, field)? {
            Cell::Number(Value::Integer(x)) => Some(x),
            Cell::Number(Value::Float(x)) if x.fract() == 0.0 && x.abs() < 9e15 => Some(x as i64),
            Cell::Text(text) => text.parse().ok(),
            Cell::Number(_) => None,
        }
    }

    /// A number as stored in the record, not scaled.
    pub(super) fn number(self, format: &Format, field: usize) -> Option<f64> {
        match self.value(format, field)? {
            Cell::Number(Value::Integer(x)) => Some(x as f64),
            Cell::Number(Value::Large(x)) => Some(x as f64),
            Cell::Number(Value::Float(x)) => Some(x),
            Cell::Text(text) => cells::number(&text),
            Cell::Number(Value::Text(_)) => None,
        }
    }

    /// Text; `None` for a number in a binary record.
    pub(super) fn text(self, format: &Format, field: usize) -> Option<Cow<'r, str>> {
        match self.value(format, field)? {
            Cell::Text(text) => Some(text),
            Cell::Number(_) => None,
        }
    }

    fn value(self, format: &Format, field: usize) -> Option<Cell<'r>> {
        let place = format.fields.get(field)?;
        match self {
            Body::Line(line) => {
                let last = field + 1 == format.fields.len() && format.ends_in_text();
                cells::cell(line, field, last).map(|text| Cell::Text(Cow::Borrowed(text)))
            }
            Body::Packed(bytes) => match kind_of(place.code)?.0 {
                PackedKind::Number(number) => {
                    bytes.get(place.offset..).and_then(|b| packed::number_of(number, b)).map(Cell::Number)
                }
                PackedKind::Text(length) => {
                    bytes.get(place.offset..place.offset + length).map(packed::text_of).map(Cell::Text)
                }
                PackedKind::Half => None,
            },
        }
    }
}

/// Length of a text in its field, in characters: Mission Planner writes unprintable ones as `\n` or `\x1B`.
fn characters(text: &str) -> usize {
    let mut rest = text.chars();
    let mut count = 0;
    while let Some(character) = rest.next() {
        count += 1;
        let mut behind = rest.clone();
        let digits = |of: &mut std::str::Chars<'_>| of.by_ref().take(2).filter(char::is_ascii_hexdigit).count();
        match (character, behind.next()) {
            ('\\', Some('\\' | 'n' | 'r' | 't')) => rest = behind,
            ('\\', Some('x')) if digits(&mut behind) == 2 => rest = behind,
            _ => {}
        }
    }
    count
}

enum Cell<'r> {
    Number(Value<'static>),
    Text(Cow<'r, str>),
}
