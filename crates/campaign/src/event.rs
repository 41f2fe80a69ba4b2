//! What happens while a campaign runs. The engine prints nothing: listeners do.

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
    /// The folder of flights was looked through.
    Found {
        /// Flights in it.
        flights: usize,
        /// Files that are no logs.
        ignored: usize,
        /// Bytes of all logs.
        bytes: u64,
    },
    /// Files whose content is not known from an earlier run are read through once.
    Hashing {
        /// How many.
        files: usize,
        /// Their bytes.
        bytes: u64,
    },
    /// So many more bytes were hashed.
    Hashed {
        /// Bytes.
        bytes: u64,
    },
    /// It is known what is left to do. A campaign that has to measure tells it twice: once for each stage.
    Planned {
        /// Stage whose work is to be done; `None` if there is none.
        stage: Option<Stage>,
        /// Flights in all.
        flights: usize,
        /// Results that are there already.
        reused: usize,
        /// Results to make; flights with the same content share one.
        to_run: usize,
        /// Bytes of the logs to read.
        bytes: u64,
    },
    /// A flight whose result is there already.
    Reused {
        /// Its name.
        flight: String,
    },
    /// A log is opened.
    Started {
        /// Its flight.
        flight: String,
        /// What for.
        stage: Stage,
        /// Why it is read: every reason.
        why: Vec<Why>,
        /// Its size.
        bytes: u64,
    },
    /// So many more bytes of logs were read.
    Read {
        /// Bytes.
        bytes: u64,
    },
    /// The delays of a flight are measured.
    DelayMeasured {
        /// Its name.
        flight: String,
        /// What kind of delay it is.
        kind: DelayKind,
        /// How late the position is, s, if that is known.
        lateness_s: Option<Estimate>,
        /// The same in words.
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
        /// How late the position is, s, if that is known.
        lateness_s: Option<Estimate>,
        /// Delay that was removed, s.
        removed_s: Option<f64>,
        /// Whether what was removed helped.
        effect: Option<EffectVerdict>,
    },
    /// A flight has no lasting result: the next run tries again.
    Troubled {
        /// Its name.
        flight: String,
        /// What went wrong.
        reason: String,
    },
    /// Something that a person should know, and that stops nothing.
    Remark {
        /// A sentence.
        text: String,
    },
    /// Table, records and pages are as they should be.
    Reduced {
        /// Flight pages that were made.
        pages: usize,
        /// Flight pages that stood already.
        kept: usize,
    },
    /// Same logs, same settings, same results: nothing was read and nothing written.
    NothingChanged,
    /// Logs of a bench were found, and are read.
    Logs {
        /// How many.
        logs: usize,
        /// Their bytes.
        bytes: u64,
    },
    /// Records of a bench are measured.
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
        /// Records in all.
        records: usize,
        /// Those that were measured.
        measured: usize,
        /// What is on the card.
        channels: Vec<record::CardChannel>,
        /// What must be said of the records behind it.
        notices: flight::Notices,
    },
    /// What is known of a flight in the end, whenever it was found: one for each, in the order of the table.
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
    /// A night begins with one of its campaigns: the events that follow are of it.
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
        /// The five lines.
        summary: Vec<String>,
        /// What went wrong, by campaign where it is of one.
        errors: Vec<String>,
    },
    /// The end.
    Done {
        /// The report's page.
        report: PathBuf,
        /// Whether everything stood already.
        nothing_changed: bool,
        /// Counts over all flights.
        #[serde(flatten)]
        totals: CampaignTotals,
        /// Flights by their gravest verdict; `None` where no criteria were given.
        #[serde(skip_serializing_if = "Option::is_none")]
        verdicts: Option<VerdictTally>,
    },
}

/// Somebody who wants to know.
pub trait EventSink: Sync {
    /// Takes one event; called from many threads.
    fn event(&self, event: &Event);
}

impl<F: Fn(&Event) + Sync> EventSink for F {
    fn event(&self, event: &Event) {
        self(event);
    }
}
