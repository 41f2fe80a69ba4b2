//! The page of a comparison of two reports.

use super::Head::Text;
use super::changes::moved_table;
use super::run_changes::{Names, is_empty, sections};
use super::{Needs, document, files, number, table};
use crate::site::Site;
use crate::text::shown;
use maud::{Markup, html};
use record::{ComparedReport, DiffRecord, MovedDelay, RunChanges};

/// The page of a comparison as `index.html`.
#[must_use]
pub fn diff_site(record: &DiffRecord) -> Site {
    let changes = &record.changes;
    let (by_sigmas, by_a_tenth) = changes.moved_counts();
    let (failing, failing_new) = changes.failing_and_new();
    let names = Names { base: "", all: "diff.json" };
    let count = |n: usize| number::count(n as u64);
    let title = format!("{} against {}", record.now.folder, record.before.folder);
    let body = html! {
        main {
            h1 { (shown(&title)) }
            p.answer {
                b { (count(by_sigmas)) " moved by more than 2\u{a0}σ" } ", " (count(by_a_tenth)) " by more than 10\u{a0}% (uncertainty unknown), of " (number::count(changes.compared)) " flights in both, "
                (count(changes.rerun.len())) " computed again, " (count(failing.len())) " newly failing, "
                (count(changes.new.len())) " only in the second"
                @if !failing_new.is_empty() { " (" (count(failing_new.len())) " failing)" }
                ", " (count(changes.gone.len())) " only in the first."
            }
            (reports(&record.before, &record.now))
            (settings(record))
            (groups(&record.moved_groups))
            h2 { "Flights" }
            @if is_empty(changes) { p { "No flight differs." } }
            (sections(&RunChanges { failing, ..changes.clone() }, &names))
            (names.words("Failing flights only in the second", &failing_new))
            (files(&["diff.json"]))
        }
    };
    let mut site = Site::default();
    site.add("index.html", document(&title, Needs::Nothing, body));
    site
}

fn reports(before: &ComparedReport, now: &ComparedReport) -> Markup {
    let head = [Text("Fact"), Text("First"), Text("Second")];
    let facts = [
        ("Folder", before.folder.clone(), now.folder.clone()),
        ("Campaign", before.name.clone(), now.name.clone()),
        ("Flights", number::count(before.flights), number::count(now.flights)),
        ("flightlag", before.flightlag_version.clone(), now.flightlag_version.clone()),
        ("Analysis", before.analysis_version.to_string(), now.analysis_version.to_string()),
        ("Title of the settings", before.settings.clone(), now.settings.clone()),
        ("Settings BLAKE3", before.settings_blake3.clone(), now.settings_blake3.clone()),
        ("Criteria BLAKE3", hash(before), hash(now)),
    ];
    html! {
        (table("What is compared", &head, html! {
            @for (name, first, second) in &facts {
                tr {
                    th scope="row" { (name) }
                    td.any { (shown(first)) }
                    td.any { @if first == second { "the same" } @else { b { (shown(second)) } } }
                }
            }
        }))
    }
}

fn hash(report: &ComparedReport) -> String {
    report.criteria_blake3.clone().unwrap_or_else(|| "no criteria".to_owned())
}

fn settings(record: &DiffRecord) -> Markup {
    html! {
        @if !record.settings.is_empty() {
            h2 { "Settings that differ" }
            ul { @for line in &record.settings { li { code { (shown(line)) } } } }
        }
    }
}

fn groups(moved: &[MovedDelay]) -> Markup {
    html! {
        @if !moved.is_empty() {
            h2 { "Groups whose delay moved" }
            (moved_table("Mean lateness of groups that moved by more than 2 σ", ["Group", "First (ms)", "Second (ms)"], moved, &|name| html! { (shown(name)) }))
        }
    }
}
