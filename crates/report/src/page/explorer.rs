//! The part of a flight's page in which a reader zooms: positions, lead and error over time beside the ground track.
//!
//! Everything that it shows is computed by `explorer.js` from the packed rows. Without script the part stays hidden and the
//! figures of the page stand alone.

use crate::number::COVERAGE_FACTOR;
use crate::text::sentence;
use maud::{Markup, PreEscaped, html};
use record::{ExplorerRows, FlightRecord, Outcome, PairDelay, ReplayRecord};
use serde::Serialize;

/// What the script reads. Times are seconds after the origin of the replay.
#[derive(Debug, Serialize)]
struct Data<'a> {
    rows: &'a ExplorerRows,
    removed_ms: f64,
    /// What the delay over the flight is measured against.
    against: String,
    /// Delay over the flight: time, delay in ms, U (k = 2) in ms.
    delay: Vec<[f64; 3]>,
    /// Places worth a look.
    places: Vec<Place>,
}

/// A place worth a look.
#[derive(Debug, Serialize)]
struct Place {
    t_s: f64,
    what: String,
}

/// Most places of each kind.
const MOST_PLACES: usize = 10;

/// The explorer, where there is something to explore.
pub(super) fn section(record: &FlightRecord, rows: Option<&ExplorerRows>) -> Option<Markup> {
    let (replay, rows) = (record.replay.as_ref()?, rows?);
    if record.outcome != Outcome::Compensated || rows.rows < 2 {
        return None;
    }
    let pair = record.delays.as_ref().and_then(|d| super::flight_delay::replayed(d, replay));
    let data = Data {
        rows,
        removed_ms: replay.settings.delay.millis(),
        against: sentence(&replay.pair.velocity),
        delay: pair.map(|pair| delay_over_flight(pair, replay)).unwrap_or_default(),
        places: pair.map(|pair| places(pair, replay)).unwrap_or_default(),
    };
    // Plain numbers and text cannot fail; `<` would end the script element.
    let json = serde_json::to_string(&data).unwrap_or_default().replace('<', "\\u003c");
    Some(html! {
        section.explorer #explorer hidden="" aria-label="Flight explorer" {
            h2 { "Explore the flight" }
            p.note {
                "Drag over a panel to zoom; double-click to see all. Keys, once the panels have the focus: "
                b { "+ −" } " zoom, " b { "← →" } " move, " b { "0" } " all. The numbers and the track follow the window."
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

/// Seconds from the origin of the replay to that of the pair; `None` where their clocks differ.
fn shift_s(pair: &PairDelay, replay: &ReplayRecord) -> Option<f64> {
    let origin = pair.origin.filter(|origin| origin.clock == replay.clock)?;
    Some(origin.origin_ns.saturating_sub(replay.origin_ns) as f64 * 1e-9)
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

/// Where the delay changes, and fixes that came late or at once.
fn places(pair: &PairDelay, replay: &ReplayRecord) -> Vec<Place> {
    let (Some(shift), Some(varies)) = (shift_s(pair, replay), &pair.varies) else { return vec![] };
    let place = |t_s: f64, what: String| Place { t_s: t_s + shift, what: sentence(&what) };
    let terms = varies.terms.iter().take(MOST_PLACES).map(|term| place(term.at_s, "the delay changes".to_owned()));
    let late = varies.late_fixes.iter().take(MOST_PLACES);
    let late = late.map(|fix| place(fix.t_s, format!("fix late by {:.0} ms more", 1e3 * fix.late_s)));
    let bursts = varies.bursts.iter().take(MOST_PLACES);
    let bursts = bursts.map(|b| place(b.start_s, format!("{} fixes at once after {:.1} s", b.fixes, b.hold_s)));
    terms.chain(late).chain(bursts).collect()
}
