//! Cost of measuring the delays of a flight.

use delay_from_flight::{FlightDelaySettings, measure_delays};
use divan::Bencher;
use flight::Flight;

fn main() {
    divan::main();
}

/// Position and velocity of a circuit, without its truth.
fn flight(duration_s: f64, position_hz: f64, velocity_hz: f64) -> Flight {
    let mut flight = benches::circuit(duration_s, position_hz, velocity_hz).to_flight().unwrap();
    flight.channels.remove("position.truth");
    flight
}

/// One pair: seconds of flight, fixes per second, velocities per second.
#[divan::bench(args = [(60, 5, 100), (600, 10, 50), (3600, 10, 100)])]
fn one_pair(bencher: Bencher, (duration_s, position_hz, velocity_hz): (u32, u32, u32)) {
    let flight = flight(f64::from(duration_s), f64::from(position_hz), f64::from(velocity_hz));
    let settings = FlightDelaySettings::default();
    bencher.bench_local(|| measure_delays(&flight, &settings));
}
