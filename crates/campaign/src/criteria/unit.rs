//! Numbers with units, as users write them in a criteria file.

use record::CriterionUnit;

/// Dimension of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dimension {
    /// Seconds.
    Time,
    /// Metres.
    Length,
    /// Metres per second.
    Speed,
    /// Per second.
    Rate,
    /// Bytes.
    Bytes,
    /// Part of a whole, 0 to 1.
    Share,
    /// A whole number without unit.
    Count,
    /// A number without unit.
    Ratio,
}

/// Name, and the SI value of one as a quotient: 150 ms is then 150/1000 s, the double nearest to 0.15.
type Row = (&'static str, f64, f64);

impl Dimension {
    fn rows(self) -> &'static [Row] {
        match self {
            Dimension::Time => {
                &[("s", 1.0, 1.0), ("ms", 1.0, 1e3), ("us", 1.0, 1e6), ("min", 60.0, 1.0), ("h", 3600.0, 1.0)]
            }
            Dimension::Length => &[("m", 1.0, 1.0), ("mm", 1.0, 1e3), ("cm", 1.0, 100.0), ("km", 1e3, 1.0)],
            Dimension::Speed => &[("m/s", 1.0, 1.0), ("km/h", 1e3, 3600.0), ("kn", 1852.0, 3600.0)],
            Dimension::Rate => &[("Hz", 1.0, 1.0), ("kHz", 1e3, 1.0)],
            Dimension::Bytes => &[("B", 1.0, 1.0), ("kB", 1e3, 1.0), ("MB", 1e6, 1.0), ("GB", 1e9, 1.0)],
            Dimension::Share => &[("%", 1.0, 100.0)],
            Dimension::Count | Dimension::Ratio => &[("", 1.0, 1.0)],
        }
    }

    /// Allowed units of a limit; one empty name if there are no units.
    pub fn units(self) -> impl Iterator<Item = &'static str> {
        self.rows().iter().map(|row| row.0)
    }

    fn has_no_unit(self) -> bool {
        matches!(self, Dimension::Count | Dimension::Ratio)
    }

    /// The correct form, for an error.
    fn wanted(self) -> String {
        match self {
            Dimension::Count => "a whole number without a unit".to_owned(),
            Dimension::Ratio => "a number without a unit".to_owned(),
            _ => {
                let units: Vec<&str> = self.units().collect();
                let which = if units.len() == 1 { "the unit" } else { "one of the units" };
                format!("a text with a number and {which} {}, such as \"5 {}\"", units.join(", "), units[0])
            }
        }
    }
}

/// A limit: the number as written, its unit, and its SI value.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Quantity {
    pub(crate) written: f64,
    pub(crate) unit: CriterionUnit,
    pub(crate) si: f64,
}

/// Reads a limit of this dimension from a TOML value.
///
/// # Errors
/// What is wrong with it and the correct form.
pub(crate) fn read(value: &toml::Value, dimension: Dimension) -> Result<Quantity, String> {
    let text = match value {
        toml::Value::String(text) => text.trim().to_owned(),
        toml::Value::Integer(n) => n.to_string(),
        toml::Value::Float(x) => x.to_string(),
        other => return Err(format!("{other} is not a limit: write {}", dimension.wanted())),
    };
    let in_number = |c: char| c.is_ascii_digit() || "+-.eE".contains(c);
    let (number, unit) = text.split_at(text.find(|c: char| !in_number(c)).unwrap_or(text.len()));
    let unit = unit.trim();
    if unit.starts_with(',') {
        return Err(format!("\"{text}\": use a decimal point, not a comma"));
    }
    let written: f64 =
        number.parse().map_err(|_| format!("\"{text}\" does not begin with a number: write {}", dimension.wanted()))?;
    if !written.is_finite() {
        return Err(format!("\"{text}\" is too large for a number"));
    }
    let found = dimension.rows().iter().find(|row| row.0 == unit);
    let (name, times, over) = found.ok_or_else(|| wrong_unit(&text, unit, dimension))?;
    if dimension == Dimension::Count && written.fract() != 0.0 {
        return Err(format!("{text} is not a count: write {}", dimension.wanted()));
    }
    let unit = CriterionUnit { name: (*name).to_owned(), si: times / over };
    // Minus zero becomes zero, which must not change the hash.
    let written = if written == 0.0 { 0.0 } else { written };
    Ok(Quantity { written, unit, si: written * times / over })
}

fn wrong_unit(text: &str, unit: &str, dimension: Dimension) -> String {
    let wanted = dimension.wanted();
    match unit {
        "" => format!("{text} has no unit: write {wanted}"),
        _ if dimension.has_no_unit() => format!("\"{text}\": this metric has no unit `{unit}`: write {wanted}"),
        _ => format!("\"{text}\": `{unit}` is not a unit of this metric: write {wanted}"),
    }
}

impl Quantity {
    /// The form in a criteria file: `150 ms`, or the bare number.
    pub(crate) fn text(&self) -> String {
        format!("{} {}", self.written, self.unit.name).trim_end().to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn si(text: &str, dimension: Dimension) -> Result<f64, String> {
        read(&toml::Value::String(text.into()), dimension).map(|q| q.si)
    }

    #[test]
    fn a_number_with_a_unit_is_the_nearest_double_in_si() {
        assert_eq!(si("150 ms", Dimension::Time), Ok(0.15));
        assert_eq!(si("150ms", Dimension::Time), Ok(0.15));
        assert_eq!(si("-2.5e1 us", Dimension::Time), Ok(-25e-6));
        assert_eq!(si("1.5 min", Dimension::Time), Ok(90.0));
        assert_eq!(si("30 cm", Dimension::Length), Ok(0.3));
        assert_eq!(si("36 km/h", Dimension::Speed), Ok(10.0));
        assert_eq!(si("95 %", Dimension::Share), Ok(0.95));
        assert_eq!(si("3", Dimension::Count), Ok(3.0));
        assert_eq!(read(&toml::Value::Integer(3), Dimension::Count).unwrap().text(), "3");
        assert_eq!(read(&toml::Value::String("150.0ms".into()), Dimension::Time).unwrap().text(), "150 ms");
    }

    #[test]
    fn an_invalid_quantity_is_rejected_with_the_correct_form() {
        for (text, dimension, says) in [
            ("150", Dimension::Time, "150 has no unit"),
            (
                "150 m",
                Dimension::Time,
                "`m` is not a unit of this metric: write a text with a number and one of the units s, ms",
            ),
            ("1,5 ms", Dimension::Time, "decimal point, not a comma"),
            ("fast", Dimension::Time, "does not begin with a number"),
            ("nan ms", Dimension::Time, "does not begin with a number"),
            ("1e999 ms", Dimension::Time, "too large"),
            ("1.5", Dimension::Count, "not a count"),
            ("3 Hz", Dimension::Count, "has no unit `Hz`"),
            ("0.95", Dimension::Share, "the unit %, such as \"5 %\""),
        ] {
            let error = si(text, dimension).unwrap_err();
            assert!(error.contains(says), "{text}: {error}");
        }
        assert!(read(&toml::Value::Boolean(true), Dimension::Ratio).is_err());
    }
}
