//! Nights as a team runs them: new, changed and unfinished logs, other settings, and a comparison of two reports.

use crate::program::{flightlag, run, text};
use serde_json::Value;
use simulate::{Container, FlightSettings, McapSettings, SensorSettings, simulate, write_campaign};
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

/// A folder with logs, a nightly file and the outputs of the nights.
pub struct Nights {
    pub folder: tempfile::TempDir,
}

impl Nights {
    pub fn new(flights: usize) -> Nights {
        let nights = Nights { folder: tempfile::tempdir().unwrap() };
        fs::create_dir(nights.path("logs")).unwrap();
        write_campaign(&nights.path("logs"), flights, 60.0, 3).unwrap();
        nights.logs().iter().for_each(|log| written_an_hour_ago(log));
        nights.config("");
        nights
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn logs(&self) -> Vec<PathBuf> {
        let mut logs: Vec<PathBuf> = fs::read_dir(self.path("logs")).unwrap().map(|e| e.unwrap().path()).collect();
        logs.sort();
        logs
    }

    fn config(&self, more: &str) {
        let fleet = "schema = 1\n[[aircraft]]\nflights = \"sim/*\"\nairframe = \"uav-1\"\nserial = \"D9-0412\"\n";
        fs::write(self.path("fleet.toml"), fleet).unwrap();
        let text = format!(
            "schema = 1\nout = \"out\"\nfleet = \"fleet.toml\"\n{more}\n[[campaign]]\nflights = \"logs\"\nname = \"sim\"\n"
        );
        fs::write(self.path("nightly.toml"), text).unwrap();
    }

    /// Runs a night and returns its `night.json`.
    pub fn night(&self, exit: i32) -> Value {
        let config = self.path("nightly.toml");
        let printed = run(["nightly".as_ref(), config.as_os_str(), "--threads".as_ref(), "2".as_ref()], exit);
        let lines = text(&printed.stdout);
        let summary = fs::read_to_string(self.path("out/summary.txt")).unwrap();
        assert_eq!(summary.lines().count(), 5, "{summary}");
        assert!(lines.starts_with(&summary), "{lines}");
        let latest = fs::read_dir(self.path("out/nights")).unwrap().map(|e| e.unwrap().path()).max().unwrap();
        let night: Value = serde_json::from_slice(&fs::read(latest.join("night.json")).unwrap()).unwrap();
        for name in ["index.html", "summary.json", "summary.md", "summary.xml"] {
            assert!(latest.join(name).is_file(), "{name}");
        }
        assert_eq!(night["exit"], exit);
        night
    }
}

/// Logs are skipped while they are being written.
fn written_an_hour_ago(path: &Path) {
    let then = SystemTime::now() - Duration::from_secs(3600);
    File::options().write(true).open(path).unwrap().set_modified(then).unwrap();
}

fn names(list: &Value) -> Vec<&str> {
    list.as_array().unwrap().iter().map(|of| of["flight"].as_str().unwrap()).collect()
}

#[test]
fn a_night_reports_what_is_new_changed_failing_and_left_and_why() {
    let nights = Nights::new(3);
    let logs = nights.logs();
    let other = tempfile::tempdir().unwrap();
    write_campaign(other.path(), 4, 60.0, 99).unwrap();

    // The third log is still being written.
    File::options().write(true).open(&logs[2]).unwrap().set_modified(SystemTime::now()).unwrap();
    let first = nights.night(0);
    assert_eq!(names(&first["changes"]["new"]), ["flight-0001.mcap", "flight-0002.mcap"]);
    assert_eq!(first["left"][0]["path"], "flight-0003.mcap");
    assert!(first["left"][0]["reason"].as_str().unwrap().starts_with("still being written"));

    // It is finished; the first one was replaced; a fourth is truncated in the middle.
    written_an_hour_ago(&logs[2]);
    fs::copy(other.path().join("flight-0001.mcap"), &logs[0]).unwrap();
    written_an_hour_ago(&logs[0]);
    let whole = fs::read(other.path().join("flight-0004.mcap")).unwrap();
    let cut = nights.path("logs/flight-0004.mcap");
    fs::write(&cut, &whole[..whole.len() / 2]).unwrap();
    written_an_hour_ago(&cut);
    let second = nights.night(3);
    let changes = &second["changes"];
    assert_eq!(names(&changes["new"]), ["flight-0003.mcap", "flight-0004.mcap"]);
    let rerun = changes["rerun"].as_array().unwrap();
    let of_first = rerun.iter().find(|of| of["flight"] == "flight-0001.mcap").unwrap();
    assert_eq!(of_first["causes"], serde_json::json!(["log"]));
    assert!(
        rerun.iter().all(|of| of["flight"] == "flight-0001.mcap" || of["causes"][0] == "other-flights"),
        "{rerun:?}"
    );
    assert_eq!(names(&changes["failing"]), ["flight-0004.mcap"]);
    assert_eq!(changes["failing"][0]["words"][0], "log damaged");
    let error = changes["failing"][0]["error"].as_str().unwrap();
    assert!(error.contains("flight-0004.mcap"), "{error}");
    assert_eq!(second["left"].as_array().unwrap().len(), 0);
    assert_eq!(second["before"], first["run_id"]);

    // Nothing changes: the night says so, and the history has a file without rows.
    let third = nights.night(3);
    assert!(third["campaigns"][0]["nothing_changed"].as_bool().unwrap());
    assert!(fs::read_to_string(nights.path("out/morning.html")).unwrap().contains("Nothing changed."));
    assert_eq!(third["before"], second["run_id"]);

    // Other settings; a log is gone.
    fs::write(nights.path("p.toml"), "schema = 1\n[delay]\nposition_s = 1.0\nsource = \"test\"\n").unwrap();
    nights.config("pipeline = \"p.toml\"");
    fs::remove_file(&cut).unwrap();
    let fourth = nights.night(4);
    assert_eq!(fourth["before"], third["run_id"], "the last night, although it has no rows");
    let changes = &fourth["changes"];
    assert_eq!(names(&changes["gone"]), ["flight-0004.mcap"]);
    let rerun = changes["rerun"].as_array().unwrap();
    assert_eq!(rerun.len(), 3);
    assert!(rerun.iter().all(|of| of["causes"] == serde_json::json!(["settings"])), "{rerun:?}");
    assert_eq!(names(&changes["failing"]).len(), 3);
    assert!(changes["failing"].as_array().unwrap().iter().all(|of| of["words"][0] == "harmed"), "{changes}");

    let runs: Value = serde_json::from_slice(
        &run(["history".as_ref(), nights.path("out/history").as_os_str(), "--json".as_ref()], 0).stdout,
    )
    .unwrap();
    let rows: Vec<u64> = runs.as_array().unwrap().iter().map(|run| run["flights"].as_u64().unwrap()).collect();
    assert_eq!((rows[0], rows[2], rows[3]), (2, 0, 3), "{rows:?}");
    latency_and_trend(&nights.path("out/history"), &nights.path("trend"));
}

/// A touched log keeps its result. An emptied log has failed, but has not disappeared. An emptied folder is a disk that
/// is not mounted.
#[test]
fn a_flight_keeps_its_result_until_its_log_is_complete_or_emptied() {
    let nights = Nights::new(3);
    // Without its content this is not a log by its name either.
    let simulated = simulate(&FlightSettings { duration_s: 60.0, ..FlightSettings::default() }).unwrap();
    let binary = Container::DataFlash.files(&simulated, "x").unwrap().remove(0);
    let binary_path = nights.path("logs").join("x.BIN");
    fs::write(&binary_path, &binary.bytes).unwrap();
    written_an_hour_ago(&binary_path);
    let logs = nights.logs();
    nights.night(0);
    File::options().write(true).open(&logs[0]).unwrap().set_modified(SystemTime::now()).unwrap();
    let touched = nights.night(0);
    assert_eq!((names(&touched["changes"]["gone"]), names(&touched["changes"]["rerun"])), (vec![], vec![]));
    assert_eq!((touched["changes"]["compared"].as_u64(), names(&touched["changes"]["advice"])), (Some(4), vec![]));
    let left = &touched["left"][0];
    assert_eq!(left["path"], "flight-0001.mcap");
    assert!(left["reason"].as_str().unwrap().ends_with("its result of the last run is kept"), "{left}");

    for log in [&logs[0], &binary_path] {
        fs::write(log, "").unwrap();
        written_an_hour_ago(log);
    }
    let emptied = nights.night(3);
    assert_eq!(names(&emptied["changes"]["gone"]), [] as [&str; 0]);
    let failing = emptied["changes"]["failing"].as_array().unwrap();
    let printed: Vec<(&str, &str)> =
        failing.iter().map(|of| (of["flight"].as_str().unwrap(), of["words"][0].as_str().unwrap())).collect();
    assert_eq!(printed, [("flight-0001.mcap", "failed"), ("x.BIN", "failed")]);
    assert!(failing[1]["error"].as_str().unwrap().starts_with("no longer a flight: "), "{failing:?}");
    fs::write(&binary_path, &binary.bytes).unwrap();
    written_an_hour_ago(&binary_path);
    assert_eq!(names(&nights.night(3)["changes"]["recovered"]), ["x.BIN"]);

    logs.iter().for_each(|log| fs::remove_file(log).unwrap());
    let away = nights.night(75);
    assert!(away["campaigns"][0]["error"].as_str().unwrap().contains("no flight found"), "{away}");
}

/// The files that a page links to. All of them must exist.
fn files_linked(page: &Path) -> Vec<String> {
    let text = fs::read_to_string(page).unwrap();
    let links = text.split("href=\"").skip(1).filter_map(|rest| rest.split('"').next());
    let files: Vec<String> = links.filter(|link| !link.starts_with('#')).map(str::to_owned).collect();
    let lost: Vec<&String> = files.iter().filter(|file| !page.parent().unwrap().join(file).exists()).collect();
    assert!(lost.is_empty(), "{}: {lost:?}", page.display());
    files
}

/// The fleet file states who flew: the logs do not.
fn latency_and_trend(history: &Path, out: &Path) {
    let table = text(&run(["history".as_ref(), history.as_os_str(), "--latency".as_ref()], 0).stdout);
    assert!(table.contains("± is U (k = 2) of the mean") && table.contains("5 Hz"), "{table}");
    let arguments = ["trend".as_ref(), history.as_os_str(), "--out".as_ref(), out.as_os_str(), "--json".as_ref()];
    let trend: Value = serde_json::from_slice(&run(arguments, 0).stdout).unwrap();
    let serial = trend["charts"].as_array().unwrap().iter().find(|chart| chart["dimension"] == "serial").unwrap();
    assert_eq!(serial["value"], "D9-0412");
    assert!(serial["points"].as_array().unwrap().len() >= 3, "{serial}");
    assert!(serial["changes"].as_array().unwrap().is_empty());
    assert!(fs::read_to_string(out.join("index.html")).unwrap().contains("serial D9-0412: no change"));
    assert!(files_linked(&out.join("index.html")).contains(&"figures.zip".to_owned()));
    assert!(fs::read_to_string(out.join("trend.csv")).unwrap().lines().count() > 3);
}

#[test]
fn a_failed_campaign_does_not_stop_others_and_bad_files_are_reported() {
    let nights = Nights::new(1);
    fs::create_dir(nights.path("empty")).unwrap();
    nights.config("");
    let config = fs::read_to_string(nights.path("nightly.toml")).unwrap();
    fs::write(nights.path("nightly.toml"), format!("{config}[[campaign]]\nflights = \"empty\"\n")).unwrap();
    let night = nights.night(1);
    assert_eq!(night["campaigns"][0]["exit"], 0);
    assert!(night["campaigns"][1]["error"].as_str().unwrap().contains("no flight found"));
    let junit = fs::read_to_string(nights.path("out/summary.xml")).unwrap();
    assert!(junit.contains("tests=\"2\" failures=\"1\""), "{junit}");
    fs::write(nights.path("nightly.toml"), "schema = 1\nout = \"out\"\nhistroy = \"h\"\n").unwrap();
    let wrong = text(&run(["nightly".as_ref(), nights.path("nightly.toml").as_os_str()], 2).stderr);
    assert!(wrong.contains("nightly.toml:3: unknown key `histroy`: did you mean `history`?"), "{wrong}");
    assert!(wrong.contains("has no [[campaign]]"), "{wrong}");
    let none = text(&run(["trend".as_ref(), nights.path("empty").as_os_str()], 2).stderr);
    assert!(none.contains("no history found"), "{none}");
    let query = |arguments: &[&str]| text(&run([&["query"], arguments].concat(), 2).stderr);
    assert!(query(&["delay_s > 0.3"]).contains("just query"), "the default build has no queries, and says which has");
    assert!(query(&["dely_s > 0.3"]).contains("the nearest are delay_s"));
}

#[test]
fn two_pipelines_over_the_same_flights_differ_only_by_settings() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    write_campaign(&folder.path().join("logs"), 2, 60.0, 5).unwrap();
    for (name, delay) in [("old.toml", 0.4), ("new.toml", 0.2)] {
        fs::write(path(name), format!("schema = 1\n[delay]\nposition_s = {delay}\nsource = \"test\"\n")).unwrap();
    }
    let (old, new, logs, out) = (path("old.toml"), path("new.toml"), path("logs"), path("diff"));
    let arguments = ["diff", &old, &new, "--flights", &logs, "--out", &out, "--json"];
    let diff: Value = serde_json::from_slice(&run(arguments, 0).stdout).unwrap();
    assert_eq!(diff["settings"][0], "delay.position_s: was 0.4, is 0.2");
    let changes = &diff["changes"];
    assert_eq!((&changes["compared"], names(&changes["rerun"]).len()), (&2.into(), 2));
    let moved = changes["moved"].as_array().unwrap();
    let rerun = changes["rerun"].as_array().unwrap();
    assert!(rerun.iter().chain(moved).all(|of| of["causes"] == serde_json::json!(["settings"])), "{changes}");
    assert!(!moved.iter().any(|of| of["quantity"] == "lateness"), "the lateness of the log is the same: {moved:?}");
    let page = fs::read_to_string(folder.path().join("diff/index.html")).unwrap();
    assert!(page.contains("href=\"second/flights/flight-0001.mcap/index.html\""), "{page}");
    files_linked(&folder.path().join("diff/index.html"));
    // The two reports directly, as text; and a folder that is not a report.
    let (first, second) = (path("diff/first"), path("diff/second"));
    let printed = text(&run(["diff", &first, &second], 0).stdout);
    assert!(printed.contains("computed again") && printed.contains("delay.position_s: was 0.4, is 0.2"), "{printed}");
    let same = text(&run(["diff", &first, &first], 0).stdout);
    assert!(same.contains("2 flights in both: 0 numbers moved"), "{same}");
    let wrong = text(&flightlag(["diff", &first, &logs]).output().unwrap().stderr);
    assert!(wrong.contains("not a campaign report: it has no campaign.json"), "{wrong}");
    let wrong = text(&run(["diff", &old, &new], 2).stderr);
    assert!(wrong.contains("old.toml is a pipeline: add --flights FOLDER and --out DIR"), "{wrong}");
}

/// Former bug: a new flight 160 ms off was "none new" where the flights of its group already differed.
#[test]
fn a_new_flight_unlike_all_earlier_ones_is_reported_in_a_divided_group() {
    let nights = Nights::new(0);
    let add = |name: &str, delay_s: f64, seed: u64| {
        let position = SensorSettings { delay_s, white_std: 0.3, ..SensorSettings::clean(5.0) };
        let settings = FlightSettings { duration_s: 120.0, seed, position, ..FlightSettings::default() };
        let log =
            Container::Mcap(McapSettings::default()).files(&simulate(&settings).unwrap(), name).unwrap().remove(0);
        let path = nights.path("logs").join(&log.path);
        fs::write(&path, &log.bytes).unwrap();
        written_an_hour_ago(&path);
    };
    let is_new = |night: &Value| night["groups"][0]["is_new"].as_bool().unwrap();
    for (k, delay_s) in [0.1, 0.1, 0.24, 0.24].into_iter().enumerate() {
        add(&format!("flight-{k}"), delay_s, k as u64);
    }
    assert!(is_new(&nights.night(3)), "the first night that sees them");
    add("flight-4", 0.24, 4);
    assert!(!is_new(&nights.night(0)), "like two of them");
    add("flight-5", 0.4, 5);
    let night = nights.night(3);
    assert!(is_new(&night), "{night}");
    let words = night["groups"][0]["words"].as_str().unwrap();
    assert!(words.starts_with("flight-5.mcap (400 ms) is new and differs from every earlier flight; "), "{words}");
    assert!(!is_new(&nights.night(0)));
}
