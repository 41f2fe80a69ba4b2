//! All numbers of bench records. `FLIGHTLAG_BLESS=1` accepts a change: read the diff.

use bench_analysis::{BenchInput, Rig, bench};
use simulate::{BenchChannel, BenchSettings, RigText, golden_difference, one_value_per_line, simulate_bench};
use std::path::Path;

fn assert_golden(name: &str, settings: &BenchSettings) {
    let simulated = simulate_bench(settings).unwrap();
    let flight = simulated.to_flight().unwrap();
    let what = RigText { model: "M".into(), serial: "1".into(), to_be_fitted: false };
    let rig = Rig::parse(&simulated.rig_text(&what), Path::new("simulated.rig.toml")).unwrap();
    let found = bench(&BenchInput { encoder: &flight, sensor: &flight, one_log: true }, &rig).unwrap();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(format!("{name}.txt"));
    let difference = golden_difference(&path, &one_value_per_line(&serde_json::to_value(&found.findings).unwrap()));
    assert!(difference.is_none(), "{}", difference.unwrap_or_default());
}

#[test]
fn the_record_of_position_and_velocity_is_as_accepted() {
    let channels = [BenchChannel::PositionGps, BenchChannel::VelocityIns, BenchChannel::AngularRate];
    assert_golden("position", &BenchSettings { seed: 24, swing_s: 30.0, ..BenchSettings::default() }.only(&channels));
}

#[test]
fn the_record_of_attitude_force_and_field_is_as_accepted() {
    let channels = [BenchChannel::Attitude, BenchChannel::SpecificForce, BenchChannel::MagneticField];
    assert_golden("inertial", &BenchSettings { seed: 25, swing_s: 30.0, ..BenchSettings::default() }.only(&channels));
}
