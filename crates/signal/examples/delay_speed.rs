//! Time of one fit on one core: 60 s at 100 Hz, median over fifty records. Needs Linux.
//! `cargo run --release -p flightlag-signal --example delay_speed`
#![allow(clippy::print_stdout, clippy::unwrap_used, reason = "an example's output is its print")]

use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use signal::{CubicSpline, DelaySettings, Gain, Measurement, Sign, choose_lag_model, fit_delay, median_in_place};
use std::f64::consts::TAU;

fn position(t: f64) -> f64 {
    0.9 * (TAU * 0.53 * t).sin() + 0.25 * (TAU * 0.81 * t + 0.7).sin() + 0.1 * (TAU * 1.37 * t - 1.1).sin()
}

/// Timestamps (regular, or each up to 30 % of an interval off) and values with a wander of `wander` m and 0.5 s.
fn record(seed: u64, jitter: f64, wander: f64) -> (Vec<f64>, Vec<f64>) {
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut x = 0.0;
    let mut row = |k: i32| {
        let normal = |rng: &mut Pcg64| rng.sample::<f64, _>(StandardNormal);
        let t = 3.0 + 0.01 * (f64::from(k) + jitter * (rng.random::<f64>() - 0.5));
        x += -0.02 * x + 0.2 * wander * normal(&mut rng);
        (t, position(t - 0.4) + x + 0.05 * normal(&mut rng))
    };
    (0..6000).map(&mut row).unzip()
}

/// CPU time of this process in milliseconds, which is nearly independent of other load on the machine.
fn core_ms() -> f64 {
    let text = std::fs::read_to_string("/proc/self/schedstat").unwrap();
    text.split(' ').next().unwrap().parse::<f64>().unwrap() * 1e-6
}

fn main() {
    let knots: Vec<f64> = (0..6700).map(|k| 0.01 * f64::from(k)).collect();
    let reference = CubicSpline::new(&knots, &knots.iter().map(|t| position(*t)).collect::<Vec<_>>()).unwrap();
    let settings = DelaySettings::default();
    let cases = [
        ("regular, white", 0.0, 0.0),
        ("regular, wander", 0.0, 0.1),
        ("jittered, white", 0.6, 0.0),
        ("jittered, wander", 0.6, 0.1),
    ];
    for (name, jitter, wander) in cases {
        let (mut fits, mut lags) = (vec![], vec![]);
        for seed in 0..50 {
            let (t, y) = record(seed, jitter, wander);
            let gain = Gain::Free { sign: Sign::Positive };
            let m = [Measurement { t: &t, y: &y, reference: &reference, gain, drift: false }];
            let start = core_ms();
            let fit = fit_delay(&m, &settings).unwrap();
            fits.push(core_ms() - start);
            if seed < 10 {
                let start = core_ms();
                assert!(!choose_lag_model(&m, &fit, &settings).candidates.is_empty());
                lags.push(core_ms() - start);
            }
        }
        let mean = fits.iter().sum::<f64>() / fits.len() as f64;
        let least = fits.iter().copied().fold(f64::INFINITY, f64::min);
        let (fit, lag) = (median_in_place(&mut fits).unwrap(), median_in_place(&mut lags).unwrap());
        println!("{name:18} fit {fit:6.2} ms (mean {mean:5.2}, least {least:5.2}), delay or lag {lag:6.1} ms");
    }
}
