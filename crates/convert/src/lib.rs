//! Converts logs to other files.
//!
//! [`recover`] writes everything recoverable from a damaged log: as MCAP, message by message unchanged, or as tables
//! that are read back as the log is. [`export_track`] writes the compensated track of a campaign's flight in the
//! formats of maps and players. [`export`] writes bound channels, or every topic, as Parquet, CSV or MCAP. Both write
//! to a temporary name and rename: an output is absent, the old one, or the complete new one. A recovered file is read
//! back before it is reported as done. The log is only read: an output path that is one of its files, or not a regular
//! file, is rejected.

mod error;
mod export;
mod guard;
mod leftover;
mod message_type;
mod output;
mod recording;
mod recover;
mod row_time;
mod sheet;
mod swap;
mod track;
mod typed_topics;

pub use error::ConvertError;
pub use export::{ExportOrder, ExportTo, ExportWhat, Exported, ExportedSheet, TABLES_MAP, export};
pub use recover::{How, Recovered, RecoveredExtra, RecoveredTopic, recover};
pub use sheet::{
    Cells, ROWS_OF_A_GROUP, ReadTable, Sheet, SheetColumn, TextCells, read_parquet, read_parquet_columns, write_csv,
    write_parquet, write_parquet_about, write_parquet_parts,
};
pub use track::{TrackOrder, TrackTo, WrittenTrack, export_track, layouts_of, write_track_table};
