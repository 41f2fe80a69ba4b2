//! From a first delay to the best one, by Gauss–Newton steps with the linear parameters projected out
//! (Golub and Pereyra 1973, in Kaufman's form).

use super::Measurement;
use super::block::{Block, Lateness, MOST_CURVED, Normal};

/// All components on their used rows.
pub(crate) struct Alignment<'a> {
    pub(crate) measurements: &'a [Measurement<'a>],
    pub(crate) blocks: Vec<Block>,
    pub(crate) middle_s: f64,
}

/// Largest step of the delay, s, and of the skew.
const LONGEST_STEP: [f64; 2] = [0.15, 0.02];
const MOST_STEPS: usize = 30;

/// End point of the descent.
#[derive(Debug, Clone)]
pub(crate) struct Descent {
    pub(crate) at: Lateness,
    pub(crate) normal: Normal,
    pub(crate) steps: usize,
    pub(crate) converged: bool,
    /// From the curvature alone, s.
    pub(crate) hessian_s: f64,
}

impl Alignment<'_> {
    /// The normal equations at `at`: evaluates the references and solves for all linear parameters.
    pub(crate) fn normal(&mut self, at: &Lateness) -> Normal {
        for (block, measurement) in self.blocks.iter_mut().zip(self.measurements) {
            block.fill(measurement, at, self.middle_s);
        }
        match self.blocks.first() {
            Some(block) if !block.shared.columns.is_empty() => Normal::of_shared(&mut self.blocks),
            _ => Normal::of(&mut self.blocks),
        }
    }

    /// Descends from `from` until a step is below `enough` standard uncertainties; `None` if the delay has no influence
    /// there.
    pub(crate) fn descend(&mut self, from: Lateness, enough: f64) -> Option<Descent> {
        let normal = self.normal(&from);
        self.walk(from, normal, enough)
    }

    /// [`Alignment::descend`] from the end point of the last descent of these blocks.
    pub(crate) fn descend_further(&mut self, last: Descent, enough: f64) -> Option<Descent> {
        self.walk(last.at, last.normal, enough)
    }

    /// Expects the columns of the blocks to be those at `at`, with the normal equations `normal`.
    fn walk(&mut self, mut at: Lateness, mut normal: Normal, enough: f64) -> Option<Descent> {
        for steps in 1..=MOST_STEPS {
            let step = normal.step(0.0, [true; MOST_CURVED])?;
            let hessian_s = self.curvature_s(&normal);
            let (next, next_normal) = self.shorter_until_lower(&at, &normal, step);
            let moved = (next.delay_s - at.delay_s).abs();
            (at, normal) = (next, next_normal);
            if moved <= (enough * hessian_s).max(1e-12) {
                return Some(Descent { at, normal, steps, converged: true, hessian_s });
            }
        }
        let hessian_s = self.curvature_s(&normal);
        Some(Descent { at, normal, steps: MOST_STEPS, converged: false, hessian_s })
    }

    fn curvature_s(&self, normal: &Normal) -> f64 {
        let unit = Normal { gradient: [1.0, 0.0, 0.0], ..normal.clone() };
        unit.step(0.0, [true; MOST_CURVED]).map_or(f64::INFINITY, |s| s[0].max(0.0).sqrt())
    }

    /// Halves the step until the sum of squares does not rise.
    fn shorter_until_lower(&mut self, at: &Lateness, normal: &Normal, step: [f64; MOST_CURVED]) -> (Lateness, Normal) {
        let longest = (0..2).map(|i| step[i].abs() / LONGEST_STEP[i]).fold(1.0, f64::max);
        let mut share = 1.0 / longest;
        for _ in 0..12 {
            let skew = if normal.parameters > 1 { at.skew + share * step[1] } else { at.skew };
            let next = Lateness { delay_s: at.delay_s + share * step[0], skew };
            let there = self.normal(&next);
            if there.rss <= normal.rss * (1.0 + 1e-12) && (there.follows() || !normal.follows()) {
                return (next, there);
            }
            share *= 0.5;
        }
        let here = self.normal(at);
        (*at, here)
    }
}
