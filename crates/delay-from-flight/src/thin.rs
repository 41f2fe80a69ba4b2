//! Reduces long records: measured channels are thinned, channels compared with are averaged. The memory of a pair then
//! does not grow with the length of a flight.

use crate::horizontal::Horizontal;
use flight::{Channel, Code, Notices, Severity, Stamp};

/// Every n-th update row of a channel, so that at most `most` remain, and at most about `most_hz` per second; and n. A
/// notice reports the numbers.
pub(crate) fn thinned_rows(
    channel: &Channel,
    (most, most_hz): (usize, f64),
    name: &str,
    notices: &mut Notices,
) -> (Vec<usize>, usize) {
    let rows = channel.update_count();
    // A rate slightly above is acceptable.
    let by_rate = (1.0 / (usual_step_s(channel) * most_hz) + 1e-6).floor();
    let by_rate = if by_rate.is_finite() { by_rate.max(1.0) as usize } else { 1 };
    let every = rows.div_ceil(most.max(1)).max(by_rate).max(1);
    if every > 1 {
        let used = rows / every;
        let text = format!("{name}: one sample in {every} is used for the delay, {used} of {rows}");
        notices.push(Code::SamplesLeftOut.at(Severity::Info), name, (rows - used) as u64, text);
    }
    (channel.updates().step_by(every).collect(), every)
}

/// Number of steps used for the usual one.
const MOST_STEPS: usize = 100_000;

/// The median time between two updates, s; in a long record from a subset.
fn usual_step_s(channel: &Channel) -> f64 {
    let stamps = channel.series.timeline().stamps();
    let mut before: Option<Stamp> = None;
    let step = |row: usize| before.replace(stamps[row]).map(|before| stamps[row].seconds_since(before));
    let every = (channel.update_count() / MOST_STEPS).max(1);
    let steps: Vec<f64> = channel.updates().filter_map(step).step_by(every).collect();
    signal::median_by_selection(&steps).unwrap_or(1.0)
}

/// Samples of a channel that another one is compared with, `N` numbers each. In a long record neighbours are averaged,
/// both time and values: the mean of a line is on the line, so nothing is shifted.
pub struct Averaged<const N: usize> {
    t: Vec<f64>,
    values: [Vec<f64>; N],
    /// Number of neighbours per average.
    each: usize,
    /// Neighbours are within this time, s: no mean spans a gap.
    longest_s: f64,
    begun_s: f64,
    count: usize,
    sums: (f64, [f64; N]),
}

/// Margin for uneven timestamps.
const UNEVEN: f64 = 1.5;

impl<const N: usize> Averaged<N> {
    /// Leaves about `most` samples of the updates of `channel`. A notice reports how many are averaged and for what.
    pub fn new((channel, name): (&Channel, &str), most: usize, what_for: &str, notices: &mut Notices) -> Averaged<N> {
        let rows = channel.update_count();
        let each = rows.div_ceil(most.max(1)).max(1);
        let longest_s = if each > 1 { UNEVEN * each as f64 * usual_step_s(channel) } else { 0.0 };
        if each > 1 {
            let left = rows / each;
            let text = format!("{name}: {each} neighbouring samples are averaged for {what_for}, {rows} to {left}");
            notices.push(Code::SamplesLeftOut.at(Severity::Info), name, (rows - rows / each) as u64, text);
        }
        Averaged { each, longest_s, ..Averaged::none(rows / each + 1) }
    }

    /// Every sample stays. `samples` is the approximate number: growing columns would take up to twice their memory.
    pub fn none(samples: usize) -> Averaged<N> {
        let (t, values) = (Vec::with_capacity(samples), std::array::from_fn(|_| Vec::with_capacity(samples)));
        Averaged { t, values, each: 1, longest_s: 0.0, begun_s: 0.0, count: 0, sums: (0.0, [0.0; N]) }
    }

    /// Number of neighbours per average.
    pub fn each(&self) -> usize {
        self.each
    }

    /// Adds a sample: its instant, s, and its values.
    pub fn push(&mut self, t: f64, values: [f64; N]) {
        if self.each == 1 {
            self.t.push(t);
            self.values.iter_mut().zip(values).for_each(|(column, value)| column.push(value));
            return;
        }
        if self.count > 0 && t - self.begun_s > self.longest_s {
            self.close();
        }
        if self.count == 0 {
            self.begun_s = t;
        }
        self.count += 1;
        self.sums.0 += t - self.begun_s;
        self.sums.1.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
        if self.count == self.each {
            self.close();
        }
    }

    fn close(&mut self) {
        if self.count == 0 {
            return;
        }
        let mean = |sum: f64| sum / self.count as f64;
        self.t.push(self.begun_s + mean(self.sums.0));
        self.values.iter_mut().zip(self.sums.1).for_each(|(column, sum)| column.push(mean(sum)));
        (self.count, self.sums) = (0, (0.0, [0.0; N]));
    }

    /// Times, s, and columns.
    pub fn finish(mut self) -> (Vec<f64>, [Vec<f64>; N]) {
        self.close();
        (self.t, self.values)
    }
}

impl Averaged<2> {
    /// The samples of a horizontal vector.
    pub fn horizontal(self) -> Horizontal {
        let (t, axes) = self.finish();
        Horizontal { t, axes }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use flight::{ChannelSource, Clock, Quantity, Series, StampKind, Timeline};

    fn velocity(t_ns: &[i64]) -> Channel {
        let timeline = Timeline::new(StampKind::Measured, Clock::Unix, t_ns.iter().copied().map(Stamp).collect());
        let rows = t_ns.len();
        Channel {
            quantity: Quantity::VelocityNed,
            series: Series::new(timeline.unwrap(), vec![vec![0.0; rows]; 3]).unwrap(),
            present: vec![true; 3],
            other_stamps: vec![],
            held: vec![false; rows],
            source: ChannelSource { topic: "t".into(), type_name: String::new(), fields: vec![] },
        }
    }

    fn averaged(t_ns: &[i64], most: usize, value: impl Fn(f64) -> f64) -> (Horizontal, Notices) {
        let mut notices = Notices::new();
        let mut out = Averaged::new((&velocity(t_ns), "velocity.ins"), most, "the delay", &mut notices);
        for t in t_ns.iter().map(|t| *t as f64 * 1e-9) {
            out.push(t, [value(t), -value(t)]);
        }
        (out.horizontal(), notices)
    }

    #[test]
    fn means_of_neighbours_are_on_the_line_and_never_span_a_gap() {
        // 100 Hz with a gap of 7 s after the 50th sample.
        let stamps: Vec<i64> = (0..100).map(|k| 10_000_000 * k + if k < 50 { 0 } else { 7_000_000_000 }).collect();
        let (found, notices) = averaged(&stamps, 25, |t| 3.0 * t - 1.0);
        assert_eq!(
            (found.t.len(), notices.iter().count()),
            (26, 1),
            "of 12 blocks of four and one of two on either side"
        );
        assert!(found.t.iter().zip(&found.axes[0]).all(|(t, v)| (v - (3.0 * t - 1.0)).abs() < 1e-12));
        assert!(found.t.iter().all(|t| *t < 0.495 || *t > 7.5), "{:?}", found.t);
        let sum: f64 = found.axes[1].iter().zip(&found.axes[0]).map(|(a, b)| a + b).sum();
        assert_eq!(sum, 0.0);
    }

    #[test]
    fn a_short_record_is_unchanged() {
        let stamps: Vec<i64> = (0..100).map(|k| 10_000_000 * k).collect();
        let (found, notices) = averaged(&stamps, 100, |t| t);
        assert_eq!((found.t.len(), notices.iter().count()), (100, 0));
        assert_eq!(found.t, found.axes[0]);
    }
}
