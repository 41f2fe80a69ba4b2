//! Four integrators in a row, driven by white noise, in the scaled states of Nordsieck (1962):
//! sᵢ = hⁱ/i! · x⁽ⁱ⁾ with h the usual interval, and everything in units of the measurement's
//! standard deviation. All numbers are then of moderate size whatever the rate.

/// A symmetric 4 × 4 matrix by its upper triangle, row by row.
pub(super) type Symmetric = [f64; 10];
/// A 4 × 4 matrix.
pub(super) type Matrix = [[f64; 4]; 4];
/// Four states.
pub(super) type State = [f64; 4];

/// Rows of the diagonal in [`Symmetric`].
const DIAGONAL: [usize; 4] = [0, 4, 7, 9];

/// The step over `ratio` usual intervals: F = [C(j,i) rʲ⁻ⁱ], upper triangular.
#[derive(Debug, Clone, Copy)]
pub(super) struct Transition {
    f01: f64,
    f02: f64,
    f03: f64,
    f12: f64,
    f13: f64,
    f23: f64,
}

impl Transition {
    pub(super) fn new(ratio: f64) -> Transition {
        let square = ratio * ratio;
        Transition {
            f01: ratio,
            f02: square,
            f03: square * ratio,
            f12: 2.0 * ratio,
            f13: 3.0 * square,
            f23: 3.0 * ratio,
        }
    }

    /// F x.
    pub(super) fn apply(&self, x: &State) -> State {
        [
            x[0] + self.f01 * x[1] + self.f02 * x[2] + self.f03 * x[3],
            x[1] + self.f12 * x[2] + self.f13 * x[3],
            x[2] + self.f23 * x[3],
            x[3],
        ]
    }

    /// Fᵀ λ.
    pub(super) fn apply_transposed(&self, l: &State) -> State {
        [
            l[0],
            l[1] + self.f01 * l[0],
            l[2] + self.f12 * l[1] + self.f02 * l[0],
            l[3] + self.f23 * l[2] + self.f13 * l[1] + self.f03 * l[0],
        ]
    }

    /// F P Fᵀ.
    pub(super) fn congruence(&self, p: &Symmetric) -> Symmetric {
        let Transition { f01, f02, f03, f12, f13, f23 } = *self;
        let [p00, p01, p02, p03, p11, p12, p13, p22, p23, p33] = *p;
        let a00 = p00 + f01 * p01 + f02 * p02 + f03 * p03;
        let a01 = p01 + f01 * p11 + f02 * p12 + f03 * p13;
        let a02 = p02 + f01 * p12 + f02 * p22 + f03 * p23;
        let a03 = p03 + f01 * p13 + f02 * p23 + f03 * p33;
        let a11 = p11 + f12 * p12 + f13 * p13;
        let a12 = p12 + f12 * p22 + f13 * p23;
        let a13 = p13 + f12 * p23 + f13 * p33;
        let a22 = p22 + f23 * p23;
        let a23 = p23 + f23 * p33;
        [
            a00 + f01 * a01 + f02 * a02 + f03 * a03,
            a01 + f12 * a02 + f13 * a03,
            a02 + f23 * a03,
            a03,
            a11 + f12 * a12 + f13 * a13,
            a12 + f23 * a13,
            a13,
            a22 + f23 * a23,
            a23,
            p33,
        ]
    }

    /// Fᵀ Λ F.
    pub(super) fn congruence_transposed(&self, l: &Symmetric) -> Symmetric {
        let Transition { f01, f02, f03, f12, f13, f23 } = *self;
        let [l00, l01, l02, l03, l11, l12, l13, l22, l23, l33] = *l;
        let m01 = l01 + f01 * l00;
        let m02 = l02 + f12 * l01 + f02 * l00;
        let m03 = l03 + f23 * l02 + f13 * l01 + f03 * l00;
        let (g11, g12, g13) = (l11 + f01 * l01, l12 + f01 * l02, l13 + f01 * l03);
        let g21 = l12 + f12 * l11 + f02 * l01;
        let g22 = l22 + f12 * l12 + f02 * l02;
        let g23 = l23 + f12 * l13 + f02 * l03;
        let g31 = l13 + f23 * l12 + f13 * l11 + f03 * l01;
        let g32 = l23 + f23 * l22 + f13 * l12 + f03 * l02;
        let g33 = l33 + f23 * l23 + f13 * l13 + f03 * l03;
        [
            l00,
            m01,
            m02,
            m03,
            g11 + f01 * m01,
            g12 + f12 * g11 + f02 * m01,
            g13 + f23 * g12 + f13 * g11 + f03 * m01,
            g22 + f12 * g21 + f02 * m02,
            g23 + f23 * g22 + f13 * g21 + f03 * m02,
            g33 + f23 * g32 + f13 * g31 + f03 * m03,
        ]
    }
}

/// Noise gathered over `ratio` usual intervals: Qᵢⱼ = ρ C(3,i) C(3,j) r⁷⁻ⁱ⁻ʲ/(7−i−j), with
/// ρ = q h⁷/(36 R) for snap of spectral density q and measurement variance R.
pub(super) fn process_noise(ratio: f64, rho: f64) -> Symmetric {
    let r2 = ratio * ratio;
    let (r3, r4) = (r2 * ratio, r2 * r2);
    let (r5, r6, r7) = (r4 * ratio, r4 * r2, r4 * r3);
    [
        rho * r7 / 7.0,
        rho * r6 * 0.5,
        rho * r5 * 0.6,
        rho * r4 * 0.25,
        rho * r5 * 1.8,
        rho * r4 * 2.25,
        rho * r3,
        rho * r3 * 3.0,
        rho * r2 * 1.5,
        rho * ratio,
    ]
}

/// a + b.
pub(super) fn sum(a: &Symmetric, b: &Symmetric) -> Symmetric {
    std::array::from_fn(|i| a[i] + b[i])
}

/// P x.
pub(super) fn times(p: &Symmetric, x: &State) -> State {
    [
        p[0] * x[0] + p[1] * x[1] + p[2] * x[2] + p[3] * x[3],
        p[1] * x[0] + p[4] * x[1] + p[5] * x[2] + p[6] * x[3],
        p[2] * x[0] + p[5] * x[1] + p[7] * x[2] + p[8] * x[3],
        p[3] * x[0] + p[6] * x[1] + p[8] * x[2] + p[9] * x[3],
    ]
}

/// Scalar product.
pub(super) fn dot(a: &State, b: &State) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
}

/// M x.
pub(super) fn matrix_times(m: &Matrix, x: &State) -> State {
    [dot(&m[0], x), dot(&m[1], x), dot(&m[2], x), dot(&m[3], x)]
}

/// M P Mᵀ.
pub(super) fn sandwich(m: &Matrix, p: &Symmetric) -> Symmetric {
    let half = m.map(|row| times(p, &row));
    [
        dot(&half[0], &m[0]),
        dot(&half[0], &m[1]),
        dot(&half[0], &m[2]),
        dot(&half[0], &m[3]),
        dot(&half[1], &m[1]),
        dot(&half[1], &m[2]),
        dot(&half[1], &m[3]),
        dot(&half[2], &m[2]),
        dot(&half[2], &m[3]),
        dot(&half[3], &m[3]),
    ]
}

/// The whole matrix.
pub(super) fn full(p: &Symmetric) -> Matrix {
    [[p[0], p[1], p[2], p[3]], [p[1], p[4], p[5], p[6]], [p[2], p[5], p[7], p[8]], [p[3], p[6], p[8], p[9]]]
}

/// The symmetric part of a matrix.
pub(super) fn symmetric_part(m: &Matrix) -> Symmetric {
    let mean = |i: usize, j: usize| 0.5 * (m[i][j] + m[j][i]);
    [m[0][0], mean(0, 1), mean(0, 2), mean(0, 3), m[1][1], mean(1, 2), mean(1, 3), m[2][2], mean(2, 3), m[3][3]]
}

/// A matrix with its negative variances, which rounding can leave, at zero.
pub(super) fn with_variances_not_negative(mut p: Symmetric) -> Symmetric {
    for i in DIAGONAL {
        p[i] = p[i].max(0.0);
    }
    p
}

/// Whether the variances of two matrices agree to about rounding.
pub(super) fn settled(new: &Symmetric, old: &Symmetric) -> bool {
    const TOLERANCE: f64 = 1e-13;
    DIAGONAL.iter().all(|&i| (new[i] - old[i]).abs() <= TOLERANCE * new[i].abs())
}

/// The Cholesky factor of a covariance, ready to solve with. Its accuracy does not depend on the
/// units of the states.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cholesky {
    lower: Matrix,
    inverse_pivot: State,
}

impl Cholesky {
    /// Directions without variance (to rounding) receive no correction.
    #[expect(clippy::needless_range_loop, reason = "the indices are those of the textbook")]
    pub(super) fn new(p: &Symmetric) -> Cholesky {
        let p = full(p);
        let mut factor = Cholesky { lower: [[0.0; 4]; 4], inverse_pivot: [0.0; 4] };
        for j in 0..4 {
            let mut pivot = p[j][j];
            for k in 0..j {
                pivot -= factor.lower[j][k] * factor.lower[j][k];
            }
            let usable = pivot > 1e-15 * p[j][j];
            factor.inverse_pivot[j] = if usable { 1.0 / pivot.sqrt() } else { 0.0 };
            for i in j + 1..4 {
                let mut entry = p[i][j];
                for k in 0..j {
                    entry -= factor.lower[i][k] * factor.lower[j][k];
                }
                factor.lower[i][j] = entry * factor.inverse_pivot[j];
            }
        }
        factor
    }

    /// P⁻¹ b.
    pub(super) fn solve(&self, b: &State) -> State {
        let (l, d) = (&self.lower, &self.inverse_pivot);
        let y0 = b[0] * d[0];
        let y1 = (b[1] - l[1][0] * y0) * d[1];
        let y2 = (b[2] - l[2][0] * y0 - l[2][1] * y1) * d[2];
        let y3 = (b[3] - l[3][0] * y0 - l[3][1] * y1 - l[3][2] * y2) * d[3];
        let x3 = y3 * d[3];
        let x2 = (y2 - l[3][2] * x3) * d[2];
        let x1 = (y1 - l[2][1] * x2 - l[3][1] * x3) * d[1];
        let x0 = (y0 - l[1][0] * x1 - l[2][0] * x2 - l[3][0] * x3) * d[0];
        [x0, x1, x2, x3]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `wiener_m4_dt0p01_q1` of the project's acceptance vectors: F and Q at 10 ms, q = 1.
    #[test]
    fn transition_and_noise_equal_the_acceptance_vector() {
        let vectors: serde_json::Value =
            serde_json::from_str(include_str!("../../tests/smoother_vectors.json")).unwrap();
        let case = &vectors["wiener_m4_dt0p01_q1"];
        let h: f64 = 0.01;
        let scale = [1.0, h, h * h / 2.0, h.powi(3) / 6.0];
        let q = full(&process_noise(1.0, h.powi(7) / 36.0));
        for i in 0..4 {
            for j in 0..4 {
                let mut unit = [0.0; 4];
                unit[j] = scale[j];
                let f = Transition::new(1.0).apply(&unit)[i] / scale[i];
                let expected = case["F"][i][j].as_f64().unwrap();
                assert!((f - expected).abs() <= 1e-12 * expected, "F[{i}][{j}] = {f}");
                let expected = case["Q"][i][j].as_f64().unwrap();
                let found = q[i][j] / scale[i] / scale[j];
                assert!((found - expected).abs() <= 1e-12 * expected, "Q[{i}][{j}] = {found}");
            }
        }
    }

    /// Against nalgebra, at an interval that is not the usual one.
    #[test]
    fn hand_written_products_agree_with_general_matrices() {
        use nalgebra::{Matrix4, Vector4};
        let p = process_noise(1.7, 3.0);
        let matrix = |m: &Matrix| Matrix4::from_fn(|i, j| m[i][j]);
        let transition = Transition::new(0.6);
        let f = Matrix4::from_fn(|i, j| {
            let mut unit = [0.0; 4];
            unit[j] = 1.0;
            transition.apply(&unit)[i]
        });
        let whole = matrix(&full(&p));
        let near = |a: Matrix4<f64>, b: Matrix4<f64>| (a - b).abs().max() < 1e-12 * b.abs().max();
        assert!(near(matrix(&full(&transition.congruence(&p))), f * whole * f.transpose()));
        assert!(near(matrix(&full(&transition.congruence_transposed(&p))), f.transpose() * whole * f));
        let x = [0.3, -1.0, 2.0, 0.7];
        let v = Vector4::from(x);
        assert!((Vector4::from(transition.apply_transposed(&x)) - f.transpose() * v).norm() < 1e-12);
        assert!((Vector4::from(times(&p, &x)) - whole * v).norm() < 1e-12 * whole.norm());
        let solved = Vector4::from(Cholesky::new(&p).solve(&x));
        assert!((whole * solved - v).norm() < 1e-10, "{}", (whole * solved - v).norm());
        let m = full(&process_noise(0.9, 1.0));
        let general = matrix(&m) * whole * matrix(&m).transpose();
        assert!(near(matrix(&full(&sandwich(&m, &p))), general));
    }
}
