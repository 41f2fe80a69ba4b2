//! Cost of measuring the delays of a flight, with the results:
//! `cargo run --release -p flightlag-compensation-replay --example flight_delay_cost -- [part of a case's name]`

#![allow(clippy::print_stdout)] // printing is its purpose

use compensation_replay::{FlightDelaySettings, measure_delays};
use record::{Finding, PairDelay};
use simulate::{FlightSettings, SensorSettings, Wander, simulate};
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let gps = |rate_hz: f64, white_std: f64| SensorSettings {
        delay_s: 0.4,
        white_std,
        wander: Some(Wander { std: 1.5, time_constant_s: 60.0 }),
        ..SensorSettings::clean(rate_hz)
    };
    let white =
        |rate_hz: f64, white_std: f64| SensorSettings { delay_s: 0.4, white_std, ..SensorSettings::clean(rate_hz) };
    let cases = [
        ("10 min, 10 Hz, 50 Hz", 600.0, gps(10.0, 0.3), 50.0),
        ("1 min, 5 Hz, 100 Hz (perf recipe)", 60.0, white(5.0, 0.3), 100.0),
        ("the same with its truth, three pairs", 60.0, white(5.0, 0.3), 100.0),
        ("1 min, 100 Hz, 100 Hz", 60.0, gps(100.0, 0.3), 100.0),
        ("1 hour, 10 Hz, 100 Hz", 3600.0, gps(10.0, 0.3), 100.0),
    ];
    let part = std::env::args().nth(1).unwrap_or_default();
    for (name, duration_s, position, velocity_hz) in cases.into_iter().filter(|c| c.0.contains(&part)) {
        let settings = FlightSettings {
            duration_s,
            position,
            velocity: SensorSettings { white_std: 0.1, ..SensorSettings::clean(velocity_hz) },
            ..FlightSettings::default()
        };
        let mut flight = simulate(&settings)?.to_flight()?;
        if !name.contains("truth") {
            flight.channels.remove("position.truth");
        }
        let mut times = vec![];
        let mut summary = String::new();
        for _ in 0..15 {
            let start = Instant::now();
            let (found, _) = measure_delays(&flight, &FlightDelaySettings::default());
            times.push(start.elapsed().as_secs_f64() * 1e3);
            let of = |p: &PairDelay| match &p.delay {
                Finding::Found(d) => {
                    let u = d.delay_s.standard_uncertainty.unwrap_or(0.0);
                    format!("{:.3} ms, u {:.3} ms", 1e3 * d.delay_s.value, 1e3 * u)
                }
                Finding::CannotTell(reason) => reason.clone(),
            };
            summary = found.pairs.iter().map(of).collect::<Vec<_>>().join("; ");
        }
        times.sort_by(f64::total_cmp);
        println!("{name}: least {:.1} ms, median {:.1} ms; {summary}", times[0], times[7]);
    }
    Ok(())
}
