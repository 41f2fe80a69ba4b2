//! Cost of the scores of a replay: a simulated flight of ten minutes, 5 and 100 Hz.

#![allow(clippy::print_stdout)] // printing is its purpose

use compensation_replay::{Settings, replay};
use flight::Delay;
use simulate::{FlightSettings, SensorSettings, simulate};
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    for position_hz in [5.0, 10.0, 100.0] {
        let settings = FlightSettings {
            duration_s: 600.0,
            position: SensorSettings { delay_s: 0.4, white_std: 0.3, ..SensorSettings::clean(position_hz) },
            velocity: SensorSettings { white_std: 0.1, ..SensorSettings::clean(100.0) },
            onboard_delay_s: Some(0.4),
            ..FlightSettings::default()
        };
        let flight = simulate(&settings)?.to_flight()?;
        let settings = Settings::with_delay(Delay::from_seconds(0.4).ok_or("delay")?, "known");
        for _ in 0..3 {
            let start = Instant::now();
            let found = replay(&flight, &settings)?;
            let ms = start.elapsed().as_secs_f64() * 1e3;
            println!("{position_hz} Hz: replay and scores {ms:.1} ms, {} rows", found.record.coverage.rows);
        }
    }
    Ok(())
}
