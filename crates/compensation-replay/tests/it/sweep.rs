//! The delay sweep on flights with known truth.

use crate::flights::{circle, late};
use crate::golden::{measure_delays, replay};
use compensation_replay::{Settings, Sweeper};
use delay_from_flight::FlightDelaySettings;
use flight::Flight;
use record::{DelaySource, DelaySweep, Estimate, Finding, MeasuredDelay, SweepMethod, SweepOptimum, SweepScore};
use simulate::{FlightSettings, PathKind, SensorSettings, Wander, simulate};

const RADIUS: f64 = 30.0;
const OMEGA: f64 = 17.5 / 30.0;

fn known(value: f64) -> Estimate {
    Estimate { value, standard_uncertainty: None }
}

fn sweeper(flight: &Flight) -> Sweeper {
    Sweeper::of(flight, &Settings::with_delay(late(0.4), "test")).unwrap()
}

fn no_measurement() -> Finding<MeasuredDelay> {
    Finding::CannotTell("not asked".into())
}

fn swept(flight: &Flight, candidates: &[(DelaySource, Estimate)]) -> DelaySweep {
    let sweeper = sweeper(flight);
    sweeper.sweep(candidates, sweeper.best(&no_measurement())).unwrap()
}

fn best(finding: &Finding<SweepOptimum>) -> &SweepOptimum {
    match finding {
        Finding::Found(optimum) => optimum,
        Finding::CannotTell(why) => panic!("{why}"),
    }
}

fn reason<T>(finding: &Finding<T>) -> &str {
    match finding {
        Finding::Found(_) => panic!("an optimum was claimed"),
        Finding::CannotTell(why) => why,
    }
}

/// A delay that is wrong by d leaves the chord 2 R sin(ω d/2) between truth and estimate, at every instant of a circle.
#[test]
fn on_a_circle_the_error_is_the_chord_of_the_closed_formula() {
    let sweep =
        swept(&circle(0.4, 60.0, 4.0, 100.0), &[(DelaySource::Card, known(0.25)), (DelaySource::Fixed, known(0.5))]);
    assert_eq!(sweep.score, SweepScore::ErrorAgainst("position.truth".into()));
    assert!(sweep.delay_s.windows(2).all(|d| d[0] < d[1]));
    assert!(sweep.delay_s[0] <= 0.151 && sweep.delay_s[sweep.delay_s.len() - 1] >= 0.599, "{:?}", sweep.delay_s);
    let chord = |d: f64| 2.0 * RADIUS * (OMEGA * (d - 0.4) / 2.0).sin().abs();
    // Linear interpolation of velocity and reference leave 1e-4 m.
    for (delay, rms) in sweep.delay_s.iter().zip(&sweep.rms_m) {
        assert!((rms - chord(*delay)).abs() < 3e-4, "{delay} s: {rms} instead of {}", chord(*delay));
    }
    let optimum = best(&sweep.optimum);
    assert!((optimum.delay_s.value - 0.4).abs() < 1e-5, "{optimum:?}");
    assert_eq!(optimum.method, SweepMethod::Jackknife);
    let at = |source| sweep.score_at(source).unwrap().rms_m.value;
    assert!((at(DelaySource::Card) - chord(0.25)).abs() < 3e-4);
    assert!((at(DelaySource::Fixed) - chord(0.5)).abs() < 3e-4);
    assert!(at(DelaySource::Sweep) < 3e-4);
    assert!(sweep.score_at(DelaySource::Flight).is_none());
}

/// Between fixes T apart the error turns by ωT: the step is 4 R sin(ω d/2) sin(ωT/2).
#[test]
fn on_a_circle_the_step_at_a_fix_matches_the_closed_formula() {
    let mut flight = circle(0.4, 60.0, 4.0, 100.0);
    flight.channels.remove("position.truth");
    let sweep = swept(&flight, &[(DelaySource::Card, known(0.3))]);
    assert_eq!(sweep.score, SweepScore::StepAtFixes);
    let step = |d: f64| 4.0 * RADIUS * (OMEGA * (d - 0.4) / 2.0).sin().abs() * (OMEGA * 0.25 / 2.0).sin();
    for (delay, rms) in sweep.delay_s.iter().zip(&sweep.rms_m) {
        assert!((rms - step(*delay)).abs() < 3e-4, "{delay} s: {rms} instead of {}", step(*delay));
    }
    assert!(reason(&sweep.optimum).contains("no reference"), "{}", reason(&sweep.optimum));
}

/// All rows of the replay have velocity for every delay of the sweep if it starts early enough.
#[test]
fn the_score_at_the_removed_delay_equals_that_of_the_replay() {
    for case in simulate::LikeCase::ALL {
        let mut flight =
            simulate(&FlightSettings { duration_s: 20.0, ..case.settings(3) }).unwrap().to_flight().unwrap();
        let position = flight.channels.get_mut("position.gps").unwrap();
        let early = position
            .series
            .timeline()
            .stamps()
            .iter()
            .take_while(|s| s.0 < position.series.timeline().stamps()[0].0 + 1_000_000_000)
            .count();
        position.held[..early].fill(true);
        let settings = Settings::with_delay(late(0.4), "test");
        let replayed = replay(&flight, &settings).unwrap().record;
        let sweep = swept(&flight, &[(DelaySource::Fixed, known(0.4))]);
        let replayed = replayed.compensators.iter().find(|c| c.name == "exact-async").unwrap().error_rms_m.unwrap();
        let at = sweep.score_at(DelaySource::Fixed).unwrap().rms_m;
        assert!((at.value - replayed.value).abs() < 1e-9, "{case:?}: {} and {}", at.value, replayed.value);
        let u = [at, replayed].map(|e| e.standard_uncertainty.unwrap());
        assert!((u[0] - u[1]).abs() < 1e-9 * (1.0 + u[1]), "{case:?}: {u:?}");
    }
}

fn circuit(seed: u64) -> FlightSettings {
    FlightSettings {
        duration_s: 90.0,
        seed,
        position: SensorSettings {
            delay_s: 0.4,
            white_std: 0.3,
            wander: Some(Wander { std: 0.2, time_constant_s: 1.0 }),
            ..SensorSettings::clean(5.0)
        },
        velocity: SensorSettings { white_std: 0.07, ..SensorSettings::clean(10.0) },
        ..FlightSettings::default()
    }
}

/// 30 circuits. Of 30 intervals at least 95 % − 4 √(0.05·0.95/30) hold the truth. Errors over uncertainties follow
/// Student's t with the nine degrees of freedom of ten blocks: rms √(9/7), known from 30 to 4/√(2·30).
#[test]
fn the_optimum_against_a_reference_is_the_true_delay_within_its_interval() {
    const TRIALS: u64 = 30;
    let (mut covered, mut squares) = (0_u32, 0.0);
    for seed in 0..TRIALS {
        let flight = simulate(&circuit(500 + seed)).unwrap().to_flight().unwrap();
        let sweeper = sweeper(&flight);
        let found = sweeper.best(&no_measurement());
        let optimum = best(&found);
        covered += u32::from(optimum.interval_95_s[0] <= 0.4 && 0.4 <= optimum.interval_95_s[1]);
        squares += ((optimum.delay_s.value - 0.4) / optimum.delay_s.standard_uncertainty.unwrap()).powi(2);
    }
    let n = TRIALS as f64;
    let ratio = (squares / n).sqrt();
    println!("covered {covered} of {TRIALS}, rms of error over claim {ratio:.3}");
    assert!(f64::from(covered) / n >= 0.95 - 4.0 * (0.05 * 0.95 / n).sqrt(), "{covered}");
    let students = (9.0_f64 / 7.0).sqrt();
    assert!((ratio / students - 1.0).abs() < 4.0 / (2.0 * n).sqrt(), "{ratio}");
}

/// Position 0.4 s late against a reference, velocity 0.1 s late: position against velocity shows 0.3 s, and the least
/// error is at the position's total lateness.
#[test]
fn the_optimum_against_a_reference_includes_the_velocity_delay() {
    let mut settings = circuit(7);
    settings.velocity.delay_s = 0.1;
    let flight = simulate(&settings).unwrap().to_flight().unwrap();
    let found = sweeper(&flight).best(&no_measurement());
    let optimum = best(&found).delay_s;
    // To first order: the rest is ω² Tv Tp/2 of the delay, 0.007 of it here.
    assert!((optimum.value - 0.4).abs() < 4.0 * optimum.standard_uncertainty.unwrap() + 0.004, "{optimum:?}");
}

#[test]
fn without_a_reference_the_optimum_is_the_estimators() {
    let mut flight = simulate(&circuit(1)).unwrap().to_flight().unwrap();
    flight.channels.remove("position.truth");
    let (delays, _) =
        measure_delays(&flight, &FlightDelaySettings { inject_s: vec![], ..FlightDelaySettings::default() });
    let measured = &delays.pairs[0].delay;
    let found = sweeper(&flight).best(measured);
    let optimum = best(&found);
    assert_eq!(optimum.method, SweepMethod::Estimator);
    assert_eq!(Some(optimum.delay_s), measured.found().map(|m| m.delay_s));
    let curve = measured.found().and_then(|m| m.objective.as_ref()).unwrap();
    let least = |x: &[f64], y: &[f64]| x[(0..y.len()).min_by(|a, b| y[*a].total_cmp(&y[*b])).unwrap()];
    assert!(
        (least(&curve.near_delay_s, &curve.near_value) - optimum.delay_s.value).abs() < 1e-9,
        "the middle of the near curve"
    );
    assert!((least(&curve.delay_s, &curve.value) - optimum.delay_s.value).abs() < 0.051, "a step of the wide one");
}

#[test]
fn a_straight_flight_has_no_optimum() {
    let settings = FlightSettings { path: PathKind::Straight { speed_mps: 18.0, heading_rad: 0.7 }, ..circuit(2) };
    let flight = simulate(&settings).unwrap().to_flight().unwrap();
    let found = sweeper(&flight).best(&no_measurement());
    assert!(reason(&found).contains("too straight and steady"), "{}", reason(&found));
}

/// A flight that is 0.55 s late with a card of 0.4 ± 0.003 s: the cost of the card, and its uncertainty.
#[test]
fn lateness_in_excess_of_the_card_costs_speed_times_the_difference() {
    let card = Estimate { value: 0.4, standard_uncertainty: Some(0.003) };
    let sweep = swept(&circle(0.55, 60.0, 4.0, 100.0), &[(DelaySource::Card, card)]);
    let at_card = sweep.score_at(DelaySource::Card).unwrap().rms_m;
    let chord = |d: f64| 2.0 * RADIUS * (OMEGA * d / 2.0).sin();
    assert!((at_card.value - chord(0.15)).abs() < 3e-4, "{at_card:?}");
    // 17.5 m/s times 3 ms; the sample itself is exact.
    assert!((at_card.standard_uncertainty.unwrap() / 0.0525 - 1.0).abs() < 0.02, "{at_card:?}");
    assert!((best(&sweep.optimum).delay_s.value - 0.55).abs() < 1e-5);
}
