//! The section of a bench page where the reader shifts the reference by hand and sees the residuals.
//!
//! `bench.js` draws it from curves and residuals of the record. Without the script, the section is hidden and only the
//! figure of the same few swings is shown.

use crate::figure::families;
use crate::number;
use crate::text::sentence;
use crate::verdict;
use maud::{Markup, PreEscaped, html};
use record::{BenchFindings, ChannelDynamics, ComponentDynamics, Curve};
use serde::Serialize;

/// Input of the script.
#[derive(Debug, Serialize)]
struct Data {
    panels: Vec<Panel>,
    /// Start and end of the few swings, s.
    view: [f64; 2],
    /// Mean period of the bar's angle, s.
    period_s: f64,
    /// Largest shift in either direction, ms.
    reach_ms: f64,
}

#[derive(Debug, Serialize)]
struct Panel {
    name: String,
    unit: String,
    gain: f64,
    found_ms: Option<f64>,
    /// The delay as text for the reader.
    found: String,
    reference: Points,
    measured: Points,
    shifts: Shifts,
}

#[derive(Debug, Serialize)]
struct Points {
    t: Vec<f64>,
    y: Vec<f64>,
}

#[derive(Debug, Serialize)]
struct Shifts {
    from_ms: f64,
    step_ms: f64,
    rms: Vec<f64>,
}

/// The section, if the record has something to shift.
pub(super) fn section(findings: &BenchFindings) -> Option<Markup> {
    let panels: Vec<Panel> = families(&findings.channels).into_iter().filter_map(panel).collect();
    let ends = |pick: fn(&[f64]) -> Option<&f64>| panels.iter().filter_map(move |p| pick(&p.measured.t)).copied();
    let view = [ends(<[f64]>::first).reduce(f64::min)?, ends(<[f64]>::last).reduce(f64::max)?];
    let reach_ms = panels.iter().map(|p| -p.shifts.from_ms).fold(500.0, f64::max);
    let hertz = findings.gate.rms_frequency_hz;
    let period_s = if hertz > 0.0 { 1.0 / hertz } else { view[1] - view[0] };
    // Serializing plain numbers and text cannot fail. A `<` could end the script element.
    let json = serde_json::to_string(&Data { panels, view, period_s, reach_ms }).unwrap_or_default();
    Some(html! {
        section.explorer #shift hidden="" aria-label="Shift the reference by hand" {
            h3 { "Shift the reference by hand" }
            p.note {
                "Move the slider and watch the residuals: each is least at the delay of its channel. Drag over a panel to zoom (one finger moves, two zoom); \
                 double-click to see all. Keys, once the panels have the focus: " b { "+ −" } " zoom, " b { "← →" } " move, "
                b { "0" } " all. Offset, drift and slow wander are removed from the measured values."
            }
        }
        script type="application/json" id="shift-data" { (PreEscaped(json.replace('<', "\\u003c"))) }
    })
}

fn panel((channel, component): (&ChannelDynamics, &ComponentDynamics)) -> Option<Panel> {
    let overlay = component.overlay.as_ref()?;
    let delay = channel.delay.as_ref();
    let shifts = Shifts {
        from_ms: 1e3 * overlay.shifts.from_s,
        step_ms: 1e3 * overlay.shifts.step_s,
        rms: overlay.shifts.rms.clone(),
    };
    let panel = Panel {
        name: sentence(&format!("{}, {}", channel.name, component.name)),
        unit: sentence(&component.unit),
        gain: component.gain.map_or(1.0, |g| g.value),
        found_ms: delay.map(|d| d.delay.millis()),
        found: delay.map_or_else(String::new, |d| number::with_uncertainty(&verdict::in_millis(&verdict::delay(d)))),
        reference: points(&overlay.reference),
        measured: points(&overlay.measured),
        shifts,
    };
    let are_finite = panel.reference.y.iter().chain(&panel.shifts.rms).all(|v| v.is_finite())
        && panel.gain.is_finite()
        && panel.shifts.from_ms.is_finite();
    let is_drawable = are_finite
        && panel.reference.t.len() > 1
        && panel.measured.t.len() > 1
        && panel.shifts.rms.len() > 3
        && panel.shifts.step_ms > 0.0;
    is_drawable.then_some(panel)
}

/// Times to 0.1 ms and values to five digits, the resolution of a screen. Non-finite values are skipped.
fn points(curve: &Curve) -> Points {
    let finite = curve.t_s.iter().zip(&curve.y).filter(|(t, y)| t.is_finite() && y.is_finite());
    let (t, y) = finite.map(|(t, y)| ((t * 1e4).round() / 1e4, number::to_significant(*y, 5))).unzip();
    Points { t, y }
}
