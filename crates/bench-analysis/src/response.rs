//! Frequency response of a channel, together with the fitted model (design note 9).

use crate::sensed::{SensedChannel, Updates};
use record::{Estimate, Finding, ModelCandidate, ModelFinding, ResponseFinding, ResponsePoint};
use signal::{ComponentFit, DelayFit, LagModel, frequency_response};
use std::f64::consts::TAU;

/// Length of the segments in a long record, s; a short record has seven.
const LONGEST_SEGMENT_S: f64 = 16.0;
const SHORTEST_SEGMENT_S: f64 = 4.0;
const SEGMENTS: f64 = 7.0;

/// Response of the component with the most signal.
pub(crate) fn response(
    channel: &SensedChannel<'_>,
    updates: &Updates,
    fit: &DelayFit,
    model: &Finding<ModelFinding>,
) -> Finding<ResponseFinding> {
    let steepness = |f: &ComponentFit| f.slope.iter().map(|s| s * s).sum::<f64>() / f.noise.std().powi(2);
    let fits = updates.excited.iter().zip(&fit.components);
    let Some((&k, best)) = fits.max_by(|a, b| steepness(a.1).total_cmp(&steepness(b.1))) else {
        return Finding::CannotTell("no component moves".to_owned());
    };
    let component = &channel.components[k];
    let drift = best.drift.map_or(0.0, |d| d.value);
    let offset = |t: f64| best.offset.value + drift * (t - fit.middle_s);
    let y: Vec<f64> = updates.t.iter().zip(&updates.values[k]).map(|(t, y)| y - offset(*t)).collect();
    let duration_s = updates.t.last().zip(updates.t.first()).map_or(0.0, |(last, first)| last - first);
    let segment_s = (duration_s / SEGMENTS).clamp(SHORTEST_SEGMENT_S, LONGEST_SEGMENT_S);
    let Some(rate_hz) = updates.rate_hz() else {
        return Finding::CannotTell("fewer than two samples".to_owned());
    };
    match frequency_response(&updates.t, &y, component.reference, fit.delay_s, segment_s, rate_hz) {
        Ok(found) => Finding::Found(described(component.name, &found, fit, model.found())),
        Err(error) => Finding::CannotTell(error.to_string()),
    }
}

fn described(
    component: &str,
    found: &signal::FrequencyResponse,
    fit: &DelayFit,
    model: Option<&ModelFinding>,
) -> ResponseFinding {
    // Above the frequency band of the bar's motion there is only noise.
    let last = found.points.iter().rposition(|p| p.reliable).unwrap_or(0);
    let shown = &found.points[..found.points.len().min(2 * last + 4)];
    let candidate = model.and_then(|m| m.candidates.first());
    let of_model = |f: f64| {
        candidate.map_or_else(
            || (fit.components.first().map_or(1.0, |c| c.gain.value), -TAU * f * fit.delay_s),
            |c| gain_and_phase(c, f),
        )
    };
    let highest_hz = found.points.get(last).map_or(0.0, |p| p.frequency_hz);
    let bandwidth = candidate.and_then(bandwidth).filter(|hz| hz.value <= highest_hz);
    ResponseFinding {
        component: component.to_owned(),
        segment_s: found.segment_s,
        averages: found.averages,
        points: shown.iter().map(point).collect(),
        model_phase_rad: shown.iter().map(|p| of_model(p.frequency_hz).1).collect(),
        model_gain: shown.iter().map(|p| of_model(p.frequency_hz).0).collect(),
        bandwidth: bandwidth.map_or_else(|| format!("> {highest_hz:.2} Hz"), in_hertz),
        bandwidth_hz: bandwidth.map(|hz| hz.value),
        bandwidth_u_hz: bandwidth.and_then(|hz| hz.standard_uncertainty),
    }
}

fn point(p: &signal::FrequencyPoint) -> ResponsePoint {
    ResponsePoint {
        frequency_hz: p.frequency_hz,
        gain: p.gain,
        gain_u95: p.gain_u95,
        phase_rad: p.phase_rad,
        phase_u95: p.phase_u95,
        coherence: p.coherence,
        reliable: p.reliable,
    }
}

/// Gain and phase of `K e^{−sτ} / Π(1 + sT)`, or of `K e^{−sτ} / (1 + a₁s + a₂s²)`, at `f` Hz.
fn gain_and_phase(model: &ModelCandidate, f: f64) -> (f64, f64) {
    let w = TAU * f;
    let delay_s = model.delay_s.map_or(0.0, |d| d.value);
    let lags = || model.lags_s.iter().map(|lag| lag.value);
    if model.name == LagModel::DA.name() {
        let half = 0.5 * w * window_s(model);
        let gain = if half == 0.0 { 1.0 } else { half.sin() / half };
        return (model.gain.value * gain, -w * delay_s - half);
    }
    if let Some(a2) = model.square_s2 {
        let (re, im) = (1.0 - a2.value * w * w, w * lags().sum::<f64>());
        return (model.gain.value / re.hypot(im), -w * delay_s - im.atan2(re));
    }
    let gain = lags().fold(model.gain.value, |gain, lag| gain / (w * lag).hypot(1.0));
    let phase = lags().fold(-w * delay_s, |phase, lag| phase - (w * lag).atan());
    (gain, phase)
}

/// With two digits of the expanded uncertainty.
fn in_hertz(hz: Estimate) -> String {
    match hz.standard_uncertainty.map(|u| 2.0 * u).filter(|expanded| *expanded > 0.0) {
        None => format!("{:.2} Hz", hz.value),
        Some(expanded) => {
            let decimals = (1.0 - expanded.log10().floor()).clamp(0.0, 6.0) as usize;
            format!("{:.decimals$} ± {expanded:.decimals$} Hz", hz.value)
        }
    }
}

/// The −3 dB frequency (half the power) of the lags, Hz; `None` for a pure delay.
///
/// From Π(1 + ω²Tₖ²) = 2, with gₖ = ω²Tₖ²/(1 + ω²Tₖ²): ∂ω/∂Tₖ = −(ω/Tₖ) gₖ/Σg. How the lags are correlated is not
/// known here, so the shares are added as if fully: for one lag this is u(ω)/ω = u(T)/T.
fn bandwidth(model: &ModelCandidate) -> Option<Estimate> {
    if model.name == LagModel::DA.name() {
        let window_s = window_s(model);
        let hz = AVERAGE_3_DB / window_s;
        let u = model.lags_s.first().and_then(|half| half.standard_uncertainty).map(|u| hz * 2.0 * u / window_s);
        return Some(Estimate { value: hz, standard_uncertainty: u });
    }
    if let (Some(a1), Some(a2)) = (model.lags_s.first(), &model.square_s2) {
        return Some(bandwidth_of_second_order(a1, a2));
    }
    let lags: Vec<&Estimate> = model.lags_s.iter().filter(|lag| lag.value > 0.0).collect();
    let longest = lags.iter().map(|lag| lag.value).reduce(f64::max)?;
    let loss = |w: f64| lags.iter().map(|lag| 1.0 + (w * lag.value).powi(2)).product::<f64>();
    // A single lag crosses at 1/T; more lags cross earlier.
    let (mut low, mut high) = (0.0, 1.0 / longest);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if loss(middle) < 2.0 { low = middle } else { high = middle }
    }
    let share = |lag: &Estimate| 1.0 - 1.0 / (1.0 + (high * lag.value).powi(2));
    let all: f64 = lags.iter().map(|lag| share(lag)).sum();
    let relative = lags.iter().map(|lag| Some(share(lag) / all * lag.standard_uncertainty? / lag.value)).sum();
    Some(Estimate {
        value: high / TAU,
        standard_uncertainty: Option::<f64>::map(relative, |relative: f64| relative * high / TAU),
    })
}

/// sin(πx)/(πx) is 1/√2 here.
const AVERAGE_3_DB: f64 = 0.442_946_470_689_452;

/// Length of a moving average, s.
fn window_s(model: &ModelCandidate) -> f64 {
    2.0 * model.lags_s.first().map_or(0.0, |half| half.value)
}

/// Where (1 − a₂ω²)² + a₁²ω² = 2: a₂²x² + bx − 1 = 0 with x = ω² and b = a₁² − 2a₂. The shares of a₁ and a₂, by implicit
/// derivatives, are added as if fully correlated.
fn bandwidth_of_second_order(a1: &Estimate, a2: &Estimate) -> Estimate {
    let (c1, c2) = (a1.value, a2.value);
    let b = c1 * c1 - 2.0 * c2;
    let x = 2.0 / (b + (b * b + 4.0 * c2 * c2).sqrt());
    let w = x.sqrt();
    let slope = 2.0 * w * (b + 2.0 * c2 * c2 * x);
    let by = |e: &Estimate, partial: f64| Some((partial / slope).abs() * e.standard_uncertainty?);
    let u = by(a1, 2.0 * c1 * x).zip(by(a2, 2.0 * x * (c2 * x - 1.0))).map(|(u1, u2)| (u1 + u2) / TAU);
    Estimate { value: w / TAU, standard_uncertainty: u }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A Butterworth filter has half the power at its corner, and a₁/a₂ as in its formula.
    #[test]
    fn a_second_order_filter_has_its_bandwidth_and_response() {
        let known = |value, u| Estimate { value, standard_uncertainty: Some(u) };
        let corner_s = 1.0 / (TAU * 2.0);
        let of = |a1: f64, a2: f64, u: f64| ModelCandidate {
            square_s2: Some(known(a2, u)),
            lags_s: vec![known(a1, u)],
            ..model(Some(0.03), &[], 1.0)
        };
        let (a1, a2) = (2_f64.sqrt() * corner_s, corner_s * corner_s);
        let butterworth = of(a1, a2, 1e-8);
        let found = bandwidth(&butterworth).unwrap();
        assert!((found.value - 2.0).abs() < 1e-12, "{found:?}");
        let at = |a1: f64, a2: f64| bandwidth(&of(a1, a2, 0.0)).unwrap().value;
        let expected = (at(a1 + 1e-8, a2) - at(a1, a2)).abs() + (at(a1, a2 + 1e-8) - at(a1, a2)).abs();
        assert!((found.standard_uncertainty.unwrap() / expected - 1.0).abs() < 1e-3, "{found:?} {expected}");
        let (gain, phase) = gain_and_phase(&butterworth, 2.0);
        let expected = -TAU * 2.0 * 0.03 - 0.25 * TAU;
        assert!((gain - 0.5_f64.sqrt()).abs() < 1e-12 && (phase - expected).abs() < 1e-12, "{gain} {phase}");
    }

    #[test]
    fn a_moving_average_has_its_bandwidth_and_response() {
        let of = |half| ModelCandidate { name: "DA".into(), ..model(Some(0.03), &[half], 1.0) };
        let (average, hz) = (of(0.1), bandwidth(&of(0.1)).unwrap().value);
        let (gain, phase) = gain_and_phase(&average, hz);
        assert!((gain - 0.5_f64.sqrt()).abs() < 1e-12 && (phase + TAU * hz * 0.13).abs() < 1e-12, "{gain} {phase}");
    }

    fn model(delay_s: Option<f64>, lags: &[f64], gain: f64) -> ModelCandidate {
        let known = |value| Estimate { value, standard_uncertainty: None };
        ModelCandidate {
            name: String::new(),
            delta_bic: 0.0,
            delay_s: delay_s.map(known),
            lags_s: lags.iter().copied().map(known).collect(),
            square_s2: None,
            gain: known(gain),
        }
    }

    /// `fopdt` of the acceptance vectors.
    #[test]
    fn the_response_of_a_delay_and_a_lag_matches_the_acceptance_vector() {
        let model = model(Some(0.4), &[0.05], 1.02);
        for (f, gain, phase) in [
            (0.1, 1.019_497_022_459_139_3, -0.282_733_009_513_603_6),
            (0.5, 1.007_644_435_958_584_8, -1.412_443_561_405_459),
            (2.0, 0.863_667_676_284_127_1, -5.587_530_361_852_293),
        ] {
            let (g, p) = gain_and_phase(&model, f);
            assert!((g - gain).abs() < 1e-12 && (p - phase).abs() < 1e-12, "{g} {p}");
        }
    }

    #[test]
    fn one_lag_has_half_power_at_omega_t_one_and_two_lags_earlier() {
        let bandwidth = |model: &ModelCandidate| bandwidth(model).map(|hz| hz.value);
        assert!((bandwidth(&model(None, &[0.05], 1.0)).unwrap() - 3.183_098_861_837_907).abs() < 1e-12);
        assert!((bandwidth(&model(None, &[0.5], 1.0)).unwrap() - 1.0 / (0.5 * TAU)).abs() < 1e-12);
        // (1 + x²)² = 2.
        let x = (2f64.sqrt() - 1.0).sqrt();
        assert!((bandwidth(&model(None, &[0.5, 0.5], 1.0)).unwrap() - x / (0.5 * TAU)).abs() < 1e-12);
        assert_eq!(bandwidth(&model(Some(0.4), &[], 1.0)), None);
    }

    #[test]
    fn a_bandwidth_has_two_digits_of_its_uncertainty() {
        let text = |u| in_hertz(Estimate { value: 1.0412, standard_uncertainty: Some(u) });
        assert_eq!([text(0.105), text(0.0007)], ["1.04 ± 0.21 Hz", "1.0412 ± 0.0014 Hz"]);
    }

    /// By finite differences: each lag longer by its uncertainty.
    #[test]
    fn the_uncertainty_of_a_bandwidth_is_that_of_its_lags() {
        let at = |lags: &[f64]| bandwidth(&model(None, lags, 1.0)).unwrap().value;
        let u = 1e-6;
        for lags in [&[0.05][..], &[0.5, 0.2], &[0.1, 0.1]] {
            let mut known = model(None, lags, 1.0);
            known.lags_s.iter_mut().for_each(|lag| lag.standard_uncertainty = Some(u));
            let found = bandwidth(&known).unwrap().standard_uncertainty.unwrap();
            let longer: Vec<f64> = lags.iter().map(|lag| lag + u).collect();
            let expected = at(lags) - at(&longer);
            assert!((found / expected - 1.0).abs() < 1e-4, "{lags:?}: {found} and {expected}");
        }
        assert_eq!(bandwidth(&model(None, &[0.05], 1.0)).unwrap().standard_uncertainty, None);
    }
}
