//! Known delays put into the flight itself, and found again.
//!
//! The first half is left as it is, the second half is handed on later. The two are fitted apart, so that their
//! difference must be what was put in. A half that shows no delay on its own gives no finding; a delay that is not the
//! same in both halves shows here as well.

use super::fit::{View, estimate};
use record::FlightInjection;
use signal::{DelayFit, DelaySettings, DelayStart, Measurement, fit_delay_near, student_quantile};

/// Fewest samples of a component that take part in a half.
const LEAST_ROWS: usize = 20;

/// One finding for each delay of the settings that could be put in.
pub(crate) fn injections(view: &View, settings: &DelaySettings) -> Vec<FlightInjection> {
    let Some(split_s) = half_said(view.fit) else { return vec![] };
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
    /// One half, handed on later by `delay_s`.
    fn fit(&self, later: bool, delay_s: f64) -> Option<DelayFit> {
        let view = self.view;
        // The noise is that of the whole: only the delay is to be found again.
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

/// The instant before and after which the motion says as much: half of the squared slope about each component's mean.
fn half_said(fit: &DelayFit) -> Option<f64> {
    let mut said: Vec<(f64, f64)> = vec![];
    for c in &fit.components {
        let mean = c.slope.iter().sum::<f64>() / c.slope.len().max(1) as f64;
        said.extend(c.t_used.iter().zip(&c.slope).map(|(t, v)| (*t, (v - mean).powi(2) / c.noise.std().powi(2))));
    }
    said.sort_by(|a, b| a.0.total_cmp(&b.0));
    let total: f64 = said.iter().map(|s| s.1).sum();
    let mut sum = 0.0;
    said.iter()
        .find(|s| {
            sum += s.1;
            2.0 * sum >= total
        })
        .map(|s| s.0)
}
