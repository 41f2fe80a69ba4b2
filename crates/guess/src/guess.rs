//! Guesses a channel map for a table that no map fits: from column names, their units, and whether the velocity agrees
//! with the motion of the position. A reading that the data contradict or cannot decide is rejected.

use crate::column_groups::{Position, TableColumns, Velocity, has_body, may_hold, names_axes, odd_unit, sources};
use crate::compare::{
    Motion, Place, Timed, Vertical, decide, is_contradiction, plausible_height, side, units_of_place, without_unit,
};
use crate::found::{Found, Guess};
use crate::names::{Named, Role};
use crate::time_columns::Timing;
use crate::write::GuessedChannels;
use crate::{body, by_motion, column_groups, compare, names, time_columns, write};
use flight::{Clock, Unit};
use formats::{FieldRequest, Log, Select, Selection, Table, TableHead, TopicInfo, ValueKind};
use std::collections::{BTreeMap, BTreeSet};

/// Part of the message for a table without a time column.
pub const NO_TIME: &str = "is a rising time";

/// The fields to read for a guess from tables with these headers; `None` if no name matches.
pub fn wanted(heads: &[TableHead]) -> Option<Wanted> {
    let named =
        |head: &TableHead| -> Vec<Named> { head.names.iter().filter_map(|path| names::named(head, path)).collect() };
    let all: Vec<(&TableHead, Vec<Named>)> = heads.iter().map(|head| (head, named(head))).collect();
    let lacks_time =
        |head: &TableHead, named: &[Named]| by_motion::may_be_tried(head) && column_groups::lacks_time(named);
    // An attitude alone is not a flight.
    let any = all.iter().any(|(head, named)| may_hold(named) || lacks_time(head, named));
    let tables = all.into_iter().filter_map(|(head, named)| match may_hold(&named) || has_body(&named) {
        true => Some((head.topic.clone(), requests(&named))),
        // Any column may be the time.
        false => lacks_time(head, &named).then(|| (head.topic.clone(), every_column(head))),
    });
    let tables: BTreeMap<String, Vec<FieldRequest>> = tables.collect();
    any.then_some(Wanted(tables))
}

/// Whether some column names indicate a position, and some a velocity.
pub fn may_hold_both(heads: &[TableHead]) -> bool {
    let of_all = |holds: fn(&[Named]) -> bool| {
        heads.iter().any(|head| {
            let named: Vec<Named> = head.names.iter().filter_map(|path| names::named(head, path)).collect();
            holds(&named)
        })
    };
    of_all(column_groups::has_position) && of_all(column_groups::has_velocity)
}

/// The fields to read for [`guess_by_motion`] from tables with meaningless names: every column.
pub fn wanted_by_motion(heads: &[TableHead]) -> Option<Wanted> {
    let tables = heads.iter().filter(|head| by_motion::may_be_tried(head));
    let tables: BTreeMap<String, Vec<FieldRequest>> = tables.map(|h| (h.topic.clone(), every_column(h))).collect();
    (!tables.is_empty()).then_some(Wanted(tables))
}

fn every_column(head: &TableHead) -> Vec<FieldRequest> {
    let all: Vec<Named> = head.names.iter().map(|path| Named::with_role(path, Role::Time)).collect();
    requests(&all)
}

/// Whether a table has no header.
pub fn any_headerless(heads: &[TableHead]) -> bool {
    heads.iter().any(by_motion::is_headerless)
}

/// Why tables whose names match nothing are not bound, and what to do about it.
pub fn why_nameless(heads: &[TableHead]) -> String {
    if let Some((topic, line)) = heads.iter().find_map(|head| Some((&head.topic, head.unused_names?))) {
        return format!(
            "line {line} of {topic} names the columns, and because of the line above it, it is not the header: delete \
             what is above line {line}"
        );
    }
    if any_headerless(heads) {
        return "the table has no header; `flightlag maps --suggest LOG` writes a channel map if its columns move \
            like a position and a velocity"
            .to_owned();
    }
    "no columns are named like a time and a position or a velocity; `flightlag maps --suggest LOG` writes a channel \
     map if the columns move like a position and a velocity. Otherwise name them in a map; `flightlag maps \
     --example` is a start"
        .to_owned()
}

/// The fields of a guess by topic.
pub struct Wanted(BTreeMap<String, Vec<FieldRequest>>);

impl Select for Wanted {
    fn select(&self, topic: &TopicInfo) -> Selection {
        self.0.get(&topic.name).map_or(Selection::Skip, |fields| Selection::Fields(fields.clone()))
    }
}

fn requests(named: &[Named]) -> Vec<FieldRequest> {
    let ask = |column: &Named, kind| FieldRequest { path: column.path.clone(), kind };
    // The digits of a time matter.
    let times = named.iter().filter(|c| c.role == Role::Time).map(|c| ask(c, ValueKind::Text));
    let mut all: Vec<FieldRequest> = named.iter().map(|c| ask(c, ValueKind::Number)).chain(times).collect();
    all.sort();
    all.dedup();
    all
}

/// Guesses the map for the tables of a log that was read with [`wanted`].
///
/// # Errors
/// Why nothing is bound.
pub fn guess(log: &Log) -> Result<Guess, String> {
    let sources = sources(log);
    if let Some(odd) = odd_unit(&sources) {
        return Err(odd);
    }
    let mut reasons: Vec<String> = sources.iter().filter(|s| s.timings.is_empty()).map(without_time).collect();
    if sources.iter().all(|s| s.velocities.is_empty()) {
        reasons.extend(sources.iter().filter_map(|s| s.speed_alone.as_ref().map(without_course)));
    }
    let without_number: Vec<&str> = sources.iter().flat_map(|s| &s.without_number).map(String::as_str).collect();
    if sources.iter().all(|s| s.positions.is_empty()) && !without_number.is_empty() {
        let columns = without_number.join(" and ");
        reasons.push(format!(
            "{columns}: no cell is a plain number; write signed decimal degrees or metres without letters"
        ));
    }
    let (mut places, motions) = compare_all(&sources, &mut reasons);
    for (of, position) in sources.iter().flat_map(|s| s.positions.iter().map(move |p| (s, p))) {
        if !has_place(&places, &of.table.topic.name, &position.first) {
            match unchecked(of, position, &motions) {
                Ok(place) => places.push(place),
                // The reason may be given with the velocity already.
                Err(why) if reasons.iter().any(|given| given.ends_with(why.as_str())) => {}
                Err(why) => reasons.push(why),
            }
        }
    }
    // A position that contradicts a velocity of the same table is as uncertain as that velocity.
    let is_doubtful = motions.is_empty() && sources.iter().any(|source| !source.velocities.is_empty());
    if is_doubtful || places.is_empty() && motions.is_empty() {
        reasons.dedup();
        reasons.extend(times_apart(&sources));
        let timed = sources.iter().filter_map(|source| Some((source.table, source.timings.first()?)));
        reasons.extend(timed.filter_map(|(table, timing)| time_columns::goes_back(table, timing)));
        return Err(if reasons.is_empty() {
            "no column is named like a position or a velocity".into()
        } else {
            reasons.join("; ")
        });
    }
    if let Some(why) = of_other_starts(&places, &motions) {
        return Err(why);
    }
    reasons.extend(sources.iter().flat_map(|source| &source.lost_heights).cloned());
    Ok(with_bodies(&sources, places, motions, reasons, log.tables.len() > 1))
}

/// The times of a table whose columns were read with several.
fn times_apart(sources: &[TableColumns<'_>]) -> Option<String> {
    let is_same = |(one, next): &(&TableColumns<'_>, &TableColumns<'_>)| std::ptr::eq(one.table, next.table);
    let (one, next) = sources.iter().zip(sources.iter().skip(1)).find(is_same)?;
    let (one, next) = (one.timings.first()?, next.timings.first()?);
    Some(format!(
        "each column was read with the time next to it, {} or {}: if these are not one clock, split the table or state \
         the time of each channel in a channel map",
        one.label, next.label
    ))
}

/// The positions and velocities that agree, and velocities whose names are complete; `reasons` get the others.
fn compare_all<'l>(
    sources: &'l [TableColumns<'l>],
    reasons: &mut Vec<String>,
) -> (Vec<Found<'l, Place>>, Vec<Found<'l, Motion>>) {
    let (mut places, mut motions): (Vec<Found<'l, Place>>, Vec<Found<'l, Motion>>) = (vec![], vec![]);
    for (of, velocity) in sources.iter().flat_map(|s| s.velocities.iter().map(move |v| (s, v))) {
        match best_place(sources, of, velocity) {
            Ok(pairs) => pairs.into_iter().for_each(|(place, motion)| {
                if !has_place(&places, place.topic, &place.what.group.first) {
                    places.push(place);
                }
                let is_same = |known: &Found<'_, Motion>| {
                    known.topic == motion.topic && known.what.group.first.path == motion.what.group.first.path
                };
                if !motions.iter().any(is_same) {
                    motions.push(motion);
                }
            }),
            Err(why) => match by_names_alone(of, velocity) {
                Some(motion) => motions.push(motion),
                None => reasons.push(format!("{} and {}: {why}", velocity.first.path, velocity.second.path)),
            },
        }
    }
    (places, motions)
}

fn has_place(places: &[Found<'_, Place>], topic: &str, first: &Named) -> bool {
    places.iter().any(|known| known.topic == topic && known.what.group.first.path == first.path)
}

/// Maximum number of reasons in a summary; the map has all.
const MOST_REASONS: usize = 4;

/// The map of positions and velocities, with the attitudes, rates and forces inferred from them.
fn with_bodies<'l>(
    sources: &'l [TableColumns<'l>],
    places: Vec<Found<'l, Place>>,
    motions: Vec<Found<'l, Motion>>,
    mut reasons: Vec<String>,
    several: bool,
) -> Guess {
    let of_places = places.iter().map(|place| (place.topic, &place.timing));
    let times: Vec<(&str, &Timing)> = motions.iter().map(|m| (m.topic, &m.timing)).chain(of_places).collect();
    let (mut bodies, unsure) = body::bodies(sources, &motions, &times);
    let other_starts = leave_out_of_other_starts(&mut bodies, &times);
    reasons.extend(unsure);
    let guess = write::map(&GuessedChannels { places, motions, bodies }, &reasons, several);
    let mut notes: Vec<String> = reasons.iter().take(MOST_REASONS).map(|why| format!("; not bound: {why}")).collect();
    let more = reasons.len().saturating_sub(MOST_REASONS);
    notes.extend((more > 0).then(|| format!("; {more} more reasons are in the suggested map")));
    // What makes every delay uncertain comes first.
    let first = other_starts.map_or(String::new(), |note| format!("{note}. "));
    Guess { summary: first + &guess.summary + &notes.concat(), ..guess }
}

/// Tables whose time begins at zero in their own first row. They may have started at different times.
struct OwnStarts<'t> {
    tables: BTreeSet<&'t str>,
    /// They last equally long, as if they had started together.
    last_equally: bool,
}

impl OwnStarts<'_> {
    fn is_doubtful(&self) -> bool {
        self.tables.len() > 1 && !self.last_equally
    }

    fn listed(&self) -> String {
        self.tables.iter().copied().collect::<Vec<_>>().join(" and ")
    }
}

fn own_starts<'t>(times: &[(&'t str, &Timing)]) -> OwnStarts<'t> {
    let own = |timing: &Timing| {
        let given = || timing.times_s.iter().copied().filter(|t| t.is_finite());
        let (first, second, last) = (given().next()?, given().nth(1)?, given().next_back()?);
        let step = second - first;
        (timing.clock == Clock::Elapsed && first.abs() <= step).then_some((last, step))
    };
    let all: Vec<(&str, (f64, f64))> = times.iter().filter_map(|(topic, t)| Some((*topic, own(t)?))).collect();
    let lasts = || all.iter().map(|(_, (last, _))| *last);
    let step = all.iter().map(|(_, (_, step))| *step).fold(0.0, f64::max);
    let apart = lasts().fold(f64::MIN, f64::max) - lasts().fold(f64::MAX, f64::min);
    OwnStarts { tables: all.into_iter().map(|(topic, _)| topic).collect(), last_equally: apart <= 2.0 * step }
}

/// Why a position and a velocity in tables that may have started at different times are not bound.
fn of_other_starts(places: &[Found<'_, Place>], motions: &[Found<'_, Motion>]) -> Option<String> {
    let of_places = places.iter().map(|place| (place.topic, &place.timing));
    let times: Vec<(&str, &Timing)> = of_places.chain(motions.iter().map(|m| (m.topic, &m.timing))).collect();
    let own = own_starts(&times);
    let is_one = places.iter().any(|place| motions.iter().any(|motion| motion.topic == place.topic));
    (own.is_doubtful() && !is_one).then(|| {
        format!(
            "the times of {} each start at the first row of their table, and the tables differ in length: it is \
             unknown when each started, so no delay between them can be measured; log them with one clock, or name their \
             columns in a channel map if they have one clock",
            own.listed()
        )
    })
}

/// Removes attitudes, rates and forces in another such table than the position and the velocity, if the tables differ in
/// length. Their delays would be wrong by the time between the starts. Returns the notice.
fn leave_out_of_other_starts(bodies: &mut Vec<Found<'_, body::Body>>, times: &[(&str, &Timing)]) -> Option<String> {
    let of_bodies = bodies.iter().map(|body| (body.topic, &body.timing));
    let all: Vec<(&str, &Timing)> = times.iter().copied().chain(of_bodies).collect();
    let own = own_starts(&all);
    if own.tables.len() < 2 {
        return None;
    }
    let start = format!("the times of {} each start at the first row of their table", own.listed());
    if own.last_equally {
        return Some(format!(
            "{start}. The tables have the same length and are taken to have started together: if they did not, each delay \
             between them is wrong by the difference"
        ));
    }
    bodies.retain(|body| !own.tables.contains(body.topic) || times.iter().any(|(topic, _)| *topic == body.topic));
    Some(format!(
        "{start}, and it is unknown whether these started together: no delay between these tables is certain; log them \
         with one clock"
    ))
}

/// The map for a table without a header or with a meaningless one: the two pairs of neighbours that agree best, if they
/// agree very well.
pub fn guess_by_motion<'l>(log: &'l Log) -> Result<Guess, String> {
    const LEAST: f64 = 0.97;
    /// Agreements within this are equal: the usual order of axes then decides.
    const SAME: f64 = 0.005;
    let of_table =
        |table: &'l Table| log.head(&table.topic.name).map_or(vec![], |head| by_motion::sources(head, table));
    let all: Vec<TableColumns<'l>> = log.tables.iter().flat_map(of_table).collect();
    let mut pairs = vec![];
    for source in &all {
        let one = std::slice::from_ref(source);
        pairs.extend(source.velocities.iter().filter_map(|v| best_place(one, source, v).ok()).flatten());
    }
    let rank = |pair: &Pair<'_>| {
        let Motion { agreement, swapped, is_west, .. } = pair.1.what;
        ((agreement / SAME).round() as i64, !swapped, !is_west)
    };
    let best = pairs.into_iter().max_by_key(rank);
    let Some((mut place, mut motion)) = best.filter(|(_, motion)| motion.what.agreement >= LEAST) else {
        let what = match log.heads.iter().all(by_motion::is_headerless) {
            true => "the table has no header",
            false => "no columns are named like a time and a position or a velocity",
        };
        return Err(format!(
            "{what}, and no two neighbouring columns move according to two others; name the columns in a channel \
             map; `flightlag maps --example` is a start"
        ));
    };
    // A neighbour is a height only if a vertical velocity proves it.
    place.what.third =
        place.what.third.filter(|_| motion.what.third.is_some_and(|(_, side)| side != Vertical::LeftOut));
    if place.what.third.is_none() {
        motion.what.why.retain(|why| !why.ends_with(compare::UNSHOWN));
    }
    Ok(write::map(&GuessedChannels { places: vec![place], motions: vec![motion], bodies: vec![] }, &[], true))
}

/// The reason for a table without a time.
fn without_time(source: &TableColumns<'_>) -> String {
    let of_positions = source.positions.iter().flat_map(|p| [&p.first.path, &p.second.path]);
    let all: Vec<&str> = of_positions
        .chain(source.velocities.iter().flat_map(|v| [&v.first.path, &v.second.path]))
        .map(String::as_str)
        .collect();
    let known = if all.is_empty() { String::new() } else { format!("{} are recognised, but ", all.join(", ")) };
    match &source.unread_time {
        Some(why) => format!("{known}{why}"),
        None => format!("{known}no column of {} {NO_TIME}", source.table.topic.name),
    }
}

/// Why a speed without a course is no velocity, and what to do about it.
fn without_course((speed, heading): &(String, Option<String>)) -> String {
    match heading {
        None => format!("{speed}: a speed without a course over ground gives no direction"),
        Some(heading) => format!(
            "{speed} and {heading}: {heading} may be where the nose points; if it is the course over ground, call the \
             column course or write a channel map with speed and track"
        ),
    }
}

type Pair<'l> = (Found<'l, Place>, Found<'l, Motion>);

/// The positions that a velocity agrees with, and the velocity as each shows it. Those of the same table and source
/// come first.
fn best_place<'l>(
    sources: &'l [TableColumns<'l>],
    of: &'l TableColumns<'l>,
    velocity: &Velocity,
) -> Result<Vec<Pair<'l>>, String> {
    let mut order: Vec<(&TableColumns<'_>, &Position)> =
        sources.iter().flat_map(|s| s.positions.iter().map(move |p| (s, p))).collect();
    order.sort_by_key(|(s, p)| (!std::ptr::eq(*s, of), !p.is_geodetic, p.source != velocity.source));
    let mut why_not = "there is no position to compare them with".to_owned();
    let mut contradicts = false;
    let mut pairs: Vec<Pair<'l>> = vec![];
    for (source, position) in order {
        match with_times(source, position, of, velocity) {
            Ok(mut pair) => {
                // The latitude and longitude found before show where the axes of this position point.
                if let (Some((known, shown)), (place, own)) = (pairs.first(), &mut pair)
                    && known.what.group.is_geodetic
                    && !place.what.group.is_geodetic
                    && !names_axes(&place.what.group.first)
                {
                    place.what.swapped = own.what.swapped != shown.what.swapped;
                    place.what.is_west = own.what.is_west != shown.what.is_west;
                }
                let agrees = pairs.first().is_none_or(|(_, known)| {
                    known.what.unit == pair.1.what.unit && known.timing.entry == pair.1.timing.entry
                });
                pairs.extend(Some(pair).filter(|_| agrees));
            }
            Err(why) if pairs.is_empty() => {
                contradicts |= position.is_geodetic && is_contradiction(&why);
                why_not = why;
            }
            Err(_) => {}
        }
    }
    // Axes that agree only with a position of unnamed axes, and not with a latitude and longitude, may point anywhere.
    let only_local =
        pairs.iter().all(|(place, _)| !place.what.group.is_geodetic && !names_axes(&place.what.group.first));
    if pairs.is_empty() || contradicts && only_local { Err(why_not) } else { Ok(pairs) }
}

/// Why two tables have no common time.
fn no_common_time(source: &TableColumns<'_>, of: &TableColumns<'_>) -> String {
    match (of.timings.first(), source.timings.first()) {
        (Some(own), Some(other)) if own.clock != other.clock => format!(
            "the times of {} and {} use different clocks: {} and {}",
            of.table.topic.name, source.table.topic.name, own.clock, other.clock
        ),
        (own, _) => {
            let lacking = if own.is_none() { of } else { source };
            match lacking.unread_time {
                Some(_) => format!("the time of {} cannot be read", lacking.table.topic.name),
                None => format!("no column of {} {NO_TIME}", lacking.table.topic.name),
            }
        }
    }
}

/// Tries all readings of the time; exactly one must fit.
fn with_times<'l>(
    source: &'l TableColumns<'l>,
    position: &Position,
    of: &'l TableColumns<'l>,
    velocity: &Velocity,
) -> Result<Pair<'l>, String> {
    let mut fits: Vec<Pair<'l>> = vec![];
    let mut why_not = no_common_time(source, of);
    let is_own = std::ptr::eq(source, of);
    for timing in &of.timings {
        let is_same = |other: &&Timing| if is_own { other.entry == timing.entry } else { other.clock == timing.clock };
        for other in source.timings.iter().filter(is_same) {
            let place = Timed { table: source.table, timing: other, group: position };
            match decide(place, Timed { table: of.table, timing, group: velocity }) {
                Ok((place, motion)) => fits.push((Found::of(source, other, place), Found::of(of, timing, motion))),
                Err(why) => why_not = why,
            }
        }
    }
    match fits.len() {
        0 => Err(why_not),
        1 => fits.pop().ok_or(why_not),
        _ => {
            let entries: Vec<String> = fits.iter().map(|(_, motion)| motion.timing.entry.clone()).collect();
            Err(format!("the time may be {}: state its unit in the name of the column", entries.join(" or ")))
        }
    }
}

/// A velocity that no position agrees with, if its names are complete.
fn by_names_alone<'l>(of: &'l TableColumns<'l>, group: &Velocity) -> Option<Found<'l, Motion>> {
    let timing = of.timings.first().filter(|timing| timing.is_certain)?;
    let unit = group.first.unit?;
    // Where a position exists and contradicts them, names alone are not trusted.
    if !of.positions.is_empty() || group.is_polar || !names_axes(&group.first) {
        return None;
    }
    let third = group.third.as_ref().and_then(|third| Some((third.unit?, side(third)?)));
    let why = vec!["by names and stated units only: there is no position to compare it with".to_owned()];
    let what =
        Motion { group: group.clone(), unit, angle: None, third, swapped: false, is_west: false, agreement: 0.0, why };
    Some(Found::of(of, timing, what))
}

/// A position that no velocity was compared with, if its range or its names are conclusive.
fn unchecked<'l>(
    of: &'l TableColumns<'l>,
    group: &Position,
    motions: &[Found<'_, Motion>],
) -> Result<Found<'l, Place>, String> {
    let path = &group.first.path;
    if !group.source.split('-').all(|word| word.is_empty() || names::SOURCES.contains(&word)) {
        return Err(format!("{path}: no velocity fits its motion, and by its name it is not a plain position"));
    }
    let is_own = |timing: &Timing| of.timings.iter().any(|own| own.entry == timing.entry);
    let same = motions.iter().find(|motion| motion.topic == of.table.topic.name && is_own(&motion.timing));
    let same = same.map(|motion| &motion.timing);
    let Some(timing) = same.or(of.timings.first().filter(|timing| timing.is_certain)) else {
        return Err(format!("{path}: the unit or clock of the time of its table is unknown"));
    };
    let units: Vec<(Unit, String)> = units_of_place(of.table, group);
    let (unit, why) = match units.as_slice() {
        [one] => one,
        [] => return Err(without_unit(of.table, group)),
        _ => return Err(format!("{path}: may be in degrees or radians; nothing shows which")),
    };
    if !group.is_geodetic && (group.first.unit.is_none() || !names_axes(&group.first)) {
        return Err(format!(
            "{path}: its unit and direction are unknown; state them in a channel map, see `flightlag maps --example`"
        ));
    }
    let mut why = vec![why.clone(), "no velocity was found that fits its motion".to_owned()];
    let third = group.third.as_ref().and_then(|third| unchecked_height(of.table, third, *unit, &mut why));
    let what = Place { group: group.clone(), unit: *unit, third, swapped: false, is_west: false, why };
    Ok(Found::of(of, timing, what))
}

/// The unit and the sign of a height that nothing was compared with; `why` gets the assumptions.
fn unchecked_height(table: &Table, height: &Named, angle: Unit, why: &mut Vec<String>) -> Option<(Unit, Vertical)> {
    let (found, summary) = plausible_height(table, height, angle);
    why.extend(summary);
    let side = side(height)?;
    Some((found.or("m".parse().ok())?, if found.is_some() { side } else { Vertical::LeftOut }))
}
