//! Constant or not, from windows (B S5 e–g).

use crate::comparison::Workspace;
use crate::delays::{Delays, Effect};
use crate::settings::OverTimeSettings;
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;

/// Draws after which a clear case stops.
const FIRST_DRAWS: usize = 400;
/// Probability above which windows are clearly consistent.
const CLEARLY_ALIKE: f64 = 0.1;
const SEED: u64 = 0xDE1A;

/// Joint results of the windows, before any draw.
#[derive(Debug, Clone)]
pub(crate) struct Comparison {
    /// Scatter in excess of the uncertainties, s.
    pub(crate) scatter_s: f64,
    /// Weighted mean, s.
    pub(crate) level: Effect,
    /// The largest significant difference: step, excursion or half a trend.
    pub(crate) difference: Effect,
    /// Least difference that counts, s.
    pub(crate) limit_s: f64,
    /// Detectable lasting change, s, between these instants, s; `None` if one window has nearly all information.
    pub(crate) detectable_s: Option<f64>,
    pub(crate) between_s: Option<[f64; 2]>,
    /// The same for a step at half the weight; the window length with the least value is used, s.
    pub(crate) at_best_s: f64,
    /// Trend, s/s.
    pub(crate) rate: Effect,
    /// Scatter from which constant delays are drawn, s.
    null_scatter_s: f64,
    strengths: [f64; 4],
}

pub(crate) fn compare(d: &Delays, settings: &OverTimeSettings) -> Comparison {
    let square: Vec<f64> = d.uncertainty_s.iter().map(|s| s * s).collect();
    let mut room = Workspace::new(d.len());
    let found = room.strengths(&d.delay_s, &square, &d.middle_s);
    let level = Effect { size: room.level, uncertainty: room.total.recip().sqrt() };
    let length = d.middle_s.last().zip(d.middle_s.first()).map_or(1.0, |(l, f)| (l - f).max(1e-9));
    let rate = Effect { size: room.slope.size / length, uncertainty: room.slope.uncertainty / length };
    let limit_s =
        (settings.least_change_share * level.size.abs()).min(settings.largest_limit_s).max(settings.least_change_s);
    let half_s = room.half_uncertainty();
    let sight = room.detectable_step();
    let detectable_s = sight.map(|(se, _)| (limit_s + 3.3 * se).max(4.5 * se));
    let between_s = sight.map(|(_, [from, to])| [d.middle_s[from - 1], d.middle_s[to]]);
    let difference = room.largest_difference();
    let null_scatter_s = room.scatter;
    Comparison {
        scatter_s: room.scatter,
        level,
        difference,
        limit_s,
        detectable_s,
        between_s,
        at_best_s: (limit_s + 3.3 * half_s).max(4.5 * half_s),
        rate,
        null_scatter_s,
        strengths: found,
    }
}

/// The decision.
#[derive(Debug, Clone)]
pub(crate) struct Decision {
    pub(crate) p: f64,
    pub(crate) varies: bool,
    /// The one window without which the change would not be significant.
    pub(crate) rests_on: Option<LoneWindow>,
}

/// A window that differs from the others.
#[derive(Debug, Clone)]
pub(crate) struct LoneWindow {
    pub(crate) row: usize,
    /// Its delay less the mean of the others, s.
    pub(crate) difference: Effect,
}

/// Varies if too improbable for a constant delay and above the limit, also with any one window left out.
pub(crate) fn decide(d: &Delays, c: &Comparison, settings: &OverTimeSettings) -> Decision {
    let p = probability(d, c, settings.draws, CLEARLY_ALIKE);
    let mut decision = Decision { p, varies: false, rests_on: None };
    if p >= settings.significance || c.difference.lower_bound() < c.limit_s {
        return decision;
    }
    let looser = 10.0 * settings.significance;
    let without = |row: usize| {
        let rest = d.without(row);
        let c = compare(&rest, settings);
        let size = d.delay_s[row] - c.level.size;
        (
            LoneWindow {
                row,
                difference: Effect { size, uncertainty: d.uncertainty_s[row].hypot(c.level.uncertainty) },
            },
            rest,
            c,
        )
    };
    let falls = |(_, rest, c): &(LoneWindow, Delays, Comparison)| {
        c.difference.lower_bound() < c.limit_s || probability(rest, c, settings.draws, 5.0 * looser) >= looser
    };
    let mut each: Vec<(LoneWindow, Delays, Comparison)> = (0..d.len()).map(without).collect();
    // The window that differs most comes first: if the change rests on one window, it is this one.
    each.sort_by(|a, b| b.0.difference.lower_bound().total_cmp(&a.0.difference.lower_bound()));
    decision.rests_on = each.into_iter().find(falls).map(|e| e.0);
    decision.varies = decision.rests_on.is_none();
    decision
}

/// Probability that a constant delay gives statistics at least as unlikely as these. Each draw estimates its own
/// scatter. Stops after the first draws if the result is already above `enough`, or far below.
fn probability(d: &Delays, c: &Comparison, draws: usize, enough: f64) -> f64 {
    let n = d.len();
    let square: Vec<f64> = d.uncertainty_s.iter().map(|s| s * s).collect();
    let sigma: Vec<f64> = square.iter().map(|s| (s + c.null_scatter_s * c.null_scatter_s).sqrt()).collect();
    let mut random = Pcg64::seed_from_u64(SEED);
    let mut drawn: [Vec<f64>; 4] = std::array::from_fn(|_| Vec::with_capacity(draws));
    let (mut room, mut delay) = (Workspace::new(n), vec![0.0; n]);
    let mut p = 1.0;
    for until in [FIRST_DRAWS.min(draws), draws] {
        while drawn[0].len() < until {
            for (x, s) in delay.iter_mut().zip(&sigma) {
                *x = s * random.sample::<f64, _>(StandardNormal);
            }
            let strengths = room.strengths(&delay, &square, &d.middle_s);
            drawn.iter_mut().zip(strengths).for_each(|(all, s)| all.push(s));
        }
        p = smallest_of_four(&drawn, &c.strengths);
        if p > enough || p < 1e-3 * enough {
            break;
        }
    }
    p
}

/// p of the least of four p: each from its draws, with an exponential tail above their 95 % point.
fn smallest_of_four(drawn: &[Vec<f64>; 4], found: &[f64; 4]) -> f64 {
    let tails: Vec<Tail> = drawn.iter().map(|d| Tail::new(d)).collect();
    let least = tails.iter().zip(found).map(|(t, x)| t.p(*x)).fold(1.0, f64::min);
    let mut null: Vec<f64> =
        (0..drawn[0].len()).map(|k| tails.iter().zip(drawn).map(|(t, d)| t.p(d[k])).fold(1.0, f64::min)).collect();
    let n = null.len();
    if n == 0 {
        return 1.0;
    }
    null.sort_unstable_by(f64::total_cmp);
    let low = signal::percentile_of_sorted(&null, 0.02).unwrap_or(0.02).max(1e-300);
    if least > low { null.partition_point(|p| *p <= least) as f64 / n as f64 } else { least * 0.02 / low }
}

/// Upper tail of a statistic.
struct Tail {
    sorted: Vec<f64>,
    high: f64,
    excess: f64,
}

impl Tail {
    fn new(drawn: &[f64]) -> Tail {
        let mut sorted = drawn.to_vec();
        sorted.sort_unstable_by(f64::total_cmp);
        let high = signal::percentile_of_sorted(&sorted, 0.95).unwrap_or(0.0);
        let above = &sorted[sorted.partition_point(|x| *x <= high)..];
        let excess = above.iter().map(|x| x - high).sum::<f64>() / above.len().max(1) as f64;
        Tail { sorted, high, excess: excess.max(1e-300) }
    }

    fn p(&self, x: f64) -> f64 {
        if x > self.high {
            return 0.05 * (-(x - self.high) / self.excess).exp();
        }
        let n = self.sorted.len();
        (n - self.sorted.partition_point(|s| *s < x)) as f64 / n.max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense::Random;

    fn windows(delay_s: impl Fn(usize) -> f64) -> Delays {
        let n = 24;
        Delays {
            window: (0..n).collect(),
            middle_s: (0..n).map(|k| 12.5 + 25.0 * k as f64).collect(),
            delay_s: (0..n).map(|k| delay_s(k) + 1e-3 * (1.7 * (k * k) as f64).sin()).collect(),
            uncertainty_s: vec![1e-3; n],
            speed_lag_s: Effect::default(),
            lever_m: Effect::default(),
            level: Effect { size: 0.2, uncertainty: 1e-3 },
            white_m: 0.02,
            inflation: 1.0,
        }
    }

    fn decided(d: &Delays) -> Decision {
        let settings = OverTimeSettings::default();
        decide(d, &compare(d, &settings), &settings)
    }

    #[test]
    fn a_change_of_one_window_is_its_difference_from_the_others() {
        for (row, late) in [(23, 0.3), (0, -0.2), (11, 0.3)] {
            let decision = decided(&windows(|k| if k == row { 0.2 + late } else { 0.2 }));
            let lone = decision.rests_on.unwrap();
            assert!(!decision.varies);
            assert_eq!(lone.row, row);
            assert!((lone.difference.size - late).abs() < 3.0 * lone.difference.uncertainty, "{lone:?}");
            assert!((1e-3..1.2e-3).contains(&lone.difference.uncertainty), "{lone:?}");
        }
    }

    #[test]
    fn a_change_of_many_windows_does_not_rest_on_one() {
        assert!(decided(&windows(|k| if k < 12 { 0.2 } else { 0.5 })).varies);
        let alike = decided(&windows(|_| 0.2));
        assert!(!alike.varies && alike.rests_on.is_none() && alike.p > 0.01);
    }

    fn noisy(random: &mut Random, n: usize) -> Delays {
        let uncertainty_s: Vec<f64> = (0..n).map(|_| random.uniform(0.005, 0.03)).collect();
        let delay_s = uncertainty_s.iter().map(|u| 0.2 + u * random.normal()).collect();
        let all = windows(|_| 0.2);
        Delays { window: (0..n).collect(), middle_s: all.middle_s[..n].to_vec(), delay_s, uncertainty_s, ..all }
    }

    /// Of 300 flights with a constant delay, 30 ± 5.2 have a probability below 10 %, and 3 ± 1.7 one below 1 %.
    #[test]
    fn probabilities_of_a_constant_delay_are_calibrated() {
        let mut random = Random::new(1);
        let settings = OverTimeSettings::default();
        let p: Vec<f64> = (0..300)
            .map(|_| {
                let d = noisy(&mut random, 14);
                probability(&d, &compare(&d, &settings), 400, 1.0)
            })
            .collect();
        let below = |limit: f64| p.iter().filter(|p| **p < limit).count();
        assert!((12..=48).contains(&below(0.1)), "{}", below(0.1));
        assert!((115..=185).contains(&below(0.5)), "{}", below(0.5));
        assert!(below(0.01) <= 10, "{}", below(0.01));
    }

    /// Ranks 0.5, 1.5, … of a distribution with this inverse.
    fn drawn(n: usize, inverse: impl Fn(f64) -> f64) -> Vec<f64> {
        (0..n).map(|k| inverse((k as f64 + 0.5) / n as f64)).collect()
    }

    #[test]
    fn a_tail_follows_its_draws_and_is_exponential_further_out() {
        let tail = Tail::new(&drawn(4000, |u| -(-u).ln_1p()));
        for x in [0.1f64, 1.0, 2.5, 2.99, 3.5, 6.0, 12.0] {
            let (found, expected) = (tail.p(x), (-x).exp());
            assert!((found / expected - 1.0).abs() < 0.15, "{x}: {found} {expected}");
        }
    }

    /// Four independent statistics: 1 − (1 − p)⁴. Four identical ones: p.
    #[test]
    fn the_least_of_four_probabilities_is_corrected() {
        let mut random = Random::new(2);
        let mut uniform = || (0..4000).map(|_| random.uniform(0.0, 1.0)).collect::<Vec<f64>>();
        let apart = [uniform(), uniform(), uniform(), uniform()];
        let same = [(); 4].map(|()| apart[0].clone());
        for p in [0.3, 0.1, 0.03] {
            let least = |drawn: &[Vec<f64>; 4], at: usize| {
                let mut found = [0.1; 4];
                found[at] = 1.0 - p;
                smallest_of_four(drawn, &found)
            };
            for at in 0..4 {
                let expected = 1.0 - (1.0 - p).powi(4);
                assert!((least(&apart, at) - expected).abs() < 0.1 * expected + 0.01, "{p}: {}", least(&apart, at));
                assert!((least(&same, at) - p).abs() < 0.1 * p + 0.005, "{p}: {}", least(&same, at));
            }
        }
        assert_eq!(smallest_of_four(&[vec![], vec![], vec![], vec![]], &[1.0; 4]), 1.0);
    }

    /// A fifth of the level, within 50 ms and 150 ms.
    #[test]
    fn the_least_change_is_a_limited_share_of_the_level() {
        let limit = |level: f64| compare(&windows(|_| level), &OverTimeSettings::default()).limit_s;
        for (level, expected) in [(0.0, 0.05), (0.2, 0.05), (0.5, 0.1), (-0.5, 0.1), (3.0, 0.15)] {
            assert!((limit(level) - expected).abs() < 1e-3, "{level}");
        }
    }

    /// 24 windows of ± 1 ms: level, rate and detectable change, by closed formulas.
    #[test]
    fn joint_results_follow_from_the_number_and_uncertainty_of_windows() {
        let d = Delays { uncertainty_s: vec![2e-3; 24], ..windows(|k| 0.2 + 1e-4 * k as f64) };
        let c = compare(&d, &OverTimeSettings::default());
        assert_eq!(c.scatter_s, 0.0);
        assert!(
            (c.level.size - 0.2 - 11.5e-4).abs() < 1e-3 && (c.level.uncertainty - 2e-3 / 24f64.sqrt()).abs() < 1e-12
        );
        // Σ (k − 11.5)² = 1150, windows 25 s apart.
        assert!((c.rate.uncertainty - 2e-3 / (25.0 * 1150f64.sqrt())).abs() < 1e-12);
        assert!((c.rate.size - 4e-6).abs() < 3.0 * c.rate.uncertainty);
        let half = 2e-3 * (2.0 / 12.0f64).sqrt();
        assert!((c.at_best_s - 0.05 - 3.3 * half).abs() < 1e-9);
        // At half, with one window left out, the variance is 1/11 + 1/12. After four windows 1/3 + 1/20 is up to 2.8
        // times this, and after three 1/2 + 1/21 is more.
        let worst = 2e-3 * (1.0 / 3.0 + 1.0 / 20.0f64).sqrt();
        assert!((c.detectable_s.unwrap() - 0.05 - 3.3 * worst).abs() < 1e-9);
        assert_eq!(c.between_s, Some([d.middle_s[3], d.middle_s[20]]));
        // If noise dominates, a change must be 4.5 standard uncertainties.
        let rough = compare(&Delays { uncertainty_s: vec![0.2; 24], ..d }, &OverTimeSettings::default());
        assert!((rough.at_best_s - 4.5 * 100.0 * half).abs() < 1e-9, "{rough:?}");
        assert!((rough.detectable_s.unwrap() - 4.5 * 100.0 * worst).abs() < 1e-9, "{rough:?}");
    }

    #[test]
    fn a_significant_change_below_the_limit_is_ignored() {
        let small = decided(&windows(|k| if k < 12 { 0.2 } else { 0.24 }));
        assert!(small.p < 1e-6 && !small.varies && small.rests_on.is_none(), "{small:?}");
    }
}
