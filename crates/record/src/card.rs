//! The sensor card: what a bench knows of one sensor, for people to read and for replay to use.

use crate::bench::{Finding, TimeBasis, Verdict};
use crate::replay::Estimate;
use flight::{Quantity, StampKind};
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Version of the layout of a card: raised when a field changes its meaning.
pub const CARD_VERSION: u32 = 1;

/// Which sensor. Two sensors are the same if every part that both name is equal.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct SensorIdentity {
    /// Maker and model, as `Xsens MTi-G`.
    pub model: String,
    /// Serial number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub serial: Option<String>,
    /// Firmware.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub firmware: Option<String>,
    /// Baud rate of its link.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub baud: Option<u32>,
    /// Whatever else changes its latency, as `GPS + Galileo`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub configuration: Option<String>,
}

/// What one channel of the sensor does.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct CardChannel {
    /// Channel name, as `position.ins`.
    pub name: String,
    /// What it holds.
    pub quantity: Quantity,
    /// Verdict over all records.
    pub verdict: Verdict,
    /// Delay, s; positive is late.
    pub delay_s: f64,
    /// Its standard uncertainty, s: within and between records.
    pub delay_standard_uncertainty_s: f64,
    /// As a loop sees it that reads held values, s; only where the channel was held.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub as_seen_delay_s: Option<f64>,
    /// Lags of the chosen model, s; empty for a pure delay.
    #[serde(default)]
    pub lags_s: Vec<f64>,
    /// Their standard uncertainties, s; empty where a record does not know its own.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lags_standard_uncertainty_s: Vec<f64>,
    /// How late slow motion is, s: delay and lags of the chosen model together; only where it has a lag. `delay_s` is the pure
    /// delay that fits the bench's swing best, which is less.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slow_motion_delay_s: Option<f64>,
    /// Its standard uncertainty, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slow_motion_standard_uncertainty_s: Option<f64>,
    /// Delay or lag, in words.
    pub model: String,
    /// Mean gain of the excited components.
    pub gain: f64,
    /// Its standard uncertainty.
    pub gain_standard_uncertainty: f64,
    /// Updates per second.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub update_rate_hz: Option<f64>,
    /// Which stamps the delay is measured with.
    pub stamp_kind: StampKind,
    /// What the delay is measured against.
    pub basis: TimeBasis,
    /// Records used.
    pub records: u64,
    /// Spread between records, standard deviation, s; only with two records or more.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub between_runs_s: Option<f64>,
    /// Files of records that were left out as outliers.
    #[serde(default)]
    pub outliers: Vec<String>,
    /// What puts the delay in doubt, each with the record's name: on what records contradict their rig file or their encoder, so
    /// that the delay is measured against a motion that was not the bar's, and where the delay changes over a record.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub contradicted: Vec<String>,
}

impl CardChannel {
    /// Whether something puts the delay in doubt.
    #[must_use]
    pub fn is_in_doubt(&self) -> bool {
        !self.contradicted.is_empty()
    }

    /// Whether it is a lag: its delay and its gain depend on the frequency. A delay that changes over a record passes for one, and
    /// is none.
    #[must_use]
    pub fn has_lag(&self) -> bool {
        !self.lags_s.is_empty() && !self.contradicted.iter().any(|what| what.contains(crate::DELAY_CHANGES))
    }
}

/// Hard and soft iron of a magnetometer: `read = soft_iron · field + hard_iron`, in body axes forward, right, down.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct IronCalibration {
    /// Hard iron x, y, z, in the unit of [`CardMagnetometer`].
    pub hard_iron: [f64; 3],
    /// Their standard uncertainties.
    pub hard_iron_standard_uncertainty: [f64; 3],
    /// Soft iron, row by row, of determinant one: the scale is apart.
    pub soft_iron: [[f64; 3]; 3],
    /// Their standard uncertainties.
    pub soft_iron_standard_uncertainty: [[f64; 3]; 3],
    /// Size of the field read over that of the model of the Earth's field; `None` without a model, or where the sensor
    /// has a scale of its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<f64>,
    /// Its standard uncertainty.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale_standard_uncertainty: Option<f64>,
    /// Rms of what is left, in the unit of [`CardMagnetometer`].
    pub residual_rms: f64,
    /// Condition number of the fit, columns scaled to unit length.
    pub condition: f64,
    /// In words.
    pub text: String,
}

/// What all records together say of the magnetometer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct CardMagnetometer {
    /// Channel, as `magnetic-field.imu`.
    pub channel: String,
    /// `T`, or `1` for a scale of the sensor's own.
    pub unit: String,
    /// Azimuth of each swing from north over east, rad, in the order of the records.
    pub azimuths_rad: Vec<f64>,
    /// Hard and soft iron, or why they cannot be told and which swings would show them.
    pub iron: Finding<IronCalibration>,
}

/// One record behind a card.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct CardSource {
    /// Files, without folder.
    pub files: Vec<String>,
    /// Their BLAKE3, in the same order.
    pub blake3: Vec<String>,
    /// UTC day, `yyyy-mm-dd`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub date: Option<String>,
    /// BLAKE3 of the rig as meant.
    pub rig_blake3: String,
}

/// A sensor card (`*.card.toml`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "schema", schemars(title = "flightlag sensor card"))]
pub struct SensorCard {
    /// [`CARD_VERSION`].
    pub card_version: u32,
    /// Which sensor.
    pub sensor: SensorIdentity,
    /// Title of the rig.
    pub rig: String,
    /// How the numbers were found, in a sentence.
    pub method: String,
    /// Version of flightlag that wrote it.
    pub flightlag_version: String,
    /// Version of the analysis behind the numbers.
    pub analysis_version: u32,
    /// Day of the newest record, `yyyy-mm-dd`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub measured_on: Option<String>,
    /// First day on which the card may be used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub valid_from: Option<String>,
    /// Last day on which the card may be used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub valid_until: Option<String>,
    /// Magnetometer, if a record has one whose swing's azimuth is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub magnetometer: Option<CardMagnetometer>,
    /// Channels, in the order of their names.
    #[serde(rename = "channel")]
    pub channels: Vec<CardChannel>,
    /// Records, in the order in which they were given.
    #[serde(rename = "record")]
    pub records: Vec<CardSource>,
}

/// The card behind the delay of a replay.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct CardUse {
    /// File name of the card.
    pub file: String,
    /// BLAKE3 of the file.
    pub blake3: String,
    /// Which sensor.
    pub sensor: SensorIdentity,
    /// The card's channel for the position that was replayed.
    pub channel: String,
    /// Its delay, s.
    pub delay_s: Estimate,
}
