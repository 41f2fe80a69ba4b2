//! Uncertainties of the parameters: from the curvature, and from the scores for any noise.

use super::block::Lateness;
use super::block::{Normal, nuisance_columns};
use super::descent::Alignment;
use super::shape::Shape;
use super::{Gain, Uncertain};
use nalgebra::DMatrix;

/// Standard uncertainties of all parameters: nonlinear first, then gain (if free), offset and drift (if any) of each
/// component.
pub(crate) struct Uncertainties {
    /// From the curvature.
    pub(crate) hessian: Vec<f64>,
    /// From the sandwich.
    pub(crate) hac: Vec<f64>,
    /// Lag of the Bartlett window, samples.
    pub(crate) lags: usize,
    /// Samples minus parameters; those of the sandwich of the delay where it is the larger, which is known less well.
    pub(crate) degrees_of_freedom: f64,
    /// Of the delay, if the noise matches the model.
    pub(crate) crlb: f64,
    /// Index of the first coefficient common to all components.
    pub(crate) first_shared: usize,
    /// Index of the first linear parameter of each component.
    pub(crate) first_linear: Vec<usize>,
}

impl Uncertainties {
    /// The larger of the two.
    pub(crate) fn of(&self, parameter: usize) -> f64 {
        self.hessian[parameter].max(self.hac[parameter])
    }

    /// A value with the uncertainty of its parameter.
    pub(crate) fn with(&self, value: f64, parameter: usize) -> Uncertain {
        Uncertain { value, standard_uncertainty: self.of(parameter) }
    }
}

/// Share of the information of all rows to add if the rows at full weight do not determine all parameters. After a step
/// of the delay, all rows of a piece may be downweighted, which leaves its offset undetermined.
const HELD_BACK_SHARE: f64 = 1e-3;

/// Minimum pivot of a matrix with ones on its diagonal.
const LEAST_PIVOT: f64 = 1e-13;

/// How the scale of the noise is treated, and whether rows are weighted.
pub(crate) struct Conditions<'a> {
    /// Huber weights for each component, if any row is downweighted.
    pub(crate) weights: Option<&'a [Vec<f64>]>,
    /// The noise is given: its scale is not estimated from the residuals.
    pub(crate) known_scale: bool,
    /// The textbook sandwich: this lag of the Bartlett window instead of Andrews' rule, and the factor n/(n − p)
    /// instead of the leverage of each row.
    pub(crate) textbook_lags: Option<usize>,
}

/// Whitened derivatives of one component by its own and the common parameters.
struct Jacobian {
    /// Column and the index of its parameter.
    columns: Vec<(usize, Vec<f64>)>,
}

/// Uncertainties at `at`, where the residuals of the blocks are those of the fit.
///
/// Curvature: s² (JᵀJ)⁻¹ with s² = eᵀe/(n − p); with Huber weights ψ the asymptotic form
/// s²_ψ H⁻¹ (JᵀJ) H⁻¹, H = Jᵀ diag(ψ′) J (Huber 1981). Sandwich: Newey and West (1987), Bartlett window, lag by Andrews
/// (1991) from an AR(1) of the score of the delay; each residual over √(1 − its leverage), which makes it unbiased in
/// small samples (HC2, MacKinnon and White 1985), and degrees of freedom by Satterthwaite as Bell and McCaffrey (2002).
/// Scores of components with the same timestamp are added first, so that what they have in common counts. `None` if the
/// parameters cannot be distinguished.
pub(crate) fn uncertainties(
    alignment: &Alignment,
    at: &Lateness,
    normal: &Normal,
    conditions: &Conditions,
) -> Option<Uncertainties> {
    let layout = Layout::of(alignment, normal.shared.len())?;
    let prior_std: &[f64] = &alignment.blocks.first()?.shared.prior_std;
    let jacobians = layout.jacobians(alignment, at, normal);
    let n: usize = alignment.blocks.iter().map(|b| b.t.len()).sum();
    let parameters = layout.parameters;
    let degrees_of_freedom = n.checked_sub(parameters).filter(|d| *d > 0)? as f64;
    let (mut information, mut bread) = matrices(&jacobians, parameters, conditions.weights);
    for (k, std) in prior_std.iter().enumerate().take(normal.shared.len()) {
        information[(layout.curved + k, layout.curved + k)] += std.powi(-2);
        bread[(layout.curved + k, layout.curved + k)] += std.powi(-2);
    }
    let inverse = inverse_of(&bread).or_else(|| inverse_of(&(bread + &information * HELD_BACK_SHARE)))?;
    let rss: f64 = alignment.blocks.iter().map(|b| b.residuals.iter().map(|e| e * e).sum::<f64>()).sum();
    let scale = if conditions.known_scale { 1.0 } else { score_power(alignment, conditions, rss) / degrees_of_freedom };
    let covariance = &inverse * &information * &inverse * scale;
    let crlb = inverse_of(&information)?[(0, 0)].sqrt();
    let hessian: Vec<f64> = (0..parameters).map(|p| covariance[(p, p)].max(0.0).sqrt()).collect();
    let correction = conditions.textbook_lags.map_or(1.0, |_| n as f64 / degrees_of_freedom);
    let Sandwich { hac, lags, of_delay } = sandwich(alignment, &jacobians, &inverse, conditions, correction);
    let degrees_of_freedom = if hac[0] > hessian[0] { degrees_of_freedom.min(of_delay) } else { degrees_of_freedom };
    let (first_shared, first_linear) = (layout.curved, layout.first_linear);
    Some(Uncertainties { hessian, hac, lags, degrees_of_freedom, crlb, first_shared, first_linear })
}

/// Positions of all parameters: nonlinear first, then the coefficients common to all components.
struct Layout {
    curved: usize,
    /// One entry per component.
    first_linear: Vec<usize>,
    parameters: usize,
}

impl Layout {
    fn of(alignment: &Alignment, shared: usize) -> Option<Layout> {
        let curved = alignment.blocks.first()?.columns.len() - 1;
        let mut first_linear = vec![];
        let mut parameters = curved + shared;
        for block in &alignment.blocks {
            first_linear.push(parameters);
            parameters += block.linear_parameters();
        }
        Some(Layout { curved, first_linear, parameters })
    }

    /// One entry per component.
    fn jacobians(&self, alignment: &Alignment, at: &Lateness, normal: &Normal) -> Vec<Jacobian> {
        let of = |(c, first_linear): (usize, &usize)| {
            let shape = Shape::of(alignment, c, at, normal);
            jacobian(alignment, c, shape, &Places { curved: self.curved, first_linear: *first_linear })
        };
        self.first_linear.iter().enumerate().map(of).collect()
    }
}

/// Standard uncertainties of the sandwich, the lag of its window, and degrees of freedom of that of the delay.
struct Sandwich {
    hac: Vec<f64>,
    lags: usize,
    of_delay: f64,
}

fn sandwich(
    alignment: &Alignment,
    jacobians: &[Jacobian],
    inverse: &DMatrix<f64>,
    conditions: &Conditions,
    correction: f64,
) -> Sandwich {
    let leverages: Vec<Vec<f64>> = match conditions.textbook_lags {
        Some(_) => alignment.blocks.iter().map(|b| vec![0.0; b.t.len()]).collect(),
        None => jacobians.iter().map(|j| leverages(j, inverse)).collect(),
    };
    let instants = Instants::of(alignment);
    let series = |parameter: usize| influence(alignment, jacobians, &leverages, inverse, (&instants, parameter));
    let delay_series = series(0);
    let lags = conditions.textbook_lags.unwrap_or_else(|| andrews_lags(&delay_series));
    let of = |s: &[f64]| (bartlett_sum(s, lags) * correction).max(0.0).sqrt();
    let hac: Vec<f64> = (0..inverse.nrows()).map(|p| if p == 0 { of(&delay_series) } else { of(&series(p)) }).collect();
    Sandwich { hac, lags, of_delay: bartlett_degrees_of_freedom(&delay_series, lags) }
}

/// Cramér–Rao bound of the delay at `at` and `gain`, in the unit of the blocks' time.
pub(crate) fn information_of_delay(alignment: &Alignment, at: &Lateness, gain: f64) -> Option<f64> {
    let parameters = 1 + alignment.blocks.first()?.linear_parameters();
    let shape = Shape::with(alignment, 0, at, gain, &[]);
    let jacobian = jacobian(alignment, 0, shape, &Places { curved: 1, first_linear: 1 });
    let (information, _) = matrices(&[jacobian], parameters, None);
    Some(inverse_of(&information)?[(0, 0)].sqrt())
}

/// Sum of ψ²: weighted residuals are e = √w z with ψ = w z.
fn score_power(alignment: &Alignment, conditions: &Conditions, rss: f64) -> f64 {
    let Some(weights) = conditions.weights else { return rss };
    let power = |(block, w): (&super::block::Block, &Vec<f64>)| -> f64 {
        block.residuals.iter().zip(w).map(|(e, w)| e * e * w).sum()
    };
    alignment.blocks.iter().zip(weights).map(power).sum()
}

/// Positions of the parameters of a component: shared coefficients follow the nonlinear ones.
struct Places {
    curved: usize,
    first_linear: usize,
}

fn jacobian(alignment: &Alignment, c: usize, shape: Shape, places: &Places) -> Jacobian {
    let (block, measurement) = (&alignment.blocks[c], &alignment.measurements[c]);
    let mut columns = vec![(0, shape.slope.iter().map(|rate| -rate).collect::<Vec<f64>>())];
    if places.curved > 1 {
        let by_skew = shape.slope.iter().zip(&block.t).map(|(rate, t)| rate * (t - alignment.middle_s));
        columns.push((1, by_skew.collect()));
    }
    columns.extend(shape.shared.into_iter().enumerate().map(|(k, column)| (places.curved + k, column)));
    let mut linear: Vec<Vec<f64>> = vec![];
    if let Gain::Free { .. } = block.gain {
        linear.push(shape.values);
    }
    linear.extend(nuisance_columns(&block.t, measurement.drift, alignment.middle_s));
    columns.extend(linear.into_iter().enumerate().map(|(k, column)| (places.first_linear + k, column)));
    for (_, column) in &mut columns {
        block.filter.apply([column]);
    }
    Jacobian { columns }
}

/// JᵀJ, and Jᵀ diag(ψ′) J. Rows are √w times the whitened ones: downweighted rows count in full in the first and not at
/// all in the second.
fn matrices(jacobians: &[Jacobian], parameters: usize, weights: Option<&[Vec<f64>]>) -> (DMatrix<f64>, DMatrix<f64>) {
    let mut information = DMatrix::zeros(parameters, parameters);
    let mut bread = DMatrix::zeros(parameters, parameters);
    for (c, jacobian) in jacobians.iter().enumerate() {
        for (i, a) in &jacobian.columns {
            for (j, b) in &jacobian.columns {
                let products = a.iter().zip(b).map(|(a, b)| a * b);
                match weights.map(|w| &w[c]) {
                    None => information[(*i, *j)] += products.sum::<f64>(),
                    Some(w) => {
                        information[(*i, *j)] += products.clone().zip(w).map(|(p, w)| p / w).sum::<f64>();
                        bread[(*i, *j)] += products.zip(w).filter(|(_, w)| **w == 1.0).map(|(p, _)| p).sum::<f64>();
                    }
                }
            }
        }
    }
    if weights.is_none() {
        bread.copy_from(&information);
    }
    (information, bread)
}

/// Inverse of a symmetric matrix whose rows may have very different units; `None` if it is singular to rounding.
fn inverse_of(matrix: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let n = matrix.nrows();
    let scale: Vec<f64> = (0..n).map(|i| matrix[(i, i)].sqrt()).collect();
    if !scale.iter().all(|s| *s > 0.0 && s.is_finite()) {
        return None;
    }
    let balanced = DMatrix::from_fn(n, n, |i, j| matrix[(i, j)] / (scale[i] * scale[j]));
    let factor = balanced.cholesky()?;
    if factor.l_dirty().diagonal().iter().any(|pivot| pivot * pivot < LEAST_PIVOT) {
        return None;
    }
    let inverse = factor.inverse();
    Some(DMatrix::from_fn(n, n, |i, j| inverse[(i, j)] / (scale[i] * scale[j])))
}

/// Leverage of each row: the diagonal of J H⁻¹ Jᵀ, kept below 1.
fn leverages(jacobian: &Jacobian, inverse: &DMatrix<f64>) -> Vec<f64> {
    let mut leverages = vec![0.0; jacobian.columns.first().map_or(0, |c| c.1.len())];
    for (i, a) in &jacobian.columns {
        for (j, b) in &jacobian.columns {
            let share = inverse[(*i, *j)];
            leverages.iter_mut().zip(a.iter().zip(b)).for_each(|(l, (a, b))| *l += share * a * b);
        }
    }
    leverages.iter_mut().for_each(|l| *l = l.clamp(0.0, 0.9));
    leverages
}

/// Maps rows of the components to common instants.
struct Instants {
    /// Index among all instants, rising, of each row of each component.
    places: Vec<Vec<usize>>,
    count: usize,
}

impl Instants {
    fn of(alignment: &Alignment) -> Instants {
        let stamps = |c: usize| alignment.blocks[c].t.iter().enumerate().map(move |(k, t)| (*t, c, k));
        let mut all: Vec<(f64, usize, usize)> = (0..alignment.blocks.len()).flat_map(stamps).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut places: Vec<Vec<usize>> = alignment.blocks.iter().map(|b| vec![0; b.t.len()]).collect();
        let mut count = 0;
        for (i, (t, c, k)) in all.iter().enumerate() {
            count += usize::from(i == 0 || all[i - 1].0 < *t);
            places[*c][*k] = count - 1;
        }
        Instants { places, count }
    }
}

/// Contribution of each instant to the error of `parameter`: its row of H⁻¹ Jᵀψ, summed over samples of one instant.
fn influence(
    alignment: &Alignment,
    jacobians: &[Jacobian],
    leverages: &[Vec<f64>],
    inverse: &DMatrix<f64>,
    (instants, parameter): (&Instants, usize),
) -> Vec<f64> {
    let mut all = vec![0.0; instants.count];
    for (c, jacobian) in jacobians.iter().enumerate() {
        let residuals = &alignment.blocks[c].residuals;
        let mut sums = vec![0.0; residuals.len()];
        for (i, column) in &jacobian.columns {
            let share = inverse[(parameter, *i)];
            for (sum, x) in sums.iter_mut().zip(column) {
                *sum += share * x;
            }
        }
        for (k, (sum, (e, l))) in sums.iter().zip(residuals.iter().zip(&leverages[c])).enumerate() {
            all[instants.places[c][k]] += sum * e / (1.0 - l).sqrt();
        }
    }
    all
}

/// Σ s² + 2 Σ_l (1 − l/(lags + 1)) Σ s_k s_{k−l}: the variance of the sum of a series (Newey and West 1987).
pub(crate) fn bartlett_sum(series: &[f64], lags: usize) -> f64 {
    let at = |lag: usize| -> f64 { crate::projection::dot(&series[lag..], &series[..series.len() - lag]) };
    let lags_here = lags.min(series.len().saturating_sub(1));
    at(0) + (1..=lags_here).map(|l| 2.0 * (1.0 - l as f64 / (lags + 1) as f64) * at(l)).sum::<f64>()
}

/// Degrees of freedom of [`bartlett_sum`] by Satterthwaite, for independent Gaussian terms of unequal size:
/// 2 V²/var V with var V = ⅔ Σ s⁴ + 4 Σ_l w_l² Σ s_k² s_{k−l}².
fn bartlett_degrees_of_freedom(series: &[f64], lags: usize) -> f64 {
    let squares: Vec<f64> = series.iter().map(|s| s * s).collect();
    let total: f64 = squares.iter().sum();
    let at = |lag: usize| -> f64 { crate::projection::dot(&squares[lag..], &squares[..squares.len() - lag]) };
    let weight = |l: usize| 1.0 - l as f64 / (lags + 1) as f64;
    let last = lags.min(series.len().saturating_sub(1));
    let variance = at(0) * 2.0 / 3.0 + (1..=last).map(|l| 4.0 * weight(l).powi(2) * at(l)).sum::<f64>();
    if variance > 0.0 { (2.0 * total * total / variance).max(3.0) } else { f64::INFINITY }
}

/// Lag of the Bartlett window by Andrews (1991): 1.1447 (α n)^⅓ with α of an AR(1), at least 1, at most n/4.
pub(crate) fn andrews_lags(series: &[f64]) -> usize {
    let n = series.len() as f64;
    let rho = crate::autocorrelation(series, 1).first().copied().unwrap_or(0.0).clamp(-0.97, 0.97);
    let alpha = 4.0 * rho * rho / ((1.0 - rho) * (1.0 + rho)).powi(2);
    ((1.1447 * (alpha * n).cbrt()).ceil() as usize).clamp(1, (series.len() / 4).max(1))
}
