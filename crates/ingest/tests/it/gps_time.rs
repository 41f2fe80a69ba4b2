//! GPS time faults of receivers, in every format that has it: weeks that wrap around, weeks that come late, epochs
//! without a fix, leap seconds, jumps in flight. More tests of tables are in `time`.

use crate::support::*;
use crate::wire::*;
use flight::{Clock, Severity, Stamp, unix_of_gps};
use ingest::{ChannelMap, FlightUnit, Loaded, LogKind, MapLibrary};
use std::path::Path;

const S: i64 = 1_000_000_000;
const MS: i64 = 1_000_000;
const WEEK_MS: i64 = 604_800_000;
/// 2000: an earlier date of a receiver is that of its firmware.
const NO_TIE_BEFORE_S: i64 = 946_684_800;
/// Five epochs a second.
const STEP_MS: i64 = 200;
const ROWS: usize = 60;
/// When the first epoch comes, since boot.
const BOOT_MS: i64 = 60_000;

/// One epoch as the receiver reports it.
#[derive(Debug, Clone, Copy)]
struct Epoch {
    week: i64,
    ms: i64,
    fix: u8,
}

/// The expected result.
struct Case {
    name: &'static str,
    epochs: Vec<Epoch>,
    /// The true week, and the true time in it, ms, of the first epoch.
    truth: (i64, i64),
    /// Number of unusable epochs.
    unused: u64,
    /// Codes of notices and their counts.
    reported: &'static [(&'static str, u64)],
}

/// Epochs from `ms` in `week` on, with the week as `written` says.
fn epochs(week: i64, ms: i64, written: impl Fn(usize, i64) -> i64) -> Vec<Epoch> {
    let epoch = |row: usize| {
        let all = week * WEEK_MS + ms + STEP_MS * row as i64;
        Epoch { week: written(row, all / WEEK_MS), ms: all % WEEK_MS, fix: 3 }
    };
    (0..ROWS).map(epoch).collect()
}

/// Six seconds before the end of a week.
const LATE_SATURDAY: i64 = WEEK_MS - 6000;
const MIDDLE: usize = 30;

fn cases() -> Vec<Case> {
    let mut cases = vec![];
    let mut case = |name, epochs, truth, unused, reported| cases.push(Case { name, epochs, truth, unused, reported });
    let end = |week: i64, mask: i64| (epochs(week, LATE_SATURDAY, |_, w| w & mask), (week, LATE_SATURDAY));
    for (name, week) in [("1023 to 1024", 1023), ("2047 to 2048", 2047), ("3071 to 3072", 3071)] {
        let (epochs, truth) = end(week, 0xffff);
        case(name, epochs, truth, 0, &[("date-inferred", 0)]);
    }
    let (ten_bits, truth) = end(2047, 0x3ff);
    case("1023 to 0 of ten bits", ten_bits, truth, 0, &[("date-inferred", ROWS as u64)]);
    // Week 2445 is that of November 2026.
    let ten_bits = epochs(2445, 500_000_000, |_, w| w & 0x3ff);
    case("ten bits in a field of sixteen", ten_bits, (2445, 500_000_000), 0, &[("date-inferred", ROWS as u64)]);
    // ArduPilot#31914: the time of week wraps around, the week follows later.
    for late in 1..=5 {
        let written = move |row: usize, week: i64| if (MIDDLE..MIDDLE + late).contains(&row) { week - 1 } else { week };
        let glitch = epochs(2313, LATE_SATURDAY, written);
        let reported: &'static [(&str, u64)] = &[
            [("date-inferred", 1)],
            [("date-inferred", 2)],
            [("date-inferred", 3)],
            [("date-inferred", 4)],
            [("date-inferred", 5)],
        ][late - 1];
        case("the week comes late", glitch, (2313, LATE_SATURDAY), 0, reported);
    }
    let early =
        epochs(2313, LATE_SATURDAY, |row, week| if (MIDDLE - 3..MIDDLE).contains(&row) { week + 1 } else { week });
    case("the week comes early", early, (2313, LATE_SATURDAY), 0, &[("date-inferred", 3)]);
    let mut none = epochs(2313, 500_000_000, |_, w| w);
    none.iter_mut().take(7).for_each(|e| *e = Epoch { week: 0, ms: 0, fix: 0 });
    case("no fix at first", none, (2313, 500_000_000), 7, &[("date-inferred", 0)]);
    // Leap seconds: 16 in January 2014, 17 in June 2016, 18 in June 2018.
    for (name, week) in [("16 leap seconds", 1774), ("17 leap seconds", 1900), ("18 leap seconds", 2004)] {
        case(name, epochs(week, 259_200_000, |_, w| w), (week, 259_200_000), 0, &[("leap-seconds", 0)]);
    }
    cases
}

/// GPS time of an epoch, ns.
fn gps_ns((week, ms): (i64, i64), row: usize) -> i64 {
    (week * WEEK_MS + ms + STEP_MS * row as i64) * MS
}

fn unix_ns(truth: (i64, i64), row: usize) -> i64 {
    unix_of_gps(Stamp(gps_ns(truth, row))).unwrap().0
}

fn load_as(kind: LogKind, bytes: &[u8], library: &MapLibrary, map: Option<&str>) -> Loaded {
    let (_folder, path) = file("log", bytes);
    let unit = FlightUnit { id: "log".into(), files: vec![path], kind };
    let loaded = load_mapped(&unit, library, map).unwrap();
    assert_ledger(&loaded);
    loaded
}

/// `reported` has the sum of the counts: the reader and the binding of channels may both report one event. Infos are not among them.
fn assert_reported(loaded: &Loaded, case: &str, reported: &[(&str, u64)], times: u64) {
    for (code, count) in reported {
        let warnings = loaded.flight.notices.iter().filter(|n| n.code == *code && n.severity > Severity::Info);
        let found: u64 = warnings.map(|n| n.count).sum();
        assert_eq!(found, times * count, "{case}: {code}: {:?}", loaded.flight.notices);
    }
}

fn boot_ms(row: usize) -> i64 {
    BOOT_MS + STEP_MS * row as i64
}

/// A DataFlash log of GPS records.
fn dataflash(epochs: &[Epoch]) -> Vec<u8> {
    dataflash_from(BOOT_MS, epochs)
}

/// The same, the first so long since boot.
fn dataflash_from(from_ms: i64, epochs: &[Epoch]) -> Vec<u8> {
    let record = |(row, e): (usize, &Epoch)| {
        let lat = if e.fix < 3 { 0 } else { 470_000_000 + row as i32 };
        let mut body = ((boot_ms(row) - BOOT_MS + from_ms) as u64 * 1000).to_le_bytes().to_vec();
        body.push(e.fix);
        body.extend((e.ms as u32).to_le_bytes());
        body.extend((e.week as u16).to_le_bytes());
        body.extend([lat, lat / 5, 58_585].map(i32::to_le_bytes).concat());
        body.extend([10.0_f32, 90.0, 0.5].map(f32::to_le_bytes).concat());
        dataflash_record(10, &body)
    };
    let columns = "TimeUS,Status,GMS,GWk,Lat,Lng,Alt,Spd,GCrs,VZ";
    let head = [dataflash_begin(), dataflash_fmt(10, "GPS", "QBIHLLefff", columns)].concat();
    [head, epochs.iter().enumerate().flat_map(record).collect()].concat()
}

#[test]
fn dataflash_is_dated_by_weeks_despite_all_their_faults() {
    let library = MapLibrary::shipped().unwrap();
    for case in cases() {
        let loaded = load_as(LogKind::DataFlash, &dataflash(&case.epochs), &library, None);
        assert_eq!(loaded.binding.as_ref().unwrap().map, "ardupilot");
        if unix_ns(case.truth, 0) < NO_TIE_BEFORE_S * S {
            assert_eq!(loaded.flight.utc, None, "{}", case.name);
            continue;
        }
        let tie = loaded.flight.utc.as_ref().unwrap_or_else(|| panic!("{}", case.name));
        assert_eq!(tie.offset_ns, unix_ns(case.truth, ROWS - 1) - boot_ms(ROWS - 1) * MS, "{}", case.name);
        assert_eq!((tie.pairs, tie.outliers), (ROWS as u64 - case.unused, 0), "{}", case.name);
        assert_reported(&loaded, case.name, case.reported, 1);
        // The samples keep their timestamps.
        let stamps = loaded.flight.channels["position.gps"].series.timeline().stamps();
        assert_eq!(stamps.len() as u64, ROWS as u64 - case.unused, "{}", case.name);
        assert_eq!(stamps.last().unwrap().0, boot_ms(ROWS - 1) * MS);
    }
}

#[test]
fn a_jump_of_receiver_time_in_flight_does_not_move_the_date() {
    let library = MapLibrary::shipped().unwrap();
    for jump_ms in [-3000, 3000, 3_600_000, 86_400_000] {
        // For four seconds, and for the rest of the flight.
        for rows in [20..40, 45..ROWS] {
            let mut jumped = epochs(2313, 300_000_000, |_, w| w);
            jumped[rows.clone()].iter_mut().for_each(|e| e.ms += jump_ms);
            let loaded = load_as(LogKind::DataFlash, &dataflash(&jumped), &library, None);
            let tie = loaded.flight.utc.as_ref().unwrap();
            assert_eq!(tie.offset_ns, unix_ns((2313, 300_000_000), 0) - BOOT_MS * MS);
            assert_eq!(tie.outliers, rows.len() as u64);
            assert_reported(&loaded, "jump", &[("utc-tie", rows.len() as u64)], 1);
        }
    }
}

/// A map of a table with weeks, and with the logger's UTC next to them.
fn table_map() -> MapLibrary {
    let text = "schema = 1\nname = \"t\"\ntitle = \"t\"\n[time]\nmeasured = [{ week = \"GWk\", field = \"GMS\", unit = \"ms\" }]\n\
                logged = [{ field = \"utc\", unit = \"ms\", clock = \"unix\" }]\n[[channel]]\nname = \"position.gps\"\n\
                quantity = \"position-geodetic\"\ntimeline = \"measured\"\nrequire = [{ field = \"fix\", min = 3 }]\n\
                [channel.fields]\nlatitude = { field = \"lat\", unit = \"deg\" }\nlongitude = { field = \"lon\", unit = \"deg\" }\n";
    let mut library = MapLibrary::shipped().unwrap();
    library.add(ChannelMap::from_toml(Path::new("t.toml"), text).unwrap());
    library
}

/// A table; with `utc` it has the log time of each epoch, ms.
fn table(epochs: &[Epoch], utc: Option<&dyn Fn(usize) -> i64>) -> Vec<u8> {
    let mut text = format!("GWk,GMS,fix,lat,lon{}\n", if utc.is_some() { ",utc" } else { "" });
    for (row, e) in epochs.iter().enumerate() {
        let place = if e.fix < 3 { "0,0".to_owned() } else { format!("47.{row:04},8.5") };
        text += &format!("{},{},{},{place}", e.week, e.ms, e.fix);
        text += &utc.map_or(String::new(), |utc| format!(",{}", utc(row)));
        text += "\n";
    }
    text.into_bytes()
}

#[test]
fn tables_are_dated_by_weeks_despite_all_their_faults() {
    let library = table_map();
    for case in cases() {
        let loaded = load_as(LogKind::Csv, &table(&case.epochs, None), &library, Some("t"));
        let timeline = loaded.flight.channels["position.gps"].series.timeline();
        let truth: Vec<i64> = (case.unused as usize..ROWS).map(|row| gps_ns(case.truth, row)).collect();
        assert_eq!(timeline.stamps().iter().map(|s| s.0).collect::<Vec<_>>(), truth, "{}", case.name);
        assert_eq!(timeline.clock(), Clock::Gps);
        assert_reported(&loaded, case.name, case.reported, 1);
    }
}

#[test]
fn a_ten_bit_week_is_the_nearest_to_the_log_date_and_is_reported() {
    let library = table_map();
    // The same ten bits in 2007, 2026 and 2046.
    for week in [1421, 2445, 3469] {
        let epochs = epochs(week, 500_000_000, |_, w| w & 0x3ff);
        let utc = |row: usize| unix_ns((week, 500_000_000), row) / MS + 120;
        let loaded = load_as(LogKind::Csv, &table(&epochs, Some(&utc)), &library, Some("t"));
        let first = loaded.flight.channels["position.gps"].series.timeline().first().unwrap();
        assert_eq!(first.0, gps_ns((week, 500_000_000), 0), "{week}");
        let rule = loaded.flight.notices.iter().find(|n| n.code == "date-inferred").unwrap();
        assert!(rule.count == ROWS as u64 && rule.text.contains("nearest to the date of the log"), "{}", rule.text);
        let offset = loaded.binding.unwrap().channels[0].offsets[0].offset_s;
        assert!((offset.median - 0.12).abs() < 1e-9);
    }
    let alone = load_as(LogKind::Csv, &table(&epochs(2445, 0, |_, w| w & 0x3ff), None), &library, Some("t"));
    let rule = alone.flight.notices.iter().find(|n| n.code == "date-inferred").unwrap();
    assert!(rule.text.contains("nearest to this release"), "{}", rule.text);
}

/// A ULog with the UTC of a receiver, us, and its kind of fix.
fn ulog(epochs: &[(i64, u8)]) -> Vec<u8> {
    let format = "sensor_gps:uint64_t timestamp;uint64_t time_utc_usec;double latitude_deg;double longitude_deg;\
                  double altitude_ellipsoid_m;uint8_t fix_type;";
    let row = |(row, (utc_us, fix)): (usize, &(i64, u8))| {
        let lat = if *fix < 3 { 0.0 } else { 47.0 + 1e-4 * row as f64 };
        let values = [lat, lat / 5.0, 500.0].map(f64::to_le_bytes).concat();
        let stamps = [(boot_ms(row) * 1000).to_le_bytes(), utc_us.to_le_bytes()].concat();
        ulog_message(b'D', &[&[0, 0][..], &stamps, &values, &[*fix]].concat())
    };
    [ulog_begin(&[(format, 0)]), epochs.iter().enumerate().flat_map(row).collect()].concat()
}

#[test]
fn a_ulog_is_dated_by_receiver_utc_despite_its_glitches() {
    let library = MapLibrary::shipped().unwrap();
    let begin = (2313, LATE_SATURDAY);
    let good: Vec<(i64, u8)> = (0..ROWS).map(|row| (unix_ns(begin, row) / 1000, 3)).collect();
    let spoilt = |rows: std::ops::Range<usize>, by: &dyn Fn((i64, u8)) -> (i64, u8)| {
        let mut epochs = good.clone();
        epochs[rows].iter_mut().for_each(|e| *e = by(*e));
        epochs
    };
    let week = |e: (i64, u8)| (e.0 - WEEK_MS * 1000, e.1);
    let cases = [
        ("good", good.clone(), 0, &[("date-inferred", 0), ("utc-tie", 0)][..]),
        ("one week late", spoilt(30..31, &week), 0, &[("date-inferred", 1)]),
        ("five weeks late", spoilt(30..35, &week), 0, &[("date-inferred", 5)]),
        ("no fix and no time", spoilt(0..9, &|_| (0, 0)), 9, &[("utc-tie", 0)]),
        ("no fix and 1980", spoilt(0..9, &|_| (315_964_800_000_000, 0)), 9, &[("utc-tie", 0)]),
        ("1024 weeks early at first", spoilt(0..9, &|e| (e.0 - 1024 * WEEK_MS * 1000, 3)), 9, &[("utc-tie", 9)]),
        ("the leap seconds come late", spoilt(0..9, &|e| (e.0 + 2_000_000, 3)), 9, &[("utc-tie", 9)]),
        ("of the other sign", spoilt(20..22, &|_| (-1, 3)), 2, &[]),
    ];
    for (name, epochs, unused, reported) in cases {
        let loaded = load_as(LogKind::Ulog, &ulog(&epochs), &library, None);
        let tie = loaded.flight.utc.as_ref().unwrap();
        assert_eq!(tie.offset_ns, unix_ns(begin, 0) - BOOT_MS * MS, "{name}");
        assert_eq!(tie.pairs, ROWS as u64 - unused, "{name}");
        assert_reported(&loaded, name, reported, 1);
    }
}

/// NAV-TIMEGPS with its week, if that is valid, then position and velocity of the epoch.
fn frames(epochs: &[Epoch]) -> Vec<u8> {
    let of = |(row, e): (usize, &Epoch)| {
        let itow = (e.ms as u32).to_le_bytes();
        let valid = if e.fix < 3 { 0 } else { 7 };
        let time = [&itow[..], &[0; 4], &(e.week as i16).to_le_bytes(), &[18, valid], &[0; 4]].concat();
        let lat = 470_000_000 + row as i32;
        let position =
            [&itow[..], &[lat / 5, lat, 500_000, 450_000, 1000, 1000].map(i32::to_le_bytes).concat()].concat();
        let velocity = [&itow[..], &[1000, 0, 0, 1000, 1000, 0, 30, 30].map(i32::to_le_bytes).concat()].concat();
        [ubx_frame(1, 0x20, &time), ubx_frame(1, 2, &position), ubx_frame(1, 0x12, &velocity)].concat()
    };
    epochs.iter().enumerate().flat_map(of).collect()
}

#[test]
fn ubx_is_dated_by_weeks_despite_all_their_faults() {
    let library = MapLibrary::shipped().unwrap();
    for case in cases() {
        let loaded = load_as(LogKind::Ubx, &frames(&case.epochs), &library, None);
        for name in ["position.posllh", "velocity.velned"] {
            let timeline = loaded.flight.channels[name].series.timeline();
            let truth: Vec<i64> = (case.unused as usize..ROWS).map(|row| gps_ns(case.truth, row)).collect();
            assert_eq!(timeline.stamps().iter().map(|s| s.0).collect::<Vec<_>>(), truth, "{}: {name}", case.name);
        }
        // Of NAV-POSLLH and of NAV-VELNED, however many channels they make.
        let times = 2;
        assert_reported(&loaded, case.name, case.reported, times);
    }
}

#[test]
fn ubx_without_any_week_continues_over_sunday() {
    let unknown: Vec<Epoch> =
        epochs(2313, LATE_SATURDAY, |_, _| 0).into_iter().map(|e| Epoch { fix: 0, ..e }).collect();
    let loaded = load_as(LogKind::Ubx, &frames(&unknown), &MapLibrary::shipped().unwrap(), None);
    let timeline = loaded.flight.channels["position.posllh"].series.timeline();
    assert_eq!(timeline.clock(), Clock::Elapsed);
    let expected: Vec<i64> = (0..ROWS as i64).map(|row| (LATE_SATURDAY + STEP_MS * row) * MS).collect();
    assert_eq!(timeline.stamps().iter().map(|s| s.0).collect::<Vec<_>>(), expected);
    assert_reported(&loaded, "Sunday", &[("stamp-wrap", 1)], 2);
}

/// RMC and GGA of epochs a second apart, with the time at which each was logged, from this UTC on, s. `receiver` gives the UTC
/// that the receiver reports, and whether it has a fix.
fn sentences(begin: i64, receiver: impl Fn(i64) -> (i64, bool)) -> Vec<u8> {
    let sealed = |body: String| format!("${body}*{:02X}", body.bytes().fold(0, |sum, byte| sum ^ byte));
    let epoch = |second: i64| {
        let (utc, fix) = receiver(begin + second);
        let date = jiff::Timestamp::from_second(utc).unwrap().strftime("%d%m%y").to_string();
        let time = jiff::Timestamp::from_second(utc).unwrap().strftime("%H%M%S").to_string();
        let place = if fix { format!("4807.{second:03},N,01131.000,E") } else { "0000.000,N,00000.000,E".into() };
        let valid = if fix { 'A' } else { 'V' };
        let rmc = sealed(format!("GPRMC,{time},{valid},{place},20.0,90.0,{date},,"));
        let gga = sealed(format!("GPGGA,{time},{place},{},08,0.9,545.4,M,46.9,M,,", u8::from(fix)));
        format!("{0}.120 {rmc}\r\n{0}.140 {gga}\r\n", begin + second)
    };
    (0..ROWS as i64).map(epoch).collect::<String>().into_bytes()
}

#[test]
fn sentences_are_dated_over_midnight_and_rollover_dates_are_suspect() {
    let library = MapLibrary::shipped().unwrap();
    // Half a minute before the midnight to Sunday, 2024-05-12; and before a new year with a leap second.
    for begin in [1_715_471_970, 1_483_228_770] {
        let loaded = load_as(LogKind::Nmea, &sentences(begin, |utc| (utc, true)), &library, None);
        for name in ["position.gps", "velocity.gps"] {
            let stamps = loaded.flight.channels[name].series.timeline().stamps();
            assert!(stamps.len() == ROWS && stamps.iter().zip(0..).all(|(s, i)| s.0 == (begin + i) * S), "{name}");
        }
        assert_eq!(count_of(&loaded, "clock-suspect"), 0, "{:?}", loaded.flight.notices);
    }
    let begin = 1_715_471_970;
    // Without a fix: position and date of the firmware.
    let no_fix = |utc: i64| if utc < begin + 9 { (315_964_800 + utc - begin, false) } else { (utc, true) };
    let loaded = load_as(LogKind::Nmea, &sentences(begin, no_fix), &library, None);
    let stamps = loaded.flight.channels["position.gps"].series.timeline().stamps();
    assert_eq!((stamps.len(), stamps[0].0), (ROWS - 9, (begin + 9) * S));
    assert!(count_of(&loaded, "rejected-row") >= 18);
    // A receiver older than its almanac counts the weeks of the age before.
    let old = |utc: i64| (utc - 1024 * WEEK_MS / 1000, true);
    let loaded = load_as(LogKind::Nmea, &sentences(begin, old), &library, None);
    let reported = loaded.flight.notices.iter().find(|n| n.code == "clock-suspect").unwrap();
    assert!(reported.text.contains("GPS week"), "{}", reported.text);
    // The leap seconds come with the almanac, after some minutes: UTC then goes back by what was missing.
    let begin_of_year = 1_388_534_400;
    for missing in [1, 2, 16] {
        let late = move |utc: i64| (utc + if utc < begin_of_year + 20 { missing } else { 0 }, true);
        let loaded = load_as(LogKind::Nmea, &sentences(begin_of_year, late), &library, None);
        let stamps = loaded.flight.channels["velocity.gps"].series.timeline().stamps();
        let reported = ["duplicate-stamp", "rejected-row"].map(|code| count_of(&loaded, code));
        assert_eq!(
            reported.iter().sum::<u64>(),
            loaded.flight.channels.len() as u64 * missing as u64,
            "{missing}: {:?}",
            loaded.flight.notices
        );
        assert_eq!(stamps.len(), ROWS - missing as usize, "a second that was passed twice has one epoch");
    }
}

#[test]
fn an_impossibly_early_date_gets_a_warning_and_is_kept() {
    let library = MapLibrary::shipped().unwrap();
    let sealed = |body: String| format!("${body}*{:02X}\r\n", body.bytes().fold(0, |sum, byte| sum ^ byte));
    let nmea = |talker: &str, date: &str, end: &str| {
        let line =
            |s: u32| sealed(format!("{talker}RMC,1200{s:02},A,4807.038,N,01131.0{s:02},E,9.0,90.0,{date},,{end}"));
        (0..20).map(line).collect::<String>().into_bytes()
    };
    let utc = |loaded: &ingest::Loaded| loaded.flight.channels["position.gps"].series.timeline().first().unwrap().0 / S;
    // date -u -d 'YYYY-MM-DDT12:00:00Z' +%s; 7168 days later is 2023-04-23.
    for (bytes, meant, unix_s) in [
        // The navigational status of NMEA 4.10, talkers of Galileo and BeiDou.
        (nmea("GN", "070903", ",A,V"), Some("2023-04-23"), 1_062_936_000),
        (nmea("GA", "070903", ""), Some("2023-04-23"), 1_062_936_000),
        // An older receiver cannot be excluded, unless the log is older than any that is read.
        (nmea("GP", "070903", ",A"), None, 1_062_936_000),
        (nmea("GP", "070903", ",,V"), None, 1_062_936_000),
        (nmea("GP", "070990", ",A"), Some("2010-04-23"), 652_708_800),
        (nmea("GN", "230423", ",A,V"), None, 1_682_251_200),
    ] {
        let loaded = load_as(LogKind::Nmea, &bytes, &library, None);
        let reported = loaded.flight.notices.iter().find(|n| n.code == "date-inferred");
        assert_eq!(reported.map(|n| n.count), meant.map(|_| 20), "{:?}", loaded.flight.notices);
        assert!(reported.zip(meant).is_none_or(|(n, meant)| n.text.contains(meant)), "{reported:?}");
        assert_eq!(utc(&loaded), unix_s);
    }
    let pvt = |year: u16| -> Vec<u8> {
        let frame = |row: u32| {
            let mut payload = [&(43_200_000 + 200 * row).to_le_bytes()[..], &year.to_le_bytes()].concat();
            payload.extend([9, 7, 12, 0, (row / 5) as u8, 7, 0, 0, 0, 0, 0, 0, 0, 0, 3, 1, 0, 9]);
            payload.extend([85_455_940, 473_977_420 + row as i32, 5, 5].map(i32::to_le_bytes).concat());
            payload.resize(92, 0);
            ubx_frame(1, 7, &payload)
        };
        (0..20).flat_map(frame).collect()
    };
    for (year, meant) in [(2003, Some("2023-04-23")), (2025, None)] {
        let loaded = load_as(LogKind::Ubx, &pvt(year), &library, None);
        let reported = loaded.flight.notices.iter().find(|n| n.code == "date-inferred");
        assert_eq!(
            reported.map(|n| n.text.contains(meant.unwrap())),
            meant.map(|_| true),
            "{:?}",
            loaded.flight.notices
        );
    }
    // One date of another age among right ones.
    let one_ubx = [&pvt(2003)[..100], &pvt(2025)[100..]].concat();
    let (early, right) = (nmea("GN", "070903", ",A,V"), nmea("GN", "230423", ",A,V"));
    let first = early.iter().position(|b| *b == b'\n').unwrap() + 1;
    let one_nmea = [&early[..first], &right[first..]].concat();
    for (kind, bytes) in [(LogKind::Ubx, one_ubx), (LogKind::Nmea, one_nmea)] {
        let loaded = load_as(kind, &bytes, &library, None);
        let reported = loaded.flight.notices.iter().find(|n| n.code == "date-inferred").unwrap();
        assert_eq!(reported.count, 1);
        assert!(reported.text.contains("2003-09-07, the earliest of 1 such dates among 20"), "{}", reported.text);
    }
}

/// A boot of a vehicle in a DataFlash log: one epoch each 0.2 s from `boot_ms` on, the first at this time of week.
fn boot(from_ms: i64, week_ms: i64, fix: u8) -> Vec<u8> {
    let mut all = epochs(2313, week_ms, |_, w| w);
    all.iter_mut().for_each(|e| e.fix = fix);
    dataflash_from(from_ms, &all)
}

#[test]
fn each_boot_in_a_dataflash_log_is_dated_by_its_own_epochs() {
    let library = MapLibrary::shipped().unwrap();
    const FIRST_MS: i64 = 300_000_000;
    // The second boot counts from less, from what the first one ended with, and from more.
    for from_ms in [3000, BOOT_MS + 5000, BOOT_MS + 60_000] {
        let later_ms = FIRST_MS + 240_000;
        let bytes = [boot(BOOT_MS, FIRST_MS, 3), boot(from_ms, later_ms, 3)].concat();
        let loaded = load_as(LogKind::DataFlash, &bytes, &library, None);
        let stamps = loaded.flight.channels["position.gps"].series.timeline().stamps();
        let utc: Vec<i64> = stamps.iter().map(|s| loaded.flight.unix(Clock::Boot, *s).unwrap().0).collect();
        let truth: Vec<i64> =
            [FIRST_MS, later_ms].iter().flat_map(|ms| (0..ROWS).map(|row| unix_ns((2313, *ms), row))).collect();
        assert_eq!(utc, truth, "{from_ms}");
        assert_eq!(stamps[0].0, BOOT_MS * MS);
        // Where the clock goes back the reader says so too.
        assert_eq!(count_saying(&loaded, "several-sessions", "each session is dated by itself"), 1);
        assert_reported(&loaded, "boots", &[("utc-tie", 0), ("undated", 0)], 1);
        assert!(!lossy(&loaded), "{:?}", loaded.flight.notices);
    }
}

#[test]
fn a_dataflash_boot_without_its_start_is_a_clock_that_steps_back() {
    let library = MapLibrary::shipped().unwrap();
    const FIRST_MS: i64 = 300_000_000;
    let headless = boot(3000, FIRST_MS + 240_000, 3)[dataflash_from(0, &[]).len()..].to_vec();
    let loaded = load_as(LogKind::DataFlash, &[boot(BOOT_MS, FIRST_MS, 3), headless].concat(), &library, None);
    assert_reported(&loaded, "boots", &[("several-sessions", 0), ("unreliable-stamps", 1 + 3)], 1);
}

/// A log of a version of 2013: its records have the autopilot's time in ms.
fn old_dataflash(from_ms: i64, epochs: &[Epoch]) -> Vec<u8> {
    let record = |(row, e): (usize, &Epoch)| {
        let mut body = vec![e.fix];
        body.extend((e.ms as u32).to_le_bytes());
        body.extend((e.week as u16).to_le_bytes());
        body.extend([470_000_000 + row as i32, 85_000_000, 58_585].map(i32::to_le_bytes).concat());
        body.extend([10.0_f32, 90.0, 0.5].map(f32::to_le_bytes).concat());
        body.extend(((boot_ms(row) - BOOT_MS + from_ms) as u32).to_le_bytes());
        dataflash_record(10, &body)
    };
    let columns = "Status,TimeMS,Week,Lat,Lng,Alt,Spd,GCrs,VZ,T";
    let head = [dataflash_begin(), dataflash_fmt(10, "GPS", "BIHLLefffI", columns)].concat();
    [head, epochs.iter().enumerate().flat_map(record).collect()].concat()
}

#[test]
fn only_one_autopilot_generation_in_a_log_is_dated() {
    let library = MapLibrary::shipped().unwrap();
    let [first, later] = [300_000_000, 300_240_000].map(|ms| epochs(2313, ms, |_, w| w));
    let (old, new) = (old_dataflash, dataflash_from);
    let logs = [[old(BOOT_MS, &first), new(3000, &later)], [new(BOOT_MS, &first), old(3000, &later)]];
    for (log, name) in logs.into_iter().zip(["old first", "new first"]) {
        let loaded = load_as(LogKind::DataFlash, &log.concat(), &library, None);
        let lost = loaded.flight.notices.iter().find(|n| n.code == "undated" && n.severity == Severity::Loss).unwrap();
        assert_eq!(lost.count, ROWS as u64, "{name}");
        let stamps = loaded.flight.channels["position.gps"].series.timeline().stamps();
        let utc: Vec<i64> = stamps.iter().map(|s| loaded.flight.unix(Clock::Boot, *s).unwrap().0).collect();
        let mut truth = [300_000_000, 300_240_000].map(|ms| (0..ROWS).map(move |row| unix_ns((2313, ms), row)));
        assert!(truth.iter_mut().any(|truth| truth.eq(utc.iter().copied())), "{name}");
    }
}

#[test]
fn row_times_for_a_table_are_those_of_their_boot() {
    let bytes = [boot(BOOT_MS, 300_000_000, 3), boot(3000, 300_240_000, 3)].concat();
    let (_folder, path) = file("log", &bytes);
    let unit = FlightUnit { id: "log".into(), files: vec![path], kind: LogKind::DataFlash };
    let want = |_: &ingest::TopicInfo| ingest::Selection::All;
    let log = in_context(|context| ingest::read(&unit, &want, context)).unwrap();
    let times = ingest::row_times(&log, &MapLibrary::shipped().unwrap()).unwrap();
    let at = log.tables.iter().position(|t| t.topic.name == "GPS").unwrap();
    let table = times.tables[at].as_ref().unwrap();
    let utc = |ns: Option<i64>| match table.clock {
        Clock::Boot => times.utc.as_ref().unwrap().unix(Stamp(ns.unwrap())).unwrap().0,
        clock => clock.unix(Stamp(ns.unwrap())).unwrap().0,
    };
    let truth = [300_000_000, 300_240_000].map(|ms| (0..ROWS).map(move |row| unix_ns((2313, ms), row)));
    assert_eq!(table.clock, Clock::Boot);
    assert_eq!(table.nanos.iter().map(utc).collect::<Vec<_>>(), truth.into_iter().flatten().collect::<Vec<_>>());
}

#[test]
fn an_undated_boot_is_lost_next_to_a_dated_one() {
    let mut library = MapLibrary::shipped().unwrap();
    let map = "schema = 1\nname = \"t\"\ntitle = \"t\"\n[time]\n\
               measured = [{ field = \"TimeUS\", unit = \"us\", clock = \"boot\" }]\n[[utc]]\ntopic = [\"GPS\"]\n\
               stamp = { field = \"TimeUS\", unit = \"us\", clock = \"boot\" }\n\
               utc = { week = \"GWk\", field = \"GMS\", unit = \"ms\", clock = \"gps\" }\n\
               require = [{ field = \"Status\", min = 3 }]\n[[channel]]\nname = \"height.gps\"\nquantity = \"height\"\n\
               topic = [\"GPS\"]\ntimeline = \"measured\"\n[channel.fields]\nheight = { field = \"Alt\", unit = \"m\" }\n";
    library.add(ChannelMap::from_toml(Path::new("t.toml"), map).unwrap());
    // The dated boot is shorter, and comes second; of two that nothing dates the first stays.
    for (fixes, kept) in [([0, 3], Some(1)), ([3, 0], Some(0)), ([0, 0], None)] {
        let bytes = [boot(BOOT_MS, 300_000_000, fixes[0]), boot(3000, 300_240_000, fixes[1])].concat();
        let loaded = load_as(LogKind::DataFlash, &bytes, &library, Some("t"));
        let stamps = loaded.flight.channels["height.gps"].series.timeline().stamps();
        assert_eq!(stamps.len(), ROWS, "{fixes:?}");
        let first = loaded.flight.unix(Clock::Boot, stamps[0]).map(|utc| utc.0);
        let truth = kept.map(|second| unix_ns((2313, 300_000_000 + 240_000 * second), 0));
        assert_eq!(first, truth, "{fixes:?}");
        assert_reported(&loaded, "lost", &[("undated", ROWS as u64), ("rejected-row", ROWS as u64)], 1);
        assert!(lossy(&loaded));
    }
}
