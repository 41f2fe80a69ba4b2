//! Faults of systems and users during a run: failing disks, unusual names and file system shapes, two runs on one
//! report, and the order, place and hour of a run. All cases: `just faults-runs`.
#![cfg(target_os = "linux")]

use crate::program::{assert_same, flightlag, results, run, text};
use record::{CampaignRecord, Outcome};
use std::collections::BTreeSet;
use std::ffi::{OsStr, OsString};
use std::fs;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, SystemTime};

/// A folder of short simulated flights in several containers.
fn flights(count: usize) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let known = "schema = 1\n[delay]\nposition_s = 0.4\nsource = \"simulated\"\n";
    fs::write(folder.path().join("known.toml"), known).unwrap();
    fs::write(folder.path().join("other.toml"), known.replace("0.4", "0.3")).unwrap();
    simulate::write_campaign(&folder.path().join("flights"), count, 20.0, 7).unwrap();
    // Modification times this recent prove nothing yet.
    std::thread::sleep(Duration::from_millis(80));
    folder
}

fn campaign(folder: &Path, flights: &Path, out: &str, more: &[&str]) -> Vec<OsString> {
    let path = |name: &str| folder.join(name).into_os_string();
    let mut all: Vec<OsString> = vec!["campaign".into(), flights.into(), "--out".into(), path(out)];
    all.extend(more.iter().map(OsString::from));
    if !more.contains(&"--pipeline") {
        all.extend(["--pipeline".into(), path("known.toml")]);
    }
    all
}

fn record(out: &Path) -> CampaignRecord {
    campaign::read_report(out).unwrap().unwrap()
}

/// The logs in a folder, one of each kind of file.
fn one_of_each(folder: &Path) -> Vec<PathBuf> {
    let mut open = vec![folder.to_owned()];
    let mut found: Vec<PathBuf> = vec![];
    while let Some(folder) = open.pop() {
        let mut entries: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
        entries.sort();
        for path in entries {
            let is_new =
                path.extension().is_some_and(|ending| !found.iter().any(|known| known.extension() == Some(ending)));
            match path.is_dir() {
                true => open.push(path),
                false if is_new && path.extension() != Some(OsStr::new("json")) => found.push(path),
                false => {}
            }
        }
    }
    found
}

/// Runs the command on a log whose `nth` read fails. `None` if there is no such read, or strace is missing.
fn with_failing_read(log: &Path, nth: usize, error: &str) -> Option<Output> {
    let trace = tempfile::NamedTempFile::new().unwrap();
    let program = flightlag([""]).get_program().to_owned();
    let mut command = Command::new("strace");
    command.args(["-f", "-qq", "-o"]).arg(trace.path()).arg("-P").arg(log);
    command.args(["-e", "trace=read,pread64", "-e", &format!("inject=read,pread64:error={error}:when={nth}")]);
    let output = command.arg(program).arg("inspect").arg(log).output().ok()?;
    fs::read_to_string(trace.path()).unwrap().contains("INJECTED").then_some(output)
}

/// Makes every `step`-th read fail; returns the number of failures.
fn failing_reads(log: &Path, step: usize) -> usize {
    let name = log.file_name().unwrap().to_str().unwrap();
    let mut failed = 0;
    for nth in (1..).step_by(step) {
        let mut any = false;
        for error in ["EIO", "ESTALE"] {
            let Some(output) = with_failing_read(log, nth, error) else { continue };
            (any, failed) = (true, failed + 1);
            let (code, printed) = (output.status.code(), text(&output.stderr));
            // Format detection from the first bytes may succeed without the remaining ones.
            let is_whole = code == Some(0) && text(&output.stdout).contains(" 0 damaged");
            let is_error = code == Some(1) && printed.contains(name) && printed.contains("os error");
            assert!(is_whole || is_error, "{name}, read {nth}, {error}: {code:?}\n{printed}\n{}", text(&output.stdout));
        }
        if !any {
            break;
        }
    }
    failed
}

fn packed(log: &Path) -> PathBuf {
    let packed = log.with_extension("csv.zst");
    fs::write(&packed, zstd::encode_all(&*fs::read(log).unwrap(), 3).unwrap()).unwrap();
    packed
}

fn failing_logs(step: usize) {
    let folder = flights(8);
    let mut logs = one_of_each(&folder.path().join("flights"));
    let table = logs.iter().find(|log| log.extension() == Some(OsStr::new("csv"))).cloned();
    logs.extend(table.map(|table| packed(&table)));
    for log in logs {
        let failed = failing_reads(&log, step);
        if failed == 0 {
            println!("skipped: no strace here, or it may not trace");
            return;
        }
        println!("{}: {failed} reads failed", log.display());
    }
}

#[test]
fn a_failing_disk_is_an_error_naming_the_file_not_damage() {
    failing_logs(45);
}

#[test]
#[ignore = "minutes; `just faults-runs`"]
fn a_disk_failing_at_any_read_is_an_error_naming_the_file_not_damage() {
    failing_logs(1);
}

#[cfg(unix)]
#[test]
fn special_files_are_refused_by_every_command_without_blocking() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    assert!(Command::new("mkfifo").arg(path("pipe.csv")).status().unwrap().success());
    let _socket = std::os::unix::net::UnixListener::bind(path("socket.csv")).unwrap();
    fs::create_dir(path("folder.csv")).unwrap();
    std::os::unix::fs::symlink(path("gone.csv"), path("dangling.csv")).unwrap();
    std::os::unix::fs::symlink(path("circle.csv"), path("circle.csv")).unwrap();
    let odd = ["pipe.csv", "socket.csv", "folder.csv", "dangling.csv", "circle.csv", "/dev/zero", "/dev/null", "-"];
    for log in odd {
        let log = if log.starts_with(['/', '-']) { PathBuf::from(log) } else { path(log) };
        let out = path("out");
        for arguments in [
            vec![OsStr::new("inspect"), log.as_os_str()],
            vec![OsStr::new("delay"), log.as_os_str()],
            vec![
                OsStr::new("export"),
                log.as_os_str(),
                OsStr::new("--to"),
                OsStr::new("csv"),
                OsStr::new("--out"),
                out.as_os_str(),
            ],
            vec![OsStr::new("recover"), log.as_os_str(), out.as_os_str()],
        ] {
            let mut command = flightlag(&arguments);
            let output = command.current_dir(folder.path()).stdin(Stdio::null()).output().unwrap();
            let (code, printed) = (output.status.code(), text(&output.stderr));
            assert!(matches!(code, Some(1 | 2)), "{arguments:?}: {code:?} {printed}");
            let name = log.file_name().map_or("-".into(), |name| name.to_string_lossy().into_owned());
            assert!(printed.contains(&name), "{arguments:?}: {printed}");
            assert!(!out.exists(), "{arguments:?}");
        }
    }
}

/// A tree with every shape, with `count` readable logs.
fn odd_tree(root: &Path, log: &[u8]) -> usize {
    let plain: [&[u8]; 16] = [
        b"-rf.mcap",
        b"a\nb.mcap",
        b"q\"uo'te.mcap",
        b"50%25 %s.mcap",
        "\u{1f681}.mcap".as_bytes(),
        "abc\u{202e}gpj.mcap".as_bytes(),
        b"\xff\xfe.mcap",
        b"Twin.mcap",
        b"twin.mcap",
        b"one/same.mcap",
        b"two/same.mcap",
        b"con.mcap",
        b"a\\b.mcap",
        b"<script>alert(1)<.mcap",
        b"\x01\x7f.mcap",
        b" blank .mcap",
    ];
    let long = [&[b'x'; 250][..], b".mcap"].concat();
    let mut names: Vec<&OsStr> = plain.iter().map(|name| OsStr::from_bytes(name)).collect();
    names.push(OsStr::from_bytes(&long));
    for name in &names {
        let path = root.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, log).unwrap();
    }
    // Not separate logs: the same file under other names, and circular links.
    fs::hard_link(root.join("Twin.mcap"), root.join("zz-hard.mcap")).unwrap();
    std::os::unix::fs::symlink("Twin.mcap", root.join("zz-link.mcap")).unwrap();
    std::os::unix::fs::symlink(".", root.join("here")).unwrap();
    std::os::unix::fs::symlink("circle-b", root.join("circle-a")).unwrap();
    std::os::unix::fs::symlink("circle-a", root.join("circle-b")).unwrap();
    assert!(Command::new("mkfifo").arg(root.join("pipe.mcap")).status().unwrap().success());
    drop(std::os::unix::net::UnixListener::bind(root.join("socket.mcap")).unwrap());
    // A path of more than 4096 bytes, which can only be created step by step.
    let deep =
        "d=$(printf 'd%.0s' $(seq 200)); for i in $(seq 24); do mkdir $d && cd $d || exit 1; done; cat > deep.mcap";
    let mut made = Command::new("bash").args(["-c", deep]).current_dir(root).stdin(Stdio::piped()).spawn().unwrap();
    std::io::Write::write_all(&mut made.stdin.take().unwrap(), log).unwrap();
    assert!(made.wait().unwrap().success());
    names.len()
}

#[cfg(unix)]
#[test]
fn each_log_of_an_unusual_tree_is_one_flight_with_its_own_page() {
    let folder = flights(1);
    let log = one_of_each(&folder.path().join("flights"));
    let log = fs::read(log.iter().find(|log| log.extension() == Some(OsStr::new("mcap"))).unwrap()).unwrap();
    let tree = folder.path().join("odd");
    let count = odd_tree(&tree, &log);
    // Some links and the deep path cannot be read: they are rows, and the others have their pages.
    run(campaign(folder.path(), &tree, "one", &["--quiet"]), 3);
    let report = folder.path().join("one");
    let record = record(&report);
    let (failed, read): (Vec<_>, Vec<_>) =
        record.flights.iter().partition(|row| matches!(row.outcome, Outcome::Failed { .. }));
    assert_eq!(read.len(), count, "{:?}", read.iter().map(|row| &row.flight).collect::<Vec<_>>());
    assert_eq!(failed.len(), 3, "{:?}", failed.iter().map(|row| &row.flight).collect::<Vec<_>>());
    let pages: BTreeSet<String> = record.flights.iter().map(|row| row.page.to_string().to_lowercase()).collect();
    assert_eq!(pages.len(), record.flights.len(), "pages are unique on a case-insensitive file system");
    let root = report.canonicalize().unwrap();
    for row in &record.flights {
        assert!(report.join(&row.page).canonicalize().unwrap().starts_with(&root), "{}", row.page);
    }
}

/// What is started while a campaign is running on the same report.
const SECOND: [&str; 12] = [
    "same",
    "other pipeline",
    "other flights",
    "verify",
    "plan",
    "gc",
    "status",
    "diff",
    "killed first",
    "terminated first",
    "interrupted first",
    "files of tomorrow",
];

/// Two runs on one report, the second `later_ms` milliseconds after the first. Each succeeds or refuses; a run after
/// both gives the bytes of a single run.
fn two_runs(folder: &Path, whole: &Path, kind: &str, later_ms: u64, out: &str) {
    let flights = folder.join("flights");
    let arguments = |more: &[&str]| campaign(folder, &flights, out, more);
    let quiet = |arguments: Vec<OsString>| {
        let mut command = flightlag(arguments);
        command.stdout(Stdio::null()).stderr(Stdio::piped());
        command
    };
    let mut first = quiet(arguments(&["--quiet"])).spawn().unwrap();
    std::thread::sleep(Duration::from_millis(later_ms));
    let report = folder.join(out).into_os_string();
    let second = match kind {
        "other pipeline" => arguments(&["--quiet", "--pipeline", folder.join("other.toml").to_str().unwrap()]),
        "verify" => arguments(&["--quiet", "--verify"]),
        "other flights" => campaign(folder, &folder.join("flights-2"), out, &["--quiet"]),
        "plan" => {
            let path = |path: &Path| path.as_os_str().to_owned();
            let [verb, stage, to] = ["campaign", "plan", "--out"].map(OsString::from);
            vec![verb, stage, path(&flights), to, report, "--pipeline".into(), path(&folder.join("known.toml"))]
        }
        "gc" => vec!["gc".into(), report],
        "status" => vec!["status".into(), report],
        "diff" => vec!["diff".into(), whole.into(), report],
        _ => arguments(&["--quiet"]),
    };
    match kind {
        "killed first" => first.kill().unwrap(),
        "terminated first" => signal(&first, "TERM"),
        "interrupted first" => signal(&first, "INT"),
        // A clock that was set back leaves such files.
        "files of tomorrow" => touch_tomorrow(&folder.join(out).join(".flightlag")),
        _ => {}
    }
    let second = quiet(second).output().unwrap();
    let first = first.wait_with_output().unwrap();
    for output in [&first, &second] {
        let printed = text(&output.stderr);
        let is_killed = kind == "killed first" && output.status.signal() == Some(9)
            || kind == "terminated first"
                && matches!((output.status.code(), output.status.signal()), (Some(143), _) | (_, Some(15)))
            || kind == "interrupted first"
                && matches!((output.status.code(), output.status.signal()), (Some(130), _) | (_, Some(2)));
        let refused =
            matches!(output.status.code(), Some(1 | 2 | 75)) && !printed.is_empty() && !printed.contains("panicked");
        assert!(output.status.success() || is_killed || refused, "{kind}, {later_ms} ms: {} {printed}", output.status);
    }
    assert!(is_well(&first) || is_well(&second) || kind.ends_with(" first"), "{kind}, {later_ms} ms: both refuse");
    // The first one keeps the report of these flights.
    let others_won = kind == "other flights" && !is_well(&first);
    let (flights, whole) = if others_won {
        (folder.join("flights-2"), whole.with_file_name("whole-2"))
    } else {
        (flights.clone(), whole.to_owned())
    };
    run(campaign(folder, &flights, out, &["--quiet"]), 0);
    let (mut found, whole) = (results(&folder.join(out)), results(&whole));
    // Results of other settings or flights stay next to those of the report.
    if kind.starts_with("other ") {
        found.retain(|path, _| whole.contains_key(path) || !path.starts_with("by-key"));
    }
    assert_same(&found, &whole);
}

fn signal(child: &Child, name: &str) {
    assert!(Command::new("kill").args(["-s", name, &child.id().to_string()]).status().unwrap().success());
}

/// Sets the times of the files in a folder, if it exists, a day ahead.
fn touch_tomorrow(folder: &Path) {
    let tomorrow = SystemTime::now() + Duration::from_secs(86_400);
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        // A temporary file may be gone by now.
        let Ok(file) = fs::File::options().write(true).open(entry.path()) else { continue };
        file.set_modified(tomorrow).unwrap();
    }
}

fn is_well(output: &Output) -> bool {
    output.status.success()
}

fn interleavings(kinds: &[&str], each: u64) {
    let folder = flights(3);
    simulate::write_campaign(&folder.path().join("flights-2"), 2, 20.0, 8).unwrap();
    run(campaign(folder.path(), &folder.path().join("flights"), "whole", &["--quiet"]), 0);
    run(campaign(folder.path(), &folder.path().join("flights-2"), "whole-2", &["--quiet"]), 0);
    let whole = folder.path().join("whole");
    for kind in kinds {
        for turn in 0..each {
            let out = format!("{}-{turn}", kind.replace(' ', "-"));
            two_runs(folder.path(), &whole, kind, 7 + turn * 900 / each, &out);
        }
    }
}

#[test]
fn two_runs_on_one_report_never_mix() {
    interleavings(&["same", "other pipeline", "gc"], 2);
}

#[test]
#[ignore = "minutes; `just faults-runs`"]
fn two_runs_of_any_kind_on_one_report_never_mix_at_fifty_delays() {
    interleavings(&SECOND, 50);
}

/// Drops the disk cache where permitted: the next run reads logs and program from disk.
fn with_cold_cache() {
    if let Err(error) = fs::write("/proc/sys/vm/drop_caches", "3") {
        println!("no cold cache: {error}");
    }
}

/// Repeats a run on the same flights, varying everything that must not matter.
fn repeated(times: usize) {
    let folder = flights(4);
    run(campaign(folder.path(), &folder.path().join("flights"), "whole", &["--quiet"]), 0);
    let whole = results(&folder.path().join("whole"));
    let zones = ["Asia/Kathmandu", "America/St_Johns", "UTC", ""];
    let languages = ["de_DE.UTF-8", "tr_TR.UTF-8", "C", "ja_JP.EUC-JP"];
    for turn in 0..times {
        // Another place, and files created in another order: the folder lists them in a different order.
        let place = folder.path().join(format!("place-{turn}/{}", "deeper/".repeat(turn % 3)));
        let mut files = all_files(&folder.path().join("flights"));
        files.rotate_left(turn % 5);
        if turn % 2 == 0 {
            files.reverse();
        }
        for (name, bytes) in files {
            let path = place.join("flights").join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, bytes).unwrap();
        }
        let threads = ["1", "2", "8"][turn % 3];
        let mut command = flightlag(campaign(
            folder.path(),
            &place.join("flights"),
            &format!("out-{turn}"),
            &["--quiet", "--threads", threads],
        ));
        // It affects other users of this machine: not in the few runs of every day.
        if times >= 20 && turn % 4 == 3 {
            with_cold_cache();
        }
        let language = languages[turn % 4];
        command.env("TZ", zones[turn % 4]).env("LANG", language).env("LC_ALL", language);
        command.env("RUST_BACKTRACE", "1").current_dir(&place);
        let output = command.output().unwrap();
        assert!(output.status.success(), "{turn}: {}", text(&output.stderr));
        assert_same(&results(&folder.path().join(format!("out-{turn}"))), &whole);
        fs::remove_dir_all(folder.path().join(format!("out-{turn}"))).unwrap();
    }
}

fn all_files(root: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    crate::program::tree(root).into_iter().collect()
}

#[test]
fn place_order_threads_time_zone_and_language_change_no_byte() {
    repeated(3);
}

#[test]
#[ignore = "minutes; `just faults-runs`"]
fn twenty_runs_in_twenty_environments_give_the_same_bytes() {
    repeated(20);
}
