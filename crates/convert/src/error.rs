//! Why a conversion failed.

use ingest::{IngestError, ReadContext};
use std::io;
use std::path::{Path, PathBuf};

/// No output was written.
#[derive(Debug, thiserror::Error)]
pub enum ConvertError {
    /// The log cannot be read.
    #[error(transparent)]
    Log(#[from] IngestError),
    /// The output cannot be written.
    #[error("{}: cannot {doing}: {source}", path.display())]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// The attempted operation.
        doing: &'static str,
        /// The error of the operating system.
        source: io::Error,
    },
    /// The output must not be overwritten. Nothing was changed.
    #[error("{}: {what}", path.display())]
    Refused {
        /// The output.
        path: PathBuf,
        /// Why it must not be.
        what: String,
    },
    /// There is nothing to write.
    #[error("{0}")]
    Nothing(String),
    /// The data read back differ from the data written; the output is discarded.
    #[error("{}: the output was read back, differed, and was removed: {what}", path.display())]
    ReadsBackDifferently {
        /// The output.
        path: PathBuf,
        /// What differs.
        what: String,
    },
}

impl ConvertError {
    /// This error, or the cancellation that caused it.
    pub(crate) fn or_stopped(self, context: &ReadContext<'_>) -> ConvertError {
        match context.advance(0) {
            Err(stopped) => ConvertError::Log(stopped.into()),
            Ok(()) => self,
        }
    }

    pub(crate) fn write(path: &Path, doing: &'static str) -> impl FnOnce(io::Error) -> ConvertError {
        let path = path.to_owned();
        move |source| ConvertError::Write { path, doing, source }
    }
}

impl From<ingest::LogError> for ConvertError {
    fn from(error: ingest::LogError) -> ConvertError {
        IngestError::from(error).into()
    }
}
