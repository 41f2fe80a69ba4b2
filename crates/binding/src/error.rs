//! Reasons why a log gives no flight.

use formats::LogError;
use logscan::ScanError;
use std::path::PathBuf;

/// The reason why a log gives no flight.
#[derive(Debug, thiserror::Error)]
pub enum IngestError {
    /// It cannot be read.
    #[error(transparent)]
    Log(#[from] LogError),
    /// No channel map fits, or two fit equally.
    #[error("{0}")]
    Map(String),
    /// A channel map of the user is meant for the log and does not fit, or names fields that the log lacks.
    #[error("{0}")]
    MapLacks(String),
    /// A channel map is wrong.
    #[error("{path}{line}: {what}", path = path.display(), line = line.map(|l| format!(":{l}")).unwrap_or_default())]
    BadMap {
        /// Its file.
        path: PathBuf,
        /// Line, from 1, where there is one.
        line: Option<usize>,
        /// What is wrong.
        what: String,
    },
}

impl From<ScanError> for IngestError {
    fn from(source: ScanError) -> IngestError {
        LogError::from(source).into()
    }
}
