//! The walk over the records of a bag, one after the other, without the index.
//!
//! An uncompressed chunk is walked through in place: its header is just another record. After
//! damage the walk goes on at the next bytes that form a whole header. A bag has no checksums
//! but those of its compressors, so this is all the certainty there is.

use super::MAGIC;
use super::record::{Fields, Kind, LONGEST_HEADER, Record, Source};
use crate::bytes::{Bytes, is_zero};
use crate::decode::Route;
use crate::error::IngestError;
use crate::format::inflate::Codec;
use crate::format::unpacker::{Packed, Unpacker};
use crate::format::wrong_start;
use crate::reader::ReadContext;
use flight::{LogHealth, Notices};
use logscan::LogFile;
use logscan::{FIRST_BLOCK, MOST_IN_VAIN, MOST_ZEROS};
use logscan::{Fate, Ledger};
use memchr::memmem;
use std::ops::Range;

/// Said of a file that does not begin as a bag does.
pub(super) const WRONG_START: &str = "the line that begins the file is wrong";
/// How every header says its type, before the type itself.
const OP_FIELD: &[u8] = b"\x04\0\0\0op=";
/// A header that is searched for begins at most this far before its type.
const LOOK_BACK: u64 = 1024;
/// A header that is searched for, or is cut off by the end of the file, is believed up to this length.
const LONGEST_FOUND_HEADER: u32 = 4096;
/// Zero bytes between two records that are taken for padding.
const MOST_PADDING: u64 = 4096;
/// Bytes fetched together with a record, for a look at the next one.
const MOST_OF_HEADER: u64 = 4 << 10;
/// Bytes searched, or fetched together, in one go.
const BLOCK: u64 = 256 << 10;

/// Who is shown connections and messages.
pub(super) trait Visit {
    /// `data` is the second header, with the definition. What is wrong with it is returned.
    fn connection(&mut self, connection: u32, topic: &str, data: &[u8]) -> Result<(), String>;

    /// Where messages of this connection go; `None` if nothing has announced it.
    fn route(&self, connection: u32) -> Option<Route>;

    /// A message whose payload is wanted.
    fn message(&mut self, route: Route, logged_ns: i64, payload: &[u8]) -> Fate;

    /// One that is not wanted, and whose payload was not read.
    fn unread(&mut self, connection: u32, route: Option<Route>, logged_ns: i64, length: u32) -> Fate;
}

/// A walk in progress, over the file or over a decompressed chunk.
pub(super) struct Walk<'w, 'c, S, V> {
    pub(super) source: S,
    /// File name for the ledger.
    pub(super) name: &'w str,
    pub(super) context: &'w ReadContext<'c>,
    pub(super) ledger: &'w mut Ledger,
    pub(super) visit: &'w mut V,
    /// `None` within a chunk, where there is nothing left to decompress.
    pub(super) unpacker: Option<&'w mut Unpacker>,
    pub(super) at: u64,
    pub(super) messages: u64,
    /// Zero bytes between records.
    pub(super) padding: u64,
    /// Those behind a message, which may have swallowed the beginning of another.
    pub(super) padding_of_messages: u64,
    /// Whether the record before is a message.
    pub(super) behind_message: bool,
    /// The record that was looked at last, mostly the next one.
    pub(super) seen: Option<Record>,
    /// Something of the bag was read.
    pub(super) found_any: bool,
    /// Bytes of headers that are none.
    pub(super) in_vain: u64,
    /// Bytes of chunks that lead over others.
    pub(super) swallowed: u64,
}

impl<S: Source, V: Visit> Walk<'_, '_, S, V> {
    /// Takes the line that begins a bag.
    pub(super) fn begin(&mut self) -> Result<(), IngestError> {
        let end = (self.at + MAGIC.len() as u64).min(self.source.size());
        let intact = self.source.bytes(self.at, MAGIC.len())?.is_some_and(|bytes| bytes == MAGIC);
        if intact {
            self.pass(end, Fate::Structure);
        } else {
            let mut next = self.at + 1;
            while next < end && !self.begins_bag(next)? {
                next += 1;
            }
            let most = (MAGIC.len() as u64 + 1).min(self.source.size().saturating_sub(self.at)) as usize;
            let reason = wrong_start(self.source.bytes(self.at, most)?.unwrap_or_default(), MAGIC, WRONG_START);
            self.damage_to(next.min(end), reason);
        }
        self.found_any = false;
        Ok(())
    }

    /// Chunks that should stand at these places may be decompressed early.
    pub(super) fn expect(&mut self, chunks: Vec<u64>) {
        if let Some(unpacker) = &mut self.unpacker {
            unpacker.expect(chunks, look);
        }
    }

    /// From where the walk stands to the end, or to where another bag begins.
    pub(super) fn run(&mut self) -> Result<(), IngestError> {
        while self.at < self.source.size() {
            let seen = self.seen.take().filter(|record| record.start == self.at);
            let record = if seen.is_some() { seen } else { Record::read(&mut self.source, self.at)? };
            match record {
                Some(record) => {
                    self.take(&record)?;
                    self.behind_message = matches!(record.kind, Kind::Message { .. });
                }
                None if self.begins_bag(self.at)? => break,
                None if self.is_padding()? => {}
                None => self.lost("what stands here is no record, or one that is cut")?,
            }
            self.source.progress(self.at, self.context)?;
        }
        Ok(())
    }

    /// Whether a whole bag begins here, as where files were put one behind another.
    fn begins_bag(&mut self, at: u64) -> Result<bool, IngestError> {
        if self.unpacker.is_none() || self.source.bytes(at, MAGIC.len())? != Some(MAGIC) {
            return Ok(false);
        }
        let header = Record::read(&mut self.source, at + MAGIC.len() as u64)?;
        Ok(header.is_some_and(|record| matches!(record.kind, Kind::BagHeader { .. })))
    }

    /// Steps over zero bytes between records, as some tools leave when they write a bag anew.
    fn is_padding(&mut self) -> Result<bool, IngestError> {
        let Some(next) = self.padding_end(self.at)? else { return Ok(false) };
        match self.behind_message {
            true => self.padding_of_messages += next - self.at,
            false => self.padding += next - self.at,
        }
        self.pass(next, Fate::Structure);
        Ok(true)
    }

    /// Where the zero bytes at `at` end, if a record follows them.
    fn padding_end(&mut self, at: u64) -> Result<Option<u64>, IngestError> {
        let most = MOST_PADDING.min(self.source.size().saturating_sub(at));
        let bytes = self.source.bytes(at, most as usize)?.unwrap_or_default();
        let zeros = bytes.iter().take_while(|&&b| b == 0).count() as u64;
        // The length of a header may begin with zeros of its own: it is at most 2^16, so with two.
        for own in 0..=zeros.min(2) {
            let next = at + zeros - own;
            if next > at && Record::read(&mut self.source, next)?.is_some() {
                return Ok(Some(next));
            }
        }
        Ok(None)
    }

    fn take(&mut self, record: &Record) -> Result<(), IngestError> {
        match &record.kind {
            Kind::Chunk { compression, size } => match codec(compression) {
                Some(Codec::None) => {
                    self.pass(record.data_at, Fate::Structure);
                    Ok(())
                }
                Some(codec) => self.chunk(codec, u64::from(*size), record),
                None => self.lost(&format!("compression {:?} is not known", String::from_utf8_lossy(compression))),
            },
            _ if record.end() > self.source.size() => self.lost("the data end inside a record"),
            _ if !record.fits_its_count() => self.lost("a record whose length does not fit its count"),
            _ => self.plain(record),
        }
    }

    fn plain(&mut self, record: &Record) -> Result<(), IngestError> {
        self.fetch(record, BLOCK)?;
        if !self.may_begin(record.end())? {
            return self.lost("a record whose length leads nowhere");
        }
        if let Some(bag) = self.swallowed(record)? {
            self.damage_to(bag, "a record was cut where another bag begins");
            return Ok(());
        }
        match self.show(record)? {
            Ok(fate) => self.pass(record.end(), fate),
            Err(reason) => self.damage_to(record.end(), &reason),
        }
        Ok(())
    }

    /// Where another bag begins whose first line lies in a record, for its header follows.
    fn swallowed(&mut self, record: &Record) -> Result<Option<u64>, IngestError> {
        let header_follows = self.seen.as_ref().is_some_and(|next| matches!(next.kind, Kind::BagHeader { .. }));
        let bag = record.end().saturating_sub(MAGIC.len() as u64);
        Ok((header_follows && bag > record.start && self.begins_bag(bag)?).then_some(bag))
    }

    /// Fetches a record of up to `most` bytes with what follows, so that the look at the next one does not fetch twice.
    fn fetch(&mut self, record: &Record, most: u64) -> Result<(), IngestError> {
        let together = (record.end() - record.start + MOST_OF_HEADER).min(self.source.size() - record.start);
        if together <= most {
            self.source.bytes(record.start, together as usize)?;
        }
        Ok(())
    }

    fn show(&mut self, record: &Record) -> Result<Result<Fate, String>, IngestError> {
        let length = record.data_length;
        let too_long = u64::from(length) > self.context.limits.record_bytes;
        match &record.kind {
            Kind::Message { connection, logged_ns } => {
                let route = self.visit.route(*connection);
                let Some(wanted) = route.filter(|route| route.is_wanted()) else {
                    self.messages += 1;
                    return Ok(Ok(self.visit.unread(*connection, route, *logged_ns, length)));
                };
                if too_long {
                    return Ok(Err(format!("a message of {length} bytes is larger than the limit")));
                }
                self.messages += 1;
                let payload = self.source.bytes(record.data_at, length as usize)?.unwrap_or_default();
                Ok(Ok(self.visit.message(wanted, *logged_ns, payload)))
            }
            Kind::Connection { connection, topic } if !too_long => {
                let data = self.source.bytes(record.data_at, length as usize)?.unwrap_or_default();
                Ok(self.visit.connection(*connection, topic, data).map(|()| Fate::Structure))
            }
            Kind::Connection { .. } => Ok(Err(format!("a connection of {length} bytes is larger than the limit"))),
            Kind::BagHeader { .. } | Kind::Index { .. } | Kind::ChunkInfo { .. } | Kind::Chunk { .. } => {
                Ok(Ok(Fate::Structure))
            }
        }
    }

    /// A compressed chunk. One that is cut gives what its decoder vouches for.
    fn chunk(&mut self, codec: Codec, size: u64, record: &Record) -> Result<(), IngestError> {
        if let Some((unpacker, file)) = self.unpacker.as_deref_mut().zip(self.source.file()) {
            unpacker.come_to(record.start, file);
        }
        // Before its bytes are read: a wrong length may be a long one.
        let whole = record.end() <= self.source.size() && self.may_begin(record.end())?;
        let mut end = if whole { record.end() } else { self.search(record.data_at)? };
        let mut packed = Packed { data: record.data_at..end, ..packed(record, codec, size, self.source.size()) };
        // A length may be wrong that leads to a record: one far behind, over others.
        let next = if whole { self.swallowed_by_chunk(&packed)? } else { None };
        if let Some(next) = next {
            (end, packed.data.end) = (next, next);
        }
        let Some(unpacker) = self.unpacker.take() else { return self.lost("a chunk inside a chunk") };
        let fate = self.decompressed(unpacker, &packed, whole && next.is_none());
        self.unpacker = Some(unpacker);
        match (fate?, next) {
            (Ok(fate), None) => self.pass(end, fate),
            (Ok(_), Some(_)) => self.damage_to(end, "the length of the chunk leads over other records; it was kept"),
            (Err(reason), _) => self.damage_to(end, &reason),
        }
        Ok(())
    }

    /// Where the next chunk or index begins within one that cannot be decompressed.
    fn swallowed_by_chunk(&mut self, packed: &Packed) -> Result<Option<u64>, IngestError> {
        let Range { start, end } = packed.data;
        // Where many chunks lead to one end, each is not read as far as there.
        let is_read =
            end - start <= self.context.limits.record_bytes && self.swallowed / MOST_IN_VAIN <= self.source.size();
        if is_read {
            let Some((unpacker, file)) = self.unpacker.as_deref_mut().zip(self.source.file()) else { return Ok(None) };
            if unpacker.unpack(packed, file)?.is_none_or(|unpacked| unpacked.fault.is_none()) {
                return Ok(None);
            }
            self.swallowed += end - start;
        }
        let of_chunks = |kind: &Kind| matches!(kind, Kind::Chunk { .. } | Kind::Index { .. });
        Ok(Some(self.search_for(start..end, of_chunks)?).filter(|&next| next < end))
    }

    fn decompressed(
        &mut self,
        unpacker: &mut Unpacker,
        packed: &Packed,
        whole: bool,
    ) -> Result<Result<Fate, String>, IngestError> {
        let length = packed.data.end - packed.data.start;
        if length > self.context.limits.record_bytes {
            return Ok(Err(format!("a chunk of {length} bytes is larger than the limit")));
        }
        let Some(file) = self.source.file() else { return Ok(Err("a chunk inside a chunk".to_owned())) };
        let Some(unpacked) = unpacker.unpack(packed, file)? else { return Ok(Err("the chunk is cut".to_owned())) };
        match unpacked.fault {
            Some(fault) if whole => Ok(Err(format!("the chunk cannot be decompressed: {fault}"))),
            fault => {
                let fault = fault.map(|_| "the chunk is cut".to_owned());
                let (verdict, messages) = inside(unpacked.bytes, fault, self.name, self.context, self.visit)?;
                self.messages += messages;
                Ok(verdict)
            }
        }
    }

    fn pass(&mut self, end: u64, fate: Fate) {
        self.ledger.count(fate, end - self.at);
        self.at = end;
        self.found_any = true;
    }

    fn damage_to(&mut self, end: u64, reason: &str) {
        if end > self.at {
            self.ledger.damaged(self.name, self.at, end - self.at, reason);
            self.at = end;
        }
    }

    /// Nothing can be made of what stands here: goes on where the next record begins.
    fn lost(&mut self, reason: &str) -> Result<(), IngestError> {
        let next = self.search(self.at + 1)?;
        self.damage_to(next, reason);
        Ok(())
    }

    /// The next whole header, or where another bag begins; the end if there is neither.
    pub(super) fn search(&mut self, from: u64) -> Result<u64, IngestError> {
        self.search_for(from..self.source.size(), |_| true)
    }

    /// As [`Walk::search`], of such a kind and within `range`.
    fn search_for(&mut self, range: Range<u64>, is_wanted: fn(&Kind) -> bool) -> Result<u64, IngestError> {
        let Range { start: from, end: size } = range;
        let mut at = from;
        let mut zeros = 0;
        let mut most = FIRST_BLOCK as u64;
        while at < size && zeros <= MOST_ZEROS {
            let length = most.min(size - at);
            let front = from.max(at.saturating_sub(LOOK_BACK));
            let block = self.source.bytes(front, (at - front + length) as usize)?.unwrap_or_default();
            let fresh = block.get((at - front) as usize..).unwrap_or_default();
            zeros = if is_zero(fresh) { zeros + length } else { 0 };
            let bags: Vec<u64> = memmem::find_iter(fresh, MAGIC).map(|bag| at + bag as u64).collect();
            let hits: Vec<u64> = memmem::find_iter(fresh, OP_FIELD).map(|hit| at + hit as u64).collect();
            let mut headers = if hits.is_empty() { vec![] } else { possible_headers(block, front) };
            let mut bag = None;
            for place in bags {
                bag = if bag.is_none() && self.begins_bag(place)? { Some(place) } else { bag };
            }
            for hit in hits.into_iter().filter(|&hit| bag.is_none_or(|bag| hit < bag)) {
                if let Some(found) = self.header_around(hit, &mut headers, is_wanted)? {
                    return Ok(found);
                }
            }
            if let Some(bag) = bag {
                return Ok(bag);
            }
            // What straddles two blocks is found in the second.
            at += if length == most { most - MAGIC.len() as u64 } else { length };
            most = BLOCK.min(2 * most);
            self.source.progress(at, self.context)?;
        }
        Ok(size)
    }

    /// The record whose header, one of these, says its type at `hit`. Those that are none are shortened to nothing.
    fn header_around(
        &mut self,
        hit: u64,
        headers: &mut [Range<u64>],
        is_wanted: fn(&Kind) -> bool,
    ) -> Result<Option<u64>, IngestError> {
        let behind = hit + OP_FIELD.len() as u64 + 1;
        let first = headers.partition_point(|header| header.start + LOOK_BACK < hit);
        let near = headers.get_mut(first..).unwrap_or_default().iter_mut().take_while(|header| header.start < hit);
        for header in near.filter(|header| header.end >= behind) {
            if let Some(record) = Record::read(&mut self.source, header.start)?
                && is_wanted(&record.kind)
                && self.is_plain(&record)?
            {
                return Ok(Some(header.start));
            }
            header.end = header.start;
        }
        Ok(None)
    }

    /// Whether a record that was searched for is one beyond doubt.
    fn is_plain(&mut self, record: &Record) -> Result<bool, IngestError> {
        match &record.kind {
            Kind::Chunk { compression, .. } => return Ok(codec(compression).is_some() && self.unpacker.is_some()),
            Kind::Message { connection, .. } if self.visit.route(*connection).is_none() => return Ok(false),
            Kind::BagHeader { .. } => return Ok(false),
            Kind::Message { .. } | Kind::Index { .. } | Kind::ChunkInfo { .. } | Kind::Connection { .. } => {}
        }
        Ok(record.end() <= self.source.size() && record.fits_its_count() && self.may_begin(record.end())?)
    }

    /// Whether a record, or the end, may be here. A header that is cut off by the end may be.
    fn may_begin(&mut self, at: u64) -> Result<bool, IngestError> {
        let Some(length) = self.source.bytes(at, 4)?.and_then(|b| Bytes(b).u32()) else { return Ok(true) };
        if length == 0 {
            return Ok(self.padding_end(at)?.is_some());
        }
        // Records without end may all lead to the same long header.
        let patient = self.in_vain / MOST_IN_VAIN <= self.source.size();
        if length > if patient { LONGEST_HEADER } else { LOOK_BACK as u32 } {
            return self.begins_bag(at);
        }
        if let Some(bytes) = self.source.bytes(at + 4, length as usize + 4)? {
            self.seen = Record::parse(bytes, at, length);
            self.in_vain += if self.seen.is_some() { 0 } else { u64::from(length) };
            return Ok(self.seen.is_some());
        }
        match self.source.bytes(at + 4, length as usize)? {
            Some(header) => Ok(Fields::parse(header).and_then(|fields| Kind::of(&fields)).is_some()),
            None => Ok(length <= LONGEST_FOUND_HEADER),
        }
    }
}

/// A compressed chunk as its record has it, in a file of `size` bytes.
fn packed(record: &Record, codec: Codec, declared: u64, size: u64) -> Packed {
    let together = record.end().saturating_add(MOST_OF_HEADER).min(size);
    Packed { fetched: record.start..together, data: record.data_at..record.end(), codec, declared, summed: false }
}

/// The compressed chunk of the record at `at`, if it is one and another record follows: what leads nowhere is no chunk, or
/// one that is cut, and the walk is not to wait for it.
fn look(file: &mut LogFile, at: u64) -> Result<Option<Packed>, IngestError> {
    file.expect_jumps();
    let size = file.size();
    let mut source = file;
    let Some(record) = Record::read(&mut source, at)?.filter(|record| record.end() <= size) else { return Ok(None) };
    let Kind::Chunk { compression, size: declared } = &record.kind else { return Ok(None) };
    let Some(codec) = codec(compression).filter(|codec| *codec != Codec::None) else { return Ok(None) };
    let follows = record.end() == size || Record::read(&mut source, record.end())?.is_some();
    Ok(follows.then(|| packed(&record, codec, u64::from(*declared), size)))
}

/// Where a header that says its type may stand, by its length and that of its first field, in the order of their beginnings.
fn possible_headers(block: &[u8], start: u64) -> Vec<Range<u64>> {
    let shortest = OP_FIELD.len() as u32 + 1;
    let header = |(place, window): (usize, &[u8])| {
        let mut lengths = Bytes(window);
        let (length, first) = (lengths.u32()?, lengths.u32()?);
        let fits = (shortest..=LONGEST_FOUND_HEADER).contains(&length) && first <= length - 4;
        let from = start + place as u64;
        fits.then(|| from..from + 4 + u64::from(length))
    };
    block.windows(8).enumerate().filter_map(header).collect()
}

/// Walks through what was a chunk. The verdict is on the whole chunk; with it the number of messages in it.
fn inside<V: Visit>(
    chunk: &[u8],
    fault: Option<String>,
    name: &str,
    context: &ReadContext<'_>,
    visit: &mut V,
) -> Result<(Result<Fate, String>, u64), IngestError> {
    let mut ledger = Ledger::new(chunk.len() as u64, 1);
    let mut inner = Walk {
        source: chunk,
        name,
        context,
        ledger: &mut ledger,
        visit,
        unpacker: None,
        at: 0,
        messages: 0,
        padding: 0,
        padding_of_messages: 0,
        behind_message: false,
        seen: None,
        found_any: false,
        in_vain: 0,
        swallowed: 0,
    };
    inner.run()?;
    let messages = inner.messages;
    let mut health = LogHealth::default();
    ledger.finish(&mut health, &mut Notices::new());
    let reason = fault.or_else(|| health.damage.first().map(|d| format!("inside the chunk: {}", d.reason)));
    let verdict = match reason {
        Some(reason) => Err(format!("{reason}; {messages} of its messages were kept")),
        None if health.bytes.decoded > 0 => Ok(Fate::Decoded),
        None if messages > 0 => Ok(Fate::Skipped),
        None => Ok(Fate::Structure),
    };
    Ok((verdict, messages))
}

fn codec(compression: &[u8]) -> Option<Codec> {
    match compression {
        b"none" => Some(Codec::None),
        b"lz4" => Some(Codec::Lz4),
        b"bz2" => Some(Codec::Bz2),
        _ => None,
    }
}
