//! Groups of flights with the same receiver, whose delays may be pooled.

#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The group that a flight belongs to (delay-network.md, section 5): receiver, its rate and serial line, channel map
/// and kind of log. Delays are pooled within a group only.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ReceiverGroup {
    /// Human-readable name: `u-blox M8 3.01, 5 Hz, 115200 baud, ArduPilot DataFlash`.
    pub name: String,
    /// Flights with the same key form one group. The key is made from the relevant parts.
    pub key: String,
    /// Parts that define the group, in the order of the name.
    pub parts: Vec<GroupPart>,
    /// Whether the log names the receiver. If not, map, format and rate are used instead, and flights of two receivers
    /// of one kind form one group.
    pub told_by_log: bool,
}

/// One fact that defines a group.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct GroupPart {
    /// Its name: `receiver`, `firmware`, `rate`.
    pub what: String,
    /// Its value, with its unit.
    pub value: String,
    /// Where it was found: a parameter, a text, `measured`.
    pub from: String,
}

/// Fingerprint of a flight's position samples, used to find complete and partial copies.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct FlightContent {
    /// Hash of all samples.
    pub fingerprint: String,
    /// Number of fixes.
    pub fixes: u64,
    /// The smallest hashes of short runs of fixes, in ascending order. Two flights that share fixes share some of these
    /// hashes.
    pub sketch: Vec<u64>,
}

/// A flight that occurs more than once, under other names or in other containers.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DuplicateFlight {
    /// The flight that counts: among those with the most fixes, the first by identity.
    pub counts: String,
    /// The others, in order: complete or partial copies.
    pub duplicates: Vec<String>,
}
