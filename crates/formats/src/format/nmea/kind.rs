//! What is read from each sentence type.

use super::sentence::{Sentence, degrees, plain};
use crate::decode::cells::{CellKind, CellLayout};
use Value::{Degrees, EllipsoidHeight, HasMode, Height, Hypotenuse, Number, Status, Valid};
use std::fmt::Write;

/// Columns of every sentence: UTC, time since the first sentence, and log time, ns.
const STAMPS: [&str; 3] = [UTC, "elapsed_ns", "logged_ns"];
pub(super) const UTC: &str = "utc_ns";

/// A value of a sentence.
enum Value {
    Number(&'static str, usize),
    /// Field of the value, and of its hemisphere after it.
    Degrees(&'static str, usize),
    /// Whether the status is `A`, or `D` as some receivers send for a differential fix: 1 or 0.
    Valid(&'static str, usize),
    /// Whether the mode is anything but `N`, not valid, of every satellite system: 1 or 0; 1 for sentences from before
    /// NMEA 2.3, which have none.
    HasMode(&'static str, usize),
    /// Height above the ellipsoid: the fields of the height above mean sea level, and of mean sea level above the
    /// ellipsoid.
    Height(&'static str, usize, usize),
    /// Height above the ellipsoid as Trimble writes it, `EHT150.790`; absent for a height above mean sea level, `GHT`.
    EllipsoidHeight(&'static str, usize),
    /// The root sum square of two perpendicular standard deviations.
    Hypotenuse(&'static str, usize, usize),
    /// The fix status in u-blox letters, as the number that its binary messages use.
    Status(&'static str, usize),
}

const GGA: [Value; 9] = [
    Degrees("latitude", 2),
    Degrees("longitude", 4),
    Number("quality", 6),
    Number("satellites", 7),
    Number("hdop", 8),
    Number("altitude", 9),
    Number("separation", 11),
    Height("height", 9, 11),
    Number("age", 13),
];

const GNS: [Value; 9] = [
    Degrees("latitude", 2),
    Degrees("longitude", 4),
    HasMode("valid", 6),
    Number("satellites", 7),
    Number("hdop", 8),
    Number("altitude", 9),
    Number("separation", 10),
    Height("height", 9, 10),
    Number("age", 11),
];

const RMC: [Value; 5] =
    [Valid("valid", 2), Degrees("latitude", 3), Degrees("longitude", 5), Number("speed", 7), Number("track", 8)];

const GST: [Value; 4] = [
    Number("latitude_std", 6),
    Number("longitude_std", 7),
    Number("altitude_std", 8),
    Hypotenuse("horizontal_std", 6, 7),
];

const PUBX_00: [Value; 12] = [
    Degrees("latitude", 3),
    Degrees("longitude", 5),
    Number("height", 7),
    Status("fix", 8),
    Number("horizontal_accuracy", 9),
    Number("vertical_accuracy", 10),
    Number("speed_kmh", 11),
    Number("track", 12),
    Number("down", 13),
    Number("age", 14),
    Number("hdop", 15),
    Number("satellites", 18),
];

const PTNL_GGK: [Value; 6] = [
    Degrees("latitude", 4),
    Degrees("longitude", 6),
    Number("quality", 8),
    Number("satellites", 9),
    Number("dop", 10),
    EllipsoidHeight("height", 11),
];

const PASHR: [Value; 7] = [
    Number("heading", 2),
    Number("roll", 4),
    Number("pitch", 5),
    Number("heave", 6),
    Number("roll_std", 7),
    Number("pitch_std", 8),
    Number("heading_std", 9),
];

/// What is read from a sentence type.
pub(super) struct Kind {
    /// Field of the time of day; `None` for a type without one.
    pub(super) time: Option<usize>,
    values: &'static [Value],
}

impl Kind {
    /// By the type in the address; `None` for one that is only counted.
    pub(super) fn of(name: &str) -> Option<Kind> {
        let kind = |time, values| Some(Kind { time, values });
        match name {
            "GGA" => kind(Some(1), &GGA),
            "GNS" => kind(Some(1), &GNS),
            "RMC" => kind(Some(1), &RMC),
            "GLL" => kind(Some(5), &[Degrees("latitude", 1), Degrees("longitude", 3), Valid("valid", 6)]),
            "VTG" => kind(None, &[Number("track", 1), Number("speed", 5), HasMode("valid", 9)]),
            "ZDA" => kind(Some(1), &[Number("day", 2), Number("month", 3), Number("year", 4)]),
            "HDT" => kind(None, &[Number("heading", 1)]),
            "GST" => kind(Some(1), &GST),
            "PUBX,00" => kind(Some(2), &PUBX_00),
            "PUBX,04" => kind(Some(2), &[Number("utc_tow", 4), Number("utc_week", 5)]),
            "PTNL,GGK" => kind(Some(2), &PTNL_GGK),
            "PASHR" => kind(Some(1), &PASHR),
            _ => None,
        }
    }

    /// Writes the values of a sentence as cells, each after a comma.
    pub(super) fn write(&self, sentence: &Sentence<'_>, line: &mut String) {
        let has_fix = !self.has_no_fix(sentence);
        for value in self.values {
            line.push(',');
            value.write(sentence, has_fix, line);
        }
    }

    /// Whether a sentence itself says that it has no fix. Receivers may write arbitrary values into these: 89° 60',
    /// 720°.
    fn has_no_fix(&self, sentence: &Sentence<'_>) -> bool {
        self.values.iter().any(|value| match *value {
            Value::Valid(_, field) => sentence.field(field) == "V",
            Value::Number("quality", field) => sentence.field(field) == "0",
            Value::HasMode(_, field) => has_no_mode(sentence.field(field)),
            Value::Status(_, field) => status(sentence.field(field)) == Some(0),
            _ => false,
        })
    }

    /// Whether a sentence has the main value of its type: the first one that is not a flag.
    pub(super) fn says_something(&self, sentence: &Sentence<'_>) -> bool {
        let field = self.values.iter().find_map(|value| match *value {
            Value::Number(_, field) | Value::Degrees(_, field) => Some(field),
            _ => None,
        });
        field.is_some_and(|field| !sentence.field(field).is_empty())
    }

    pub(super) fn layout(&self) -> CellLayout {
        let stamps = STAMPS.into_iter().map(|name| (name, CellKind::WholeIfAny));
        let values = self.values.iter().map(|value| match value {
            Value::Number(name, _)
            | Value::Degrees(name, _)
            | Value::Valid(name, _)
            | Value::HasMode(name, _)
            | Value::EllipsoidHeight(name, _)
            | Value::Status(name, _)
            | Value::Hypotenuse(name, ..)
            | Value::Height(name, ..) => (*name, CellKind::NumberIfAny),
        });
        CellLayout::of(stamps.chain(values))
    }
}

pub(super) fn is_valid(status: &str) -> bool {
    matches!(status, "A" | "D")
}

/// `navStat`: no fix, dead reckoning, 2D and 3D standalone and differential, combined with dead reckoning, time only.
fn status(letters: &str) -> Option<u8> {
    Some(match letters {
        "NF" => 0,
        "DR" => 1,
        "G2" | "D2" => 2,
        "G3" | "D3" => 3,
        "RK" => 4,
        "TT" => 5,
        _ => return None,
    })
}

fn has_no_mode(modes: &str) -> bool {
    !modes.is_empty() && modes.bytes().all(|mode| mode == b'N')
}

impl Value {
    /// Writes the value as a cell; nothing if it is absent.
    fn write(&self, sentence: &Sentence<'_>, has_fix: bool, line: &mut String) {
        let number = |field| plain(sentence.field(field)).and_then(|text| text.parse::<f64>().ok());
        // Writing to a string does not fail.
        let _ = match *self {
            // Text that is not a number is kept as it is, and the row is rejected.
            Value::Number(_, field) => line.write_str(sentence.field(field)),
            Value::Degrees(_, field) => match degrees(sentence.field(field), sentence.field(field + 1)) {
                Some(degrees) => write!(line, "{degrees}"),
                None if sentence.field(field).is_empty() || !has_fix => Ok(()),
                None => line.write_str("no angle"),
            },
            Value::Valid(_, field) => line.write_str(if is_valid(sentence.field(field)) { "1" } else { "0" }),
            Value::HasMode(_, field) => line.write_str(if has_no_mode(sentence.field(field)) { "0" } else { "1" }),
            Value::Height(_, altitude, separation) => match number(altitude).zip(number(separation)) {
                Some((altitude, separation)) => write!(line, "{}", altitude + separation),
                None => Ok(()),
            },
            Value::Hypotenuse(_, one, other) => match number(one).zip(number(other)) {
                Some((one, other)) => write!(line, "{}", one.hypot(other)),
                None => Ok(()),
            },
            Value::EllipsoidHeight(_, field) => match sentence.field(field) {
                text if text.is_empty() || text.starts_with("GHT") => Ok(()),
                text => line.write_str(text.strip_prefix("EHT").unwrap_or(text)),
            },
            Value::Status(_, field) => match status(sentence.field(field)) {
                Some(status) => write!(line, "{status}"),
                None => line.write_str(sentence.field(field)),
            },
        };
    }
}

/// Raw column of sentences that are not decoded: the text between `$` and the checksum.
pub(super) fn whole_layout() -> CellLayout {
    let stamps = STAMPS.into_iter().map(|name| (name, CellKind::WholeIfAny));
    CellLayout::of(stamps.chain([("sentence", CellKind::Text)]))
}
