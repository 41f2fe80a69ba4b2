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
    let whole = view.record.measurements();
    let half = |later: bool, delay_s: f64| -> Option<DelayFit> {
        // The noise is that of the whole: only the delay is to be found again.
        let parts: Vec<(usize, Vec<f64>, &[f64])> = whole
            .iter()
            .enumerate()
            .filter_map(|(c, m)| {
                let cut = m.t.partition_point(|t| *t < split_s);
                let rows = if later { cut..m.t.len() } else { 0..cut };
                (rows.len() >= LEAST_ROWS)
                    .then(|| (c, m.t[rows.clone()].iter().map(|t| t + delay_s).collect(), &m.y[rows]))
            })
            .collect();
        let measurements: Vec<Measurement> = parts.iter().map(|(c, t, y)| Measurement { t, y, ..whole[*c] }).collect();
        let known = |fit: &DelayFit| fit.converged && fit.standard_uncertainty_s <= view.settings.worst_sigma_s;
        let noise = parts.iter().filter_map(|(c, ..)| view.fit.components.get(*c)).map(|c| c.noise).collect();
        let start = DelayStart { delay_s: view.fit.delay_s, noise, keep_noise: true };
        fit_delay_near(&measurements, settings, &start).ok().filter(known)
    };
    let Some(before) = half(false, 0.0) else { return vec![] };
    let one = |&injected_s: &f64| {
        let after = half(true, injected_s)?;
        let error = after.delay_s - before.delay_s - injected_s;
        let uncertainty = after.standard_uncertainty_s.hypot(before.standard_uncertainty_s);
        let wide = uncertainty * student_quantile(0.975, before.degrees_of_freedom.min(after.degrees_of_freedom));
        Some(FlightInjection {
            injected_s,
            error_s: estimate(error, uncertainty),
            interval_95_s: [error - wide, error + wide],
            split_s,
        })
    };
    view.settings.inject_s.iter().filter_map(one).collect()
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
