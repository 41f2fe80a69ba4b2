//! A test card file as its author writes it. Every table rejects unknown keys.

use jiff::civil::Date;
use record::{TestAircraft, TestCard, TestConditions, TestInstrument, TestReport};
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::Deserialize;
use settings::SettingsFile;
use std::collections::BTreeMap;
use std::path::Path;
use toml::Spanned;

/// What is tested, with what, and by whom: for a campaign, or for one flight.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "schema", schemars(title = "flightlag test card"))]
pub(super) struct TestCardFile {
    /// Version of this file's layout: 1.
    #[cfg_attr(feature = "schema", schemars(range(min = 1, max = 1)))]
    pub(super) schema: u32,
    /// Title of the report.
    pub(super) title: Option<String>,
    /// Front matter of the report.
    #[serde(default)]
    pub(super) report: TestReport,
    /// The aircraft and its configuration.
    #[serde(default)]
    pub(super) aircraft: TestAircraft,
    /// Instrumentation, one row per channel.
    #[serde(default)]
    pub(super) instrumentation: Vec<TestInstrument>,
    /// Conditions of the test.
    #[serde(default)]
    pub(super) conditions: TestConditions,
    /// In the card of a campaign: the planned test cards. In the card of a flight: those it flew.
    #[serde(default)]
    pub(super) card: Vec<TestCard>,
}

impl TestCardFile {
    /// Reads a card.
    ///
    /// # Errors
    /// All its errors, one per line, with file and line.
    pub(super) fn parse(text: &str, path: &Path) -> Result<TestCardFile, String> {
        let file = SettingsFile::new(text, path);
        let card = file.read::<TestCardFile>().and_then(|card| {
            // The same keys again, with their positions.
            file.read::<Places>()?.check(&file);
            Ok(card)
        });
        file.finish(card).map_err(|error| error.to_string())
    }
}

/// The JSON schema of a test card file, as text.
#[cfg(feature = "schema")]
pub(crate) fn test_card_schema() -> String {
    let schema = schemars::schema_for!(TestCardFile);
    format!("{:#}\n", schema.as_value())
}

/// The checked values, with their positions in the file.
#[derive(Deserialize)]
struct Places {
    schema: Spanned<u32>,
    #[serde(default)]
    report: ReportPlaces,
    #[serde(default)]
    aircraft: AircraftPlaces,
    #[serde(default)]
    instrumentation: Vec<InstrumentPlaces>,
    #[serde(default)]
    conditions: ConditionPlaces,
    #[serde(default)]
    card: Vec<CardPlaces>,
}

#[derive(Default, Deserialize)]
struct ReportPlaces {
    date: Option<Spanned<String>>,
}

#[derive(Default, Deserialize)]
struct AircraftPlaces {
    mass_kg: Option<Spanned<f64>>,
}

#[derive(Deserialize)]
struct InstrumentPlaces {
    channel: Spanned<String>,
    rate_hz: Option<Spanned<f64>>,
    calibrated_on: Option<Spanned<String>>,
}

#[derive(Default, Deserialize)]
struct ConditionPlaces {
    temperature_c: Option<Spanned<f64>>,
}

#[derive(Deserialize)]
struct CardPlaces {
    number: Spanned<String>,
}

impl Places {
    fn check(&self, file: &SettingsFile<'_>) {
        let _ = file.known_layout(&self.schema);
        date(file, "date", self.report.date.as_ref());
        number(file, "mass_kg", self.aircraft.mass_kg.as_ref(), 1e-3, 1e6);
        number(file, "temperature_c", self.conditions.temperature_c.as_ref(), -100.0, 100.0);
        for row in &self.instrumentation {
            number(file, "rate_hz", row.rate_hz.as_ref(), 1e-3, 1e6);
            date(file, "calibrated_on", row.calibrated_on.as_ref());
        }
        names(file, "channel", "row", self.instrumentation.iter().map(|row| &row.channel));
        names(file, "number", "card", self.card.iter().map(|card| &card.number));
    }
}

fn number(file: &SettingsFile<'_>, key: &str, value: Option<&Spanned<f64>>, low: f64, high: f64) {
    if let Some((value, Err(what))) = value.map(|value| (value, settings::within(key, *value.get_ref(), low, high))) {
        file.reject(value, what);
    }
}

fn date(file: &SettingsFile<'_>, key: &str, value: Option<&Spanned<String>>) {
    if let Some(value) = value.filter(|value| value.get_ref().parse::<Date>().is_err()) {
        file.reject(value, format!("{key} = {:?}: must be a date such as 2026-05-31", value.get_ref()));
    }
}

/// A name must not be empty and must be unique among its kind.
fn names<'n>(file: &SettingsFile<'_>, key: &str, kind: &str, names: impl Iterator<Item = &'n Spanned<String>>) {
    let mut lines: BTreeMap<&str, usize> = BTreeMap::new();
    for name in names {
        if name.get_ref().trim().is_empty() {
            file.reject(name, format!("{key} must not be empty"));
        } else if let Some(first) = lines.insert(name.get_ref(), file.line_of(name)) {
            file.reject(name, format!("{key} {:?} is already used by the {kind} on line {first}", name.get_ref()));
        }
    }
}
