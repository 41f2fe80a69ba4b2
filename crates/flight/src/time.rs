//! Timestamps, their clocks and kinds, and the one definition of delay.

use crate::distribution::Distribution;
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Nanoseconds in a second.
pub const NANOS_PER_SECOND: i64 = 1_000_000_000;

/// An instant in integer nanoseconds since the epoch of its [`Clock`].
///
/// Integers, because at 1.7e9 s since 1970 an `f64` second resolves only 238 ns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(transparent)]
pub struct Stamp(pub i64);

impl Stamp {
    /// Seconds from `origin` to `self`; exact difference, then one rounding.
    #[must_use]
    pub fn seconds_since(self, origin: Stamp) -> f64 {
        let nanos = i128::from(self.0) - i128::from(origin.0);
        nanos as f64 / NANOS_PER_SECOND as f64
    }

    /// The timestamp `seconds` later, rounded to the nanosecond and saturated at the limits of `i64`.
    #[must_use]
    pub fn plus_seconds(self, seconds: f64) -> Stamp {
        Stamp(self.0.saturating_add((seconds * NANOS_PER_SECOND as f64).round() as i64))
    }
}

/// The clock of a timestamp. Timestamps of different clocks are never compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Clock {
    /// UTC as a Unix count: since 1970-01-01, leap seconds not counted.
    Unix,
    /// GPS time since 1980-01-06, leap seconds counted.
    Gps,
    /// Since the device was switched on.
    Boot,
    /// Since an unspecified start, such as the time column of a hand-made table.
    Elapsed,
}

impl fmt::Display for Clock {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Clock::Unix => "UTC (Unix)",
            Clock::Gps => "GPS",
            Clock::Boot => "since boot",
            Clock::Elapsed => "elapsed",
        })
    }
}

/// UTC of a clock without UTC, from messages of the log that contain both: usually those of its receiver.
///
/// It dates the flight. Samples keep their timestamps: a receiver's message is late by an unknown and varying time,
/// so a tie is no better than its spread.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct UtcTie {
    /// The clock that is tied.
    pub clock: Clock,
    /// Topic and fields that contain both.
    pub source: String,
    /// UTC (Unix) minus the clock, ns: the median of the pairs.
    pub offset_ns: i64,
    /// The pairs minus their median, s, without outliers.
    pub spread_s: Distribution,
    /// Number of pairs used.
    pub pairs: u64,
    /// Number of pairs more than a second off, not used.
    pub outliers: u64,
}

impl UtcTie {
    /// UTC of a timestamp of the tied clock, as a Unix count. `None` outside the range of `i64`.
    #[must_use]
    pub fn unix(&self, stamp: Stamp) -> Option<Stamp> {
        stamp.0.checked_add(self.offset_ns).map(Stamp)
    }
}

/// What a timestamp means for its sample. The three are kept separate, because their
/// differences are what flightlag measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum StampKind {
    /// When the value was true according to the device (ROS `header.stamp`, ULog `timestamp_sample`).
    Measured,
    /// When the driver sent the message.
    Published,
    /// When the logger received it.
    Logged,
}

impl fmt::Display for StampKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            StampKind::Measured => "measured",
            StampKind::Published => "published",
            StampKind::Logged => "logged",
        })
    }
}

/// How late a signal is, in seconds. **Positive means late**: `measured(t) = truth(t − delay)`
/// (design note, notation; Park & Lee 2010 call it Td).
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(transparent)]
pub struct Delay(f64);

impl Delay {
    /// No delay.
    pub const ZERO: Delay = Delay(0.0);

    /// A delay of `seconds`; `None` if not finite.
    #[must_use]
    pub fn from_seconds(seconds: f64) -> Option<Delay> {
        seconds.is_finite().then_some(Delay(seconds))
    }

    /// The delay in seconds.
    #[must_use]
    pub fn seconds(self) -> f64 {
        self.0
    }

    /// The delay in milliseconds.
    #[must_use]
    pub fn millis(self) -> f64 {
        self.0 * 1e3
    }

    /// The instant at which a value with timestamp `stamp` was true.
    #[must_use]
    pub fn true_time(self, stamp: Stamp) -> Stamp {
        stamp.plus_seconds(-self.0)
    }

    /// The timestamp of a value that was true at `instant`.
    #[must_use]
    pub fn stamp_of(self, instant: Stamp) -> Stamp {
        instant.plus_seconds(self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_late_sensor_has_a_positive_delay() {
        let late = Delay::from_seconds(0.4).unwrap();
        // A value that was true at 10.0 s and has the timestamp 10.4 s is 0.4 s late.
        assert_eq!(late.true_time(Stamp(10_400_000_000)), Stamp(10_000_000_000));
        assert_eq!(late.stamp_of(Stamp(10_000_000_000)), Stamp(10_400_000_000));
    }

    #[test]
    fn delaying_and_advancing_by_the_same_amount_gives_the_stamp_back() {
        for nanos in [0, 1, 399_999_999, -1_250_000_007] {
            let delay = Delay::from_seconds(nanos as f64 * 1e-9).unwrap();
            let stamp = Stamp(1_700_000_000_123_456_789);
            assert_eq!(delay.true_time(delay.stamp_of(stamp)), stamp);
        }
    }

    #[test]
    fn seconds_between_far_stamps_do_not_overflow() {
        assert_eq!(Stamp(i64::MAX).seconds_since(Stamp(i64::MIN)), 18_446_744_073.709_553);
        assert_eq!(Stamp(i64::MAX).plus_seconds(1e30), Stamp(i64::MAX));
    }

    #[test]
    fn a_delay_is_finite() {
        assert!(Delay::from_seconds(f64::NAN).is_none());
    }
}
