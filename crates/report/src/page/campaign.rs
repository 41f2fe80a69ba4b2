//! The page of a campaign: the answer, what to do, all flights with the gravest first.

mod attention;
mod flights;
mod todo;

use super::Head::Text;
use super::flight_delay::normalised_difference;
use super::{
    Needs, badge, command_block, criteria, document, estimate, figure, finding, lateness, more, no_number,
    pipeline_details, pipeline_rows, plain, table, versions,
};
use crate::figure::{Figure, control_chart, flights_figures, pooled_sweep};
use crate::number;
use crate::site::Site;
use crate::text::shown;
use crate::verdict::in_millis;
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

/// The page of a campaign: `index.html`, and its figures again in `figures/`. [`FlightRow::page`] is a path relative to this page, not yet
/// percent-encoded.
#[must_use]
pub fn campaign_site(record: &CampaignRecord) -> Site {
    let mut site = Site::default();
    let figures = flights_figures(record);
    let of_delay = delay_figures(record, 1 + figures.len() as u32);
    for figure in figures.iter().chain(&of_delay) {
        site.add_figure(figure);
    }
    let title = format!("{} — flightlag campaign", record.name);
    site.add("index.html", document(&title, Needs::Table, body(record, &figures, &of_delay)));
    site
}

/// The chart of the delay from flight to flight, and the score over one delay for all.
fn delay_figures(record: &CampaignRecord, number: u32) -> Vec<Figure> {
    let Some(delay) = &record.delay else { return vec![] };
    let chart = control_chart(delay, number);
    let pooled = pooled_sweep(delay, number + u32::from(chart.is_some()));
    chart.into_iter().chain(pooled).collect()
}

fn body(record: &CampaignRecord, figures: &[Figure], of_delay: &[Figure]) -> Markup {
    html! {
        nav aria-label="On this page" {
            a href="#todo" { "Do this" }
            @for of in figures { a href={ "#" (of.id) } { (of.title) } }
            a href="#attention" { "Needs attention" }
            @if record.criteria.is_some() { a href="#criteria" { "Criteria" } } a href="#all" { "All flights" }
            @if record.delay.is_some() { a href="#delay" { "Position against velocity" } }
            a href="#ignored" { "Inputs not processed" } a href="#provenance" { "Provenance" }
        }
        main {
            h1 { (shown(&record.name)) }
            p.note { (shown(&record.pipeline.title)) }
            (answer(record))
            (todo::todo(record))
            (stats(record))
            @for of in figures { (figure(of)) }
            (attention::attention(&record.flights))
            @if let Some(of) = &record.criteria { (criteria::campaign_section(of)) }
            (flights::table(&record.flights))
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

/// Whether the removal made the flight worse.
fn is_harmed(row: &FlightRow) -> bool {
    row.effect.as_ref().is_some_and(|e| e.verdict == EffectVerdict::Harmed)
}

/// How grave a flight is: 0 is the gravest; flights of one gravity by name.
fn gravity(row: &FlightRow) -> (u8, &str) {
    let alarms = flight_alarms(row.lateness.as_ref(), row.decision.as_ref());
    let any = |gravity| alarms.iter().any(|a| a.gravity == gravity);
    let rank = match row.outcome {
        Outcome::Failed { .. } => 0,
        _ if is_harmed(row) => 1,
        _ if any(Gravity::Red) => 2,
        _ if row.lossy => 3,
        Outcome::NotMeasurable { .. } | Outcome::Pending { .. } => 6,
        _ if any(Gravity::Amber) || !row.attention.is_empty() => 4,
        Outcome::Compensated | Outcome::Uncompensated { .. } => 5,
    };
    (rank, &row.flight)
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
