//! A swing bench with known truth: a hand-driven bar, an encoder on its axis, a sensor at its end.
//!
//! All times derive from one true time: seconds after the start. For [`BenchSettings::rest_s`] the bar rests, then it
//! swings, then it rests again. The encoder's clock shows true time; the sensor's clock and the clock of the logger may
//! be off ([`BenchClocks`]).

mod bar;
mod bench_demo;
mod bench_samples;
mod lag;
mod logbook;
mod motion;
mod observe;
mod part;
mod quantity;
mod rig;
mod settings;
mod swing;
#[cfg(test)]
mod tests;
mod wide;

pub use bar::{Bar, FlexibleBar, Mount};
pub use bench_demo::{BenchDemo, BenchDemoRecord, write_bench_demo};
pub use bench_samples::{BenchSamples, EncoderSamples, PulseSamples, SimulatedBench};
pub use motion::{BarMotion, BenchTruth};
pub use quantity::BenchChannel;
pub use rig::RigText;
pub use settings::{
    BenchClocks, BenchSensor, BenchSettings, ClockError, Encoder, EncoderOutput, Outliers, Pulses, Site,
};
pub use swing::Swing;

use crate::error::SimulateError;

/// Swings the bar and records the encoder and the sensor.
///
/// # Errors
/// [`SimulateError::Setting`] with the first invalid setting.
pub fn simulate_bench(settings: &BenchSettings) -> Result<SimulatedBench, SimulateError> {
    settings.check()?;
    let truth = BenchTruth::new(settings)?;
    observe::observe(settings, truth)
}
