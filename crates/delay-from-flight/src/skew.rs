//! Lopsided lateness: a queue makes some fixes much later than most and none earlier.
//!
//! Huber's weights suppress such fixes and give the typical delay. Compensation has to remove the mean on average,
//! which plain least squares gives.

use signal::DelayFit;

/// A sum of signed squares above this many standard deviations is not due to chance.
const SURE: f64 = 3.3;

/// A detected lopsided lateness.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Skew {
    /// Delay with outlying samples suppressed, s.
    pub(crate) typical_s: f64,
}

impl Skew {
    pub(crate) fn words(&self) -> String {
        let side = if self.typical_s < 0.0 { "early" } else { "late" };
        format!(
            "the lateness is skewed, as after a queue: this is its mean; typical samples are {:.0} ms {side}",
            1e3 * self.typical_s.abs()
        )
    }
}

/// Whether whitened residuals along the motion are lopsided: the sum of their signed squares over its own standard
/// deviation, which is about standard normal for symmetric residuals with any tails.
pub(crate) fn is_skewed(fit: &DelayFit) -> bool {
    if fit.downweighted_share <= 0.0 {
        return false;
    }
    let (mut sum, mut squares) = (0.0, 0.0);
    for c in &fit.components {
        let size = (c.slope.iter().map(|v| v * v).sum::<f64>() / c.slope.len().max(1) as f64).sqrt();
        for ((z, w), v) in c.whitened.iter().zip(&c.weights).zip(&c.slope) {
            // The unweighted residual in units of the noise; lateness shows where the motion is fast.
            let along = -(z / w.sqrt()) * (v / size).clamp(-1.0, 1.0);
            sum += along * along.abs();
            squares += along.powi(4);
        }
    }
    squares > 0.0 && (sum / squares.sqrt()).abs() > SURE
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_early_sample_is_called_early() {
        let words = |typical_s| Skew { typical_s }.words();
        assert!(words(-0.036).ends_with("typical samples are 36 ms early"), "{}", words(-0.036));
        assert!(words(0.036).ends_with("typical samples are 36 ms late"));
    }
}
