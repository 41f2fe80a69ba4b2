//! The zoomable section of a flight's page: positions, lead and error over time next to the ground track.
//!
//! `explorer.js` computes everything in it from the packed rows. Without the script, the section is hidden and only the
//! figures of the page are shown.

use super::anomalies::{Anomaly, shift_s};
use crate::number::COVERAGE_FACTOR;
use crate::text::sentence;
use maud::{Markup, PreEscaped, html};
use record::{ExplorerRows, FlightRecord, PairDelay, ReplayRecord};
use serde::Serialize;

/// Input of the script. Times are seconds after the origin of the replay.
#[derive(Debug, Serialize)]
struct Data<'a> {
    rows: &'a ExplorerRows,
    /// The delay that was removed, if it is relative to the same channel as the delay over the flight.
    removed_ms: Option<f64>,
    /// What the delay over the flight is measured against.
    against: String,
    /// Delay over the flight: time, delay in ms, U (k = 2) in ms.
    delay: Vec<[f64; 3]>,
    /// Points of interest.
    places: Vec<&'a Anomaly>,
}

/// The explorer, if there is something to explore.
pub(super) fn section(record: &FlightRecord, rows: Option<&ExplorerRows>, anomalies: &[Anomaly]) -> Option<Markup> {
    let (replay, rows) = (record.drawable()?, rows?);
    if rows.rows < 2 {
        return None;
    }
    let pair = record.delays.as_ref().and_then(|d| super::flight_delay::replayed(d, replay));
    let relative = record.lateness.as_ref().and_then(|l| l.lateness.as_ref()?.relative_to.as_ref());
    let is_relative = relative == Some(&replay.pair.velocity);
    let data = Data {
        rows,
        removed_ms: (is_relative && record.replay.is_some()).then(|| replay.settings.delay.millis()),
        against: sentence(&replay.pair.velocity),
        delay: pair.map(|pair| delay_over_flight(pair, replay)).unwrap_or_default(),
        places: anomalies.iter().filter(|a| a.t_s.is_some()).collect(),
    };
    // Serializing plain numbers and text cannot fail. A `<` could end the script element.
    let json = serde_json::to_string(&data).unwrap_or_default().replace('<', "\\u003c");
    Some(html! {
        section.explorer #explorer hidden="" aria-label="Flight explorer" {
            h2 { "Explore the flight" }
            p.note {
                "Drag over a panel to zoom, Shift-drag to move, double-click for all; one finger moves, two zoom; the numbers and the track follow the \
                 window. "
                b { "?" } " lists the keys."
                @if rows.extremes_of > 1 {
                    " The flight is too long to hold every row here: of every " (rows.extremes_of)
                    " rows those with an extreme are kept, " (crate::number::count(rows.rows)) " of "
                    (crate::number::count(rows.of)) ". Every row is in track.parquet."
                }
            }
        }
        script type="application/json" id="explorer-data" { (PreEscaped(json)) }
    })
}

fn delay_over_flight(pair: &PairDelay, replay: &ReplayRecord) -> Vec<[f64; 3]> {
    let (Some(shift), Some(varies)) = (shift_s(pair, replay), &pair.varies) else { return vec![] };
    let millis = |seconds: f64| (1e4 * seconds).round() / 10.0;
    varies
        .curve
        .iter()
        .map(|p| [p.t_s + shift, millis(p.delay_s), millis(COVERAGE_FACTOR * p.standard_uncertainty_s)])
        .filter(|point| point.iter().all(|v| v.is_finite()))
        .collect()
}
