//! Receivers of records during the walk through a file or its summary.

use super::summary::Summary;
use flight::Notices;
use logscan::Fate;

/// A receiver of records.
pub(super) trait Visit {
    /// A record, from the top level or from within an intact chunk. For an attachment that is not wanted or
    /// exceeds the maximum record length, the first megabyte. The error returned is for users.
    fn record(&mut self, opcode: u8, body: &[u8]) -> Result<Fate, String>;

    /// Whether messages of this channel are wanted; true if the channel is not known.
    fn may_want(&mut self, channel: u16) -> bool;

    /// Whether a message of this channel can be placed.
    fn knows(&self, channel: u16) -> bool;

    /// Whether attachments are passed on whole.
    fn takes_attachments(&self) -> bool {
        false
    }

    /// A message index of a skipped chunk: nothing else reports what it lists.
    fn index(&mut self, body: &[u8]) -> Result<Fate, String>;

    /// A log has ended, and this is what it stated about itself. Oddities are reported.
    fn end_log(&mut self, _file: &str, _summary: &Summary, _notices: &mut Notices) {}

    /// Another log starts, with definitions of its own.
    fn forget(&mut self) {}
}
