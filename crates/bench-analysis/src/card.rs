//! Sensor cards: validated reading, readable writing, and combination of several records of one sensor.

mod combine;
#[cfg(test)]
mod example;
mod file;
mod identity;
mod iron;

pub use combine::{CardTerms, Combined, combine};
#[cfg(feature = "schema")]
pub use file::card_schema;
pub use file::{card_text, parse_card};
pub use identity::{identity_conflict, sensor_name};
pub use iron::{MagneticEvidence, card_magnetometer};

use std::path::PathBuf;

/// An error in a sensor card, or in the records for one, with its location.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}{}: {what}", file.display(), line.map(|l| format!(":{l}")).unwrap_or_default())]
pub struct CardError {
    /// The card, or the record.
    pub file: PathBuf,
    /// Line, from 1, if known.
    pub line: Option<usize>,
    /// What is wrong, and what is expected.
    pub what: String,
}
