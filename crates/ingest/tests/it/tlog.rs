//! MAVLink telemetry: a simulated flight, frames of pymavlink, and everything that can go wrong.

use crate::support::*;
use crate::telemetry::*;
use flight::{Clock, Severity, StampKind};
use ingest::{LogKind, TlogReader};
use simulate::Container;

const READER: Reader = |path| Box::new(TlogReader::new(vec![path]));

/// Frames with their times as pymavlink 2.4.50 writes them, 10 ms apart from 2026-11-21T12:00:00Z: a heartbeat, a
/// GPS_RAW_INT in MAVLink 2 and in 1, a signed ATTITUDE whose last floats are zero, and a GLOBAL_POSITION_INT of vehicle 2.
fn of_pymavlink() -> Vec<u8> {
    bytes_of(
        "000660c819a17000fd0900000001010000000a0000000103510403fd23000660c819a19710fd340000000101180000246ae60300\
         0000004c52401c44f41705bb72070048006e00d204366a030e532a0800dc050000c40900002c01000028000000504607d9000660\
         c819a1be20fe1e000101186477e903000000004d52401c45f41705bc72070048006e00d304376a030e061e000660c819a1e530fd\
         1001000001011e0000dcff00000000003e000080be0000c03f9b270305000000000091e54f8798f4000660c819a20c40fd1c0000\
         000201210000400001004c52401c44f4170540720700e8030000640038ff1e00366a8d83",
    )
}

/// CRC-16/MCRF4XX.
fn checksum(crc: u16, byte: u8) -> u16 {
    (0..8).fold(crc ^ u16::from(byte), |crc, _| if crc & 1 == 0 { crc >> 1 } else { crc >> 1 ^ 0x8408 })
}

/// A MAVLink 2 frame with a time, in whose checksum `extra` stands for the layout.
fn frame(time_us: u64, [system, component]: [u8; 2], number: u32, flags: u8, extra: u8, payload: &[u8]) -> Vec<u8> {
    let [a, b, c, _] = number.to_le_bytes();
    let body = [&[payload.len() as u8, flags, 0, 0, system, component, a, b, c], payload].concat();
    let crc = body.iter().chain([&extra]).fold(0xffff, |crc, byte| checksum(crc, *byte));
    [&time_us.to_be_bytes()[..], &[0xfd], &body, &crc.to_le_bytes()].concat()
}

const NOON_US: u64 = 1_795_262_400_000_000;

#[test]
fn a_simulated_flight_comes_back_within_the_quantum_of_its_frames() {
    let flight = flight(20.0, 50.0);
    let truth = flight.to_flight().unwrap();
    let start_ns = flight.settings.start.0 - 60_000_000_000;
    for name in ["flight.tlog", "flight.dat"] {
        let loaded = load_written(Container::Tlog, &flight, name, "mavlink-tlog");
        let channel = |name: &str| &loaded.flight.channels[name];
        let timeline = channel("position.gps").series.timeline();
        assert_eq!((timeline.kind(), timeline.clock()), (StampKind::Measured, Clock::Boot));
        let half = 0.5001e-7_f64.to_radians();
        for name in ["position.gps", "position.truth"] {
            let (position, late) = worst(channel(name), &truth.channels[name], |ns| ns + start_ns);
            assert!(position[0] > 0.0 && position[0] <= half && position[1] <= half, "{position:?}");
            assert!(position[2] > 0.0 && position[2] <= 0.000_500_1 && late <= 500, "{position:?} {late}");
        }
        let (velocity, late) = worst(channel("velocity.ekf"), &truth.channels["velocity.gps"], |ns| ns + start_ns);
        assert!(velocity.iter().all(|v| *v > 0.0 && *v <= 5e-6) && late <= 500_000, "{velocity:?} {late}");
        let about = &loaded.health.about;
        assert_eq!(
            (about.system.as_deref(), about.firmware.as_deref()),
            (Some("ArduPlane"), Some("V4.5.7 (0a1b2c3d)"))
        );
        assert_eq!((about.configured_delays[0].value_s, about.modes[0].mode.as_str()), (0.22, "AUTO"));
        assert_eq!(about.modes.len(), 1);
        // SYSTEM_TIME is exact here.
        let utc = loaded.health.utc.as_ref().unwrap();
        assert!((utc.offset_ns - start_ns).abs() <= 500_000 && utc.pairs == 20, "{utc:?}");
    }
}

#[test]
fn frames_of_pymavlink_have_the_values_that_it_was_given() {
    let log = read_bytes(READER, &of_pymavlink()).unwrap();
    assert_eq!((log.health.messages, log.health.bytes.damaged, log.health.bytes.skipped), (5, 0, 0));
    let all = |topic: &str, expected: &[(&str, &[f64])]| {
        for (field, expected) in expected {
            let expected: Vec<_> = expected.iter().map(|v| Some(*v)).collect();
            assert_eq!(values(&log, topic, field), expected, "{topic}.{field}");
        }
    };
    all("GPS_RAW_INT", &[("time_usec", &[65_432_100.0, 65_632_100.0]), ("lat", &[473_977_420.0, 473_977_421.0])]);
    all("GPS_RAW_INT", &[("vel", &[1234.0, 1235.0]), ("cog", &[27_190.0, 27_191.0]), ("fix_type", &[3.0; 2])]);
    // MAVLink 1 does not have the fields that came later.
    assert_eq!(values(&log, "GPS_RAW_INT", "alt_ellipsoid"), [Some(535_123.0), None]);
    assert_eq!(values(&log, "GPS_RAW_INT", "yaw"), [Some(18_000.0), None]);
    // Zeros that were cut off are back.
    all("ATTITUDE", &[("roll", &[0.125]), ("pitch", &[-0.25]), ("yaw", &[1.5]), ("yawspeed", &[0.0])]);
    all("GLOBAL_POSITION_INT@2", &[("vx", &[100.0]), ("vy", &[-200.0]), ("relative_alt", &[1000.0])]);
    let logged = table(&log, "GPS_RAW_INT").logged_ns.as_ref().unwrap();
    assert_eq!(*logged, [10_000, 20_000].map(|us| (NOON_US as i64 + us) * 1000));
    assert_eq!(log.health.about.modes[0].mode, "AUTO");
    assert_eq!(log.health.about.modes[0].clock, Clock::Unix);
}

#[test]
fn the_vehicle_with_the_smallest_number_has_the_plain_names() {
    let heartbeat = |sender, autopilot| frame(NOON_US, sender, 0, 0, 50, &[0, 0, 0, 0, 1, autopilot, 0, 4, 3]);
    let bytes = [
        // Ground station, camera of vehicle 7, vehicles 9 and 7.
        frame(NOON_US, [255, 190], 0, 0, 50, &[0, 0, 0, 0, 6, 8, 0, 4, 3]),
        frame(NOON_US, [3, 100], 0, 0, 50, &[0, 0, 0, 0, 30, 8, 0, 4, 3]),
        heartbeat([9, 1], 3),
        heartbeat([7, 1], 3),
        frame(NOON_US, [7, 197], 2, 0, 137, &[1]),
    ];
    let log = read_bytes(READER, &bytes.concat()).unwrap();
    let names: Vec<&str> = log.tables.iter().map(|t| t.topic.name.as_str()).collect();
    assert_eq!(names, ["HEARTBEAT", "HEARTBEAT@255.190", "HEARTBEAT@3.100", "HEARTBEAT@9", "SYSTEM_TIME@7.197"]);
    assert!(log.tables.iter().all(|t| t.topic.type_name == t.topic.name.split('@').next().unwrap()));
}

#[test]
fn a_message_that_is_not_defined_must_have_the_same_layout_every_time() {
    let own = |extra| frame(NOON_US, [1, 1], 999_999, 0, extra, &[1, 2, 3]);
    let log = read_bytes(READER, &[of_pymavlink(), own(77), own(77), own(78), of_pymavlink()].concat()).unwrap();
    assert_eq!(messages(&log, "MESSAGE_999999"), 2);
    assert_eq!((log.health.messages, log.health.damage_count), (12, 1));
    assert!(log.notices.iter().any(|n| n.code == "unknown-message" && n.count == 2));
    let log = read_bytes(READER, &[of_pymavlink(), frame(NOON_US, [1, 1], 0, 2, 50, &[0; 9])].concat()).unwrap();
    assert!(log.notices.iter().any(|n| n.code == "unknown-flags" && n.severity == Severity::Loss));
}

/// Where records begin, and the end.
fn boundaries(bytes: &[u8]) -> Vec<usize> {
    let mut all = vec![0];
    while let Some(head) = bytes.get(all[all.len() - 1] + 8..).filter(|rest| !rest.is_empty()) {
        let signature = if head[2] & 1 == 1 { 13 } else { 0 };
        all.push(all[all.len() - 1] + 8 + 12 + usize::from(head[1]) + signature);
    }
    all
}

#[test]
fn a_log_cut_anywhere_gives_the_frames_before_the_cut_and_says_so() {
    let bytes = seed(Container::Tlog);
    let (whole, ends) = (rows(&read_bytes(READER, &bytes).unwrap()), boundaries(&bytes));
    each_cut(READER, &bytes, |log, length| {
        let intact = ends.iter().filter(|end| **end <= length).count() - 1;
        let Ok(log) = log else { return assert_eq!(intact, 0, "{length}") };
        assert_eq!(log.health.messages, intact as u64, "{length}");
        assert_eq!(log.health.bytes.damaged == 0, ends.contains(&length), "{length}: {:?}", log.health.damage);
        for (topic, rows) in rows(log) {
            assert_eq!(rows, whole[&topic][..rows.len()], "{length}");
        }
    });
}

#[test]
fn no_flipped_bit_changes_a_value_and_none_costs_a_frame_in_silence() {
    check_flips(1);
}

#[test]
#[ignore = "all single bits, some seconds to a minute"]
fn no_flipped_bit_at_all_changes_a_value_and_none_costs_a_frame_in_silence() {
    check_flips(8);
}

fn check_flips(bits_of_each_byte: usize) {
    let bytes = seed(Container::Tlog);
    let whole = read_bytes(READER, &bytes).unwrap();
    let (truth, places) = (rows(&whole), boundaries(&bytes));
    let signed = |at: usize| bytes[at + 10] & 1 == 1;
    each_flip(READER, &bytes, bits_of_each_byte, |log, place, bit| {
        let found = rows(log);
        assert_eq!(missing(&found, &truth), 0, "byte {place}, bit {bit}: a value changed");
        let record = places.iter().position(|at| *at > place).unwrap() - 1;
        // The time in front and the signature behind are in no checksum.
        let within = place - places[record];
        let outside = within < 8 || (signed(places[record]) && place + 13 >= places[record + 1]);
        let lost = u64::from(!outside);
        assert_eq!(log.health.messages + lost, whole.health.messages, "byte {place}, bit {bit}");
        assert_eq!(log.health.bytes.damaged > 0, !outside, "byte {place}, bit {bit}");
    });
}

#[test]
fn garbage_between_frames_is_damage_and_nothing_else_is_lost() {
    let bytes = [of_pymavlink(), vec![0xfd; 700], of_pymavlink(), vec![0; 300_000], of_pymavlink()].concat();
    let log = read_bytes(READER, &bytes).unwrap();
    assert_eq!((log.health.messages, log.health.bytes.damaged), (15, 300_700), "{:?}", log.health.damage);
}

#[test]
fn what_is_no_log_is_refused() {
    for (bytes, reason) in [
        (&b""[..], "empty"),
        (&[0; 5000], "zero bytes"),
        (&[0x17; 5000], "nothing in it is intact"),
        (b"a letter to a friend, in which nothing is measured at all", "text"),
    ] {
        let error = read_bytes(READER, bytes).unwrap_err().to_string();
        assert!(error.contains(reason), "{error}");
    }
    let (folder, _path) = file("flight.bin", &of_pymavlink());
    let found = ingest::discover(folder.path(), &ingest::MapLibrary::shipped().unwrap()).unwrap();
    assert_eq!(found.units[0].kind, LogKind::Tlog);
}
