//! Weighted least squares over the network: latenesses, covariance, closure and tests of effects.

use crate::graph::{Edge, Effect, Graph};
use crate::lineage::Role;
use crate::settings::{NetworkSettings, ReferenceUse};
use nalgebra::{DMatrix, DVector};
use record::NetworkDatum;

/// Least variance of a pair, s².
const LEAST_VARIANCE: f64 = 1e-12;
/// Lateness of a reference, s.
const REFERENCE_PIN_S: f64 = 1e-4;
/// Lateness of a zero by convention, s.
const ZERO_PIN_S: f64 = 1e-6;
/// Least share of an error that must appear in the residuals for a pair to count as checked.
const LEAST_REDUNDANCY: f64 = 1e-6;
/// Least standard deviation of an effect that is estimated as an unknown, s.
const FREE_S: f64 = 1.0;
/// Non-centrality of Baarda's test: 80 % power at a significance of 0.1 %.
const BAARDA: f64 = 4.13;

/// Effect that is estimated as an unknown.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Freed {
    pub(crate) effect: usize,
    /// Standard deviation that frees it, s.
    pub(crate) sd_s: f64,
}

impl Freed {
    /// Freed with a standard deviation that allows an error of this size, s.
    pub(crate) fn with_size(effect: usize, size_s: f64) -> Self {
        Freed { effect, sd_s: FREE_S.max(3.0 * size_s.abs()) }
    }
}

/// Zero of one part.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct PartDatum {
    pub(crate) datum: NetworkDatum,
    /// Node that is zero by convention; `None` where a datum holds.
    pub(crate) zero: Option<usize>,
}

/// Test of one effect.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct EffectTest {
    pub(crate) redundancy: f64,
    /// Test value, size and derived figures; `None` if nothing checks the effect.
    pub(crate) checked: Option<Checked>,
}

/// Test of an effect that other pairs check.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Checked {
    pub(crate) w: f64,
    pub(crate) size_s: f64,
    pub(crate) least_error_s: f64,
    /// Uncertainty of the size from the rest of the network, without the effect's own model error, s.
    pub(crate) size_uncertainty_s: f64,
}

/// Latenesses of all nodes with one choice of datum and of freed effects.
#[derive(Debug, Clone)]
pub(crate) struct Adjustment {
    pub(crate) lateness_s: DVector<f64>,
    pub(crate) covariance: DMatrix<f64>,
    /// Model part of the standard uncertainty, s.
    pub(crate) model_s: Vec<f64>,
    /// What few windows of the pairs add to the variance of a 95 % interval, s².
    few_windows: Vec<f64>,
    pub(crate) residuals: DVector<f64>,
    pub(crate) chi2: f64,
    pub(crate) degrees_of_freedom: usize,
    pub(crate) tests: Vec<EffectTest>,
    /// How much of an error of each effect (column) reaches each node (row).
    pub(crate) carried: DMatrix<f64>,
    pub(crate) parts: Vec<PartDatum>,
}

impl Adjustment {
    /// Standard uncertainty of one node, s.
    pub(crate) fn uncertainty_s(&self, node: usize) -> f64 {
        self.covariance[(node, node)].max(0.0).sqrt()
    }

    /// Half width of the interval of one node in units of k, s: as [`Adjustment::uncertainty_s`], but including what few
    /// windows of its pairs add.
    pub(crate) fn half_width_s(&self, node: usize) -> f64 {
        (self.covariance[(node, node)] + self.few_windows[node]).max(0.0).sqrt()
    }

    /// Probability of a closure at least as bad; `None` without a loop.
    pub(crate) fn p(&self) -> Option<f64> {
        (self.degrees_of_freedom > 0).then(|| signal::chi_squared_tail(self.chi2, self.degrees_of_freedom as f64))
    }
}

/// Covariance S of the pairs, without the noise that their channels share: `diag((1−ρ)u²) + Σ m² z zᵀ`.
pub(crate) fn pair_covariance(graph: &Graph, settings: &NetworkSettings, freed: &[Freed]) -> DMatrix<f64> {
    let mut s = model_covariance(graph, freed);
    for (at, edge) in graph.edges.iter().enumerate() {
        s[(at, at)] += own_variance(edge, graph.effects[edge.effect].model_s, settings);
    }
    s
}

/// Variance of a pair that it shares with no channel and no effect, s². The model error of its kind was measured on
/// pairs with such faults, so only the widening that exceeds it is added.
fn own_variance(edge: &Edge, model_s: f64, settings: &NetworkSettings) -> f64 {
    let beyond_model = (edge.widened_s.powi(2) - model_s.powi(2)).max(0.0);
    (1.0 - settings.shared_noise) * edge.uncertainty_s.powi(2) + beyond_model + LEAST_VARIANCE
}

/// Part of S that comes from model errors.
fn model_covariance(graph: &Graph, freed: &[Freed]) -> DMatrix<f64> {
    let mut s = DMatrix::zeros(graph.edges.len(), graph.edges.len());
    for (at, effect) in graph.effects.iter().enumerate() {
        let variance = effect_variance(effect, at, freed);
        for &i in &effect.edges {
            for &j in &effect.edges {
                s[(i, j)] += variance;
            }
        }
    }
    s
}

fn effect_variance(effect: &Effect, at: usize, freed: &[Freed]) -> f64 {
    let free: f64 = freed.iter().filter(|freed| freed.effect == at).map(|freed| freed.sd_s.powi(2)).sum();
    effect.model_s.powi(2) + free
}

/// Column of an effect: a coefficient for each of its pairs.
fn effect_column(effect: &Effect, pairs: usize) -> DVector<f64> {
    let mut z = DVector::zeros(pairs);
    for &edge in &effect.edges {
        z[edge] = 1.0;
    }
    z
}

/// Datum of every part. Parts in `refused` get no datum even though they hold accelerations.
pub(crate) fn part_data(graph: &Graph, settings: &NetworkSettings, refused: &[bool]) -> Vec<PartDatum> {
    (0..graph.parts)
        .map(|part| {
            let holds = |role| graph.members(part).any(|node| graph.nodes[node].role == role);
            let refused = refused.get(part).copied().unwrap_or(false);
            let on_time = settings.reference == ReferenceUse::Datum && holds(Role::Reference);
            match (on_time, holds(Role::Acceleration)) {
                (true, _) => PartDatum { datum: NetworkDatum::Reference, zero: None },
                (false, true) if !refused => PartDatum { datum: NetworkDatum::Imu, zero: None },
                (_, tied) => PartDatum {
                    datum: if tied { NetworkDatum::Refused } else { NetworkDatum::None },
                    zero: chosen_zero(graph, settings, part),
                },
            }
        })
        .collect()
}

/// Zero by convention: the velocity that compensation uses, else the first velocity, else the first channel (section 3.5).
fn chosen_zero(graph: &Graph, settings: &NetworkSettings, part: usize) -> Option<usize> {
    let name = |node: &usize| graph.nodes[*node].name.as_str();
    graph
        .members(part)
        .find(|node| Some(name(node)) == settings.compensation_velocity.as_deref())
        .or_else(|| graph.members(part).find(|node| name(node).starts_with("velocity")))
        .or_else(|| graph.members(part).next())
}

/// Weighted least squares; `None` if a matrix is singular.
pub(crate) fn adjust(
    graph: &Graph,
    settings: &NetworkSettings,
    noise: &[f64],
    refused: &[bool],
    freed: &[Freed],
) -> Option<Adjustment> {
    let parts = part_data(graph, settings, refused);
    let b = incidence(graph);
    let y = DVector::from_iterator(graph.edges.len(), graph.edges.iter().map(|edge| edge.delay_s));
    let weights = pair_covariance(graph, settings, freed).cholesky()?.inverse();
    let normal = b.transpose() * &weights * &b + DMatrix::from_diagonal(&pins(graph, settings, noise, &parts));
    let inverse = normal.cholesky()?.inverse();
    let gain = &inverse * b.transpose() * &weights;
    let mut lateness_s = &gain * &y;
    let residuals = &y - &b * &lateness_s;
    let mut covariance = inverse;
    add_noise_and_datum(&mut covariance, graph, settings, noise, &parts);
    let mut model_s = model_part(&gain, graph, settings, &parts, freed);
    let mut few_windows = few_windows(&gain, graph);
    for zero in parts.iter().filter_map(|part| part.zero) {
        covariance.row_mut(zero).fill(0.0);
        covariance.column_mut(zero).fill(0.0);
        lateness_s[zero] = 0.0;
        model_s[zero] = 0.0;
        few_windows[zero] = 0.0;
    }
    let (chi2, tests) = closure(graph, &b, &weights, &y, freed)?;
    let loops = (graph.edges.len() + graph.parts).saturating_sub(graph.nodes.len());
    let carried = carried(&gain, graph);
    let degrees_of_freedom = loops.saturating_sub(freed.len());
    let chi2 = if degrees_of_freedom == 0 { 0.0 } else { chi2 };
    let finite = lateness_s.iter().chain(covariance.iter()).all(|x| x.is_finite()) && chi2.is_finite();
    finite.then_some(Adjustment {
        lateness_s,
        covariance,
        model_s,
        few_windows,
        residuals,
        chi2,
        degrees_of_freedom,
        tests,
        carried,
        parts,
    })
}

/// How much of an error of each effect (column) reaches each node (row).
fn carried(gain: &DMatrix<f64>, graph: &Graph) -> DMatrix<f64> {
    let columns: Vec<DVector<f64>> =
        graph.effects.iter().map(|effect| gain * effect_column(effect, graph.edges.len())).collect();
    if columns.is_empty() { DMatrix::zeros(0, 0) } else { DMatrix::from_columns(&columns) }
}

/// Incidence matrix B: +1 at the first, −1 at the second node of each pair.
fn incidence(graph: &Graph) -> DMatrix<f64> {
    let mut b = DMatrix::zeros(graph.edges.len(), graph.nodes.len());
    for (at, edge) in graph.edges.iter().enumerate() {
        b[(at, edge.first)] = 1.0;
        b[(at, edge.second)] = -1.0;
    }
    b
}

/// Weights that hold the datum. The row of a pinned channel includes its noise, because the estimate is of T + n.
fn pins(graph: &Graph, settings: &NetworkSettings, noise: &[f64], parts: &[PartDatum]) -> DVector<f64> {
    DVector::from_iterator(
        graph.nodes.len(),
        graph.nodes.iter().zip(noise).enumerate().map(|(at, (node, noise))| {
            let part = parts.get(node.part);
            let pin_s = match (part.map(|part| part.datum), node.role) {
                (Some(NetworkDatum::Reference), Role::Reference) => Some(REFERENCE_PIN_S),
                (Some(NetworkDatum::Imu), Role::Acceleration) => Some(settings.acceleration_pin_s),
                _ if part.and_then(|part| part.zero) == Some(at) => Some(ZERO_PIN_S),
                _ => None,
            };
            pin_s.map_or(0.0, |pin_s: f64| 1.0 / (pin_s.powi(2) + noise))
        }),
    )
}

/// Uncertainty of the datum that all channels of a part tied to the IMU share, s.
fn common_s(node_part: usize, settings: &NetworkSettings, parts: &[PartDatum]) -> f64 {
    match parts.get(node_part).map(|part| part.datum) {
        Some(NetworkDatum::Imu) => settings.datum_uncertainty_s,
        _ => 0.0,
    }
}

/// `Cov += diag(c²) + u_d² 1 1ᵀ`.
fn add_noise_and_datum(
    covariance: &mut DMatrix<f64>,
    graph: &Graph,
    settings: &NetworkSettings,
    noise: &[f64],
    parts: &[PartDatum],
) {
    let common: Vec<f64> = graph.nodes.iter().map(|node| common_s(node.part, settings, parts)).collect();
    for (i, noise) in noise.iter().enumerate() {
        covariance[(i, i)] += noise;
        for (j, other) in common.iter().enumerate() {
            covariance[(i, j)] += common[i] * other;
        }
    }
}

/// `√(diag(G S_model Gᵀ) + u_d²)`: the part that does not average out over flights.
fn model_part(
    gain: &DMatrix<f64>,
    graph: &Graph,
    settings: &NetworkSettings,
    parts: &[PartDatum],
    freed: &[Freed],
) -> Vec<f64> {
    let spread = gain * model_covariance(graph, freed) * gain.transpose();
    graph
        .nodes
        .iter()
        .enumerate()
        .map(|(at, node)| spread[(at, at)].max(0.0).sqrt().hypot(common_s(node.part, settings, parts)))
        .collect()
}

/// `diag(G diag(t²) Gᵀ)` with what few windows add to each pair, t.
fn few_windows(gain: &DMatrix<f64>, graph: &Graph) -> Vec<f64> {
    let of_node =
        |node| graph.edges.iter().enumerate().map(move |(at, e)| (gain[(node, at)] * e.few_windows_s).powi(2));
    (0..graph.nodes.len()).map(|node| of_node(node).sum()).collect()
}

/// Closure χ² and the tests of all effects, both free of any datum: `R = S⁻¹ − S⁻¹B(BᵀS⁻¹B)⁺BᵀS⁻¹`.
fn closure(
    graph: &Graph,
    b: &DMatrix<f64>,
    weights: &DMatrix<f64>,
    y: &DVector<f64>,
    freed: &[Freed],
) -> Option<(f64, Vec<EffectTest>)> {
    // without the first node of each part B has full rank
    let kept: Vec<usize> =
        (0..graph.nodes.len()).filter(|&at| graph.members(graph.nodes[at].part).next() != Some(at)).collect();
    let b = b.select_columns(&kept);
    let projected = b.transpose() * weights;
    let normal = (&projected * &b).cholesky()?;
    let residuals = y - &b * normal.solve(&(&projected * y));
    let weighted_residuals = weights * &residuals;
    let chi2 = residuals.dot(&weighted_residuals).max(0.0);
    let tests = graph
        .effects
        .iter()
        .enumerate()
        .map(|(at, effect)| {
            let z = effect_column(effect, graph.edges.len());
            let full = z.dot(&(weights * &z));
            let seen = &projected * &z;
            let q = full - seen.dot(&normal.solve(&seen));
            test(q, full, z.dot(&weighted_residuals), effect_variance(effect, at, freed))
        })
        .collect();
    Some((chi2, tests))
}

/// Test of an effect from `q = zᵀRz`, `full = zᵀS⁻¹z` and `zᵀS⁻¹r`.
fn test(q: f64, full: f64, score: f64, variance: f64) -> EffectTest {
    let redundancy = if full > 0.0 { (q / full).clamp(0.0, 1.0) } else { 0.0 };
    let checked = (redundancy > LEAST_REDUNDANCY).then(|| Checked {
        w: score / q.sqrt(),
        size_s: score / q,
        least_error_s: BAARDA / q.sqrt(),
        size_uncertainty_s: (1.0 / q - variance).max(LEAST_VARIANCE).sqrt(),
    });
    EffectTest { redundancy, checked }
}
