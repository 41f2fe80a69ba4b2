//! What needs attention: one line for each reason, not for each flight.

use super::super::badge;
use super::flights::{is_on_the_page, link};
use super::is_harmed;
use crate::number;
use crate::text::ended;
use maud::{Markup, html};
use record::{CampaignRecord, FlightRow, Gravity, Outcome, flight_alarms};
use std::collections::{BTreeMap, BTreeSet};

/// Number of flights named next to a reason. The others are collapsed.
const NAMED: usize = 3;
/// Flights with one reason.
struct Reason<'a> {
    /// Name in the URL of the filtered table.
    slug: String,
    class: &'static str,
    icon: &'static str,
    word: &'static str,
    /// Text of the first flight.
    text: String,
    flights: Vec<&'a FlightRow>,
}

/// Severity, then text without numbers. Reasons that differ only in their numbers are merged.
type Key = (u8, String);

/// All reasons, most severe and most frequent first.
fn all_reasons(flights: &[FlightRow]) -> Vec<Reason<'_>> {
    let mut all: BTreeMap<Key, Reason<'_>> = BTreeMap::new();
    for row in flights {
        for (key, reason) in reasons(row) {
            all.entry(key).or_insert(reason).flights.push(row);
        }
    }
    let mut slugs: BTreeMap<String, u32> = BTreeMap::new();
    for ((_, what), reason) in &mut all {
        let slug = slug(what);
        let before = slugs.entry(slug.clone()).or_default();
        *before += 1;
        reason.slug = if *before == 1 { slug } else { format!("{slug}-{before}") };
    }
    let mut all: Vec<(Key, Reason<'_>)> = all.into_iter().collect();
    all.sort_by_key(|((rank, _), reason)| (*rank, std::cmp::Reverse(reason.flights.len())));
    all.into_iter().map(|(_, reason)| reason).collect()
}

/// A name for a URL: lower-case letters and digits of the first words.
fn slug(what: &str) -> String {
    const MOST: usize = 32;
    let letters = what.chars().map(|c| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { ' ' });
    let words: String = letters.collect();
    let joined = words.split_whitespace().fold(String::new(), |text, word| match text.len() + word.len() {
        _ if text.is_empty() => word.chars().take(MOST).collect(),
        length if length < MOST => format!("{text}-{word}"),
        _ => text,
    });
    if joined.is_empty() { "other".to_owned() } else { joined }
}

/// The reasons of each flight by flight name, for the filter of the flight table.
pub(super) type Reasons<'a> = BTreeMap<&'a str, String>;

pub(super) fn reasons_of(record: &CampaignRecord) -> Reasons<'_> {
    let mut of: Reasons<'_> = BTreeMap::new();
    for reason in all_reasons(&record.flights) {
        for row in &reason.flights {
            let slugs = of.entry(&row.flight).or_default();
            if !slugs.is_empty() {
                slugs.push(' ');
            }
            slugs.push_str(&reason.slug);
        }
    }
    of
}

pub(super) fn attention(record: &CampaignRecord) -> Markup {
    let all = all_reasons(&record.flights);
    let warnings = record.flights.iter().fold(0, |sum: u64, row| sum.saturating_add(row.warnings));
    html! {
        h2 #attention { "Needs attention" }
        @if all.is_empty() {
            p {
                "Nothing: no flight was harmed, no delay has an alarm, and no log is damaged."
                @if warnings > 0 { " The pages of the flights hold " (number::counted(warnings, "warning", "warnings")) "." }
            }
        }
        @else { ul.reasons { @for reason in &all { (line(reason, is_on_the_page(record))) } } }
    }
}

fn line(reason: &Reason<'_>, is_on_the_page: bool) -> Markup {
    let count = reason.flights.len();
    html! {
        li data-reason=(reason.slug) {
            (badge(reason.class, reason.icon, reason.word)) " "
            b { (number::counted(count as u64, "flight", "flights")) }
            @if count > 1 { ", such as: " } @else { ": " }
            span.text { (ended(&reason.text)) } " "
            (names(&reason.flights)) " "
            @if is_on_the_page && count > 1 {
                a.show href="#all" data-q={ "reason:" (reason.slug) } { "Show these " (number::count(count as u64)) " in the table" }
            }
        }
    }
}

/// Severity of a reason, and its badge: class, icon and word.
type Grave = (u8, (&'static str, &'static str, &'static str));

fn of_outcome(outcome: &Outcome) -> Option<Grave> {
    match outcome {
        Outcome::Failed { .. } => Some((0, ("bad", "✗", "Failed"))),
        Outcome::NotMeasurable { .. } => Some((4, ("unsure", "○", "Not measurable"))),
        Outcome::Pending { .. } => Some((5, ("off", "…", "Pending"))),
        // The table and the flight's page have the reason why nothing was removed.
        Outcome::Compensated | Outcome::Uncompensated { .. } => None,
    }
}

fn of_alarm(gravity: Gravity) -> Option<Grave> {
    match gravity {
        Gravity::Red => Some((1, ("bad", "!", "Red alarm"))),
        Gravity::Amber => Some((3, ("unsure", "!", "Amber alarm"))),
        Gravity::Grey => None,
    }
}

fn reasons(row: &FlightRow) -> Vec<(Key, Reason<'_>)> {
    let mut out: Vec<(Key, Reason<'_>)> = vec![];
    let mut add = |rank: u8, key: &str, (class, icon, word), text: &str| {
        let text = text.to_owned();
        out.push(((rank, key.to_owned()), Reason { slug: String::new(), class, icon, word, text, flights: vec![] }));
    };
    let mut said: Vec<&str> = vec![];
    if let Some((text, (rank, badge))) = row.outcome.reason().zip(of_outcome(&row.outcome)) {
        add(rank, &without_numbers(text), badge, text);
        said.push(text);
    }
    if let Some(effect) = row.effect.as_ref().filter(|_| is_harmed(row)) {
        add(0, "harmed", ("bad", "✗", "HARMED"), &effect.words);
    }
    let alarms = flight_alarms(row.lateness.as_ref(), row.decision.as_ref());
    for alarm in &alarms {
        if let Some((rank, badge)) = of_alarm(alarm.gravity) {
            add(rank, &alarm.code, badge, &alarm.text);
        }
    }
    let alarmed = |text: &str| alarms.iter().any(|a| a.text == text);
    let mut others = row.attention.iter().filter(|text| !said.contains(&text.as_str()) && !alarmed(text));
    if row.lossy {
        // The first text says what was lost. The flight's page has all texts.
        let text = others.next().map_or("bytes or messages were lost", String::as_str);
        add(2, &without_numbers(text), ("lost", "▲", "LOG DAMAGED"), text);
    } else {
        others.for_each(|text| match text.ends_with(": FAIL") {
            true => add(1, &without_numbers(text), ("bad", "✗", "FAIL"), text),
            false => add(3, &without_numbers(text), ("unsure", "!", "Warning"), text),
        });
    }
    // Count a flight once for each reason.
    let mut keys = BTreeSet::new();
    out.retain(|(key, _)| keys.insert(key.clone()));
    out
}

/// The text with every number replaced by `#`.
fn without_numbers(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '0'..='9' if out.ends_with('#') => {}
            '0'..='9' => out.push('#'),
            '.' | ',' if out.ends_with('#') => {}
            c => out.push(c),
        }
    }
    out
}

/// Whether one delay does not describe the flight.
pub(super) fn varies(row: &FlightRow) -> bool {
    row.lateness.as_ref().is_some_and(|l| l.kind.varies())
}

/// The first names and the number of further names.
pub(super) fn names(flights: &[&FlightRow]) -> Markup {
    html! {
        @for (i, row) in flights.iter().take(NAMED).enumerate() { @if i > 0 { ", " } (link(row, "")) }
        @if flights.len() > NAMED { " and " (number::count((flights.len() - NAMED) as u64)) " more" }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slug_is_short_and_alphanumeric() {
        assert_eq!(slug("delay-steps"), "delay-steps");
        assert_eq!(slug("# bytes of the log <b> are damaged and lost"), "bytes-of-the-log-b-are-damaged");
        assert_eq!(slug("\u{202e}?"), "other");
    }

    #[test]
    fn reasons_that_differ_only_in_their_numbers_are_merged() {
        let text = |bytes: &str| format!("{bytes} bytes of a7.bag are damaged at 12.5 s, and more");
        assert_eq!(without_numbers(&text("4096")), without_numbers(&text("17")));
        assert_eq!(without_numbers("1,234.5 m"), "# m");
        assert_ne!(without_numbers("no map fits"), without_numbers("no position"));
    }
}
