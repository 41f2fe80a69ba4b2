//! Which delay is removed (section 6).

mod decision_words;
mod grid;
mod group;
mod table;

use self::group::GroupFlights;
use self::table::Table;
use record::{DelayPool, DelaySource, Estimate, NetworkDatum, NetworkVerdict, RemovedDelay};

/// Lateness of one flight's position channel, according to its network.
#[derive(Debug, Clone, PartialEq)]
pub struct PositionLateness {
    /// Lateness T with U, s.
    pub lateness_s: Estimate,
    /// Model part of U, s.
    pub model_uncertainty_s: f64,
    /// Datum of the channel's part.
    pub datum: NetworkDatum,
    /// Verdict of the network.
    pub verdict: NetworkVerdict,
    /// Whether the only path to the datum leads through a filter that is made from it.
    pub weak: bool,
}

/// Position against velocity of one flight.
#[derive(Debug, Clone, PartialEq)]
pub struct RelativeLateness {
    /// `Tp − Tv`, s.
    pub delay_s: Estimate,
    /// Velocity channel.
    pub velocity: String,
}

/// All sources for the delay of one flight.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FlightSources {
    /// Flight, unique in its group.
    pub flight: String,
    /// Lateness of the position; `None` without a network.
    pub position: Option<PositionLateness>,
    /// Why there is no position; `None` if there is one, or if no pair was tried.
    pub not_measured: Option<String>,
    /// Position against velocity; `None` if not measured.
    pub relative: Option<RelativeLateness>,
    /// Delay of a valid card of this sensor, s, installation included in its uncertainty.
    pub card_s: Option<Estimate>,
    /// Number stated in the pipeline, s.
    pub stated_s: Option<Estimate>,
    /// Reason to exclude this flight from the mean of the others, such as a delay that steps; `None` to include it.
    pub keep_out_of_pool: Option<String>,
}

/// Decision for the flights of one group.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct GroupDecision {
    /// Delay removed from each flight, in the order of the flights given.
    pub removed: Vec<RemovedDelay>,
    /// Pools of the group's flights, outliers included and marked. The pool of the whole group comes first. If the
    /// group is split, those of its clusters follow. Empty without a usable flight.
    pub pools: Vec<DelayPool>,
    /// Flights without a delay of their own whose difference between position and velocity is not that of the others.
    pub unlike: Vec<String>,
}

/// Delay that is removed from each flight of one group, by the table of section 6.
///
/// By default it is the mean of the *other* flights of the group, so that the residual in the flight is an independent
/// test of it. Outliers (externally studentised |z| > 3) and flights without a delay of their own are in no mean. A
/// group of two clusters is pooled per cluster. A flight whose cluster is unknown gets no mean.
///
/// A value from flights is rounded to a grid: the largest power of ten of a second that is at most a quarter of its
/// standard uncertainty, and at least 0.1 ms. With 8 ms the grid is 1 ms, so rounding moves the value by 0.5 ms at
/// most. One more flight among ten thousand moves their mean by microseconds and rarely changes any removed value. The
/// grids are powers of ten, not 1-2-5, because each such grid contains the coarser ones, and because the uncertainty of
/// a pool is near 8 ms, where a 1-2-5 grid changes its step. The standard uncertainty is rounded up to two digits. A
/// stated number, a card and a sweep are not rounded.
///
/// `value_s`, `standard_uncertainty_s` and `source` depend on the set of flights as described. `pooled_flights`, `z`
/// and `words` change with every flight and must not be part of a cache key.
///
/// Measured: 20 000 flights take a fraction of a second (test `twenty_thousand_flights_are_decided_together`).
#[must_use]
pub fn decide(flights: &[FlightSources], asked: DelaySource, datum_uncertainty_s: f64) -> GroupDecision {
    let group = GroupFlights::new(flights, datum_uncertainty_s);
    let removed = flights
        .iter()
        .enumerate()
        .map(|(at, flight)| Table { flight, evidence: group.evidence(at) }.removed(asked))
        .collect();
    let is_unlike = |at: &usize| group.evidence(*at).unlike_s.is_some();
    let unlike = (0..flights.len()).filter(is_unlike).map(|at| flights[at].flight.clone()).collect();
    GroupDecision { removed, pools: group.into_pools(), unlike }
}
