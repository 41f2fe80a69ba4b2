//! The table of all flights, most severe first, with the attributes that the script filters by.

use super::super::Head::{self, Number, Text};
use super::super::{Needs, criteria, data_lost, document, expanded, files, lateness, minor_loss, tail_cut};
use super::attention::{self, Reasons};
use super::gravity;
use crate::figure::packed_sketch;
use crate::number;
use crate::text::{Shown, href, sentence, shown};
use crate::verdict::{in_millis, source_word};
use maud::{Markup, Render, html};
use record::{
    CampaignRecord, DelayAlarm, Estimate, FlightLateness, FlightRow, Gravity, JudgedBy, Outcome, flight_alarms,
};
use std::collections::BTreeMap;

/// Maximum number of flights in the table of the campaign's page. Larger tables are on separate pages.
pub(super) const MOST_FLIGHTS: usize = 2_000;
/// Number of flights on each of these pages.
const ON_A_PAGE: usize = 1_000;
/// Folder of these pages, next to the campaign's page.
pub const TABLE_FOLDER: &str = "table";

/// A column head. A less important column (`false`) is shown on demand.
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

/// Whether the campaign's page has the table of all flights.
pub(super) fn is_on_the_page(record: &CampaignRecord) -> bool {
    record.flights.len() <= MOST_FLIGHTS
}

/// Flights by severity, most severe first, then by name.
fn sorted(record: &CampaignRecord) -> Vec<&FlightRow> {
    let mut rows: Vec<&FlightRow> = record.flights.iter().collect();
    rows.sort_by_cached_key(|row| gravity(row));
    rows
}

/// The table, or links to the pages with its parts.
pub(super) fn section(record: &CampaignRecord) -> Markup {
    let rows = sorted(record);
    html! {
        h2 #all { "All flights" }
        (files(&["flights.csv", "flights.parquet", "campaign.json"]))
        @if is_on_the_page(record) { (table(record, &rows, "", &attention::reasons_of(record))) }
        @else {
            p {
                (number::counted(rows.len() as u64, "flight", "flights")) " are too many for one page: they are in pages of "
                (number::count(ON_A_PAGE as u64)) ", the most severe first. The groups are above."
            }
            ul {
                @for (k, part) in rows.chunks(ON_A_PAGE).enumerate() {
                    li { a href={ (TABLE_FOLDER) "/" (k + 1) ".html" } { "Flights " (span(k, part.len())) } ": " (effects(part)) }
                }
            }
        }
    }
}

/// `1001 to 2000`.
fn span(page: usize, flights: usize) -> String {
    let first = page * ON_A_PAGE;
    format!("{} to {}", number::count(first as u64 + 1), number::count((first + flights) as u64))
}

/// Number of flights with each result.
fn effects(rows: &[&FlightRow]) -> Markup {
    let mut counts: BTreeMap<&str, u64> = BTreeMap::new();
    rows.iter()
        .for_each(|row| *counts.entry(lateness::result_word(&row.outcome, row.effect.as_ref())).or_default() += 1);
    html! { @for (i, (word, n)) in counts.iter().enumerate() { @if i > 0 { ", " } (number::count(*n)) " " (word) } }
}

/// The table pages of a campaign with more flights than its own page can show; otherwise empty.
pub(super) fn pages(record: &CampaignRecord) -> Vec<(String, String)> {
    if is_on_the_page(record) {
        return vec![];
    }
    let (rows, reasons) = (sorted(record), attention::reasons_of(record));
    let count = rows.len().div_ceil(ON_A_PAGE);
    let page = |(k, part): (usize, &[&FlightRow])| {
        let title = format!("{} — flights {}", record.name, span(k, part.len()));
        let body = html! {
            nav aria-label="Pages" {
                a href="../index.html#all" { "Campaign" }
                @if k > 0 { a rel="prev" href={ (k) ".html" } { "Graver" } }
                @if k + 1 < count { a rel="next" href={ (k + 2) ".html" } { "Less severe" } }
            }
            main {
                h1 { (shown(&record.name)) ": flights " (span(k, part.len())) " of " (number::count(rows.len() as u64)) }
                (table(record, part, "../", &reasons))
            }
        };
        (format!("{TABLE_FOLDER}/{}.html", k + 1), document(&title, Needs::Table, body))
    };
    rows.chunks(ON_A_PAGE).enumerate().map(page).collect()
}

fn table(record: &CampaignRecord, rows: &[&FlightRow], base: &str, reasons: &Reasons<'_>) -> Markup {
    let judged = record.flights.iter().any(|r| r.criteria.is_some());
    let alarmed = record.flights.iter().any(|r| !shown_alarms(r).is_empty());
    let scale = scale(&record.flights);
    let row = |row: &FlightRow| flight_row(row, judged, base, scale, reasons.get(row.flight.as_str()));
    html! {
        p.printed.note { "Not printed: the columns Flown, Data, and those that the page does not show at first. flights.csv has all." }
        div.scroll.tall tabindex="0" role="region" aria-label="All flights" {
            table.sortable #flights {
                caption { "One row for each flight, the most severe first; ± is U with k = 2, and a blue bar shows it \
                           on one scale. —: not available." (errors_of(record)) }
                thead { tr { @for column in head(judged, alarmed) { (column) } } }
                tbody { @for of in rows { (row(of)) } }
            }
        }
    }
}

/// What the errors of the table are, if they are not the same in all flights.
fn errors_of(record: &CampaignRecord) -> String {
    let judged = record.flights.iter().filter_map(|row| row.effect.as_ref()).filter(|e| e.error_raw_m.is_some());
    let (whole, of_delay): (Vec<_>, Vec<_>) = judged.partition(|e| matches!(e.judged_by, JudgedBy::Truth(_)));
    if whole.is_empty() || of_delay.is_empty() {
        return String::new();
    }
    format!(
        " Errors are of the whole position in the {} with a reference, and of the delay alone in the other {}.",
        number::counted(whole.len() as u64, "flight", "flights"),
        number::count(of_delay.len() as u64)
    )
}

/// The column heads. Of the first ten, all but the second and the eighth are printed.
fn head(judged: bool, alarmed: bool) -> Vec<Column> {
    let (usual, more) = (|h| Column(h, true), |h| Column(h, false));
    let mut head = vec![
        usual(Text("Flight")),
        usual(Text("Flown")),
        usual(Text("Effect")),
        usual(Number("Lateness (ms)")),
        usual(Number("Removed (ms)")),
        usual(Number("Error before (m)")),
        usual(Number("Error after (m)")),
        usual(Text("Data")),
    ];
    head.extend(judged.then(|| usual(Text("Criteria"))));
    head.extend([
        Column(Text("Alarms"), alarmed),
        more(Text("Group")),
        more(Text("Kind")),
        more(Text("Against")),
        more(Text("Removed from")),
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

fn flight_row(row: &FlightRow, judged: bool, base: &str, scale: Scale, reasons: Option<&String>) -> Markup {
    let alarms = shown_alarms(row);
    let codes: Vec<&str> = alarms.iter().map(|a| a.code.as_str()).collect();
    let group = row.lateness.as_ref().map_or("", |l| l.group.name.as_str());
    html! {
        tr data-alarm=[Some(codes.join(" ")).filter(|t| !t.is_empty())]
            data-reason=[reasons]
            data-track=[row.track_sketch_m.as_deref().and_then(packed_sketch)] {
            th scope="row" { (link(row, base)) }
            td { (row.flown_at.as_deref().map_or_else(|| "—".to_owned(), minute)) }
            td.w data-v=(gravity(row).0) { (lateness::result_cell(&row.outcome, row.effect.as_ref())) }
            (lateness_cell(row, scale))
            (millis_cell(removed(row).as_ref()))
            (lateness::effect_cells(row))
            td.w data-v=(data_rank(row)) { (data_word(row)) }
            @if judged { (criteria::cell(row)) }
            td.w data-v=(alarms.len()) { (lateness::alarm_badges(&alarms)) }
            td { (or_dash(Some(group).filter(|g| !g.is_empty()))) }
            (lateness::kind_cells(row))
            td { (or_dash(row.delay_from.map(source_word))) }
            (share_cell(row.valid_share))
            td.n { (number::count(row.warnings)) }
            (cell(row.duration_s, |s| number::clock(s, 0)))
            (millis_cell(row.measured_delay_s.as_ref()))
            (estimate_cell(row.correction_rms_m.as_ref()))
            (cell(row.speed_median_mps, |v| number::significant(v, 3)))
            (cell(row.position_rate_hz, |hz| number::significant(hz, 3)))
            (cell(row.velocity_rate_hz, |hz| number::significant(hz, 3)))
            td { (or_dash(row.map.as_deref())) }
            td { (shown(&row.format)) }
            td data-v=(row.bytes) { (number::bytes(row.bytes)) }
        }
    }
}

/// The removed delay with its uncertainty; a stated delay may have none.
fn removed(row: &FlightRow) -> Option<Estimate> {
    let standard_uncertainty = row.decision.as_ref().and_then(|decision| decision.standard_uncertainty_s);
    row.delay_s.map(|value| Estimate { value, standard_uncertainty })
}

/// Alarms of a flight, except grey ones.
fn shown_alarms(row: &FlightRow) -> Vec<DelayAlarm> {
    let alarms = flight_alarms(row.lateness.as_ref(), row.decision.as_ref());
    alarms.into_iter().filter(|a| a.gravity != Gravity::Grey).collect()
}

/// Ends of the scale of the bars, s: the range of all flights plus half the median bar length on either side.
type Scale = Option<(f64, f64)>;

fn scale(flights: &[FlightRow]) -> Scale {
    let all: Vec<Estimate> = flights.iter().filter_map(late).filter(|e| e.value.is_finite()).collect();
    let mut halves: Vec<f64> = all.iter().filter_map(|e| e.standard_uncertainty).map(|u| 2.0 * u).collect();
    halves.sort_unstable_by(f64::total_cmp);
    let air = halves.get(halves.len() / 2).copied().filter(|half| half.is_finite()).unwrap_or(0.0).max(1e-3);
    let low = all.iter().map(|e| e.value).reduce(f64::min)?;
    let high = all.iter().map(|e| e.value).reduce(f64::max)?;
    Some((low - air, high + air))
}

fn late(row: &FlightRow) -> Option<Estimate> {
    row.lateness.as_ref().and_then(FlightLateness::lateness_s)
}

/// The lateness in front of a bar that shows its interval on a scale common to all rows.
fn lateness_cell(row: &FlightRow, scale: Scale) -> Markup {
    let Some(late) = late(row).filter(|e| e.value.is_finite()) else { return html! { td.n { "—" } } };
    let half = 2.0 * late.standard_uncertainty.unwrap_or(0.0);
    let share = |at: f64| scale.map_or(0.0, |(low, high)| (at - low) / (high - low));
    let place = |at: f64| if share(at).is_finite() { 100.0 * share(at).clamp(0.0, 1.0) } else { 0.0 };
    let (from, to) = (place(late.value - half), place(late.value + half));
    let style = format!("--a:{from:.0}%;--b:{:.0}%", to.max(from + 2.0));
    html! { td.range style=(style) data-v=(late.value) data-u=[expanded(&late)] { (lateness_text(row, &late)) } }
}

/// The number with U, or the interval where it is one-sided.
fn lateness_text(row: &FlightRow, late: &Estimate) -> String {
    let channel = row
        .lateness
        .as_ref()
        .and_then(|l| l.lateness.as_ref())
        .filter(|channel| record::is_one_sided(channel.lateness_s.value, channel.interval_95_s));
    match channel.map(|channel| channel.interval_95_s.map(|s| number::fixed(1e3 * s, 0))) {
        Some([low, high]) => format!("{low} to {high}"),
        None => number::with_uncertainty(&in_millis(late)),
    }
}

/// A link to the flight's page. The name is isolated for bidirectional text. `base` leads to the campaign's folder.
pub(super) fn link(row: &FlightRow, base: &str) -> Markup {
    html! { a href={ (base) (href(&row.page)) } { bdi { (shown(&row.flight)) } } }
}

/// A text, or the dash that the caption explains.
fn or_dash(text: Option<&str>) -> Shown<'_> {
    shown(text.unwrap_or("—"))
}

/// `2022-06-15 18:46` of `2022-06-15T18:46:34.360Z`.
fn minute(instant: &str) -> String {
    sentence(instant).chars().take(16).map(|c| if c == 'T' { ' ' } else { c }).collect()
}

/// State of the data; unknown if a flight failed for another reason.
fn data_word(row: &FlightRow) -> Markup {
    match data_name(row) {
        "damaged" => data_lost(),
        "minor loss" => minor_loss(),
        "tail cut" => tail_cut(),
        "" => html! { "—" },
        name => html! { (name) },
    }
}

fn data_name(row: &FlightRow) -> &'static str {
    match row.outcome {
        _ if row.lossy => "damaged",
        Outcome::Failed { .. } | Outcome::Pending { .. } => "",
        _ if row.minor_loss => "minor loss",
        _ if row.tail_cut_bytes > 0 => "tail cut",
        _ => "whole",
    }
}

fn data_rank(row: &FlightRow) -> u8 {
    match data_name(row) {
        "damaged" => 0,
        "minor loss" => 1,
        "tail cut" => 2,
        "whole" => 3,
        _ => 4,
    }
}

/// A number that is sorted at full precision and shown rounded.
fn cell(value: Option<f64>, show: impl FnOnce(f64) -> String) -> Markup {
    match value {
        Some(value) => html! { td data-v=(value) { (show(value)) } },
        None => html! { td.n { "—" } },
    }
}

fn estimate_cell(value: Option<&Estimate>) -> Markup {
    match value {
        Some(value) => html! { td data-v=(value.value) data-u=[expanded(value)] { (number::with_uncertainty(value)) } },
        None => html! { td.n { "—" } },
    }
}

/// Shown in milliseconds, sorted and saved in seconds.
fn millis_cell(value: Option<&Estimate>) -> Markup {
    match value {
        Some(value) => {
            html! { td data-v=(value.value) data-u=[expanded(value)] { (number::with_uncertainty(&in_millis(value))) } }
        }
        None => html! { td.n { "—" } },
    }
}

fn share_cell(share: Option<f64>) -> Markup {
    match share.filter(|s| s.is_finite()) {
        Some(share) => {
            let width = format!("--p:{:.0}%", share.clamp(0.0, 1.0) * 100.0);
            html! { td.share style=(width) data-v=(share) { (number::percent(share)) } }
        }
        None => html! { td.n { "—" } },
    }
}
