//! Starts, gaps, resets, rejections.

use crate::flights::{along_a_parallel, channel, circle, late};
use crate::golden::replay;
use compensation_replay::{Refusal, ReplayedTrack, RowState, Settings, Track, TrackColumn, TrackRows};
use flight::{Channel, Flight, Quantity, Severity};
use rand::SeedableRng;
use rand_distr::{Distribution, Normal};
use record::StartRule;

fn settings() -> Settings {
    Settings::with_delay(late(0.4), "truth")
}

fn rows_of(channel: &Channel) -> Vec<(f64, [f64; 3])> {
    let timeline = channel.series.timeline();
    let t = timeline.seconds_since(flight::Stamp(1_700_000_000_000_000_000));
    t.into_iter().enumerate().map(|(row, t)| (t, [0, 1, 2].map(|k| channel.series.component(k)[row]))).collect()
}

fn edit(flight: &mut Flight, name: &str, change: impl Fn(&mut Vec<(f64, [f64; 3])>)) {
    let old = &flight.channels[name];
    let quantity = old.quantity;
    let mut rows = rows_of(old);
    change(&mut rows);
    flight.channels.insert(name.into(), channel(quantity, &rows));
}

fn numbers(track: &ReplayedTrack, name: &str) -> Vec<Option<f64>> {
    match track.whole().column(name) {
        Some(TrackColumn::F64(values)) => values.clone(),
        other => panic!("{name}: {other:?}"),
    }
}

fn error(replay: &compensation_replay::Replay, name: &str) -> f64 {
    replay.record.compensators.iter().find(|c| c.name == name).unwrap().error_rms_m.unwrap().value
}

#[test]
fn compensation_with_the_wrong_sign_would_double_the_error() {
    // On the circle the raw error is 2 R sin(ω Td / 2), and the compensated one nearly zero.
    let found = replay(&circle(0.4, 60.0, 100.0, 100.0), &settings()).unwrap();
    let raw = 60.0 * (17.5 / 30.0 * 0.4_f64 / 2.0).sin();
    assert!((error(&found, "raw") - raw).abs() < 1e-3);
    assert!(error(&found, "exact-async") < 1e-4 && error(&found, "pade-1-1") < 0.033);
}

#[test]
fn two_hundred_kilometres_along_a_parallel_stay_correct() {
    let found = replay(&along_a_parallel(0.4, 1000.0), &settings()).unwrap();
    // 80 m on the parallel; the tangent plane of the origin is tilted by up to 1.8° there.
    assert!((error(&found, "raw") - 80.0).abs() < 80.0 * 5e-4);
    // The velocity is rotated at the late fix: 80 m · tan 60° / R · 80 m = 1.7 mm.
    assert!(error(&found, "exact-async") < 2e-3, "{}", error(&found, "exact-async"));
    let north = numbers(&found.track, "raw_north_m");
    assert!(north.last().unwrap().unwrap() > 2_500.0, "the meridians converge: {:?}", north.last());
}

#[test]
fn the_compensated_latitude_and_longitude_are_correct() {
    let found = replay(&along_a_parallel(0.4, 500.0), &settings()).unwrap();
    let latitude = numbers(&found.track, "exact_async_latitude_deg");
    // As above, 1.7 mm = 1.6e-8 deg.
    assert!(latitude.iter().flatten().all(|l| (l - 60.0).abs() < 2e-8));
}

#[test]
fn a_cold_start_lacks_the_textbook_displacement() {
    let mut flight = circle(0.4, 60.0, 100.0, 100.0);
    let straight = |t: f64, late: f64| [20.0 * (t - late), 0.0, 0.0];
    edit(&mut flight, "position.gps", |rows| rows.iter_mut().for_each(|(t, p)| *p = straight(*t, 0.4)));
    edit(&mut flight, "velocity.gps", |rows| rows.iter_mut().for_each(|(_, v)| *v = [20.0, 0.0, 0.0]));
    edit(&mut flight, "position.truth", |rows| rows.iter_mut().for_each(|(t, p)| *p = straight(*t, 0.0)));
    let cold = replay(&flight, &Settings { start: StartRule::Cold, ..settings() }).unwrap();
    let north = numbers(&cold.track, "pade_1_1_north_m");
    // Design note 5.8: −Td v0 e^{−2t/Td}, sampled: Tustin at 100 Hz errs by the step of the first sample.
    for (row, t) in [(20, 0.2), (40, 0.4), (80, 0.8)] {
        let lack = 20.0 * t - north[row].unwrap();
        assert!((lack - 8.0 * (-2.0 * t / 0.4_f64).exp()).abs() < 0.25, "t = {t}: {lack}");
    }
    let warm = replay(&flight, &settings()).unwrap();
    assert!(
        numbers(&warm.track, "pade_1_1_north_m")
            .iter()
            .enumerate()
            .all(|(k, n)| (n.unwrap() - 0.2 * k as f64).abs() < 1e-9)
    );
    let wait = replay(&flight, &Settings { start: StartRule::InvalidUntilTd, ..settings() }).unwrap();
    let north = numbers(&wait.track, "exact_async_north_m");
    assert_eq!(north.iter().position(Option::is_some), Some(40));
}

#[test]
fn a_long_velocity_gap_restarts_and_a_short_one_is_bridged() {
    let mut flight = circle(0.4, 60.0, 100.0, 100.0);
    edit(&mut flight, "velocity.gps", |rows| {
        rows.retain(|(t, _)| !(20.0..23.0).contains(t) && !(40.0..40.5).contains(t))
    });
    let found = replay(&flight, &settings()).unwrap();
    let coverage = &found.record.coverage;
    assert_eq!((coverage.restarts, coverage.bridged_gaps), (1, 1));
    let counted: u64 = coverage.invalid.iter().map(|r| r.count).sum();
    assert_eq!(coverage.valid_rows + counted, coverage.rows);
    // From 60 s, minus 3 s of gap, minus twice 0.4 s of warm-up, minus the bridged 0.5 s without rows.
    assert!((coverage.valid_s - 55.7).abs() < 0.03, "{}", coverage.valid_s);
    // After the gap 0.4 s of warm-up at 100 Hz, as at the start.
    assert_eq!(coverage.invalid[0].count, 80);
    // The bridge cuts the corner of half a second of turn: a chord of ω h = 0.29 rad, error < v ω² h³ / 12 = 0.06 m.
    assert!(error(&found, "exact-async") < 0.03, "{}", error(&found, "exact-async"));
}

#[test]
fn between_lost_fixes_the_exact_form_dead_reckons() {
    let mut flight = circle(0.4, 60.0, 10.0, 100.0);
    edit(&mut flight, "position.gps", |rows| rows.retain(|(t, _)| !(20.0..30.0).contains(t)));
    let found = replay(&flight, &settings()).unwrap();
    assert!((found.record.coverage.longest_position_gap_s - 10.1).abs() < 1e-6);
    assert!(error(&found, "exact-async") < 1e-3);
    assert!(error(&found, "raw") > 10.0);
}

#[test]
fn held_rows_are_not_fixes() {
    let clean = circle(0.4, 60.0, 5.0, 100.0);
    let mut held = clean.clone();
    // The same fixes, each repeated four times in between and marked as held.
    let fixes = rows_of(&clean.channels["position.gps"]);
    let rows: Vec<(f64, [f64; 3])> =
        fixes.iter().flat_map(|(t, p)| (0..5).map(|k| (t + 0.04 * f64::from(k), *p)).collect::<Vec<_>>()).collect();
    let mut repeated = channel(Quantity::PositionNed, &rows);
    repeated.held = (0..rows.len()).map(|row| row % 5 != 0).collect();
    held.channels.insert("position.gps".into(), repeated);
    let (a, b) = (replay(&clean, &settings()).unwrap(), replay(&held, &settings()).unwrap());
    assert_eq!(a, b);
}

#[test]
fn one_reset_of_the_position_is_marked_and_passed_on() {
    let mut flight = circle(0.4, 60.0, 10.0, 100.0);
    edit(&mut flight, "position.gps", |rows| rows.iter_mut().filter(|(t, _)| *t > 33.0).for_each(|(_, p)| p[0] += 7.0));
    let found = replay(&flight, &settings()).unwrap();
    assert_eq!(found.record.coverage.position_resets, 1);
    let notice = found.notices.iter().find(|n| n.code == "position-reset").unwrap();
    assert!(notice.text.contains("7.00 m") && notice.place == "t = 33.100 s", "{notice:?}");
}

#[test]
fn swapped_axes_are_reported() {
    let mut flight = circle(0.4, 60.0, 10.0, 100.0);
    assert!(replay(&flight, &settings()).unwrap().notices.iter().all(|n| n.severity == Severity::Info));
    edit(&mut flight, "velocity.gps", |rows| rows.iter_mut().for_each(|(_, v)| v.swap(0, 1)));
    let found = replay(&flight, &settings()).unwrap();
    assert!(found.notices.iter().any(|n| n.code == "velocity-contradicts-position"));
}

#[test]
fn the_difference_matches_the_velocity_prediction() {
    let found = replay(&circle(0.4, 60.0, 10.0, 100.0), &settings()).unwrap().record;
    // v · (Td + age) compared with the chord flown: 1 − sinc(ω Td/2) is below 0.5 % here.
    let predicted = found.predicted_rms_m.value;
    let exact = found.compensators.last().unwrap().raw_minus_this_rms_m.value;
    assert!((exact / predicted - 1.0).abs() < 0.006, "{exact} {predicted}");
}

#[test]
fn the_delay_uncertainty_propagates_to_the_correction() {
    let flight = circle(0.4, 60.0, 100.0, 100.0);
    let found = replay(&flight, &Settings { delay_uncertainty_s: Some(0.01), ..settings() }).unwrap().record;
    let u = found.compensators[1].raw_minus_this_rms_m.standard_uncertainty.unwrap();
    assert!((u - 0.175).abs() < 0.002, "U δTd = 17.5 m/s · 10 ms = 0.175 m, not {u}");
}

#[test]
fn every_spike_of_the_raw_position_is_in_its_curve() {
    let mut flight = circle(0.4, 600.0, 100.0, 100.0);
    edit(&mut flight, "position.gps", |rows| rows[31_415].1[1] = 55.0);
    let found = replay(&flight, &settings()).unwrap().record;
    let east = &found.axes[1].position_m[0];
    let top = east.y.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    assert!(top > 54.0 && east.y.len() < 2_000 && east.stands_for == found.coverage.rows);
    assert!(found.zoom.is_some());
}

#[test]
fn a_stationary_flight_is_rejected_with_the_reason() {
    let mut flight = circle(0.4, 60.0, 10.0, 100.0);
    edit(&mut flight, "velocity.gps", |rows| rows.iter_mut().for_each(|(_, v)| *v = [0.1, 0.0, 0.0]));
    let refusal = replay(&flight, &settings()).unwrap_err();
    assert!(matches!(refusal, Refusal::NoMotion { .. }) && refusal.to_string().contains("0.10 m/s"), "{refusal}");
}

#[test]
fn missing_channels_are_named() {
    let mut flight = circle(0.4, 60.0, 10.0, 100.0);
    flight.channels.remove("velocity.gps");
    let text = replay(&flight, &settings()).unwrap_err().to_string();
    assert!(text.contains("velocity.ekf") && text.contains("position.gps"), "{text}");
    let early = replay(&circle(0.4, 9.0, 10.0, 10.0), &Settings::with_delay(late(-0.1), "")).unwrap_err();
    assert_eq!(early, Refusal::DelayNotPositive(-0.1));
}

#[test]
fn channels_without_overlap_are_rejected() {
    let mut flight = circle(0.4, 60.0, 10.0, 100.0);
    edit(&mut flight, "velocity.gps", |rows| rows.iter_mut().for_each(|(t, _)| *t += 1e6));
    assert!(matches!(replay(&flight, &settings()), Err(Refusal::NoOverlap { .. })));
}

#[test]
fn a_flight_without_a_valid_row_is_rejected_and_not_scored_as_zero() {
    let refusal = replay(&circle(0.4, 0.3, 20.0, 100.0), &settings()).unwrap_err();
    assert!(matches!(refusal, Refusal::NothingValid { .. }), "{refusal}");
}

#[test]
fn states_are_written_by_name() {
    let found = replay(&circle(0.4, 10.0, 100.0, 100.0), &settings()).unwrap();
    let Some(TrackColumn::Text(states)) = found.track.whole().column("state").cloned() else { panic!() };
    assert_eq!((states[0], states[500]), (RowState::WarmUp.name(), RowState::Valid.name()));
}

#[test]
fn a_logger_that_writes_whole_seconds_cannot_show_a_shorter_delay() {
    let coarse = |flight: &Flight| {
        replay(flight, &settings()).unwrap().notices.iter().any(|n| n.code == "stamps-coarser-than-delay")
    };
    let mut flight = circle(0.4, 60.0, 1.0, 10.0);
    assert!(!coarse(&flight), "a receiver that measures on the second is fine");
    for name in ["position.gps", "velocity.gps"] {
        let old = flight.channels.get_mut(name).unwrap();
        let stamps = old.series.timeline().stamps().to_vec();
        let logged = flight::Timeline::new(flight::StampKind::Logged, flight::Clock::Unix, stamps).unwrap();
        old.series = flight::Series::new(logged, old.series.components().to_vec()).unwrap();
    }
    assert!(coarse(&flight));
}

#[test]
fn rows_on_a_regular_clock_are_not_rounded_and_digits_are_limited() {
    let notice = |irregular: bool| {
        let mut flight = circle(0.3, 60.0, 10.0, 10.0);
        for name in ["position.gps", "velocity.gps"] {
            let old = flight.channels.get_mut(name).unwrap();
            // Every third row comes a step later.
            let shift = |i: usize| if irregular && i % 3 == 2 { 100_000_000 } else { 0 };
            let stamps = (0..old.series.timeline().stamps().len())
                .map(|i| flight::Stamp(i as i64 * 200_000_000 + shift(i)))
                .collect();
            let logged = flight::Timeline::new(flight::StampKind::Logged, flight::Clock::Unix, stamps).unwrap();
            old.series = flight::Series::new(logged, old.series.components().to_vec()).unwrap();
        }
        let settings = Settings::with_delay(late(0.1 + 0.2 - 0.25), "");
        let found = replay(&flight, &settings).unwrap();
        found.notices.iter().find(|n| n.code == "stamps-coarser-than-delay").unwrap().text.clone()
    };
    let (regular, rounded) = (notice(false), notice(true));
    assert!(regular.contains("a regular clock") && !regular.contains("rounded"), "{regular}");
    assert!(rounded.contains("rounded to whole steps"), "{rounded}");
    assert!(regular.contains("A step of 0.1 s is no shorter than the delay of 0.050 s"), "{regular}");
}

fn with_further(names: &[&str]) -> Settings {
    Settings { compensators: names.iter().map(|n| n.parse().unwrap()).collect(), ..settings() }
}

/// The circle with ten seconds without velocity: two segments.
fn interrupted_circle() -> Flight {
    let mut flight = circle(0.4, 60.0, 100.0, 100.0);
    edit(&mut flight, "velocity.gps", |rows| rows.retain(|(t, _)| !(20.0..30.0).contains(t)));
    flight
}

#[test]
fn further_compensators_restart_in_every_segment_with_every_start_rule() {
    // With a fix at every velocity the FIR form equals the asynchronous one.
    for start in [StartRule::Warm, StartRule::InvalidUntilTd, StartRule::Cold] {
        let settings = Settings { start, ..with_further(&["exact-fir", "pade-2-2-foh"]) };
        let found = replay(&interrupted_circle(), &settings).unwrap();
        assert_eq!(found.record.coverage.restarts, 1);
        for axis in ["north", "east"] {
            let column = |name: &str| numbers(&found.track, &format!("{name}_{axis}_m"));
            for (row, (fir, exact)) in column("exact_fir").iter().zip(column("exact_async")).enumerate() {
                let apart = fir.zip(exact).map_or(0.0, |(fir, exact)| (fir - exact).abs());
                assert_eq!(fir.is_some(), exact.is_some(), "{start:?}: row {row}");
                assert!(apart <= 1e-9, "{start:?}: row {row} is {apart} m apart");
            }
        }
        assert!(start == StartRule::Cold || error(&found, "pade-2-2-foh") < 0.1 * error(&found, "pade-1-1"));
    }
}

#[test]
fn default_compensators_run_once_with_the_same_bits_next_to_others() {
    let flight = interrupted_circle();
    let alone = replay(&flight, &settings()).unwrap();
    let names = ["pade-1-1-tustin", "pade-3-3-foh", "exact-async", "pade-2-2-foh", "exact-fir", "pade-3-3-foh"];
    let more = replay(&flight, &with_further(&names)).unwrap();
    let compensators = &more.record.compensators;
    let before = alone.record.compensators.len();
    assert_eq!(compensators[..before], alone.record.compensators);
    let further: Vec<&str> = compensators[before..].iter().map(|c| c.name.as_str()).collect();
    assert_eq!(further, ["pade-3-3-foh", "pade-2-2-foh", "exact-fir"]);
    let with_more = more.track.whole();
    for (name, column) in &alone.track.whole().columns {
        assert_eq!(with_more.column(name), Some(column), "{name}");
    }
    // In the figures, only the first two of the further ones.
    let (drawn, usual) = (&more.record.axes[0], &alone.record.axes[0]);
    assert_eq!(drawn.position_m.len(), usual.position_m.len() + 2);
    assert_eq!(more.notices, alone.notices);
}

#[test]
fn noncausal_compensators_are_marked_and_stop_where_the_fixes_end() {
    let found = replay(&circle(0.4, 20.0, 10.0, 20.0), &with_further(&["offline-shift", "rts-smoother"])).unwrap();
    let further = &found.record.compensators[4..];
    assert_eq!(further.iter().map(|c| c.name.as_str()).collect::<Vec<_>>(), ["offline-shift", "rts-smoother"]);
    for c in further {
        assert!(c.title.ends_with("(not causal: bound)"), "{}", c.title);
        assert_eq!(c.step_at_fix_rms_m, None);
        assert!(c.error_rms_m.unwrap().value < 1e-3, "{c:?}");
    }
    // The last 0.4 s of the rows have no fix 0.4 s later.
    let east = numbers(&found.track, "offline_shift_east_m");
    let silent = east.iter().rev().take_while(|x| x.is_none()).count();
    assert!((7..=9).contains(&silent), "{silent}");
    let notice = found.notices.iter().find(|n| n.code == "no-output").unwrap();
    assert_eq!((notice.count, notice.severity), (silent as u64, Severity::Info));
    assert!(notice.text.contains("offline-shift"), "{notice:?}");
    assert!(found.notices.iter().any(|n| n.code == "kalman-noise-fitted"));
}

#[test]
fn a_fitted_kalman_filter_beats_forms_that_pass_noise_on() {
    let mut flight = circle(0.4, 40.0, 10.0, 20.0);
    let mut generator = rand_pcg::Pcg64::seed_from_u64(7);
    let noise = Normal::new(0.0, 0.5).unwrap();
    let draws: Vec<[f64; 2]> = (0..=400).map(|_| [0, 1].map(|_| noise.sample(&mut generator))).collect();
    edit(&mut flight, "position.gps", |rows| {
        for ((_, ned), draw) in rows.iter_mut().zip(&draws) {
            ned[0] += draw[0];
            ned[1] += draw[1];
        }
    });
    let found = replay(&flight, &with_further(&["kalman", "rts-smoother"])).unwrap();
    let [exact, kalman, bound] = ["exact-async", "kalman", "rts-smoother"].map(|name| error(&found, name));
    // The exact form passes the noise of 400 fixes on with gain 1: 0.5 √2 m, with an uncertainty of 2.5 %.
    assert!((exact / (0.5 * 2f64.sqrt()) - 1.0).abs() < 0.12, "{exact}");
    assert!(kalman < 0.5 * exact && bound < kalman, "Kalman {kalman}, bound {bound}, exact {exact}");
}

#[test]
fn the_track_latitude_is_the_exact_forms_whatever_else_runs() {
    let flight = along_a_parallel(0.4, 60.0);
    let more = replay(&flight, &with_further(&["pade-0-1-zoh", "offline-shift"])).unwrap();
    let alone = replay(&flight, &settings()).unwrap();
    for name in ["exact_async_latitude_deg", "exact_async_longitude_deg"] {
        assert_eq!(numbers(&more.track, name), numbers(&alone.track, name));
    }
    // Where the offline shift has no output its column is empty, but that of the exact form is not.
    assert_eq!(numbers(&more.track, "offline_shift_east_m").last(), Some(&None));
    assert!(numbers(&more.track, "exact_async_longitude_deg").last().unwrap().is_some());
}

/// In a long record neighbouring velocities are averaged and the newest fixes kept: removed and residual errors stay.
#[test]
fn a_very_long_record_is_averaged_and_its_errors_stay() {
    let flight = circle(0.4, 60.0, 100.0, 100.0);
    let all = replay(&flight, &settings()).unwrap();
    let averaged = replay(&flight, &Settings { most_samples: 2001, ..settings() }).unwrap();
    let texts: Vec<&str> =
        averaged.notices.iter().filter(|n| n.code == "samples-left-out").map(|n| n.text.as_str()).collect();
    let [velocity, fixes, reference] = texts[..] else { panic!("{texts:?}") };
    assert_eq!(velocity, "velocity.gps: 3 neighbouring samples are averaged for the replay, 6001 to 2000");
    assert_eq!(fixes, "position.gps: 2002 of 6001 fixes are replayed, the newest at each velocity sample");
    assert!(reference.starts_with("position.truth: 3 neighbouring samples"), "{reference}");
    assert!(all.notices.iter().all(|n| n.code != "samples-left-out"));
    assert_eq!((averaged.record.coverage.rows, averaged.record.coverage.fixes), (2001, 2002));
    // Of three samples the middle one is at their mean, and the age of its fix is unchanged.
    let column = |replayed: &compensation_replay::Replay, name: &str| numbers(&replayed.track, name);
    let (t, age) = (column(&averaged, "t_s"), column(&averaged, "fix_age_s"));
    let fix = |t: &Option<f64>, age: &Option<f64>| 100.0 * (t.unwrap() - age.unwrap());
    assert!(t.iter().zip(&age).all(|(t, age)| (fix(t, age) - fix(t, age).round()).abs() < 1e-6));
    assert!(age.iter().flatten().all(|age| *age < 0.01), "no fix is older than a step of the log");
    for name in ["raw", "pade-1-1", "exact-async"] {
        let (all, averaged) = (error(&all, name), error(&averaged, name));
        assert!((averaged - all).abs() < 0.01 * all + 2e-3, "{name}: {averaged} m, not {all} m");
    }
}

#[test]
fn the_parts_of_a_track_match_the_whole() {
    let track = replay(&interrupted_circle(), &settings()).unwrap().track;
    let (whole, rows) = (track.whole(), track.rows());
    let parts: Vec<Track> = (0..rows).step_by(999).map(|from| track.part(from..rows.min(from + 999))).collect();
    assert!(parts.len() > 3 && parts.len() == rows.div_ceil(999));
    for (from, part) in (0..rows).step_by(999).zip(&parts) {
        assert_eq!(part, &whole.part(from..from + part.rows()), "rows from {from}");
    }
    assert_eq!(parts.iter().map(TrackRows::rows).sum::<usize>(), rows);
}
