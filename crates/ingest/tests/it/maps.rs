//! The shipped channel maps: their schema, their checks, and how they bind real logs.

use crate::support::*;
use flight::{Clock, StampKind};
use ingest::{ChannelMap, FlightUnit, Loaded, LogKind, MapLibrary};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

fn maps_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../pipelines/channel-maps")
}

#[test]
fn the_commented_example_is_a_channel_map() {
    let map = ChannelMap::from_toml(Path::new("channel-map.example.toml"), ingest::EXAMPLE_MAP).unwrap();
    assert!(map.channel_names().count() > 10);
}

#[test]
fn every_map_in_the_folder_is_shipped_and_named_after_its_file() {
    let library = MapLibrary::shipped().unwrap();
    let mut names: Vec<&str> = library.iter().map(|m| m.name.as_str()).collect();
    names.sort_unstable();
    let entries = std::fs::read_dir(maps_folder()).unwrap().map(|e| e.unwrap().path());
    let mut files: Vec<String> = entries
        .filter(|p| p.extension().is_some_and(|e| e == "toml"))
        .map(|p| p.file_stem().unwrap().to_string_lossy().into_owned())
        .collect();
    files.sort();
    assert_eq!(names, files);
}

const GOOD: &str = "schema = 1\nname = \"n\"\ntitle = \"t\"\n[time]\nlogged = [{ field = \"t\", unit = \"s\", clock = \"boot\" }]\n\
                    [[channel]]\nname = \"velocity.x\"\nquantity = \"velocity-ned\"\ntimeline = \"logged\"\n[channel.fields]\n\
                    north = { field = \"a\", unit = \"m/s\" }\neast = { field = \"b\", unit = \"kt\" }\n";

#[test]
fn a_wrong_map_is_rejected_with_file_line_and_reason() {
    let of = |text: &str| ChannelMap::from_toml(Path::new("mine.toml"), text);
    assert!(of(GOOD).is_ok());
    for (from, to, expected) in [
        ("title =", "titel =", ":3: unknown key `titel`: did you mean `title`?"),
        ("unit = \"kt\"", "unit = \"knots\"", ":12: unknown unit \"knots\"; known are 1, rad, deg, "),
        ("unit = \"kt\"", "units = \"kt\"", ":12: unknown key `units`: did you mean `unit`?"),
        ("{ field = \"b\", unit = \"kt\" }", "\"b\"", ":12: channel.fields.east = \"b\": must be a table"),
        ("{ field = \"b\", unit = \"kt\" }", "[{ field = \"b\", units = \"kt\" }]", ":12: unknown key `units`"),
        ("unit = \"kt\"", "unit = \"deg\"", "deg is not a unit of Speed"),
        ("east =", "height =", "the field height cannot be combined"),
        ("east = { field = \"b\", unit = \"kt\" }\n", "", "the field east is missing"),
        ("clock = \"boot\"", "clock = \"moon\"", ":5: "),
        (", clock = \"boot\"", "", "needs a clock"),
        ("unit = \"kt\"", "unit = \"kt\", above = \"ellipsoid\"", "east: `above` is for heights only"),
        ("schema = 1", "schema = 2", "schema 2"),
        ("timeline = \"logged\"", "timeline = \"later\"", ":9: "),
    ] {
        let error = of(&GOOD.replace(from, to)).unwrap_err().to_string();
        assert!(error.starts_with("mine.toml:") && error.contains(expected), "{to}: {error}");
    }
}

#[test]
fn a_maps_text_is_its_files_text_and_parses_to_the_same_map() {
    for map in MapLibrary::shipped().unwrap().iter() {
        let path = maps_folder().join(format!("{}.toml", map.name));
        assert_eq!(map.text(), std::fs::read_to_string(&path).unwrap(), "{}", path.display());
        let again = ChannelMap::from_toml(&path, &format!("# mine\n{}", map.text())).unwrap();
        assert_ne!(again.text(), map.text());
        // Campaigns use the debug text as the meaning of a map.
        assert_eq!(format!("{again:?}"), format!("{map:?}"));
    }
}

#[test]
fn a_user_map_replaces_the_shipped_one_of_the_same_name() {
    let (folder, _path) = file("mine.toml", GOOD.replace("name = \"n\"", "name = \"mavros\"").as_bytes());
    let shipped = MapLibrary::shipped().unwrap();
    let count = shipped.iter().count();
    let library = shipped.with_folder(folder.path()).unwrap();
    assert_eq!(library.iter().count(), count);
    assert_eq!(library.get("mavros").unwrap().title, "t");
    let error = library.get("flysihgt1").unwrap_err().to_string();
    assert!(error.contains("the nearest are flysight-1, flysight-2, "), "{error}");
}

#[test]
fn two_maps_of_one_name_in_a_folder_are_refused_with_both_files() {
    let (folder, _path) = file("a.toml", GOOD.as_bytes());
    std::fs::write(folder.path().join("b.toml"), GOOD).unwrap();
    let error = MapLibrary::default().with_folder(folder.path()).unwrap_err().to_string();
    assert!(error.contains("b.toml: \"n\" is also the name of ") && error.contains("a.toml: rename one"), "{error}");
}

/// Checks the chosen map, and that displacement and velocity agree. Scale within `scale` of one, rotation
/// within `degrees` of zero: swapped axes, a wrong sign or a wrong unit are far outside.
fn assert_agrees(loaded: &Loaded, map: &str, pair: (&str, &str), scale: f64, degrees: f64) {
    let binding = loaded.binding.as_ref().unwrap();
    assert_eq!(binding.map, map, "{}", binding.why);
    let channel = |name: &str| loaded.flight.channels.get(name).unwrap_or_else(|| panic!("no {name}"));
    let a = agreement(channel(pair.0), channel(pair.1), 3.0);
    let what = format!(
        "{pair:?}: scale {}, rotation {}°, left {}, {} windows",
        a.scale,
        a.rotation.to_degrees(),
        a.left_over,
        a.windows
    );
    assert!(a.windows > 30, "{what}");
    assert!((a.scale - 1.0).abs() < scale && a.rotation.to_degrees().abs() < degrees && a.left_over < 0.15, "{what}");
}

/// First row, by column, of the file below `folder` with this ending: an independent parser, for files without quotes.
fn first_row(folder: &Path, ending: &str, header_lines: usize) -> HashMap<String, String> {
    let mut open = vec![folder.to_owned()];
    while let Some(next) = open.pop() {
        for path in std::fs::read_dir(next).unwrap().map(|e| e.unwrap().path()) {
            if path.is_dir() {
                open.push(path);
            } else if path.to_str().unwrap().ends_with(ending) {
                let text = std::fs::read_to_string(path).unwrap();
                let cells =
                    |line: usize| text.lines().nth(line).unwrap().split(',').map(str::to_owned).collect::<Vec<_>>();
                return cells(0).into_iter().zip(cells(header_lines)).collect();
            }
        }
    }
    panic!("no file ends with {ending}");
}

fn number(text: &str) -> f64 {
    text.parse().unwrap()
}

#[test]
fn alfa_tables_of_mavros_agree_with_themselves() {
    let Some(folder) = real_logs("ALFA") else { return };
    let found = ingest::discover(&folder, &MapLibrary::shipped().unwrap()).unwrap();
    assert_eq!(found.units.len(), 1);
    assert_eq!(found.units[0].id, "alfa-cpp/csv/carbonZ_2018-07-18-15-53-31_1_engine_failure");
    assert_eq!(found.units[0].files.len(), 34);
    let loaded = load(&found.units[0]).unwrap();
    assert_ledger(&loaded);
    for velocity in ["velocity.gps", "velocity.ekf"] {
        for position in ["position.gps", "position.ekf", "position.local"] {
            assert_agrees(&loaded, "mavros", (position, velocity), 0.01, 1.5);
        }
    }
    let fix = &loaded.flight.channels["position.gps"].series;
    let row = first_row(&folder, "mavros-global_position-raw-fix.csv", 1);
    assert_eq!(fix.timeline().kind(), StampKind::Measured);
    assert_eq!(fix.timeline().first().unwrap().0.to_string(), row["field.header.stamp"]);
    let [latitude, longitude, height] =
        ["latitude", "longitude", "altitude"].map(|k| number(&row[&format!("field.{k}")]));
    assert_eq!([0, 1].map(|k| fix.component(k)[0]), [latitude.to_radians(), longitude.to_radians()]);
    assert_eq!((fix.component(2)[0], fix.len()), (height, 662));
    // x is east, y is north.
    let velocity = &loaded.flight.channels["velocity.gps"].series;
    let row = first_row(&folder, "raw-gps_vel.csv", 1);
    let [east, north] = ["x", "y"].map(|k| number(&row[&format!("field.twist.linear.{k}")]));
    assert_eq!((velocity.component(0)[0], velocity.component(1)[0]), (north, east));
}

#[test]
fn mavros_odometry_rotated_by_its_orientation_is_the_local_velocity() {
    let Some(folder) = real_logs("ALFA/alfa-cpp/csv") else { return };
    let text = std::fs::read_to_string(maps_folder().join("navsatfix-twist.toml")).unwrap();
    // The table has no type, so the rule gets a name instead.
    let named = text.replace("type = [\"nav_msgs/Odometry\"]", "topic = [\"/local_position/odom\"]");
    let mut library = MapLibrary::shipped().unwrap();
    library.add(ChannelMap::from_toml(Path::new("odometry.toml"), &named).unwrap());
    let prefix = "carbonZ_2018-07-18-15-53-31_1_engine_failure-mavros-local_position";
    let unit = tables(&[folder.join(format!("{prefix}-odom.csv")), folder.join(format!("{prefix}-velocity.csv"))]);
    let of = |map| load_mapped(&unit, &library, Some(map)).unwrap().flight;
    let (turned, local) = (of("navsatfix-twist"), of("mavros"));
    let (turned, local) = (&turned.channels["velocity.odometry"].series, &local.channels["velocity.ekf"].series);
    let at = |i: usize| local.timeline().stamps().iter().position(|s| *s == turned.timeline().stamps()[i]);
    let pairs: Vec<(usize, usize)> = (0..turned.len()).filter_map(|i| Some((i, at(i)?))).collect();
    assert!(pairs.len() > 500, "{}", pairs.len());
    // Occasionally mavros pairs a velocity with the attitude of the message before.
    let error = |&(i, j): &(usize, usize)| {
        (0..3).map(|k| (turned.component(k)[i] - local.component(k)[j]).powi(2)).sum::<f64>().sqrt()
    };
    let mut errors: Vec<f64> = pairs.iter().map(error).collect();
    errors.sort_by(f64::total_cmp);
    assert!(errors[errors.len() / 2] < 1e-6, "median error {} m/s", errors[errors.len() / 2]);
}

#[test]
fn the_px4_map_agrees_with_itself() {
    let Some(folder) = real_logs("aircraft-polar/data") else { return };
    let found = ingest::discover(&folder, &MapLibrary::shipped().unwrap()).unwrap();
    let ids: Vec<&str> = found.units.iter().map(|u| u.id.as_str()).collect();
    assert_eq!(ids, ["dawn1_flight1_log/log", "flight3"]);
    let loaded = load(&found.units[1]).unwrap();
    assert_ledger(&loaded);
    for velocity in ["velocity.gps", "velocity.ekf"] {
        for position in ["position.gps", "position.ekf"] {
            assert_agrees(&loaded, "px4-ulog", (position, velocity), 0.015, 1.5);
        }
    }
    let channels = &loaded.flight.channels;
    let gps = &channels["position.gps"];
    // The 2 Hz table is used, not sensor_gps at 1 Hz; times are microseconds, angles 1e-7 deg, heights mm.
    assert_eq!((gps.source.topic.as_str(), gps.series.len()), ("flight3_vehicle_gps_position_0", 1948));
    assert_eq!((gps.series.timeline().kind(), gps.series.timeline().clock()), (StampKind::Published, Clock::Boot));
    let row = first_row(&folder, "flight3_vehicle_gps_position_0.csv", 1);
    assert_eq!(gps.series.timeline().first().unwrap().0, 1000 * row["timestamp"].parse::<i64>().unwrap());
    assert_eq!(gps.series.component(0)[0], number(&format!("{}e-7", row["lat"])).to_radians());
    assert_eq!(gps.series.component(2)[0], number(&format!("{}e-3", row["alt_ellipsoid"])));
    let row = first_row(&folder, "flight3_vehicle_local_position_0.csv", 1);
    let sampled = 1000 * row["timestamp_sample"].parse::<i64>().unwrap();
    assert_eq!(channels["velocity.ekf"].series.timeline().first().unwrap().0, sampled);
}

#[test]
fn the_wide_table_agrees_with_itself_and_its_held_rows_are_recognised() {
    let Some(loaded) = load_real("PyFlightCoach-FlightData/test/ekfv3_test.csv") else { return };
    assert_agrees(&loaded, "wide-csv", ("position.gps", "velocity.ekf"), 0.005, 0.5);
    assert_agrees(&loaded, "wide-csv", ("position.ekf", "velocity.ekf"), 0.005, 0.5);
    let binding = loaded.binding.as_ref().unwrap();
    let held = |name: &str| binding.channels.iter().find(|c| c.name == name).unwrap().held.clone();
    // REFERENCE.csv: 2959 updates of 5998 rows, at 5 Hz.
    let gps = held("position.gps").unwrap();
    assert_eq!((gps.modal_run, 5998 - gps.repeats), (2, 2959));
    assert!((gps.update_interval_s - 0.2).abs() < 1e-3);
    assert_eq!(loaded.flight.channels["position.gps"].update_rows().len(), 2959);
    assert!(held("velocity.ekf").is_none() && held("position.ekf").is_none());
    assert_eq!(binding.channels.iter().find(|c| c.name == "position.gps").unwrap().absent, ["height"]);
}

#[test]
fn flysight_tables_agree_with_themselves() {
    for (path, map, rows) in [
        ("SSScoring/legacy/data-sources/ciurana/16-35-32.CSV", "flysight-1", 13_088),
        ("SSScoring/resources/quickstart-example/R2_11-00-34.csv", "flysight-1", 17_392),
        ("SSScoring/resources/test-tracks/FS1/test-data-02.CSV", "flysight-1", 20_313),
        ("SSScoring/resources/test-tracks/INSIGHT/gps_00105.csv", "flysight-1", 673),
        ("SSScoring/resources/test-tracks/FS2/01-00-00/TRACK.CSV", "flysight-2", 16_022),
    ] {
        let Some(loaded) = load_real(path) else { return };
        assert_agrees(&loaded, map, ("position.gps", "velocity.gps"), 0.01, 1.0);
        // wc -l minus the lines before the rows.
        assert_eq!(loaded.flight.channels["position.gps"].series.len(), rows, "{path}");
        assert!(!lossy(&loaded) && count_of(&loaded, "assumption") > 0, "{path}");
    }
}

#[test]
fn the_first_flysight_row_is_read_to_the_last_digit() {
    let Some(loaded) = load_real("SSScoring/resources/test-tracks/FS1/test-data-02.CSV") else { return };
    let Some(folder) = real_logs("SSScoring/resources/test-tracks/FS1") else { return };
    let row = first_row(&folder, "test-data-02.CSV", 2);
    let position = &loaded.flight.channels["position.gps"].series;
    // date -u -d 2024-05-10T17:27:44Z +%s; the file adds 0.3 s.
    assert!(row["time"].starts_with("2024-05-10T17:27:44.30"));
    assert_eq!(position.timeline().first().unwrap().0, 1_715_362_064_300_000_000);
    let first = |c: &flight::Series| [0, 1, 2].map(|i| c.component(i)[0]);
    let [latitude, longitude, height] = ["lat", "lon", "hMSL"].map(|k| number(&row[k]));
    assert_eq!(first(position), [latitude.to_radians(), longitude.to_radians(), height]);
    assert_eq!(
        first(&loaded.flight.channels["velocity.gps"].series),
        ["velN", "velE", "velD"].map(|k| number(&row[k]))
    );
}

#[test]
fn the_garmin_map_agrees_with_itself_with_variation_added_to_the_track() {
    // Rows as in REFERENCE.csv. In France the variation is 1.9 deg: so half a degree rules out the wrong sign.
    for (name, rows, degrees) in [("log_220417_125002_LFQA.csv", 2760, 0.6), ("log_210623_141501_TEST1.csv", 4475, 0.6)]
    {
        let Some(loaded) = load_real(&format!("flightlogstats-G1000/flightlogstatsTests/TestAssets/{name}")) else {
            return;
        };
        assert_agrees(&loaded, "garmin-g1000", ("position.gps", "velocity.gps"), 0.005, degrees);
        assert_eq!(loaded.flight.channels["position.gps"].series.len(), rows, "{name}");
    }
}

#[test]
fn the_vertical_axis_of_every_map_points_the_right_way() {
    let tables = [
        ("SSScoring/resources/quickstart-example/R2_11-00-34.csv", "velocity.gps"),
        ("flightlogstats-G1000/flightlogstatsTests/TestAssets/log_220417_125002_LFQA.csv", "velocity.gps"),
    ];
    for (path, velocity) in tables {
        let Some(loaded) = load_real(path) else { return };
        let position = &loaded.flight.channels["position.gps"].series;
        let down = &loaded.flight.channels[velocity].series;
        // Height loss must be the integral of the speed down: slope one within a tenth.
        let (mut product, mut square) = (0.0, 0.0);
        let seconds = position.timeline().seconds_since(flight::Stamp(0));
        for i in 1..position.len().min(down.len()) {
            let dt = seconds[i] - seconds[i - 1];
            let fallen = position.component(2)[i - 1] - position.component(2)[i];
            let speed = 0.5 * (down.component(2)[i - 1] + down.component(2)[i]);
            if dt < 1.5 && fallen.abs() < 100.0 {
                product += fallen * speed * dt;
                square += (speed * dt).powi(2);
            }
        }
        assert!((product / square - 1.0).abs() < 0.1, "{path}: {}", product / square);
    }
}

#[test]
fn alfa_yields_the_same_channels_from_every_intact_container() {
    let (Some(folder), Some(derived)) = (real_logs("ALFA"), real_logs("derived-alfa")) else { return };
    let library = MapLibrary::shipped().unwrap();
    let of = |path: &Path| load(&ingest::discover(path, &library).unwrap().units[0]).unwrap();
    let tables = of(&folder).flight;
    for container in [
        "alfa_none.bag",
        "alfa_lz4.bag",
        "alfa_bz2.bag",
        "alfa_ros1_none.mcap",
        "alfa_ros1_lz4.mcap",
        "alfa_ros1_zstd.mcap",
        "alfa_ros1_unchunked.mcap",
        "alfa_ros1_nosummary.mcap",
        "alfa_mcap_ros2/alfa_mcap_ros2.mcap",
    ] {
        let loaded = of(&derived.join(container));
        assert_ledger(&loaded);
        assert!(!lossy(&loaded), "{container}");
        for name in ["position.gps", "velocity.gps", "velocity.ekf"] {
            let (a, b) = (&tables.channels[name], &loaded.flight.channels[name]);
            assert_eq!(a.series, b.series, "{container}: {name}");
            assert_eq!(a.other_stamps, b.other_stamps, "{container}: {name}");
            assert_eq!((&a.present, &a.held), (&b.present, &b.held), "{container}: {name}");
        }
    }
}

#[test]
fn the_old_mti_g_driver_publishes_every_velocity_twice_and_stamps_on_sending() {
    let Some(path) = real_logs("PlotJuggler/datasamples/tilt_laser.bag") else { return };
    let loaded = load(&ingest::discover(&path, &MapLibrary::shipped().unwrap()).unwrap().units[0]).unwrap();
    assert_ledger(&loaded);
    assert_eq!(loaded.binding.as_ref().unwrap().map, "xsens-mtig");
    let velocity = &loaded.flight.channels["velocity.ins"].series;
    // 712 messages on /velocity for 356 on /position_gps.
    assert_eq!((velocity.len(), velocity.timeline().kind()), (356, StampKind::Published));
    assert_eq!(loaded.flight.channels["position.gps"].series.len(), 356);
    assert_eq!(count_of(&loaded, "duplicate-stamp"), 356);
}

/// Loads a text with the shipped maps.
fn bound(text: &str) -> Loaded {
    let (_folder, path) = file("log.csv", text.as_bytes());
    let unit = FlightUnit { id: "log".into(), files: vec![path], kind: LogKind::Csv };
    let library = MapLibrary::shipped().unwrap();
    let loaded = load_mapped(&unit, &library, None).unwrap();
    assert_ledger(&loaded);
    loaded
}

/// Clock, first and last timestamp of a channel.
fn times(loaded: &Loaded, channel: &str) -> (Clock, i64, i64) {
    let channel = loaded.flight.channels.get(channel).unwrap_or_else(|| panic!("no {channel}: {:?}", loaded.binding));
    let timeline = channel.series.timeline();
    (timeline.clock(), timeline.stamps()[0].0, timeline.stamps().last().unwrap().0)
}

/// Number of used rows of a channel, and why others are rejected.
fn used(loaded: &Loaded, channel: &str) -> (u64, Vec<(String, u64)>) {
    let health = loaded.binding.iter().flat_map(|b| &b.channels).find(|c| c.name == channel).unwrap();
    (health.used, health.rejected.iter().map(|r| (r.reason.clone(), r.count)).collect())
}

fn lines(header: &str, row: impl Fn(u32) -> String) -> String {
    format!("{header}\n{}", (0..20).map(|n| row(n) + "\n").collect::<String>())
}

/// `date -u -d 2026-11-21T12:00:00Z +%s`, in nanoseconds.
const NOON_NS: i64 = 1_795_262_400_000_000_000;
/// The same instant in GPS time: 315 964 800 s between the epochs, 18 leap seconds.
const GPS_NOON_S: i64 = 1_795_262_400 - 315_964_800 + 18;

#[test]
fn oxts_exports_use_their_time_zone_in_every_notation() {
    let columns = "PosLat (deg);PosLon (deg);PosAlt (m);VelNorth (km/h);VelEast (km/h);VelDown (km/h)";
    for (zone, date, hour) in [
        ("UTC+1,00", "21.11.2026", 13),
        ("UTC+0,00", "2026-11-21", 12),
        ("UTC-9,50", "2026-11-21", 2),
        ("UTC", "21/11/2026", 12),
    ] {
        let minute = if zone.ends_with(",50") { 30 } else { 0 };
        let text = lines(&format!("Date ({zone});Time ({zone});TimeFromStart (s);{columns}"), |n| {
            format!("{date};{hour:02}:{minute:02}:{n:02}.500;{n},0;47,3{n:04};8,5;400,25;36,0;18,0;-3,6")
        });
        let loaded = bound(&text);
        assert_eq!(loaded.binding.as_ref().unwrap().map, "oxts-csv", "{zone}");
        let half = NOON_NS + 500_000_000;
        assert_eq!(times(&loaded, "velocity.ins"), (Clock::Unix, half, half + 19_000_000_000), "{zone}");
        assert_eq!(loaded.flight.channels["velocity.ins"].series.component(0)[0], 10.0, "{zone}");
    }
    // With an unknown zone, the seconds from the start are used.
    let text = lines("Date (UTC+X),Time (UTC+X),TimeFromStart (s),PosLat (deg),PosLon (deg),PosAlt (m)", |n| {
        format!("2026-11-21,12:00:{n:02},{n},47.3{n:04},8.5,400")
    });
    assert_eq!(times(&bound(&text), "position.ins").0, Clock::Elapsed);
}

#[test]
fn navgraph_times_are_gps_time_and_the_device_prefix_is_dropped() {
    let header = |device: &str, time: &str| {
        let names = [time, "Latitude (deg)", "Longitude (deg)", "Altitude (m)", "Velocity north (mph)"];
        let more = ["Velocity east (mph)", "Velocity down (mph)", "Heading (deg)", "Pitch (deg)", "Roll (deg)"];
        names.iter().chain(&more).map(|name| format!("{device}{name}")).collect::<Vec<_>>().join(",")
    };
    let row = |time: String, n: u32| format!("{time},47.3{n:04},8.5,400.5,10,5,-1,90,20,0");
    let seconds = |n: u32| format!("{}.{:03}", GPS_NOON_S, 4 * n);
    let nanos = |n: u32| format!("{}{:03}000001", GPS_NOON_S, 4 * n);
    let first = GPS_NOON_S * 1_000_000_000;
    let plain = bound(&lines(&header("", "Time (GPS s)"), |n| row(seconds(n), n)));
    assert_eq!(times(&plain, "position.ins"), (Clock::Gps, first, first + 76_000_000));
    let fine = bound(&lines(&header("", "Time (GPS ns)"), |n| row(nanos(n), n)));
    assert_eq!(times(&fine, "position.ins"), (Clock::Gps, first + 1, first + 76_000_001));
    // One device followed by another, whose names are kept.
    let (one, two) = ("[Tag 0 SN1234 Real-Time]", "[Tag 1 SN5678 Range]");
    let alone = bound(&lines(&header(one, "Time (GPS s)"), |n| row(seconds(n), n)));
    let both = format!("{},{two}Latitude (deg)", header(one, "Time (GPS s)"));
    let both = bound(&lines(&both, |n| row(seconds(n), n) + ",0"));
    for (loaded, reported) in [(&plain, 0), (&alone, 0), (&both, 1)] {
        for channel in ["position.ins", "velocity.ins", "attitude.ins"] {
            assert_eq!(loaded.flight.channels[channel].series, plain.flight.channels[channel].series, "{channel}");
        }
        assert_eq!(count_of(loaded, "several-sources"), reported);
    }
    let north = plain.flight.channels["velocity.ins"].series.component(0)[0];
    assert!((north - 4.4704).abs() < 1e-12, "{north}");
}

#[test]
fn ncom_to_csv_output_uses_gps_time_not_local_time() {
    let header = " Time(), Date, Local Time, Latitude(deg), Longitude(deg), Altitude(m), Velocity north(m/s), \
                  Velocity east(m/s), Velocity down(m/s), Velocity up(m/s), Acceleration Xv(m/s²), \
                  Acceleration Yv(m/s²), Acceleration Zv(m/s²), Heading(deg), Pitch(deg), Roll(deg), \
                  Angular rate Xv(deg/s), Angular rate Yv(deg/s), Angular rate Zv(deg/s),";
    let row = |n: u32| {
        let (ms, place) = (4 * n, format!("47.3{n:04}000,8.50000000,400.125"));
        let stamp = format!("{GPS_NOON_S}.{ms:03},2026-11-21,12:00:01.{ms:03}");
        format!("{stamp},{place},10.0,5.0,-1.0,-,0.1,0.2,-9.8,90.0,20.0,0.0,1.0,2.0,3.0,")
    };
    let loaded = bound(&lines(header, row));
    let first = GPS_NOON_S * 1_000_000_000;
    let channels = ["angular-rate.imu", "attitude.ins", "position.ins", "specific-force.imu", "velocity.ins"];
    assert_eq!(loaded.flight.channels.keys().collect::<Vec<_>>(), channels);
    for channel in channels {
        assert_eq!(times(&loaded, channel), (Clock::Gps, first, first + 76_000_000), "{channel}");
    }
    assert_eq!(loaded.flight.channels["specific-force.imu"].series.component(2)[0], -9.8);
}

#[test]
fn oxts_rows_without_a_gnss_position_are_rejected_and_counted() {
    let text = |column: &str, mode: &dyn Fn(u32) -> String| {
        let header = "Time (GPS s),PosLat (deg),PosLon (deg),PosAlt (m),VelNorth (m/s),VelEast (m/s),VelDown (m/s),\
                      AngleHeading (deg),AnglePitch (deg),AngleRoll (deg)";
        lines(&format!("{header},{column}"), |n| {
            format!("{GPS_NOON_S}.{n:02},47.3{n:04},8.5,400,1,2,0,90,0,0,{}", mode(n))
        })
    };
    let number = |n: u32| [0, 1, 2, 3, 4, 5, 10, 11, 12].get(n as usize).unwrap_or(&6).to_string();
    let words = |n: u32| format!("Mode ({})", number(n));
    for (column, mode) in [("GpsPosMode", &number as &dyn Fn(u32) -> String), ("GPS position mode ()", &words)] {
        let loaded = bound(&text(column, mode));
        for channel in ["position.ins", "velocity.ins"] {
            assert_eq!(used(&loaded, channel), (14, vec![("fix_ok is below 1".to_owned(), 6)]), "{column} {channel}");
        }
        assert_eq!(used(&loaded, "attitude.ins"), (20, vec![]));
    }
    // An empty mode is ignored; so is an unknown word, which is reported.
    let unknown = bound(&text("GpsPosMode", &|n| if n < 3 { "Fine".to_owned() } else { String::new() }));
    assert_eq!((used(&unknown, "position.ins").0, count_of(&unknown, "unknown-word")), (20, 3));
}

/// An export of MT Manager at 100 Hz from noon on, with the given status word and UTC word.
fn of_mt_manager(status: impl Fn(u32) -> String, valid: impl Fn(u32) -> u32) -> Loaded {
    let header = "// Coordinate system: ENU\nPacketCounter\tSampleTimeFine\tUTC_Nano\tUTC_Year\tUTC_Month\tUTC_Day\tUTC_Hour\t\
                  UTC_Minute\tUTC_Second\tUTC_Valid\tStatusWord\tRoll\tPitch\tYaw\tLatitude\tLongitude\tAltitude\tVel_E\tVel_N\t\
                  Vel_U";
    bound(&lines(header, |n| {
        let utc = format!("{}\t2026\t11\t21\t12\t0\t0\t{}", 10_000_000 * n, valid(n));
        format!("{n}\t{}\t{utc}\t{}\t0\t0\t90\t47.3{n:04}\t8.5\t400\t1\t2\t0.5", 500 + 100 * n, status(n))
    }))
}

/// Without a fix in the first five rows, then with one.
fn status(n: u32) -> u32 {
    if n < 5 { 0x83 } else { 0x0080_0087 }
}

#[test]
fn xsens_rows_without_a_fix_are_rejected_and_counted() {
    let decimal = |n| status(n).to_string();
    let hexadecimal = |n| format!("{:08X}", status(n));
    let binary = |n| format!("{:032b}", status(n));
    for loaded in [of_mt_manager(decimal, |_| 55), of_mt_manager(hexadecimal, |_| 55), of_mt_manager(binary, |_| 55)] {
        for channel in ["position.ins", "velocity.ins"] {
            assert_eq!(used(&loaded, channel), (15, vec![("fix_ok is below 1".to_owned(), 5)]), "{channel}");
        }
        assert_eq!(used(&loaded, "attitude.ins"), (20, vec![]));
        assert_eq!(times(&loaded, "attitude.ins"), (Clock::Unix, NOON_NS, NOON_NS + 190_000_000));
        assert_eq!(count_of(&loaded, "undated") + count_of(&loaded, "unknown-word"), 0);
    }
    let unclear = of_mt_manager(|_| "25165827".to_owned(), |_| 7);
    assert_eq!((used(&unclear, "position.ins").0, count_of(&unclear, "unknown-word")), (20, 20));
}

#[test]
fn xsens_utc_without_valid_flags_is_not_used() {
    let fixed = |_| status(19).to_string();
    // Without leap seconds the date is unknown; rows that have them date the others.
    let never = of_mt_manager(fixed, |_| 3);
    assert_eq!(times(&never, "position.ins"), (Clock::Elapsed, 50_000_000, 240_000_000));
    assert_eq!(count_of(&never, "undated"), 20);
    let later = of_mt_manager(fixed, |n| if n < 8 { 0 } else { 7 });
    assert_eq!(times(&later, "position.ins"), (Clock::Unix, NOON_NS, NOON_NS + 190_000_000));
    assert_eq!((count_of(&later, "undated"), count_of(&later, "date-inferred")), (8, 8));
}

#[test]
fn zeros_that_mt_manager_writes_for_missing_values_are_absent() {
    let header = "PacketCounter;SampleTimeFine;UTC_Nano;UTC_Year;UTC_Month;UTC_Day;UTC_Hour;UTC_Minute;UTC_Second;UTC_Valid;\
                  StatusWord;Acc_X;Acc_Y;Acc_Z;Gyr_X;Gyr_Y;Gyr_Z;Mag_X;Mag_Y;Mag_Z;Roll;Pitch;Yaw;Latitude;Longitude;Altitude;\
                  Vel_X;Vel_Y;Vel_Z";
    // Every fourth sample has the slower values. A zero among others is a value: on the equator, at zero height.
    let loaded = bound(&lines(header, |n| {
        let slow = |text: String| if n % 4 == 0 { text } else { "0;0.000000;0".to_owned() };
        let utc =
            if n % 4 == 0 { format!("{};2026;11;21;12;0;0;7;135", 10_000_000 * n) } else { "0;0;0;0;0;0;0;0;0".into() };
        let (angles, place) = (slow("1.5;0;90".into()), slow(format!("0.000000;8.5{n:04};0.0")));
        let (field, velocity) = (slow("0.5;0.1;-0.8".into()), slow("1;2;0.5".into()));
        format!("{n};{};{utc};0;0;9.8;0.001;0;0;{field};{angles};{place};{velocity}", 500 + 100 * n)
    }));
    for (channel, lacks) in [
        ("attitude.ins", "orientation_given"),
        ("position.ins", "position_given"),
        ("velocity.xyz", "velocity_given"),
        ("magnetic-direction.imu", "field_given"),
    ] {
        assert_eq!(used(&loaded, channel), (5, vec![(format!("{lacks} is below 1"), 15)]), "{channel}");
    }
    for channel in ["angular-rate.imu", "specific-force.imu"] {
        assert_eq!(used(&loaded, channel), (20, vec![]), "{channel}");
    }
    assert_eq!(times(&loaded, "specific-force.imu"), (Clock::Unix, NOON_NS, NOON_NS + 190_000_000));
    assert_eq!(count_of(&loaded, "unknown-word"), 0);
}

#[test]
fn a_stationary_xsens_has_zero_velocity_where_it_has_a_position() {
    let header = "SampleTimeFine;Latitude;Longitude;Altitude;Vel_E;Vel_N;Vel_U";
    let loaded = bound(&lines(header, |n| {
        let place = if n % 4 == 0 { format!("47.3{n:04};8.5;400") } else { "0.0;0.0;0.0".to_owned() };
        format!("{};{place};0.0;0.0;0.0", 100 * n)
    }));
    assert_eq!(used(&loaded, "velocity.ins"), (5, vec![("velocity_given is below 1".to_owned(), 15)]));
}

/// 20 s at 50 Hz of a flight to the north-east, in the columns of VectorNav's exporter; GPS week 2366, 345 600 s in it.
fn vectornav(header: &str, row: impl Fn(f64) -> String) -> Loaded {
    let rows: String = (0..1000).map(|i| row(0.02 * f64::from(i)) + "\n").collect();
    let (_folder, path) = file("FA.csv", format!("{header}\n{rows}").as_bytes());
    let loaded = load(&FlightUnit { id: "FA".into(), files: vec![path], kind: LogKind::Csv }).unwrap();
    assert_eq!(loaded.binding.as_ref().unwrap().map, "vectornav-csv", "{:?}", loaded.binding);
    loaded
}

#[test]
fn exports_of_both_vectornav_sdks_and_ascii_messages_are_bound() {
    const IN_WEEK_S: f64 = 345_600.0;
    let week_s = 2366.0 * 604_800.0;
    let place = |t: f64| format!("{:.9},{:.9},{:.3}", 47.0 + 1e-4 * t, 8.5 + 2e-4 * t, 500.0 + t);
    let ns = |s: f64| format!("{:.0}", (s * 1e3).round() * 1e6);
    let binary = |t: f64| {
        format!("{},90,5,-10,{},11.1,15.2,-1,0.1,0.2,-9.8,0.01,0.02,-0.03", ns(week_s + IN_WEEK_S + t), place(t))
    };
    let names = "AccelX,AccelY,AccelZ,GyroX,GyroY,GyroZ";
    let newer = vectornav(&format!("TimeGps,Yaw,Pitch,Roll,PosLat,PosLon,PosAlt,VelN,VelE,VelD,{names}"), binary);
    let names = "accelX,accelY,accelZ,angularRateX,angularRateY,angularRateZ";
    let older = vectornav(&format!("timeGps,yaw,pitch,roll,lat,lon,alt,velNedX,velNedY,velNedZ,{names}"), binary);
    let ascii = vectornav(
        "TimeGpsTow,TimeGpsWeek,InsStatus,Yaw,Pitch,Roll,PosLat,PosLon,PosAlt,VelN,VelE,VelD,AttUncertainty",
        |t| format!("{:.6},2366,0006,90,5,-10,{},11.1,15.2,-1,0.5", IN_WEEK_S + t, place(t)),
    );
    for loaded in [&newer, &older, &ascii] {
        let first = |name: &str| -> Vec<f64> {
            loaded.flight.channels[name].series.components().iter().map(|axis| axis[0]).collect()
        };
        let timeline = loaded.flight.channels["position.ins"].series.timeline();
        assert_eq!((timeline.kind(), timeline.clock()), (StampKind::Measured, Clock::Gps));
        let stamp = timeline.stamps()[50].0 - (2366 * 604_800 + 345_601) * 1_000_000_000;
        assert!(stamp.abs() < 1_000, "{stamp}");
        let [latitude, longitude, height] = first("position.ins")[..] else { panic!() };
        assert!((latitude.to_degrees() - 47.0).abs() < 1e-9 && (longitude.to_degrees() - 8.5).abs() < 1e-9);
        assert_eq!((height, first("velocity.ins")), (500.0, vec![11.1, 15.2, -1.0]));
        // Heading east, nose up, left side down.
        let [w, x, y, z] = first("attitude.ins")[..] else { panic!() };
        let nose = [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)];
        assert!(
            nose[0].abs() < 1e-9 && nose[1] > 0.99 && (nose[2] + 5_f64.to_radians().sin()).abs() < 1e-9,
            "{nose:?}"
        );
    }
    for loaded in [&newer, &older] {
        let first = |name: &str| loaded.flight.channels[name].series.components().iter().map(|axis| axis[0]).collect();
        let (rate, force): (Vec<f64>, Vec<f64>) = (first("angular-rate.imu"), first("specific-force.imu"));
        assert_eq!((rate, force), (vec![0.01, 0.02, -0.03], vec![0.1, 0.2, -9.8]));
    }
}

#[test]
fn a_receiver_in_a_vectornav_export_has_its_own_time_and_only_fixes_count() {
    let loaded = vectornav(
        "TimeStartup,Yaw,Pitch,Roll,Gps1Tow,Gps1Week,Gnss1Fix,Gnss1Lat,Gnss1Lon,Gnss1Alt,Gnss1VelN,Gnss1VelE,Gnss1VelD",
        |t| {
            let fix_s = (5.0 * t).floor() / 5.0;
            let tow = format!("{:.0}", (345_600.0 + fix_s) * 1e9);
            let (fix, north) = (if t < 2.0 { 0 } else { 3 }, 47.0 + 1e-4 * fix_s);
            format!("{:.0},0,0,0,{tow},2366,{fix},{north:.9},8.5,500,11.1,0,0", 1e9 * (7.0 + t))
        },
    );
    let position = loaded.flight.channels["position.gps"].series.timeline();
    assert_eq!((position.clock(), position.stamps().len()), (Clock::Gps, 90));
    assert_eq!(loaded.flight.channels["attitude.ins"].series.timeline().clock(), Clock::Boot);
}
