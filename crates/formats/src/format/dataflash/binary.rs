//! The frames of a binary log: its records. Only the next record proves a record, except for definitions that are
//! self-consistent.

use super::dataflash_record::{FMT_ID, FMT_LENGTH, Format, HEADER, LONGEST_RECORD, SYNC};
use super::dataflash_session::Session;
use logscan::{Fate, Framing, Parsed, Trust};
use memchr::memmem;
use std::borrow::Cow;

/// Reported where no record starts.
pub(super) const NO_RECORD: &str = "bytes that are not a record";

/// The records of a log, passed to its session.
pub(super) struct Records<'b, 't, 's> {
    session: &'b mut Session<'t, 's>,
    sync: memmem::Finder<'static>,
}

impl<'b, 't, 's> Records<'b, 't, 's> {
    pub(super) fn new(session: &'b mut Session<'t, 's>) -> Records<'b, 't, 's> {
        Records { session, sync: memmem::Finder::new(&SYNC) }
    }
}

impl Framing for Records<'_, '_, '_> {
    const PROOF: usize = 1;
    const PADDED: bool = true;

    fn longest(&self) -> usize {
        LONGEST_RECORD
    }

    #[inline]
    fn parse(&self, bytes: &[u8]) -> Parsed {
        let id = match *bytes {
            [first, second, id, ..] if [first, second] == SYNC => id,
            [] | [_] | [_, _] if SYNC.starts_with(bytes) => return Parsed::Cut,
            _ => return Parsed::Not(HEADER),
        };
        if id == FMT_ID && bytes.get(..FMT_LENGTH).is_some_and(Format::agrees) {
            return Parsed::Frame(FMT_LENGTH, Trust::Proven);
        }
        match self.session.format(id).and_then(Format::length) {
            Some(length) if length > bytes.len() => Parsed::Cut,
            Some(length) => Parsed::Frame(length, Trust::Shape),
            None => Parsed::Not(HEADER),
        }
    }

    #[inline]
    fn begins(&self, bytes: &[u8]) -> bool {
        bytes.starts_with(&SYNC) || SYNC.starts_with(bytes)
    }

    #[inline]
    fn candidate(&self, block: &[u8], from: usize) -> Option<usize> {
        self.sync.find(block.get(from..)?).map(|at| from + at)
    }

    #[inline]
    fn length(&self, bytes: &[u8]) -> Option<usize> {
        self.session.format(*bytes.get(HEADER - 1)?)?.length()
    }

    /// Numbers may look like a record header (-0.0211 as a double does), but hardly with a time near the last one.
    fn is_likely(&self, record: &[u8]) -> bool {
        self.session.is_near(record, HEADER)
    }

    #[inline]
    fn take(&mut self, record: &[u8], _: &[u8], _: u64) -> Result<Fate, Cow<'static, str>> {
        Ok(self.session.packed(record, HEADER)?)
    }

    fn fault(&self, bytes: &[u8]) -> Cow<'static, str> {
        match *bytes {
            [first, second, id, ..] if [first, second] == SYNC => match self.session.format(id) {
                Some(_) => "a record with a wrong length".into(),
                None => format!("records of the undefined type {id}").into(),
            },
            _ => NO_RECORD.into(),
        }
    }
}
