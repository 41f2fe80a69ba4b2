//! Bytes to flights. The only crate that knows a format's name.
//!
//! [`discover`] finds the flights in a folder, [`load`] reads one of them: a [`LogReader`]
//! turns wanted topics into columns, a [`ChannelMap`] binds columns to channels of a
//! [`flight::Flight`].

#![cfg_attr(not(test), deny(clippy::indexing_slicing, clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod error;
mod ledger;
mod reader;
mod table;

pub use error::IngestError;
pub use reader::{FieldRequest, Limits, Log, LogReader, ReadContext, Select, Selection, TopicInfo, ValueKind};
pub use table::{Column, ColumnData, Table};
