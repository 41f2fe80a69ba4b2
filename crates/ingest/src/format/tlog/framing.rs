//! What stands in front of the frames of a file, and where the next one is.

use super::book::NO_FRAME;
use super::clock::PLAUSIBLE_US;
use super::frame::{CHECKSUM, Finder, Frame, LONGEST, MAGIC, SIGNATURE};
use crate::bytes::is_zero;
use crate::error::IngestError;
use crate::format::MOST_ZEROS;
use crate::format::file::LogFile;
use crate::reader::ReadContext;

/// Bytes of the time in front of a frame.
pub(super) const TIME: usize = 8;
/// Bytes looked through for the first frames.
const SOUGHT: u64 = 16 << 20;
/// Bytes searched in one go.
const BLOCK: usize = 256 << 10;

/// What stands in front of every frame of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Framing {
    /// The time at which it came.
    Stamped,
    /// Nothing: it follows the frame before.
    Bare,
}

impl Framing {
    /// Bytes in front of a frame.
    pub(super) fn front(self) -> usize {
        match self {
            Framing::Stamped => TIME,
            Framing::Bare => 0,
        }
    }

    /// By the first block that holds frames: what stands before may be zeros, junk, or text. A file without one is refused if
    /// it is no log at all.
    pub(super) fn of_file(file: &mut LogFile, context: &ReadContext<'_>) -> Result<Framing, IngestError> {
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

    /// As the begin shows, or else most of what follows a frame.
    fn of(head: &[u8]) -> Framing {
        // The end of a frame of a few bytes may look like a time: then another follows at once.
        let first =
            head.get(TIME..).and_then(Frame::length_at).map_or(usize::MAX, |length| TIME.saturating_add(length));
        let follows = || Framing::ahead(head.get(first..).unwrap_or_default()) == Some(Framing::Bare);
        let is_bare = (!begins_stamped(head) || follows()) && Census::of(head).is_bare();
        if is_bare { Framing::Bare } else { Framing::Stamped }
    }

    /// What the bytes behind a frame show, if they show that another one follows.
    fn ahead(bytes: &[u8]) -> Option<Framing> {
        let is_magic = |at: usize| bytes.get(at).is_some_and(|magic| MAGIC.contains(magic));
        if is_magic(0) {
            return Some(Framing::Bare);
        }
        (is_magic(TIME) && is_plausible(bytes)).then_some(Framing::Stamped)
    }

    /// Whether a frame of a message that is not defined is one and no accident, where nothing else vouches for it: some
    /// layout makes its checksum right, no intact frame reaches out of its payload, and the next record or the end of the file
    /// stands behind it or else no intact frame is lost with it. The record begins with these bytes, and as many follow as the
    /// longest frame has.
    pub(super) fn believes(self, frame: &Frame<'_>, bytes: &[u8]) -> bool {
        let inner = || inner_ends(bytes.get(self.front()..).unwrap_or_default(), frame.length);
        let payload = frame.length - CHECKSUM - if frame.is_signed { SIGNATURE } else { 0 };
        frame.extra.is_some()
            && match inner().max() {
                Some(last) => last <= payload && self.goes_on(frame, bytes),
                None => true,
            }
    }

    /// Whether another record begins behind that of this frame, or the file ends there.
    pub(super) fn goes_on(self, frame: &Frame<'_>, bytes: &[u8]) -> bool {
        let end = self.front() + frame.length;
        bytes.len() == end || Framing::ahead(bytes.get(end..).unwrap_or_default()) == Some(self)
    }
}

/// Where the intact frames end that begin inside of the one that the bytes begin with.
fn inner_ends(bytes: &[u8], length: usize) -> impl Iterator<Item = usize> {
    let inside = bytes.get(1..length).unwrap_or_default();
    let mut starts = memchr::memchr2_iter(MAGIC[0], MAGIC[1], inside).map(|at| at + 1).peekable();
    let finder = starts.peek().map(|_| Finder::new(bytes.to_vec()));
    let is_frame = move |at: &usize| finder.as_ref().is_some_and(|finder| finder.is_frame(*at));
    starts.filter(is_frame).filter_map(|at| Some(at + Frame::length_at(bytes.get(at..)?)?))
}

/// What a walk over the first bytes of a file finds.
#[derive(Default)]
struct Census {
    frames: usize,
    /// Of all frames.
    bytes: usize,
    /// Frames that another one follows, behind its time and at once.
    stamped: usize,
    bare: usize,
}

/// So many frames are no accident.
const FEWEST: usize = 3;

impl Census {
    /// Counts intact frames, and those of messages that are not defined where the frame before says that one stands and
    /// another follows.
    fn of(head: &[u8]) -> Census {
        let finder = Finder::new(head.to_vec());
        let mut census = Census { bare: usize::from(finder.is_frame(0)), ..Census::default() };
        let (mut at, mut next) = (0, None);
        while let Some(bytes) = head.get(at..).filter(|bytes| !bytes.is_empty()) {
            if !finder.is_frame(at) && (next != Some(at) || !is_followed(bytes)) {
                at += 1;
                continue;
            }
            let length = Frame::length_at(bytes).unwrap_or(1);
            let ahead = Framing::ahead(bytes.get(length..).unwrap_or_default());
            census.frames += 1;
            census.bytes += length;
            census.stamped += usize::from(ahead == Some(Framing::Stamped));
            census.bare += usize::from(ahead == Some(Framing::Bare));
            at += length;
            next = ahead.map(|framing| at + framing.front());
        }
        census
    }

    fn is_bare(&self) -> bool {
        self.bare > self.stamped
    }

    /// Whether the head is of MAVLink: some frames, and half of it is theirs.
    fn prevails_in(&self, head: &[u8]) -> bool {
        self.frames >= FEWEST && 2 * self.bytes >= head.len()
    }
}

/// Whether a frame of a message that is not defined begins here, and another one behind it.
fn is_followed(bytes: &[u8]) -> bool {
    let unknown = Frame::at(bytes).ok().filter(|frame| frame.intact.is_none() && frame.extra.is_some());
    unknown.is_some_and(|frame| bytes.get(frame.length..).and_then(Framing::ahead).is_some())
}

/// Whether these first bytes of a file begin with a frame behind its time, or are frames by half.
pub(crate) fn looks_like(head: &[u8]) -> bool {
    begins_stamped(head) || Census::of(head).prevails_in(head)
}

pub(super) fn begins_stamped(head: &[u8]) -> bool {
    let frame = || Frame::at(head.get(TIME..).unwrap_or_default()).ok();
    let begins = head.get(TIME).is_some_and(|magic| MAGIC.contains(magic)) && is_plausible(head);
    begins && frame().is_some_and(|frame| frame.intact == Some(true) || frame.zeros_cut.is_some())
}

pub(super) fn time_us(bytes: &[u8]) -> Option<u64> {
    bytes.first_chunk().map(|eight| u64::from_be_bytes(*eight))
}

fn is_plausible(bytes: &[u8]) -> bool {
    time_us(bytes).is_some_and(|time| PLAUSIBLE_US.contains(&time))
}

/// The time in front of a frame that the bytes begin with, and what follows that frame.
pub(super) fn next_time(bytes: &[u8]) -> Option<(u64, &[u8])> {
    let time = time_us(bytes).filter(|_| bytes.get(TIME).is_some_and(|magic| MAGIC.contains(magic)))?;
    let length = Frame::length_at(bytes.get(TIME..)?).unwrap_or(usize::MAX);
    Some((time, bytes.get(TIME..)?.get(length..).unwrap_or_default()))
}

/// Times that are near the last one of a file, µs.
const NEAR_US: u64 = 86_400_000_000;

/// Behind damage, frames of messages that are not defined are looked for in so many bytes.
const NEAR_BYTES: u64 = 32 << 10;

/// A search for intact frames. What was learned of a block serves the next search in it.
pub(super) struct Search {
    framing: Framing,
    /// The time in front of the last frame that was read, µs.
    pub(super) last_us: Option<u64>,
    /// A block and where it begins.
    searched: Option<(u64, Finder)>,
    /// From where on a frame of a defined message was searched, and where it was.
    found: Option<(u64, u64)>,
}

impl Search {
    pub(super) fn of(framing: Framing) -> Search {
        Search { framing, last_us: None, searched: None, found: None }
    }

    /// Whether a time stands in front of an intact frame: one that is plausible, or near the last one where the clock was not
    /// set, or whatever it is if a record or the end of the file follows.
    fn is_stamped(&self, bytes: &[u8]) -> bool {
        let is_near = || time_us(bytes).zip(self.last_us).is_some_and(|(a, b)| a.abs_diff(b) <= NEAR_US);
        let follows = || {
            let length = bytes.get(TIME..).and_then(Frame::length_at).map_or(usize::MAX, |length| TIME + length);
            let rest = bytes.get(length..).unwrap_or_default();
            bytes.len() == length || rest.get(TIME).is_some_and(|magic| MAGIC.contains(magic))
        };
        is_plausible(bytes) || is_near() || follows()
    }

    /// Where the next intact frame begins, at or behind `from`; `end` if there is none before. It is of a defined message, or
    /// of one with a layout that the caller `knows`, and another record behind it.
    pub(super) fn next(
        &mut self,
        file: &mut LogFile,
        from: u64,
        end: u64,
        knows: &dyn Fn(u32, u8) -> bool,
        context: &ReadContext<'_>,
    ) -> Result<u64, IngestError> {
        let (mut at, mut zeros) = (from, 0);
        let front = self.framing.front();
        // What was found once is not searched again, but for what is known since, in the first bytes.
        let known_to = from.saturating_add(NEAR_BYTES);
        let found_before =
            self.found.filter(|(searched, found)| (*searched..=*found).contains(&from)).map(|(_, at)| at);
        let to = found_before.map_or(end, |found| found.min(known_to).min(end));
        while at < to && zeros <= MOST_ZEROS {
            if self.searched.as_ref().is_none_or(|(start, _)| at - start >= BLOCK as u64) {
                // What a block of the search begins with may be as long as a record.
                self.searched = Some((at, Finder::new(file.up_to(at, BLOCK + front + LONGEST)?.to_vec())));
            }
            let Some((start, finder)) = &self.searched else { break };
            let (first, block) = ((at - start) as usize, finder.block());
            let found = memchr::memchr2_iter(MAGIC[0], MAGIC[1], block.get(first + front..).unwrap_or_default())
                .map(|hit| first + hit)
                .take_while(|hit| *hit < BLOCK && start + (*hit as u64) < to)
                .find(|&hit| {
                    let rest = block.get(hit..).unwrap_or_default();
                    let is_defined = found_before.is_none() && finder.is_frame(hit + front);
                    let is_near = start + (hit as u64) < known_to;
                    let is_known = || {
                        finder.layout(hit + front).filter(|_| is_near).is_some_and(|(message, extra, length)| {
                            let next = rest.get(front + length..).and_then(Framing::ahead);
                            next == Some(self.framing) && knows(message, extra)
                        })
                    };
                    (is_defined || is_known()) && (front == 0 || self.is_stamped(rest))
                });
            if let Some(hit) = found {
                let place = (start + hit as u64).min(end);
                if finder.is_frame(hit + front) {
                    self.found = Some((from, place));
                }
                return Ok(place);
            }
            at = start + BLOCK as u64;
            zeros = if is_zero(block) { zeros + BLOCK as u64 } else { 0 };
            file.progress(at.min(end), context)?;
        }
        let place = found_before.unwrap_or(end);
        self.found = Some((from, place));
        Ok(place)
    }
}
