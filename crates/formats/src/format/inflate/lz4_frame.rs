//! The LZ4 frame format (<https://github.com/lz4/lz4/blob/dev/doc/lz4_Frame_format.md>), block by block straight into
//! the output, where earlier blocks are the dictionary of linked ones. A streaming decoder copies every
//! byte three times along the way.

use crate::bytes::Bytes;
use lz4_flex::block::decompress_into_with_dict;
use xxhash_rust::xxh32::xxh32;

const MAGIC: u32 = 0x184d_2204;
/// Sixteen magic numbers without their last four bits: a skippable frame, user data preceded by their length.
pub(crate) const SKIPPABLE: u32 = 0x184d_2a50;
/// Maximum distance of a back-reference.
const WINDOW: usize = 64 << 10;
/// Set in the length of an uncompressed block.
const STORED: u32 = 1 << 31;
const CUT: &str = "the frame is truncated";

/// The block properties stated by the frame.
struct Descriptor {
    linked: bool,
    block_checksums: bool,
    content_bytes: Option<u64>,
    content_checksum: bool,
    /// Maximum size of one block, bytes.
    block_bytes: usize,
}

impl Descriptor {
    fn read(rest: &mut Bytes<'_>) -> Result<Descriptor, &'static str> {
        if rest.u32() != Some(MAGIC) {
            return Err("not a frame");
        }
        let start = *rest;
        let (flags, sizes) = rest.u8().zip(rest.u8()).ok_or(CUT)?;
        let has = |bit: u8| flags >> bit & 1 == 1;
        let content_bytes = if has(3) { Some(rest.u64().ok_or(CUT)?) } else { None };
        let block_bytes = match sizes {
            0x40 => 64 << 10,
            0x50 => 256 << 10,
            0x60 => 1 << 20,
            0x70 => 4 << 20,
            _ => return Err("blocks of an undefined size"),
        };
        // Version, a reserved bit, and whether there is a dictionary, which is never available.
        if flags >> 6 != 1 || has(1) || has(0) {
            return Err("a frame of another version, or with a dictionary");
        }
        let length = start.0.len() - rest.0.len();
        let sum = xxh32(start.0.get(..length).unwrap_or_default(), 0);
        if rest.u8().ok_or(CUT)? != (sum >> 8) as u8 {
            return Err("the checksum of the frame's header is wrong");
        }
        let (linked, block_checksums, content_checksum) = (!has(5), has(4), has(2));
        Ok(Descriptor { linked, block_checksums, content_bytes, content_checksum, block_bytes })
    }
}

/// Decompresses consecutive frames with a total declared size of `declared` bytes, and never produces
/// more. `out` grows as needed: up to `at_once` bytes in one go, above that with the output. Returns how many of
/// its bytes are filled, and what is wrong with the rest.
pub(super) fn decode(data: &[u8], declared: usize, at_once: usize, out: &mut Vec<u8>) -> (usize, Option<&'static str>) {
    let mut filled = 0;
    let mut rest = Bytes(data);
    loop {
        if let Err(fault) = skip(&mut rest).unwrap_or_else(|| frame(&mut rest, declared, at_once, out, &mut filled)) {
            return (filled, Some(fault));
        }
        if rest.0.is_empty() {
            return (filled, None);
        }
    }
}

/// Skips a skippable frame; `None` if there is none.
fn skip(rest: &mut Bytes<'_>) -> Option<Result<(), &'static str>> {
    let mut ahead = *rest;
    ahead.u32().filter(|magic| magic & !0xf == SKIPPABLE)?;
    let skipped = ahead.prefixed();
    *rest = ahead;
    Some(skipped.map(|_| ()).ok_or(CUT))
}

/// Takes one frame from the front of `rest`, and appends its content after the `filled` bytes of `out`.
fn frame(
    rest: &mut Bytes<'_>,
    declared: usize,
    at_once: usize,
    out: &mut Vec<u8>,
    filled: &mut usize,
) -> Result<(), &'static str> {
    let start = *filled;
    let frame = Descriptor::read(rest)?;
    loop {
        let word = rest.u32().ok_or(CUT)?;
        if word == 0 {
            break;
        }
        let length = (word & !STORED) as usize;
        if length > frame.block_bytes {
            return Err("a block longer than the frame allows");
        }
        let block = rest.take(length).ok_or(CUT)?;
        if frame.block_checksums && rest.u32().ok_or(CUT)? != xxh32(block, 0) {
            return Err("the checksum of a block is wrong");
        }
        let end = declared.min(filled.saturating_add(frame.block_bytes));
        if out.len() < end {
            out.resize(declared.min(at_once.max(end.saturating_mul(2))), 0);
        }
        let (before, after) = out.split_at_mut_checked(*filled).unwrap_or_default();
        let room = after.get_mut(..end - *filled).unwrap_or_default();
        *filled += if word & STORED != 0 {
            room.get_mut(..length).ok_or("a block longer than declared")?.copy_from_slice(block);
            length
        } else {
            let window = if frame.linked { (before.len() - start).min(WINDOW) } else { 0 };
            let dictionary = before.get(before.len() - window..).unwrap_or_default();
            decompress_into_with_dict(block, room, dictionary).map_err(|_| "a block cannot be decompressed")?
        };
    }
    if frame.content_bytes.is_some_and(|stated| stated != (*filled - start) as u64) {
        return Err("the frame does not hold the number of bytes that it states");
    }
    let content = out.get(start..*filled).unwrap_or_default();
    if frame.content_checksum && rest.u32().ok_or(CUT)? != xxh32(content, 0) {
        return Err("the checksum of the frame is wrong");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use lz4::{BlockMode, ContentChecksum, EncoderBuilder};
    use std::io::Write;

    fn frame_of(content: &[u8], mode: BlockMode) -> Vec<u8> {
        let mut builder = EncoderBuilder::new();
        let builder = builder.block_mode(mode).checksum(ContentChecksum::ChecksumEnabled);
        let mut encoder = builder.build(vec![]).unwrap();
        encoder.write_all(content).unwrap();
        encoder.finish().0
    }

    #[test]
    fn later_frames_are_read_and_skippable_frames_skipped() {
        let content: Vec<u8> = (0..200_000_u32).map(|i| (i / 3 % 251) as u8).collect();
        let (first, second) = content.split_at(130_000);
        let skippable = [&(SKIPPABLE | 7).to_le_bytes()[..], &3_u32.to_le_bytes(), b"abc"].concat();
        for mode in [BlockMode::Independent, BlockMode::Linked] {
            let data = [&skippable, &frame_of(first, mode.clone())[..], &skippable, &frame_of(second, mode)].concat();
            let mut out = vec![];
            assert_eq!(decode(&data, content.len(), 1 << 20, &mut out), (content.len(), None));
            assert!(out[..content.len()] == content[..]);
            // No data after a frame are ignored silently.
            for tail in [&b"x"[..], &skippable[..9], &data[data.len() - 20..]] {
                let data = [&data[..], tail].concat();
                let (filled, fault) = decode(&data, content.len(), 1 << 20, &mut out);
                assert!(filled == content.len() && fault.is_some(), "{fault:?}");
            }
        }
    }
}
