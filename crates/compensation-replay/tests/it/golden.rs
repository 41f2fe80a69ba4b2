//! All numbers of the records that the tests compute, as they were accepted. `FLIGHTLAG_BLESS=1` accepts a change: read
//! the diff.

use crate::flights::late;
use compensation_replay::{Refusal, Replay, Settings, Sweeper};
use delay_from_flight::FlightDelaySettings;
use flight::{Flight, Notices};
use record::{DelaySource, Estimate, FlightDelays};
use serde::Serialize;
use simulate::{FlightSettings, LikeCase, SensorSettings, one_field_per_line, simulate};
use std::path::Path;

/// Three minutes with noisy sensors, position 0.4 s late.
fn flown() -> Flight {
    let settings = FlightSettings {
        duration_s: 180.0,
        seed: 24,
        position: SensorSettings { delay_s: 0.4, white_std: 0.1, ..SensorSettings::clean(5.0) },
        velocity: SensorSettings { delay_s: 0.02, white_std: 0.05, ..SensorSettings::clean(20.0) },
        ..FlightSettings::default()
    };
    simulate(&settings).unwrap().to_flight().unwrap()
}

fn assert_golden(record: &impl Serialize) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden");
    simulate::assert_golden(&folder, &one_field_per_line(&serde_json::to_value(record).unwrap()));
}

/// [`delay_from_flight::measure_delays`], compared with the golden text of the running test.
pub fn measure_delays(flight: &Flight, settings: &FlightDelaySettings) -> (FlightDelays, Notices) {
    let (delays, notices) = delay_from_flight::measure_delays(flight, settings);
    assert_golden(&(&delays, &notices));
    (delays, notices)
}

/// [`compensation_replay::replay`], compared with the golden text of the running test.
pub fn replay(flight: &Flight, settings: &Settings) -> Result<Replay, Refusal> {
    let replayed = compensation_replay::replay(flight, settings);
    match &replayed {
        Ok(replayed) => assert_golden(&(&replayed.record, &replayed.notices)),
        Err(refusal) => assert_golden(&refusal.to_string()),
    }
    replayed
}

#[test]
fn the_record_of_a_replay_is_as_accepted() {
    replay(&flown(), &Settings::with_delay(late(0.38), "test")).unwrap();
}

#[test]
fn the_measured_delays_of_a_flight_are_as_accepted() {
    measure_delays(&flown(), &FlightDelaySettings::default());
}

#[test]
fn the_measured_delays_without_a_reference_are_as_accepted() {
    let mut flight = flown();
    flight.channels.remove("position.truth");
    measure_delays(&flight, &FlightDelaySettings::default());
}

/// One minute of a case with more compensators, its sweep and its measured delays.
fn assert_case(case: LikeCase) {
    let names = ["pade-2-2", "pade-1-1-zoh", "pade-3-3", "kalman", "offline-shift", "rts-smoother"];
    let compensators = names.iter().map(|name| name.parse().unwrap()).collect();
    let flight = simulate(&FlightSettings { duration_s: 60.0, ..case.settings(24) }).unwrap().to_flight().unwrap();
    let settings = Settings { compensators, ..Settings::with_delay(late(0.4), "test") };
    replay(&flight, &settings).unwrap();
    let (mut delays, _) = measure_delays(&flight, &FlightDelaySettings { inject_s: vec![], ..Default::default() });
    let sweeper = Sweeper::of(&flight, &settings).unwrap();
    let optimum = sweeper.best(&delays.pairs.remove(0).delay);
    let fixed = Estimate { value: 0.38, standard_uncertainty: Some(0.004) };
    assert_golden(&sweeper.sweep(&[(DelaySource::Fixed, fixed)], optimum));
}

#[test]
fn the_records_of_a_plain_gps_with_an_ins_are_as_accepted() {
    assert_case(LikeCase::C);
}

#[test]
fn the_records_of_an_rtk_receiver_are_as_accepted() {
    assert_case(LikeCase::D);
}

#[test]
fn the_records_of_a_plain_gps_are_as_accepted() {
    assert_case(LikeCase::F);
}
