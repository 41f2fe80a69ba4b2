//! The sensor card: bench results for one sensor, readable by people and used by replay.

use crate::bench::{Finding, TimeBasis, Verdict};
use crate::replay::Estimate;
use flight::{Quantity, StampKind};
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Version of the layout of a card: raised when the meaning of a field changes.
pub const CARD_VERSION: u32 = 1;

/// Identity of a sensor. Two sensors are the same if all parts stated for both are equal.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct SensorIdentity {
    /// Maker and model, such as `Xsens MTi-G`.
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
    /// Anything else that changes its latency, such as `GPS + Galileo`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub configuration: Option<String>,
}

/// Bench results for one channel of the sensor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct CardChannel {
    /// Channel name, such as `position.ins`.
    pub name: String,
    /// Quantity that it holds.
    pub quantity: Quantity,
    /// Verdict over all records.
    pub verdict: Verdict,
    /// Delay, s; positive is late.
    pub delay_s: f64,
    /// Its standard uncertainty, s: within and between records.
    pub delay_standard_uncertainty_s: f64,
    /// Delay as seen by a loop that reads held values, s; only where the channel was held.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub as_seen_delay_s: Option<f64>,
    /// Lags of the chosen model, s; empty for a pure delay.
    #[serde(default)]
    pub lags_s: Vec<f64>,
    /// Their standard uncertainties, s; empty where a record does not state its own.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lags_standard_uncertainty_s: Vec<f64>,
    /// Lateness of slow motion, s: sum of delay and lags of the chosen model; only where it has a lag. `delay_s` is the
    /// pure delay that fits the bench's swing best, which is smaller.
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
    /// Timestamps with which the delay is measured.
    pub stamp_kind: StampKind,
    /// Reference against which the delay is measured.
    pub basis: TimeBasis,
    /// Number of records used.
    pub records: u64,
    /// Spread between records, standard deviation, s; only with at least two records.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub between_runs_s: Option<f64>,
    /// Files of records that were rejected as outliers.
    #[serde(default)]
    pub outliers: Vec<String>,
    /// Reasons to doubt the delay, each with the record's name. A record may contradict its rig file or its encoder, so
    /// that the delay is measured against a wrong reference motion. The delay may change over a record.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub contradicted: Vec<String>,
}

/// The model of a channel that averages.
pub const MOVING_AVERAGE: &str = "delay and moving average";

impl CardChannel {
    /// Whether there is a reason to doubt the delay.
    #[must_use]
    pub fn is_in_doubt(&self) -> bool {
        !self.contradicted.is_empty()
    }

    /// Whether it is a lag: its delay and gain depend on frequency. A delay that changes over a record can look like a
    /// lag, but is not one.
    #[must_use]
    pub fn has_lag(&self) -> bool {
        let changes = self.contradicted.iter().any(|what| what.contains(crate::DELAY_CHANGES));
        !self.lags_s.is_empty() && !changes && self.lags_explain_delay()
    }

    /// The numbers of its model, s: lags, the a₁ of a second-order filter, or the length of a moving average, of which
    /// `lags_s` holds half.
    #[must_use]
    pub fn lags_as_named(&self) -> Vec<Estimate> {
        let factor = if self.model.starts_with(MOVING_AVERAGE) { 2.0 } else { 1.0 };
        let u_s = |k: usize| self.lags_standard_uncertainty_s.get(k).map(|u| factor * u);
        let of = |(k, lag): (usize, &f64)| Estimate { value: factor * lag, standard_uncertainty: u_s(k) };
        self.lags_s.iter().enumerate().map(of).collect()
    }

    /// How late the channel is in flight, s. A lag delays slow motion more than the swing on the bench, and a vehicle moves
    /// slowly: then it is the lateness of slow motion, less certain by what a motion as fast as the swing would show.
    #[must_use]
    pub fn lateness_in_flight_s(&self) -> Estimate {
        let own = Estimate { value: self.delay_s, standard_uncertainty: Some(self.delay_standard_uncertainty_s) };
        let Some(value) = self.slow_motion_delay_s.filter(|_| self.has_lag()) else { return own };
        let range_s = (value - self.delay_s).abs() / 12_f64.sqrt();
        let u_s = self.slow_motion_standard_uncertainty_s.unwrap_or(self.delay_standard_uncertainty_s);
        Estimate { value, standard_uncertainty: Some(u_s.hypot(range_s)) }
    }

    /// Whether the delay lies between the lateness of slow motion less the lags and that lateness, as the pure delay
    /// that fits a lag best does, within 20 ms and four standard uncertainties.
    fn lags_explain_delay(&self) -> bool {
        let Some(slow_s) = self.slow_motion_delay_s else { return true };
        let u_s = self.delay_standard_uncertainty_s.hypot(self.slow_motion_standard_uncertainty_s.unwrap_or(0.0));
        let tolerance_s = 4.0 * u_s + 0.02;
        let lags_s: f64 = self.lags_s.iter().sum();
        (-tolerance_s..=lags_s + tolerance_s).contains(&(slow_s - self.delay_s))
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
    /// Soft iron, row by row, with determinant one: the scale is separate.
    pub soft_iron: [[f64; 3]; 3],
    /// Their standard uncertainties.
    pub soft_iron_standard_uncertainty: [[f64; 3]; 3],
    /// Magnitude of the measured field divided by that of the Earth field model; `None` without a model, or where the
    /// sensor has a scale of its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<f64>,
    /// Its standard uncertainty.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale_standard_uncertainty: Option<f64>,
    /// Rms of the residuals, in the unit of [`CardMagnetometer`].
    pub residual_rms: f64,
    /// Condition number of the fit, columns scaled to unit length.
    pub condition: f64,
    /// Summary in words.
    pub text: String,
}

/// Magnetometer results from all records together.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct CardMagnetometer {
    /// Channel, such as `magnetic-field.imu`.
    pub channel: String,
    /// `T`, or `1` for a scale of the sensor's own.
    pub unit: String,
    /// Azimuth of each swing from north over east, rad, in the order of the records.
    pub azimuths_rad: Vec<f64>,
    /// Hard and soft iron, or why they cannot be estimated and which swings would allow it.
    pub iron: Finding<IronCalibration>,
}

/// One record used for a card.
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
    /// BLAKE3 of the resolved rig file.
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
    /// The sensor.
    pub sensor: SensorIdentity,
    /// Title of the rig.
    pub rig: String,
    /// How the numbers were obtained, in a sentence.
    pub method: String,
    /// Version of flightlag that wrote it.
    pub flightlag_version: String,
    /// Version of the analysis that produced the numbers.
    pub analysis_version: u32,
    /// Date of the newest record, `yyyy-mm-dd`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub measured_on: Option<String>,
    /// First day on which the card may be used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub valid_from: Option<String>,
    /// Last day on which the card may be used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub valid_until: Option<String>,
    /// Magnetometer, if a record has one and its swing azimuth is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub magnetometer: Option<CardMagnetometer>,
    /// Channels, sorted by name.
    #[serde(rename = "channel")]
    pub channels: Vec<CardChannel>,
    /// Records, in the order in which they were given.
    #[serde(rename = "record")]
    pub records: Vec<CardSource>,
}

/// The card that the delay of a replay comes from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct CardUse {
    /// File name of the card.
    pub file: String,
    /// BLAKE3 of the file.
    pub blake3: String,
    /// The sensor.
    pub sensor: SensorIdentity,
    /// The card's channel for the position that was replayed.
    pub channel: String,
    /// Its delay, s; for a lag that of slow motion.
    pub delay_s: Estimate,
    /// The same of the velocity that compensates it; `None` if it is not on the card.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub velocity_delay_s: Option<Estimate>,
}
