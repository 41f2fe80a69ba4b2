//! Results of the criteria, for the page of a flight and for all flights of a campaign.

use super::Head::{Number, Text};
use super::{badge, maybe, more, rows, table};
use crate::criterion::{criterion_interval, criterion_value, criterion_why, criterion_word, limit};
use crate::number;
use crate::text::{ended, shown, shown_block};
use maud::{Markup, html};
use record::{
    CampaignCriteria, CriteriaUse, CriterionFinding, CriterionSummary, CriterionVerdict, FlightCriteria, FlightRow,
    PassRate, VerdictTally,
};

/// Maximum number of titles in a line; the table below has more.
const MOST_IN_A_LINE: usize = 20;
/// Maximum number of rows in a table; the record has all.
const MOST_ROWS: usize = 100;
/// Maximum number of flight names in a cell.
const MOST_NAMES: usize = 5;

const RULE: &str = "Decision rule. PASS: the whole 95\u{a0}% interval of the number lies within the limit (limits \
                    themselves are within). FAIL: all of it lies beyond. INCONCLUSIVE: it crosses the limit, or is \
                    unknown. The interval is that of the analysis if it gives one, otherwise value ± U with k = 2. \
                    Numbers without an uncertainty (counts, shares of time, facts of the log) are compared as they \
                    are, and the table says so; so are those whose criterion says decision = \"value\". NOT EVALUATED: \
                    there is no such number. NOT APPLICABLE: the criterion is not meant for this flight.";

fn verdict_badge(verdict: CriterionVerdict, count: Option<u64>) -> Markup {
    let (class, icon) = look(verdict);
    let word = criterion_word(verdict);
    badge(class, icon, &count.map_or_else(|| word.to_owned(), |n| format!("{} {word}", number::count(n))))
}

// A flight

/// Number of criteria with each verdict, for the head of the page.
pub(super) fn chips(criteria: &FlightCriteria) -> Markup {
    html! { a.chips href="#criteria" { (counts(&criteria.tally())) } }
}

/// A verdict in a narrow cell.
pub(super) fn verdict_cell(verdict: Option<CriterionVerdict>, flight: &str) -> Markup {
    match verdict {
        None => html! { td.off { "" } },
        Some(verdict) => {
            let (class, icon) = look(verdict);
            let name = format!("{flight}: {}", criterion_word(verdict));
            html! { td class=(class) title=(name) aria-label=(criterion_word(verdict)) { (icon) } }
        }
    }
}

fn look(verdict: CriterionVerdict) -> (&'static str, &'static str) {
    match verdict {
        CriterionVerdict::Fail => ("bad", "✗"),
        CriterionVerdict::Inconclusive => ("unsure", "?"),
        CriterionVerdict::NotEvaluated => ("off", "○"),
        CriterionVerdict::Pass => ("ok", "✓"),
        CriterionVerdict::NotApplicable => ("off", "–"),
    }
}

fn counts(tally: &VerdictTally) -> Markup {
    html! { @for (verdict, n) in tally.by_verdict() { @if n > 0 { (verdict_badge(verdict, Some(n))) } } }
}

fn gravest_first(criteria: &FlightCriteria) -> Vec<&CriterionFinding> {
    let mut sorted: Vec<&CriterionFinding> = criteria.findings.iter().collect();
    sorted.sort_by_key(|finding| finding.verdict);
    sorted
}

/// Failed and inconclusive criteria first. The others follow in one line for each verdict and reason, with their
/// numbers collapsed.
pub(super) fn section(criteria: &FlightCriteria) -> Markup {
    let is_quiet = |v: CriterionVerdict| !matches!(v, CriterionVerdict::Fail | CriterionVerdict::Inconclusive);
    let (quiet, loud): (Vec<_>, Vec<_>) = gravest_first(criteria).into_iter().partition(|f| is_quiet(f.verdict));
    html! {
        h2 id="criteria" { "Criteria" }
        @if !loud.is_empty() { (findings("Criteria that are not met, the most severe first", &loud)) }
        (not_evaluated(&quiet))
        (in_a_line(&quiet, CriterionVerdict::Pass))
        (in_a_line(&quiet, CriterionVerdict::NotApplicable))
        @if !quiet.is_empty() {
            details { summary { "Numbers of these" } (findings("Criteria that are met, not evaluated, or not meant for this flight", &quiet)) }
        }
        details {
            summary { "How verdicts are decided" }
            p.note { (RULE) }
            (file_line(&criteria.criteria))
        }
    }
}

fn findings(caption: &str, findings: &[&CriterionFinding]) -> Markup {
    let head = [
        Text("Criterion"),
        Number("Value"),
        Number("U (k\u{a0}=\u{a0}2)"),
        Number("95 % interval"),
        Number("Limit"),
        Text("Verdict"),
        Text("Why"),
    ];
    table(caption, &head, rows(findings, MOST_ROWS, head.len(), |finding| finding_row(finding)))
}

/// Criteria without a number, each reason once.
fn not_evaluated(of: &[&CriterionFinding]) -> Markup {
    let mut by_reason: Vec<(&str, Vec<&CriterionFinding>)> = vec![];
    for finding in of.iter().copied().filter(|f| f.verdict == CriterionVerdict::NotEvaluated) {
        match by_reason.iter_mut().find(|(reason, _)| *reason == finding.reason) {
            Some((_, findings)) => findings.push(finding),
            None => by_reason.push((&finding.reason, vec![finding])),
        }
    }
    html! {
        @for (reason, findings) in by_reason.iter().take(MOST_IN_A_LINE) {
            p { (titles(findings, CriterionVerdict::NotEvaluated)) ": " (ended(reason)) }
        }
    }
}

/// The titles of the criteria with one verdict.
fn in_a_line(of: &[&CriterionFinding], verdict: CriterionVerdict) -> Markup {
    let those: Vec<&CriterionFinding> = of.iter().copied().filter(|f| f.verdict == verdict).collect();
    html! { @if !those.is_empty() { p { (titles(&those, verdict)) "." } } }
}

fn titles(of: &[&CriterionFinding], verdict: CriterionVerdict) -> Markup {
    html! {
        (verdict_badge(verdict, Some(of.len() as u64))) " "
        @for (i, finding) in of.iter().take(MOST_IN_A_LINE).enumerate() { @if i > 0 { "; " } (shown(&finding.title)) }
        @if of.len() > MOST_IN_A_LINE { "; " (more(of.len() - MOST_IN_A_LINE)) }
    }
}

fn finding_row(finding: &CriterionFinding) -> Markup {
    let value = criterion_value(finding);
    let with_unit = |text: &str| html! { (text) "\u{a0}" (shown(&finding.unit.name)) };
    let bits = finding.value.map(|v| v.value).filter(|v| v.is_finite());
    html! {
        tr {
            th scope="row" {
                (shown(&finding.title))
                div.note { @match shown_at(&finding.metric) {
                    Some(part) => { a href=(part) { (shown(&finding.quantity)) } }
                    None => { (shown(&finding.quantity)) }
                } }
            }
            td.n { (maybe(value.as_ref(), |(v, _)| html! { data value=[bits] { (with_unit(v)) } })) }
            td.n { (maybe(value.as_ref().and_then(|(_, u)| u.as_ref()), |u| html! { "±\u{a0}" (with_unit(u)) })) }
            td.n { (maybe(criterion_interval(finding), |i| with_unit(&i))) }
            td.n { (limit(finding)) }
            td { (verdict_badge(finding.verdict, None)) }
            td.any { (shown_block(&criterion_why(finding))) div.note { "Limit: " (shown_block(&finding.rationale)) } }
        }
    }
}

/// The section of the flight's page with details of a metric.
fn shown_at(metric: &str) -> Option<&'static str> {
    const OF_LOG: [&str; 4] = ["damaged", "undecodable", "channel-", "-rate"];
    match metric {
        "losses" | "warnings" => Some("#notices"),
        _ if OF_LOG.iter().any(|part| metric.contains(part)) => Some("#health"),
        _ if metric.starts_with("residual") => None,
        _ if metric.contains("delay") || ["injection-error", "moving-share"].contains(&metric) => Some("#delay"),
        _ => None,
    }
}

fn file_line(used: &CriteriaUse) -> Markup {
    html! {
        p.note {
            (shown(&used.title)) ", from " code { (shown(&used.file)) } ", criteria fingerprint (comments ignored), BLAKE3 "
            code.hash { (shown(&used.blake3)) } ". Changing a limit needs no new analysis."
        }
        details {
            summary { "Criteria as they were used (TOML)" }
            pre tabindex="0" { code { (shown_block(&used.toml)) } }
        }
    }
}

// All flights

/// The verdict of a flight in the table of flights.
pub(super) fn cell(row: &FlightRow) -> Markup {
    let tally: VerdictTally = row.criteria.iter().flat_map(|c| &c.each).map(|v| v.verdict).collect();
    let of_all = tally.by_verdict().iter().map(|(_, n)| n).sum::<u64>();
    // Sort by the most severe verdict, then by how frequent it is.
    let rank = row.criteria.as_ref().map(|c| {
        let place = tally.by_verdict().iter().position(|(v, _)| *v == c.overall).unwrap_or(0);
        let count = tally.by_verdict().get(place).map_or(0, |(_, n)| *n);
        1000 * place as u64 + of_all - count
    });
    html! {
        td.w data-v=[rank] {
            @match &row.criteria {
                Some(criteria) => {
                    b class=(look(criteria.overall).0) { (look(criteria.overall).1) " " (criterion_word(criteria.overall)) } " "
                    (tally.by_verdict().iter().find(|(v, _)| *v == criteria.overall).map_or(0, |(_, n)| *n)) "/" (of_all)
                }
                None => { "—" }
            }
        }
    }
}

/// Pass rates and failing flights.
pub(super) fn campaign_section(criteria: &CampaignCriteria, matrix: Markup) -> Markup {
    let head = [
        Text("Criterion"),
        Number("Limit"),
        Number("PASS"),
        Number("FAIL"),
        Number("INCONCLUSIVE"),
        Number("NOT EVALUATED"),
        Number("NOT APPLICABLE"),
        Number("Pass rate (95 % interval)"),
        Text("Flights that fail"),
    ];
    html! {
        h2 id="criteria" { "Criteria" }
        p.answer { (flights_sentence(criteria)) }
        @for of in criteria.each.iter().take(MOST_ROWS) { @if let Some(reason) = &of.never_evaluated {
            p { (verdict_badge(CriterionVerdict::NotEvaluated, None)) " No flight has the number of " b { (shown(&of.title)) }
                ": " (ended(reason)) }
        } }
        div.strip role="group" aria-label="Flights by their most severe verdict" { (counts(&criteria.flights)) }
        (matrix)
        (table("Flights by verdict", &head, rows(&criteria.each, MOST_ROWS, head.len(), summary_row)))
        p.note { (RULE) }
        p.note {
            "A flight's own verdict is its most severe one. Pass rate: flights that pass, of those that pass, fail or \
             are inconclusive; its interval (Wilson 1927) is for flights like these."
        }
        (file_line(&criteria.criteria))
    }
}

fn flights_sentence(criteria: &CampaignCriteria) -> Markup {
    let VerdictTally { not_evaluated, not_applicable, .. } = criteria.flights;
    let left_out = not_evaluated + not_applicable;
    html! {
        @match &criteria.pass_rate {
            Some(rate) => {
                b { (number::count(rate.passed)) " of " (number::counted(rate.judged, "judged flight", "judged flights")) }
                " meet every criterion that applies: " (pass_rate(rate)) "."
            }
            None => { "No flight could be judged in full." }
        }
        @if left_out > 0 && criteria.pass_rate.is_some() { " " (number::counted(left_out, "flight", "flights")) " could not be judged in full." }
    }
}

fn pass_rate(rate: &PassRate) -> Markup {
    let [low, high] = rate.interval_95.map(|share| number::fixed(share * 100.0, 0));
    let share = rate.passed as f64 / rate.judged as f64;
    html! { data value=(share) { (number::fixed(share * 100.0, 0)) "\u{a0}%" } " (" (low) " to " (high) "\u{a0}%)" }
}

fn summary_row(of: &CriterionSummary) -> Markup {
    let VerdictTally { fail, inconclusive, not_evaluated, pass, not_applicable } = of.tally;
    html! {
        tr {
            th scope="row" { (shown(&of.title)) div.note { (shown(&of.metric)) } }
            td.n { (shown(&of.limit)) }
            @for n in [pass, fail, inconclusive, not_evaluated, not_applicable] { td.n { (number::count(n)) } }
            td.n { (maybe(of.pass_rate.as_ref(), pass_rate)) }
            td.any {
                @for (i, name) in of.failed.iter().take(MOST_NAMES).enumerate() { @if i > 0 { ", " } (shown(name)) }
                @if of.failed.len() > MOST_NAMES { ", " (more(of.failed.len() - MOST_NAMES)) }
            }
        }
    }
}
