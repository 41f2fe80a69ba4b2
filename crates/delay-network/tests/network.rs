//! How a network handles wrong pairs, filter lanes, references, separate parts and invalid input.

use delay_network::{Lineage, NetworkSettings, PairObservation, ReferenceUse, difference, lineage_from_name, solve};
use record::DelayPairKind::{
    PositionAgainstReference, PositionAgainstVelocity, VelocityAgainstAcceleration, VelocityAgainstReference,
};
use record::{DelayNetwork, EffectKind, Estimate, NetworkDatum, NetworkVerdict};

const IMU: &str = "attitude.ahrs2 + specific-force.imu";

fn solved(pairs: &[PairObservation]) -> DelayNetwork {
    solve(pairs, &lineage_from_name, &NetworkSettings::default()).unwrap()
}

fn position_velocity(position: (&str, f64), velocity: (&str, f64), u: f64) -> PairObservation {
    PairObservation::measured(PositionAgainstVelocity, position.0, velocity.0, position.1 - velocity.1, u)
}

/// All positions against all velocities, and the measured velocities against the IMU.
fn complete(positions: &[(&str, f64)], velocities: &[(&str, f64)]) -> Vec<PairObservation> {
    let mut pairs: Vec<PairObservation> =
        positions.iter().flat_map(|p| velocities.iter().map(|v| position_velocity(*p, *v, 0.003))).collect();
    for (name, late) in velocities.iter().filter(|(name, _)| lineage_from_name(name) == Lineage::Measured) {
        pairs.push(PairObservation::measured(VelocityAgainstAcceleration, name, IMU, *late, 0.002));
    }
    pairs
}

fn lie(pair: &PairObservation, by_s: f64) -> PairObservation {
    let measured = *pair.delay_s.found().unwrap();
    let u = measured.standard_uncertainty.unwrap();
    PairObservation::measured(pair.kind, &pair.first, &pair.second, measured.value + by_s, u)
}

fn covers(network: &DelayNetwork, channel: &str, truth: f64) -> bool {
    let [low, high] = network.channel(channel).unwrap().interval_95_s;
    (low..=high).contains(&truth)
}

/// Four pairs of a real flight (DeLorean 159): position.gps is truly 203.3 ms late, velocity.ekf 56.2 ms.
fn delorean() -> Vec<PairObservation> {
    vec![
        PairObservation::measured(PositionAgainstVelocity, "position.gps", "velocity.ekf", 0.145_57, 0.009_133),
        PairObservation::measured(PositionAgainstVelocity, "position.gps", "velocity.gps", 0.000_178, 0.001_793),
        PairObservation::measured(VelocityAgainstAcceleration, "velocity.ekf", IMU, -0.002_294, 0.002_033),
        PairObservation::measured(VelocityAgainstAcceleration, "velocity.gps", IMU, 0.201_972, 0.000_929),
    ]
}

const POSITIONS: [(&str, f64); 3] = [("position.gps", 0.200), ("position.gps2", 0.120), ("position.vision", 0.050)];
const VELOCITIES: [(&str, f64); 3] = [("velocity.gps", 0.180), ("velocity.vo", 0.060), ("velocity.ekf", 0.040)];

#[test]
fn the_order_of_the_pairs_does_not_matter() {
    let mut pairs = complete(&POSITIONS, &VELOCITIES);
    pairs.push(lie(&pairs[4], 0.1));
    pairs.push(PairObservation::measured(PositionAgainstReference, "position.gps", "position.truth", 0.2, 0.001));
    pairs.push(position_velocity(("position.a", 0.0), ("velocity.b", 0.0), 0.001).not_used("too slow"));
    let first = solved(&pairs);
    for turn in 1..pairs.len() {
        pairs.rotate_left(1);
        if turn % 3 == 0 {
            pairs.reverse();
        }
        assert_eq!(solved(&pairs), first);
    }
}

/// Making a position 70 ms later in all its pairs makes it 70 ms later and changes nothing else.
#[test]
fn a_later_channel_moves_alone() {
    let pairs = complete(&POSITIONS, &VELOCITIES);
    let before = solved(&pairs);
    for (name, _) in POSITIONS {
        let later: Vec<PairObservation> =
            pairs.iter().map(|pair| if pair.first == name { lie(pair, 0.07) } else { pair.clone() }).collect();
        let after = solved(&later);
        assert_eq!(after.covariance_s2, before.covariance_s2);
        assert!((after.chi2 - before.chi2).abs() < 1e-9 && after.verdict == before.verdict);
        for (a, b) in after.channels.iter().zip(&before.channels) {
            let moved = if a.channel == name { 0.07 } else { 0.0 };
            assert!((a.lateness_s.value - b.lateness_s.value - moved).abs() < 1e-9, "{name}: {}", a.channel);
        }
    }
}

/// Lateness of the first less that of the second, or the reverse.
#[test]
fn swapping_the_names_of_a_pair_changes_nothing() {
    let pairs = complete(&POSITIONS, &VELOCITIES);
    let turned = |pair: &PairObservation| {
        if pair.kind != PositionAgainstVelocity {
            return pair.clone();
        }
        let measured = *pair.delay_s.found().unwrap();
        let u = measured.standard_uncertainty.unwrap();
        PairObservation::measured(pair.kind, &pair.second, &pair.first, -measured.value, u)
    };
    let (here, there) = (solved(&pairs), solved(&pairs.iter().map(turned).collect::<Vec<_>>()));
    for (a, b) in here.channels.iter().zip(&there.channels) {
        assert!((a.lateness_s.value - b.lateness_s.value).abs() < 1e-9, "{}", a.channel);
        let [u, v] = [a, b].map(|c| c.lateness_s.standard_uncertainty.unwrap());
        assert!((u - v).abs() < 1e-9, "{}", a.channel);
    }
    assert!((here.chi2 - there.chi2).abs() < 1e-9 && here.degrees_of_freedom == there.degrees_of_freedom);
}

#[test]
fn a_reference_changes_nothing() {
    let without = solved(&delorean());
    let mut pairs = delorean();
    pairs.push(PairObservation::measured(
        PositionAgainstReference,
        "position.gps",
        "position.simulation",
        0.2033,
        0.001,
    ));
    pairs.push(PairObservation::measured(VelocityAgainstReference, "velocity.ekf", "position.truth", 0.0562, 0.001));
    let with = solved(&pairs);
    assert_eq!(with.unused_pairs.len(), 2);
    let blind = DelayNetwork { unused_pairs: Vec::new(), ..with };
    assert_eq!(blind, without);
}

#[test]
fn a_reference_is_the_datum_only_on_request() {
    let mut pairs = delorean();
    pairs.push(PairObservation::measured(PositionAgainstReference, "position.gps", "position.truth", 0.2033, 0.001));
    let settings = NetworkSettings { reference: ReferenceUse::Datum, ..NetworkSettings::default() };
    let network = solve(&pairs, &lineage_from_name, &settings).unwrap();
    assert_eq!(network.datum, NetworkDatum::Reference);
    let position = network.channel("position.gps").unwrap();
    assert!((position.lateness_s.value - 0.2033).abs() < 0.0005);
    assert!(position.lateness_s.standard_uncertainty.unwrap() < 0.002);
}

#[test]
fn a_wrong_pair_among_three_families_is_named() {
    let truth = complete(&POSITIONS, &VELOCITIES);
    for at in 0..9 {
        for by_s in [0.2, -0.2, 5.0] {
            let mut pairs = truth.clone();
            pairs[at] = lie(&pairs[at], by_s);
            let network = solved(&pairs);
            let names = (&pairs[at].first, &pairs[at].second);
            assert_eq!(network.verdict, NetworkVerdict::Named, "{names:?} {by_s}: {}", network.verdict_words);
            assert_eq!(network.named.len(), 1);
            assert_eq!((&network.named[0].first, &network.named[0].second), names);
            let found = network.effects.iter().find(|effect| effect.name == network.named[0]).unwrap();
            assert!((found.size_s.unwrap() - by_s).abs() < 0.01);
            for (channel, late) in POSITIONS.iter().chain(&VELOCITIES) {
                assert!(covers(&network, channel, *late), "{channel} with a wrong pair in {names:?}");
            }
        }
    }
}

#[test]
fn a_wrong_pair_among_two_families_is_undecided_and_the_hull_covers_it() {
    let (positions, velocities) = (&[("position.gps", 0.2), ("position.ekf", 0.07)], &VELOCITIES[..1]);
    let velocities = [velocities[0], ("velocity.ekf", 0.06)];
    let truth = complete(positions, &velocities);
    for at in 0..4 {
        let mut pairs = truth.clone();
        pairs[at] = lie(&pairs[at], 0.2);
        let network = solved(&pairs);
        assert_eq!(network.verdict, NetworkVerdict::Undecided, "{}", network.verdict_words);
        assert_eq!(network.undecided_between.len(), 4);
        assert!(network.named.is_empty());
        for (channel, late) in positions.iter().chain(&velocities) {
            assert!(covers(&network, channel, *late), "{channel} with wrong pair {at}");
        }
    }
}

#[test]
fn contradicting_lanes_are_scattered_and_widened() {
    let [gps, ekf, lane] = [("velocity.gps", 0.2), ("velocity.ekf", 0.06), ("velocity.ekf-2", 0.06)];
    let mut pairs = complete(&[("position.gps", 0.2), ("position.ekf", 0.07)], &[gps, ekf, lane]);
    let quiet = solved(&pairs);
    // the lanes share the error of a filter, so only noise may separate them
    for pair in pairs.iter_mut().filter(|pair| pair.first == "position.ekf" && pair.second == "velocity.ekf-2") {
        *pair = lie(pair, 0.03);
    }
    let network = solved(&pairs);
    assert_eq!(network.verdict, NetworkVerdict::Scattered, "{}", network.verdict_words);
    let expected = (network.chi2 / f64::from(network.degrees_of_freedom)).sqrt();
    assert!((network.birge - expected).abs() < 1e-12 && network.birge > 1.5);
    let width = |network: &DelayNetwork| {
        let [low, high] = network.channel("position.gps").unwrap().interval_95_s;
        high - low
    };
    assert!((width(&network) / width(&quiet) - network.birge).abs() < 1e-6);
    let u = network.channel("position.gps").unwrap().lateness_s.standard_uncertainty.unwrap();
    assert!((width(&network) - 2.0 * 1.96 * u).abs() < 1e-12, "interval, uncertainty and covariance agree");
    assert!((network.covariance_s2[2][2].sqrt() - u).abs() < 1e-12 || network.channels[2].channel != "position.gps");
}

/// With t of few degrees of freedom, ±1.96 u of a pair alone is too narrow: the interval is that of the pair.
#[test]
fn the_interval_of_a_channel_is_as_wide_as_that_of_its_only_pair() {
    let pair = position_velocity(("position.gps", 0.2), ("velocity.gps", 0.0), 0.05);
    let model_s = NetworkSettings::default().model.of(EffectKind::MeasuredMeasured);
    let half = |few_windows_s: f64| {
        let network = solved(&[PairObservation { few_windows_s, ..pair.clone() }]);
        let channel = network.channel("position.gps").unwrap();
        assert!((channel.lateness_s.standard_uncertainty.unwrap() - 0.05_f64.hypot(model_s)).abs() < 1e-6);
        let [low, high] = channel.interval_95_s;
        assert!((low + high - 0.4).abs() < 1e-9, "the interval is about the value");
        assert_eq!(network.channel("velocity.gps").unwrap().interval_95_s, [0.0, 0.0], "the zero has no uncertainty");
        0.5 * (high - low)
    };
    assert!((half(0.0) - 1.96 * 0.05_f64.hypot(model_s)).abs() < 1e-6);
    assert!((half(0.12) - 1.96 * 0.13_f64.hypot(model_s)).abs() < 1e-6, "5, 12, 13");
}

/// A chain of two pairs without a check: widening one pair widens the position by the same amount.
#[test]
fn widening_a_pair_widens_only_what_depends_on_it() {
    let chain = |widened_s| {
        let first = position_velocity(("position.gps", 0.2), ("velocity.gps", 0.18), 0.002);
        let second = PairObservation::measured(VelocityAgainstAcceleration, "velocity.gps", IMU, 0.18, 0.001);
        let network = solved(&[PairObservation { widened_s, ..first }, second]);
        let u = |channel: &str| network.channel(channel).unwrap().lateness_s.standard_uncertainty.unwrap();
        (u("position.gps"), u("velocity.gps"))
    };
    let (quiet, wide) = (chain(0.0), chain(0.040));
    let model_s = NetworkSettings::default().model.of(EffectKind::MeasuredMeasured);
    let expected = (quiet.0.powi(2) + 0.040_f64.powi(2) - model_s.powi(2)).sqrt();
    assert!((wide.0 - expected).abs() < 1e-9, "{wide:?} {expected}");
    assert!((wide.1 - quiet.1).abs() < 1e-9, "the velocity does not rest on that pair");
    assert!((chain(0.9 * model_s).0 - quiet.0).abs() < 1e-12, "the model error of the pair kind is not added twice");
}

#[test]
fn a_filter_is_not_a_delay_and_a_figure_names_what_it_rests_on() {
    let network = solved(&delorean());
    let filter = network.channel("velocity.ekf").unwrap().filter_not_a_delay.unwrap();
    assert!((filter.value - -0.002_294).abs() < 1e-4, "lateness against its own IMU: {}", filter.value);
    let position = network.channel("position.gps").unwrap();
    assert_eq!(position.filter_not_a_delay, None);
    assert_eq!(position.rests_on.as_deref(), Some("velocity.gps against acceleration, unchecked"));
    assert!(!position.weak && !position.derived && position.at_least_s.is_none());
    assert!(network.datum_words.contains("Its own lateness cannot be seen"));
}

#[test]
fn a_filter_as_the_only_path_to_the_imu_gives_a_weak_lower_bound() {
    let pairs = [
        position_velocity(("position.gps", 0.09), ("velocity.ekf", 0.0), 0.005),
        PairObservation::measured(VelocityAgainstAcceleration, "velocity.ekf", IMU, 0.04, 0.003),
    ];
    let network = solved(&pairs);
    let position = network.channel("position.gps").unwrap();
    assert!(position.weak);
    let Estimate { value, standard_uncertainty } = position.lateness_s;
    let own = standard_uncertainty.unwrap().powi(2) - position.model_uncertainty_s.powi(2);
    assert!((position.at_least_s.unwrap() - (value - 2.0 * own.sqrt())).abs() < 1e-12);
    assert_eq!(position.filter_not_a_delay, None, "without another path there is nothing to compare with");
}

#[test]
fn separate_parts_have_their_own_zero() {
    let pairs = [
        position_velocity(("position.gps", 0.002), ("velocity.gps", 0.0), 0.003),
        position_velocity(("position.ekf", -0.028), ("velocity.ekf", 0.0), 0.009),
        position_velocity(("position.gps", 0.1), ("velocity.ekf", 0.0), 0.009).not_used("the flight was too straight"),
    ];
    let network = solved(&pairs);
    assert_eq!(network.datum, NetworkDatum::None);
    assert_eq!(difference(&network, "position.gps", "position.ekf"), None);
    assert!(network.datum_words.contains("relative to velocity.ekf") && !network.datum_words.contains("IMU"));
}

#[test]
fn the_compensation_velocity_is_the_zero_of_a_part_without_datum() {
    let pairs = [
        position_velocity(("position.gps", 0.2), ("velocity.ekf", 0.05), 0.003),
        position_velocity(("position.gps", 0.2), ("velocity.gps", 0.2), 0.003),
    ];
    let settings =
        NetworkSettings { compensation_velocity: Some("velocity.gps".to_owned()), ..NetworkSettings::default() };
    let network = solve(&pairs, &lineage_from_name, &settings).unwrap();
    let zero = network.channel("velocity.gps").unwrap();
    assert_eq!((zero.lateness_s.value, zero.lateness_s.standard_uncertainty), (0.0, Some(0.0)));
    assert!((network.channel("velocity.ekf").unwrap().lateness_s.value - -0.15).abs() < 1e-9);
    // the difference of both ends is the pair's delay, whichever is the zero
    let between = difference(&network, "position.gps", "velocity.ekf").unwrap();
    assert!((between.value - 0.15).abs() < 1e-9);
    assert!((between.standard_uncertainty.unwrap() - 0.003_f64.hypot(0.008)).abs() < 1e-5);
}

#[test]
fn the_channel_map_overrides_the_name() {
    let pairs = [position_velocity(("position.gps", 0.1), ("velocity.ekf", 0.0), 0.001)];
    let lineage = |name: &str| if name == "velocity.ekf" { Lineage::Measured } else { lineage_from_name(name) };
    let network = solve(&pairs, &lineage, &NetworkSettings::default()).unwrap();
    assert_eq!(network.effects[0].name.kind, EffectKind::MeasuredMeasured);
    assert!(!network.channel("velocity.ekf").unwrap().derived);
}

#[test]
fn invalid_pairs_are_listed_and_never_panic() {
    let measured = |a: &str, b: &str, y: f64, u: f64| PairObservation::measured(PositionAgainstVelocity, a, b, y, u);
    let pairs = [
        measured("a", "a", 0.1, 0.001),
        measured("a", "b", f64::NAN, 0.001),
        measured("a", "b", 0.1, 0.0),
        measured("a", "b", 0.1, -1.0),
        measured("a", "b", 0.1, f64::INFINITY),
        measured("", "", 0.1, 0.1),
    ];
    assert_eq!(solve(&[], &lineage_from_name, &NetworkSettings::default()), None);
    assert_eq!(solve(&pairs, &lineage_from_name, &NetworkSettings::default()), None);
    let strange = [
        measured("position.a", "velocity.b", 1e9, 1e-300),
        measured("position.a", "velocity.b", -1e9, 1e12),
        measured("velocity.b", "position.a", 0.3, 1e-9),
        PairObservation::measured(VelocityAgainstAcceleration, "velocity.b", "", 0.1, 1.0),
        PairObservation::measured(VelocityAgainstAcceleration, "acc[x]", "acc[y]", 0.1, 1.0),
        PairObservation::measured(PositionAgainstReference, "position.truth", "position.truth", 0.1, 1.0),
        PairObservation::measured(PositionAgainstReference, "position.truth", "position.rtk", 0.1, 1.0),
    ];
    for settings in [
        NetworkSettings::default(),
        NetworkSettings { reference: ReferenceUse::Datum, ..NetworkSettings::default() },
        NetworkSettings { shared_noise: 1.0, suspect_w: 0.0, most_freed: 99, ..NetworkSettings::default() },
    ] {
        let all: Vec<PairObservation> = pairs.iter().chain(&strange).cloned().collect();
        for count in 0..all.len() {
            if let Some(network) = solve(&all[count..], &lineage_from_name, &settings) {
                let values = network.channels.iter().flat_map(|c| [c.lateness_s.value, c.interval_95_s[0]]);
                assert!(values.into_iter().all(f64::is_finite));
                serde_json::to_string(&network).unwrap();
            }
        }
    }
}

#[test]
fn the_best_attitude_serves_all_velocities_and_others_are_listed() {
    let against = |velocity: &str, attitude: &str, late: f64, u: f64| {
        let second = format!("attitude.{attitude} + specific-force.imu");
        PairObservation::measured(VelocityAgainstAcceleration, velocity, &second, late, u)
    };
    let mut pairs = delorean();
    pairs.retain(|pair| pair.kind == PositionAgainstVelocity);
    pairs.extend([
        // the first by name is the worst; a third was compared with only one velocity, and with a small uncertainty
        against("velocity.gps", "ahrs2", 0.190, 0.004),
        against("velocity.ekf", "ahrs2", -0.010, 0.004),
        against("velocity.gps", "ekf", 0.202, 0.001),
        against("velocity.ekf", "ekf", -0.002, 0.002),
        against("velocity.ekf", "ins", -0.001, 0.0005),
        against("velocity.gps-2", "ahrs2", 0.2, 0.004),
    ]);
    let network = solved(&pairs);
    let used: Vec<(&str, &str)> = network
        .used_pairs
        .iter()
        .filter(|pair| pair.second.starts_with("acc["))
        .map(|pair| (pair.first.as_str(), pair.second.as_str()))
        .collect();
    // ahrs2 was compared with two measured velocities, so it wins for all of them; the rest is assigned afterwards
    assert_eq!(
        used,
        [("velocity.ekf", "acc[ahrs2+imu]"), ("velocity.gps", "acc[ahrs2+imu]"), ("velocity.gps-2", "acc[ahrs2+imu]")]
    );
    pairs.pop();
    let network = solved(&pairs);
    let used: Vec<&str> = network.used_pairs.iter().map(|pair| pair.second.as_str()).collect();
    assert_eq!(used.iter().filter(|second| **second == "acc[ekf+imu]").count(), 2);
    assert_eq!(network.unused_pairs.len(), 3);
    assert!(network.unused_pairs.iter().all(|pair| pair.why.contains("the same IMU")));
}

#[test]
fn a_record_survives_a_json_round_trip() {
    let network = solved(&delorean());
    let text = serde_json::to_string(&network).unwrap();
    assert!(text.contains("\"datum\":\"imu\"") && text.contains("\"verdict\":\"consistent\""));
    assert_eq!(serde_json::from_str::<DelayNetwork>(&text).unwrap(), network);
}
