//! The page of changes since the previous run.

use super::Head::{Number, Text};
use super::{Needs, document, estimate, files, number, table};
use crate::site::Site;
use crate::text::{href, shown};
use crate::verdict::in_millis;
use maud::{Markup, html};
use record::{CampaignChanges, FlightRow, MadeWith, MovedDelay, TroubleChange, in_the_past};
use std::collections::BTreeMap;

/// Maximum number of flights named in one list.
const MOST: usize = 200;

/// The page of changes since the previous run: `since-last-run.html`, in the folder of the campaign's page. `flights`
/// has the paths of the flight pages.
#[must_use]
pub fn changes_site(changes: &CampaignChanges, flights: &[FlightRow]) -> Site {
    let pages: BTreeMap<&str, &str> = flights.iter().map(|row| (row.flight.as_str(), row.page.as_str())).collect();
    let body = html! {
        nav aria-label="Pages" { a href="index.html" { "Campaign" } }
        main {
            h1 { (shown(&changes.name)) ": since the last run" }
            (answer(changes))
            @if let Some(before) = &changes.before { (settings(before, &changes.now)) }
            (troubles("Newly failing", &changes.failing, str::to_owned, &pages))
            (moved("Groups whose delay moved", &changes.moved_groups, &pages))
            (moved("Flights whose delay moved", &changes.moved, &pages))
            (rerun(changes, &pages))
            (new_flights(&changes.new, flights, &pages))
            (names("No longer in the folder", &changes.gone, &pages))
            (troubles("No longer failing", &changes.recovered, in_the_past, &pages))
            p.note {
                "Compared with what this folder held before. Only this page and run.json depend on earlier runs. A run \
                 that changes nothing does not rewrite this page."
            }
            (files(&["since-last-run.json"]))
        }
    };
    let mut site = Site::default();
    let title = format!("{} — since the last run", changes.name);
    site.add("since-last-run.html", document(&title, Needs::Nothing, body));
    site
}

fn answer(changes: &CampaignChanges) -> Markup {
    let count = |n: usize| number::count(n as u64);
    html! {
        p.answer {
            @if changes.before.is_none() { "First run in this folder: there is nothing to compare with." }
            @else if changes.is_empty() { "Nothing changed." }
            @else {
                b { (count(changes.failing.len())) " newly failing" } ", " (count(changes.moved.len())) " with a lateness that moved by more than 2\u{a0}σ, "
                (count(changes.rerun.len())) " computed again, " (count(changes.new.len())) " new, " (count(changes.gone.len()))
                " gone, " (count(changes.recovered.len())) " no longer failing."
            }
        }
    }
}

/// Changes of the settings and the build.
fn settings(before: &MadeWith, now: &MadeWith) -> Markup {
    html! {
        @if before.flightlag_version != now.flightlag_version {
            p { "flightlag was " (shown(&before.flightlag_version)) ", is " (shown(&now.flightlag_version)) "." }
        }
        @if before.analysis_version != now.analysis_version {
            p { "The analysis was version " (before.analysis_version) ", is version " (now.analysis_version) "." }
        }
        @if before.pipeline_blake3 != now.pipeline_blake3 { p { "The pipeline has changed in meaning." } }
        @if before.criteria_blake3 != now.criteria_blake3 { p { "The criteria have changed." } }
    }
}

type Pages<'a> = BTreeMap<&'a str, &'a str>;

/// A name, linked to its page if it has one.
fn named(name: &str, pages: &Pages<'_>) -> Markup {
    html! {
        @match pages.get(name) {
            Some(page) => { a href=(href(page)) { bdi { (shown(name)) } } }
            None => { bdi { (shown(name)) } }
        }
    }
}

fn list<'a>(names: impl ExactSizeIterator<Item = &'a str>, pages: &Pages<'_>) -> Markup {
    let more = names.len().saturating_sub(MOST);
    html! {
        @for (i, name) in names.take(MOST).enumerate() { @if i > 0 { ", " } (named(name, pages)) }
        @if more > 0 { ", and " (number::count(more as u64)) " more, in since-last-run.json" }
    }
}

fn names(title: &str, names: &[String], pages: &Pages<'_>) -> Markup {
    html! {
        @if !names.is_empty() {
            h2 { (title) ": " (number::count(names.len() as u64)) }
            p { (list(names.iter().map(String::as_str), pages)) "." }
        }
    }
}

/// New flights with what was found in them.
fn new_flights(new: &[String], flights: &[FlightRow], pages: &Pages<'_>) -> Markup {
    let rows: BTreeMap<&str, &FlightRow> = flights.iter().map(|row| (row.flight.as_str(), row)).collect();
    html! {
        @if !new.is_empty() {
            h2 { "New flights: " (number::count(new.len() as u64)) }
            ul {
                @for row in new.iter().filter_map(|name| rows.get(name.as_str())).take(MOST) {
                    li { (named(&row.flight, pages)) ": " (shown(&row.answer())) }
                }
                @if new.len() > MOST { li { "and " (number::count((new.len() - MOST) as u64)) " more, in since-last-run.json" } }
            }
        }
    }
}

/// Flights with a changed result, by cause.
fn rerun(changes: &CampaignChanges, pages: &Pages<'_>) -> Markup {
    let mut by_cause: BTreeMap<String, Vec<&str>> = BTreeMap::new();
    for flight in &changes.rerun {
        by_cause.entry(flight.causes.join("; ")).or_default().push(&flight.flight);
    }
    html! {
        @if !changes.rerun.is_empty() {
            h2 { "Another result: " (number::count(changes.rerun.len() as u64)) }
            ul {
                @for (cause, flights) in &by_cause {
                    li {
                        b { (number::counted(flights.len() as u64, "flight", "flights")) } ", " (shown(cause)) ": "
                        (list(flights.iter().copied(), pages)) "."
                    }
                }
            }
        }
    }
}

fn troubles(title: &str, all: &[TroubleChange], said: fn(&str) -> String, pages: &Pages<'_>) -> Markup {
    let words = |of: &TroubleChange| of.troubles.iter().map(|trouble| said(trouble)).collect::<Vec<_>>().join(", ");
    html! {
        @if !all.is_empty() {
            h2 { (title) ": " (number::count(all.len() as u64)) }
            ul {
                @for of in all.iter().take(MOST) { li { (named(&of.flight, pages)) ": " (shown(&words(of))) } }
                @if all.len() > MOST { li { "and " (number::count((all.len() - MOST) as u64)) " more, in since-last-run.json" } }
            }
        }
    }
}

fn moved(title: &str, all: &[MovedDelay], pages: &Pages<'_>) -> Markup {
    html! {
        @if !all.is_empty() {
            h2 { (title) ": " (number::count(all.len() as u64)) }
            (moved_table(title, ["Name", "Before (ms)", "Now (ms)"], all, &|name| named(name, pages)))
            p.note { "± is U with k = 2. σ: root of the sum of both squared standard uncertainties." }
        }
    }
}

/// Delays that moved, with the titles of the first three columns.
pub(super) fn moved_table(
    caption: &str,
    [name, before, now]: [&'static str; 3],
    all: &[MovedDelay],
    named: &dyn Fn(&str) -> Markup,
) -> Markup {
    let head = [Text(name), Number(before), Number(now), Number("Moved by (σ)")];
    let row = |of: &MovedDelay| {
        html! {
            tr {
                th scope="row" { (named(&of.name)) }
                td.n { (estimate(&in_millis(&of.before_s))) }
                td.n { (estimate(&in_millis(&of.now_s))) }
                td.n { (super::plain(of.sigmas, 2)) }
            }
        }
    };
    table(caption, &head, super::rows(all, MOST, head.len(), row))
}
