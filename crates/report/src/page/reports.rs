//! The overview page of all reports below one folder.

use super::Head::{Number, Text};
use super::{Needs, document, table};
use crate::number;
use crate::text::{href, shown};
use maud::html;

/// A report below the folder of the page.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReportEntry {
    /// Path of its folder relative to the folder of the page, not yet percent-encoded.
    pub path: String,
    /// `campaign` or `bench`.
    pub kind: String,
    /// Number of flights or records. `None` if it was written by an earlier version of flightlag.
    pub size: Option<u64>,
    /// Findings, one sentence each.
    pub answers: Vec<String>,
    /// Folder or file that it was made from.
    pub source: String,
    /// UTC of its last change, such as `2026-05-04 18:46`.
    pub changed: String,
}

/// `index.html` of a folder of reports, with the entries in the order given.
#[must_use]
pub fn reports_page(entries: &[ReportEntry]) -> String {
    let head = [
        Text("Report"),
        Text("Kind"),
        Number("Flights or records"),
        Text("Answer"),
        Text("Made from"),
        Text("Changed (UTC)"),
    ];
    let row = |entry: &ReportEntry| {
        html! {
            tr {
                th scope="row" { a href={ (href(&entry.path)) "/index.html" } { bdi { (shown(&entry.path)) } } }
                td { (shown(&entry.kind)) }
                td.n { @match entry.size { Some(size) => { (number::count(size)) } None => { "—" } } }
                td.any { @for answer in &entry.answers { div { (shown(answer)) } } }
                td.any { (shown(&entry.source)) }
                td { (shown(&entry.changed)) }
            }
        }
    };
    let body = html! {
        main {
            h1 { "Reports" }
            p.answer { (number::counted(entries.len() as u64, "report", "reports")) ", the newest first." }
            (table("All reports below this folder", &head, html! { @for entry in entries { (row(entry)) } }))
            p.note { "flightlag writes this page again whenever it writes a report below this folder." }
        }
    };
    document(REPORTS_TITLE, Needs::Nothing, body)
}

/// Title of the page.
pub const REPORTS_TITLE: &str = "Reports — flightlag";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_escaped_and_links_are_percent_encoded() {
        let entry = ReportEntry {
            path: "may/<b>#1 & 2?".into(),
            kind: "campaign".into(),
            size: Some(12),
            answers: vec!["<script>alert(1)</script>".into()],
            source: "/logs/\"<i>".into(),
            changed: "2026-05-04 18:46".into(),
        };
        let page = reports_page(&[entry]);
        assert!(page.contains("href=\"may/%3Cb%3E%231%20%26%202%3F/index.html\""), "{page}");
        assert!(!page.contains("<script>alert") && !page.contains("<b>#1") && !page.contains("<i>"), "{page}");
        assert!(page.contains("1 report, the newest first."), "{page}");
    }
}
