//! Attitudes, angular rates and specific forces: infers units and axes by comparing them with each other and with the
//! velocity. What these contradict or cannot decide is rejected.

mod attitude;
mod force;
mod rate;

use self::attitude::Turns;
use super::decide::Motion;
use super::motion::Trace;
use super::sets::{Source, Triple};
use super::times::Timing;
use super::{Found, decide};
use crate::table::Table;
use flight::Unit;

/// An agreement that confirms or, with the opposite sign, contradicts.
const CONFIRMS: f64 = 0.8;
/// A difference in agreement that decides.
const DECIDES: f64 = 0.05;

/// Three columns with their unit and frame.
#[derive(Debug, Clone)]
pub(super) struct Body {
    pub(super) set: Triple,
    pub(super) quantity: &'static str,
    pub(super) roles: [&'static str; 3],
    pub(super) unit: Unit,
    /// As named in a map.
    pub(super) frame: &'static str,
    pub(super) why: Vec<String>,
}

/// Columns of a table with its time.
struct Of<'a> {
    table: &'a Table,
    timing: &'a Timing,
    set: &'a Triple,
}

impl Of<'_> {
    /// The values in SI units, over the time of the table.
    fn trace(&self, unit: Unit) -> Trace<3> {
        let columns = self.set.columns.each_ref().map(Some);
        decide::trace(self.table, &self.timing.times_s, columns, |values| values.map(|value| unit.to_si(value)))
    }

    /// The unit that the table states, or `None`.
    ///
    /// # Errors
    /// If a unit is unknown, or differs between columns.
    fn stated(&self) -> Result<Option<Unit>, String> {
        let columns = || self.set.columns.iter();
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
        self.set.columns.iter().map(|column| decide::largest(self.table, column)).fold(0.0, f64::max)
    }
}

fn unit(symbol: &str) -> Result<Unit, String> {
    decide::unit(symbol).ok_or_else(|| "no such unit".to_owned())
}

/// What is found in the tables, and why other sets are not bound. `motions` are the bound velocities.
pub(super) fn bodies<'l>(
    sources: &'l [Source<'l>],
    motions: &[Found<'_, Motion>],
    times: &[(&str, &Timing)],
) -> (Vec<Found<'l, Body>>, Vec<String>) {
    let mut bodies = Bodies::default();
    let flown = motions.iter().find_map(|motion| attitude::flown(sources, motion));
    let mut turns: Vec<Turns> = vec![];
    let timed = || sources.iter().filter_map(|source| Some((source, timing_of(source, times)?)));
    for (source, timing) in timed() {
        for set in &source.attitudes {
            let of = Of { table: source.table, timing, set };
            let decided = attitude::decide(&of, flown.as_ref());
            turns.extend(decided.as_ref().ok().map(|body| Turns::new(&of, body)));
            bodies.keep(source, &of, decided);
        }
    }
    for (source, timing) in timed() {
        let turns = turns.iter().find(|turns| turns.clock == timing.clock);
        for set in &source.rates {
            let of = Of { table: source.table, timing, set };
            bodies.keep(source, &of, rate::decide(&of, turns));
        }
        for set in &source.forces {
            let of = Of { table: source.table, timing, set };
            bodies.keep(source, &of, force::decide(&of, turns));
        }
    }
    (bodies.found, bodies.reasons)
}

/// What is decided so far, and why the rest is not.
#[derive(Default)]
struct Bodies<'l> {
    found: Vec<Found<'l, Body>>,
    reasons: Vec<String>,
}

impl<'l> Bodies<'l> {
    fn keep(&mut self, source: &'l Source<'l>, of: &Of<'_>, body: Result<Body, String>) {
        match body {
            Ok(what) => self.found.push(Found::of(source, of.timing, what)),
            Err(why) => self.reasons.push(format!("{}: {why}", of.set.names())),
        }
    }
}

/// The time of a table: that of its positions and velocities, or else a certain one.
fn timing_of<'t>(source: &'t Source<'_>, times: &[(&str, &'t Timing)]) -> Option<&'t Timing> {
    let same = times.iter().find(|(topic, _)| *topic == source.table.topic.name).map(|(_, timing)| *timing);
    same.or(source.timings.first().filter(|timing| timing.is_certain))
}
