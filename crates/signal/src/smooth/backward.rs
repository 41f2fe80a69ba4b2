//! The smoother of Rauch, Tung and Striebel (1965), backwards over the results of the filter.

use super::chain::{
    Cholesky, Matrix, State, Symmetric, Transition, dot, full, matrix_times, process_noise, sandwich, settled, sum,
    symmetric_part, with_variances_not_negative,
};
use super::filter::{Filtered, Series};

/// Longer intervals than this, in usual ones, keep what interpolation inside them needs.
const LONG: f64 = 2.0;

/// Smoothed states and covariances, in scaled units.
#[derive(Debug, Clone)]
pub(super) struct Smoothed {
    pub states: Vec<State>,
    pub covariances: Vec<Symmetric>,
    /// For each long interval, from the last to the first: the previous row, and the covariance of the state there
    /// (rows) with the state after it (columns).
    pub across: Vec<(usize, Matrix)>,
    /// Samples at which the motion restarted after a gap, from the last to the first.
    pub restarts: Vec<usize>,
}

/// One step back: xₛ = x + C (xₛ′ − x′) and Pₛ = B + C Pₛ′ Cᵀ.
#[derive(Debug, Clone, Copy)]
struct StepBack {
    gain: Matrix,
    own: Symmetric,
}

/// Smooths the filter's results (states and covariances kept) with the same `rho`.
pub(super) fn smooth_back(series: &Series, filtered: &Filtered, rho: f64) -> Smoothed {
    let n = series.z.len();
    let usual = Transition::new(1.0);
    let mut out =
        Smoothed { states: vec![[0.0; 4]; n], covariances: vec![[0.0; 10]; n], across: vec![], restarts: vec![] };
    let Some(last) = n.checked_sub(1) else { return out };
    let mut state = filtered.states[last];
    let mut covariance = with_variances_not_negative(*filtered.covariance(last));
    out.states[last] = state;
    out.covariances[last] = covariance;
    let mut step = None;
    let mut steady = false;
    for k in (0..last).rev() {
        let ratio = series.ratio[k + 1];
        let is_usual = ratio == 1.0;
        let index = filtered.update_of[k];
        let same = is_usual && matches!(step, Some((i, _)) if i == index);
        let back = match step {
            _ if filtered.restarts_at(k + 1) => StepBack { gain: [[0.0; 4]; 4], own: *filtered.covariance(k) },
            Some((_, back)) if same => back,
            _ => step_back(filtered.covariance(k), ratio, rho),
        };
        step = (is_usual && !filtered.restarts_at(k + 1)).then_some((index, back));
        let predicted = if is_usual { usual } else { Transition::new(ratio) }.apply(&filtered.states[k]);
        let ahead: State = std::array::from_fn(|i| state[i] - predicted[i]);
        let correction = matrix_times(&back.gain, &ahead);
        state = std::array::from_fn(|i| filtered.states[k][i] + correction[i]);
        if filtered.restarts_at(k + 1) {
            out.restarts.push(k + 1);
        }
        if ratio > LONG {
            out.across.push((k, product(&back.gain, &full(&covariance))));
        }
        if !(steady && same) {
            let next = with_variances_not_negative(sum(&back.own, &sandwich(&back.gain, &covariance)));
            steady = same && settled(&next, &covariance);
            covariance = next;
        }
        out.states[k] = state;
        out.covariances[k] = covariance;
    }
    out
}

/// C = Pf Fᵀ Pp⁻¹ and B = Pf − C Pp Cᵀ, where Pp = F Pf Fᵀ + Q. With W = Q Pp⁻¹ they are F⁻¹ (I − W) and F⁻¹ (Q − W Q)
/// F⁻ᵀ, which loses no digits where the filter knows far less than the smoother (at the start, and when q is small);
/// the first form loses few over a long gap.
fn step_back(filtered: &Symmetric, ratio: f64, rho: f64) -> StepBack {
    let forth = Transition::new(ratio);
    let noise = process_noise(ratio, rho);
    let predicted = sum(&forth.congruence(filtered), &noise);
    let factor = Cholesky::new(&predicted);
    if ratio <= LONG || noise[0] <= 0.5 * predicted[0] {
        let weight = full(&noise).map(|row| factor.solve(&row));
        let kept: Matrix = std::array::from_fn(|i| std::array::from_fn(|j| f64::from(i == j) - weight[i][j]));
        let back = inverse(ratio);
        let own = symmetric_part(&product(&kept, &full(&noise)));
        StepBack { gain: product(&back, &kept), own: Transition::new(-ratio).congruence(&own) }
    } else {
        let crossing: Matrix = full(filtered).map(|row| forth.apply(&row));
        let gain = crossing.map(|row| factor.solve(&row));
        let taken = symmetric_part(&std::array::from_fn(|i| gain.map(|row| dot(&row, &crossing[i]))));
        StepBack { gain, own: with_variances_not_negative(std::array::from_fn(|i| filtered[i] - taken[i])) }
    }
}

/// F⁻¹ as a matrix.
fn inverse(ratio: f64) -> Matrix {
    let back = Transition::new(-ratio);
    let columns: Matrix = std::array::from_fn(|j| {
        let mut unit = [0.0; 4];
        unit[j] = 1.0;
        back.apply(&unit)
    });
    std::array::from_fn(|i| std::array::from_fn(|j| columns[j][i]))
}

fn product(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| {
        std::array::from_fn(|j| a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j] + a[i][3] * b[3][j])
    })
}
