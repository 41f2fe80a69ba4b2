//! User tables: the units that they state, and maps that name missing columns.

use crate::support::*;
use ingest::{ChannelMap, Loaded, MapLibrary};
use std::path::Path;

/// A FlySight 1 table: 36 km/h north, 18 km/h east, climbing by 3.6 km/h.
fn flysight_with(units: &str) -> Loaded {
    let mut text = format!("time,lat,lon,hMSL,velN,velE,velD,gpsFix\n{units}\n");
    for second in 0..20 {
        let (lat, height) = (47.0 + 9e-5 * f64::from(second), 400 + second);
        text += &format!("2024-05-10T17:27:{second:02}Z,{lat:.7},8.5,{height},36,18,-3.6,3\n");
    }
    let (_folder, path) = file("flight.csv", text.as_bytes());
    load(&tables(&[path])).unwrap()
}

#[test]
fn a_line_of_units_is_converted_and_reported() {
    let loaded = flysight_with(",(deg),(deg),(m),(km/h),(km/h),(km/h),");
    let velocity = &loaded.flight.channels["velocity.gps"].series;
    let first: Vec<f64> = velocity.components().iter().map(|axis| axis[0]).collect();
    assert_eq!(first, [10.0, 5.0, -1.0]);
    assert_eq!(count_of(&loaded, "unit-differs"), 3 * 20);
    let notice = loaded.flight.notices.iter().find(|n| n.code == "unit-differs").unwrap();
    assert_eq!(
        notice.text,
        "channel velocity.gps: velN is converted from km/h, the unit in the table; the channel map states m/s"
    );
    assert!(loaded.binding.unwrap().channels[1].source.fields.contains(&"velN [km/h]".to_owned()));
}

#[test]
fn impossible_velocities_are_counted_and_not_used() {
    let mut text = "time,lat,lon,hMSL,velN,velE,velD,gpsFix\n".to_owned();
    for second in 0..20 {
        let north = if second == 3 { 32_767 } else { 36 };
        text += &format!(
            "2024-05-10T17:27:{second:02}Z,{:.7},8.5,400,{north},18,-3.6,3\n",
            47.0 + 3e-4 * f64::from(second)
        );
    }
    let (_folder, path) = file("flight.csv", text.as_bytes());
    let loaded = load(&tables(&[path])).unwrap();
    assert_eq!(count_saying(&loaded, "rejected-row", "velocity out of range: above 12 km/s"), 1);
    assert_eq!(loaded.flight.channels["velocity.gps"].series.len(), 19);
}

#[test]
fn a_line_with_the_units_of_the_map_changes_nothing() {
    let loaded = flysight_with(",(deg),(deg),(m),(m/s),(m/s),(m/s),");
    assert_eq!(loaded.flight.channels["velocity.gps"].series.components()[0][0], 36.0);
    assert_eq!(count_of(&loaded, "unit-differs") + count_of(&loaded, "unit-unknown"), 0);
}

#[test]
fn a_unit_of_another_quantity_is_rejected_and_an_unknown_one_is_reported() {
    let loaded = flysight_with(",(deg),(deg),(m),(deg),(deg),(deg),");
    assert!(!loaded.flight.channels.contains_key("velocity.gps"));
    let loaded = flysight_with(",(deg),(deg),(m),(furlongs),(m/s),(m/s),");
    let notice = loaded.flight.notices.iter().find(|n| n.code == "unit-unknown").unwrap();
    assert!(notice.text.contains("unit \"(furlongs)\" for velN"), "{}", notice.text);
}

const MINE: &str = r#"
schema = 1
name = "mine"
title = "My table"
[time]
logged = [{ field = "t", unit = "s", clock = "elapsed" }]
[[channel]]
name = "position.gps"
quantity = "position-geodetic"
timeline = "logged"
[channel.fields]
latitude = { field = "my_lat", unit = "deg" }
longitude = { field = "my_lon", unit = "deg" }
[[channel]]
name = "velocity.gps"
quantity = "velocity-ned"
timeline = "logged"
[channel.fields]
north = { field = "vnorth", unit = "m/s" }
east = { field = "v_east", unit = "m/s" }
"#;

fn with_map(map: &str, table: &str) -> Loaded {
    let mut library = MapLibrary::shipped().unwrap();
    library.add(ChannelMap::from_toml(Path::new("mine.toml"), map).unwrap());
    let (_folder, path) = file("flight.csv", table.as_bytes());
    load_mapped(&tables(&[path]), &library, None).unwrap()
}

#[test]
fn a_field_that_the_log_lacks_is_an_error_with_the_nearest_name() {
    let table = "t,my_lat,my_lon,v_north,v_east\n0,47,8,1,2\n1,47.00001,8,1,2\n2,47.00002,8,1,2\n";
    let loaded = with_map(MINE, table);
    assert!(!lossy(&loaded), "a wrong map is not damage");
    assert_eq!(count_of(&loaded, "map-lacks"), 1);
    assert_eq!(
        loaded.binding.unwrap_err(),
        "the channel map mine names fields that the log does not have: velocity.gps: topic flight has no \"vnorth\" (the \
         nearest name is \"v_north\"); correct the names, or write `optional = true` in the channel"
    );
    // Each channel with a slip: no channel binds, but the names are still reported.
    let none = with_map(&MINE.replace("my_lat", "my_latt"), table).binding.unwrap_err();
    assert!(none.contains("no \"my_latt\" (the nearest name is \"my_lat\")"), "{none}");
    assert!(none.contains("no \"vnorth\" (the nearest name is \"v_north\")"), "{none}");
    let optional = MINE.replace("name = \"velocity.gps\"\n", "name = \"velocity.gps\"\noptional = true\n");
    let loaded = with_map(&optional, table);
    assert_eq!(loaded.binding.unwrap().map, "mine");
    assert_eq!(loaded.flight.channels.keys().collect::<Vec<_>>(), ["position.gps"]);
    assert_eq!(with_map(&MINE.replace("vnorth", "v_north"), table).flight.channels.len(), 2);
}

#[test]
fn a_missing_time_field_is_named_unless_the_container_may_time_the_rows() {
    let table = "t,my_lat,my_lon,v_north,v_east\n0,47,8,1,2\n1,47.00001,8,1,2\n2,47.00002,8,1,2\n";
    let field = "{ field = \"tt\", unit = \"s\", clock = \"elapsed\" }";
    let error = |times: &str| {
        let map = MINE.replace("{ field = \"t\", unit = \"s\", clock = \"elapsed\" }", times);
        with_map(&map, table).binding.unwrap_err()
    };
    let of_velocity = "velocity.gps: topic flight has no \"vnorth\" (the nearest name is \"v_north\")";
    let of_time = "no \"tt\" (the nearest name is \"t\")";
    let alone = error(field);
    let expected =
        format!("does not have: position.gps: topic flight has {of_time}; {of_velocity}, {of_time}; correct");
    assert!(alone.contains(&expected), "{alone}");
    let by_container = error(&format!("{field}, {{ container = \"logged\" }}"));
    assert!(by_container.contains(&format!("does not have: {of_velocity}; correct")), "{by_container}");
}

#[test]
fn timestamps_in_another_unit_than_the_map_states_are_rejected() {
    let table = "t [ms],my_lat,my_lon\n0,47,8\n1000,47.00001,8\n2000,47.00002,8\n";
    let map = MINE.replace("field = \"t\"", "field = \"t [ms]\"");
    let map = map.split("[[channel]]\nname = \"velocity.gps\"").next().unwrap();
    let error = with_map(map, table).binding.unwrap_err();
    assert!(error.contains("the unit of t [ms] is ms in the table"), "{error}");
    assert!(with_map(&map.replace("unit = \"s\"", "unit = \"ms\""), table).binding.is_ok());
}
