//! Receivers and lever arms from the parameters of ArduPilot (3.2 to 4.7) and PX4 (1.8 to 1.17).

use super::{Parameters, Receivers, known, note_baud, note_rate, note_text, numbered, versions::report_ardupilot};
use flight::{LeverArm, ReceiverIdentity};

/// ArduPilot's parameter names for one receiver, since 4.6 and before.
struct Names {
    number: u32,
    kind: [&'static str; 2],
    period_ms: [&'static str; 2],
}

const ARDUPILOT: [Names; 2] = [
    Names { number: 1, kind: ["GPS1_TYPE", "GPS_TYPE"], period_ms: ["GPS1_RATE_MS", "GPS_RATE_MS"] },
    Names { number: 2, kind: ["GPS2_TYPE", "GPS_TYPE2"], period_ms: ["GPS2_RATE_MS", "GPS_RATE_MS2"] },
];

/// Values of `GPS_TYPE` (ArduPilot, `AP_GPS.h`): number, protocol, and whether it uses a serial port.
const TYPES: &[(u32, &str, bool)] = &[
    (2, "UBX", true),
    (3, "MTK", true),
    (4, "MTK", true),
    (5, "NMEA", true),
    (6, "SiRF", true),
    (8, "SBP", true),
    (9, "DroneCAN", false),
    (10, "SBF", true),
    (11, "GSOF", true),
    (13, "ERB", true),
    (14, "MAVLink", false),
    (15, "NOVA", true),
    (16, "NMEA of Hemisphere", true),
    (17, "UBX", true),
    (18, "UBX", true),
    (19, "MSP", true),
    (20, "NMEA of AllyStar", true),
    (21, "external AHRS", false),
    (22, "DroneCAN", false),
    (23, "DroneCAN", false),
    (24, "NMEA of Unicore", true),
    (25, "NMEA of Unicore", true),
    (26, "SBF", true),
    (100, "simulated", false),
];

/// Receivers from ArduPilot's texts and parameters.
pub(in crate::format) fn of_ardupilot(parameters: &Parameters<'_>, texts: &[String]) -> Vec<ReceiverIdentity> {
    let mut receivers = Receivers::new();
    let (tried, found): (Vec<&String>, Vec<&String>) = texts.iter().partition(|text| text.contains(" probing for "));
    found.into_iter().chain(tried).for_each(|text| report_ardupilot(text, &mut receivers));
    let mut lines = serial_lines(parameters).into_iter();
    for names in ARDUPILOT {
        let (kind, kind_source) = first_of(parameters, &names.kind).unwrap_or((0.0, names.kind[0]));
        if kind == 0.0 && !receivers.contains_key(&names.number) {
            continue;
        }
        let receiver = numbered(&mut receivers, names.number);
        let entry = TYPES.iter().find(|(number, ..)| f64::from(*number) == kind);
        note_text(receiver, "protocol", entry.map(|(_, protocol, _)| *protocol), kind_source);
        if let Some((period_ms, source)) = first_of(parameters, &names.period_ms) {
            note_rate(receiver, Some(1e3 / period_ms), source);
        }
        let has_line = match receiver.protocol.as_deref() {
            Some("DroneCAN") => false,
            _ => entry.is_none_or(|(_, _, serial)| *serial),
        };
        if let Some((baud, source)) = has_line.then(|| lines.next()).flatten() {
            note_baud(receiver, Some(baud), &source);
        }
    }
    known(receivers)
}

/// Baud rates of the serial ports on which ArduPilot expects a receiver, in its order: the first receiver has the
/// first.
fn serial_lines(parameters: &Parameters<'_>) -> Vec<(u32, String)> {
    const GPS: f64 = 5.0;
    let line = |port: u32| {
        let is_gps = parameters(&format!("SERIAL{port}_PROTOCOL")) == Some(GPS);
        let name = format!("SERIAL{port}_BAUD");
        let baud = parameters(&name).filter(|_| is_gps).and_then(baud_of)?;
        Some((baud, name))
    };
    (0..10).filter_map(line).collect()
}

/// ArduPilot's short codes for baud rates (`AP_SerialManager::map_baudrate`); larger numbers are the rate itself.
fn baud_of(stated: f64) -> Option<u32> {
    const SHORT: &[(f64, u32)] = &[
        (1.0, 1_200),
        (2.0, 2_400),
        (4.0, 4_800),
        (9.0, 9_600),
        (19.0, 19_200),
        (38.0, 38_400),
        (57.0, 57_600),
        (100.0, 100_000),
        (111.0, 111_100),
        (115.0, 115_200),
        (230.0, 230_400),
        (256.0, 256_000),
        (460.0, 460_800),
        (500.0, 500_000),
        (921.0, 921_600),
        (1500.0, 1_500_000),
        (2000.0, 2_000_000),
    ];
    let short = SHORT.iter().find(|(number, _)| *number == stated).map(|(_, baud)| *baud);
    short.or_else(|| (stated > 2000.0 && stated <= 12_500_000.0).then_some(stated as u32))
}

/// Ports that PX4's `GPS_n_CONFIG` may name, and the parameter of their baud rate.
const PORTS: &[(f64, &str)] = &[
    (101.0, "SER_TEL1_BAUD"),
    (102.0, "SER_TEL2_BAUD"),
    (103.0, "SER_TEL3_BAUD"),
    (104.0, "SER_TEL4_BAUD"),
    (201.0, "SER_GPS1_BAUD"),
    (202.0, "SER_GPS2_BAUD"),
    (203.0, "SER_GPS3_BAUD"),
    (300.0, "SER_RC_BAUD"),
];

/// `GPS_n_PROTOCOL` of PX4; 0 is automatic.
const PROTOCOLS: &[(f64, &str)] =
    &[(1.0, "UBX"), (2.0, "MTK"), (3.0, "Ashtech"), (4.0, "ERB"), (5.0, "Femtomes"), (6.0, "NMEA")];

/// Reads PX4's parameters. A baud rate of zero is auto-detected by the driver and unknown here.
pub(in crate::format) fn of_px4(parameters: &Parameters<'_>, receivers: &mut Vec<ReceiverIdentity>) {
    let mut all: Receivers = receivers.drain(..).map(|receiver| (receiver.number, receiver)).collect();
    for number in [1, 2] {
        let port = parameters(&format!("GPS_{number}_CONFIG")).filter(|port| *port != 0.0);
        let known = all.contains_key(&number);
        let Some(port) = port.filter(|_| known || number == 1) else { continue };
        let receiver = numbered(&mut all, number);
        if let Some((_, name)) = PORTS.iter().find(|(known, _)| *known == port) {
            note_baud(
                receiver,
                parameters(name).filter(|baud| (1.0..2e7).contains(baud)).map(|baud| baud as u32),
                name,
            );
        }
        let name = format!("GPS_{number}_PROTOCOL");
        let stated = parameters(&name);
        let protocol = PROTOCOLS.iter().find(|(known, _)| Some(*known) == stated).map(|(_, protocol)| *protocol);
        note_text(receiver, "protocol", protocol, &name);
    }
    *receivers = known(all);
}

/// Position parameters: the sensor, and the parts of the name before and after the axis.
const PLACES: &[(&str, &str)] = &[
    ("gps", "GPS1_POS_"),
    ("gps", "GPS_POS1_"),
    ("gps", "SENS_GPS0_OFF"),
    ("gps", "EKF2_GPS_POS_"),
    ("gps-2", "GPS2_POS_"),
    ("gps-2", "GPS_POS2_"),
    ("gps-2", "SENS_GPS1_OFF"),
    ("imu", "INS_POS1_"),
    ("imu", "EKF2_IMU_POS_"),
    ("imu-2", "INS_POS2_"),
];

/// Sensor positions. Of two parameters for one sensor the one that is set counts, otherwise the first.
pub(in crate::format) fn lever_arms(parameters: &Parameters<'_>) -> Vec<LeverArm> {
    let mut arms: Vec<LeverArm> = vec![];
    for (sensor, name) in PLACES {
        let axis = |axis: &str| parameters(&format!("{name}{axis}")).filter(|value| value.is_finite());
        let (Some(forward_m), Some(right_m), Some(down_m)) = (axis("X"), axis("Y"), axis("Z")) else { continue };
        let arm =
            LeverArm { sensor: (*sensor).to_owned(), parameter: format!("{name}X/Y/Z"), forward_m, right_m, down_m };
        match arms.iter_mut().find(|known| known.sensor == arm.sensor) {
            Some(known) if !known.is_set() && arm.is_set() => *known = arm,
            Some(_) => {}
            None => arms.push(arm),
        }
    }
    arms
}

/// The first of these parameters that has a numeric value in the log.
fn first_of(parameters: &Parameters<'_>, names: &[&'static str; 2]) -> Option<(f64, &'static str)> {
    names.iter().find_map(|name| Some((parameters(name).filter(|value| value.is_finite())?, *name)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    fn stated(parameters: &[(&str, f64)]) -> BTreeMap<String, f64> {
        parameters.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect()
    }

    #[test]
    fn ardupilot_parameters_give_type_rate_and_port_of_each_receiver() {
        for (kind, rate, other) in
            [("GPS_TYPE", "GPS_RATE_MS", "GPS_TYPE2"), ("GPS1_TYPE", "GPS1_RATE_MS", "GPS2_TYPE")]
        {
            let all = stated(&[
                (kind, 2.0),
                (rate, 125.0),
                (other, 9.0),
                ("SERIAL1_PROTOCOL", 2.0),
                ("SERIAL1_BAUD", 57.0),
                ("SERIAL3_PROTOCOL", 5.0),
                ("SERIAL3_BAUD", 230.0),
                ("SERIAL4_PROTOCOL", 5.0),
                ("SERIAL4_BAUD", 38.0),
            ]);
            let receivers = of_ardupilot(&|name| all.get(name).copied(), &[]);
            let known: Vec<_> =
                receivers.iter().map(|r| (r.number, r.protocol.as_deref().unwrap(), r.rate_hz, r.baud)).collect();
            assert_eq!(known, [(1, "UBX", Some(8.0), Some(230_400)), (2, "DroneCAN", None, None)]);
            assert_eq!(receivers[0].sources["baud"], "SERIAL3_BAUD");
        }
    }

    #[test]
    fn what_the_autopilot_detected_overrides_what_was_configured() {
        let all =
            stated(&[("GPS_TYPE", 1.0), ("GPS_RATE_MS", 200.0), ("SERIAL3_PROTOCOL", 5.0), ("SERIAL3_BAUD", 38.0)]);
        let texts = ["GPS 1: probing for u-blox at 9600 baud", "GPS 1: detected as u-blox at 115200 baud"];
        let receivers = of_ardupilot(&|name| all.get(name).copied(), &texts.map(str::to_owned));
        assert_eq!((receivers.len(), receivers[0].baud, receivers[0].rate_hz), (1, Some(115_200), Some(5.0)));
        assert!(receivers[0].sources["baud"].contains("detected"));
        // A receiver that is switched off is omitted, and so is a rate without meaning.
        let all = stated(&[("GPS_TYPE", 0.0), ("GPS_RATE_MS", 200.0)]);
        assert_eq!(of_ardupilot(&|name| all.get(name).copied(), &[]), []);
        let all = stated(&[("GPS_TYPE", 2.0), ("GPS_RATE_MS", 0.0)]);
        assert_eq!(of_ardupilot(&|name| all.get(name).copied(), &[])[0].rate_hz, None);
    }

    #[test]
    fn px4_baud_rate_is_that_of_the_receivers_port() {
        let all = stated(&[
            ("GPS_1_CONFIG", 102.0),
            ("SER_TEL2_BAUD", 115_200.0),
            ("SER_GPS1_BAUD", 0.0),
            ("GPS_1_PROTOCOL", 6.0),
        ]);
        let mut receivers = vec![];
        of_px4(&|name| all.get(name).copied(), &mut receivers);
        assert_eq!((receivers[0].baud, receivers[0].protocol.as_deref()), (Some(115_200), Some("NMEA")));
        let all = stated(&[("GPS_1_CONFIG", 201.0), ("SER_GPS1_BAUD", 0.0), ("GPS_1_PROTOCOL", 0.0)]);
        let mut receivers = vec![];
        of_px4(&|name| all.get(name).copied(), &mut receivers);
        assert_eq!(receivers, []);
    }

    #[test]
    fn lever_arms_are_found_under_the_parameter_names_of_every_autopilot() {
        let of = |name: &str, x: f64| [("X", x), ("Y", 0.0), ("Z", -0.2)].map(|(axis, v)| (format!("{name}{axis}"), v));
        for (name, sensor) in [
            ("GPS_POS1_", "gps"),
            ("GPS1_POS_", "gps"),
            ("EKF2_GPS_POS_", "gps"),
            ("GPS_POS2_", "gps-2"),
            ("INS_POS1_", "imu"),
            ("EKF2_IMU_POS_", "imu"),
            ("SENS_GPS0_OFF", "gps"),
        ] {
            let all: BTreeMap<String, f64> = of(name, 0.35).into();
            let arms = lever_arms(&|name| all.get(name).copied());
            assert_eq!(
                (arms.len(), arms[0].sensor.as_str(), arms[0].forward_m, arms[0].down_m),
                (1, sensor, 0.35, -0.2)
            );
        }
        let all: BTreeMap<String, f64> =
            stated(&[("SENS_GPS0_OFFX", 0.0), ("SENS_GPS0_OFFY", 0.0), ("SENS_GPS0_OFFZ", 0.0)])
                .into_iter()
                .chain(of("EKF2_GPS_POS_", 0.1))
                .collect();
        let arms = lever_arms(&|name| all.get(name).copied());
        assert_eq!((arms.len(), arms[0].parameter.as_str()), (1, "EKF2_GPS_POS_X/Y/Z"));
    }
}
