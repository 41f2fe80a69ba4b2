//! UBX as written by a u-blox receiver: a position is a `NAV-POSLLH`, a velocity a `NAV-VELNED`; `NAV-TIMEGPS` gives
//! the week once per second.
//!
//! Resolution: 1e-7 deg, 1 mm, 1 cm/s, whole milliseconds. There is no truth.

use crate::simulated::SimulatedFlight;
use flight::{Stamp, WEEK_S, gps_of_unix};

const NAV: u8 = 0x01;

/// The flight as frames.
pub(super) fn write(flight: &SimulatedFlight) -> Vec<u8> {
    let mut frames = positions(flight);
    frames.extend(velocities(flight));
    frames.extend(weeks(flight));
    frames.sort_by_key(|(logged, _)| *logged);
    let mut bytes = frame(0x0a, 0x04, &version());
    frames.into_iter().for_each(|(_, frame)| bytes.extend(frame));
    bytes
}

/// `NAV-POSLLH` with the timestamps of the log.
fn positions(flight: &SimulatedFlight) -> Vec<(Stamp, Vec<u8>)> {
    let mut frames = vec![];
    let position = &flight.position;
    for ((measured, logged), [latitude, longitude, height]) in
        position.measured.iter().zip(&position.logged).zip(&position.geodetic_deg)
    {
        let whole = |value: f64, scale: f64| ((value * scale).round() as i32).to_le_bytes();
        let place = [whole(*longitude, 1e7), whole(*latitude, 1e7), whole(*height, 1e3), whole(height - 47.0, 1e3)];
        let accuracy = [1500_u32, 2500].map(u32::to_le_bytes);
        let payload = [&time_of_week(*measured).1[..], &place.concat(), &accuracy.concat()].concat();
        frames.push((*logged, frame(NAV, 0x02, &payload)));
    }
    frames
}

/// `NAV-VELNED` with the timestamps of the log.
fn velocities(flight: &SimulatedFlight) -> Vec<(Stamp, Vec<u8>)> {
    let mut frames = vec![];
    let velocity = &flight.velocity;
    for ((measured, logged), ned) in velocity.measured.iter().zip(&velocity.logged).zip(&velocity.ned) {
        let whole = |value: f64| ((value * 1e2).round() as i32).to_le_bytes();
        let (speed, ground) = (ned.iter().map(|v| v * v).sum::<f64>().sqrt(), ned[0].hypot(ned[1]));
        let heading = ((ned[1].atan2(ned[0]).to_degrees() * 1e5).round() as i32).to_le_bytes();
        let accuracy = [20_u32, 50_000].map(u32::to_le_bytes);
        let speeds = [whole(speed), whole(ground), heading].concat();
        let payload = [&time_of_week(*measured).1[..], &ned.map(whole).concat(), &speeds, &accuracy.concat()].concat();
        frames.push((*logged, frame(NAV, 0x12, &payload)));
    }
    frames
}

/// `NAV-TIMEGPS`, just before each full second.
fn weeks(flight: &SimulatedFlight) -> impl Iterator<Item = (Stamp, Vec<u8>)> {
    (0..flight.settings.duration_s.ceil() as u32).map(|second| {
        let stamp = flight.settings.start.plus_seconds(f64::from(second) - 0.0005);
        let (week, in_week) = time_of_week(stamp);
        let payload = [&in_week[..], &[0; 4], &week.to_le_bytes(), &[18, 7], &[20, 0, 0, 0]].concat();
        (stamp, frame(NAV, 0x20, &payload))
    })
}

/// `MON-VER`.
fn version() -> Vec<u8> {
    let field = |text: &str, size: usize| {
        let mut field = text.as_bytes().to_vec();
        field.resize(size, 0);
        field
    };
    [field("SIM CORE 1.00", 30), field("00080000", 10), field("MOD=SIMULATED", 30)].concat()
}

/// GPS week, and milliseconds within it.
fn time_of_week(stamp: Stamp) -> (i16, [u8; 4]) {
    const WEEK_MS: i64 = WEEK_S * 1000;
    let ms = gps_of_unix(stamp).map_or(0, |gps| (gps.0 + 500_000).div_euclid(1_000_000));
    (ms.div_euclid(WEEK_MS) as i16, (ms.rem_euclid(WEEK_MS) as u32).to_le_bytes())
}

/// Sync, class, number, length, payload and 8-bit Fletcher checksum.
fn frame(class: u8, number: u8, payload: &[u8]) -> Vec<u8> {
    let body = [&[class, number][..], &(payload.len() as u16).to_le_bytes(), payload].concat();
    let sum = |[a, b]: [u8; 2], byte: &u8| [a.wrapping_add(*byte), b.wrapping_add(a.wrapping_add(*byte))];
    let checksum = body.iter().fold([0_u8; 2], sum);
    [&[0xb5, 0x62], &body[..], &checksum].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_matches_the_manual() {
        assert_eq!(frame(0x06, 0x08, &[]), [0xb5, 0x62, 0x06, 0x08, 0, 0, 0x0e, 0x30]);
    }
}
