//! Information about the vehicle from its messages: firmware, modes, parameters, texts.

use crate::decode::packed::text_of;
use crate::format::dataflash::dataflash_vehicle::Vehicle as ArduPilot;
use crate::format::dataflash::modes;
use flight::{About, Clock, NANOS_PER_SECOND};
use std::collections::BTreeMap;

/// Message numbers.
const HEARTBEAT: u32 = 0;
const PARAM_VALUE: u32 = 22;
const AUTOPILOT_VERSION: u32 = 148;
const STATUSTEXT: u32 = 253;

/// `MAV_AUTOPILOT`.
const ARDUPILOT: u8 = 3;
const NO_AUTOPILOT: u8 = 8;
const PX4: u8 = 12;

/// Parts of texts that are kept until the text is complete.
const MOST_PARTS: usize = 64;

/// Whether it is the heartbeat of an autopilot, and not another message or a heartbeat of a ground station or camera.
pub(super) fn is_autopilot(message: u32, payload: &[u8]) -> bool {
    let kind = Heartbeat::read(payload);
    message == HEARTBEAT && kind.is_some_and(|h| h.autopilot != NO_AUTOPILOT && h.vehicle_type != GROUND_STATION)
}

/// `MAV_TYPE_GCS`.
const GROUND_STATION: u8 = 6;

/// Information from an autopilot so far.
#[derive(Debug)]
pub(super) struct Vehicle {
    /// Clock of the reception times.
    clock: Clock,
    /// Collects information from all makes of autopilot.
    kept: ArduPilot,
    autopilot: Option<u8>,
    system: Option<&'static str>,
    firmware: Option<String>,
    board: Option<String>,
    uid: Option<String>,
    /// Partial texts by their number.
    parts: BTreeMap<u16, String>,
}

impl Vehicle {
    /// A vehicle whose messages have times of this clock.
    pub(super) fn new(clock: Clock) -> Vehicle {
        Vehicle {
            clock,
            kept: ArduPilot::default(),
            autopilot: None,
            system: None,
            firmware: None,
            board: None,
            uid: None,
            parts: BTreeMap::new(),
        }
    }

    /// Takes a message; its payload has the length of its definition.
    pub(super) fn observe(&mut self, message: u32, payload: &[u8], at_ns: i64) {
        match message {
            HEARTBEAT => self.heartbeat(payload, at_ns),
            PARAM_VALUE => self.parameter(payload, at_ns),
            AUTOPILOT_VERSION => self.version(payload),
            STATUSTEXT => self.text(payload, at_ns),
            _ => {}
        }
    }

    fn heartbeat(&mut self, payload: &[u8], at_ns: i64) {
        let Some(heartbeat) = Heartbeat::read(payload) else { return };
        self.autopilot = Some(heartbeat.autopilot);
        self.system = heartbeat.system().or(self.system);
        self.kept.mode(at_ns, None, Some(&heartbeat.mode()));
    }

    /// ArduPilot sends integers as floats, PX4 their bits in place of a float's.
    fn parameter(&mut self, payload: &[u8], at_ns: i64) {
        let (Some(bits), Some(name), Some(&kind)) = (payload.first_chunk(), payload.get(8..24), payload.get(24)) else {
            return;
        };
        const REAL: u8 = 9;
        let float = f64::from(f32::from_le_bytes(*bits));
        let whole = f64::from(i32::from_le_bytes(*bits));
        let value = if self.autopilot == Some(PX4) && kind < REAL { whole } else { float };
        let name = text_of(name);
        let clock = self.clock;
        self.kept.parameter_at(|| time(clock, at_ns), &name, value);
    }

    fn version(&mut self, payload: &[u8]) {
        let number = |at: usize| payload.get(at..).and_then(<[u8]>::first_chunk).map(|four| u32::from_le_bytes(*four));
        let custom = payload.get(36..44).unwrap_or_default();
        if let Some(version) = number(16).filter(|v| *v != 0) {
            self.firmware = Some(firmware(version, custom));
        }
        self.board = number(28).filter(|b| *b != 0).map(|b| format!("board {b:#x}")).or(self.board.take());
        let uid = payload.get(8..16).and_then(<[u8]>::first_chunk).map(|eight| u64::from_le_bytes(*eight));
        self.uid = uid.filter(|uid| *uid != 0).map(|uid| format!("{uid:016x}")).or(self.uid.take());
    }

    /// A text of more than 50 characters is split into parts with one number; the last part is shorter. It has no time
    /// of its own: the log's time is used, as with modes.
    fn text(&mut self, payload: &[u8], at_ns: i64) {
        const PART: usize = 50;
        let text = text_of(payload.get(1..=PART).unwrap_or_default());
        let id = payload.get(51..).and_then(<[u8]>::first_chunk).map_or(0, |two| u16::from_le_bytes(*two));
        if id == 0 {
            return self.kept.message_at(&time(self.clock, at_ns), &text);
        }
        let room = self.parts.len() < MOST_PARTS || self.parts.contains_key(&id);
        if text.len() == PART && room {
            self.parts.entry(id).or_default().push_str(&text);
            return;
        }
        let begun = self.parts.remove(&id).unwrap_or_default();
        self.kept.message_at(&time(self.clock, at_ns), &format!("{begun}{text}"));
    }

    pub(super) fn finish(self) -> About {
        let mut about = self.kept.finish();
        // Heartbeats have no time of their own: a mode begins at the log's time.
        for mode in &mut about.modes {
            mode.clock = self.clock;
        }
        about.system = about.system.or(self.system.map(str::to_owned));
        about.firmware = about.firmware.or(self.firmware);
        about.hardware = about.hardware.or(self.board);
        about.vehicle = about.vehicle.or(self.uid);
        about
    }
}

/// Fields of a heartbeat.
struct Heartbeat {
    custom_mode: u32,
    vehicle_type: u8,
    autopilot: u8,
}

impl Heartbeat {
    fn read(payload: &[u8]) -> Option<Heartbeat> {
        let custom_mode = u32::from_le_bytes(*payload.first_chunk()?);
        Some(Heartbeat { custom_mode, vehicle_type: *payload.get(4)?, autopilot: *payload.get(5)? })
    }

    /// By `MAV_TYPE`.
    fn system(&self) -> Option<&'static str> {
        Some(match (self.autopilot, self.vehicle_type) {
            (PX4, _) => "PX4",
            (ARDUPILOT, 1 | 19..=25 | 28) => "ArduPlane",
            (ARDUPILOT, 2..=4 | 13..=15 | 29 | 35) => "ArduCopter",
            (ARDUPILOT, 10 | 11) => "ArduRover",
            (ARDUPILOT, 12) => "ArduSub",
            (ARDUPILOT, 5) => "AntennaTracker",
            (ARDUPILOT, 7) => "Blimp",
            _ => return None,
        })
    }

    fn mode(&self) -> String {
        if self.autopilot == PX4 {
            let [_, _, main, sub] = self.custom_mode.to_le_bytes();
            return px4_mode(main, sub);
        }
        modes::name(self.system(), self.custom_mode.into())
    }
}

/// `PX4_CUSTOM_MAIN_MODE` and, for its automatic mode, `PX4_CUSTOM_SUB_MODE_AUTO`; named as in ULog.
fn px4_mode(main: u8, sub: u8) -> String {
    let name = match (main, sub) {
        (1, _) => "Manual",
        (2, _) => "Altitude",
        (3, 0) => "Position",
        (3, 1) => "Orbit",
        (4, 2) => "Takeoff",
        (4, 3) => "Hold",
        (4, 4) => "Mission",
        (4, 5) => "Return",
        (4, 6) => "Land",
        (4, 8) => "Follow target",
        (4, 9) => "Precision land",
        (4, 10) => "VTOL takeoff",
        (5, _) => "Acro",
        (6, _) => "Offboard",
        (7, _) => "Stabilized",
        (10, _) => "Termination",
        _ => return format!("mode {main}.{sub}"),
    };
    name.to_owned()
}

/// `0xAABBCCTT`: major, minor, patch and release type; and the commit, as text or as bytes.
fn firmware(version: u32, custom: &[u8]) -> String {
    let [major, minor, patch, kind] = version.to_be_bytes();
    let kind = match kind {
        0..64 => "-dev",
        64..128 => "-alpha",
        128..192 => "-beta",
        192..255 => "-rc",
        255 => "",
    };
    let text = text_of(custom);
    let commit = if !text.is_empty() && text.bytes().all(|b| b.is_ascii_hexdigit()) {
        text.into_owned()
    } else {
        custom.iter().rev().map(|byte| format!("{byte:02x}")).collect()
    };
    format!("V{major}.{minor}.{patch}{kind} ({commit})")
}

/// A time of the log as text, to the millisecond.
fn time(clock: Clock, at_ns: i64) -> String {
    match clock {
        Clock::Unix => {
            let time = jiff::Timestamp::from_nanosecond(at_ns.into()).ok();
            time.map_or_else(String::new, |time| time.strftime("%Y-%m-%d %H:%M:%S%.3f UTC").to_string())
        }
        _ if at_ns == 0 => "before the first known time".to_owned(),
        _ => format!("{:.3} s", at_ns as f64 / NANOS_PER_SECOND as f64),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_heartbeat_names_its_mode_as_its_autopilot_does() {
        let mode = |custom_mode, vehicle_type, autopilot| Heartbeat { custom_mode, vehicle_type, autopilot }.mode();
        assert_eq!(mode(10, 1, ARDUPILOT), "AUTO");
        assert_eq!(mode(5, 2, ARDUPILOT), "LOITER");
        assert_eq!(mode(0x0404_0000, 2, PX4), "Mission");
        assert_eq!(mode(7, 2, 0), "mode 7");
    }

    #[test]
    fn a_ground_station_is_not_an_autopilot() {
        let heartbeat = |kind, autopilot| [0, 0, 0, 0, kind, autopilot, 0, 4, 3];
        assert!(is_autopilot(0, &heartbeat(1, ARDUPILOT)));
        assert!(!is_autopilot(0, &heartbeat(GROUND_STATION, NO_AUTOPILOT)));
        assert!(!is_autopilot(1, &heartbeat(1, ARDUPILOT)));
    }

    fn parameter(name: &str, bits: [u8; 4], kind: u8) -> Vec<u8> {
        let mut id = name.as_bytes().to_vec();
        id.resize(16, 0);
        [&bits[..], &[0; 4], &id, &[kind]].concat()
    }

    #[test]
    fn integer_parameters_are_floats_from_ardupilot_and_bits_from_px4() {
        let about = |autopilot, bits: [u8; 4], name| {
            let mut vehicle = Vehicle::new(Clock::Unix);
            vehicle.observe(HEARTBEAT, &[0, 0, 0, 0, 2, autopilot, 0, 4, 3], 0);
            vehicle.observe(PARAM_VALUE, &parameter(name, bits, 6), 1);
            vehicle.finish().configured_delays[0].value_s
        };
        assert_eq!(about(ARDUPILOT, 220_f32.to_le_bytes(), "GPS_DELAY_MS"), 0.22);
        assert_eq!(about(PX4, 110_i32.to_le_bytes(), "EKF2_GPS_DELAY"), 0.11);
    }

    #[test]
    fn parameters_of_either_autopilot_give_receiver_and_antenna() {
        let about = |autopilot, parameters: &[(&str, f32)]| {
            let mut vehicle = Vehicle::new(Clock::Unix);
            vehicle.observe(HEARTBEAT, &[0, 0, 0, 0, 2, autopilot, 0, 4, 3], 0);
            for (name, value) in parameters {
                vehicle.observe(PARAM_VALUE, &parameter(name, value.to_le_bytes(), 9), 1);
            }
            vehicle.finish()
        };
        let places = [("GPS1_POS_X", 0.25), ("GPS1_POS_Y", 0.0), ("GPS1_POS_Z", -0.1)];
        let ardupilot = about(ARDUPILOT, &[&places[..], &[("GPS1_TYPE", 2.0), ("GPS1_RATE_MS", 100.0)]].concat());
        assert_eq!(ardupilot.receiver_identities[0].rate_hz, Some(10.0));
        assert_eq!(ardupilot.lever_arm("gps").map(|arm| arm.forward_m), Some(0.25));
        let px4 = about(PX4, &[("GPS_1_CONFIG", 201.0), ("SER_GPS1_BAUD", 115_200.0)]);
        assert_eq!(px4.receiver_identities[0].baud, Some(115_200));
    }

    #[test]
    fn a_parameter_change_is_reported_with_its_time() {
        let mut vehicle = Vehicle::new(Clock::Unix);
        for (value, at_ns) in [(0.25_f32, 5_000_000_000), (0.25, 6_000_000_000), (0.5, 7_250_000_000)] {
            vehicle.observe(PARAM_VALUE, &parameter("A", value.to_le_bytes(), 9), at_ns);
        }
        assert_eq!(vehicle.finish().parameter_changes, ["A at 1970-01-01 00:00:07.250 UTC: 0.25 to 0.5"]);
    }

    #[test]
    fn a_long_text_is_joined_and_the_firmware_read_from_it() {
        let mut vehicle = Vehicle::new(Clock::Unix);
        let part = |id: u16, text: &str| {
            let mut field = text.as_bytes().to_vec();
            field.resize(50, 0);
            [&[6][..], &field, &id.to_le_bytes(), &[0]].concat()
        };
        vehicle.observe(STATUSTEXT, &part(0, "ArduPlane V4.5.7 (0a1b2c3d)"), 5_000_000_000);
        vehicle.observe(STATUSTEXT, &part(3, &"x".repeat(50)), 6_000_000_000);
        vehicle.observe(STATUSTEXT, &part(3, "y"), 6_000_000_000);
        let about = vehicle.finish();
        assert_eq!(about.firmware.as_deref(), Some("V4.5.7 (0a1b2c3d)"));
        assert_eq!(about.texts[1], format!("1970-01-01 00:00:06.000 UTC: {}y", "x".repeat(50)));
        assert_eq!(firmware(0x0405_07ff, b"0a1b2c3d"), "V4.5.7 (0a1b2c3d)");
        assert_eq!(firmware(0x010e_0040, &[1, 2, 3, 4, 5, 6, 7, 8]), "V1.14.0-alpha (0807060504030201)");
    }
}
