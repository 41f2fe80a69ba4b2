//! The swings of a record, from its magnetometer's point of view.

use super::MagneticSwing;
use super::azimuths::{degrees, differ};
use crate::alignment::{Alignment, align};
use crate::motion::Motion;
use crate::rig::Rig;
use crate::sensor_rows::{sensor_rows, update_samples};
use crate::surroundings::Surroundings;
use flight::{Channel, Code, Flight, Notices, Quantity, Series, Timeline};
use signal::static_segments;

/// Minimum number of rows of a swing.
const LEAST_ROWS: usize = 50;
/// A bench is not turned in less time, s.
const LEAST_REST_S: f64 = 2.0;
/// A part of a swing shorter than this does not determine an azimuth, s.
const LEAST_SWING_S: f64 = 10.0;
/// Counts per second below which the bar is at rest.
const STILL_COUNTS_PER_S: f64 = 2.0;

/// The first magnetometer of `sensor` over its swings: one, or more if the bench was turned while the bar rested.
///
/// The azimuth is inferred only from north and east of positions and velocities; a record without them has one swing,
/// at the azimuth of the rig file. `motion` is oriented by `alignment`; timestamps are in the encoder's clock.
pub(crate) fn magnetic_swings(
    sensor: &Flight,
    motion: &Motion,
    rig: &Rig,
    around: &Surroundings,
    alignment: &Alignment,
) -> (Vec<MagneticSwing>, Notices) {
    let mut notices = Notices::new();
    let parts = parts(sensor, motion, rig, around);
    let turned = parts.windows(2).any(|pair| differ(pair[0].azimuth, pair[1].azimuth));
    let swings = if turned {
        notices.push(Code::RecordSplit, "", parts.len() as u64, in_words(&parts));
        parts.iter().filter_map(|p| first_swing(&p.sensor, motion, rig, &p.alignment)).collect()
    } else {
        first_swing(sensor, motion, rig, alignment).into_iter().collect()
    };
    (swings, notices)
}

fn first_swing(sensor: &Flight, motion: &Motion, rig: &Rig, alignment: &Alignment) -> Option<MagneticSwing> {
    sensor.channels.iter().find_map(|(name, channel)| MagneticSwing::of(name, channel, motion, rig, alignment))
}

/// Notice for a record whose channels are all compared at one azimuth.
fn in_words(parts: &[Part]) -> String {
    let one = |p: &Part| format!("{} from {:.0} to {:.0} s", degrees(p.azimuth), p.from_s, p.to_s);
    let all: Vec<String> = parts.iter().map(one).collect();
    format!(
        "the bench was turned within the record: {}. The magnetometer's hard and soft iron are fitted swing by swing; \
         every other number assumes one azimuth, so cut the log there and measure the parts separately",
        all.join(", ")
    )
}

/// A part of the swing between rests.
struct Part {
    from_s: f64,
    to_s: f64,
    azimuth: f64,
    sensor: Flight,
    alignment: Alignment,
}

/// The parts between rests whose azimuth can be determined.
fn parts(sensor: &Flight, motion: &Motion, rig: &Rig, around: &Surroundings) -> Vec<Part> {
    let raw = motion.clone().oriented(1.0, 0.0);
    let mut open = rig.clone();
    open.bar.azimuth_rad = None;
    let part = |(from_s, to_s): (f64, f64)| {
        let sensor = cut(sensor, motion, from_s, to_s);
        let alignment = align(&raw, &sensor, &open, around);
        let by_heading = |name: &str| sensor.channels.get(name).is_some_and(|c| c.quantity == Quantity::Attitude);
        // The heading of an attitude filter is affected by the very iron to be determined.
        let shown = alignment.azimuths.iter().filter(|(name, _)| !by_heading(name));
        let u = |e: &record::Estimate| e.standard_uncertainty.unwrap_or(f64::INFINITY);
        let (_, azimuth) = shown.min_by(|a, b| u(&a.1).total_cmp(&u(&b.1)))?;
        let azimuth = *azimuth;
        let alignment = Alignment { azimuth_rad: Some(azimuth), ..alignment };
        Some(Part { from_s, to_s, azimuth: azimuth.value, sensor, alignment })
    };
    let stretches = stretches(motion);
    // The usual record has one, without anything to compare.
    if stretches.len() < 2 { vec![] } else { stretches.into_iter().filter_map(part).collect() }
}

/// Sufficiently long periods of motion between rests, s after the origin.
fn stretches(motion: &Motion) -> Vec<(f64, f64)> {
    let (t, rate): (Vec<f64>, Vec<f64>) = motion.states().map(|(t, state)| (t, state.rate)).unzip();
    let still = STILL_COUNTS_PER_S * motion.encoder().lsb_rad();
    let rests = static_segments(&t, &rate, still, LEAST_REST_S);
    let (first, last) = motion.span();
    let starts = std::iter::once(first).chain(rests.iter().map(|rows| t[rows.end - 1]));
    let ends = rests.iter().map(|rows| t[rows.start]).chain([last]);
    starts.zip(ends).filter(|(from, to)| to - from >= LEAST_SWING_S).collect()
}

/// The channels' data within a part.
fn cut(sensor: &Flight, motion: &Motion, from_s: f64, to_s: f64) -> Flight {
    let (from, to) = (motion.origin().plus_seconds(from_s), motion.origin().plus_seconds(to_s));
    let part = |channel: &Channel| {
        let timeline = channel.series.timeline();
        let stamps = timeline.stamps();
        let rows = stamps.partition_point(|s| *s < from)..stamps.partition_point(|s| *s < to);
        let columns = channel.series.components().iter().map(|c| c[rows.clone()].to_vec()).collect();
        let timeline = Timeline::new(timeline.kind(), timeline.clock(), stamps[rows.clone()].to_vec()).ok()?;
        Some(Channel {
            series: Series::new(timeline, columns).ok()?,
            held: channel.held[rows].to_vec(),
            other_stamps: vec![],
            quantity: channel.quantity,
            present: channel.present.clone(),
            source: channel.source.clone(),
        })
    };
    let channels = sensor.channels.iter().filter_map(|(name, channel)| Some((name.clone(), part(channel)?)));
    Flight { channels: channels.filter(|(_, c)| !c.series.is_empty()).collect(), ..Flight::default() }
}

impl MagneticSwing {
    /// The channel `name` over one swing, with its delay removed. `None` if it is not a magnetometer with three axes,
    /// has no usable data of the swing, or the azimuth is unknown.
    fn of(name: &str, channel: &Channel, motion: &Motion, rig: &Rig, alignment: &Alignment) -> Option<MagneticSwing> {
        if !matches!(channel.quantity, Quantity::MagneticField | Quantity::MagneticDirection) {
            return None;
        }
        let delay_s = *alignment.coarse_delay_s.get(name)?;
        let samples = update_samples(channel, &sensor_rows(name, channel, rig)?, motion.origin());
        let [x, y, z] = &samples.components[..] else { return None };
        let (rows, angle_rad): (Vec<usize>, Vec<f64>) =
            samples.t.iter().enumerate().filter_map(|(row, t)| Some((row, motion.seen_at(t - delay_s)?.angle))).unzip();
        let taken = |column: &[f64]| rows.iter().map(|&row| column[row]).collect();
        (rows.len() >= LEAST_ROWS).then_some(MagneticSwing {
            channel: name.to_owned(),
            azimuth: alignment.azimuth_rad?,
            angle_rad,
            field: [taken(x), taken(y), taken(z)],
            is_tesla: channel.quantity == Quantity::MagneticField,
        })
    }
}
