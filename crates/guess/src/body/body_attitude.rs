//! Roll, pitch and yaw: infers the unit from what is stated, from the range, or from whether yaw follows the course.

use super::{Body, CONFIRMS, DECIDES, TimedTriple, unit};
use crate::column_groups::TableColumns;
use crate::compare::{self, Motion, Vertical};
use crate::found::Found;
use crate::windows::Trace;
use binding::AttitudeFrame;
use binding::from_euler;
use flight::{Clock, Unit};
use std::f64::consts::{FRAC_PI_2, TAU};

/// Values between rows farther apart are unknown, s.
const HOLE_S: f64 = 2.0;
/// A slower velocity has no course, m/s.
const SLOWEST: f64 = 2.0;
/// The mean of unit vectors is at least this long if nearly all point the same way.
const STEADY: f64 = 0.95;
/// Fewer rows with a course are not evaluated.
const FEWEST: usize = 20;

/// A velocity north, east, down in m/s.
pub(super) struct Flown {
    clock: Clock,
    trace: Trace<3>,
    has_down: bool,
}

/// The bound velocity, with its units and axes.
pub(super) fn flown(sources: &[TableColumns<'_>], motion: &Found<'_, Motion>) -> Option<Flown> {
    let source = sources.iter().find(|source| source.table.topic.name == motion.topic)?;
    let Motion { group, unit, angle, third, swapped, is_west, .. } = &motion.what;
    let columns = [Some(&group.first), Some(&group.second), group.third.as_ref()];
    let down = third.and_then(|(unit, side)| match side {
        Vertical::Down => Some((unit, 1.0)),
        Vertical::Up => Some((unit, -1.0)),
        Vertical::LeftOut => None,
    });
    let trace = compare::trace(source.table, &motion.timing.times_s, columns, |[a, b, c]| {
        let down = down.map_or(0.0, |(unit, sign)| sign * unit.to_si(c));
        let (first, second) = (unit.to_si(a), unit.to_si(b));
        match angle {
            Some(angle) => [first * angle.to_si(b).cos(), first * angle.to_si(b).sin(), down],
            None => {
                let (north, east) = if *swapped { (second, first) } else { (first, second) };
                [north, if *is_west { -east } else { east }, down]
            }
        }
    });
    Some(Flown { clock: motion.timing.clock, trace, has_down: down.is_some() })
}

/// A sense and a zero of yaw.
#[derive(Clone, Copy)]
struct YawSense {
    /// As named in a map; empty if maps have no frame for it.
    frame: &'static str,
    /// Yaw clockwise from north, from the yaw of the columns, rad.
    clockwise: fn(f64) -> f64,
    words: &'static str,
}

const YAW_SENSES: [YawSense; 4] = [
    YawSense { frame: "frd-ned", clockwise: |yaw| yaw, words: "clockwise from north" },
    YawSense { frame: "flu-enu", clockwise: |yaw| FRAC_PI_2 - yaw, words: "anticlockwise from east" },
    YawSense { frame: "", clockwise: |yaw| -yaw, words: "anticlockwise from north" },
    YawSense { frame: "", clockwise: |yaw| FRAC_PI_2 + yaw, words: "clockwise from east" },
];

/// A possible reading of the angles.
#[derive(Clone, Copy)]
struct Reading {
    unit: Unit,
    sense: YawSense,
}

/// The unit and the frame of three angles.
pub(super) fn decide(of: &TimedTriple<'_>, flown: Option<&Flown>) -> Result<Body, String> {
    let (units, why_unit) = units(of)?;
    let flown = flown.filter(|flown| flown.clock == of.timing.clock);
    let readings: Vec<Reading> =
        units.iter().flat_map(|unit| YAW_SENSES.map(|sense| Reading { unit: *unit, sense })).collect();
    let body = |unit, frame, why| Body {
        group: of.group.clone(),
        quantity: "attitude",
        roles: ["roll", "pitch", "yaw"],
        unit,
        frame,
        why,
    };
    let Some((best, reading)) = reading_by_course(of, &readings, flown)? else {
        check_no_offset(of, &readings, flown)?;
        return match units.as_slice() {
            [unit] => Ok(body(*unit, "frd-ned", vec![why_unit, UNCONFIRMED.to_owned()])),
            _ => Err("they may be in degrees or radians; nothing shows which".to_owned()),
        };
    };
    let course = format!(
        "{} agrees with the course of the velocity to {best:.3} if it counts {}",
        of.group.columns[2].path, reading.sense.words
    );
    let pitch = pitch_side(of, reading, flown)?;
    let why_unit = if units.len() > 1 { format!("{}, according to the course", reading.unit) } else { why_unit };
    Ok(body(reading.unit, reading.sense.frame, vec![why_unit, course, pitch]))
}

/// The reading in which yaw follows the course of the velocity, with the agreement; `None` if there is none.
///
/// # Errors
/// If two readings fit equally, or maps have no frame for the best one.
fn reading_by_course(
    of: &TimedTriple<'_>,
    readings: &[Reading],
    flown: Option<&Flown>,
) -> Result<Option<(f64, Reading)>, String> {
    let score =
        |reading: &Reading| Some((agreement(&of.trace(reading.unit), flown?, reading.sense.clockwise)?, *reading));
    let mut scored: Vec<(f64, Reading)> = readings.iter().filter_map(score).collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0));
    let Some((best, reading)) = scored.first().copied().filter(|(best, _)| *best >= CONFIRMS) else { return Ok(None) };
    if let Some((_, other)) = scored.iter().skip(1).find(|(other, _)| best - other < DECIDES) {
        return match other.unit == reading.unit {
            true => Err(format!(
                "the path is too straight to decide whether yaw counts {} or {}",
                reading.sense.words, other.sense.words
            )),
            false => Err(format!("they may be in {} or in {}", reading.unit, other.unit)),
        };
    }
    if reading.sense.frame.is_empty() {
        return Err(format!("yaw counts {}, and channel maps have no frame for this", reading.sense.words));
    }
    Ok(Some((best, reading)))
}

const UNCONFIRMED: &str = "nothing confirms the yaw: by the names alone it is assumed clockwise from north, pitch \
    positive nose up, roll positive right side down";

/// Possible units of the angles, with the reason.
fn units(of: &TimedTriple<'_>) -> Result<(Vec<Unit>, String), String> {
    if let Some(stated) = of.stated()? {
        let most = stated.to_si(of.largest());
        return match most <= TAU + 1e-3 {
            true => Ok((vec![stated], format!("the table states {stated}"))),
            false => Err(format!("they reach {most:.1} rad, if they are in {stated} as stated")),
        };
    }
    match of.largest() {
        most if most > 361.0 => Err(format!("they reach {most:.0}, more than a full circle in degrees")),
        most if most > TAU + 1e-3 => Ok((vec![unit("deg")?], "their range is that of deg".to_owned())),
        _ => Ok((vec![unit("deg")?, unit("rad")?], "tried as deg and rad".to_owned())),
    }
}

/// Yaw minus course where the velocity has a course, rad.
fn off_course(angles: &Trace<3>, flown: &Flown, clockwise: fn(f64) -> f64) -> Vec<f64> {
    let rows = angles.times_s.iter().zip(&angles.values).filter_map(|(t, [_, _, yaw])| {
        let [north, east, _] = flown.trace.at(*t, HOLE_S)?;
        (north.hypot(east) >= SLOWEST).then(|| clockwise(*yaw) - east.atan2(north))
    });
    rows.collect()
}

/// The mean cosine and sine of angles.
fn mean(angles: &[f64]) -> [f64; 2] {
    let count = angles.len().max(1) as f64;
    angles.iter().fold([0.0; 2], |[cos, sin], angle| [cos + angle.cos() / count, sin + angle.sin() / count])
}

/// The mean cosine between yaw and course, 1 if they are the same; `None` if too few rows have a course.
fn agreement(angles: &Trace<3>, flown: &Flown, clockwise: fn(f64) -> f64) -> Option<f64> {
    let off = off_course(angles, flown, clockwise);
    (off.len() >= FEWEST).then(|| mean(&off)[0])
}

/// Checks that yaw is not off a turning course by a constant angle.
///
/// # Errors
/// If it is, with the angle.
fn check_no_offset(of: &TimedTriple<'_>, readings: &[Reading], flown: Option<&Flown>) -> Result<(), String> {
    let Some(flown) = flown else { return Ok(()) };
    for reading in readings {
        let angles = of.trace(reading.unit);
        let off = off_course(&angles, flown, reading.sense.clockwise);
        let course: Vec<f64> = flown.trace.values.iter().map(|[north, east, _]| east.atan2(*north)).collect();
        let ([cos, sin], [a, b]) = (mean(&off), mean(&course));
        if off.len() >= FEWEST && cos.hypot(sin) >= STEADY && a.hypot(b) <= CONFIRMS {
            let degrees = sin.atan2(cos).to_degrees();
            return Err(format!(
                "{} stays {degrees:.0} degrees off the course of the velocity, if it counts {}",
                of.group.columns[2].path, reading.sense.words
            ));
        }
    }
    Ok(())
}

/// Checks that pitch has the sign of the frame when the vehicle climbs.
fn pitch_side(of: &TimedTriple<'_>, reading: Reading, flown: Option<&Flown>) -> Result<String, String> {
    let path = &of.group.columns[1].path;
    let unknown = || format!("the signs of {path} and {} are assumed from their names", of.group.columns[0].path);
    let Some(flown) = flown.filter(|flown| flown.has_down) else { return Ok(unknown()) };
    let angles = of.trace(reading.unit);
    let pairs = angles.times_s.iter().zip(&angles.values).filter_map(|(t, [_, pitch, _])| {
        let [north, east, down] = flown.trace.at(*t, HOLE_S)?;
        let speed = north.hypot(east);
        (speed >= SLOWEST).then(|| (*pitch, (-down).atan2(speed)))
    });
    let follows = correlation(&pairs.collect::<Vec<_>>());
    let expected = if reading.sense.frame == "flu-enu" { -1.0 } else { 1.0 };
    match follows * expected {
        agreed if agreed >= 0.5 => Ok(format!("{path} follows the climb to {:.2}", follows.abs())),
        agreed if agreed <= -0.5 => Err(format!(
            "{path} has the opposite sign of the frame {} that yaw follows: in a climb it goes {}",
            reading.sense.frame,
            if follows < 0.0 { "down" } else { "up" }
        )),
        _ => Ok(unknown()),
    }
}

fn correlation(pairs: &[(f64, f64)]) -> f64 {
    let count = pairs.len().max(1) as f64;
    let (a, b) = pairs.iter().fold((0.0, 0.0), |(a, b), pair| (a + pair.0 / count, b + pair.1 / count));
    let sums = pairs.iter().fold([0.0; 3], |[xy, xx, yy], (x, y)| {
        [xy + (x - a) * (y - b), xx + (x - a) * (x - a), yy + (y - b) * (y - b)]
    });
    sums[0] / (sums[1] * sums[2]).sqrt().max(f64::MIN_POSITIVE)
}

/// A decided attitude: the rotation from forward, right, down to north, east, down over time.
pub(super) struct Rotation {
    pub(super) clock: Clock,
    /// Name of the yaw column.
    pub(super) path: String,
    pub(super) quaternions: Trace<4>,
}

impl Rotation {
    pub(super) fn new(of: &TimedTriple<'_>, body: &Body) -> Rotation {
        let frame = if body.frame == "flu-enu" { AttitudeFrame::FluEnu } else { AttitudeFrame::FrdNed };
        let angles = of.trace(body.unit);
        let mut last = [0.0; 4];
        let rows = angles.times_s.iter().zip(&angles.values).map(|(t, angles)| {
            let q = from_euler(frame, *angles);
            // The opposite sign is the same attitude, and interpolation between both signs gives none.
            let same: f64 = q.iter().zip(last).map(|(a, b)| a * b).sum();
            last = if same < 0.0 { q.map(|v| -v) } else { q };
            (*t, last)
        });
        Rotation {
            clock: of.timing.clock,
            path: of.group.columns[2].path.clone(),
            quaternions: Trace::new(rows.collect()),
        }
    }
}
