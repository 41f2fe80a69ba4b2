//! What precedes the frames of a file.

use super::clock::PLAUSIBLE_US;
use super::mavlink_frame::{Frame, MAGIC};
use crate::error::LogError;
use crate::reader::ReadContext;
use logscan::{LogFile, Source};

/// Reported where no frame begins.
pub(super) const NO_FRAME: &str = "bytes that are not a MAVLink frame";

/// Bytes of the time before a frame.
pub(super) const TIME: usize = 8;
/// Bytes searched for the first frames.
const SOUGHT: u64 = 16 << 20;

/// What precedes every frame of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Framing {
    /// Its reception time.
    Stamped,
    /// Nothing: it follows the previous frame.
    Bare,
}

impl Framing {
    /// Number of bytes before a frame.
    pub(super) fn front(self) -> usize {
        match self {
            Framing::Stamped => TIME,
            Framing::Bare => 0,
        }
    }

    /// Determined from the first block with frames: before it there may be zeros, junk or text. A file without such a
    /// block is rejected if it is not a log at all.
    pub(super) fn of_file(file: &mut LogFile, context: &ReadContext<'_>) -> Result<Framing, LogError> {
        let mut at = 0;
        while at < file.size().min(SOUGHT) {
            let head = file.up_to(at, crate::sniff::HEAD)?;
            if (at == 0 && begins_stamped(head)) || Census::of(head).frames >= FEWEST {
                return Ok(Framing::of(head));
            }
            at += crate::sniff::HEAD as u64;
        }
        crate::format::refuse_foreign(file, NO_FRAME, context)?;
        Ok(Framing::of(file.up_to(0, crate::sniff::HEAD)?))
    }

    /// Determined from the start, otherwise from what follows most frames.
    fn of(head: &[u8]) -> Framing {
        // The end of a frame of a few bytes may look like a time: then another frame follows directly.
        let first =
            head.get(TIME..).and_then(Frame::length_at).map_or(usize::MAX, |length| TIME.saturating_add(length));
        let follows = || Framing::ahead(head.get(first..).unwrap_or_default()) == Some(Framing::Bare);
        let is_bare = (!begins_stamped(head) || follows()) && Census::of(head).is_bare();
        if is_bare { Framing::Bare } else { Framing::Stamped }
    }

    /// Framing of the next frame by the bytes after a frame, if they show that another one follows.
    fn ahead(bytes: &[u8]) -> Option<Framing> {
        let is_magic = |at: usize| bytes.get(at).is_some_and(|magic| MAGIC.contains(magic));
        if is_magic(0) {
            return Some(Framing::Bare);
        }
        (is_magic(TIME) && is_plausible(bytes)).then_some(Framing::Stamped)
    }

    /// Whether the bytes before a frame can be a time: one of a clock that is set.
    pub(super) fn is_plausible(self, record: &[u8]) -> bool {
        self == Framing::Bare || is_plausible(record)
    }
}

/// Statistics of the first bytes of a file.
#[derive(Default)]
struct Census {
    frames: usize,
    /// Bytes of all frames.
    bytes: usize,
    /// Frames followed by another one, after its time and directly.
    stamped: usize,
    bare: usize,
}

/// This many frames are not a coincidence.
const FEWEST: usize = 3;

impl Census {
    /// Counts intact frames, and those of undefined messages where the previous frame shows that one begins.
    fn of(head: &[u8]) -> Census {
        let mut census = Census::default();
        let (mut at, mut next) = (0, None);
        while let Some(bytes) = head.get(at..).filter(|bytes| !bytes.is_empty()) {
            let frame = Frame::at(bytes).ok().filter(|frame| frame.intact.unwrap_or(next == Some(at)));
            let Some(length) = frame.map(|frame| frame.length) else {
                at += 1;
                continue;
            };
            let ahead = Framing::ahead(bytes.get(length..).unwrap_or_default());
            census.bare += usize::from(at == 0) + usize::from(ahead == Some(Framing::Bare));
            census.stamped += usize::from(ahead == Some(Framing::Stamped));
            census.frames += 1;
            census.bytes += length;
            at += length;
            next = ahead.map(|framing| at + framing.front());
        }
        census
    }

    fn is_bare(&self) -> bool {
        self.bare > self.stamped
    }

    /// Whether the head is MAVLink: a few frames, which make up at least half of it.
    fn prevails_in(&self, head: &[u8]) -> bool {
        self.frames >= FEWEST && 2 * self.bytes >= head.len()
    }
}

/// Whether these first bytes of a file begin with a time and a frame, or consist of frames for at least half.
pub(crate) fn looks_like(head: &[u8]) -> bool {
    begins_stamped(head) || Census::of(head).prevails_in(head)
}

fn begins_stamped(head: &[u8]) -> bool {
    let frame = || Frame::at(head.get(TIME..).unwrap_or_default()).ok();
    let begins = head.get(TIME).is_some_and(|magic| MAGIC.contains(magic)) && is_plausible(head);
    begins && frame().is_some_and(|frame| frame.intact == Some(true))
}

pub(super) fn time_us(bytes: &[u8]) -> Option<u64> {
    bytes.first_chunk().map(|eight| u64::from_be_bytes(*eight))
}

fn is_plausible(bytes: &[u8]) -> bool {
    time_us(bytes).is_some_and(|time| PLAUSIBLE_US.contains(&time))
}

/// The time before the frame at the start of the bytes, and what follows that frame.
pub(super) fn next_time(bytes: &[u8]) -> Option<(u64, &[u8])> {
    let time = time_us(bytes).filter(|_| bytes.get(TIME).is_some_and(|magic| MAGIC.contains(magic)))?;
    let length = Frame::length_at(bytes.get(TIME..)?).unwrap_or(usize::MAX);
    Some((time, bytes.get(TIME..)?.get(length..).unwrap_or_default()))
}
