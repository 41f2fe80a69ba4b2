//! The files that make up one log.

use crate::sniff::LogKind;
use std::path::PathBuf;

/// The files of one flight.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct FlightUnit {
    /// Path below the root with `/` between folders. For several files that make one flight: their folder and the
    /// common prefix of their names.
    pub id: String,
    /// Its files in the order in which they are read: sorted, or in recording order.
    pub files: Vec<PathBuf>,
    /// How they are read.
    pub kind: LogKind,
}
