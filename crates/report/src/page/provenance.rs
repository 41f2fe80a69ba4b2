//! What the page was made from, and how to make it again.

use super::Head::{Number, Text};
use super::{FlightPage, command_block, pipeline_details, pipeline_rows, rows, table, versions};
use crate::number;
use crate::text::shown;
use maud::{Markup, html};
use record::InputFile;

pub(super) fn section(page: &FlightPage) -> Markup {
    let record = page.record;
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
    let facts = html! {
        tr { th scope="row" { "Result key" } td.hash { (shown(&record.key)) } }
        tr { th scope="row" { "Versions" } td { (versions(record.record_version, record.analysis_version)) } }
        (pipeline_rows(&record.pipeline))
    };
    html! {
        h2 { "Provenance" }
        (table("Input files", &head, rows(&record.inputs, 400, head.len(), input)))
        (table("Result", &[Text("Item"), Text("Value")], facts))
        (pipeline_details(&record.pipeline))
        h3 { "Make it again" }
        (command_block(page.command))
        p.note { "The same logs, settings and versions give the same bytes." }
    }
}
