//! Shared by the tests: real logs if present, generated files, and functions to load them.

use flight::{Channel, Geodetic, LocalFrame, Quantity, Severity};
use ingest::{FlightUnit, IngestError, Limits, Loaded, Log, LogError, LogKind, MapLibrary, ReadContext, Select};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

/// The folder of real logs, which is not part of the project. Prints a notice if it is absent.
pub fn real_logs(below: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/logs").join(below);
    if !path.exists() {
        // Straight to standard error: the test runner hides what a passing test prints.
        let _ = writeln!(std::io::stderr(), "skipped: {} is not there", path.display());
    }
    path.exists().then_some(path)
}

/// Runs `body` with a context of these limits.
pub fn with_limits<T>(limits: Limits, body: impl FnOnce(&ReadContext<'_>) -> T) -> T {
    let cancel = AtomicBool::new(false);
    body(&ReadContext { limits, cancel: &cancel, on_bytes: &|_| () })
}

/// Runs `body` with the default limits.
pub fn in_context<T>(body: impl FnOnce(&ReadContext<'_>) -> T) -> T {
    with_limits(Limits::default(), body)
}

/// The map that is suggested for a table. It is as it was accepted.
pub fn suggest(unit: &FlightUnit) -> String {
    let map = in_context(|context| ingest::suggest(unit, context)).unwrap();
    crate::golden::assert_golden(&unit.files, &map);
    map
}

/// Reads with these limits. What was read is as it was accepted.
pub fn read_files(limits: Limits, kind: LogKind, files: &[PathBuf], want: &dyn Select) -> Result<Log, LogError> {
    let log = with_limits(limits, |context| ingest::read_files(kind, files, want, context));
    crate::golden::assert_log_as_accepted(files, &log);
    log
}

/// Writes `text` to a file in a new folder, which is deleted on drop.
pub fn file(name: &str, text: &[u8]) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, text).unwrap();
    (folder, path)
}

/// A unit of text tables.
pub fn tables(files: &[PathBuf]) -> FlightUnit {
    FlightUnit { id: "test".into(), files: files.to_vec(), kind: LogKind::Csv }
}

/// Loads with the shipped maps.
pub fn load(unit: &FlightUnit) -> Result<Loaded, IngestError> {
    load_mapped(unit, &MapLibrary::shipped().unwrap(), None)
}

/// Loads with these maps, or with the map of this name. What was loaded is as it was accepted.
pub fn load_mapped(unit: &FlightUnit, library: &MapLibrary, map: Option<&str>) -> Result<Loaded, IngestError> {
    let loaded = in_context(|context| ingest::load(unit, library, map, context));
    crate::golden::assert_as_accepted(&unit.files, &loaded);
    loaded
}

/// Loads one real file; the ledger must add up.
pub fn load_real(below: &str) -> Option<Loaded> {
    let path = real_logs(below)?;
    let loaded = load(&tables(&[path])).unwrap();
    assert_ledger(&loaded);
    Some(loaded)
}

/// Every byte is accounted for once.
pub fn assert_ledger(loaded: &Loaded) {
    let b = &loaded.health.bytes;
    assert_eq!(b.sum(), b.size, "{b:?}");
    for channel in loaded.binding.iter().flat_map(|b| &b.channels) {
        let rejected: u64 = channel.rejected.iter().map(|r| r.count).sum();
        assert_eq!(channel.used + rejected, channel.rows, "{}", channel.name);
    }
}

/// Number of events in the notices of a code.
pub fn count_of(loaded: &Loaded, code: &str) -> u64 {
    loaded.flight.notices.iter().filter(|n| n.code == code).map(|n| n.count).sum()
}

/// The same for notices with this text.
pub fn count_saying(loaded: &Loaded, code: &str, text: &str) -> u64 {
    let notices = loaded.flight.notices.iter();
    notices.filter(|n| n.code == code && n.text.contains(text)).map(|n| n.count).sum()
}

/// Whether anything was lost.
pub fn lossy(loaded: &Loaded) -> bool {
    loaded.flight.notices.iter().any(|n| n.severity == Severity::Loss)
}

/// North and east, m, of the updates of a position, with their times, s since the epoch of its clock.
pub fn track(position: &Channel) -> (Vec<f64>, Vec<[f64; 2]>) {
    let rows = position.update_rows();
    let c = position.series.components();
    let stamps = position.series.timeline().stamps();
    let times = rows.iter().map(|&i| stamps[i].seconds_since(flight::Stamp(0))).collect();
    let geodetic = |i: usize| Geodetic { latitude: c[0][i], longitude: c[1][i], height: c[2][i] };
    let frame = LocalFrame::new(geodetic(rows[0]));
    let at = |&i: &usize| match position.quantity {
        Quantity::PositionGeodetic => {
            let ned = frame.to_ned(geodetic(i));
            [ned[0], ned[1]]
        }
        _ => [c[0][i], c[1][i]],
    };
    (times, rows.iter().map(at).collect())
}

/// How displacements over windows of about `window_s` agree with the mean velocity in them: scale and
/// rotation (rad, clockwise) that turn velocity into displacement, and the share of the displacement
/// that is then left over. A right map gives 1, 0 and little; swapped axes, a wrong sign or a wrong unit
/// do not.
pub struct Agreement {
    pub scale: f64,
    pub rotation: f64,
    pub left_over: f64,
    pub windows: usize,
}

/// Least squares of complex numbers: displacement = g · velocity · time, for windows in motion.
pub fn agreement(position: &Channel, velocity: &Channel, window_s: f64) -> Agreement {
    let (times, points) = track(position);
    let v = velocity.series.components();
    let vt = velocity.series.timeline().seconds_since(flight::Stamp(0));
    let (mut num, mut den, mut total, mut rows) = ([0.0, 0.0], 0.0, 0.0, vec![]);
    let mut start = 0;
    for end in 1..times.len() {
        let dt = times[end] - times[start];
        if dt < window_s {
            continue;
        }
        let d = [points[end][0] - points[start][0], points[end][1] - points[start][1]];
        let (from, to) = (vt.partition_point(|t| *t < times[start]), vt.partition_point(|t| *t <= times[end]));
        start = end;
        let count = (to - from) as f64;
        // A gap in either stream makes no window.
        if dt > 2.0 * window_s || count < 2.0 || d[0].hypot(d[1]) < 3.0 * dt {
            continue;
        }
        let mean = |axis: usize| v[axis][from..to].iter().sum::<f64>() / count * dt;
        let u = [mean(0), mean(1)];
        num[0] += u[0] * d[0] + u[1] * d[1];
        num[1] += u[0] * d[1] - u[1] * d[0];
        den += u[0] * u[0] + u[1] * u[1];
        total += d[0] * d[0] + d[1] * d[1];
        rows.push((u, d));
    }
    let g = [num[0] / den, num[1] / den];
    let left = |(u, d): &([f64; 2], [f64; 2])| {
        (d[0] - g[0] * u[0] + g[1] * u[1]).powi(2) + (d[1] - g[0] * u[1] - g[1] * u[0]).powi(2)
    };
    let left_over = (rows.iter().map(left).sum::<f64>() / total).sqrt();
    Agreement { scale: g[0].hypot(g[1]), rotation: g[1].atan2(g[0]), left_over, windows: rows.len() }
}
