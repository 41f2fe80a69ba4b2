//! Checks whether the delay of a channel is constant over the record (design note 3.9).

use crate::verdict::{millis, probability};
use record::{Estimate, Finding, ModelFinding, Stationarity};
use signal::{
    DelayFit, DelaySettings, DelayStart, LagModel, LaggedReference, Measurement, SegmentDelay, delay_by_segment,
    fit_delay, fit_delay_near, homogeneity,
};

/// Windows of the delay over the record, s; half overlapping.
const WINDOW_S: f64 = 15.0;
/// Below this probability the text states that the delay changes.
const REPORTED_P: f64 = 0.01;
/// Below this one the delay counts as changing: 1 of 752 channels with a constant delay, in simulations.
const CERTAIN_P: f64 = 0.001;
/// Below this one each window is fitted with its own noise, because a step becomes part of the noise of the whole
/// record and hides itself.
const DOUBTFUL_P: f64 = 0.05;
/// Half of a 95 % interval in standard uncertainties.
const HALF_95: f64 = 1.96;
/// A lag explains a change if it leaves less than this share of its range.
const LAG_EXPLAINS: f64 = 0.75;
/// Minimum number of rows for the noise of a window.
const LEAST_ROWS: usize = 60;
/// Grid of a lagged reference, s.
const GRID_S: f64 = 0.01;

/// The finding, and the deviation of the delay from constant.
pub(crate) struct Constancy {
    pub(crate) finding: Finding<Stationarity>,
    /// Standard uncertainty that covers the delay of every window, s; `None` if no change is certain.
    pub(crate) change_s: Option<f64>,
}

/// The delay in windows, compared with one delay for all. With a lag, a hand that changes its speed changes the
/// best-fitting delay: only the change that remains with the lag of the `model` in the reference is a change of the
/// channel.
pub(crate) fn constancy(
    measurements: &[Measurement<'_>],
    fit: &DelayFit,
    settings: &DelaySettings,
    model: Option<&ModelFinding>,
) -> Constancy {
    let windows = delay_by_segment(measurements, fit, WINDOW_S, 0.5);
    let apart = delay_by_segment(measurements, fit, WINDOW_S, 0.0);
    let Some((chi2, constant_p)) = homogeneity(&apart) else {
        let text = format!("fewer than two windows of {WINDOW_S} s with enough motion");
        return Constancy { finding: Finding::CannotTell(text), change_s: None };
    };
    let is_doubtful = (CERTAIN_P..DOUBTFUL_P).contains(&constant_p);
    let own_p = is_doubtful.then(|| each_alone(measurements, fit, settings, &apart)).flatten();
    let constant_p = own_p.filter(|p| *p < CERTAIN_P).unwrap_or(constant_p);
    let by_the_lag = constant_p < REPORTED_P && !changes_behind_lag(measurements, settings, model, &apart);
    let changes = constant_p < CERTAIN_P && !by_the_lag;
    let [least, most] = range(windows.iter().map(|w| w.delay_s));
    let found = match constant_p {
        p if p >= REPORTED_P => "No change over the record",
        _ if by_the_lag => "The delay that fits best changes with the motion, as expected of the lag",
        _ => {
            let verb = if changes { "changes" } else { "may change" };
            &format!("The delay {verb} over the record, between {} and {} ms", millis(least), millis(most))
        }
    };
    let text = format!("{found} (χ² = {chi2:.1}, {} windows, {}).", apart.len(), probability(constant_p));
    let finding = Finding::Found(Stationarity {
        window_s: WINDOW_S,
        t_s: windows.iter().map(|w| w.middle_s).collect(),
        delay_s: windows.iter().map(estimate_of).collect(),
        constant_p,
        changes,
        slope: slope(&apart),
        text,
    });
    let farthest_s = (most - fit.delay_s).max(fit.delay_s - least);
    Constancy { finding, change_s: changes.then_some(farthest_s / HALF_95) }
}

fn range(values: impl Iterator<Item = f64>) -> [f64; 2] {
    values.fold([f64::INFINITY, f64::NEG_INFINITY], |[least, most], x| [least.min(x), most.max(x)])
}

fn estimate_of(window: &SegmentDelay) -> Estimate {
    Estimate { value: window.delay_s, standard_uncertainty: Some(window.standard_uncertainty_s) }
}

/// Probability that separately fitted windows have one delay; `None` with fewer than two such windows.
fn each_alone(
    measurements: &[Measurement<'_>],
    fit: &DelayFit,
    settings: &DelaySettings,
    apart: &[SegmentDelay],
) -> Option<f64> {
    let noise: Vec<_> = fit.components.iter().map(|c| c.noise).collect();
    let one = |window: &SegmentDelay| {
        let (from, to) = (window.middle_s - 0.5 * WINDOW_S, window.middle_s + 0.5 * WINDOW_S);
        let within = |m: &Measurement<'_>| m.t.partition_point(|t| *t < from)..m.t.partition_point(|t| *t < to);
        let parts: Vec<Measurement<'_>> =
            measurements.iter().map(|m| Measurement { t: &m.t[within(m)], y: &m.y[within(m)], ..*m }).collect();
        let start = DelayStart { delay_s: window.delay_s, noise: noise.clone(), keep_noise: false };
        let found = fit_delay_near(&parts, settings, &start).ok().filter(|f| f.converged)?;
        let enough = found.components.iter().all(|c| c.t_used.len() >= LEAST_ROWS);
        let (delay_s, standard_uncertainty_s) = (found.delay_s, found.standard_uncertainty_s);
        enough.then_some(SegmentDelay { delay_s, standard_uncertainty_s, ..*window })
    };
    let windows: Vec<SegmentDelay> = apart.iter().filter_map(one).collect();
    homogeneity(&windows).map(|(_, p)| p)
}

/// Whether the delay also changes with the lag of the best model in the reference; always true without a lag.
fn changes_behind_lag(
    measurements: &[Measurement<'_>],
    settings: &DelaySettings,
    model: Option<&ModelFinding>,
    apart: &[SegmentDelay],
) -> bool {
    let best = model.and_then(|m| m.candidates.first());
    let lags: Vec<f64> = best.into_iter().flat_map(|c| &c.lags_s).map(|l| l.value).filter(|l| *l > 0.0).collect();
    if lags.is_empty() {
        return true;
    }
    let averages = best.is_some_and(|c| c.name == LagModel::DA.name());
    let square_s2 = best.and_then(|c| c.square_s2).map(|square| square.value);
    let lagged = |m: &Measurement<'_>| match square_s2 {
        Some(a2) => LaggedReference::second_order(m.reference, [lags[0], a2], GRID_S),
        None if averages => LaggedReference::moving_average(m.reference, 2.0 * lags[0], GRID_S),
        None => LaggedReference::new(m.reference, &lags, GRID_S),
    };
    let Some(references) = measurements.iter().map(lagged).collect::<Option<Vec<_>>>() else { return true };
    let lagged: Vec<Measurement<'_>> =
        measurements.iter().zip(&references).map(|(m, reference)| Measurement { reference, ..*m }).collect();
    let Ok(fit) = fit_delay(&lagged, settings) else { return true };
    // A lag fitted to a step keeps the windows apart, but with so much noise that chi-squared does not show it.
    let sharper = |window: SegmentDelay| {
        let same = apart.iter().find(|w| (w.middle_s - window.middle_s).abs() < 0.5 * WINDOW_S);
        let known_s = same.map_or(f64::INFINITY, |w| w.standard_uncertainty_s);
        SegmentDelay { standard_uncertainty_s: window.standard_uncertainty_s.min(known_s), ..window }
    };
    let windows: Vec<SegmentDelay> = delay_by_segment(&lagged, &fit, WINDOW_S, 0.0).into_iter().map(sharper).collect();
    let range = |all: &[SegmentDelay]| {
        let bound = |f: fn(f64, f64) -> f64, from: f64| all.iter().map(|w| w.delay_s).fold(from, f);
        bound(f64::max, f64::NEG_INFINITY) - bound(f64::min, f64::INFINITY)
    };
    range(&windows) > LAG_EXPLAINS * range(apart) || homogeneity(&windows).is_none_or(|(_, p)| p < CERTAIN_P)
}

/// Weighted straight line through the delays of non-overlapping windows, s/s.
fn slope(windows: &[SegmentDelay]) -> Estimate {
    let weight = |w: &SegmentDelay| w.standard_uncertainty_s.powi(-2);
    let total: f64 = windows.iter().map(weight).sum();
    let mean = |f: &dyn Fn(&SegmentDelay) -> f64| windows.iter().map(|w| weight(w) * f(w)).sum::<f64>() / total;
    let (t, d) = (mean(&|w| w.middle_s), mean(&|w| w.delay_s));
    let spread = windows.iter().map(|w| weight(w) * (w.middle_s - t).powi(2)).sum::<f64>();
    let product = windows.iter().map(|w| weight(w) * (w.middle_s - t) * (w.delay_s - d)).sum::<f64>();
    let known = spread > 0.0;
    Estimate {
        value: if known { product / spread } else { 0.0 },
        standard_uncertainty: known.then(|| spread.sqrt().recip()),
    }
}
