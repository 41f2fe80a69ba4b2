use super::*;
use delay_from_flight::measure_delays;
use flight::NANOS_PER_SECOND;
use simulate::{FlightSettings, SensorSettings, simulate};

const POSITION: [&str; 1] = ["position.gps"];

fn wanted() -> Vec<String> {
    POSITION.map(str::to_owned).to_vec()
}

/// Four minutes of flight: a late position and a velocity in the log, the truth in a second file.
fn two_files() -> (Flight, Flight) {
    let settings = FlightSettings {
        duration_s: 240.0,
        position: SensorSettings { delay_s: 0.2, white_std: 0.3, ..SensorSettings::clean(5.0) },
        velocity: SensorSettings { white_std: 0.1, ..SensorSettings::clean(25.0) },
        ..FlightSettings::default()
    };
    let mut log = simulate(&settings).unwrap().to_flight().unwrap();
    let mut second = Flight::default();
    second.channels.insert("position.ppk".to_owned(), log.channels.remove("position.truth").unwrap());
    (log, second)
}

/// The channels on a clock that is ahead by `offset_s` at its first timestamp and gains `drift`.
fn with_clock(flight: &Flight, clock: Clock, offset_s: f64, drift: f64) -> Flight {
    let mut out = Flight::default();
    for (name, channel) in &flight.channels {
        let first = channel.series.timeline().first().unwrap();
        let stamp = |s: Stamp| Some(s.plus_seconds(offset_s + drift * s.seconds_since(first)));
        out.channels.insert(name.clone(), moved(channel, clock, &stamp).unwrap());
    }
    out
}

fn own(log: &Flight, second: &Flight, rule: ClockRule) -> ClockOffset {
    match relate_clocks(log, second, &wanted(), rule, &FlightDelaySettings::default()) {
        ReferenceClock::Own(offset) => offset,
        other => panic!("{other:?}"),
    }
}

/// Error of the timestamps with this offset, s, at the first, the middle and the last row.
fn errors(second: &Flight, moved: &Flight, clock: &ClockOffset) -> Vec<f64> {
    let stamps = |f: &Flight| f.channels["position.ppk"].series.timeline().stamps().to_vec();
    let (truth, own) = (stamps(second), stamps(moved));
    let row = |k: usize| Stamp(clock.in_log_ns(own[k].0).unwrap()).seconds_since(truth[k]);
    vec![row(0), row(truth.len() / 2), row(truth.len() - 1)]
}

#[test]
fn the_offset_of_another_clock_is_found_within_its_interval() {
    let (log, second) = two_files();
    for offset_s in [0.0, 3601.25, -98_765.4] {
        let other = with_clock(&second, Clock::Elapsed, offset_s, 0.0);
        let found = own(&log, &other, ClockRule::Auto);
        assert_eq!(found.by, "velocity.gps");
        assert!(found.standard_uncertainty_s < 3e-3 && found.drift.is_none(), "{found:?}");
        for e in errors(&second, &other, &found) {
            assert!(e.abs() < 3.0 * found.standard_uncertainty_s, "{e} {found:?}");
        }
    }
}

#[test]
fn the_drift_of_another_clock_is_found() {
    let (log, second) = two_files();
    let other = with_clock(&second, Clock::Boot, 500.0, 400e-6);
    let found = own(&log, &other, ClockRule::Auto);
    let drift = found.drift.unwrap();
    assert!((drift.value + 400e-6).abs() < 3.0 * drift.standard_uncertainty.unwrap(), "{drift:?}");
    // 48 ms from start to end without the drift.
    assert!(errors(&second, &other, &found).iter().all(|e| e.abs() < 8e-3), "{found:?}");
}

#[test]
fn two_files_that_count_utc_share_a_clock_whatever_their_time_scale() {
    let (log, second) = two_files();
    let start = 1_700_000_000.0;
    let log = with_clock(&log, Clock::Unix, start, 0.0);
    let utc = with_clock(&second, Clock::Unix, start, 0.0);
    let mut gps = utc.clone();
    let channel = gps.channels.get_mut("position.ppk").unwrap();
    *channel = moved(channel, Clock::Gps, &|s| gps_of_unix(s)).unwrap();
    for second in [utc, gps] {
        let settings = FlightDelaySettings::default();
        let clock = relate_clocks(&log, &second, &wanted(), ClockRule::Auto, &settings);
        assert_eq!(clock, ReferenceClock::Same);
        let mut both = log.clone();
        assert_eq!(join_reference(&mut both, &second, &wanted(), &clock), [REFERENCE_POSITION]);
        let (delays, _) = measure_delays(&both, &settings);
        let pair = delays.pairs.iter().find(|p| p.first == "position.gps" && p.second == REFERENCE_POSITION).unwrap();
        let found = pair.delay.found().unwrap().delay_s;
        assert!((found.value - 0.2).abs() < 3.0 * found.standard_uncertainty.unwrap(), "{found:?}");
    }
}

#[test]
fn a_file_of_another_day_has_its_own_clock() {
    let (log, second) = two_files();
    let log = with_clock(&log, Clock::Unix, 1_700_000_000.0, 0.0);
    let summer_time = with_clock(&second, Clock::Unix, 1_700_003_600.0, 0.0);
    let found = own(&log, &summer_time, ClockRule::Auto);
    assert!((found.offset_ns + 3600 * NANOS_PER_SECOND).abs() < 10_000_000, "{found:?}");
}

#[test]
fn unrelated_clocks_are_rejected_with_the_reason() {
    let (log, second) = two_files();
    let settings = FlightDelaySettings::default();
    let reason = |log: &Flight, second: &Flight, rule| match relate_clocks(log, second, &wanted(), rule, &settings) {
        ReferenceClock::Unknown { reason } => reason,
        other => panic!("{other:?}"),
    };
    let mut without = log.clone();
    without.channels.remove("velocity.gps");
    assert!(reason(&without, &second, ClockRule::Own).contains("no velocity to relate the clocks by"));
    assert!(reason(&log, &Flight::default(), ClockRule::Auto).contains("no position and no velocity"));
    let utc = with_clock(&second, Clock::Unix, 0.0, 0.0);
    let boot = with_clock(&log, Clock::Boot, 0.0, 0.0);
    assert!(reason(&boot, &utc, ClockRule::Same).contains("it counts UTC (Unix) and the log since boot"));
    let other = simulate(&FlightSettings { duration_s: 200.0, seed: 77, ..FlightSettings::default() }).unwrap();
    let mut foreign = Flight::default();
    let mut track = other.to_flight().unwrap().channels.remove("position.truth").unwrap();
    // East and north exchanged, and mirrored: no part of it was flown in the log.
    let timeline = track.series.timeline().clone();
    let [n, e, d] = [0, 1, 2].map(|k| track.series.component(k).to_vec());
    let n: Vec<f64> = n.iter().rev().map(|x| x - n[0]).collect();
    track.series = Series::new(timeline, vec![e, n, d]).unwrap();
    foreign.channels.insert("position.x".into(), track);
    let text = reason(&log, &foreign, ClockRule::Own);
    assert!(text.contains("is it of the same flight?") || text.contains("the motion repeats itself"), "{text}");
}

/// Output of a quadcopter's filter or a receiver's Doppler velocity, without a position.
#[test]
fn a_second_file_may_hold_a_velocity_alone() {
    let (mut log, second) = two_files();
    let mut other = Flight::default();
    other.channels.insert("velocity.mocap".into(), log.channels["velocity.gps"].clone());
    let far = with_clock(&other, Clock::Elapsed, -40.0, 0.0);
    drop(second);
    let found = own(&log, &far, ClockRule::Own);
    assert!((found.offset_ns - 40 * NANOS_PER_SECOND).abs() < 5_000_000, "{found:?}");
    let clock = ReferenceClock::Own(found);
    assert_eq!(join_reference(&mut log, &far, &wanted(), &clock), [REFERENCE_VELOCITY]);
}

#[test]
fn a_shared_clock_contradicted_by_the_motion_is_refused_with_the_gap() {
    let (log, second) = two_files();
    let relate =
        |second: &Flight| relate_clocks(&log, second, &wanted(), ClockRule::Same, &FlightDelaySettings::default());
    let clock = log.channels["position.gps"].series.timeline().clock();
    assert_eq!(relate(&with_clock(&second, clock, 0.0, 0.0)), ReferenceClock::Same);
    assert_eq!(relate(&with_clock(&second, clock, -4.0, 0.0)), ReferenceClock::Same, "a delay may be as large");
    match relate(&with_clock(&second, clock, 92.7, 0.0)) {
        ReferenceClock::Unknown { reason } => {
            assert!(
                reason.starts_with("its clock is not that of the log: the motion agrees if about -92."),
                "{reason}"
            );
            assert!(reason.contains("Use --reference-clock own"), "{reason}");
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn the_rms_speed_is_of_both_axes_and_of_the_samples_inside() {
    let motion =
        Motion { t: vec![0.0, 1.0, 2.0, 3.0], north: vec![90.0, 3.0, 0.0, 90.0], east: vec![90.0, 4.0, 1.0, 90.0] };
    assert_eq!(motion.rms_between((1.0, 1.5)), Some(5.0));
    assert_eq!(motion.rms_between((1.0, 2.0)), Some(13f64.sqrt()));
    assert_eq!(motion.rms_between((2.5, 2.9)), None);
}
