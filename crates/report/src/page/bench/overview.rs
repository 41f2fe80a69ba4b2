//! All channels in one table, Fig. 4, and whether the swing is suitable for a measurement.

use super::super::Head::{self, Number, Text};
use super::super::{basis, estimate, figure, finding, met_badge, no_number, or_why, plain, rows, table};
use super::channel_badge;
use crate::figure::{BenchFigures, ChannelFigures, main_component};
use crate::number;
use crate::text::shown;
use crate::verdict;
use maud::{Markup, html};
use record::{
    BenchFindings, ChannelDynamics, ComponentDynamics, DelayFinding, Estimate, GateCheck, ModelFinding, NoiseFinding,
    QualityGate, TimeBasis,
};

/// Maximum number of channels in a table; the record has all.
pub(super) const MOST_CHANNELS: usize = 60;

pub(super) fn section(
    findings: &BenchFindings,
    figures: &BenchFigures,
    shift: Option<&Markup>,
    doubts: &[String],
) -> Markup {
    html! {
        h2 id="results" { "Results" }
        (channels(findings, &figures.channels, doubts))
        p.note {
            "A positive delay is late: measured(t) = truth(t − delay). As seen: effective delay when the last value is \
             held. Smallest detectable: detected with a power of 80 %. Gain and noise are those of the component with \
             the most information about the delay. —: not available."
        }
        @if let Some(shift) = shift { (shift) }
        @if let Some(zoom) = &figures.zoom { (figure(zoom)) }
        @if let Some(whole) = &figures.whole { details { summary { "The whole record" } (figure(whole)) } }
        @if figures.zoom.is_none() && figures.whole.is_none() {
            p { "The record has no curve of a channel, so nothing is drawn." }
        }
    }
}

fn channels(findings: &BenchFindings, figures: &[ChannelFigures], doubts: &[String]) -> Markup {
    let head = [
        Text("Channel"),
        Text("Verdict"),
        Number("Delay (ms)"),
        Number("Smallest detectable (ms)"),
        Text("Delay or lag"),
        Number("Gain"),
        Text("Noise, standard deviation"),
        Text("Updates, stamps, measured against"),
    ];
    let both: Vec<_> = findings.channels.iter().zip(figures).collect();
    html! { div.compact { (channel_table(&both, &head, doubts)) } }
}

fn channel_table(both: &[(&ChannelDynamics, &ChannelFigures)], head: &[Head], doubts: &[String]) -> Markup {
    table(
        "All channels; ± is U with k = 2",
        head,
        rows(both, MOST_CHANNELS, head.len(), |(channel, figures)| row(channel, figures, doubts)),
    )
}

const NO_DELAY: &str = "not fitted";

fn row(channel: &ChannelDynamics, figures: &ChannelFigures, doubts: &[String]) -> Markup {
    let is_anchor = channel.is_anchor();
    let delay = channel.delay.as_ref().filter(|_| !is_anchor);
    let no_delay = if is_anchor { "the anchor" } else { NO_DELAY };
    let main = main_component(channel);
    html! {
        tr {
            th scope="row" {
                a href={ "#" (figures.anchor) "-channel" } { (shown(&channel.name)) }
            }
            td { (channel_badge(channel, doubts)) }
            td.n { @if is_anchor { (verdict::ZERO_BY_DEFINITION) } @else { (or_why(delay, NO_DELAY, delay_cell)) } }
            td.n { (or_why(delay, no_delay, |d| plain(d.minimum_detectable_s * 1e3, 2))) }
            td.any {
                @match channel.model.found() {
                    None if is_anchor => { (no_number(no_delay)) }
                    _ => { (finding(&channel.model, model_word)) }
                }
            }
            td.n {
                @if channel.lags().is_some() { (no_number("a lag's gain depends on the frequency")) }
                @else { (or_why(main.and_then(|c| Some((c, c.gain.as_ref()?))), "not fitted", gain_cell)) }
            }
            td.any { (or_why(main.and_then(|c| Some((c, c.noise.as_ref()?))), "not fitted", noise)) }
            td.any {
                (or_why(channel.update_rate_hz, "rate unknown", |hz| html! { (plain(hz, 4)) " Hz" })) ", "
                (channel.stamp_kind) ", " (against(channel))
            }
        }
    }
}

/// The delay, and the delay seen by a control loop that reads held values.
fn delay_cell(found: &DelayFinding) -> Markup {
    html! {
        (estimate(&verdict::in_millis(&verdict::delay(found))))
        @if let Some(seen) = &found.as_seen_s { div { "as seen " (estimate(&verdict::in_millis(seen))) } }
    }
}

/// The gain, with the component and the frequency that it stands for.
fn gain_cell((component, gain): (&ComponentDynamics, &Estimate)) -> Markup {
    html! {
        (estimate(gain))
        @if let Some(hz) = component.gain_frequency_hz {
            div { (shown(&component.name)) " at " (number::fixed(hz, 2)) " Hz" }
        }
    }
}

/// Ends of the interval of a delay, ms.
pub(super) fn interval_ms(found: &DelayFinding) -> String {
    number::interval(found.interval_95_s.map(|s| s * 1e3), found.standard_uncertainty_s * 1e3)
}

fn model_word(model: &ModelFinding) -> Markup {
    html! {
        @match &model.chosen {
            Some(name) => { (kind(name)) }
            None => { "not distinguished" }
        }
    }
}

/// The name of a candidate in words.
pub(super) fn kind(name: &str) -> Markup {
    let words = match name {
        "D" => "delay",
        "L" => "lag",
        "DL" => "delay and lag",
        "DLL" => "delay and two lags",
        "D2" => "delay and second-order filter",
        "DA" => "delay and moving average (half of it)",
        _ => "",
    };
    html! { (shown(name)) @if !words.is_empty() { ", " (words) } }
}

fn noise((component, noise): (&ComponentDynamics, &NoiseFinding)) -> Markup {
    let with_unit = |value| html! { (number::significant(value, 2)) "\u{a0}" (shown(&component.unit)) };
    html! {
        "white noise " (with_unit(noise.white_std))
        @if noise.wander_std > 0.0 {
            "; slow wander " (with_unit(noise.wander_std)) ", time constant " (number::significant(noise.time_constant_s, 2)) "\u{a0}s"
        }
    }
}

/// What the delay of a channel is measured against. The anchor has no other reference.
fn against(channel: &ChannelDynamics) -> Markup {
    match &channel.basis {
        TimeBasis::Anchor { channel: anchor } if *anchor == channel.name => html! { "the anchor itself" },
        other => basis(other),
    }
}

/// Checks, collapsed if all pass.
pub(super) fn folded(what: &str, all_pass: bool, table: &Markup) -> Markup {
    html! {
        @if all_pass { details { summary { "All passed: " (what) } (table) } } @else { (table) }
    }
}

/// Quality checks made before any verdict.
pub(super) fn gate(gate: &QualityGate) -> Markup {
    let check = |check: &GateCheck| {
        html! {
            tr {
                th scope="row" { (shown(&check.name)) }
                td { (met_badge(check.passed)) }
                td.any { (shown(&check.text)) }
            }
        }
    };
    let head = [Text("Check"), Text("Passed"), Text("Number, limit, what follows")];
    html! {
        h2 id="gate" { "Quality gate" }
        p {
            (number::counted(gate.swings, "full swing", "full swings")) "; nine tenths of the power of the bar's rate lie \
             between " (plain(gate.excited_band_hz[0], 2)) " and " (plain(gate.excited_band_hz[1], 2)) " Hz, its angle has \
             an rms frequency of " (plain(gate.rms_frequency_hz, 3)) " Hz."
        }
        @if gate.checks.is_empty() { p { "Nothing was checked." } }
        @else {
            (folded(&number::counted(gate.checks.len() as u64, "check", "checks"), gate.checks.iter().all(|c| c.passed),
                &table("Checked before any verdict", &head, rows(&gate.checks, 60, head.len(), check))))
        }
        @if !gate.not_observable.is_empty() {
            h3 { "What this swing cannot show, whatever the sensor" }
            ul.plain { @for text in gate.not_observable.iter().take(30) { li { (shown(text)) } } }
        }
    }
}
