//! What the scan knows of the frames of a format.

use crate::error::ScanError;
use crate::ledger::Fate;
use crate::source::Source;
use std::borrow::Cow;

/// How strongly a frame is verified.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Trust {
    /// Possibly a frame of an unknown kind: accepted if the frames after it lead to a better one.
    Weak,
    /// It looks like a frame; its length is stated once. Accepted if another frame follows, and no frame within it ends
    /// where it ends.
    Shape,
    /// Its length is stated twice, and both agree. Accepted if another frame follows.
    Agrees,
    /// Verified by a checksum, or by as many known bytes. No further check is needed.
    Proven,
}

/// What a sequence of bytes starts with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Parsed {
    /// A frame of this many bytes, at least one.
    Frame(usize, Trust),
    /// A frame of this many bytes, of which only the head has to be in memory: the format fetches its content. Its
    /// content is not examined before it is accepted.
    Long(u64, Trust),
    /// A frame that is longer than the rest of the file.
    Cut,
    /// Not a frame; the number of bytes examined to find out.
    Not(usize),
}

/// The result of fetching a frame's content.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Fetched {
    /// It is intact.
    Taken(Fate),
    /// It is damaged; its intact part was taken. The next frame starts at its end.
    Damaged(Cow<'static, str>),
    /// It is so damaged that its length may be wrong too. The scan searches for frames inside it.
    Refuted(Cow<'static, str>),
}

/// The frames of a format, and where their content goes.
pub trait Framing {
    /// Length in bytes of the longest frame that is parsed in memory, and of the longest head of any other.
    fn longest(&self) -> usize;

    /// What these bytes start with. They are as long as the longest frame, or extend to the end of the file.
    fn parse(&self, bytes: &[u8]) -> Parsed;

    /// Whether a frame may start here, judged by the first few bytes; there are fewer at the end of a file.
    fn begins(&self, bytes: &[u8]) -> bool;

    /// The next position in a block at or after `from` where a frame may start: a superset, found fast.
    fn candidate(&self, block: &[u8], from: usize) -> Option<usize>;

    /// Length in bytes of the frame that starts here, as its head states it, whether it is a frame or not. `None` if
    /// all frames of this format are verified.
    fn length(&self, _bytes: &[u8]) -> Option<usize> {
        None
    }

    /// Whether the content of a frame that was searched for, or found within another, is consistent with the log, such
    /// as a time near the previous one. For a long frame only the head is given.
    fn is_likely(&self, _frame: &[u8]) -> bool {
        true
    }

    /// Takes an accepted frame at position `at` of the file; `after` is what follows it, up to the length of the
    /// longest frame.
    ///
    /// # Errors
    /// What is wrong with its content, if it is damaged after all.
    fn take(&mut self, frame: &[u8], after: &[u8], at: u64) -> Result<Fate, Cow<'static, str>>;

    /// Takes an accepted long frame: `length` bytes at a position of the source, which has all of them.
    ///
    /// # Errors
    /// If the source cannot be read.
    fn fetch<S: Source>(&mut self, _source: &mut S, _at: u64, _length: u64) -> Result<Fetched, ScanError> {
        Ok(Fetched::Refuted("a frame of a format that has no long ones".into()))
    }

    /// The fault to report where no frame was accepted.
    fn fault(&self, bytes: &[u8]) -> Cow<'static, str>;

    /// Whether the bytes before the first frame are not damage, such as the text lines a device prints at startup.
    fn is_preamble(&self, _bytes: &[u8]) -> bool {
        false
    }

    /// Called when something is missing before the next frame.
    fn breaks(&mut self) {}

    /// Number of consecutive frames needed after damage if no checksum verifies the first: fewer where frame starts are
    /// unmistakable.
    const PROOF: usize = 3;

    /// The bytes at the start of every log of this format, if one log may follow another in a file. No frame contains
    /// them.
    const START: &'static [u8] = b"";

    /// Whether a file may end in zeros or ones that are padding, as a preallocated one does.
    const PADDED: bool = false;

    /// Whether a log states its end. One that ends inside a frame is then damaged, not just a cut tail.
    const STATES_ITS_END: bool = false;
}
