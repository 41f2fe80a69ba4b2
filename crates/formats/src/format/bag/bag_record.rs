//! The records of a ROS 1 bag: a header of `name=value` fields, then data.

use crate::bytes::Bytes;

/// Record types.
const MESSAGE: u8 = 2;
const BAG_HEADER: u8 = 3;
const INDEX: u8 = 4;
const CHUNK: u8 = 5;
const CHUNK_INFO: u8 = 6;
const CONNECTION: u8 = 7;

/// The first line of a bag.
pub(super) const MAGIC: &[u8] = b"#ROSBAG V2.0\n";

/// Records up to this length are read in place, bytes.
pub(super) const LONGEST: usize = 5 << 10;

/// Longest header accepted, bytes.
pub(super) const LONGEST_HEADER: u32 = 4 << 10;

/// The fields of a header. Later fields of the same name are ignored.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fields<'h>(&'h [u8]);

impl<'h> Fields<'h> {
    /// `None` if this is not a list of fields.
    pub(super) fn parse(header: &'h [u8]) -> Option<Fields<'h>> {
        let mut rest = Bytes(header);
        while !rest.0.is_empty() {
            rest.prefixed().filter(|field| field.contains(&b'='))?;
        }
        Some(Fields(header))
    }

    pub(super) fn get(&self, name: &str) -> Option<&'h [u8]> {
        let mut rest = Bytes(self.0);
        while let Some(field) = rest.prefixed() {
            if let Some(value) = field.strip_prefix(name.as_bytes()).and_then(|v| v.strip_prefix(b"=")) {
                return Some(value);
            }
        }
        None
    }

    pub(super) fn u32(&self, name: &str) -> Option<u32> {
        self.get(name).filter(|v| v.len() == 4).and_then(|v| Bytes(v).u32())
    }

    pub(super) fn u64(&self, name: &str) -> Option<u64> {
        self.get(name).filter(|v| v.len() == 8).and_then(|v| Bytes(v).u64())
    }

    pub(super) fn text(&self, name: &str) -> Option<String> {
        self.get(name).map(|v| String::from_utf8_lossy(v).into_owned())
    }

    pub(super) fn time_ns(&self, name: &str) -> Option<i64> {
        self.get(name).and_then(time_ns)
    }
}

/// Seconds and nanoseconds as nanoseconds: 2^32 s fit.
fn time_ns(value: &[u8]) -> Option<i64> {
    let mut parts = Bytes(Some(value).filter(|v| v.len() == 8)?);
    let (seconds, nanos) = (parts.u32()?, parts.u32()?);
    Some(i64::from(seconds) * flight::NANOS_PER_SECOND + i64::from(nanos))
}

/// The kind of a record, with the part of the header that this kind needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind<'h> {
    Message { connection: u32, logged_ns: i64 },
    BagHeader { index_at: u64, chunks: Option<u32>, encryptor: &'h [u8] },
    Index { count: Option<u32> },
    Chunk { compression: &'h [u8], size: u32 },
    ChunkInfo { chunk_at: u64, count: Option<u32> },
    Connection { connection: u32, topic: &'h [u8] },
}

impl<'h> Kind<'h> {
    /// The kind of a message with the three fields that every recorder writes, in any order; `None`: use [`Kind::of`].
    fn usual_message(header: &[u8]) -> Option<Kind<'h>> {
        let (mut is_message, mut connection, mut time) = (false, None, None);
        let mut rest = Bytes(header);
        for _ in 0..3 {
            match *rest.prefixed()? {
                [b'o', b'p', b'=', MESSAGE] => is_message = true,
                [b'c', b'o', b'n', b'n', b'=', a, b, c, d] => connection = Some(u32::from_le_bytes([a, b, c, d])),
                [b't', b'i', b'm', b'e', b'=', ref stamp @ ..] => time = Some(time_ns(stamp)?),
                _ => return None,
            }
        }
        let whole = is_message && rest.0.is_empty();
        whole.then_some(Kind::Message { connection: connection?, logged_ns: time? })
    }

    pub(super) fn of(fields: &Fields<'h>) -> Option<Kind<'h>> {
        let [op] = *fields.get("op")? else { return None };
        Some(match op {
            MESSAGE => Kind::Message { connection: fields.u32("conn")?, logged_ns: fields.time_ns("time")? },
            BAG_HEADER => Kind::BagHeader {
                index_at: fields.u64("index_pos")?,
                chunks: fields.u32("chunk_count"),
                encryptor: fields
                    .get("encryptor")
                    .filter(|plugin| *plugin != b"rosbag/NoEncryptor")
                    .unwrap_or_default(),
            },
            INDEX => fields.u32("conn").map(|_| Kind::Index { count: fields.u32("count") })?,
            CHUNK => Kind::Chunk { compression: fields.get("compression")?, size: fields.u32("size")? },
            CHUNK_INFO => Kind::ChunkInfo { chunk_at: fields.u64("chunk_pos")?, count: fields.u32("count") },
            CONNECTION => Kind::Connection { connection: fields.u32("conn")?, topic: fields.get("topic")? },
            _ => return None,
        })
    }
}

/// A record whose header is intact.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Record<'h> {
    pub(super) kind: Kind<'h>,
    /// Bytes before the data.
    pub(super) head: usize,
    /// Stated length of the data: it may extend past the end.
    data: u32,
}

impl<'h> Record<'h> {
    /// The record at the start of the bytes; `None` if there is none, or its header is truncated.
    #[inline]
    pub(super) fn of(bytes: &'h [u8]) -> Option<Record<'h>> {
        let mut rest = Bytes(bytes);
        let length = rest.u32().filter(|length| *length <= LONGEST_HEADER)? as usize;
        let header = rest.take(length)?;
        let data = rest.u32()?;
        let kind = Kind::usual_message(header).or_else(|| Kind::of(&Fields::parse(header)?))?;
        Some(Record { kind, head: length + 8, data })
    }

    /// Total length in bytes.
    pub(super) fn length(&self) -> u64 {
        self.head as u64 + u64::from(self.data)
    }

    /// Whether its length matches its stated number of entries, of times and offsets or of connections and counts;
    /// `None` if it states no number of entries.
    pub(super) fn fits_its_count(&self) -> Option<bool> {
        let (count, entry) = match self.kind {
            Kind::Index { count } => (count?, 12),
            Kind::ChunkInfo { count, .. } => (count?, 8),
            _ => return None,
        };
        Some(u64::from(count) * entry == u64::from(self.data))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_matched_by_their_full_name() {
        let header = b"\x08\0\0\0oper=abc\x04\0\0\0op=\x02\x08\0\0\0conn=\x01\0\0";
        let fields = Fields::parse(header).unwrap();
        assert_eq!(fields.get("op"), Some(&[2][..]));
        assert_eq!(fields.u32("conn"), None);
        assert_eq!(fields.get("o"), None);
        assert!(Fields::parse(&header[..header.len() - 1]).is_none());
    }

    #[test]
    fn the_fast_path_for_usual_messages_agrees_with_the_general_one() {
        let field = |content: &[u8]| [&(content.len() as u32).to_le_bytes(), content].concat();
        let (op, conn) = (field(b"op=\x02"), field(b"conn=\x07\0\x01\0"));
        let time = field(b"time=\x05\0\0\0\x09\0\0\0");
        let usual =
            [[&op[..], &conn, &time].concat(), [&conn[..], &op, &time].concat(), [&time[..], &conn, &op].concat()];
        for header in &usual {
            let kind = Kind::usual_message(header);
            assert_eq!(kind, Some(Kind::Message { connection: 0x1_0007, logged_ns: 5_000_000_009 }));
            assert_eq!(kind, Fields::parse(header).and_then(|fields| Kind::of(&fields)));
        }
        let other_op = field(b"op=\x04");
        let unusual = [
            [&op[..], &op, &time].concat(),
            [&op[..], &conn, &time, &conn].concat(),
            [&op[..], &conn].concat(),
            [&other_op[..], &conn, &time].concat(),
            [&op[..], &conn, &field(b"time=\x05")].concat(),
        ];
        assert!(unusual.iter().all(|header| Kind::usual_message(header).is_none()));
    }
}
