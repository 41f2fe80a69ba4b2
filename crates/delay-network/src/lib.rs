//! One lateness per channel, from all measured pairs of a flight; one delay per group of flights; and the delay to
//! remove.
//!
//! [`solve`] builds a network from the pairs of one flight, [`pool`] averages the flights of one group, and [`decide`]
//! chooses the delay to remove from each flight. Positive is late, in seconds. Source: `science/delay-network.md`; the
//! docs cite its sections. The crate handles no files, samples or pages.

mod adjust;
mod attitudes;
mod channels;
#[cfg(test)]
mod coverage;
mod decide;
mod graph;
mod isolate;
mod lineage;
mod noise;
mod observation;
mod pool;
mod settings;
mod solve;
mod words;

pub use crate::decide::{FlightSources, GroupDecision, PositionLateness, RelativeLateness, decide};
pub use crate::lineage::{Lineage, is_acceleration, lineage_from_name};
pub use crate::observation::PairObservation;
pub use crate::pool::{FlightLateness, pool};
pub use crate::settings::{ModelErrors, NetworkSettings, ReferenceUse};
pub use crate::solve::{difference, solve};
