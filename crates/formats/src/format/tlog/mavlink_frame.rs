//! A frame of MAVLink 1 or 2 (<https://mavlink.io/en/guide/serialization.html>).
//!
//! The specification requires a receiver to drop frames with unknown incompatibility flags; it defines one, for
//! signatures.

use super::checksum::Checksum;
use super::definition::Definitions;

/// First bytes of a frame.
pub(super) const MAGIC: [u8; 2] = [0xfe, 0xfd];
/// Length of the longest frame: header, payload, checksum and signature of MAVLink 2.
pub(super) const LONGEST: usize = HEADER_2 + 255 + CHECKSUM + SIGNATURE;
/// Length of the shortest frame, without payload.
const HEADER_1: usize = 6;
const HEADER_2: usize = 10;
pub(super) const CHECKSUM: usize = 2;
pub(super) const SIGNATURE: usize = 13;
/// The MAVLink 2 flag for a signature at the end.
const SIGNED: u8 = 1;

/// Content of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Frame<'b> {
    /// MAVLink 2, or a MAVLink 1 payload with extension fields: truncated zeros are restored, and there may be more
    /// fields.
    pub(super) wide: bool,
    pub(super) system: u8,
    pub(super) component: u8,
    pub(super) message: u32,
    /// Incompatibility flags unknown to this reader: the meaning of the payload is then unknown.
    pub(super) unknown_flags: u8,
    pub(super) payload: &'b [u8],
    /// Bytes of the whole frame.
    pub(super) length: usize,
    /// Whether the checksum is right; `None` for an undefined message whose checksum is right with some layout.
    pub(super) intact: Option<bool>,
}

/// Why the bytes are not a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum NoFrame {
    /// The first bytes are not those of a frame.
    Foreign,
    /// The bytes end inside it.
    Cut,
}

/// Header of a frame.
#[derive(Debug, Clone, Copy)]
struct Head {
    wide: bool,
    flags: u8,
    system: u8,
    component: u8,
    message: u32,
    /// Bytes before the payload, and of it.
    header: usize,
    payload: usize,
}

impl Head {
    /// The header at the start of the bytes.
    fn at(bytes: &[u8]) -> Result<Head, NoFrame> {
        let (Some(&magic), Some(&payload)) = (bytes.first(), bytes.get(1)) else { return Err(NoFrame::Cut) };
        if !MAGIC.contains(&magic) {
            return Err(NoFrame::Foreign);
        }
        let wide = magic == MAGIC[1];
        let header = if wide { HEADER_2 } else { HEADER_1 };
        let (flags, system, component, message) = match *bytes.get(..header).ok_or(NoFrame::Cut)? {
            [_, _, flags, _, _, system, component, low, middle, high] => {
                (flags, system, component, u32::from_le_bytes([low, middle, high, 0]))
            }
            [_, _, _, system, component, message] => (0, system, component, message.into()),
            _ => return Err(NoFrame::Cut),
        };
        Ok(Head { wide, flags, system, component, message, header, payload: payload.into() })
    }

    /// Bytes from the start of the frame to its checksum.
    fn checked(&self) -> usize {
        self.header + self.payload
    }

    fn length(&self) -> usize {
        self.checked() + CHECKSUM + if self.flags & SIGNED == 0 { 0 } else { SIGNATURE }
    }
}

impl<'b> Frame<'b> {
    /// Length of the frame at the start of the bytes, intact or not.
    pub(super) fn length_at(bytes: &[u8]) -> Option<usize> {
        Head::at(bytes).ok().map(|head| head.length())
    }

    /// The frame at the start of the bytes.
    pub(super) fn at(bytes: &'b [u8]) -> Result<Frame<'b>, NoFrame> {
        let head = Head::at(bytes)?;
        let length = head.length();
        let (checked, rest) =
            bytes.get(..length).and_then(|b| b.split_at_checked(head.checked())).ok_or(NoFrame::Cut)?;
        let stored = rest.first_chunk().map(|two| u16::from_le_bytes(*two)).ok_or(NoFrame::Cut)?;
        let mut checksum = Checksum::new();
        checksum.add(checked.get(1..).unwrap_or_default());
        let definition = Definitions::all().get(head.message);
        Ok(Frame {
            wide: head.wide || definition.is_some_and(|d| head.payload > d.length(false)),
            system: head.system,
            component: head.component,
            message: head.message,
            unknown_flags: head.flags & !SIGNED,
            payload: checked.get(head.header..).unwrap_or_default(),
            length,
            intact: match definition {
                Some(definition) => Some(checksum.with(definition.extra) == stored),
                None => checksum.extra_of(stored).is_none().then_some(false),
            },
        })
    }
}

/// Sender of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct Sender {
    pub(super) system: u8,
    pub(super) component: u8,
}

impl Sender {
    pub(super) fn of(frame: &Frame<'_>) -> Sender {
        Sender { system: frame.system, component: frame.component }
    }
}

impl Default for Sender {
    /// An autopilot with default system and component IDs.
    fn default() -> Sender {
        Sender { system: 1, component: 1 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_of_both_versions_are_parsed_with_and_without_a_signature() {
        let extra = Definitions::all().get(0).unwrap().extra;
        let sealed = |mut frame: Vec<u8>| {
            let mut checksum = Checksum::new();
            checksum.add(&frame[1..]);
            frame.extend(checksum.with(extra).to_le_bytes());
            frame
        };
        let payload = [0, 0, 0, 0, 2, 3, 81, 4, 3];
        let one = sealed([&[0xfe, 9, 0, 1, 200, 0][..], &payload].concat());
        let two = sealed([&[0xfd, 9, 0, 0, 7, 1, 200, 0, 0, 0][..], &payload].concat());
        let signed = [sealed([&[0xfd, 9, 1, 0, 7, 1, 200, 0, 0, 0][..], &payload].concat()), vec![9; 13]].concat();
        for (bytes, wide) in [(one, false), (two, true), (signed, true)] {
            let frame = Frame::at(&bytes).unwrap();
            assert_eq!((frame.wide, frame.system, frame.component, frame.message), (wide, 1, 200, 0));
            assert_eq!((frame.payload, frame.length, frame.intact), (&payload[..], bytes.len(), Some(true)));
            for cut in 0..bytes.len() {
                assert_eq!(Frame::at(&bytes[..cut]), Err(NoFrame::Cut));
            }
        }
        assert_eq!(Frame::at(&[1, 2, 3]), Err(NoFrame::Foreign));
    }
}
