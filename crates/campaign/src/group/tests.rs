use super::*;
use flight::{Channel, ChannelSource, Clock, Flight, Quantity, Series, Stamp, Timeline};
use record::FlightContent;

fn binding(map: &str) -> Binding {
    Binding { map: map.to_owned(), why: String::new(), others: vec![], channels: vec![] }
}

fn identified() -> About {
    let receiver = ReceiverIdentity {
        number: 1,
        model: Some("u-blox M8".to_owned()),
        firmware: Some("3.01".to_owned()),
        rate_hz: Some(5.0),
        baud: Some(115_200),
        protocol: Some("UBX".to_owned()),
        sources: [("rate".to_owned(), "GPS_RATE_MS".to_owned())].into(),
        ..ReceiverIdentity::default()
    };
    About { vehicle: Some("00360029".to_owned()), receiver_identities: vec![receiver], ..About::default() }
}

fn group(about: &About, rate_hz: f64) -> ReceiverGroup {
    let format = "ArduPilot DataFlash (text)";
    group_of(about, &binding("ardupilot"), format, "position.gps", Some(rate_hz), StampKind::Measured)
}

#[test]
fn a_group_is_the_receiver_identity_from_the_log() {
    let group = group(&identified(), 4.98);
    assert_eq!(group.name, "u-blox M8 3.01, 5 Hz, 115200 baud, ArduPilot DataFlash");
    assert!(group.told_by_log);
    let rate = group.parts.iter().find(|part| part.what == "rate").unwrap();
    assert_eq!((rate.value.as_str(), rate.from.as_str()), ("5 Hz", "GPS_RATE_MS"));
    assert!(!group.key.contains("00360029"), "{}", group.key);
}

#[test]
fn nearly_equal_rates_are_one_group_and_others_are_not() {
    let silent = About::default();
    let [a, b, c] = [4.98, 5.02, 10.0].map(|hz| group(&silent, hz));
    assert_eq!((&a.key, a.name.as_str()), (&b.key, "unknown receiver of map ardupilot, 5 Hz, ArduPilot DataFlash"));
    assert!(a.key != c.key && !a.told_by_log);
    for (measured, usual) in
        [(0.999, 1.0), (1.98, 2.0), (3.9, 4.0), (9.1, 10.0), (17.9, 20.0), (49.0, 50.0), (99.7, 100.0)]
    {
        assert_eq!(usual_rate_hz(measured), Some(usual), "{measured}");
    }
    assert_eq!([0.0, -1.0, f64::NAN, f64::INFINITY].map(usual_rate_hz), [None; 4]);
}

#[test]
fn each_fact_of_the_key_makes_another_group() {
    let changed = |change: fn(&mut ReceiverIdentity)| {
        let mut about = identified();
        about.receiver_identities.iter_mut().for_each(change);
        group(&about, 5.0).key
    };
    let mut keys = vec![
        changed(|_| ()),
        changed(|r| r.model = Some("u-blox 9".to_owned())),
        changed(|r| r.firmware = Some("4.04".to_owned())),
        changed(|r| r.serial = Some("d001".to_owned())),
        changed(|r| r.rate_hz = Some(10.0)),
        changed(|r| r.baud = Some(230_400)),
    ];
    // A logger that drops fixes does not change the receiver.
    let decimated = group(&identified(), 1.0);
    assert_eq!(decimated.key, keys[0]);
    assert!(decimated.parts.iter().any(|part| part.what == "logged rate" && part.value == "1 Hz"));
    for (map, format, stamps) in [
        ("mine", "ArduPilot DataFlash", StampKind::Measured),
        ("ardupilot", "MCAP", StampKind::Measured),
        ("ardupilot", "ArduPilot DataFlash", StampKind::Logged),
    ] {
        keys.push(group_of(&identified(), &binding(map), format, "position.gps", Some(5.0), stamps).key);
    }
    let all = keys.len();
    keys.sort();
    keys.dedup();
    assert_eq!(keys.len(), all, "{keys:#?}");
    // An equivalent spelling does not make another group.
    assert_eq!(changed(|r| r.model = Some("U-blox  m8".to_owned())), changed(|_| ()));
}

#[test]
fn the_second_position_is_of_the_second_receiver() {
    assert_eq!(
        ["position.gps", "position.gps-2", "position.gps-0", "position.my-own"].map(receiver_number),
        [1, 2, 1, 1]
    );
    let second = group_of(&identified(), &binding("ardupilot"), "x", "position.gps-2", Some(5.0), StampKind::Logged);
    assert!(!second.told_by_log);
}

#[test]
fn the_kind_of_a_log_is_that_of_the_original_without_its_writer() {
    for (format, kind) in [
        ("ArduPilot DataFlash (text)", "ArduPilot DataFlash"),
        ("MCAP, profile ros2, library rosbag2 0.1", "MCAP"),
        ("ROS 1 bag 2.0", "ROS 1 bag 2.0"),
        ("MCAP, profile ros2, recovered from ULog 1", "ULog 1"),
        ("", ""),
    ] {
        assert_eq!(log_kind(format).0, kind);
    }
}

/// A receiver over 200 s at 5 Hz: latitude and longitude in rad, height.
fn flown(change: impl Fn(usize, &mut [f64; 3], &mut i64)) -> Flight {
    let mut rows: Vec<([f64; 3], i64)> = vec![];
    for row in 0..1000_usize {
        let t = row as f64 * 0.2;
        let mut place = [
            (47.397_742 + (1e4 * (t / 20.0).sin()).round() * 1e-7_f64).to_radians(),
            (8.545_594 + (1e4 * (t / 15.0).cos()).round() * 1e-7_f64).to_radians(),
            500.0 + t,
        ];
        let mut at_ns = 1_700_000_000_000_000_000 + row as i64 * 200_000_000 + (row as i64 * 7_919) % 3_000_000;
        change(row, &mut place, &mut at_ns);
        rows.push((place, at_ns));
    }
    let stamps = rows.iter().map(|(_, ns)| Stamp(*ns)).collect();
    let timeline = Timeline::new(StampKind::Measured, Clock::Unix, stamps).unwrap();
    let components = (0..3).map(|axis| rows.iter().map(|(place, _)| place[axis]).collect()).collect();
    let channel = Channel {
        quantity: Quantity::PositionGeodetic,
        series: Series::new(timeline, components).unwrap(),
        present: vec![true; 3],
        other_stamps: vec![],
        held: vec![false; rows.len()],
        source: ChannelSource { topic: "t".into(), type_name: String::new(), fields: vec![] },
    };
    Flight { channels: [("position.gps".to_owned(), channel)].into(), ..Flight::default() }
}

fn print(flight: &Flight) -> String {
    fingerprint(flight, "position.gps").unwrap()
}

#[test]
fn a_fingerprint_does_not_depend_on_clock_epoch_or_last_digits() {
    let plain = print(&flown(|_, _, _| ()));
    // Another clock epoch, and values that went through another number format.
    assert_eq!(plain, print(&flown(|_, _, ns| *ns -= 1_699_999_000_000_000_000)));
    assert_eq!(plain, print(&flown(|_, place, _| place[0] *= 1.0 + 1e-15)));
}

#[test]
fn another_flight_has_another_fingerprint() {
    let plain = print(&flown(|_, _, _| ()));
    let others = [
        print(&flown(|row, place, _| place[0] += if row == 999 { 2e-7_f64.to_radians() } else { 0.0 })),
        print(&flown(|_, place, _| place[1] += 1e-6)),
        print(&flown(|row, _, ns| *ns += if row >= 500 { 150_000_000 } else { 0 })),
        print(&flown(|row, _, ns| *ns += 10_000_000 * row as i64 / 999)),
    ];
    for other in others {
        assert_ne!(plain, other);
    }
    let mut cut = flown(|_, _, _| ());
    cut.channels.get_mut("position.gps").unwrap().held[500] = true;
    assert_ne!(plain, print(&cut));
    assert_eq!(fingerprint(&Flight::default(), "position.gps"), None);
}

#[test]
fn logs_at_rest_are_copies_only_if_they_start_at_the_same_instant() {
    const YEAR_NS: i64 = 365 * 86_400 * 1_000_000_000;
    let stand = |place: &mut [f64; 3]| (place[0], place[1]) = (0.5, 0.1);
    let [first, again, later] = [0, 0, YEAR_NS].map(|by| flown(move |_, place, ns| (stand(place), *ns += by).1));
    assert_eq!(print(&first), print(&again));
    assert_ne!(print(&first), print(&later));
    // A single fix has no motion, wherever it is.
    let one = |by: i64| {
        let mut flight = flown(move |_, _, ns| *ns += by);
        flight.channels.get_mut("position.gps").unwrap().held[1..].fill(true);
        flight
    };
    assert_eq!(print(&one(0)), print(&one(0)));
    assert_ne!(print(&one(0)), print(&one(1_000_000_000)));
    // A log without a date is not a copy of any.
    let mut undated = flown(|_, place, _| stand(place));
    let channel = undated.channels.get_mut("position.gps").unwrap();
    let stamps = channel.series.timeline().stamps().to_vec();
    let timeline = Timeline::new(StampKind::Measured, Clock::Boot, stamps).unwrap();
    channel.series = Series::new(timeline, channel.series.components().to_vec()).unwrap();
    assert_eq!(fingerprint(&undated, "position.gps"), None);
}

#[test]
fn of_duplicates_with_as_many_fixes_only_the_first_counts() {
    let content = |of: &str, fixes| Some(FlightContent { fingerprint: of.to_owned(), fixes, sketch: vec![] });
    let flights = [
        ("b.bag", content("1", 9)),
        ("a.csv", content("1", 9)),
        ("c.csv", content("2", 9)),
        ("d.csv", None),
        ("e.csv", None),
        ("f.db3", content("1", 9)),
    ];
    let found = duplicates(&flights);
    assert_eq!(found.len(), 1);
    assert_eq!(
        (found[0].counts.as_str(), &found[0].duplicates[..]),
        ("b.bag", &["a.csv".to_owned(), "f.db3".to_owned()][..])
    );
}

#[test]
fn part_of_a_flight_is_a_duplicate_and_a_flight_on_the_same_path_is_not() {
    let of = |flight: &Flight| content_of(flight, "position.gps");
    let whole = flown(|_, _, _| ());
    let held = |rows: fn(usize) -> bool| {
        let mut part = flown(|_, _, _| ());
        let held = &mut part.channels.get_mut("position.gps").unwrap().held;
        held.iter_mut().enumerate().for_each(|(row, held)| *held = rows(row));
        part
    };
    let [begin, holes] = [held(|row| row > 300), held(|row| row % 50 == 7)];
    // Exactly the same path, flown with fixes at other times.
    let again = flown(|row, _, ns| *ns += (row as i64 * 7_919_333) % 40_000_000);
    let flights = [("again", of(&again)), ("begin", of(&begin)), ("holes", of(&holes)), ("whole", of(&whole))];
    let found = duplicates(&flights);
    assert_eq!(found.len(), 1, "{found:?}");
    assert_eq!((found[0].counts.as_str(), found[0].duplicates.join(" ").as_str()), ("whole", "begin holes"));
    // A vehicle at rest has nothing that identifies it.
    let still = flown(|_, place, _| (place[0], place[1]) = (0.5, 0.1));
    assert_eq!(of(&still).unwrap().sketch, Vec::<u64>::new());
}

/// Flights of a folder of real logs, by name, with the content of their receiver's position; empty without the folder.
fn real_flights(folder: &str) -> Vec<(String, Option<FlightContent>)> {
    use std::io::Write as _;
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/logs").join(folder);
    if !root.exists() {
        let _ = writeln!(std::io::stderr(), "skipped: {} is not there", root.display());
        return vec![];
    }
    let library = ingest::MapLibrary::shipped().unwrap();
    let cancel = std::sync::atomic::AtomicBool::new(false);
    let context = ingest::ReadContext { limits: ingest::Limits::default(), cancel: &cancel, on_bytes: &|_| () };
    let load = |unit: &ingest::FlightUnit| ingest::load(unit, &library, None, &context).ok();
    let units = ingest::discover(&root, &library).unwrap().units;
    let loaded = units.iter().filter_map(|unit| Some((unit.id.clone(), load(unit)?)));
    loaded.map(|(id, loaded)| (id, content_of(&loaded.flight, "position.gps"))).collect()
}

#[test]
fn a_real_flight_has_one_fingerprint_in_every_container() {
    let tables = real_flights("ALFA");
    let containers = real_flights("derived-alfa");
    let print = |content: &Option<FlightContent>| content.as_ref().map(|content| content.fingerprint.clone());
    if let Some((_, table)) = tables.first() {
        // Damaged copies have lost fixes, and differ in content. Two have lost nothing: without index, and with
        // trailing junk.
        let lost = |id: &str| id.contains("bitflip") || id.contains("trunc60");
        for (id, other) in &containers {
            assert_eq!(print(other) == print(table), !lost(id), "{id}");
        }
        assert_eq!(containers.iter().filter(|(id, _)| !lost(id)).count(), 14);
        // All of them are one flight, including those that have lost a part.
        let found = duplicates(&[tables, containers].concat());
        assert_eq!((found.len(), found[0].duplicates.len()), (1, 20), "{found:?}");
    }
    assert_eq!(duplicates(&real_flights("DeLorean")), []);
}
