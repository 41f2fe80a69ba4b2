//! Random-effects mean: REML, Hartung–Knapp, and the leave-one-out means.

/// Above this number of members, leaving one out keeps the τ of all.
const EXACT_UP_TO: usize = 30;
/// Points of the grid that brackets the minimum of the REML objective.
const GRID: usize = 64;

/// Values with the variances of their own errors.
#[derive(Debug, Clone)]
pub(crate) struct Sample {
    values: Vec<f64>,
    variances: Vec<f64>,
}

/// Random-effects mean of some values.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Mean {
    /// Number of values.
    pub(crate) count: usize,
    /// Mean.
    pub(crate) mean: f64,
    /// Its standard error, including Hartung–Knapp's factor (at least 1).
    pub(crate) se: f64,
    /// Standard deviation between members; `None` for one.
    pub(crate) tau: Option<f64>,
}

impl Mean {
    /// Half width of the 95 % interval of the mean.
    pub(crate) fn half(&self) -> f64 {
        self.quantile() * self.se
    }

    fn quantile(&self) -> f64 {
        match self.count {
            0 | 1 => crate::isolate::K95,
            k => signal::student_quantile(0.975, (k - 1) as f64),
        }
    }
}

/// Weighted sums of a sample at one τ.
#[derive(Debug, Clone, Copy)]
struct Sums {
    weight: f64,
    mean: f64,
    /// Σ w (y − mean)².
    q: f64,
}

impl Sample {
    /// Sample of values and variances above zero.
    pub(crate) fn new(items: impl Iterator<Item = (f64, f64)>) -> Sample {
        let (values, variances) = items.unzip();
        Sample { values, variances }
    }

    pub(crate) fn len(&self) -> usize {
        self.values.len()
    }

    /// Values with their variances.
    pub(crate) fn items(&self) -> impl Iterator<Item = (f64, f64)> + '_ {
        self.values.iter().copied().zip(self.variances.iter().copied())
    }

    /// Random-effects mean at the REML τ.
    pub(crate) fn mean(&self) -> Mean {
        let tau = (self.len() > 1).then(|| self.tau_reml());
        let sums = self.sums(tau.unwrap_or(0.0));
        mean_of(sums, self.len(), tau)
    }

    /// Cochran's Q at τ = 0.
    pub(crate) fn cochran_q(&self) -> f64 {
        self.sums(0.0).q
    }

    /// Mean of all others, for each member. With more than 30 members all share one τ, and sums are corrected instead
    /// of recomputed: `Q₋ᵢ = Q − wᵢ(yᵢ − m)² W/(W − wᵢ)`.
    pub(crate) fn leave_one_out(&self) -> Vec<Option<Mean>> {
        let count = self.len();
        if count < 2 {
            return vec![None; count];
        }
        if count <= EXACT_UP_TO {
            return (0..count).map(|at| Some(self.without(at).mean())).collect();
        }
        let tau = self.tau_reml();
        let all = self.sums(tau);
        self.items()
            .map(|(value, variance)| {
                let weight = 1.0 / (variance + tau * tau);
                let left = all.weight - weight;
                let mean = (all.weight * all.mean - weight * value) / left;
                let q = (all.q - weight * (value - all.mean).powi(2) * all.weight / left).max(0.0);
                Some(mean_of(Sums { weight: left, mean, q }, count - 1, Some(tau)))
            })
            .collect()
    }

    fn without(&self, at: usize) -> Sample {
        Sample::new(self.items().enumerate().filter(|(i, _)| *i != at).map(|(_, item)| item))
    }

    fn sums(&self, tau: f64) -> Sums {
        let (mut weight, mut weighted) = (0.0, 0.0);
        for (value, variance) in self.items() {
            let w = 1.0 / (variance + tau * tau);
            weight += w;
            weighted += w * value;
        }
        let mean = weighted / weight;
        let q = self.items().map(|(value, variance)| (value - mean).powi(2) / (variance + tau * tau)).sum();
        Sums { weight, mean, q }
    }

    /// Minus the logarithm of the restricted likelihood, without its constants.
    fn objective(&self, tau: f64) -> f64 {
        let sums = self.sums(tau);
        let logs: f64 = self.variances.iter().map(|variance| (variance + tau * tau).ln()).sum();
        0.5 * (logs + sums.weight.ln() + sums.q)
    }

    /// τ that maximises the restricted likelihood: a grid brackets it.
    fn tau_reml(&self) -> f64 {
        let count = self.len() as f64;
        let mean = self.values.iter().sum::<f64>() / count;
        let spread = (self.values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / count).sqrt();
        let largest = self.variances.iter().copied().fold(0.0, f64::max).sqrt();
        let step = (3.0 * spread).max(3.0 * largest).max(1e-6) / (GRID - 1) as f64;
        let at_zero = self.objective(0.0);
        let (best, _) = (1..GRID)
            .map(|i| (i, self.objective(step * i as f64)))
            .fold((0, at_zero), |best, next| if next.1 < best.1 { next } else { best });
        let bracket = (step * best.saturating_sub(1) as f64, step * (best + 1) as f64);
        let (tau, value) = signal::least_between(|tau| self.objective(tau), bracket, 1e-9 * step);
        // Rounding must not decide between zero and next to nothing.
        if at_zero - value > 1e-12 * (1.0 + at_zero.abs()) { tau } else { 0.0 }
    }
}

fn mean_of(sums: Sums, count: usize, tau: Option<f64>) -> Mean {
    let factor = if count > 1 { (sums.q / (count - 1) as f64).max(1.0) } else { 1.0 };
    Mean { count, mean: sums.mean, se: (factor / sums.weight).sqrt(), tau }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(count: usize) -> Sample {
        Sample::new((0..count).map(|i| {
            let wave = (i as f64 * 1.7).sin();
            (0.2 + 0.004 * wave, (0.002 + 0.001 * (i as f64 * 0.9).cos().abs()).powi(2))
        }))
    }

    #[test]
    fn leave_one_out_in_closed_form_equals_recomputation() {
        let sample = sample(50);
        let tau = sample.tau_reml();
        for (at, left) in sample.leave_one_out().iter().enumerate() {
            let (left, others) = (left.unwrap(), sample.without(at));
            let redone = mean_of(others.sums(tau), others.len(), Some(tau));
            assert!((left.mean - redone.mean).abs() < 1e-12);
            assert!((left.se / redone.se - 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn one_tau_for_all_hardly_changes_leave_one_out_means() {
        let sample = sample(40);
        for (at, left) in sample.leave_one_out().iter().enumerate() {
            assert!((left.unwrap().mean - sample.without(at).mean().mean).abs() < 2e-5);
        }
    }

    #[test]
    fn equal_variances_give_the_textbook_reml() {
        // with equal variances s² REML is the sample variance less s²
        let values = [0.190, 0.200, 0.204, 0.214, 0.198];
        let sample = Sample::new(values.iter().map(|value| (*value, 0.003_f64.powi(2))));
        let mean = values.iter().sum::<f64>() / 5.0;
        let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / 4.0;
        assert!((sample.tau_reml() - (variance - 9e-6).sqrt()).abs() < 1e-7);
    }
}
