//! Boots of the vehicle, where logs come one after another.
//!
//! Every log counts from the boot of its vehicle. If a log starts before the end of the previous log, its messages are
//! of another boot. They are logged after it, so that two boots do not mix, and each boot is dated by itself.

use crate::reader::Restart;

/// Minimum log time between two boots, µs.
const BETWEEN_US: u64 = 10_000_000;
const SECOND_US: u64 = 1_000_000;
/// Maximum time from one message of a boot to the next, µs, unless the following message confirms it.
const APART_US: u64 = 3_600_000_000;
/// The latest timestamp accepted, µs: 146 years.
const LATEST_US: u64 = i64::MAX as u64 / 2000;

/// The log time of the last message of a log, robust against single wrong timestamps.
#[derive(Debug, Default)]
pub(super) struct LastStamp {
    pub(super) us: Option<u64>,
    /// Far from the messages before it, and to be confirmed by the next one.
    doubtful_us: Option<u64>,
}

impl LastStamp {
    /// Whether a message at this time may follow the last one.
    pub(super) fn is_near(&self, stamp_us: u64) -> bool {
        self.us.is_some_and(|us| us.abs_diff(stamp_us) <= APART_US)
    }

    #[inline]
    pub(super) fn add(&mut self, stamp_us: u64) {
        let near = |us: Option<u64>| us.is_some_and(|us| us.abs_diff(stamp_us) <= APART_US);
        if self.us.is_none() || near(self.us) || near(self.doubtful_us) {
            (self.us, self.doubtful_us) = (Some(stamp_us), None);
        } else {
            self.doubtful_us = Some(stamp_us);
        }
    }
}

/// The boots of the logs so far.
#[derive(Debug, Default)]
pub(super) struct Boots {
    /// Log time of the last message.
    latest_us: Option<u64>,
    offset_us: u64,
    pub(super) restarts: Vec<Restart>,
}

impl Boots {
    /// Another log starts, at this time of its own boot if stated. Returns the offset to add to its timestamps.
    pub(super) fn next_log(&mut self, began_us: Option<u64>) -> u64 {
        let Some(latest_us) = self.latest_us else { return 0 };
        let began_us = began_us.filter(|&us| us < LATEST_US).map(|us| us.saturating_add(self.offset_us));
        let certain = began_us.is_none_or(|began_us| began_us < latest_us);
        if certain {
            self.offset_us = (latest_us.saturating_add(BETWEEN_US) / SECOND_US).saturating_mul(SECOND_US);
        }
        // Messages published before a log started are in it too: only the boot itself is a lower limit.
        let first_us = if certain { self.offset_us } else { began_us.unwrap_or_default() };
        let logged_ns = i64::try_from(first_us.saturating_mul(1000)).unwrap_or(i64::MAX);
        self.restarts.push(Restart { logged_ns, certain });
        self.offset_us
    }

    /// The timestamp of the last message of a log, if it has messages.
    pub(super) fn latest(&mut self, stamp_us: Option<u64>) {
        let logged_us = stamp_us.map(|stamp| stamp.saturating_add(self.offset_us)).filter(|&us| us < LATEST_US);
        self.latest_us = self.latest_us.max(logged_us);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_log_of_another_boot_is_logged_after_the_last_and_the_same_boot_goes_on() {
        let mut boots = Boots::default();
        assert_eq!(boots.next_log(Some(5_000_000)), 0);
        boots.latest(Some(61_500_000));
        assert_eq!(boots.next_log(Some(70_000_000)), 0);
        boots.latest(Some(90_200_000));
        assert_eq!(boots.next_log(Some(2_000_000)), 100_000_000);
        boots.latest(Some(30_000_000));
        assert_eq!(boots.next_log(Some(31_000_000)), 100_000_000);
        let restarts: Vec<(i64, bool)> =
            boots.restarts.iter().map(|r| (r.logged_ns / 1_000_000_000, r.certain)).collect();
        assert_eq!(restarts, [(70, false), (100, true), (131, false)]);
    }

    #[test]
    fn a_wrong_timestamp_does_not_move_the_next_boot_but_a_confirmed_pause_does() {
        let last = |stamps: &[u64]| {
            let mut last = LastStamp::default();
            stamps.iter().for_each(|&us| last.add(us));
            last.us
        };
        assert_eq!(last(&[1_000_000, 2_000_000, 1 << 62]), Some(2_000_000));
        assert_eq!(last(&[1 << 62, 1_000_000, 2_000_000]), Some(2_000_000));
        assert_eq!(last(&[1_000_000, 1 << 62, 2_000_000, 1 << 50]), Some(2_000_000));
        assert_eq!(last(&[1_000_000, 9_000_000_000, 9_000_000_010]), Some(9_000_000_010));
        let mut boots = Boots::default();
        boots.next_log(Some(0));
        boots.latest(Some(30_000_000));
        boots.latest(Some(u64::MAX));
        assert_eq!(boots.next_log(Some(u64::MAX)), 40_000_000);
        assert_eq!(boots.restarts.last().map(|restart| restart.logged_ns), Some(40_000_000_000));
    }

    #[test]
    fn a_log_without_messages_does_not_start_a_boot() {
        let mut boots = Boots::default();
        boots.next_log(Some(5_000_000));
        boots.latest(None);
        assert_eq!(boots.next_log(Some(1)), 0);
        assert!(boots.restarts.is_empty());
    }
}
