//! Why a conversion was not made.

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
        /// What was tried.
        doing: &'static str,
        /// What the system says.
        source: io::Error,
    },
    /// The output is not one that may be written over. Nothing was touched.
    #[error("{}: {what}", path.display())]
    Refused {
        /// The output.
        path: PathBuf,
        /// What it is.
        what: String,
    },
    /// There is nothing that could be written.
    #[error("{0}")]
    Nothing(String),
    /// What was read back is not what was written; the output is not kept.
    #[error("{}: the output reads back differently and was removed: {what}", path.display())]
    ReadsBackDifferently {
        /// The output.
        path: PathBuf,
        /// What differs.
        what: String,
    },
}

impl ConvertError {
    /// What a wish to stop made of it.
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
