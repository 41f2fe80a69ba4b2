//! MAVLink telemetry as written by a ground station: a position is a `GPS_RAW_INT`, a velocity a `LOCAL_POSITION_NED`
//! whose position is the truth, the truth a `HIL_STATE_QUATERNION`.
//!
//! Resolution: 1e-7 deg, 1 mm, single precision, whole milliseconds for velocities and microseconds for positions since
//! boot. MAVLink 2, with trailing zeros of a payload omitted; every other velocity is signed.

use crate::samples::Samples;
use crate::simulated::SimulatedFlight;
use flight::{Geodetic, LocalFrame, Stamp};

/// Time since boot at the start of the flight, µs.
const BOOT_US: i64 = 60_000_000;

/// A message type: number, and the extra byte for the checksum that represents its layout (CRC_EXTRA).
type Kind = (u32, u8);
const HEARTBEAT: Kind = (0, 50);
const SYSTEM_TIME: Kind = (2, 137);
const PARAM_VALUE: Kind = (22, 220);
const GPS_RAW_INT: Kind = (24, 24);
const LOCAL_POSITION_NED: Kind = (32, 185);
const HIL_STATE_QUATERNION: Kind = (115, 4);
const STATUSTEXT: Kind = (253, 83);

/// A frame before encoding, and its arrival at the ground station.
struct Message {
    logged: Stamp,
    kind: Kind,
    payload: Vec<u8>,
    signed: bool,
}

/// The flight as frames with their times.
pub(super) fn write(flight: &SimulatedFlight) -> Vec<u8> {
    let mut messages = vec![];
    fixes(flight, &mut messages);
    velocities(flight, &mut messages);
    truths(flight, &mut messages);
    beats(flight, &mut messages);
    messages.sort_by_key(|message| message.logged);
    let mut all = introduction(flight);
    all.extend(messages);
    let frame = |(sequence, message): (usize, Message)| message.frame(sequence as u8);
    all.into_iter().enumerate().flat_map(frame).collect()
}

fn plain(logged: Stamp, kind: Kind, payload: Vec<u8>) -> Message {
    Message { logged, kind, payload, signed: false }
}

fn rows(samples: &Samples) -> impl Iterator<Item = (Stamp, Stamp, usize)> {
    samples.measured.iter().zip(&samples.logged).enumerate().map(|(row, (measured, logged))| (*measured, *logged, row))
}

fn place([latitude, longitude, height]: [f64; 3]) -> Vec<u8> {
    let scaled = [latitude * 1e7, longitude * 1e7, height * 1e3];
    scaled.map(|value| (value.round() as i32).to_le_bytes()).concat()
}

fn fixes(flight: &SimulatedFlight, messages: &mut Vec<Message>) {
    for (measured, logged, row) in rows(&flight.position) {
        let time = (boot_us(flight, measured) as u64).to_le_bytes();
        // Dilutions; speed and course unknown; a 3D fix with 14 satellites.
        let quality = [72_u16, 110, u16::MAX, u16::MAX].map(u16::to_le_bytes).concat();
        let mut payload = [&time[..], &place(flight.position.geodetic_deg[row]), &quality, &[3, 14]].concat();
        payload.extend([0, 1500, 2500, 0, 0].map(u32::to_le_bytes).concat());
        payload.extend([0, 0]);
        messages.push(plain(logged, GPS_RAW_INT, payload));
    }
}

fn velocities(flight: &SimulatedFlight, messages: &mut Vec<Message>) {
    let Some([latitude, longitude, height]) = flight.reference.geodetic_deg.first() else { return };
    let frame = LocalFrame::new(Geodetic::from_degrees(*latitude, *longitude, *height));
    for (measured, logged, row) in rows(&flight.velocity) {
        let nearest = flight.reference.measured.partition_point(|stamp| *stamp < measured);
        let there = flight.reference.geodetic_deg.get(nearest).or(flight.reference.geodetic_deg.last());
        let place = there.map_or([0.0; 3], |[a, b, c]| frame.to_ned(Geodetic::from_degrees(*a, *b, *c)));
        let floats = place.into_iter().chain(flight.velocity.ned[row]).flat_map(|v| (v as f32).to_le_bytes());
        let payload = boot_ms(flight, measured).to_le_bytes().into_iter().chain(floats).collect();
        messages.push(Message { signed: row % 2 == 1, ..plain(logged, LOCAL_POSITION_NED, payload) });
    }
}

fn truths(flight: &SimulatedFlight, messages: &mut Vec<Message>) {
    for (measured, logged, row) in rows(&flight.reference) {
        let mut payload = (boot_us(flight, measured) as u64).to_le_bytes().to_vec();
        let level = [1.0_f32, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        payload.extend(level.map(f32::to_le_bytes).concat());
        payload.extend(place(flight.reference.geodetic_deg[row]));
        payload.resize(64, 0);
        messages.push(plain(logged, HIL_STATE_QUATERNION, payload));
    }
}

/// Once per second: heartbeat, time, and a text.
fn beats(flight: &SimulatedFlight, messages: &mut Vec<Message>) {
    for second in 0..flight.settings.duration_s.ceil() as u32 {
        let at = flight.settings.start.plus_seconds(f64::from(second) + 0.0005);
        messages.push(plain(at, HEARTBEAT, heartbeat()));
        let unix_us = (at.0 / 1000) as u64;
        let times = [&unix_us.to_le_bytes()[..], &boot_ms(flight, at).to_le_bytes()].concat();
        messages.push(plain(at, SYSTEM_TIME, times));
        messages.push(plain(at, STATUSTEXT, text(&format!("second {second}: all well, nothing to see"))));
    }
}

/// An ArduPilot plane in AUTO.
fn heartbeat() -> Vec<u8> {
    [&10_u32.to_le_bytes()[..], &[1, 3, 0x51, 4, 3]].concat()
}

fn text(text: &str) -> Vec<u8> {
    let mut payload = vec![6];
    payload.extend(text.bytes().take(50));
    payload.resize(54, 0);
    payload
}

/// Messages of an autopilot when a ground station connects.
fn introduction(flight: &SimulatedFlight) -> Vec<Message> {
    let start = flight.settings.start;
    let mut delay = 220_f32.to_le_bytes().to_vec();
    delay.extend([2, 0, 0, 0]);
    delay.extend(b"GPS_DELAY_MS\0\0\0\0");
    delay.push(9);
    vec![
        plain(start, HEARTBEAT, heartbeat()),
        plain(start, STATUSTEXT, text("ArduPlane V4.5.7 (0a1b2c3d)")),
        plain(start, PARAM_VALUE, delay),
    ]
}

fn boot_us(flight: &SimulatedFlight, stamp: Stamp) -> i64 {
    BOOT_US + ((stamp.0 - flight.settings.start.0) as f64 / 1e3).round() as i64
}

fn boot_ms(flight: &SimulatedFlight, stamp: Stamp) -> u32 {
    (BOOT_US / 1000) as u32 + ((stamp.0 - flight.settings.start.0) as f64 / 1e6).round() as u32
}

impl Message {
    fn frame(self, sequence: u8) -> Vec<u8> {
        let (number, extra) = self.kind;
        // At least one byte remains, whatever its value.
        let used = self.payload.iter().rposition(|byte| *byte != 0).map_or(1, |last| last + 1);
        let [a, b, c, _] = number.to_le_bytes();
        let mut frame = vec![0xfd, used as u8, u8::from(self.signed), 0, sequence, 1, 1, a, b, c];
        frame.extend(&self.payload[..used]);
        let checked = frame[1..].iter().copied().chain([extra]);
        frame.extend(checked.fold(0xffff, checksum).to_le_bytes());
        if self.signed {
            frame.extend([7; 13]);
        }
        let time_us = (self.logged.0 / 1000) as u64;
        [&time_us.to_be_bytes()[..], &frame].concat()
    }
}

/// CRC-16/MCRF4XX.
fn checksum(crc: u16, byte: u8) -> u16 {
    (0..8).fold(crc ^ u16::from(byte), |crc, _| if crc & 1 == 0 { crc >> 1 } else { crc >> 1 ^ 0x8408 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_matches_the_crc_catalogue() {
        assert_eq!(b"123456789".iter().fold(0xffff, |crc, byte| checksum(crc, *byte)), 0x6f91);
    }
}
