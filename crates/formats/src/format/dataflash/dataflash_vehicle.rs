//! What a log states about its vehicle: firmware, board, receivers, parameters, modes, texts.

use super::modes;
use crate::format::identity::{lever_arms, of_ardupilot, of_px4};
use crate::format::ulog::about::configured;
use flight::{About, Clock, ConfiguredDelay, ModeStart, NANOS_PER_SECOND, ReceiverIdentity};
use std::collections::BTreeMap;

/// Maximum parameters that are remembered.
const MOST_PARAMETERS: usize = 20_000;
/// Maximum changes of parameters that are listed.
const MOST_CHANGES: usize = 100;
/// Parameters with the autopilot's own statistics: flights, seconds in the air.
const COUNTER: &str = "STAT_";
/// Maximum modes that are listed.
const MOST_MODES: usize = 1000;
/// Maximum texts that are listed.
const MOST_TEXTS: usize = 100;
/// Maximum receivers that are listed.
const MOST_RECEIVERS: usize = 20;

/// What the records have stated so far.
#[derive(Debug, Default)]
pub(in crate::format) struct Vehicle {
    /// First and latest value.
    parameters: BTreeMap<String, [f64; 2]>,
    changes: Vec<String>,
    unlisted_changes: u64,
    modes: Vec<(i64, Mode)>,
    texts: Vec<String>,
    system: Option<String>,
    firmware: Option<String>,
    board: Option<String>,
    board_id: Option<i64>,
    serial: Option<String>,
    receivers: Vec<String>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum Mode {
    Number(i64),
    Name(String),
}

impl Vehicle {
    pub(super) fn parameter(&mut self, at_ns: i64, name: &str, value: f64) {
        self.parameter_at(|| seconds(at_ns), name, value);
    }

    /// The value of a parameter, and since when.
    pub(in crate::format) fn parameter_at(&mut self, when: impl FnOnce() -> String, name: &str, value: f64) {
        let value = as_set(value);
        let full = self.parameters.len() >= MOST_PARAMETERS;
        match self.parameters.get_mut(name) {
            Some([_, latest]) if latest.to_bits() != value.to_bits() => {
                if name.starts_with(COUNTER) {
                    // Counts up all the time; no user set it.
                } else if self.changes.len() < MOST_CHANGES {
                    self.changes.push(format!("{name} at {}: {latest} to {value}", when()));
                } else {
                    self.unlisted_changes += 1;
                }
                *latest = value;
            }
            Some(_) => {}
            None if full => {}
            None => drop(self.parameters.insert(name.to_owned(), [value; 2])),
        }
    }

    pub(in crate::format) fn message(&mut self, at_ns: i64, text: &str) {
        self.message_at(&seconds(at_ns), text);
    }

    /// A text and its time.
    pub(in crate::format) fn message_at(&mut self, when: &str, text: &str) {
        let text = text.trim();
        if self.texts.len() < MOST_TEXTS {
            self.texts.push(format!("{when}: {text}"));
        }
        if let Some((system, firmware)) = firmware(text) {
            self.system = Some(system.to_owned());
            self.firmware = Some(firmware.to_owned());
        }
        if let Some((board, serial)) = board(text) {
            self.board = Some(board.to_owned());
            self.serial = Some(serial.to_owned());
        }
        if is_receiver(text) && self.receivers.len() < MOST_RECEIVERS && !self.receivers.iter().any(|r| r == text) {
            self.receivers.push(text.to_owned());
        }
    }

    pub(in crate::format) fn mode(&mut self, at_ns: i64, number: Option<i64>, name: Option<&str>) {
        let mode = match (number, name) {
            (Some(number), _) => Mode::Number(number),
            (None, Some(name)) => Mode::Name(name.trim().to_owned()),
            (None, None) => return,
        };
        if self.modes.len() < MOST_MODES && self.modes.last().is_none_or(|(_, last)| *last != mode) {
            self.modes.push((at_ns, mode));
        }
    }

    /// A `VER` record, from ArduPilot 4.3 on. Firmware with a custom name is identified by its build type.
    pub(super) fn version(&mut self, firmware_text: Option<&str>, build: Option<i64>, board_id: Option<i64>) {
        let text = firmware_text.map(str::trim).filter(|text| !text.is_empty());
        let built_of = BUILDS.iter().find(|(number, _)| Some(*number) == build).map(|(_, system)| *system);
        match text.and_then(firmware) {
            Some((system, firmware)) => {
                self.system = Some(system.to_owned());
                self.firmware = Some(firmware.to_owned());
            }
            None => {
                self.firmware = text.map(str::to_owned).or(self.firmware.take());
                self.system = built_of.map(str::to_owned).or(self.system.take());
            }
        }
        self.board_id = board_id.or(self.board_id);
    }

    /// A `VER` record of PX4's sdlog2.
    pub(super) fn version_of_px4(&mut self, board: &str, git: &str) {
        self.system = Some("PX4".to_owned());
        self.firmware = Some(format!("git {git}"));
        self.board = Some(board.to_owned());
    }

    pub(in crate::format) fn finish(self) -> About {
        let configured_delays = self.delays();
        let (receiver_identities, lever_arms) = (self.receiver_identities(), lever_arms(&|name| self.first(name)));
        let mut parameter_changes = self.changes;
        if self.unlisted_changes > 0 {
            parameter_changes.push(format!("and {} more", self.unlisted_changes));
        }
        let system = self.system;
        let name_of = |mode: Mode| match mode {
            Mode::Name(name) => name,
            Mode::Number(number) => modes::name(system.as_deref(), number),
        };
        let started = |(at_ns, mode)| ModeStart { at_ns, clock: Clock::Boot, mode: name_of(mode) };
        About {
            modes: self.modes.into_iter().map(started).collect(),
            firmware: self.firmware,
            hardware: self.board.or_else(|| self.board_id.map(|id| format!("board {id} in ArduPilot's list"))),
            vehicle: self.serial,
            receivers: self.receivers,
            receiver_identities,
            lever_arms,
            configured_delays,
            parameters: self.parameters.len() as u64,
            parameter_changes,
            texts: self.texts,
            system,
        }
    }

    /// Value of a parameter at the start.
    fn first(&self, name: &str) -> Option<f64> {
        self.parameters.get(name).map(|[first, _]| *first)
    }

    fn receiver_identities(&self) -> Vec<ReceiverIdentity> {
        let mut receivers = of_ardupilot(&|name| self.first(name), &self.receivers);
        of_px4(&|name| self.first(name), &mut receivers);
        receivers
    }

    fn delays(&self) -> Vec<ConfiguredDelay> {
        let first = |name: &str| self.first(name);
        let delay = |&(parameter, unit, meaning): &(&str, DelayUnit, &str)| {
            let value = first(parameter)?;
            let value_s = match unit {
                DelayUnit::Milliseconds => value / 1e3,
                DelayUnit::Periods(rate) => value / first(rate).filter(|hz| *hz > 0.0)?,
            };
            Some(ConfiguredDelay { parameter: parameter.to_owned(), value_s, meaning: meaning.to_owned() })
        };
        let of_px4 = self.parameters.iter().filter_map(|(name, [first, _])| configured(name, *first));
        DELAYS.iter().filter_map(delay).chain(of_px4).collect()
    }
}

fn seconds(ns: i64) -> String {
    format!("{:.3} s", ns as f64 / NANOS_PER_SECOND as f64)
}

/// A parameter is a 32-bit float: its shortest decimal is its value, 0.1, and not the double next to it.
fn as_set(value: f64) -> f64 {
    let narrow = value as f32;
    if f64::from(narrow) == value { narrow.to_string().parse().unwrap_or(value) } else { value }
}

/// The unit of a delay parameter.
#[derive(Debug, Clone, Copy)]
enum DelayUnit {
    Milliseconds,
    /// Periods of a receiver whose rate in Hz is this parameter.
    Periods(&'static str),
}

const FIRST: &str = "delay that the autopilot assumes for the first receiver; 0 is the default of its type";
const SECOND: &str = "delay that the autopilot assumes for the second receiver; 0 is the default of its type";
const POSITION: &str = "delay that the estimator assumes for the position";
const VELOCITY: &str = "delay that the estimator assumes for the velocity";
const GPS: &str = "delay that the estimator assumes for the receiver";
const HEIGHT: &str = "delay that the estimator assumes for the height";
const FLOW: &str = "delay that the estimator assumes for optical flow";
const BEACON: &str = "delay that the estimator assumes for range beacons";
const VISION: &str = "delay that the autopilot assumes for visual odometry";
const SIMULATED: &str = "delay of the simulated receiver";

/// Parameters of ArduPilot 3.2 to 4.7 that set a delay of a measurement.
const DELAYS: &[(&str, DelayUnit, &str)] = &[
    ("GPS_DELAY_MS", DelayUnit::Milliseconds, FIRST),
    ("GPS1_DELAY_MS", DelayUnit::Milliseconds, FIRST),
    ("GPS_DELAY_MS2", DelayUnit::Milliseconds, SECOND),
    ("GPS2_DELAY_MS", DelayUnit::Milliseconds, SECOND),
    ("EKF_POS_DELAY", DelayUnit::Milliseconds, POSITION),
    ("EKF_VEL_DELAY", DelayUnit::Milliseconds, VELOCITY),
    ("EKF_FLOW_DELAY", DelayUnit::Milliseconds, FLOW),
    ("EK2_GPS_DELAY", DelayUnit::Milliseconds, GPS),
    ("EK2_HGT_DELAY", DelayUnit::Milliseconds, HEIGHT),
    ("EK2_FLOW_DELAY", DelayUnit::Milliseconds, FLOW),
    ("EK2_BCN_DELAY", DelayUnit::Milliseconds, BEACON),
    ("EK3_HGT_DELAY", DelayUnit::Milliseconds, HEIGHT),
    ("EK3_FLOW_DELAY", DelayUnit::Milliseconds, FLOW),
    ("EK3_BCN_DELAY", DelayUnit::Milliseconds, BEACON),
    ("VISO_DELAY_MS", DelayUnit::Milliseconds, VISION),
    ("SIM_GPS_DELAY", DelayUnit::Periods("SIM_GPS_HZ"), SIMULATED),
    ("SIM_GPS2_DELAY", DelayUnit::Periods("SIM_GPS2_HZ"), SIMULATED),
    ("SIM_GPS_LAG_MS", DelayUnit::Milliseconds, SIMULATED),
    ("SIM_GPS1_LAG_MS", DelayUnit::Milliseconds, SIMULATED),
    ("SIM_GPS2_LAG_MS", DelayUnit::Milliseconds, SIMULATED),
];

/// Firmware names as logged, and their present names.
const SYSTEMS: &[(&str, &str)] = &[
    ("ArduCopter", "ArduCopter"),
    ("APM:Copter", "ArduCopter"),
    ("ArduPlane", "ArduPlane"),
    ("APM:Plane", "ArduPlane"),
    ("ArduRover", "ArduRover"),
    ("APM:Rover", "ArduRover"),
    ("Rover", "ArduRover"),
    ("ArduSub", "ArduSub"),
    ("AntennaTracker", "AntennaTracker"),
    ("Blimp", "Blimp"),
];

/// The build type of a firmware (ArduPilot, `AP_Vehicle_Type.h`).
const BUILDS: &[(i64, &str)] = &[
    (1, "ArduRover"),
    (2, "ArduCopter"),
    (3, "ArduPlane"),
    (4, "AntennaTracker"),
    (7, "ArduSub"),
    (12, "Blimp"),
    (13, "ArduCopter"),
];

/// `ArduCopter V4.1.0 (0b517cfc)`.
fn firmware(text: &str) -> Option<(&'static str, &str)> {
    let (name, version) = text.split_once(' ')?;
    let (_, system) = SYSTEMS.iter().find(|(known, _)| *known == name)?;
    let numbered = version.strip_prefix('V').is_some_and(|v| v.starts_with(|c: char| c.is_ascii_digit()));
    numbered.then_some((*system, version))
}

/// `fmuv3 003A0025 3136510A 31353532`: board, and serial number of its processor.
fn board(text: &str) -> Option<(&str, &str)> {
    let (board, serial) = text.split_once(' ')?;
    let words: Vec<&str> = serial.split(' ').collect();
    let hexadecimal = |word: &&str| word.len() == 8 && word.bytes().all(|b| b.is_ascii_hexdigit());
    (words.len() == 3 && words.iter().all(hexadecimal)).then_some((board, serial))
}

/// `GPS 1: detected as u-blox at 115200 baud`; since 4.5 `GPS 1: detected u-blox` on detection, and in each log that
/// starts afterwards `GPS 1: probing for u-blox at 230400 baud`; without a search `specified as`.
fn is_receiver(text: &str) -> bool {
    const FOUND: [&str; 3] = [" detected ", " specified as ", " probing for "];
    (text.starts_with("GPS") && FOUND.iter().any(|found| text.contains(found)))
        || (text.starts_with("u-blox ") && text.contains("HW:"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn firmware_board_and_receiver_are_parsed_from_texts() {
        let mut vehicle = Vehicle::default();
        for text in [
            "ArduPlane V3.8.2-dev (8178ab40)",
            "PX4: 0384802e NuttX: 1bcae90b",
            "PX4v4 00360029 30365103 31323731",
            "GPS 1: detected as u-blox at 115200 baud",
            "u-blox 1 HW: 00040007 SW: 7.03 (45970)",
            "u-blox 1 HW: 00040007 SW: 7.03 (45970)",
            "Rover is not a version",
        ] {
            vehicle.message(1_500_000_000, text);
        }
        vehicle.mode(2, Some(10), None);
        let about = vehicle.finish();
        assert_eq!(about.system.as_deref(), Some("ArduPlane"));
        assert_eq!(about.firmware.as_deref(), Some("V3.8.2-dev (8178ab40)"));
        assert_eq!(about.hardware.as_deref(), Some("PX4v4"));
        assert_eq!(about.vehicle.as_deref(), Some("00360029 30365103 31323731"));
        assert_eq!(about.receivers.len(), 2);
        assert_eq!(about.texts[0], "1.500 s: ArduPlane V3.8.2-dev (8178ab40)");
        assert_eq!(about.modes[0].mode, "AUTO");
    }

    #[test]
    fn firmware_with_a_custom_name_is_identified_by_its_build_type() {
        let identity = |text, build| -> [String; 3] {
            let mut vehicle = Vehicle::default();
            vehicle.version(text, build, Some(1063));
            vehicle.mode(0, Some(20), None);
            let about = vehicle.finish();
            [about.system.unwrap_or_default(), about.firmware.unwrap_or_default(), about.modes[0].mode.clone()]
        };
        assert_eq!(
            identity(Some("SurveyBird V4.5.7-3 (0b517cfc)"), Some(3)),
            ["ArduPlane", "SurveyBird V4.5.7-3 (0b517cfc)", "QLAND"]
        );
        assert_eq!(
            identity(Some("ArduSub V4.7.0 (0b517cfc)"), Some(7)),
            ["ArduSub", "V4.7.0 (0b517cfc)", "MOTOR_DETECT"]
        );
        assert_eq!(identity(Some("SurveyBird V4.3.0"), None), ["", "SurveyBird V4.3.0", "mode 20"]);
    }

    #[test]
    fn receivers_are_parsed_from_the_texts_of_every_version() {
        let mut vehicle = Vehicle::default();
        let receivers = [
            "GPS 1: detected as u-blox at 115200 baud",
            "GPS 1: detected u-blox",
            "GPS 1: probing for u-blox at 230400 baud",
            "GPS 2: specified as DroneCAN1-125",
        ];
        for text in ["GPS Glitch", "PreArm: GPS 1: Bad fix", "GPS 1: u-blox solution rate configuration required"] {
            vehicle.message(0, text);
        }
        receivers.iter().for_each(|text| vehicle.message(0, text));
        assert_eq!(vehicle.finish().receivers, receivers);
    }

    #[test]
    fn a_parameter_change_is_reported_and_its_first_value_is_the_delay() {
        let mut vehicle = Vehicle::default();
        for (name, value) in [("SIM_GPS_HZ", 5.0), ("SIM_GPS_DELAY", 1.0), ("GPS_DELAY_MS", 110.0)] {
            vehicle.parameter(0, name, value);
            vehicle.parameter(0, name, value);
        }
        vehicle.parameter(0, "GPS_DELAY_MS", 50.0);
        let about = vehicle.finish();
        assert_eq!(
            (about.parameters, about.parameter_changes),
            (3, vec!["GPS_DELAY_MS at 0.000 s: 110 to 50".to_owned()])
        );
        let delays: Vec<(&str, f64)> =
            about.configured_delays.iter().map(|d| (d.parameter.as_str(), d.value_s)).collect();
        assert_eq!(delays, [("GPS_DELAY_MS", 0.11), ("SIM_GPS_DELAY", 0.2)]);
    }
}
