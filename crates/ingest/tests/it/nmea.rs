//! NMEA 0183: a simulated flight, sentences of other tools, and all kinds of damage.

use crate::made::lost;
use crate::stream::*;
use crate::support::*;
use flight::{Clock, Severity, Stamp, StampKind};
use ingest::{Log, LogKind};
use simulate::Container;

const READER: ingest::LogKind = ingest::LogKind::Nmea;

fn text(lines: &[&str]) -> Log {
    read_bytes(READER, (lines.join("\r\n") + "\r\n").as_bytes()).unwrap()
}

pub fn sealed(body: &str) -> String {
    format!("${body}*{:02X}", body.bytes().fold(0, |sum, byte| sum ^ byte))
}

#[test]
fn a_simulated_flight_survives_within_the_resolution_of_its_sentences() {
    let flight = flight(20.0, 50.0);
    let truth = flight.to_flight().unwrap();
    for name in ["flight.nmea", "flight.txt"] {
        let loaded = load_written(Container::Nmea, &flight, name, LogKind::Nmea, "nmea");
        let channel = |name: &str| &loaded.flight.channels[name];
        let timeline = channel("position.gps").series.timeline();
        assert_eq!((timeline.kind(), timeline.clock()), (StampKind::Measured, Clock::Unix));
        let (position, late) = worst(channel("position.gps"), &truth.channels["position.gps"], |ns| ns);
        let half = (0.5001e-5_f64 / 60.0).to_radians();
        assert!(position[0] > 0.0 && position[0] <= half && position[1] <= half, "{position:?}");
        assert!(position[2] > 0.0 && position[2] <= 0.000_500_1 && late <= 500_000, "{position:?} {late}");
        // Half a quantum of speed, and of track at the speed of this flight.
        let speed = 0.5001e-4 * 1852.0 / 3600.0;
        let fastest = truth.channels["velocity.gps"].series.components()[..2]
            .iter()
            .flat_map(|c| c.iter().map(|v| v.abs()))
            .fold(0.0, f64::max);
        let (velocity, late) = worst(channel("velocity.gps"), &truth.channels["velocity.gps"], |ns| ns);
        let most = speed + 0.5001e-4_f64.to_radians() * fastest * 1.5;
        assert!(velocity[0] > 0.0 && velocity[0] <= most && velocity[1] <= most, "{velocity:?} of {most}");
        assert!(late <= 500_000);
        assert_eq!(loaded.health.about.texts, ["simulated receiver"]);
    }
}

/// Ashtech receivers also send positions as `PASHR,POS`.
#[test]
fn only_pashr_with_a_true_heading_is_an_attitude() {
    let attitude = sealed("PASHR,120000.00,123.45,T,1.50,-2.50,0.10,0.2,0.2,0.3,2,1");
    let position =
        sealed("PASHR,POS,0,07,120000.00,5200.000000,N,00400.000000,E,0030.00,,123.4,010.2,+00.1,1.9,1.0,1.6,1.2,1");
    let gga = sealed("GGA,120000.00,5200.0000,N,00400.0000,E,1,08,1.0,30.0,M,45.0,M,,").replacen('$', "$GP", 1);
    let rows = |sentence: &str| {
        let body = gga.trim_start_matches('$').split('*').next().unwrap().to_owned();
        let log = text(&[&sealed(&body), sentence, &sealed(&body)]);
        log.tables.iter().filter(|table| table.topic.name.contains("PASHR")).map(|table| table.rows).sum::<usize>()
    };
    assert_eq!((rows(&attitude), rows(&position)), (1, 0));
}

#[test]
fn sentences_without_their_dollar_are_read_if_the_checksum_matches() {
    let lines: Vec<String> = (0..5)
        .map(|i| sealed(&format!("GPGGA,12351{i}.00,4807.03{i}0,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,")))
        .collect();
    let with: Vec<&str> = lines.iter().map(String::as_str).collect();
    let without: Vec<&str> = with.iter().map(|line| &line[1..]).collect();
    let (a, b) = (text(&with), text(&without));
    assert_eq!(b.tables, a.tables);
    assert_eq!((b.health.bytes.damaged, b.health.bytes.decoded), (0, a.health.bytes.decoded - 5));
    let reported = b.notices.iter().find(|n| n.code == "read-leniently").unwrap();
    assert_eq!(reported.count, 5);
    let (folder, _path) = file("track.txt", (without.join("\r\n") + "\r\n").as_bytes());
    let found = ingest::discover(folder.path(), &ingest::MapLibrary::shipped().unwrap()).unwrap();
    assert_eq!(found.units.iter().map(|unit| unit.kind).collect::<Vec<_>>(), [LogKind::Nmea]);
    // A wrong checksum is not accepted, and after sentences with a `$` one without it is a fragment.
    let wrong = without[2].replace("545.4", "545.5");
    assert!(text(&[without[0], without[1], &wrong, without[3]]).health.bytes.damaged > 60);
    assert!(text(&[with[0], with[1], without[2]]).health.bytes.damaged > 60);
}

#[test]
fn sentences_of_real_receivers_have_the_values_that_pynmeagps_reads() {
    // pynmeagps 1.1.8: the same sentences give these degrees, rounded to 10 digits.
    let log = text(&[
        "$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47",
        "$GNRMC,103607.00,A,5327.03942,N,00214.42462,W,0.046,,060321,,,A,V*0F",
        "$GNGLL,5327.04319,N,00214.41396,W,223232.00,A,A*67",
        "$GPVTG,054.7,T,034.4,M,005.5,N,010.2,K*48",
        "$GPGSV,3,1,11,03,03,111,00,04,15,270,00,06,01,010,00,13,06,292,00*74",
    ]);
    assert_eq!(log.health.bytes.damaged, 0, "{:?}", log.health.damage);
    let number = |topic, field| values(&log, topic, field)[0];
    assert_eq!(number("GPGGA", "latitude"), Some(48.1173));
    assert!((number("GNRMC", "longitude").unwrap() + 2.240_410_333_3).abs() < 1e-10);
    assert!((number("GNGLL", "latitude").unwrap() - 53.450_719_833_3).abs() < 1e-10);
    assert_eq!(
        ["altitude", "separation", "satellites", "hdop"].map(|f| number("GPGGA", f)),
        [Some(545.4), Some(46.9), Some(8.0), Some(0.9)]
    );
    assert_eq!((number("GNRMC", "speed"), number("GPVTG", "track")), (Some(0.046), Some(54.7)));
    assert_eq!((messages(&log, "GPGSV"), log.tables.len()), (1, 4));
    // Slow: no track, and so no velocity.
    assert!(table(&log, "GNRMC").column("track").is_none());
    // date -u -d '2021-03-06T10:36:07Z' +%s
    let utc = |topic| table(&log, topic).column("utc_ns").unwrap().integer(0).unwrap();
    assert_eq!(utc("GNRMC"), 1_615_026_967_000_000_000);
    // GGA before any date: 12:35:19 is nearest on the same day.
    assert_eq!(utc("GPGGA") - utc("GNRMC"), 7_152_000_000_000);
    assert!(codes(&log).contains(&"undated"));
}

#[test]
fn a_slow_epoch_has_a_position_and_no_velocity() {
    let mut lines = vec![];
    for second in 0..20 {
        let track = if second < 5 { "" } else { "90.0" };
        lines.push(sealed(&format!("GPRMC,1200{second:02},A,,,,,1.0,{track},211126,,")));
        lines.push(sealed(&format!("GPGGA,1200{second:02},4807.038,N,01131.0{second:02},E,1,08,0.9,5.4,M,46.9,M,,")));
    }
    let (_folder, path) = file("slow.nmea", lines.join("\r\n").as_bytes());
    let unit = ingest::FlightUnit { id: "slow".into(), files: vec![path], kind: ingest::LogKind::Nmea };
    let loaded = load(&unit).unwrap();
    let of = |name: &str| loaded.flight.channels[name].series.len();
    assert_eq!((of("position.gps"), of("velocity.gps")), (20, 15));
    let rejected = loaded.flight.notices.iter().find(|n| n.code == "rejected-row").unwrap();
    assert_eq!((rejected.count, rejected.text.contains("track is missing")), (5, true), "{}", rejected.text);
    // Above the ellipsoid.
    assert_eq!(loaded.flight.channels["position.gps"].series.component(2)[0], 5.4 + 46.9);
}

/// RMC and VTG of twenty seconds at these speeds, without a track.
fn load_trackless(speed: impl Fn(usize) -> &'static str) -> ingest::Loaded {
    let lines = |second: usize| {
        let (at, minute, speed) = (format!("1200{second:02}"), format!("01131.0{second:02}"), speed(second));
        [
            sealed(&format!("GPRMC,{at},A,4807.038,N,{minute},E,{speed},,211126,,")),
            sealed(&format!("GPVTG,,T,,M,{speed},N,0.0,K")),
        ]
        .join("\r\n")
    };
    let (_folder, path) = file("f.nmea", (0..20).map(lines).collect::<Vec<_>>().join("\r\n").as_bytes());
    load(&ingest::FlightUnit { id: "f".into(), files: vec![path], kind: LogKind::Nmea }).unwrap()
}

#[test]
fn a_stationary_receiver_needs_no_track_for_a_velocity() {
    // A receiver on the ground, which does not invent a track (Garmin, u-blox).
    let parked = load_trackless(|_| "0.00");
    for name in ["velocity.gps", "velocity.vtg"] {
        let series = &parked.flight.channels[name].series;
        assert_eq!((series.len(), series.component(0)[19], series.component(1)[0]), (20, 0.0, 0.0), "{name}");
    }
    // A moving one without a track in some rows or in all.
    for moving in [3, 20] {
        let loaded = load_trackless(|second| if second < moving { "1.5" } else { "0.0" });
        let length = |name: &str| loaded.flight.channels.get(name).map(|c| c.series.len());
        let still = Some(20 - moving).filter(|rows| *rows > 0);
        assert_eq!((length("position.gps"), length("velocity.gps"), length("velocity.vtg")), (Some(20), still, still));
        let reported = |n: &&flight::Notice| n.text.contains("track is missing, and the speed is not zero");
        let counts: Vec<u64> = loaded.flight.notices.iter().filter(reported).map(|n| n.count).collect();
        assert_eq!(counts, [moving as u64; 2]);
    }
}

#[test]
fn values_invalid_by_their_mode_field_are_not_used() {
    // NMEA 2.3 and above: the last field of VTG, the sixth of GNS with a letter for each system.
    let lines = |second: u32| {
        let (at, mode, modes) = if second < 4 { (0, "N", "NN") } else { (second, "A", "AN") };
        [
            sealed(&format!("GNRMC,1200{second:02},A,4807.038,N,01131.0{at:02},E,1.0,90.0,211126,,")),
            sealed(&format!("GNVTG,0.00,T,,M,0.00,N,0.00,K,{mode}")),
            sealed(&format!("GNGNS,1200{second:02},4807.038,N,01131.0{at:02},E,{modes},09,0.9,5.4,46.9,,")),
        ]
        .join("\r\n")
    };
    let (_folder, path) = file("f.nmea", (0..20).map(lines).collect::<Vec<_>>().join("\r\n").as_bytes());
    let loaded = load(&ingest::FlightUnit { id: "f".into(), files: vec![path], kind: LogKind::Nmea }).unwrap();
    for name in ["position.gps", "velocity.vtg"] {
        assert_eq!(loaded.flight.channels[name].series.len(), 16, "{name}");
        let health = loaded.binding.as_ref().unwrap().channels.iter().find(|c| c.name == name).unwrap();
        assert_eq!((health.rejected[0].count, health.rejected[0].reason.as_str()), (4, "valid is below 1"));
    }
}

#[test]
fn a_log_without_any_date_is_timed_from_its_start_over_midnight() {
    let gga = |time: &str, minute: u32| {
        sealed(&format!("GPGGA,{time},4807.{minute:03},N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,"))
    };
    let lines = [gga("235959.50", 1), gga("000000.00", 2), gga("000000.50", 3)];
    let (_folder, path) = file("f.nmea", (lines.join("\n") + "\n").as_bytes());
    let unit = ingest::FlightUnit { id: "f".into(), files: vec![path], kind: ingest::LogKind::Nmea };
    let loaded = load(&unit).unwrap();
    let timeline = loaded.flight.channels["position.gps"].series.timeline();
    assert_eq!(timeline.clock(), Clock::Elapsed);
    assert_eq!(timeline.stamps().iter().map(|s| s.0).collect::<Vec<_>>(), [0, 500_000_000, 1_000_000_000]);
}

/// GGA at 10 Hz from a tenth before midnight of 2026-11-21 on, with an RMC after those of `dated`, and VTG after all.
fn around_midnight(dated: impl Fn(i64) -> bool) -> Vec<String> {
    let epoch = |tenth: i64| {
        let day = [21, 22][usize::from(tenth > 0)];
        let of_day = (864_000 + tenth - 1) % 864_000;
        let (hour, minute, second) = (of_day / 36_000, of_day / 600 % 60, of_day / 10 % 60);
        let time = format!("{hour:02}{minute:02}{second:02}.{}", of_day % 10);
        let place = format!("4807.{:03},N,01131.000,E", 100 + tenth);
        let rmc = || sealed(&format!("GPRMC,{time},A,{place},20.0,90.0,{day}1126,,"));
        [
            Some(sealed(&format!("GPGGA,{time},{place},1,08,0.9,5.0,M,46.9,M,,"))),
            dated(tenth).then(rmc),
            Some(sealed("GPVTG,90.0,T,,M,20.0,N,,K")),
        ]
    };
    (0..40).flat_map(epoch).flatten().collect()
}

#[test]
fn sentences_before_the_first_date_are_dated_back_over_midnight_too() {
    // date -u -d '2026-11-21T23:59:59.9Z' +%s
    let truth: Vec<i64> = (0..40).map(|tenth| 1_795_305_599_900_000_000 + 100_000_000 * tenth).collect();
    for (dated, early) in [(0..40, 1), (7..8, 15), (39..40, 79)] {
        let lines = around_midnight(|tenth| dated.contains(&tenth));
        let (_folder, path) = file("late.nmea", (lines.join("\r\n") + "\r\n").as_bytes());
        let unit = ingest::FlightUnit { id: "late".into(), files: vec![path], kind: LogKind::Nmea };
        let loaded = load(&unit).unwrap();
        for name in ["position.gps", "velocity.vtg"] {
            let timeline = loaded.flight.channels[name].series.timeline();
            assert_eq!(timeline.clock(), Clock::Unix);
            assert_eq!(timeline.stamps().iter().map(|s| s.0).collect::<Vec<_>>(), truth, "{name}, dated {dated:?}");
        }
        let reported = loaded.flight.notices.iter().find(|n| n.code == "undated").unwrap();
        assert_eq!((reported.count, reported.severity), (early, Severity::Info));
        assert!(!lossy(&loaded), "{:?}", loaded.flight.notices);
    }
}

#[test]
fn two_files_are_not_one_log() {
    let (_folder, path) = file("a.nmea", b"");
    let files = [path.clone(), path];
    for kind in [LogKind::Nmea, LogKind::Ubx, LogKind::Tlog, LogKind::DataFlash, LogKind::Ulog, LogKind::Bag] {
        let want = |_: &ingest::TopicInfo| ingest::Selection::All;
        let error = in_context(|context| ingest::read_files(kind, &files, &want, context)).unwrap_err().to_string();
        assert!(error.contains("is one file, but 2 were given"), "{error}");
    }
}

#[test]
fn undated_sentences_are_a_loss_unless_they_are_empty() {
    let rmc = sealed("GPRMC,120000,A,4807.038,N,01131.000,E,20.0,90.0,211126,,");
    let silent = ["GPGGA,,,,,,0,00,99.99,,,,,,", "GPVTG,,T,,M,,N,,K", "GPRMC,,V,,,,,,,,,"].map(sealed);
    let lossless = text(&[&silent[0], &silent[1], &silent[2], &rmc]);
    assert!(lossless.notices.iter().all(|n| n.severity < Severity::Loss), "{:?}", lossless.notices);
    let place = "4807.038,N,01131.000,E";
    let lost = [format!("GPGGA,,{place},1,08,0.9,5.0,M,46.9,M,,"), "GPVTG,90.0,T,,M,20.0,N,,K".to_owned()];
    let log = text(&[&sealed(&lost[1]), &rmc, &sealed(&lost[0]), &sealed(&lost[1])]);
    let loss = log.notices.iter().find(|n| n.code == "undecodable").unwrap();
    assert_eq!((loss.severity, loss.count), (Severity::Loss, 1), "{}", loss.text);
    assert!(loss.text.ends_with(&lost[0]), "{}", loss.text);
    // The VTG after the RMC has its time; the one before is from an epoch that the log has only the end of.
    let headless = log.notices.iter().find(|n| n.code == "undated").unwrap();
    assert_eq!((headless.severity, headless.count), (Severity::Info, 1), "{}", headless.text);
}

#[test]
fn a_unix_time_before_a_line_is_its_log_time() {
    let rmc =
        |second: u32| sealed(&format!("GPRMC,1200{second:02},A,4807.0{second:02},N,01131.000,E,20.0,90.0,211126,,"));
    let lines: Vec<String> = (0..9).map(|s| format!("17952624{s:02}.123 {}", rmc(s))).collect();
    let (_folder, path) = file("f.txt", (lines.join("\n") + "\n").as_bytes());
    let unit = ingest::FlightUnit { id: "f".into(), files: vec![path], kind: ingest::LogKind::Nmea };
    let loaded = load(&unit).unwrap();
    let channel = &loaded.flight.channels["velocity.gps"];
    let logged = channel.series.timeline();
    assert_eq!((logged.kind(), logged.stamps().len()), (StampKind::Measured, 9));
    let offsets = loaded.binding.unwrap().channels.iter().find(|c| c.name == "velocity.gps").unwrap().offsets.clone();
    // Noon of that day is 1795262400.
    assert!((offsets[0].offset_s.median.abs() - 0.123).abs() < 1e-9, "{offsets:?}");
    let other = text(&[&format!("[12:00:01] {}", rmc(1)), &rmc(2)]);
    assert!(codes(&other).contains(&"skipped") && table(&other, "GPRMC").column("logged_ns").is_none());
    assert_eq!((table(&other, "GPRMC").rows, other.health.bytes.damaged), (2, 0));
}

#[test]
fn a_bad_line_is_damage_with_its_line_number_and_the_others_are_read() {
    let good = sealed("GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,");
    let bad = good.replace("545.4", "645.4");
    let log = text(&["log of the receiver", "# a comment", &good, &bad, "4.5,M,46.9,M,,", "", &good, "\u{7}", &good]);
    let reasons: Vec<&str> = log.health.damage.iter().map(|d| d.reason.as_str()).collect();
    assert_eq!(reasons[0], "line 4: the checksum is 47, and the sentence gives 44");
    assert_eq!(reasons[1..], ["line 5: not a sentence", "line 8: not a sentence"]);
    assert_eq!((table(&log, "GPGGA").rows, log.health.damage_count), (3, 3));
    // If the end of a line is damaged, both its sentences are read.
    let merged = text(&[&format!("{good}\rJ{good}")]);
    assert_eq!((table(&merged, "GPGGA").rows, merged.health.bytes.damaged), (2, 0), "{:?}", merged.health.damage);
}

#[test]
fn text_between_sentences_is_not_damage_but_a_fragment_is() {
    let good = sealed("GPGLL,4807.038,N,01131.000,E,123520,A");
    let own = sealed("PSRFTXTClock: 96 kHz, good");
    let log = text(&[&good, "+ 6: 28 (.....)", &own, "038,N,01131.000", "038", "noise*47", &good]);
    let reasons: Vec<&str> = log.health.damage.iter().map(|d| d.reason.as_str()).collect();
    assert_eq!(reasons, [4, 5, 6].map(|line| format!("line {line}: not a sentence")));
    assert_eq!((messages(&log, "GPGLL"), messages(&log, "PSRF")), (2, 1));
    // A logger that prefixes each sentence with text also writes other lines.
    let logged = format!("12:00:01 | recv - {good}");
    let log = text(&[&logged, "12:00:02 | main - interrupted, leaving", &logged, "12:00:03 | recv - GPGLL,4807*38"]);
    assert_eq!((messages(&log, "GPGLL"), log.health.damage_count), (2, 1), "{:?}", log.health.damage);
    assert!(log.notices.iter().any(|n| n.code == "skipped" && n.count == 40));
}

#[test]
fn a_position_is_absent_if_its_sentence_has_no_fix() {
    let log = text(&[
        &sealed("GPGGA,235946.005,8960.000000,N,00000.000000,E,0,0,,137.000,M,13.000,M,,"),
        &sealed("GPRMC,000452.981,V,36000.0000,N,72000.0000,E,0.000000,,190120,,"),
        &sealed("GPGLL,36000.0000,N,72000.0000,E,000452.981,V"),
        &sealed("GPGGA,000453,4807.038,N,01131.000,E,0,00,,,M,,M,,"),
    ]);
    assert_eq!((log.health.undecodable, log.health.messages), (0, 4), "{:?}", codes(&log));
    assert_eq!(values(&log, "GPGGA", "latitude"), [None, Some(48.1173)]);
    assert_eq!(values(&log, "GPGGA", "quality"), [Some(0.0); 2]);
    assert_eq!((values(&log, "GPRMC", "valid"), values(&log, "GPRMC", "speed")), (vec![Some(0.0)], vec![Some(0.0)]));
    let wrong = text(&[&sealed("GPGLL,36000.0000,N,72000.0000,E,000452.981,A")]);
    assert_eq!((wrong.health.undecodable, wrong.notices.any_loss()), (1, true));
}

#[test]
fn sentences_with_a_doubled_dollar_are_read() {
    let good = format!("${}", sealed("GPGLL,4807.038,N,01131.000,E,123520,A"));
    let log = text(&[&good, &good]);
    assert_eq!((log.health.messages, log.health.bytes.damaged), (2, 0), "{:?}", log.health.damage);
    let (folder, _path) = file("receiver.log", format!("{good}\r\n{good}\r\n").as_bytes());
    let found = ingest::discover(folder.path(), &ingest::MapLibrary::shipped().unwrap()).unwrap();
    assert_eq!(found.units[0].kind, LogKind::Nmea);
}

#[test]
fn a_log_without_any_checksum_is_detected_by_its_sentence_types() {
    let found = |text: &str| {
        let (folder, _path) = file("receiver.log", text.as_bytes());
        let found = ingest::discover(folder.path(), &ingest::MapLibrary::shipped().unwrap()).unwrap();
        found.units.first().map(|unit| unit.kind)
    };
    let gga = "$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,\r\n";
    let gsv = "$GPGSV,3,1,09,07,38,351,00,08,60,306,31,11,73,114,35,17,36,265,46\r\n";
    assert_eq!(found(&format!("# of a receiver\r\n{gga}{gsv}{gga}{gsv}{gga}")), Some(LogKind::Nmea));
    assert_eq!(found(&format!("{gga}{gsv}")), None);
    assert_eq!(found("$STI,IC,error=4\r\n$STI,IC,error=4\r\n$STI,IC,error=6\r\n"), None);
}

#[test]
fn a_log_without_any_checksum_is_read_and_reported() {
    let lines =
        ["$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,", "$GPGLL,4807.038,N,01131.000,E,123520,A"];
    let log = text(&lines);
    assert_eq!((log.health.messages, log.health.bytes.damaged), (2, 0));
    assert!(log.notices.iter().any(|n| n.code == "no-checksum" && n.severity == Severity::Warning && n.count == 2));
    // If others have a checksum, a sentence without one is damaged.
    let log = text(&[lines[0], &sealed("GPGLL,4807.038,N,01131.000,E,123520,A")]);
    assert_eq!((log.health.messages, log.health.damage_count), (1, 1));
}

/// GGA of this many seconds from noon, with and without a checksum.
fn fixes(seconds: std::ops::Range<usize>, checked: bool) -> String {
    let body =
        |i: usize| format!("GPGGA,12{:02}{:02},4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,", i / 60, i % 60);
    let line = |i: usize| if checked { sealed(&body(i)) } else { format!("${}", body(i)) };
    seconds.map(|i| line(i) + "\r\n").collect()
}

#[test]
fn the_majority_nearby_decides_whether_sentences_have_checksums() {
    let count = |bytes: &[u8]| {
        let (folder, path) = file("receiver.log", bytes);
        let found = ingest::discover(folder.path(), &ingest::MapLibrary::shipped().unwrap()).unwrap();
        assert_eq!(found.units[0].kind, LogKind::Nmea);
        let log = read(READER, &path).unwrap();
        (log.health.messages, log.health.damage_count)
    };
    let (bare, checked) = (fixes(0..120, false), fixes(120..240, true));
    // A point that became a `*`; a line of another device; half of the log by another logger.
    let point = bare.find('.').unwrap();
    let marked = format!("{}*{}", &bare[..point], &bare[point + 1..]);
    assert_eq!(count(marked.as_bytes()), (119, 1));
    assert_eq!(count([&bare, &*sealed("GPTXT,01,01,02,hello"), "\r\n"].concat().as_bytes()), (121, 0));
    assert_eq!(count([&*bare, &checked].concat().as_bytes()), (240, 0));
    assert_eq!(count([&*checked, &bare].concat().as_bytes()), (240, 0));
    // If a logger keeps checksums, single sentences without one are damaged.
    let mixed = checked.lines().enumerate().map(|(i, line)| {
        let line = if i % 10 == 5 { &line[..line.len() - 3] } else { line };
        format!("{line}\r\n")
    });
    let mixed: String = mixed.collect();
    assert_eq!(count(mixed.as_bytes()), (108, 12));
    for front in [vec![0; 70_000], vec![0xff; 70_000]] {
        let log = read_bytes(READER, &[&front[..], bare.as_bytes()].concat()).unwrap();
        assert_eq!(log.health.messages, 120);
    }
}

#[test]
fn lines_of_another_device_do_not_imply_a_log_without_checksums() {
    // A log with more other lines than sentences. One sentence was truncated inside a number.
    let own = "$LOG,12,34\r\n".repeat(4);
    let mut lines: Vec<String> = fixes(0..60, true).split_inclusive('\n').map(str::to_owned).collect();
    lines[30].replace_range(55.., "\r\n");
    let log = read_bytes(READER, lines.iter().map(|line| line.clone() + &own).collect::<String>().as_bytes()).unwrap();
    assert_eq!(table(&log, "GPGGA").rows, 59);
    assert!(lost(&log));
}

#[test]
fn text_that_a_logger_appends_to_a_sentence_is_harmless() {
    let lines: Vec<String> = fixes(0..50, true).lines().map(|line| format!("{line},1795262400000\r\n")).collect();
    let log = read_bytes(READER, lines.concat().as_bytes()).unwrap();
    assert_eq!((log.health.messages, log.health.bytes.damaged), (50, 0), "{:?}", log.health.damage);
    // The end of a line is damaged, and a sentence is longer than the standard has it.
    let log = read_bytes(READER, fixes(0..50, true).replacen("\r\n", "\u{1d}\n", 9).as_bytes()).unwrap();
    assert_eq!((log.health.messages, log.health.bytes.damaged), (50, 9), "{:?}", log.health.damage);
    let long = sealed(&format!("PUBX,03,30{}", ",23,-,,,45,010".repeat(60)));
    let log = read_bytes(READER, [fixes(0..3, true), long + "\r\n"].concat().as_bytes()).unwrap();
    assert_eq!((log.health.messages, log.health.bytes.damaged), (4, 0), "{:?}", log.health.damage);
}

/// An epoch of a receiver that sends VTG last, as most do.
fn late_epoch(talker: &str, tenth: usize) -> [String; 3] {
    let time = format!("12{:02}{:02}.{}", tenth / 600, tenth / 10 % 60, tenth % 10);
    let (speed, track) = (20.0 + 0.1 * (tenth % 50) as f64, tenth % 360);
    let place = "4807.038,N,01131.000,E";
    [
        sealed(&format!("{talker}GGA,{time},{place},1,08,0.9,545.4,M,46.9,M,,")),
        sealed(&format!("{talker}RMC,{time},A,{place},{speed:.1},{track}.0,211126,,,A")),
        sealed(&format!("{talker}VTG,{track}.0,T,,M,{speed:.1},N,,K,A")),
    ]
}

/// Checks that every VTG with a time has that of the RMC with its track; returns how many have no time.
fn vtg_without_time(log: &Log, talker: &str) -> usize {
    let column = |kind: &str, field: &str| table(log, &format!("{talker}{kind}")).column(field).unwrap();
    let at = |kind: &str, row: usize| column(kind, "utc_ns").integer(row).filter(|ns| *ns != 0);
    let tracks: Vec<Option<f64>> = values(log, &format!("{talker}RMC"), "track");
    let vtg = values(log, &format!("{talker}VTG"), "track");
    let mut without = 0;
    for (row, track) in vtg.iter().enumerate() {
        let valid = column("VTG", "utc_ns").number(row).is_some();
        match at("VTG", row).filter(|_| valid) {
            Some(ns) => {
                let rmc = (0..tracks.len()).find(|&i| at("RMC", i) == Some(ns)).expect("the RMC of its time");
                assert_eq!(tracks[rmc], *track, "VTG {row}");
            }
            None => without += 1,
        }
    }
    without
}

#[test]
fn a_velocity_after_damage_gets_no_time_from_another_epoch() {
    let lines: Vec<String> = (0..200).flat_map(|i| late_epoch("GP", 10 * i)).collect();
    let whole = lines.join("\r\n") + "\r\n";
    assert_eq!(vtg_without_time(&read_bytes(READER, whole.as_bytes()).unwrap(), "GP"), 0);
    let starts: Vec<usize> = std::iter::once(0).chain(whole.match_indices('\n').map(|(at, _)| at + 1)).collect();
    for (from, to) in [(120, 182), (121, 182), (122, 182), (121, 123), (90, 91), (31, 35)] {
        // From the middle of one sentence to the middle of another.
        let mut hit = whole.clone().into_bytes();
        hit[starts[from] + 9..starts[to] - 9].fill(0);
        let log = read_bytes(READER, &hit).unwrap();
        assert!(vtg_without_time(&log, "GP") <= 1, "{from} to {to}");
    }
}

#[test]
fn a_velocity_gets_the_time_of_its_own_talker() {
    let mut lines: Vec<(usize, String)> = vec![];
    for i in 0..60 {
        // Once a second and late, and five times a second.
        lines.extend(late_epoch("GP", 10 * i).map(|line| (10 * i + 3, line)));
        lines.extend((0..5).flat_map(|k| late_epoch("GN", 10 * i + 2 * k).map(|line| (10 * i + 2 * k, line))));
    }
    lines.sort_by_key(|(at, _)| *at);
    // The velocity of the slow one comes after the next epoch of the other.
    for at in (0..lines.len()).rev() {
        if lines[at].1.starts_with("$GPVTG") && at + 3 < lines.len() {
            let line = lines.remove(at);
            lines.insert(at + 3, line);
        }
    }
    let text: String = lines.iter().map(|(_, line)| format!("{line}\r\n")).collect();
    let log = read_bytes(READER, text.as_bytes()).unwrap();
    assert_eq!((vtg_without_time(&log, "GP"), vtg_without_time(&log, "GN")), (0, 0));
}

#[test]
fn a_heading_gets_the_time_of_its_epoch_from_any_talker() {
    let heading = |talker: &str, i: usize| sealed(&format!("{talker}HDT,{}.0,T", i % 360));
    let fix = |talker: &str, i: usize| late_epoch(talker, 10 * i)[0].clone();
    let date = sealed("GPZDA,115959.0,21,11,2026,00,00");
    let stamps = |lines: Vec<String>, topic: &str| -> Vec<i64> {
        let log = read_bytes(READER, (lines.join("\r\n") + "\r\n").as_bytes()).unwrap();
        let table = table(&log, topic);
        let column = table.column("elapsed_ns").unwrap();
        (0..table.rows).map(|row| column.integer(row).unwrap() / 1_000_000_000).collect()
    };
    let seconds: Vec<i64> = (0..60).collect();
    // The receiver changes its talker but not that of the heading; another talker sent a time once.
    let changed = (0..60).flat_map(|i| [fix(if i < 10 { "GP" } else { "GN" }, i), heading("GP", i)]).collect();
    assert_eq!(stamps(changed, "GPHDT"), seconds);
    let once = std::iter::once(date).chain((0..60).flat_map(|i| [fix("GN", i), heading("GP", i)])).collect();
    assert_eq!(stamps(once, "GPHDT"), (1..61).collect::<Vec<i64>>());
    let turns = |i: usize| if i.is_multiple_of(2) { "GP" } else { "GN" };
    let alternating = (0..60).flat_map(|i| [fix(turns(i), i), heading("HE", i)]).collect();
    assert_eq!(stamps(alternating, "HEHDT"), seconds);
}

#[test]
fn one_receiver_with_two_talkers_has_one_time() {
    for tenths in [1, 10] {
        // The talker of the velocity sends the time of its epoch after it.
        let epoch = |i: usize| {
            let [fix, rmc, _] = late_epoch("GN", tenths * i);
            let [_, _, vtg] = late_epoch("GP", tenths * i);
            [rmc, vtg, sealed(&format!("GPHDT,{}.0,T", i % 360)), fix.replace("$GNGGA", "$GPGGA")]
        };
        let lines: Vec<String> = (0..120).flat_map(epoch).collect();
        let resealed = lines.iter().map(|line| sealed(line[1..].split('*').next().unwrap()) + "\r\n");
        let log = read_bytes(READER, resealed.collect::<String>().as_bytes()).unwrap();
        assert_eq!(log.health.bytes.damaged, 0);
        for topic in ["GPVTG", "GPHDT", "GPGGA"] {
            let column = table(&log, topic).column("elapsed_ns").unwrap();
            let ms: Vec<i64> = (0..120).map(|row| column.integer(row).unwrap() / 1_000_000).collect();
            assert_eq!(ms, (0..120).map(|i| 100 * tenths as i64 * i).collect::<Vec<i64>>(), "{topic} {tenths}");
        }
    }
}

/// The times of a topic's rows, s, to a millisecond.
fn elapsed_ms(log: &Log, topic: &str) -> Vec<i64> {
    let table = table(log, topic);
    let column = table.column("elapsed_ns").unwrap();
    (0..table.rows).map(|row| column.integer(row).unwrap_or(-1) / 1_000_000).collect()
}

#[test]
fn two_receivers_on_one_line_keep_their_own_times() {
    // As from a multiplexer at 4800 baud: sentences of the slow one are spread between the epochs of the other.
    let heading = |talker: &str, i: usize| sealed(&format!("{talker}HDT,{}.0,T", i % 360));
    let mut lines = vec![];
    for second in 0..60 {
        let [slow, slow_rmc, _] = late_epoch("GP", 10 * second);
        let fast = [0, 5].map(|tenth| late_epoch("GN", 10 * second + tenth));
        lines.extend([fast[0][1].clone(), slow_rmc, slow, heading("GN", second)]);
        lines.extend([fast[1][1].clone(), heading("GP", second), heading("GN", second)]);
    }
    let text: String = lines.iter().map(|line| format!("{line}\r\n")).collect();
    let log = read_bytes(READER, text.as_bytes()).unwrap();
    assert_eq!(elapsed_ms(&log, "GPHDT"), (0..60).map(|i| 1000 * i).collect::<Vec<i64>>());
    assert_eq!(elapsed_ms(&log, "GNHDT"), (0..120).map(|i| 500 * i).collect::<Vec<i64>>());
}

#[test]
fn a_date_and_time_outside_the_epochs_times_no_velocity() {
    let epoch = |i: usize, zda: &str, leads: bool| {
        let [gga, rmc, vtg] = late_epoch("GN", 10 * i);
        let zda = sealed(&format!("GNZDA,12{:02}{:02}.{zda},21,11,2026,00,00", i / 60, i % 60));
        if leads { vec![zda, vtg, rmc, gga] } else { vec![rmc, gga, zda, vtg] }
    };
    for (zda, leads) in [("05", false), ("0", false), ("0", true)] {
        let lines = (0..60).flat_map(|i| epoch(i, zda, leads)).map(|line| line + "\r\n");
        let log = read_bytes(READER, lines.collect::<String>().as_bytes()).unwrap();
        assert_eq!(elapsed_ms(&log, "GNVTG"), (0..60).map(|i| 1000 * i).collect::<Vec<i64>>(), "{zda} {leads}");
    }
}

#[test]
fn a_talker_without_times_does_not_end_anothers_epoch() {
    let lines = (0..60).flat_map(|i| {
        let [_, rmc, vtg] = late_epoch("GN", 10 * i);
        let empty = sealed("GPGGA,,,,,,0,00,99.9,,,,,,");
        let heading = |tenth: usize| sealed(&format!("HEHDT,{i}.{tenth},T"));
        [rmc, empty, vtg, heading(0), heading(5)]
    });
    let log = read_bytes(READER, lines.map(|line| line + "\r\n").collect::<String>().as_bytes()).unwrap();
    // The heading is in each epoch twice.
    for (topic, rows) in [("GNVTG", 1), ("HEHDT", 2)] {
        assert_eq!(elapsed_ms(&log, topic), (0..60 * rows).map(|i| 1000 * (i / rows)).collect::<Vec<i64>>(), "{topic}");
    }
}

#[test]
fn a_heading_has_no_time_while_the_receiver_has_none() {
    let lines = (0..60).flat_map(|i| {
        let [_, rmc, _] = late_epoch("GN", 10 * i);
        let lost = sealed("GNRMC,,V,,,,,,,,,,N");
        [if (20..40).contains(&i) { lost } else { rmc }, sealed(&format!("HEHDT,{i}.0,T"))]
    });
    let log = read_bytes(READER, lines.map(|line| line + "\r\n").collect::<String>().as_bytes()).unwrap();
    let table = table(&log, "HEHDT");
    let column = table.column("elapsed_ns").unwrap();
    let timed: Vec<usize> = (0..60).filter(|&row| column.number(row).is_some()).collect();
    assert_eq!(timed, (0..20).chain(40..60).collect::<Vec<usize>>());
    assert!(log.notices.iter().any(|n| n.code == "undated"), "{:?}", log.notices);
}

#[test]
fn a_value_that_is_not_a_number_costs_its_row_and_is_a_loss() {
    let log = text(&[
        &sealed("GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,high,M,46.9,M,,"),
        &sealed("GPGGA,123520,4867.038,N,01131.000,E,1,08,0.9,5.0,M,46.9,M,,"),
        &sealed("GPGGA,123521,4807.038,N,01131.000,E,1,08,0.9,5.0,M,46.9,M,,"),
    ]);
    assert_eq!((table(&log, "GPGGA").rows, log.health.undecodable), (1, 2));
    assert!(log.notices.iter().any(|n| n.code == "undecodable" && n.severity == Severity::Loss));
}

#[test]
fn a_long_line_that_is_not_a_sentence_is_damage_except_for_its_end() {
    let good = sealed("GPGLL,4807.038,N,01131.000,E,123520,A");
    let long = "x ".repeat(2500);
    let log = read_bytes(READER, format!("{good}\n{long}\n{good}\n").as_bytes()).unwrap();
    assert_eq!((log.health.messages, log.health.bytes.damaged), (2, 5000));
    assert_eq!(log.health.damage[0].reason, "line 2: not a sentence");
}

#[test]
fn a_log_cut_anywhere_gives_the_sentences_before_it_and_reports_it() {
    let bytes = seed(Container::Nmea);
    // A sentence is complete with the last digit of its checksum.
    let ends: Vec<usize> = (0..bytes.len()).filter(|at| bytes[*at] == b'\r').collect();
    let between = |length| length == 0 || b"\r\n".contains(&bytes[length]) || bytes[length - 1] == b'\n';
    check_cuts(READER, &bytes, 0..bytes.len(), &ends, between);
}

#[test]
fn no_flipped_bit_changes_a_value_or_loses_a_sentence_silently() {
    check_flips(1);
}

#[test]
#[ignore = "all single bits, some seconds to a minute"]
fn no_single_bit_flip_at_all_changes_a_value_or_loses_a_sentence() {
    check_flips(8);
}

fn check_flips(bits_of_each_byte: usize) {
    let bytes = seed(Container::Nmea);
    let whole = rows(&read_bytes(READER, &bytes).unwrap());
    let mut lost = 0;
    // The date comes from earlier sentences: only values in the sentence itself are compared.
    let own = |rows: &std::collections::BTreeMap<String, Vec<String>>| {
        let strip = |row: &String| row.split(' ').filter(|cell| !cell.contains("_ns=")).collect::<Vec<_>>().join(" ");
        rows.iter().map(|(topic, rows)| (topic.clone(), rows.iter().map(strip).collect())).collect()
    };
    let truth = own(&whole);
    each_flip(READER, &bytes, bits(0..bytes.len(), bits_of_each_byte), |log, place, bit| {
        let found = own(&rows(log));
        let (gone, new) = (missing(&truth, &found), missing(&found, &truth));
        assert_eq!(new, 0, "byte {place}, bit {bit}: a value changed");
        assert!(gone <= 1 && (gone == 0 || log.health.bytes.damaged > 0), "byte {place}, bit {bit}: silent loss");
        lost += gone;
    });
    assert!(lost > 100 * bits_of_each_byte, "{lost}");
}

#[test]
fn what_is_no_log_is_refused() {
    check_refusals(READER, "no NMEA sentence");
}

/// A log with these lines, bound.
fn bound(lines: &[String]) -> ingest::Loaded {
    let (_folder, path) = file("f.nmea", (lines.join("\r\n") + "\r\n").as_bytes());
    load(&ingest::FlightUnit { id: "f".into(), files: vec![path], kind: LogKind::Nmea }).unwrap()
}

/// Fifth `fifth` of a second of a flight to the north, from `talker`: GGA with this separation, and RMC of this status.
fn epoch(talker: &str, fifth: usize, separation: &str, status: &str) -> [String; 2] {
    let time = format!("1200{:02}.{}0", fifth / 5, 2 * (fifth % 5));
    let place = format!("4807.{:04},N,01131.0000,E", fifth + 100);
    let of_sea = if separation.is_empty() { String::new() } else { format!("{separation},M") };
    let of_sea = if of_sea.is_empty() { ",".to_owned() } else { of_sea };
    [
        sealed(&format!("{talker}GGA,{time},{place},1,08,0.9,545.4,M,{of_sea},,")),
        sealed(&format!("{talker}RMC,{time},{status},{place},20.0,0.0,211126,,")),
    ]
}

fn length(loaded: &ingest::Loaded, channel: &str) -> usize {
    loaded.flight.channels.get(channel).map_or(0, |channel| channel.series.len())
}

#[test]
fn a_receiver_that_changes_its_talker_is_one_channel_throughout() {
    // As more satellites come into view and leave it again.
    let talker = |fifth| if (20..70).contains(&fifth) { "GN" } else { "GP" };
    let lines: Vec<String> = (0..100).flat_map(|fifth| epoch(talker(fifth), fifth, "46.9", "A")).collect();
    let loaded = bound(&lines);
    for name in ["position.gps", "velocity.gps", "fix.gps"] {
        assert_eq!(length(&loaded, name), 100, "{name}");
        let stamps = loaded.flight.channels[name].series.timeline().stamps();
        assert!(stamps.windows(2).all(|pair| pair[1].0 - pair[0].0 == 200_000_000), "{name}");
    }
    assert!(!lossy(&loaded), "{:?}", loaded.flight.notices);
    let reported: Vec<_> = loaded.flight.notices.iter().filter(|n| n.code == "several-sources").collect();
    assert_eq!((reported.len(), reported[0].count), (2, 100));
    assert!(reported[0].text.contains("GNGGA (50), GPGGA (50)"), "{}", reported[0].text);
    let topics: Vec<_> = loaded.health.topics.iter().map(|t| (t.name.as_str(), t.messages)).collect();
    assert_eq!(topics, [("GGA", 100), ("RMC", 100)]);
    assert_eq!(loaded.health.messages, 200);
    // The talkers are not lost.
    let log = read_bytes(READER, lines.join("\n").as_bytes()).unwrap();
    let table = log.tables.iter().find(|t| t.topic.name == "GGA").unwrap();
    let said = (0..100).filter_map(|row| table.column("talker")?.text(row));
    assert!(said.eq((0..100).map(talker)));
}

#[test]
fn several_receivers_or_systems_stay_separate() {
    // The same epochs of two systems; a second receiver between the epochs of the first; a slow one and a fast one.
    for (every, tenths) in [(1, 0), (1, 1), (5, 1)] {
        let others = |fifth: usize| epoch("GP", fifth, "46.9", "A").map(|line| later(&line, tenths));
        let lines = |fifth: usize| {
            let others = fifth.is_multiple_of(every).then(|| others(fifth)).into_iter().flatten();
            epoch("GN", fifth, "46.9", "A").into_iter().chain(others).collect::<Vec<_>>()
        };
        let loaded = bound(&(0..50).flat_map(lines).collect::<Vec<_>>());
        assert_eq!(loaded.flight.channels["position.gps"].source.topic, "GNGGA");
        assert_eq!((length(&loaded, "position.gps"), loaded.health.topics.len()), (50, 4), "{every} {tenths}");
    }
}

/// The sentence some tenths of a second later, within its second.
fn later(line: &str, tenths: u8) -> String {
    let body = line.trim_start_matches('$').split('*').next().unwrap();
    let (head, rest) = body.split_at("GPGGA,120000.".len());
    let tenth: u8 = rest[..1].parse().unwrap();
    sealed(&format!("{head}{}{}", tenth + tenths, &rest[1..]))
}

#[test]
fn a_differential_fix_is_a_fix() {
    // Some receivers (Unicore among them) put it in the status, where the standard has A and V.
    let loaded = bound(&(0..50).flat_map(|fifth| epoch("GN", fifth, "46.9", "D")).collect::<Vec<_>>());
    assert_eq!((length(&loaded, "position.gps"), length(&loaded, "velocity.gps")), (50, 50));
    // The date of such an RMC counts.
    assert_eq!(loaded.flight.channels["position.gps"].series.timeline().clock(), Clock::Unix);
    let loaded = bound(&(0..50).flat_map(|fifth| epoch("GN", fifth, "46.9", "V")).collect::<Vec<_>>());
    assert_eq!((length(&loaded, "velocity.gps"), lossy(&loaded)), (0, false));
}

#[test]
fn heights_without_geoid_separation_are_reported_as_above_sea_level() {
    let height = |loaded: &ingest::Loaded| loaded.flight.channels["position.gps"].series.component(2)[0];
    let above_sea = |loaded: &ingest::Loaded| count_saying(loaded, "assumption", "above mean sea level") > 0;
    let loaded = bound(&(0..50).flat_map(|fifth| epoch("GN", fifth, "", "A")).collect::<Vec<_>>());
    assert_eq!((height(&loaded), above_sea(&loaded)), (545.4, true));
    // If single sentences lack it, the others have the height above the ellipsoid.
    let said = |fifth| if fifth % 10 == 3 { "" } else { "46.9" };
    let loaded = bound(&(0..50).flat_map(|fifth| epoch("GN", fifth, said(fifth), "A")).collect::<Vec<_>>());
    assert_eq!((height(&loaded), above_sea(&loaded)), (545.4 + 46.9, false));
}

/// PUBX,00 of u-blox, a second apart, of a flight to the north-east that climbs.
fn pubx(second: usize, status: &str) -> String {
    let place = format!("4717.{:05},N,00833.91565,E", 11_437 + second);
    sealed(&format!(
        "PUBX,00,1200{second:02}.00,{place},546.589,{status},2.1,3.4,36.000,45.00,-1.500,,0.92,1.19,0.77,9,0,0"
    ))
}

#[test]
fn pubx_alone_yields_a_3d_velocity_and_accuracies() {
    let status = |second| if second == 7 { "NF" } else { "G3" };
    let date = sealed("PUBX,04,120000.00,211126,561600.00,2445,18,495176,342.504,21");
    let lines: Vec<String> = [date].into_iter().chain((0..20).map(|second| pubx(second, status(second)))).collect();
    let loaded = bound(&lines);
    assert_eq!(["position.gps", "velocity.gps", "velocity.pubx"].map(|name| length(&loaded, name)), [19; 3]);
    let first = |name: &str| [0, 1, 2].map(|i| loaded.flight.channels[name].series.component(i)[0]);
    let [latitude, longitude, height] = first("position.gps");
    assert!((latitude.to_degrees() - (47.0 + 17.11437 / 60.0)).abs() < 1e-12, "{latitude}");
    assert!((longitude.to_degrees() - (8.0 + 33.91565 / 60.0)).abs() < 1e-12 && height == 546.589);
    let horizontal = 10.0 * std::f64::consts::FRAC_1_SQRT_2;
    let off = first("velocity.gps").into_iter().zip([horizontal, horizontal, -1.5]).map(|(v, truth)| (v - truth).abs());
    assert!(off.into_iter().all(|off| off < 1e-12), "{:?}", first("velocity.gps"));
    // date -u -d '2026-11-21T12:00:00Z' +%s
    let timeline = loaded.flight.channels["position.gps"].series.timeline();
    assert_eq!((timeline.clock(), timeline.first()), (Clock::Unix, Some(Stamp(1_795_262_400_000_000_000))));
    let scalar = |name: &str| loaded.flight.channels[name].series.component(0).to_vec();
    assert_eq!((scalar("horizontal-accuracy.gps"), scalar("vertical-accuracy.gps")), (vec![2.1; 19], vec![3.4; 19]));
    assert_eq!(scalar("fix.pubx"), (0..20).map(|second| if second == 7 { 0.0 } else { 3.0 }).collect::<Vec<_>>());
    assert!(!lossy(&loaded), "{:?}", loaded.flight.notices);
}

#[test]
fn standard_sentences_take_precedence_over_proprietary_ones() {
    let standard = |second: usize| epoch("GN", 5 * second, "46.9", "A").into_iter().chain([pubx(second, "D3")]);
    let loaded = bound(&(0..12).flat_map(standard).collect::<Vec<_>>());
    let topic = |name: &str| loaded.flight.channels[name].source.topic.clone();
    assert_eq!([topic("position.gps"), topic("velocity.gps")], ["GNGGA", "GNRMC"]);
    assert_eq!((topic("velocity.pubx"), length(&loaded, "velocity.pubx")), ("PUBX,00".to_owned(), 12));
}

#[test]
fn a_position_of_trimble_has_its_date_and_its_height_above_the_ellipsoid() {
    let ggk = |second: usize| {
        let quality = if second == 3 { 0 } else { 3 };
        let place = format!("4717.{:08},N,00833.91565000,E", 11_437_000 + second);
        sealed(&format!("PTNL,GGK,1200{second:02}.00,112126,{place},{quality},09,1.9,EHT150.790,M"))
    };
    let loaded = bound(&(0..10).map(ggk).collect::<Vec<_>>());
    let position = &loaded.flight.channels["position.gps"].series;
    assert_eq!((position.len(), position.component(2)[0]), (9, 150.79));
    assert_eq!(position.timeline().first(), Some(Stamp(1_795_262_400_000_000_000)));
}

#[test]
fn the_standard_deviations_of_gst_are_accuracies() {
    let gst = |fifth: usize| {
        let time = format!("1200{:02}.{}0", fifth / 5, 2 * (fifth % 5));
        sealed(&format!("GNGST,{time},2.1,1.0,0.9,45.0,3.0,4.0,6.5"))
    };
    let lines = (0..20).flat_map(|fifth| epoch("GN", fifth, "46.9", "A").into_iter().chain([gst(fifth)]));
    let loaded = bound(&lines.collect::<Vec<_>>());
    let scalar = |name: &str| loaded.flight.channels[name].series.component(0)[0];
    assert_eq!([scalar("horizontal-accuracy.gps"), scalar("vertical-accuracy.gps")], [5.0, 6.5]);
}

#[test]
fn a_tag_block_has_the_log_time_and_damage_costs_only_the_block() {
    let tagged = |second: usize, sum_off: u8| {
        let said = format!("s:r1,c:{}", 1_795_262_401 + second);
        let sum = said.bytes().fold(sum_off, |sum, b| sum ^ b);
        let [gga, _] = epoch("GN", 5 * second, "46.9", "A");
        format!("\\{said}*{sum:02X}\\{gga}")
    };
    let lines: Vec<String> = (0..10).map(|second| tagged(second, u8::from(second == 4))).collect();
    let log = read_bytes(READER, (lines.join("\r\n") + "\r\n").as_bytes()).unwrap();
    let table = log.tables.iter().find(|t| t.topic.name == "GNGGA").unwrap();
    let column = table.column("logged_ns").unwrap();
    let logged: Vec<Option<i64>> = (0..10).map(|row| column.integer(row)).collect();
    let truth = |second: i64| (second != 4).then_some((1_795_262_401 + second) * 1_000_000_000);
    assert_eq!(logged, (0..10).map(truth).collect::<Vec<_>>());
    assert_eq!(log.health.bytes.damaged, r"\s:r1,c:1795262405*00\".len() as u64);
}

#[test]
fn a_velocity_before_its_epoch_is_rejected_and_reported() {
    // VTG first, in the middle or last; a flight whose speed changes, and one that does not.
    let lines = |place_of_vtg: usize, faster: usize| -> Vec<String> {
        let second = |second: usize| {
            let (time, speed) = (format!("1200{second:02}.00"), 20 + faster * second);
            let place = format!("4807.{:04},N,01131.0000,E", second + 100);
            let vtg = sealed(&format!("GPVTG,45.0,T,,M,{speed}.0,N,,K,A"));
            let rmc = sealed(&format!("GPRMC,{time},A,{place},{speed}.0,45.0,211126,,,A"));
            let gga = sealed(&format!("GPGGA,{time},{place},1,08,0.9,545.4,M,46.9,M,,"));
            let mut epoch = vec![gga, rmc];
            epoch.insert(place_of_vtg, vtg);
            epoch
        };
        (0..30).flat_map(second).collect()
    };
    for (place, faster) in [(0, 1), (1, 1), (2, 1), (2, 0)] {
        let loaded = bound(&lines(place, faster));
        let leads = place == 0;
        assert_eq!(length(&loaded, "velocity.gps"), 30, "{place} {faster}");
        // The first comes before any time and is counted separately.
        let refused = loaded.flight.notices.iter().filter(|n| n.code == "undated" && n.place == "VTG");
        assert_eq!(refused.map(|n| n.count).sum::<u64>(), if leads { 29 } else { 0 }, "{place} {faster}");
        let Some(vtg) = loaded.flight.channels.get("velocity.vtg") else {
            assert!(leads, "{place} {faster}");
            continue;
        };
        let rmc = &loaded.flight.channels["velocity.gps"].series;
        assert!(!leads && vtg.series.timeline().stamps() == rmc.timeline().stamps(), "{place} {faster}");
        assert_eq!(vtg.series.component(0), rmc.component(0));
    }
}

#[test]
fn framing_around_sentences_is_not_damage() {
    let lines = |before: &str, after: &str| -> Vec<u8> {
        let line = |fifth: usize| format!("{before}{}{after}", epoch("GN", fifth, "46.9", "A")[0]);
        (0..20).map(line).collect::<String>().into_bytes()
    };
    let time = "2026-11-21T12:00:00.000Z";
    for (before, after) in
        [("\x02".to_owned(), "\r\n\x03"), ("\x02".to_owned(), "\x03\r\n"), (format!("{time} \x02"), "\r\n")]
    {
        let log = read_bytes(READER, &lines(&before, after)).unwrap();
        assert_eq!((messages(&log, "GNGGA"), log.health.bytes.damaged), (20, 0), "{before:?}: {:?}", log.health.damage);
        assert!(!codes(&log).contains(&"skipped") && !log.notices.any_loss(), "{before:?}: {:?}", log.notices);
        let logged = table(&log, "GNGGA").column("logged_ns").and_then(|column| column.integer(19));
        assert_eq!(logged, before.contains(time).then_some(1_795_262_400_000_000_000), "{before:?}");
    }
    // Other text is reported, and non-text is damage.
    let log = read_bytes(READER, &lines("[info] \x02", "\r\n")).unwrap();
    assert_eq!((log.health.bytes.damaged, codes(&log).contains(&"skipped")), (0, true));
    for binary in ["\x07", "\0\x02", "\x02\x01", "\x1b[32m"] {
        let log = read_bytes(READER, &lines(binary, "\r\n")).unwrap();
        let damaged = 20 * binary.len() as u64;
        assert_eq!((messages(&log, "GNGGA"), log.health.bytes.damaged), (20, damaged), "{binary:?}");
    }
}

#[test]
fn binary_frames_among_lines_with_logger_times_are_read() {
    let frame = crate::wire::ubx_frame(1, 3, &[0; 16]);
    let damaged = [&frame[..10], &[1], &frame[11..]].concat();
    let ns = |fifth: usize| (1_795_262_400_100 + 200 * fifth as i64) * 1_000_000;
    let stamped = |fifth: usize| format!("{}.{:03} ", ns(fifth) / 1_000_000_000, ns(fifth) / 1_000_000 % 1000);
    let tagged = |fifth: usize| {
        let said = format!("s:r1,c:{}", ns(fifth) / 1_000_000);
        format!("\\{said}*{:02X}\\", said.bytes().fold(0, |sum, b| sum ^ b))
    };
    let prefixes: [&dyn Fn(usize) -> String; 2] = [&stamped, &tagged];
    for (prefix, (frame, is_intact)) in
        prefixes.into_iter().flat_map(|prefix| [(prefix, (&frame, true)), (prefix, (&damaged, false))])
    {
        let mut bytes = vec![];
        for fifth in 0..100 {
            let frame = if fifth == 60 { &frame[..] } else { &[] };
            let line = format!("{}{}\r\n", prefix(fifth), epoch("GN", fifth, "46.9", "A")[0]);
            bytes.extend([frame, line.as_bytes()].concat());
        }
        let (_folder, path) = file("f.nmea", &bytes);
        let loaded = load(&ingest::FlightUnit { id: "f".into(), files: vec![path], kind: LogKind::Nmea }).unwrap();
        assert_ledger(&loaded);
        let format = if is_intact { "NMEA 0183 among UBX or RTCM 3" } else { "NMEA 0183" };
        assert_eq!((loaded.health.format.as_str(), lossy(&loaded)), (format, !is_intact));
        let log = read_bytes(READER, &bytes).unwrap();
        let lost = if is_intact { 0 } else { (frame.len() + prefix(60).len()) as u64 };
        assert_eq!((log.health.bytes.damaged, table(&log, "GNGGA").rows), (lost, 100), "{:?}", log.health.damage);
        let column = table(&log, "GNGGA").column("logged_ns").unwrap();
        let truth = |row| Some(ns(row)).filter(|_| is_intact || row != 60);
        assert!((0..100).all(|row| column.integer(row) == truth(row)));
        assert_eq!(log.health.topics.iter().any(|topic| topic.name == "NAV-STATUS"), is_intact);
    }
}

#[test]
fn binary_frames_that_a_receiver_starts_sending_late_are_read() {
    // More sentences than are examined to detect the format, then UBX frames or corrections among them.
    let second = |n: usize| epoch("GN", n % 300, "46.9", "A").join("\r\n") + "\r\n";
    let sentences: String = (0..900).map(second).collect();
    let frame = crate::wire::ubx_frame(1, 7, &[3; 92]);
    let correction = bytes_of("D300133ED7D30202980EDEEF34B4BD62AC0941986F33360B98");
    for (between, topic) in [(&frame, "NAV-PVT"), (&correction, "RTCM3")] {
        let later = (0..10).flat_map(|n| [second(n).as_bytes(), between].concat());
        let bytes: Vec<u8> = sentences.bytes().chain(later).collect();
        let (_folder, path) = file("f.nmea", &bytes);
        let loaded = load(&ingest::FlightUnit { id: "f".into(), files: vec![path], kind: LogKind::Nmea }).unwrap();
        assert_ledger(&loaded);
        let count = |name: &str| loaded.health.topics.iter().find(|t| t.name == name).map(|t| t.messages);
        assert_eq!(["GNGGA", "GNRMC", topic].map(count), [Some(910), Some(910), Some(10)]);
        assert_eq!((loaded.health.bytes.damaged, lossy(&loaded)), (0, false), "{:?}", loaded.flight.notices);
    }
    // A broken frame does not make it such a log.
    let broken = [sentences.as_bytes(), &frame[..50], b"\r\n", second(1).as_bytes()].concat();
    let log = read_bytes(READER, &broken).unwrap();
    assert_eq!((log.health.format.as_str(), log.health.damage_count), ("NMEA 0183", 1));
}
