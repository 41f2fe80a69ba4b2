//! Why a flight cannot be simulated or written.

use std::path::PathBuf;

/// A simulation that cannot be.
#[derive(Debug, thiserror::Error)]
pub enum SimulateError {
    /// A setting makes no sense.
    #[error("{setting} = {value}: {expected}")]
    Setting {
        /// Its name.
        setting: &'static str,
        /// What was asked for.
        value: f64,
        /// What it may be.
        expected: &'static str,
    },
    /// A file or folder cannot be written.
    #[error("{path}: {source}", path = path.display())]
    Write {
        /// Which.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// A compressor failed.
    #[error("{what}: {source}")]
    Compress {
        /// Which.
        what: &'static str,
        /// What it says.
        source: std::io::Error,
    },
    /// The MCAP writer failed.
    #[error("MCAP writer: {0}")]
    Mcap(#[from] mcap::McapError),
    /// SQLite failed.
    #[cfg(feature = "db3")]
    #[error("SQLite: {0}")]
    Sqlite(#[from] rusqlite::Error),
    /// A record cannot be written as JSON.
    #[error("JSON: {0}")]
    Json(#[from] serde_json::Error),
    /// What is no flight has no such form.
    #[error("only flights are written as {0}")]
    OnlyFlights(&'static str),
    /// Samples that make no series: a fault of the simulation itself.
    #[error("simulated samples: {0}")]
    Series(#[from] flight::SeriesError),
}

/// Refuses a setting outside `low..=high`.
pub(crate) fn within(
    setting: &'static str,
    value: f64,
    low: f64,
    high: f64,
    expected: &'static str,
) -> Result<(), SimulateError> {
    // A NaN is in no range, so it is refused too.
    if (low..=high).contains(&value) { Ok(()) } else { Err(SimulateError::Setting { setting, value, expected }) }
}
