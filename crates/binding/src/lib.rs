//! Binds the columns of a log to the channels of a [`flight::Flight`].
//!
//! A [`ChannelMap`] states which topic and field is which channel, in which unit, frame and timeline. [`bind`] finds the
//! map that fits a log and makes the flight, [`row_times`] gives the times of all its rows.

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod bind;
mod definitions;
mod error;
mod filler;
mod map;

pub use bind::{RowTimes, TableTimes, bind, from_euler, row_times, stamps_by};
pub use error::IngestError;
pub use filler::is_all_nines;
pub use map::{AttitudeFrame, ChannelMap, EXAMPLE_MAP, MapLibrary, MapSelect, SelectAll, is_shipped};
#[cfg(feature = "schema")]
pub use map_file::channel_map_schema;
