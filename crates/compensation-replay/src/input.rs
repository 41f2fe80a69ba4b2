//! The flight as input to the compensators: seconds and metres from one origin.

use crate::settings::Settings;
use delay_from_flight::{Averaged, Horizontal};
use flight::{Channel, Clock, Code, Flight, Geodetic, LocalFrame, Notices, Quantity, Severity, Stamp, StampKind};

/// Why a flight cannot be replayed. Each message says what would help.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// A required channel is not in the log.
    #[error("no {what} channel: the pipeline asks for {wanted}; the log binds {held}")]
    NoChannel {
        /// `position` or `velocity`.
        what: &'static str,
        /// Preferred names of the pipeline.
        wanted: String,
        /// Available channels: names of this kind, else the number of others.
        held: String,
    },
    /// The channel is of a different kind.
    #[error("{channel} holds {quantity:?}, which is not a {what}")]
    WrongQuantity {
        /// Its name.
        channel: String,
        /// Its quantity.
        quantity: Quantity,
        /// The required quantity.
        what: &'static str,
    },
    /// Position and velocity have timestamps on unrelated clocks.
    #[error("{position} has timestamps of the clock {a}, {velocity} of {b}: they cannot be compared")]
    Clocks {
        /// Position channel.
        position: String,
        /// Its clock.
        a: Clock,
        /// Velocity channel.
        velocity: String,
        /// Its clock.
        b: Clock,
    },
    /// A channel has too few samples.
    #[error("{channel} has too few usable samples: {rows}; at least {least} are needed")]
    TooShort {
        /// Its name.
        channel: String,
        /// Its updates.
        rows: usize,
        /// Required number.
        least: usize,
    },
    /// Position and velocity do not overlap in time.
    #[error("{position} ({p0:.1} to {p1:.1} s) and {velocity} ({v0:.1} to {v1:.1} s) do not overlap in time")]
    NoOverlap {
        /// Position channel.
        position: String,
        /// Its first update, s.
        p0: f64,
        /// Its last.
        p1: f64,
        /// Velocity channel.
        velocity: String,
        /// Its first sample, s.
        v0: f64,
        /// Its last.
        v1: f64,
    },
    /// Position and velocity overlap, but never long enough.
    #[error(
        "{position} and {velocity} overlap, but no fix comes at least {delay_s:.3} s (the delay) after the first \
         velocity: nothing can be scored"
    )]
    NothingValid {
        /// Position channel.
        position: String,
        /// Velocity channel.
        velocity: String,
        /// The delay, s.
        delay_s: f64,
    },
    /// For a stationary vehicle, late and on time look alike.
    #[error(
        "the vehicle does not travel (95 % of ground speeds are below {p95_mps:.2} m/s; replay.min_speed_mps is {limit_mps:.2} m/s); \
         a late position shows only in motion, best in turns"
    )]
    NoMotion {
        /// 95th percentile of the ground speed, m/s.
        p95_mps: f64,
        /// The limit, m/s.
        limit_mps: f64,
    },
    /// The delay cannot be removed causally.
    #[error("the delay to remove is {0:.3} s: only a positive delay (a late position) can be compensated")]
    DelayNotPositive(f64),
}

/// All inputs of the replay.
#[derive(Debug)]
pub(crate) struct Input {
    pub(crate) names: record::PairUse,
    pub(crate) origin: Stamp,
    pub(crate) clock: Clock,
    pub(crate) frame: Option<LocalFrame>,
    /// Fixes, without held repeats.
    pub(crate) position: Horizontal,
    /// Down coordinate of each fix, m.
    pub(crate) down: Vec<f64>,
    pub(crate) velocity: Horizontal,
    pub(crate) reference: Option<Horizontal>,
    /// Number of neighbouring velocity samples per average.
    pub(crate) averaged: usize,
}

const LEAST_ROWS: usize = 3;

impl Input {
    pub(crate) fn of(flight: &Flight, settings: &Settings, notices: &mut Notices) -> Result<Input, Refusal> {
        if settings.delay.seconds() <= 0.0 {
            return Err(Refusal::DelayNotPositive(settings.delay.seconds()));
        }
        let [(position_name, position), (velocity_name, velocity)] =
            pick_pair(flight, &settings.position, &settings.velocity)?;
        let clock = same_clock((position_name, position), (velocity_name, velocity))?;
        let first_fix = first_update(position_name, position)?;
        let first_sample = first_update(velocity_name, velocity)?;
        let stamp = |channel: &Channel, row: usize| channel.series.timeline().stamps()[row];
        let origin = stamp(position, first_fix).min(stamp(velocity, first_sample));
        let reference = reference_of(flight, settings, position);
        let frame =
            (position.quantity == Quantity::PositionGeodetic).then(|| LocalFrame::new(geodetic(position, first_fix)));
        let most = settings.most_samples;
        let out = Averaged::new((velocity, velocity_name), most, "the replay", notices);
        let averaged = out.each();
        let velocity_local = rotated(velocity, position, origin, frame.as_ref(), out);
        let fixes = replayed_fixes((position, position_name), &velocity_local.t, origin, most, notices);
        let place = (origin, frame.as_ref());
        let out = Averaged::none(fixes.len());
        let (position_local, down) = local((position, position_name), fixes.into_iter(), place, out)?;
        let reference_local = reference.map(|named| track_of_reference(named, most, place, notices)).transpose()?;
        let input = Input {
            names: record::PairUse {
                position: position_name.to_owned(),
                velocity: velocity_name.to_owned(),
                reference: reference.map(|(name, _)| name.to_owned()),
            },
            origin,
            clock,
            frame,
            position: position_local,
            down,
            velocity: velocity_local,
            reference: reference_local,
            averaged,
        };
        input.check_overlap()?;
        Ok(input)
    }

    /// Timestamps with steps longer than the delay cannot show it.
    pub(crate) fn warn_of_coarse_stamps(
        flight: &Flight,
        names: &record::PairUse,
        settings: &Settings,
        notices: &mut Notices,
    ) {
        let mut found: Vec<(&str, f64)> = vec![];
        for name in [&names.position, &names.velocity] {
            let Some(timeline) = flight.channels.get(name).map(|c| c.series.timeline()) else { continue };
            let tick_s = tick_s(timeline.stamps());
            if timeline.kind() == StampKind::Logged && tick_s >= settings.delay.seconds() {
                found.push((name, tick_s));
            }
        }
        let Some((_, tick_s)) = found.first() else { return };
        let which = found.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(" and ");
        let all_regular = found.iter().all(|(name, _)| flight.channels.get(*name).is_some_and(is_regular));
        // The samples may really have been taken at their timestamps.
        let how = match all_regular {
            true => "a row comes at every step of a regular clock, and the log does not show how old its values are",
            false => "the logger's timestamps are rounded to whole steps",
        };
        let text = format!(
            "{which}: {how}. A step of {tick_s} s is no shorter than the delay of {:.3} s: the effect of the \
             compensation is drawn, but these timestamps cannot show whether it is right",
            settings.delay.seconds()
        );
        notices.push(Code::StampsCoarserThanDelay, which, found.len() as u64, text);
    }

    fn check_overlap(&self) -> Result<(), Refusal> {
        let ends = |t: &[f64]| (t[0], t[t.len() - 1]);
        let ((p0, p1), (v0, v1)) = (ends(&self.position.t), ends(&self.velocity.t));
        if p0 <= v1 && v0 <= p1 {
            return Ok(());
        }
        let (position, velocity) = (self.names.position.clone(), self.names.velocity.clone());
        Err(Refusal::NoOverlap { position, p0, p1, velocity, v0, v1 })
    }
}

/// The largest of 1 s, 0.5 s, 0.1 s and 0.01 s that divides all timestamps; 0 if none does.
fn tick_s(stamps: &[Stamp]) -> f64 {
    let ticks = [1_000_000_000, 500_000_000, 100_000_000, 10_000_000];
    let tick = ticks.into_iter().find(|tick| stamps.iter().all(|s| s.0 % tick == 0));
    tick.map_or(0.0, |tick| tick as f64 * 1e-9)
}

/// Least share of equal steps between timestamps for a regular channel.
const REGULAR_SHARE: f64 = 0.95;

/// Whether a channel's timestamps are evenly spaced except for gaps. The samples were then taken at their timestamps,
/// rather than the times of an irregular source rounded.
fn is_regular(channel: &Channel) -> bool {
    let stamps = channel.series.timeline().stamps();
    let mut steps: Vec<i64> = stamps.windows(2).map(|pair| pair[1].0.saturating_sub(pair[0].0)).collect();
    steps.sort_unstable();
    let Some(median) = steps.get(steps.len() / 2) else { return false };
    let equal = steps.iter().filter(|step| *step == median).count();
    equal as f64 >= REGULAR_SHARE * steps.len() as f64
}

/// A channel with its name.
pub type Picked<'a> = (&'a str, &'a Channel);

/// The position and the velocity channel for a replay of this flight, each the first of its list that the flight has.
///
/// # Errors
/// [`Refusal::NoChannel`] or [`Refusal::WrongQuantity`].
pub fn pick_pair<'a>(
    flight: &'a Flight,
    position: &'a [String],
    velocity: &'a [String],
) -> Result<[Picked<'a>; 2], Refusal> {
    Ok([pick(flight, "position", position)?, pick(flight, "velocity", velocity)?])
}

fn pick<'a>(flight: &'a Flight, what: &'static str, wanted: &'a [String]) -> Result<Picked<'a>, Refusal> {
    let (name, channel) = flight.first_of(wanted).ok_or_else(|| Refusal::NoChannel {
        what,
        wanted: some_of(wanted),
        held: available_instead(flight, what),
    })?;
    if is(what, channel.quantity) {
        Ok((name, channel))
    } else {
        Err(Refusal::WrongQuantity { channel: name.to_owned(), quantity: channel.quantity, what })
    }
}

/// The first names of a long list, and how many more there are.
#[must_use]
pub fn some_of(names: &[String]) -> String {
    const NAMED: usize = 4;
    match names {
        [first @ .., _] if first.len() >= NAMED => {
            format!("{} and {} more", names[..NAMED - 1].join(", "), names.len() - (NAMED - 1))
        }
        all => all.join(", "),
    }
}

fn is(what: &str, quantity: Quantity) -> bool {
    match quantity {
        Quantity::PositionGeodetic | Quantity::PositionNed => what == "position",
        Quantity::VelocityNed => what == "velocity",
        _ => false,
    }
}

/// Channels of this kind, else the first three of other kinds.
fn available_instead(flight: &Flight, what: &str) -> String {
    let of_kind: Vec<&str> =
        flight.channels.iter().filter(|(_, c)| is(what, c.quantity)).map(|(name, _)| name.as_str()).collect();
    if !of_kind.is_empty() {
        let names = of_kind.join(", ");
        return format!("{names}. Set {what} = [\"{}\"] under [channels] of the pipeline to use it", of_kind[0]);
    }
    let others: Vec<&str> = flight.channels.keys().take(3).map(String::as_str).collect();
    match flight.channels.len() - others.len() {
        0 if others.is_empty() => "nothing".to_owned(),
        0 => others.join(", "),
        more => format!("{} and {more} more, none of them a {what}", others.join(", ")),
    }
}

fn same_clock((position_name, position): Picked, (velocity_name, velocity): Picked) -> Result<Clock, Refusal> {
    let [a, b] = [position, velocity].map(|channel| channel.series.timeline().clock());
    if a == b {
        return Ok(a);
    }
    Err(Refusal::Clocks { position: position_name.to_owned(), a, velocity: velocity_name.to_owned(), b })
}

/// First update of a channel that has enough of them.
fn first_update(name: &str, channel: &Channel) -> Result<usize, Refusal> {
    let rows = channel.update_count();
    match channel.updates().next() {
        Some(first) if rows >= LEAST_ROWS => Ok(first),
        _ => Err(Refusal::TooShort { channel: name.to_owned(), rows, least: LEAST_ROWS }),
    }
}

/// Rows of the fixes that are replayed: all, or in a long record those that are the newest at a velocity sample, plus
/// the first and the last. Fixes are never averaged, because their age counts from their own timestamps.
fn replayed_fixes(
    (position, name): (&Channel, &str),
    velocity_t: &[f64],
    origin: Stamp,
    most: usize,
    notices: &mut Notices,
) -> Vec<usize> {
    let fixes = position.update_count();
    if fixes <= most {
        return position.update_rows();
    }
    let stamps = position.series.timeline().stamps();
    let mut next = 0;
    let mut rows = position.updates().peekable();
    let mut kept = vec![];
    while let Some(row) = rows.next() {
        let until = rows.peek().map_or(f64::INFINITY, |&after| stamps[after].seconds_since(origin));
        let seen = next;
        while next < velocity_t.len() && velocity_t[next] < until {
            next += 1;
        }
        if next > seen || kept.is_empty() || rows.peek().is_none() {
            kept.push(row);
        }
    }
    let text = format!("{name}: {} of {fixes} fixes are replayed, the newest at each velocity sample", kept.len());
    notices.push(Code::SamplesLeftOut.at(Severity::Info), name, (fixes - kept.len()) as u64, text);
    kept
}

fn geodetic(channel: &Channel, row: usize) -> Geodetic {
    let s = &channel.series;
    Geodetic { latitude: s.component(0)[row], longitude: s.component(1)[row], height: s.component(2)[row] }
}

/// The first reference in the settings that is a position of the same kind on the same clock.
fn reference_of<'a>(flight: &'a Flight, settings: &'a Settings, position: &Channel) -> Option<(&'a str, &'a Channel)> {
    let clock = position.series.timeline().clock();
    let fits = |channel: &Channel| channel.quantity == position.quantity && channel.series.timeline().clock() == clock;
    let named = settings.reference.iter().filter_map(|name| Some((name.as_str(), flight.channels.get(name)?)));
    named.into_iter().find(|(_, channel)| fits(channel))
}

/// The track of a reference: every row, or its updates if neighbours are averaged.
fn track_of_reference(
    (name, channel): (&str, &Channel),
    most: usize,
    place: (Stamp, Option<&LocalFrame>),
    notices: &mut Notices,
) -> Result<Horizontal, Refusal> {
    let out = Averaged::new((channel, name), most, "the replay", notices);
    let takes_held = out.each() == 1;
    let rows = (0..channel.series.len()).filter(|row| takes_held || !channel.held[*row]);
    Ok(local((channel, name), rows, place, out)?.0)
}

/// North and east of a position channel in metres, and down.
pub(crate) fn local(
    (channel, name): (&Channel, &str),
    rows: impl Iterator<Item = usize>,
    (origin, frame): (Stamp, Option<&LocalFrame>),
    mut out: Averaged<3>,
) -> Result<(Horizontal, Vec<f64>), Refusal> {
    let stamps = channel.series.timeline().stamps();
    for row in rows {
        let ned = match (channel.quantity, frame) {
            (Quantity::PositionGeodetic, Some(frame)) => frame.to_ned(geodetic(channel, row)),
            (Quantity::PositionNed, _) => [0, 1, 2].map(|k| channel.series.component(k)[row]),
            (quantity, _) => {
                return Err(Refusal::WrongQuantity { channel: name.to_owned(), quantity, what: "position" });
            }
        };
        out.push(stamps[row].seconds_since(origin), ned);
    }
    let (t, [north, east, down]) = out.finish();
    Ok((Horizontal { t, axes: [north, east] }, down))
}

/// North and east velocity, rotated from the aircraft's own north-east-down (at its newest fix) into the axes of the
/// origin, so that its integral is a difference of local positions. The fix is late by Td, which rotates the velocity
/// wrongly by v Td tan(latitude)/R: 1.7 mm of position at 200 m/s, 60° and 0.4 s.
fn rotated(
    velocity: &Channel,
    position: &Channel,
    origin: Stamp,
    frame: Option<&LocalFrame>,
    mut out: Averaged<2>,
) -> Horizontal {
    let stamps = velocity.series.timeline().stamps();
    let fix_stamps = position.series.timeline().stamps();
    let mut fixes = position.updates().peekable();
    let mut newest = fixes.next();
    for row in velocity.updates() {
        while let Some(fix) = fixes.next_if(|fix| fix_stamps[*fix] <= stamps[row]) {
            newest = Some(fix);
        }
        let own = [0, 1, 2].map(|k| velocity.series.component(k)[row]);
        let ned = frame.zip(newest).map_or(own, |(frame, fix)| frame.from_local_ned(geodetic(position, fix), own));
        out.push(stamps[row].seconds_since(origin), [ned[0], ned[1]]);
    }
    out.horizontal()
}
