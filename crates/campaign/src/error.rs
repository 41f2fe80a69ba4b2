//! Errors that end a campaign. A corrupt flight does not: it is a row of the table.

use crate::s3::is_in_bucket;
use settings::SettingsError;
use std::io::ErrorKind;
use std::path::PathBuf;

/// Start of the reason for skipping a log that is still being written.
pub const STILL_WRITTEN: &str = "still being written; skipped until the next run";

/// An output could not be written, read or removed.
#[derive(Debug, thiserror::Error)]
#[error("{}: cannot {doing}: {source}", path.display())]
pub struct StoreError {
    /// The file or folder.
    pub path: PathBuf,
    /// The attempted operation.
    pub doing: &'static str,
    /// Error of the operating system.
    pub source: std::io::Error,
}

/// Why a campaign did not finish.
#[derive(Debug, thiserror::Error)]
pub enum CampaignError {
    /// A pipeline, criteria or rig file is wrong.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The command asks for something that cannot be done.
    #[error("{0}")]
    Asked(String),
    /// The folder of flights, or a channel map, cannot be used.
    #[error(transparent)]
    Ingest(#[from] ingest::IngestError),
    /// Nothing in the folder is a known log.
    #[error("{}: no flight found: {what}", path.display())]
    NoFlights {
        /// The folder.
        path: PathBuf,
        /// What its files are instead.
        what: String,
    },
    /// An output could not be written.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// Another process uses the same output folder.
    #[error("{}: another flightlag is working on this folder ({owner})", out.display())]
    Busy {
        /// The output folder.
        out: PathBuf,
        /// Its process and host.
        owner: String,
    },
    /// A table could not be made.
    #[error("{path}: {what}")]
    Table {
        /// Its path below the output folder.
        path: String,
        /// Error of the table library.
        what: String,
    },
    /// The manifest cannot be read, or was made by another version.
    #[error("{}: {what}", path.display())]
    Manifest {
        /// Its file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// All logs were modified more recently than the settling time of the order.
    #[error("all logs ({}) are {}", .0.len(), STILL_WRITTEN)]
    AllStillWritten(Vec<String>),
    /// Something is not available yet or has changed; the same command may work later.
    #[error("{0}")]
    TryAgain(String),
    /// The inputs have changed since the plan. Waiting does not help; a new plan does.
    #[error("{0}: plan again")]
    Outdated(String),
    /// The user stopped.
    #[error("stopped; finished flights are kept; run the same command again to continue")]
    Cancelled,
}

/// How a command ended, for the shell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Exit {
    /// Success.
    Well = 0,
    /// Failed.
    Failed = 1,
    /// Wrong command, pipeline or rig.
    Wrong = 2,
    /// Finished, but some flights failed or lost data, or no flight has the number of a criterion.
    Incomplete = 3,
    /// Finished, but a criterion is not met. It outweighs [`Exit::Incomplete`]: a damaged log must not hide a failed
    /// criterion.
    CriterionFailed = 4,
    /// Temporary failure: try again later.
    TryAgain = 75,
    /// Stopped by the user.
    Stopped = 130,
}

impl CampaignError {
    /// The exit code of this error.
    #[must_use]
    pub fn exit(&self) -> Exit {
        match self {
            CampaignError::Settings(_) | CampaignError::Asked(_) => Exit::Wrong,
            CampaignError::Ingest(ingest::IngestError::BadMap { .. }) => Exit::Wrong,
            CampaignError::Store(error) if crate::disk::may_heal(&error.source) => Exit::TryAgain,
            // An invalid bucket address, or a build without S3 support.
            CampaignError::Store(error)
                if error.source.kind() == ErrorKind::InvalidInput && is_in_bucket(&error.path) =>
            {
                Exit::Wrong
            }
            CampaignError::TryAgain(_) | CampaignError::AllStillWritten(_) | CampaignError::Busy { .. } => {
                Exit::TryAgain
            }
            CampaignError::Cancelled
            | CampaignError::Ingest(ingest::IngestError::Log(ingest::LogError::Read(ingest::ScanError::Cancelled))) => {
                Exit::Stopped
            }
            _ => Exit::Failed,
        }
    }
}
