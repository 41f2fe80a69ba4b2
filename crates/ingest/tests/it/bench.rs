//! Bench logs: a simulated bench in every format, and how tables and messages of sensors are bound.

use crate::support::*;
use flight::{Channel, Clock, Flight, Quantity, Stamp, StampKind};
use ingest::{ChannelMap, FlightUnit, Loaded, LogKind, MapLibrary};
use simulate::{
    BagCompression, BagSettings, BenchChannel, BenchSensor, BenchSettings, ClockError, Container, EncoderOutput,
    LogFile, McapCompression, McapEncoding, McapSettings, Pulses, SimulatedBench, simulate_bench,
};
use std::path::Path;

/// All channels, with noise, so that no two values are alike.
fn settings() -> BenchSettings {
    let mut settings = BenchSettings {
        swing_s: 8.0,
        rest_s: [1.0, 1.0],
        pulses: Some(Pulses { stamp_jitter_s: 1e-5, drop_share: 0.0 }),
        ..BenchSettings::default()
    };
    let more = [
        (BenchChannel::PositionIns, BenchSensor::noisy(50.0, 0.01).late(0.1)),
        (BenchChannel::VelocityGps, BenchSensor::noisy(4.0, 0.05)),
        (BenchChannel::MagneticDirection, BenchSensor::noisy(50.0, 0.004)),
    ];
    settings.sensor.extend(more);
    settings.sensor.get_mut(&BenchChannel::Attitude).unwrap().rotation_rad = [0.01, -0.02, 0.03];
    settings
}

fn containers() -> Vec<Container> {
    use {BagCompression as B, McapCompression as C, McapEncoding as E};
    let mcap = |encoding, compression| Container::Mcap(McapSettings { encoding, compression, summary: true });
    let bag = |compression| Container::Bag(BagSettings { compression, indexed: true });
    vec![
        Container::CsvFolder,
        mcap(E::Cdr, C::Zstd),
        mcap(E::Ros1, C::Lz4),
        mcap(E::Json, C::None),
        bag(B::None),
        bag(B::Lz4Linked),
    ]
}

fn read(files: &[LogFile]) -> Loaded {
    let folder = tempfile::tempdir().unwrap();
    for file in files {
        let path = folder.path().join(&file.path);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, &file.bytes).unwrap();
    }
    let library = MapLibrary::shipped().unwrap();
    let found = ingest::discover(folder.path(), &library).unwrap();
    assert_eq!((found.units.len(), found.ignored.len()), (1, 0), "{found:?}");
    let loaded = load(&found.units[0]).unwrap();
    assert_ledger(&loaded);
    loaded
}

/// Everything measured in a channel: clock, stamps, values as bits, repeats, arrivals.
type Measured = (StampKind, Clock, Vec<Stamp>, Vec<Vec<u64>>, Vec<bool>, Vec<(StampKind, Clock, Vec<Stamp>)>);

fn measured(channel: &Channel) -> Measured {
    let line = channel.series.timeline();
    let bits = channel.series.components().iter().map(|values| values.iter().map(|v| v.to_bits()).collect()).collect();
    let others = channel.other_stamps.clone();
    (line.kind(), line.clock(), line.stamps().to_vec(), bits, channel.held.clone(), others)
}

fn assert_same(read: &Flight, truth: &Flight, what: &str) {
    let names = |flight: &Flight| flight.channels.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(read), names(truth), "{what}");
    for (name, channel) in &read.channels {
        let theirs = &truth.channels[name];
        let (ours, theirs) = ((channel.quantity, measured(channel)), (theirs.quantity, measured(theirs)));
        assert!(ours == theirs, "{what}: {name} differs from what was simulated");
    }
}

fn map_of(loaded: &Loaded) -> &str {
    &loaded.binding.as_ref().unwrap().map
}

#[test]
fn one_bench_in_every_container_gives_the_same_channels_bit_for_bit() {
    let bench = simulate_bench(&settings()).unwrap();
    let mut truth = bench.to_flight().unwrap();
    // The logged timestamps of a pulse are its edges: one kind only.
    assert_eq!(truth.channels["pps.sensor"].other_stamps, []);
    truth.notices = flight::Notices::default();
    assert_eq!(truth.channels.len(), 12);
    for container in containers() {
        let loaded = read(&bench.files(container, "bench").unwrap());
        assert_eq!(map_of(&loaded), "flightlag-bench");
        assert_same(&loaded.flight, &truth, &format!("{container:?}"));
        assert!(!lossy(&loaded), "{container:?}");
    }
}

#[test]
fn two_logs_with_two_clocks_each_keep_their_timestamps() {
    let mut settings = settings();
    settings.clocks.device = Some(ClockError { offset_s: 512.5, skew: 40e-6 });
    settings.clocks.logger = ClockError { offset_s: -0.75, skew: 0.0 };
    let bench = simulate_bench(&settings).unwrap();
    let (encoder, sensor) = bench.to_flights().unwrap();
    assert_eq!(sensor.channels["angular-rate.imu"].series.timeline().clock(), Clock::Boot);
    for container in containers() {
        let loaded = read(&bench.encoder_files(container, "daq").unwrap());
        assert_same(&loaded.flight, &encoder, &format!("encoder, {container:?}"));
        let loaded = read(&bench.sensor_files(container, "mti").unwrap());
        assert_eq!(map_of(&loaded), "flightlag-bench-clocks");
        assert_same(&loaded.flight, &sensor, &format!("sensor, {container:?}"));
        let loaded = read(&bench.files(container, "both").unwrap());
        assert_same(&loaded.flight, &bench.to_flight().unwrap(), &format!("one log, {container:?}"));
    }
}

#[test]
fn a_wide_bench_table_is_exact_and_marks_held_values() {
    let bench = simulate_bench(&settings()).unwrap();
    let loaded = read(&bench.files(Container::CsvWide, "bench").unwrap());
    assert_eq!(map_of(&loaded), "bench-wide-csv");
    assert_same(&loaded.flight, &bench.to_wide_flight().unwrap(), "wide");
    let held = |name: &str| loaded.flight.channels[name].is_held();
    assert!(held("position.gps") && held("velocity.gps") && held("position.ins"));
    assert!(!held("encoder.bar") && !held("angular-rate.imu") && !held("attitude.ins"));
}

#[test]
fn an_encoder_alone_is_bound_as_counts_and_as_an_angle() {
    for (output, name, quantity) in [
        (EncoderOutput::Count, "encoder.bar", Quantity::EncoderCount),
        (EncoderOutput::Angle, "encoder.angle", Quantity::EncoderAngle),
    ] {
        let mut settings = settings().only(&[]);
        settings.encoder.output = output;
        let bench = simulate_bench(&settings).unwrap();
        for container in containers().into_iter().chain([Container::CsvWide]) {
            let loaded = read(&bench.files(container, "encoder").unwrap());
            let channel = &loaded.flight.channels[name];
            assert_eq!(channel.quantity, quantity, "{container:?}");
            assert_eq!(channel.series.component(0), bench.encoder_values(), "{container:?}");
            // Two seconds of rest in ten: a bar at rest is still measured.
            assert!(!channel.is_held(), "{container:?}");
        }
    }
}

#[test]
fn a_sensor_without_position_and_velocity_is_bound() {
    let imu = [BenchChannel::AngularRate, BenchChannel::SpecificForce];
    let bench = simulate_bench(&settings().only(&imu)).unwrap();
    for container in containers().into_iter().chain([Container::CsvWide]) {
        let loaded = read(&bench.sensor_files(container, "imu").unwrap());
        let names: Vec<&String> = loaded.flight.channels.keys().collect();
        assert_eq!(names, ["angular-rate.imu", "specific-force.imu"], "{container:?}");
    }
}

/// A table with the shipped maps.
fn table(text: &str) -> Loaded {
    let (_folder, path) = file("bench.csv", text.as_bytes());
    let loaded = load(&tables(&[path])).unwrap();
    assert_ledger(&loaded);
    loaded
}

#[test]
fn a_bare_table_of_an_encoder_is_read_under_its_common_names() {
    for (head, name, quantity, values) in [
        ("time_s,counts", "encoder.bar", Quantity::EncoderCount, [10.0, -20.0, -20.0]),
        ("Time (s),Encoder", "encoder.bar", Quantity::EncoderCount, [10.0, -20.0, -20.0]),
        ("Time,Count", "encoder.bar", Quantity::EncoderCount, [10.0, -20.0, -20.0]),
        ("time,angle_rad", "encoder.angle", Quantity::EncoderAngle, [10.0, -20.0, -20.0]),
        ("time,Angle (deg)", "encoder.angle", Quantity::EncoderAngle, [10.0f64, -20.0, -20.0].map(f64::to_radians)),
    ] {
        let loaded = table(&format!("{head}\n0.000,10\n0.010,-20\n0.020,-20\n"));
        assert_eq!(map_of(&loaded), "encoder-csv", "{head}");
        let channel = &loaded.flight.channels[name];
        assert_eq!((channel.quantity, channel.series.component(0)), (quantity, &values[..]), "{head}");
        assert_eq!(channel.series.timeline().stamps(), [0, 10_000_000, 20_000_000].map(Stamp), "{head}");
    }
}

#[test]
fn a_table_with_one_gyroscope_axis_is_an_angular_rate_of_that_axis() {
    let loaded = table("time_s,encoder_angle_deg,gyro_y_degps\n0,90,180\n0.01,90,90\n0.02,45,0\n");
    let gyro = &loaded.flight.channels["angular-rate.imu"];
    assert_eq!(gyro.present, [false, true, false]);
    assert_eq!(gyro.series.component(1), [180.0f64, 90.0, 0.0].map(f64::to_radians));
    assert_eq!(gyro.series.component(0), [0.0; 3]);
    let absent: Vec<&str> =
        loaded.flight.notices.iter().filter(|n| n.code == "assumption").map(|n| n.text.as_str()).collect();
    assert!(absent[0].contains("no x") && absent[1].contains("no z"), "{absent:?}");
    let angle = &loaded.flight.channels["encoder.angle"].series;
    assert_eq!(angle.component(0), [90.0f64, 90.0, 45.0].map(f64::to_radians));
}

/// A map of one channel over a table of five columns.
fn bound_by(entry: &str, rows: &str) -> Flight {
    let text = format!(
        "schema = 1\nname = \"mine\"\ntitle = \"t\"\n[time]\nlogged = [{{ field = \"t\", unit = \"s\", clock = \"elapsed\" }}]\n\
         [[channel]]\nname = \"mine\"\ntimeline = \"logged\"\n{entry}"
    );
    let mut library = MapLibrary::shipped().unwrap();
    library.add(ChannelMap::from_toml(Path::new("mine.toml"), &text).unwrap());
    let (_folder, path) = file("mine.csv", format!("t,a,b,c,d\n{rows}").as_bytes());
    let unit = FlightUnit { id: "mine".into(), files: vec![path], kind: LogKind::Csv };
    load_mapped(&unit, &library, Some("mine")).unwrap().flight
}

fn row_of(flight: &Flight, row: usize) -> Vec<f64> {
    flight.channels["mine"].series.components().iter().map(|c| c[row]).collect()
}

fn fields(roles: [&str; 3], unit: &str) -> String {
    let line = |(role, column): (&str, &str)| format!("{role} = {{ field = \"{column}\", unit = \"{unit}\" }}\n");
    format!("[channel.fields]\n{}", roles.into_iter().zip(["a", "b", "c"]).map(line).collect::<String>())
}

#[test]
fn vectors_become_forward_right_down_from_any_axis_names() {
    let rows = "0,1,2,3,0\n1,4,5,6,0\n";
    for (frame, roles, expected) in [
        ("frame = \"frd\"\n", ["x", "y", "z"], [1.0, 2.0, 3.0]),
        ("frame = \"flu\"\n", ["x", "y", "z"], [1.0, -2.0, -3.0]),
        ("", ["forward", "left", "up"], [1.0, -2.0, -3.0]),
        ("", ["forward", "right", "down"], [1.0, 2.0, 3.0]),
        ("", ["left", "forward", "down"], [2.0, -1.0, 3.0]),
    ] {
        let entry = format!("quantity = \"specific-force\"\n{frame}{}", fields(roles, "g0"));
        let flight = bound_by(&entry, rows);
        let g = 9.80665;
        assert_eq!(row_of(&flight, 0), expected.map(|v| v * g), "{entry}");
    }
    let nano = format!("quantity = \"magnetic-field\"\nframe = \"frd\"\n{}", fields(["x", "y", "z"], "nT"));
    assert_eq!(row_of(&bound_by(&nano, rows), 0), [1e-9, 2e-9, 3e-9]);
    let rate = format!("quantity = \"angular-rate\"\nframe = \"frd\"\n{}", fields(["x", "y", "z"], "deg/s"));
    assert_eq!(row_of(&bound_by(&rate, rows), 0), [1.0f64, 2.0, 3.0].map(f64::to_radians));
}

#[test]
fn euler_angles_and_a_long_quaternion_of_one_attitude_give_one_quaternion() {
    let angles = format!("quantity = \"attitude\"\nframe = \"frd-ned\"\n{}", fields(["roll", "pitch", "yaw"], "deg"));
    // Yaw 180°, and nose up 90° after yaw 90°.
    let flight = bound_by(&angles, "0,0,0,180,0\n1,0,90,90,0\n");
    let quaternion = "quantity = \"attitude\"\nframe = \"frd-ned\"\n[channel.fields]\n\
        orientation_w = { field = \"a\", unit = \"1\" }\norientation_x = { field = \"b\", unit = \"1\" }\n\
        orientation_y = { field = \"c\", unit = \"1\" }\norientation_z = { field = \"d\", unit = \"1\" }\n";
    let same = bound_by(quaternion, "0,0,0,0,9\n1,2,-2,2,2\n");
    for row in 0..2 {
        let (a, b) = (row_of(&flight, row), row_of(&same, row));
        assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-15), "{a:?} {b:?}");
    }
    // A driver without orientation leaves all zeros: those rows are counted, and no attitude is invented.
    let none = bound_by(quaternion, "0,0,0,0,0\n1,0,0,0,0\n2,0,0,0,1\n");
    assert_eq!(none.channels["mine"].series.len(), 1);
    assert!(none.notices.iter().any(|n| n.code == "rejected-row" && n.count == 2));
}

#[test]
fn a_held_vector_repeats_all_its_components_and_a_resting_encoder_is_measured() {
    let held: String = (0..40).map(|i| format!("{i},1,2,{},0\n", i / 4)).collect();
    let vector = format!("quantity = \"specific-force\"\nframe = \"frd\"\n{}", fields(["x", "y", "z"], "m/s^2"));
    let marks = &bound_by(&vector, &held).channels["mine"].held.clone();
    assert_eq!(marks.iter().filter(|held| **held).count(), 30);
    let reported = bound_by(&vector, &held).notices;
    let reported: Vec<_> = reported.iter().filter(|n| n.code == "held-rows").map(|n| n.count).collect();
    assert_eq!(reported, [30]);
    // Only the third axis moves: for a vector that is a new value.
    let moving: String = (0..40).map(|i| format!("{i},1,2,{i},0\n")).collect();
    assert!(!bound_by(&vector, &moving).channels["mine"].is_held());
    let count = "quantity = \"encoder-count\"\n[channel.fields]\ncount = { field = \"c\", unit = \"1\" }\n";
    assert!(!bound_by(count, &held).channels["mine"].is_held());
    let height = "quantity = \"height\"\n[channel.fields]\nheight = { field = \"c\", unit = \"m\" }\n";
    assert!(bound_by(height, &held).channels["mine"].is_held());
}

#[test]
fn a_sensor_map_without_a_frame_is_rejected() {
    let of = |entry: String| {
        let text = format!(
            "schema = 1\nname = \"n\"\ntitle = \"t\"\n[time]\nlogged = [{{ container = \"logged\" }}]\n\
             [[channel]]\nname = \"c\"\ntimeline = \"logged\"\n{entry}"
        );
        ChannelMap::from_toml(Path::new("mine.toml"), &text).unwrap_err().to_string()
    };
    let axes = fields(["x", "y", "z"], "rad/s");
    for (entry, expected) in [
        (format!("quantity = \"angular-rate\"\n{axes}"), "need a frame: frd or flu"),
        (format!("quantity = \"angular-rate\"\nframe = \"flu-enu\"\n{axes}"), "need a frame: frd or flu"),
        (format!("quantity = \"specific-force\"\nframe = \"flu\"\n{axes}"), "rad/s is not a unit of Acceleration"),
        (format!("quantity = \"attitude\"\n{}", fields(["roll", "pitch", "yaw"], "deg")), "an attitude needs a frame"),
        (
            format!("quantity = \"angular-rate\"\nframe = \"flu\"\n{}", fields(["forward", "left", "up"], "rad/s")),
            "is only for",
        ),
        (
            format!("quantity = \"angular-rate\"\n{}", fields(["left", "right", "up"], "rad/s")),
            "right cannot be combined",
        ),
        ("quantity = \"angular-rate\"\n[channel.fields]\n".into(), "no field: give x, y or z"),
        ("quantity = \"encoder-count\"\n[channel.fields]\n".into(), "the field count is missing"),
        (
            "quantity = \"encoder-angle\"\n[channel.fields]\nangle = { field = \"a\", unit = \"1\" }\n".into(),
            "1 is not a unit of Angle",
        ),
    ] {
        let error = of(entry.clone());
        assert!(error.contains("mine.toml:6: channel c") && error.contains(expected), "{entry}: {error}");
    }
}

#[test]
fn an_encoder_in_a_flight_does_not_change_the_flights_map() {
    let rows = "2024-05-10T17:27:01Z,47.1,8.5,400,1,2,3,3,7\n2024-05-10T17:27:02Z,47.2,8.5,400,1,2,3,3,8\n";
    let loaded = table(&format!("time,lat,lon,hMSL,velN,velE,velD,gpsFix,counts\n{rows}"));
    assert_eq!(map_of(&loaded), "flysight-1");
}

/// The attitude of mavros must carry the accelerometer to the vertical, and its nose along the track.
#[test]
fn the_attitude_and_the_accelerometer_of_alfa_agree_with_gravity_and_with_the_track() {
    let Some(folder) = real_logs("ALFA") else { return };
    let found = ingest::discover(&folder, &MapLibrary::shipped().unwrap()).unwrap();
    let flight = load(&found.units[0]).unwrap().flight;
    let channel = |name: &str| &flight.channels[name].series;
    let (attitude, force, velocity) = (channel("attitude.ekf"), channel("specific-force.imu"), channel("velocity.ekf"));
    let q = |row: usize| [0, 1, 2, 3].map(|k| attitude.component(k)[row]);
    let turned = |q: [f64; 4], v: [f64; 3]| {
        let [w, x, y, z] = q;
        [
            (1.0 - 2.0 * (y * y + z * z)) * v[0] + 2.0 * (x * y - w * z) * v[1] + 2.0 * (x * z + w * y) * v[2],
            2.0 * (x * y + w * z) * v[0] + (1.0 - 2.0 * (x * x + z * z)) * v[1] + 2.0 * (y * z - w * x) * v[2],
            2.0 * (x * z - w * y) * v[0] + 2.0 * (y * z + w * x) * v[1] + (1.0 - 2.0 * (x * x + y * y)) * v[2],
        ]
    };
    let (mut sum, mut turns) = ([0.0; 3], vec![]);
    for row in 0..attitude.len() {
        let ned = turned(q(row), [0, 1, 2].map(|k| force.component(k)[row]));
        (0..3).for_each(|k| sum[k] += ned[k] / attitude.len() as f64);
        let now = attitude.timeline().stamps()[row];
        let at = velocity.timeline().stamps().partition_point(|s| *s < now).min(velocity.len() - 1);
        let (north, east) = (velocity.component(0)[at], velocity.component(1)[at]);
        let nose = turned(q(row), [1.0, 0.0, 0.0]);
        if north.hypot(east) > 10.0 {
            let off = (east.atan2(north) - nose[1].atan2(nose[0])).sin();
            let same_way = north * nose[0] + east * nose[1] > 0.0;
            turns.push(if same_way { off.abs() } else { 1.0 });
        }
    }
    turns.sort_by(f64::total_cmp);
    let median = turns[turns.len() / 2].asin().to_degrees();
    // The wind alone turns the nose out of the track by some degrees. Means of the force over minutes of circling
    // are gravity and little else.
    assert!(turns.len() > 100 && median < 15.0, "{} rows, {median} deg", turns.len());
    assert!((sum[2] + 9.8).abs() < 0.7 && sum[0].abs() < 0.7 && sum[1].abs() < 0.7, "{sum:?}");
}

/// At rest and level, in the device's own axes.
#[test]
fn the_old_mti_g_at_rest_measures_gravity_along_its_up_axis() {
    let Some(path) = real_logs("PlotJuggler/datasamples/tilt_laser.bag") else { return };
    let loaded = load(&ingest::discover(&path, &MapLibrary::shipped().unwrap()).unwrap().units[0]).unwrap();
    let force = &loaded.flight.channels["specific-force.imu"].series;
    let mean = |k: usize| force.component(k).iter().sum::<f64>() / force.len() as f64;
    let all = [0, 1, 2].map(mean);
    assert!((all.iter().map(|v| v * v).sum::<f64>().sqrt() - 9.8).abs() < 0.2, "{all:?}");
    let direction = &loaded.flight.channels["magnetic-direction.imu"].series;
    let strength = [0, 1, 2].map(|k| direction.component(k)[0].powi(2)).iter().sum::<f64>().sqrt();
    assert!((0.3..3.0).contains(&strength), "{strength}");
}

#[test]
fn the_rig_of_a_simulated_bench_names_its_channels() {
    let bench: SimulatedBench = simulate_bench(&settings()).unwrap();
    let rig = simulate::RigText { model: "m".into(), serial: "s".into(), to_be_fitted: false };
    let text = bench.rig_text(&rig);
    let channels = bench.to_flight().unwrap().channels;
    let sensed = channels.keys().filter(|name| !name.starts_with("encoder") && !name.starts_with("pps"));
    sensed.for_each(|name| assert!(text.contains(&format!("\"{name}\"")), "{name}"));
}
