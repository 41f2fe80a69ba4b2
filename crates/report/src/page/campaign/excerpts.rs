//! North and east of the newest flights, raw and compensated, on demand: Fig. 7 of the paper for each flight.

use super::flights::link;
use crate::draw;
use crate::figure::{Line, Pen, extent, pieces};
use crate::number;
use maud::{Markup, html};
use record::{AxisCurves, CampaignRecord, Curve, FlightRow, Outcome, Zoom};

/// Maximum number of flights; each takes a few kilobytes.
const MOST: usize = 12;
/// Width and left edge of a panel in drawing units (half a CSS pixel).
const WIDTH: f64 = 560.0;
const LEFT: f64 = 80.0;
/// Height of a panel, and the space between panels.
const HEIGHT: f64 = 150.0;
const BETWEEN: f64 = 16.0;

/// The hardest turn of one flight.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackExcerpt {
    /// The flight's name.
    pub flight: String,
    /// The seconds of its hardest turn.
    pub zoom: Zoom,
}

/// The flights whose tracks the page of a campaign shows: the newest compensated flights.
#[must_use]
pub fn excerpt_flights(record: &CampaignRecord) -> Vec<&FlightRow> {
    let mut rows: Vec<&FlightRow> = record.flights.iter().filter(|row| row.outcome == Outcome::Compensated).collect();
    rows.sort_by(|a, b| (&b.flown_at, &b.flight).cmp(&(&a.flown_at, &a.flight)));
    rows.truncate(MOST);
    rows
}

pub(super) fn section(record: &CampaignRecord, excerpts: &[TrackExcerpt]) -> Markup {
    let mut all = vec![];
    for of in excerpts.iter().take(MOST) {
        let row = record.flights.iter().find(|row| row.flight == of.flight);
        all.extend(row.zip(drawing(&of.zoom)).map(|(row, drawing)| (row, &of.zoom, drawing)));
    }
    html! {
        @if !all.is_empty() {
            h2 #excerpts { "North and east" }
            details {
                summary { "Raw and compensated where the aircraft turned hardest, " (number::counted(all.len() as u64, "flight", "flights")) ", the newest first" }
                p.note {
                    "As Fig. 7 of Park and Lee: north above, east below, in metres over the stated seconds. "
                    b.raw { "Wide: raw." } " " b.exact { "Thin: compensated (exact form)." }
                    " Good: the same shape, earlier by the delay. Bad: peaks of another height. The page of each \
                     flight shows the whole flight."
                }
                div.excerpts {
                    @for (row, zoom, drawing) in &all {
                        div { p { (link(row, "")) ", " (number::clock(zoom.start_s, 0)) " to " (number::clock(zoom.end_s, 0)) } (drawing) }
                    }
                }
            }
        }
    }
}

/// Both axes; `None` if no curve can be drawn.
fn drawing(zoom: &Zoom) -> Option<Markup> {
    let axes: Vec<Vec<Line>> = zoom.axes.iter().take(2).map(lines).collect();
    let time = extent(axes.iter().flatten(), |p| p.0).filter(|(from, to)| to > from)?;
    let height = 2.0 * HEIGHT + BETWEEN;
    Some(html! {
        svg viewBox={ "0 0 " (LEFT + WIDTH) " " (height) } width=((LEFT + WIDTH) / 2.0) height=(height / 2.0) role="img" aria-label="North and east" {
            @for (k, lines) in axes.iter().enumerate() { (panel(lines, time, k as f64 * (HEIGHT + BETWEEN))) }
        }
    })
}

fn panel(lines: &[Line], (from, to): (f64, f64), top: f64) -> Markup {
    let Some((low, high)) = extent(lines, |p| p.1) else { return html! {} };
    let scale = (HEIGHT - 8.0) / (high - low).max(1e-6);
    let place = |(t, y): &(f64, f64)| {
        let (x, y) = (LEFT + WIDTH * (t - from) / (to - from), top + HEIGHT - 4.0 - scale * (y - low));
        (x.round() as i32, y.round() as i32)
    };
    let d = |line: &Line| -> String {
        line.pieces.iter().map(|piece| draw::curve(&piece.iter().map(place).collect::<Vec<_>>())).collect()
    };
    html! {
        rect x=(LEFT) y=(top) width=(WIDTH) height=(HEIGHT) {}
        text x=(LEFT - 8.0) y=(top + 22.0) { (number::fixed(high, 0)) }
        text x=(LEFT - 8.0) y=(top + HEIGHT - 2.0) { (number::fixed(low, 0)) }
        @for line in lines { path.raw[line.pen == Pen::Raw].exact[line.pen != Pen::Raw] d=(d(line)) {} }
    }
}

/// The curve of the exact form (fallback: the last curve) with the raw curve on top.
fn lines(axis: &AxisCurves) -> Vec<Line> {
    let raw = axis.position_m.first();
    let others = axis.position_m.get(1..).unwrap_or_default();
    let compensated = others.iter().find(|curve| curve.name.starts_with("exact")).or(others.last());
    let line = |curve: &Curve, pen: Pen| {
        let (pieces, _) = pieces(&curve.t_s, &curve.y, &curve.breaks);
        Line { name: String::new(), pen, pieces }
    };
    compensated.map(|curve| line(curve, Pen::Band)).into_iter().chain(raw.map(|curve| line(curve, Pen::Raw))).collect()
}
