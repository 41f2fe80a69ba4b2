//! Binds columns to channels: which map fits, which rows count, and in which order.

mod attitude;
mod bound_rows;
mod clocks;
mod conditions;
mod counter_dates;
mod date_columns;
mod ecef;
mod indexed_plan;
mod missing_fields;
mod order;
mod plan;
mod receive_times;
mod repair;
mod restarts;
mod stamp_columns;
mod stamp_notices;
mod stated_units;
mod time_of_day;
mod times;
mod trial;
mod wraps;

pub use self::attitude::from_euler;
pub use self::times::{RowTimes, TableTimes, row_times};

use self::bound_rows::{bind_rows, take_rows};
use self::indexed_plan::IndexedPlan;
use self::plan::Plan;
use self::restarts::Joined;
use self::stamp_columns::{Tied, tie_of};
use self::trial::Trial;
use crate::error::IngestError;
use crate::map::{BENCH_ALONE, ChannelMap, MapLibrary, time_source_of};
use flight::{Binding, ChannelHealth, Clock, Code, Flight, MapCandidate, Notices, Severity, StampKind};
use formats::{Log, Table, Values};
use std::collections::BTreeSet;
use std::rc::Rc;

/// Finds the channel map that fits `log` and makes its flight from the log's columns, which are consumed. The notices
/// of the log come first.
///
/// A map fits if it binds a position, a velocity, an encoder, or another bench quantity, with data.
/// If several fit, the better one wins. The criteria, in order: position and velocity before only one of them before
/// neither, an encoder before no encoder, topics matched by name before topics matched by type before columns of any
/// table, the number of channels (those of a flight first), exact topic names before topics below a namespace. `forced`
/// names the map instead.
///
/// # Errors
/// [`IngestError::Map`] if no map fits, with what is missing; if two fit equally, with both names; or if there is no
/// map `forced`. [`IngestError::MapLacks`] if the best map is the user's and names fields that the log lacks, with the
/// nearest names, or nearly fits.
pub fn bind(log: &mut Log, library: &MapLibrary, forced: Option<&str>) -> Result<(Flight, Binding), IngestError> {
    let chosen = choose(log, library, forced);
    let made = chosen.map(|chosen| make(chosen, log));
    log.tables.clear();
    made
}

/// A channel map with its plans for a log, and everything that needs to be read from the log only once.
struct Chosen<'m> {
    map: &'m ChannelMap,
    plans: Vec<IndexedPlan>,
    /// The notices about units, for each plan.
    units: Vec<Notices>,
    /// The notices of the log and of the plans.
    notices: Notices,
    joined: Option<Joined>,
    tied: Option<Tied>,
    why: String,
    others: Vec<MapCandidate>,
}

fn choose<'m>(log: &Log, library: &'m MapLibrary, forced: Option<&str>) -> Result<Chosen<'m>, IngestError> {
    let maps = library.candidates(forced)?;
    let mut trials = Trial::of_all(&maps, log);
    trials.sort_by_key(|t| std::cmp::Reverse(t.rank()));
    check_best(&trials, log)?;
    let mut best = trials.remove(0);
    wraps::align(best.plans.iter_mut().flat_map(|plan| &mut plan.stamps));
    let joined = on_one_clock(&mut best, log);
    let others = trials.iter().filter(|t| !t.plans.is_empty()).map(|t| candidate(t, &best)).collect();
    let why = if forced.is_some() { "asked for by name".to_owned() } else { best.why(best.plans.len()) };
    let tied = if joined.is_none() { tie_of(&best.map.ties, log) } else { None };
    let notices = notices_of(&best, log);
    let of_units = |plan: &Plan<'_>| {
        let mut of_plan = Notices::new();
        stated_units::compare(plan, &log.units, &mut of_plan);
        of_plan
    };
    let units = best.plans.iter().map(of_units).collect();
    let Some(map) = maps.into_iter().find(|map| std::ptr::eq(*map, best.map)) else {
        return Err(nothing_fits(&[best], log));
    };
    let plans = best.plans.into_iter().map(|plan| IndexedPlan::of(plan, map, log)).collect();
    Ok(Chosen { map, plans, units, notices, joined, tied, why, others })
}

/// Rejects trials whose first does not fit, is no better than the second, or lacks what the user's map names.
fn check_best(trials: &[Trial<'_>], log: &Log) -> Result<(), IngestError> {
    let Some(best) = trials.first().filter(|t| t.fits()) else { return Err(nothing_fits(trials, log)) };
    let equals: Vec<&str> = trials.iter().filter(|t| t.rank() == best.rank()).map(|t| t.map.name.as_str()).collect();
    if equals.len() > 1 {
        let names = equals.join(" and ");
        return Err(IngestError::Map(format!("the channel maps {names} fit equally well; choose one with --map")));
    }
    missing_fields::check(best, log).map_err(IngestError::MapLacks)
}

/// Moves the timestamps of all sessions of a log onto the clock of the first; `None` if it has one session.
fn on_one_clock(best: &mut Trial<'_>, log: &Log) -> Option<Joined> {
    let joined = restarts::join(&best.plans, &best.map.ties, log)?;
    for plan in &mut best.plans {
        for stamps in &mut plan.stamps {
            Rc::make_mut(&mut stamps.nanos).change(|nanos| joined.shift(plan.table, stamps.clock, nanos));
        }
    }
    Some(joined)
}

/// The notices to report before any channel is made.
fn notices_of(best: &Trial<'_>, log: &Log) -> Notices {
    let mut notices = log.notices.clone();
    for (name, remark) in &best.unknown {
        let text = format!("channel {name} is not bound: the log states {remark}, which the channel map does not know");
        notices.push(Code::UnknownWord, "", 1, text);
    }
    for equals in &best.equals {
        let advice = "; name the topic in a channel map to choose";
        notices.push(Code::SeveralSources.at(Severity::Warning), "", 1, equals.in_words() + advice);
    }
    stamp_notices::note_stamps(&best.plans, &mut notices);
    notices
}

/// The clock and the timestamps, ns, that a source gives to the rows of a table. The source is written as in a map,
/// `{ field = "t", unit = "s", clock = "boot" }`; `None` if it is no source, or the table lacks its fields.
pub fn stamps_by(source: &str, table: &Table) -> Option<(Clock, Values<i64>)> {
    let source = time_source_of(source)?;
    let stamps = stamp_columns::read_stamps(StampKind::Logged, &source, table, || None)?;
    Some((stamps.clock, Rc::unwrap_or_clone(stamps.nanos)))
}

fn make(chosen: Chosen<'_>, log: &mut Log) -> (Flight, Binding) {
    let Chosen { map, mut plans, units, notices, joined, tied, why, others } = chosen;
    let mut flight = Flight { notices, ..Flight::default() };
    let (mut channels, mut apart, mut coarse, mut back) = (vec![], vec![], vec![], None);
    indexed_plan::keep_columns_of(&plans, log);
    for of_units in units {
        let plan = plans.remove(0);
        let Some(bound) = plan.make(map, log, &plans, take_rows, bind_rows) else { continue };
        flight.notices.extend(bound.notices);
        flight.notices.extend(of_units);
        match bound.channel {
            Some(channel) => flight.insert(&bound.health.name, channel),
            None => no_rows(&bound.health, &mut flight.notices),
        }
        apart.extend(bound.apart.into_iter().map(|offset| (bound.health.clone(), offset)));
        coarse.extend(bound.coarse_s.map(|step_s| (bound.health.clone(), step_s)));
        back = back.into_iter().chain(bound.back_s).reduce(f64::max);
        channels.push(bound.health);
    }
    stamp_notices::note_apart(&apart, &mut flight.notices);
    stamp_notices::note_coarse(&coarse, &mut flight.notices);
    note_back_jumps(&channels, back, &mut flight.notices);
    channels.sort_by(|a, b| a.name.cmp(&b.name));
    date_clocks(&mut flight, joined, tied);
    (flight, Binding { map: map.name.clone(), why, others, channels })
}

/// Ties a clock of the flight to UTC, and compares its clocks.
fn date_clocks(flight: &mut Flight, joined: Option<Joined>, tied: Option<Tied>) {
    let tied = match joined {
        Some(joined) => {
            joined.report(&mut flight.notices);
            joined.into_tie()
        }
        None => tied,
    };
    let tied_by_gps = tied.as_ref().is_some_and(|t| t.from_gps);
    if let Some(tied) = tied {
        note_tie(&tied, &mut flight.notices);
        flight.utc = Some(tied.tie);
    }
    clocks::note_unknown_leaps(flight, tied_by_gps);
    clocks::compare(flight);
}

/// Reports how a clock is tied to UTC, and what was corrected or skipped for it.
fn note_tie(tied: &Tied, notices: &mut Notices) {
    let tie = &tied.tie;
    let text = format!(
        "the clock {} is dated by {}: {} pairs within {:.3} s; the timestamps of samples are unchanged",
        tie.clock,
        tie.source,
        tie.pairs,
        tie.spread_s.p99 - tie.spread_s.p01
    );
    notices.push(Code::UtcTie, "", tie.pairs, text);
    for repair in &tied.repairs {
        notices.push(repair.what, &tie.source, repair.count, &*repair.text);
    }
    if tie.outliers > 0 {
        let text = "messages that date the clock differ from the others by more than a second and are not used";
        notices.push(Code::UtcTie.at(Severity::Warning), &tie.source, tie.outliers, text);
    }
}

/// One notice for all channels whose timestamps go back; the number of jumps of each is in its health.
fn note_back_jumps(channels: &[ChannelHealth], longest_s: Option<f64>, notices: &mut Notices) {
    let jumps = |c: &ChannelHealth| c.stamps.as_ref().map_or(0, |s| s.back_jumps);
    let back: Vec<&ChannelHealth> = channels.iter().filter(|c| jumps(c) > 0).collect();
    let Some(first) = back.first() else { return };
    let which = stamp_notices::which(&first.name, back.len());
    let topics: BTreeSet<&str> = back.iter().map(|c| c.source.topic.as_str()).collect();
    let place = match topics.len() {
        1 => first.source.topic.clone(),
        several => format!("{} and {} more", first.source.topic, several - 1),
    };
    let longest = longest_s.map_or(String::new(), |back_s| format!(", by {back_s:.3} s at most"));
    let text = format!("{which}: timestamps go back{longest}; the rows were sorted by timestamp");
    notices.push(Code::UnreliableStamps, place, back.iter().copied().map(jumps).sum(), text);
}

/// A driver fills in what its sensor lacks, for example with zeros. A bench channel without usable rows is therefore no
/// reason to warn about a flight.
fn no_rows(health: &ChannelHealth, notices: &mut Notices) {
    let reasons: Vec<String> = health.rejected.iter().map(|r| format!("{} ({})", r.reason, r.count)).collect();
    let text = format!("channel {} has no usable row: {}", health.name, reasons.join(", "));
    let severity = if BENCH_ALONE.contains(&health.quantity) { Severity::Info } else { Severity::Warning };
    notices.push(Code::RejectedRow.at(severity), &health.source.topic, health.rows, text);
}

fn candidate(trial: &Trial<'_>, best: &Trial<'_>) -> MapCandidate {
    let why = match (trial.both(), best.both()) {
        (false, true) => "does not bind both a position and a velocity",
        _ if best.encoder() && !trial.encoder() => "binds no encoder",
        _ if trial.specificity() < best.specificity() => "names topics less exactly",
        _ if trial.plans.len() < best.plans.len() => "binds fewer channels",
        _ => "names topics less exactly",
    };
    MapCandidate { map: trial.map.name.clone(), binds: trial.names(), why: why.into() }
}

/// Reports which map comes nearest, and which topics the log has.
fn nothing_fits(trials: &[Trial<'_>], log: &Log) -> IngestError {
    let meant: Vec<String> = trials
        .iter()
        .filter(|trial| trial.is_meant())
        .filter_map(|trial| missing_fields::check(trial, log).err())
        .collect();
    if !meant.is_empty() {
        return IngestError::MapLacks(meant.join("; "));
    }
    // A user who asks for one map wants all the details.
    let (mut text, channels) = match trials {
        [only] => (format!("the channel map {} does not fit", only.map.name), usize::MAX),
        _ => ("no channel map fits".to_owned(), 3),
    };
    let mut near: Vec<(usize, String)> = trials.iter().filter_map(|trial| trial.complaint(channels)).collect();
    near.sort_by_key(|(found, _)| std::cmp::Reverse(*found));
    near.truncate(2);
    if !near.is_empty() {
        text += &format!("; nearest: {}", near.into_iter().map(|(_, what)| what).collect::<Vec<_>>().join("; "));
    }
    let text = format!("{text}; {}", topics_of(log));
    if trials.iter().any(Trial::is_meant) { IngestError::MapLacks(text) } else { IngestError::Map(text) }
}

/// At most ten topics with their types.
fn topics_of(log: &Log) -> String {
    const LISTED: usize = 10;
    let named = |t: &flight::TopicHealth| match (t.type_name.as_str(), t.reason.as_str()) {
        ("", "") => t.name.clone(),
        ("", reason) => format!("{} ({reason})", t.name),
        (type_name, _) => format!("{} [{type_name}]", t.name),
    };
    let topics = &log.health.topics;
    let list: Vec<String> = topics.iter().take(LISTED).map(named).collect();
    let more = topics.len().saturating_sub(LISTED);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    if list.is_empty() { "the log holds no topic".into() } else { format!("the log holds {}{more}", list.join(", ")) }
}
