//! The rows of a replay in compact form, for a page with zoom.

#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Rows of a replay, packed.
///
/// `data` is base64 (RFC 4648, section 4) of a raw deflate stream (RFC 1951). Inflated, it holds one block for each
/// column: the lowest byte of every row, then the next, up to the fourth. Together they form little-endian 32-bit
/// integers `z`: zigzag-coded differences, `(z >> 1) ^ −(z & 1)`, of the order given by
/// [`ExplorerColumn::differences`]. [`ExplorerRows::MISSING`] marks a row without a value: the differences continue
/// from the last row with a value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
pub struct ExplorerRows {
    /// Rows contained here.
    pub rows: u64,
    /// Rows of the replay.
    pub of: u64,
    /// Block size: of this many consecutive rows, only those with an extreme of any column are kept; 1 if all are kept.
    pub extremes_of: u64,
    /// A step between rows of the replay longer than this is a gap, s.
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
    /// 1: differences from the row before. 2: differences of those differences.
    pub differences: u8,
}

impl ExplorerRows {
    /// Marks a missing value.
    pub const MISSING: i32 = i32::MIN;
}
