//! The record of one flight.

use crate::{Decision, DelayNetwork, Effect, FlightCriteria, FlightDelays, FlightLateness, FlightTest, ReplayRecord};
use flight::{Binding, LogHealth, Notices};
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A file from which the flight was read.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct InputFile {
    /// Name without its folder.
    pub name: String,
    /// Size, bytes.
    pub bytes: u64,
    /// BLAKE3 of the content, hexadecimal.
    pub blake3: String,
}

/// The settings used to analyse the flight.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct PipelineUse {
    /// Title from the file.
    pub title: String,
    /// BLAKE3 of the resolved settings (comments and order do not count).
    pub blake3: String,
    /// The resolved settings, as TOML.
    pub toml: String,
}

/// Outcome of the flight.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(tag = "outcome", rename_all = "kebab-case")]
pub enum Outcome {
    /// The flight was compensated and has a [`ReplayRecord`].
    Compensated,
    /// The log was read and the delay was analysed, but no delay was removed.
    Uncompensated {
        /// Reason.
        reason: String,
    },
    /// The log was read, but the flight cannot be measured.
    NotMeasurable {
        /// Reason, and what would make it measurable.
        reason: String,
    },
    /// No result yet, and no known reason against one.
    Pending {
        /// What is pending.
        reason: String,
    },
    /// The log could not be used.
    Failed {
        /// File, topic, line or byte, and what is wrong.
        reason: String,
    },
}

impl Outcome {
    /// The outcome as shown in tables.
    #[must_use]
    pub fn word(&self) -> &'static str {
        match self {
            Outcome::Compensated => "compensated",
            Outcome::Uncompensated { .. } => "uncompensated",
            Outcome::NotMeasurable { .. } => "not-measurable",
            Outcome::Pending { .. } => "pending",
            Outcome::Failed { .. } => "failed",
        }
    }

    /// Why the flight is not compensated; `None` if it is.
    #[must_use]
    pub fn reason(&self) -> Option<&str> {
        match self {
            Outcome::Compensated => None,
            Outcome::Uncompensated { reason }
            | Outcome::NotMeasurable { reason }
            | Outcome::Pending { reason }
            | Outcome::Failed { reason } => Some(reason),
        }
    }
}

/// Everything found about one flight. It contains no times of day, hosts or folders, so that the same log, settings and
/// analysis give the same bytes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct FlightRecord {
    /// [`crate::RECORD_VERSION`].
    pub record_version: u32,
    /// Analysis version, raised by hand when the numbers change.
    pub analysis_version: u32,
    /// Hash of inputs, pipeline and analysis version: the key of this result.
    pub key: String,
    /// Files that were read.
    pub inputs: Vec<InputFile>,
    /// Settings used.
    pub pipeline: PipelineUse,
    /// Outcome.
    #[serde(flatten)]
    pub outcome: Outcome,
    /// Result of reading the log; `None` if the file could not be opened.
    pub log: Option<LogHealth>,
    /// Channels bound by the channel map; `None` if no map matches.
    pub binding: Option<Binding>,
    /// The replay.
    pub replay: Option<ReplayRecord>,
    /// What the compensators would have done with the measured delay between position and velocity, for a flight from
    /// which nothing was removed. Used only on its page; not a result of the flight.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trial: Option<ReplayRecord>,
    /// Delays measured from the flight itself; `None` if no channel was bound.
    #[serde(default)]
    pub delays: Option<FlightDelays>,
    /// How late the position is; `None` if the log could not be read.
    #[serde(default)]
    pub lateness: Option<FlightLateness>,
    /// One lateness for each channel; `None` if no pair gave a delay.
    #[serde(default)]
    pub network: Option<DelayNetwork>,
    /// Delay removed, and why; `None` before it is decided.
    #[serde(default)]
    pub decision: Option<Decision>,
    /// Whether removing it helped; `None` where nothing could be compared.
    #[serde(default)]
    pub effect: Option<Effect>,
    /// Verdicts of the criteria; `None` without criteria. Not part of the result under its key: criteria are evaluated
    /// again whenever pages are generated, so that a changed limit does not recompute flights.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub criteria: Option<FlightCriteria>,
    /// Test cards; `None` without a card. Like the criteria, not part of the result under its key.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub test: Option<FlightTest>,
    /// All notices, in the order in which they were raised.
    pub notices: Notices,
    /// JSON pointers (RFC 6901) of the lists that are empty here and stored in `details.json.gz`, because with them the
    /// record would exceed 64 kB.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub details: Vec<String>,
}

impl FlightRecord {
    /// Whether bytes or messages that the logger wrote were lost, and the loss affects a result or is large.
    #[must_use]
    pub fn has_loss(&self) -> bool {
        self.notices.any_loss()
    }

    /// The replay, otherwise the trial: what the page can draw.
    #[must_use]
    pub fn drawable(&self) -> Option<&ReplayRecord> {
        self.replay.as_ref().or(self.trial.as_ref())
    }

    /// UTC (Unix, ns) at time zero of the replay, otherwise of the first pair of channels. `None` if the clock does not
    /// know the date and the log does not tie it to UTC.
    #[must_use]
    pub fn began(&self) -> Option<flight::Stamp> {
        let replay = self.drawable().map(|r| (r.origin_ns, r.clock));
        let mut pairs = self.delays.iter().flat_map(|d| &d.pairs).filter_map(|p| p.origin);
        let (origin_ns, clock) = replay.or_else(|| pairs.next().map(|o| (o.origin_ns, o.clock)))?;
        let tie = self.log.as_ref().and_then(|log| log.utc.as_ref()).filter(|tie| tie.clock == clock);
        clock.unix(flight::Stamp(origin_ns)).or_else(|| tie?.unix(flight::Stamp(origin_ns)))
    }

    /// Whether a small amount was lost without affecting a result.
    #[must_use]
    pub fn has_minor_loss(&self) -> bool {
        self.notices.iter().any(|notice| notice.code == ::flight::Code::MinorLoss)
    }
}
