//! The dynamics of one channel against the reference motion (design note 3 and 9).

use crate::constancy::{Constancy, constancy};
use crate::curves::component_curves;
use crate::injection::{inject, not_injected};
use crate::lag_words::{less_certain, model, with_lag, with_model};
use crate::no_answer::{ambiguous_with, no_answer};
use crate::overlay::Laid;
use crate::reference_error::with_reference;
use crate::response::response;
use crate::sampling::rate_hz;
use crate::sensed::{Circumstances, SensedChannel, SensedComponent, Updates, measurement};
use crate::verdict::Evidence;
use flight::{Delay, RejectCount, with_expanded};
use record::{
    ChannelDynamics, ComponentDynamics, DelayFinding, Estimate, Finding, FitChecks, NoiseFinding, ObjectiveCurve,
    Stationarity, TimeBasis, Verdict,
};
use signal::{
    ComponentFit, DelayFit, DelaySettings, DelayStart, Measurement, NoiseRule, Uncertain, autocorrelation,
    choose_lag_model_against, delay_excess, fit_delay, fit_delay_near, jitter_from_residuals, kurtosis, ljung_box,
    resolution, static_deviation, static_segments,
};

/// Lags of the autocorrelation that are shown and tested.
const ACF_LAGS: usize = 40;
/// Number of points of the objective's curve over the whole search.
const OBJECTIVE_POINTS: usize = 101;
/// Number of points of its curve near the minimum, which is nearly a parabola.
const NEAR_POINTS: usize = 31;
/// The objective near its minimum is drawn up to this many standard uncertainties to either side.
const NEAR_U: f64 = 5.0;

/// Why a channel without a fit has no further results.
const NOT_TRIED: &str = "the channel could not be measured";

/// All results of the record for the channel.
pub(crate) fn dynamics(channel: &SensedChannel<'_>, bench: &Circumstances<'_>) -> ChannelDynamics {
    let updates = Updates::of(channel);
    let mut found = blank(channel, bench, &updates);
    if let Some(reason) = &bench.closed {
        found.reason = format!("no verdict: {reason}");
        return found;
    }
    let measurements = updates.measurements(channel);
    if measurements.is_empty() {
        found.reason = "the swing moves none of its components".to_owned();
        return found;
    }
    let settings = bench.settings();
    let fit = match fit_delay(&measurements, &settings) {
        Ok(fit) => fit,
        Err(error) => return ChannelDynamics { reason: error.to_string(), ..found },
    };
    let reference_std = updates.reference_std(channel);
    let step_s = signal::median_step(&updates.t).unwrap_or_default();
    found.model = model(&choose_lag_model_against(&measurements, &fit, &settings, &reference_std), step_s);
    if let Some(reason) = no_answer(&measurements, &fit, &settings, found.model.found()) {
        let checks = Some(checks(&measurements, &fit, bench.search_s));
        return ChannelDynamics { reason, checks, model: Finding::CannotTell(NOT_TRIED.to_owned()), ..found };
    }
    let Constancy { finding, change_s } = constancy(&measurements, &fit, &settings, found.model.found());
    let reference_s = bench.errors.of_delay(&measurements, &fit, &updates.sensitivities(channel));
    let beyond = Beyond { change_s: change_s.unwrap_or(0.0), ..Beyond::of(channel, bench, &updates, reference_s) };
    let delay = delay_finding(channel, bench, &updates, &fit, beyond);
    found.model = less_certain(found.model, |fit_s| beyond.added_to(fit_s, &fit));
    found.predicted_s = Some(fit.crlb_s);
    (found.verdict, found.reason) = judge(bench, channel, &updates, &fit, &delay);
    found.verdict = with_lag(found.verdict, found.model.found(), delay.strict_margin_s);
    found.reason = with_change(found.reason, change_s.and(finding.found()));
    found.reason = with_model(&found.reason, fit.delay_s, found.model.found());
    found.rejected.extend(unused(&updates, &fit));
    found.components = components(channel, bench, &updates, &fit);
    found.response = response(channel, &updates, &fit, &found.model);
    found.checks = Some(checks(&measurements, &fit, bench.search_s));
    found.stationarity = finding;
    found.jitter_s = jitter(&fit);
    found.injections = inject(&measurements, &settings, bench);
    found.delay = Some(delay);
    found
}

fn with_change(reason: String, change: Option<&Stationarity>) -> String {
    match change {
        Some(change) => format!("{reason}; {}", change.text),
        None => reason,
    }
}

fn blank(channel: &SensedChannel<'_>, bench: &Circumstances<'_>, updates: &Updates) -> ChannelDynamics {
    let not_tried = || NOT_TRIED.to_owned();
    ChannelDynamics {
        name: channel.name.to_owned(),
        quantity: channel.channel.quantity,
        stamp_kind: channel.time.kind,
        clock: channel.time.clock,
        basis: bench.basis.clone(),
        samples: (updates.t.len() + updates.hidden.len()) as u64,
        rejected: in_gaps(updates).into_iter().collect(),
        rate_hz: rate_hz(&channel.t),
        update_rate_hz: updates.rate_hz(),
        held_rows: (updates.rows - updates.t.len() - updates.hidden.len()) as u64,

        verdict: Verdict::NotMeasurable,
        reason: String::new(),
        predicted_s: None,
        delay: None,
        components: channel.components.iter().map(|c| undetermined(channel, c, bench)).collect(),
        model: Finding::CannotTell(not_tried()),
        response: Finding::CannotTell(not_tried()),
        checks: None,
        stationarity: Finding::CannotTell(not_tried()),
        jitter_s: Finding::CannotTell(not_tried()),
        latency: channel.time.latency.clone(),
        injections: not_injected(bench, NOT_TRIED),
    }
}

/// A component for which only the curve is known.
fn undetermined(
    channel: &SensedChannel<'_>,
    component: &SensedComponent<'_>,
    bench: &Circumstances<'_>,
) -> ComponentDynamics {
    let (curves, zoom) = component_curves(channel, component, None, bench.zoom);
    ComponentDynamics {
        name: component.name.to_owned(),
        unit: component.unit.to_owned(),
        excited: component.excited.is_ok(),
        why_not: component.excited.err().unwrap_or_default().to_owned(),
        gain: None,
        gain_frequency_hz: None,
        offset: None,
        drift: None,
        noise: None,
        delay_s: None,
        curves,
        zoom,
        residual: None,
        overlay: None,
    }
}

pub(crate) fn estimate(uncertain: Uncertain) -> Estimate {
    Estimate { value: uncertain.value, standard_uncertainty: Some(uncertain.standard_uncertainty) }
}

/// Uncertainty of the delay that the noise of a fit does not include.
#[derive(Clone, Copy)]
struct Beyond {
    /// Standard uncertainty from the reference, s.
    reference_s: f64,
    /// Deviation of the delay from constant, s.
    change_s: f64,
    /// Standard uncertainty of the instant of a held value, s.
    stamps_s: f64,
    /// Standard uncertainty of the anchor's lag, s; zero for the anchor itself.
    anchor_s: f64,
}

impl Beyond {
    fn of(channel: &SensedChannel<'_>, bench: &Circumstances<'_>, updates: &Updates, reference_s: f64) -> Beyond {
        let is_anchor = matches!(bench.basis, TimeBasis::Anchor { channel: anchor } if anchor == channel.name);
        let anchor_s = if is_anchor { 0.0 } else { bench.anchor_s };
        Beyond { reference_s, change_s: 0.0, stamps_s: stamp_uncertainty(channel, updates), anchor_s }
    }

    /// The standard uncertainty of a lateness from that of its fit, s.
    fn added_to(self, fit_s: f64, fit: &DelayFit) -> f64 {
        let own_s = with_reference(fit_s, self.reference_s, fit.components.len());
        own_s.hypot(self.stamps_s).hypot(self.anchor_s).hypot(self.change_s)
    }
}

fn delay_finding(
    channel: &SensedChannel<'_>,
    bench: &Circumstances<'_>,
    updates: &Updates,
    fit: &DelayFit,
    beyond: Beyond,
) -> DelayFinding {
    let Beyond { reference_s, change_s, stamps_s, anchor_s } = beyond;
    let standard_uncertainty_s = beyond.added_to(fit.standard_uncertainty_s, fit);
    let judgement = evidence(bench, updates, fit, standard_uncertainty_s).judge();
    let as_seen = updates
        .mean_age_s
        .map(|age| Estimate { value: fit.delay_s + age, standard_uncertainty: Some(standard_uncertainty_s) });
    DelayFinding {
        delay: Delay::from_seconds(fit.delay_s).unwrap_or(Delay::ZERO),
        standard_uncertainty_s,
        hessian_s: fit.hessian_s,
        hac_s: fit.hac_s,
        reference_s,
        stamps_s,
        anchor_s,
        change_s,
        interval_95_s: judgement.interval_95_s,
        degrees_of_freedom: fit.degrees_of_freedom,
        crlb_s: fit.crlb_s,
        as_seen_s: as_seen,
        held_fit_s: held_fit(channel, bench, updates),
        minimum_detectable_s: judgement.minimum_detectable_s,
        margin_s: margin(bench, updates),
        strict_margin_s: strict_margin(bench),
        deciding_length_s: judgement.deciding_length_s,
    }
}

/// A held value is seen at the first row after its change: up to one row late, uniformly distributed.
fn stamp_uncertainty(channel: &SensedChannel<'_>, updates: &Updates) -> f64 {
    let row_s = if channel.channel.is_held() { updates.row_step_s.unwrap_or(0.0) } else { 0.0 };
    row_s / 12f64.sqrt()
}

/// Margin of a delay that differs from zero, and of a fast channel, s.
const LEAST_MARGIN_S: f64 = 0.005;

/// Half the interval of the channel's updates, or 5 ms, whichever is larger (design note 3.7).
fn margin(bench: &Circumstances<'_>, updates: &Updates) -> f64 {
    let half_interval_s = updates.rate_hz().map_or(0.0, |rate| 0.5 / rate);
    bench.margin_s.unwrap_or_else(|| half_interval_s.max(LEAST_MARGIN_S))
}

fn strict_margin(bench: &Circumstances<'_>) -> f64 {
    bench.margin_s.unwrap_or(LEAST_MARGIN_S)
}

fn evidence(bench: &Circumstances<'_>, updates: &Updates, fit: &DelayFit, standard_uncertainty_s: f64) -> Evidence {
    Evidence {
        delay_s: fit.delay_s,
        standard_uncertainty_s,
        degrees_of_freedom: fit.degrees_of_freedom,
        margin_s: margin(bench, updates),
        strict_margin_s: strict_margin(bench),
        duration_s: duration(&updates.t),
    }
}

fn duration(t: &[f64]) -> f64 {
    t.last().zip(t.first()).map_or(0.0, |(last, first)| last - first)
}

fn held_fit(channel: &SensedChannel<'_>, bench: &Circumstances<'_>, updates: &Updates) -> Option<Estimate> {
    updates.mean_age_s?;
    let seen: Vec<usize> = (0..channel.t.len()).filter(|&row| !channel.hidden.hides(channel.t[row])).collect();
    let of = |column: &[f64]| -> Vec<f64> { seen.iter().filter_map(|&row| column.get(row).copied()).collect() };
    let (t, columns): (Vec<f64>, Vec<Vec<f64>>) =
        (of(&channel.t), updates.excited.iter().map(|&k| of(channel.components[k].values)).collect());
    let whole: Vec<Measurement<'_>> =
        updates.excited.iter().zip(&columns).map(|(&k, y)| measurement(&channel.components[k], &t, y)).collect();
    // Row by row, as a control loop sees it: a row counts in full even if it repeats the previous one.
    let settings = DelaySettings { noise: NoiseRule::White, robust: false, ..bench.settings() };
    let fit = fit_delay(&whole, &settings).ok()?;
    Some(Estimate { value: fit.delay_s, standard_uncertainty: Some(fit.standard_uncertainty_s) })
}

fn judge(
    bench: &Circumstances<'_>,
    channel: &SensedChannel<'_>,
    updates: &Updates,
    fit: &DelayFit,
    delay: &DelayFinding,
) -> (Verdict, String) {
    if let TimeBasis::Anchor { channel: anchor } = bench.basis
        && anchor == channel.name
    {
        let text = "this is the anchor, assumed to be on time: every other delay is relative to it";
        return (Verdict::NotMeasurable, text.to_owned());
    }
    if !fit.converged {
        return (Verdict::NotMeasurable, unsettled(fit));
    }
    let judgement = evidence(bench, updates, fit, delay.standard_uncertainty_s).judge();
    let relative = match bench.basis {
        TimeBasis::Anchor { channel } => format!(" (relative to {channel})"),
        _ => String::new(),
    };
    (judgement.verdict, judgement.reason + &relative)
}

/// Why delay and noise did not converge, as far as the last round shows it.
fn unsettled(fit: &DelayFit) -> String {
    let noise = fit.components.first().map_or_else(String::new, |c| {
        format!(" Its residual wanders with a time constant of {:.2} s", c.noise.time_constant_s)
    });
    format!(
        "the fit did not converge: after {} steps, at {} ms (k = 2), delay and noise still affect each other.{noise}: \
         the reference is wrong there, or the noise is as strong as the swing",
        fit.iterations,
        with_expanded(1e3 * fit.delay_s, 2e3 * fit.standard_uncertainty_s)
    )
}

/// The reason for a row whose true instant is within a gap of the encoder.
pub(crate) const SILENT: &str = "the encoder has a gap at the row's true time";

fn in_gaps(updates: &Updates) -> Option<RejectCount> {
    let first = format!("row {}", updates.hidden.first()?);
    Some(RejectCount { reason: SILENT.to_owned(), count: updates.hidden.len() as u64, first })
}

fn unused(updates: &Updates, fit: &DelayFit) -> Vec<RejectCount> {
    let used = fit.components.iter().map(|c| c.used_rows.len()).min().unwrap_or(0);
    let outside = updates.t.len().saturating_sub(used);
    let used_rows = fit.components.first().map_or(&[][..], |c| &c.used_rows);
    let first = (0..used_rows.len()).find(|&row| used_rows[row] != row).unwrap_or(used_rows.len());
    (outside > 0)
        .then(|| RejectCount {
            reason: "the row's true time is outside the part of the encoder's record that is used".to_owned(),
            count: outside as u64,
            first: format!("update {first}"),
        })
        .into_iter()
        .collect()
}

fn components(
    channel: &SensedChannel<'_>,
    bench: &Circumstances<'_>,
    updates: &Updates,
    fit: &DelayFit,
) -> Vec<ComponentDynamics> {
    let still = still_rows(bench, &channel.t);
    let shares = bench.errors.of_gains(&updates.measurements(channel), fit, &updates.sensitivities(channel));
    channel
        .components
        .iter()
        .enumerate()
        .map(|(k, component)| {
            let place = updates.excited.iter().position(|&e| e == k);
            let fitted = place.and_then(|place| fit.components.get(place));
            let (curves, zoom) = component_curves(channel, component, fitted.map(|f| (fit, f)), bench.zoom);
            let measured = measurement(component, &updates.t, &updates.values[k]);
            let by = &component.sensitivity;
            let alone = fitted.filter(|_| updates.excited.len() > 1).and_then(|f| {
                let start = DelayStart { delay_s: fit.delay_s, noise: vec![f.noise], keep_noise: false };
                fit_delay_near(&[measured], &bench.settings(), &start).ok()
            });
            ComponentDynamics {
                gain: fitted.zip(place).map(|(f, place)| gain(f, shares[place])),
                gain_frequency_hz: fitted.and_then(|f| bench.errors.frequency_of_gain_hz(&measured, fit, f, by)),
                offset: fitted.map(|f| estimate(f.offset)),
                drift: fitted.and_then(|f| f.drift).map(estimate),
                noise: fitted.map(|f| noise(f, component.values, &still)),
                delay_s: alone
                    .map(|f| Estimate { value: f.delay_s, standard_uncertainty: Some(f.standard_uncertainty_s) }),
                curves,
                zoom,
                residual: fitted.map(crate::curves::residual_curve),
                overlay: fitted.map(|f| overlaid(component, bench, fit, f).overlay()),
                ..undetermined(channel, component, bench)
            }
        })
        .collect()
}

fn overlaid<'a>(
    component: &SensedComponent<'a>,
    bench: &Circumstances<'_>,
    fit: &DelayFit,
    of_component: &'a ComponentFit,
) -> Laid<'a> {
    Laid {
        reference: component.reference,
        fit: of_component,
        delay_s: fit.delay_s,
        zoom: bench.zoom,
        period_s: bench.period_s,
    }
}

/// Ratio measured/reference, including the relative standard uncertainty `share` from the reference.
fn gain(f: &ComponentFit, share: f64) -> Estimate {
    let standard_uncertainty = f.gain.standard_uncertainty.hypot(f.gain.value * share);
    Estimate { value: f.gain.value, standard_uncertainty: Some(standard_uncertainty) }
}

/// Rows of the channel while the bar is at rest for five seconds or more.
fn still_rows(bench: &Circumstances<'_>, t: &[f64]) -> Vec<std::ops::Range<usize>> {
    const LEAST_S: f64 = 5.0;
    let of_row = |at: f64| t.partition_point(|&x| x < at);
    static_segments(bench.t, bench.rate, bench.still_rate, LEAST_S)
        .into_iter()
        .filter(|rows| !rows.is_empty())
        .map(|rows| of_row(bench.t[rows.start])..of_row(bench.t[rows.end - 1]))
        .filter(|rows| rows.len() > 1)
        .collect()
}

fn noise(fit: &ComponentFit, values: &[f64], still: &[std::ops::Range<usize>]) -> NoiseFinding {
    NoiseFinding {
        wander_std: fit.noise.wander_std,
        time_constant_s: fit.noise.time_constant_s,
        white_std: fit.noise.white_std,
        static_std: static_deviation(values, still),
        resolution: resolution(values),
    }
}

fn checks(measurements: &[Measurement<'_>], fit: &DelayFit, search_s: (f64, f64)) -> FitChecks {
    let whitened: Vec<f64> = fit.components.iter().flat_map(|c| c.whitened.iter().copied()).collect();
    let first = fit.components.first().map_or(&[][..], |c| c.whitened.as_slice());
    let lags = ACF_LAGS.min(first.len() / 4);
    let acf = autocorrelation(first, lags);
    let ljung_box_p = ljung_box(&acf, first.len());
    FitChecks {
        autocorrelation_u95: 1.96 / (first.len().max(1) as f64).sqrt(),
        ljung_box_p,
        autocorrelation: acf,
        kurtosis: kurtosis(&whitened).unwrap_or(3.0),
        downweighted_share: fit.downweighted_share,
        outlier_share: outlier_share(fit),
        objective: objective(measurements, fit, search_s),
        second_minimum_s: ambiguous_with(fit),
    }
}

/// Share of the used rows more than four standard deviations off: Huber's weight is 1.345 divided by the deviation.
fn outlier_share(fit: &DelayFit) -> f64 {
    const FAR: f64 = 1.345 / 4.0;
    let weights: Vec<f64> = fit.components.iter().flat_map(|c| c.weights.iter().copied()).collect();
    weights.iter().filter(|w| **w < FAR).count() as f64 / weights.len().max(1) as f64
}

fn objective(measurements: &[Measurement<'_>], fit: &DelayFit, (from, to): (f64, f64)) -> ObjectiveCurve {
    let half = NEAR_U * fit.standard_uncertainty_s;
    let grid = |from: f64, to: f64, points: usize| -> Vec<f64> {
        (0..points).map(|k| from + (to - from) * k as f64 / (points - 1) as f64).collect()
    };
    let (delay_s, value) = delay_excess(measurements, fit, &grid(from, to, OBJECTIVE_POINTS));
    let near = grid(fit.delay_s - half, fit.delay_s + half, NEAR_POINTS);
    let (near_delay_s, near_value) = delay_excess(measurements, fit, &near);
    ObjectiveCurve { delay_s, value, near_delay_s, near_value }
}

fn jitter(fit: &DelayFit) -> Finding<Estimate> {
    let of = |c: &ComponentFit| jitter_from_residuals(&c.t_used, &c.residuals, &c.slope, &c.noise);
    // The component with the steepest signal relative to its noise shows jitter best.
    let steepness = |c: &ComponentFit| c.slope.iter().map(|s| s * s).sum::<f64>() / c.noise.std().powi(2);
    let best = fit.components.iter().max_by(|a, b| steepness(a).total_cmp(&steepness(b)));
    match best.and_then(of) {
        Some((std, u)) => Finding::Found(Estimate { value: std, standard_uncertainty: Some(u) }),
        None => Finding::CannotTell(
            "residuals do not clearly grow with the slope of the signal: no jitter detected".to_owned(),
        ),
    }
}
