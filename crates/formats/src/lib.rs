//! Reads log files into tables. The only crate that knows format names.
//!
//! [`sniff`] detects what a file is, [`read`] turns the wanted topics of a log into columns and accounts for every byte.
//! What the columns mean is the matter of the crate `ingest`.

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod bytes;
pub mod civil;
mod decode;
mod error;
mod format;
mod reader;
pub mod sniff;
pub mod stamps;
mod table;
mod texts;
pub mod time;
mod unit;
mod values;
pub mod written_unit;

pub use error::{LogError, file_name};
pub use format::bag_folder;
pub use format::{
    Member, OriginalLog, OriginalTopic, PACKED_ENDINGS, Packing, inert, is_packed_of, members, read, read_files,
    write_ahead_log_of,
};
pub use logscan::ScanError;
pub use reader::{
    Extra, FieldRequest, LeftOut, Limits, Log, MessageSink, RawMessage, ReadContext, Restart, Select, Selection,
    StatedUnit, TableHead, ValueKind,
};
pub use sniff::LogKind;
pub use table::{Column, ColumnData, PAYLOAD_HEX, Places, Table, TopicInfo};
pub use texts::Texts;
pub use unit::FlightUnit;
pub use values::Values;
