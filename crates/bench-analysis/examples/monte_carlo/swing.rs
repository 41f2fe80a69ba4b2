//! Swings with known truth, and the reference from a 2000-count encoder.

use bench_analysis::{EncoderSeries, Motion, Rig, encoder_channel, position};
use signal::CubicSpline;
use simulate::{BenchChannel, BenchSettings, BenchTruth, RigText, SimulatedBench, simulate_bench};
use std::path::Path;

/// Seconds of measured swing.
pub const SWING_S: f64 = 60.0;
/// The bar already swings before and after the measured part, in seconds: this study does not start at rest.
pub const MARGIN_S: f64 = 4.0;

/// A swing, and its encoder readings.
pub struct TrueSwing {
    truth: BenchTruth,
    /// North position of the sensor from the smoothed encoder.
    pub reference: CubicSpline,
}

impl TrueSwing {
    /// North position of the sensor, m.
    pub fn north(&self, t: f64) -> f64 {
        self.truth.value(BenchChannel::PositionIns, t)[0]
    }
}

/// Hand-driven swings of ±60° at the paper's bench.
pub fn swings(number: u64) -> Vec<TrueSwing> {
    (0..number).map(|seed| swing(crate::SEED.wrapping_add(seed))).collect()
}

fn swing(seed: u64) -> TrueSwing {
    let settings = BenchSettings { seed, swing_s: SWING_S + 2.0 * MARGIN_S, rest_s: [0.0; 2], ..BenchSettings::ins() };
    let settings = settings.only(&[BenchChannel::PositionIns]);
    let bench = simulate_bench(&settings).unwrap();
    let flight = bench.to_flight().unwrap();
    let rig = rig(&bench);
    let (name, channel) = encoder_channel(&flight, &rig).unwrap();
    let motion = Motion::of(EncoderSeries::of(name, channel, &rig).unwrap()).unwrap();
    let grid = motion.grid(motion.span(), 100.0);
    let arm = settings.lever_arm_m(BenchChannel::PositionIns);
    let azimuth = settings.bar.azimuth_rad;
    let north: Vec<f64> = grid.iter().map(|&t| position(&motion.at(t).unwrap(), azimuth, arm).value[0]).collect();
    TrueSwing { truth: bench.truth, reference: CubicSpline::new(&grid, &north).unwrap() }
}

/// The rig file of a simulated bench.
pub fn rig(bench: &SimulatedBench) -> Rig {
    let text = RigText { model: "simulated".into(), serial: "1".into(), to_be_fitted: false };
    Rig::parse(&bench.rig_text(&text), Path::new("simulated.rig.toml")).unwrap()
}
