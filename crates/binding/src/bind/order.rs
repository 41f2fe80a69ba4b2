//! Sorts rows by timestamp, and drops those whose timestamp cannot be the time of their value.
//!
//! Out-of-order rows are only sorted. A clock that is set back covers a time twice, and sorting would interleave two
//! stretches of the flight: the longer one is kept. A few rows that jump away and back have a wrong timestamp, unless
//! they fill a hole where they land.

use flight::{Clock, NANOS_PER_SECOND};
use formats::Places;
use std::collections::BTreeMap;
use std::ops::Range;

/// A timestamp further than this from the median of its channel is not of the flight.
pub(super) const FAR_NS: u64 = 86_400 * NANOS_PER_SECOND as u64;
/// A step back of this many usual steps is more than disorder.
const DEEP_STEPS: u64 = 4;
/// The most rows that jump away together.
const FEW: usize = 5;

/// Why a row is dropped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Reason {
    NeverFilled,
    Far,
    PassedTwice,
    OutOfLine,
    Repeated,
    /// It is unknown which of the two rows is right.
    Shared,
}

impl Reason {
    pub(super) fn text(self) -> &'static str {
        match self {
            Reason::NeverFilled => "timestamp zero, long before the others: never filled in",
            Reason::Far => "timestamp more than a day away from the others",
            Reason::PassedTwice => "the clock went back to a time that other rows already have",
            Reason::OutOfLine => "timestamp does not fit between those of the rows around it",
            Reason::Repeated => "timestamp equal to the one before",
            Reason::Shared => "timestamp equal to the one before, but a different value",
        }
    }
}

/// Whether rows dropped for this reason have the timestamp of the row before.
pub(super) fn is_duplicate(reason: &str) -> bool {
    [Reason::Repeated, Reason::Shared].iter().any(|duplicate| duplicate.text() == reason)
}

/// Whether rows dropped for this reason are otherwise valid, and only their time is unknown.
pub(super) fn is_of_clock(reason: &str) -> bool {
    [Reason::Far, Reason::PassedTwice].iter().any(|of_clock| of_clock.text() == reason)
}

/// The rows that are used, in columns: index, timestamp, values. A log may have many millions.
#[derive(Default)]
pub(super) struct Samples {
    /// The row of each sample, counted from 1.
    rows: Places,
    stamps: Vec<i64>,
    /// One for each component of the quantity; empty while all values are zero, such as a height that the log lacks.
    values: Vec<Vec<f64>>,
}

/// Samples whose timestamps are still in the timestamps of all rows.
#[derive(Default)]
pub(super) struct Unstamped {
    count: usize,
    /// The maximum number of samples.
    most: usize,
    rows: Places,
    values: Vec<Vec<f64>>,
}

impl Unstamped {
    /// For a table with at most this many rows.
    pub(super) fn new(components: usize, most: usize) -> Unstamped {
        Unstamped { values: vec![vec![]; components], most, ..Unstamped::default() }
    }

    /// Takes as many values as there are components.
    pub(super) fn push(&mut self, row: usize, values: [f64; 4]) {
        let before = self.count;
        self.rows.push(before, row as u64 + 1);
        self.count += 1;
        for (column, value) in self.values.iter_mut().zip(values) {
            if !column.is_empty() || value.to_bits() != 0 {
                // Only once: a growing column fragments the memory.
                column.reserve_exact(self.most.saturating_sub(before));
                column.resize(before, 0.0);
                column.push(value);
            }
        }
    }

    /// Attaches the timestamp of each row.
    pub(super) fn stamped(self, stamp_of: impl Fn(usize) -> i64) -> Samples {
        let Unstamped { count, rows, mut values, .. } = self;
        values.iter_mut().for_each(Vec::shrink_to_fit);
        let stamps = (0..count).map(|sample| stamp_of(row_of(&rows, sample))).collect();
        Samples { rows, stamps, values }
    }
}

impl Samples {
    pub(super) fn len(&self) -> usize {
        self.stamps.len()
    }

    pub(super) fn is_empty(&self) -> bool {
        self.stamps.is_empty()
    }

    pub(super) fn stamps(&self) -> &[i64] {
        &self.stamps
    }

    /// The table row of a sample.
    pub(super) fn row(&self, sample: usize) -> usize {
        row_of(&self.rows, sample)
    }

    /// The rows of all samples.
    pub(super) fn rows(&self) -> impl Iterator<Item = usize> {
        (0..self.len()).map(|sample| self.row(sample))
    }

    /// Whether the first `components` components of two samples are equal.
    pub(super) fn is_same(&self, a: usize, b: usize, components: usize) -> bool {
        self.values.iter().take(components).all(|column| column.get(a) == column.get(b))
    }

    /// Whether the first `components` components of these samples change by one step of their resolution nearly every
    /// time: such values repeat because they are rounded.
    pub(super) fn is_rounded(&self, at: &[usize], components: usize) -> bool {
        const NEARLY_ALL: f64 = 0.8;
        let changes = |column: &'_ Vec<f64>| -> Vec<f64> {
            let pairs = at.iter().zip(at.iter().skip(1));
            let change = |(a, b): (&usize, &usize)| Some((column.get(*b)? - column.get(*a)?).abs());
            pairs.filter_map(change).filter(|change| *change > 0.0).collect()
        };
        let of_column = |column: &Vec<f64>| {
            let changes = changes(column);
            let step = changes.iter().copied().fold(f64::MAX, f64::min);
            (changes.iter().filter(|change| **change < 1.5 * step).count(), changes.len())
        };
        let counts = self.values.iter().take(components).map(of_column);
        let (single, all) = counts.fold((0, 0), |sum, of| (sum.0 + of.0, sum.1 + of.1));
        all > 0 && single as f64 >= NEARLY_ALL * all as f64
    }

    /// Timestamps and components.
    pub(super) fn into_columns(self) -> (Vec<i64>, Vec<Vec<f64>>) {
        let rows = self.stamps.len();
        // Zeros that are never written are provided by the system on reading, and take no memory.
        let whole = |values: Vec<f64>| if values.is_empty() { vec![0.0; rows] } else { values };
        (self.stamps, self.values.into_iter().map(whole).collect())
    }

    /// Drops those for which `why` gives a reason.
    fn keep(&mut self, rejected: Reject<'_>, mut why: impl FnMut(&Samples, usize) -> Option<Reason>) {
        let reasons: Vec<Option<Reason>> = (0..self.len()).map(|sample| why(self, sample)).collect();
        if reasons.iter().all(Option::is_none) {
            return;
        }
        let mut rows = Places::default();
        let mut kept = 0;
        for (sample, reason) in reasons.iter().enumerate() {
            match reason {
                Some(reason) => rejected(*reason, self.row(sample)),
                None => {
                    rows.push(kept, self.rows.of(sample));
                    kept += 1;
                }
            }
        }
        self.rows = rows;
        retain(&mut self.stamps, &reasons);
        self.values.iter_mut().for_each(|column| retain(column, &reasons));
    }

    /// Samples with equal timestamps stay in the order of the log.
    fn sort(&mut self) {
        if self.stamps.is_sorted() {
            return;
        }
        let stamp = |sample: &usize| self.stamps.get(*sample).copied();
        let mut order: Vec<usize> = (0..self.len()).collect();
        order.sort_by_key(stamp);
        self.rows = order.iter().map(|sample| self.rows.of(*sample)).collect();
        self.stamps = order.iter().filter_map(stamp).collect();
        for column in &mut self.values {
            *column = order.iter().filter_map(|sample| column.get(*sample).copied()).collect();
        }
    }
}

fn row_of(rows: &Places, sample: usize) -> usize {
    rows.of(sample).saturating_sub(1) as usize
}

fn retain<T>(values: &mut Vec<T>, reasons: &[Option<Reason>]) {
    let mut reasons = reasons.iter();
    values.retain(|_| reasons.next().is_none_or(Option::is_none));
    values.shrink_to_fit();
}

/// Called with the reason and the row of each dropped sample.
pub(super) type Reject<'r> = &'r mut dyn FnMut(Reason, usize);

/// Drops rows that are years or days off, and zeros before the first valid timestamp of a clock that does not know the
/// day.
pub(super) fn leave_out_far(samples: &mut Samples, clock: Clock, rejected: Reject<'_>) {
    leave_out_unset(samples, clock, rejected);
    let middle = samples.len() / 2;
    if middle == 0 {
        return;
    }
    let median = match samples.stamps.is_sorted() {
        true => samples.stamps.get(middle).copied().unwrap_or_default(),
        false => *samples.stamps.clone().select_nth_unstable(middle).1,
    };
    let is_far = |stamp: &i64| stamp.abs_diff(median) > FAR_NS;
    if samples.stamps.iter().any(is_far) {
        samples.keep(rejected, |all, sample| all.stamps.get(sample).is_some_and(is_far).then_some(Reason::Far));
    }
}

fn leave_out_unset(samples: &mut Samples, clock: Clock, rejected: Reject<'_>) {
    let zeros = samples.stamps.iter().take_while(|stamp| **stamp == 0).count();
    if zeros == 0 || !matches!(clock, Clock::Boot | Clock::Elapsed) {
        return;
    }
    let (Some(first), Some(step)) = (samples.stamps.get(zeros), usual_step(&samples.stamps)) else { return };
    if first.unsigned_abs() > DEEP_STEPS * step {
        samples.keep(rejected, |_, sample| (sample < zeros).then_some(Reason::NeverFilled));
    }
}

/// Sorts by timestamp; of equal ones the first in the log is kept.
pub(super) fn sort(samples: &mut Samples, rejected: Reject<'_>) {
    let reasons = misplaced(samples);
    if !reasons.is_empty() {
        samples.keep(rejected, |_, sample| reasons.get(sample).copied().flatten());
    }
    samples.sort();
    let equal = |pair: &[i64]| matches!(pair, [a, b] if a == b);
    if !samples.stamps.windows(2).any(equal) {
        return;
    }
    let mut last: Option<usize> = None;
    samples.keep(rejected, |all, sample| match last {
        Some(kept) if all.stamps.get(kept) == all.stamps.get(sample) => {
            Some(if all.is_same(kept, sample, all.values.len()) { Reason::Repeated } else { Reason::Shared })
        }
        _ => {
            last = Some(sample);
            None
        }
    });
}

/// The 90th percentile of the steps forward, ns; `None` if there are too few.
fn usual_step(stamps: &[i64]) -> Option<u64> {
    let step = |pair: &[i64]| match pair {
        [a, b] if b > a => Some(b.abs_diff(*a)),
        _ => None,
    };
    let mut steps: Vec<u64> = stamps.windows(2).filter_map(step).collect();
    let place = steps.len() * 9 / 10;
    (steps.len() > FEW).then(|| *steps.select_nth_unstable(place).1)
}

/// Why each row is dropped, in the order of the log. Mere disorder drops no row.
fn misplaced(samples: &Samples) -> Vec<Option<Reason>> {
    if samples.stamps.is_sorted() {
        return vec![];
    }
    let Some(step) = usual_step(&samples.stamps) else { return vec![] };
    let mut pieces = pieces(&samples.stamps, DEEP_STEPS * step);
    if !pieces.iter().any(|p| p.out_of_order) {
        return vec![];
    }
    let mut reasons = vec![None; samples.len()];
    let mut placed = Placed { rows: BTreeMap::new(), samples, step };
    // The longest first; of equal ones the earlier.
    pieces.sort_by_key(|p| std::cmp::Reverse(p.rows.len()));
    for piece in pieces {
        placed.add(&piece, &mut reasons);
    }
    reasons
}

/// Rows between two deep steps.
struct Piece {
    rows: Range<usize>,
    /// It begins or ends with a step back.
    out_of_order: bool,
}

fn pieces(stamps: &[i64], deep_ns: u64) -> Vec<Piece> {
    let mut pieces: Vec<Piece> = vec![];
    let (mut start, mut went_back) = (0, false);
    for (row, pair) in (1..).zip(stamps.windows(2)) {
        let [before, now] = pair else { continue };
        if before.abs_diff(*now) > deep_ns {
            let back = now < before;
            pieces.push(Piece { rows: start..row, out_of_order: went_back || back });
            (start, went_back) = (row, back);
        }
    }
    pieces.push(Piece { rows: start..stamps.len(), out_of_order: went_back });
    pieces
}

/// Rows that are kept, by timestamp.
struct Placed<'s> {
    rows: BTreeMap<i64, usize>,
    samples: &'s Samples,
    step: u64,
}

/// What surrounds the position of a row.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Place {
    /// Other rows are close before and after it, or another value is there.
    Taken,
    /// Between rows, with room for more.
    Hole,
    /// At either end.
    End,
    /// Far from either end.
    Beyond,
}

impl Placed<'_> {
    fn add(&mut self, piece: &Piece, reasons: &mut [Option<Reason>]) {
        let places: Vec<Place> = piece.rows.clone().map(|row| self.place(row)).collect();
        let count = |of: &[Place]| places.iter().filter(|p| of.contains(p)).count();
        let taken = count(&[Place::Taken]);
        let mixed = 2 * taken > taken + count(&[Place::Hole]);
        let leap = piece.out_of_order && piece.rows.len() <= FEW;
        for (row, place) in piece.rows.clone().zip(places) {
            let reason = match place {
                Place::Taken if leap => Some(Reason::OutOfLine),
                Place::Taken => Some(Reason::PassedTwice),
                Place::Hole if mixed => Some(Reason::PassedTwice),
                Place::Beyond if leap => Some(Reason::OutOfLine),
                Place::End | Place::Beyond if mixed && !self.continues(row) => Some(Reason::PassedTwice),
                _ => None,
            };
            match (reason, self.samples.stamps.get(row)) {
                (None, Some(stamp)) => drop(self.rows.entry(*stamp).or_insert(row)),
                _ => reasons.get_mut(row).into_iter().for_each(|r| *r = reason),
            }
        }
    }

    /// Whether a row at an end of the kept ones comes at that end in the log too. After a restart to zero the first rows
    /// are earlier than the flight and come after it.
    fn continues(&self, row: usize) -> bool {
        let Some(stamp) = self.samples.stamps.get(row) else { return true };
        match (self.rows.first_key_value(), self.rows.last_key_value()) {
            (Some((first, of_first)), _) if stamp < first => row < *of_first,
            (_, Some((last, of_last))) if stamp > last => row > *of_last,
            _ => true,
        }
    }

    fn place(&self, row: usize) -> Place {
        let Some(&stamp) = self.samples.stamps.get(row) else { return Place::End };
        if let Some(other) = self.rows.get(&stamp) {
            // A repeat of the same row is only a duplicate.
            let is_same = self.samples.is_same(*other, row, self.samples.values.len());
            return if is_same { Place::Hole } else { Place::Taken };
        }
        let before = self.rows.range(..stamp).next_back().map(|(s, _)| stamp.abs_diff(*s));
        let after = self.rows.range(stamp..).next().map(|(s, _)| stamp.abs_diff(*s));
        match (before, after) {
            // A missing row leaves two steps.
            (Some(before), Some(after)) if 10 * (before + after) < 19 * self.step => Place::Taken,
            (Some(_), Some(_)) => Place::Hole,
            (Some(gap), None) | (None, Some(gap)) if gap > DEEP_STEPS * self.step => Place::Beyond,
            _ => Place::End,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Timestamps and rows that are kept, and reasons and rows that are dropped.
    type Sorted = (Vec<(i64, usize)>, Vec<(Reason, usize)>);

    fn sorted(clock: Clock, stamps: &[i64]) -> Sorted {
        let mut samples = Unstamped::new(3, stamps.len());
        (0..stamps.len()).for_each(|row| samples.push(row, [row as f64, 0.0, 0.0, 0.0]));
        let mut samples = samples.stamped(|row| stamps[row]);
        let mut rejected = vec![];
        leave_out_far(&mut samples, clock, &mut |why, row| rejected.push((why, row)));
        sort(&mut samples, &mut |why, row| rejected.push((why, row)));
        assert!(samples.stamps.windows(2).all(|w| w[0] < w[1]));
        assert_eq!(samples.len() + rejected.len(), stamps.len());
        // The values are those of the row.
        assert!(samples.rows().map(|row| row as f64).eq(samples.values[0].iter().copied()));
        (samples.stamps.iter().copied().zip(samples.rows()).collect(), rejected)
    }

    fn line(from: i64, rows: i64) -> Vec<i64> {
        (0..rows).map(|i| from + 100 * i).collect()
    }

    #[test]
    fn out_of_order_rows_are_sorted_without_losing_any() {
        let swapped = (0..100).map(|i| 100 * (i ^ 1)).collect();
        let late = {
            let mut l = line(0, 100);
            let one = l.remove(20);
            l.insert(60, one);
            l
        };
        let blocks = [line(5000, 50), line(0, 50)].concat();
        let files = [line(0, 30), line(9000, 30), line(3000, 30), line(6000, 30)].concat();
        let shuffled = (0..101).map(|i| 100 * (i * 37 % 101)).collect();
        for stamps in [swapped, late, blocks, files, shuffled] {
            let (kept, rejected) = sorted(Clock::Boot, &stamps);
            assert!(rejected.is_empty(), "{stamps:?}: {rejected:?}");
            assert_eq!(kept.len(), stamps.len());
        }
    }

    #[test]
    fn the_longer_of_two_overlapping_stretches_is_kept_whole() {
        // A device that restarts: its first three hundred rows are from before the flight.
        let (kept, rejected) = sorted(Clock::Boot, &[line(1000, 300), line(1050, 900)].concat());
        assert!(kept.iter().all(|(_, row)| *row >= 300 || *row == 0), "{kept:?}");
        assert!(rejected.iter().all(|(why, row)| *why == Reason::PassedTwice && (1..300).contains(row)));
        // Set back by a second in the middle: ten rows are covered twice.
        let (kept, rejected) = sorted(Clock::Unix, &[line(0, 500), line(49_000, 400)].concat());
        assert_eq!((kept.len(), rejected.len()), (890, 10));
        assert!(rejected.iter().all(|(_, row)| (500..510).contains(row)));
        // Restarted at zero after the flight: its first rows, from before the times of the flight, are of another.
        let (kept, rejected) = sorted(Clock::Elapsed, &[line(2000, 2000), line(0, 480)].concat());
        assert_eq!((kept.len(), rejected.len()), (2000, 480));
        assert!(rejected.iter().all(|(why, row)| *why == Reason::PassedTwice && *row >= 2000));
        let (kept, rejected) = sorted(Clock::Elapsed, &[line(0, 480), line(-2000, 2000)].concat());
        assert_eq!((kept.len(), rejected.len()), (2000, 480));
        assert!(rejected.iter().all(|(_, row)| *row < 480));
    }

    #[test]
    fn rows_that_jump_away_and_back_are_dropped() {
        for length in [1, 3, 5] {
            for leap in [-3_600_000, -1_000, -5_000, 1_000, 5_000, 3_600_000] {
                for begin in [0, 40, 85] {
                    let mut stamps = line(100_000, 100);
                    stamps[begin..begin + length].iter_mut().for_each(|s| *s += leap);
                    let (kept, rejected) = sorted(Clock::Boot, &stamps);
                    let good = |(stamp, row): &(i64, usize)| *stamp == 100_000 + 100 * *row as i64;
                    // At the very start a jump back leaves a hole after it.
                    if begin > 0 || leap > 0 {
                        assert!(kept.iter().all(good), "{length} {leap} {begin}: {kept:?}");
                        assert_eq!(rejected.len(), length);
                    }
                }
            }
        }
    }

    #[test]
    fn leading_zeros_are_dropped_unless_the_time_begins_at_zero() {
        let (kept, rejected) = sorted(Clock::Boot, &[vec![0; 3], line(60_000, 20)].concat());
        assert_eq!((kept[0].0, rejected.len(), rejected[0].0), (60_000, 3, Reason::NeverFilled));
        assert_eq!(sorted(Clock::Elapsed, &line(0, 20)).1, []);
        // A clock of whole seconds repeats its zero as it does every other.
        let coarse: Vec<i64> = (0..60).map(|i| 1000 * (i / 10)).collect();
        assert_eq!(
            sorted(Clock::Elapsed, &coarse).0.iter().map(|k| k.0).collect::<Vec<_>>(),
            [0, 1000, 2000, 3000, 4000, 5000]
        );
    }

    /// Values that change by one step nearly every time are rounded; other repeats are held values.
    #[test]
    fn values_that_change_by_one_step_are_rounded() {
        let rounded = |values: &[f64]| {
            let mut samples = Unstamped::new(1, values.len());
            values.iter().enumerate().for_each(|(row, value)| samples.push(row, [*value, 0.0, 0.0, 0.0]));
            let samples = samples.stamped(|row| row as i64);
            samples.is_rounded(&(0..values.len()).collect::<Vec<usize>>(), 1)
        };
        assert!(rounded(&[0.0, 0.1, 0.1, 0.2, 0.1, 0.1, 0.0]));
        assert!(!rounded(&[0.0, 0.1, 0.1, 0.7, 0.2, 0.9, 0.3]));
        // Four of five changes are of one step; three of four are too few.
        assert!(rounded(&[0.0, 1.0, 2.0, 3.0, 4.0, 6.0]));
        assert!(!rounded(&[0.0, 1.0, 2.0, 3.0, 5.0]));
        assert!(!rounded(&[1.0, 1.0, 1.0]), "no change shows no step");
    }
}
