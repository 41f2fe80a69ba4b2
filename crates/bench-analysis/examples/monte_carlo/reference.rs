//! The reference motion: the remaining effect of the encoder's steps.

use crate::{Case, Group};
use crate::{known, rms};
use bench_analysis::{EncoderSeries, Motion, encoder_channel};
use rayon::prelude::*;
use simulate::{BenchSettings, SensorSettings, Swing, simulate_bench};

const LENGTH_M: f64 = 1.3;
const RECORDS: u64 = 12;

/// Errors of velocity and tangential acceleration by encoder and swing.
pub fn accuracy() -> Group {
    let cases = [
        ("hand-driven, 2000 counts, 100 Hz", Swing::hand(), 2000, 100.0, Some(0.12)),
        ("pushed pendulum, 2000 counts, 100 Hz", Swing::pushed(), 2000, 100.0, Some(0.12)),
        ("hand-driven, 8000 counts, 100 Hz", Swing::hand(), 8000, 100.0, Some(0.05)),
        ("pushed pendulum, 8000 counts, 100 Hz", Swing::pushed(), 8000, 100.0, Some(0.05)),
        ("hand-driven, 2000 counts, 1 kHz", Swing::hand(), 2000, 1000.0, None),
    ];
    let case = |(name, swing, lines, rate_hz, goal): (&str, Swing, u32, f64, Option<f64>)| {
        let errors: Vec<[f64; 2]> =
            (0..RECORDS).into_par_iter().map(|seed| errors(seed, swing, lines, rate_hz)).collect();
        let mean = |k: usize| rms(errors.iter().map(|e| e[k]));
        let error = |k: usize| rms(errors.iter().map(|e| e[k] - mean(k))) / (RECORDS as f64).sqrt();
        Case {
            name: name.to_owned(),
            trials: RECORDS,
            values: vec![known(1e3 * mean(0), 1e3 * error(0)), known(mean(1), error(1))],
            met: vec![None, goal.map(|goal| mean(1) <= goal)],
        }
    };
    Group {
        title: "Reference motion from the encoder".to_owned(),
        text: "60 s of swing to ±60°, bar of 1.3 m; rms errors of velocity and tangential acceleration against the truth, one second cut off at both ends."
            .to_owned(),
        columns: ["velocity (mm/s)", "acceleration (m/s²)"].map(str::to_owned).to_vec(),
        goals: ["", "≤ 0.12 at 2000 counts and 100 Hz; ≤ 0.05 at 8000"].map(str::to_owned).to_vec(),
        cases: cases.into_iter().map(case).collect(),
    }
}

fn errors(seed: u64, swing: Swing, lines: u32, rate_hz: f64) -> [f64; 2] {
    let mut settings = BenchSettings { seed: crate::SEED + seed, swing, rest_s: [0.0; 2], ..BenchSettings::default() };
    settings.encoder.lines = lines;
    settings.encoder.sampling = SensorSettings::clean(rate_hz);
    let bench = simulate_bench(&settings.only(&[])).unwrap();
    let flight = bench.to_flight().unwrap();
    let rig = crate::swing::rig(&bench);
    let (name, channel) = encoder_channel(&flight, &rig).unwrap();
    let motion = Motion::of(EncoderSeries::of(name, channel, &rig).unwrap()).unwrap();
    let (first, last) = motion.span();
    let inner = || motion.states().filter(|(t, _)| *t > first + 1.0 && *t < last - 1.0);
    let truth = |t: f64| bench.truth.at(t);
    [
        rms(inner().map(|(t, s)| LENGTH_M * (s.rate - truth(t).rate))),
        rms(inner().map(|(t, s)| LENGTH_M * (s.acceleration - truth(t).acceleration))),
    ]
}
