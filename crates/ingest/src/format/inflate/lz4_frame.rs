//! The LZ4 frame format (<https://github.com/lz4/lz4/blob/dev/doc/lz4_Frame_format.md>), block by block straight into
//! the output, where the blocks before are the dictionary of those that are linked. A decoder for streams copies every
//! byte three times on its way.

use crate::bytes::Bytes;
use lz4_flex::block::decompress_into_with_dict;
use xxhash_rust::xxh32::xxh32;

const MAGIC: u32 = 0x184d_2204;
/// How far back a block may refer.
const WINDOW: usize = 64 << 10;
/// Set in the length of a block that is stored as it is.
const STORED: u32 = 1 << 31;
const CUT: &str = "the frame is cut";

/// What the frame says of its blocks.
struct Descriptor {
    linked: bool,
    block_checksums: bool,
    content_bytes: Option<u64>,
    content_checksum: bool,
    /// Most bytes of one block.
    block_bytes: usize,
}

impl Descriptor {
    fn read(rest: &mut Bytes<'_>) -> Result<Descriptor, &'static str> {
        if rest.u32() != Some(MAGIC) {
            return Err("this is no frame");
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
            _ => return Err("blocks of a size that is not defined"),
        };
        // Version, a reserved bit, and whether there is a dictionary, which nobody could give us.
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

/// Decompresses a frame that declares to become `declared` bytes, and never makes more of it. `out` grows as needed: up
/// to `at_once` bytes in one go, beyond that with what arrives. Gives back how many of its bytes are filled, and what
/// is wrong with the rest.
pub(super) fn decode(data: &[u8], declared: usize, at_once: usize, out: &mut Vec<u8>) -> (usize, Option<&'static str>) {
    let mut filled = 0;
    let fault = blocks(data, declared, at_once, out, &mut filled).err();
    (filled, fault)
}

fn blocks(
    data: &[u8],
    declared: usize,
    at_once: usize,
    out: &mut Vec<u8>,
    filled: &mut usize,
) -> Result<(), &'static str> {
    let mut rest = Bytes(data);
    let frame = Descriptor::read(&mut rest)?;
    loop {
        let word = rest.u32().ok_or(CUT)?;
        if word == 0 {
            break;
        }
        let length = (word & !STORED) as usize;
        if length > frame.block_bytes {
            return Err("a block longer than its frame allows");
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
            room.get_mut(..length).ok_or("a block longer than is declared")?.copy_from_slice(block);
            length
        } else {
            let window = if frame.linked { before.len().min(WINDOW) } else { 0 };
            let dictionary = before.get(before.len() - window..).unwrap_or_default();
            decompress_into_with_dict(block, room, dictionary).map_err(|_| "a block cannot be decompressed")?
        };
    }
    if frame.content_bytes.is_some_and(|stated| stated != *filled as u64) {
        return Err("the frame does not hold as many bytes as it states");
    }
    let content = out.get(..*filled).unwrap_or_default();
    if frame.content_checksum && rest.u32().ok_or(CUT)? != xxh32(content, 0) {
        return Err("the checksum of the frame is wrong");
    }
    Ok(())
}
