//! Rate of timestamps.

/// Rate by the median step of the timestamps `t` in s, in Hz; `None` if that step is not positive.
pub(crate) fn rate_hz(t: &[f64]) -> Option<f64> {
    signal::median_step(t).filter(|step| *step > 0.0).map(|step| 1.0 / step)
}
