//! Models of the noise in residuals.

use crate::log_product::LogProduct;
use crate::minimise::{Lowest, Tolerance, nelder_mead};
use crate::projection::orthonormal;
use crate::whiten::NoiseModel;

/// What is known about the noise before a fit.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum NoiseRule {
    /// White; its size is estimated from the residuals.
    White,
    /// A wander (Ornstein–Uhlenbeck) plus white noise by restricted maximum likelihood; white only, unless the wander
    /// raises the log likelihood by two.
    #[default]
    WanderAndWhite,
    /// Known.
    Known(NoiseModel),
}

/// Increase of the log likelihood required to accept a wander: two more parameters (Akaike 1974).
const WORTH_A_WANDER: f64 = 2.0;
/// With fewer residuals a wander is not searched for.
const LEAST_FOR_A_WANDER: usize = 20;
/// Maximum number of columns of a [`NoiseProblem`], including the residual.
const MOST_COLUMNS: usize = 8;

/// Residuals and the regressors they come from, used to estimate the noise.
///
/// The restricted likelihood (Patterson and Thompson 1971) is that of the part that no regressor can explain. Its noise
/// parameters are not biased low by what the fit removed.
pub(crate) struct NoiseProblem {
    /// Row-major: orthonormal regressors, then the residual.
    rows: Vec<f64>,
    columns: usize,
    intervals: Intervals,
    /// Huber weights of the rows, and the share of a Gaussian's power that they keep.
    weights: Option<Vec<f64>>,
    kept_power: f64,
}

/// A restricted likelihood: half of −2 log, without constants, and the scale of the noise that maximizes it.
#[derive(Debug, Clone, Copy)]
struct Likelihood {
    minus_log: f64,
    scale: f64,
}

/// The noise that explains residuals best, including all parameters.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BestNoise {
    pub(crate) model: NoiseModel,
    pub(crate) minus_twice_log: f64,
    pub(crate) parameters: usize,
}

/// Start of a search in the plane of shapes: logarithms of the time constant (s) and of the ratio of the white variance
/// to the variance that the wander gains from one sample to the next.
type Shape = [f64; 2];

/// Search result, used as the next start.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NoiseFit {
    pub(crate) model: NoiseModel,
    /// End point of the search, even if white noise was as good.
    shape: Option<Shape>,
}

impl NoiseFit {
    /// A start from a noise: white as it is, a wander from the end point of a search.
    pub(crate) fn from_model(model: NoiseModel, t: &[f64]) -> NoiseFit {
        let shape = shape_at(&model, Intervals::of(t).median);
        NoiseFit { model, shape }
    }

    /// A noise that did not come from a search.
    pub(crate) fn given(model: NoiseModel) -> NoiseFit {
        NoiseFit { model, shape: None }
    }

    /// The same, with a standard deviation of at least `floor`.
    pub(crate) fn at_least(self, floor: f64) -> NoiseFit {
        if self.model.std() >= floor { self } else { NoiseFit::given(NoiseModel::white(floor)) }
    }
}

impl NoiseProblem {
    /// `regressors` are made orthonormal; linearly dependent ones are skipped. `weights` as in
    /// [`crate::whiten::WhiteningFilter::new`], with the share of a Gaussian's power that they keep.
    pub(crate) fn new(
        t: &[f64],
        regressors: &[Vec<f64>],
        residuals: &[f64],
        weights: Option<(&[f64], f64)>,
    ) -> NoiseProblem {
        let basis = orthonormal(&regressors[..regressors.len().min(MOST_COLUMNS - 1)]);
        let columns = basis.len() + 1;
        let rows = (0..t.len()).flat_map(|k| basis.iter().map(move |q| q[k]).chain([residuals[k]])).collect();
        NoiseProblem {
            rows,
            columns,
            intervals: Intervals::of(t),
            weights: weights.map(|w| w.0.to_vec()),
            kept_power: weights.map_or(1.0, |w| w.1),
        }
    }

    fn samples(&self) -> usize {
        self.rows.len() / self.columns
    }

    /// The best white noise.
    pub(crate) fn white(&self) -> NoiseFit {
        NoiseFit { model: NoiseModel::white(self.white_likelihood().scale), shape: None }
    }

    /// The best noise, starting at the end point of `before` if that was a wander. Otherwise, if there are many
    /// samples, every second, third, … one is searched first, and with `rough` only these.
    pub(crate) fn wander_and_white(&self, before: Option<&NoiseFit>, rough: bool) -> NoiseFit {
        let white = self.white_likelihood();
        let n = self.samples();
        if n < LEAST_FOR_A_WANDER.max(3 * self.columns) || white.scale <= 0.0 {
            return self.white();
        }
        let f = |shape: &Shape| self.likelihood(shape).map_or(f64::INFINITY, |l| l.minus_log);
        let before = before.and_then(|b| b.shape);
        let few = if before.is_none() { self.shape_of_few() } else { None };
        let lowest = match few.filter(|_| rough) {
            Some(at) => Lowest { at, value: f(&at) },
            None => self.search(f, before.or(few)),
        };
        match self.likelihood(&lowest.at) {
            Some(l) if l.minus_log < white.minus_log - WORTH_A_WANDER => {
                NoiseFit { model: self.model(&lowest.at, l.scale), shape: Some(lowest.at) }
            }
            _ => NoiseFit { shape: Some(lowest.at), ..self.white() },
        }
    }

    /// White, or wander and white, whichever has the lower Bayesian information criterion among `rows` samples. A rule
    /// without a choice applies directly. The search starts at `before` if that wanders. The likelihood is the plain
    /// one, regressors profiled out. `None` if the residuals are all zero.
    pub(crate) fn best_by_bic(&self, rule: &NoiseRule, rows: usize, before: &NoiseModel) -> Option<BestNoise> {
        let n = self.samples() as f64;
        if let NoiseRule::Known(model) = rule {
            let (gram, log_det) = self.known(model);
            let rss = gram.pivots(self.columns)?[self.columns - 1];
            return Some(BestNoise { model: *model, minus_twice_log: rss + log_det, parameters: 0 });
        }
        let plain = |gram: &Gram, log_det: f64| -> Option<Likelihood> {
            let variance = gram.pivots(self.columns)?[self.columns - 1] / (n * self.kept_power);
            Some(Likelihood { minus_log: 0.5 * (n * variance.ln() + n + log_det), scale: variance.sqrt() })
        };
        let (gram, log_det) = self.white_gram();
        let white = plain(&gram, log_det)?;
        let best =
            BestNoise { model: NoiseModel::white(white.scale), minus_twice_log: 2.0 * white.minus_log, parameters: 1 };
        if *rule == NoiseRule::White || n < LEAST_FOR_A_WANDER as f64 {
            return Some(best);
        }
        let of = |shape: &Shape| {
            let (gram, log_det) = self.wander_gram(shape)?;
            plain(&gram, log_det)
        };
        let search = |before: Option<Shape>| {
            let lowest = self.search(|shape| of(shape).map_or(f64::INFINITY, |l| l.minus_log), before);
            Some((lowest.at, of(&lowest.at)?))
        };
        // A wander far outside of this record has no likelihood here.
        let Some((shape, wander)) = search(self.shape_of(before)).or_else(|| search(None)) else { return Some(best) };
        let worth = 2.0 * (rows as f64).ln();
        if 2.0 * wander.minus_log + worth < best.minus_twice_log {
            let model = self.model(&shape, wander.scale);
            return Some(BestNoise { model, minus_twice_log: 2.0 * wander.minus_log, parameters: 3 });
        }
        Some(best)
    }

    /// The best shape on every n-th sample, for all samples; `None` if there are few samples or no wander.
    fn shape_of_few(&self) -> Option<Shape> {
        const FEW: usize = 800;
        let every = self.samples() / FEW;
        if every < 2 {
            return None;
        }
        let few = self.thinned(every);
        let f = |shape: &Shape| few.likelihood(shape).map_or(f64::INFINITY, |l| l.minus_log);
        let lowest = few.search(f, None);
        let scale = few.likelihood(&lowest.at)?.scale;
        self.shape_of(&few.model(&lowest.at, scale)).map(|[time, ratio]| [time, ratio.clamp(-13.0, 13.0)])
    }

    fn thinned(&self, every: usize) -> NoiseProblem {
        let rows = self.rows.chunks_exact(self.columns).step_by(every).flatten().copied().collect();
        let weights = self.weights.as_ref().map(|w| w.iter().step_by(every).copied().collect());
        let between: Vec<f64> = self.intervals.between.chunks_exact(every).map(|c| c.iter().sum()).collect();
        let intervals = Intervals::of_steps(between);
        NoiseProblem { rows, columns: self.columns, intervals, weights, kept_power: self.kept_power }
    }

    fn search(&self, mut f: impl FnMut(&Shape) -> f64, before: Option<Shape>) -> Lowest<2> {
        let (start, step) = match before {
            Some(shape) => (shape, [0.3, 0.3]),
            None => (self.coarse_search(&mut f), [0.8, 0.8]),
        };
        nelder_mead(f, start, step, &Tolerance { x: [0.15, 0.15], f: 5e-3, evaluations: 80 })
    }

    fn coarse_search(&self, mut f: impl FnMut(&Shape) -> f64) -> Shape {
        let (shortest, longest) = ((1.5 * self.intervals.median).ln(), (self.intervals.total / 3.0).ln());
        let mut lowest = Lowest { at: [shortest, 0.0], value: f64::INFINITY };
        for k in 0..5 {
            let log_time = shortest + (longest - shortest).max(0.0) * f64::from(k) / 4.0;
            for log_ratio in [-3.0, 1.0, 5.0, 8.0] {
                let at = [log_time, log_ratio];
                let value = f(&at);
                if value < lowest.value {
                    lowest = Lowest { at, value };
                }
            }
        }
        lowest.at
    }

    fn model(&self, shape: &Shape, scale: f64) -> NoiseModel {
        let time_constant_s = shape[0].exp();
        NoiseModel { wander_std: scale, time_constant_s, white_std: scale * self.white_variance(shape).sqrt() }
    }

    /// The shape that [`NoiseProblem::model`] converts to this; `None` without both parts.
    fn shape_of(&self, model: &NoiseModel) -> Option<Shape> {
        shape_at(model, self.intervals.median)
    }

    /// Ratio of the white variance to the wander's.
    fn white_variance(&self, shape: &Shape) -> f64 {
        -shape[1].exp() * (-2.0 * self.intervals.median / shape[0].exp()).exp_m1()
    }

    fn likelihood(&self, shape: &Shape) -> Option<Likelihood> {
        let (gram, log_det) = self.wander_gram(shape)?;
        self.restricted(&gram, log_det)
    }

    fn white_likelihood(&self) -> Likelihood {
        let (gram, log_det) = self.white_gram();
        self.restricted(&gram, log_det).unwrap_or(Likelihood { minus_log: f64::INFINITY, scale: 0.0 })
    }

    /// For rows whitened under a wander of variance 1; `None` outside the range resolved by the timestamps.
    fn wander_gram(&self, shape: &Shape) -> Option<(Gram, f64)> {
        let time_constant = shape[0].exp();
        let within = time_constant >= 0.2 * self.intervals.median
            && time_constant <= 20.0 * self.intervals.total
            && shape[1].abs() <= 14.0;
        within.then(|| self.whitened_gram(time_constant, self.white_variance(shape), 1.0))
    }

    /// For rows that are white with variance 1.
    fn white_gram(&self) -> (Gram, f64) {
        let log_det = -self.weights.iter().flatten().map(|w| w.ln()).sum::<f64>();
        (self.gram(|k| self.weights.as_ref().map_or(1.0, |w| w[k])), log_det)
    }

    /// For rows whitened under a known noise.
    fn known(&self, model: &NoiseModel) -> (Gram, f64) {
        let (wander, white) = (model.wander_std.powi(2), model.white_std.powi(2));
        self.whitened_gram(model.time_constant_s, white, wander)
    }

    /// The gram matrix of the unwhitened rows.
    fn gram(&self, weight: impl Fn(usize) -> f64) -> Gram {
        let p = self.columns;
        let mut gram = Gram::default();
        for (k, row) in self.rows.chunks_exact(p).enumerate() {
            for i in 0..p {
                for j in 0..=i {
                    gram.0[i][j] += weight(k) * row[i] * row[j];
                }
            }
        }
        gram
    }

    /// ½[(n − p) ln s² + ln |C| + ln |XᵀC⁻¹X|] with s² = RSS/(n − p), C the covariance at scale 1.
    fn restricted(&self, gram: &Gram, log_det: f64) -> Option<Likelihood> {
        let last = self.columns - 1;
        let free = self.samples().checked_sub(last).filter(|f| *f > 0)? as f64;
        let pivots = gram.pivots(self.columns)?;
        let variance = pivots[last] / (free * self.kept_power);
        let log_regressors: f64 = pivots[..last].iter().map(|p| p.ln()).sum();
        let minus_log = 0.5 * (free * variance.ln() + log_det + log_regressors);
        Some(Likelihood { minus_log, scale: variance.max(0.0).sqrt() })
    }

    fn whitened_gram(&self, time_constant: f64, white: f64, wander: f64) -> (Gram, f64) {
        match self.columns {
            1 => self.whitened_gram_of::<1>(time_constant, white, wander),
            2 => self.whitened_gram_of::<2>(time_constant, white, wander),
            3 => self.whitened_gram_of::<3>(time_constant, white, wander),
            4 => self.whitened_gram_of::<4>(time_constant, white, wander),
            5 => self.whitened_gram_of::<5>(time_constant, white, wander),
            6 => self.whitened_gram_of::<6>(time_constant, white, wander),
            7 => self.whitened_gram_of::<7>(time_constant, white, wander),
            _ => self.whitened_gram_of::<MOST_COLUMNS>(time_constant, white, wander),
        }
    }

    /// The gram matrix of the whitened rows, and the logarithm of the determinant, for a wander of this `variance`.
    fn whitened_gram_of<const P: usize>(&self, time_constant: f64, white: f64, variance: f64) -> (Gram, f64) {
        let mut gains = Gains::new(&self.intervals, self.weights.as_deref(), time_constant, white, variance);
        let mut sums = [[0.0; P]; P];
        let mut wander = [0.0; P];
        let mut log_det = LogProduct::default();
        let (rows, _) = self.rows.as_chunks::<P>();
        for (chunk, rows) in rows.chunks(CHUNK).enumerate() {
            // First the gains, which do not depend on the rows, then the rows, so that both loops stay in registers.
            let mut steps = [Step::default(); CHUNK];
            for (k, step) in steps[..rows.len()].iter_mut().enumerate() {
                *step = gains.at(chunk * CHUNK + k);
            }
            for (row, step) in rows.iter().zip(&steps) {
                log_det.times(step.inverse);
                let mut scaled = [0.0; P];
                let mut innovation = [0.0; P];
                for j in 0..P {
                    innovation[j] = row[j] - step.decay * wander[j];
                    scaled[j] = step.inverse * innovation[j];
                    wander[j] = step.decay * wander[j] + step.gain * innovation[j];
                }
                for i in 0..P {
                    for j in 0..=i {
                        sums[i][j] += scaled[i] * innovation[j];
                    }
                }
            }
        }
        let mut gram = Gram::default();
        for (row, sums) in gram.0.iter_mut().zip(&sums) {
            row[..P].copy_from_slice(sums);
        }
        (gram, -log_det.sum())
    }
}

/// The shape of a noise at timestamps `median_s` apart; `None` without both parts.
fn shape_at(model: &NoiseModel, median_s: f64) -> Option<Shape> {
    let ratio = (model.white_std / model.wander_std).powi(2);
    let gained = -(-2.0 * median_s / model.time_constant_s).exp_m1();
    let shape = [model.time_constant_s.ln(), (ratio / gained).ln()];
    shape.iter().all(|x| x.is_finite()).then_some(shape)
}

/// Number of rows whose gains are computed together.
const CHUNK: usize = 64;

/// State of the filter at one sample.
#[derive(Debug, Clone, Copy, Default)]
struct Step {
    /// Decay of the wander since the previous sample.
    decay: f64,
    /// Share of the innovation that is wander.
    gain: f64,
    /// Weight divided by the variance of the innovation.
    inverse: f64,
}

/// The gains of the whitening filter, sample by sample, as in [`crate::whiten::WhiteningFilter`].
///
/// The unknown variance of the wander is kept as a fraction, so that no division waits for the previous one. During
/// equal intervals the gain converges; once its last digits no longer change it is reused.
struct Gains<'a> {
    intervals: &'a Intervals,
    weights: Option<&'a [f64]>,
    time_constant: f64,
    decays: [f64; MOST_KINDS],
    white: f64,
    variance: f64,
    /// Variance of the wander before the sample, as numerator and denominator.
    fraction: (f64, f64),
    last: Step,
    steady: bool,
}

impl<'a> Gains<'a> {
    fn new(
        intervals: &'a Intervals,
        weights: Option<&'a [f64]>,
        time_constant: f64,
        white: f64,
        variance: f64,
    ) -> Gains<'a> {
        let decays = intervals.decays(time_constant);
        let (fraction, last, steady) = ((variance, 1.0), Step::default(), false);
        Gains { intervals, weights, time_constant, decays, white, variance, fraction, last, steady }
    }

    /// The step of sample `k`; must be called in order.
    #[inline(always)]
    fn at(&mut self, k: usize) -> Step {
        let (decay, same) = self.intervals.decay_before(k, self.time_constant, &self.decays);
        if self.steady && same {
            return self.last;
        }
        let next = match self.weights {
            None => self.step(k, decay),
            Some(weights) => self.weighted_step(k, decay, weights[k]),
        };
        self.steady = same
            && self.weights.is_none()
            && (next.gain - self.last.gain).abs() <= 1e-15 * next.gain
            && (next.inverse - self.last.inverse).abs() <= 1e-15 * next.inverse;
        self.last = next;
        next
    }

    #[inline(always)]
    fn step(&mut self, k: usize, decay: f64) -> Step {
        if k > 0 {
            let (known, one) = self.fraction;
            let square = decay * decay;
            let innovation = known + self.white * one;
            self.fraction = (square * self.white * known + self.variance * (1.0 - square) * innovation, innovation);
            if k.is_multiple_of(8) {
                self.fraction = (self.fraction.0 / self.fraction.1, 1.0);
            }
        }
        let (known, one) = self.fraction;
        let inverse = 1.0 / (known + self.white * one);
        Step { decay, gain: known * inverse, inverse: one * inverse }
    }

    fn weighted_step(&mut self, k: usize, decay: f64, weight: f64) -> Step {
        if k > 0 {
            let left = (1.0 - self.last.gain) * self.fraction.0;
            self.fraction.0 = self.variance + decay * decay * (left - self.variance);
        }
        let inverse = weight / (self.fraction.0 + self.white);
        Step { decay, gain: self.fraction.0 * inverse, inverse }
    }
}

/// Lower triangle of XᵀX.
#[derive(Default)]
struct Gram([[f64; MOST_COLUMNS]; MOST_COLUMNS]);

impl Gram {
    /// Squares of the diagonal of the Cholesky factor of the first `p` rows and columns: the last one is the remainder
    /// of the last column after regression on the others. `None` if the matrix is not positive definite.
    fn pivots(&self, p: usize) -> Option<[f64; MOST_COLUMNS]> {
        let mut factor = self.0;
        let mut pivots = [0.0; MOST_COLUMNS];
        for j in 0..p {
            let pivot = factor[j][j] - (0..j).map(|k| factor[j][k] * factor[j][k]).sum::<f64>();
            if pivot.is_nan() || pivot <= 0.0 {
                return None;
            }
            pivots[j] = pivot;
            let root = pivot.sqrt();
            for i in j + 1..p {
                let dot: f64 = (0..j).map(|k| factor[i][k] * factor[j][k]).sum();
                factor[i][j] = (factor[i][j] - dot) / root;
            }
        }
        Some(pivots)
    }
}

/// The intervals between timestamps; recurring ones (within a millionth) are identified by number.
struct Intervals {
    between: Vec<f64>,
    kinds: Vec<u8>,
    common: Vec<f64>,
    median: f64,
    total: f64,
}

/// An interval that does not recur.
const UNIQUE: u8 = u8::MAX;
const MOST_KINDS: usize = 12;

impl Intervals {
    fn of(t: &[f64]) -> Intervals {
        Intervals::of_steps(t.windows(2).map(|w| w[1] - w[0]).collect())
    }

    fn of_steps(between: Vec<f64>) -> Intervals {
        let median = crate::median_by_selection(&between).unwrap_or(1.0);
        let mut common: Vec<f64> = vec![];
        let kinds = between.iter().map(|dt| kind_of(*dt, &mut common)).collect();
        let total = between.iter().sum::<f64>().max(median);
        Intervals { between, kinds, common, median, total }
    }

    fn decays(&self, time_constant: f64) -> [f64; MOST_KINDS] {
        std::array::from_fn(|k| self.common.get(k).map_or(0.0, |dt| (-dt / time_constant).exp()))
    }

    /// Decay over the interval that ends at sample `k`, and whether the previous interval was the same.
    #[inline]
    fn decay_before(&self, k: usize, time_constant: f64, decays: &[f64; MOST_KINDS]) -> (f64, bool) {
        let Some(last) = k.checked_sub(1) else { return (1.0, false) };
        match self.kinds[last] {
            UNIQUE => (decay(self.between[last] / time_constant), false),
            kind => (decays[usize::from(kind)], last > 0 && self.kinds[last - 1] == kind),
        }
    }
}

fn kind_of(dt: f64, common: &mut Vec<f64>) -> u8 {
    match common.iter().position(|c| (dt - c).abs() <= 1e-6 * c) {
        Some(kind) => kind as u8,
        None if common.len() < MOST_KINDS => {
            common.push(dt);
            (common.len() - 1) as u8
        }
        None => UNIQUE,
    }
}

/// e^{−x}, by its series where that is exact to rounding.
#[inline]
fn decay(x: f64) -> f64 {
    if x < 0.03 {
        let late = 1.0 / 120.0 - x * (1.0 / 720.0 - x * (1.0 / 5040.0 - x / 40320.0));
        1.0 - x * (1.0 - x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0 - x * late))))
    } else {
        (-x).exp()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::whiten::WhiteningFilter;

    fn stamps(jitter: f64) -> Vec<f64> {
        (0..900).map(|k| 0.02 * (f64::from(k) + jitter * (1.7 * f64::from(k * k)).sin()) + f64::from(k / 300)).collect()
    }

    /// Compares the fraction, the steady state and the series for the decay with a filter that uses none of them.
    #[test]
    fn the_gram_matrix_is_that_of_the_whitened_columns() {
        for (jitter, weighted) in [(0.0, false), (0.3, false), (0.3, true)] {
            let t = stamps(jitter);
            let column = |f: f64| -> Vec<f64> { t.iter().map(|t| (f * t * t).sin() + 0.1).collect() };
            let weights: Vec<f64> = (0..t.len()).map(|k| if k % 7 == 0 { 0.3 } else { 1.0 }).collect();
            let weights = weighted.then_some(weights.as_slice());
            let problem = NoiseProblem::new(&t, &[], &column(0.3), weights.map(|w| (w, 1.0)));
            for (time_constant_s, white_std) in [(0.05, 0.4), (3.0, 0.02), (3.0, 0.0), (200.0, 5.0)] {
                let noise = NoiseModel { wander_std: 0.7, time_constant_s, white_std };
                let filter = WhiteningFilter::new(&t, &noise, weights);
                let mut whitened = column(0.3);
                filter.apply([&mut whitened]);
                let (gram, log_det) = problem.known(&noise);
                let expected = crate::projection::sum_of_squares(&whitened);
                assert!((gram.0[0][0] / expected - 1.0).abs() < 1e-11, "{} {expected}", gram.0[0][0]);
                assert!((log_det - filter.log_det).abs() < 1e-9 * log_det.abs().max(1.0));
            }
        }
    }

    #[test]
    fn a_shape_and_its_model_are_the_same() {
        let t = stamps(0.2);
        let problem = NoiseProblem::new(&t, &[], &t, None);
        let shape = [0.7, -1.2];
        let back = problem.shape_of(&problem.model(&shape, 0.3)).unwrap();
        assert!((back[0] - shape[0]).abs() < 1e-12 && (back[1] - shape[1]).abs() < 1e-12);
    }
}
