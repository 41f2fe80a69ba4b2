//! Reports when the clocks of encoder and sensor do not fit.

use crate::golden::bench;
use crate::support::{Sensor, Swing, encoder_channel, flight_of, rig, sensed};
use bench_analysis::BenchInput;
use flight::{Channel, Clock, Code, Flight, Notice, Quantity, Series, Stamp, Timeline};

/// The channel with other timestamps: of this clock, each computed from the old one.
fn restamped(channel: &Channel, clock: Clock, stamp: impl Fn(i64) -> i64) -> Channel {
    let timeline = channel.series.timeline();
    let stamps = timeline.stamps().iter().map(|s| Stamp(stamp(s.0))).collect();
    let timeline = Timeline::new(timeline.kind(), clock, stamps).unwrap();
    Channel { series: Series::new(timeline, channel.series.components().to_vec()).unwrap(), ..channel.clone() }
}

/// A swing with its encoder, a gyro and a velocity; all on one clock and on time.
fn recorded(swing: &Swing) -> Flight {
    let sensor = Sensor::upright(0.7);
    flight_of(vec![
        ("encoder.bar", encoder_channel(swing, 1000.0, 2000.0, 1.0, 0.0)),
        ("angular-rate.imu", sensed(swing, &sensor, Quantity::AngularRate, 100.0, 0.0, 0.002)),
        ("velocity.ins", sensed(swing, &sensor, Quantity::VelocityNed, 100.0, 0.0, 0.002)),
    ])
}

fn notices(flight: &Flight, one_log: bool, code: Code) -> Vec<Notice> {
    let mut rig = rig("azimuth_deg = 40.1", "sign = 1", "");
    rig.analysis.inject_s = vec![];
    let found = bench(&BenchInput { encoder: flight, sensor: flight, one_log }, &rig).unwrap();
    found.notices.iter().filter(|notice| notice.code == code).cloned().collect()
}

#[test]
fn a_channel_on_its_own_clock_is_skipped_and_named() {
    let mut flight = recorded(&Swing::by_hand(0.0));
    assert_eq!(notices(&flight, true, Code::ClockTie), []);
    let gyro = restamped(&flight.channels["angular-rate.imu"], Clock::Boot, |ns| ns + 5_000_000_000);
    let rows = gyro.series.len() as u64;
    flight.channels.insert("angular-rate.imu".into(), gyro);
    let said = notices(&flight, true, Code::ClockTie);
    assert_eq!((said.len(), said[0].place.as_str(), said[0].count), (1, "angular-rate.imu", rows), "{said:?}");
    assert!(
        said[0].text.contains("the relation of its clock (since boot) to the encoder's (elapsed) is unknown"),
        "{said:?}"
    );
}

/// Two clocks whose rig file says that they are one.
#[test]
fn a_gyro_too_late_or_early_for_one_clock_is_reported() {
    let mut rig = rig("azimuth_deg = 40.1", "sign = 1", "");
    rig.analysis.inject_s = vec![];
    for (shift_ns, text) in [(321_000_000, "is 321.0 ± "), (30_000_000, ""), (-30_000_000, "is 30.0 ± ")] {
        let mut flight = recorded(&Swing::by_hand(0.0));
        for name in ["angular-rate.imu", "velocity.ins"] {
            let shifted = restamped(&flight.channels[name], Clock::Elapsed, |ns| ns + shift_ns);
            flight.channels.insert(name.into(), shifted);
        }
        let found = bench_analysis::bench(&BenchInput { encoder: &flight, sensor: &flight, one_log: true }, &rig);
        let notices = found.unwrap().notices;
        let said: Vec<&Notice> = notices.iter().filter(|notice| notice.code == Code::ClockTie).collect();
        assert_eq!(said.len(), usize::from(!text.is_empty()), "{said:?}");
        let side = if shift_ns > 0 { "ms late (k = 2)" } else { "ms early (k = 2)" };
        assert!(said.iter().all(|n| n.place == "angular-rate.imu" && n.text.contains(text) && n.text.contains(side)));
    }
}

/// Timestamps that gain 2 ms per second, on the encoder's own clock.
#[test]
fn channels_that_drift_on_the_encoders_own_clock_are_reported() {
    let mut flight = recorded(&Swing::by_hand(0.0));
    assert_eq!(notices(&flight, true, Code::ClockTie), []);
    for name in ["angular-rate.imu", "velocity.ins"] {
        let drifting = restamped(&flight.channels[name], Clock::Elapsed, |ns| ns + ns / 500);
        flight.channels.insert(name.into(), drifting);
    }
    let said = notices(&flight, true, Code::ClockTie);
    // A second of timestamps lasts 1/1.002 s of truth: 1996.0 ppm too many.
    let found = said[0].text.split("by ").nth(1).and_then(|text| text.split(' ').next()).unwrap();
    assert!(said.len() == 1 && (found.parse::<f64>().unwrap() - 1996.0).abs() < 3.0, "{said:?}");
}

/// One sine repeats after a period, so two clocks can be aligned in many ways.
#[test]
fn a_swing_of_one_sine_is_too_regular_to_align_two_clocks() {
    let by_hand = Swing::by_hand(0.0);
    assert_eq!(notices(&recorded(&by_hand), false, Code::ClockTie), []);
    let regular = Swing { sines: vec![(0.7, 0.5, 0.3)], ..by_hand };
    let said = notices(&recorded(&regular), false, Code::ClockTie);
    assert!(said.len() == 1 && said[0].text.contains("too regular"), "{said:?}");
}
