//! One lateness per channel, from all measured pairs of a flight; one delay per group of flights; and the delay that is
//! removed.
//!
//! [`solve`] makes a network of the pairs of one flight, [`pool`] a mean of the flights of one group, [`decide`] says which
//! delay is removed from each flight. Positive is late, in seconds. Source: `science/delay-network.md`, whose
//! sections the docs name. The crate knows no file, no sample and no page.

mod adjust;
mod attitudes;
mod channels;
#[cfg(test)]
mod coverage;
mod decide;
mod graph;
mod isolate;
mod lineage;
mod loops;
mod noise;
mod observation;
mod pool;
mod settings;
mod solve;
mod suggest;
mod words;

pub use crate::decide::{AskedSource, FlightSources, GroupDecision, PositionLateness, RelativeLateness, decide};
pub use crate::lineage::{Lineage, lineage_from_name};
pub use crate::observation::{PairObservation, acceleration_gate};
pub use crate::pool::{FlightLateness, pool};
pub use crate::settings::{ModelErrors, NetworkSettings, ReferenceUse};
pub use crate::solve::{difference, expected_residual, judge_against_reference, solve};
