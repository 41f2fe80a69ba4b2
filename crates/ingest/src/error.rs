//! Reasons why a log cannot be used at all. Damage that leaves something usable is not an error.

use logscan::ScanError;
use std::path::{Path, PathBuf};

/// The reason why nothing of the log can be used.
#[derive(Debug, thiserror::Error)]
pub enum IngestError {
    /// A file cannot be read, changed meanwhile, or the user stopped.
    #[error(transparent)]
    Read(#[from] ScanError),
    /// The file is not a known log.
    #[error("{file}: {what}")]
    NotALog {
        /// File name.
        file: String,
        /// What it is instead, or what was expected.
        what: String,
    },
    /// It is a log, but nothing in it is intact.
    #[error("{file}: {what}")]
    Unusable {
        /// File name, with byte or line where known.
        file: String,
        /// What is wrong.
        what: String,
    },
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

impl IngestError {
    /// A file that cannot be opened, or has no readable size.
    pub(crate) fn of_file(path: &Path, source: std::io::Error) -> IngestError {
        ScanError::Io { file: file_name(path), offset: 0, source }.into()
    }
}

/// The file name for messages.
pub(crate) fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}
