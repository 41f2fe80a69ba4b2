//! The two clocks of a telemetry log: reception at the ground station, and time since boot of the vehicle.

use super::definition::Definition;
use crate::decode::Tally;
use crate::reader::Restart;
use std::collections::HashMap;
use std::ops::Range;

/// A ground station's clock that is set reads between 2000 and 2100, µs.
pub(super) const PLAUSIBLE_US: Range<u64> = 946_684_800_000_000..4_102_444_800_000_000;
/// Frames arrive, and are written, out of order by less than this, µs.
const DISORDER_US: u64 = 250_000;
/// A gap that shows on one side only is shorter than this, µs.
const DAY_US: u64 = 86_400_000_000;

/// The times before the frames. No checksum covers them, so only neighbouring times can confirm them.
#[derive(Debug, Default)]
pub(super) struct ReceiveClock {
    trusted_us: Option<u64>,
    pub(super) out_of_line: Tally,
    pub(super) set_back: Tally,
    pub(super) unset: Tally,
}

impl ReceiveClock {
    /// Reception time of a frame, ns: the time before it, or one between its neighbours' if it jumps away from both.
    /// `ahead` holds the times before the next two frames, µs, if they follow without a break.
    pub(super) fn stamp(&mut self, time_us: u64, ahead: [Option<u64>; 2]) -> i64 {
        let trusted = is_trusted(self.trusted_us, time_us, ahead) && time_us <= LATEST_US;
        let stamp_us = if trusted { time_us } else { between(self.trusted_us, ahead).unwrap_or(time_us) };
        let before = || format!("{time_us} us, after {} us", self.trusted_us.unwrap_or_default());
        if !trusted {
            self.out_of_line.add(before);
        } else if !PLAUSIBLE_US.contains(&time_us) {
            self.unset.add(before);
        } else if self.trusted_us.is_some_and(|trusted| !in_order(trusted, time_us)) {
            self.set_back.add(before);
        }
        if trusted {
            self.trusted_us = Some(time_us);
        }
        i64::try_from(stamp_us.min(LATEST_US)).map_or(i64::MAX, |us| us.saturating_mul(1000))
    }
}

/// The last microsecond that 64-bit nanoseconds can represent.
const LATEST_US: u64 = i64::MAX as u64 / 1000;

/// Whether a time does not jump away from its neighbours and back again. A clock that is set jumps too, but
/// then continues from there.
fn is_trusted(before: Option<u64>, time: u64, ahead: [Option<u64>; 2]) -> bool {
    let near = |next: u64| in_order(time, next) && next.saturating_sub(time) <= DAY_US;
    match (before, ahead) {
        (Some(before), [Some(next), _]) if in_order(before, next) => in_order(before, time) && in_order(time, next),
        (Some(before), [Some(next), _]) => in_order(before, time) || in_order(time, next),
        (Some(before), [None, _]) => in_order(before, time) && time.saturating_sub(before) <= DAY_US,
        (None, [None, None]) => PLAUSIBLE_US.contains(&time),
        // If it is the next time that jumps, the one after it is later than this.
        (None, [next, second]) => next.is_some_and(near) || second.is_some_and(|second| time <= second && near(second)),
    }
}

fn in_order(earlier: u64, later: u64) -> bool {
    earlier <= later.saturating_add(DISORDER_US)
}

/// A time for a frame whose own time is not trusted.
fn between(before: Option<u64>, ahead: [Option<u64>; 2]) -> Option<u64> {
    match (before, ahead) {
        (Some(before), [Some(next), _]) if in_order(before, next) => Some(before.midpoint(next)),
        (Some(before), _) => Some(before),
        (None, [Some(next), Some(second)]) if !in_order(next, second) => Some(second),
        (None, [next, _]) => next,
    }
}

/// If a vehicle's clock goes back by less than this, its messages are merely out of order, ms.
const DISORDER_MS: i64 = 1000;
/// This many messages in a row show that the clock continues from where it jumped to.
const CONFIRMED_BY: u32 = 3;
/// The counter wraps around after 32 bits, ms.
const RANGE_MS: i64 = 1 << 32;
/// This close to its end, ms.
const WRAP_MS: i64 = 60_000;
/// Restarts in one log. With more, it is not one vehicle but several with the same number.
const MOST_RESTARTS: usize = 10_000;

/// Time since boot of the vehicle, from all its messages that carry it, in order of arrival.
#[derive(Debug, Default)]
pub(super) struct BootClock {
    /// Position of `time_boot_ms` in each message; `None` if it has no such field.
    offsets: HashMap<u32, Option<usize>>,
    last: Option<Reading>,
    begun: Option<Begun>,
    restarts: Vec<Restart>,
    told_ms: i64,
}

/// Where it may have restarted.
#[derive(Debug, Clone, Copy)]
struct Begun {
    first: Reading,
    latest: Reading,
    /// Messages may be written slightly out of order of arrival, ns.
    earliest_ns: i64,
    count: u32,
}

impl Begun {
    fn at(first: Reading) -> Begun {
        Begun { first, latest: first, earliest_ns: first.logged_ns, count: 1 }
    }

    fn goes_on(self, now: Reading) -> Begun {
        Begun { latest: now, earliest_ns: self.earliest_ns.min(now.logged_ns), count: self.count + 1, ..self }
    }
}

/// A reading of the clock, and when it was taken.
#[derive(Debug, Clone, Copy)]
struct Reading {
    boot_ms: i64,
    logged_ns: i64,
}

impl Reading {
    /// Time since an earlier reading by the vehicle's clock, ms; wraparound is resolved.
    fn since_ms(self, earlier: Reading) -> i64 {
        let wraps = |from: i64, to: i64| from > RANGE_MS - WRAP_MS && to < WRAP_MS;
        let wrapped = i64::from(wraps(earlier.boot_ms, self.boot_ms)) - i64::from(wraps(self.boot_ms, earlier.boot_ms));
        self.boot_ms - earlier.boot_ms + wrapped * RANGE_MS
    }

    /// How much more time passed since an earlier reading by the log's clock than by the vehicle's, ms.
    fn lag_ms(self, earlier: Reading) -> i64 {
        let logged_ms = self.logged_ns.saturating_sub(earlier.logged_ns) / 1_000_000;
        logged_ms.saturating_sub(self.since_ms(earlier))
    }

    fn went_back(self, earlier: Reading) -> bool {
        self.since_ms(earlier) < -DISORDER_MS
    }
}

impl BootClock {
    /// A message of the vehicle; missing trailing zeros count. Without a reception time its byte position
    /// is used instead: then a clock that jumps ahead shows nothing, and one that goes back shows a restart.
    pub(super) fn message(&mut self, definition: &Definition, number: u32, payload: &[u8], logged_ns: i64) {
        let offset = *self.offsets.entry(number).or_insert_with(|| boot_ms_in(definition));
        let Some(rest) = offset.and_then(|offset| payload.get(offset..)) else { return };
        let bytes = std::array::from_fn(|at| rest.get(at).copied().unwrap_or(0));
        let boot_ms = i64::from(u32::from_le_bytes(bytes));
        // Senders that do not know the time leave it zero.
        if boot_ms != 0 {
            self.told_ms = boot_ms;
            self.read(Reading { boot_ms, logged_ns });
        }
    }

    /// The last time it reported, ns; 0 before the first.
    pub(super) fn told_ns(&self) -> i64 {
        self.told_ms.saturating_mul(1_000_000)
    }

    fn read(&mut self, now: Reading) {
        let Some(last) = self.last else {
            self.last = Some(now);
            return;
        };
        let leaps = |from: Reading| now.went_back(from) || now.lag_ms(from).abs() > DISORDER_MS;
        match self.begun {
            // The nearer of the two lines.
            Some(begun) if now.lag_ms(begun.latest).abs() < now.lag_ms(last).abs() => {
                let begun = begun.goes_on(now);
                self.begun = Some(begun);
                if begun.count >= CONFIRMED_BY {
                    self.confirm(begun, last);
                    (self.last, self.begun) = (Some(now), None);
                }
            }
            _ if leaps(last) => self.begun = Some(Begun::at(now)),
            _ => (self.last, self.begun) = (Some(now), None),
        }
    }

    /// A clock that jumps ahead has not restarted: queued messages catch up, or the log's clock is set.
    fn confirm(&mut self, begun: Begun, before: Reading) {
        let certain = begun.first.went_back(before);
        let anew = certain || begun.first.lag_ms(before) > DISORDER_MS;
        if anew && self.restarts.len() < MOST_RESTARTS {
            // A vehicle that boots is silent for some seconds: in the middle of these, disorder matters least.
            let logged_ns = begun.earliest_ns.max(before.logged_ns).midpoint(before.logged_ns).saturating_add(1);
            self.restarts.push(Restart { logged_ns, certain });
        }
    }

    /// Number of restarts so far.
    pub(super) fn restarts(&self) -> usize {
        self.restarts.len()
    }

    pub(super) fn finish(self) -> Vec<Restart> {
        self.restarts
    }
}

fn boot_ms_in(definition: &Definition) -> Option<usize> {
    definition.layout(true).fields.iter().find(|field| field.path == "time_boot_ms").map(|field| field.offset)
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOON_US: u64 = 1_795_262_400_000_000;

    fn stamps(times: &[u64]) -> (Vec<i64>, ReceiveClock) {
        let mut clock = ReceiveClock::default();
        let at = |i: usize| times.get(i).copied();
        let stamps = (0..times.len()).map(|i| clock.stamp(times[i], [at(i + 1), at(i + 2)])).collect();
        (stamps, clock)
    }

    fn line(count: u64) -> Vec<u64> {
        (0..count).map(|i| NOON_US + 20_000 * i).collect()
    }

    #[test]
    fn a_time_that_jumps_away_and_back_is_counted_and_interpolated() {
        let good = line(20);
        for place in 0..20 {
            for bad in [0, 1, good[place] + 300_000, good[place] - 1_500_000, good[place] ^ 1 << 50, u64::MAX] {
                let mut times = good.clone();
                times[place] = bad;
                // At either end the neighbours do not contradict a gap of less than a day.
                let silent = (place == 0 && bad < good[0] && good[0] - bad < DAY_US)
                    || (place == 19 && bad > good[19] && bad - good[19] < DAY_US);
                let (found, clock) = stamps(&times);
                assert_eq!(clock.out_of_line.count, u64::from(!silent), "{place} {bad}");
                assert_eq!(clock.set_back.count + clock.unset.count, 0, "{place} {bad}");
                for (row, (stamp, good)) in found.iter().zip(&good).enumerate() {
                    let off = stamp.abs_diff(*good as i64 * 1000);
                    assert!(off <= if row == place { 20_000_000 } else { 0 } || silent, "{place} {bad}: {row} {off}");
                }
            }
        }
    }

    #[test]
    fn a_clock_that_is_set_continues_from_there() {
        for step in [-3_600_000_000, -2_000_000, 5_000_000, 3_600_000_000_i64] {
            let times: Vec<u64> = line(20)
                .iter()
                .map(|t| if *t < NOON_US + 200_000 { *t } else { t.wrapping_add_signed(step) })
                .collect();
            let (found, clock) = stamps(&times);
            assert_eq!(found, times.iter().map(|t| *t as i64 * 1000).collect::<Vec<_>>(), "{step}");
            assert_eq!((clock.out_of_line.count, clock.set_back.count), (0, u64::from(step < 0)), "{step}");
        }
        // A ground station that does not know the date until the middle.
        let times: Vec<u64> = line(20).iter().enumerate().map(|(i, t)| if i < 10 { t - NOON_US } else { *t }).collect();
        let (_, clock) = stamps(&times);
        assert_eq!((clock.out_of_line.count, clock.unset.count, clock.set_back.count), (0, 10, 0));
    }

    /// Restarts of a clock with these readings at these times, both ms.
    fn restarts(readings: impl IntoIterator<Item = (i64, i64)>) -> Vec<(i64, bool)> {
        let mut clock = BootClock::default();
        readings.into_iter().for_each(|(boot_ms, at_ms)| {
            clock.read(Reading { boot_ms, logged_ns: at_ms * 1_000_000 });
        });
        clock.finish().iter().map(|r| (r.logged_ns / 1_000_000, r.certain)).collect()
    }

    #[test]
    fn a_clock_restart_is_detected_but_not_disorder_glitches_or_wraps() {
        let run = |boot: i64, at: i64| (0..100).map(move |i| (boot + 100 * i, at + 100 * i));
        assert_eq!(restarts(run(50_000, 0).chain(run(3000, 30_000))), [(19_950, true)]);
        // When it is heard again, it has run for longer than before.
        assert_eq!(restarts(run(50_000, 0).chain(run(60_000, 40_000))), [(24_950, false)]);
        // Written in a different order than received.
        let swapped = run(3000, 30_000).map(|(boot, at)| (boot, at + if boot == 3000 { 150 } else { 0 }));
        assert_eq!(restarts(run(50_000, 0).chain(swapped)), [(20_000, true)]);
        let end = (1 << 32) - 5000;
        assert_eq!(restarts(run(end, 0).map(|(boot, at)| (boot % (1 << 32), at))), []);
        assert_eq!(restarts(run(50_000, 0).chain(run(70_000, 20_000))), []);
        for off in [-40_000, -3000, -800, 3000, 40_000] {
            for few in [1, 2] {
                let spoil = |(i, (boot, at))| (if (50..50 + few).contains(&i) { boot + off } else { boot }, at);
                assert_eq!(restarts(run(50_000, 0).enumerate().map(spoil)), [], "{off} {few}");
            }
        }
    }
}
