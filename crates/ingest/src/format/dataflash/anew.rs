//! Whether a clock that goes back has begun anew although no log begins, as where the begin of the second was lost.
//!
//! ArduPilot's clock never goes back while it runs. A wrong time, on whichever side, does not last, and behind records that
//! come late the clock is back where it was.

use flight::NANOS_PER_SECOND;

/// A step back of the clock that is longer than this is no mere disorder, ns.
pub(super) const STEP_BACK_NS: i64 = NANOS_PER_SECOND;
/// So many records in a row on both sides, behind one another in time on each, show that a clock has begun anew.
pub(super) const CONFIRMED_BY: usize = 8;
/// Records follow one another within less, ns.
const NEXT_NS: i64 = 10 * NANOS_PER_SECOND;
/// A log begins so soon after its autopilot, ns.
const BEGIN_NS: i64 = 30 * NANOS_PER_SECOND;
/// A clock that has begun anew goes on for so long, ns.
const LASTS_NS: i64 = NANOS_PER_SECOND;
/// Beyond this nothing is looked at, ns.
const AHEAD_NS: i64 = 10 * NANOS_PER_SECOND;

/// Whether a record comes right behind another one.
fn goes_on(before_ns: i64, ns: i64) -> bool {
    (-STEP_BACK_NS..NEXT_NS).contains(&ns.saturating_sub(before_ns))
}

/// A clock that goes back to nearly zero, and what the records behind tell of it.
#[derive(Debug)]
pub(super) struct Anew {
    /// The earliest and the last of the times before.
    earliest_ns: i64,
    last_before_ns: i64,
    first_ns: i64,
    /// Of those that go on: the last, and how many there are behind the first.
    last_ns: i64,
    count: usize,
    /// So many in a row that do not.
    odd: usize,
    refuted: bool,
}

impl Anew {
    /// Of a record with this time behind the [`CONFIRMED_BY`] last ones, the oldest first; `None` if nothing can begin here.
    pub(super) fn at(first_ns: i64, before_ns: &[i64]) -> Option<Anew> {
        let [.., last_before_ns] = *before_ns else { return None };
        let lasted = before_ns.windows(2).all(|pair| matches!(*pair, [a, b] if goes_on(a, b)));
        let earliest_ns = before_ns.iter().copied().min()?;
        let begins = lasted && (0..BEGIN_NS).contains(&first_ns) && is_back(first_ns, earliest_ns);
        let (last_ns, count, odd, refuted) = (first_ns, 0, 0, false);
        begins.then_some(Anew { earliest_ns, last_before_ns, first_ns, last_ns, count, odd, refuted })
    }

    /// Takes in the time of the next record behind. `false` if those behind it need not be looked at.
    pub(super) fn goes_on(&mut self, ns: i64) -> bool {
        let leaps = ns.saturating_sub(self.last_ns) > STEP_BACK_NS;
        if leaps && goes_on(self.last_before_ns, ns) {
            self.refuted = true;
        } else if goes_on(self.last_ns, ns) {
            (self.last_ns, self.odd) = (ns, 0);
            self.count += 1;
            self.refuted = self.count <= CONFIRMED_BY && !is_back(ns, self.earliest_ns);
        } else {
            self.odd += 1;
            self.refuted = self.odd >= CONFIRMED_BY;
        }
        !self.refuted && self.last_ns - self.first_ns < AHEAD_NS
    }

    /// Whether the clock has begun anew, by what was looked at.
    pub(super) fn is_certain(&self) -> bool {
        !self.refuted && self.count >= CONFIRMED_BY && self.last_ns - self.first_ns >= LASTS_NS
    }
}

/// Whether a time is before another one by more than disorder.
fn is_back(ns: i64, from_ns: i64) -> bool {
    ns.saturating_add(STEP_BACK_NS) < from_ns
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    /// Whether a clock that was at 34.86 s to 35 s before has begun anew with the first of these times, ms; and how many of
    /// them are looked at.
    fn anew(times_ms: impl IntoIterator<Item = i64>) -> (bool, usize) {
        let before: Vec<i64> = (0..8).map(|i| (34_860 + 20 * i) * MS).collect();
        let mut times = times_ms.into_iter().map(|ms| ms * MS);
        let mut anew = Anew::at(times.next().unwrap(), &before).unwrap();
        let mut looked = 0;
        for ns in times {
            looked += 1;
            if !anew.goes_on(ns) {
                break;
            }
        }
        (anew.is_certain(), looked)
    }

    fn run(from_ms: i64, count: i64) -> impl Iterator<Item = i64> {
        (0..count).map(move |i| from_ms + 20 * i)
    }

    #[test]
    fn a_clock_that_goes_on_for_a_second_has_begun_anew_and_ten_seconds_are_looked_at() {
        assert_eq!([anew(run(2000, 50)).0, anew(run(2000, 51)).0], [false, true]);
        assert_eq!(anew(run(2000, 10_000)), (true, 500));
        assert!(!anew(run(2000, 8).chain(std::iter::repeat_n(2200, 1000))).0);
    }

    #[test]
    fn records_that_come_late_are_none_however_many_they_are() {
        for late in [1, 8, 9, 100, 490] {
            assert_eq!(anew(run(20_000, late).chain(run(35_020, 500))), (false, late as usize), "{late}");
        }
        // Every other one is late; the clock is back after a while; back by less than ten seconds.
        assert!(!anew(run(20_000, 100).flat_map(|ms| [ms, ms + 15_020])).0);
        assert!(!anew(run(20_000, 100).chain(run(50_000, 500))).0);
        assert!(!anew(run(29_000, 100).chain(run(35_020, 500))).0);
    }

    #[test]
    fn a_wrong_time_does_not_hide_that_the_clock_began_anew() {
        let wrong = |at: usize| {
            let time = move |(i, ms): (usize, i64)| if i == at { 4_000_000 } else { ms };
            anew(run(2000, 200).enumerate().map(time)).0
        };
        assert_eq!([1, 7, 60, 199].map(wrong), [true; 4]);
    }

    #[test]
    fn a_clock_that_comes_to_where_it_was_step_by_step_has_begun_anew() {
        let before: Vec<i64> = (0..8).map(|i| (5000 + 20 * i) * MS).collect();
        let mut anew = Anew::at(3000 * MS, &before).unwrap();
        assert!(run(3020, 400).all(|ms| anew.goes_on(ms * MS)) && anew.is_certain());
    }

    #[test]
    fn nothing_begins_behind_disorder_or_far_from_zero() {
        let before = [1, 2, 3, 4, 5, 6, 7, 800].map(|s| 1000 * s * MS);
        assert!(Anew::at(2000 * MS, &before).is_none() && Anew::at(2000 * MS, &[]).is_none());
        assert!(Anew::at(40_000 * MS, &[90_000 * MS; 8]).is_none());
    }
}
