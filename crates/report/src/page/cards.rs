//! The overview page of several sensor cards: which sensors were measured, and how late each position is.

use super::Head::{Number, Text};
use super::card::{delay_ms, is_position, time_base, validity};
use super::{Needs, document, estimate, or_why, rows, sensor_name, table, verdict_badge};
use crate::number;
use crate::site::Site;
use crate::text::{href, shown};
use maud::{Markup, html};
use record::SensorCard;

/// One card on the overview page.
#[derive(Debug, Clone, Copy)]
pub struct IndexedCard<'a> {
    /// The card; `None` if nothing was measured.
    pub card: Option<&'a SensorCard>,
    /// Number of records that were given, measured or not.
    pub records: u64,
    /// Path of its page relative to this page; not yet percent-encoded.
    pub href: &'a str,
}

/// The overview page of several sensors: `index.html` with a row for each card, in the order given.
#[must_use]
pub fn cards_site(cards: &[IndexedCard]) -> Site {
    let head = [
        Text("Sensor"),
        Text("Position"),
        Number("Delay (ms)"),
        Text("Measured against"),
        Number("Records used"),
        Text("Validity"),
    ];
    let body = html! {
        main {
            h1 { "Bench reports" }
            p.answer { (number::counted(cards.len() as u64, "sensor", "sensors")) " measured. A positive delay is late." }
            (table("Sensor cards; ± is U with k = 2", &head, rows(cards, 200, head.len(), row)))
        }
    };
    let mut site = Site::default();
    site.add("index.html", document("Bench reports — flightlag", Needs::Nothing, body));
    site
}

fn row(indexed: &IndexedCard) -> Markup {
    let position = indexed.card.and_then(|card| card.channels.iter().find(|c| is_position(c)));
    html! {
        tr {
            th scope="row" {
                a href=(href(indexed.href)) {
                    @match indexed.card { Some(card) => { (shown(&sensor_name(&card.sensor))) } None => { (shown(indexed.href)) } }
                }
            }
            td { (or_why(position, "no position", |c| html! { code { (shown(&c.name)) } " " (verdict_badge(c.verdict)) })) }
            td.n { (or_why(position, "none", |c| estimate(&delay_ms(c)))) }
            td.any { (or_why(position, "no position", |c| time_base(&c.basis))) }
            td.n {
                @match position.map(|c| c.records).filter(|used| *used < indexed.records) {
                    Some(used) => { (number::count(used)) " of " (number::count(indexed.records)) }
                    None => { (number::count(indexed.records)) }
                }
            }
            td.any { (or_why(indexed.card, "nothing was measured", validity)) }
        }
    }
}
