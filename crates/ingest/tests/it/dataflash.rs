//! ArduPilot DataFlash: real logs against pymavlink, a simulated flight, and all kinds of damage.

use crate::made::lost;
use crate::stream::*;
use crate::support::*;
use crate::wire::*;
use flight::{Clock, Severity, StampKind};
use ingest::{ChannelMap, Limits, Log, LogKind, MapLibrary, Selection, TopicInfo};
use simulate::Container;
use std::collections::BTreeMap;
use std::path::Path;

const READER: ingest::LogKind = ingest::LogKind::DataFlash;

fn record(id: u8, fields: &[&[u8]]) -> Vec<u8> {
    dataflash_record(id, &fields.concat())
}

/// A record of time and one float, as type 10.
fn sample(time_us: u64, value: f32) -> Vec<u8> {
    record(10, &[&time_us.to_le_bytes(), &value.to_le_bytes()])
}

/// The definitions of [`sample`].
fn samples_begin() -> Vec<u8> {
    [dataflash_begin(), dataflash_fmt(10, "ABC", "Qf", "TimeUS,V")].concat()
}

#[test]
fn real_logs_have_the_message_counts_of_pymavlink() {
    // Messages and topics by pymavlink 2.4.50, instances counted apart; all values were compared bit for bit too.
    for (path, messages, topics) in [
        ("pymavlink/tests/test.BIN", 1731, 47),
        ("DeLorean/data/00000002.BIN", 100_000, 69),
        ("DeLorean/data/00000117.BIN", 52_892, 71),
        ("DeLorean/data/00000129.BIN", 41_185, 71),
        ("DeLorean/data/00000130.BIN", 49_231, 71),
        ("DeLorean/data/00000131.BIN", 96_788, 71),
        ("DeLorean/data/00000135.BIN", 13_048, 71),
        ("DeLorean/data/00000139.BIN", 33_777, 70),
        ("DeLorean/data/00000143.BIN", 12_965, 70),
        ("DeLorean/data/00000159.BIN", 101_730, 71),
        ("DeLorean/data/00000160.BIN", 80_284, 72),
        ("DeLorean/data/00000161.BIN", 101_412, 73),
    ] {
        let Some(path) = real_logs(path) else { return };
        let want = |_: &TopicInfo| Selection::Skip;
        let log = in_context(|context| {
            ingest::read_files(ingest::LogKind::DataFlash, std::slice::from_ref(&path), &want, context)
        })
        .unwrap();
        assert_balanced(&log, std::fs::metadata(&path).unwrap().len() as usize);
        let used = log.health.topics.iter().filter(|t| t.messages > 0).count();
        assert_eq!((log.health.messages, used, log.health.undecodable), (messages, topics, 0), "{}", path.display());
    }
}

#[test]
fn a_real_log_of_2017_names_its_vehicle_and_agrees_with_pymavlink() {
    let Some(path) = real_logs("pymavlink/tests/test.BIN") else { return };
    let log = read(READER, &path).unwrap();
    let about = &log.health.about;
    assert_eq!(about.system.as_deref(), Some("ArduPlane"));
    assert_eq!(about.firmware.as_deref(), Some("V3.8.2-dev (8178ab40)"));
    assert_eq!(about.hardware.as_deref(), Some("PX4v4"));
    assert_eq!(about.receivers, ["GPS 1: detected as u-blox at 115200 baud", "u-blox 1 HW: 00040007 SW: 7.03 (45970)"]);
    let delay = |name: &str| about.configured_delays.iter().find(|d| d.parameter == name).map(|d| d.value_s);
    assert_eq!((delay("EK2_GPS_DELAY"), delay("GPS_DELAY_MS")), (Some(0.22), Some(0.0)));
    assert_eq!(about.modes.iter().map(|m| m.mode.as_str()).collect::<Vec<_>>(), ["MANUAL"]);
    assert_eq!(messages(&log, "GPS"), 5);
    // pymavlink: the first NKF1 and NKF6 of the log.
    assert_eq!(table(&log, "NKF1").topic.type_name, "NKF1");
}

#[test]
fn a_simulated_flight_survives_within_the_resolution_of_its_log() {
    let flown = flight(20.0, 100.0);
    let truth = flown.to_flight().unwrap();
    let loaded = load_written(Container::DataFlash, &flown, "flight.bin", LogKind::DataFlash, "ardupilot");
    assert_eq!(count_of(&loaded, "unit-differs"), 0);
    let start_ns = flown.settings.start.0 - 60_000_000_000;
    // The receiver's week and milliseconds date the clock since boot in UTC.
    let dated = loaded.flight.unix(Clock::Boot, flight::Stamp(60_000_000_000)).unwrap();
    assert!((dated.0 - flown.settings.start.0).abs() <= 1_000_000, "{dated:?}");
    for (ours, theirs, quanta) in [
        ("position.gps", "position.gps", [1e-7_f64.to_radians(), 1e-7_f64.to_radians(), 0.01]),
        ("position.truth", "position.truth", [1e-7_f64.to_radians(), 1e-7_f64.to_radians(), 1e-4]),
        ("velocity.ekf", "velocity.gps", [1e-5; 3]),
    ] {
        let ours = &loaded.flight.channels[ours];
        let timeline = ours.series.timeline();
        assert_eq!((timeline.kind(), timeline.clock()), (StampKind::Measured, Clock::Boot));
        let (worst, late) = worst(ours, &truth.channels[theirs], |ns| ns + start_ns);
        assert!(late <= 500, "{late}");
        for (worst, quantum) in worst.into_iter().zip(quanta) {
            assert!(worst > 0.0 && worst <= 0.5001 * quantum, "{worst} of {quantum}");
        }
    }
}

#[test]
fn a_text_log_yields_the_channels_of_the_binary_log_bit_for_bit() {
    let flight = flight(20.0, 50.0);
    let [binary, text] = [(Container::DataFlash, "flight.bin"), (Container::DataFlashText, "flight.log")]
        .map(|(container, name)| load_written(container, &flight, name, LogKind::DataFlash, "ardupilot"));
    assert_eq!(text.flight.channels.len(), binary.flight.channels.len());
    for (name, channel) in &text.flight.channels {
        assert!(*channel == binary.flight.channels[name], "{name}");
    }
    let counts = |loaded: &ingest::Loaded| -> BTreeMap<String, u64> {
        loaded.health.topics.iter().map(|t| (t.name.clone(), t.messages)).collect()
    };
    assert_eq!(counts(&text), counts(&binary));
    let about = &text.health.about;
    assert_eq!(*about, binary.health.about);
    assert_eq!((about.system.as_deref(), about.parameters), (Some("ArduPlane"), 2));
    assert_eq!(about.modes.iter().map(|m| m.mode.as_str()).collect::<Vec<_>>(), ["AUTO"]);
}

/// Offsets and types of the records, and the end.
fn boundaries(bytes: &[u8]) -> Vec<(usize, u8)> {
    let mut lengths = BTreeMap::from([(128_u8, 89_usize)]);
    let (mut at, mut all) = (0, vec![]);
    while at < bytes.len() {
        assert_eq!(bytes[at..at + 2], [0xa3, 0x95]);
        let id = bytes[at + 2];
        all.push((at, id));
        if id == 128 {
            lengths.insert(bytes[at + 3], bytes[at + 4].into());
        }
        at += lengths[&id];
    }
    all.push((at, 0));
    all
}

/// A tiny flight: 0.2 s, nine samples.
fn nine_samples(container: Container) -> Vec<u8> {
    container.files(&flight(0.2, 10.0), "seed").unwrap().remove(0).bytes
}

#[test]
fn a_log_cut_anywhere_gives_the_records_before_the_cut_and_reports_it() {
    let bytes = nine_samples(Container::DataFlash);
    let places = boundaries(&bytes);
    let ends: Vec<usize> = places.iter().map(|(at, _)| *at).collect();
    let samples_from = places.iter().find(|(_, id)| [76, 104, 118].contains(id)).unwrap().0;
    // Every byte of the samples; of the definitions, which are far more, every seventh.
    let lengths = (0..bytes.len()).filter(|length| *length >= samples_from || length % 7 == 0);
    check_cuts(READER, &bytes, lengths, &ends, |length| ends.contains(&length));
}

/// Bytes of records that are, or are not, definitions.
fn places_of(bytes: &[u8], definitions: bool) -> Vec<usize> {
    let places = boundaries(bytes);
    let records = places.windows(2).filter(|p| [128, 177, 178, 179].contains(&p[0].1) == definitions);
    records.flat_map(|p| p[0].0..p[1].0).collect()
}

/// Without a checksum a changed value is undetectable. Only the record before damage may be lost too, never silently.
fn check_sample_flips(bits_of_each_byte: usize) {
    let bytes = nine_samples(Container::DataFlash);
    let whole = rows(&read_bytes(READER, &bytes).unwrap());
    let mut lost = 0;
    let places = places_of(&bytes, false);
    each_flip(READER, &bytes, bits(places, bits_of_each_byte), |log, place, bit| {
        let found = rows(log);
        let (gone, new) = (missing(&whole, &found), missing(&found, &whole));
        assert!(gone <= 2 && new <= 1, "byte {place}, bit {bit}: {gone} rows missing, {new} new");
        assert!(new > 0 || gone == 0 || log.health.bytes.damaged > 0, "byte {place}, bit {bit}: silent loss");
        lost += usize::from(new == 0 && gone > 0);
    });
    assert!(lost > 0, "no flip cost a sample");
}

/// A changed definition affects all records of its type: the definition, the type that it defines, and the one whose
/// number it may now have.
fn check_definition_flips(bits_of_each_byte: usize, stride: usize) {
    let bytes = nine_samples(Container::DataFlash);
    let whole = rows(&read_bytes(READER, &bytes).unwrap());
    let places = places_of(&bytes, true).into_iter().step_by(stride);
    each_flip(READER, &bytes, bits(places, bits_of_each_byte), |log, place, bit| {
        let found = rows(log);
        let definitions = ["FMT", "FMTU", "UNIT", "MULT"];
        let changed =
            whole.iter().filter(|(topic, rows)| found.get(*topic) != Some(rows)).map(|(topic, _)| topic.as_str());
        let changed: Vec<&str> = changed.filter(|topic| !definitions.contains(topic)).collect();
        assert!(changed.len() <= 2, "byte {place}, bit {bit}: {changed:?}");
    });
}

#[test]
fn a_flipped_bit_in_a_sample_costs_no_other_sample_and_none_silently() {
    check_sample_flips(2);
}

#[test]
fn a_flipped_bit_in_a_definition_costs_only_its_own_types() {
    check_definition_flips(1, 5);
}

#[test]
#[ignore = "all 22 000 single bits, about a minute"]
fn every_flipped_bit_in_a_log_costs_only_its_own_record_or_type() {
    check_sample_flips(8);
    check_definition_flips(8, 1);
}

#[test]
fn a_text_log_cut_anywhere_gives_the_lines_before_the_cut() {
    let bytes = nine_samples(Container::DataFlashText);
    let ends: Vec<usize> = (1..=bytes.len()).filter(|end| bytes[end - 1] == b'\n').collect();
    check_cuts(READER, &bytes, (40..bytes.len()).step_by(3), &ends, |length| ends.contains(&length));
}

#[test]
fn a_text_log_with_a_bit_flipped_anywhere_accounts_for_every_byte() {
    let bytes = nine_samples(Container::DataFlashText);
    let whole = read_bytes(READER, &bytes).unwrap().health.messages;
    each_flip(READER, &bytes, (0..bytes.len()).step_by(3).map(|place| (place, place % 8)), |log, place, bit| {
        // At worst a definition is lost, with the ten lines of its type.
        let messages = log.health.messages;
        assert!(messages + 12 >= whole, "byte {place}, bit {bit}: {messages} of {whole} messages");
    });
}

#[test]
fn every_format_character_is_decoded_like_in_pymavlink() {
    let codes = "aBbhHiI";
    let more = "fdnNZcCeELMqQg";
    let array: Vec<u8> = (0..32_i16).flat_map(|i| (i - 5).to_le_bytes()).collect();
    let bytes = [
        dataflash_begin(),
        dataflash_fmt(10, "ABC", codes, "A,B,b,h,H,i,Whole"),
        dataflash_fmt(11, "DEF", more, "f,d,n,N,Z,c,C,e,E,L,M,q,Q,g"),
        record(
            10,
            &[
                &array,
                &[200],
                &[0xfd],
                &(-300_i16).to_le_bytes(),
                &60_000_u16.to_le_bytes(),
                &(-70_000_i32).to_le_bytes(),
                &4_000_000_000_u32.to_le_bytes(),
            ],
        ),
        record(
            11,
            &[
                &1.5_f32.to_le_bytes(),
                &0.1_f64.to_le_bytes(),
                b"ABCD",
                &padded("sixteen", 16),
                &padded("text, with a comma", 64),
                &(-1234_i16).to_le_bytes(),
                &35_999_u16.to_le_bytes(),
                &(-123_456_i32).to_le_bytes(),
                &4_000_000_001_u32.to_le_bytes(),
                &(-353_632_621_i32).to_le_bytes(),
                &[5],
                &i64::MIN.to_le_bytes(),
                &(i64::MAX as u64).to_le_bytes(),
                &0xc500_u16.to_le_bytes(),
            ],
        ),
    ]
    .concat();
    let log = read_bytes(READER, &bytes).unwrap();
    let number = |topic, field| numbers(&log, topic, field)[0];
    let fields = ["A[0]", "A[31]", "B", "b", "h", "H", "i", "Whole"];
    assert_eq!(fields.map(|f| number("ABC", f)), [-5.0, 26.0, 200.0, -3.0, -300.0, 60_000.0, -70_000.0, 4e9]);
    let fields = ["f", "d", "c", "C", "e", "E", "L", "M", "g"];
    let expected = [1.5, 0.1, -12.34, 359.99, -1234.56, 40_000_000.01, -35.363_262_1, 5.0, -5.0];
    assert_eq!(fields.map(|f| number("DEF", f)), expected);
    let def = table(&log, "DEF");
    assert_eq!(
        (def.column("q").unwrap().integer(0), def.column("Q").unwrap().integer(0)),
        (Some(i64::MIN), Some(i64::MAX))
    );
    let text = |field| def.column(field).unwrap().text(0).unwrap();
    assert_eq!(["n", "N", "Z"].map(text), ["ABCD", "sixteen", "text, with a comma"]);
}

#[test]
fn a_second_receiver_is_a_separate_topic_with_and_without_units() {
    let gps = |instance: u8, lat: i32| {
        record(10, &[&(1_000_000_u64 * u64::from(instance) + 7).to_le_bytes(), &[instance], &lat.to_le_bytes()])
    };
    let definitions = [dataflash_begin(), dataflash_fmt(10, "GPS", "QBL", "TimeUS,I,Lat")].concat();
    let units = [dataflash_fmt(12, "FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds")].concat();
    let fmtu = |ids: &str| record(12, &[&0_u64.to_le_bytes(), &[10], &padded(ids, 16), &padded("F-G", 16)]);
    let log = read_bytes(READER, &[definitions.clone(), gps(0, 1), gps(1, 2), gps(0, 3)].concat()).unwrap();
    assert_eq!(numbers(&log, "GPS", "Lat"), [1e-7, 3e-7]);
    assert_eq!(numbers(&log, "GPS_1", "Lat"), [2e-7]);
    assert_eq!(table(&log, "GPS_1").topic.type_name, "GPS");
    // A log may state that its column I is not an instance.
    let log =
        read_bytes(READER, &[definitions.clone(), units.clone(), fmtu("s-D"), gps(0, 1), gps(1, 2)].concat()).unwrap();
    assert_eq!(numbers(&log, "GPS", "Lat").len(), 2);
    // If it states so too late, that is reported.
    let log = read_bytes(READER, &[definitions, units, gps(1, 1), fmtu("s-D"), gps(1, 2)].concat()).unwrap();
    assert!(codes(&log).contains(&"redefined"), "{:?}", log.notices);
}

#[test]
fn the_replay_estimator_is_bound_next_to_that_of_the_flight() {
    let core = |number: u8, time_us: u64, north: f32| {
        record(10, &[&time_us.to_le_bytes(), &[number], &[0; 6], &[north, 0.0, 0.0].map(f32::to_le_bytes).concat()])
    };
    let begin = [dataflash_begin(), dataflash_fmt(10, "XKF1", "QBccCfff", "TimeUS,C,Roll,Pitch,Yaw,PN,PE,PD")].concat();
    let records: Vec<u8> = (1..5_u64)
        .flat_map(|i| [core(0, 100_000 * i, i as f32), core(100, 100_000 * i, -(i as f32))].concat())
        .collect();
    let (_folder, path) = file("replay.bin", &[begin, records].concat());
    let unit = ingest::FlightUnit { id: "replay".into(), files: vec![path], kind: LogKind::DataFlash };
    let loaded = load(&unit).unwrap();
    let north = |channel: &str| loaded.flight.channels[channel].series.component(0).to_vec();
    assert_eq!(north("position.ekf"), [1.0, 2.0, 3.0, 4.0]);
    assert_eq!(north("position.ekf-replay"), [-1.0, -2.0, -3.0, -4.0]);
    assert_eq!(loaded.flight.channels["attitude.core-replay"].series.len(), 4);
}

#[test]
fn a_gps_record_of_2013_has_autopilot_time_not_its_time_of_week() {
    let bytes = [
        dataflash_begin(),
        dataflash_fmt(10, "GPS", "BIHBcLLeeEeI", "Status,TimeMS,Week,NSats,HDop,Lat,Lng,RelAlt,Alt,Spd,GCrs,T"),
        dataflash_fmt(11, "IMU", "Iffffff", "TimeMS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
        record(
            10,
            &[
                &[3],
                &302_400_000_u32.to_le_bytes(),
                &1750_u16.to_le_bytes(),
                &[9],
                &150_i16.to_le_bytes(),
                &(-353_632_621_i32).to_le_bytes(),
                &1_491_652_374_i32.to_le_bytes(),
                &0_i32.to_le_bytes(),
                &58_585_i32.to_le_bytes(),
                &1234_u32.to_le_bytes(),
                &9000_i32.to_le_bytes(),
                &65_432_u32.to_le_bytes(),
            ],
        ),
        record(11, &[&65_500_u32.to_le_bytes(), &[0; 24]]),
    ]
    .concat();
    let (_folder, path) = file("old.bin", &bytes);
    let unit = ingest::FlightUnit { id: "old".into(), files: vec![path], kind: LogKind::DataFlash };
    let loaded = load(&unit).unwrap();
    let gps = &loaded.flight.channels["position.gps"].series;
    assert_eq!(gps.timeline().first().unwrap().0, 65_432_000_000);
    assert_eq!(gps.component(0)[0], (-35.363_262_1_f64).to_radians());
    let velocity = &loaded.flight.channels["velocity.gps"].series;
    assert!(velocity.component(0)[0].abs() < 1e-12 && velocity.component(1)[0] == 12.34);
    assert_eq!(loaded.flight.channels["angular-rate.imu"].series.timeline().first().unwrap().0, 65_500_000_000);
}

#[test]
fn fixes_before_2013_use_their_time_of_week_for_lack_of_another_time() {
    let lines = [
        "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns",
        "FMT, 130, 35, GPS, BIBcLLeeEe, Status,Time,NSats,HDop,Lat,Lng,RelAlt,Alt,Spd,GCrs",
        "GPS, 2, 302400000, 4, 4.68, 44.1000000, -77.7000000, 3.13, 91.56, 0.00, 0.00",
        "GPS, 3, 302400200, 9, 1.50, 44.1000000, -77.7000000, 3.13, 91.56, 5.00, 90.00",
        "GPS, 3, 302400400, 9, 1.50, 44.1000000, -77.6999900, 3.13, 91.56, 5.00, 90.00",
    ];
    let (_folder, path) = file("old.log", lines.map(|line| format!("{line}\n")).concat().as_bytes());
    let unit = ingest::FlightUnit { id: "old".into(), files: vec![path], kind: LogKind::DataFlash };
    let flight = load(&unit).unwrap().flight;
    for name in ["position.gps", "velocity.gps"] {
        let timeline = flight.channels[name].series.timeline();
        assert_eq!(timeline.clock(), flight::Clock::Elapsed);
        assert_eq!(
            timeline.stamps().iter().map(|s| s.0).collect::<Vec<_>>(),
            [302_400_200_000_000, 302_400_400_000_000]
        );
    }
}

#[test]
fn px4_records_before_ulog_use_the_preceding_time_record() {
    let time = |us: u64| record(129, &[&us.to_le_bytes()]);
    // 2015-06-01 12:00:00 UTC.
    let gps = |utc_us: u64, fix: u8, lat_e7: i32| {
        let [north, east, down] = [3.0_f32, 4.0, -0.5].map(f32::to_le_bytes);
        let (accuracy, height) = (1.5_f32.to_le_bytes(), 488.25_f32.to_le_bytes());
        let place = [lat_e7.to_le_bytes(), 85_455_940_i32.to_le_bytes()].concat();
        record(8, &[&utc_us.to_le_bytes(), &[fix], &accuracy, &accuracy, &place, &height, &north, &east, &down])
    };
    let local = |x: f32, flags: u8| record(6, &[&x.to_le_bytes(), &x.to_le_bytes(), &[flags]]);
    let text = |bytes: &str, length: usize| [bytes.as_bytes(), &vec![0; length - bytes.len()]].concat();
    let bytes = [
        dataflash_fmt(129, "TIME", "Q", "StartTime"),
        dataflash_fmt(130, "VER", "NZ", "Arch,FwGit"),
        dataflash_fmt(131, "PARM", "Nf", "Name,Value"),
        dataflash_fmt(8, "GPS", "QBffLLffff", "GPSTime,Fix,EPH,EPV,Lat,Lon,Alt,VelN,VelE,VelD"),
        dataflash_fmt(6, "LPOS", "ffB", "VX,VY,PFlg"),
        record(130, &[&text("PX4FMU_V2", 16), &text("9bd3e660", 64)]),
        record(131, &[&text("PE_POS_DELAY_MS", 16), &210_f32.to_le_bytes()]),
        time(5_000_000),
        gps(1_433_160_000_000_000, 3, 473_977_420),
        local(1.0, 15),
        time(5_200_000),
        gps(1_433_160_000_200_000, 3, 473_977_430),
        local(2.0, 11),
        time(5_400_000),
        gps(0, 1, 0),
        local(3.0, 15),
        time(5_600_000),
    ];
    let (_folder, path) = file("log001.px4log", &bytes.concat());
    let unit = ingest::FlightUnit { id: "log001".into(), files: vec![path], kind: LogKind::DataFlash };
    let loaded = load(&unit).unwrap();
    assert_eq!(loaded.binding.as_ref().map(|binding| binding.map.as_str()), Ok("px4-sdlog2"));
    let channel = |name: &str| &loaded.flight.channels[name].series;
    let stamps = |name: &str| channel(name).timeline().stamps().iter().map(|s| s.0).collect::<Vec<_>>();
    assert_eq!(stamps("position.gps"), [5_000_000_000, 5_200_000_000]);
    // The velocity of the second row is flagged invalid.
    assert_eq!(stamps("velocity.ekf"), [5_000_000_000, 5_400_000_000]);
    assert_eq!(channel("position.gps").component(0)[1], 47.397_743_f64.to_radians());
    assert_eq!(channel("velocity.gps").component(1), [4.0, 4.0]);
    let unix = loaded.flight.unix(flight::Clock::Boot, flight::Stamp(5_200_000_000));
    assert_eq!(unix, Some(flight::Stamp(1_433_160_000_200_000_000)));
    let about = &loaded.health.about;
    assert_eq!((about.system.as_deref(), about.hardware.as_deref()), (Some("PX4"), Some("PX4FMU_V2")));
    assert_eq!((about.configured_delays[0].value_s, loaded.health.bytes.damaged), (0.21, 0));
}

#[test]
fn a_log_whose_first_receiver_has_no_fix_is_dated_by_its_second() {
    let gps = |time_us: u64, instance: u8| {
        let (fix, week_ms, week) = if instance == 1 { (3_u8, (time_us / 1000) as u32, 2086_u16) } else { (1, 0, 0) };
        let place = [473_977_420_i32, 85_455_940, 48_800].map(i32::to_le_bytes).concat();
        record(10, &[&time_us.to_le_bytes(), &[instance, fix], &week_ms.to_le_bytes(), &week.to_le_bytes(), &place])
    };
    let begin =
        [dataflash_begin(), dataflash_fmt(10, "GPS", "QBBIHLLe", "TimeUS,I,Status,GMS,GWk,Lat,Lng,Alt")].concat();
    let records: Vec<u8> = (0..40_u64).flat_map(|i| gps(5_000_000 + 100_000 * i, (i % 2) as u8)).collect();
    let (_folder, path) = file("second.bin", &[begin, records].concat());
    let unit = ingest::FlightUnit { id: "second".into(), files: vec![path], kind: LogKind::DataFlash };
    let loaded = load(&unit).unwrap();
    assert_eq!(loaded.flight.channels.keys().filter(|name| name.starts_with("position")).count(), 1);
    // Week 2086 of GPS time began on 29 December 2019, 18 leap seconds before that day did in UTC.
    let utc = loaded.flight.unix(Clock::Boot, flight::Stamp(0)).unwrap();
    assert_eq!(utc.0, (1_577_577_600 - 18) * 1_000_000_000);
}

#[test]
fn a_changed_parameter_has_its_new_value_and_the_time_of_its_record() {
    let set = |time_us: u64, value: f32| record(10, &[&time_us.to_le_bytes(), &padded("A", 16), &value.to_le_bytes()]);
    let begin = [dataflash_begin(), dataflash_fmt(10, "PARM", "QNf", "TimeUS,Name,Value")].concat();
    let log = read_bytes(READER, &[begin, set(1_000_000, 0.1), set(2_500_000, 0.15)].concat()).unwrap();
    assert_eq!(log.health.about.parameter_changes, ["A at 2.500 s: 0.1 to 0.15"]);
}

#[test]
fn two_boots_in_one_file_are_consecutive_and_the_restart_is_reported() {
    let boot = |from: u64| -> Vec<u8> {
        let samples = (0..50_u64).flat_map(|i| sample(from + 20_000 * i, i as f32));
        [samples_begin(), samples.collect()].concat()
    };
    let log = read_bytes(READER, &[boot(5_000_000), boot(3_000_000)].concat()).unwrap();
    let times = numbers(&log, "ABC", "TimeUS");
    assert_eq!(times.len(), 100);
    assert!(times.windows(2).all(|w| w[0] < w[1]), "{times:?}");
    // Within a boot nothing moves, and the applied shift is in whole seconds.
    assert_eq!(times[49], 5_980_000.0);
    assert_eq!(times[50], 15_000_000.0);
    assert_eq!(times[99] - times[50], 980_000.0);
    assert!(codes(&log).contains(&"several-sessions"), "{:?}", log.notices);
    // A second log whose clock continues is not shifted.
    let log = read_bytes(READER, &[boot(5_000_000), boot(9_000_000)].concat()).unwrap();
    assert_eq!(numbers(&log, "ABC", "TimeUS")[50], 9_000_000.0);
    assert!(!codes(&log).contains(&"several-sessions"));
}

#[test]
fn a_clock_that_steps_back_is_reported_and_mere_disorder_is_not() {
    let log = |times: &[u64]| {
        let samples: Vec<u8> = times.iter().flat_map(|t| sample(*t, 0.0)).collect();
        read_bytes(READER, &[samples_begin(), samples].concat()).unwrap()
    };
    assert!(codes(&log(&[1_000_000, 1_020_000, 1_010_000, 1_030_000])).is_empty());
    let jump = log(&[10_000_000, 10_020_000, 2_000_000, 2_020_000]);
    assert_eq!(codes(&jump), ["unreliable-stamps"]);
    assert_eq!(numbers(&jump, "ABC", "TimeUS"), [1e7, 10_020_000.0, 2e6, 2_020_000.0]);
    // A timestamp that overflows nanoseconds is rejected, without a panic.
    let beyond = log(&[1_000_000, u64::MAX, i64::MAX as u64, 1_020_000]);
    assert_eq!(table(&beyond, "ABC").rows, 4);
}

#[test]
fn padding_at_the_end_is_not_damage_but_garbage_is() {
    let whole: Vec<u8> = [samples_begin(), (0..9).flat_map(|i| sample(20_000 * i, 1.0)).collect()].concat();
    for filling in [0, 0xff] {
        for length in [1, 2, 300, 700_000] {
            let log = read_bytes(READER, &[whole.clone(), vec![filling; length]].concat()).unwrap();
            assert_eq!((log.health.bytes.damaged, log.health.messages), (0, 11), "{filling} × {length}");
            assert_eq!(codes(&log), ["skipped"]);
        }
    }
    // Nothing after the record just before a little garbage confirms it.
    let garbage = b"garbage that is no record";
    let log = read_bytes(READER, &[whole.clone(), garbage.to_vec(), vec![0; 1000]].concat()).unwrap();
    assert_eq!((log.health.bytes.damaged, log.health.bytes.structure, log.health.messages), (15 + 25, 1000, 10));
    // Zeros in the middle of a log are damage and cost the preceding record.
    let log =
        read_bytes(READER, &[whole.clone(), vec![0; 5000], sample(1_000_000, 2.0), sample(1_020_000, 2.0)].concat())
            .unwrap();
    assert_eq!((log.health.bytes.damaged, log.health.messages), (5015, 12), "{:?}", log.health.damage);
}

#[test]
fn a_log_without_its_beginning_is_read_from_its_first_definition() {
    let bytes = [&[7; 1000][..], &sample(1, 1.0), &samples_begin(), &sample(2, 2.0), &sample(3, 3.0)].concat();
    let (folder, _path) = file("00000007.BIN", &bytes);
    let found = ingest::discover(folder.path(), &MapLibrary::shipped().unwrap()).unwrap();
    assert_eq!(found.units[0].kind, LogKind::DataFlash);
    let log = read(READER, &found.units[0].files[0]).unwrap();
    assert_balanced(&log, bytes.len());
    assert_eq!((numbers(&log, "ABC", "V"), log.health.bytes.damaged), (vec![2.0, 3.0], 1015));
}

#[test]
fn definitions_with_nonsense_lengths_cost_only_their_own_records() {
    let good: Vec<u8> = (0..5).flat_map(|i| sample(20_000 * i, 1.0)).collect();
    for length in [0, 1, 2, 3, 14, 16, 254, 255] {
        // The length disagrees with the format characters, which say 15.
        let bytes = [dataflash_begin(), dataflash_fmt_of(10, length, "ABC", "Qf", "TimeUS,V"), good.clone()].concat();
        let log = read_bytes(READER, &bytes).unwrap();
        assert_eq!((numbers(&log, "ABC", "V").len(), log.health.bytes.damaged), (5, 0), "{length}");
    }
    for (length, codes, columns) in [(15, "Qq", "TimeUS,V"), (15, "Q?", "TimeUS,V"), (15, "Qf", "TimeUS"), (15, "", "")]
    {
        let other = [dataflash_fmt(11, "DEF", "QB", "TimeUS,B"), record(11, &[&[0; 8], &[1]])].concat();
        let log = read_bytes(
            READER,
            &[dataflash_begin(), dataflash_fmt_of(10, length, "ABC", codes, columns), good.clone(), other].concat(),
        )
        .unwrap();
        assert_eq!(messages(&log, "DEF"), 1, "{codes} {columns}");
        assert!(log.tables.iter().all(|t| t.topic.name != "ABC"), "{codes} {columns}: {:?}", log.tables);
        assert!(!codes_of_trouble(&log).is_empty(), "{codes} {columns}");
    }
}

fn codes_of_trouble(log: &Log) -> Vec<&str> {
    log.notices.iter().filter(|n| n.severity != Severity::Info).map(|n| n.code.as_str()).collect()
}

#[test]
fn a_type_defined_twice_uses_its_last_definition_and_is_reported() {
    let again =
        read_bytes(READER, &[samples_begin(), samples_begin(), sample(1, 1.0), sample(2, 1.0)].concat()).unwrap();
    assert_eq!((numbers(&again, "ABC", "V").len(), codes(&again)), (2, vec![]));
    let other = [
        samples_begin(),
        sample(1, 1.0),
        dataflash_fmt(10, "XYZ", "Qh", "TimeUS,H"),
        record(10, &[&2_u64.to_le_bytes(), &(-5_i16).to_le_bytes()]),
        record(10, &[&3_u64.to_le_bytes(), &(-6_i16).to_le_bytes()]),
    ];
    let log = read_bytes(READER, &other.concat()).unwrap();
    assert_eq!((numbers(&log, "ABC", "V"), numbers(&log, "XYZ", "H")), (vec![1.0], vec![-5.0, -6.0]));
    assert_eq!(codes_of_trouble(&log), ["redefined"]);
    // PX4's sdlog2 gave two types one number; where neither was written, nothing is lost.
    let unused = [samples_begin(), dataflash_fmt(10, "XYZ", "Qh", "TimeUS,H")].concat();
    let log = read_bytes(READER, &unused).unwrap();
    assert_eq!((codes(&log), codes_of_trouble(&log)), (vec!["redefined"], vec![]));
    // Memory stays bounded with a hostile log.
    let many: Vec<u8> = (0..6000_u32).flat_map(|i| dataflash_fmt(10, "ABC", "Qf", &format!("TimeUS,V{i}"))).collect();
    let log = read_bytes(READER, &[dataflash_begin(), many].concat()).unwrap();
    assert!(log.health.bytes.damaged > 0 && codes(&log).contains(&"redefined"));
}

/// Definitions of three types, `ABC` as [`sample`] and two longer ones, and some records of each.
fn three_types(records: u64) -> [Vec<u8>; 2] {
    let begin = [
        samples_begin(),
        dataflash_fmt(11, "POS", "QLLf", "TimeUS,Lat,Lng,Alt"),
        dataflash_fmt(12, "IMU", "QBfff", "TimeUS,I,X,Y,Z"),
    ];
    let of = |i: u64| {
        let time = (1_000_000 + 10_000 * i).to_le_bytes();
        let value = (i as f32).to_le_bytes();
        let place = (470_000_000 + i as i32).to_le_bytes();
        let imu = |instance: u8| record(12, &[&time, &[instance], &value, &value, &value]);
        [sample(1_000_000 + 10_000 * i, i as f32), record(11, &[&time, &place, &place, &value]), imu(0), imu(1)]
            .concat()
    };
    [begin.concat(), (0..records).flat_map(of).collect()]
}

#[test]
fn a_definition_under_the_id_of_another_type_is_reported() {
    let [begin, records] = three_types(60);
    let rows = |log: &Log, topic: &str| log.tables.iter().find(|t| t.topic.name == topic).map_or(0, |t| t.rows);
    for (taken, untouched) in [(10, "IMU"), (12, "ABC")] {
        let mut lying = begin.clone();
        let fmt = lying.windows(9).position(|w| w[0] == 11 && &w[2..5] == b"POS").unwrap();
        lying[fmt] = taken;
        let log = read_bytes(READER, &[&lying[..], &records].concat()).unwrap();
        assert_eq!(rows(&log, untouched), 60, "{taken}: {:?}", log.notices);
        assert!(lost(&log), "{:?}", log.notices);
    }
}

#[test]
fn units_of_another_type_make_no_instances_and_are_reported() {
    let [begin, records] = three_types(40);
    let fmtu = dataflash_fmt(13, "FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds");
    let units = |id: u8, units: &str| {
        let text = |text: &str| [text.as_bytes(), &[0; 16][text.len()..]].concat();
        record(13, &[&0_u64.to_le_bytes(), &[id], &text(units), &text(&"F".repeat(units.len()))])
    };
    let with =
        |more: &[u8]| read_bytes(READER, &[&begin[..], &fmtu, &units(12, "s#ooo"), more, &records].concat()).unwrap();
    let names = |log: &Log| log.tables.iter().map(|t| t.topic.name.clone()).filter(|n| n != "FMTU").collect::<Vec<_>>();
    let whole = with(&[]);
    assert_eq!(names(&whole), ["ABC", "FMT", "IMU", "IMU_1", "POS"]);
    for (lie, code) in
        [(units(12, "sDU"), "redefined"), (units(12, "s-ooo"), "redefined"), (units(10, "sDUm"), "redefined")]
    {
        let log = with(&lie);
        assert_eq!(names(&log), names(&whole), "{:?}", log.notices);
        assert!(codes(&log).contains(&code), "{code}: {:?}", log.notices);
    }
}

#[test]
fn the_record_just_before_damage_is_dropped_and_none_is_mixed_from_two() {
    let [begin, records] = three_types(30);
    let places: Vec<usize> = memchr::memmem::find_iter(&records, b"\xa3\x95").collect();
    let whole = read_bytes(READER, &[&begin[..], &records].concat()).unwrap().health.messages;
    for (index, &at) in places.iter().enumerate().skip(3).step_by(5) {
        // The sync bytes of a record, and a place without a record.
        let mut overwritten = records.clone();
        overwritten[at..at + 2].fill(0x11);
        let zeros = [&records[..at], &[0; 512], &records[at..]].concat();
        for (damaged, costs) in [(overwritten, 2), (zeros, 1)] {
            let log = read_bytes(READER, &[&begin[..], &damaged].concat()).unwrap();
            assert_eq!(log.health.messages + costs, whole, "record {index}: {:?}", log.health.damage);
            assert!(lost(&log));
        }
    }
}

#[test]
fn a_unit_that_differs_from_the_map_is_reported() {
    let flight = flight(5.0, 20.0);
    let bytes = Container::DataFlash.files(&flight, "f").unwrap().remove(0).bytes;
    let text = MapLibrary::shipped().unwrap().get("ardupilot").unwrap().text().to_owned();
    let wrong = text.replace("field = \"VN\", unit = \"m/s\"", "field = \"VN\", unit = \"cm/s\"");
    let mut library = MapLibrary::shipped().unwrap();
    library.add(ChannelMap::from_toml(Path::new("ardupilot.toml"), &wrong).unwrap());
    let (_folder, path) = file("f.bin", &bytes);
    let unit = ingest::FlightUnit { id: "f".into(), files: vec![path], kind: LogKind::DataFlash };
    let loaded = load_mapped(&unit, &library, None).unwrap();
    let notice = loaded.flight.notices.iter().find(|n| n.code == "unit-differs").unwrap();
    assert!(notice.text.contains("VN is m/s") && notice.text.contains("cm/s"), "{}", notice.text);
}

#[test]
fn console_lines_before_a_text_log_are_not_damage_but_bad_lines_are() {
    let lines = [
        "ArduCopter V3.1",
        "",
        "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns",
        "FMT, 10, 15, ABC, Qf, TimeUS,V",
        "FMT, 11, 75, MSG, QZ, TimeUS,Message",
        "ABC, 20000, 1.5",
        "ABC, 40000",
        "XYZ, 1, 2",
        "ABC, 60000, -nan",
        "ABC, 80000, high",
        "MSG, 90000, well, all of it",
        "ABC, 100000, 2.5, 7",
        "ABC, 120000, 3.5",
    ];
    let bytes = format!("{}\n", lines.join("\r\n"));
    let log = read_bytes(READER, bytes.as_bytes()).unwrap();
    assert_eq!(log.health.format, "ArduPilot DataFlash (text)");
    assert_eq!(table(&log, "MSG").column("Message").unwrap().text(0), Some("well, all of it"));
    let values = numbers(&log, "ABC", "V");
    assert!(values[0] == 1.5 && values[1].is_nan() && values[2] == 3.5 && values.len() == 3, "{values:?}");
    assert_eq!(log.health.damage_count, 3, "{:?}", log.health.damage);
    assert_eq!(log.health.undecodable, 1);
    let lengths = ["ABC, 40000", "XYZ, 1, 2", "ABC, 100000, 2.5, 7"].map(|line| line.len() as u64 + 2);
    assert_eq!(log.health.damage.iter().map(|d| d.length).collect::<Vec<_>>(), lengths);
}

#[test]
fn two_records_in_one_line_are_damage_but_commas_in_a_text_are_not() {
    for comma in [", ", ","] {
        let text = |joint: &str| {
            let head =
                "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\nFMT, 11, 75, MSG, QZ, TimeUS,Message\n";
            let head = head.replace(", ", comma);
            format!("{head}MSG{comma}10{comma}mode AUTO{comma}5 of 7{joint}MSG{comma}20{comma}landed\n")
        };
        let whole = read_bytes(READER, text("\n").as_bytes()).unwrap();
        assert_eq!((table(&whole, "MSG").rows, whole.health.bytes.damaged), (2, 0), "{comma:?}");
        let joined = text("J");
        let log = read_bytes(READER, joined.as_bytes()).unwrap();
        let line = joined.lines().last().unwrap().len() as u64 + 1;
        assert_eq!(log.health.bytes.damaged, line, "{comma:?}: {:?}", log.health.damage);
    }
}

#[test]
fn mission_planners_escapes_do_not_make_a_text_too_long() {
    let line = |text: &str| {
        let head = "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\nFMT, 11, 75, MSG, QZ, TimeUS,Message\n";
        read_bytes(READER, format!("{head}MSG, 10, {text}\r\n").as_bytes()).unwrap()
    };
    // A field has 64 characters.
    for (written, each) in [("\\n", 2), ("\\x1B", 4), ("\\\\", 2), ("x", 1)] {
        assert_eq!(written.len(), each);
        assert_eq!(line(&written.repeat(64)).health.bytes.damaged, 0, "{written}");
        assert!(line(&written.repeat(65)).health.bytes.damaged > 0, "{written}");
    }
    // These are not escapes.
    assert!(line(&"\\q".repeat(33)).health.bytes.damaged > 0 && line(&"\\xG1".repeat(17)).health.bytes.damaged > 0);
}

#[test]
fn a_text_log_without_its_first_line_reports_a_loss() {
    let text = "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\nFMT, 10, 15, ABC, Qf, TimeUS,V\n\
                FMT, 11, 15, DEF, Qf, TimeUS,V\nABC, 1, 2.5\n";
    let lost = |text: &str| {
        read_bytes(READER, text.as_bytes()).unwrap().notices.iter().any(|n| n.code == "incomplete-recording")
    };
    assert!(!lost(text));
    assert!(lost(&text.replacen("FMT", "GMT", 1)));
}

#[test]
fn a_byte_order_mark_in_front_of_a_text_log_costs_nothing() {
    let text = "\u{feff}FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\nFMT, 10, 15, ABC, Qf, TimeUS,V\n\
                ABC, 1, 2.5\n";
    let log = read_bytes(READER, text.as_bytes()).unwrap();
    assert_eq!(numbers(&log, "ABC", "V"), [2.5]);
    assert_eq!((messages(&log, "FMT"), codes(&log)), (2, vec![]));
    assert_balanced(&log, text.len());
}

#[test]
fn a_line_longer_than_the_limit_is_damage_and_the_next_one_is_read() {
    let long = format!("ABC, 1, {}\n", "7".repeat(5000));
    let text = format!(
        "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\nFMT, 10, 15, ABC, Qf, TimeUS,V\n{long}ABC, 2, 2.5\n"
    );
    let log = read_within(Limits { line_bytes: 1000, ..Limits::default() }, READER, text.as_bytes());
    assert_eq!((numbers(&log, "ABC", "V"), log.health.bytes.damaged as usize), (vec![2.5], long.len()));
}

#[test]
fn what_is_no_log_is_refused_with_a_reason() {
    check_refusals(READER, "text");
}

#[test]
fn a_damaged_record_takes_no_values_from_records_its_wrong_type_spans() {
    // Type 12 is as long as two records of type 10.
    let big = [
        dataflash_begin(),
        dataflash_fmt(10, "ABC", "Qf", "TimeUS,V"),
        dataflash_fmt(12, "BIG", "QQQBBB", "TimeUS,A,B,C,D,E"),
    ]
    .concat();
    assert_eq!(dataflash_size("QQQBBB"), 2 * dataflash_size("Qf"));
    let mut bytes = [big, sample(1, 1.0), sample(2, 2.0), sample(3, 3.0), sample(4, 4.0)].concat();
    let second = bytes.len() - 3 * 15;
    bytes[second + 2] = 12;
    let log = read_bytes(READER, &bytes).unwrap();
    assert_eq!((numbers(&log, "ABC", "V"), log.health.bytes.damaged), (vec![1.0, 3.0, 4.0], 15));
    assert_eq!(messages(&log, "BIG"), 0);
}

#[test]
fn a_number_that_looks_like_a_record_head_is_still_a_number() {
    // As in real ArduPilot logs with a double of -0.0211: its last bytes look like a record head, and the false record
    // ends where the true one ends.
    let looks_like = f64::from_bits(0x0a95_a3b8_de1c_ec0c);
    let position = record(12, &[&2_u64.to_le_bytes(), &looks_like.to_le_bytes(), &(-5.02_f64).to_le_bytes(), &[7; 4]]);
    assert_eq!(position.windows(3).position(|head| head == [0xa3, 0x95, 10]), Some(position.len() - 15));
    let defined = [samples_begin(), dataflash_fmt(12, "POS", "Qddf", "TimeUS,X,Y,Z")];
    let bytes = [defined.concat(), sample(1, 1.0), position, sample(3, 3.0)].concat();
    let log = read_bytes(READER, &bytes).unwrap();
    assert_eq!((numbers(&log, "ABC", "V"), numbers(&log, "POS", "X")), (vec![1.0, 3.0], vec![looks_like]));
    assert_eq!(log.health.bytes.damaged, 0);
}
