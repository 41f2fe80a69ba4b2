//! Speed of each compensator: one hour at 100 Hz, velocity and position at every sample, on one core.
//!
//! `cargo run --release -p flightlag-compensation-replay --example compensator_speed`

#![allow(clippy::print_stdout)]

use compensation_replay::{Compensator, CompensatorKind, CompensatorOptions, KalmanSettings};
use record::StartRule;
use std::hint::black_box;
use std::time::Instant;

struct Hour {
    t: Vec<f64>,
    velocity: Vec<f64>,
    position: Vec<f64>,
}

impl Hour {
    /// `jitter` seconds of timestamp noise, without structure.
    fn of(jitter: f64) -> Hour {
        let t: Vec<f64> =
            (0..360_000).map(|k| f64::from(k) * 0.01 + jitter * (f64::from(k % 9973) * 12.9898).sin()).collect();
        let velocity = t.iter().map(|t| 17.5 * (0.58 * t).cos()).collect();
        let position = t.iter().map(|t| 30.0 * (0.58 * (t - 0.4)).sin()).collect();
        Hour { t, velocity, position }
    }

    /// Sum of the outputs, so that nothing is optimised away.
    fn fly(&self, compensator: &mut dyn Compensator) -> f64 {
        compensator.start(self.t[0], self.velocity[0], StartRule::Warm).unwrap();
        let mut sum = 0.0;
        for ((&t, &v), &p) in self.t.iter().zip(&self.velocity).zip(&self.position).skip(1) {
            compensator.velocity(t, v).unwrap();
            compensator.position(t, p).unwrap();
            sum += compensator.output(t).unwrap();
        }
        sum
    }
}

/// CPU time so far, s: of this process alone if Linux reports it, else wall clock since `begin`.
fn core_time(begin: Instant) -> f64 {
    let of_process = std::fs::read_to_string("/proc/self/schedstat").ok();
    let nanoseconds = of_process.and_then(|text| text.split(' ').next()?.parse::<f64>().ok());
    nanoseconds.map_or_else(|| begin.elapsed().as_secs_f64(), |ns| ns * 1e-9)
}

/// Million samples per second over at least half a second; the system counts in ticks of 4 ms.
fn speed(kind: CompensatorKind, hour: &Hour) -> f64 {
    let kalman = Some(KalmanSettings::circuit(0.1, 0.1));
    let options = CompensatorOptions { kalman, ..CompensatorOptions::new(0.4, 0.01) };
    let mut compensator = kind.build(&options).unwrap();
    let begin = Instant::now();
    let (before, mut samples, mut spent) = (core_time(begin), 0, 0.0);
    while spent < 0.5 {
        black_box(hour.fly(compensator.as_mut()));
        samples += hour.t.len();
        spent = core_time(begin) - before;
    }
    samples as f64 / spent * 1e-6
}

fn main() {
    let (even, uneven) = (Hour::of(0.0), Hour::of(2e-3));
    println!("million samples a second (velocity, position and output each): even stamps, stamps with 2 ms of jitter");
    for kind in CompensatorKind::all().into_iter().filter(|k| k.causal()) {
        println!("{:20}{:8.1}{:8.1}", kind.to_string(), speed(kind, &even), speed(kind, &uneven));
    }
}
