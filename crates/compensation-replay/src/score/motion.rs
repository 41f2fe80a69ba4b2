//! Frequency content of the motion of a flight, and the noise in its velocity.

use delay_from_flight::{AXES, Horizontal};
use record::{Finding, MotionSpectrum};
use signal::{Spectrum, power_spectrum};
use std::f64::consts::{LN_2, TAU};
use std::ops::Range;

/// Rates above this are averaged down to about it, Hz, or to four times the inverse delay if that is more.
const RATE_HZ: f64 = 20.0;
/// Shortest stretch with a spectrum, s.
const SHORTEST_S: f64 = 20.0;
/// Bins of the record per decade.
const PER_DECADE: f64 = 12.0;
/// Lines closer than this ratio are combined: 10^0.01.
const NEAR: f64 = 1.023_292_992_280_754;
/// Frequencies above this share of the highest one determine the noise.
const NOISE_ABOVE: f64 = 2.0 / 3.0;

/// Spectrum of the velocity over its longest stretch.
pub(crate) struct Motion {
    /// (m/s)² in each line, north and east.
    pub(crate) spectra: [Spectrum; 2],
    /// Noise in each line.
    floor: [f64; 2],
    /// Frequency and power less noise of both axes, with neighbours within a hundredth of a decade combined.
    excess: Vec<(f64, f64)>,
    duration_s: f64,
    /// Usual step of the velocity, s.
    step_s: f64,
}

impl Motion {
    pub(crate) fn of(velocity: &Horizontal, segments: &[Range<usize>], delay_s: f64) -> Result<Motion, String> {
        let span = |s: &Range<usize>| velocity.t[s.end - 1] - velocity.t[s.start];
        let longest = segments.iter().max_by(|a, b| span(a).total_cmp(&span(b))).ok_or("there is no velocity")?;
        let duration_s = span(longest);
        if duration_s < SHORTEST_S {
            return Err(format!(
                "the longest stretch of velocity without a gap lasts {duration_s:.1} s; at least {SHORTEST_S} s are needed"
            ));
        }
        let t = &velocity.t[longest.clone()];
        // Steps of the whole stretch, so that an even grid hits the samples and interpolation smooths nothing.
        let step_s = crate::rows::median_step(t);
        let count = (duration_s / step_s).round().max(1.0);
        let step_s = duration_s / count;
        let wanted = RATE_HZ.max(4.0 / delay_s);
        let block = (1.0 / (step_s * wanted)).floor().max(1.0) as usize;
        let rate_hz = 1.0 / (step_s * block as f64);
        let spectra = AXES.map(|k| {
            let even = evenly(t, &velocity.axes[k][longest.clone()], step_s, count as usize + 1);
            let means: Vec<f64> = even.chunks_exact(block).map(|c| c.iter().sum::<f64>() / block as f64).collect();
            power_spectrum(&means, rate_hz)
        });
        let floor = spectra.each_ref().map(noise_floor);
        let excess = excess(&spectra, &floor);
        Ok(Motion { spectra, floor, excess, duration_s, step_s })
    }

    /// Σ over both axes of power less noise, weighted by frequency, (m/s)² times the weight's unit; not below zero.
    pub(crate) fn weighted(&self, weight: impl Fn(f64) -> f64) -> f64 {
        self.excess.iter().map(|(f, p)| p * weight(*f)).sum::<f64>().max(0.0)
    }

    /// One-sided density of the noise, (m/s)²/Hz.
    pub(crate) fn noise_density(&self) -> [f64; 2] {
        [0, 1].map(|k| {
            let line = self.spectra[k].frequency_hz.first().copied().unwrap_or(1.0);
            self.floor[k] / line
        })
    }

    /// Mean of 2-D |v″|², (m/s³)²: the part that linear interpolation of the velocity cannot follow.
    pub(crate) fn bend2(&self) -> f64 {
        self.weighted(|f| (TAU * f).powi(4))
    }

    pub(crate) fn step_s(&self) -> f64 {
        self.step_s
    }

    pub(crate) fn record(&self) -> MotionSpectrum {
        let [north, east] = &self.spectra;
        let lines = || north.frequency_hz.iter().zip(north.power.iter().zip(&east.power).map(|(n, e)| n + e));
        let (first, last) = (north.frequency_hz[0], north.frequency_hz[north.frequency_hz.len() - 1]);
        let low = (first.log10() * PER_DECADE).floor() as i32;
        let high = (last.log10() * PER_DECADE).floor() as i32 + 1;
        let edges_hz: Vec<f64> = (low..=high).map(|k| 10f64.powf(f64::from(k) / PER_DECADE)).collect();
        let mut share = vec![0.0; edges_hz.len() - 1];
        let total: f64 = lines().map(|(_, p)| p).sum();
        for (f, p) in lines() {
            let bin = edges_hz.partition_point(|e| e <= f).saturating_sub(1).min(share.len() - 1);
            share[bin] += if total > 0.0 { p / total } else { 0.0 };
        }
        MotionSpectrum { edges_hz, share, duration_s: self.duration_s, noise_floor: self.noise_density() }
    }
}

pub(crate) fn finding(motion: &Result<Motion, String>) -> Finding<MotionSpectrum> {
    match motion {
        Ok(motion) => Finding::Found(motion.record()),
        Err(why) => Finding::CannotTell(why.clone()),
    }
}

/// Values at even steps from the first stamp, linear between samples.
fn evenly(t: &[f64], y: &[f64], step_s: f64, count: usize) -> Vec<f64> {
    let mut k = 0;
    (0..count)
        .map(|i| {
            let at = t[0] + step_s * i as f64;
            while k + 2 < t.len() && t[k + 1] <= at {
                k += 1;
            }
            let share = ((at - t[k]) / (t[k + 1] - t[k])).clamp(0.0, 1.0);
            y[k] + share * (y[k + 1] - y[k])
        })
        .collect()
}

/// Power less noise of both axes: single lines if they are far apart, sums over a hundredth of a decade if they are
/// close, at the mean of their frequencies.
fn excess([north, east]: &[Spectrum; 2], [floor_n, floor_e]: &[f64; 2]) -> Vec<(f64, f64)> {
    let lines = north.frequency_hz.iter().zip(north.power.iter().zip(&east.power));
    let mut out: Vec<(f64, f64, f64)> = vec![];
    let mut until = 0.0;
    for (&f, (n, e)) in lines {
        let p = n - floor_n + e - floor_e;
        match out.last_mut() {
            Some((sum, power, count)) if f < until => (*sum, *power, *count) = (*sum + f, *power + p, *count + 1.0),
            _ => {
                until = f * NEAR;
                out.push((f, p, 1.0));
            }
        }
    }
    out.into_iter().map(|(sum, power, count)| (sum / count, power)).collect()
}

/// Noise in each line, from the median of the highest third. The noise of a line is exponentially distributed, so its
/// mean is the median over ln 2, and a few tones do not raise it.
fn noise_floor(spectrum: &Spectrum) -> f64 {
    let n = spectrum.power.len();
    let mut high = spectrum.power[((n as f64 * NOISE_ABOVE) as usize).min(n)..].to_vec();
    signal::median_in_place(&mut high).unwrap_or(0.0) / LN_2
}
