//! Distribution of a signal's power over frequency.

use rustfft::FftPlanner;
use rustfft::num_complex::Complex64;

/// One-sided power spectrum of evenly spaced values.
#[derive(Debug, Clone, PartialEq)]
pub struct Spectrum {
    /// Hz, from the first above zero.
    pub frequency_hz: Vec<f64>,
    /// Power in each bin, unit²: their sum is the mean square about the mean, weighted by the window.
    pub power: Vec<f64>,
}

/// Power spectrum of `y`, sampled at `rate_hz`, mean removed, Hann window; empty with fewer than four values.
#[must_use]
pub fn power_spectrum(y: &[f64], rate_hz: f64) -> Spectrum {
    let n = y.len();
    if n < 4 {
        return Spectrum { frequency_hz: vec![], power: vec![] };
    }
    let mean = y.iter().sum::<f64>() / n as f64;
    let window = |k: usize| (std::f64::consts::PI * (k as f64 + 0.5) / n as f64).sin().powi(2);
    let mut buffer: Vec<Complex64> =
        y.iter().enumerate().map(|(k, v)| Complex64::new((v - mean) * window(k), 0.0)).collect();
    FftPlanner::new().plan_fft_forward(n).process(&mut buffer);
    let weight: f64 = (0..n).map(|k| window(k).powi(2)).sum::<f64>() * n as f64;
    let bins = 1..n.div_ceil(2);
    Spectrum {
        frequency_hz: bins.clone().map(|k| k as f64 * rate_hz / n as f64).collect(),
        power: bins.map(|k| 2.0 * buffer[k].norm_sqr() / weight).collect(),
    }
}

impl Spectrum {
    /// The band from which a share `(1 − share)/2` of the power lies below and as much above, Hz; `None` without power.
    #[must_use]
    pub fn band(&self, share: f64) -> Option<[f64; 2]> {
        let total: f64 = self.power.iter().sum();
        if total.is_nan() || total <= 0.0 {
            return None;
        }
        let tail = 0.5 * (1.0 - share) * total;
        let at = |level: f64| {
            let mut sum = 0.0;
            let row = self.power.iter().position(|p| {
                sum += p;
                sum >= level
            });
            row.and_then(|row| self.frequency_hz.get(row)).or(self.frequency_hz.last()).copied()
        };
        Some([at(tail)?, at(total - tail)?])
    }

    /// `√(∫ f² S / ∫ S)`, Hz (design note 3.1); `None` without power.
    #[must_use]
    pub fn rms_frequency_hz(&self) -> Option<f64> {
        let total: f64 = self.power.iter().sum();
        let weighted: f64 = self.power.iter().zip(&self.frequency_hz).map(|(p, f)| p * f * f).sum();
        (total > 0.0).then(|| (weighted / total).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    fn tones(rate_hz: f64, n: usize, parts: &[(f64, f64)]) -> Vec<f64> {
        let at = |t: f64| parts.iter().map(|(f, a)| a * (TAU * f * t).sin()).sum::<f64>();
        (0..n).map(|k| 3.0 + at(k as f64 / rate_hz)).collect()
    }

    #[test]
    fn the_power_of_a_tone_is_half_its_amplitude_squared() {
        let spectrum = power_spectrum(&tones(50.0, 3000, &[(0.55, 2.0)]), 50.0);
        assert!((spectrum.power.iter().sum::<f64>() - 2.0).abs() < 1e-3);
        assert!((spectrum.rms_frequency_hz().unwrap() - 0.55).abs() < 0.01);
    }

    #[test]
    fn the_rms_frequency_of_two_tones_is_weighted_by_power() {
        let spectrum = power_spectrum(&tones(50.0, 6000, &[(0.5, 1.0), (1.5, 1.0)]), 50.0);
        assert!((spectrum.rms_frequency_hz().unwrap() - (0.5_f64 * (0.25 + 2.25)).sqrt()).abs() < 0.01);
        let [low, high] = spectrum.band(0.9).unwrap();
        assert!((low - 0.5).abs() < 0.03 && (high - 1.5).abs() < 0.03);
    }

    #[test]
    fn a_constant_series_has_no_band() {
        assert_eq!(power_spectrum(&[2.0; 100], 10.0).band(0.9), None);
        assert_eq!(power_spectrum(&[], 10.0).rms_frequency_hz(), None);
    }
}
