//! Late because of a delay, or because of a lag?

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
}

impl LagModel {
    /// `D`, `L`, `DL` or `DLL`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            LagModel::D => "D",
            LagModel::L => "L",
            LagModel::DL => "DL",
            LagModel::DLL => "DLL",
        }
    }
}

/// One way to be late, fitted.
#[derive(Debug, Clone, PartialEq)]
pub struct LagCandidate {
    /// Which.
    pub model: LagModel,
    /// Bayesian information criterion: −2 log likelihood + parameters · ln(samples).
    pub bic: f64,
    /// Delay, s; `None` for [`LagModel::L`], which has none.
    pub delay_s: Option<Uncertain>,
    /// Lags, s, the longest first.
    pub lags_s: Vec<Uncertain>,
    /// Gains, one for each component.
    pub gains: Vec<Uncertain>,
    /// Delay plus lags, s: the group delay at low frequency.
    pub sum_s: Uncertain,
    /// Least and largest delay proper (without the lags) that the data leave open for this candidate at 95 %, s.
    pub delay_range_s: [f64; 2],
}

/// Which way it is.
#[derive(Debug, Clone, PartialEq)]
pub struct LagChoice {
    /// The candidates that could be fitted, the best first.
    pub candidates: Vec<LagCandidate>,
    /// The best one, or `None` if another that means something else is as good within ΔBIC 6, or differs from it only by the
    /// error of the reference alone.
    pub chosen: Option<LagModel>,
    /// The best candidate that means something else than the best, with its ΔBIC.
    pub rival: Option<(LagModel, f64)>,
}

/// A candidate this much worse than the best (in BIC) is out.
const DISTINGUISHED: f64 = 6.0;
/// Candidates whose delays proper differ by less than this share of delay plus lags mean the same.
const SAME_SHARE: f64 = 0.2;

/// Chooses between a delay, a lag, and both, by the Bayesian information criterion (Schwarz 1978) of the candidates
/// `D`, `L`, `DL` and `DLL`, each with gain, offset and drift as in `components` and with its own noise of the family
/// in `settings` (design note 3.6).
///
/// A second candidate within ΔBIC 6 makes it undecided, unless it means the same: a `DL` whose lag cannot be
/// longer than a fifth of the whole says nothing else than `D`. All candidates are fitted to the same rows: those of
/// `fit`, less a lead-in of 6.2 delays or so in which a lag remembers what happened before the reference began.
///
/// Delay and lag apart are known far worse than their sum; narrow swings with a free gain cannot tell them at all.
///
/// The reference counts as exact; see [`choose_lag_model_against`].
#[must_use]
pub fn choose_lag_model(components: &[Measurement], fit: &DelayFit, settings: &DelaySettings) -> LagChoice {
    choose_lag_model_against(components, fit, settings, &[])
}

/// [`choose_lag_model`] against references that err: `reference_std` is the standard uncertainty of the reference of each
/// component at any one instant, unit of the component (nothing: exact).
///
/// Candidates whose values differ by less than that (rms) are not told apart, however clear the criterion: it would be an
/// error of the reference that decides. And no delay beside a lag is negative, unless that is better by ΔBIC 6 than what
/// has no negative delay, and by more than the reference errs: on the border of what is allowed, delay or lag is zero.
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
    LagChoice { chosen, rival, candidates: fitted.into_iter().map(|f| f.candidate).collect() }
}

/// Whether `other` leaves no delay open that is far from that of `best`.
fn mean_the_same(best: &LagCandidate, other: &LagCandidate) -> bool {
    let delay = best.delay_s.map_or(0.0, |d| d.value);
    let farthest = other.delay_range_s.iter().map(|d| (d - delay).abs()).fold(0.0, f64::max);
    farthest < SAME_SHARE * best.sum_s.value.abs()
}
