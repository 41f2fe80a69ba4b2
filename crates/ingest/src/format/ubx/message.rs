//! The messages that are read, in u-blox terms (interface descriptions of protocol 15 to 34).

use crate::decode::packed::{Layout, PackedField, PackedKind};
use crate::decode::schema::Number;

/// Class, number, name, shortest payload, and fields in their order.
const MESSAGES: &[(u8, u8, &str, usize, &str)] = &[
    (0x01, 0x01, "NAV-POSECEF", 20, "U4 iTOW, I4 ecefX, I4 ecefY, I4 ecefZ, U4 pAcc"),
    (0x01, 0x02, "NAV-POSLLH", 28, "U4 iTOW, I4 lon, I4 lat, I4 height, I4 hMSL, U4 hAcc, U4 vAcc"),
    (0x01, 0x03, "NAV-STATUS", 16, "U4 iTOW, U1 gpsFix, U1 flags, U1 fixStat, U1 flags2, U4 ttff, U4 msss"),
    (0x01, 0x04, "NAV-DOP", 18, "U4 iTOW, U2 gDOP, U2 pDOP, U2 tDOP, U2 vDOP, U2 hDOP, U2 nDOP, U2 eDOP"),
    (
        0x01,
        0x05,
        "NAV-ATT",
        32,
        "U4 iTOW, U1 version, U3 -, I4 roll, I4 pitch, I4 heading, U4 accRoll, U4 accPitch, U4 accHeading",
    ),
    (
        0x01,
        0x06,
        "NAV-SOL",
        52,
        "U4 iTOW, I4 fTOW, I2 week, U1 gpsFix, U1 flags, I4 ecefX, I4 ecefY, I4 ecefZ, U4 pAcc, I4 ecefVX, I4 ecefVY, \
         I4 ecefVZ, U4 sAcc, U2 pDOP, U1 -, U1 numSV",
    ),
    (0x01, 0x07, "NAV-PVT", 84, PVT),
    (0x01, 0x11, "NAV-VELECEF", 20, "U4 iTOW, I4 ecefVX, I4 ecefVY, I4 ecefVZ, U4 sAcc"),
    (
        0x01,
        0x12,
        "NAV-VELNED",
        36,
        "U4 iTOW, I4 velN, I4 velE, I4 velD, U4 speed, U4 gSpeed, I4 heading, U4 sAcc, U4 cAcc",
    ),
    (
        0x01,
        0x14,
        "NAV-HPPOSLLH",
        36,
        "U1 version, U2 -, U1 flags, U4 iTOW, I4 lon, I4 lat, I4 height, I4 hMSL, I1 lonHp, I1 latHp, I1 heightHp, \
         I1 hMSLHp, U4 hAcc, U4 vAcc",
    ),
    (
        0x01,
        0x13,
        "NAV-HPPOSECEF",
        28,
        "U1 version, U3 -, U4 iTOW, I4 ecefX, I4 ecefY, I4 ecefZ, I1 ecefXHp, I1 ecefYHp, I1 ecefZHp, U1 flags, U4 pAcc",
    ),
    (
        0x01,
        0x17,
        "NAV-PVAT",
        116,
        "U4 iTOW, U1 version, U1 valid, U2 year, U1 month, U1 day, U1 hour, U1 min, U1 sec, U3 -, U4 tAcc, I4 nano, \
         U1 fixType, U1 flags, U1 flags2, U1 numSV, I4 lon, I4 lat, I4 height, I4 hMSL, U4 hAcc, U4 vAcc, I4 velN, \
         I4 velE, I4 velD, I4 gSpeed, U4 sAcc, I4 vehRoll, I4 vehPitch, I4 vehHeading, I4 motHeading, U2 accRoll, \
         U2 accPitch, U2 accHeading, I2 magDec, U2 magAcc, U2 errEllipseOrient, U4 errEllipseMajor, U4 errEllipseMinor",
    ),
    (0x01, 0x20, "NAV-TIMEGPS", 16, "U4 iTOW, I4 fTOW, I2 week, I1 leapS, U1 valid, U4 tAcc"),
    (
        0x01,
        0x21,
        "NAV-TIMEUTC",
        20,
        "U4 iTOW, U4 tAcc, I4 nano, U2 year, U1 month, U1 day, U1 hour, U1 min, U1 sec, U1 valid",
    ),
    (0x0d, 0x01, "TIM-TP", 16, "U4 towMS, U4 towSubMS, I4 qErr, U2 week, U1 flags, U1 refInfo"),
    (
        0x0d,
        0x03,
        "TIM-TM2",
        28,
        "U1 ch, U1 flags, U2 count, U2 wnR, U2 wnF, U4 towMsR, U4 towSubMsR, U4 towMsF, U4 towSubMsF, U4 accEst",
    ),
    (
        0x10,
        0x15,
        "ESF-INS",
        36,
        "U4 flags, U4 -, U4 iTOW, I4 xAngRate, I4 yAngRate, I4 zAngRate, I4 xAccel, I4 yAccel, I4 zAccel",
    ),
    (
        0x28,
        0x00,
        "HNR-PVT",
        72,
        "U4 iTOW, U2 year, U1 month, U1 day, U1 hour, U1 min, U1 sec, U1 valid, I4 nano, U1 gpsFix, U1 flags, U2 -, \
         I4 lon, I4 lat, I4 height, I4 hMSL, I4 gSpeed, I4 speed, I4 headMot, I4 headVeh, U4 hAcc, U4 vAcc, U4 sAcc, \
         U4 headAcc",
    ),
    (
        0x28,
        0x01,
        "HNR-ATT",
        32,
        "U4 iTOW, U1 version, U3 -, I4 roll, I4 pitch, I4 heading, U4 accRoll, U4 accPitch, U4 accHeading",
    ),
    (
        0x28,
        0x02,
        "HNR-INS",
        36,
        "U4 flags, U4 -, U4 iTOW, I4 xAngRate, I4 yAngRate, I4 zAngRate, I4 xAccel, I4 yAccel, I4 zAccel",
    ),
    (0x29, 0x07, "NAV2-PVT", 92, PVT),
];

/// Fields of NAV-PVT and of NAV2-PVT, which is the same for a second solution, without dead reckoning.
const PVT: &str = "U4 iTOW, U2 year, U1 month, U1 day, U1 hour, U1 min, U1 sec, U1 valid, U4 tAcc, I4 nano, U1 fixType, U1 flags, \
         U1 flags2, U1 numSV, I4 lon, I4 lat, I4 height, I4 hMSL, U4 hAcc, U4 vAcc, I4 velN, I4 velE, I4 velD, \
         I4 gSpeed, I4 headMot, U4 sAcc, U4 headAcc, U2 pDOP";

/// Classes by number.
const CLASSES: &[(u8, &str)] = &[
    (0x01, "NAV"),
    (0x02, "RXM"),
    (0x04, "INF"),
    (0x05, "ACK"),
    (0x06, "CFG"),
    (0x09, "UPD"),
    (0x0a, "MON"),
    (0x0b, "AID"),
    (0x0d, "TIM"),
    (0x10, "ESF"),
    (0x13, "MGA"),
    (0x21, "LOG"),
    (0x27, "SEC"),
    (0x28, "HNR"),
    (0x29, "NAV2"),
];

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
        let found = MESSAGES.iter().find(|m| (m.0, m.1) == (class, number));
        found.map(|&(_, _, name, shortest, fields)| Message { name, shortest, fields })
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
    match CLASSES.iter().find(|(known, _)| *known == class) {
        Some((_, class)) => format!("{class}-0x{number:02X}"),
        None => format!("0x{class:02X}-0x{number:02X}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layouts_have_the_lengths_of_the_interface_description() {
        for &(class, number, name, shortest, _) in MESSAGES {
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
