//! The fixes that are used, and the pieces they form.

use crate::motion::Motion;

/// Fixes without bursts, outliers and those without a velocity.
#[derive(Debug, Clone, Default)]
pub(crate) struct Fixes {
    /// Timestamps, s.
    pub(crate) t: Vec<f64>,
    /// North and east about a common point, m.
    pub(crate) y: Vec<[f64; 2]>,
    /// First row of each piece with its own offset, and the number of rows at the end.
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

    /// The fixes corrected for a speed that lags the direction, s, and an antenna ahead, m.
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

    /// The fixes with timestamps earlier by `by`; those that are then out of order are excluded.
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

/// Starts of pieces: resets of the position at their instant, gaps of the velocity where fixes show them.
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

#[cfg(test)]
mod tests {
    use super::*;

    fn fixes() -> Fixes {
        let t: Vec<f64> = (0..20).map(f64::from).collect();
        Fixes { y: t.iter().map(|t| [2.0 * t, -t]).collect(), starts: vec![0, 8, 12, 20], t }
    }

    #[test]
    fn retimed_fixes_keep_their_positions_and_pieces() {
        let moved = fixes().retimed(&|t| 0.5 + 0.1 * t);
        assert_eq!((moved.len(), moved.starts.as_slice()), (20, [0, 8, 12, 20].as_slice()));
        for (k, (t, y)) in moved.t.iter().zip(&moved.y).enumerate() {
            let before = k as f64;
            assert!((t - before + 0.5 + 0.1 * before).abs() < 1e-12 && *y == [2.0 * before, -before]);
        }
        assert_eq!(moved.pieces().collect::<Vec<_>>(), [0..8, 8..12, 12..20]);
    }

    /// From 10 s on all timestamps are 5.5 s earlier: those of 10 s to 14 s come before 9 s.
    #[test]
    fn timestamps_out_of_order_are_excluded() {
        let moved = fixes().retimed(&|t| if t >= 10.0 { 5.5 } else { 0.0 });
        assert_eq!(
            moved.y.iter().map(|y| y[0] / 2.0).collect::<Vec<f64>>(),
            [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 15.0, 16.0, 17.0, 18.0, 19.0]
        );
        assert_eq!(moved.starts, [0, 8, 10, 15]);
    }

    /// A reset at 5 s; a gap of the velocity from 8 s to 12 s, which fixes show 1 s later.
    #[test]
    fn pieces_begin_at_resets_and_where_fixes_show_a_gap() {
        let velocity_t: Vec<f64> =
            (-200..2500).filter(|k| !(801..1200).contains(k)).map(|k| 0.01 * f64::from(k)).collect();
        let motion = Motion::new(&velocity_t, &vec![1.0; velocity_t.len()], &vec![0.0; velocity_t.len()]);
        let breaks = Breaks { resets: &[5.0], motion: &motion, delay: &|_| 1.0 };
        let all = fixes();
        let usable = |k: usize| !(10..13).contains(&k);
        let of = Fixes::select(&all.t, &all.y, &breaks, usable, 1);
        assert_eq!((of.len(), of.starts.as_slice()), (17, [0, 5, 10, 17].as_slice()));
        assert_eq!((of.t[5], of.t[10], of.y[10]), (5.0, 13.0, [26.0, -13.0]));
        let third = Fixes::select(&all.t, &all.y, &breaks, usable, 3);
        assert_eq!(third.t, [0.0, 3.0, 6.0, 9.0, 15.0, 18.0]);
        assert_eq!(third.starts, [0, 2, 4, 6]);
    }
}
