//! Fingerprint of a flight in a few bytes: equal for the same flight in another container, or under another name.

use flight::{Channel, Flight, Quantity, Stamp};
use record::{DuplicateFlight, FlightContent};
use std::collections::BTreeMap;

/// Rows sampled in addition to the first and the last: enough that no two flights agree in all of them.
const SAMPLED: usize = 256;
/// Number of hashes in a sketch.
const SKETCH: usize = 64;
/// Number of fixes in a stretch.
const STRETCH: usize = 4;
/// Changes of place among the sampled rows that identify a flight without its date.
const LEAST_MOVES: usize = 4;
/// Step of latitude and longitude, rad: 1e-7 degrees, the resolution of receivers.
const ANGLE_STEP: f64 = 1e-7 * std::f64::consts::PI / 180.0;
/// Step of other values: one millimetre.
const LENGTH_STEP_M: f64 = 1e-3;
/// Step of times after the first fix, ns: one millisecond.
const TIME_STEP_NS: i64 = 1_000_000;

/// A hash of the position's updates: their number, and for some of them including first and last, the horizontal place
/// and the time after the first. `None` if the flight has no such channel, or no row in it.
///
/// Clock epoch, container, names and other channels are not part of it. Heights are not either, because a container may
/// hold another kind of height.
///
/// A log that hardly moves looks like every other log from the same place. Its hash includes the UTC of its first
/// update; if that is unknown, there is no hash.
#[must_use]
pub fn fingerprint(flight: &Flight, position_channel: &str) -> Option<String> {
    let channel = flight.channels.get(position_channel)?;
    let rows = channel.update_rows();
    let (first, last) = (*rows.first()?, *rows.last()?);
    let stamps = channel.series.timeline().stamps();
    let begin = stamps.get(first)?.0;
    let mut hasher = blake3::Hasher::new();
    hasher.update(&(rows.len() as u64).to_le_bytes());
    let step = rows.len().div_ceil(SAMPLED).max(1);
    let (mut moves, mut before) = (0, horizontal(channel, first));
    for row in rows.iter().copied().step_by(step).chain([last]) {
        let after_ns = stamps.get(row)?.0.saturating_sub(begin);
        hasher.update(&rounded_ms(after_ns).to_le_bytes());
        let place = horizontal(channel, row);
        for count in place {
            hasher.update(&count.to_le_bytes());
        }
        moves += usize::from(place != before);
        before = place;
    }
    if moves < LEAST_MOVES {
        let utc = flight.unix(channel.series.timeline().clock(), Stamp(begin))?;
        hasher.update(&rounded_ms(utc.0).to_le_bytes());
    }
    Some(hasher.finalize().to_hex().to_string())
}

/// Rounds to the nearest step; ties go to the later one.
fn rounded_ms(after_ns: i64) -> i64 {
    after_ns.saturating_add(TIME_STEP_NS / 2).div_euclid(TIME_STEP_NS)
}

/// The first two components in steps that every container preserves.
fn horizontal(channel: &Channel, row: usize) -> [i64; 2] {
    let step = if channel.quantity == Quantity::PositionGeodetic { ANGLE_STEP } else { LENGTH_STEP_M };
    let value = |axis: usize| channel.series.components().get(axis).and_then(|values| values.get(row));
    [0, 1].map(|axis| value(axis).map_or(0, |value| (value / step).round() as i64))
}

/// Fingerprint and sketch of a flight's position. `None` as for [`fingerprint`].
#[must_use]
pub fn content_of(flight: &Flight, position_channel: &str) -> Option<FlightContent> {
    let fingerprint = fingerprint(flight, position_channel)?;
    let channel = flight.channels.get(position_channel)?;
    let rows = channel.update_rows();
    let mut sketch: Vec<u64> = rows.windows(STRETCH).filter_map(|stretch| hash_of(channel, stretch)).collect();
    sketch.sort_unstable();
    sketch.dedup();
    sketch.truncate(SKETCH);
    Some(FlightContent { fingerprint, fixes: rows.len() as u64, sketch })
}

/// Hash of a stretch of fixes: places, and the times between. `None` without motion, where all flights look alike.
fn hash_of(channel: &Channel, stretch: &[usize]) -> Option<u64> {
    let stamps = channel.series.timeline().stamps();
    let begin = stamps.get(*stretch.first()?)?.0;
    let places: Vec<[i64; 2]> = stretch.iter().map(|row| horizontal(channel, *row)).collect();
    if places.windows(2).any(|pair| pair.first() == pair.last()) {
        return None;
    }
    let mut hasher = blake3::Hasher::new();
    for (row, place) in stretch.iter().zip(&places) {
        hasher.update(&rounded_ms(stamps.get(*row)?.0.saturating_sub(begin)).to_le_bytes());
        for count in place {
            hasher.update(&count.to_le_bytes());
        }
    }
    Some(u64::from_le_bytes(*hasher.finalize().as_bytes().first_chunk()?))
}

/// Share of the stretches of the shorter flight that are also in the other, 0 to 1.
#[must_use]
pub fn shared_content(a: &FlightContent, b: &FlightContent) -> f64 {
    // A full sketch is complete only below its largest hash.
    let known_to = |content: &FlightContent| {
        if content.sketch.len() < SKETCH { u64::MAX } else { content.sketch.last().copied().unwrap_or(0) }
    };
    let end = known_to(a).min(known_to(b));
    let known = |content: &FlightContent| content.sketch.partition_point(|hash| *hash <= end);
    let least = known(a).min(known(b));
    let shared = a.sketch.iter().take(known(a)).filter(|hash| b.sketch.binary_search(hash).is_ok()).count();
    if least == 0 { 0.0 } else { shared as f64 / least as f64 }
}

/// Flights that occur more than once, under other names or in other containers, whole or in part. The one with the most
/// fixes counts, and of several the first. A flight without content is not a duplicate.
#[must_use]
pub fn duplicates<Id: AsRef<str>>(flights: &[(Id, Option<FlightContent>)]) -> Vec<DuplicateFlight> {
    let mut known: Vec<(&str, &FlightContent)> =
        flights.iter().filter_map(|(id, content)| Some((id.as_ref(), content.as_ref()?))).collect();
    known.sort_by_key(|(_, content)| std::cmp::Reverse(content.fixes));
    let mut by_print: BTreeMap<&str, usize> = BTreeMap::new();
    let mut by_hash: BTreeMap<u64, usize> = BTreeMap::new();
    let mut found: BTreeMap<usize, Vec<String>> = BTreeMap::new();
    for (number, (id, content)) in known.iter().enumerate() {
        let mut candidates = content.sketch.iter().filter_map(|hash| by_hash.get(hash)).copied();
        let same = by_print.get(content.fingerprint.as_str()).copied();
        let of = same
            .or_else(|| candidates.find(|other| known.get(*other).is_some_and(|(_, whole)| is_part(content, whole))));
        match of {
            Some(whole) => found.entry(whole).or_default().push((*id).to_owned()),
            None => {
                by_print.entry(&content.fingerprint).or_insert(number);
                for hash in &content.sketch {
                    by_hash.entry(*hash).or_insert(number);
                }
            }
        }
    }
    let listed = |(whole, mut duplicates): (usize, Vec<String>)| {
        duplicates.sort();
        Some(DuplicateFlight { counts: known.get(whole)?.0.to_owned(), duplicates })
    };
    let mut found: Vec<DuplicateFlight> = found.into_iter().filter_map(listed).collect();
    found.sort_by(|a, b| a.counts.cmp(&b.counts));
    found
}

/// Whether a flight is part of the other. Copies with holes also have some different stretches, across the holes.
fn is_part(part: &FlightContent, whole: &FlightContent) -> bool {
    shared_content(part, whole) >= 0.5
}
