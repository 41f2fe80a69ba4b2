//! Maps a device's clock to the logger's, using a pulse per second.

use crate::regression::regress;
use thiserror::Error;

/// Why pulses do not define a clock.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum PulseError {
    /// Fewer usable pulses than needed for a line and its scatter.
    #[error("{used} usable pulses of {given}: at least {LEAST_PULSES} are needed")]
    TooFew {
        /// Usable pulses.
        used: usize,
        /// All pulses.
        given: usize,
    },
}

/// Minimum number of pulses for a clock.
const LEAST_PULSES: usize = 4;
/// A pulse farther than this from a whole second after the previous one is stray, s.
const OFF_BEAT_S: f64 = 0.02;
/// Number of candidates for the first pulse, in case the first ones are stray.
const TRIED_STARTS: usize = 8;

/// Device time against logger time: a straight line from pulse to pulse.
///
/// A pulse is exact up to the jitter of its timestamp; between pulses the clocks are assumed to keep their rate.
/// Outside, the mean rate is used.
#[derive(Debug, Clone, PartialEq)]
pub struct PiecewiseClock {
    /// Device seconds of the used pulses: `first_second` and whole numbers after it.
    pub device_s: Vec<f64>,
    /// Logger seconds of the used pulses.
    pub logger_s: Vec<f64>,
    /// Rejected pulses: more than 20 ms from a whole second after the previous pulse, or not finite.
    pub off_beat: usize,
    /// Seconds without a pulse between the first and the last.
    pub missing: usize,
    /// Seconds that the logger's clock gains per second of the pulses.
    pub skew: f64,
    /// Its standard uncertainty, valid for a clock that wanders.
    pub skew_uncertainty: f64,
    /// Jitter of a pulse: rms distance from the line through its neighbours, scaled to one pulse, s.
    pub residual_rms_s: f64,
}

impl PiecewiseClock {
    /// From the logger's timestamps of the pulses (s), and the device's second of the first used pulse (0 if unknown:
    /// the map is then right to whole seconds).
    ///
    /// # Errors
    /// [`PulseError`]: fewer than 4 regular pulses.
    pub fn from_pulses(logger_s: &[f64], first_second: f64) -> Result<PiecewiseClock, PulseError> {
        let beats = (0..logger_s.len().min(TRIED_STARTS))
            .map(|start| on_beat(&logger_s[start..]))
            .reduce(|best, other| if other.len() > best.len() { other } else { best })
            .unwrap_or_default();
        let too_few = PulseError::TooFew { used: beats.len(), given: logger_s.len() };
        if beats.len() < LEAST_PULSES {
            return Err(too_few);
        }
        let (device, logger): (Vec<f64>, Vec<f64>) = beats.iter().map(|(n, t)| (first_second + *n as f64, *t)).unzip();
        let (skew, skew_uncertainty) = skew_of(&device, &logger).ok_or(too_few)?;
        Ok(PiecewiseClock {
            off_beat: logger_s.len() - beats.len(),
            missing: beats[beats.len() - 1].0 as usize + 1 - beats.len(),
            skew,
            skew_uncertainty,
            residual_rms_s: jitter(&device, &logger),
            device_s: device,
            logger_s: logger,
        })
    }

    /// Logger time at a device time, s.
    #[must_use]
    pub fn logger_at(&self, device_s: f64) -> f64 {
        along(&self.device_s, &self.logger_s, 1.0 + self.skew, device_s)
    }
}

/// Pulses a whole number of seconds apart: seconds after the first, and timestamps.
fn on_beat(logger_s: &[f64]) -> Vec<(u64, f64)> {
    let mut beats: Vec<(u64, f64)> = vec![];
    for &t in logger_s.iter().filter(|t| t.is_finite()) {
        let Some(&(n, last)) = beats.last() else {
            beats.push((0, t));
            continue;
        };
        let seconds = (t - last).round();
        if seconds >= 1.0 && (t - last - seconds).abs() <= OFF_BEAT_S {
            beats.push((n + seconds as u64, t));
        }
    }
    beats
}

/// Slope less one of logger against device, and its standard uncertainty.
fn skew_of(device: &[f64], logger: &[f64]) -> Option<(f64, f64)> {
    let middle = 0.5 * (device[0] + device[device.len() - 1]);
    let x: Vec<f64> = device.iter().map(|d| d - middle).collect();
    let gained: Vec<f64> = device.iter().zip(logger).map(|(d, l)| (l - logger[0]) - (d - device[0])).collect();
    let fit = regress(&[&vec![1.0; x.len()], &x], &["offset", "skew"], &gained).ok()?;
    Some((fit.coefficients[1], fit.standard_uncertainty(1)))
}

/// Rms distance of each pulse from the line through its neighbours; equal, independent jitter σ gives
/// a distance of variance σ² (1 + a² + b²) with a and b the neighbours' weights.
fn jitter(device: &[f64], logger: &[f64]) -> f64 {
    let squares = device.windows(3).zip(logger.windows(3)).map(|(d, l)| {
        let b = (d[1] - d[0]) / (d[2] - d[0]);
        let a = 1.0 - b;
        (l[1] - a * l[0] - b * l[2]).powi(2) / (1.0 + a * a + b * b)
    });
    (squares.sum::<f64>() / (device.len() - 2) as f64).sqrt()
}

/// The piecewise-linear y of x, with the mean slope outside.
fn along(xs: &[f64], ys: &[f64], slope: f64, x: f64) -> f64 {
    let last = xs.len() - 1;
    let after = xs.partition_point(|&k| k <= x);
    match after {
        0 => ys[0] + slope * (x - xs[0]),
        _ if after > last => ys[last] + slope * (x - xs[last]),
        _ => {
            let k = after - 1;
            ys[k] + (ys[after] - ys[k]) * (x - xs[k]) / (xs[after] - xs[k])
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, Normal};
    use rand_pcg::Pcg64;

    /// 300 pulses on a logger 35 ppm fast, 20 µs of jitter, three pulses lost, two stray ones.
    #[test]
    fn lost_and_stray_pulses_do_not_bend_the_clock() {
        let mut random = Pcg64::seed_from_u64(3);
        let jitter = Normal::new(0.0, 20e-6).unwrap();
        let logger_at = |second: f64| 1000.25 + second * (1.0 + 35e-6);
        let mut pulses: Vec<f64> = (0..300)
            .filter(|k| ![17, 18, 200].contains(k))
            .map(|k| logger_at(f64::from(k)) + jitter.sample(&mut random))
            .collect();
        pulses.insert(0, 999.9);
        pulses.insert(100, pulses[99] + 0.4);
        let clock = PiecewiseClock::from_pulses(&pulses, 50.0).unwrap();
        assert_eq!((clock.device_s.len(), clock.off_beat, clock.missing), (297, 2, 3));
        assert_eq!((clock.device_s[0], clock.device_s[296]), (50.0, 349.0));
        // σ of the slope: 20 µs √12/(300^1.5) = 0.0133 ppm; of the jitter over 297 pulses: about 5 %.
        assert!((clock.skew - 35e-6).abs() < 4.0 * 0.0133e-6, "{}", clock.skew);
        assert!((0.4..2.5).contains(&(clock.skew_uncertainty / 0.0133e-6)), "{}", clock.skew_uncertainty);
        assert!((clock.residual_rms_s / 20e-6 - 1.0).abs() < 0.2, "{}", clock.residual_rms_s);
        for second in [-3.0, 0.0, 17.5, 123.4, 299.0, 305.0] {
            assert!((clock.logger_at(second + 50.0) - logger_at(second)).abs() < 1e-4, "{second}");
        }
    }

    #[test]
    fn a_clock_that_changes_its_rate_is_followed() {
        let logger_at = |s: f64| 5.0 + s + if s < 100.0 { 0.0 } else { 50e-6 * (s - 100.0) };
        let pulses: Vec<f64> = (0..200).map(|k| logger_at(f64::from(k))).collect();
        let clock = PiecewiseClock::from_pulses(&pulses, 0.0).unwrap();
        for second in [3.3, 99.5, 150.2, 198.9] {
            assert!((clock.logger_at(second) - logger_at(second)).abs() < 1e-9, "{second}");
        }
    }

    #[test]
    fn too_few_pulses_give_no_clock() {
        let error = |pulses: &[f64]| PiecewiseClock::from_pulses(pulses, 0.0).unwrap_err();
        assert_eq!(error(&[]), PulseError::TooFew { used: 0, given: 0 });
        assert_eq!(error(&[1.0, 2.0, f64::NAN, 2.5, 3.0]), PulseError::TooFew { used: 3, given: 5 });
    }
}
