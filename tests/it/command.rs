//! The command as used by people and shells.

use crate::program::{flightlag, run, text};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Stdio;

#[test]
fn an_invalid_command_or_pipeline_ends_with_2_and_its_position() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    fs::create_dir(folder.path().join("flights")).unwrap();
    fs::write(folder.path().join("p.toml"), "schema = 1\n\n[delay]\nposition = 0.4\nsource = \"s\"\n").unwrap();
    let (flights, out) = (path("flights"), path("out"));
    run(["frobnicate"], 2);
    run(["campaign"], 2);
    run(["campaign", "--out", &out], 2);
    run(["campaign", &path("nowhere"), "--out", &out], 2);
    run(["campaign", &flights, "--out", &out, "--map", "no-such-map"], 2);
    let wrong = text(&run(["campaign", &flights, "--out", &out, "--pipeline", &path("p.toml")], 2).stderr);
    assert!(wrong.contains("p.toml:4: unknown key `position`") && wrong.contains("`position_s`"), "{wrong}");
    let wrong = text(&run(["delay", &flights, "--reference-clock", "own"], 2).stderr);
    assert!(wrong.contains("--reference-clock needs --reference FILE"), "{wrong}");
    let empty = text(&run(["campaign", &flights, "--out", &out], 1).stderr);
    assert!(empty.contains("no flight found"), "{empty}");
    assert!(!Path::new(&out).exists(), "a failed run leaves no empty folder");
}

#[test]
fn folders_of_the_same_name_share_a_report_only_on_request() {
    let folder = tempfile::tempdir().unwrap();
    for month in ["may", "june"] {
        simulate::write_campaign(&folder.path().join(month).join("data"), 1, 20.0, 1).unwrap();
    }
    let campaign = |arguments: &[&str]| {
        flightlag([&["campaign", "--quiet"], arguments].concat()).current_dir(folder.path()).output().unwrap()
    };
    assert_eq!(campaign(&["may/data"]).status.code(), Some(0));
    let refused = campaign(&["june/data"]);
    assert_eq!(refused.status.code(), Some(2));
    let error = text(&refused.stderr);
    assert!(error.contains("may/data, not of ") && error.contains("--replace"), "{error}");
    assert_eq!(campaign(&["may/data"]).status.code(), Some(0));
    assert_eq!(campaign(&["june/data", "--replace"]).status.code(), Some(0));
    assert_eq!(campaign(&["may/data"]).status.code(), Some(2));
}

#[test]
fn seconds_that_look_like_milliseconds_are_rejected_with_the_unit() {
    let error_of = |arguments: &[&str]| text(&run(arguments, 2).stderr);
    let delay = error_of(&["compensator", "pade-1-1", "--delay-s", "400", "--step-s", "0.01"]);
    assert!(delay.contains("must be above 0 and at most 30 s; 400 ms are 0.4 s"), "{delay}");
    let step = error_of(&["delay", "logs", "--c", "out", "--step-s", "10"]);
    assert!(step.contains("must be from 0.00001 to 1 s; 10 ms are 0.01 s"), "{step}");
    let early = error_of(&["compensator", "pade-1-1", "--delay-s", "-0.2", "--step-s", "0.01"]);
    assert!(early.contains("must be above 0 and at most 30 s"), "{early}");
    let unknown =
        error_of(&["compensator", "pade-1-1", "--delay-s", "0.2", "--uncertainty-s", "8", "--step-s", "0.01"]);
    assert!(unknown.contains("--uncertainty-s 8: larger than the delay of 0.2 s"), "{unknown}");
    let slip = error_of(&["compensator", "exact-asinc", "--delay-s", "0.4", "--step-s", "0.01"]);
    assert!(slip.contains("no compensator is called \"exact-asinc\"; did you mean \"exact-async\"?"), "{slip}");
    // A negative number is parsed as a number.
    for (arguments, range) in [
        (vec!["delay", "x", "--threads", "-1"], "-1 is not in 1..=1024"),
        (vec!["demo", "x", "--seed", "-1"], "invalid digit"),
        (vec!["campaign", "plan", "x", "--max-shards", "-3"], "-3 is not in 1"),
        (vec!["export", "x", "--track", "--rate", "-5"], "--rate -5: must be from 0 to"),
    ] {
        let refused = error_of(&arguments);
        assert!(refused.contains(range) && !refused.contains("unexpected argument"), "{refused}");
    }
    let impossible = error_of(&["compensator", "pade-3-2", "--delay-s", "0.4", "--step-s", "0.01"]);
    assert!(impossible.contains("\"pade-3-2\": [3/2] is not proper"), "{impossible}");
}

#[test]
fn a_slow_loop_promises_nothing_above_half_its_rate() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let arguments = ["compensator", "pade-1-1-tustin", "--delay-s", "0.2", "--step-s", "1", "--out", out];
    let printed = text(&run(arguments, 0).stdout);
    let words: Vec<&str> = printed.split_whitespace().collect();
    let frequencies: Vec<f64> =
        words.windows(2).filter(|pair| pair[1].starts_with("Hz")).map(|pair| pair[0].parse().unwrap()).collect();
    assert!(frequencies.len() >= 2 && frequencies.iter().all(|hz| *hz <= 0.5), "{printed}");
    assert!(printed.starts_with("wrote "), "{printed}");
    assert!(text(&run(arguments, 0).stdout).starts_with("replaced "), "an existing file is not replaced silently");
}

#[test]
fn the_default_report_is_named_after_the_flights() {
    let folder = tempfile::tempdir().unwrap();
    simulate::write_campaign(&folder.path().join("may"), 1, 20.0, 1).unwrap();
    let ended = flightlag(["campaign", "may", "--quiet"]).current_dir(folder.path()).status().unwrap();
    assert_eq!(ended.code(), Some(0));
    assert!(folder.path().join("reports/may/index.html").is_file());
    // One page links to all reports; it is recreated if missing, even though nothing changed.
    let all = folder.path().join("reports/index.html");
    let page = fs::read_to_string(&all).unwrap();
    assert!(page.contains("href=\"may/index.html\""), "{page}");
    assert!(page.contains("ms later than velocity.gps"), "{page}");
    fs::remove_file(&all).unwrap();
    flightlag(["campaign", "may", "--quiet"]).current_dir(folder.path()).status().unwrap();
    assert_eq!(fs::read_to_string(&all).unwrap(), page);
}

#[test]
fn a_misspelt_channel_is_rejected_with_the_five_nearest() {
    let folder = tempfile::tempdir().unwrap();
    let (flights, pipeline) = (folder.path().join("flights"), folder.path().join("p.toml"));
    std::fs::create_dir(&flights).unwrap();
    std::fs::write(flights.join("a.csv"), "x,y\n1,2\n").unwrap();
    let text = "schema = 1\n[delay]\nposition_s = 0.4\nsource = \"x\"\n[channels]\nvelocity = [\"velocity.efk\"]\n";
    std::fs::write(&pipeline, text).unwrap();
    let out = folder.path().join("out");
    let arguments = [
        "campaign".as_ref(),
        flights.as_os_str(),
        "--out".as_ref(),
        out.as_os_str(),
        "--pipeline".as_ref(),
        pipeline.as_os_str(),
    ];
    let error = crate::program::text(&run(arguments, 2).stderr);
    let near = error.trim_end().rsplit_once("the nearest are ").unwrap().1;
    assert!(error.contains("velocity.efk") && near.starts_with("velocity.ekf, "), "{error}");
    assert_eq!(near.split(", ").count(), 5, "{error}");
}

#[test]
fn a_refused_output_folder_is_not_touched() {
    let folder = tempfile::tempdir().unwrap();
    let inside = folder.path().join("report");
    run(["campaign".as_ref(), folder.path().as_os_str(), "--out".as_ref(), inside.as_os_str()], 2);
    assert!(!inside.exists());
}

#[test]
fn an_error_is_printed_once_with_control_characters_escaped() {
    let wrong = text(&run(["inspect", "no\u{1b}[31mlog"], 2).stderr);
    assert_eq!(wrong.lines().count(), 1, "{wrong}");
    assert!(wrong.starts_with("flightlag: no\\u{1b}[31mlog: "), "{wrong}");
}

#[test]
fn a_closed_output_pipe_is_not_a_failure() {
    let folder = tempfile::tempdir().unwrap();
    simulate::write_campaign(folder.path(), 1, 10.0, 3).unwrap();
    let log = folder.path().join("flight-0001.mcap");
    let mut child =
        flightlag(["inspect".as_ref(), log.as_os_str()]).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!((output.status.code(), text(&output.stderr)), (Some(0), String::new()));
}

#[test]
fn a_full_disk_at_standard_output_is_a_failure() {
    let Ok(full) = fs::File::options().write(true).open("/dev/full") else {
        println!("skipped: no /dev/full here");
        return;
    };
    let output = flightlag(["maps"]).stdout(full).stderr(Stdio::piped()).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains("standard output"), "{}", text(&output.stderr));
}

#[test]
fn inspect_shows_the_content_of_a_log_and_the_matching_map() {
    let folder = tempfile::tempdir().unwrap();
    simulate::write_campaign(folder.path(), 1, 20.0, 3).unwrap();
    let log = folder.path().join("flight-0001.mcap").to_str().unwrap().to_owned();
    let page = text(&run(["inspect", &log], 0).stdout);
    for word in ["flight-0001.mcap", "MCAP", "channel map", "position.", "velocity.", "timestamps"] {
        assert!(page.contains(word), "{word} is not in:\n{page}");
    }
    let json: serde_json::Value = serde_json::from_slice(&run(["inspect", &log, "--json"], 0).stdout).unwrap();
    let bytes = &json["health"]["bytes"];
    let sum: u64 =
        ["decoded", "skipped", "structure", "damaged", "tail_cut"].iter().map(|k| bytes[k].as_u64().unwrap()).sum();
    assert_eq!(sum, fs::metadata(&log).unwrap().len());
    let channels = json["binding"]["channels"].as_array().unwrap();
    let position = channels.iter().find(|c| c["name"] == "position.gps").unwrap();
    // 5 Hz for 20 s: the first at zero, and possibly one at the very end.
    assert!((100..=101).contains(&position["used"].as_u64().unwrap()), "{position}");
}

#[test]
fn inspect_ends_with_3_for_a_truncated_log() {
    let folder = tempfile::tempdir().unwrap();
    simulate::write_campaign(folder.path(), 1, 20.0, 3).unwrap();
    let log = folder.path().join("flight-0001.mcap");
    let bytes = fs::read(&log).unwrap();
    fs::write(&log, &bytes[..bytes.len() * 6 / 10]).unwrap();
    let page = text(&run(["inspect".as_ref(), log.as_os_str()], 3).stdout);
    assert!(page.contains("damage") || page.contains("loss"), "{page}");
}

#[test]
fn the_demo_runs_and_names_the_page_to_open() {
    let folder = crate::shared::demo();
    let demo = folder.join("demo");
    let printed = std::fs::read_to_string(folder.join("printed.txt")).unwrap();
    let page = demo.join("report/index.html");
    assert!(printed.contains(&format!("open {}", page.display())), "{printed}");
    assert!(page.exists());
    // The page named in the README links to the card of each sensor.
    let index = std::fs::read_to_string(demo.join("bench-report/index.html")).unwrap();
    for card in ["sim-0001/index.html", "sim-0002/index.html"] {
        assert!(index.contains(&format!("href=\"{card}\"")) && demo.join("bench-report").join(card).exists(), "{card}");
    }
}

#[test]
fn the_example_channel_map_is_printed() {
    let text = text(&run(["maps", "--example"], 0).stdout);
    assert!(text.contains("#:schema") && text.contains("[[channel]]") && text.contains("height_above = "), "{text}");
}

#[test]
fn the_shipped_maps_are_listed() {
    let maps = text(&run(["maps"], 0).stdout);
    assert!(maps.contains("mavros") && maps.contains("flysight"), "{maps}");
}

#[test]
fn a_map_is_suggested_for_a_custom_table_and_refused_for_a_non_table() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("own.csv");
    // Circles of 60 m in 25 s near the equator, where a degree is 111 km.
    let row = |i: i32| {
        let (t, w) = (0.1 * f64::from(i), 0.25);
        let [north, east] = [60.0 * (w * t).sin(), -60.0 * (w * t).cos()];
        let (lat, lon) = (0.5 + (north / 6_335_700.0_f64).to_degrees(), 9.0 + (east / 6_378_000.0_f64).to_degrees());
        format!("{t:.1},{lat:.9},{lon:.9},{:.4},{:.4}\n", 54.0 * (w * t).cos(), 54.0 * (w * t).sin())
    };
    std::fs::write(&path, format!("time,lat,lon,vn,ve\n{}", (0..600).map(row).collect::<String>())).unwrap();
    let path = path.to_str().unwrap();
    let map = text(&run(["maps", "--suggest", path], 0).stdout);
    assert!(map.contains("north = { field = \"vn\", unit = \"km/h\" }"), "{map}");
    let page = text(&run(["inspect", path], 0).stdout);
    assert!(page.contains("columns bound by guess") && page.contains("maps --suggest LOG"), "{page}");
    let answer = text(&run(["delay", path], 0).stdout);
    assert!(answer.contains("alarm") && answer.contains("columns bound by guess"), "{answer}");
    let other = folder.path().join("other.csv");
    std::fs::write(&other, "a,b\n1,2\n3,4\n5,6\n").unwrap();
    let error = text(&run(["maps", "--suggest", other.to_str().unwrap()], 1).stderr);
    assert!(error.contains("no columns are named like"), "{error}");
}

#[test]
fn a_compensator_is_written_as_c_and_an_unstable_one_rejected() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let of = |name: &'static str, delay: &'static str| {
        ["compensator", name, "--delay-s", delay, "--step-s", "0.01", "--out", out].map(str::to_owned)
    };
    let written = run(of("pade-2-2-foh", "0.4"), 0);
    let source = std::fs::read_to_string(folder.path().join("position_delay.c")).unwrap();
    let header = std::fs::read_to_string(folder.path().join("position_delay.h")).unwrap();
    assert!(source.contains("Td     0.400000 s") && header.contains("position_delay_step"), "{source}");
    assert!(text(&written.stdout).contains("No parameter of an autopilot takes 400 ms"));
    let short = run(of("pade-2-2-foh", "0.2"), 0);
    assert!(text(&short.stdout).contains("Do not compensate twice"));
    assert!(text(&run(of("pade-0-5-foh", "0.4"), 2).stderr).contains("unstable"));
    assert!(text(&run(of("pade-1-1-tustin", "-0.1"), 2).stderr).contains("must be above 0"));
}

/// Runs a campaign of one simulated flight, 5 Hz and 0.4 s late, judged by these criteria.
struct Judging {
    folder: tempfile::TempDir,
}

impl Judging {
    fn new() -> Judging {
        let folder = tempfile::tempdir().unwrap();
        simulate::write_campaign(&folder.path().join("flights"), 1, 60.0, 1).unwrap();
        let known = "schema = 1\n[delay]\nposition_s = 0.4\nsource = \"simulated\"\n";
        fs::write(folder.path().join("known.toml"), known).unwrap();
        Judging { folder }
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().to_owned()
    }

    /// Limits of the rate and of the longest gap.
    fn criteria(&self, rate: &str, gap: &str) -> String {
        let criterion = |id: &str, metric: &str, limit: &str| {
            format!("[[criterion]]\nid = \"{id}\"\ntitle = \"t\"\nmetric = \"{metric}\"\n{limit}\nrationale = \"r\"\n")
        };
        let rate = criterion("rate", "position-rate", &format!("at_least = \"{rate}\""));
        let gap = criterion("gap", "longest-position-gap", &format!("at_most = \"{gap}\""));
        let file = self.path("c.toml");
        fs::write(&file, format!("schema = 1\n{rate}{gap}")).unwrap();
        file
    }

    fn run(&self, added: &[&str], exit: i32) -> String {
        let (flights, out) = (self.path("flights"), self.path("out"));
        let known = self.path("known.toml");
        let mut all = vec!["campaign", &flights, "--out", &out];
        if !added.contains(&"--pipeline") {
            all.extend(["--pipeline", &known]);
        }
        all.extend(added);
        let ran = run(all, exit);
        text(&ran.stdout) + &text(&ran.stderr)
    }

    fn page(&self) -> String {
        fs::read_to_string(self.folder.path().join("out/flights/flight-0001.mcap/index.html")).unwrap()
    }

    fn record(&self) -> serde_json::Value {
        let page = self.folder.path().join("out/flights/flight-0001.mcap/index.html");
        serde_json::from_slice(&campaign::record_of_page(&page).unwrap().unwrap()).unwrap()
    }
}

#[test]
fn a_failed_criterion_ends_with_4_and_a_new_limit_reads_no_log() {
    let campaign = Judging::new();
    let missed = campaign.criteria("10 Hz", "2 s");
    let printed = campaign.run(&["--criteria", &missed], 4);
    assert!(printed.contains("criteria, flights by worst verdict: 1 FAIL"), "{printed}");
    assert!(printed.contains("FAIL rate (position-rate ≥ 10 Hz): flight-0001.mcap"), "{printed}");
    assert!(campaign.page().contains("≥ 10\u{a0}Hz"));
    let finding = &campaign.record()["criteria"]["findings"][0];
    assert_eq!((&finding["verdict"], &finding["limit"]), (&"fail".into(), &serde_json::json!({ "at-least": 10.0 })));
    let again = campaign.run(&["--criteria", &missed], 4);
    assert!(again.contains("nothing changed") && again.contains("1 FAIL"), "{again}");

    let met = campaign.criteria("4 Hz", "2 s");
    let printed = campaign.run(&["--criteria", &met], 0);
    assert!(printed.contains("0 flights to replay") && printed.contains("1 page made"), "{printed}");
    assert!(printed.contains("worst verdict: 1 PASS") && !printed.contains("FAIL"), "{printed}");
    assert!(!campaign.page().contains("≥ 10\u{a0}Hz"));
    let judged: serde_json::Value =
        serde_json::from_slice(&fs::read(campaign.folder.path().join("out/campaign.json")).unwrap()).unwrap();
    assert_eq!(judged["criteria"]["flights"]["pass"], 1);

    campaign.run(&[], 0);
    assert!(!campaign.page().contains("criterion") && campaign.record().get("criteria").is_none());
}

#[test]
fn a_failed_criterion_outweighs_a_damaged_log() {
    let campaign = Judging::new();
    let log = campaign.folder.path().join("flights/flight-0001.mcap");
    let bytes = fs::read(&log).unwrap();
    fs::write(&log, &bytes[..bytes.len() * 7 / 10]).unwrap();
    campaign.run(&["--criteria", &campaign.criteria("4 Hz", "2 s")], 3);
    campaign.run(&["--criteria", &campaign.criteria("10 Hz", "2 s")], 4);
}

#[test]
fn criteria_in_the_pipeline_are_overridden_by_the_command() {
    let campaign = Judging::new();
    campaign.criteria("10 Hz", "2 s");
    let text = "schema = 1\n[delay]\nposition_s = 0.4\nsource = \"s\"\n[criteria]\nfile = \"c.toml\"\n";
    let pipeline = campaign.path("p.toml");
    fs::write(&pipeline, text).unwrap();
    campaign.run(&["--pipeline", &pipeline], 4);
    let other = campaign.path("other.toml");
    fs::write(&other, fs::read_to_string(campaign.path("c.toml")).unwrap().replace("10 Hz", "4 Hz")).unwrap();
    campaign.run(&["--pipeline", &pipeline, "--criteria", &other], 0);
    fs::write(&other, "schema = 1\n[[criterion]]\nid = \"a\"\n").unwrap();
    let wrong = campaign.run(&["--criteria", &other], 2);
    assert!(wrong.contains("other.toml:2: missing key `title`"), "{wrong}");
    fs::write(campaign.path("c.toml"), "schema = 2\n").unwrap();
    let wrong = campaign.run(&["--pipeline", &pipeline], 2);
    assert!(wrong.contains("p.toml:6: criteria.file: ") && wrong.contains("c.toml:1: schema must be 1"), "{wrong}");
}

#[test]
fn a_cluster_uses_the_criteria_of_the_plan() {
    let campaign = Judging::new();
    let (flights, out) = (campaign.path("flights"), campaign.path("out"));
    let criteria = campaign.criteria("10 Hz", "2 s");
    let known = campaign.path("known.toml");
    let mut manifest = String::new();
    for stage in ["measure", "replay"] {
        manifest = campaign.path(&format!("{stage}.json"));
        let planned = ["--criteria", &criteria, "--pipeline", &known, "--manifest", &manifest];
        run([["campaign", "plan", &flights, "--out", &out].as_slice(), &planned].concat(), 0);
        run(["campaign", "task", "--manifest", &manifest, "--shard", "0"], 0);
    }
    fs::remove_file(&criteria).unwrap();
    run(["campaign", "reduce", "--manifest", &manifest], 4);
}

#[test]
fn available_criteria_are_listed_and_a_file_is_checked() {
    let listed = text(&run(["criteria"], 0).stdout);
    assert!(listed.contains("error-rms") && listed.contains("needs compensator"), "{listed}");
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("mine.toml");
    fs::write(&file, run(["criteria", "--example"], 0).stdout).unwrap();
    let meant = text(&run(["criteria".as_ref(), file.as_os_str()], 0).stdout);
    assert!(
        meant.starts_with("# mine.toml is valid; criteria: ") && meant.contains("metric = \"lateness\""),
        "{meant}"
    );
}

/// The log of a campaign of one flight in this folder.
fn one_flight(folder: &Path) -> PathBuf {
    simulate::write_campaign(folder, 1, 20.0, 1).unwrap();
    fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).find(|p| p.extension().is_some()).unwrap()
}

/// The same flight given by two paths is not necessarily adjacent in the sorted order.
#[test]
fn a_flight_given_by_two_paths_is_measured_once() {
    let folder = tempfile::tempdir().unwrap();
    simulate::write_campaign(folder.path(), 2, 20.0, 1).unwrap();
    let log =
        fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().path()).find(|p| p.extension().is_some()).unwrap();
    let paths = [log.as_os_str(), folder.path().as_os_str()];
    let answer = text(&run([&["delay".as_ref(), "--json".as_ref()], paths.as_slice()].concat(), 0).stdout);
    let report: serde_json::Value = serde_json::from_str(&answer).unwrap();
    assert_eq!(report["flights"].as_array().unwrap().len(), 2, "{answer}");
}

/// Former bug: the log was missing from the answer, and the command ended with 0.
#[cfg(unix)]
#[test]
fn a_log_that_cannot_be_opened_is_a_failed_flight_of_delay() {
    let folder = tempfile::tempdir().unwrap();
    one_flight(folder.path());
    std::os::unix::fs::symlink("nowhere", folder.path().join("z.csv")).unwrap();
    let answer = text(&run(["delay".as_ref(), "--json".as_ref(), folder.path().as_os_str()], 3).stdout);
    let report: serde_json::Value = serde_json::from_str(&answer).unwrap();
    let lost = &report["flights"][1];
    assert_eq!((lost["flight"].as_str(), lost["data"].as_str()), (Some("z.csv"), Some("failed")), "{answer}");
    assert!(lost["words"].as_str().is_some_and(|words| words.contains("cannot be read")), "{lost}");
}

#[test]
fn a_truncated_log_is_recovered_and_the_command_ends_with_3() {
    let folder = tempfile::tempdir().unwrap();
    let log = one_flight(folder.path());
    let (whole, out) = (folder.path().join("whole.mcap"), folder.path().join("cut.mcap"));
    let recover = |from: &std::path::Path, to: &std::path::Path, exit| {
        text(&run(["recover".as_ref(), from.as_os_str(), to.as_os_str()], exit).stdout)
    };
    assert!(recover(&log, &whole, 0).contains("read back and equal"));
    let mut bytes = fs::read(&log).unwrap();
    bytes.truncate(bytes.len() / 2);
    fs::write(&log, bytes).unwrap();
    assert!(recover(&log, &out, 3).contains("damaged"));
    assert!(fs::metadata(&out).unwrap().len() < fs::metadata(&whole).unwrap().len());
    let there = text(&run(["recover".as_ref(), log.as_os_str(), out.as_os_str()], 2).stderr);
    assert!(there.contains("--force"), "{there}");
}

#[test]
fn channels_are_exported_as_every_kind_of_table() {
    let folder = tempfile::tempdir().unwrap();
    let log = one_flight(folder.path());
    for (kind, place) in [("parquet", "position.gps.parquet"), ("csv", "position.gps.csv"), ("mcap", "")] {
        let out = folder.path().join(format!("out-{kind}"));
        let arguments =
            ["export".as_ref(), log.as_os_str(), "--to".as_ref(), kind.as_ref(), "--out".as_ref(), out.as_os_str()];
        let printed = text(&run(arguments, 0).stdout);
        assert!(printed.contains("position.gps"), "{printed}");
        let written = if place.is_empty() { out } else { out.join(place) };
        assert!(fs::metadata(written).unwrap().len() > 500, "{kind}");
    }
}

#[test]
fn a_build_without_buckets_refuses_a_bucket_in_one_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let (flights, out) = (folder.path().join("flights"), folder.path().join("out"));
    fs::create_dir(&flights).unwrap();
    let (flights, out) = (flights.to_str().unwrap(), out.to_str().unwrap());
    let commands: [&[&str]; 4] = [
        &["campaign", "s3://lab/flights", "--out", out],
        &["campaign", flights, "--out", "s3://lab/out"],
        &["delay", "s3://lab/flights"],
        &["gc", "s3://lab/out"],
    ];
    for command in commands {
        let output = flightlag(command).current_dir(folder.path()).output().unwrap();
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{error}");
        assert!(
            error.starts_with("flightlag: s3://lab/") && error.contains("build it with `--features s3`"),
            "{error}"
        );
        assert_eq!(error.lines().count(), 1, "{error}");
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is written, and no folder called s3:");
}
