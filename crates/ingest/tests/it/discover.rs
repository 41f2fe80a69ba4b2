//! Which files are flights.

use ingest::{Discovery, LogKind, MapLibrary, discover};
use std::fs;
#[cfg(unix)]
use std::os::unix::fs::symlink;
use std::path::Path;

const FLYSIGHT: &[u8] = b"time,lat,lon\n,(deg),(deg)\n2024-05-10T17:27:44.30Z,47,8\n";
const FLYSIGHT2: &[u8] = b"$FLYS,1\n$COL,GNSS,time\n$DATA\n";
const TOPIC: &[u8] = b"%time,field.latitude\n1,47\n";
const MCAP: &[u8] = b"\x89MCAP0\r\n rest";

fn tree(files: &[(&str, &[u8])]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (path, content) in files {
        let path = folder.path().join(path);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, content).unwrap();
    }
    folder
}

fn found(root: &Path) -> Discovery {
    discover(root, &MapLibrary::shipped().unwrap()).unwrap()
}

fn ids(found: &Discovery) -> Vec<(&str, LogKind, usize)> {
    found.units.iter().map(|u| (u.id.as_str(), u.kind, u.files.len())).collect()
}

fn reason<'a>(found: &'a Discovery, path: &str) -> &'a str {
    found.ignored.iter().chain(&found.unreadable).find(|(p, _)| p == path).map_or("", |(_, reason)| reason)
}

#[test]
fn logs_are_detected_by_content_and_the_rest_is_listed_with_a_reason() {
    let folder = tree(&[
        ("b/one.csv", FLYSIGHT),
        ("b/two.txt", FLYSIGHT),
        ("a/three", MCAP),
        ("a/four.bag", b"#ROSBAG V2.0\n"),
        ("a/cut.bag", b""),
        ("a/empty.csv", b""),
        ("README.md", b"a, b\n1, 2\n"),
        ("LICENSE", b"Permission is hereby granted, free of charge, to any person\nobtaining a copy\n"),
        ("x.ulg", b"ULog\x01\x12\x35\x01"),
        ("x.BIN", b"\xa3\x95\x80\x59"),
        ("x.db3", b"SQLite format 3\0"),
        ("x.zip", b"PK\x03\x04"),
        ("lfs.mcap", b"version https://git-lfs.github.com/spec/v1\n"),
        ("page.bag", b"<!DOCTYPE html><html>"),
        ("noise", b"\x00\x01\x02"),
        ("nothing", b""),
        (".hidden.csv", FLYSIGHT),
    ]);
    let found = found(folder.path());
    let expected = [
        ("a/cut.bag", LogKind::Bag, 1),
        ("a/empty.csv", LogKind::Csv, 1),
        ("a/four.bag", LogKind::Bag, 1),
        ("a/three", LogKind::Mcap, 1),
        ("b/one.csv", LogKind::Csv, 1),
        ("b/two.txt", LogKind::Csv, 1),
        ("x.BIN", LogKind::DataFlash, 1),
        ("x.db3", LogKind::Db3, 1),
        ("x.ulg", LogKind::Ulog, 1),
    ];
    assert_eq!(ids(&found), expected);
    for (path, text) in [
        ("README.md", ".md"),
        ("LICENSE", "text, but"),
        ("x.zip", "without a valid list of files"),
        ("lfs.mcap", "Git LFS"),
        ("page.bag", "HTML"),
        ("noise", "binary"),
        ("nothing", "empty"),
        (".hidden.csv", "hidden"),
    ] {
        assert!(reason(&found, path).contains(text), "{path}: {:?}", reason(&found, path));
    }
    assert_eq!(found.units.len() + found.ignored.len(), 17);
}

#[test]
fn tables_of_one_topic_each_are_one_flight_by_their_shared_prefix() {
    let folder = tree(&[
        ("run1-mavros-global_position-raw-fix.csv", TOPIC),
        ("run1-mavros-local_position-velocity.csv", TOPIC),
        ("run1-mavros-battery.csv", TOPIC),
        ("run10-mavros-global_position-raw-fix.csv", TOPIC),
        ("run10-mavros-battery.csv", TOPIC),
        ("f3_vehicle_gps_position_0.csv", TOPIC),
        ("f3_vehicle_local_position_0.csv", TOPIC),
        ("alone.csv", FLYSIGHT),
    ]);
    let csv = LogKind::Csv;
    assert_eq!(
        ids(&found(folder.path())),
        [("alone.csv", csv, 1), ("f3", csv, 2), ("run1", csv, 3), ("run10", csv, 2)]
    );
}

#[test]
fn tables_whose_last_word_names_their_content_are_one_flight() {
    let table: &[u8] = b"time,lat,lon\n0,1,2\n1,1,2\n";
    let names = ["x_GPS.csv", "x_Imu.csv", "x_ppk.csv", "x.csv", "day-1-pos.csv", "day-2-pos.csv", "gps.csv"];
    let files: Vec<(&str, &[u8])> = names.iter().map(|name| (*name, table)).collect();
    let folder = tree(&files);
    let found = found(folder.path());
    let flights: Vec<(&str, usize)> = ids(&found).into_iter().map(|(id, _, files)| (id, files)).collect();
    assert_eq!(
        flights,
        [("day-1-pos.csv", 1), ("day-2-pos.csv", 1), ("gps.csv", 1), ("x", 2), ("x.csv", 1), ("x_ppk.csv", 1)]
    );
}

#[test]
fn tables_named_after_their_content_are_one_flight() {
    let table: &[u8] = b"time,lat,lon\n0,1,2\n1,1,2\n";
    for names in [["f/gps.csv", "f/IMU.csv"], ["f/GPS_1.csv", "f/imu_1.csv"]] {
        let folder = tree(&names.map(|name| (name, table)));
        let found = found(folder.path());
        assert_eq!(found.units.len(), 1, "{names:?}: {:?}", ids(&found));
        assert_eq!(found.units[0].files.len(), 2);
    }
    let folder = tree(&["f/gps.csv", "f/gps-2.csv"].map(|name| (name, table)));
    assert_eq!(found(folder.path()).units.len(), 2, "two of one kind are no parts of one flight");
}

#[test]
fn a_folder_of_bare_topics_is_one_flight() {
    let folder =
        tree(&[("day/f1/gps-fix.csv", TOPIC), ("day/f1/gps-vel.csv", TOPIC), ("day/f1/operator-notes.csv", TOPIC)]);
    assert_eq!(ids(&found(folder.path())), [("day/f1", LogKind::Csv, 3)]);
    // The root itself also has a name.
    let below = found(&folder.path().join("day/f1"));
    assert_eq!(ids(&below), [("f1", LogKind::Csv, 3)]);
}

#[test]
fn track_and_sensor_of_a_flysight_2_are_one_flight() {
    let folder = tree(&[
        ("09/01/TRACK.CSV", FLYSIGHT2),
        ("09/01/SENSOR.CSV", FLYSIGHT2),
        ("09/01/EVENT.CSV", FLYSIGHT2),
        ("09/02/TRACK.CSV", FLYSIGHT2),
    ]);
    assert_eq!(ids(&found(folder.path())), [("09/01", LogKind::Csv, 3), ("09/02/TRACK.CSV", LogKind::Csv, 1)]);
}

#[cfg(unix)]
#[test]
fn circular_links_end_and_no_log_counts_twice() {
    let folder = tree(&[("a/log.csv", FLYSIGHT), ("b/other.csv", FLYSIGHT)]);
    let root = folder.path();
    symlink(root, root.join("a/up")).unwrap();
    symlink(root.join("a"), root.join("z")).unwrap();
    symlink(root.join("a/log.csv"), root.join("b/same.csv")).unwrap();
    fs::hard_link(root.join("a/log.csv"), root.join("b/twin.csv")).unwrap();
    symlink(root.join("gone"), root.join("broken.csv")).unwrap();
    let found = found(root);
    assert_eq!(ids(&found), [("a/log.csv", LogKind::Csv, 1), ("b/other.csv", LogKind::Csv, 1)]);
    assert!(reason(&found, "a/up").contains("that contains it"));
    assert!(reason(&found, "z").contains("same folder as a"));
    assert!(reason(&found, "b/same.csv").contains("same file as a/log.csv"));
    assert!(reason(&found, "b/twin.csv").contains("same file as a/log.csv"));
    assert!(reason(&found, "broken.csv").contains("cannot be read"));
}

#[cfg(unix)]
#[test]
fn unreadable_files_are_not_listed_as_not_logs() {
    let folder = tree(&[("log.csv", FLYSIGHT), ("notes.md", b"hello")]);
    symlink(folder.path().join("gone"), folder.path().join("a.mcap")).unwrap();
    symlink("itself", folder.path().join("itself")).unwrap();
    let found = found(folder.path());
    let paths = |list: &[(String, String)]| list.iter().map(|(path, _)| path.clone()).collect::<Vec<_>>();
    assert_eq!(
        (paths(&found.unreadable), paths(&found.ignored)),
        (vec!["a.mcap".to_owned(), "itself".to_owned()], vec!["notes.md".to_owned()])
    );
}

#[cfg(unix)]
#[test]
fn only_regular_files_are_opened() {
    let folder = tree(&[("log.csv", FLYSIGHT)]);
    let pipe = folder.path().join("pipe.csv");
    // Opening a pipe without a writer would wait for ever.
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let _socket = std::os::unix::net::UnixListener::bind(folder.path().join("socket.csv")).unwrap();
    let found = found(folder.path());
    assert_eq!(ids(&found), [("log.csv", LogKind::Csv, 1)]);
    assert!(reason(&found, "pipe.csv").contains("not a regular file"));
    assert!(reason(&found, "socket.csv").contains("not a regular file"));
}

#[test]
fn a_single_file_is_a_root_too() {
    let folder = tree(&[("log.csv", FLYSIGHT), ("notes.md", b"hello")]);
    assert_eq!(ids(&found(&folder.path().join("log.csv"))), [("log.csv", LogKind::Csv, 1)]);
    let none = found(&folder.path().join("notes.md"));
    assert!(none.units.is_empty() && none.ignored.len() == 1);
    assert!(discover(&folder.path().join("gone"), &MapLibrary::shipped().unwrap()).is_err());
}

#[cfg(unix)]
#[test]
fn odd_file_names_are_accepted() {
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt;
    let folder = tree(&[("-rf.csv", FLYSIGHT), ("a b\n\"c\".csv", FLYSIGHT), ("ünïcode 🚁.csv", FLYSIGHT)]);
    for byte in [b"\xff.csv", b"\xfe.csv"] {
        fs::write(folder.path().join(OsStr::from_bytes(byte)), FLYSIGHT).unwrap();
    }
    let found = found(folder.path());
    assert_eq!(found.units.len(), 5);
    let mut ids: Vec<&String> = found.units.iter().map(|u| &u.id).collect();
    ids.dedup();
    assert_eq!(ids.len(), 5, "two names that are not UTF-8 must not become one");
}

#[test]
fn a_bag_part_present_packed_and_unpacked_is_one_flight() {
    let plain = b"SQLite format 3\0".as_slice();
    let packed = zstd::bulk::compress(plain, 3).unwrap();
    let named = |file: &str| {
        format!(
            "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: sqlite3\n  relative_file_paths:\n    - {file}\n"
        )
    };
    for (metadata, kept, copy) in [
        (Some("f_0.db3.zstd"), "f_0.db3.zstd", "f/f_0.db3"),
        (Some("f_0.db3"), "f_0.db3", "f/f_0.db3.zstd"),
        (None, "f_0.db3.zstd", "f/f_0.db3"),
    ] {
        let text = metadata.map(named).unwrap_or_default();
        let mut files = vec![("f/f_0.db3", plain), ("f/f_0.db3.zstd", packed.as_slice())];
        files.extend(metadata.map(|_| ("f/metadata.yaml", text.as_bytes())));
        let root = tree(&files);
        let found = found(root.path());
        assert_eq!(found.units.len(), 1, "{found:?}");
        assert!(found.units[0].files[0].ends_with(kept), "{found:?}");
        assert!(reason(&found, copy).contains(kept), "{found:?}");
    }
    // Neither another recording nor tables with the same name.
    let longer = [plain, plain].concat();
    let root = tree(&[("f/f_0.db3", longer.as_slice()), ("f/f_0.db3.zstd", packed.as_slice())]);
    assert!(found(root.path()).ignored.is_empty());
    let table = b"t,x\n0,1\n1,2\n".as_slice();
    let packed = zstd::bulk::compress(table, 3).unwrap();
    let root = tree(&[("f.csv", table), ("f.csv.zstd", packed.as_slice())]);
    assert_eq!(found(root.path()).units.len(), 2);
}

#[test]
fn a_renamed_bag_is_still_described_by_its_metadata_sidecar() {
    let metadata = b"rosbag2_bagfile_information:\n  relative_file_paths:\n  - old_0.mcap\n";
    let mcap: &[u8] = b"\x89MCAP0\r\n";
    let one = tree(&[("metadata.yaml", metadata), ("new.mcap", mcap), ("deeper/other.mcap", mcap)]);
    assert_eq!(ids(&found(one.path())), [("deeper/other.mcap", LogKind::Mcap, 1), ("new.mcap", LogKind::Mcap, 2)]);
    let two = tree(&[("metadata.yaml", metadata), ("new.mcap", mcap), ("newer.mcap", mcap)]);
    assert_eq!(ids(&found(two.path())), [("new.mcap", LogKind::Mcap, 1), ("newer.mcap", LogKind::Mcap, 1)]);
}
