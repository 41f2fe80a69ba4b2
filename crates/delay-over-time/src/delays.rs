//! Delays of windows, corrected for flight-wide effects that resemble a delay (B S5 b, c).

use crate::windows::Window;

/// The variance of a window is at least this share of the median variance.
const LEAST_VARIANCE: f64 = 0.1;
/// Prior standard deviation of the two effects: speed later than direction, s; antenna ahead, m.
const PRIOR: [f64; 2] = [0.3, 1.0];
/// Degrees of freedom of the usual variance when it is combined with a window's own.
const USUAL_FREE: f64 = 20.0;
/// Limit on the ratio of a window's Bartlett sum of scores to the model's, in medians of all windows.
const MOST_RATIO: f64 = 3.0;
/// Standard uncertainties subtracted for the lower bound of an effect.
const LOWER: f64 = 2.0;

/// A value with its standard uncertainty.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Effect {
    pub(crate) size: f64,
    pub(crate) uncertainty: f64,
}

impl Effect {
    /// Whether it exceeds three standard uncertainties.
    pub(crate) fn is_significant(&self) -> bool {
        self.size.abs() > 3.0 * self.uncertainty
    }

    /// Absolute size less two standard uncertainties.
    pub(crate) fn lower_bound(&self) -> f64 {
        self.size.abs() - LOWER * self.uncertainty
    }
}

/// Windows corrected for what resembles a delay.
#[derive(Debug, Clone)]
pub(crate) struct Delays {
    /// For each window: its number, middle, delay and standard uncertainty.
    pub(crate) window: Vec<usize>,
    pub(crate) middle_s: Vec<f64>,
    pub(crate) delay_s: Vec<f64>,
    pub(crate) uncertainty_s: Vec<f64>,
    /// Speed later than direction, s; antenna ahead, m.
    pub(crate) speed_lag_s: Effect,
    pub(crate) lever_m: Effect,
    /// Mean delay without these two, unless they are significant (3 standard uncertainties).
    pub(crate) level: Effect,
    /// White noise of the position, m, and the inflation of variances by autocorrelation.
    pub(crate) white_m: f64,
    pub(crate) inflation: f64,
}

/// Removes the two effects that are common to the flight.
pub(crate) fn delays(windows: &[Window]) -> Option<Delays> {
    if windows.is_empty() {
        return None;
    }
    let mut variances: Vec<f64> = windows.iter().map(|w| w.variance).collect();
    let typical = signal::median_in_place(&mut variances)?;
    let inflation = inflation(windows);
    // A variance from few fixes is shrunk towards the usual one: windows that are good by chance get too much weight.
    let shrunk = |w: &Window| (w.free * w.variance + USUAL_FREE * typical) / (w.free + USUAL_FREE);
    let variance = |w: &Window| shrunk(w).max(LEAST_VARIANCE * typical).max(1e-12) * inflation;
    let (effects, c) = common(windows, &variance);
    let mut out = freed(windows, &variance, effects, c)?;
    out.white_m = typical.sqrt();
    out.inflation = inflation;
    Some(out)
}

/// Information of a window on the two effects: products of their columns without the delay's, and with the residual.
#[derive(Clone, Copy)]
struct Information {
    normal: [f64; 3],
    right: [f64; 2],
}

impl Information {
    fn plus(&self, other: &Information, sign: f64) -> Information {
        Information {
            normal: [0, 1, 2].map(|i| self.normal[i] + sign * other.normal[i]),
            right: [0, 1].map(|i| self.right[i] + sign * other.right[i]),
        }
    }

    /// Covariance and sizes.
    fn solved(&self) -> ([f64; 3], [f64; 2]) {
        let [a, b, d] = self.normal;
        let det = a * d - b * b;
        let c = [d / det, -b / det, a / det];
        (c, [c[0] * self.right[0] + c[1] * self.right[1], c[1] * self.right[0] + c[2] * self.right[1]])
    }
}

/// Speed later than direction and antenna ahead, with their covariance, widened if windows disagree. A window across a
/// step fits whichever effect resembles the step, with a small uncertainty (jackknife).
fn common(windows: &[Window], variance: &dyn Fn(&Window) -> f64) -> ([Effect; 2], [f64; 3]) {
    let of = |w: &Window| {
        let k = 1.0 / variance(w);
        let [d, ds, dl, ss, sl, ll] = w.products;
        let b = [ds / d, dl / d];
        Information {
            normal: [ss - b[0] * b[0] * d, sl - b[0] * b[1] * d, ll - b[1] * b[1] * d].map(|x| k * x),
            right: [0, 1].map(|i| k * (w.scores[i + 1] - b[i] * w.scores[0])),
        }
    };
    let all: Vec<Information> = windows.iter().map(of).collect();
    let prior = Information { normal: [PRIOR[0].powi(-2), 0.0, PRIOR[1].powi(-2)], right: [0.0; 2] };
    let sum = all.iter().fold(prior, |s, x| s.plus(x, 1.0));
    let (c, size) = sum.solved();
    let without: Vec<[f64; 2]> = all.iter().map(|x| sum.plus(x, -1.0).solved().1).collect();
    let n = windows.len() as f64;
    let widen = [0, 1].map(|i| {
        let mean = without.iter().map(|w| w[i]).sum::<f64>() / n;
        let jackknife = without.iter().map(|w| (w[i] - mean).powi(2)).sum::<f64>() * (n - 1.0) / n;
        (jackknife / c[2 * i]).max(1.0).sqrt()
    });
    let c = [c[0] * widen[0] * widen[0], c[1] * widen[0] * widen[1], c[2] * widen[1] * widen[1]];
    ([0, 1].map(|i| Effect { size: size[i], uncertainty: c[2 * i].sqrt() }), c)
}

/// Correlation of the scores: their Bartlett sums over those of the model, pooled. A window across a step counts at
/// most [`MOST_RATIO`] times the median, or it would widen all others.
fn inflation(windows: &[Window]) -> f64 {
    let modelled = |w: &Window| w.variance * w.information;
    let mut ratios: Vec<f64> =
        windows.iter().filter(|w| modelled(w) > 0.0).map(|w| w.score_variance / modelled(w)).collect();
    let Some(middle) = signal::median_in_place(&mut ratios) else { return 1.0 };
    let cut = |w: &Window| w.score_variance.min(MOST_RATIO * middle * modelled(w));
    // With its variance, the model's information of a window across a step is too large.
    let (scores, all) = windows.iter().fold((0.0, 0.0), |s, w| (s.0 + cut(w), s.1 + modelled(w)));
    if all > 0.0 { (scores / all).max(1.0) } else { 1.0 }
}

fn freed(
    windows: &[Window],
    variance: &dyn Fn(&Window) -> f64,
    [lag, lever]: [Effect; 2],
    covariance: [f64; 3],
) -> Option<Delays> {
    let own: Vec<f64> = windows.iter().map(|w| variance(w) / w.information).collect();
    let total: f64 = own.iter().map(|v| 1.0 / v).sum();
    let mean = [0, 1].map(|i| windows.iter().zip(&own).map(|(w, v)| along(w)[i] / v).sum::<f64>() / total);
    let sure = [lag, lever].map(|e| if e.is_significant() { e.size } else { 0.0 });
    let raw = windows.iter().zip(&own).map(|(w, v)| w.delay_s / v).sum::<f64>() / total;
    let level = raw - mean[0] * sure[0] - mean[1] * sure[1];
    // What was removed has an uncertainty of its own.
    let removed: f64 = (0..2).filter(|i| sure[*i] != 0.0).map(|i| mean[i] * mean[i] * covariance[2 * i]).sum();
    let (delay_s, uncertainty_s) = without_effects(windows, &own, mean, [lag, lever], covariance);
    let birge = birge_squared(&delay_s, &uncertainty_s);
    let finite = delay_s.iter().chain(&uncertainty_s).chain([&level, &total]).all(|x| x.is_finite());
    finite.then(|| Delays {
        window: (0..windows.len()).collect(),
        middle_s: windows.iter().map(|w| w.middle_s).collect(),
        delay_s,
        uncertainty_s,
        speed_lag_s: lag,
        lever_m: lever,
        level: Effect { size: level, uncertainty: (birge / total + removed).sqrt() },
        white_m: 0.0,
        inflation: 1.0,
    })
}

/// Square of Birge's ratio: windows that scatter more than expected widen the level.
fn birge_squared(delay_s: &[f64], uncertainty_s: &[f64]) -> f64 {
    let about = delay_s.iter().zip(uncertainty_s).map(|(d, u)| (1.0 / (u * u), *d)).collect::<Vec<_>>();
    let centre = about.iter().map(|a| a.0 * a.1).sum::<f64>() / about.iter().map(|a| a.0).sum::<f64>();
    let chi_squared: f64 = about.iter().map(|a| a.0 * (a.1 - centre).powi(2)).sum();
    (chi_squared / (delay_s.len() as f64 - 1.0).max(1.0)).max(1.0)
}

/// Delay and standard uncertainty of each window without the two effects. What all windows share is the level's.
fn without_effects(
    windows: &[Window],
    own: &[f64],
    mean: [f64; 2],
    [lag, lever]: [Effect; 2],
    covariance: [f64; 3],
) -> (Vec<f64>, Vec<f64>) {
    let of = |(w, v): (&Window, &f64)| {
        let b = along(w);
        let c = [b[0] - mean[0], b[1] - mean[1]];
        let shared = c[0] * c[0] * covariance[0] + 2.0 * c[0] * c[1] * covariance[1] + c[1] * c[1] * covariance[2];
        (w.delay_s - b[0] * lag.size - b[1] * lever.size, (v + shared).sqrt())
    };
    windows.iter().zip(own).map(of).unzip()
}

/// Apparent delay in a window per unit of each effect.
fn along(w: &Window) -> [f64; 2] {
    [w.products[1] / w.products[0], w.products[2] / w.products[0]]
}

impl Delays {
    /// Speed later than direction, s, and antenna ahead, m, if significant; else 0.
    pub(crate) fn sure_effects(&self) -> [f64; 2] {
        [self.speed_lag_s, self.lever_m].map(|e| if e.is_significant() { e.size } else { 0.0 })
    }

    /// The windows whose standard uncertainty is at most `limit_s`.
    pub(crate) fn known(&self, limit_s: f64) -> Delays {
        let rows: Vec<usize> = (0..self.delay_s.len()).filter(|k| self.uncertainty_s[*k] < limit_s).collect();
        self.rows(&rows)
    }

    pub(crate) fn without(&self, row: usize) -> Delays {
        let rows: Vec<usize> = (0..self.delay_s.len()).filter(|k| *k != row).collect();
        self.rows(&rows)
    }

    fn rows(&self, rows: &[usize]) -> Delays {
        let pick = |x: &[f64]| rows.iter().map(|k| x[*k]).collect();
        Delays {
            window: rows.iter().map(|k| self.window[*k]).collect(),
            middle_s: pick(&self.middle_s),
            delay_s: pick(&self.delay_s),
            uncertainty_s: pick(&self.uncertainty_s),
            ..self.clone()
        }
    }

    pub(crate) fn len(&self) -> usize {
        self.delay_s.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dense::Random;
    use nalgebra::{DMatrix, DVector};

    /// Ten windows with equal information on lag and lever; each asks for its `lag_s`.
    fn lag_of(lag_s: [f64; 10]) -> Effect {
        let window = |(k, lag): (usize, f64)| Window {
            from_s: 10.0 * k as f64,
            to_s: 10.0 * k as f64 + 10.0,
            middle_s: 10.0 * k as f64 + 5.0,
            delay_s: 0.2,
            information: 1e4,
            variance: 1.0,
            free: 95.0,
            score_variance: 1e4,
            speed_mps: 15.0,
            products: [1e4, 0.0, 0.0, 1e4, 0.0, 1.0],
            scores: [0.0, 1e4 * lag, 0.0],
        };
        let windows: Vec<Window> = lag_s.into_iter().enumerate().map(window).collect();
        delays(&windows).unwrap().speed_lag_s
    }

    #[test]
    fn an_effect_is_as_uncertain_as_the_windows_disagree() {
        // Information of 1e4 per s² from each of ten windows: 1 / √1e5 s.
        let agreed = lag_of([0.05; 10]);
        assert!((agreed.uncertainty - 1e-5f64.sqrt()).abs() < 1e-5 && agreed.is_significant(), "{agreed:?}");
        // One window asks for half a second and nine for zero: the mean is 50 ± 50 ms.
        let one = lag_of([0.0, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert!((one.size - 0.05).abs() < 1e-4 && (one.uncertainty - 0.05).abs() < 1e-3, "{one:?}");
        assert!(!one.is_significant());
    }

    /// A window from its columns (delay, lag, lever) and residuals, white with variance `variance`.
    fn window(k: usize, columns: &DMatrix<f64>, residual: &DVector<f64>, variance: f64) -> Window {
        let products = columns.transpose() * columns;
        let with = columns.transpose() * residual;
        let step = with[0] / products[(0, 0)];
        Window {
            from_s: 10.0 * k as f64,
            to_s: 10.0 * k as f64 + 10.0,
            middle_s: 10.0 * k as f64 + 5.0,
            delay_s: 0.2 + step,
            information: products[(0, 0)],
            variance,
            free: 40.0,
            score_variance: variance * products[(0, 0)],
            speed_mps: 15.0,
            products: [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|at| products[at]),
            scores: [0.0, with[1] - step * products[(0, 1)], with[2] - step * products[(0, 2)]],
        }
    }

    /// Nine windows of 30 rows that scatter about a delay of 0.2 s, with a speed 50 ms late and an antenna 0.4 m ahead.
    fn flight(seed: u64) -> (Vec<DMatrix<f64>>, Vec<DVector<f64>>, Vec<Window>) {
        let mut random = Random::new(seed);
        let columns: Vec<DMatrix<f64>> = (0..9)
            .map(|_| DMatrix::from_fn(30, 3, |_, c| [12.0, 9.0, 0.8][c] * (random.normal() + [0.0, 0.4, -0.3][c])))
            .collect();
        let effects = DVector::from_vec(vec![0.0, 0.05, 0.4]);
        let residuals: Vec<DVector<f64>> =
            columns.iter().map(|c| c * &effects + DVector::from_fn(30, |_, _| 0.5 * random.normal())).collect();
        let windows = columns.iter().zip(&residuals).enumerate().map(|(k, (c, r))| window(k, c, r, 0.25)).collect();
        (columns, residuals, windows)
    }

    /// One delay per window and the two effects that all share, with their prior: covariance and values from the joint
    /// normal equations.
    fn together(columns: &[DMatrix<f64>], residuals: &[DVector<f64>], variance: f64) -> (DMatrix<f64>, DVector<f64>) {
        let n = columns.len();
        let mut normal = DMatrix::zeros(n + 2, n + 2);
        let mut right = DVector::zeros(n + 2);
        for (k, (c, r)) in columns.iter().zip(residuals).enumerate() {
            let at = [k, n, n + 1];
            let (products, with) = (c.transpose() * c / variance, c.transpose() * r / variance);
            for i in 0..3 {
                right[at[i]] += with[i];
                for j in 0..3 {
                    normal[(at[i], at[j])] += products[(i, j)];
                }
            }
        }
        normal[(n, n)] += 1.0 / (0.3 * 0.3);
        normal[(n + 1, n + 1)] += 1.0;
        let covariance = normal.try_inverse().unwrap();
        let values = &covariance * right;
        (covariance, values)
    }

    #[test]
    fn effects_and_delays_match_a_joint_adjustment() {
        for seed in 0..4 {
            let (columns, residuals, windows) = flight(seed);
            let found = delays(&windows).unwrap();
            let (covariance, values) = together(&columns, &residuals, 0.25);
            assert!(
                (found.speed_lag_s.size - values[9]).abs() < 1e-9 && (found.lever_m.size - values[10]).abs() < 1e-9
            );
            for (k, delay_s) in found.delay_s.iter().enumerate() {
                assert!((delay_s - 0.2 - values[k]).abs() < 1e-9, "{k}");
            }
            // With each window left out, the jackknife only widens the covariance.
            for (i, effect) in [(9, found.speed_lag_s), (10, found.lever_m)] {
                let without = |k: usize| {
                    let rest = |x: usize| x != k;
                    let c: Vec<_> = (0..9).filter(|x| rest(*x)).map(|x| columns[x].clone()).collect();
                    let r: Vec<_> = (0..9).filter(|x| rest(*x)).map(|x| residuals[x].clone()).collect();
                    together(&c, &r, 0.25).1[i - 1]
                };
                let each: Vec<f64> = (0..9).map(without).collect();
                let mean = each.iter().sum::<f64>() / 9.0;
                let jackknife = each.iter().map(|e| (e - mean).powi(2)).sum::<f64>() * 8.0 / 9.0;
                let expected = jackknife.max(covariance[(i, i)]).sqrt();
                assert!((effect.uncertainty - expected).abs() < 1e-9, "{effect:?} {expected}");
            }
        }
    }

    /// Windows that agree on both effects: the covariance is that of the joint adjustment, and the part that all
    /// windows share belongs to the level.
    #[test]
    fn relative_uncertainties_of_windows_match_a_joint_adjustment() {
        let (columns, _, _) = flight(7);
        let nothing: Vec<DVector<f64>> = columns.iter().map(|_| DVector::zeros(30)).collect();
        let of = |(k, c): (usize, &DMatrix<f64>)| window(k, c, &nothing[k], 0.25);
        let windows: Vec<Window> = columns.iter().enumerate().map(of).collect();
        let found = delays(&windows).unwrap();
        let (covariance, _) = together(&columns, &nothing, 0.25);
        let effects = covariance.view((9, 9), (2, 2)).into_owned();
        let own: Vec<f64> = columns.iter().map(|c| 0.25 / c.column(0).norm_squared()).collect();
        let total: f64 = own.iter().map(|v| 1.0 / v).sum();
        let along = |k: usize| {
            let d = columns[k].column(0);
            DVector::from_vec([1, 2].map(|c| d.dot(&columns[k].column(c)) / d.norm_squared()).to_vec())
        };
        let mean = (0..9).map(|k| along(k) / own[k]).fold(DVector::zeros(2), |a, b| a + b) / total;
        for (k, u) in found.uncertainty_s.iter().enumerate() {
            let apart = along(k) - &mean;
            let expected = (own[k] + apart.dot(&(&effects * &apart))).sqrt();
            assert!((u - expected).abs() < 1e-9, "{k}: {u} {expected}");
        }
        assert!(
            (found.level.size - 0.2).abs() < 1e-12 && (found.level.uncertainty - total.recip().sqrt()).abs() < 1e-9
        );
    }

    /// Significant effects move the level: the apparent delay of a window is not all delay.
    #[test]
    fn significant_effects_are_removed_from_the_level() {
        let (columns, _, _) = flight(8);
        let effects = DVector::from_vec(vec![0.03, 0.2, 3.0]);
        let of = |(k, c): (usize, &DMatrix<f64>)| window(k, c, &(c * &effects), 0.25);
        let windows: Vec<Window> = columns.iter().enumerate().map(of).collect();
        let found = delays(&windows).unwrap();
        assert!(found.speed_lag_s.is_significant() && found.lever_m.is_significant());
        let [lag, lever] = found.sure_effects();
        assert!((lag - 0.2).abs() < 0.01 && (lever - 3.0).abs() < 0.05, "{lag} {lever}");
        assert!((found.level.size - 0.23).abs() < 0.01, "{:?}", found.level);
        assert!(found.delay_s.iter().all(|d| (d - 0.23).abs() < 0.01), "{:?}", found.delay_s);
    }

    /// Birge's ratio: windows that differ by ten times their uncertainty make the level ten times as uncertain.
    #[test]
    fn a_level_is_as_uncertain_as_its_windows_disagree() {
        let column = DMatrix::from_fn(30, 3, |i, c| if i % 3 == c { 10.0 } else { 0.0 });
        let level = |late: f64| {
            let sign = |k: usize| if k.is_multiple_of(2) { late } else { -late };
            let of = |k: usize| window(k, &column, &(column.column(0) * sign(k)), 1.0);
            delays(&(0..8).map(of).collect::<Vec<Window>>()).unwrap().level
        };
        // Ten rows of 10 m/s and 1 m of noise: the uncertainty of a window is 1 / √1000 s, of eight 1 / √8000 s.
        let u = 8000f64.sqrt().recip();
        assert!((level(0.01).uncertainty - u).abs() < 1e-9);
        let chi_squared = 8.0 * 0.3 * 0.3 * 1000.0;
        assert!((level(0.3).uncertainty - u * (chi_squared / 7.0f64).sqrt()).abs() < 1e-9);
    }

    /// Ten windows whose scores have twice the variance of white noise, and one across a step with a hundred times.
    #[test]
    fn correlated_scores_widen_but_a_single_window_does_not() {
        let column = DMatrix::from_fn(30, 3, |i, c| if i % 3 == c { 10.0 } else { 0.0 });
        let inflation = |ratio: &dyn Fn(usize) -> f64| {
            let of = |k: usize| {
                let w = window(k, &column, &DVector::zeros(30), 1.0);
                Window { score_variance: ratio(k) * w.score_variance, ..w }
            };
            delays(&(0..11).map(of).collect::<Vec<Window>>()).unwrap().inflation
        };
        assert!((inflation(&|_| 2.0) - 2.0).abs() < 1e-12);
        assert!((inflation(&|_| 0.5) - 1.0).abs() < 1e-12);
        assert!((inflation(&|k| if k == 4 { 100.0 } else { 2.0 }) - (10.0 * 2.0 + 3.0 * 2.0) / 11.0).abs() < 1e-12);
    }

    #[test]
    fn rows_keep_the_values_of_their_window() {
        let (.., windows) = flight(9);
        let mut all = delays(&windows).unwrap();
        all.uncertainty_s[3] = 0.5;
        all.uncertainty_s[6] = 0.25;
        let known = all.known(0.25);
        assert_eq!(known.window, [0, 1, 2, 4, 5, 7, 8]);
        assert_eq!((known.len(), all.len()), (7, 9));
        let again = known.without(3);
        assert_eq!(again.window, [0, 1, 2, 5, 7, 8]);
        for (row, k) in again.window.iter().enumerate() {
            let of = |d: &Delays, r: usize| [d.middle_s[r], d.delay_s[r], d.uncertainty_s[r]];
            assert_eq!(of(&again, row), of(&all, *k));
        }
        assert_eq!(again.level, all.level);
    }
}
