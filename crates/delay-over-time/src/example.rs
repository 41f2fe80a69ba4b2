//! A flight as input to verdict and words, for tests: windows of 20 s that start at 100 s.

use crate::bins::Noise;
use crate::coarse::CoarseMap;
use crate::constancy::{Decision, compare, decide};
use crate::delays::{Delays, Effect};
use crate::dense::turning;
use crate::describe::{Description, Term};
use crate::jitter::Jitter;
use crate::noise_shape::GUESS;
use crate::odd::Odd;
use crate::refine::Refined;
use crate::settings::OverTimeSettings;
use crate::stages::{Found, Test};
use crate::stamps::Queued;
use crate::windows::Window;
use record::DelayTermKind;

/// First fix, s, and length of a window, s.
pub(crate) const FIRST_S: f64 = 100.0;
pub(crate) const WINDOW_S: f64 = 20.0;

/// Windows with these delays, each with uncertainty `u`.
pub(crate) fn delays(delay_s: &[f64], u: f64) -> Delays {
    let n = delay_s.len();
    Delays {
        window: (0..n).collect(),
        middle_s: (0..n).map(|k| FIRST_S + WINDOW_S * (k as f64 + 0.5)).collect(),
        delay_s: delay_s.to_vec(),
        uncertainty_s: vec![u; n],
        speed_lag_s: Effect::default(),
        lever_m: Effect::default(),
        level: Effect { size: delay_s.iter().sum::<f64>() / n as f64, uncertainty: u / (n as f64).sqrt() },
        white_m: 0.3,
        inflation: 1.0,
    }
}

fn window(k: usize) -> Window {
    let from_s = FIRST_S + WINDOW_S * k as f64;
    Window {
        from_s,
        to_s: from_s + WINDOW_S,
        middle_s: from_s + 0.5 * WINDOW_S,
        delay_s: 0.2,
        information: 1e4,
        variance: 0.09,
        free: 195.0,
        score_variance: 900.0,
        speed_mps: 15.0,
        products: [1e4, 0.0, 0.0, 1.0, 0.0, 1.0],
        scores: [0.0; 3],
    }
}

/// Results of a flight whose windows have these delays, each with uncertainty `u`.
pub(crate) fn found(delay_s: &[f64], u: f64) -> Found {
    let (settings, known, n) = (OverTimeSettings::default(), delays(delay_s, u), delay_s.len());
    let comparison = compare(&known, &settings);
    let decision = decide(&known, &comparison, &settings);
    let last_s = FIRST_S + WINDOW_S * n as f64;
    Found {
        motion: turning(last_s),
        queued: Queued { rows: vec![false; 100 * n], bursts: vec![] },
        odd: Odd::default(),
        search_s: [-2.5, 13.0],
        map: Some(CoarseMap {
            middle_s: vec![FIRST_S, last_s],
            path_s: vec![0.2; 2],
            constant_s: 0.2,
            runner_up_s: 3.0,
            runner_up_cost: 500.0,
            edge: false,
            unexplained_share: 0.01,
        }),
        jitter: Jitter::default(),
        test: Some(Test {
            windows: (0..n).map(window).collect(),
            length_s: WINDOW_S,
            all: known.clone(),
            known,
            comparison: Some(comparison),
            decision: Some(decision),
        }),
        flexible: None,
        refined: None,
        explained: false,
        noise: Noise { shape: GUESS, white_m: 0.3 },
        interval_s: 0.2,
        fixes_used: 100 * n,
        span_s: [FIRST_S, last_s],
    }
}

/// Twelve windows with a varying delay, with steps or bends (after the first fix, s; size, s or s/s).
pub(crate) fn described(terms: &[(DelayTermKind, f64, f64)], level_s: f64) -> Found {
    let term =
        |(kind, after_s, size): &(DelayTermKind, f64, f64)| Term { kind: *kind, at_s: FIRST_S + after_s, size: *size };
    let description = Description { level_s, terms: terms.iter().map(term).collect() };
    let delay_s: Vec<f64> = (0..12).map(|k| description.at(FIRST_S + WINDOW_S * (f64::from(k) + 0.5))).collect();
    let mut found = found(&delay_s, 1e-3);
    if let Some(test) = &mut found.test {
        test.decision = Some(Decision { p: 1e-6, varies: true, rests_on: None });
    }
    Found { refined: Some(Refined::example(description)), ..found }
}
