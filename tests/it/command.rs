//! The command as people and shells meet it.

use crate::program::{flightlag, run, text};
use std::fs;
use std::process::Stdio;

#[test]
fn a_wrong_command_or_pipeline_ends_with_2_and_says_where() {
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
    let empty = text(&run(["campaign", &flights, "--out", &out], 1).stderr);
    assert!(empty.contains("no flight found"), "{empty}");
}

#[test]
fn without_an_output_folder_the_report_is_named_after_the_flights() {
    let folder = tempfile::tempdir().unwrap();
    simulate::write_campaign(&folder.path().join("may"), 1, 20.0, 1).unwrap();
    let ended = flightlag(["campaign", "may", "--quiet"]).current_dir(folder.path()).status().unwrap();
    assert_eq!(ended.code(), Some(0));
    assert!(folder.path().join("reports/may/index.html").is_file());
}

#[test]
fn a_misspelt_channel_is_refused_with_the_known_ones() {
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
    assert!(error.contains("velocity.efk") && error.contains("velocity.ekf"), "{error}");
}

#[test]
fn a_refused_output_folder_is_not_touched() {
    let folder = tempfile::tempdir().unwrap();
    let inside = folder.path().join("report");
    run(["campaign".as_ref(), folder.path().as_os_str(), "--out".as_ref(), inside.as_os_str()], 2);
    assert!(!inside.exists());
}

#[test]
fn an_error_is_told_once_and_with_visible_characters() {
    let wrong = text(&run(["inspect", "no\u{1b}[31mlog"], 2).stderr);
    assert_eq!(wrong.lines().count(), 1, "{wrong}");
    assert!(wrong.starts_with("flightlag: no\\u{1b}[31mlog: "), "{wrong}");
}

#[test]
fn a_reader_that_leaves_early_is_no_failure() {
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
fn a_full_disk_behind_standard_output_is_a_failure() {
    let Ok(full) = fs::File::options().write(true).open("/dev/full") else {
        println!("skipped: no /dev/full here");
        return;
    };
    let output = flightlag(["maps"]).stdout(full).stderr(Stdio::piped()).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains("standard output"), "{}", text(&output.stderr));
}

#[test]
fn inspect_says_what_a_log_holds_and_which_map_would_bind_it() {
    let folder = tempfile::tempdir().unwrap();
    simulate::write_campaign(folder.path(), 1, 20.0, 3).unwrap();
    let log = folder.path().join("flight-0001.mcap").to_str().unwrap().to_owned();
    let page = text(&run(["inspect", &log], 0).stdout);
    for word in ["flight-0001.mcap", "MCAP", "channel map", "position.", "velocity.", "time stamps"] {
        assert!(page.contains(word), "{word} is not in:\n{page}");
    }
    let json: serde_json::Value = serde_json::from_slice(&run(["inspect", &log, "--json"], 0).stdout).unwrap();
    let bytes = &json["health"]["bytes"];
    let sum: u64 = ["decoded", "skipped", "structure", "damaged"].iter().map(|k| bytes[k].as_u64().unwrap()).sum();
    assert_eq!(sum, fs::metadata(&log).unwrap().len());
    let channels = json["binding"]["channels"].as_array().unwrap();
    let position = channels.iter().find(|c| c["name"] == "position.gps").unwrap();
    // 5 Hz for 20 s: the first at zero, and one that may fall on the end.
    assert!((100..=101).contains(&position["used"].as_u64().unwrap()), "{position}");
}

#[test]
fn inspect_marks_a_log_that_was_cut_off_with_3() {
    let folder = tempfile::tempdir().unwrap();
    simulate::write_campaign(folder.path(), 1, 20.0, 3).unwrap();
    let log = folder.path().join("flight-0001.mcap");
    let bytes = fs::read(&log).unwrap();
    fs::write(&log, &bytes[..bytes.len() * 6 / 10]).unwrap();
    let page = text(&run(["inspect".as_ref(), log.as_os_str()], 3).stdout);
    assert!(page.contains("damage") || page.contains("loss"), "{page}");
}

#[test]
fn the_demo_runs_and_says_which_page_to_open() {
    let folder = tempfile::tempdir().unwrap();
    let demo = folder.path().join("demo");
    let said = text(&run(["demo".as_ref(), demo.as_os_str(), "--run".as_ref()], 0).stdout);
    let page = demo.join("report/index.html");
    assert!(said.contains(&format!("open {}", page.display())), "{said}");
    assert!(page.exists());
}

#[test]
fn the_shipped_maps_are_listed() {
    let maps = text(&run(["maps"], 0).stdout);
    assert!(maps.contains("mavros") && maps.contains("flysight"), "{maps}");
}

#[test]
fn help_is_there_for_every_command() {
    for arguments in [
        vec!["--help"],
        vec!["campaign", "--help"],
        vec!["campaign", "plan", "--help"],
        vec!["campaign", "task", "--help"],
        vec!["campaign", "reduce", "--help"],
        vec!["campaign", "status", "--help"],
        vec!["inspect", "--help"],
        vec!["demo", "--help"],
        vec!["maps", "--help"],
    ] {
        let help = text(&run(&arguments, 0).stdout);
        assert!(help.contains("Usage: flightlag"), "{arguments:?}: {help}");
    }
}

#[test]
fn a_compensator_is_written_as_c_and_an_unstable_one_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let of = |name: &'static str, delay: &'static str| {
        ["compensator", name, "--delay-s", delay, "--step-s", "0.01", "--out", out].map(str::to_owned)
    };
    let told = run(of("pade-2-2-foh", "0.4"), 0);
    let source = std::fs::read_to_string(folder.path().join("position_delay.c")).unwrap();
    let header = std::fs::read_to_string(folder.path().join("position_delay.h")).unwrap();
    assert!(source.contains("Td     0.400000 s") && header.contains("position_delay_step"), "{source}");
    assert!(text(&told.stdout).contains("Do not compensate twice"));
    assert!(text(&run(of("pade-0-5-foh", "0.4"), 2).stderr).contains("unstable"));
    assert!(text(&run(of("pade-1-1-tustin", "-0.1"), 2).stderr).contains("positive delay"));
}
