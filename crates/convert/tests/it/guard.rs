//! What is never overwritten.

use crate::flight::{in_context, library, unit, write};
use convert::{ConvertError, ExportOrder, ExportTo, ExportWhat, export, recover};
use simulate::{Container, Db3Settings, McapSettings};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

fn exported(log: &Path, to: ExportTo, out: &Path) -> Result<(), ConvertError> {
    let (unit, library, what) = (unit(log), library(), ExportWhat::Topics);
    let order = ExportOrder { unit: &unit, library, map: None, what, to, out, command: "flightlag export" };
    in_context(|context| export(&order, context)).map(drop)
}

fn recovered(log: &Path, out: &Path) -> Result<(), ConvertError> {
    in_context(|context| recover(&unit(log), library(), out, context)).map(drop)
}

#[track_caller]
fn refused(result: Result<(), ConvertError>, why: &str) {
    match result.unwrap_err() {
        ConvertError::Refused { what, .. } => assert!(what.contains(why), "{what}"),
        other => panic!("{other}"),
    }
}

/// Contents of every file in a folder; empty for anything that is not a file.
fn content(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let paths = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path());
    let held = |path: PathBuf| {
        let bytes = if path.is_file() { std::fs::read(&path).unwrap() } else { vec![] };
        (path, bytes)
    };
    paths.map(held).collect()
}

fn mcap(folder: &Path) -> PathBuf {
    write(Container::Mcap(McapSettings::default()), folder)
}

#[cfg(unix)]
#[test]
fn a_log_is_not_overwritten_under_any_name_or_link() {
    let folder = tempfile::tempdir().unwrap();
    let log = mcap(folder.path());
    let other = |name: &str| folder.path().join(name);
    std::os::unix::fs::symlink(&log, other("soft.mcap")).unwrap();
    std::os::unix::fs::symlink(other("soft.mcap"), other("softer.mcap")).unwrap();
    std::fs::hard_link(&log, other("hard.mcap")).unwrap();
    let before = content(folder.path());
    for out in [log.clone(), other("soft.mcap"), other("softer.mcap"), other("hard.mcap"), other("./flight.mcap")] {
        refused(exported(&log, ExportTo::Mcap, &out), "the log itself");
        refused(recovered(&log, &out), "the log itself");
    }
    // A link as the log, and its target as the output.
    refused(recovered(&other("softer.mcap"), &log), "the log itself");
    refused(exported(&other("softer.mcap"), ExportTo::Mcap, &other("hard.mcap")), "the log itself");
    assert_eq!(content(folder.path()), before);
}

#[test]
fn the_write_ahead_log_of_a_bag_is_part_of_the_log() {
    let folder = tempfile::tempdir().unwrap();
    let log = write(Container::Db3(Db3Settings::default()), folder.path());
    let database = match log.is_dir() {
        true => content(&log).into_keys().find(|path| path.extension().is_some_and(|e| e == "db3")).unwrap(),
        false => log.clone(),
    };
    for end in ["-wal", "-shm", "-journal"] {
        let mut sidecar = database.clone().into_os_string();
        sidecar.push(end);
        std::fs::write(&sidecar, "x").unwrap();
        refused(recovered(&database, Path::new(&sidecar)), "the log itself");
        assert_eq!(std::fs::read(&sidecar).unwrap(), b"x");
        std::fs::remove_file(&sidecar).unwrap();
    }
}

#[test]
fn tables_do_not_overwrite_their_source_tables() {
    let folder = tempfile::tempdir().unwrap();
    let log = write(Container::CsvWide, folder.path());
    let before = content(folder.path());
    refused(exported(&log, ExportTo::Csv, folder.path()), "the log itself");
    assert_eq!(content(folder.path()), before);
    // A log of several files: each of them is protected.
    let several = write(Container::CsvFolder, folder.path());
    let before = content(&several);
    assert!(before.len() > 1);
    refused(exported(&several, ExportTo::Csv, &several), "the log itself");
    for file in before.keys() {
        refused(recovered(&several, file), "the log itself");
    }
    assert_eq!(content(&several), before);
}

#[test]
fn an_earlier_exported_table_that_is_now_the_log_is_not_removed() {
    let folder = tempfile::tempdir().unwrap();
    let tables = folder.path().join("tables");
    exported(&write(Container::CsvWide, folder.path()), ExportTo::Csv, &tables).unwrap();
    let before = content(&tables);
    refused(exported(&tables.join("flight.csv"), ExportTo::Parquet, &tables), "an earlier export");
    assert_eq!(content(&tables), before);
}

#[cfg(unix)]
#[test]
fn only_regular_files_are_replaced() {
    use std::os::unix::fs::FileTypeExt;
    let folder = tempfile::tempdir().unwrap();
    let log = mcap(folder.path());
    let out = |name: &str| folder.path().join(name);
    let _socket = std::os::unix::net::UnixListener::bind(out("socket")).unwrap();
    std::os::unix::fs::symlink(out("socket"), out("link")).unwrap();
    std::os::unix::fs::symlink(out("nowhere"), out("dangling")).unwrap();
    std::fs::create_dir(out("folder")).unwrap();
    for (name, why) in [
        ("socket", "only a plain file"),
        ("link", "only a plain file"),
        ("dangling", "a broken link"),
        ("folder", "a folder"),
    ] {
        refused(exported(&log, ExportTo::Mcap, &out(name)), why);
        refused(recovered(&log, &out(name)), why);
    }
    let kind = |name: &str| std::fs::symlink_metadata(out(name)).unwrap().file_type();
    assert!(kind("socket").is_socket() && kind("link").is_symlink() && kind("dangling").is_symlink());
    // Nor is one in the place of a table.
    let csv = write(Container::CsvWide, folder.path());
    std::fs::create_dir(out("folder/flight.csv")).unwrap();
    refused(exported(&csv, ExportTo::Csv, &out("folder")), "a folder");
    assert_eq!(std::fs::read_dir(out("folder")).unwrap().count(), 1);
}
