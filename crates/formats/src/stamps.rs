//! Statistics of timestamps: counts, steps, gaps, jumps; streaming for a whole log, exact for a column.

use flight::{Clock, Distribution, Gap, StampHealth, StampKind};

/// A step longer than this many median steps is a gap.
const GAP_FACTOR: f64 = 2.5;
/// The number of gaps that are listed.
const LISTED_GAPS: usize = 10;
/// At most one of this many steps may be a gap for gaps to be excluded from the rate.
const STEPS_FOR_A_GAP: u64 = 100;
/// If one timestamp has this share of all rows, and at least two, the rows were written at once and have no rate.
const AT_ONCE: u64 = 2;
/// Steps held individually before a streaming count switches to buckets.
const HELD_STEPS: usize = 1024;
/// Buckets per octave of the step: the middle of one is within 1/256 of any step in it.
const BUCKETS: usize = 1 << BUCKET_BITS;
const BUCKET_BITS: u32 = 7;

/// Describes the timestamps of one topic, taken one at a time in the order of the log.
///
/// A step is a timestamp minus the one before it. Forward steps (above zero) make the distribution, the rate and the
/// gaps. Equal timestamps and steps back are counted separately, so that a topic that sends everything twice has its
/// true rate. Where one timestamp holds half of all rows, they were written at once, as the parameters at the start of
/// a log: no rate.
///
/// Counts, ends, extremes and the ten longest gaps are always exact. Percentiles (linear between order statistics, as
/// NumPy's default) are exact up to 1024 forward steps. Above that, memory stays below 33 kB, each percentile is within
/// 0.4 % of the true step, and the number of gaps is exact except for steps within 0.4 % of the threshold. Measured by
/// `a_long_stream_is_described_within_four_per_mille`.
#[derive(Debug, Clone)]
pub struct StampStats {
    count: u64,
    first_ns: i64,
    last_ns: i64,
    duplicates: u64,
    /// Runs of equal timestamps: the current one, and the longest.
    equal: u64,
    most_equal: u64,
    back_jumps: u64,
    forward: Steps,
    forward_count: u64,
    forward_ns: u128,
    longest: Vec<LongStep>,
}

#[derive(Debug, Clone, Copy)]
struct LongStep {
    step_ns: u64,
    start_ns: i64,
}

impl Default for StampStats {
    fn default() -> StampStats {
        StampStats::new()
    }
}

impl StampStats {
    /// For a stream of any length, in bounded memory.
    #[must_use]
    pub fn new() -> StampStats {
        StampStats::with(Steps::Held { steps: vec![], most: HELD_STEPS })
    }

    /// Counts, ends and jumps only: no distribution, rate or gaps. For logs with many topics, where full
    /// descriptions would take too much memory.
    #[must_use]
    pub fn counts_only() -> StampStats {
        StampStats::with(Steps::Ignored)
    }

    /// Exact description of timestamps that are in memory; `None` if there are none.
    #[must_use]
    pub fn from_slice(kind: StampKind, clock: Clock, source: &str, stamps_ns: &[i64]) -> Option<StampHealth> {
        let mut stats = StampStats::with(Steps::Held { steps: vec![], most: usize::MAX });
        for &stamp in stamps_ns {
            stats.push(stamp);
        }
        stats.finish(kind, clock, source)
    }

    fn with(forward: Steps) -> StampStats {
        StampStats {
            count: 0,
            first_ns: 0,
            last_ns: 0,
            duplicates: 0,
            equal: 0,
            most_equal: 0,
            back_jumps: 0,
            forward,
            forward_count: 0,
            forward_ns: 0,
            longest: vec![],
        }
    }

    /// Adds the next timestamp, ns.
    pub fn push(&mut self, stamp_ns: i64) {
        if self.count == 0 {
            self.first_ns = stamp_ns;
        } else {
            self.step(self.last_ns, stamp_ns);
        }
        self.equal = if self.count > 0 && stamp_ns == self.last_ns { self.equal + 1 } else { 1 };
        self.most_equal = self.most_equal.max(self.equal);
        self.last_ns = stamp_ns;
        self.count += 1;
    }

    fn step(&mut self, before: i64, now: i64) {
        match now.cmp(&before) {
            std::cmp::Ordering::Less => self.back_jumps += 1,
            std::cmp::Ordering::Equal => self.duplicates += 1,
            std::cmp::Ordering::Greater => {
                let step_ns = now.abs_diff(before);
                self.forward.push(step_ns);
                self.forward_count += 1;
                self.forward_ns += u128::from(step_ns);
                self.keep_if_long(LongStep { step_ns, start_ns: before });
            }
        }
    }

    /// The ten longest gaps are among the ten longest steps, whatever the median turns out to be.
    fn keep_if_long(&mut self, step: LongStep) {
        let full = self.longest.len() == LISTED_GAPS;
        if full && self.longest.last().is_some_and(|shortest| step.step_ns <= shortest.step_ns) {
            return;
        }
        let place = self.longest.partition_point(|kept| kept.step_ns >= step.step_ns);
        self.longest.insert(place, step);
        self.longest.truncate(LISTED_GAPS);
    }

    /// The number of timestamps so far.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Forward steps per second without the gaps. Frequent gaps are not gaps but normal for the topic. `None` for rows
    /// that were written at once.
    fn rate_hz(&self, threshold_s: f64) -> Option<f64> {
        if self.most_equal > 1 && self.most_equal * AT_ONCE >= self.count {
            return None;
        }
        let gaps = self.longest.iter().map(|l| l.step_ns).filter(|&ns| seconds(ns) > threshold_s);
        let (gaps, gaps_ns) = gaps.fold((0, 0), |(count, sum), ns| (count + 1, sum + u128::from(ns)));
        let all = (self.forward_count, self.forward_ns);
        let (count, ns) = match self.forward.up_to_s(threshold_s) {
            _ if gaps < LISTED_GAPS as u64 => (all.0 - gaps, all.1 - gaps_ns),
            few if (all.0 - few.0) * STEPS_FOR_A_GAP <= all.0 => few,
            _ => all,
        };
        Some(count as f64 * 1e9 / ns as f64)
    }

    /// The description; `None` if there was no timestamp.
    #[must_use]
    pub fn finish(mut self, kind: StampKind, clock: Clock, source: &str) -> Option<StampHealth> {
        if self.count == 0 {
            return None;
        }
        let steps_s = self.forward.distribution_s();
        let threshold_s = steps_s.map(|d| GAP_FACTOR * d.median);
        Some(StampHealth {
            kind,
            clock,
            source: source.to_owned(),
            first_ns: self.first_ns,
            last_ns: self.last_ns,
            count: self.count,
            rate_hz: threshold_s.and_then(|t| self.rate_hz(t)),
            steps_s,
            gap_count: threshold_s.map_or(0, |t| self.forward.count_above_s(t)),
            gaps: threshold_s.map_or(vec![], |t| self.gaps_above_s(t)),
            duplicates: self.duplicates,
            back_jumps: self.back_jumps,
        })
    }

    fn gaps_above_s(&self, threshold_s: f64) -> Vec<Gap> {
        self.longest
            .iter()
            .map(|long| Gap {
                start_s: flight::Stamp(long.start_ns).seconds_since(flight::Stamp(self.first_ns)),
                length_s: seconds(long.step_ns),
            })
            .filter(|gap| gap.length_s > threshold_s)
            .collect()
    }
}

/// Order statistics of a sample; non-finite values are skipped. `None` if no value remains.
#[must_use]
pub fn distribution(values: &[f64]) -> Option<Distribution> {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    sorted.sort_unstable_by(f64::total_cmp);
    percentiles(sorted.len() as u64, |rank| sorted.get(rank as usize).copied().unwrap_or_default())
}

/// `at(rank)` is the value of that rank, from 0.
fn percentiles(count: u64, at: impl Fn(u64) -> f64) -> Option<Distribution> {
    let last = count.checked_sub(1)?;
    let quantile = |p: f64| {
        let position = p * last as f64;
        let below = at(position.floor() as u64);
        let above = at(position.ceil() as u64);
        below + (above - below) * position.fract()
    };
    Some(Distribution { min: at(0), p01: quantile(0.01), median: quantile(0.5), p99: quantile(0.99), max: at(last) })
}

fn seconds(nanos: u64) -> f64 {
    nanos as f64 / flight::NANOS_PER_SECOND as f64
}

#[derive(Debug, Clone)]
enum Steps {
    Held { steps: Vec<u64>, most: usize },
    Bucketed(Buckets),
    Ignored,
}

impl Steps {
    fn push(&mut self, step_ns: u64) {
        match self {
            Steps::Ignored => {}
            Steps::Bucketed(buckets) => buckets.push(step_ns),
            Steps::Held { steps, most } if steps.len() < *most => steps.push(step_ns),
            Steps::Held { steps, .. } => {
                let mut buckets = Buckets::default();
                steps.iter().for_each(|&s| buckets.push(s));
                buckets.push(step_ns);
                *self = Steps::Bucketed(buckets);
            }
        }
    }

    fn distribution_s(&mut self) -> Option<Distribution> {
        match self {
            Steps::Ignored => None,
            Steps::Bucketed(buckets) => percentiles(buckets.count, |rank| seconds(buckets.at(rank))),
            Steps::Held { steps, .. } => {
                steps.sort_unstable();
                percentiles(steps.len() as u64, |rank| seconds(steps.get(rank as usize).copied().unwrap_or_default()))
            }
        }
    }

    /// Number and sum, ns, of the steps up to a threshold.
    fn up_to_s(&self, threshold_s: f64) -> (u64, u128) {
        let sum = |steps: &mut dyn Iterator<Item = (u64, u64)>| {
            let short = steps.filter(|(step, _)| seconds(*step) <= threshold_s);
            short.fold((0, 0), |(n, ns), (step, tally)| (n + tally, ns + u128::from(step) * u128::from(tally)))
        };
        match self {
            Steps::Ignored => (0, 0),
            Steps::Bucketed(buckets) => sum(&mut buckets.middles()),
            Steps::Held { steps, .. } => sum(&mut steps.iter().map(|step| (*step, 1))),
        }
    }

    fn count_above_s(&self, threshold_s: f64) -> u64 {
        match self {
            Steps::Ignored => 0,
            Steps::Bucketed(buckets) => buckets.count_above_s(threshold_s),
            Steps::Held { steps, .. } => steps.iter().filter(|&&s| seconds(s) > threshold_s).count() as u64,
        }
    }
}

/// A histogram of steps with buckets of equal relative width; only octaves that occur are held.
#[derive(Debug, Clone)]
struct Buckets {
    count: u64,
    min_ns: u64,
    max_ns: u64,
    octaves: Vec<Option<Box<[u32; BUCKETS]>>>,
}

impl Default for Buckets {
    fn default() -> Buckets {
        Buckets { count: 0, min_ns: u64::MAX, max_ns: 0, octaves: vec![None; u64::BITS as usize] }
    }
}

impl Buckets {
    fn push(&mut self, step_ns: u64) {
        self.count += 1;
        self.min_ns = self.min_ns.min(step_ns);
        self.max_ns = self.max_ns.max(step_ns);
        let (octave, bucket) = bucket_of(step_ns);
        if let Some(octave) = self.octaves.get_mut(octave)
            && let Some(tally) = octave.get_or_insert_with(|| Box::new([0; BUCKETS])).get_mut(bucket)
        {
            *tally = tally.saturating_add(1);
        }
    }

    /// Middle and count of every bucket in use, in ascending order.
    fn middles(&self) -> impl Iterator<Item = (u64, u64)> {
        self.octaves.iter().enumerate().flat_map(move |(octave, tallies)| {
            tallies.iter().flat_map(move |tallies| {
                tallies.iter().enumerate().filter(|(_, tally)| **tally > 0).map(move |(bucket, &tally)| {
                    (middle_of(octave, bucket).clamp(self.min_ns, self.max_ns), u64::from(tally))
                })
            })
        })
    }

    fn at(&self, rank: u64) -> u64 {
        if rank == 0 {
            return self.min_ns;
        }
        let mut below = 0;
        for (middle, tally) in self.middles() {
            below += tally;
            if rank < below && rank + 1 < self.count {
                return middle;
            }
        }
        self.max_ns
    }

    fn count_above_s(&self, threshold_s: f64) -> u64 {
        self.middles().filter(|&(middle, _)| seconds(middle) > threshold_s).map(|(_, tally)| tally).sum()
    }
}

fn bucket_of(step_ns: u64) -> (usize, usize) {
    let octave = u64::BITS - 1 - step_ns.max(1).leading_zeros();
    let fraction = step_ns.max(1) ^ (1 << octave);
    let bucket =
        if octave >= BUCKET_BITS { fraction >> (octave - BUCKET_BITS) } else { fraction << (BUCKET_BITS - octave) };
    (octave as usize, bucket as usize)
}

fn middle_of(octave: usize, bucket: usize) -> u64 {
    let top = 1u64 << octave;
    let width = top >> BUCKET_BITS;
    let low = (bucket as u64) << octave.saturating_sub(BUCKET_BITS as usize);
    let low = if octave < BUCKET_BITS as usize { bucket as u64 >> (BUCKET_BITS as usize - octave) } else { low };
    top + low + width / 2
}

#[cfg(test)]
mod tests {
    use super::*;

    fn described(stamps: &[i64]) -> StampHealth {
        StampStats::from_slice(StampKind::Logged, Clock::Unix, "log", stamps).unwrap()
    }

    #[test]
    fn a_hole_in_a_regular_stream_is_its_only_gap() {
        let stamps: Vec<i64> = (0..101).map(|i| i * 10_000_000 + if i > 60 { 500_000_000 } else { 0 }).collect();
        let health = described(&stamps);
        assert_eq!(health.rate_hz, Some(100.0));
        assert_eq!(health.gap_count, 1);
        assert_eq!(health.gaps, [Gap { start_s: 0.6, length_s: 0.51 }]);
        assert_eq!((health.duplicates, health.back_jumps, health.count), (0, 0, 101));
    }

    #[test]
    fn a_topic_that_sends_everything_twice_has_the_rate_of_its_samples() {
        let stamps: Vec<i64> = (0..200).map(|i| (i / 2) * 20_000_000).collect();
        let health = described(&stamps);
        assert_eq!((health.rate_hz, health.duplicates, health.gap_count), (Some(50.0), 100, 0));
    }

    #[test]
    fn a_step_back_is_a_jump_and_does_not_affect_gaps_or_rate() {
        let health = described(&[0, 10, 20, 5, 15, 25]);
        assert_eq!((health.back_jumps, health.gap_count, health.duplicates), (1, 0, 0));
        assert_eq!(health.steps_s.unwrap().median, 1e-8);
        assert_eq!((health.first_ns, health.last_ns), (0, 25));
    }

    #[test]
    fn rows_written_at_once_have_no_rate() {
        // The parameters at the start of a log, and some that were changed in flight.
        let parameters: Vec<i64> = vec![71; 1298].into_iter().chain((1..=8).map(|i| 71 + i * 30)).collect();
        let formats: Vec<i64> = vec![0; 77].into_iter().chain(vec![71; 77]).collect();
        for stamps in [parameters, formats] {
            assert_eq!(described(&stamps).rate_hz, None);
        }
        // Five sensors that share a timestamp, twenty times, are 50 Hz.
        let sensors: Vec<i64> = (0..100).map(|i| (i / 5) * 20_000_000).collect();
        assert_eq!(described(&sensors).rate_hz, Some(50.0));
        assert_eq!(described(&[0, 20_000_000]).rate_hz, Some(50.0));
    }

    #[test]
    fn a_logger_that_pauses_often_has_the_rate_at_which_it_logs() {
        // 5 Hz with a pause of 40 s after every 190 rows, as in a parachutist's log.
        let mut now = 0;
        let stamps = (0..6731).map(|row| {
            now += if row % 190 == 189 { 40_000_000_000 } else { 200_000_000 };
            now
        });
        let stamps: Vec<i64> = stamps.collect();
        let health = described(&stamps);
        assert_eq!((health.rate_hz, health.gap_count), (Some(5.0), 35));
        let mut stream = StampStats::new();
        stamps.iter().for_each(|stamp| stream.push(*stamp));
        let streamed = stream.finish(StampKind::Logged, Clock::Unix, "log").unwrap().rate_hz.unwrap();
        assert!((streamed / 5.0 - 1.0).abs() < 0.004, "{streamed}");
        // A topic that comes in pairs a second apart has no gaps: that is normal for it.
        let pairs: Vec<i64> = (0..200).map(|i| (i / 2) * 1_000_000_000 + (i % 2) * 10_000_000).collect();
        assert!((described(&pairs).rate_hz.unwrap() - 199.0 / 99.01).abs() < 1e-9);
    }

    #[test]
    fn a_single_timestamp_or_equal_timestamps_have_no_rate() {
        for stamps in [&[7][..], &[7, 7, 7]] {
            let health = described(stamps);
            assert_eq!((health.rate_hz, health.steps_s, health.count), (None, None, stamps.len() as u64));
        }
        assert!(StampStats::new().finish(StampKind::Logged, Clock::Unix, "log").is_none());
    }

    #[test]
    fn timestamps_at_both_limits_of_the_range_do_not_overflow() {
        let health = described(&[i64::MIN, i64::MAX, i64::MIN]);
        assert_eq!(health.back_jumps, 1);
        assert_eq!(health.steps_s.unwrap().max, 18_446_744_073.709_553);
    }

    #[test]
    fn a_long_stream_is_described_within_four_per_mille() {
        // A ramp of steps from 1 ms to 30 ms in a scrambled order: every quantile is known.
        let n = 29_000_u64;
        let mut exact = vec![0_i64];
        for i in 0..n {
            let step = 1_000_000 + (i * 12_347 % n) * 1000;
            exact.push(exact[exact.len() - 1] + step as i64);
        }
        let mut stream = StampStats::new();
        exact.iter().for_each(|&s| stream.push(s));
        let streamed = stream.finish(StampKind::Logged, Clock::Unix, "log").unwrap();
        let d = streamed.steps_s.unwrap();
        let close = |got: f64, truth: f64| assert!((got / truth - 1.0).abs() < 0.004, "{got} {truth}");
        close(d.p01, 1.29e-3);
        close(d.median, 15.5e-3);
        close(d.p99, 29.71e-3);
        assert_eq!((d.min, d.max), (1e-3, 29.999e-3));
        assert_eq!(streamed.gap_count, 0);
        let d = described(&exact).steps_s.unwrap();
        assert!((d.median - 15.499_5e-3).abs() < 1e-9, "{d:?}");
    }

    #[test]
    fn every_step_lies_within_its_bucket() {
        for step in (0..64).flat_map(|e| [1u64 << e, (1u64 << e) | ((1u64 << e) - 1), (1u64 << e) + (1u64 << e) / 3]) {
            let (octave, bucket) = bucket_of(step);
            let middle = middle_of(octave, bucket) as f64;
            assert!((middle / step as f64 - 1.0).abs() <= 1.0 / 256.0, "{step}: {middle}");
        }
    }

    #[test]
    fn gaps_are_counted_in_a_long_stream_and_the_longest_listed() {
        let mut stream = StampStats::new();
        let mut now = 0;
        for i in 0..20_000 {
            now += if i % 1000 == 999 { 100_000_000 + i } else { 1_000_000 };
            stream.push(now);
        }
        let health = stream.finish(StampKind::Published, Clock::Unix, "publish").unwrap();
        assert_eq!((health.gap_count, health.gaps.len()), (20, 10));
        assert_eq!(health.gaps[0].length_s, 0.100_019_999);
    }

    #[test]
    fn percentiles_are_interpolated_linearly_between_order_statistics() {
        // numpy.percentile([1, 2, 4, 8], [1, 50, 99]) = 1.03, 3, 7.88
        let d = distribution(&[8.0, f64::NAN, 1.0, 4.0, 2.0]).unwrap();
        assert_eq!((d.min, d.median, d.max), (1.0, 3.0, 8.0));
        assert!((d.p01 - 1.03).abs() < 1e-12 && (d.p99 - 7.88).abs() < 1e-12);
        assert!(distribution(&[]).is_none());
    }
}
