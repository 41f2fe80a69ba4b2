//! Whether the delay stays the same.

use super::fit::{View, estimate};
use record::{DelayHomogeneity, DelayStep, WindowDelay};
use signal::{ComponentFit, DelayFit, SegmentDelay, delay_by_segment, homogeneity};

/// Steps in which the end of a window is looked for.
const TILES: usize = 120;
/// Windows that a flight is cut into: no more than these, and no fewer if it says as much.
const MOST_WINDOWS: f64 = 24.0;
const FEWEST_WINDOWS: f64 = 4.0;

/// What windows say.
pub(crate) struct OverTime {
    pub(crate) windows: Vec<WindowDelay>,
    pub(crate) homogeneity: Option<DelayHomogeneity>,
    pub(crate) alarm: Option<String>,
}

/// The delay in windows that do not overlap, each as long as it takes to know the delay as well as the settings aim at
/// (between 4 and 24 windows' worth), with offsets and drifts of its own.
pub(crate) fn over_time(view: &View) -> OverTime {
    let whole = view.fit.standard_uncertainty_s;
    let aim = view.settings.window_sigma_s.clamp(whole * FEWEST_WINDOWS.sqrt(), whole * MOST_WINDOWS.sqrt());
    let segments = windows(view, aim);
    let found: Vec<SegmentDelay> = segments.iter().map(|s| s.2).collect();
    let homogeneity = homogeneity(&found).and_then(|(chi2, p)| {
        let degrees_of_freedom = found.len() as u64 - 1;
        Some(DelayHomogeneity { chi2, degrees_of_freedom, p, largest_step: largest_step(&segments)? })
    });
    OverTime {
        windows: segments
            .iter()
            .map(|(start_s, end_s, s)| WindowDelay {
                start_s: *start_s,
                end_s: *end_s,
                delay_s: estimate(s.delay_s, s.standard_uncertainty_s),
            })
            .collect(),
        homogeneity,
        alarm: homogeneity.and_then(|h| alarm(&h, view.settings.alarm_p)),
    }
}

fn alarm(h: &DelayHomogeneity, alarm_p: f64) -> Option<String> {
    let step = h.largest_step;
    let ms = |e: record::Estimate| {
        format!("{:.1} ± {:.1} ms", 1e3 * e.value, 1.96e3 * e.standard_uncertainty.unwrap_or(0.0))
    };
    let (before, after) = (ms(step.before_s), ms(step.after_s));
    if step.p < alarm_p {
        return Some(format!(
            "the delay changes during the flight: {before} before {:.0} s, {after} after (p = {:.1e}). One delay for the \
             whole flight is a compromise",
            step.at_s, step.p
        ));
    }
    (h.p < alarm_p).then(|| {
        format!(
            "the delay does not stay the same: chi-squared {:.1} for {} windows (p = {:.1e}). One delay for the whole \
             flight is a compromise",
            h.chi2,
            h.degrees_of_freedom + 1,
            h.p
        )
    })
}

/// Windows from the first stamp on, each extended until it is known to `aim`; what is left at the end goes to the last.
fn windows(view: &View, aim: f64) -> Vec<(f64, f64, SegmentDelay)> {
    let stamps = || view.fit.components.iter().flat_map(|c| c.t_used.first().into_iter().chain(c.t_used.last()));
    let first = stamps().copied().fold(f64::INFINITY, f64::min);
    let last = stamps().copied().fold(f64::NEG_INFINITY, f64::max);
    let tile = (last - first) / TILES as f64;
    let measurements = view.record.measurements();
    let delay_within = |a: usize, b: usize| {
        // The last window holds the last stamp.
        let end = if b == TILES { last + tile } else { first + tile * b as f64 };
        let part = part_of(view.fit, first + tile * a as f64, end)?;
        let (start, end) = span(&part);
        let most = part.components.iter().map(|c| c.t_used.len()).max()?;
        let window_s = (end - start) * (1.0 + 0.5 / most.saturating_sub(1).max(1) as f64);
        delay_by_segment(&measurements, &part, window_s, 0.0).first().copied().map(|s| (start, end, s))
    };
    let mut out: Vec<(f64, f64, SegmentDelay)> = vec![];
    let (mut from, mut last_from) = (0, 0);
    while from < TILES {
        let mut to = from + 1;
        let found = loop {
            let found = delay_within(from, to);
            match found {
                Some(w) if w.2.standard_uncertainty_s <= aim => break Some(w),
                _ if to == TILES => break None,
                Some(w) => {
                    // Information grows with length, or faster.
                    let more = (w.2.standard_uncertainty_s / aim).powi(2).clamp(1.0, 2.0) * 0.9;
                    to = ((from as f64 + (to - from) as f64 * more) as usize).clamp(to + 1, TILES);
                }
                None => to = (to + (to - from)).min(TILES),
            }
        };
        match found {
            Some(window) => {
                out.push(window);
                last_from = from;
            }
            None => {
                if let (true, Some(window)) = (out.pop().is_some(), delay_within(last_from, TILES)) {
                    out.push(window);
                }
                break;
            }
        }
        from = to;
    }
    out
}

/// The fit with the rows from `from` to before `to` only, as far as [`delay_by_segment`] looks.
fn part_of(fit: &DelayFit, from: f64, to: f64) -> Option<DelayFit> {
    let part = |c: &ComponentFit| {
        let rows = c.t_used.partition_point(|t| *t < from)..c.t_used.partition_point(|t| *t < to);
        ComponentFit {
            used_rows: c.used_rows[rows.clone()].to_vec(),
            t_used: c.t_used[rows.clone()].to_vec(),
            weights: c.weights[rows].to_vec(),
            residuals: vec![],
            whitened: vec![],
            slope: vec![],
            ..*c
        }
    };
    let components: Vec<ComponentFit> = fit.components.iter().map(part).collect();
    components.iter().any(|c| c.t_used.len() > 1).then_some(DelayFit { components, ..*fit })
}

fn span(fit: &DelayFit) -> (f64, f64) {
    let stamps = || fit.components.iter().flat_map(|c| c.t_used.first().into_iter().chain(c.t_used.last()));
    (stamps().copied().fold(f64::INFINITY, f64::min), stamps().copied().fold(f64::NEG_INFINITY, f64::max))
}

/// The border of two windows at which the means before and after differ most; its p-value is Bonferroni's.
fn largest_step(windows: &[(f64, f64, SegmentDelay)]) -> Option<DelayStep> {
    let mean = |part: &[(f64, f64, SegmentDelay)]| {
        let weight = |s: &SegmentDelay| s.standard_uncertainty_s.powi(-2);
        let total: f64 = part.iter().map(|w| weight(&w.2)).sum();
        (part.iter().map(|w| weight(&w.2) * w.2.delay_s).sum::<f64>() / total, total.powf(-0.5))
    };
    let step = |k: usize| {
        let (before, after) = (mean(&windows[..k]), mean(&windows[k..]));
        let z = (after.0 - before.0) / before.1.hypot(after.1);
        (
            z.abs(),
            DelayStep {
                at_s: 0.5 * (windows[k - 1].1 + windows[k].0),
                before_s: estimate(before.0, before.1),
                after_s: estimate(after.0, after.1),
                p: (signal::chi_squared_tail(z * z, 1.0) * (windows.len() - 1) as f64).min(1.0),
            },
        )
    };
    (1..windows.len()).map(step).max_by(|a, b| a.0.total_cmp(&b.0)).map(|s| s.1)
}
