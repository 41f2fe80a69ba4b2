//! Effect of errors of the values on the delay.

use crate::delay::block::Block;
use crate::delay::{ComponentFit, DelayFit, Measurement};
use crate::whiten::WhiteningFilter;

/// Response of the delay of a fit to errors of the values, to first order; gain, offset, drift, noise and weights as in
/// the fit. An error of the reference is equivalent to one of the values: the same times the gain, with the opposite
/// sign.
pub struct DelayResponse {
    /// Per component: the whitening of its values, and the resulting slope over the delay.
    parts: Vec<(WhiteningFilter, Vec<f64>)>,
    power: f64,
}

impl DelayResponse {
    /// For the fit of `components`. `None` if it has no slope.
    #[must_use]
    pub fn of(components: &[Measurement], fit: &DelayFit) -> Option<DelayResponse> {
        let part = |(m, f): (&Measurement, &ComponentFit)| {
            let (filter, [_, slope]) = whitened(m, f, fit.delay_s);
            (filter, slope)
        };
        let parts: Vec<_> = components.iter().zip(&fit.components).map(part).collect();
        let power: f64 = parts.iter().flat_map(|(_, slope)| slope).map(|s| s * s).sum();
        (power > 0.0).then_some(DelayResponse { parts, power })
    }

    /// Increase of the delay, s, if the used rows of each component measure `errors` more: one series for each
    /// component, one value for each of its used rows. `None` if the lengths do not match.
    #[must_use]
    pub fn shift_s(&self, errors: &[Vec<f64>]) -> Option<f64> {
        let fits = errors.len() == self.parts.len()
            && errors.iter().zip(&self.parts).all(|(error, (_, slope))| error.len() == slope.len());
        let along = |((filter, slope), error): (&(WhiteningFilter, Vec<f64>), &Vec<f64>)| {
            let mut white = error.clone();
            filter.apply([&mut white]);
            slope.iter().zip(&white).map(|(s, e)| s * e).sum::<f64>()
        };
        fits.then(|| self.parts.iter().zip(errors).map(along).sum::<f64>() / self.power)
    }
}

/// Response of the gain of one component of a fit to errors of its measured values, with the fitted noise.
#[derive(Debug, Clone)]
pub struct GainResponse {
    /// The whitening of its values, and the resulting reference minus the part that offset and drift explain.
    part: (WhiteningFilter, Vec<f64>),
    power: f64,
}

impl GainResponse {
    /// For the component `m` with the fit `f`, at the delay `delay_s`. `None` if the reference does not move.
    #[must_use]
    pub fn of(m: &Measurement, f: &ComponentFit, delay_s: f64) -> Option<GainResponse> {
        let (filter, [value, _]) = whitened(m, f, delay_s);
        let power: f64 = value.iter().map(|v| v * v).sum();
        (power > 0.0).then_some(GainResponse { part: (filter, value), power })
    }

    /// Increase of the gain if the used rows measure `errors` more; `None` if the lengths do not match.
    #[must_use]
    pub fn shift(&self, errors: &[f64]) -> Option<f64> {
        let (filter, value) = &self.part;
        (errors.len() == value.len()).then(|| {
            let mut white = errors.to_vec();
            filter.apply([&mut white]);
            value.iter().zip(&white).map(|(v, e)| v * e).sum::<f64>() / self.power
        })
    }
}

/// The whitening of the values of a component, and its white columns: the reference, and the slope over the delay minus
/// the part that the gain explains; both without offset and drift.
fn whitened(m: &Measurement, f: &ComponentFit, delay_s: f64) -> (WhiteningFilter, [Vec<f64>; 2]) {
    let mut block = Block::new(m, f.used_rows.clone(), &f.noise, Some(&f.weights), 1);
    for (k, t) in f.t_used.iter().enumerate() {
        let (value, rate) = m.reference.value_and_rate(t - delay_s);
        block.columns[0][k] = value;
        block.columns[1][k] = -rate;
    }
    block.project();
    let slope = block.columns.pop().unwrap_or_default();
    (block.filter, [block.columns.pop().unwrap_or_default(), slope])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{CubicSpline, DelaySettings, Gain, Sign, fit_delay};

    /// With the same noise and a small error added, the fit moves as predicted.
    #[test]
    fn the_fit_moves_as_predicted() {
        let knots: Vec<f64> = (0..=1500).map(|k| 0.02 * f64::from(k)).collect();
        let truth: Vec<f64> = knots.iter().map(|t| (3.4 * t + 2.0 * (0.21 * t).sin()).sin()).collect();
        let reference = CubicSpline::new(&knots, &truth).unwrap();
        let t: Vec<f64> = (0..250).map(|k| 2.0 + 0.1 * f64::from(k)).collect();
        let noise = |k: usize| 0.05 * (1.2345 * (k * k) as f64).sin();
        let error: Vec<f64> = t.iter().map(|t| 1e-3 * (3.1 * t).cos() + 2e-4 * t).collect();
        let fit = |with: f64| {
            let values = t.iter().enumerate().map(|(k, t)| 1.1 * reference.value(t - 0.4) + noise(k) + with * error[k]);
            let y: Vec<f64> = values.collect();
            let gain = Gain::Free { sign: Sign::Positive };
            let m = [Measurement { t: &t, y: &y, reference: &reference, gain, drift: false }];
            let fit = fit_delay(&m, &DelaySettings { robust: false, ..DelaySettings::default() }).unwrap();
            let used: Vec<f64> = fit.components[0].used_rows.iter().map(|&k| error[k]).collect();
            let response = DelayResponse::of(&m, &fit).unwrap();
            (fit.delay_s, response.shift_s(&[used]).unwrap(), response.shift_s(&[vec![0.0]]))
        };
        let ((before, predicted, wrong_length), (after, ..)) = (fit(0.0), fit(1.0));
        assert!(predicted.abs() > 5e-5 && (after - before - predicted).abs() < 0.03 * predicted.abs(), "{predicted}");
        assert_eq!(wrong_length, None);
    }
}
