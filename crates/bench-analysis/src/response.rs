//! Frequency response of a channel, together with the fitted model (design note 9).

use crate::sensed::{SensedChannel, Updates};
use record::{Estimate, Finding, ModelCandidate, ModelFinding, ResponseFinding, ResponsePoint};
use signal::{ComponentFit, DelayFit, frequency_response};
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

/// Gain and phase of `K e^{−sτ} / Π(1 + sT)` at `f` Hz.
fn gain_and_phase(model: &ModelCandidate, f: f64) -> (f64, f64) {
    let w = TAU * f;
    let delay_s = model.delay_s.map_or(0.0, |d| d.value);
    let lags = || model.lags_s.iter().map(|lag| lag.value);
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

#[cfg(test)]
mod tests {
    use super::*;

    fn model(delay_s: Option<f64>, lags: &[f64], gain: f64) -> ModelCandidate {
        let known = |value| Estimate { value, standard_uncertainty: None };
        ModelCandidate {
            name: String::new(),
            delta_bic: 0.0,
            delay_s: delay_s.map(known),
            lags_s: lags.iter().copied().map(known).collect(),
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
