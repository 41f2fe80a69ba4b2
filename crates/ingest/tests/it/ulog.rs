//! PX4 ULog: the whole format, simulated flights, all kinds of damage, and hostile files.

use crate::stream::{numbers, table};
use crate::support::*;
use crate::wire::ulog_begin;
use flight::{Channel, Clock, Severity, Stamp, StampKind};
use ingest::{
    FieldRequest, FlightUnit, Limits, Loaded, Log, LogError, LogKind, Selection, Table, TopicInfo, ValueKind,
};
use simulate::{
    BenchChannel, BenchSensor, BenchSettings, Container, FlightSettings, LogFile, Pulses, SensorSettings, simulate,
    simulate_bench,
};
use std::path::Path;

/// Builds a ULog.
struct Made(Vec<u8>);

impl Made {
    /// Header and flag bits, with the offsets of appended data.
    fn begin(offsets: [u64; 3]) -> Made {
        let mut made = Made(b"ULog\x01\x12\x35\x01\x00\x00\x00\x00\x00\x00\x00\x00".to_vec());
        let flags = [0, 0, 0, 0, 0, 0, 0, 0, u8::from(offsets[0] > 0), 0, 0, 0, 0, 0, 0, 0];
        made.put(b'B', &[&flags[..], &offsets.map(u64::to_le_bytes).concat()].concat());
        made
    }

    fn put(&mut self, kind: u8, body: &[u8]) {
        self.0.extend((body.len() as u16).to_le_bytes());
        self.0.push(kind);
        self.0.extend(body);
    }

    fn entry(&mut self, kind: u8, flags: &[u8], key: &str, value: &[u8]) {
        self.put(kind, &[flags, &[key.len() as u8], key.as_bytes(), value].concat());
    }

    fn format(&mut self, text: &str) {
        self.put(b'F', text.as_bytes());
    }

    fn subscribe(&mut self, number: u16, instance: u8, name: &str) {
        self.put(b'A', &[&[instance][..], &number.to_le_bytes(), name.as_bytes()].concat());
    }

    fn data(&mut self, number: u16, at_us: u64, rest: &[u8]) {
        self.put(b'D', &[&number.to_le_bytes()[..], &at_us.to_le_bytes(), rest].concat());
    }

    fn text(&mut self, at_us: u64, text: &str) {
        self.put(b'L', &[b"6", &at_us.to_le_bytes()[..], text.as_bytes()].concat());
    }

    fn sync(&mut self) {
        self.put(b'S', &[0x2f, 0x73, 0x13, 0x20, 0x25, 0x0c, 0xbb, 0x12]);
    }
}

fn read_with(bytes: &[u8], limits: Limits) -> Result<Log, LogError> {
    let (_folder, path) = file("log.ulg", bytes);
    read_path(&path, limits)
}

fn read_path(path: &Path, limits: Limits) -> Result<Log, LogError> {
    let want = |_: &TopicInfo| Selection::All;
    let log = read_files(limits, LogKind::Ulog, &[path.to_owned()], &want)?;
    let b = &log.health.bytes;
    assert_eq!(b.sum(), b.size, "{b:?}");
    Ok(log)
}

fn read(bytes: &[u8]) -> Log {
    read_with(bytes, Limits::default()).unwrap()
}

fn loses(log: &Log) -> bool {
    log.notices.any_loss()
}

fn notice(log: &Log, code: &str) -> Option<(Severity, u64)> {
    log.notices.iter().find(|n| n.code == code).map(|n| (n.severity, n.count))
}

/// Definitions of two topics, `pose` with instances 0 and 1, and nested `esc`.
fn definitions(made: &mut Made) {
    made.entry(b'I', &[], "char[3] sys_name", b"PX4");
    made.entry(b'I', &[], "uint32_t ver_sw_release", &0x010e_03ff_u32.to_le_bytes());
    made.format("report:float rpm;uint8_t state;uint8_t[3] _padding0;");
    made.format("pose:uint64_t timestamp;float x;float y;");
    made.format("esc:uint64_t timestamp;report[2] esc;char[4] name;int16_t n;uint8_t[2] _padding0;");
    made.entry(b'P', &[], "float EKF2_GPS_DELAY", &110_f32.to_le_bytes());
    made.subscribe(0, 0, "pose");
    made.subscribe(7, 1, "pose");
    made.subscribe(3, 0, "esc");
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// Definitions and `rows` poses of each instance with an `esc` in between and an occasional text and sync.
fn small(rows: u64) -> Vec<u8> {
    let mut made = Made::begin([0; 3]);
    definitions(&mut made);
    for i in 0..rows {
        let at_us = 1_000_000 + 10_000 * i;
        made.data(0, at_us, &floats(&[i as f32, 0.5]));
        made.data(7, at_us + 10, &floats(&[1000.0 + i as f32, -0.5]));
        let reports = [floats(&[600.0 + i as f32]), vec![1, 0, 0, 0], floats(&[-600.0]), vec![2, 0, 0, 0]].concat();
        made.data(3, at_us + 20, &[&reports[..], b"ab\0c", &(-7_i16).to_le_bytes()].concat());
        match i % 4 {
            1 => made.text(at_us + 30, &format!("this is row {i}")),
            3 => made.sync(),
            _ => {}
        }
    }
    made.0
}

#[test]
fn every_message_kind_is_read_and_fields_follow_their_format() {
    let mut made = Made::begin([0; 3]);
    definitions(&mut made);
    made.entry(b'M', &[0], "char[5] perf_top", b"first");
    made.entry(b'M', &[1], "char[6] perf_top", b"second");
    made.entry(b'Q', &[1], "float EKF2_GPS_DELAY", &175_f32.to_le_bytes());
    made.data(0, 1_000_000, &floats(&[1.0, 2.0]));
    made.data(7, 1_000_100, &floats(&[10.0, 20.0]));
    let reports = [floats(&[600.0]), vec![1, 0, 0, 0], floats(&[-600.0]), vec![2, 0, 0, 0]].concat();
    made.data(3, 1_000_200, &[&reports[..], b"ab\0c", &(-7_i16).to_le_bytes()].concat());
    made.put(b'O', &250_u16.to_le_bytes());
    made.put(b'O', &50_u16.to_le_bytes());
    made.entry(b'P', &[], "float EKF2_GPS_DELAY", &150_f32.to_le_bytes());
    made.text(1_500_000, "take-off");
    made.put(b'C', &[b"4\x02\x00", &1_600_000_u64.to_le_bytes()[..], b"wind is high"].concat());
    made.sync();
    made.put(b'R', &7_u16.to_le_bytes());
    made.data(0, 900_000, &floats(&[3.0, 4.0]));
    let log = read(&made.0);
    assert_eq!(log.health.format, "ULog 1");
    assert_eq!(numbers(&log, "pose", "x"), [1.0, 3.0]);
    assert_eq!(numbers(&log, "pose_1", "y"), [20.0]);
    assert_eq!(table(&log, "pose_1").topic.type_name, "pose");
    assert_eq!(numbers(&log, "esc", "esc[1].rpm"), [-600.0]);
    assert_eq!(numbers(&log, "esc", "esc[1].state"), [2.0]);
    assert_eq!(numbers(&log, "esc", "n"), [-7.0]);
    assert_eq!(table(&log, "esc").column("name").unwrap().text(0), Some("ab"));
    assert_eq!(table(&log, "esc").columns.iter().filter(|c| c.path.contains("padding")).count(), 0);
    assert_eq!(table(&log, "pose").logged_ns, Some(vec![1_000_000_000, 900_000_000]));
    let stamps = &log.health.topics.iter().find(|t| t.name == "pose").unwrap().stamps[0];
    assert_eq!((stamps.clock, stamps.kind, stamps.back_jumps), (Clock::Boot, StampKind::Logged, 1));
    assert_eq!(notice(&log, "dropout"), Some((Severity::Warning, 2)));
    assert_eq!(notice(&log, "unreliable-stamps"), Some((Severity::Warning, 1)));
    assert!(!loses(&log));
    let about = &log.health.about;
    assert_eq!(about.system.as_deref(), Some("PX4"));
    assert_eq!(about.firmware.as_deref(), Some("1.14.3 release"));
    assert_eq!(
        (about.configured_delays[0].parameter.as_str(), about.configured_delays[0].value_s),
        ("EKF2_GPS_DELAY", 0.11)
    );
    assert_eq!(about.parameter_changes, ["EKF2_GPS_DELAY at 1.000 s: 110 → 150"]);
    assert_eq!(about.texts, ["1.500 s INFO: take-off", "1.600 s WARNING [2]: wind is high"]);
    assert!(log.health.extras.contains(&"perf_top (2 parts)".to_owned()), "{:?}", log.health.extras);
    assert!(log.health.extras.contains(&"1 default parameters".to_owned()), "{:?}", log.health.extras);
}

#[test]
fn flight_modes_come_from_vehicle_status_in_time_order() {
    let mut made = Made::begin([0; 3]);
    made.format("vehicle_status:uint64_t timestamp;uint8_t arming_state;uint8_t nav_state;");
    made.subscribe(0, 0, "vehicle_status");
    for (i, state) in [2, 2, 3, 3, 5, 2].into_iter().enumerate() {
        made.data(0, 1_000_000 * i as u64, &[0, state]);
    }
    // Whether or not the topic is wanted.
    let want = |_: &TopicInfo| Selection::Skip;
    let (_folder, path) = file("log.ulg", &made.0);
    let log = read_files(Limits::default(), LogKind::Ulog, &[path], &want).unwrap();
    let modes: Vec<(i64, &str)> = log.health.about.modes.iter().map(|m| (m.at_ns, m.mode.as_str())).collect();
    assert_eq!(
        modes,
        [(0, "Position"), (2_000_000_000, "Mission"), (4_000_000_000, "Return"), (5_000_000_000, "Position")]
    );
    assert_eq!((log.tables.len(), log.health.messages), (0, 6));
}

#[test]
fn receivers_are_named_by_their_device_ids() {
    let mut made = Made::begin([0; 3]);
    made.format("sensor_gps:uint64_t timestamp;double latitude_deg;uint32_t device_id;");
    made.subscribe(0, 0, "sensor_gps");
    made.subscribe(1, 1, "sensor_gps");
    // Type, address, bus and kind of bus from the highest byte but one down; zero where unknown to the driver.
    for (i, device) in [0_u32, 0x00aa_0005, 0x00aa_0005, 0x0085_7d03, 0x00fe_0001].into_iter().enumerate() {
        made.data((i / 3) as u16, 1_000_000 * i as u64, &[&0_f64.to_le_bytes()[..], &device.to_le_bytes()].concat());
    }
    assert_eq!(
        read(&made.0).health.about.receivers,
        [
            "GPS 0: u-blox F9P (device 0xaa0005)",
            "GPS 1: DroneCAN (device 0x857d03)",
            "GPS 1: of an unknown type (device 0xfe0001)"
        ]
    );
}

#[test]
fn a_message_without_a_timestamp_does_not_reset_a_parameter_changes_time() {
    let mut made = Made::begin([0; 3]);
    definitions(&mut made);
    made.data(0, 5_000_000, &floats(&[1.0, 2.0]));
    // Like the ground truth from PX4's Gazebo bridge.
    made.data(7, 0, &floats(&[1.0, 2.0]));
    made.entry(b'P', &[], "float EKF2_GPS_DELAY", &150_f32.to_le_bytes());
    assert_eq!(read(&made.0).health.about.parameter_changes, ["EKF2_GPS_DELAY at 5.000 s: 110 → 150"]);
}

/// Loads a log of these topics, with the messages that `rows` writes for each fifth of a second.
fn load_topics(topics: &[(&str, u8)], rows: impl Fn(u64) -> Vec<Vec<u8>>) -> Loaded {
    let mut made = Made(ulog_begin(topics));
    for i in 0..20 {
        for (number, rest) in rows(i).iter().enumerate().filter(|(_, rest)| !rest.is_empty()) {
            made.data(number as u16, 10_000_000 + 200_000 * i, rest);
        }
    }
    load_files(&[LogFile { path: "log.ulg".into(), bytes: made.0 }])
}

/// A position that moves north by one metre per row.
fn place(i: u64) -> [f64; 2] {
    [47.0 + i as f64 / 111_200.0, 8.5]
}

#[test]
fn simulator_height_is_its_bridges_field_and_invalid_positions_are_skipped() {
    const FIELDS: &str = "uint64_t timestamp;double lat;double lon;float alt;float alt_ellipsoid;bool lat_lon_valid;";
    let topics =
        ["vehicle_global_position_groundtruth", "vehicle_global_position"].map(|name| format!("{name}:{FIELDS}"));
    let loaded = load_topics(&[(&topics[0], 0), (&topics[1], 0)], |i| {
        let [lat, lon] = place(i).map(f64::to_le_bytes);
        let row = |ellipsoid: f32, valid: u8| {
            [&lat[..], &lon, &(488.0 + i as f32).to_le_bytes(), &ellipsoid.to_le_bytes(), &[valid]].concat()
        };
        vec![row(0.0, 0), row(535.0 + i as f32, u8::from(i >= 5))]
    });
    let height = |channel: &str| loaded.flight.channels[channel].series.component(2).to_vec();
    assert_eq!(height("position.truth"), (0..20).map(|i| 488.0 + f64::from(i)).collect::<Vec<_>>());
    assert_eq!(height("position.ekf-global"), (5..20).map(|i| 535.0 + f64::from(i)).collect::<Vec<_>>());
}

#[test]
fn magnetometer_and_barometer_of_2017_are_found_in_sensor_combined() {
    let topic = "sensor_combined:uint64_t timestamp;float[3] gyro_rad;float[3] accelerometer_m_s2;\
                 float[3] magnetometer_ga;float baro_alt_meter;int32_t accelerometer_timestamp_relative;\
                 int32_t magnetometer_timestamp_relative;int32_t baro_timestamp_relative;";
    let gps = "vehicle_gps_position:uint64_t timestamp;int32_t lat;int32_t lon;uint8_t fix_type;";
    let loaded = load_topics(&[(topic, 0), (gps, 0)], |i| {
        let [lat, lon] = place(i).map(|deg| ((deg * 1e7) as i32).to_le_bytes());
        // The largest number means that the sensor has not measured yet.
        let relative = [5, 10, 15].map(|from| if i < from { i32::MAX } else { -3000 }.to_le_bytes()).concat();
        let values = floats(&[0.0, 0.0, 0.1, 0.0, 0.0, -9.8, 0.25, -0.125, 0.5, 488.0 + i as f32]);
        vec![[values, relative].concat(), [&lat[..], &lon, &[3]].concat()]
    });
    let series = |channel: &str| &loaded.flight.channels[channel].series;
    // One gauss is 1e-4 tesla.
    let field: Vec<f64> = series("magnetic-field.imu").components().iter().map(|c| c[0]).collect();
    assert!(field.iter().zip([0.25e-4, -0.125e-4, 0.5e-4]).all(|(x, y)| (x - y).abs() < 1e-18), "{field:?}");
    assert_eq!(series("height.baro").component(0), [503.0, 504.0, 505.0, 506.0, 507.0]);
    let used = ["angular-rate.imu", "specific-force.imu", "magnetic-field.imu"].map(|channel| series(channel).len());
    assert_eq!(used, [20, 15, 10]);
}

#[test]
fn camera_poses_before_2022_are_read_only_where_referenced_to_north() {
    let topic = "vehicle_visual_odometry:uint64_t timestamp;uint64_t timestamp_sample;float x;float y;float z;float[4] q;\
                 float vx;float vy;float vz;uint8_t local_frame;uint8_t velocity_frame;";
    let loaded = load_topics(&[(topic, 0)], |i| {
        let values = floats(&[i as f32, 2.0, -3.0, 1.0, 0.0, 0.0, 0.0, 5.0, 0.0, 0.0]);
        // From the fifth row on the heading has its own origin.
        vec![[&(9_950_000 + 200_000 * i).to_le_bytes()[..], &values, &[u8::from(i >= 5), 1]].concat()]
    });
    let place = &loaded.flight.channels["position.vision"].series;
    assert_eq!(place.components().iter().map(|c| c[4]).collect::<Vec<_>>(), [4.0, 2.0, -3.0]);
    assert_eq!((place.len(), place.timeline().first()), (5, Some(Stamp(9_950_000_000))));
    assert_eq!(loaded.flight.channels["attitude.vision"].series.len(), 5);
    assert!(!loaded.flight.channels.contains_key("velocity.vision"));
}

#[test]
fn an_estimator_sensor_replay_has_magnetometer_and_barometer_too() {
    let rows = |i: u64| {
        let us = 40_000 * i;
        format!(
            "{us},imu,0.1,0.2,-9.8,0.01,0.02,0.03\n{us},mag,0.25,-0.125,0.5\n{us},baro,{}\n\
             {us},gps,488099.0,85456074.0,{}.0,1.5,-0.5,0.25\n",
            487 + i,
            473_977_508 + i
        )
    };
    let (_folder, path) = file("replay.csv", (0..20).map(rows).collect::<String>().as_bytes());
    let loaded = load(&tables(&[path])).unwrap();
    assert_eq!(loaded.binding.as_ref().unwrap().map, "px4-ecl-replay");
    let first = |channel: &str| -> Vec<f64> {
        loaded.flight.channels[channel].series.components().iter().map(|component| component[0]).collect()
    };
    let field = first("magnetic-field.imu");
    assert!(field.iter().zip([0.25e-4, -0.125e-4, 0.5e-4]).all(|(x, y)| (x - y).abs() < 1e-18), "{field:?}");
    assert_eq!((first("height.baro"), first("velocity.gps")), (vec![487.0], vec![1.5, -0.5, 0.25]));
    assert!((first("position.gps")[0].to_degrees() - 47.397_750_8).abs() < 1e-9);
}

#[test]
fn a_log_whose_first_receiver_has_no_fix_is_dated_by_its_second() {
    let topic = "sensor_gps:uint64_t timestamp;double latitude_deg;double longitude_deg;uint64_t time_utc_usec;uint8_t fix_type;";
    let loaded = load_topics(&[(topic, 0), (topic, 1)], |i| {
        let [lat, lon] = place(i).map(f64::to_le_bytes);
        let row = |utc: u64, fix: u8| [&lat[..], &lon, &utc.to_le_bytes(), &[fix]].concat();
        vec![row(0, 0), row(1_520_000_000_000_000 + 200_000 * i, 3)]
    });
    assert_eq!(loaded.flight.unix(Clock::Boot, Stamp(10_000_000_000)), Some(Stamp(1_520_000_000_000_000_000)));
}

#[test]
fn appended_data_are_read_after_a_truncated_message() {
    let cut = |share: usize| {
        let body = small(8);
        let first = body.len() - share;
        let mut made = Made(body[..first].to_vec());
        made.entry(b'I', &[], "char[5] ver_hw", b"BOARD");
        made.data(0, 9_000_000, &floats(&[77.0, 0.0]));
        made.sync();
        // The offset goes into the flag bits.
        made.0[16 + 3 + 8] = 1;
        made.0[16 + 3 + 16..16 + 3 + 24].copy_from_slice(&(first as u64).to_le_bytes());
        made.0
    };
    let whole = read(&cut(0));
    assert!(!loses(&whole) && numbers(&whole, "pose", "x").len() == 9);
    assert_eq!(whole.health.about.hardware.as_deref(), Some("BOARD"));
    // Into the sync, and further into the esc before it.
    for share in [4, 30] {
        let log = read(&cut(share));
        assert_eq!(numbers(&log, "pose", "x").last(), Some(&77.0), "{share}");
        assert_eq!(log.health.damage_count, 1, "{:?}", log.health.damage);
    }
}

/// Every topic's rows as text, in file order.
fn rows(log: &Log) -> Vec<(String, Vec<String>)> {
    let row = |t: &Table, row: usize| {
        let cells = t.columns.iter().map(|c| format!("{:?}/{:?}", c.number(row), c.text(row))).collect::<Vec<_>>();
        format!("{} {}", t.logged_ns.as_ref().unwrap()[row], cells.join(" "))
    };
    log.tables.iter().map(|t| (t.topic.name.clone(), (0..t.rows).map(|i| row(t, i)).collect())).collect()
}

fn rows_of<'r>(rows: &'r [(String, Vec<String>)], topic: &str) -> &'r [String] {
    rows.iter().find(|(name, _)| name == topic).map_or(&[], |(_, rows)| rows)
}

/// Where each message ends.
fn ends(bytes: &[u8]) -> Vec<usize> {
    let mut ends = vec![16];
    let mut at = 16;
    while at < bytes.len() {
        at += 3 + usize::from(u16::from_le_bytes([bytes[at], bytes[at + 1]]));
        ends.push(at);
    }
    ends
}

#[test]
fn a_log_cut_anywhere_gives_the_rows_before_the_cut_and_reports_it() {
    let bytes = small(12);
    let ends = ends(&bytes);
    let whole = rows(&read(&bytes));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.ulg");
    std::fs::write(&path, &bytes).unwrap();
    let on_disk = std::fs::File::options().write(true).open(&path).unwrap();
    for cut in (0..bytes.len()).rev() {
        on_disk.set_len(cut as u64).unwrap();
        match read_path(&path, Limits::default()) {
            Ok(log) => {
                for (topic, rows) in rows(&log) {
                    assert!(rows_of(&whole, &topic).starts_with(&rows), "cut at {cut}: {topic}");
                }
                let expected = ends.iter().filter(|&&end| end <= cut).count();
                let data = (0..expected.saturating_sub(1)).filter(|&i| bytes[ends[i] + 2] == b'D').count();
                assert_eq!(log.health.messages, data as u64, "cut at {cut}");
                let reported = loses(&log) || log.health.bytes.tail_cut > 0;
                assert_eq!(reported, !ends.contains(&cut), "cut at {cut}");
            }
            Err(LogError::Unusable { .. } | LogError::NotALog { .. }) => {
                assert!(!ends[1..].contains(&cut), "cut at {cut} between two messages");
            }
            Err(error) => panic!("cut at {cut}: {error}"),
        }
    }
}

#[test]
fn a_flipped_bit_changes_only_its_own_row_and_no_row_is_lost_silently() {
    let bytes = small(2);
    let ends = ends(&bytes);
    let whole = rows(&read(&bytes));
    let count = |rows: &[(String, Vec<String>)]| rows.iter().map(|(_, rows)| rows.len()).sum::<usize>();
    let first_row = ends[ends.iter().position(|&end| bytes[end + 2] == b'D').unwrap()];
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.ulg");
    std::fs::write(&path, &bytes).unwrap();
    let on_disk = std::fs::File::options().write(true).open(&path).unwrap();
    for bit in 0..8 * bytes.len() {
        let (at, byte) = (bit / 8, bytes[bit / 8]);
        crate::made::write_at(&on_disk, &[byte ^ 1 << (bit % 8)], at as u64);
        let result = read_path(&path, Limits::default());
        crate::made::write_at(&on_disk, &[byte], at as u64);
        let log = match result {
            Ok(log) => log,
            Err(LogError::Unusable { .. } | LogError::NotALog { .. }) if bit / 8 < first_row => continue,
            Err(error) => panic!("bit {bit}: {error}"),
        };
        let rows = rows(&log);
        assert!(count(&rows) >= count(&whole) || loses(&log) || !log.notices.is_empty(), "bit {bit}: lost silently");
        if bit / 8 < first_row {
            continue;
        }
        assert!(count(&rows) >= count(&whole) || loses(&log), "bit {bit}: a row was lost without a loss");
        let mut missing = 0;
        for (topic, expected) in &whole {
            let there = rows_of(&rows, topic);
            missing += expected.iter().filter(|row| !there.contains(row)).count();
        }
        assert!(missing <= 2, "bit {bit}: {missing} rows are missing");
        assert!(count(&rows) <= count(&whole), "bit {bit}: invented rows");
    }
}

#[test]
fn everything_before_and_after_a_damaged_stretch_is_read() {
    // More than the reader buffers.
    let bytes = small(14_000);
    assert!(bytes.len() > (1 << 20) + 100_000, "{}", bytes.len());
    let ends = ends(&bytes);
    let whole = read(&bytes).health.messages;
    for (from, length) in [
        (100_000, 1),
        (500_000, 16),
        (700_000, 512),
        ((1 << 20) - 400_000, 8),
        ((1 << 20) - 2000, 4096),
        (1 << 20, 100_000),
        (600_000, 500_000),
    ] {
        let fill = (length % 3) as u8 * 0x44;
        let mut damaged = bytes.clone();
        damaged[from..from + length].fill(fill);
        let log = read(&damaged);
        let hit = ends.windows(2).filter(|e| e[0] < from + length && e[1] > from && bytes[e[0] + 2] == b'D').count();
        let lost = whole - log.health.messages;
        assert!(lost <= hit as u64 + 1, "{from} {length} {fill}: {lost} of {hit}");
        // A few changed bytes may just be another value.
        assert!(length < 512 || loses(&log), "{from} {length} {fill}");
    }
}

#[test]
fn a_missing_beginning_and_missing_formats_are_reported() {
    let bytes = small(20);
    let mut headless = bytes.clone();
    headless[..16].fill(0xaa);
    let log = read(&headless);
    assert_eq!(log.health.messages, 60);
    assert_eq!(log.health.bytes.damaged, 16);
    let mut formless = bytes.clone();
    let place = formless.windows(5).position(|w| w == b"pose:").unwrap();
    formless[place..place + 20].fill(0);
    let log = read(&formless);
    assert_eq!(numbers(&log, "esc", "n").len(), 20);
    let bad = notice(&log, "undecodable").unwrap();
    assert_eq!(bad.0, Severity::Loss);
    // One at the very end could only lead to the end.
    assert!((38..=40).contains(&bad.1), "{bad:?}");
}

#[test]
fn unknown_types_and_flags_are_counted_and_the_rest_is_read() {
    let mut made = Made(small(4));
    made.put(b'Z', b"something new");
    made.data(0, 5_000_000, &floats(&[5.0, 5.0]));
    made.0[16 + 3 + 8] = 2;
    let log = read(&made.0);
    assert_eq!(numbers(&log, "pose", "x").last(), Some(&5.0));
    assert_eq!(notice(&log, "unknown-record"), Some((Severity::Loss, 1)));
    assert_eq!(notice(&log, "unknown-record"), Some((Severity::Loss, 1)));
}

#[test]
fn flag_bits_may_be_longer_but_come_first() {
    let plain = small(4);
    let end = 16 + 3 + 40;
    for more in [1, 8] {
        let mut longer = [&plain[..end], &vec![0; more][..], &plain[end..]].concat();
        longer[16] = 40 + more as u8;
        let log = read(&longer);
        assert!(!loses(&log) && log.health.damage.is_empty(), "{:?}", log.notices);
        assert_eq!(log.tables, read(&plain).tables);
        longer[16 + 3 + 8] = 2;
        assert_eq!(notice(&read(&longer), "unknown-record"), Some((Severity::Loss, 1)));
    }
    let mut late = Made(plain);
    late.put(b'B', &[0; 40]);
    late.data(0, 5_000_000, &floats(&[5.0, 5.0]));
    let log = read(&late.0);
    assert!(
        log.health.damage[0].reason.contains("flag bits that are not the first message"),
        "{:?}",
        log.health.damage
    );
    assert_eq!(numbers(&log, "pose", "x").last(), Some(&5.0));
}

#[test]
fn a_message_with_a_wrong_length_is_dropped_and_its_neighbours_are_kept() {
    let mut made = Made(small(2));
    made.data(0, 5_000_000, &floats(&[5.0]));
    made.data(0, 6_000_000, &floats(&[6.0, 6.0]));
    made.data(99, 7_000_000, &floats(&[6.0, 6.0]));
    made.data(0, 8_000_000, &floats(&[8.0, 8.0]));
    let log = read(&made.0);
    assert_eq!(numbers(&log, "pose", "x"), [0.0, 1.0, 6.0, 8.0]);
    assert_eq!(notice(&log, "undecodable"), Some((Severity::Loss, 1)));
    assert!(log.health.damage[0].reason.contains("length that does not fit"), "{:?}", log.health.damage);
}

#[test]
fn hostile_formats_are_rejected_with_a_reason_and_the_rest_is_read() {
    let mut made = Made::begin([0; 3]);
    made.format("loop:uint64_t timestamp;other x;");
    made.format("other:loop y;");
    made.format("big:uint64_t timestamp;uint8_t[2000000000] x;");
    made.format("bomb:uint64_t timestamp;level0[4000000000] x;");
    for level in 0..40 {
        made.format(&format!("level{level}:level{}[4000000000] a;level{}[4000000000] b;", level + 1, level + 1));
    }
    for i in 0..70_000 {
        made.format(&format!("f{i}:uint64_t timestamp;"));
    }
    for (number, name) in ["loop", "big", "bomb", "missing"].into_iter().enumerate() {
        made.subscribe(number as u16, 0, name);
        made.data(number as u16, 1, &[0; 8]);
    }
    made.format("pose:uint64_t timestamp;float x;");
    made.subscribe(9, 0, "f5");
    made.data(9, 2, &[]);
    let log = read(&made.0);
    assert_eq!(log.health.messages, 5);
    assert_eq!(table(&log, "f5").rows, 1);
    assert_eq!(notice(&log, "undecodable"), Some((Severity::Loss, 4)));
    let reason = |name: &str| log.health.topics.iter().find(|t| t.name == name).unwrap().reason.clone();
    for (topic, what) in
        [("loop", "contains itself"), ("big", "field x of big"), ("bomb", "deep"), ("missing", "does not define")]
    {
        assert!(reason(topic).contains(what), "{topic}: {}", reason(topic));
    }
    assert!(log.health.damage.iter().any(|d| d.reason.contains("too many formats")), "{:?}", log.health.damage);
}

#[test]
fn a_file_that_is_not_a_ulog_is_rejected_and_a_sparse_file_ends_soon() {
    for (bytes, what) in [(&b""[..], "empty"), (&[0; 1000], "zero bytes"), (b"<html>no log at all</html>", "text")] {
        let error = read_with(bytes, Limits::default()).unwrap_err().to_string();
        assert!(error.contains(what), "{error}");
    }
    let (_folder, path) = file("log.ulg", &small(4));
    std::fs::File::options().write(true).open(&path).unwrap().set_len(100 << 30).unwrap();
    let log = read_path(&path, Limits::default()).unwrap();
    assert!(log.health.messages >= 11 && log.health.damage_count == 1, "{:?}", log.health.damage);
}

#[test]
fn only_wanted_fields_are_decoded_and_the_bytes_of_other_topics_are_skipped() {
    let want = |topic: &TopicInfo| {
        let field = FieldRequest { path: "y".to_owned(), kind: ValueKind::Number };
        if topic.name == "pose_1" { Selection::Fields(vec![field]) } else { Selection::Skip }
    };
    let (_folder, path) = file("log.ulg", &small(10));
    let log = read_files(Limits::default(), LogKind::Ulog, &[path], &want).unwrap();
    assert_eq!(log.tables.len(), 1);
    assert_eq!(log.tables[0].columns.iter().map(|c| c.path.as_str()).collect::<Vec<_>>(), ["y"]);
    let poses = 10 * (3 + 2 + 8 + 8);
    assert_eq!((log.health.bytes.decoded, log.health.bytes.damaged), (poses, 0));
    assert_eq!(log.health.messages, 30);
}

fn load_files(files: &[LogFile]) -> Loaded {
    let (_folder, path) = file("log.ulg", &files[0].bytes);
    let unit = FlightUnit { id: "test".into(), files: vec![path], kind: LogKind::Ulog };
    let loaded = load(&unit).unwrap();
    assert_ledger(&loaded);
    loaded
}

/// Values within a step of a 32-bit float of their size; timestamps truncated to µs, with a common shift.
fn assert_within_quantum(ours: &Channel, theirs: &Channel, kind: StampKind, zero_ns: i64, name: &str) {
    assert_eq!(ours.series.len(), theirs.series.len(), "{name}");
    let (ours_c, theirs_c) = (ours.series.components(), theirs.series.components());
    for row in 0..ours.series.len() {
        let size = theirs_c.iter().map(|c| c[row].abs()).fold(0.0, f64::max);
        for (x, y) in ours_c.iter().zip(theirs_c) {
            assert!((x[row] - y[row]).abs() <= size * 1.2e-7, "{name}: {} {}", x[row], y[row]);
        }
    }
    let line = theirs.series.timeline();
    let stamps = match kind {
        kind if kind == line.kind() => line.stamps().to_vec(),
        kind => theirs.other_stamps.iter().find(|(k, ..)| *k == kind).unwrap().2.clone(),
    };
    for (x, y) in ours.series.timeline().stamps().iter().zip(stamps) {
        assert_eq!(x.0 + zero_ns, y.0.div_euclid(1000) * 1000, "{name}");
    }
}

/// When the log clock was zero: ten seconds before the second of the first stamp.
fn zero_ns(first: Stamp) -> i64 {
    (first.0.div_euclid(1_000_000_000) - 10) * 1_000_000_000
}

#[test]
fn a_simulated_flight_survives_a_ulog_within_its_field_resolution() {
    let position = SensorSettings { delay_s: 0.4, white_std: 0.3, ..SensorSettings::clean(5.0) };
    let velocity = SensorSettings { white_std: 0.1, ..SensorSettings::clean(100.0) };
    let settings = FlightSettings { duration_s: 30.0, position, velocity, ..FlightSettings::default() };
    let simulated = simulate(&settings).unwrap();
    let truth = simulated.to_flight().unwrap();
    let loaded = load_files(&Container::Ulog.files(&simulated, "f").unwrap());
    assert_eq!(loaded.binding.as_ref().unwrap().map, "px4-ulog");
    assert!(!lossy(&loaded) && loaded.health.bytes.damaged == 0);
    let zero = zero_ns(settings.start);
    for (name, kind) in [
        ("position.gps", StampKind::Logged),
        ("velocity.gps", StampKind::Logged),
        ("position.truth", StampKind::Measured),
    ] {
        assert_within_quantum(&loaded.flight.channels[name], &truth.channels[name], kind, zero, name);
    }
    let about = &loaded.health.about;
    assert_eq!((about.system.as_deref(), about.texts.len()), (Some("PX4"), 30));
    assert_eq!(about.configured_delays[0].value_s, 0.11);
    assert_eq!(about.firmware.as_deref(), Some("1.16.0 release, git 0123456789abcdef"));
}

#[test]
fn a_simulated_bench_survives_a_ulog_within_its_field_resolution() {
    let mut settings = BenchSettings {
        swing_s: 8.0,
        rest_s: [1.0, 1.0],
        pulses: Some(Pulses { stamp_jitter_s: 1e-5, drop_share: 0.0 }),
        ..BenchSettings::default()
    };
    settings.sensor.insert(BenchChannel::PositionIns, BenchSensor::noisy(50.0, 0.01).late(0.1));
    let bench = simulate_bench(&settings).unwrap();
    let truth = bench.to_flight().unwrap();
    let loaded = load_files(&bench.files(Container::Ulog, "bench").unwrap());
    assert_eq!(loaded.binding.as_ref().unwrap().map, "px4-ulog");
    let first = truth.channels.values().flat_map(|c| c.series.timeline().first()).min().unwrap();
    let zero = zero_ns(first);
    let names = [
        ("encoder.bar", "encoder.bar", StampKind::Measured),
        ("position.gps", "position.gps", StampKind::Logged),
        ("position.ekf-global", "position.ins", StampKind::Measured),
        ("attitude.ekf", "attitude.ins", StampKind::Measured),
        ("angular-rate.filtered", "angular-rate.imu", StampKind::Measured),
        ("specific-force.filtered", "specific-force.imu", StampKind::Measured),
        ("magnetic-field.imu", "magnetic-field.imu", StampKind::Measured),
        ("height.baro", "height.baro", StampKind::Measured),
        ("pps.sensor", "pps.sensor", StampKind::Logged),
    ];
    let mut compared = 0;
    for (ours, theirs, kind) in names {
        let (Some(ours), Some(theirs)) = (loaded.flight.channels.get(ours), truth.channels.get(theirs)) else {
            continue;
        };
        assert_within_quantum(ours, theirs, kind, zero, theirs.source.topic.as_str());
        compared += 1;
    }
    assert!(compared >= 7, "{:?} {:?}", loaded.flight.channels.keys(), truth.channels.keys());
}

/// A log of two topics; the payload of one of its messages of `data` begins with `carried`.
fn carrying(carried: &[u8], rows: u64) -> Vec<u8> {
    let mut made = Made::begin([0; 3]);
    made.format(&format!("data:uint64_t timestamp;uint8_t[{}] data;", carried.len()));
    made.format("pose:uint64_t timestamp;float x;");
    made.subscribe(0, 0, "data");
    made.subscribe(1, 0, "pose");
    for i in 0..rows {
        let at_us = 1_000_000 + 10_000 * i;
        let content = if i == rows / 2 { carried.to_vec() } else { vec![0; carried.len()] };
        made.data(0, at_us, &content);
        made.data(1, at_us + 10, &floats(&[i as f32]));
    }
    made.0
}

#[test]
fn missing_doubled_or_swapped_blocks_cost_only_the_messages_they_cut() {
    let bytes = small(300);
    let ends = ends(&bytes);
    // Disk faults: a sector is missing, duplicated, or overwritten by another.
    for place in (8192..bytes.len() - 4096).step_by(733) {
        let (front, sector, rest) = (&bytes[..place], &bytes[place..place + 512], &bytes[place + 512..]);
        let missing = [front, rest].concat();
        let doubled = [front, sector, sector, rest].concat();
        let swapped = [front, &rest[1024..1536], &rest[..1024], sector, &rest[1536..]].concat();
        let within = |from: usize, to: usize| ends.windows(2).filter(|m| m[0] >= from && m[1] <= to).count() as u64;
        let all = ends.len() as u64 - 1;
        let seams = [place, place + 512, place + 1536, place + 2048];
        let cut = |seams: &[usize]| seams.iter().filter(|seam| !ends.contains(seam)).count() as u64;
        for (mixed, intact) in [
            (missing, all - within(place, place + 512) - cut(&seams[..2])),
            (doubled, all - cut(&seams[..2]) + within(place, place + 512)),
            (swapped, all - cut(&seams)),
        ] {
            let log = read(&mixed);
            // Texts, definitions and syncs are messages too, but have no rows.
            let topics: u64 = log.tables.iter().map(|table| table.rows as u64).sum();
            let others = ends.windows(2).filter(|m| bytes[m[0] + 2] != b'D').count() as u64;
            // A message could begin where a cut one ends; the message before a seam may be given up.
            assert!(topics + others + 5 >= intact, "{place}: {topics} + {others} of {intact}, {:?}", log.health.damage);
        }
    }
}

#[test]
fn a_length_that_ends_within_the_padding_of_a_format_is_invalid() {
    let bytes = small(40);
    let esc: Vec<usize> =
        ends(&bytes).into_iter().filter(|&at| bytes.get(at + 2..at + 5) == Some(&[b'D', 3, 0])).collect();
    let whole = rows(&read(&bytes));
    for &at in &esc[..esc.len() - 1] {
        let mut lying = bytes.clone();
        // Two bytes of padding are not written: one of them would belong to the next message.
        lying[at] += 1;
        let log = read(&lying);
        assert!(loses(&log));
        let found = rows(&log);
        let lost: Vec<usize> = whole.iter().map(|(topic, rows)| rows.len() - rows_of(&found, topic).len()).collect();
        assert!(lost.iter().sum::<usize>() <= 2, "{at}: {lost:?}");
    }
}

#[test]
fn wrong_definitions_cost_only_their_own_topic_and_are_reported() {
    let bytes = small(60);
    let whole = rows(&read(&bytes));
    let place = |text: &[u8]| bytes.windows(text.len()).position(|window| window == text).unwrap();
    let others = |log: &Log, own: &[&str]| {
        let found = rows(log);
        whole.iter().filter(|(topic, _)| !own.contains(&topic.as_str())).for_each(|(topic, rows)| {
            assert_eq!(rows_of(&found, topic), rows, "{topic}");
        });
    };
    // A type in the most frequent topic's format, its name, and a subscription with another's number.
    let lies = [
        (place(b"float x;float y;"), b'g', &["pose", "pose_1"][..]),
        (place(b"report[2] esc") + 7, b'1', &["esc"]),
        (place(b"pose:"), b'q', &["pose", "pose_1"]),
        (place(b"\x01\x07\0pose") + 1, 0, &["pose", "pose_1"]),
    ];
    for (at, byte, own) in lies {
        let mut lying = bytes.clone();
        lying[at] = byte;
        let log = read(&lying);
        assert!(loses(&log) || log.notices.iter().any(|n| n.severity == Severity::Warning), "{at}: {:?}", log.notices);
        others(&log, own);
    }
    // The length of the flag bits.
    for length in [41, 42, 104, 168] {
        let mut lying = bytes.clone();
        lying[16] = length;
        assert!(loses(&read(&lying)), "{length}");
    }
}

#[test]
fn a_message_of_unknown_format_is_not_read_with_its_ids_old_format() {
    let mut made = Made::begin([0; 3]);
    made.format("a:uint64_t timestamp;float x;");
    made.subscribe(0, 0, "a");
    (0..10).for_each(|i| made.data(0, 1_000_000 + 1000 * i, &floats(&[1.0])));
    made.subscribe(0, 0, "b");
    (0..10).for_each(|i| made.data(0, 2_000_000 + 1000 * i, &floats(&[2.0])));
    let log = read(&made.0);
    assert_eq!((numbers(&log, "a", "x"), loses(&log)), (vec![1.0; 10], true), "{:?}", log.notices);
}

#[test]
fn a_topic_padded_differently_from_the_others_is_reported() {
    let mut made = Made::begin([0; 3]);
    made.format("a:uint64_t timestamp;float[3] x;uint8_t[4] _padding0;");
    made.format("b:uint64_t timestamp;float x;uint8_t[4] _padding0;");
    made.subscribe(0, 0, "a");
    made.subscribe(1, 0, "b");
    for i in 0..30 {
        made.data(0, 1_000_000 + 1000 * i, &floats(&[1.0, 2.0, 3.0]));
        made.data(1, 1_000_010 + 1000 * i, &floats(&[4.0]));
    }
    assert!(read(&made.0).notices.is_empty());
    let mut lying = made.0.clone();
    let digit = lying.windows(9).position(|window| window == b"float[3] ").unwrap() + 6;
    lying[digit] = b'2';
    assert_eq!(notice(&read(&lying), "read-leniently"), Some((Severity::Warning, 30)));
}

#[test]
fn a_log_after_a_truncated_one_is_read_whole_and_so_is_the_truncated_part() {
    let second = small(6);
    let expected = rows(&read(&second));
    let first = carrying(&[0; 64], 3);
    let whole = rows(&read(&first));
    let (data, ends) = (rows_of(&whole, "data"), ends(&first));
    for cut in 17..first.len() {
        let log = read(&[&first[..cut], &second].concat());
        let found = rows(&log);
        for topic in ["pose_1", "esc"] {
            assert_eq!(rows_of(&found, topic).len(), rows_of(&expected, topic).len(), "{topic} cut at {cut}");
        }
        // After the flag bits: two formats, two subscriptions, then one message of each topic in turn.
        let messages = ends.iter().filter(|&&end| end <= cut).count().saturating_sub(6);
        // The message just before a fragment may be given up.
        let kept = rows_of(&found, "data");
        assert!(data[..messages.div_ceil(2)].starts_with(kept), "cut at {cut}");
        assert!(
            kept.len() + 1 >= messages.div_ceil(2) && log.health.messages + 1 >= messages as u64 + 18,
            "cut at {cut}"
        );
        if messages > 1 {
            assert_eq!(notice(&log, "several-sessions").map(|(_, count)| count), Some(2), "cut at {cut}");
            let stamps = |topic| table(&log, topic).logged_ns.as_ref().unwrap().clone();
            assert!(stamps("esc")[0] > *stamps("data").last().unwrap(), "cut at {cut}");
        }
    }
}

#[test]
fn a_log_of_a_later_version_after_another_is_found() {
    let mut later = small(5);
    later[7] = 2;
    for both in [[small(4), later.clone()], [later, small(4)]] {
        let log = read(&both.concat());
        assert_eq!((table(&log, "esc").rows, log.health.bytes.damaged), (9, 0), "{:?}", log.notices);
        assert_eq!(notice(&log, "several-sessions").map(|(_, count)| count), Some(2));
        assert!(notice(&log, "unknown-record").is_some(), "{:?}", log.notices);
    }
}

#[test]
fn a_wrong_timestamp_at_the_end_of_a_log_does_not_shift_the_next_log() {
    let first = small(20);
    let mut wrong = Made(first.clone());
    wrong.data(0, 1 << 62, &floats(&[20.0, 0.5]));
    let ends = |bytes: &[u8]| {
        let log = read(&[bytes, &small(20)].concat());
        table(&log, "esc").logged_ns.as_ref().unwrap().clone()
    };
    assert_eq!(ends(&wrong.0), ends(&first));
    assert!(ends(&first).iter().all(|&ns| ns < 60_000_000_000), "{:?}", ends(&first));
}
