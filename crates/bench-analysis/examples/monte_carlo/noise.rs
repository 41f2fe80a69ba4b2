//! Noise of every kind, drawn at any timestamps.

use rand::{Rng, RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

/// A generator for one trial of one case.
pub fn generator(case: &str, trial: u64) -> Pcg64 {
    let tag = case.bytes().fold(crate::SEED, |hash, b| (hash ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3));
    Pcg64::seed_from_u64(tag ^ trial.wrapping_mul(0x9e37_79b9_7f4a_7c15))
}

fn normal(random: &mut impl Rng) -> f64 {
    StandardNormal.sample(random)
}

/// Kinds of noise.
#[derive(Clone, Copy)]
pub enum Noise {
    /// Ornstein–Uhlenbeck of `std` and `time_constant_s`, plus white.
    WanderAndWhite { std: f64, time_constant_s: f64, white: f64 },
    /// A random walk, m/√s, plus white.
    Walk { per_root_s: f64, white: f64 },
    /// White, but held for `hold_s`, plus a random walk and a little white.
    Held { std: f64, hold_s: f64, per_root_s: f64, white: f64 },
    /// Student's t with three degrees of freedom.
    HeavyTails { scale: f64 },
}

impl Noise {
    pub fn white(std: f64) -> Noise {
        Noise::WanderAndWhite { std: 0.0, time_constant_s: 1.0, white: std }
    }

    pub fn draw(&self, t: &[f64], random: &mut impl Rng) -> Vec<f64> {
        match *self {
            Noise::WanderAndWhite { std, time_constant_s, white } => {
                let mut state = std * normal(random);
                let mut last = t[0];
                t.iter()
                    .map(|&t| {
                        let phi = (-(t - last) / time_constant_s).exp();
                        state = phi * state + std * (1.0 - phi * phi).sqrt() * normal(random);
                        last = t;
                        state + white * normal(random)
                    })
                    .collect()
            }
            Noise::Walk { per_root_s, white } => walk(t, per_root_s, white, random),
            Noise::Held { std, hold_s, per_root_s, white } => {
                let steps = walk(t, per_root_s, white, random);
                let (mut block, mut value) = (f64::NEG_INFINITY, 0.0);
                let held = t.iter().map(|t| {
                    if (t / hold_s).floor() > block {
                        block = (t / hold_s).floor();
                        value = std * normal(random);
                    }
                    value
                });
                held.zip(steps).map(|(a, b)| a + b).collect()
            }
            Noise::HeavyTails { scale } => t
                .iter()
                .map(|_| {
                    let chi2: f64 = (0..3).map(|_| normal(random).powi(2)).sum();
                    scale * normal(random) / (chi2 / 3.0).sqrt()
                })
                .collect(),
        }
    }
}

fn walk(t: &[f64], per_root_s: f64, white: f64, random: &mut impl Rng) -> Vec<f64> {
    let (mut sum, mut last) = (0.0, t[0]);
    t.iter()
        .map(|&t| {
            sum += per_root_s * (t - last).sqrt() * normal(random);
            last = t;
            sum + white * normal(random)
        })
        .collect()
}

/// How samples are taken.
#[derive(Clone, Copy, PartialEq)]
pub enum Sampling {
    Regular,
    /// Timestamps are known, but irregular by ±30 % of the interval.
    Jitter,
    /// One in ten samples is lost.
    Lossy,
}

impl Sampling {
    pub const ALL: [Sampling; 3] = [Sampling::Regular, Sampling::Jitter, Sampling::Lossy];

    pub fn name(self) -> &'static str {
        match self {
            Sampling::Regular => "regular",
            Sampling::Jitter => "±30 % jitter",
            Sampling::Lossy => "10 % lost",
        }
    }

    pub fn stamps(self, from: f64, seconds: f64, rate_hz: f64, random: &mut impl Rng) -> Vec<f64> {
        let n = (seconds * rate_hz).round() as usize;
        (0..n)
            .filter_map(|k| {
                let uniform: f64 = random.random();
                let even = from + k as f64 / rate_hz;
                match self {
                    Sampling::Regular => Some(even),
                    Sampling::Jitter => Some(even + 0.6 * (uniform - 0.5) / rate_hz),
                    Sampling::Lossy => (uniform >= 0.1).then_some(even),
                }
            })
            .collect()
    }
}
