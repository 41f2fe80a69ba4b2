//! The flight as the compensators see it: seconds and metres from one origin.

use crate::settings::Settings;
use flight::{Channel, Clock, Code, Flight, Geodetic, LocalFrame, Notices, Quantity, Stamp, StampKind};

/// Why a flight cannot be replayed. Each says what would help.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// A channel that is needed is not in the log.
    #[error("no {what} channel: the pipeline asks for {wanted}; the log binds {held}")]
    NoChannel {
        /// `position` or `velocity`.
        what: &'static str,
        /// Names that the pipeline prefers.
        wanted: String,
        /// What the flight holds instead: names of this kind, else how many others.
        held: String,
    },
    /// The channel is of another kind.
    #[error("{channel} holds {quantity:?}, which is no {what}")]
    WrongQuantity {
        /// Its name.
        channel: String,
        /// What it holds.
        quantity: Quantity,
        /// What is needed.
        what: &'static str,
    },
    /// Position and velocity are stamped by clocks that nobody has related.
    #[error("{position} is stamped by the clock {a}, {velocity} by {b}: they cannot be compared")]
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
    /// Too little of a channel.
    #[error("{channel} has {rows} usable sample(s); at least {least} are needed")]
    TooShort {
        /// Its name.
        channel: String,
        /// Its updates.
        rows: usize,
        /// What is needed.
        least: usize,
    },
    /// The two do not meet in time.
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
    /// Position and velocity meet, but never long enough.
    #[error(
        "{position} and {velocity} overlap, but no fix comes a delay of {delay_s:.3} s after the velocity's start: nothing \
         can be scored"
    )]
    NothingValid {
        /// Position channel.
        position: String,
        /// Velocity channel.
        velocity: String,
        /// The delay, s.
        delay_s: f64,
    },
    /// Standing still, late and on time look alike.
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

/// The horizontal axes: index into everything that has a north and an east.
pub(crate) const AXES: [usize; 2] = [0, 1];

/// Samples of a horizontal vector.
#[derive(Debug, Clone, Default)]
pub(crate) struct Horizontal {
    pub(crate) t: Vec<f64>,
    /// North, then east.
    pub(crate) axes: [Vec<f64>; 2],
}

impl Horizontal {
    /// One axis at an instant, linear between samples and constant beyond them.
    pub(crate) fn at(&self, t: f64, axis: usize) -> f64 {
        let y = &self.axes[axis];
        let after = self.t.partition_point(|&x| x <= t);
        match (after.checked_sub(1), self.t.get(after)) {
            (None, _) => y[0],
            (Some(k), None) => y[k],
            (Some(k), Some(next)) => y[k] + (t - self.t[k]) / (next - self.t[k]) * (y[after] - y[k]),
        }
    }
}

/// Everything that the replay reads.
#[derive(Debug)]
pub(crate) struct Input {
    pub(crate) names: record::PairUse,
    pub(crate) origin: Stamp,
    pub(crate) clock: Clock,
    pub(crate) frame: Option<LocalFrame>,
    /// Fixes, held repeats left out.
    pub(crate) position: Horizontal,
    /// Down coordinate of each fix, m.
    pub(crate) down: Vec<f64>,
    pub(crate) velocity: Horizontal,
    pub(crate) reference: Option<Horizontal>,
}

const LEAST_ROWS: usize = 3;

impl Input {
    pub(crate) fn of(flight: &Flight, settings: &Settings) -> Result<Input, Refusal> {
        if settings.delay.seconds() <= 0.0 {
            return Err(Refusal::DelayNotPositive(settings.delay.seconds()));
        }
        let [(position_name, position), (velocity_name, velocity)] =
            pick_pair(flight, &settings.position, &settings.velocity)?;
        let clock = position.series.timeline().clock();
        if velocity.series.timeline().clock() != clock {
            return Err(Refusal::Clocks {
                position: position_name.to_owned(),
                a: clock,
                velocity: velocity_name.to_owned(),
                b: velocity.series.timeline().clock(),
            });
        }
        let fixes = updates(position_name, position)?;
        let samples = updates(velocity_name, velocity)?;
        let origin = position.series.timeline().stamps()[fixes[0]].min(velocity.series.timeline().stamps()[samples[0]]);
        let reference = settings.reference.iter().find_map(|name| {
            let channel = flight.channels.get(name)?;
            (channel.quantity == position.quantity && channel.series.timeline().clock() == clock)
                .then_some((name, channel))
        });
        let frame =
            (position.quantity == Quantity::PositionGeodetic).then(|| LocalFrame::new(geodetic(position, fixes[0])));
        let (position_local, down) = local(position_name, position, &fixes, origin, frame.as_ref())?;
        let velocity_local = turned(velocity, &samples, origin, frame.as_ref(), position, &fixes);
        let reference_local = match reference {
            Some((name, channel)) => {
                let rows: Vec<usize> = (0..channel.series.len()).collect();
                Some(local(name, channel, &rows, origin, frame.as_ref())?.0)
            }
            None => None,
        };
        let input = Input {
            names: record::PairUse {
                position: position_name.to_owned(),
                velocity: velocity_name.to_owned(),
                reference: reference.map(|(name, _)| name.clone()),
            },
            origin,
            clock,
            frame,
            position: position_local,
            down,
            velocity: velocity_local,
            reference: reference_local,
        };
        input.check_overlap()?;
        Ok(input)
    }

    /// A clock that ticks more slowly than the delay cannot show it.
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
        // They may have been sampled when they are stamped.
        let how = match all_regular {
            true => "a row comes at every step of a regular clock, and how old its values are the log does not say",
            false => "the logger's stamps are rounded to whole steps",
        };
        let text = format!(
            "{which}: {how}. A step of {tick_s} s is no shorter than the delay of {:.3} s: what compensation changes is drawn, but \
             these stamps cannot show whether it is right",
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

/// The largest of 1 s, 0.5 s, 0.1 s and 0.01 s of which all stamps are multiples; 0 if none.
fn tick_s(stamps: &[Stamp]) -> f64 {
    let ticks = [1_000_000_000, 500_000_000, 100_000_000, 10_000_000];
    let tick = ticks.into_iter().find(|tick| stamps.iter().all(|s| s.0 % tick == 0));
    tick.map_or(0.0, |tick| tick as f64 * 1e-9)
}

/// Of steps between stamps so many are equal where rows come as regularly as a clock.
const REGULAR_SHARE: f64 = 0.95;

/// Whether a channel's stamps are evenly spaced, but for gaps: so they stand where samples were taken by a clock, and not where
/// the times of an irregular source were rounded.
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

/// The position and the velocity channel that a replay of this flight uses, each the first of its list that the
/// flight holds.
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
        wanted: wanted.join(", "),
        held: held_instead(flight, what),
    })?;
    if is(what, channel.quantity) {
        Ok((name, channel))
    } else {
        Err(Refusal::WrongQuantity { channel: name.to_owned(), quantity: channel.quantity, what })
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
fn held_instead(flight: &Flight, what: &str) -> String {
    let of_kind: Vec<&str> =
        flight.channels.iter().filter(|(_, c)| is(what, c.quantity)).map(|(name, _)| name.as_str()).collect();
    if !of_kind.is_empty() {
        return of_kind.join(", ");
    }
    let others: Vec<&str> = flight.channels.keys().take(3).map(String::as_str).collect();
    match flight.channels.len() - others.len() {
        0 if others.is_empty() => "nothing".to_owned(),
        0 => others.join(", "),
        more => format!("{} and {more} more, none of them a {what}", others.join(", ")),
    }
}

fn updates(name: &str, channel: &Channel) -> Result<Vec<usize>, Refusal> {
    let rows = channel.update_rows();
    if rows.len() < LEAST_ROWS {
        return Err(Refusal::TooShort { channel: name.to_owned(), rows: rows.len(), least: LEAST_ROWS });
    }
    Ok(rows)
}

fn geodetic(channel: &Channel, row: usize) -> Geodetic {
    let s = &channel.series;
    Geodetic { latitude: s.component(0)[row], longitude: s.component(1)[row], height: s.component(2)[row] }
}

/// North and east of a position channel in metres, and down beside them.
pub(crate) fn local(
    name: &str,
    channel: &Channel,
    rows: &[usize],
    origin: Stamp,
    frame: Option<&LocalFrame>,
) -> Result<(Horizontal, Vec<f64>), Refusal> {
    let stamps = channel.series.timeline().stamps();
    let mut out =
        Horizontal { t: rows.iter().map(|&r| stamps[r].seconds_since(origin)).collect(), ..Horizontal::default() };
    let mut down = Vec::with_capacity(rows.len());
    for &row in rows {
        let ned = match (channel.quantity, frame) {
            (Quantity::PositionGeodetic, Some(frame)) => frame.to_ned(geodetic(channel, row)),
            (Quantity::PositionNed, _) => [0, 1, 2].map(|k| channel.series.component(k)[row]),
            (quantity, _) => {
                return Err(Refusal::WrongQuantity { channel: name.to_owned(), quantity, what: "position" });
            }
        };
        AXES.into_iter().for_each(|k| out.axes[k].push(ned[k]));
        down.push(ned[2]);
    }
    Ok((out, down))
}

/// North and east velocity, turned from the aircraft's own north-east-down (at its newest fix)
/// into the axes of the origin, so that its integral is a difference of local positions. The fix
/// is late by Td, which turns the velocity wrongly by v Td tan(latitude)/R: 1.7 mm of position
/// at 200 m/s, 60° and 0.4 s.
fn turned(
    velocity: &Channel,
    samples: &[usize],
    origin: Stamp,
    frame: Option<&LocalFrame>,
    position: &Channel,
    fixes: &[usize],
) -> Horizontal {
    let stamps = velocity.series.timeline().stamps();
    let fix_stamps = position.series.timeline().stamps();
    let mut out = Horizontal::default();
    let mut newest = 0;
    for &row in samples {
        while newest + 1 < fixes.len() && fix_stamps[fixes[newest + 1]] <= stamps[row] {
            newest += 1;
        }
        let own = [0, 1, 2].map(|k| velocity.series.component(k)[row]);
        let ned = frame.map_or(own, |f| f.from_local_ned(geodetic(position, fixes[newest]), own));
        out.t.push(stamps[row].seconds_since(origin));
        AXES.into_iter().for_each(|k| out.axes[k].push(ned[k]));
    }
    out
}
