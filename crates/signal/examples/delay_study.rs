//! Accuracy of the delay estimator: many simulated hand swings of known delay, one line of results for each kind of
//! noise, rate and timestamps. `cargo run --release -p flightlag-signal --example delay_study -- [trials] [part of a
//! case's name, or lag]`
#![allow(clippy::print_stdout, reason = "an example's output is its print")]

use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, Normal, StandardNormal};
use rand_pcg::Pcg64;
use signal::{
    CubicSpline, DelaySettings, Gain, LaggedReference, Measurement, NoiseModel, Reference, Sign, choose_lag_model,
    delay_crlb, fit_delay,
};
use std::f64::consts::TAU;

const DELAY_S: f64 = 0.4;
const ARM_M: f64 = 1.3;

/// A hand-driven swing: many sines about 0.55 Hz and a few up to 2.5 Hz, largest angle 60 degrees.
struct Swing {
    terms: Vec<(f64, f64, f64)>,
}

impl Swing {
    fn new(rng: &mut Pcg64, length_s: f64) -> Swing {
        let slow = Normal::new(0.55, 0.1).expect("a positive width");
        let rayleigh = |rng: &mut Pcg64| (-2.0 * (1.0 - rng.random::<f64>()).ln()).sqrt();
        let mut terms = vec![];
        for _ in 0..30 {
            let f: f64 = slow.sample(rng);
            terms.push((f.clamp(0.15, 1.2), rayleigh(rng), TAU * rng.random::<f64>()));
        }
        for _ in 0..30 {
            let f: f64 = 0.8 + 1.7 * rng.random::<f64>();
            terms.push((f, 0.02 * rayleigh(rng) * (0.8 / f).powi(2) * 8.0, TAU * rng.random::<f64>()));
        }
        let mut swing = Swing { terms };
        let largest = (0..(length_s / 0.01) as usize).map(|k| swing.angle(0.01 * k as f64).abs()).fold(0.0, f64::max);
        swing.terms.iter_mut().for_each(|t| t.1 *= 60f64.to_radians() / largest);
        swing
    }

    fn angle(&self, t: f64) -> f64 {
        self.terms.iter().map(|(f, a, p)| a * (TAU * f * t + p).sin()).sum()
    }

    fn position(&self, t: f64) -> f64 {
        -ARM_M * self.angle(t).sin()
    }
}

#[derive(Clone, Copy, Debug)]
enum Noise {
    Model(NoiseModel),
    /// White noise that changes four times a second and is held in between, and a random walk.
    HeldSteps {
        held: f64,
        walk: f64,
    },
    /// Random walk and white noise.
    Walk {
        walk: f64,
        white: f64,
    },
    /// Jitter of the latency (standard deviation, s), and white noise.
    Jitter {
        jitter: f64,
        white: f64,
    },
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Stamps {
    Regular,
    Jittered,
    Lost,
    JitteredAndLost,
}

struct Case {
    name: String,
    rate_hz: f64,
    length_s: f64,
    noise: Noise,
    stamps: Stamps,
}

fn stamps(case: &Case, rng: &mut Pcg64) -> Vec<f64> {
    let n = (case.length_s * case.rate_hz).round() as usize;
    let mut t = vec![];
    for k in 0..n {
        let jitter = match case.stamps {
            Stamps::Jittered | Stamps::JitteredAndLost => 0.6 * (rng.random::<f64>() - 0.5),
            _ => 0.0,
        };
        let lost = matches!(case.stamps, Stamps::Lost | Stamps::JitteredAndLost) && rng.random::<f64>() < 0.1;
        if !lost {
            t.push(3.0 + (k as f64 + jitter) / case.rate_hz);
        }
    }
    t
}

fn ou(t: &[f64], m: &NoiseModel, rng: &mut Pcg64) -> Vec<f64> {
    let mut normal = || -> f64 { StandardNormal.sample(rng) };
    let mut x = m.wander_std * normal();
    (0..t.len())
        .map(|k| {
            if k > 0 && m.wander_std > 0.0 {
                let d = (-(t[k] - t[k - 1]) / m.time_constant_s).exp();
                x = d * x + m.wander_std * (1.0 - d * d).sqrt() * normal();
            }
            x + m.white_std * normal()
        })
        .collect()
}

fn walk(t: &[f64], per_root_s: f64, rng: &mut Pcg64) -> Vec<f64> {
    let mut x = 0.0;
    (0..t.len())
        .map(|k| {
            let z: f64 = StandardNormal.sample(rng);
            x += if k > 0 { per_root_s * (t[k] - t[k - 1]).sqrt() * z } else { 0.0 };
            x
        })
        .collect()
}

fn add(a: Vec<f64>, b: Vec<f64>) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a + b).collect()
}

struct Trial {
    error: f64,
    crlb: Option<f64>,
    hessian: f64,
    hac: f64,
    se: f64,
    quantile: f64,
    milliseconds: f64,
    down: f64,
    coloured: bool,
    gain_covered: bool,
}

fn trial(case: &Case, seed: u64) -> Result<Trial, String> {
    let mut rng = Pcg64::seed_from_u64(seed);
    let swing = Swing::new(&mut rng, case.length_s + 8.0);
    let knots: Vec<f64> = (0..=((case.length_s + 6.0) * 100.0) as usize).map(|k| 0.01 * k as f64).collect();
    let reference = CubicSpline::new(&knots, &knots.iter().map(|t| swing.position(*t)).collect::<Vec<_>>())
        .map_err(|e| e.to_string())?;
    let t = stamps(case, &mut rng);
    let white = NoiseModel::white;
    let (noise, model, jitter) = match case.noise {
        Noise::Model(m) => (ou(&t, &m, &mut rng), Some(m), 0.0),
        Noise::Walk { walk: w, white: s } => (add(walk(&t, w, &mut rng), ou(&t, &white(s), &mut rng)), None, 0.0),
        Noise::HeldSteps { held, walk: w } => {
            let steps: Vec<f64> = (0..4000).map(|_| StandardNormal.sample(&mut rng)).collect();
            let stairs: Vec<f64> = t.iter().map(|t| held * steps[(t * 4.0) as usize]).collect();
            (add(stairs, walk(&t, w, &mut rng)), None, 0.0)
        }
        Noise::Jitter { jitter, white: s } => (ou(&t, &white(s), &mut rng), None, jitter),
    };
    let y: Vec<f64> = t
        .iter()
        .zip(&noise)
        .map(|(t, n)| {
            let late: f64 = if jitter > 0.0 { jitter * rng.sample::<f64, _>(StandardNormal) } else { 0.0 };
            swing.position(t - DELAY_S - late) + 2.0 + n
        })
        .collect();
    let measurement =
        Measurement { t: &t, y: &y, reference: &reference, gain: Gain::Free { sign: Sign::Positive }, drift: false };
    let start = std::time::Instant::now();
    let fit = fit_delay(&[measurement], &DelaySettings::default()).map_err(|e| e.to_string())?;
    let milliseconds = start.elapsed().as_secs_f64() * 1e3;
    let _ = reference.span();
    Ok(Trial {
        error: fit.delay_s - DELAY_S,
        crlb: model.and_then(|m| delay_crlb(&t, &reference, DELAY_S, 1.0, &m, false)),
        hessian: fit.hessian_s,
        hac: fit.hac_s,
        se: fit.standard_uncertainty_s,
        quantile: signal::student_quantile(0.975, fit.degrees_of_freedom),
        milliseconds,
        down: fit.downweighted_share,
        coloured: fit.components[0].noise.wander_std > 0.0,
        gain_covered: (fit.components[0].gain.value - 1.0).abs() <= 1.97 * fit.components[0].gain.standard_uncertainty,
    })
}

fn cases() -> Vec<Case> {
    let mut cases = vec![];
    let kinds = [
        ("white .1", Noise::Model(NoiseModel::white(0.1))),
        ("OU .1/.5s+.02", Noise::Model(NoiseModel { wander_std: 0.1, time_constant_s: 0.5, white_std: 0.02 })),
        ("OU .5/20s+.05", Noise::Model(NoiseModel { wander_std: 0.5, time_constant_s: 20.0, white_std: 0.05 })),
    ];
    for rate_hz in [4.0, 10.0, 50.0, 100.0] {
        for (noise_name, noise) in kinds {
            for stamps in [Stamps::Regular, Stamps::Jittered, Stamps::Lost] {
                let name = format!("{rate_hz}Hz {noise_name} {stamps:?}");
                cases.push(Case { name, rate_hz, length_s: 60.0, noise, stamps });
            }
        }
    }
    let mut other = |name: &str, rate_hz: f64, length_s: f64, noise: Noise, stamps: Stamps| {
        cases.push(Case { name: name.into(), rate_hz, length_s, noise, stamps });
    };
    for rate in [4.0, 10.0, 50.0, 100.0] {
        let name = |what: &str| format!("mismatch {rate}Hz {what}");
        if rate > 4.0 {
            other(&name("held4 .1+walk .05"), rate, 60.0, Noise::HeldSteps { held: 0.1, walk: 0.05 }, Stamps::Regular);
        }
        other(&name("walk .2+.05"), rate, 60.0, Noise::Walk { walk: 0.2, white: 0.05 }, Stamps::Jittered);
        other(&name("walk .2"), rate, 60.0, Noise::Walk { walk: 0.2, white: 0.0 }, Stamps::Regular);
        other(&name("jitter 20ms+.01"), rate, 60.0, Noise::Jitter { jitter: 0.02, white: 0.01 }, Stamps::Regular);
        other(&name("jitter 5ms+.01"), rate, 60.0, Noise::Jitter { jitter: 0.005, white: 0.01 }, Stamps::Regular);
    }
    for rate in [4.0, 10.0] {
        let model = |wander_std, time_constant_s, white_std| {
            Noise::Model(NoiseModel { wander_std, time_constant_s, white_std })
        };
        other(&format!("hard {rate}Hz white 1"), rate, 60.0, model(0.0, 1.0, 1.0), Stamps::JitteredAndLost);
        other(&format!("hard {rate}Hz OU 2/20s+.1"), rate, 60.0, model(2.0, 20.0, 0.1), Stamps::JitteredAndLost);
        other(&format!("hard {rate}Hz 10s white .1"), rate, 10.0, model(0.0, 1.0, 0.1), Stamps::Regular);
    }
    for rate in [4.0, 10.0, 100.0] {
        let model = |wander_std, time_constant_s, white_std| {
            Noise::Model(NoiseModel { wander_std, time_constant_s, white_std })
        };
        let name = |what: &str| format!("short {rate}Hz {what}");
        other(&name("20s white .3"), rate, 20.0, model(0.0, 1.0, 0.3), Stamps::JitteredAndLost);
        other(&name("20s OU .3/3+.1"), rate, 20.0, model(0.3, 3.0, 0.1), Stamps::JitteredAndLost);
        other(&name("30s OU .3/3+.1"), rate, 30.0, model(0.3, 3.0, 0.1), Stamps::Jittered);
        other(&name("60s OU .3/1+.1"), rate, 60.0, model(0.3, 1.0, 0.1), Stamps::JitteredAndLost);
        other(&name("60s OU 1/30+.2"), rate, 60.0, model(1.0, 30.0, 0.2), Stamps::Jittered);
    }
    cases
}

/// Truths of design note 3.6: delay and lags, and the correct model names.
const LATENESSES: [(f64, [f64; 2], &str); 5] = [
    (0.4, [0.0, 0.0], "D"),
    (0.0, [0.4, 0.0], "L"),
    (0.3, [0.1, 0.0], "DL"),
    (0.2, [0.2, 0.0], "DL"),
    (0.0, [0.2, 0.2], "DLL"),
];

/// How often the kind of lateness is identified, undecided, or wrong.
fn lag_study(trials: u64) {
    println!(
        "{:18} {:>6} {:>6} {:>6} {:>6} | best by BIC: D L DL DLL | coverage of sum, delay, first lag | ms",
        "truth", "rate", "right", "open", "wrong"
    );
    for (number, (rate_hz, sigma)) in [(4.0, 0.1), (4.0, 0.02), (100.0, 0.1), (100.0, 0.02)].into_iter().enumerate() {
        for (which, (delay, lags, right)) in LATENESSES.into_iter().enumerate() {
            let (mut right_model, mut open, mut best) = (0, 0, [0; 4]);
            let mut covered = [0; 3];
            let mut ms = 0.0;
            for s in 0..trials {
                let mut rng = Pcg64::seed_from_u64(((number * 5 + which) * 100_000) as u64 + s);
                let swing = Swing::new(&mut rng, 68.0);
                let grid: Vec<f64> = (0..=14_000).map(|k| -4.0 + 0.005 * k as f64).collect();
                let truth =
                    CubicSpline::new(&grid, &grid.iter().map(|t| swing.position(*t)).collect::<Vec<_>>()).unwrap();
                let slow = LaggedReference::new(&truth, &lags, 0.001).unwrap();
                let knots: Vec<f64> = (0..=6600).map(|k| 0.01 * k as f64).collect();
                let reference =
                    CubicSpline::new(&knots, &knots.iter().map(|t| swing.position(*t)).collect::<Vec<_>>()).unwrap();
                let t: Vec<f64> = (0..(60.0 * rate_hz) as usize).map(|k| 3.0 + k as f64 / rate_hz).collect();
                let y: Vec<f64> = t
                    .iter()
                    .map(|t| slow.value_and_rate(t - delay).0 + 2.0 + sigma * rng.sample::<f64, _>(StandardNormal))
                    .collect();
                let m = Measurement {
                    t: &t,
                    y: &y,
                    reference: &reference,
                    gain: Gain::Free { sign: Sign::Positive },
                    drift: false,
                };
                let settings = DelaySettings::default();
                let fit = fit_delay(&[m], &settings).unwrap();
                let start = std::time::Instant::now();
                let choice = choose_lag_model(&[m], &fit, &settings);
                ms += start.elapsed().as_secs_f64() * 1e3 / trials as f64;
                match choice.chosen {
                    Some(model) if model.name() == right => right_model += 1,
                    None => open += 1,
                    _ => {}
                }
                best[["D", "L", "DL", "DLL"].iter().position(|n| *n == choice.candidates[0].model.name()).unwrap()] +=
                    1;
                let of_truth = choice.candidates.iter().find(|c| c.model.name() == right).unwrap();
                let inside =
                    |u: signal::Uncertain, v: f64| usize::from((u.value - v).abs() < 1.96 * u.standard_uncertainty);
                covered[0] += inside(of_truth.sum_s, delay + lags[0] + lags[1]);
                covered[1] += of_truth.delay_s.map_or(1, |d| inside(d, delay));
                covered[2] += of_truth.lags_s.first().map_or(1, |d| inside(*d, lags[0]));
            }
            let percent = |k: usize| 100.0 * k as f64 / trials as f64;
            println!(
                "{:18} {rate_hz:6} {:6.1} {:6.1} {:6.1} | {best:?} | {:.1} {:.1} {:.1} | {ms:.1}   (noise {sigma} m)",
                format!("{delay} + {lags:?}"),
                percent(right_model),
                percent(open),
                percent(trials as usize - right_model - open),
                percent(covered[0]),
                percent(covered[1]),
                percent(covered[2])
            );
        }
    }
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let trials: u64 = arguments.get(1).and_then(|a| a.parse().ok()).unwrap_or(400);
    let part = arguments.get(2).cloned().unwrap_or_default();
    if part == "lag" {
        return lag_study(trials);
    }
    println!(
        "{:32} {:>8} {:>8} {:>7} {:>6} {:>6} {:>6} {:>6} {:>6} {:>6} {:>6} {:>6} {:>5} {:>6} {:>6}",
        "case",
        "CRLB ms",
        "rms ms",
        "rms/C",
        "bias/C",
        "se/rms",
        "he/rms",
        "ha/rms",
        "cov",
        "covHe",
        "covHA",
        "ms",
        "down",
        "colour",
        "covGn"
    );
    for (number, case) in cases().iter().enumerate().filter(|(_, c)| c.name.contains(&part)) {
        let all: Vec<Result<Trial, String>> = (0..trials).map(|s| trial(case, 1_000_000 * number as u64 + s)).collect();
        let failed = all.iter().filter(|t| t.is_err()).count();
        let good: Vec<Trial> = all.into_iter().flatten().collect();
        let n = good.len() as f64;
        let mean = |f: &dyn Fn(&Trial) -> f64| good.iter().map(f).sum::<f64>() / n;
        let rms = mean(&|t| t.error * t.error).sqrt();
        let ratio = mean(&|t| (t.error / t.crlb.unwrap_or(f64::NAN)).powi(2)).sqrt();
        let bias = mean(&|t| t.error / t.crlb.unwrap_or(t.se));
        let covered =
            |f: &dyn Fn(&Trial) -> f64| 100.0 * mean(&|t| f64::from(u8::from(t.error.abs() <= t.quantile * f(t))));
        let crlb = mean(&|t| t.crlb.unwrap_or(f64::NAN).powi(2)).sqrt() * 1e3;
        let mean_square = |f: &dyn Fn(&Trial) -> f64| mean(&|t| f(t).powi(2)).sqrt() / rms;
        println!(
            "{:32} {:8.3} {:8.3} {:7.3} {:6.2} {:6.3} {:6.3} {:6.3} {:6.1} {:6.1} {:6.1} {:6.2} {:5.2} {:6.2} {:6.1} {}",
            case.name,
            crlb,
            rms * 1e3,
            ratio,
            bias,
            mean_square(&|t| t.se),
            mean_square(&|t| t.hessian),
            mean_square(&|t| t.hac),
            covered(&|t| t.se),
            covered(&|t| t.hessian),
            covered(&|t| t.hac),
            mean(&|t| t.milliseconds),
            mean(&|t| t.down),
            mean(&|t| f64::from(u8::from(t.coloured))),
            100.0 * mean(&|t| f64::from(u8::from(t.gain_covered))),
            if failed > 0 { format!("{failed} failed") } else { String::new() }
        );
    }
}
