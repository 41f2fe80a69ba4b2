//! Mount and calibration: values from the data next to values from the rig file.

use super::super::Head::{Number, Text};
use super::super::{badge, estimate, exact, fact, finding, met_badge, or_why, plain, rows, table};
use super::overview::folded;
use crate::number;
use crate::text::{shown, shown_block};
use maud::{Markup, html};
use record::{Estimate, Finding, Flexibility, MagnetometerFinding, MountCheck, MountFinding};

pub(super) fn section(mount: &MountFinding, flexibility: &Finding<Flexibility>, is_tesla: bool) -> Markup {
    html! {
        h2 id="mount" { "Mount and calibration" }
        p {
            "The data say that the sensor is mounted: " b { (finding(&mount.detected, |word| html! { (shown(word)) })) }
            ". The rig file says: " b { (shown(&mount.stated)) } "."
        }
        (checks(&mount.checks))
        h3 { "Flexibility of the bar" }
        (finding(flexibility, bar))
        h3 { "Magnetometer" }
        (finding(&mount.magnetometer, |found| magnetometer(found, if is_tesla { "µT" } else { "sensor's own unit" })))
    }
}

fn checks(checks: &[MountCheck]) -> Markup {
    let row = |check: &MountCheck| {
        let (factor, unit) = match check.unit.as_str() {
            "rad" => (1f64.to_degrees(), "°"),
            "rad/s" => (1f64.to_degrees(), "°/s"),
            unit => (1.0, unit),
        };
        html! {
            tr {
                th scope="row" { (shown(&check.name)) }
                td.n { (finding(&check.fitted, |found| estimate(&number::scaled(found, factor)))) }
                td.n { (or_why(check.stated, "nothing", |stated| plain(stated * factor, 5))) }
                td { (shown(unit)) }
                td { (check.agrees.map_or_else(|| badge("off", "○", "not compared"), met_badge)) }
                td.any { (shown(&check.text)) }
            }
        }
    };
    let head =
        [Text("What"), Number("From the data"), Number("Compared with"), Text("Unit"), Text("Agree"), Text("In words")];
    html! {
        @if checks.is_empty() { p { "Nothing was compared." } }
        @else {
            (folded(&number::counted(checks.len() as u64, "number of mount and calibration", "numbers of mount and calibration"),
                checks.iter().all(|c| c.agrees == Some(true)),
                &table("Data against what the rig file states or what is in use; ± is U with k = 2. They agree within three standard \
                    uncertainties and a tolerance",
                &head, rows(checks, 80, head.len(), row))))
        }
    }
}

fn bar(found: &Flexibility) -> Markup {
    let hertz = |e| html! { (estimate(e)) " Hz" };
    let facts = html! {
        (fact("Gain of position, velocity and height", estimate(&found.translation_gain)))
        (fact("Gain of attitude and rate", estimate(&found.rotation_gain)))
        (fact("Frequency of both gains", or_why(found.frequency_hz, "not recorded", |hz| html! { (number::fixed(hz, 2)) " Hz" })))
        (fact("(rotation − 1)/(translation − 1)", html! {
            (finding(&found.ratio, estimate)) "; 1.38 to 1.50 for a bar that bends"
        }))
        (fact("First mode", finding(&found.first_mode_hz, hertz)))
        (fact("First mode that the rig file expects",
            or_why(found.expected_hz, "not stated", |hz| html! { (exact(hz)) " Hz" })))
    };
    html! {
        p { (shown(&found.text)) }
        (table("Whether the bar bends; ± is U with k = 2", &[Text("Item"), Text("Value")], facts))
    }
}

/// A matrix row by row, with uncertainties if known.
pub(in crate::page) fn soft_iron(rows: &[[f64; 3]], uncertainties: &[[f64; 3]]) -> Markup {
    let cell = |row: usize, column: usize, value: f64| match uncertainties.get(row) {
        Some(u) => estimate(&Estimate { value, standard_uncertainty: Some(u[column]) }),
        None => html! { (number::fixed(value, 4)) },
    };
    html! {
        @for (r, row) in rows.iter().enumerate().take(3) {
            div { @for (c, v) in row.iter().enumerate() { @if c > 0 { ", " } (cell(r, c, *v)) } }
        }
    }
}

fn magnetometer(found: &MagnetometerFinding, unit: &str) -> Markup {
    let degrees = |e| html! { (estimate(&number::scaled(e, 1f64.to_degrees()))) "°" };
    let no_ratio = if unit == "µT" { "no model was used" } else { "the scale is the sensor's own" };
    let no_dip = match found.kind.as_str() {
        "planar" if found.azimuths == 1 => "one azimuth does not show it",
        "planar" => "these azimuths do not show it",
        _ => "no model was used",
    };
    let facts = html! {
        (fact("Fit", html! { (shown(&found.kind)) ", from " (number::counted(found.azimuths, "azimuth", "azimuths")) }))
        @for (axis, iron) in ["x", "y", "z"].into_iter().zip(&found.hard_iron) {
            (fact(&format!("Hard iron {axis} ({unit})"), finding(iron, estimate)))
        }
        (fact("Soft iron, row by row", soft_iron(&found.soft_iron, &found.soft_iron_standard_uncertainty)))
        (fact("Condition number of the fit", or_why(found.condition, "a planar fit has no common one", |c| plain(c, 2))))
        (fact(&format!("Rms of residuals ({unit})"), plain(found.residual_rms, 3)))
        (fact("Size of the field over the model's", or_why(found.magnitude_ratio.as_ref(), no_ratio, estimate)))
        (fact("Dip less the model's", or_why(found.dip_error_rad.as_ref(), no_dip, degrees)))
    };
    html! {
        p { (shown_block(&found.text)) }
        (table("Hard and soft iron; ± is U with k = 2", &[Text("Item"), Text("Value")], facts))
    }
}
