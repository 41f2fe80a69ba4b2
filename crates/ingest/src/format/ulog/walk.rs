//! The walk over the messages of a ULog, one after the other, whole or damaged.
//!
//! A message that does not vouch for itself must lead to one that does, or at least have none inside that does.
//! Where neither holds, the walk goes on at the next byte from which it can be sure again.

use super::MAGIC;
use super::record::{DAMAGED_FORMAT, FLAG_BITS, HEAD, Kind, LONGEST, Trust, is_printable};
use super::session::Session;
use crate::bytes::is_zero;
use crate::decode::Tally;
use crate::error::IngestError;
use crate::format::MOST_ZEROS;
use crate::format::file::LogFile;
use crate::ledger::{Fate, Ledger};
use crate::reader::ReadContext;
use flight::{Notices, Severity};
use memchr::memmem;
use std::cell::Cell;
use std::cmp::Ordering;

/// Said of a file that does not begin as a ULog does.
pub(super) const WRONG_START: &str = "the bytes that begin the file are wrong";
/// Magic, version and time in front of the first message.
pub(super) const START: u64 = 16;
/// Messages that are looked at to see where one leads.
const HOPS: usize = 4;
/// Bytes that are looked at ahead of where the walk stands.
const MARGIN: usize = (HOPS + 2) * LONGEST;
/// Bytes held at a time.
const BLOCK: usize = 512 << 10;
/// Bytes behind the beginning of another log in which this one may go on.
const SOUGHT: usize = 64 << 10;
/// Bytes of a message that are looked at from afar.
const GLANCE: usize = 32;
/// As many zero bytes at the end of a search have a reason of their own.
const TELLING_ZEROS: usize = 512;
const ZEROS: &str = "zero bytes where messages should stand";
const ENDS_INSIDE: &str = "the log ends inside a message";

/// A walk in progress.
pub(super) struct Walk<'w> {
    /// File name for the ledger.
    name: &'w str,
    ledger: &'w mut Ledger,
    /// Where the log begins in the file.
    base: u64,
    pub(super) at: u64,
    /// Another log begins where the walk stands.
    another: bool,
    /// Something of this log was read.
    pub(super) found_any: bool,
    /// Why the walk is searching, if it is.
    lost: Option<String>,
    /// Zero bytes passed in the search.
    zeros: u64,
    /// Where data were appended, falling.
    joints: Vec<u64>,
    wrong_joints: Tally,
}

/// Bytes of the file that begin where a block begins.
#[derive(Clone, Copy)]
struct View<'v> {
    bytes: &'v [u8],
    start: u64,
    /// Whether they reach the end of the file.
    whole: bool,
    /// Where another log begins in them, at or behind the place where the walk stands.
    log: Option<usize>,
    /// From where to where all bytes may stand in a format; the one behind them may not.
    printable: &'v Cell<(usize, usize)>,
}

/// A message within a view.
struct Message<'v> {
    letter: u8,
    body: &'v [u8],
    end: usize,
}

impl<'v> View<'v> {
    /// The message at `at`; `None` if it reaches beyond the view.
    #[inline]
    fn message(self, at: usize) -> Option<Message<'v>> {
        let &[low, high, letter] = self.bytes.get(at..)?.first_chunk()?;
        let end = at + HEAD + usize::from(u16::from_le_bytes([low, high]));
        Some(Message { letter, body: self.bytes.get(at + HEAD..end)?, end })
    }

    /// Whether all these bytes may stand in a format. How far that goes is remembered: of many formats that seem to
    /// reach over one wrong byte, each would be read up to it.
    fn is_printable(self, from: usize, to: usize) -> bool {
        let (first, mut end) = self.printable.get();
        if !(first..end).contains(&from) {
            let rest = self.bytes.get(from..).unwrap_or_default();
            end = from + rest.iter().take_while(|b| is_printable(b)).count();
            self.printable.set((from, end));
        }
        to <= end
    }
}

impl<'w> Walk<'w> {
    pub(super) fn new(name: &'w str, ledger: &'w mut Ledger) -> Walk<'w> {
        Walk {
            name,
            ledger,
            base: 0,
            at: 0,
            another: false,
            found_any: false,
            lost: None,
            zeros: 0,
            joints: vec![],
            wrong_joints: Tally::default(),
        }
    }

    /// Takes the first bytes of a log; `head` are those and as many more, if there are.
    pub(super) fn begin(&mut self, head: &[u8], intact: bool) {
        let another = next_log(head, 0).filter(|_| !intact).map_or(START, |log| log as u64);
        let length = START.min(head.len() as u64).min(another);
        match (intact, length == START) {
            (true, true) => self.ledger.count(Fate::Structure, length),
            (true, false) => self.ledger.damaged(self.name, self.at, length, "the log ends inside its header"),
            (false, _) => self.ledger.damaged(self.name, self.at, length, WRONG_START),
        }
        (self.base, self.another, self.found_any) = (self.at, false, false);
        (self.lost, self.zeros) = (None, 0);
        self.joints.clear();
        self.at += length;
    }

    /// All bytes up to the end of the file are of no use.
    pub(super) fn leave(&mut self, size: u64, reason: &str) {
        if reason == ENDS_INSIDE {
            self.ledger.cut(self.name, self.at, size - self.at, reason);
        } else {
            self.ledger.damaged(self.name, self.at, size - self.at, reason);
        }
        self.at = size;
    }

    /// From where the walk stands to the end of the file, or to where another log begins.
    pub(super) fn run(
        &mut self,
        file: &mut LogFile,
        context: &ReadContext<'_>,
        session: &mut Session<'_, '_>,
    ) -> Result<(), IngestError> {
        let size = file.size();
        while self.at < size && !self.another {
            let start = self.at;
            let there = (size - start).min(BLOCK as u64) as usize;
            let bytes = file.bytes(start, there)?.unwrap_or_default();
            let (whole, log, printable) = (start + there as u64 == size, next_log(bytes, 0), &Cell::default());
            self.block(View { bytes, start, whole, log, printable }, session);
            if !self.another && (self.at == start || self.zeros > MOST_ZEROS) {
                let reason = self.lost.take().unwrap_or_else(|| ENDS_INSIDE.to_owned());
                self.leave(size, &reason);
            }
            file.progress(self.at, context)?;
        }
        Ok(())
    }

    pub(super) fn conclude(&self, notices: &mut Notices) {
        let Tally { count, first } = &self.wrong_joints;
        if *count > 0 {
            let text = format!("places where data should have been appended and were not; the first: {first}");
            notices.push(Severity::Warning, "bad-offset", self.name, *count, text);
        }
    }

    /// Walks until so little is left of the view that one cannot look ahead, or to the end of the file.
    fn block(&mut self, mut view: View<'_>, session: &mut Session<'_, '_>) {
        let stop = if view.whole { view.bytes.len() } else { view.bytes.len().saturating_sub(MARGIN) };
        let mut at = 0;
        if let Some(reason) = self.lost.take() {
            at = self.go_on(view, (0, 0), stop, reason, session);
            view.log = view.log.filter(|&log| log >= at).or_else(|| next_log(view.bytes, at));
        }
        // Behind `stop`, too, stand messages that need no look ahead.
        while !self.another {
            let sure = self.sure(view, at, session);
            if sure.is_none()
                && view.log == Some(at)
                && let Some(next) = self.resumes(view, at, session)
            {
                self.damage(view, at, next, "the beginning of a log in the midst of this one, which goes on behind it");
                at = next;
                view.log = next_log(view.bytes, at);
                continue;
            }
            self.another = sure.is_none() && view.log == Some(at);
            let next = sure.or_else(|| (at < stop && !self.another).then(|| self.step(view, at, stop, session)));
            let Some(next) = next else { break };
            at = next;
            if view.log.is_some_and(|log| log < at) {
                view.log = next_log(view.bytes, at);
            }
        }
        self.at = view.start + at as u64;
    }

    /// A message of a topic that vouches for itself, as nearly all do; where the next one may be.
    #[inline]
    fn sure(&mut self, view: View<'_>, at: usize, session: &mut Session<'_, '_>) -> Option<usize> {
        let message = view.message(at).filter(|message| message.letter == Kind::DATA && self.joints.is_empty())?;
        // One behind which nothing stands that may be a message is looked at more closely.
        let follows = view.bytes.get(message.end + 2).is_none_or(|&letter| Kind::of(letter).is_some());
        if !follows || view.log.is_some_and(|log| log < message.end) {
            return None;
        }
        let fate = session.sure_data(message.body)?;
        self.ledger.count(fate, (message.end - at) as u64);
        self.found_any = true;
        Some(message.end)
    }

    /// One message, or what stands in its place; where the next one may be.
    fn step(&mut self, view: View<'_>, at: usize, stop: usize, session: &mut Session<'_, '_>) -> usize {
        let Some(message) = view.message(at) else {
            return self.go_on(view, (at, at + 1), stop, ENDS_INSIDE.to_owned(), session);
        };
        let Message { letter, body, end } = message;
        let kind = Kind::of(letter);
        let begins = kind == Some(Kind::FlagBits) && view.start + at as u64 == self.base + START;
        if begins && body.len() > FLAG_BITS && !leads(view, end, session) {
            // They have been of one length so far.
            let end = at + HEAD + FLAG_BITS;
            self.damage(view, at, at + HEAD, "flag bits of a wrong length");
            let message = Message { letter, body: body.get(..FLAG_BITS).unwrap_or_default(), end };
            self.take(view, at + HEAD, &message, kind, session);
            return end;
        }
        let trust = match kind {
            Some(Kind::FlagBits) if begins && body.len() == FLAG_BITS => Trust::Sure,
            Some(Kind::FlagBits) if begins && body.len() > FLAG_BITS => Trust::Fits,
            Some(Kind::Format) if !view.is_printable(at + HEAD, end) => Trust::Wrong(DAMAGED_FORMAT),
            Some(kind) => session.judge(kind, body, usize::MAX),
            None => Trust::Weak,
        };
        if let Some(log) = view.log.filter(|&log| log < end)
            && !(matches!(trust, Trust::Sure | Trust::Fits) && carries(view, log, end, session))
        {
            self.damage(view, at, log, "a message was cut where another log begins");
            return log;
        }
        if !self.joints.is_empty()
            && let Some(joint) =
                self.joint(view, at, end, trust == Trust::Sure && is_certain(view, end, session), session)
        {
            self.damage(view, at, joint, "a message was cut where data were appended later");
            return joint;
        }
        let undisputed = || !(at + 1..end).any(|inside| is_certain(view, inside, session));
        let stands = match trust {
            Trust::Sure | Trust::Fits => leads(view, end, session) || undisputed(),
            Trust::Weak | Trust::Wrong(_) => leads(view, end, session) && undisputed(),
        };
        match (trust, stands) {
            (Trust::Wrong(reason), true) => self.damage(view, at, end, reason),
            (_, true) => self.take(view, at, &message, kind, session),
            (Trust::Wrong(reason), false) => {
                return self.go_on(view, (at, at + 1), stop, reason.to_owned(), session);
            }
            (_, false) => {
                let reason = "what stands here is no message, or one whose length leads nowhere";
                return self.go_on(view, (at, at + 1), stop, reason.to_owned(), session);
            }
        }
        end
    }

    #[inline]
    fn take(
        &mut self,
        view: View<'_>,
        at: usize,
        message: &Message<'_>,
        kind: Option<Kind>,
        session: &mut Session<'_, '_>,
    ) {
        let taken = match kind {
            Some(kind) => session.take(kind, message.body),
            None => Ok(session.take_unknown(message.letter, message.body.len())),
        };
        self.found_any = true;
        match taken {
            Ok(fate) => self.ledger.count(fate, (message.end - at) as u64),
            Err(reason) => self.damage(view, at, message.end, &reason),
        }
        if kind == Some(Kind::FlagBits) {
            self.take_joints(session);
        }
    }

    fn take_joints(&mut self, session: &Session<'_, '_>) {
        let offsets = session.flags.offsets.iter().filter(|&&offset| offset > 0);
        if !session.flags.appended() {
            offsets
                .for_each(|offset| self.wrong_joints.add(|| format!("byte {offset}, without the flag that says so")));
            return;
        }
        self.joints = offsets.map(|offset| self.base.saturating_add(*offset)).collect();
        self.joints.sort_unstable_by(|a, b| b.cmp(a));
        self.joints.dedup();
    }

    /// Where this log goes on behind the first bytes of one, of which no more is there, as where blocks of a disk were mixed up:
    /// a log subscribes to a topic before there are messages of it.
    fn resumes(&self, view: View<'_>, log: usize, session: &Session<'_, '_>) -> Option<usize> {
        session.last_stamp.us?;
        let mut at = log + START as usize;
        let of_head = |kind| matches!(kind, Kind::FlagBits | Kind::Format | Kind::Info | Kind::InfoPart);
        let of_head = |kind| of_head(kind) || matches!(kind, Kind::Parameter | Kind::DefaultParameter);
        let trust = |kind, body: &[u8]| match kind {
            Kind::FlagBits => Trust::Sure,
            kind => session.judge(kind, body, GLANCE),
        };
        while let Some(message) = view.message(at)
            && let Some(kind) = Kind::of(message.letter).filter(|&kind| of_head(kind))
            && !matches!(trust(kind, message.body), Trust::Wrong(_))
        {
            at = message.end;
        }
        // The last of them may be cut, and reach over what follows.
        let own_last = at.saturating_sub(LONGEST).max(log + START as usize);
        let is_own = |place: &usize| {
            let message = view.message(*place).filter(|message| message.letter == Kind::DATA);
            message.is_some_and(|message| {
                session.judge(Kind::Data, message.body, GLANCE) == Trust::Sure && session.is_near(message.body)
            })
        };
        let subscribes = |place: &usize| {
            let message = view.message(*place).filter(|message| Kind::of(message.letter) == Some(Kind::Subscribe));
            let trust = message.map(|message| session.judge(Kind::Subscribe, message.body, GLANCE));
            matches!(trust, Some(Trust::Sure | Trust::Fits))
        };
        let end = view.bytes.len().min(at + SOUGHT);
        let own = (own_last..end).find(is_own)?;
        (log..own).all(|place| !subscribes(&place)).then_some(own)
    }

    /// Where, inside of `at..end`, data were appended, unless the message there `is_whole`. That the file says so is not enough.
    fn joint(
        &mut self,
        view: View<'_>,
        at: usize,
        end: usize,
        is_whole: bool,
        session: &Session<'_, '_>,
    ) -> Option<usize> {
        let place = |at: usize| view.start + at as u64;
        while let Some(&joint) = self.joints.last().filter(|&&joint| joint < place(end)) {
            self.joints.pop();
            if joint <= place(at) {
                continue;
            }
            let within = (joint - view.start) as usize;
            if !is_whole && leads(view, within, session) {
                return Some(within);
            }
            self.wrong_joints.add(|| format!("byte {joint}"));
        }
        None
    }

    /// Nothing can be made of the bytes at `at`: goes on at the first certain message at or behind `from`.
    fn go_on(
        &mut self,
        view: View<'_>,
        (at, from): (usize, usize),
        stop: usize,
        reason: String,
        session: &Session<'_, '_>,
    ) -> usize {
        let empty = is_zero(view.bytes.get(at..).unwrap_or_default());
        let found = if empty { None } else { (from..stop).find(|&place| is_certain(view, place, session)) };
        let next = found.unwrap_or(stop).max(at);
        let passed = view.bytes.get(at..next).unwrap_or_default();
        let zeros = if empty { next - at } else { passed.iter().rev().take_while(|&&b| b == 0).count() };
        self.zeros = if zeros == passed.len() { self.zeros + zeros as u64 } else { 0 };
        let zeros_from = if zeros < TELLING_ZEROS { next } else { next - zeros };
        self.damage(view, at, zeros_from, &reason);
        self.damage(view, zeros_from, next, ZEROS);
        self.lost = found.is_none().then(|| if zeros_from < next { ZEROS.to_owned() } else { reason });
        next
    }

    fn damage(&mut self, view: View<'_>, from: usize, to: usize, reason: &str) {
        let (at, length) = (view.start + from as u64, to.saturating_sub(from) as u64);
        if reason == ENDS_INSIDE && view.whole && to == view.bytes.len() {
            self.ledger.cut(self.name, at, length, reason);
        } else if length > 0 {
            self.ledger.damaged(self.name, at, length, reason);
        }
    }
}

/// Where, at or behind `from`, another log begins, as where files were put one behind another.
fn next_log(bytes: &[u8], from: usize) -> Option<usize> {
    let rest = bytes.get(from..)?;
    memmem::find_iter(rest, MAGIC).map(|at| from + at).find(|&log| begins_log(bytes, log))
}

/// Whether a definition stands behind the magic at `log`, as far as the bytes reach.
fn begins_log(bytes: &[u8], log: usize) -> bool {
    let first = log + START as usize;
    let Some(&[low, high, letter]) = bytes.get(first..).and_then(|message| message.first_chunk()) else { return true };
    let length = usize::from(u16::from_le_bytes([low, high]));
    match Kind::of(letter) {
        Some(Kind::FlagBits) => length >= FLAG_BITS,
        Some(Kind::Format | Kind::Info | Kind::InfoPart | Kind::Parameter) => {
            bytes.get(first + HEAD + length + 2).is_none_or(|&letter| Kind::of(letter).is_some())
        }
        _ => false,
    }
}

/// Whether a message that fits carries the log inside of it as its content: behind its `end`, this log goes on, and not the
/// other.
fn carries(view: View<'_>, log: usize, end: usize, session: &Session<'_, '_>) -> bool {
    let mut at = log + START as usize;
    while at < end
        && let Some(message) = view.message(at).filter(|message| Kind::of(message.letter).is_some())
    {
        at = message.end;
    }
    let is_data = view.bytes.get(end + 2) == Some(&Kind::DATA);
    let this_goes_on = leads(view, end, session);
    match at.cmp(&end) {
        Ordering::Less => this_goes_on,
        // Where a message of the other log, too, begins at the end, only one of a topic tells that it is of this log.
        Ordering::Equal => is_data && this_goes_on,
        Ordering::Greater => this_goes_on && (is_certain(view, end, session) && is_data || !leads(view, at, session)),
    }
}

/// Whether a message begins at `at` beyond doubt, or a log: one that vouches for itself, at least by its content, and leads on.
fn is_certain(view: View<'_>, at: usize, session: &Session<'_, '_>) -> bool {
    let Some(kind) = view.bytes.get(at + 2).and_then(|&letter| Kind::of(letter)) else { return view.log == Some(at) };
    let Some(message) = view.message(at) else { return false };
    let trust = session.judge(kind, message.body, GLANCE);
    if kind == Kind::Format && trust == Trust::Fits && !view.is_printable(at + HEAD, message.end) {
        return false;
    }
    match (kind, trust) {
        (Kind::Sync, Trust::Sure) => true,
        (Kind::Data, Trust::Sure) if session.is_near(message.body) => true,
        (_, Trust::Sure | Trust::Fits) => leads(view, message.end, session),
        (_, Trust::Weak | Trust::Wrong(_)) => false,
    }
}

/// Whether messages begin at `at`: within a few, one vouches for itself or the file ends, or all have a right content.
fn leads(view: View<'_>, mut at: usize, session: &Session<'_, '_>) -> bool {
    let mut fit = true;
    for _ in 0..HOPS {
        if at == view.bytes.len() {
            return view.whole;
        }
        if view.log == Some(at) {
            return true;
        }
        let Some(message) = view.message(at) else {
            // Cut by the end of the file.
            let letter = view.bytes.get(at + 2);
            return view.whole && letter.is_none_or(|&letter| Kind::of(letter).is_some());
        };
        match Kind::of(message.letter).map(|kind| session.judge(kind, message.body, GLANCE)) {
            Some(Trust::Sure) => return true,
            // The format of its topic may be wrong.
            Some(Trust::Wrong(_)) if message.letter == Kind::DATA && session.is_known(message.body) => {
                (at, fit) = (message.end, false);
            }
            Some(Trust::Wrong(_)) => return false,
            Some(Trust::Fits) => at = message.end,
            // Zeros are no messages, and lead anywhere.
            None if message.letter == 0 && message.body.is_empty() => return false,
            Some(Trust::Weak) | None => (at, fit) = (message.end, false),
        }
    }
    fit
}
