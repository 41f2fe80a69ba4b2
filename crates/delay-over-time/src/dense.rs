//! The formulas of the fits with full matrices, and small random flights, for comparison in tests.

use crate::motion::Motion;
use crate::whitening::NoiseShape;
use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;

/// Random numbers that are the same in every run.
pub(crate) struct Random(Pcg64);

impl Random {
    pub(crate) fn new(seed: u64) -> Random {
        Random(Pcg64::seed_from_u64(seed))
    }

    pub(crate) fn uniform(&mut self, from: f64, to: f64) -> f64 {
        from + (to - from) * self.0.random::<f64>()
    }

    pub(crate) fn normal(&mut self) -> f64 {
        self.0.sample(StandardNormal)
    }

    /// `n` timestamps from `from` on, 0.15 s to 0.6 s apart.
    pub(crate) fn stamps(&mut self, n: usize, from: f64) -> Vec<f64> {
        let mut t = from;
        (0..n)
            .map(|_| {
                t += self.uniform(0.15, 0.6);
                t
            })
            .collect()
    }

    pub(crate) fn pairs(&mut self, n: usize, size: f64) -> Vec<[f64; 2]> {
        (0..n).map(|_| [size * self.normal(), size * self.normal()]).collect()
    }
}

/// A velocity at 25 Hz that turns back and forth while its speed rises and falls; it starts 20 s before zero.
pub(crate) fn turning(seconds: f64) -> Motion {
    let t: Vec<f64> = (0..(25.0 * (seconds + 40.0)) as usize).map(|k| 0.04 * k as f64 - 20.0).collect();
    let speed = |t: f64| 15.0 + 4.0 * (0.31 * t).sin();
    let heading = |t: f64| 1.3 * (0.45 * t).sin() + 0.4 * (0.17 * t).cos();
    let north: Vec<f64> = t.iter().map(|t| speed(*t) * heading(*t).cos()).collect();
    let east: Vec<f64> = t.iter().map(|t| speed(*t) * heading(*t).sin()).collect();
    Motion::new(&t, &north, &east)
}

/// One axis of one piece: the noise covariance `V` relative to the white part, and offset and drift `X`.
pub(crate) struct Dense {
    lower: DMatrix<f64>,
    /// Orthonormal columns that span the whitened offset and drift.
    basis: DMatrix<f64>,
    /// ln det V, and ln det XᵀV⁻¹X with a drift that rises by one over the timestamps.
    pub(crate) log_det_noise: f64,
    pub(crate) log_det_nuisance: f64,
}

impl Dense {
    /// `extra` is the additional variance of each sample.
    pub(crate) fn new(t: &[f64], shape: &NoiseShape, extra: impl Fn(usize) -> f64) -> Dense {
        let n = t.len();
        let noise = DMatrix::from_fn(n, n, |i, j| {
            let wander = shape.wander.powi(2) * (-(t[i] - t[j]).abs() / shape.time_constant_s).exp();
            wander + if i == j { 1.0 + extra(i) } else { 0.0 }
        });
        let lower = noise.cholesky().unwrap().l();
        let nuisance = DMatrix::from_fn(n, 2, |i, c| if c == 0 { 1.0 } else { (t[i] - t[0]) / (t[n - 1] - t[0]) });
        let whitened = lower.solve_lower_triangular(&nuisance).unwrap();
        Dense {
            log_det_noise: 2.0 * lower.diagonal().iter().map(|d| d.ln()).sum::<f64>(),
            log_det_nuisance: (whitened.transpose() * &whitened).determinant().ln(),
            basis: whitened.qr().q(),
            lower,
        }
    }

    /// The whitened column: L⁻¹ x with V = L Lᵀ.
    pub(crate) fn white(&self, column: &[f64]) -> DVector<f64> {
        self.lower.solve_lower_triangular(&DVector::from_column_slice(column)).unwrap()
    }

    /// The whitened column, orthogonal to offset and drift.
    pub(crate) fn free(&self, column: &[f64]) -> DVector<f64> {
        let white = self.white(column);
        &white - &self.basis * (self.basis.transpose() * &white)
    }
}

/// Whether two numbers agree to `share` of the larger, or of one.
pub(crate) fn near(a: f64, b: f64, share: f64) -> bool {
    (a - b).abs() <= share * a.abs().max(b.abs()).max(1.0)
}
