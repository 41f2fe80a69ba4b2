//! The encoder and the reference motion computed from it.

use super::super::Head::Text;
use super::super::{estimate, exact, fact, figure, no_number, or_why, plain, table};
use crate::figure::BenchFigures;
use crate::number;
use crate::text::shown;
use maud::{Markup, html};
use record::{BenchFindings, Estimate, ReferenceFinding};

pub(super) fn section(findings: &BenchFindings, figures: &BenchFigures) -> Markup {
    let reference = &findings.reference;
    let facts = html! { (encoder(reference, findings)) (geometry(reference)) (surroundings(reference)) };
    html! {
        h2 id="reference" { "Reference motion" }
        (table("Encoder, smoother, site", &[Text("Item"), Text("Value")], facts))
        @for shown in [&figures.angle, &figures.acceleration].into_iter().flatten() { (figure(shown)) }
    }
}

fn encoder(reference: &ReferenceFinding, findings: &BenchFindings) -> Markup {
    let [angle, rate, acceleration] = reference.uncertainty;
    html! {
        (fact("Encoder", html! {
            code { (shown(&reference.channel)) } ", clock " (findings.clock) ": " (number::count(reference.samples))
            " samples in " (plain(reference.duration_s, 4)) " s, " (plain(reference.rate_hz, 4)) " Hz"
        }))
        (fact("Counts per revolution", html! {
            (exact(reference.counts_per_rev)) " (" (shown(&reference.counts_source)) ")"
        }))
        (fact("Spectral density of the snap, log₁₀ q", html! {
            (plain(reference.log10_q, 4)) " (rad²/s⁷), by generalised cross-validation"
        }))
        (fact("Encoder − smoothed, rms", html! {
            (plain(reference.residual_rms_counts, 3)) " counts; 0.289 is a perfect quantiser"
        }))
        (fact("Uncertainty of the smoothed motion (median, one sigma)", html! {
            "angle " (plain(angle * 1e3, 2)) " mrad, rate " (plain(rate, 2)) " rad/s, acceleration "
            (plain(acceleration, 2)) " rad/s²"
        }))
    }
}

fn geometry(reference: &ReferenceFinding) -> Markup {
    let [largest, smallest] = reference.angle_range_rad;
    html! {
        (fact("Bar angle, smallest to largest", html! {
            (number::fixed(smallest.min(largest).to_degrees(), 1)) "° to " (number::fixed(largest.max(smallest).to_degrees(), 1)) "°"
        }))
        (fact("Sign", html! {
            @if reference.sign < 0.0 { "−1: counts fall as the angle rises" } @else { "+1: counts rise with the angle" }
            " (" (shown(&reference.sign_source)) ")"
        }))
        (fact("Bar angle at count zero", html! { (degrees(&reference.zero_rad)) " (" (shown(&reference.zero_source)) ")" }))
        (fact("Azimuth of the swing plane, from north over east", match &reference.azimuth_rad {
            Some(azimuth) => html! {
                (degrees(&Estimate { value: azimuth.value.rem_euclid(std::f64::consts::TAU), ..*azimuth })) " (" (shown(&reference.azimuth_source)) ")"
            },
            None => html! { (no_number("no channel needs it")) },
        }))
    }
}

fn surroundings(reference: &ReferenceFinding) -> Markup {
    html! {
        (fact("Gravity", html! { (plain(reference.gravity_mps2, 7)) " m/s² (" (shown(&reference.gravity_source)) ")" }))
        (fact("Magnetic field north, east, down", html! {
            (or_why(reference.field_t, "fitted, not given", |field| html! {
                @for (i, component) in field.into_iter().enumerate() {
                    @if i > 0 { ", " } (plain(component * 1e6, 4))
                }
                " µT"
            }))
            " (" (shown(&reference.field_source)) ")"
        }))
    }
}

fn degrees(angle: &Estimate) -> Markup {
    html! { (estimate(&number::scaled(angle, 1f64.to_degrees()))) "°" }
}
