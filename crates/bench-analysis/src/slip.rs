//! Counts lost or gained by an encoder at one place: afterwards the angle continues with a constant offset.
//!
//! A smoother turns such a step into false motion, and the residual of the whole record hardly shows it.

use signal::regress;

/// A place where the encoder's count jumps permanently.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slip {
    /// First row after it.
    pub row: usize,
    /// Instant of that row, s after the first sample.
    pub t_s: f64,
    /// Increase of the angle at it, counts.
    pub counts: f64,
}

/// Time over which the motion is modelled as a polynomial before and after, s, and the minimum number of samples.
const HALF_S: f64 = 0.1;
const LEAST_HALF: usize = 8;
/// A window of samples this many times longer than usual has a gap, which hides a step.
const LONGEST: f64 = 1.5;
/// An increment that differs from its neighbours by less than this, counts, is not a significant slip.
const LEAST_COUNTS: f64 = 3.0;
/// Number of increments on either side for the comparison.
const AROUND: usize = 4;
/// Number of standard uncertainties for a step to be a slip. Measured on 90 clean records of 14 kinds: 4.2 at most; a
/// slip of 3 counts has 10 at 100 Hz, one of 10 counts has 27.
const SURE: f64 = 8.0;
/// Scatter of a perfect quantiser, counts: 1/√12.
const QUANTISER: f64 = 0.289;

/// The slips of an encoder, in order of time. `t` in s, `angle` and `lsb` (one count) in rad.
///
/// At each increment that differs from its neighbours, fits a polynomial of fourth order and a step to 0.1 s before and
/// after. Hand motion produces a step of no more than four standard uncertainties.
pub(crate) fn slips(t: &[f64], angle: &[f64], lsb: f64) -> Vec<Slip> {
    let Some(step_s) = signal::median_step(t).filter(|s| *s > 0.0) else { return vec![] };
    let half = ((HALF_S / step_s).round() as usize).max(LEAST_HALF);
    let mut found: Vec<(Slip, f64)> = vec![];
    for row in half..(t.len() + 1).saturating_sub(half) {
        let rows = row - half..row + half;
        let usual_s = (2 * half - 1) as f64 * step_s;
        if !stands_out(angle, row, lsb) || t[rows.end - 1] - t[rows.start] > LONGEST * usual_s {
            continue;
        }
        let Some((counts, sure)) = step(&t[rows.clone()], &angle[rows], half, lsb) else { continue };
        if sure < SURE || counts.abs() < LEAST_COUNTS {
            continue;
        }
        let slip = Slip { row, t_s: t[row], counts };
        match found.last_mut().filter(|(last, _)| row - last.row < 2 * half) {
            Some(last) if last.1 < sure => *last = (slip, sure),
            Some(_) => {}
            None => found.push((slip, sure)),
        }
    }
    found.into_iter().map(|(slip, _)| slip).collect()
}

/// Whether the increment before `row` differs from the median of those around it.
fn stands_out(angle: &[f64], row: usize, lsb: f64) -> bool {
    let increment = |k: usize| angle[k] - angle[k - 1];
    let (first, end) = (row.saturating_sub(AROUND).max(1), (row + AROUND + 1).min(angle.len()));
    let mut around: Vec<f64> = (first..end).filter(|k| *k != row).map(increment).collect();
    let usual = signal::median_in_place(&mut around).unwrap_or(0.0);
    (increment(row) - usual).abs() >= (LEAST_COUNTS - 0.5) * lsb
}

/// Step before sample `at`, counts, and its size in standard uncertainties.
fn step(t: &[f64], angle: &[f64], at: usize, lsb: f64) -> Option<(f64, f64)> {
    const NAMES: [&str; 5] = ["1", "t", "t²", "t³", "t⁴"];
    let (middle, scale) = (t[at], 0.5 * (t[t.len() - 1] - t[0]));
    let powers: Vec<Vec<f64>> =
        (0..5).map(|power| t.iter().map(|t| ((t - middle) / scale).powi(power)).collect()).collect();
    let columns: Vec<&[f64]> = powers.iter().map(Vec::as_slice).collect();
    let counts: Vec<f64> = angle.iter().map(|a| (a - angle[0]) / lsb).collect();
    let after: Vec<f64> = (0..t.len()).map(|k| f64::from(u8::from(k >= at))).collect();
    let motion = regress(&columns, &NAMES, &counts).ok()?.residuals;
    let shape = regress(&columns, &NAMES, &after).ok()?.residuals;
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let power = dot(&shape, &shape);
    let step = dot(&shape, &motion) / power;
    let freedom = t.len().saturating_sub(NAMES.len() + 1).max(1) as f64;
    let rest = ((dot(&motion, &motion) - step * step * power).max(0.0) / freedom).sqrt();
    Some((step, step.abs() * power.sqrt() / rest.max(QUANTISER)))
}
