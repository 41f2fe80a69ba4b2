//! The walk over the frames of a file, and the search for the next one after damage.
//!
//! A frame verified by a checksum is accepted by itself. Any other is accepted if another starts at its end. After
//! damage several must follow one another; the one just before damage is discarded, because it may be a mixture of two.

use crate::bytes::is_zero;
use crate::error::ScanError;
use crate::frame::{Fetched, Framing, Parsed, Trust};
use crate::ledger::{Fate, Ledger};
use crate::limits::{FIRST_BLOCK, MOST_IN_VAIN, MOST_ZEROS, ReadContext};
use crate::source::Source;
use memchr::memmem;
use std::borrow::Cow;

/// Bytes scanned at once.
const BLOCK: usize = 256 << 10;
/// Bytes by which a format recognises the start of a frame.
const LOOK: usize = 16;
/// Number of frames within which a weak frame must lead to a better one.
const HOPS: usize = 3;
/// Budget for false starts in any file, however small, bytes.
const IN_VAIN_AT_LEAST: u64 = 1 << 20;
/// The longest text before the first frame, bytes.
const LONGEST_PREAMBLE: u64 = 64 << 10;

/// What was found in addition to frames.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Scanned {
    /// Bytes of text before the first frame.
    pub preamble: u64,
    /// Bytes of zeros or ones after the last.
    pub padding: u64,
}

/// Scans a file, or bytes in memory, from the first byte to the last. Every byte gets a fate in the ledger.
///
/// # Errors
/// If the file cannot be read, or the user requests a stop.
pub fn scan<S: Source, F: Framing>(
    source: &mut S,
    ledger: &mut Ledger,
    context: &ReadContext<'_>,
    framing: &mut F,
) -> Result<Scanned, ScanError> {
    let name = source.file().map(|file| file.name().to_owned()).unwrap_or_default();
    let size = source.size();
    let (reach, padding_from) = (BLOCK, None);
    let mut scan =
        Scan { name, source, ledger, context, framing, at: 0, size, reach, false_start_cost: 0, padding_from };
    let mut scanned = Scanned::default();
    while scan.at < size {
        scan.block()?;
        scan.source.progress(scan.at, context)?;
        let lost = if scan.at < size { scan.step()? } else { None };
        let Some(lost) = lost else { continue };
        if F::PADDED && scan.is_padding(scan.at)? {
            scanned.padding = size - scan.at;
            scan.pass(Fate::Structure, size);
        } else {
            scanned.preamble += scan.lost(lost)?;
        }
    }
    scan.source.progress(size, context)?;
    Ok(scanned)
}

/// A position without an accepted frame: what it was taken for, and the reason if its content refuted that.
type Lost = (Parsed, Option<Cow<'static, str>>);

struct Scan<'s, 'c, S, F> {
    name: String,
    source: &'s mut S,
    ledger: &'s mut Ledger,
    context: &'s ReadContext<'c>,
    framing: &'s mut F,
    at: u64,
    size: u64,
    /// Bytes that are read at once: few after a long frame, because another may follow.
    reach: usize,
    /// Bytes examined for false starts.
    false_start_cost: u64,
    /// Start of the zeros or ones at the end of the file, once determined; the file size if there are none.
    padding_from: Option<u64>,
}

impl<S: Source, F: Framing> Scan<'_, '_, S, F> {
    /// Takes the frames of a block that have no fault, as nearly all do.
    fn block(&mut self) -> Result<(), ScanError> {
        let need = self.framing.longest() + LOOK;
        let bytes = self.source.ahead(self.at, need, self.reach + need)?;
        self.reach = BLOCK.min(4 * self.reach);
        let is_last = self.at + bytes.len() as u64 == self.size;
        let stop = if is_last { bytes.len() } else { bytes.len().saturating_sub(need) };
        let (mut place, mut start) = (0, None);
        while place < stop {
            let rest = bytes.get(place..).unwrap_or_default();
            let Parsed::Frame(length, trust) = self.framing.parse(rest) else { break };
            let Some((frame, next)) = rest.split_at_checked(length) else { break };
            if !F::START.is_empty() && start.is_none_or(|start| start <= place) {
                start = Some(start_in::<F>(bytes, place + 1));
            }
            let accepted = start.is_none_or(|start| start >= place + length)
                && match trust {
                    Trust::Proven => true,
                    Trust::Agrees => next.is_empty() || self.framing.begins(next),
                    Trust::Shape => {
                        (next.is_empty() || self.framing.begins(next)) && !holds_others(self.framing, frame, trust)
                    }
                    Trust::Weak => false,
                };
            if !accepted {
                break;
            }
            let at = self.at + place as u64;
            match self.framing.take(frame, next, at) {
                Ok(fate) => self.ledger.count(fate, length as u64),
                Err(reason) => self.ledger.damaged(&self.name, at, length as u64, reason),
            }
            place += length;
        }
        self.at += place as u64;
        Ok(())
    }

    /// Examines one frame more closely. Takes it if it is accepted; otherwise returns what it was.
    fn step(&mut self) -> Result<Option<Lost>, ScanError> {
        let parsed = self.parse(self.at)?;
        let (Parsed::Frame(_, trust) | Parsed::Long(_, trust)) = parsed else { return Ok(Some((parsed, None))) };
        if !self.is_accepted(self.at, parsed, trust)? {
            return Ok(Some((parsed, None)));
        }
        let at = self.at;
        let length = match parsed {
            Parsed::Long(length, _) => return self.long(length, parsed),
            Parsed::Frame(length, _) => length,
            Parsed::Cut | Parsed::Not(_) => 0,
        };
        let longest = self.framing.longest();
        let Some((frame, after)) = self.source.up_to(at, longest)?.split_at_checked(length) else {
            return Ok(Some((parsed, None)));
        };
        match self.framing.take(frame, after, at) {
            Ok(fate) => self.ledger.count(fate, length as u64),
            Err(reason) => self.ledger.damaged(&self.name, at, length as u64, reason),
        }
        self.at += length as u64;
        Ok(None)
    }

    /// Takes an accepted long frame.
    fn long(&mut self, length: u64, parsed: Parsed) -> Result<Option<Lost>, ScanError> {
        self.reach = FIRST_BLOCK;
        match self.framing.fetch(self.source, self.at, length)? {
            Fetched::Taken(fate) => self.ledger.count(fate, length),
            Fetched::Damaged(reason) => {
                self.ledger.damaged(&self.name, self.at, length, reason);
                self.framing.breaks();
            }
            Fetched::Refuted(reason) => {
                self.false_start_cost += length;
                return Ok(Some((parsed, Some(reason))));
            }
        }
        self.at += length;
        Ok(None)
    }

    /// Parses what starts at a position.
    fn parse(&mut self, at: u64) -> Result<Parsed, ScanError> {
        let longest = self.framing.longest();
        Ok(match self.framing.parse(self.source.up_to(at, longest)?) {
            Parsed::Long(length, _) if length > self.size - at => Parsed::Cut,
            parsed => parsed,
        })
    }

    fn is_accepted(&mut self, at: u64, parsed: Parsed, trust: Trust) -> Result<bool, ScanError> {
        let length = match parsed {
            Parsed::Frame(length, _) => length,
            Parsed::Long(length, _) => {
                let end = at + length;
                let follows = trust > Trust::Weak && self.may_begin(end)?;
                return Ok(trust == Trust::Proven || follows || self.leads_on(end)?);
            }
            Parsed::Cut | Parsed::Not(_) => return Ok(false),
        };
        let end = at + length as u64;
        if !F::START.is_empty() && self.holds_a_start(at, length)? {
            return Ok(false);
        }
        Ok(match trust {
            Trust::Proven => true,
            Trust::Agrees => self.may_begin(end)? || self.leads_on(end)?,
            Trust::Shape => {
                (self.may_begin(end)? || self.leads_on(end)?) && !self.holds_others_at(at, length, trust)?
            }
            Trust::Weak => self.leads_on(end)? && !self.holds_others_at(at, length, trust)?,
        })
    }

    fn holds_others_at(&mut self, at: u64, length: usize, trust: Trust) -> Result<bool, ScanError> {
        let frame = self.source.bytes(at, length)?.unwrap_or_default();
        Ok(holds_others(self.framing, frame, trust))
    }

    /// Whether another log starts within a frame.
    fn holds_a_start(&mut self, at: u64, length: usize) -> Result<bool, ScanError> {
        let mut from = 1;
        while from < length {
            // Far enough for a log that starts at the last byte.
            let start = start_in::<F>(self.source.up_to(at, length + F::START.len() - 1)?, from);
            let is_one = |parsed| matches!(parsed, Parsed::Frame(_, Trust::Proven) | Parsed::Long(_, Trust::Proven));
            if start < length && is_one(self.parse(at + start as u64)?) {
                return Ok(true);
            }
            from = start.saturating_add(1);
        }
        Ok(false)
    }

    fn is_likely(&mut self, at: u64, length: usize) -> Result<bool, ScanError> {
        let frame = self.source.bytes(at, length)?.unwrap_or_default();
        Ok(self.framing.is_likely(frame))
    }

    /// Whether a frame, the padding or the end of the file may start here.
    fn may_begin(&mut self, at: u64) -> Result<bool, ScanError> {
        Ok(at == self.size
            || self.framing.begins(self.source.up_to(at, LOOK)?)
            || (F::PADDED && self.is_padding(at)?))
    }

    /// Whether the next few frames lead to a better than weak one, or to the end of the file.
    fn leads_on(&mut self, mut at: u64) -> Result<bool, ScanError> {
        for _ in 0..HOPS {
            match self.parse(at)? {
                Parsed::Frame(length, Trust::Weak) => at += length as u64,
                Parsed::Long(length, Trust::Weak) => at += length,
                Parsed::Frame(..) | Parsed::Long(..) => return Ok(true),
                Parsed::Cut => return Ok(at == self.size || self.framing.begins(self.source.up_to(at, LOOK)?)),
                Parsed::Not(_) => return Ok(at == self.size),
            }
        }
        Ok(false)
    }

    /// Whether the walk may resume here after damage.
    fn is_certain(&mut self, at: u64) -> Result<bool, ScanError> {
        let mut place = at;
        for hop in 0..F::PROOF {
            let parsed = self.parse(place)?;
            self.false_start_cost += match parsed {
                Parsed::Frame(looked, Trust::Shape) | Parsed::Not(looked) => looked as u64,
                // Little of it was examined.
                Parsed::Frame(_, Trust::Weak) | Parsed::Long(..) => LOOK as u64,
                Parsed::Frame(..) | Parsed::Cut => 1,
            };
            match parsed {
                Parsed::Frame(_, Trust::Proven) | Parsed::Long(_, Trust::Proven) => return Ok(true),
                Parsed::Frame(_, Trust::Weak) | Parsed::Long(_, Trust::Weak) if hop == 0 => return Ok(false),
                Parsed::Long(length, _) => {
                    let longest = self.framing.longest();
                    if self.framing.is_likely(self.source.up_to(place, longest)?) {
                        return self.may_begin(place + length);
                    }
                    place += length;
                }
                Parsed::Frame(length, trust) => {
                    if trust == Trust::Shape && self.holds_others_at(place, length, trust)? {
                        return Ok(false);
                    }
                    if trust == Trust::Agrees && self.is_likely(place, length)? {
                        return Ok(true);
                    }
                    place += length as u64;
                }
                Parsed::Cut => return Ok(hop > 0 && self.may_begin(place)?),
                Parsed::Not(_) => return Ok(hop > 0 && (place == self.size || F::PADDED && self.is_padding(place)?)),
            }
        }
        self.may_begin(place)
    }

    /// No frame is accepted here: resumes at the next one. Returns the number of bytes that were text before the first
    /// frame.
    fn lost(&mut self, (parsed, reason): Lost) -> Result<u64, ScanError> {
        if let Parsed::Not(looked) | Parsed::Frame(looked, Trust::Weak | Trust::Shape) = parsed {
            self.false_start_cost += looked as u64;
        }
        let longest = self.framing.longest();
        let reason = match reason {
            Some(reason) => reason,
            None => self.framing.fault(self.source.up_to(self.at, longest)?),
        };
        let next = self.search(self.at + 1)?;
        if self.at == 0 && next < self.size.min(LONGEST_PREAMBLE) && self.is_preamble(next as usize)? {
            self.pass(Fate::Skipped, next);
            return Ok(next);
        }
        let length = next - self.at;
        if parsed == Parsed::Cut && next == self.size && !F::STATES_ITS_END {
            self.ledger.cut(&self.name, self.at, length, "the log ends inside a frame");
        } else {
            self.ledger.damaged(&self.name, self.at, length, reason);
        }
        self.framing.breaks();
        self.at = next;
        Ok(0)
    }

    /// The start of the next certain frame; if there is none, the padding or the end of the file.
    fn search(&mut self, from: u64) -> Result<u64, ScanError> {
        let (mut at, mut most, mut zeros) = (from, FIRST_BLOCK, 0);
        while at < self.size && zeros <= MOST_ZEROS && self.false_start_cost < self.patience() {
            let longest = self.framing.longest();
            let block = self.source.up_to(at, most + longest)?;
            let head = block.get(..most).unwrap_or(block);
            zeros = if is_zero(head) { zeros + head.len() as u64 } else { 0 };
            let step = head.len();
            match self.framing.candidate(block, 0).filter(|found| *found < step) {
                Some(found) => {
                    at += found as u64;
                    if self.is_certain(at)? {
                        return Ok(at);
                    }
                    (at, most) = (at + 1, FIRST_BLOCK);
                }
                None => {
                    at += step.max(1) as u64;
                    most = BLOCK.min(2 * most);
                }
            }
            self.source.progress(at.min(self.size), self.context)?;
        }
        // Padding shorter than a frame may be the rest of a truncated one.
        let filling = F::PADDED && self.is_padding(self.size - 1)?;
        let padding = self.padding_from.filter(|at| filling && self.size - at > self.framing.longest() as u64);
        Ok(padding.map_or(self.size, |at| at.max(from)))
    }

    fn patience(&self) -> u64 {
        IN_VAIN_AT_LEAST + MOST_IN_VAIN.saturating_mul(self.size)
    }

    fn is_preamble(&mut self, length: usize) -> Result<bool, ScanError> {
        let bytes = self.source.bytes(0, length)?.unwrap_or_default();
        Ok(self.framing.is_preamble(bytes))
    }

    /// Whether only zeros, or only ones, follow up to the end of the file.
    fn is_padding(&mut self, at: u64) -> Result<bool, ScanError> {
        let from = match self.padding_from {
            Some(from) => from,
            None => padding_from(self.source)?,
        };
        self.padding_from = Some(from);
        Ok((from..self.size).contains(&at))
    }

    fn pass(&mut self, fate: Fate, to: u64) {
        self.ledger.count(fate, to - self.at);
        self.at = to;
    }
}

/// The position at or after `from` where the first bytes of a log are found; past the end if there is none.
fn start_in<F: Framing>(bytes: &[u8], from: usize) -> usize {
    memmem::find(bytes.get(from..).unwrap_or_default(), F::START).map_or(usize::MAX, |at| from + at)
}

/// Whether this frame contains another that shows its length to be wrong: one that ends exactly where it ends, or in a
/// weak frame any that is self-consistent.
fn holds_others<F: Framing>(framing: &F, frame: &[u8], trust: Trust) -> bool {
    let mut from = 1;
    while let Some(inner) = framing.candidate(frame, from) {
        let rest = frame.get(inner..).unwrap_or_default();
        let length = framing.length(rest).unwrap_or(usize::MAX);
        let reaches = length == rest.len() || (trust == Trust::Weak && length < rest.len());
        if reaches
            && let Parsed::Frame(_, found) = framing.parse(rest)
            && (found >= Trust::Agrees || (length == rest.len() && found > Trust::Weak))
            && framing.is_likely(rest.get(..length).unwrap_or_default())
        {
            return true;
        }
        from = inner + 1;
    }
    false
}

/// Start of the zeros or ones at the end of a file: preallocated files end in zeros, flash memory in ones. If there are
/// more than the reader looks back for, the file is sparse and has no padding.
fn padding_from(source: &mut impl Source) -> Result<u64, ScanError> {
    let size = source.size();
    let mut end = size;
    let mut filling = None;
    while end > 0 && size - end <= MOST_ZEROS {
        let start = end.saturating_sub(BLOCK as u64);
        let block = source.up_to(start, (end - start) as usize)?;
        let filling = *filling.get_or_insert(block.last().copied().unwrap_or_default());
        if !matches!(filling, 0 | 0xff) {
            return Ok(size);
        }
        if let Some(other) = block.iter().rposition(|b| *b != filling) {
            return Ok(start + other as u64 + 1);
        }
        end = start;
    }
    Ok(if end == 0 { 0 } else { size })
}
