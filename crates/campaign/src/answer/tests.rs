//! Wording of a lateness and of a difference, and other consequences of an answer.

use super::{
    advice, advice_in, change_against_imu, contradicts_reference, fly, kind_of, network_of, other_receiver,
    other_receivers, parameter_differs, receivers_in_words, unknown, unused_imu, velocities_in_words, widen, words,
};
use crate::config::Pipeline;
use crate::known_lateness::{contradiction_of_card, known, velocity_before_motion, velocity_lateness_s};
use crate::line::{DelayLine, LineParts};
use delay_network::{NetworkSettings, PairObservation, ReferenceUse, difference, lineage_from_name, solve};
use flight::{ConfiguredDelay, LogHealth, Notices};
use record::{
    CardDelay, CardUse, ChannelLateness, Decision, DelayAdvice, DelayAlarm, DelayKind, DelayNetwork, DelayOverTime,
    DelayPairKind, DelaySetting, DelaySource, Estimate, Finding, FlightDelays, FlightLateness, Gravity, GroupLateness,
    JudgedBy, MeasuredDelay, NetworkDatum, NetworkVerdict, PairDelay, SensorIdentity,
};

fn estimate(value: f64, u: f64) -> Estimate {
    Estimate { value, standard_uncertainty: Some(u) }
}

/// A position that is late by this, or later than a velocity.
pub(crate) fn late(value_s: f64, relative_to: Option<&str>) -> FlightLateness {
    let channel = ChannelLateness {
        channel: "position.gps".into(),
        lateness_s: estimate(value_s, 0.004),
        model_uncertainty_s: 0.003,
        interval_95_s: [value_s - 0.008, value_s + 0.008],
        part: 0,
        datum: if relative_to.is_some() { NetworkDatum::None } else { NetworkDatum::Imu },
        relative_to: relative_to.map(str::to_owned),
        derived: false,
        weak: false,
        at_least_s: None,
        filter_not_a_delay: None,
        earlier_than_datum: false,
        against_refused_datum_s: None,
        rests_on: None,
    };
    FlightLateness { lateness: Some(channel), velocity: Some("velocity.gps".into()), ..unknown("k") }
}

/// The constant fit may give a delay while the varying fit cannot show that it is constant.
#[test]
fn a_delay_not_known_to_be_constant_is_not_called_constant() {
    let kind = |kind| kind_of(&late(0.203, None), Some(&crate::answer::alarms::tests::over_time(kind)), None);
    assert_eq!((kind(DelayKind::Constant), kind(DelayKind::CannotTell)), (DelayKind::Constant, DelayKind::NotTested));
}

fn decision(contradicted: Option<&str>) -> Decision {
    Decision {
        asked: DelaySource::Fixed,
        row: 0,
        used: Some(DelaySource::Fixed),
        delay_s: Some(0.4),
        standard_uncertainty_s: None,
        circular: false,
        words: String::new(),
        contradicted: contradicted.map(str::to_owned),
    }
}

/// Former bug: "102.9 ± 2.5 ms late, helped" where the clock of the reference was 150 ms off and its velocity 150 ms
/// early.
#[test]
fn a_reference_with_an_early_velocity_is_not_the_zero() {
    let network = |velocity_s: f64, position_s: f64| {
        let pair =
            |kind, first: &str, second: &str, delay_s| PairObservation::measured(kind, first, second, delay_s, 0.001);
        let pairs = [
            pair(DelayPairKind::PositionAgainstReference, "position.gps", "position.reference", position_s),
            pair(DelayPairKind::VelocityAgainstReference, "velocity.gps", "position.reference", velocity_s),
            pair(DelayPairKind::PositionAgainstVelocity, "position.gps", "velocity.gps", position_s - velocity_s),
        ];
        let settings = NetworkSettings { reference: ReferenceUse::Datum, ..NetworkSettings::default() };
        solve(&pairs, &lineage_from_name, &settings).unwrap()
    };
    let text = contradicts_reference(&network(-0.15, 0.103)).unwrap();
    assert!(text.starts_with("velocity.gps would be 150"), "{text}");
    assert_eq!(contradicts_reference(&network(-0.015, 0.235)), None, "within what filters do");
    assert_eq!(contradicts_reference(&network(0.0, -0.1)), None, "a position may be predicted");
}

/// Former bug: the mean of the other flights was taken for the lateness of a straight flight: "✓ helped".
#[test]
fn the_mean_of_the_other_flights_judges_only_a_flight_that_shows_the_same_difference() {
    let removed = Decision { used: Some(DelaySource::OthersFlights), delay_s: Some(0.12), ..decision(None) };
    let shows = |position_minus_velocity_s| FlightLateness {
        velocity: Some("velocity.gps".into()),
        position_minus_velocity_s,
        ..unknown("k")
    };
    assert_eq!(known(&shows(None), &removed), None);
    let same = known(&shows(Some(estimate(0.1, 0.01))), &removed).unwrap();
    assert_eq!((same.lateness_s.value, same.judged_by), (0.12, JudgedBy::Lateness));
    assert!((same.velocity_late_s.unwrap().value - 0.02).abs() < 1e-12);
}

/// A stated delay of 100 ms, where the position is 300 ms later than the velocity.
#[test]
fn a_stated_delay_that_puts_the_velocity_before_the_motion_is_contradicted() {
    let of = |apart_s: f64, used: DelaySource| {
        let lateness = FlightLateness {
            velocity: Some("velocity.gps".into()),
            position_minus_velocity_s: Some(estimate(apart_s, 0.001)),
            ..unknown("k")
        };
        let stated =
            Decision { used: Some(used), delay_s: Some(0.1), standard_uncertainty_s: Some(0.001), ..decision(None) };
        velocity_before_motion(&lateness, &stated)
    };
    let text = of(0.3, DelaySource::Fixed).unwrap();
    assert!(text.starts_with("position - velocity is 300.0 ± 2.0 ms in this flight") && text.contains("200 ms before"));
    assert!(of(0.3, DelaySource::Card).is_some());
    // A velocity that is late explains a larger delay.
    assert_eq!(of(0.05, DelaySource::Fixed), None);
    assert_eq!(of(0.115, DelaySource::Fixed), None);
    assert_eq!(of(0.3, DelaySource::Flight), None);
}

/// Former bug: "harmed" where the card said, rightly, that the velocity is late, too.
#[test]
fn a_card_with_the_velocity_judges_a_flight_that_shows_only_a_difference() {
    let with = |apart_s: f64| {
        let card = CardUse {
            file: "m.card.toml".into(),
            blake3: String::new(),
            sensor: SensorIdentity::default(),
            channel: "position.gps".into(),
            delay_s: estimate(0.4, 0.002),
            velocity_delay_s: Some(estimate(0.25, 0.002)),
        };
        let card = CardDelay { delay_s: card.delay_s, words: String::new(), card, notices: Notices::new() };
        FlightLateness {
            velocity: Some("velocity.gps".into()),
            position_minus_velocity_s: Some(estimate(apart_s, 0.002)),
            card: Some(Finding::Found(card)),
            ..unknown("k")
        }
    };
    let removed = Decision { used: Some(DelaySource::Card), ..decision(None) };
    let found = known(&with(0.15), &removed).unwrap();
    assert!((found.lateness_s.value - 0.4).abs() < 1e-12 && found.judged_by == JudgedBy::Lateness);
    assert!((found.velocity_late_s.unwrap().value - 0.25).abs() < 1e-12);
    assert_eq!(contradiction_of_card(&with(0.15), &removed), None);
    let text = contradiction_of_card(&with(0.185), &removed).unwrap();
    assert_eq!(text, "position - velocity is 185.0 ± 4.0 ms in this flight, and 150.0 ms on the card");
    assert_eq!(contradiction_of_card(&with(0.185), &decision(None)), None, "the card was not removed");
}

/// Former bug: a minute of turns for a step that was measured, and another duration than in the reason.
#[test]
fn what_to_fly_is_what_the_reason_says_and_nothing_for_a_delay_that_changes() {
    let why = "the delay would be known only to ±77 ms. About 4 min of circles at 5 m/s would give a standard uncertainty of 25 ms.";
    assert_eq!(advice_in(why), Some("About 4 min of circles at 5 m/s would give a standard uncertainty of 25 ms."));
    assert_eq!(advice_in("fewer than 20 fixes"), None);
    let steps = FlightLateness { kind: DelayKind::Steps, ..unknown("k") };
    let tested = crate::answer::alarms::tests::over_time(DelayKind::Steps);
    let tested = DelayOverTime { what_to_fly: Some("Fly 2 minutes of turns.".into()), ..tested };
    assert_eq!(fly(&steps, None, Some(&tested)), None);
    assert_eq!(fly(&unknown("k"), None, Some(&tested)).as_deref(), Some("Fly 2 minutes of turns."));
}

/// The kind is relative to the datum next to it; the sentence names that datum.
#[test]
fn a_difference_has_a_kind_and_its_sentence_never_says_late() {
    let tested = crate::answer::alarms::tests::over_time(DelayKind::Constant);
    for (value_s, kind) in [(-0.507, DelayKind::Early), (0.001, DelayKind::OnTime), (0.203, DelayKind::Constant)] {
        assert_eq!(kind_of(&late(value_s, None), Some(&tested), None), kind);
        // Former bug: early and on time, which say that the delay stays the same, where that was not tested.
        assert_eq!(kind_of(&late(value_s, None), None, None), DelayKind::NotTested);
        let difference = late(value_s, Some("velocity.gps"));
        assert_eq!(kind_of(&difference, Some(&tested), None), kind);
        let text = words(&FlightLateness { kind, ..difference }, None, None);
        assert!(text.contains("than velocity.gps; the lateness of both is unknown"), "{text}");
    }
}

/// Former bug: "the lateness of both is unknown", and no word on the IMU that the log has.
/// A velocity against the IMU that was not measured.
fn against_imu(first: &str) -> PairDelay {
    PairDelay {
        kind: DelayPairKind::VelocityAgainstAcceleration,
        first: first.into(),
        second: "attitude.ins + specific-force.imu".into(),
        meaning: String::new(),
        origin: None,
        excitation: None,
        delay: Finding::CannotTell(String::new()),
        varies: None,
        not_for_network: None,
        is_attitude_untested: false,
        lever_arm_s_per_decimetre: None,
    }
}

#[test]
fn an_imu_that_is_not_used_is_reported_with_its_reason() {
    let pair = |first: &str, why: &str| PairDelay { delay: Finding::CannotTell(why.into()), ..against_imu(first) };
    let delays = FlightDelays { pairs: vec![pair("velocity.ekf", "other"), pair("velocity.gps", "check axes")] };
    let relative = late(0.1, Some("velocity.gps"));
    let remark = unused_imu(&relative, &delays).unwrap();
    assert_eq!(remark.text, "attitude.ins + specific-force.imu is not used: check axes");
    assert_eq!(remark.gravity, Gravity::Grey);
    let known = FlightLateness { datum: NetworkDatum::Imu, ..late(0.1, None) };
    assert_eq!(unused_imu(&known, &delays), None);
}

/// The delay of one receiver is wrong for another. Not reported: an equally late receiver, a filter and a truth.
#[test]
fn another_receiver_with_a_different_delay_is_reported() {
    let against_gps = |position: &str, delay_s: f64| {
        PairObservation::measured(DelayPairKind::PositionAgainstVelocity, position, "velocity.gps", delay_s, 0.0005)
    };
    let others = |second: &str, delay_s: f64| {
        let pairs = [against_gps("position.gps", 0.2), against_gps(second, delay_s)];
        let network = solve(&pairs, &lineage_from_name, &NetworkSettings::default()).unwrap();
        let lateness = network.channel("position.gps").cloned();
        let own = FlightLateness { lateness, ..late(0.2, Some("velocity.gps")) };
        receivers_in_words(&FlightLateness { other_receivers: other_receivers(&own, &network), ..own })
    };
    let alarm = other_receiver(&others("position.gps-2", 0.45)).unwrap();
    assert!(alarm.text.starts_with("Another position of this log, position.gps-2, is 450"), "{}", alarm.text);
    assert_eq!((alarm.gravity, alarm.code.as_str()), (Gravity::Amber, "other-receiver"));
    assert_eq!(other_receiver(&others("position.gps-2", 0.201)), None);
    let words = others("position.gps-2", 0.45);
    assert!(words.starts_with(". Another position of this log, position.gps-2, is 450"), "{words}");
    assert!(words.ends_with("ms later than velocity.gps"), "{words}");
    assert_eq!(others("position.gps-2", 0.201), "");
    assert_eq!(others("position.ekf", 0.01), "");
    assert_eq!(others("position.truth", 0.0), "");
}

#[test]
fn another_velocity_at_another_time_is_reported() {
    let against = |velocity: &str, delay_s: f64| {
        PairObservation::measured(DelayPairKind::PositionAgainstVelocity, "position.gps", velocity, delay_s, 0.0005)
    };
    let others = |first: &str, second: &str, delay_s: f64| {
        let pairs = [against(first, 0.23), against(second, delay_s)];
        velocities_in_words(first, &solve(&pairs, &lineage_from_name, &NetworkSettings::default()).unwrap())
    };
    let later = others("velocity.plain", "velocity.gps", 0.08);
    assert!(later.starts_with(". velocity.gps is 150") && later.ends_with("ms later than velocity.plain"), "{later}");
    assert!(others("velocity.plain", "velocity.gps", 0.33).ends_with("ms earlier than velocity.plain"));
    assert_eq!(others("velocity.plain", "velocity.gps", 0.231), "");
    assert_eq!(others("velocity.plain", "velocity.ekf", 0.08), "", "the output of a filter has no single delay");
    assert_eq!(others("velocity.ekf", "velocity.gps", 0.08), "");
}

#[test]
fn the_latenesses_of_position_and_velocity_match_their_difference() {
    let apart = Some(estimate(0.143, 0.003));
    let own = FlightLateness { position_minus_velocity_s: apart, ..late(0.203, None) };
    let velocity_s = velocity_lateness_s(&own, &decision(None)).unwrap();
    assert!((velocity_s.value - 0.060).abs() < 1e-12);
    assert!((velocity_s.standard_uncertainty.unwrap() - 0.005).abs() < 1e-12, "√(4² + 3²) ms");
    let relative = FlightLateness { position_minus_velocity_s: apart, ..late(0.143, Some("velocity.gps")) };
    assert_eq!(velocity_lateness_s(&relative, &decision(None)), None, "how late both are is unknown");
}

#[test]
fn contradictions_are_among_the_alarms_of_the_terminal_and_of_json() {
    let red = DelayAlarm { gravity: Gravity::Red, code: "delay-steps".into(), text: "The delay jumps.".into() };
    let lateness = FlightLateness { alarms: vec![red], ..late(0.203, None) };
    let line = DelayLine::of(&LineParts {
        flight: "a",
        lateness: Some(&lateness),
        decision: Some(&decision(Some("400 ms is contradicted"))),
        effect: None,
        failed: None,
        minor_loss: false,
        damaged: false,
        tail_cut: false,
        warnings: 0,
        warning_texts: &[],
        pending: None,
        replayed: true,
        duplicate_of: None,
    });
    let alarms: Vec<(&str, &str)> = line.alarms.iter().map(|a| (a.gravity.as_str(), a.code.as_str())).collect();
    assert_eq!(alarms, [("red", "delay-steps"), ("amber", "delay-contradicted")]);
}

/// Two receivers in one group: their mean suits neither, and each gets its own setting.
#[test]
fn a_split_group_gives_no_setting_for_its_mean() {
    let flight = |k: u32| {
        let value_s = if k < 5 { 0.2 } else { 0.3 } + 1e-4 * f64::from(k);
        let set = vec![DelaySetting {
            name: "position_s".into(),
            value: value_s,
            unit: "s".into(),
            in_log: None,
            note: String::new(),
            unsuitable: false,
        }];
        let advice = DelayAdvice { set, fly: None };
        FlightLateness { verdict: Some(NetworkVerdict::Consistent), advice, ..late(value_s, None) }
    };
    let flights: Vec<(String, FlightLateness)> = (0..10).map(|k| (format!("f{k}"), flight(k))).collect();
    let named: Vec<(&str, &FlightLateness)> = flights.iter().map(|(name, flight)| (name.as_str(), flight)).collect();
    let groups = crate::decide::over(&named, &crate::config::Pipeline::shipped_default().unwrap()).groups;
    let settings = |mean_s: f64| {
        let near = |g: &&GroupLateness| g.lateness_s.is_some_and(|e| (e.value - mean_s).abs() < 0.01);
        groups.iter().find(near).unwrap().advice.set.len()
    };
    assert_eq!((groups.len(), settings(0.2), settings(0.3)), (3, 1, 1));
    let whole = &groups[0];
    assert!(whole.split.is_some() && whole.is_apart() && whole.lateness_s.is_none() && whole.advice.set.is_empty());
    assert_eq!(groups.iter().map(|group| group.flights).collect::<Vec<_>>(), [10, 5, 5]);
}

/// 200, 240 and 300 ms: none is an outlier among the others, and no mean describes them.
#[test]
fn three_delays_in_a_group_give_no_setting() {
    let value_s = [0.2, 0.201, 0.202, 0.24, 0.3, 0.301];
    let flights: Vec<(String, FlightLateness)> =
        value_s.iter().enumerate().map(|(k, s)| (format!("f{k}"), late(*s, None))).collect();
    let named: Vec<(&str, &FlightLateness)> = flights.iter().map(|(name, flight)| (name.as_str(), flight)).collect();
    let groups = crate::decide::over(&named, &crate::config::Pipeline::shipped_default().unwrap()).groups;
    let whole = &groups[0];
    assert!(whole.is_apart() && whole.lateness_s.is_none() && whole.advice.set.is_empty(), "{}", whole.words);
}

#[test]
fn numbers_against_two_velocities_have_no_common_mean() {
    let against = |velocity: &str, value_s| {
        let mut flight = late(value_s, Some(velocity));
        flight.against = format!("relative to {velocity}");
        flight.datum = NetworkDatum::None;
        flight
    };
    let flights = [
        ("a", against("velocity.ekf", 0.1)),
        ("b", against("velocity.gps", -0.02)),
        ("c", against("velocity.ekf", 0.1)),
    ];
    let named: Vec<(&str, &FlightLateness)> = flights.iter().map(|(name, l)| (*name, l)).collect();
    let decided = crate::decide::over(&named, &Pipeline::shipped_default().unwrap());
    let groups: Vec<(&str, u64)> = decided.groups.iter().map(|g| (g.words.as_str(), g.flights)).collect();
    assert_eq!(groups.len(), 2, "{groups:?}");
    assert!(groups[0].0.contains("later than velocity.ekf (2 of 2 flights)") && groups[0].1 == 2, "{groups:?}");
    assert!(groups[1].0.contains("earlier than velocity.gps (1 of 1 flight)") && groups[1].1 == 1, "{groups:?}");
}

#[test]
fn a_companion_file_is_reported_as_such_without_a_delay_alarm() {
    let alarms = super::companion("k", "a log of the ground station".into()).lateness.alarms;
    let alarms: Vec<(Gravity, &str, &str)> =
        alarms.iter().map(|a| (a.gravity, a.code.as_str(), a.text.as_str())).collect();
    assert_eq!(alarms, [(Gravity::Grey, "companion", "a log of the ground station")]);
}

/// Of a filter against its own IMU only bounds are known: the value is the lower one.
#[test]
fn a_lateness_of_which_only_bounds_are_known_is_no_setting() {
    let with = |interval_95_s: [f64; 2]| {
        let lateness_s = estimate(0.2, 0.03);
        let own = ChannelLateness { lateness_s, interval_95_s, ..late(0.2, None).lateness.unwrap() };
        let out = FlightLateness { lateness: Some(own), ..unknown("k") };
        advice(&lateness_s, &out, None, &LogHealth::default()).set.into_iter().map(|set| set.name).collect::<Vec<_>>()
    };
    assert_eq!(with([0.14, 0.26]), ["position_s"]);
    assert_eq!(with([0.194, 0.32]), [""; 0]);
}

#[test]
fn advice_states_the_values_in_the_logs_and_what_cannot_be_set() {
    let flight = |ms: f64, in_log: Option<f64>| {
        let setting = |name: &str, value: f64, unit: &str, in_log: Option<f64>| DelaySetting {
            name: name.into(),
            value,
            unit: unit.into(),
            in_log,
            note: String::new(),
            unsuitable: false,
        };
        let set = vec![setting("position_s", ms / 1e3, "s", None), setting("GPS_DELAY_MS", ms, "ms", in_log)];
        FlightLateness { advice: DelayAdvice { set, fly: None }, ..unknown("k") }
    };
    let of_parameter = |lateness_s: f64, flights: &[FlightLateness]| {
        let lateness_s = Estimate { value: lateness_s, standard_uncertainty: Some(0.008) };
        crate::answer::advice_for(&lateness_s, &flights.iter().collect::<Vec<_>>()).set.remove(1)
    };
    let same = [flight(203.0, Some(50.0)), flight(205.0, Some(50.0))];
    let set = of_parameter(0.204, &same);
    assert_eq!((set.value, set.note.as_str(), set.unsuitable), (204.0, "it is 50 ms in this log", false));
    // Logs with different values give no common statement, and a value beyond the range cannot be set.
    let other = [flight(203.0, Some(50.0)), flight(205.0, Some(201.0))];
    assert_eq!(of_parameter(0.204, &other).note, "");
    let right = [flight(203.0, Some(200.0)), flight(205.0, Some(200.0))];
    assert_eq!(of_parameter(0.204, &right).note, "it is 200 ms in this log, which agrees");
    let beyond = of_parameter(0.261, &same);
    assert_eq!((beyond.value, beyond.note.as_str(), beyond.unsuitable), (261.0, "it takes 0 to 250 ms", true));
}

/// PX4 renamed the parameter twice and limits it by another; ArduPilot renamed its own once.
#[test]
fn a_parameter_has_the_name_that_the_log_has() {
    let parameter = |system: &str, value_s: f64, stated: &[(&str, f64)]| {
        let configured = |&(parameter, ms): &(&str, f64)| ConfiguredDelay {
            parameter: parameter.into(),
            value_s: 1e-3 * ms,
            meaning: String::new(),
        };
        let mut health = LogHealth::default();
        health.about.system = Some(system.into());
        health.about.configured_delays = stated.iter().map(configured).collect();
        let out = FlightLateness { datum: NetworkDatum::Imu, ..late(value_s, None) };
        let set = advice(&out.lateness_s().unwrap(), &out, None, &health).set.remove(1);
        (set.name, set.note)
    };
    let is = |name: &str, note: &str| (name.to_owned(), note.to_owned());
    assert_eq!(parameter("PX4", 0.11, &[]), is("EKF2_GPS_DELAY", ""));
    let renamed = parameter("PX4", 0.11, &[("SENS_GNSS0_DELAY", 105.0)]);
    assert_eq!(renamed, is("SENS_GNSS0_DELAY", "it is 105 ms in this log, which agrees"));
    let long = [("EKF2_GPS_DELAY", 110.0), ("EKF2_DELAY_MAX", 200.0)];
    let both = "it is 110 ms in this log; raise EKF2_DELAY_MAX too: it is 200 ms in this log";
    assert_eq!(parameter("PX4", 0.23, &long), is("EKF2_GPS_DELAY", both));
    assert_eq!(parameter("PX4", 0.23, &[]), is("EKF2_GPS_DELAY", "raise EKF2_DELAY_MAX too if it is 200 ms"));
    let unnamed = is("GPS1_DELAY_MS", "before ArduPilot 4.6, GPS_DELAY_MS");
    assert_eq!(parameter("ArduCopter V4.5", 0.11, &[]), unnamed);
    let older = parameter("ArduCopter V4.5", 0.11, &[("GPS_DELAY_MS", 0.0)]);
    assert_eq!(older, is("GPS_DELAY_MS", "it is 0 in this log, which means automatic"));
}

/// A parameter of the autopilot shifts position and velocity. If it is no setting for one flight, it is none for all.
#[test]
fn a_parameter_that_would_shift_an_on_time_velocity_is_no_setting() {
    let flight = |note: &str, unsuitable: bool| {
        let (name, unit) = ("GPS_DELAY_MS".into(), "ms".into());
        let set = vec![DelaySetting { name, value: 201.0, unit, in_log: Some(0.0), note: note.into(), unsuitable }];
        FlightLateness { advice: DelayAdvice { set, fly: None }, ..unknown("k") }
    };
    let note = "it also shifts velocity.gps, which is −5 ± 16 ms late";
    let flights = [flight("it is 0 in this log", false), flight(note, true)];
    let lateness_s = Estimate { value: 0.201, standard_uncertainty: Some(0.008) };
    let set = &crate::answer::advice_for(&lateness_s, &flights.iter().collect::<Vec<_>>()).set[0];
    assert!(set.unsuitable && set.note == note, "{set:?}");
    let set = &crate::answer::advice_for(&lateness_s, &[&flights[0]]).set[0];
    assert!(!set.unsuitable, "{set:?}");
}

/// Without a gyro the lateness of the attitude is unknown: it is in U against the IMU, and in no difference.
#[test]
fn an_untested_attitude_widens_the_lateness_against_the_imu_only() {
    let measured = |delay_s: f64| -> Finding<MeasuredDelay> {
        let text = format!(
            r#"{{"delay_s": {{"value": {delay_s}, "standard_uncertainty": 0.002}}, "interval_95_s": [0.0, 1.0], "hessian_s": 0.002,
            "hac_s": 0.002, "widened_s": 0.0, "crlb_s": 0.0, "smallest_detectable_s": 0.0, "samples": 100,
            "downweighted_share": 0.0, "rival_s": null, "pieces": [], "over_time": [], "homogeneity": null, "alarm": null,
            "splits": [], "injections": []}}"#
        );
        let found: MeasuredDelay = serde_json::from_str(&text).unwrap();
        Finding::Found(MeasuredDelay { interval_95_s: [delay_s - 0.004, delay_s + 0.004], ..found })
    };
    let pair = |kind, first: &str, second: &str, delay_s: f64, is_attitude_untested: bool| PairDelay {
        kind,
        second: second.into(),
        delay: measured(delay_s),
        is_attitude_untested,
        ..against_imu(first)
    };
    let solved = |velocity_s: f64, is_untested: bool| {
        use DelayPairKind::{PositionAgainstVelocity, VelocityAgainstAcceleration};
        let imu = "attitude.ins + specific-force.imu";
        let pairs = vec![
            pair(PositionAgainstVelocity, "position.gps", "velocity.gps", 0.2, false),
            pair(VelocityAgainstAcceleration, "velocity.gps", imu, velocity_s, is_untested),
        ];
        network_of(&FlightDelays { pairs }, Some("velocity.gps"), None, false).0.unwrap()
    };
    let (tested, untested) = (solved(0.1, false), solved(0.1, true));
    let u = |n: &DelayNetwork| n.channel("position.gps").unwrap().lateness_s.standard_uncertainty.unwrap();
    assert!((u(&untested) - u(&tested).hypot(0.03)).abs() < 1e-12, "{} {}", u(&untested), u(&tested));
    let apart = |n: &DelayNetwork| difference(n, "position.gps", "velocity.gps").unwrap().standard_uncertainty.unwrap();
    assert!((apart(&untested) - apart(&tested)).abs() < 1e-9);
    let [low, high] = untested.channel("position.gps").unwrap().interval_95_s;
    assert!((0.5 * (high - low) - 1.96 * u(&untested)).abs() < 1e-3, "{low} {high}");
    assert!(untested.datum_words.ends_with("30 ms are assumed (standard uncertainty)."), "{}", untested.datum_words);
    // A velocity that would come before the motion still shows that the IMU is late.
    let early = solved(-0.06, true);
    assert_eq!((early.datum, u(&early)), (NetworkDatum::Refused, u(&solved(-0.06, false))));
}

/// Former bug: position and velocity whose delay steps together were "constant", with a setting, although the record of
/// velocity against IMU held the step.
#[test]
fn a_change_against_the_imu_is_in_the_uncertainty_and_gives_no_single_delay() {
    let found = |after_s: f64| -> MeasuredDelay {
        let text = format!(
            r#"{{"delay_s": {{"value": 0.2, "standard_uncertainty": 0.002}}, "interval_95_s": [0.196, 0.204], "hessian_s": 0.002,
            "hac_s": 0.002, "widened_s": 0.0, "crlb_s": 0.0, "smallest_detectable_s": 0.0, "samples": 100,
            "downweighted_share": 0.0, "rival_s": null, "pieces": [], "over_time": [], "alarm": "the delay changes",
            "homogeneity": {{"chi2": 30.0, "degrees_of_freedom": 9, "p": 1e-5, "largest_step": {{"at_s": 150.0, "p": 1e-6,
                "before_s": {{"value": 0.1, "standard_uncertainty": 0.02}},
                "after_s": {{"value": {after_s}, "standard_uncertainty": 0.02}}}}}},
            "splits": [], "injections": []}}"#
        );
        serde_json::from_str(&text).unwrap()
    };
    let change = |after_s: f64, first: &str| {
        let pair = PairDelay { delay: Finding::Found(found(after_s)), ..against_imu(first) };
        change_against_imu("velocity.gps", &FlightDelays { pairs: vec![pair] })
    };
    let (text, change_s) = change(0.3, "velocity.gps").unwrap();
    assert!(text.starts_with("velocity.gps against attitude.ins + specific-force.imu: the delay changes."), "{text}");
    assert!((change_s.value - 0.2).abs() < 1e-12);
    assert!((change_s.standard_uncertainty.unwrap() - 0.02 * 2.0_f64.sqrt()).abs() < 1e-12);
    assert_eq!(change(0.13, "velocity.gps"), None, "30 ms are left to the uncertainty");
    assert_eq!(change(0.3, "velocity.ekf"), None, "not the velocity that is used");
    let mut channel = late(0.2, None).lateness.unwrap();
    widen(&mut channel, 0.003);
    assert!((channel.lateness_s.standard_uncertainty.unwrap() - 0.005).abs() < 1e-12, "√(4² + 3²) ms");
    let half_s = 0.008_f64.hypot(1.96 * 0.003);
    assert!(
        (channel.interval_95_s[1] - 0.2 - half_s).abs() < 1e-12
            && (0.2 - half_s - channel.interval_95_s[0]).abs() < 1e-12
    );
}

/// Former bug: with GPS_DELAY_MS = 200 a receiver that is on time needed nothing, and the autopilot flew 200 ms ahead.
#[test]
fn a_parameter_that_states_a_delay_of_a_position_on_time_is_an_alarm() {
    let alarm = |late_s: f64, stated_s: f64| {
        let mut health = LogHealth::default();
        health.about.configured_delays =
            vec![ConfiguredDelay { parameter: "GPS_DELAY_MS".to_owned(), value_s: stated_s, meaning: String::new() }];
        let alarm = parameter_differs(&late(late_s, None), &health)?;
        assert_eq!(alarm.code, "parameter-differs");
        Some(alarm.text)
    };
    assert_eq!(alarm(0.001, 0.2).unwrap(), "GPS_DELAY_MS is 200 ms in this log, and position.gps is 1.0 ± 8.0 ms late");
    assert_eq!(alarm(0.001, 0.02), None, "within the interval and 20 ms");
    assert_eq!(alarm(0.001, 0.0), None);
    assert_eq!(alarm(0.18, 0.3), None, "a late position has a setting instead");
}
