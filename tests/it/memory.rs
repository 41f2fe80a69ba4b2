//! Peak memory of the command: 256 MiB in addition to the requested columns.
//!
//! The default tests use a quarter of the input, and of the bound without the program itself. `just memory` uses
//! all of both.
#![cfg(target_os = "linux")]

use crate::program::{flightlag, log_of_topics};
use std::ffi::OsString;
use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::Duration;

const MIB: u64 = 1 << 20;
/// The promised limit in addition to the columns.
const PROMISED: u64 = 256 * MIB;
/// The part of it that the program uses before it reads anything, at most.
const PROGRAM: u64 = 48 * MIB;

/// Fraction of an input that is read.
#[derive(Clone, Copy, PartialEq)]
enum Size {
    Quarter,
    Whole,
}

impl Size {
    fn of(self, whole: u64) -> u64 {
        if self == Size::Whole { whole } else { whole / 4 }
    }

    /// Limit with columns of this many cells, bytes.
    fn bound(self, cells: u64) -> u64 {
        PROGRAM + self.of(PROMISED - PROGRAM) + 8 * cells
    }
}

/// Runs the command to its end, with one of these exit codes. Returns its peak resident memory.
fn peak(arguments: &[&str], paths: &[&Path], exits: &[i32]) -> u64 {
    let all = arguments.iter().map(OsString::from).chain(paths.iter().map(|path| path.into()));
    let mut command = flightlag(all.collect::<Vec<OsString>>());
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let status = PathBuf::from(format!("/proc/{}/status", child.id()));
    let mut peak = 0;
    loop {
        // Nothing is reported after the process has ended: the last reading decides. The peak only grows.
        let content = fs::read_to_string(&status).unwrap_or_default();
        let kib = content.lines().find_map(|line| line.strip_prefix("VmHWM:")?.split_whitespace().next()?.parse().ok());
        peak = kib.unwrap_or(0_u64).max(peak);
        if let Some(exit) = child.try_wait().unwrap() {
            assert!(exits.contains(&exit.code().unwrap()), "{arguments:?}: {exit}");
            return peak << 10;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[track_caller]
fn assert_bound(what: &str, size: Size, cells: u64, peak: u64) {
    let bound = size.bound(cells);
    println!("{what}: {} MiB of {} MiB", peak / MIB, bound / MIB);
    assert!(peak <= bound, "{what}: {} MiB, more than {} MiB", peak / MIB, bound / MIB);
}

/// Rows of a position every tenth of a second, in about `bytes` bytes; returns their number.
fn places(out: &mut dyn Write, bytes: u64, open_quote: bool) -> u64 {
    out.write_all(b"time_s,latitude_deg,longitude_deg\n").unwrap();
    let (mut row, mut rows, mut written) = (String::new(), 0, 0);
    while written < bytes {
        let t = rows as f64 * 0.1;
        row.clear();
        let quote = if open_quote && rows == 1000 { "\"" } else { "" };
        let (latitude, longitude) = (37.6 + 0.01 * (t / 60.0).sin(), 127.0 + 0.01 * (t / 60.0).cos());
        writeln!(row, "{quote}{t:.1},{latitude:.5},{longitude:.5}").unwrap();
        out.write_all(row.as_bytes()).unwrap();
        written += row.len() as u64;
        rows += 1;
    }
    rows
}

struct Table {
    folder: tempfile::TempDir,
    path: PathBuf,
    rows: u64,
}

fn table(bytes: u64, open_quote: bool) -> Table {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("places.csv");
    let mut out = BufWriter::new(File::create(&path).unwrap());
    let rows = places(&mut out, bytes, open_quote);
    out.flush().unwrap();
    Table { folder, path, rows }
}

fn tables(size: Size, bytes: u64) {
    for (open_quote, what) in [(false, "rows of a table"), (true, "rows below a quote that is never closed")] {
        let table = table(size.of(bytes), open_quote);
        let label = format!("{what}, {} rows", table.rows);
        let cells = 3 * table.rows;
        assert_bound(&label, size, cells, peak(&["inspect"], &[&table.path], &[0, 3]));
        if size == Size::Whole {
            assert_bound(&format!("{label}: delay"), size, cells, peak(&["delay"], &[&table.path], &[0, 1, 3]));
            let out = table.folder.path().join("out");
            let paths = [table.path.as_path(), Path::new("--out"), &out];
            let whole = peak(&["export", "--topics", "--to", "csv"], &paths, &[0, 3]);
            assert_bound(&format!("{label}: export"), size, cells, whole);
        }
    }
}

/// Columns of [`flight`]; a text counts as a number.
const FLIGHT: u64 = 6;

/// Rows of a flight at 100 Hz in about `bytes` bytes: a late position, a velocity, both with noise, and a mode; returns
/// their number.
fn flight(path: &Path, bytes: u64) -> u64 {
    let mut out = BufWriter::new(File::create(path).unwrap());
    out.write_all(b"time_s,latitude_deg,longitude_deg,vel_north_mps,vel_east_mps,mode\n").unwrap();
    let mut noise = 0_u64;
    let mut uniform = || {
        noise = noise.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (noise >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
    };
    let (mut row, mut rows, mut written) = (String::new(), 0, 0);
    while written < bytes {
        let t = rows as f64 * 0.01;
        let (now, then) = (0.05 * t, 0.05 * (t - 0.2));
        let latitude = 37.0 + 400.0 * then.sin() / 111_000.0 + 1e-6 * uniform();
        let longitude = 127.0 - 400.0 * then.cos() / 88_800.0 + 1e-6 * uniform();
        let (north, east) = (20.0 * now.cos() + 0.3 * uniform(), 20.0 * now.sin() + 0.3 * uniform());
        let mode = ["auto", "loiter", "manual"][rows as usize / 1000 % 3];
        row.clear();
        writeln!(row, "{t:.2},{latitude:.7},{longitude:.7},{north:.2},{east:.2},{mode}").unwrap();
        out.write_all(row.as_bytes()).unwrap();
        written += row.len() as u64;
        rows += 1;
    }
    out.flush().unwrap();
    rows
}

fn long_flight(size: Size, bytes: u64) {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("flight.csv");
    let rows = flight(&log, size.of(bytes));
    let out = folder.path().join("out");
    // Memory of the analysis stops growing at half a million samples, and a quarter has fewer.
    if size == Size::Whole {
        let what = format!("delay, {rows} rows");
        assert_bound(&what, size, FLIGHT * rows, peak(&["delay"], &[&log], &[0]));
        let removes = folder.path().join("removes.toml");
        fs::write(&removes, "schema = 1\n[delay]\nfrom = \"fixed\"\nposition_s = 0.2\n").unwrap();
        let flights = folder.path().join("flights");
        fs::create_dir(&flights).unwrap();
        fs::rename(&log, flights.join("flight.csv")).unwrap();
        for settings in [None, Some(removes.as_path())] {
            let report = folder.path().join(if settings.is_some() { "removed" } else { "measured" });
            let mut paths = vec![flights.as_path(), Path::new("--out"), &report];
            paths.extend(settings.iter().flat_map(|settings| [Path::new("--pipeline"), settings]));
            let what = format!("campaign, {rows} rows, {}", report.file_name().unwrap().display());
            assert_bound(&what, size, FLIGHT * rows, peak(&["campaign"], &paths, &[0]));
        }
        fs::rename(flights.join("flight.csv"), &log).unwrap();
    }
    for (arguments, writes) in [
        (&["inspect"][..], false),
        (&["export", "--force"], true),
        (&["export", "--force", "--topics"], true),
        (&["export", "--force", "--topics", "--to", "csv"], true),
    ] {
        let paths = if writes { vec![log.as_path(), Path::new("--out"), &out] } else { vec![log.as_path()] };
        let what = format!("{}, {rows} rows", arguments.join(" "));
        assert_bound(&what, size, FLIGHT * rows, peak(arguments, &paths, &[0]));
    }
}

#[test]
fn a_long_flight_uses_only_the_memory_of_its_columns() {
    long_flight(Size::Quarter, 64 << 20);
}

#[test]
#[ignore = "a minute; `just memory`"]
fn a_long_flight_of_256_mib_uses_only_the_memory_of_its_columns() {
    long_flight(Size::Whole, 256 << 20);
}

#[test]
fn a_table_uses_only_the_memory_of_its_columns() {
    tables(Size::Quarter, 64 << 20);
}

#[test]
#[ignore = "a minute; `just memory`"]
fn a_table_of_256_mib_uses_only_the_memory_of_its_columns() {
    tables(Size::Whole, 256 << 20);
}

/// A line without an end, plain and compressed a thousandfold; no part of it is a table.
fn one_line(size: Size, bytes: u64) {
    let folder = tempfile::tempdir().unwrap();
    let (plain, packed) = (folder.path().join("line.csv"), folder.path().join("line.csv.zst"));
    let mut file = BufWriter::new(File::create(&plain).unwrap());
    let mut zstd = zstd::Encoder::new(File::create(&packed).unwrap(), 1).unwrap();
    let head = b"time_s,latitude_deg,longitude_deg\n0.0,37.6,127.0\n0.1,37.6,127.0\n";
    file.write_all(head).unwrap();
    zstd.write_all(head).unwrap();
    let part = vec![b'1'; 1 << 20];
    for _ in 0..size.of(bytes) >> 20 {
        file.write_all(&part).unwrap();
        zstd.write_all(&part).unwrap();
    }
    file.flush().unwrap();
    zstd.finish().unwrap();
    for path in [&plain, &packed] {
        assert_bound("one line", size, 0, peak(&["inspect"], &[path], &[0, 1, 3]));
    }
}

#[test]
fn an_endless_line_is_not_read_into_memory() {
    one_line(Size::Quarter, 256 << 20);
}

#[test]
#[ignore = "a minute; `just memory`"]
fn a_line_of_a_gibibyte_is_not_read_into_memory() {
    one_line(Size::Whole, 1 << 30);
}

fn many_topics(size: Size, commands: &[&str]) {
    const COLUMNS: u64 = 5;
    let folder = tempfile::tempdir().unwrap();
    let (log, out) = (folder.path().join("many.mcap"), folder.path().join("out"));
    let count = size.of(65_000);
    log_of_topics(&log, count);
    for to in commands {
        let whole = peak(&["export", "--topics", "--to", to], &[&log, Path::new("--out"), &out], &[0]);
        // The first topics have timestamp statistics, and use more than the others: half of the bound is for a quarter.
        let bound = PROMISED / if size == Size::Whole { 1 } else { 2 } + 8 * 2 * COLUMNS * count;
        println!("{count} topics as {to}: {} MiB of {} MiB", whole / MIB, bound / MIB);
        assert!(whole <= bound, "{count} topics as {to}: {} MiB, more than {} MiB", whole / MIB, bound / MIB);
        let _ = fs::remove_file(&out).or_else(|_| fs::remove_dir_all(&out));
    }
}

#[test]
fn a_log_of_many_topics_is_exported_topic_by_topic() {
    many_topics(Size::Quarter, &["mcap"]);
}

#[test]
#[ignore = "a minute; `just memory`"]
fn a_log_of_65_000_topics_is_exported_topic_by_topic() {
    many_topics(Size::Whole, &["mcap", "csv", "parquet"]);
}

#[test]
fn a_sparse_log_of_a_hundred_gigabytes_uses_no_memory() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("sparse.mcap");
    log_of_topics(&log, 10);
    if let Err(error) = File::options().write(true).open(&log).unwrap().set_len(100_000_000_000) {
        println!("skipped: no sparse file of that size here: {error}");
        return;
    }
    assert_bound("a sparse log", Size::Quarter, 0, peak(&["inspect"], &[&log], &[3]));
}
