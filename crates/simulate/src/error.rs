//! Why a flight cannot be simulated or written.

use std::path::PathBuf;

/// Why a simulation fails.
#[derive(Debug, thiserror::Error)]
pub enum SimulateError {
    /// A setting is invalid.
    #[error("{setting} = {value}: {expected}")]
    Setting {
        /// Its name.
        setting: &'static str,
        /// Its value.
        value: f64,
        /// Allowed values.
        expected: &'static str,
    },
    /// A file or folder cannot be written.
    #[error("{path}: {source}", path = path.display())]
    Write {
        /// Its path.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// A compressor failed.
    #[error("{what}: {source}")]
    Compress {
        /// Name of the compressor.
        what: &'static str,
        /// Its error.
        source: std::io::Error,
    },
    /// The MCAP writer failed.
    #[error("MCAP writer: {0}")]
    Mcap(#[from] mcap::McapError),
    /// SQLite failed.
    #[cfg(feature = "every-format")]
    #[error("SQLite: {0}")]
    Sqlite(#[from] rusqlite::Error),
    /// A record cannot be written as JSON.
    #[error("JSON: {0}")]
    Json(#[from] serde_json::Error),
    /// Only a flight can be written in this format.
    #[cfg(feature = "every-format")]
    #[error("only flights can be written as {0}")]
    OnlyFlights(&'static str),
    /// Samples that are not a valid series: a bug in the simulation.
    #[error("simulated samples: {0}")]
    Series(#[from] flight::SeriesError),
}

/// Rejects a setting outside `low..=high`.
pub(crate) fn within(
    setting: &'static str,
    value: f64,
    low: f64,
    high: f64,
    expected: &'static str,
) -> Result<(), SimulateError> {
    // A NaN is not in any range, so it is also rejected.
    if (low..=high).contains(&value) { Ok(()) } else { Err(SimulateError::Setting { setting, value, expected }) }
}
