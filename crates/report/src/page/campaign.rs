//! The page of a campaign: all flights, the troubled ones first.

use super::Head::{self, Number, Text};
use super::flight_delay::normalised_difference;
use super::{
    badge, command_block, criteria, data_lost, document, estimate, figure, finding, lateness, maybe, more, no_number,
    pipeline_details, pipeline_rows, plain, reason, table, tail_cut, versions,
};
use crate::draw;
use crate::figure::{Figure, control_chart, overview, pooled_sweep};
use crate::number;
use crate::site::Site;
use crate::text::{href, label, shown};
use crate::verdict::{in_millis, source_word};
use maud::{Markup, html};
use record::{
    CampaignDelay, CampaignRecord, ControlPoint, DelayOverFlights, EffectVerdict, Estimate, Finding, FlightRow,
    Gravity, Outcome, flight_alarms,
};
use std::collections::BTreeMap;

/// Most paths listed under one reason; the record holds all.
const MOST_PATHS: usize = 500;
/// Most flights named as outside their limits.
const MOST_OUTSIDE: usize = 20;

/// The page of a campaign: `index.html`, and its figure again as `figures/overview.svg` if
/// any flight has a correction. [`FlightRow::page`] is a path relative to this page, not yet
/// percent-encoded.
#[must_use]
pub fn campaign_site(record: &CampaignRecord) -> Site {
    let mut site = Site::default();
    let figure = overview(record);
    let of_delay = delay_figures(record, 1 + u32::from(figure.is_some()));
    for figure in figure.iter().chain(&of_delay) {
        site.add(&format!("figures/{}.svg", figure.id), draw::svg_file(figure));
    }
    let title = format!("{} — flightlag campaign", record.name);
    site.add("index.html", document(&title, true, body(record, figure.as_ref(), &of_delay)));
    site
}

/// The chart of the delay from flight to flight, and the score over one delay for all.
fn delay_figures(record: &CampaignRecord, number: u32) -> Vec<Figure> {
    let Some(delay) = &record.delay else { return vec![] };
    let chart = control_chart(delay, number);
    let pooled = pooled_sweep(delay, number + u32::from(chart.is_some()));
    chart.into_iter().chain(pooled).collect()
}

fn body(record: &CampaignRecord, overview: Option<&Figure>, of_delay: &[Figure]) -> Markup {
    html! {
        nav aria-label="On this page" {
            a href="#attention" { "Needs attention" }
            @if record.criteria.is_some() { a href="#criteria" { "Criteria" } } a href="#all" { "All flights" }
            @if let Some(overview) = overview { a href={ "#" (overview.id) } { "Figure" } }
            @if record.delay.is_some() { a href="#delay" { "Position against velocity" } }
            a href="#ignored" { "Inputs not processed" } a href="#provenance" { "Provenance" }
        }
        main {
            h1 { (shown(&record.name)) }
            p.note { (shown(&record.pipeline.title)) }
            (answer(record))
            (stats(record))
            (attention(&record.flights))
            @if let Some(of) = &record.criteria { (criteria::campaign_section(of)) }
            (flights(&record.flights))
            @if let Some(overview) = overview { (figure(overview)) }
            @if let Some(delay) = &record.delay { (delay_section(delay, of_delay)) }
            (ignored(record))
            (provenance(record))
        }
    }
}

fn answer(record: &CampaignRecord) -> Markup {
    let t = &record.totals;
    html! {
        p.answer {
            b { "Helped " (number::count(t.helped)) " of " (number::counted(t.flights, "flight", "flights")) }
            @if t.harmed > 0 { ", " (badge("bad", "✗", "HARMED")) " " b { (number::count(t.harmed)) } }
            @if t.varying > 0 { ", " (number::count(t.varying)) " with a delay that changes" }
            ", " (number::count(t.uncompensated)) " measured with nothing removed, " (number::count(t.not_measurable)) " not measurable, "
            @if t.pending > 0 { (number::count(t.pending)) " pending, " }
            (number::count(t.failed)) " failed, " (number::count(t.lossy)) " with damaged logs; " (number::clock(t.duration_s, 0)) " compensated."
        }
        (lateness::groups(&record.groups))
    }
}

fn stats(record: &CampaignRecord) -> Markup {
    let t = &record.totals;
    html! {
        ul.stats {
            li { b { (number::count(t.flights)) } "flights" }
            li { b { (number::clock(t.duration_s, 0)) } "compensated (h:mm:ss)" }
            (outcome_count(t.helped, "ok", "✓", "helped"))
            (outcome_count(t.harmed, "bad", "✗", "harmed"))
            (outcome_count(t.varying, "unsure", "!", "delay changes"))
            (outcome_count(t.not_measurable, "unsure", "○", "not measurable"))
            (outcome_count(t.failed, "bad", "✗", "failed"))
            (outcome_count(t.lossy, "lost", "▲", "log damaged"))
            li { b { (number::bytes(t.bytes)) } "of logs" }
        }
    }
}

/// A colour warns of something; of no flight at all it would warn of nothing.
fn outcome_count(flights: u64, class: &str, icon: &str, word: &str) -> Markup {
    html! { li { b { (number::count(flights)) } (badge(if flights == 0 { "off" } else { class }, icon, word)) } }
}

/// Failed or lossy flights with their reason; then those that could not be measured.
fn attention(flights: &[FlightRow]) -> Markup {
    let troubled: Vec<&FlightRow> = flights
        .iter()
        .filter(|row| {
            let done = matches!(row.outcome, Outcome::Compensated | Outcome::Uncompensated { .. });
            row.lossy || !row.attention.is_empty() || !done
        })
        .collect();
    let harmed = |row: &FlightRow| row.effect.as_ref().is_some_and(|e| e.verdict == EffectVerdict::Harmed);
    let alarmed = |row: &FlightRow| {
        flight_alarms(row.lateness.as_ref(), row.decision.as_ref()).iter().any(|a| a.gravity == Gravity::Red)
    };
    let rank = |row: &FlightRow| match row.outcome {
        Outcome::Failed { .. } => 0,
        _ if harmed(row) || alarmed(row) => 0,
        Outcome::Compensated | Outcome::Uncompensated { .. } if !row.lossy => 2,
        Outcome::NotMeasurable { .. } | Outcome::Pending { .. } if !row.lossy => 3,
        _ => 1,
    };
    let body = html! {
        @for wanted in 0..4 {
            @for row in troubled.iter().filter(|row| rank(row) == wanted) {
                tr {
                    th scope="row" { (link(row)) }
                    td {
                        (lateness::row_badges(row)) " "
                        (lateness::alarm_badges(&flight_alarms(row.lateness.as_ref(), row.decision.as_ref())))
                    }
                    td.any { (why(row)) }
                }
            }
        }
    };
    let head = [Text("Flight"), Text("Outcome"), Text("Reason")];
    html! {
        h2 #attention { "Needs attention" }
        @if troubled.is_empty() { p { "Nothing: no flight was harmed, no delay has an alarm, and no log is damaged." } }
        @else { (table("Failed, damaged, doubtful, or not measurable", &head, body)) }
    }
}

fn why(row: &FlightRow) -> Markup {
    html! {
        @if let Some(reason) = reason(&row.outcome) { (shown(reason)) " " }
        @if !row.attention.is_empty() {
            ul.plain { @for reason in &row.attention { li { (shown(reason)) } } }
        }
    }
}

fn link(row: &FlightRow) -> Markup {
    html! { a href=(href(&row.page)) { (shown(&row.flight)) } }
}

fn flights(flights: &[FlightRow]) -> Markup {
    let judged = flights.iter().any(|r| r.criteria.is_some());
    html! {
        h2 #all { "All flights" }
        div.scroll tabindex="0" role="region" aria-label="All flights" {
            table.sortable #flights {
                caption { "One row for each flight; ± is U with k = 2. — is a number that the record does not hold." }
                thead { tr { @for column in head(judged) { (column) } } }
                tbody { @for row in flights { (flight_row(row, judged)) } }
            }
        }
    }
}

fn head(judged: bool) -> Vec<Head> {
    let mut head = vec![
        Text("Flight"),
        Text("Effect"),
        Text("Alarms"),
        Text("Kind"),
        Number("Lateness (ms)"),
        Text("Against"),
        Number("Removed (ms)"),
        Text("Removed from"),
        Number("Error before (m)"),
        Number("Error after (m)"),
        Text("Data"),
        Number("Valid (% of time)"),
        Number("Warnings"),
        Number("Duration (h:mm:ss)"),
        Number("Position − velocity (ms)"),
        Number("Correction, 2‑D rms (m)"),
    ];
    if judged {
        head.insert(3, Text("Criteria"));
    }
    head.extend(["Speed, median (m/s)", "Position (Hz)", "Velocity (Hz)"].map(Number));
    head.extend([Text("Map"), Text("Format"), Number("Size")]);
    head
}

fn flight_row(row: &FlightRow, judged: bool) -> Markup {
    html! {
        tr {
            th scope="row" { (link(row)) }
            td { (lateness::result_badge(&row.outcome, row.effect.as_ref())) }
            td { (lateness::alarm_badges(&flight_alarms(row.lateness.as_ref(), row.decision.as_ref()))) }
            @if judged { (criteria::cell(row)) }
            (lateness::lateness_cells(row))
            (cell(row.delay_s, |s| number::significant(s * 1e3, 4)))
            td { (maybe(row.delay_from, |from| html! { (source_word(from)) })) }
            (lateness::effect_cells(row))
            td { (data_word(row)) }
            (share_cell(row.valid_share))
            td.n { (number::count(row.warnings)) }
            (cell(row.duration_s, |s| number::clock(s, 0)))
            (estimate_cell(row.measured_delay_s.as_ref().map(in_millis).as_ref()))
            (estimate_cell(row.correction_rms_m.as_ref()))
            (cell(row.speed_median_mps, |v| number::significant(v, 3)))
            (rate_cell(row.position_rate_hz, row.position.as_deref()))
            (rate_cell(row.velocity_rate_hz, row.velocity.as_deref()))
            td { (maybe(row.map.as_deref(), |map| html! { (shown(map)) })) }
            td { (shown(&row.format)) }
            td.n data-v=(row.bytes) { (number::bytes(row.bytes)) }
        }
    }
}

/// Nothing is known of the data of a flight that failed for another reason.
fn data_word(row: &FlightRow) -> Markup {
    match row.outcome {
        _ if row.lossy => data_lost(),
        Outcome::Failed { .. } | Outcome::Pending { .. } => html! { "—" },
        _ if row.tail_cut_bytes > 0 => tail_cut(),
        _ => html! { "whole" },
    }
}

/// A number that sorts by all its bits and is shown rounded.
fn cell(value: Option<f64>, show: impl FnOnce(f64) -> String) -> Markup {
    match value {
        Some(value) => html! { td.n data-v=(value) { (show(value)) } },
        None => html! { td.n { "—" } },
    }
}

fn rate_cell(rate: Option<f64>, channel: Option<&str>) -> Markup {
    html! {
        td.n data-v=[rate] title=[channel.map(label)] {
            @match rate { Some(rate) => { (number::significant(rate, 3)) } None => { "—" } }
        }
    }
}

fn estimate_cell(value: Option<&Estimate>) -> Markup {
    match value {
        Some(value) => html! { td.n data-v=(value.value) { (number::with_uncertainty(value)) } },
        None => html! { td.n { "—" } },
    }
}

fn share_cell(share: Option<f64>) -> Markup {
    match share.filter(|s| s.is_finite()) {
        Some(share) => {
            let width = format!("--p:{:.0}%", share.clamp(0.0, 1.0) * 100.0);
            html! { td.n.share style=(width) data-v=(share) { (number::percent(share)) } }
        }
        None => html! { td.n { "—" } },
    }
}

/// What the flights say of the delay, together.
fn delay_section(delay: &CampaignDelay, figures: &[Figure]) -> Markup {
    let outside: Vec<&ControlPoint> = delay.control.iter().filter(|p| p.is_outside).collect();
    html! {
        h2 #delay { "Position against velocity over the flights" }
        p.answer {
            "Position later than velocity: "
            (finding(&delay.measured, |found| over_flights(found, delay.card_s.as_ref()))) "."
        }
        p.note {
            "A figure of consistency between flights. How late the position itself is, and what is removed, is above: both differ by \
             what the velocity is late."
        }
        (homogeneity(delay.measured.found()))
        @if delay.measured != delay.swept {
            p { "Best delays of the flights' sweeps: " (finding(&delay.swept, |found| over_flights(found, delay.card_s.as_ref()))) "." }
        }
        @if !outside.is_empty() {
            p.why.unsure {
                (badge("unsure", "!", "Outside")) " Outside three standard uncertainties of the difference: "
                @for (i, point) in outside.iter().take(MOST_OUTSIDE).enumerate() {
                    @if i > 0 { ", " } (shown(&point.flight)) " (" (estimate(&in_millis(&point.delay_s))) "\u{a0}ms)"
                }
                @if outside.len() > MOST_OUTSIDE { ", " (more(outside.len() - MOST_OUTSIDE)) }
                "."
            }
        }
        @for f in figures { (figure(f)) }
        @if let Finding::CannotTell(why) = &delay.curve { p { "One delay for all flights: " (no_number(why)) } }
        p.note {
            "Mean over the flights: random effects (Paule and Mandel), its uncertainty by Hartung, Knapp, Sidik and Jonkman. \
             A flight counts as what it shows of position against velocity, whichever delay was removed from it, or none."
        }
    }
}

fn over_flights(found: &DelayOverFlights, card: Option<&Estimate>) -> Markup {
    let e_n = card.and_then(|card| normalised_difference(&found.delay_s, card));
    html! {
        b { (estimate(&in_millis(&found.delay_s))) "\u{a0}ms" } " over " (number::counted(found.flights, "flight", "flights"))
        @if let Some(between) = found.between_s {
            ", spread between flights beyond their own uncertainties " (plain(between * 1e3, 2)) "\u{a0}ms"
        }
        @if let (Some(card), Some(e_n)) = (card, e_n) {
            "; the sensor card has " (estimate(&in_millis(card))) "\u{a0}ms: "
            @if e_n.abs() <= 1.0 { (badge("ok", "✓", "agrees")) } @else { (badge("bad", "✗", "differs")) }
            ", E_n = " (plain(e_n, 2))
        }
    }
}

fn homogeneity(found: Option<&DelayOverFlights>) -> Markup {
    html! {
        @if let Some(h) = found.and_then(|f| f.homogeneity) {
            p {
                "One difference for all flights: χ² = " (plain(h.chi2, 3)) " with "
                (number::counted(h.degrees_of_freedom, "degree", "degrees")) " of freedom, p = " (plain(h.p, 2)) ": "
                @if h.p < 0.01 { "the flights do not agree." } @else { "nothing speaks against it." }
            }
        }
    }
}

fn ignored(record: &CampaignRecord) -> Markup {
    let mut by_reason: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for input in &record.ignored {
        by_reason.entry(&input.reason).or_default().push(&input.path);
    }
    html! {
        h2 #ignored { "Inputs not processed" }
        @if record.ignored.is_empty() { p { "None: every file in the folder belongs to a flight." } }
        @else { p { (number::counted(record.ignored.len() as u64, "file", "files")) ", by reason:" } }
        @for (reason, paths) in &by_reason {
            details {
                summary { (number::counted(paths.len() as u64, "file", "files")) ": " (shown(reason)) }
                ul.plain {
                    @for path in paths.iter().take(MOST_PATHS) { li { (shown(path)) } }
                    @if let Some(more) = paths.len().checked_sub(MOST_PATHS).filter(|more| *more > 0) {
                        li { "and " (number::count(more as u64)) " more, in the campaign's record (JSON)" }
                    }
                }
            }
        }
    }
}

fn provenance(record: &CampaignRecord) -> Markup {
    let facts = html! {
        (pipeline_rows(&record.pipeline))
        tr {
            th scope="row" { "Versions" }
            td {
                "flightlag " (shown(&record.flightlag_version)) ", "
                (versions(record.record_version, record.analysis_version))
            }
        }
    };
    html! {
        h2 #provenance { "Provenance" }
        (table("Result", &[Text("Item"), Text("Value")], facts))
        (pipeline_details(&record.pipeline))
        h3 { "Make it again" }
        (command_block(&record.command))
        p.note { "The same logs, settings and versions give the same bytes, whatever the number of threads." }
    }
}
