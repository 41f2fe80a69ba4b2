//! A frame of MAVLink 1 or 2 (<https://mavlink.io/en/guide/serialization.html>).
//!
//! Who does not know an incompatibility flag must drop the frame, says the specification; it defines one, of signatures. A
//! draft of 2026 (<https://github.com/ArduPilot/pymavlink/pull/1229>) has two more, which make the header longer: its frames
//! are dropped as others with such flags are, and the checksum proves where they end.

use super::checksum::{Checksum, step};
use super::definition::{Definition, Definitions};

/// First bytes of a frame.
pub(super) const MAGIC: [u8; 2] = [0xfe, 0xfd];
/// The longest: header, payload, checksum and signature of MAVLink 2.
pub(super) const LONGEST: usize = HEADER_2 + WIDE_SENDER + WIDE_TARGET + 255 + CHECKSUM + SIGNATURE;
/// Of the shortest, without payload.
const HEADER_1: usize = 6;
const HEADER_2: usize = 10;
pub(super) const CHECKSUM: usize = 2;
pub(super) const SIGNATURE: usize = 13;
/// The flag of MAVLink 2 that a signature follows.
const SIGNED: u8 = 1;
/// Flags of the draft: the number of the sending system has 32 bits, and the header ends in that of a target.
const SYSID32: u8 = 2;
const TARGET32: u8 = 4;
/// What that adds to the header.
const WIDE_SENDER: usize = 3;
const WIDE_TARGET: usize = 4;

/// What stands in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Frame<'b> {
    /// MAVLink 2, or a payload of MAVLink 1 with fields of that: cut zeros are to be restored, and there may be more fields.
    pub(super) wide: bool,
    pub(super) system: u8,
    pub(super) component: u8,
    pub(super) message: u32,
    pub(super) is_signed: bool,
    /// Incompatibility flags that this reader does not know: then the payload may mean anything.
    pub(super) unknown_flags: u8,
    pub(super) payload: &'b [u8],
    /// Bytes of the whole frame.
    pub(super) length: usize,
    /// Whether the checksum is right; `None` for a message that is not defined. Then [`Frame::extra`] is what the
    /// sender must have put into it.
    pub(super) intact: Option<bool>,
    /// The number that stands for the layout in the checksum: as defined, or the one that makes it right.
    pub(super) extra: Option<u8>,
    /// Of a defined message whose checksum is wrong: the number of another layout that would make it right.
    pub(super) other: Option<u8>,
    /// The checksum as it stands there.
    pub(super) told: u16,
    /// Zeros that are missing at the end of a payload whose checksum is wrong: with them it is right.
    pub(super) zeros_cut: Option<usize>,
    /// Bytes of the payload before any zero is left out, without the fields of MAVLink 2, if the message is defined.
    base: Option<usize>,
}

/// Why there is no frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum NoFrame {
    /// It does not begin as one.
    Foreign,
    /// The bytes end inside it.
    Cut,
}

/// What stands in front of a payload.
#[derive(Debug, Clone, Copy)]
struct Head {
    wide: bool,
    flags: u8,
    system: u8,
    component: u8,
    message: u32,
    /// Bytes in front of the payload, and of it.
    header: usize,
    payload: usize,
}

impl Head {
    /// The head that the bytes begin with, as the specification has it.
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

    /// The same as the draft has it, if its flags are set.
    fn drafted(self, bytes: &[u8]) -> Option<Head> {
        let sender = if self.flags & SYSID32 == 0 { 0 } else { WIDE_SENDER };
        let target = if self.flags & TARGET32 == 0 { 0 } else { WIDE_TARGET };
        let [component, low, middle, high] = *bytes.get(HEADER_1 + sender..)?.first_chunk()?;
        let (header, message) = (self.header + sender + target, u32::from_le_bytes([low, middle, high, 0]));
        (sender + target > 0).then_some(Head { component, message, header, ..self })
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
    /// Bytes of the frame that the bytes begin with, intact or not.
    pub(super) fn length_at(bytes: &[u8]) -> Option<usize> {
        let head = Head::at(bytes).ok()?;
        Some(Frame::drafted(head, bytes).map_or(head.length(), |frame| frame.length))
    }

    /// The frame that the bytes begin with.
    pub(super) fn at(bytes: &'b [u8]) -> Result<Frame<'b>, NoFrame> {
        let head = Head::at(bytes)?;
        Frame::drafted(head, bytes).map_or_else(|| Frame::behind(head, bytes), Ok)
    }

    /// The same as the draft has it, if its checksum proves that.
    fn drafted(head: Head, bytes: &'b [u8]) -> Option<Frame<'b>> {
        let frame = head.drafted(bytes).and_then(|head| Frame::behind(head, bytes).ok());
        frame.filter(|frame| frame.intact == Some(true))
    }

    fn behind(head: Head, bytes: &'b [u8]) -> Result<Frame<'b>, NoFrame> {
        let length = head.length();
        let (checked, rest) =
            bytes.get(..length).and_then(|b| b.split_at_checked(head.checked())).ok_or(NoFrame::Cut)?;
        let told = rest.first_chunk().map(|two| u16::from_le_bytes(*two)).ok_or(NoFrame::Cut)?;
        let mut checksum = Checksum::new();
        checksum.add(checked.get(1..).unwrap_or_default());
        let definition = Definitions::all().get(head.message);
        let defined = definition.map(|d| d.extra);
        let intact = defined.map(|extra| checksum.with(extra) == told);
        let suspect = definition.filter(|_| head.wide && intact == Some(false));
        Ok(Frame {
            wide: head.wide || definition.is_some_and(|d| head.payload > d.length(false)),
            system: head.system,
            component: head.component,
            message: head.message,
            is_signed: head.flags & SIGNED != 0,
            unknown_flags: head.flags & !SIGNED,
            payload: checked.get(head.header..).unwrap_or_default(),
            length,
            intact,
            extra: defined.or_else(|| checksum.extra_of(told)),
            other: checksum.extra_of(told).filter(|_| intact == Some(false)),
            told,
            zeros_cut: suspect.and_then(|definition| zeros_cut(definition, checked, head.payload, told)),
            base: definition.map(|d| d.length(false)),
        })
    }

    /// The frame as one of a message that is not defined.
    pub(super) fn undefined(self) -> Frame<'b> {
        Frame { intact: None, extra: self.other, zeros_cut: None, base: None, ..self }
    }

    /// Whether its sender left zeros out.
    pub(super) fn is_shortened(&self) -> bool {
        self.wide && self.intact == Some(true) && self.base.is_some_and(|base| self.payload.len() < base)
    }
}

/// How many zeros behind the payload make the checksum right: none, one behind a text, or as many as complete a field.
fn zeros_cut(definition: &Definition, checked: &[u8], payload: usize, told: u16) -> Option<usize> {
    let (_, sent) = checked.split_at_checked(2)?;
    // What leaves zeros out leaves out all but the first byte.
    if payload > 1 && sent.last() == Some(&0) {
        return None;
    }
    let with = |length: usize| {
        let mut checksum = Checksum::new();
        checksum.add(&[u8::try_from(length).ok()?]);
        checksum.add(sent);
        (payload..length).for_each(|_| checksum.add(&[0]));
        (checksum.with(definition.extra) == told).then_some(length - payload)
    };
    let ends = definition.ends().into_iter().filter(|end| *end > payload + 1);
    [payload + 1].into_iter().chain(ends).find_map(with)
}

/// Finds intact frames in a block; each place takes one step, whatever length stands there.
///
/// A checksum is linear: with Q(i) that of the first i bytes, begun with zero, and A what a zero byte makes of a checksum,
/// the one of the bytes from i to j, begun with c, is A^(j-i) (c + Q(i)) + Q(j), where + is the exclusive or.
pub(super) struct Finder {
    block: Vec<u8>,
    /// Q.
    sums: Vec<u16>,
}

impl Finder {
    pub(super) fn new(block: Vec<u8>) -> Finder {
        let mut sums = Vec::with_capacity(block.len() + 1);
        let mut sum = Checksum(0);
        sums.push(sum.0);
        for byte in &block {
            sum.add(std::slice::from_ref(byte));
            sums.push(sum.0);
        }
        Finder { block, sums }
    }

    pub(super) fn block(&self) -> &[u8] {
        &self.block
    }

    /// Whether an intact frame of a defined message begins here.
    pub(super) fn is_frame(&self, at: usize) -> bool {
        let bytes = self.block.get(at..).unwrap_or_default();
        Head::at(bytes).is_ok_and(|head| {
            let heads = [head.drafted(bytes), Some(head)];
            heads.into_iter().flatten().any(|head| self.is_intact(at, bytes, head).unwrap_or(false))
        })
    }

    fn is_intact(&self, at: usize, bytes: &[u8], head: Head) -> Option<bool> {
        let defined = Definitions::all().get(head.message)?.extra;
        Some(self.extra(at, bytes, head)? == defined)
    }

    /// The number that stands for the layout in the checksum of the frame at `at`, if one does.
    fn extra(&self, at: usize, bytes: &[u8], head: Head) -> Option<u8> {
        let told = bytes.get(..head.length())?.get(head.checked()..)?.first_chunk()?;
        // The magic is not summed up.
        let [from, to] = [self.sums.get(at + 1)?, self.sums.get(at + head.checked())?];
        let sum = advanced(Checksum::new().0 ^ from, head.checked() - 1)? ^ to;
        Checksum(sum).extra_of(u16::from_le_bytes(*told))
    }

    /// The message and the layout of the frame at `at`, whether it is defined or not, and the bytes of the frame; `None` if no
    /// layout makes its checksum right.
    pub(super) fn layout(&self, at: usize) -> Option<(u32, u8, usize)> {
        let bytes = self.block.get(at..)?;
        let head = Head::at(bytes).ok()?;
        Some((head.message, self.extra(at, bytes, head)?, head.length()))
    }
}

/// What `zeros` zero bytes make of a checksum; `None` for more than a frame has.
fn advanced(sum: u16, zeros: usize) -> Option<u16> {
    let of_bits = OF_BITS.get(zeros)?;
    let bits = of_bits.iter().enumerate().filter(|(bit, _)| sum >> bit & 1 == 1);
    Some(bits.fold(0, |advanced, (_, of_bit)| advanced ^ of_bit))
}

/// What each number of zero bytes makes of each single bit.
#[allow(clippy::indexing_slicing, reason = "worked out by the compiler, which checks it")]
static OF_BITS: [[u16; 16]; LONGEST] = {
    let mut table = [[0; 16]; LONGEST];
    let mut bit = 0;
    while bit < 16 {
        let mut sum = 1 << bit;
        let mut zeros = 0;
        while zeros < LONGEST {
            table[zeros][bit] = sum;
            sum = step(sum, 0);
            zeros += 1;
        }
        bit += 1;
    }
    table
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_finder_finds_what_the_frames_are() {
        let messages = [0_u32, 30, 33, 24, 77];
        let mut block = vec![];
        for i in 0..250_u8 {
            let message = messages[usize::from(i) % messages.len()];
            let length = [9, 3, 28, 255][usize::from(i) % 4];
            // Some have flags of the draft and not its header.
            let flags = if i % 7 == 0 { i % 8 } else { i & 1 };
            let mut frame = vec![0xfd, length, flags, 0, i, 1, 1, message as u8, 0, 0];
            frame.extend((0..length).map(|at| at.wrapping_mul(i)));
            let mut checksum = Checksum::new();
            checksum.add(&frame[1..]);
            let told = Definitions::all().get(message).map_or(7, |d| checksum.with(d.extra));
            block.extend(vec![i.wrapping_mul(37); usize::from(i % 5)]);
            block.extend(frame.into_iter().chain(told.to_le_bytes()));
            block.extend(vec![0xfe; if flags & 1 == 1 { SIGNATURE } else { 0 }]);
        }
        let finder = Finder::new(block.clone());
        let truth = |at: &usize| Frame::at(&block[*at..]).is_ok_and(|frame| frame.intact == Some(true));
        let found: Vec<usize> = (0..block.len()).filter(|at| finder.is_frame(*at)).collect();
        assert_eq!(found, (0..block.len()).filter(truth).collect::<Vec<_>>());
        assert!(found.len() >= 200, "{}", found.len());
        // However long the header is, by its flags or by its checksum.
        let lengths = |at: &usize| (Frame::length_at(&block[*at..]), Frame::at(&block[*at..]).ok().map(|f| f.length));
        assert!(found.iter().map(lengths).all(|(said, true_one)| said == true_one));
    }

    /// Frames of COMMAND_LONG from system 42 or 10.0.0.1 to 7 or 10.0.0.2, the last one signed: from the tests of the draft.
    const DRAFTED: [&str; 4] = [
        "fd210400002a0b4c00000200000a0000803f0000004000004040000080400000a0400000c0400000e0402c01fffa018df2",
        "fd210200000100000a0b4c00000000803f0000004000004040000080400000a0400000c0400000e0402c0107fa019d0f",
        "fd210600000100000a0b4c00000200000a0000803f0000004000004040000080400000a0400000c0400000e0402c01fffa0140e5",
        "fd210700000100000a0b4c00000200000a0000803f0000004000004040000080400000a0400000c0400000e0402c01fffa01d03903e80300\
         000000349dea1b799d",
    ];

    #[test]
    fn a_frame_with_the_longer_header_of_the_draft_is_intact_and_its_flags_are_not_known() {
        for text in DRAFTED {
            let digit = |at: usize| u8::from_str_radix(&text[at..at + 2], 16).unwrap();
            let bytes: Vec<u8> = (0..text.len()).step_by(2).map(digit).collect();
            let frame = Frame::at(&bytes).unwrap();
            assert_eq!((frame.message, frame.component, frame.length), (76, 11, bytes.len()), "{text}");
            assert_eq!((frame.intact, frame.unknown_flags), (Some(true), bytes[2] & !SIGNED));
            assert!(Finder::new(bytes.clone()).is_frame(0));
            for bit in 8..8 * (bytes.len() - if frame.is_signed { SIGNATURE } else { 0 }) {
                let mut damaged = bytes.clone();
                damaged[bit / 8] ^= 1 << (bit % 8);
                assert_ne!(Frame::at(&damaged).map(|f| f.intact), Ok(Some(true)), "{text}: {bit}");
            }
        }
    }

    #[test]
    fn a_frame_is_taken_apart_in_both_versions_with_and_without_a_signature() {
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
