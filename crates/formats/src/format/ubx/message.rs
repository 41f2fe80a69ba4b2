//! The messages that are read.

use crate::decode::packed::{Layout, PackedField, PackedKind};
use crate::decode::schema::Number;
use std::sync::LazyLock;

/// One line per message.
const TABLE: &str = include_str!("messages.txt");

/// Classes by number.
const CLASSES: &str =
    "01:NAV 02:RXM 04:INF 05:ACK 06:CFG 09:UPD 0a:MON 0b:AID 0d:TIM 10:ESF 13:MGA 21:LOG 27:SEC 28:HNR 29:NAV2";

/// Class and number of each message that is read, and the message.
static MESSAGES: LazyLock<Vec<((u8, u8), Message)>> = LazyLock::new(|| TABLE.lines().filter_map(parse).collect());

fn parse(line: &'static str) -> Option<((u8, u8), Message)> {
    let (head, fields) = line.split_once(": ")?;
    let mut words = head.split(' ');
    let mut byte = || u8::from_str_radix(words.next()?, 16).ok();
    let key = (byte()?, byte()?);
    Some((key, Message { name: words.next()?, shortest: words.next()?.parse().ok()?, fields }))
}

/// A message that is read.
#[derive(Debug, Clone, Copy)]
pub(super) struct Message {
    pub(super) name: &'static str,
    /// Length of the shortest payload.
    pub(super) shortest: usize,
    fields: &'static str,
}

/// Derived fields that the reader prepends to a payload, little-endian.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Derived {
    /// GPS week of `iTOW`, or of a pulse; 0 if it is not known yet.
    pub(super) week: u16,
    /// GPS time of week of a pulse, ms; 0 if unknown.
    pub(super) tow_ms: u32,
    /// Whether the receiver trusts its fix; 1 if it does not say.
    pub(super) fix_ok: bool,
    /// Carrier phase ambiguities: 0 unresolved, 1 float, 2 fixed.
    pub(super) carrier: u8,
    /// Position with all digits: latitude and longitude, deg, and height, m; or ECEF, m. For an ECEF velocity
    /// the position at which it was measured, or the centre of the earth if that is unknown.
    pub(super) place: [f64; 3],
}

/// Length of [`Derived`] before a payload.
const FRONT: usize = 3;
const FRONT_PLACE: usize = FRONT + 24;
const FRONT_PULSE: usize = FRONT + 4;
const FRONT_CARRIER: usize = FRONT + 1;

impl Message {
    /// `None` for a message that is only counted.
    pub(super) fn of(class: u8, number: u8) -> Option<Message> {
        MESSAGES.iter().find(|(key, _)| *key == (class, number)).map(|(_, message)| *message)
    }

    /// Field names of [`Derived::place`], if it is prepended.
    fn place(self) -> Option<&'static str> {
        Some(match self.name {
            "NAV-HPPOSLLH" => "R8 latitude, R8 longitude, R8 ellipsoid_height",
            "NAV-HPPOSECEF" => "R8 place_x, R8 place_y, R8 place_z",
            "NAV-VELECEF" => "R8 at_x, R8 at_y, R8 at_z",
            _ => return None,
        })
    }

    /// Whether it describes a pulse: it may count UTC, or the time of a system other than GPS.
    pub(super) fn is_pulse(self) -> bool {
        matches!(self.name, "TIM-TP" | "TIM-TM2")
    }

    /// Whether it has the state of the carrier phase solution.
    fn has_carrier(self) -> bool {
        matches!(self.name, "NAV-PVT" | "NAV2-PVT" | "NAV-PVAT")
    }

    /// The derived fields, and the positions of all fields after them.
    pub(super) fn layout(self) -> Layout {
        let mut fields = vec![];
        let mut offset = 0;
        let derived = "U2 gps_week, U1 fix_ok";
        let (more, front) = match (self.place(), self.is_pulse()) {
            (Some(place), _) => (place, FRONT_PLACE),
            (None, true) => ("U4 gps_tow_ms", FRONT_PULSE),
            _ if self.has_carrier() => ("U1 carrier", FRONT_CARRIER),
            _ => ("", FRONT),
        };
        for field in [derived, more, self.fields].into_iter().flat_map(|part| part.split(',')) {
            let Some((type_name, name)) = field.trim().split_once(' ') else { continue };
            let kind = match type_name {
                "U1" => Number::U8,
                "I1" => Number::I8,
                "U2" => Number::U16,
                "I2" => Number::I16,
                "U4" => Number::U32,
                "I4" => Number::I32,
                "R8" => Number::F64,
                // Three reserved bytes.
                _ => {
                    offset += 3;
                    continue;
                }
            };
            let kind = PackedKind::Number(kind);
            if name != "-" {
                fields.push(PackedField { path: name.to_owned(), offset, kind, scale: None });
            }
            offset += kind.size();
        }
        // Later protocols add fields at the end.
        Layout { fields, shortest: front + self.shortest, longest: usize::MAX }
    }

    /// Writes the derived fields and the payload.
    pub(super) fn assemble(self, derived: Derived, payload: &[u8], bytes: &mut Vec<u8>) {
        bytes.clear();
        bytes.extend(derived.week.to_le_bytes());
        bytes.push(u8::from(derived.fix_ok));
        if self.place().is_some() {
            bytes.extend(derived.place.iter().flat_map(|value| value.to_le_bytes()));
        }
        if self.is_pulse() {
            bytes.extend(derived.tow_ms.to_le_bytes());
        }
        if self.has_carrier() {
            bytes.push(derived.carrier);
        }
        bytes.extend_from_slice(payload);
    }
}

/// Name of any message, as `NAV-PVT` or `RXM-0x15`.
pub(super) fn name(class: u8, number: u8) -> String {
    if let Some(message) = Message::of(class, number) {
        return message.name.to_owned();
    }
    match CLASSES.split(' ').find_map(|known| known.strip_prefix(&format!("{class:02x}:"))) {
        Some(class) => format!("{class}-0x{number:02X}"),
        None => format!("0x{class:02X}-0x{number:02X}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layouts_have_the_lengths_of_the_interface_description() {
        assert_eq!(MESSAGES.len(), TABLE.lines().filter(|line| !line.starts_with('#')).count());
        for &((class, number), Message { name, shortest, .. }) in MESSAGES.iter() {
            let layout = Message::of(class, number).unwrap().layout();
            let end = layout.fields.iter().map(|f| f.offset + f.kind.size()).max().unwrap();
            // NAV-PVT has 84 bytes in protocols 14 and 15, and these end in reserved fields, or fields that are not
            // read.
            let reserved = match name {
                "NAV-PVT" => 6,
                "NAV2-PVT" => 14,
                "NAV-PVAT" => 8,
                "NAV-SOL" | "HNR-PVT" => 4,
                _ => 0,
            };
            assert_eq!(end + reserved, layout.shortest, "{name}");
            assert!(shortest > 0);
        }
    }

    #[test]
    fn field_offsets_match_the_interface_description() {
        let offset = |class, number, path: &str| {
            let layout = Message::of(class, number).unwrap().layout();
            layout.fields.iter().find(|f| f.path == path).unwrap().offset
        };
        assert_eq!(
            [offset(1, 7, "nano"), offset(1, 7, "lon"), offset(1, 7, "velN")],
            [16, 24, 48].map(|at| at + FRONT_CARRIER)
        );
        assert_eq!([offset(0x28, 0, "lon"), offset(0x28, 0, "headAcc")], [20, 64].map(|at| at + FRONT));
        assert_eq!([offset(1, 0x14, "lonHp"), offset(1, 0x14, "vAcc")], [24, 32].map(|at| at + FRONT_PLACE));
        assert_eq!([offset(1, 0x13, "ecefXHp"), offset(1, 0x13, "pAcc")], [20, 24].map(|at| at + FRONT_PLACE));
        let of_attitudes = [offset(1, 0x17, "fixType"), offset(1, 0x17, "vehRoll"), offset(1, 0x17, "accHeading")];
        assert_eq!(of_attitudes, [24, 72, 92].map(|at| at + FRONT_CARRIER));
        assert_eq!([offset(0x10, 0x15, "iTOW"), offset(0x10, 0x15, "zAccel")], [8, 32].map(|at| at + FRONT));
        assert_eq!([offset(1, 6, "week"), offset(1, 6, "numSV")], [8, 47].map(|at| at + FRONT));
        assert_eq!([offset(1, 5, "roll"), offset(1, 0x21, "valid")], [8, 19].map(|at| at + FRONT));
    }

    #[test]
    fn messages_that_are_not_read_still_have_a_name() {
        assert_eq!([name(1, 7), name(2, 0x15), name(0x77, 1)], ["NAV-PVT", "RXM-0x15", "0x77-0x01"]);
    }
}
