//! The second file of a flight: a PPK solution next to an own table.

use crate::program::{flightlag, text};
use flight::{Channel, Flight, Stamp};
use simulate::{FlightSettings, SensorSettings, simulate};
use std::fmt::Write;
use std::fs;
use std::path::Path;
use std::process::Command;

/// 2021-05-04 12:00:00 UTC, when GPS time was 18 s ahead.
const START_S: i64 = 1_620_129_600;
const LATE_S: f64 = 0.2;

fn flown(seed: u64) -> Flight {
    let settings = FlightSettings {
        duration_s: 200.0,
        position: SensorSettings { delay_s: LATE_S, white_std: 0.3, ..SensorSettings::clean(5.0) },
        velocity: SensorSettings { white_std: 0.1, ..SensorSettings::clean(25.0) },
        seed,
        ..FlightSettings::default()
    };
    simulate(&settings).unwrap().to_flight().unwrap()
}

/// Seconds since the first stamp of the truth, and the row.
fn rows(flight: &Flight, channel: &Channel) -> Vec<(f64, [f64; 3])> {
    let first = flight.channels["position.truth"].series.timeline().first().unwrap();
    let at = |row: usize| [0, 1, 2].map(|k| channel.series.component(k)[row]);
    let stamps: Vec<Stamp> = channel.series.timeline().stamps().to_vec();
    stamps.iter().enumerate().map(|(row, s)| (s.seconds_since(first), at(row))).collect()
}

/// A table of the position with the latest velocity, whose clock starts at `start_s`.
pub fn write_table(flight: &Flight, path: &Path, start_s: f64) {
    let velocity = rows(flight, &flight.channels["velocity.gps"]);
    let mut out = "time,lat,lon,alt\n".to_owned();
    for (t, [lat, lon, height]) in rows(flight, &flight.channels["position.gps"]) {
        let (lat, lon) = (lat.to_degrees(), lon.to_degrees());
        writeln!(out, "{:.6},{lat:.10},{lon:.10},{height:.3}", start_s + t).unwrap();
    }
    fs::write(path, out).unwrap();
    let mut out = "time,vn,ve,vd\n".to_owned();
    for (t, [n, e, d]) in velocity {
        writeln!(out, "{:.6},{n:.4},{e:.4},{d:.4}", start_s + t).unwrap();
    }
    fs::write(path.with_file_name(format!("{}_VEL.csv", stem(path))), out).unwrap();
}

fn stem(path: &Path) -> String {
    path.file_stem().unwrap().to_string_lossy().trim_end_matches("_POS").to_owned()
}

/// The truth in RTKLIB format: GPS time.
fn write_pos(flight: &Flight, path: &Path) {
    let mut out =
        "% program   : rnx2rtkp\n%\n%  GPST          latitude(deg) longitude(deg)  height(m)   Q  ns\n".to_owned();
    for (t, [lat, lon, height]) in rows(flight, &flight.channels["position.truth"]).into_iter().step_by(20) {
        let ms = (1e3 * t).round() as i64 + 18_000;
        let (minute, second) = (ms / 60_000, ms % 60_000);
        let (lat, lon) = (lat.to_degrees(), lon.to_degrees());
        let time = format!("12:{minute:02}:{:02}.{:03}", second / 1000, second % 1000);
        writeln!(out, "2021/05/04 {time}  {lat:.10}  {lon:.10}  {height:.4}  1  12").unwrap();
    }
    fs::write(path, out).unwrap();
}

fn answer(folder: &Path, arguments: &[&str]) -> serde_json::Value {
    let output = flightlag([&["delay", "--json"], arguments].concat()).current_dir(folder).output().unwrap();
    serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{e}: {}", text(&output.stderr)))
}

fn is_late(flight: &serde_json::Value) {
    let (value, u) = (flight["lateness_s"].as_f64().unwrap(), flight["lateness_u_s"].as_f64().unwrap());
    assert!((value - LATE_S).abs() < 3.0 * u && u < 5e-3, "{value} ± {u}");
}

#[test]
fn lateness_against_a_reference_with_the_same_clock_is_absolute() {
    let folder = tempfile::tempdir().unwrap();
    let flight = flown(1);
    write_table(&flight, &folder.path().join("a_POS.csv"), START_S as f64);
    write_pos(&flight, &folder.path().join("a.pos"));
    let alone = answer(folder.path(), &["."]);
    // The position and the velocity are one flight, the solution without a velocity is another.
    let names = |found: &serde_json::Value| -> Vec<String> {
        found["flights"].as_array().unwrap().iter().map(|f| f["flight"].as_str().unwrap().to_owned()).collect()
    };
    assert_eq!(names(&alone), ["a", "a.pos"]);
    assert_eq!(alone["flights"][0]["datum"], "relative to velocity.gps");
    let both = answer(folder.path(), &[".", "--reference", "{stem}.pos"]);
    assert_eq!(names(&both), ["a"], "a reference is not a separate flight");
    assert_eq!(both["flights"][0]["datum"], "reference");
    is_late(&both["flights"][0]);
    assert!(both["flights"][0]["words"].as_str().unwrap().contains("late against the reference"));
    assert_eq!(both["flights"][0]["effect"], "helped");
}

/// By default it only checks the result. `--reference-clock same` says that it is on time.
#[test]
fn lateness_is_measured_against_a_reference_in_the_log_if_it_is_said_to_be_on_time() {
    let folder = tempfile::tempdir().unwrap();
    simulate::write_campaign(folder.path(), 1, 120.0, 1).unwrap();
    let alone = &answer(folder.path(), &["."])["flights"][0];
    assert_eq!(alone["datum"], "relative to velocity.gps");
    assert!(alone["words"].as_str().unwrap().contains("As a check: the delay of position.gps against position.truth"));
    assert!(alone["removed_s"].is_null(), "{alone}");
    let said = &answer(folder.path(), &[".", "--reference-clock", "same"])["flights"][0];
    assert_eq!((&said["datum"], &said["effect"]), (&"reference".into(), &"helped".into()), "{said}");
    let (value, u) = (said["lateness_s"].as_f64().unwrap(), said["lateness_u_s"].as_f64().unwrap());
    assert!((value - 0.4).abs() < 3.0 * u && u < 5e-3, "{value} ± {u}");
}

#[test]
fn a_log_without_the_reference_that_is_said_to_be_on_time_is_an_alarm() {
    let folder = tempfile::tempdir().unwrap();
    write_table(&flown(1), &folder.path().join("a_POS.csv"), START_S as f64);
    let output = flightlag(["delay", ".", "--reference-clock", "same"]).current_dir(folder.path()).output().unwrap();
    let printed = text(&output.stdout);
    assert_eq!(output.status.code(), Some(3), "{printed}");
    let why = "the log has no reference (position.truth): `--reference-clock same` has no effect";
    assert!(printed.lines().next().unwrap().contains(why), "{printed}");
}

#[test]
fn a_reference_with_its_own_clock_is_tied_by_the_velocity() {
    let folder = tempfile::tempdir().unwrap();
    let flight = flown(2);
    write_table(&flight, &folder.path().join("b_POS.csv"), 17.0);
    write_pos(&flight, &folder.path().join("solution.pos"));
    let found = answer(folder.path(), &[".", "--reference", "solution.pos"]);
    let line = &found["flights"][0];
    assert_eq!(line["datum"], "relative to velocity.gps");
    is_late(line);
    let words = line["reference_file"].as_str().unwrap();
    // The log says 17 s where the solution says 12:00:18 GPS time: the offset is the whole difference.
    let gps_s = START_S + 18 - 315_964_800;
    let offset: f64 = words.split(" is ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!((offset - (17.0 - gps_s as f64)).abs() < 0.01, "{words}");
    assert_eq!(line["error_raw_m"].as_f64().map(|m| m > 1.0), Some(true));
}

/// Compiles C files with all compilers of this machine, without warnings and together in one program.
fn compiles(folder: &Path, sources: &[&str]) {
    for compiler in ["gcc", "clang"] {
        let strict = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-Wconversion", "-shared", "-fPIC", "-o", "all.so"];
        match Command::new(compiler).args(strict).args(sources).current_dir(folder).output() {
            Ok(done) => assert!(done.status.success(), "{compiler}: {}", text(&done.stderr)),
            Err(_) => println!("SKIPPED: no `{compiler}` on this machine"),
        }
    }
}

#[test]
fn a_campaign_writes_its_delay_as_c_that_compiles_without_warnings() {
    let folder = tempfile::tempdir().unwrap();
    let flights = folder.path().join("flights");
    fs::create_dir(&flights).unwrap();
    for (name, seed) in [("one", 5), ("two", 6)] {
        let flight = flown(seed);
        write_table(&flight, &flights.join(format!("{name}_POS.csv")), START_S as f64);
        write_pos(&flight, &flights.join(format!("{name}.pos")));
    }
    let campaign = |reference: &[&str]| {
        let asked = ["campaign", "flights", "--out", "out", "--c", "c", "--step-s", "0.02"];
        flightlag([&asked, reference].concat()).current_dir(folder.path()).output().unwrap()
    };
    let unknown = campaign(&[]);
    assert_eq!(unknown.status.code(), Some(1), "a lateness relative to the velocity cannot be compensated");
    let why = text(&unknown.stderr);
    assert!(why.contains("no C was written: the lateness of the position against the IMU"), "{why}");
    assert!(!folder.path().join("c").exists() && folder.path().join("out/index.html").exists());

    let known = campaign(&["--reference", "{stem}.pos"]);
    assert_eq!(known.status.code(), Some(0), "{}", text(&known.stderr));
    let written = text(&known.stderr);
    assert!(written.contains("position_delay.h and .c, exact-async, "), "{written}");
    assert!(written.contains("position_delay_pade.h and .c, pade-1-1-tustin, "), "{written}");
    let header = fs::read_to_string(folder.path().join("c/position_delay_pade.h")).unwrap();
    assert!(header.contains("2 flights of ") && header.contains("against the reference, 95 % "), "{header}");
    compiles(&folder.path().join("c"), &["position_delay.c", "position_delay_pade.c"]);
    // The command on the page reproduces the report.
    let record = fs::read_to_string(folder.path().join("out/campaign.json")).unwrap();
    assert!(record.contains("--reference '{stem}.pos' --out REPORT"), "{record:.2000}");
}

#[test]
fn a_campaign_uses_the_reference_file_of_each_flight() {
    let folder = tempfile::tempdir().unwrap();
    let flights = folder.path().join("flights");
    fs::create_dir(&flights).unwrap();
    for (name, seed) in [("one", 3), ("two", 4)] {
        let flight = flown(seed);
        write_table(&flight, &flights.join(format!("{name}_POS.csv")), START_S as f64);
        write_pos(&flight, &flights.join(format!("{name}_ppk.pos")));
    }
    let pipeline = "schema = 1\n[delay]\nfrom = \"network\"\n[reference]\nfile = \"{stem}_*.pos\"\n";
    fs::write(folder.path().join("p.toml"), pipeline).unwrap();
    let campaign = || {
        let output = flightlag(["campaign", "flights", "--out", "out", "--pipeline", "p.toml"])
            .current_dir(folder.path())
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(0), "{}{}", text(&output.stdout), text(&output.stderr));
        text(&output.stdout)
    };
    let printed = campaign();
    assert!(printed.contains("late against reference (2 of 2 flights)"), "{printed}");
    let record = || {
        let found = fs::read_dir(folder.path().join("out/flights")).unwrap().flatten();
        let page = found.map(|e| e.path().join("index.html")).find(|p| p.to_string_lossy().contains("one")).unwrap();
        serde_json::from_slice::<serde_json::Value>(&campaign::record_of_page(&page).unwrap().unwrap()).unwrap()
    };
    let before = record();
    assert_eq!(before["lateness"]["reference_file"]["clock"]["clock"], "same");
    assert!(before["inputs"].as_array().unwrap().iter().any(|f| f["name"] == "one_ppk.pos"));
    campaign();
    assert_eq!(record(), before);
    // Another solution gives another result.
    let solution = fs::read_to_string(flights.join("one_ppk.pos")).unwrap();
    fs::write(flights.join("one_ppk.pos"), solution.replace("  1  12\n", "  2  12\n")).unwrap();
    campaign();
    assert_ne!(record()["key"], before["key"]);
}

#[test]
fn an_unusable_reference_file_is_an_alarm_with_its_reason() {
    let folder = tempfile::tempdir().unwrap();
    let flight = flown(6);
    write_table(&flight, &folder.path().join("c_POS.csv"), START_S as f64);
    write_pos(&flight, &folder.path().join("c.pos"));
    let alarm = |arguments: &[&str]| {
        let found = answer(folder.path(), arguments);
        let alarms = found["flights"][0]["alarms"].as_array().unwrap().clone();
        let of =
            |a: &serde_json::Value| (a["code"] == "reference-not-used").then(|| a["text"].as_str().unwrap().to_owned());
        alarms.iter().find_map(of).unwrap()
    };
    let refused = |arguments: &[&str]| {
        let output = flightlag([&["delay"], arguments].concat()).current_dir(folder.path()).output().unwrap();
        assert_eq!((output.status.code(), text(&output.stdout)), (Some(2), String::new()), "{}", text(&output.stderr));
        text(&output.stderr)
    };
    let none = refused(&["c_POS.csv", "c_VEL.csv", "--reference", "{stem}.ppk"]);
    assert!(none.contains("reference file {stem}.ppk: no flight has one"), "{none}");
    let none = refused(&["c_POS.csv", "--reference", "none.csv"]);
    assert!(none.contains("reference file none.csv: the file does not exist"), "{none}");
    fs::copy(folder.path().join("c.pos"), folder.path().join("c2.pos")).unwrap();
    assert!(refused(&["c_POS.csv", "--reference", "c*.pos"]).contains("2 files have a matching name"));
    fs::write(folder.path().join("short.csv"), "time,lat,lon,alt\n0,47.1,8.1,400\n1,47.1,8.1,400\n").unwrap();
    fs::create_dir(folder.path().join("log")).unwrap();
    for name in ["c_POS.csv", "c_VEL.csv"] {
        fs::copy(folder.path().join(name), folder.path().join("log").join(name)).unwrap();
    }
    let reason = alarm(&["log", "--reference", "short.csv"]);
    let asked = ["delay", "log", "--quiet", "--reference", "short.csv"];
    let unusable = flightlag(asked).current_dir(folder.path()).output().unwrap();
    assert_eq!(unusable.status.code(), Some(3));
    let first = format!("reference file {reason}");
    assert_eq!(text(&unusable.stdout).lines().next(), Some(first.as_str()), "its reason comes first");
    let several = flightlag(["delay", ".", "--reference", "c.pos"]).current_dir(folder.path()).output().unwrap();
    assert_eq!(several.status.code(), Some(2));
    assert!(
        text(&several.stderr).contains("give a pattern in which {stem} is the name of the log"),
        "{}",
        text(&several.stderr)
    );
}

/// The truth as a second file without axis names: east, north, up, in the clock of a motion capture system.
fn write_mocap(flight: &Flight, path: &Path, start_s: f64) {
    let frame = flight::LocalFrame::new(flight::Geodetic { latitude: 0.0, longitude: 0.0, height: 0.0 });
    let all = rows(flight, &flight.channels["position.truth"]);
    let first = all[0].1;
    let frame = if first[0] == 0.0 {
        frame
    } else {
        flight::LocalFrame::new(flight::Geodetic { latitude: first[0], longitude: first[1], height: 0.0 })
    };
    let mut out = "Frame,Time,X,Y,Z\n".to_owned();
    for (k, (t, [latitude, longitude, height])) in all.into_iter().step_by(10).enumerate() {
        let [north, east, _] = frame.to_ned(flight::Geodetic { latitude, longitude, height: 0.0 });
        writeln!(out, "{k},{:.3},{east:.4},{north:.4},{height:.4}", start_s + t).unwrap();
    }
    fs::write(path, out).unwrap();
}

#[test]
fn an_ambiguous_reference_file_is_resolved_by_the_motion_of_the_log() {
    let folder = tempfile::tempdir().unwrap();
    let flight = flown(7);
    write_table(&flight, &folder.path().join("d_POS.csv"), START_S as f64);
    // A velocity alone.
    let found = answer(folder.path(), &["d_POS.csv", "--reference", "d_VEL.csv", "--reference-clock", "same"]);
    let line = &found["flights"][0];
    assert_eq!(line["datum"], "reference", "{line:#}");
    is_late(line);
    assert!(line["reference_file"].as_str().unwrap().contains("north = vn [m/s], east = ve [m/s]"), "{line:#}");
    // A motion capture with unnamed axes and its own clock.
    write_mocap(&flight, &folder.path().join("mocap.csv"), 1234.0);
    let found = answer(folder.path(), &[".", "--reference", "mocap.csv"]);
    let line = &found["flights"][0];
    assert!(line["reference_file"].as_str().unwrap().contains("north = Y [m], east = X [m]"), "{line:#}");
    is_late(line);
    // In other units it is rejected with advice.
    let text = fs::read_to_string(folder.path().join("d_VEL.csv")).unwrap();
    let in_kmh = |line: &str| {
        let cells: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
        format!("{},{},{},{}\n", cells[0], 3.6 * cells[1], 3.6 * cells[2], 3.6 * cells[3])
    };
    let rows: String = text.lines().skip(1).map(in_kmh).collect();
    fs::create_dir(folder.path().join("kmh")).unwrap();
    fs::write(folder.path().join("kmh/fast.csv"), format!("time,vn,ve,vd\n{rows}")).unwrap();
    let asked = ["delay", "d_POS.csv", "--reference", "kmh/fast.csv", "--reference-clock", "same"];
    let refused = flightlag(asked).current_dir(folder.path()).output().unwrap();
    assert_eq!(refused.status.code(), Some(1), "without a velocity nothing is measured");
    let printed = text_of(&refused);
    assert!(
        printed.contains("it moves 3.6") && printed.contains("state the unit in the name of its column"),
        "{printed}"
    );
}

fn text_of(output: &std::process::Output) -> String {
    text(&output.stdout) + &text(&output.stderr)
}

#[test]
fn an_unshared_clock_is_not_an_error_of_a_thousand_metres() {
    let folder = tempfile::tempdir().unwrap();
    let flight = flown(8);
    write_table(&flight, &folder.path().join("e_POS.csv"), 17.0);
    write_mocap(&flight, &folder.path().join("mocap.csv"), 109.7);
    let asked = ["delay", ".", "--reference", "mocap.csv", "--reference-clock", "same"];
    let refused = flightlag(asked).current_dir(folder.path()).output().unwrap();
    assert_eq!(refused.status.code(), Some(3), "{}", text_of(&refused));
    let printed = text(&refused.stdout);
    let first = printed.lines().next().unwrap();
    assert!(first.starts_with("reference file mocap.csv is not used: its clock is not that of the log"), "{printed}");
    assert!(first.contains("-92."), "{printed}");
}
