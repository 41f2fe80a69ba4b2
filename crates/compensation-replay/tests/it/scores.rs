//! Scores with and without a reference, error budget and on-board comparison, against closed forms.

use crate::flights::{channel, circle, late};
use crate::golden::replay;
use compensation_replay::Settings;
use flight::{Flight, Quantity};
use record::{CompensatorScore, Estimate, ReplayRecord, ReplayScores};
use simulate::{FlightSettings, LikeCase, PathKind, SensorSettings, simulate};

const TD: f64 = 0.4;

fn settings() -> Settings {
    Settings::with_delay(late(TD), "test")
}

fn played(flight: &Flight, settings: &Settings) -> ReplayRecord {
    replay(flight, settings).unwrap().record
}

fn scores(record: &ReplayRecord) -> &ReplayScores {
    record.scores.as_ref().unwrap()
}

fn of<'a>(record: &'a ReplayRecord, name: &str) -> &'a CompensatorScore {
    scores(record).compensators.iter().find(|c| c.name == name).unwrap()
}

/// Size of a term, m.
fn term(score: &CompensatorScore, begins: &str) -> f64 {
    let term = score.budget.terms.iter().find(|t| t.name.starts_with(begins)).unwrap();
    *term.size_m.found().unwrap_or_else(|| panic!("{term:?}"))
}

fn near(found: f64, expected: f64, by: f64) {
    assert!((found - expected).abs() <= by, "{found} instead of {expected} ± {by}");
}

fn holds(found: &Estimate, expected: f64, k: f64) {
    let u = found.standard_uncertainty.unwrap();
    assert!((found.value - expected).abs() <= k * u, "{found:?} does not hold {expected} within {k} u");
}

/// A circle of R = 30 m with speed `u`, position late by Td and biased velocity.
fn turning(u: f64, duration_s: f64, bias: [f64; 2]) -> Flight {
    let (radius, omega) = (30.0, u / 30.0);
    let at = |t: f64| [radius * (omega * t).sin(), -radius * (omega * t).cos(), 0.0];
    let rows = |hz: f64, f: &dyn Fn(f64) -> [f64; 3]| -> Vec<(f64, [f64; 3])> {
        (0..=(duration_s * hz) as usize).map(|k| k as f64 / hz).map(|t| (t, f(t))).collect()
    };
    let velocity = |t: f64| [u * (omega * t).cos() + bias[0], u * (omega * t).sin() + bias[1], 0.0];
    let mut flight = Flight::default();
    flight.channels.insert("position.gps".into(), channel(Quantity::PositionNed, &rows(100.0, &|t| at(t - TD))));
    flight.channels.insert("velocity.gps".into(), channel(Quantity::VelocityNed, &rows(100.0, &velocity)));
    flight.channels.insert("position.truth".into(), channel(Quantity::PositionNed, &rows(100.0, &at)));
    flight
}

#[test]
fn the_budget_of_a_circle_matches_its_closed_form() {
    for (u, raw, paper) in [(15.0, 5.990, 0.0199), (17.5, 6.984, 0.0315), (20.0, 7.976, 0.0469)] {
        let record = played(&turning(u, 300.0, [0.0; 2]), &settings());
        // Displacement along the arc at one velocity; raw is the chord: 5.990 is 2 R sin(ωTd/2).
        near(term(of(&record, "raw"), "delay, not removed"), u * TD, 1e-3);
        near(of(&record, "raw").reference.found().unwrap().rms_m.value, raw, 6e-4);
        near(term(of(&record, "pade-1-1"), "truncation"), paper, 2e-4);
        near(of(&record, "pade-1-1").reference.found().unwrap().rms_m.value, paper, 2e-4);
        // Truncation along the track: sin x − sin(2 atan(x/2)) over ω, about Td x²/12, which is 1.8 ms at 17.5 m/s.
        let omega = u / 30.0;
        let looks_like = ((omega * TD).sin() - (2.0 * (0.5 * omega * TD).atan()).sin()) / omega;
        near(of(&record, "pade-1-1").residual_delay.found().unwrap().expected_s.value, looks_like, 1e-5);
        let budget = &of(&record, "pade-1-1").budget;
        near(budget.known_m, budget.measured_m.unwrap().value, 5e-4);
    }
}

#[test]
fn a_biased_velocity_costs_td_times_the_bias() {
    for b in [0.05, 0.2] {
        let record = played(&turning(17.5, 300.0, [b, b]), &settings());
        let expected = TD * b * 2.0_f64.sqrt();
        near(term(of(&record, "exact-async"), "bias of the velocity"), expected, 0.02 * expected);
        near(of(&record, "exact-async").budget.measured_m.unwrap().value, expected, 0.02 * expected);
    }
}

#[test]
fn a_wrong_delay_leaves_its_error_as_residual_and_costs_u_times_it() {
    let flight = simulate(&receiver(4, 10.0, 0.02)).unwrap().to_flight().unwrap();
    for error in [-0.1, 0.02, 0.1] {
        let record = played(&flight, &Settings::with_delay(late(TD - error), "wrong"));
        let exact = of(&record, "exact-async");
        let residual = exact.residual_delay.found().unwrap();
        // The missing displacement was flown Td ago. Along the current track only the cosine of the turn since then
        // remains: cos(0.667 · 0.45) = 0.955 in turns at 20 m/s, less in roll-ins.
        let near_error = |e: &Estimate| {
            near(e.value, 0.95 * error, 0.05 * error.abs() + 4.0 * e.standard_uncertainty.unwrap());
        };
        near_error(&residual.delay_s);
        near_error(exact.reference.found().unwrap().residual_delay_s.found().unwrap());
        holds(&of(&record, "raw").residual_delay.found().unwrap().delay_s, TD, 4.0);
        // U = 17.6 m/s rms (15 to 20); the 2 ms uncertainty of the residual itself are 0.035 m.
        let speed = 17.5_f64.hypot(2.5 / 2.0_f64.sqrt());
        near(term(exact, "delay set wrongly"), speed * error.abs(), 0.05);
        near(exact.budget.total_m.unwrap(), exact.budget.measured_m.unwrap().value, 0.05);
        // Raw is late by the delay of the flight, whatever was set.
        let raw = &of(&record, "raw").budget;
        let measured = raw.measured_m.unwrap().value;
        near(raw.total_m.unwrap(), measured, 0.02 * measured);
    }
}

fn receiver(seed: u64, position_hz: f64, position_m: f64) -> FlightSettings {
    FlightSettings {
        position: SensorSettings { delay_s: TD, white_std: position_m, ..SensorSettings::clean(position_hz) },
        velocity: SensorSettings { white_std: 0.1, ..SensorSettings::clean(100.0) },
        ..LikeCase::F.settings(seed)
    }
}

#[test]
fn simulated_flights_have_no_residual_delay_and_a_lead_of_td() {
    let mut outside = 0;
    for seed in 0..4 {
        let flight = simulate(&receiver(seed, 5.0, 0.3)).unwrap().to_flight().unwrap();
        let record = played(&flight, &settings());
        for name in ["pade-1-1", "exact-async"] {
            let score = of(&record, name);
            let residual = score.residual_delay.found().unwrap();
            let [low, high] = residual.interval_95_s;
            let (expected, slack) =
                (residual.expected_s.value, 2.0 * residual.expected_s.standard_uncertainty.unwrap());
            outside += u32::from(!(low - slack <= expected && expected <= high + slack));
            let lead = score.lead_s.found().unwrap();
            near(lead.value, TD, if name == "exact-async" { 1e-3 } else { 4e-3 });
            let correlation = score.step_correlation.found().unwrap();
            if name == "exact-async" { holds(correlation, 0.0, 4.0) } else { near(correlation.value, 1.0, 0.02) }
        }
        let raw = of(&record, "raw");
        let residual = raw.residual_delay.found().unwrap();
        holds(&residual.delay_s, TD, 4.0);
        assert_eq!(residual.expected_s.value, TD);
    }
    // Eight intervals, of which pairs share their data: more than two misses of 5 % each have a probability below 1 %.
    assert!(outside <= 2, "{outside}");
}

/// There and back along one line: north = A sin ωt. At the same place both passes have the same speed U, and the chord
/// of each is A sin(ω Td) cos(ωt)/…: raw is apart by 2 A cos(ωt) sin(ω Td) = 2 U sin(ωTd)/ω.
#[test]
fn opposite_passes_of_a_late_position_are_two_u_td_apart() {
    let (a, omega) = (100.0, 0.2);
    let rows = |hz: f64, f: &dyn Fn(f64) -> [f64; 3]| -> Vec<(f64, [f64; 3])> {
        (0..=(200.0 * hz) as usize).map(|k| k as f64 / hz).map(|t| (t, f(t))).collect()
    };
    let place = |t: f64| [a * (omega * t).sin(), 5.0 * (0.5 * omega * t).sin(), 0.0];
    let velocity = |t: f64| [a * omega * (omega * t).cos(), 2.5 * omega * (0.5 * omega * t).cos(), 0.0];
    let mut flight = Flight::default();
    flight.channels.insert("position.gps".into(), channel(Quantity::PositionNed, &rows(10.0, &|t| place(t - TD))));
    flight.channels.insert("velocity.gps".into(), channel(Quantity::VelocityNed, &rows(50.0, &velocity)));
    let record = played(&flight, &settings());
    let passes = scores(&record).opposite_passes.found().unwrap();
    assert!(passes.pairs >= 6, "{passes:?}");
    let raw = of(&record, "raw").hysteresis.found().unwrap();
    near(raw.expected_along_m, passes.closing_speed_mps * TD, 1e-12);
    // sin(ωTd)/(ωTd) = 0.99893.
    near(raw.along_m.value / raw.expected_along_m, 0.99893, 2e-3);
    near(raw.across_m.value, 0.0, 0.05);
    for name in ["pade-1-1", "exact-async"] {
        let left = of(&record, name).hysteresis.found().unwrap();
        near(left.along_m.value, 0.0, 0.01);
        assert_eq!(left.expected_along_m, 0.0);
    }
    let circle = played(&circle(TD, 60.0, 10.0, 100.0), &settings());
    assert!(scores(&circle).opposite_passes.found().is_none(), "a circle has no opposite passes");
}

#[test]
fn straight_legs_are_not_harmed() {
    for (position_hz, position_m) in [(10.0, 0.1), (5.0, 0.3)] {
        let path = PathKind::Straight { speed_mps: 17.5, heading_rad: 0.7 };
        let flown = simulate(&FlightSettings { path, ..receiver(1, position_hz, position_m) }).unwrap();
        let record = played(&flown.to_flight().unwrap(), &settings());
        let legs = scores(&record).straight_legs.found().unwrap();
        assert!(legs.duration_s > 170.0, "{legs:?}");
        for name in ["pade-1-1", "exact-async"] {
            let score = of(&record, name).straight.found().unwrap();
            // Noise of velocity over Td: √(Td·dt)·σ = 6.3 mm; that of Simpson's three velocities: √½·Td·σ = 28 mm.
            holds(&score.along_excess_m, 0.0, 4.0);
            near(score.across_rms_m.value, 0.5_f64.sqrt() * TD * 0.1, 0.004);
            near(score.noise_ratio.value, 1.0, 0.01);
        }
        // A flight that cannot show a delay reports so.
        let why = format!("{:?}", of(&record, "exact-async").residual_delay);
        assert!(why.contains("straight"), "{why}");
    }
    let circle = played(&circle(TD, 60.0, 10.0, 100.0), &settings());
    assert!(scores(&circle).straight_legs.found().is_none(), "a circle has no straight leg");
}

/// Circuits with straights between turns and a deliberately wrong compensator: a sign error of the delay does no harm
/// across, but it does along.
#[test]
fn on_straights_the_output_moves_only_along_the_track() {
    let flight = simulate(&receiver(3, 10.0, 0.05)).unwrap().to_flight().unwrap();
    let record = played(&flight, &settings());
    let legs = scores(&record).straight_legs.found().unwrap();
    assert!(legs.legs >= 3, "{legs:?}");
    let exact = of(&record, "exact-async").straight.found().unwrap();
    assert!(exact.across_rms_m.value < 0.05 && exact.along_excess_m.value.abs() < 0.02, "{exact:?}");
    near(exact.noise_ratio.value, 1.0, 0.1);
}

/// The similar cases of table 5.7: the budget predicts the measured error to within a third, in every case with noise.
#[test]
fn the_budget_predicts_the_error_of_similar_cases() {
    for (case, tolerance) in [(LikeCase::B, 0.1), (LikeCase::C, 0.1), (LikeCase::D, 0.15), (LikeCase::F, 0.1)] {
        let flight = simulate(&case.settings(2)).unwrap().to_flight().unwrap();
        let record = played(&flight, &settings());
        for name in ["raw", "pade-1-1", "exact-async"] {
            let budget = &of(&record, name).budget;
            let measured = budget.measured_m.unwrap().value;
            println!("{case:?} {name}: {:.4} {measured:.4}", budget.known_m);
            for t in &budget.terms {
                println!("    {} {:?}", t.name, t.size_m);
            }
            near(budget.known_m / measured, 1.0, tolerance);
        }
    }
}

/// Both sensors wander, as in the demo's worn flight: ambiguous terms are named, and separable ones are not too large.
#[test]
fn an_ambiguous_wander_is_not_attributed_to_the_position() {
    let wander = |std| Some(simulate::Wander { std, time_constant_s: 30.0 });
    let mut worn = receiver(12, 5.0, 0.3);
    (worn.position.wander, worn.velocity.wander) = (wander(0.5), wander(0.03));
    let record = played(&simulate(&worn).unwrap().to_flight().unwrap(), &settings());
    let budget = &of(&record, "exact-async").budget;
    assert_eq!(budget.total_m, None, "whose the wander is, is not known: {budget:?}");
    assert!(budget.known_m < 1.1 * budget.measured_m.unwrap().value, "{budget:?}");
}

#[test]
fn unknown_terms_are_named() {
    let mut flight = simulate(&FlightSettings {
        path: PathKind::Straight { speed_mps: 17.5, heading_rad: 0.7 },
        ..receiver(1, 5.0, 0.3)
    })
    .unwrap()
    .to_flight()
    .unwrap();
    flight.channels.remove("position.truth");
    let record = played(&flight, &settings());
    let terms = &of(&record, "exact-async").budget.terms;
    let unknown: Vec<&str> = terms.iter().filter(|t| t.size_m.found().is_none()).map(|t| t.name.as_str()).collect();
    let expected = [
        "delay set wrongly, speed × δTd",
        "delay of the velocity itself, a·Td·Tv",
        "bias of the velocity, Td·b",
        "white noise of the position",
        "wander of the position",
    ];
    assert_eq!(unknown, expected);
    let budget = &of(&record, "exact-async").budget;
    let known: f64 = terms.iter().filter_map(|t| t.size_m.found()).map(|m| m * m).sum();
    assert_eq!((budget.total_m, budget.known_m), (None, known.sqrt()), "five of the terms are missing in the sum");
    assert!(of(&record, "exact-async").reference.found().is_none());
}

/// A velocity late by 50 ms and a position late by 450: the difference is removed, the common part remains.
#[test]
fn a_late_velocity_is_found_with_a_reference_and_narrows_the_band() {
    let mut settings_of_flight = receiver(5, 10.0, 0.05);
    settings_of_flight.position.delay_s = TD + 0.05;
    settings_of_flight.velocity.delay_s = 0.05;
    let record = played(&simulate(&settings_of_flight).unwrap().to_flight().unwrap(), &settings());
    holds(scores(&record).velocity_delay_s.found().unwrap(), 0.05, 4.0);
    let exact = of(&record, "exact-async");
    near(exact.residual_delay.found().unwrap().delay_s.value, 0.0, 4e-3);
    near(term(exact, "delay set wrongly"), 17.5 * 0.05, 0.05);
    // 50 of 450 ms remain: more than a tenth, less than a half.
    let band = exact.band.found().unwrap();
    assert!(band.helps_below_hz.is_none() && band.halves_below_hz.is_some(), "{band:?}");
    let on_time = played(&simulate(&receiver(5, 10.0, 0.05)).unwrap().to_flight().unwrap(), &settings());
    let share = of(&on_time, "pade-1-1").band.found().unwrap().motion_share.unwrap();
    assert!(share[0] > 0.95 && (share.iter().sum::<f64>() - 1.0).abs() < 1e-12, "{share:?}");
}

/// The same without the truth, removing the position's own lateness. The flight's pair shows 400 ms; compared with
/// that, the 50 ms would count as a wrongly set delay.
#[test]
fn band_and_budget_use_both_latenesses_if_known() {
    let mut settings_of_flight = receiver(5, 10.0, 0.05);
    settings_of_flight.position.delay_s = TD + 0.05;
    settings_of_flight.velocity.delay_s = 0.05;
    let mut flight = simulate(&settings_of_flight).unwrap().to_flight().unwrap();
    flight.channels.remove("position.truth");
    let of_ms = |ms: f64| Some(Estimate { value: ms / 1e3, standard_uncertainty: Some(0.004) });
    let known = Settings {
        position_lateness_s: of_ms(450.0),
        velocity_lateness_s: of_ms(50.0),
        position_minus_velocity_s: of_ms(400.0),
        ..Settings::with_delay(late(TD + 0.05), "the delay network")
    };
    let record = played(&flight, &known);
    let exact = of(&record, "exact-async");
    let band = exact.band.found().unwrap();
    near(band.delays_s[0], 0.45, 1e-9);
    near(band.delays_s[1], 0.05, 1e-9);
    assert!(band.helps_below_hz.is_some_and(|hz| hz > 0.1), "{band:?}");
    near(term(exact, "delay set wrongly"), 17.5 * 0.004, 0.01);
    // Circles of 30 m at 17.5 m/s: 10 m/s² at most.
    let of_velocity = term(exact, "delay of the velocity itself");
    assert!((0.02..=10.5).contains(&(of_velocity / (0.45 * 0.05))), "{of_velocity}");
    let residual = exact.residual_delay.found().unwrap();
    near(residual.expected_s.value, -0.05, 1e-9);
    near(residual.delay_s.value, -0.05, 6e-3);
}

#[test]
fn errors_are_split_by_axis_direction_speed_and_frequency() {
    let record = played(&simulate(&receiver(2, 10.0, 0.05)).unwrap().to_flight().unwrap(), &settings());
    for name in ["raw", "exact-async"] {
        let score = of(&record, name).reference.found().unwrap();
        let square = |pair: [[Estimate; 2]; 2]| pair.iter().map(|[_, rms]| rms.value * rms.value).sum::<f64>().sqrt();
        near(square([score.north_m, score.east_m]), score.rms_m.value, 1e-9);
        near(square([score.along_m, score.across_m]), score.rms_m.value, 1e-9);
        assert!(score.percentiles_m.is_sorted() && score.percentiles_m[3] <= score.max_m);
        assert_eq!((score.by_speed.len(), scores(&record).speeds_mps.len()), (3, 3));
        // Bands hold the part about the mean, averaged over 0.1 s: nearly all of raw's error.
        let bands = score.bands_rms_m.found().unwrap();
        assert_eq!(bands.len(), scores(&record).bands_hz.len());
        if name == "raw" {
            // A late position is further back on the track.
            assert!(score.along_m[0].value < -0.8 * score.rms_m.value, "{score:?}");
            let slowest = score.by_speed[0].unwrap().value;
            assert!(score.by_speed[2].unwrap().value > 1.1 * slowest, "{:?}", score.by_speed);
            let all = bands.iter().map(|b| b * b).sum::<f64>().sqrt();
            let mean2 = score.north_m[0].value.powi(2) + score.east_m[0].value.powi(2);
            near(all, (score.rms_m.value.powi(2) - mean2).sqrt(), 0.1 * score.rms_m.value);
        }
    }
}

#[test]
fn the_replay_reproduces_the_onboard_result() {
    let settings_of_flight = FlightSettings { onboard_delay_s: Some(TD), ..receiver(1, 10.0, 0.02) };
    let flight = simulate(&settings_of_flight).unwrap().to_flight().unwrap();
    let onboard = played(&flight, &settings()).onboard.unwrap();
    let found = onboard.found().unwrap();
    assert_eq!(found.reproduced_by.found().map(String::as_str), Some("pade-1-1"), "{found:?}");
    assert!(found.same_stamps && found.compared > 17_000 && found.tolerance_m < 0.03, "{found:?}");
    let against = |name: &str| found.against.iter().find(|a| a.name == name).unwrap();
    // Steps of 1e-7 deg: 11.1 mm north, 8.8 mm east, each uniform.
    near(against("pade-1-1").rms_m, (11.1_f64.hypot(8.8) / 12.0_f64.sqrt()) * 1e-3, 4e-4);
    holds(against("pade-1-1").delay_s.found().unwrap(), 0.0, 4.0);
    // Raw is late against it by Td plus the mean age of a fix, 45 ms at 10 and 100 Hz; the lead of [1/1] is nearly Td.
    near(against("raw").delay_s.found().unwrap().value, -(TD), 0.005);
}

#[test]
fn an_onboard_channel_of_another_kind_is_rejected_with_the_reason() {
    let settings_of_flight = FlightSettings { onboard_delay_s: Some(TD), ..receiver(1, 10.0, 0.02) };
    let flight = simulate(&settings_of_flight).unwrap().to_flight().unwrap();
    let velocity = flight.channels.iter().find(|(_, channel)| channel.quantity == Quantity::VelocityNed).unwrap().0;
    let found = replay(&flight, &Settings { onboard: vec![velocity.clone()], ..settings() }).unwrap();
    let notices: Vec<_> = found.notices.iter().filter(|n| n.code == "onboard-not-compared").collect();
    assert!(notices.len() == 1 && notices[0].place == *velocity, "{notices:?}");
    assert_eq!(notices[0].text, format!("{velocity} holds VelocityNed, which is not a position"));
    assert!(found.record.onboard.unwrap().found().is_none());
}

#[test]
fn another_onboard_delay_is_not_reproduced_and_reported() {
    let settings_of_flight = FlightSettings { onboard_delay_s: Some(0.35), ..receiver(1, 10.0, 0.02) };
    let flight = simulate(&settings_of_flight).unwrap().to_flight().unwrap();
    let onboard = played(&flight, &settings()).onboard.unwrap();
    let found = onboard.found().unwrap();
    assert!(format!("{:?}", found.reproduced_by).contains("pade-1-1, differs by 0.8"), "{:?}", found.reproduced_by);
    let paper = found.against.iter().find(|a| a.name == "pade-1-1").unwrap();
    near(paper.delay_s.found().unwrap().value, 0.05, 0.002);
}
