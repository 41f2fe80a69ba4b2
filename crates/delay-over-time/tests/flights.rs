//! Simulated flights with known delays. Gates follow from their number; `examples/over_time_study.rs` uses more.

#![allow(clippy::indexing_slicing, clippy::unwrap_used)]

mod support;

use delay_over_time::{CannotAnalyse, OverTimeSettings, PositionAgainstVelocity};
use record::{DelayKind, DelayOverTime, DelayTermKind};
use support::{Case, Flight, GPS, Path, Profile, RTK, TURNING, analyse, fly, inject_step};

fn found(path: Path, profile: Profile, seed: u64) -> DelayOverTime {
    fly(&Case::gps(path, profile), seed).analyse()
}

/// 48 constant flights: with a false-alarm rate of 1 %, two or more have a probability of 8 %, three of 1 %.
#[test]
fn constant_delays_are_not_called_varying() {
    let flights = TURNING.iter().flat_map(|p| (0..12).map(move |s| found(*p, Profile::Constant, 100 + s)));
    let all: Vec<DelayOverTime> = flights.collect();
    assert!(all.iter().filter(|f| f.constancy.varies).count() <= 2);
    assert!(all.iter().filter(|f| f.constancy.tested).count() >= 46);
    assert!(all.iter().filter(|f| f.kind == DelayKind::Constant).count() >= 44);
    let limit = |f: &DelayOverTime| f.remarks.iter().filter(|r| r.contains(" ms or more between ")).count();
    assert!(
        all.iter().filter(|f| f.constancy.tested && !f.constancy.varies).all(|f| limit(f) == 1),
        "{:?}",
        all[0].remarks
    );
}

/// Sum of squared errors over variances of 60 levels: chi-squared with 60 degrees of freedom is within 35 to 92 with 99
/// %. An uncertainty wrong by 20 % moves it by 40 %.
#[test]
fn uncertainties_of_levels_are_calibrated() {
    let squares: f64 = (0..60)
        .map(|s| {
            let level = found(Path::Circuits, Profile::Constant, 3000 + s).level_s;
            ((level.value - 0.2) / level.standard_uncertainty.unwrap()).powi(2)
        })
        .sum();
    assert!((35.0..92.0).contains(&squares), "{squares}");
}

/// Motion is missing, not time: an hour of straight flight gives no more information.
#[test]
fn an_untestable_change_is_explained_by_the_number_of_usable_windows() {
    let noise = [1.5, 60.0, 0.3];
    let cases = [Path::Circuits, Path::Sturns, Path::VarSpeed].into_iter().flat_map(|path| {
        let with = move |(duration, by)| Case { duration, noise, ..Case::gps(path, Profile::Step { by }) };
        [(30.0, 0.4), (40.0, 0.25), (50.0, 0.2), (60.0, 0.15), (60.0, 0.25), (80.0, 0.15)].into_iter().map(with)
    });
    let flights = cases.flat_map(|case| (0..4).map(move |seed| fly(&case, 900 + seed).analyse()));
    let mut remarks_checked = 0;
    for f in flights.filter(|f| f.kind == DelayKind::NotTested) {
        for remark in f.remarks.iter().filter(|remark| remark.starts_with("The delay may change")) {
            let count = format!("of the 8 windows needed, {} could be measured.", f.constancy.windows);
            assert!(remark.ends_with(&count) && f.constancy.windows < 8, "{remark}");
            remarks_checked += 1;
        }
    }
    assert!(remarks_checked > 0);
}

#[test]
fn steps_are_found_with_instant_and_size() {
    for path in [Path::Circuits, Path::Sturns, Path::Survey] {
        for seed in 0..5 {
            let f = found(path, Profile::Step { by: 0.15 }, 500 + seed);
            assert_eq!(f.kind, DelayKind::Steps, "{path:?} {seed}: {}", f.words);
            let step = f.terms.iter().max_by(|a, b| a.size.abs().total_cmp(&b.size.abs())).unwrap();
            assert_eq!(step.kind, DelayTermKind::Step);
            assert!((step.at_s - 120.2).abs() <= 1.0, "{step:?}");
            assert!((step.size - 0.15).abs() < 4.0 * step.standard_uncertainty.max(0.01), "{step:?}");
            assert!(f.span_s > 0.1);
            let [from, to] = f.constancy.detectable_between_s.unwrap();
            assert!((1.0..120.2).contains(&from) && (120.2..239.0).contains(&to), "{from} to {to}");
        }
    }
}

/// A step of the delay moves the position of a fast aircraft by metres, so it often counts as a reset too. Both pieces
/// then constrain its instant.
#[test]
fn a_step_with_a_reset_of_the_position_is_one_step() {
    for (by, noise) in [(0.1, RTK), (0.3, RTK), (0.3, GPS)] {
        for seed in 0..6 {
            let flight = fly(&Case { noise, ..Case::rtk(Path::Circuits, Profile::Constant) }, 620 + seed);
            let t = inject_step(&flight, by, 0.5);
            let at = t.windows(2).max_by(|a, b| (a[1] - a[0]).total_cmp(&(b[1] - b[0]))).unwrap()[1];
            for breaks in [vec![], vec![at]] {
                let record = PositionAgainstVelocity { t: &t, breaks: &breaks, ..flight.record() };
                let f = analyse(&record, &OverTimeSettings::default()).unwrap();
                let case = format!("{by} s, {noise:?}, seed {seed}, breaks {breaks:?}: {}", f.words);
                assert_eq!((f.kind, f.terms.len()), (DelayKind::Steps, 1), "{case}");
                let step = &f.terms[0];
                assert!((step.at_s - at).abs() <= 0.5 && (step.size - by).abs() < 0.02, "{case} {step:?}");
            }
        }
    }
}

#[test]
fn a_build_up_is_a_queue_with_a_burst() {
    for seed in 0..4 {
        let f = found(Path::Circuits, Profile::BuildUp { top: 2.5 }, 700 + seed);
        assert_eq!(f.kind, DelayKind::Queues, "{}", f.words);
        assert_eq!(f.bursts.len(), 1);
        assert!(f.curve.len() <= 200 && f.span_s > 2.0);
        let worst = f.curve.iter().map(|p| p.delay_s).fold(0.0, f64::max);
        assert!((worst - 2.5).abs() < 0.1, "{worst}");
    }
}

#[test]
fn slow_changes_are_named() {
    let ramp = found(Path::Circuits, Profile::Ramp { by: 0.3 }, 41);
    assert!(matches!(ramp.kind, DelayKind::Drifts | DelayKind::BuildsUp), "{}", ramp.words);
    let saw = found(Path::Circuits, Profile::Sawtooth { top: 0.6, period: 40.0 }, 42);
    assert!(saw.kind == DelayKind::Queues || saw.constancy.note.is_some(), "{}", saw.words);
}

/// In circuits, S-turns and surveys: 0.2 s at 25 % of the flight grows to 1.7 s at 70 %, then falls back at once.
#[test]
fn a_queue_is_described_by_its_ramp_levels_and_instants() {
    for seed in 50..58 {
        let case = Case { duration: 240.0, ..Case::gps(TURNING[seed as usize % 3], Profile::BuildUp { top: 1.7 }) };
        let flight = fly(&case, seed);
        let f = flight.analyse();
        assert_eq!(f.kind, DelayKind::Queues, "{seed}: {}", f.words);
        let begins_s = 0.25 * case.duration + 0.2;
        for p in f.curve.iter().filter(|p| p.t_s < begins_s - 4.0) {
            assert!((p.delay_s - 0.2).abs() < 4.0 * p.standard_uncertainty_s + 0.01, "{seed}: {p:?}");
        }
        let most = f.curve.iter().map(|p| p.delay_s).fold(f64::MIN, f64::max);
        assert!((most - 1.7).abs() < 0.1, "{seed}: {most}");
        let first = f.terms.first().unwrap();
        assert!(first.kind == DelayTermKind::Bend && (first.at_s - begins_s).abs() < 4.0, "{seed}: {first:?}");
    }
}

#[test]
fn delays_of_minus_two_to_twelve_seconds_are_measured() {
    for (k, delay) in [-2.0, -0.7, 1.4, 5.3, 12.0].into_iter().enumerate() {
        let path = TURNING[k % 4];
        let f = fly(&Case { delay, ..Case::gps(path, Profile::Constant) }, 900 + k as u64).analyse();
        assert!((f.level_s.value - delay).abs() < 0.1, "{delay}: {}", f.words);
        let expected = if delay < 0.0 { DelayKind::Early } else { DelayKind::Constant };
        assert_eq!(f.kind, expected, "{}", f.words);
        assert!(!f.edge_hit);
    }
}

#[test]
fn a_delay_outside_the_first_search_widens_it() {
    let case = Case { delay: -4.0, ..Case::gps(Path::Circuits, Profile::Constant) };
    let f = fly(&case, 31).analyse();
    assert!((f.level_s.value + 4.0).abs() < 0.1 && f.search_s[0] < -2.5, "{}", f.words);
}

#[test]
fn zero_and_negative_delays_are_named() {
    let zero = fly(&Case { delay: 0.0, ..Case::gps(Path::Circuits, Profile::Constant) }, 11).analyse();
    assert_eq!(zero.kind, DelayKind::OnTime, "{}", zero.words);
    let early = fly(&Case { delay: -0.2, ..Case::gps(Path::Circuits, Profile::Constant) }, 12).analyse();
    assert_eq!(early.kind, DelayKind::Early, "{}", early.words);
    assert!(early.words.contains("velocity is"), "{}", early.words);
}

#[test]
fn straight_flight_gives_no_result() {
    let f = found(Path::Straight, Profile::Constant, 21);
    assert_eq!(f.kind, DelayKind::CannotTell, "{}", f.words);
    assert!(f.what_to_fly.is_some());
    let f = found(Path::Straight, Profile::BuildUp { top: 2.5 }, 22);
    assert!(f.kind == DelayKind::CannotTell && f.words.contains("But the delay changes"), "{}", f.words);
}

#[test]
fn jitter_is_measured_and_is_not_a_step() {
    for path in [Path::Circuits, Path::Survey] {
        let f = found(path, Profile::Jitter { mean: 0.08 }, 61);
        let jitter = f.jitters.expect("jitter").standard_deviation_s;
        assert!((0.05..0.09).contains(&jitter), "{jitter}");
        assert!(!f.constancy.varies);
    }
    assert!(found(Path::Circuits, Profile::Constant, 62).jitters.is_none());
}

/// Between sparse fixes the flight turns: a velocity that is one percent off, and the half step by which the coarse map
/// misses the delay, are not jitter.
#[test]
fn motion_errors_between_sparse_fixes_are_not_jitter() {
    for path in TURNING {
        for (interval_s, velocity_scale, delay) in
            [(3.0, 0.99, 0.2), (6.0, 0.99, 0.2), (2.0, 1.0, 0.25), (7.6, 1.0, 0.25)]
        {
            let (rates, noise, duration) = ([1.0 / interval_s, 25.0], [0.0, 60.0, 0.02], 600.0 * interval_s);
            let case = Case { velocity_scale, delay, duration, rates, noise, ..Case::rtk(path, Profile::Constant) };
            let f = fly(&case, 63).analyse();
            assert!(f.jitters.is_none(), "{path:?}, {interval_s} s: {}", f.words);
        }
    }
}

#[test]
fn an_antenna_ahead_is_not_a_change_of_delay() {
    let f = fly(&Case { lever: 1.0, ..Case::rtk(Path::VarSpeed, Profile::Constant) }, 71).analyse();
    assert_eq!(f.kind, DelayKind::Constant, "{}", f.words);
    let lever = f.lever_arm_m.expect("lever");
    assert!((lever.value - 1.0).abs() < 4.0 * lever.standard_uncertainty.unwrap() + 0.05, "{lever:?}");
    assert!((f.level_s.value - 0.2).abs() < 0.01, "{:?}", f.level_s);
}

#[test]
fn a_position_reset_and_a_velocity_gap_are_not_a_change() {
    let mut flight = fly(&Case::gps(Path::Circuits, Profile::Constant), 91);
    let at = flight.t.partition_point(|t| *t < 130.0);
    flight.north[at..].iter_mut().for_each(|n| *n += 40.0);
    let breaks = [flight.t[at]];
    let record = PositionAgainstVelocity { breaks: &breaks, ..flight.record() };
    let f = analyse(&record, &OverTimeSettings::default()).unwrap();
    assert_eq!(f.kind, DelayKind::Constant, "{}", f.words);
    let keep = |t: f64| !(60.0..75.0).contains(&t);
    let rows: Vec<usize> = (0..flight.velocity_t.len()).filter(|k| keep(flight.velocity_t[*k])).collect();
    let pick = |x: &[f64]| rows.iter().map(|k| x[*k]).collect::<Vec<f64>>();
    let (t, n, e) = (pick(&flight.velocity_t), pick(&flight.velocity_north), pick(&flight.velocity_east));
    let record = PositionAgainstVelocity { velocity_t: &t, velocity_north: &n, velocity_east: &e, ..record };
    let f = analyse(&record, &OverTimeSettings::default()).unwrap();
    assert_eq!(f.kind, DelayKind::Constant, "{}", f.words);
    assert!((f.level_s.value - 0.2).abs() < 0.03);
}

/// No number is NaN or infinite: JSON has no such numbers, so the value read back would differ.
#[test]
fn every_record_survives_json_and_is_reproducible() {
    let cases = [
        (Path::Straight, Profile::Constant),
        (Path::Hover, Profile::Two { by: 0.2, dwell: 60.0 }),
        (Path::Survey, Profile::Spikes { count: 5 }),
        (Path::Circuits, Profile::Jitter { mean: 0.08 }),
    ];
    for (path, profile) in cases {
        let flight = fly(&Case { duration: 100.0, ..Case::gps(path, profile) }, 99);
        let first = flight.analyse();
        let text = serde_json::to_string(&first).unwrap();
        assert_eq!(serde_json::from_str::<DelayOverTime>(&text).unwrap(), first);
        assert_eq!(text, serde_json::to_string(&flight.analyse()).unwrap());
    }
}

#[test]
fn odd_input_is_rejected_or_handled() {
    let flight = fly(&Case { duration: 40.0, ..Case::gps(Path::Circuits, Profile::Constant) }, 5);
    let settings = OverTimeSettings::default();
    let short = PositionAgainstVelocity { north: &flight.north[1..], ..flight.record() };
    assert!(matches!(analyse(&short, &settings), Err(CannotAnalyse::LengthsDiffer { .. })));
    let falling = vec![1.0; flight.t.len()];
    let record = PositionAgainstVelocity { t: &falling, ..flight.record() };
    assert!(matches!(analyse(&record, &settings), Err(CannotAnalyse::BadRow { .. })));
    let later: Vec<f64> = flight.t.iter().map(|t| t + 1e4).collect();
    let record = PositionAgainstVelocity { t: &later, ..flight.record() };
    assert!(matches!(analyse(&record, &settings), Err(CannotAnalyse::NoOverlap { .. })));
    let still = vec![0.0; flight.velocity_t.len()];
    let record = PositionAgainstVelocity { velocity_north: &still, velocity_east: &still, ..flight.record() };
    assert_eq!(analyse(&record, &settings).unwrap().kind, DelayKind::CannotTell);
    let huge: Vec<f64> = flight.north.iter().map(|n| n * 1e150).collect();
    let record = PositionAgainstVelocity { north: &huge, ..flight.record() };
    let text = serde_json::to_string(&analyse(&record, &settings).unwrap()).unwrap();
    assert!(serde_json::from_str::<DelayOverTime>(&text).is_ok(), "{text}");
    let breaks: Vec<f64> = (0..200).map(|k| 0.2 * f64::from(k)).collect();
    let record = PositionAgainstVelocity { breaks: &breaks, ..flight.record() };
    assert_eq!(analyse(&record, &settings).unwrap().kind, DelayKind::CannotTell);
}

/// A pendulum at 1 m/s: slow, but always turning.
#[test]
fn a_slow_pendulum_gives_a_result() {
    let mut random = support::Random::new(7);
    let t: Vec<f64> = (0..1200).map(|k| 0.1 * f64::from(k)).collect();
    let phase = |t: f64| 2.0 * t + 2.5 * (0.13 * t).sin();
    let rate = |t: f64| 2.0 + 2.5 * 0.13 * (0.13 * t).cos();
    let place = |t: f64| [0.5 * phase(t).sin(), 0.2 * (0.7 * phase(t)).cos()];
    let speed = |t: f64| [0.5 * rate(t) * phase(t).cos(), -0.14 * rate(t) * (0.7 * phase(t)).sin()];
    let mut noisy = |x: f64, sigma: f64| x + sigma * random.normal();
    let of = |f: &dyn Fn(f64) -> [f64; 2], a: usize, late: f64| t.iter().map(|t| f(t - late)[a]).collect::<Vec<f64>>();
    let mut series = |f: &dyn Fn(f64) -> [f64; 2], a: usize, late: f64, sigma: f64| -> Vec<f64> {
        of(f, a, late).into_iter().map(|x| noisy(x, sigma)).collect()
    };
    let (north, east) = (series(&place, 0, 0.12, 0.01), series(&place, 1, 0.12, 0.01));
    let (velocity_north, velocity_east) = (series(&speed, 0, 0.0, 0.02), series(&speed, 1, 0.0, 0.02));
    let record = PositionAgainstVelocity {
        t: &t,
        north: &north,
        east: &east,
        velocity_t: &t,
        velocity_north: &velocity_north,
        velocity_east: &velocity_east,
        breaks: &[],
    };
    let f = analyse(&record, &OverTimeSettings::default()).unwrap();
    assert_eq!(f.kind, DelayKind::Constant, "{}", f.words);
    assert!((f.level_s.value - 0.12).abs() < 0.01, "{:?}", f.level_s);
}

/// The flight an hour later, 50 km away, and turned by a quarter: north becomes east, and east becomes south.
#[test]
fn shifting_time_and_place_and_a_quarter_turn_change_nothing() {
    for (profile, seed) in [(Profile::Constant, 7), (Profile::Step { by: 0.2 }, 8)] {
        let here = fly(&Case::gps(Path::Circuits, profile), seed);
        let there = Flight {
            t: here.t.iter().map(|t| t + 3600.0).collect(),
            velocity_t: here.velocity_t.iter().map(|t| t + 3600.0).collect(),
            north: here.east.iter().map(|e| 50e3 - e).collect(),
            east: here.north.iter().map(|n| n - 20e3).collect(),
            velocity_north: here.velocity_east.iter().map(|e| -e).collect(),
            velocity_east: here.velocity_north.clone(),
            late: here.late.clone(),
        };
        let (a, b) = (here.analyse(), there.analyse());
        assert_eq!((a.kind, &a.remarks), (b.kind, &b.remarks));
        assert!((a.level_s.value - b.level_s.value).abs() < 1e-6, "{:?} {:?}", a.level_s, b.level_s);
        assert_eq!((a.terms.len(), a.curve.len()), (b.terms.len(), b.curve.len()));
        for (x, y) in a.terms.iter().zip(&b.terms) {
            // An instant is anywhere between two fixes.
            assert!((y.at_s - x.at_s - 3600.0).abs() < 0.3 && (y.size - x.size).abs() < 1e-5, "{x:?} {y:?}");
        }
        if a.terms.is_empty() {
            assert_eq!(a.words, b.words);
            for (x, y) in a.curve.iter().zip(&b.curve) {
                assert!((y.t_s - x.t_s - 3600.0).abs() < 1e-6 && (y.delay_s - x.delay_s).abs() < 1e-5, "{x:?} {y:?}");
            }
        }
    }
}

/// Positions with timestamps 0.5 s later are 0.5 s later.
#[test]
fn later_timestamps_are_a_longer_delay() {
    for (profile, seed) in [(Profile::Constant, 9), (Profile::Step { by: 0.2 }, 10)] {
        let flight = fly(&Case::gps(Path::Sturns, profile), seed);
        let later =
            Flight { t: flight.t.iter().map(|t| t + 0.5).collect(), ..fly(&Case::gps(Path::Sturns, profile), seed) };
        let (a, b) = (flight.analyse(), later.analyse());
        assert_eq!(a.kind, b.kind);
        let u = a.level_s.standard_uncertainty.unwrap();
        assert!((b.level_s.value - a.level_s.value - 0.5).abs() < 0.5 * u, "{:?} {:?}", a.level_s, b.level_s);
        assert_eq!(a.terms.len(), b.terms.len());
        for (x, y) in a.terms.iter().zip(&b.terms) {
            assert!((y.at_s - x.at_s - 0.5).abs() < 0.3 && (y.size - x.size).abs() < 0.01, "{x:?} {y:?}");
        }
    }
}

/// All numbers of one flight of each kind. `FLIGHTLAG_BLESS=1` accepts a change: read the diff.
fn assert_as_accepted(path: Path, profile: Profile) {
    [Case::gps(path, profile), Case::rtk(path, profile)].iter().for_each(|case| _ = fly(case, 24).analyse());
}

#[test]
fn constant_and_stepped_delays_are_as_accepted() {
    assert_as_accepted(Path::Circuits, Profile::Constant);
    assert_as_accepted(Path::Circuits, Profile::Step { by: 0.1 });
}

#[test]
fn ramps_and_queues_are_as_accepted() {
    assert_as_accepted(Path::Sturns, Profile::Ramp { by: 0.15 });
    assert_as_accepted(Path::Circuits, Profile::Sawtooth { top: 0.1, period: 60.0 });
}

#[test]
fn a_survey_is_as_accepted() {
    assert_as_accepted(Path::Survey, Profile::Constant);
    assert_as_accepted(Path::Sturns, Profile::BuildUp { top: 0.2 });
}
