//! The trivially exact solution for a pure delay, after the flight.

use signal::{CubicSpline, SplineError};

/// `x_est(t) = p(t + Td)`: the position that arrives Td later, from a spline through all fixes (design note 5.7).
///
/// Not causal, and without velocity. The remaining error is the noise of the positions and the interpolation error of
/// the spline.
#[derive(Debug, Clone)]
pub struct OfflineShift {
    spline: CubicSpline,
    span: (f64, f64),
    delay_s: f64,
}

impl OfflineShift {
    /// Through positions (m) at rising timestamps (s), late by `delay_s`.
    ///
    /// # Errors
    /// As [`CubicSpline::new`]: fewer than two positions, timestamps that do not rise, numbers that are not finite.
    pub fn new(position_t: &[f64], position: &[f64], delay_s: f64) -> Result<OfflineShift, SplineError> {
        let spline = CubicSpline::new(position_t, position)?;
        Ok(OfflineShift { spline, span: (position_t[0], position_t[position_t.len() - 1]), delay_s })
    }

    /// The position at `t` (s), m; `None` unless there are fixes on both sides of `t + Td`.
    #[must_use]
    pub fn at(&self, t: f64) -> Option<f64> {
        let at = t + self.delay_s;
        (self.span.0 <= at && at <= self.span.1).then(|| self.spline.value(at))
    }
}
