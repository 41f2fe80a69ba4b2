//! What can go wrong with a history, a fleet file or a nightly file.

use std::path::PathBuf;

/// Why a history could not be read, written or used.
#[derive(Debug, thiserror::Error)]
pub enum HistoryError {
    /// A file or folder cannot be read or written.
    #[error("{}: cannot {doing}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The attempted operation.
        doing: &'static str,
        /// The error of the operating system.
        source: std::io::Error,
    },
    /// A settings file is wrong.
    #[error(transparent)]
    Settings(#[from] settings::SettingsError),
    /// A folder is not the report of a campaign, or one of its files is damaged.
    #[error("{}: {what}", path.display())]
    Report {
        /// The file or folder.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// The command requests something impossible.
    #[error("{0}")]
    Asked(String),
    /// A campaign failed, or one of its settings files is wrong.
    #[error(transparent)]
    Campaign(#[from] campaign::CampaignError),
}

impl HistoryError {
    pub(crate) fn io(path: &std::path::Path, doing: &'static str, source: std::io::Error) -> HistoryError {
        HistoryError::Io { path: path.to_owned(), doing, source }
    }

    /// The exit code for this error.
    #[must_use]
    pub fn exit(&self) -> campaign::Exit {
        match self {
            HistoryError::Settings(_) | HistoryError::Asked(_) => campaign::Exit::Wrong,
            HistoryError::Campaign(error) => error.exit(),
            HistoryError::Io { source, .. } if campaign::may_heal(source) => campaign::Exit::TryAgain,
            HistoryError::Io { .. } | HistoryError::Report { .. } => campaign::Exit::Failed,
        }
    }
}
