//! All numbers of the records that the tests compute, as they were accepted. `FLIGHTLAG_BLESS=1` accepts a change: read
//! the diff.

use bench_analysis::{Bench, BenchInput, BenchRefusal, Rig};
use simulate::{BenchChannel, BenchSettings, RigText, one_field_per_line, simulate_bench};
use std::path::Path;

/// [`bench_analysis::bench`], compared with the golden text of the running test.
pub fn bench(input: &BenchInput<'_>, rig: &Rig) -> Result<Bench, BenchRefusal> {
    let found = bench_analysis::bench(input, rig);
    let record = match &found {
        Ok(found) => serde_json::to_value((&found.findings, &found.notices)).unwrap(),
        Err(refusal) => refusal.to_string().into(),
    };
    simulate::assert_golden(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden"), &one_field_per_line(&record));
    found
}

fn assert_as_accepted(settings: &BenchSettings) {
    let simulated = simulate_bench(settings).unwrap();
    let flight = simulated.to_flight().unwrap();
    let what = RigText { model: "M".into(), serial: "1".into(), to_be_fitted: false };
    let rig = Rig::parse(&simulated.rig_text(&what), Path::new("simulated.rig.toml")).unwrap();
    bench(&BenchInput { encoder: &flight, sensor: &flight, one_log: true }, &rig).unwrap();
}

#[test]
fn the_record_of_position_and_velocity_is_as_accepted() {
    let channels = [BenchChannel::PositionGps, BenchChannel::VelocityIns, BenchChannel::AngularRate];
    assert_as_accepted(&BenchSettings { seed: 24, swing_s: 30.0, ..BenchSettings::default() }.only(&channels));
}

#[test]
fn the_record_of_attitude_force_and_field_is_as_accepted() {
    let channels = [BenchChannel::Attitude, BenchChannel::SpecificForce, BenchChannel::MagneticField];
    assert_as_accepted(&BenchSettings { seed: 25, swing_s: 30.0, ..BenchSettings::default() }.only(&channels));
}
