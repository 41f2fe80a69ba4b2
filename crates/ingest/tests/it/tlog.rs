//! MAVLink telemetry: a simulated flight, frames of pymavlink, and all kinds of damage.

use crate::stream::*;
use crate::support::*;
use crate::wire::{crc16, tlog_frame, tlog_frame_from};
use flight::{Clock, Severity, StampKind};
use ingest::LogKind;
use simulate::Container;

const READER: ingest::LogKind = ingest::LogKind::Tlog;

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

const NOON_US: u64 = 1_795_262_400_000_000;

#[test]
fn a_simulated_flight_survives_within_the_resolution_of_its_frames() {
    let flight = flight(20.0, 50.0);
    let truth = flight.to_flight().unwrap();
    let start_ns = flight.settings.start.0 - 60_000_000_000;
    for name in ["flight.tlog", "flight.dat"] {
        let loaded = load_written(Container::Tlog, &flight, name, LogKind::Tlog, "mavlink-tlog");
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
fn pymavlink_frames_decode_to_the_values_given_to_it() {
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
    // Truncated trailing zeros are restored.
    all("ATTITUDE", &[("roll", &[0.125]), ("pitch", &[-0.25]), ("yaw", &[1.5]), ("yawspeed", &[0.0])]);
    all("GLOBAL_POSITION_INT@2", &[("vx", &[100.0]), ("vy", &[-200.0]), ("relative_alt", &[1000.0])]);
    let logged = table(&log, "GPS_RAW_INT").logged_ns.as_ref().unwrap();
    assert_eq!(*logged, [10_000, 20_000].map(|us| (NOON_US as i64 + us) * 1000));
    assert_eq!(log.health.about.modes[0].mode, "AUTO");
    assert_eq!(log.health.about.modes[0].clock, Clock::Unix);
}

#[test]
fn the_vehicle_with_the_lowest_id_gets_the_plain_names() {
    let heartbeat =
        |sender, autopilot| tlog_frame_from(sender, 0, NOON_US, 0, 50, &[0, 0, 0, 0, 1, autopilot, 0, 4, 3]);
    let bytes = [
        // Ground station, camera of vehicle 7, vehicles 9 and 7.
        tlog_frame_from([255, 190], 0, NOON_US, 0, 50, &[0, 0, 0, 0, 6, 8, 0, 4, 3]),
        tlog_frame_from([3, 100], 0, NOON_US, 0, 50, &[0, 0, 0, 0, 30, 8, 0, 4, 3]),
        heartbeat([9, 1], 3),
        heartbeat([7, 1], 3),
        tlog_frame_from([7, 197], 0, NOON_US, 2, 137, &[1]),
    ];
    let log = read_bytes(READER, &bytes.concat()).unwrap();
    let names: Vec<&str> = log.tables.iter().map(|t| t.topic.name.as_str()).collect();
    assert_eq!(names, ["HEARTBEAT", "HEARTBEAT@255.190", "HEARTBEAT@3.100", "HEARTBEAT@9", "SYSTEM_TIME@7.197"]);
    assert!(log.tables.iter().all(|t| t.topic.type_name == t.topic.name.split('@').next().unwrap()));
}

#[test]
fn damage_in_a_log_with_an_unset_clock_costs_only_its_own_record() {
    let attitude = |i: u64, at_us: u64| tlog_frame(at_us, 30, 39, &[&(i as u32).to_le_bytes()[..], &[1; 24]].concat());
    for begin_us in [0, 315_532_800_000_000 - 3_600_000_000, NOON_US] {
        let records: Vec<Vec<u8>> = (0..100).map(|i| attitude(i, begin_us + 20_000 * i)).collect();
        for hit in [0, 1, 50, 98, 99] {
            let mut damaged = records.clone();
            let middle = damaged[hit].len() / 2;
            damaged[hit][middle] ^= 1;
            let log = read_bytes(READER, &damaged.concat()).unwrap();
            assert_eq!(log.health.messages, 99, "{begin_us}, {hit}: {:?}", log.health.damage);
            damaged[hit].remove(middle);
            let log = read_bytes(READER, &damaged.concat()).unwrap();
            assert_eq!(log.health.messages, 99, "{begin_us}, {hit}: {:?}", log.health.damage);
        }
    }
}

#[test]
fn serial_output_before_a_stream_costs_no_frames() {
    let without_timestamps =
        |i: u64| tlog_frame(NOON_US, 30, 39, &[&(i as u32).to_le_bytes()[..], &[1; 24]].concat())[8..].to_vec();
    let stream: Vec<u8> = (0..300).flat_map(without_timestamps).collect();
    for front in [100, 4096, 5740] {
        let text = b"nsh> booting the vehicle\r\n".repeat(front / 26 + 1);
        let log = read_bytes(READER, &[&text[..front], b"\r\n", &stream].concat()).unwrap();
        assert_eq!((log.health.messages, log.health.bytes.damaged), (300, 0), "{front}: {:?}", log.health.damage);
    }
    for junk in [vec![0; 70_000], vec![0xe5; 70_000], b"nsh> booting the vehicle\r\n".repeat(5000)] {
        let log = read_bytes(READER, &[&junk[..], &stream].concat()).unwrap();
        assert_eq!(log.health.messages, 300);
    }
    let stamped: Vec<u8> = (0..300).flat_map(|i| tlog_frame(NOON_US + i, 30, 39, &[7; 28])).collect();
    let log = read_bytes(READER, &[&b"a logger's remark\n"[..], &stamped].concat()).unwrap();
    assert_eq!((log.health.messages, log.health.bytes.damaged, log.health.bytes.skipped), (300, 0, 18));
    // The end of a heartbeat, which could be misread as a time from 1970 on.
    let front = [0, 6, 8, 0, 0, 3, 0x51, 0x40];
    let log = read_bytes(READER, &[&front[..], &stream].concat()).unwrap();
    assert_eq!(log.health.messages, 300, "{:?}", log.health.damage);
}

/// Offsets of the records, and of the end.
fn boundaries(bytes: &[u8]) -> Vec<usize> {
    let mut all = vec![0];
    while let Some(head) = bytes.get(all[all.len() - 1] + 8..).filter(|rest| !rest.is_empty()) {
        let signature = if head[2] & 1 == 1 { 13 } else { 0 };
        all.push(all[all.len() - 1] + 8 + 12 + usize::from(head[1]) + signature);
    }
    all
}

#[test]
fn a_log_cut_anywhere_gives_the_frames_before_the_cut_and_reports_it() {
    let bytes = seed(Container::Tlog);
    let ends = boundaries(&bytes);
    check_cuts(READER, &bytes, 0..bytes.len(), &ends, |length| ends.contains(&length));
}

#[test]
fn no_flipped_bit_changes_a_value_or_loses_a_frame_silently() {
    check_flips(1);
}

#[test]
#[ignore = "all single bits, some seconds to a minute"]
fn no_single_bit_flip_at_all_changes_a_value_or_loses_a_frame_silently() {
    check_flips(8);
}

fn check_flips(bits_of_each_byte: usize) {
    let bytes = seed(Container::Tlog);
    let whole = read_bytes(READER, &bytes).unwrap();
    let (truth, places) = (rows(&whole), boundaries(&bytes));
    let signed = |at: usize| bytes[at + 10] & 1 == 1;
    each_flip(READER, &bytes, bits(0..bytes.len(), bits_of_each_byte), |log, place, bit| {
        let found = rows(log);
        assert_eq!(missing(&found, &truth), 0, "byte {place}, bit {bit}: a value changed");
        let record = places.iter().position(|at| *at > place).unwrap() - 1;
        // No checksum covers the leading timestamp and the trailing signature.
        let within = place - places[record];
        let outside = within < 8 || (signed(places[record]) && place + 13 >= places[record + 1]);
        let lost = u64::from(!outside);
        assert_eq!(log.health.messages + lost, whole.health.messages, "byte {place}, bit {bit}");
        assert_eq!(log.health.bytes.damaged > 0, !outside, "byte {place}, bit {bit}");
    });
}

#[test]
fn garbage_between_frames_is_damage_and_costs_no_frames() {
    let bytes = [of_pymavlink(), vec![0xfd; 700], of_pymavlink(), vec![0; 300_000], of_pymavlink()].concat();
    let log = read_bytes(READER, &bytes).unwrap();
    assert_eq!((log.health.messages, log.health.bytes.damaged), (15, 300_700), "{:?}", log.health.damage);
}

#[test]
fn what_is_no_log_is_refused() {
    check_refusals(READER, "text");
    let (folder, _path) = file("flight.bin", &of_pymavlink());
    let found = ingest::discover(folder.path(), &ingest::MapLibrary::shipped().unwrap()).unwrap();
    assert_eq!(found.units[0].kind, LogKind::Tlog);
}

/// The frames of one boot, ten positions and one SYSTEM_TIME a second: time since boot of the first, and its time,
/// ms after noon. They are received 40 to 60 ms later.
struct Boot {
    from_ms: u64,
    at_ms: u64,
    /// What SYSTEM_TIME says instead of the true time after noon, ms.
    utc: Option<fn(u64) -> u64>,
}

const ROWS: u64 = 100;
const TRUE: Option<fn(u64) -> u64> = Some(|ms| ms);

impl Boot {
    fn frames(&self) -> Vec<u8> {
        let row = |row: u64| {
            let (boot_ms, at_ms) = ((self.from_ms + 100 * row) as u32, self.at_ms + 100 * row);
            let received_us = NOON_US + 1000 * (at_ms + 40 + 10 * (row % 3));
            let position = [row as f32, 1.0, 2.0, 1.0, 1.0, 1.0].map(f32::to_le_bytes).concat();
            let system_time = self.utc.filter(|_| row.is_multiple_of(10)).map(|utc| {
                let unix = (NOON_US + 1000 * utc(at_ms)).to_le_bytes();
                // Written before an earlier frame.
                tlog_frame(received_us + 9000, 2, 137, &[&unix[..], &boot_ms.to_le_bytes()].concat())
            });
            let position = tlog_frame(received_us, 32, 185, &[&boot_ms.to_le_bytes()[..], &position].concat());
            [system_time.unwrap_or_default(), position].concat()
        };
        (0..ROWS).flat_map(row).collect()
    }
}

fn load_boots(boots: &[Boot]) -> ingest::Loaded {
    let (_folder, path) = file("log.tlog", &boots.iter().flat_map(Boot::frames).collect::<Vec<u8>>());
    let unit = ingest::FlightUnit { id: "log".into(), files: vec![path], kind: LogKind::Tlog };
    let loaded = load(&unit).unwrap();
    assert_ledger(&loaded);
    loaded
}

/// UTC error of all positions, ms.
fn off_ms(loaded: &ingest::Loaded, boots: &[Boot]) -> Vec<f64> {
    let stamps = loaded.flight.channels["position.ekf"].series.timeline().stamps();
    let utc = stamps.iter().map(|s| loaded.flight.unix(Clock::Boot, *s).unwrap().0);
    let truth = boots.iter().flat_map(|b| (0..ROWS).map(|row| (NOON_US + 1000 * (b.at_ms + 100 * row)) as i64 * 1000));
    assert_eq!(stamps.len() as u64, ROWS * boots.len() as u64, "{:?}", loaded.flight.notices);
    utc.zip(truth).map(|(utc, truth)| (utc - truth) as f64 * 1e-6).collect()
}

#[test]
fn every_boot_in_one_log_keeps_its_rows_at_their_true_time() {
    let boot = |from_ms, at_ms, utc| Boot { from_ms, at_ms, utc };
    // Restarts below and above the end of the first, twice, at once, and at a position that other rows have.
    for later in [
        &[(3037, 40_000)][..],
        &[(90_000, 60_000)],
        &[(3000, 40_000), (9000, 70_000)],
        &[(2000, 11_500)],
        &[(50_037, 30_000)],
    ] {
        let boots = |utc| -> Vec<Boot> {
            let later = later.iter().map(|(from, at)| boot(*from, *at, utc));
            [boot(50_000, 0, utc)].into_iter().chain(later).collect()
        };
        let loaded = load_boots(&boots(TRUE));
        assert!(off_ms(&loaded, &boots(TRUE)).iter().all(|off| *off == 0.0), "{later:?}");
        assert_eq!(count_of(&loaded, "several-sessions"), later.len() as u64, "{later:?}");
        assert_eq!(
            (count_saying(&loaded, "utc-tie", "by more than a second"), count_of(&loaded, "unreliable-stamps")),
            (0, 0),
            "{later:?}"
        );
        assert!(!lossy(&loaded));
        let first = loaded.flight.channels["position.ekf"].series.timeline().first().unwrap();
        assert_eq!(first.0, 50_000_000_000, "{later:?}");
        if later[0].0 >= 60_000 {
            // Without its own dates, a restart that did not go back looks like a gap.
            continue;
        }
        // Receive times are the fallback if UTC is absent or the same for every boot.
        let loaded = load_boots(&boots(None));
        let off = off_ms(&loaded, &boots(None));
        assert!(off.iter().all(|off| *off == 50.0), "{later:?}: {off:?}");
        let again = boots(Some(|ms| 1000 + ms % 10_000));
        assert!(off_ms(&load_boots(&again), &again).iter().all(|off| *off == 50.0), "{later:?}");
    }
}

/// When a message reaches the ground station, ms after it was sent: drifting from 10 to 110, plus a few ms of jitter.
fn latency_ms(sent_ms: u64) -> u64 {
    let slow = 60.0 + 50.0 * (sent_ms as f64 * 1e-3 * 0.7).sin();
    slow as u64 + sent_ms * 7 % 4
}

/// A flight of 20 s in which ATTITUDE is sent every 50 ms with its time, and AHRS2 and SIMSTATE without, 20 ms after
/// every second one: their latitude is the time at which they were sent.
fn untimed(from_ms: u64, at_ms: u64) -> Vec<u8> {
    let row = |row: u64| {
        let (boot_ms, at_ms) = (from_ms + 50 * row, at_ms + 50 * row);
        let received_us = |sent_ms: u64| NOON_US + 1000 * (sent_ms + latency_ms(sent_ms));
        let attitude =
            tlog_frame(received_us(at_ms), 30, 39, &[&(boot_ms as u32).to_le_bytes()[..], &[0; 24]].concat());
        if row % 2 == 1 {
            return attitude;
        }
        let place = [boot_ms as i32 + 20, 85_000_000].map(i32::to_le_bytes).concat();
        let ahrs2 = [&[0; 12][..], &100_f32.to_le_bytes(), &place].concat();
        let simstate = [&[0; 36][..], &place].concat();
        let at_us = received_us(at_ms + 20);
        [attitude, tlog_frame(at_us, 178, 47, &ahrs2), tlog_frame(at_us, 164, 154, &simstate)].concat()
    };
    (0..400).flat_map(row).collect()
}

fn load_log(bytes: &[u8]) -> ingest::Loaded {
    let (_folder, path) = file("log.tlog", bytes);
    load(&ingest::FlightUnit { id: "log".into(), files: vec![path], kind: LogKind::Tlog }).unwrap()
}

/// Timestamps minus the times in the latitudes, ms.
fn off_by_latitude(channel: &flight::Channel) -> Vec<f64> {
    let sent = channel.series.components()[0].iter().map(|latitude| (latitude.to_degrees() * 1e7).round());
    channel.series.timeline().stamps().iter().zip(sent).map(|(stamp, sent)| stamp.0 as f64 * 1e-6 - sent).collect()
}

#[test]
fn messages_without_a_time_get_boot_time_from_their_neighbours() {
    let loaded = load_log(&untimed(5000, 0));
    let attitude = loaded.flight.channels["attitude.ekf"].series.timeline().clock();
    for name in ["position.ahrs2", "position.truth-simstate"] {
        let channel = &loaded.flight.channels[name];
        let timeline = channel.series.timeline();
        assert_eq!((timeline.kind(), timeline.clock(), timeline.stamps().len()), (StampKind::Measured, attitude, 200));
        let off = off_by_latitude(channel);
        assert!(off.iter().all(|off| off.abs() < 5.0), "{name}: {off:?}");
        // By the ground station's clock alone they would differ by the change in latency.
        let logged = channel.other_stamps.iter().find(|(kind, ..)| *kind == StampKind::Logged).unwrap();
        let late: Vec<i64> = logged.2.iter().zip(timeline.stamps()).map(|(logged, own)| logged.0 - own.0).collect();
        assert!(late.iter().max().unwrap() - late.iter().min().unwrap() > 90_000_000);
    }
    let said: Vec<_> = loaded.flight.notices.iter().filter(|n| n.code == "stamp-kind").collect();
    assert_eq!(said.len(), 2, "{said:?}");
    assert!(
        said[0].text.contains("between messages of ATTITUDE") && said[0].text.contains("0.050 s at most"),
        "{said:?}"
    );
}

#[test]
fn messages_without_a_time_follow_their_vehicle_across_a_restart() {
    let loaded = load_log(&[untimed(50_000, 0), untimed(3000, 40_000)].concat());
    assert_eq!(count_of(&loaded, "several-sessions"), 1);
    // The sessions are as far apart as for messages that carry their time.
    let attitude = loaded.flight.channels["attitude.ekf"].series.timeline().stamps();
    let moved_ms = attitude[400].0 as f64 * 1e-6 - 3000.0;
    assert!((moved_ms - 87_000.0).abs() < 100.0, "{moved_ms}");
    let off = off_by_latitude(&loaded.flight.channels["position.ahrs2"]);
    assert_eq!((attitude.len(), off.len()), (800, 400));
    assert!(off[..200].iter().all(|off| off.abs() < 5.0), "{off:?}");
    assert!(off[200..].iter().all(|off| (off - moved_ms).abs() < 5.0), "{off:?}");
}

#[test]
fn without_any_message_time_the_receive_time_is_used_and_reported() {
    let frame = |row: u64| {
        let place = [row as i32, 85_000_000].map(i32::to_le_bytes).concat();
        tlog_frame(NOON_US + 100_000 * row, 178, 47, &[&[0; 12][..], &100_f32.to_le_bytes(), &place].concat())
    };
    let loaded = load_log(&(0..100).flat_map(frame).collect::<Vec<u8>>());
    let timeline = loaded.flight.channels["position.ahrs2"].series.timeline();
    assert_eq!((timeline.kind(), timeline.clock()), (StampKind::Logged, Clock::Unix));
    assert_eq!(count_saying(&loaded, "stamp-kind", "They are placed on the clock since boot"), 0);
    assert!(count_of(&loaded, "stamp-kind") > 0);
}

#[test]
fn one_boot_with_utc_dates_the_others_by_receive_time() {
    for said in [0, 1] {
        let of = |boot| if boot == said { TRUE } else { None };
        let boots = [Boot { from_ms: 50_000, at_ms: 0, utc: of(0) }, Boot { from_ms: 3037, at_ms: 40_000, utc: of(1) }];
        let off = off_ms(&load_boots(&boots), &boots);
        assert!(off.iter().all(|off| *off == 0.0), "{said}: {off:?}");
    }
}

#[test]
fn setting_the_ground_station_clock_is_not_a_vehicle_restart() {
    let hours_later = |hours: u64| -> Vec<u8> {
        let boots = [Boot { from_ms: 50_000, at_ms: 0, utc: TRUE }, Boot { from_ms: 60_000, at_ms: 10_000, utc: TRUE }];
        let mut second = boots[1].frames();
        let mut at = 0;
        while at < second.len() {
            let time = u64::from_be_bytes(second[at..at + 8].try_into().unwrap()) + hours * 3_600_000_000;
            second[at..at + 8].copy_from_slice(&time.to_be_bytes());
            at += 8 + 12 + usize::from(second[at + 9]);
        }
        [boots[0].frames(), second].concat()
    };
    let (_folder, path) = file("log.tlog", &hours_later(1));
    let unit = ingest::FlightUnit { id: "log".into(), files: vec![path], kind: LogKind::Tlog };
    let loaded = load(&unit).unwrap();
    assert_eq!(count_of(&loaded, "several-sessions"), 0, "{:?}", loaded.flight.notices);
    let stamps = loaded.flight.channels["position.ekf"].series.timeline().stamps();
    assert_eq!((stamps.len(), stamps[199].0 - stamps[0].0), (200, 19_900_000_000));
    assert_eq!(loaded.flight.unix(Clock::Boot, stamps[199]).unwrap().0, (NOON_US + 19_900_000) as i64 * 1000);
}

#[test]
fn message_times_are_utc_or_boot_time_by_size_and_the_topic_says_which() {
    let load_from = |from_us: u64| {
        let gps = |row: u64| {
            let place = [470_000_000 + row as i32, 85_000_000, 500_000].map(i32::to_le_bytes).concat();
            let rest = [100_u16, 100, 1000, 9000].map(u16::to_le_bytes).concat();
            let payload = [&(from_us + 200_000 * row).to_le_bytes()[..], &place, &rest, &[3, 12]].concat();
            tlog_frame(NOON_US + 200_000 * row + 50_000, 24, 24, &payload)
        };
        let boot = Boot { from_ms: 5000, at_ms: 0, utc: TRUE };
        let (_folder, path) = file("log.tlog", &[boot.frames(), (0..50).flat_map(gps).collect()].concat());
        load(&ingest::FlightUnit { id: "log".into(), files: vec![path], kind: LogKind::Tlog }).unwrap()
    };
    for (from_us, clock, reported) in [(NOON_US, Clock::Unix, true), (5_000_000, Clock::Boot, false)] {
        let loaded = load_from(from_us);
        let timeline = loaded.flight.channels["position.gps"].series.timeline();
        assert_eq!((timeline.clock(), timeline.stamps().len()), (clock, 50));
        assert_eq!(timeline.stamps()[0].0, from_us as i64 * 1000);
        for channel in ["position.gps", "position.ekf"] {
            let timeline = loaded.flight.channels[channel].series.timeline();
            let utc = loaded.flight.unix(timeline.clock(), timeline.first().unwrap());
            assert_eq!(utc.unwrap().0, NOON_US as i64 * 1000, "{channel}");
        }
        assert_eq!(count_of(&loaded, "date-inferred") > 0, reported, "{:?}", loaded.flight.notices);
    }
}

#[test]
fn no_flipped_bit_in_a_receive_time_moves_a_timestamp_far_silently() {
    let frames = Boot { from_ms: 5000, at_ms: 0, utc: TRUE }.frames();
    let starts = boundaries(&frames);
    let whole = read_bytes(READER, &frames).unwrap();
    let stamps = |log: &ingest::Log| log.tables.iter().flat_map(|t| t.logged_ns.clone().unwrap()).collect::<Vec<i64>>();
    let truth = stamps(&whole);
    let last = starts.len() - 2;
    for record in [0, 1, 2, 50, last - 1, last] {
        for bit in 0..64 {
            let mut bytes = frames.clone();
            bytes[starts[record] + bit / 8] ^= 0x80 >> (bit % 8);
            let log = read_bytes(READER, &bytes).unwrap();
            let reported = log
                .notices
                .iter()
                .any(|n| n.code == "unreliable-stamps" && n.count == 1 && n.severity == Severity::Loss);
            let off = stamps(&log).iter().zip(&truth).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
            assert_eq!(stamps(&log).len(), truth.len());
            assert_eq!((log.health.bytes.damaged, log.health.messages), (0, whole.health.messages));
            // At the ends of a log, less than a day counts as a gap.
            let most = if record == 0 || record == last { 86_400 } else { 2 };
            assert!(off < most * 1_000_000_000, "{record}, {bit}: {off} ns");
            assert!(!reported || off <= 110_000_000, "{record}, {bit}: {off} ns");
        }
    }
    // In the middle, the error is limited by the neighbours.
    let mut bytes = frames.clone();
    bytes[starts[50]..starts[50] + 8].copy_from_slice(&u64::MAX.to_be_bytes());
    let log = read_bytes(READER, &bytes).unwrap();
    assert!(log.notices.any_loss() && stamps(&log).iter().all(|s| s.abs_diff(truth[0]) < 11_000_000_000));
}

/// The frames without their leading timestamps.
fn without_timestamps(bytes: &[u8]) -> Vec<u8> {
    boundaries(bytes).windows(2).flat_map(|pair| &bytes[pair[0] + 8..pair[1]]).copied().collect()
}

#[test]
fn a_stream_without_receive_times_is_detected_and_has_the_same_messages() {
    let stamped = seed(Container::Tlog);
    let bytes = without_timestamps(&stamped);
    // The first vehicle received is named by its heartbeat.
    let (whole, log) = (read_bytes(READER, &stamped).unwrap(), read_bytes(READER, &bytes).unwrap());
    assert_balanced(&log, bytes.len());
    let without_log_time = |log: &ingest::Log| {
        let mut tables = log.tables.clone();
        tables.iter_mut().for_each(|table| table.logged_ns = None);
        tables
    };
    assert_eq!(log.tables, without_log_time(&whole));
    assert_eq!((log.health.bytes.damaged, log.health.messages), (0, whole.health.messages));
    let reported = log.notices.iter().find(|n| n.code == "stamp-kind").unwrap();
    assert_eq!((reported.severity, reported.count), (Severity::Warning, whole.health.messages));
    assert!(log.health.topics.iter().all(|topic| topic.stamps.is_empty()));
    // Starts inside a frame, after the autopilot's boot text, and with another file extension.
    let (cut, printed) = (bytes[5..].to_vec(), b"\nInit ArduCopter V4.7.0-dev\nBooting 0/0\n".to_vec());
    let booted = [&printed[..], &bytes].concat();
    for (name, bytes, lost, text) in [
        ("flight.tlog.raw", &bytes, 0, 0),
        ("flight.tlog", &bytes, 0, 0),
        ("capture.bin", &cut, 1, 0),
        ("capture.raw", &booted, 0, printed.len() as u64),
    ] {
        let (folder, path) = file(name, bytes);
        let found = ingest::discover(folder.path(), &ingest::MapLibrary::shipped().unwrap()).unwrap();
        assert_eq!(found.units[0].kind, LogKind::Tlog, "{name}");
        let log = read(READER, &path).unwrap();
        assert_eq!(log.health.messages, whole.health.messages - lost, "{name}");
        assert_eq!((log.health.bytes.damaged > 0, log.health.bytes.skipped), (lost > 0, text), "{name}");
    }
}

#[test]
fn a_stream_without_receive_times_uses_boot_time_dated_by_system_time() {
    let boot = Boot { from_ms: 50_000, at_ms: 0, utc: TRUE };
    let load_without_timestamps = |frames: &[u8]| {
        let (_folder, path) = file("log.tlog.raw", &without_timestamps(frames));
        let loaded = load(&ingest::FlightUnit { id: "log".into(), files: vec![path], kind: LogKind::Tlog }).unwrap();
        assert_ledger(&loaded);
        loaded
    };
    let loaded = load_without_timestamps(&boot.frames());
    assert!(off_ms(&loaded, &[boot]).iter().all(|off| *off == 0.0));
    assert!(!lossy(&loaded));
}

#[test]
fn in_a_stream_without_receive_times_only_the_first_boot_is_bound() {
    let boots =
        [50_000, 3000].map(|from_ms| Boot { from_ms, at_ms: if from_ms == 3000 { 40_000 } else { 0 }, utc: TRUE });
    let of = |boots: &[Boot]| without_timestamps(&boots.iter().flat_map(Boot::frames).collect::<Vec<u8>>());
    let loaded_of = |bytes: &[u8]| {
        let (_folder, path) = file("log.tlog.raw", bytes);
        let loaded = load(&ingest::FlightUnit { id: "log".into(), files: vec![path], kind: LogKind::Tlog }).unwrap();
        assert_ledger(&loaded);
        loaded
    };
    let ends = |loaded: &ingest::Loaded| {
        let stamps = loaded.flight.channels["position.ekf"].series.timeline().stamps();
        [stamps[0].0, stamps[stamps.len() - 1].0]
    };
    let first = loaded_of(&of(&boots[..1]));
    let both = loaded_of(&of(&boots));
    assert_eq!((ends(&first), count_of(&first, "undated")), (ends(&both), 0));
    let later: u64 = both.health.topics.iter().filter(|t| t.name.ends_with("#2")).map(|t| t.messages).sum();
    assert_eq!((count_of(&both, "undated"), lossy(&both)), (later, true));
    // It takes a few messages to be sure that the clock restarted.
    assert!(later + 15 >= first.health.messages, "{later} of {}", first.health.messages);
}

/// The detected kind of a file with this name and content.
fn kind(name: &str, bytes: &[u8]) -> Option<LogKind> {
    let (folder, _path) = file(name, bytes);
    let found = ingest::discover(folder.path(), &ingest::MapLibrary::shipped().unwrap()).unwrap();
    found.units.first().map(|unit| unit.kind)
}

/// Messages and damaged bytes of a log with this format name.
fn read_as(format: &str, bytes: &[u8]) -> (u64, u64) {
    let log = read_bytes(READER, bytes).unwrap();
    assert_eq!(log.health.format, format);
    (log.health.messages, log.health.bytes.damaged)
}

const STREAM: &str = "MAVLink stream";

#[test]
fn a_stream_without_receive_times_is_detected_wherever_it_starts() {
    let frames: Vec<Vec<u8>> =
        (0..40).map(|i| without_timestamps(&tlog_frame(NOON_US, 0, 50, &[i, 0, 0, 0, 1, 3, 0, 4, 3]))).collect();
    let own = without_timestamps(&tlog_frame(NOON_US, 54_321, 77, &[1; 20]));
    let mut lost = frames.clone();
    lost[2].pop();
    let second = [&frames[..1], std::slice::from_ref(&own), &frames[1..]].concat();
    let alternating: Vec<Vec<u8>> = frames.iter().flat_map(|frame| [frame.clone(), own.clone()]).collect();
    let cut = alternating.concat()[5..].to_vec();
    let holes: Vec<Vec<u8>> =
        frames.iter().enumerate().map(|(i, frame)| frame[..frame.len() - usize::from(i % 2 == 1)].to_vec()).collect();
    for (name, bytes, messages, damaged) in [
        ("byte.bin", lost.concat(), 39, 20),
        ("second.bin", second.concat(), 41, 0),
        ("alternating.bin", alternating.concat(), 80, 0),
        ("cut.bin", cut, 79, 16),
        ("holes.bin", holes.concat(), 20, 20 * 20),
    ] {
        assert_eq!(kind(name, &bytes), Some(LogKind::Tlog), "{name}");
        assert_eq!(read_as(STREAM, &bytes), (messages, damaged), "{name}");
    }
    // One with receive times that begins inside a frame.
    assert_eq!(kind("flight.bin", &of_pymavlink().repeat(3)[3..]), Some(LogKind::Tlog));
}

#[test]
fn a_few_mavlink_frames_do_not_turn_another_log_into_mavlink() {
    let frames = without_timestamps(&tlog_frame(NOON_US, 0, 50, &[0, 0, 0, 0, 1, 3, 0, 4, 3])).repeat(3);
    let sentence = |i: usize| {
        let text = format!("GPRMC,12{:02}{:02}.00,A,4724.0{i:03},N,00830.0000,E,10.0,45.0,211126,,,A", i / 60, i % 60);
        let sum = text.bytes().fold(0, |sum, byte| sum ^ byte);
        format!("${text}*{sum:02X}\r\n").into_bytes()
    };
    let ubx = |i: usize| crate::wire::ubx_frame(1, 7, &[i as u8; 92]);
    let among = |record: &dyn Fn(usize) -> Vec<u8>| -> Vec<u8> {
        let (before, after) = ((0..20).flat_map(record), (20..200).flat_map(record));
        before.chain(frames.iter().copied()).chain(after).collect()
    };
    assert_eq!(kind("log.bin", &among(&sentence)), Some(LogKind::Nmea));
    assert_eq!(kind("log.bin", &among(&ubx)[70..]), Some(LogKind::Ubx));
    assert_eq!(kind("log.dat", &among(&|i| format!("{i},47.4,8.5\n").into_bytes())), None);
    assert_eq!(kind("log.dat", &among(&|_| vec![])), Some(LogKind::Tlog));
}

/// A frame of an undefined message that contains other frames.
fn tunnel(time_us: u64, inner: &[u8]) -> Vec<u8> {
    tlog_frame(time_us, 54_321, 77, inner)
}

#[test]
fn frames_inside_undefined_frames_are_not_a_stream_and_are_not_read() {
    let inner = without_timestamps(&tlog_frame_from([9, 1], 0, NOON_US, 0, 50, &[0, 0, 0, 0, 1, 3, 0, 4, 3])).repeat(7);
    let frame = |i: u64| tlog_frame(NOON_US + i, 0, 50, &[0, 0, 0, 0, 1, 3, 0, 4, 3]);
    let bytes: Vec<u8> = (0..20).flat_map(|i| [frame(i), tunnel(NOON_US + i, &inner)].concat()).collect();
    assert_eq!(read_as("MAVLink telemetry", &bytes), (40, 0));
    // The first frame contains others, or is damaged.
    let (first, second) = (frame(0).len(), tunnel(0, &inner).len());
    assert_eq!(read_as("MAVLink telemetry", &bytes[first..]), (39, 0));
    assert_eq!(read_as("MAVLink telemetry", &bytes[5..]), (39, (first - 5) as u64));
    // It is the only one, with nothing after it.
    assert_eq!(read_as("MAVLink telemetry", &bytes[..first + second]), (2, 0));
    assert_eq!(read_as(STREAM, &without_timestamps(&bytes)), (40, 0));
}

#[test]
fn bytes_that_only_look_like_a_frame_swallow_no_frames() {
    for has_no_timestamps in [false, true] {
        let plain = |frame: Vec<u8>| if has_no_timestamps { without_timestamps(&frame) } else { frame };
        let heartbeat = plain(tlog_frame(NOON_US, 0, 50, &[0, 0, 0, 0, 1, 3, 0, 4, 3]));
        let position =
            |checksum: [u8; 2]| plain(tlog_frame(NOON_US, 32, 185, &[&[7; 16][..], &checksum, &[7; 10]].concat()));
        // The checksum that completes this false frame is inside the fifth one.
        let until = position([0; 2]).len() - 2 - 12;
        let swallowed = [heartbeat.repeat(4), position([0; 2])[..until].to_vec()].concat();
        let like = plain(tlog_frame(NOON_US, 3_351_057, 99, &swallowed));
        let (begin, checksum) = (&like[..like.len() - 2 - swallowed.len()], &like[like.len() - 2..]);
        let after = [heartbeat.repeat(4), position([checksum[0], checksum[1]])].concat();
        let bytes = [&heartbeat.repeat(4), begin, &after, &heartbeat].concat();
        assert!(bytes.windows(like.len()).any(|window| window == like));
        let log = read_bytes(READER, &bytes).unwrap();
        assert_eq!((log.health.messages, log.health.bytes.damaged), (10, begin.len() as u64), "{has_no_timestamps}");
        assert!(log.health.damage[0].reason.contains("3351057"), "{:?}", log.health.damage);
    }
}

#[test]
fn an_undefined_frame_ending_inside_an_intact_one_swallows_no_frames() {
    for has_no_timestamps in [false, true] {
        let plain = |frame: Vec<u8>| if has_no_timestamps { without_timestamps(&frame) } else { frame };
        let front = if has_no_timestamps { 0 } else { 8 };
        let heartbeat = plain(tlog_frame(NOON_US, 0, 50, &[0, 0, 0, 0, 1, 3, 0, 4, 3]));
        // A wrong length leads to the end of the second frame after it, whose checksum fits some layout.
        let mut swallowed = 0;
        for i in 0..1500_u16 {
            let mut lie = plain(tlog_frame(NOON_US, 54_321, 77, &[&i.to_le_bytes()[..], &[3, 4]].concat()));
            lie[front + 1] += 2 * heartbeat.len() as u8;
            let (from, to) = (front + 1, lie.len() + 2 * heartbeat.len() - 2);
            let bytes = [heartbeat.repeat(4), lie.clone(), heartbeat.repeat(20)].concat();
            let body = &bytes[4 * heartbeat.len()..];
            let checksum = u16::from_le_bytes([body[to], body[to + 1]]);
            let fits = |extra| crate::wire::crc16(&[&body[from..to], &[extra]].concat()) == checksum;
            swallowed += u32::from((0..=u8::MAX).any(fits));
            let log = read_bytes(READER, &bytes).unwrap();
            assert_eq!(
                (log.health.messages, log.health.bytes.damaged),
                (24, lie.len() as u64),
                "{has_no_timestamps} {i}"
            );
        }
        assert!(swallowed > 0, "{has_no_timestamps}");
    }
}

#[test]
fn damage_in_a_stream_without_receive_times_costs_only_what_it_hits() {
    let stamped = seed(Container::Tlog);
    let bytes = without_timestamps(&stamped);
    let ends: Vec<usize> = boundaries(&stamped).iter().enumerate().map(|(record, at)| at - 8 * record).collect();
    // Shorter ones are too short to detect.
    check_cuts(READER, &bytes, ends[3]..bytes.len(), &ends, |length| ends.contains(&length));
    let whole = read_bytes(READER, &bytes).unwrap();
    let truth = rows(&whole);
    let signed = |at: usize| bytes[at + 2] & 1 == 1;
    each_flip(READER, &bytes, bits(ends[3]..bytes.len(), 1), |log, place, bit| {
        assert_eq!(missing(&rows(log), &truth), 0, "byte {place}, bit {bit}: a value changed");
        let record = ends.iter().position(|at| *at > place).unwrap() - 1;
        let outside = signed(ends[record]) && place + 13 >= ends[record + 1];
        assert_eq!(log.health.bytes.damaged > 0, !outside, "byte {place}, bit {bit}");
        assert_eq!(log.health.messages + u64::from(!outside), whole.health.messages, "byte {place}, bit {bit}");
    });
}

#[test]
fn undefined_messages_are_reported_by_id_and_cost_nothing_else() {
    let own = |number: u32| tlog_frame(NOON_US, number, number as u8, &[1, 2, 3]);
    let bytes = [of_pymavlink(), own(54_321), own(54_320), own(54_321), of_pymavlink()].concat();
    let log = read_bytes(READER, &bytes).unwrap();
    let reported = log.notices.iter().find(|n| n.code == "unknown-record").unwrap();
    assert_eq!(reported.count, 3);
    assert!(reported.text.ends_with(": numbers 54320 (1), 54321 (2)"), "{}", reported.text);
    assert_eq!((log.health.messages, log.health.bytes.damaged, log.health.bytes.skipped), (13, 0, 3 * (8 + 12 + 3)));
    // A damaged frame does not cost the next one, although no checksum confirms it.
    let mut damaged = tlog_frame(NOON_US, 0, 50, &[7; 9]);
    damaged[20] ^= 1;
    let bytes = [of_pymavlink(), own(54_321), damaged.clone(), own(54_321), of_pymavlink()].concat();
    let log = read_bytes(READER, &bytes).unwrap();
    assert_eq!((log.health.messages, log.health.bytes.damaged), (12, damaged.len() as u64), "{:?}", log.health.damage);
}

#[test]
fn mavlink_1_frames_with_mavlink_2_fields_are_read() {
    // GPS_RAW_INT as pymavlink writes it in MAVLink 1 with MAVLink 2 definitions.
    let payload: Vec<u8> = (1..=52).collect();
    let frame = |length: usize| {
        let wide = tlog_frame(NOON_US, 24, 24, &payload[..length]);
        let body = [&[length as u8, 0, 1, 1, 24][..], &payload[..length], &[24]].concat();
        [&wide[..8], &[0xfe], &body[..body.len() - 1], &crc16(&body).to_le_bytes()].concat()
    };
    let log = read_bytes(READER, &[of_pymavlink(), frame(52), frame(30)].concat()).unwrap();
    let table = log.tables.iter().find(|t| t.topic.name == "GPS_RAW_INT").unwrap();
    let last = |field: &str| table.column(field).unwrap().number(table.rows - 2);
    assert_eq!(last("alt_ellipsoid"), Some(f64::from(i32::from_le_bytes([31, 32, 33, 34]))));
    assert_eq!(last("yaw"), Some(f64::from(u16::from_le_bytes([51, 52]))));
    // Without these fields the values are absent.
    assert_eq!(table.column("yaw").unwrap().number(table.rows - 1), None);
    assert_eq!(log.health.bytes.damaged, 0);
}

#[test]
fn frames_with_unknown_flags_are_dropped_and_are_not_damage() {
    // Undefined flags, on a HEARTBEAT.
    let first = tlog_frame_from([9, 9], 6, NOON_US, 0, 50, &[0; 9]);
    let other = tlog_frame_from([9, 9], 8, NOON_US, 0, 50, &[0; 9]);
    let bytes = [of_pymavlink(), first.clone(), other.clone(), first.clone(), of_pymavlink()].concat();
    let log = read_bytes(READER, &bytes).unwrap();
    assert_eq!((log.health.messages, log.health.bytes.damaged), (10, 0), "{:?}", log.health.damage);
    assert_eq!(log.health.bytes.skipped as usize, 2 * first.len() + other.len());
    let reported = log.notices.iter().find(|n| n.code == "unknown-record").unwrap();
    assert_eq!((reported.severity, reported.count), (Severity::Loss, 3));
    assert!(reported.text.contains("message 0 with flags 0x06"), "{}", reported.text);
    // Nothing but these frames is not a log, and not damage.
    let error = read_bytes(READER, &[first, other].concat()).unwrap_err().to_string();
    assert!(error.contains("(2) have unknown incompatibility flags") && !error.contains("nothing"), "{error}");
}

#[test]
fn texts_have_the_receive_time_like_modes() {
    let text = [&[6][..], b"all is well", &[0; 42]].concat();
    let log = read_bytes(READER, &[of_pymavlink(), tlog_frame(NOON_US + 60_000, 253, 83, &text)].concat()).unwrap();
    assert_eq!(log.health.about.texts, ["2026-11-21 12:00:00.060 UTC: all is well"]);
    assert_eq!(log.health.about.modes[0].at_ns, NOON_US as i64 * 1000);
}

/// Binds the bytes as a log with this file name.
fn load_tlog(bytes: &[u8]) -> ingest::Loaded {
    let (_folder, path) = file("log.tlog", bytes);
    let loaded = load(&ingest::FlightUnit { id: "log".into(), files: vec![path], kind: LogKind::Tlog }).unwrap();
    assert_ledger(&loaded);
    loaded
}

#[test]
fn the_second_receiver_has_accuracies_and_one_of_several_units_is_bound() {
    let floats = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let epoch = |n: u64| {
        let (at_us, boot_us) = (NOON_US + 200_000 * n, (50_000_000 + 200_000 * n).to_le_bytes());
        let place = [473_977_420_i32, 85_455_940, 488_123].map(i32::to_le_bytes).concat();
        // GPS2_RAW: age of corrections, hdop, vdop, speed, course, fix, satellites, number of corrections; heading, height
        // above the ellipsoid, and accuracies.
        let receiver =
            [&boot_us[..], &place, &[0; 4], &[90, 0, 120, 0], &1000_u16.to_le_bytes(), &9000_u16.to_le_bytes()];
        let accuracies = [535_123_u32, 1500, 2500, 300, 0].map(u32::to_le_bytes).concat();
        let receiver = [&receiver.concat()[..], &[3, 17, 0, 0, 0], &accuracies].concat();
        // Two alternating units, the second rotated the other way.
        let unit = |id: u8| {
            let sign = if id == 0 { 1.0 } else { -1.0 };
            let values = [0.5, 1.0, -9.8, 0.1, 0.2, 0.3, 0.2, 0.1, 0.4, 950.0, 0.0, 500.0, 20.0].map(|v: f32| sign * v);
            let late = (50_000_000 + 200_000 * n + 1000 * u64::from(id)).to_le_bytes();
            tlog_frame(at_us, 105, 93, &[&late[..], &floats(&values), &[0xff, 0x1f, id]].concat())
        };
        // From another onboard computer.
        let input = [&boot_us[..], &[0; 4], &place[..8], &floats(&[488.0, 0.9, 1.2, 1.0, 2.0, 3.0, 0.3, 1.5, 2.5])];
        let flags: u16 = if n < 10 { 0 } else { 8 };
        let input = [&input.concat()[..], &flags.to_le_bytes(), &[0; 2], &[0, 3, 12]].concat();
        let input = tlog_frame_from([1, 191], 0, at_us + 50, 232, 151, &input);
        [tlog_frame(at_us, 124, 87, &receiver), unit(0), unit(1), input].concat()
    };
    let loaded = load_tlog(&(0..20).flat_map(epoch).collect::<Vec<u8>>());
    let series = |name: &str| &loaded.flight.channels[name].series;
    let scalars = ["horizontal-accuracy.gps-2", "vertical-accuracy.gps-2", "speed-accuracy.gps-2", "fix.gps-2"];
    assert_eq!(scalars.map(|name| series(name).component(0)[0]), [1.5, 2.5, 0.3, 3.0]);
    assert_eq!((series("position.gps-2").len(), series("satellites.gps-2").component(0)[0]), (20, 17.0));
    let turns = series("angular-rate.imu").component(0);
    assert!(turns.len() == 20 && turns.iter().all(|turn| *turn > 0.0), "{turns:?}");
    assert_eq!(["position.gps-input", "velocity.gps-input"].map(|name| series(name).len()), [20, 10]);
    assert_eq!([0, 1, 2].map(|i| series("velocity.gps-input").component(i)[0]), [1.0, 2.0, 3.0]);
}

#[test]
fn values_that_gps_input_flags_as_ignored_are_not_used() {
    // mavlink.io, GPS_INPUT_IGNORE_FLAGS: 1 height, 2 and 4 dilutions, 8 and 16 velocity, 32 to 128 accuracies.
    let frame = |n: usize, flags: u16| {
        let front = [&[0; 12][..], &473_977_420_i32.to_le_bytes(), &85_455_940_i32.to_le_bytes()].concat();
        let numbers = [500.0_f32, 1.0, 1.0, 3.0, -4.0, 0.5, 0.2, 1.0, 2.0].map(f32::to_le_bytes).concat();
        let payload = [&front[..], &numbers, &flags.to_le_bytes(), &[0, 0, 1, 3, 12]].concat();
        tlog_frame(NOON_US + 200_000 * n as u64, 232, 151, &payload)
    };
    let rows = |flags: u16| {
        let bytes: Vec<u8> = [of_pymavlink(), (1..=20).flat_map(|n| frame(n, flags)).collect()].concat();
        let (_folder, path) = file("f.tlog", &bytes);
        let loaded = load(&ingest::FlightUnit { id: "f".into(), files: vec![path], kind: LogKind::Tlog }).unwrap();
        assert_ledger(&loaded);
        let series = |name: &str| loaded.flight.channels.get(name).map(|channel| &channel.series);
        if let Some(position) = series("position.gps-input") {
            assert_eq!((position.component(2)[0], position.component(0)[0].to_degrees()), (500.0, 47.397_742));
        }
        if let Some(velocity) = series("velocity.gps-input") {
            assert_eq!([0, 1, 2].map(|i| velocity.component(i)[0]), [3.0, -4.0, 0.5]);
        }
        ["position.gps-input", "velocity.gps-input"].map(|name| series(name).map_or(0, |series| series.len()))
    };
    for flags in [0, 2, 6, 32, 64, 128, 230] {
        assert_eq!(rows(flags), [20, 20], "{flags}");
    }
    for (flags, used) in [(1, [0, 20]), (8, [20, 0]), (16, [20, 0]), (24 + 32, [20, 0]), (255, [0, 0])] {
        assert_eq!(rows(flags), used, "{flags}");
    }
}
