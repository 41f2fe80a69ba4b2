//! Curves of a record as lines of a figure, and what their caption must disclose.

use super::{Line, Pen, Shape, pieces};
use crate::number;
use crate::text::label;
use record::Curve;

/// Maximum number of curves in one panel. More cannot be distinguished.
const MOST_CURVES: usize = 8;

/// How many samples the curves of a figure represent, and how many of them are not drawn.
#[derive(Default)]
pub(super) struct Tally {
    points: u64,
    samples: u64,
    lost: u64,
    left_out: u64,
}

impl Tally {
    pub(super) fn add(&mut self, points: usize, stands_for: u64, lost: usize) {
        self.points += points as u64;
        self.samples = self.samples.saturating_add(stands_for);
        self.lost += lost as u64;
    }

    /// The sentence, then the tally.
    pub(super) fn caption(&self, what: &str) -> String {
        let (points, samples) =
            (number::counted(self.points, "point", "points"), number::counted(self.samples, "sample", "samples"));
        let mut text = format!("{what} {points} for {samples}, every extreme kept.");
        if self.lost > 0 {
            text += &format!(" Not drawn, because not finite or beyond 10¹²: {}.", number::count(self.lost));
        }
        if self.left_out > 0 {
            text += &format!(" Curves not drawn, but in the record: {}.", number::count(self.left_out));
        }
        text
    }
}

/// Lines for the curves of a panel, with the pens in the same order.
pub(super) fn lines(curves: &[Curve], pens: &[Pen], tally: &mut Tally) -> Vec<Line> {
    tally.left_out += curves.len().saturating_sub(MOST_CURVES) as u64;
    let mut lines = Vec::new();
    for (curve, &pen) in curves.iter().zip(pens).take(MOST_CURVES) {
        let (x, y) = (&curve.t_s, &curve.y);
        let (mut pieces, lost) = pieces(x, y, &curve.breaks);
        tally.add(x.len().max(y.len()), curve.stands_for, lost);
        if pen.shape() == Shape::Points {
            pieces = pieces.into_iter().flatten().map(|point| vec![point]).collect();
        }
        lines.push(Line { name: label(&curve.name), pen, pieces });
    }
    lines
}
