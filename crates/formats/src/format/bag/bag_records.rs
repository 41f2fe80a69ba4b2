//! The frames of a bag, which are its records, and where their content goes.
//!
//! The header of an uncompressed chunk is treated as a record: the content is records like any other. Only the
//! compressors add checksums, so a record is accepted if it has the fields of its kind and another follows.

use super::bag_record::{Kind, LONGEST, LONGEST_HEADER, MAGIC, Record};
use super::connections::Connections;
use super::index::{Index, IndexReader};
use crate::bytes::Bytes;
use crate::decode::Topics;
use crate::format::inflate::Codec;
use crate::format::unpacker::{Packed, Unpacker};
use crate::format::wrong_start;
use crate::reader::ReadContext;
use flight::{Code, LogHealth, Notices};
use logscan::{Fate, Fetched, Framing, Ledger, LogFile, Parsed, ScanError, Source, Trust, scan};
use std::borrow::Cow;

/// Reported for a file that does not start as a bag does.
pub(super) const WRONG_START: &str = "the first line of the file is wrong";
/// Bytes read together with a compressed chunk, to examine what follows.
const AHEAD: u64 = LONGEST as u64 + 64;
/// The shortest header contains only its type: a length, and `op=` with a byte.
const SHORTEST_HEADER: u32 = 8;
/// The shortest record, bytes: two lengths and a header.
const SHORTEST: usize = 16;
/// Most zero bytes between two records that are accepted as padding.
const MOST_PADDING: usize = 4096;

/// The records of one bag.
pub(super) struct Records<'b, 't, 'c> {
    name: &'b str,
    context: &'b ReadContext<'c>,
    notices: &'b mut Notices,
    connections: Connections<'b, 't>,
    /// `None` within a chunk, where nothing is left to decompress.
    unpacker: Option<Unpacker>,
    /// Some of the file was examined.
    has_begun: bool,
    bag: Bag,
}

/// State of the bag that is being read.
#[derive(Default)]
struct Bag {
    index: Index,
    messages: u64,
    padding: u64,
    /// The previous record is a message: zeros after it may belong to it.
    behind_message: bool,
    /// It has compressed chunks, and no messages outside them.
    is_packed: bool,
    found_any: bool,
}

impl<'b, 't, 'c> Records<'b, 't, 'c> {
    pub(super) fn new(
        name: &'b str,
        file: &LogFile,
        context: &'b ReadContext<'c>,
        topics: &'b mut Topics<'t>,
        notices: &'b mut Notices,
    ) -> Records<'b, 't, 'c> {
        Records {
            name,
            context,
            notices,
            connections: Connections::new(topics),
            unpacker: Some(Unpacker::new(file, context.limits.chunk_bytes)),
            has_begun: false,
            bag: Bag::default(),
        }
    }

    /// Reports oddities of the bag. Returns the number of messages without a connection.
    pub(super) fn finish(self) -> u64 {
        if self.bag.padding > 0 {
            self.notices.push(Code::Skipped, self.name, self.bag.padding, "zero bytes between records");
        }
        self.bag.index.conclude(self.name, self.bag.messages, self.notices);
        self.connections.end(self.name, self.notices)
    }

    fn is_inside(&self) -> bool {
        self.unpacker.is_none()
    }

    /// The first line of a bag.
    fn first_line(&self, bytes: &[u8]) -> Parsed {
        let next = bytes.get(MAGIC.len()..).and_then(Record::of);
        let leads_on = next.is_some_and(|record| matches!(record.kind, Kind::BagHeader { .. }));
        match self.is_inside() {
            true => Parsed::Not(MAGIC.len()),
            false => Parsed::Frame(MAGIC.len(), if leads_on { Trust::Proven } else { Trust::Agrees }),
        }
    }

    /// Data that does not start with a record header: padding between two records, or a truncated header.
    fn no_record(&self, bytes: &[u8]) -> Parsed {
        match Bytes(bytes).u32() {
            None => Parsed::Cut,
            Some(0) => match padding(bytes).filter(|_| !self.bag.behind_message) {
                Some(length) => Parsed::Frame(length, Trust::Proven),
                None => Parsed::Not(4),
            },
            Some(length) if length > LONGEST_HEADER => Parsed::Not(4),
            Some(length) if bytes.len() < length as usize + 8 => Parsed::Cut,
            Some(length) => Parsed::Not(length as usize),
        }
    }

    /// The header of the bag: the index is read first.
    fn begin_bag<S: Source>(
        &mut self,
        source: &mut S,
        index_at: u64,
        chunks: Option<u32>,
    ) -> Result<Fetched, ScanError> {
        let Some(file) = source.file() else { return Ok(Fetched::Refuted("a bag inside a chunk".into())) };
        self.bag.index = match index_at {
            _ if index_at == 0 => Index::None,
            index_at if index_at > file.size() => Index::CutOff,
            index_at => {
                let (connections, most) = (&mut self.connections, self.context.limits.record_bytes);
                let mut reader = IndexReader { file, connections, most, places: vec![] };
                let index = reader.read(index_at, chunks)?;
                if let Some(unpacker) = &mut self.unpacker {
                    unpacker.expect(reader.places, look);
                }
                index
            }
        };
        self.bag.found_any = true;
        Ok(Fetched::Taken(Fate::Structure))
    }

    fn chunk<S: Source>(&mut self, source: &mut S, packed: &Packed) -> Result<Fetched, ScanError> {
        let taken = self.unpacker.take();
        let (Some(mut unpacker), Some(file)) = (taken, source.file()) else {
            return Ok(Fetched::Refuted("a chunk inside a chunk".into()));
        };
        let fetched = self.unpack(&mut unpacker, file, packed);
        self.unpacker = Some(unpacker);
        (self.bag.is_packed, self.bag.behind_message, self.bag.found_any) = (true, false, true);
        fetched
    }

    /// Scans the records in a chunk. The verdict applies to the whole chunk.
    fn unpack(&mut self, unpacker: &mut Unpacker, file: &mut LogFile, packed: &Packed) -> Result<Fetched, ScanError> {
        let length = packed.data.end - packed.data.start;
        if length > self.context.limits.record_bytes {
            return Ok(Fetched::Damaged(format!("a chunk of {length} bytes is larger than the limit").into()));
        }
        unpacker.come_to(packed.fetched.start, file);
        let Some(unpacked) = unpacker.unpack(packed, file)? else {
            return Ok(Fetched::Refuted("the chunk is truncated".into()));
        };
        if let Some(fault) = unpacked.fault {
            return Ok(Fetched::Refuted(format!("the chunk cannot be decompressed: {fault}").into()));
        }
        let (mut chunk, before) = (unpacked.bytes, self.bag.messages);
        let (mut ledger, mut health) = (Ledger::new(chunk.len() as u64, 1), LogHealth::default());
        scan(&mut chunk, &mut ledger, self.context, self)?;
        ledger.finish(&mut health, &mut Notices::new());
        let messages = self.bag.messages - before;
        Ok(match health.damage.first() {
            Some(damage) => {
                let reason = &damage.reason;
                Fetched::Damaged(format!("inside the chunk: {reason}; {messages} of its messages were kept").into())
            }
            None if health.bytes.decoded > 0 => Fetched::Taken(Fate::Decoded),
            None if messages > 0 => Fetched::Taken(Fate::Skipped),
            None => Fetched::Taken(Fate::Structure),
        })
    }
}

impl Framing for Records<'_, '_, '_> {
    const START: &'static [u8] = MAGIC;
    const STATES_ITS_END: bool = true;

    fn longest(&self) -> usize {
        LONGEST
    }

    fn parse(&self, bytes: &[u8]) -> Parsed {
        let Some(record) = Record::of(bytes) else {
            return if bytes.starts_with(MAGIC) { self.first_line(bytes) } else { self.no_record(bytes) };
        };
        let length = record.length();
        let trust = match record.kind {
            Kind::Chunk { .. } if self.is_inside() => return Parsed::Not(record.head),
            Kind::BagHeader { .. } if self.is_inside() || self.bag.found_any => return Parsed::Not(record.head),
            Kind::Chunk { compression, .. } => match codec(compression) {
                Some(Codec::None) => return Parsed::Frame(record.head, Trust::Agrees),
                Some(_) => return Parsed::Long(length, Trust::Agrees),
                None => return Parsed::Not(record.head),
            },
            Kind::BagHeader { .. } => return Parsed::Long(length, Trust::Agrees),
            _ => match record.fits_its_count() {
                Some(true) => Trust::Proven,
                Some(false) => return Parsed::Not(record.head),
                None => Trust::Agrees,
            },
        };
        match usize::try_from(length).ok().filter(|length| *length <= LONGEST) {
            Some(length) if length <= bytes.len() => Parsed::Frame(length, trust),
            Some(_) => Parsed::Cut,
            None => Parsed::Long(length, trust),
        }
    }

    fn begins(&self, bytes: &[u8]) -> bool {
        bytes.len() < SHORTEST || begins_header(bytes) || bytes.starts_with(MAGIC)
    }

    fn candidate(&self, block: &[u8], from: usize) -> Option<usize> {
        let may_be = |bytes: &[u8]| begins_header(bytes) || bytes.starts_with(MAGIC);
        block.get(from..)?.windows(SHORTEST).position(may_be).map(|at| from + at)
    }

    fn is_likely(&self, frame: &[u8]) -> bool {
        match Record::of(frame).map(|record| record.kind) {
            Some(Kind::Message { connection, .. }) => {
                self.connections.knows(connection) && (self.is_inside() || !self.bag.is_packed)
            }
            _ => true,
        }
    }

    fn take(&mut self, frame: &[u8], _: &[u8], _: u64) -> Result<Fate, Cow<'static, str>> {
        self.has_begun = true;
        let Some(record) = Record::of(frame) else {
            if frame.starts_with(MAGIC) && self.bag.found_any {
                return Err("another bag begins in the midst of the file".into());
            }
            self.bag.padding += if frame.starts_with(MAGIC) { 0 } else { frame.len() as u64 };
            return Ok(Fate::Structure);
        };
        let data = frame.get(record.head..).unwrap_or_default();
        (self.bag.found_any, self.bag.behind_message) = (true, matches!(record.kind, Kind::Message { .. }));
        match record.kind {
            Kind::Message { connection, logged_ns } => {
                self.bag.messages += 1;
                Ok(self.connections.message(connection, logged_ns, data))
            }
            Kind::Connection { connection, topic } => {
                self.connections.announce(connection, topic, data)?;
                Ok(Fate::Structure)
            }
            _ => Ok(Fate::Structure),
        }
    }

    fn fetch<S: Source>(&mut self, source: &mut S, at: u64, length: u64) -> Result<Fetched, ScanError> {
        self.has_begun = true;
        let (size, head) = (source.size(), source.up_to(at, LONGEST)?);
        let Some(record) = Record::of(head) else { return Ok(Fetched::Refuted(NO_RECORD.into())) };
        match record.kind {
            Kind::Chunk { .. } => match packed(&record, at, size) {
                Some(packed) => self.chunk(source, &packed),
                None => Ok(Fetched::Refuted(NO_RECORD.into())),
            },
            Kind::BagHeader { index_at, chunks, .. } => self.begin_bag(source, index_at, chunks),
            Kind::Message { connection, logged_ns } if !self.connections.wants(connection) => {
                let payload = length - record.head as u64;
                self.bag.messages += 1;
                (self.bag.found_any, self.bag.behind_message) = (true, true);
                Ok(Fetched::Taken(self.connections.unread(connection, logged_ns, payload)))
            }
            _ if length > self.context.limits.record_bytes => {
                Ok(Fetched::Damaged(format!("a record of {length} bytes is larger than the limit").into()))
            }
            _ => {
                let frame = source.bytes(at, length as usize)?.unwrap_or_default();
                Ok(self.take(frame, &[], at).map_or_else(Fetched::Damaged, Fetched::Taken))
            }
        }
    }

    fn fault(&self, bytes: &[u8]) -> Cow<'static, str> {
        if !self.has_begun {
            return wrong_start(bytes.get(..MAGIC.len() + 1).unwrap_or(bytes), MAGIC, WRONG_START).into();
        }
        match Record::of(bytes) {
            None => NO_RECORD.into(),
            Some(Record { kind: Kind::Chunk { compression, .. }, .. }) if codec(compression).is_none() => {
                format!("unknown compression {:?}", String::from_utf8_lossy(compression)).into()
            }
            Some(record) if record.fits_its_count() == Some(false) => {
                "a record whose length does not fit its count".into()
            }
            Some(_) => "a truncated record, or a record with a wrong length".into(),
        }
    }

    fn breaks(&mut self) {
        self.has_begun = true;
    }
}

/// Reported where no record starts.
const NO_RECORD: &str = "the bytes here are not a record, or a truncated one";

/// Whether a header may start with these bytes: its length, then the length and the name of its first field.
fn begins_header(bytes: &[u8]) -> bool {
    let [a, b, 0, 0, c, d, 0, 0, name @ ..] = bytes else { return false };
    let [length, first] = [[*a, *b], [*c, *d]].map(|two| u32::from(u16::from_le_bytes(two)));
    let is_letter = |byte: &u8| byte.is_ascii_lowercase() || *byte == b'_';
    (SHORTEST_HEADER..=LONGEST_HEADER).contains(&length)
        && (2..=length - 4).contains(&first)
        && name.first().is_some_and(is_letter)
        && name.iter().take(SHORTEST_HEADER as usize).take_while(|byte| **byte != b'=').all(is_letter)
}

/// Number of leading zero bytes, if a record follows them: some tools leave such padding when they rewrite a bag.
fn padding(bytes: &[u8]) -> Option<usize> {
    let zeros = bytes.iter().take(MOST_PADDING).take_while(|b| **b == 0).count();
    // The length of a header is at most 2^12, so it may itself start with one zero byte.
    let ends = |length: &usize| bytes.get(*length..).and_then(Record::of).is_some();
    [zeros, zeros.saturating_sub(1)].into_iter().filter(|length| *length > 0).find(ends)
}

/// The compressed chunk of a record at `at` in a file of `size` bytes.
fn packed(record: &Record<'_>, at: u64, size: u64) -> Option<Packed> {
    let Kind::Chunk { compression, size: declared } = record.kind else { return None };
    let codec = codec(compression).filter(|codec| *codec != Codec::None)?;
    let end = at + record.length();
    let fetched = at..end.saturating_add(AHEAD).min(size);
    Some(Packed { fetched, data: at + record.head as u64..end, codec, declared: u64::from(declared), summed: false })
}

/// The compressed chunk of the record at `at`, if another record follows it. Otherwise it is not a chunk or is
/// truncated, and the scan does not wait for it.
fn look(file: &mut LogFile, at: u64) -> Result<Option<Packed>, ScanError> {
    file.expect_jumps();
    let size = file.size();
    let head = file.up_to(at, LONGEST)?;
    let found = Record::of(head).and_then(|record| packed(&record, at, size)).filter(|packed| packed.data.end <= size);
    let Some(packed) = found else { return Ok(None) };
    let end = packed.data.end;
    let follows = end == size || begins_header(file.up_to(end, SHORTEST)?);
    Ok(follows.then_some(packed))
}

fn codec(compression: &[u8]) -> Option<Codec> {
    match compression {
        b"none" => Some(Codec::None),
        b"lz4" => Some(Codec::Lz4),
        b"bz2" => Some(Codec::Bz2),
        _ => None,
    }
}
