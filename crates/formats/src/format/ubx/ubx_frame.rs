//! UBX frames, RTCM 3 frames between them, and their checksums.

/// First bytes of a UBX frame.
pub(crate) const SYNC: [u8; 2] = [0xb5, 0x62];
/// First byte of an RTCM 3 frame.
pub(crate) const RTCM: u8 = 0xd3;
/// Sync, class, number and length.
pub(super) const HEADER: usize = 6;
const CHECKSUM: usize = 2;
/// The longest frame.
pub(crate) const LONGEST: usize = HEADER + u16::MAX as usize + CHECKSUM;

/// An intact frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Frame<'b> {
    pub(super) class: u8,
    pub(super) number: u8,
    pub(super) payload: &'b [u8],
    /// Bytes of the whole frame.
    pub(super) length: usize,
}

impl<'b> Frame<'b> {
    /// The frame at the start of the bytes. Fails with what is wrong.
    pub(super) fn at(bytes: &'b [u8]) -> Result<Frame<'b>, &'static str> {
        let length = length_at(bytes).ok_or(CUT)?;
        let (head, rest) = bytes.split_at_checked(HEADER).ok_or(CUT)?;
        let payload = rest.get(..length - HEADER - CHECKSUM).ok_or(CUT)?;
        let checked = bytes.get(SYNC.len()..length - CHECKSUM).ok_or(CUT)?;
        let stored = bytes.get(length - CHECKSUM..length).ok_or(CUT)?;
        match *head {
            [_, _, class, number, ..] if stored == fletcher(checked) => Ok(Frame { class, number, payload, length }),
            _ => Err(WRONG),
        }
    }

    /// Parses bytes that are known to be an intact frame.
    pub(super) fn of(bytes: &'b [u8]) -> Frame<'b> {
        let at = |place: usize| bytes.get(place).copied().unwrap_or_default();
        let payload = bytes.get(HEADER..bytes.len().saturating_sub(CHECKSUM)).unwrap_or_default();
        Frame { class: at(2), number: at(3), payload, length: bytes.len() }
    }
}

/// Whether these last bytes of a file are the start of a frame.
pub(super) fn may_be_cut(bytes: &[u8]) -> bool {
    SYNC.starts_with(bytes) || bytes.starts_with(&SYNC)
}

/// Fault of a complete frame.
pub(super) const WRONG: &str = "the checksum of a frame is wrong";
/// Fault of an incomplete frame.
pub(super) const CUT: &str = "a frame with a wrong length";

/// Length of the frame that begins here, by its header; `None` if the header is truncated.
pub(super) fn length_at(bytes: &[u8]) -> Option<usize> {
    let length = bytes.get(4..).and_then(<[u8]>::first_chunk).map(|two| u16::from_le_bytes(*two))?;
    bytes.starts_with(&SYNC).then_some(HEADER + usize::from(length) + CHECKSUM)
}

/// The 8-bit Fletcher checksum of RFC 1145.
fn fletcher(bytes: &[u8]) -> [u8; 2] {
    let sum = |[a, b]: [u8; 2], byte: &u8| {
        let a = a.wrapping_add(*byte);
        [a, b.wrapping_add(a)]
    };
    bytes.iter().fold([0, 0], sum)
}

/// Length of the RTCM 3 frame at the start of the bytes, by its header: preamble, ten bits of length, payload, CRC-24Q
/// (RTCM 10403).
pub(super) fn stated_rtcm_length(bytes: &[u8]) -> Option<usize> {
    let &[preamble, high, low] = bytes.first_chunk()?;
    (preamble == RTCM && high & 0xfc == 0).then_some(3 + usize::from(u16::from_be_bytes([high, low])) + 3)
}

/// Length of the intact RTCM 3 frame at the start of the bytes.
pub(super) fn rtcm_length(bytes: &[u8]) -> Option<usize> {
    let length = stated_rtcm_length(bytes)?;
    let (checked, stored) = bytes.get(..length)?.split_last_chunk::<3>()?;
    (crc24(checked).to_be_bytes().get(1..) == Some(stored)).then_some(length)
}

fn crc24(bytes: &[u8]) -> u32 {
    bytes.iter().fold(0, |crc, byte| {
        let index = (crc >> 16) as u8 ^ byte;
        (crc << 8 & 0xff_ffff) ^ CRC24.get(usize::from(index)).copied().unwrap_or_default()
    })
}

/// Contribution of each byte.
#[allow(clippy::indexing_slicing, reason = "worked out by the compiler, which checks it")]
const CRC24: [u32; 256] = {
    const POLYNOMIAL: u32 = 0x186_4cfb;
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let mut crc = (byte as u32) << 16;
        let mut bit = 0;
        while bit < 8 {
            crc <<= 1;
            if crc & 0x100_0000 != 0 {
                crc ^= POLYNOMIAL;
            }
            bit += 1;
        }
        table[byte] = crc;
        byte += 1;
    }
    table
};

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(class: u8, number: u8, payload: &[u8]) -> Vec<u8> {
        let body = [&[class, number][..], &(payload.len() as u16).to_le_bytes(), payload].concat();
        [&SYNC[..], &body, &fletcher(&body)].concat()
    }

    #[test]
    fn a_published_frame_is_intact_and_one_flipped_bit_makes_it_corrupt() {
        // The poll of CFG-RATE, as printed in manuals.
        let poll = [0xb5, 0x62, 0x06, 0x08, 0x00, 0x00, 0x0e, 0x30];
        assert_eq!(Frame::at(&poll), Ok(Frame { class: 6, number: 8, payload: &[], length: 8 }));
        let whole = frame(1, 7, &[5; 20]);
        for bit in 0..whole.len() * 8 {
            let mut changed = whole.clone();
            changed[bit / 8] ^= 1 << (bit % 8);
            assert!(Frame::at(&changed).is_err(), "bit {bit}");
        }
        assert_eq!(Frame::at(&whole[..27]), Err(CUT));
    }

    #[test]
    fn a_frame_of_corrections_is_detected_by_its_checksum() {
        // RTCM 10403.1, example of message 1005.
        let text = "D300133ED7D30202980EDEEF34B4BD62AC0941986F33360B98";
        let bytes: Vec<u8> =
            (0..text.len()).step_by(2).map(|i| u8::from_str_radix(&text[i..i + 2], 16).unwrap()).collect();
        assert_eq!(rtcm_length(&bytes), Some(25));
        assert_eq!(rtcm_length(&bytes[..24]), None);
        let mut changed = bytes;
        changed[9] ^= 1;
        assert_eq!(rtcm_length(&changed), None);
    }
}
