//! Pages as text.

use record::FlightRecord;
use report::{FlightPage, Site, flight_site};

/// A file of a site.
pub fn text(site: &Site, path: &str) -> String {
    String::from_utf8(site.files[path].clone()).unwrap()
}

/// The site of a flight.
pub fn site(record: &FlightRecord) -> Site {
    flight_site(&FlightPage {
        name: "n",
        record,
        explorer: None,
        has_details: false,
        neighbours: [None; 2],
        track_href: None,
        index_href: "index.html",
        command: "c",
    })
}

/// The page of a flight.
pub fn page(record: &FlightRecord) -> String {
    text(&site(record), "index.html")
}

/// Page text without markup.
pub fn words(html: &str) -> String {
    let text: String = html.split('<').map(|part| part.split_once('>').map_or(part, |p| p.1)).collect();
    text.replace('\u{a0}', " ")
}

/// Page text without markup and figures, with whitespace normalised.
pub fn words_outside_figures(html: &str) -> String {
    let html: String = html.split("<svg").map(|part| part.split_once("</svg>").map_or(part, |p| p.1)).collect();
    let text: String = html.split('<').map(|part| part.split_once('>').map_or(part, |p| p.1)).collect();
    text.replace(['\u{a0}', '\u{202f}'], " ").split_whitespace().collect::<Vec<_>>().join(" ")
}
