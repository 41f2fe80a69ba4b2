//! Which flights have the same receiver and may be pooled, and which flights are one flight twice.

mod fingerprint;

pub use fingerprint::{content_of, duplicates, fingerprint, shared_content};

use flight::{About, Binding, ReceiverIdentity, StampKind};
use record::{GroupPart, ReceiverGroup};

/// Rates that receivers and loggers are set to, Hz: a measured rate is the nearest of them.
const RATES_HZ: [f64; 20] = [
    0.1, 0.2, 0.5, 1.0, 2.0, 4.0, 5.0, 8.0, 10.0, 15.0, 20.0, 25.0, 30.0, 50.0, 100.0, 200.0, 250.0, 400.0, 500.0,
    1000.0,
];

/// What is listed and makes no group.
const LOGGED_RATE: &str = "logged rate";

/// The group of a flight: receiver, firmware, rate and line as the log says them, channel map, kind of log and stamps.
///
/// Where the log does not say what the receiver is, map, kind of log and rate stand for it. Nothing of the vehicle is
/// in it: a receiver of one kind is as late in another vehicle, unless a serial number says that it is one receiver.
/// `position_rate_hz` is the measured rate of the position's updates, `stamp_kind` the stamps that the analysis uses.
#[must_use]
pub fn group_of(
    about: &About,
    binding: &Binding,
    health_format: &str,
    position_channel: &str,
    position_rate_hz: Option<f64>,
    stamp_kind: StampKind,
) -> ReceiverGroup {
    let number = receiver_number(position_channel);
    let identity = about.receiver_identity(number);
    let told_by_log = identity.is_some_and(|told| told.serial.is_some() || told.model.is_some());
    let mut parts = Parts::default();
    if let Some(told) = identity {
        parts.of_receiver(told);
    }
    parts.rate(identity, position_rate_hz);
    let (kind, recovered) = log_kind(health_format);
    parts.named("log", kind.to_owned(), if recovered { "the log that it was recovered from" } else { "the log" });
    parts.quiet("channel map", binding.map.clone(), "the channel map that fits");
    parts.quiet("position", position_channel.to_owned(), "the pipeline");
    parts.quiet("stamps", stamp_kind.to_string(), "the channel map");
    ReceiverGroup { name: parts.name(&binding.map, told_by_log), key: parts.key(), parts: parts.all, told_by_log }
}

/// Number of the receiver that a channel is of: `position.gps` of the first, `position.gps-2` of the second.
#[must_use]
pub fn receiver_number(channel: &str) -> u32 {
    let last = channel.rsplit_once('-').and_then(|(_, number)| number.parse().ok());
    last.filter(|number| *number > 0).unwrap_or(1)
}

/// The nearest rate that receivers are set to, by ratio, Hz: 4.98 and 5.02 Hz are one. `None` for what is no rate.
#[must_use]
pub fn usual_rate_hz(rate_hz: f64) -> Option<f64> {
    if !rate_hz.is_finite() || rate_hz <= 0.0 {
        return None;
    }
    let apart = |usual: &f64| (rate_hz / usual).ln().abs();
    RATES_HZ.into_iter().min_by(|a, b| apart(a).total_cmp(&apart(b)))
}

/// Kind of log without what its header says of its writer, and whether it was recovered from another.
fn log_kind(format: &str) -> (&str, bool) {
    let (format, recovered) = match format.rsplit_once(", recovered from ") {
        Some((_, original)) => (original, true),
        None => (format, false),
    };
    let end = format.find([',', '(', ';', ':']).unwrap_or(format.len());
    (format.get(..end).unwrap_or(format).trim(), recovered)
}

/// Facts as they are gathered.
#[derive(Default)]
struct Parts {
    all: Vec<GroupPart>,
    /// Which of them stand in the name.
    words: Vec<String>,
}

impl Parts {
    /// A fact that stands in the name.
    fn named(&mut self, what: &str, value: String, from: &str) {
        self.words.push(value.clone());
        self.quiet(what, value, from);
    }

    /// A fact that does not.
    fn quiet(&mut self, what: &str, value: String, from: &str) {
        self.all.push(GroupPart { what: what.to_owned(), value, from: from.to_owned() });
    }

    fn of_receiver(&mut self, told: &ReceiverIdentity) {
        let from = |name: &str| told.sources.get(name).map_or("the log", String::as_str);
        let of_firmware = told.firmware.as_ref().map(|firmware| format!(" {firmware}")).unwrap_or_default();
        if let Some(model) = &told.model {
            self.words.push(format!("{model}{of_firmware}"));
            self.quiet("receiver", model.clone(), from("model"));
        }
        if let Some(serial) = &told.serial {
            self.named("serial", serial.clone(), from("serial"));
        }
        if let Some(firmware) = &told.firmware {
            self.quiet("firmware", firmware.clone(), from("firmware"));
        }
        if let Some(protocol) = &told.protocol {
            self.quiet("protocol", protocol.clone(), from("protocol"));
        }
        if let Some(baud) = told.baud {
            self.quiet("baud", format!("{baud} baud"), from("baud"));
        }
    }

    /// The configured rate, else the measured one. Where the log says a rate, the measured one does not count: a logger
    /// leaves fixes out, and of a vehicle at rest a fix like the one before looks like no update.
    fn rate(&mut self, told: Option<&ReceiverIdentity>, measured_hz: Option<f64>) {
        let configured = told.and_then(|told| usual_rate_hz(told.rate_hz?));
        let measured = measured_hz.and_then(usual_rate_hz);
        if let Some(hz) = configured {
            let from = told.and_then(|told| told.sources.get("rate")).map_or("the log", String::as_str);
            self.named("rate", format!("{hz} Hz"), from);
        }
        match measured.filter(|_| measured != configured) {
            Some(hz) if configured.is_some() => self.quiet(LOGGED_RATE, format!("{hz} Hz"), "measured"),
            Some(hz) => self.named("rate", format!("{hz} Hz"), "measured"),
            None => {}
        }
        if let Some(baud) = told.and_then(|told| told.baud) {
            self.words.push(format!("{baud} baud"));
        }
    }

    fn name(&self, map: &str, told_by_log: bool) -> String {
        let front = if told_by_log { String::new() } else { format!("unknown receiver of map {map}, ") };
        format!("{front}{}", self.words.join(", "))
    }

    /// All facts, in the order of their names: small letters, so that another way of writing makes no other group.
    fn key(&self) -> String {
        let clean =
            |text: &str| text.to_lowercase().split_whitespace().collect::<Vec<_>>().join(" ").replace(['|', '='], "/");
        let counts = |part: &&GroupPart| part.what != LOGGED_RATE;
        let mut facts: Vec<String> = self
            .all
            .iter()
            .filter(counts)
            .map(|part| format!("{}={}", clean(&part.what), clean(&part.value)))
            .collect();
        facts.sort();
        facts.join("|")
    }
}

#[cfg(test)]
mod tests;
