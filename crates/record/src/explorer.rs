//! The rows of a replay in few bytes, for a page that lets a reader zoom into them.

#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Rows of a replay, packed.
///
/// `data` is base64 (RFC 4648, section 4) of a raw deflate stream (RFC 1951). Inflated, it holds one block for each column:
/// the lowest byte of every row, then the next, up to the fourth. They make little-endian 32-bit integers `z`: zigzag of
/// differences, `(z >> 1) ^ −(z & 1)`, as many times over as [`ExplorerColumn::differences`] says. [`ExplorerRows::MISSING`] is a row without a value: the
/// differences go on from the last row that has one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ExplorerRows {
    /// Rows that are here.
    pub rows: u64,
    /// Rows of the replay.
    pub of: u64,
    /// Of this many rows one after another, those that hold an extreme of any column are here; 1 if all are.
    pub extremes_of: u64,
    /// A longer step between rows of the replay is a gap, s.
    pub gap_s: f64,
    /// Time first, then positions.
    pub columns: Vec<ExplorerColumn>,
    /// All columns.
    pub data: String,
}

/// A column of [`ExplorerRows`].
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ExplorerColumn {
    /// `t` in ms after the origin of the replay, or `raw_north`, `exact_async_east`, `truth_north` and so on in cm.
    pub name: String,
    /// 1: differences from the row before. 2: differences of these.
    pub differences: u8,
}

impl ExplorerRows {
    /// Stands for a value that is not there.
    pub const MISSING: i32 = i32::MIN;
}
