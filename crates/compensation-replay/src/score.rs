//! Scores of the compensators, with and without an independent reference.

mod against_reference;
mod all;
mod budget;
mod jackknife;
mod motion;
mod onboard;
mod truthless;
mod updates;

pub(crate) use all::{Played, scores};
pub(crate) use jackknife::{Blocks, root_mean};
pub(crate) use onboard::onboard;

use crate::compensator::CompensatorKind;
use crate::estimate::{EXACT_ASYNC, Positions, of_segments};
use crate::input::Input;
use crate::rows::{Rows, median_step};
use crate::settings::Settings;
use delay_from_flight::{AXES, Horizontal};
use flight::{Code, Notices};
use record::{CompensatorResult, Estimate};
use std::ops::Range;

/// Steps of two kinds at each fix: against the previous fix, and against its dead-reckoned position.
#[derive(Debug)]
pub(crate) struct Innovations {
    fix: Vec<u32>,
    /// The fix less the dead-reckoned previous fix, m: north and east.
    exact: [Vec<f64>; 2],
    /// Displacement from velocity between the two, m: north and east.
    flown: [Vec<f64>; 2],
}

/// Innovations of all fixes for which velocity covers the whole flight since the previous fix.
pub(crate) fn innovations(input: &Input, settings: &Settings, segments: &[Range<usize>]) -> Innovations {
    let flown = AXES.map(|k| of_segments(input, settings, segments, k));
    let td = settings.delay.seconds();
    let fixes = input.position.t.len();
    let column = || Vec::with_capacity(fixes);
    let mut out =
        Innovations { fix: Vec::with_capacity(fixes), exact: AXES.map(|_| column()), flown: AXES.map(|_| column()) };
    for j in 1..fixes {
        let (from, to) = (input.position.t[j - 1] - td, input.position.t[j] - td);
        let Some(s) = covering(input, segments, from, to) else { continue };
        let step = step_to(input, j);
        out.fix.push(j as u32);
        for k in AXES {
            let displacement = flown[k][s].flown(from, to);
            out.exact[k].push(step[k] - displacement);
            out.flown[k].push(displacement);
        }
    }
    out
}

/// From the previous fix to fix `j`, m.
fn step_to(input: &Input, j: usize) -> [f64; 2] {
    AXES.map(|k| input.position.axes[k][j] - input.position.axes[k][j - 1])
}

/// The segment of velocity that covers an entire interval.
fn covering(input: &Input, segments: &[Range<usize>], from: f64, to: f64) -> Option<usize> {
    let t = &input.velocity.t;
    let s = segments.partition_point(|s| t[s.end - 1] < to);
    segments.get(s).filter(|range| t[range.start] <= from && to <= t[range.end - 1]).map(|_| s)
}

/// Fixes that jump by more than five robust sigma against velocity (design note 5.8): passed on and counted. Sigma is
/// that of the surrounding fixes, otherwise a parked receiver would make every turn a jump.
pub(crate) fn resets(input: &Input, innovations: &Innovations, notices: &mut Notices) -> u64 {
    let sigma = innovations.exact.each_ref().map(|axis| local_sigma(axis));
    let jumps: Vec<usize> = (0..innovations.fix.len())
        .filter(|&i| AXES.into_iter().any(|k| innovations.exact[k][i].abs() > 5.0 * sigma[k][i / SIGMA_BLOCK]))
        .collect();
    if let Some(&first) = jumps.first() {
        let size = innovations.exact[0][first].hypot(innovations.exact[1][first]);
        let text = match jumps.len() {
            1 => format!(
                "a fix jumps by {size:.2} m, more than five sigma, against the integrated velocity; it is passed through \
                 unchanged"
            ),
            _ => format!(
                "fixes jump by more than five sigma against the integrated velocity, the first by {size:.2} m; they are \
                 passed through unchanged"
            ),
        };
        let place = format!("t = {:.3} s", input.position.t[innovations.fix[first] as usize]);
        notices.push(Code::PositionReset, place, jumps.len() as u64, text);
    }
    jumps.len() as u64
}

/// Number of fixes that share a sigma, which is computed from their own block and its two neighbours.
const SIGMA_BLOCK: usize = 25;

/// Robust sigma of each block, at least that of the whole flight and a centimetre (1e-7 deg is 1.1 cm).
fn local_sigma(values: &[f64]) -> Vec<f64> {
    let floor = signal::robust_sigma(values).unwrap_or_default().max(0.01);
    let blocks = values.len().div_ceil(SIGMA_BLOCK);
    let around = |b: usize| b.saturating_sub(1) * SIGMA_BLOCK..((b + 2) * SIGMA_BLOCK).min(values.len());
    (0..blocks).map(|b| signal::robust_sigma(&values[around(b)]).unwrap_or_default().max(floor)).collect()
}

/// Over five seconds the fixes must move like the velocity; if not, an axis, a sign or a unit is likely wrong.
pub(crate) fn warn_of_contradiction(
    input: &Input,
    settings: &Settings,
    segments: &[Range<usize>],
    notices: &mut Notices,
) {
    const BASE_S: f64 = 5.0;
    let flown = AXES.map(|k| of_segments(input, settings, segments, k));
    let (td, t) = (settings.delay.seconds(), &input.position.t);
    let (mut moved2, mut missed2, mut pairs) = (0.0, 0.0, 0_u64);
    let mut i = 0;
    for j in 0..t.len() {
        if t[j] - t[i] < BASE_S {
            continue;
        }
        if let Some(s) = covering(input, segments, t[i] - td, t[j] - td) {
            for k in AXES {
                let step = input.position.axes[k][j] - input.position.axes[k][i];
                moved2 += step * step;
                missed2 += (step - flown[k][s].flown(t[i] - td, t[j] - td)).powi(2);
            }
            pairs += 1;
        }
        i = j;
    }
    let share = if moved2 > 0.0 { (missed2 / moved2).sqrt() } else { 0.0 };
    if pairs >= 3 && share > 0.5 {
        let text = format!(
            "over {BASE_S} s the fixes disagree with the integrated velocity by {:.0} % of the distance: check the delay, and axes, signs and units of {} and {}",
            100.0 * share,
            input.names.position,
            input.names.velocity
        );
        notices.push(Code::VelocityContradictsPosition, "", pairs, text);
    }
}

/// rms with its standard uncertainty, if the record is long enough for one; `None` without rows.
fn rms(squares: impl Iterator<Item = f64> + Clone) -> Option<Estimate> {
    Blocks::of(squares.clone().count(), squares.map(|square| [square, 1.0])).size(root_mean)
}

/// Raw − compensated predicted from velocity, m.
pub(crate) fn predicted(input: &Input, rows: &Rows, settings: &Settings) -> Estimate {
    let displacement = AXES.map(|k| rows.predicted(input, settings, k));
    let squares = rows.valid().map(|row| AXES.map(|k| displacement[k][row].powi(2)).iter().sum());
    with_delay_uncertainty(rms(squares), rows, settings)
}

/// Adds U · u(Td) in quadrature: a displacement during Td is as uncertain as Td.
fn with_delay_uncertainty(estimate: Option<Estimate>, rows: &Rows, settings: &Settings) -> Estimate {
    let mut estimate = estimate.expect("a flight without a valid row is refused before it is scored");
    let speeds = rows.valid().map(|r| rows.velocity[0][r].powi(2) + rows.velocity[1][r].powi(2));
    if let (Some(u), Some(delay_u), Some(speed)) =
        (estimate.standard_uncertainty, settings.delay_uncertainty_s, rms(speeds))
    {
        estimate.standard_uncertainty = Some(u.hypot(speed.value * delay_u));
    }
    estimate
}

pub(crate) fn compensators(
    input: &Input,
    settings: &Settings,
    rows: &Rows,
    tracks: &[Positions],
    innovations: &Innovations,
) -> Vec<CompensatorResult> {
    let reference = input.reference.as_ref().map(|r| Reference::at(r, rows, rows.valid()));
    tracks
        .iter()
        .map(|track| {
            let shown = rows.valid().filter(|&row| track.has_own_output(row));
            let difference =
                shown.map(|row| AXES.map(|k| (tracks[0].axes[k][row] - track.axes[k][row]).powi(2)).iter().sum());
            let errors = reference.as_ref().map(|r| r.squared_errors(track));
            CompensatorResult {
                name: track.name.clone(),
                title: track.title.clone(),
                delay: track.delay,
                raw_minus_this_rms_m: if track.is_raw() {
                    Estimate { value: 0.0, standard_uncertainty: Some(0.0) }
                } else {
                    with_delay_uncertainty(rms(difference), rows, settings)
                },
                step_at_fix_rms_m: step_at_fix(input, track, innovations),
                error_rms_m: errors.as_deref().and_then(|errors| rms(errors.iter().copied())),
                error_p95_m: errors.as_deref().and_then(percentile_95),
            }
        })
        .collect()
}

/// Rms step of the output at the fixes, m. A filter's displacement is continuous, so its position steps at a fix like
/// the raw one. A smoothing compensator follows a fix slowly or knew it in advance, and has no such step.
fn step_at_fix(input: &Input, track: &Positions, innovations: &Innovations) -> Option<Estimate> {
    let square = |[n, e]: [f64; 2]| n * n + e * e;
    match track.further {
        Some(CompensatorKind::Kalman | CompensatorKind::OfflineShift | CompensatorKind::RtsSmoother) => None,
        _ if track.name == EXACT_ASYNC => {
            let [north, east] = &innovations.exact;
            rms(north.iter().zip(east).map(|(n, e)| square([*n, *e])))
        }
        _ => rms(innovations.fix.iter().map(|fix| square(step_to(input, *fix as usize)))),
    }
}

/// The 95th percentile of the error. Its uncertainty is from the spread of its ten consecutive parts, with Student's
/// quantile for nine. Its relative uncertainty is at least that of the rms, and missing if that is missing.
fn percentile_95(squares: &[f64]) -> Option<Estimate> {
    const PARTS: usize = 10;
    const STUDENT: f64 = 2.262_157;
    let p95 = |squares: &[f64]| signal::percentile(squares, 0.95).map(f64::sqrt);
    let value = p95(squares)?;
    let n = squares.len();
    let of_parts = (n >= 20 * PARTS).then(|| {
        let parts: Vec<f64> = (0..PARTS).filter_map(|b| p95(&squares[b * n / PARTS..(b + 1) * n / PARTS])).collect();
        let mean = parts.iter().sum::<f64>() / PARTS as f64;
        let spread = parts.iter().map(|p| (p - mean).powi(2)).sum::<f64>();
        0.5 * STUDENT * (spread / ((PARTS - 1) * PARTS) as f64).sqrt()
    });
    let of_rms = |rms: Estimate| Some(rms.standard_uncertainty? / rms.value.max(f64::MIN_POSITIVE));
    let share = rms(squares.iter().copied()).and_then(of_rms);
    let standard_uncertainty = of_parts.zip(share).map(|(u, share)| u.max(value * share));
    Some(Estimate { value, standard_uncertainty })
}

/// The reference at the valid rows that it covers without a gap.
pub(crate) struct Reference {
    pub(crate) row: Vec<usize>,
    pub(crate) axes: [Vec<f64>; 2],
}

impl Reference {
    /// Linear between reference samples (error at most a h²/8), never across a gap of more than 2.5 steps.
    pub(crate) fn at(reference: &Horizontal, rows: &Rows, of: impl Iterator<Item = usize>) -> Reference {
        let t = &reference.t;
        let longest = 2.5 * median_step(t);
        let mut out = Reference { row: vec![], axes: [vec![], vec![]] };
        let mut after = 0;
        for row in of {
            while after < t.len() && t[after] <= rows.t[row] {
                after += 1;
            }
            let Some(k) = after.checked_sub(1) else { continue };
            let (share, next) = if t[k] == rows.t[row] {
                (0.0, k)
            } else if after < t.len() && t[after] - t[k] <= longest {
                ((rows.t[row] - t[k]) / (t[after] - t[k]), after)
            } else {
                continue;
            };
            out.row.push(row);
            for (out, y) in out.axes.iter_mut().zip(&reference.axes) {
                out.push(y[k] + share * (y[next] - y[k]));
            }
        }
        out
    }

    fn squared_errors(&self, track: &Positions) -> Vec<f64> {
        let error = |i: usize, k: usize| track.axes[k][self.row[i]] - self.axes[k][i];
        let shown = (0..self.row.len()).filter(|&i| track.has_own_output(self.row[i]));
        shown.map(|i| AXES.map(|k| error(i, k).powi(2)).iter().sum()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten parts of 40 errors; every other one is 90 m, the rest are 101 to 110 m.
    #[test]
    fn the_95th_percentile_is_as_uncertain_as_the_mean_of_its_parts() {
        let parts = [1, 10, 2, 9, 3, 8, 4, 7, 5, 6].map(f64::from);
        let of_part = |part: f64| (0..40).map(move |k| if k % 2 == 0 { 90.0_f64 } else { 100.0 + part });
        let squares: Vec<f64> = parts.into_iter().flat_map(of_part).map(|error| error * error).collect();
        let found = percentile_95(&squares).unwrap();
        // Place 379.05 of 0 to 399: 109 m ends at 379.
        let value = (0.95 * 109.0_f64.powi(2) + 0.05 * 110.0_f64.powi(2)).sqrt();
        assert!((found.value - value).abs() < 1e-9, "{found:?}");
        // The variance of 1 to 10 is 82.5/9; half of Student's quantile for nine degrees of freedom.
        let of_parts = 0.5 * 2.262_157 * (82.5_f64 / 9.0 / 10.0).sqrt();
        let of_rms = rms(squares.iter().copied()).unwrap();
        let least = found.value * of_rms.standard_uncertainty.unwrap() / of_rms.value;
        let u = found.standard_uncertainty.unwrap();
        assert!((u - of_parts.max(least)).abs() < 1e-9, "{u}, not {of_parts} or {least}");
        assert!(of_parts > least, "the parts decide: {of_parts} {least}");
    }

    #[test]
    fn the_95th_percentile_of_few_errors_has_no_uncertainty() {
        let found = percentile_95(&[4.0; 199]).unwrap();
        assert_eq!((found.value, found.standard_uncertainty), (2.0, None));
        assert!(percentile_95(&[4.0; 200]).unwrap().standard_uncertainty.is_some());
        assert!(percentile_95(&[]).is_none());
    }
}
