//! A reference as a slow sensor shows it.

use crate::reference::Reference;
use nalgebra::{Complex, ComplexField};

/// A reference after first-order lags, `r/((1 + sT₁)(1 + sT₂)…)`, or a second-order filter, on a fine grid.
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

    /// `reference` after the low-pass filter `1/(1 + a₁s + a₂s²)` (s and s²) whose poles are complex (`4a₂ > a₁² > 0`), on such a
    /// grid. `None` if the reference has no duration.
    #[must_use]
    pub fn second_order(reference: &dyn Reference, [a1, a2]: [f64; 2], step_s: f64) -> Option<LaggedReference> {
        Some(LaggedReference::sampled(reference, step_s)?.after_second_order([a1, a2]))
    }

    /// Mean of `reference` over `window_s` (s) around each time, on such a grid. `None` if the reference has no duration.
    #[must_use]
    pub fn moving_average(reference: &dyn Reference, window_s: f64, step_s: f64) -> Option<LaggedReference> {
        Some(LaggedReference::sampled(reference, step_s)?.averaged(window_s))
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

    /// Applies the filter `1/(1 + a₁s + a₂s²)` with complex poles.
    ///
    /// With the complex lag T = a₁/2 + ib of |T|² = a₂ it is 2 Re(c/(1 + sT)), c = T/(2ib).
    pub(crate) fn after_second_order(&self, [a1, a2]: [f64; 2]) -> LaggedReference {
        let half = 0.5 * a1;
        let lag = Complex::new(half, (a2 - half * half).max(0.0).sqrt());
        let c = lag / Complex::new(0.0, 2.0 * lag.im);
        let lagged = self.lagged(lag);
        let values = lagged.iter().map(|y| 2.0 * (c * y).re).collect();
        let rates = self.values.iter().zip(&lagged).map(|(x, y)| 2.0 * (c * (x - y) / lag).re).collect();
        LaggedReference { values, rates, ..*self }
    }

    /// Mean over `window_s` around each time. Before its start and after its end the reference counts as steady.
    pub(crate) fn averaged(&self, window_s: f64) -> LaggedReference {
        let half = 0.5 * window_s;
        let integral = self.integral();
        let at = |k: usize| self.start + self.step_s * k as f64;
        let mean = |k: usize| {
            (self.integral_at(&integral, at(k) + half) - self.integral_at(&integral, at(k) - half)) / window_s
        };
        let rate = |k: usize| (self.value_and_rate(at(k) + half).0 - self.value_and_rate(at(k) - half).0) / window_s;
        let n = self.values.len();
        LaggedReference { values: (0..n).map(mean).collect(), rates: (0..n).map(rate).collect(), ..*self }
    }

    /// Integral from the start to each grid point.
    fn integral(&self) -> Vec<f64> {
        let h = self.step_s;
        let mut sum = 0.0;
        let mut out = vec![0.0];
        for (y, d) in self.values.windows(2).zip(self.rates.windows(2)) {
            sum += 0.5 * h * (y[0] + y[1]) + h * h * (d[0] - d[1]) / 12.0;
            out.push(sum);
        }
        out
    }

    fn integral_at(&self, integral: &[f64], t: f64) -> f64 {
        let (start, end) = self.span();
        if t > end {
            return integral[integral.len() - 1] + (t - end) * self.values[self.values.len() - 1];
        }
        if t < start {
            return (t - start) * self.values[0];
        }
        let (k, x) = self.place(t);
        let h = self.step_s;
        let (y0, y1, d0, d1) = (self.values[k], self.values[k + 1], self.rates[k] * h, self.rates[k + 1] * h);
        let (c2, c3) = (3.0 * (y1 - y0) - 2.0 * d0 - d1, 2.0 * (y0 - y1) + d0 + d1);
        integral[k] + h * x * (y0 + x * (d0 / 2.0 + x * (c2 / 3.0 + x * c3 / 4.0)))
    }

    /// y of T·y′ + y = x on the grid, y = x at its start, for a real or a complex T.
    fn lagged<T: ComplexField<RealField = f64> + Copy>(&self, lag_s: T) -> Vec<T> {
        let z = T::from_real(self.step_s) / lag_s;
        let decay = (-z).exp();
        let [m0, m1, m2, m3] = moments(z);
        let mut y = T::from_real(self.values[0]);
        let mut out = Vec::with_capacity(self.values.len());
        out.push(y);
        for (x, d) in self.values.windows(2).zip(self.rates.windows(2)) {
            let (rise, d0, d1) = (x[1] - x[0], d[0] * self.step_s, d[1] * self.step_s);
            let (c2, c3) = (3.0 * rise - 2.0 * d0 - d1, d0 + d1 - 2.0 * rise);
            y = decay * y + (m0.scale(x[0]) + m1.scale(d0) + m2.scale(c2) + m3.scale(c3));
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
fn moments<T: ComplexField<RealField = f64> + Copy>(z: T) -> [T; 4] {
    let of = T::from_real;
    if z.modulus() > 2.0 {
        let m0 = of(1.0) - (-z).exp();
        let m1 = of(1.0) - m0 / z;
        let m2 = of(1.0) - m1.scale(2.0) / z;
        return [m0, m1, m2, of(1.0) - m2.scale(3.0) / z];
    }
    // z · j! Σ (−z)ᵏ/(k + j + 1)!, avoiding differences that cancel for a long lag.
    std::array::from_fn(|j| {
        let mut term = z.unscale((j + 1) as f64);
        let mut sum = term;
        for k in 1..26 {
            term *= -z.unscale((k + j + 1) as f64);
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

    /// Gain and phase of 1/(1 + a₁s + a₂s²): a Butterworth filter of 2 Hz, and a nearly critical one.
    #[test]
    fn a_sine_after_a_second_order_filter_has_the_gain_and_phase_of_the_formula() {
        let cut = 1.0 / (TAU * 2.0);
        for [a1, a2] in [[2_f64.sqrt() * cut, cut * cut], [0.2, 0.0101]] {
            for f in [0.3, 1.0, 2.5] {
                let w = TAU * f;
                let response = Complex::new(1.0 - a2 * w * w, a1 * w).inv();
                let filtered = LaggedReference::second_order(&Sine(f), [a1, a2], 0.005).unwrap();
                for k in 0..50 {
                    let t = 8.0 + 0.437 * f64::from(k);
                    let expected = response.norm() * (w * t + response.arg()).sin();
                    let rate = w * response.norm() * (w * t + response.arg()).cos();
                    let (found, found_rate) = filtered.value_and_rate(t);
                    assert!((found - expected).abs() < 1e-6, "{f} Hz at {t} s: {found} instead of {expected}");
                    assert!((found_rate - rate).abs() < 1e-4 * w, "{f} Hz at {t} s: {found_rate} instead of {rate}");
                }
            }
        }
    }

    /// Gain of a moving average: sin(πfT)/(πfT), without a shift.
    #[test]
    fn a_sine_after_a_moving_average_has_the_gain_of_the_formula() {
        for (f, window) in [(0.5, 0.2), (1.3, 0.2), (0.7, 0.033)] {
            let averaged = LaggedReference::moving_average(&Sine(f), window, 0.01).unwrap();
            let x = 0.5 * TAU * f * window;
            for k in 0..50 {
                let t = 3.0 + 0.437 * f64::from(k);
                let (value, rate) = averaged.value_and_rate(t);
                let expected = x.sin() / x * (TAU * f * t).sin();
                assert!((value - expected).abs() < 1e-6, "{f} Hz at {t} s: {value} instead of {expected}");
                assert!((rate - TAU * f * x.sin() / x * (TAU * f * t).cos()).abs() < 1e-4, "{f} Hz at {t} s");
            }
        }
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
