//! A reliable store: external changes are detected, and nothing else is made again.

use super::*;
use crate::file_stamp::FileStamp;
use crate::store::{Check, Store};

impl Bench {
    /// Path of a file of a flight's result or measurement.
    fn stored(&self, flight: &str, base: &str) -> PathBuf {
        let record = self.record();
        let row = record.flights.iter().find(|row| row.flight == flight).unwrap();
        let measured = ["measured.json.gz", "lateness.json"].contains(&base);
        let key = if measured { row.lateness.as_ref().unwrap().key.clone() } else { row.key.clone() };
        self.out().join(format!("by-key/{}/{key}/{base}", &key[..2]))
    }

    /// As if the file system had kept all timestamps of this file, as with a flipped bit on the disk.
    fn forget_change(&self, path: &Path) {
        let stamp = serde_json::to_value(FileStamp::of(path).unwrap()).unwrap();
        let name = path.strip_prefix(self.out()).unwrap().to_str().unwrap().to_owned();
        self.edit_state(|state| {
            let mut places: Vec<&mut serde_json::Value> = vec![];
            let state = state.as_object_mut().unwrap();
            for (field, value) in state {
                match field.as_str() {
                    "results" => places.extend(value.as_object_mut().unwrap().values_mut()),
                    "pages" => places.extend(value.as_object_mut().unwrap().values_mut().map(|p| &mut p["files"])),
                    "whole" => places.push(&mut value["files"]),
                    _ => {}
                }
            }
            let file = places.into_iter().find_map(|files| files.get_mut(&name)).unwrap();
            file[0] = stamp;
        });
    }
}

/// Changes a byte in the middle of a file without changing its size.
fn flip(path: &Path) {
    let mut bytes = fs::read(path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(path, bytes).unwrap();
}

/// One file of each kind that a run keeps.
fn one_of_each_kind(bench: &Bench) -> Vec<PathBuf> {
    let stored = ["record.json.gz", "track.parquet", "measured.json.gz", "lateness.json", "files.json"];
    let placed = ["flights/b.csv/index.html", "flights/b.csv/record.json.gz"];
    let whole = ["flights.csv", "flights.parquet", "flights.jsonl.gz", "index.html", "campaign.json"];
    let of_results = stored.map(|base| bench.stored("b.csv", base));
    of_results.into_iter().chain(placed.iter().chain(&whole).map(|name| bench.out().join(name))).collect()
}

#[test]
fn a_change_of_the_same_size_is_detected_in_every_kind_of_file() {
    let bench = Bench::five();
    bench.run();
    let tree = bench.tree(&bench.out());
    for path in one_of_each_kind(&bench) {
        flip(&path);
        let again = bench.run();
        assert!(!again.verdict().nothing_changed, "{}", path.display());
        assert_eq!(bench.tree(&bench.out()), tree, "{}", path.display());
        assert!(bench.run().verdict().nothing_changed, "{}", path.display());
    }
}

#[test]
fn verify_detects_a_change_without_a_new_timestamp() {
    let bench = Bench::five();
    bench.run();
    let tree = bench.tree(&bench.out());
    for path in one_of_each_kind(&bench) {
        flip(&path);
        bench.forget_change(&path);
        let again = bench.run_into(&bench.out(), 2, true);
        assert!(!again.verdict().nothing_changed, "{}", path.display());
        assert_eq!(bench.tree(&bench.out()), tree, "{}", path.display());
    }
}

#[test]
fn files_read_for_a_page_are_compared_with_their_hashes() {
    let bench = Bench::five();
    bench.run();
    let tree = bench.tree(&bench.out());
    for base in ["record.json.gz", "track.parquet"] {
        let path = bench.stored("b.csv", base);
        flip(&path);
        bench.forget_change(&path);
        assert!(bench.run().verdict().nothing_changed, "a quick look cannot see it");
        // A new neighbour: the page is made again, which reads the result.
        bench.log("b0.csv", "three");
        let again = bench.run();
        assert!(again.started_to(Stage::Replay).contains_key("b.csv"), "{base}: {:?}", again.started());
        fs::remove_file(bench.flights().join("b0.csv")).unwrap();
        bench.run();
        let results = |tree: BTreeMap<PathBuf, Vec<u8>>| {
            let of_flights = |path: &PathBuf| path.starts_with("flights");
            tree.into_iter().filter(|(path, _)| of_flights(path)).collect::<Vec<_>>()
        };
        assert_eq!(results(bench.tree(&bench.out())), results(tree.clone()), "{base}");
    }
}

#[test]
fn the_remark_names_the_files_that_changed() {
    let bench = Bench::five();
    bench.run();
    fs::remove_file(bench.out().join("flights/b.csv/index.html")).unwrap();
    let remarks = |ran: &Ran| {
        let text = |e: &Event| if let Event::Remark { text } = e { Some(text.clone()) } else { None };
        ran.events.iter().filter_map(text).collect::<Vec<_>>().join("; ")
    };
    let text = remarks(&bench.run());
    assert!(text.contains("flights/b.csv/index.html") && !text.contains("more"), "{text}");
}

#[test]
fn a_result_of_another_record_version_is_made_again() {
    let bench = Bench::five();
    bench.run();
    let list = bench.stored("b.csv", "files.json");
    let text = fs::read_to_string(&list).unwrap();
    let version = format!("\"record_version\":{}", record::RECORD_VERSION);
    assert!(text.contains(&version), "{text}");
    fs::write(&list, text.replace(&version, "\"record_version\":0")).unwrap();
    fs::remove_file(bench.out().join(".flightlag/state.json")).unwrap();
    let again = bench.run();
    assert_eq!(again.started().keys().collect::<Vec<_>>(), ["b.csv"]);
}

#[test]
fn counts_for_the_exit_code_come_from_the_checked_record() {
    let bench = Bench::five();
    bench.log("x.csv", "bad");
    bench.run();
    let path = bench.out().join("campaign.json");
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, text.replacen("\"failed\": 1", "\"failed\": 0", 1)).unwrap();
    bench.forget_change(&path);
    let again = bench.run();
    assert_eq!((again.verdict().totals.failed, again.verdict().exit()), (1, Exit::Incomplete));
    // A changed state of the last run is rejected too.
    let notes = bench.out().join(".flightlag/state.json");
    flip(&notes);
    assert_eq!(bench.run().verdict().exit(), Exit::Incomplete);
    assert!(fs::read_to_string(&path).unwrap().contains("\"failed\": 1"));
}

#[cfg(unix)]
#[test]
fn the_track_is_stored_once_and_the_page_links_to_it() {
    use std::os::unix::fs::MetadataExt;
    let bench = Bench::five();
    bench.run();
    let (track, page) = (bench.stored("b.csv", "track.parquet"), bench.out().join("flights/b.csv/index.html"));
    let html = fs::read_to_string(&page).unwrap();
    let link = html.split('"').find(|part| part.ends_with("/track.parquet")).unwrap();
    assert_eq!(page.parent().unwrap().join(link).canonicalize().unwrap(), track.canonicalize().unwrap());
    // A copy that an earlier flightlag left next to the page is removed with that page.
    let copy = page.with_file_name("track.parquet");
    assert!(!copy.exists());
    fs::write(&copy, "left by an earlier version").unwrap();
    flip(&page);
    bench.run();
    assert!(!copy.exists());
    // Editing the record next to the page does not change the result.
    let (record, placed) = (bench.stored("b.csv", "record.json.gz"), page.with_file_name("record.json.gz"));
    assert_eq!([&record, &placed].map(|path| fs::metadata(path).unwrap().nlink()), [1, 1]);
    let (result, whole) = (fs::read(&record).unwrap(), fs::read(&placed).unwrap());
    fs::write(&placed, "edited in place").unwrap();
    assert_eq!(fs::read(&record).unwrap(), result);
    let again = bench.run();
    assert!(again.started().is_empty() && fs::read(&placed).unwrap() == whole);
}

#[test]
fn another_title_or_limit_rewrites_pages_without_analysis() {
    let mut bench = Bench::five();
    bench.run();
    bench.pipeline = format!("title = \"Spring campaign\"\n{}", bench.pipeline);
    let again = bench.run();
    assert!(again.started().is_empty() && !again.verdict().nothing_changed, "{:?}", again.started());
    for page in ["index.html", "flights/b.csv/index.html"] {
        assert!(fs::read_to_string(bench.out().join(page)).unwrap().contains("Spring campaign"), "{page}");
    }
    let record = crate::record_of_page(&bench.out().join("flights/b.csv/index.html")).unwrap().unwrap();
    assert!(String::from_utf8(record).unwrap().contains("Spring campaign"));
    assert!(bench.run().verdict().nothing_changed);
}

#[test]
fn a_stopped_reduction_continues_with_the_remaining_pages() {
    let bench = Bench::five();
    bench.run();
    let tree = bench.tree(&bench.out());
    // As after a stopped run: three pages are in the state, without their rows.
    bench.edit_state(|state| {
        state["whole"] = serde_json::Value::Null;
        state["record_blake3"] = "".into();
        let pages = state["pages"].as_object_mut().unwrap();
        pages.retain(|slug, _| ["a.csv", "b.csv", "c.csv"].contains(&slug.as_str()));
        pages.values_mut().for_each(|page| page["has_row"] = false.into());
    });
    let again = bench.run();
    let made = again.events.iter().find_map(|e| if let Event::Reduced { pages, .. } = e { Some(*pages) } else { None });
    assert_eq!(made, Some(2));
    assert_eq!(bench.tree(&bench.out()), tree);
}

#[test]
fn the_pages_of_a_stopped_first_reduction_are_reused() {
    use crate::state::{PageState, State};
    let bench = Bench::five();
    let store = Store::open(&bench.out()).unwrap();
    let mut state = State::recall(&store);
    let page = PageState { made_from: "this".to_owned(), files: BTreeMap::new(), has_row: false };
    state.pages.insert("a.csv".to_owned(), page.clone());
    state.save(&store).unwrap();
    assert_eq!(State::recall(&store).pages.get("a.csv"), Some(&page));
}

#[test]
fn a_truncated_track_between_task_and_reduce_is_not_a_result() {
    let bench = group();
    let (store, cancel) = (Store::open(&bench.out()).unwrap(), AtomicBool::new(false));
    let sink = |_: &Event| {};
    let context = RunContext { threads: 1, cancel: &cancel, events: &sink };
    let order = bench.order(&bench.out(), false);
    let work = || loop {
        let manifest = plan_shards(&order, &context, 2).unwrap();
        if manifest.stage().is_none() {
            break manifest;
        }
        for shard in 0..manifest.shards() {
            make(&manifest.of_shard(shard), &manifest, &Scripted { stop_at: None }, &store, &context).unwrap();
        }
    };
    for damage in [halve as fn(&Path), flip] {
        let manifest = work();
        let key = manifest.flights[2].key.clone().unwrap();
        damage(&bench.out().join(format!("by-key/{}/{key}/track.parquet", &key[..2])));
        let mut reduced = crate::reduce::reduce(&manifest, &context);
        if let Ok(verdict) = &reduced {
            // Its size alone shows that it is truncated: the flight has no result yet.
            assert_eq!(verdict.totals.pending, 1);
        } else {
            assert!(reduced.as_ref().unwrap_err().to_string().contains("plan again"), "{reduced:?}");
        }
        reduced = crate::reduce::reduce(&work(), &context);
        assert_eq!(reduced.unwrap().totals.compensated, 7);
        assert!(crate::results::is_there(&store, &key, Check::Full));
        fs::remove_dir_all(bench.out().join("flights")).unwrap();
        fs::remove_file(bench.out().join(".flightlag/state.json")).unwrap();
    }
}

fn halve(path: &Path) {
    let bytes = fs::read(path).unwrap();
    fs::write(path, &bytes[..bytes.len() / 2]).unwrap();
}

#[test]
fn gc_removes_only_results_that_no_report_refers_to() {
    let mut bench = Bench::five();
    bench.run();
    bench.pipeline = bench.pipeline.replace("0.4", "0.35");
    bench.run();
    let tree = bench.tree(&bench.out());
    let cancel = AtomicBool::new(false);
    let context = RunContext { threads: 1, cancel: &cancel, events: &|_: &Event| {} };
    let gc = |dry_run| crate::gc(&bench.out(), dry_run, &context).unwrap();
    // A count needs no lock, and does not wait for one.
    let held = crate::lock::OutputLock::take(&crate::store::Store::open(&bench.out()).unwrap(), &context).unwrap();
    let would = gc(true);
    drop(held);
    assert_eq!((would.results, would.kept), (5, 10), "{would:?}");
    assert_eq!(bench.tree(&bench.out()), tree);
    assert_eq!(gc(false), would);
    let left = bench.tree(&bench.out());
    assert!(left.len() < tree.len() && left.iter().all(|(path, bytes)| tree.get(path) == Some(bytes)));
    assert_eq!(gc(false).results, 0);
    assert!(bench.run().verdict().nothing_changed);
    assert_eq!(bench.tree(&bench.out()), left);
}

#[test]
fn gc_rejects_a_folder_with_a_changed_report() {
    let bench = Bench::five();
    bench.run();
    let cancel = AtomicBool::new(false);
    let context = RunContext { threads: 1, cancel: &cancel, events: &|_: &Event| {} };
    assert_eq!(crate::gc(&bench.flights(), false, &context).unwrap_err().exit(), Exit::Wrong);
    flip(&bench.out().join("campaign.json"));
    let refusal = crate::gc(&bench.out(), false, &context).unwrap_err().to_string();
    assert!(refusal.contains("campaign.json"), "{refusal}");
}
