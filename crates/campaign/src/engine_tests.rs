//! The engine with a fast study that can be made to fail.

mod cluster;
pub(crate) mod faults;
mod reported;
mod store_tests;

use crate::config::Pipeline;
use crate::event::Event;
use crate::manifest::{Manifest, Planned, Stage, Why};
use crate::plan::Order;
use crate::reduce::Verdict;
use crate::run::{plan_shards, run_with};
use crate::run_context::RunContext;
use crate::status::status;
use crate::study::{Interrupted, Studied, Study, failed_record};
use crate::task::make;
use crate::{CampaignError, Exit};
use compensation_replay::{Track, TrackColumn};
use record::{CampaignChanges, CampaignRecord, FlightRecord, MeasuredFlight, Outcome};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, SystemTime};

/// A table with `text` as its only value.
fn table(text: &str) -> String {
    format!("time,word\n0,{text}\n1,{text}\n")
}

/// A study scripted by the first word of the log.
struct Scripted {
    stop_at: Option<&'static str>,
}

impl Study for Scripted {
    fn measure(&self, flight: &Planned, _: &Manifest, context: &RunContext<'_>) -> Result<MeasuredFlight, Interrupted> {
        let text = fs::read_to_string(&flight.files[0].path).map_err(|e| Interrupted::Trouble(e.to_string()))?;
        if self.stop_at == Some(flight.flight.as_str()) {
            context.cancel.store(true, Ordering::Relaxed);
            return Err(Interrupted::Cancelled);
        }
        let key = flight.measure_key.as_deref().unwrap();
        let words: Vec<&str> = text.lines().nth(1).unwrap_or_default().split([',', ' ']).skip(1).collect();
        match words.as_slice() {
            ["panic", ..] => panic!("index 7 out of range"),
            ["busy", ..] => Err(Interrupted::Trouble("the disk does not answer".into())),
            ["late", seconds, ..] => Ok(late(key, seconds.parse().unwrap())),
            _ => Ok(crate::answer::failed(key, String::new())),
        }
    }

    fn study(
        &self,
        flight: &Planned,
        measured: MeasuredFlight,
        manifest: &Manifest,
        _: &RunContext<'_>,
    ) -> Result<Studied, Interrupted> {
        let text = fs::read_to_string(&flight.files[0].path).map_err(|e| Interrupted::Trouble(e.to_string()))?;
        let failed = failed_record(flight, manifest, "cut before the first message".into());
        let (decision, lateness) = (flight.decision.clone(), Some(measured.lateness));
        let failed = FlightRecord { decision, lateness, ..failed };
        match text.lines().nth(1).and_then(|l| l.split([',', ' ']).nth(1)) {
            Some("bad") => Ok(Studied { record: failed, track: None, explorer: None }),
            _ => Ok(Studied {
                record: FlightRecord { outcome: Outcome::Compensated, ..failed },
                track: Some(Box::new(track(&text))),
                explorer: None,
            }),
        }
    }
}

/// A measurement of a position that is `lateness_s` ± 8 ms late.
fn late(key: &str, lateness_s: f64) -> MeasuredFlight {
    let mut measured = crate::answer::failed(key, String::new());
    let channel = serde_json::json!({
        "channel": "position.gps", "lateness_s": { "value": lateness_s, "standard_uncertainty": 0.008 },
        "model_uncertainty_s": 0.0078, "interval_95_s": [lateness_s - 0.016, lateness_s + 0.016], "part": 0,
        "datum": "imu", "relative_to": null, "derived": false, "weak": false, "at_least_s": null,
        "filter_not_a_delay": null, "earlier_than_datum": false, "against_refused_datum_s": null, "rests_on": null,
    });
    let lateness = &mut measured.lateness;
    lateness.failed = None;
    (lateness.position, lateness.velocity) = (Some("position.gps".into()), Some("velocity.ekf".into()));
    lateness.lateness = Some(serde_json::from_value(channel).unwrap());
    (lateness.datum, lateness.verdict) = (record::NetworkDatum::Imu, Some(record::NetworkVerdict::Consistent));
    lateness.kind = record::DelayKind::Constant;
    measured
}

fn track(text: &str) -> Track {
    let stamps: Vec<i64> = text.bytes().map(i64::from).collect();
    let north = text.bytes().map(|b| (b > 64).then(|| f64::from(b) / 3.0)).collect();
    Track { columns: vec![("t_ns".into(), TrackColumn::I64(stamps)), ("north_m".into(), TrackColumn::F64(north))] }
}

/// A folder of flights and an output folder.
struct Bench {
    folder: tempfile::TempDir,
    pipeline: String,
    stop_at: Option<&'static str>,
}

struct Ran {
    verdict: Result<Verdict, CampaignError>,
    events: Vec<Event>,
}

impl Ran {
    /// Flights with a log that was read in any stage, with the reasons.
    fn started(&self) -> BTreeMap<String, Vec<Why>> {
        [Stage::Measure, Stage::Replay].into_iter().flat_map(|stage| self.started_to(stage)).collect()
    }

    fn started_to(&self, wanted: Stage) -> BTreeMap<String, Vec<Why>> {
        let of = |e: &Event| match e {
            Event::Started { flight, stage, why, .. } if *stage == wanted => Some((flight.clone(), why.clone())),
            _ => None,
        };
        self.events.iter().filter_map(of).collect()
    }

    fn hashed_files(&self) -> usize {
        let of = |e: &Event| if let Event::Hashing { files, .. } = e { *files } else { 0 };
        self.events.iter().map(of).sum()
    }

    fn verdict(&self) -> &Verdict {
        self.verdict.as_ref().unwrap()
    }
}

impl Bench {
    fn new(flights: &[(&str, &str)]) -> Bench {
        let folder = tempfile::tempdir().unwrap();
        let pipeline = "schema = 1\n[delay]\nposition_s = 0.4\nsource = \"bench\"\n".to_owned();
        let bench = Bench { folder, pipeline, stop_at: None };
        fs::create_dir(bench.flights()).unwrap();
        for (name, text) in flights {
            bench.log(name, text);
        }
        bench
    }

    fn five() -> Bench {
        Bench::new(&[("a.csv", "one"), ("b.csv", "two"), ("c.csv", "three"), ("d.csv", "four"), ("e.csv", "five")])
    }

    fn flights(&self) -> PathBuf {
        self.folder.path().join("flights")
    }

    fn out(&self) -> PathBuf {
        self.folder.path().join("report")
    }

    /// Writes a log and waits until its timestamps are reliable.
    fn log(&self, name: &str, text: &str) {
        fs::write(self.flights().join(name), table(text)).unwrap();
        std::thread::sleep(Duration::from_millis(60));
    }

    fn run(&self) -> Ran {
        self.run_into(&self.out(), 2, false)
    }

    fn run_into(&self, out: &Path, threads: usize, verify: bool) -> Ran {
        let events = Mutex::new(vec![]);
        let sink = |event: &Event| events.lock().unwrap().push(event.clone());
        let cancel = AtomicBool::new(false);
        let order = self.order(out, verify);
        let context = RunContext { threads, cancel: &cancel, events: &sink };
        let stop_at = self.stop_at;
        let verdict = run_with(&order, &context, &|_| Ok(Box::new(Scripted { stop_at })));
        Ran { verdict, events: events.into_inner().unwrap() }
    }

    fn order(&self, out: &Path, verify: bool) -> Order {
        Order {
            flights: self.flights(),
            out: out.to_owned(),
            pipeline: Pipeline::parse(&self.pipeline, Path::new("p.toml")).unwrap(),
            verify,
            replace: false,
            command: "flightlag campaign flights --out REPORT".into(),
            settle: None,
        }
    }

    /// Every output except those that depend on the time and on this machine.
    fn tree(&self, out: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
        let mut tree = BTreeMap::new();
        let mut open = vec![out.to_owned()];
        while let Some(folder) = open.pop() {
            for entry in fs::read_dir(folder).unwrap().map(|e| e.unwrap()) {
                match entry.file_type().unwrap().is_dir() {
                    true => open.push(entry.path()),
                    false => {
                        drop(tree.insert(
                            entry.path().strip_prefix(out).unwrap().to_owned(),
                            fs::read(entry.path()).unwrap(),
                        ))
                    }
                }
            }
        }
        tree.retain(|path, _| !depends_on_earlier_runs(path) && !path.starts_with(".flightlag"));
        tree
    }

    /// Edits the state that the last run wrote for the next.
    fn edit_state(&self, edit: impl FnOnce(&mut serde_json::Value)) {
        let store = crate::store::Store::open(&self.out()).unwrap();
        let mut state: serde_json::Value = store.read_sealed(".flightlag/state.json").unwrap();
        edit(&mut state);
        store.write_sealed(".flightlag/state.json", &state).unwrap();
    }

    fn changes(&self) -> CampaignChanges {
        serde_json::from_slice(&fs::read(self.out().join("since-last-run.json")).unwrap()).unwrap()
    }

    fn record(&self) -> CampaignRecord {
        crate::read_report(&self.out()).unwrap().unwrap()
    }
}

/// The outputs that say when and after what a run was: the bytes of all others depend on logs, pipeline and build
/// alone.
fn depends_on_earlier_runs(path: &Path) -> bool {
    ["run.json", "since-last-run.json", "since-last-run.html"].iter().any(|name| path == Path::new(name))
}

/// A group of flights after two runs, between which one log was rewritten, one added and one removed.
fn changed_group() -> Bench {
    let bench = group();
    bench.run();
    let first = bench.changes();
    assert!(first.before.is_none() && first.new.is_empty() && first.rerun.is_empty(), "{first:?}");
    bench.log("b.csv", "late 0.25");
    bench.log("h.csv", "late 0.2004");
    fs::remove_file(bench.flights().join("g.csv")).unwrap();
    bench.run();
    bench
}

fn causes(changes: &CampaignChanges, flight: &str) -> Option<String> {
    changes.rerun.iter().find(|r| r.flight == flight).map(|r| r.causes.join(", "))
}

#[test]
fn changes_since_the_previous_run_are_reported_with_their_cause() {
    let mut bench = changed_group();
    let then = bench.changes();
    assert_eq!((&then.new, &then.gone), (&vec!["h.csv".to_owned()], &vec!["g.csv".to_owned()]));
    assert_eq!(then.moved.iter().map(|m| m.name.as_str()).collect::<Vec<_>>(), ["b.csv"]);
    let moved = &then.moved[0];
    assert!((moved.now_s.value - moved.before_s.value - 0.0488).abs() < 1e-9, "{moved:?}");
    assert_eq!(causes(&then, "b.csv").as_deref(), Some("the log has changed"));
    bench.pipeline += "[delay]\nposition_s = 0.3\nsource = \"bench\"\n";
    bench.run();
    let settings = bench.changes();
    assert_eq!(settings.rerun.len(), 7);
    assert!(causes(&settings, "a.csv").unwrap().contains("settings have changed: "), "{settings:?}");
    assert!(
        settings.moved.is_empty() && settings.before.as_ref().unwrap().pipeline_blake3 != settings.now.pipeline_blake3
    );
}

#[test]
fn a_run_that_changes_nothing_keeps_the_last_report_of_changes() {
    let bench = changed_group();
    let then = bench.changes();
    let page = || fs::read(bench.out().join("since-last-run.html")).unwrap();
    let before = page();
    assert!(bench.run().verdict().nothing_changed && page() == before && bench.changes() == then);
    fs::remove_file(bench.out().join("flights/b.csv/index.html")).unwrap();
    bench.run();
    assert!(page() == before && bench.changes() == then);
    // Nor does the loss of the folder's state, which leaves no cause to find.
    fs::remove_file(bench.out().join(".flightlag/state.json")).unwrap();
    bench.run();
    assert_eq!(bench.changes(), then);
}

#[test]
fn a_flight_that_starts_or_stops_failing_is_among_the_changes() {
    let bench = Bench::five();
    bench.run();
    bench.log("b.csv", "bad");
    bench.run();
    let names = |all: &[record::TroubleChange]| {
        all.iter().map(|t| format!("{}: {}", t.flight, t.troubles.join(", "))).collect::<Vec<_>>()
    };
    assert_eq!(names(&bench.changes().failing), ["b.csv: failed"]);
    bench.log("b.csv", "two");
    bench.run();
    assert_eq!(
        (names(&bench.changes().recovered), bench.changes().failing.len()),
        (vec!["b.csv: failed".to_owned()], 0)
    );
}

#[test]
fn a_second_run_with_nothing_changed_opens_no_log_and_writes_nothing() {
    let bench = Bench::five();
    assert_eq!(bench.run().started().len(), 5);
    let before = bench.tree(&bench.out());
    let again = bench.run();
    assert!(again.started().is_empty());
    assert_eq!(again.hashed_files(), 0);
    assert!(again.events.contains(&Event::NothingChanged) && again.verdict().nothing_changed);
    assert_eq!(bench.tree(&bench.out()), before);
}

#[test]
fn one_changed_log_reruns_that_flight_and_reports_why() {
    let bench = Bench::five();
    bench.run();
    bench.log("c.csv", "THREE");
    let again = bench.run();
    assert_eq!(again.started(), BTreeMap::from([("c.csv".to_owned(), vec![Why::LogChanged])]));
    assert_eq!(again.hashed_files(), 1);
    let pages =
        again.events.iter().find_map(|e| if let Event::Reduced { pages, .. } = e { Some(*pages) } else { None });
    assert_eq!(pages, Some(1));
}

#[test]
fn a_log_that_was_only_touched_is_hashed_and_not_read_again() {
    let bench = Bench::five();
    bench.run();
    bench.log("c.csv", "three");
    let again = bench.run();
    assert_eq!((again.started().len(), again.hashed_files()), (0, 1));
    assert!(again.verdict().nothing_changed);
}

#[test]
fn verify_hashes_every_log_and_still_reuses_valid_results() {
    let bench = Bench::five();
    bench.run();
    let again = bench.run_into(&bench.out(), 2, true);
    assert_eq!((again.started().len(), again.hashed_files()), (0, 5));
}

#[test]
fn a_changed_setting_reruns_all_and_is_reported() {
    let mut bench = Bench::five();
    bench.run();
    bench.pipeline = bench.pipeline.replace("0.4", "0.35");
    let again = bench.run();
    let settings = vec!["delay.position_s: was 0.4, is 0.35".to_owned()];
    assert_eq!(again.started().len(), 5);
    assert!(again.started().values().all(|why| *why == [Why::SettingsChanged { settings: settings.clone() }]));
    bench.pipeline = bench.pipeline.replace("0.35", "0.4");
    assert!(bench.run().started().is_empty(), "the first results are still there");
}

#[test]
fn a_changed_delay_to_remove_replays_without_measuring() {
    let mut bench = Bench::five();
    bench.run();
    bench.pipeline = bench.pipeline.replace("0.4", "0.35");
    let again = bench.run();
    assert_eq!((again.started_to(Stage::Measure).len(), again.started_to(Stage::Replay).len()), (0, 5));
    bench.pipeline += "[measure]\nsearch_s = [-1.0, 1.0]\n";
    let again = bench.run();
    assert_eq!((again.started_to(Stage::Measure).len(), again.started_to(Stage::Replay).len()), (5, 5));
}

/// A group of flights with known lateness.
fn group() -> Bench {
    let names = ["a.csv", "b.csv", "c.csv", "d.csv", "e.csv", "f.csv", "g.csv"];
    let texts = ["late 0.2001", "late 0.2012", "late 0.1998", "late 0.2003", "late 0.1995", "late 0.2006", "late 0.2"];
    let flights: Vec<(&str, &str)> = names.into_iter().zip(texts).collect();
    let mut bench = Bench::new(&flights);
    bench.pipeline = "schema = 1\n".to_owned();
    bench
}

#[test]
fn one_more_flight_of_a_group_replays_only_that_flight() {
    let bench = group();
    assert_eq!(bench.run().started_to(Stage::Replay).len(), 7);
    let removed = |b: &Bench| {
        let of = |r: &record::FlightRow| r.decision.as_ref().and_then(|d| d.delay_s);
        b.record().flights.iter().map(of).collect::<Vec<_>>()
    };
    assert_eq!(removed(&bench), [Some(0.2); 7], "the mean of the others, on a grid");
    bench.log("h.csv", "late 0.2004");
    let again = bench.run();
    assert_eq!(again.started_to(Stage::Measure), BTreeMap::from([("h.csv".to_owned(), vec![Why::NewFlight])]));
    assert_eq!(again.started_to(Stage::Replay), BTreeMap::from([("h.csv".to_owned(), vec![Why::NewFlight])]));
    assert_eq!(bench.record().groups.iter().map(|g| (g.flights, g.pooled)).collect::<Vec<_>>(), [(8, 8)]);
}

#[test]
fn a_group_whose_mean_moves_replays_its_flights_and_reports_why() {
    let bench = group();
    bench.run();
    for name in ["b.csv", "c.csv", "d.csv", "e.csv", "f.csv", "g.csv"] {
        bench.log(name, "late 0.25");
    }
    let again = bench.run();
    assert_eq!(again.started_to(Stage::Measure).len(), 6);
    let why = again.started_to(Stage::Replay).remove("a.csv").unwrap();
    assert!(matches!(why.as_slice(), [Why::DelayChanged { was, is }] if was != is), "{why:?}");
}

#[test]
fn shards_of_both_stages_give_the_same_bytes_as_one_machine() {
    let bench = group();
    bench.run();
    let alone = bench.tree(&bench.out());
    let out = bench.folder.path().join("cluster");
    let (store, cancel) = (crate::store::Store::open(&out).unwrap(), AtomicBool::new(false));
    let sink = |_: &Event| {};
    let context = RunContext { threads: 1, cancel: &cancel, events: &sink };
    let order = bench.order(&out, false);
    let mut stages = vec![];
    let manifest = loop {
        let manifest = plan_shards(&order, &context, 3).unwrap();
        let Some(stage) = manifest.stage() else { break manifest };
        stages.push((stage, manifest.shards()));
        for shard in 0..manifest.shards() {
            let flights = manifest.of_shard(shard);
            make(&flights, &manifest, &Scripted { stop_at: None }, &store, &context).unwrap();
        }
        assert_eq!(status(&manifest).unwrap().exit(), Exit::Well, "{stage}");
    };
    assert_eq!(stages, [(Stage::Measure, 3), (Stage::Replay, 3)]);
    crate::reduce::reduce(&manifest, &context).unwrap();
    assert_eq!(bench.tree(&out), alone);
}

#[test]
fn a_comment_in_the_pipeline_changes_nothing() {
    let mut bench = Bench::five();
    bench.run();
    bench.pipeline = format!("# tuned in October\n{}\n[replay]\nzoom_s = 20\n", bench.pipeline);
    assert!(bench.run().verdict().nothing_changed);
}

#[test]
fn the_number_of_threads_changes_no_byte() {
    let bench = Bench::five();
    bench.log("x.csv", "bad");
    bench.log("y.csv", "panic");
    let trees = [1, 2, 8].map(|threads| {
        let out = bench.folder.path().join(format!("out{threads}"));
        bench.run_into(&out, threads, false);
        bench.tree(&out)
    });
    assert!(trees[0].len() > 7 * 2);
    assert_eq!(trees[0], trees[1]);
    assert_eq!(trees[0], trees[2]);
}

#[test]
fn a_corrupt_log_and_a_panic_are_rows_and_do_not_stop_the_others() {
    let bench = Bench::five();
    bench.log("x.csv", "bad log");
    bench.log("y.csv", "panic please");
    let ran = bench.run();
    let record = bench.record();
    assert_eq!((record.totals.flights, record.totals.compensated, record.totals.failed), (7, 5, 2));
    assert_eq!(ran.verdict().exit(), Exit::Incomplete);
    let reason = |name: &str| format!("{:?}", record.flights.iter().find(|r| r.flight == name).unwrap().outcome);
    assert!(reason("x.csv").contains("cut before the first message"));
    assert!(reason("y.csv").contains("index 7 out of range") && reason("y.csv").contains("defect"));
    assert_eq!(bench.run().verdict().exit(), Exit::Incomplete, "also when nothing is new");
}

#[test]
fn trouble_is_retried_and_a_lasting_failure_is_not() {
    let bench = Bench::new(&[("a.csv", "one"), ("b.csv", "busy"), ("c.csv", "bad")]);
    let first = bench.run();
    assert_eq!(first.verdict().troubled, 1);
    let again = bench.run();
    assert_eq!(again.started(), BTreeMap::from([("b.csv".to_owned(), vec![Why::EarlierTrouble])]));
    assert!(again.verdict().nothing_changed);
    let reason = format!("{:?}", bench.record().flights[1].outcome);
    assert!(reason.contains("the disk does not answer"), "{reason}");
}

#[cfg(unix)]
#[test]
fn an_unreadable_log_is_a_row_with_its_reason() {
    let bench = Bench::five();
    std::os::unix::fs::symlink("nowhere", bench.flights().join("z.csv")).unwrap();
    let ran = bench.run();
    assert_eq!(ran.verdict().exit(), Exit::Incomplete);
    let record = bench.record();
    let row = record.flights.last().unwrap();
    assert!(row.flight == "z.csv" && format!("{:?}", row.outcome).contains("z.csv: "), "{row:?}");
    assert!(bench.out().join(&row.page).exists());
}

#[test]
fn flights_with_the_same_content_share_a_result_but_not_pages() {
    let bench = Bench::five();
    fs::create_dir(bench.flights().join("day2")).unwrap();
    let twin = bench.flights().join("twin.csv");
    fs::write(&twin, table("x")).unwrap();
    let ran = bench.run();
    assert_eq!(ran.started().len(), 6);
    // File names count: the same bytes under another name are another result.
    fs::copy(bench.flights().join("a.csv"), &twin).unwrap();
    std::thread::sleep(Duration::from_millis(60));
    let again = bench.run();
    assert_eq!(again.started().keys().collect::<Vec<_>>(), ["twin.csv"]);
}

#[test]
fn a_lost_or_damaged_result_is_made_again() {
    let bench = Bench::five();
    bench.run();
    let tree = bench.tree(&bench.out());
    let key = |name: &str| bench.record().flights.iter().find(|r| r.flight == name).unwrap().key.clone();
    let file = |name: &str, base: &str| {
        let key = key(name);
        bench.out().join(format!("by-key/{}/{key}/{base}", &key[..2]))
    };
    let (lost, cut, garbled) =
        (file("a.csv", "track.parquet"), file("b.csv", "record.json.gz"), file("c.csv", "record.json.gz"));
    fs::remove_file(lost).unwrap();
    fs::write(cut, "{").unwrap();
    let mut bytes = fs::read(&garbled).unwrap();
    bytes[20] ^= 1;
    fs::write(garbled, bytes).unwrap();
    // The same size and no state: only reading it shows the change.
    fs::remove_file(bench.out().join(".flightlag/state.json")).unwrap();
    let again = bench.run();
    assert_eq!(again.verdict().exit(), Exit::Well);
    assert_eq!(bench.tree(&bench.out()), tree);
}

#[test]
fn a_lost_page_is_made_again_without_reading_a_log() {
    let bench = Bench::five();
    bench.run();
    let tree = bench.tree(&bench.out());
    fs::remove_file(bench.out().join("flights/b.csv/index.html")).unwrap();
    fs::write(bench.out().join("flights.csv"), "").unwrap();
    let again = bench.run();
    assert!(again.started().is_empty() && !again.verdict().nothing_changed);
    assert_eq!(bench.tree(&bench.out()), tree);
}

#[test]
fn a_removed_flight_disappears_from_the_table_with_its_page() {
    let bench = Bench::five();
    bench.run();
    fs::remove_file(bench.flights().join("c.csv")).unwrap();
    fs::write(bench.out().join("flights/c.csv/notes.txt"), "my notes").unwrap();
    bench.run();
    assert_eq!(bench.record().flights.len(), 4);
    assert!(!bench.out().join("flights/c.csv/index.html").exists());
    assert!(bench.out().join("flights/c.csv/notes.txt").exists(), "what we did not write stays");
}

#[test]
fn a_stopped_run_continues_and_ends_with_the_same_bytes() {
    let whole = Bench::five();
    whole.run();
    let mut bench = Bench::five();
    bench.stop_at = Some("a.csv");
    let stopped = bench.run_into(&bench.out(), 1, false);
    assert_eq!(stopped.verdict.as_ref().unwrap_err().exit(), Exit::Stopped);
    assert!(!bench.out().join("index.html").exists());
    bench.stop_at = None;
    let resumed = bench.run();
    let again = resumed.started_to(Stage::Measure);
    assert!((1..5).contains(&again.len()), "flights that are measured are not measured again: {again:?}");
    assert_eq!(bench.tree(&bench.out()), whole.tree(&whole.out()));
}

#[test]
fn a_page_of_an_aborted_reduction_is_not_taken_for_the_old_one() {
    let bench = Bench::five();
    bench.run();
    let tree = bench.tree(&bench.out());
    bench.log("c.csv", "Three");
    bench.run();
    let newer = fs::read(bench.out().join("flights/c.csv/index.html")).unwrap();
    bench.log("c.csv", "three");
    bench.run();
    assert_eq!(
        bench.tree(&bench.out()).get(Path::new("flights/c.csv/index.html")),
        tree.get(Path::new("flights/c.csv/index.html"))
    );
    // As if a reduction had been killed after it removed its entries and wrote one newer page.
    bench.edit_state(|claims| {
        claims["pages"].as_object_mut().unwrap().remove("c.csv");
        claims["whole"] = serde_json::Value::Null;
    });
    fs::write(bench.out().join("flights/c.csv/index.html"), newer).unwrap();
    bench.run();
    let now = bench.tree(&bench.out());
    for (path, bytes) in &tree {
        assert_eq!(now.get(path), Some(bytes), "{}", path.display());
    }
}

#[test]
fn a_foreign_output_folder_or_one_with_the_flights_is_left_untouched() {
    let bench = Bench::five();
    let foreign = bench.folder.path().join("home");
    fs::create_dir(&foreign).unwrap();
    fs::write(foreign.join("index.html"), "my page").unwrap();
    let into = |out: &Path| bench.run_into(out, 1, false).verdict.unwrap_err();
    assert_eq!(into(&foreign).exit(), Exit::Wrong);
    assert_eq!(fs::read_dir(&foreign).unwrap().count(), 1);
    assert_eq!(into(&bench.flights().join("report")).exit(), Exit::Wrong);
    assert_eq!(into(&bench.flights()).exit(), Exit::Wrong);
}

#[test]
fn a_run_killed_at_its_very_start_can_be_restarted() {
    let bench = Bench::five();
    fs::create_dir(bench.out()).unwrap();
    fs::write(bench.out().join(".probe.gone-host.7.0-1.flightlag-tmp"), "").unwrap();
    assert_eq!(bench.run().verdict().exit(), Exit::Well);
}

#[test]
fn a_log_with_a_future_timestamp_is_read_and_not_remembered_wrongly() {
    let bench = Bench::five();
    let ahead = SystemTime::now() + Duration::from_secs(3600);
    let file = fs::File::options().write(true).open(bench.flights().join("a.csv")).unwrap();
    file.set_modified(ahead).unwrap();
    bench.run();
    let again = bench.run();
    assert_eq!(again.hashed_files(), 1, "its time proves nothing, so that it is hashed");
    assert!(again.verdict().nothing_changed);
}
