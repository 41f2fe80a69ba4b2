//! What a channel is compared with: the integral of a rate, or a track between its samples.

use signal::Reference;

/// `∫ v dτ` from the first sample, with `v` linear between samples: continuous with its derivative, exact, and as
/// symmetric in time as the samples are, so that interpolation shifts nothing.
pub(crate) struct Integral<'a> {
    t: &'a [f64],
    v: &'a [f64],
    sum: Vec<f64>,
}

impl<'a> Integral<'a> {
    /// Of `v` (unit/s) at the rising times `t` (s); both as long as each other and not empty.
    pub(crate) fn new(t: &'a [f64], v: &'a [f64]) -> Integral<'a> {
        let mut total = 0.0;
        let steps = t.windows(2).zip(v.windows(2)).map(|(t, v)| {
            total += 0.5 * (v[0] + v[1]) * (t[1] - t[0]);
            total
        });
        Integral { t, v, sum: std::iter::once(0.0).chain(steps).collect() }
    }
}

impl Reference for Integral<'_> {
    fn span(&self) -> (f64, f64) {
        ends(self.t)
    }

    fn value_and_rate(&self, t: f64) -> (f64, f64) {
        let k = interval(self.t, t);
        let h = t - self.t[k];
        match self.t.get(k + 1) {
            Some(next) => {
                let slope = (self.v[k + 1] - self.v[k]) / (next - self.t[k]);
                (self.sum[k] + h * (self.v[k] + 0.5 * slope * h), self.v[k] + slope * h)
            }
            None => (self.sum[k] + h * self.v[k], self.v[k]),
        }
    }
}

/// A track through its samples: cubic between two of them, the slope at each that of the parabola through it and its
/// neighbours.
pub(crate) struct Interpolated<'a> {
    t: &'a [f64],
    y: &'a [f64],
    slope: Vec<f64>,
}

impl<'a> Interpolated<'a> {
    /// Through `y` at the rising times `t` (s); both as long as each other and not empty.
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
}

impl Reference for Interpolated<'_> {
    fn span(&self) -> (f64, f64) {
        ends(self.t)
    }

    fn value_and_rate(&self, t: f64) -> (f64, f64) {
        let k = interval(self.t, t);
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

/// The interval `[t[k], t[k + 1])` that holds `at`; the first before all, the last knot after all. Even stamps are
/// found at once.
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
    fn one_sample_is_a_constant() {
        assert_eq!(Integral::new(&[5.0], &[3.0]).value_and_rate(5.0), (0.0, 3.0));
        assert_eq!(Interpolated::new(&[5.0], &[3.0]).value_and_rate(5.0), (3.0, 0.0));
    }
}
