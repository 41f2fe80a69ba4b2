//! Runs a whole record of one axis through a compensator.

use crate::compensator::{Compensator, FeedError};
use record::StartRule;

/// One axis of a flight: rising timestamps, s, with velocities, m/s, and late positions, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisSamples<'a> {
    /// Timestamps of the velocities, s.
    pub velocity_t: &'a [f64],
    /// Velocities, m/s.
    pub velocity: &'a [f64],
    /// Timestamps of the positions, s.
    pub position_t: &'a [f64],
    /// Positions, m.
    pub position: &'a [f64],
}

/// Which velocities a compensator may use at a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VelocityView {
    /// No velocity later than the row: what an aircraft has.
    UpToNow,
    /// Up to the first sample at or after the row, for compensators that interpolate. Not causal by up to one velocity
    /// interval. Table 5.7 of the design note uses this view.
    Bracketing,
}

/// Result of a replay.
#[derive(Debug, Clone, PartialEq)]
pub struct Replayed {
    /// Position at each row, m.
    pub output: Vec<Option<f64>>,
    /// Number of rejected samples.
    pub refused: u64,
    /// Reason for the first rejection.
    pub first_refusal: Option<FeedError>,
}

impl Replayed {
    fn note(&mut self, fed: Result<(), FeedError>) {
        if let Err(error) = fed {
            self.refused += 1;
            self.first_refusal.get_or_insert(error);
        }
    }
}

/// Feeds a record in timestamp order (velocity first on ties) and reads the output at every row; rows rise, s.
///
/// The compensator starts at the first velocity, with the newest earlier position. Earlier rows have no output.
#[must_use]
pub fn replay_axis(
    compensator: &mut dyn Compensator,
    samples: &AxisSamples<'_>,
    start: StartRule,
    view: VelocityView,
    rows: &[f64],
) -> Replayed {
    let velocities: Vec<(f64, f64)> = pairs(samples.velocity_t, samples.velocity);
    let positions: Vec<(f64, f64)> = pairs(samples.position_t, samples.position);
    let mut out = Replayed { output: Vec::with_capacity(rows.len()), refused: 0, first_refusal: None };
    let Some(&(first, velocity)) = velocities.first() else {
        out.output.resize(rows.len(), None);
        return out;
    };
    let ahead = view == VelocityView::Bracketing && compensator.interpolates();
    out.note(compensator.start(first, velocity, start));
    let mut next_velocity = 1;
    let mut next_position = positions.partition_point(|(t, _)| *t < first).saturating_sub(1);
    for &row in rows {
        loop {
            let v = velocities.get(next_velocity).filter(|(t, _)| *t <= row);
            let p = positions.get(next_position).filter(|(t, _)| *t <= row);
            match (v, p) {
                (Some(&(t, value)), p) if p.is_none_or(|(of_position, _)| t <= *of_position) => {
                    out.note(compensator.velocity(t, value));
                    next_velocity += 1;
                }
                (_, Some(&(t, value))) => {
                    out.note(compensator.position(t, value));
                    next_position += 1;
                }
                _ => break,
            }
        }
        if let Some(&(t, value)) =
            velocities.get(next_velocity).filter(|_| ahead && velocities[next_velocity - 1].0 < row)
        {
            out.note(compensator.velocity(t, value));
            next_velocity += 1;
        }
        out.output.push(if row < first { None } else { compensator.output(row) });
    }
    out
}

fn pairs(t: &[f64], values: &[f64]) -> Vec<(f64, f64)> {
    t.iter().copied().zip(values.iter().copied()).collect()
}
