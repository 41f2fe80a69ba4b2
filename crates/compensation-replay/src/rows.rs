//! The instants of a replay, with the inputs known at each.

use crate::input::{Input, Refusal};
use crate::settings::Settings;
use delay_from_flight::AXES;
use flight::{Code, Notices, RejectCount};
use record::{Coverage, StartRule};
use std::ops::Range;

/// Validity of the compensated position of a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum RowState {
    /// All inputs were measured.
    Valid,
    /// Less than Td of velocity has been seen since the start: the start rule applies.
    WarmUp,
    /// No fix yet since the velocity started, or restarted after a long gap.
    NoFix,
    /// No velocity: inside a gap too long to bridge. (Only with rows at a fixed rate.)
    NoVelocity,
}

impl RowState {
    /// Name in the track's `state` column.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            RowState::Valid => "valid",
            RowState::WarmUp => "warm-up",
            RowState::NoFix => "no-fix",
            RowState::NoVelocity => "no-velocity",
        }
    }

    /// In words, for counts.
    #[must_use]
    pub fn reason(self) -> &'static str {
        match self {
            RowState::Valid => "valid",
            RowState::WarmUp => "less than Td of velocity since the start",
            RowState::NoFix => "no position fix since the velocity started",
            RowState::NoVelocity => "velocity gap too long to bridge",
        }
    }
}

/// The instants of a replay, with the inputs known at each. There may be half a million, so derived values are computed
/// on demand.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Rows {
    pub(crate) t: Vec<f64>,
    fix: Vec<u32>,
    /// Velocity as seen by the loop: the newest sample.
    pub(crate) velocity: [Vec<f64>; 2],
    segment: Vec<u32>,
    pub(crate) state: Vec<RowState>,
    pub(crate) start: Option<StartRule>,
    /// A step between rows longer than this is a gap that breaks the lines, s.
    pub(crate) gap_s: f64,
}

impl Rows {
    pub(crate) fn of(
        input: &Input,
        settings: &Settings,
        segments: &[Range<usize>],
        notices: &mut Notices,
    ) -> Result<Rows, Refusal> {
        let (fixes, samples) = (&input.position.t, &input.velocity.t);
        let instants = instants(input, settings, notices);
        let gap_s = 2.5 * median_step(&instants);
        let count = instants.len();
        let mut rows = Rows {
            t: vec![],
            fix: Vec::with_capacity(count),
            velocity: AXES.map(|_| Vec::with_capacity(count)),
            segment: Vec::with_capacity(count),
            state: Vec::with_capacity(count),
            start: Some(settings.start),
            gap_s,
        };
        let (mut fix, mut sample, mut segment) = (0, 0, 0);
        for &t in &instants {
            while fix + 1 < fixes.len() && fixes[fix + 1] <= t {
                fix += 1;
            }
            while sample + 1 < samples.len() && samples[sample + 1] <= t {
                sample += 1;
            }
            while segment + 1 < segments.len() && segments[segment].end <= sample {
                segment += 1;
            }
            let inside = t <= samples[segments[segment].end - 1];
            rows.fix.push(small(fix));
            AXES.into_iter().for_each(|k| rows.velocity[k].push(input.velocity.axes[k][sample]));
            rows.segment.push(if inside { small(segment) } else { NO_SEGMENT });
            rows.state.push(state(settings, fixes[fix], inside.then(|| samples[segments[segment].start])));
        }
        rows.t = instants;
        if rows.t.len() < 3 {
            return Err(Refusal::TooShort { channel: input.names.velocity.clone(), rows: rows.t.len(), least: 3 });
        }
        Ok(rows)
    }

    /// The newest fix of a row.
    pub(crate) fn fix(&self, row: usize) -> usize {
        self.fix[row] as usize
    }

    /// Whether the fix of a row is new since the previous row.
    pub(crate) fn has_new_fix(&self, row: usize) -> bool {
        row == 0 || self.fix[row] != self.fix[row - 1]
    }

    /// Seconds since the newest fix of a row.
    pub(crate) fn age_s(&self, input: &Input, row: usize) -> f64 {
        self.t[row] - input.position.t[self.fix(row)]
    }

    /// The segment of velocity that contains a row.
    pub(crate) fn segment(&self, row: usize) -> Option<usize> {
        Some(self.segment[row]).filter(|segment| *segment != NO_SEGMENT).map(|segment| segment as usize)
    }

    /// Runs of rows in one segment, with that segment.
    pub(crate) fn runs(&self) -> impl Iterator<Item = (Option<usize>, Range<usize>)> {
        let mut first = 0;
        self.segment.chunk_by(|a, b| a == b).map(move |same| {
            let rows = first..first + same.len();
            first = rows.end;
            (self.segment(rows.start), rows)
        })
    }

    /// Displacement at each row since its fix was true, m, from the single velocity at the middle of that time: the
    /// midpoint rule, without integral or filter.
    pub(crate) fn predicted(&self, input: &Input, settings: &Settings, axis: usize) -> Vec<f64> {
        let mut velocity = input.velocity.walk(axis);
        let of_row = |row: usize| {
            let delay = settings.delay.seconds() + self.age_s(input, row);
            // This instant rises from row to row: it is halfway between the row and when its fix was true.
            delay * velocity(self.t[row] - 0.5 * delay)
        };
        (0..self.t.len()).map(of_row).collect()
    }

    /// Whether the compensated position of a row is shown.
    pub(crate) fn has_output(&self, row: usize) -> bool {
        match self.state[row] {
            RowState::Valid => true,
            RowState::WarmUp => self.start != Some(StartRule::InvalidUntilTd),
            RowState::NoFix | RowState::NoVelocity => false,
        }
    }

    pub(crate) fn valid(&self) -> impl Iterator<Item = usize> + Clone {
        (0..self.t.len()).filter(|&row| self.state[row] == RowState::Valid)
    }

    /// Mean age of the fix over valid rows, s: the delay that holding adds in a loop (design note 3.8).
    pub(crate) fn mean_age_s(&self, input: &Input) -> f64 {
        let (sum, count) =
            self.valid().fold((0.0, 0_u32), |(sum, count), row| (sum + self.age_s(input, row), count + 1));
        if count == 0 { 0.0 } else { sum / f64::from(count) }
    }

    /// Time to the next row, summed over valid rows that are not followed by a gap.
    fn valid_s(&self) -> f64 {
        let steps = self.t.windows(2).map(|w| w[1] - w[0]).zip(&self.state);
        steps.filter(|(h, state)| **state == RowState::Valid && *h <= self.gap_s).map(|(h, _)| h).sum()
    }

    pub(crate) fn coverage(&self, input: &Input, bridge_s: f64, segments: &[Range<usize>], resets: u64) -> Coverage {
        let count = |state| self.state.iter().filter(|s| **s == state).count() as u64;
        let invalid = [RowState::WarmUp, RowState::NoFix, RowState::NoVelocity]
            .into_iter()
            .filter(|&state| count(state) > 0)
            .map(|state| {
                let first = self.state.iter().position(|s| *s == state).unwrap_or_default();
                RejectCount {
                    reason: state.reason().to_owned(),
                    count: count(state),
                    first: format!("t = {:.3} s", self.t[first]),
                }
            })
            .collect();
        let usual = 2.5 * median_step(&input.velocity.t);
        let steps = input.velocity.t.windows(2).map(|w| w[1] - w[0]);
        Coverage {
            duration_s: self.t[self.t.len() - 1] - self.t[0],
            rows: self.t.len() as u64,
            valid_rows: count(RowState::Valid),
            valid_s: self.valid_s(),
            invalid,
            bridged_gaps: steps.filter(|&h| h > usual && h <= bridge_s).count() as u64,
            restarts: segments.len() as u64 - 1,
            fixes: input.position.t.len() as u64,
            position_resets: resets,
            longest_position_gap_s: input.position.t.windows(2).map(|w| w[1] - w[0]).fold(0.0, f64::max),
        }
    }
}

/// A row outside all segments.
const NO_SEGMENT: u32 = u32::MAX;

/// An index into a record, which has fewer than 2³² − 1 samples: more would take 100 GB.
fn small(place: usize) -> u32 {
    u32::try_from(place).unwrap_or(NO_SEGMENT - 1)
}

fn state(settings: &Settings, fix: f64, segment_start: Option<f64>) -> RowState {
    match segment_start {
        None => RowState::NoVelocity,
        Some(start) if fix - settings.delay.seconds() >= start => RowState::Valid,
        Some(start) if fix >= start => RowState::WarmUp,
        Some(_) => RowState::NoFix,
    }
}

/// Velocity samples from the first fix until the last one is too old, or even time steps.
fn instants(input: &Input, settings: &Settings, notices: &mut Notices) -> Vec<f64> {
    let (fixes, samples) = (&input.position.t, &input.velocity.t);
    let last_useful = fixes[fixes.len() - 1] + 2.5 * median_step(fixes);
    let Some(rate) = settings.output_rate_hz else {
        note_outside(samples, fixes[0], last_useful, notices);
        return samples.iter().copied().filter(|t| *t >= fixes[0] && *t <= last_useful).collect();
    };
    let (first, last) = (samples[0].max(fixes[0]), samples[samples.len() - 1].min(last_useful));
    let count = ((last - first) * rate).floor().max(0.0) as usize;
    (0..=count).map(|k| first + k as f64 / rate).collect()
}

fn note_outside(samples: &[f64], first: f64, last: f64, notices: &mut Notices) {
    let before = samples.iter().filter(|t| **t < first).count() as u64;
    let after = samples.iter().filter(|t| **t > last).count() as u64;
    if before > 0 {
        notices.push(Code::NoOutput, "", before, "velocity samples before the first position fix: not in the track");
    }
    if after > 0 {
        notices.push(Code::NoOutput, "", after, "velocity samples after the last position fix: not in the track");
    }
}

/// Median step of rising times, s.
pub(crate) fn median_step(t: &[f64]) -> f64 {
    signal::median_step(t).unwrap_or_default()
}

/// Velocity gaps up to this long are bridged, s.
pub(crate) fn bridge(input: &Input, settings: &Settings) -> f64 {
    settings.bridge_s.unwrap_or_else(|| (2.0 * settings.delay.seconds()).max(2.5 * median_step(&input.velocity.t)))
}

/// Segments of velocity samples without a gap longer than `bridge_s`.
pub(crate) fn segments(t: &[f64], bridge_s: f64) -> Vec<Range<usize>> {
    let mut out = vec![];
    let mut start = 0;
    for k in 1..t.len() {
        if t[k] - t[k - 1] > bridge_s {
            out.push(start..k);
            start = k;
        }
    }
    out.push(start..t.len());
    out
}
