//! The page of a nightly run, to be read in the morning.

use super::Head::{Number, Text};
use super::run_changes::{Names, is_empty, sections};
use super::{Needs, badge, document, estimate, maybe_estimate, number, table};
use crate::site::Site;
use crate::text::{ended, href, shown};
use crate::verdict::in_millis;
use maud::{Markup, html};
use record::{NightCampaign, NightRecord, ProofVerdict, SettingProof};

/// The page of a night as `index.html`, with its figures. `base` leads from the page to the folder of the reports, such
/// as `../../`.
#[must_use]
pub fn night_site(record: &NightRecord, base: &str) -> Site {
    let mut site = Site::default();
    let names = Names { base, all: "night.json" };
    let title = format!("{} — {}", record.title, record.run_id);
    let folder = if base.is_empty() { format!("nights/{}/", record.run_id) } else { String::new() };
    let body = html! {
        nav aria-label="Pages" {
            @for campaign in &record.campaigns { (link(campaign, base)) }
        }
        main {
            h1 { (shown(&record.title)) ": " (shown(&record.run_id)) }
            div.strip { (exit(record)) }
            ul { @for line in &record.summary { li { (shown(line)) } } }
            (problems(record))
            h2 { "Campaigns" }
            (campaigns(&record.campaigns, base))
            (groups(record))
            (new_trends(record, &names))
            (settings(record, &names))
            h2 { "What changed since " @match &record.before { Some(run) => { (shown(run)) } None => { "the beginning" } } }
            @if is_empty(&record.changes) { p { "Nothing changed" @if let Some(unread) = unread(record) { " in the other campaigns. Unknown for " (shown(&unread)) } "." } }
            (sections(&record.changes, &names))
            (left(record))
            h2 { "Trends" }
            @if record.new_trend_changes.is_empty() { p { "No new change." } }
            (super::trend::charts(&record.trend, &names, &mut site))
            p.note {
                "Files of this night: "
                @for (i, name) in ["night.json", "summary.txt", "summary.json", "summary.md", "summary.xml"].iter().enumerate() {
                    @if i > 0 { ", " }
                    a href={ (href(&folder)) (name) } download="" { (name) }
                }
                ". It took " (number::significant(record.seconds, 2)) " s with flightlag " (shown(&record.flightlag_version)) "."
            }
        }
    };
    site.add("index.html", document(&title, Needs::Nothing, body));
    site
}

/// The name of a campaign, linked to its report if it has one.
fn link(campaign: &NightCampaign, base: &str) -> Markup {
    html! {
        @if campaign.report.is_empty() { (shown(&campaign.name)) }
        @else { a href={ (base) (href(&campaign.report)) } { (shown(&campaign.name)) } }
    }
}

/// The exit code in words. A campaign that could not be read is worse than what the code says of the others.
fn exit(record: &NightRecord) -> Markup {
    let code = record.exit;
    let (class, icon, word) = match code {
        75 if record.campaigns.iter().any(|c| c.error.is_some()) => {
            ("bad", "✗", "a campaign could not be read: run again")
        }
        0 => ("ok", "✓", "all well"),
        3 => ("unsure", "▲", "finished, look at the list below"),
        4 => {
            ("bad", "✗", "a criterion failed, a flight was harmed, or a setting did not remove the delay as predicted")
        }
        75 => ("unsure", "○", "a part was not possible now: run again"),
        _ => ("bad", "✗", "a campaign failed"),
    };
    html! { (badge(class, icon, &format!("exit {code}: {word}"))) }
}

/// Names of the campaigns that could not be read.
fn unread(record: &NightRecord) -> Option<String> {
    let names: Vec<&str> = record.campaigns.iter().filter(|c| c.error.is_some()).map(|c| c.name.as_str()).collect();
    (!names.is_empty()).then(|| names.join(", "))
}

fn problems(record: &NightRecord) -> Markup {
    html! {
        @for campaign in &record.campaigns {
            @if let Some(error) = &campaign.error { p.why { b { (shown(&campaign.name)) ": " } (shown(error)) } }
        }
        @for problem in &record.problems { p.why { (shown(problem)) } }
    }
}

fn campaigns(all: &[NightCampaign], base: &str) -> Markup {
    let head = [
        Text("Campaign"),
        Number("Flights"),
        Number("Helped"),
        Number("Harmed"),
        Number("Not measurable"),
        Number("Failed"),
        Number("Logs damaged"),
        Number("Fail a criterion"),
        Number("Exit"),
        Text("Logs"),
    ];
    let count = |campaign: &NightCampaign, of: fn(&record::CampaignTotals) -> u64| {
        campaign.totals.as_ref().map_or_else(|| "—".to_owned(), |totals| number::count(of(totals)))
    };
    html! {
        (table("Campaigns of this night", &head, html! {
            @for campaign in all {
                tr {
                    th scope="row" { (link(campaign, base)) }
                    td.n { (count(campaign, |t| t.flights)) }
                    td.n { (count(campaign, |t| t.helped)) }
                    td.n { (count(campaign, |t| t.harmed)) }
                    td.n { (count(campaign, |t| t.not_measurable)) }
                    td.n { (count(campaign, |t| t.failed)) }
                    td.n { (count(campaign, |t| t.lossy)) }
                    td.n { @if campaign.totals.is_some() { (number::count(campaign.criteria_failed)) } @else { "—" } }
                    td.n { (campaign.exit) }
                    td.any {
                        (shown(&campaign.flights))
                        @if campaign.nothing_changed { " (nothing changed)" }
                        @if campaign.error.is_some() && !campaign.report.is_empty() { " (the report is that of an earlier night)" }
                    }
                }
            }
        }))
    }
}

fn left(record: &NightRecord) -> Markup {
    html! {
        @if !record.left.is_empty() {
            h3 { "Left for the next night: " (number::count(record.left.len() as u64)) }
            ul { @for log in &record.left { li { bdi { (shown(&format!("{}/{}", log.campaign, log.path))) } ": " (shown(&log.reason)) } } }
        }
    }
}

/// Groups for which no single value can be recommended.
fn groups(record: &NightRecord) -> Markup {
    html! {
        @if !record.groups.is_empty() {
            h2 { "Flights that differ" }
            @for group in &record.groups {
                p.why.unsure {
                    b { @if group.is_new { "New: " } (shown(&group.campaign)) ", " (shown(&group.group)) } ": " (ended(&group.words))
                }
            }
        }
    }
}

fn verdict(verdict: ProofVerdict) -> Markup {
    match verdict {
        ProofVerdict::Pass => badge("ok", "✓", verdict.word()),
        ProofVerdict::Fail => badge("bad", "✗", verdict.word()),
        ProofVerdict::CannotTell => badge("unsure", "?", verdict.word()),
        ProofVerdict::NotSet => badge("off", "○", verdict.word()),
    }
}

/// Recommended settings, with the predicted and the measured residual side by side.
fn settings(record: &NightRecord, names: &Names<'_>) -> Markup {
    let head = [
        Text("Parameter"),
        Text("Of"),
        Number("Residual before (ms)"),
        Number("Predicted (ms)"),
        Number("Measured (ms)"),
        Number("Flights"),
        Text("Verdict"),
        Text("In words"),
    ];
    let millis = |estimate: Option<record::Estimate>| estimate.map(|e| in_millis(&e));
    let row = |proof: &SettingProof| {
        html! {
            tr {
                th scope="row" { code { (shown(&proof.parameter)) } }
                td { (shown(&format!("{} {}", proof.campaign, proof.of))) }
                td.n { (maybe_estimate(millis(proof.before_s).as_ref())) }
                td.n { (estimate(&in_millis(&proof.predicted_s))) }
                td.n { (maybe_estimate(millis(proof.measured_s).as_ref())) }
                td.n { (number::count(proof.flights.len() as u64)) }
                td { (verdict(proof.verdict)) }
                td.any {
                    (shown(&proof.words))
                    @for (i, flight) in proof.flights.iter().take(5).enumerate() { @if i == 0 { " " } @else { ", " } (names.flight(flight)) }
                }
            }
        }
    };
    html! {
        @if !record.proofs.is_empty() {
            h2 { "Set this, then prove it" }
            (table("Recommended settings and the flights after them", &head, html! { @for proof in &record.proofs { (row(proof)) } }))
            p.note {
                "The residual is the lateness of the position minus the parameter: what the autopilot does not account \
                 for. The prediction follows from the flights before the setting, the measurement from those after it. \
                 ± is U with k = 2."
            }
        }
    }
}

/// Changes of trends that the night before did not show, or that this one shows no more.
fn new_trends(record: &NightRecord, names: &Names<'_>) -> Markup {
    let is_known = record.new_trend_changes.is_empty() && record.withdrawn_trend_changes.is_empty();
    html! {
        @if !is_known { h2 { "Trends that changed" } }
        @for old in &record.withdrawn_trend_changes {
            p.why.unsure {
                b { "Withdrawn: " (shown(&old.chart)) } ": " (estimate(&in_millis(&old.change.step_s))) " ms from "
                (names.flight(&old.change.at)) " on, of the previous night. With the flights since then, no change is "
                "found at this flight. A single flight that is far off can do this, and so can another change near it: "
                "see " code { "flightlag trend" } "."
            }
        }
        @for new in &record.new_trend_changes {
            p.why.unsure {
                b { "New: " (shown(&new.chart)) } ": " (estimate(&in_millis(&new.change.step_s))) " ms from "
                (names.flight(&new.change.at)) " on"
                @if !new.change.with_it.is_empty() { "; with it " (shown(&new.change.with_it.join("; "))) }
                "."
            }
        }
    }
}
