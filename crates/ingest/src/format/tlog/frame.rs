//! A frame of MAVLink 1 or 2 (<https://mavlink.io/en/guide/serialization.html>).

use super::definition::Definitions;

/// First bytes of a frame.
pub(super) const MAGIC: [u8; 2] = [0xfe, 0xfd];
/// The longest: header, payload, checksum and signature of MAVLink 2.
pub(super) const LONGEST: usize = 10 + 255 + 2 + 13;
/// Of the shortest, without payload.
const HEADER_1: usize = 6;
const HEADER_2: usize = 10;
const SIGNATURE: usize = 13;
/// The flag of MAVLink 2 that a signature follows.
const SIGNED: u8 = 1;

/// What stands in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Frame<'b> {
    /// MAVLink 2: cut zeros are to be restored, and there may be more fields.
    pub(super) wide: bool,
    pub(super) system: u8,
    pub(super) component: u8,
    pub(super) message: u32,
    /// Flags that this reader does not know: then the payload may mean anything.
    pub(super) unknown_flags: bool,
    pub(super) payload: &'b [u8],
    /// Bytes of the whole frame.
    pub(super) length: usize,
    /// Whether the checksum is right; `None` for a message that is not defined. Then [`Frame::extra`] is what the
    /// sender must have put into it.
    pub(super) intact: Option<bool>,
    /// The number that stands for the layout in the checksum: as defined, or the one that makes it right.
    pub(super) extra: Option<u8>,
}

/// Why there is no frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum NoFrame {
    /// It does not begin as one.
    Foreign,
    /// The bytes end inside it.
    Cut,
}

impl<'b> Frame<'b> {
    /// The frame that the bytes begin with.
    pub(super) fn at(bytes: &'b [u8]) -> Result<Frame<'b>, NoFrame> {
        let (Some(&magic), Some(&payload)) = (bytes.first(), bytes.get(1)) else { return Err(NoFrame::Cut) };
        if !MAGIC.contains(&magic) {
            return Err(NoFrame::Foreign);
        }
        let wide = magic == MAGIC[1];
        let header = if wide { HEADER_2 } else { HEADER_1 };
        let checked = bytes.get(..header + usize::from(payload)).ok_or(NoFrame::Cut)?;
        let (head, payload) = checked.split_at_checked(header).ok_or(NoFrame::Cut)?;
        let (flags, system, component, message) = match *head {
            [_, _, _, system, component, message] => (0, system, component, u32::from(message)),
            [_, _, flags, _, _, system, component, a, b, c] => {
                (flags, system, component, u32::from_le_bytes([a, b, c, 0]))
            }
            _ => return Err(NoFrame::Cut),
        };
        let signature = if flags & SIGNED == 0 { 0 } else { SIGNATURE };
        let length = checked.len() + 2 + signature;
        let rest = bytes.get(checked.len()..length).ok_or(NoFrame::Cut)?;
        let told = rest.first_chunk().map(|two| u16::from_le_bytes(*two)).ok_or(NoFrame::Cut)?;
        let mut checksum = Checksum::new();
        checksum.add(checked.get(1..).unwrap_or_default());
        let defined = Definitions::all().get(message).map(|d| d.extra);
        let implied = || (0..=u8::MAX).find(|extra| checksum.with(*extra) == told);
        Ok(Frame {
            wide,
            system,
            component,
            message,
            unknown_flags: flags & !SIGNED != 0,
            payload,
            length,
            intact: defined.map(|extra| checksum.with(extra) == told),
            extra: defined.or_else(implied),
        })
    }
}

/// CRC-16/MCRF4XX, which MAVLink calls X.25.
#[derive(Debug, Clone, Copy)]
pub(super) struct Checksum(u16);

impl Checksum {
    pub(super) fn new() -> Checksum {
        Checksum(0xffff)
    }

    pub(super) fn add(&mut self, bytes: &[u8]) {
        self.0 = bytes.iter().fold(self.0, |crc, &byte| {
            let mut low = byte ^ crc as u8;
            low ^= low << 4;
            let low = u16::from(low);
            (crc >> 8) ^ (low << 8) ^ (low << 3) ^ (low >> 4)
        });
    }

    /// With one more byte.
    fn with(self, byte: u8) -> u16 {
        let mut more = self;
        more.add(&[byte]);
        more.0
    }

    pub(super) fn value(self) -> u16 {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_that_of_the_catalogue() {
        let mut checksum = Checksum::new();
        checksum.add(b"123456789");
        assert_eq!(checksum.value(), 0x6f91);
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
