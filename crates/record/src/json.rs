//! Records as JSON: here alone, so that the code that reads and writes these large types is made once.

use crate::{BenchRecord, CampaignRecord, FlightRecord, FlightRow, MeasuredFlight};
use serde_json::{Error, Value};

impl FlightRecord {
    /// As JSON in one line.
    #[must_use]
    pub fn to_json(&self) -> Vec<u8> {
        line(serde_json::to_vec(self))
    }

    /// As a JSON value.
    ///
    /// # Errors
    /// None in practice: the types have text keys.
    pub fn to_value(&self) -> Result<Value, Error> {
        serde_json::to_value(self)
    }

    /// From a JSON value.
    ///
    /// # Errors
    /// The value is no record of this version.
    pub fn from_value(value: Value) -> Result<FlightRecord, Error> {
        serde_json::from_value(value)
    }
}

impl MeasuredFlight {
    /// As JSON in one line.
    #[must_use]
    pub fn to_json(&self) -> Vec<u8> {
        line(serde_json::to_vec(self))
    }

    /// From JSON.
    ///
    /// # Errors
    /// The text is no measurement of this version.
    pub fn from_json(text: &[u8]) -> Result<MeasuredFlight, Error> {
        serde_json::from_value(serde_json::from_slice(text)?)
    }
}

impl CampaignRecord {
    /// As JSON in many lines, without the rows.
    #[must_use]
    pub fn to_json(&self) -> Vec<u8> {
        line(serde_json::to_vec_pretty(self))
    }

    /// From JSON, without rows.
    ///
    /// # Errors
    /// The text is no record of this version.
    pub fn from_json(text: &[u8]) -> Result<CampaignRecord, Error> {
        serde_json::from_slice(text)
    }
}

impl BenchRecord {
    /// As JSON in one line.
    #[must_use]
    pub fn to_json(&self) -> Vec<u8> {
        line(serde_json::to_vec(self))
    }
}

impl FlightRow {
    /// As JSON in one line.
    #[must_use]
    pub fn to_json(&self) -> Vec<u8> {
        line(serde_json::to_vec(self))
    }

    /// From JSON.
    ///
    /// # Errors
    /// The text is no row of this version.
    pub fn from_json(text: &[u8]) -> Result<FlightRow, Error> {
        serde_json::from_slice(text)
    }
}

/// The types have text keys and no way to fail.
fn line(text: Result<Vec<u8>, Error>) -> Vec<u8> {
    let mut text = text.unwrap_or_default();
    text.push(b'\n');
    text
}
