//! The walk over a binary log, record by record.
//!
//! Nothing in it vouches for a record but what stands behind it: a record counts if another begins where it ends.

use super::anew::Anew;
use super::book::Book;
use super::record::{FMT_ID, FMT_LENGTH, Format, HEADER, LONGEST_RECORD, SYNC};
use crate::bytes::is_zero;
use crate::error::IngestError;
use crate::format::MOST_ZEROS;
use crate::format::file::LogFile;
use crate::ledger::{Fate, Ledger};
use crate::reader::ReadContext;
use flight::{Notices, Severity};
use memchr::memmem;

/// Said where no record begins.
pub(super) const NO_RECORD: &str = "what stands here is no record";
/// Bytes looked through for the end in one go.
const BLOCK: usize = 256 << 10;
/// Bytes compared in one go.
const PIECE: usize = 4 << 10;
/// Bytes searched in one go: few, for where records and damage alternate every search is short.
const STRETCH: usize = 4 << 10;
/// Looked through for records behind one whose clock goes back, bytes: a second of a dense log.
const AHEAD: u64 = 1 << 20;
/// Fetched with a record: it, and the start of the next.
const TOGETHER: usize = LONGEST_RECORD + HEADER;

/// A walk in progress.
pub(super) struct Walk<'w, 'c, 't, 's> {
    file: &'w mut LogFile,
    name: String,
    context: &'w ReadContext<'c>,
    ledger: &'w mut Ledger,
    notices: &'w mut Notices,
    book: &'w mut Book<'t, 's>,
    sync: memmem::Finder<'static>,
    inner: InnerRecords,
    at: u64,
    /// Where the filling at the end begins; not known if it is longer than the reader looks back.
    padding_from: Option<u64>,
}

impl<'w, 'c, 't, 's> Walk<'w, 'c, 't, 's> {
    pub(super) fn new(
        file: &'w mut LogFile,
        context: &'w ReadContext<'c>,
        ledger: &'w mut Ledger,
        notices: &'w mut Notices,
        book: &'w mut Book<'t, 's>,
    ) -> Walk<'w, 'c, 't, 's> {
        let name = file.name().to_owned();
        let sync = memmem::Finder::new(&SYNC);
        let inner = InnerRecords::default();
        Walk { file, name, context, ledger, notices, book, sync, inner, at: 0, padding_from: None }
    }

    /// From the first byte to the last.
    pub(super) fn run(mut self) -> Result<(), IngestError> {
        self.padding_from = padding_from(self.file)?;
        while self.at < self.file.size() {
            match self.record_at(self.at)? {
                Some(length) => self.take(length)?,
                None if self.is_padding(self.at) => self.padding(),
                None => self.lost()?,
            }
            self.file.progress(self.at, self.context)?;
        }
        Ok(())
    }

    /// Length of the record that begins here: of the lengths that its type may have the first that leads on.
    fn record_at(&mut self, at: u64) -> Result<Option<usize>, IngestError> {
        let window = self.file.up_to(at, TOGETHER)?;
        let Some((&[first, second, id], _)) = window.split_first_chunk() else { return Ok(None) };
        if [first, second] != SYNC {
            return Ok(None);
        }
        if id == FMT_ID && window.get(..FMT_LENGTH).is_some_and(Format::vouches) {
            return Ok(Some(FMT_LENGTH));
        }
        let lengths = self.book.format(id).map(Format::lengths).unwrap_or_default();
        if let Some(former) = self.book.former(id).and_then(Format::usual_length) {
            let [one, other] = lengths;
            return self.record_of_either(at, [one, other, Some(former)]);
        }
        // Nearly always the next record follows, and nothing within this one looks like a third.
        if let [Some(length), _] = lengths
            && window.get(length..).is_some_and(|next| next.starts_with(&SYNC))
            && window.get(HEADER..length).is_some_and(|inner| self.sync.find(inner).is_none())
        {
            return Ok(Some(length));
        }
        for length in lengths.into_iter().flatten() {
            if self.may_begin(at + length as u64)? && !self.swallows(at, length)? {
                return Ok(Some(length));
            }
        }
        Ok(None)
    }

    /// As [`Walk::record_at`], of a type that was defined anew: what leads on and has a time that is near comes first.
    fn record_of_either(&mut self, at: u64, lengths: [Option<usize>; 3]) -> Result<Option<usize>, IngestError> {
        let mut untimely = None;
        for length in lengths.into_iter().flatten() {
            if !self.may_begin(at + length as u64)? || self.swallows(at, length)? {
                continue;
            }
            let bytes = self.file.bytes(at, length)?.unwrap_or_default();
            if self.book.is_timely(bytes, HEADER) {
                return Ok(Some(length));
            }
            untimely = untimely.or(Some(length));
        }
        Ok(untimely)
    }

    /// Length of the record that begins here in front of damage: it leads nowhere, but its time is near, no other begins
    /// within it, and what stands behind it is more than the rest of a record whose type is wrong, or one that leads to
    /// `next`.
    fn record_before_damage(&mut self, at: u64, next: u64) -> Result<Option<usize>, IngestError> {
        let Some(id) = self.type_at(at)? else { return Ok(None) };
        let Some(length) = self.book.format(id).and_then(Format::usual_length) else { return Ok(None) };
        let end = at + length as u64;
        let is_timely = self.file.bytes(at, length)?.is_some_and(|bytes| self.book.is_timely(bytes, HEADER));
        if !is_timely || end >= next || self.swallows(at, length)? {
            return Ok(None);
        }
        let damaged = self.file.bytes(end, HEADER)?.and_then(|head| head.last().copied());
        let leads = damaged.and_then(|id| self.book.format(id)?.usual_length()).is_some_and(|l| end + l as u64 == next);
        Ok((leads || next > at + LONGEST_RECORD as u64).then_some(length))
    }

    fn type_at(&mut self, at: u64) -> Result<Option<u8>, IngestError> {
        Ok(match self.file.bytes(at, HEADER)? {
            Some(&[first, second, id]) if [first, second] == SYNC => Some(id),
            _ => None,
        })
    }

    /// Whether a record, the padding or the end may be here. One wrong bit in the sync bytes is the next record's
    /// damage, not that of the one before.
    fn may_begin(&mut self, at: u64) -> Result<bool, IngestError> {
        if at > self.file.size() {
            return Ok(false);
        }
        let wrong = match self.file.up_to(at, SYNC.len())? {
            [first, second] => (first ^ SYNC[0]).count_ones() + (second ^ SYNC[1]).count_ones(),
            [first] => (first ^ SYNC[0]).count_ones(),
            _ => 0,
        };
        Ok(wrong <= 1 || self.is_padding(at) || (self.padding_from.is_none() && self.is_void(at)?))
    }

    /// Whether a record within this one leads to its very end: then its type, and so its length, is wrong. Numbers may look
    /// like the head of a record (-0.0211 as a double does), but hardly with a time that is near behind it.
    fn swallows(&mut self, at: u64, length: usize) -> Result<bool, IngestError> {
        let bytes = self.file.bytes(at, length)?.unwrap_or_default();
        self.inner.look(at, bytes, self.book);
        let begin = self.inner.leads_to(at + length as u64).and_then(|begin| begin.checked_sub(at));
        let inner = begin.filter(|begin| *begin >= HEADER as u64).and_then(|begin| bytes.get(begin as usize..));
        Ok(inner.is_some_and(|inner| self.book.may_be_beside(inner, bytes, HEADER)))
    }

    /// Whether nothing but the filling at the end of the file follows.
    fn is_padding(&self, at: u64) -> bool {
        self.padding_from.is_some_and(|from| (from..self.file.size()).contains(&at))
    }

    /// Whether so many zeros follow that no record has them.
    fn is_void(&mut self, at: u64) -> Result<bool, IngestError> {
        let bytes = self.file.up_to(at, STRETCH)?;
        Ok(bytes.len() == STRETCH && is_zero(bytes))
    }

    fn padding(&mut self) {
        let length = self.file.size() - self.at;
        self.notices.push(
            Severity::Info,
            "padding",
            self.name.as_str(),
            length,
            "filling bytes behind the last record",
        );
        self.ledger.count(Fate::Structure, length);
        self.at += length;
    }

    fn take(&mut self, length: usize) -> Result<(), IngestError> {
        let mut bytes = self.file.bytes(self.at, length)?.unwrap_or_default();
        let id = bytes.get(HEADER - 1).copied().unwrap_or_default();
        let raw_ns = self.book.time_of_record(id, bytes, HEADER);
        if let Some(mut anew) = raw_ns.and_then(|raw_ns| self.book.may_begin_anew(raw_ns)) {
            self.look_ahead(length, &mut anew)?;
            self.book.begins_anew(&anew);
            bytes = self.file.bytes(self.at, length)?.unwrap_or_default();
        }
        match self.book.packed(id, bytes, HEADER, raw_ns) {
            Ok(fate) => self.ledger.count(fate, length as u64),
            Err(reason) => self.ledger.damaged(&self.name, self.at, length as u64, reason),
        }
        self.at += length as u64;
        Ok(())
    }

    /// Shows the times of the records behind this one; what is damaged is left out.
    fn look_ahead(&mut self, length: usize, anew: &mut Anew) -> Result<(), IngestError> {
        let (mut at, end) = (self.at + length as u64, self.at + AHEAD);
        while at < end {
            let window = self.file.up_to(at, LONGEST_RECORD)?;
            let Some((&[first, second, id], _)) = window.split_first_chunk() else { break };
            let known = self.book.format(id).filter(|_| [first, second] == SYNC).and_then(Format::usual_length);
            let Some((length, record)) = known.and_then(|length| Some((length, window.get(..length)?))) else {
                // Sync bytes that straddle the end of the window are found in the next.
                let next = window.get(1..).and_then(|rest| self.sync.find(rest));
                at += next.map_or(window.len() as u64 - 1, |next| next as u64 + 1);
                continue;
            };
            if self.book.time_of_record(id, record, HEADER).is_some_and(|ns| !anew.goes_on(ns)) {
                break;
            }
            at += length as u64;
        }
        Ok(())
    }

    /// Nothing can be made of what stands here: goes on where the next record begins.
    fn lost(&mut self) -> Result<(), IngestError> {
        // Asked before the search, for the file is read forwards.
        let (kind, is_cut) = (self.type_at(self.at)?, self.is_cut()?);
        let next = self.search(self.at + 1)?;
        if let Some(length) = self.record_before_damage(self.at, next)? {
            return self.take(length);
        }
        if is_cut && next == self.file.size() {
            self.ledger.cut(&self.name, self.at, next - self.at, "the log ends inside a record");
            self.at = next;
            return Ok(());
        }
        let reason = match kind {
            Some(id) if self.book.format(id).is_none() => format!("records of type {id}, which is not defined"),
            Some(_) => "a record that leads nowhere".to_owned(),
            None => NO_RECORD.to_owned(),
        };
        self.ledger.damaged(&self.name, self.at, next - self.at, reason);
        self.at = next;
        Ok(())
    }

    /// Whether a record begins here that reaches beyond the end of the file.
    fn is_cut(&mut self) -> Result<bool, IngestError> {
        let left = self.file.size() - self.at;
        let head = self.file.up_to(self.at, HEADER)?;
        Ok(match *head {
            [first, second, id] if [first, second] == SYNC => {
                self.book.format(id).is_some_and(|f| f.lengths().into_iter().flatten().any(|l| l as u64 > left))
            }
            _ => left < HEADER as u64 && SYNC.starts_with(head),
        })
    }

    /// The next record beyond doubt; the filling or the end if there is none.
    fn search(&mut self, from: u64) -> Result<u64, IngestError> {
        let size = self.file.size();
        let (mut at, mut zeros) = (from, 0);
        while at < self.padding_from.unwrap_or(size) {
            if zeros > MOST_ZEROS {
                return Ok(size);
            }
            let block = self.file.up_to(at, STRETCH)?;
            let length = block.len();
            zeros = if is_zero(block) { zeros + length as u64 } else { 0 };
            let hit = self.sync.find(block);
            match hit {
                Some(hit) => {
                    let place = at + hit as u64;
                    if self.is_plain(place)? {
                        return Ok(place);
                    }
                    at = place + 1;
                }
                // Sync bytes that straddle two blocks are found in the second.
                None if length < STRETCH => break,
                None => at += length as u64 - 1,
            }
            self.file.progress(at, self.context)?;
        }
        // Filling that is longer than any record is that; less may be the rest of a record that was cut.
        let filling = self.padding_from.filter(|&at| at >= from && size - at > LONGEST_RECORD as u64);
        Ok(filling.unwrap_or(size))
    }

    /// Whether a record that was searched for is one: of a known type, and followed by another or the end.
    fn is_plain(&mut self, at: u64) -> Result<bool, IngestError> {
        let Some(length) = self.record_at(at)? else { return Ok(false) };
        let next = at + length as u64;
        Ok(next == self.file.size() || self.type_at(next)?.is_some() || self.is_padding(next))
    }
}

/// Where the records lead to that may begin within another one. Every byte is looked at once, whatever lengths overlap.
struct InnerRecords {
    /// Of records that lead to a place, the one that begins last; by the place's remainder.
    begins: [Option<Lead>; 2 * (LONGEST_RECORD + 1)],
    /// Everything before this place was looked at.
    looked_to: u64,
    /// Definitions that were known then.
    types: usize,
}

#[derive(Debug, Clone, Copy)]
struct Lead {
    from: u64,
    to: u64,
}

impl Default for InnerRecords {
    fn default() -> InnerRecords {
        InnerRecords { begins: [None; 2 * (LONGEST_RECORD + 1)], looked_to: 0, types: 0 }
    }
}

impl InnerRecords {
    /// Looks at the bytes of a record at `at` that it has not seen.
    fn look(&mut self, at: u64, bytes: &[u8], book: &Book<'_, '_>) {
        if self.types != book.types() {
            *self = InnerRecords { types: book.types(), ..InnerRecords::default() };
        }
        let first = self.looked_to.saturating_sub(at) as usize;
        // What begins in the last bytes may go on behind them.
        let last = bytes.len().saturating_sub(HEADER - 1);
        for place in first..last {
            let Some(&[first, second, id]) = bytes.get(place..).and_then(<[u8]>::first_chunk) else { continue };
            let length = if [first, second] == SYNC { book.format(id).and_then(Format::usual_length) } else { None };
            let Some(length) = length else { continue };
            let from = at + place as u64;
            let to = from + length as u64;
            if let Some(slot) = self.begins.get_mut(slot_of(to)) {
                *slot = Some(Lead { from, to });
            }
        }
        self.looked_to = self.looked_to.max(at + last as u64);
    }

    /// Where the last record begins that leads to this place.
    fn leads_to(&self, place: u64) -> Option<u64> {
        self.begins.get(slot_of(place)).copied().flatten().filter(|lead| lead.to == place).map(|lead| lead.from)
    }
}

/// Records that are looked at together reach less than twice the longest one.
fn slot_of(place: u64) -> usize {
    (place % (2 * (LONGEST_RECORD as u64 + 1))) as usize
}

/// Where the zeros or ones begin that a file ends in: a preallocated file has the first, flash memory the second. `None`
/// if there are more than one looks back for: such a file is sparse.
fn padding_from(file: &mut LogFile) -> Result<Option<u64>, IngestError> {
    let size = file.size();
    let mut end = size;
    let mut filling = None;
    while end > 0 {
        if size - end > MOST_ZEROS {
            return Ok(None);
        }
        let start = end.saturating_sub(BLOCK as u64);
        let block = file.up_to(start, (end - start) as usize)?;
        let filling = *filling.get_or_insert(block.last().copied().unwrap_or_default());
        if !matches!(filling, 0 | 0xff) {
            return Ok(Some(end));
        }
        // By large pieces, which a processor compares at once.
        let pieces = block.rchunks(PIECE).map(|piece| (piece, piece.iter().fold(0, |odd, b| odd | (b ^ filling))));
        let mut behind = block.len();
        for (piece, odd) in pieces {
            if odd != 0 {
                let other = piece.iter().rposition(|&b| b != filling).unwrap_or_default();
                return Ok(Some(start + (behind - piece.len() + other) as u64 + 1));
            }
            behind -= piece.len();
        }
        end = start;
    }
    Ok(Some(end))
}
