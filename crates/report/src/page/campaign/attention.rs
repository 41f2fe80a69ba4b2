//! What needs attention: one line for each reason, not one for each flight.

use super::super::{badge, reason};
use super::flights::link;
use super::is_harmed;
use crate::number;
use crate::text::{ended, shown};
use maud::{Markup, html};
use record::{FlightRow, Gravity, Outcome, flight_alarms};
use std::collections::BTreeMap;

/// Flights named beside a reason before the rest is folded away.
const NAMED: usize = 3;
/// Most flights listed under one reason; the table has all.
const MOST_LISTED: usize = 500;

/// Flights with one reason.
struct Reason<'a> {
    class: &'static str,
    icon: &'static str,
    word: &'static str,
    /// What the first of them says.
    text: String,
    flights: Vec<&'a FlightRow>,
}

/// How grave, then what: reasons that differ in their numbers only are one.
type Key = (u8, String);

pub(super) fn attention(flights: &[FlightRow]) -> Markup {
    let mut all: BTreeMap<Key, Reason<'_>> = BTreeMap::new();
    for row in flights {
        for (key, reason) in reasons(row) {
            all.entry(key).or_insert(reason).flights.push(row);
        }
    }
    let mut all: Vec<(Key, Reason<'_>)> = all.into_iter().collect();
    all.sort_by_key(|((rank, _), reason)| (*rank, std::cmp::Reverse(reason.flights.len())));
    html! {
        h2 #attention { "Needs attention" }
        @if all.is_empty() { p { "Nothing: no flight was harmed, no delay has an alarm, and no log is damaged." } }
        @else { ul.reasons { @for (_, reason) in &all { (line(reason)) } } }
    }
}

fn line(reason: &Reason<'_>) -> Markup {
    let (first, rest) = reason.flights.split_at(reason.flights.len().min(NAMED));
    html! {
        li {
            (badge(reason.class, reason.icon, reason.word)) " "
            b { (number::counted(reason.flights.len() as u64, "flight", "flights")) }
            @if reason.flights.len() > 1 { ", such as: " } @else { ": " }
            (ended(&reason.text)) " "
            @for (i, row) in first.iter().enumerate() { @if i > 0 { ", " } (link(row)) }
            @if !rest.is_empty() {
                details {
                    summary { "and " (number::count(rest.len() as u64)) " more" }
                    @for (i, row) in rest.iter().take(MOST_LISTED).enumerate() { @if i > 0 { ", " } (link(row)) }
                    @if rest.len() > MOST_LISTED { " … (the table has all)" }
                }
            }
        }
    }
}

fn reasons(row: &FlightRow) -> Vec<(Key, Reason<'_>)> {
    let mut out: Vec<(Key, Reason<'_>)> = vec![];
    let mut add = |rank: u8, key: &str, (class, icon, word), text: &str| {
        let text = text.to_owned();
        out.push(((rank, key.to_owned()), Reason { class, icon, word, text, flights: vec![] }));
    };
    let mut said: Vec<&str> = vec![];
    if let Some(text) = reason(&row.outcome) {
        let about = match row.outcome {
            Outcome::Failed { .. } => Some((0, ("bad", "✗", "Failed"))),
            Outcome::NotMeasurable { .. } => Some((4, ("unsure", "○", "Not measurable"))),
            Outcome::Pending { .. } => Some((5, ("off", "…", "Pending"))),
            // Why nothing was removed is in the table and on the flight's page.
            Outcome::Compensated | Outcome::Uncompensated { .. } => None,
        };
        if let Some((rank, badge)) = about {
            add(rank, &without_numbers(text), badge, text);
            said.push(text);
        }
    }
    if let Some(effect) = row.effect.as_ref().filter(|_| is_harmed(row)) {
        add(0, "harmed", ("bad", "✗", "HARMED"), &effect.words);
    }
    let alarms = flight_alarms(row.lateness.as_ref(), row.decision.as_ref());
    for alarm in &alarms {
        let (rank, badge) = match alarm.gravity {
            Gravity::Red => (1, ("bad", "!", "Alarm")),
            Gravity::Amber => (3, ("unsure", "!", "Warning")),
            Gravity::Grey => continue,
        };
        add(rank, &alarm.code, badge, &alarm.text);
    }
    let alarmed = |text: &str| alarms.iter().any(|a| a.text == text);
    let mut others = row.attention.iter().filter(|text| !said.contains(&text.as_str()) && !alarmed(text));
    if row.lossy {
        // The first says what was lost; the flight's page has all.
        let text = others.next().map_or("bytes or messages were lost", String::as_str);
        add(2, &without_numbers(text), ("lost", "▲", "LOG DAMAGED"), text);
    } else {
        others.for_each(|text| add(3, &without_numbers(text), ("unsure", "!", "Warning"), text));
    }
    out.dedup_by(|a, b| a.0 == b.0);
    out
}

/// The text with every number as `#`.
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

/// The first names, and how many more.
pub(super) fn names(flights: &[&FlightRow]) -> Markup {
    html! {
        @for (i, row) in flights.iter().take(NAMED).enumerate() { @if i > 0 { ", " } (link(row)) }
        @if flights.len() > NAMED { " and " (shown(&(flights.len() - NAMED).to_string())) " more" }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reasons_that_differ_in_their_numbers_only_are_one() {
        let text = |bytes: &str| format!("{bytes} bytes of a7.bag are damaged at 12.5 s, and more");
        assert_eq!(without_numbers(&text("4096")), without_numbers(&text("17")));
        assert_eq!(without_numbers("1,234.5 m"), "# m");
        assert_ne!(without_numbers("no map fits"), without_numbers("no position"));
    }
}
