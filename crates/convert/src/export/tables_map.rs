//! A channel map that reads exported tables again.

use super::Source;
use serde_json::Value;
use std::fmt::Write;

/// Its file name, in the folder of the tables.
pub const TABLES_MAP: &str = "channel-map.toml";

const UTC: &str = "utc_ns";

/// The map of the tables of one log.
pub(super) struct TablesMap {
    text: String,
    ties: String,
}

impl TablesMap {
    /// A map without channels.
    pub(super) fn new(log: &str) -> TablesMap {
        let title = quoted(&format!("Channels exported by flightlag from {log}"));
        let text = format!(
            "# Reads the tables in this folder: flightlag delay FOLDER --maps FOLDER\nschema = 1\nname = \"exported\"\ntitle = {title}\n"
        );
        TablesMap { text, ties: String::new() }
    }

    /// Adds a channel in the table `place`.
    pub(super) fn add(&mut self, source: &Source, place: &str) {
        let word = |of: &Value| of.as_str().unwrap_or_default().to_owned();
        let topic = quoted(place.strip_suffix(".csv").unwrap_or(place));
        let (quantity, timeline) = (word(&source.about["quantity"]), word(&source.about["stamps"]));
        let is_stamp = |name: &str| name.ends_with("_ns") && name != UTC;
        let of = |name: &str, what: &str| source.columns.get(name).map(|about| word(&about[what])).unwrap_or_default();
        let names = || source.sheet.columns.iter().map(|column| column.name.as_str());
        let entry = |name: &str| format!("{{ field = \"{name}\", unit = \"ns\", clock = \"{}\" }}", of(name, "clock"));

        let text = &mut self.text;
        let _ = writeln!(text, "\n[[channel]]\nname = {}\nquantity = \"{quantity}\"", quoted(&source.name));
        let _ = writeln!(text, "topic = [{topic}]\ntimeline = \"{timeline}\"");
        if let Some(frame) = frame(&quantity) {
            let _ = writeln!(text, "frame = \"{frame}\"");
        }
        let _ = writeln!(text, "\n[channel.time]");
        for name in names().filter(|name| is_stamp(name)) {
            let _ = writeln!(text, "{} = [{}]", name.trim_end_matches("_ns"), entry(name));
        }
        let _ = writeln!(text, "\n[channel.fields]");
        for name in names().filter(|name| of(name, "clock").is_empty() && *name != "held") {
            let component = name.split('_').next().unwrap_or(name);
            let role = if quantity == "attitude" { format!("orientation_{component}") } else { component.to_owned() };
            let _ = writeln!(text, "{role} = {{ field = \"{name}\", unit = \"{}\" }}", of(name, "unit"));
        }
        if names().any(|name| name == UTC) && self.ties.is_empty() {
            let stamp = entry(&format!("{timeline}_ns"));
            self.ties = format!("\n[[utc]]\ntopic = [{topic}]\nstamp = {stamp}\nutc = {}\n", entry(UTC));
        }
    }

    /// The whole text.
    pub(super) fn finish(self) -> String {
        self.text + &self.ties
    }
}

/// The frame of a quantity with axes.
fn frame(quantity: &str) -> Option<&'static str> {
    match quantity {
        "angular-rate" | "specific-force" | "magnetic-field" | "magnetic-direction" => Some("frd"),
        "attitude" => Some("frd-ned"),
        _ => None,
    }
}

/// A text as a TOML string: JSON escapes are a subset of those of TOML.
fn quoted(text: &str) -> String {
    Value::from(text).to_string()
}
