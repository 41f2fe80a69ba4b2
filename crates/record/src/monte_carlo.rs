//! Results of a Monte-Carlo study of an estimator.

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
    /// Number of trials.
    pub trials: u64,
    /// Columns of numbers, in the order of the group's columns; `None` where a number does not apply to the case.
    pub values: Vec<Option<Estimate>>,
    /// Whether each goal of the group is met within the error of the study; `None` where the column has no goal.
    pub met: Vec<Option<bool>>,
}

/// Cases with the same columns.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct MonteCarloGroup {
    /// Title.
    pub title: String,
    /// Procedure and goals, in words.
    pub text: String,
    /// Columns with units, such as `rms/CRLB`.
    pub columns: Vec<String>,
    /// Goal of each column in words; empty without a goal.
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
    /// Seed of all random numbers.
    pub seed: u64,
    /// Command that reproduces this.
    pub command: String,
    /// Groups of cases.
    pub groups: Vec<MonteCarloGroup>,
}
