//! The steps of a cluster, and failures between them.

use super::*;
use crate::reduce::reduce;
use crate::store::Store;
use crate::task::TaskReport;

/// A cluster of one node.
struct Cluster<'a> {
    bench: &'a Bench,
    cancel: AtomicBool,
}

impl Cluster<'_> {
    fn of(bench: &Bench) -> Cluster<'_> {
        Cluster { bench, cancel: AtomicBool::new(false) }
    }

    fn context(&self) -> RunContext<'_> {
        RunContext { threads: 1, cancel: &self.cancel, events: &|_: &Event| {} }
    }

    fn plan(&self, shards: u32) -> Manifest {
        plan_shards(&self.bench.order(&self.bench.out(), false), &self.context(), shards).unwrap()
    }

    fn task(&self, manifest: &Manifest, shard: u32) -> TaskReport {
        let store = Store::open(&self.bench.out()).unwrap();
        make(&manifest.of_shard(shard), manifest, &Scripted { stop_at: None }, &store, &self.context()).unwrap()
    }

    /// Runs all tasks of both stages.
    fn work(&self) -> Manifest {
        loop {
            let manifest = self.plan(1);
            if manifest.stage().is_none() {
                return manifest;
            }
            assert_eq!(self.task(&manifest, 0).exit(), Exit::Well);
        }
    }
}

#[test]
fn a_task_without_its_output_folder_mounted_ends_with_75_without_work() {
    let bench = group();
    let cluster = Cluster::of(&bench);
    let manifest = cluster.plan(2);
    let kept = manifest.keep().unwrap();
    let (out, away) = (bench.out(), bench.folder.path().join("away"));
    fs::rename(&out, &away).unwrap();
    let refused = |what: Result<(), CampaignError>| {
        let error = what.unwrap_err();
        assert_eq!(error.exit(), Exit::TryAgain, "{error}");
        assert!(error.to_string().contains("not be mounted"), "{error}");
    };
    refused(crate::task(&manifest, 0, &cluster.context()).map(drop));
    refused(reduce(&manifest, &cluster.context()).map(drop));
    refused(status(&manifest).map(drop));
    // The plan is in that folder.
    refused(Manifest::read(&kept).map(drop));
    assert!(!out.exists(), "nothing is made where nothing is mounted");
    // The mount point exists and is empty.
    fs::create_dir(&out).unwrap();
    refused(crate::task(&manifest, 0, &cluster.context()).map(drop));
    refused(Manifest::read(&kept).map(drop));
    assert_eq!(fs::read_dir(&out).unwrap().count(), 0);
    fs::remove_dir(&out).unwrap();
    fs::rename(&away, &out).unwrap();
    assert!(status(&Manifest::read(&kept).unwrap()).is_ok());
    // A wrong name is a permanent error.
    assert_ne!(Manifest::read(&kept.with_extension("jsn")).unwrap_err().exit(), Exit::TryAgain);
}

#[test]
fn a_node_with_its_own_copy_of_the_logs_makes_results() {
    let bench = group();
    let cluster = Cluster::of(&bench);
    let manifest = cluster.plan(1);
    let (flights, copies) = (bench.flights(), bench.folder.path().join("copies"));
    fs::create_dir(&copies).unwrap();
    for entry in fs::read_dir(&flights).unwrap().map(Result::unwrap) {
        fs::copy(entry.path(), copies.join(entry.file_name())).unwrap();
    }
    fs::remove_dir_all(&flights).unwrap();
    fs::rename(&copies, &flights).unwrap();
    let report = cluster.task(&manifest, 0);
    assert_eq!((report.made, report.exit()), (7, Exit::Well), "{report:?}");
}

#[test]
fn a_log_changed_since_the_plan_is_not_retried_until_the_next_plan() {
    let bench = group();
    let cluster = Cluster::of(&bench);
    let manifest = cluster.plan(1);
    bench.log("b.csv", "late 0.2013");
    let report = cluster.task(&manifest, 0);
    assert_eq!((report.made, report.lasting.len(), report.exit()), (6, 1, Exit::Incomplete), "{report:?}");
    assert!(report.lasting[0].1.contains("has changed since it was planned"), "{report:?}");
    let verdict = reduce(&cluster.work(), &cluster.context()).unwrap();
    assert_eq!((verdict.totals.compensated, verdict.exit()), (7, Exit::Well));
}

#[test]
fn a_temporary_error_ends_with_75_and_a_defect_does_not() {
    let bench = Bench::new(&[("a.csv", "busy")]);
    let cluster = Cluster::of(&bench);
    assert_eq!(cluster.task(&cluster.plan(1), 0).exit(), Exit::TryAgain);
    bench.log("a.csv", "panic");
    assert_eq!(cluster.task(&cluster.plan(1), 0).exit(), Exit::Incomplete);
    fs::remove_file(bench.flights().join("a.csv")).unwrap();
    let full = std::io::Error::from(std::io::ErrorKind::StorageFull);
    let failed = |source| crate::StoreError { path: "x".into(), doing: "write", source };
    assert_eq!(CampaignError::from(failed(full)).exit(), Exit::TryAgain);
    let wrapped = std::io::Error::other(std::io::Error::other(std::io::Error::from(std::io::ErrorKind::StorageFull)));
    assert_eq!(CampaignError::from(failed(wrapped)).exit(), Exit::TryAgain);
    let large = std::io::Error::from(std::io::ErrorKind::FileTooLarge);
    assert_eq!(CampaignError::from(failed(large)).exit(), Exit::Failed);
}

#[test]
fn a_later_plan_keeps_the_manifest_of_an_earlier_one() {
    let bench = group();
    let cluster = Cluster::of(&bench);
    let first = cluster.plan(3);
    let kept = first.keep().unwrap();
    bench.log("h.csv", "late 0.2004");
    let second = cluster.plan(1);
    let other = second.keep().unwrap();
    assert_ne!(kept, other);
    assert_eq!(Manifest::read(&kept).unwrap(), first);
    assert_eq!(second.keep().unwrap(), other, "the same plan has the same name");
    // A task of the first plan still does its assigned flights.
    let report = cluster.task(&Manifest::read(&kept).unwrap(), 2);
    assert_eq!(report.exit(), Exit::Well);
}

#[test]
fn a_damaged_result_that_no_plan_needs_does_not_stop_a_reduction() {
    let bench = group();
    let cluster = Cluster::of(&bench);
    let first = cluster.work();
    reduce(&first, &cluster.context()).unwrap();
    let key = first.flights[1].key.clone().unwrap();
    fs::write(bench.out().join(format!("by-key/{}/{key}/track.parquet", &key[..2])), "short").unwrap();
    assert_eq!(reduce(&first, &cluster.context()).unwrap_err().exit(), Exit::Failed, "it is needed: plan again");
    fs::remove_file(bench.flights().join("b.csv")).unwrap();
    let verdict = reduce(&cluster.work(), &cluster.context()).unwrap();
    assert_eq!((verdict.totals.flights, verdict.exit()), (6, Exit::Well));
}

#[test]
fn gc_keeps_what_a_recent_plan_names() {
    let bench = group();
    let cluster = Cluster::of(&bench);
    reduce(&cluster.work(), &cluster.context()).unwrap();
    bench.log("b.csv", "late 0.25");
    let manifest = cluster.plan(1);
    manifest.keep().unwrap();
    cluster.task(&manifest, 0);
    let gc = || crate::gc(&bench.out(), false, &cluster.context()).unwrap();
    let before = gc();
    assert_eq!(before.results, 0, "the measurement that was just made is of a plan");
    fs::remove_dir_all(bench.out().join(".flightlag/plans")).unwrap();
    assert_eq!(gc().results, 1);
}

#[test]
fn a_reduction_records_when_and_where_it_was_made() {
    let bench = group();
    let cluster = Cluster::of(&bench);
    reduce(&cluster.work(), &cluster.context()).unwrap();
    let run: serde_json::Value = serde_json::from_slice(&fs::read(bench.out().join("run.json")).unwrap()).unwrap();
    assert_eq!((&run["flights"], &run["nothing_changed"]), (&7.into(), &false.into()));
    assert!(run["host"].is_string() && run["started"].is_string() && run.get("results_made").is_none(), "{run}");
}
