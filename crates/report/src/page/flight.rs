//! The page of one flight: the answer, what to do, the evidence, the method and the provenance, in this order.

use super::Head::{Number, Text};
use super::{
    Needs, anomalies, contents, criteria, document, estimate, explorer, figure, flight_delay, health, lateness,
    maybe_estimate, method, provenance, rows, score, sweep, table, test_card,
};
use crate::figure::{Figure, THUMBNAIL, flight_figures, thumbnail, timeline};
use crate::number;
use crate::site::Site;
use crate::text::{href, shown, shown_block};
use flight::Distribution;
use maud::{Markup, html};
use record::{CompensatorResult, Coverage, ExplorerRows, FlightRecord, Outcome, ReplayRecord, flight_alarms};

/// What the page of a flight needs besides the record.
#[derive(Debug, Clone, Copy)]
pub struct FlightPage<'a> {
    /// Path below the campaign's folder: the name that users know.
    pub name: &'a str,
    /// Results of the analysis.
    pub record: &'a FlightRecord,
    /// Whether `details.json.gz` is in the folder of this page.
    pub has_details: bool,
    /// The rows of its replay for the explorer; `None` if there are no rows.
    pub explorer: Option<&'a ExplorerRows>,
    /// Path of its track relative to this page; `None` if it has no track.
    pub track_href: Option<&'a str>,
    /// Path of the campaign's page relative to this page, such as `../../index.html`; not yet percent-encoded.
    pub index_href: &'a str,
    /// Names and page paths of the previous and the next flight; not yet percent-encoded.
    pub neighbours: [Option<(&'a str, &'a str)>; 2],
    /// Command that regenerates this page.
    pub command: &'a str,
}

/// The page of one flight: `index.html` with its figures inline, and each figure also in `figures/` as SVG and CSV
/// (`fig-7`, `turn`, `lead`, `track`, `delay-over-time`, `delay-sweep`, `delay-objective`, `bands`, `budget`,
/// `timeline`). A figure without data in the record is omitted.
#[must_use]
pub fn flight_site(page: &FlightPage) -> Site {
    let figures = Figures::of(page.record);
    let mut site = Site::default();
    figures.0.iter().for_each(|figure| site.add_figure(figure));
    let anomalies = anomalies::of(page.record);
    let explorer = explorer::section(page.record, page.explorer, &anomalies);
    let needs = if explorer.is_some() { Needs::Explorer } else { Needs::Nothing };
    let body = body(page, explorer.as_ref(), &figures, &anomalies);
    site.add("index.html", document(&format!("{} — flightlag", page.name), needs, body));
    site
}

/// The figures of the page, numbered in page order.
struct Figures(Vec<Figure>);

impl Figures {
    fn of(record: &FlightRecord) -> Figures {
        let mut all = flight_figures(record);
        all.extend(flight_delay::of(record).and_then(|delays| delays.figure()));
        all.extend(sweep::figures(record));
        all.extend(score::figures(record.replay.as_ref()));
        all.extend(timeline(record));
        (1..).zip(&mut all).for_each(|(number, figure)| figure.number = number);
        Figures(all)
    }

    fn get(&self, id: &str) -> Option<&Figure> {
        self.0.iter().find(|figure| figure.id == id)
    }

    /// The figures with these names, in this order.
    fn show(&self, ids: &[&str]) -> Markup {
        html! { @for f in ids.iter().filter_map(|id| self.get(id)) { (figure(f)) } }
    }
}

fn body(page: &FlightPage, explorer: Option<&Markup>, figures: &Figures, anomalies: &[anomalies::Anomaly]) -> Markup {
    let record = page.record;
    let delays = flight_delay::of(record);
    html! {
        (campaign_links(page))
        main #main {
            @if let Some(lead) = record.drawable().and_then(|r| r.lead.as_ref()) { (track_link(&lead.track)) }
            h1 { bdi { (shown(page.name)) } }
            (facts(record))
            (test_card::flight_line(record.test.as_ref()))
            (chips(record))
            (first_words(record))
            (on_this_page(record))
            @if let Some(criteria) = &record.criteria { (criteria::section(criteria)) }
            @if let Some(replay) = record.drawable() { (evidence(replay, record.replay.is_none(), explorer, figures)) }
            @if let Some(network) = &record.network { (lateness::network(network)) }
            @if let Some(delays) = &delays { (flight_delay::section(delays, record.lateness.as_ref(), figures.get("delay-over-time"))) }
            @if let Some(replay) = &record.replay {
                (sweep::section(replay, &figures.show(&["delay-sweep", "delay-objective"])))
                (compensators(replay))
                (score::section(replay, record.effect.as_ref(), &figures.show(&["budget"]), &figures.show(&["bands"])))
            }
            (health::section(record, &figures.show(&["timeline"])))
            @if record.log.is_some() { (anomalies::section(record, anomalies, explorer.is_some())) }
            (health::notices_section(&record.notices))
            @if let Some(replay) = &record.replay { (method::section(record, replay)) }
            (health::binding_section(record.binding.as_ref()))
            (test_card::flight_section(record.test.as_ref()))
            (provenance::section(page))
        }
    }
}

fn campaign_links(page: &FlightPage) -> Markup {
    html! {
        nav aria-label="Campaign" {
            a.skip href="#main" { "Skip to the answer" }
            a href=(href(page.index_href)) { "↑ All flights of the campaign" }
            @for (n, (sign, rel)) in [("← ", "prev"), ("→ ", "next")].into_iter().enumerate() {
                @if let Some((name, path)) = page.neighbours[n] {
                    a rel=(rel) href=(href(path)) { (sign) bdi { (shown(name)) } }
                }
            }
        }
    }
}

/// A small ground track, coloured by lead.
fn track_link(track: &record::LeadTrack) -> Markup {
    let paths = thumbnail(track);
    let (width, height) = THUMBNAIL;
    html! {
        @if !paths.is_empty() {
            a.thumb href="#evidence" {
                svg viewBox={ "0 0 " (width) " " (height) } width=(width) height=(height) role="img" aria-label="Ground track, coloured by lead; to the evidence" {
                    @for (colour, d) in &paths { path style={ "stroke:var(--lead-" (colour) ")" } d=(d) {} }
                }
            }
        }
    }
}

/// Receiver, date, duration and place in a line below the name.
fn facts(record: &FlightRecord) -> Markup {
    let receiver = record.lateness.as_ref().map(|l| l.group.name.as_str()).filter(|name| !name.is_empty());
    let replay = record.replay.as_ref();
    let date = record.began().and_then(|began| {
        let time = jiff::Timestamp::from_nanosecond(i128::from(began.0)).ok()?;
        Some(format!("{} UTC", time.strftime("%Y-%m-%d %H:%M:%S")))
    });
    let duration = replay.map(|r| number::lasting(r.coverage.duration_s));
    let place = replay.and_then(|r| r.origin).map(|origin| {
        let degrees = |radians: f64| number::fixed(radians.to_degrees(), 3);
        format!("{}°, {}°", degrees(origin.latitude), degrees(origin.longitude))
    });
    let all = [receiver.map(str::to_owned), date, duration, place];
    html! {
        @if all.iter().any(Option::is_some) {
            p.facts { @for (i, fact) in all.iter().flatten().enumerate() { @if i > 0 { " · " } bdi { (shown(fact)) } } }
        }
    }
}

fn chips(record: &FlightRecord) -> Markup {
    html! {
        div.strip role="status" {
            (lateness::result_badge(&record.outcome, record.effect.as_ref()))
            (lateness::alarm_badges(&flight_alarms(record.lateness.as_ref(), record.decision.as_ref())))
            (health::notice_words(&record.notices))
            @if let Some(criteria) = &record.criteria { (criteria::chips(criteria)) }
        }
    }
}

/// The answer, preceded by the reason if there is no result.
fn first_words(record: &FlightRecord) -> Markup {
    let class = if matches!(record.outcome, Outcome::Failed { .. }) { "why" } else { "why unsure" };
    // The answer already says why a delay is unknown, with the limits of the answer.
    let is_said = matches!(record.outcome, Outcome::NotMeasurable { .. })
        && record.lateness.as_ref().is_some_and(|l| l.lateness.is_none());
    html! {
        @if is_said {}
        @else if let (Some(reason), None | Some(Outcome::Failed { .. } | Outcome::NotMeasurable { .. } | Outcome::Pending { .. })) =
            (record.outcome.reason(), record.decision.as_ref().map(|_| &record.outcome))
        {
            p class=(class) { (shown_block(reason)) }
        }
        (lateness::answer(record))
        @if record.replay.is_none() && record.outcome == Outcome::Compensated {
            p.why { "The record says compensated, but has no replay." }
        }
        @if record.has_loss() {
            p { "Part of the log could not be read. The numbers below use only what could be read; what was lost is \
                 listed under " a href="#health" { "Data health" } " and " a href="#notices" { "Notices" } "." }
        }
    }
}

fn on_this_page(record: &FlightRecord) -> Markup {
    let replay = record.replay.as_ref();
    let parts = [
        (record.criteria.is_some(), "criteria", "Criteria"),
        (record.drawable().is_some(), "evidence", "Evidence"),
        (record.network.is_some(), "network", "Latenesses"),
        (record.delays.is_some(), "delay", "Delay"),
        (replay.is_some_and(|r| r.choice.is_some() || r.sweep.is_some()), "choice", "Candidates"),
        (replay.is_some(), "compensators", "Compensators"),
        (replay.is_some_and(|r| r.scores.is_some()), "score", "Scores"),
        (true, "health", "Data health"),
        (record.log.is_some(), "anomalies", "Anomalies"),
        (true, "notices", "Notices"),
        (replay.is_some(), "method", "Method"),
        (true, "test-card", "Test card"),
        (true, "provenance", "Files and provenance"),
    ];
    let there: Vec<(&str, &str)> = parts.into_iter().filter(|p| p.0).map(|(_, id, name)| (id, name)).collect();
    contents(&there)
}

/// Fig. 7, the explorer, and the figures that replace it on paper and without a script.
fn evidence(replay: &ReplayRecord, is_trial: bool, explorer: Option<&Markup>, figures: &Figures) -> Markup {
    let twins = html! {
        div.pair { (figures.show(&["turn", "track"])) }
        (figures.show(&["lead"]))
    };
    html! {
        h2 id="evidence" { "Evidence" }
        @if is_trial {
            p.why.unsure {
                "Nothing was removed from this flight. "
                @if replay.settings.delay.seconds() > 0.0 {
                    "The compensated curves are a trial: what they would be if the difference between position and velocity, "
                    (number::significant(replay.settings.delay.millis(), 3)) "\u{a0}ms, were removed. Nothing else on this page uses them."
                } @else { "The curves show the position as it was logged; “compensated” only fills the time between \
                           its fixes." }
            }
        }
        @if figures.get("fig-7").is_none() && figures.get("track").is_none() {
            p { "The record has no curve that could be drawn." }
        }
        (figures.show(&["fig-7"]))
        @match explorer {
            Some(explorer) => {
                (explorer)
                details.twins open="" { summary { "The same as figures: turn, track, lead" } (twins) }
            }
            None => { (twins) }
        }
        @if !is_trial { (coverage(replay)) }
    }
}

/// What part of the flight the numbers cover.
fn coverage(replay: &ReplayRecord) -> Markup {
    let numbers = coverage_numbers(replay);
    let row = |number: &CoverageNumber| {
        html! {
            tr {
                th scope="row" { (number.name) }
                td.n { (number.value) }
                td { (number.unit) }
                td.any { (shown(&number.note)) }
            }
        }
    };
    let head = [Text("What"), Number("Value"), Text("Unit"), Text("Note")];
    table("What the numbers of this page cover", &head, rows(&numbers, 60, head.len(), row))
}

/// A row of the coverage table.
struct CoverageNumber {
    name: &'static str,
    value: String,
    unit: &'static str,
    note: String,
}

impl CoverageNumber {
    fn of(name: &'static str, value: String, unit: &'static str, note: &str) -> CoverageNumber {
        CoverageNumber { name, value, unit, note: note.to_owned() }
    }
}

fn coverage_numbers(replay: &ReplayRecord) -> Vec<CoverageNumber> {
    let of_flight = numbers_of_flight(replay).into_iter();
    of_flight.chain(numbers_of_position(&replay.coverage)).chain(numbers_of_velocity(replay)).collect()
}

fn numbers_of_flight(replay: &ReplayRecord) -> [CoverageNumber; 3] {
    let c = &replay.coverage;
    let Distribution { p01, median, p99, .. } = replay.speed_mps;
    let three = |value| number::significant(value, 3);
    let share = if c.duration_s > 0.0 { number::percent(c.valid_s / c.duration_s) } else { "—".to_owned() };
    let fixes = number::counted(c.fixes, "position fix", "position fixes");
    let speeds = format!("1 % of the rows below {}, 1 % above {} m/s", three(p01), three(p99));
    let valid = "Share of that time with a valid compensated position";
    [
        CoverageNumber::of("Time covered", number::clock(c.duration_s, 0), "h:mm:ss", &fixes),
        CoverageNumber::of(valid, share, "%", &valid_note(replay)),
        CoverageNumber::of("Ground speed, median", three(median), "m/s", &speeds),
    ]
}

fn numbers_of_position(c: &Coverage) -> [CoverageNumber; 2] {
    let longest = number::significant(c.longest_position_gap_s, 3);
    let resets =
        "fixes that jump against integrated velocity by more than 5 σ of the fixes around them: kept and counted";
    [
        CoverageNumber::of("Longest time without a position fix", longest, "s", ""),
        CoverageNumber::of("Position resets", number::count(c.position_resets), "", resets),
    ]
}

fn numbers_of_velocity(replay: &ReplayRecord) -> [CoverageNumber; 2] {
    let c = &replay.coverage;
    let bridge = format!("gaps up to {} s", number::significant(replay.settings.bridge_s, 3));
    [
        CoverageNumber::of("Velocity gaps bridged", number::count(c.bridged_gaps), "", &bridge),
        CoverageNumber::of("Restarts after longer velocity gaps", number::count(c.restarts), "", ""),
    ]
}

/// A share of the time that is mentioned in a note.
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

/// A row for each compensator: its input, its effect, and the residual.
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
        h2 id="compensators" { "Compensators" }
        (table("Compensators; ± is U with k = 2", &head, rows(&replay.compensators, 20, head.len(), row)))
        p.note {
            "Velocity predicts a change of " (estimate(&replay.predicted_rms_m))
            "\u{a0}m rms: the distance flown in Td and the age of the fix. Step at a fix: how far the output jumps \
             when the next fix arrives; small is good. "
            @if !scored { "No errors are given: the log has no reference. " }
            "—: not available."
        }
    }
}
