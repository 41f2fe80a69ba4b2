//! The method in words and equations, with the settings that were used.

use super::estimate;
use crate::number;
use crate::text::shown;
use crate::verdict::in_millis;
use maud::{Markup, html};
use record::{FlightRecord, ReplayRecord, StartRule};

/// The method section, ready to paste into a report.
pub(super) fn section(record: &FlightRecord, replay: &ReplayRecord) -> Markup {
    html! {
        h2 id="method" { "Method" }
        (delay_paragraph(record, replay))
        (compensators(replay))
        (rules(replay))
        (frame(replay))
        p {
            "Each number is given with its expanded uncertainty U = k u, k = 2, where u is the standard uncertainty in \
             the record. For rms values u is a delete-one jackknife over 8 to 20 stretches of the flight, each at \
             least four correlation times of the error long: U covers about 95 % of flights like this one. Where the \
             error changes so slowly that fewer than 8 such stretches fit into the flight, no U is given: one flight \
             is too short. Nor is one given where a few samples hold most of an rms value, as after a gap. Rms values are 2‑D: north and east together. "
        }
    }
}

fn delay_paragraph(record: &FlightRecord, replay: &ReplayRecord) -> Markup {
    let settings = &replay.settings;
    let apart = record.lateness.as_ref().and_then(|l| l.position_minus_velocity_s);
    html! {
        p {
            code { (shown(&replay.pair.position)) } " is compensated with " code { (shown(&replay.pair.velocity)) }
            @if let Some(apart) = apart {
                ". The position is " (estimate(&in_millis(&apart))) "\u{a0}ms later than the velocity"
            }
            ". To first order only the lateness of the position counts, not that of the velocity. A positive delay means late: measured(t) = truth(t − Td), with Td = "
            (number::significant(settings.delay.millis(), 4)) " ms"
            @match settings.delay_uncertainty_s {
                Some(u) => { ", standard uncertainty " (number::significant(u * 1e3, 2)) " ms" }
                None => { ", no uncertainty stated" }
            }
            " (" (shown(&settings.delay_source)) "). "
            @match &replay.pair.reference {
                Some(reference) => { "Errors are against " code { (shown(reference)) } ", which no compensator used." }
                None => { "There is no independent position in the log, so no error is given." }
            }
        }
    }
}

fn compensators(replay: &ReplayRecord) -> Markup {
    let has = |start: &str| replay.compensators.iter().any(|c| c.name.starts_with(start));
    html! {
        @if has("pade") {
            p { "The paper's compensator (Park and Lee 2010) adds to the raw position the distance flown during the \
                 delay, from velocity, with the delay's transfer function replaced by its Padé [1/1] approximation and \
                 made discrete with Tustin's rule:" }
            p.equation { "x_est = p + G v,  G(s) = (1 − e^(−s Td)) / s ≈ Td / ((Td/2) s + 1)" }
        }
        @if has("pade-1-1-as-seen") {
            p { "A loop that holds each fix until the next gets it later still, by its mean age; the compensator is \
                 therefore run a second time with Td and that age together." }
        }
        @if has("exact") {
            p { "The exact asynchronous form adds to each fix p_j, stamped t_j, the integral I of velocity over the \
             delay and over the time since the fix; it needs no approximation and no held position:" }
            p.equation { "x_est(t) = p_j + I(t) − I(t_j − Td),  I(t) = ∫ v dt (trapezoids)" }
        }
    }
}

fn rules(replay: &ReplayRecord) -> Markup {
    let settings = &replay.settings;
    html! {
        p {
            (start_rule(settings.start)) " "
            "Velocity gaps of up to " (number::significant(settings.bridge_s, 3)) " s are bridged by a straight line; \
             after a longer one the output is invalid and the compensators restart. "
            "Gaps bridged here: " (number::count(replay.coverage.bridged_gaps))
            "; restarts: " (number::count(replay.coverage.restarts)) ". "
            "Fixes that jump against integrated velocity by more than five sigma are kept and counted."
        }
    }
}

fn start_rule(start: StartRule) -> &'static str {
    match start {
        StartRule::Warm => {
            "Warm start: the first velocity is assumed to have been flown for long before, so the correction starts at \
             Td v₀."
        }
        StartRule::Cold => {
            "Cold start: the filter starts at zero, so the correction is short of Td v₀ by Td v₀ e^(−2t/Td) at first."
        }
        StartRule::InvalidUntilTd => "The output is invalid until velocity covers Td.",
    }
}

fn frame(replay: &ReplayRecord) -> Markup {
    html! {
        p {
            "Time zero is " (instant(replay.origin_ns, replay.clock)) " (" (replay.origin_ns) "\u{a0}ns). "
            @match &replay.origin {
                Some(origin) => {
                    "North and east are in the plane that touches WGS 84 at \
                     latitude " (number::fixed(origin.latitude.to_degrees(), 6))
                    "°, longitude " (number::fixed(origin.longitude.to_degrees(), 6)) "°, height "
                    (number::fixed(origin.height, 1)) " m."
                }
                None => { "North and east are the log's own local coordinates; their origin is not in the log." }
            }
        }
    }
}

/// A timestamp as UTC to the microsecond if its clock is UTC, otherwise in seconds of its clock.
pub(super) fn instant(stamp_ns: i64, clock: flight::Clock) -> String {
    let seconds = || format!("{} s, clock {clock}", number::fixed(stamp_ns as f64 * 1e-9, 6));
    match clock {
        flight::Clock::Unix => jiff::Timestamp::from_nanosecond(i128::from(stamp_ns))
            .map_or_else(|_| seconds(), |time| format!("{} UTC", time.strftime("%Y-%m-%d %H:%M:%S%.6f"))),
        _ => seconds(),
    }
}
