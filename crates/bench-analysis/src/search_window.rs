//! Decides whether the best delay is a real minimum, or only the best of a search that ended too early.

use crate::verdict::millis;
use record::{ModelCandidate, ModelFinding};
use signal::{ComponentFit, DelayFit, DelaySettings, Measurement, delay_objective_above};

/// Distance beyond the search window in which a better delay is sought, s, and its limit as a share of the record.
const BEYOND_S: f64 = 5.0;
const MOST_OF_RECORD: f64 = 0.2;
/// Number of rows of a component used there.
const ROWS: usize = 600;
/// Required improvement of a delay beyond the search, units of chi-squared.
const BETTER: f64 = 9.0;
/// Smooth noise larger than this share of the signal, with a gain below [`LEAST_GAIN`], is motion at another delay. Of
/// 333 simulated channels with a delay inside the search, none has both.
const UNEXPLAINED: f64 = 0.8;
const LEAST_GAIN: f64 = 0.8;
/// A residual that is motion has no white part.
const SMOOTH: f64 = 0.02;
/// A lag that explains the gain is only ruled out if its BIC is worse by this much.
const DISTINGUISHED: f64 = 6.0;

/// Why the delay of `fit` is invalid; `None` if it is valid. `model`: choice between delay and lag at that delay.
pub(crate) fn no_answer(
    measurements: &[Measurement<'_>],
    fit: &DelayFit,
    settings: &DelaySettings,
    model: Option<&ModelFinding>,
) -> Option<String> {
    let (from, to) = settings.search_s;
    let window = format!("the search window of {} to {to} s", flight::with_minus(&from.to_string()));
    let advice = "widen analysis.search_s of the rig file";
    if fit.delay_s <= from + settings.search_step_s || fit.delay_s >= to - settings.search_step_s {
        let best = millis(fit.delay_s);
        return Some(format!("cannot tell: the best delay, {best} ms, is at the edge of {window} or beyond; {advice}"));
    }
    if let Some(other_s) = better_beyond(measurements, fit, settings) {
        let (best, other) = (millis(fit.delay_s), millis(other_s));
        return Some(format!(
            "cannot tell: the best delay in {window} is {best} ms, but one near {other} ms fits better; {advice}"
        ));
    }
    is_unexplained(measurements, fit, model).then(|| {
        let best = millis(fit.delay_s);
        format!(
            "cannot tell: at no delay in {window} does it follow the motion (best at {best} ms, where the residual \
             exceeds the explained part); {advice}, or look for a wrong mount or clock"
        )
    })
}

/// A delay outside the search that fits clearly better, s.
fn better_beyond(measurements: &[Measurement<'_>], fit: &DelayFit, settings: &DelaySettings) -> Option<f64> {
    let (from, to) = settings.search_s;
    let (first, last) = measurements.first()?.reference.span();
    let beyond_s = BEYOND_S.min(MOST_OF_RECORD * (last - first));
    let steps = (beyond_s / settings.search_step_s).floor() as usize;
    let outward = |end: f64, sign: f64| (1..=steps).map(move |k| end + sign * settings.search_step_s * k as f64);
    let delays: Vec<f64> = outward(from, -1.0).chain(outward(to, 1.0)).collect();
    let values = delay_objective_above(measurements, fit, &delays, ROWS);
    let (delay_s, value) = delays.into_iter().zip(values).min_by(|a, b| a.1.total_cmp(&b.1))?;
    (value < -BETTER).then_some(delay_s)
}

/// Whether every component has a smooth residual as large as the part it explains, with too small a gain.
fn is_unexplained(measurements: &[Measurement<'_>], fit: &DelayFit, model: Option<&ModelFinding>) -> bool {
    let is_sensor = |c: &&ModelCandidate| !c.lags_s.is_empty() && c.delay_s.is_none_or(|d| d.value >= 0.0);
    let explains = |c: &ModelCandidate| (LEAST_GAIN..1.0 / LEAST_GAIN).contains(&c.gain.value);
    let in_question = model.into_iter().flat_map(|m| &m.candidates).filter(|c| c.delta_bic < DISTINGUISHED);
    let is_pure_delay = model.is_some_and(|m| m.chosen.as_deref() == Some("D"));
    if !is_pure_delay && in_question.filter(is_sensor).any(explains) {
        return false;
    }
    let is_left = |(m, c): (&Measurement<'_>, &ComponentFit)| {
        let signal: Vec<f64> =
            c.t_used.iter().map(|t| c.gain.value * m.reference.value_and_rate(t - fit.delay_s).0).collect();
        let mean = signal.iter().sum::<f64>() / signal.len().max(1) as f64;
        let rms = (signal.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / signal.len().max(1) as f64).sqrt();
        let is_smooth = c.noise.white_std < SMOOTH * c.noise.wander_std;
        is_smooth && c.noise.wander_std > UNEXPLAINED * rms && c.gain.value < LEAST_GAIN
    };
    measurements.iter().zip(&fit.components).all(is_left)
}
