//! Messages that a sender defines otherwise than the public definitions: a dialect of its own, or one of years ago, in which
//! the number of a message stands for another layout. Their checksums are all wrong here, and wrong in the same way. And those
//! that no public definition has: two senders may each have a layout for one number.

use super::frame::Frame;
use std::collections::HashMap;

/// So many frames whose checksums one other layout explains show that this is theirs. One of 256 damaged frames has such a
/// layout, and of those one of 256 the same.
const CONFIRMED_BY: u32 = 3;
/// Messages and layouts that are remembered.
const MOST: usize = 4096;

/// The layouts of a log that are not the public ones, by message and by the number that stands for them in the checksum.
#[derive(Debug, Default)]
pub(super) struct Dialect {
    seen: HashMap<(u32, u8), Sightings>,
}

#[derive(Debug, Default)]
struct Sightings {
    frames: u32,
    last: u64,
}

impl Dialect {
    /// Learns from a frame at this place, with which the log goes on; one place counts once.
    pub(super) fn learn(&mut self, place: u64, frame: &Frame<'_>) {
        let Some(key) = key(frame) else { return };
        if self.seen.len() >= MOST && !self.seen.contains_key(&key) {
            return;
        }
        let sightings = self.seen.entry(key).or_default();
        if sightings.frames == 0 || place > sightings.last {
            *sightings = Sightings { frames: sightings.frames + 1, last: place };
        }
    }

    /// Whether the frame has a layout that this log has.
    pub(super) fn vouches_for(&self, frame: &Frame<'_>) -> bool {
        key(frame).is_some_and(|(message, extra)| self.has(message, extra))
    }

    /// Whether the layout is one of the log's.
    pub(super) fn has(&self, message: u32, extra: u8) -> bool {
        self.seen.get(&(message, extra)).is_some_and(|sightings| sightings.frames >= CONFIRMED_BY)
    }
}

fn key(frame: &Frame<'_>) -> Option<(u32, u8)> {
    let undefined = frame.extra.filter(|_| frame.intact.is_none());
    let layout = frame.other.or(undefined).filter(|_| frame.unknown_flags == 0)?;
    Some((frame.message, layout))
}
