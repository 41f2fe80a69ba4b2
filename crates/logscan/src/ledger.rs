//! Where every byte went. One type for all readers, so that tests can assert the sum.

use flight::{ByteLedger, Code, DamagedRange, LogHealth, Notices};
use std::cell::Cell;
use std::rc::Rc;

/// Collects the fate of every byte while a reader walks its files.
#[derive(Debug)]
pub struct Ledger {
    bytes: ByteLedger,
    damage: Vec<DamagedRange>,
    damage_count: u64,
    tails: Vec<DamagedRange>,
    listed: usize,
    time: LogTime,
}

/// How far the log has come, by the log times of its messages; shared by those who count them and who meet damage.
#[derive(Debug, Clone, Default)]
pub struct LogTime(Rc<Cell<Option<(i64, i64)>>>);

impl LogTime {
    /// A message was logged at this time. Zero is none: it is what loggers without a clock write.
    pub fn passes(&self, logged_ns: i64) {
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
pub enum Fate {
    /// Held wanted values.
    Decoded,
    /// Intact and unwanted.
    Skipped,
    /// The container's own.
    Structure,
}

impl Ledger {
    /// Of files of this size in all; so many damaged ranges are listed.
    #[must_use]
    pub fn new(size: u64, listed: usize) -> Ledger {
        Ledger {
            bytes: ByteLedger { size, ..ByteLedger::default() },
            damage: vec![],
            damage_count: 0,
            tails: vec![],
            listed,
            time: LogTime::default(),
        }
    }

    /// Damage is told with the time at which it lies. Only where messages stand in the order in which they were logged.
    pub fn timed_by(mut self, time: &LogTime) -> Ledger {
        self.time = time.clone();
        self
    }

    /// These bytes have this fate.
    pub fn count(&mut self, fate: Fate, bytes: u64) {
        match fate {
            Fate::Decoded => self.bytes.decoded += bytes,
            Fate::Skipped => self.bytes.skipped += bytes,
            Fate::Structure => self.bytes.structure += bytes,
        }
    }

    /// Bytes that cannot be used. Ranges that touch and have the same reason become one.
    pub fn damaged(&mut self, file: &str, offset: u64, length: u64, reason: impl Into<String>) {
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

    /// The bytes from `offset` to the end of `file`, which ends inside the record that they begin. Few are the tail of a log
    /// that was written until the power went off, more are damage. Whether they are damage.
    pub fn cut(&mut self, file: &str, offset: u64, length: u64, reason: impl Into<String>) -> bool {
        if !ByteLedger::is_cut_tail(length, offset + length) {
            self.damaged(file, offset, length, reason);
            return true;
        }
        self.bytes.tail_cut += length;
        let (file, reason, after_ns) = (file.to_owned(), reason.into(), self.time.elapsed_ns());
        self.tails.push(DamagedRange { file, offset, length, reason, after_ns });
        false
    }

    /// Bytes not yet accounted for.
    pub fn open(&self) -> u64 {
        self.bytes.size.saturating_sub(self.bytes.sum())
    }

    /// Writes the result into `health`, and one notice of the losses.
    pub fn finish(self, health: &mut LogHealth, notices: &mut Notices) {
        debug_assert_eq!(self.open(), 0, "bytes without a fate: {:?}", self.bytes);
        for d in &self.damage {
            notices.push(Code::Damaged, place_of(d), d.length, &d.reason);
        }
        let unlisted = self.damage_count - self.damage.len() as u64;
        if unlisted > 0 {
            notices.push(Code::Damaged, "", unlisted, "more damaged ranges, counted and not listed");
        }
        for tail in &self.tails {
            let text = format!(
                "{}: tail cut, as when the power goes off. Everything before it was read; whether more was recorded, the \
                 log does not say",
                tail.reason
            );
            notices.push(Code::TailCut, place_of(tail), tail.length, text);
        }
        health.bytes = self.bytes;
        health.damage = self.damage;
        health.damage_count = self.damage_count;
    }
}

fn place_of(range: &DamagedRange) -> String {
    let time = range.after_s().map(|s| format!(", after {s:.3} s")).unwrap_or_default();
    format!("{}, bytes {} to {}{time}", range.file, range.offset, range.offset + range.length)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Fate of the last `length` bytes of a file of `size`, which ends inside a record.
    fn cut(size: u64, length: u64) -> (LogHealth, Notices) {
        let (mut ledger, mut health, mut notices) = (Ledger::new(size, 10), LogHealth::default(), Notices::new());
        ledger.count(Fate::Decoded, size - length);
        ledger.cut("a.bin", size - length, length, "the log ends inside a record");
        ledger.finish(&mut health, &mut notices);
        (health, notices)
    }

    #[test]
    fn a_last_record_cut_at_power_off_is_counted_and_told_and_no_loss() {
        let (health, notices) = cut(1_000_000, 999);
        assert_eq!((health.bytes.tail_cut, health.bytes.damaged, health.damage_count), (999, 0, 0));
        let told: Vec<_> = notices.iter().collect();
        assert_eq!((told.len(), told[0].code.as_str(), told[0].count), (1, "tail-cut", 999));
        assert_eq!(told[0].place, "a.bin, bytes 999001 to 1000000");
        assert!(!notices.any_loss(), "{told:?}");
    }

    #[test]
    fn damaged_ranges_are_losses_and_those_beyond_the_list_are_counted() {
        let (mut ledger, mut health, mut notices) = (Ledger::new(100, 2), LogHealth::default(), Notices::new());
        ledger.count(Fate::Decoded, 97);
        (0..3).for_each(|at| ledger.damaged("a.bin", 10 * at, 1, "a checksum is wrong"));
        ledger.finish(&mut health, &mut notices);
        let said: Vec<_> = notices.iter().map(|n| (n.code.as_str(), n.place.as_str(), n.count)).collect();
        let listed = [("damaged", "a.bin, bytes 0 to 1", 1), ("damaged", "a.bin, bytes 10 to 11", 1)];
        assert_eq!(said, [&listed[..], &[("damaged", "", 1)]].concat());
        assert!(notices.iter().all(|n| n.severity == flight::Severity::Loss));
    }

    #[test]
    fn a_thousandth_of_the_log_is_more_than_a_tail_unless_it_is_one_row_of_a_short_table() {
        let is_tail = |size: u64, length: u64| {
            let (health, notices) = cut(size, length);
            let bytes = &health.bytes;
            assert_eq!((bytes.tail_cut + bytes.damaged, bytes.tail_cut == 0), (length, notices.any_loss()));
            bytes.tail_cut == length
        };
        assert!(is_tail(2_000_000, 1999) && !is_tail(2_000_000, 2000));
        assert!(is_tail(130_000, 589) && is_tail(200_000, 1024), "a row");
        assert!(!is_tail(200_000, 1025), "more than a row");
        assert!(!is_tail(50_000, 500), "a hundredth");
    }
}
