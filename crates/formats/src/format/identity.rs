//! Receivers and sensor positions, from parameters, texts and version messages.
//!
//! A text that the autopilot wrote when it detected the receiver takes precedence over a parameter: the parameter says
//! what was requested, the text what was found.

mod parameters;
mod tables;
mod versions;

pub(in crate::format) use parameters::{lever_arms, of_ardupilot, of_px4};
pub(in crate::format) use tables::{GARMIN, of_table_head};
pub(in crate::format) use versions::{of_version, report_px4_versions};

use flight::ReceiverIdentity;
use std::collections::BTreeMap;

/// Value of a parameter at the start of the log.
pub(in crate::format) type Parameters<'a> = dyn Fn(&str) -> Option<f64> + 'a;

/// Receivers by their numbers.
type Receivers = BTreeMap<u32, ReceiverIdentity>;

/// The receiver with this number, created if it does not exist yet.
fn numbered(receivers: &mut Receivers, number: u32) -> &mut ReceiverIdentity {
    receivers.entry(number).or_insert_with(|| ReceiverIdentity { number, ..ReceiverIdentity::default() })
}

/// The receivers with at least one known fact, in numeric order.
fn known(receivers: Receivers) -> Vec<ReceiverIdentity> {
    receivers.into_values().filter(ReceiverIdentity::is_told).collect()
}

/// Records a fact and its source. A fact that is already known is kept.
fn note<T>(field: &mut Option<T>, value: Option<T>, known: Known<'_>) {
    if field.is_none() && value.is_some() {
        *field = value;
        known.sources.insert(known.name.to_owned(), known.source.to_owned());
    }
}

/// Name of a fact and its source.
struct Known<'a> {
    sources: &'a mut BTreeMap<String, String>,
    name: &'a str,
    source: &'a str,
}

/// Model, protocol and firmware from one source.
fn note_text(receiver: &mut ReceiverIdentity, name: &str, value: Option<&str>, source: &str) {
    let value = value.map(str::trim).filter(|value| !value.is_empty()).map(str::to_owned);
    let ReceiverIdentity { model, firmware, serial, protocol, sources, .. } = receiver;
    let field = match name {
        "model" => model,
        "firmware" => firmware,
        "serial" => serial,
        _ => protocol,
    };
    note(field, value, Known { sources, name, source });
}

fn note_rate(receiver: &mut ReceiverIdentity, rate_hz: Option<f64>, source: &str) {
    let rate_hz = rate_hz.filter(|hz| hz.is_finite() && *hz > 0.0);
    note(&mut receiver.rate_hz, rate_hz, Known { sources: &mut receiver.sources, name: "rate", source });
}

fn note_baud(receiver: &mut ReceiverIdentity, baud: Option<u32>, source: &str) {
    note(
        &mut receiver.baud,
        baud.filter(|baud| *baud > 0),
        Known { sources: &mut receiver.sources, name: "baud", source },
    );
}
