//! Frames that were written again with a shorter payload under their old checksum.
//!
//! MAVLink 2 leaves out the zeros at the end of a payload, and some senders do not. A ground station accepts what they send,
//! but as it writes it to its log, the C library leaves the zeros out and keeps the checksum of the payload with them
//! (<https://github.com/ArduPilot/pymavlink/issues/237>). With the zeros back in place the checksum proves the frame.

use super::Sender;
use super::frame::Frame;
use std::collections::HashMap;

/// Who sends zeros at the end of payloads.
///
/// Each length that is tried for a frame gives chance another try at its sixteen bits. So one damaged frame alone proves
/// nothing, and nothing is tried for who is known to leave zeros out.
#[derive(Debug, Default)]
pub(super) struct Recut {
    senders: HashMap<Sender, Habit>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Habit {
    /// One frame needs zeros for its checksum to hold: where it stands, and that checksum.
    Suspected(u64, u16),
    SendsZeros,
    LeavesZerosOut,
}

impl Recut {
    /// Learns from a frame that stands at this place of its file.
    pub(super) fn learn(&mut self, sender: Sender, at: u64, frame: &Frame<'_>) {
        if frame.unknown_flags != 0 {
            return;
        }
        let known = self.senders.get(&sender).copied();
        let habit = match known {
            Some(Habit::LeavesZerosOut | Habit::SendsZeros) => return,
            _ if frame.is_shortened() => Habit::LeavesZerosOut,
            _ if frame.zeros_cut.is_none() => return,
            None => Habit::Suspected(at, frame.told),
            Some(Habit::Suspected(place, told)) if (place, told) == (at, frame.told) => return,
            Some(_) => Habit::SendsZeros,
        };
        self.senders.insert(sender, habit);
    }

    /// Whether the frame is as it was sent but for zeros at its end.
    pub(super) fn vouches_for(&self, sender: Sender, frame: &Frame<'_>) -> bool {
        frame.zeros_cut.is_some() && self.senders.get(&sender) == Some(&Habit::SendsZeros)
    }
}
