//! What a flight's page says about the performance of the compensators, and about what the aircraft computed.

use crate::fixture::{flight_record, onboard};
use crate::html::read;
use crate::page_text::{page, site, text, words};
use record::{Finding, FlightRecord};

/// From the section's heading to the next one.
fn section(record: &FlightRecord, id: &str) -> String {
    let html = page(record);
    let section = html.split(&format!("<h2 id=\"{id}\">")).nth(1).unwrap();
    section.split("<h2").next().unwrap().to_owned()
}

#[test]
fn each_output_is_labelled_as_agreeing_with_its_expected_delay_or_not() {
    let html = section(&flight_record(), "score");
    let row = |name: &str| {
        let rows = html.split("<tr>").filter(|row| row.contains(&format!("<code>{name}</code>")));
        words(rows.take(1).next().unwrap())
    };
    // Measured against expected, ms: 400 ± 1.2, 400; 1.8 ± 1.2, 1.3 (its truncation); 3.1 ± 1.2, 0.
    assert!(row("raw").contains("✓ agrees") && row("raw").contains("400.0 ± 1.2"), "{}", row("raw"));
    assert!(row("pade-1-1").contains("✓ agrees"), "{}", row("pade-1-1"));
    assert!(row("exact-async").contains("! differs"), "{}", row("exact-async"));
}

#[test]
fn an_unknown_number_is_a_dash_with_its_reason_below() {
    let html = section(&flight_record(), "score");
    let text = words(&html);
    assert!(text.contains("ref.") && !text.contains("the lead is that over raw"), "{text}");
    assert!(text.contains("— unknown, "), "{text}");
    assert!(text.contains("unknown"), "{text}");
    // Text from a log is escaped, here in the reason of an unknown term.
    assert!(html.contains("&lt;the flight is too straight&gt;") && !html.contains("<the flight"), "{html}");
}

#[test]
fn the_error_budget_is_shown_next_to_the_measured_error() {
    let html = section(&flight_record(), "score");
    let budget = words(html.split("<h3 id=\"error-budget\">Error budget</h3>").nth(1).unwrap());
    let (total, measured) = budget.split_once("Measured against the reference").unwrap();
    assert!(total.contains("0.0105") || total.contains("0.011"), "{total}");
    assert!(total.contains("0.0193 from the others"), "0.98 × 0.0197, and one term is unknown: {total}");
    assert!(measured.contains("0.01970 ± 0.00083"), "{measured}");
}

#[test]
fn the_figure_of_the_bands_is_drawn_below_the_motion() {
    let record = flight_record();
    let svg = text(&site(&record), "figures/bands.svg");
    for part in [
        "velocity of this flight",
        "less than a tenth of raw",
        "worse than raw",
        ">pade-1-1</text>",
        "exact-async",
        "frequency (Hz)",
    ] {
        assert!(svg.contains(part), "{part}");
    }
    read(&page(&record));
}

#[test]
fn the_onboard_result_is_reported_as_reproduced_or_with_its_difference() {
    let text = words(&section(&flight_record(), "onboard"));
    assert!(text.contains("✓ reproduced position.compensated is what pade-1-1 gives in the replay"), "{text}");
    let mut record = flight_record();
    let other = Finding::CannotTell("the closest, pade-1-1, differs by 0.9 m".to_owned());
    record.replay.as_mut().unwrap().onboard =
        Some(Finding::Found(record::OnboardComparison { reproduced_by: other, ..onboard() }));
    let text = words(&section(&record, "onboard"));
    assert!(text.contains("✗ not reproduced") && text.contains("differs by 0.9 m"), "{text}");
}

#[test]
fn an_older_record_without_scores_still_has_a_page() {
    let mut record = flight_record();
    let replay = record.replay.as_mut().unwrap();
    (replay.scores, replay.onboard) = (None, None);
    let html = page(&record);
    assert!(!html.contains("id=\"score\"") && !html.contains("id=\"onboard\""));
    let old = serde_json::to_string(&record).unwrap();
    assert_eq!(serde_json::from_str::<FlightRecord>(&old).unwrap(), record);
}
