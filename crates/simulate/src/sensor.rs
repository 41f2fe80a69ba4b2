//! Errors of a sensor: delay, noise, bias, its own rate, gaps.

use crate::error::{SimulateError, within};
use crate::random::normal;
use crate::trajectory::MARGIN_S;
use rand::RngExt;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

/// Noise that wanders: an Ornstein-Uhlenbeck process, stationary from the first sample.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Wander {
    /// Standard deviation of each axis, m or m/s.
    pub std: f64,
    /// Time after which the correlation has fallen to 1/e, s.
    pub time_constant_s: f64,
}

/// From `from_s` (included) to `to_s` (not included), seconds after the start.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Interval {
    /// Start.
    pub from_s: f64,
    /// End.
    pub to_s: f64,
}

/// A sensor. A sample taken at the instant `t` is `truth(t − delay) + bias + wander + white` with the timestamp `t +
/// timestamp error`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SensorSettings {
    /// Samples per second.
    pub rate_hz: f64,
    /// Delay of its values, s; positive is late.
    pub delay_s: f64,
    /// White noise of each axis, standard deviation, m or m/s.
    pub white_std: f64,
    /// Wandering noise, if any.
    pub wander: Option<Wander>,
    /// Constant error north, east, down, m or m/s.
    pub bias: [f64; 3],
    /// Standard deviation of the error of a timestamp, s; an error above 0.4 sample intervals is clipped there, so that
    /// timestamps increase.
    pub stamp_jitter_s: f64,
    /// Share of samples lost individually, 0 to 1.
    pub drop_share: f64,
    /// Gaps in which no samples are taken.
    pub gaps: Vec<Interval>,
    /// Minimum latency from timestamp to logger, s.
    pub log_latency_s: f64,
    /// Additional latency: mean of an exponential distribution, s.
    pub log_jitter_s: f64,
}

impl SensorSettings {
    /// A perfect sensor at this rate, logged 2 ms after its timestamp.
    #[must_use]
    pub fn clean(rate_hz: f64) -> SensorSettings {
        SensorSettings {
            rate_hz,
            delay_s: 0.0,
            white_std: 0.0,
            wander: None,
            bias: [0.0; 3],
            stamp_jitter_s: 0.0,
            drop_share: 0.0,
            gaps: vec![],
            log_latency_s: 0.002,
            log_jitter_s: 0.0003,
        }
    }

    pub(crate) fn check(&self) -> Result<(), SimulateError> {
        within("rate_hz", self.rate_hz, 0.01, 10_000.0, "between 0.01 and 10 000 Hz")?;
        within("delay_s", self.delay_s, -MARGIN_S, MARGIN_S, "between -10 and 10 s")?;
        within("white_std", self.white_std, 0.0, f64::MAX, "zero or more")?;
        within("stamp_jitter_s", self.stamp_jitter_s, 0.0, 10.0, "between 0 and 10 s")?;
        within("drop_share", self.drop_share, 0.0, 1.0, "between 0 and 1")?;
        within("log_latency_s", self.log_latency_s, 0.0, 10.0, "between 0 and 10 s")?;
        within("log_jitter_s", self.log_jitter_s, 0.0, 10.0, "between 0 and 10 s")?;
        self.bias.iter().try_for_each(|&b| within("bias", b, f64::MIN, f64::MAX, "a finite number"))?;
        self.wander.iter().try_for_each(|w| {
            within("wander.std", w.std, 0.0, f64::MAX, "zero or more")?;
            within("wander.time_constant_s", w.time_constant_s, 1e-9, f64::MAX, "more than zero")
        })
    }

    /// Sampling instants, seconds after the start.
    pub(crate) fn instants(&self, duration_s: f64, random: &mut Pcg64) -> Vec<f64> {
        let count = (duration_s * self.rate_hz + 1e-9).floor() as usize + 1;
        let in_gap = |t: f64| self.gaps.iter().any(|gap| (gap.from_s..gap.to_s).contains(&t));
        (0..count)
            .map(|row| row as f64 / self.rate_hz)
            // Drawn for every row, so that a gap does not change which of the other samples are lost.
            .filter(|&t| !random.random_bool(self.drop_share) && !in_gap(t))
            .collect()
    }

    /// Error of a sample's values at each instant, without the delay.
    pub(crate) fn errors(&self, instants: &[f64], random: &mut Pcg64) -> Vec<[f64; 3]> {
        let wander = self.wander.unwrap_or(Wander { std: 0.0, time_constant_s: 1.0 });
        let mut state: Option<([f64; 3], f64)> = None;
        let mut errors = Vec::with_capacity(instants.len());
        for &t in instants {
            let keep = state.map_or(0.0, |(_, before)| (-(t - before) / wander.time_constant_s).exp());
            let last = state.map_or([0.0; 3], |(value, _)| value);
            let fresh = wander.std * (1.0 - keep * keep).sqrt();
            let now = last.map(|x| keep * x + fresh * normal(random));
            errors.push([0, 1, 2].map(|k| self.bias[k] + now[k] + self.white_std * normal(random)));
            state = Some((now, t));
        }
        errors
    }

    /// Error of each timestamp, s.
    pub(crate) fn stamp_errors(&self, count: usize, random: &mut Pcg64) -> Vec<f64> {
        let limit = 0.4 / self.rate_hz;
        (0..count).map(|_| (self.stamp_jitter_s * normal(random)).clamp(-limit, limit)).collect()
    }

    /// Latency from timestamp to logger, s, one for each sample.
    pub(crate) fn latencies(&self, count: usize, random: &mut Pcg64) -> Vec<f64> {
        // 1 − u lies in (0, 1]: the logarithm is finite.
        (0..count).map(|_| self.log_latency_s - self.log_jitter_s * (1.0 - random.random::<f64>()).ln()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::generator;

    fn moments(values: &[f64]) -> (f64, f64) {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        (mean, (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt())
    }

    #[test]
    fn white_noise_has_the_requested_standard_deviation_and_bias() {
        let sensor = SensorSettings { white_std: 0.3, bias: [0.0, 1.0, -2.0], ..SensorSettings::clean(100.0) };
        let instants: Vec<f64> = (0..40_000).map(|i| f64::from(i) / 100.0).collect();
        let errors = sensor.errors(&instants, &mut generator(1, "test"));
        for (axis, bias) in [0.0, 1.0, -2.0].into_iter().enumerate() {
            let (mean, std) = moments(&errors.iter().map(|e| e[axis]).collect::<Vec<_>>());
            // Five standard errors of a mean and of a standard deviation over n values.
            let n = 40_000f64;
            assert!((mean - bias).abs() < 5.0 * 0.3 / n.sqrt(), "{axis}: {mean}");
            assert!((std - 0.3).abs() < 5.0 * 0.3 / (2.0 * n).sqrt(), "{axis}: {std}");
        }
    }

    #[test]
    fn wandering_noise_has_its_spread_and_time_constant() {
        let wander = Wander { std: 0.5, time_constant_s: 2.0 };
        let sensor = SensorSettings { wander: Some(wander), ..SensorSettings::clean(10.0) };
        let instants: Vec<f64> = (0..200_000).map(|i| f64::from(i) / 10.0).collect();
        let x: Vec<f64> = sensor.errors(&instants, &mut generator(2, "test")).iter().map(|e| e[0]).collect();
        let (_, std) = moments(&x);
        let after_2s = x.windows(21).map(|w| w[0] * w[20]).sum::<f64>() / (x.len() - 20) as f64;
        // 20 000 s at τ = 2 s: a variance decorrelates twice as fast as a mean, so it is the mean of T/τ independent
        // values (Bartlett); each has a relative standard error of √2. Five of them.
        let n = 20_000.0 / 2.0f64;
        assert!((std * std - 0.25).abs() < 5.0 * 0.25 * (2.0 / n).sqrt(), "{std}");
        assert!((after_2s - 0.25 / std::f64::consts::E).abs() < 5.0 * 0.25 * (2.0 / n).sqrt(), "{after_2s}");
    }

    #[test]
    fn a_gap_removes_only_its_own_samples() {
        let holes = SensorSettings {
            gaps: vec![Interval { from_s: 2.0, to_s: 4.0 }],
            drop_share: 0.2,
            ..SensorSettings::clean(10.0)
        };
        let whole = SensorSettings { gaps: vec![], ..holes.clone() };
        let with = holes.instants(60.0, &mut generator(3, "test"));
        let without = whole.instants(60.0, &mut generator(3, "test"));
        assert!(without.iter().any(|t| (2.0..4.0).contains(t)));
        assert_eq!(with, without.into_iter().filter(|t| !(2.0..4.0).contains(t)).collect::<Vec<_>>());
    }
}
