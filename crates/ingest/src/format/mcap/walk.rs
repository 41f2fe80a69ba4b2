//! The walk over the records of an MCAP file, with every byte accounted for and every checksum
//! looked at before what it covers is used.
//!
//! After damage the walk goes on at the next chunk that the summary knows, or else at the next
//! bytes that look like a record followed by another. In a file with chunks only whole chunks
//! are found that way, never the messages inside a broken one: nothing has vouched for them.

use super::agreement::Agreement;
use super::record::{
    AttachmentHead, CHUNK_HEAD_BYTES, ChunkHead, HEAD_BYTES, Head, MAGIC, MOST_ATTACHMENT_HEAD, WRONG_START,
    is_defined, is_private, name,
};
use super::summary::{Summary, Trust};
use super::visit::Visit;
use crate::bytes::{Bytes, is_zero};
use crate::decode::{Tally, Vouch};
use crate::error::IngestError;
use crate::format::unpacker::Unpacker;
use crate::format::wrong_start;
use crate::reader::ReadContext;
use flight::{Code, Graded, Notices, Severity};
use logscan::LogFile;
use logscan::{FIRST_BLOCK, MOST_IN_VAIN, MOST_ZEROS};
use logscan::{Fate, Ledger};
use mcap::records::op;
use memchr::memmem;

/// How much of an attachment is shown where nobody takes it; its content is summed but not held.
const ATTACHMENT_SHOWN: u64 = 1 << 20;
/// Bytes searched or summed in one go.
const BLOCK: usize = 256 << 10;
/// A definition found by searching is believed up to this length.
const LONGEST_FOUND: u64 = 1 << 20;
/// A record that the end of the file cuts is believed to be shorter than this.
const LONGEST_CUT: u64 = 1 << 40;
/// As many zero bytes behind a message and at the end of the file, or all between them, are what a loss of power leaves.
const TELLING_ZEROS: usize = 4096;

/// A walk in progress.
pub(super) struct Walk<'w, 'c, V> {
    file: &'w mut LogFile,
    context: &'w ReadContext<'c>,
    ledger: &'w mut Ledger,
    notices: &'w mut Notices,
    visit: &'w mut V,
    summary: Summary,
    unpacker: Unpacker,
    /// Where this log begins in the file.
    start: u64,
    at: u64,
    data_crc: Option<crc32fast::Hasher>,
    chunks_seen: bool,
    messages_seen: bool,
    data_ended: bool,
    footer_seen: bool,
    ended: bool,
    /// Another log begins where the walk stands.
    another: bool,
    /// Where the log begins that was last found inside of a record: many damaged records may reach over the same one.
    log_within: u64,
    /// Bytes of records that proved wrong and lead nowhere.
    in_vain: u64,
    /// Something of this log was read.
    found_any: bool,
    damaged: bool,
    unknown: Tally,
    /// Of types that applications give a meaning of their own.
    private: Tally,
    agreement: Agreement,
    without_crc: u64,
    not_opened: u64,
    /// Nothing is summed and some chunks stay closed: what nobody needs is not read.
    jumps: bool,
    /// The chunk that came last was, or there was none.
    opened: bool,
    /// No chunk stands any more where the summary says that one should.
    no_more_known: bool,
}

/// A log that was walked through.
pub(super) struct Walked {
    /// What it said of itself.
    pub(super) summary: Summary,
    /// Where the next one begins, or the file ends.
    pub(super) end: u64,
    /// Something of it was there, and not only damage.
    pub(super) found_any: bool,
}

type Verdict = Result<Fate, String>;

impl<'w, 'c, V: Visit> Walk<'w, 'c, V> {
    pub(super) fn new(
        file: &'w mut LogFile,
        context: &'w ReadContext<'c>,
        ledger: &'w mut Ledger,
        notices: &'w mut Notices,
        visit: &'w mut V,
        start: u64,
        summary: Summary,
    ) -> Walk<'w, 'c, V> {
        // Where the data section is known to have no checksum, chunks need not even be read.
        let data_crc = (summary.data_crc != Some(0)).then(crc32fast::Hasher::new);
        visit.settle(false);
        visit.vouch(if data_crc.is_some() { Vouch::Later } else { Vouch::Nothing });
        let jumps = data_crc.is_none() && summary.chunks.iter().any(|chunk| !chunk.wanted);
        if jumps {
            file.expect_jumps();
        }
        let mut unpacker = Unpacker::new(file, context.limits.chunk_bytes);
        let opened = summary.chunks.iter().filter(|chunk| chunk.wanted).map(|chunk| chunk.offset).collect();
        unpacker.expect(opened, ChunkHead::look);
        Walk {
            file,
            context,
            ledger,
            notices,
            visit,
            summary,
            unpacker,
            start,
            at: start,
            data_crc,
            chunks_seen: false,
            messages_seen: false,
            data_ended: false,
            footer_seen: false,
            ended: false,
            another: false,
            log_within: 0,
            in_vain: 0,
            found_any: false,
            damaged: false,
            unknown: Tally::default(),
            private: Tally::default(),
            agreement: Agreement::default(),
            without_crc: 0,
            not_opened: 0,
            jumps,
            opened: true,
            no_more_known: false,
        }
    }

    /// From the first byte of a log to its last.
    pub(super) fn run(mut self) -> Result<Walked, IngestError> {
        self.magic()?;
        while self.at < self.file.size() && !self.ended && !self.another {
            if self.footer_seen {
                self.end_magic()?
            } else {
                self.record()?
            }
            self.file.progress(self.at, self.context)?;
        }
        if self.ended && (self.at < self.file.size() || self.start > 0) {
            // What was looked at before, if anything, is at the end of the file.
            let within = self.start..self.at;
            self.summary = Summary::read(self.file, within, self.context.limits.record_bytes, self.visit)?;
            if self.at < self.file.size() {
                self.behind("bytes behind the end of the log")?;
            }
        }
        self.file.progress(self.at, self.context)?;
        self.conclude()?;
        Ok(Walked { summary: self.summary, end: self.at, found_any: self.found_any })
    }

    /// Only the chunks that the summary lists, found by their offsets.
    pub(super) fn run_by_index(mut self) -> Result<(), IngestError> {
        for chunk in std::mem::take(&mut self.summary.chunks) {
            self.at = chunk.offset;
            self.record()?;
        }
        Ok(())
    }

    fn magic(&mut self) -> Result<(), IngestError> {
        let found = self.file.up_to(self.at, MAGIC.len())?;
        let (end, intact) = (self.at + found.len() as u64, found == MAGIC);
        if intact {
            return self.pass(end, Fate::Structure);
        }
        let mut next = self.at + 1;
        while next < end && !self.begins_log(next)? {
            next += 1;
        }
        let reason = wrong_start(self.file.up_to(self.at, MAGIC.len() + 1)?, MAGIC, WRONG_START);
        self.damage_to(next.min(end), reason);
        Ok(())
    }

    fn end_magic(&mut self) -> Result<(), IngestError> {
        self.ended = self.file.up_to(self.at, MAGIC.len())? == MAGIC;
        if self.ended {
            return self.pass(self.at + MAGIC.len() as u64, Fate::Structure);
        }
        self.behind("the eight bytes that end the file are missing")
    }

    /// The bytes behind a log are of no use, up to where another one begins.
    fn behind(&mut self, reason: &str) -> Result<(), IngestError> {
        let next = self.next_log(self.at)?;
        self.damage_to(next, reason);
        Ok(())
    }

    /// Where another log begins; the end of the file if none does.
    fn next_log(&mut self, from: u64) -> Result<u64, IngestError> {
        self.search(from, |walk, at| walk.begins_log(at))
    }

    /// Takes one record, or as much as is damaged.
    fn record(&mut self) -> Result<(), IngestError> {
        let size = self.file.size();
        self.another = self.at > self.start && self.begins_log(self.at)?;
        if self.another {
            return Ok(());
        }
        let Some(head) = Head::read(self.file, self.at)? else {
            return self.lost("the file ends inside the header of a record");
        };
        if head.opcode == 0 || !head.fits_its_type() {
            return self.lost("what stands here is no record");
        }
        let head = match self.true_end(&head)? {
            Some(end) => {
                // It may be read all the same.
                self.damage_to(self.at + HEAD_BYTES, &format!("a {} whose length is wrong", name(head.opcode)));
                head.until(end)
            }
            None => head,
        };
        if head.end > size {
            let reason = format!("the file ends inside a record ({} of {} bytes)", name(head.opcode), head.length);
            return self.lost(&reason);
        }
        if self.leads_nowhere(&head)? {
            return self.lost("a record whose length leads nowhere");
        }
        if let Some(next) = self.record_within(&head)? {
            self.damage_to(next, &format!("a {} of which bytes are missing", name(head.opcode)));
            return Ok(());
        }
        match self.take(&head)? {
            Ok(fate) => self.pass(head.end, fate),
            Err(reason) if self.begins_record(head.end)? => {
                self.damage_to(head.end, &reason);
                Ok(())
            }
            Err(reason) => {
                self.in_vain += self.looked_into(&head)?;
                self.lost(&reason)
            }
        }
    }

    /// How much of a record that proved wrong was read, bytes: of a chunk whose own header is wrong no more than that.
    fn looked_into(&mut self, head: &Head) -> Result<u64, IngestError> {
        let refused = head.opcode == op::CHUNK && ChunkHead::read(self.file, head)?.is_err();
        Ok(if refused { CHUNK_HEAD_BYTES as u64 } else { head.end - head.start })
    }

    /// Whether a record that has no checksum, as all that are in no chunk, is refuted by what follows: a message by the first
    /// thing behind it, any other if another log begins inside of it.
    fn leads_nowhere(&mut self, head: &Head) -> Result<bool, IngestError> {
        if self.in_vain / MOST_IN_VAIN > self.file.size() && !self.begins_record(head.end)? {
            return Ok(true);
        }
        if matches!(head.opcode, op::CHUNK | op::ATTACHMENT) || head.length > self.context.limits.record_bytes {
            return Ok(false);
        }
        if head.opcode == op::MESSAGE && !self.leads_on(head.end)? {
            return Ok(true);
        }
        // Where a summary stands that is right, nothing was cut before it.
        if head.opcode != op::MESSAGE && self.summary.trust == Trust::Good && self.summary.shift.is_none() {
            return Ok(false);
        }
        // A message may carry a log, but then two records follow it, or what ends a file. Looked at first: few bytes tell it.
        let known = head.opcode == op::MESSAGE && self.is_message(head)?;
        let follow = match Head::read(self.file, head.end)?.filter(|next| next.end <= self.file.size()) {
            Some(next) if is_defined(next.opcode) || known && is_private(next.opcode) => {
                self.begins_record(head.end)? && self.leads_on(next.end)?
            }
            _ => known && self.ends_here(head.end)?,
        };
        if follow {
            return Ok(false);
        }
        if (head.start + 1..head.end).contains(&self.log_within) {
            return Ok(true);
        }
        // As far as a log that begins with the last byte.
        let most = (head.end - head.start) as usize + MAGIC.len() - 2;
        let Some(inside) = memmem::find(self.file.up_to(head.start + 1, most)?, MAGIC) else { return Ok(false) };
        let at = head.start + 1 + inside as u64;
        let found = self.begins_log(at)?;
        if found {
            self.log_within = at;
            self.in_vain += head.end - head.start;
        }
        Ok(found)
    }

    /// Where a record ends whose length leads elsewhere: what it holds tells, and another record begins there. A writer may
    /// have added a few bytes, but no whole records.
    fn true_end(&mut self, head: &Head) -> Result<Option<u64>, IngestError> {
        let Some(end) = head.own_end(self.file)? else { return Ok(None) };
        if !self.begins_record(end)? {
            return Ok(None);
        }
        let mut at = end;
        while at < head.end && !Head::is_too_long(head.end - end) {
            match Head::read(self.file, at)?.filter(|next| is_defined(next.opcode) && next.fits_its_type()) {
                Some(next) => at = next.end,
                None => return Ok(None),
            }
        }
        Ok((at <= head.end).then_some(end))
    }

    /// Where the next record begins in one behind which nothing does: bytes of it are missing.
    fn record_within(&mut self, head: &Head) -> Result<Option<u64>, IngestError> {
        // Types that this version does not know are too rare to vouch for anything.
        let is_known = self.file.peek::<1>(head.end)?.is_none_or(|[opcode]| is_defined(opcode) || is_private(opcode));
        let follows = is_known && self.leads_on(head.end)?;
        let may = matches!(head.opcode, op::CHUNK | op::MESSAGE) || self.footer_seen || follows;
        if may || head.own_end(self.file)?.is_some() || self.has_checksum(head)? {
            return Ok(None);
        }
        let from = head.end.saturating_sub(LONGEST_FOUND).max(self.at + 1);
        self.in_vain += head.end - from;
        let mut at = from;
        while at < head.end {
            let block = self.file.up_to(at, BLOCK)?;
            let fresh = (block.len() as u64).saturating_sub(HEAD_BYTES - 1).max(1);
            let found: Vec<u64> = candidates(block).map(|i| at + i as u64).filter(|&i| i < head.end).collect();
            for candidate in found {
                if self.is_record(candidate)? && self.reaches_over(candidate, head.end)? {
                    return Ok(Some(candidate));
                }
            }
            at += fresh;
        }
        Ok(None)
    }

    /// Whether records lead from here over a place and not to it: those that a record carries end within it.
    fn reaches_over(&mut self, mut at: u64, place: u64) -> Result<bool, IngestError> {
        while at < place {
            match Head::read(self.file, at)?.filter(|head| is_defined(head.opcode) && head.opcode != op::FOOTER) {
                Some(head) => at = head.end,
                None => return Ok(false),
            }
        }
        Ok(at > place)
    }

    /// Whether the record is an attachment that tells by itself whether it is intact.
    fn has_checksum(&mut self, head: &Head) -> Result<bool, IngestError> {
        let sum_at = head.end.saturating_sub(4).max(head.start);
        Ok(head.opcode == op::ATTACHMENT && self.file.peek::<4>(sum_at)?.is_some_and(|sum| sum != [0; 4]))
    }

    /// Whether a record begins here, or the file ends as where its recorder was stopped.
    fn leads_on(&mut self, at: u64) -> Result<bool, IngestError> {
        Ok(self.begins_record(at)? || self.ends_here(at)?)
    }

    /// Whether nothing follows, or zeros, or a record that the end of the file cuts.
    fn ends_here(&mut self, at: u64) -> Result<bool, IngestError> {
        let tail = self.file.size().saturating_sub(TELLING_ZEROS as u64).max(at);
        if is_zero(self.file.up_to(at, TELLING_ZEROS)?) && is_zero(self.file.up_to(tail, TELLING_ZEROS)?) {
            return Ok(true);
        }
        let may_begin = |opcode| is_defined(opcode) || is_private(opcode);
        Ok(match Head::read(self.file, at)? {
            Some(head) => may_begin(head.opcode) && head.end > self.file.size() && head.length < LONGEST_CUT,
            // The magic begins as a private record does.
            None => self.file.peek::<1>(at)?.is_some_and(|[opcode]| may_begin(opcode)),
        })
    }

    fn take(&mut self, head: &Head) -> Result<Verdict, IngestError> {
        if head.opcode == op::MESSAGE_INDEX && !self.data_ended {
            let frame = self.file.peek::<6>(head.start + HEAD_BYTES)?;
            self.agreement.message_index(head, frame);
        }
        match head.opcode {
            op::CHUNK => self.chunk(head),
            op::ATTACHMENT => self.attachment(head),
            op::FOOTER => self.footer(head),
            _ if head.length > self.context.limits.record_bytes => Ok(Err(format!(
                "a {} of {} bytes is larger than the limit of {}",
                name(head.opcode),
                head.length,
                self.context.limits.record_bytes
            ))),
            op::MESSAGE_INDEX if self.jumps && self.opened && self.is_message_index(head)? => Ok(Ok(Fate::Structure)),
            opcode if is_defined(opcode) => self.plain(head),
            _ => self.undefined(head),
        }
    }

    fn plain(&mut self, head: &Head) -> Result<Verdict, IngestError> {
        self.messages_seen |= head.opcode == op::MESSAGE;
        if head.opcode == op::DATA_END {
            let stated = body(self.file, head, 4)?.and_then(|b| Bytes(b).u32()).unwrap_or_default();
            self.data_ended = true;
            self.check_data(stated);
        }
        self.show(head, head.length)
    }

    /// By the frame alone, without its entries: of a chunk that was opened they tell nothing new.
    fn is_message_index(&mut self, head: &Head) -> Result<bool, IngestError> {
        let frame = self.file.peek::<6>(head.start + HEAD_BYTES)?;
        Ok(frame.is_some_and(|frame| super::is_message_index(&frame, head.length)))
    }

    fn show(&mut self, head: &Head, length: u64) -> Result<Verdict, IngestError> {
        match body(self.file, head, length)? {
            Some(body) if head.opcode == op::MESSAGE_INDEX && !self.opened => Ok(self.visit.index(body)),
            Some(body) => {
                match self.data_ended {
                    true => self.agreement.summary(head.opcode, body, self.start),
                    false => self.agreement.data(head.opcode, body),
                }
                Ok(self.visit.record(head.opcode, body))
            }
            None => Ok(Err("the record is cut".to_owned())),
        }
    }

    /// A record that this version does not know may be the next version's, or damage.
    fn undefined(&mut self, head: &Head) -> Result<Verdict, IngestError> {
        if !self.begins_record(head.end)? {
            return Ok(Err("what stands here is no record".to_owned()));
        }
        if ChunkHead::read(self.file, head)?.is_ok() {
            return Ok(Err("a chunk whose type byte is damaged".to_owned()));
        }
        let place = format!("{} at byte {}", name(head.opcode), head.start);
        let tally = if is_private(head.opcode) { &mut self.private } else { &mut self.unknown };
        tally.add(|| place);
        Ok(Ok(Fate::Structure))
    }

    fn footer(&mut self, head: &Head) -> Result<Verdict, IngestError> {
        let rest = self.file.up_to(head.end, MAGIC.len())?;
        if rest.len() == MAGIC.len() && rest != MAGIC && head.end + (MAGIC.len() as u64) < self.file.size() {
            return Ok(Err("a footer in the midst of the file".to_owned()));
        }
        self.footer_seen = true;
        self.show(head, head.length)
    }

    fn check_data(&mut self, stated: u32) {
        let Some(hasher) = self.data_crc.take() else { return };
        let is_right = stated != 0 && !self.damaged && hasher.finalize() == stated;
        self.visit.settle(is_right);
        if stated != 0 && !self.damaged && !is_right {
            let place = format!("{}, bytes {} to {}", self.file.name(), self.start, self.at);
            let text = "the checksum over the data section is wrong: some of its bytes are not what was written";
            self.notices.push(Code::Corrupt, place, self.at - self.start, text);
        }
    }

    fn chunk(&mut self, head: &Head) -> Result<Verdict, IngestError> {
        self.chunks_seen = true;
        let chunk = match ChunkHead::read(self.file, head)? {
            Ok(chunk) => chunk,
            Err(reason) => return Ok(Err(reason)),
        };
        self.agreement.chunk(head, &chunk);
        if self.can_leave_closed(head)? {
            self.agreement.closed();
            self.opened = false;
            self.not_opened += 1;
            return Ok(Ok(Fate::Skipped));
        }
        if head.length > self.context.limits.record_bytes {
            let limit = self.context.limits.record_bytes;
            return Ok(Err(format!("a chunk of {} bytes is larger than the limit of {limit}", head.length)));
        }
        self.unpacker.come_to(head.start, self.file);
        self.file.bytes(head.start, (head.end - head.start) as usize)?;
        let Some(unpacked) = self.unpacker.unpack(&chunk.packed(head), self.file)? else {
            return Ok(Err("the chunk is cut".to_owned()));
        };
        if let Some(fault) = unpacked.fault {
            return Ok(Err(fault));
        }
        if chunk.crc == 0 {
            self.without_crc += 1;
        } else if unpacked.crc != chunk.crc {
            return Ok(Err("the chunk's checksum is wrong".to_owned()));
        }
        self.opened = true;
        // That of the data section is of the packed bytes, and of these too.
        let outer = if self.data_crc.is_some() { Vouch::Later } else { Vouch::Nothing };
        self.visit.vouch(if chunk.crc == 0 { outer } else { Vouch::Checksum });
        let verdict = contents(unpacked.bytes, self.visit, &mut self.unknown, &mut self.agreement);
        self.visit.vouch(outer);
        self.agreement.end_of_chunk();
        Ok(verdict)
    }

    /// The summary, whose checksum is right, says that this very chunk holds nothing that is wanted, and so do the message
    /// indexes behind it.
    fn can_leave_closed(&mut self, head: &Head) -> Result<bool, IngestError> {
        let length = head.end - head.start;
        let known = self.summary.chunk_at(head.start).is_some_and(|c| !c.wanted && c.length == length);
        if !known || !self.context.limits.may_leave_closed {
            return Ok(false);
        }
        let mut at = head.end;
        while let Some(index) = Head::read(self.file, at)?.filter(|head| head.opcode == op::MESSAGE_INDEX) {
            let channel = self.file.peek::<2>(index.start + HEAD_BYTES)?.map(u16::from_le_bytes);
            if channel.is_some_and(|channel| self.visit.may_want(channel)) {
                return Ok(false);
            }
            at = index.own_end(self.file)?.unwrap_or(index.end);
        }
        Ok(true)
    }

    fn attachment(&mut self, head: &Head) -> Result<Verdict, IngestError> {
        let shown = head.length.min(ATTACHMENT_SHOWN);
        let parsed = body(self.file, head, shown)?.and_then(|start| AttachmentHead::parse(start, head.length));
        let Some(attachment) = parsed else { return Ok(Err("the attachment's own header is damaged".to_owned())) };
        let start = head.start + HEAD_BYTES;
        let crc_at = start + attachment.data.end;
        let stated = self.file.bytes(crc_at, 4)?.and_then(|b| Bytes(b).u32()).unwrap_or_default();
        if stated != 0 {
            let mut hasher = crc32fast::Hasher::new();
            self.sum(start, crc_at, &mut hasher)?;
            if hasher.finalize() != stated {
                return Ok(Err(format!("the checksum of the attachment {:.200} is wrong", attachment.name)));
            }
        }
        let whole = self.visit.takes_attachments() && head.length <= self.context.limits.record_bytes;
        self.show(head, if whole { head.length } else { shown })
    }

    fn sum(&mut self, from: u64, to: u64, hasher: &mut crc32fast::Hasher) -> Result<(), IngestError> {
        let mut at = from;
        while at < to {
            let block = self.file.up_to(at, BLOCK.min((to - at) as usize))?;
            hasher.update(block);
            at += block.len().max(1) as u64;
            self.file.progress(at, self.context)?;
        }
        Ok(())
    }

    /// The bytes up to `end` are intact.
    fn pass(&mut self, end: u64, fate: Fate) -> Result<(), IngestError> {
        if let Some(mut hasher) = self.data_crc.take() {
            self.sum(self.at, end, &mut hasher)?;
            self.data_crc = Some(hasher);
        }
        self.ledger.count(fate, end - self.at);
        self.found_any |= self.at > self.start;
        self.at = end;
        Ok(())
    }

    /// The bytes up to `end` are of no use.
    fn damage_to(&mut self, end: u64, reason: &str) {
        if end > self.at {
            self.ledger.damaged(self.file.name(), self.at, end - self.at, reason);
            self.damaged = true;
            self.at = end;
        }
    }

    /// Nothing can be made of what stands here: goes on where the next record begins.
    fn lost(&mut self, reason: &str) -> Result<(), IngestError> {
        let next = match self.known_end()? {
            Some(end) => end,
            None => match self.next_known_chunk(self.at + 1)? {
                Some(at) => at,
                None => self.search(self.at + 1, |walk, at| Ok(walk.begins_log(at)? || walk.is_record(at)?))?,
            },
        };
        self.damage_to(next, reason);
        Ok(())
    }

    /// Where the summary says that the chunk that should be here ends, if a record begins there.
    fn known_end(&mut self) -> Result<Option<u64>, IngestError> {
        let stated = self.summary.chunk_at(self.at).and_then(|chunk| self.at.checked_add(chunk.length));
        match stated.filter(|&end| end > self.at && end <= self.file.size()) {
            Some(end) if self.begins_record(end)? => Ok(Some(end)),
            _ => Ok(None),
        }
    }

    /// By the summary; the chunk is looked at before it is believed to be there.
    fn next_known_chunk(&mut self, from: u64) -> Result<Option<u64>, IngestError> {
        if self.data_ended {
            return Ok(None);
        }
        let mut known = from;
        while let Some(chunk) = self.summary.chunks_from(known).first().copied().filter(|_| !self.no_more_known) {
            if self.is_record(chunk.offset)? {
                return Ok(Some(chunk.offset));
            }
            known = chunk.offset + 1;
        }
        // Looked for once, and not again behind every other record that is damaged.
        self.no_more_known = true;
        match self.summary.data_end.filter(|&at| at >= from && !self.summary.chunks.is_empty()) {
            Some(at) if self.is_record(at)? => Ok(Some(at)),
            _ => Ok(None),
        }
    }

    /// The first place, by the look of the bytes, that is what is looked for; the end of the file if there is none.
    fn search(
        &mut self,
        from: u64,
        mut is_it: impl FnMut(&mut Self, u64) -> Result<bool, IngestError>,
    ) -> Result<u64, IngestError> {
        let size = self.file.size();
        let mut at = from;
        let mut zeros = 0;
        let mut length = FIRST_BLOCK;
        while at + HEAD_BYTES <= size {
            let block = self.file.up_to(at, length)?;
            let fresh = block.len() as u64 - (HEAD_BYTES - 1);
            zeros = if is_zero(block) { zeros + fresh } else { 0 };
            let found = candidates(block).map(|i| at + i as u64).collect::<Vec<u64>>();
            for candidate in found {
                if is_it(self, candidate)? {
                    return Ok(candidate);
                }
            }
            if zeros > MOST_ZEROS {
                break;
            }
            at += fresh;
            length = BLOCK.min(2 * length);
            self.file.progress(at, self.context)?;
        }
        Ok(size)
    }

    /// Whether a whole log begins here, as where files were put one behind another.
    fn begins_log(&mut self, at: u64) -> Result<bool, IngestError> {
        if self.file.peek::<8>(at)?.as_ref() != Some(MAGIC) {
            return Ok(false);
        }
        let head = Head::read(self.file, at + MAGIC.len() as u64)?;
        Ok(head.is_some_and(|h| h.opcode == op::HEADER && h.length <= LONGEST_FOUND && h.end <= self.file.size()))
    }

    /// Whether a record that may be gone on with begins here, so plainly that chance is no explanation.
    fn is_record(&mut self, at: u64) -> Result<bool, IngestError> {
        let size = self.file.size();
        let Some(head) = Head::read(self.file, at)?.filter(|h| h.end <= size && h.fits_its_type()) else {
            return Ok(false);
        };
        let without_chunks = !self.chunks_seen && !self.summary.has_chunks;
        let loose = without_chunks && (self.messages_seen || self.summary.trust == Trust::Good);
        let fits = match head.opcode {
            op::CHUNK => ChunkHead::read(self.file, &head)?.is_ok(),
            op::MESSAGE if loose => self.is_message(&head)?,
            op::SCHEMA | op::CHANNEL if loose => head.length <= LONGEST_FOUND,
            op::METADATA => head.length <= LONGEST_FOUND,
            op::ATTACHMENT => {
                let start = body(self.file, &head, head.length.min(MOST_ATTACHMENT_HEAD))?;
                start.and_then(|b| AttachmentHead::parse(b, head.length)).is_some()
            }
            op::DATA_END => true,
            op::FOOTER => self.file.up_to(head.end, MAGIC.len())? == MAGIC,
            op::SCHEMA | op::CHANNEL | op::CHUNK_INDEX | op::ATTACHMENT_INDEX => self.data_ended,
            op::STATISTICS | op::METADATA_INDEX | op::SUMMARY_OFFSET => self.data_ended,
            _ => false,
        };
        Ok(fits && self.begins_record(head.end)?)
    }

    fn is_message(&mut self, head: &Head) -> Result<bool, IngestError> {
        let channel =
            body(self.file, head, head.length.min(22))?.filter(|b| b.len() == 22).and_then(|b| Bytes(b).u16());
        Ok(channel.is_some_and(|channel| self.visit.knows(channel)))
    }

    /// Whether a record, or what ends a file, may begin here.
    fn begins_record(&mut self, at: u64) -> Result<bool, IngestError> {
        let size = self.file.size();
        if at == size || self.file.peek::<8>(at)?.as_ref() == Some(MAGIC) {
            return Ok(true);
        }
        if self.footer_seen {
            return Ok(false);
        }
        let head = Head::read(self.file, at)?;
        // Private and future records begin at 0x10; between chunks they are rare, and lengths that fit rarer still.
        Ok(head.is_some_and(|h| h.opcode != 0 && h.end <= size && h.fits_its_type()))
    }

    fn conclude(&mut self) -> Result<(), IngestError> {
        let file = self.file.name().to_owned();
        // Of a log that is damaged nobody knows which of them is wrong.
        let is_whole = self.footer_seen && self.data_ended && !self.damaged && self.summary.shift.is_none();
        let agreement = std::mem::take(&mut self.agreement);
        let differences = if is_whole { agreement.conclude(self.file)? } else { Tally::default() };
        let mut raise = |what: Graded, count, text: &str| {
            if count > 0 {
                self.notices.push(what, file.as_str(), count, text);
            }
        };
        // What stands before the first log is damage, and nothing else.
        if self.another && !self.found_any {
            return Ok(());
        }
        if !self.footer_seen {
            let text = "the file has no footer: it was cut, or its recorder was stopped before it could close it";
            raise(Code::IncompleteFile.into(), 1, text);
        } else if !self.data_ended && !self.damaged {
            let text = "the record that ends the data is missing: it was swallowed by another, or never written";
            raise(Code::IncompleteFile.at(Severity::Warning), 1, text);
        } else if !self.ended && !self.damaged {
            raise(Code::IncompleteFile.into(), 1, "the file was cut just behind its footer");
        }
        if self.summary.trust == Trust::Bad {
            let text = "the summary at the end does not have the checksum that it states; it was not used";
            raise(Code::Corrupt.into(), 1, text);
        }
        if let Some(shift) = self.summary.shift {
            let text = match shift {
                ..0 => {
                    "bytes are missing from the file: its summary stands so many before the place that the footer says"
                }
                _ => "bytes were put into the file: its summary stands so many behind the place that the footer says",
            };
            raise(Code::IndexDiffers.at(Severity::Loss), shift.unsigned_abs(), text);
        }
        let text = format!("records of unknown types, passed over; the first: {}", self.unknown.first);
        raise(Code::UnknownRecord.into(), self.unknown.count, &text);
        let text = format!("records of an application's own types, passed over; the first: {}", self.private.first);
        raise(Code::UnknownRecord.at(Severity::Info), self.private.count, &text);
        raise(
            Code::NoChecksum.at(Severity::Info),
            self.without_crc,
            "chunks carry no checksum: their content cannot be verified",
        );
        let text = "chunks hold no wanted topic and were left closed: their messages are counted by the index, \
                    which knows neither their size nor when they were published";
        raise(Code::ClosedChunks.into(), self.not_opened, text);
        let text = format!(
            "what the index or the header of a chunk says differs from the data, which are followed; the first: {}",
            differences.first
        );
        raise(Code::IndexDiffers.into(), differences.count, &text);
        Ok(())
    }
}

/// The first `length` bytes of a record's content.
fn body<'f>(file: &'f mut LogFile, head: &Head, length: u64) -> Result<Option<&'f [u8]>, IngestError> {
    let whole = file.bytes(head.start, (HEAD_BYTES + length) as usize)?;
    Ok(whole.and_then(|bytes| bytes.get(HEAD_BYTES as usize..)))
}

/// Shows the records inside a chunk. The fate is that of the whole chunk.
fn contents<V: Visit>(data: &[u8], visit: &mut V, unknown: &mut Tally, agreement: &mut Agreement) -> Verdict {
    let mut rest = Bytes(data);
    let mut fate = Fate::Structure;
    let mut bad = Tally::default();
    while !rest.0.is_empty() {
        let (Some(opcode), Some(length)) = (rest.u8(), rest.u64()) else {
            return Err("the chunk ends inside the header of a record; what came before was kept".to_owned());
        };
        let Some(body) = usize::try_from(length).ok().and_then(|length| rest.take(length)) else {
            return Err("a record reaches past the end of its chunk; what came before was kept".to_owned());
        };
        agreement.data(opcode, body);
        match opcode {
            op::MESSAGE | op::SCHEMA | op::CHANNEL => match visit.record(opcode, body) {
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
    Err(format!("{} records of the chunk are unusable, the rest was kept; the first: {}", bad.count, bad.first))
}

/// A chunk with one wanted message is decoded, one with any message is more than structure.
fn weightier(one: Fate, other: Fate) -> Fate {
    match (one, other) {
        (Fate::Decoded, _) | (_, Fate::Decoded) => Fate::Decoded,
        (Fate::Skipped, _) | (_, Fate::Skipped) => Fate::Skipped,
        (Fate::Structure, Fate::Structure) => Fate::Structure,
    }
}

/// Where in a block a record may begin, for the opcode is defined and the length below 2^40, or a log.
fn candidates(block: &[u8]) -> impl Iterator<Item = usize> {
    let may_begin = |w: &[u8]| match w {
        [opcode, _, _, _, _, _, a, b, c] if is_defined(*opcode) => (*a | *b | *c) == 0,
        window => window.starts_with(MAGIC),
    };
    block.windows(HEAD_BYTES as usize).enumerate().filter(move |(_, w)| may_begin(w)).map(|(i, _)| i)
}
