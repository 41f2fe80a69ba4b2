//! The fit of one lag model.

use super::lagged::LaggedReference;
use super::{DISTINGUISHED, LagCandidate, LagModel};
use crate::delay::block::{Block, MOST_CURVED, Normal, middle, nuisance_columns};
use crate::delay::{DelayFit, DelaySettings, Gain, Measurement, Uncertain};
use crate::noise::{BestNoise, NoiseProblem, NoiseRule};
use crate::projection::{orthonormal_to, remove};
use crate::whiten::NoiseModel;

/// Grid of the lagged references, s.
const GRID_S: f64 = 0.01;
/// Longest lag to search, s.
const LONGEST_LAG_S: f64 = 3.0;
/// A candidate better than another by this much (in BIC) is very strongly preferred (Kass and Raftery 1995).
const CLEARLY_BETTER: f64 = 10.0;
/// Range of a₂/a₁² of a filter with complex poles: from just above two equal lags, 1/4, to a damping of 0.35.
const NEARLY_CRITICAL: f64 = 0.2501;
const LEAST_DAMPED: f64 = 2.0;
const MOST_STEPS: usize = 40;
const LEAST_ROWS: usize = 20;
/// One-sided 95 %.
const ONE_SIDED: f64 = 1.645;

/// Data shared by the candidates.
pub(super) struct Trial<'a> {
    components: &'a [Measurement<'a>],
    references: Vec<LaggedReference>,
    rows: Vec<Vec<usize>>,
    weights: Option<Vec<Vec<f64>>>,
    noise: Vec<NoiseModel>,
    rule: NoiseRule,
    delay_s: f64,
    /// Standard uncertainty of the reference of each component, at any one instant.
    reference_std: Vec<f64>,
}

/// A candidate with its predicted measured values.
#[derive(Clone)]
pub(super) struct Fitted {
    pub(super) candidate: LagCandidate,
    /// Gain times shape at the rows of each component, offset and drift removed.
    shapes: Vec<Vec<f64>>,
}

impl Fitted {
    /// Whether it has more parameters than `other`.
    pub(super) fn is_richer_than(&self, other: &Fitted) -> bool {
        parameters(self.model) > parameters(other.model)
    }
}

impl std::ops::Deref for Fitted {
    type Target = LagCandidate;

    fn deref(&self) -> &LagCandidate {
        &self.candidate
    }
}

/// Delay plus lags (s) and the squares of the lags (s²): near zero lag the likelihood is smooth in the square, not in
/// the lag. For `D2`: delay plus a₁ (s), a₁ (s) and a₂ (s²). For `DA`: delay plus half the average (s), and the average (s).
type Point = [f64; MOST_CURVED];
type Covariance = [[f64; MOST_CURVED]; MOST_CURVED];

/// A candidate at its best point.
#[derive(Clone)]
struct Best {
    at: Point,
    normal: Normal,
}

impl<'a> Trial<'a> {
    pub(super) fn new(
        components: &'a [Measurement<'a>],
        fit: &DelayFit,
        settings: &DelaySettings,
        reference_std: &[f64],
    ) -> Option<Trial<'a>> {
        let delay_s = fit.delay_s;
        let mut references = vec![];
        let mut rows = vec![];
        let mut weights = vec![];
        for (m, f) in components.iter().zip(&fit.components) {
            let (first, last) = m.reference.span();
            let lead = (6.0 * delay_s.abs() + 0.2).min(0.2 * (last - first));
            let (from, to) = (first + lead + delay_s.max(0.0), last + delay_s.min(0.0));
            let kept: Vec<usize> = (0..f.t_used.len()).filter(|&k| f.t_used[k] >= from && f.t_used[k] <= to).collect();
            if kept.len() < LEAST_ROWS {
                return None;
            }
            rows.push(kept.iter().map(|&k| f.used_rows[k]).collect());
            weights.push(kept.iter().map(|&k| f.weights[k]).collect::<Vec<f64>>());
            references.push(LaggedReference::sampled(m.reference, GRID_S)?);
        }
        let held_back = weights.iter().flatten().any(|w| *w < 1.0);
        let noise = fit.components.iter().map(|c| c.noise).collect();
        let weights = held_back.then_some(weights);
        let reference_std = (0..components.len()).map(|c| reference_std.get(c).copied().unwrap_or(0.0)).collect();
        Some(Trial { components, references, rows, weights, noise, rule: settings.noise, delay_s, reference_std })
    }

    /// All candidates that can be fitted. A delay together with a lag is not negative, unless the data require it.
    pub(super) fn candidates(&self) -> Vec<Fitted> {
        let delay = self.delay_s;
        let guess = delay.abs().max(0.02);
        let only_delay = self.best(LagModel::D, &[[delay, 0.0, 0.0]]);
        let only_lag = self.best(LagModel::L, &[[1.3 * guess, 0.0, 0.0], [3.0 * guess, 0.0, 0.0]]);
        let lag = only_lag.as_ref().map_or(guess, |b| b.0.at[0]);
        let both = self.best(LagModel::DL, &[[1.05 * delay, 0.05 * guess * guess, 0.0], [lag, 0.8 * lag * lag, 0.0]]);
        let [sum, square, _] = both.as_ref().map_or([lag, 0.25 * lag * lag, 0.0], |b| b.0.at);
        let two = (0.5 * sum).powi(2);
        let starts = [[sum, 0.7 * square + 1e-4, 0.2 * square], [sum, 1.1 * two, 0.8 * two]];
        let two_lags = self.best(LagModel::DLL, &starts);
        let fitted =
            [(LagModel::D, only_delay), (LagModel::L, only_lag), (LagModel::DL, both), (LagModel::DLL, two_lags)];
        let free = fitted.into_iter().filter_map(|(model, best)| self.candidate(model, best?)).collect();
        self.with_filters(self.without_negative_delays(free))
    }

    /// With `D2` and `DA` where they are clearly better than a delay and lags, which are the usual case. Where they are only
    /// as likely as lags, the lateness of slow motion is as uncertain as they differ.
    fn with_filters(&self, mut all: Vec<Fitted>) -> Vec<Fitted> {
        let usual = all.iter().filter(|f| f.model != LagModel::L).min_by(|a, b| a.bic.total_cmp(&b.bic));
        let Some(usual) = usual.map(|f| f.candidate.clone()) else { return all };
        let starts = starts_of_filters(&usual);
        let fitted = starts.iter().filter_map(|(model, starts)| self.candidate(*model, self.best(*model, starts)?));
        let proper = fitted.filter(|f| f.delay_s.is_some_and(|delay| delay.value >= 0.0));
        let (clear, others): (Vec<Fitted>, Vec<Fitted>) = proper.partition(|f| f.bic + CLEARLY_BETTER < usual.bic);
        for f in all.iter_mut().filter(|f| matches!(f.model, LagModel::DL | LagModel::DLL)) {
            let as_likely = others.iter().filter(|other| other.bic < f.bic + DISTINGUISHED);
            let apart_s = as_likely.map(|other| (other.sum_s.value - f.sum_s.value).abs()).fold(0.0, f64::max);
            let u = &mut f.candidate.sum_s.standard_uncertainty;
            *u = u.hypot(apart_s / 3_f64.sqrt());
        }
        all.extend(clear);
        all
    }

    /// A sensor that shows a value early and also smears it does not exist, but a reference with too much
    /// high-frequency content looks like one: `e^{sT}/(1 + sT)` is a low pass. Such an optimum is replaced by the one
    /// on the border, where either the lag or the delay is zero: the better of the candidates without a negative delay,
    /// with insignificant parameters. It is kept if it is better by ΔBIC 6 than all of these and differs from them by
    /// more than the reference's own error.
    fn without_negative_delays(&self, free: Vec<Fitted>) -> Vec<Fitted> {
        let is_negative = |f: &Fitted| !f.lags_s.is_empty() && f.delay_s.is_some_and(|d| d.value < 0.0);
        let proper: Vec<Fitted> = free.iter().filter(|f| !is_negative(f)).cloned().collect();
        let Some(border) = proper.iter().min_by(|a, b| a.bic.total_cmp(&b.bic)).cloned() else { return free };
        let rows: usize = self.rows.iter().map(Vec::len).sum();
        let on_the_border = |f: Fitted| {
            if !is_negative(&f) || f.bic + DISTINGUISHED <= border.bic && self.differ(&f, &border) {
                return f;
            }
            let idle = parameters(f.model).saturating_sub(parameters(border.model));
            let mut lags_s = border.lags_s.clone();
            let none = Uncertain { value: 0.0, standard_uncertainty: border.sum_s.standard_uncertainty };
            lags_s.resize(parameters(f.model) - 1, none);
            let delay_s = Some(border.delay_s.unwrap_or(none));
            let bic = border.bic + idle as f64 * (rows as f64).ln();
            let own = LagCandidate { model: f.model, bic, delay_s, lags_s, ..border.candidate.clone() };
            Fitted { candidate: own, shapes: border.shapes.clone() }
        };
        free.into_iter().map(on_the_border).collect()
    }

    /// Whether the predictions of two candidates differ by more than the error of the reference.
    pub(super) fn differ(&self, a: &Fitted, b: &Fitted) -> bool {
        let of = |((a, b), std): ((&Vec<f64>, &Vec<f64>), &f64)| {
            let square = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / a.len().max(1) as f64;
            square > std * std
        };
        a.shapes.iter().zip(&b.shapes).zip(&self.reference_std).any(of)
    }

    /// The best point of `model` under its best noise, and its Bayesian information criterion.
    fn best(&self, model: LagModel, starts: &[Point]) -> Option<(Best, f64)> {
        let mut noise = self.noise.clone();
        let mut blocks = self.blocks(model, &noise);
        let first = starts
            .iter()
            .filter_map(|s| self.descend(model, &mut blocks, *s))
            .min_by(|a, b| a.normal.rss.total_cmp(&b.normal.rss))?;
        self.refine_noise(model, &first, &mut noise, &self.rule)?;
        blocks = self.blocks(model, &noise);
        let best = self.descend(model, &mut blocks, first.at)?;
        // The residuals hardly change, so white noise stays white.
        let white = noise.iter().all(|n| n.wander_std == 0.0) && self.rule == NoiseRule::WanderAndWhite;
        let rule = if white { NoiseRule::White } else { self.rule };
        let bic = self.refine_noise(model, &best, &mut noise, &rule)?;
        blocks = self.blocks(model, &noise);
        Some((Best { normal: self.normal(model, &mut blocks, &best.at), ..best }, bic))
    }

    fn blocks(&self, model: LagModel, noise: &[NoiseModel]) -> Vec<Block> {
        let block = |c: usize| {
            let weights = self.weights.as_ref().map(|w| w[c].as_slice());
            Block::new(&self.components[c], self.rows[c].clone(), &noise[c], weights, parameters(model))
        };
        (0..self.components.len()).map(block).collect()
    }

    /// Fills the columns of all blocks at `at` and solves for the linear parameters.
    fn normal(&self, model: LagModel, blocks: &mut [Block], at: &Point) -> Normal {
        let (delay, lags) = delay_and_lags(model, at);
        for (block, reference) in blocks.iter_mut().zip(&self.references) {
            let shape = shaped(model, at, reference);
            match model {
                LagModel::D2 => {
                    fill_second_order(block, &shape, &shaped(model, at, &shape), delay);
                    continue;
                }
                LagModel::DA => {
                    fill_average(block, &shape, reference, at);
                    continue;
                }
                LagModel::D | LagModel::L | LagModel::DL | LagModel::DLL => {}
            }
            let once_more: Vec<LaggedReference> = lags.iter().map(|lag| shape.after(*lag)).collect();
            let curvatures: Vec<Vec<f64>> = once_more.iter().map(LaggedReference::curvatures).collect();
            for (k, t) in block.t.iter().enumerate() {
                let place = shape.place(t - delay);
                let (value, rate) = shape.value_and_rate_at(place);
                block.columns[0][k] = value;
                block.columns[1][k] = match model {
                    LagModel::L => -once_more[0].value_and_rate_at(place).1,
                    _ => -rate,
                };
                for (column, curvature) in block.columns[2..].iter_mut().zip(&curvatures) {
                    let (i, x) = place;
                    column[k] = 0.5 * (curvature[i] + x * (curvature[i + 1] - curvature[i]));
                }
            }
        }
        Normal::of(blocks)
    }

    /// Levenberg and Marquardt's descent, keeping the squares of the lags non-negative.
    fn descend(&self, model: LagModel, blocks: &mut [Block], start: Point) -> Option<Best> {
        let mut at = bounded(model, start);
        let mut normal = self.normal(model, blocks, &at);
        let mut damping = 1e-3;
        for _ in 0..MOST_STEPS {
            let step = normal.step(damping, free(model, &at, &normal))?;
            let next = bounded(model, std::array::from_fn(|i| at[i] + step[i].clamp(-0.3, 0.3)));
            let there = self.normal(model, blocks, &next);
            let gained = normal.rss - there.rss;
            if gained >= 0.0 && (there.follows() || !normal.follows()) {
                (at, normal) = (next, there);
                damping = (damping * 0.1).max(1e-9);
                if gained < 1e-4 {
                    break;
                }
            } else {
                damping = damping.max(1e-4) * 10.0;
                if damping > 1e6 {
                    break;
                }
            }
        }
        normal.follows().then_some(Best { at, normal })
    }

    /// Fits the noise to the residuals of `best`. Returns the Bayesian information criterion including the noise's
    /// parameters; `None` if there is no likelihood.
    fn refine_noise(&self, model: LagModel, best: &Best, noise: &mut [NoiseModel], rule: &NoiseRule) -> Option<f64> {
        let rows: usize = self.rows.iter().map(Vec::len).sum();
        let mut minus_twice_log = 0.0;
        let mut counted = parameters(model);
        for (c, model_of_noise) in noise.iter_mut().enumerate() {
            let residuals = self.residuals(model, c, best);
            let m = &self.components[c];
            let t: Vec<f64> = self.rows[c].iter().map(|&k| m.t[k]).collect();
            let weights = self.weights.as_ref().map(|w| (w[c].as_slice(), crate::delay::KEPT_POWER));
            let regressors = nuisance_columns(&t, m.drift, 0.0);
            counted += regressors.len() + usize::from(matches!(m.gain, Gain::Free { .. }));
            let found: BestNoise =
                NoiseProblem::new(&t, &regressors, &residuals, weights).best_by_bic(rule, rows, model_of_noise)?;
            minus_twice_log += found.minus_twice_log;
            counted += found.parameters;
            *model_of_noise = found.model;
        }
        Some(minus_twice_log + counted as f64 * (rows as f64).ln())
    }

    /// Values minus gain times lagged and delayed reference.
    fn residuals(&self, model: LagModel, c: usize, best: &Best) -> Vec<f64> {
        let (delay, _) = delay_and_lags(model, &best.at);
        let shape = shaped(model, &best.at, &self.references[c]);
        let (m, gain) = (&self.components[c], best.normal.projections[c].gain);
        let value = |t: f64| shape.value_and_rate_at(shape.place(t - delay)).0;
        self.rows[c].iter().map(|&k| m.y[k] - gain * value(m.t[k])).collect()
    }

    /// Values predicted by `best` for component `c`, offset and drift removed.
    fn shape(&self, model: LagModel, c: usize, best: &Best) -> Vec<f64> {
        let m = &self.components[c];
        let t: Vec<f64> = self.rows[c].iter().map(|&k| m.t[k]).collect();
        let left = self.residuals(model, c, best);
        let mut shape: Vec<f64> = self.rows[c].iter().zip(left).map(|(&k, left)| m.y[k] - left).collect();
        let mut nuisances: Vec<Vec<f64>> = vec![];
        for column in nuisance_columns(&t, m.drift, middle(&t)) {
            nuisances.extend(orthonormal_to(&column, &nuisances));
        }
        nuisances.iter().for_each(|q| remove(&mut shape, q));
        shape
    }

    fn candidate(&self, model: LagModel, (best, bic): (Best, f64)) -> Option<Fitted> {
        let covariance = covariance(&best.normal);
        if matches!(model, LagModel::D2 | LagModel::DA) {
            return self.filter_candidate(model, (best, bic), &covariance);
        }
        let (delay, lags) = delay_and_lags(model, &best.at);
        let sum = best.at[0];
        let sum_s = Uncertain { value: sum, standard_uncertainty: covariance[0][0].sqrt() };
        let squares = if model == LagModel::L { 0 } else { parameters(model) - 1 };
        let mut lags_s: Vec<Uncertain> = match model {
            LagModel::L => vec![sum_s],
            _ => (0..squares).map(|i| lag_of(best.at[i + 1], covariance[i + 1][i + 1])).collect(),
        };
        lags_s.sort_by(|a, b| b.value.total_cmp(&a.value));
        // The sum of the squares varies; the sum itself is known far better.
        let total: f64 = best.at[1..=squares].iter().sum();
        let variance: f64 =
            (1..=squares).flat_map(|i| (1..=squares).map(move |j| (i, j))).map(|(i, j)| covariance[i][j]).sum();
        let of_lags = lag_of(total, variance).standard_uncertainty;
        let delay_s = Uncertain { value: delay, standard_uncertainty: sum_s.standard_uncertainty.hypot(of_lags) };
        let delay_s = match delay_and_lag_error(&best.at, &covariance) {
            Some(error) if squares == 1 => Uncertain { standard_uncertainty: error, ..delay_s },
            _ => delay_s,
        };
        let delay_range_s = match model {
            LagModel::L => [0.0, 0.0],
            _ => range_of_delay(sum, &lags, total, ONE_SIDED * variance.max(0.0).sqrt()),
        };
        let gains = self.gains(&best);
        let finite = bic.is_finite() && sum_s.standard_uncertainty.is_finite();
        let delay_s = (model != LagModel::L).then_some(delay_s);
        finite.then(|| Fitted {
            candidate: LagCandidate { model, bic, delay_s, lags_s, square_s2: None, gains, sum_s, delay_range_s },
            shapes: (0..self.components.len()).map(|c| self.shape(model, c, &best)).collect(),
        })
    }

    /// `D2`, which is late by delay plus a₁, or `DA`, by delay plus half the average.
    fn filter_candidate(&self, model: LagModel, (best, bic): (Best, f64), covariance: &Covariance) -> Option<Fitted> {
        let share = if model == LagModel::DA { 0.5 } else { 1.0 };
        let known = |k: usize, share: f64| Uncertain {
            value: share * best.at[k],
            standard_uncertainty: share * covariance[k][k].sqrt(),
        };
        let variance = covariance[0][0] + share * share * covariance[1][1] - 2.0 * share * covariance[0][1];
        let delay_s =
            Uncertain { value: best.at[0] - share * best.at[1], standard_uncertainty: variance.max(0.0).sqrt() };
        let half = ONE_SIDED * delay_s.standard_uncertainty;
        let candidate = LagCandidate {
            model,
            bic,
            delay_s: Some(delay_s),
            lags_s: vec![known(1, share)],
            square_s2: (model == LagModel::D2).then(|| known(2, 1.0)),
            gains: self.gains(&best),
            sum_s: known(0, 1.0),
            delay_range_s: [delay_s.value - half, delay_s.value + half],
        };
        let shapes = (0..self.components.len()).map(|c| self.shape(model, c, &best)).collect();
        (bic.is_finite() && known(0, 1.0).standard_uncertainty.is_finite()).then_some(Fitted { candidate, shapes })
    }

    /// Gains with their uncertainty if the lateness is known; fixed gains have none.
    fn gains(&self, best: &Best) -> Vec<Uncertain> {
        let of = |(m, p): (&Measurement, &crate::delay::block::Projection)| match m.gain {
            Gain::Fixed(value) => Uncertain { value, standard_uncertainty: 0.0 },
            Gain::Free { .. } => Uncertain { value: p.gain, standard_uncertainty: 1.0 / p.power.sqrt() },
        };
        self.components.iter().zip(&best.normal.projections).map(of).collect()
    }
}

/// Number of nonlinear parameters.
fn parameters(model: LagModel) -> usize {
    match model {
        LagModel::D | LagModel::L => 1,
        LagModel::DL | LagModel::DA => 2,
        LagModel::DLL | LagModel::D2 => 3,
    }
}

/// Where the search for `D2` and `DA` begins, near the best of delay and lags; nowhere near a delay alone.
fn starts_of_filters(usual: &LagCandidate) -> Vec<(LagModel, [Point; 2])> {
    let sum = usual.sum_s.value;
    let squares: f64 = usual.lags_s.iter().map(|lag| lag.value * lag.value).sum();
    if squares <= 0.0 {
        return vec![];
    }
    // Two equal lags smear as much as a moving average with T²/12 = 2T₁².
    let (a1, window) = ((2.0 * squares).sqrt(), (12.0 * squares).sqrt());
    vec![
        (LagModel::D2, [[sum, a1, 0.3 * a1 * a1], [sum, 1.2 * a1, 0.6 * a1 * a1]]),
        (LagModel::DA, [[sum, window, 0.0], [sum, 0.7 * window, 0.0]]),
    ]
}

/// `reference` behind the lags or the filter of a model, without its delay; a moving average without its own.
fn shaped(model: LagModel, at: &Point, reference: &LaggedReference) -> LaggedReference {
    match model {
        LagModel::D2 => reference.after_second_order([at[1], at[2]]),
        LagModel::DA => reference.averaged(at[1]),
        _ => delay_and_lags(model, at).1.iter().fold(reference.clone(), |r, lag| r.after(*lag)),
    }
}

/// Columns of `DA`. With the mean X over T around t − S: ∂X/∂S = −X′, ∂X/∂T = (mean of both ends − X)/T.
fn fill_average(block: &mut Block, shape: &LaggedReference, reference: &LaggedReference, &[sum, window, _]: &Point) {
    let end = |t: f64| reference.value_and_rate_at(reference.place(t)).0;
    for (k, t) in block.t.iter().enumerate() {
        let (value, rate) = shape.value_and_rate_at(shape.place(t - sum));
        block.columns[0][k] = value;
        block.columns[1][k] = -rate;
        let ends = 0.5 * (end(t - sum + 0.5 * window) + end(t - sum - 0.5 * window));
        block.columns[2][k] = (ends - value) / window;
    }
}

/// Columns of `D2`. With X = e^{−sτ}H r and τ = S − a₁: ∂X/∂S = −sX, ∂X/∂a₁ = sX − sHX, ∂X/∂a₂ = −s²HX.
fn fill_second_order(block: &mut Block, shape: &LaggedReference, once_more: &LaggedReference, delay: f64) {
    let curvature = once_more.curvatures();
    for (k, t) in block.t.iter().enumerate() {
        let place = shape.place(t - delay);
        let (value, rate) = shape.value_and_rate_at(place);
        let (i, x) = place;
        block.columns[0][k] = value;
        block.columns[1][k] = -rate;
        block.columns[2][k] = rate - once_more.value_and_rate_at(place).1;
        block.columns[3][k] = -(curvature[i] + x * (curvature[i + 1] - curvature[i]));
    }
}

fn delay_and_lags(model: LagModel, at: &Point) -> (f64, Vec<f64>) {
    match model {
        LagModel::L => (0.0, vec![at[0]]),
        LagModel::D2 => (at[0] - at[1], vec![]),
        LagModel::DA => (at[0], vec![]),
        _ => {
            let lags: Vec<f64> = at[1..parameters(model)].iter().map(|v| v.sqrt()).collect();
            (at[0] - lags.iter().sum::<f64>(), lags)
        }
    }
}

fn bounded(model: LagModel, at: Point) -> Point {
    let longest = LONGEST_LAG_S * LONGEST_LAG_S;
    let sum = if model == LagModel::L { at[0].clamp(1e-4, LONGEST_LAG_S) } else { at[0] };
    if model == LagModel::DA {
        return [sum, at[1].clamp(GRID_S, LONGEST_LAG_S), 0.0];
    }
    if model == LagModel::D2 {
        let a1 = at[1].clamp(1e-4, LONGEST_LAG_S);
        return [sum, a1, at[2].clamp(NEARLY_CRITICAL * a1 * a1, LEAST_DAMPED * a1 * a1)];
    }
    [sum, at[1].clamp(0.0, longest), at[2].clamp(0.0, longest)]
}

/// Whether each parameter is free: a square at zero whose gradient points below zero is held there.
fn free(model: LagModel, at: &Point, normal: &Normal) -> [bool; MOST_CURVED] {
    let is_square = |i: usize| i > 0 && !matches!(model, LagModel::L | LagModel::D2 | LagModel::DA);
    let held = |i: usize| is_square(i) && at[i] <= 0.0 && normal.gradient[i] <= 0.0;
    std::array::from_fn(|i| !held(i))
}

/// Inverse of the normal equations, slightly damped: two equal lags cannot be separated, but their sum is determined.
fn covariance(normal: &Normal) -> Covariance {
    std::array::from_fn(|i| {
        let mut unit = normal.clone();
        unit.gradient = std::array::from_fn(|j| f64::from(u8::from(i == j)));
        unit.step(1e-7, [true; MOST_CURVED]).unwrap_or([f64::INFINITY; MOST_CURVED])
    })
}

/// Sum minus lags whose squares add up to `total` ± `spread`.
fn range_of_delay(sum: f64, lags: &[f64], total: f64, spread: f64) -> [f64; 2] {
    let all: f64 = lags.iter().sum();
    let open = |square: f64| if total > 0.0 { all * (square.max(0.0) / total).sqrt() } else { square.max(0.0).sqrt() };
    [sum - open(total + spread), sum - open(total - spread)]
}

/// A lag and its uncertainty from its square.
fn lag_of(square: f64, variance: f64) -> Uncertain {
    let error = variance.max(0.0).sqrt();
    let half = 0.5 * ((square + error).sqrt() - (square - error).max(0.0).sqrt());
    Uncertain { value: square.sqrt(), standard_uncertainty: half }
}

/// Standard uncertainty of delay = sum − lag, by the delta method; `None` where the lag is too short for it.
fn delay_and_lag_error(at: &Point, covariance: &Covariance) -> Option<f64> {
    let lag = at[1].sqrt();
    let far_from_none = at[1] > 2.0 * covariance[1][1].max(0.0).sqrt();
    let slope = -0.5 / lag;
    let variance = covariance[0][0] + 2.0 * slope * covariance[0][1] + slope * slope * covariance[1][1];
    (far_from_none && variance >= 0.0).then(|| variance.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// d = s − √q has the derivatives 1 and −1/(2√q).
    #[test]
    fn the_uncertainty_of_the_delay_follows_from_those_of_sum_and_squared_lag() {
        let mut covariance = [[0.0; MOST_CURVED]; MOST_CURVED];
        (covariance[0][0], covariance[1][1]) = (4e-6, 9e-6);
        (covariance[0][1], covariance[1][0]) = (1e-6, 1e-6);
        let mut at = [0.0; MOST_CURVED];
        (at[0], at[1]) = (0.1, 0.04);
        // A lag of 0.2 s: 4 − 2·2.5·1 + 2.5²·9 = 55.25.
        let found = delay_and_lag_error(&at, &covariance).unwrap();
        assert!((found - 55.25e-6_f64.sqrt()).abs() < 1e-12, "{found}");
        // A squared lag of less than two of its standard uncertainties.
        at[1] = 0.0059;
        assert_eq!(delay_and_lag_error(&at, &covariance), None);
    }
}
