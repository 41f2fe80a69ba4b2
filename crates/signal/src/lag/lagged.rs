//! A reference as a slow sensor shows it.

use crate::reference::Reference;

/// A reference after first-order lags, `r/((1 + sT₁)(1 + sT₂)…)`, on a fine grid.
///
/// Between grid points, reference and result are cubic Hermite curves, and the lag is the exact solution for such an
/// input: the error falls with the fourth power of the step, that of the textbook ramp-invariant recursion with the
/// second. The reference is assumed steady before its start, which affects the first few `T`.
#[derive(Debug, Clone)]
pub struct LaggedReference {
    start: f64,
    step_s: f64,
    pub(crate) values: Vec<f64>,
    pub(crate) rates: Vec<f64>,
}

impl LaggedReference {
    /// `reference` after `lags_s` (s; non-positive ones are ignored), on a grid of about `step_s` seconds, which should
    /// be a thirtieth of the shortest period or less. `None` if the reference has no duration.
    #[must_use]
    pub fn new(reference: &dyn Reference, lags_s: &[f64], step_s: f64) -> Option<LaggedReference> {
        let plain = LaggedReference::sampled(reference, step_s)?;
        Some(lags_s.iter().fold(plain, |r, lag_s| r.after(*lag_s)))
    }

    /// `reference` on the grid, without a lag.
    pub(crate) fn sampled(reference: &dyn Reference, step_s: f64) -> Option<LaggedReference> {
        let (start, end) = reference.span();
        let steps = ((end - start) / step_s).ceil();
        if !(end > start && step_s > 0.0 && steps < 1e8) {
            return None;
        }
        let step_s = (end - start) / steps;
        let at = |k: usize| reference.value_and_rate((start + step_s * k as f64).min(end));
        let (values, rates) = (0..=steps as usize).map(at).unzip();
        Some(LaggedReference { start, step_s, values, rates })
    }

    /// Applies one more lag.
    pub(crate) fn after(&self, lag_s: f64) -> LaggedReference {
        if lag_s.is_nan() || lag_s <= SHORTEST_LAG_S {
            return self.clone();
        }
        let values = self.lagged(lag_s);
        let rates = self.values.iter().zip(&values).map(|(x, y)| (x - y) / lag_s).collect();
        LaggedReference { values, rates, ..*self }
    }

    /// y of T·y′ + y = x on the grid, y = x at its start.
    fn lagged(&self, lag_s: f64) -> Vec<f64> {
        let z = self.step_s / lag_s;
        let decay = (-z).exp();
        let [m0, m1, m2, m3] = moments(z);
        let mut y = self.values[0];
        let mut out = Vec::with_capacity(self.values.len());
        out.push(y);
        for (x, d) in self.values.windows(2).zip(self.rates.windows(2)) {
            let (rise, d0, d1) = (x[1] - x[0], d[0] * self.step_s, d[1] * self.step_s);
            let (c2, c3) = (3.0 * rise - 2.0 * d0 - d1, d0 + d1 - 2.0 * rise);
            y = decay * y + (m0 * x[0] + m1 * d0 + m2 * c2 + m3 * c3);
            out.push(y);
        }
        out
    }

    /// Second derivative at the grid points.
    pub(crate) fn curvatures(&self) -> Vec<f64> {
        let n = self.rates.len();
        let at = |k: usize| {
            let (a, b) = (k.saturating_sub(1), (k + 1).min(n - 1));
            (self.rates[b] - self.rates[a]) / ((b - a) as f64 * self.step_s)
        };
        (0..n).map(at).collect()
    }

    /// Grid point before `t`, and the fraction of the step to the next one, 0 to 1.
    pub(crate) fn place(&self, t: f64) -> (usize, f64) {
        let x = ((t - self.start) / self.step_s).clamp(0.0, (self.values.len() - 1) as f64);
        let k = (x as usize).min(self.values.len() - 2);
        (k, x - k as f64)
    }

    pub(crate) fn value_and_rate_at(&self, (k, x): (usize, f64)) -> (f64, f64) {
        let h = self.step_s;
        let (y0, y1, d0, d1) = (self.values[k], self.values[k + 1], self.rates[k] * h, self.rates[k + 1] * h);
        let (c2, c3) = (3.0 * (y1 - y0) - 2.0 * d0 - d1, 2.0 * (y0 - y1) + d0 + d1);
        (y0 + x * (d0 + x * (c2 + x * c3)), (d0 + x * (2.0 * c2 + x * 3.0 * c3)) / h)
    }
}

impl Reference for LaggedReference {
    fn span(&self) -> (f64, f64) {
        (self.start, self.start + self.step_s * (self.values.len() - 1) as f64)
    }

    fn value_and_rate(&self, t: f64) -> (f64, f64) {
        self.value_and_rate_at(self.place(t))
    }
}

/// A lag below this has no visible effect, s.
const SHORTEST_LAG_S: f64 = 1e-6;

/// z ∫₀¹ e^{−z(1−s)} sʲ ds for j = 0 to 3: effect of a lag of 1/z steps on a power within one step.
fn moments(z: f64) -> [f64; 4] {
    if z > 2.0 {
        let m0 = -(-z).exp_m1();
        let m1 = 1.0 - m0 / z;
        let m2 = 1.0 - 2.0 * m1 / z;
        return [m0, m1, m2, 1.0 - 3.0 * m2 / z];
    }
    // z · j! Σ (−z)ᵏ/(k + j + 1)!, avoiding differences that cancel for a long lag.
    std::array::from_fn(|j| {
        let mut term = z / (j + 1) as f64;
        let mut sum = term;
        for k in 1..26 {
            term *= -z / (k + j + 1) as f64;
            sum += term;
        }
        sum
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    struct Sine(f64);

    impl Reference for Sine {
        fn span(&self) -> (f64, f64) {
            (0.0, 30.0)
        }

        fn value_and_rate(&self, t: f64) -> (f64, f64) {
            ((TAU * self.0 * t).sin(), TAU * self.0 * (TAU * self.0 * t).cos())
        }
    }

    /// `fopdt` of the project's acceptance vectors: gain and phase of 1.02·e^{−0.4s}/(1 + 0.05s).
    #[test]
    fn a_lagged_and_delayed_sine_matches_the_acceptance_vector() {
        let vectors: serde_json::Value = serde_json::from_str(include_str!("../../tests/delay_vectors.json")).unwrap();
        let case = &vectors["fopdt"];
        let number = |v: &serde_json::Value| v.as_f64().unwrap();
        let (gain, delay, lag) = (number(&case["K"]), number(&case["tau"]), number(&case["T1"]));
        for row in case["rows"].as_array().unwrap() {
            let f = number(&row["f"]);
            let lagged = LaggedReference::new(&Sine(f), &[lag], 0.01).unwrap();
            let (modulus, phase) = (number(&row["gain"]), number(&row["phase_rad_unwrapped"]));
            for k in 0..50 {
                let t = 5.0 + 0.437 * f64::from(k);
                let expected = modulus * (TAU * f * t + phase).sin();
                let found = gain * lagged.value_and_rate(t - delay).0;
                assert!((found - expected).abs() < 1e-6, "{f} Hz at {t} s: {found} instead of {expected}");
            }
        }
        let apparent = (TAU * 0.55 * 0.4f64).atan() / (TAU * 0.55);
        assert!((apparent - number(&case["apparent_delay_of_lag_0p4_at_0p55Hz"])).abs() < 1e-12);
    }

    #[test]
    fn moments_of_a_step_are_the_same_by_series_and_by_recursion() {
        let (below, above) = (moments(2.0), moments(2.0 + 1e-12));
        assert!(below.iter().zip(above).all(|(a, b)| (a - b).abs() < 1e-11), "{below:?} {above:?}");
        // A lag of a million steps passes a millionth of the mean of sʲ.
        let long = moments(1e-6);
        assert!((0..4).all(|j| (long[j] * 1e6 * (j + 1) as f64 - 1.0).abs() < 1e-6));
    }

    #[test]
    fn a_ramp_is_late_by_the_lag() {
        struct Ramp;
        impl Reference for Ramp {
            fn span(&self) -> (f64, f64) {
                (0.0, 10.0)
            }
            fn value_and_rate(&self, t: f64) -> (f64, f64) {
                (2.0 * t, 2.0)
            }
        }
        let lagged = LaggedReference::new(&Ramp, &[0.3, 0.1], 0.01).unwrap();
        for t in [7.0, 8.123, 10.0] {
            assert!((lagged.value_and_rate(t).0 - 2.0 * (t - 0.4)).abs() < 1e-9);
            assert!((lagged.value_and_rate(t).1 - 2.0).abs() < 1e-7);
        }
    }
}
