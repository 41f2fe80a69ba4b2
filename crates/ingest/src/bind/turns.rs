//! Counts of several topics that begin anew together, of which one topic shows it and another only begins behind.

use super::repair::Repair;
use super::stamps::Stamps;
use super::trial::Plan;
use flight::{Clock, Severity};

/// A topic belongs where so much of it lies within the time of the others, of a hundred.
const WITHIN: i128 = 90;

const SHIFTED: &str =
    "the count had begun anew before the first of these stamps, as the other topics show: they are put behind";
const UNCLEAR: &str = "in other topics the count began anew, and these stamps fit before it as well as behind: they are taken as they stand, \
                       which is before";

/// From when to when stamps are, ns.
#[derive(Clone, Copy)]
struct Span {
    first: i64,
    last: i64,
}

impl Span {
    fn of(nanos: &[Option<i64>]) -> Option<Span> {
        let stamps = || nanos.iter().flatten().copied();
        Some(Span { first: stamps().min()?, last: stamps().max()? })
    }

    fn and(self, other: Span) -> Span {
        Span { first: self.first.min(other.first), last: self.last.max(other.last) }
    }

    fn is_within(self, other: Span) -> bool {
        let common = i128::from(self.last.min(other.last)) - i128::from(self.first.max(other.first));
        common >= 0 && 100 * common >= WITHIN * (i128::from(self.last) - i128::from(self.first))
    }
}

/// Puts the stamps of topics that do not show the end of a count into the turn in which the topics that show it are.
pub(super) fn align(plans: &mut [Plan<'_>]) {
    let mut turned: Vec<(Clock, i64, Span)> = vec![];
    for stamps in plans.iter().flat_map(|plan| &plan.stamps) {
        let Some((range, span)) = stamps.turn_ns.zip(Span::of(&stamps.nanos)) else { continue };
        match turned.iter_mut().find(|(clock, known, _)| (*clock, *known) == (stamps.clock, range)) {
            Some((_, _, all)) => *all = all.and(span),
            None => turned.push((stamps.clock, range, span)),
        }
    }
    for stamps in plans.iter_mut().flat_map(|plan| &mut plan.stamps).filter(|stamps| stamps.turn_ns.is_none()) {
        if let Some((_, range, all)) = turned.iter().find(|(clock, ..)| *clock == stamps.clock) {
            put_into_turn(stamps, *range, *all);
        }
    }
}

fn put_into_turn(stamps: &mut Stamps, range: i64, all: Span) {
    let Some(own) = Span::of(&stamps.nanos).filter(|own| (0..range).contains(&own.first) && own.last < range) else {
        return;
    };
    let behind = |turn: i64| Span { first: own.first + turn * range, last: own.last + turn * range };
    let fitting: Vec<i64> = (0..=all.last / range).filter(|turn| behind(*turn).is_within(all)).collect();
    let text = match fitting.as_slice() {
        [] | [0] => return,
        [turn] => {
            stamps.nanos.iter_mut().flatten().for_each(|stamp| *stamp += turn * range);
            SHIFTED
        }
        _ => UNCLEAR,
    };
    let count = stamps.nanos.iter().flatten().count() as u64;
    let code = if text == UNCLEAR { "turn-unclear" } else { "stamp-wrap" };
    stamps.repairs.push(Repair { severity: Severity::Warning, code, count, text: text.into() });
}
