//! The decision table: each row tested on a hand-made case.

use delay_network::{FlightSources, PositionLateness, RelativeLateness, decide};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use record::{DelaySource, Estimate, NetworkDatum, NetworkVerdict, RemovedDelay};

const DATUM_S: f64 = 0.005;

fn estimate(value: f64, u: f64) -> Estimate {
    Estimate { value, standard_uncertainty: Some(u) }
}

/// Flight with a network of its own.
fn flight(name: &str, lateness_s: f64) -> FlightSources {
    FlightSources {
        flight: name.to_owned(),
        position: Some(PositionLateness {
            lateness_s: estimate(lateness_s, 0.0081),
            model_uncertainty_s: 0.0078,
            datum: NetworkDatum::Imu,
            verdict: NetworkVerdict::Consistent,
            weak: false,
        }),
        ..FlightSources::default()
    }
}

/// Flight whose network is undecided.
fn undecided(name: &str, change: impl Fn(&mut PositionLateness)) -> FlightSources {
    let mut flight = flight(name, 0.5);
    flight.position.as_mut().into_iter().for_each(change);
    flight
}

fn relative() -> Option<RelativeLateness> {
    Some(RelativeLateness { delay_s: estimate(0.1471, 0.0087), velocity: "velocity.ekf".to_owned() })
}

fn group(count: usize) -> Vec<FlightSources> {
    let values = [0.200, 0.203, 0.198, 0.201, 0.204, 0.199, 0.202, 0.2015];
    (0..count).map(|at| flight(&format!("f{at}"), values[at % values.len()])).collect()
}

fn with(mut group: Vec<FlightSources>, flight: FlightSources) -> Vec<FlightSources> {
    group.push(flight);
    group
}

/// Decision for the last flight of a group.
fn last(group: &[FlightSources], asked: DelaySource) -> RemovedDelay {
    let mut removed = decide(group, asked, DATUM_S).removed;
    assert_eq!(removed.len(), group.len());
    removed.pop().unwrap()
}

fn by_default(group: &[FlightSources]) -> RemovedDelay {
    last(group, DelaySource::Network)
}

#[test]
fn row_1_takes_the_mean_of_the_others() {
    let removed = by_default(&with(group(4), flight("own", 0.210)));
    assert_eq!((removed.row, removed.source, removed.circular), (1, Some(DelaySource::OthersFlights), false));
    assert_eq!((removed.value_s, removed.pooled_flights), (Some(0.201), 4), "0.210 is excluded");
    assert!(removed.z.unwrap() > 0.5 && removed.z.unwrap() < 3.0);
    assert!(removed.words.starts_with("From 4 other flights"), "{}", removed.words);
    let u = removed.standard_uncertainty_s.unwrap();
    assert!((0.0078..0.009).contains(&u));
}

#[test]
fn row_2_takes_the_own_delay_of_a_differing_flight() {
    let all = with(group(5), flight("odd", 0.262));
    let removed = by_default(&all);
    assert_eq!((removed.row, removed.source, removed.circular), (2, Some(DelaySource::OwnNetwork), true));
    assert_eq!(removed.value_s, Some(0.262));
    assert!(removed.z.unwrap() > 3.0);
    assert!(removed.words.contains("Differs from its group: 60.8 ms later"), "{}", removed.words);
    // and it is in no mean
    for other in &decide(&all, DelaySource::Network, DATUM_S).removed[..5] {
        assert_eq!((other.row, other.pooled_flights), (1, 4));
        assert!((other.value_s.unwrap() - 0.201).abs() < 0.0015);
    }
}

#[test]
fn row_3_takes_the_others_if_the_own_delay_is_unknown() {
    for (own, why) in [
        (undecided("own", |p| p.verdict = NetworkVerdict::Undecided), "which one is wrong is unknown"),
        (undecided("own", |p| p.verdict = NetworkVerdict::Scattered), "do not agree"),
        (undecided("own", |p| p.datum = NetworkDatum::Refused), "its IMU is itself late"),
        (undecided("own", |p| p.datum = NetworkDatum::None), "no sensor of this flight ties it to true time"),
        (undecided("own", |p| p.weak = true), "link to true time is a filter"),
        (FlightSources { flight: "own".to_owned(), ..FlightSources::default() }, "no pair of channels gave one"),
        (
            FlightSources {
                flight: "own".to_owned(),
                not_measured: Some("the vehicle does not travel".to_owned()),
                ..FlightSources::default()
            },
            "the vehicle does not travel",
        ),
    ] {
        let removed = by_default(&with(group(4), own));
        assert_eq!((removed.row, removed.source, removed.circular), (3, Some(DelaySource::OthersFlights), false));
        assert_eq!((removed.value_s, removed.pooled_flights, removed.z), (Some(0.201), 4, None));
        assert!(removed.words.contains(why), "{}", removed.words);
    }
}

/// Former bug: a position 301 ms later than its velocity got the mean of flights where it is 147 ms later, and the
/// removal was judged by that mean.
#[test]
fn a_flight_whose_position_minus_velocity_is_unlike_the_others_does_not_get_their_mean() {
    let with_relative = |count| {
        let mut group = group(count);
        group.iter_mut().for_each(|flight| flight.relative = relative());
        group
    };
    let own = |delay_s: f64, velocity: &str| FlightSources {
        flight: "own".to_owned(),
        relative: Some(RelativeLateness { delay_s: estimate(delay_s, 0.0015), velocity: velocity.to_owned() }),
        ..FlightSources::default()
    };
    for (delay_s, velocity, is_unlike) in [
        (0.301, "velocity.ekf", true),
        (0.05, "velocity.ekf", true),
        (0.16, "velocity.ekf", false),
        (0.301, "velocity.gps", false),
    ] {
        let removed = by_default(&with(with_relative(4), own(delay_s, velocity)));
        let source = (!is_unlike).then_some(DelaySource::OthersFlights);
        assert_eq!((removed.source, removed.row), (source, if is_unlike { 8 } else { 3 }), "{delay_s} {velocity}");
        assert_eq!(removed.words.contains("is not its delay"), is_unlike, "{}", removed.words);
    }
    let card = FlightSources { card_s: Some(estimate(0.3, 0.01)), ..own(0.301, "velocity.ekf") };
    assert_eq!(by_default(&with(with_relative(4), card)).source, Some(DelaySource::Card));
}

#[test]
fn row_4_takes_the_own_delay_without_enough_others() {
    for others in [0, 1] {
        let removed = by_default(&with(group(others), flight("own", 0.2104)));
        assert_eq!((removed.row, removed.source, removed.circular), (4, Some(DelaySource::OwnNetwork), true));
        assert_eq!((removed.value_s, removed.z), (Some(0.21), None));
        assert!(removed.words.contains("zero by construction"), "{}", removed.words);
    }
}

#[test]
fn row_5_takes_the_card_if_it_agrees_and_is_better_known() {
    let own = |u| FlightSources { card_s: Some(estimate(0.2041, u)), ..flight("own", 0.202) };
    let better = by_default(&with(group(4), own(0.002)));
    assert_eq!((better.row, better.source, better.circular), (5, Some(DelaySource::Card), false));
    assert_eq!((better.value_s, better.standard_uncertainty_s), (Some(0.2041), Some(0.002)), "a card is not rounded");
    assert!(better.card_e_n.unwrap() < 1.0 && better.words.contains("Card and flights agree"));
    assert_eq!(better.pooled_flights, 4, "the four flights that agree with the card");
    let worse = by_default(&with(group(4), own(0.02)));
    assert_eq!((worse.row, worse.source, worse.value_s), (5, Some(DelaySource::OthersFlights), Some(0.201)));
    assert!(worse.card_e_n.unwrap() < 1.0 && worse.words.starts_with("Card and flights agree. From 4 other"));
    let alone = by_default(&[own(0.002)]);
    assert_eq!((alone.row, alone.source), (5, Some(DelaySource::Card)));
}

#[test]
fn row_6_keeps_the_flights_if_they_contradict_the_card() {
    let own = FlightSources { card_s: Some(estimate(0.1, 0.002)), ..flight("own", 0.202) };
    let removed = by_default(&with(group(4), own.clone()));
    assert_eq!((removed.row, removed.source, removed.value_s), (6, Some(DelaySource::OthersFlights), Some(0.201)));
    assert!(removed.card_e_n.unwrap() > 1.0);
    assert!(removed.words.starts_with("Card contradicted by 4 flights."), "{}", removed.words);
    assert!(removed.contradicted.is_some_and(|text| text.starts_with("The card, 100.0 ms, is contradicted")));
    let alone = by_default(&[own]);
    assert_eq!((alone.row, alone.source, alone.circular), (6, Some(DelaySource::OwnNetwork), true));
    assert!(alone.words.starts_with("Card contradicted by 1 flight."));
}

#[test]
fn row_7_takes_a_card_alone() {
    let own = FlightSources {
        flight: "own".to_owned(),
        card_s: Some(estimate(0.1234, 0.002)),
        stated_s: Some(estimate(0.4, 0.01)),
        ..FlightSources::default()
    };
    let removed = by_default(&[own]);
    assert_eq!((removed.row, removed.source, removed.value_s), (7, Some(DelaySource::Card), Some(0.1234)));
    assert!(removed.words.contains("The IMU of no flight verified it"));
    assert_eq!(removed.contradicted, None);
    // A weak figure cannot be removed, but it can contradict the card.
    let weak = FlightSources {
        card_s: Some(estimate(0.9, 0.01)),
        ..undecided("own", |p| (p.weak, p.lateness_s) = (true, estimate(0.13, 0.061)))
    };
    let removed = by_default(&[weak]);
    assert_eq!((removed.row, removed.source), (7, Some(DelaySource::Card)));
    let words = removed.contradicted.unwrap();
    assert!(words.contains("The card") && words.contains("770.0 ms less than stated"), "{words}");
}

#[test]
fn row_8_does_not_use_a_relative_figure_as_a_delay() {
    let own = |card_s, stated_s| FlightSources {
        relative: relative(),
        card_s,
        stated_s,
        ..undecided("own", |p| p.datum = NetworkDatum::None)
    };
    let (card, stated) = (Some(estimate(0.2, 0.004)), Some(estimate(0.4, 0.01)));
    let nothing = by_default(&[own(None, None)]);
    assert_eq!((nothing.row, nothing.source, nothing.value_s), (8, None, None));
    let words = "The lateness of position and velocity.ekf is unknown: ";
    assert!(nothing.words.starts_with(words) && nothing.words.ends_with("Nothing is removed."), "{}", nothing.words);
    let by_card = by_default(&[own(card, stated)]);
    assert_eq!((by_card.row, by_card.source, by_card.value_s), (8, Some(DelaySource::Card), Some(0.2)));
    let by_number = by_default(&[own(None, stated)]);
    assert_eq!((by_number.row, by_number.source, by_number.value_s), (8, Some(DelaySource::Fixed), Some(0.4)));
    assert_eq!(by_number.contradicted, None);
    // a weak figure cannot be removed, but it can contradict
    let weak = FlightSources {
        stated_s: Some(estimate(0.9, 0.01)),
        relative: relative(),
        ..undecided("own", |p| (p.weak, p.lateness_s) = (true, estimate(0.13, 0.061)))
    };
    assert!(by_default(&[weak]).contradicted.unwrap().contains("770.0 ms less than stated"));
}

#[test]
fn row_9_aligns_the_position_with_the_velocity_on_request() {
    let own = FlightSources { relative: relative(), ..flight("own", 0.202) };
    let removed = last(&with(group(4), own), DelaySource::Flight);
    assert_eq!((removed.row, removed.source, removed.circular), (9, Some(DelaySource::Flight), true));
    assert_eq!(removed.value_s, Some(0.147));
    assert!(
        removed.words.contains("position with velocity.ekf: what velocity.ekf itself is late remains"),
        "{}",
        removed.words
    );
    let none = last(&[flight("own", 0.2)], DelaySource::Flight);
    assert_eq!((none.value_s, none.source, none.circular), (None, None, false));
}

#[test]
fn a_stated_number_is_removed_on_request_and_checked_against_flights() {
    let own = |stated| FlightSources {
        stated_s: Some(Estimate { value: stated, standard_uncertainty: None }),
        ..flight("own", 0.203)
    };
    let wrong = last(&[own(0.4)], DelaySource::Fixed);
    assert_eq!((wrong.value_s, wrong.source, wrong.row), (Some(0.4), Some(DelaySource::Fixed), 0));
    let words = wrong.contradicted.unwrap();
    assert!(
        words.contains("400.0 ms") && words.contains("203.0 ± 16.2 ms") && words.contains("197.0 ms less than stated"),
        "{words}"
    );
    assert_eq!(last(&[own(0.203 + 3.0 * 0.0081 - 1e-6)], DelaySource::Fixed).contradicted, None);
    assert!(last(&[own(0.203 - 3.0 * 0.0081 - 1e-6)], DelaySource::Fixed).contradicted.is_some());
    // A flight without its own delay is compared with the other flights, otherwise with its own.
    let by = |flight| last(&with(group(4), flight), DelaySource::Fixed).contradicted.unwrap();
    let silent = FlightSources { position: None, ..own(0.4) };
    assert!(by(silent.clone()).contains("other flights of its group"), "{}", by(silent));
    assert!(by(own(0.4)).contains("this flight"), "{}", by(own(0.4)));
}

#[test]
fn a_requested_card_is_removed_and_checked() {
    let own = FlightSources { card_s: Some(estimate(0.1, 0.002)), ..flight("own", 0.202) };
    let removed = last(&with(group(4), own), DelaySource::Card);
    assert_eq!((removed.row, removed.source, removed.value_s), (6, Some(DelaySource::Card), Some(0.1)));
    assert!(removed.contradicted.is_some() && removed.card_e_n.unwrap() > 1.0);
    let none = last(&group(4), DelaySource::Card);
    assert_eq!((none.value_s, none.source), (None, None));
}

#[test]
fn a_group_of_two_receivers_is_pooled_per_receiver() {
    let mut all = Vec::new();
    for at in 0..5 {
        all.push(flight(&format!("a{at}"), 0.200 + 0.001 * f64::from(at % 3)));
        all.push(flight(&format!("b{at}"), 0.300 + 0.001 * f64::from(at % 3)));
    }
    all.push(undecided("silent", |p| p.verdict = NetworkVerdict::Undecided));
    let decision = decide(&all, DelaySource::Network, DATUM_S);
    for removed in &decision.removed[..10] {
        let near = if removed.flight.starts_with('a') { 0.201 } else { 0.301 };
        assert_eq!((removed.row, removed.pooled_flights), (1, 4), "{}", removed.words);
        assert!((removed.value_s.unwrap() - near).abs() < 0.0015);
    }
    let silent = &decision.removed[10];
    assert_eq!((silent.row, silent.value_s), (8, None));
    assert!(silent.words.contains("Its group has two different delays"), "{}", silent.words);
    assert_eq!(decision.pools.len(), 3, "the whole, and both sides");
    assert_eq!(decision.pools[0].split.as_ref().unwrap().early, ["a0", "a1", "a2", "a3", "a4"]);
    assert_eq!(decision.pools[1].flights, 5);
}

/// Former bug: with delays of 1 and 199 ms, a third flight got "100 ± 400 ms".
#[test]
fn two_flights_that_differ_give_no_mean_to_a_third() {
    let third = undecided("third", |position| position.datum = NetworkDatum::None);
    let removed = by_default(&with(vec![flight("a", 0.001), flight("b", 0.199)], third.clone()));
    assert_eq!((removed.value_s, removed.source), (None, None), "{}", removed.words);
    let alike = by_default(&with(vec![flight("a", 0.198), flight("b", 0.199)], third));
    assert_eq!(alike.source, Some(DelaySource::OthersFlights));
}

#[test]
fn a_flight_with_a_varying_delay_is_in_no_mean() {
    let varying = FlightSources { keep_out_of_pool: Some("its delay steps".to_owned()), ..flight("own", 0.215) };
    let all = with(group(4), varying);
    let decision = decide(&all, DelaySource::Network, DATUM_S);
    assert!(decision.removed[..4].iter().all(|removed| removed.pooled_flights == 3));
    let own = &decision.removed[4];
    assert_eq!((own.row, own.pooled_flights, own.value_s), (1, 4, Some(0.201)));
    assert!(own.z.unwrap() > 1.0 && own.z.unwrap() < 3.0);
    assert_eq!(decision.pools[0].flights, 4);
}

#[test]
fn the_order_of_flights_does_not_matter_and_names_may_repeat() {
    let mut all = with(group(7), flight("odd", 0.262));
    let of = |all: &[FlightSources]| {
        let mut values: Vec<(String, Option<f64>, u8)> = decide(all, DelaySource::Network, DATUM_S)
            .removed
            .into_iter()
            .map(|removed| (removed.flight, removed.value_s, removed.row))
            .collect();
        values.sort_by(|a, b| a.0.cmp(&b.0));
        values
    };
    let first = of(&all);
    all.reverse();
    assert_eq!(of(&all), first);
    all.iter_mut().for_each(|flight| flight.flight = "same".to_owned());
    assert_eq!(of(&all).iter().filter(|(_, _, row)| *row == 1).count(), 7);
}

#[test]
fn twenty_thousand_flights_are_decided_together() {
    let mut rng = Pcg64::seed_from_u64(7);
    let mut many: Vec<FlightSources> = (0..20_000)
        .map(|at| flight(&format!("f{at:05}"), 0.2033 + 0.004 * rng.sample::<f64, _>(StandardNormal)))
        .collect();
    let before = decide(&many, DelaySource::Network, DATUM_S).removed;
    assert!(before.iter().all(|removed| removed.row == 1));
    assert!(before.iter().all(|removed| removed.value_s == Some(0.203)));
    // adding one flight, even an outlier, changes none of the values that a result depends on
    many.push(flight("new", 0.212));
    let after = decide(&many, DelaySource::Network, DATUM_S).removed;
    let key = |removed: &RemovedDelay| (removed.value_s, removed.standard_uncertainty_s, removed.source);
    assert!(before.iter().zip(&after).all(|(before, after)| key(before) == key(after)));
}

#[test]
fn nonsense_never_panics() {
    assert!(decide(&[], DelaySource::Network, DATUM_S).removed.is_empty());
    let broken = [
        flight("nan", f64::NAN),
        undecided("no u", |p| p.lateness_s.standard_uncertainty = None),
        undecided("negative", |p| p.model_uncertainty_s = -1.0),
        FlightSources {
            card_s: Some(estimate(f64::NAN, 0.0)),
            stated_s: Some(estimate(f64::NAN, -1.0)),
            ..flight("card", 0.2)
        },
        FlightSources { card_s: Some(estimate(0.2, 0.0)), ..flight("zero", 0.2) },
    ];
    for asked in [DelaySource::Network, DelaySource::Flight, DelaySource::Card, DelaySource::Fixed, DelaySource::Sweep]
    {
        for removed in decide(&broken, asked, DATUM_S).removed {
            assert!(removed.value_s.is_none_or(f64::is_finite), "{asked:?}: {removed:?}");
            assert!(removed.source.is_some() || removed.value_s.is_none());
        }
    }
}
