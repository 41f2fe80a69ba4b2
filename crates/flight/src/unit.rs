//! Units as channel maps write them, and their conversion to SI and radians.

use std::fmt;
use std::str::FromStr;

/// What a unit measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Dimension {
    /// Stored in radians.
    Angle,
    /// Stored in metres.
    Length,
    /// Stored in metres per second.
    Speed,
    /// Stored in metres per second squared.
    Acceleration,
    /// Stored in radians per second.
    AngularRate,
    /// Stored in seconds.
    Time,
    /// Stored in tesla.
    MagneticField,
    /// A dimensionless number.
    None,
}

/// A unit with its exact linear conversion to SI: `si = value · factor / divisor`.
///
/// Two numbers, so that a decimal scale such as 1e-7 deg divides by an exact power of
/// ten instead of multiplying by a rounded one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unit {
    symbol: &'static str,
    dimension: Dimension,
    factor: f64,
    divisor: f64,
}

const DEG: f64 = std::f64::consts::PI / 180.0;

/// Symbol, dimension, factor, divisor. Feet, miles, knots, nautical miles and standard gravity are exact by definition.
const UNITS: &[(&str, Dimension, f64, f64)] = &[
    ("1", Dimension::None, 1.0, 1.0),
    ("rad", Dimension::Angle, 1.0, 1.0),
    ("deg", Dimension::Angle, DEG, 1.0),
    ("1e-2 deg", Dimension::Angle, DEG, 1e2),
    ("1e-5 deg", Dimension::Angle, DEG, 1e5),
    ("1e-7 deg", Dimension::Angle, DEG, 1e7),
    ("mrad", Dimension::Angle, 1.0, 1e3),
    ("rev", Dimension::Angle, std::f64::consts::TAU, 1.0),
    ("m", Dimension::Length, 1.0, 1.0),
    ("cm", Dimension::Length, 1.0, 1e2),
    ("mm", Dimension::Length, 1.0, 1e3),
    ("km", Dimension::Length, 1e3, 1.0),
    ("ft", Dimension::Length, 0.3048, 1.0),
    ("nmi", Dimension::Length, 1852.0, 1.0),
    ("m/s", Dimension::Speed, 1.0, 1.0),
    ("cm/s", Dimension::Speed, 1.0, 1e2),
    ("mm/s", Dimension::Speed, 1.0, 1e3),
    ("km/h", Dimension::Speed, 1.0, 3.6),
    ("kt", Dimension::Speed, 1852.0, 3600.0),
    ("ft/min", Dimension::Speed, 0.3048, 60.0),
    ("ft/s", Dimension::Speed, 0.3048, 1.0),
    ("mi/h", Dimension::Speed, 1609.344, 3600.0),
    ("m/s^2", Dimension::Acceleration, 1.0, 1.0),
    ("cm/s^2", Dimension::Acceleration, 1.0, 1e2),
    ("mm/s^2", Dimension::Acceleration, 1.0, 1e3),
    ("g0", Dimension::Acceleration, 9.80665, 1.0),
    ("mg0", Dimension::Acceleration, 9.80665, 1e3),
    ("rad/s", Dimension::AngularRate, 1.0, 1.0),
    ("mrad/s", Dimension::AngularRate, 1.0, 1e3),
    ("deg/s", Dimension::AngularRate, DEG, 1.0),
    ("1e-2 deg/s", Dimension::AngularRate, DEG, 1e2),
    ("1e-3 deg/s", Dimension::AngularRate, DEG, 1e3),
    ("rev/min", Dimension::AngularRate, std::f64::consts::TAU, 60.0),
    ("s", Dimension::Time, 1.0, 1.0),
    ("ms", Dimension::Time, 1.0, 1e3),
    ("us", Dimension::Time, 1.0, 1e6),
    ("ns", Dimension::Time, 1.0, 1e9),
    ("T", Dimension::MagneticField, 1.0, 1.0),
    ("uT", Dimension::MagneticField, 1.0, 1e6),
    ("nT", Dimension::MagneticField, 1.0, 1e9),
    ("G", Dimension::MagneticField, 1.0, 1e4),
    ("mG", Dimension::MagneticField, 1.0, 1e7),
    ("mT", Dimension::MagneticField, 1.0, 1e3),
];

impl Unit {
    /// The unit as a channel map writes it.
    #[must_use]
    pub fn symbol(self) -> &'static str {
        self.symbol
    }

    /// What it measures.
    #[must_use]
    pub fn dimension(self) -> Dimension {
        self.dimension
    }

    /// `value` in SI (angles in radians).
    #[must_use]
    pub fn to_si(self, value: f64) -> f64 {
        value / self.divisor * self.factor
    }

    /// All units, in the order in which error messages list them.
    pub fn all() -> impl Iterator<Item = Unit> {
        UNITS.iter().map(|&(symbol, dimension, factor, divisor)| Unit { symbol, dimension, factor, divisor })
    }
}

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.symbol)
    }
}

/// A unit that flightlag does not know. It never guesses.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("unknown unit {0:?}; known are {list}", list = Unit::all().map(|u| u.symbol).collect::<Vec<_>>().join(", "))]
pub struct UnknownUnit(pub String);

impl FromStr for Unit {
    type Err = UnknownUnit;

    fn from_str(text: &str) -> Result<Unit, UnknownUnit> {
        Unit::all().find(|u| u.symbol == text).ok_or_else(|| UnknownUnit(text.to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn si(unit: &str, value: f64) -> f64 {
        unit.parse::<Unit>().unwrap().to_si(value)
    }

    #[test]
    fn a_knot_is_a_nautical_mile_an_hour() {
        assert_eq!(si("kt", 3600.0), 1852.0);
        assert_eq!(si("ft/min", 60.0), 0.3048);
    }

    #[test]
    fn prefixed_units_convert_exactly() {
        // 1000 mg0 is standard gravity, 1 G is 0.1 mT, 60 rev/min is one turn per second.
        assert_eq!([si("mg0", 1000.0), si("cm/s^2", 981.0), si("mm/s^2", 9810.0)], [9.806_65, 9.81, 9.81]);
        assert_eq!([si("mrad/s", 1500.0), si("mrad", 250.0), si("rev/min", 60.0)], [1.5, 0.25, std::f64::consts::TAU]);
        assert_eq!([si("1e-2 deg/s", 4500.0), si("1e-3 deg/s", 45_000.0)], [45_f64.to_radians(); 2]);
        assert_eq!([si("mG", 1000.0), si("G", 1.0), si("mT", 0.1)], [1e-4; 3]);
        assert_eq!([si("ft/s", 10.0), si("mi/h", 3600.0)], [3.048, 1609.344]);
    }

    #[test]
    fn integer_degrees_equal_the_decimal_text_of_the_same_angle() {
        // 1e-7 deg integers and decimal degrees of two loggers must give identical bits.
        for e7 in [423_585_499_i32, -710_872_500, 1, i32::MAX] {
            let decimal: f64 = format!("{}e-7", e7).parse().unwrap();
            assert_eq!(si("1e-7 deg", f64::from(e7)), si("deg", decimal));
        }
    }

    #[test]
    fn an_unknown_unit_is_rejected_with_the_list_of_known_ones() {
        let error = "knots".parse::<Unit>().unwrap_err().to_string();
        assert!(error.contains("\"knots\"") && error.contains("kt"), "{error}");
    }
}
