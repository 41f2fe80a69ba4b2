//! The exact compensator for any rates and drop-outs.

use signal::CumulativeIntegral;

/// `x_est(t) = p_j + I(t) − I(t_j − Td)` (design note 5.1), one axis.
///
/// With a fix at every velocity sample this is `G(s) = (1 − e^{−s Td})/s` itself. Between fixes it dead-reckons from
/// the newest one. Its only error is that of `∫v`.
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

    /// The position at `now` (s) from a fix `position` (m) with timestamp `stamp` (s).
    #[must_use]
    pub fn at(&self, now: f64, position: f64, stamp: f64) -> f64 {
        position + self.integral.between(stamp - self.delay_s, now)
    }

    /// Displacement from velocity between two instants, m.
    #[must_use]
    pub fn flown(&self, from: f64, to: f64) -> f64 {
        self.integral.between(from, to)
    }
}
