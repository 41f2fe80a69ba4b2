//! Initial scan: the objective over all allowed delays, on few samples.

use super::block::Block;
use super::block::Lateness;
use super::descent::Alignment;
use super::{DelayError, DelaySettings, LEAST_SAMPLES, Measurement};
use crate::whiten::NoiseModel;

/// Samples of a component used for the scan.
const ENOUGH_SAMPLES: usize = 600;

/// The objective over the search range.
#[derive(Debug, Clone)]
pub(crate) struct Scan {
    /// Delay, s, and −2 log likelihood.
    points: Vec<(f64, f64)>,
    /// Whether a component follows its reference with the right sign at any delay.
    pub(crate) follows: bool,
}

impl Scan {
    /// Result if there was no search.
    pub(crate) fn none() -> Scan {
        Scan { points: vec![], follows: true }
    }

    /// The delay with the lowest objective, s.
    pub(crate) fn lowest(&self) -> Option<f64> {
        self.points.iter().min_by(|a, b| a.1.total_cmp(&b.1)).map(|p| p.0)
    }

    /// Minima inside the range, and its ends if the objective falls towards them; lowest first.
    pub(crate) fn minima(&self) -> Vec<(f64, f64)> {
        let value = |k: usize| self.points.get(k).map_or(f64::INFINITY, |p| p.1);
        let mut minima: Vec<(f64, f64)> = (0..self.points.len())
            .filter(|&k| value(k) < k.checked_sub(1).map_or(f64::INFINITY, value) && value(k) <= value(k + 1))
            .map(|k| self.points[k])
            .collect();
        minima.sort_by(|a, b| a.1.total_cmp(&b.1));
        minima
    }
}

/// Checks the settings and returns the delays to scan, s.
pub(crate) fn delays(settings: &DelaySettings) -> Result<Vec<f64>, DelayError> {
    let ((from_s, to_s), step_s) = (settings.search_s, settings.search_step_s);
    let steps = (to_s - from_s) / step_s;
    if !(from_s.is_finite() && to_s.is_finite() && step_s > 0.0 && (0.0..1e6).contains(&steps)) {
        return Err(DelayError::SearchRange { from_s, to_s, step_s });
    }
    Ok((0..=(steps + 1e-9).floor() as usize).map(|k| from_s + step_s * k as f64).collect())
}

/// The objective at `delays`, on at most 600 samples of each component, with the noise as far as it is known: a noise
/// of the model applies unchanged to fewer samples. Without noise each component is assumed white, of unknown size.
///
/// # Errors
/// Too few samples within the reference, or a reference that does not move.
pub(crate) fn scan(
    measurements: &[Measurement],
    delays: &[f64],
    noise: Option<&[NoiseModel]>,
    skew_about: (f64, f64),
) -> Result<Scan, DelayError> {
    let (skew, middle_s) = skew_about;
    let between = (delays.first().copied().unwrap_or(0.0), delays.last().copied().unwrap_or(0.0));
    let blocks = thinned_blocks(measurements, between, noise)?;
    let mut alignment = Alignment { measurements, blocks, middle_s };
    let mut scan = Scan { points: Vec::with_capacity(delays.len()), follows: false };
    let mut moving = false;
    for &delay_s in delays {
        let normal = alignment.normal(&Lateness { delay_s, skew });
        moving |= normal.projections.iter().any(|p| p.moving_share > 1e-12);
        scan.follows |= normal.follows();
        let unknown = |(p, b): (&super::block::Projection, &Block)| b.t.len() as f64 * p.rss.max(1e-300).ln();
        let value = match noise {
            Some(_) => normal.rss,
            None => normal.projections.iter().zip(&alignment.blocks).map(unknown).sum(),
        };
        scan.points.push((delay_s, value));
    }
    if moving { Ok(scan) } else { Err(DelayError::NoExcitation) }
}

/// A block of each measurement with the rows comparable at all delays between the two.
fn thinned_blocks(
    measurements: &[Measurement],
    (earliest, latest): (f64, f64),
    noise: Option<&[NoiseModel]>,
) -> Result<Vec<Block>, DelayError> {
    let unit = NoiseModel::white(1.0);
    let block = |(component, m): (usize, &Measurement)| {
        let rows = rows_of(m, earliest, latest);
        match rows.len() {
            samples if samples < LEAST_SAMPLES => {
                Err(DelayError::TooFewSamples { component, samples, of: m.t.len(), needed: LEAST_SAMPLES })
            }
            _ => Ok(Block::new(m, thinned(rows), noise.map_or(&unit, |n| &n[component]), None, 0)),
        }
    };
    measurements.iter().enumerate().map(block).collect()
}

/// Rows within the reference for all delays between the two. If that leaves less than half of the rows that are within
/// it for at least one of them, the latter.
fn rows_of(m: &Measurement, earliest: f64, latest: f64) -> Vec<usize> {
    let (first, last) = m.reference.span();
    let rows =
        |from: f64, to: f64| -> Vec<usize> { (0..m.t.len()).filter(|&k| m.t[k] >= from && m.t[k] <= to).collect() };
    let all = rows(first + latest, last + earliest);
    let any = rows(first + earliest, last + latest);
    if 2 * all.len() >= any.len() { all } else { any }
}

fn thinned(rows: Vec<usize>) -> Vec<usize> {
    let every = rows.len().div_ceil(ENOUGH_SAMPLES).max(1);
    rows.into_iter().step_by(every).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Known;

    impl crate::Reference for Known {
        fn span(&self) -> (f64, f64) {
            (0.0, 100.0)
        }

        fn value_and_rate(&self, t: f64) -> (f64, f64) {
            (t, 1.0)
        }
    }

    fn rows(t: &[f64], earliest: f64, latest: f64) -> Vec<f64> {
        let gain = crate::Gain::Free { sign: crate::Sign::Positive };
        let measurement = Measurement { t, y: t, reference: &Known, gain, drift: false };
        rows_of(&measurement, earliest, latest).into_iter().map(|row| t[row]).collect()
    }

    #[test]
    fn rows_are_within_the_reference_at_every_delay() {
        let t: Vec<f64> = (-10..=110).map(f64::from).collect();
        let found = rows(&t, -2.0, 5.0);
        assert_eq!((found[0], found[found.len() - 1], found.len()), (5.0, 98.0, 94));
    }

    #[test]
    fn a_search_as_long_as_the_record_uses_rows_that_some_delay_keeps_inside() {
        let t: Vec<f64> = (-10..=110).map(f64::from).collect();
        // Within for every delay: 60 to 100; for at least one: 0 to 110.
        let found = rows(&t, 0.0, 60.0);
        assert_eq!((found[0], found[found.len() - 1], found.len()), (0.0, 110.0, 111));
    }

    #[test]
    fn many_rows_are_thinned_evenly_from_the_first() {
        assert_eq!(thinned((0..600).collect()).len(), 600);
        let thin = thinned((0..1801).collect());
        assert_eq!((thin[0], thin[1], thin.len()), (0, 4, 451));
    }
}
