//! Decides whether a sensor is late because of a delay or because of a lag.

mod candidate;
mod lagged;

pub use lagged::LaggedReference;

use crate::delay::{DelayFit, DelaySettings, Measurement, Uncertain};
use candidate::{Fitted, Trial};

/// Ways to be late.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LagModel {
    /// `e^{−sτ}`.
    D,
    /// `1/(1 + sT)`.
    L,
    /// `e^{−sτ}/(1 + sT)`.
    DL,
    /// `e^{−sτ}/((1 + sT₁)(1 + sT₂))`.
    DLL,
    /// `e^{−sτ}/(1 + a₁s + a₂s²)` with complex poles, as most filters of a sensor have: no chain of lags is equal to it.
    D2,
    /// `e^{−sτ}(1 − e^{−sT})/(sT)`: delay and moving average, as of a velocity from positions.
    DA,
}

impl LagModel {
    /// `D`, `L`, `DL`, `DLL`, `D2` or `DA`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            LagModel::D => "D",
            LagModel::L => "L",
            LagModel::DL => "DL",
            LagModel::DLL => "DLL",
            LagModel::D2 => "D2",
            LagModel::DA => "DA",
        }
    }
}

/// One way to be late, fitted.
#[derive(Debug, Clone, PartialEq)]
pub struct LagCandidate {
    /// Model of this candidate.
    pub model: LagModel,
    /// Bayesian information criterion: −2 log likelihood + parameters · ln(samples).
    pub bic: f64,
    /// Delay, s; `None` for [`LagModel::L`], which has no delay.
    pub delay_s: Option<Uncertain>,
    /// Lags, s, longest first; for [`LagModel::D2`] the one number `a₁`, for [`LagModel::DA`] half the average.
    pub lags_s: Vec<Uncertain>,
    /// `a₂` of [`LagModel::D2`], s².
    pub square_s2: Option<Uncertain>,
    /// Gains, one for each component.
    pub gains: Vec<Uncertain>,
    /// Delay plus lags, s: the group delay at low frequency.
    pub sum_s: Uncertain,
    /// Smallest and largest delay proper (without the lags) compatible with the data for this candidate at 95 %, s.
    pub delay_range_s: [f64; 2],
}

/// The choice between the models.
#[derive(Debug, Clone, PartialEq)]
pub struct LagChoice {
    /// Candidates that could be fitted, best first.
    pub candidates: Vec<LagCandidate>,
    /// The best one. `None` if a candidate with a different meaning is as good within ΔBIC 6, or differs from it only
    /// by the error of the reference.
    pub chosen: Option<LagModel>,
    /// The best candidate with a different meaning than the best, with its ΔBIC.
    pub rival: Option<(LagModel, f64)>,
}

/// A candidate worse than the best by this much (in BIC) is ruled out.
const DISTINGUISHED: f64 = 6.0;
/// Candidates whose delays proper differ by less than this share of delay plus lags have the same meaning.
const SAME_SHARE: f64 = 0.2;

/// Chooses between a delay, a lag, and both, by the Bayesian information criterion (Schwarz 1978) of the candidates
/// `D`, `L`, `DL`, `DLL`, `D2` and `DA`, each with gain, offset and drift as in `components` and with its own noise of the family
/// in `settings` (design note 3.6).
///
/// The choice is undecided if a second candidate is within ΔBIC 6, unless it has the same meaning: a `DL` whose lag
/// cannot be longer than a fifth of the whole is equivalent to `D`, and two candidates with delay and lag that are equally
/// late together are. All candidates are fitted to the same rows: those
/// of `fit`, minus a lead-in of about 6.2 delays in which a lag depends on motion before the start of the reference.
///
/// `D2` and `DA` are tried where the best of the others has a lag, and are candidates only if they are better by ΔBIC 10.
///
/// Delay and lag separately are far less certain than their sum; narrow swings with a free gain cannot separate them.
///
/// The reference counts as exact; see [`choose_lag_model_against`].
#[must_use]
pub fn choose_lag_model(components: &[Measurement], fit: &DelayFit, settings: &DelaySettings) -> LagChoice {
    choose_lag_model_against(components, fit, settings, &[])
}

/// [`choose_lag_model`] against inexact references: `reference_std` is the standard uncertainty of the reference of
/// each component at any one instant, unit of the component (empty: exact).
///
/// Candidates whose values differ by less than that (rms) are not distinguished, however clear the criterion, because
/// an error of the reference would decide. A delay together with a lag is not negative, unless that is better by ΔBIC 6
/// than all candidates without negative delay, and by more than the reference error. On the border of the allowed
/// range, delay or lag is zero.
#[must_use]
pub fn choose_lag_model_against(
    components: &[Measurement],
    fit: &DelayFit,
    settings: &DelaySettings,
    reference_std: &[f64],
) -> LagChoice {
    let undecided = LagChoice { candidates: vec![], chosen: None, rival: None };
    let Some(trial) = Trial::new(components, fit, settings, reference_std) else { return undecided };
    let mut fitted = trial.candidates();
    fitted.sort_by(|a, b| a.bic.total_cmp(&b.bic));
    let Some((best, others)) = fitted.split_first() else { return undecided };
    let is_as_good = |c: &&Fitted| {
        let only_by_the_reference = !c.is_richer_than(best) && !trial.differ(best, c);
        c.bic - best.bic < DISTINGUISHED || only_by_the_reference
    };
    let rivals = || others.iter().filter(|c| !mean_the_same(best, c));
    let equal = rivals().find(is_as_good);
    let rival = equal.or_else(|| rivals().next()).map(|c| (c.model, c.bic - best.bic));
    let chosen = (equal.is_none() && !others.is_empty()).then_some(best.model);
    // Where the data do not tell which of them it is, the lateness of slow motion is as uncertain as they differ.
    let as_likely = others.iter().filter(|c| c.bic - best.bic < DISTINGUISHED && !c.lags_s.is_empty());
    let apart_s = as_likely.map(|c| (c.sum_s.value - best.sum_s.value).abs()).fold(0.0, f64::max);
    let mut candidates: Vec<LagCandidate> = fitted.into_iter().map(|f| f.candidate).collect();
    if let Some(best) = candidates.first_mut().filter(|best| !best.lags_s.is_empty()) {
        best.sum_s.standard_uncertainty = best.sum_s.standard_uncertainty.hypot(apart_s / 3_f64.sqrt());
    }
    LagChoice { chosen, rival, candidates }
}

/// Whether all delays compatible with `other` are close to that of `best`, or both have delay and lag and are equally
/// late together.
fn mean_the_same(best: &LagCandidate, other: &LagCandidate) -> bool {
    let has_both = |c: &LagCandidate| !c.lags_s.is_empty() && c.delay_s.is_some();
    let apart_s = (best.sum_s.value - other.sum_s.value).abs();
    let u_s = best.sum_s.standard_uncertainty.hypot(other.sum_s.standard_uncertainty);
    if has_both(best) && has_both(other) && apart_s < 2.0 * u_s {
        return true;
    }
    let delay = best.delay_s.map_or(0.0, |d| d.value);
    let farthest = other.delay_range_s.iter().map(|d| (d - delay).abs()).fold(0.0, f64::max);
    farthest < SAME_SHARE * best.sum_s.value.abs()
}
