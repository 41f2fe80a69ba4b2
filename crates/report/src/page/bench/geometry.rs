//! The rig as built, drawn from the rig file, and where each channel was measured.

use super::super::Head::{Number, Text};
use super::super::{exact, figure, rows, table};
use crate::figure::{BenchFigures, letter};
use crate::text::shown;
use maud::{Markup, html};
use record::{BenchFindings, RigPart};

pub(super) fn section(findings: &BenchFindings, figures: &BenchFigures) -> Markup {
    html! {
        h2 id="geometry" { "Rig" }
        @match &findings.geometry {
            Some(geometry) => {
                div.pair { @for drawn in [&figures.side, &figures.above].into_iter().flatten() { (figure(drawn)) } }
                (parts(&geometry.parts))
            }
            None => { p { "Geometry: not available. Analyse the record again to draw it." } }
        }
    }
}

fn parts(parts: &[RigPart]) -> Markup {
    let head = [
        Text("In the drawing"),
        Text("Channels"),
        Number("Forward (m)"),
        Number("Right (m)"),
        Number("Down (m)"),
        Text("From"),
    ];
    let lettered: Vec<(usize, &RigPart)> = parts.iter().enumerate().collect();
    let row = |(i, part): &(usize, &RigPart)| {
        html! {
            tr {
                th scope="row" { (letter(*i)) }
                td.any { @for (i, name) in part.channels.iter().enumerate() { @if i > 0 { ", " } code { (shown(name)) } } }
                @for arm in part.lever_arm_m { td.n { (exact(arm)) } }
                td { @if part.is_stated { "rig file" } @else { "length and mount of the bar" } }
            }
        }
    };
    table("Lever arms from the pivot at bar angle zero, body axes", &head, rows(&lettered, 40, head.len(), row))
}
