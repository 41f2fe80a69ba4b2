//! What the commands print, and the records of a campaign, as they were accepted. `FLIGHTLAG_BLESS=1` accepts a change:
//! read the diff.

use crate::nightly::Nights;
use crate::program::{run, text};
use campaign::{read_report, record_of_page};
use serde_json::Value;
use simulate::{BenchChannel, BenchSensor, BenchSettings, Container, RigText, one_field_per_line, simulate_bench};
use std::fs;
use std::path::Path;
use tempfile::TempDir;

/// Three flights of 40 s, a pipeline, and two criteria; all flights fail the second.
fn flights() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    simulate::write_campaign(&folder.path().join("flights"), 3, 40.0, 24).unwrap();
    let known = "schema = 1\n[delay]\nposition_s = 0.4\nsource = \"simulated\"\n";
    fs::write(folder.path().join("known.toml"), known).unwrap();
    let criteria = "schema = 1\n[[criterion]]\nid = \"rate\"\ntitle = \"Rate\"\nmetric = \"position-rate\"\n\
                    at_least = \"4.5 Hz\"\nrationale = \"r\"\n[[criterion]]\nid = \"error\"\ntitle = \"Error\"\n\
                    metric = \"error-p95\"\ncompensator = \"exact-async\"\nat_most = \"0.2 m\"\nrationale = \"r\"\n";
    fs::write(folder.path().join("criteria.toml"), criteria).unwrap();
    folder
}

/// Compares a text without the name of the folder with the golden text of the running test.
fn assert_as_accepted(folder: &TempDir, text: &str) {
    let text = text.replace(&format!("{}/", folder.path().display()), "");
    simulate::assert_golden(&Path::new(env!("CARGO_MANIFEST_DIR")).join("golden"), &text);
}

/// Runs a command, given as words. A word that begins with `./` is a path below the folder.
fn command(folder: &TempDir, words: &str, exit: i32) -> String {
    let path = |word: &str| match word.strip_prefix("./") {
        Some(name) => folder.path().join(name).display().to_string(),
        None => word.to_owned(),
    };
    let ran = run(words.split(' ').map(path), exit);
    text(&ran.stdout) + &text(&ran.stderr)
}

fn assert_printed(folder: &TempDir, words: &str, exit: i32) {
    assert_as_accepted(folder, &command(folder, words, exit));
}

/// Compares a record without keys, hashes and versions.
fn assert_record(folder: &TempDir, record: &Value) {
    let fields = one_field_per_line(record);
    let kept = fields.lines().filter(|line| ![".key:", "blake3", "version"].iter().any(|word| line.contains(word)));
    assert_as_accepted(folder, &kept.map(|line| format!("{line}\n")).collect::<String>());
}

/// The record of the first flight of a report.
fn assert_flight(folder: &TempDir, out: &str) {
    let out = folder.path().join(out);
    let page = out.join(&read_report(&out).unwrap().unwrap().flights[0].page);
    assert_record(folder, &serde_json::from_slice(&record_of_page(&page).unwrap().unwrap()).unwrap());
}

#[test]
fn what_inspect_and_recover_print_is_as_accepted() {
    let folder = flights();
    assert_printed(&folder, "inspect ./flights/flight-0001.mcap", 0);
    assert_record(
        &folder,
        &serde_json::from_str(&command(&folder, "inspect ./flights/flight-0001.mcap --json", 0)).unwrap(),
    );
    let whole = fs::read(folder.path().join("flights/flight-0002.mcap")).unwrap();
    fs::write(folder.path().join("cut.mcap"), &whole[..2 * whole.len() / 3]).unwrap();
    assert_printed(&folder, "inspect ./cut.mcap", 3);
    assert_printed(&folder, "recover ./cut.mcap ./whole.mcap", 3);
}

#[test]
fn what_delay_prints_is_as_accepted() {
    let folder = flights();
    assert_printed(&folder, "delay ./flights/flight-0001.mcap", 0);
    assert_printed(&folder, "delay ./flights --threads 1", 0);
    assert_record(
        &folder,
        &serde_json::from_str(&command(&folder, "delay ./flights/flight-0002.mcap --json", 0)).unwrap(),
    );
}

#[test]
fn the_records_of_a_campaign_are_as_accepted() {
    let folder = flights();
    let words = "campaign ./flights --out ./out --threads 1 --pipeline ./known.toml --criteria ./criteria.toml";
    assert_printed(&folder, words, 4);
    let record = read_report(&folder.path().join("out")).unwrap().unwrap();
    assert_record(&folder, &serde_json::to_value(&record).unwrap());
    assert_flight(&folder, "out");
}

#[test]
fn a_comparison_a_trial_and_a_second_run_are_as_accepted() {
    let folder = flights();
    let run = |more: &str| command(&folder, &format!("campaign ./flights --threads 1 {more}"), 0);
    run("--out ./first --pipeline ./known.toml");
    run("--out ./second");
    assert_printed(&folder, "diff ./first ./second", 0);
    assert_flight(&folder, "second");
    fs::remove_file(folder.path().join("flights/flight-0003.mcap")).unwrap();
    assert_as_accepted(&folder, &run("--out ./first --pipeline ./known.toml"));
    let changes = fs::read(folder.path().join("first/since-last-run.json")).unwrap();
    assert_record(&folder, &serde_json::from_slice(&changes).unwrap());
}

#[test]
fn what_bench_prints_and_its_card_are_as_accepted() {
    let folder = tempfile::tempdir().unwrap();
    let channels = [BenchChannel::AngularRate, BenchChannel::PositionGps];
    let settings = BenchSettings { seed: 24, swing_s: 20.0, rest_s: [2.0, 2.0], ..BenchSettings::default() };
    let settings = settings.only(&channels).with(BenchChannel::PositionGps, BenchSensor::noisy(4.0, 0.1).late(0.4));
    let simulated = simulate_bench(&settings).unwrap();
    for file in simulated.files(Container::CsvWide, "swing").unwrap() {
        fs::write(folder.path().join(&file.path), &file.bytes).unwrap();
    }
    let rig = RigText { model: "Simulated".into(), serial: "1".into(), to_be_fitted: true };
    fs::write(folder.path().join("swing.rig.toml"), simulated.rig_text(&rig)).unwrap();
    assert_printed(&folder, "bench ./swing.csv --threads 1 --out ./out", 0);
    let mut files = fs::read_dir(folder.path().join("out")).unwrap().map(|entry| entry.unwrap().path());
    let card = files.find(|path| path.to_string_lossy().ends_with(".card.toml")).unwrap();
    let card = fs::read_to_string(card).unwrap();
    let lines = card.lines().filter(|line| !line.contains("blake3") && !line.contains("version"));
    assert_as_accepted(&folder, &lines.map(|line| format!("{line}\n")).collect::<String>());
}

#[test]
fn what_compensator_prints_is_as_accepted() {
    let folder = tempfile::tempdir().unwrap();
    for (name, exit) in [("pade-1-1-zoh", 0), ("exact-async", 0), ("kalman", 2)] {
        assert_printed(&folder, &format!("compensator {name} --delay-s 0.4 --step-s 0.02 --out ./"), exit);
    }
}

#[test]
fn the_charts_of_a_night_are_as_accepted() {
    let nights = Nights::new(3);
    nights.night(0);
    let folder = &nights.folder;
    assert_printed(folder, "history ./out/history --latency", 0);
    assert_printed(folder, "trend ./out/history", 0);
    assert_record(folder, &serde_json::from_str(&command(folder, "trend ./out/history --json", 0)).unwrap());
}
