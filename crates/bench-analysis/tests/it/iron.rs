//! Hard and soft iron from simulated records of one sensor, and from one record in which the bench was turned.

use crate::golden::bench;
use bench_analysis::{Bench, BenchInput, MagneticEvidence, Rig, card_magnetometer};
use flight::{Channel, Flight, NANOS_PER_SECOND, Series, Stamp, Timeline};
use nalgebra::Matrix3;
use record::{CardMagnetometer, Finding, IronCalibration};
use simulate::{BenchChannel, BenchSettings, RigText, SimulatedBench, simulate_bench};
use std::path::Path;

const HARD: [f64; 3] = [12e-6, -7e-6, 20e-6];
const SOFT: [[f64; 3]; 3] = [[1.05, 0.02, -0.03], [0.01, 0.97, 0.04], [-0.02, 0.03, 1.01]];

/// 15 s of swing with velocity and magnetometer; the bench is at `azimuth_deg`.
fn simulated(azimuth_deg: f64, seed: u64, start_s: i64) -> SimulatedBench {
    let mut settings = BenchSettings { seed, swing_s: 12.0, rest_s: [3.0, 3.0], ..BenchSettings::default() };
    settings.start = Stamp(settings.start.0 + start_s * NANOS_PER_SECOND);
    settings.bar.azimuth_rad = azimuth_deg.to_radians();
    let mut settings = settings.only(&[BenchChannel::VelocityIns, BenchChannel::MagneticField]);
    let magnetometer = settings.sensor.get_mut(&BenchChannel::MagneticField).unwrap();
    magnetometer.sampling.bias = HARD;
    magnetometer.soft_iron = Some(SOFT);
    simulate_bench(&settings).unwrap()
}

/// The rig of a bench whose azimuth differs by `error_deg` from the rig file; or is not stated.
fn rig(simulated: &SimulatedBench, error_deg: Option<f64>) -> Rig {
    let what = RigText { model: "M".into(), serial: "1".into(), to_be_fitted: false };
    let mut rig = Rig::parse(&simulated.rig_text(&what), Path::new("simulated.rig.toml")).unwrap();
    rig.analysis.inject_s = vec![];
    rig.bar.azimuth_rad = rig.bar.azimuth_rad.zip(error_deg).map(|(azimuth, error)| azimuth + error.to_radians());
    rig
}

fn measured(flight: &Flight, rig: &Rig) -> Bench {
    bench(&BenchInput { encoder: flight, sensor: flight, one_log: true }, rig).unwrap()
}

fn evidence(azimuth_deg: f64, seed: u64, error_deg: Option<f64>) -> MagneticEvidence {
    let simulated = simulated(azimuth_deg, seed, 0);
    measured(&simulated.to_flight().unwrap(), &rig(&simulated, error_deg)).magnetic
}

fn together(records: &[MagneticEvidence]) -> CardMagnetometer {
    card_magnetometer(&records.iter().collect::<Vec<_>>()).unwrap()
}

/// Errors of hard iron, soft iron and scale in standard uncertainties.
fn errors(found: &IronCalibration) -> Vec<f64> {
    let soft = Matrix3::from(SOFT).transpose();
    let scale = soft.determinant().cbrt();
    let mut z: Vec<f64> =
        (0..3).map(|k| (found.hard_iron[k] - HARD[k]) / found.hard_iron_standard_uncertainty[k]).collect();
    for r in 0..3 {
        for c in 0..3 {
            let error = found.soft_iron[r][c] - soft[(r, c)] / scale;
            z.push(error / found.soft_iron_standard_uncertainty[r][c]);
        }
    }
    z
}

#[test]
fn records_at_four_azimuths_recover_the_simulated_hard_and_soft_iron() {
    let records: Vec<MagneticEvidence> =
        [30.0, 75.0, 165.0, 308.0].iter().zip(1..).map(|(azimuth, seed)| evidence(*azimuth, seed, None)).collect();
    let found = together(&records);
    assert_eq!((found.channel.as_str(), found.unit.as_str()), ("magnetic-field.imu", "T"));
    assert_eq!(found.azimuths_rad.len(), 4);
    let iron = found.iron.found().unwrap();
    for (k, z) in errors(iron).iter().enumerate() {
        assert!(z.abs() < 4.5, "{k}: {z}");
    }
    assert!(iron.hard_iron_standard_uncertainty.iter().all(|u| *u < 0.5e-6), "{iron:?}");
    assert!(iron.soft_iron_standard_uncertainty.iter().flatten().all(|u| *u < 0.01), "{iron:?}");
    let scale = Matrix3::from(SOFT).determinant().cbrt();
    let (ratio, u) = (iron.scale.unwrap(), iron.scale_standard_uncertainty.unwrap());
    assert!((ratio - scale).abs() < 4.5 * u + 2e-4, "{ratio} ± {u}, true {scale}: the model differs by 1e-4");
    // The simulated white noise is 0.2 µT.
    assert!((iron.residual_rms / 0.2e-6 - 1.0).abs() < 0.1, "{}", iron.residual_rms);
}

#[test]
fn azimuths_stated_wrongly_widen_the_uncertainty() {
    let azimuths = [30.0, 75.0, 165.0, 308.0];
    let wrong = [0.6, -0.4, 0.5, -0.7];
    let with = |errors: [Option<f64>; 4]| {
        let records: Vec<MagneticEvidence> =
            azimuths.iter().zip(errors).zip(1..).map(|((a, e), seed)| evidence(*a, seed, e)).collect();
        together(&records).iron.found().unwrap().clone()
    };
    let (fitted, stated) = (with([None; 4]), with(wrong.map(Some)));
    assert!(stated.hard_iron_standard_uncertainty[1] > 2.0 * fitted.hard_iron_standard_uncertainty[1]);
    assert!(errors(&stated).iter().all(|z| z.abs() < 4.5), "{:?}", errors(&stated));
    assert!(stated.text.contains("0.5°") && !fitted.text.contains("0.5°"), "{}", stated.text);
}

#[test]
fn too_few_azimuths_are_reported_with_those_that_would_help() {
    let Finding::CannotTell(why) = together(&[evidence(30.0, 1, None)]).iron else { panic!() };
    assert!(why.contains("at an azimuth of 30°; swing at 2 more, such as 150° and 270°"), "{why}");
    let near = [evidence(30.0, 1, None), evidence(33.0, 2, None), evidence(100.0, 3, None)];
    let Finding::CannotTell(why) = together(&near).iron else { panic!() };
    assert!(why.contains("2 azimuths within 70°; swing at 1 more, such as 245°"), "{why}");
}

#[test]
fn records_in_different_fields_are_not_combined() {
    let mut records = [30.0, 150.0, 270.0].map(|azimuth| evidence(azimuth, 1, None));
    let model = records[2].around.model.as_mut().unwrap();
    model.ned_t[0] *= 1.1;
    let Finding::CannotTell(why) = together(&records).iron else { panic!() };
    assert!(why.contains("in one place"), "{why}");
}

/// Concatenates two flights into one log.
fn joined(parts: &[Flight]) -> Flight {
    let mut whole = parts[0].clone();
    for (name, channel) in &mut whole.channels {
        let all: Vec<&Channel> = parts.iter().map(|p| &p.channels[name]).collect();
        let timeline = channel.series.timeline();
        let stamps = all.iter().flat_map(|c| c.series.timeline().stamps()).copied().collect();
        let columns = (0..channel.series.components().len())
            .map(|k| all.iter().flat_map(|c| c.series.component(k)).copied().collect())
            .collect();
        let timeline = Timeline::new(timeline.kind(), timeline.clock(), stamps).unwrap();
        channel.series = Series::new(timeline, columns).unwrap();
        channel.held = all.iter().flat_map(|c| &c.held).copied().collect();
        channel.other_stamps = vec![];
    }
    whole
}

#[test]
fn a_bench_turned_within_a_record_is_reported_and_calibrated() {
    let parts: Vec<SimulatedBench> =
        [30.0, 150.0, 270.0].iter().zip(0..).map(|(azimuth, k)| simulated(*azimuth, 1 + k, 19 * k as i64)).collect();
    let flights: Vec<Flight> = parts.iter().map(|p| p.to_flight().unwrap()).collect();
    let found = measured(&joined(&flights), &rig(&parts[0], None));
    let notice = found.notices.iter().find(|n| n.code == "record-split").unwrap();
    assert!(notice.text.contains("30° from") && notice.text.contains("150° from") && notice.text.contains("270° from"));
    for (swing, truth) in found.magnetic.swings.iter().zip([30.0f64, 150.0, 270.0]) {
        let off = swing.azimuth.value.rem_euclid(std::f64::consts::TAU) - truth.to_radians();
        assert!(off.abs() < 4.5 * swing.azimuth.standard_uncertainty.unwrap(), "{truth}: {off}");
    }
    assert!(errors(together(&[found.magnetic]).iron.found().unwrap()).iter().all(|z| z.abs() < 4.5));
    let of_record = found.findings.mount.magnetometer.found().unwrap();
    assert_eq!((of_record.kind.as_str(), of_record.azimuths), ("full", 3));
    let steady = measured(&flights[0], &rig(&parts[0], None));
    assert!(steady.notices.iter().all(|n| n.code != "record-split"));
}
