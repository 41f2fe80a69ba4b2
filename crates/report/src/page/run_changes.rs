//! Changes between two sets of results: sections shared by the page of a night and the page of a comparison.

use super::Head::{Number, Text};
use super::{estimate, number, rows, table};
use crate::text::{href, shown};
use crate::verdict::in_millis;
use maud::{Markup, html};
use record::{ChangeCause, FlightWords, MovedAdvice, MovedNumber, NamedFlight, RunChanges};
use std::collections::BTreeMap;

/// Maximum number of flights named in one list.
const MOST: usize = 200;

/// How a page links to flights and to the file with all entries.
pub(super) struct Names<'a> {
    /// Path from the page to the folder that flight pages are relative to.
    pub(super) base: &'a str,
    /// File with all entries.
    pub(super) all: &'a str,
}

impl Names<'_> {
    /// A flight, linked to its page if it has one.
    pub(super) fn flight(&self, flight: &NamedFlight) -> Markup {
        let name = match flight.campaign.as_str() {
            "" => flight.flight.clone(),
            campaign => format!("{campaign}/{}", flight.flight),
        };
        html! {
            @match &flight.page {
                Some(page) => { a href={ (self.base) (href(page)) } { bdi { (shown(&name)) } } }
                None => { bdi { (shown(&name)) } }
            }
        }
    }

    fn list<'f>(&self, flights: impl ExactSizeIterator<Item = &'f NamedFlight>) -> Markup {
        let more = flights.len().saturating_sub(MOST);
        html! {
            @for (i, flight) in flights.take(MOST).enumerate() { @if i > 0 { ", " } (self.flight(flight)) }
            @if more > 0 { ", and " (number::count(more as u64)) " more, in " (self.all) }
        }
    }

    fn section(&self, title: &str, flights: &[NamedFlight]) -> Markup {
        html! {
            @if !flights.is_empty() {
                h3 { (title) ": " (number::count(flights.len() as u64)) }
                p { (self.list(flights.iter())) "." }
            }
        }
    }

    pub(super) fn words(&self, title: &str, all: &[FlightWords]) -> Markup {
        html! {
            @if !all.is_empty() {
                @let words = all.iter().map(|of| of.words.len()).sum::<usize>();
                h3 {
                    (title) ": " (number::count(words as u64))
                    @if words != all.len() { " of " (number::counted(all.len() as u64, "flight", "flights")) }
                }
                ul {
                    @for of in all.iter().take(MOST) {
                        li {
                            (self.flight(&of.flight)) ": " (with_texts(of))
                            @if let Some(error) = &of.error { ": " (shown(error)) }
                        }
                    }
                    @if all.len() > MOST { li { "and " (number::count((all.len() - MOST) as u64)) " more, in " (self.all) } }
                }
            }
        }
    }
}

/// The words of a flight, each with its full text.
fn with_texts(of: &FlightWords) -> Markup {
    if of.texts.iter().all(String::is_empty) {
        return html! { b { (shown(&of.words.join(", "))) } };
    }
    html! {
        @for (i, word) in of.words.iter().enumerate() {
            @if i > 0 { br; }
            b { (shown(word)) }
            @if let Some(text) = of.texts.get(i).filter(|text| !text.is_empty()) { ": " (shown(text)) }
        }
    }
}

/// All sections. Those that need attention come first.
pub(super) fn sections(changes: &RunChanges, names: &Names<'_>) -> Markup {
    html! {
        (names.words("Newly failing", &changes.failing))
        (names.words("Another verdict of the criteria", &changes.verdicts))
        (moved(changes, names))
        (advice(&changes.advice, names))
        (rerun(changes, names))
        (names.words("New alarms", &changes.alarms_new))
        (new_flights(changes, names))
        (names.words("New remarks", &changes.remarks_new))
        (names.section("New flights that cannot be measured", &changes.new_not_measurable))
        (names.section("No longer there", &changes.gone))
        (names.words("No longer failing", &changes.recovered_from()))
        (names.words("Alarms cleared", &changes.alarms_cleared))
        (names.words("Remarks cleared", &changes.remarks_cleared))
    }
}

/// Whether there is nothing to show.
pub(super) fn is_empty(changes: &RunChanges) -> bool {
    RunChanges { compared: 0, ..changes.clone() } == RunChanges::default()
}

/// Causes in words.
pub(super) fn causes(causes: &[ChangeCause]) -> String {
    match causes {
        [] => "an unknown cause".to_owned(),
        causes => causes.iter().map(|cause| cause.word()).collect::<Vec<_>>().join(", "),
    }
}

/// New flights with what was found in them.
fn new_flights(changes: &RunChanges, names: &Names<'_>) -> Markup {
    let answers = changes.new_answers.iter().map(String::as_str).chain(std::iter::repeat(""));
    html! {
        @if !changes.new.is_empty() {
            h3 { "New flights: " (number::count(changes.new.len() as u64)) }
            ul {
                @for (flight, answer) in changes.new.iter().zip(answers).take(MOST) {
                    li { (names.flight(flight)) @if !answer.is_empty() { ": " (shown(answer)) } }
                }
                @if changes.new.len() > MOST { li { "and " (number::count((changes.new.len() - MOST) as u64)) " more, in " (names.all) } }
            }
        }
    }
}

fn rerun(changes: &RunChanges, names: &Names<'_>) -> Markup {
    let mut by_cause: BTreeMap<String, Vec<&NamedFlight>> = BTreeMap::new();
    for flight in &changes.rerun {
        by_cause.entry(causes(&flight.causes)).or_default().push(&flight.flight);
    }
    html! {
        @if !changes.rerun.is_empty() {
            h3 { "Another result: " (number::count(changes.rerun.len() as u64)) }
            ul {
                @for (cause, flights) in &by_cause {
                    li {
                        b { (number::counted(flights.len() as u64, "flight", "flights")) } ", because of " (cause) ": "
                        (names.list(flights.iter().copied())) "."
                    }
                }
            }
        }
    }
}

/// Recommended values that changed, by parameter and values.
fn advice(all: &[MovedAdvice], names: &Names<'_>) -> Markup {
    let value = |value_s: Option<f64>| {
        value_s.map_or_else(|| "none".to_owned(), |s| format!("{}\u{a0}ms", number::fixed(1e3 * s, 0)))
    };
    let mut by_values: BTreeMap<(&str, String, String), Vec<&NamedFlight>> = BTreeMap::new();
    for of in all {
        by_values.entry((&of.parameter, value(of.before_s), value(of.now_s))).or_default().push(&of.flight);
    }
    html! {
        @if !all.is_empty() {
            h3 { "Another value recommended: " (number::counted(all.len() as u64, "flight", "flights")) }
            ul {
                @for ((parameter, before, now), flights) in &by_values {
                    li {
                        code { (shown(parameter)) } ": " b { (before) " → " (now) } ", "
                        (number::counted(flights.len() as u64, "flight", "flights")) ": " (names.list(flights.iter().copied())) "."
                    }
                }
            }
        }
    }
}

fn moved(changes: &RunChanges, names: &Names<'_>) -> Markup {
    let (all, (by_sigmas, by_a_tenth)) = (&changes.moved, changes.moved_counts());
    let head = [
        Text("Flight"),
        Text("Quantity"),
        Number("Before"),
        Number("Now"),
        Text("Unit"),
        Number("Moved by (σ)"),
        Text("Because of"),
    ];
    let row = |of: &MovedNumber| {
        let in_ms = of.unit == "s";
        let shown_value = |e: &record::Estimate| if in_ms { in_millis(e) } else { *e };
        html! {
            tr {
                th scope="row" { (names.flight(&of.flight)) }
                td { (shown(&of.quantity)) }
                td.n { (estimate(&shown_value(&of.before))) }
                td.n { (estimate(&shown_value(&of.now))) }
                td { @if in_ms { "ms" } @else { (shown(&of.unit)) } }
                td.n { @match of.sigmas { Some(sigmas) => { (super::plain(sigmas, 2)) } None => { "uncertainty unknown" } } }
                td { (causes(&of.causes)) }
            }
        }
    };
    html! {
        @if !all.is_empty() {
            h3 {
                "Moved by more than 2\u{a0}σ: " (number::count(by_sigmas as u64))
                @if by_a_tenth > 0 {
                    "; by more than 10\u{a0}%, uncertainty unknown: " (number::count(by_a_tenth as u64))
                }
            }
            (table("Numbers that moved, the largest move first", &head, rows(all, MOST, head.len(), row)))
            p.note {
                "± is U with k = 2. σ: root of the sum of both squared standard uncertainties. If the log is the same in both, \
                 the two numbers are not independent: σ then says how large the move is, not how likely."
            }
        }
    }
}
