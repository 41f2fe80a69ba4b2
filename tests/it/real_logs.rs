//! Whole campaigns over real logs from other sources, if available.

use crate::program::{flightlag, results, text};
use record::{CampaignRecord, EffectVerdict, Finding, FlightRecord, FlightRow, Outcome};
use std::io::Write;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// A folder of real logs, or a message that the test was skipped.
fn logs(folder: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/logs").join(folder);
    if !path.is_dir() {
        // Directly to standard error: the test runner hides standard output of tests that pass.
        let _ = writeln!(std::io::stderr(), "skipped: {} is not there", path.display());
        return None;
    }
    Some(path)
}

struct Report {
    out: TempDir,
    exit: Option<i32>,
    campaign: CampaignRecord,
}

impl Report {
    fn of(flights: &Path) -> Report {
        Report::with(flights, "schema = 1\n")
    }

    /// With a stated delay, s.
    fn stated(flights: &Path, delay_s: f64) -> Report {
        Report::with(flights, &format!("schema = 1\n[delay]\nposition_s = {delay_s}\nsource = \"stated\"\n"))
    }

    fn with(flights: &Path, pipeline: &str) -> Report {
        let out = tempfile::tempdir().unwrap();
        let settings = tempfile::tempdir().unwrap();
        let file = settings.path().join("p.toml");
        std::fs::write(&file, pipeline).unwrap();
        let (flights, folder, file) = (flights.as_os_str(), out.path().as_os_str(), file.as_os_str());
        let arguments =
            ["campaign".as_ref(), flights, "--out".as_ref(), folder, "--quiet".as_ref(), "--pipeline".as_ref(), file];
        let output = flightlag(arguments).output().unwrap();
        let campaign = campaign::read_report(out.path()).unwrap();
        let campaign = campaign.unwrap_or_else(|| panic!("no report: {}", text(&output.stderr)));
        Report { exit: output.status.code(), campaign, out }
    }

    fn row(&self, flight: &str) -> &FlightRow {
        self.campaign.flights.iter().find(|f| f.flight == flight).unwrap_or_else(|| panic!("no flight {flight}"))
    }

    fn record(&self, flight: &str) -> FlightRecord {
        let page = self.out.path().join(&self.row(flight).page);
        serde_json::from_slice(&campaign::record_of_page(&page).unwrap().unwrap()).unwrap()
    }
}

/// One real flight in nine containers: the findings are bit-identical.
#[test]
fn intact_containers_of_a_real_flight_give_one_record() {
    let Some(folder) = logs("derived-alfa") else { return };
    let report = Report::stated(&folder, 0.2166);
    let intact = [
        "alfa_none.bag",
        "alfa_bz2.bag",
        "alfa_lz4.bag",
        "alfa_ros1_none.mcap",
        "alfa_ros1_lz4.mcap",
        "alfa_ros1_zstd.mcap",
        "alfa_ros1_unchunked.mcap",
        "alfa_ros1_nosummary.mcap",
        "alfa_mcap_ros2/alfa_mcap_ros2.mcap",
    ];
    let first = report.record(intact[0]);
    assert_eq!(first.outcome, Outcome::Compensated);
    for name in intact {
        let record = report.record(name);
        assert_eq!(record.replay, first.replay, "{name}");
        assert_eq!(record.log.unwrap().messages, 2196, "{name}");
        assert!(!report.row(name).lossy, "{name} is whole");
    }
    // An unindexed bag contains all messages too; that it was never closed is still a loss.
    assert_eq!(report.record("alfa_lz4_unindexed.bag").replay, first.replay);
}

/// Recoverable messages according to the independent salvage supplied with the logs.
#[test]
fn damaged_copies_of_a_real_flight_are_salvaged_and_marked_red() {
    let Some(folder) = logs("derived-alfa") else { return };
    let report = Report::of(&folder);
    assert_eq!(report.exit, Some(3));
    for (name, least) in [
        ("alfa_none_trunc60.bag", 1149),
        ("alfa_bz2_trunc60.bag", 1149),
        ("alfa_lz4_unindexed.bag", 2196),
        ("alfa_bz2_bitflip.bag", 1809),
        ("alfa_ros1_none_trunc60.mcap", 1266),
        ("alfa_ros1_zstd_bitflip.mcap", 837),
        ("alfa_ros1_none_tailjunk.mcap", 2196),
    ] {
        let log = report.record(name).log.unwrap();
        assert!(log.messages >= least, "{name}: {} messages, {least} can be recovered", log.messages);
        let b = log.bytes;
        assert_eq!(b.sum(), b.size, "{name}");
        // Junk after the last record is less than 0.1 % of the log and leaves no long gap: a minor loss, shown in
        // amber.
        let row = report.row(name);
        assert!(row.lossy || row.minor_loss, "{name} is marked as lossy");
    }
}

/// Delays of a position against a velocity by another estimator, from `REFERENCE.csv`: folder, flight, position,
/// velocity, ms, their standard error in ms. Those of the DeLorean flights, against truth, are below; comma2k19 is not
/// read.
const REFERENCE: &[(&str, &str, &str, &str, f64, f64)] = &[
    ("ALFA", "alfa-cpp/csv/carbonZ_2018-07-18-15-53-31_1_engine_failure", GPS.0, GPS.1, 4.0, 3.5),
    ("ALFA", "alfa-cpp/csv/carbonZ_2018-07-18-15-53-31_1_engine_failure", GPS.0, "velocity.ekf", 216.6, 15.6),
    ("PyFlightCoach-FlightData", "test/ekfv3_test.csv", GPS.0, "velocity.ekf", 152.6, 3.7),
    ("PyFlightCoach-FlightData", "test/ekfv3_test.csv", "position.ekf", "velocity.ekf", -19.3, 3.7),
    ("flightlogstats-G1000", "flightlogstatsTests/TestAssets/log_210623_141501_TEST1.csv", GPS.0, GPS.1, -504.6, 2.1),
    ("flightlogstats-G1000", "flightlogstatsTests/TestAssets/log_220417_125002_LFQA.csv", GPS.0, GPS.1, -511.4, 8.0),
    ("px4-ulog-rs/tests/fixtures/esc_status_log.ulg", "esc_status_log.ulg", GPS.0, GPS.1, -1.4, 6.7),
    ("px4-ulog-rs/tests/fixtures/esc_status_log.ulg", "esc_status_log.ulg", GPS.0, "velocity.ekf", 40.3, 18.3),
    ("aircraft-polar", "data/flight3", GPS.0, GPS.1, -29.6, 5.5),
    ("aircraft-polar", "data/flight3", GPS.0, "velocity.ekf", 92.0, 10.8),
    ("InertialNav", "code/InputFilesPX4_search.zip", GPS.0, GPS.1, -57.9, 13.4),
    ("InertialNav", "code/quad106.zip", GPS.0, GPS.1, -104.5, 27.1),
    ("SSScoring", "legacy/data-sources/ciurana/16-35-32.CSV", GPS.0, GPS.1, 2.0, 5.9),
    ("SSScoring", "legacy/data-sources/ciurana/17-46-49.CSV", GPS.0, GPS.1, -12.5, 6.0),
    ("SSScoring", "resources/quickstart-example/R1_09-20-26.CSV", GPS.0, GPS.1, -23.3, 3.0),
    ("SSScoring", "resources/test-tracks/FS1/test-data-00.CSV", GPS.0, GPS.1, -13.3, 12.8),
    ("SSScoring", "resources/test-tracks/FS1/test-data-02.CSV", GPS.0, GPS.1, -20.8, 8.1),
    ("SSScoring", "resources/test-tracks/FS2/01-00-00/TRACK.CSV", GPS.0, GPS.1, -22.3, 5.6),
    ("SSScoring", "resources/test-tracks/INSIGHT/gps_00105.csv", GPS.0, GPS.1, -9.7, 7.4),
    ("SSScoring", "resources/test-tracks/INSIGHT/gps_00106.csv", GPS.0, GPS.1, -1.6, 2.5),
];
const GPS: (&str, &str) = ("position.gps", "velocity.gps");

/// Every delay of this folder is within three combined standard errors of the reference, or 10 ms.
fn assert_near_reference(report: &Report, folder: &str) {
    for (_, flight, position, velocity, ms, se_ms) in REFERENCE.iter().filter(|r| r.0 == folder) {
        let pairs = report.record(flight).delays.unwrap().pairs;
        let pair = pairs.iter().find(|p| p.first == *position && p.second == *velocity).unwrap();
        let Finding::Found(found) = &pair.delay else { panic!("{flight}: {pair:?}") };
        let (own, own_se) = (1e3 * found.delay_s.value, 1e3 * found.delay_s.standard_uncertainty.unwrap());
        let within = (3.0 * own_se.hypot(*se_ms)).max(10.0);
        assert!((own - ms).abs() <= within, "{flight}, {velocity}: {own} ± {own_se} ms, reference {ms} ± {se_ms} ms");
    }
}

/// All flights of these folders: a result or a reason each, no panic, and delays that agree with other measurements.
#[test]
fn every_real_flight_gets_a_result_or_a_reason_and_agrees_with_reference() {
    for folder in [
        "ALFA",
        "PyFlightCoach-FlightData",
        "SSScoring",
        "pyflysight",
        "flightlogstats-G1000",
        "aircraft-polar",
        "InertialNav",
        "PlotJuggler",
        "embag",
        "robot_localization",
        "keelson",
        "mcap-crate",
        "foxglove-mcap",
    ] {
        let Some(path) = logs(folder) else { return };
        let report = Report::of(&path);
        assert!(matches!(report.exit, Some(0 | 3)), "{folder}: exit {:?}", report.exit);
        assert_eq!(report.campaign.totals.harmed, 0, "{folder}: the default makes no flight worse");
        for row in &report.campaign.flights {
            match &row.outcome {
                Outcome::Compensated => assert!(row.correction_rms_m.is_some(), "{}", row.flight),
                Outcome::Uncompensated { reason }
                | Outcome::NotMeasurable { reason }
                | Outcome::Pending { reason }
                | Outcome::Failed { reason } => {
                    assert!(!reason.is_empty() && !reason.contains("panicked"), "{}: {reason}", row.flight);
                }
            }
        }
        assert!(!results(report.out.path()).is_empty());
        assert_near_reference(&report, folder);
    }
}

/// The reference delays of these logs are stated in a file next to them; they are facts about the logs, not our
/// results.
#[test]
fn a_real_mti_g_that_does_not_travel_is_not_measurable() {
    let Some(folder) = logs("PlotJuggler") else { return };
    let report = Report::of(&folder);
    let row = report.row("datasamples/tilt_laser.bag");
    assert!(matches!(&row.outcome, Outcome::NotMeasurable { reason } if reason.contains("does not travel")), "{row:?}");
    assert_eq!(row.map.as_deref(), Some("xsens-mtig"));
}

/// The same flight as ROS 2 bags in SQLite: plain, compressed per message, compressed per file.
#[test]
fn ros_2_bags_of_a_real_flight_give_the_same_record_as_its_ros_1_bag() {
    let Some(folder) = logs("derived-alfa") else { return };
    let report = Report::stated(&folder, 0.2166);
    let first = report.record("alfa_none.bag");
    for name in [
        "alfa_db3/alfa_db3.db3",
        "alfa_db3_msgzstd/alfa_db3_msgzstd.db3",
        "alfa_db3_filezstd/alfa_db3_filezstd.db3.zstd",
    ] {
        let record = report.record(name);
        assert_eq!(record.replay, first.replay, "{name}");
        assert_eq!(record.log.unwrap().messages, 2196, "{name}");
        assert!(!report.row(name).lossy, "{name} is whole");
    }
}

/// Truth of the DeLorean flights, s.
const DELOREAN_S: f64 = 0.2033;

/// Lateness without the reference: within 15 ms of the truth, inside the interval; the default reduces the error to
/// what the true delay would leave.
#[test]
fn lateness_of_a_simulated_copter_is_found_and_removed_by_default() {
    let Some(folder) = logs("DeLorean") else { return };
    let report = Report::of(&folder);
    let moving: Vec<&FlightRow> =
        report.campaign.flights.iter().filter(|r| r.outcome == Outcome::Compensated).collect();
    assert_eq!(moving.len(), 8);
    for row in moving {
        let found = row.lateness.as_ref().unwrap().lateness.as_ref().unwrap();
        let [low, high] = found.interval_95_s;
        assert!((found.lateness_s.value - DELOREAN_S).abs() < 0.015, "{}: {:?}", row.flight, found.lateness_s);
        assert!(low <= DELOREAN_S && DELOREAN_S <= high, "{}: {low} to {high}", row.flight);
        let effect = row.effect.as_ref().unwrap();
        assert_eq!(effect.verdict, EffectVerdict::Helped, "{}: {}", row.flight, effect.words);
        let (after, best) = (effect.error_compensated_m.unwrap().value, effect.best_m.unwrap());
        assert!(after < 1.3 * best, "{}: {after} m, where {best} m is possible", row.flight);
    }
    assert_eq!(report.campaign.totals.harmed, 0);
}

/// Whatever delay is stated for these flights, each flight it harms is reported as such.
#[test]
fn a_stated_delay_that_harms_a_flight_is_reported_and_ends_with_4() {
    for folder in ["SSScoring", "flightlogstats-G1000"] {
        let Some(path) = logs(folder) else { return };
        let report = Report::stated(&path, 0.4);
        assert_eq!(report.exit, Some(4), "{folder}");
        for row in report.campaign.flights.iter().filter(|r| r.outcome == Outcome::Compensated) {
            let apart = row.lateness.as_ref().unwrap().position_minus_velocity_s;
            let harmed = row.effect.as_ref().unwrap().verdict == EffectVerdict::Harmed;
            let surely = apart.is_some_and(|e| e.value + 3.0 * e.standard_uncertainty.unwrap() < 0.19);
            assert!(harmed || !surely, "{}: {:?} {:?}", row.flight, apart, row.effect);
        }
    }
}

/// ArduCopter in its simulator: the receiver is one period of 200 ms late. An independent estimate against the
/// simulator's truth is 203.3 ms (203.2 to 203.6).
#[test]
fn a_simulated_copters_receiver_is_one_period_late_if_it_moves() {
    let Some(folder) = logs("DeLorean") else { return };
    let report = Report::of(&folder);
    for number in ["002", "117", "129", "130", "131", "135", "139", "143", "159", "160", "161"] {
        let name = format!("data/00000{number}.BIN");
        let record = report.record(&name);
        assert_eq!(report.row(&name).map.as_deref(), Some("ardupilot"), "{name}");
        let pairs = record.delays.unwrap().pairs;
        let pair = pairs.iter().find(|p| p.first == "position.gps" && p.second == "position.truth").unwrap();
        match &pair.delay {
            Finding::Found(delay) => {
                assert!(!["131", "135", "143"].contains(&number), "{name} does not move");
                assert!((delay.delay_s.value - 0.2033).abs() < 0.01, "{name}: {:?}", delay.delay_s);
            }
            Finding::CannotTell(reason) => {
                assert!(
                    ["131", "135", "143"].contains(&number) && reason.contains("does not travel"),
                    "{name}: {reason}"
                );
            }
        }
        let about = record.log.unwrap().about;
        assert_eq!(about.system.as_deref(), Some("ArduCopter"), "{name}");
        let simulated = about.configured_delays.iter().find(|d| d.parameter == "SIM_GPS_DELAY").unwrap();
        assert_eq!(simulated.value_s, 0.2, "{name}");
    }
}

/// All of a ULog, with every topic decoded.
fn ulog(path: &Path) -> ingest::Log {
    let want = |_: &ingest::TopicInfo| ingest::Selection::All;
    let cancel = std::sync::atomic::AtomicBool::new(false);
    let context = ingest::ReadContext { limits: ingest::Limits::default(), cancel: &cancel, on_bytes: &|_| () };
    let log = ingest::read_files(ingest::LogKind::Ulog, &[path.to_owned()], &want, &context).unwrap();
    let b = &log.health.bytes;
    assert_eq!(b.sum(), b.size, "{}", path.display());
    log
}

/// The values of a field summed in log order, so that every bit counts.
fn sum_of(log: &ingest::Log, topic: &str, field: &str) -> f64 {
    let table = log.tables.iter().find(|t| t.topic.name == topic).unwrap();
    let column = table.column(field).unwrap();
    (0..table.rows).map(|row| column.number(row).unwrap()).sum()
}

/// Rows, parameters and texts that pyulog 1.3.0 finds, and the sum of one field.
#[test]
fn intact_ulogs_match_pyulog() {
    let expected = [
        ("foxglove-mcap/test_ulog.ulg", 4272, 1157, 7, "vehicle_attitude", "q[3]", -30.415_827_901_684_68),
        (
            "px4-ulog-rs/tests/fixtures/6ba1abc7-b433-4029-b8f5-3b2bb12d3b6c.ulg",
            20390,
            544,
            2,
            "vehicle_attitude",
            "q[3]",
            129.924_094_125_628_47,
        ),
        (
            "px4-ulog-rs/tests/fixtures/esc_status_log.ulg",
            8200,
            759,
            0,
            "vehicle_attitude",
            "q[3]",
            -724.273_666_295_222_9,
        ),
        (
            "px4-ulog-rs/tests/fixtures/quadrotor_local.ulg",
            63011,
            1116,
            11,
            "sensor_combined",
            "gyro_rad[0]",
            19.967_310_678_159_265,
        ),
        ("pyulog/test/sample.ulg", 64542, 493, 4, "vehicle_attitude", "q[3]", -1_948.757_425_308_227_5),
        ("pyulog/test/sample_appended_multiple.ulg", 6852, 750, 1, "vehicle_attitude", "q[3]", 197.555_716_633_796_7),
        ("pyulog/test/sample_first_version.ulg", 14317, 408, 0, "vehicle_attitude", "q[3]", 1_361.683_383_464_813_2),
        ("pyulog/test/sample_log_small.ulg", 14604, 980, 3, "vehicle_attitude", "q[3]", 64.354_977_110_400_8),
        (
            "pyulog/test/sample_logging_tagged_and_default_params.ulg",
            21229,
            696,
            7,
            "sensor_combined",
            "gyro_rad[0]",
            0.442_083_057_392_335_9,
        ),
        ("pyulog/test/sample_px4_events.ulg", 29480, 875, 18, "vehicle_attitude", "q[3]", 6.198_285_951_162_688),
        ("yule_log/core/data/powers.ulg", 20, 0, 0, "powers_of_2", "value", 1023.0),
        ("yule_log/core/data/short_list.ulg", 10, 0, 0, "list_data", "list[1]", 460.0),
    ];
    let Some(folder) = logs("") else { return };
    for (file, rows, parameters, texts, topic, field, sum) in expected {
        let log = ulog(&folder.join(file));
        assert_eq!(log.tables.iter().map(|t| t.rows).sum::<usize>(), rows, "{file}");
        assert_eq!((log.health.messages, log.health.undecodable), (rows as u64, 0), "{file}");
        let about = &log.health.about;
        assert_eq!((about.parameters, about.texts.len()), (parameters, texts), "{file}");
        assert_eq!(sum_of(&log, topic, field), sum, "{file}: {topic}.{field}");
        // Its last message is truncated, which pyulog does not report.
        let cut = file.ends_with("sample_first_version.ulg");
        assert_eq!((log.health.bytes.tail_cut > 0, log.notices.any_loss()), (cut, false), "{file}: {:?}", log.notices);
    }
}

/// Rows that pyulog 1.3.0 can recover.
#[test]
fn damaged_ulogs_give_at_least_as_much_as_pyulog() {
    let Some(folder) = logs("px4-ulog-rs/tests/fixtures") else { return };
    for (file, least) in [("corrupt_actuator_armed_wrong_size.ulg", 9539), ("corrupt_format_not_utf8.ulg", 61_964)] {
        let log = ulog(&folder.join(file));
        assert!(log.health.messages >= least, "{file}: {}", log.health.messages);
        assert!(log.notices.any_loss(), "{file}");
    }
}

/// The lines of the text files next to the logs, with second, level and text; except those of events (without a module
/// in brackets), whose text is not in the log.
#[test]
fn logged_texts_match_the_text_files_of_the_ulogs() {
    let Some(folder) = logs("pyulog/test") else { return };
    for name in [
        "sample",
        "sample_appended_multiple",
        "sample_log_small",
        "sample_logging_tagged_and_default_params",
        "sample_px4_events",
    ] {
        let ours = ulog(&folder.join(format!("{name}.ulg"))).health.about.texts;
        let plain = |text: &String| {
            let (stamp, rest) = text.split_once(" s ").unwrap();
            let seconds: u64 = stamp.split_once('.').unwrap().0.parse().unwrap();
            let (level, words) = rest.split_once(": ").unwrap();
            let level = level.split(' ').next().unwrap();
            format!("{}:{:02}:{:02} {level}: {words}", seconds / 3600, seconds / 60 % 60, seconds % 60)
        };
        let ours: Vec<String> = ours.iter().map(plain).collect();
        let expected = std::fs::read_to_string(folder.join(format!("{name}_messages.txt"))).unwrap();
        for line in expected.lines().filter(|line| line.contains(": [")) {
            assert!(ours.iter().any(|text| text == line), "{name}: {line:?} is not among {ours:?}");
        }
    }
}

/// The output of pyulog's `ulog_info`, from text files next to the logs: information, messages and bytes of every
/// topic, dropouts.
#[test]
fn information_counts_and_dropouts_match_ulog_info() {
    let Some(folder) = logs("pyulog/test") else { return };
    for (name, lines, topics) in [("sample", 4, 15), ("sample_appended_multiple", 90, 20)] {
        let log = ulog(&folder.join(format!("{name}.ulg")));
        let text = std::fs::read_to_string(folder.join(format!("{name}_info.txt"))).unwrap();
        let (head, table) = text.split_once("Name (multi id").unwrap();
        let information: Vec<&str> = head.lines().filter_map(|line| line.strip_prefix(' ')).collect();
        for line in &information {
            // For a value logged in parts, the number of parts is listed.
            let parts = format!("{} (", line.split(':').next().unwrap());
            let listed = log.health.extras.iter().any(|extra| extra == line || extra.starts_with(&parts));
            assert!(listed, "{name}: {line:?}");
        }
        let rows: Vec<Vec<&str>> = table.lines().skip(1).map(|row| row.split_whitespace().collect()).collect();
        for row in &rows {
            let [topic, id, _size, messages, bytes] = row.as_slice() else { panic!("{name}: {row:?}") };
            let id = id.trim_matches(['(', ',']);
            let full = if id == "0" { (*topic).to_owned() } else { format!("{topic}_{id}") };
            let ours = log.health.topics.iter().find(|t| t.name == full && t.type_name == *topic).unwrap();
            assert_eq!(
                (ours.messages, ours.payload_bytes),
                (messages.parse().unwrap(), bytes.parse().unwrap()),
                "{full}"
            );
        }
        assert_eq!((information.len(), log.health.extras.len(), rows.len()), (lines, lines, topics), "{name}");
        let dropouts = log.notices.iter().find(|n| n.code == "dropout");
        match head.lines().find_map(|line| line.strip_prefix("Dropouts: count: ")) {
            Some(stated) => {
                let (count, rest) = stated.split_once(',').unwrap();
                let longest = rest.split_once("max: ").unwrap().1.split(',').next().unwrap();
                let ours = dropouts.unwrap();
                assert_eq!(ours.count.to_string(), count, "{name}");
                assert!(ours.text.contains(&format!("the longest {longest}")), "{name}: {}", ours.text);
            }
            None => assert_eq!(dropouts, None, "{name}"),
        }
    }
}

/// The CSV exports next to the logs of yule_log, cell by cell; two of them omit the first sample.
#[test]
fn values_match_the_csv_exports_of_the_ulogs() {
    let Some(folder) = logs("yule_log/core") else { return };
    for (log, table, left_out) in [
        ("data/powers", "data/powers", 1),
        ("data/powers", "data/powers_export", 0),
        ("data/short_list", "data/short_list_export", 0),
        ("data/trig_stats", "data/trig_stats", 1),
        ("data/trig_stats", "data/trig_stats_export", 0),
        ("test_data/input/powers", "test_data/output/powers_export", 0),
        ("test_data/input/short_list", "test_data/output/short_list_export", 0),
        ("test_data/input/trig_stats", "test_data/output/trig_stats_export", 0),
    ] {
        let log = ulog(&folder.join(format!("{log}.ulg")));
        let text = std::fs::read_to_string(folder.join(format!("{table}.csv"))).unwrap();
        let cells: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
        for (column, name) in cells[0].iter().enumerate().skip(1) {
            let expected: Vec<String> = cells[1..]
                .iter()
                .filter(|c| !c[column].is_empty())
                .map(|c| format!("{} {}", c[0], c[column]))
                .collect();
            let (topic, field) = name.split_once('/').unwrap();
            let field = match field.split_once('.') {
                Some((array, index)) => format!("{array}[{}]", index.parse::<usize>().unwrap()),
                None => field.to_owned(),
            };
            let ours = log.tables.iter().find(|t| t.topic.name == topic).unwrap();
            let (stamps, values) = (ours.logged_ns.as_ref().unwrap(), ours.column(&field).unwrap());
            let line = |row: usize| {
                let us = stamps[row] / 1000;
                format!("{}.{:06} {:.9}", us / 1_000_000, us % 1_000_000, values.number(row).unwrap())
            };
            assert_eq!((left_out..ours.rows).map(line).collect::<Vec<_>>(), expected, "{table}: {name}");
        }
    }
}

#[test]
fn the_delays_of_a_real_px4_flight_agree_with_the_reference() {
    let file = "px4-ulog-rs/tests/fixtures/esc_status_log.ulg";
    let Some(folder) = logs("") else { return };
    let report = Report::of(&folder.join(file));
    assert_eq!(report.row("esc_status_log.ulg").map.as_deref(), Some("px4-ulog"));
    assert_near_reference(&report, file);
    let configured = report.record("esc_status_log.ulg").log.unwrap().about.configured_delays;
    assert_eq!(configured.iter().find(|d| d.parameter == "EKF2_GPS_DELAY").unwrap().value_s, 0.11);
}
