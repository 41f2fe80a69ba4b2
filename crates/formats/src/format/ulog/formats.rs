//! The formats of a ULog: text that describes the layout of messages.

use super::ulog_record::{Basic, array, basic};
use crate::decode::Wanted;
use crate::decode::packed::{Layout, PackedField, PackedKind};
use crate::decode::schema::Number;
use std::cell::Cell;
use std::collections::HashMap;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::rc::Rc;

/// Formats nested deeper than this are rejected.
const MOST_NESTED: usize = 32;
/// Maximum formats in one log.
const MOST_FORMATS: usize = 65_536;
/// Maximum memory for the text of all formats, bytes.
const MOST_TEXT: usize = 16 << 20;
/// Maximum formats replaced by others of the same name.
const MOST_REPLACED: u64 = 100;
/// Maximum fields visited to size all formats: definitions can refer to each other repeatedly.
const MOST_MEASURED: u64 = 10_000_000;
/// Maximum fields visited to lay out all messages of a log: each wanted field is a column.
const MOST_LAID_OUT: u32 = 1 << 17;
/// Bytes that a message has for its fields, after its number.
const LONGEST_MESSAGE: u64 = u16::MAX as u64 - 2;
/// Longest path of a field, bytes.
const LONGEST_PATH: usize = 512;

/// All formats so far.
#[derive(Debug, Default)]
pub(super) struct Formats {
    by_name: HashMap<String, Format>,
    text_bytes: usize,
    /// How often a format was replaced by another of the same name.
    pub(super) replaced: u64,
    /// How many formats were accepted.
    pub(super) version: u64,
    measured: HashMap<String, Extent>,
    looked_at: u64,
    /// Fields that were laid out.
    laid_out: Cell<u32>,
}

#[derive(Debug, Clone, PartialEq)]
struct Format {
    text: String,
    /// Represents the text, which may be long.
    digest: u64,
    fields: Rc<[Field]>,
}

#[derive(Debug, Clone, PartialEq)]
struct Field {
    name: String,
    kind: FieldKind,
    count: Option<u32>,
}

#[derive(Debug, Clone, PartialEq)]
enum FieldKind {
    Basic(Basic),
    Nested(String),
}

/// Length of a message, and position of its timestamp.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Extent {
    /// Without the padding at its end, which PX4 does not write.
    pub(super) shortest: usize,
    pub(super) full: usize,
    pub(super) stamp: Option<Stamp>,
}

impl Extent {
    /// Whether a message has the expected length: with the padding at its end or without. Two bytes come before
    /// its fields.
    #[inline]
    pub(super) fn fits(&self, body: &[u8]) -> bool {
        let length = body.len().saturating_sub(2);
        length == self.shortest || length == self.full
    }
}

/// The field `timestamp`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Stamp {
    pub(super) offset: usize,
    pub(super) number: Number,
}

impl Field {
    fn parse(text: &str) -> Option<Field> {
        let (kind, name) = text.trim().split_once(' ')?;
        let (element, count) = match array(kind) {
            Some((element, count)) => (element, Some(count)),
            None if kind.contains('[') => return None,
            None => (kind, None),
        };
        let kind = basic(element).map_or_else(|| FieldKind::Nested(element.to_owned()), FieldKind::Basic);
        Some(Field { name: name.trim().to_owned(), kind, count })
    }

    fn is_padding(&self) -> bool {
        self.name.starts_with("_padding")
    }
}

impl Formats {
    /// Takes a format, `name:type field;type field;`. The error returned says what is wrong.
    pub(super) fn add(&mut self, text: &[u8]) -> Result<(), String> {
        let text = std::str::from_utf8(text).map_err(|_| "a format that is not UTF-8".to_owned())?;
        let (name, rest) = text.split_once(':').ok_or("a format without a name")?;
        let parts = rest.split(';').filter(|part| !part.trim().is_empty());
        let fields: Option<Rc<[Field]>> = parts.map(Field::parse).collect();
        let fields = fields.ok_or_else(|| format!("the format {name:.128} has a field that cannot be read"))?;
        let mut digest = DefaultHasher::new();
        text.hash(&mut digest);
        let format = Format { text: text.to_owned(), digest: digest.finish(), fields };
        if self.by_name.get(name) == Some(&format) {
            return Ok(());
        }
        self.text_bytes += text.len();
        if self.by_name.len() >= MOST_FORMATS || self.text_bytes > MOST_TEXT || self.replaced >= MOST_REPLACED {
            return Err("there are too many formats".to_owned());
        }
        self.version += 1;
        if self.by_name.insert(name.to_owned(), format).is_some() {
            self.replaced += 1;
            self.measured.clear();
        }
        Ok(())
    }

    pub(super) fn has(&self, name: &str) -> bool {
        self.by_name.contains_key(name)
    }

    /// Identifies the layout of `name` among earlier ones of the same name.
    pub(super) fn identity(&self, name: &str) -> String {
        let digest = self.by_name.get(name).map_or(0, |format| format.digest);
        format!("{} {digest:x}", self.replaced)
    }

    /// Size of a message of format `name`. The error names the format.
    pub(super) fn extent(&mut self, name: &str) -> Result<Extent, String> {
        self.measure(name, 0)
    }

    fn measure(&mut self, name: &str, depth: usize) -> Result<Extent, String> {
        if let Some(extent) = self.measured.get(name) {
            return Ok(*extent);
        }
        if depth > MOST_NESTED {
            return Err(format!("the format {name:.128} contains itself, or is nested more than {MOST_NESTED} deep"));
        }
        let format = self.by_name.get(name).ok_or_else(|| format!("the log does not define the format {name:.128}"))?;
        let fields = Rc::clone(&format.fields);
        let (mut extent, mut size) = (Extent::default(), 0_u64);
        for field in fields.iter() {
            self.looked_at += 1;
            if self.looked_at > MOST_MEASURED {
                return Err("the formats refer to each other too many times".to_owned());
            }
            if let (true, FieldKind::Basic(Basic::Number(number)), None) =
                (field.name == "timestamp", &field.kind, field.count)
            {
                extent.stamp = Some(Stamp { offset: size as usize, number: *number });
            }
            let element = match &field.kind {
                FieldKind::Basic(basic) => basic.size() as u64,
                FieldKind::Nested(inner) => self.measure(inner, depth + 1)?.full as u64,
            };
            size = size.saturating_add(element.saturating_mul(field.count.unwrap_or(1).into()));
            if size > LONGEST_MESSAGE {
                return Err(format!("the field {:.128} of {name:.128} does not fit into a message", field.name));
            }
            if !field.is_padding() {
                extent.shortest = size as usize;
            }
        }
        extent.full = size as usize;
        self.measured.insert(name.to_owned(), extent);
        Ok(extent)
    }

    /// Positions of the wanted fields in a message of format `name`. Its extent must be known.
    pub(super) fn layout(&self, name: &str, wanted: &Wanted) -> Result<Layout, String> {
        let extent = self.measured.get(name).copied().unwrap_or_default();
        let mut flat = Flat { formats: self, wanted, fields: vec![] };
        flat.message(name, "", 0)?;
        Ok(Layout { fields: flat.fields, shortest: extent.shortest, longest: extent.full })
    }

    /// Position of a single number, such as a state. The extent of the message must be known.
    pub(super) fn place(&self, name: &str, field: &str, number: Number) -> Option<usize> {
        let mut offset = 0_usize;
        for known in self.by_name.get(name)?.fields.iter() {
            if known.name == field {
                let is_it = known.kind == FieldKind::Basic(Basic::Number(number)) && known.count.is_none();
                return is_it.then_some(offset);
            }
            offset = offset.saturating_add(self.size_of(known));
        }
        None
    }

    /// Size of a field with all its elements, bytes. The extent of the message must be known.
    fn size_of(&self, field: &Field) -> usize {
        self.element_size(field).saturating_mul(field.count.unwrap_or(1) as usize)
    }

    fn element_size(&self, field: &Field) -> usize {
        match &field.kind {
            FieldKind::Basic(basic) => basic.size(),
            FieldKind::Nested(inner) => self.measured.get(inner).map_or(0, |extent| extent.full),
        }
    }
}

/// Nested formats become dotted paths, elements `path[0]`.
struct Flat<'f> {
    formats: &'f Formats,
    wanted: &'f Wanted,
    fields: Vec<PackedField>,
}

impl Flat<'_> {
    fn message(&mut self, name: &str, prefix: &str, start: usize) -> Result<(), String> {
        let Some(format) = self.formats.by_name.get(name) else { return Ok(()) };
        let mut offset = start;
        for field in format.fields.iter() {
            self.spend(name)?;
            let size = self.formats.element_size(field);
            if !field.is_padding() && size > 0 {
                self.field(field, format!("{prefix}{}", field.name), offset, size)?;
            }
            offset = offset.saturating_add(self.formats.size_of(field));
        }
        Ok(())
    }

    fn field(&mut self, field: &Field, path: String, offset: usize, size: usize) -> Result<(), String> {
        if path.len() > LONGEST_PATH {
            return Err(format!("the name of the field {path:.128} is too long"));
        }
        match (&field.kind, field.count) {
            (FieldKind::Basic(Basic::Char), count) => {
                self.push(path, offset, PackedKind::Text(count.unwrap_or(1) as usize));
            }
            (FieldKind::Basic(Basic::Number(number)), None) => self.push(path, offset, PackedKind::Number(*number)),
            (FieldKind::Nested(inner), None) => self.nested(inner, &path, offset)?,
            (kind, Some(count)) => {
                for index in self.wanted.elements(&path, count).into_iter().filter(|&index| index < count) {
                    self.spend(&path)?;
                    let (path, offset) = (format!("{path}[{index}]"), offset + index as usize * size);
                    match kind {
                        FieldKind::Basic(Basic::Number(number)) => self.push(path, offset, PackedKind::Number(*number)),
                        FieldKind::Nested(inner) => self.nested(inner, &path, offset)?,
                        FieldKind::Basic(Basic::Char) => {}
                    }
                }
            }
        }
        Ok(())
    }

    /// Fails if too many fields were laid out.
    fn spend(&self, name: &str) -> Result<(), String> {
        let laid_out = self.formats.laid_out.get();
        if laid_out >= MOST_LAID_OUT {
            return Err(format!("the formats have too many fields, first in {name:.128}"));
        }
        self.formats.laid_out.set(laid_out + 1);
        Ok(())
    }

    fn nested(&mut self, inner: &str, path: &str, offset: usize) -> Result<(), String> {
        if self.wanted.below(path) { self.message(inner, &format!("{path}."), offset) } else { Ok(()) }
    }

    fn push(&mut self, path: String, offset: usize, kind: PackedKind) {
        if self.wanted.has(&path) {
            self.fields.push(PackedField { path, offset, kind, scale: None });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn formats(texts: &[&str]) -> Formats {
        let mut formats = Formats::default();
        texts.iter().for_each(|text| formats.add(text.as_bytes()).unwrap());
        formats
    }

    #[test]
    fn nested_formats_arrays_and_padding_follow_the_c_layout() {
        let mut formats = formats(&[
            "esc_status:uint64_t timestamp;esc_report[2] esc;char[4] name;uint8_t n;uint8_t[7] _padding0;",
            "esc_report:float rpm;uint8_t state;uint8_t[3] _padding0;",
        ]);
        let extent = formats.extent("esc_status").unwrap();
        let stamp = Some(Stamp { offset: 0, number: Number::U64 });
        assert_eq!(extent, Extent { shortest: 29, full: 36, stamp });
        let layout = formats.layout("esc_status", &Wanted::All).unwrap();
        let places: Vec<(&str, usize)> = layout.fields.iter().map(|f| (f.path.as_str(), f.offset)).collect();
        let expected = [
            ("timestamp", 0),
            ("esc[0].rpm", 8),
            ("esc[0].state", 12),
            ("esc[1].rpm", 16),
            ("esc[1].state", 20),
            ("name", 24),
            ("n", 28),
        ];
        assert_eq!(places, expected);
        let some = formats.layout("esc_status", &Wanted::of_paths(["esc[1].state", "esc[2].state"])).unwrap();
        assert_eq!(some.fields.iter().map(|f| f.offset).collect::<Vec<_>>(), [20]);
        assert_eq!(formats.place("esc_status", "n", Number::U8), Some(28));
    }

    #[test]
    fn a_cycle_a_missing_format_and_an_impossible_size_are_rejected_by_name() {
        let mut formats = formats(&[
            "a:uint64_t timestamp;b x;",
            "b:a y;",
            "big:uint8_t[2000000000] x;",
            "huge:big2[4000000000] x;",
            "big2:big3[4000000000] x;",
            "big3:uint64_t[60] x;",
            "lone:gone x;",
            "hollow:none[4000000000] x;uint8_t y;",
            "none:",
        ]);
        for (name, what) in
            [("a", "contains itself"), ("big", "field x of big"), ("huge", "does not fit"), ("lone", "format gone")]
        {
            let error = formats.extent(name).unwrap_err();
            assert!(error.contains(what), "{name}: {error}");
        }
        assert_eq!(formats.extent("hollow").unwrap().full, 1);
        assert_eq!(formats.layout("hollow", &Wanted::All).unwrap().fields.len(), 1);
    }

    #[test]
    fn exponentially_nested_formats_terminate() {
        let mut formats = Formats::default();
        for level in 0..30 {
            let text = format!("f{level}:{}", format!("f{} x;", level + 1).repeat(1000));
            formats.add(text.as_bytes()).unwrap();
        }
        formats.add(b"f30:").unwrap();
        assert_eq!(formats.extent("f0").unwrap().full, 0);
        formats.add(b"g:f0 x;uint8_t y;").unwrap();
        formats.extent("g").unwrap();
        assert_eq!(formats.layout("g", &Wanted::All).unwrap().fields.len(), 1);
        // Never known, so never remembered.
        let mut open = Formats::default();
        for level in 0..33 {
            open.add(format!("f{level}:{}", format!("f{} x;", level + 1).repeat(1000)).as_bytes()).unwrap();
        }
        for _ in 0..1000 {
            open.extent("f0").unwrap_err();
        }
    }

    #[test]
    fn a_replaced_format_is_measured_again_up_to_a_limit() {
        let mut formats = formats(&["a:uint8_t x;"]);
        assert_eq!(formats.extent("a").unwrap().full, 1);
        let before = formats.identity("a");
        formats.add(b"a:float x;").unwrap();
        assert_eq!(formats.extent("a").unwrap().full, 4);
        assert_ne!(formats.identity("a"), before);
        let results = (0..2000).map(|i| formats.add(format!("a:uint8_t[{i}] x;").as_bytes()));
        assert_eq!(results.filter(Result::is_err).count(), 1901);
    }
}
