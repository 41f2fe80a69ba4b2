//! Reads log files into flights. The only crate that knows format names.
//!
//! [`discover`] finds the flights in a folder, [`load`] reads one of them: [`read`]
//! turns wanted topics into columns, a [`ChannelMap`] binds columns to channels of a
//! [`flight::Flight`].

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod bind;
mod bytes;
mod civil;
mod companion;
mod decode;
mod definitions;
mod discover;
mod error;
mod format;
mod guess;
mod load;
mod map;
mod map_schema;
mod platform;
mod reader;
mod sniff;
pub mod stamps;
mod table;
mod texts;
mod time;
mod values;
mod written_unit;

pub use bind::{RowTimes, TableTimes, bind, row_times};
pub use discover::{Discovery, FlightUnit, discover};
pub use error::IngestError;
pub use format::{OriginalLog, OriginalTopic, inert, read};
pub use load::{Loaded, load, load_orientations, read_files, suggest};
pub use logscan::ScanError;
pub use map::{ChannelMap, EXAMPLE_MAP, MapLibrary, MapSelect, SelectAll};
#[cfg(feature = "schema")]
pub use map_schema::channel_map_schema;
pub use reader::{
    Extra, FieldRequest, LeftOut, Limits, Log, MessageSink, RawMessage, ReadContext, Restart, Select, Selection,
    StatedUnit, TableHead, ValueKind,
};
pub use sniff::LogKind;
pub use table::{Column, ColumnData, PAYLOAD_HEX, Places, Table, TopicInfo};
pub use texts::Texts;
pub use values::Values;
