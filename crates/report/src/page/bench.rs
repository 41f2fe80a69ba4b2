//! The page of one bench record.

mod bench_method;
mod bench_provenance;
mod channel;
mod clocks;
mod explore;
mod geometry;
mod mount;
mod overview;
mod reference;

pub(super) use mount::soft_iron;

use super::{
    Needs, anchor_badge, badge, contents, document, estimate, health, in_doubt, sensor_name, verdict_badge,
    verdict_or_doubt,
};
use crate::figure::{BenchFigures, place_in_paper};
use crate::number;
use crate::site::Site;
use crate::text::{href, shown, shown_block};
use crate::verdict;
use flight::Quantity;
use maud::{Markup, PreEscaped, html};
use record::{
    BenchFindings, BenchOutcome, BenchRecord, ChannelDynamics, DelayFinding, Finding, GateCheck, TimeBasis, Verdict,
};

/// What the page of a bench record needs besides the record.
#[derive(Debug, Clone, Copy)]
pub struct BenchPage<'a> {
    /// Title: the name that users know.
    pub name: &'a str,
    /// Results of the analysis.
    pub record: &'a BenchRecord,
    /// Command that regenerates this page.
    pub command: &'a str,
    /// Path of the parent page, if there is one; not yet percent-encoded.
    pub index_href: Option<&'a str>,
}

/// The page of a bench record: `index.html` with its figures inline, and each figure also
/// as a file in `figures/` (`fig-4`, `fig-4-whole`, `geometry-side`, `geometry-above`, `angle`, `acceleration`, and for
/// each channel its name followed by `-components`, `-hysteresis`, `-response`, `-residuals`, `-autocorrelation`,
/// `-objective`, `-minimum`, `-stationarity`, `-latency`). A figure without curves in the record is omitted.
#[must_use]
pub fn bench_site(page: &BenchPage) -> Site {
    let record = for_people(page.record);
    let page = &BenchPage { record: &record, ..*page };
    let figures = page.record.findings.as_ref().map(BenchFigures::of).unwrap_or_default();
    let mut site = Site::default();
    for figure in figures.iter() {
        site.add_figure(figure);
    }
    let shift = page.record.findings.as_ref().and_then(explore::section);
    let needs = if shift.is_some() { Needs::Bench } else { Needs::Nothing };
    let body = body(page, &figures, shift.as_ref());
    site.add("index.html", document(&format!("{} — flightlag bench", page.name), needs, body));
    site
}

/// The record with its channels in the order of the paper and fields in microtesla (0.00000020 T is unreadable).
pub(super) fn for_people(record: &BenchRecord) -> BenchRecord {
    const MICRO: f64 = 1e6;
    let mut record = record.clone();
    if let Some(findings) = &mut record.findings {
        findings.channels.sort_by_key(|c| place_in_paper(c.quantity).unwrap_or(usize::MAX));
        in_microtesla(findings);
    }
    let channels = record.findings.iter_mut().flat_map(|f| &mut f.channels);
    for component in channels.flat_map(|c| &mut c.components).filter(|c| c.unit == "T") {
        component.unit = "µT".to_owned();
        if let Some(overlay) = &mut component.overlay {
            overlay.shifts.rms.iter_mut().for_each(|rms| *rms *= MICRO);
            if let Some(wander) = &mut overlay.wander {
                (wander.rms, wander.range_in_view) = (wander.rms * MICRO, wander.range_in_view * MICRO);
            }
        }
        let overlay = component.overlay.iter_mut().flat_map(|o| [&mut o.reference, &mut o.measured]);
        let curves =
            component.curves.iter_mut().chain(&mut component.zoom).chain(&mut component.residual).chain(overlay);
        curves.flat_map(|c| &mut c.y).for_each(|y| *y *= MICRO);
        for estimate in [&mut component.offset, &mut component.drift].into_iter().flatten() {
            estimate.value *= MICRO;
            estimate.standard_uncertainty = estimate.standard_uncertainty.map(|u| u * MICRO);
        }
        if let Some(noise) = &mut component.noise {
            noise.wander_std *= MICRO;
            noise.white_std *= MICRO;
            noise.static_std = noise.static_std.map(|s| s * MICRO);
            noise.resolution = noise.resolution.map(|s| s * MICRO);
        }
    }
    record
}

/// Whether the magnetometer of a record is in tesla, not in a scale of its own.
fn is_tesla(findings: &BenchFindings) -> bool {
    let magnetic = findings.channels.iter().filter(|c| c.quantity == Quantity::MagneticField);
    magnetic.flat_map(|c| &c.components).any(|c| matches!(c.unit.as_str(), "T" | "µT"))
}

fn in_microtesla(findings: &mut BenchFindings) {
    const MICRO: f64 = 1e6;
    let is_tesla = is_tesla(findings);
    let Finding::Found(iron) = &mut findings.mount.magnetometer else { return };
    if !is_tesla {
        return;
    }
    iron.residual_rms *= MICRO;
    for axis in &mut iron.hard_iron {
        if let Finding::Found(found) = axis {
            *found = number::scaled(found, MICRO);
        }
    }
}

fn body(page: &BenchPage, figures: &BenchFigures, shift: Option<&Markup>) -> Markup {
    let record = page.record;
    let doubts = record.doubts();
    html! {
        @if let Some(index) = page.index_href {
            nav aria-label="Above this page" { a href=(href(index)) { "← All records" } }
        }
        (contents(parts(record)))
        main {
            h1 { (shown(page.name)) }
            p.note {
                (shown(&sensor_name(&record.sensor))) " on the rig “" (shown(&record.rig.title)) "”"
                @if let Some(date) = &record.date { ", " (shown(date)) } "."
            }
            (strip(record, &doubts))
            (first_words(record, &doubts))
            @if let Some(findings) = &record.findings { (found(findings, figures, shift, &doubts)) }
            (logs(record))
            (health::notices_section(&record.notices))
            @if let Some(findings) = &record.findings { (bench_method::section(findings)) }
            (bench_provenance::section(page))
        }
    }
}

fn parts(record: &BenchRecord) -> &'static [(&'static str, &'static str)] {
    const ALL: [(&str, &str); 11] = [
        ("results", "Results"),
        ("gate", "Quality gate"),
        ("geometry", "Rig"),
        ("channels", "Channels"),
        ("clocks", "Clocks"),
        ("reference", "Reference"),
        ("mount", "Mount"),
        ("method", "Method"),
        ("health", "Data health"),
        ("notices", "Notices"),
        ("provenance", "Provenance"),
    ];
    if record.findings.is_some() { &ALL } else { &ALL[8..] }
}

fn found(findings: &BenchFindings, figures: &BenchFigures, shift: Option<&Markup>, doubts: &[String]) -> Markup {
    html! {
        (overview::section(findings, figures, shift, doubts))
        (overview::gate(&findings.gate))
        (geometry::section(findings, figures))
        (channel::section(&findings.channels, &figures.channels, doubts))
        (clocks::section(&findings.clocks))
        (reference::section(findings, figures))
        (mount::section(&findings.mount, &findings.flexibility, is_tesla(findings)))
    }
}

/// Whether the delay of a channel is in doubt: because of faults of the record (`doubts`), or because it changes.
fn is_in_doubt(channel: &ChannelDynamics, doubts: &[String]) -> bool {
    channel.delay.is_some() && !channel.is_anchor() && (!doubts.is_empty() || channel.changing_delay_s().is_some())
}

/// Verdict on the delay of a channel; the anchor has none.
fn channel_badge(channel: &ChannelDynamics, doubts: &[String]) -> Markup {
    match channel.is_anchor() {
        true => anchor_badge(),
        false => verdict_or_doubt(channel.verdict, is_in_doubt(channel, doubts)),
    }
}

/// Number of channels with each verdict, and the state of the data.
fn strip(record: &BenchRecord, doubts: &[String]) -> Markup {
    const ALL: [Verdict; 5] =
        [Verdict::Delayed, Verdict::Early, Verdict::Inconclusive, Verdict::EquivalentToZero, Verdict::NotMeasurable];
    let channels = record.findings.iter().flat_map(|f| &f.channels);
    let sure = channels.clone().filter(|c| !c.is_anchor() && !is_in_doubt(c, doubts));
    let anchors = channels.clone().filter(|c| c.is_anchor()).count() as u64;
    let count = |verdict| sure.clone().filter(|c| c.verdict == verdict).count() as u64;
    let doubtful = channels.filter(|c| is_in_doubt(c, doubts)).count() as u64;
    html! {
        div.strip role="status" {
            @match &record.outcome {
                BenchOutcome::Measured if doubtful > 0 => { (badge("unsure", "!", "Measured")) }
                BenchOutcome::Measured => { (badge("ok", "✓", "Measured")) }
                BenchOutcome::NotMeasurable { .. } => { (badge("unsure", "○", "Not measurable")) }
                BenchOutcome::Failed { .. } => { (badge("bad", "✗", "Failed")) }
            }
            @if doubtful > 0 { span { (in_doubt()) " " (number::counted(doubtful, "channel", "channels")) } }
            @for verdict in ALL {
                @if count(verdict) > 0 { span { (verdict_badge(verdict)) " " (number::counted(count(verdict), "channel", "channels")) } }
            }
            @if anchors > 0 { span { (anchor_badge()) " " (number::counted(anchors, "channel", "channels")) } }
            (health::notice_words(&record.notices))
        }
    }
}

/// The answer, or the reason why there is no result.
fn first_words(record: &BenchRecord, doubts: &[String]) -> Markup {
    html! {
        @match &record.outcome {
            BenchOutcome::Measured => {}
            BenchOutcome::NotMeasurable { reason } => { p.why.unsure { (shown_block(reason)) } }
            BenchOutcome::Failed { reason } => { p.why { (shown_block(reason)) } }
        }
        @match &record.findings {
            Some(findings) => { (answer(findings, doubts)) }
            None if record.outcome == BenchOutcome::Measured => {
                p.why { "The record says measured, but has no findings." }
            }
            None => {}
        }
        @if record.notices.any_loss() {
            p { "Some logged data could not be read. The numbers below use only what could be read; what was lost is \
                 listed under " a href="#health" { "Data health" } " and " a href="#notices" { "Notices" } "." }
        }
    }
}

/// The answer for each channel in one sentence. Channels that are late or early come first.
fn answer(findings: &BenchFindings, doubts: &[String]) -> Markup {
    let of = |verdict| findings.channels.iter().filter(move |c| c.verdict == verdict && !c.is_anchor());
    let failed: Vec<&GateCheck> =
        findings.gate.checks.iter().filter(|c| !c.passed && !c.is_of_wrong_motion()).collect();
    html! {
        @if !doubts.is_empty() {
            p.answer {
                (in_doubt()) " " @for what in doubts { (shown(what)) ". " }
                "Every delay below is in doubt. Correct the named cause and measure again."
            }
        }
        @for channel in of(Verdict::Delayed).chain(of(Verdict::Early)) { (displaced(channel)) }
        (group("On time, each within its margin: ", of(Verdict::EquivalentToZero).collect(), on_time))
        (group("Not decided: ", of(Verdict::Inconclusive).collect(), undecided))
        (group("Not measurable: ", of(Verdict::NotMeasurable).collect(), |c| html! { " (" (shown(c.reason.trim_end_matches('.'))) ")" }))
        @if findings.channels.is_empty() { p.answer { "No channel could be measured." } }
        p.answer { (shown(&findings.clocks.statement)) }
        @for check in failed {
            p.answer {
                (badge("unsure", "!", "Quality gate")) " " (shown(&check.name)) ": " (shown(&check.text)) ". See " a href="#gate" { "Quality gate" } "."
            }
        }
    }
}

fn displaced(channel: &ChannelDynamics) -> Markup {
    let (word, sign) = if channel.verdict == Verdict::Early { ("early", -1.0) } else { ("late", 1.0) };
    html! {
        p.answer {
            b { code { (shown(&channel.name)) } " is " (word) }
            @match &channel.delay {
                Some(found) => {
                    b { " by " (size(found, sign)) "\u{a0}ms" } " (k = 2), 95 % interval of the delay "
                    (number::interval(found.interval_95_s.map(|s| s * 1e3), found.standard_uncertainty_s * 1e3)) " ms"
                    @if let TimeBasis::Anchor { channel } = &channel.basis { ", relative to " code { (shown(channel)) } }
                    "."
                    @if let Some([least, most]) = channel.changing_delay_s() {
                        " " (in_doubt()) " The delay changes over the record, from " (number::fixed(1e3 * least, 1)) " to "
                        (number::fixed(1e3 * most, 1)) " ms in windows. One number does not describe it."
                    } @else if let Some((model, _)) = channel.lags() {
                        " That is the pure delay that fits this swing best. The channel has a lag (" (shown(&model.text))
                        "): slow motion is " b { (estimate(&verdict::in_millis(&model.sum_s))) " ms" } " late."
                    }
                    @if let Some(seen) = &found.as_seen_s {
                        " A loop that reads the held value sees a delay of " (estimate(&verdict::in_millis(seen)))
                        " ms."
                    }
                }
                None => { "; the record has no number." }
            }
        }
    }
}

fn size(found: &DelayFinding, sign: f64) -> Markup {
    estimate(&number::scaled(&verdict::delay(found), sign * 1e3))
}

fn group(title: &str, channels: Vec<&ChannelDynamics>, say: fn(&ChannelDynamics) -> Markup) -> Markup {
    html! {
        @if !channels.is_empty() {
            p.answer {
                b { (title) }
                @for (i, channel) in channels.iter().enumerate() {
                    @if i > 0 { "; " }
                    code { (shown(&channel.name)) } (say(channel))
                }
                "."
            }
        }
    }
}

fn on_time(channel: &ChannelDynamics) -> Markup {
    html! {
        @if let Some(found) = &channel.delay {
            " " (size(found, 1.0)) "\u{a0}ms within ±" (number::significant(found.deciding_margin_s() * 1e3, 3)) "\u{a0}ms"
        }
    }
}

fn undecided(channel: &ChannelDynamics) -> Markup {
    html! {
        @if let Some(found) = &channel.delay {
            " " (size(found, 1.0)) " ms; smallest delay that it could show "
            (number::significant(found.minimum_detectable_s * 1e3, 2)) "\u{a0}ms, margin ±" (number::significant(found.margin_s * 1e3, 3)) "\u{a0}ms"
            @if let Some(length) = found.deciding_length_s.filter(|s| *s <= 3600.0) { ", " (duration(length)) " of record would decide" }
        }
    }
}

/// Duration of a record in readable units.
fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 180.0 => format!("{} s", number::significant(s, 2)),
        s if s < 7200.0 => format!("{} min", number::significant(s / 60.0, 2)),
        s => format!("{} h", number::significant(s / 3600.0, 2)),
    }
}

/// Adds the log number to the label of each region, because two logs have the same tables. Text cannot contain the
/// attribute, because its quotes are escaped.
fn numbered_regions(number: usize, health: Markup) -> Markup {
    PreEscaped(health.into_string().replace("aria-label=\"", &format!("aria-label=\"Log {number}: ")))
}

fn logs(record: &BenchRecord) -> Markup {
    html! {
        h2 id="health" { "Data health" }
        @if record.logs.is_empty() { p { "No log could be opened, so its data are unknown." } }
        @for (number, log) in (1..).zip(&record.logs) {
            h3 { "Log of " (shown(&log.role)) }
            (health::channel_map(log.binding.as_ref()))
            (numbered_regions(number, health::log_health(&log.health, log.binding.as_ref())))
        }
    }
}
