//! Progress of a planned campaign, from the results alone.

use crate::error::{CampaignError, Exit};
use crate::manifest::{Manifest, Stage};
use crate::results;
use crate::store::{Check, Store};
use serde::Serialize;

/// Counts of a manifest's flights, and the names of those without a result.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Status {
    /// Stage of the manifest; `None` if it has no work.
    pub stage: Option<Stage>,
    /// All flights of the manifest.
    pub flights: usize,
    /// Flights with the result of that stage.
    pub done: usize,
    /// Flights without one, because of trouble at the last attempt or an unreadable file.
    pub troubled: Vec<Trouble>,
    /// Flights without one that were not attempted yet.
    pub missing: Vec<String>,
}

/// A flight in trouble.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Trouble {
    /// Its name.
    pub flight: String,
    /// What happened.
    pub reason: String,
}

impl Status {
    /// 0 if every flight has a result, else 3.
    #[must_use]
    pub fn exit(&self) -> Exit {
        if self.done == self.flights { Exit::Well } else { Exit::Incomplete }
    }
}

/// Determines which flights of a manifest have the result of its stage.
///
/// # Errors
/// The output folder cannot be opened.
pub fn status(manifest: &Manifest) -> Result<Status, CampaignError> {
    let store = Store::open_planned(manifest.out(), &manifest.out_id)?;
    let mut status =
        Status { stage: manifest.stage(), flights: manifest.flights.len(), done: 0, troubled: vec![], missing: vec![] };
    let is_there = |key: &str| results::is_there(&store, key, Check::Quick);
    for planned in &manifest.flights {
        let key = planned.key.as_deref().unwrap_or_default();
        let is_done = match planned.stage {
            Some(Stage::Measure) => planned.measure_key.as_deref().is_some_and(is_there),
            _ => planned.key.as_deref().is_some_and(is_there),
        };
        let attempt = || results::read_trouble(&store, planned.work_key().unwrap_or(key));
        let reason = || attempt().and_then(|r| r.outcome.reason().map(str::to_owned));
        let flight = planned.flight.clone();
        if is_done {
            status.done += 1;
        } else if let Some(reason) = planned.trouble.clone().or_else(reason) {
            status.troubled.push(Trouble { flight, reason });
        } else {
            status.missing.push(flight);
        }
    }
    Ok(status)
}
