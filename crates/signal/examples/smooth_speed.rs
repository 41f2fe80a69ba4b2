//! Run time of the smoother: medians over repeats, one core. `cargo run --release -p flightlag-signal --example
//! smooth_speed`
#![allow(clippy::print_stdout)]

use std::time::Instant;

/// Median time in milliseconds.
fn median_ms(repeats: usize, mut work: impl FnMut()) -> f64 {
    let mut times: Vec<f64> = (0..repeats)
        .map(|_| {
            let start = Instant::now();
            work();
            start.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    times.sort_unstable_by(f64::total_cmp);
    times[repeats / 2]
}

/// A bar swung by hand, read by an encoder of 2000 counts.
fn counts(t: &[f64]) -> Vec<f64> {
    let lsb = std::f64::consts::TAU / 2000.0;
    t.iter().map(|t| ((3.1 * t).sin() + 0.05 * (10.7 * t + 0.3).sin()) / lsb).map(|n| n.round() * lsb).collect()
}

fn main() {
    let samples = 60_000;
    let variance = (std::f64::consts::TAU / 2000.0).powi(2) / 12.0;
    println!("{samples} samples                        smooth once   q by GCV   both (ms)");
    for rate in [100.0, 1000.0] {
        for (name, jitter) in [("regular", 0.0), ("jitter 10 %", 0.1)] {
            let t: Vec<f64> =
                (0..samples).map(|k| (f64::from(k) + jitter * (f64::from(k) * 12.9898).sin()) / rate).collect();
            let z = counts(&t);
            let smoother = signal::Smoother::default();
            let log10_q = smoother.log10_q_by_gcv(&t, &z, variance).expect("a good record");
            let once = median_ms(15, || drop(smoother.smooth(&t, &z, variance, log10_q)));
            let search = median_ms(7, || drop(smoother.log10_q_by_gcv(&t, &z, variance)));
            let both = median_ms(7, || drop(smoother.smooth_by_gcv(&t, &z, variance)));
            println!("{rate:6} Hz, {name:12} log10 q {log10_q:6.2}  {once:11.2} {search:10.2} {both:10.2}");
        }
    }
}
