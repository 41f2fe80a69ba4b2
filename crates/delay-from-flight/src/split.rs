//! The delay by operating point: by speed, and by the quality reported by the receiver.

use super::fit::{View, estimate};
use flight::{Channel, Quantity, Stamp};
use nalgebra::{DMatrix, DVector};
use record::{DelayGroup, DelaySplit};
use signal::ComponentFit;

/// A group with less than this share of the information is not used.
const LEAST_INFORMATION: f64 = 1e-3;
/// Maximum number of groups of a split.
const MOST_GROUPS: usize = 4;
/// Speeds that differ by less than this ratio (95th to 5th percentile) are a single operating point.
const LEAST_RANGE: f64 = 1.3;
/// Prefixes of the names of scalar channels that describe the quality of a fix.
const QUALITY: [&str; 6] = ["satellites", "fix", "hdop", "horizontal-accuracy", "position-accuracy", "quality"];

/// A split by speed, and one per quality channel.
pub(crate) fn splits(view: &View) -> Vec<DelaySplit> {
    let (t, speed) = &view.prepared.speed;
    let mut out: Vec<DelaySplit> = by_quantiles(view, t, speed).into_iter().collect();
    for (name, channel) in &view.flight.channels {
        if channel.quantity == Quantity::Scalar && QUALITY.iter().any(|q| name.starts_with(q)) {
            out.extend(by_value(view, name, channel));
        }
    }
    out
}

/// Three groups with equal numbers of samples by speed.
fn by_quantiles(view: &View, t: &[f64], speed: &[f64]) -> Option<DelaySplit> {
    let of_rows = at_rows(view, t, speed);
    let mut sorted: Vec<f64> = of_rows.iter().flatten().copied().collect();
    sorted.sort_unstable_by(f64::total_cmp);
    let at = |share| signal::percentile_of_sorted(&sorted, share).unwrap_or(0.0);
    if at(0.95) < LEAST_RANGE * at(0.05).max(0.5) {
        return None;
    }
    let borders = [at(1.0 / 3.0), at(2.0 / 3.0)];
    split(view, "ground speed, m/s".to_owned(), &of_rows, &|v| borders.iter().filter(|b| v > **b).count(), 3)
}

/// A group per value, or per quarter of the samples if there are many values.
fn by_value(view: &View, name: &str, channel: &Channel) -> Option<DelaySplit> {
    if channel.series.timeline().clock() != view.prepared.origin.clock || channel.series.is_empty() {
        return None;
    }
    let t = channel.series.timeline().seconds_since(Stamp(view.prepared.origin.origin_ns));
    let of_rows = at_rows(view, &t, channel.series.component(0));
    let mut values: Vec<f64> = of_rows.iter().flatten().copied().collect();
    values.sort_unstable_by(f64::total_cmp);
    let quarters = [0.25, 0.5, 0.75].map(|q| signal::percentile_of_sorted(&values, q).unwrap_or(0.0));
    values.dedup();
    let groups = values.len().min(MOST_GROUPS);
    if groups < 2 {
        return None;
    }
    let few = values.len() <= MOST_GROUPS;
    let group = |v: f64| {
        if few { values.partition_point(|x| *x < v) } else { quarters.iter().filter(|q| v > **q).count() }
    };
    split(view, name.to_owned(), &of_rows, &group, groups)
}

/// The newest value at each row of each component; the first value before all.
fn at_rows(view: &View, t: &[f64], values: &[f64]) -> Vec<Vec<f64>> {
    let newest = |at: &f64| values[t.partition_point(|x| x <= at).saturating_sub(1)];
    if values.is_empty() {
        return vec![];
    }
    view.fit.components.iter().map(|c| c.t_used.iter().map(newest).collect()).collect()
}

/// Whitened residuals of the fit and their derivatives by the delay of each group, with offsets and drifts removed.
struct Rows {
    residual: Vec<f64>,
    /// One per group, each as long as the residual.
    derivatives: Vec<Vec<f64>>,
}

/// One delay per group, with common offsets, drifts and noise: one Gauss–Newton step from the joint delay, on whitened
/// rows, with its own Huber weights. The error of the step is half the acceleration times its square; only differences
/// between groups are used. A delay that changes smoothly with the value partly looks like wander: the groups then
/// appear closer than they are (25 ms instead of 60 ms between slow and fast were observed).
fn split(
    view: &View,
    by: String,
    values: &[Vec<f64>],
    group: &dyn Fn(f64) -> usize,
    groups: usize,
) -> Option<DelaySplit> {
    let empty = DelayGroup { range: [f64::INFINITY, f64::NEG_INFINITY], samples: 0, delay_s: estimate(0.0, 0.0) };
    let mut found = vec![empty; groups];
    let mut rows = Rows { residual: vec![], derivatives: vec![vec![]; groups] };
    for (fit, values) in view.fit.components.iter().zip(values) {
        let labels: Vec<usize> = values.iter().map(|v| group(*v).min(groups - 1)).collect();
        for (label, v) in labels.iter().zip(values) {
            let g = &mut found[*label];
            g.range = [g.range[0].min(*v), g.range[1].max(*v)];
            g.samples += 1;
        }
        rows.extend(fit, &labels)?;
    }
    finish(view, by, &found, &rows)
}

impl Rows {
    fn extend(&mut self, fit: &ComponentFit, labels: &[usize]) -> Option<()> {
        let middle = 0.5 * (fit.t_used.first()? + fit.t_used.last()?);
        let mut columns = vec![vec![1.0; fit.t_used.len()]];
        if fit.drift.is_some() {
            columns.push(fit.t_used.iter().map(|t| t - middle).collect());
        }
        let nuisances = columns.len();
        columns.push(fit.residuals.clone());
        for g in 0..self.derivatives.len() {
            let of_group = |(slope, label): (&f64, &usize)| if *label == g { -slope } else { 0.0 };
            columns.push(fit.slope.iter().zip(labels).map(of_group).collect());
        }
        let mut slices: Vec<&mut [f64]> = columns.iter_mut().map(Vec::as_mut_slice).collect();
        signal::whiten(&fit.t_used, &mut slices, &fit.noise);
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        for n in 0..nuisances {
            let (before, rest) = columns.split_at_mut(n + 1);
            let q = &before[n];
            let length2 = dot(q, q);
            for column in rest {
                let share = dot(q, column) / length2;
                column.iter_mut().zip(q).for_each(|(x, q)| *x -= share * q);
            }
        }
        let mut columns = columns.into_iter().skip(nuisances);
        self.residual.extend(columns.next()?);
        self.derivatives.iter_mut().zip(columns).for_each(|(all, part)| all.extend(part));
        Some(())
    }

    /// For the groups of `kept`: information, step from the joint delay, and the scale of the whitened residuals.
    fn solve(&self, kept: &[usize]) -> Option<(DMatrix<f64>, DVector<f64>, f64)> {
        const HUBER: f64 = 1.345;
        const ROUNDS: usize = 8;
        // In standard uncertainties.
        const STEADY: f64 = 0.01;
        let mut weights = vec![1.0; self.residual.len()];
        let mut last: Option<(DMatrix<f64>, DVector<f64>, f64)> = None;
        for _ in 0..ROUNDS {
            let product =
                |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).zip(&weights).map(|((a, b), w)| a * b * w).sum() };
            let of = |k: usize| &self.derivatives[kept[k]];
            let a = DMatrix::from_fn(kept.len(), kept.len(), |i, j| product(of(i), of(j)));
            let b = DVector::from_fn(kept.len(), |i, _| product(of(i), &self.residual));
            let step = a.clone().cholesky()?.solve(&b);
            let mut left = self.residual.clone();
            for (k, share) in step.iter().enumerate() {
                left.iter_mut().zip(of(k)).for_each(|(e, d)| *e -= share * d);
            }
            let scale = signal::robust_sigma(&left)?.max(f64::MIN_POSITIVE);
            weights = left.iter().map(|e| (HUBER * scale / e.abs().max(f64::MIN_POSITIVE)).min(1.0)).collect();
            let moved = last.as_ref().map_or(f64::INFINITY, |(_, before, _)| (&step - before).amax());
            let steady = moved * a.diagonal().max().sqrt() < STEADY * scale;
            last = Some((a, step, scale));
            if steady {
                break;
            }
        }
        last
    }
}

/// Solves for the groups with enough information.
fn finish(view: &View, by: String, found: &[DelayGroup], rows: &Rows) -> Option<DelaySplit> {
    let information = |g: usize| rows.derivatives[g].iter().map(|d| d * d).sum::<f64>();
    let total: f64 = (0..found.len()).map(information).sum();
    let kept: Vec<usize> = (0..found.len()).filter(|&g| information(g) > LEAST_INFORMATION * total).collect();
    if kept.len() < 2 {
        return None;
    }
    let (a, step, _) = rows.solve(&kept)?;
    // The common delay of all groups then has the uncertainty of the fit.
    let inflation = view.fit.standard_uncertainty_s * a.sum().sqrt();
    let covariance = a.clone().cholesky()?.inverse();
    // Chi-squared of the differences: the residual after one common step for all.
    let ones = DVector::from_element(kept.len(), 1.0);
    let common = (&a * &step).sum() / (&a * &ones).sum();
    let apart = step.map(|x| x - common);
    let chi2 = (apart.transpose() * &a * &apart)[0] / (inflation * inflation);
    let group = |(i, &g): (usize, &usize)| DelayGroup {
        delay_s: estimate(view.fit.delay_s + apart[i], covariance[(i, i)].sqrt() * inflation),
        ..found[g].clone()
    };
    let mut groups: Vec<DelayGroup> = kept.iter().enumerate().map(group).collect();
    groups.sort_by(|x, y| x.range[0].total_cmp(&y.range[0]));
    Some(DelaySplit { by, groups, p: Some(signal::chi_squared_tail(chi2, kept.len() as f64 - 1.0)) })
}
