//! A table with only a position or a velocity, as the second file of a flight: the possible directions of its axes. The
//! motion of the first file has to decide between them.

use super::column_groups::odd_unit;
use super::column_groups::{Position, TableColumns, Velocity, names_axes, sources};
use super::compare::{Motion, Place, Vertical, plausible_height, side, unit};
use super::found::{Found, Guess};
use super::time_columns::Timing;
use super::write::{GuessedChannels, map};
use formats::Log;

/// Whether the second column is north, and whether the other one is positive to the west.
const AXES: [(bool, bool); 4] = [(false, false), (true, false), (false, true), (true, true)];

/// The maps by which a table may be read; none if the unit of its time or of its columns is unknown.
pub fn orientations(log: &Log) -> Vec<Guess> {
    let sources = sources(log);
    if odd_unit(&sources).is_some() {
        return vec![];
    }
    let several = log.tables.len() > 1;
    let of_source = |source| of_source(source).into_iter().map(|all| map(&all, &[], several));
    sources.iter().flat_map(of_source).collect()
}

fn of_source<'l>(source: &'l TableColumns<'l>) -> Vec<GuessedChannels<'l>> {
    // A time with an ambiguous unit is read in each: only one of them moves as the log does.
    source.timings.iter().flat_map(|timing| of_timing(source, timing)).collect()
}

fn of_timing<'l>(source: &'l TableColumns<'l>, timing: &Timing) -> Vec<GuessedChannels<'l>> {
    let of_one = |places, motions| GuessedChannels { places, motions, bodies: vec![] };
    if source.positions.is_empty() {
        let motions = source.velocities.iter().flat_map(motions);
        return motions.map(|what| of_one(vec![], vec![Found::of(source, timing, what)])).collect();
    }
    let places = source.positions.iter().filter(|p| !p.is_geodetic).flat_map(|p| places(source, p));
    places.map(|what| of_one(vec![Found::of(source, timing, what)], vec![])).collect()
}

const JUDGED: &str = "by its names; the motion in the first file decides the axes";

fn motions(group: &Velocity) -> Vec<Motion> {
    let Some(speed) = group.first.unit.or(unit("m/s")) else { return vec![] };
    let angle = group.is_polar.then(|| group.second.unit.or(unit("deg"))).flatten();
    let is_plain = group.is_polar || names_axes(&group.first);
    let third = group.third.as_ref().map(|t| (t.unit.unwrap_or(speed), side(t).unwrap_or(Vertical::LeftOut)));
    let one = |(swapped, is_west): (bool, bool)| Motion {
        group: group.clone(),
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

fn places(source: &TableColumns<'_>, group: &Position) -> Vec<Place> {
    let Some(length) = group.first.unit.or(unit("m")) else { return vec![] };
    let third = group.third.as_ref().and_then(|t| {
        let (unit, _) = plausible_height(source.table, t, length);
        Some((unit?, side(t).unwrap_or(Vertical::LeftOut)))
    });
    let one = |(swapped, is_west): (bool, bool)| Place {
        group: group.clone(),
        unit: length,
        third,
        swapped,
        is_west,
        why: vec![JUDGED.to_owned()],
    };
    AXES.into_iter().take(if names_axes(&group.first) { 1 } else { AXES.len() }).map(one).collect()
}
