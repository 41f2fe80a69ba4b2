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
pub(super) const CHUNK_HEAD_BYTES: usize = 128;
/// An attachment has its own header within this many bytes.
pub(super) const MOST_ATTACHMENT_HEAD: u64 = 4096;
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
    /// `None` if the file ends before the head does. The record may still reach past the end.
    pub(super) fn read(file: &mut LogFile, start: u64) -> Result<Option<Head>, ScanError> {
        let Some([opcode, length @ ..]) = file.peek::<{ HEAD_BYTES as usize }>(start)? else { return Ok(None) };
        let length = u64::from_le_bytes(length);
        let end = (start + HEAD_BYTES).saturating_add(length);
        Ok(Some(Head { opcode, start, length, end }))
    }

    /// The same record, of another length.
    pub(super) fn until(self, end: u64) -> Head {
        Head { length: end.saturating_sub(self.start + HEAD_BYTES), end, ..self }
    }

    /// Where the record ends by what it holds, if it tells and that is not where its length leads. `None` too if less was
    /// written than it holds.
    pub(super) fn own_end(&self, file: &mut LogFile) -> Result<Option<u64>, ScanError> {
        let content = self.start + HEAD_BYTES;
        let end = match self.opcode {
            op::CHUNK => match ChunkHead::stated(file, self)? {
                Some(Ok(chunk)) => Some((self.start + chunk.data_at).saturating_add(chunk.compressed)),
                _ => None,
            },
            op::ATTACHMENT => {
                let start = file.up_to(content, self.length.min(MOST_ATTACHMENT_HEAD) as usize)?;
                AttachmentHead::parse(start, self.length).map(|head| content + head.data.end + 4)
            }
            opcode => {
                let mut at = content;
                for part in parts_of(opcode) {
                    at += match part {
                        Part::Bytes(count) => *count as u64,
                        Part::Text | Part::TextMap | Part::Offsets => match file.peek::<4>(at)? {
                            Some(length) => 4 + u64::from(u32::from_le_bytes(length)),
                            None => return Ok(None),
                        },
                    };
                }
                Some(at).filter(|&at| at > content)
            }
        };
        Ok(end.filter(|&end| end < self.end))
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
    /// First and last log time of its messages, as it says, ns.
    pub(super) times: (u64, u64),
    /// Offset of the compressed bytes from the start of the record.
    pub(super) data_at: u64,
    pub(super) compressed: u64,
}

impl ChunkHead {
    /// Reads and checks the head; what is wrong is for people.
    pub(super) fn read(file: &mut LogFile, head: &Head) -> Result<Result<ChunkHead, String>, ScanError> {
        let parsed = ChunkHead::stated(file, head)?.ok_or_else(|| "the chunk's own header is cut".to_owned());
        Ok(parsed.and_then(|inner| inner).and_then(|chunk| chunk.fits_in(head)))
    }

    /// The head as it stands there.
    fn stated(file: &mut LogFile, head: &Head) -> Result<Option<Result<ChunkHead, String>>, ScanError> {
        let most = head.length.saturating_add(HEAD_BYTES).min(CHUNK_HEAD_BYTES as u64) as usize;
        Ok(ChunkHead::parse(file.up_to(head.start, most)?))
    }

    fn parse(bytes: &[u8]) -> Option<Result<ChunkHead, String>> {
        let mut rest = Bytes(bytes);
        rest.take(HEAD_BYTES as usize)?;
        let times = (rest.u64()?, rest.u64()?);
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
        Some(Ok(ChunkHead { codec, uncompressed, crc, times, data_at, compressed }))
    }

    /// As the file has it.
    pub(super) fn packed(&self, head: &Head) -> Packed {
        let data_at = head.start + self.data_at;
        Packed {
            fetched: head.start..head.end,
            data: data_at..data_at + self.compressed,
            codec: self.codec,
            declared: self.uncompressed,
            summed: self.crc != 0,
        }
    }

    /// The chunk of the record at `at`, if it is one.
    pub(super) fn look(file: &mut LogFile, at: u64) -> Result<Option<Packed>, ScanError> {
        let Some(head) = Head::read(file, at)?.filter(|head| head.opcode == op::CHUNK && head.end <= file.size())
        else {
            return Ok(None);
        };
        Ok(ChunkHead::read(file, &head)?.ok().map(|chunk| chunk.packed(&head)))
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
