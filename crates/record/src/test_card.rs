//! What was to be tested, with what, and which parts were flown. The text comes from test card files; nothing here is
//! measured.

use crate::FlightCriteria;
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Front matter of a report.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct TestReport {
    /// Number of the report.
    pub number: Option<String>,
    /// Issue or revision.
    pub issue: Option<String>,
    /// Date of issue, `YYYY-MM-DD`.
    pub date: Option<String>,
    /// Who wrote it.
    pub author: Option<String>,
    /// Who checked it.
    pub checker: Option<String>,
    /// Who approved it.
    pub approver: Option<String>,
    /// Who receives it.
    #[serde(default)]
    pub distribution: Vec<String>,
}

/// The aircraft and how it was configured.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct TestAircraft {
    /// Type and serial number or registration.
    pub name: Option<String>,
    /// Take-off mass, kg.
    pub mass_kg: Option<f64>,
    /// Position of the centre of gravity, with its unit and reference.
    pub centre_of_gravity: Option<String>,
    /// Configuration: payload, antenna, differences from the baseline.
    pub configuration: Option<String>,
    /// Software of the autopilot and receiver.
    pub software: Option<String>,
}

/// A row of the instrumentation table.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct TestInstrument {
    /// Channel of the log, such as `position.gps`.
    pub channel: String,
    /// Maker and model of the sensor.
    pub sensor: Option<String>,
    /// Serial number of the sensor.
    pub serial: Option<String>,
    /// Measuring range with its unit.
    pub range: Option<String>,
    /// Resolution with its unit.
    pub resolution: Option<String>,
    /// Rate, Hz.
    pub rate_hz: Option<f64>,
    /// Source of its timestamps, such as `GPS time of the fix` or `time of arrival`.
    pub timestamp_source: Option<String>,
    /// Date of the last calibration, `YYYY-MM-DD`.
    pub calibrated_on: Option<String>,
    /// Number of the calibration certificate.
    pub certificate: Option<String>,
    /// Standard uncertainty (k = 1) with its unit.
    pub standard_uncertainty: Option<String>,
}

/// Conditions during the flight.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct TestConditions {
    /// Place of the test.
    pub place: Option<String>,
    /// Wind: speed with its unit, and direction.
    pub wind: Option<String>,
    /// Air temperature, °C.
    pub temperature_c: Option<f64>,
    /// Number of satellites in use.
    pub satellites: Option<u32>,
}

/// A test card: one test point.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct TestCard {
    /// Number of the card, unique in its file.
    pub number: String,
    /// What is tested, in a few words.
    pub title: Option<String>,
    /// What the test is to show.
    pub objective: Option<String>,
    /// Priority, such as `1` or `must`.
    pub priority: Option<String>,
    /// The manoeuvre, step by step.
    #[serde(default)]
    pub procedure: Vec<String>,
    /// Limits at which the test is aborted.
    #[serde(default)]
    pub limits: Vec<String>,
    /// Criteria file that decides whether the card is done, relative to the card's file. Default: the criteria of the
    /// campaign.
    pub criteria: Option<String>,
    /// Flights that fly this card, in the card of a campaign: paths relative to the folder of flights; `*` matches
    /// anything.
    #[serde(default)]
    pub flights: Vec<String>,
}

/// Status of a card after the flights, the most urgent first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum CardStatus {
    /// No flight has flown it.
    Missing,
    /// Flown, but every flight failed a criterion, could not decide one, or has no result.
    Repeat,
    /// A flight has a result and meets the criteria, if any.
    Done,
}

/// A file from which test cards were read.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct TestCardSource {
    /// Path relative to the folder of flights.
    pub file: String,
    /// BLAKE3 of its content.
    pub blake3: String,
}

/// A card that a flight has flown.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct FlownCard {
    /// The card.
    pub card: TestCard,
    /// Whether this flight is sufficient: done or repeat.
    pub status: CardStatus,
    /// Why it has to be repeated; empty if done.
    pub why: String,
    /// Result of the card's criteria file; `None` without one.
    pub criteria: Option<FlightCriteria>,
}

/// The test card information for a flight. The campaign's card is the fallback for anything missing from the flight's
/// card.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct FlightTest {
    /// Source files: the campaign's card, then the flight's.
    pub sources: Vec<TestCardSource>,
    /// Title of the report.
    pub title: Option<String>,
    /// Front matter.
    pub report: TestReport,
    /// Aircraft.
    pub aircraft: TestAircraft,
    /// Instrumentation.
    pub instrumentation: Vec<TestInstrument>,
    /// Conditions.
    pub conditions: TestConditions,
    /// The cards that the flight has flown.
    pub cards: Vec<FlownCard>,
}

/// A card that a flight has flown, in brief.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct RowCard {
    /// Number of the card.
    pub number: String,
    /// Title of the card.
    pub title: Option<String>,
    /// Whether this flight is sufficient: done or repeat.
    pub status: CardStatus,
    /// Why it has to be repeated; empty if done.
    pub why: String,
}

/// A flight of a card.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct CardFlight {
    /// Path relative to the folder of flights.
    pub flight: String,
    /// Its page, relative to the campaign's page.
    pub page: String,
    /// Done or repeat.
    pub status: CardStatus,
    /// Why it has to be repeated; empty if done.
    pub why: String,
}

/// A card over all flights.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct CardCoverage {
    /// The card.
    pub card: TestCard,
    /// Whether the campaign's card contains it.
    pub is_planned: bool,
    /// Done if one of its flights is done, repeat if it was flown but is not done, otherwise missing.
    pub status: CardStatus,
    /// The flights that flew it, by name.
    pub flights: Vec<CardFlight>,
}

/// The test card information for a campaign.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct CampaignTest {
    /// The campaign's card; `None` if only flights have cards.
    pub source: Option<TestCardSource>,
    /// Title of the report.
    pub title: Option<String>,
    /// Front matter.
    pub report: TestReport,
    /// Aircraft.
    pub aircraft: TestAircraft,
    /// Instrumentation.
    pub instrumentation: Vec<TestInstrument>,
    /// Conditions.
    pub conditions: TestConditions,
    /// Planned cards in the order of the file, then others by number.
    pub coverage: Vec<CardCoverage>,
    /// Flights that flew no card.
    pub flights_without_card: u64,
}
