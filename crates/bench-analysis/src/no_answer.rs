//! Decides whether the best delay is an answer: a real minimum, of a channel that follows the swing above its noise.

use crate::verdict::millis;
use record::{ModelCandidate, ModelFinding};
use signal::{ComponentFit, DelayFit, DelaySettings, Measurement, delay_objective_above};

/// Distance beyond the search window in which a better delay is sought, s, and its limit as a share of the record.
const BEYOND_S: f64 = 5.0;
const MOST_OF_RECORD: f64 = 0.2;
/// Number of rows of a component used there.
const ROWS: usize = 600;
/// Smooth noise larger than this share of the signal, with a gain below [`LEAST_GAIN`], is motion at another delay. Of
/// 333 simulated channels with a delay inside the search, none has both.
const UNEXPLAINED: f64 = 0.8;
const LEAST_GAIN: f64 = 0.8;
/// A residual that is motion has no white part.
const SMOOTH: f64 = 0.02;
/// The least sum of `(gain/u)²` over the components. In 336 simulated swings of 30 s with noise of up to 50 m, the 95 %
/// intervals above it held in 132 of 141 cases, those down to half of it in 26 of 33, and those below in 70 of 128: the
/// best of a search through noise has a sharp minimum somewhere, and an interval around it.
const DETECTED: f64 = 40.0;
/// Two minima differ if their distance exceeds this many units of chi-squared, and this share of what the best explains:
/// closer ones of a swing that repeats itself differ by errors of the reference.
const DIFFERENT: f64 = 9.0;
const DIFFERENT_SHARE: f64 = 1e-3;
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
    let best = millis(fit.delay_s);
    if fit.delay_s <= from + settings.search_step_s || fit.delay_s >= to - settings.search_step_s {
        return Some(format!("cannot tell: the best delay, {best} ms, is at the edge of {window} or beyond; {advice}"));
    }
    let beyond = better_beyond(measurements, fit, settings).map(|other_s| {
        let other = millis(other_s);
        format!("cannot tell: the best delay in {window} is {best} ms, but one near {other} ms fits better; {advice}")
    });
    let detected = detected(fit);
    if detected < DETECTED {
        let hidden = || {
            format!(
                "cannot tell: the swing is hardly visible in its noise: the gain is {:.1} times its standard uncertainty, \
                 but a delay needs {:.1} times. Swing wider, faster or longer, or record a less noisy output",
                detected.sqrt(),
                DETECTED.sqrt()
            )
        };
        return beyond.or_else(|| Some(hidden()));
    }
    // Of a swing that repeats itself, a delay beyond the search also fits.
    if let Some(other_s) = ambiguous_with(fit) {
        let other = millis(other_s);
        // Two equal delays to either side of zero are half a swing each: the channel moves opposite to its reference.
        let is_opposite = (fit.delay_s + other_s).abs() < 0.1 * (fit.delay_s - other_s).abs();
        let advice = match is_opposite {
            true => {
                "They are half a swing to either side: its sign may be wrong. Check encoder.sign, azimuth, mount and field"
            }
            false => "Swing by hand, not too regularly, or longer",
        };
        return Some(format!("cannot tell: delays of {best} ms and {other} ms fit nearly equally well. {advice}"));
    }
    let unexplained = || {
        format!(
            "cannot tell: at no delay in {window} does it follow the motion (best at {best} ms, where the residual \
             exceeds the explained part); {advice}, or look for a wrong mount or clock"
        )
    };
    beyond.or_else(|| is_unexplained(measurements, fit, model).then(unexplained))
}

/// Another delay in the search window that fits nearly as well, s.
pub(crate) fn ambiguous_with(fit: &DelayFit) -> Option<f64> {
    fit.second_minimum.filter(|m| m.excess < different(fit)).map(|m| m.delay_s)
}

/// Distance of two minima that are not equally good, units of chi-squared.
fn different(fit: &DelayFit) -> f64 {
    DIFFERENT.max(DIFFERENT_SHARE * detected(fit))
}

/// Sum of `(gain/u)²` over the components.
fn detected(fit: &DelayFit) -> f64 {
    fit.components.iter().map(|c| (c.gain.value / c.gain.standard_uncertainty).powi(2)).sum()
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
    (value < -different(fit)).then_some(delay_s)
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
