//! Campaigns through the command: reuse, interruption, bad flights.

use crate::program::{assert_same, flightlag, log_of_topics, results, run, text, tree};
use record::{CampaignRecord, FlightRecord, Outcome};
use std::fs;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

/// A folder with a campaign of short simulated flights.
struct Campaign {
    folder: tempfile::TempDir,
}

impl Campaign {
    fn of(flights: usize) -> Campaign {
        let campaign = Campaign { folder: tempfile::tempdir().unwrap() };
        // These logs have no IMU: they show the difference between position and velocity, not how late both are.
        let known = "schema = 1\n[delay]\nposition_s = 0.4\nsource = \"simulated\"\n";
        fs::write(campaign.folder.path().join("known.toml"), known).unwrap();
        simulate::write_campaign(&campaign.flights(), flights, 20.0, 7).unwrap();
        // Modification times this recent prove nothing yet.
        std::thread::sleep(Duration::from_millis(80));
        campaign
    }

    fn flights(&self) -> PathBuf {
        self.folder.path().join("flights")
    }

    fn out(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn arguments(&self, out: &str, more: &[&str]) -> Vec<String> {
        let path = |p: PathBuf| p.to_str().unwrap().to_owned();
        let mut all = vec!["campaign".to_owned(), path(self.flights()), "--out".to_owned(), path(self.out(out))];
        all.extend(more.iter().map(|&m| m.to_owned()));
        if !more.contains(&"--pipeline") {
            all.extend(["--pipeline".to_owned(), path(self.folder.path().join("known.toml"))]);
        }
        all
    }

    fn run(&self, out: &str, more: &[&str], exit: i32) -> Vec<serde_json::Value> {
        let mut arguments = self.arguments(out, more);
        arguments.push("--json".to_owned());
        let output = run(arguments, exit);
        text(&output.stdout).lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    }

    fn record(&self, out: &str) -> CampaignRecord {
        campaign::read_report(&self.out(out)).unwrap().unwrap()
    }
}

fn started(events: &[serde_json::Value]) -> Vec<String> {
    let started = events.iter().filter(|e| e["event"] == "started");
    let names: std::collections::BTreeSet<&str> = started.map(|e| e["flight"].as_str().unwrap()).collect();
    names.into_iter().map(str::to_owned).collect()
}

/// A small random generator, so that every run of the test kills at the same moments.
fn next(state: &mut u64) -> u64 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    *state >> 33
}

fn flight_record(page: &Path) -> FlightRecord {
    serde_json::from_slice(&campaign::record_of_page(page).unwrap().unwrap()).unwrap()
}

#[test]
fn a_simulated_delay_is_removed_and_files_are_in_the_expected_places() {
    let campaign = Campaign::of(2);
    campaign.run("report", &[], 0);
    let record = campaign.record("report");
    assert_eq!(record.totals.compensated, 2);
    for row in &record.flights {
        let page = campaign.out("report").join(&row.page);
        let folder = page.parent().unwrap();
        let flight: FlightRecord = flight_record(&page);
        assert_eq!((flight.outcome, flight.key), (Outcome::Compensated, row.key.clone()));
        let html = fs::read_to_string(&page).unwrap();
        assert!(html.contains("As a check: the delay of position.gps against position.truth is "), "{}", row.flight);
        let track = folder.join(html.split('"').find(|part| part.ends_with("/track.parquet")).unwrap());
        assert_eq!(fs::read(track).unwrap().get(..4), Some(b"PAR1".as_slice()));
        let (raw, exact) = (row.raw_error_rms_m.unwrap().value, row.exact_error_rms_m.unwrap().value);
        // At 15 to 20 m/s, 0.4 s are 6 to 8 m; the receiver's own noise of 0.3 m remains.
        assert!((5.0..9.0).contains(&raw) && exact < 1.0, "raw {raw} m, compensated {exact} m");
    }
}

#[test]
fn records_are_small_and_figure_points_are_stored_once() {
    let campaign = Campaign::of(1);
    campaign.run("report", &[], 0);
    let out = campaign.out("report");
    let files = results(&out);
    for once in ["points.bin", "track.parquet"] {
        assert_eq!(files.keys().filter(|path| path.ends_with(once)).count(), 1, "{once}");
    }
    let page = out.join(&campaign.record("report").flights[0].page);
    let bytes = campaign::record_of_page(&page).unwrap().unwrap();
    assert!(bytes.len() <= 64_000, "{} bytes", bytes.len());
    let record = flight_record(&page);
    assert!(record.replay.unwrap().axes.iter().all(|axis| axis.position_m.iter().all(|c| c.t_s.is_empty())));
    // The figures still have all their points: of the raw position both ends of each step, north and east.
    let mut figures = zip::ZipArchive::new(fs::File::open(page.with_file_name("figures.zip")).unwrap()).unwrap();
    let mut curves = String::new();
    figures.by_name("fig-7.csv").unwrap().read_to_string(&mut curves).unwrap();
    let of_raw = curves.lines().filter(|line| line.contains("\"raw, newest fix held\"")).count();
    assert!(of_raw >= 2 * 2 * 5 * 19, "{of_raw} points: {curves:.200}");
}

/// Hundreds of topics would inflate a record to a megabyte.
#[test]
fn a_long_record_moves_its_lists_to_a_details_file() {
    let campaign = Campaign::of(0);
    fs::create_dir_all(campaign.flights()).unwrap();
    log_of_topics(&campaign.flights().join("many.mcap"), 2_000);
    campaign.run("report", &[], 3);
    let out = campaign.out("report");
    let page = out.join(&campaign.record("report").flights[0].page);
    let mut json = vec![];
    let packed = fs::read(page.with_file_name("record.json.gz")).unwrap();
    flate2::read::GzDecoder::new(packed.as_slice()).read_to_end(&mut json).unwrap();
    assert!(json.len() <= 64_000, "{} bytes", json.len());
    let short: FlightRecord = serde_json::from_slice(&json).unwrap();
    assert_eq!((short.details.as_slice(), short.log.unwrap().topics.len()), (["/log/topics".to_owned()].as_slice(), 0));
    let whole = flight_record(&page);
    assert_eq!((whole.log.unwrap().topics.len(), whole.details), (2_000, vec![]));
    assert!(fs::read_to_string(&page).unwrap().contains(r#"href="details.json.gz""#));
    // A file that is changed is restored as it was.
    let before = results(&out);
    for (name, bytes) in before.iter().filter(|(name, _)| name.ends_with("details.json.gz")) {
        fs::write(out.join(name), &bytes[1..]).unwrap();
        campaign.run("report", &[], 3);
        assert_same(&results(&out), &before);
    }
}

#[test]
fn results_of_a_flight_take_at_most_300_kb_or_the_log_size() {
    for duration_s in [20.0, 60.0] {
        let campaign = Campaign::of(0);
        simulate::write_campaign(&campaign.flights(), 2, duration_s, 7).unwrap();
        campaign.run("report", &[], 0);
        assert_eq!(campaign.record("report").totals.compensated, 2);
        let files = results(&campaign.out("report"));
        let of_flights = files.iter().filter(|(path, _)| path.starts_with("flights") || path.starts_with("by-key"));
        let bytes: usize = of_flights.map(|(_, bytes)| bytes.len()).sum();
        let logs: u64 = campaign.record("report").flights.iter().map(|row| row.bytes.max(300_000)).sum();
        assert!(bytes as u64 <= logs, "{duration_s} s: {bytes} bytes of results, {logs} allowed");
    }
}

#[test]
fn the_record_of_a_campaign_does_not_grow_with_its_flights() {
    let size = |flights| {
        let campaign = Campaign::of(flights);
        campaign.run("report", &[], 0);
        fs::read(campaign.out("report").join("campaign.json")).unwrap().len()
    };
    // Allows for a name among the members of its group, and a digit of a count.
    assert!(size(4) - size(2) < 200);
}

#[test]
fn an_unchanged_rerun_reads_no_log_and_changes_no_byte() {
    let campaign = Campaign::of(3);
    campaign.run("report", &[], 0);
    let before = results(&campaign.out("report"));
    let events = campaign.run("report", &[], 0);
    assert!(started(&events).is_empty());
    assert!(events.iter().any(|e| e["event"] == "nothing-changed"));
    assert!(events.iter().all(|e| e["event"] != "hashing" && e["event"] != "read"));
    assert_same(&results(&campaign.out("report")), &before);
}

#[test]
fn only_the_changed_log_is_read_again() {
    let campaign = Campaign::of(3);
    campaign.run("report", &[], 0);
    fs::copy(campaign.flights().join("flight-0003.mcap"), campaign.flights().join("flight-0002.mcap")).unwrap();
    let events = campaign.run("report", &[], 0);
    assert_eq!(started(&events), ["flight-0002.mcap"]);
    let why = events.iter().find(|e| e["event"] == "started").unwrap()["why"].to_string();
    assert!(why.contains("log-changed"), "{why}");
}

#[test]
fn a_changed_setting_rereads_all_logs_and_is_reported() {
    let campaign = Campaign::of(2);
    let pipeline = campaign.folder.path().join("p.toml");
    let write =
        |delay: &str| fs::write(&pipeline, format!("schema = 1\n[delay]\nposition_s = {delay}\nsource = \"s\"\n"));
    let option = ["--pipeline", pipeline.to_str().unwrap()];
    write("0.4").unwrap();
    campaign.run("report", &option, 0);
    write("0.3").unwrap();
    let events = campaign.run("report", &option, 0);
    assert_eq!(started(&events).len(), 2);
    let why = events.iter().find(|e| e["event"] == "started").unwrap()["why"].to_string();
    assert!(why.contains("delay.position_s: was 0.4, is 0.3"), "{why}");
}

#[test]
fn threads_locale_and_time_zone_change_no_byte() {
    let campaign = Campaign::of(4);
    run(campaign.arguments("one", &["--threads", "1"]), 0);
    let mut other = flightlag(campaign.arguments("two", &["--threads", "2"]));
    other
        .env("TZ", "Asia/Kathmandu")
        .env("LANG", "de_DE.UTF-8")
        .env("LC_ALL", "de_DE.UTF-8")
        .env("RUST_BACKTRACE", "1");
    assert!(other.output().unwrap().status.success());
    assert_same(&results(&campaign.out("one")), &results(&campaign.out("two")));
}

#[test]
fn a_run_killed_at_any_moment_gives_the_same_bytes_after_a_restart() {
    let campaign = Campaign::of(5);
    run(campaign.arguments("whole", &[]), 0);
    let whole = results(&campaign.out("whole"));
    let mut seed = 20_261_121;
    for round in 0..6 {
        let out = format!("killed-{round}");
        for _ in 0..3 {
            let mut child = flightlag(campaign.arguments(&out, &["--quiet"])).spawn().unwrap();
            std::thread::sleep(Duration::from_millis(next(&mut seed) % 400));
            child.kill().unwrap();
            child.wait().unwrap();
            assert_outputs_are_whole(&campaign.out(&out));
        }
        run(campaign.arguments(&out, &[]), 0);
        assert_same(&results(&campaign.out(&out)), &whole);
    }
}

/// A file under its final name is complete at any moment.
fn assert_outputs_are_whole(out: &Path) {
    if !out.exists() {
        return;
    }
    for (path, bytes) in tree(out) {
        let name = path.file_name().unwrap().to_str().unwrap();
        match path.extension().and_then(|e| e.to_str()) {
            Some("json") => drop(serde_json::from_slice::<serde_json::Value>(&bytes).unwrap()),
            Some("parquet") => assert!(bytes.ends_with(b"PAR1"), "{}", path.display()),
            Some("html") => assert!(text(&bytes).trim_end().ends_with("</html>"), "{}", path.display()),
            _ => assert!(name == "lock" || !bytes.is_empty() || name.ends_with("flightlag-tmp"), "{}", path.display()),
        }
    }
}

#[test]
fn failed_flights_are_rows_with_a_reason_and_the_others_get_pages() {
    let campaign = Campaign::of(3);
    let cut = campaign.flights().join("flight-0002.mcap");
    let bytes = fs::read(&cut).unwrap();
    fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    fs::write(campaign.flights().join("shopping.csv"), "item,count\nbread,2\nbutter,1\n").unwrap();
    fs::write(campaign.flights().join("README.md"), "# notes\n").unwrap();
    campaign.run("report", &[], 3);
    let record = campaign.record("report");
    let row = |name: &str| record.flights.iter().find(|r| r.flight == name).unwrap();
    assert!(row("flight-0002.mcap").lossy);
    assert!(matches!(&row("shopping.csv").outcome, Outcome::Failed { reason } if !reason.is_empty()));
    assert!(["flight-0001.mcap", "flight-0003.mcap"].map(row).iter().all(|r| r.outcome == Outcome::Compensated));
    assert!(record.ignored.iter().any(|i| i.path == "README.md" && !i.reason.is_empty()));
    for row in &record.flights {
        assert!(campaign.out("report").join(&row.page).exists(), "{}", row.page);
    }
}

#[test]
fn cluster_steps_give_the_same_bytes_as_a_single_run() {
    let campaign = Campaign::of(5);
    run(campaign.arguments("run", &[]), 0);
    let out = campaign.out("steps");
    let plan = || {
        let mut plan = campaign.arguments("steps", &["--max-shards", "2"]);
        plan.insert(1, "plan".to_owned());
        text(&run(plan, 0).stdout)
    };
    let printed = plan();
    assert!(printed.starts_with("flights=5 stage=measure stale=5 shards=2"), "{printed}");
    let manifest = std::cell::RefCell::new(manifest_of(&printed));
    let plan = || {
        let printed = plan();
        manifest.replace(manifest_of(&printed));
        printed
    };
    let step = |step: &str, more: &[&str], exit| {
        let manifest = manifest.borrow().clone();
        let mut all = vec!["campaign", step, "--manifest", &manifest];
        all.extend(more);
        text(&run(all, exit).stdout)
    };
    assert!(step("status", &[], 3).starts_with("0 of 5 flights are measured"));
    step("task", &["--shard", "0"], 0);
    assert!(step("status", &[], 3).contains(" of 5 flights are measured"));
    assert!(plan().contains("stage=measure"), "every flight is measured before anything is removed");
    step("task", &["--shard", "0"], 0);
    step("task", &["--shard", "1"], 0);
    let printed = plan();
    assert!(printed.starts_with("flights=5 stage=replay stale=5 shards=2"), "{printed}");
    step("task", &["--shard", "0"], 0);
    step("reduce", &[], 3);
    step("task", &["--shard", "1"], 0);
    assert!(step("task", &["--shard", "1"], 0).starts_with("made=0"), "a shard may run twice");
    step("task", &["--shard", "2"], 2);
    assert!(step("status", &[], 0).starts_with("5 of 5 flights have a result"));
    step("reduce", &[], 0);
    assert!(plan().contains("stage=done stale=0 shards=0"));
    assert_same(&results(&out), &results(&campaign.out("run")));
}

/// The manifest named in the output of `plan`.
fn manifest_of(printed: &str) -> String {
    printed.trim().rsplit_once(" manifest=").unwrap().1.to_owned()
}

/// A substitute for Slurm: a submitted job runs at once, one task after another.
const SBATCH: &str = r#"#!/bin/bash
set -u
array= name= output=/dev/null
while [ $# -gt 0 ]; do
    case $1 in
    --array=*) array=${1#--array=} ;;
    --job-name=*) name=${1#--job-name=} ;;
    --output=*) output=${1#--output=} ;;
    --*) ;;
    *) break ;;
    esac
    shift
done
id=$(( $(cat "$SLURM_STUB/last" 2>/dev/null || echo 0) + 1 ))
echo "$id" > "$SLURM_STUB/last"
echo "$id $name ${array:-none}" >> "$SLURM_STUB/jobs"
run() {
    local tries=0
    while :; do
        rm -f "$SLURM_STUB/requeued"
        SLURM_RESTART_COUNT=$tries SLURM_JOB_ID=$id SLURM_ARRAY_JOB_ID=$id SLURM_ARRAY_TASK_ID=${2:-} \
            bash "${@:3}" >> "$SLURM_STUB/log" 2>&1 &
        echo $! > "$SLURM_STUB/script"
        wait $!
        echo "$1 ended with $?" >> "$SLURM_STUB/ended"
        [ -e "$SLURM_STUB/requeued" ] || break
        tries=$((tries + 1))
    done
}
if [ -n "$array" ]; then
    for task in $(seq 0 "${array#0-}"); do run "${id}_$task" "$task" "$@"; done
else
    run "$id" "" "$@"
fi
echo "$id"
"#;
const SCONTROL: &str = r#"#!/bin/bash
case $1 in
requeue) touch "$SLURM_STUB/requeued" ;;
show) echo "MaxArraySize            = 4" ;;
esac
"#;

/// Runs `pipelines/slurm/campaign.sh` with the substitute; returns its folder.
fn on_slurm(campaign: &Campaign, out: &str, environment: &[(&str, &str)]) -> PathBuf {
    let stub = campaign.out(&format!("stub-{out}"));
    fs::create_dir(&stub).unwrap();
    for (name, text) in [("sbatch", SBATCH), ("scontrol", SCONTROL)] {
        fs::write(stub.join(name), text).unwrap();
        let made = Command::new("chmod").arg("+x").arg(stub.join(name)).status().unwrap();
        assert!(made.success());
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../pipelines/slurm/campaign.sh");
    let path = format!("{}:{}", stub.display(), std::env::var("PATH").unwrap());
    let mut command = Command::new("bash");
    command.arg(script).args([campaign.flights(), campaign.out(out)]);
    command.arg("--pipeline").arg(campaign.folder.path().join("known.toml"));
    command.env("PATH", path).env("SLURM_STUB", &stub).env("FLIGHTLAG", flightlag([""]).get_program());
    let output = command.env("RETRY_WAIT", "0").envs(environment.iter().copied()).output().unwrap();
    assert!(
        output.status.success(),
        "{}{}",
        text(&output.stderr),
        text(&fs::read(stub.join("log")).unwrap_or_default())
    );
    stub
}

#[test]
fn the_slurm_scripts_give_the_same_bytes_as_one_machine() {
    let campaign = Campaign::of(5);
    run(campaign.arguments("run", &[]), 0);
    let stub = on_slurm(&campaign, "slurm", &[]);
    let read = |name: &str| fs::read_to_string(stub.join(name)).unwrap();
    // At most as many tasks as the site allows, in each of two stages, then the reduction.
    let jobs = "1 flightlag-step none
2 flightlag 0-2
3 flightlag-step none
4 flightlag 0-2
5 flightlag-step none
";
    assert_eq!(read("jobs"), jobs, "{}", read("log"));
    assert_same(&results(&campaign.out("slurm")), &results(&campaign.out("run")));
    assert!(read("ended").lines().all(|line| line.ends_with(" 0")), "{}", read("ended"));
}

#[test]
fn a_slurm_task_that_ends_with_75_is_requeued_at_most_three_times() {
    let campaign = Campaign::of(1);
    // A program whose tasks never see the output folder.
    let away = campaign.out("away.sh");
    let program = flightlag([""]).get_program().to_string_lossy().into_owned();
    fs::write(&away, format!("#!/bin/bash\n[ \"$2\" = task ] && exit 75\nexec {program} \"$@\"\n")).unwrap();
    assert!(Command::new("chmod").arg("+x").arg(&away).status().unwrap().success());
    let stub = on_slurm(&campaign, "slurm", &[("FLIGHTLAG", away.to_str().unwrap()), ("MAX_ROUNDS", "1")]);
    let ended = fs::read_to_string(stub.join("ended")).unwrap();
    assert_eq!(ended.matches("2_0 ended with 75").count(), 4, "{ended}");
    // The report names the flight without a result; the job itself succeeded.
    let record = campaign.record("slurm");
    assert_eq!(record.totals.pending, 1);
}

#[test]
fn a_slurm_step_terminated_while_planning_is_requeued() {
    let campaign = Campaign::of(1);
    let termed = campaign.out("termed.sh");
    let program = flightlag([""]).get_program().to_string_lossy().into_owned();
    let text = format!(
        r#"#!/bin/bash
if [ "$2" = plan ] && mkdir "$SLURM_STUB/once" 2> /dev/null; then
    trap 'exit 75' TERM
    until [ -s "$SLURM_STUB/script" ]; do sleep 0.1; done
    kill -TERM "$(cat "$SLURM_STUB/script")"
    sleep 60 & wait
fi
exec {program} "$@"
"#
    );
    fs::write(&termed, text).unwrap();
    assert!(Command::new("chmod").arg("+x").arg(&termed).status().unwrap().success());
    let stub = on_slurm(&campaign, "slurm", &[("FLIGHTLAG", termed.to_str().unwrap())]);
    let ended = fs::read_to_string(stub.join("ended")).unwrap();
    assert!(ended.starts_with("1 ended with 75\n") && ended.contains("\n1 ended with 0\n"), "{ended}");
    assert_eq!(campaign.record("slurm").totals.compensated, 1);
}

#[test]
fn a_second_run_on_one_report_is_refused_naming_the_owner() {
    let campaign = Campaign::of(1);
    run(campaign.arguments("report", &[]), 0);
    let before = results(&campaign.out("report"));
    let path = campaign.out("report").join(".flightlag/lock");
    let owner = fs::read_to_string(&path).unwrap();
    let lock = fs::File::options().write(true).open(&path).unwrap();
    lock.try_lock().unwrap();
    let refusal = text(&run(campaign.arguments("report", &["--verify"]), 75).stderr);
    let owner: serde_json::Value = serde_json::from_str(owner.trim()).unwrap();
    assert!(refusal.contains(owner["owner"].as_str().unwrap()) && refusal.contains("process "), "{refusal}");
    assert_same(&results(&campaign.out("report")), &before);
    drop(lock);
    run(campaign.arguments("report", &[]), 0);
}

#[test]
fn an_unwritable_output_fails_with_its_path_and_leaves_no_partial_file() {
    let campaign = Campaign::of(3);
    run(campaign.arguments("whole", &[]), 0);
    let program = flightlag([""]).get_program().to_owned();
    // No file may exceed some kilobytes: not even the measurements fit.
    let limited = Command::new("sh")
        .args(["-c", "ulimit -f 8; exec \"$0\" \"$@\""])
        .arg(program)
        .args(campaign.arguments("full", &["--quiet"]))
        .output()
        .unwrap();
    let printed = text(&limited.stderr);
    assert_eq!(limited.status.code(), Some(1), "a retry does not help: {printed}");
    assert!(printed.contains("measured.json") && printed.contains("too large"), "{printed}");
    assert_outputs_are_whole(&campaign.out("full"));
    run(campaign.arguments("full", &[]), 0);
    assert_same(&results(&campaign.out("full")), &results(&campaign.out("whole")));
}

#[test]
fn a_signal_ends_with_its_code_and_the_next_run_cleans_up_and_resumes() {
    let campaign = Campaign::of(12);
    for (signal, code) in [("INT", 130), ("TERM", 75), ("HUP", 75)] {
        let mut child = flightlag(campaign.arguments(signal, &["--threads", "1", "--json"]))
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut events = std::io::BufRead::lines(std::io::BufReader::new(child.stdout.take().unwrap()));
        events.find(|line| line.as_ref().is_ok_and(|l| l.contains("\"finished\""))).unwrap().unwrap();
        let sent = Command::new("kill").args(["-s", signal, &child.id().to_string()]).status().unwrap();
        assert!(sent.success());
        events.for_each(drop);
        assert_eq!(child.wait().unwrap().code(), Some(code), "{signal}");
        let events = campaign.run(signal, &[], 0);
        assert!((1..12).contains(&started(&events).len()), "finished flights are kept: {:?}", started(&events));
        let left = tree(&campaign.out(signal)).into_keys().find(|p| p.to_string_lossy().contains("flightlag-tmp"));
        assert_eq!(left, None);
    }
}

/// `flightlag` as an unprivileged user; `None` where that cannot be tried.
#[cfg(unix)]
fn as_nobody(campaign: &Campaign) -> Option<Command> {
    use std::os::unix::fs::PermissionsExt;
    fs::set_permissions(campaign.folder.path(), fs::Permissions::from_mode(0o755)).unwrap();
    let mut command = Command::new("setpriv");
    command.args(["--reuid=65534", "--regid=65534", "--clear-groups"]).arg(flightlag([""]).get_program());
    let mut tried = Command::new(command.get_program());
    let is_possible = tried.args(command.get_args()).arg("--version").output().is_ok_and(|o| o.status.success());
    if !is_possible {
        let _ = writeln!(std::io::stderr(), "skipped: the program cannot be run as another user here");
    }
    is_possible.then_some(command)
}

#[cfg(unix)]
#[test]
#[cfg(target_os = "linux")]
fn permission_errors_are_reported_before_any_work_and_on_their_row() {
    use std::os::unix::fs::PermissionsExt;
    let campaign = Campaign::of(3);
    let Some(mut refused) = as_nobody(&campaign) else { return };
    // The parent folder belongs to another user.
    let output = refused.args(campaign.arguments("theirs", &["--json"])).output().unwrap();
    let printed = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{printed}");
    assert!(printed.contains("theirs") && printed.contains("Permission denied"), "{printed}");
    assert!(!text(&output.stdout).contains("\"started\"") && !campaign.out("theirs").exists());
    // A log that the user may not read is a row with its reason.
    fs::create_dir(campaign.out("mine")).unwrap();
    fs::set_permissions(campaign.out("mine"), fs::Permissions::from_mode(0o777)).unwrap();
    let theirs = campaign.flights().join("flight-0002.mcap");
    fs::set_permissions(&theirs, fs::Permissions::from_mode(0o600)).unwrap();
    let output = as_nobody(&campaign).unwrap().args(campaign.arguments("mine", &["--quiet"])).output().unwrap();
    assert_eq!(output.status.code(), Some(3), "{}", text(&output.stderr));
    let record = campaign.record("mine");
    let reasons: Vec<_> = record.flights.iter().map(|row| (row.flight.as_str(), &row.outcome)).collect();
    assert!(
        reasons.iter().all(|(flight, outcome)| match outcome {
            Outcome::Failed { reason } => *flight == "flight-0002.mcap" && reason.contains("Permission denied"),
            outcome => **outcome == Outcome::Compensated && *flight != "flight-0002.mcap",
        }),
        "{reasons:?}"
    );
}

#[test]
#[cfg(target_os = "linux")]
#[ignore = "limits of the system, a minute: just faults-outputs"]
fn limits_of_the_system_change_no_byte() {
    let campaign = Campaign::of(5);
    run(campaign.arguments("whole", &[]), 0);
    let whole = results(&campaign.out("whole"));
    let program = flightlag([""]).get_program().to_string_lossy().into_owned();
    let limits = [
        "ulimit -n 12; exec \"$0\" \"$@\"",
        "ulimit -v 1000000; exec \"$0\" \"$@\"",
        "exec taskset 1 \"$0\" \"$@\"",
        "exec env -i \"$0\" \"$@\"",
        "TMPDIR=/nonexistent exec \"$0\" \"$@\"",
        "exec \"$0\" \"$@\" <&- >&- 2>&-",
        "LC_ALL=tr_TR.UTF-8 TZ=Asia/Kathmandu exec \"$0\" \"$@\"",
        "cd \"$(mktemp -d)\" && rmdir \"$PWD\" && exec \"$0\" \"$@\"",
    ];
    for (n, limit) in limits.iter().enumerate() {
        let out = format!("limit-{n}");
        let mut command = Command::new("sh");
        command.args(["-c", limit, &program]).args(campaign.arguments(&out, &["--quiet"]));
        let output = command.output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{limit}: {}", text(&output.stderr));
        assert_same(&results(&campaign.out(&out)), &whole);
    }
}
