//! Reasons why a log cannot be read at all. Damage that leaves something usable is not an error.

use logscan::ScanError;
use std::path::Path;

/// The reason why nothing of the log can be read.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
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
}

impl LogError {
    /// A file that cannot be opened, or has no readable size.
    #[must_use]
    pub fn of_file(path: &Path, source: std::io::Error) -> LogError {
        ScanError::Io { file: file_name(path), offset: 0, source }.into()
    }
}

/// The file name for messages.
#[must_use]
pub fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}
