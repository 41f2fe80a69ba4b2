//! How the sensor's timestamps were related to the encoder's clock: what is absolute and what is relative.

use super::super::Head::Text;
use super::super::{basis, estimate, fact, finding, health, no_number, or_why, plain, table};
use crate::number;
use crate::text::shown;
use maud::{Markup, html};
use record::{ClockFinding, Estimate, HullFinding, PpsFinding, TimeBasis};

pub(super) fn section(clocks: &ClockFinding) -> Markup {
    let facts = html! {
        (fact("Delays are measured against", basis(&clocks.basis)))
        (fact("Delays are", what_they_are(&clocks.basis)))
        (fact("Skew of the sensor's clock", finding(&clocks.skew, ppm)))
        (fact("Lag of the anchor against the encoder as logged",
            or_why(clocks.anchor_lag_s.as_ref(), "no anchor was needed", |lag| html! {
                (estimate(lag)) " s: an offset of the clocks and the anchor's own delay together"
            })))
    };
    html! {
        h2 id="clocks" { "Clocks" }
        p { (shown(&clocks.statement)) }
        (table("Basis of time", &[Text("Item"), Text("Value")], facts))
        h3 { "Device time to arrival" }
        @match &clocks.hull {
            Some(found) => { (hull(found)) }
            None => { p { (no_number("device time and arrival are not both logged")) } }
        }
        h3 { "Pulse per second" }
        @match &clocks.pps {
            Some(found) => { (pps(found)) }
            None => { p { (no_number("no pulse per second was logged")) } }
        }
    }
}

fn what_they_are(basis: &TimeBasis) -> Markup {
    match basis {
        TimeBasis::OneClock => html! { "absolute, except for the timestamping by that one clock" },
        TimeBasis::Pps => html! { "absolute, except for the edge of the pulse" },
        TimeBasis::FastestArrivals => html! { "absolute, but including the least transport latency" },
        TimeBasis::Anchor { channel } => html! {
            "relative: delay minus that of " code { (shown(channel)) } ", which is assumed to be on time"
        },
    }
}

/// Clock skew (seconds gained per second) in parts per million.
fn ppm(skew: &Estimate) -> Markup {
    html! { (estimate(&number::scaled(skew, 1e6))) " ppm (positive gains)" }
}

fn hull(found: &HullFinding) -> Markup {
    let d = &found.latency_s;
    let facts = html! {
        (fact("Channel", html! { code { (shown(&found.channel)) } }))
        (fact("Clocks", html! { "device: " (found.device) "; arrival: " (found.arrival) }))
        (fact("Arrival − device time on the hull, at the middle", html! {
            (number::fixed(found.offset_s, 6)) " s; it includes the least transport latency"
        }))
        // If the device clock gains, arrival minus device time decreases.
        (fact("Skew of the device clock", html! { (plain(-found.skew * 1e6, 3)) " ppm (positive gains)" }))
        (fact("Arrival above the fastest", html! {
            "median " (health::millis(d.median)) " ms, 1st to 99th percentile " (health::millis(d.p01)) " to "
            (health::millis(d.p99)) " ms, largest " (health::millis(d.max)) " ms"
        }))
        @if !found.remark.is_empty() { (fact("Remark", shown(&found.remark))) }
    };
    table("Line of the fastest arrivals (lower convex hull)", &[Text("Item"), Text("Value")], facts)
}

fn pps(found: &PpsFinding) -> Markup {
    let facts = html! {
        (fact("Channel", html! { code { (shown(&found.channel)) } }))
        (fact("Pulses used", number::count(found.pulses)))
        (fact("Pulses left out", health::rejects(&found.rejected)))
        (fact("Skew of the logger's clock", ppm(&found.skew)))
        (fact("Rms of the pulses about the map", html! { (plain(found.residual_rms_s * 1e6, 3)) " µs" }))
    };
    table("Pulses as a ruler", &[Text("Item"), Text("Value")], facts)
}
