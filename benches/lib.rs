//! The simulated flight that the benchmarks share.

use simulate::{FlightSettings, SensorSettings, SimulatedFlight, Wander, simulate};

/// A circuit of `duration_s` seconds: position 0.4 s late with noise and wander, velocity on time.
///
/// # Panics
/// If the simulator rejects the settings.
#[must_use]
#[allow(clippy::expect_used)] // a benchmark without its flight cannot go on
pub fn circuit(duration_s: f64, position_hz: f64, velocity_hz: f64) -> SimulatedFlight {
    let position = SensorSettings {
        delay_s: 0.4,
        white_std: 0.3,
        wander: Some(Wander { std: 1.5, time_constant_s: 60.0 }),
        ..SensorSettings::clean(position_hz)
    };
    let velocity = SensorSettings { white_std: 0.1, ..SensorSettings::clean(velocity_hz) };
    simulate(&FlightSettings { duration_s, position, velocity, ..FlightSettings::default() }).expect("a circuit")
}
