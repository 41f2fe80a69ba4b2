//! Step and rate of timestamps.

/// Median step of the timestamps `t`, in s; `None` for fewer than two.
pub(crate) fn median_step(t: &[f64]) -> Option<f64> {
    let mut steps: Vec<f64> = t.windows(2).map(|pair| pair[1] - pair[0]).collect();
    signal::median_in_place(&mut steps)
}

/// Rate by the median step of the timestamps `t` in s, in Hz; `None` if that step is not positive.
pub(crate) fn rate_hz(t: &[f64]) -> Option<f64> {
    median_step(t).filter(|step| *step > 0.0).map(|step| 1.0 / step)
}
