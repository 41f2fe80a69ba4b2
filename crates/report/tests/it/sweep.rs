//! The removed delay, the effect of other delays, and the flights of a campaign combined.

use crate::campaign_fixture::varied;
use crate::fixture::sweep::{error, estimate};
use crate::fixture::{TD, campaign_record, flight_record};
use record::{
    CampaignDelay, CampaignRecord, ControlPoint, DelayOverFlights, DelaySource, Finding, FlightHomogeneity,
    FlightRecord, GroupLateness, PooledSweep,
};
use report::{FlightPage, Site, campaign_site, flight_site};

/// Twelve flights; the eighth is later than the others.
pub fn campaign() -> CampaignRecord {
    let control = (0..12).map(|i| {
        let late = if i == 7 { 0.031 } else { 0.001 * f64::from(i % 3) };
        ControlPoint {
            flight: format!("flight-{i:02}.<mcap>"),
            flown_at: Some(format!("2026-11-{:02}T12:00:00Z", i + 1)),
            delay_s: estimate(TD + late, 0.002),
            centre_s: TD,
            limit_s: 0.009,
            is_outside: i == 7,
        }
    });
    let over = |value: f64| DelayOverFlights {
        flights: 12,
        delay_s: estimate(value, 0.003),
        between_s: Some(0.008),
        homogeneity: Some(FlightHomogeneity { chi2: 212.0, degrees_of_freedom: 11, p: 1e-39 }),
    };
    let delay_s: Vec<f64> = (60..=102).map(|k| 0.005 * f64::from(k)).collect();
    let consistency = CampaignDelay {
        measured: Finding::Found(over(TD + 0.0035)),
        swept: Finding::Found(over(TD + 0.0021)),
        card_s: Some(estimate(TD, 0.0022)),
        control: control.collect(),
        in_time_order: true,
        curve: Finding::Found(PooledSweep {
            against_reference: true,
            flights: 12,
            samples: 71_000,
            rms_m: delay_s.iter().map(|d| error(*d)).collect(),
            delay_s,
        }),
    };
    let names: Vec<String> = campaign_record(12).flights.into_iter().map(|row| row.flight).collect();
    let group = GroupLateness { members: names, consistency: Some(consistency), ..varied(12).groups.remove(0) };
    CampaignRecord { groups: vec![group], ..campaign_record(12) }
}

fn site(record: &FlightRecord) -> Site {
    flight_site(&FlightPage {
        name: "flight 07",
        record,
        explorer: None,
        has_details: false,
        neighbours: [None; 2],
        track_href: None,
        index_href: "../../index.html",
        command: "flightlag",
    })
}

/// Page text without markup, with whitespace normalised.
fn words(site: &Site) -> String {
    let html = String::from_utf8(site.files["index.html"].clone()).unwrap();
    let mut text = String::new();
    for piece in html.split('<') {
        text += piece.split_once('>').map_or(piece, |(_, after)| after);
    }
    let text = text.replace('\u{a0}', " ").replace("&lt;", "<").replace("&gt;", ">");
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn assert_said(text: &str, said: &[&str]) {
    for said in said {
        let begin = said.split_whitespace().next().unwrap_or_default();
        let near = text.find(begin).map(|at| text[at..].chars().take(200).collect::<String>());
        assert!(text.contains(said), "{said}\nfirst `{begin}`: {near:?}");
    }
}

#[test]
fn the_page_shows_the_removed_delay_its_reason_and_the_alternatives() {
    let site = site(&flight_record());
    let text = words(&site);
    assert_said(
        &text,
        &[
            "stated in the pipeline ● removed",
            "no card of <sensor> 7",
            "At the stated value, 400 ± 13 ms, this flight would have had",
            "least error against the reference",
            "95 % interval 399.30 to 401.10 ms",
        ],
    );
    // (400.2 − 400)/√(13² + 0.8²). Position against velocity is not a lateness, so it is not compared.
    assert_said(&text, &["agrees 0.015"]);
    assert!(!text.contains("agrees 0.68"), "{text}");
    for figure in ["figures/delay-sweep.svg", "figures/delay-objective.svg"] {
        assert!(site.files.contains_key(figure), "{figure}");
    }
}

#[test]
fn a_delay_from_the_flight_itself_is_marked_as_not_a_test() {
    let mut record = flight_record();
    let found = record.delays.as_ref().unwrap().pairs[0].delay.found().unwrap().delay_s;
    let replay = record.replay.as_mut().unwrap();
    replay.settings.delay = flight::Delay::from_seconds(found.value).unwrap();
    let choice = replay.choice.as_mut().unwrap();
    (choice.asked, choice.used, choice.circular) = (DelaySource::Flight, DelaySource::Flight, true);
    let text = words(&site(&record));
    assert_said(&text, &["zero by construction and tests nothing"]);
    let plain = words(&site(&flight_record()));
    assert!(!plain.contains("zero by construction"));
}

#[test]
fn a_fallback_is_marked_and_gives_its_reason() {
    let mut record = flight_record();
    let choice = record.replay.as_mut().unwrap().choice.as_mut().unwrap();
    choice.asked = DelaySource::Flight;
    choice.why = "the flight is too straight: the number stands in".into();
    let text = words(&site(&record));
    assert!(
        text.contains("Fallback") && text.contains("asks for first: the flight is too straight: the number stands in.")
    );
}

#[test]
fn an_older_record_without_a_sweep_has_a_page_without_it() {
    let mut record = flight_record();
    let replay = record.replay.as_mut().unwrap();
    (replay.choice, replay.sweep) = (None, None);
    let text = words(&site(&record));
    assert!(!text.contains("Delays that could be removed"));
}

#[test]
fn the_campaign_shows_the_combined_result_and_the_outlier() {
    let site = campaign_site(&campaign(), &[]);
    let text = words(&site);
    assert_said(
        &text,
        &[
            "No common delay: the flights differ by 8.0 ms, 1 σ (χ² = 212, 11 degrees of freedom, p < 0.001).",
            "Their mean, 403.5 ± 6.0 ms over 12 flights, describes none of them; the sensor card has 400.0 ± 4.4 ms: ✓ agrees, \
             E_n = 0.47.",
            "flight-07.<mcap> (431.0 ± 4.0 ms)",
            "1 flight is outside the limits of the group",
        ],
    );
    for figure in ["figures/trend.svg", "figures/valley-1.svg"] {
        assert!(site.files.contains_key(figure), "{figure}");
    }
}
