//! The record of one flight.

use crate::{Decision, DelayNetwork, Effect, FlightCriteria, FlightDelays, FlightLateness, FlightTest, ReplayRecord};
use flight::{Binding, LogHealth, Notices};
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A file that the flight was read from.
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

/// The settings that the flight was analysed with.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct PipelineUse {
    /// Title from the file.
    pub title: String,
    /// BLAKE3 of the settings as they are meant (comments and order do not count).
    pub blake3: String,
    /// The settings as they are meant, as TOML.
    pub toml: String,
}

/// What became of the flight.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(tag = "outcome", rename_all = "kebab-case")]
pub enum Outcome {
    /// There is a [`ReplayRecord`].
    Compensated,
    /// The log was read and its delay looked for, but no delay was removed.
    Uncompensated {
        /// Why.
        reason: String,
    },
    /// The log was read, but compensation says nothing here.
    NotMeasurable {
        /// Why, and what would make it so.
        reason: String,
    },
    /// No result has been made yet: nothing is known against it.
    Pending {
        /// What is to come.
        reason: String,
    },
    /// The log could not be used.
    Failed {
        /// File, topic, line or byte, and what is wrong.
        reason: String,
    },
}

impl Outcome {
    /// The outcome as tables give it.
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

/// Everything found about one flight. Free of times of day, hosts and folders, so that the
/// same log, settings and analysis give the same bytes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct FlightRecord {
    /// [`crate::RECORD_VERSION`].
    pub record_version: u32,
    /// Raised by hand when the analysis gives other numbers.
    pub analysis_version: u32,
    /// Hash of inputs, pipeline and analysis version: the name of this result.
    pub key: String,
    /// What was read.
    pub inputs: Vec<InputFile>,
    /// With which settings.
    pub pipeline: PipelineUse,
    /// What came of it.
    #[serde(flatten)]
    pub outcome: Outcome,
    /// How the reading went; `None` if the file could not even be opened.
    pub log: Option<LogHealth>,
    /// Which map bound what; `None` if no map fits.
    pub binding: Option<Binding>,
    /// The replay.
    pub replay: Option<ReplayRecord>,
    /// What the compensators would have done with the difference between position and velocity, of a flight from which
    /// nothing was removed: for its page alone, no result of the flight.
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
    /// What is removed, and why; `None` before it is decided.
    #[serde(default)]
    pub decision: Option<Decision>,
    /// Whether that helped; `None` where nothing could be compared.
    #[serde(default)]
    pub effect: Option<Effect>,
    /// What the criteria say; `None` where none were given. Not part of the result under its key: it is judged anew
    /// whenever pages are made, so that another limit recomputes no flight.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub criteria: Option<FlightCriteria>,
    /// What the test cards say; `None` without one. Like the criteria no part of the result under its key.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub test: Option<FlightTest>,
    /// All notices, in the order in which they were raised.
    pub notices: Notices,
    /// JSON pointers (RFC 6901) of the lists that `details.json.gz` holds and that are empty here, for the record would be longer
    /// than 64 kB with them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub details: Vec<String>,
}

impl FlightRecord {
    /// Whether bytes or messages that the logger wrote were lost, and that touches a result or is much.
    #[must_use]
    pub fn has_loss(&self) -> bool {
        self.notices.any_loss()
    }

    /// The replay, else the trial: what the page can draw.
    #[must_use]
    pub fn drawable(&self) -> Option<&ReplayRecord> {
        self.replay.as_ref().or(self.trial.as_ref())
    }

    /// UTC (Unix, ns) at time zero of the replay, else of the first pair of channels; `None` if the clock does not know the
    /// day and the log does not tie it to UTC.
    #[must_use]
    pub fn began(&self) -> Option<flight::Stamp> {
        let replay = self.drawable().map(|r| (r.origin_ns, r.clock));
        let mut pairs = self.delays.iter().flat_map(|d| &d.pairs).filter_map(|p| p.origin);
        let (origin_ns, clock) = replay.or_else(|| pairs.next().map(|o| (o.origin_ns, o.clock)))?;
        let tie = self.log.as_ref().and_then(|log| log.utc.as_ref()).filter(|tie| tie.clock == clock);
        clock.unix(flight::Stamp(origin_ns)).or_else(|| tie?.unix(flight::Stamp(origin_ns)))
    }

    /// Whether a little was lost that touches no result.
    #[must_use]
    pub fn has_minor_loss(&self) -> bool {
        self.notices.iter().any(|notice| notice.code == ::flight::Code::MinorLoss)
    }
}
