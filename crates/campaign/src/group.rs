//! Which flights have the same receiver and may be pooled, and which flights are duplicates.

mod fingerprint;

pub use fingerprint::{content_of, duplicates, fingerprint, shared_content};

use flight::{About, Binding, ReceiverIdentity, StampKind};
use record::{GroupPart, ReceiverGroup};

/// Usual rates of receivers and loggers, Hz: a measured rate is rounded to the nearest.
const RATES_HZ: [f64; 20] = [
    0.1, 0.2, 0.5, 1.0, 2.0, 4.0, 5.0, 8.0, 10.0, 15.0, 20.0, 25.0, 30.0, 50.0, 100.0, 200.0, 250.0, 400.0, 500.0,
    1000.0,
];

/// A fact that is listed but does not affect the group.
const LOGGED_RATE: &str = "logged rate";

/// The group of a flight: receiver, firmware, rate and line from the log, channel map, kind of log and timestamps.
///
/// If the log does not identify the receiver, map, kind of log and rate replace it. The vehicle is not part of the
/// group: receivers of one kind are equally late in every vehicle. A serial number limits the group to one receiver.
/// `position_rate_hz` is the measured update rate of the position, `stamp_kind` the timestamps that the analysis uses.
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
    let told_by_log = identity.is_some_and(|id| id.serial.is_some() || id.model.is_some());
    let mut parts = Parts::default();
    if let Some(receiver) = identity {
        parts.of_receiver(receiver);
    }
    parts.rate(identity, position_rate_hz);
    let (kind, recovered) = log_kind(health_format);
    parts.named("log", kind.to_owned(), if recovered { "the log that it was recovered from" } else { "the log" });
    parts.quiet("channel map", binding.map.clone(), "the channel map that fits");
    parts.quiet("position", position_channel.to_owned(), "the pipeline");
    parts.quiet("stamps", stamp_kind.to_string(), "the channel map");
    ReceiverGroup { name: parts.name(&binding.map, told_by_log), key: parts.key(), parts: parts.all, told_by_log }
}

/// Number of the receiver of a channel: `position.gps` of the first, `position.gps-2` of the second.
#[must_use]
pub fn receiver_number(channel: &str) -> u32 {
    let last = channel.rsplit_once('-').and_then(|(_, number)| number.parse().ok());
    last.filter(|number| *number > 0).unwrap_or(1)
}

/// The nearest usual rate of receivers, by ratio, Hz: 4.98 and 5.02 Hz are the same. `None` for an invalid rate.
#[must_use]
pub fn usual_rate_hz(rate_hz: f64) -> Option<f64> {
    if !rate_hz.is_finite() || rate_hz <= 0.0 {
        return None;
    }
    let apart = |usual: &f64| (rate_hz / usual).ln().abs();
    RATES_HZ.into_iter().min_by(|a, b| apart(a).total_cmp(&apart(b)))
}

/// Kind of log without the writer in its header, and whether it was recovered from another log.
fn log_kind(format: &str) -> (&str, bool) {
    let (format, recovered) = match format.rsplit_once(", recovered from ") {
        Some((_, original)) => (original, true),
        None => (format, false),
    };
    let end = format.find([',', '(', ';', ':']).unwrap_or(format.len());
    (format.get(..end).unwrap_or(format).trim(), recovered)
}

/// Collected facts.
#[derive(Default)]
struct Parts {
    all: Vec<GroupPart>,
    /// Values of the facts in the name.
    words: Vec<String>,
}

impl Parts {
    /// Adds a fact that is in the name.
    fn named(&mut self, what: &str, value: String, from: &str) {
        self.words.push(value.clone());
        self.quiet(what, value, from);
    }

    /// Adds a fact that is not.
    fn quiet(&mut self, what: &str, value: String, from: &str) {
        self.all.push(GroupPart { what: what.to_owned(), value, from: from.to_owned() });
    }

    fn of_receiver(&mut self, receiver: &ReceiverIdentity) {
        let from = |name: &str| receiver.sources.get(name).map_or("the log", String::as_str);
        let of_firmware = receiver.firmware.as_ref().map(|firmware| format!(" {firmware}")).unwrap_or_default();
        if let Some(model) = &receiver.model {
            self.words.push(format!("{model}{of_firmware}"));
            self.quiet("receiver", model.clone(), from("model"));
        }
        if let Some(serial) = &receiver.serial {
            self.named("serial", serial.clone(), from("serial"));
        }
        if let Some(firmware) = &receiver.firmware {
            self.quiet("firmware", firmware.clone(), from("firmware"));
        }
        if let Some(protocol) = &receiver.protocol {
            self.quiet("protocol", protocol.clone(), from("protocol"));
        }
        if let Some(baud) = receiver.baud {
            self.quiet("baud", format!("{baud} baud"), from("baud"));
        }
    }

    /// The configured rate, else the measured one. If the log states a rate, the measured one is ignored: a logger may
    /// drop fixes, and for a vehicle at rest a repeated fix looks like no update.
    fn rate(&mut self, receiver: Option<&ReceiverIdentity>, measured_hz: Option<f64>) {
        let configured = receiver.and_then(|receiver| usual_rate_hz(receiver.rate_hz?));
        let measured = measured_hz.and_then(usual_rate_hz);
        if let Some(hz) = configured {
            let from = receiver.and_then(|receiver| receiver.sources.get("rate")).map_or("the log", String::as_str);
            self.named("rate", format!("{hz} Hz"), from);
        }
        match measured.filter(|_| measured != configured) {
            Some(hz) if configured.is_some() => self.quiet(LOGGED_RATE, format!("{hz} Hz"), "measured"),
            Some(hz) => self.named("rate", format!("{hz} Hz"), "measured"),
            None => {}
        }
        if let Some(baud) = receiver.and_then(|receiver| receiver.baud) {
            self.words.push(format!("{baud} baud"));
        }
    }

    fn name(&self, map: &str, told_by_log: bool) -> String {
        let front = if told_by_log { String::new() } else { format!("unknown receiver of map {map}, ") };
        format!("{front}{}", self.words.join(", "))
    }

    /// All facts, sorted by name and in lower case, so that another spelling does not make another group.
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
