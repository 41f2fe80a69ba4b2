//! Columns that belong together: the axes of a position, or of a velocity.

use super::names::{Axis, Named, Role};
use super::time_blocks::blocks;
use super::time_columns::Timing;
use formats::{Log, Table, TableHead};

/// A table with the roles from its column names and the possible readings of its time.
pub(super) struct TableColumns<'l> {
    pub(super) table: &'l Table,
    pub(super) timings: Vec<Timing>,
    /// Why the time cannot be read, if a column is named like one.
    pub(super) unread_time: Option<String>,
    /// Why the table is not read with any time: the unit is unknown, or it is unclear which of two times counts.
    pub(super) refused_time: Option<String>,
    pub(super) positions: Vec<Position>,
    pub(super) velocities: Vec<Velocity>,
    /// Columns named like a position without a number.
    pub(super) without_number: Vec<String>,
    /// Why heights are not bound.
    pub(super) lost_heights: Vec<String>,
    /// A speed that no other column gives a direction, and a heading that may or may not be its course.
    pub(super) speed_alone: Option<(String, Option<String>)>,
    /// Roll, pitch and yaw.
    pub(super) attitudes: Vec<Triple>,
    /// About three axes of the body.
    pub(super) rates: Vec<Triple>,
    /// Along three axes of the body.
    pub(super) forces: Vec<Triple>,
}

/// Three columns that belong together.
#[derive(Debug, Clone)]
pub(super) struct Triple {
    pub(super) source: String,
    pub(super) columns: [Named; 3],
}

impl Triple {
    /// Their names, for the user.
    pub(super) fn names(&self) -> String {
        let [a, b, c] = &self.columns;
        format!("{}, {} and {}", a.path, b.path, c.path)
    }
}

/// Two or three columns that are a position.
#[derive(Debug, Clone)]
pub(super) struct Position {
    pub(super) source: String,
    /// Latitude and longitude; otherwise lengths along axes.
    pub(super) is_geodetic: bool,
    pub(super) first: Named,
    pub(super) second: Named,
    pub(super) third: Option<Named>,
}

/// Two or three columns that are a velocity.
#[derive(Debug, Clone)]
pub(super) struct Velocity {
    pub(super) source: String,
    /// Speed and track; otherwise speeds along axes.
    pub(super) is_polar: bool,
    pub(super) first: Named,
    pub(super) second: Named,
    pub(super) third: Option<Named>,
}

/// Whether names give the north and east axes.
pub(super) fn names_axes(first: &Named) -> bool {
    matches!(first.role, Role::Position(Axis::North) | Role::Velocity(Axis::North))
}

/// All tables in which something was found; one with several clocks is a table for each.
pub(super) fn sources(log: &Log) -> Vec<TableColumns<'_>> {
    log.tables.iter().flat_map(|table| of_table(log, table)).collect()
}

/// The columns whose name gives a role: those that hold a value, and those without a number.
fn filled(head: &TableHead, table: &Table) -> (Vec<Named>, Vec<Named>) {
    let holds = |column: &Named| {
        let values = || table.numbers(&column.path);
        column.role == Role::Time || values().is_some_and(|v| (0..table.rows).any(|row| v.number(row).is_some()))
    };
    head.names.iter().filter_map(|path| super::names::named(head, path)).partition(holds)
}

fn of_table<'l>(log: &'l Log, table: &'l Table) -> Vec<TableColumns<'l>> {
    let Some(head) = log.head(&table.topic.name) else { return vec![] };
    let (named, empty) = filled(head, table);
    let is_position = |c: &Named| matches!(c.role, Role::Latitude | Role::Longitude | Role::Position(_));
    let mut lost_heights: Vec<String> = empty.iter().filter(|c| c.role == Role::Height).map(without_height).collect();
    let mut without_number: Vec<String> = empty.into_iter().filter(is_position).map(|column| column.path).collect();
    let unknown_unit = super::time_columns::unknown_unit(table, &named);
    let parts = super::time_columns::parts_of_time(table, &head.names);
    let mut times = named.iter().filter(|column| column.role == Role::Time);
    let (of_times, clash) = match times.any(|column| !parts.contains(&column.path.as_str())) {
        true => blocks(table, named),
        false if parts.is_empty() => {
            let rising = super::time_columns::by_rise(table, &head.names, &named);
            (vec![(named, rising)], None)
        }
        false => (vec![(named, vec![])], None),
    };
    let mut refused_time = unknown_unit.or(clash);
    let of_block = |(named, timings): (Vec<Named>, Vec<Timing>)| TableColumns {
        refused_time: refused_time.take(),
        without_number: std::mem::take(&mut without_number),
        lost_heights: std::mem::take(&mut lost_heights).into_iter().chain(stray_heights(&named)).collect(),
        ..source(head, table, &named, timings)
    };
    of_times.into_iter().map(of_block).collect()
}

fn without_height(column: &Named) -> String {
    format!("{}: no cell is a plain number; write it with a decimal point and without other marks", column.path)
}

/// Heights that by their names belong to no latitude and longitude, where one of these has no height.
fn stray_heights(named: &[Named]) -> Option<String> {
    let lacks = |c: &&Named| c.role == Role::Latitude && of(named, &c.source, Role::Height).is_none();
    let place = named.iter().find(lacks)?;
    let has_place = |source: &str| of(named, source, Role::Latitude).is_some();
    let stray = named.iter().filter(|c| c.role == Role::Height && !has_place(&c.source));
    let stray: Vec<&str> = stray.map(|c| c.path.as_str()).collect();
    (!stray.is_empty()).then(|| {
        format!(
            "{}: by the name not the height of {}, which has none; call the column alt, or state it in a channel map",
            stray.join(" and "),
            place.path
        )
    })
}

/// The columns of one time.
fn source<'l>(head: &TableHead, table: &'l Table, named: &[Named], timings: Vec<Timing>) -> TableColumns<'l> {
    let mut labels: Vec<&str> = vec![];
    for column in named.iter().filter(|c| !matches!(c.role, Role::Time | Role::Week)) {
        if !labels.contains(&column.source.as_str()) {
            labels.push(&column.source);
        }
    }
    let positions = labels.iter().flat_map(|label| positions(named, label)).collect();
    let velocities: Vec<Velocity> = labels.iter().flat_map(|label| velocities(named, label)).collect();
    let path_of = |role| named.iter().find(|column| column.role == role).map(|column| column.path.clone());
    let speed_alone = path_of(Role::Speed).filter(|_| velocities.is_empty()).map(|speed| (speed, path_of(Role::Yaw)));
    let unread_time =
        if timings.is_empty() { super::time_columns::unreadable(table, &head.names, named) } else { None };
    let triples = |roles: [Role; 3]| labels.iter().filter_map(|label| triple(named, label, roles)).collect();
    TableColumns {
        table,
        timings,
        unread_time,
        refused_time: None,
        positions,
        velocities,
        without_number: vec![],
        lost_heights: vec![],
        speed_alone,
        attitudes: triples(ATTITUDE),
        rates: triples(AXES.map(Role::Rate)),
        forces: triples(AXES.map(Role::Force)),
    }
}

const ATTITUDE: [Role; 3] = [Role::Roll, Role::Pitch, Role::Yaw];
const AXES: [Axis; 3] = [Axis::X, Axis::Y, Axis::Z];

fn triple(named: &[Named], label: &str, roles: [Role; 3]) -> Option<Triple> {
    let [a, b, c] = roles.map(|role| of(named, label, role));
    Some(Triple { source: label.to_owned(), columns: [a?, b?, c?] })
}

/// Whether names indicate an attitude, rates or forces in a table.
pub(super) fn has_body(named: &[Named]) -> bool {
    let found = |label: &str| {
        [ATTITUDE, AXES.map(Role::Rate), AXES.map(Role::Force)]
            .into_iter()
            .any(|roles| triple(named, label, roles).is_some())
    };
    named.iter().any(|c| c.role == Role::Time) && named.iter().any(|c| found(&c.source))
}

/// Whether names alone indicate that a table of these columns may hold something.
pub(super) fn may_hold(named: &[Named]) -> bool {
    named.iter().any(|c| c.role == Role::Time) && (has_position(named) || has_velocity(named))
}

/// Whether names alone indicate a position and a velocity, but no time.
pub(super) fn lacks_time(named: &[Named]) -> bool {
    named.iter().all(|c| c.role != Role::Time) && has_position(named) && has_velocity(named)
}

pub(super) fn has_position(named: &[Named]) -> bool {
    named.iter().any(|c| !positions(named, &c.source).is_empty())
}

pub(super) fn has_velocity(named: &[Named]) -> bool {
    named.iter().any(|c| !velocities(named, &c.source).is_empty())
}

fn of(named: &[Named], label: &str, role: Role) -> Option<Named> {
    named.iter().find(|c| c.role == role && c.source == label).cloned()
}

fn positions(named: &[Named], label: &str) -> Vec<Position> {
    let of = |role| of(named, label, role);
    let source = label.to_owned();
    let geodetic = of(Role::Latitude).zip(of(Role::Longitude)).map(|(first, second)| Position {
        source: source.clone(),
        is_geodetic: true,
        first,
        second,
        third: of(Role::Height),
    });
    let axes = axes(|axis| of(Role::Position(axis)));
    let local = axes.map(|(first, second, third)| Position { source, is_geodetic: false, first, second, third });
    geodetic.into_iter().chain(local).collect()
}

fn velocities(named: &[Named], label: &str) -> Vec<Velocity> {
    let of = |role| of(named, label, role);
    let source = label.to_owned();
    let axes = axes(|axis| of(Role::Velocity(axis)));
    let of_axes =
        axes.map(|(first, second, third)| Velocity { source: source.clone(), is_polar: false, first, second, third });
    let polar = of(Role::Speed).zip(of(Role::Track)).map(|(first, second)| {
        let third = of(Role::Velocity(Axis::Up)).or_else(|| of(Role::Velocity(Axis::Down)));
        Velocity { source, is_polar: true, first, second, third }
    });
    of_axes.into_iter().chain(polar).collect()
}

/// North, east and a vertical axis, or x, y and z.
fn axes(of: impl Fn(Axis) -> Option<Named>) -> Option<(Named, Named, Option<Named>)> {
    let pair = |a, b| of(a).zip(of(b));
    if let Some((north, east)) = pair(Axis::North, Axis::East) {
        return Some((north, east, of(Axis::Down).or_else(|| of(Axis::Up)).or_else(|| of(Axis::Z))));
    }
    pair(Axis::X, Axis::Y).map(|(x, y)| (x, y, of(Axis::Z)))
}

/// The message for a table that states an unknown unit, or whose time is unclear. Such a table is not read in another
/// unit.
pub(super) fn odd_unit(sources: &[TableColumns<'_>]) -> Option<String> {
    if let Some(why) = sources.iter().find_map(|source| source.refused_time.as_ref()) {
        return Some(why.clone());
    }
    let of_positions = sources.iter().flat_map(|s| &s.positions).map(|p| (&p.first, &p.second, &p.third));
    let of_velocities = sources.iter().flat_map(|s| &s.velocities).map(|v| (&v.first, &v.second, &v.third));
    of_positions.chain(of_velocities).find_map(|(first, second, third)| {
        let columns = [Some(first), Some(second), third.as_ref()];
        columns.into_iter().flatten().find_map(|column| {
            let unit = column.odd_unit.as_ref()?;
            Some(format!("the table states the unit {unit:?} for {}, which flightlag does not know", column.path))
        })
    })
}
