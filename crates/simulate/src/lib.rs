//! Flights and bench records with known truth, in every format that flightlag reads.
//!
//! A [`Trajectory`] is the path, a [`SensorSettings`] defines the errors of each sensor, and [`simulate`] creates a
//! [`SimulatedFlight`]: truth at any instant, late position, velocity on time. It becomes a [`flight::Flight`] directly
//! ([`SimulatedFlight::to_flight`]) or bytes of a log ([`Container::files`]), and [`write_demo`] writes a whole
//! campaign of them.
//!
//! A bench is simulated the same way: [`simulate_bench`] swings a bar with an encoder and a sensor on it and creates a
//! [`SimulatedBench`].
//!
//! The same settings give the same bytes. (Sines come from the platform's mathematical library: the last bit of a value
//! may differ between platforms.)
//!
//! ```
//! use simulate::{FlightSettings, simulate};
//! let flight = simulate(&FlightSettings { duration_s: 20.0, ..FlightSettings::default() })?;
//! // Position is 0.4 s late: the value with timestamp 10.0 s was true at 9.6 s.
//! let row = flight.position.at_s.iter().position(|&t| t == 10.0).unwrap();
//! let truth = flight.truth.at(9.6).position;
//! assert!((flight.position.ned[row][0] - truth[0]).abs() < 1e-9);
//! # Ok::<(), simulate::SimulateError>(())
//! ```

mod bench;
mod damage;
mod demo;
mod error;
#[cfg(feature = "every-format")]
mod golden;
mod onboard;
mod presets;
mod random;
mod samples;
#[cfg(feature = "every-format")]
mod seeds;
mod sensor;
mod simulated;
mod trajectory;
mod write;

pub use bench::{
    Bar, BarMotion, BenchChannel, BenchClocks, BenchDemo, BenchDemoRecord, BenchSamples, BenchSensor, BenchSettings,
    BenchTruth, ClockError, Encoder, EncoderOutput, EncoderSamples, FlexibleBar, Mount, Outliers, PulseSamples, Pulses,
    RigText, SimulatedBench, Site, Swing, simulate_bench, write_bench_demo,
};
pub use damage::{cut_off, zero_block};
pub use demo::{DemoFlight, DemoManifest, TRUTH_FILE, write_campaign, write_demo};
pub use error::SimulateError;
#[cfg(feature = "every-format")]
pub use golden::{assert_golden, one_field_per_line, one_tag_per_line};
pub use presets::LikeCase;
pub use samples::Samples;
#[cfg(feature = "every-format")]
pub use seeds::{Seed, seeds, tiny_flight};
pub use sensor::{Interval, SensorSettings, Wander};
pub use simulated::{FlightSettings, PathKind, SimulatedFlight, simulate};
pub use trajectory::{Motion, Trajectory};
pub use write::{BagCompression, BagSettings, Container, LogFile, McapCompression, McapEncoding, McapSettings};
#[cfg(feature = "every-format")]
pub use write::{Db3Compression, Db3Layout, Db3Settings};
