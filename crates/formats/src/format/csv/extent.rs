//! Extent of one record in the buffer.

/// One record that is complete in the buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Extent {
    /// The length of the record without its line end, bytes.
    pub(super) text: usize,
    /// The length with the line end, bytes.
    pub(super) whole: usize,
    /// The number of lines of the record: more than one if a quoted field holds line ends.
    pub(super) lines: u64,
    /// Whether a line end follows; only the last record of a file may lack it.
    pub(super) ended: bool,
    /// Whether quotes do not match. The line is then a separate record.
    pub(super) broken: bool,
}
