//! The trivially exact answer to a pure delay, after the flight.

use signal::{CubicSpline, SplineError};

/// `x_est(t) = p(t + Td)`: the position that arrives Td later, from a spline through all fixes (design note 5.7).
///
/// Not causal, and without velocity: what is left is the noise of the positions and what a spline cannot know between
/// them.
#[derive(Debug, Clone)]
pub struct OfflineShift {
    spline: CubicSpline,
    span: (f64, f64),
    delay_s: f64,
}

impl OfflineShift {
    /// Through positions (m) at rising stamps (s), late by `delay_s`.
    ///
    /// # Errors
    /// As [`CubicSpline::new`]: fewer than two positions, stamps that do not rise, numbers that are not finite.
    pub fn new(position_t: &[f64], position: &[f64], delay_s: f64) -> Result<OfflineShift, SplineError> {
        let spline = CubicSpline::new(position_t, position)?;
        Ok(OfflineShift { spline, span: (position_t[0], position_t[position_t.len() - 1]), delay_s })
    }

    /// The position at `t` (s), m; `None` where no fix is on one of both sides of `t + Td`.
    #[must_use]
    pub fn at(&self, t: f64) -> Option<f64> {
        let at = t + self.delay_s;
        (self.span.0 <= at && at <= self.span.1).then(|| self.spline.value(at))
    }
}
