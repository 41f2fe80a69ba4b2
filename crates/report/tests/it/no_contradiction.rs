//! A page does not contradict itself: each number and each verdict has one source.

use crate::fixture::{campaign_record, flight_record, sweep::estimate};
use crate::page_text::{page, words_outside_figures};
use record::{
    ChannelLateness, Decision, DelayAdvice, DelayAlarm, DelayKind, DelayNetwork, DelaySource, EffectVerdict,
    FlightLateness, FlightRecord, Gravity, NetworkDatum, NetworkVerdict, Outcome, ReceiverGroup,
};
use report::campaign_site;

/// The text above the first table.
fn top(record: &FlightRecord) -> String {
    words_outside_figures(page(record).split("<h2").next().unwrap())
}

fn alarm(gravity: Gravity, code: &str, text: &str) -> DelayAlarm {
    DelayAlarm { gravity, code: code.into(), text: text.into() }
}

fn channel() -> ChannelLateness {
    ChannelLateness {
        channel: "position.gps".into(),
        lateness_s: estimate(0.203, 0.008),
        model_uncertainty_s: 0.007,
        interval_95_s: [0.187, 0.219],
        part: 0,
        datum: NetworkDatum::Imu,
        relative_to: None,
        derived: false,
        weak: false,
        at_least_s: None,
        filter_not_a_delay: None,
        earlier_than_datum: false,
        against_refused_datum_s: None,
        rests_on: Some("velocity.gps against acceleration, unchecked".into()),
    }
}

/// Position 203 ms late, velocity 60 ms: the difference is 143 ms.
fn lateness() -> FlightLateness {
    FlightLateness {
        reference_file: None,
        key: "k".into(),
        failed: None,
        position: Some("position.gps".into()),
        velocity: Some("velocity.ekf".into()),
        group: ReceiverGroup::default(),
        content: None,
        kind: DelayKind::Constant,
        also: vec![],
        words: "position.gps is 203 ± 16 ms late against the IMU. This rests on velocity.gps against acceleration, unchecked"
            .into(),
        lateness: Some(channel()),
        datum: NetworkDatum::Imu,
        against: "imu".into(),
        verdict: None,
        position_minus_velocity_s: Some(estimate(0.143, 0.007)),
        card: None,
        speed_rms_mps: Some(17.5),
        acceleration_rms_mps2: Some(2.0),
        jitter_s: None,
        lever_arm_s_per_decimetre: None,
        other_receivers: vec![],
        checked_against: None,
        alarms: vec![
            alarm(Gravity::Red, "two-delays-fit", "two delays fit: 203 and 500 ms"),
            alarm(Gravity::Amber, "outliers", "about 9 % of the samples are outliers"),
        ],
        advice: DelayAdvice { set: vec![], fly: Some("Fly 2 minutes of turns.".into()) },
    }
}

fn decision() -> Decision {
    Decision {
        asked: DelaySource::Fixed,
        row: 0,
        used: Some(DelaySource::Fixed),
        delay_s: Some(0.4),
        standard_uncertainty_s: None,
        circular: false,
        words: "The number stated in the pipeline is removed. What was measured contradicts it.".into(),
        contradicted: Some("The stated delay, 400 ms, is contradicted: measured is 203 ± 16 ms.".into()),
    }
}

fn record() -> FlightRecord {
    FlightRecord { lateness: Some(lateness()), decision: Some(decision()), ..flight_record() }
}

/// Former bug: "Nothing to set" below the alarm that the delay jumps, because the mean delay had been removed.
#[test]
fn no_setting_is_accepted_for_a_delay_that_changes() {
    let advice = DelayAdvice { set: vec![], fly: None };
    let of = |kind| {
        let lateness = FlightLateness { kind, advice: advice.clone(), ..lateness() };
        top(&FlightRecord { lateness: Some(lateness), ..record() })
    };
    let steps = of(DelayKind::Steps);
    assert!(steps.contains("Do not set one delay") && !steps.contains("Nothing to set"), "{steps}");
    assert!(!of(DelayKind::Constant).contains("Do not set one delay"));
}

/// Former bug: "Not tested for changes" above the limit of the test.
#[test]
fn a_flight_that_was_tested_for_changes_is_not_called_untested() {
    let of = |kind, position: &str| {
        let lateness = FlightLateness { kind, position: Some(position.into()), ..lateness() };
        top(&FlightRecord { lateness: Some(lateness), ..record() })
    };
    assert!(
        of(DelayKind::Scatters, "position.gps").contains("Differs between windows by more than their uncertainties")
    );
    assert!(of(DelayKind::NotTested, "position.gps").contains("Not tested for changes."));
    assert!(of(DelayKind::NotTested, "position.ins").contains("because it is the output of a filter"));
}

#[test]
fn alarms_are_above_the_first_table_worst_first_and_counted() {
    let text = top(&record());
    let places = ["two delays fit", "9 % of the samples", "is contradicted: measured is 203"]
        .map(|alarm| text.find(alarm).unwrap_or_else(|| panic!("{alarm}: {text}")));
    assert!(places[0] < places[1].min(places[2]), "{text}");
    assert!(
        text.contains("Helped ! 1 red alarm! 2 amber alarms") || text.contains("Helped! 1 red alarm! 2 amber alarms"),
        "{text}"
    );
}

#[test]
fn the_campaign_row_of_a_flight_counts_all_its_alarms() {
    let mut campaign = campaign_record(3);
    (campaign.flights[1].lateness, campaign.flights[1].decision) = (Some(lateness()), Some(decision()));
    campaign.flights[1].attention = vec!["two delays fit: 203 and 500 ms".into()];
    campaign.flights[0].attention = vec!["a velocity gap".into()];
    let html = String::from_utf8(campaign_site(&campaign, &[]).files["index.html"].clone()).unwrap();
    let (attention, all) = html.split_once("<h2 id=\"all\">").unwrap();
    let attention = words_outside_figures(attention.split_once("<h2 id=\"attention\">").unwrap().1);
    let row = words_outside_figures(all.split("<tr").find(|row| row.contains("flight-0001")).unwrap());
    assert!(row.contains("! 1 red alarm! 2 amber alarms"), "{row}");
    assert_eq!(attention.matches("! Red alarm 1 flight").count(), 1, "{attention}");
    assert_eq!(attention.matches("flight-0001").count(), 3, "{attention}");
    // A red alarm ranks above what is merely worth a look.
    assert!(attention.find("flight-0001") < attention.find("flight-0000"), "{attention}");
}

/// The text of a campaign's list of things to do.
fn to_do(campaign: &record::CampaignRecord) -> String {
    let html = String::from_utf8(campaign_site(campaign, &[]).files["index.html"].clone()).unwrap();
    words_outside_figures(html.split("<h2 id=\"todo\">").nth(1).unwrap().split("<h2").next().unwrap())
}

/// Former bug: two of three flights were named, because the advice of the third had another speed.
#[test]
fn advice_that_differs_in_its_numbers_is_one_thing_to_do() {
    let mut campaign = campaign_record(3);
    for (row, mps) in campaign.flights.iter_mut().zip([9, 10, 10]) {
        let advice = DelayAdvice { set: vec![], fly: Some(format!("Fly 2 minutes of turns at {mps} m/s.")) };
        row.lateness = Some(FlightLateness { advice, alarms: vec![], ..lateness() });
    }
    let text = to_do(&campaign);
    assert!(text.contains("3 flights do not show whether the delay changes"), "{text}");
    assert!(text.contains("each page has its own"), "{text}");
}

/// Former bug: only the most frequent advice was shown. The flights without a lateness come first.
#[test]
fn every_kind_of_flight_that_is_needed_is_a_thing_to_do() {
    let mut campaign = campaign_record(3);
    let advised = ["Fly 2 minutes of turns.", "Fly a minute of circles.", "Fly 2 minutes of turns."];
    for (row, fly) in campaign.flights.iter_mut().zip(advised) {
        let advice = DelayAdvice { set: vec![], fly: Some(fly.to_owned()) };
        row.lateness = Some(FlightLateness { advice, alarms: vec![], ..lateness() });
    }
    campaign.flights[1].lateness.as_mut().unwrap().lateness = None;
    let text = to_do(&campaign);
    let at = |what: &str| text.find(what).unwrap_or_else(|| panic!("{what}: {text}"));
    assert!(at("Fly a minute of circles") < at("Fly 2 minutes of turns"), "{text}");
    assert!(text.contains("1 flight does not show how late the position is"), "{text}");
    assert!(text.contains("2 flights do not show whether the delay changes"), "{text}");
}

/// Former bug: "Nothing to do", while the pages of the flights said to remove another delay.
#[test]
fn a_removed_delay_that_leaves_a_larger_error_is_a_thing_to_do() {
    let mut campaign = campaign_record(3);
    campaign.flights[0].effect = Some(record::Effect {
        verdict: EffectVerdict::Helped,
        judged_by: record::JudgedBy::Truth("position.truth".into()),
        error_raw_m: Some(estimate(7.03, 0.1)),
        error_compensated_m: Some(estimate(3.63, 0.1)),
        best_m: Some(0.03),
        short_by: Some(121.0),
        words: String::new(),
    });
    let text = to_do(&campaign);
    assert!(text.contains("Remove another delay from 1 flight: the one that was removed leaves 120 times"), "{text}");
}

#[test]
fn a_flight_that_was_not_replayed_has_no_removed_delay() {
    let parked = FlightRecord {
        outcome: Outcome::NotMeasurable { reason: "the vehicle does not travel".into() },
        replay: None,
        ..record()
    };
    let text = top(&parked);
    assert!(text.contains("RemovedNothing. The vehicle does not travel.") && !text.contains("Removed 400"), "{text}");
}

#[test]
fn an_unknown_lateness_starts_with_cannot_tell() {
    let unknown = FlightLateness {
        kind: DelayKind::CannotTell,
        words: "the vehicle does not travel. Fly circles".into(),
        ..lateness()
    };
    let text = top(&FlightRecord { lateness: Some(unknown), ..record() });
    assert!(text.contains("How lateCannot tell: the vehicle does not travel. Fly circles."), "{text}");
}

#[test]
fn sentences_end_with_one_full_stop_and_verdicts_appear_once() {
    let text = top(&record());
    assert!(!text.contains("..") && !text.contains("helped: "), "{text}");
    assert!(
        text.contains("What was measured contradicts it.") && text.contains("To know more: fly 2 minutes of turns."),
        "{text}"
    );
    assert!(!text.contains("95 % interval"), "± U says it: {text}");
    assert!(text.contains("This rests on velocity.gps"), "{text}");
}

#[test]
fn a_figure_says_late_only_if_the_lateness_is_known() {
    let title = |relative_to: Option<&str>| {
        let mut one = record();
        let channel = one.lateness.as_mut().unwrap().lateness.as_mut().unwrap();
        channel.relative_to = relative_to.map(str::to_owned);
        let html = page(&one);
        let figure = html.split("id=\"fig-7-t\">").nth(1).unwrap().split('<').next().unwrap().to_owned();
        figure.replace('\u{a0}', " ")
    };
    assert_eq!(title(None), "The position is 203 ± 16 ms late; 400 ± 13 ms were removed");
    let relative = title(Some("velocity.ekf"));
    assert_eq!(relative, "The position is 203 ± 16 ms later than velocity.ekf; 400 ± 13 ms were removed");
}

#[test]
fn no_page_calls_a_velocity_on_time_if_its_network_finds_it_late() {
    let text = words_outside_figures(&page(&record()));
    assert!(!text.contains("is on time"), "{text}");
    assert!(text.contains("The position is 143 ± 14 ms later than the velocity"), "{text}");
}

#[test]
fn an_unknown_effect_has_no_table_of_helpful_frequencies() {
    let section = |record: &FlightRecord| {
        let html = page(record);
        words_outside_figures(html.split("<h3>At which frequencies</h3>").nth(1).unwrap().split("<h2").next().unwrap())
    };
    let helped = section(&record());
    assert!(
        helped.contains("Over the whole flight: helped: 7.03 → 0.04 m") && helped.contains("exact-async"),
        "{helped}"
    );
    let mut unknown = record();
    let effect = unknown.effect.as_mut().unwrap();
    (effect.verdict, effect.words) = (EffectVerdict::CannotTell, "cannot tell: 1.00 → 0.99 m".into());
    let text = section(&unknown);
    assert!(text.contains("the whole is unknown") && !text.contains("exact-async"), "{text}");
}

#[test]
fn a_delay_from_the_network_is_not_labelled_a_fallback() {
    let mut record = record();
    let choice = record.replay.as_mut().unwrap().choice.as_mut().unwrap();
    for (used, is_fallback) in
        [(DelaySource::OthersFlights, false), (DelaySource::OwnNetwork, false), (DelaySource::Card, true)]
    {
        (choice.asked, choice.used) = (DelaySource::Network, used);
        let html = {
            let mut one = flight_record();
            one.replay.as_mut().unwrap().choice = Some(choice.clone());
            page(&one)
        };
        assert_eq!(html.contains("Fallback"), is_fallback, "{used:?}");
    }
}

#[test]
fn channels_without_a_datum_have_differences_but_no_lateness() {
    let network = |relative_to: Option<&str>| DelayNetwork {
        channels: vec![ChannelLateness { relative_to: relative_to.map(str::to_owned), ..channel() }],
        covariance_s2: vec![vec![6.4e-5]],
        datum: if relative_to.is_some() { NetworkDatum::None } else { NetworkDatum::Imu },
        datum_words: "words of the datum".into(),
        verdict: NetworkVerdict::Unchecked,
        verdict_words: "No pair is checked by another.".into(),
        named: vec![],
        undecided_between: vec![],
        chi2: 0.0,
        degrees_of_freedom: 0,
        p: None,
        birge: 1.0,
        effects: vec![],
        used_pairs: vec![],
        unused_pairs: vec![],
    };
    let section = |relative_to| {
        let html = page(&FlightRecord { network: Some(network(relative_to)), ..record() });
        words_outside_figures(html.split("<h2 id=\"network\">").nth(1).unwrap().split("<h2").next().unwrap())
    };
    assert!(section(None).contains("One lateness for each channel"));
    let relative = section(Some("velocity.ekf"));
    assert!(relative.contains("Later by ± U (ms)") && relative.contains("relative to velocity.ekf"), "{relative}");
    assert!(!relative.contains("Lateness"), "{relative}");
}

#[test]
fn a_campaign_shows_one_error_before_and_one_after() {
    let html = String::from_utf8(campaign_site(&campaign_record(4), &[]).files["index.html"].clone()).unwrap();
    let head = words_outside_figures(
        html.split("<thead>").find(|part| part.contains("Error before")).unwrap().split("</thead>").next().unwrap(),
    );
    assert!(!head.contains("Error raw") && !head.contains("Error exact"), "{head}");
}
