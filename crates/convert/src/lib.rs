//! Logs in, other files out.
//!
//! [`recover`] writes what is good of a damaged log as MCAP, message by message as it stood in the log, or as tables that are
//! read again as the log is.
//! [`export_track`] writes the compensated track of a campaign's flight as maps and players read it.
//! [`export`] writes bound channels, or every topic, as Parquet, CSV or MCAP. Both write to a temporary name and rename:
//! an output is absent, the old one, or the new one, whole. What was recovered is read again before it is called done. The
//! log is only read: an output that is one of its files is refused, and so is one that is no plain file.

mod anew;
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

pub use error::ConvertError;
pub use export::{ExportOrder, ExportTo, ExportWhat, Exported, ExportedSheet, export};
pub use recover::{How, Recovered, RecoveredExtra, RecoveredTopic, recover};
pub use sheet::{
    Cells, ROWS_OF_A_GROUP, ReadTable, Sheet, SheetColumn, TextCells, read_parquet, read_parquet_columns, write_csv,
    write_parquet, write_parquet_about, write_parquet_parts,
};
pub use track::{TrackOrder, TrackTo, WrittenTrack, export_track, layouts_of, write_track_table};
