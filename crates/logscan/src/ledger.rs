//! Accounting of every byte. One type for all readers, so that tests can assert the sum.

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

/// How far the log has come, by log time; shared by whoever counts messages and reports damage.
#[derive(Debug, Clone, Default)]
pub struct LogTime(Rc<Cell<Option<(i64, i64)>>>);

impl LogTime {
    /// Notes the log time of a message. Zero is ignored: loggers without a clock write it.
    pub fn passes(&self, logged_ns: i64) {
        if logged_ns != 0 {
            let first = self.0.get().map_or(logged_ns, |(first, _)| first);
            self.0.set(Some((first, logged_ns)));
        }
    }

    /// Time since the first message, ns.
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
    /// Container overhead.
    Structure,
}

impl Ledger {
    /// A ledger of files of `size` bytes in total; lists up to `listed` damaged ranges.
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

    /// Reports damage with its log time. Only where messages are stored in the order in which they were logged.
    pub fn timed_by(mut self, time: &LogTime) -> Ledger {
        self.time = time.clone();
        self
    }

    /// Assigns a fate to some bytes.
    pub fn count(&mut self, fate: Fate, bytes: u64) {
        match fate {
            Fate::Decoded => self.bytes.decoded += bytes,
            Fate::Skipped => self.bytes.skipped += bytes,
            Fate::Structure => self.bytes.structure += bytes,
        }
    }

    /// Records bytes that cannot be used. Adjacent ranges with the same reason are merged.
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

    /// Records the bytes from `offset` to the end of `file`, where a truncated record starts. A few bytes are the cut
    /// tail of a log written until power-off; more are damage. Returns whether they are damage.
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

    /// Writes the result into `health`, and one notice about the losses.
    pub fn finish(self, health: &mut LogHealth, notices: &mut Notices) {
        debug_assert_eq!(self.open(), 0, "bytes without a fate: {:?}", self.bytes);
        for d in &self.damage {
            notices.push(Code::Damaged, place_of(d), d.length, &d.reason);
        }
        let unlisted = self.damage_count - self.damage.len() as u64;
        if unlisted > 0 {
            notices.push(Code::Damaged, "", unlisted, "more damaged ranges; they are counted, but not listed");
        }
        for tail in &self.tails {
            let text = format!(
                "{}: tail cut, as after power-off. Everything before it was read; the log does not show whether more \
                 was recorded",
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

    /// Fate of the last `length` bytes of a file of `size` bytes that ends inside a record.
    fn cut(size: u64, length: u64) -> (LogHealth, Notices) {
        let (mut ledger, mut health, mut notices) = (Ledger::new(size, 10), LogHealth::default(), Notices::new());
        ledger.count(Fate::Decoded, size - length);
        ledger.cut("a.bin", size - length, length, "the log ends inside a record");
        ledger.finish(&mut health, &mut notices);
        (health, notices)
    }

    #[test]
    fn a_last_record_cut_at_power_off_is_reported_but_not_a_loss() {
        let (health, notices) = cut(1_000_000, 999);
        assert_eq!((health.bytes.tail_cut, health.bytes.damaged, health.damage_count), (999, 0, 0));
        let raised: Vec<_> = notices.iter().collect();
        assert_eq!((raised.len(), raised[0].code.as_str(), raised[0].count), (1, "tail-cut", 999));
        assert_eq!(raised[0].place, "a.bin, bytes 999001 to 1000000");
        assert!(!notices.any_loss(), "{raised:?}");
    }

    #[test]
    fn damaged_ranges_are_losses_and_unlisted_ones_are_counted() {
        let (mut ledger, mut health, mut notices) = (Ledger::new(100, 2), LogHealth::default(), Notices::new());
        ledger.count(Fate::Decoded, 97);
        (0..3).for_each(|at| ledger.damaged("a.bin", 10 * at, 1, "a checksum is wrong"));
        ledger.finish(&mut health, &mut notices);
        let reported: Vec<_> = notices.iter().map(|n| (n.code.as_str(), n.place.as_str(), n.count)).collect();
        let listed = [("damaged", "a.bin, bytes 0 to 1", 1), ("damaged", "a.bin, bytes 10 to 11", 1)];
        assert_eq!(reported, [&listed[..], &[("damaged", "", 1)]].concat());
        assert!(notices.iter().all(|n| n.severity == flight::Severity::Loss));
    }

    #[test]
    fn a_cut_tail_is_under_a_thousandth_or_one_row_of_a_short_table() {
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
