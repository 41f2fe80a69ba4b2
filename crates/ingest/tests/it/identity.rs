//! What logs state about the receiver, its rate and serial line, and about lever arms.

use crate::nmea::sealed;
use crate::stream::*;
use crate::support::*;
use flight::{About, ReceiverIdentity};
use ingest::LogKind;
use simulate::Container;

/// Number, model, firmware, rate and baud as one line.
fn words(receiver: &ReceiverIdentity) -> String {
    let text = |value: &Option<String>| value.clone().unwrap_or_else(|| "-".to_owned());
    let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |value| value.to_string());
    format!(
        "{}: {} | {} | {} | {} Hz | {} baud",
        receiver.number,
        text(&receiver.model),
        text(&receiver.firmware),
        text(&receiver.protocol),
        number(receiver.rate_hz),
        number(receiver.baud.map(f64::from))
    )
}

fn all_of(below: &str) -> Vec<(String, About)> {
    let Some(path) = real_logs(below) else { return vec![] };
    let library = ingest::MapLibrary::shipped().unwrap();
    let units = ingest::discover(&path, &library).unwrap().units;
    units.iter().filter_map(|unit| Some((unit.id.clone(), load(unit).ok()?.health.about))).collect()
}

#[test]
fn real_logs_name_the_receiver_and_its_settings() {
    for (path, reported) in [
        ("DeLorean/data/00000117.BIN", vec!["1: u-blox | - | UBX | 5 Hz | 230400 baud"]),
        ("pymavlink/tests/test.BIN", vec!["1: u-blox 6 | 7.03 (45970) | UBX | 5 Hz | 115200 baud"]),
        ("foxglove-mcap/test_ulog.ulg", vec!["1: u-blox | SPG 5.10 | UBX, version 34.10 | - Hz | - baud"]),
        (
            "px4-ulog-rs/tests/fixtures/quadrotor_local.ulg",
            vec!["1: u-blox | SPG 5.10 | UBX, version 34.10 | - Hz | - baud"],
        ),
        (
            "SSScoring/resources/test-tracks/FS2/01-00-00/TRACK.CSV",
            vec!["1: FlySight 2 | v2024.08.07.release_candidate | - | - Hz | - baud"],
        ),
        (
            "flightlogstats-G1000/flightlogstatsTests/TestAssets/log_220502_095923______.csv",
            vec!["1: Garmin 006-B1177-C1 | 21.50.5 | - | - Hz | - baud"],
        ),
        ("pyulog/test/sample_px4_events.ulg", vec!["1: simulated | - | - | - Hz | - baud"]),
    ] {
        for (_, about) in all_of(path) {
            let found: Vec<String> = about.receiver_identities.iter().map(words).collect();
            assert_eq!(found, reported, "{path}");
        }
    }
}

#[test]
fn a_real_log_states_the_antenna_position() {
    for (_, about) in all_of("px4-ulog-rs/tests/fixtures/esc_status_log.ulg") {
        let arm = about.lever_arm("gps").unwrap();
        assert_eq!((arm.forward_m, arm.parameter.as_str()), (0.0, "EKF2_GPS_POS_X/Y/Z"));
        assert!((arm.right_m - 0.046).abs() < 1e-6, "{arm:?}");
        // Zeros are the default: the IMU's position was never set.
        assert!(about.lever_arms.iter().any(|arm| arm.sensor == "imu") && about.lever_arm("imu").is_none());
    }
}

#[test]
fn a_ubx_log_reports_its_version_message() {
    let loaded = load_written(Container::Ubx, &flight(5.0, 10.0), "flight.ubx", LogKind::Ubx, "ubx");
    let found: Vec<String> = loaded.health.about.receiver_identities.iter().map(words).collect();
    assert_eq!(found, ["1: SIMULATED | SIM CORE 1.00 | UBX | - Hz | - baud"]);
}

#[test]
fn text_sentences_are_reported_like_a_version_message() {
    let fix = "GPRMC,120000.00,A,4723.86520,N,00832.73570,E,0.1,0.0,211126,,,A";
    let texts =
        ["GPTXT,01,01,02,HW  UBX-M8030   00080000", "GPTXT,01,01,02,FWVER=SPG 3.01", "GPTXT,01,01,02,PROTVER=18.00"];
    let lines: String = texts.into_iter().chain([fix; 3]).map(|text| format!("{}\r\n", sealed(text))).collect();
    let log = read_bytes(ingest::LogKind::Nmea, lines.as_bytes()).unwrap();
    let found: Vec<String> = log.health.about.receiver_identities.iter().map(words).collect();
    assert_eq!(found, ["1: u-blox M8 | SPG 3.01 | NMEA, version 18.00 | - Hz | - baud"]);
}

/// `cargo test -p flightlag-ingest --test it -- --ignored --nocapture list_identity_of_all_real_logs` prints it.
#[test]
#[ignore = "a listing to be read: it takes half a minute"]
fn list_identity_of_all_real_logs() {
    for folder in ["DeLorean", "pymavlink", "px4-ulog-rs", "pyulog", "yule_log", "foxglove-mcap", "ALFA", "SSScoring"] {
        for (id, about) in all_of(folder) {
            println!("{folder}/{id}");
            about
                .receiver_identities
                .iter()
                .for_each(|receiver| println!("    {} {:?}", words(receiver), receiver.sources));
            about.lever_arms.iter().for_each(|arm| println!("    {arm:?}"));
        }
    }
}
