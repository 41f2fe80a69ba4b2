//! What was read, what was not, and the quality of the timestamps.

use crate::about::About;
use crate::channel::{ChannelSource, Quantity};
use crate::distribution::Distribution;
use crate::time::{Clock, NANOS_PER_SECOND, StampKind, UtcTie};
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Accounting of every byte of a log: the five numbers after `size` add up to it.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ByteLedger {
    /// Size of all files of the flight together.
    pub size: u64,
    /// Wanted values. A compressed chunk counts as a whole.
    pub decoded: u64,
    /// Intact, but not wanted.
    pub skipped: u64,
    /// Magic, headers, indexes, definitions, comment lines.
    pub structure: u64,
    /// Could not be read or failed a checksum.
    pub damaged: u64,
    /// Begun records that files end inside of, as at power-off: no damage, see [`ByteLedger::is_cut_tail`].
    #[serde(default)]
    pub tail_cut: u64,
}

impl ByteLedger {
    /// Largest fraction of a file that an unfinished last record may take without counting as damage: a thousandth,
    pub const LARGEST_TAIL: f64 = 1e-3;
    /// and in short files a hundredth, if it is no longer than one row of a table, bytes.
    pub const LARGEST_TAIL_OF_SHORT: (f64, u64) = (1e-2, 1024);

    /// The sum of all fates: equals `size` unless bytes were forgotten.
    #[must_use]
    pub fn sum(&self) -> u64 {
        [self.decoded, self.skipped, self.structure, self.damaged, self.tail_cut]
            .iter()
            .fold(0, |a, b| a.saturating_add(*b))
    }

    /// Whether `bytes` of a truncated last record in a file of `size` bytes are the normal end of a log at power-off,
    /// not damage. Only for formats that do not state where they end: where an index, a footer or a size shows that
    /// something is missing, that is a loss.
    #[must_use]
    pub fn is_cut_tail(bytes: u64, size: u64) -> bool {
        let (share, row) = ByteLedger::LARGEST_TAIL_OF_SHORT;
        let below = |share: f64| (bytes as f64) < share * size as f64;
        below(ByteLedger::LARGEST_TAIL) || (bytes <= row && below(share))
    }
}

/// A range of bytes that could not be used.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct DamagedRange {
    /// File name without its folder.
    pub file: String,
    /// First byte.
    pub offset: u64,
    /// Bytes.
    pub length: u64,
    /// Why, for people.
    pub reason: String,
    /// Log time of the last message in front of it less that of the log's first, ns. `None` if there is none, or if the
    /// format keeps no log times or not their order.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub after_ns: Option<i64>,
}

impl DamagedRange {
    /// [`DamagedRange::after_ns`] in seconds.
    #[must_use]
    pub fn after_s(&self) -> Option<f64> {
        self.after_ns.map(|ns| ns as f64 / NANOS_PER_SECOND as f64)
    }
}

/// How one log was read.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct LogHealth {
    /// Format, such as `MCAP` or `ROS 1 bag 2.0`, with the writer stated in its header.
    pub format: String,
    /// Bytes.
    pub bytes: ByteLedger,
    /// Messages (rows) that are intact, wanted or not.
    pub messages: u64,
    /// Messages or rows that were found and could not be decoded.
    pub undecodable: u64,
    /// First hundred damaged ranges.
    pub damage: Vec<DamagedRange>,
    /// How many there are in all.
    pub damage_count: u64,
    /// Topics in the order of their names.
    pub topics: Vec<TopicHealth>,
    /// Attachments, metadata and the like, by name: listed, not read.
    pub extras: Vec<String>,
    /// What the log states about the vehicle and its settings.
    #[serde(default, skip_serializing_if = "About::is_empty")]
    pub about: About,
    /// UTC of the clock since boot, where the log ties the two.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub utc: Option<UtcTie>,
}

/// One topic of the log, read or not.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct TopicHealth {
    /// Name.
    pub name: String,
    /// Message type; empty if the format has none.
    pub type_name: String,
    /// Encoding of its messages, such as `ros1`, `cdr`, `json`, `csv`.
    pub encoding: String,
    /// Intact messages (rows).
    pub messages: u64,
    /// Their payload bytes, uncompressed.
    pub payload_bytes: u64,
    /// Timestamps of these messages, one entry for each kind in the log.
    pub stamps: Vec<StampHealth>,
    /// Whether its values were decoded.
    pub decoded: bool,
    /// Why not, if it was wanted.
    pub reason: String,
}

/// Statistics of one kind of timestamp of one topic. For a channel whose timestamps go back, rate, steps, gaps and
/// ends are those of its sorted rows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct StampHealth {
    /// Kind.
    pub kind: StampKind,
    /// Clock.
    pub clock: Clock,
    /// Field from which the timestamps were read; `log` or `publish` for the container's own.
    pub source: String,
    /// First timestamp, ns.
    pub first_ns: i64,
    /// Last timestamp, ns.
    pub last_ns: i64,
    /// Number of timestamps.
    pub count: u64,
    /// Forward steps per second, Hz; gaps are excluded if there are fewer than ten, or at most one in a hundred steps.
    /// `None` with fewer than two different timestamps, or if half of the rows share one: they were written at once.
    pub rate_hz: Option<f64>,
    /// Steps between timestamps, s; `None` without steps.
    pub steps_s: Option<Distribution>,
    /// Steps longer than [`Gap`]'s threshold.
    pub gap_count: u64,
    /// The longest gaps, at most ten, longest first.
    pub gaps: Vec<Gap>,
    /// Timestamps equal to the previous one.
    pub duplicates: u64,
    /// Timestamps earlier than the previous one.
    pub back_jumps: u64,
}

/// A gap in the timestamps: a step of more than 2.5 median steps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct Gap {
    /// Seconds after the first timestamp.
    pub start_s: f64,
    /// Its length, s.
    pub length_s: f64,
}

/// Difference between two kinds of timestamp of the same messages, s.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct StampOffset {
    /// The kind subtracted from; usually the later one.
    pub of: StampKind,
    /// The kind subtracted.
    pub against: StampKind,
    /// The differences, s. Both clocks count the same kind of time.
    pub offset_s: Distribution,
}

/// Rows that were not used, by reason.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct RejectCount {
    /// Why.
    pub reason: String,
    /// How many.
    pub count: u64,
    /// The first of them: line, message number or row.
    pub first: String,
}

/// Detected repetition of held values (design note 3.8).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct Held {
    /// Rows that repeat the previous value.
    pub repeats: u64,
    /// Most frequent run length of equal values.
    pub modal_run: u64,
    /// Median time between updates, s.
    pub update_interval_s: f64,
}

/// A bound channel, with its rejected rows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ChannelHealth {
    /// Channel name, such as `position.gps`.
    pub name: String,
    /// What it holds.
    pub quantity: Quantity,
    /// Topic and fields, with the units read.
    pub source: ChannelSource,
    /// Components missing from the log, by name.
    pub absent: Vec<String>,
    /// Rows in the topic.
    pub rows: u64,
    /// Rows used.
    pub used: u64,
    /// Rows not used, by reason; `used` and these add up to `rows`.
    pub rejected: Vec<RejectCount>,
    /// The timeline that the analysis uses.
    pub stamps: Option<StampHealth>,
    /// Differences between the kinds of timestamp.
    pub offsets: Vec<StampOffset>,
    /// Held values, if the stream was detected as held.
    pub held: Option<Held>,
}

/// A channel map that was considered.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct MapCandidate {
    /// Name of the map.
    pub map: String,
    /// Channels it would bind.
    pub binds: Vec<String>,
    /// Why it was chosen, or why not.
    pub why: String,
}

/// How columns became channels.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct Binding {
    /// Name of the chosen map.
    pub map: String,
    /// Why this one.
    pub why: String,
    /// The others.
    pub others: Vec<MapCandidate>,
    /// What it bound.
    pub channels: Vec<ChannelHealth>,
}
