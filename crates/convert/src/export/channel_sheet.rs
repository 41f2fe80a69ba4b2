//! A channel as a sheet: timestamps, values in readable units, and descriptions of the columns.

use super::{About, ExportTo, Source};
use crate::row_time::{utc_of, way_to_utc};
use crate::sheet::{Cells, Sheet};
use flight::{Channel, Clock, Dimension, Quantity, Stamp, Unit, UtcTie};
use ingest::Values;
use serde_json::{Value, json};
use std::collections::HashMap;

/// How the values of a column are written.
#[derive(Debug, Clone, Copy)]
struct Written {
    /// Suffix of the column name.
    end: &'static str,
    unit: &'static str,
    from_si: fn(f64) -> f64,
}

/// The SI value unchanged.
const fn si(end: &'static str, unit: &'static str) -> Written {
    Written { end, unit, from_si: |x| x }
}

const METRES: Written = si("_m", "m");
const SECONDS: Written = si("_s", "s");
const RADIANS: Written = si("_rad", "rad");
const SPEED: Written = si("_mps", "m/s");
const ACCELERATION: Written = si("_mps2", "m/s^2");
const RATE: Written = si("_radps", "rad/s");
const FIELD: Written = Written { end: "_nt", unit: "nT", from_si: |x| x * 1e9 };
const DEGREES: Written = Written { end: "_deg", unit: "deg", from_si: degrees };
const NUMBER: Written = si("", "1");

impl Written {
    /// How a component of a channel is written. A scalar follows its field.
    fn of(channel: &Channel, component: &str) -> Written {
        match (channel.quantity, component) {
            (Quantity::PositionGeodetic, "latitude" | "longitude") => DEGREES,
            (Quantity::PositionGeodetic | Quantity::PositionNed | Quantity::Height, _) => METRES,
            (Quantity::VelocityNed, _) => SPEED,
            (Quantity::AngularRate, _) => RATE,
            (Quantity::SpecificForce, _) => ACCELERATION,
            (Quantity::MagneticField, _) => FIELD,
            (Quantity::EncoderAngle, _) => RADIANS,
            (Quantity::Pulse, _) => SECONDS,
            (Quantity::Scalar, _) => channel.source.fields.first().map_or(NUMBER, |field| Written::of_field(field)),
            (Quantity::Attitude | Quantity::MagneticDirection | Quantity::EncoderCount, _) => NUMBER,
        }
    }

    /// From a field followed by its logged unit, such as `hAcc [mm]`.
    fn of_field(field: &str) -> Written {
        let unit = field.rsplit_once(" [").and_then(|(_, unit)| unit.strip_suffix(']'));
        match unit.and_then(|unit| unit.parse::<Unit>().ok()).map(Unit::dimension) {
            Some(Dimension::Angle) => RADIANS,
            Some(Dimension::Length) => METRES,
            Some(Dimension::Speed) => SPEED,
            Some(Dimension::Acceleration) => ACCELERATION,
            Some(Dimension::AngularRate) => RATE,
            Some(Dimension::Time) => SECONDS,
            Some(Dimension::MagneticField) => FIELD,
            Some(Dimension::None) | None => NUMBER,
        }
    }
}

/// Radians to degrees. If the radians came from degrees with few digits, exactly those.
fn degrees(radians: f64) -> f64 {
    let degrees = radians.to_degrees();
    let short = format!("{degrees:.14e}").parse().unwrap_or(degrees);
    let back = |degrees: f64| degrees * (std::f64::consts::PI / 180.0);
    if back(short) == radians { short } else { degrees }
}

/// First timestamp of the earliest channel of each clock: the zero of `t_s` in all sheets of a log, so that rows of two
/// sheets with the same `t_s` are from the same instant.
pub(super) fn zeros<'c>(channels: impl Iterator<Item = &'c Channel>) -> HashMap<Clock, Stamp> {
    let mut zeros = HashMap::new();
    for timeline in channels.map(|channel| channel.series.timeline()) {
        if let Some(first) = timeline.first() {
            let zero = zeros.entry(timeline.clock()).or_insert(first);
            *zero = first.min(*zero);
        }
    }
    zeros
}

/// Timestamps, seconds since the zero of their clock, UTC unless the timestamps are UTC, components with their units,
/// and 1 where a value was held since an earlier row. Frees the channel's memory as it goes.
pub(super) fn source(
    name: String,
    channel: Channel,
    to: ExportTo,
    zeros: &HashMap<Clock, Stamp>,
    utc: Option<&UtcTie>,
) -> Source {
    let timeline = channel.series.timeline();
    let (clock, main) = (timeline.clock(), format!("{}_ns", timeline.kind()));
    let own_ns: Values<i64> = timeline.stamps().iter().map(|s| Some(s.0)).collect();
    let utc_ns = utc_of(clock, &own_ns, utc);
    let log_time = match to {
        ExportTo::Mcap => utc_ns.clone().unwrap_or(own_ns).into_parts().0,
        ExportTo::Parquet | ExportTo::Csv => {
            drop(own_ns);
            vec![]
        }
    };
    let way = utc_ns.is_some().then(|| format!("{main}{}", way_to_utc(clock)));
    let log_time_how = match &way {
        Some(way) => format!("UTC: {way}"),
        None => format!("{main}, clock {clock}, not UTC"),
    };
    let about = about(&channel, way);
    let zero = zeros.get(&clock).copied().unwrap_or(Stamp(0));
    let (mut sheet, mut columns) = (Sheet::default(), About::new());
    for (name, cells, about) in times_of(&channel, zero, utc_ns).into_iter().chain(values_of(channel)) {
        columns.insert(name.clone(), about);
        sheet.push(name, cells);
    }
    Source { name, sheet, columns, about, log_time, log_time_how }
}

/// The timestamps of a channel, in each of its clocks, as columns.
fn times_of(channel: &Channel, zero: Stamp, utc_ns: Option<Values<i64>>) -> Vec<(String, Cells, Value)> {
    let timeline = channel.series.timeline();
    let clock = timeline.clock();
    let nanos = |stamps: &[Stamp]| Cells::I64(stamps.iter().map(|s| Some(s.0)).collect());
    let seconds = Cells::F64(timeline.seconds_since(zero).into());
    let mut columns = vec![
        (format!("{}_ns", timeline.kind()), nanos(timeline.stamps()), json!({ "unit": "ns", "clock": clock })),
        ("t_s".to_owned(), seconds, json!({ "unit": "s", "clock": clock, "zero_ns": zero.0 })),
    ];
    if let Some(utc_ns) = utc_ns.filter(|_| clock != Clock::Unix) {
        columns.push(("utc_ns".to_owned(), Cells::I64(utc_ns), json!({ "unit": "ns", "clock": Clock::Unix })));
    }
    for (kind, clock, stamps) in &channel.other_stamps {
        columns.push((format!("{kind}_ns"), nanos(stamps), json!({ "unit": "ns", "clock": clock })));
    }
    columns
}

/// The source of a channel; `utc` is how its timestamps become UTC.
fn about(channel: &Channel, utc: Option<String>) -> Value {
    let timeline = channel.series.timeline();
    json!({
        "quantity": channel.quantity,
        "axes": axes(channel.quantity),
        "topic": channel.source.topic,
        "type": channel.source.type_name,
        "fields": channel.source.fields,
        "clock": timeline.clock(),
        "stamps": timeline.kind(),
        "utc": utc,
    })
}

/// The axes of a quantity, which may differ from those of the log; `None` for one without axes.
fn axes(quantity: Quantity) -> Option<&'static str> {
    match quantity {
        Quantity::AngularRate | Quantity::SpecificForce | Quantity::MagneticField | Quantity::MagneticDirection => {
            Some("x forward, y right, z down")
        }
        Quantity::Attitude => Some("from x forward, y right, z down to north, east, down"),
        Quantity::PositionNed | Quantity::VelocityNed => Some("north, east, down"),
        Quantity::PositionGeodetic
        | Quantity::Height
        | Quantity::EncoderCount
        | Quantity::EncoderAngle
        | Quantity::Pulse
        | Quantity::Scalar => None,
    }
}

/// The components that the log contains, and which values are held, as columns.
fn values_of(channel: Channel) -> Vec<(String, Cells, Value)> {
    let held = channel.is_held().then(|| channel.held.iter().map(|h| Some(i64::from(*h))).collect());
    let as_logged = match (channel.quantity, channel.source.fields.as_slice()) {
        (Quantity::Scalar, [field]) => Some(field.clone()),
        _ => None,
    };
    let components = channel.quantity.components().iter().zip(&channel.present);
    let written: Vec<(&str, Option<Written>)> =
        components.map(|(name, present)| (*name, present.then(|| Written::of(&channel, name)))).collect();
    let mut columns = vec![];
    for ((name, written), mut values) in written.into_iter().zip(channel.series.into_components()) {
        let Some(written) = written else { continue };
        values.iter_mut().for_each(|x| *x = (written.from_si)(*x));
        let mut about = json!({ "unit": written.unit });
        if let Some(field) = &as_logged {
            about["as_logged"] = field.as_str().into();
        }
        columns.push((format!("{name}{}", written.end), Cells::F64(values.into()), about));
    }
    columns.extend(held.map(|held| ("held".to_owned(), Cells::I64(held), json!({ "unit": "1" }))));
    columns
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn degrees_with_few_digits_are_restored_exactly() {
        for text in ["-127", "47.1234567", "8.5", "-0.0000001", "179.99999999999", "33.3"] {
            let value: f64 = text.parse().unwrap();
            assert_eq!(degrees(value * (std::f64::consts::PI / 180.0)), value);
        }
        for k in 1..1000 {
            let radians = f64::from(k) * 0.003_141_592_1;
            assert!((degrees(radians) - radians.to_degrees()).abs() <= f64::EPSILON * 180.0);
        }
    }

    #[test]
    fn a_scalar_has_the_unit_of_its_field() {
        for (field, end) in [
            ("hAcc [mm]", "_m"),
            ("sAcc [cm/s]", "_mps"),
            ("age [ms]", "_s"),
            ("a [1e-2 deg]", "_rad"),
            ("numSV [1]", ""),
            ("odd", ""),
        ] {
            assert_eq!(Written::of_field(field).end, end, "{field}");
        }
    }
}
