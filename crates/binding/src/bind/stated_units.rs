//! Compares the units of the map with those that the log itself states.

use super::plan::{Found, Plan};
use super::stamp_columns::Stamps;
use crate::map::{ChannelRule, TimeSource};
use flight::{Code, Dimension, Graded, Notices, Severity, Unit};
use formats::written_unit::{Written, in_brackets, read};
use formats::{StatedUnit, TableHead};

/// The column in the unit that its table states. A decimal fraction of that unit is left to the map, because tables
/// state `deg` for integers of 1e-7 deg.
///
/// # Errors
/// If the table states a unit of another quantity.
pub(super) fn as_written<'a>(found: Found<'a>, head: Option<&'a TableHead>) -> Result<Found<'a>, String> {
    let map = found.unit;
    let Some(head) = head.filter(|_| map.dimension() != Dimension::None) else { return Ok(found) };
    let path = found.column.path.as_str();
    let text = head.unit_of(path);
    match read(text, map.dimension()) {
        Written::Unit(unit) if unit == map || is_fraction(map, unit) => Ok(found),
        Written::Unit(unit) => Ok(Found { unit, stated_unit: Some((text, map)), ..found }),
        Written::Other(other) if other.dimension() != map.dimension() && !is_of_name(head, path, text) => {
            Err(format!("the unit of {path} is {other} in the table, but {map} in the channel map"))
        }
        // Brackets in a name may hold anything.
        Written::Unknown if !is_of_name(head, path, text) => Ok(Found { stated_unit: Some((text, map)), ..found }),
        Written::Blank | Written::Other(_) | Written::Unknown => Ok(found),
    }
}

/// Whether the map's unit is a decimal fraction of the stated one.
fn is_fraction(map: Unit, stated: Unit) -> bool {
    map.symbol().strip_prefix("1e-").and_then(|rest| rest.split_once(' ')).is_some_and(|(_, of)| of == stated.symbol())
}

fn is_of_name(head: &TableHead, path: &str, text: &str) -> bool {
    in_brackets(path) == Some(text) && !head.units.iter().any(|cell| cell == text)
}

/// Rejects timestamps whose column states another unit of time than the map.
///
/// # Errors
/// With both units.
pub(super) fn check_times(rule: &ChannelRule, stamps: &[Stamps], head: Option<&TableHead>) -> Result<(), String> {
    let Some(head) = head else { return Ok(()) };
    for source in rule.times.iter().flat_map(|(_, sources)| sources) {
        let (TimeSource::Number { field, tick, .. } | TimeSource::GpsWeek { field, tick, .. }) = source else {
            continue;
        };
        if !stamps.iter().any(|stamps| stamps.label == source.label()) {
            continue;
        }
        if let Written::Unit(unit) = read(head.unit_of(field), Dimension::Time)
            && (unit.to_si(1.0) * 1e9 - tick.nanos() as f64).abs() > 0.5
        {
            let nanos = tick.nanos();
            return Err(format!(
                "the unit of {field} is {unit} in the table, but ticks of {nanos} ns in the channel map"
            ));
        }
    }
    Ok(())
}

/// Scales that differ by less than this are equal: loggers round theirs to single precision.
const SAME_SCALE: f64 = 1e-5;

/// Reports where the map interprets a field differently from the log. The map still applies, because its author may
/// know better. Pure numbers are not reported: loggers have no common word for them.
pub(super) fn compare(plan: &Plan<'_>, stated: &[StatedUnit], notices: &mut Notices) {
    for found in plan.columns.iter().flatten() {
        let Some((text, map)) = found.stated_unit else { continue };
        let (name, path) = (&plan.rule.name, &found.column.path);
        let (what, text) = if found.unit == map {
            let text = format!(
                "channel {name}: the table states the unit {text:?} for {path}, which flightlag does not know; {map} \
                 is used"
            );
            (Graded::from(Code::UnitUnknown), text)
        } else {
            let text = format!(
                "channel {name}: {path} is converted from {}, the unit in the table; the channel map states {map}",
                found.unit
            );
            (Code::UnitDiffers.at(Severity::Info), text)
        };
        notices.push(what, &plan.table.topic.name, plan.table.rows as u64, text);
    }
    for found in plan.columns.iter().flatten().filter(|f| f.unit.dimension() != Dimension::None) {
        let of_field = |s: &&StatedUnit| s.type_name == plan.table.topic.type_name && s.path == found.column.path;
        let Some(stated) = stated.iter().rfind(of_field) else { continue };
        let Some((dimension, si)) = stated.measures else { continue };
        let same = dimension == found.unit.dimension() && (si / found.unit.to_si(1.0) - 1.0).abs() < SAME_SCALE;
        if !same {
            let text = format!(
                "channel {}: the unit of {} is {} in the log, but {} in the channel map, which is used",
                plan.rule.name, found.column.path, stated.text, found.unit
            );
            notices.push(Code::UnitDiffers, &plan.table.topic.name, plan.table.rows as u64, text);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_unit_in_brackets_is_of_the_name_unless_the_line_of_units_has_it_too() {
        let head = |units: &[&str]| TableHead {
            topic: "csv".into(),
            names: vec!["t".into(), "speed [kn]".into()],
            units: units.iter().map(|unit| (*unit).to_owned()).collect(),
            unused_names: None,
        };
        assert!(is_of_name(&head(&[]), "speed [kn]", "kn"));
        assert!(!is_of_name(&head(&[]), "speed [kn]", "m/s"), "the unit is that of another place");
        assert!(!is_of_name(&head(&["s", "kn"]), "speed [kn]", "kn"), "the line of units says it as well");
        assert!(!is_of_name(&head(&["s", "kn"]), "speed", "kn"));
    }
}
