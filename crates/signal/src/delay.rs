//! Estimates how late a measurement is relative to a reference.

pub(crate) mod block;
mod bound;
mod descent;
mod objective;
mod rounds;
mod search;
mod segments;
mod shape;
mod uncertainty;
mod windows;

pub use bound::delay_crlb;
pub use objective::{delay_objective, delay_objective_above};
pub use segments::{SegmentDelay, delay_by_segment, homogeneity};
pub use windows::{DelayWindow, delay_windows};

pub(crate) use rounds::KEPT_POWER;
pub(crate) use uncertainty::{andrews_lags, bartlett_sum};

use crate::noise::NoiseRule;
use crate::reference::Reference;
use crate::whiten::NoiseModel;

/// A value and its standard uncertainty, in the same unit. A value that was given and not fitted has uncertainty 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Uncertain {
    /// Best value.
    pub value: f64,
    /// Standard uncertainty.
    pub standard_uncertainty: f64,
}

/// Known sign of a gain.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Sign {
    /// Measured rises when the reference rises.
    #[default]
    Positive,
    /// Measured falls when the reference rises.
    Negative,
    /// Unknown.
    Any,
}

/// Prior knowledge of the ratio measured/reference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Gain {
    /// To be fitted.
    Free {
        /// Its sign.
        sign: Sign,
    },
    /// Known.
    Fixed(f64),
}

/// One component of a channel, with its own timestamps.
#[derive(Clone, Copy)]
pub struct Measurement<'a> {
    /// Timestamps, s; strictly increasing.
    pub t: &'a [f64],
    /// Measured values, one for each timestamp, finite. Repeats of held values have been removed.
    pub y: &'a [f64],
    /// What a perfect sensor would have measured, same unit.
    pub reference: &'a dyn Reference,
    /// Ratio measured/reference.
    pub gain: Gain,
    /// Whether the offset may drift linearly.
    pub drift: bool,
}

/// Settings of the delay fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DelaySettings {
    /// Delays to search, s.
    pub search_s: (f64, f64),
    /// Step of the first search, s; well below half a period of the signal.
    pub search_step_s: f64,
    /// Noise.
    pub noise: NoiseRule,
    /// Whether the clock rates may differ: t in the sensor's clock is `t + skew·(t − middle)` in the reference's.
    pub skew: bool,
    /// Whether to downweight samples far outside the noise (Huber weights).
    pub robust: bool,
}

impl Default for DelaySettings {
    fn default() -> DelaySettings {
        DelaySettings {
            search_s: (-1.0, 1.5),
            search_step_s: 0.02,
            noise: NoiseRule::WanderAndWhite,
            skew: false,
            robust: true,
        }
    }
}

/// Another delay at which the objective has a minimum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OtherMinimum {
    /// Delay at this minimum, s.
    pub delay_s: f64,
    /// −2 log likelihood above the best: chi-squared units.
    pub excess: f64,
}

/// Fit result of one component.
#[derive(Debug, Clone, PartialEq)]
pub struct ComponentFit {
    /// Ratio measured/reference.
    pub gain: Uncertain,
    /// Measured minus reference, unit of the component; at [`DelayFit::middle_s`] if there is a drift.
    pub offset: Uncertain,
    /// Drift of the offset, unit per second.
    pub drift: Option<Uncertain>,
    /// Noise about the fit.
    pub noise: NoiseModel,
    /// Used rows, rising: those whose true instant lies within the reference.
    pub used_rows: Vec<usize>,
    /// Timestamps of the used rows, s.
    pub t_used: Vec<f64>,
    /// Measured minus fitted for each used row, unit of the component.
    pub residuals: Vec<f64>,
    /// The whitened residuals: uncorrelated with standard deviation 1 if the fitted noise is right.
    pub whitened: Vec<f64>,
    /// Weight of each used row, 0 to 1: below 1 for downweighted outliers.
    pub weights: Vec<f64>,
    /// Gain times rate of the reference at the true instant of each used row, unit per second.
    pub slope: Vec<f64>,
}

/// A delay and its uncertainty.
#[derive(Debug, Clone, PartialEq)]
pub struct DelayFit {
    /// Delay, s; positive is late: `measured(t) = truth(t − delay)`.
    pub delay_s: f64,
    /// Standard uncertainty from the curvature of the objective, s.
    pub hessian_s: f64,
    /// Standard uncertainty from the sandwich that is consistent under heteroscedasticity and autocorrelation, s.
    pub hac_s: f64,
    /// The larger of the two, s.
    pub standard_uncertainty_s: f64,
    /// Degrees of freedom of Student's distribution for intervals.
    pub degrees_of_freedom: f64,
    /// Lag of the Bartlett window of the sandwich, samples.
    pub hac_lags: usize,
    /// Coefficients of the shared columns of the references, see [`Reference::shared`].
    pub shared: Vec<Uncertain>,
    /// Skew of the clocks, seconds per second, if requested.
    pub skew: Option<Uncertain>,
    /// Instant that offset, drift and skew refer to, s: the middle of the used rows.
    pub middle_s: f64,
    /// Cramér–Rao bound at the fitted noise, s.
    pub crlb_s: f64,
    /// Fits of the components.
    pub components: Vec<ComponentFit>,
    /// Gauss–Newton steps taken.
    pub iterations: usize,
    /// Whether the last step was small enough to count as converged.
    pub converged: bool,
    /// Share of the used rows that were downweighted as outliers, 0 to 1.
    pub downweighted_share: f64,
    /// The next best minimum of the objective in the search range.
    pub second_minimum: Option<OtherMinimum>,
}

impl DelayFit {
    /// Confidence interval of the delay at `level`, such as 0.95, s: lower and upper end.
    #[must_use]
    pub fn interval(&self, level: f64) -> [f64; 2] {
        let half = self.standard_uncertainty_s * crate::student_quantile(0.5 + 0.5 * level, self.degrees_of_freedom);
        [self.delay_s - half, self.delay_s + half]
    }
}

/// Why a delay cannot be estimated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DelayError {
    /// No component was given.
    #[error("no component to fit")]
    NoComponent,
    /// Numbers of timestamps and values differ.
    #[error("component {component}: {stamps} timestamps for {values} values")]
    LengthsDiffer {
        /// Component, from 0.
        component: usize,
        /// Number of timestamps.
        stamps: usize,
        /// Number of values.
        values: usize,
    },
    /// Timestamps do not increase.
    #[error("component {component}: the timestamps do not increase strictly at row {row}")]
    StampsNotRising {
        /// Component, from 0.
        component: usize,
        /// Row that is not later than the previous one.
        row: usize,
    },
    /// Too little of the record overlaps the reference.
    #[error("component {component}: only {samples} of {of} samples lie within the reference, {needed} are needed")]
    TooFewSamples {
        /// Component, from 0.
        component: usize,
        /// Samples within the reference.
        samples: usize,
        /// Samples of the component.
        of: usize,
        /// Required minimum.
        needed: usize,
    },
    /// Shared columns together with a gain that is to be fitted.
    #[error("component {component}: a reference with shared columns needs a gain that is known")]
    SharedNeedsGain {
        /// Component, from 0.
        component: usize,
    },
    /// The settings are inconsistent.
    #[error("cannot search {step_s:.4} s apart from {from_s:.3} s to {to_s:.3} s")]
    SearchRange {
        /// First delay, s.
        from_s: f64,
        /// Last delay, s.
        to_s: f64,
        /// Step, s.
        step_s: f64,
    },
    /// The reference does not move, so that every delay fits equally well.
    #[error("the reference does not move over the record: every delay fits equally well")]
    NoExcitation,
    /// The effect of a shared column on the reference cannot be distinguished from a delay.
    #[error(
        "the motion cannot separate a delay from the other fitted effects, such as an accelerometer's bias on a steady circle: \
         turn both ways, and change speed"
    )]
    NotSeparable,
    /// The measured values do not follow the reference at any delay.
    #[error(
        "no delay from {from_s:.3} s to {to_s:.3} s makes the measured values follow the reference with a gain of the stated sign"
    )]
    DoesNotFollow {
        /// First delay, s.
        from_s: f64,
        /// Last delay, s.
        to_s: f64,
    },
}

/// Estimates the delay (and skew) common to all components; each component has its own gain, offset, drift and noise.
///
/// The model is `y = gain · r(t − delay + skew·(t − middle)) + offset + drift·(t − middle) + noise`. The fit is least
/// squares with the linear parameters projected out, on samples whitened under a noise whose parameters are found by
/// restricted maximum likelihood. Both steps alternate until they converge (design note 3.5).
///
/// Performance (`examples/delay_study.rs`, 1000 swings of 60 s by hand for each of 4, 10, 50, 100 Hz × white, wander of
/// 0.5 s, of 20 s × regular, 30 % jittered, a tenth lost): rms error over the Cramér–Rao bound 0.95 to 1.06, 1.00 over
/// all (each ± 0.022); 95 % intervals cover 93.0 to 96.2 %; bias below 0.1 of the bound. With noise in held steps, a
/// random walk, or a jittering latency they cover 93 to 99 % (1000 records each up to 50 Hz, 400 at 100 Hz).
/// `delay/monte_carlo.rs` checks this with fewer trials.
///
/// With noise as large as the signal (4 Hz, 1 m, 1000 records) four fits were a whole swing off, and their intervals
/// did not show it. In all four, [`DelayFit::second_minimum`] was the true delay, less than 6 above the best. It was
/// less than 9 above in 35 of the 1000: below that, distrust the choice.
///
/// Tried: the textbook sandwich (factor and degrees of freedom from n − p) instead of HC2 and Satterthwaite. It is
/// nearly as good: under jitter at 4 Hz its intervals covered 367 times, these 369 times, on the same 400 records.
///
/// # Errors
/// Why the delay cannot be estimated.
pub fn fit_delay(components: &[Measurement], settings: &DelaySettings) -> Result<DelayFit, DelayError> {
    fit_delay_with_noise(components, settings, |_| None)
}

/// Noise fitted to one component.
#[derive(Debug, Clone, Copy)]
pub struct FoundNoise<'a> {
    /// The noise.
    pub model: NoiseModel,
    /// Timestamps of the rows it was estimated from, s.
    pub t_used: &'a [f64],
}

/// [`fit_delay`], then a second fit from its delay with the noise that `revise` derives from the noise of all
/// components, such as one that they share. If `revise` returns `None`, the first fit is returned.
///
/// # Errors
/// Why the delay cannot be estimated.
pub fn fit_delay_with_noise(
    components: &[Measurement],
    settings: &DelaySettings,
    revise: impl Fn(&[FoundNoise]) -> Option<Vec<NoiseModel>>,
) -> Result<DelayFit, DelayError> {
    check(components)?;
    rounds::fit(components, settings, revise).map_err(|e| inseparable(components, e))
}

/// If nothing in the data determines the delay and there are shared columns, they are the cause.
fn inseparable(components: &[Measurement], error: DelayError) -> DelayError {
    let shared = components.iter().any(|m| !m.reference.shared().is_empty());
    if shared && error == DelayError::NoExcitation { DelayError::NotSeparable } else { error }
}

/// Start of a fit that needs no search.
#[derive(Debug, Clone, PartialEq)]
pub struct DelayStart {
    /// An approximate delay, s: within a fraction of the signal's period.
    pub delay_s: f64,
    /// Noise of each component.
    pub noise: Vec<NoiseModel>,
    /// Whether the noise is known; if not, it is the start of the search.
    pub keep_noise: bool,
}

/// [`fit_delay`] from an approximate delay and noise: it does not search the range of the settings and does not look
/// for another minimum.
///
/// # Errors
/// Why the delay cannot be estimated.
pub fn fit_delay_near(
    components: &[Measurement],
    settings: &DelaySettings,
    start: &DelayStart,
) -> Result<DelayFit, DelayError> {
    check(components)?;
    rounds::fit_near(components, settings, start).map_err(|e| inseparable(components, e))
}

/// Minimum number of samples of a component within the reference.
const LEAST_SAMPLES: usize = 8;

fn check(components: &[Measurement]) -> Result<(), DelayError> {
    if components.is_empty() {
        return Err(DelayError::NoComponent);
    }
    for (component, m) in components.iter().enumerate() {
        if m.t.len() != m.y.len() {
            return Err(DelayError::LengthsDiffer { component, stamps: m.t.len(), values: m.y.len() });
        }
        if matches!(m.gain, Gain::Free { .. }) && !m.reference.shared().is_empty() {
            return Err(DelayError::SharedNeedsGain { component });
        }
        if let Some(k) = m.t.windows(2).position(|w| w[0].partial_cmp(&w[1]) != Some(std::cmp::Ordering::Less)) {
            return Err(DelayError::StampsNotRising { component, row: k + 1 });
        }
    }
    Ok(())
}

#[cfg(test)]
mod closed_values;
#[cfg(test)]
mod monte_carlo;
#[cfg(test)]
mod tests;
