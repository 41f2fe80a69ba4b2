//! Records as JSON. Kept in one place, and read by way of a [`Value`] only, so that the code for these large types is
//! compiled once.

use crate::{BenchRecord, CampaignRecord, FlightLateness, FlightRecord, FlightRow, MeasuredFlight};
use serde_json::{Error, Value};

impl FlightRecord {
    /// Serialises as JSON on one line.
    #[must_use]
    pub fn to_json(&self) -> Vec<u8> {
        line(serde_json::to_vec(self))
    }

    /// Converts to a JSON value.
    ///
    /// # Errors
    /// Does not fail in practice: all map keys are strings.
    pub fn to_value(&self) -> Result<Value, Error> {
        serde_json::to_value(self)
    }

    /// Converts from a JSON value.
    ///
    /// # Errors
    /// The value is not a record of this version.
    pub fn from_value(value: Value) -> Result<FlightRecord, Error> {
        serde_json::from_value(value)
    }
}

impl MeasuredFlight {
    /// Serialises as JSON on one line.
    #[must_use]
    pub fn to_json(&self) -> Vec<u8> {
        line(serde_json::to_vec(self))
    }

    /// Reads from JSON.
    ///
    /// # Errors
    /// The text is not a measurement of this version.
    pub fn from_json(text: &[u8]) -> Result<MeasuredFlight, Error> {
        serde_json::from_value(serde_json::from_slice(text)?)
    }
}

impl FlightLateness {
    /// Reads from JSON.
    ///
    /// # Errors
    /// The text is not a lateness of this version.
    pub fn from_json(text: &[u8]) -> Result<FlightLateness, Error> {
        serde_json::from_value(serde_json::from_slice(text)?)
    }
}

impl CampaignRecord {
    /// Serialises as multi-line JSON, without the rows.
    #[must_use]
    pub fn to_json(&self) -> Vec<u8> {
        line(serde_json::to_vec_pretty(self))
    }

    /// Reads from JSON, without rows.
    ///
    /// # Errors
    /// The text is not a record of this version.
    pub fn from_json(text: &[u8]) -> Result<CampaignRecord, Error> {
        serde_json::from_value(serde_json::from_slice(text)?)
    }
}

impl BenchRecord {
    /// Serialises as JSON on one line.
    #[must_use]
    pub fn to_json(&self) -> Vec<u8> {
        line(serde_json::to_vec(self))
    }
}

impl FlightRow {
    /// Serialises as JSON on one line.
    #[must_use]
    pub fn to_json(&self) -> Vec<u8> {
        line(serde_json::to_vec(self))
    }

    /// Reads from JSON.
    ///
    /// # Errors
    /// The text is not a row of this version.
    pub fn from_json(text: &[u8]) -> Result<FlightRow, Error> {
        serde_json::from_value(serde_json::from_slice(text)?)
    }
}

/// Serialising these types cannot fail: all map keys are strings.
fn line(text: Result<Vec<u8>, Error>) -> Vec<u8> {
    let mut text = text.unwrap_or_default();
    text.push(b'\n');
    text
}
