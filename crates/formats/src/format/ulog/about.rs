//! What a ULog states about the vehicle: information, parameters, modes and texts.

use super::ulog_record::Entry;
use crate::format::identity::{lever_arms, of_px4, report_px4_versions};
use flight::{About, Clock, ConfiguredDelay, ModeStart, ReceiverIdentity};
use std::collections::BTreeMap;

/// Maximum distinct information keys, and parameters, that are kept.
const MOST_NAMES: usize = 16_384;
/// Maximum changes of parameters, and of modes, that are listed.
const MOST_CHANGES: usize = 1000;
/// Maximum texts that are kept.
const MOST_TEXTS: usize = 100;
/// Maximum receivers that are listed.
const MOST_RECEIVERS: usize = 20;
/// Maximum driver output that is parsed, bytes.
const LONGEST_CONSOLE: usize = 1 << 16;
/// Longest text that is kept, characters.
const LONGEST_TEXT: usize = 1000;

/// Collects it while the log is read.
#[derive(Debug, Default)]
pub(super) struct Gathered {
    /// By key; `None` for values that are neither text nor number.
    information: BTreeMap<String, Option<String>>,
    /// Output of the drivers at their start.
    console: String,
    /// Parts of multi-part information by key.
    parts: BTreeMap<String, u64>,
    /// At the start of the log.
    parameters: BTreeMap<String, f64>,
    current: BTreeMap<String, f64>,
    defaults: BTreeMap<String, f64>,
    changes: Vec<String>,
    modes: Vec<ModeStart>,
    mode: Option<u8>,
    /// Instance and device number.
    receivers: Vec<(u8, u32)>,
    texts: Vec<String>,
    text_count: u64,
    /// Names and changes beyond the limits.
    pub(super) not_kept: u64,
}

impl Gathered {
    pub(super) fn information(&mut self, entry: &Entry<'_>) {
        let whole = |x: f64| if x.fract() == 0.0 { format!("{x:.0}") } else { x.to_string() };
        let value = entry.text().map(cut).or_else(|| entry.number().map(whole));
        if self.has_room(self.information.len(), self.information.contains_key(entry.name)) {
            self.information.insert(entry.name.to_owned(), value);
        }
    }

    pub(super) fn part(&mut self, entry: &Entry<'_>) {
        if entry.name == "boot_console_output" && self.console.len() < LONGEST_CONSOLE {
            self.console.push_str(&entry.text().map(cut).unwrap_or_default());
        }
        if self.has_room(self.parts.len(), self.parts.contains_key(entry.name)) {
            *self.parts.entry(entry.name.to_owned()).or_default() += 1;
        }
    }

    /// `at_us` is `None` before the first message.
    pub(super) fn parameter(&mut self, entry: &Entry<'_>, at_us: Option<u64>) {
        let Some(value) = entry.number() else { return };
        if !self.has_room(self.current.len(), self.current.contains_key(entry.name)) {
            return;
        }
        let before = self.current.insert(entry.name.to_owned(), value);
        let Some(at_us) = at_us else {
            self.parameters.insert(entry.name.to_owned(), value);
            return;
        };
        if before != Some(value) && self.has_room_for_change(self.changes.len()) {
            let from = before.map_or("not logged".to_owned(), |before| before.to_string());
            self.changes.push(format!("{} at {}: {from} → {value}", entry.name, seconds(at_us)));
        }
    }

    pub(super) fn default_parameter(&mut self, entry: &Entry<'_>) {
        let Some(value) = entry.number() else { return };
        if self.has_room(self.defaults.len(), self.defaults.contains_key(entry.name)) {
            self.defaults.insert(entry.name.to_owned(), value);
        }
    }

    pub(super) fn mode(&mut self, state: u8, at_ns: i64) {
        if self.mode.replace(state) != Some(state) && self.has_room_for_change(self.modes.len()) {
            self.modes.push(ModeStart { at_ns, clock: Clock::Boot, mode: mode_name(state) });
        }
    }

    /// A driver that does not know its device reports zero.
    pub(super) fn receiver(&mut self, instance: u8, device: u32) {
        let known = device == 0 || self.receivers.contains(&(instance, device));
        if !known && self.receivers.len() < MOST_RECEIVERS {
            self.receivers.push((instance, device));
        }
    }

    pub(super) fn text(&mut self, level: u8, tag: Option<u16>, at_us: u64, text: &str) {
        self.text_count += 1;
        if self.texts.len() < MOST_TEXTS {
            let tag = tag.map_or(String::new(), |tag| format!(" [{tag}]"));
            self.texts.push(format!(
                "{} {}{tag}: {}",
                seconds(at_us),
                level_name(level),
                cut(text.trim_end().to_owned())
            ));
        }
    }

    /// Texts beyond the limit.
    pub(super) fn texts_not_kept(&self) -> u64 {
        self.text_count - self.texts.len() as u64
    }

    fn has_room(&mut self, taken: usize, known: bool) -> bool {
        let room = known || taken < MOST_NAMES;
        self.not_kept += u64::from(!room);
        room
    }

    fn has_room_for_change(&mut self, taken: usize) -> bool {
        let room = taken < MOST_CHANGES;
        self.not_kept += u64::from(!room);
        room
    }

    fn known(&self, key: &str) -> Option<&str> {
        self.information.get(key)?.as_deref().filter(|value| !value.is_empty())
    }

    fn firmware(&self) -> Option<String> {
        let release = self.known("ver_sw_release").and_then(|text| text.parse().ok()).map(release);
        let branch = self.known("ver_sw_branch").map(|branch| format!("branch {branch}"));
        let commit = self.known("ver_sw").map(|commit| format!("git {commit}"));
        let parts: Vec<String> = [release, branch, commit].into_iter().flatten().collect();
        (!parts.is_empty()).then(|| parts.join(", "))
    }

    fn hardware(&self) -> Option<String> {
        let parts: Vec<&str> = ["ver_hw", "ver_hw_subtype"].iter().filter_map(|key| self.known(key)).collect();
        (!parts.is_empty()).then(|| parts.join(" "))
    }

    /// What the log holds besides its messages, by name.
    pub(super) fn extras(&self) -> Vec<String> {
        let information = self.information.iter().map(|(key, value)| match value {
            Some(value) => format!("{key}: {value}"),
            None => key.clone(),
        });
        let parts = self.parts.iter().map(|(key, parts)| format!("{key} ({parts} parts)"));
        let defaults = (!self.defaults.is_empty()).then(|| format!("{} default parameters", self.defaults.len()));
        information.chain(parts).chain(defaults).collect()
    }

    fn receiver_identities(&self) -> Vec<ReceiverIdentity> {
        let mut receivers: Vec<ReceiverIdentity> = vec![];
        for (instance, device) in &self.receivers {
            let number = u32::from(*instance) + 1;
            let Some(model) = kind_of(*device).filter(|_| receivers.iter().all(|r| r.number != number)) else {
                continue;
            };
            let sources = [("model".to_owned(), format!("device {device:#x}"))].into();
            receivers.push(ReceiverIdentity { number, model: Some(model.to_owned()), sources, ..Default::default() });
        }
        receivers.sort_by_key(|receiver| receiver.number);
        of_px4(&|name| self.parameters.get(name).copied(), &mut receivers);
        let console = self.console.lines().map(str::to_owned);
        let lines: Vec<String> = console.chain(self.texts.iter().cloned()).collect();
        report_px4_versions(&mut receivers, &lines);
        receivers
    }

    pub(super) fn about(self) -> About {
        About {
            system: self.known("sys_name").map(str::to_owned),
            firmware: self.firmware(),
            hardware: self.hardware(),
            vehicle: self.known("sys_uuid").map(str::to_owned),
            receivers: self.receivers.iter().map(|(instance, device)| receiver(*instance, *device)).collect(),
            receiver_identities: self.receiver_identities(),
            lever_arms: lever_arms(&|name| self.parameters.get(name).copied()),
            configured_delays: self.parameters.iter().filter_map(|(name, value)| configured(name, *value)).collect(),
            parameters: self.parameters.len() as u64,
            parameter_changes: self.changes,
            modes: self.modes,
            texts: self.texts,
        }
    }
}

fn cut(text: String) -> String {
    if text.len() > LONGEST_TEXT { text.chars().take(LONGEST_TEXT).collect() } else { text }
}

fn seconds(at_us: u64) -> String {
    format!("{}.{:03} s", at_us / 1_000_000, at_us / 1000 % 1000)
}

/// `0xAABBCCTT`: major, minor, patch and release type (PX4, `src/lib/version`).
fn release(version: u32) -> String {
    let [major, minor, patch, kind] = version.to_be_bytes();
    let kind = match kind {
        0..64 => "development",
        64..128 => "alpha",
        128..192 => "beta",
        192..255 => "release candidate",
        255 => "release",
    };
    format!("{major}.{minor}.{patch} {kind}")
}

/// `GPS 0: u-blox F9P (device 0xaa0005)`: the second-highest byte of a device's number is its type (PX4,
/// `src/drivers/drv_sensor.h`).
fn receiver(instance: u8, device: u32) -> String {
    let name = kind_of(device).unwrap_or("of an unknown type");
    format!("GPS {instance}: {name} (device {device:#x})")
}

fn kind_of(device: u32) -> Option<&'static str> {
    let [_, kind, ..] = device.to_be_bytes();
    Some(match kind {
        0x85 => "DroneCAN",
        0xa0 => "Ashtech",
        0xa1 => "Emlid Reach",
        0xa2 => "Femtomes",
        0xa3 => "MTK",
        0xa4 => "Septentrio",
        0xa5 => "u-blox",
        0xa6 => "u-blox 6",
        0xa7 => "u-blox 7",
        0xa8 => "u-blox 8",
        0xa9 => "u-blox 9",
        0xaa => "u-blox F9P",
        0xab => "NMEA",
        0xac => "u-blox 10",
        0xad => "u-blox 20",
        0xaf => "simulated",
        _ => return None,
    })
}

/// Parameters that set a delay: name, units per second, what they delay.
const DELAYS: &[(&str, f64, &str)] = &[
    ("EKF2_GPS_DELAY", 1e3, "delay of GPS against the IMU"),
    ("EKF2_MAG_DELAY", 1e3, "delay of the magnetometer against the IMU"),
    ("EKF2_BARO_DELAY", 1e3, "delay of the barometer against the IMU"),
    ("EKF2_ASP_DELAY", 1e3, "delay of the airspeed against the IMU"),
    ("EKF2_EV_DELAY", 1e3, "delay of external vision against the IMU"),
    ("EKF2_OF_DELAY", 1e3, "delay of optical flow against the IMU"),
    ("EKF2_RNG_DELAY", 1e3, "delay of the range finder against the IMU"),
    ("EKF2_AVEL_DELAY", 1e3, "delay of the auxiliary velocity against the IMU"),
    ("EKF2_AGP_DELAY", 1e3, "delay of the auxiliary global position against the IMU"),
    ("EKF2_AGP0_DELAY", 1e3, "delay of the auxiliary global position 0 against the IMU"),
    ("EKF2_DELAY_MAX", 1e3, "longest delay that the estimator allows for"),
    ("SENS_GPS0_DELAY", 1e3, "delay of GPS 0 against the IMU"),
    ("SENS_GPS1_DELAY", 1e3, "delay of GPS 1 against the IMU"),
    ("SENS_GNSS0_DELAY", 1e3, "delay of GPS 0 against the IMU"),
    ("SENS_GNSS1_DELAY", 1e3, "delay of GPS 1 against the IMU"),
    ("PE_POS_DELAY_MS", 1e3, "delay of the GPS position against the IMU"),
    ("PE_VEL_DELAY_MS", 1e3, "delay of the GPS velocity against the IMU"),
    ("PE_HGT_DELAY_MS", 1e3, "delay of the barometric height against the IMU"),
    ("PE_TAS_DELAY_MS", 1e3, "delay of the airspeed against the IMU"),
    ("LPE_GPS_DELAY", 1.0, "delay of GPS against the local estimator"),
    ("LPE_VIS_DELAY", 1.0, "delay of vision against the local estimator"),
    ("INAV_DELAY_GPS", 1.0, "delay of GPS against the inertial estimator"),
];

pub(in crate::format) fn configured(name: &str, value: f64) -> Option<ConfiguredDelay> {
    let (parameter, per_second, meaning) = DELAYS.iter().find(|(parameter, ..)| *parameter == name)?;
    let value_s = value / per_second;
    value_s.is_finite().then(|| ConfiguredDelay {
        parameter: (*parameter).to_owned(),
        value_s,
        meaning: (*meaning).to_owned(),
    })
}

/// `nav_state` of `vehicle_status`. Numbers whose meaning PX4 changed over time are shown as numbers.
fn mode_name(state: u8) -> String {
    let name = match state {
        0 => "Manual",
        1 => "Altitude",
        2 => "Position",
        3 => "Mission",
        4 => "Hold",
        5 => "Return",
        10 => "Acro",
        12 => "Descend",
        13 => "Termination",
        14 => "Offboard",
        15 => "Stabilized",
        17 => "Takeoff",
        18 => "Land",
        19 => "Follow target",
        20 => "Precision land",
        21 => "Orbit",
        22 => "VTOL takeoff",
        23..=30 => return format!("External {}", state - 22),
        _ => return format!("nav_state {state}"),
    };
    name.to_owned()
}

/// Linux kernel levels, as digits.
pub(super) fn level_name(level: u8) -> &'static str {
    match level & 0xf {
        0 => "EMERGENCY",
        1 => "ALERT",
        2 => "CRITICAL",
        3 => "ERROR",
        4 => "WARNING",
        5 => "NOTICE",
        6 => "INFO",
        _ => "DEBUG",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `NAVIGATION_STATE_*` of PX4's `VehicleStatus.msg`, and `KERN_*` of Linux' `kern_levels.h`.
    #[test]
    fn modes_and_levels_have_the_names_of_px4_and_linux() {
        let modes = "Manual, Altitude, Position, Mission, Hold, Return, nav_state 6, nav_state 7, nav_state 8, nav_state 9, \
                     Acro, nav_state 11, Descend, Termination, Offboard, Stabilized, nav_state 16, Takeoff, Land, \
                     Follow target, Precision land, Orbit, VTOL takeoff, External 1, External 2, External 3, External 4, \
                     External 5, External 6, External 7, External 8, nav_state 31";
        assert_eq!((0..32).map(mode_name).collect::<Vec<String>>().join(", "), modes);
        let levels = "EMERGENCY ALERT CRITICAL ERROR WARNING NOTICE INFO DEBUG";
        assert_eq!((b'0'..=b'7').map(level_name).collect::<Vec<&str>>().join(" "), levels);
    }

    fn number(name: &str, value: f32) -> (String, Vec<u8>) {
        (name.to_owned(), value.to_le_bytes().into())
    }

    fn with(gathered: &mut Gathered, (name, value): (String, Vec<u8>), at_us: Option<u64>) {
        gathered.parameter(&Entry { kind: "float", name: &name, value: &value }, at_us);
    }

    #[test]
    fn a_parameter_change_is_reported_and_its_first_value_is_the_delay() {
        let mut gathered = Gathered::default();
        with(&mut gathered, number("EKF2_GPS_DELAY", 110.0), None);
        with(&mut gathered, number("EKF2_GPS_DELAY", 110.0), Some(1));
        with(&mut gathered, number("EKF2_GPS_DELAY", 150.0), Some(12_345_678));
        with(&mut gathered, number("NEW", 1.5), Some(13_000_000));
        let about = gathered.about();
        assert_eq!(about.parameters, 1);
        assert_eq!(about.configured_delays[0].value_s, 0.11);
        assert_eq!(
            about.parameter_changes,
            ["EKF2_GPS_DELAY at 12.345 s: 110 → 150", "NEW at 13.000 s: not logged → 1.5"]
        );
    }

    #[test]
    fn a_version_is_formatted_as_in_px4() {
        assert_eq!(release(0x010d_00ff), "1.13.0 release");
        assert_eq!(release(0x010e_0040), "1.14.0 alpha");
    }

    #[test]
    fn kept_entries_are_limited_and_the_rest_are_counted() {
        let mut gathered = Gathered::default();
        for i in 0..MOST_NAMES + 7 {
            with(&mut gathered, number(&format!("P{i}"), 1.0), None);
        }
        for i in 0..2 * MOST_TEXTS {
            gathered.text(b'6', None, 0, &format!("{i} {}", "x".repeat(5000)));
        }
        for i in 0..2 * MOST_CHANGES {
            gathered.mode((i % 2) as u8, 0);
        }
        assert_eq!((gathered.not_kept, gathered.texts_not_kept()), (7 + 1000, 100));
        let about = gathered.about();
        assert_eq!((about.texts.len(), about.modes.len()), (MOST_TEXTS, MOST_CHANGES));
        assert!(about.texts.iter().all(|text| text.len() < 1100));
    }
}
