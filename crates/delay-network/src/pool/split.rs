//! Whether a group should be split in two.

use statrs::function::gamma::ln_gamma;

/// Least number of flights in a cluster.
const LEAST_IN_CLUSTER: usize = 2;

/// Best cut of a group in two.
#[derive(Debug)]
pub(crate) struct Cut {
    /// Indices of the earlier side.
    pub(crate) early: Vec<usize>,
    /// Indices of the later side.
    pub(crate) late: Vec<usize>,
    /// Empty gap between them.
    pub(crate) gap: f64,
    /// Distance of the means in standard deviations within a side. The halves of a uniform spread are √12 = 3.5 apart.
    pub(crate) separation: f64,
    /// Upper bound of the probability that one normal group has such a cut.
    pub(crate) p: f64,
}

/// Running sums of weights, weighted values and weighted squares.
#[derive(Debug, Clone, Copy, Default)]
struct Running {
    weight: f64,
    value: f64,
    square: f64,
}

impl Running {
    fn plus(self, value: f64, weight: f64) -> Running {
        Running {
            weight: self.weight + weight,
            value: self.value + weight * value,
            square: self.square + weight * value * value,
        }
    }

    fn minus(self, other: Running) -> Running {
        Running {
            weight: self.weight - other.weight,
            value: self.value - other.value,
            square: self.square - other.square,
        }
    }

    fn mean(self) -> f64 {
        self.value / self.weight
    }

    fn within(self) -> f64 {
        (self.square - self.value * self.value / self.weight).max(0.0)
    }
}

/// Cut with the least weighted variance within both sides, of values with variances; `None` with fewer than four.
pub(crate) fn best_cut(items: &[(f64, f64)]) -> Option<Cut> {
    let count = items.len();
    if count < 2 * LEAST_IN_CLUSTER {
        return None;
    }
    let centre = items.iter().map(|(value, _)| value).sum::<f64>() / count as f64;
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|&a, &b| items[a].0.total_cmp(&items[b].0).then(a.cmp(&b)));
    let mut running = vec![Running::default()];
    for &at in &order {
        let (value, variance) = items[at];
        let last = running.last().copied().unwrap_or_default();
        running.push(last.plus(value - centre, 1.0 / variance));
    }
    let all = running.last().copied()?;
    let sides = |cut: usize| (running[cut], all.minus(running[cut]));
    let within = |cut: usize| sides(cut).0.within() + sides(cut).1.within();
    let cut = (LEAST_IN_CLUSTER..=count - LEAST_IN_CLUSTER).min_by(|&a, &b| within(a).total_cmp(&within(b)))?;
    let (early, late) = sides(cut);
    let between = (early.mean() - late.mean()).powi(2) / (1.0 / early.weight + 1.0 / late.weight);
    let (low, high) = order.split_at(cut);
    let gap = items[*high.first()?].0 - items[*low.last()?].0;
    let scatter = (within(cut) / (count as f64 - 2.0) * count as f64 / all.weight).sqrt();
    let separation = (late.mean() - early.mean()) / scatter;
    let p = p_of_cut(count, between, within(cut));
    let (mut early, mut late) = (low.to_vec(), high.to_vec());
    early.sort_unstable();
    late.sort_unstable();
    Some(Cut { early, late, gap, separation, p })
}

/// `(2^(k−1) − 1) · P(|t| > √(between (k−2)/within))`, k − 2 degrees of freedom, at most 1, in logarithms.
///
/// The tail is the incomplete beta function `I_x(a, ½)` with `a = (k−2)/2` and `x = within/(within + between)`, bounded by
/// `xᵃ / (a B(a, ½) √(1−x))`.
fn p_of_cut(count: usize, between: f64, within: f64) -> f64 {
    let a = 0.5 * (count as f64 - 2.0);
    let x = within / (within + between);
    if !(between > 0.0 && x < 1.0) {
        return 1.0;
    }
    let ln_beta = ln_gamma(a) + ln_gamma(0.5) - ln_gamma(a + 0.5);
    let ln_tail = a * x.ln() - a.ln() - ln_beta - 0.5 * (1.0 - x).ln();
    let cuts = count as f64 - 1.0;
    // ln(2ⁿ − 1) = n ln 2 + ln(1 − 2⁻ⁿ)
    let ln_cuts = cuts * std::f64::consts::LN_2 + (-(-cuts * std::f64::consts::LN_2).exp()).ln_1p();
    (ln_tail + ln_cuts).exp().min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use statrs::distribution::{ContinuousCDF, StudentsT};

    #[test]
    fn the_tail_bound_is_slightly_above_student_t() {
        for (count, t) in [(4_usize, 20.0), (8, 9.0), (12, 12.0)] {
            let dof = count as f64 - 2.0;
            let student = 2.0 * StudentsT::new(0.0, 1.0, dof).unwrap().sf(t);
            let exact = student * (2.0_f64.powi(count as i32 - 1) - 1.0);
            let found = p_of_cut(count, t * t, dof);
            assert!(found >= exact * (1.0 - 1e-9) && found < 1.1 * exact.min(1.0), "{found} for {exact}");
        }
    }

    #[test]
    fn a_uniformly_spread_group_is_not_split_however_large() {
        for count in [10, 100, 20_000] {
            let items: Vec<(f64, f64)> = (0..count).map(|i| (i as f64 / count as f64, 1.0)).collect();
            let separation = best_cut(&items).unwrap().separation;
            assert!((separation - 12.0_f64.sqrt()).abs() < 0.6, "{count}: {separation}");
        }
    }
}
