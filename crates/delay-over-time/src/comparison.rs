//! Step, excursion and trend among the delays of windows (B S5 d, e).

use crate::delays::Effect;

/// Median of chi-squared with one degree of freedom.
const MEDIAN_CHI_SQUARED: f64 = 0.454_936_423;
/// Largest excess scatter, s.
const MOST_SCATTER_S: f64 = 1.0;
/// A part of the flight has at least this share of the weight.
const LEAST_SHARE: f64 = 0.02;
/// Windows on either side of a step that is seen with any one left out.
const LEAST_WINDOWS: usize = 3;
/// Variance of a step there over that at the best place: up to a tenth of the weight on one side.
const NEARLY_AS_WELL: f64 = 2.8;

/// Median of the squared differences of neighbours over their variances as it should be: a few changes do not count.
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

/// Windows from `.0` up to `.1` against the others; empty if there is no such part.
type Part = (usize, usize);

/// Memory and sums of one set of delays.
pub(crate) struct Room {
    weight: Vec<f64>,
    /// Sums of the weights, and of weight times delay less the level, before each window and at the end.
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

impl Room {
    pub(crate) fn new(n: usize) -> Room {
        Room {
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

    /// Likelihood ratios of the best step, of the best step or excursion and of a trend, each with a scatter of its own,
    /// and the mean squared partial sum. The scatter of the room becomes the least of them.
    pub(crate) fn strengths(&mut self, delay: &[f64], square: &[f64], middle: &[f64]) -> [f64; 4] {
        let n = delay.len();
        let from_neighbours = excess_scatter(delay, square, &mut self.memory);
        self.sum(delay, square, middle, from_neighbours);
        self.search();
        let whole = (0, n);
        let (_, null) = own_scatter(delay, square, whole, 0.0, middle);
        let (step_scatter, step) = own_scatter(delay, square, self.step, 0.0, middle);
        let (excursion_scatter, excursion) = if self.excursion == self.step {
            (step_scatter, step)
        } else {
            own_scatter(delay, square, self.excursion, 0.0, middle)
        };
        let slope = self.slope.size / (middle[n - 1] - middle[0]).max(1e-9);
        let (trend_scatter, trend) = own_scatter(delay, square, whole, slope, middle);
        let least = step_scatter.min(excursion_scatter).min(trend_scatter);
        if least < from_neighbours {
            self.sum(delay, square, middle, least);
        }
        let squares: f64 = self.sums[1..n].iter().map(|s| s * s).sum();
        let step = if self.step == (0, 0) { 0.0 } else { null - step };
        let excursion = if self.excursion == (0, 0) { step } else { null - excursion };
        [step, excursion.max(step), null - trend, squares / (self.total * n as f64 / 6.0)]
    }

    /// Weights and sums under `scatter`.
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

    /// The difference with the largest lower bound. Call after [`Room::strengths`].
    pub(crate) fn largest_difference(&self) -> Effect {
        let of = |(i, j): Part| {
            let (sum, weight) = (self.sums[j] - self.sums[i], self.weights[j] - self.weights[i]);
            let rest = self.total - weight;
            // A step is what comes after less what was before.
            let sign = if i == 0 { -1.0 } else { 1.0 };
            let size = sign * sum * self.total / (weight * rest);
            (j > i && size.is_finite()).then(|| Effect { size, uncertainty: (1.0 / weight + 1.0 / rest).sqrt() })
        };
        let trend = Effect { size: 0.5 * self.slope.size, uncertainty: 0.5 * self.slope.uncertainty };
        let candidates = [of(self.step), of(self.excursion), Some(trend)];
        candidates.into_iter().flatten().max_by(|a, b| a.surely().total_cmp(&b.surely())).unwrap_or_default()
    }

    /// Standard uncertainty of a step at half the weight.
    pub(crate) fn half_uncertainty(&self) -> f64 {
        let half = self.weights.partition_point(|w| *w < 0.5 * self.total).min(self.weight.len() - 1).max(1);
        (1.0 / self.weights[half] + 1.0 / (self.total - self.weights[half])).sqrt()
    }

    /// Where a step would be seen nearly as well as at the best place, and its standard uncertainty at the worst of these
    /// places with any one window left out: first and last window that begin the part after the step.
    pub(crate) fn sight(&self) -> Option<(f64, [usize; 2])> {
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

/// Scatter beyond the uncertainties about the means of `part` and of the rest after a `slope` was taken out, and
/// −2 log likelihood with it: restricted maximum likelihood by three Newton steps from the moments.
fn own_scatter(delay: &[f64], square: &[f64], part: Part, slope: f64, middle: &[f64]) -> (f64, f64) {
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
    let inside = |k: usize| k >= part.0 && k < part.1;
    let value = |k: usize| delay[k] - slope * middle[k];
    let sums = |excess: f64| {
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
    };
    let (at_zero, _, log_det) = sums(0.0);
    if at_zero <= free {
        return (0.0, at_zero + log_det);
    }
    // Unweighted moments overestimate what a few bad windows add; Newton's steps repair it.
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

/// Squared difference of a part's mean from the rest's over its variance; `sum` is about the level.
#[inline]
fn strength(sum: f64, weight: f64, total: f64) -> f64 {
    let rest = total - weight;
    let q = sum * sum * total / (weight * rest);
    if weight > LEAST_SHARE * total && rest > LEAST_SHARE * total { q } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sight(uncertainty_s: &[f64]) -> Option<(f64, [usize; 2])> {
        let n = uncertainty_s.len();
        let square: Vec<f64> = uncertainty_s.iter().map(|u| u * u).collect();
        let middle: Vec<f64> = (0..n).map(|k| 10.0 * k as f64).collect();
        let mut room = Room::new(n);
        room.strengths(&vec![0.2; n], &square, &middle);
        room.sight()
    }

    /// Twelve equal windows: at the worst place two are left before the step and nine are after it.
    #[test]
    fn the_limit_holds_at_the_worst_place_with_any_window_left_out() {
        let (u, between) = sight(&[0.01; 12]).unwrap();
        assert!((u - 0.01 * (1.0 / 2.0 + 1.0 / 9.0f64).sqrt()).abs() < 1e-12, "{u}");
        assert_eq!(between, [3, 9]);
    }

    #[test]
    fn a_part_that_knows_little_is_not_promised() {
        let bad_first: Vec<f64> = (0..12).map(|k| if k < 5 { 0.1 } else { 0.01 }).collect();
        let [from, to] = sight(&bad_first).unwrap().1;
        assert_eq!([from, to], [7, 9], "two good windows before the step, of which one may be left out");
        assert!(sight(&[0.01; 5]).is_none());
    }
}
