//! Counters of several topics that wrap around together, where one topic shows it and another only starts afterwards.

use super::repair::Repair;
use super::stamp_columns::{Counter, Stamps};
use flight::{Clock, Code};
use formats::time::TOLERATED;
use std::rc::Rc;

/// A topic fits a number of wraps if at least this percentage of its time lies within that of the others.
const WITHIN: i128 = 90;

const SHIFTED: &str = "the other topics show that the counter wrapped around before this topic started: its \
    timestamps are shifted accordingly";
const UNCLEAR: &str = "in other topics the counter wrapped around; these timestamps fit before the wrap and after \
    it. They are not shifted: they are assumed to be before it";

/// The range of timestamps, ns.
#[derive(Clone, Copy)]
struct Span {
    first: i128,
    last: i128,
}

impl Span {
    /// One timestamp of [`TOLERATED`] at each end may be wrong. What that trims is restored from the rate of the
    /// others.
    fn of(stamps: impl Iterator<Item = i64>) -> Option<Span> {
        let mut stamps: Vec<i64> = stamps.collect();
        stamps.sort_unstable();
        let cut = stamps.len() / TOLERATED;
        let kept = stamps.get(cut..stamps.len() - cut)?;
        let (least, first) = (i128::from(*stamps.first()?), i128::from(*kept.first()?));
        let (last, most) = (i128::from(*kept.last()?), i128::from(*stamps.last()?));
        let share = (last - first) * cut as i128 / kept.len() as i128 + 1;
        Some(Span { first: least.max(first - share), last: most.min(last + share) })
    }

    fn and(self, other: Span) -> Span {
        Span { first: self.first.min(other.first), last: self.last.max(other.last) }
    }

    fn shifted(self, wraps: i128, range: i128) -> Span {
        Span { first: self.first + wraps * range, last: self.last + wraps * range }
    }

    fn is_within(self, other: Span) -> bool {
        let common = self.last.min(other.last) - self.first.max(other.first);
        common >= 0 && 100 * common >= WITHIN * (self.last - self.first)
    }
}

/// Shifts the timestamps of topics that do not show the wrap of a counter to match the topics that do. Only topics with
/// the same unit and limit are shifted.
pub(super) fn align<'s>(topics: impl Iterator<Item = &'s mut Stamps>) {
    let mut topics: Vec<&mut Stamps> = topics.collect();
    let mut wrapped: Vec<(Clock, Counter, Span)> = vec![];
    for stamps in &topics {
        let Some((counter, span)) = stamps.wrapped_at.zip(Span::of(stamps.nanos.given())) else { continue };
        match wrapped.iter_mut().find(|(clock, known, _)| (*clock, *known) == (stamps.clock, counter)) {
            Some((_, _, all)) => *all = all.and(span),
            None => wrapped.push((stamps.clock, counter, span)),
        }
    }
    for stamps in topics.iter_mut().filter(|stamps| stamps.wrapped_at.is_none()) {
        let same =
            |(clock, counter, _): &&(Clock, Counter, Span)| *clock == stamps.clock && stamps.counters.contains(counter);
        if let Some((_, counter, all)) = wrapped.iter().find(same) {
            shift_by_wraps(stamps, counter.range, *all);
        }
    }
}

fn shift_by_wraps(stamps: &mut Stamps, range: i64, all: Span) {
    let in_range = |stamp: &i64| (0..range).contains(stamp);
    let given = stamps.nanos.given().count();
    let count = stamps.nanos.given().filter(in_range).count();
    let Some(own) = Span::of(stamps.nanos.given().filter(in_range)) else { return };
    if TOLERATED * (given - count) > given {
        return;
    }
    let wide = i128::from(range);
    // With fewer wraps than `first` the timestamps end before the others begin. With more than `last` they begin after
    // the others end.
    let (first, last) = ((all.first - own.last).div_euclid(wide).max(0), (all.last - own.first).div_euclid(wide));
    let mut fitting = (first..=last).filter(|wraps| own.shifted(*wraps, wide).is_within(all));
    let text = match (fitting.next(), fitting.next()) {
        (None, _) | (Some(0), None) => return,
        (Some(wraps), None) => {
            let shifted = |stamp: i64| i64::try_from(i128::from(stamp) + wraps * wide).ok();
            Rc::make_mut(&mut stamps.nanos).change(|nanos| {
                let counts = nanos.iter_mut().filter(|stamp| stamp.is_some_and(|stamp| in_range(&stamp)));
                counts.for_each(|stamp| *stamp = stamp.and_then(shifted));
            });
            SHIFTED
        }
        (Some(_), Some(_)) => UNCLEAR,
    };
    stamps.repairs.push(Repair { what: Code::StampWrap.into(), count: count as u64, text: text.into() });
}
