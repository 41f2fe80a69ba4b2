//! Attitudes, angular rates and specific forces: infers units and axes by comparing them with each other and with the
//! velocity. A reading that these contradict or cannot decide is rejected.

mod body_attitude;
mod force;
mod rate;

use self::body_attitude::Rotation;
use super::column_groups::{TableColumns, Triple};
use super::compare;
use super::compare::Motion;
use super::found::Found;
use super::time_columns::Timing;
use super::windows::Trace;
use flight::Unit;
use formats::Table;

/// An agreement that confirms or, with the opposite sign, contradicts.
const CONFIRMS: f64 = 0.8;
/// A difference in agreement that decides.
const DECIDES: f64 = 0.05;

/// Three columns with their unit and frame.
#[derive(Debug, Clone)]
pub(super) struct Body {
    pub(super) group: Triple,
    pub(super) quantity: &'static str,
    pub(super) roles: [&'static str; 3],
    pub(super) unit: Unit,
    /// As named in a map.
    pub(super) frame: &'static str,
    pub(super) why: Vec<String>,
}

/// Columns of a table with its time.
struct TimedTriple<'a> {
    table: &'a Table,
    timing: &'a Timing,
    group: &'a Triple,
}

impl TimedTriple<'_> {
    /// The values in SI units, over the time of the table.
    fn trace(&self, unit: Unit) -> Trace<3> {
        let columns = self.group.columns.each_ref().map(Some);
        compare::trace(self.table, &self.timing.times_s, columns, |values| values.map(|value| unit.to_si(value)))
    }

    /// The unit that the table states, or `None`.
    ///
    /// # Errors
    /// If a unit is unknown, or differs between columns.
    fn stated(&self) -> Result<Option<Unit>, String> {
        let columns = || self.group.columns.iter();
        if let Some((column, odd)) = columns().find_map(|column| Some((column, column.odd_unit.as_ref()?))) {
            return Err(format!(
                "the table states {} in {odd:?}, which flightlag does not know as a unit of it",
                column.path
            ));
        }
        let mut units = columns().filter_map(|column| column.unit);
        let first = units.next();
        match units.find(|unit| Some(*unit) != first) {
            Some(_) => Err("the table states different units for them".to_owned()),
            None => Ok(first),
        }
    }

    /// The largest absolute value of any of the columns.
    fn largest(&self) -> f64 {
        self.group.columns.iter().map(|column| compare::largest(self.table, column)).fold(0.0, f64::max)
    }
}

fn unit(symbol: &str) -> Result<Unit, String> {
    compare::unit(symbol).ok_or_else(|| "no such unit".to_owned())
}

/// The attitudes, rates and forces of the tables, and why others are not bound. `motions` are the bound velocities.
pub(super) fn bodies<'l>(
    sources: &'l [TableColumns<'l>],
    motions: &[Found<'_, Motion>],
    times: &[(&str, &Timing)],
) -> (Vec<Found<'l, Body>>, Vec<String>) {
    let mut bodies = Bodies::default();
    let flown = motions.iter().find_map(|motion| body_attitude::flown(sources, motion));
    let mut rotations: Vec<Rotation> = vec![];
    let timed = || sources.iter().filter_map(|source| Some((source, timing_of(source, times)?)));
    for (source, timing) in timed() {
        for group in &source.attitudes {
            let of = TimedTriple { table: source.table, timing, group };
            let decided = body_attitude::decide(&of, flown.as_ref());
            rotations.extend(decided.as_ref().ok().map(|body| Rotation::new(&of, body)));
            bodies.keep(source, &of, decided);
        }
    }
    for (source, timing) in timed() {
        let rotation = rotations.iter().find(|rotation| rotation.clock == timing.clock);
        for group in &source.rates {
            let of = TimedTriple { table: source.table, timing, group };
            bodies.keep(source, &of, rate::decide(&of, rotation));
        }
        for group in &source.forces {
            let of = TimedTriple { table: source.table, timing, group };
            bodies.keep(source, &of, force::decide(&of, rotation));
        }
    }
    (bodies.found, bodies.reasons)
}

/// The channels found so far, and the reasons why others are not bound.
#[derive(Default)]
struct Bodies<'l> {
    found: Vec<Found<'l, Body>>,
    reasons: Vec<String>,
}

impl<'l> Bodies<'l> {
    fn keep(&mut self, source: &'l TableColumns<'l>, of: &TimedTriple<'_>, body: Result<Body, String>) {
        match body {
            Ok(what) => self.found.push(Found::of(source, of.timing, what)),
            Err(why) => self.reasons.push(format!("{}: {why}", of.group.names())),
        }
    }
}

/// The time of a table: that of its positions and velocities, or else a certain one.
fn timing_of<'t>(source: &'t TableColumns<'_>, times: &[(&str, &'t Timing)]) -> Option<&'t Timing> {
    let is_own = |timing: &Timing| source.timings.iter().any(|own| own.entry == timing.entry);
    let same = times.iter().find(|(topic, timing)| *topic == source.table.topic.name && is_own(timing));
    same.map(|(_, timing)| *timing).or(source.timings.first().filter(|timing| timing.is_certain))
}
