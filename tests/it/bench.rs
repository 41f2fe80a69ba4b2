//! The whole bench: records with known truth, through files, command and card.

use crate::agreement::{channels, containers, read_back};
use bench_analysis::{BenchInput, Rig, bench};
use record::{Finding, IronCalibration, SensorCard, TimeBasis, Verdict};
use simulate::{
    BenchChannel, BenchDemo, BenchSensor, BenchSettings, Container, Db3Settings, RigText, SimulatedBench,
    simulate_bench,
};
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// A short swing with every kind of channel, noisy enough that no two values are equal.
fn short() -> SimulatedBench {
    let settings = BenchSettings { swing_s: 20.0, rest_s: [2.0, 2.0], ..BenchSettings::ins() };
    simulate_bench(&settings.with(BenchChannel::PositionGps, BenchSensor::noisy(4.0, 0.1).late(0.4))).unwrap()
}

fn rig_of(simulated: &SimulatedBench) -> Rig {
    let text = RigText { model: "Simulated".into(), serial: "1".into(), to_be_fitted: true };
    Rig::parse(&simulated.rig_text(&text), Path::new("simulated.rig.toml")).unwrap()
}

#[test]
fn one_swing_gives_one_bench_record_in_every_container() {
    let simulated = short();
    let perfect = simulated.to_flight().unwrap();
    let rig = rig_of(&simulated);
    let of = |flight: &flight::Flight| {
        let input = BenchInput { encoder: flight, sensor: flight, one_log: true };
        serde_json::to_string(&bench(&input, &rig).unwrap().findings).unwrap()
    };
    let found = of(&perfect);
    // An encoder's message has no common type: a bag without definitions cannot describe it.
    let says_its_types = |c: &Container| !matches!(c, Container::Db3(Db3Settings { definitions: false, .. }));
    for (index, container) in containers().into_iter().filter(says_its_types).enumerate() {
        let loaded = read_back(&simulated.files(container, "swing").unwrap(), &format!("{container:?}"));
        assert!(channels(&loaded.flight) == channels(&perfect), "{container:?}: {:?}", loaded.binding);
        // Equal channels give equal findings: one container of each family shows that nothing else matters.
        if index % 12 == 0 {
            assert!(of(&loaded.flight) == found, "{container:?}");
        }
    }
}

/// Delay errors of positions 0.4 s late and of channels on time, with a 99.99 % interval for every channel.
#[test]
fn delays_of_a_simulated_sensor_are_found_within_their_uncertainty() {
    for (settings, late) in
        [(BenchSettings::default(), BenchChannel::PositionGps), (BenchSettings::ins(), BenchChannel::PositionIns)]
    {
        let simulated = simulate_bench(&BenchSettings { seed: 5, ..settings }).unwrap();
        let flight = simulated.to_flight().unwrap();
        let input = BenchInput { encoder: &flight, sensor: &flight, one_log: true };
        let found = bench(&input, &rig_of(&simulated)).unwrap().findings;
        assert_eq!(found.clocks.basis, TimeBasis::OneClock);
        for channel in &found.channels {
            let truth = if channel.name == late.name() { 0.4 } else { 0.0 };
            let delay = channel.delay.as_ref().unwrap();
            let error = delay.delay.seconds() - truth;
            assert!(error.abs() < 4.0 * delay.standard_uncertainty_s, "{}: {error} s, {delay:?}", channel.name);
            let expected = if truth > 0.0 { Verdict::Delayed } else { Verdict::EquivalentToZero };
            assert!(
                channel.verdict == expected || channel.name == "height.baro",
                "{}: {}",
                channel.name,
                channel.reason
            );
        }
        let position = found.channels.iter().find(|c| c.name == late.name()).unwrap();
        match &position.delay.as_ref().unwrap().as_seen_s {
            // Held for 25 rows of 10 ms: 0.12 s old on average (design note 3.8).
            Some(as_seen) => assert!((as_seen.value - 0.52).abs() < 0.02 && late == BenchChannel::PositionGps),
            None => assert_eq!(late, BenchChannel::PositionIns),
        }
    }
}

/// The demo's records through the command: one card for each sensor.
#[test]
fn the_command_makes_a_card_that_matches_the_truth() {
    let folder = crate::shared::demo().join("demo");
    let truth = fs::read(folder.join("bench").join(simulate::TRUTH_FILE)).unwrap();
    let demo: BenchDemo = serde_json::from_slice(&truth).unwrap();
    for serial in demo.records.iter().map(|r| r.serial.clone()).collect::<BTreeSet<_>>() {
        let of_sensor: Vec<_> = demo.records.iter().filter(|r| r.serial == serial).collect();
        let out = folder.join("bench-report").join(serial.to_lowercase());
        let card = card_in(&out);
        assert_eq!(card.sensor.serial.as_deref(), Some(serial.as_str()));
        assert_eq!(card.records.len(), of_sensor.len());
        // A lag is not a delay: the barometer's delay on the card depends on the swing.
        let delays = card.channels.iter().filter(|c| of_sensor.iter().all(|r| r.channels[&c.name].lags_s.is_empty()));
        for channel in delays {
            let truths: BTreeSet<String> = of_sensor
                .iter()
                .filter_map(|r| Some(r.channels.get(&channel.name)?.sampling.delay_s.to_string()))
                .collect();
            assert_eq!(truths.len(), 1, "{}: {truths:?}", channel.name);
            let truth: f64 = truths.first().unwrap().parse().unwrap();
            let error = channel.delay_s - truth;
            assert!(error.abs() < 4.0 * channel.delay_standard_uncertainty_s, "{serial} {}: {error} s", channel.name);
        }
        let page = fs::read_to_string(out.join("index.html")).unwrap();
        assert!(page.contains(&serial) && !page.contains("src=\"http"));
        let magnetometer = card.magnetometer.unwrap();
        assert_eq!(magnetometer.azimuths_rad.len(), of_sensor.len());
        match &magnetometer.iron {
            Finding::Found(iron) => {
                assert!(of_sensor.len() > 2 && page.contains("Soft iron, row by row"));
                holds_the_truth(iron, &of_sensor[0].channels[&magnetometer.channel]);
            }
            Finding::CannotTell(why) => {
                assert!(of_sensor.len() == 1 && why.contains("swing at 2 more, such as 150° and 270°"), "{why}");
                assert!(page.contains(why.as_str()));
            }
        }
    }
}

/// Hard iron, and soft iron scaled to determinant one, are within 4.5 standard uncertainties: 12 numbers.
fn holds_the_truth(iron: &IronCalibration, truth: &BenchSensor) {
    let soft = truth.soft_iron.unwrap();
    let [[a, b, c], [d, e, f], [g, h, i]] = soft;
    let scale = (a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)).cbrt();
    for (axis, soft) in soft.iter().enumerate() {
        let (off, u) = (iron.hard_iron[axis] - truth.sampling.bias[axis], iron.hard_iron_standard_uncertainty[axis]);
        assert!(off.abs() < 4.5 * u && u < 0.5e-6, "{axis}: {off} ± {u} T");
        for (column, soft) in soft.iter().enumerate() {
            let off = iron.soft_iron[axis][column] - soft / scale;
            let u = iron.soft_iron_standard_uncertainty[axis][column];
            assert!(off.abs() < 4.5 * u && u < 0.02, "{axis} {column}: {off} ± {u}");
        }
    }
}

fn card_in(out: &Path) -> SensorCard {
    let entries = fs::read_dir(out).unwrap().map(|entry| entry.unwrap().path());
    let file = entries.into_iter().find(|p| p.to_string_lossy().ends_with(".card.toml")).unwrap();
    bench_analysis::parse_card(&fs::read_to_string(&file).unwrap(), &file).unwrap()
}

#[test]
fn a_clock_skew_is_found_from_all_channels_together() {
    let mut settings = BenchSettings { seed: 9, ..BenchSettings::ins() };
    settings.clocks.device = Some(simulate::ClockError { offset_s: 12_345.6, skew: 80e-6 });
    let simulated = simulate_bench(&settings).unwrap();
    let (encoder, sensor) = simulated.to_flights().unwrap();
    let input = BenchInput { encoder: &encoder, sensor: &sensor, one_log: false };
    let found = bench(&input, &rig_of(&simulated)).unwrap().findings;
    assert_eq!(found.clocks.basis, TimeBasis::Anchor { channel: "angular-rate.imu".into() });
    let Finding::Found(skew) = &found.clocks.skew else { panic!("{:?}", found.clocks.skew) };
    let error = skew.value - 80e-6;
    assert!(error.abs() < 4.0 * skew.standard_uncertainty.unwrap() + 1e-8, "{skew:?}");
    let position = found.channels.iter().find(|c| c.name == "position.ins").unwrap();
    let delay = position.delay.as_ref().unwrap();
    assert!((delay.delay.seconds() - 0.4).abs() < 4.0 * delay.standard_uncertainty_s, "{delay:?}");
    assert!(position.reason.contains("relative to angular-rate.imu"), "{}", position.reason);
}

#[test]
fn a_bar_at_rest_gives_a_reason_instead_of_a_delay() {
    let settings = BenchSettings { swing: simulate::Swing::Still, ..BenchSettings::ins() };
    let simulated = simulate_bench(&settings).unwrap();
    let flight = simulated.to_flight().unwrap();
    let input = BenchInput { encoder: &flight, sensor: &flight, one_log: true };
    match bench(&input, &rig_of(&simulated)) {
        Ok(found) => {
            for channel in &found.findings.channels {
                assert_eq!(channel.verdict, Verdict::NotMeasurable, "{}", channel.name);
                assert!(!channel.reason.is_empty());
            }
        }
        Err(refusal) => assert!(!refusal.to_string().is_empty()),
    }
}
