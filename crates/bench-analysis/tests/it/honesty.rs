//! Records that break an assumption: what is said of them must be no confident wrong number.

use crate::support::{Noise, Sensor, Swing, encoder_channel, flight_of, rig, sensed};
use bench_analysis::{Bench, BenchInput, bench};
use flight::{Channel, Flight, Quantity};
use record::ChannelDynamics;

fn measured(encoder: Channel, sensors: Vec<(&str, Channel)>) -> Bench {
    let mut channels = vec![("encoder.bar", encoder)];
    channels.extend(sensors);
    let flight: Flight = flight_of(channels);
    let mut rig = rig("azimuth_deg = 30", "", "");
    rig.analysis.inject_s = vec![];
    bench(&BenchInput { encoder: &flight, sensor: &flight, one_log: true }, &rig).unwrap()
}

fn channel_of<'a>(found: &'a Bench, name: &str) -> &'a ChannelDynamics {
    found.findings.channels.iter().find(|c| c.name == name).unwrap()
}

/// A swing of the hand that is another one for each seed.
fn swing(seed: u64) -> Swing {
    let mut noise = Noise::seeded(seed);
    let mut swing = Swing::by_hand(0.0);
    for (_, f, phase) in &mut swing.sines {
        *f *= 1.0 + noise.gauss(0.05);
        *phase += noise.gauss(2.0);
    }
    swing.duration = 60.0;
    swing
}

/// Rows of `late` from `from_s` on, of `early` before.
fn changing(early: &Channel, late: &Channel, from_s: f64) -> Channel {
    let rows = early.series.len();
    let from = early.series.timeline().stamps().iter().filter(|s| (s.0 as f64) < from_s * 1e9).count();
    let of = |k: usize| [&early.series.component(k)[..from], &late.series.component(k)[from..]].concat();
    let values: Vec<Vec<f64>> = (0..early.series.components().len()).map(of).collect();
    let t: Vec<f64> = early.series.timeline().stamps().iter().map(|s| s.0 as f64 * 1e-9).collect();
    assert_eq!(values[0].len(), rows);
    crate::support::channel(early.quantity, &t, values)
}

/// It was 45.8 ± 0.9 ms without a word, and exit code 0.
#[test]
fn a_delay_that_changes_is_said_and_covered() {
    for seed in 0..3 {
        let (swing, sensor) = (swing(seed), Sensor { seed, ..Sensor::upright(30f64.to_radians()) });
        let velocity = |delay| sensed(&swing, &sensor, Quantity::VelocityNed, 50.0, delay, 0.03);
        let changed = changing(&velocity(0.02), &velocity(0.08), 32.0);
        let gyro = sensed(&swing, &sensor, Quantity::AngularRate, 50.0, 0.0, 0.01);
        let encoder = encoder_channel(&swing, 100.0, 2000.0, 1.0, 0.0);
        let found = measured(encoder, vec![("velocity.ins", changed), ("angular-rate.imu", gyro)]);
        let velocity = channel_of(&found, "velocity.ins");
        let [low, high] = velocity.delay.as_ref().unwrap().interval_95_s;
        assert!(low < 0.021 && high > 0.079, "{low} {high}");
        assert!(velocity.stationarity.found().unwrap().changes, "{velocity:?}");
        assert!(velocity.reason.contains("changes over the record, between"), "{}", velocity.reason);
        let gyro = channel_of(&found, "angular-rate.imu");
        assert!(!gyro.stationarity.found().unwrap().changes && gyro.delay.as_ref().unwrap().change_s == 0.0);
    }
}
