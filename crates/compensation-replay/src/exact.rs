//! The exact compensator for any rates and drop-outs.

use signal::CumulativeIntegral;

/// `x_est(t) = p_j + I(t) − I(t_j − Td)` (design note 5.1), one axis.
///
/// With fixes at every velocity sample this is `G(s) = (1 − e^{−s Td})/s` itself; between fixes
/// it dead-reckons from the newest one. Its only error is that of `∫v`.
#[derive(Debug, Clone)]
pub struct ExactAsync<'a> {
    integral: CumulativeIntegral<'a>,
    delay_s: f64,
}

impl<'a> ExactAsync<'a> {
    /// For velocities `v` (m/s) at the rising times `t` (s) and positions late by `delay_s`.
    ///
    /// # Panics
    /// If the slices are empty or of different length.
    #[must_use]
    pub fn new(t: &'a [f64], v: &'a [f64], delay_s: f64) -> ExactAsync<'a> {
        ExactAsync { integral: CumulativeIntegral::new(t, v), delay_s }
    }

    /// The position at `now` (s) from a fix `position` (m) stamped `stamp` (s).
    #[must_use]
    pub fn at(&self, now: f64, position: f64, stamp: f64) -> f64 {
        position + self.integral.between(stamp - self.delay_s, now)
    }

    /// What velocity says was flown between two instants, m.
    #[must_use]
    pub fn flown(&self, from: f64, to: f64) -> f64 {
        self.integral.between(from, to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `exact_async` of the acceptance vectors: p = 3t² − 2t + 1, v at 10 Hz, p at 4 Hz and 0.4 s late.
    #[test]
    fn a_quadratic_track_is_recovered_exactly() {
        let t: Vec<f64> = (0..=20).map(|k| f64::from(k) / 10.0).collect();
        let v: Vec<f64> = t.iter().map(|t| 6.0 * t - 2.0).collect();
        let stamps = [0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0];
        let measured = [0.83, 0.6675, 0.88, 1.4675, 2.43, 3.7675, 5.48];
        let compensator = ExactAsync::new(&t, &v, 0.4);
        for (now, expected) in
            [(0.5, 0.75), (0.6, 0.88), (0.74, 1.1628), (0.75, 1.1875), (1.0, 2.0), (1.33, 3.6467), (2.0, 9.0)]
        {
            let j = stamps.iter().rposition(|s| *s <= now).unwrap();
            let found = compensator.at(now, measured[j], stamps[j]);
            assert!((found - expected).abs() < 1e-10, "x_est({now}) = {found} instead of {expected}");
        }
    }
}
