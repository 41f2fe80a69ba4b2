//! Inputs of the page, and how to regenerate it.

use super::super::Head::Text;
use super::super::{command_block, fact, provenance, sensor_name, settings_details, table, versions};
use super::BenchPage;
use crate::text::shown;
use maud::{Markup, html};

pub(super) fn section(page: &BenchPage) -> Markup {
    let record = page.record;
    let facts = html! {
        (fact("Sensor", shown(&sensor_name(&record.sensor))))
        (fact("Rig", shown(&record.rig.title)))
        tr { th scope="row" { "Rig BLAKE3" } td.hash { (shown(&record.rig.blake3)) } }
        (fact("Versions", versions(record.record_version, record.analysis_version)))
    };
    html! {
        h2 id="provenance" { "Provenance" }
        @for log in &record.logs { (provenance::inputs(&format!("Input files: {}", log.role), &log.inputs)) }
        (table("Result", &[Text("Item"), Text("Value")], facts))
        (settings_details("Rig as it was used (TOML)", &record.rig.toml))
        h3 { "Make it again" }
        (command_block(page.command))
        p.note { "The same logs, rig and versions give the same bytes." }
    }
}
