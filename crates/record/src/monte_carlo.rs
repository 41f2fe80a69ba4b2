//! What a Monte-Carlo study says of an estimator.

use crate::replay::Estimate;
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// One case of a study.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct MonteCarloCase {
    /// What was simulated, in words.
    pub name: String,
    /// Trials.
    pub trials: u64,
    /// Columns of numbers, in the order of the group's columns; `None` where the case has no such number.
    pub values: Vec<Option<Estimate>>,
    /// Whether each goal of the group is met within the error of the study; `None` where the column has none.
    pub met: Vec<Option<bool>>,
}

/// Cases with the same columns.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct MonteCarloGroup {
    /// Title.
    pub title: String,
    /// What is done and what the goals are, in words.
    pub text: String,
    /// Columns with units, as `rms/CRLB`.
    pub columns: Vec<String>,
    /// Goal of each column in words; empty if none.
    pub goals: Vec<String>,
    /// Cases.
    pub cases: Vec<MonteCarloCase>,
}

/// A study.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct MonteCarloRecord {
    /// [`crate::RECORD_VERSION`].
    pub record_version: u32,
    /// Title.
    pub title: String,
    /// Seed of everything random.
    pub seed: u64,
    /// Command that makes this again.
    pub command: String,
    /// Groups of cases.
    pub groups: Vec<MonteCarloGroup>,
}
