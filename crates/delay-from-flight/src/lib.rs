//! Relative lateness of the channels of a flight, measured from the flight itself.
//!
//! A position is the integral of its velocity: `p(t) = c + d·(t − t_m) + ∫v(t − δ) + noise`, north and east with one δ.
//! The same holds for a velocity and the acceleration, and without the integral for two tracks. Only differences of
//! delays are observable this way: δ = Tp − Tv and so on (design note 4). The estimator is [`signal::fit_delay`].
//!
//! [`measure_delays`] measures every pair of channels, [`measure_against_reference`] one of them, and a [`TrackFitter`]
//! how late tracks are against their velocity.

mod attitude;
mod bands;
#[cfg(test)]
mod body_bias;
mod coarse;
mod disturbance;
mod doubt;
mod fit;
mod foreign;
mod gate;
mod horizontal;
mod injection;
mod local;
mod measure;
mod measured_pairs;
mod objective;
mod over_time;
mod pairs;
mod pieces;
mod reference;
mod residual;
mod skew;
mod split;
mod thin;
mod varies;

pub use horizontal::{AXES, Horizontal};
pub use measured_pairs::{FlightDelaySettings, measure_against_reference, measure_delays};
pub use residual::{TrackFit, TrackFitter};
pub use thin::Averaged;
