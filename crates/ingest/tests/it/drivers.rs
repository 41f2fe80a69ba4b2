//! Channel maps of receivers and autopilots that log through their ROS drivers. Names of types and fields are those of the drivers'
//! own definitions.

use flight::{Binding, ChannelHealth, Flight, Quantity};
use ingest::{Column, ColumnData, Log, MapLibrary, Table, TopicInfo, bind};

/// 2020-12-04 20:44:52 UTC, which is second 506710 of GPS week 2134: 18 leap seconds.
const UTC_S: i64 = 1_607_114_692;
const WEEK: f64 = 2134.0;
const TOW_MS: f64 = 506_710_000.0;

/// Messages of a driver, once a second from [`UTC_S`] on, with timestamps 0.3 s later.
struct Topic(Table);

impl Topic {
    fn new(name: &str, type_name: &str, rows: usize) -> Topic {
        let stamps: Vec<i64> = (0..rows as i64).map(|row| (UTC_S + row) * 1_000_000_000 + 300_000_000).collect();
        let topic = TopicInfo { name: name.into(), type_name: type_name.into(), encoding: "cdr".into() };
        let origin = ingest::Places::default();
        let logged = Some(stamps.clone());
        let table = Table { topic, rows, published_ns: logged.clone(), logged_ns: logged, origin, columns: vec![] };
        Topic(table).with("header.stamp", ColumnData::I64(stamps))
    }

    fn with(mut self, path: &str, data: ColumnData) -> Topic {
        self.0.columns.push(Column { path: path.into(), data, valid: None });
        self.0.columns.sort_by(|a, b| a.path.cmp(&b.path));
        self
    }

    fn numbers(self, columns: &[(&str, &[f64])]) -> Topic {
        columns.iter().fold(self, |topic, (path, values)| topic.with(path, ColumnData::F64(values.to_vec())))
    }
}

fn bound<const N: usize>(topics: [Topic; N]) -> (Flight, Binding) {
    let mut log = Log { tables: topics.map(|topic| topic.0).into(), ..Log::default() };
    bind(&mut log, &MapLibrary::shipped().unwrap(), None).unwrap()
}

/// Every row of a channel: UTC as ms since [`UTC_S`], and the components.
fn content(flight: &Flight, channel: &str) -> Vec<(i64, Vec<f64>)> {
    let series = &flight.channels[channel].series;
    let of_row = |(row, stamp): (usize, &flight::Stamp)| {
        let utc = flight.unix(series.timeline().clock(), *stamp).unwrap();
        (utc.0 / 1_000_000 - UTC_S * 1000, series.components().iter().map(|component| component[row]).collect())
    };
    series.timeline().stamps().iter().enumerate().map(of_row).collect()
}

/// UTC of every row, ms since [`UTC_S`].
fn times(flight: &Flight, channel: &str) -> Vec<i64> {
    content(flight, channel).into_iter().map(|(ms, _)| ms).collect()
}

fn reasons(health: &ChannelHealth) -> Vec<(&str, u64)> {
    health.rejected.iter().map(|r| (r.reason.as_str(), r.count)).collect()
}

fn assert_near(found: &[f64], expected: &[f64]) {
    let near = |(a, b): (&f64, &f64)| (a - b).abs() <= 1e-12 * (1.0 + b.abs());
    assert!(found.len() == expected.len() && found.iter().zip(expected).all(near), "{found:?} {expected:?}");
}

#[test]
fn novatels_driver_uses_the_receivers_gps_time_not_the_drivers() {
    let head = |topic: Topic| {
        let tow: Vec<f64> = (0..topic.0.rows).map(|row| TOW_MS + 1000.0 * row as f64).collect();
        let week = vec![WEEK; tow.len()];
        topic.numbers(&[("nov_header.gps_week_number", &week), ("nov_header.gps_week_milliseconds", &tow)])
    };
    // The second has no solution.
    let place = head(Topic::new("/novatel/oem7/bestpos", "novatel_oem7_msgs/msg/BESTPOS", 3)).numbers(&[
        ("lat", &[51.0, 0.0, 51.2]),
        ("lon", &[-114.0, 0.0, -114.2]),
        ("hgt", &[1094.0, 0.0, 1096.0]),
        ("sol_status.status", &[0.0, 1.0, 0.0]),
    ]);
    let speed = head(Topic::new("/novatel/oem7/bestvel", "novatel_oem7_msgs/msg/BESTVEL", 3)).numbers(&[
        ("hor_speed", &[10.0, 10.0, 10.0]),
        ("trk_gnd", &[0.0, 90.0, 180.0]),
        ("ver_speed", &[1.0, 2.0, 3.0]),
        ("sol_status.status", &[0.0; 3]),
    ]);
    // Aligning, good, free, alignment complete.
    let inertial = head(Topic::new("/novatel/oem7/inspva", "novatel_oem7_msgs/msg/INSPVA", 4)).numbers(&[
        ("latitude", &[51.0; 4]),
        ("longitude", &[-114.0; 4]),
        ("height", &[1077.0; 4]),
        ("north_velocity", &[1.0; 4]),
        ("east_velocity", &[2.0; 4]),
        ("up_velocity", &[3.0; 4]),
        ("roll", &[0.0; 4]),
        ("pitch", &[0.0; 4]),
        ("azimuth", &[90.0; 4]),
        ("status.status", &[1.0, 3.0, 6.0, 7.0]),
    ]);
    let (flight, binding) = bound([place, speed, inertial]);
    assert_eq!(binding.map, "novatel-ros");
    let place = content(&flight, "position.gps");
    assert_eq!(times(&flight, "position.gps"), [0, 2000]);
    assert_near(&place[1].1, &[51.2_f64.to_radians(), (-114.2_f64).to_radians(), 1096.0]);
    let speed = content(&flight, "velocity.gps");
    assert_near(&speed[0].1, &[10.0, 0.0, -1.0]);
    assert_near(&speed[1].1, &[0.0, 10.0, -2.0]);
    let inertial = content(&flight, "velocity.ins");
    assert_eq!(times(&flight, "velocity.ins"), [1000, 2000, 3000]);
    assert_near(&inertial[0].1, &[1.0, 2.0, -3.0]);
    assert_eq!(flight.channels["attitude.ins"].quantity, Quantity::Attitude);
}

#[test]
fn septentrios_driver_has_angles_in_radians_and_minus_2e10_is_absent() {
    let head = |topic: Topic| {
        let tow: Vec<f64> = (0..topic.0.rows).map(|row| TOW_MS + 1000.0 * row as f64).collect();
        let week = vec![WEEK; tow.len()];
        topic.numbers(&[("block_header.wnc", &week), ("block_header.tow", &tow)])
    };
    const NONE: f64 = -2e10;
    // No solution; an error; a good one.
    let solution = head(Topic::new("/pvtgeodetic", "septentrio_gnss_driver/msg/PVTGeodetic", 3)).numbers(&[
        ("mode", &[0.0, 4.0, 4.0]),
        ("error", &[1.0, 2.0, 0.0]),
        ("latitude", &[NONE, 0.8, 0.9]),
        ("longitude", &[NONE, 0.1, 0.2]),
        ("height", &[NONE, 500.0, 600.0]),
        ("vn", &[NONE, 1.0, 1.5]),
        ("ve", &[NONE, 2.0, 2.5]),
        ("vu", &[NONE, 3.0, 3.5]),
    ]);
    // Only the second has the part with the velocity.
    let inertial = head(Topic::new("/insnavgeod", "septentrio_gnss_driver/msg/INSNavGeod", 2)).numbers(&[
        ("gnss_mode", &[4.0, 4.0]),
        ("error", &[0.0, 0.0]),
        ("latitude", &[0.9, 0.9]),
        ("longitude", &[0.2, 0.2]),
        ("height", &[600.0, 600.0]),
        ("vn", &[NONE, 1.5]),
        ("ve", &[NONE, 2.5]),
        ("vu", &[NONE, 3.5]),
    ]);
    let (flight, binding) = bound([solution, inertial]);
    assert_eq!(binding.map, "septentrio-ros");
    let rows = |name: &str| content(&flight, name);
    assert_eq!(rows("position.gps"), [(2000, vec![0.9, 0.2, 600.0])]);
    assert_eq!(rows("velocity.gps"), [(2000, vec![1.5, 2.5, -3.5])]);
    assert_eq!(rows("position.ins").len(), 2);
    assert_eq!(rows("velocity.ins"), [(1000, vec![1.5, 2.5, -3.5])]);
    // The direction of its angles is unknown.
    assert!(!flight.channels.contains_key("attitude.ins"));
}

#[test]
fn navpvt_of_the_ublox_driver_is_read_from_ros_1_and_ros_2() {
    for [fix_type, north, east, down] in [["fixType", "velN", "velE", "velD"], ["fix_type", "vel_n", "vel_e", "vel_d"]]
    {
        let solution = Topic::new("/ublox/navpvt", "ublox_msgs/NavPVT", 3).numbers(&[
            ("year", &[2020.0; 3]),
            ("month", &[12.0; 3]),
            ("day", &[4.0; 3]),
            ("hour", &[20.0; 3]),
            ("min", &[44.0; 3]),
            ("sec", &[52.0, 53.0, 54.0]),
            // The second one begins a quarter of a second early.
            ("nano", &[0.0, -250_000_000.0, 400.0]),
            // All but the lowest bit describe the kind of fix, valid or not.
            ("flags", &[130.0, 1.0, 131.0]),
            (fix_type, &[3.0; 3]),
            ("lat", &[470_000_000.0; 3]),
            ("lon", &[80_000_000.0; 3]),
            ("height", &[450_000.0; 3]),
            (north, &[1500.0; 3]),
            (east, &[-2500.0; 3]),
            (down, &[250.0; 3]),
        ]);
        let (flight, binding) = bound([solution]);
        assert_eq!(binding.map, "ublox-ros");
        let velocity = content(&flight, "velocity.gps");
        assert_eq!(times(&flight, "velocity.gps"), [750, 2000], "{north}");
        assert_near(&velocity[0].1, &[1.5, -2.5, 0.25]);
        assert_near(&content(&flight, "position.gps")[0].1, &[47_f64.to_radians(), 8_f64.to_radians(), 450.0]);
        let health = binding.channels.iter().find(|c| c.name == "position.gps").unwrap();
        assert_eq!(reasons(health), [("bit 0 of flags is not set", 1)]);
    }
}

#[test]
fn a_valid_gps_fix_has_position_and_velocity_of_one_solution() {
    for type_name in ["gps_common/GPSFix", "gps_msgs/msg/GPSFix"] {
        let fix = Topic::new("/gps/gps", type_name, 3).numbers(&[
            ("status.status", &[-1.0, 0.0, 2.0]),
            ("latitude", &[0.0, 47.0, 47.1]),
            ("longitude", &[0.0, 8.0, 8.1]),
            ("altitude", &[0.0, 450.0, 460.0]),
            ("track", &[0.0, 270.0, 360.0]),
            ("speed", &[0.0, 20.0, 30.0]),
            ("climb", &[0.0, 1.0, -1.0]),
        ]);
        let (flight, binding) = bound([fix]);
        assert_eq!(binding.map, "gps-fix");
        let velocity = content(&flight, "velocity.gps");
        // The header's timestamp.
        assert_eq!(times(&flight, "velocity.gps"), [1300, 2300]);
        assert_near(&velocity[0].1, &[0.0, -20.0, -1.0]);
        assert_near(&velocity[1].1, &[30.0, 0.0, 1.0]);
        assert_eq!(flight.channels["position.gps"].series.len(), 2);
    }
}

#[test]
fn px4_in_ros_2_is_dated_by_its_receiver_for_boot_time_and_utc() {
    for (begin_us, gps, local) in [
        (12_000_000, "/fmu/out/vehicle_gps_position", "/fmu/out/vehicle_local_position_v1"),
        (UTC_S * 1_000_000, "/px4_2/fmu/out/vehicle_gps_position", "/px4_2/fmu/out/vehicle_local_position"),
        (12_000_000, "/fmu/vehicle_gps_position/out", "/fmu/vehicle_local_position/out"),
    ] {
        let us = |rows: i64, late_us: i64| {
            ColumnData::I64((0..rows).map(|row| begin_us + 1_000_000 * row + late_us).collect())
        };
        let receiver = Topic::new(gps, "px4_msgs/msg/SensorGps", 3)
            .with("timestamp", us(3, 0))
            .with("time_utc_usec", ColumnData::I64((0..3).map(|row| (UTC_S + row) * 1_000_000).collect()))
            .numbers(&[
                ("fix_type", &[3.0; 3]),
                ("latitude_deg", &[47.0; 3]),
                ("longitude_deg", &[8.0; 3]),
                ("altitude_ellipsoid_m", &[450.0; 3]),
                ("vel_ned_valid", &[1.0, 0.0, 1.0]),
                ("vel_n_m_s", &[4.0; 3]),
                ("vel_e_m_s", &[5.0; 3]),
                ("vel_d_m_s", &[6.0; 3]),
            ]);
        let estimate = Topic::new(local, "px4_msgs/msg/VehicleLocalPosition", 3)
            .with("timestamp", us(3, 500))
            .with("timestamp_sample", us(3, 0))
            .numbers(&[
                ("xy_valid", &[1.0; 3]),
                ("v_xy_valid", &[1.0; 3]),
                ("x", &[1.0; 3]),
                ("y", &[2.0; 3]),
                ("z", &[3.0; 3]),
                ("vx", &[4.0; 3]),
                ("vy", &[5.0; 3]),
                ("vz", &[6.0; 3]),
            ]);
        let (flight, binding) = bound([receiver, estimate]);
        assert_eq!(binding.map, "px4-ros2");
        assert_eq!(times(&flight, "velocity.gps"), [0, 2000], "{gps}");
        assert_eq!(times(&flight, "velocity.ekf"), [0, 1000, 2000], "{gps}");
        // Samples keep their timestamps.
        assert_eq!(flight.channels["velocity.ekf"].series.timeline().stamps()[0], flight::Stamp(begin_us * 1000));
        assert_near(&content(&flight, "velocity.ekf")[0].1, &[4.0, 5.0, 6.0]);
        assert_eq!(flight.channels["position.ekf"].quantity, Quantity::PositionNed);
    }
}

#[test]
fn an_all_zero_height_yields_to_mean_sea_level_height_and_is_reported() {
    for (ellipsoid, expected, codes) in
        [([0.0; 2], [550.0, 551.0], vec!["assumption", "assumption"]), ([600.0, 0.0], [600.0, 0.0], vec![])]
    {
        let receiver = Topic::new("/fmu/out/vehicle_gps_position", "px4_msgs/msg/SensorGps", 2)
            .with("timestamp", ColumnData::I64(vec![1_000_000, 2_000_000]))
            .numbers(&[
                ("fix_type", &[3.0; 2]),
                ("latitude_deg", &[47.0; 2]),
                ("longitude_deg", &[8.0; 2]),
                ("altitude_ellipsoid_m", &ellipsoid),
                ("altitude_msl_m", &[550.0, 551.0]),
            ]);
        let (flight, _) = bound([receiver]);
        assert_eq!(flight.channels["position.gps"].series.component(2), expected);
        let reported = flight.notices.iter().filter(|n| n.text.contains("position.gps"));
        let mut reported: Vec<&str> = reported.map(|n| n.code.as_str()).collect();
        reported.sort_unstable();
        assert_eq!(reported, codes);
    }
}

/// A fix as gpsd_client or a driver publishes it, at this speed to the north.
fn gps_fix(speed: f64) -> Topic {
    Topic::new("/gps", "gps_msgs/msg/GPSFix", 2).numbers(&[
        ("status.status", &[0.0; 2]),
        ("latitude", &[47.0, 47.1]),
        ("longitude", &[8.0; 2]),
        ("altitude", &[450.0; 2]),
        ("track", &[0.0; 2]),
        ("speed", &[speed; 2]),
        ("climb", &[0.0; 2]),
        ("status.satellites_used", &[9.0; 2]),
    ])
}

#[test]
fn a_generic_gps_fix_map_ranks_below_device_maps_and_nonzero_velocity() {
    let week = Topic::new("/pvtgeodetic", "septentrio_gnss_driver/msg/PVTGeodetic", 2).numbers(&[
        ("block_header.wnc", &[WEEK; 2]),
        ("block_header.tow", &[TOW_MS, TOW_MS + 1000.0]),
        ("mode", &[4.0; 2]),
        ("error", &[0.0; 2]),
        ("latitude", &[0.8; 2]),
        ("longitude", &[0.1; 2]),
        ("height", &[500.0; 2]),
        ("vn", &[1.0; 2]),
        ("ve", &[2.0; 2]),
        ("vu", &[3.0; 2]),
    ]);
    assert_eq!(bound([week, gps_fix(20.0)]).1.map, "septentrio-ros");
    let standard = || {
        let place = Topic::new("/fix", "sensor_msgs/msg/NavSatFix", 2).numbers(&[
            ("status.status", &[0.0; 2]),
            ("latitude", &[47.0, 47.1]),
            ("longitude", &[8.0; 2]),
            ("altitude", &[450.0; 2]),
        ]);
        let velocity = Topic::new("/vel", "geometry_msgs/msg/TwistStamped", 2).numbers(&[
            ("twist.linear.x", &[22.0; 2]),
            ("twist.linear.y", &[0.0; 2]),
            ("twist.linear.z", &[0.0; 2]),
        ]);
        (place, velocity)
    };
    // A fix converted from NavSatFix has no speed.
    for (speed, map) in [(0.0, "navsatfix-twist"), (20.0, "gps-fix")] {
        let (place, velocity) = standard();
        assert_eq!(bound([place, velocity, gps_fix(speed)]).1.map, map, "{speed}");
    }
}

#[test]
fn inspvax_height_is_above_mean_sea_level_and_inspva_above_ellipsoid() {
    for (type_name, status, is_reported) in [("INSPVA", "status.status", false), ("INSPVAX", "ins_status.status", true)]
    {
        let solution = Topic::new("/ins", &format!("novatel_oem7_msgs/msg/{type_name}"), 2).numbers(&[
            ("nov_header.gps_week_number", &[WEEK; 2]),
            ("nov_header.gps_week_milliseconds", &[TOW_MS, TOW_MS + 1000.0]),
            ("latitude", &[51.0; 2]),
            ("longitude", &[-114.0; 2]),
            ("height", &[1077.0; 2]),
            ("north_velocity", &[1.0; 2]),
            ("east_velocity", &[2.0; 2]),
            ("up_velocity", &[3.0; 2]),
            (status, &[3.0; 2]),
        ]);
        let (flight, _) = bound([solution]);
        assert_eq!(flight.channels["position.ins"].series.component(2), [1077.0; 2]);
        assert_eq!(flight.notices.iter().any(|n| n.code == "assumption"), is_reported, "{type_name}");
    }
}
