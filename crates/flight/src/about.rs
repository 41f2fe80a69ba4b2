//! What a log says of itself beside its samples: who flew, with what software and which settings.

use crate::time::Clock;
use serde::{Deserialize, Serialize};

/// What a log says of the vehicle, its software and its settings.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
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
    /// Receivers and drivers as they name themselves, such as `u-blox M8 3.01`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub receivers: Vec<String>,
    /// Parameters that set a delay, as they stood at the start.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub configured_delays: Vec<ConfiguredDelay>,
    /// How many parameters the log holds.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub parameters: u64,
    /// Parameters that changed during the log: name, old and new value, in the order of time.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parameter_changes: Vec<String>,
    /// Flight modes in the order of time.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub modes: Vec<ModeStart>,
    /// Text messages of the autopilot, the first hundred, with their time.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub texts: Vec<String>,
}

impl About {
    /// Whether the log says nothing.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == About::default()
    }
}

fn is_zero(count: &u64) -> bool {
    *count == 0
}

/// A parameter that sets a delay.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ConfiguredDelay {
    /// Its name, such as `EKF2_GPS_DELAY`.
    pub parameter: String,
    /// The delay, s.
    pub value_s: f64,
    /// What it means, in words.
    pub meaning: String,
}

/// The begin of a flight mode.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ModeStart {
    /// Stamp, ns.
    pub at_ns: i64,
    /// Its clock.
    pub clock: Clock,
    /// Name of the mode.
    pub mode: String,
}
