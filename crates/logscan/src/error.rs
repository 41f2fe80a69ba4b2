//! Why a file cannot be read. Damage that leaves something usable is not an error.

/// The file cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ScanError {
    /// The system cannot read it.
    #[error("{file}: byte {offset}: {source}")]
    Io {
        /// File name.
        file: String,
        /// Offset at which the read began.
        offset: u64,
        /// The error of the operating system.
        source: std::io::Error,
    },
    /// It is not a regular file.
    #[error("{file}: not a regular file")]
    NotAFile {
        /// File name.
        file: String,
    },
    /// It changed while it was being read.
    #[error("{file}: the file changed while it was read")]
    Changed {
        /// File name.
        file: String,
    },
    /// The user stopped.
    #[error("stopped")]
    Cancelled,
}
