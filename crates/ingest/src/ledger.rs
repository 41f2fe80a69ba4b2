//! Where every byte went. One type for all readers, so that tests can assert the sum.

use flight::{ByteLedger, DamagedRange, LogHealth, Notices, Severity};
use std::cell::Cell;
use std::rc::Rc;

/// Collects the fate of every byte while a reader walks its files.
#[derive(Debug)]
pub(crate) struct Ledger {
    bytes: ByteLedger,
    damage: Vec<DamagedRange>,
    damage_count: u64,
    listed: usize,
    time: LogTime,
}

/// How far the log has come, by the log times of its messages; shared by those who count them and who meet damage.
#[derive(Debug, Clone, Default)]
pub(crate) struct LogTime(Rc<Cell<Option<(i64, i64)>>>);

impl LogTime {
    /// A message was logged at this time. Zero is none: it is what loggers without a clock write.
    pub(crate) fn passes(&self, logged_ns: i64) {
        if logged_ns != 0 {
            let first = self.0.get().map_or(logged_ns, |(first, _)| first);
            self.0.set(Some((first, logged_ns)));
        }
    }

    /// Since the first message, ns.
    fn elapsed_ns(&self) -> Option<i64> {
        self.0.get().and_then(|(first, last)| last.checked_sub(first))
    }
}

/// What became of some bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Fate {
    /// Held wanted values.
    Decoded,
    /// Intact and unwanted.
    Skipped,
    /// The container's own.
    Structure,
}

impl Ledger {
    pub(crate) fn new(size: u64, listed: usize) -> Ledger {
        Ledger {
            bytes: ByteLedger { size, ..ByteLedger::default() },
            damage: vec![],
            damage_count: 0,
            listed,
            time: LogTime::default(),
        }
    }

    /// Damage is told with the time at which it lies. Only where messages stand in the order in which they were logged.
    pub(crate) fn timed_by(mut self, time: &LogTime) -> Ledger {
        self.time = time.clone();
        self
    }

    pub(crate) fn count(&mut self, fate: Fate, bytes: u64) {
        match fate {
            Fate::Decoded => self.bytes.decoded += bytes,
            Fate::Skipped => self.bytes.skipped += bytes,
            Fate::Structure => self.bytes.structure += bytes,
        }
    }

    /// Bytes that cannot be used. Ranges that touch and have the same reason become one.
    pub(crate) fn damaged(&mut self, file: &str, offset: u64, length: u64, reason: impl Into<String>) {
        let reason = reason.into();
        self.bytes.damaged += length;
        if let Some(last) = self.damage.last_mut()
            && last.file == file
            && last.offset + last.length == offset
            && last.reason == reason
        {
            last.length += length;
            return;
        }
        self.damage_count += 1;
        if self.damage.len() < self.listed {
            let after_ns = self.time.elapsed_ns();
            self.damage.push(DamagedRange { file: file.to_owned(), offset, length, reason, after_ns });
        }
    }

    /// Bytes not yet accounted for.
    pub(crate) fn open(&self) -> u64 {
        let b = &self.bytes;
        b.size.saturating_sub(b.decoded + b.skipped + b.structure + b.damaged)
    }

    /// Writes the result into `health`, and one notice of the losses.
    pub(crate) fn finish(self, health: &mut LogHealth, notices: &mut Notices) {
        debug_assert_eq!(self.open(), 0, "bytes without a fate: {:?}", self.bytes);
        for d in &self.damage {
            let time = d.after_s().map(|s| format!(", after {s:.3} s")).unwrap_or_default();
            let place = format!("{}, bytes {} to {}{time}", d.file, d.offset, d.offset + d.length);
            notices.push(Severity::Loss, "damaged", place, d.length, &d.reason);
        }
        let unlisted = self.damage_count - self.damage.len() as u64;
        if unlisted > 0 {
            notices.push(Severity::Loss, "damaged", "", unlisted, "more damaged ranges, counted and not listed");
        }
        health.bytes = self.bytes;
        health.damage = self.damage;
        health.damage_count = self.damage_count;
    }
}
