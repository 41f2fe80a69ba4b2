//! Whether the delay of a position is constant: the varying fit comes first (delay over time).

use super::FlightDelaySettings;
use super::coarse::Coarse;
use super::local::Prepared;
use super::pairs::{Pair, Second};
use super::pieces::Piece;
use super::reference::Interpolated;
use crate::horizontal::Horizontal;
use delay_over_time::{OverTimeSettings, PositionAgainstVelocity, analyse};
use record::{DelayOverTime, DelayPairKind};
use std::borrow::Cow;
use std::ops::Range;

/// Delay over time of the position against `second`, the velocity or reference track of its pair; `None` for other
/// pairs, and for outputs of filters.
pub(crate) fn over_time(
    pair: &Pair,
    prepared: &Prepared,
    second: &Horizontal,
    pieces: &[Piece],
    settings: &FlightDelaySettings,
) -> Option<DelayOverTime> {
    let of_position =
        matches!(pair.kind, DelayPairKind::PositionAgainstVelocity | DelayPairKind::PositionAgainstReference);
    if !of_position || record::is_filter_output(&pair.first) {
        return None;
    }
    let velocity = match &pair.second {
        Second::Velocity(_) => Cow::Borrowed(second),
        Second::Position(_) => Cow::Owned(velocity_of(second)?),
        Second::Acceleration(_) | Second::Rate(_) => return None,
    };
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
    };
    let (search, wide) = (settings.search_s, settings.wide_search_s);
    let settings = OverTimeSettings {
        search_s: [search.0, search.1],
        wide_search_s: [wide.0, wide.1],
        ..OverTimeSettings::default()
    };
    let mut found = analyse(&record, &settings).ok()?;
    if part.len() < first.t.len() {
        let was = if found.constancy.tested { "was tested on" } else { "could only be tested on" };
        found.remarks.push(format!(
            "Whether the delay stays the same {was} the longest part without a pause of {LONGEST_PAUSE_S:.0} s, {} of {} \
             fixes.",
            part.len(),
            first.t.len()
        ));
    }
    Some(found)
}

/// The velocity of a track at its samples: the slope of the parabola through each and its neighbours.
fn velocity_of(track: &Horizontal) -> Option<Horizontal> {
    if track.t.len() < super::local::LEAST_SAMPLES {
        return None;
    }
    let slopes = |axis: &Vec<f64>| Interpolated::new(&track.t, axis).slopes().to_vec();
    Some(Horizontal { t: track.t.clone(), axes: [slopes(&track.axes[0]), slopes(&track.axes[1])] })
}

/// After a longer pause a receiver may have restarted with another delay, s.
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

/// Removes the fixes that arrived in a burst: they share a timestamp but not the lateness of the others. Single late
/// fixes stay: they are part of the mean lateness, and robust weights suppress them otherwise. Returns whether any was
/// removed.
pub(crate) fn skip_bursts(pieces: &mut [Piece], t: &[f64], over_time: &DelayOverTime) -> bool {
    let mut out: Vec<usize> = vec![];
    for burst in &over_time.bursts {
        let first = t.partition_point(|x| *x < burst.start_s);
        out.extend(first..first.saturating_add(burst.fixes as usize).min(t.len()));
    }
    out.sort_unstable();
    let rows: usize = pieces.iter().map(|p| p.rows.len()).sum();
    if out.is_empty() || 4 * out.len() > rows {
        return false;
    }
    pieces.iter_mut().for_each(|p| p.rows.retain(|row| out.binary_search(row).is_err()));
    true
}

/// Another start for the constant fit: the level of the varying one, if that is known and elsewhere.
pub(crate) fn start(coarse: &Coarse, over_time: &DelayOverTime) -> Option<Coarse> {
    let level = over_time.level_s;
    let known = level.standard_uncertainty.is_some_and(|u| u < LEVEL_KNOWN_S) && over_time.two_delays_fit.is_none();
    let elsewhere = (level.value - coarse.delay_s).abs() > ELSEWHERE_S;
    let there = Coarse { delay_s: level.value, rival_s: Some(coarse.delay_s), ..*coarse };
    (known && elsewhere).then_some(there)
}

/// A level with less uncertainty than this is used as a start, s,
const LEVEL_KNOWN_S: f64 = 0.05;
/// if it is farther from the coarse delay than this, s.
const ELSEWHERE_S: f64 = 0.3;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_part_without_a_pause_of_either_channel_is_used() {
        let t: Vec<f64> = (0..1000).map(f64::from).collect();
        let all: Vec<f64> = (0..2000).map(|k| 0.5 * f64::from(k)).collect();
        assert_eq!(longest_part(&t, &all), 0..1000);
        let paused: Vec<f64> = all.iter().copied().filter(|t| !(300.0..500.0).contains(t)).collect();
        assert_eq!(
            longest_part(&t, &paused),
            0..500,
            "up to where velocity is back; without it a fix carries no information"
        );
        let late: Vec<f64> = all.iter().copied().filter(|t| !(100.0..300.0).contains(t)).collect();
        assert_eq!(longest_part(&t, &late), 300..1000);
        let broken: Vec<f64> = t.iter().map(|t| if *t < 400.0 { *t } else { t + 500.0 }).collect();
        assert_eq!(longest_part(&broken, &all), 400..1000);
        assert_eq!(longest_part(&[], &all), 0..0);
    }
}
