//! The delay in windows just long enough to determine it.

use super::{ComponentFit, DelayFit, LEAST_SAMPLES};
use crate::whiten::Steps;

/// The delay in one window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DelayWindow {
    /// First timestamp, s.
    pub start_s: f64,
    /// Last timestamp, s.
    pub end_s: f64,
    /// Delay, s.
    pub delay_s: f64,
    /// Its standard uncertainty, s.
    pub standard_uncertainty_s: f64,
}

/// The delay in non-overlapping windows, starting at the first used row. Each is extended by one part in `tiles` of the
/// record until its delay is known to `aim_s` (standard uncertainty); the remainder at the end joins the last window.
/// Each window fits offset and drift; gain, shared columns and noise are those of the whole. It takes one Gauss–Newton
/// step from the delay of the whole, in one pass over the rows. Uncertainties are from the curvature, times the ratio
/// of the whole fit's uncertainty to its curvature's.
#[must_use]
pub fn delay_windows(fit: &DelayFit, aim_s: f64, tiles: usize) -> Vec<DelayWindow> {
    let stamps = || fit.components.iter().flat_map(|c| c.t_used.first().into_iter().chain(c.t_used.last()));
    let first = stamps().copied().fold(f64::INFINITY, f64::min);
    let last = stamps().copied().fold(f64::NEG_INFINITY, f64::max);
    if first >= last || tiles == 0 || fit.hessian_s.is_nan() || fit.hessian_s <= 0.0 {
        return vec![];
    }
    let border = |k: usize| if k >= tiles { f64::INFINITY } else { first + (last - first) * k as f64 / tiles as f64 };
    let inflation = fit.standard_uncertainty_s / fit.hessian_s;
    let mut out: Vec<(usize, DelayWindow)> = vec![];
    let mut from = 0;
    while from < tiles {
        let mut window = Window::new(fit, border(from));
        let known = (from + 1..=tiles).find_map(|to| {
            window.extend(fit, border(to));
            let found = window.delay(fit, inflation)?;
            (found.standard_uncertainty_s <= aim_s).then_some((to, found))
        });
        let Some((to, found)) = known else {
            if let Some((last_from, last)) = out.last_mut() {
                let mut window = Window::new(fit, border(*last_from));
                window.extend(fit, f64::INFINITY);
                *last = window.delay(fit, inflation).unwrap_or(*last);
            }
            break;
        };
        out.push((from, found));
        from = to;
    }
    out.into_iter().map(|w| w.1).collect()
}

/// Sums over the rows of a window.
struct Window {
    parts: Vec<Part>,
}

/// For one component: derivative by the delay, residual, offset and drift, whitened from the first row of the window
/// on.
struct Part {
    first: usize,
    next: usize,
    steps: Steps,
    wander: [f64; 4],
    gram: [[f64; 4]; 4],
    /// Whether any row of the fit is downweighted.
    weighted: bool,
}

const DELAY: usize = 0;
const RESIDUAL: usize = 1;
const OFFSET: usize = 2;
const DRIFT: usize = 3;

impl Window {
    fn new(fit: &DelayFit, from_s: f64) -> Window {
        let part = |c: &ComponentFit| {
            let first = c.t_used.partition_point(|t| *t < from_s);
            let weighted = c.weights.iter().any(|w| *w < 1.0);
            Part { first, next: first, steps: Steps::new(&c.noise), wander: [0.0; 4], gram: [[0.0; 4]; 4], weighted }
        };
        Window { parts: fit.components.iter().map(part).collect() }
    }

    /// Adds the rows before `to_s`.
    fn extend(&mut self, fit: &DelayFit, to_s: f64) {
        for (part, c) in self.parts.iter_mut().zip(&fit.components) {
            while let Some(t) = c.t_used.get(part.next).filter(|t| **t < to_s) {
                let k = part.next;
                let interval = c.t_used.get(k + 1).map_or(f64::INFINITY, |next| next - t);
                let step = part.steps.next(interval, part.weighted.then(|| c.weights[k]));
                let row = [-c.slope[k], c.residuals[k], 1.0, t - c.t_used[part.first]];
                let mut white = [0.0; 4];
                for (j, x) in row.iter().enumerate() {
                    let innovation = x - part.wander[j];
                    white[j] = innovation * step.weight;
                    part.wander[j] = step.decay * (part.wander[j] + step.gain * innovation);
                }
                for i in 0..4 {
                    for j in 0..=i {
                        part.gram[i][j] += white[i] * white[j];
                    }
                }
                part.next += 1;
            }
        }
    }

    /// The delay from the rows so far; `None` while they do not determine it.
    fn delay(&self, fit: &DelayFit, inflation: f64) -> Option<DelayWindow> {
        let (mut information, mut right) = (0.0, 0.0);
        let (mut start_s, mut end_s) = (f64::INFINITY, f64::NEG_INFINITY);
        for (part, c) in self.parts.iter().zip(&fit.components) {
            if part.next - part.first < LEAST_SAMPLES {
                continue;
            }
            let left = part.without_nuisances(c.drift.is_some());
            information += left[0];
            right += left[1];
            start_s = start_s.min(c.t_used[part.first]);
            end_s = end_s.max(c.t_used[part.next - 1]);
        }
        let standard_uncertainty_s = inflation / information.sqrt();
        (information > 0.0 && standard_uncertainty_s.is_finite()).then_some(DelayWindow {
            start_s,
            end_s,
            delay_s: fit.delay_s + right / information,
            standard_uncertainty_s,
        })
    }
}

impl Part {
    /// Σ d² and Σ d e with offset and drift removed.
    fn without_nuisances(&self, drift: bool) -> [f64; 2] {
        let half = &self.gram;
        let mut g: [[f64; 4]; 4] = std::array::from_fn(|i| std::array::from_fn(|j| half[i.max(j)][i.min(j)]));
        for pivot in [OFFSET, DRIFT].into_iter().take(1 + usize::from(drift)) {
            let (row, square) = (g[pivot], g[pivot][pivot]);
            if square <= 1e-12 * self.gram[pivot][pivot] || square <= 0.0 {
                continue;
            }
            for i in 0..4 {
                let share = row[i] / square;
                (0..4).for_each(|j| g[i][j] -= share * row[j]);
            }
        }
        [g[DELAY][DELAY].max(0.0), g[DELAY][RESIDUAL]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::delay::tests::swing;
    use crate::{DelaySettings, Gain, Measurement, NoiseRule, delay_by_segment, fit_delay};

    fn record(step_s: f64) -> (Vec<f64>, Vec<f64>) {
        let t: Vec<f64> = (0..600).map(|k| 3.0 + 0.1 * f64::from(k)).collect();
        let late = |t: f64| if t < 33.0 { 0.4 } else { 0.4 + step_s };
        let noise = |k: usize| 0.02 * (1.2345 * (k * k) as f64).sin();
        let y =
            t.iter().enumerate().map(|(k, t)| crate::Reference::value_and_rate(&swing(), t - late(*t)).0 + noise(k));
        let y = y.collect();
        (t, y)
    }

    fn fitted(t: &[f64], y: &[f64]) -> (DelayFit, Vec<DelayWindow>, Option<crate::SegmentDelay>) {
        let reference = swing();
        let measurement = [Measurement { t, y, reference: &reference, gain: Gain::Fixed(1.0), drift: true }];
        let settings = DelaySettings { noise: NoiseRule::White, ..DelaySettings::default() };
        let fit = fit_delay(&measurement, &settings).unwrap();
        let windows = delay_windows(&fit, 3.0 * fit.standard_uncertainty_s, 120);
        let length = windows.first().map_or(1.0, |w| w.end_s - w.start_s + 0.05);
        let segment = delay_by_segment(&measurement, &fit, length, 0.0).first().copied();
        (fit, windows, segment)
    }

    #[test]
    fn windows_are_as_long_as_needed_and_agree_with_a_fit_of_their_rows() {
        let (t, y) = record(0.0);
        let (fit, windows, segment) = fitted(&t, &y);
        assert!(windows.len() >= 3 && windows.windows(2).all(|w| w[0].end_s < w[1].start_s), "{windows:?}");
        assert_eq!((windows[0].start_s, windows[windows.len() - 1].end_s), (t[0], t[t.len() - 1]));
        for w in &windows {
            assert!(w.standard_uncertainty_s <= 3.0 * fit.standard_uncertainty_s);
            assert!((w.delay_s - 0.4).abs() < 4.0 * w.standard_uncertainty_s, "{w:?}");
        }
        let (first, segment) = (windows[0], segment.unwrap());
        assert!((first.standard_uncertainty_s / segment.standard_uncertainty_s - 1.0).abs() < 0.01, "{segment:?}");
        assert!((first.delay_s - segment.delay_s).abs() < 0.05 * first.standard_uncertainty_s, "{first:?} {segment:?}");
    }

    #[test]
    fn a_step_of_the_delay_shows_in_the_windows() {
        let (t, y) = record(0.03);
        let (_, windows, _) = fitted(&t, &y);
        let (first, last) = (windows[0].delay_s, windows[windows.len() - 1].delay_s);
        assert!((last - first - 0.03).abs() < 0.005, "{windows:?}");
    }

    #[test]
    fn no_rows_give_no_windows() {
        let (t, y) = record(0.0);
        let (fit, ..) = fitted(&t, &y);
        assert!(delay_windows(&DelayFit { components: vec![], ..fit.clone() }, 1.0, 10).is_empty());
        assert!(delay_windows(&fit, 1.0, 0).is_empty());
    }
}
