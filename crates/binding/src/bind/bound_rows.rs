//! Turns the rows of a table into the samples of a channel, and reports which rows are unused and why.

use super::attitude::{from_euler, from_quaternion, rotate};
use super::conditions::failed;
use super::ecef;
use super::order::{self, FAR_NS, Reason, Samples, Unstamped};
use super::plan::{Found, Plan};
use super::stamp_columns::Stamps;
use crate::filler::is_all_nines;
use crate::map::{ChannelRule, Combine, Part, Presence};
use flight::{
    Channel, ChannelHealth, ChannelSource, Code, Dimension, Graded, Held, NANOS_PER_SECOND, Notices, Quantity,
    RejectCount, Series, Severity, Stamp, StampHealth, StampKind, StampOffset, Timeline,
};
use formats::stamps::{StampStats, distribution};
use formats::time::suspicion;
use map_file::HeightAbove;
use std::collections::HashMap;

/// With fewer runs than this, holding is not inferred.
const FEWEST_RUNS: usize = 3;

/// A channel with its health and its notices.
pub(super) struct Bound {
    /// `None` if no row could be used.
    pub(super) channel: Option<Channel>,
    pub(super) health: ChannelHealth,
    /// Kinds of timestamp that are more than a day apart.
    pub(super) apart: Vec<StampOffset>,
    /// The resolution of timestamps that several rows share.
    pub(super) coarse_s: Option<f64>,
    /// The longest step back of its timestamps, in the order of the log, with the time between two rows.
    pub(super) back_s: Option<f64>,
    pub(super) notices: Notices,
}

fn step_back_s(stamps: &[i64], logged: &StampHealth) -> Option<f64> {
    let step_s = logged.steps_s.map(|steps| steps.median)?;
    let back_s = stamps.windows(2).map(|pair| -seconds_between(pair)).fold(0.0, f64::max);
    (back_s > 0.0).then_some(back_s + step_s)
}

/// Rows that are not used, by reason, in the order in which the reasons first occur.
#[derive(Default)]
struct Rejects(Vec<RejectCount>);

impl Rejects {
    fn add(&mut self, reason: &str, place: impl FnOnce() -> String) {
        match self.0.iter_mut().find(|r| r.reason == reason) {
            Some(known) => known.count += 1,
            None => self.0.push(RejectCount { reason: reason.to_owned(), count: 1, first: place() }),
        }
    }

    fn of(&self, reason: &str) -> u64 {
        self.0.iter().filter(|r| r.reason == reason).map(|r| r.count).sum()
    }

    fn total(&self) -> u64 {
        self.0.iter().map(|r| r.count).sum()
    }
}

/// What a channel is made from once its columns are no longer needed.
pub(super) struct Taken {
    samples: Unstamped,
    rejects: Rejects,
    /// Which columns were used.
    used: Vec<bool>,
    notices: Notices,
}

/// Takes the usable rows of a plan.
pub(super) fn take_rows(plan: &Plan<'_>) -> Taken {
    let mut notices = Notices::new();
    let mut rejects = Rejects::default();
    let columns = drop_thin_verticals(plan, &mut notices);
    // A plan without timestamps is never made; if it were, no row would have one.
    let samples = plan.stamps.first().map(|primary| usable_rows(plan, &columns, primary, &mut rejects));
    let used = columns.iter().map(Option::is_some).collect();
    Taken { samples: samples.unwrap_or_default(), rejects, used, notices }
}

/// Makes the channel of a plan from the rows taken.
pub(super) fn bind_rows(plan: &Plan<'_>, taken: Taken) -> Bound {
    let Taken { samples, mut rejects, used, mut notices } = taken;
    let columns = plan.columns.iter().zip(used).map(|(found, used)| found.as_ref().filter(|_| used));
    let columns: Vec<Option<&Found<'_>>> = columns.collect();
    let Some(primary) = plan.stamps.first() else { return unusable(plan, &columns, rejects, notices) };
    let mut samples = samples.stamped(|row| primary.nanos.get(row).unwrap_or_default());
    let (stamps, back_s) = put_in_order(plan, primary, &mut samples, &mut rejects);
    let coarse_s = coarse(&rejects, samples.stamps());
    assumptions(plan, &columns, &mut notices);
    report(plan, &rejects, samples.is_empty(), coarse_s.is_some(), &mut notices);
    let (held, held_health) = held_rows(&samples, compared(plan.rule.quantity, columns.len()));
    held_health.iter().for_each(|held| note_held(plan, held, &mut notices));
    let mut health = health_of(plan, &columns, rejects, samples.len());
    health.stamps = stamps;
    let (near, apart) = offsets(plan, &samples, &mut notices);
    health.offsets = near;
    health.held = held_health;
    let channel = channel_of(plan, primary, &columns, samples, held, coarse_s, &mut notices);
    Bound { channel, health, apart, coarse_s, back_s, notices }
}

/// Drops rows with timestamps far from the others and sorts the rest. Returns their health and their longest step back.
fn put_in_order(
    plan: &Plan<'_>,
    primary: &Stamps,
    samples: &mut Samples,
    rejects: &mut Rejects,
) -> (Option<StampHealth>, Option<f64>) {
    order::leave_out_far(samples, primary.clock, &mut |why, row| rejects.add(why.text(), || place(plan, row)));
    let as_logged = describe(primary, samples);
    let back = as_logged.as_ref().and_then(|logged| step_back_s(samples.stamps(), logged));
    order::sort(samples, &mut |why, row| rejects.add(why.text(), || place(plan, row)));
    (as_logged.map(|logged| as_used(logged, primary, samples)), back)
}

fn note_held(plan: &Plan<'_>, held: &Held, notices: &mut Notices) {
    let text = format!(
        "channel {} repeats held values: it updates every {:.3} s, usually with {} rows for each; the repeats are \
         not measurements",
        plan.rule.name, held.update_interval_s, held.modal_run
    );
    notices.push(Code::HeldRows, &plan.table.topic.name, held.repeats, text);
}

fn describe(stamps: &Stamps, samples: &Samples) -> Option<StampHealth> {
    StampStats::from_slice(stamps.kind, stamps.clock, &stamps.label, samples.stamps())
}

/// Where timestamps go back, the order of the log hides holes. Rate, steps and gaps then describe the sorted rows, and
/// only jumps and repeats describe the log.
fn as_used(logged: StampHealth, primary: &Stamps, sorted: &Samples) -> StampHealth {
    let (duplicates, back_jumps) = (logged.duplicates, logged.back_jumps);
    match (back_jumps > 0).then(|| describe(primary, sorted)).flatten() {
        Some(used) => StampHealth { duplicates, back_jumps, ..used },
        None => logged,
    }
}

fn unusable(plan: &Plan<'_>, columns: &[Option<&Found<'_>>], rejects: Rejects, notices: Notices) -> Bound {
    Bound {
        channel: None,
        health: health_of(plan, columns, rejects, 0),
        apart: vec![],
        coarse_s: None,
        back_s: None,
        notices,
    }
}

/// A height or vertical speed that most rows lack is dropped as a whole, so that no rows are lost for it.
fn drop_thin_verticals<'p>(plan: &'p Plan<'_>, notices: &mut Notices) -> Vec<Option<&'p Found<'p>>> {
    let rows_with_others = |row: usize| {
        let needed = |part: &Part| !matches!(part.presence, Presence::Vertical | Presence::Direction);
        let others = plan.columns.iter().zip(&plan.rule.parts).filter(|(_, part)| needed(part));
        others.filter_map(|(found, _)| found.as_ref()).all(|f| f.column.number(row).is_some())
    };
    let whole = (0..plan.table.rows).filter(|&row| rows_with_others(row)).count();
    let parts = plan.columns.iter().zip(&plan.rule.parts);
    parts
        .map(|(found, part)| {
            let found = found.as_ref()?;
            let is_value = |value: f64| !is_filler(found, part, value);
            let filled = |row: &usize| rows_with_others(*row) && found.column.number(*row).is_some_and(is_value);
            let thin = part.presence == Presence::Vertical && 2 * (0..plan.table.rows).filter(filled).count() < whole;
            if thin {
                let text = format!(
                    "channel {}: most rows have no {}; it is not used and counts as zero",
                    plan.rule.name, found.column.path
                );
                notices.push(Code::Assumption.at(Severity::Info), &plan.table.topic.name, whole as u64, text);
            }
            (!thin).then_some(found)
        })
        .collect()
}

fn usable_rows(plan: &Plan<'_>, columns: &[Option<&Found<'_>>], primary: &Stamps, rejects: &mut Rejects) -> Unstamped {
    let mut samples = Unstamped::new(plan.rule.quantity.components().len(), plan.table.rows);
    for row in 0..plan.table.rows {
        match sample_of(plan, columns, primary, row) {
            Ok(values) => samples.push(row, values),
            Err(reason) => rejects.add(&reason, || place(plan, row)),
        }
    }
    samples
}

fn place(plan: &Plan<'_>, row: usize) -> String {
    let what = if plan.table.topic.encoding == "csv" { "line" } else { "message" };
    format!("{what} {}", plan.table.origin_of(row))
}

fn sample_of(
    plan: &Plan<'_>,
    columns: &[Option<&Found<'_>>],
    primary: &Stamps,
    row: usize,
) -> Result<[f64; 4], String> {
    let parts = values_of(plan.rule, columns, row)?;
    primary.nanos.get(row).ok_or("no timestamp")?;
    if let Some(reason) = failed(&plan.conditions, row) {
        return Err(reason);
    }
    let values = combine(plan.rule.combine, &parts)?;
    if values.iter().any(|v| !v.is_finite()) {
        return Err("value exceeds the range of a double".into());
    }
    match plan.rule.quantity {
        Quantity::PositionGeodetic => plausible(values)?,
        Quantity::VelocityNed => possible(values)?,
        _ => {}
    }
    Ok(values)
}

/// The parts of a row in SI units, zero where the log has no such field.
fn values_of(rule: &ChannelRule, columns: &[Option<&Found<'_>>], row: usize) -> Result<Vec<f64>, String> {
    let cells = || columns.iter().flatten().map(|f| f.column.number(row));
    if cells().all(|c| c.is_none()) {
        return Err("no value".into());
    }
    let mut values = Vec::with_capacity(columns.len());
    for (found, part) in columns.iter().zip(&rule.parts) {
        let Some((found, value)) = found.and_then(|found| Some((found, found.column.number(row)?))) else {
            values.push(instead(part, *found, &values)?);
            continue;
        };
        if !value.is_finite() {
            return Err(format!("{} is not finite", found.column.path));
        }
        if is_filler(found, part, value) {
            return Err(format!("{} is {value}, which stands for a missing value", found.column.path));
        }
        let si = found.unit.to_si(value);
        values.push(if part.opposite { -si } else { si });
    }
    Ok(values)
}

/// Whether a speed or a height is nothing but nines and far from what is flown.
fn is_filler(found: &Found<'_>, part: &Part, value: f64) -> bool {
    /// In m/s and in m: nines in other units, such as 9999 mm/s, may be measured.
    const FAR: f64 = 300.0;
    let si = found.unit.to_si(value);
    let is_far = match found.unit.dimension() {
        Dimension::Speed => si.abs() > FAR,
        Dimension::Length => part.role == "height" && si < -FAR,
        _ => false,
    };
    is_far && is_all_nines(value)
}

/// The substitute for a part that a row lacks, computed from the parts before it; fails if there is none.
fn instead(part: &Part, found: Option<&Found<'_>>, before: &[f64]) -> Result<f64, String> {
    match (part.presence, found, before.first()) {
        (Presence::Direction, _, Some(0.0)) => Ok(0.0),
        (Presence::Direction, ..) => Err(format!("{} is missing, and the speed is not zero", part.role)),
        (_, Some(found), _) => Err(format!("{} is missing", found.column.path)),
        (_, None, _) => Ok(0.0),
    }
}

/// The components of a channel from the parts; see [`Combine`].
fn combine(how: Combine, parts: &[f64]) -> Result<[f64; 4], String> {
    Ok(match (how, parts) {
        (Combine::Polar, &[speed, track, down]) => [speed * track.cos(), speed * track.sin(), down, 0.0],
        (Combine::MagneticPolar, &[speed, track, variation, down]) => {
            let (sin, cos) = (track + variation).sin_cos();
            [speed * cos, speed * sin, down, 0.0]
        }
        (Combine::EcefPlace, &[x, y, z]) => {
            let place = ecef::place([x, y, z])?;
            [place.latitude, place.longitude, place.height, 0.0]
        }
        (Combine::EcefVelocity, &[x, y, z, at_x, at_y, at_z]) => {
            let [north, east, down] = ecef::to_ned(ecef::place([at_x, at_y, at_z])?, [x, y, z]);
            [north, east, down, 0.0]
        }
        (Combine::Body, &[forward, left, up, x, y, z, w]) => {
            let turned = rotate([x, y, z, w], [forward, left, up]);
            // Drivers without orientation leave the field all zero.
            let [east, north, up] = turned.ok_or(NO_ORIENTATION)?;
            [north, east, -up, 0.0]
        }
        (Combine::Quaternion(frame), &[w, x, y, z]) => from_quaternion(frame, [w, x, y, z]).ok_or(NO_ORIENTATION)?,
        (Combine::Euler(frame), &[roll, pitch, yaw]) => from_euler(frame, [roll, pitch, yaw]),
        (_, parts) => [0, 1, 2, 3].map(|i| parts.get(i).copied().unwrap_or(0.0)),
    })
}

const NO_ORIENTATION: &str = "the orientation is zero or too large to normalise";

fn plausible([latitude, longitude, height, _]: [f64; 4]) -> Result<(), String> {
    use std::f64::consts::{FRAC_PI_2, PI};
    // The last digit of a degree may round just past the pole or the antimeridian.
    const SLACK: f64 = 1e-9;
    if latitude.abs() > FRAC_PI_2 + SLACK || longitude.abs() > 2.0 * PI + SLACK {
        return Err("latitude or longitude out of range".into());
    }
    if latitude == 0.0 && longitude == 0.0 {
        return Err("latitude and longitude are zero: no fix".into());
    }
    if height.abs() > 1e6 { Err("height out of range".into()) } else { Ok(()) }
}

/// Nothing that stays near the Earth is faster than it takes to leave it.
fn possible([north, east, down, _]: [f64; 4]) -> Result<(), String> {
    const ESCAPE_M_PER_S: f64 = 12_000.0;
    let speed = north.hypot(east).hypot(down);
    if speed > ESCAPE_M_PER_S { Err("velocity out of range: above 12 km/s".into()) } else { Ok(()) }
}

/// One row in this many that shares its timestamp with another value is one too many.
const SHARED_BY: u64 = 4;

/// The resolution of a clock that gives one timestamp to several rows, such as one of whole seconds, or of a logger
/// that writes its rows in blocks, s.
fn coarse(rejects: &Rejects, sorted: &[i64]) -> Option<f64> {
    let shared = rejects.of(Reason::Shared.text());
    let all = shared + sorted.len() as u64;
    let steps = || sorted.windows(2).map(seconds_between).collect::<Vec<f64>>();
    (shared > FEW_ROWS && SHARED_BY * shared >= all).then(|| distribution(&steps()))?.map(|steps| steps.median)
}

fn seconds_between(pair: &[i64]) -> f64 {
    match pair {
        [a, b] => Stamp(*b).seconds_since(Stamp(*a)),
        _ => f64::NAN,
    }
}

/// One row in this many dropped only for its clock is a loss, if it is more than a few.
const LOST_BY_CLOCK: u64 = 10;
const FEW_ROWS: u64 = 5;

/// For a channel without usable rows [`no_rows`](super::no_rows) gives the reason, and for coarse timestamps
/// [`note_coarse`](super::stamp_notices::note_coarse).
fn report(plan: &Plan<'_>, rejects: &Rejects, unusable: bool, is_coarse: bool, notices: &mut Notices) {
    let is_listed = |reject: &&RejectCount| !(unusable || is_coarse && reject.reason == Reason::Shared.text());
    for reject in rejects.0.iter().filter(is_listed) {
        let duplicate = order::is_duplicate(&reject.reason);
        let many = reject.count > FEW_ROWS && LOST_BY_CLOCK * reject.count >= plan.table.rows as u64;
        let lost = many && order::is_of_clock(&reject.reason);
        let severity = match reject.reason.as_str() {
            "no value" => Severity::Info,
            _ if lost => Severity::Loss,
            _ => Severity::Warning,
        };
        let code = if duplicate { Code::DuplicateStamp } else { Code::RejectedRow };
        let place = format!("{}, {}", plan.table.topic.name, reject.first);
        let text = format!("channel {}: rows not used, {}", plan.rule.name, reject.reason);
        notices.push(code.at(severity), place, reject.count, text);
    }
}

/// Reports what the map assumes.
fn assumptions(plan: &Plan<'_>, columns: &[Option<&Found<'_>>], notices: &mut Notices) {
    let name = &plan.rule.name;
    let mut say = |what: Graded, text: &str| {
        notices.push(what, &plan.table.topic.name, plan.table.rows as u64, format!("channel {name}: {text}"));
    };
    let substitute = Code::Assumption.at(Severity::Info);
    if let Some(note) = &plan.rule.note {
        say(Code::Assumption.into(), note);
    }
    for (found, column) in columns.iter().flatten().filter_map(|found| Some((found, found.passed_over?))) {
        let text = format!("{} is zero in every row; {} is read instead", column.path, found.column.path);
        say(substitute, &text);
    }
    if columns.iter().flatten().any(|found| found.above == Some(HeightAbove::MeanSeaLevel)) {
        say(substitute, "the height above mean sea level is used as the height above the ellipsoid");
    }
    if plan.rule.combine == Combine::MagneticPolar {
        say(substitute, "the track is magnetic; true track = track + variation");
    }
    // A dropped column has its own notice.
    if columns.iter().flatten().count() == plan.columns.iter().flatten().count() {
        for (of, absent) in absent(plan, columns) {
            let who = if is_named(plan, of) { "the log has" } else { "the channel map reads" };
            say(substitute, &format!("{who} no {absent}; it counts as zero"));
        }
    }
}

/// Which components the log holds: those with a part of their own, if it was found; otherwise all, except a third
/// component that is height or down.
fn present(plan: &Plan<'_>, columns: &[Option<&Found<'_>>]) -> Vec<bool> {
    let found = |i: usize| columns.get(i).copied().flatten().is_some();
    let vertical = plan.rule.parts.iter().position(|p| p.presence == Presence::Vertical);
    let components = plan.rule.quantity.components().iter().enumerate();
    components
        .map(|(i, _)| if plan.rule.combine == Combine::AsIs { found(i) } else { i != 2 || vertical.is_none_or(found) })
        .collect()
}

/// Components without a column, by index and name.
fn absent(plan: &Plan<'_>, columns: &[Option<&Found<'_>>]) -> Vec<(usize, String)> {
    let components = plan.rule.quantity.components().iter().zip(present(plan, columns)).enumerate();
    components.filter(|(_, (_, present))| !present).map(|(of, (name, _))| (of, (*name).to_owned())).collect()
}

/// Whether the map has a field for a component.
fn is_named(plan: &Plan<'_>, component: usize) -> bool {
    let vertical = plan.rule.parts.iter().find(|part| part.presence == Presence::Vertical);
    vertical.or(plan.rule.parts.get(component)).is_none_or(|part| !part.fields.is_empty())
}

fn source_of(plan: &Plan<'_>, columns: &[Option<&Found<'_>>]) -> ChannelSource {
    ChannelSource {
        topic: plan.table.topic.name.clone(),
        type_name: plan.table.topic.type_name.clone(),
        fields: columns.iter().flatten().map(|f| format!("{} [{}]", f.column.path, f.unit)).collect(),
    }
}

fn health_of(plan: &Plan<'_>, columns: &[Option<&Found<'_>>], rejects: Rejects, used: usize) -> ChannelHealth {
    debug_assert_eq!(used as u64 + rejects.total(), plan.table.rows as u64, "rows without a fate");
    ChannelHealth {
        name: plan.rule.name.clone(),
        quantity: plan.rule.quantity,
        source: source_of(plan, columns),
        absent: absent(plan, columns).into_iter().map(|(_, name)| name).collect(),
        rows: plan.table.rows as u64,
        used: used as u64,
        rejected: rejects.0,
        stamps: None,
        offsets: vec![],
        held: None,
    }
}

/// Differences between kinds of timestamp on the same rows: those whose clocks agree, and those more than a day apart.
/// Timestamps of a simulation that claim to be UTC are years away from those of the logger: such a difference is not a
/// delay.
fn offsets(plan: &Plan<'_>, samples: &Samples, notices: &mut Notices) -> (Vec<StampOffset>, Vec<StampOffset>) {
    let pairs = [
        (StampKind::Published, StampKind::Measured),
        (StampKind::Logged, StampKind::Measured),
        (StampKind::Logged, StampKind::Published),
    ];
    let offsets: Vec<StampOffset> = pairs.into_iter().filter_map(|pair| offset(plan, samples, pair)).collect();
    for o in &offsets {
        if let Some(what) = first_unix(plan, samples).and_then(|at| suspicion(&o.offset_s, at)) {
            let text = format!("channel {}, {} and {} timestamps: {what}", plan.rule.name, o.of, o.against);
            notices.push(Code::ClockSuspect, &plan.table.topic.name, samples.len() as u64, text);
        }
    }
    let far_s = FAR_NS as f64 / NANOS_PER_SECOND as f64;
    offsets.into_iter().partition(|o| o.offset_s.median.abs() <= far_s)
}

/// The time of the first sample, from any of its timestamps with a known date.
fn first_unix(plan: &Plan<'_>, samples: &Samples) -> Option<Stamp> {
    let row = samples.rows().next()?;
    plan.stamps.iter().find_map(|s| s.clock.unix(Stamp(s.nanos.get(row)?)))
}

fn offset(plan: &Plan<'_>, samples: &Samples, (of, against): (StampKind, StampKind)) -> Option<StampOffset> {
    let of_kind = |kind| plan.stamps.iter().find(|s| s.kind == kind);
    let (later, earlier) = (of_kind(of)?, of_kind(against)?);
    // GPS time and UTC are compared as UTC; clocks with an unknown epoch only with their own kind.
    let on_axis = |stamps: &Stamps, row: usize| {
        let stamp = Stamp(stamps.nanos.get(row)?);
        if later.clock == earlier.clock { Some(stamp) } else { stamps.clock.unix(stamp) }
    };
    let on_row = |row: usize| Some(on_axis(later, row)?.seconds_since(on_axis(earlier, row)?));
    let differences: Vec<f64> = samples.rows().filter_map(on_row).collect();
    Some(StampOffset { of, against, offset_s: distribution(&differences)? })
}

/// How many components must be unchanged for a row to repeat the one before; `None` where an unchanged value is a
/// measurement, such as a bar at rest. The third component of a position or velocity does not count, because a height
/// may be updated separately.
fn compared(quantity: Quantity, parts: usize) -> Option<usize> {
    match quantity {
        Quantity::PositionGeodetic | Quantity::PositionNed | Quantity::VelocityNed | Quantity::Scalar => {
            Some(parts.min(2))
        }
        Quantity::EncoderCount | Quantity::EncoderAngle | Quantity::Pulse => None,
        Quantity::Height
        | Quantity::Attitude
        | Quantity::AngularRate
        | Quantity::SpecificForce
        | Quantity::MagneticField
        | Quantity::MagneticDirection => Some(quantity.components().len()),
    }
}

/// Which rows repeat the value before, if the stream is held: at least half of its values last for two rows or more, so
/// the most frequent run is two or longer (design note 3.8). Rounded values that repeat because the vehicle is slow are
/// measurements.
fn held_rows(samples: &Samples, compared: Option<usize>) -> (Vec<bool>, Option<Held>) {
    let Some(compared) = compared else { return (vec![false; samples.len()], None) };
    let mut repeats: Vec<bool> = (0..samples.len()).map(|i| i > 0 && samples.is_same(i - 1, i, compared)).collect();
    let updated = || repeats.iter().enumerate().filter(|(_, repeats)| !**repeats).map(|(i, _)| i);
    let modal_run = modal_run(updated(), samples.len());
    if updated().nth(FEWEST_RUNS - 1).is_none() || modal_run < 2 {
        repeats.fill(false);
        return (repeats, None);
    }
    let updates: Vec<usize> = updated().collect();
    let modal = updates.iter().zip(updates.iter().skip(1)).filter(|(from, to)| *to - *from == modal_run).count();
    let is_steady = 10 * modal >= 9 * updates.len().saturating_sub(1);
    if !is_steady && samples.is_rounded(&updates, compared) {
        repeats.fill(false);
        return (repeats, None);
    }
    let stamp = |i: &usize| samples.stamps().get(*i).copied().unwrap_or_default();
    let steps: Vec<f64> = updates
        .windows(2)
        .filter_map(|pair| <&[usize; 2]>::try_from(pair).ok())
        .map(|[a, b]| Stamp(stamp(b)).seconds_since(Stamp(stamp(a))))
        .collect();
    let health = Held {
        repeats: (samples.len() - updates.len()) as u64,
        modal_run: modal_run as u64,
        update_interval_s: distribution(&steps).map_or(0.0, |d| d.median),
    };
    (repeats, Some(health))
}

/// The most frequent number of rows between updates; the shorter if two are equally frequent.
fn modal_run(updates: impl Iterator<Item = usize> + Clone, rows: usize) -> usize {
    let mut tally: HashMap<usize, usize> = HashMap::new();
    let ends = updates.clone().skip(1).chain([rows]);
    for (start, end) in updates.zip(ends) {
        *tally.entry(end - start).or_default() += 1;
    }
    tally.into_iter().max_by_key(|&(run, count)| (count, std::cmp::Reverse(run))).map_or(0, |(run, _)| run)
}

fn channel_of(
    plan: &Plan<'_>,
    primary: &Stamps,
    columns: &[Option<&Found<'_>>],
    samples: Samples,
    held: Vec<bool>,
    coarse_s: Option<f64>,
    notices: &mut Notices,
) -> Option<Channel> {
    let rows = samples.len();
    // In the order in which notices are listed.
    let others = if samples.is_empty() { vec![] } else { other_stamps(plan, &samples, notices) };
    let (stamps, components) = samples.into_columns();
    let stamps = stamps.into_iter().map(Stamp).collect();
    let series = Timeline::new(primary.kind, primary.clock, stamps)
        .map(|timeline| timeline.with_shared_step(coarse_s.unwrap_or_default()))
        .and_then(|timeline| Series::new(timeline, components));
    match series {
        Ok(series) => (!series.is_empty()).then(|| Channel {
            quantity: plan.rule.quantity,
            series,
            present: present(plan, columns),
            other_stamps: others,
            held,
            source: source_of(plan, columns),
        }),
        // The rows were sorted and checked above; this reports it if they are still rejected.
        Err(error) => {
            let text = format!("channel {}: {error}", plan.rule.name);
            notices.push(Code::RejectedRow, &plan.table.topic.name, rows as u64, text);
            None
        }
    }
}

/// The other kinds of timestamp that every used row has.
fn other_stamps(
    plan: &Plan<'_>,
    samples: &Samples,
    notices: &mut Notices,
) -> Vec<(StampKind, flight::Clock, Vec<Stamp>)> {
    let mut others = vec![];
    for stamps in plan.stamps.iter().skip(1) {
        let on_rows: Option<Vec<Stamp>> = samples.rows().map(|row| stamps.nanos.get(row).map(Stamp)).collect();
        match on_rows {
            Some(values) => others.push((stamps.kind, stamps.clock, values)),
            None => {
                let text = format!(
                    "channel {}: some rows have no {} timestamp; this kind is not used",
                    plan.rule.name, stamps.kind
                );
                notices.push(Code::StampKind, &plan.table.topic.name, samples.len() as u64, text);
            }
        }
    }
    others
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_magnetic_track_turns_clockwise_by_an_easterly_variation() {
        let [north, east, ..] =
            combine(Combine::MagneticPolar, &[10.0, 80f64.to_radians(), 10f64.to_radians(), 0.0]).unwrap();
        assert!(north.abs() < 1e-12 && (east - 10.0).abs() < 1e-12);
    }

    #[test]
    fn a_body_that_heads_north_moves_north_when_it_moves_forward() {
        // Yaw of 90 deg from east, about up.
        let half = 45f64.to_radians();
        let [north, east, down, _] =
            combine(Combine::Body, &[15.0, 1.0, 2.0, 0.0, 0.0, half.sin(), half.cos()]).unwrap();
        assert!((north - 15.0).abs() < 1e-12 && (east + 1.0).abs() < 1e-12 && (down + 2.0).abs() < 1e-12);
    }

    #[test]
    fn a_body_velocity_without_orientation_is_rejected() {
        for length in [0.0, 1e-200, 1e200] {
            assert!(combine(Combine::Body, &[15.0, 0.0, 0.0, 0.0, 0.0, 0.0, length]).is_err());
        }
    }

    #[test]
    fn the_most_frequent_run_distinguishes_held_from_parked() {
        assert_eq!(modal_run([0, 2, 4, 7, 9].into_iter(), 11), 2);
        assert_eq!(modal_run([0, 500, 501, 502, 503].into_iter(), 504), 1);
        assert_eq!(modal_run([0, 1, 2, 4, 6].into_iter(), 8), 2);
        assert_eq!(modal_run([].into_iter(), 0), 0);
    }
}
