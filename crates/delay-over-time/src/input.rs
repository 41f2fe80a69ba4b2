//! Input of the analysis, and reasons to reject it.

use thiserror::Error;

/// A position and a velocity on one clock. North and east, m and m/s.
#[derive(Debug, Clone, Copy)]
pub struct PositionAgainstVelocity<'a> {
    /// Timestamps of the position, s; strictly rising.
    pub t: &'a [f64],
    /// Position north, m.
    pub north: &'a [f64],
    /// Position east, m.
    pub east: &'a [f64],
    /// Timestamps of the velocity, s; strictly rising.
    pub velocity_t: &'a [f64],
    /// Velocity north, m/s.
    pub velocity_north: &'a [f64],
    /// Velocity east, m/s.
    pub velocity_east: &'a [f64],
    /// Instants at which the position was reset or the velocity has a gap, s, rising. A new offset starts at each. Gaps
    /// of the velocity are also detected here (over 1 s and four usual intervals).
    pub breaks: &'a [f64],
}

/// Why the input cannot be analysed.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum CannotAnalyse {
    /// Series of one channel differ in length.
    #[error("{what}: {stamps} timestamps but {values} values")]
    LengthsDiffer {
        /// Which channel.
        what: &'static str,
        /// Timestamps.
        stamps: usize,
        /// Values.
        values: usize,
    },
    /// Timestamps do not rise, or a number is not finite.
    #[error("{what}: row {row} is not a finite number, or its timestamp does not increase")]
    BadRow {
        /// Which channel.
        what: &'static str,
        /// Row, from 0.
        row: usize,
    },
    /// Too few samples.
    #[error("{what}: {samples} samples, at least {needed} are needed")]
    TooFewSamples {
        /// Which channel.
        what: &'static str,
        /// Samples.
        samples: usize,
        /// Least number.
        needed: usize,
    },
    /// Position and velocity were not logged at the same time.
    #[error("position and velocity overlap for {overlap_s:.1} s; at least {needed_s:.0} s are needed")]
    NoOverlap {
        /// Seconds that both cover.
        overlap_s: f64,
        /// Least overlap, s.
        needed_s: f64,
    },
    /// Search range or limits are invalid.
    #[error("cannot search delays from {from_s:.3} s to {to_s:.3} s")]
    SearchRange {
        /// First delay, s.
        from_s: f64,
        /// Last delay, s.
        to_s: f64,
    },
}

/// Least number of samples of either channel.
pub(crate) const LEAST_SAMPLES: usize = 20;
/// Least overlap of position and velocity, s.
pub(crate) const LEAST_OVERLAP_S: f64 = 8.0;
/// Longest search range, s: bounds the cost.
const LONGEST_RANGE_S: f64 = 120.0;

impl PositionAgainstVelocity<'_> {
    /// Checks lengths, timestamps and values.
    pub(crate) fn check(&self) -> Result<(), CannotAnalyse> {
        check_channel("position", self.t, &[self.north, self.east])?;
        check_channel("velocity", self.velocity_t, &[self.velocity_north, self.velocity_east])?;
        if let Some(row) = self.breaks.iter().position(|b| !b.is_finite()) {
            return Err(CannotAnalyse::BadRow { what: "breaks", row });
        }
        let (first, last) = (span(self.t), span(self.velocity_t));
        let overlap_s = first.1.min(last.1) - first.0.max(last.0);
        if overlap_s < LEAST_OVERLAP_S {
            return Err(CannotAnalyse::NoOverlap { overlap_s: overlap_s.max(0.0), needed_s: LEAST_OVERLAP_S });
        }
        Ok(())
    }
}

/// First and last timestamp.
pub(crate) fn span(t: &[f64]) -> (f64, f64) {
    (t.first().copied().unwrap_or(0.0), t.last().copied().unwrap_or(0.0))
}

fn check_channel(what: &'static str, t: &[f64], values: &[&[f64]]) -> Result<(), CannotAnalyse> {
    for v in values {
        if v.len() != t.len() {
            return Err(CannotAnalyse::LengthsDiffer { what, stamps: t.len(), values: v.len() });
        }
        if let Some(row) = v.iter().position(|x| !x.is_finite()) {
            return Err(CannotAnalyse::BadRow { what, row });
        }
    }
    if let Some(row) = t.iter().position(|x| !x.is_finite()) {
        return Err(CannotAnalyse::BadRow { what, row });
    }
    if let Some(row) = t.windows(2).position(|w| w[1] <= w[0]) {
        return Err(CannotAnalyse::BadRow { what, row: row + 1 });
    }
    match t.len() {
        samples if samples < LEAST_SAMPLES => {
            Err(CannotAnalyse::TooFewSamples { what, samples, needed: LEAST_SAMPLES })
        }
        _ => Ok(()),
    }
}

pub(crate) fn check_range([from_s, to_s]: [f64; 2]) -> Result<(), CannotAnalyse> {
    let good = from_s.is_finite() && to_s.is_finite() && to_s - from_s > 0.5 && to_s - from_s <= LONGEST_RANGE_S;
    if good { Ok(()) } else { Err(CannotAnalyse::SearchRange { from_s, to_s }) }
}
