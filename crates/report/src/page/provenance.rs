//! Inputs of the page, and how to regenerate it.

use super::Head::{Number, Text};
use super::{
    FlightPage, command_block, estimate, files, pipeline_details, pipeline_rows, rows, sensor_name, table, versions,
};
use crate::number;
use crate::text::{href, shown};
use crate::verdict;
use maud::{Markup, html};
use record::{CardUse, InputFile};

pub(super) fn section(page: &FlightPage) -> Markup {
    let record = page.record;
    let facts = html! {
        tr { th scope="row" { "Result key" } td.hash { (shown(&record.key)) } }
        tr { th scope="row" { "Versions" } td { (versions(record.record_version, record.analysis_version)) } }
        (pipeline_rows(&record.pipeline))
        @if let Some(card) = record.replay.as_ref().and_then(|r| r.settings.card.as_ref()) { (card_rows(card)) }
    };
    html! {
        h2 id="provenance" { "Files and provenance" }
        @match page.has_details {
            true => (files(&["record.json.gz", "details.json.gz"])),
            false => (files(&["record.json.gz"])),
        }
        @if let Some(track) = page.track_href {
            p.note {
                "The track, raw and compensated: " a href=(href(track)) download="" { "track.parquet" }
                ". For other programs, from the folder of this page: "
                code { "flightlag export . --track --to geojson" } " (or kml, gpx, csv, mcap)."
            }
        }
        (inputs("Input files", &record.inputs))
        (table("Result", &[Text("Item"), Text("Value")], facts))
        (pipeline_details(&record.pipeline))
        h3 { "Make it again" }
        (command_block(page.command))
        p.note { "Run it in the folder that holds what it names. The same logs, settings and versions give the same bytes." }
    }
}

/// The sensor card that the delay was taken from.
fn card_rows(card: &CardUse) -> Markup {
    html! {
        tr { th scope="row" { "Sensor card" } td.any {
            (shown(&card.file)) ": " code { (shown(&card.channel)) } " of " (shown(&sensor_name(&card.sensor))) ", "
            (estimate(&verdict::in_millis(&card.delay_s))) " ms"
        } }
        tr { th scope="row" { "Sensor card BLAKE3" } td.hash { (shown(&card.blake3)) } }
    }
}

/// Files with their hashes.
pub(super) fn inputs(caption: &str, all: &[InputFile]) -> Markup {
    let input = |file: &InputFile| {
        html! {
            tr {
                th scope="row" { (shown(&file.name)) }
                td.n { (number::count(file.bytes)) }
                td.hash { (shown(&file.blake3)) }
            }
        }
    };
    let head = [Text("File"), Number("Bytes"), Text("BLAKE3")];
    table(caption, &head, rows(all, 400, head.len(), input))
}
