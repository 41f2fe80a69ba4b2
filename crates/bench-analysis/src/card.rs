//! Sensor cards: validated reading, readable writing, and combination of several records of one sensor.

mod combine;
#[cfg(test)]
pub(crate) mod example;
mod file;
mod identity;
mod iron;

pub use combine::{CardTerms, Combined, combine, copies};
#[cfg(feature = "schema")]
pub use file::card_schema;
pub use file::{card_text, parse_card};
pub use identity::{identity_conflict, sensor_name};
pub use iron::{MagneticEvidence, card_magnetometer};
