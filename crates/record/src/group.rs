//! Which flights have the same receiver: their delays may be pooled.

#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The group that a flight belongs to (delay-network.md, section 5): receiver, its rate and line, channel map and kind of
/// log. Delays are pooled within a group only.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ReceiverGroup {
    /// For people: `u-blox M8 3.01, 5 Hz, 115200 baud, ArduPilot DataFlash`.
    pub name: String,
    /// Flights with the same key are one group. It follows from the parts that count.
    pub key: String,
    /// What the group is made of, in the order of the name.
    pub parts: Vec<GroupPart>,
    /// Whether the log says what the receiver is. If not, map, format and rate stand for it: flights of two receivers of
    /// one kind are one group then.
    pub told_by_log: bool,
}

/// One fact that makes a group.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct GroupPart {
    /// What it is: `receiver`, `firmware`, `rate`.
    pub what: String,
    /// Its value, with its unit.
    pub value: String,
    /// Where it was found: a parameter, a text, `measured`.
    pub from: String,
}

/// What a flight's position holds, in a few bytes: to find copies of it, and copies that have lost some of it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct FlightContent {
    /// Hash of all of it.
    pub fingerprint: String,
    /// Fixes.
    pub fixes: u64,
    /// The least hashes of stretches of a few fixes each, rising: two flights that share fixes share some of these.
    pub sketch: Vec<u64>,
}

/// A flight that is there more than once, under other names or in other containers.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DuplicateFlight {
    /// The flight that counts: of those with the most fixes the first by its identity.
    pub counts: String,
    /// The others, in their order: the same, or parts of it.
    pub duplicates: Vec<String>,
}
