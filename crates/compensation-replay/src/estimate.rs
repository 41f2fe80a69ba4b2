//! Runs the compensators over all rows of a flight.

mod further;

use crate::compensator::CompensatorKind;
use crate::exact::ExactAsync;
use crate::input::Input;
use crate::pade::PadeTustin;
use crate::rows::Rows;
use crate::settings::Settings;
use delay_from_flight::AXES;
use flight::{Delay, Notices};
use record::StartRule;
use std::ops::Range;

/// Positions of a compensator at every row. If the row's state allows no output, or the compensator has none, the raw
/// position is stored and not shown.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Positions {
    pub(crate) name: String,
    pub(crate) title: String,
    /// Delay given to it.
    pub(crate) delay: Delay,
    /// North, then east.
    pub(crate) axes: [Vec<f64>; 2],
    /// Kind, if the pipeline requests it in addition to the default compensators.
    pub(crate) further: Option<CompensatorKind>,
    /// For every row, whether the compensator has no output there; empty: always has output.
    no_output: Vec<bool>,
}

impl Positions {
    fn always(name: &str, title: &str, delay: Delay, axes: [Vec<f64>; 2]) -> Positions {
        Positions { name: name.to_owned(), title: title.to_owned(), delay, axes, further: None, no_output: vec![] }
    }

    pub(crate) fn is_raw(&self) -> bool {
        self.name == "raw"
    }

    /// Whether the compensator itself has output at a row, whatever the row's state.
    pub(crate) fn has_own_output(&self, row: usize) -> bool {
        self.no_output.get(row) != Some(&true)
    }

    /// Whether the position at a row is shown; the raw one always is.
    pub(crate) fn shown(&self, rows: &Rows, row: usize) -> bool {
        self.is_raw() || (rows.has_output(row) && self.has_own_output(row))
    }
}

/// Raw first, then the paper's compensator unchanged, the same with the mean age of held fixes added to its delay, and
/// the exact form, followed by those requested by the pipeline.
pub(crate) fn estimates(
    input: &Input,
    settings: &Settings,
    segments: &[Range<usize>],
    rows: &Rows,
    notices: &mut Notices,
) -> Vec<Positions> {
    let td = settings.delay;
    let raw = AXES.map(|k| (0..rows.t.len()).map(|row| input.position.axes[k][rows.fix(row)]).collect::<Vec<f64>>());
    let pade = |name, title, delay| {
        Positions::always(name, title, delay, AXES.map(|k| pade_axis(rows, settings.start, delay, &raw[k], k)))
    };
    let mut out = vec![
        Positions::always("raw", "raw, newest fix held", Delay::ZERO, raw.clone()),
        pade(PAPER, "Padé [1/1], Tustin (the paper)", td),
    ];
    let age = rows.mean_age_s(input);
    if let Some(as_seen) = Delay::from_seconds(td.seconds() + age).filter(|_| age >= 1e-3) {
        out.push(pade("pade-1-1-as-seen", "Padé [1/1], Tustin, Td + mean age of the held fix", as_seen));
    }
    let exact = AXES.map(|k| exact_axis(input, settings, segments, rows, k));
    out.push(Positions::always(EXACT_ASYNC, "exact asynchronous, p + ∫v", td, exact));
    out.extend(further::further(input, settings, segments, rows, &raw, notices));
    out
}

/// Name of the unchanged paper's compensator.
pub(crate) const PAPER: &str = "pade-1-1";

/// Name of the exact asynchronous form that always runs.
pub(crate) const EXACT_ASYNC: &str = "exact-async";

/// Raw plus the filter's displacement; the filter restarts in every segment.
fn pade_axis(rows: &Rows, start: StartRule, delay: Delay, raw: &[f64], axis: usize) -> Vec<f64> {
    let v = &rows.velocity[axis];
    let td = delay.seconds();
    let mut filter: Option<PadeTustin> = None;
    let mut out = raw.to_vec();
    for row in 0..rows.t.len() {
        let h = if row == 0 { 0.0 } else { rows.t[row] - rows.t[row - 1] };
        let fresh = row == 0 || rows.segment(row) != rows.segment(row - 1);
        match (&mut filter, rows.segment(row)) {
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
            let (raw, stamp) = (input.position.axes[axis][rows.fix(row)], input.position.t[rows.fix(row)]);
            let Some(s) = rows.segment(row) else { return raw };
            let from = match settings.start {
                // Cold: at rest before the first velocity.
                StartRule::Cold => stamp.max(input.velocity.t[segments[s].start] + settings.delay.seconds()),
                StartRule::Warm | StartRule::InvalidUntilTd => stamp,
            };
            compensators[s].at(rows.t[row], raw, from)
        })
        .collect()
}

/// The exact compensator for one axis, segment by segment.
pub(crate) fn of_segments<'a>(
    input: &'a Input,
    settings: &Settings,
    segments: &[Range<usize>],
    axis: usize,
) -> Vec<ExactAsync<'a>> {
    let (t, v) = (&input.velocity.t, &input.velocity.axes[axis]);
    segments.iter().map(|s| ExactAsync::new(&t[s.clone()], &v[s.clone()], settings.delay.seconds())).collect()
}
