//! The page of changes since the previous run.

use crate::campaign_fixture::varied;
use crate::html::read;
use record::{CampaignChanges, Estimate, MadeWith, MovedDelay, RECORD_VERSION, RerunFlight, TroubleChange};
use report::changes_site;

fn made_with(version: &str) -> MadeWith {
    MadeWith {
        flightlag_version: version.into(),
        analysis_version: 3,
        pipeline_blake3: "ab".into(),
        criteria_blake3: None,
    }
}

/// One change of each kind.
pub fn all_kinds() -> CampaignChanges {
    let names: Vec<String> = varied(6).flights.into_iter().map(|row| row.flight).collect();
    let late = |value| Estimate { value, standard_uncertainty: Some(0.001) };
    let moved = |name: &str| MovedDelay { name: name.into(), before_s: late(0.2), now_s: late(0.21), sigmas: 7.07 };
    let trouble = |name: &str, what: &str| TroubleChange { flight: name.into(), troubles: vec![what.into()] };
    let rerun = |name: &str, cause: &str| RerunFlight { flight: name.into(), causes: vec![cause.into()] };
    CampaignChanges {
        record_version: RECORD_VERSION,
        name: "Goheung".into(),
        before: Some(made_with("0.1.0")),
        now: made_with("0.2.0"),
        new: vec![names[0].clone()],
        gone: vec!["2026-01-01/old.mcap".into()],
        rerun: vec![rerun(&names[1], "the log has changed"), rerun(&names[2], "the log has changed")],
        moved: vec![moved(&names[1])],
        moved_groups: vec![moved("u-blox M8")],
        failing: vec![trouble(&names[3], "harmed")],
        recovered: vec![trouble(&names[4], "log damaged")],
    }
}

fn words(changes: &CampaignChanges) -> String {
    let site = changes_site(changes, &varied(6).flights);
    let html = String::from_utf8(site.files["since-last-run.html"].clone()).unwrap();
    read(&html);
    let text: String = html.split('<').map(|part| part.split_once('>').map_or(part, |p| p.1)).collect();
    text.replace(['\u{a0}', '\u{202f}'], " ")
}

#[test]
fn the_page_lists_new_rerun_moved_and_newly_failing_flights() {
    let text = words(&all_kinds());
    for said in [
        "1 newly failing, 1 with a lateness that moved by more than 2 σ, 2 computed again, 1 new, 1 gone, 1 no longer failing.",
        "flightlag was 0.1.0, is 0.2.0.",
        "New flights: 1",
        "flight-0000.mcap: position.gps is late against the IMU. Helped: error 1.82 m, after 1.32 m.",
        "2 flights, the log has changed: ",
        "flight-0003.mcap: harmed",
        "flight-0004.mcap: log was damaged",
        "200.0 ± 2.0",
        "2026-01-01/old.mcap",
    ] {
        assert!(text.contains(said), "{said} is not in {text}");
    }
}

#[test]
fn a_first_run_and_an_unchanged_run_say_so() {
    let nothing = CampaignChanges {
        now: made_with("0.1.0"),
        new: vec![],
        gone: vec![],
        rerun: vec![],
        moved: vec![],
        moved_groups: vec![],
        failing: vec![],
        recovered: vec![],
        ..all_kinds()
    };
    assert!(nothing.is_empty() && words(&nothing).contains("Nothing changed."));
    let first = CampaignChanges { before: None, ..nothing };
    assert!(!first.is_empty() && words(&first).contains("First run in this folder"));
}
