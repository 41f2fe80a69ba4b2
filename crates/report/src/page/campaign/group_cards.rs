//! The answer: one card for each group of flights that may share a delay.

use super::super::{badge, estimate, no_number};
use super::attention::names;
use super::members;
use crate::number::{self, COVERAGE_FACTOR};
use crate::page::lateness::unsuitable;
use crate::text::{ended, shown};
use crate::verdict::{AGREE_P, DIFFER_P, has_no_common_delay, in_millis, is_relative, source_phrase};
use maud::{Markup, html};
use record::{CampaignRecord, DelaySetting, DelaySource, EffectVerdict, Estimate, FlightRow, GroupLateness};
use std::collections::BTreeSet;

/// Maximum number of groups shown; the record has all.
const MOST_GROUPS: usize = 20;
/// Number of groups shown above the to-do list: one row.
const FIRST: usize = 3;
/// Width and height of the small chart, CSS pixels.
const SPARK: (f64, f64) = (150.0, 28.0);
/// Maximum number of flights in the small chart (the newest).
const MOST_SPARKS: usize = 100;
/// Name of the group fact with the log type of its flights.
const LOG: &str = "log";

/// How late the position is in the largest groups, whether the removal helped, and what to set.
pub(super) fn first(record: &CampaignRecord) -> Markup {
    html! {
        @if record.groups.iter().all(|g| g.pooled == 0) {
            p.answer { "No flight shows how late its position is." }
        }
        (cards(record, 0, FIRST))
    }
}

/// Cards of the other groups, below the to-do list, which must be on the first screen.
pub(super) fn others(record: &CampaignRecord) -> Markup {
    let rest = record.groups.len().saturating_sub(FIRST);
    html! {
        @if rest > 0 {
            h2 #groups { (number::counted(rest as u64, "smaller group", "smaller groups")) }
            (cards(record, FIRST, MOST_GROUPS))
            @if let Some(more) = record.groups.len().checked_sub(MOST_GROUPS).filter(|more| *more > 0) {
                p.note { (number::count(more as u64)) " more in campaign.json." }
            }
        }
    }
}

/// Cards of the groups. Groups with a delay come first.
fn cards(record: &CampaignRecord, from: usize, to: usize) -> Markup {
    let groups = &record.groups;
    let mut ordered: Vec<&GroupLateness> = groups.iter().collect();
    ordered.sort_by_key(|group| group.pooled == 0);
    html! {
        ul.cards {
            @for group in ordered.into_iter().take(to).skip(from) { (card(group, &members(group, &record.flights), &other_logs(group, groups))) }
        }
    }
}

/// Log types of the groups that differ from this one only in log type.
fn other_logs<'a>(group: &GroupLateness, groups: &'a [GroupLateness]) -> Vec<&'a str> {
    let log =
        |of: &'a GroupLateness| of.group.parts.iter().find(|part| part.what == LOG).map(|part| part.value.as_str());
    let rest = |of: &GroupLateness| -> BTreeSet<(String, String)> {
        let facts = of.group.parts.iter().filter(|part| part.what != LOG);
        facts.map(|part| (part.what.clone(), part.value.to_lowercase())).collect()
    };
    let own = rest(group);
    let like =
        groups.iter().filter(|other| !own.is_empty() && other.group.key != group.group.key && rest(other) == own);
    like.filter_map(log).collect()
}

fn card(group: &GroupLateness, rows: &[&FlightRow], other_logs: &[&str]) -> Markup {
    html! {
        li {
            h2 { bdi { @if group.group.name.is_empty() { "Receiver and rate unknown" } @else { (shown(&group.group.name)) } } }
            p.big { (lateness(group, rows)) }
            p { (agreement(group, rows)) }
            @if !other_logs.is_empty() {
                p.note {
                    "Everything except the log is as in the " @if other_logs.len() == 1 { "group" } @else { "groups" }
                    " of "
                    @for (i, log) in other_logs.iter().enumerate() { (joint(i, other_logs.len())) (shown(log)) }
                    ". Another logger may set the timestamp at another moment, so they are not averaged."
                }
            }
            (other_receivers(group, rows))
            p { (removal(rows)) }
            @if !group.advice.set.is_empty() { p { "To remove it, set " (settings(&group.advice.set)) "." (unsuitable(&group.advice.set)) } }
            (spark(rows, is_relative(group)))
        }
    }
}

/// How late. If the flights have no common delay, the range is shown, because their mean describes no flight.
fn lateness(group: &GroupLateness, rows: &[&FlightRow]) -> Markup {
    let all = || rows.iter().filter_map(|r| r.lateness.as_ref()?.lateness_s()).map(|e| e.value);
    let (low, high) = (all().reduce(f64::min), all().reduce(f64::max));
    html! {
        @match &group.lateness_s {
            _ if has_no_common_delay(group) => {
                b { "No common delay" }
                @if let (Some(low), Some(high)) = (low, high) { ": " (range(low, high)) }
                @if is_relative(group) { ", " (shown(&group.against)) }
                ". Do not use one delay."
            }
            Some(found) if is_relative(group) => {
                @let apart = Estimate { value: found.value.abs(), ..*found };
                b { (estimate(&in_millis(&apart))) "\u{a0}ms" } @if found.value < 0.0 { " earlier, " } @else { " later, " }
                (shown(&group.against)) "; the lateness of both is unknown"
            }
            Some(found) => { b { (estimate(&in_millis(found))) "\u{a0}ms" } " late, against " (shown(datum(&group.against))) }
            None => { (no_number(&group.words)) }
        }
    }
}

/// `3 to 20 ms later`, `1 to 21 ms earlier`, `5 ms earlier to 12 ms later`.
fn range(low_s: f64, high_s: f64) -> String {
    let ms = |s: f64| millis(s.abs());
    match (low_s < 0.0, high_s > 0.0) {
        (true, true) => format!("{}\u{a0}ms earlier to {}\u{a0}ms later", ms(low_s), ms(high_s)),
        (true, false) => format!("{} to {}\u{a0}ms earlier", ms(high_s), ms(low_s)),
        _ => format!("{} to {}\u{a0}ms later", ms(low_s), ms(high_s)),
    }
}

/// Separator before an item of a list in a sentence.
fn joint(item: usize, of: usize) -> &'static str {
    match item {
        0 => "",
        last if last + 1 == of => " and ",
        _ => ", ",
    }
}

fn millis(seconds: f64) -> String {
    number::fixed(1e3 * seconds, 0)
}

fn datum(against: &str) -> &str {
    match against {
        "imu" => "the IMU",
        "reference" => "the reference",
        other => other,
    }
}

/// Number of flights that show the lateness, and whether they agree.
fn agreement(group: &GroupLateness, rows: &[&FlightRow]) -> Markup {
    let outliers: Vec<&FlightRow> = rows.iter().filter(|r| group.outliers.contains(&r.flight)).copied().collect();
    html! {
        (number::counted(group.flights, "flight", "flights"))
        @if group.pooled > 0 { ", " (number::count(group.pooled)) " with a measured delay" }
        @if let Some(words) = &group.split { ": " (ended(words)) }
        @else {
            // The test covers all flights. Outliers are named instead and excluded from the mean.
            @if let Some(test) = group.difference.as_ref().filter(|_| outliers.is_empty() || group.lateness_s.is_none()) {
                @if test.p < DIFFER_P {
                    ", and they differ (" (p_value(test.p))
                    @if let Some(between) = group.between_s.filter(|b| *b > 0.0) { "; " (number::significant(1e3 * between, 2)) "\u{a0}ms, 1\u{a0}σ" }
                    ")"
                }
                @else if test.p < AGREE_P { ", and disagreement is likely (" (p_value(test.p)) ")" }
                @else { ", and they agree with each other (" (p_value(test.p)) ")" }
            }
            @if !outliers.is_empty() { "; " (badge("unsure", "!", "differs")) " " (names(&outliers)) @if group.lateness_s.is_some() { ", not in the mean" } }
            "."
            @if group.lateness_s.is_some() && 2 * outliers.len() > rows.len() { " Do not use one delay for all." }
        }
    }
}

/// `p = 0.41`, `p < 0.001`.
pub(in super::super) fn p_value(p: f64) -> String {
    if p < 0.001 { "p < 0.001".to_owned() } else { format!("p = {}", number::significant(p, 2)) }
}

/// Positions from other receivers. The delay of the group does not apply to them.
fn other_receivers(group: &GroupLateness, rows: &[&FlightRow]) -> Markup {
    let of = |row: &FlightRow| row.lateness.as_ref().map(|l| l.other_receivers.clone()).unwrap_or_default();
    let with: Vec<&FlightRow> = rows.iter().filter(|row| !of(row).is_empty()).copied().collect();
    html! {
        @if let Some(first) = with.first() {
            p {
                (badge("unsure", "!", "Another receiver")) " "
                @for (i, other) in of(first).iter().enumerate() {
                    (joint(i, of(first).len())) code { (shown(&other.channel)) } " is "
                    (estimate(&in_millis(&other.lateness_s))) "\u{a0}ms "
                    @if is_relative(group) { "later" } @else { "late" }
                }
                " in " (names(&with)) "."
            }
        }
    }
}

/// What was removed from these flights, and the effect.
fn removal(rows: &[&FlightRow]) -> Markup {
    let removed: Vec<f64> = rows.iter().filter_map(|r| r.delay_s).filter(|s| s.is_finite()).collect();
    let sources: BTreeSet<DelaySource> =
        rows.iter().filter(|r| r.delay_s.is_some()).filter_map(|r| r.delay_from).collect();
    let widths: Vec<f64> = rows
        .iter()
        .filter(|r| r.delay_s.is_some())
        .filter_map(|r| r.decision.as_ref()?.standard_uncertainty_s)
        .map(|u| COVERAGE_FACTOR * u)
        .collect();
    let ends = removed.iter().copied().reduce(f64::min).zip(removed.iter().copied().reduce(f64::max));
    html! {
        @match ends {
            None => { "Nothing was removed." }
            Some((low, high)) => {
                "Removed: " (number::fixed(1e3 * low, 1))
                @if high > low { " to " (number::fixed(1e3 * high, 1)) }
                "\u{a0}ms"
                @for (i, source) in sources.iter().enumerate() { @if i == 0 { " (" } @else { ", " } (source_phrase(*source)) }
                @if !sources.is_empty() { ")" }
                @if removed.len() < rows.len() { " from " (number::count(removed.len() as u64)) " of them" }
                (known_to(&widths, removed.len()))
                ". " (effects(rows)) (short(rows))
            }
        }
    }
}

/// Expanded uncertainties (s) of a number of removed delays.
fn known_to(widths_s: &[f64], delays: usize) -> String {
    let unknown = delays.saturating_sub(widths_s.len());
    let each = match widths_s.iter().copied().reduce(f64::max) {
        None => return ", without an uncertainty".to_owned(),
        Some(most) if delays == 1 => format!(", known to ±\u{a0}{}\u{a0}ms", number::significant(1e3 * most, 2)),
        Some(most) => format!(", each known to ±\u{a0}{}\u{a0}ms or better", number::significant(1e3 * most, 2)),
    };
    match unknown {
        0 => each,
        n => format!("{each}, {} without an uncertainty", number::count(n as u64)),
    }
}

fn effects(rows: &[&FlightRow]) -> Markup {
    let count = |verdict| {
        rows.iter().filter(|r| r.delay_s.is_some() && r.effect.as_ref().is_some_and(|e| e.verdict == verdict)).count()
            as u64
    };
    let all = [
        (EffectVerdict::Harmed, "bad", "✗", "HARMED"),
        (EffectVerdict::Helped, "ok", "✓", "Helped"),
        (EffectVerdict::NoChange, "off", "○", "No change"),
        (EffectVerdict::CannotTell, "unsure", "?", "Cannot tell"),
    ];
    html! {
        @for (verdict, class, icon, word) in all {
            @if count(verdict) > 0 { (badge(class, icon, &format!("{word} {}", number::count(count(verdict))))) " " }
        }
    }
}

/// The error in units of the smallest possible one: median over the flights where it is clearly larger.
fn short(rows: &[&FlightRow]) -> Markup {
    let mut factors: Vec<f64> =
        rows.iter().filter_map(|r| r.effect.as_ref()?.short_by).filter(|f| f.is_finite()).collect();
    factors.sort_unstable_by(f64::total_cmp);
    html! {
        @if let Some(middle) = factors.get(factors.len() / 2) {
            "The error is " (number::significant(*middle, 2)) " times the smallest possible one ("
            @if factors.len() > 1 { "median of " (number::count(factors.len() as u64)) " flights" } @else { "1 flight" }
            ")."
        }
    }
}

/// `position_s = 0.203 or GPS1_DELAY_MS = 203`.
pub(super) fn settings(set: &[DelaySetting]) -> Markup {
    html! {
        @for (i, s) in set.iter().filter(|s| !s.unsuitable).enumerate() {
            @if i > 0 { " or " }
            code { (shown(&s.name)) " = " (s.value) } @if s.unit == "ms" { " (ms)" }
        }
    }
}

/// Lateness of the flights by date; nothing for fewer than three.
fn spark(rows: &[&FlightRow], is_relative: bool) -> Markup {
    let mut all: Vec<(&str, f64)> =
        rows.iter().filter_map(|r| Some((r.flown_at.as_deref()?, r.lateness.as_ref()?.lateness_s()?.value))).collect();
    // Values further off are faults and would hide all others.
    all.retain(|(_, late)| late.abs() < 1e6);
    all.sort_unstable_by(|a, b| a.0.cmp(b.0).then(a.1.total_cmp(&b.1)));
    let newest = all.split_off(all.len().saturating_sub(MOST_SPARKS));
    let ends = |of: fn(f64, f64) -> f64| newest.iter().map(|p| p.1).reduce(of).unwrap_or(0.0);
    let (low, high) = (ends(f64::min), ends(f64::max));
    let (width, height) = SPARK;
    let step = (width - 8.0) / newest.len().max(2).saturating_sub(1) as f64;
    let y =
        |late: f64| if high > low { height - 4.0 - (height - 8.0) * (late - low) / (high - low) } else { height / 2.0 };
    let dots: String =
        newest.iter().enumerate().map(|(k, p)| format!("M{:.1} {:.1}h0", 4.0 + step * k as f64, y(p.1))).collect();
    html! {
        @if newest.len() > 2 {
            p.note {
                svg.spark viewBox={ "0 0 " (width) " " (height) } width=(width) height=(height) role="img" aria-label="Lateness by date" {
                    path fill="none" stroke="currentColor" stroke-width="4" stroke-linecap="round" d=(dots) {}
                }
                " by date, "
                @if is_relative { (range(low, high)) } @else { (millis(low)) " to " (millis(high)) "\u{a0}ms" }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_of_lateness_has_no_negative_values() {
        let all = [(0.003, 0.02), (-0.021, -0.001), (-0.005, 0.012)].map(|(low, high)| range(low, high));
        assert_eq!(all, ["3 to 20\u{a0}ms later", "1 to 21\u{a0}ms earlier", "5\u{a0}ms earlier to 12\u{a0}ms later"]);
    }

    #[test]
    fn a_probability_is_never_zero() {
        assert_eq!(
            (p_value(0.0), p_value(0.41), p_value(0.0123)),
            ("p < 0.001".into(), "p = 0.41".into(), "p = 0.012".into())
        );
    }
}
