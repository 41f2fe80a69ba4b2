//! The values as text for people and programs.

use record::{EkfChannel, EkfValue, EkfValueKind, EkfValues};
use std::fmt::Write as _;

/// The values as TOML, each with its formula. The same values give the same bytes.
#[must_use]
pub fn ekf_values_toml(values: &EkfValues) -> String {
    let mut text = String::from(
        "# Values for the design of a Kalman filter, from one flight.\n\
         # `u` is the standard uncertainty (k = 1). A positive delay is late. T is the sampling interval.\n\
         schema = 1\n",
    );
    for channel in &values.channels {
        put(&mut text, channel);
    }
    text
}

fn put(text: &mut String, channel: &EkfChannel) {
    let _ =
        writeln!(text, "\n[[channel]]\nname = {}\nrests_on = {}", quoted(&channel.channel), quoted(&channel.rests_on));
    if let Some(rate_hz) = channel.rate_hz {
        let _ = writeln!(text, "rate_hz = {}", number(rate_hz));
    }
    for remark in &channel.remarks {
        let _ = writeln!(text, "# {}", one_line(remark));
    }
    for value in &channel.values {
        let _ = writeln!(text, "# {}", one_line(&value.formula));
        let _ = writeln!(text, "{} = {}", name(value.kind), fields(value));
    }
}

fn fields(value: &EkfValue) -> String {
    let u = value.standard_uncertainty.map(|u| format!(", u = {}", number(u))).unwrap_or_default();
    format!("{{ value = {}{u}, unit = {} }}", number(value.value), quoted(&value.unit))
}

/// Name as in the record.
fn name(kind: EkfValueKind) -> &'static str {
    match kind {
        EkfValueKind::WhiteStd => "white-std",
        EkfValueKind::NoiseDensity => "noise-density",
        EkfValueKind::WanderStd => "wander-std",
        EkfValueKind::WanderTimeConstant => "wander-time-constant",
        EkfValueKind::RandomWalkDensity => "random-walk-density",
        EkfValueKind::BiasStd => "bias-std",
        EkfValueKind::Delay => "delay",
    }
}

/// Six digits: a flight cannot determine more. A TOML float has a point or an exponent.
fn number(value: f64) -> String {
    format!("{value:.5e}")
}

fn quoted(text: &str) -> String {
    let mut out = String::from('"');
    for letter in text.chars() {
        match letter {
            '"' | '\\' => out.extend(['\\', letter]),
            letter if letter.is_control() => {
                let _ = write!(out, "\\u{:04X}", u32::from(letter));
            }
            letter => out.push(letter),
        }
    }
    out.push('"');
    out
}

fn one_line(text: &str) -> String {
    text.chars().map(|letter| if letter.is_control() { ' ' } else { letter }).collect()
}
