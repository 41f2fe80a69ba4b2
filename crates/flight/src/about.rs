//! What a log states in addition to its samples: vehicle, software and settings.

use crate::time::Clock;
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What a log states about the vehicle, its software and its settings.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct About {
    /// Autopilot or logger, such as `PX4`, `ArduCopter`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub system: Option<String>,
    /// Version of its firmware, with the commit where it is logged.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub firmware: Option<String>,
    /// Board.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hardware: Option<String>,
    /// Serial number or identity of the vehicle.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vehicle: Option<String>,
    /// Receivers and drivers by their own names, such as `u-blox M8 3.01`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub receivers: Vec<String>,
    /// What the log states about each receiver, by number. Several texts of one receiver make one entry.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub receiver_identities: Vec<ReceiverIdentity>,
    /// Positions of antennas and IMU on the vehicle, from the parameters at the start.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lever_arms: Vec<LeverArm>,
    /// Parameters that set a delay, with their values at the start.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub configured_delays: Vec<ConfiguredDelay>,
    /// Number of parameters in the log.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub parameters: u64,
    /// Parameters that changed during the log: name, old and new value, in the order of time.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parameter_changes: Vec<String>,
    /// Flight modes in the order of time.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub modes: Vec<ModeStart>,
    /// First hundred text messages of the autopilot, with their time.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub texts: Vec<String>,
}

impl About {
    /// Whether the log states nothing.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == About::default()
    }

    /// What the log states about the receiver with this number; the first is 1.
    #[must_use]
    pub fn receiver_identity(&self, number: u32) -> Option<&ReceiverIdentity> {
        self.receiver_identities.iter().find(|identity| identity.number == number)
    }

    /// The lever arm that the parameters state for a sensor: `gps`, `gps-2`, `imu`. One that is zero in all axes is the
    /// autopilot's default: it was never measured, so `None` is returned.
    #[must_use]
    pub fn lever_arm(&self, sensor: &str) -> Option<&LeverArm> {
        self.lever_arms.iter().find(|arm| arm.sensor == sensor && arm.is_set())
    }
}

/// What a log states about one receiver. Fields are absent if the log does not state them.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ReceiverIdentity {
    /// Number of the receiver; the first is 1 (PX4 counts from 0: its instance 0 is receiver 1).
    pub number: u32,
    /// Make and model, such as `u-blox M8` or `NEO-M8N-0`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<String>,
    /// Firmware of the receiver, such as `SPG 3.01`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub firmware: Option<String>,
    /// Serial number, or the chip's unique number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub serial: Option<String>,
    /// Rate of the fixes as configured, Hz.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate_hz: Option<f64>,
    /// Speed of its serial line, baud.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub baud: Option<u32>,
    /// Protocol, such as `UBX`, `NMEA`, `DroneCAN`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub protocol: Option<String>,
    /// Source of each of these: name of the field, and the parameter or text.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub sources: BTreeMap<String, String>,
}

impl ReceiverIdentity {
    /// Whether the log states anything about it except its number.
    #[must_use]
    pub fn is_told(&self) -> bool {
        let texts = [&self.model, &self.firmware, &self.serial, &self.protocol];
        texts.iter().any(|text| text.is_some()) || self.rate_hz.is_some() || self.baud.is_some()
    }
}

/// Configured position of a sensor on the vehicle: in body axes, from the point that the autopilot uses as the
/// vehicle's origin (PX4 and ArduPilot: usually the centre of gravity).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct LeverArm {
    /// `gps` and `gps-2` for antennas, `imu` for the inertial sensors.
    pub sensor: String,
    /// The parameters, such as `EKF2_GPS_POS_X/Y/Z`.
    pub parameter: String,
    /// Ahead of the origin, m.
    pub forward_m: f64,
    /// Right of it, m.
    pub right_m: f64,
    /// Below it, m.
    pub down_m: f64,
}

impl LeverArm {
    /// Whether it was set: zero in all axes is the default.
    #[must_use]
    pub fn is_set(&self) -> bool {
        [self.forward_m, self.right_m, self.down_m].iter().any(|axis| *axis != 0.0)
    }
}

fn is_zero(count: &u64) -> bool {
    *count == 0
}

/// A parameter that sets a delay.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ConfiguredDelay {
    /// Its name, such as `EKF2_GPS_DELAY`.
    pub parameter: String,
    /// The delay, s.
    pub value_s: f64,
    /// Its meaning, in words.
    pub meaning: String,
}

/// The start of a flight mode.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ModeStart {
    /// Stamp, ns.
    pub at_ns: i64,
    /// Its clock.
    pub clock: Clock,
    /// Name of the mode.
    pub mode: String,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arm(sensor: &str, forward_m: f64) -> LeverArm {
        LeverArm { sensor: sensor.to_owned(), parameter: String::new(), forward_m, right_m: 0.0, down_m: 0.0 }
    }

    #[test]
    fn a_zero_lever_arm_is_treated_as_unset() {
        let about = About { lever_arms: vec![arm("gps", 0.0), arm("imu", 0.1)], ..About::default() };
        assert_eq!(about.lever_arm("gps"), None);
        assert_eq!(about.lever_arm("imu").map(|arm| arm.forward_m), Some(0.1));
    }

    #[test]
    fn absent_fields_are_not_serialised() {
        let about = About {
            receiver_identities: vec![ReceiverIdentity { number: 2, ..Default::default() }],
            ..About::default()
        };
        let text = serde_json::to_string(&about).unwrap();
        assert_eq!(text, r#"{"receiver_identities":[{"number":2}]}"#);
        assert_eq!(serde_json::from_str::<About>(&text).unwrap(), about);
        assert_eq!(about.receiver_identity(2).map(ReceiverIdentity::is_told), Some(false));
        assert_eq!(serde_json::from_str::<About>("{}").unwrap(), About::default());
    }
}
