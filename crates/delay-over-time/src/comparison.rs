//! Step, excursion and trend among the delays of windows (B S5 d, e).

use crate::delays::Effect;

/// Median of chi-squared with one degree of freedom.
const MEDIAN_CHI_SQUARED: f64 = 0.454_936_423;
/// Largest excess scatter, s.
const MOST_SCATTER_S: f64 = 1.0;
/// Least share of the weight that a part of the flight must have.
const LEAST_SHARE: f64 = 0.02;
/// Least windows on each side of a step for it to be detectable with any one left out.
const LEAST_WINDOWS: usize = 3;
/// Largest ratio of a step's variance to that at the best place: up to a tenth of the weight on one side.
const NEARLY_AS_WELL: f64 = 2.8;

/// Scatter that makes the median normalised squared difference of neighbours as expected; robust against a few changes.
fn excess_scatter(delay: &[f64], square: &[f64], room: &mut Vec<f64>) -> f64 {
    room.clear();
    let neighbours = delay.windows(2).zip(square.windows(2));
    room.extend(neighbours.map(|(d, s)| 0.5 * ((d[1] - d[0]).powi(2) / MEDIAN_CHI_SQUARED - s[0] - s[1])));
    let n = room.len();
    if n == 0 {
        return 0.0;
    }
    let (below, upper, _) = room.select_nth_unstable_by(n / 2, f64::total_cmp);
    let upper = *upper;
    let median = if n % 2 == 1 { upper } else { 0.5 * (upper + below.iter().copied().fold(f64::MIN, f64::max)) };
    median.max(0.0).sqrt().min(MOST_SCATTER_S)
}

/// Windows from `.0` up to `.1` compared with the others; empty if there is no such part.
type Part = (usize, usize);

/// Buffers and sums for one set of delays.
pub(crate) struct Workspace {
    weight: Vec<f64>,
    /// Sums of the weights, and of weight times delay relative to the level, before each window and at the end.
    weights: Vec<f64>,
    sums: Vec<f64>,
    memory: Vec<f64>,
    pub(crate) total: f64,
    pub(crate) level: f64,
    pub(crate) slope: Effect,
    pub(crate) scatter: f64,
    step: Part,
    excursion: Part,
}

impl Workspace {
    pub(crate) fn new(n: usize) -> Workspace {
        Workspace {
            weight: vec![0.0; n],
            weights: vec![0.0; n + 1],
            sums: vec![0.0; n + 1],
            memory: vec![],
            total: 0.0,
            level: 0.0,
            slope: Effect::default(),
            scatter: 0.0,
            step: (0, 0),
            excursion: (0, 0),
        }
    }

    /// Likelihood ratios of the best step, of the best step or excursion and of a trend, each with its own scatter, and
    /// the mean squared partial sum. The scatter of the room becomes the least of them.
    pub(crate) fn strengths(&mut self, delay: &[f64], square: &[f64], middle: &[f64]) -> [f64; 4] {
        let n = delay.len();
        let from_neighbours = excess_scatter(delay, square, &mut self.memory);
        self.sum(delay, square, middle, from_neighbours);
        self.search();
        let whole = (0, n);
        let (_, null) = excess_scatter_about(delay, square, whole, 0.0, middle);
        let (step_scatter, step) = excess_scatter_about(delay, square, self.step, 0.0, middle);
        let (excursion_scatter, excursion) = if self.excursion == self.step {
            (step_scatter, step)
        } else {
            excess_scatter_about(delay, square, self.excursion, 0.0, middle)
        };
        let slope = self.slope.size / (middle[n - 1] - middle[0]).max(1e-9);
        let (trend_scatter, trend) = excess_scatter_about(delay, square, whole, slope, middle);
        let least = step_scatter.min(excursion_scatter).min(trend_scatter);
        if least < from_neighbours {
            self.sum(delay, square, middle, least);
        }
        let squares: f64 = self.sums[1..n].iter().map(|s| s * s).sum();
        let step = if self.step == (0, 0) { 0.0 } else { null - step };
        let excursion = if self.excursion == (0, 0) { step } else { null - excursion };
        [step, excursion.max(step), null - trend, squares / (self.total * n as f64 / 6.0)]
    }

    /// Computes weights and sums for `scatter`.
    fn sum(&mut self, delay: &[f64], square: &[f64], middle: &[f64], scatter: f64) {
        let (mut total, mut first, mut centre) = (0.0, 0.0, 0.0);
        for (((w, d), s), m) in self.weight.iter_mut().zip(delay).zip(square).zip(middle) {
            *w = 1.0 / (s + scatter * scatter);
            total += *w;
            first += *w * d;
            centre += *w * m;
        }
        (self.scatter, self.total, self.level) = (scatter, total, first / total);
        let centre = centre / total;
        let (mut w_sum, mut sum, mut with_time, mut time) = (0.0, 0.0, 0.0, 0.0);
        for (k, ((w, d), m)) in self.weight.iter().zip(delay).zip(middle).enumerate() {
            let (d, x) = (d - self.level, m - centre);
            w_sum += w;
            sum += w * d;
            self.weights[k + 1] = w_sum;
            self.sums[k + 1] = sum;
            with_time += w * d * x;
            time += w * x * x;
        }
        let length = middle.last().zip(middle.first()).map_or(0.0, |(l, f)| l - f);
        let slope = if time > 0.0 { with_time / time } else { 0.0 };
        self.slope = Effect { size: slope * length, uncertainty: if time > 0.0 { length / time.sqrt() } else { 0.0 } };
    }

    /// Finds the strongest step and the strongest excursion; both sides have at least two windows.
    fn search(&mut self) {
        let n = self.weight.len();
        let mut best = 0.0;
        self.step = (0, 0);
        for k in 2..n.saturating_sub(1) {
            let q = strength(self.sums[k], self.weights[k], self.total);
            if q > best {
                (best, self.step) = (q, (0, k));
            }
        }
        self.excursion = self.step;
        for i in 1..n.saturating_sub(2) {
            let (w0, s0) = (self.weights[i], self.sums[i]);
            let pairs = self.weights[i + 2..n].iter().zip(&self.sums[i + 2..n]);
            let row = pairs.map(|(w, s)| strength(s - s0, w - w0, self.total)).fold(0.0, f64::max);
            if row > best {
                let j = (i + 2..n).find(|j| strength(self.sums[*j] - s0, self.weights[*j] - w0, self.total) >= row);
                best = row;
                self.excursion = j.map_or(self.excursion, |j| (i, j));
            }
        }
    }

    /// The difference with the largest lower bound. Call after [`Workspace::strengths`].
    pub(crate) fn largest_difference(&self) -> Effect {
        let of = |(i, j): Part| {
            let (sum, weight) = (self.sums[j] - self.sums[i], self.weights[j] - self.weights[i]);
            let rest = self.total - weight;
            // A step is the level after less the level before.
            let sign = if i == 0 { -1.0 } else { 1.0 };
            let size = sign * sum * self.total / (weight * rest);
            (j > i && size.is_finite()).then(|| Effect { size, uncertainty: (1.0 / weight + 1.0 / rest).sqrt() })
        };
        let trend = Effect { size: 0.5 * self.slope.size, uncertainty: 0.5 * self.slope.uncertainty };
        let candidates = [of(self.step), of(self.excursion), Some(trend)];
        candidates.into_iter().flatten().max_by(|a, b| a.lower_bound().total_cmp(&b.lower_bound())).unwrap_or_default()
    }

    /// Standard uncertainty of a step at half the weight.
    pub(crate) fn half_uncertainty(&self) -> f64 {
        let half = self.weights.partition_point(|w| *w < 0.5 * self.total).min(self.weight.len() - 1).max(1);
        (1.0 / self.weights[half] + 1.0 / (self.total - self.weights[half])).sqrt()
    }

    /// First and last window that may begin the part after a step for it to be detectable nearly as well as at the best
    /// place. Also its standard uncertainty at the worst of these places with any one window left out.
    pub(crate) fn detectable_step(&self) -> Option<(f64, [usize; 2])> {
        let n = self.weight.len();
        let heaviest = |from: usize, to: usize| self.weight[from..to].iter().copied().fold(0.0, f64::max);
        let variance = |k: usize| {
            let (before, after) = (self.weights[k], self.total - self.weights[k]);
            let first = 1.0 / (before - heaviest(0, k)) + 1.0 / after;
            first.max(1.0 / before + 1.0 / (after - heaviest(k, n)))
        };
        let places = LEAST_WINDOWS..(n + 1).saturating_sub(LEAST_WINDOWS);
        let best = places.clone().min_by(|a, b| variance(*a).total_cmp(&variance(*b)))?;
        let near = |k: &usize| variance(*k) <= NEARLY_AS_WELL * variance(best);
        let from = (places.start..=best).rev().take_while(near).last()?;
        let to = (best..places.end).take_while(near).last()?;
        let worst = (from..=to).map(variance).fold(0.0, f64::max);
        worst.is_finite().then(|| (worst.sqrt(), [from, to]))
    }
}

/// Scatter in excess of the uncertainties about the means of `part` and of the rest, with a `slope` removed, and −2 log
/// likelihood with it: restricted maximum likelihood by three Newton steps from the moments.
fn excess_scatter_about(delay: &[f64], square: &[f64], part: Part, slope: f64, middle: &[f64]) -> (f64, f64) {
    let n = delay.len();
    let split = part.1 > part.0 && part.1 - part.0 < n;
    let free = n as f64
        - if split {
            3.0
        } else if slope != 0.0 {
            2.0
        } else {
            1.0
        };
    let sums = |excess: f64| sums_about(delay, square, part, |k| slope * middle[k], excess);
    let (at_zero, _, log_det) = sums(0.0);
    if at_zero <= free {
        return (0.0, at_zero + log_det);
    }
    // Unweighted moments overestimate the contribution of a few bad windows; Newton's steps correct it.
    let mean_square = square.iter().sum::<f64>() / n as f64;
    let equal = sums(1e3 * (mean_square + 1e-6)).0 * 1e3 * (mean_square + 1e-6);
    let mut excess = (equal / free - mean_square).max(0.05 * mean_square);
    let mut last = (0.0, 0.0, 0.0);
    for round in 0..4 {
        last = sums(excess);
        if round < 3 {
            let step = (last.0 - free) / last.1.max(1e-300);
            excess = (excess + step).clamp(0.2 * excess, 5.0 * excess + 1e-12);
        }
    }
    (excess.sqrt().min(MOST_SCATTER_S), last.0 + last.2)
}

/// Chi-squared about the means of `part` and of the rest, its rate of decrease with the excess variance, and the
/// logarithm of their product. `trend` is removed first.
#[inline]
fn sums_about(delay: &[f64], square: &[f64], part: Part, trend: impl Fn(usize) -> f64, excess: f64) -> (f64, f64, f64) {
    let n = delay.len();
    let inside = |k: usize| k >= part.0 && k < part.1;
    let value = |k: usize| delay[k] - trend(k);
    let mut of = [[0.0; 2]; 2];
    for k in 0..n {
        let w = 1.0 / (square[k] + excess);
        let side = &mut of[usize::from(inside(k))];
        side[0] += w;
        side[1] += w * value(k);
    }
    let mean = of.map(|s| if s[0] > 0.0 { s[1] / s[0] } else { 0.0 });
    let (mut chi_squared, mut falls, mut log_det) = (0.0, 0.0, 1.0);
    let mut log_sum = 0.0;
    for k in 0..n {
        let v = square[k] + excess;
        let d = value(k) - mean[usize::from(inside(k))];
        let q = d * d / v;
        chi_squared += q;
        falls += q / v;
        log_det *= v;
        if !(1e-200..1e200).contains(&log_det) {
            log_sum += f64::ln(log_det);
            log_det = 1.0;
        }
    }
    (chi_squared, falls, log_sum + log_det.ln())
}

/// Squared difference between the mean of a part and of the rest over its variance; `sum` is relative to the level.
#[inline]
fn strength(sum: f64, weight: f64, total: f64) -> f64 {
    let rest = total - weight;
    let q = sum * sum * total / (weight * rest);
    if weight > LEAST_SHARE * total && rest > LEAST_SHARE * total { q } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense::{Random, near};
    use nalgebra::{DMatrix, DVector};

    fn sight(uncertainty_s: &[f64]) -> Option<(f64, [usize; 2])> {
        let n = uncertainty_s.len();
        let square: Vec<f64> = uncertainty_s.iter().map(|u| u * u).collect();
        let middle: Vec<f64> = (0..n).map(|k| 10.0 * k as f64).collect();
        let mut room = Workspace::new(n);
        room.strengths(&vec![0.2; n], &square, &middle);
        room.detectable_step()
    }

    /// Twelve equal windows: at the worst place two remain before the step and nine after it.
    #[test]
    fn the_limit_holds_at_the_worst_place_without_any_one_window() {
        let (u, between) = sight(&[0.01; 12]).unwrap();
        assert!((u - 0.01 * (1.0 / 2.0 + 1.0 / 9.0f64).sqrt()).abs() < 1e-12, "{u}");
        assert_eq!(between, [3, 9]);
    }

    #[test]
    fn a_part_with_little_information_is_not_claimed() {
        let bad_first: Vec<f64> = (0..12).map(|k| if k < 5 { 0.1 } else { 0.01 }).collect();
        let [from, to] = sight(&bad_first).unwrap().1;
        assert_eq!([from, to], [7, 9], "two good windows before the step, of which one may be left out");
        assert!(sight(&[0.01; 5]).is_none());
    }

    fn mean(x: &[f64]) -> f64 {
        x.iter().sum::<f64>() / x.len() as f64
    }

    fn about_mean(x: &[f64]) -> f64 {
        x.iter().map(|v| (v - mean(x)).powi(2)).sum()
    }

    /// Delays about 0.2 s with a scatter of `scatter` at unequally spaced instants, plus `more`.
    fn windows(seed: u64, n: usize, scatter: f64, more: impl Fn(usize) -> f64) -> (Vec<f64>, Vec<f64>) {
        let mut random = Random::new(seed);
        let delay = (0..n).map(|k| 0.2 + scatter * random.normal() + more(k)).collect();
        (delay, random.stamps(n, 100.0))
    }

    /// Scatter and −2 log likelihood of `n` windows of equal uncertainty `u` with residual `square` and `free` degrees
    /// of freedom: the variance of each is square / free, but at least u².
    fn by_formula(square: f64, free: f64, n: usize, u: f64) -> (f64, f64) {
        let variance = (square / free).max(u * u);
        ((variance - u * u).sqrt(), square / variance + n as f64 * variance.ln())
    }

    /// Scatters of zero, of a third and of five times the uncertainty.
    #[test]
    fn the_scatter_of_equal_windows_follows_from_their_squares() {
        let (n, u) = (14, 0.01);
        for (seed, scatter) in [(1, 0.0), (2, 0.003), (3, 0.05), (4, 0.05)] {
            let (delay, middle) = windows(seed, n, scatter, |k| if k < 5 { 0.1 } else { 0.0 });
            let agree = |found: (f64, f64), expected: (f64, f64)| {
                assert!((found.0 - expected.0).abs() < 1e-9, "{found:?} {expected:?}");
                assert!(near(found.1, expected.1, 1e-9), "{found:?} {expected:?}");
            };
            let own = |part, slope| excess_scatter_about(&delay, &vec![u * u; n], part, slope, &middle);
            agree(own((0, n), 0.0), by_formula(about_mean(&delay), 13.0, n, u));
            let [a, b] = [&delay[..5], &delay[5..]].map(about_mean);
            agree(own((0, 5), 0.0), by_formula(a + b, 11.0, n, u));
            let outside = [&delay[..4], &delay[9..]].concat();
            agree(own((4, 9), 0.0), by_formula(about_mean(&delay[4..9]) + about_mean(&outside), 11.0, n, u));
            let level: Vec<f64> = delay.iter().zip(&middle).map(|(d, m)| d + 0.02 * m).collect();
            agree(own((0, n), -0.02), by_formula(about_mean(&level), 12.0, n, u));
        }
    }

    /// Windows of unequal uncertainty: with the scatter, chi-squared equals the degrees of freedom, and the likelihood
    /// is that of a normal distribution.
    #[test]
    fn windows_with_excess_scatter_have_the_expected_chi_squared() {
        let n = 30;
        for seed in 10..16 {
            let (delay, middle) = windows(seed, n, 0.06, |k| if k < 12 { 0.2 } else { 0.0 });
            let mut random = Random::new(seed);
            let square: Vec<f64> = (0..n).map(|_| random.uniform(0.01, 0.04).powi(2)).collect();
            let (scatter, cost) = excess_scatter_about(&delay, &square, (0, 12), 0.0, &middle);
            let variance: Vec<f64> = square.iter().map(|s| s + scatter * scatter).collect();
            let chi_squared: f64 = [0..12, 12..n]
                .map(|rows| {
                    let total: f64 = rows.clone().map(|k| 1.0 / variance[k]).sum();
                    let level = rows.clone().map(|k| delay[k] / variance[k]).sum::<f64>() / total;
                    rows.map(|k| (delay[k] - level).powi(2) / variance[k]).sum::<f64>()
                })
                .iter()
                .sum();
            assert!((chi_squared - 27.0).abs() < 0.01, "{chi_squared}");
            let log_det: f64 = variance.iter().map(|v| v.ln()).sum();
            assert!(near(cost, chi_squared + log_det, 1e-9), "{cost}");
        }
    }

    /// Two hundred windows of 1 µs: their determinant underflows, its logarithm does not.
    #[test]
    fn the_likelihood_of_many_windows_is_finite() {
        let (n, u) = (200, 1e-6);
        let delay: Vec<f64> = (0..n).map(|k| 1e-7 * f64::from(u8::from(k % 2 == 0))).collect();
        let (scatter, cost) = excess_scatter_about(&delay, &vec![u * u; n], (0, n), 0.0, &vec![0.0; n]);
        let expected = by_formula(about_mean(&delay), 199.0, n, u);
        assert!(scatter == 0.0 && near(cost, expected.1, 1e-9), "{cost} {expected:?}");
    }

    /// The best part of windows of equal weight by brute force: the decrease of the squares when it gets its own mean.
    fn best_part(delay: &[f64], parts: impl Iterator<Item = Part>) -> (f64, Part) {
        let rest = |(i, j): Part| about_mean(&delay[i..j]) + about_mean(&[&delay[..i], &delay[j..]].concat());
        parts.map(|part| (rest(part), part)).min_by(|a, b| a.0.total_cmp(&b.0)).unwrap()
    }

    fn middle_of(mut x: Vec<f64>) -> f64 {
        x.sort_by(f64::total_cmp);
        let n = x.len();
        0.5 * (x[n / 2] + x[(n - 1) / 2])
    }

    /// Expected results for windows of equal uncertainty, by definition.
    struct Expected {
        strengths: [f64; 4],
        step: Part,
        excursion: Part,
        scatter: f64,
        slope: f64,
    }

    fn by_definition(delay: &[f64], middle: &[f64], u: f64) -> Expected {
        let n = delay.len();
        let null = by_formula(about_mean(delay), n as f64 - 1.0, n, u);
        let steps = || (2..n - 1).map(|k| (0, k));
        let (squares, step) = best_part(delay, steps());
        let stepped = by_formula(squares, n as f64 - 3.0, n, u);
        let inner = (1..n - 2).flat_map(|i| (i + 2..n).map(move |j| (i, j)));
        let (squares, excursion) = best_part(delay, steps().chain(inner));
        let any = by_formula(squares, n as f64 - 3.0, n, u);
        let with_time: f64 = middle.iter().zip(delay).map(|(m, d)| (m - mean(middle)) * d).sum();
        let slope = with_time / about_mean(middle);
        let flat: Vec<f64> = delay.iter().zip(middle).map(|(d, m)| d - slope * m).collect();
        let trend = by_formula(about_mean(&flat), n as f64 - 2.0, n, u);
        let neighbours = delay.windows(2).map(|d| 0.5 * (d[1] - d[0]).powi(2) / 0.454_936_423 - u * u);
        let scatter = middle_of(neighbours.collect()).max(0.0).sqrt().min(stepped.0).min(any.0).min(trend.0);
        let partial = (1..n).map(|k| (delay[..k].iter().sum::<f64>() - k as f64 * mean(delay)).powi(2));
        let nyblom = 6.0 * partial.sum::<f64>() / ((u * u + scatter * scatter) * (n * n) as f64);
        let best = (null.1 - any.1).max(null.1 - stepped.1);
        let strengths = [null.1 - stepped.1, best, null.1 - trend.1, nyblom];
        Expected { strengths, step, excursion, scatter, slope }
    }

    /// A step, an excursion, a trend and pure scatter.
    #[test]
    fn strengths_are_likelihood_ratios_of_the_best_step_excursion_and_trend() {
        let (n, u) = (15, 0.02);
        let shapes: [fn(usize) -> f64; 4] = [
            |k| if k < 6 { 0.3 } else { 0.0 },
            |k| if (5..9).contains(&k) { 0.3 } else { 0.0 },
            |k| 0.02 * k as f64,
            |_| 0.0,
        ];
        for (seed, (shape, scatter)) in shapes.iter().flat_map(|s| [(s, 0.01), (s, 0.06)]).enumerate() {
            let (delay, middle) = windows(20 + seed as u64, n, scatter, shape);
            let mut room = Workspace::new(n);
            let found = room.strengths(&delay, &vec![u * u; n], &middle);
            let expected = by_definition(&delay, &middle, u);
            assert_eq!((room.step, room.excursion), (expected.step, expected.excursion));
            assert!((room.scatter - expected.scatter).abs() < 1e-8 && (room.level - mean(&delay)).abs() < 1e-12);
            for (x, y) in found.iter().zip(&expected.strengths) {
                assert!(near(*x, *y, 1e-6), "{seed}: {found:?} {:?}", expected.strengths);
            }
            let (length, variance) = (middle[n - 1] - middle[0], u * u + expected.scatter.powi(2));
            assert!(near(room.slope.size, expected.slope * length, 1e-9));
            assert!(near(room.slope.uncertainty, length * (variance / about_mean(&middle)).sqrt(), 1e-6));
        }
    }

    /// Compared with the normal equations of a level and a slope.
    #[test]
    fn level_and_slope_match_weighted_least_squares() {
        let n = 9;
        let (delay, middle) = windows(40, n, 1e-3, |k| 1e-3 * k as f64);
        let square: Vec<f64> = (0..n).map(|k| (0.01 + 0.02 * (k % 4) as f64).powi(2)).collect();
        let mut room = Workspace::new(n);
        room.strengths(&delay, &square, &middle);
        assert!(room.scatter == 0.0);
        let x = DMatrix::from_fn(n, 2, |i, c| if c == 0 { 1.0 } else { middle[i] });
        let weights = DMatrix::from_diagonal(&DVector::from_iterator(n, square.iter().map(|s| 1.0 / s)));
        let covariance = (x.transpose() * &weights * &x).try_inverse().unwrap();
        let solved = &covariance * x.transpose() * &weights * DVector::from_column_slice(&delay);
        let length = middle[n - 1] - middle[0];
        assert!((room.slope.size - solved[1] * length).abs() < 1e-9);
        assert!((room.slope.uncertainty - covariance[(1, 1)].sqrt() * length).abs() < 1e-9);
        let total: f64 = square.iter().map(|s| 1.0 / s).sum();
        let level = delay.iter().zip(&square).map(|(d, s)| d / s).sum::<f64>() / total;
        assert!((room.level - level).abs() < 1e-12 && near(room.total, total, 1e-12));
        let sums = square.iter().zip(&delay).scan((0.0, 0.0), |s, (v, d)| {
            *s = (s.0 + 1.0 / v, s.1 + (d - level) / v);
            Some(*s)
        });
        for (k, (weight, sum)) in sums.enumerate() {
            assert!(near(room.weights[k + 1], weight, 1e-12) && near(room.sums[k + 1], sum, 1e-9));
        }
    }

    fn difference(delay: &[f64], u: f64) -> Effect {
        let n = delay.len();
        let middle: Vec<f64> = (0..n).map(|k| 10.0 * k as f64).collect();
        let mut room = Workspace::new(n);
        room.strengths(delay, &vec![u * u; n], &middle);
        room.largest_difference()
    }

    /// After less before for a step, inside less outside for an excursion, half the change for a trend.
    #[test]
    fn a_difference_has_the_size_sign_and_uncertainty_of_the_means() {
        let u = 0.01;
        let is = |found: Effect, size: f64, uncertainty: f64| {
            assert!((found.size - size).abs() < 1e-9 && (found.uncertainty - uncertainty).abs() < 1e-9, "{found:?}");
        };
        for sign in [1.0, -1.0] {
            let step: Vec<f64> = (0..16).map(|k| if k < 6 { 0.2 } else { 0.2 + 0.3 * sign }).collect();
            is(difference(&step, u), 0.3 * sign, u * (1.0 / 6.0 + 0.1f64).sqrt());
            let bump: Vec<f64> = (0..16).map(|k| if (5..10).contains(&k) { 0.2 + 0.3 * sign } else { 0.2 }).collect();
            is(difference(&bump, u), 0.3 * sign, u * (0.2 + 1.0 / 11.0f64).sqrt());
        }
        let trend: Vec<f64> = (0..4).map(|k| -0.1 * f64::from(k)).collect();
        // With four windows a step has two on each side: 0.2 s ± u. Half the trend is 0.15 s ± u 3 / √5 / 2.
        let lower_bound = |size: f64, uncertainty: f64| size - 2.0 * uncertainty;
        let (step, half) = (lower_bound(0.2, u), lower_bound(0.15, 1.5 * u / 5f64.sqrt()));
        assert!(step > half);
        is(difference(&trend, u), -0.2, u);
        let alone = [0.0, 0.1, 0.2];
        is(difference(&alone, u), 0.1, 0.5 * u * 2.0 / 2f64.sqrt());
    }

    #[test]
    fn half_of_the_weight_is_half_of_equally_informative_windows() {
        let of = |square: &[f64]| {
            let n = square.len();
            let mut room = Workspace::new(n);
            room.strengths(&vec![0.2; n], square, &(0..n).map(|k| k as f64).collect::<Vec<f64>>());
            room.half_uncertainty()
        };
        assert!((of(&[0.25; 12]) - 0.5 * (2.0 / 6.0f64).sqrt()).abs() < 1e-12);
        // The first window alone has more information than all others: half the weight is as near as a step can be.
        assert!((of(&[0.01, 1.0, 1.0, 1.0]) - (0.01 + 1.0 / 3.0f64).sqrt()).abs() < 1e-12);
    }
}
