//! What a flight's page says about the delays estimated from the flight itself.

use crate::fixture::{failed_record, flight_record, parked_record};
use crate::html::read;
use crate::page_text::{page, words};
use record::{DelayPairKind, Finding, FlightRecord, MeasuredDelay};

/// From the section's heading to the next one.
fn section(record: &FlightRecord) -> String {
    let html = page(record);
    let section = html.split("<h2 id=\"delay\">").nth(1).unwrap();
    section.split("<h2").next().unwrap().to_owned()
}

fn main_delay(record: &mut FlightRecord) -> &mut MeasuredDelay {
    match &mut record.delays.as_mut().unwrap().pairs[0].delay {
        Finding::Found(found) => found,
        Finding::CannotTell(why) => panic!("{why}"),
    }
}

#[test]
fn the_replay_pair_comes_first_as_a_difference_and_tests_no_removed_delay() {
    let text = words(&section(&flight_record()));
    // 409.3 ms, U = 2 × 2.1 ms.
    assert!(
        text.contains(
            "position.gps is 409.3 ± 4.2 ms later than velocity.ekf (k = 2). This pair does not show how late"
        ),
        "{text}"
    );
    assert!(!text.contains("Removed was") && !text.contains("E_n"), "a pair has a difference, not a lateness: {text}");
    let html = page(&flight_record());
    let places = [">Evidence</h2>", "<h2 id=\"delay\">", ">Data health</h2>"].map(|t| html.find(t).unwrap());
    assert!(places.is_sorted(), "{places:?}");
}

#[test]
fn a_difference_is_never_called_late_early_or_on_time() {
    let mut record = flight_record();
    for ms in [-12.3, 0.1, 12.3] {
        main_delay(&mut record).delay_s.value = ms / 1e3;
        let text = words(&section(&record));
        let first = text.split("All pairs that were tried").next().unwrap();
        assert!(!["is late", "is early", "on time"].iter().any(|word| first.contains(word)), "{first}");
    }
    main_delay(&mut record).delay_s.value = -0.0123;
    assert!(words(&section(&record)).contains("position.gps is 12.3 ± 4.2 ms earlier than velocity.ekf"));
}

#[test]
fn every_pair_has_a_row_with_its_numbers_or_its_reason() {
    let record = flight_record();
    let text = words(&section(&record));
    for pair in &record.delays.as_ref().unwrap().pairs {
        let said = match &pair.delay {
            Finding::Found(_) => &pair.meaning,
            Finding::CannotTell(why) => why,
        };
        assert!(text.contains(said.as_str()), "{said}");
    }
    // 1.96 × 2.1 ms on either side, 2.8 × 2.1 ms, and both axes.
    assert!(text.contains("405.2 to 413.4") && text.contains("5.9") && text.contains("5\u{202f}780"), "{text}");
}

#[test]
fn the_main_pair_has_tables_of_operating_points_injections_and_pieces() {
    let text = words(&section(&flight_record()));
    for wanted in [
        "ground speed, m/s",
        "15.1 to 18.9",
        "satellites.gps9",
        "t = 0: 2023-11-14 22:13:20.123456 UTC",
        "\u{2212}1.6 ± 8.4",
        "a gap of 10.200 s in velocity.ekf",
        "0.0310 ± 0.0080",
    ] {
        assert!(text.contains(wanted), "{wanted}: {text}");
    }
}

#[test]
fn an_alarm_and_a_rival_are_warnings_and_the_step_is_drawn() {
    let calm = section(&flight_record());
    assert!(!calm.contains("Warning") && !calm.contains("largest step<"));
    let mut record = flight_record();
    let found = main_delay(&mut record);
    found.alarm = Some("the delay changes during the flight".into());
    found.rival_s = Some(0.873);
    let html = section(&record);
    let text = words(&html);
    assert!(text.contains("Warning the delay changes during the flight"), "{text}");
    assert!(text.contains("explains the data almost as well: 873") && html.contains("largest step<"));
}

#[test]
fn a_replay_pair_without_a_delay_leads_with_its_reason() {
    let mut record = flight_record();
    let reason = "the flight is too straight: fly two circles";
    record.delays.as_mut().unwrap().pairs[0].delay = Finding::CannotTell(reason.into());
    let text = words(&section(&record));
    assert!(text.contains("How much later position.gps is than velocity.ekf is unknown from this flight."), "{text}");
    assert!(text.matches(reason).count() == 2 && !text.contains("How to read it"), "{text}");
}

#[test]
fn without_a_replay_the_first_measured_pair_leads() {
    let mut record = flight_record();
    record.replay = None;
    record.delays.as_mut().unwrap().pairs.swap(0, 2);
    record.delays.as_mut().unwrap().pairs.swap(0, 1);
    let text = words(&section(&record));
    assert!(text.contains("position.gps is 398.2 ± 1.8 ms later than position.truth"), "{text}");
    assert!(!text.contains("Removed was") && text.contains("Figure 1. This pair alone: 398.2"), "{text}");
}

#[test]
fn no_pair_and_no_search_are_distinguished() {
    assert!(words(&section(&parked_record())).contains("No pair of channels gives a delay; the table says why."));
    let mut record = flight_record();
    record.delays.as_mut().unwrap().pairs.clear();
    assert!(words(&section(&record)).contains("No two channels of this flight can be compared"));
    assert!(!page(&failed_record()).contains("Delays of pairs of channels"));
}

/// Thousands of everything, with overlong names.
#[test]
fn a_flood_of_pairs_windows_and_pieces_is_truncated_and_counted() {
    let mut record = flight_record();
    let found = main_delay(&mut record);
    found.over_time = vec![found.over_time[1]; 5_000];
    found.pieces = vec![found.pieces[1].clone(); 5_000];
    found.injections = vec![found.injections[0]; 5_000];
    found.splits[0].by = "<b>".repeat(10_000);
    found.splits = vec![found.splits[0].clone(); 5_000];
    found.over_time[3].delay_s.value = f64::NAN;
    found.alarm = Some("<script>".into());
    let pairs = &mut record.delays.as_mut().unwrap().pairs;
    pairs[1].delay = Finding::CannotTell("x".repeat(10_000));
    let more = vec![pairs[1].clone(); 5_000];
    pairs.extend(more);
    let html = page(&record);
    read(&html);
    assert!(html.len() < 700_000, "{}", html.len());
    // 40 rows each of 5003 pairs, 5000 pieces, 5000 injections and 15000 groups; 299 of 5000 windows.
    assert_eq!(html.matches("and 4\u{202f}960 more").count(), 2);
    assert!(html.contains("and 4\u{202f}963 more") && html.contains("and 14\u{202f}960 more"));
    assert!(html.contains("Not drawn, but in the record: 4\u{202f}701."));
}

#[test]
fn the_page_rules_out_only_anomalies_that_were_looked_for() {
    let said = |change: fn(&mut FlightRecord)| {
        let mut record = flight_record();
        record.log.as_mut().unwrap().damage.clear();
        record.binding = None;
        record.replay.as_mut().unwrap().coverage.position_resets = 0;
        record.delays.as_mut().unwrap().pairs.iter_mut().for_each(|pair| pair.varies = None);
        change(&mut record);
        let html = page(&record);
        let section = html.split("<h2 id=\"anomalies\">").nth(1).unwrap().split("<h2").next().unwrap().to_owned();
        words(&section)
    };
    let fitted = said(|_| ());
    assert!(fitted.contains("None: no gap, no damage, no position reset."), "{fitted}");
    let unknown = said(|record| {
        let delay = &mut record.delays.as_mut().unwrap().pairs[0].delay;
        *delay = Finding::CannotTell("the vehicle hardly moved".into());
    });
    assert!(unknown.contains("None: no gap, no damage."), "{unknown}");
}

#[test]
fn the_segments_of_a_velocity_against_an_acceleration_drift_in_its_units() {
    let mut record = flight_record();
    let pair = &mut record.delays.as_mut().unwrap().pairs[0];
    assert_eq!(pair.kind, DelayPairKind::PositionAgainstVelocity);
    let unit = |record: &FlightRecord| words(&page(record)).contains("drift in m/s² (± U, k = 2), noise (σ) in m/s");
    pair.kind = DelayPairKind::VelocityAgainstAcceleration;
    assert!(unit(&record));
    record.delays.as_mut().unwrap().pairs[0].kind = DelayPairKind::PositionAgainstVelocity;
    assert!(words(&page(&record)).contains("drift in m/s (± U, k = 2), noise (σ) in m"));
}
