//! Who looks at the records while a file, or its summary, is walked through.

use super::summary::Summary;
use crate::decode::Vouch;
use flight::Notices;
use logscan::Fate;

/// Who is shown the records.
pub(super) trait Visit {
    /// A record, from the top level or from within a chunk that is intact. Of an attachment that is not taken, or is
    /// longer than a record may be, the first megabyte. What is wrong with it is returned for people.
    fn record(&mut self, opcode: u8, body: &[u8]) -> Result<Fate, String>;

    /// Whether messages of this channel are wanted; true if the channel is not known.
    fn may_want(&mut self, channel: u16) -> bool;

    /// Whether a message of this channel can be placed.
    fn knows(&self, channel: u16) -> bool;

    /// Whether attachments are shown whole.
    fn takes_attachments(&self) -> bool {
        false
    }

    /// What vouches for the messages that follow.
    fn vouch(&mut self, _by: Vouch) {}

    /// Whether the checksum behind the messages is right.
    fn settle(&mut self, _is_right: bool) {}

    /// A message index of a chunk that was left closed: what it lists is shown by nothing else.
    fn index(&mut self, body: &[u8]) -> Result<Fate, String>;

    /// A log has ended, and this is what it said of itself. What is odd is said.
    fn end_log(&mut self, _file: &str, _summary: &Summary, _notices: &mut Notices) {}

    /// Another log begins, with definitions of its own.
    fn forget(&mut self) {}
}
