//! The used rows of one component, whitened, and the linear part of the fit.

use super::{Gain, Measurement, Sign};
use crate::projection::{dot, orthonormal_to, remove};
use crate::whiten::{NoiseModel, WhiteningFilter};

/// The nonlinear parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Lateness {
    pub(crate) delay_s: f64,
    pub(crate) skew: f64,
}

impl Lateness {
    /// True instant of a sample with timestamp `t`.
    pub(crate) fn true_instant(&self, t: f64, middle_s: f64) -> f64 {
        t - self.delay_s + self.skew * (t - middle_s)
    }
}

/// One component under one noise: holds what does not change during the search for the delay.
pub(crate) struct Block {
    /// Used rows of the measurement.
    pub(crate) rows: Vec<usize>,
    /// Their timestamps, s.
    pub(crate) t: Vec<f64>,
    pub(crate) gain: Gain,
    drift: bool,
    pub(crate) filter: WhiteningFilter,
    /// Whitened offset and drift, orthonormal.
    nuisances: Vec<Vec<f64>>,
    /// Whitened values minus their projection on the nuisances.
    values: Vec<f64>,
    /// Working space: the shape of the signal, then its derivatives by the nonlinear parameters, at gain 1.
    pub(crate) columns: Vec<Vec<f64>>,
    /// Whitened residuals of the last projection.
    pub(crate) residuals: Vec<f64>,
    /// Working space: instants that the rows show.
    instants: Vec<f64>,
    /// Columns whose coefficients all components share.
    pub(crate) shared: Shared,
    /// Squared length of the whitened shape before offset and drift are removed.
    whitened_power: f64,
}

/// Working space for the shared columns: values, rates, and the prior deviations of the coefficients.
#[derive(Default)]
pub(crate) struct Shared {
    pub(crate) columns: Vec<Vec<f64>>,
    pub(crate) rates: Vec<Vec<f64>>,
    pub(crate) prior_std: Vec<f64>,
}

/// Remainder of one component for one set of the nonlinear parameters.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Projection {
    /// Best gain; 0 if it would have the wrong sign.
    pub(crate) gain: f64,
    /// Whitened residual sum of squares.
    pub(crate) rss: f64,
    /// Squared length of the whitened shape, offset and drift removed: the inverse of the variance of the gain.
    pub(crate) power: f64,
    /// The same divided by its value before they were removed: 0 for a constant shape.
    pub(crate) moving_share: f64,
}

impl Block {
    /// `rows` of `measurement`, with `derivatives` columns in addition to the shape.
    pub(crate) fn new(
        measurement: &Measurement,
        rows: Vec<usize>,
        noise: &NoiseModel,
        weights: Option<&[f64]>,
        derivatives: usize,
    ) -> Block {
        let t: Vec<f64> = rows.iter().map(|&k| measurement.t[k]).collect();
        let filter = WhiteningFilter::new(&t, noise, weights);
        let mut nuisances: Vec<Vec<f64>> = vec![];
        for mut column in nuisance_columns(&t, measurement.drift, middle(&t)) {
            filter.apply([&mut column]);
            nuisances.extend(orthonormal_to(&column, &nuisances));
        }
        let mut values: Vec<f64> = rows.iter().map(|&k| measurement.y[k]).collect();
        filter.apply([&mut values]);
        let before = dot(&values, &values);
        nuisances.iter().for_each(|q| remove(&mut values, q));
        if dot(&values, &values) <= 1e-26 * before {
            // Constant values: only rounding remains.
            values.fill(0.0);
        }
        let columns = vec![vec![0.0; t.len()]; 1 + derivatives];
        let residuals = vec![0.0; t.len()];
        let prior_std: Vec<f64> = measurement.reference.shared().iter().map(|s| s.prior_std).collect();
        let empty = || vec![vec![0.0; t.len()]; prior_std.len()];
        let shared = Shared { columns: empty(), rates: empty(), prior_std };
        Block {
            instants: vec![0.0; t.len()],
            shared,
            whitened_power: 0.0,
            rows,
            t,
            gain: measurement.gain,
            drift: measurement.drift,
            filter,
            nuisances,
            values,
            columns,
            residuals,
        }
    }

    /// Fills the columns at `at`: shape and derivatives by delay and skew, not yet whitened; values and rates of the
    /// shared columns.
    pub(crate) fn fill(&mut self, measurement: &Measurement, at: &Lateness, middle_s: f64) {
        let (first, last) = measurement.reference.span();
        for (instant, t) in self.instants.iter_mut().zip(&self.t) {
            *instant = at.true_instant(*t, middle_s).clamp(first, last);
        }
        for (k, shared) in measurement.reference.shared().iter().enumerate().take(self.shared.columns.len()) {
            shared.reference.fill(&self.instants, &mut self.shared.columns[k], &mut self.shared.rates[k]);
        }
        let [shape, derivatives @ ..] = self.columns.as_mut_slice() else { return };
        match derivatives {
            // Values that are not needed go to columns that are overwritten later.
            [] => measurement.reference.fill(&self.instants, shape, &mut self.residuals),
            [by_delay, rest @ ..] => {
                measurement.reference.fill(&self.instants, shape, by_delay);
                if let Some(by_skew) = rest.first_mut() {
                    for (x, (rate, t)) in by_skew.iter_mut().zip(by_delay.iter().zip(&self.t)) {
                        *x = rate * (t - middle_s);
                    }
                }
                by_delay.iter_mut().for_each(|x| *x = -*x);
            }
        }
    }

    /// Parameters of this component: gain (if free), offset and drift.
    pub(crate) fn linear_parameters(&self) -> usize {
        1 + usize::from(self.drift) + usize::from(matches!(self.gain, Gain::Free { .. }))
    }

    /// Solves for gain, offset and drift, with `columns` filled in (not yet whitened). Afterwards `residuals` are the
    /// whitened residuals, and the derivative columns are multiplied by the gain and orthogonal to all linear
    /// parameters.
    pub(crate) fn project(&mut self) -> Projection {
        let raw = dot(&self.columns[0], &self.columns[0]);
        self.filter.apply_all(&mut self.columns);
        let whitened = dot(&self.columns[0], &self.columns[0]);
        for q in &self.nuisances {
            self.columns.iter_mut().for_each(|c| remove(c, q));
        }
        let linear_gain = matches!(self.gain, Gain::Free { .. });
        let [shape, derivatives @ ..] = self.columns.as_mut_slice() else {
            return Projection { gain: 0.0, rss: dot(&self.values, &self.values), power: 0.0, moving_share: 0.0 };
        };
        let power = dot(shape, shape);
        let moving_share = if raw > 0.0 && whitened > 0.0 { power / whitened } else { 0.0 };
        let gain = match self.gain {
            Gain::Fixed(gain) => gain,
            Gain::Free { sign } if moving_share > 1e-20 => with_sign(dot(shape, &self.values) / power, sign),
            Gain::Free { .. } => 0.0,
        };
        for (e, (y, x)) in self.residuals.iter_mut().zip(self.values.iter().zip(shape.iter())) {
            *e = y - gain * x;
        }
        for derivative in derivatives {
            let along = if linear_gain && power > 0.0 { dot(derivative, shape) / power } else { 0.0 };
            for (d, x) in derivative.iter_mut().zip(shape.iter()) {
                *d = gain * (*d - along * x);
            }
        }
        Projection { gain, rss: dot(&self.residuals, &self.residuals), power, moving_share }
    }
}

impl Block {
    fn fixed_gain(&self) -> f64 {
        match self.gain {
            Gain::Fixed(gain) => gain,
            Gain::Free { .. } => 0.0,
        }
    }

    /// Whitens shape and shared columns and removes offset and drift; `residuals` become the values minus gain times
    /// shape.
    fn whiten_shared(&mut self) {
        let gain = self.fixed_gain();
        self.filter.apply_all(&mut self.shared.columns);
        let Some(shape) = self.columns.first_mut() else { return };
        self.filter.apply([shape]);
        self.whitened_power = dot(shape, shape);
        for q in &self.nuisances {
            self.shared.columns.iter_mut().for_each(|c| remove(c, q));
            remove(shape, q);
        }
        for (e, (y, x)) in self.residuals.iter_mut().zip(self.values.iter().zip(shape.iter())) {
            *e = y - gain * x;
        }
    }

    /// As [`Block::project`] after [`Block::whiten_shared`], with the shared coefficients common to all blocks. Offset
    /// and drift are removed from the derivatives, the shared columns are not.
    fn project_shared(&mut self, coefficients: &[f64]) -> Projection {
        let gain = self.fixed_gain();
        for (column, c) in self.shared.columns.iter().zip(coefficients) {
            self.residuals.iter_mut().zip(column).for_each(|(e, x)| *e -= c * x);
        }
        let [shape, derivatives @ ..] = self.columns.as_mut_slice() else {
            return Projection { gain, rss: dot(&self.residuals, &self.residuals), power: 0.0, moving_share: 0.0 };
        };
        let power = dot(shape, shape);
        if let [by_delay, rest @ ..] = derivatives {
            by_delay.iter_mut().for_each(|d| *d *= gain);
            for (rate, c) in self.shared.rates.iter().zip(coefficients) {
                by_delay.iter_mut().zip(rate).for_each(|(d, rate)| *d -= c * rate);
            }
            rest.iter_mut().flatten().for_each(|d| *d *= gain);
        }
        self.filter.apply_all(derivatives);
        for q in &self.nuisances {
            derivatives.iter_mut().for_each(|d| remove(d, q));
        }
        let moving_share = if self.whitened_power > 0.0 { power / self.whitened_power } else { 0.0 };
        Projection { gain, rss: dot(&self.residuals, &self.residuals), power, moving_share }
    }
}

fn with_sign(gain: f64, sign: Sign) -> f64 {
    let right = match sign {
        Sign::Positive => gain > 0.0,
        Sign::Negative => gain < 0.0,
        Sign::Any => true,
    };
    if right { gain } else { 0.0 }
}

/// Offset, and drift about `middle` if there is one.
pub(crate) fn nuisance_columns(t: &[f64], drift: bool, middle: f64) -> Vec<Vec<f64>> {
    let mut columns = vec![vec![1.0; t.len()]];
    if drift {
        columns.push(t.iter().map(|t| t - middle).collect());
    }
    columns
}

pub(crate) fn middle(t: &[f64]) -> f64 {
    match (t.first(), t.last()) {
        (Some(first), Some(last)) => 0.5 * (first + last),
        _ => 0.0,
    }
}

/// The best shared coefficients, and how well the columns determine them.
struct Joint {
    coefficients: Vec<f64>,
    prior_std: Vec<f64>,
    information: Option<nalgebra::Cholesky<f64, nalgebra::Dyn>>,
}

impl Joint {
    /// Whitens the shared columns and the shapes of all blocks and solves for the coefficients.
    fn of(blocks: &mut [Block]) -> Joint {
        let prior_std = blocks.first().map_or_else(Vec::new, |b| b.shared.prior_std.clone());
        let n = prior_std.len();
        let mut information = nalgebra::DMatrix::<f64>::zeros(n, n);
        let mut right = nalgebra::DVector::<f64>::zeros(n);
        for (k, std) in prior_std.iter().enumerate() {
            information[(k, k)] = std.powi(-2);
        }
        for block in blocks {
            block.whiten_shared();
            for (i, a) in block.shared.columns.iter().enumerate().take(n) {
                right[i] += dot(a, &block.residuals);
                for (j, b) in block.shared.columns[..=i].iter().enumerate() {
                    let product = dot(a, b);
                    information[(i, j)] += product;
                    if i != j {
                        information[(j, i)] += product;
                    }
                }
            }
        }
        let information = information.cholesky();
        let coefficients =
            information.as_ref().map_or_else(|| vec![0.0; n], |c| c.solve(&right).iter().copied().collect());
        Joint { coefficients, prior_std, information }
    }

    /// Penalty of the coefficients under their prior.
    fn penalty(&self) -> f64 {
        self.coefficients.iter().zip(&self.prior_std).map(|(c, std)| (c / std).powi(2)).sum()
    }

    /// aᵀ (information)⁻¹ b.
    fn inverse_product(&self, a: &[f64], b: &[f64]) -> f64 {
        let b = nalgebra::DVector::from_column_slice(b);
        let solved = self.information.as_ref().map(|c| c.solve(&b));
        solved.map_or(0.0, |solved| a.iter().zip(solved.iter()).map(|(a, b)| a * b).sum())
    }
}

/// Normal equations of the nonlinear parameters, at most [`MOST_CURVED`] of them.
#[derive(Debug, Clone)]
pub(crate) struct Normal {
    pub(crate) hessian: [[f64; MOST_CURVED]; MOST_CURVED],
    pub(crate) gradient: [f64; MOST_CURVED],
    pub(crate) parameters: usize,
    /// Sum of squares over all components, and of the shared coefficients over their prior deviations.
    pub(crate) rss: f64,
    /// Projections of the components.
    pub(crate) projections: Vec<Projection>,
    /// Coefficients common to all components.
    pub(crate) shared: Vec<f64>,
}

/// Maximum number of nonlinear parameters: delay and skew, or delay and two lags.
pub(crate) const MOST_CURVED: usize = 3;

impl Normal {
    /// Projects all blocks (their columns filled in) and adds them up.
    pub(crate) fn of(blocks: &mut [Block]) -> Normal {
        let parameters = blocks.first().map_or(0, |b| b.columns.len() - 1);
        let mut normal = Normal {
            hessian: [[0.0; MOST_CURVED]; MOST_CURVED],
            gradient: [0.0; MOST_CURVED],
            parameters,
            rss: 0.0,
            projections: Vec::with_capacity(blocks.len()),
            shared: vec![],
        };
        for block in blocks {
            let projection = block.project();
            normal.add(block, projection);
        }
        normal
    }

    /// As [`Normal::of`], solving jointly for the shared columns of the blocks (also filled in). The gains are fixed.
    pub(crate) fn of_shared(blocks: &mut [Block]) -> Normal {
        let parameters = blocks.first().map_or(0, |b| b.columns.len() - 1);
        let joint = Joint::of(blocks);
        let mut normal = Normal {
            hessian: [[0.0; MOST_CURVED]; MOST_CURVED],
            gradient: [0.0; MOST_CURVED],
            parameters,
            rss: joint.penalty(),
            projections: Vec::with_capacity(blocks.len()),
            shared: joint.coefficients.clone(),
        };
        let mut crossed = vec![vec![0.0; joint.coefficients.len()]; parameters];
        for block in blocks {
            let projection = block.project_shared(&joint.coefficients);
            normal.add(block, projection);
            for (sums, derivative) in crossed.iter_mut().zip(&block.columns[1..]) {
                for (sum, column) in sums.iter_mut().zip(&block.shared.columns) {
                    *sum += dot(derivative, column);
                }
            }
        }
        // The part of the derivatives that the shared columns explain carries no information.
        for i in 0..parameters {
            for j in 0..parameters {
                normal.hessian[i][j] -= joint.inverse_product(&crossed[i], &crossed[j]);
            }
        }
        normal
    }

    fn add(&mut self, block: &Block, projection: Projection) {
        self.rss += projection.rss;
        self.projections.push(projection);
        let derivatives = &block.columns[1..];
        for (i, d) in derivatives.iter().enumerate() {
            self.gradient[i] += dot(d, &block.residuals);
            for (j, other) in derivatives[..=i].iter().enumerate() {
                let product = dot(d, other);
                self.hessian[i][j] += product;
                if i != j {
                    self.hessian[j][i] += product;
                }
            }
        }
    }

    /// Whether any component follows its reference.
    pub(crate) fn follows(&self) -> bool {
        self.projections.iter().any(|p| p.gain != 0.0)
    }

    /// Solves (H + damping · diag H) step = gradient over the parameters that are `free`; the others stay. `None` if
    /// the parameters cannot be distinguished.
    pub(crate) fn step(&self, damping: f64, free: [bool; MOST_CURVED]) -> Option<[f64; MOST_CURVED]> {
        let mut matrix = nalgebra::Matrix3::<f64>::identity();
        let mut right = nalgebra::Vector3::<f64>::zeros();
        let moves = |i: usize| i < self.parameters && free[i];
        let scale: [f64; MOST_CURVED] = std::array::from_fn(|i| if moves(i) { self.hessian[i][i].sqrt() } else { 1.0 });
        if !scale.iter().all(|s| *s > 0.0 && s.is_finite()) {
            return None;
        }
        for i in (0..MOST_CURVED).filter(|i| moves(*i)) {
            right[i] = self.gradient[i] / scale[i];
            for j in (0..MOST_CURVED).filter(|j| moves(*j)) {
                matrix[(i, j)] = self.hessian[i][j] / (scale[i] * scale[j]);
            }
            matrix[(i, i)] = 1.0 + damping;
        }
        let step = matrix.cholesky()?.solve(&right);
        Some(std::array::from_fn(|i| step[i] / scale[i]))
    }
}
