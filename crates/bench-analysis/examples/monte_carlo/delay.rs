//! The delay estimator: efficiency, coverage, held samples, false alarms.

use crate::noise::{Noise, Sampling, generator};
use crate::swing::{MARGIN_S, SWING_S, TrueSwing};
use crate::{Case, Group};
use crate::{known, rms, share};
use rand::RngExt;
use rayon::prelude::*;
use signal::{DelayFit, DelaySettings, Gain, Measurement, NoiseModel, NoiseRule, Sign, delay_crlb, fit_delay};

const TRUE_DELAY_S: f64 = 0.4;
const GAIN: f64 = 1.02;

/// One trial.
struct Trial {
    error_s: f64,
    crlb_s: Option<f64>,
    covered: bool,
}

/// Simulates a position that is `delay_s` late, and fits it.
fn fit(swing: &TrueSwing, t: &[f64], y: &[f64]) -> DelayFit {
    fit_with(swing, t, y, &DelaySettings::default())
}

fn fit_with(swing: &TrueSwing, t: &[f64], y: &[f64], settings: &DelaySettings) -> DelayFit {
    let gain = Gain::Free { sign: Sign::Positive };
    let measurement = Measurement { t, y, reference: &swing.reference, gain, drift: false };
    fit_delay(&[measurement], settings).unwrap()
}

fn measured(swing: &TrueSwing, t: &[f64], delay_s: f64, noise: Vec<f64>) -> Vec<f64> {
    t.iter().zip(noise).map(|(&t, n)| GAIN * swing.north(t - delay_s) + 0.5 + n).collect()
}

fn trials(swings: &[TrueSwing], n: u64, one: impl Fn(&TrueSwing, u64) -> Trial + Sync) -> Vec<Trial> {
    (0..n).into_par_iter().map(|trial| one(&swings[trial as usize % swings.len()], trial)).collect()
}

fn judged(fit: &DelayFit, delay_s: f64, crlb_s: Option<f64>) -> Trial {
    let [low, high] = fit.interval(0.95);
    Trial { error_s: fit.delay_s - delay_s, crlb_s, covered: (low..=high).contains(&delay_s) }
}

/// rms over CRLB, bias over CRLB, coverage on the whole grid of rates, noises and samplings.
pub fn efficiency(swings: &[TrueSwing], n: u64) -> Group {
    let noises = [
        ("white 0.1 m", Noise::white(0.1)),
        ("OU 0.3 m, 0.5 s", Noise::WanderAndWhite { std: 0.3, time_constant_s: 0.5, white: 0.02 }),
        ("OU 0.5 m, 20 s + white 0.05 m", Noise::WanderAndWhite { std: 0.5, time_constant_s: 20.0, white: 0.05 }),
    ];
    let mut cases = vec![];
    for rate_hz in [4.0, 10.0, 50.0, 100.0] {
        for (noise_name, noise) in noises {
            for sampling in Sampling::ALL {
                let name = format!("{rate_hz:.0} Hz, {noise_name}, {}", sampling.name());
                cases.push(efficiency_case(swings, n, name, rate_hz, noise, sampling));
            }
        }
    }
    Group {
        title: "Delay of a position, 60 s of hand-driven swing".to_owned(),
        text: "Position 0.4 s late, gain 1.02, offset 0.5 m, against the smoothed 2000-count encoder at 100 Hz. CRLB: \
               Cramér–Rao bound at the true noise with gain and offset unknown."
            .to_owned(),
        columns: ["CRLB (ms)", "rms/CRLB", "bias/CRLB", "coverage of 95 % (%)"].map(str::to_owned).to_vec(),
        goals: ["", "≤ 1.05", "within ±0.1", "93 to 97"].map(str::to_owned).to_vec(),
        cases,
    }
}

fn efficiency_case(swings: &[TrueSwing], n: u64, name: String, rate_hz: f64, noise: Noise, sampling: Sampling) -> Case {
    let Noise::WanderAndWhite { std, time_constant_s, white } = noise else { unreachable!("a known noise") };
    let model = NoiseModel { wander_std: std, time_constant_s, white_std: white };
    let all = trials(swings, n, |swing, trial| {
        let mut random = generator(&name, trial);
        let t = sampling.stamps(MARGIN_S, SWING_S, rate_hz, &mut random);
        let y = measured(swing, &t, TRUE_DELAY_S, noise.draw(&t, &mut random));
        let crlb = delay_crlb(&t, &swing.reference, TRUE_DELAY_S, GAIN, &model, false);
        judged(&fit(swing, &t, &y), TRUE_DELAY_S, crlb)
    });
    let m = all.len() as f64;
    let relative = || all.iter().filter_map(|t| Some(t.error_s / t.crlb_s?));
    let efficiency = rms(relative());
    let efficiency_error = efficiency / (2.0 * m).sqrt();
    let bias = relative().sum::<f64>() / m;
    let bias_error = efficiency / m.sqrt();
    let coverage = share(all.iter().filter(|t| t.covered).count(), all.len());
    let crlb_ms = 1e3 * rms(all.iter().filter_map(|t| t.crlb_s));
    Case {
        name,
        trials: n,
        met: vec![
            None,
            Some(efficiency <= 1.05 + 2.0 * efficiency_error),
            Some(bias.abs() <= 0.1 + 2.0 * bias_error),
            coverage.map(|c| {
                let slack = 2.0 * c.standard_uncertainty.unwrap_or(0.0);
                (93.0 - slack..=97.0 + slack).contains(&c.value)
            }),
        ],
        values: vec![
            Some(record::Estimate { value: crlb_ms, standard_uncertainty: None }),
            known(efficiency, efficiency_error),
            known(bias, bias_error),
            coverage,
        ],
    }
}

/// Noise outside the model.
pub fn misspecified(swings: &[TrueSwing], n: u64) -> Group {
    let held = Noise::Held { std: 0.05, hold_s: 0.25, per_root_s: 0.02, white: 0.002 };
    let cases = [
        ("50 Hz, noise held for 0.25 s and a random walk", 50.0, held, 0.0),
        ("10 Hz, random walk 0.1 m/√s", 10.0, Noise::Walk { per_root_s: 0.1, white: 0.02 }, 0.0),
        ("10 Hz, Student's t with 3 degrees of freedom", 10.0, Noise::HeavyTails { scale: 0.05 }, 0.0),
        ("100 Hz, stamps miss by up to ±10 ms, white 0.01 m", 100.0, Noise::white(0.01), 0.01),
        ("4 Hz, stamps miss by up to ±20 ms, white 0.01 m", 4.0, Noise::white(0.01), 0.02),
    ];
    let case = |(name, rate_hz, noise, jitter_s): (&str, f64, Noise, f64)| {
        let all = trials(swings, n, |swing, trial| {
            let mut random = generator(name, trial);
            let t = Sampling::Regular.stamps(MARGIN_S, SWING_S, rate_hz, &mut random);
            let true_t: Vec<f64> = t.iter().map(|t| t + jitter_s * (2.0 * random.random::<f64>() - 1.0)).collect();
            let y = measured(swing, &true_t, TRUE_DELAY_S, noise.draw(&t, &mut random));
            judged(&fit(swing, &t, &y), TRUE_DELAY_S, None)
        });
        let error = rms(all.iter().map(|t| t.error_s * 1e3));
        let coverage = share(all.iter().filter(|t| t.covered).count(), all.len());
        let covered = coverage.map(|c| c.value + 2.0 * c.standard_uncertainty.unwrap_or(0.0) >= 92.0);
        Case {
            name: name.to_owned(),
            trials: n,
            values: vec![known(error, error / (2.0 * all.len() as f64).sqrt()), coverage],
            met: vec![None, covered],
        }
    };
    Group {
        title: "The same with noise outside the model".to_owned(),
        text: "The estimator takes the noise for an Ornstein–Uhlenbeck process plus white noise; here it is neither."
            .to_owned(),
        columns: ["rms error (ms)", "coverage of 95 % (%)"].map(str::to_owned).to_vec(),
        goals: ["", "≥ 92"].map(str::to_owned).to_vec(),
        cases: cases.into_iter().map(case).collect(),
    }
}

/// A 4 Hz position held in 100 Hz rows: fitted at its updates, and as if every row were a measurement.
pub fn held(swings: &[TrueSwing], n: u64) -> Group {
    let noise = Noise::white(0.01);
    let fits: Vec<(f64, bool, f64)> = (0..n)
        .into_par_iter()
        .map(|trial| {
            let swing = &swings[trial as usize % swings.len()];
            let mut random = generator("held", trial);
            let updates = Sampling::Regular.stamps(MARGIN_S, SWING_S, 4.0, &mut random);
            let y = measured(swing, &updates, TRUE_DELAY_S, noise.draw(&updates, &mut random));
            let rows: Vec<f64> = (0..(SWING_S * 100.0) as usize).map(|k| MARGIN_S + k as f64 / 100.0).collect();
            let held: Vec<f64> = rows.iter().map(|t| y[updates.partition_point(|u| u <= t).max(1) - 1]).collect();
            let at_updates = fit(swing, &updates, &y);
            let [low, high] = at_updates.interval(0.95);
            let covered = (low..=high).contains(&TRUE_DELAY_S);
            let as_rows = DelaySettings { noise: NoiseRule::White, robust: false, ..DelaySettings::default() };
            (at_updates.delay_s, covered, fit_with(swing, &rows, &held, &as_rows).delay_s)
        })
        .collect();
    let mean = |f: &dyn Fn(&(f64, bool, f64)) -> f64| fits.iter().map(f).sum::<f64>() / fits.len() as f64;
    let spread = |f: &dyn Fn(&(f64, bool, f64)) -> f64| {
        let m = mean(f);
        rms(fits.iter().map(|x| f(x) - m)) / (fits.len() as f64).sqrt()
    };
    let updates = |x: &(f64, bool, f64)| 1e3 * x.0;
    let rows = |x: &(f64, bool, f64)| 1e3 * x.2;
    let case = Case {
        name: "4 Hz position held in 100 Hz rows, white 0.01 m".to_owned(),
        trials: n,
        values: vec![
            known(mean(&updates), spread(&updates)),
            share(fits.iter().filter(|f| f.1).count(), fits.len()),
            known(mean(&rows), spread(&rows)),
        ],
        met: vec![None; 3],
    };
    Group {
        title: "Held samples".to_owned(),
        text:
            "The true delay is 400 ms. A fit of all rows sees half an update interval more: 520 ms (design note 3.8)."
                .to_owned(),
        columns: ["fit at updates (ms)", "coverage of 95 % (%)", "fit of all rows (ms)"].map(str::to_owned).to_vec(),
        goals: vec![String::new(); 3],
        cases: vec![case],
    }
}

/// How often "delayed" (or early) is reported if the true delay is 0 and 2.8 standard uncertainties.
pub fn decisions(swings: &[TrueSwing], n: u64) -> Group {
    let noise = Noise::WanderAndWhite { std: 0.3, time_constant_s: 1.0, white: 0.1 };
    let model = NoiseModel { wander_std: 0.3, time_constant_s: 1.0, white_std: 0.1 };
    let case = |(name, sigmas, goal): (&str, f64, std::ops::RangeInclusive<f64>)| {
        let said: Vec<bool> = (0..n)
            .into_par_iter()
            .map(|trial| {
                let swing = &swings[trial as usize % swings.len()];
                let mut random = generator(name, trial);
                let t = Sampling::Jitter.stamps(MARGIN_S, SWING_S, 10.0, &mut random);
                let crlb = delay_crlb(&t, &swing.reference, 0.0, GAIN, &model, false).unwrap();
                let y = measured(swing, &t, sigmas * crlb, noise.draw(&t, &mut random));
                let [low, high] = fit(swing, &t, &y).interval(0.95);
                low > 0.0 || high < 0.0
            })
            .collect();
        let rate = share(said.iter().filter(|s| **s).count(), said.len());
        let met = rate.map(|r| {
            let slack = 2.0 * r.standard_uncertainty.unwrap_or(0.0);
            (goal.start() - slack..=goal.end() + slack).contains(&r.value)
        });
        Case { name: name.to_owned(), trials: n, values: vec![rate], met: vec![met] }
    };
    Group {
        title: "Saying \"delayed\"".to_owned(),
        text: "10 Hz, ±30 % jitter, OU 0.3 m / 1 s + white 0.1 m. Goal: 5 ± 1 % where there is no delay, and 80 % (within 10) at \
               the minimum detectable delay of 2.8 standard uncertainties."
            .to_owned(),
        columns: vec!["interval excludes zero (%)".to_owned()],
        goals: vec!["5 ± 1, 80 ± 10".to_owned()],
        cases: [("true delay 0", 0.0, 4.0..=6.0), ("true delay 2.8 CRLB", 2.8, 70.0..=90.0)].into_iter().map(case).collect(),
    }
}
