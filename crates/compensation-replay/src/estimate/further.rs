//! The compensators that a pipeline requests in addition to the default ones.

use crate::compensator::{
    AxisSamples, CompensatorError, CompensatorKind, CompensatorOptions, Replayed, VelocityView, fit_kalman,
};
use crate::estimate::Positions;
use crate::input::Input;
use crate::rows::{Rows, bridge, median_step};
use crate::settings::Settings;
use delay_from_flight::AXES;
use flight::{Code, Notices, Severity};
use std::ops::Range;

/// Maximum number of velocity samples for the noise fit: ten minutes at 100 Hz.
const FIT_SAMPLES: usize = 60_000;

/// All of [`Settings::compensators`] that give an output at some valid row, in that order. `notices` counts what they
/// reject and where they have no output.
pub(super) fn further(
    input: &Input,
    settings: &Settings,
    segments: &[Range<usize>],
    rows: &Rows,
    raw: &[Vec<f64>; 2],
    notices: &mut Notices,
) -> Vec<Positions> {
    let mut wanted: Vec<CompensatorKind> = vec![];
    for &kind in &settings.compensators {
        if !Settings::always_runs(kind) && !wanted.contains(&kind) {
            wanted.push(kind);
        }
    }
    if wanted.is_empty() {
        return vec![];
    }
    let options = options(input, settings, segments, &wanted, notices);
    let bench = Bench { input, settings, rows, raw, options, stretches: stretches(segments, rows) };
    wanted.into_iter().filter_map(|kind| bench.run(kind, notices)).collect()
}

fn options(
    input: &Input,
    settings: &Settings,
    segments: &[Range<usize>],
    wanted: &[CompensatorKind],
    notices: &mut Notices,
) -> CompensatorOptions {
    let step_s = median_step(&input.velocity.t);
    let usual = CompensatorOptions::new(settings.delay.seconds(), step_s);
    let mut options = CompensatorOptions { max_gap_s: bridge(input, settings).max(2.5 * step_s), ..usual };
    if wanted.iter().copied().any(needs_noise) {
        fit_noise(input, segments, &mut options, notices);
    }
    options
}

fn needs_noise(kind: CompensatorKind) -> bool {
    matches!(kind, CompensatorKind::Kalman | CompensatorKind::RtsSmoother)
}

/// Noise and agility from the middle of the longest segment, both axes. The fit sees that entire stretch, so a Kalman
/// filter here is as good as one that was tuned beforehand on a similar flight.
fn fit_noise(input: &Input, segments: &[Range<usize>], options: &mut CompensatorOptions, notices: &mut Notices) {
    let Some(longest) = segments.iter().max_by_key(|s| s.len()) else { return };
    let middle = longest.start + longest.len() / 2;
    let half = FIT_SAMPLES / 2;
    let part = longest.start.max(middle.saturating_sub(half))..longest.end.min(middle + half);
    let axes = AXES.map(|k| samples(input, &part, k, options.delay_s));
    let Some(fit) = fit_kalman(&axes, options.delay_s, 0.0) else { return };
    let (jerk, p, v) = (fit.jerk_density, fit.position_sigma_m, fit.velocity_sigma_mps);
    options.kalman = Some(fit);
    let text = format!(
        "velocity samples that the noise for the Kalman filter and the smoother is fitted to: jerk density {jerk:.3e} m²/s⁵, position {p:.3e} m, velocity {v:.3e} m/s"
    );
    let at = format!("t = {:.3} s", input.velocity.t[part.start]);
    notices.push(Code::KalmanNoiseFitted, at, part.len() as u64, text);
}

/// A part of the velocity with the positions from its start to one delay after its end. (Causal compensators never
/// receive a position later than their row.)
fn samples<'a>(input: &'a Input, part: &Range<usize>, axis: usize, delay_s: f64) -> AxisSamples<'a> {
    let (velocity_t, fixes) = (&input.velocity.t[part.clone()], &input.position.t);
    let (first, last) = (velocity_t[0], velocity_t[velocity_t.len() - 1] + delay_s);
    let from = fixes.partition_point(|t| *t < first);
    let until = (fixes.partition_point(|t| *t < last) + 1).min(fixes.len()).max(from);
    AxisSamples {
        velocity_t,
        velocity: &input.velocity.axes[axis][part.clone()],
        position_t: &fixes[from..until],
        position: &input.position.axes[axis][from..until],
    }
}

/// The segments that have rows: their velocity samples, and their rows.
fn stretches(segments: &[Range<usize>], rows: &Rows) -> Vec<(Range<usize>, Range<usize>)> {
    rows.runs().filter_map(|(segment, of_rows)| Some((segments[segment?].clone(), of_rows))).collect()
}

struct Bench<'a> {
    input: &'a Input,
    settings: &'a Settings,
    rows: &'a Rows,
    raw: &'a [Vec<f64>; 2],
    options: CompensatorOptions,
    stretches: Vec<(Range<usize>, Range<usize>)>,
}

/// Problems in a run: rejected samples, and the first reason for any problem.
#[derive(Default)]
struct Trouble {
    refused: u64,
    first: Option<String>,
}

impl Trouble {
    fn note(&mut self, replayed: Result<Replayed, CompensatorError>) -> Option<Vec<Option<f64>>> {
        match replayed {
            Ok(Replayed { output, refused, first_refusal }) => {
                self.refused += refused;
                self.first = self.first.take().or(first_refusal.map(|r| r.to_string()));
                Some(output)
            }
            Err(error) => {
                self.first.get_or_insert(error.to_string());
                None
            }
        }
    }
}

impl Bench<'_> {
    /// `None`, with a notice, if it has no output at any valid row.
    fn run(&self, kind: CompensatorKind, notices: &mut Notices) -> Option<Positions> {
        let mut trouble = Trouble::default();
        let outputs = AXES.map(|k| self.axis(kind, k, &mut trouble));
        let no_output: Vec<bool> =
            outputs[0].iter().zip(&outputs[1]).map(|(n, e)| n.is_none() || e.is_none()).collect();
        self.report(kind, &no_output, &trouble, notices);
        self.rows.valid().find(|&row| !no_output[row])?;
        let axes = AXES.map(|k| {
            let given = outputs[k].iter().zip(&self.raw[k]).zip(&no_output);
            given.map(|((x, raw), no_output)| x.filter(|_| !no_output).unwrap_or(*raw)).collect()
        });
        let (name, title, delay) = (kind.to_string(), title(kind), self.settings.delay);
        Some(Positions { name, title, delay, axes, further: Some(kind), no_output })
    }

    /// Position at every row; restarts in every segment.
    fn axis(&self, kind: CompensatorKind, axis: usize, trouble: &mut Trouble) -> Vec<Option<f64>> {
        let mut out = vec![None; self.rows.t.len()];
        for (part, rows) in &self.stretches {
            let samples = samples(self.input, part, axis, self.options.delay_s);
            if samples.position.is_empty() {
                continue; // Its rows have no fix.
            }
            let t = &self.rows.t[rows.clone()];
            let replayed = kind.replay(&self.options, &samples, self.settings.start, VelocityView::UpToNow, t);
            if let Some(output) = trouble.note(replayed) {
                out[rows.clone()].copy_from_slice(&output);
            }
        }
        out
    }

    fn report(&self, kind: CompensatorKind, no_output: &[bool], trouble: &Trouble, notices: &mut Notices) {
        let why = trouble.first.as_ref().map(|first| format!(" ({first})")).unwrap_or_default();
        if trouble.refused > 0 {
            let text = format!("samples, counted per axis, that {kind} rejected{why}");
            notices.push(Code::NoOutput.at(Severity::Warning), "", trouble.refused, text);
        }
        let missing = |row: &usize| no_output[*row] && self.rows.has_output(*row);
        let rows = (0..no_output.len()).filter(missing);
        if let Some(first) = rows.clone().next() {
            let at = format!("t = {:.3} s", self.rows.t[first]);
            let text = format!("rows at which {kind} has no output: not shown and not scored{why}");
            notices.push(Code::NoOutput, at, rows.count() as u64, text);
        }
    }
}

/// Title for a page; marks what no aircraft could run.
fn title(kind: CompensatorKind) -> String {
    match kind {
        CompensatorKind::OfflineShift => "p(t + Td), spline (not causal: bound)".to_owned(),
        CompensatorKind::RtsSmoother => "smoother on shifted data (not causal: bound)".to_owned(),
        CompensatorKind::Kalman => format!("{}, noise fitted to this flight", kind.title()),
        _ => kind.title(),
    }
}
