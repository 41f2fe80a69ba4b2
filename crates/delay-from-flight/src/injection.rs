//! Known delays injected into the flight itself and measured again.
//!
//! The first half is unchanged, the second half is delayed. The two are fitted separately, so their difference must
//! equal the injected delay. A half that shows no delay on its own gives no finding. A delay that differs between the
//! halves shows here as well.

use super::fit::{View, estimate};
use record::FlightInjection;
use signal::{DelayFit, DelaySettings, DelayStart, Measurement, fit_delay_near, student_quantile};

/// Least number of samples of a component in a half.
const LEAST_ROWS: usize = 20;

/// One finding for each delay of the settings that could be injected.
pub(crate) fn injections(view: &View, settings: &DelaySettings) -> Vec<FlightInjection> {
    let Some(split_s) = half_information(view.fit) else { return vec![] };
    let halves = Halves { view, settings, whole: view.record.measurements(), split_s };
    let Some(before) = halves.fit(false, 0.0) else { return vec![] };
    view.settings.inject_s.iter().filter_map(|&injected_s| halves.injection(&before, injected_s)).collect()
}

/// The flight on both sides of an instant.
struct Halves<'a> {
    view: &'a View<'a>,
    settings: &'a DelaySettings,
    whole: Vec<Measurement<'a>>,
    split_s: f64,
}

impl Halves<'_> {
    /// Fits one half, delayed by `delay_s`.
    fn fit(&self, later: bool, delay_s: f64) -> Option<DelayFit> {
        let view = self.view;
        // The noise is that of the whole flight: only the delay is estimated again.
        let part = |c: usize| {
            let m = &self.whole[c];
            let cut = m.t.partition_point(|t| *t < self.split_s);
            let rows = if later { cut..m.t.len() } else { 0..cut };
            let t: Vec<f64> = m.t[rows.clone()].iter().map(|t| t + delay_s).collect();
            (rows.len() >= LEAST_ROWS).then(|| (c, t, &m.y[rows]))
        };
        let parts: Vec<_> = (0..self.whole.len()).filter_map(part).collect();
        let measurements: Vec<Measurement> =
            parts.iter().map(|(c, t, y)| Measurement { t, y, ..self.whole[*c] }).collect();
        let known = |fit: &DelayFit| fit.converged && fit.standard_uncertainty_s <= view.settings.worst_sigma_s;
        let noise = parts.iter().filter_map(|(c, ..)| view.fit.components.get(*c)).map(|c| c.noise).collect();
        let start = DelayStart { delay_s: view.fit.delay_s, noise, keep_noise: true };
        fit_delay_near(&measurements, self.settings, &start).ok().filter(known)
    }

    fn injection(&self, before: &DelayFit, injected_s: f64) -> Option<FlightInjection> {
        let after = self.fit(true, injected_s)?;
        let error = after.delay_s - before.delay_s - injected_s;
        let uncertainty = after.standard_uncertainty_s.hypot(before.standard_uncertainty_s);
        let wide = uncertainty * student_quantile(0.975, before.degrees_of_freedom.min(after.degrees_of_freedom));
        Some(FlightInjection {
            injected_s,
            error_s: estimate(error, uncertainty),
            interval_95_s: [error - wide, error + wide],
            split_s: self.split_s,
        })
    }
}

/// The instant that splits the information in half: half of the squared slope about each component's mean.
fn half_information(fit: &DelayFit) -> Option<f64> {
    let mut information: Vec<(f64, f64)> = vec![];
    for c in &fit.components {
        let mean = c.slope.iter().sum::<f64>() / c.slope.len().max(1) as f64;
        information
            .extend(c.t_used.iter().zip(&c.slope).map(|(t, v)| (*t, (v - mean).powi(2) / c.noise.std().powi(2))));
    }
    information.sort_by(|a, b| a.0.total_cmp(&b.0));
    let total: f64 = information.iter().map(|s| s.1).sum();
    let mut sum = 0.0;
    information
        .iter()
        .find(|s| {
            sum += s.1;
            2.0 * sum >= total
        })
        .map(|s| s.0)
}
