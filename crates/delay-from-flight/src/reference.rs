//! Reference for a channel: the integral of a rate, or a track between its samples.

use signal::{Cursor, Reference, SharedColumn};

/// `∫ v dτ` from the first sample, with `v` linear between samples: continuous with its derivative, exact, and as
/// symmetric in time as the samples, so interpolation causes no shift.
pub(crate) struct Integral<'a> {
    t: &'a [f64],
    /// Integral and rate at the start of each interval, and half the slope of the rate within it; the last one is
    /// extrapolated.
    pieces: Vec<[f64; 3]>,
    /// Further columns that are fitted with it.
    shared: Vec<(Integral<'a>, f64)>,
}

impl<'a> Integral<'a> {
    /// Integral of `v` (unit/s) at the rising times `t` (s); both of the same length and not empty.
    pub(crate) fn new(t: &'a [f64], v: &[f64]) -> Integral<'a> {
        let mut sum = 0.0;
        let mut pieces = Vec::with_capacity(t.len());
        for (t, v) in t.windows(2).zip(v.windows(2)) {
            let step = t[1] - t[0];
            pieces.push([sum, v[0], 0.5 * (v[1] - v[0]) / step]);
            sum += 0.5 * (v[0] + v[1]) * step;
        }
        pieces.push([sum, v.last().copied().unwrap_or(0.0), 0.0]);
        Integral { t, pieces, shared: vec![] }
    }

    /// Adds the integrals of `rates` as shared columns; `prior_std` is the prior deviation of their coefficients.
    pub(crate) fn with_shared(mut self, rates: &[&[f64]], prior_std: f64) -> Integral<'a> {
        self.shared = rates.iter().map(|v| (Integral::new(self.t, v), prior_std)).collect();
        self
    }

    #[inline]
    fn at(&self, k: usize, t: f64) -> (f64, f64) {
        let [sum, rate, half] = self.pieces[k];
        let h = t - self.t[k];
        (sum + h * (rate + half * h), rate + 2.0 * half * h)
    }
}

impl Reference for Integral<'_> {
    fn span(&self) -> (f64, f64) {
        ends(self.t)
    }

    fn value_and_rate(&self, t: f64) -> (f64, f64) {
        self.at(interval(self.t, t), t)
    }

    fn fill(&self, instants: &[f64], values: &mut [f64], rates: &mut [f64]) {
        let mut cursor = Cursor::default();
        for ((t, value), rate) in instants.iter().zip(values).zip(rates) {
            (*value, *rate) = self.at(cursor.interval(self.t, *t), *t);
        }
    }

    fn shared(&self) -> Vec<SharedColumn<'_>> {
        self.shared.iter().map(|(reference, prior_std)| SharedColumn { reference, prior_std: *prior_std }).collect()
    }
}

/// A track through its samples: cubic between two of them; the slope at each is that of the parabola through it and its
/// neighbours.
pub(crate) struct Interpolated<'a> {
    t: &'a [f64],
    y: &'a [f64],
    slope: Vec<f64>,
}

impl<'a> Interpolated<'a> {
    /// Through `y` at the rising times `t` (s); both of the same length and not empty.
    pub(crate) fn new(t: &'a [f64], y: &'a [f64]) -> Interpolated<'a> {
        let rise = |k: usize| (y[k + 1] - y[k]) / (t[k + 1] - t[k]);
        let last = t.len() - 1;
        let slope = |k: usize| match (k, last) {
            (_, 0) => 0.0,
            (0, _) => rise(0),
            (k, last) if k == last => rise(last - 1),
            (k, _) => {
                let (before, after) = (t[k] - t[k - 1], t[k + 1] - t[k]);
                (after * rise(k - 1) + before * rise(k)) / (before + after)
            }
        };
        Interpolated { t, y, slope: (0..t.len()).map(slope).collect() }
    }

    /// Its rate at each sample.
    pub(crate) fn slopes(&self) -> &[f64] {
        &self.slope
    }
}

impl Reference for Interpolated<'_> {
    fn span(&self) -> (f64, f64) {
        ends(self.t)
    }

    fn value_and_rate(&self, t: f64) -> (f64, f64) {
        self.at(interval(self.t, t), t)
    }

    fn fill(&self, instants: &[f64], values: &mut [f64], rates: &mut [f64]) {
        let mut cursor = Cursor::default();
        for ((t, value), rate) in instants.iter().zip(values).zip(rates) {
            (*value, *rate) = self.at(cursor.interval(self.t, *t), *t);
        }
    }
}

impl Interpolated<'_> {
    #[inline]
    fn at(&self, k: usize, t: f64) -> (f64, f64) {
        let Some(next) = self.t.get(k + 1) else { return (self.y[k], self.slope[k]) };
        let (h, s) = (next - self.t[k], t - self.t[k]);
        let rise = (self.y[k + 1] - self.y[k]) / h;
        let (a, b) = (self.slope[k] - rise, self.slope[k + 1] - rise);
        let u = s / h;
        let value = self.y[k] + s * rise + s * (1.0 - u) * (a * (1.0 - u) - b * u);
        let rate = rise + a * (1.0 - u) * (1.0 - 3.0 * u) + b * u * (3.0 * u - 2.0);
        (value, rate)
    }
}

fn ends(t: &[f64]) -> (f64, f64) {
    (t[0], t[t.len() - 1])
}

/// The interval `[t[k], t[k + 1])` that holds `at`; the first before all, the last knot after all. With even timestamps
/// the first guess is right.
fn interval(t: &[f64], at: f64) -> usize {
    let last = t.len() - 1;
    let (first, end) = ends(t);
    if at <= first || last == 0 {
        return 0;
    }
    if at >= end {
        return last;
    }
    let guess = (((at - first) / (end - first) * last as f64) as usize).min(last - 1);
    let holds = |k: usize| t[k] <= at && at < t[k + 1];
    let near = [guess, guess.saturating_sub(1), (guess + 1).min(last - 1)];
    near.into_iter().find(|&k| holds(k)).unwrap_or_else(|| t.partition_point(|&x| x <= at) - 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    const T: [f64; 6] = [0.0, 0.3, 0.31, 1.7, 2.0, 9.0];

    #[test]
    fn the_integral_of_a_straight_line_is_its_parabola() {
        let v = T.map(|t| 6.0 * t - 2.0);
        let integral = Integral::new(&T, &v);
        for t in [0.0, 0.1, 0.305, 1.0, 1.99, 5.0, 9.0] {
            let (value, rate) = integral.value_and_rate(t);
            assert!((value - (3.0 * t * t - 2.0 * t)).abs() < 1e-12 && (rate - (6.0 * t - 2.0)).abs() < 1e-12, "{t}");
        }
    }

    #[test]
    fn a_parabola_is_interpolated_exactly_inside_and_its_rate_is_continuous() {
        let y = T.map(|t| t * t - 3.0 * t);
        let track = Interpolated::new(&T, &y);
        for t in [0.3, 0.305, 0.9, 1.7, 1.9] {
            let (value, rate) = track.value_and_rate(t);
            assert!((value - (t * t - 3.0 * t)).abs() < 1e-12 && (rate - (2.0 * t - 3.0)).abs() < 1e-12, "{t}: {rate}");
        }
        for knot in [0.3, 0.31, 1.7, 2.0] {
            let (before, after) = (track.value_and_rate(knot - 1e-9).1, track.value_and_rate(knot + 1e-9).1);
            assert!((before - after).abs() < 1e-6, "{knot}");
        }
    }

    #[test]
    fn many_instants_at_once_match_single_ones() {
        let y = T.map(|t| (3.0 * t).sin());
        let (integral, track) = (Integral::new(&T, &y), Interpolated::new(&T, &y));
        let instants = [-1.0, 0.0, 0.2, 0.305, 0.31, 1.0, 1.9, 0.3, 8.0, 9.0, 10.0];
        for reference in [&integral as &dyn Reference, &track] {
            let (mut values, mut rates) = ([0.0; 11], [0.0; 11]);
            reference.fill(&instants, &mut values, &mut rates);
            for (k, t) in instants.iter().enumerate() {
                assert_eq!((values[k], rates[k]), reference.value_and_rate(*t), "{t}");
            }
        }
    }

    #[test]
    fn one_sample_is_a_constant() {
        assert_eq!(Integral::new(&[5.0], &[3.0]).value_and_rate(5.0), (0.0, 3.0));
        assert_eq!(Interpolated::new(&[5.0], &[3.0]).value_and_rate(5.0), (3.0, 0.0));
    }
}
