//! The messages that MAVLink defines: their layout, and the byte that represents it in their checksum.

use super::checksum::Checksum;
use crate::decode::packed::{Layout, PackedField, PackedKind};
use crate::decode::schema::Number;
use std::sync::LazyLock;

/// One line per message.
const TABLE: &str = include_str!("messages.txt");

/// The messages by number.
pub(super) struct Definitions(Vec<Definition>);

/// A message.
#[derive(Debug)]
pub(super) struct Definition {
    number: u32,
    pub(super) name: &'static str,
    /// Number of its fields, without and with MAVLink 2 extensions.
    fields: [&'static str; 2],
    /// Included in the checksum, so that sender and receiver agree on the layout.
    pub(super) extra: u8,
    /// Bytes of its payload, without and with MAVLink 2 extensions.
    lengths: [usize; 2],
    /// Position of its ignore flags in the payload, 16 bits.
    ignore_at: Option<usize>,
}

impl Definitions {
    /// All definitions, parsed once.
    pub(super) fn all() -> &'static Definitions {
        static ALL: LazyLock<Definitions> = LazyLock::new(|| {
            let mut all: Vec<Definition> = TABLE.lines().filter_map(Definition::parse).collect();
            all.sort_by_key(|d| d.number);
            Definitions(all)
        });
        &ALL
    }

    pub(super) fn get(&self, number: u32) -> Option<&Definition> {
        let at = self.0.binary_search_by_key(&number, |d| d.number).ok()?;
        self.0.get(at)
    }
}

impl Definition {
    /// `24 GPS_RAW_INT: uint64 time_usec, int32 lat | int32 alt_ellipsoid`; `None` for a comment.
    fn parse(line: &'static str) -> Option<Definition> {
        let (head, all) = line.split_once(": ")?;
        let (number, name) = head.split_once(' ')?;
        let base = all.split(" | ").next().unwrap_or(all);
        let fields = [base, all];
        let lengths = fields.map(|text| fields_of(text).map(|f| f.kind.size() * f.count.unwrap_or(1)).sum());
        let ignore_at = ignore_at(base);
        Some(Definition { number: number.parse().ok()?, name, fields, extra: extra(name, base), lengths, ignore_at })
    }

    /// Bytes of a payload; `wide` includes the MAVLink 2 extensions.
    pub(super) fn length(&self, wide: bool) -> usize {
        let [base, all] = self.lengths;
        if wide { all } else { base }
    }

    /// Distinguishes one layout from another.
    pub(super) fn text(&self, wide: bool) -> &'static str {
        let [base, all] = self.fields;
        if wide { all } else { base }
    }

    /// What the reader prepends to a payload: for a message with ignore flags, their inverse, because a channel map
    /// asks for bits that are set.
    pub(super) fn derived(&self, payload: &[u8]) -> Option<[u8; 2]> {
        let flags = payload.get(self.ignore_at?..)?.first_chunk()?;
        Some((!u16::from_le_bytes(*flags)).to_le_bytes())
    }

    /// Positions of all fields in a payload, after what [`Definition::derived`] returns.
    pub(super) fn layout(&self, wide: bool) -> Layout {
        let mut offset = 0;
        let mut fields = vec![];
        if self.ignore_at.is_some() {
            let kind = PackedKind::Number(Number::U16);
            fields.push(PackedField { path: "use_flags".to_owned(), offset, kind, scale: None });
            offset += kind.size();
        }
        for field in fields_of(self.text(wide)) {
            let elements = match (field.kind, field.count) {
                (_, None) | (PackedKind::Text(_), _) => vec![field.name.to_owned()],
                (_, Some(count)) => (0..count).map(|i| format!("{}[{i}]", field.name)).collect(),
            };
            let kind = match (field.kind, field.count) {
                (PackedKind::Text(_), count) => PackedKind::Text(count.unwrap_or(1)),
                (kind, _) => kind,
            };
            for path in elements {
                fields.push(PackedField { path, offset, kind, scale: None });
                offset += kind.size();
            }
        }
        Layout { fields, shortest: offset, longest: offset }
    }
}

struct Field<'t> {
    type_name: &'t str,
    name: &'t str,
    kind: PackedKind,
    /// Elements of an array.
    count: Option<usize>,
}

fn fields_of(text: &str) -> impl Iterator<Item = Field<'_>> {
    text.split([',', '|']).filter_map(|field| {
        let (type_name, name) = field.trim().split_once(' ')?;
        let (name, count) = match name.trim_end_matches(']').split_once('[') {
            Some((name, count)) => (name, Some(count.parse().ok()?)),
            None => (name, None),
        };
        let number = match type_name {
            "char" => return Some(Field { type_name, name, kind: PackedKind::Text(1), count }),
            "uint8" => Number::U8,
            "int8" => Number::I8,
            "uint16" => Number::U16,
            "int16" => Number::I16,
            "uint32" => Number::U32,
            "int32" => Number::I32,
            "uint64" => Number::U64,
            "int64" => Number::I64,
            "float" => Number::F32,
            "double" => Number::F64,
            _ => return None,
        };
        Some(Field { type_name, name, kind: PackedKind::Number(number), count })
    })
}

fn ignore_at(text: &str) -> Option<usize> {
    let mut at = 0;
    for field in fields_of(text) {
        if (field.type_name, field.name) == ("uint16", "ignore_flags") {
            return Some(at);
        }
        at += field.kind.size() * field.count.unwrap_or(1);
    }
    None
}

/// `CRC_EXTRA`: the checksum over name, types and names of fields, folded
/// (<https://mavlink.io/en/guide/serialization.html#crc_extra>).
fn extra(name: &str, base: &str) -> u8 {
    let mut checksum = Checksum::new();
    checksum.add(name.as_bytes());
    checksum.add(b" ");
    for field in fields_of(base) {
        checksum.add(field.type_name.as_bytes());
        checksum.add(if matches!(field.type_name, "float" | "double" | "char") { b" " } else { b"_t " });
        checksum.add(field.name.as_bytes());
        checksum.add(b" ");
        checksum.add(field.count.map(|count| count as u8).as_slice());
    }
    let [low, high] = checksum.value().to_le_bytes();
    low ^ high
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_line_is_a_message_whose_fields_are_all_understood() {
        let lines: Vec<&str> = TABLE.lines().filter(|line| !line.starts_with('#')).collect();
        let all = Definitions::all();
        assert_eq!((all.0.len(), lines.len()), (393, 393));
        for line in lines {
            let number = line.split(' ').next().unwrap().parse().unwrap();
            let definition = all.get(number).unwrap();
            assert_eq!(fields_of(definition.text(true)).count(), line.matches([',', '|']).count() + 1, "{line}");
            assert!(definition.length(true) <= 255 && definition.length(false) <= definition.length(true), "{line}");
        }
    }

    #[test]
    fn crc_extra_values_match_those_that_mavlink_publishes() {
        let all = Definitions::all();
        for (number, name, extra, lengths) in [
            (0, "HEARTBEAT", 50, [9, 9]),
            (1, "SYS_STATUS", 124, [31, 43]),
            (22, "PARAM_VALUE", 220, [25, 25]),
            (24, "GPS_RAW_INT", 24, [30, 52]),
            (30, "ATTITUDE", 39, [28, 28]),
            (33, "GLOBAL_POSITION_INT", 104, [28, 28]),
            (148, "AUTOPILOT_VERSION", 178, [60, 78]),
            (253, "STATUSTEXT", 83, [51, 54]),
            (331, "ODOMETRY", 91, [230, 233]),
        ] {
            let d = all.get(number).unwrap();
            assert_eq!((d.name, d.extra, d.lengths), (name, extra, lengths));
        }
        assert!(all.get(1_000_000).is_none());
    }

    #[test]
    fn array_elements_have_a_column_each_and_characters_form_one_text() {
        let all = Definitions::all();
        let paths = |number: u32, wide| -> Vec<(String, usize)> {
            all.get(number).unwrap().layout(wide).fields.into_iter().map(|f| (f.path, f.offset)).collect()
        };
        assert_eq!(paths(253, false), [("severity".to_owned(), 0), ("text".to_owned(), 1)]);
        assert_eq!(
            paths(115, false)[1..3],
            [("attitude_quaternion[0]".into(), 8), ("attitude_quaternion[1]".into(), 12)]
        );
        assert_eq!(paths(24, true).last(), Some(&("yaw".to_owned(), 50)));
    }
}
