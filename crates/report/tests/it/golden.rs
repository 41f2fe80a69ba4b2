//! Every page of the fixtures, tag by tag. `FLIGHTLAG_BLESS=1` accepts a change: look at the pages and read the diff.

use crate::campaign_fixture::varied;
use crate::fixture::{failed_record, flight_record, parked_record};
use crate::night_fixture::{diff, night, trend};
use record::{FlightRecord, SensorCard};
use report::{FlightPage, IndexedCard, Site, cards_site, changes_site, diff_site, flight_site, night_site, trend_site};
use simulate::one_tag_per_line;
use std::path::Path;

fn assert_as_accepted(site: &Site, page: &str) {
    let html = String::from_utf8(site.files[page].clone()).unwrap();
    simulate::assert_golden(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden"), &one_tag_per_line(&html));
}

fn flight(record: &FlightRecord) -> Site {
    flight_site(&FlightPage {
        name: "north field/flight 07.mcap",
        record,
        explorer: None,
        has_details: true,
        neighbours: [None, Some(("flight 08.mcap", "../flight-08/index.html"))],
        track_href: Some("track.parquet"),
        index_href: "../../index.html",
        command: "flightlag campaign flights --out reports",
    })
}

#[test]
fn flight_pages_are_as_accepted() {
    let criteria = Some(crate::criteria::criteria());
    assert_as_accepted(&flight(&FlightRecord { criteria, ..flight_record() }), "index.html");
    assert_as_accepted(&flight(&failed_record()), "index.html");
    assert_as_accepted(&flight(&parked_record()), "index.html");
}

#[test]
fn campaign_pages_are_as_accepted() {
    let record = varied(24);
    assert_as_accepted(&crate::campaign::site(&record), "index.html");
    assert_as_accepted(&crate::campaign::site(&crate::sweep::campaign()), "index.html");
    let changes = changes_site(&crate::changes::all_kinds(), &varied(6).flights);
    assert_as_accepted(&changes, "since-last-run.html");
}

#[test]
fn bench_pages_are_as_accepted() {
    crate::bench::all_sites().iter().for_each(|site| assert_as_accepted(site, "index.html"));
}

#[test]
fn the_list_of_cards_is_as_accepted() {
    let (card, records): (SensorCard, _) = crate::bench_fixture::card();
    let of = |card, records| IndexedCard { card, records, href: "a/index.html" };
    let cards = cards_site(&[of(Some(&card), records.len() as u64 + 1), of(None, 1)]);
    assert_as_accepted(&cards, "index.html");
}

#[test]
fn pages_of_a_night_a_trend_and_a_comparison_are_as_accepted() {
    assert_as_accepted(&night_site(&night(), ""), "index.html");
    assert_as_accepted(&trend_site(&trend(), "Trends", ""), "index.html");
    assert_as_accepted(&diff_site(&diff()), "index.html");
}
