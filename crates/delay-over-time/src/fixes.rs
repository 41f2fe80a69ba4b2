//! The fixes that take part, and the pieces they fall into.

use crate::motion::Motion;

/// Fixes after bursts, odd ones and those without a velocity were left out.
#[derive(Debug, Clone, Default)]
pub(crate) struct Fixes {
    /// Stamps, s.
    pub(crate) t: Vec<f64>,
    /// North and east about a common point, m.
    pub(crate) y: Vec<[f64; 2]>,
    /// First row of each piece with an offset of its own, and the number of rows at the end.
    pub(crate) starts: Vec<usize>,
}

impl Fixes {
    pub(crate) fn len(&self) -> usize {
        self.t.len()
    }

    /// Rows of each piece.
    pub(crate) fn pieces(&self) -> impl Iterator<Item = std::ops::Range<usize>> + '_ {
        self.starts.windows(2).map(|w| w[0]..w[1])
    }

    /// The fixes without a speed that follows later than the direction, s, and an antenna ahead, m.
    pub(crate) fn without_effects(&self, motion: &Motion, delay: &dyn Fn(f64) -> f64, [lag, lever]: [f64; 2]) -> Fixes {
        let mut out = self.clone();
        let mut hint = 0;
        for (t, y) in out.t.iter().zip(&mut out.y) {
            let columns = motion.resembling_at(t - delay(*t), &mut hint);
            for (y, [of_lag, of_lever]) in y.iter_mut().zip(columns) {
                *y -= lag * of_lag + lever * of_lever;
            }
        }
        out
    }

    /// The fixes with stamps earlier by `by`; those that come out of order are left out.
    pub(crate) fn retimed(&self, by: &dyn Fn(f64) -> f64) -> Fixes {
        let mut out = Fixes::default();
        for piece in self.pieces() {
            out.starts.push(out.t.len());
            for (t, y) in self.t[piece.clone()].iter().zip(&self.y[piece]) {
                let stamp = t - by(*t);
                if out.t.last().is_none_or(|last| stamp > *last) {
                    out.t.push(stamp);
                    out.y.push(*y);
                }
            }
        }
        out.starts.push(out.t.len());
        out.starts.dedup();
        out
    }

    /// The rows for which `keep` holds, every `every`-th of them.
    pub(crate) fn select(
        t: &[f64],
        y: &[[f64; 2]],
        breaks: &Breaks,
        keep: impl Fn(usize) -> bool,
        every: usize,
    ) -> Fixes {
        let rows = (0..t.len()).filter(|k| keep(*k)).step_by(every.max(1));
        let mut fixes = Fixes::default();
        let mut piece = None;
        for k in rows {
            let of = breaks.piece_of(t[k]);
            if piece != Some(of) {
                piece = Some(of);
                fixes.starts.push(fixes.t.len());
            }
            fixes.t.push(t[k]);
            fixes.y.push(y[k]);
        }
        fixes.starts.push(fixes.t.len());
        fixes
    }
}

/// Where pieces begin: resets of the position at their instant, gaps of the velocity where fixes show them.
pub(crate) struct Breaks<'a> {
    pub(crate) resets: &'a [f64],
    pub(crate) motion: &'a Motion,
    /// Delay along the flight, s.
    pub(crate) delay: &'a dyn Fn(f64) -> f64,
}

impl Breaks<'_> {
    fn piece_of(&self, t: f64) -> (usize, usize) {
        (self.resets.partition_point(|b| *b <= t), self.motion.gaps_before(t - (self.delay)(t)))
    }
}
