//! A guessed map, and the items that it is made of.

use super::column_groups::TableColumns;
use super::time_columns::Timing;

/// A guessed map.
#[derive(Debug)]
pub struct Guess {
    /// The map as a file, with the reasons as comments.
    pub text: String,
    /// The columns of each channel, in one line.
    pub summary: String,
    /// The number of channels.
    pub channels: u64,
    /// Whether there are both a position and a velocity.
    pub both: bool,
}

/// An item with its table and time.
pub(super) struct Found<'l, T> {
    pub(super) topic: &'l str,
    pub(super) timing: Timing,
    pub(super) what: T,
}

impl<'l, T> Found<'l, T> {
    pub(super) fn of(source: &TableColumns<'l>, timing: &Timing, what: T) -> Found<'l, T> {
        Found { topic: &source.table.topic.name, timing: timing.clone(), what }
    }
}
