//! Pairs as input to the network.

use crate::isolate::K95;
use record::{DelayPairKind, Estimate, Finding, MeasuredDelay, PairDelay};

/// Measured delay of one pair of channels, or why there is none.
#[derive(Debug, Clone, PartialEq)]
pub struct PairObservation {
    /// Kind of comparison.
    pub kind: DelayPairKind,
    /// First channel, such as `position.gps`.
    pub first: String,
    /// Second channel, or two as `attitude.ins + specific-force.imu`.
    pub second: String,
    /// Lateness of the first less that of the second, s, with the standard uncertainty from noise; or why it was not
    /// measured.
    pub delay_s: Finding<Estimate>,
    /// Standard uncertainty for what one delay does not explain in this pair, such as a delay that depends on
    /// frequency, s. No other pair shares it.
    pub widened_s: f64,
    /// What the 95 % interval has beyond ±1.96 standard uncertainties because few windows were measured (Student's t),
    /// as a standard uncertainty to be added in quadrature, s.
    pub few_windows_s: f64,
    /// Reason not to use a measured delay, `None` to use it.
    pub not_used: Option<String>,
}

impl PairObservation {
    /// Pair with a delay, s, and its standard uncertainty, s.
    #[must_use]
    pub fn measured(kind: DelayPairKind, first: &str, second: &str, delay_s: f64, standard_uncertainty_s: f64) -> Self {
        let delay_s = Estimate { value: delay_s, standard_uncertainty: Some(standard_uncertainty_s) };
        PairObservation {
            kind,
            first: first.to_owned(),
            second: second.to_owned(),
            delay_s: Finding::Found(delay_s),
            widened_s: 0.0,
            few_windows_s: 0.0,
            not_used: None,
        }
    }

    /// The same pair, listed but not used.
    #[must_use]
    pub fn not_used(self, why: impl Into<String>) -> Self {
        PairObservation { not_used: Some(why.into()), ..self }
    }
}

impl From<&PairDelay> for PairObservation {
    fn from(pair: &PairDelay) -> Self {
        let (delay_s, widened_s, few_windows_s) = match &pair.delay {
            Finding::Found(delay) => (Finding::Found(without_widening(delay)), delay.widened_s, few_windows_s(delay)),
            Finding::CannotTell(why) => (Finding::CannotTell(why.clone()), 0.0, 0.0),
        };
        PairObservation {
            kind: pair.kind,
            first: pair.first.clone(),
            second: pair.second.clone(),
            delay_s,
            widened_s,
            few_windows_s,
            not_used: None,
        }
    }
}

fn few_windows_s(delay: &MeasuredDelay) -> f64 {
    let [low, high] = delay.interval_95_s;
    let beyond = |u: f64| ((0.5 * (high - low) / K95).powi(2) - u.powi(2)).max(0.0).sqrt();
    delay.delay_s.standard_uncertainty.map_or(0.0, beyond)
}

fn without_widening(delay: &MeasuredDelay) -> Estimate {
    let noise = |u: f64| (u.powi(2) - delay.widened_s.powi(2)).max(0.0).sqrt().max(delay.hessian_s);
    Estimate { standard_uncertainty: delay.delay_s.standard_uncertainty.map(noise), ..delay.delay_s }
}

/// Pair with its node names and a usable number.
#[derive(Debug)]
pub(crate) struct Usable {
    pub(crate) kind: DelayPairKind,
    pub(crate) first: String,
    pub(crate) second: String,
    pub(crate) delay: Estimate,
    pub(crate) uncertainty_s: f64,
    pub(crate) widened_s: f64,
    pub(crate) few_windows_s: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measured(standard_uncertainty: Option<f64>, widened_s: f64, hessian_s: f64) -> Option<f64> {
        let text = format!(
            r#"{{"delay_s": {{"value": 0.2, "standard_uncertainty": null}}, "interval_95_s": [0.1, 0.3], "hessian_s": {hessian_s},
            "hac_s": 0.0, "widened_s": {widened_s}, "crlb_s": 0.0, "smallest_detectable_s": 0.0, "samples": 100,
            "downweighted_share": 0.18, "rival_s": null, "pieces": [], "over_time": [], "homogeneity": null, "alarm": null,
            "splits": [], "injections": []}}"#
        );
        let mut delay: MeasuredDelay = serde_json::from_str(&text).unwrap();
        delay.delay_s.standard_uncertainty = standard_uncertainty;
        let without = without_widening(&delay);
        assert_eq!(without.value, 0.2);
        without.standard_uncertainty
    }

    /// Student's t of 5 degrees of freedom: 2.571 · 10 ms = 1.96 · √(10² + 8.489²) ms.
    #[test]
    fn an_interval_of_few_windows_is_wider_than_196_standard_uncertainties() {
        let text = |half: f64, u: &str| {
            format!(
                r#"{{"delay_s": {{"value": 0.2, "standard_uncertainty": {u}}}, "interval_95_s": [{}, {}], "hessian_s": 0.01,
                "hac_s": 0.0, "widened_s": 0.0, "crlb_s": 0.0, "smallest_detectable_s": 0.0, "samples": 100,
                "downweighted_share": 0.18, "rival_s": null, "pieces": [], "over_time": [], "homogeneity": null,
                "alarm": null, "splits": [], "injections": []}}"#,
                0.2 - half,
                0.2 + half
            )
        };
        let beyond = |half, u: &str| few_windows_s(&serde_json::from_str(&text(half, u)).unwrap());
        assert!((beyond(0.02571, "0.01") - 0.008489).abs() < 1e-6, "{}", beyond(0.02571, "0.01"));
        assert_eq!(beyond(0.0195, "0.01"), 0.0, "never narrower");
        assert_eq!(beyond(0.02571, "null"), 0.0);
    }

    /// Variances add up: 3² + 4² = 5².
    #[test]
    fn the_uncertainty_without_widening_is_noise_or_curvature() {
        let near = |a: Option<f64>, b: f64| (a.unwrap() - b).abs() < 1e-15;
        assert!(near(measured(Some(0.005), 0.004, 0.001), 0.003));
        assert!(near(measured(Some(0.005), 0.0, 0.001), 0.005));
        assert!(near(measured(Some(0.005), 0.004, 0.0035), 0.0035));
        assert!(near(measured(Some(0.005), 0.006, 0.002), 0.002));
        assert_eq!(measured(None, 0.004, 0.001), None);
    }
}
