//! Tables with several times, such as an INS and a GPS side by side: which columns belong to which time.

use super::names::{Named, Role};
use super::time_columns::{Timing, middle, repeats, timings};
use formats::Table;

/// Times that differ by less are the same, s.
const SAME_S: f64 = 1e-3;
/// Clocks of one instant may drift apart by this part of the time.
const DRIFT: f64 = 1e-3;

/// The columns of a table with the possible readings of their time; and the reason if it is unclear which of two times
/// counts.
type Blocks = (Vec<(Vec<Named>, Vec<Timing>)>, Option<String>);

/// Columns belong to the time next to them, usually on their left, if the times of a table are not those of the same instants.
pub(super) fn blocks(table: &Table, named: Vec<Named>) -> Blocks {
    let whole = timings(table, &named);
    let all = side_by_side(table, &named);
    let Some(first) = whole.first().filter(|_| all.len() > 1).cloned() else { return (vec![(named, whole)], None) };
    let (mut same, mut apart) = (vec![], vec![]);
    for (columns, own) in all {
        match own.first().map_or(Relation::Same, |other| relation(&first, other)) {
            Relation::Same => same.extend(columns),
            Relation::Apart(by_s) => {
                let own = own.into_iter().map(|timing| of_its_own(timing, &first, by_s)).collect();
                apart.push((columns, own));
            }
            Relation::Unclear => {
                let why = unclear(&first, own.first());
                return (vec![(named, whole)], Some(why));
            }
        }
    }
    (std::iter::once((same, whole)).chain(apart).collect(), None)
}

fn unclear(first: &Timing, other: Option<&Timing>) -> String {
    format!(
        "the times {} and {} of one table count differently, and it is unknown which time applies to which columns: \
         split the table into one for each time, or state the time of each channel in a channel map, see `flightlag \
         maps --example`",
        first.label,
        other.map_or("", |other| &other.label)
    )
}

fn of_its_own(timing: Timing, first: &Timing, by_s: f64) -> Timing {
    let side = if by_s < 0.0 { "before" } else { "after" };
    let note = format!("next to its columns, {:.3} s {side} {}; taken as one clock", by_s.abs(), first.label);
    Timing { label: format!("{} ({note})", timing.label), why: format!("{}; {note}", timing.why), ..timing }
}

/// Times, each with the columns next to it and its readings. A time that cannot be read begins no block.
fn side_by_side(table: &Table, named: &[Named]) -> Vec<(Vec<Named>, Vec<Timing>)> {
    let is_time = |column: &Named| matches!(column.role, Role::Time | Role::Week);
    // Times at the right end are on the right of their columns.
    let is_mirrored = named.first().is_some_and(|c| !is_time(c)) && named.last().is_some_and(is_time);
    let mut ordered: Vec<&Named> = named.iter().collect();
    if is_mirrored {
        ordered.reverse();
    }
    let mut all: Vec<Vec<Named>> = vec![vec![]];
    let mut holds_values = false;
    for column in ordered {
        let begins = is_time(column) && holds_values && all.last().is_some_and(|block| block.iter().any(is_time));
        if begins {
            all.push(vec![]);
        }
        holds_values = !is_time(column) || holds_values && !begins;
        all.last_mut().into_iter().for_each(|block| block.push(column.clone()));
    }
    if is_mirrored {
        all.iter_mut().for_each(|block| block.reverse());
        all.reverse();
    }
    let is_only = all.len() == 1;
    let mut blocks: Vec<(Vec<Named>, Vec<Timing>)> = vec![];
    for columns in all {
        // Reading a time takes a while.
        let is_needless = is_only || columns.iter().all(is_time);
        let own = if is_needless { vec![] } else { timings(table, &columns) };
        match blocks.last_mut() {
            Some((before, _)) if own.is_empty() => before.extend(columns),
            _ => blocks.push((columns, own)),
        }
    }
    blocks
}

/// How two times of the same rows differ.
enum Relation {
    /// By nothing, or by a constant between two kinds of clock.
    Same,
    /// One clock, read at other instants; by so much at the median, s.
    Apart(f64),
    Unclear,
}

fn relation(first: &Timing, other: &Timing) -> Relation {
    if first.entry == other.entry {
        return Relation::Same;
    }
    let both = first.times_s.iter().zip(other.times_s.iter()).filter(|(a, b)| a.is_finite() && b.is_finite());
    let mut apart: Vec<f64> = both.map(|(a, b)| b - a).collect();
    apart.sort_by(f64::total_cmp);
    let at = |twentieth: usize| apart.get(twentieth * apart.len() / 20).copied();
    let (Some(low), Some(by_s), Some(high)) = (at(1), at(10), at(19)) else { return Relation::Same };
    let (spread, duration) = (high - low, duration(first));
    let is_constant = spread <= 1.5 * step(first).max(step(other)) + DRIFT * duration;
    let resolution = resolution(first).max(resolution(other));
    let is_zero = by_s.abs() <= resolution && spread <= resolution;
    match first.clock == other.clock && by_s.abs() < duration {
        true if is_zero => Relation::Same,
        true => Relation::Apart(by_s),
        false if is_constant => Relation::Same,
        false => Relation::Unclear,
    }
}

fn duration(timing: &Timing) -> f64 {
    let given = || timing.times_s.iter().copied().filter(|t| t.is_finite());
    given().next().zip(given().next_back()).map_or(0.0, |(first, last)| last - first)
}

fn step(timing: &Timing) -> f64 {
    let steps = timing.times_s.iter().zip(timing.times_s.iter().skip(1)).map(|(a, b)| b - a);
    middle(steps.filter(|step| *step > 0.0).collect()).unwrap_or_default()
}

/// A time that repeats is known to its step.
fn resolution(timing: &Timing) -> f64 {
    if repeats(timing) { step(timing) } else { SAME_S }
}
