//! A smooth curve through points.

use crate::reference::Reference;

/// Why there is no spline.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SplineError {
    /// A curve needs two points.
    #[error("{knots} knots: a spline needs at least 2")]
    TooFewKnots {
        /// Number of knots.
        knots: usize,
    },
    /// Numbers of knots and values differ.
    #[error("{knots} knots for {values} values")]
    LengthsDiffer {
        /// Number of knots.
        knots: usize,
        /// Number of values.
        values: usize,
    },
    /// Knots must increase, and all numbers must be finite.
    #[error("knot {row} is not finite or not after the one before")]
    BadKnot {
        /// Row of the knot.
        row: usize,
    },
    /// All numbers must be finite.
    #[error("value {row} is not finite")]
    BadValue {
        /// Row of the value.
        row: usize,
    },
}

/// The cubic between one knot and the next: value, rate, half the second and a sixth of the third derivative at `t`.
#[derive(Debug, Clone, Copy)]
struct Piece {
    t: f64,
    coefficients: [f64; 4],
}

/// Cubic spline through irregular knots, with the not-a-knot condition at both ends (de Boor 1978, as SciPy's
/// `CubicSpline`): two knots give a line, three a parabola. Outside its ends it continues as the last cubic, which is
/// accurate for a fraction of a knot's distance only.
///
/// On a smooth signal the error falls with the fourth power of the knot spacing.
#[derive(Debug, Clone)]
pub struct CubicSpline {
    pieces: Vec<Piece>,
    end: f64,
    /// Index of the piece at the start of each of equally long intervals of the span.
    stretches: Vec<u32>,
    per_second: f64,
}

impl CubicSpline {
    /// The spline through the points (`t`, `y`).
    ///
    /// # Errors
    /// Fewer than two knots, knots that do not increase, numbers that are not finite.
    pub fn new(t: &[f64], y: &[f64]) -> Result<CubicSpline, SplineError> {
        check(t, y)?;
        let slopes = not_a_knot_slopes(t, y);
        let pieces: Vec<Piece> =
            (1..t.len()).map(|k| piece([t[k - 1], t[k]], [y[k - 1], y[k]], [slopes[k - 1], slopes[k]])).collect();
        let end = t[t.len() - 1];
        let per_second = pieces.len() as f64 / (end - t[0]);
        let stretches = stretches(&pieces, per_second);
        Ok(CubicSpline { pieces, end, stretches, per_second })
    }

    /// Value at `t`.
    #[must_use]
    pub fn value(&self, t: f64) -> f64 {
        self.value_and_rate(t).0
    }

    fn piece_at(&self, t: f64) -> &Piece {
        let last = self.stretches.len() - 1;
        let stretch = (((t - self.pieces[0].t) * self.per_second).max(0.0) as usize).min(last);
        // Rounding may put t one interval too early or too late: also check the neighbours on both sides.
        let from = self.stretches[stretch.saturating_sub(1)] as usize;
        let to = self.stretches.get(stretch + 2).map_or(self.pieces.len(), |p| *p as usize + 1);
        let mut at = self.stretches[stretch] as usize;
        if at + 1 < self.pieces.len() && self.pieces[at + 1].t <= t {
            at += 1;
            if at + 1 < self.pieces.len() && self.pieces[at + 1].t <= t {
                at = from + self.pieces[from..to].partition_point(|p| p.t <= t).saturating_sub(1);
            }
        } else if at > 0 && self.pieces[at].t > t {
            at = from + self.pieces[from..to].partition_point(|p| p.t <= t).saturating_sub(1);
        }
        &self.pieces[at]
    }
}

impl Reference for CubicSpline {
    fn span(&self) -> (f64, f64) {
        (self.pieces[0].t, self.end)
    }

    fn value_and_rate(&self, t: f64) -> (f64, f64) {
        let piece = self.piece_at(t);
        let [c0, c1, c2, c3] = piece.coefficients;
        let x = t - piece.t;
        (c0 + x * (c1 + x * (c2 + x * c3)), c1 + x * (2.0 * c2 + x * (3.0 * c3)))
    }

    /// As the default, but compiled with this crate: a quarter of the time of a fit is spent here.
    fn fill(&self, instants: &[f64], values: &mut [f64], rates: &mut [f64]) {
        for ((t, value), rate) in instants.iter().zip(values).zip(rates) {
            (*value, *rate) = self.value_and_rate(*t);
        }
    }
}

fn check(t: &[f64], y: &[f64]) -> Result<(), SplineError> {
    if t.len() != y.len() {
        return Err(SplineError::LengthsDiffer { knots: t.len(), values: y.len() });
    }
    if t.len() < 2 {
        return Err(SplineError::TooFewKnots { knots: t.len() });
    }
    if let Some(row) = (0..t.len()).find(|&k| !t[k].is_finite() || (k > 0 && t[k] <= t[k - 1])) {
        return Err(SplineError::BadKnot { row });
    }
    match y.iter().position(|y| !y.is_finite()) {
        Some(row) => Err(SplineError::BadValue { row }),
        None => Ok(()),
    }
}

/// The cubic with these values and slopes at both ends.
fn piece(t: [f64; 2], y: [f64; 2], slope: [f64; 2]) -> Piece {
    let h = t[1] - t[0];
    let chord = (y[1] - y[0]) / h;
    let cubic = (slope[0] + slope[1] - 2.0 * chord) / h;
    Piece { t: t[0], coefficients: [y[0], slope[0], (chord - slope[0]) / h - cubic, cubic / h] }
}

fn stretches(pieces: &[Piece], per_second: f64) -> Vec<u32> {
    let start = pieces[0].t;
    let mut at = 0;
    (0..pieces.len())
        .map(|k| {
            let t = start + k as f64 / per_second;
            while at + 1 < pieces.len() && pieces[at + 1].t <= t {
                at += 1;
            }
            at as u32
        })
        .collect()
}

/// Slopes at the knots that make second derivatives continuous, and the third at the second and the last knot but one.
fn not_a_knot_slopes(t: &[f64], y: &[f64]) -> Vec<f64> {
    let n = t.len();
    let h = |k: usize| t[k + 1] - t[k];
    let chord = |k: usize| (y[k + 1] - y[k]) / h(k);
    if n == 2 {
        return vec![chord(0); 2];
    }
    if n == 3 {
        let curve = (chord(1) - chord(0)) / (t[2] - t[0]);
        return vec![chord(0) - curve * h(0), chord(0) + curve * h(0), chord(1) + curve * h(1)];
    }
    // Rows (below, diagonal, above, right-hand side), solved by Thomas's algorithm.
    let (d, e) = (t[2] - t[0], t[n - 1] - t[n - 3]);
    let first = ((h(0) + 2.0 * d) * h(1) * chord(0) + h(0) * h(0) * chord(1)) / d;
    let (g, f) = (h(n - 2), h(n - 3));
    let last = (g * g * chord(n - 3) + (2.0 * e + g) * f * chord(n - 2)) / e;
    let mut above = vec![d / h(1)];
    let mut slopes = vec![first / h(1)];
    for k in 1..n {
        let (below, diagonal, over, right) = if k + 1 < n {
            (h(k), 2.0 * (h(k - 1) + h(k)), h(k - 1), 3.0 * (h(k) * chord(k - 1) + h(k - 1) * chord(k)))
        } else {
            (e, f, 0.0, last)
        };
        let pivot = diagonal - below * above[k - 1];
        above.push(over / pivot);
        slopes.push((right - below * slopes[k - 1]) / pivot);
    }
    for k in (0..n - 1).rev() {
        slopes[k] -= above[k] * slopes[k + 1];
    }
    slopes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cubic_is_reproduced_exactly_between_irregular_knots() {
        let cubic = |t: f64| 2.0 - t + 0.5 * t * t - 0.25 * t * t * t;
        let rate = |t: f64| -1.0 + t - 0.75 * t * t;
        let t = [-1.0, -0.2, 0.0, 0.7, 0.71, 3.0];
        let spline = CubicSpline::new(&t, &t.map(cubic)).unwrap();
        for k in 0..=400 {
            let q = -1.0 + 0.01 * f64::from(k);
            let (value, slope) = spline.value_and_rate(q);
            assert!((value - cubic(q)).abs() < 1e-12 && (slope - rate(q)).abs() < 1e-12);
        }
    }

    /// scipy.interpolate.CubicSpline([0, .5, .6, 1.5, 2, 4], [1, 0, 2, -1, .5, 3]) at .25, .55, 1.2, 3.9.
    #[test]
    fn values_and_rates_are_those_of_scipy() {
        let spline = CubicSpline::new(&[0.0, 0.5, 0.6, 1.5, 2.0, 4.0], &[1.0, 0.0, 2.0, -1.0, 0.5, 3.0]).unwrap();
        for (t, value, rate) in SCIPY {
            let found = spline.value_and_rate(t);
            assert!((found.0 - value).abs() < 1e-12 && (found.1 - rate).abs() < 1e-11, "{t}: {found:?}");
        }
    }

    const SCIPY: [(f64, f64, f64); 4] = [
        (0.25, -4.28460171568627, 5.12267156862744),
        (0.55, 1.06503210784314, 20.2849068627451),
        (1.2, 1.54787450980392, -10.0540784313725),
        (3.9, 6.00347294117647, -27.1400509803922),
    ];

    #[test]
    fn the_piece_is_found_for_any_knot_spacing() {
        let mut t: Vec<f64> = (0..200).map(|k| 1e-6 * f64::from(k)).collect();
        t.extend((1..50).map(|k| f64::from(k) * f64::from(k)));
        let y: Vec<f64> = t.iter().map(|t| 3.0 * t - 1.0).collect();
        let spline = CubicSpline::new(&t, &y).unwrap();
        for w in t.windows(2) {
            for q in [w[0], 0.5 * (w[0] + w[1]), w[1]] {
                let at = spline.piece_at(q).t;
                assert_eq!(at, *t[..t.len() - 1].iter().rfind(|k| **k <= q).unwrap());
            }
        }
    }

    #[test]
    fn bad_knots_are_errors() {
        assert_eq!(CubicSpline::new(&[1.0], &[1.0]).unwrap_err(), SplineError::TooFewKnots { knots: 1 });
        assert_eq!(CubicSpline::new(&[1.0, 1.0], &[1.0, 2.0]).unwrap_err(), SplineError::BadKnot { row: 1 });
        assert_eq!(CubicSpline::new(&[1.0, 2.0], &[1.0, f64::NAN]).unwrap_err(), SplineError::BadValue { row: 1 });
    }
}
