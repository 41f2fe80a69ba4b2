//! The two clocks of a telemetry log: when the ground station had a frame, and since when the vehicle runs.

use super::definition::Definition;
use crate::decode::Tally;
use crate::reader::Restart;
use std::collections::HashMap;
use std::ops::Range;

/// A ground station's clock that is set is between 2000 and 2100, µs.
pub(super) const PLAUSIBLE_US: Range<u64> = 946_684_800_000_000..4_102_444_800_000_000;
/// Frames come, and are written, out of order by less, µs.
const DISORDER_US: u64 = 250_000;
/// A hole that only one side shows is shorter, µs.
const DAY_US: u64 = 86_400_000_000;

/// The times in front of the frames. They are in no checksum, so that only their neighbours can speak for them.
#[derive(Debug, Default)]
pub(super) struct ReceiveClock {
    trusted_us: Option<u64>,
    pub(super) out_of_line: Tally,
    pub(super) set_back: Tally,
    pub(super) unset: Tally,
}

impl ReceiveClock {
    /// Another file begins.
    pub(super) fn next_file(&mut self) {
        self.trusted_us = None;
    }

    /// When a frame was received, ns: the time in front of it, or one between its neighbours' if it leaps away from both.
    /// `ahead` are the times in front of the next two frames, µs, as far as they follow without a break.
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

/// The last microsecond that nanoseconds in 64 bits can say.
const LATEST_US: u64 = i64::MAX as u64 / 1000;

/// Whether a time is no leap away from the one before and from the next and back again. A clock that is set leaps too, but
/// then it goes on from there.
fn is_trusted(before: Option<u64>, time: u64, ahead: [Option<u64>; 2]) -> bool {
    let near = |next: u64| in_order(time, next) && next.saturating_sub(time) <= DAY_US;
    match (before, ahead) {
        (Some(before), [Some(next), _]) if in_order(before, next) => in_order(before, time) && in_order(time, next),
        (Some(before), [Some(next), _]) => in_order(before, time) || in_order(time, next),
        (Some(before), [None, _]) => in_order(before, time) && time.saturating_sub(before) <= DAY_US,
        (None, [None, None]) => PLAUSIBLE_US.contains(&time),
        // If it is the next that leaps, the one behind it comes later than this.
        (None, [next, second]) => next.is_some_and(near) || second.is_some_and(|second| time <= second && near(second)),
    }
}

fn in_order(earlier: u64, later: u64) -> bool {
    earlier <= later.saturating_add(DISORDER_US)
}

/// A time for a frame whose own cannot be trusted.
fn between(before: Option<u64>, ahead: [Option<u64>; 2]) -> Option<u64> {
    match (before, ahead) {
        (Some(before), [Some(next), _]) if in_order(before, next) => Some(before.midpoint(next)),
        (Some(before), _) => Some(before),
        (None, [Some(next), Some(second)]) if !in_order(next, second) => Some(second),
        (None, [next, _]) => next,
    }
}

/// A vehicle's clock that goes back by less is mere disorder of its messages, ms.
const DISORDER_MS: i64 = 1000;
/// So many messages in a row show that it goes on from where it went.
const CONFIRMED_BY: u32 = 3;
/// The count goes on from zero behind 32 bits, ms.
const RANGE_MS: i64 = 1 << 32;
/// So close to its end, ms.
const WRAP_MS: i64 = 60_000;
/// Restarts of one log. More is no vehicle but several that have one number.
const MOST_RESTARTS: usize = 10_000;

/// Since when the vehicle runs, by all of its messages that say so, in the order in which they came.
#[derive(Debug, Default)]
pub(super) struct BootClock {
    /// Where `time_boot_ms` lies in each message; `None` if it has none.
    offsets: HashMap<u32, Option<usize>>,
    last: Option<Reading>,
    begun: Option<Begun>,
    restarts: Vec<Restart>,
    told_ms: i64,
}

/// Where it may have begun anew.
#[derive(Debug, Clone, Copy)]
struct Begun {
    first: Reading,
    latest: Reading,
    /// Messages may be written in a slightly different order than they came, ns.
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

/// What the clock said when.
#[derive(Debug, Clone, Copy)]
struct Reading {
    boot_ms: i64,
    logged_ns: i64,
}

impl Reading {
    /// What the vehicle says has passed since an earlier reading, ms; across the end of its count it runs on.
    fn since_ms(self, earlier: Reading) -> i64 {
        let wraps = |from: i64, to: i64| from > RANGE_MS - WRAP_MS && to < WRAP_MS;
        let wrapped = i64::from(wraps(earlier.boot_ms, self.boot_ms)) - i64::from(wraps(self.boot_ms, earlier.boot_ms));
        self.boot_ms - earlier.boot_ms + wrapped * RANGE_MS
    }

    /// How much longer the log says it took from an earlier reading than the vehicle does, ms.
    fn lag_ms(self, earlier: Reading) -> i64 {
        let logged_ms = self.logged_ns.saturating_sub(earlier.logged_ns) / 1_000_000;
        logged_ms.saturating_sub(self.since_ms(earlier))
    }

    fn went_back(self, earlier: Reading) -> bool {
        self.since_ms(earlier) < -DISORDER_MS
    }
}

impl BootClock {
    /// A message of the vehicle; zeros that are missing at its end count. Where nothing says when it came its place among the
    /// bytes stands for that: then a clock that goes ahead tells nothing, and one that goes back does.
    pub(super) fn message(&mut self, definition: &Definition, number: u32, payload: &[u8], logged_ns: i64) {
        let offset = *self.offsets.entry(number).or_insert_with(|| boot_ms_in(definition));
        let Some(rest) = offset.and_then(|offset| payload.get(offset..)) else { return };
        let bytes = std::array::from_fn(|at| rest.get(at).copied().unwrap_or(0));
        let boot_ms = i64::from(u32::from_le_bytes(bytes));
        // Zero is how a sender leaves it that does not know.
        if boot_ms != 0 {
            self.told_ms = boot_ms;
            self.read(Reading { boot_ms, logged_ns });
        }
    }

    /// What it said last, ns; 0 before it said anything.
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
            // Of the two lines the one that is nearer.
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

    /// A clock that leaps ahead has not begun anew: messages that waited catch up, or the log's clock is set.
    fn confirm(&mut self, begun: Begun, before: Reading) {
        let certain = begun.first.went_back(before);
        let anew = certain || begun.first.lag_ms(before) > DISORDER_MS;
        if anew && self.restarts.len() < MOST_RESTARTS {
            // A vehicle that starts is silent for some seconds: in their middle, disorder matters least.
            let logged_ns = begun.earliest_ns.max(before.logged_ns).midpoint(before.logged_ns).saturating_add(1);
            self.restarts.push(Restart { logged_ns, certain });
        }
    }

    /// How often it restarted so far.
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
    fn a_time_that_leaps_away_and_back_is_counted_and_lies_between_its_neighbours() {
        let good = line(20);
        for place in 0..20 {
            for bad in [0, 1, good[place] + 300_000, good[place] - 1_500_000, good[place] ^ 1 << 50, u64::MAX] {
                let mut times = good.clone();
                times[place] = bad;
                // At either end a hole of less than a day is none that the others speak against.
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
    fn a_clock_that_is_set_goes_on_from_there() {
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

    /// Restarts of a clock that says so at these times, both ms.
    fn restarts(readings: impl IntoIterator<Item = (i64, i64)>) -> Vec<(i64, bool)> {
        let mut clock = BootClock::default();
        readings.into_iter().for_each(|(boot_ms, at_ms)| {
            clock.read(Reading { boot_ms, logged_ns: at_ms * 1_000_000 });
        });
        clock.finish().iter().map(|r| (r.logged_ns / 1_000_000, r.certain)).collect()
    }

    #[test]
    fn a_clock_that_begins_anew_is_found_and_disorder_glitches_and_wraps_are_none() {
        let run = |boot: i64, at: i64| (0..100).map(move |i| (boot + 100 * i, at + 100 * i));
        assert_eq!(restarts(run(50_000, 0).chain(run(3000, 30_000))), [(19_950, true)]);
        // It ran for longer than before when it is heard again.
        assert_eq!(restarts(run(50_000, 0).chain(run(60_000, 40_000))), [(24_950, false)]);
        // Written in another order than received.
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
