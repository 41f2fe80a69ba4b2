//! Curves of a component for the figures: reference, reference delayed as found, measured.

use crate::gap;
use crate::sensed::{SensedChannel, SensedComponent};
use record::Curve;
use signal::{ComponentFit, DelayFit, Reference, min_max};

/// A curve over the whole record keeps at most four rows in each of this many segments.
const BINS: usize = 300;
/// Number of points of a reference over the whole record.
const REFERENCE_POINTS: usize = 1200;
/// Reference rows per second in the zoom.
const ZOOM_RATE_HZ: f64 = 100.0;
/// Length of the zoom, s: a few swings.
const ZOOM_S: f64 = 10.0;
/// The zoom is moved in steps of this, s.
const ZOOM_STEP_S: f64 = 0.5;

/// Reference at the true time, reference delayed and scaled by the fit, measured: over the whole record, and over the
/// segment `zoom`.
pub(crate) fn component_curves(
    channel: &SensedChannel<'_>,
    component: &SensedComponent<'_>,
    fit: Option<(&DelayFit, &ComponentFit)>,
    zoom: (f64, f64),
) -> (Vec<Curve>, Vec<Curve>) {
    let (from, to) = component.reference.span();
    let whole = curves(channel, component, fit, (from, to), (to - from) / REFERENCE_POINTS as f64);
    let zoom = curves(channel, component, fit, zoom, 1.0 / ZOOM_RATE_HZ);
    (whole, zoom)
}

/// Measured − fitted over the record.
pub(crate) fn residual_curve(fit: &ComponentFit) -> Curve {
    curve("measured − fitted", &fit.t_used, &fit.residuals)
}

fn curves(
    channel: &SensedChannel<'_>,
    component: &SensedComponent<'_>,
    fit: Option<(&DelayFit, &ComponentFit)>,
    (start, end): (f64, f64),
    step: f64,
) -> Vec<Curve> {
    let (from, to) = component.reference.span();
    let gaps = channel.hidden.gaps;
    // The motion in a gap was not measured, so nothing is drawn there.
    let is_known = |t: &f64| (from..=to).contains(t) && !gap::contains(gaps, *t);
    let steps = ((end - start) / step).floor().max(0.0) as usize;
    let all: Vec<f64> = (0..=steps).map(|k| start + k as f64 * step).collect();
    let grid: Vec<f64> = all.iter().copied().filter(is_known).collect();
    let reference: Vec<f64> = grid.iter().map(|&t| component.reference.value_and_rate(t).0).collect();
    let mut curves = vec![curve("reference", &grid, &reference)];
    if let Some((fit, component_fit)) = fit {
        let (late_t, late): (Vec<f64>, Vec<f64>) = all
            .iter()
            .filter(|&&t| (from..=to).contains(&t) && is_known(&(t - fit.delay_s)))
            .map(|&t| (t, fitted(t, component.reference, fit, component_fit)))
            .unzip();
        curves.push(curve("reference, delayed and scaled as found", &late_t, &late));
    }
    let t = &channel.t;
    let rows = t.partition_point(|&x| x < start)..t.partition_point(|&x| x <= end);
    curves.push(curve("measured", &t[rows.clone()], &component.values[rows]));
    curves
}

fn fitted(t: f64, reference: &dyn Reference, fit: &DelayFit, component: &ComponentFit) -> f64 {
    let drift = component.drift.map_or(0.0, |d| d.value * (t - fit.middle_s));
    component.gain.value * reference.value_and_rate(t - fit.delay_s).0 + component.offset.value + drift
}

/// The segment with the most motion, away from gaps if possible: one for all channels, to allow comparison.
/// compared.
pub(crate) fn liveliest(t: &[f64], rate: &[f64], gaps: &[(f64, f64)]) -> (f64, f64) {
    let (Some(&from), Some(&to)) = (t.first(), t.last()) else { return (0.0, 0.0) };
    let square: Vec<f64> = rate.iter().map(|r| r * r).collect();
    let energy = signal::CumulativeIntegral::new(t, &square);
    let last = (to - ZOOM_S).max(from);
    let steps = ((last - from) / ZOOM_STEP_S) as usize;
    let starts = (0..=steps).map(|k| from + k as f64 * ZOOM_STEP_S);
    let of = |start: &f64| energy.between(*start, (start + ZOOM_S).min(to));
    let has_gap = |start: &f64| gaps.iter().any(|(before, after)| *before < start + ZOOM_S && *after > *start);
    let best = |all: &mut dyn Iterator<Item = f64>| all.max_by(|a, b| of(a).total_cmp(&of(b)));
    let start = best(&mut starts.clone().filter(|s| !has_gap(s))).or_else(|| best(&mut starts.clone())).unwrap_or(from);
    (start, (start + ZOOM_S).min(to))
}

/// A curve of at most four rows in each of 300 segments, with pen-ups where samples are missing.
pub(crate) fn curve(name: &str, t: &[f64], y: &[f64]) -> Curve {
    let kept = min_max(t, y, BINS);
    Curve {
        name: name.to_owned(),
        t_s: kept.rows.iter().map(|&row| t[row]).collect(),
        y: kept.rows.iter().map(|&row| y[row]).collect(),
        breaks: breaks(t, &kept.rows),
        stands_for: kept.stands_for as u64,
    }
}

/// Kept rows preceded by missing data: the step to the previous row is far longer than usual.
fn breaks(t: &[f64], kept: &[usize]) -> Vec<u32> {
    const GAP: f64 = 2.5;
    let mut steps: Vec<f64> = t.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let Some(usual) = signal::median_in_place(&mut steps) else { return vec![] };
    let is_gap = |row: usize| row > 0 && t[row] - t[row - 1] > GAP * usual;
    let gaps: Vec<usize> = (0..t.len()).filter(|&row| is_gap(row)).collect();
    let mut breaks: Vec<u32> =
        gaps.iter().filter_map(|gap| u32::try_from(kept.partition_point(|row| row < gap)).ok()).collect();
    breaks.dedup();
    breaks
}
