//! The two channels of a pair in seconds and metres: local north and east, held rows skipped.

use super::pairs::{Pair, Second};
use crate::horizontal::Horizontal;
use crate::thin::{Averaged, thinned_rows};
use flight::{Channel, Clock, Code, Flight, Geodetic, LocalFrame, Notices, Quantity, Stamp};
use nalgebra::Vector3;
use record::DelayOrigin;

/// Fixes farther than this from the median fix are not part of the flight, m.
const FARTHEST_M: f64 = 1e6;
/// With fewer samples of either channel no measurement is tried.
pub(crate) const LEAST_SAMPLES: usize = 20;

/// A pair ready to be split into pieces.
pub(crate) struct Prepared {
    pub(crate) origin: DelayOrigin,
    /// The measured channel.
    pub(crate) first: Horizontal,
    /// A rate to be integrated, or a track.
    pub(crate) second: Horizontal,
    /// Whether the second is a rate.
    pub(crate) integrate: bool,
    /// North and east of each body axis at the samples of the second: directions of an accelerometer bias.
    pub(crate) body: Option<BodyAxes>,
    /// Ground speed over time, m/s, if a velocity or a track provides it.
    pub(crate) speed: (Vec<f64>, Vec<f64>),
    /// One in this many samples of the first is used.
    pub(crate) one_in: usize,
    /// Standard uncertainty of a delay due to shared timestamps, s. Each channel counts as measured anywhere within a
    /// step before or after its timestamp (JCGM 100:2008, 4.3.7) where several rows shared one.
    pub(crate) stamps_s: f64,
}

/// Limits on the number of samples for a pair.
#[derive(Clone, Copy)]
pub(crate) struct Most {
    /// For the first channel, and its limit per second.
    pub(crate) of_first: (usize, f64),
    /// For the second channel.
    pub(crate) of_second: usize,
}

/// Body axes forward, right and down, each with its north and its east component.
pub(crate) type BodyAxes = [[Vec<f64>; 2]; 3];

/// Name of the samples of a channel.
fn counted(quantity: Quantity, rows: usize) -> &'static str {
    let of_position = matches!(quantity, Quantity::PositionGeodetic | Quantity::PositionNed);
    match (of_position, rows) {
        (true, 1) => "fix",
        (true, _) => "fixes",
        (false, 1) => "measurement",
        (false, _) => "measurements",
    }
}

fn channel_of<'a>(flight: &'a Flight, name: &str) -> Result<&'a Channel, String> {
    flight.channels.get(name).ok_or_else(|| format!("no channel {name}"))
}

/// Reads the channels of `pair`, up to the given numbers of samples; or returns in words why that is impossible.
pub(crate) fn prepare(flight: &Flight, pair: &Pair, most: Most, notices: &mut Notices) -> Result<Prepared, String> {
    let first = channel_of(flight, &pair.first)?;
    let second = channel_of(flight, pair.second.channels()[0])?;
    let stamps_s = stamps_s(flight, pair)?;
    let stamp = |c: &Channel| c.series.timeline().first().unwrap_or(Stamp(0));
    let origin = stamp(first).min(stamp(second));
    let place = match (first.quantity, second.quantity) {
        (Quantity::PositionGeodetic, _) => Some(first),
        (_, Quantity::PositionGeodetic) => Some(second),
        _ => None,
    };
    let frame = place.map(|p| LocalFrame::new(median_fix(p)));
    let axes = Axes { origin, frame: frame.as_ref() };
    let (rows, one_in) = thinned_rows(first, most.of_first, &pair.first, notices);
    let out = Averaged::none(rows.len());
    let first_local = located((first, &pair.first), rows.into_iter(), &axes, out, notices);
    let (second_local, body) = second_of(flight, pair, &axes, most.of_second, notices)?;
    let speed = speed_of(pair, &first_local, &second_local);
    Ok(Prepared {
        origin: DelayOrigin { origin_ns: origin.0, clock: first.series.timeline().clock() },
        first: first_local,
        second: second_local,
        integrate: matches!(pair.second, Second::Velocity(_) | Second::Acceleration(_)),
        body,
        speed,
        one_in,
        stamps_s,
    })
}

/// Standard uncertainty of the timestamps of all channels of the pair, s, if these can be compared.
fn stamps_s(flight: &Flight, pair: &Pair) -> Result<f64, String> {
    let clock = channel_of(flight, &pair.first)?.series.timeline().clock();
    let mut stamps_s = 0_f64;
    for name in std::iter::once(pair.first.as_str()).chain(pair.second.channels()) {
        let channel = channel_of(flight, name)?;
        check(channel, name, &pair.first, clock)?;
        stamps_s = stamps_s.hypot(channel.series.timeline().shared_step_s() / 3_f64.sqrt());
    }
    Ok(stamps_s)
}

/// The second channel, with about `most` samples; for an acceleration with the body axes.
fn second_of(
    flight: &Flight,
    pair: &Pair,
    axes: &Axes<'_>,
    most: usize,
    notices: &mut Notices,
) -> Result<(Horizontal, Option<BodyAxes>), String> {
    let name = pair.second.channels()[0];
    let second = channel_of(flight, name)?;
    let averaged = |notices: &mut Notices| Averaged::new((second, name), most, "the delay", notices);
    Ok(match &pair.second {
        Second::Position(_) | Second::Rate(_) => {
            let out = averaged(notices);
            (located((second, name), second.updates(), axes, out, notices), None)
        }
        Second::Velocity(_) => (in_frame_axes(second, channel_of(flight, &pair.first)?, axes, averaged(notices)), None),
        Second::Acceleration(of) => {
            let out = Averaged::new((second, name), most, "the delay", notices);
            let attitude = (channel_of(flight, &of.attitude)?, of.attitude_late_s.unwrap_or(0.0));
            let (force, body) = rotated(second, attitude, axes.origin, out);
            (force, Some(body))
        }
    })
}

/// Rejects a channel on another clock than the first one, a short one, and one without its first two components.
fn check(channel: &Channel, name: &str, first: &str, clock: Clock) -> Result<(), String> {
    let other = channel.series.timeline().clock();
    if other != clock {
        return Err(format!(
            "{first} has timestamps of the clock {clock}, {name} of {other}: the relation of the two clocks is unknown; log both with one clock"
        ));
    }
    let rows = channel.update_count();
    if rows < LEAST_SAMPLES {
        let what = counted(channel.quantity, rows);
        return Err(format!("{name} has {rows} {what}; at least {LEAST_SAMPLES} are needed: log a longer flight"));
    }
    if channel.quantity != Quantity::Attitude && channel.present.iter().take(2).any(|present| !present) {
        return Err(format!("{name} lacks one of its first two components"));
    }
    Ok(())
}

/// The fix with the median latitude: a real fix, unaffected by outliers.
fn median_fix(channel: &Channel) -> Geodetic {
    let mut rows = channel.update_rows();
    let latitude = channel.series.component(0);
    let middle = rows.len() / 2;
    let by_latitude = |a: &usize, b: &usize| latitude[*a].total_cmp(&latitude[*b]).then(a.cmp(b));
    let (_, row, _) = rows.select_nth_unstable_by(middle, by_latitude);
    geodetic(channel, *row)
}

fn geodetic(channel: &Channel, row: usize) -> Geodetic {
    let at = |k: usize| channel.series.component(k)[row];
    Geodetic { latitude: at(0), longitude: at(1), height: if channel.present[2] { at(2) } else { 0.0 } }
}

/// Origin in place and time.
struct Axes<'a> {
    origin: Stamp,
    frame: Option<&'a LocalFrame>,
}

/// The first two components of these rows; for a geodetic position north and east, m.
fn located(
    (channel, name): (&Channel, &str),
    rows: impl Iterator<Item = usize>,
    axes: &Axes<'_>,
    mut out: Averaged<2>,
    notices: &mut Notices,
) -> Horizontal {
    let frame = axes.frame.filter(|_| channel.quantity == Quantity::PositionGeodetic);
    let stamps = channel.series.timeline().stamps();
    let component = |k: usize| channel.series.component(k);
    let mut far = 0;
    for row in rows {
        let t = stamps[row].seconds_since(axes.origin);
        let Some(frame) = frame else {
            out.push(t, [component(0)[row], component(1)[row]]);
            continue;
        };
        let ned = frame.to_ned(geodetic(channel, row));
        if ned.iter().any(|x| x.abs() > FARTHEST_M) {
            far += 1;
            continue;
        }
        out.push(t, [ned[0], ned[1]]);
    }
    if far > 0 {
        let fixes = if far == 1 { "fix" } else { "fixes" };
        let text = format!("{far} {fixes} dropped: more than {:.0} km from the median fix", FARTHEST_M / 1e3);
        notices.push(Code::SamplesLeftOut, name, far, text);
    }
    out.horizontal()
}

/// A velocity in the axes of the frame, so that its integral is a difference of local positions. It is rotated at the
/// newest fix of `position` that is part of the flight.
fn in_frame_axes(velocity: &Channel, position: &Channel, axes: &Axes<'_>, mut out: Averaged<2>) -> Horizontal {
    let frame = axes.frame.filter(|_| position.quantity == Quantity::PositionGeodetic);
    let place = |row: usize| (position.series.timeline().stamps()[row], geodetic(position, row));
    let is_of_flight = |frame: &LocalFrame, place| frame.to_ned(place).iter().all(|x| x.abs() <= FARTHEST_M);
    let mut fixes = position
        .updates()
        .take_while(|_| frame.is_some())
        .map(place)
        .filter(|(_, place)| frame.is_some_and(|frame| is_of_flight(frame, *place)))
        .peekable();
    let rotation_at = |(_, place): (Stamp, Geodetic)| Some(frame?.rotation_from(place));
    let mut rotation = fixes.next().and_then(rotation_at);
    let stamps = velocity.series.timeline().stamps();
    for row in velocity.updates() {
        let mut newest = None;
        while let Some(fix) = fixes.next_if(|(stamp, _)| *stamp <= stamps[row]) {
            newest = Some(fix);
        }
        rotation = newest.and_then(rotation_at).or(rotation);
        let own = [0, 1, 2].map(|k| velocity.series.component(k)[row]);
        let ned = rotation.map_or(own, |rotation| (rotation * Vector3::from(own)).into());
        out.push(stamps[row].seconds_since(axes.origin), [ned[0], ned[1]]);
    }
    out.horizontal()
}

/// Specific force in north and east, which gravity does not affect. Attitude is interpolated between its samples; without
/// attitude there is no acceleration. If the attitude is later than the gyro (`late_s`), it is shifted; if it is earlier,
/// the force is late and shifted.
fn rotated(
    force: &Channel,
    (attitude, late_s): (&Channel, f64),
    origin: Stamp,
    mut out: Averaged<8>,
) -> (Horizontal, BodyAxes) {
    let shifted = |channel: &Channel, late_s: f64| -> Vec<Stamp> {
        let late_ns = (1e9 * late_s).round() as i64;
        channel.series.timeline().stamps().iter().map(|t| Stamp(t.0 - late_ns)).collect()
    };
    let turns = shifted(attitude, late_s.max(0.0));
    let stamps = shifted(force, (-late_s).max(0.0));
    let mut known = attitude.updates().peekable();
    let mut before = None;
    for row in force.updates() {
        while let Some(turn) = known.next_if(|turn| turns[*turn] <= stamps[row]) {
            before = Some(turn);
        }
        let (Some(before), Some(&after)) = (before, known.peek()) else { continue };
        let share = stamps[row].seconds_since(turns[before]) / turns[after].seconds_since(turns[before]);
        let Some(q) = between(quaternion(attitude, before), quaternion(attitude, after), share) else { continue };
        let ned = turn(q, [0, 1, 2].map(|k| force.series.component(k)[row]));
        let along = |axis: usize| turn(q, std::array::from_fn(|k| if k == axis { 1.0 } else { 0.0 }));
        let [forward, right, down] = [along(0), along(1), along(2)];
        let values = [ned[0], ned[1], forward[0], forward[1], right[0], right[1], down[0], down[1]];
        out.push(stamps[row].seconds_since(origin), values);
    }
    let (t, [north, east, a, b, c, d, e, f]) = out.finish();
    (Horizontal { t, axes: [north, east] }, [[a, b], [c, d], [e, f]])
}

type Quaternion = [f64; 4];

pub(crate) fn quaternion(channel: &Channel, row: usize) -> Quaternion {
    [0, 1, 2, 3].map(|k| channel.series.component(k)[row])
}

/// Interpolated on the short arc from `a` to `b`; `None` if that is not a rotation.
fn between(a: Quaternion, b: Quaternion, share: f64) -> Option<Quaternion> {
    let sign = if (0..4).map(|k| a[k] * b[k]).sum::<f64>() < 0.0 { -1.0 } else { 1.0 };
    let q: Quaternion = std::array::from_fn(|k| (1.0 - share) * a[k] + share * sign * b[k]);
    let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
    (length > 1e-6).then(|| q.map(|x| x / length))
}

/// v + 2 q × (q × v + w v).
fn turn([w, x, y, z]: Quaternion, v: [f64; 3]) -> [f64; 3] {
    let cross =
        |a: [f64; 3], b: [f64; 3]| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let q = [x, y, z];
    let inner = cross(q, v);
    let outer = cross(q, [0, 1, 2].map(|k| inner[k] + w * v[k]));
    [0, 1, 2].map(|k| v[k] + 2.0 * outer[k])
}

/// Ground speed from the channel that provides it: a velocity, or the track's steps.
fn speed_of(pair: &Pair, first: &Horizontal, second: &Horizontal) -> (Vec<f64>, Vec<f64>) {
    let of = |v: &Horizontal| (v.t.clone(), v.axes[0].iter().zip(&v.axes[1]).map(|(n, e)| n.hypot(*e)).collect());
    match &pair.second {
        Second::Velocity(_) | Second::Rate(_) => of(second),
        Second::Acceleration(_) => of(first),
        Second::Position(_) => steps(second),
    }
}

/// Speed over at least two seconds, so that noise does not look like motion.
fn steps(track: &Horizontal) -> (Vec<f64>, Vec<f64>) {
    const BASE_S: f64 = 2.0;
    let mut before = 0;
    let mut out = (vec![], vec![]);
    for now in 1..track.t.len() {
        while before + 1 < now && track.t[now] - track.t[before + 1] >= BASE_S {
            before += 1;
        }
        let h = track.t[now] - track.t[before];
        if h >= BASE_S {
            let moved = (track.axes[0][now] - track.axes[0][before]).hypot(track.axes[1][now] - track.axes[1][before]);
            out.0.push(track.t[now]);
            out.1.push(moved / h);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quarter_turn_to_the_right_takes_forward_to_east() {
        let half = std::f64::consts::FRAC_PI_4;
        let east = turn([half.cos(), 0.0, 0.0, half.sin()], [2.0, 0.0, 0.0]);
        assert!(east[0].abs() < 1e-15 && (east[1] - 2.0).abs() < 1e-15);
    }

    #[test]
    fn a_quaternion_and_its_negative_are_the_same_attitude() {
        let q = [0.8, 0.0, 0.6, 0.0];
        let middle = between(q, q.map(|x| -x), 0.5).unwrap();
        assert!((0..4).all(|k| (middle[k] - q[k]).abs() < 1e-15));
    }
}
