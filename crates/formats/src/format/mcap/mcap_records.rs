//! The frames of an MCAP file, which are its records, and where their content goes.
//!
//! Every checksum is checked before the data under it are used. After damage in a chunked file, only whole chunks are
//! accepted, never the messages inside a broken one: nothing vouches for them.

use super::Channels;
use super::mcap_record::{
    AttachmentHead, ChunkHead, HEAD_BYTES, Head, LONGEST, MAGIC, WRONG_START, is_defined, is_private, name,
};
use super::summary::{self, Summary};
use crate::bytes::Bytes;
use crate::decode::Tally;
use crate::format::unpacker::Unpacker;
use crate::format::wrong_start;
use crate::reader::ReadContext;
use flight::{Code, Notices, Severity};
use logscan::{Fate, Fetched, Framing, LogFile, Parsed, ScanError, Source, Trust};
use mcap::records::op;
use std::borrow::Cow;

/// How much of an attachment is passed on when it is not wanted; the content is checksummed but not kept.
const ATTACHMENT_SHOWN: u64 = 1 << 20;
/// Bytes checksummed in one go.
const BLOCK: usize = 256 << 10;
/// Maximum length of a definition found by searching.
const LONGEST_FOUND: u64 = 1 << 20;
/// Reported for a chunk that is not complete in the file.
const CUT: &str = "a truncated chunk";

/// The records of one file.
pub(super) struct Records<'b, 'c, 't, 'w> {
    name: String,
    context: &'b ReadContext<'c>,
    notices: &'b mut Notices,
    channels: &'b mut Channels<'t, 'w>,
    unpacker: Unpacker,
    /// Some of the file was examined.
    has_begun: bool,
    log: State,
}

/// State of the log that is being read.
#[derive(Default)]
struct State {
    summary: Summary,
    /// Over the data section; `None` if that is known to have no checksum.
    data_crc: Option<crc32fast::Hasher>,
    chunks_seen: bool,
    /// Outside of chunks.
    channels_seen: bool,
    data_ended: bool,
    footer_seen: bool,
    /// The magic after its footer was found.
    has_end: bool,
    /// Some of it was present, and not only damage.
    found_any: bool,
    damaged: bool,
    unknown: Tally,
    /// Of types reserved for applications.
    private: Tally,
    without_crc: u64,
    not_opened: u64,
    /// The last chunk was skipped.
    is_closed: bool,
}

impl<'b, 'c, 't, 'w> Records<'b, 'c, 't, 'w> {
    /// For a file with this summary at its end.
    pub(super) fn new(
        file: &mut LogFile,
        context: &'b ReadContext<'c>,
        notices: &'b mut Notices,
        channels: &'b mut Channels<'t, 'w>,
        summary: Summary,
    ) -> Records<'b, 'c, 't, 'w> {
        let mut unpacker = Unpacker::new(file, context.limits.chunk_bytes);
        let opened = summary.chunks.iter().filter(|chunk| chunk.wanted).map(|chunk| chunk.offset).collect();
        unpacker.expect(opened, ChunkHead::look);
        // If the data section is known to have no checksum, skipped chunks need not even be read.
        if summary.data_crc == Some(0) && summary.chunks.iter().any(|chunk| !chunk.wanted) {
            file.expect_jumps();
        }
        let data_crc = (summary.data_crc != Some(0)).then(crc32fast::Hasher::new);
        let log = State { summary, data_crc, ..State::default() };
        Records { name: file.name().to_owned(), context, notices, channels, unpacker, has_begun: false, log }
    }

    /// Reports oddities of the log.
    pub(super) fn finish(self) {
        self.log.conclude(&self.name, self.notices);
        self.channels.conclude(&self.name, &self.log.summary, self.notices);
    }

    fn begins_log(bytes: &[u8]) -> bool {
        let head = bytes.strip_prefix(MAGIC).and_then(|rest| Head::of(rest, 0));
        head.is_some_and(|head| head.opcode == op::HEADER && head.length <= LONGEST_FOUND)
    }

    /// The eight bytes at both ends of a log.
    fn magic(&self, bytes: &[u8]) -> Parsed {
        match self.log.footer_seen {
            true if self.log.has_end => Parsed::Not(MAGIC.len()),
            true => Parsed::Frame(MAGIC.len(), Trust::Proven),
            false if Self::begins_log(bytes) => Parsed::Long(MAGIC.len() as u64, Trust::Proven),
            false if !self.has_begun => Parsed::Long(MAGIC.len() as u64, Trust::Agrees),
            false => Parsed::Not(MAGIC.len()),
        }
    }

    /// How strongly a record of a type proves itself; `None` for an invalid type.
    fn trust(&self, head: &Head, bytes: &[u8]) -> Option<Trust> {
        let body = bytes.get(HEAD_BYTES as usize..).unwrap_or_default();
        let agrees = match head.opcode {
            // Two lengths of eight bytes.
            op::CHUNK => return ChunkHead::of(bytes, head).is_ok().then_some(Trust::Proven),
            op::ATTACHMENT => {
                let attachment = AttachmentHead::parse(body, head.length)?;
                return (!Head::is_too_long(head.length - attachment.data.end - 4)).then_some(Trust::Proven);
            }
            op::MESSAGE => {
                let knows = Bytes(body).u16().is_some_and(|channel| self.channels.knows(channel));
                return (head.length >= super::MESSAGE_HEAD_BYTES as u64).then_some(if knows {
                    Trust::Agrees
                } else {
                    Trust::Weak
                });
            }
            op::FOOTER => {
                let next = bytes.get(head.end as usize..).unwrap_or_default();
                let is_last = next.len() <= MAGIC.len() || next.starts_with(MAGIC);
                return (head.fits_its_type() && is_last).then_some(Trust::Proven);
            }
            opcode if is_defined(opcode) => head.fits_its_type() && head.fits_its_content(body),
            _ => ChunkHead::of(bytes, head).is_err(),
        };
        // After the header, a stopped recorder leaves a single chunk whose length it never wrote.
        let trust = if head.opcode == op::HEADER { Trust::Proven } else { Trust::Agrees };
        agrees.then_some(trust)
    }

    /// Whether to resync after damage at a record of this type: data outside chunks, in a log without chunks.
    fn is_searched(&self, opcode: u8) -> bool {
        let log = &self.log;
        let has_chunks = log.chunks_seen || log.summary.has_chunks;
        let is_loose = !has_chunks && (log.channels_seen || log.summary.trust == summary::Trust::Good);
        match opcode {
            _ if log.footer_seen => false,
            op::HEADER => !self.has_begun,
            op::CHUNK | op::MESSAGE_INDEX | op::METADATA | op::ATTACHMENT | op::DATA_END | op::FOOTER => true,
            op::MESSAGE => is_loose,
            op::SCHEMA | op::CHANNEL => is_loose || log.data_ended,
            op::CHUNK_INDEX | op::ATTACHMENT_INDEX | op::STATISTICS | op::METADATA_INDEX | op::SUMMARY_OFFSET => {
                log.data_ended
            }
            _ => false,
        }
    }

    fn plain(&mut self, opcode: u8, body: &[u8], at: u64) -> Result<Fate, String> {
        self.log.channels_seen |= opcode == op::CHANNEL && !self.log.data_ended;
        match opcode {
            op::DATA_END => {
                self.log.data_ended = true;
                self.check_data(Bytes(body).u32().unwrap_or_default(), at);
            }
            op::FOOTER => self.log.footer_seen = true,
            op::MESSAGE_INDEX if self.log.is_closed => return self.channels.index_of_skipped(body),
            _ => {}
        }
        self.channels.record(opcode, body)
    }

    /// A record of unknown type comes from a later version or an application.
    fn undefined(&mut self, opcode: u8, at: u64) -> Fate {
        let place = format!("{} at byte {at}", name(opcode));
        let tally = if is_private(opcode) { &mut self.log.private } else { &mut self.log.unknown };
        tally.add(|| place);
        Fate::Structure
    }

    /// Compares the checksum of the data section, which ends at `end`.
    fn check_data(&mut self, stated: u32, end: u64) {
        let log = &mut self.log;
        let Some(hasher) = log.data_crc.take() else { return };
        if stated != 0 && !log.damaged && hasher.finalize() != stated {
            let place = format!("{}, bytes 0 to {end}", self.name);
            let text = "the checksum of the data section is wrong: some of its bytes are damaged";
            self.notices.push(Code::Corrupt, place, end, text);
        }
    }

    fn chunk(&mut self, file: &mut LogFile, head: &Head, chunk: &ChunkHead) -> Result<Fetched, ScanError> {
        self.log.chunks_seen = true;
        self.log.is_closed = self.can_leave_closed(file, head)?;
        if self.log.is_closed {
            self.log.not_opened += 1;
            return Ok(Fetched::Taken(Fate::Skipped));
        }
        let limit = self.context.limits.record_bytes;
        if head.length > limit {
            let reason = format!("a chunk of {} bytes is larger than the limit of {limit}", head.length);
            return Ok(Fetched::Damaged(reason.into()));
        }
        self.unpacker.come_to(head.start, file);
        file.bytes(head.start, (head.end - head.start) as usize)?;
        let Some(unpacked) = self.unpacker.unpack(&chunk.packed(head, file.size()), file)? else {
            return Ok(Fetched::Refuted(CUT.into()));
        };
        let wrong_sum = chunk.crc != 0 && unpacked.crc != chunk.crc;
        let fault: Option<Cow<'static, str>> = unpacked.fault.map(Cow::from);
        if let Some(fault) = fault.or(wrong_sum.then_some("the checksum of the chunk is wrong".into())) {
            let follows = self.begins(file.up_to(head.end, MAGIC.len() + HEAD_BYTES as usize)?);
            return Ok(if follows { Fetched::Damaged(fault) } else { Fetched::Refuted(fault) });
        }
        self.log.without_crc += u64::from(chunk.crc == 0);
        let verdict = contents(unpacked.bytes, self.channels, &mut self.log.unknown);
        if leads_over_records(file, head.start + chunk.data_at + chunk.compressed, head)? {
            return Ok(Fetched::Damaged("a chunk whose length reaches over other records; it was kept".into()));
        }
        Ok(verdict.map_or_else(|reason| Fetched::Damaged(reason.into()), Fetched::Taken))
    }

    /// Whether the summary, with a valid checksum, says that this chunk holds nothing wanted, and the message indexes
    /// after it agree.
    fn can_leave_closed(&mut self, file: &mut LogFile, head: &Head) -> Result<bool, ScanError> {
        let length = head.end - head.start;
        let known = self.log.summary.chunk_at(head.start).is_some_and(|c| !c.wanted && c.length == length);
        if !known || !self.context.limits.may_leave_closed {
            return Ok(false);
        }
        let mut at = head.end;
        while let Some(index) = Head::read(file, at)?.filter(|head| head.opcode == op::MESSAGE_INDEX) {
            let channel = file.peek::<2>(index.start + HEAD_BYTES)?.map(u16::from_le_bytes);
            if channel.is_some_and(|channel| self.channels.may_want(channel)) {
                return Ok(false);
            }
            at = index.end;
        }
        Ok(true)
    }

    fn attachment<S: Source>(&mut self, source: &mut S, head: &Head) -> Result<Fetched, ScanError> {
        let start = head.start + HEAD_BYTES;
        let parsed = AttachmentHead::parse(source.up_to(start, LONGEST)?, head.length);
        let Some(attachment) = parsed else { return Ok(Fetched::Refuted(BAD_ATTACHMENT.into())) };
        let crc_at = start + attachment.data.end;
        let stated = source.bytes(crc_at, 4)?.and_then(|b| Bytes(b).u32()).unwrap_or_default();
        if stated != 0 {
            let mut hasher = crc32fast::Hasher::new();
            self.sum(source, start, crc_at, &mut hasher)?;
            if hasher.finalize() != stated {
                let reason = format!("the checksum of the attachment {:.200} is wrong", attachment.name);
                return Ok(Fetched::Damaged(reason.into()));
            }
        }
        if leads_over_records(source, crc_at + 4, head)? {
            return Ok(Fetched::Damaged("an attachment whose length reaches over other records".into()));
        }
        let whole = self.channels.takes_attachments() && head.length <= self.context.limits.record_bytes;
        let shown = if whole { head.length } else { head.length.min(ATTACHMENT_SHOWN) };
        let body = source.bytes(start, shown as usize)?.unwrap_or_default();
        Ok(fetched(self.channels.record(head.opcode, body)))
    }

    fn sum<S: Source>(
        &self,
        source: &mut S,
        from: u64,
        to: u64,
        hasher: &mut crc32fast::Hasher,
    ) -> Result<(), ScanError> {
        let mut at = from;
        while at < to {
            let block = source.up_to(at, BLOCK.min((to - at) as usize))?;
            hasher.update(block);
            at += block.len().max(1) as u64;
            source.progress(at, self.context)?;
        }
        Ok(())
    }

    /// As [`Framing::fetch`], for anything but the magic, without the checksum of the data section.
    fn record<S: Source>(&mut self, source: &mut S, head: &Head, start: &[u8]) -> Result<Fetched, ScanError> {
        let limit = self.context.limits.record_bytes;
        match head.opcode {
            op::CHUNK => match (ChunkHead::of(start, head), source.file()) {
                (Ok(chunk), Some(file)) => self.chunk(file, head, &chunk),
                _ => Ok(Fetched::Refuted(CUT.into())),
            },
            op::ATTACHMENT => self.attachment(source, head),
            opcode if !is_defined(opcode) => Ok(Fetched::Taken(self.undefined(opcode, head.start))),
            // For an opened chunk, its entries add nothing.
            op::MESSAGE_INDEX if !self.log.is_closed => Ok(Fetched::Taken(Fate::Structure)),
            opcode if head.length > limit => {
                let reason = format!("a {} of {} bytes is larger than the limit of {limit}", name(opcode), head.length);
                Ok(Fetched::Damaged(reason.into()))
            }
            opcode => {
                let body = source.bytes(head.start + HEAD_BYTES, head.length as usize)?.unwrap_or_default();
                Ok(fetched(self.plain(opcode, body, head.start)))
            }
        }
    }
}

/// Reported for an attachment that does not fit its record.
const BAD_ATTACHMENT: &str = "the header of the attachment is damaged";

/// Whether the content of a record ends at `end`, and other records follow up to its stated length.
fn leads_over_records<S: Source>(source: &mut S, end: u64, head: &Head) -> Result<bool, ScanError> {
    let added = source.up_to(end, head.end.saturating_sub(end) as usize)?;
    Ok(Head::are_records(added))
}

fn fetched(verdict: Result<Fate, String>) -> Fetched {
    verdict.map_or_else(|reason| Fetched::Damaged(reason.into()), Fetched::Taken)
}

impl Framing for Records<'_, '_, '_, '_> {
    const START: &'static [u8] = MAGIC;
    const STATES_ITS_END: bool = true;

    fn longest(&self) -> usize {
        LONGEST
    }

    #[inline]
    fn parse(&self, bytes: &[u8]) -> Parsed {
        if bytes.starts_with(MAGIC) {
            return self.magic(bytes);
        }
        if self.log.footer_seen {
            return Parsed::Not(1);
        }
        let Some(head) = Head::of(bytes, 0) else { return Parsed::Cut };
        let Some(trust) = Some(&head).filter(|head| head.may_be()).and_then(|head| self.trust(head, bytes)) else {
            return Parsed::Not(HEAD_BYTES as usize);
        };
        let is_fetched = matches!(head.opcode, op::CHUNK | op::ATTACHMENT);
        match usize::try_from(head.end).ok().filter(|end| !is_fetched && *end <= LONGEST) {
            Some(end) if end <= bytes.len() => Parsed::Frame(end, trust),
            Some(_) => Parsed::Cut,
            None => Parsed::Long(head.end, trust),
        }
    }

    #[inline]
    fn begins(&self, bytes: &[u8]) -> bool {
        match Head::of(bytes, 0) {
            _ if bytes.starts_with(MAGIC) => true,
            _ if self.log.footer_seen => false,
            Some(head) => head.may_be() && head.fits_its_type(),
            // The file ends inside the head.
            None => bytes.first().is_none_or(|opcode| is_defined(*opcode) || is_private(*opcode)),
        }
    }

    fn candidate(&self, block: &[u8], from: usize) -> Option<usize> {
        if self.log.has_end {
            return None;
        }
        let searched = (0..=op::DATA_END).filter(|opcode| self.is_searched(*opcode));
        let searched = searched.fold(0_u32, |bits, opcode| bits | 1 << opcode);
        // A length below 2^40.
        let may_be = |w: &[u8]| match w {
            [opcode, _, _, _, _, _, 0, 0, 0] if is_defined(*opcode) => searched >> *opcode & 1 == 1,
            window => window.starts_with(MAGIC),
        };
        block.get(from..)?.windows(HEAD_BYTES as usize).position(may_be).map(|at| from + at)
    }

    fn is_likely(&self, frame: &[u8]) -> bool {
        Head::of(frame, 0).is_some_and(|head| match head.opcode {
            op::CHUNK | op::ATTACHMENT | op::MESSAGE => true,
            _ => head.length <= LONGEST_FOUND,
        })
    }

    #[inline]
    fn take(&mut self, frame: &[u8], _: &[u8], at: u64) -> Result<Fate, Cow<'static, str>> {
        if frame == MAGIC {
            self.log.has_end = true;
            return Ok(Fate::Structure);
        }
        (self.has_begun, self.log.found_any) = (true, true);
        let opcode = frame.first().copied().unwrap_or_default();
        let body = frame.get(HEAD_BYTES as usize..).unwrap_or_default();
        if let Some(hasher) = self.log.data_crc.as_mut().filter(|_| opcode != op::DATA_END) {
            hasher.update(frame);
        }
        let verdict = if is_defined(opcode) { self.plain(opcode, body, at) } else { Ok(self.undefined(opcode, at)) };
        self.log.damaged |= verdict.is_err();
        verdict.map_err(Cow::from)
    }

    fn fetch<S: Source>(&mut self, source: &mut S, at: u64, length: u64) -> Result<Fetched, ScanError> {
        self.has_begun = true;
        let mut start = [0; LONGEST];
        let held = source.up_to(at, LONGEST)?;
        let start = start.get_mut(..held.len()).unwrap_or_default();
        start.copy_from_slice(held);
        let start: &[u8] = start;
        if start.starts_with(MAGIC) {
            if self.log.found_any {
                self.log.damaged = true;
                return Ok(Fetched::Damaged("another log begins in the midst of the file".into()));
            }
            if let Some(hasher) = &mut self.log.data_crc {
                hasher.update(MAGIC);
            }
            return Ok(Fetched::Taken(Fate::Structure));
        }
        self.log.found_any = true;
        let Some(head) = Head::of(start, at).filter(|head| head.end - at == length) else {
            return Ok(Fetched::Refuted(NO_RECORD.into()));
        };
        let fetched = self.record(source, &head, start)?;
        match (self.log.data_crc.take(), &fetched) {
            (Some(mut hasher), Fetched::Taken(_)) => {
                self.sum(source, at, head.end, &mut hasher)?;
                self.log.data_crc = Some(hasher);
            }
            (hasher, _) => self.log.data_crc = hasher,
        }
        self.log.damaged |= !matches!(fetched, Fetched::Taken(_));
        Ok(fetched)
    }

    fn fault(&self, bytes: &[u8]) -> Cow<'static, str> {
        let log = &self.log;
        if !self.has_begun {
            return wrong_start(bytes.get(..MAGIC.len() + 1).unwrap_or(bytes), MAGIC, WRONG_START).into();
        }
        match Head::of(bytes, 0) {
            _ if log.has_end => "bytes after the end of the log".into(),
            _ if log.footer_seen => "the last eight bytes of the file are missing".into(),
            None => "the file ends inside the header of a record".into(),
            Some(head) if head.opcode == 0 || !head.fits_its_type() => NO_RECORD.into(),
            Some(head) => match (head.opcode, ChunkHead::of(bytes, &head)) {
                (op::CHUNK, _) if !head.may_be() => CUT.into(),
                (op::CHUNK, Err(reason)) => reason.into(),
                (opcode, Ok(_)) if !is_defined(opcode) => "a chunk with a damaged type byte".into(),
                (opcode, _) => format!("a {} that is truncated or has a wrong length", name(opcode)).into(),
            },
        }
    }

    fn breaks(&mut self) {
        (self.has_begun, self.log.damaged) = (true, true);
    }
}

/// Reported where no record starts.
const NO_RECORD: &str = "the bytes here are not a record";

impl State {
    fn conclude(&self, file: &str, notices: &mut Notices) {
        if !self.footer_seen {
            let text = "the file has no footer: it is truncated, or the recorder was stopped before it closed the \
                file";
            notices.push(Code::IncompleteRecording, file, 1, text);
        } else if !self.data_ended && !self.damaged {
            let text = "the record that ends the data is missing: another record covers it, or it was never written";
            notices.push(Code::IncompleteRecording.at(Severity::Warning), file, 1, text);
        } else if !self.has_end && !self.damaged {
            notices.push(Code::IncompleteRecording, file, 1, "the file is truncated directly after its footer");
        }
        if self.summary.trust == summary::Trust::Bad {
            let text = "the summary at the end does not match its checksum; it was not used";
            notices.push(Code::Corrupt, file, 1, text);
        }
        self.unknown.report(Code::UnknownRecord, file, "records of unknown types were skipped", notices);
        let text = "records of private types of an application were skipped";
        self.private.report(Code::UnknownRecord.at(Severity::Info), file, text, notices);
        if self.without_crc > 0 {
            let text = "chunks have no checksum: their content cannot be verified";
            notices.push(Code::NoChecksum.at(Severity::Info), file, self.without_crc, text);
        }
        let text = "chunks without a wanted topic were not decompressed; their messages are counted from the index, \
            which states neither sizes nor publish times";
        if self.not_opened > 0 {
            notices.push(Code::Skipped, file, self.not_opened, text);
        }
    }
}

/// Passes on the records inside a chunk. The fate is that of the whole chunk.
fn contents(data: &[u8], channels: &mut Channels<'_, '_>, unknown: &mut Tally) -> Result<Fate, String> {
    let mut rest = Bytes(data);
    let mut fate = Fate::Structure;
    let mut bad = Tally::default();
    while !rest.0.is_empty() {
        let (Some(opcode), Some(length)) = (rest.u8(), rest.u64()) else {
            return Err("the chunk ends inside the header of a record; the records before it were kept".to_owned());
        };
        let Some(body) = usize::try_from(length).ok().and_then(|length| rest.take(length)) else {
            return Err("a record reaches beyond the end of its chunk; the records before it were kept".to_owned());
        };
        match opcode {
            op::MESSAGE | op::SCHEMA | op::CHANNEL => match channels.record(opcode, body) {
                Ok(one) => fate = weightier(fate, one),
                Err(reason) => bad.add(|| reason),
            },
            _ if is_defined(opcode) || opcode == 0 => bad.add(|| format!("a {} inside a chunk", name(opcode))),
            _ => unknown.add(|| format!("{} inside a chunk", name(opcode))),
        }
    }
    if bad.count == 0 {
        return Ok(fate);
    }
    Err(format!("{} records of the chunk are unusable, the others were kept; the first: {}", bad.count, bad.first))
}

/// A chunk with a wanted message counts as decoded, one with any message as more than structure.
fn weightier(one: Fate, other: Fate) -> Fate {
    match (one, other) {
        (Fate::Decoded, _) | (_, Fate::Decoded) => Fate::Decoded,
        (Fate::Skipped, _) | (_, Fate::Skipped) => Fate::Skipped,
        (Fate::Structure, Fate::Structure) => Fate::Structure,
    }
}
