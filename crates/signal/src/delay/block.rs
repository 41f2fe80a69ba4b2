//! The rows of one component that take part, made white, and the part of the fit that is linear.

use super::{Gain, Measurement, Sign};
use crate::noise::{dot, orthonormal_to, remove};
use crate::whiten::{NoiseModel, WhiteningFilter};

/// One component under one noise: what does not change while the delay is looked for is computed once.
pub(crate) struct Block {
    /// Rows of the measurement that take part.
    pub(crate) rows: Vec<usize>,
    /// Their stamps, s.
    pub(crate) t: Vec<f64>,
    pub(crate) gain: Gain,
    drift: bool,
    pub(crate) filter: WhiteningFilter,
    /// Whitened offset and drift, orthonormal.
    nuisances: Vec<Vec<f64>>,
    /// Whitened values without their projection on the nuisances.
    values: Vec<f64>,
    /// Working space: the shape of the signal, then its derivatives by the parameters that are not linear, at gain 1.
    pub(crate) columns: Vec<Vec<f64>>,
    /// Whitened residuals of the last projection.
    pub(crate) residuals: Vec<f64>,
}

/// What is left of one component for one set of the parameters that are not linear.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Projection {
    /// Gain that fits best; 0 if that would have the wrong sign.
    pub(crate) gain: f64,
    /// Whitened sum of squares that is left.
    pub(crate) rss: f64,
    /// Square of the length of the whitened shape, offset and drift taken out: one over the variance of the gain.
    pub(crate) power: f64,
    /// The same over what it was before they were taken out: 0 for a constant shape.
    pub(crate) moving_share: f64,
}

impl Block {
    /// `rows` of `measurement`, with `derivatives` columns beside the shape.
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
            // Constant values: what is left is rounding.
            values.fill(0.0);
        }
        let columns = vec![vec![0.0; t.len()]; 1 + derivatives];
        let residuals = vec![0.0; t.len()];
        Block {
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

    /// Parameters of this component: gain (if free), offset and drift.
    pub(crate) fn linear_parameters(&self) -> usize {
        1 + usize::from(self.drift) + usize::from(matches!(self.gain, Gain::Free { .. }))
    }

    /// Solves for gain, offset and drift, with `columns` filled in (not yet whitened). Afterwards `residuals` are the
    /// whitened residuals, and the derivative columns are times the gain and orthogonal to all linear parameters.
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

/// Normal equations of the parameters that are not linear, at most [`MOST_CURVED`] of them.
#[derive(Debug, Clone)]
pub(crate) struct Normal {
    pub(crate) hessian: [[f64; MOST_CURVED]; MOST_CURVED],
    pub(crate) gradient: [f64; MOST_CURVED],
    pub(crate) parameters: usize,
    /// Sum of squares over all components.
    pub(crate) rss: f64,
    /// One for each component.
    pub(crate) projections: Vec<Projection>,
}

/// Most parameters that are not linear: delay and skew, or delay and two lags.
pub(crate) const MOST_CURVED: usize = 3;

impl Normal {
    /// Projects all blocks (their columns filled in) and sums up.
    pub(crate) fn of(blocks: &mut [Block]) -> Normal {
        let parameters = blocks.first().map_or(0, |b| b.columns.len() - 1);
        let mut normal = Normal {
            hessian: [[0.0; MOST_CURVED]; MOST_CURVED],
            gradient: [0.0; MOST_CURVED],
            parameters,
            rss: 0.0,
            projections: Vec::with_capacity(blocks.len()),
        };
        for block in blocks {
            let projection = block.project();
            normal.rss += projection.rss;
            normal.projections.push(projection);
            let derivatives = &block.columns[1..];
            for (i, d) in derivatives.iter().enumerate() {
                normal.gradient[i] += dot(d, &block.residuals);
                for (j, other) in derivatives[..=i].iter().enumerate() {
                    let product = dot(d, other);
                    normal.hessian[i][j] += product;
                    if i != j {
                        normal.hessian[j][i] += product;
                    }
                }
            }
        }
        normal
    }

    /// Whether a component follows its reference at all.
    pub(crate) fn follows(&self) -> bool {
        self.projections.iter().any(|p| p.gain != 0.0)
    }

    /// Solves (H + damping · diag H) step = gradient over the parameters that are `free`; the others stay. `None` if
    /// the parameters cannot be told apart.
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
