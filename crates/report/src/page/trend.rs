//! The page of trends: control charts and their change points.

use super::Head::{Number, Text};
use super::run_changes::Names;
use super::{Needs, document, estimate, figure, files, number, table};
use crate::figure::control_chart;
use crate::site::Site;
use crate::text::shown;
use crate::verdict::in_millis;
use maud::{Markup, html};
use record::{TrendChart, TrendRecord};

/// Maximum number of charts drawn; the table has all.
const MOST_DRAWN: usize = 40;

/// The page of trends as `index.html`, with its figures. `base` leads from the page to the folder that flight pages are
/// relative to.
#[must_use]
pub fn trend_site(record: &TrendRecord, title: &str, base: &str) -> Site {
    let mut site = Site::default();
    let names = Names { base, all: "trend.json" };
    let with_changes = record.charts.iter().filter(|chart| !chart.changes.is_empty()).count();
    let body = html! {
        main {
            h1 { (shown(title)) }
            p.answer {
                @if with_changes == 0 { b { "No change" } " on " } @else { b { "A change" } " on " (number::count(with_changes as u64)) " of " }
                (number::counted(record.charts.len() as u64, "chart", "charts")) "."
            }
            (charts(record, &names, &mut site))
            (method(record))
            (files(&["trend.json", "trend.csv"]))
        }
    };
    site.add("index.html", document(title, Needs::Nothing, body));
    site
}

/// The table of changes, then the charts. Charts with changes come first.
pub(super) fn charts(record: &TrendRecord, names: &Names<'_>, site: &mut Site) -> Markup {
    let mut ordered: Vec<&TrendChart> = record.charts.iter().collect();
    ordered.sort_by_key(|chart| (chart.changes.is_empty(), std::cmp::Reverse(chart.points.len())));
    let figures: Vec<_> = ordered
        .iter()
        .take(MOST_DRAWN)
        .zip(1..)
        .filter_map(|(chart, number)| control_chart(chart, number))
        .inspect(|figure| site.add_figure(figure))
        .collect();
    html! {
        (changes(&ordered, names))
        (means(&ordered))
        @for drawn in &figures { (figure(drawn)) }
        @if ordered.len() > MOST_DRAWN {
            p.note { (number::count((ordered.len() - MOST_DRAWN) as u64)) " more charts are in the table and not drawn." }
        }
        @if record.without_change > 0 {
            p.note { (number::counted(record.without_change, "chart has", "charts have")) " no change and " (if record.without_change == 1 { "is" } else { "are" }) " not drawn: " code { "flightlag trend" } " draws all." }
        }
        @if !record.left_out.is_empty() { p.note { "Not on a chart: " (shown(&record.left_out.join("; "))) "." } }
    }
}

fn changes(charts: &[&TrendChart], names: &Names<'_>) -> Markup {
    let head = [
        Text("Chart"),
        Text("From this flight on"),
        Text("Flown (UTC)"),
        Number("Step (ms)"),
        Number("σ"),
        Text("With it"),
    ];
    let any = charts.iter().any(|chart| !chart.changes.is_empty());
    html! {
        @if any {
            (table("Changes", &head, html! {
                @for chart in charts {
                    @for change in &chart.changes {
                        tr {
                            th scope="row" { (shown(&chart.name())) }
                            td {
                                (names.flight(&change.at))
                                @if change.earliest != change.latest {
                                    " (95 %: " (names.flight(&change.earliest)) " to " (names.flight(&change.latest)) ")"
                                }
                            }
                            td { (shown(change.flown_at.as_deref().unwrap_or("unknown"))) }
                            td.n { (estimate(&in_millis(&change.step_s))) }
                            td.n { (super::plain(change.sigmas, 2)) }
                            td.any { @if change.with_it.is_empty() { "nothing else known" } @else { (shown(&change.with_it.join("; "))) } }
                        }
                    }
                }
            }))
        }
    }
}

/// The mean of each segment. The newest one is the current value.
fn means(charts: &[&TrendChart]) -> Markup {
    let head = [
        Text("Chart"),
        Text("Counted from"),
        Number("Flights"),
        Number("Lateness now (ms)"),
        Number("Spread between flights (ms)"),
        Number("Changes"),
        Number("Outside limits"),
    ];
    if charts.is_empty() {
        return html! {};
    }
    html! {
        (table("Charts", &head, html! {
            @for chart in charts {
                @let outside = chart.points.iter().filter(|point| point.is_outside).count();
                tr {
                    th scope="row" { (shown(&chart.name())) }
                    td { (shown(&chart.datum)) }
                    td.n { (number::count(chart.points.len() as u64 + chart.older_points)) }
                    td.n { @if let Some(last) = chart.segments.last() { (estimate(&in_millis(&last.mean_s))) } }
                    td.n { (super::plain(chart.between_s * 1e3, 2)) }
                    td.n { (number::count(chart.changes.len() as u64)) }
                    td.n { (number::count(outside as u64)) }
                }
            }
        }))
    }
}

fn method(record: &TrendRecord) -> Markup {
    html! {
        p.note {
            "Each flight counts with its own uncertainty and the spread between flights. A change is a step of the mean that lowers \
             the weighted sum of squares by more than a threshold. A chart without a change shows one with a probability of at most \
             about " (number::percent(record.false_alarm)) " %, "
            @if record.every_look {
                "over all nights together. `flightlag trend` looks once and shows smaller changes. "
            } @else {
                "for one look. Over many looks it is more: the page of a night has a higher threshold, which is valid \
                 over all nights. "
            }
            "A step with fewer than three flights after it is not yet a change. ± is U with k = 2."
        }
    }
}
