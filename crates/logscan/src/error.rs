//! Why a file cannot be read. Damage that leaves something to use is no error.

/// The file cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ScanError {
    /// The system cannot read it.
    #[error("{file}: byte {offset}: {source}")]
    Io {
        /// File name.
        file: String,
        /// Where the read began.
        offset: u64,
        /// What the system says.
        source: std::io::Error,
    },
    /// It is not a regular file.
    #[error("{file}: not a regular file")]
    NotAFile {
        /// File name.
        file: String,
    },
    /// It changed while it was read.
    #[error("{file}: the file changed while it was read")]
    Changed {
        /// File name.
        file: String,
    },
    /// The user stopped.
    #[error("stopped")]
    Cancelled,
}
