//! Compares the clocks of one log: those of different topics, and a clock since boot with the log's own.

use flight::{
    Channel, Clock, Code, Distribution, Flight, LEAPS_KNOWN_UNTIL, Notices, Quantity, Stamp, StampKind,
    leaps_are_known_at,
};
use formats::stamps::distribution;
use formats::time::suspicion;
use std::collections::BTreeMap;

/// With fewer rows, a clock is not compared.
const FEWEST_ROWS: usize = 10;
/// Two topics whose starts and ends differ by the same offset within this, s, differ only in their clocks.
const SAME_S: f64 = 0.5;
/// Topics may begin a second or two apart without a fault: only larger offsets of starts and ends are examined, s.
const SHORTEST_S: f64 = 10.0;

/// The timestamps of one topic on one clock.
struct Line<'f> {
    name: &'f str,
    channel: &'f Channel,
    /// UTC of the first and the last timestamp.
    ends: [Stamp; 2],
    /// UTC minus the log's own time, s.
    to_log: Option<Distribution>,
}

/// Warns where two clocks that both claim UTC seem to differ by leap seconds, a time zone or a week.
pub(super) fn compare(flight: &mut Flight) {
    let mut notices = Notices::new();
    let lines = lines(flight);
    // The clock since boot is shared by all topics: checking the first one is enough.
    if let Some((line, what)) = lines.iter().find_map(|line| Some((line, against_log(line)?))) {
        let clock = line.channel.series.timeline().clock();
        let text = format!("channel {}, log timestamps and the clock {clock}, compared in UTC: {what}", line.name);
        let (place, rows) = (&line.channel.source.topic, line.channel.series.len() as u64);
        notices.push(Code::ClockSuspect, place, rows, text);
    }
    let pairs = lines.iter().enumerate().flat_map(|(i, a)| lines.iter().skip(i + 1).map(move |b| (a, b)));
    let mut reported: Vec<(String, u64)> = vec![];
    for (a, b) in pairs {
        let Some(what) = offset(a, b).and_then(|o| suspicion(&o, a.ends[0])) else { continue };
        // A wrong clock differs from every other one: the first pair is reported, the others are counted.
        let kind = what.split_once(": ").map_or("", |(_, kind)| kind);
        match reported.iter_mut().find(|(known, _)| known.ends_with(kind)) {
            Some((_, count)) => *count += 1,
            None => reported.push((format!("{} and {} use different clocks; {what}", a.name, b.name), 1)),
        }
    }
    for (text, pairs) in reported {
        notices.push(Code::ClockSuspect, "", pairs, format!("channels {text}"));
    }
    no_common_time(flight, &mut notices);
    flight.notices.extend(notices);
}

/// One line for each topic and clock, from its first channel by name.
fn lines(flight: &Flight) -> Vec<Line<'_>> {
    let mut lines: BTreeMap<(&str, StampKind), Line<'_>> = BTreeMap::new();
    for (name, channel) in &flight.channels {
        let timeline = channel.series.timeline();
        let unix = |stamp: &Stamp| flight.unix(timeline.clock(), *stamp);
        let ends = timeline.first().zip(timeline.last()).and_then(|(a, b)| Some([unix(&a)?, unix(&b)?]));
        let Some(ends) = ends.filter(|_| channel.series.len() >= FEWEST_ROWS) else { continue };
        let logged =
            channel.other_stamps.iter().find(|(kind, clock, _)| (*kind, *clock) == (StampKind::Logged, Clock::Unix));
        let to_log = logged.and_then(|(_, _, logged)| {
            let pairs = timeline.stamps().iter().zip(logged);
            distribution(
                &pairs.filter_map(|(stamp, logged)| Some(unix(stamp)?.seconds_since(*logged))).collect::<Vec<_>>(),
            )
        });
        let line = Line { name, channel, ends, to_log };
        lines.entry((channel.source.topic.as_str(), timeline.kind())).or_insert(line);
    }
    lines.into_values().collect()
}

/// What the difference between a clock since boot, tied to UTC, and the log's clock looks like. For other clocks the
/// channel's own rows show it.
fn against_log(line: &Line<'_>) -> Option<String> {
    if !matches!(line.channel.series.timeline().clock(), Clock::Boot | Clock::Elapsed) {
        return None;
    }
    let d = line.to_log.as_ref()?;
    let log_less_clock = Distribution { min: -d.max, p01: -d.p99, median: -d.median, p99: -d.p01, max: -d.min };
    suspicion(&log_less_clock, line.ends[0])
}

/// How far the clock of `a` is ahead of that of `b`, as far as the log shows it without examining the values: from the
/// log's own time on both, or from their starts and ends if these differ by the same offset.
fn offset(a: &Line<'_>, b: &Line<'_>) -> Option<Distribution> {
    if let (Some(a), Some(b)) = (&a.to_log, &b.to_log) {
        let apart = |x: f64, y: f64| x - y;
        return Some(Distribution {
            min: apart(a.min, b.max),
            p01: apart(a.p01, b.p99),
            median: apart(a.median, b.median),
            p99: apart(a.p99, b.p01),
            max: apart(a.max, b.min),
        });
    }
    let [begin, end] = [0, 1].map(|i: usize| a.ends.get(i).zip(b.ends.get(i)).map(|(a, b)| a.seconds_since(*b)));
    let (begin, end) = begin.zip(end)?;
    let telling = (begin - end).abs() <= SAME_S && begin.abs().min(end.abs()) >= SHORTEST_S;
    telling.then(|| distribution(&[begin, end])).flatten()
}

/// A position and a velocity that never overlap in time cannot be on one clock.
fn no_common_time(flight: &Flight, notices: &mut Notices) {
    let is_velocity = |c: &Channel| c.quantity == Quantity::VelocityNed;
    let is_position = |c: &Channel| matches!(c.quantity, Quantity::PositionGeodetic | Quantity::PositionNed);
    for (position, p) in flight.channels.iter().filter(|(_, c)| is_position(c)) {
        for (velocity, v) in flight.channels.iter().filter(|(_, c)| is_velocity(c)) {
            let (a, b) = (p.series.timeline(), v.series.timeline());
            let apart = a.clock() == b.clock() && (a.last() < b.first() || b.last() < a.first());
            if apart && p.series.len().min(v.series.len()) >= FEWEST_ROWS {
                let text = format!(
                    "channels {position} and {velocity} have no time in common, although both use the clock {}",
                    a.clock()
                );
                let place = format!("{}, {}", p.source.topic, v.source.topic);
                notices.push(Code::ClockSuspect, place, p.series.len() as u64, text);
            }
        }
    }
}

/// Notes that UTC was computed from GPS time on a day whose leap seconds are unknown, for a channel that counts GPS
/// time or a clock since boot that GPS time ties to UTC.
pub(super) fn note_unknown_leaps(flight: &mut Flight, tied_by_gps: bool) {
    let last = |channel: &Channel| {
        let timeline = channel.series.timeline();
        let reckoned = timeline.clock() == Clock::Gps || (tied_by_gps && timeline.clock() != Clock::Unix);
        timeline.last().filter(|_| reckoned).and_then(|stamp| flight.unix(timeline.clock(), stamp))
    };
    let last = flight.channels.values().filter_map(last).max();
    if last.is_none_or(leaps_are_known_at) {
        return;
    }
    let text = format!(
        "GPS time is converted to UTC with the leap seconds known until {LEAPS_KNOWN_UNTIL}; the flight is \
            later"
    );
    flight.notices.push(Code::LeapSeconds, "", 1, text);
}
