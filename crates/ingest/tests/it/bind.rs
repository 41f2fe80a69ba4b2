//! How the binder handles rows, timestamps and maps: small tables with exact expectations.

use crate::support::*;
use flight::{ChannelHealth, Notice, Quantity, StampKind};
use ingest::{
    ChannelMap, Column, ColumnData, FlightUnit, IngestError, Loaded, Log, LogError, LogKind, MapLibrary, ScanError,
    Table, TopicInfo, bind,
};
use std::path::Path;

const HEADER: &str = "time,lat,lon,hMSL,velN,velE,velD,gpsFix\n";

fn flysight(rows: &str) -> Loaded {
    let (_folder, path) = file("flight.csv", format!("{HEADER}{rows}").as_bytes());
    let loaded = load(&tables(&[path])).unwrap();
    assert_ledger(&loaded);
    loaded
}

fn health<'a>(loaded: &'a Loaded, name: &str) -> &'a ChannelHealth {
    loaded.binding.as_ref().unwrap().channels.iter().find(|c| c.name == name).unwrap()
}

fn reasons(health: &ChannelHealth) -> Vec<(&str, u64, &str)> {
    health.rejected.iter().map(|r| (r.reason.as_str(), r.count, r.first.as_str())).collect()
}

fn row(second: u32, lat: f64) -> String {
    format!("2024-05-10T17:27:{second:02}Z,{lat},8.5,400,1,2,3,3\n")
}

#[test]
fn unusable_rows_are_counted_by_reason_with_their_first_line() {
    let rows = [
        row(1, 47.1),
        "2024-05-10T17:27:02Z,,8.5,400,1,2,3,3\n".into(),
        "2024-05-10T17:27:03Z,nan,8.5,400,1,2,3,3\n".into(),
        "2024-05-10T17:27:04Z,91.0,8.5,400,1,2,3,3\n".into(),
        "2024-05-10T17:27:05Z,0,0,400,1,2,3,3\n".into(),
        "2024-05-10T17:27:06Z,47.1,8.5,400,1,2,3,2\n".into(),
        "yesterday,47.1,8.5,400,1,2,3,3\n".into(),
        "1970-01-01T00:00:00Z,47.1,8.5,400,1,2,3,3\n".into(),
        row(9, 47.2),
        row(10, 47.3),
    ]
    .concat();
    let loaded = flysight(&rows);
    let position = health(&loaded, "position.gps");
    assert_eq!((position.rows, position.used), (10, 3));
    assert_eq!(
        reasons(position),
        [
            ("lat is missing", 2, "line 3"),
            ("latitude or longitude out of range", 1, "line 5"),
            ("latitude and longitude are zero: no fix", 1, "line 6"),
            ("gpsFix is below 3", 1, "line 7"),
            ("no timestamp", 1, "line 8"),
            ("timestamp more than a day away from the others", 1, "line 9"),
        ]
    );
    // The velocity of a row with a bad position is still a velocity.
    assert_eq!(health(&loaded, "velocity.gps").used, 7);
    assert_eq!(count_of(&loaded, "rejected-row"), 7 + 3);
    assert!(!lossy(&loaded));
}

#[test]
fn rows_are_sorted_by_timestamp_and_the_first_of_equal_ones_is_kept() {
    let loaded = flysight(&[row(3, 47.3), row(1, 47.1), row(3, 47.9), row(2, 47.2)].concat());
    let series = &loaded.flight.channels["position.gps"].series;
    let degrees: Vec<f64> = series.component(0).iter().map(|r| (r.to_degrees() * 10.0).round() / 10.0).collect();
    assert_eq!(degrees, [47.1, 47.2, 47.3]);
    assert_eq!(
        reasons(health(&loaded, "position.gps")),
        [("timestamp equal to the one before, but a different value", 1, "line 4")]
    );
    assert_eq!(health(&loaded, "position.gps").stamps.as_ref().unwrap().back_jumps, 2);
    // Once for each of the two channels; one notice reports the jumps of both.
    assert_eq!((count_of(&loaded, "unreliable-stamps"), count_of(&loaded, "duplicate-stamp")), (4, 2));
    let back: Vec<&Notice> = loaded.flight.notices.iter().filter(|n| n.code == "unreliable-stamps").collect();
    let [notice] = back.as_slice() else { panic!("{back:?}") };
    assert!(
        notice.text.starts_with("2 channels, the first of them position.gps: timestamps go back"),
        "{}",
        notice.text
    );
}

#[test]
fn a_gap_hidden_by_the_order_of_the_log_is_found() {
    // Two recordings in one file, the later one first: it has no long step forward anywhere.
    let later: String = (40..60).map(|i| row(i, 47.0 + f64::from(i) * 1e-4)).collect();
    let earlier: String = (0..10).map(|i| row(i, 47.0 + f64::from(i) * 1e-4)).collect();
    let loaded = flysight(&(later + &earlier));
    let stamps = health(&loaded, "position.gps").stamps.clone().unwrap();
    assert_eq!((stamps.gap_count, stamps.back_jumps, stamps.count), (1, 1, 30));
    assert_eq!(stamps.gaps, [flight::Gap { start_s: 9.0, length_s: 31.0 }]);
    assert_eq!(stamps.last_ns - stamps.first_ns, 59_000_000_000);
}

#[test]
fn the_reason_for_a_map_counts_its_channels() {
    let binding = flysight(&[row(1, 47.1), row(2, 47.2)].concat()).binding.unwrap();
    let channels = format!("; {} channels", binding.channels.len());
    assert!(binding.why.ends_with(&channels) && !binding.why.contains("position.gps"), "{}", binding.why);
}

#[test]
fn values_held_over_rows_are_marked_and_a_parked_receiver_is_not() {
    let moving = |i: u32| 47.0 + f64::from(i) * 1e-4;
    let held: String = (0..30).map(|i| row(i, moving(i / 3))).collect();
    let loaded = flysight(&held);
    let position = &loaded.flight.channels["position.gps"];
    assert_eq!(position.update_rows(), (0..30).step_by(3).collect::<Vec<_>>());
    let health_held = health(&loaded, "position.gps").held.clone().unwrap();
    assert_eq!((health_held.repeats, health_held.modal_run, health_held.update_interval_s), (20, 3, 3.0));

    let parked: String = (0..30).map(|i| row(i, moving(i.max(20)))).collect();
    let loaded = flysight(&parked);
    assert!(!loaded.flight.channels["position.gps"].is_held());
    assert!(health(&loaded, "position.gps").held.is_none());
    // Never moving at all is one long run, and not a sign of held values.
    assert!(!flysight(&(0..30).map(|i| row(i, 47.0)).collect::<String>()).flight.channels["position.gps"].is_held());
}

/// A vehicle that moves by less than the last decimal from row to row repeats values without holding any.
#[test]
fn rounded_values_that_repeat_are_measurements() {
    let place = |i: u32| 47.0 + 0.43e-4 * (f64::from(i) + 8.0 * (0.2 * f64::from(i)).sin());
    let rows: String = (0..60).map(|i| row(i, (place(i) * 1e4).round() / 1e4)).collect();
    let loaded = flysight(&rows);
    assert!(health(&loaded, "position.gps").held.is_none());
    assert_eq!(loaded.flight.channels["position.gps"].update_rows().len(), 60);
}

#[test]
fn a_height_that_most_rows_lack_does_not_cost_the_rows() {
    let without = |i: u32| format!("2024-05-10T17:27:{i:02}Z,47.{i},8.5,,1,2,3,3\n");
    let loaded = flysight(&[row(1, 47.1), without(2), without(3), without(4)].concat());
    let position = &loaded.flight.channels["position.gps"];
    assert_eq!((position.present.as_slice(), position.series.len()), (&[true, true, false][..], 4));
    assert_eq!(position.series.component(2), [0.0; 4]);
    assert_eq!(health(&loaded, "position.gps").absent, ["height"]);
    // A single row without it among many costs just that row.
    let loaded = flysight(&[row(1, 47.1), without(2), row(3, 47.3), row(4, 47.4)].concat());
    assert_eq!(reasons(health(&loaded, "position.gps")), [("hMSL is missing", 1, "line 3")]);
}

#[test]
fn a_channel_without_a_usable_row_is_absent_with_a_reason() {
    let loaded = flysight("2024-05-10T17:27:02Z,47,8,1,1,2,3,0\n2024-05-10T17:27:03Z,47,8,1,1,2,3,0\n");
    assert!(loaded.flight.channels.is_empty());
    assert_eq!(health(&loaded, "position.gps").used, 0);
    assert!(loaded.flight.notices.iter().any(|n| n.code == "rejected-row" && n.text.contains("gpsFix is below 3 (2)")));
}

#[test]
fn a_log_without_a_map_has_health_and_a_reason_with_its_columns() {
    let (_folder, path) = file("motor.csv", b"t,rpm\n0,1\n1,2\n");
    let loaded = load(&tables(&[path])).unwrap();
    let reason = loaded.binding.unwrap_err();
    assert!(
        reason.starts_with("no channel map fits") && reason.contains("motor") && reason.contains("t, rpm"),
        "{reason}"
    );
    assert_eq!((loaded.health.messages, loaded.health.bytes.size), (2, 14));
}

#[test]
fn what_is_missing_in_the_nearest_map_is_named() {
    let (_folder, path) = file("f.csv", b"time,lat,lonX,hMSL,velN,velEX,velD\n2024-05-10T17:27:02Z,47,8,1,1,2,3\n");
    let reason = load(&tables(&[path])).unwrap().binding.unwrap_err();
    assert!(reason.contains("nearest: flysight-1 lacks position.gps: topic f: no longitude (lon)"), "{reason}");
}

#[test]
fn a_time_that_cannot_be_parsed_is_shown() {
    let rows = "10h27m02,47,8,1,1,2,3,3\n10h27m03,47,8,1,1,2,3,3\n";
    let (_folder, path) = file("f.csv", format!("{HEADER}{rows}").as_bytes());
    let reason = load(&tables(&[path])).unwrap().binding.unwrap_err();
    assert!(reason.contains("the time time of f begins with \"10h27m02\", which cannot be read"), "{reason}");
}

#[test]
fn a_reason_stays_short_and_a_time_column_alone_suggests_no_map() {
    // The maps of autopilots know the topic by its name, and have some thirty channels.
    let (_folder, path) = file("IMU.csv", b"time,a,b\n0.0,1,2\n0.1,1,2\n");
    let reason = load(&tables(&[path])).unwrap().binding.unwrap_err();
    assert!(reason.contains("ardupilot lacks angular-rate.imu: topic IMU: no x (GyrX), specific"), "{reason}");
    assert!(reason.contains(" more channels") && reason.len() < 400, "{reason}");
    // Garmin's and other maps have its date and time, but nothing else of it.
    let (_folder, path) = file("fuel.csv", b"Lcl Date,Lcl Time,fuel\n2024-05-10,17:27:02,3\n2024-05-10,17:27:03,3\n");
    let reason = load(&tables(&[path])).unwrap().binding.unwrap_err();
    assert!(!reason.contains("nearest"), "{reason}");
}

const SAME: &str = "schema = 1\nname = \"NAME\"\ntitle = \"t\"\n[time]\nlogged = [{ field = \"t\", unit = \"s\", clock = \"boot\" }]\n\
    [[channel]]\nname = \"velocity.x\"\nquantity = \"velocity-ned\"\ntimeline = \"logged\"\n[channel.fields]\n\
    north = { field = \"a\", unit = \"UNIT\" }\neast = { field = \"b\", unit = \"UNIT\" }\nVERTICAL\n";

fn same(name: &str, unit: &str, vertical: &str) -> ChannelMap {
    let text = SAME.replace("NAME", name).replace("UNIT", unit).replace("VERTICAL", vertical);
    ChannelMap::from_toml(Path::new("x.toml"), &text).unwrap()
}

fn load_with(library: &MapLibrary, text: &str, forced: Option<&str>) -> Result<Loaded, IngestError> {
    let (_folder, path) = file("f.csv", text.as_bytes());
    load_mapped(&tables(&[path]), library, forced)
}

#[test]
fn two_equally_fitting_maps_are_an_error_that_names_both() {
    let mut library = MapLibrary::shipped().unwrap();
    library.add(same("first", "m/s", ""));
    library.add(same("second", "kt", ""));
    let text = "t,a,b\n0,1,2\n1,3,4\n";
    let reason = load_with(&library, text, None).unwrap().binding.unwrap_err();
    assert!(reason.contains("first and second") && reason.contains("--map"), "{reason}");
    let loaded = load_with(&library, text, Some("second")).unwrap();
    assert_eq!(loaded.binding.unwrap().map, "second");
    // 3600 kt are 1852 m/s.
    let north = loaded.flight.channels["velocity.x"].series.component(0).to_vec();
    assert!((north[1] - 3.0 * 1852.0 / 3600.0).abs() < 1e-15);
    assert!(matches!(load_with(&library, text, Some("third")), Err(IngestError::Map(_))));
}

#[test]
fn up_becomes_down_and_feet_a_minute_metres_a_second() {
    let mut library = MapLibrary::shipped().unwrap();
    library.add(same("up", "km/h", "up = { field = \"c\", unit = \"ft/min\" }"));
    let loaded = load_with(&library, "t,a,b,c\n0,36,-72,600\n0.25,36,-72,-600\n", Some("up")).unwrap();
    let velocity = &loaded.flight.channels["velocity.x"];
    assert_eq!(velocity.quantity, Quantity::VelocityNed);
    assert_eq!([0, 1].map(|i| velocity.series.component(i)[0]), [10.0, -20.0]);
    assert!(
        (velocity.series.component(2)[0] + 3.048).abs() < 1e-12
            && (velocity.series.component(2)[1] - 3.048).abs() < 1e-12
    );
    assert_eq!(velocity.series.timeline().stamps()[1].0, 250_000_000);
}

/// A table as a reader of typed messages gives it.
fn typed(name: &str, type_name: &str, columns: &[(&str, &[f64])], stamps: &[i64], logged: &[i64]) -> Table {
    let number = |(path, values): &(&str, &[f64])| Column {
        path: (*path).into(),
        data: ColumnData::F64(values.to_vec()),
        valid: None,
    };
    let mut columns: Vec<Column> = columns.iter().map(number).collect();
    columns.push(Column { path: "header.stamp".into(), data: ColumnData::I64(stamps.to_vec()), valid: None });
    columns.sort_by(|a, b| a.path.cmp(&b.path));
    Table {
        topic: TopicInfo { name: name.into(), type_name: type_name.into(), encoding: "ros1".into() },
        rows: stamps.len(),
        logged_ns: Some(logged.to_vec()),
        published_ns: Some(logged.to_vec()),
        origin: ingest::Places::default(),
        columns,
    }
}

const STAMPS: &[i64] = &[1_700_000_000_000_000_000, 1_700_000_001_000_000_000, 1_700_000_002_000_000_000];
const LOGGED: &[i64] = &[1_700_000_000_250_000_000, 1_700_000_001_250_000_000, 1_700_000_002_500_000_000];

fn fix(name: &str, type_name: &str) -> Table {
    let values: [(&str, &[f64]); 4] = [
        ("latitude", &[47.0, 47.1, 47.2]),
        ("longitude", &[8.0; 3]),
        ("altitude", &[400.0; 3]),
        ("status.status", &[0.0; 3]),
    ];
    typed(name, type_name, &values, STAMPS, LOGGED)
}

fn twist(name: &str, stamps: &[i64]) -> Table {
    let values: [(&str, &[f64]); 3] =
        [("twist.linear.x", &[1.0; 3]), ("twist.linear.y", &[2.0; 3]), ("twist.linear.z", &[3.0; 3])];
    typed(name, "geometry_msgs/msg/TwistStamped", &values, stamps, LOGGED)
}

fn bound(tables: Vec<Table>) -> Result<(flight::Flight, flight::Binding), IngestError> {
    bind(&mut Log { tables, ..Log::default() }, &MapLibrary::shipped().unwrap(), None)
}

#[test]
fn topics_by_type_are_found_under_any_name_and_east_north_up_becomes_north_east_down() {
    let (flight, binding) = bound(vec![fix("/a", "sensor_msgs/msg/NavSatFix"), twist("/b", STAMPS)]).unwrap();
    assert_eq!(binding.map, "navsatfix-twist");
    let velocity = &flight.channels["velocity.gps"].series;
    assert_eq!([0, 1, 2].map(|i| velocity.component(i)[0]), [2.0, 1.0, -3.0]);
    // A publish time equal to the log time carries no information.
    let others: Vec<StampKind> = flight.channels["position.gps"].other_stamps.iter().map(|(kind, ..)| *kind).collect();
    assert_eq!(others, [StampKind::Logged]);
    let offset = &binding.channels[0].offsets[0];
    assert_eq!((offset.of, offset.against), (StampKind::Logged, StampKind::Measured));
    assert_eq!((offset.offset_s.median, offset.offset_s.max), (0.25, 0.5));
}

#[test]
fn two_topics_of_the_same_type_are_named_when_ambiguous() {
    let type_name = "sensor_msgs/NavSatFix";
    let error = bound(vec![fix("/a", type_name), fix("/c", type_name)]).unwrap_err().to_string();
    assert!(error.contains("/a and /c fit equally well"), "{error}");
}

/// Former bug: of two topics of a type neither was used, and nothing was said.
#[test]
fn of_several_imus_the_shortest_name_is_used_and_of_several_receivers_none() {
    let turned: [(&str, &[f64]); 3] =
        [("angular_velocity.x", &[0.1; 3]), ("angular_velocity.y", &[0.2; 3]), ("angular_velocity.z", &[0.3; 3])];
    let imu = |name: &str| typed(name, "sensor_msgs/Imu", &turned, STAMPS, LOGGED);
    let receiver = |name: &str| fix(name, "sensor_msgs/NavSatFix");
    let tables = vec![imu("/imu/data_raw"), imu("/imu/data"), receiver("/a"), receiver("/c"), twist("/b", STAMPS)];
    let (flight, binding) = bound(tables).unwrap();
    let topic = |name: &str| binding.channels.iter().find(|c| c.name == name).map(|c| c.source.topic.as_str());
    assert_eq!((topic("angular-rate.imu"), topic("position.gps")), (Some("/imu/data"), None));
    let said: Vec<&str> =
        flight.notices.iter().filter(|n| n.code == "several-sources").map(|n| n.text.as_str()).collect();
    let is_said = |text: &str| said.iter().any(|said| said.starts_with(text));
    assert!(is_said("channel position.gps is not bound: the topics /a and /c fit equally well"), "{said:?}");
    let used =
        "channel angular-rate.imu: the topics /imu/data and /imu/data_raw fit equally well, and /imu/data is used";
    assert!(is_said(used), "{said:?}");
}

/// Former bug: the demo's map took every log with `/gps/fix` and `/gps/vel`, without its IMU.
#[test]
fn a_map_fits_only_with_the_channels_that_it_needs() {
    let of_robot = || vec![fix("/gps/fix", "sensor_msgs/NavSatFix"), twist("/gps/vel", STAMPS)];
    assert_eq!(bound(of_robot()).unwrap().1.map, "navsatfix-twist");
    let of_demo = [of_robot(), vec![fix("/truth/fix", "sensor_msgs/NavSatFix")]].concat();
    assert_eq!(bound(of_demo).unwrap().1.map, "flightlag-demo");
    let shipped = MapLibrary::shipped().unwrap();
    let demo = shipped.get("flightlag-demo").unwrap().text().to_owned();
    let mistyped = demo.replace("needs = [\"position.truth\"]", "needs = [\"position.thruth\"]");
    let error = ChannelMap::from_toml(Path::new("own.toml"), &mistyped).unwrap_err().to_string();
    assert!(error.contains("needs: the map has no channel position.thruth"), "{error}");
}

#[test]
fn topics_match_by_name_before_type_also_below_a_namespace() {
    let tables = vec![
        fix("/uav1/mavros/global_position/raw/fix", "sensor_msgs/NavSatFix"),
        twist("/uav1/mavros/local_position/velocity_local", STAMPS),
    ];
    let (flight, binding) = bound(tables).unwrap();
    assert_eq!(binding.map, "mavros");
    assert!(flight.channels.contains_key("velocity.ekf"));
    assert!(binding.others.iter().any(|o| o.map == "navsatfix-twist"));
}

#[test]
fn log_time_replaces_timestamps_never_filled_in_with_a_warning() {
    let (flight, _) = bound(vec![fix("/a", "sensor_msgs/NavSatFix"), twist("/b", &[0; 3])]).unwrap();
    let velocity = &flight.channels["velocity.gps"].series;
    assert_eq!(velocity.timeline().kind(), StampKind::Logged);
    assert_eq!(velocity.len(), 3);
    let texts: Vec<&str> = flight.notices.iter().filter(|n| n.code == "stamp-kind").map(|n| n.text.as_str()).collect();
    assert!(
        texts.iter().any(|t| t.contains("never change")) && texts.iter().any(|t| t.contains("are used instead")),
        "{texts:?}"
    );
}

#[test]
fn timestamps_of_another_clock_yield_no_offset() {
    let simulated = [10_000_000_000, 11_000_000_000, 12_000_000_000];
    let (flight, binding) = bound(vec![fix("/a", "sensor_msgs/NavSatFix"), twist("/b", &simulated)]).unwrap();
    assert!(binding.channels.iter().find(|c| c.name == "velocity.gps").unwrap().offsets.is_empty());
    assert!(flight.notices.iter().any(|n| n.code == "clock-suspect" && n.place == "/b"));
}

#[test]
fn clocks_that_are_days_apart_are_reported_once_with_the_days() {
    let simulated = [10_000_000_000, 11_000_000_000, 12_000_000_000];
    let place =
        typed("/a", "sensor_msgs/NavSatFix", &[("latitude", &[47.0; 3]), ("longitude", &[8.0; 3])], &simulated, LOGGED);
    let (flight, _) = bound(vec![place, twist("/b", &simulated)]).unwrap();
    let reported: Vec<(u64, &str)> =
        flight.notices.iter().filter(|n| n.code == "clock-suspect").map(|n| (n.count, n.text.as_str())).collect();
    // 1 699 999 990 s.
    let text = "2 channels, the first of them position.gps: logged timestamps are 19675.9 days later than measured ones, so they use different clocks";
    assert_eq!(reported, [(6, text)]);
}

#[test]
fn a_number_that_is_not_finite_rejects_its_message() {
    let mut table = fix("/a", "sensor_msgs/NavSatFix");
    for column in &mut table.columns {
        if column.path == "latitude" {
            column.data = ColumnData::F64(vec![47.0, f64::NAN, 47.2]);
        }
    }
    let (flight, binding) = bound(vec![table, twist("/b", STAMPS)]).unwrap();
    assert_eq!(flight.channels["position.gps"].series.len(), 2);
    let position = binding.channels.iter().find(|c| c.name == "position.gps").unwrap();
    assert_eq!(reasons(position), [("latitude is not finite", 1, "message 2")]);
}

#[test]
fn a_missing_file_is_an_error_with_its_name() {
    let unit = FlightUnit { id: "x".into(), files: vec!["/nowhere/x.csv".into()], kind: LogKind::Csv };
    let error = load(&unit).unwrap_err();
    assert!(
        matches!(&error, IngestError::Log(LogError::Read(ScanError::Io { file, .. })) if file == "x.csv"),
        "{error}"
    );
}

#[test]
fn a_log_written_to_while_being_read_is_an_error() {
    let text: String = (0..50_000).map(|i| format!("{i},1,2\n")).collect();
    let (_folder, path) = file("f.csv", format!("t,a,b\n{text}").as_bytes());
    let library = MapLibrary::shipped().unwrap();
    let cancel = std::sync::atomic::AtomicBool::new(false);
    let grow = |_| {
        use std::io::Write;
        std::fs::OpenOptions::new().append(true).open(&path).unwrap().write_all(b"9,9,9\n").unwrap();
    };
    let context = ingest::ReadContext { limits: ingest::Limits::default(), cancel: &cancel, on_bytes: &grow };
    let error = ingest::load(&tables(std::slice::from_ref(&path)), &library, None, &context).unwrap_err();
    assert!(
        matches!(&error, IngestError::Log(LogError::Read(ScanError::Changed { file })) if file == "f.csv"),
        "{error}"
    );
}

#[test]
fn a_wish_to_stop_is_heard() {
    let (_folder, path) = file("f.csv", b"t,a,b\n1,2,3\n");
    let library = MapLibrary::shipped().unwrap();
    let cancel = std::sync::atomic::AtomicBool::new(true);
    let context = ingest::ReadContext { limits: ingest::Limits::default(), cancel: &cancel, on_bytes: &|_| () };
    let error = ingest::load(&tables(&[path]), &library, None, &context).unwrap_err();
    assert!(matches!(error, IngestError::Log(LogError::Read(ScanError::Cancelled))));
}

/// `sensor_msgs/Imu` that looks east at rest, with or without an orientation.
fn imu(name: &str, w: f64) -> Table {
    let values: [(&str, &[f64]); 10] = [
        ("orientation.w", &[w; 3]),
        ("orientation.x", &[0.0; 3]),
        ("orientation.y", &[0.0; 3]),
        ("orientation.z", &[0.0; 3]),
        ("angular_velocity.x", &[0.1, 0.2, 0.3]),
        ("angular_velocity.y", &[0.4; 3]),
        ("angular_velocity.z", &[0.5; 3]),
        ("linear_acceleration.x", &[0.0, 0.1, 0.2]),
        ("linear_acceleration.y", &[1.0; 3]),
        ("linear_acceleration.z", &[9.8; 3]),
    ];
    typed(name, "sensor_msgs/Imu", &values, STAMPS, LOGGED)
}

#[test]
fn a_ros_imu_becomes_attitude_rate_and_force_in_forward_right_down() {
    let (flight, binding) = bound(vec![imu("/anything", 1.0)]).unwrap();
    assert_eq!(binding.map, "navsatfix-twist");
    let first = |name: &str| -> Vec<f64> { flight.channels[name].series.components().iter().map(|c| c[0]).collect() };
    let half = std::f64::consts::FRAC_1_SQRT_2;
    assert_eq!(first("attitude.imu"), [half, 0.0, 0.0, half]);
    assert_eq!(first("angular-rate.imu"), [0.1, -0.4, -0.5]);
    assert_eq!(first("specific-force.imu"), [0.0, -1.0, -9.8]);
}

#[test]
fn an_imu_without_orientation_is_no_warning_and_leaves_the_flight_unchanged() {
    let tables = || vec![fix("/a", "sensor_msgs/NavSatFix"), twist("/b", STAMPS)];
    let (plain, _) = bound(tables()).unwrap();
    let (flight, binding) = bound([tables(), vec![imu("/c", 0.0)]].concat()).unwrap();
    assert_eq!(binding.map, "navsatfix-twist");
    assert!(!flight.channels.contains_key("attitude.imu"));
    assert_eq!(flight.channels["specific-force.imu"].series.len(), 3);
    for name in ["position.gps", "velocity.gps"] {
        assert_eq!(flight.channels[name], plain.channels[name]);
    }
    let warnings =
        |flight: &flight::Flight| flight.notices.iter().filter(|n| n.severity == flight::Severity::Warning).count();
    assert_eq!(warnings(&flight), warnings(&plain));
    let absent = flight.notices.iter().find(|n| n.code == "rejected-row").unwrap();
    assert!(absent.text.contains("the orientation is zero or too large to normalise (3)"), "{}", absent.text);
}

#[test]
fn an_encoder_without_a_timestamp_uses_log_time_and_never_outranks_a_flight() {
    let ticks = |name| typed(name, "std_msgs/Int64", &[("data", &[7.0, 7.0, 9.0])], &[0; 3], LOGGED);
    let (flight, binding) = bound(vec![ticks("/motor/ticks")]).unwrap();
    assert_eq!(binding.map, "encoder-ros");
    let encoder = &flight.channels["encoder.bar"];
    assert_eq!((encoder.quantity, encoder.series.component(0)), (Quantity::EncoderCount, &[7.0, 7.0, 9.0][..]));
    assert_eq!(encoder.series.timeline().kind(), StampKind::Logged);
    assert!(flight.notices.iter().any(|n| n.code == "assumption"));
    let both = vec![fix("/a", "sensor_msgs/NavSatFix"), twist("/b", STAMPS), ticks("/motor/ticks")];
    assert_eq!(bound(both).unwrap().1.map, "navsatfix-twist");
    let joint = typed("/joints", "sensor_msgs/msg/JointState", &[("position[0]", &[0.1, 0.2, 0.3])], STAMPS, LOGGED);
    let (flight, _) = bound(vec![joint]).unwrap();
    assert_eq!(flight.channels["encoder.angle"].series.component(0), [0.1, 0.2, 0.3]);
    assert_eq!(flight.channels["encoder.angle"].series.timeline().kind(), StampKind::Measured);
}
