//! A table with only a position or a velocity, as the second file of a flight: the possible directions of its axes. The
//! motion of the first file has to decide between them.

use super::decide::{Motion, Place, Vertical, plausible_height, side, unit};
use super::sets::{Position, Source, Velocity, says_axes, sources};
use super::times::Timing;
use super::write::{All, map};
use super::{Found, Guess, odd_unit};
use crate::reader::Log;

/// Which column is north, and whether the other one is positive to the west.
const AXES: [(bool, bool); 4] = [(false, false), (true, false), (false, true), (true, true)];

/// The maps by which a table may be read; none if the unit of its time or of its columns is unknown.
pub(crate) fn ways(log: &Log) -> Vec<Guess> {
    let sources = sources(log);
    if odd_unit(&sources).is_some() {
        return vec![];
    }
    let several = log.tables.len() > 1;
    let of_source = |source| of_source(source).into_iter().map(|all| map(&all, &[], several));
    sources.iter().flat_map(of_source).collect()
}

fn of_source<'l>(source: &'l Source<'l>) -> Vec<All<'l>> {
    // A time with an ambiguous unit is read in each: only one of them moves as the log does.
    source.timings.iter().flat_map(|timing| of_timing(source, timing)).collect()
}

fn of_timing<'l>(source: &'l Source<'l>, timing: &Timing) -> Vec<All<'l>> {
    let alone = |places, motions| All { places, motions, bodies: vec![] };
    if source.positions.is_empty() {
        let motions = source.velocities.iter().flat_map(motions);
        return motions.map(|what| alone(vec![], vec![Found::of(source, timing, what)])).collect();
    }
    let places = source.positions.iter().filter(|p| !p.is_geodetic).flat_map(|p| places(source, p));
    places.map(|what| alone(vec![Found::of(source, timing, what)], vec![])).collect()
}

const JUDGED: &str = "by its names; the motion in the first file decides the axes";

fn motions(set: &Velocity) -> Vec<Motion> {
    let Some(speed) = set.first.unit.or(unit("m/s")) else { return vec![] };
    let angle = set.is_polar.then(|| set.second.unit.or(unit("deg"))).flatten();
    let is_plain = set.is_polar || says_axes(&set.first);
    let third = set.third.as_ref().map(|t| (t.unit.unwrap_or(speed), side(t).unwrap_or(Vertical::LeftOut)));
    let one = |(swapped, is_west): (bool, bool)| Motion {
        set: set.clone(),
        unit: speed,
        angle,
        third,
        swapped,
        is_west,
        agreement: 0.0,
        why: vec![JUDGED.to_owned()],
    };
    AXES.into_iter().take(if is_plain { 1 } else { AXES.len() }).map(one).collect()
}

fn places(source: &Source<'_>, set: &Position) -> Vec<Place> {
    let Some(length) = set.first.unit.or(unit("m")) else { return vec![] };
    let third = set.third.as_ref().and_then(|t| {
        let (unit, _) = plausible_height(source.table, t, length);
        Some((unit?, side(t).unwrap_or(Vertical::LeftOut)))
    });
    let one = |(swapped, is_west): (bool, bool)| Place {
        set: set.clone(),
        unit: length,
        third,
        swapped,
        is_west,
        why: vec![JUDGED.to_owned()],
    };
    AXES.into_iter().take(if says_axes(&set.first) { 1 } else { AXES.len() }).map(one).collect()
}
