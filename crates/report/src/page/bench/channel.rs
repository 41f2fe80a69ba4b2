//! The section of one channel.

use super::super::Head::{Number, Text};
use super::super::{
    basis, estimate, exact, fact, figure, finding, health, met_badge, no_number, or_why, plain, rows, table,
};
use super::overview::{MOST_CHANNELS, interval_ms, kind};
use super::{channel_badge, duration};
use crate::figure::{ChannelFigures, Figure, KINDS};
use crate::number;
use crate::text::{ended, shown};
use crate::verdict;
use maud::{Markup, html};
use record::{
    ChannelDynamics, ComponentDynamics, DelayFinding, Estimate, Finding, FitChecks, Injection, LatencyHistogram,
    ModelCandidate, ModelFinding, ResponseFinding, Stationarity, Verdict,
};

/// Maximum number of rows in each table of a channel; the record has all.
const MOST: usize = 40;

pub(super) fn section(channels: &[ChannelDynamics], figures: &[ChannelFigures], doubts: &[String]) -> Markup {
    html! {
        h2 id="channels" { "Channels" }
        @if channels.is_empty() { p { "None was found in the sensor's log." } }
        @else { (kinds(figures)) }
        @for (channel, figures) in channels.iter().zip(figures).take(MOST_CHANNELS) { (details(channel, figures, doubts)) }
    }
}

/// How to read the figures of a channel: one text for each kind of figure on the page.
fn kinds(figures: &[ChannelFigures]) -> Markup {
    let is_drawn = |kind: usize| figures.iter().any(|f| f.slots()[kind].is_some());
    html! {
        details {
            summary { "How to read the figures of a channel" }
            ul.plain {
                @for (_, (title, how)) in KINDS.iter().enumerate().filter(|(kind, _)| is_drawn(*kind)) {
                    li { b { (title) } ". " (how) }
                }
            }
        }
    }
}

/// Details of a channel, collapsed unless the channel is delayed.
fn details(channel: &ChannelDynamics, figures: &ChannelFigures, doubts: &[String]) -> Markup {
    let is_open = channel.verdict == Verdict::Delayed;
    html! {
        details.channel open=[is_open.then_some("open")] {
            summary { code { (shown(&channel.name)) } (channel_badge(channel, doubts)) (summary(channel)) }
            div id={ (figures.anchor) "-channel" } {
                p { (shown(&channel.reason)) }
                (delay_table(channel))
                h3 { "Components" }
                (components(channel))
                (optional(figures.components.as_ref()))
                h3 { "Delay or lag" }
                (finding(&channel.model, |found| model(channel, found)))
                h3 { "Frequency response, checks of the fit, delay over the record" }
                div.pair {
                    (optional(figures.hysteresis.as_ref()))
                    div { (optional(figures.response.as_ref())) (finding(&channel.response, bandwidth)) }
                    div { (optional(figures.residuals.as_ref())) (checks(channel.checks.as_ref())) }
                    (optional(figures.autocorrelation.as_ref()))
                    (optional(figures.objective.as_ref()))
                    (optional(figures.minimum.as_ref()))
                    div { (optional(figures.stationarity.as_ref())) (finding(&channel.stationarity, constancy)) }
                    div { (optional(figures.latency.as_ref())) p { "Latency: " (finding(&channel.latency, latency)) } }
                }
                h3 { "Injection and recovery" }
                (injections(channel))
            }
        }
    }
}

fn summary(channel: &ChannelDynamics) -> Markup {
    html! {
        @if channel.is_anchor() { (verdict::ZERO_BY_DEFINITION) }
        @else if let Some(found) = &channel.delay { (estimate(&verdict::in_millis(&verdict::delay(found)))) " ms" }
    }
}

fn optional(shown: Option<&Figure>) -> Markup {
    html! { @if let Some(shown) = shown { (figure(shown)) } }
}

// The delay

fn delay_table(channel: &ChannelDynamics) -> Markup {
    let facts = html! {
        @match &channel.delay {
            Some(_) if channel.is_anchor() => { (fact("Delay", verdict::ZERO_BY_DEFINITION)) }
            Some(found) => { (delay_facts(channel, found)) }
            None => { (fact("Delay", no_number(&channel.reason))) }
        }
        (fact("Standard uncertainty predicted before the fit",
            or_why(channel.predicted_s, "no component was expected to show it", |s| html! { (plain(s * 1e3, 2)) " ms" })))
        (fact("Jitter of the latency, standard deviation", finding(&channel.jitter_s, |j| html! { (estimate(&verdict::in_millis(j))) " ms" })))
        (fact("Measured against", html! { (basis(&channel.basis)) "; timestamps: " (channel.stamp_kind) ", clock " (channel.clock) }))
        (fact("Rows", html! {
            (number::count(channel.samples)) " measured"
            @if channel.held_rows > 0 { ", " (number::count(channel.held_rows)) " repeats of held values not used" }
        }))
        (fact("Rates", html! {
            (or_why(channel.rate_hz, "rows: unknown", |hz| html! { (plain(hz, 4)) " Hz rows" })) "; "
            (or_why(channel.update_rate_hz, "updates: unknown", |hz| html! { (plain(hz, 4)) " Hz updates" }))
        }))
        (fact("Rows not used, by reason", health::rejects(&channel.rejected)))
    };
    table(&format!("Delay of {}; ± is U with k = 2", channel.name), &[Text("Item"), Text("Value")], facts)
}

fn delay_facts(channel: &ChannelDynamics, found: &DelayFinding) -> Markup {
    let ms = |seconds: f64| html! { (plain(seconds * 1e3, 2)) " ms" };
    let held = |e: &Estimate| html! { (estimate(&verdict::in_millis(e))) " ms" };
    html! {
        (fact("Delay", html! { b { (estimate(&verdict::in_millis(&verdict::delay(found)))) " ms" } }))
        (fact("95 % interval (Student)", html! {
            (interval_ms(found)) " ms, " (plain(found.degrees_of_freedom, 3)) " degrees of freedom"
        }))
        (fact("Standard uncertainty", html! {
            (ms(found.standard_uncertainty_s)) ": the larger of " (ms(found.hessian_s)) " (Hessian) and "
            (ms(found.hac_s)) " (sandwich, HAC). It includes " (ms(found.reference_s)) " of the reference, "
            (ms(found.stamps_s)) " of the timestamps and " (ms(found.anchor_s)) " of the anchor, added in quadrature."
            @if found.change_s > 0.0 {
                " It also includes " (ms(found.change_s)) ", so that the interval covers the delay of every part of \
                 the record."
            }
        }))
        (fact("Cramér–Rao bound at the fitted noise", ms(found.crlb_s)))
        (fact("Effective delay when the last value is held", or_why(found.as_seen_s.as_ref(), not_held(channel), held)))
        (fact("Fit that ignores the holding", or_why(found.held_fit_s.as_ref(), not_held(channel), held)))
        (fact("Smallest detectable delay (power 80 %)", ms(found.minimum_detectable_s)))
        (fact("Margin of equivalence", html! { "±" (exact(found.deciding_margin_s() * 1e3)) " ms" }))
        @if channel.verdict == Verdict::Inconclusive {
            (fact("Record that would decide", or_why(found.deciding_length_s, "unknown", |s| html! { (duration(s)) })))
        }
    }
}

fn not_held(channel: &ChannelDynamics) -> &'static str {
    if channel.held_rows == 0 { "the channel is not held" } else { "not given" }
}

// Components

fn components(channel: &ChannelDynamics) -> Markup {
    let head = [
        Text("Component"),
        Text("Excited"),
        Number("Delay alone (ms)"),
        Number("Gain"),
        Number("Offset"),
        Number("Drift (per s)"),
        Number("White σ"),
        Number("Wander σ, in (s)"),
        Number("σ at rest"),
        Number("Resolution"),
    ];
    html! {
        @if channel.components.is_empty() { p { "None." } }
        @else {
            div.compact {
                (table(&format!("Components of {}, each in its unit; ± is U with k = 2", channel.name), &head,
                    rows(&channel.components, MOST, head.len(), component)))
            }
        }
    }
}

fn component(c: &ComponentDynamics) -> Markup {
    let noise = c.noise.as_ref();
    let unfitted = if c.excited { "not fitted" } else { "not excited" };
    let wander = noise.filter(|n| n.wander_std > 0.0);
    let no_wander = if noise.is_some() { "none found" } else { "not fitted" };
    html! {
        tr {
            th scope="row" { (shown(&c.name)) " (" (shown(&c.unit)) ")" }
            td.any { (met_badge(c.excited)) @if !c.why_not.is_empty() { ": " (shown(&c.why_not)) } }
            td.n { (or_why(c.delay_s.as_ref(), unfitted, |d| estimate(&verdict::in_millis(d)))) }
            td.n { (or_why(c.gain.as_ref(), unfitted, estimate)) }
            td.n { (or_why(c.offset.as_ref(), "not fitted", estimate)) }
            td.n { (or_why(c.drift.as_ref(), "not fitted", estimate)) }
            td.n { (or_why(noise, "not fitted", |n| plain(n.white_std, 2))) }
            td.n { (or_why(wander, no_wander, |n| html! { (plain(n.wander_std, 2)) ", " (plain(n.time_constant_s, 2)) })) }
            td.n { (or_why(noise.and_then(|n| n.static_std), if noise.is_some() { "never at rest" } else { unfitted }, |s| plain(s, 2))) }
            td.n { (or_why(noise.and_then(|n| n.resolution), "unknown", |r| plain(r, 2))) }
        }
    }
}

// Dynamics

fn model(channel: &ChannelDynamics, model: &ModelFinding) -> Markup {
    let row = |candidate: &ModelCandidate| {
        html! {
            tr {
                th scope="row" {
                    (kind(&candidate.name))
                    @if model.chosen.as_deref() == Some(candidate.name.as_str()) { " " b { "(chosen)" } }
                }
                td.n { (plain(candidate.delta_bic, 3)) }
                td.n { (or_why(candidate.delay_s.as_ref(), "zero by definition", |d| estimate(&verdict::in_millis(d)))) }
                td.n {
                    @if candidate.lags_s.is_empty() { (no_number("no lag")) }
                    @for (i, lag) in candidate.lags_s.iter().enumerate() {
                        @if i > 0 { "; " } (estimate(&verdict::in_millis(lag)))
                    }
                }
                td.n { (estimate(&candidate.gain)) }
            }
        }
    };
    let head = [Text("Candidate"), Number("ΔBIC"), Number("Delay (ms)"), Number("Lags or filter (ms)"), Number("Gain")];
    html! {
        p { (shown(&model.text)) }
        p { "Delay and lags together, the group delay at low frequency: " b { (estimate(&verdict::in_millis(&model.sum_s))) " ms" } "." }
        (table(&format!("Candidates for {}; ± is U with k = 2", channel.name), &head, rows(&model.candidates, MOST, head.len(), row)))
    }
}

fn bandwidth(found: &ResponseFinding) -> Markup {
    let hz = found.bandwidth_hz.map(|value| Estimate { value, standard_uncertainty: found.bandwidth_u_hz });
    html! {
        p {
            "Bandwidth (−3 dB) of the fitted model: "
            b { @match &hz { Some(hz) => { (estimate(hz)) " Hz" } None => { (shown(&found.bandwidth)) } } } "."
        }
    }
}

fn checks(checks: Option<&FitChecks>) -> Markup {
    let second = |checks: &FitChecks| match checks.second_minimum_s {
        Some(s) => {
            html! { " Another minimum nearly as good at " (plain(s * 1e3, 4)) " ms: the delay is ambiguous by a swing." }
        }
        None => html! { " No other minimum is nearly as good." },
    };
    html! {
        @match checks {
            Some(checks) => {
                p {
                    "Whitened residuals: Ljung–Box " (number::probability(checks.ljung_box_p)) ", kurtosis "
                    (plain(checks.kurtosis, 3)) " (3 if Gaussian), " (number::percent(checks.downweighted_share))
                    "\u{a0}% of the samples downweighted by the robust weights." (second(checks))
                }
            }
            None => { p { (no_number("nothing was fitted, so there is no fit to check")) } }
        }
    }
}

fn constancy(found: &Stationarity) -> Markup {
    html! {
        p {
            (ended(&found.text)) " Slope: " (estimate(&number::scaled(&found.slope, 60e3))) " ms/min."
        }
    }
}

fn latency(found: &LatencyHistogram) -> Markup {
    let d = &found.latency_s;
    html! {
        (shown(&found.text)) ". Median " (health::millis(d.median)) " ms, 1st to 99th percentile "
        (health::millis(d.p01)) " to " (health::millis(d.p99)) " ms, largest " (health::millis(d.max)) " ms."
    }
}

fn injections(channel: &ChannelDynamics) -> Markup {
    let injections = &channel.injections;
    let row = |i: &Injection| {
        html! {
            tr {
                td.n { (exact(i.injected_s * 1e3)) }
                td.n { (exact(i.injected_gain)) }
                @match &i.recovered {
                    Finding::Found(found) => {
                        td.n { (estimate(&verdict::in_millis(&found.delay_error_s))) }
                        td.n { (expanded_interval(&verdict::in_millis(&found.delay_error_s))) }
                        td.n { (estimate(&found.gain_error)) }
                        td.n { (expanded_interval(&found.gain_error)) }
                    }
                    Finding::CannotTell(why) => { td.any colspan="4" { (no_number(why)) } }
                }
            }
        }
    };
    let head = [
        Number("Delay added (ms)"),
        Number("Gain multiplied by"),
        Number("Recovered − added (ms)"),
        Number("from, to (ms)"),
        Number("Recovered − injected gain"),
        Number("from, to"),
    ];
    html! {
        @if injections.is_empty() { p { (no_number("the rig file asks for no injection")) } }
        @else {
            (table(&format!("Known delays and gains added to {} and measured again; ± is U with k = 2", channel.name), &head,
                rows(injections, MOST, head.len(), row)))
            p.note { "Added to the second half of the record and measured against the first. Expected: 19 of 20 \
                      intervals contain zero." }
        }
    }
}

fn expanded_interval(error: &Estimate) -> Markup {
    or_why(error.standard_uncertainty.filter(|u| *u > 0.0), "no U", |u| {
        let half = number::COVERAGE_FACTOR * u;
        html! { (number::interval([error.value - half, error.value + half], u)) }
    })
}
