//! Reads log files into flights.
//!
//! [`discover`] finds the flights in a folder, [`load`] reads one of them: [`read`] of the crate `formats` turns wanted
//! topics into columns, a [`ChannelMap`] binds columns to channels of a [`flight::Flight`].

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod bind;
mod companion;
mod definitions;
mod discover;
mod error;
mod filler;
mod guess;
mod load;
mod map;
mod platform;

pub use bind::{RowTimes, TableTimes, bind, row_times};
pub use discover::{Discovery, discover};
pub use error::IngestError;
pub use formats::{
    Column, ColumnData, Extra, FieldRequest, FlightUnit, LeftOut, Limits, Log, LogError, LogKind, MessageSink,
    OriginalLog, OriginalTopic, PAYLOAD_HEX, Places, RawMessage, ReadContext, Restart, ScanError, Select, Selection,
    StatedUnit, Table, TableHead, Texts, TopicInfo, ValueKind, Values, inert, read, read_files, stamps,
};
pub use load::{Loaded, load, load_orientations, suggest};
pub use map::{ChannelMap, EXAMPLE_MAP, MapLibrary, MapSelect, SelectAll};
#[cfg(feature = "schema")]
pub use map_file::channel_map_schema;
