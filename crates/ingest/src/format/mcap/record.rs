//! The frames of MCAP records, as far as they must be understood before a record is taken.

use crate::bytes::Bytes;
use crate::format::inflate::Codec;
use crate::format::unpacker::Packed;
use logscan::{LogFile, ScanError};
use mcap::records::{Record, op};
use std::ops::Range;

/// At both ends of a file.
pub(super) const MAGIC: &[u8; 8] = b"\x89MCAP0\r\n";
/// Said of a file that does not begin with it.
pub(super) const WRONG_START: &str = "the eight bytes that begin the file are wrong";
/// Opcode and length.
pub(super) const HEAD_BYTES: u64 = 9;
/// Largest head of a chunk record: the frame, the fixed fields and the name of the compression.
const CHUNK_HEAD_BYTES: usize = 128;
/// Records up to this length are taken as they lie in memory, and attachments have their own header within it, bytes.
pub(super) const LONGEST: usize = 4 << 10;
/// Bytes read together with a chunk, for a look at what follows.
const AHEAD: u64 = LONGEST as u64 + 64;
/// No record is as long as this, bytes.
const LONGEST_RECORD: u64 = 1 << 40;
/// Writers may add fields that we do not know to a record; more than this is taken for damage.
const MOST_ADDED: u64 = 256;

/// Opcode, place and length of a record.
#[derive(Debug, Clone, Copy)]
pub(super) struct Head {
    pub(super) opcode: u8,
    pub(super) start: u64,
    /// Length of the content.
    pub(super) length: u64,
    /// First byte behind the record.
    pub(super) end: u64,
}

impl Head {
    /// Of the record that the bytes at `start` begin with; `None` if they end before the head does. The record may reach past
    /// them.
    #[inline]
    pub(super) fn of(bytes: &[u8], start: u64) -> Option<Head> {
        let mut rest = Bytes(bytes);
        let (opcode, length) = (rest.u8()?, rest.u64()?);
        let end = (start + HEAD_BYTES).saturating_add(length);
        Some(Head { opcode, start, length, end })
    }

    /// `None` if the file ends before the head does. The record may still reach past the end.
    pub(super) fn read(file: &mut LogFile, start: u64) -> Result<Option<Head>, ScanError> {
        Ok(file.peek::<{ HEAD_BYTES as usize }>(start)?.and_then(|bytes| Head::of(&bytes, start)))
    }

    /// Whether a record may have this type and length.
    #[inline]
    pub(super) fn may_be(&self) -> bool {
        self.opcode != 0 && self.length < LONGEST_RECORD
    }

    /// Whether the length is that of what the record holds, as far as `body` has the first bytes of it. A writer may have added
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

    /// Whether bytes behind what a record holds are whole records, which a wrong length of it leads over.
    pub(super) fn are_records(mut bytes: &[u8]) -> bool {
        let is_empty = bytes.is_empty();
        while let Some(head) = Head::of(bytes, 0).filter(|head| is_defined(head.opcode) && head.fits_its_type()) {
            let Some(rest) = usize::try_from(head.end).ok().and_then(|end| bytes.get(end..)) else { return false };
            bytes = rest;
        }
        !is_empty && bytes.is_empty()
    }

    /// Whether so many bytes behind what a record holds are more than a writer may have added to it.
    pub(super) fn is_too_long(added: u64) -> bool {
        added > MOST_ADDED
    }

    /// Whether the length is one that the record type can have.
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

/// Whether the type is one that applications give a meaning of their own.
pub(super) fn is_private(opcode: u8) -> bool {
    opcode >= 0x80
}

/// Name of a record type for people.
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

/// What a record holds, one behind the other.
enum Part {
    Bytes(usize),
    /// Bytes behind their length.
    Text,
    /// Texts, two by two, behind their length together.
    TextMap,
    /// Ids and offsets or counts of ten bytes, behind their length together.
    Offsets,
}

/// Parses a record whose texts have been seen to lie within it: `mcap` makes room for a text of up to 4 GiB before it
/// looks whether it is there.
pub(super) fn parse(opcode: u8, body: &[u8]) -> Result<Record<'_>, String> {
    parts_fit(parts_of(opcode), body).ok_or("what it holds reaches beyond its end")?;
    mcap::read::parse_record(opcode, body).map_err(|e| e.to_string())
}

/// What a record holds; nothing for those with content of any length.
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

/// What a chunk says of itself.
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
    /// Of a chunk record that the bytes begin with, if it fits; what is wrong is for people.
    pub(super) fn of(bytes: &[u8], head: &Head) -> Result<ChunkHead, String> {
        let most = head.length.saturating_add(HEAD_BYTES).min(CHUNK_HEAD_BYTES as u64) as usize;
        let parsed = ChunkHead::parse(bytes.get(..most).unwrap_or(bytes));
        parsed.ok_or_else(|| "the chunk's own header is cut".to_owned())?.and_then(|chunk| chunk.fits_in(head))
    }

    fn parse(bytes: &[u8]) -> Option<Result<ChunkHead, String>> {
        let mut rest = Bytes(bytes);
        rest.take(HEAD_BYTES as usize)?;
        // First and last log time of its messages: the messages tell.
        rest.take(16)?;
        let uncompressed = rest.u64()?;
        let crc = rest.u32()?;
        let Some(compression) = rest.prefixed() else { return Some(Err("compression of unknown name".to_owned())) };
        let codec = match compression {
            b"" => Codec::None,
            b"zstd" => Codec::Zstd,
            b"lz4" => Codec::Lz4,
            other => return Some(Err(format!("compression {:?} is not known", String::from_utf8_lossy(other)))),
        };
        let compressed = rest.u64()?;
        let data_at = (bytes.len() - rest.0.len()) as u64;
        Some(Ok(ChunkHead { codec, uncompressed, crc, data_at, compressed }))
    }

    /// As a file of `size` bytes has it.
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

/// What an attachment says of itself, and where its checksum lies.
#[derive(Debug)]
pub(super) struct AttachmentHead {
    pub(super) logged_ns: u64,
    pub(super) created_ns: u64,
    pub(super) name: String,
    pub(super) media_type: String,
    /// Where the attached bytes lie in the content of the record.
    pub(super) data: Range<u64>,
}

impl AttachmentHead {
    /// `start` is the beginning of the content of the record, as much as was read of its `length`.
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
