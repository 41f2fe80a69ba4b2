use super::*;
use crate::bench::bench_logs::Source;
use crate::bench::pair::MadeOf;
use flight::{Binding, Channel, ChannelSource, Clock, Flight, LogHealth, Quantity, Series, Stamp, StampKind, Timeline};
use ingest::{FlightUnit, Loaded, LogKind};
use record::Verdict;
use simulate::{
    BenchChannel, BenchSensor, BenchSettings, Container, LogFile, McapSettings, RigText, SimulatedBench, simulate_bench,
};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::AtomicBool;

const MCAP: fn() -> Container = || Container::Mcap(McapSettings::default());

// --- which logs form a record ---

/// A log of this name with channels of these quantities; `None` for an unreadable log.
fn log(id: &str, folder: &str, quantities: Option<&[Quantity]>) -> ReadLog {
    let unit = FlightUnit { id: id.into(), files: vec![Path::new(folder).join(id)], kind: LogKind::Mcap };
    let source = Source { unit, neighbourhood: folder.into(), is_stated_encoder: false };
    let loaded = quantities.ok_or_else(|| "cut off".to_owned()).map(|quantities| Loaded {
        flight: flight(quantities),
        health: LogHealth::default(),
        binding: Ok(Binding { map: "m".into(), why: String::new(), channels: vec![], others: vec![] }),
        companion: None,
    });
    ReadLog { source, inputs: vec![], loaded }
}

fn flight(quantities: &[Quantity]) -> Flight {
    let channel = |quantity: Quantity| {
        let timeline = Timeline::new(StampKind::Measured, Clock::Unix, vec![Stamp(0), Stamp(1)]).unwrap();
        let columns = quantity.components().iter().map(|_| vec![0.0, 1.0]).collect();
        Channel {
            quantity,
            series: Series::new(timeline, columns).unwrap(),
            present: quantity.components().iter().map(|_| true).collect(),
            other_stamps: vec![],
            held: vec![false; 2],
            source: ChannelSource { topic: "t".into(), type_name: String::new(), fields: vec![] },
        }
    };
    let channels = quantities.iter().enumerate().map(|(i, &q)| (format!("c{i}"), channel(q)));
    Flight { channels: channels.collect(), ..Flight::default() }
}

const ENCODER: Option<&[Quantity]> = Some(&[Quantity::EncoderCount, Quantity::Pulse]);
const SENSOR: Option<&[Quantity]> = Some(&[Quantity::VelocityNed]);
const BOTH: Option<&[Quantity]> = Some(&[Quantity::EncoderAngle, Quantity::VelocityNed]);

fn paired(logs: &[ReadLog]) -> Vec<(String, MadeOf)> {
    pair::pair(logs, false).into_iter().map(|s| (s.name, s.made_of)).collect()
}

#[test]
fn an_encoder_and_a_sensor_in_a_folder_or_in_one_log_form_a_record() {
    let logs = [log("a.mcap", "d", BOTH), log("x.csv", "d", SENSOR), log("y.csv", "d", ENCODER)];
    assert_eq!(
        paired(&logs),
        [("a.mcap".to_owned(), MadeOf::One(0)), ("y.csv + x.csv".to_owned(), MadeOf::Two { encoder: 2, sensor: 1 }),]
    );
}

#[test]
fn several_pairs_are_matched_by_the_start_of_their_names_or_by_folder() {
    let logs = [
        log("run-1-encoder.csv", "d", ENCODER),
        log("run-1-imu.mcap", "d", SENSOR),
        log("run-2-encoder.csv", "d", ENCODER),
        log("run-2-imu.mcap", "d", SENSOR),
        log("s3/enc.csv", "d/s3", ENCODER),
        log("s3/imu.mcap", "d/s3", SENSOR),
    ];
    let two = |encoder, sensor| MadeOf::Two { encoder, sensor };
    let expected = [("run-1", two(0, 1)), ("run-2", two(2, 3)), ("s3", two(4, 5))];
    assert_eq!(paired(&logs), expected.map(|(name, made_of)| (name.to_owned(), made_of)));
}

#[test]
fn logs_that_cannot_be_paired_are_reported_without_guessing() {
    let logs = [log("a.csv", "d", ENCODER), log("b.csv", "d", ENCODER), log("c.mcap", "d", SENSOR)];
    let found = paired(&logs);
    assert_eq!(found.len(), 3);
    for (_, made_of) in found {
        let MadeOf::Nothing { reason, .. } = made_of else { panic!("{made_of:?}") };
        assert!(reason.contains("2 logs of encoders and 1 of sensors"), "{reason}");
    }
    let alone = paired(&[log("c.mcap", "d", SENSOR)]);
    assert!(matches!(&alone[0].1, MadeOf::Nothing { reason, .. } if reason.contains("give --encoder")), "{alone:?}");
}

#[test]
fn an_encoder_whose_only_companion_is_unreadable_shares_its_failure() {
    let found = paired(&[log("enc.csv", "d", ENCODER), log("imu.mcap", "d", None)]);
    assert_eq!(
        found,
        [("enc.csv + imu.mcap".to_owned(), MadeOf::Nothing { logs: vec![0, 1], reason: "cut off".into() })]
    );
}

#[test]
fn records_of_different_folders_with_the_same_name_are_distinguished() {
    let names: Vec<String> =
        paired(&[log("a.mcap", "d1", BOTH), log("a.mcap", "d2", BOTH)]).into_iter().map(|p| p.0).collect();
    assert_eq!(names, ["a.mcap", "a.mcap~2"]);
}

#[test]
fn each_log_of_a_record_has_its_role() {
    let logs = [
        log("a.mcap", "both", BOTH),
        log("e.csv", "pair", ENCODER),
        log("s.mcap", "pair", SENSOR),
        log("e.csv", "alone", ENCODER),
        log("s.mcap", "only", SENSOR),
        log("x.mcap", "bad", None),
    ];
    let rig = Rig::shipped_default().unwrap();
    let roles = |swing: &Swing| -> Vec<String> {
        let record = bench_study::defect(swing, &rig, &logs, "index out of bounds");
        let reason = bench_study::outcome_reason(&record.outcome).unwrap();
        assert_eq!(
            (bench_study::outcome_name(&record.outcome), reason.contains("index out of bounds")),
            ("failed", true)
        );
        record.logs.into_iter().map(|log| log.role).collect()
    };
    let found: Vec<Vec<String>> = pair::pair(&logs, false).iter().map(roles).collect();
    assert_eq!(
        found,
        [vec!["encoder and sensor"], vec!["encoder", "sensor"], vec!["encoder"], vec!["sensor"], vec!["unknown"]]
    );
}

// --- the whole run, on simulated records ---

/// Velocity 20 ms late, 12 s of swing.
fn simulated(seed: u64) -> SimulatedBench {
    let velocity = BenchSettings::default().sensor[&BenchChannel::VelocityIns].clone().late(0.02);
    let settings = BenchSettings { seed, swing_s: 12.0, rest_s: [2.0, 2.0], ..BenchSettings::default() };
    simulate_bench(&settings.only(&[BenchChannel::VelocityIns]).with(BenchChannel::VelocityIns, velocity)).unwrap()
}

fn put(folder: &Path, files: Vec<LogFile>) {
    for file in files {
        let path = folder.join(file.path);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, file.bytes).unwrap();
    }
}

fn rig(bench: &SimulatedBench, serial: &str) -> String {
    bench.rig_text(&RigText { model: "M".into(), serial: serial.into(), to_be_fitted: false })
}

/// A folder with one record in one log and one in two, and a rig for both.
fn bench() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let (one, two) = (simulated(1), simulated(2));
    put(&folder.path().join("logs"), one.files(MCAP(), "one").unwrap());
    put(&folder.path().join("logs/pair"), two.encoder_files(Container::CsvWide, "enc").unwrap());
    put(&folder.path().join("logs/pair"), two.sensor_files(MCAP(), "imu").unwrap());
    std::fs::write(folder.path().join("m.rig.toml"), rig(&one, "1")).unwrap();
    folder
}

fn order(folder: &Path, records: &[&str], out: &str) -> BenchOrder {
    BenchOrder {
        records: records.iter().map(|r| folder.join(r)).collect(),
        encoder: None,
        rig: Some(folder.join("m.rig.toml")),
        out: folder.join(out),
        forced_map: None,
        maps_folder: None,
        replace: false,
        card: None,
        command: "flightlag bench logs --out REPORT".into(),
    }
}

fn go(order: &BenchOrder, threads: usize) -> Result<BenchVerdict, CampaignError> {
    let quiet = |_: &Event| {};
    bench_run(order, &RunContext { threads, cancel: &AtomicBool::new(false), events: &quiet })
}

/// What the events of a run say.
#[derive(Debug, PartialEq)]
struct Reported {
    /// For each record: the outcome, and whether there is a reason.
    outcomes: Vec<(&'static str, bool)>,
    sensor: String,
    card: Option<String>,
    records: usize,
    measured: usize,
}

/// The same with its events.
fn go_with_events(order: &BenchOrder) -> (BenchVerdict, Reported) {
    let events = std::sync::Mutex::new(vec![]);
    let keep = |event: &Event| events.lock().unwrap().push(event.clone());
    let context = RunContext { threads: 1, cancel: &AtomicBool::new(false), events: &keep };
    let verdict = bench_run(order, &context).unwrap();
    let (mut outcomes, mut reported) = (vec![], vec![]);
    for event in events.into_inner().unwrap() {
        match event {
            Event::Measured { record, outcome, reason, lossy } => {
                assert_eq!((&record, lossy), (&verdict.rows[outcomes.len()].name, false));
                outcomes.push((outcome, reason.is_some()));
            }
            Event::Carded { sensor, card, report, records, measured, channels, notices } => {
                assert_eq!((&report, channels.as_slice()), (&verdict.page, verdict.channels()));
                assert_eq!(notices, verdict.notices);
                reported.push(Reported { outcomes: std::mem::take(&mut outcomes), sensor, card, records, measured });
            }
            _ => {}
        }
    }
    let [reported] = reported.try_into().unwrap();
    (verdict, reported)
}

/// Every file below a folder except `run.json` and internal files.
fn content(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut open = vec![folder.to_owned()];
    while let Some(path) = open.pop() {
        for entry in std::fs::read_dir(path).unwrap().map(|e| e.unwrap().path()) {
            let name = entry.strip_prefix(folder).unwrap().to_string_lossy().into_owned();
            match entry.is_dir() {
                true if name != ".flightlag" => open.push(entry),
                false if name != "run.json" => drop(found.insert(name, std::fs::read(&entry).unwrap())),
                _ => {}
            }
        }
    }
    found
}

#[test]
fn two_records_give_the_simulated_delay_and_the_same_bytes_on_any_threads() {
    let folder = bench();
    let verdict = go(&order(folder.path(), &["logs"], "out-1"), 1).unwrap();
    let names: Vec<&str> = verdict.rows.iter().map(|r| r.name.as_str()).collect();
    assert_eq!(names, ["one.mcap", "pair"]);
    assert_eq!(verdict.exit(), Exit::Well, "{:?}", verdict.rows);
    let [velocity] = verdict.channels() else { panic!("{:?}", verdict.card) };
    assert_eq!((velocity.name.as_str(), velocity.verdict), ("velocity.ins", Verdict::Delayed));
    // 99.99 % of a Gaussian: this tests the data path, not the quality of the estimate.
    let off = (velocity.delay_s - 0.02).abs() / velocity.delay_standard_uncertainty_s;
    assert!(off < 4.0, "{velocity:?}");

    let card_file = verdict.card_file.unwrap();
    assert_eq!(card_file.file_name().unwrap(), "m-1.card.toml");
    let text = std::fs::read_to_string(&card_file).unwrap();
    assert_eq!(bench_analysis::parse_card(&text, &card_file).unwrap(), verdict.card.unwrap());

    go(&order(folder.path(), &["logs"], "out-2"), 2).unwrap();
    let (a, b) = (content(&folder.path().join("out-1")), content(&folder.path().join("out-2")));
    assert_eq!(a.keys().collect::<Vec<_>>(), b.keys().collect::<Vec<_>>());
    assert!(a == b, "bytes differ");
    assert!(a.contains_key("index.html") && a.contains_key("records/pair/record.json"), "{:?}", a.keys());
}

/// A bar of 1.3 m with a rig file that states 1.2 m: the velocity shows it.
#[test]
fn a_rig_contradicted_by_the_data_affects_the_card_and_the_exit_code() {
    let folder = bench();
    let text = rig(&simulated(1), "1");
    assert!(text.contains("-1.3]"), "{text}");
    std::fs::write(folder.path().join("m.rig.toml"), text.replace("-1.3]", "-1.2]")).unwrap();
    let verdict = go(&order(folder.path(), &["logs"], "out"), 2).unwrap();
    assert_eq!(verdict.exit(), Exit::Incomplete);
    let marked = &verdict.channels()[0].contradicted;
    assert_eq!(marked.len(), 2, "{marked:?}");
    assert!(marked[0].starts_with("one.mcap: distance from the axis by velocity.ins"), "{marked:?}");
    assert!(verdict.notices.iter().any(|n| n.code == "rig-contradicted" && n.place == "pair"), "{:?}", verdict.notices);
    let page = std::fs::read_to_string(verdict.page).unwrap();
    assert!(page.contains("in doubt"));
}

/// The card of one record of these channels, each with a sensor of its own, and a rig file that is right.
fn card_of(channels: &[(BenchChannel, BenchSensor)]) -> BenchVerdict {
    let folder = tempfile::tempdir().unwrap();
    let names: Vec<BenchChannel> = channels.iter().map(|c| c.0).collect();
    let settings = BenchSettings { seed: 3, swing_s: 30.0, rest_s: [2.0, 2.0], ..BenchSettings::ins() }.only(&names);
    let settings =
        channels.iter().cloned().fold(settings, |settings, (channel, sensor)| settings.with(channel, sensor));
    let simulated = simulate_bench(&settings).unwrap();
    put(folder.path(), simulated.files(MCAP(), "swing").unwrap());
    std::fs::write(folder.path().join("m.rig.toml"), rig(&simulated, "1")).unwrap();
    go(&order(folder.path(), &["swing.mcap"], "out"), 2).unwrap()
}

/// A wrong azimuth turns the field, and so moves the iron that is fitted to it.
#[test]
fn iron_of_a_record_with_a_contradicted_azimuth_is_not_given() {
    let names = [BenchChannel::MagneticField, BenchChannel::VelocityIns];
    let settings = BenchSettings { seed: 3, swing_s: 20.0, rest_s: [2.0, 2.0], ..BenchSettings::ins() }.only(&names);
    let simulated = simulate_bench(&settings).unwrap();
    let reason = |off_deg: f64| {
        let folder = tempfile::tempdir().unwrap();
        put(folder.path(), simulated.files(MCAP(), "swing").unwrap());
        let text = rig(&simulated, "1");
        let line = text.lines().find(|line| line.starts_with("azimuth_deg")).unwrap();
        let azimuth_deg = settings.bar.azimuth_rad.to_degrees() + off_deg;
        let text = text.replace(line, &format!("azimuth_deg = {azimuth_deg:.3}"));
        std::fs::write(folder.path().join("m.rig.toml"), text).unwrap();
        let card = go(&order(folder.path(), &["swing.mcap"], "out"), 2).unwrap().card.unwrap();
        match card.magnetometer.unwrap().iron {
            Finding::Found(_) => String::new(),
            Finding::CannotTell(why) => why,
        }
    };
    assert!(!reason(0.0).contains("in doubt"));
    let doubt = reason(20.0);
    assert!(doubt.starts_with("an angle is in doubt (swing.mcap: azimuth by velocity.ins"), "{doubt}");
}

#[test]
fn a_position_that_could_not_be_measured_ends_with_3() {
    let velocity = (BenchChannel::VelocityIns, BenchSensor::noisy(100.0, 0.02));
    let position = |noise_m| (BenchChannel::PositionIns, BenchSensor::noisy(10.0, noise_m));
    let measured = card_of(&[velocity.clone(), position(0.02)]);
    assert_eq!((measured.channels().len(), measured.lacks_position, measured.exit()), (2, false, Exit::Well));
    let lacking = card_of(&[velocity, position(50.0)]);
    let names: Vec<&str> = lacking.channels().iter().map(|c| c.name.as_str()).collect();
    assert_eq!(names, ["velocity.ins"]);
    assert_eq!((lacking.lacks_position, lacking.exit()), (true, Exit::Incomplete));
    assert!(lacking.rows.iter().all(|row| row.outcome == BenchOutcome::Measured && !row.lossy));
}

/// Former bug: a clock 0.2 s off made every channel "early by 200 ms, absolute", with exit code 0.
#[test]
fn an_early_gyro_shows_that_the_clocks_differ() {
    let gyro = |delay_s| (BenchChannel::AngularRate, BenchSensor::noisy(100.0, 0.01).late(delay_s));
    let velocity = (BenchChannel::VelocityIns, BenchSensor::noisy(100.0, 0.02).late(0.1));
    assert_eq!(card_of(&[gyro(0.0), velocity.clone()]).exit(), Exit::Well);
    let verdict = card_of(&[gyro(-0.2), velocity]);
    assert_eq!(verdict.exit(), Exit::Incomplete);
    assert!(verdict.channels().iter().all(|c| c.contradicted[0].contains("−200.0 ± ")), "{:?}", verdict.channels());
}

/// Lags that make the circles of position and velocity equally small: both seem to show a bar 15 % shorter.
#[test]
fn lagging_channels_do_not_contradict_the_rig_file() {
    let lagging = |lag_s| BenchSensor { lags_s: vec![lag_s], ..BenchSensor::noisy(100.0, 0.01) };
    let verdict = card_of(&[(BenchChannel::VelocityIns, lagging(0.153)), (BenchChannel::PositionIns, lagging(0.2))]);
    assert_eq!(verdict.channels().len(), 2);
    for channel in verdict.channels() {
        assert!(channel.contradicted.is_empty(), "{channel:?}");
    }
    assert!(!verdict.notices.iter().any(|n| n.code == "rig-contradicted"), "{:?}", verdict.notices);
}

#[test]
fn a_record_without_a_delay_is_a_row_and_no_card_is_made_without_any() {
    let folder = bench();
    let mut asked = order(folder.path(), &["logs/pair/imu.mcap"], "out");
    asked.card = Some(folder.path().join("copy.card.toml"));
    let (verdict, reported) = go_with_events(&asked);
    let failed = vec![("failed", true)];
    assert_eq!(reported, Reported { outcomes: failed, sensor: "M 1".to_owned(), card: None, records: 1, measured: 0 });
    assert!(matches!(&verdict.rows[0].outcome, BenchOutcome::Failed { reason } if reason.contains("--encoder")));
    assert_eq!((verdict.exit(), verdict.card_file), (Exit::Incomplete, None));
    assert!(verdict.page.exists() && !folder.path().join("copy.card.toml").exists());

    asked.encoder = Some(folder.path().join("logs/pair/enc.csv"));
    let (verdict, reported) = go_with_events(&asked);
    let card = Some("m-1.card.toml".to_owned());
    let measured = vec![("measured", false)];
    assert_eq!(reported, Reported { outcomes: measured, sensor: "M 1".to_owned(), card, records: 1, measured: 1 });
    assert_eq!(verdict.exit(), Exit::Well, "{:?}", verdict.rows);
    let copy = std::fs::read(folder.path().join("copy.card.toml")).unwrap();
    assert_eq!(copy, std::fs::read(verdict.card_file.unwrap()).unwrap());
}

#[test]
fn outputs_of_an_earlier_run_are_removed_and_foreign_files_stay() {
    let folder = bench();
    go(&order(folder.path(), &["logs/one.mcap"], "out"), 1).unwrap();
    let out = folder.path().join("out");
    std::fs::write(out.join("records/one.mcap/notes.txt"), "mine").unwrap();
    std::fs::create_dir(out.join("records/one.mcap/figures")).unwrap();
    std::fs::write(out.join("records/one.mcap/figures/old.svg"), "an earlier figure").unwrap();
    std::fs::write(folder.path().join("m.rig.toml"), rig(&simulated(1), "2")).unwrap();
    let other = order(folder.path(), &["logs/pair"], "out");
    let error = go(&other, 1).unwrap_err().to_string();
    assert!(error.contains("one.mcap, not of ") && error.contains("--replace"), "{error}");
    go(&BenchOrder { replace: true, ..other }, 1).unwrap();
    let names: Vec<String> = content(&out).into_keys().filter(|n| !n.ends_with("figures.zip")).collect();
    let pages = ["records/one.mcap/notes.txt", "records/pair/index.html", "records/pair/record.json"];
    assert_eq!(names[..2], ["index.html", "m-2.card.toml"]);
    assert_eq!(names[2..], pages);
    assert!(!out.join("records/one.mcap/figures").exists());
}

#[test]
fn invalid_requests_are_rejected_before_anything_is_measured() {
    let folder = bench();
    let path = folder.path();
    let refused = |order: &BenchOrder, says: &str| {
        let error = go(order, 1).unwrap_err();
        assert_eq!(error.exit(), Exit::Wrong, "{error}");
        assert!(error.to_string().contains(says), "{error}");
    };
    refused(&BenchOrder { rig: None, ..order(path, &["logs"], "out") }, "no rig file");
    std::fs::write(path.join("logs/one.rig.toml"), rig(&simulated(1), "1")).unwrap();
    std::fs::write(path.join("logs/pair/any.rig.toml"), rig(&simulated(1), "2")).unwrap();
    refused(
        &BenchOrder { rig: None, ..order(path, &["logs"], "out") },
        "different sensors according to their rig files: serial `1` and `2`",
    );
    std::fs::write(path.join("bad.rig.toml"), "schema = 1\ncolour = 2\n").unwrap();
    refused(&BenchOrder { rig: Some(path.join("bad.rig.toml")), ..order(path, &["logs"], "out") }, "bad.rig.toml:");
    refused(&order(path, &["logs"], "logs/out"), "must not be inside the folder of the logs");
    refused(&order(path, &["nothing"], "out"), "nothing");
    let two = BenchOrder { encoder: Some(path.join("logs/pair/enc.csv")), ..order(path, &["logs"], "out") };
    refused(&two, "--encoder is for one log");
    std::fs::create_dir_all(path.join("old/.flightlag")).unwrap();
    std::fs::write(path.join("old/.flightlag/lock"), "").unwrap();
    std::fs::write(path.join("old/.flightlag/state.json"), "{}").unwrap();
    refused(&order(path, &["logs"], "old"), "holds the report of a campaign");
}

#[test]
fn each_record_uses_the_rig_file_next_to_it() {
    let folder = bench();
    let path = folder.path();
    std::fs::write(path.join("logs/one.rig.toml"), rig(&simulated(1), "1")).unwrap();
    std::fs::write(path.join("logs/pair.rig.toml"), rig(&simulated(1), "1").replace("Simulated bench", "Another"))
        .unwrap();
    let verdict = go(&BenchOrder { rig: None, ..order(path, &["logs"], "out") }, 2).unwrap();
    assert_eq!(verdict.exit(), Exit::Well, "{:?}", verdict.rows);
    assert_eq!(verdict.card.unwrap().rig, "Another; Simulated bench");
}
