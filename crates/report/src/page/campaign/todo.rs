//! What to do, ranked by how much it reduces the error in metres.

use super::attention::{names, varies};
use super::group_cards::settings;
use super::{is_harmed, members};
use crate::number;
use crate::page::lateness::unsuitable;
use crate::text::{ended, shown};
use crate::verdict::is_relative;
use maud::{Markup, html};
use record::{CampaignRecord, Effect, FlightRow, GroupLateness, Outcome};
use std::collections::{BTreeMap, BTreeSet};

/// Maximum number of lines.
const MOST: usize = 5;
/// Code of the alarm for a table whose columns were bound by a guess.
const GUESSED: &str = "bound-by-guess";

/// One thing to do.
struct Action {
    /// Reduction of the error, summed over its flights, m.
    saves_m: f64,
    what: Markup,
}

/// The to-do list, at most five lines.
pub(super) fn todo(record: &CampaignRecord) -> Markup {
    let mut all: Vec<Action> = record.groups.iter().filter_map(|group| set(group, &record.flights)).collect();
    all.extend(harmed(&record.flights));
    all.extend(short(record));
    // Actions with equal savings keep this order.
    all.extend(changing(&record.flights));
    all.extend(failed(&record.flights));
    all.extend(copies(&record.flights));
    all.extend(fly(&record.flights));
    all.extend(relative(record));
    all.extend(guessed(&record.flights));
    all.sort_by(|a, b| b.saves_m.total_cmp(&a.saves_m));
    html! {
        h2 #todo { "Do this" }
        @if all.is_empty() { p { "Nothing to do." } }
        @else {
            ol.todo { @for action in all.iter().take(MOST) { li { (action.what) } } }
            @if all.len() > MOST {
                details {
                    summary { (number::counted((all.len() - MOST) as u64, "more thing", "more things")) }
                    ul.todo { @for action in all.iter().skip(MOST) { li { (action.what) } } }
                }
            }
        }
    }
}

/// The setting of a group. Its saving is relative to the delay that was removed, if that is known to be too small or
/// too large, and otherwise relative to the log.
fn set(group: &GroupLateness, flights: &[FlightRow]) -> Option<Action> {
    if group.advice.set.is_empty() {
        return None;
    }
    let outliers: Vec<&FlightRow> =
        members(group, flights).into_iter().filter(|row| group.outliers.contains(&row.flight)).collect();
    let is_alike = |row: &&FlightRow| row.delay_s.is_some() && !group.outliers.contains(&row.flight);
    let rows: Vec<&FlightRow> = members(group, flights).into_iter().filter(is_alike).collect();
    let (errors, is_short) = errors_now_and_then(group, &rows);
    let saves_m = errors.iter().map(|[now, then, _]| now - then).sum::<f64>();
    let median = |k: usize| median(errors.iter().map(|e| e[k]).collect());
    let metres = median(0).zip(median(1)).filter(|(now, then)| then < now);
    let what = html! {
        "Set " (settings(&group.advice.set)) " for " b { bdi { (shown(&group.group.name)) } }
        @if is_short { " instead of what was removed" }
        @if let Some((now, then)) = metres {
            ": error " (number::significant(now, 3)) " → "
            @match median(2) {
                Some(bound) if bound >= 2.0 * then => { "below " (number::significant(bound, 2)) }
                _ => { (number::significant(then, 2)) }
            }
            " m (" @if errors.len() > 1 { "median of " }
            (number::counted(errors.len() as u64, "flight", "flights")) ")"
        }
        @if !outliers.is_empty() { ". Not for " (names(&outliers)) ", which " @if outliers.len() == 1 { "differs" } @else { "differ" } }
        "." (unsuitable(&group.advice.set))
    };
    Some(Action { saves_m, what })
}

/// Smallest improvement for which a setting replaces what was removed, m.
const WORTH_M: f64 = 0.05;

/// Error of each flight now and with the setting, and what the latter is surely below (k = 2), m. "Now" is the error after removal if the removed delay is known to
/// be too small or too large (the flag is then true), and otherwise the error of the log.
fn errors_now_and_then(group: &GroupLateness, rows: &[&FlightRow]) -> (Vec<[f64; 3]>, bool) {
    let set_s = group.advice.set.iter().find(|setting| setting.unit == "s").map(|setting| setting.value);
    let own_s = |row: &FlightRow| row.lateness.as_ref()?.lateness_s().map(|own| own.value);
    let short = |row: &FlightRow, e: &Effect| {
        let best_m = e.short_by.and(e.best_m)?;
        let after = e.error_compensated_m?;
        let then = error_at(set_s?, best_m, own_s(row)?, e)?;
        (after.value - then > WORTH_M).then(|| [after.value, then, then + expanded(&after)])
    };
    let logged = |row: &FlightRow, e: &Effect| {
        let after = e.error_compensated_m?;
        let then = error_at(set_s?, after.value, row.delay_s?, e)?;
        Some([e.error_raw_m?.value, then, then + expanded(&after)])
    };

    let of = |errors: &dyn Fn(&FlightRow, &Effect) -> Option<[f64; 3]>| -> Vec<[f64; 3]> {
        rows.iter().filter_map(|row| errors(row, row.effect.as_ref()?)).collect()
    };
    let shorts = of(&short);
    if shorts.is_empty() { (of(&logged), false) } else { (shorts, true) }
}

fn expanded(error: &record::Estimate) -> f64 {
    2.0 * error.standard_uncertainty.unwrap_or_default()
}

/// Median; for an even count, the mean of the two middle values.
fn median(mut all: Vec<f64>) -> Option<f64> {
    all.sort_unstable_by(f64::total_cmp);
    let (low, high) = (all.get(all.len().wrapping_sub(1) / 2)?, all.get(all.len() / 2)?);
    Some((low + high) / 2.0)
}

/// Error after removing `set_s`, if removing `at_s` leaves `error_m`. The raw error is speed times delay, and the
/// difference of the two delays adds its share in quadrature.
fn error_at(set_s: f64, error_m: f64, at_s: f64, effect: &Effect) -> Option<f64> {
    let speed_mps = effect.error_raw_m?.value / at_s.abs();
    Some(error_m.hypot((set_s - at_s) * speed_mps)).filter(|error| error.is_finite())
}

fn harmed(flights: &[FlightRow]) -> Option<Action> {
    let rows: Vec<&FlightRow> = flights.iter().filter(|r| is_harmed(r)).collect();
    let lost = |r: &&FlightRow| {
        let effect = r.effect.as_ref()?;
        Some(effect.error_compensated_m?.value - effect.error_raw_m?.value)
    };
    let what = html! {
        "Do not remove this delay from " (number::counted(rows.len() as u64, "flight", "flights")) ", which it makes worse: "
        (names(&rows)) "."
    };
    (!rows.is_empty()).then(|| Action { saves_m: rows.iter().filter_map(lost).sum(), what })
}

/// Flights whose removed delay is not the best one, in groups without a setting.
fn short(record: &CampaignRecord) -> Option<Action> {
    let with_setting = record.groups.iter().filter(|group| !group.advice.set.is_empty());
    let are_set: BTreeSet<&String> = with_setting.flat_map(|group| &group.members).collect();
    let short_by = |r: &&FlightRow| r.effect.as_ref().filter(|_| !is_harmed(r)).and_then(|e| e.short_by);
    let is_short = |r: &&FlightRow| short_by(r).is_some() && !are_set.contains(&r.flight);
    let rows: Vec<&FlightRow> = record.flights.iter().filter(is_short).collect();
    let saved = |r: &&FlightRow| {
        let effect = r.effect.as_ref()?;
        Some(effect.error_compensated_m?.value - effect.best_m?)
    };
    let least = rows.iter().filter_map(short_by).fold(f64::INFINITY, f64::min);
    let what = html! {
        "Remove another delay from " (number::counted(rows.len() as u64, "flight", "flights")) ": the one that was removed leaves "
        @if rows.len() > 1 { "at least " }
        (number::significant(least, 2)) " times the smallest possible error. Each page names the best delay: " (names(&rows)) "."
    };
    (!rows.is_empty()).then(|| Action { saves_m: rows.iter().filter_map(saved).sum(), what })
}

fn changing(flights: &[FlightRow]) -> Option<Action> {
    let rows: Vec<&FlightRow> = flights.iter().filter(|r| varies(r)).collect();
    let what = html! {
        "Do not use one delay for " (number::counted(rows.len() as u64, "flight", "flights")) " whose delay changes: " (names(&rows)) "."
    };
    (!rows.is_empty()).then_some(Action { saves_m: 0.0, what })
}

fn copies(flights: &[FlightRow]) -> Option<Action> {
    let rows: Vec<&FlightRow> = flights.iter().filter(|r| r.duplicate_of.is_some()).collect();
    let what = html! {
        "Take " (number::counted(rows.len() as u64, "log", "logs")) " out of the folder: " (names(&rows)) ". "
        @if rows.len() == 1 { "The same flight is in it under another name. It is left out of the means, but counted above." }
        @else { "The same flights are in it under other names. They are left out of the means, but counted above." }
    };
    (!rows.is_empty()).then_some(Action { saves_m: 0.0, what })
}

fn failed(flights: &[FlightRow]) -> Option<Action> {
    let reason = |r: &FlightRow| match &r.outcome {
        Outcome::Failed { reason } => Some(reason.clone()),
        _ => None,
    };
    let rows: Vec<&FlightRow> = flights.iter().filter(|r| reason(r).is_some()).collect();
    let what = html! {
        "Look at " (number::counted(rows.len() as u64, "log", "logs")) " that could not be used: " (names(&rows)) ". "
        a href="#attention" { "Reasons" } "."
    };
    (!rows.is_empty()).then_some(Action { saves_m: 0.0, what })
}

/// What to fly, first for flights without a lateness. Advice that differs only in its numbers is one advice.
fn fly(flights: &[FlightRow]) -> Vec<Action> {
    let mut by_kind: BTreeMap<String, Vec<(&FlightRow, &str)>> = BTreeMap::new();
    for row in flights.iter().filter(|row| row.duplicate_of.is_none()) {
        if let Some(fly) = row.lateness.as_ref().and_then(|l| l.advice.fly.as_deref()) {
            let kind = fly.chars().filter(|c| c.is_alphabetic() || *c == ' ').collect();
            by_kind.entry(kind).or_default().push((row, fly));
        }
    }
    let mut kinds: Vec<Vec<(&FlightRow, &str)>> = by_kind.into_values().collect();
    let without = |(row, _): &&(&FlightRow, &str)| row.lateness.as_ref().is_some_and(|l| l.lateness.is_none());
    kinds.sort_by_key(|rows| std::cmp::Reverse((rows.iter().filter(without).count(), rows.len())));
    kinds.into_iter().map(fly_for).collect()
}

fn fly_for(of_kind: Vec<(&FlightRow, &str)>) -> Action {
    let advice = of_kind[0].1;
    let is_same = of_kind.iter().all(|(_, other)| *other == advice);
    let rows: Vec<&FlightRow> = of_kind.into_iter().map(|(row, _)| row).collect();
    // Advice is also given if the lateness is known but it is unknown whether it changes.
    let lacks = rows.iter().filter(|r| r.lateness.as_ref().is_some_and(|l| l.lateness.is_none())).count();
    let what = html! {
        (ended(advice)) " "
        @if !is_same { "(The numbers are those of the first flight; each page has its own.) " }
        @if lacks > 0 { (number::counted(lacks as u64, "flight does not", "flights do not")) " show how late the position is" }
        @if lacks > 0 && lacks < rows.len() { "; " }
        @if lacks < rows.len() { (number::counted((rows.len() - lacks) as u64, "flight does not", "flights do not")) " show whether the delay changes" }
        ": " (names(&rows)) "."
    };
    Action { saves_m: 0.0, what }
}

/// How to get true time for flights that show only the difference of two channels, so that nothing was removed.
fn relative(record: &CampaignRecord) -> Option<Action> {
    let groups = record.groups.iter().filter(|g| is_relative(g));
    let rows: Vec<&FlightRow> =
        groups.flat_map(|g| members(g, &record.flights)).filter(|r| r.delay_s.is_none()).collect();
    let is_told = |r: &&FlightRow| r.lateness.as_ref().is_some_and(|l| l.lateness.is_some());
    let rows: Vec<&FlightRow> = rows.into_iter().filter(|r| r.duplicate_of.is_none()).filter(is_told).collect();
    let has_reference = |r: &&&FlightRow| r.lateness.as_ref().is_some_and(|l| l.checked_against.is_some());
    let with_reference = rows.iter().filter(has_reference).count();
    let what = html! {
        "Log the IMU (acceleration and attitude, 10 Hz or more), or measure the receiver on the bench. If an IMU is logged, the page of \
         the flight says why it was not used. "
        (number::counted(rows.len() as u64, "flight shows", "flights show"))
        " how far position and velocity are apart in time, but not how late both are, so nothing was removed: " (names(&rows)) "."
        @if with_reference > 0 {
            " Or measure against the reference in the log, if it is on time: " code { "--reference-clock same" } " ("
            (number::counted(with_reference as u64, "flight has one", "flights have one")) ")."
        }
    };
    (!rows.is_empty()).then_some(Action { saves_m: 0.0, what })
}

fn guessed(flights: &[FlightRow]) -> Option<Action> {
    let is_guessed =
        |r: &&FlightRow| r.lateness.as_ref().is_some_and(|l| l.alarms.iter().any(|alarm| alarm.code == GUESSED));
    let rows: Vec<&FlightRow> = flights.iter().filter(is_guessed).collect();
    let what = html! {
        "State which columns are which, for " (number::counted(rows.len() as u64, "log was", "logs were"))
        " bound by guess: " code { "flightlag maps --suggest LOG > own.toml" } "."
    };
    (!rows.is_empty()).then_some(Action { saves_m: 0.0, what })
}
