//! A second file of a flight: its position and velocity become channels of the flight, `position.reference` and
//! `velocity.reference`, on the clock of the log.
//!
//! If each file has its own clock, the offset is estimated from the velocities: first by correlation over the whole
//! flight, then as the delay between a velocity of the log and the reference. That velocity initially counts as on
//! time. Its own lateness is removed once the delay network has measured it.

use delay_from_flight::{FlightDelaySettings, measure_against_reference};
use flight::{Channel, Clock, Flight, Quantity, Series, Stamp, Timeline, gps_of_unix, unix_of_gps};
use record::{ClockOffset, Estimate, Finding, MeasuredDelay, ReferenceClock};

/// Names of the channels of a reference file.
pub const REFERENCE_POSITION: &str = "position.reference";
/// As [`REFERENCE_POSITION`].
pub const REFERENCE_VELOCITY: &str = "velocity.reference";

/// Grid on which velocities are correlated, Hz.
const GRID_HZ: f64 = 5.0;
/// Offsets closer than this to the best are the same one, s.
const SAME_OFFSET_S: f64 = 5.0;
/// Velocities with a lower correlation are from different flights.
const LEAST_CORRELATION: f64 = 0.7;
/// Least ratio of the unexplained part at the second best offset to that at the best.
const RIVAL_RATIO: f64 = 1.5;
/// Interval over which a velocity is computed from a position, s.
const BASE_S: f64 = 1.0;
/// A drift is removed if it is at least this many standard uncertainties,
const DRIFT_SHOWN: f64 = 3.0;
/// is supported by at least this many windows,
const DRIFT_WINDOWS: usize = 4;
/// and does not exceed that of any real clock.
const WORST_DRIFT: f64 = 1e-3;
/// Two files that count UTC are from one flight if they share this much of the shorter one.
const LEAST_SHARED: f64 = 0.5;

/// Handling of a reference file's clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ClockRule {
    /// Two files that count UTC or GPS time share a clock; for others the offset is estimated.
    #[default]
    Auto,
    /// Both files have timestamps from one clock.
    Same,
    /// The offset is estimated.
    Own,
}

/// Channels used from a reference file: a position, a velocity, or both, on one clock.
struct Taken<'a> {
    position: Option<&'a Channel>,
    velocity: Option<&'a Channel>,
    clock: Clock,
}

impl<'a> Taken<'a> {
    fn of(reference: &'a Flight) -> Result<Taken<'a>, String> {
        let best = |wanted: &[Quantity]| {
            let fits = reference.channels.values().filter(|c| wanted.contains(&c.quantity));
            fits.max_by_key(|c| (c.quantity == Quantity::PositionGeodetic, c.update_rows().len()))
        };
        let position = best(&[Quantity::PositionGeodetic, Quantity::PositionNed]);
        let velocity = best(&[Quantity::VelocityNed]);
        let clock_of = |c: &Channel| c.series.timeline().clock();
        let clock = position.or(velocity).map(clock_of).ok_or("it holds no position and no velocity")?;
        Ok(Taken { position, velocity: velocity.filter(|v| clock_of(v) == clock), clock })
    }

    /// First and last timestamp.
    fn span(&self) -> Option<(Stamp, Stamp)> {
        let timeline = self.position.or(self.velocity)?.series.timeline();
        Some((timeline.first()?, timeline.last()?))
    }

    /// Adds it to the flight; `in_log` converts a timestamp to the clock of the log. Returns the names of the channels.
    fn join(&self, flight: &mut Flight, clock: Clock, in_log: &dyn Fn(Stamp) -> Option<Stamp>) -> Vec<String> {
        let all = [(REFERENCE_POSITION, self.position), (REFERENCE_VELOCITY, self.velocity)];
        let mut names = vec![];
        for (name, channel) in all.into_iter().filter_map(|(name, c)| Some((name, c?))) {
            if let Some(moved) = moved(channel, clock, in_log) {
                flight.channels.insert(name.to_owned(), moved);
                names.push(name.to_owned());
            }
        }
        names
    }
}

/// The channel with converted timestamps; `None` if they are out of range or no longer rise.
fn moved(channel: &Channel, clock: Clock, in_log: &dyn Fn(Stamp) -> Option<Stamp>) -> Option<Channel> {
    let timeline = channel.series.timeline();
    let stamps: Vec<Stamp> = timeline.stamps().iter().map(|s| in_log(*s)).collect::<Option<_>>()?;
    let timeline = Timeline::new(timeline.kind(), clock, stamps).ok()?.with_shared_step(timeline.shared_step_s());
    let components = (0..channel.present.len()).map(|k| channel.series.component(k).to_vec()).collect();
    let series = Series::new(timeline, components).ok()?;
    Some(Channel { series, other_stamps: vec![], ..channel.clone() })
}

/// Relation of the clock of `reference` to that of the log. `wanted` are the positions that the pipeline compensates;
/// their clock is that of the log.
#[must_use]
pub fn relate_clocks(
    flight: &Flight,
    reference: &Flight,
    wanted: &[String],
    rule: ClockRule,
    settings: &FlightDelaySettings,
) -> ReferenceClock {
    let unknown = |reason: String| ReferenceClock::Unknown { reason };
    let taken = match Taken::of(reference) {
        Ok(taken) => taken,
        Err(reason) => return unknown(reason),
    };
    let Some((_, position)) = flight.first_of(wanted) else {
        return unknown("the log has no position to compare it with".to_owned());
    };
    let timeline = position.series.timeline();
    let same = rule == ClockRule::Same || (rule == ClockRule::Auto && share_utc(timeline, &taken));
    if same {
        if converted(taken.clock, timeline.clock(), Stamp(0)).is_none() {
            return unknown(format!(
                "its clock was declared to be that of the log, but it counts {} and the log {}",
                taken.clock,
                timeline.clock()
            ));
        }
        return contradicted(flight, position, &taken, settings).map_or(ReferenceClock::Same, unknown);
    }
    offset(flight, &taken, timeline.clock(), settings).map_or_else(unknown, ReferenceClock::Own)
}

/// Similarity of the motions in a log and a second file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Likeness {
    /// Correlation coefficient of the horizontal velocities at the best clock offset.
    pub correlation: f64,
    /// Speed of the second file over that of the log, rms over the shared time.
    pub scale: f64,
}

/// Similarity of the motions of `reference` and of the log, for any clocks. `None` if one of them does not move.
#[must_use]
pub fn likeness(flight: &Flight, reference: &Flight, wanted: &[String]) -> Option<Likeness> {
    let taken = Taken::of(reference).ok()?;
    let (_, position) = flight.first_of(wanted)?;
    let clock = position.series.timeline().clock();
    let moves = velocity_of(flight, clock).map_or(position, |(_, velocity)| velocity);
    let log = Motion::of(moves, moves.series.timeline().first()?);
    let own = Motion::of(taken.velocity.or(taken.position)?, taken.span()?.0);
    let lag = signal::coarse_lag(log.as_input(), own.as_input(), GRID_HZ, SAME_OFFSET_S)?;
    let shared = |motion: &Motion, other: &Motion, shift_s: f64| {
        let ends = (*other.t.first()? + shift_s, *other.t.last()? + shift_s);
        motion.rms_between(ends)
    };
    let scale = shared(&own, &log, -lag.shift_s)? / shared(&log, &own, lag.shift_s)?;
    Some(Likeness { correlation: lag.correlation, scale })
}

/// The message if both count one clock, but the motion agrees only with clocks that are further apart than any delay in
/// the search.
fn contradicted(
    flight: &Flight,
    position: &Channel,
    taken: &Taken<'_>,
    settings: &FlightDelaySettings,
) -> Option<String> {
    let clock = position.series.timeline().clock();
    let moves = velocity_of(flight, clock).map_or(position, |(_, velocity)| velocity);
    let coarse = match coarse_offset(moves, taken) {
        Ok(coarse) => coarse,
        Err(why) => return is_of_another_flight(moves, taken).then_some(why),
    };
    let at = taken.span()?.0;
    let stated_ns = converted(taken.clock, clock, at)?.0.checked_sub(at.0)?;
    let apart_s = coarse.offset_ns.checked_sub(stated_ns)? as f64 * 1e-9;
    let (earliest, latest) = settings.search_s;
    let fits = apart_s >= earliest.min(-SAME_OFFSET_S) && apart_s <= latest.max(SAME_OFFSET_S);
    (!fits).then(|| {
        format!(
            "its clock is not that of the log: the motion agrees if about {apart_s:.1} s are added to its timestamps (correlation of \
             the velocities {:.2}). Use --reference-clock own (clock = \"own\" in a pipeline), which estimates the offset",
            coarse.correlation
        )
    })
}

/// Velocities of one flight that are less similar than this are unrelated,
const OTHER_FLIGHT: f64 = 0.7;
/// if the log moves at least this fast, rms, m/s: at rest there is nothing to compare.
const MOVES_MPS: f64 = 2.0;

/// Whether a log that moves has nothing in common with a second file.
fn is_of_another_flight(moves: &Channel, taken: &Taken<'_>) -> bool {
    let log = moves.series.timeline().first().map(|origin| Motion::of(moves, origin));
    let own = taken.velocity.or(taken.position).zip(taken.span()).map(|(channel, span)| Motion::of(channel, span.0));
    let Some((log, own)) = log.zip(own) else { return false };
    let is_fast = log.rms_between((f64::MIN, f64::MAX)).is_some_and(|rms| rms > MOVES_MPS);
    let lag = signal::coarse_lag(log.as_input(), own.as_input(), GRID_HZ, SAME_OFFSET_S);
    is_fast && lag.is_some_and(|lag| lag.correlation < OTHER_FLIGHT)
}

/// Adds position and velocity of `reference` to the flight and returns their names; none if clocks are not related.
pub fn join_reference(
    flight: &mut Flight,
    reference: &Flight,
    wanted: &[String],
    clock: &ReferenceClock,
) -> Vec<String> {
    let (Ok(taken), Some((_, position))) = (Taken::of(reference), flight.first_of(wanted)) else { return vec![] };
    let log = position.series.timeline().clock();
    match clock {
        ReferenceClock::Same => taken.join(flight, log, &|stamp| converted(taken.clock, log, stamp)),
        ReferenceClock::Own(offset) => taken.join(flight, log, &|stamp| offset.in_log_ns(stamp.0).map(Stamp)),
        ReferenceClock::Unknown { .. } => vec![],
    }
}

/// A timestamp on another clock, if both count the same time.
fn converted(from: Clock, to: Clock, stamp: Stamp) -> Option<Stamp> {
    match (from, to) {
        (Clock::Gps, Clock::Unix) => unix_of_gps(stamp),
        (Clock::Unix, Clock::Gps) => gps_of_unix(stamp),
        _ => (from == to).then_some(stamp),
    }
}

/// Whether both count UTC or GPS time and were recorded during the same flight.
fn share_utc(log: &Timeline, taken: &Taken<'_>) -> bool {
    let (Some((from, to)), Some((first, last))) = (taken.span(), log.first().zip(log.last())) else { return false };
    let unix = |clock: Clock, a: Stamp, b: Stamp| Some((clock.unix(a)?, clock.unix(b)?));
    let (Some(a), Some(b)) = (unix(taken.clock, from, to), unix(log.clock(), first, last)) else { return false };
    let shared = a.1.min(b.1).seconds_since(a.0.max(b.0));
    let shorter = a.1.seconds_since(a.0).min(b.1.seconds_since(b.0));
    shared > LEAST_SHARED * shorter
}

/// Clock of the log less that of the reference.
fn offset(
    flight: &Flight,
    taken: &Taken<'_>,
    clock: Clock,
    settings: &FlightDelaySettings,
) -> Result<ClockOffset, String> {
    let (by, velocity) = velocity_of(flight, clock).ok_or(
        "the log has no velocity to relate the clocks by, so the offset of the clocks cannot be separated from the \
         delay of the position: log a velocity, or use --reference-clock same (clock = \"same\" in a pipeline) if one \
         clock made the timestamps of both files",
    )?;
    let coarse = coarse_offset(velocity, taken)?;
    let (first, last) = taken.span().ok_or("it is empty")?;
    let middle_ns = first.0.midpoint(last.0);
    let mut found = ClockOffset {
        by: by.to_owned(),
        at_ns: middle_ns,
        offset_ns: coarse.offset_ns,
        standard_uncertainty_s: f64::INFINITY,
        drift: None,
        correlation: coarse.correlation,
    };
    let mut late = measured(flight, taken, clock, &found, settings)?;
    found.drift = drift_of(&late);
    if found.drift.is_some() {
        late = measured(flight, taken, clock, &found, settings)?;
    }
    let late = late.delay_s;
    found.offset_ns = found.offset_ns.saturating_add((1e9 * late.value).round() as i64);
    found.standard_uncertainty_s = late.standard_uncertainty.unwrap_or(f64::INFINITY);
    Ok(found)
}

/// A velocity on this clock: measured by a sensor, else from a filter; of several the one with most samples.
fn velocity_of(flight: &Flight, clock: Clock) -> Option<(&str, &Channel)> {
    let fits = |c: &Channel| c.quantity == Quantity::VelocityNed && c.series.timeline().clock() == clock;
    let all = flight.channels.iter().filter(|(name, c)| fits(c) && *name != REFERENCE_VELOCITY);
    let best = all.max_by_key(|(name, c)| (!record::is_filter_output(name), c.update_rows().len()));
    best.map(|(name, channel)| (name.as_str(), channel))
}

/// The offset to grid resolution, and the similarity of the velocities there.
struct Coarse {
    offset_ns: i64,
    correlation: f64,
}

/// `moves` is a velocity or a position of the log.
fn coarse_offset(moves: &Channel, taken: &Taken<'_>) -> Result<Coarse, String> {
    let (log_origin, origin) =
        moves.series.timeline().first().zip(taken.span().map(|span| span.0)).ok_or("one of the velocities is empty")?;
    let log = Motion::of(moves, log_origin);
    let own = taken.velocity.or(taken.position).ok_or("it holds no position and no velocity")?;
    let own = Motion::of(own, origin);
    let lag = signal::coarse_lag(log.as_input(), own.as_input(), GRID_HZ, SAME_OFFSET_S)
        .ok_or("its velocity does not change enough, or is too short, to relate the clocks")?;
    let correlation = lag.correlation;
    if correlation < LEAST_CORRELATION {
        return Err(format!(
            "its motion is not that of the log at any offset of the clocks (correlation of the velocities at best \
             {correlation:.2}): is it of the same flight?"
        ));
    }
    if 1.0 - lag.runner_up < RIVAL_RATIO * (1.0 - correlation) {
        return Err(format!(
            "the motion repeats itself: the clocks may be {:.1} s or {:.1} s apart: give logs of the whole flight, or use \
             --reference-clock same (clock = \"same\" in a pipeline) if one clock made the timestamps of both files",
            lag.shift_s, lag.runner_up_s
        ));
    }
    let apart = i128::from(log_origin.0) - i128::from(origin.0) + i128::from((1e9 * lag.shift_s) as i64);
    let offset_ns = i64::try_from(apart).map_err(|_| "its clock is out of range".to_owned())?;
    Ok(Coarse { offset_ns, correlation })
}

/// A horizontal velocity over time.
struct Motion {
    t: Vec<f64>,
    north: Vec<f64>,
    east: Vec<f64>,
}

impl Motion {
    fn as_input(&self) -> (&[f64], [&[f64]; 2]) {
        (&self.t, [&self.north, &self.east])
    }

    /// Rms speed over a time span, m/s; `None` without a moving sample in it.
    fn rms_between(&self, (from, to): (f64, f64)) -> Option<f64> {
        let all = self.t.iter().zip(self.north.iter().zip(&self.east));
        let inside = all.filter(|(t, _)| (from..=to).contains(*t)).map(|(_, (n, e))| n * n + e * e);
        let (sum, count) = inside.fold((0.0, 0_u32), |(sum, count), square| (sum + square, count + 1));
        (sum > 0.0).then(|| (sum / f64::from(count)).sqrt())
    }

    /// Motion from a velocity or a position.
    fn of(channel: &Channel, origin: Stamp) -> Motion {
        match channel.quantity {
            Quantity::VelocityNed => Motion::of_velocity(channel, origin),
            _ => Motion::of_position(channel, origin),
        }
    }

    fn of_velocity(channel: &Channel, origin: Stamp) -> Motion {
        let stamps = channel.series.timeline().stamps();
        let rows = channel.update_rows();
        let of = |k: usize| rows.iter().map(|&r| channel.series.component(k)[r]).collect();
        Motion { t: rows.iter().map(|&r| stamps[r].seconds_since(origin)).collect(), north: of(0), east: of(1) }
    }

    /// Displacements over about a second, at its middle.
    fn of_position(channel: &Channel, origin: Stamp) -> Motion {
        let stamps = channel.series.timeline().stamps();
        let rows = channel.update_rows();
        let at = |row: usize, k: usize| channel.series.component(k)[row];
        let scale = |row: usize| match channel.quantity {
            Quantity::PositionGeodetic => [flight::WGS84_A, flight::WGS84_A * at(row, 0).cos()],
            _ => [1.0, 1.0],
        };
        let mut out = Motion { t: vec![], north: vec![], east: vec![] };
        let mut before = 0;
        for now in 1..rows.len() {
            let seconds = |k: usize| stamps[rows[k]].seconds_since(origin);
            while before + 1 < now && seconds(now) - seconds(before + 1) >= BASE_S {
                before += 1;
            }
            let h = seconds(now) - seconds(before);
            if (BASE_S..4.0 * BASE_S).contains(&h) {
                let scale = scale(rows[now]);
                let speed = |k: usize| scale[k] * (at(rows[now], k) - at(rows[before], k)) / h;
                out.t.push(0.5 * (seconds(now) + seconds(before)));
                out.north.push(speed(0));
                out.east.push(speed(1));
            }
        }
        out
    }
}

/// How much later the velocity of the log is than the reference shifted by `offset`.
fn measured(
    flight: &Flight,
    taken: &Taken<'_>,
    clock: Clock,
    offset: &ClockOffset,
    settings: &FlightDelaySettings,
) -> Result<MeasuredDelay, String> {
    let velocity = flight.channels.get(&offset.by).ok_or("the log no longer has its velocity")?;
    let mut pair = Flight::default();
    pair.channels.insert(offset.by.clone(), velocity.clone());
    taken.join(&mut pair, clock, &|stamp| offset.in_log_ns(stamp.0).map(Stamp));
    let reference = if taken.position.is_some() { REFERENCE_POSITION } else { REFERENCE_VELOCITY };
    match measure_against_reference(&pair, &offset.by, reference, settings) {
        Finding::Found(delay) if delay.rival_s.is_none() => Ok(delay),
        Finding::Found(_) => Err("two offsets of the clocks explain the motion equally well".to_owned()),
        Finding::CannotTell(reason) => Err(format!("the offset of the clocks is unknown: {reason}")),
    }
}

/// The drift of the offset over the windows, if it is significant.
fn drift_of(measured: &MeasuredDelay) -> Option<Estimate> {
    let windows = &measured.over_time;
    if windows.len() < DRIFT_WINDOWS {
        return None;
    }
    let weighed = windows.iter().filter_map(|w| {
        let u = w.delay_s.standard_uncertainty.filter(|u| *u > 0.0)?;
        Some((0.5 * (w.start_s + w.end_s), w.delay_s.value, 1.0 / (u * u)))
    });
    let weighed: Vec<(f64, f64, f64)> = weighed.collect();
    let sum = |of: &dyn Fn(&(f64, f64, f64)) -> f64| weighed.iter().map(of).sum::<f64>();
    let total = sum(&|w| w.2);
    let (t, y) = (sum(&|w| w.2 * w.0) / total, sum(&|w| w.2 * w.1) / total);
    let spread = sum(&|w| w.2 * (w.0 - t).powi(2));
    let slope = sum(&|w| w.2 * (w.0 - t) * (w.1 - y)) / spread;
    let left = sum(&|w| w.2 * (w.1 - y - slope * (w.0 - t)).powi(2));
    let free = weighed.len().checked_sub(2).filter(|free| *free > 0)? as f64;
    let u = (left / free).max(1.0).sqrt() / spread.sqrt();
    let shown = slope.abs() > DRIFT_SHOWN * u && slope.abs() < WORST_DRIFT;
    shown.then_some(Estimate { value: slope, standard_uncertainty: Some(u) })
}

#[cfg(test)]
mod tests;
