//! Alternates between delay and noise until both converge.

use super::block::{Block, Lateness, Normal, Projection, nuisance_columns};
use super::descent::{Alignment, Descent};
use super::search::{self, Scan};
use super::shape::Shape;
use super::uncertainty::{Conditions, Uncertainties, uncertainties};
use super::{
    ComponentFit, DelayError, DelayFit, DelaySettings, DelayStart, FoundNoise, Gain, LEAST_SAMPLES, Measurement,
    OtherMinimum, Uncertain,
};
use crate::noise::{NoiseFit, NoiseProblem, NoiseRule};
use crate::projection::{dot, orthonormal, residuals_of};
use crate::whiten::{NoiseModel, WhiteningFilter};

/// Huber's constant: 95 % as efficient as least squares without outliers.
pub(crate) const HUBER: f64 = 1.345;
/// Share of a Gaussian's power that Huber's weights keep: E min(z², k|z|) = 2Φ(k) − 1.
pub(crate) const KEPT_POWER: f64 = 0.821_374;
/// Whitened residuals are checked for outliers above this kurtosis or this size.
const WILD_KURTOSIS: f64 = 4.0;
const WILD_RESIDUAL: f64 = 6.0;
const MOST_ROUNDS: usize = 6;
/// Change between two rounds that counts as converged, in standard uncertainties.
const STEADY: f64 = 0.01;

/// Current state of the fit.
struct State {
    at: Lateness,
    noise: Vec<NoiseFit>,
    /// Huber weights by row of each measurement, once outliers have been detected.
    weights: Option<Vec<Vec<f64>>>,
}

struct Fitting<'a> {
    measurements: &'a [Measurement<'a>],
    settings: &'a DelaySettings,
    /// Smallest usable standard deviation of the noise of each component in floating point.
    floors: Vec<f64>,
    middle_s: f64,
    /// The noise stays at its start value.
    keep_noise: bool,
}

/// If `revise` returns a noise, the fit ends with that one.
pub(crate) fn fit(
    measurements: &[Measurement],
    settings: &DelaySettings,
    revise: impl Fn(&[FoundNoise]) -> Option<Vec<NoiseModel>>,
) -> Result<DelayFit, DelayError> {
    let delays = search::delays(settings)?;
    let (from_s, to_s) = (delays[0], delays[delays.len() - 1]);
    let unknown = search::scan(measurements, &delays, None, (0.0, 0.0))?;
    let start = unknown.lowest().filter(|_| unknown.follows).ok_or(DelayError::DoesNotFollow { from_s, to_s })?;
    let first = Lateness { delay_s: start, skew: 0.0 };
    let fitting = Fitting::about(measurements, settings, &first);
    let state = State { at: first, noise: fitting.first_noise(&first)?, weights: None };
    let mut found = fitting.from(state, Some(&delays), unknown)?;
    if let Some(better) = found.second.filter(|s| s.excess < 0.0) {
        let at = Lateness { delay_s: better.delay_s, ..found.descent.at };
        let state = State { at, noise: fitting.first_noise(&at)?, weights: None };
        found = fitting.from(state, None, found.scan.clone())?;
    }
    let noise = found.state.noise.iter().zip(&found.alignment.blocks);
    let noise: Vec<FoundNoise> = noise.map(|(n, b)| FoundNoise { model: n.model, t_used: &b.t }).collect();
    if let Some(noise) = revise(&noise) {
        let start = DelayStart { delay_s: found.descent.at.delay_s, noise, keep_noise: true };
        return Ok(DelayFit { second_minimum: found.second, ..fit_near(measurements, settings, &start)? });
    }
    fitting.report(found).ok_or(DelayError::NoExcitation)
}

/// [`fit`] from an approximate delay, without a search.
pub(crate) fn fit_near(
    measurements: &[Measurement],
    settings: &DelaySettings,
    start: &DelayStart,
) -> Result<DelayFit, DelayError> {
    let first = Lateness { delay_s: start.delay_s, skew: 0.0 };
    let mut fitting = Fitting::about(measurements, settings, &first);
    let noise = measurements.iter().zip(&start.noise).map(|(m, noise)| NoiseFit::from_model(*noise, m.t));
    let noise: Vec<NoiseFit> = noise.zip(&fitting.floors).map(|(noise, floor)| noise.at_least(*floor)).collect();
    if noise.len() < measurements.len() {
        return Err(DelayError::NoComponent);
    }
    fitting.keep_noise = start.keep_noise;
    let found = fitting.from(State { at: first, noise, weights: None }, None, Scan::none())?;
    fitting.report(found).ok_or(DelayError::NoExcitation)
}

/// Result after the last round.
struct Found<'a> {
    alignment: Alignment<'a>,
    state: State,
    descent: Descent,
    steps: usize,
    scan: Scan,
    second: Option<OtherMinimum>,
}

/// Everything after the last round.
struct End<'a> {
    alignment: Alignment<'a>,
    state: State,
    descent: Descent,
    steps: usize,
    scan: Scan,
}

impl<'a> Fitting<'a> {
    fn about(measurements: &'a [Measurement<'a>], settings: &'a DelaySettings, first: &Lateness) -> Fitting<'a> {
        let middle_s = middle_of(measurements, first, settings.search_step_s);
        let floors = measurements.iter().map(floor_of).collect();
        Fitting { measurements, settings, floors, middle_s, keep_noise: false }
    }

    /// Alternates delay and noise from `state`. With `relocate`, the best of these delays (s) is searched for again
    /// once the noise is known.
    fn from(&self, mut state: State, mut relocate: Option<&[f64]>, mut scan: Scan) -> Result<Found<'a>, DelayError> {
        let mut steps = 0;
        let mut guard_s = self.settings.search_step_s;
        let mut round = 0;
        loop {
            round += 1;
            let mut alignment = self.align(&state, guard_s)?;
            let descent = alignment.descend(state.at, 1e-3).ok_or(DelayError::NoExcitation)?;
            steps += descent.steps;
            let moved = (descent.at.delay_s - state.at.delay_s).abs();
            let steady = round > 1 && moved < STEADY * descent.hessian_s;
            state.at = descent.at;
            guard_s = (2.0 * moved).min(guard_s);
            if steady || round == MOST_ROUNDS {
                let end = End { alignment, state, descent, steps, scan };
                return self.finish(end, true);
            }
            self.update_noise(&mut state, &alignment, &descent, round == 1);
            if self.keep_noise && state.weights.is_none() && moved < self.settings.search_step_s {
                // Neither noise nor weights changed: another round would repeat this one.
                let end = End { alignment, state, descent, steps, scan };
                return self.finish(end, false);
            }
            if state.noise.iter().any(|n| n.model.wander_std > 0.0)
                && let Some(delays) = relocate.take()
            {
                scan = self.scan_again(&state, delays)?;
                if let Some(other) = self.elsewhere(&scan, state.at.delay_s, guard_s) {
                    state.at.delay_s = other;
                    guard_s = self.settings.search_step_s;
                }
            }
        }
    }

    /// The scan under the fitted noise and skew.
    fn scan_again(&self, state: &State, delays: &[f64]) -> Result<Scan, DelayError> {
        let models: Vec<NoiseModel> = state.noise.iter().map(|n| n.model).collect();
        search::scan(self.measurements, delays, Some(&models), (state.at.skew, self.middle_s))
    }

    /// The lowest delay of the scan, if it is not near the fitted one.
    fn elsewhere(&self, scan: &Scan, delay_s: f64, guard_s: f64) -> Option<f64> {
        let apart = 3.0 * guard_s.max(self.settings.search_step_s);
        scan.lowest().filter(|d| (d - delay_s).abs() > apart)
    }

    /// Descends to the minimum; with `rivals` also to the other minimum.
    fn finish(&self, end: End<'a>, rivals: bool) -> Result<Found<'a>, DelayError> {
        let End { mut alignment, mut state, descent, steps, scan } = end;
        let descent = alignment.descend_further(descent, 1e-9).ok_or(DelayError::NoExcitation)?;
        let steps = steps + descent.steps;
        state.at = descent.at;
        let second = if rivals { self.second_minimum(&state, &scan, &descent) } else { None };
        Ok(Found { alignment, state, descent, steps, scan, second })
    }

    fn curved(&self) -> usize {
        if self.settings.skew { 2 } else { 1 }
    }

    /// The rows whose true instant is within the reference, `guard_s` from its ends, under the noise of `state`.
    fn align(&self, state: &State, guard_s: f64) -> Result<Alignment<'a>, DelayError> {
        let models: Vec<NoiseModel> = state.noise.iter().map(|n| n.model).collect();
        let rows = self.rows(&state.at, guard_s)?;
        Ok(self.align_rows(rows, &models, state.weights.as_deref()))
    }

    fn rows(&self, at: &Lateness, guard_s: f64) -> Result<Vec<Vec<usize>>, DelayError> {
        let of = |(component, m): (usize, &Measurement)| {
            let rows = rows_within(m, at, self.middle_s, guard_s);
            match rows.len() {
                samples if samples < LEAST_SAMPLES => {
                    Err(DelayError::TooFewSamples { component, samples, of: m.t.len(), needed: LEAST_SAMPLES })
                }
                _ => Ok(rows),
            }
        };
        self.measurements.iter().enumerate().map(of).collect()
    }

    fn align_rows(&self, rows: Vec<Vec<usize>>, models: &[NoiseModel], weights: Option<&[Vec<f64>]>) -> Alignment<'a> {
        let block = |(c, rows): (usize, Vec<usize>)| {
            let weights: Option<Vec<f64>> = weights.map(|w| rows.iter().map(|&k| w[c][k]).collect());
            Block::new(&self.measurements[c], rows, &models[c], weights.as_deref(), self.curved())
        };
        let blocks = rows.into_iter().enumerate().map(block).collect();
        Alignment { measurements: self.measurements, blocks, middle_s: self.middle_s }
    }

    /// White noise with the standard deviation of the residuals at the first delay.
    fn first_noise(&self, at: &Lateness) -> Result<Vec<NoiseFit>, DelayError> {
        let unit = vec![NoiseModel::white(1.0); self.measurements.len()];
        let mut alignment = self.align_rows(self.rows(at, self.settings.search_step_s)?, &unit, None);
        let normal = alignment.normal(at);
        let size = |(c, p): (usize, &Projection)| {
            let block = &alignment.blocks[c];
            let free = block.t.len().saturating_sub(block.linear_parameters() + 1).max(1);
            NoiseFit::given(NoiseModel::white((p.rss / free as f64).sqrt().max(self.floors[c])))
        };
        Ok(normal.projections.iter().enumerate().map(size).collect())
    }

    fn update_noise(&self, state: &mut State, alignment: &Alignment, descent: &Descent, rough: bool) {
        for c in 0..self.measurements.len() {
            let weighted = state.weights.as_ref().is_some_and(|w| w[c].iter().any(|w| *w < 1.0));
            let raw = Raw::of(alignment, c, &descent.at, &descent.normal);
            if !weighted {
                self.update_noise_of(c, state, (alignment, &raw), rough);
            }
            if self.settings.robust && self.update_weights_of(c, state, alignment, &raw) {
                self.update_noise_of(c, state, (alignment, &raw), rough);
            }
        }
    }

    /// With `rough` the wander is searched for on few samples only.
    fn update_noise_of(&self, c: usize, state: &mut State, (alignment, raw): (&Alignment, &Raw), rough: bool) {
        if self.keep_noise {
            return;
        }
        if let NoiseRule::Known(model) = self.settings.noise {
            state.noise[c] = NoiseFit::given(model);
            return;
        }
        let block = &alignment.blocks[c];
        let regressors = raw.regressors(alignment, c);
        let weights: Option<Vec<f64>> = state.weights.as_ref().map(|w| block.rows.iter().map(|&k| w[c][k]).collect());
        let weights = weights.as_deref().map(|w| (w, KEPT_POWER));
        let problem = NoiseProblem::new(&block.t, &regressors, &raw.residuals, weights);
        let fit = match self.settings.noise {
            NoiseRule::WanderAndWhite => problem.wander_and_white(Some(&state.noise[c]), rough),
            _ => problem.white(),
        };
        state.noise[c] = fit.at_least(self.floors[c]);
    }

    /// Huber weights of the rows of component `c` under the noise of `state`; whether any is below 1.
    fn update_weights_of(&self, c: usize, state: &mut State, alignment: &Alignment, raw: &Raw) -> bool {
        let block = &alignment.blocks[c];
        let before: Option<Vec<f64>> = state.weights.as_ref().map(|w| block.rows.iter().map(|&k| w[c][k]).collect());
        let mut z = whitened_residuals(alignment, c, &raw.residuals, &state.noise[c].model, before.as_deref());
        if let Some(weights) = &before {
            z.iter_mut().zip(weights).for_each(|(z, w)| *z /= w.sqrt());
        }
        let wild = z.iter().any(|z| z.abs() > WILD_RESIDUAL) || crate::kurtosis(&z).is_some_and(|k| k > WILD_KURTOSIS);
        let held_back_before = before.as_ref().is_some_and(|w| w.iter().any(|w| *w < 1.0));
        if !wild && !held_back_before {
            return false;
        }
        let all = state.weights.get_or_insert_with(|| self.measurements.iter().map(|m| vec![1.0; m.t.len()]).collect());
        for (&row, z) in block.rows.iter().zip(&z) {
            all[c][row] = (HUBER / z.abs()).min(1.0);
        }
        true
    }

    /// The lowest other minimum of the scan, refined, against the best on the same rows.
    fn second_minimum(&self, state: &State, scan: &Scan, best: &Descent) -> Option<OtherMinimum> {
        let apart = (3.0 * best.hessian_s).max(2.0 * self.settings.search_step_s);
        let (start, _) = scan.minima().into_iter().find(|m| (m.0 - best.at.delay_s).abs() > apart)?;
        let there = Lateness { delay_s: start, ..best.at };
        let guard_s = self.settings.search_step_s;
        let here: Vec<Vec<usize>> = self.rows(&best.at, guard_s).ok()?;
        let rows = self.rows(&there, guard_s).ok()?;
        let common = |(a, b): (Vec<usize>, &Vec<usize>)| a.into_iter().filter(|k| b.binary_search(k).is_ok()).collect();
        let rows: Vec<Vec<usize>> = rows.into_iter().zip(&here).map(common).collect();
        if rows.iter().any(|r| r.len() < LEAST_SAMPLES) {
            return None;
        }
        let models: Vec<NoiseModel> = state.noise.iter().map(|n| n.model).collect();
        let mut alignment = self.align_rows(rows, &models, state.weights.as_deref());
        let other = alignment.descend(there, 1e-2)?;
        let excess = other.normal.rss - alignment.normal(&best.at).rss;
        let same = (other.at.delay_s - best.at.delay_s).abs() < apart;
        (!same && other.converged && other.normal.follows())
            .then_some(OtherMinimum { delay_s: other.at.delay_s, excess })
    }

    fn report(&self, found: Found) -> Option<DelayFit> {
        let Found { alignment, state, descent, steps, second, .. } = found;
        let weights: Option<Vec<Vec<f64>>> = state.weights.as_ref().map(|all| of_rows(all, &alignment.blocks));
        let conditions = Conditions {
            weights: weights.as_deref(),
            known_scale: self.keep_noise || matches!(self.settings.noise, NoiseRule::Known(_)),
            textbook_lags: None,
        };
        let sure = uncertainties(&alignment, &descent.at, &descent.normal, &conditions)?;
        let component = |c: usize| {
            let weights = weights.as_ref().map(|w| w[c].as_slice());
            component_fit(&alignment, c, &descent, &state.noise[c].model, weights, &sure)
        };
        let shared = |(k, value): (usize, &f64)| sure.with(*value, sure.first_shared + k);
        Some(DelayFit {
            delay_s: descent.at.delay_s,
            hessian_s: sure.hessian[0],
            hac_s: sure.hac[0],
            standard_uncertainty_s: sure.of(0),
            degrees_of_freedom: sure.degrees_of_freedom,
            hac_lags: sure.lags,
            shared: descent.normal.shared.iter().enumerate().map(shared).collect(),
            skew: self.settings.skew.then(|| sure.with(descent.at.skew, 1)),
            middle_s: self.middle_s,
            crlb_s: sure.crlb,
            components: (0..alignment.blocks.len()).map(component).collect(),
            iterations: steps,
            converged: descent.converged,
            downweighted_share: downweighted_share(&alignment.blocks, weights.as_deref()),
            second_minimum: second,
        })
    }
}

/// The weights of the rows used by the blocks.
fn of_rows(weights: &[Vec<f64>], blocks: &[Block]) -> Vec<Vec<f64>> {
    blocks.iter().zip(weights).map(|(b, w)| b.rows.iter().map(|&k| w[k]).collect()).collect()
}

/// Share of the rows that weights reduce.
fn downweighted_share(blocks: &[Block], weights: Option<&[Vec<f64>]>) -> f64 {
    let used: usize = blocks.iter().map(|b| b.t.len()).sum();
    let held_back = weights.into_iter().flatten().flatten().filter(|w| **w < 1.0).count();
    held_back as f64 / used as f64
}

fn component_fit(
    alignment: &Alignment,
    c: usize,
    descent: &Descent,
    noise: &NoiseModel,
    weights: Option<&[f64]>,
    sure: &Uncertainties,
) -> ComponentFit {
    let (block, m) = (&alignment.blocks[c], &alignment.measurements[c]);
    let gain = descent.normal.projections[c].gain;
    let shape = Shape::of(alignment, c, &descent.at, &descent.normal);
    let without_signal: Vec<f64> = block.rows.iter().zip(&shape.modelled).map(|(&k, r)| m.y[k] - r).collect();
    let nuisances = nuisance_columns(&block.t, m.drift, alignment.middle_s);
    let linear = regress_whitened(&block.filter, &nuisances, &without_signal);
    let mut residuals = without_signal;
    for (column, value) in nuisances.iter().zip(&linear) {
        residuals.iter_mut().zip(column).for_each(|(e, x)| *e -= value * x);
    }
    let mut place = sure.first_linear[c];
    let mut take = |value: f64| {
        let uncertain = Uncertain { value, standard_uncertainty: sure.of(place) };
        place += 1;
        uncertain
    };
    let gain = match m.gain {
        Gain::Free { .. } => take(gain),
        Gain::Fixed(value) => Uncertain { value, standard_uncertainty: 0.0 },
    };
    let offset = take(linear[0]);
    let drift = linear.get(1).map(|d| take(*d));
    ComponentFit {
        gain,
        offset,
        drift,
        noise: *noise,
        used_rows: block.rows.clone(),
        t_used: block.t.clone(),
        residuals,
        whitened: block.residuals.clone(),
        weights: weights.map_or_else(|| vec![1.0; block.t.len()], <[f64]>::to_vec),
        slope: shape.slope,
    }
}

/// One component before whitening: values minus gain times reference and shared columns, and the model's shape.
struct Raw {
    residuals: Vec<f64>,
    shape: Shape,
}

impl Raw {
    fn of(alignment: &Alignment, c: usize, at: &Lateness, normal: &Normal) -> Raw {
        let (block, m) = (&alignment.blocks[c], &alignment.measurements[c]);
        let shape = Shape::of(alignment, c, at, normal);
        let residuals = block.rows.iter().zip(&shape.modelled).map(|(&k, r)| m.y[k] - r).collect();
        Raw { residuals, shape }
    }

    /// The columns that the fit removed from the values: offset, drift, value (if the gain is free), shared columns,
    /// skew, rate.
    fn regressors(&self, alignment: &Alignment, c: usize) -> Vec<Vec<f64>> {
        let (block, m) = (&alignment.blocks[c], &alignment.measurements[c]);
        let mut regressors = nuisance_columns(&block.t, m.drift, alignment.middle_s);
        if let Gain::Free { .. } = m.gain {
            regressors.push(self.shape.values.clone());
        }
        regressors.extend_from_slice(&self.shape.shared);
        let slope = &self.shape.slope;
        if block.columns.len() > 2 {
            regressors.push(slope.iter().zip(&block.t).map(|(rate, t)| rate * (t - alignment.middle_s)).collect());
        }
        regressors.push(slope.clone());
        regressors
    }
}

/// `residuals` of component `c` whitened under a different noise than that of its block.
fn whitened_residuals(
    alignment: &Alignment,
    c: usize,
    residuals: &[f64],
    noise: &NoiseModel,
    weights: Option<&[f64]>,
) -> Vec<f64> {
    let (block, m) = (&alignment.blocks[c], &alignment.measurements[c]);
    let filter = WhiteningFilter::new(&block.t, noise, weights);
    let mut residuals = residuals.to_vec();
    filter.apply([&mut residuals]);
    let mut nuisance = nuisance_columns(&block.t, m.drift, alignment.middle_s);
    nuisance.iter_mut().for_each(|column| filter.apply([column]));
    residuals_of(&residuals, &orthonormal(&nuisance))
}

/// Coefficients of `y` on one or two `columns` after whitening.
fn regress_whitened(filter: &WhiteningFilter, columns: &[Vec<f64>], y: &[f64]) -> Vec<f64> {
    let whitened = |column: &[f64]| {
        let mut column = column.to_vec();
        filter.apply([&mut column]);
        column
    };
    let (columns, y): (Vec<Vec<f64>>, Vec<f64>) = (columns.iter().map(|c| whitened(c)).collect(), whitened(y));
    let aa = dot(&columns[0], &columns[0]);
    let ay = dot(&columns[0], &y);
    let Some(second) = columns.get(1) else { return vec![ay / aa] };
    let (ab, bb, by) = (dot(&columns[0], second), dot(second, second), dot(second, &y));
    let slope = (by - ab * ay / aa) / (bb - ab * ab / aa);
    vec![(ay - ab * slope) / aa, slope]
}

fn rows_within(m: &Measurement, at: &Lateness, middle_s: f64, guard_s: f64) -> Vec<usize> {
    let (first, last) = m.reference.span();
    let within = |k: &usize| {
        let instant = at.true_instant(m.t[*k], middle_s);
        instant >= first + guard_s && instant <= last - guard_s
    };
    (0..m.t.len()).filter(within).collect()
}

/// Middle of the used timestamps.
fn middle_of(measurements: &[Measurement], at: &Lateness, guard_s: f64) -> f64 {
    let (mut first, mut last) = (f64::INFINITY, f64::NEG_INFINITY);
    for m in measurements {
        let rows = rows_within(m, at, 0.0, guard_s);
        if let (Some(&a), Some(&b)) = (rows.first(), rows.last()) {
            (first, last) = (first.min(m.t[a]), last.max(m.t[b]));
        }
    }
    if first <= last { 0.5 * (first + last) } else { 0.0 }
}

/// Rounding of the values, as a standard deviation.
fn floor_of(m: &Measurement) -> f64 {
    let largest = m.y.iter().fold(0.0, |a: f64, y| a.max(y.abs()));
    (1e-12 * largest).max(f64::MIN_POSITIVE.sqrt())
}
