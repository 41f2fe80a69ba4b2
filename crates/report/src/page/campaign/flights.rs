//! The table of all flights: the gravest first, with what the script filters by.

use super::super::Head::{self, Number, Text};
use super::super::{criteria, data_lost, files, lateness, maybe, tail_cut};
use super::gravity;
use crate::number;
use crate::text::{href, label, sentence, shown};
use crate::verdict::source_word;
use maud::{Markup, Render, html};
use record::{Estimate, FlightLateness, FlightRow, Gravity, Outcome, flight_alarms};

/// Most flights in the table; files beside the page have all.
const MOST_FLIGHTS: usize = 2_000;

/// A column head; what not everybody needs is shown on demand.
struct Column(Head, bool);

impl Render for Column {
    fn render(&self) -> Markup {
        match self {
            Column(head, true) => head.render(),
            Column(Text(name), false) => html! { th.more scope="col" { (name) } },
            Column(Number(name), false) => html! { th.n.more scope="col" { (name) } },
        }
    }
}

/// The gravest first, those of one gravity by name.
pub(super) fn table(flights: &[FlightRow]) -> Markup {
    let judged = flights.iter().any(|r| r.criteria.is_some());
    let mut rows: Vec<&FlightRow> = flights.iter().collect();
    rows.sort_by_key(|row| gravity(row));
    let more = rows.len().saturating_sub(MOST_FLIGHTS);
    html! {
        h2 #all { "All flights" }
        @if more > 0 {
            p.why.unsure {
                "The table shows the " (number::count(MOST_FLIGHTS as u64)) " gravest flights. " (number::count(more as u64))
                " more are in flights.csv."
            }
        }
        (files(&["flights.csv", "flights.parquet", "campaign.json"]))
        div.scroll tabindex="0" role="region" aria-label="All flights" {
            table.sortable #flights {
                caption { "One row for each flight, the gravest first; ± is U with k = 2. —: not available." }
                thead { tr { @for column in head(judged) { (column) } } }
                tbody { @for row in rows.iter().take(MOST_FLIGHTS) { (flight_row(row, judged)) } }
            }
        }
    }
}

fn head(judged: bool) -> Vec<Column> {
    let (usual, more) = (|h| Column(h, true), |h| Column(h, false));
    let mut head = vec![usual(Text("Flight")), usual(Text("Effect")), usual(Text("Alarms"))];
    head.extend(judged.then(|| usual(Text("Criteria"))));
    head.extend([
        usual(Text("Kind")),
        usual(Number("Lateness (ms)")),
        more(Text("Against")),
        usual(Number("Removed (ms)")),
        more(Text("Removed from")),
        usual(Number("Error before (m)")),
        usual(Number("Error after (m)")),
        usual(Text("Data")),
        usual(Text("Group")),
        usual(Text("Flown")),
        more(Number("Valid (% of time)")),
        more(Number("Warnings")),
        more(Number("Duration (h:mm:ss)")),
        more(Number("Position − velocity (ms)")),
        more(Number("Correction, 2‑D rms (m)")),
        more(Number("Speed, median (m/s)")),
        more(Number("Position (Hz)")),
        more(Number("Velocity (Hz)")),
        more(Text("Map")),
        more(Text("Format")),
        more(Number("Size")),
    ]);
    head
}

fn flight_row(row: &FlightRow, judged: bool) -> Markup {
    let alarms = flight_alarms(row.lateness.as_ref(), row.decision.as_ref());
    let told: Vec<&str> = alarms.iter().filter(|a| a.gravity != Gravity::Grey).map(|a| a.code.as_str()).collect();
    let group = row.lateness.as_ref().map_or("", |l| l.group.name.as_str());
    html! {
        tr data-effect=(lateness::result_word(&row.outcome, row.effect.as_ref()))
            data-kind=(row.lateness.as_ref().map(FlightLateness::kind_name).unwrap_or_default())
            data-group=(sentence(group))
            data-data=(data_name(row))
            data-alarm=(told.join(" ")) {
            th scope="row" { (link(row)) }
            td.w data-v=(gravity(row).0) { (lateness::result_badge(&row.outcome, row.effect.as_ref())) }
            td.w data-v=(told.len()) { (lateness::alarm_badges(&alarms)) }
            @if judged { (criteria::cell(row)) }
            (lateness::lateness_cells(row))
            (cell(row.delay_s, |s| number::significant(s * 1e3, 4)))
            td { (maybe(row.delay_from, |from| html! { (source_word(from)) })) }
            (lateness::effect_cells(row))
            td.w data-v=(data_rank(row)) { (data_word(row)) }
            td { (maybe(Some(group).filter(|g| !g.is_empty()), |g| html! { (shown(g)) })) }
            td data-v=[row.flown_at.as_deref()] { (maybe(row.flown_at.as_deref(), |at| html! { (minute(at)) })) }
            (share_cell(row.valid_share))
            td.n { (number::count(row.warnings)) }
            (cell(row.duration_s, |s| number::clock(s, 0)))
            (millis_cell(row.measured_delay_s.as_ref()))
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

/// A link to the flight's page, its name isolated from the text around it.
pub(super) fn link(row: &FlightRow) -> Markup {
    html! { a href=(href(&row.page)) { bdi { (shown(&row.flight)) } } }
}

/// `2022-06-15 18:46` of `2022-06-15T18:46:34.360Z`.
fn minute(instant: &str) -> String {
    instant.chars().take(16).map(|c| if c == 'T' { ' ' } else { c }).collect()
}

/// Nothing is known of the data of a flight that failed for another reason.
fn data_word(row: &FlightRow) -> Markup {
    match data_name(row) {
        "damaged" => data_lost(),
        "tail cut" => tail_cut(),
        "" => html! { "—" },
        name => html! { (name) },
    }
}

fn data_name(row: &FlightRow) -> &'static str {
    match row.outcome {
        _ if row.lossy => "damaged",
        Outcome::Failed { .. } | Outcome::Pending { .. } => "",
        _ if row.tail_cut_bytes > 0 => "tail cut",
        _ => "whole",
    }
}

fn data_rank(row: &FlightRow) -> u8 {
    match data_name(row) {
        "damaged" => 0,
        "tail cut" => 1,
        "whole" => 2,
        _ => 3,
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

/// Shown in milliseconds, sorted and saved in seconds.
fn millis_cell(value: Option<&Estimate>) -> Markup {
    match value {
        Some(value) => {
            html! { td.n data-v=(value.value) { (number::with_uncertainty(&crate::verdict::in_millis(value))) } }
        }
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
