//! Products of two series after removing the offset and drift of each piece.

use super::Sample;
use std::collections::BTreeMap;

/// Sums of one piece over both axes, sufficient for the products.
#[derive(Default)]
struct Piece {
    /// Time of the first sample: sums of times near zero lose no precision.
    begin_s: f64,
    /// Σw, Σwt, Σwt².
    time: [f64; 3],
    axes: [Axis; 2],
}

/// Sums of one axis; the series are forward, right and velocity.
#[derive(Default)]
struct Axis {
    /// Σwx of each.
    plain: [f64; 3],
    /// Σwtx of each.
    timed: [f64; 3],
    /// Σ wxv of each with the velocity.
    product: [f64; 3],
}

/// Sums by piece.
#[derive(Default)]
pub(super) struct Projected {
    pieces: BTreeMap<usize, Piece>,
}

impl Projected {
    pub(super) fn add(&mut self, sample: &Sample) {
        let fresh = || Piece { begin_s: sample.time_s, ..Piece::default() };
        let piece = self.pieces.entry(sample.piece).or_insert_with(fresh);
        let (w, t) = (sample.weight, sample.time_s - piece.begin_s);
        for (sum, value) in piece.time.iter_mut().zip([w, w * t, w * t * t]) {
            *sum += value;
        }
        let [north, east] = sample.forward;
        let right = [-east, north];
        for (axis, sums) in piece.axes.iter_mut().enumerate() {
            let v = sample.velocity[axis];
            for (series, x) in [sample.forward[axis], right[axis], v].into_iter().enumerate() {
                sums.plain[series] += w * x;
                sums.timed[series] += w * t * x;
                sums.product[series] += w * x * v;
            }
        }
    }

    /// Σ w (Px)·(Pv) of forward, right and velocity.
    pub(super) fn products(&self, drift: bool) -> [f64; 3] {
        let mut products = [0.0; 3];
        for piece in self.pieces.values() {
            for axis in &piece.axes {
                for (series, product) in products.iter_mut().enumerate() {
                    *product += piece.product(axis, series, drift);
                }
            }
        }
        products
    }

    /// Σ w v·v without any projection.
    pub(super) fn power(&self) -> f64 {
        self.pieces.values().flat_map(|piece| &piece.axes).map(|axis| axis.product[2]).sum()
    }
}

impl Piece {
    /// Product of one series with the velocity, without what the regression on 1 and t explains.
    fn product(&self, axis: &Axis, series: usize, drift: bool) -> f64 {
        let [w, wt, wtt] = self.time;
        if w <= 0.0 {
            return 0.0;
        }
        let velocity = 2;
        let mut left = axis.product[series] - axis.plain[series] * axis.plain[velocity] / w;
        let spread = wtt - wt * wt / w;
        if drift && spread > 1e-12 * wtt {
            let slope = |series: usize| axis.timed[series] - axis.plain[series] * wt / w;
            left -= slope(series) * slope(velocity) / spread;
        }
        left
    }
}
