//! What a format tells the scan of its frames.

use crate::error::ScanError;
use crate::ledger::Fate;
use crate::source::Source;
use std::borrow::Cow;

/// How far a frame proves itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Trust {
    /// It may be a frame of a kind that is not known: believed if the frames after it lead to one that is better.
    Weak,
    /// It looks like one; its length is stated once. Believed if another frame follows, and none within it reaches to its end.
    Shape,
    /// Its length is stated twice, and both agree. Believed if another frame follows.
    Agrees,
    /// A checksum, or as many bytes as one, proves it. Nothing else is asked.
    Proven,
}

/// What bytes begin with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Parsed {
    /// A frame of this many bytes, at least one.
    Frame(usize, Trust),
    /// A frame of this many bytes, of which only the head has to be in memory: the format fetches its content. What is in it is
    /// not looked into before it is believed.
    Long(u64, Trust),
    /// A frame that is longer than the bytes that are left of the file.
    Cut,
    /// Not a frame; how many bytes were looked at to find out.
    Not(usize),
}

/// What became of a frame whose content the format fetched.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Fetched {
    /// It is intact.
    Taken(Fate),
    /// It is damaged, and what is intact in it was taken. The next frame begins where it ends.
    Damaged(Cow<'static, str>),
    /// It is so damaged that its length may be wrong too. Frames are searched for in it.
    Refuted(Cow<'static, str>),
}

/// A format's frames, and where their content goes.
pub trait Framing {
    /// Bytes of the longest frame that is parsed in memory, and of the longest head of any other.
    fn longest(&self) -> usize;

    /// What these bytes begin with. As many are given as the longest frame has, or all up to the end of the file.
    fn parse(&self, bytes: &[u8]) -> Parsed;

    /// Whether a frame may begin with these bytes, by the first few of them; there are fewer at the end of a file.
    fn begins(&self, bytes: &[u8]) -> bool;

    /// The next place in a block at or after `from` where a frame may begin: a superset, found fast.
    fn candidate(&self, block: &[u8], from: usize) -> Option<usize>;

    /// Bytes of the frame that these begin with, as its head states them, whether it is one or not. `None` if frames of this
    /// format are all proven.
    fn length(&self, _bytes: &[u8]) -> Option<usize> {
        None
    }

    /// Whether the content of a frame that was searched for, or found within another, agrees with the log, as a time near the
    /// last one does. Of a long frame the head is given.
    fn is_likely(&self, _frame: &[u8]) -> bool {
        true
    }

    /// Takes a frame that is believed, at this place of the file; `after` is what follows it, as far as the longest frame reaches.
    ///
    /// # Errors
    /// What is wrong with its content, if it is damaged after all.
    fn take(&mut self, frame: &[u8], after: &[u8], at: u64) -> Result<Fate, Cow<'static, str>>;

    /// Takes a long frame that is believed: `length` bytes at a place of the source, which has them all.
    ///
    /// # Errors
    /// If the source cannot be read.
    fn fetch<S: Source>(&mut self, _source: &mut S, _at: u64, _length: u64) -> Result<Fetched, ScanError> {
        Ok(Fetched::Refuted("a frame of a format that has no long ones".into()))
    }

    /// What is wrong where no frame was believed.
    fn fault(&self, bytes: &[u8]) -> Cow<'static, str>;

    /// Whether the bytes before the first frame are no damage, as the lines of text that a device prints when it starts.
    fn is_preamble(&self, _bytes: &[u8]) -> bool {
        false
    }

    /// Something is missing before the next frame.
    fn breaks(&mut self) {}

    /// Frames that have to follow one another after damage, if no checksum proves the first: fewer if it is plain where one begins.
    const PROOF: usize = 3;

    /// What every log of this format begins with, if one may follow another in a file. No frame holds it.
    const START: &'static [u8] = b"";

    /// Whether a file may end in zeros or ones that are not damage, as a preallocated one does.
    const PADDED: bool = false;

    /// Whether a log says where it ends, so that one that ends inside a frame is damaged and not merely cut.
    const STATES_ITS_END: bool = false;
}
