//! Whether the delay of a position stays the same: the varying fit comes first (delay over time).

use super::FlightDelaySettings;
use super::local::Prepared;
use super::pairs::{Pair, Second};
use super::pieces::Piece;
use crate::input::Horizontal;
use delay_over_time::{OverTimeSettings, PositionAgainstVelocity, analyse};
use record::{DelayOverTime, DelayPairKind, MeasuredDelay};
use std::ops::Range;

/// What the position says over time against the velocity of its pair; `None` for other pairs, and for outputs of filters.
pub(crate) fn over_time(
    pair: &Pair,
    prepared: &Prepared,
    velocity: &Horizontal,
    pieces: &[Piece],
    settings: &FlightDelaySettings,
) -> Option<DelayOverTime> {
    if pair.kind != DelayPairKind::PositionAgainstVelocity || !matches!(pair.second, Second::Velocity(_)) {
        return None;
    }
    let first = &prepared.first;
    let part = longest_part(&first.t, &velocity.t);
    let begins = pieces.iter().skip(1).filter_map(|p| p.rows.first()).map(|&row| first.t[row]);
    let breaks: Vec<f64> = begins.collect();
    let record = PositionAgainstVelocity {
        t: first.t.get(part.clone())?,
        north: first.axes[0].get(part.clone())?,
        east: first.axes[1].get(part.clone())?,
        velocity_t: &velocity.t,
        velocity_north: &velocity.axes[0],
        velocity_east: &velocity.axes[1],
        breaks: &breaks,
        device_time_s: None,
    };
    let (search, wide) = (settings.search_s, settings.wide_search_s);
    let settings = OverTimeSettings {
        search_s: [search.0, search.1],
        wide_search_s: [wide.0, wide.1],
        ..OverTimeSettings::default()
    };
    let mut found = analyse(&record, &settings).ok()?;
    if part.len() < first.t.len() {
        found.remarks.push(format!(
            "Whether the delay stays the same was asked of the longest part without a pause of {LONGEST_PAUSE_S:.0} s, {} of \
             {} fixes.",
            part.len(),
            first.t.len()
        ));
    }
    Some(found)
}

/// After a pause this long a receiver is another: it may have been switched off, s.
const LONGEST_PAUSE_S: f64 = 120.0;

/// Rows of the longest part, by fixes, without a long pause of either channel.
fn longest_part(t: &[f64], velocity_t: &[f64]) -> Range<usize> {
    let resumed = velocity_t.windows(2).filter(|w| w[1] - w[0] > LONGEST_PAUSE_S).map(|w| w[1]);
    let mut resumed = resumed.peekable();
    let mut best = 0..0;
    let mut from = 0;
    for k in 0..=t.len() {
        let mut ends = k == t.len() || (k > 0 && t[k] - t[k - 1] > LONGEST_PAUSE_S);
        while let Some(at) = resumed.next_if(|at| t.get(k).is_some_and(|t| t >= at)) {
            ends |= t.get(from).is_some_and(|first| *first < at);
        }
        if ends {
            if k - from > best.len() {
                best = from..k;
            }
            from = k;
        }
    }
    best
}

/// A delay that differs between parts of the flight, or by how fast it is flown, is known less well than its fit says; what
/// fails its own check is an alarm.
pub(crate) fn doubt(found: &mut MeasuredDelay, over_time: Option<&DelayOverTime>, alarm_p: f64) {
    let mut wider_s = over_time.map_or(0.0, |o| o.level_widening_s);
    for split in found.splits.iter().filter(|s| s.p.is_some_and(|p| p < alarm_p)) {
        let of = |pick: fn(f64, f64) -> f64, start: f64| split.groups.iter().map(|g| g.delay_s.value).fold(start, pick);
        let span_s = of(f64::max, f64::NEG_INFINITY) - of(f64::min, f64::INFINITY);
        wider_s = wider_s.hypot(span_s / 12_f64.sqrt());
        found.alarms.push(format!(
            "the delay differs by {:.0} ms with {} (p {})",
            1e3 * span_s,
            split.by,
            small(split.p.unwrap_or(0.0))
        ));
    }
    for injection in &found.injections {
        let u = injection.error_s.standard_uncertainty.unwrap_or(f64::INFINITY);
        if injection.error_s.value.abs() > NOT_RECOVERED * u {
            found.alarms.push(format!(
                "{:.0} ms put into the second half came back as {:.0} ms: the halves differ by {:.0} ± {:.0} ms",
                1e3 * injection.injected_s,
                1e3 * (injection.injected_s + injection.error_s.value),
                1e3 * injection.error_s.value,
                2e3 * u
            ));
        }
    }
    if let Some(o) = over_time {
        found.alarm = o.kind.varies().then(|| o.words.clone());
    }
    if wider_s > 0.0 {
        let value = found.delay_s.value;
        found.delay_s.standard_uncertainty = found.delay_s.standard_uncertainty.map(|u| u.hypot(wider_s));
        for end in &mut found.interval_95_s {
            let half = *end - value;
            *end = value + half.signum() * half.hypot(1.96 * wider_s);
        }
    }
}

/// An error of the recovery beyond this many standard uncertainties is an alarm.
const NOT_RECOVERED: f64 = 3.3;

fn small(p: f64) -> String {
    if p < 0.001 { "< 0.001".to_owned() } else { format!("= {p:.3}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_part_without_a_pause_of_either_channel_is_taken() {
        let t: Vec<f64> = (0..1000).map(f64::from).collect();
        let all: Vec<f64> = (0..2000).map(|k| 0.5 * f64::from(k)).collect();
        assert_eq!(longest_part(&t, &all), 0..1000);
        let paused: Vec<f64> = all.iter().copied().filter(|t| !(300.0..500.0).contains(t)).collect();
        assert_eq!(longest_part(&t, &paused), 0..500, "up to where velocity is back; without it a fix says nothing");
        let late: Vec<f64> = all.iter().copied().filter(|t| !(100.0..300.0).contains(t)).collect();
        assert_eq!(longest_part(&t, &late), 300..1000);
        let broken: Vec<f64> = t.iter().map(|t| if *t < 400.0 { *t } else { t + 500.0 }).collect();
        assert_eq!(longest_part(&broken, &all), 400..1000);
        assert_eq!(longest_part(&[], &all), 0..0);
    }
}
