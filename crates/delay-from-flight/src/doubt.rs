//! Checks of a fit against itself: alarms, most serious first, and a wider interval if the model failed.

use super::bands::Bands;
use super::fit::View;
use super::skew::Skew;
use record::{DelayHomogeneity, DelayOverTime, DelayPairKind, Estimate, MeasuredDelay, WindowDelay};
use signal::{Reading, mean_of};

/// An error of the recovery above this many standard uncertainties is an alarm.
const NOT_RECOVERED: f64 = 3.3;
/// Two frequency bands that differ by more than this many standard uncertainties disagree.
const BANDS_APART: f64 = 3.3;
/// A smaller difference between slow and fast motion is no filter, s.
const FILTER_S: f64 = 0.01;
/// White noise of a position and a velocity above that of any working receiver, m and m/s.
const WILD_NOISE: [f64; 2] = [5.0, 1.5];

/// Widens the interval and adds alarms. `skew` is a lopsided lateness found by the fit.
pub(crate) fn doubt(
    found: &mut MeasuredDelay,
    view: &View,
    over_time: Option<&DelayOverTime>,
    (kind, skew): (DelayPairKind, Option<&Skew>),
) {
    let varying = over_time.filter(|o| o.kind.varies());
    let mut wider_s = match varying {
        Some(varying) => mean_of_varying(found, varying),
        // Both describe how much the parts of the flight differ.
        None => over_time
            .map_or(0.0, |o| o.level_widening_s.max(by_unplaced_change(found, o)))
            .max(by_window(found.homogeneity, &found.over_time)),
    };
    if let Some(o) = over_time {
        found.alarm = o.kind.varies().then(|| o.words.clone());
        if found.alarm.is_none() && o.level_widening_s > 0.0 {
            found.alarms.push(o.constancy.note.clone().unwrap_or_else(|| o.words.clone()));
        }
    }
    if over_time.is_some_and(|o| o.unplaced_change) {
        found.alarms.push(
            "the delay changes during the flight, or the position was reset along the track; the motion does not show \
             when or by how much"
                .to_owned(),
        );
    }
    wider_s = wider_s.hypot(by_frequency(found, view)).hypot(by_operating_point(found, view.settings.alarm_p));
    not_recovered(found);
    if let Some(skew) = skew.filter(|_| varying.is_none()) {
        found.alarms.push(skew.words());
    }
    noise(found, kind);
    widen(found, wider_s);
}

/// Uses the mean of a varying delay over the flight and adds its range to the uncertainty. A constant fit settles on
/// one part of the flight and treats the rest as outliers.
fn mean_of_varying(found: &mut MeasuredDelay, varying: &DelayOverTime) -> f64 {
    // They belong to the same fit, and would give the delay of that part for every speed.
    found.splits.clear();
    let range_s = varying.span_s / 12_f64.sqrt();
    let Estimate { value, standard_uncertainty: Some(u) } = varying.level_s else { return range_s };
    let shift_s = value - found.delay_s.value;
    found.delay_s.value = value;
    found.interval_95_s = found.interval_95_s.map(|end| end + shift_s);
    found.remarks.push(format!(
        "this is the mean over the flight; a single delay would be {:.0} ms and would fit only part of the flight",
        1e3 * (value - shift_s)
    ));
    u.hypot(range_s)
}

/// Uncertainty from a change that is detected but cannot be located: the distance of the varying fit from the constant
/// one, and the uncertainty of the former.
fn by_unplaced_change(found: &MeasuredDelay, over_time: &DelayOverTime) -> f64 {
    let Estimate { value, standard_uncertainty: Some(u) } = over_time.level_s else { return 0.0 };
    if over_time.unplaced_change { (value - found.delay_s.value).hypot(u) } else { 0.0 }
}

/// Uncertainty of the mean from the scatter of the windows.
fn by_window(homogeneity: Option<DelayHomogeneity>, windows: &[WindowDelay]) -> f64 {
    if !homogeneity.is_some_and(|h| h.scatters()) {
        return 0.0;
    }
    let reading =
        |delay_s: Estimate| Some(Reading { value: delay_s.value, standard_uncertainty: delay_s.standard_uncertainty? });
    let windows: Vec<Reading> = windows.iter().filter_map(|w| reading(w.delay_s)).collect();
    let of_equals: f64 = windows.iter().map(|w| w.standard_uncertainty.powi(-2)).sum::<f64>().recip();
    mean_of(&windows).map_or(0.0, |mean| (mean.standard_uncertainty.powi(2) - of_equals).max(0.0).sqrt())
}

/// Compares slow and fast motion.
fn by_frequency(found: &mut MeasuredDelay, view: &View) -> f64 {
    let Some(bands) = Bands::of(view.fit) else { return 0.0 };
    let (apart_s, u) = (bands.fast_s - bands.slow_s, bands.apart_u_s);
    if apart_s.abs() <= BANDS_APART * u {
        return 0.0;
    }
    let digits = usize::from(1.96e3 * u < 9.95);
    let ms = |s: f64| flight::fixed(1e3 * s, digits);
    let cause = match apart_s.abs() > FILTER_S {
        true => "One of the two channels acts as a filter, not as a pure delay",
        false => "U includes the difference",
    };
    found.alarms.push(format!(
        "the delay depends on frequency: {} ms in slow motion, {} ms in fast (different by {} ± {} ms; the border is about \
         {:.2} Hz). {cause}",
        ms(bands.slow_s),
        ms(bands.fast_s),
        ms(apart_s.abs()),
        ms(1.96 * u),
        bands.border_hz
    ));
    apart_s.abs() / 12_f64.sqrt()
}

fn by_operating_point(found: &mut MeasuredDelay, alarm_p: f64) -> f64 {
    let mut wider_s = 0_f64;
    for split in found.splits.iter().filter(|s| s.p.is_some_and(|p| p < alarm_p)) {
        let of = |pick: fn(f64, f64) -> f64, start: f64| split.groups.iter().map(|g| g.delay_s.value).fold(start, pick);
        let span_s = of(f64::max, f64::NEG_INFINITY) - of(f64::min, f64::INFINITY);
        wider_s = wider_s.hypot(span_s / 12_f64.sqrt());
        found.alarms.push(format!(
            "the delay differs by {:.0} ms, depending on {} (p {})",
            1e3 * span_s,
            split.by,
            small(split.p.unwrap_or(0.0))
        ));
    }
    wider_s
}

fn not_recovered(found: &mut MeasuredDelay) {
    for injection in &found.injections {
        let u = injection.error_s.standard_uncertainty.unwrap_or(f64::INFINITY);
        if injection.error_s.value.abs() > NOT_RECOVERED * u {
            found.alarms.push(format!(
                "{:.0} ms added to the second half were measured as {:.0} ms: the halves differ by {:.0} ± {:.0} ms",
                1e3 * injection.injected_s,
                1e3 * (injection.injected_s + injection.error_s.value),
                1e3 * injection.error_s.value,
                1.96e3 * u
            ));
        }
    }
}

fn noise(found: &mut MeasuredDelay, kind: DelayPairKind) {
    let (limit, unit) = match kind {
        DelayPairKind::VelocityAgainstAcceleration => (WILD_NOISE[1], "m/s"),
        _ => (WILD_NOISE[0], "m"),
    };
    let white = found.pieces.iter().flat_map(|p| p.noise).map(|n| n.white_std).fold(0.0, f64::max);
    if white > limit {
        found.alarms.push(format!("noise of {white:.1} {unit} from sample to sample: far more than a receiver has"));
    }
}

fn widen(found: &mut MeasuredDelay, wider_s: f64) {
    if wider_s <= 0.0 {
        return;
    }
    let value = found.delay_s.value;
    found.widened_s = wider_s;
    found.delay_s.standard_uncertainty = found.delay_s.standard_uncertainty.map(|u| u.hypot(wider_s));
    for end in &mut found.interval_95_s {
        let half = *end - value;
        *end = value + half.signum() * half.hypot(1.96 * wider_s);
    }
}

fn small(p: f64) -> String {
    if p < 0.001 { "< 0.001".to_owned() } else { format!("= {p:.3}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use record::DelayStep;

    /// Windows of 60 s with u = 1 s.
    fn windows(delays_s: &[f64]) -> Vec<WindowDelay> {
        let window = |(k, delay_s): (usize, &f64)| WindowDelay {
            start_s: 60.0 * k as f64,
            end_s: 60.0 * (k + 1) as f64,
            delay_s: Estimate { value: *delay_s, standard_uncertainty: Some(1.0) },
        };
        delays_s.iter().enumerate().map(window).collect()
    }

    fn agreement(p: f64) -> Option<DelayHomogeneity> {
        let mean = Estimate { value: 0.0, standard_uncertainty: Some(1.0) };
        let largest_step = DelayStep { at_s: 60.0, before_s: mean, after_s: mean, p: 1.0 };
        Some(DelayHomogeneity { chi2: 18.0, degrees_of_freedom: 2, p, largest_step })
    }

    #[test]
    fn scattered_windows_widen_the_interval_to_that_of_their_mean() {
        // Standard deviation 3 of three windows, Student's 97.5 % quantile with two degrees of freedom. Without scatter
        // the uncertainty of the mean would be 1/√3.
        let unlike: f64 = 3.0 / 3_f64.sqrt() * 4.302_653 / 1.959_964;
        let expected = (unlike.powi(2) - 1.0 / 3.0).sqrt();
        let wider = by_window(agreement(1.2e-4), &windows(&[-3.0, 0.0, 3.0]));
        assert!((wider - expected).abs() < 1e-5, "{wider} is not {expected}");
    }

    #[test]
    fn windows_that_agree_do_not_widen_the_interval() {
        assert_eq!(by_window(agreement(0.02), &windows(&[-2.0, 0.0, 2.0])), 0.0);
        assert_eq!(by_window(None, &windows(&[0.0])), 0.0);
    }

    /// Uniformly distributed between two groups 40 ms apart.
    #[test]
    fn groups_that_differ_widen_the_interval_by_their_span_over_the_root_of_twelve() {
        let settings = simulate::FlightSettings { duration_s: 60.0, ..simulate::FlightSettings::default() };
        let flight = simulate::simulate(&settings).unwrap().to_flight().unwrap();
        let (mut delays, _) = crate::measure_delays(&flight, &crate::FlightDelaySettings::default());
        let record::Finding::Found(mut found) = delays.pairs.remove(0).delay else { panic!("no delay") };
        let group = |value: f64| record::DelayGroup {
            range: [10.0, 20.0],
            samples: 100,
            delay_s: Estimate { value, standard_uncertainty: Some(0.001) },
        };
        let split = |p: f64| record::DelaySplit {
            by: "ground speed, m/s".to_owned(),
            groups: vec![group(0.42), group(0.38)],
            p: Some(p),
        };
        found.alarms.clear();
        found.splits = vec![split(0.2)];
        assert_eq!((by_operating_point(&mut found, 1e-3), found.alarms.len()), (0.0, 0));
        found.splits = vec![split(1e-6), split(0.2), split(1e-6)];
        let wider_s = by_operating_point(&mut found, 1e-3);
        assert!((wider_s - 0.04 * (2.0_f64 / 12.0).sqrt()).abs() < 1e-12, "{wider_s}");
        assert_eq!(found.alarms.len(), 2);
        assert!(
            found.alarms[0].starts_with("the delay differs by 40 ms, depending on ground speed"),
            "{:?}",
            found.alarms
        );
    }
}
