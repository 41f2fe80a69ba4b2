//! One flight through all compensators.

use crate::curves::{Curves, draw};
use crate::exact::ExactAsync;
use crate::input::{AXES, Input, Refusal};
use crate::pade::PadeTustin;
use crate::score;
use crate::settings::Settings;
use crate::track::{RowState, Track, TrackColumn};
use flight::{Delay, Distribution, Flight, Geodetic, LocalFrame, Notices, RejectCount, Severity};
use record::{Coverage, ReplayRecord, ReplaySettings, StartRule};
use std::ops::Range;

/// What came of a replay.
#[derive(Debug, Clone, PartialEq)]
pub struct Replay {
    /// What was found.
    pub record: ReplayRecord,
    /// Every row.
    pub track: Track,
    /// What a reader of the record must know.
    pub notices: Notices,
}

/// Replays the compensators over a flight.
///
/// # Errors
/// A [`Refusal`] when compensation says nothing about this flight, with the reason.
pub fn replay(flight: &Flight, settings: &Settings) -> Result<Replay, Refusal> {
    let input = Input::of(flight, settings)?;
    let speed = ground_speed(&input, settings)?;
    let bridge_s = bridge(&input, settings);
    let segments = segments(&input.velocity.t, bridge_s);
    let mut notices = Notices::new();
    let rows = Rows::of(&input, settings, &segments, &mut notices)?;
    let estimates = estimates(&input, settings, &segments, &rows);
    let innovations = score::innovations(&input, settings, &segments);
    score::warn_of_contradiction(&input, settings, &segments, &mut notices);
    let resets = score::resets(&innovations, &mut notices);
    let coverage = rows.coverage(&input, bridge_s, &segments, resets);
    let compensators = score::compensators(&input, settings, &rows, &estimates, &innovations);
    let Curves { axes, zoom, track } = draw(&input, settings, &rows, &estimates);
    let record = ReplayRecord {
        settings: ReplaySettings {
            delay: settings.delay,
            delay_uncertainty_s: settings.delay_uncertainty_s,
            delay_source: settings.delay_source.clone(),
            start: settings.start,
            bridge_s,
        },
        pair: input.names.clone(),
        origin_ns: input.origin.0,
        clock: input.clock,
        origin: input.frame.map(|f| f.origin()),
        coverage,
        speed_mps: speed,
        predicted_rms_m: score::predicted(&rows, settings),
        compensators,
        axes,
        zoom,
        track,
    };
    let track = table(&input, &rows, &estimates);
    Ok(Replay { record, track, notices })
}

/// A compensator's position at every row; where the row's state gives none, the raw one stands in and is not shown.
#[derive(Debug)]
pub(crate) struct Estimate {
    pub(crate) name: &'static str,
    pub(crate) title: String,
    /// Delay it was given.
    pub(crate) delay: Delay,
    /// North, then east.
    pub(crate) axes: [Vec<f64>; 2],
}

/// The instants of the replay, and what is known at each.
#[derive(Debug, Default)]
pub(crate) struct Rows {
    pub(crate) t: Vec<f64>,
    /// Newest fix.
    pub(crate) fix: Vec<usize>,
    /// Seconds since that fix.
    pub(crate) age: Vec<f64>,
    /// Velocity as the loop sees it: the newest sample.
    pub(crate) velocity: [Vec<f64>; 2],
    /// What one velocity, taken half way back to when the fix was true, flies in all that time, m:
    /// the midpoint rule, no integral and no filter.
    pub(crate) predicted: [Vec<f64>; 2],
    pub(crate) segment: Vec<Option<usize>>,
    pub(crate) state: Vec<RowState>,
    pub(crate) start: Option<StartRule>,
    /// A step between rows longer than this is a gap: the pen is lifted, s.
    pub(crate) gap_s: f64,
}

impl Rows {
    fn of(
        input: &Input,
        settings: &Settings,
        segments: &[Range<usize>],
        notices: &mut Notices,
    ) -> Result<Rows, Refusal> {
        let (fixes, samples) = (&input.position.t, &input.velocity.t);
        let last_useful = fixes[fixes.len() - 1] + 2.5 * median_step(fixes);
        let wanted = |t: &f64| *t >= fixes[0] && *t <= last_useful;
        let instants: Vec<f64> = match settings.output_rate_hz {
            None => samples.iter().copied().filter(wanted).collect(),
            Some(rate) => {
                let (first, last) = (samples[0].max(fixes[0]), samples[samples.len() - 1].min(last_useful));
                let count = ((last - first) * rate).floor().max(0.0) as usize;
                (0..=count).map(|k| first + k as f64 / rate).collect()
            }
        };
        if settings.output_rate_hz.is_none() {
            note_outside(samples, fixes[0], last_useful, notices);
        }
        let gap_s = 2.5 * median_step(&instants);
        let mut rows = Rows { start: Some(settings.start), gap_s, ..Rows::default() };
        let (mut fix, mut sample, mut segment) = (0, 0, 0);
        for t in instants {
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
            rows.t.push(t);
            rows.fix.push(fix);
            rows.age.push(t - fixes[fix]);
            AXES.into_iter().for_each(|k| rows.velocity[k].push(input.velocity.axes[k][sample]));
            let delay = settings.delay.seconds() + (t - fixes[fix]);
            AXES.into_iter().for_each(|k| rows.predicted[k].push(delay * input.velocity.at(t - 0.5 * delay, k)));
            rows.segment.push(inside.then_some(segment));
            rows.state.push(state(settings, fixes[fix], inside.then(|| samples[segments[segment].start])));
        }
        if rows.t.len() < 3 {
            return Err(Refusal::TooShort { channel: input.names.velocity.clone(), rows: rows.t.len(), least: 3 });
        }
        Ok(rows)
    }

    /// Whether the compensated position of a row is given out.
    pub(crate) fn has_output(&self, row: usize) -> bool {
        match self.state[row] {
            RowState::Valid => true,
            RowState::WarmUp => self.start != Some(StartRule::InvalidUntilTd),
            RowState::NoFix | RowState::NoVelocity => false,
        }
    }

    pub(crate) fn valid(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.t.len()).filter(|&row| self.state[row] == RowState::Valid)
    }

    /// Mean age of the fix over valid rows, s: what holding adds to the delay that a loop sees (design note 3.8).
    pub(crate) fn mean_age_s(&self) -> f64 {
        let (sum, count) = self.valid().fold((0.0, 0_u32), |(sum, count), row| (sum + self.age[row], count + 1));
        if count == 0 { 0.0 } else { sum / f64::from(count) }
    }

    fn coverage(&self, input: &Input, bridge_s: f64, segments: &[Range<usize>], resets: u64) -> Coverage {
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
            invalid,
            bridged_gaps: steps.filter(|&h| h > usual && h <= bridge_s).count() as u64,
            restarts: segments.len() as u64 - 1,
            fixes: input.position.t.len() as u64,
            position_resets: resets,
            longest_position_gap_s: input.position.t.windows(2).map(|w| w[1] - w[0]).fold(0.0, f64::max),
        }
    }
}

fn state(settings: &Settings, fix: f64, segment_start: Option<f64>) -> RowState {
    match segment_start {
        None => RowState::NoVelocity,
        Some(start) if fix - settings.delay.seconds() >= start => RowState::Valid,
        Some(start) if fix >= start => RowState::WarmUp,
        Some(_) => RowState::NoFix,
    }
}

fn note_outside(samples: &[f64], first: f64, last: f64, notices: &mut Notices) {
    let before = samples.iter().filter(|t| **t < first).count() as u64;
    let after = samples.iter().filter(|t| **t > last).count() as u64;
    if before > 0 {
        notices.push(
            Severity::Info,
            "velocity-before-first-fix",
            "",
            before,
            "velocity samples before the first position fix: no row is made of them",
        );
    }
    if after > 0 {
        notices.push(
            Severity::Info,
            "velocity-after-last-fix",
            "",
            after,
            "velocity samples after the last position fix: no row is made of them",
        );
    }
}

/// Median and percentiles of the ground speed; refuses a flight that does not move.
fn ground_speed(input: &Input, settings: &Settings) -> Result<Distribution, Refusal> {
    let mut speeds: Vec<f64> = {
        let [north, east] = &input.velocity.axes;
        north.iter().zip(east).map(|(n, e)| n.hypot(*e)).collect()
    };
    speeds.sort_unstable_by(f64::total_cmp);
    let at = |share| signal::percentile_of_sorted(&speeds, share).unwrap_or_default();
    let p95_mps = at(0.95);
    if p95_mps < settings.min_speed_mps {
        return Err(Refusal::NoMotion { p95_mps, limit_mps: settings.min_speed_mps });
    }
    Ok(Distribution { min: at(0.0), p01: at(0.01), median: at(0.5), p99: at(0.99), max: at(1.0) })
}

pub(crate) fn median_step(t: &[f64]) -> f64 {
    let mut steps: Vec<f64> = t.windows(2).map(|w| w[1] - w[0]).collect();
    signal::median_in_place(&mut steps).unwrap_or_default()
}

fn bridge(input: &Input, settings: &Settings) -> f64 {
    settings.bridge_s.unwrap_or_else(|| (2.0 * settings.delay.seconds()).max(2.5 * median_step(&input.velocity.t)))
}

/// Stretches of velocity samples without a gap longer than `bridge_s`.
fn segments(t: &[f64], bridge_s: f64) -> Vec<Range<usize>> {
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

fn estimates(input: &Input, settings: &Settings, segments: &[Range<usize>], rows: &Rows) -> Vec<Estimate> {
    let td = settings.delay;
    let raw = AXES.map(|k| rows.fix.iter().map(|&j| input.position.axes[k][j]).collect::<Vec<f64>>());
    let pade = |name, title: &str, delay: Delay| Estimate {
        name,
        title: title.to_owned(),
        delay,
        axes: AXES.map(|k| pade_axis(rows, settings.start, delay, &raw[k], k)),
    };
    let mut out = vec![
        Estimate { name: "raw", title: "raw, newest fix held".to_owned(), delay: Delay::ZERO, axes: raw.clone() },
        pade("pade-1-1", "Padé [1/1], Tustin (the paper)", td),
    ];
    let age = rows.mean_age_s();
    if let Some(as_seen) = Delay::from_seconds(td.seconds() + age).filter(|_| age >= 1e-3) {
        out.push(pade("pade-1-1-as-seen", "Padé [1/1], Tustin, Td + mean age of the held fix", as_seen));
    }
    out.push(Estimate {
        name: "exact-async",
        title: "exact asynchronous, p + ∫v".to_owned(),
        delay: td,
        axes: AXES.map(|k| exact_axis(input, settings, segments, rows, k)),
    });
    out
}

/// Raw plus the filter's displacement; the filter starts anew in every segment.
fn pade_axis(rows: &Rows, start: StartRule, delay: Delay, raw: &[f64], axis: usize) -> Vec<f64> {
    let v = &rows.velocity[axis];
    let td = delay.seconds();
    let mut filter: Option<PadeTustin> = None;
    let mut out = raw.to_vec();
    for row in 0..rows.t.len() {
        let h = if row == 0 { 0.0 } else { rows.t[row] - rows.t[row - 1] };
        let fresh = row == 0 || rows.segment[row] != rows.segment[row - 1];
        match (&mut filter, rows.segment[row]) {
            (_, None) => filter = None,
            (Some(running), Some(_)) if !fresh => {
                running.step(h, v[row]);
            }
            (_, Some(_)) => {
                let next = rows.t.get(row + 1).map_or(td, |t| t - rows.t[row]);
                filter = Some(match start {
                    StartRule::Cold => PadeTustin::cold(td, v[row], next),
                    StartRule::Warm | StartRule::InvalidUntilTd => PadeTustin::warm(td, v[row]),
                });
            }
        }
        out[row] += filter.as_ref().map_or(0.0, PadeTustin::output);
    }
    out
}

fn exact_axis(input: &Input, settings: &Settings, segments: &[Range<usize>], rows: &Rows, axis: usize) -> Vec<f64> {
    let compensators = of_segments(input, settings, segments, axis);
    (0..rows.t.len())
        .map(|row| {
            let (raw, stamp) = (input.position.axes[axis][rows.fix[row]], input.position.t[rows.fix[row]]);
            let Some(s) = rows.segment[row] else { return raw };
            let from = match settings.start {
                // Cold: nothing was flown before the first velocity.
                StartRule::Cold => stamp.max(input.velocity.t[segments[s].start] + settings.delay.seconds()),
                StartRule::Warm | StartRule::InvalidUntilTd => stamp,
            };
            compensators[s].at(rows.t[row], raw, from)
        })
        .collect()
}

/// The exact compensator of one axis, segment by segment.
pub(crate) fn of_segments<'a>(
    input: &'a Input,
    settings: &Settings,
    segments: &[Range<usize>],
    axis: usize,
) -> Vec<ExactAsync<'a>> {
    let (t, v) = (&input.velocity.t, &input.velocity.axes[axis]);
    segments.iter().map(|s| ExactAsync::new(&t[s.clone()], &v[s.clone()], settings.delay.seconds())).collect()
}

fn table(input: &Input, rows: &Rows, estimates: &[Estimate]) -> Track {
    let stamps = rows.t.iter().map(|&t| input.origin.plus_seconds(t).0).collect();
    let shown = |values: &[f64], always: bool| {
        TrackColumn::F64(
            values.iter().enumerate().map(|(row, &v)| (always || rows.has_output(row)).then_some(v)).collect(),
        )
    };
    let mut columns = vec![
        ("stamp_ns".to_owned(), TrackColumn::I64(stamps)),
        ("t_s".to_owned(), shown(&rows.t, true)),
        ("state".to_owned(), TrackColumn::U8(rows.state.iter().map(|&s| s as u8).collect())),
        ("fix_age_s".to_owned(), shown(&rows.age, true)),
    ];
    for estimate in estimates {
        let prefix = estimate.name.replace('-', "_");
        for (axis, values) in ["north", "east"].into_iter().zip(&estimate.axes) {
            columns.push((format!("{prefix}_{axis}_m"), shown(values, estimate.name == "raw")));
        }
    }
    if let (Some(frame), Some(exact)) = (&input.frame, estimates.last()) {
        let points = (0..rows.t.len()).map(|row| rows.has_output(row).then(|| point(frame, input, rows, exact, row)));
        let (latitude, longitude) =
            points.map(|p| (p.map(|p| p.latitude.to_degrees()), p.map(|p| p.longitude.to_degrees()))).unzip();
        columns.push(("exact_async_latitude_deg".to_owned(), TrackColumn::F64(latitude)));
        columns.push(("exact_async_longitude_deg".to_owned(), TrackColumn::F64(longitude)));
    }
    Track { columns }
}

/// The compensated point of a row at the height of its fix: only the horizontal position is compensated.
fn point(frame: &LocalFrame, input: &Input, rows: &Rows, exact: &Estimate, row: usize) -> Geodetic {
    let fix = rows.fix[row];
    frame.to_geodetic([exact.axes[0][row], exact.axes[1][row], input.down[fix]])
}
