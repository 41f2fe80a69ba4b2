//! Reads log files into flights.
//!
//! [`discover`] finds the flights in a folder, [`load`] reads one of them: [`read`] of the crate `formats` turns wanted
//! topics into columns, a [`ChannelMap`] binds columns to channels of a [`flight::Flight`].

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod companion;
mod discover;
mod load;
mod platform;

#[cfg(feature = "schema")]
pub use binding::channel_map_schema;
pub use binding::{
    ChannelMap, EXAMPLE_MAP, IngestError, MapLibrary, MapSelect, RowTimes, SelectAll, TableTimes, bind, row_times,
};
pub use discover::{Discovery, discover};
pub use formats::{
    Column, ColumnData, Extra, FieldRequest, FlightUnit, LeftOut, Limits, Log, LogError, LogKind, MessageSink,
    OriginalLog, OriginalTopic, PAYLOAD_HEX, Places, RawMessage, ReadContext, Restart, ScanError, Select, Selection,
    StatedUnit, Table, TableHead, Texts, TopicInfo, ValueKind, Values, inert, read, read_files, stamps,
};
pub use load::{Loaded, load, load_orientations, suggest};
