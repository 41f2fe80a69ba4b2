//! Accuracy of the smoother's acceleration of a bar from a coarse encoder: simulated motion with exact derivatives,
//! seeded.

use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64;
use signal::{SmoothedMotion, smooth, smooth_by_gcv};
use std::f64::consts::{PI, TAU};

const GRAVITY: f64 = 9.80665;
const LENGTH: f64 = 1.3;
const DURATION: f64 = 60.0;

/// A motion on a grid of 1 ms: angle, rate, acceleration.
struct Truth(Vec<[f64; 3]>);

/// A hanging bar pushed by hand once per half swing, about 60° wide: the pendulum's equation by Runge and Kutta, its
/// acceleration from the equation itself.
fn pushed_pendulum(seed: u64) -> Truth {
    let mut random = Pcg64::seed_from_u64(seed);
    let half_swing = PI * (LENGTH / GRAVITY).sqrt() * 1.07;
    let normal = |mean: f64, deviation: f64| Normal::new(mean, deviation).unwrap();
    let pushes: Vec<[f64; 3]> = (0..)
        .map(|k| (k, 0.2 + f64::from(k) * half_swing))
        .take_while(|(_, t)| *t < DURATION)
        .map(|(k, t)| {
            let strength = normal(1.35, 0.35).sample(&mut random) * if k % 2 == 0 { -1.0 } else { 1.0 };
            [t + normal(0.0, 0.05).sample(&mut random), strength, random.random_range(0.35..0.6)]
        })
        .collect();
    let mut scale = 1.0;
    let mut truth = swung(&pushes, scale);
    for _ in 0..12 {
        let widest = truth.0.iter().map(|x| x[0].abs()).fold(0.0, f64::max);
        scale *= (60f64.to_radians() / widest).clamp(0.5, 2.0).powf(0.8);
        truth = swung(&pushes, scale);
    }
    truth
}

fn swung(pushes: &[[f64; 3]], scale: f64) -> Truth {
    let h = 1e-3;
    let samples = (DURATION / h) as usize;
    let mut push = vec![0.0; 2 * samples + 3];
    for [start, strength, width] in pushes {
        let first = (start.max(0.0) / h * 2.0).ceil() as usize;
        for (k, push) in push.iter_mut().enumerate().skip(first).take((width / h * 2.0) as usize) {
            *push += scale * strength * (PI * (k as f64 * h / 2.0 - start) / width).sin().powi(4);
        }
    }
    let acceleration = |x: f64, v: f64, u: f64| -GRAVITY / LENGTH * x.sin() - 0.12 * v + u;
    let (mut x, mut v) = (0.3, 0.0);
    let rows = (0..samples).map(|k| {
        let row = [x, v, acceleration(x, v, push[2 * k])];
        let (u1, u2) = (push[2 * k + 1], push[2 * k + 2]);
        let (x1, v1) = (v, row[2]);
        let (x2, v2) = (v + 0.5 * h * v1, acceleration(x + 0.5 * h * x1, v + 0.5 * h * v1, u1));
        let (x3, v3) = (v + 0.5 * h * v2, acceleration(x + 0.5 * h * x2, v + 0.5 * h * v2, u1));
        let (x4, v4) = (v + h * v3, acceleration(x + h * x3, v + h * v3, u2));
        x += h / 6.0 * (x1 + 2.0 * x2 + 2.0 * x3 + x4);
        v += h / 6.0 * (v1 + 2.0 * v2 + 2.0 * v3 + v4);
        row
    });
    Truth(rows.collect())
}

/// A bar waved by hand: 30 sines about 0.5 Hz and 30 weaker ones up to 2.5 Hz, 60° wide.
fn waved_bar(seed: u64) -> Truth {
    let mut random = Pcg64::seed_from_u64(seed);
    let rayleigh = |random: &mut Pcg64| (-2.0 * (1.0 - random.random::<f64>()).ln()).sqrt();
    let slow: Normal<f64> = Normal::new(0.5, 0.12).unwrap();
    let sines: Vec<[f64; 3]> = (0..60)
        .map(|k| {
            let frequency: f64 =
                if k < 30 { slow.sample(&mut random).clamp(0.15, 1.2) } else { random.random_range(0.8..2.5) };
            let weight = if k < 30 { 1.0 } else { 0.16 * (0.8_f64 / frequency).powi(2) };
            [TAU * frequency, weight * rayleigh(&mut random), random.random_range(0.0..TAU)]
        })
        .collect();
    let at = |t: f64| {
        sines.iter().fold([0.0; 3], |[x, v, a], [w, amplitude, phase]| {
            let (sine, cosine) = (w * t + phase).sin_cos();
            [x + amplitude * sine, v + amplitude * w * cosine, a - amplitude * w * w * sine]
        })
    };
    let rows: Vec<[f64; 3]> = (0..(DURATION * 1e3) as usize).map(|k| at(k as f64 * 1e-3)).collect();
    let widest = rows.iter().map(|x| x[0].abs()).fold(0.0, f64::max);
    Truth(rows.iter().map(|x| x.map(|x| x * 60f64.to_radians() / widest)).collect())
}

/// Smoothed encoder readings, and the true states at their timestamps.
fn smoothed(truth: &Truth, counts: f64, every: usize) -> (SmoothedMotion, Vec<[f64; 3]>) {
    let lsb = TAU / counts;
    let states: Vec<[f64; 3]> = truth.0.iter().step_by(every).copied().collect();
    let t: Vec<f64> = (0..states.len()).map(|k| (k * every) as f64 * 1e-3).collect();
    (smooth_by_gcv(&t, &readings(&states, counts), lsb * lsb / 12.0).unwrap(), states)
}

/// Readings of an encoder with this many counts, its zero somewhere within a count.
fn readings(states: &[[f64; 3]], counts: f64) -> Vec<f64> {
    let lsb = TAU / counts;
    states.iter().map(|x| ((x[0] + 0.37 * lsb) / lsb).round() * lsb - 0.37 * lsb).collect()
}

/// Rows excluding one second at each end.
fn inner(motion: &SmoothedMotion, every: usize) -> std::ops::Range<usize> {
    let second = 1000 / every;
    second..motion.t.len() - second
}

/// L · rms of the error of the acceleration, m/s², excluding one second at each end.
fn acceleration_error(motion: &SmoothedMotion, states: &[[f64; 3]], every: usize) -> f64 {
    let rows = inner(motion, every);
    let squares: f64 = rows.clone().map(|k| (motion.state[k][2] - states[k][2]).powi(2)).sum();
    LENGTH * (squares / rows.len() as f64).sqrt()
}

/// That error for each of six seeds.
fn acceleration_errors(motion: fn(u64) -> Truth, counts: f64, every: usize) -> Vec<f64> {
    (0..6)
        .map(|seed| {
            let (motion, states) = smoothed(&motion(seed), counts, every);
            acceleration_error(&motion, &states, every)
        })
        .collect()
}

/// Goal of the design note: mean at most `mean` over motions; a single one is allowed a fifth more. Observed: 0.101 and
/// 0.079 m/s² (2000 counts), 0.047 and 0.030 m/s² (8000), single motions within 20 %.
fn assert_at_most(errors: &[f64], mean: f64) {
    let found = errors.iter().sum::<f64>() / errors.len() as f64;
    assert!(found <= mean && errors.iter().all(|&e| e <= 1.2 * mean), "mean {found} of {errors:?}, goal {mean}");
    assert!(found > 0.2 * mean, "too good to be true: {errors:?}");
}

#[test]
fn the_acceleration_of_a_pushed_pendulum_is_known_to_0_1_m_per_s2() {
    assert_at_most(&acceleration_errors(pushed_pendulum, 2000.0, 10), 0.12);
}

#[test]
fn the_acceleration_of_a_waved_bar_is_known_to_0_1_m_per_s2() {
    assert_at_most(&acceleration_errors(waved_bar, 2000.0, 10), 0.12);
}

#[test]
fn four_times_the_counts_halve_the_error_of_the_acceleration() {
    assert_at_most(&acceleration_errors(pushed_pendulum, 8000.0, 10), 0.05);
    assert_at_most(&acceleration_errors(waved_bar, 8000.0, 10), 0.05);
}

#[test]
fn a_thousand_readings_a_second_reduce_the_error() {
    assert_at_most(&acceleration_errors(pushed_pendulum, 2000.0, 1), 0.06);
}

/// Rounding is not white, and a hand is smoother than white snap: the stated deviation is an upper bound in practice.
/// Observed over 24 records: error over stated 0.56 to 1.02 (angle), 0.56 to 0.96 (rate), 0.41 to 0.83 (acceleration).
#[test]
fn the_stated_uncertainty_is_slightly_above_the_actual_error() {
    for motion in [pushed_pendulum as fn(u64) -> Truth, waved_bar] {
        for (seed, counts, every) in [(0, 2000.0, 10), (1, 8000.0, 10), (2, 2000.0, 1)] {
            let (motion, states) = smoothed(&motion(seed), counts, every);
            for (i, gate) in [(0, 0.5..1.15), (1, 0.5..1.1), (2, 0.35..0.95)] {
                let rows = inner(&motion, every);
                let share = |k: usize| (motion.state[k][i] - states[k][i]) / motion.standard_deviation(k)[i];
                let ratio = (rows.clone().map(|k| share(k).powi(2)).sum::<f64>() / rows.len() as f64).sqrt();
                assert!(gate.contains(&ratio), "derivative {i}, seed {seed}, {counts} counts: {ratio}");
            }
        }
    }
}

/// Compared with the best q in hindsight, on a grid of half decades. Observed over 24 records: 1.00 to 1.32 (design
/// note: 1.00 to 1.27).
#[test]
fn the_q_of_cross_validation_is_nearly_as_good_as_the_best_q() {
    for (motion, gate) in [(pushed_pendulum as fn(u64) -> Truth, 1.1), (waved_bar, 1.35)] {
        for counts in [2000.0, 8000.0] {
            let (found, states) = smoothed(&motion(1), counts, 10);
            let variance = (TAU / counts).powi(2) / 12.0;
            let z = readings(&states, counts);
            let best = (-6..=4)
                .map(|half_decades| {
                    let log10_q = found.log10_q + 0.5 * f64::from(half_decades);
                    acceleration_error(&smooth(&found.t, &z, variance, log10_q).unwrap(), &states, 10)
                })
                .fold(f64::INFINITY, f64::min);
            let ratio = acceleration_error(&found, &states, 10) / best;
            assert!((0.9..gate).contains(&ratio), "{ratio} at {counts} counts");
        }
    }
}

/// Ten counts at 1 kHz: each value is held for 30 samples or more. A smoother that takes the readings as independent
/// follows each step: its acceleration is wrong by 100 times the acceleration itself.
#[test]
fn a_motion_of_a_few_counts_is_not_tracked_step_by_step() {
    let (lsb, omega) = (TAU / 2000.0, PI);
    for (rate, amplitude) in [(100.0, 0.01), (1000.0, 0.03), (1000.0, 0.1), (4000.0, 0.1)] {
        let t: Vec<f64> = (0..(20.0 * rate) as usize).map(|k| k as f64 / rate).collect();
        let z: Vec<f64> = t.iter().map(|t| (amplitude * (omega * t).sin() / lsb).round() * lsb).collect();
        let motion = smooth_by_gcv(&t, &z, lsb * lsb / 12.0).unwrap();
        for k in (0..t.len()).skip(rate as usize).step_by(7).take_while(|k| t[*k] < 19.0) {
            let truth = -amplitude * omega * omega * (omega * t[k]).sin();
            let error = motion.state[k][2] - truth;
            assert!(error.abs() < 0.05 * amplitude * omega * omega, "{error} at {} s, {rate} Hz, {amplitude}", t[k]);
            assert!(error.abs() < 3.0 * motion.standard_deviation(k)[2]);
        }
    }
}

/// Timestamps that are all slightly off, a tenth of the samples lost, and a gap of two seconds.
#[test]
fn irregular_timestamps_and_lost_samples_only_cost_the_lost_samples() {
    let truth = waved_bar(3);
    let mut random = Pcg64::seed_from_u64(77);
    let rows: Vec<usize> = (0..truth.0.len())
        .step_by(10)
        .filter_map(|k| {
            let row = k + random.random_range(0..4);
            let kept = random.random::<f64>() > 0.1 && !(30_000..32_000).contains(&row);
            kept.then_some(row)
        })
        .collect();
    let states: Vec<[f64; 3]> = rows.iter().map(|&k| truth.0[k]).collect();
    let t: Vec<f64> = rows.iter().map(|&k| k as f64 * 1e-3).collect();
    let motion = smooth_by_gcv(&t, &readings(&states, 2000.0), (TAU / 2000.0).powi(2) / 12.0).unwrap();
    let near_hole = |k: usize| (28.5..33.5).contains(&t[k]);
    let inner: Vec<usize> = (100..t.len() - 100).filter(|&k| !near_hole(k)).collect();
    let squares: f64 = inner.iter().map(|&k| (motion.state[k][2] - states[k][2]).powi(2)).sum();
    let error = LENGTH * (squares / inner.len() as f64).sqrt();
    assert!((0.02..0.12).contains(&error), "{error}");
    // Inside the gap the motion is a guess with a correspondingly large uncertainty.
    for t in [30.5, 31.0, 31.5] {
        let miss = motion.at(t).unwrap()[0] - truth.0[(t * 1e3) as usize][0];
        let deviation = motion.covariance_at(t).unwrap()[0].sqrt();
        assert!(miss.abs() < 3.0 * deviation && deviation > 0.01, "{miss} ± {deviation} at {t} s");
    }
}
