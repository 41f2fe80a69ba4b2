//! Messages made by hand, one for each binding, with values whose unit, sign and frame are unambiguous.

use crate::support::*;
use crate::wire::*;
use flight::{Clock, Severity, StampKind};
use ingest::{FlightUnit, Loaded, LogKind, MapLibrary};

fn load_as(kind: LogKind, bytes: &[u8]) -> Loaded {
    let (_folder, path) = file("log", bytes);
    let unit = FlightUnit { id: "log".into(), files: vec![path], kind };
    let library = MapLibrary::shipped().unwrap();
    let loaded = load_mapped(&unit, &library, None).unwrap();
    assert_ledger(&loaded);
    assert_eq!(loaded.health.bytes.damaged, 0, "{:?}", loaded.health.damage);
    loaded
}

/// Every sample of the channel has these values, within a last digit of single precision.
fn assert_all(loaded: &Loaded, name: &str, expected: &[f64]) {
    let channel = loaded.flight.channels.get(name).unwrap_or_else(|| panic!("no {name}: {:?}", loaded.binding));
    assert_eq!(channel.series.components().len(), expected.len(), "{name}");
    for (axis, expected) in channel.series.components().iter().zip(expected) {
        let near = |v: &f64| (v - expected).abs() <= 2e-7 * expected.abs().max(1e-9);
        assert!(axis.iter().all(near), "{name}: {axis:?}, not {expected}");
    }
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn shorts(values: &[i16]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

const G: f64 = 9.806_65;
/// Rotated 90° to the right of north: w, x, y, z.
const EAST: [f32; 4] = [std::f32::consts::FRAC_1_SQRT_2, 0.0, 0.0, std::f32::consts::FRAC_1_SQRT_2];

fn east() -> [f64; 4] {
    EAST.map(f64::from)
}

/// Message ID, CRC_EXTRA, and the payload at a time since boot, ms.
type Message<'m> = (u32, u8, &'m dyn Fn(u64) -> Vec<u8>);

/// Frames with each message five times, 100 ms apart.
fn tlog(messages: &[Message<'_>]) -> Vec<u8> {
    let frame = |step: u64| {
        messages.iter().flat_map(move |(number, extra, payload)| {
            tlog_frame(1_795_262_400_000_000 + 100_000 * step, *number, *extra, &payload(100 * step + 65_000))
        })
    };
    (0..5).flat_map(frame).collect()
}

#[test]
fn mavlink_inertial_messages_are_in_thousandths_of_their_units() {
    let xyz = [100, -200, -1000, 1500, -250, 5, 230, -10, 410];
    let boot = move |ms: u64| [(ms as u32).to_le_bytes().to_vec(), shorts(&xyz)].concat();
    let raw = move |ms: u64| [(1000 * ms).to_le_bytes().to_vec(), shorts(&xyz)].concat();
    let loaded =
        load_as(LogKind::Tlog, &tlog(&[(26, 170, &boot), (116, 76, &boot), (129, 46, &boot), (27, 144, &raw)]));
    for name in ["scaled", "scaled-2", "scaled-3", "raw"] {
        assert_all(&loaded, &format!("specific-force.{name}"), &[0.1 * G, -0.2 * G, -G]);
        assert_all(&loaded, &format!("angular-rate.{name}"), &[1.5, -0.25, 0.005]);
        // Milligauss.
        assert_all(&loaded, &format!("magnetic-field.{name}"), &[23e-6, -1e-6, 41e-6]);
        let timeline = loaded.flight.channels[&format!("specific-force.{name}")].series.timeline();
        assert_eq!((timeline.kind(), timeline.first().unwrap().0), (StampKind::Measured, 65_000_000_000));
    }
    // The units of RAW_IMU are an assumption, which is reported.
    assert_eq!(count_of(&loaded, "assumption"), 10);
}

#[test]
fn other_estimates_and_simulator_truth_are_bound_from_mavlink() {
    let (lat, lon) = (473_977_420_i32, -85_455_940_i32);
    let place = move || [lat.to_le_bytes(), lon.to_le_bytes()].concat();
    let degrees = [47.397_742_f64.to_radians(), -8.545_594_f64.to_radians()];
    let ahrs2 = move |_| [floats(&[0.1, -0.2, 1.5, 488.5]), place()].concat();
    let simstate = move |_| [floats(&[0.1, -0.2, 1.5, 0.0, 0.0, -9.8, 0.0, 0.0, 0.0]), place()].concat();
    let sim_state = move |_| {
        let rest = [0.0, 0.0, 1.5, 0.0, 0.0, -9.8, 0.0, 0.0, 0.0, 47.4, -8.5, 488.5, 0.1, 0.2, 12.0, -3.0, 0.5];
        [floats(&EAST), floats(&rest), place()].concat()
    };
    let odometry = |ms: u64, frame: u8, child: u8| {
        let values = [1.0, -2.0, -30.0, EAST[0], EAST[1], EAST[2], EAST[3], 4.0, 5.0, -0.5, 0.0, 0.0, 0.0];
        [(1000 * ms).to_le_bytes().to_vec(), floats(&values), floats(&[0.0; 42]), vec![frame, child]].concat()
    };
    let (ned, body) = (move |ms| odometry(ms, 1, 1), move |ms| odometry(ms, 1, 12));
    let both = [(178, 47, &ahrs2 as _), (164, 154, &simstate as _), (108, 32, &sim_state as _), (331, 91, &ned as _)];
    let loaded = load_as(LogKind::Tlog, &tlog(&both));
    assert_all(&loaded, "position.ahrs2", &[degrees[0], degrees[1], 488.5]);
    assert_all(&loaded, "position.truth-simstate", &[degrees[0], degrees[1], 0.0]);
    assert_all(&loaded, "position.truth-sim", &[degrees[0], degrees[1], 488.5]);
    assert_all(&loaded, "velocity.truth-sim", &[12.0, -3.0, 0.5]);
    assert_all(&loaded, "attitude.truth-sim", &east());
    assert_all(&loaded, "position.odometry", &[1.0, -2.0, -30.0]);
    assert_all(&loaded, "velocity.odometry", &[4.0, 5.0, -0.5]);
    // None of these messages carries a vehicle timestamp.
    assert_eq!(loaded.flight.channels["position.ahrs2"].series.timeline().kind(), StampKind::Logged);
    // A pose that rotates the body, with a body-frame velocity: not a velocity to the north.
    let loaded = load_as(LogKind::Tlog, &tlog(&[(331, 91, &body as _)]));
    assert_all(&loaded, "attitude.odometry", &east());
    assert!(!loaded.flight.channels.contains_key("velocity.odometry"));
}

/// A DataFlash log with each type five times, 100 ms apart: name, format, columns, and what follows the time.
fn dataflash(types: &[(&str, &str, &str, Vec<u8>)]) -> Vec<u8> {
    let mut out = dataflash_begin();
    for (id, (name, codes, columns, _)) in (10..).zip(types) {
        out.extend(dataflash_fmt(id, name, &format!("Q{codes}"), &format!("TimeUS,{columns}")));
    }
    for step in 0..5_u64 {
        for (id, (.., body)) in (10..).zip(types) {
            out.extend(dataflash_record(id, &[&(65_000_000 + 100_000 * step).to_le_bytes()[..], body].concat()));
        }
    }
    out
}

const CORE: (&str, &str) = ("BccCffffff", "C,Roll,Pitch,Yaw,VN,VE,VD,PN,PE,PD");

/// Roll 10°, pitch −20°, yaw 90°, and velocity and position of this core.
fn core(number: u8) -> Vec<u8> {
    let turn = [shorts(&[1000, -2000]), 9000_u16.to_le_bytes().to_vec()].concat();
    let place = f32::from(number);
    [vec![number], turn, floats(&[12.0, -3.0, 0.5, place, -2.0, -30.0])].concat()
}

fn turned() -> [f64; 4] {
    let [(sr, cr), (sp, cp), (sy, cy)] = [10.0_f64, -20.0, 90.0].map(|d| (d.to_radians() / 2.0).sin_cos());
    [cr * cp * cy + sr * sp * sy, sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy]
}

#[test]
fn both_lanes_of_old_and_new_ardupilot_estimators_are_bound() {
    for types in [
        vec![("XKF1", CORE.0, CORE.1, core(0)), ("XKF1", CORE.0, CORE.1, core(1))],
        vec![("NKF1", CORE.0, CORE.1, core(0)), ("NKF1", CORE.0, CORE.1, core(1))],
        vec![
            ("NKF1", &CORE.0[1..], &CORE.1[2..], core(0)[1..].to_vec()),
            ("NKF6", &CORE.0[1..], &CORE.1[2..], core(1)[1..].to_vec()),
        ],
        vec![
            ("XKF1", &CORE.0[1..], &CORE.1[2..], core(0)[1..].to_vec()),
            ("XKF6", &CORE.0[1..], &CORE.1[2..], core(1)[1..].to_vec()),
        ],
    ] {
        let loaded = load_as(LogKind::DataFlash, &dataflash(&types));
        for (lane, north) in [("", 0.0), ("-2", 1.0)] {
            assert_all(&loaded, &format!("position.ekf{lane}"), &[north, -2.0, -30.0]);
            assert_all(&loaded, &format!("velocity.ekf{lane}"), &[12.0, -3.0, 0.5]);
            assert_all(&loaded, &format!("attitude.core{lane}"), &turned());
        }
    }
}

#[test]
fn other_dataflash_types_have_their_units_and_signs() {
    let place = || [473_977_420_i32, -85_455_940].map(i32::to_le_bytes).concat();
    let turn = || [shorts(&[1000, -2000]), 9000_u16.to_le_bytes().to_vec()].concat();
    let whole = "Roll,Pitch,Yaw,Alt,Lat,Lng,Q1,Q2,Q3,Q4";
    let ahr2 = [turn(), floats(&[488.5]), place(), floats(&EAST)].concat();
    let camera =
        |values: &[f32]| [&65_020_000_u64.to_le_bytes()[..], &64_980_u32.to_le_bytes(), &floats(values)].concat();
    let imu = |number: u8| [vec![number], floats(&[0.1, -0.2, 0.3, 1.0, -2.0, -9.8])].concat();
    let mag = |number: u8| [vec![number], shorts(&[230, -10, 410])].concat();
    let types = [
        ("AHR2", "ccCfLLffff", whole, ahr2.clone()),
        ("SIM", "ccCfLLffff", whole, ahr2),
        ("SIM2", "ffffff", "PN,PE,PD,VN,VE,VD", floats(&[100.0, -50.0, -30.0, 12.0, -3.0, 0.5])),
        ("VISP", "QIffffff", "RTimeUS,CTimeMS,PX,PY,PZ,Roll,Pitch,Yaw", camera(&[1.0, -2.0, -3.0, 10.0, -20.0, 90.0])),
        ("VISV", "QIfff", "RTimeUS,CTimeMS,VX,VY,VZ", camera(&[4.0, -5.0, 0.5])),
        ("IMU", "Bffffff", "I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ", imu(1)),
        ("IMU3", "ffffff", "GyrX,GyrY,GyrZ,AccX,AccY,AccZ", imu(0)[1..].to_vec()),
        ("MAG", "Bhhh", "I,MagX,MagY,MagZ", mag(1)),
        ("MAG3", "hhh", "MagX,MagY,MagZ", mag(0)[1..].to_vec()),
    ];
    let mut bytes = dataflash(&types);
    // The camera's own times must differ.
    let stamps: Vec<usize> = (0..bytes.len() - 4).filter(|at| bytes[*at..at + 4] == 64_980_u32.to_le_bytes()).collect();
    for (i, at) in stamps.iter().enumerate() {
        bytes[*at..at + 4].copy_from_slice(&(64_980 + 100 * (i as u32 / 2)).to_le_bytes());
    }
    let loaded = load_as(LogKind::DataFlash, &bytes);
    let degrees = [47.397_742_f64.to_radians(), -8.545_594_f64.to_radians(), 488.5];
    assert_all(&loaded, "position.ahrs2", &degrees);
    assert_all(&loaded, "attitude.ahrs2", &turned());
    assert_all(&loaded, "position.truth", &degrees);
    assert_all(&loaded, "attitude.truth", &east());
    assert_all(&loaded, "position.truth-ned", &[100.0, -50.0, -30.0]);
    assert_all(&loaded, "velocity.truth", &[12.0, -3.0, 0.5]);
    assert_all(&loaded, "position.vision", &[1.0, -2.0, -3.0]);
    assert_all(&loaded, "attitude.vision", &turned());
    assert_all(&loaded, "velocity.vision", &[4.0, -5.0, 0.5]);
    for device in ["imu-2", "imu-3"] {
        assert_all(&loaded, &format!("angular-rate.{device}"), &[0.1, -0.2, 0.3]);
        assert_all(&loaded, &format!("specific-force.{device}"), &[1.0, -2.0, -9.8]);
        assert_all(&loaded, &format!("magnetic-field.{device}"), &[23e-6, -1e-6, 41e-6]);
    }
    // When the picture was taken, not when the autopilot logged it.
    let camera = loaded.flight.channels["position.vision"].series.timeline();
    assert_eq!((camera.kind(), camera.first().unwrap().0), (StampKind::Measured, 64_980_000_000));
}

#[test]
fn px4_lanes_and_cameras_are_bound_in_the_frame_they_name() {
    let odometry = "uint64_t timestamp;uint64_t timestamp_sample;float[3] position;float[4] q;float[3] velocity;\
                    uint8_t pose_frame;uint8_t velocity_frame;";
    let local = "estimator_local_position:uint64_t timestamp;uint64_t timestamp_sample;float x;float y;float z;float vx;\
                 float vy;float vz;bool xy_valid;bool v_xy_valid;";
    let attitude = "estimator_attitude:uint64_t timestamp;uint64_t timestamp_sample;float[4] q;";
    let topic = format!("vehicle_visual_odometry:{odometry}");
    let log = |frames: [u8; 2]| {
        let mut out = ulog_begin(&[(&topic, 0), (local, 1), (attitude, 1)]);
        for step in 0..5_u64 {
            let stamps = [65_010_000 + 100_000 * step, 65_000_000 + 100_000 * step].map(u64::to_le_bytes).concat();
            let pose = [1.0, -2.0, -30.0, EAST[0], EAST[1], EAST[2], EAST[3], 4.0, -5.0, 0.5];
            let place = [floats(&[1.0, -2.0, -30.0, 4.0, -5.0, 0.5]), vec![1, 1]].concat();
            let bodies = [[floats(&pose), frames.to_vec()].concat(), place, floats(&EAST)];
            for (number, body) in (0..).zip(bodies) {
                out.extend(ulog_message(b'D', &[&[number, 0], &stamps[..], &body].concat()));
            }
        }
        load_as(LogKind::Ulog, &out)
    };
    let loaded = log([1, 1]);
    for name in ["vision", "ekf-2"] {
        assert_all(&loaded, &format!("position.{name}"), &[1.0, -2.0, -30.0]);
        assert_all(&loaded, &format!("velocity.{name}"), &[4.0, -5.0, 0.5]);
        assert_all(&loaded, &format!("attitude.{name}"), &east());
        let timeline = loaded.flight.channels[&format!("position.{name}")].series.timeline();
        assert_eq!(timeline.first().unwrap().0, 65_000_000_000);
    }
    // 2 is a frame without a north reference, 3 the body frame.
    let loaded = log([2, 3]);
    let bound = |name: &str| loaded.flight.channels.contains_key(name);
    assert!(!bound("position.vision") && !bound("velocity.vision") && !bound("attitude.vision"));
    assert!(bound("velocity.ekf-2"));
}

#[test]
fn receiver_marks_and_pulses_have_receiver_time_to_the_nanosecond() {
    const WEEK: u16 = 2445;
    let mark = |n: u32| {
        let times = [561_600_123 + 1000 * n, 456_789, 561_600_200 + 1000 * n, 1].map(u32::to_le_bytes).concat();
        let weeks = [40 + n as u16, WEEK, WEEK].map(u16::to_le_bytes).concat();
        ubx_frame(0x0d, 3, &[&[0, 0xc8][..], &weeks, &times, &[0; 4]].concat())
    };
    // From a receiver with flags for pulses in UTC, which is 18 leap seconds less than GPS time.
    let pulse = |n: u32| {
        let times = [561_582_000 + 1000 * n, 0, 0].map(u32::to_le_bytes).concat();
        ubx_frame(0x0d, 1, &[&times[..], &WEEK.to_le_bytes(), &[3, 0]].concat())
    };
    let loaded = load_as(LogKind::Ubx, &(0..5).flat_map(|n| [pulse(n), mark(n)].concat()).collect::<Vec<u8>>());
    let start = i64::from(WEEK) * 604_800_000 + 561_600_000;
    let series = |name: &str| &loaded.flight.channels[name].series;
    let stamps = |name: &str| series(name).timeline().stamps().iter().map(|s| s.0).collect::<Vec<_>>();
    assert_eq!(
        stamps("pps.time-mark"),
        (0..5).map(|n| (start + 123 + 1000 * n) * 1_000_000 + 456_789).collect::<Vec<_>>()
    );
    assert_eq!(series("pps.time-mark").component(0), [40.0, 41.0, 42.0, 43.0, 44.0]);
    assert_eq!(stamps("pps.receiver"), (0..5).map(|n| (start + 1000 * n) * 1_000_000).collect::<Vec<_>>());
    assert_eq!(series("pps.receiver").component(0)[0], 561_582.0);
}

/// A message of NovAtel with its checksum: the CRC-32 of IEEE 802.3 without its first and last inversion.
fn novatel(name: &str, seconds: f64, fields: &str) -> String {
    let body = format!("{name}A,COM1,0,83.5,FINESTEERING,2445,{seconds:.3},02000020,cdba,16809;{fields}");
    let bit = |crc: u32, _| if crc & 1 == 0 { crc >> 1 } else { crc >> 1 ^ 0xedb8_8320 };
    let crc = body.bytes().fold(0, |crc, byte| (0..8).fold(crc ^ u32::from(byte), bit));
    format!("#{body}*{crc:08x}\r\n")
}

#[test]
fn novatel_rows_without_a_solution_are_rejected_and_counted() {
    let epoch = |n: u32| {
        let (seconds, latitude) = (561_600.0 + f64::from(n), 47.3 + 1e-5 * f64::from(n));
        let (status, inertial) = match n {
            0 => ("INSUFFICIENT_OBS", "INS_INACTIVE"),
            1 => ("COLD_START", "INS_ALIGNING"),
            2 => ("SOL_COMPUTED", "INS_SOLUTION_NOT_GOOD"),
            3 => ("SOL_COMPUTED", "INS_SOLUTION_FREE"),
            4 => ("SOL_COMPUTED", "INS_ALIGNMENT_COMPLETE"),
            5 => ("SOL_COMPUTED", "INS_HIGH_VARIANCE"),
            _ => ("SOL_COMPUTED", "INS_SOLUTION_GOOD"),
        };
        [
            novatel(
                "BESTPOS",
                seconds,
                &format!(
                    "{status},SINGLE,{latitude},8.5,400.0,47.2,WGS84,1.5,1.2,2.5,\"\",0.0,0.0,15,15,15,12,00,06,39,33"
                ),
            ),
            novatel("BESTVEL", seconds, &format!("{status},DOPPLER_VELOCITY,0.150,0.000,{}.0,90.0,0.5,0.0", n + 1)),
            novatel(
                "INSPVA",
                seconds,
                &format!("2445,{seconds:.3},{latitude},8.5,400.0,1.0,2.0,0.5,0.1,0.2,90.0,{inertial}"),
            ),
        ]
        .concat()
    };
    let text: String = (0..20).map(epoch).collect();
    let loaded = load_as(LogKind::Csv, text.as_bytes());
    for (name, unusable) in
        [("position.gps", 2), ("velocity.gps", 2), ("position.ins", 3), ("velocity.ins", 3), ("attitude.ins", 3)]
    {
        let health = loaded.binding.iter().flat_map(|b| &b.channels).find(|c| c.name == name).unwrap();
        let rejected: Vec<(&str, u64)> = health.rejected.iter().map(|r| (r.reason.as_str(), r.count)).collect();
        assert_eq!((health.used, rejected), (20 - unusable, vec![("solution_ok is below 1", unusable)]), "{name}");
    }
    // The first used row is the third.
    let velocity = &loaded.flight.channels["velocity.gps"].series;
    assert!((velocity.component(1)[0] - 3.0).abs() < 1e-12, "{:?}", velocity.component(1));
    assert_eq!(count_of(&loaded, "rejected-row"), 13);
}

#[test]
fn inertial_angles_are_aircraft_angles_and_split_messages_bind_as_one() {
    let row = |n: u32| {
        let (seconds, latitude) = (561_600.0 + f64::from(n), 47.3 + 1e-5 * f64::from(n));
        let inertial =
            |name, fields: &str| novatel(name, seconds, &format!("2445,{seconds:.3},{fields},INS_SOLUTION_GOOD"));
        let position = inertial("INSPOS", &format!("{latitude},8.5,400.0"));
        [position, inertial("INSVEL", "1.0,2.0,0.5"), inertial("INSATT", "20.0,0.0,0.0")].concat()
    };
    let novatel = load_as(LogKind::Csv, (0..9).map(row).collect::<String>().as_bytes());
    let half = 10.0_f64.to_radians();
    assert_all(&novatel, "attitude.ins", &[half.cos(), half.sin(), 0.0, 0.0]);
    assert_all(&novatel, "velocity.ins", &[1.0, 2.0, -0.5]);
    assert_eq!(novatel.flight.channels["position.ins"].series.len(), 9);
    // An RT3000's export in local time: latin text in the header, km/h, a comma too many.
    let header = "\"Date (UTC+1,00)\",\"Time (UTC+1,00)\",TimeFromStart (s),PosLat (deg),PosLon (deg),PosAlt (m),VelNorth (km/h),\
                  VelEast (km/h),VelDown (km/h),AccelX (m/s\u{b2}),AngleHeading (deg),AnglePitch (deg),AngleRoll (deg)\r\n";
    let row = |n: u32| {
        format!("2026-11-21,13:00:0{n},{n},{},8.5,400,36,18,-3.6,0.1,90,20,0,\r\n", 47.3 + 1e-5 * f64::from(n))
    };
    let text = header.to_owned() + &(0..9).map(row).collect::<String>();
    let latin: Vec<u8> = text.chars().map(|letter| letter as u8).collect();
    let oxts = load_as(LogKind::Csv, &latin);
    assert_all(&oxts, "velocity.ins", &[10.0, 5.0, -1.0]);
    let side = std::f64::consts::FRAC_1_SQRT_2;
    assert_all(&oxts, "attitude.ins", &[half.cos() * side, -half.sin() * side, half.sin() * side, half.cos() * side]);
    // 13:00 local is noon UTC.
    let timeline = oxts.flight.channels["position.ins"].series.timeline();
    assert_eq!((timeline.clock(), timeline.stamps()[8].0), (Clock::Unix, 1_795_262_408_000_000_000));
}

#[test]
fn values_unknown_to_mavlink_are_absent() {
    let unknown = u32::MAX;
    let raw = move |ms: u64| {
        let step = ms as i32;
        let (satellites, accuracy) = match ms {
            65_000 => (255, 0),
            65_100 => (255, unknown),
            _ => (12, 1500),
        };
        [
            (1000 * ms).to_le_bytes().to_vec(),
            [473_977_420 + step, 85_455_940, 488_123].map(i32::to_le_bytes).concat(),
            [120_u16, 180, 1234, 9000].map(u16::to_le_bytes).concat(),
            vec![3, satellites],
            [535_123_u32, accuracy, accuracy, accuracy, 0].map(u32::to_le_bytes).concat(),
        ]
        .concat()
    };
    let loaded = load_as(LogKind::Tlog, &tlog(&[(24, 24, &raw)]));
    for (name, value) in [("satellites.gps", 12.0), ("horizontal-accuracy.gps", 1.5), ("speed-accuracy.gps", 1.5)] {
        let series = &loaded.flight.channels[name].series;
        assert_eq!(series.component(0), [value; 3], "{name}");
    }
    assert_eq!(loaded.flight.channels["position.gps"].series.len(), 5);
}

/// A text export of MT Manager at 10 Hz, from 2026-11-21T12:00:00 UTC on; `utc` gives the UTC columns.
fn mt_manager(rows: u32, utc: impl Fn(u32) -> String) -> String {
    let header = "SampleTimeFine,UTC_Nano,UTC_Year,UTC_Month,UTC_Day,UTC_Hour,UTC_Minute,UTC_Second,UTC_Valid,Roll,Pitch,Yaw,\
                  Latitude,Longitude,Altitude,Vel_X,Vel_Y,Vel_Z";
    let row =
        |n: u32| format!("{},{},0,-10,90,{},8.5,400,1,20,0.5\n", 70_000 + 1000 * n, utc(n), 47.3 + 1e-5 * f64::from(n));
    format!("// General information:\n// Coordinate system: ENU\n{header}\n{}", (0..rows).map(row).collect::<String>())
}

fn noon(n: u32) -> String {
    format!("{},2026,11,21,12,0,{},7", n % 10 * 100_000_000, n / 10)
}

#[test]
fn mt_manager_angles_rotate_the_sensor_to_east_north_up() {
    let loaded = load_as(LogKind::Csv, mt_manager(30, noon).as_bytes());
    // Heading north with the nose ten degrees up.
    let half = 5.0_f64.to_radians();
    assert_all(&loaded, "attitude.ins", &[half.cos(), 0.0, half.sin(), 0.0]);
    assert_all(&loaded, "velocity.xyz", &[20.0, 1.0, -0.5]);
    assert_eq!(count_of(&loaded, "assumption"), 0);
}

#[test]
fn an_mt_manager_comment_sets_the_frame_and_without_one_it_is_assumed() {
    let load_with_remark = |text: &str| {
        let text = mt_manager(30, noon).replace("// Coordinate system: ENU\n", text);
        load_as(LogKind::Csv, text.as_bytes())
    };
    let half = 5.0_f64.to_radians();
    let side = std::f64::consts::FRAC_1_SQRT_2;
    // Yaw 90 deg about up, or about down, and the pitch about the left axis; forward, right, down of NED.
    let enu = ([20.0, 1.0, -0.5], [half.cos(), 0.0, half.sin(), 0.0]);
    let nwu = ([1.0, -20.0, -0.5], [half.cos() * side, half.sin() * side, half.sin() * side, -half.cos() * side]);
    let ned = ([1.0, 20.0, 0.5], [-half.sin() * side, half.cos() * side, half.cos() * side, half.sin() * side]);
    for (comment, (velocity, attitude), reported) in [
        ("", enu, 60),
        ("// Coordinate system: ENU\n", enu, 0),
        ("//  Coordinate system: NWU \n", nwu, 60),
        ("// Coordinate system: NED\n", ned, 60),
    ] {
        let loaded = load_with_remark(comment);
        assert_all(&loaded, "velocity.xyz", &velocity);
        assert_all(&loaded, "attitude.ins", &attitude);
        assert_eq!(count_of(&loaded, "assumption"), reported, "{comment}");
    }
    let unknown = load_with_remark("// Coordinate system: SEU\n");
    assert_eq!(unknown.flight.channels.keys().collect::<Vec<_>>(), ["position.ins"]);
    assert_eq!(count_of(&unknown, "unknown-word"), 2);
}

#[test]
fn contradictory_mt_manager_comments_leave_no_frame_assumed() {
    let text = mt_manager(30, noon).replace("// Coordinate", "// Coordinate system: NED\n// Coordinate");
    let loaded = load_as(LogKind::Csv, text.as_bytes());
    assert_eq!(loaded.flight.channels.keys().collect::<Vec<_>>(), ["position.ins"]);
    let reported = loaded.flight.notices.iter().find(|n| n.code == "unknown-word").unwrap();
    assert!(reported.text.contains("Coordinate system ENU and NED"), "{}", reported.text);
}

#[test]
fn mt_manager_rows_without_utc_are_dated_by_the_devices_counter() {
    // No UTC, and a date from the device itself.
    let absent = |n: u32| if n < 5 { ",,,,,,,0".to_owned() } else { noon(n) };
    let own = |n: u32| if n < 5 { format!("{},2000,1,1,0,0,0,0", n * 100_000_000) } else { noon(n) };
    for text in [mt_manager(30, absent), mt_manager(30, own)] {
        let loaded = load_as(LogKind::Csv, text.as_bytes());
        let timeline = loaded.flight.channels["position.ins"].series.timeline();
        assert_eq!(timeline.clock(), Clock::Unix);
        // date -u -d '2026-11-21T12:00:00Z' +%s
        let truth: Vec<i64> = (0..30).map(|n| 1_795_262_400_000_000_000 + 100_000_000 * n).collect();
        assert_eq!(timeline.stamps().iter().map(|s| s.0).collect::<Vec<_>>(), truth);
        let reported = loaded.flight.notices.iter().find(|n| n.code == "date-inferred").unwrap();
        assert_eq!((reported.count, reported.severity), (5, Severity::Warning));
    }
    let whole = load_as(LogKind::Csv, mt_manager(30, noon).as_bytes());
    assert_eq!(count_of(&whole, "date-inferred"), 0);
}
