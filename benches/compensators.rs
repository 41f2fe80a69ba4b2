//! Samples per second of each compensator: ten minutes at 100 Hz, one velocity, position and output per sample.

use compensation_replay::{CompensatorKind, CompensatorOptions, KalmanSettings};
use divan::Bencher;
use divan::counter::ItemsCount;
use record::StartRule;

fn main() {
    divan::main();
}

const SAMPLES: u32 = 60_000;

#[divan::bench(args = CompensatorKind::all().into_iter().filter(|k| k.causal()))]
fn ten_minutes(bencher: Bencher, kind: &CompensatorKind) {
    let options =
        CompensatorOptions { kalman: Some(KalmanSettings::circuit(0.1, 0.1)), ..CompensatorOptions::new(0.4, 0.01) };
    let mut compensator = kind.build(&options).unwrap();
    let sample = |k: u32| {
        let t = f64::from(k) * 0.01;
        (t, 17.5 * (0.58 * t).cos(), 30.0 * (0.58 * (t - 0.4)).sin())
    };
    let samples: Vec<(f64, f64, f64)> = (0..SAMPLES).map(sample).collect();
    bencher.counter(ItemsCount::new(SAMPLES)).bench_local(|| {
        let (t, v, _) = samples[0];
        compensator.start(t, v, StartRule::Warm).unwrap();
        let mut sum = 0.0;
        for &(t, v, p) in &samples[1..] {
            compensator.velocity(t, v).unwrap();
            compensator.position(t, p).unwrap();
            sum += compensator.output(t).unwrap();
        }
        sum
    });
}
