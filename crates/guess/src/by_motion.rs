//! Tables without a header or with meaningless names: finds the columns that move like a position and a velocity.

use super::column_groups::{Position, TableColumns, Velocity};
use super::names::{Axis, Named, Role};
use super::time_columns::{Timing, timings};
use formats::{Table, TableHead};

/// Tables with more columns are not tried.
const MOST_COLUMNS: usize = 40;
/// No flight extends further, as an angle in degrees.
const MOST_TRAVELLED: f64 = 20.0;

/// Columns that are tried as the time.
const MOST_TIMES: usize = 4;

/// Whether no column has a name.
pub(super) fn is_headerless(head: &TableHead) -> bool {
    let is_numbered = |(i, name): (usize, &String)| *name == format!("column_{}", i + 1);
    may_be_tried(head) && head.names.iter().enumerate().all(is_numbered)
}

/// Whether there are few enough columns to try them by their motion alone.
pub(super) fn may_be_tried(head: &TableHead) -> bool {
    !head.names.is_empty() && head.names.len() <= MOST_COLUMNS
}

/// All neighbours that may be a latitude and a longitude, and all that may be horizontal velocities: once for each
/// possible time column.
pub(super) fn sources<'l>(head: &TableHead, table: &'l Table) -> Vec<TableColumns<'l>> {
    let times = head.names.iter().filter_map(|path| {
        let found = timings(table, &[Named::with_role(path, Role::Time)]);
        (!found.is_empty()).then_some((path, found))
    });
    times.take(MOST_TIMES).map(|(time, timings)| source(head, table, time, timings)).collect()
}

fn source<'l>(head: &TableHead, table: &'l Table, time: &String, timings: Vec<Timing>) -> TableColumns<'l> {
    let columns: Vec<&String> = head.names.iter().filter(|path| *path != time && varies(table, path)).collect();
    let follow = |at: usize| columns.get(at).copied();
    let pairs = || columns.windows(2).enumerate().filter_map(|(at, pair)| Some((at, *pair.first()?, *pair.get(1)?)));
    let position = |at: usize, latitude: &String, longitude: &String| Position {
        source: String::new(),
        is_geodetic: true,
        first: Named::with_role(latitude, Role::Latitude),
        second: Named::with_role(longitude, Role::Longitude),
        third: follow(at + 2).map(|path| Named::with_role(path, Role::Height)),
    };
    let either_way = pairs().flat_map(|(at, a, b)| [(at, a, b), (at, b, a)]);
    let places = either_way.filter(|(_, latitude, longitude)| may_be_place(table, latitude, longitude));
    let positions: Vec<Position> = places.map(|(at, latitude, longitude)| position(at, latitude, longitude)).collect();
    let is_place = |path: &String| positions.iter().any(|p| p.first.path == *path || p.second.path == *path);
    let velocities = pairs().filter(|(_, a, b)| !is_place(a) && !is_place(b)).map(|(at, a, b)| Velocity {
        source: String::new(),
        is_polar: false,
        first: Named::with_role(a, Role::Velocity(Axis::X)),
        second: Named::with_role(b, Role::Velocity(Axis::Y)),
        third: follow(at + 2).map(|path| Named::with_role(path, Role::Velocity(Axis::Z))),
    });
    let velocities = velocities.collect();
    let (attitudes, rates, forces) = (vec![], vec![], vec![]);
    TableColumns {
        table,
        timings,
        unread_time: None,
        refused_time: None,
        positions,
        velocities,
        without_number: vec![],
        lost_heights: vec![],
        speed_alone: None,
        attitudes,
        rates,
        forces,
    }
}

fn range(table: &Table, path: &str) -> Option<(f64, f64)> {
    let column = table.numbers(path)?;
    let values = (0..table.rows).filter_map(|row| column.number(row)).filter(|v| v.is_finite());
    values.fold(None, |range: Option<(f64, f64)>, v| Some(range.map_or((v, v), |(a, b)| (a.min(v), b.max(v)))))
}

fn varies(table: &Table, path: &str) -> bool {
    range(table, path).is_some_and(|(least, most)| most > least)
}

/// Degrees, or integers of 1e-7 degrees, that stay in one country, and have enough digits for a position.
fn may_be_place(table: &Table, latitude: &str, longitude: &str) -> bool {
    let Some(((a, b), (c, d))) = range(table, latitude).zip(range(table, longitude)) else { return false };
    let fits = |scale: f64| {
        let in_range = a.abs().max(b.abs()) <= 90.0 * scale && c.abs().max(d.abs()) <= 180.0 * scale;
        in_range && (b - a).max(d - c) <= MOST_TRAVELLED * scale && a.abs().max(c.abs()) > 0.01 * scale
    };
    let is_fine = |path: &str| {
        let value = table.numbers(path).and_then(|column| column.number(table.rows / 2));
        value.is_some_and(|value| (value * 1e4).fract().abs() > 1e-9 || value.abs() > 1e4)
    };
    (fits(1.0) || fits(1e7)) && is_fine(latitude) && is_fine(longitude)
}
