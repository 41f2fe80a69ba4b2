//! A second file of a flight with a reference or its own velocity, and how its clock relates to that of the log.

use crate::Estimate;
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The reference file of a flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ReferenceFile {
    /// Names of its files.
    pub files: Vec<String>,
    /// Channels of the flight that come from it; empty if its clock cannot be related to that of the log.
    pub channels: Vec<String>,
    /// How its clock relates to that of the log.
    pub clock: ReferenceClock,
    /// Summary in a sentence.
    pub words: String,
}

/// How the clock of a reference file relates to that of the log.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(tag = "clock", rename_all = "kebab-case")]
pub enum ReferenceClock {
    /// Both count the same time.
    Same,
    /// Each has its own clock; their offset was estimated.
    Own(ClockOffset),
    /// The offset cannot be estimated.
    Unknown {
        /// Why, and what would help.
        reason: String,
    },
}

/// Offset: clock of the log less clock of the reference file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ClockOffset {
    /// Channel of the log that is assumed to be on time; its lateness is part of the offset.
    pub by: String,
    /// Timestamp of the reference file at which the offset holds, ns.
    pub at_ns: i64,
    /// The offset there, ns.
    pub offset_ns: i64,
    /// Its standard uncertainty (k = 1), s.
    pub standard_uncertainty_s: f64,
    /// Drift: seconds that the clock of the log gains on the other per second; `None` where no drift was detected.
    pub drift: Option<Estimate>,
    /// Correlation coefficient of the velocities at that offset.
    pub correlation: f64,
}

impl ClockOffset {
    /// Converts a timestamp of the reference file to the clock of the log, ns. `None` outside the range of `i64`.
    #[must_use]
    pub fn in_log_ns(&self, stamp_ns: i64) -> Option<i64> {
        let since_s = (i128::from(stamp_ns) - i128::from(self.at_ns)) as f64 * 1e-9;
        let gained_ns = self.drift.map_or(0.0, |drift| 1e9 * drift.value * since_s).round();
        stamp_ns.checked_add(self.offset_ns)?.checked_add(gained_ns as i64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_timestamp_is_shifted_by_offset_and_drift() {
        let drift = Some(Estimate { value: 20e-6, standard_uncertainty: Some(1e-6) });
        let offset = ClockOffset {
            by: "velocity.gps".into(),
            at_ns: 1_000_000_000_000,
            offset_ns: -400_000_000,
            standard_uncertainty_s: 1e-3,
            drift,
            correlation: 0.99,
        };
        // 100 s after the middle, the clock of the log has gained 2 ms.
        assert_eq!(offset.in_log_ns(1_100_000_000_000), Some(1_100_000_000_000 - 400_000_000 + 2_000_000));
        assert_eq!(offset.in_log_ns(i64::MIN), None);
    }
}
