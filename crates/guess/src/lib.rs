//! Guesses the channel map of a text table that no channel map fits.
//!
//! [`guess()`] infers it from column names, their units, and whether the velocity agrees with the motion of the position,
//! [`guess_by_motion`] from the motion alone. [`orientations`] gives every possible one for a second file of a flight.
//!
//! A crate of its own, because it is nearly as large as what binds the columns and runs at most once for a log: it is
//! compiled with less optimisation.

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod body;
mod by_motion;
mod column_groups;
mod compare;
mod found;
mod guess;
mod names;
mod orientations;
mod time_blocks;
mod time_columns;
mod windows;
mod write;

pub use found::Guess;
pub use guess::{
    NO_TIME, Wanted, any_headerless, guess, guess_by_motion, may_hold_both, wanted, wanted_by_motion, why_nameless,
};
pub use orientations::orientations;
pub use write::renamed;
