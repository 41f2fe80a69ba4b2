//! Delay or lag: how often the right one is chosen (design note 3.6).

use crate::noise::{Noise, generator};
use crate::share;
use crate::swing::{MARGIN_S, SWING_S, TrueSwing};
use crate::{Case, Group};
use rayon::prelude::*;
use signal::{CubicSpline, DelaySettings, Gain, Measurement, Sign, choose_lag_model, fit_delay};

/// Grid on which the truth is filtered, s.
const STEP_S: f64 = 1e-3;

/// Right, not distinguished, wrong; for five truths at three accuracies.
pub fn choices(swings: &[TrueSwing], n: u64) -> Group {
    let truths: [(&str, f64, &[f64]); 5] =
        [("D", 0.4, &[]), ("L", 0.0, &[0.4]), ("DL", 0.3, &[0.1]), ("DL", 0.2, &[0.2]), ("DLL", 0.0, &[0.2, 0.2])];
    let mut cases = vec![];
    for (rate_hz, sigma, clear) in [(4.0, 0.1, false), (4.0, 0.02, false), (100.0, 0.1, true)] {
        for (right, delay_s, lags) in truths {
            let name = format!("{rate_hz:.0} Hz, {sigma} m: delay {delay_s} s, lags {lags:?} s");
            // The design note finds two equal lags hard to distinguish from a delay and one lag even at 100 Hz.
            let must = clear && lags.len() < 2;
            cases.push(case(swings, n, name, (rate_hz, sigma), (right, delay_s, lags), must));
        }
    }
    Group {
        title: "Delay or lag".to_owned(),
        text: "Position, 60 s of hand-driven swing, gain free. Right: the true model is chosen. Not distinguished: two models are \
               within ΔBIC 6. Wrong: another one is chosen."
            .to_owned(),
        columns: ["right (%)", "not distinguished (%)", "wrong (%)"].map(str::to_owned).to_vec(),
        goals: ["≥ 95 at 100 Hz with at most one lag", "", "≤ 5"].map(str::to_owned).to_vec(),
        cases,
    }
}

fn case(
    swings: &[TrueSwing],
    n: u64,
    name: String,
    (rate_hz, sigma): (f64, f64),
    (right, delay_s, lags): (&str, f64, &[f64]),
    must: bool,
) -> Case {
    let lagged: Vec<CubicSpline> = swings.iter().take(n as usize).map(|swing| lagged(swing, lags)).collect();
    let chosen: Vec<Option<&'static str>> = (0..n)
        .into_par_iter()
        .map(|trial| {
            let k = trial as usize % lagged.len();
            let mut random = generator(&name, trial);
            let t: Vec<f64> = (0..(SWING_S * rate_hz) as usize).map(|k| MARGIN_S + k as f64 / rate_hz).collect();
            let noise = Noise::white(sigma).draw(&t, &mut random);
            let y: Vec<f64> = t.iter().zip(noise).map(|(t, n)| lagged[k].value(t - delay_s) + 2.0 + n).collect();
            let gain = Gain::Free { sign: Sign::Positive };
            let measurement = [Measurement { t: &t, y: &y, reference: &swings[k].reference, gain, drift: false }];
            let settings = DelaySettings::default();
            let fit = fit_delay(&measurement, &settings).unwrap();
            choose_lag_model(&measurement, &fit, &settings).chosen.map(|model| model.name())
        })
        .collect();
    let count = |f: &dyn Fn(&Option<&str>) -> bool| share(chosen.iter().filter(|c| f(c)).count(), chosen.len());
    let is_right = count(&|c| *c == Some(right));
    let wrong = count(&|c| c.is_some_and(|c| c != right));
    let slack = |e: &record::Estimate| 2.0 * e.standard_uncertainty.unwrap_or(0.0);
    Case {
        name,
        trials: n,
        met: vec![
            is_right.filter(|_| must).map(|e| e.value + slack(&e) >= 95.0),
            None,
            wrong.map(|e| e.value - slack(&e) <= 5.0),
        ],
        values: vec![is_right, count(&|c| c.is_none()), wrong],
    }
}

/// The true north position through first-order lags: exact for a truth that is linear within a millisecond.
fn lagged(swing: &TrueSwing, lags: &[f64]) -> CubicSpline {
    const LEAD_S: f64 = 3.9;
    let from = MARGIN_S - LEAD_S;
    let n = ((SWING_S + LEAD_S + 1.0) / STEP_S) as usize;
    let t: Vec<f64> = (0..n).map(|k| from + k as f64 * STEP_S).collect();
    let mut y: Vec<f64> = t.iter().map(|&t| swing.north(t)).collect();
    for lag in lags {
        let phi = (-STEP_S / lag).exp();
        let (old, new) = ((1.0 - phi) * lag / STEP_S - phi, 1.0 - (1.0 - phi) * lag / STEP_S);
        let mut state = y[0];
        let mut last = y[0];
        for value in &mut y {
            state = phi * state + old * last + new * *value;
            last = *value;
            *value = state;
        }
    }
    CubicSpline::new(&t, &y).unwrap()
}
