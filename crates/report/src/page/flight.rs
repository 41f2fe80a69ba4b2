//! The page of one flight.

use super::Head::{Number, Text};
use super::{
    Needs, criteria, document, estimate, explorer, figure, flight_delay, health, lateness, maybe, maybe_estimate,
    method, provenance, reason, rows, score, sweep, table,
};
use crate::draw;
use crate::figure::{Figure, flight_figures};
use crate::number;
use crate::site::Site;
use crate::text::{href, shown, shown_block};
use flight::Distribution;
use maud::{Markup, html};
use record::{CompensatorResult, Effect, Estimate, ExplorerRows, FlightRecord, Outcome, ReplayRecord, flight_alarms};

/// What the page of a flight needs besides the record.
#[derive(Debug, Clone, Copy)]
pub struct FlightPage<'a> {
    /// Path below the campaign's folder: the name people know.
    pub name: &'a str,
    /// What was found.
    pub record: &'a FlightRecord,
    /// The rows of its replay, to zoom into; `None` if there are none.
    pub explorer: Option<&'a ExplorerRows>,
    /// Path of the campaign's page from this one, as `../../index.html`; not encoded yet.
    pub index_href: &'a str,
    /// Names and paths of the pages of the flights before and after this one; not encoded yet.
    pub neighbours: [Option<(&'a str, &'a str)>; 2],
    /// Command that makes this page again.
    pub command: &'a str,
}

/// The page of one flight: `index.html` with its figures inside, and each figure again as a
/// file under `figures/` (`fig-7`, `zoom`, `zoom-difference`, `difference`,
/// `track`, `delay-over-time`, `bands`; those that the record has curves for).
#[must_use]
pub fn flight_site(page: &FlightPage) -> Site {
    let figures = page.record.replay.as_ref().map(flight_figures).unwrap_or_default();
    let delays = flight_delay::of(page.record);
    let over_time = delays.as_ref().and_then(|delays| delays.figure(figures.len() as u32 + 1));
    let explorer = explorer::section(page.record, page.explorer);
    let mut site = Site::default();
    let of_sweep = sweep::figures(page.record, figures.len() as u32 + 1 + u32::from(over_time.is_some()));
    let taken = figures.len() + usize::from(over_time.is_some()) + of_sweep.len();
    let of_bands = score::bands(page.record.replay.as_ref(), taken as u32 + 1);
    for figure in figures.iter().chain(&over_time).chain(&of_sweep).chain(&of_bands) {
        site.add(&format!("figures/{}.svg", figure.id), draw::svg_file(figure));
    }
    site.add(
        "index.html",
        document(
            &format!("{} — flightlag", page.name),
            if explorer.is_some() { Needs::Explorer } else { Needs::Nothing },
            body(page, explorer, &figures, over_time.as_ref(), &of_sweep, of_bands.as_ref()),
        ),
    );
    site
}

fn body(
    page: &FlightPage,
    explorer: Option<Markup>,
    figures: &[Figure],
    over_time: Option<&Figure>,
    of_sweep: &[Figure],
    of_bands: Option<&Figure>,
) -> Markup {
    let record = page.record;
    let delays = flight_delay::of(record);
    html! {
        nav aria-label="Campaign" {
            a href=(href(page.index_href)) { "↑ All flights of the campaign" }
            @for (n, (sign, rel)) in [("← ", "prev"), ("→ ", "next")].into_iter().enumerate() {
                @if let Some((name, path)) = page.neighbours[n] {
                    a rel=(rel) href=(href(path)) { (sign) bdi { (shown(name)) } }
                }
            }
        }
        main {
            h1 { (shown(page.name)) }
            (verdict(record))
            @if let Some(criteria) = &record.criteria { (criteria::strip(criteria)) }
            (first_words(record))
            @if let Some(criteria) = &record.criteria { (criteria::section(criteria)) }
            @if let Some(explorer) = explorer { (explorer) }
            @if let Some(replay) = &record.replay { (results(record, replay, figures)) }
            @if let Some(network) = &record.network { (lateness::network(network)) }
            @if let Some(delays) = &delays { (flight_delay::section(delays, record.lateness.as_ref(), over_time)) }
            @if let Some(replay) = &record.replay { (sweep::section(replay, of_sweep)) }
            @if let Some(replay) = &record.replay { (score::section(replay, record.effect.as_ref(), of_bands)) }
            (health::section(record))
            (health::notices_section(&record.notices))
            @if let Some(replay) = &record.replay { (method::section(record, replay)) }
            (health::binding_section(record.binding.as_ref()))
            (provenance::section(page))
        }
    }
}

fn verdict(record: &FlightRecord) -> Markup {
    html! {
        div.strip role="status" {
            (lateness::result_badge(&record.outcome, record.effect.as_ref()))
            (lateness::alarm_badges(&flight_alarms(record.lateness.as_ref(), record.decision.as_ref())))
            (health::notice_words(&record.notices))
        }
    }
}

/// The reason if there is no result, else the answer.
fn first_words(record: &FlightRecord) -> Markup {
    let class = if matches!(record.outcome, Outcome::Failed { .. }) { "why" } else { "why unsure" };
    html! {
        @if let (Some(reason), None | Some(Outcome::Failed { .. } | Outcome::NotMeasurable { .. } | Outcome::Pending { .. })) =
            (reason(&record.outcome), record.decision.as_ref().map(|_| &record.outcome))
        {
            p class=(class) { (shown_block(reason)) }
        }
        (lateness::answer(record))
        @if record.replay.is_none() && record.outcome == Outcome::Compensated {
            p.why { "The record says compensated, but holds no replay." }
        }
        @if record.has_loss() {
            p { "Data that the logger wrote could not be read. The numbers below are of what could be read; what was \
             lost stands under " a href="#health" { "Data health" } " and " a href="#notices" { "Notices" } "." }
        }
    }
}

/// The delay in ms, with U if the pipeline states an uncertainty.
fn delay(replay: &ReplayRecord) -> Estimate {
    let settings = &replay.settings;
    Estimate {
        value: settings.delay.millis(),
        standard_uncertainty: settings.delay_uncertainty_s.map(|seconds| seconds * 1e3),
    }
}

fn results(record: &FlightRecord, replay: &ReplayRecord, figures: &[Figure]) -> Markup {
    html! {
        h2 { "Key numbers" }
        (key_numbers(record.effect.as_ref(), replay, figures))
        h2 { "Raw and compensated" }
        @if figures.is_empty() { p { "The record holds no curve that could be drawn." } }
        @for f in figures { (figure(f)) }
        (compensators(replay))
    }
}

/// A row of the table of key numbers.
struct KeyNumber {
    name: String,
    figure: &'static str,
    value: String,
    expanded: Option<String>,
    unit: &'static str,
    note: String,
}

impl KeyNumber {
    fn estimated(name: String, figure: &'static str, estimate: &Estimate, unit: &'static str, why_none: &str) -> Self {
        let (value, expanded) = number::measured(estimate.value, estimate.standard_uncertainty);
        let note = if expanded.is_none() { why_none.to_owned() } else { String::new() };
        KeyNumber { name, figure, value, expanded, unit, note }
    }

    fn plain(name: &str, value: String, unit: &'static str, note: impl Into<String>) -> Self {
        KeyNumber { name: name.to_owned(), figure: "", value, expanded: None, unit, note: note.into() }
    }
}

fn key_numbers(effect: Option<&Effect>, replay: &ReplayRecord, figures: &[Figure]) -> Markup {
    let numbers: Vec<KeyNumber> = result_numbers(effect, replay).into_iter().chain(coverage_numbers(replay)).collect();
    let row = |number: &KeyNumber| {
        html! {
            tr {
                th scope="row" {
                    (shown(&number.name))
                    @if let Some(f) = figures.iter().find(|f| f.id == number.figure) {
                        " (" a href={ "#" (f.id) } { "Figure\u{a0}" (f.number) } ")"
                    }
                }
                td.n { (number.value) }
                td.n { (maybe(number.expanded.as_ref(), |u| html! { "±\u{a0}" (u) })) }
                td { (number.unit) }
                td.any { (shown(&number.note)) }
            }
        }
    };
    let head = [Text("Quantity"), Number("Value"), Number("U (k = 2)"), Text("Unit"), Text("Note")];
    table(
        "U is the expanded uncertainty with k = 2; — where the analysis gives none. See Method for what it covers",
        &head,
        rows(&numbers, 60, head.len(), row),
    )
}

fn result_numbers(effect: Option<&Effect>, replay: &ReplayRecord) -> Vec<KeyNumber> {
    let td = "Delay removed, Td".to_owned();
    let mut numbers =
        vec![KeyNumber::estimated(td, "zoom", &delay(replay), "ms", "the pipeline states no uncertainty of Td")];
    let mut push = |name, figure, e: &Estimate| numbers.push(KeyNumber::estimated(name, figure, e, "m", ""));
    if let Some(effect) = effect {
        for (what, error) in [("before", &effect.error_raw_m), ("after", &effect.error_compensated_m)] {
            if let Some(error) = error {
                push(format!("Error {what} compensation, fixes at their own timestamps, 2‑D rms"), "", error);
            }
        }
    }
    for c in replay.compensators.iter().skip(1) {
        push(format!("Raw − {}, 2‑D rms", c.title), "zoom-difference", &c.raw_minus_this_rms_m);
    }
    push(
        "Way flown in Td and the age of the fix, from velocity, 2‑D rms".to_owned(),
        "zoom-difference",
        &replay.predicted_rms_m,
    );
    for c in &replay.compensators {
        if let Some(error) = &c.error_rms_m {
            push(format!("Error against the reference, {}, with the age of held fixes, 2‑D rms", c.title), "", error);
        }
    }
    numbers
}

fn coverage_numbers(replay: &ReplayRecord) -> Vec<KeyNumber> {
    let c = &replay.coverage;
    let Distribution { p01, median, p99, .. } = replay.speed_mps;
    let three = |value| number::significant(value, 3);
    let share = if c.duration_s > 0.0 { number::percent(c.valid_s / c.duration_s) } else { "—".to_owned() };
    let fixes = number::counted(c.fixes, "position fix", "position fixes");
    let speeds = format!("1 % of the rows below {}, 1 % above {} m/s", three(p01), three(p99));
    let resets =
        "fixes that jump against integrated velocity by more than 5 σ of the fixes around: passed on and counted";
    let bridge = format!("gaps up to {} s", three(replay.settings.bridge_s));
    vec![
        KeyNumber::plain("Time covered", number::clock(c.duration_s, 0), "h:mm:ss", fixes),
        KeyNumber::plain("Share of that time with a valid compensated position", share, "%", valid_note(replay)),
        KeyNumber::plain("Ground speed, median", three(median), "m/s", speeds),
        KeyNumber::plain("Longest time without a position fix", three(c.longest_position_gap_s), "s", ""),
        KeyNumber::plain("Position resets", number::count(c.position_resets), "1", resets),
        KeyNumber::plain("Velocity gaps bridged", number::count(c.bridged_gaps), "1", bridge),
        KeyNumber::plain("Restarts after longer velocity gaps", number::count(c.restarts), "1", ""),
    ]
}

/// A share of the time that is worth a word.
const NOTABLE: f64 = 0.01;

fn valid_note(replay: &ReplayRecord) -> String {
    let c = &replay.coverage;
    let mut note = format!("{} of {} rows", number::count(c.valid_rows), number::count(c.rows));
    for reject in c.invalid.iter().take(10) {
        note += &format!("; {}: {} (first: {})", reject.reason, number::count(reject.count), reject.first);
    }
    let of_rows = c.valid_rows as f64 / c.rows.max(1) as f64;
    if c.valid_s < (of_rows - NOTABLE) * c.duration_s {
        note += "; the rest of the time has no rows";
    }
    note
}

fn compensators(replay: &ReplayRecord) -> Markup {
    let scored = replay.compensators.iter().any(|c| c.error_rms_m.is_some() || c.error_p95_m.is_some());
    let mut head = vec![
        Text("Compensator"),
        Number("Delay given (ms)"),
        Number("Raw − this, 2‑D rms (m)"),
        Number("Step at a fix, 2‑D rms (m)"),
    ];
    if scored {
        head.extend([
            Number("Error against reference with the age of held fixes, 2‑D rms (m)"),
            Number("95th percentile (m)"),
        ]);
    }
    let row = |c: &CompensatorResult| {
        html! {
            tr {
                th scope="row" { (shown(&c.title)) " " code { (shown(&c.name)) } }
                td.n { (number::significant(c.delay.millis(), 4)) }
                td.n { (estimate(&c.raw_minus_this_rms_m)) }
                td.n { (maybe_estimate(c.step_at_fix_rms_m.as_ref())) }
                @if scored {
                    td.n { (maybe_estimate(c.error_rms_m.as_ref())) }
                    td.n { (maybe_estimate(c.error_p95_m.as_ref())) }
                }
            }
        }
    };
    html! {
        (table("Compensators; ± is U with k = 2", &head, rows(&replay.compensators, 20, head.len(), row)))
        p.note {
            "Step at a fix: how far the output jumps when the next fix arrives. Small is good: the fix says what the \
             compensator had foreseen. "
            @if !scored { "No errors are given: the log holds no reference to score against. " }
            "— is a number that the record does not hold."
        }
    }
}
