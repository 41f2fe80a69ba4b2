//! Infers units, axes and signs of a position and a velocity from the motion.

use super::column_groups::{Position, Velocity, names_axes};
use super::names::{Axis, Named, Role};
use super::time_columns::Timing;
use super::windows::{Match, Trace, Windows};
use binding::is_all_nines;
use flight::{Dimension, Geodetic, LocalFrame, Unit};
use formats::{Column, Table};

/// The least agreement of a position and a velocity of one vehicle.
const LEAST_AGREEMENT: f64 = 0.9;
/// A smaller difference in agreement counts as zero.
const SAME: f64 = 0.02;
/// A larger difference in agreement decides.
const DECIDES: f64 = 0.05;
/// A unit is right if the measured scale is this near, as a logarithm.
const NEAR: f64 = 0.15;
/// The least agreement of a height and a vertical velocity. Heights move too little for a higher limit.
const LEAST_VERTICAL: f64 = 0.8;
/// The most rows that are compared. Of a longer table [`STRETCHES`] contiguous stretches are compared: each lasts
/// minutes, and windows last seconds.
const MOST_ROWS: usize = 1 << 19;
const STRETCHES: usize = 32;
/// The latitude of a pole, rad.
const MOST_LATITUDE: f64 = std::f64::consts::FRAC_PI_2;

/// The positive direction of a vertical column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Vertical {
    Up,
    Down,
    /// Unknown: the column is left out.
    LeftOut,
}

/// A position with its units.
#[derive(Debug, Clone)]
pub(super) struct Place {
    pub(super) group: Position,
    pub(super) unit: Unit,
    pub(super) third: Option<(Unit, Vertical)>,
    /// The second column is north, and the first one east.
    pub(super) swapped: bool,
    /// The east column is positive to the west.
    pub(super) is_west: bool,
    pub(super) why: Vec<String>,
}

/// A velocity with its units and axes.
#[derive(Debug, Clone)]
pub(super) struct Motion {
    pub(super) group: Velocity,
    pub(super) unit: Unit,
    /// For a track.
    pub(super) angle: Option<Unit>,
    pub(super) third: Option<(Unit, Vertical)>,
    pub(super) swapped: bool,
    /// The east column is positive to the west.
    pub(super) is_west: bool,
    /// With the position that it was compared with; 1 is complete.
    pub(super) agreement: f64,
    pub(super) why: Vec<String>,
}

/// The rows of a table that are compared: all of them, or some stretches of a very long one.
fn compared_rows(rows: usize) -> impl Iterator<Item = usize> {
    let stretches = if rows > MOST_ROWS { STRETCHES } else { 1 };
    let length = rows.min(MOST_ROWS) / stretches;
    (0..stretches).flat_map(move |stretch| {
        let begin = stretch * (rows - length) / (stretches - 1).max(1);
        begin..begin + length
    })
}

/// The values of some columns over the time of a table, each row converted by `convert`. Rows with a number in place of a
/// missing value are left out.
pub(super) fn trace<const N: usize>(
    table: &Table,
    times_s: &[f64],
    columns: [Option<&Named>; N],
    convert: impl Fn([f64; N]) -> [f64; N],
) -> Trace<N> {
    let columns = columns.map(|column| column.and_then(|c| table.numbers(&c.path)));
    let row = |row: usize| {
        let time_s = *times_s.get(row)?;
        let mut values = [0.0; N];
        for (value, column) in values.iter_mut().zip(&columns) {
            if let Some(column) = column {
                *value = column.number(row).filter(|value| !is_all_nines(*value))?;
            }
        }
        Some((time_s, convert(values)))
    };
    Trace::new(compared_rows(times_s.len()).filter_map(row).collect())
}

pub(super) fn unit(symbol: &str) -> Option<Unit> {
    symbol.parse().ok()
}

pub(super) fn largest(table: &Table, column: &Named) -> f64 {
    let values = table.numbers(&column.path);
    (0..table.rows).filter_map(|row| values?.number(row)).fold(0.0, |most, v| most.max(v.abs()))
}

/// Distances from the centre of the Earth within which anything flies, m.
const EARTH_CENTRED_M: std::ops::Range<f64> = 6.33e6..6.5e6;

/// Whether three lengths are earth-centred coordinates: their distance from the origin is the Earth's radius.
pub(super) fn is_earth_centred(table: &Table, group: &Position) -> bool {
    let columns =
        [Some(&group.first), Some(&group.second), group.third.as_ref()].map(|c| Some((c?, table.numbers(&c?.path)?)));
    let [Some(x), Some(y), Some(z)] = columns else { return false };
    let length = |row: usize, (column, values): (&Named, &Column)| {
        let value = values.number(row)?;
        Some(column.unit.map_or(value, |unit| unit.to_si(value)))
    };
    let distance = |row: usize| Some(length(row, x)?.hypot(length(row, y)?).hypot(length(row, z)?));
    let mut distances = (0..table.rows).filter_map(distance).filter(|distance| *distance > 0.0).peekable();
    !group.is_geodetic && distances.peek().is_some() && distances.all(|distance| EARTH_CENTRED_M.contains(&distance))
}

/// Possible units of a position: the stated one, or those that its range allows, with the reason; none for
/// earth-centred coordinates, which have no north axis.
pub(super) fn units_of_place(table: &Table, group: &Position) -> Vec<(Unit, String)> {
    if is_earth_centred(table, group) {
        return vec![];
    }
    let stated = group.first.unit.or(group.second.unit);
    if let Some(stated) = stated {
        return vec![(stated, format!("the table states {stated}"))];
    }
    if !group.is_geodetic {
        return unit("m").map(|m| (m, "assumed in metres".to_owned())).into_iter().collect();
    }
    let (latitude, longitude) = (largest(table, &group.first), largest(table, &group.second));
    if are_degrees_and_minutes(latitude, longitude) {
        return vec![];
    }
    let fits = |symbol: &str| {
        let unit = unit(symbol)?;
        (unit.to_si(latitude) <= MOST_LATITUDE && unit.to_si(longitude) <= 2.0 * std::f64::consts::PI + 1e-9)
            .then_some(unit)
    };
    let why = |unit: Unit| (unit, format!("its range is that of {unit}"));
    if latitude.max(longitude) > 1e4 {
        return fits("1e-7 deg").map(why).into_iter().collect();
    }
    let radians = fits("rad").filter(|_| longitude <= std::f64::consts::PI + 1e-9);
    let degrees =
        fits("deg").map(|unit| (unit, if radians.is_some() { "tried as deg".to_owned() } else { why(unit).1 }));
    degrees.into_iter().chain(radians.map(|rad| (rad, "tried as rad".to_owned()))).collect()
}

/// Whether the largest latitude and longitude look like 4807.038 for 48° 07.038′.
fn are_degrees_and_minutes(latitude: f64, longitude: f64) -> bool {
    let is_whole = |value: f64| value % 100.0 < 60.0;
    (180.0..=9000.0).contains(&latitude) && longitude <= 18_000.0 && is_whole(latitude) && is_whole(longitude)
}

/// The reason for a position without a unit: it is earth-centred, or its values fit no unit of angle.
pub(super) fn without_unit(table: &Table, group: &Position) -> String {
    if !group.is_geodetic {
        let [x, y] = [&group.first.path, &group.second.path];
        let z = group.third.as_ref().map_or("", |z| &z.path);
        return format!(
            "{x}, {y} and {z} are earth-centred coordinates; read them in a channel map as x, y and z with frame = \
             \"ecef\", see `flightlag maps --example`"
        );
    }
    let [latitude, longitude] = [&group.first, &group.second].map(|column| (&column.path, largest(table, column)));
    if are_degrees_and_minutes(latitude.1, longitude.1) {
        return format!(
            "the values of {} and {} look like degrees and minutes ({:.0}.…), which are not read",
            latitude.0,
            longitude.0,
            latitude.1.trunc()
        );
    }
    if latitude.1 > 90.0 && latitude.1 <= 180.0 && longitude.1 <= 90.0 {
        return format!(
            "{} reaches {:.1}, which no latitude can: {} and {} may be exchanged",
            latitude.0, latitude.1, latitude.0, longitude.0
        );
    }
    format!(
        "the values of {} reach {}, those of {} {}: neither degrees nor radians nor 1e-7 degrees (missing values as -9999, or \
         degrees and minutes as 4807.038, are not read from a table: leave cells without a value empty)",
        latitude.0, latitude.1, longitude.0, longitude.1
    )
}

/// A position in metres north, east, up from its first row; lengths in the order of the columns.
fn metres(table: &Table, timing: &Timing, group: &Position, angle: Unit) -> Trace<3> {
    let columns = [Some(&group.first), Some(&group.second), group.third.as_ref()];
    let third = group.third.as_ref().and_then(|c| c.unit);
    let height = |value: f64| third.map_or(value, |unit| unit.to_si(value));
    if !group.is_geodetic {
        return trace(table, &timing.times_s, columns, |[a, b, c]| [angle.to_si(a), angle.to_si(b), height(c)]);
    }
    let mut degrees: Trace<3> =
        trace(table, &timing.times_s, columns, |[a, b, c]| [angle.to_si(a), angle.to_si(b), height(c)]);
    let is_fix = |[latitude, longitude, _]: &[f64; 3]| *latitude != 0.0 || *longitude != 0.0;
    degrees.retain(is_fix);
    let Some([latitude, longitude, _]) = degrees.values.first().copied() else { return degrees };
    let frame = LocalFrame::new(Geodetic { latitude, longitude, height: 0.0 });
    for value in &mut degrees.values {
        let [latitude, longitude, height] = *value;
        let [north, east, _] = frame.to_ned(Geodetic { latitude, longitude, height: 0.0 });
        *value = [north, east, height];
    }
    degrees
}

/// A velocity as logged: along the axes of its columns, with the track in `angle`.
fn speeds(table: &Table, timing: &Timing, group: &Velocity, angle: Option<Unit>) -> Trace<3> {
    let columns = [Some(&group.first), Some(&group.second), group.third.as_ref()];
    trace(table, &timing.times_s, columns, |[a, b, c]| match angle {
        Some(angle) => [a * angle.to_si(b).cos(), a * angle.to_si(b).sin(), c],
        None => [a, b, c],
    })
}

/// A table, its time, and some of its columns.
pub(super) struct Timed<'a, S> {
    pub(super) table: &'a Table,
    pub(super) timing: &'a Timing,
    pub(super) group: &'a S,
}

impl<S> Clone for Timed<'_, S> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<S> Copy for Timed<'_, S> {}

/// Finds the units, axes and signs with which the velocity agrees with the motion of the position.
///
/// # Errors
/// Why there are none, or more than one.
pub(super) fn decide(place: Timed<'_, Position>, motion: Timed<'_, Velocity>) -> Result<(Place, Motion), String> {
    let mut found: Vec<(Place, Motion)> = vec![];
    let mut why_not = without_unit(place.table, place.group);
    for (angle, why) in units_of_place(place.table, place.group) {
        for track in tracks(motion.table, motion.group) {
            let speeds = speeds(motion.table, motion.timing, motion.group, track);
            let metres = metres(place.table, place.timing, place.group, angle);
            match Windows::new(metres, speeds) {
                None => why_not = "there is too little motion to compare them".into(),
                Some(windows) => match fit(place, motion, &windows, (angle, &why), track) {
                    Ok(fit) => found.push(fit),
                    Err(why) => why_not = why,
                },
            }
        }
    }
    found.sort_by(|(_, a), (_, b)| b.agreement.total_cmp(&a.agreement));
    match found.as_slice() {
        [] => Err(why_not),
        [(a, best), (b, other), ..] if best.agreement - other.agreement < SAME && a.unit != b.unit => {
            Err(format!("{} may be in {} or in {}", place.group.first.path, a.unit, b.unit))
        }
        _ => found.into_iter().next().ok_or(why_not),
    }
}

/// Start of the part of a reason that gives an agreement that is too low.
const AGREEMENT: &str = "(agreement ";

/// Whether a reason of [`decide`] is that position and velocity move differently.
pub(super) fn is_contradiction(why: &str) -> bool {
    why.contains(AGREEMENT)
}

/// Possible units of a track; one `None` for a velocity along axes.
fn tracks(table: &Table, group: &Velocity) -> Vec<Option<Unit>> {
    if !group.is_polar {
        return vec![None];
    }
    let guessed = if largest(table, &group.second) > 2.0 * std::f64::consts::PI + 1e-6 { "deg" } else { "rad" };
    vec![group.second.unit.or_else(|| unit(guessed))]
}

fn fit(
    place: Timed<'_, Position>,
    motion: Timed<'_, Velocity>,
    windows: &Windows,
    (angle, why): (Unit, &str),
    track: Option<Unit>,
) -> Result<(Place, Motion), String> {
    let found = axes(place.group, motion.group, windows)?;
    let (first, second) = (&motion.group.first, &motion.group.second);
    let speed = unit_of_speed(motion, found.scale)?;
    let (height, vertical, notes) = verticals(place, motion.group, windows, (angle, speed));
    let is_unnamed = !place.group.is_geodetic && !names_axes(&place.group.first);
    let mut whys = vec![evidence(windows, &place.group.first.path, &found, speed)];
    if is_unnamed {
        whys.push("it is unknown where x points: it is called north; this does not affect the delay".into());
    }
    if found.swapped {
        whys.push(format!("{} goes north and {} east", second.path, first.path));
    }
    whys.extend(notes);
    let place_unit_why =
        if why.starts_with("tried") { format!("{angle}, according to the motion") } else { why.to_owned() };
    // Where the velocity names its axes, they decide those of an unnamed position.
    let of_place = is_unnamed && names_axes(first);
    if of_place && found.signs[1] < 0.0 {
        return Err(format!(
            "{} and {} have the opposite sign of {} and {}",
            place.group.first.path, place.group.second.path, first.path, second.path
        ));
    }
    let place = Place {
        group: place.group.clone(),
        unit: angle,
        third: height,
        swapped: of_place && found.swapped,
        is_west: false,
        why: vec![place_unit_why],
    };
    let motion = Motion {
        group: motion.group.clone(),
        unit: speed,
        angle: track,
        third: vertical,
        swapped: !of_place && found.swapped,
        is_west: found.signs[1] < 0.0,
        agreement: found.agreement,
        why: whys,
    };
    Ok((place, motion))
}

/// The evidence for the units and axes of a velocity.
fn evidence(windows: &Windows, place: &str, found: &Match, speed: Unit) -> String {
    format!(
        "{} windows of {:.1} s: it agrees with the motion of {place} to {:.3}, velocity over displacement is {:.3} ({speed} would \
         be {:.3}), the position is {:.1} s late in this comparison",
        windows.moved.len(),
        windows.length_s,
        found.agreement,
        found.scale,
        1.0 / speed.to_si(1.0),
        windows.late_s
    )
}

/// The directions of the axes: as named if they are named, else those that fit best by far.
fn axes(place: &Position, motion: &Velocity, windows: &Windows) -> Result<Match, String> {
    let all = windows.all();
    let plain = windows.try_axes(false, [1.0, 1.0]);
    let Some(best) = all.first().copied() else { return Err("nothing to compare".into()) };
    let (a, b) = (&motion.first.path, &motion.second.path);
    if best.agreement < LEAST_AGREEMENT {
        let agreement = best.agreement;
        return Err(format!("{a} and {b} do not fit the motion of {} {AGREEMENT}{agreement:.2})", place.first.path));
    }
    let named = motion.is_polar
        || names_axes(&motion.first) == names_axes(&place.first)
        || (place.is_geodetic && names_axes(&motion.first));
    let same_names = named && !(place.is_geodetic && !names_axes(&motion.first) && !motion.is_polar);
    if same_names && plain.agreement >= best.agreement - SAME {
        return Ok(plain);
    }
    let west = windows.try_axes(false, [1.0, -1.0]);
    if same_names && !motion.is_polar && west.agreement >= best.agreement - SAME {
        return Ok(west);
    }
    if same_names {
        return Err(format!(
            "by name, {a} belongs to {} and {b} to {}, but the motion contradicts this {AGREEMENT}{:.2}; {} gives \
             {:.2})",
            place.first.path,
            place.second.path,
            plain.agreement,
            described(best),
            best.agreement
        ));
    }
    let is_alone = all.get(1).is_none_or(|second| second.agreement < best.agreement - DECIDES);
    match (is_alone, best.signs[0] > 0.0) {
        (false, _) => Err(format!("the path is too straight to decide which of {a} and {b} goes north")),
        (true, false) => {
            let north = if best.swapped { b } else { a };
            Err(format!(
                "{north} is positive to the south, and a channel map knows only north: negate this column and try \
                 again"
            ))
        }
        (true, true) => Ok(best),
    }
}

fn described(found: Match) -> String {
    let order = if found.swapped { "exchanged axes" } else { "the same axes" };
    match found.signs {
        [n, e] if n > 0.0 && e > 0.0 => order.to_owned(),
        _ => format!("{order} with other signs"),
    }
}

/// The unit with the measured scale, if no other unit is nearly as close.
fn unit_of_speed(motion: Timed<'_, Velocity>, scale: f64) -> Result<Unit, String> {
    let (first, second) = (&motion.group.first, &motion.group.second);
    let distance = |unit: Unit| (scale * unit.to_si(1.0)).ln().abs();
    let stated = first.unit.or(second.unit.filter(|_| !motion.group.is_polar));
    if let Some(stated) = stated {
        if distance(stated) <= NEAR {
            return Ok(stated);
        }
        let times = scale * stated.to_si(1.0);
        return Err(format!(
            "{} is {times:.3} times as fast as the position moves, if it is in {stated} as stated",
            first.path
        ));
    }
    let certain = motion.timing.is_certain;
    let is_tried = |unit: &Unit| {
        let usual = ["m/s", "km/h", "kt", "ft/s", "mi/h"].contains(&unit.symbol());
        usual || certain && ["cm/s", "mm/s"].contains(&unit.symbol())
    };
    let mut tried: Vec<Unit> = Unit::all().filter(|u| u.dimension() == Dimension::Speed).filter(is_tried).collect();
    tried.sort_by(|a, b| distance(*a).total_cmp(&distance(*b)));
    match tried.as_slice() {
        [nearest, next, ..] if distance(*nearest) <= NEAR && 2.0 * distance(*nearest) <= distance(*next) => {
            Ok(*nearest)
        }
        _ => Err(format!(
            "{} is {scale:.3} times as fast as the position moves in m/s, which is not a known unit",
            first.path
        )),
    }
}

/// The positive direction of a vertical column by its name.
pub(super) fn side(named: &Named) -> Option<Vertical> {
    match named.role {
        Role::Height | Role::Velocity(Axis::Up) | Role::Position(Axis::Up) => Some(Vertical::Up),
        Role::Velocity(Axis::Down) | Role::Position(Axis::Down) => Some(Vertical::Down),
        _ => None,
    }
}

/// Units and signs of heights and vertical velocities, from the motion or else from the names; with the notices.
#[expect(clippy::type_complexity, reason = "two verticals and their notes")]
fn verticals(
    of: Timed<'_, Position>,
    motion: &Velocity,
    windows: &Windows,
    (angle, speed): (Unit, Unit),
) -> (Option<(Unit, Vertical)>, Option<(Unit, Vertical)>, Vec<String>) {
    let mut notes = vec![];
    let measured = windows.vertical().filter(|(agreement, _)| agreement.abs() >= LEAST_VERTICAL);
    let (height, third) = (of.group.third.as_ref(), motion.third.as_ref());
    let third_unit = third.map(|t| t.unit.unwrap_or(speed));
    let (height_unit, why) = match (height, third_unit.zip(third), measured) {
        (Some(h), Some((of_third, t)), Some((_, scale))) => measured_height(of.table, h, (t, of_third), scale, angle),
        (Some(h), ..) => plausible_height(of.table, h, angle),
        (None, ..) => (None, None),
    };
    notes.extend(why);
    // The direction of a `z` in an unknown frame follows from a vertical velocity with a named direction.
    let by_third = || Some((side(third?)? == Vertical::Up) == (measured?.0 > 0.0));
    let height_up = height.and_then(side).map(|side| side == Vertical::Up).or_else(by_third);
    let place_side = height.map(|_| match (height_unit, height_up) {
        (Some(_), Some(true)) => Vertical::Up,
        (Some(_), Some(false)) => Vertical::Down,
        _ => Vertical::LeftOut,
    });
    let (counts, note) = third.map(|t| direction(t, height.zip(height_up), measured)).unzip();
    notes.extend(note.flatten());
    let height = height_unit.or(unit("m")).zip(place_side);
    (height, third_unit.zip(counts), notes)
}

/// The positive direction of a vertical velocity: shown by a height with a known direction, otherwise by its name.
fn direction(
    third: &Named,
    height: Option<(&Named, bool)>,
    measured: Option<(f64, f64)>,
) -> (Vertical, Option<String>) {
    let path = &third.path;
    match (height.zip(measured), side(third)) {
        (Some(((height, height_up), (agreement, _))), by_name) => {
            let up = (agreement > 0.0) == height_up;
            let (shown, word) = if up { (Vertical::Up, "up") } else { (Vertical::Down, "down") };
            let differs = by_name.is_some_and(|named| named != shown);
            let note = || format!("{path} is positive {word}, as {} shows, against its name", height.path);
            (shown, differs.then(note))
        }
        (None, None) => {
            (Vertical::LeftOut, Some(format!("{path} is not used: it may be positive up or down; nothing shows which")))
        }
        (None, Some(named)) => (named, Some(format!("the sign of {path} is assumed from its name"))),
    }
}

/// The end of the reason for an assumed unit.
pub(super) const UNSHOWN: &str = "which nothing confirms";
/// Units in which heights are logged.
const OF_HEIGHTS: [&str; 4] = ["m", "ft", "mm", "cm"];
/// No flight table holds heights above this, m.
const HIGHEST_M: f64 = 20_000.0;
/// A height above this is not in feet: it would be above [`HIGHEST_M`].
const HIGHEST_FT: f64 = 65_600.0;

/// The unit of a height from the vertical velocity that was compared with it, with the notices. `scale` is velocity
/// over displacement as logged, with the height in SI units where its unit is stated.
fn measured_height(
    table: &Table,
    height: &Named,
    (third, of_third): (&Named, Unit),
    scale: f64,
    angle: Unit,
) -> (Option<Unit>, Option<String>) {
    let per_unit = |to_si: f64| scale * of_third.to_si(1.0) / to_si;
    if let Some(stated) = height.unit {
        // The comparison already has it in metres.
        let times = 1.0 / per_unit(1.0);
        let differs = times.ln().abs() > NEAR;
        return (
            Some(stated),
            differs.then(|| {
                format!(
                    "{} changes {times:.3} times as fast as {} gives, if it is in {stated} as stated",
                    height.path, third.path
                )
            }),
        );
    }
    let fits = |symbol: &&str| unit(symbol).filter(|u| per_unit(u.to_si(1.0)).ln().abs() < NEAR);
    match OF_HEIGHTS.iter().find_map(fits) {
        Some(found) if found.symbol() == "m" => (Some(found), None),
        Some(found) => {
            (Some(found), Some(format!("{} changes as {} gives if it is in {found}", height.path, third.path)))
        }
        None => {
            let (found, why) = plausible_height(table, height, angle);
            let times = 1.0 / per_unit(1.0);
            let odd =
                format!("{} changes {times:.3} times as fast as {} gives, if it is in m", height.path, third.path);
            (found, Some(why.map_or(odd.clone(), |why| format!("{odd}; {why}"))))
        }
    }
}

/// The unit of a height that nothing is compared with, by its size; `None` if that is ambiguous.
pub(super) fn plausible_height(table: &Table, height: &Named, angle: Unit) -> (Option<Unit>, Option<String>) {
    if let Some(stated) = height.unit {
        return (Some(stated), None);
    }
    let most = largest(table, height);
    let path = &height.path;
    if most <= HIGHEST_M {
        return (unit("m"), Some(format!("{path} is assumed to be in metres, {UNSHOWN}")));
    }
    if most > HIGHEST_FT && angle.symbol() == "1e-7 deg" && unit("mm").is_some_and(|mm| mm.to_si(most) <= HIGHEST_M) {
        let why = format!(
            "{path} is assumed to be in mm: it reaches {most:.0}, too high for metres, and the table uses 1e-7 deg"
        );
        return (unit("mm"), Some(why));
    }
    (None, Some(format!("{path} is not used: it reaches {most:.0}, too high for metres, and its unit is unknown")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_described_by_their_order_and_signs() {
        let of = |swapped, signs| described(Match { swapped, signs, scale: 1.0, agreement: 1.0 });
        assert_eq!(of(false, [1.0, 1.0]), "the same axes");
        assert_eq!(of(true, [1.0, 1.0]), "exchanged axes");
        for signs in [[1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]] {
            assert_eq!(of(false, signs), "the same axes with other signs");
        }
    }
}
