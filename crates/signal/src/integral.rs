//! The integral of a velocity that is linear between its samples.

/// `I(t) = ∫ v dτ` from the first sample, with `v` linear between samples and constant before the first and after the
/// last (design note 5.1). Exact at any instant; O(log n) per query.
///
/// Linear interpolation of a velocity with second derivative up to `v″` errs by at most
/// `T h² v″ / 12` over a time `T` (design note 5.1).
#[derive(Debug, Clone)]
pub struct CumulativeIntegral<'a> {
    t: &'a [f64],
    v: &'a [f64],
    prefix: Vec<f64>,
}

impl<'a> CumulativeIntegral<'a> {
    /// Prepares the integral of `v` (unit/s) at the rising times `t` (s).
    ///
    /// # Panics
    /// If the slices are empty or of different length.
    #[must_use]
    pub fn new(t: &'a [f64], v: &'a [f64]) -> CumulativeIntegral<'a> {
        assert!(!t.is_empty() && t.len() == v.len(), "t and v must have the same non-zero length");
        let mut sum = 0.0;
        let mut prefix = Vec::with_capacity(t.len());
        prefix.push(0.0);
        for (t, v) in t.windows(2).zip(v.windows(2)) {
            sum += 0.5 * (v[0] + v[1]) * (t[1] - t[0]);
            prefix.push(sum);
        }
        CumulativeIntegral { t, v, prefix }
    }

    /// The integral from the first sample to `query` (s), in unit.
    #[must_use]
    pub fn at(&self, query: f64) -> f64 {
        let after = self.t.partition_point(|&t| t <= query);
        let Some(k) = after.checked_sub(1) else {
            return self.v[0] * (query - self.t[0]);
        };
        let d = query - self.t[k];
        let slope = match self.t.get(after) {
            Some(next) => (self.v[after] - self.v[k]) / (next - self.t[k]),
            None => 0.0,
        };
        self.prefix[k] + d * (self.v[k] + 0.5 * slope * d)
    }

    /// The integral from `from` to `to` (s), in unit.
    #[must_use]
    pub fn between(&self, from: f64, to: f64) -> f64 {
        self.at(to) - self.at(from)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `cumulative_integral` of the project's acceptance vectors.
    #[test]
    fn the_integral_equals_the_acceptance_vector() {
        let t = [0.0, 0.01, 0.02, 0.035, 0.05, 0.08, 0.081, 0.12, 0.25, 0.26];
        let v = [15.0, 15.2, 15.1, 15.4, 15.0, 14.5, 14.6, 14.0, 12.0, 12.2];
        let query = [-0.1, 0.0, 0.004, 0.03, 0.0805, 0.2, 0.26, 0.3];
        let expected = [-1.5, 0.0, 0.06016, 0.454_5, 1.209_012_5, 2.844_769_230_769_230_7, 3.585, 4.073];
        let integral = CumulativeIntegral::new(&t, &v);
        for (q, e) in query.iter().zip(expected) {
            assert!((integral.at(*q) - e).abs() < 1e-12, "I({q}) = {} instead of {e}", integral.at(*q));
        }
    }

    #[test]
    fn a_single_sample_is_a_constant_velocity() {
        let integral = CumulativeIntegral::new(&[5.0], &[3.0]);
        assert_eq!(integral.between(4.0, 7.0), 9.0);
    }

    #[test]
    fn a_linear_velocity_is_integrated_exactly_with_any_timestamps() {
        let t = [0.0, 0.3, 0.31, 1.7, 2.0];
        let v = t.map(|t| 6.0 * t - 2.0);
        let integral = CumulativeIntegral::new(&t, &v);
        for q in [0.0, 0.05, 0.305, 1.0, 1.99] {
            assert!((integral.at(q) - (3.0 * q * q - 2.0 * q)).abs() < 1e-12);
        }
    }
}
