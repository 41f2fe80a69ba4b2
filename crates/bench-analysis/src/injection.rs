//! Injects known delays and gains into the data and checks that they are recovered.
//!
//! The first half of the record is left as it is; the second half is delayed and scaled, like a slow link with a wrong
//! scale. The difference of two independent estimates must equal the injected values.

use crate::sensed::Circumstances;
use record::{Estimate, Finding, Injection, Recovery};
use signal::{DelayFit, DelaySettings, Measurement, fit_delay};

/// Injects every delay of the rig's list once, with its gain.
pub(crate) fn inject(
    measurements: &[Measurement<'_>],
    settings: &DelaySettings,
    bench: &Circumstances<'_>,
) -> Vec<Injection> {
    let half = |later: bool, delay_s: f64, gain: f64| {
        let middle = moving_middle(bench).ok_or("the bar does not move")?;
        let parts: Vec<Part> = measurements.iter().map(|m| Part::of(m, middle, later, delay_s, gain)).collect();
        let whole: Vec<Measurement<'_>> =
            measurements.iter().zip(&parts).map(|(m, part)| Measurement { t: &part.t, y: &part.y, ..*m }).collect();
        let fit = fit_delay(&whole, settings).map_err(|error| error.to_string())?;
        if fit.converged { Ok(fit) } else { Err("the fit does not converge".to_owned()) }
    };
    let before = half(false, 0.0, 1.0);
    let gain = bench.inject_gain;
    let recovered = |delay_s: f64| {
        let before = before.as_ref().map_err(|why| format!("the first half alone cannot be fitted: {why}"))?;
        let after = half(true, delay_s, gain)
            .map_err(|why| format!("the second half with the injected delay and gain cannot be fitted: {why}"))?;
        Ok(compare(before, &after, delay_s, gain))
    };
    let one = |delay_s: f64| injection(delay_s, gain, recovered(delay_s));
    bench.inject_s.iter().copied().map(one).collect()
}

/// The same list for a channel that cannot be injected.
pub(crate) fn not_injected(bench: &Circumstances<'_>, why: &str) -> Vec<Injection> {
    bench.inject_s.iter().map(|&delay_s| injection(delay_s, bench.inject_gain, Err(why.to_owned()))).collect()
}

fn injection(injected_s: f64, injected_gain: f64, recovered: Result<Recovery, String>) -> Injection {
    Injection { injected_s, injected_gain, recovered: recovered.map_or_else(Finding::CannotTell, Finding::Found) }
}

/// The instant that halves the squared path of the bar: both halves carry the same information.
fn moving_middle(bench: &Circumstances<'_>) -> Option<f64> {
    let total: f64 = bench.rate.iter().map(|r| r * r).sum();
    let mut sum = 0.0;
    let row = bench.rate.iter().position(|r| {
        sum += r * r;
        2.0 * sum >= total
    })?;
    bench.t.get(row).copied()
}

/// One half of a component.
struct Part {
    t: Vec<f64>,
    y: Vec<f64>,
}

impl Part {
    fn of(whole: &Measurement<'_>, middle: f64, later: bool, delay_s: f64, gain: f64) -> Part {
        let split = whole.t.partition_point(|&t| t < middle);
        let rows = if later { split..whole.t.len() } else { 0..split };
        Part {
            t: whole.t[rows.clone()].iter().map(|t| t + delay_s).collect(),
            y: whole.y[rows].iter().map(|y| y * gain).collect(),
        }
    }
}

fn compare(before: &DelayFit, after: &DelayFit, injected_s: f64, injected_gain: f64) -> Recovery {
    let delay_error_s = Estimate {
        value: after.delay_s - before.delay_s - injected_s,
        standard_uncertainty: Some(after.standard_uncertainty_s.hypot(before.standard_uncertainty_s)),
    };
    let gains = before.components.first().zip(after.components.first()).map(|(b, a)| (b.gain, a.gain));
    let gain_error = gains.map_or(Estimate { value: 0.0, standard_uncertainty: None }, |(b, a)| Estimate {
        value: a.value / b.value - injected_gain,
        standard_uncertainty: Some(
            (a.value / b.value) * (a.standard_uncertainty / a.value).hypot(b.standard_uncertainty / b.value),
        ),
    });
    Recovery { delay_error_s, gain_error }
}
