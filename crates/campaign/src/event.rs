//! Events of a running campaign. The engine prints nothing; listeners do.

use crate::line::DelayLine;
use crate::manifest::{Stage, Why};
use record::{CampaignTotals, DelayKind, EffectVerdict, Estimate, VerdictTally};
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::Serialize;
use std::path::PathBuf;

/// One thing that happened.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(tag = "event", rename_all = "kebab-case")]
pub enum Event {
    /// The folder of flights was searched.
    Found {
        /// Flights in it.
        flights: usize,
        /// Files that are not logs.
        ignored: usize,
        /// Bytes of all logs.
        bytes: u64,
    },
    /// Files with unknown content are read once to hash them.
    Hashing {
        /// How many.
        files: usize,
        /// Their bytes.
        bytes: u64,
    },
    /// More bytes were hashed.
    Hashed {
        /// Bytes.
        bytes: u64,
    },
    /// The remaining work is known. A campaign that has to measure sends this event twice: once for each stage.
    Planned {
        /// Stage with work to do; `None` if there is none.
        stage: Option<Stage>,
        /// Flights in total.
        flights: usize,
        /// Existing results.
        reused: usize,
        /// Results to make; flights with the same content share one.
        to_run: usize,
        /// Bytes of the logs to read.
        bytes: u64,
    },
    /// A flight whose result already exists.
    Reused {
        /// Its name.
        flight: String,
    },
    /// A log is opened.
    Started {
        /// Its flight.
        flight: String,
        /// Its stage.
        stage: Stage,
        /// All reasons for reading it.
        why: Vec<Why>,
        /// Its size.
        bytes: u64,
    },
    /// More bytes of logs were read.
    Read {
        /// Bytes.
        bytes: u64,
    },
    /// The delays of a flight are measured.
    DelayMeasured {
        /// Its name.
        flight: String,
        /// Kind of the delay.
        kind: DelayKind,
        /// Lateness of the position, s, if known.
        lateness_s: Option<Estimate>,
        /// The same as text.
        words: String,
    },
    /// A flight has a result.
    Finished {
        /// Its name.
        flight: String,
        /// `compensated`, `uncompensated`, `not-measurable` or `failed`.
        outcome: &'static str,
        /// Why it is not compensated.
        reason: Option<String>,
        /// Bytes or messages were lost.
        lossy: bool,
        /// Lateness of the position, s, if known.
        lateness_s: Option<Estimate>,
        /// Delay that was removed, s.
        removed_s: Option<f64>,
        /// Whether the removal helped.
        effect: Option<EffectVerdict>,
    },
    /// A flight has no lasting result: the next run tries again.
    Troubled {
        /// Its name.
        flight: String,
        /// What went wrong.
        reason: String,
    },
    /// A remark for the user, which does not stop the run.
    Remark {
        /// A sentence.
        text: String,
    },
    /// Table, records and pages are up to date.
    Reduced {
        /// Flight pages that were made.
        pages: usize,
        /// Flight pages that were already up to date.
        kept: usize,
    },
    /// Same logs, same settings, same results: nothing was read or written.
    NothingChanged,
    /// Bench logs were found, and are being read.
    Logs {
        /// How many.
        logs: usize,
        /// Their bytes.
        bytes: u64,
    },
    /// Bench records are being measured.
    Measuring {
        /// How many.
        records: usize,
    },
    /// A bench record was measured.
    Measured {
        /// Its name.
        record: String,
        /// `measured`, `not-measurable` or `failed`.
        outcome: &'static str,
        /// Why it is not measured.
        reason: Option<String>,
        /// Bytes or messages were lost.
        lossy: bool,
    },
    /// The end of a bench run.
    Carded {
        /// The sensor.
        sensor: String,
        /// File name of its card; `None` if nothing was measured.
        card: Option<String>,
        /// The report's page.
        report: PathBuf,
        /// Records in total.
        records: usize,
        /// Measured records.
        measured: usize,
        /// Channels on the card.
        channels: Vec<record::CardChannel>,
        /// Notices about the records that it is based on.
        notices: flight::Notices,
    },
    /// The final result of a flight, whenever it was made: one event per flight, in the order of the table.
    Flight {
        /// `compensated`, `uncompensated`, `not-measurable`, `pending` or `failed`.
        outcome: &'static str,
        /// Why it is not compensated.
        reason: Option<String>,
        /// Its page.
        page: PathBuf,
        /// Name, delay, effect and alarms.
        #[serde(flatten)]
        line: Box<DelayLine>,
    },
    /// A night starts one of its campaigns: the following events belong to it.
    Campaign {
        /// Its name.
        name: String,
        /// Folder or bucket of its logs.
        flights: PathBuf,
    },
    /// The end of a night.
    Night {
        /// Its name: its start, UTC.
        run_id: String,
        /// Exit code.
        exit: u8,
        /// Page to open.
        page: PathBuf,
        /// Folder with night.json and the summaries.
        folder: PathBuf,
        /// The new file of the history.
        history: PathBuf,
        /// The five summary lines.
        summary: Vec<String>,
        /// Errors, with the campaign where there is one.
        errors: Vec<String>,
    },
    /// The end of a campaign.
    Done {
        /// The report's page.
        report: PathBuf,
        /// Whether everything was already up to date.
        nothing_changed: bool,
        /// Counts over all flights.
        #[serde(flatten)]
        totals: CampaignTotals,
        /// Flights by their worst verdict; `None` without criteria.
        #[serde(skip_serializing_if = "Option::is_none")]
        verdicts: Option<VerdictTally>,
    },
}

/// Receiver of events.
pub trait EventSink: Sync {
    /// Takes one event; called from many threads.
    fn event(&self, event: &Event);
}

impl<F: Fn(&Event) + Sync> EventSink for F {
    fn event(&self, event: &Event) {
        self(event);
    }
}
