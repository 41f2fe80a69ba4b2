//! The frames of a ULog: its messages, and the log headers, of which a file may have several.

use super::boots::Boots;
use super::session::Session;
use super::ulog_record::{HEAD, Kind, LONGEST, Trust as Judged};
use super::{MAGIC, MOST_LOGS, START, VERSION};
use crate::decode::Topics;
use flight::{Code, LogHealth, Notices};
use logscan::{Fate, Framing, Parsed, Trust};
use std::borrow::Cow;

/// The logs of a file, routed to the topics.
pub(super) struct Messages<'f, 'w> {
    file: &'f str,
    notices: &'f mut Notices,
    health: &'f mut LogHealth,
    boots: &'f mut Boots,
    /// State of the log that is being read; always present.
    session: Option<Session<'f, 'w>>,
    version: u8,
    /// Log headers so far, and logs with at least one message.
    heads: u64,
    logs: u64,
    /// The log that is being read has a message.
    is_begun: bool,
}

impl<'f, 'w> Messages<'f, 'w> {
    pub(super) fn new(
        file: &'f str,
        topics: &'f mut Topics<'w>,
        boots: &'f mut Boots,
        notices: &'f mut Notices,
        health: &'f mut LogHealth,
    ) -> Messages<'f, 'w> {
        let session = Some(Session::new(topics));
        Messages { file, notices, health, boots, session, version: VERSION, heads: 0, logs: 0, is_begun: false }
    }

    /// Another log starts with these bytes: magic, version, and its start time by the clock since boot.
    fn begin(&mut self, head: &[u8]) {
        self.end_log();
        self.heads += 1;
        self.version = head.get(MAGIC.len()).copied().unwrap_or(VERSION);
        let began_us = head.get(MAGIC.len() + 1..).and_then(|time| time.first_chunk().copied().map(u64::from_le_bytes));
        let offset_us = self.boots.next_log(began_us);
        self.session = self.session.take().map(|session| session.next(offset_us));
    }

    /// The header of the first log is lost.
    fn begin_headless(&mut self) {
        let offset_us = self.boots.next_log(None);
        self.session.iter_mut().for_each(|session| session.offset_us = offset_us);
    }

    fn end_log(&mut self) {
        let Some(session) = &mut self.session else { return };
        if self.heads + u64::from(self.is_begun) == 0 {
            return;
        }
        self.boots.latest(session.last_stamp.us);
        if self.version > VERSION {
            let version = self.version;
            let text =
                format!("the log has version {version}; parts that are new since version {VERSION} are not read");
            self.notices.push(Code::UnknownRecord, self.file, 1, text);
        }
        session.conclude(self.file, self.notices);
        session.hand_on();
        self.health.undecodable += session.unplaced.count;
        self.health.extras.extend(session.gathered.extras());
        let about = std::mem::take(&mut session.gathered).about();
        if self.health.about.is_empty() {
            self.health.about = about;
        }
        self.health.format = format!("ULog {}", self.version);
        self.logs += u64::from(std::mem::take(&mut self.is_begun));
    }

    /// Ends the last log of the file.
    pub(super) fn finish(mut self) {
        self.end_log();
        self.health.format = format!("ULog {}", self.version);
        if self.logs > 1 {
            let text = "this file holds several logs, one after another; all were read";
            self.notices.push(Code::SeveralSessions, self.file, self.logs, text);
        }
    }
}

impl Framing for Messages<'_, '_> {
    const START: &'static [u8] = MAGIC;

    fn longest(&self) -> usize {
        LONGEST
    }

    #[inline]
    fn parse(&self, bytes: &[u8]) -> Parsed {
        let Some(&[low, high, letter]) = bytes.first_chunk() else { return Parsed::Cut };
        if bytes.starts_with(MAGIC) {
            return self.head(bytes);
        }
        let end = HEAD + usize::from(u16::from_le_bytes([low, high]));
        let kind = Kind::of(letter);
        let Some(body) = bytes.get(HEAD..end) else {
            return if kind.is_some() { Parsed::Cut } else { Parsed::Not(HEAD) };
        };
        match kind.map(|kind| self.session.as_ref().map_or(Judged::Weak, |session| session.judge(kind, body))) {
            // A defined name, a text of known form or a magic number.
            Some(Judged::Sure) if matches!(kind, Some(Kind::Subscribe | Kind::Format | Kind::Sync)) => {
                Parsed::Frame(end, Trust::Proven)
            }
            Some(Judged::Sure) => Parsed::Frame(end, Trust::Agrees),
            Some(Judged::Fits) => Parsed::Frame(end, Trust::Shape),
            // Only the content may be wrong, and the length right.
            Some(Judged::Weak | Judged::Wrong(_)) => Parsed::Frame(end, Trust::Weak),
            // Zeros prove nothing.
            None if letter != 0 => Parsed::Frame(end, Trust::Weak),
            None => Parsed::Not(HEAD),
        }
    }

    #[inline]
    fn begins(&self, bytes: &[u8]) -> bool {
        bytes.get(HEAD - 1).is_none_or(|letter| Kind::of(*letter).is_some()) || bytes.starts_with(MAGIC)
    }

    fn length(&self, bytes: &[u8]) -> Option<usize> {
        let &[low, high, letter] = bytes.first_chunk()?;
        Kind::of(letter).map(|_| HEAD + usize::from(u16::from_le_bytes([low, high])))
    }

    fn candidate(&self, block: &[u8], from: usize) -> Option<usize> {
        let third = MAGIC.get(HEAD - 1);
        let may_be = |letter: &u8| Kind::of(*letter).is_some() || Some(letter) == third;
        block.get(from + HEAD - 1..)?.iter().position(may_be).map(|at| from + at)
    }

    fn is_likely(&self, message: &[u8]) -> bool {
        let body = message.get(HEAD..).unwrap_or_default();
        message.get(HEAD - 1) != Some(&Kind::DATA) || self.session.as_ref().is_some_and(|session| session.is_near(body))
    }

    #[inline]
    fn take(&mut self, message: &[u8], _: &[u8], _: u64) -> Result<Fate, Cow<'static, str>> {
        if message.starts_with(MAGIC) {
            self.begin(message);
            return Ok(Fate::Structure);
        }
        let (letter, body) =
            (message.get(HEAD - 1).copied().unwrap_or_default(), message.get(HEAD..).unwrap_or_default());
        if self.heads == 0 && !self.is_begun {
            self.begin_headless();
        }
        self.is_begun = true;
        let Some(session) = &mut self.session else { return Ok(Fate::Skipped) };
        match Kind::of(letter) {
            Some(kind) => match session.judge(kind, body) {
                Judged::Wrong(reason) => Err(reason.into()),
                _ => Ok(session.take(kind, body)?),
            },
            None => Ok(session.take_unknown(letter, body.len())),
        }
    }

    fn fault(&self, bytes: &[u8]) -> Cow<'static, str> {
        let body = self.length(bytes).and_then(|end| bytes.get(HEAD..end));
        let kind = bytes.get(HEAD - 1).and_then(|letter| Kind::of(*letter));
        match (kind.zip(body), &self.session) {
            (Some((kind, body)), Some(session)) => match session.judge(kind, body) {
                Judged::Wrong(reason) => reason.into(),
                _ => "a message with a wrong length".into(),
            },
            _ => NO_MESSAGE.into(),
        }
    }
}

/// Reported where no message starts.
pub(super) const NO_MESSAGE: &str = "bytes that are not a message";

impl Messages<'_, '_> {
    /// The first bytes of a log, if a definition follows them.
    fn head(&self, bytes: &[u8]) -> Parsed {
        let Some(rest) = bytes.get(START..) else { return Parsed::Cut };
        let is_definition =
            |kind| matches!(kind, Kind::FlagBits | Kind::Format | Kind::Info | Kind::InfoPart | Kind::Parameter);
        let follows = rest.get(HEAD - 1).is_none_or(|letter| Kind::of(*letter).is_some_and(is_definition));
        let is_one = follows && self.heads < MOST_LOGS;
        if is_one { Parsed::Frame(START, Trust::Proven) } else { Parsed::Not(START) }
    }
}
