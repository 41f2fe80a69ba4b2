//! One regression over both accelerometer axes in the swing's plane: six numbers that the axes share.

use crate::kinematics::BarState;
use crate::pattern::{PatternFit, Samples};
use nalgebra::{DMatrix, DVector};
use record::Estimate;
use signal::regress;

/// A lever arm that shrinks by more than this share, because the angular acceleration is itself uncertain, is not
/// fitted: acceleration and gravity vary alike.
const MOST_ATTENUATION: f64 = 0.03;
/// Accuracy of a lever arm from the rig file, m.
const STATED_ARM_M: f64 = 0.005;

/// Input of the fit.
pub(crate) struct ForceTerms {
    pub(crate) gravity: f64,
    /// Typical standard uncertainties of the bar's angle, rate and acceleration.
    pub(crate) typical: [f64; 3],
    /// r_z and r_x of the rig, m.
    pub(crate) stated: [f64; 2],
}

/// Decomposition of an accelerometer's reading, for one sign of the encoder.
#[derive(Debug, Clone)]
pub(crate) struct ForceFit {
    /// cos ξ₀ and sin ξ₀ times the scale, r_z, r_x, bias x, bias z.
    pub(crate) coefficients: [f64; 6],
    /// Their covariance: from the residuals, and from the uncertainty of the motion or of the stated arm.
    pub(crate) covariance: DMatrix<f64>,
    /// Sum of squared residuals.
    pub(crate) rest: f64,
    /// Whether the lever arm was fitted; if not, it is the rig's.
    pub(crate) arm_is_fitted: bool,
}

impl ForceFit {
    /// Coefficient `k` with its standard uncertainty.
    pub(crate) fn estimate(&self, k: usize) -> Estimate {
        super::estimate(self.coefficients[k], self.covariance[(k, k)].max(0.0).sqrt())
    }

    /// Standard uncertainty of a function of the coefficients, given its gradient by the first two.
    pub(crate) fn spread_of_gravity(&self, by_cos: f64, by_sin: f64) -> f64 {
        let c = &self.covariance;
        let variance = by_cos * by_cos * c[(0, 0)] + by_sin * by_sin * c[(1, 1)] + 2.0 * by_cos * by_sin * c[(0, 1)];
        variance.max(0.0).sqrt()
    }
}

/// Fits for sign +1 and −1. `None` if x or z is missing, or the swing shows nothing.
pub(crate) fn force_fits(
    samples: &Samples,
    fit: &PatternFit,
    component: &[usize],
    terms: &ForceTerms,
) -> Option<[ForceFit; 2]> {
    let x = component.iter().position(|c| *c == 0)?;
    let z = component.iter().position(|c| *c == 2)?;
    let y: Vec<f64> =
        [x, z].iter().flat_map(|&k| fit.rows.iter().map(move |&row| samples.components[k][row])).collect();
    let of_sign = |sign: f64| {
        let columns = columns(&fit.states, sign, terms.gravity);
        with_arm(&columns, &y, &fit.states, terms.typical).or_else(|| without_arm(&columns, &y, terms.stated))
    };
    Some([of_sign(1.0)?, of_sign(-1.0)?])
}

/// With ξ = sθ + ξ₀: `f_X = s r_z θ″ − r_x θ′² + g sin ξ + b_x`, `f_Z = −s r_x θ″ − r_z θ′² − g cos ξ + b_z`, linear in the
/// six unknowns. Gravity columns are scaled by `gravity`, so that their coefficients are cos ξ₀ and sin ξ₀ times the
/// accelerometer's scale.
fn columns(states: &[BarState], sign: f64, gravity: f64) -> [Vec<f64>; 6] {
    let stacked = |x: &dyn Fn(&BarState) -> f64, z: &dyn Fn(&BarState) -> f64| {
        states.iter().map(x).chain(states.iter().map(z)).collect::<Vec<f64>>()
    };
    [
        stacked(&|b| gravity * sign * b.angle.sin(), &|b| -gravity * b.angle.cos()),
        stacked(&|b| gravity * b.angle.cos(), &|b| gravity * sign * b.angle.sin()),
        stacked(&|b| sign * b.acceleration, &|b| -b.rate * b.rate),
        stacked(&|b| -b.rate * b.rate, &|b| -sign * b.acceleration),
        stacked(&|_| 1.0, &|_| 0.0),
        stacked(&|_| 0.0, &|_| 1.0),
    ]
}

fn normal_inverse(columns: &[&[f64]]) -> Option<DMatrix<f64>> {
    let n = columns.len();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    DMatrix::from_fn(n, n, |i, j| dot(columns[i], columns[j])).try_inverse()
}

fn squares(values: &[f64]) -> f64 {
    values.iter().map(|r| r * r).sum()
}

fn matrix(rows: &[Vec<f64>]) -> DMatrix<f64> {
    DMatrix::from_fn(rows.len(), rows.len(), |i, j| rows[i][j])
}

/// Fits all six. An uncertain regressor pulls its coefficient towards zero and affects the others, by (XᵀX)⁻¹ N β with
/// N the summed variance of the regressors: that bias is added to the covariance, and if it is large there is no fit.
fn with_arm(columns: &[Vec<f64>; 6], y: &[f64], states: &[BarState], typical: [f64; 3]) -> Option<ForceFit> {
    let slices: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
    let fit = regress(&slices, &["g cos", "g sin", "r_z", "r_x", "bias x", "bias z"], y).ok()?;
    let inverse = normal_inverse(&slices)?;
    let noise: f64 = states.iter().map(|b| typical[2].powi(2) + (2.0 * b.rate * typical[1]).powi(2)).sum();
    if inverse[(2, 2)].max(inverse[(3, 3)]) * noise > MOST_ATTENUATION {
        return None;
    }
    let beta = DVector::from_fn(6, |k, _| if k == 2 || k == 3 { noise * fit.coefficients[k] } else { 0.0 });
    let bias = inverse * beta;
    Some(ForceFit {
        coefficients: std::array::from_fn(|k| fit.coefficients[k]),
        covariance: matrix(&fit.covariance) + &bias * bias.transpose(),
        rest: squares(&fit.residuals),
        arm_is_fitted: true,
    })
}

/// Fits gravity and biases, after subtracting the effect of the rig's lever arm from the readings.
fn without_arm(columns: &[Vec<f64>; 6], y: &[f64], [z, x]: [f64; 2]) -> Option<ForceFit> {
    let rest: Vec<f64> = (0..y.len()).map(|row| y[row] - z * columns[2][row] - x * columns[3][row]).collect();
    let kept = [0, 1, 4, 5];
    let slices: Vec<&[f64]> = kept.iter().map(|&k| columns[k].as_slice()).collect();
    let fit = regress(&slices, &["g cos", "g sin", "bias x", "bias z"], &rest).ok()?;
    let inverse = normal_inverse(&slices)?;
    let mut four = matrix(&fit.covariance);
    for arm in [2, 3] {
        let moved = DVector::from_fn(4, |k, _| slices[k].iter().zip(&columns[arm]).map(|(a, b)| a * b).sum::<f64>());
        let by_arm = &inverse * moved * STATED_ARM_M;
        four += &by_arm * by_arm.transpose();
    }
    let mut coefficients = [0.0, 0.0, z, x, 0.0, 0.0];
    let mut covariance = DMatrix::zeros(6, 6);
    for (i, &row) in kept.iter().enumerate() {
        coefficients[row] = fit.coefficients[i];
        for (j, &column) in kept.iter().enumerate() {
            covariance[(row, column)] = four[(i, j)];
        }
    }
    for arm in [2, 3] {
        covariance[(arm, arm)] = STATED_ARM_M * STATED_ARM_M;
    }
    Some(ForceFit { coefficients, covariance, rest: squares(&fit.residuals), arm_is_fitted: false })
}
