//! The frames of MCAP records, as far as needed before a record is taken.

use crate::bytes::Bytes;
use crate::format::inflate::Codec;
use crate::format::unpacker::Packed;
use logscan::{LogFile, ScanError, Source};
use mcap::records::{Record, op};
use std::ops::Range;

/// The magic bytes at both ends of a file.
pub(super) const MAGIC: &[u8; 8] = b"\x89MCAP0\r\n";
/// Reported for a file that does not start with it.
pub(super) const WRONG_START: &str = "the first eight bytes of the file are wrong";
/// Opcode and length.
pub(super) const HEAD_BYTES: u64 = 9;
/// Largest head of a chunk record: the frame, the fixed fields and the name of the compression.
const CHUNK_HEAD_BYTES: usize = 128;
/// Records up to this length are read in place; attachments have their own header within it, bytes.
pub(super) const LONGEST: usize = 4 << 10;
/// Bytes read together with a chunk, to examine what follows.
const AHEAD: u64 = LONGEST as u64 + 64;
/// No record is this long, bytes.
const LONGEST_RECORD: u64 = 1 << 40;
/// Writers may add fields that we do not know to a record; more than this is treated as damage.
const MOST_ADDED: u64 = 256;

/// Opcode, offset and length of a record.
#[derive(Debug, Clone, Copy)]
pub(super) struct Head {
    pub(super) opcode: u8,
    pub(super) start: u64,
    /// Length of the content.
    pub(super) length: u64,
    /// First byte after the record.
    pub(super) end: u64,
}

impl Head {
    /// Parses the record at `start` in the bytes; `None` if they end before the head does. The record may extend past
    /// them.
    #[inline]
    pub(super) fn of(bytes: &[u8], start: u64) -> Option<Head> {
        let mut rest = Bytes(bytes);
        let (opcode, length) = (rest.u8()?, rest.u64()?);
        let end = (start + HEAD_BYTES).saturating_add(length);
        Some(Head { opcode, start, length, end })
    }

    /// `None` if the file ends before the head does. The record may still extend past the end.
    pub(super) fn read(file: &mut LogFile, start: u64) -> Result<Option<Head>, ScanError> {
        Ok(file.peek::<{ HEAD_BYTES as usize }>(start)?.and_then(|bytes| Head::of(&bytes, start)))
    }

    /// Whether a record may have this type and length.
    #[inline]
    pub(super) fn may_be(&self) -> bool {
        self.opcode != 0 && self.length < LONGEST_RECORD
    }

    /// Whether the length matches the content, as far as `body` has its first bytes. A writer may have added
    /// a few.
    pub(super) fn fits_its_content(&self, body: &[u8]) -> bool {
        let mut own = 0_u64;
        for part in parts_of(self.opcode) {
            own += match part {
                Part::Bytes(count) => *count as u64,
                Part::Text | Part::TextMap | Part::Offsets => {
                    let length = body.get(own as usize..).and_then(|rest| Bytes(rest).u32());
                    let Some(length) = length else { return own + 4 <= self.length && self.length > body.len() as u64 };
                    4 + u64::from(length)
                }
            };
        }
        let added = body.get(own as usize..self.length as usize);
        own <= self.length && !Head::is_too_long(self.length - own) && !added.is_some_and(Head::are_records)
    }

    /// Whether the bytes after the content are whole records, which a wrong length would skip.
    pub(super) fn are_records(mut bytes: &[u8]) -> bool {
        let is_empty = bytes.is_empty();
        while let Some(head) = Head::of(bytes, 0).filter(|head| is_defined(head.opcode) && head.fits_its_type()) {
            let Some(rest) = usize::try_from(head.end).ok().and_then(|end| bytes.get(end..)) else { return false };
            bytes = rest;
        }
        !is_empty && bytes.is_empty()
    }

    /// Whether this many bytes after the content are more than a writer may have added.
    pub(super) fn is_too_long(added: u64) -> bool {
        added > MOST_ADDED
    }

    /// Whether the length is possible for the record type.
    pub(super) fn fits_its_type(&self) -> bool {
        let fixed = match self.opcode {
            op::FOOTER => 20,
            op::SUMMARY_OFFSET => 17,
            op::DATA_END => 4,
            _ => return true,
        };
        (fixed..=fixed + MOST_ADDED).contains(&self.length)
    }
}

pub(super) fn is_defined(opcode: u8) -> bool {
    (op::HEADER..=op::DATA_END).contains(&opcode)
}

/// Whether the type is one of those reserved for applications.
pub(super) fn is_private(opcode: u8) -> bool {
    opcode >= 0x80
}

/// Readable name of a record type.
pub(super) fn name(opcode: u8) -> String {
    let name = match opcode {
        op::HEADER => "header",
        op::FOOTER => "footer",
        op::SCHEMA => "schema",
        op::CHANNEL => "channel",
        op::MESSAGE => "message",
        op::CHUNK => "chunk",
        op::MESSAGE_INDEX => "message index",
        op::CHUNK_INDEX => "chunk index",
        op::ATTACHMENT => "attachment",
        op::ATTACHMENT_INDEX => "attachment index",
        op::STATISTICS => "statistics",
        op::METADATA => "metadata",
        op::METADATA_INDEX => "metadata index",
        op::SUMMARY_OFFSET => "summary offset",
        op::DATA_END => "end of data",
        other => return format!("record of unknown type 0x{other:02x}"),
    };
    name.to_owned()
}

/// The fields of a record, in order.
enum Part {
    Bytes(usize),
    /// Bytes, preceded by their length.
    Text,
    /// Pairs of texts, preceded by their total length.
    TextMap,
    /// Ids and offsets or counts of ten bytes, preceded by their total length.
    Offsets,
}

/// Parses a record whose texts are known to lie within it: `mcap` allocates for a text of up to 4 GiB before it
/// checks whether the text is present.
pub(super) fn parse(opcode: u8, body: &[u8]) -> Result<Record<'_>, String> {
    parts_fit(parts_of(opcode), body).ok_or("its content reaches beyond its end")?;
    mcap::read::parse_record(opcode, body).map_err(|e| e.to_string())
}

/// The fields of a record; empty for types with content of any length.
fn parts_of(opcode: u8) -> &'static [Part] {
    match opcode {
        op::HEADER => &[Part::Text, Part::Text],
        op::FOOTER => &[Part::Bytes(20)],
        op::SCHEMA => &[Part::Bytes(2), Part::Text, Part::Text, Part::Text],
        op::CHANNEL => &[Part::Bytes(4), Part::Text, Part::Text, Part::TextMap],
        op::MESSAGE_INDEX => &[Part::Bytes(2), Part::Text],
        op::CHUNK_INDEX => &[Part::Bytes(32), Part::Offsets, Part::Bytes(8), Part::Text, Part::Bytes(16)],
        op::ATTACHMENT_INDEX => &[Part::Bytes(40), Part::Text, Part::Text],
        op::STATISTICS => &[Part::Bytes(42), Part::Offsets],
        op::METADATA => &[Part::Text, Part::TextMap],
        op::METADATA_INDEX => &[Part::Bytes(16), Part::Text],
        op::SUMMARY_OFFSET => &[Part::Bytes(17)],
        op::DATA_END => &[Part::Bytes(4)],
        _ => &[],
    }
}

fn parts_fit(parts: &[Part], body: &[u8]) -> Option<()> {
    let mut rest = Bytes(body);
    for part in parts {
        match part {
            Part::Bytes(count) => _ = rest.take(*count)?,
            Part::Text => _ = rest.prefixed()?,
            Part::TextMap => {
                let mut map = Bytes(rest.prefixed()?);
                while !map.0.is_empty() {
                    map.prefixed()?;
                    map.prefixed()?;
                }
            }
            Part::Offsets => _ = rest.prefixed().filter(|offsets| offsets.len().is_multiple_of(10))?,
        }
    }
    Some(())
}

/// The header of a chunk.
#[derive(Debug, Clone, Copy)]
pub(super) struct ChunkHead {
    pub(super) codec: Codec,
    pub(super) uncompressed: u64,
    pub(super) crc: u32,
    /// Offset of the compressed bytes from the start of the record.
    pub(super) data_at: u64,
    pub(super) compressed: u64,
}

impl ChunkHead {
    /// The header of the chunk record at the start of the bytes, if it fits. The error text is for users.
    pub(super) fn of(bytes: &[u8], head: &Head) -> Result<ChunkHead, String> {
        let most = head.length.saturating_add(HEAD_BYTES).min(CHUNK_HEAD_BYTES as u64) as usize;
        let parsed = ChunkHead::parse(bytes.get(..most).unwrap_or(bytes));
        parsed.ok_or_else(|| "the header of the chunk is truncated".to_owned())?.and_then(|chunk| chunk.fits_in(head))
    }

    fn parse(bytes: &[u8]) -> Option<Result<ChunkHead, String>> {
        let mut rest = Bytes(bytes);
        rest.take(HEAD_BYTES as usize)?;
        // First and last log time of its messages: the messages have them too.
        rest.take(16)?;
        let uncompressed = rest.u64()?;
        let crc = rest.u32()?;
        let Some(compression) = rest.prefixed() else {
            return Some(Err("compression with an invalid name".to_owned()));
        };
        let codec = match compression {
            b"" => Codec::None,
            b"zstd" => Codec::Zstd,
            b"lz4" => Codec::Lz4,
            other => return Some(Err(format!("unknown compression {:?}", String::from_utf8_lossy(other)))),
        };
        let compressed = rest.u64()?;
        let data_at = (bytes.len() - rest.0.len()) as u64;
        Some(Ok(ChunkHead { codec, uncompressed, crc, data_at, compressed }))
    }

    /// As found in a file of `size` bytes.
    pub(super) fn packed(&self, head: &Head, size: u64) -> Packed {
        let data_at = head.start + self.data_at;
        Packed {
            fetched: head.start..head.end.saturating_add(AHEAD).min(size),
            data: data_at..data_at + self.compressed,
            codec: self.codec,
            declared: self.uncompressed,
            summed: self.crc != 0,
        }
    }

    /// The chunk of the record at `at`, if it is one.
    pub(super) fn look(file: &mut LogFile, at: u64) -> Result<Option<Packed>, ScanError> {
        let size = file.size();
        let bytes = file.up_to(at, CHUNK_HEAD_BYTES)?;
        let Some(head) = Head::of(bytes, at).filter(|head| head.opcode == op::CHUNK && head.end <= size) else {
            return Ok(None);
        };
        Ok(ChunkHead::of(bytes, &head).ok().map(|chunk| chunk.packed(&head, size)))
    }

    fn fits_in(self, head: &Head) -> Result<ChunkHead, String> {
        let needed = self.compressed.saturating_add(self.data_at);
        let there = head.length.saturating_add(HEAD_BYTES);
        if (needed..=needed.saturating_add(MOST_ADDED)).contains(&there) {
            Ok(self)
        } else {
            Err(format!("a chunk of {} compressed bytes does not fit its record of {there}", self.compressed))
        }
    }
}

/// The header of an attachment, and the position of its checksum.
#[derive(Debug)]
pub(super) struct AttachmentHead {
    pub(super) logged_ns: u64,
    pub(super) created_ns: u64,
    pub(super) name: String,
    pub(super) media_type: String,
    /// Where the attached bytes are in the content of the record.
    pub(super) data: Range<u64>,
}

impl AttachmentHead {
    /// `start` is the beginning of the record's content: the part that was read of its `length`.
    pub(super) fn parse(start: &[u8], length: u64) -> Option<AttachmentHead> {
        let mut rest = Bytes(start);
        let (logged_ns, created_ns) = (rest.u64()?, rest.u64()?);
        let name = String::from_utf8_lossy(rest.prefixed()?).into_owned();
        let media_type = String::from_utf8_lossy(rest.prefixed()?).into_owned();
        let size = rest.u64()?;
        let from = (start.len() - rest.0.len()) as u64;
        let data = from..size.checked_add(from)?;
        (data.end.checked_add(4)? <= length).then_some(AttachmentHead { logged_ns, created_ns, name, media_type, data })
    }

    /// The attached bytes, if `body` holds all of them.
    pub(super) fn data_in<'b>(&self, body: &'b [u8]) -> Option<&'b [u8]> {
        body.get(self.data.start as usize..usize::try_from(self.data.end).ok()?)
    }
}
