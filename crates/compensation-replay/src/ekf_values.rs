//! Values from a flight for the design of a filter: noise, wander and delay of each channel (the paper's conclusion).
//!
//! A position compared with the integral of its velocity shows the noise of the position, both white and slowly
//! wandering. A velocity compared with the integral of acceleration shows the noise of the velocity. The noise of the
//! second channel, integrated to a random walk, is included, so the stated wander is an upper bound.
//!
//! With σ of one sample, sampling interval T, σ_w and τ of the wander (first-order Gauss–Markov process):
//! density of the white noise `σ·√T`; driving noise of the wander `√(2σ_w²/τ)`, which is the density of the random walk
//! that a slow wander looks like; in discrete time `φ = exp(−T/τ)`, `Q = σ_w²·(1 − φ²)`.

mod toml;

pub use self::toml::ekf_values_toml;

use record::{
    DelayNoise, DelayPairKind, DelayPiece, EkfChannel, EkfValue, EkfValueKind, EkfValues, Estimate, FlightDelays,
    MeasuredDelay, PairDelay,
};
use std::collections::BTreeMap;

/// White noise below this fraction of the wander's step between samples cannot be distinguished from zero.
const LEAST_OBSERVABLE: f64 = 0.05;

/// Facts about a channel in addition to its pairs.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct EkfChannelFacts {
    /// Updates per second, Hz. `None`: samples of the pair divided by the seconds they cover.
    pub rate_hz: Option<f64>,
    /// Lateness of the channel, and against what. `None`: the delay of the pair is the fallback, with its name.
    pub lateness_s: Option<(Estimate, String)>,
}

/// Values for the design of a filter, from the delays of a flight. `facts` is by channel name.
///
/// For each channel the pair with the most certain delay is used: a position against a velocity, a velocity against an
/// acceleration. References are not used: they only judge.
#[must_use]
pub fn ekf_values(delays: &FlightDelays, facts: &BTreeMap<String, EkfChannelFacts>) -> EkfValues {
    let mut best: BTreeMap<&str, (&PairDelay, &MeasuredDelay)> = BTreeMap::new();
    for pair in delays.pairs.iter().filter(|pair| gives_noise(pair.kind)) {
        let Some(measured) = pair.delay.found() else { continue };
        let known = best.get(pair.first.as_str());
        if known.is_none_or(|(_, other)| uncertainty(measured) < uncertainty(other)) {
            best.insert(&pair.first, (pair, measured));
        }
    }
    let of = |(name, (pair, measured)): (&str, (&PairDelay, &MeasuredDelay))| {
        channel_of(pair, measured, facts.get(name).unwrap_or(&EkfChannelFacts::default()))
    };
    EkfValues { channels: best.into_iter().map(of).collect() }
}

fn gives_noise(kind: DelayPairKind) -> bool {
    matches!(kind, DelayPairKind::PositionAgainstVelocity | DelayPairKind::VelocityAgainstAcceleration)
}

fn uncertainty(measured: &MeasuredDelay) -> f64 {
    measured.delay_s.standard_uncertainty.unwrap_or(f64::INFINITY)
}

fn channel_of(pair: &PairDelay, measured: &MeasuredDelay, facts: &EkfChannelFacts) -> EkfChannel {
    let duration_s: f64 = measured.pieces.iter().map(|piece| (piece.end_s - piece.start_s).max(0.0)).sum();
    let per_axis = measured.samples as f64 / 2.0;
    let counted_hz = (duration_s > 0.0).then(|| per_axis / duration_s).filter(|hz| *hz > 0.0);
    let rate_hz = facts.rate_hz.filter(|hz| hz.is_finite() && *hz > 0.0).or(counted_hz);
    let mut channel = EkfChannel {
        channel: pair.first.clone(),
        rests_on: format!("{} against {}", pair.first, pair.second),
        rate_hz,
        values: vec![],
        remarks: vec![],
    };
    let unit = if pair.kind == DelayPairKind::PositionAgainstVelocity { "m" } else { "m/s" };
    white(&mut channel, measured, unit);
    wander(&mut channel, measured, duration_s, unit);
    bias(&mut channel, measured, pair);
    delay(&mut channel, pair, measured, facts);
    channel
}

/// Standard deviation and density of the white noise.
fn white(channel: &mut EkfChannel, measured: &MeasuredDelay, unit: &str) {
    let Some(std) = pooled(measured, |noise| Some(noise.white_std)) else { return };
    // Step of the wander in one sample: white noise far below it is the edge of the fit's search and not observable.
    let step = pooled(measured, walk_density).zip(channel.rate_hz).map_or(0.0, |(walk, hz)| walk.value / hz.sqrt());
    if std.value < LEAST_OBSERVABLE * step {
        let text = "no white noise was found: it is below the wander of one sample";
        channel.remarks.push(format!("{text} ({step:.2e} {unit})"));
        return;
    }
    // The larger of the uncertainty for independent samples and the scatter between pieces and axes.
    let alike = std.value / (2.0 * (measured.samples as f64).max(1.0)).sqrt();
    let u = Some(alike.max(std.scatter));
    push(channel, EkfValueKind::WhiteStd, std.value, u, unit, "standard deviation of the white noise of one sample");
    if let Some(hz) = channel.rate_hz {
        let root = (1.0 / hz).sqrt();
        let formula = "white-std * sqrt(T), T = 1 / rate: the measurement's R in continuous time is its square";
        push(
            channel,
            EkfValueKind::NoiseDensity,
            std.value * root,
            u.map(|u| u * root),
            &format!("{unit}/sqrt(Hz)"),
            formula,
        );
    }
}

/// The wander as a Gauss–Markov process, and as the random walk that drives it.
fn wander(channel: &mut EkfChannel, measured: &MeasuredDelay, duration_s: f64, unit: &str) {
    let std = pooled(measured, |noise| noise.wander_std.filter(|_| noise.time_constant_s.is_some()));
    let walk = pooled(measured, walk_density);
    let (Some(std), Some(walk)) = (std, walk) else {
        channel.remarks.push("no wander was found: the noise is white".to_owned());
        return;
    };
    // A single process with the pooled variance and the pooled driving noise.
    let time_constant_s = 2.0 * (std.value / walk.value).powi(2);
    // Two axes; for time constant τ, a record of length D gives D/(2τ) independent values of the variance.
    let records = 2.0 * duration_s / time_constant_s;
    let u_std = (records > 0.0).then(|| (std.value / records.sqrt() / 2.0_f64.sqrt()).max(std.scatter));
    let u_constant = (records > 0.0).then(|| time_constant_s * (2.0 / records).sqrt());
    let u_walk = (walk.value / (2.0 * (measured.samples as f64).max(1.0)).sqrt()).max(walk.scatter);
    let formula = "standard deviation of the wander, a first-order Gauss-Markov process";
    push(channel, EkfValueKind::WanderStd, std.value, u_std, unit, formula);
    let formula = "correlation time tau: phi = exp(-T / tau), Q = wander-std^2 * (1 - phi^2)";
    push(channel, EkfValueKind::WanderTimeConstant, time_constant_s, u_constant, "s", formula);
    let formula = "sqrt(2 * wander-std^2 / tau): driving noise of the wander, random walk of a slow one";
    push(channel, EkfValueKind::RandomWalkDensity, walk.value, Some(u_walk), &format!("{unit}/sqrt(s)"), formula);
    remark_on_wander(channel, duration_s, time_constant_s);
}

fn remark_on_wander(channel: &mut EkfChannel, duration_s: f64, time_constant_s: f64) {
    if duration_s < 3.0 * time_constant_s {
        channel.remarks.push(format!(
            "the time constant of the wander is not much shorter than the record ({duration_s:.0} s): use the random \
             walk, not the standard deviation and time constant"
        ));
    }
    let second = channel.rests_on.split_once(" against ").map(|(_, second)| second.to_owned()).unwrap_or_default();
    channel.remarks.push(format!("the wander includes the integrated noise of {second}: it is an upper limit"));
}

/// Drift of the fit: the bias of the integrated channel.
fn bias(channel: &mut EkfChannel, measured: &MeasuredDelay, pair: &PairDelay) {
    let drifts: Vec<f64> = measured.pieces.iter().flat_map(|piece| piece.drift).map(|drift| drift.value).collect();
    if drifts.is_empty() || !drifts.iter().all(|drift| drift.is_finite()) {
        return;
    }
    let count = drifts.len() as f64;
    let value = (drifts.iter().map(|drift| drift * drift).sum::<f64>() / count).sqrt();
    let unit = if pair.kind == DelayPairKind::PositionAgainstVelocity { "m/s" } else { "m/s^2" };
    let formula = format!("root mean square of the drift of {} pieces and axes: bias of {}", drifts.len(), pair.second);
    push(channel, EkfValueKind::BiasStd, value, Some(value / (2.0 * count).sqrt()), unit, &formula);
}

fn delay(channel: &mut EkfChannel, pair: &PairDelay, measured: &MeasuredDelay, facts: &EkfChannelFacts) {
    let (estimate, formula) = match &facts.lateness_s {
        Some((estimate, datum)) => (*estimate, format!("how late the channel is, against {datum}")),
        None => {
            (measured.delay_s, format!("how much later than {}; a delay that both share cannot be seen", pair.second))
        }
    };
    push(channel, EkfValueKind::Delay, estimate.value, estimate.standard_uncertainty, "s", &formula);
}

fn push(
    channel: &mut EkfChannel,
    kind: EkfValueKind,
    value: f64,
    standard_uncertainty: Option<f64>,
    unit: &str,
    formula: &str,
) {
    let standard_uncertainty = standard_uncertainty.filter(|u| u.is_finite());
    if value.is_finite() {
        let (unit, formula) = (unit.to_owned(), formula.to_owned());
        channel.values.push(EkfValue { kind, value, standard_uncertainty, unit, formula });
    }
}

/// `√(2σ²/τ)`; zero if there is no wander.
fn walk_density(noise: &DelayNoise) -> Option<f64> {
    let (std, time_constant_s) = (noise.wander_std?, noise.time_constant_s?);
    (time_constant_s > 0.0).then(|| (2.0 * std * std / time_constant_s).sqrt())
}

/// A standard deviation, pooled over pieces and axes.
struct Pooled {
    value: f64,
    /// Standard uncertainty from the scatter of pieces and axes; 0 for a single one.
    scatter: f64,
}

/// Root of the mean variance of pieces and axes, each weighted by its duration. `None` if no piece has a value.
fn pooled(measured: &MeasuredDelay, of: impl Fn(&DelayNoise) -> Option<f64>) -> Option<Pooled> {
    let values = measured.pieces.iter().flat_map(|piece| piece.noise.iter().map(move |noise| (seconds(piece), noise)));
    let usable = |(weight, noise): (f64, &DelayNoise)| {
        let value = of(noise).unwrap_or(0.0);
        (weight > 0.0 && value.is_finite()).then_some((weight, value * value))
    };
    let variances: Vec<(f64, f64)> = values.filter_map(usable).collect();
    let weight: f64 = variances.iter().map(|(weight, _)| weight).sum();
    let mean = variances.iter().map(|(weight, variance)| weight * variance).sum::<f64>() / weight;
    let value = Some(mean.sqrt()).filter(|value| value.is_finite() && *value > 0.0)?;
    let square = |(w, variance): &(f64, f64)| (w * (variance - mean)).powi(2);
    let count = variances.len() as f64;
    let spread =
        if variances.len() > 1 { variances.iter().map(square).sum::<f64>() * count / (count - 1.0) } else { 0.0 };
    // d σ = d σ² / 2σ.
    Some(Pooled { value, scatter: spread.sqrt() / weight / (2.0 * value) })
}

fn seconds(piece: &DelayPiece) -> f64 {
    Some(piece.end_s - piece.start_s).filter(|seconds| seconds.is_finite()).map_or(0.0, |seconds| seconds.max(0.0))
}

#[cfg(test)]
mod tests;
