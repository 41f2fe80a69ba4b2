//! Whether the delay is constant.

use super::fit::{View, estimate};
use record::{DelayHomogeneity, DelayStep, WindowDelay};
use signal::{DelayWindow, SegmentDelay, delay_windows, homogeneity};

/// Steps in which the end of a window is searched.
const TILES: usize = 120;
/// Maximum number of windows of a flight, and the minimum if there is enough information.
const MOST_WINDOWS: f64 = 24.0;
const FEWEST_WINDOWS: f64 = 4.0;

/// Results of the windows.
pub(crate) struct OverTime {
    pub(crate) windows: Vec<WindowDelay>,
    pub(crate) homogeneity: Option<DelayHomogeneity>,
    pub(crate) alarm: Option<String>,
}

/// The delay in windows that do not overlap, each with its own offsets and drifts. Each is as long as needed for the
/// target uncertainty of the settings (with between 4 and 24 windows in total).
pub(crate) fn over_time(view: &View) -> OverTime {
    let whole = view.fit.standard_uncertainty_s;
    let aim = view.settings.window_sigma_s.clamp(whole * FEWEST_WINDOWS.sqrt(), whole * MOST_WINDOWS.sqrt());
    let windows = delay_windows(view.fit, aim, TILES);
    let segment = |w: &DelayWindow| SegmentDelay {
        middle_s: 0.5 * (w.start_s + w.end_s),
        delay_s: w.delay_s,
        standard_uncertainty_s: w.standard_uncertainty_s,
    };
    let segments: Vec<SegmentDelay> = windows.iter().map(segment).collect();
    let homogeneity = homogeneity(&segments).and_then(|(chi2, p)| {
        let degrees_of_freedom = segments.len() as u64 - 1;
        Some(DelayHomogeneity { chi2, degrees_of_freedom, p, largest_step: largest_step(&windows)? })
    });
    OverTime {
        windows: windows
            .iter()
            .map(|w| WindowDelay {
                start_s: w.start_s,
                end_s: w.end_s,
                delay_s: estimate(w.delay_s, w.standard_uncertainty_s),
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

/// The window border where the means before and after differ most; its p-value is Bonferroni-corrected.
fn largest_step(windows: &[DelayWindow]) -> Option<DelayStep> {
    let mean = |part: &[DelayWindow]| {
        let weight = |w: &DelayWindow| w.standard_uncertainty_s.powi(-2);
        let total: f64 = part.iter().map(weight).sum();
        (part.iter().map(|w| weight(w) * w.delay_s).sum::<f64>() / total, total.powf(-0.5))
    };
    let step = |k: usize| {
        let (before, after) = (mean(&windows[..k]), mean(&windows[k..]));
        let z = (after.0 - before.0) / before.1.hypot(after.1);
        (
            z.abs(),
            DelayStep {
                at_s: 0.5 * (windows[k - 1].end_s + windows[k].start_s),
                before_s: estimate(before.0, before.1),
                after_s: estimate(after.0, after.1),
                p: (signal::chi_squared_tail(z * z, 1.0) * (windows.len() - 1) as f64).min(1.0),
            },
        )
    };
    (1..windows.len()).map(step).max_by(|a, b| a.0.total_cmp(&b.0)).map(|s| s.1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_step_is_at_the_border_where_the_means_differ_most() {
        let window = |(k, delay_s): (usize, f64)| DelayWindow {
            start_s: 60.0 * k as f64,
            end_s: 60.0 * k as f64 + 50.0,
            delay_s,
            standard_uncertainty_s: 0.01,
        };
        let windows: Vec<DelayWindow> = [0.4, 0.4, 0.43, 0.43].into_iter().enumerate().map(window).collect();
        let step = largest_step(&windows).unwrap();
        // Means of two windows each: 30 ms ± 10 ms apart, which is three standard uncertainties, at one of three borders.
        assert_eq!(step.at_s, 115.0);
        assert!((step.before_s.value - 0.4).abs() < 1e-12 && (step.after_s.value - 0.43).abs() < 1e-12, "{step:?}");
        let u = 0.01 / 2_f64.sqrt();
        assert!((step.before_s.standard_uncertainty.unwrap() - u).abs() < 1e-12, "{step:?}");
        assert!((step.after_s.standard_uncertainty.unwrap() - u).abs() < 1e-12, "{step:?}");
        assert!((step.p - 3.0 * 0.002_699_8).abs() < 1e-6, "{step:?}");
        assert!(largest_step(&windows[..1]).is_none());
    }
}
