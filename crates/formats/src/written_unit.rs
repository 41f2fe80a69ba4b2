//! Parses units as written in tables, above their columns or in column names.

use flight::{Dimension, Unit};

/// Spellings other than the symbol itself, without spaces and in lower case.
const SPELLINGS: &[(&str, &[&str])] = &[
    ("deg", &["°", "degree", "degrees", "degs", "°t", "degtrue"]),
    ("rad", &["radian", "radians", "rads"]),
    ("1e-7 deg", &["1e-7deg", "dege7", "deg*1e7", "dege-7", "deg*1e-7"]),
    ("1e-5 deg", &["1e-5deg"]),
    ("m", &["meter", "meters", "metre", "metres", "mtr"]),
    ("cm", &["centimeter", "centimeters", "centimetre", "centimetres"]),
    ("mm", &["millimeter", "millimeters", "millimetre", "millimetres"]),
    ("km", &["kilometer", "kilometers", "kilometre", "kilometres"]),
    ("ft", &["foot", "feet"]),
    ("nmi", &["nm"]),
    ("m/s", &["mps", "m/sec", "ms-1", "m.s-1", "m*s-1", "ms^-1", "meters/second", "metres/second", "meter/sec"]),
    ("cm/s", &["cmps", "cm/sec"]),
    ("mm/s", &["mmps", "mm/sec"]),
    ("km/h", &["kmh", "kph", "kmph", "km/hr", "kmh-1"]),
    ("kt", &["kts", "kn", "knot", "knots"]),
    ("ft/s", &["fps", "ftps", "ft/sec", "feet/second"]),
    ("ft/min", &["fpm", "ftpm", "feet/minute"]),
    ("mi/h", &["mph", "mi/hr"]),
    ("m/s^2", &["m/s2", "m/s²", "m/s/s", "mps2", "mpss", "ms-2", "m.s-2", "m/sec^2", "m/sec2"]),
    ("g0", &["g", "gee", "gs"]),
    ("mg0", &["mg"]),
    ("rad/s", &["radps", "rps", "rad/sec", "rads-1"]),
    ("deg/s", &["degps", "dps", "deg/sec", "°/s", "degs-1", "degrees/second"]),
    ("s", &["sec", "secs", "second", "seconds"]),
    ("ms", &["msec", "msecs", "millisecond", "milliseconds", "millis"]),
    ("us", &["µs", "μs", "usec", "usecs", "microsecond", "microseconds", "micros"]),
    ("ns", &["nsec", "nsecs", "nanosecond", "nanoseconds", "nanos"]),
    ("G", &["gauss"]),
    ("T", &["tesla"]),
];

/// Words after a unit of length that give the height datum, or how it was measured.
const DATUMS: &[&str] = &["msl", "amsl", "hmsl", "agl", "wgs", "wgs84", "baro", "ellipsoid", "hae"];

/// The unit that a table states for a column.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Written {
    /// Nothing.
    Blank,
    /// A unit of the wanted dimension.
    Unit(Unit),
    /// A unit of another dimension.
    Other(Unit),
    /// Text that is not a known unit.
    Unknown,
}

/// Parses the text where a unit of `wanted` belongs.
pub fn read(text: &str, wanted: Dimension) -> Written {
    if is_blank(text) {
        return Written::Blank;
    }
    let found = units_of(text);
    match (found.iter().find(|unit| unit.dimension() == wanted), found.last()) {
        (Some(unit), _) => Written::Unit(*unit),
        (None, Some(other)) => Written::Other(*other),
        (None, None) => Written::Unknown,
    }
}

/// Whether a cell of units is empty.
pub fn is_blank(text: &str) -> bool {
    let text = without_brackets(text).to_ascii_lowercase();
    let is_datum = || text.split_whitespace().all(|word| DATUMS.contains(&word));
    matches!(text.as_str(), "-" | "1" | "none" | "n/a" | "unitless") || is_datum()
}

/// The text in brackets at the end of a name, such as `m/s` in `Velocity north (m/s)`.
pub fn in_brackets(name: &str) -> Option<&str> {
    let name = name.trim_end();
    let open = match name.chars().next_back()? {
        ')' => name.rfind('(')?,
        ']' => name.rfind('[')?,
        '}' => name.rfind('{')?,
        _ => return None,
    };
    name.get(open + 1..name.len() - 1)
}

/// The units of the dimension for a word at the end of a name, such as `mps` in `vel_north_mps`.
pub fn of_word(word: &str) -> Vec<Unit> {
    units_of(word)
}

/// All units that a text may mean; one spelling may mean two, such as `G`.
fn units_of(text: &str) -> Vec<Unit> {
    let plain = without_brackets(text);
    let whole: String = plain.split_whitespace().collect();
    let first = plain.split_whitespace().next().unwrap_or_default();
    let rest_is_datum = || {
        let mut rest = plain.split_whitespace().skip(1).peekable();
        rest.peek().is_some() && rest.all(|word| DATUMS.contains(&word.to_ascii_lowercase().as_str()))
    };
    let spelled = |text: &str| -> Vec<Unit> {
        let lower = text.to_lowercase();
        let is_it = |unit: &Unit| {
            let symbol: String = unit.symbol().split_whitespace().collect();
            // `ms` and `Ms` are the same; `mT` and `MT` are not among ours.
            let as_symbol = symbol == text || symbol.to_lowercase() == lower;
            as_symbol
                || SPELLINGS.iter().any(|(known, words)| *known == unit.symbol() && words.contains(&lower.as_str()))
        };
        Unit::all().filter(|unit| unit.dimension() != Dimension::None).filter(is_it).collect()
    };
    let found = spelled(&whole);
    if found.is_empty() && rest_is_datum() { spelled(first) } else { found }
}

fn without_brackets(text: &str) -> &str {
    text.trim().trim_matches(|c: char| "()[]{}".contains(c)).trim()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_read_as_written_in_tables_and_other_texts_are_not() {
        let speed = |text: &str| match read(text, Dimension::Speed) {
            Written::Unit(unit) => unit.symbol(),
            Written::Other(_) => "other",
            Written::Unknown => "unknown",
            Written::Blank => "blank",
        };
        for (text, said) in [
            ("(m/s)", "m/s"),
            ("[km/h]", "km/h"),
            ("Knots", "kt"),
            ("mps", "m/s"),
            ("m / s", "m/s"),
            ("fpm", "ft/min"),
            ("(deg)", "other"),
            ("furlongs", "unknown"),
            ("()", "blank"),
            ("(MSL)", "blank"),
            ("", "blank"),
        ] {
            assert_eq!(speed(text), said, "{text}");
        }
        assert_eq!(read("ft msl", Dimension::Length), Written::Unit("ft".parse().unwrap()));
        assert_eq!(read("g", Dimension::Acceleration), Written::Unit("g0".parse().unwrap()));
        assert_eq!(read("g", Dimension::MagneticField), Written::Unit("G".parse().unwrap()));
        assert_eq!(in_brackets("Velocity north (m/s)"), Some("m/s"));
        assert_eq!(in_brackets("velN"), None);
    }
}
