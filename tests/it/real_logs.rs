//! Whole campaigns over real logs of others, where they are at hand.

use crate::program::{flightlag, results, text};
use record::{CampaignRecord, FlightRecord, FlightRow, Outcome};
use std::io::Write;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// A folder of the real logs, or a word that the test was skipped.
fn logs(folder: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/logs").join(folder);
    if !path.is_dir() {
        // Straight to standard error: what is printed, the test runner keeps to itself when a test passes.
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
        let out = tempfile::tempdir().unwrap();
        let (flights, folder) = (flights.as_os_str(), out.path().as_os_str());
        let output =
            flightlag(["campaign".as_ref(), flights, "--out".as_ref(), folder, "--quiet".as_ref()]).output().unwrap();
        let campaign =
            std::fs::read(out.path().join("campaign.json")).unwrap_or_else(|e| panic!("{e}: {}", text(&output.stderr)));
        Report { exit: output.status.code(), campaign: serde_json::from_slice(&campaign).unwrap(), out }
    }

    fn row(&self, flight: &str) -> &FlightRow {
        self.campaign.flights.iter().find(|f| f.flight == flight).unwrap_or_else(|| panic!("no flight {flight}"))
    }

    fn record(&self, flight: &str) -> FlightRecord {
        let page = self.out.path().join(&self.row(flight).page);
        serde_json::from_slice(&std::fs::read(page.with_file_name("record.json")).unwrap()).unwrap()
    }
}

/// One real flight in nine containers: what was found is the same to the last bit.
#[test]
fn the_intact_containers_of_a_real_flight_give_one_record_apart_from_provenance() {
    let Some(folder) = logs("derived-alfa") else { return };
    let report = Report::of(&folder);
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
    // An unindexed bag holds all messages too; that nobody closed it is a loss all the same.
    assert_eq!(report.record("alfa_lz4_unindexed.bag").replay, first.replay);
}

/// Recoverable messages by the independent salvage that came with the logs.
#[test]
fn damaged_copies_of_a_real_flight_give_what_is_left_and_a_red_mark() {
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
        assert_eq!(b.decoded + b.skipped + b.structure + b.damaged, b.size, "{name}");
        assert!(report.row(name).lossy, "{name} is marked");
    }
}

/// Whatever is in these folders: a result or a reason for each flight, and no panic.
#[test]
fn every_real_flight_gets_a_result_or_a_reason() {
    for folder in [
        "ALFA",
        "PyFlightCoach-FlightData",
        "SSScoring",
        "pyflysight",
        "flightlogstats-G1000",
        "aircraft-polar",
        "PlotJuggler",
        "embag",
        "robot_localization",
        "keelson",
        "mcap-crate",
        "foxglove-mcap",
    ] {
        let Some(folder) = logs(folder) else { return };
        let report = Report::of(&folder);
        assert!(matches!(report.exit, Some(0 | 3)), "{}: exit {:?}", folder.display(), report.exit);
        for row in &report.campaign.flights {
            match &row.outcome {
                Outcome::Compensated => assert!(row.correction_rms_m.is_some(), "{}", row.flight),
                Outcome::NotMeasurable { reason } | Outcome::Failed { reason } => {
                    assert!(!reason.is_empty() && !reason.contains("panicked"), "{}: {reason}", row.flight);
                }
            }
        }
        assert!(!results(report.out.path()).is_empty());
    }
}

/// The reference delays of these logs are stated beside them; these are facts of the logs, not of us.
#[test]
fn the_real_mti_g_that_does_not_travel_is_not_measurable() {
    let Some(folder) = logs("PlotJuggler") else { return };
    let report = Report::of(&folder);
    let row = report.row("datasamples/tilt_laser.bag");
    assert!(matches!(&row.outcome, Outcome::NotMeasurable { reason } if reason.contains("does not travel")), "{row:?}");
    assert_eq!(row.map.as_deref(), Some("xsens-mtig"));
}
