//! Clock faults in real logs, which must not make any number wrong.

use crate::support::*;
use flight::{Clock, Stamp};
use ingest::{ChannelMap, IngestError, Loaded, MapLibrary};
use std::path::{Path, PathBuf};

const S: i64 = 1_000_000_000;
const WEEK: i64 = 604_800;
/// 1980-01-06, s.
const GPS_EPOCH: i64 = 315_964_800;

/// A map of a wide table with `lat`, `lon` and these timestamps.
fn library(time: &str, more: &str) -> MapLibrary {
    let text = format!(
        "schema = 1\nname = \"t\"\ntitle = \"t\"\n[time]\n{time}\n{more}\n[[channel]]\nname = \"position.gps\"\n\
         quantity = \"position-geodetic\"\ntimeline = \"measured\"\nrequire = [{{ field = \"fix\", min = 3 }}]\n\
         [channel.fields]\nlatitude = {{ field = \"lat\", unit = \"deg\" }}\nlongitude = {{ field = \"lon\", unit = \"deg\" }}\n"
    );
    let mut library = MapLibrary::shipped().unwrap();
    library.add(ChannelMap::from_toml(Path::new("t.toml"), &text).unwrap());
    library
}

fn read(library: &MapLibrary, text: &str) -> Result<Loaded, IngestError> {
    let (_folder, path) = file("t.csv", text.as_bytes());
    let loaded = load_mapped(&tables(&[path]), library, Some("t"))?;
    assert_ledger(&loaded);
    Ok(loaded)
}

fn stamps(loaded: &Loaded) -> Vec<i64> {
    loaded.flight.channels["position.gps"].series.timeline().stamps().iter().map(|s| s.0).collect()
}

const WEEKS: &str = "measured = [{ week = \"GWk\", field = \"GMS\", unit = \"ms\" }]";

/// Rows of GPS weeks and milliseconds with their fix.
fn weeks(rows: &[(i64, i64, i64)]) -> String {
    let mut text = "GWk,GMS,fix,lat,lon\n".to_owned();
    for (i, (week, ms, fix)) in rows.iter().enumerate() {
        text += &format!("{week},{ms},{fix},47.{i:04},8.5\n");
    }
    text
}

#[test]
fn gps_weeks_and_milliseconds_are_gps_time_to_the_millisecond() {
    let rows: Vec<_> = (0..10).map(|i| (2313, 500_000_000 + 200 * i, 3)).collect();
    let loaded = read(&library(WEEKS, ""), &weeks(&rows)).unwrap();
    let expected: Vec<i64> = (0..10).map(|i| (2313 * WEEK + 500_000) * S + 200_000_000 * i).collect();
    assert_eq!(stamps(&loaded), expected);
    assert_eq!(loaded.flight.channels["position.gps"].series.timeline().clock(), Clock::Gps);
    // date -u -d '1980-01-06 UTC + 2313 weeks + 500000 seconds - 18 seconds' +%s
    assert_eq!(loaded.flight.unix(Clock::Gps, Stamp(expected[0])), Some(Stamp(1_715_367_182 * S)));
}

#[test]
fn a_ten_or_eleven_bit_week_wraps_around_without_a_step() {
    for (before, after, start) in [(1023, 0, 2047), (1023, 1024, 1023), (2047, 2048, 2047), (3071, 3072, 3071)] {
        let rows: Vec<_> = (0..20)
            .map(|i| if i < 10 { (before, 604_798_000 + 200 * i, 3) } else { (after, 200 * (i - 10), 3) })
            .collect();
        let loaded = read(&library(WEEKS, ""), &weeks(&rows)).unwrap();
        let stamps = stamps(&loaded);
        let expected: Vec<i64> = (0..20).map(|i| (start * WEEK + 604_798) * S + 200_000_000 * i).collect();
        assert_eq!(stamps, expected, "{before} {after}");
        assert_eq!(count_of(&loaded, "date-inferred"), if after == 0 { 20 } else { 0 });
    }
}

#[test]
fn epochs_with_the_old_week_after_sunday_midnight_are_corrected() {
    // ArduPilot#31914: the time of week wraps around, the week follows some epochs late.
    for late in 1..=5 {
        let rows: Vec<_> = (0..40)
            .map(|i| match i {
                0..20 => (2313, 604_796_000 + 200 * i, 3),
                _ if i < 20 + late => (2313, 200 * (i - 20), 3),
                _ => (2314, 200 * (i - 20), 3),
            })
            .collect();
        let loaded = read(&library(WEEKS, ""), &weeks(&rows)).unwrap();
        let expected: Vec<i64> = (0..40).map(|i| (2313 * WEEK + 604_796) * S + 200_000_000 * i).collect();
        assert_eq!(stamps(&loaded), expected, "{late}");
        assert_eq!(count_of(&loaded, "date-inferred"), late as u64);
    }
}

#[test]
fn rows_without_a_fix_or_a_week_are_never_used() {
    let mut rows = vec![(0, 0, 0), (0, 200, 3), (1024, 0, 1)];
    rows.extend((0..10).map(|i| (2313, 1000 + 200 * i, 3)));
    let loaded = read(&library(WEEKS, ""), &weeks(&rows)).unwrap();
    assert_eq!(stamps(&loaded).len(), 10);
    assert_eq!(stamps(&loaded)[0], (2313 * WEEK + 1) * S);
}

#[test]
fn counters_of_32_bits_continue_when_they_wrap_around() {
    for (unit, tick) in [("us", 1000), ("ms", 1_000_000), ("100us", 100_000)] {
        let time = format!("measured = [{{ field = \"t\", unit = \"{unit}\", clock = \"boot\" }}]");
        let step = 100_000_000 / tick;
        let count = |i: i64| (1 << 32) - 5 * step + i * step;
        let mut text = "t,fix,lat,lon\n".to_owned();
        for i in 0..10 {
            text += &format!("{},3,47.{i:04},8.5\n", count(i) % (1 << 32));
        }
        let loaded = read(&library(&time, ""), &text).unwrap();
        assert_eq!(stamps(&loaded), (0..10).map(|i| count(i) * tick).collect::<Vec<_>>(), "{unit}");
        assert_eq!(count_of(&loaded, "stamp-wrap"), 1);
    }
}

#[test]
fn timestamp_corrections_of_a_topic_are_reported_once() {
    let time = "measured = [{ field = \"t\", unit = \"us\", clock = \"boot\" }]";
    let velocity = "[[channel]]\nname = \"velocity.gps\"\nquantity = \"velocity-ned\"\ntimeline = \"measured\"\n[channel.fields]\n\
                    north = { field = \"lat\", unit = \"m/s\" }\neast = { field = \"lon\", unit = \"m/s\" }\n";
    let row = |i: i64| format!("{},3,47.{i:04},8.5\n", ((1 << 32) - 500_000 + i * 100_000) % (1_i64 << 32));
    let text = (0..10).fold("t,fix,lat,lon\n".to_owned(), |text, i| text + &row(i));
    let loaded = read(&library(time, velocity), &text).unwrap();
    assert_eq!(loaded.flight.channels.len(), 2);
    let reported: Vec<_> = loaded.flight.notices.iter().filter(|n| n.code == "stamp-wrap").collect();
    assert_eq!((reported.len(), reported[0].count), (1, 1));
    assert!(reported[0].text.starts_with("2 channels, the first of them velocity.gps: "), "{}", reported[0].text);
}

#[test]
fn a_channel_without_a_usable_row_is_reported_once_with_reasons() {
    let loaded = read(&library(WEEKS, ""), &weeks(&[(2313, 1000, 1), (2313, 1200, 2), (0, 1400, 3)])).unwrap();
    let of_channel = |n: &&flight::Notice| n.severity == flight::Severity::Warning && n.text.contains("position.gps");
    let reported: Vec<_> = loaded.flight.notices.iter().filter(of_channel).collect();
    assert_eq!(reported.iter().map(|n| n.code.as_str()).collect::<Vec<_>>(), ["rejected-row"]);
    assert!(reported[0].text.ends_with("fix is below 3 (2), no timestamp (1)"), "{}", reported[0].text);
}

#[test]
fn numbers_of_a_calendar_and_dates_of_every_order_are_the_same_instants() {
    // date -u -d '2024-05-10T17:27:44Z' +%s
    let expected: Vec<i64> = (0..3).map(|i| 1_715_362_064 * S + 100_000_000 * i).collect();
    let calendar = "measured = [{ calendar = [\"y\", \"mo\", \"d\", \"h\", \"mi\", \"s\", \"ns\"] }]";
    let mut text = "y,mo,d,h,mi,s,ns,fix,lat,lon\n".to_owned();
    (0..3).for_each(|i| text += &format!("2024,5,10,17,27,44,{},3,47.{i:04},8.5\n", 100_000_000 * i));
    assert_eq!(stamps(&read(&library(calendar, ""), &text).unwrap()), expected);
    let civil = "measured = [{ date = \"date\", time = \"time\" }]";
    for date in ["2024-05-10", "2024/05/10", "20240510", "10.05.2024", "10.5.2024"] {
        let mut text = "date;time;fix;lat;lon\n".to_owned();
        (0..3).for_each(|i| text += &format!("{date};17:27:44,{i};3;47,000{i};8,5\n"));
        assert_eq!(stamps(&read(&library(civil, ""), &text).unwrap()), expected, "{date}");
    }
}

#[test]
fn the_day_of_a_date_with_slashes_is_not_guessed() {
    let civil = "measured = [{ date = \"date\", time = \"time\" }]";
    let text = |date: &str| format!("date,time,fix,lat,lon\n{date},17:27:44,3,47.0,8.5\n{date},17:27:45,3,47.1,8.5\n");
    let loaded = read(&library(civil, ""), &text("23/06/2021")).unwrap();
    assert_eq!(stamps(&loaded)[0], 1_624_469_264 * S);
    assert_eq!(count_saying(&loaded, "date-inferred", "day first: 23/06/2021"), 2);
    let why = read(&library(civil, ""), &text("05/06/2021")).unwrap().binding.unwrap_err();
    assert!(why.contains("date is ambiguous: which number of 05/06/2021 is the day? Write order ="), "{why}");
    for (order, day) in [("day-month-year", 1_622_914_064), ("month-day-year", 1_620_322_064)] {
        let civil = format!("measured = [{{ date = \"date\", order = \"{order}\", time = \"time\" }}]");
        let loaded = read(&library(&civil, ""), &text("05/06/2021")).unwrap();
        assert_eq!((stamps(&loaded)[0], count_saying(&loaded, "date-inferred", "first: ")), (day * S, 0), "{order}");
    }
}

#[test]
fn a_stale_date_after_midnight_moves_no_row_a_day_back() {
    let civil = "measured = [{ date = \"date\", time = \"time\" }]";
    // 23:59:50 to 00:00:29; from row 10 on it is the 6th, which the date says from row `known` on.
    let text = |known: usize| {
        let row = |i: usize| {
            let time = if i < 10 { format!("23:59:{}", 50 + i) } else { format!("00:00:{:02}", i - 10) };
            format!("{},{time},3,47.{i:04},8.5\n", if i < known { "2021-06-05" } else { "2021-06-06" })
        };
        (0..40).fold("date,time,fix,lat,lon\n".to_owned(), |text, i| text + &row(i))
    };
    // date -u -d '2021-06-05T23:59:50Z' +%s
    let truth: Vec<i64> = (0..40).map(|i| (1_622_937_590 + i) * S).collect();
    for (known, stale) in [(10, 0), (25, 15), (40, 30)] {
        let loaded = read(&library(civil, ""), &text(known)).unwrap();
        assert_eq!(stamps(&loaded), truth, "{known}");
        let dated = count_saying(&loaded, "date-inferred", "midnight");
        assert_eq!((dated, count_of(&loaded, "unreliable-stamps")), (stale, 0), "{known}");
    }
}

const BOOT: &str = "measured = [{ field = \"t\", unit = \"us\", clock = \"boot\" }]";
const TIE: &str = "[[utc]]\nstamp = { field = \"t\", unit = \"us\", clock = \"boot\" }\n\
                   utc = { week = \"GWk\", field = \"GMS\", unit = \"ms\" }\nrequire = [{ field = \"fix\", min = 3 }]";

#[test]
fn the_receivers_time_dates_the_clock_since_boot_and_moves_no_sample() {
    let mut text = "t,GWk,GMS,fix,lat,lon\n".to_owned();
    for i in 0..51_i64 {
        // The message is 100 to 104 ms late; the first has no fix, one is a day off.
        let late = 100_000 + 1000 * (i % 5);
        let day = if i == 7 { 86_400_000 } else { 0 };
        let fix = if i == 0 { 1 } else { 3 };
        text +=
            &format!("{},2313,{},{fix},47.{i:04},8.5\n", 5_000_000 + 200_000 * i + late, 500_000_000 + 200 * i - day);
    }
    let loaded = read(&library(BOOT, TIE), &text).unwrap();
    let tie = loaded.flight.utc.as_ref().unwrap();
    // GPS week 2313 + 500 000 s is 1 715 367 182 s of UTC; the message of that epoch came 5.102 s after boot as a rule.
    assert_eq!(tie.offset_ns, 1_715_367_182 * S - 5_102_000_000);
    assert_eq!((tie.pairs, tie.outliers, tie.clock), (49, 1, Clock::Boot));
    assert!(tie.spread_s.min >= -0.002 - 1e-9 && tie.spread_s.max <= 0.002 + 1e-9);
    assert_eq!(loaded.health.utc.as_ref(), Some(tie));
    assert_eq!(
        (count_saying(&loaded, "utc-tie", "is dated by"), count_saying(&loaded, "utc-tie", "by more than a second")),
        (49, 1)
    );
    assert_eq!(stamps(&loaded)[0], 5_301_000_000);
    assert_eq!(loaded.flight.unix(Clock::Boot, Stamp(5_102_000_000)), Some(Stamp(1_715_367_182 * S)));
}

#[test]
fn clocks_that_differ_by_leap_seconds_or_a_zone_get_a_warning() {
    let time = "measured = [{ field = \"gps\", unit = \"s\", clock = \"gps\" }]\n\
                logged = [{ field = \"utc\", unit = \"s\", clock = \"unix\" }]";
    for (off, word) in
        [(18, "leap seconds"), (-18, "leap seconds"), (36, "twice"), (37, "TAI"), (7200, "local time, 2 h")]
    {
        let mut text = "gps,utc,fix,lat,lon\n".to_owned();
        for i in 0..20_i64 {
            let gps = 2313 * WEEK + 500_000 + i;
            text += &format!("{gps}.000,{}.050,3,47.{i:04},8.5\n", gps + GPS_EPOCH - 18 + off);
        }
        let loaded = read(&library(time, ""), &text).unwrap();
        let notice =
            loaded.flight.notices.iter().find(|n| n.code == "clock-suspect").unwrap_or_else(|| panic!("{off}"));
        assert!(notice.text.contains(word), "{off}: {}", notice.text);
    }
}

#[test]
fn a_delay_between_gps_time_and_utc_is_not_suspect() {
    let time = "measured = [{ field = \"gps\", unit = \"s\", clock = \"gps\" }]\n\
                logged = [{ field = \"utc\", unit = \"s\", clock = \"unix\" }]";
    let mut text = "gps,utc,fix,lat,lon\n".to_owned();
    for i in 0..20_i64 {
        let gps = 2313 * WEEK + 500_000 + i;
        text += &format!("{gps}.000,{}.120,3,47.{i:04},8.5\n", gps + GPS_EPOCH - 18);
    }
    let loaded = read(&library(time, ""), &text).unwrap();
    assert_eq!(count_of(&loaded, "clock-suspect"), 0);
    let offset = loaded.binding.unwrap().channels[0].offsets[0].offset_s;
    assert!((offset.median - 0.12).abs() < 1e-9, "{offset:?}");
}

#[test]
fn a_flight_after_the_known_leap_seconds_is_reported() {
    let rows = |week| weeks(&(0..10).map(|i| (week, 1000 * i, 3)).collect::<Vec<_>>());
    let reported = |week| count_of(&read(&library(WEEKS, ""), &rows(week)).unwrap(), "leap-seconds");
    assert_eq!((reported(2313), reported(2600)), (0, 1));
    // Also for a clock since boot dated by GPS time.
    let tied = |week: i64| {
        let row = |i: i64| format!("{},{week},{},3,47.{i:04},8.5\n", 5_000_000 + 200_000 * i, 500_000_000 + 200 * i);
        let text = format!("t,GWk,GMS,fix,lat,lon\n{}", (0..10).map(row).collect::<String>());
        count_of(&read(&library(BOOT, TIE), &text).unwrap(), "leap-seconds")
    };
    assert_eq!((tied(2313), tied(2600)), (0, 1));
}

/// A position that counts GPS time and a velocity that counts UTC, each in its own table, `apart` seconds too far
/// from one another; with the log's own time, or without.
fn two_tables(apart: f64, logged: bool) -> Loaded {
    let log = |on: bool| if on { "\nlogged = [{ field = \"log\", unit = \"s\", clock = \"unix\" }]" } else { "" };
    let channel = |name: &str, quantity: &str, topic: &str, time: &str, fields: &str| {
        format!(
            "[[channel]]\nname = \"{name}\"\nquantity = \"{quantity}\"\ntopic = [\"{topic}\"]\ntimeline = \"measured\"\n\
             [channel.time]\nmeasured = [{time}]{}\n[channel.fields]\n{fields}\n",
            log(logged)
        )
    };
    let position = channel(
        "position.gps",
        "position-geodetic",
        "the_position",
        "{ field = \"t\", unit = \"s\", clock = \"gps\" }",
        "latitude = { field = \"lat\", unit = \"deg\" }\nlongitude = { field = \"lon\", unit = \"deg\" }",
    );
    let velocity = channel(
        "velocity.gps",
        "velocity-ned",
        "the_velocity",
        "{ field = \"t\", unit = \"s\", clock = \"unix\" }",
        "north = { field = \"n\", unit = \"m/s\" }\neast = { field = \"e\", unit = \"m/s\" }",
    );
    let map = format!("schema = 1\nname = \"t\"\ntitle = \"t\"\n{position}{velocity}");
    let mut library = MapLibrary::shipped().unwrap();
    library.add(ChannelMap::from_toml(Path::new("t.toml"), &map).unwrap());
    let folder = tempfile::tempdir().unwrap();
    let utc = |i: i64| 1_715_367_182.0 + 0.2 * i as f64;
    let table = |name: &str, head: &str, row: &dyn Fn(i64) -> String| {
        let path = folder.path().join(name);
        let rows: String = (0..200).map(|i| format!("{},{:.3}\n", row(i), utc(i) + 0.25)).collect();
        std::fs::write(&path, format!("{head},log\n{rows}")).unwrap();
        path
    };
    let gps = |i: i64| utc(i) - GPS_EPOCH as f64 + 18.0;
    let files = [
        table("the_position.csv", "t,lat,lon", &|i| format!("{:.3},47.{i:04},8.5", gps(i))),
        table("the_velocity.csv", "t,n,e", &|i| format!("{:.3},1.{i},2", utc(i) + apart + 0.03)),
    ];
    let loaded = load_mapped(&tables(&files), &library, Some("t")).unwrap();
    assert_ledger(&loaded);
    loaded
}

#[test]
fn topic_clocks_that_differ_by_leap_seconds_or_a_zone_get_a_warning() {
    for logged in [false, true] {
        for (apart, word) in [
            (18.0, "leap seconds"),
            (-18.0, "leap seconds"),
            (-36.0, "twice"),
            (37.0, "TAI"),
            (19.0, "TAI"),
            (3600.0, "local time, 1 h"),
            (-19_800.0, "local time, 5.5 h"),
            (604_800.0, "GPS week"),
        ] {
            let loaded = two_tables(apart, logged);
            let reported: Vec<&flight::Notice> =
                loaded.flight.notices.iter().filter(|n| n.code == "clock-suspect").collect();
            let names = |n: &&&flight::Notice| n.text.contains("position.gps") && n.text.contains("velocity.gps");
            let pair = reported.iter().find(names).unwrap_or_else(|| panic!("{apart} {logged}: {reported:?}"));
            assert!(pair.text.contains(word), "{apart} {logged}: {}", pair.text);
        }
        for apart in [0.0, 0.4, -1.4, 5.0, 25.0, 100.0] {
            let loaded = two_tables(apart, logged);
            assert_eq!(count_of(&loaded, "clock-suspect"), 0, "{apart} {logged}: {:?}", loaded.flight.notices);
        }
    }
}

#[test]
fn log_time_is_compared_with_a_dated_clock_since_boot() {
    let time = format!("{BOOT}\nlogged = [{{ field = \"utc\", unit = \"ms\", clock = \"unix\" }}]");
    for (off, word) in [(0, None), (800, None), (18_000, Some("leap seconds")), (-7_200_000, Some("local time, 2 h"))] {
        let mut text = "t,GWk,GMS,utc,fix,lat,lon\n".to_owned();
        for i in 0..50_i64 {
            let utc_ms = 1_715_367_182_000 + 200 * i;
            text += &format!(
                "{},2313,{},{},3,47.{i:04},8.5\n",
                5_000_000 + 200_000 * i,
                500_000_000 + 200 * i,
                utc_ms + 50 + off
            );
        }
        let loaded = read(&library(&time, TIE), &text).unwrap();
        let reported: Vec<&str> =
            loaded.flight.notices.iter().filter(|n| n.code == "clock-suspect").map(|n| n.text.as_str()).collect();
        match word {
            Some(word) => assert!(reported.len() == 1 && reported[0].contains(word), "{off}: {reported:?}"),
            None => assert!(reported.is_empty(), "{off}: {reported:?}"),
        }
    }
}

#[test]
fn a_position_and_velocity_without_common_time_are_reported() {
    let of = |apart| count_saying(&two_tables(apart, false), "clock-suspect", "no time in common");
    // These count GPS time and UTC: not directly comparable, and reported by their offset.
    assert_eq!(of(3600.0), 0);
    let map = "schema = 1\nname = \"t\"\ntitle = \"t\"\n[time]\nmeasured = [{ field = \"t\", unit = \"s\", clock = \"boot\" }]\n\
               [[channel]]\nname = \"position.a\"\nquantity = \"position-ned\"\ntopic = [\"the_position\"]\n\
               timeline = \"measured\"\n[channel.fields]\nnorth = { field = \"n\", unit = \"m\" }\n\
               east = { field = \"e\", unit = \"m\" }\n[[channel]]\nname = \"velocity.a\"\nquantity = \"velocity-ned\"\n\
               topic = [\"the_velocity\"]\ntimeline = \"measured\"\n[channel.fields]\n\
               north = { field = \"n\", unit = \"m/s\" }\neast = { field = \"e\", unit = \"m/s\" }\n";
    let mut library = MapLibrary::shipped().unwrap();
    library.add(ChannelMap::from_toml(Path::new("t.toml"), map).unwrap());
    for (begin, reported) in [(0, 0), (10, 0), (4295, 1)] {
        let folder = tempfile::tempdir().unwrap();
        let table = |name: &str, begin: i64| {
            let rows: String = (0..20).map(|i| format!("{},{i},1\n", begin + i)).collect();
            std::fs::write(folder.path().join(name), format!("t,n,e\n{rows}")).unwrap();
            folder.path().join(name)
        };
        let files = [table("the_position.csv", 0), table("the_velocity.csv", begin)];
        let loaded = load_mapped(&tables(&files), &library, Some("t")).unwrap();
        assert_eq!(count_saying(&loaded, "clock-suspect", "no time in common"), 20 * reported, "{begin}");
    }
}

/// A map of a position and a velocity with this time source.
fn wrap_library([position, velocity]: [&str; 2]) -> MapLibrary {
    let channel = |name: &str, quantity: &str, topic: &str, time: &str, fields: &str| {
        format!(
            "[[channel]]\nname = \"{name}\"\nquantity = \"{quantity}\"\ntopic = [\"{topic}\"]\ntimeline = \"measured\"\n\
             time = {{ measured = [{{ field = \"t\", {time} }}] }}\n[channel.fields]\n{fields}\n"
        )
    };
    let degrees = "latitude = { field = \"a\", unit = \"deg\" }\nlongitude = { field = \"b\", unit = \"deg\" }";
    let speeds = "north = { field = \"a\", unit = \"m/s\" }\neast = { field = \"b\", unit = \"m/s\" }";
    let map = "schema = 1\nname = \"t\"\ntitle = \"t\"\n".to_owned()
        + &channel("position.gps", "position-geodetic", "the_position", position, degrees)
        + &channel("velocity.gps", "velocity-ned", "the_velocity", velocity, speeds);
    let mut library = MapLibrary::default();
    library.add(ChannelMap::from_toml(Path::new("t.toml"), &map).unwrap());
    library
}

/// A table with a row in each of these seconds, which wrap around at `range`; one cell may be replaced.
fn wrap_table(path: PathBuf, range: i64, seconds: std::ops::Range<i64>, wrong: Option<(i64, i64)>) -> PathBuf {
    let begin = seconds.start;
    let cell = |s: i64| wrong.filter(|(at, _)| begin + at == s).map_or(s % range, |(_, cell)| cell);
    let rows: String = seconds.map(|s| format!("{},47.{s:06},8.5\n", cell(s))).collect();
    std::fs::write(&path, format!("t,a,b\n{rows}")).unwrap();
    path
}

/// The time of the first row of each of these tables, s, if they are read whole; and the notices about the timestamps
/// of the first two, by code and count.
fn first_rows(files: &[PathBuf], library: &MapLibrary) -> (Vec<i64>, Vec<(String, u64)>) {
    let all = |_: &ingest::TopicInfo| ingest::Selection::All;
    let log = in_context(|context| ingest::read(&tables(files), &all, context)).unwrap();
    let times = ingest::row_times(&log, library).unwrap();
    let name = |file: &PathBuf| file.file_stem().unwrap().to_str().unwrap().to_owned();
    let first = |file: &PathBuf| {
        let at = log.tables.iter().position(|table| table.topic.name == name(file)).unwrap();
        times.tables[at].as_ref().unwrap().nanos.get(0).unwrap() / S
    };
    (
        files.iter().map(first).collect(),
        notices_of_stamps(&times.notices, &files[..2].iter().map(name).collect::<Vec<_>>()),
    )
}

/// The notices about the timestamps of these topics, by code and count.
fn notices_of_stamps(notices: &flight::Notices, topics: &[String]) -> Vec<(String, u64)> {
    let of_stamps = |n: &&flight::Notice| n.text.contains("stamps in ") && topics.contains(&n.place);
    let mut reported: Vec<(String, u64)> =
        notices.iter().filter(of_stamps).map(|n| (n.code.clone(), n.count)).collect();
    reported.sort_unstable();
    reported
}

/// The first stamps of a position and a velocity, s since the end of a count, and how many stamps are reported to fit before it as
/// well. Rows every second until 300 s after it. One cell of each table may be replaced.
/// The rows of a table have the same stamps in the reader's row times.
fn wrapped(times: [&str; 2], range: i64, begins: [i64; 2], wrong: [Option<(i64, i64)>; 2]) -> ([i64; 2], u64) {
    let library = wrap_library(times);
    let folder = tempfile::tempdir().unwrap();
    let table = |name: &str, begin, wrong| wrap_table(folder.path().join(name), range, begin..range + 300, wrong);
    let files = [
        table("the_position.csv", range + begins[0], wrong[0]),
        table("the_velocity.csv", range + begins[1], wrong[1]),
        table("no_channel.csv", 0, None),
    ];
    let loaded = load_mapped(&tables(&files), &library, Some("t")).unwrap();
    let first = |name: &str| loaded.flight.channels[name].series.timeline().stamps()[0].0 / S - range;
    let found = ["position.gps", "velocity.gps"].map(first);
    let (rows, reported) = first_rows(&files, &library);
    assert_eq!(rows[..2], found.map(|s| s + range));
    // The third table may report more of them.
    let bound = notices_of_stamps(&loaded.flight.notices, &["the_position".into(), "the_velocity".into()]);
    assert!(bound.iter().all(|notice| reported.contains(notice)), "{bound:?} in {reported:?}");
    (found, count_saying(&loaded, "stamp-wrap", "fit before the wrap and after it"))
}

const TIME_OF_DAY: &str = "unit = \"s\", clock = \"elapsed\"";
const TWELVE_BITS: &str = "unit = \"s\", clock = \"boot\", bits = 12";

#[test]
fn a_topic_starting_after_a_wrap_follows_the_others_or_is_reported() {
    for (time, range) in [(TIME_OF_DAY, 86_400), (TWELVE_BITS, 4096)] {
        let load = |begins| wrapped([time; 2], range, begins, [None; 2]);
        for begins in [[-200, -100], [100, -100], [-100, 100], [100, 100 - range / 2]] {
            assert_eq!(load(begins), (begins, 0), "{time}: {begins:?}");
        }
        // It fits before and after.
        assert_eq!(load([100, 50 - range]), ([100 - range, 50 - range], 200), "{time}");
    }
}

#[test]
fn rows_of_a_table_without_channels_wrap_like_the_others() {
    let folder = tempfile::tempdir().unwrap();
    let table = |name: &str, begin| wrap_table(folder.path().join(name), 86_400, begin..86_700, None);
    let library = wrap_library([TIME_OF_DAY; 2]);
    let crossing = table("the_position.csv", 86_200);
    let files = [crossing, table("the_velocity.csv", 86_500), table("no_channel.csv", 86_450)];
    assert_eq!(first_rows(&files, &library).0, [86_200, 86_500, 86_450]);
    // It alone shows the midnight.
    let files = [table("the_position.csv", 86_410), files[1].clone(), table("no_channel.csv", 86_300)];
    assert_eq!(first_rows(&files, &library).0, [86_410, 86_500, 86_300]);
}

#[test]
fn one_wrong_cell_does_not_prevent_wrapping_like_the_other_topic() {
    let begins = [100, -2000];
    for wrong in [9_000_000_000, 5_000_000] {
        for cells in [[None, Some((150, wrong))], [Some((150, wrong)), None]] {
            assert_eq!(wrapped([TWELVE_BITS; 2], 4096, begins, cells), (begins, 0), "{cells:?}");
        }
    }
}

#[test]
fn only_a_topic_with_the_same_counter_and_range_wraps_like_another() {
    for other in [
        "unit = \"s\", clock = \"boot\"",
        "unit = \"s\", clock = \"boot\", bits = 13",
        "unit = \"s\", clock = \"elapsed\", bits = 12",
    ] {
        let (found, unclear) = wrapped([other, TWELVE_BITS], 4096, [100, -100], [None; 2]);
        assert_eq!((found, unclear), ([100 - 4096, -100], 0), "{other}");
    }
}

#[test]
fn a_coarse_clock_is_reported_with_its_resolution() {
    let time = "measured = [{ field = \"t\", unit = \"ms\", clock = \"boot\" }]";
    let reported = |stamp: &dyn Fn(i64) -> i64, value: &dyn Fn(i64) -> i64| {
        let row = |i: i64| format!("{},3,47.{:04},8.5\n", 10_000 + stamp(i), value(i));
        let text = (0..200).fold("t,fix,lat,lon\n".to_owned(), |text, i| text + &row(i));
        let loaded = read(&library(time, ""), &text).unwrap();
        let notice =
            loaded.flight.notices.iter().find(|n| n.code == "duplicate-stamp" && n.text.contains("no finer")).cloned();
        // It is visible in the timestamps themselves.
        let step_s = loaded.flight.channels.values().map(|c| c.series.timeline().shared_step_s()).fold(0.0, f64::max);
        assert_eq!(step_s > 0.0, notice.is_some());
        notice.map(|n| (n.count, n.text))
    };
    // Ten rows a second: by a clock of whole seconds, and by a logger that writes twice a second.
    let (count, text) = reported(&|i| i / 10 * 1000, &|i| i).unwrap();
    assert_eq!(count, 180);
    assert!(text.contains("180 of 200 rows") && text.contains("no finer than 1.000 s"), "{text}");
    assert!(reported(&|i| (i / 5 + 1) * 500, &|i| i).unwrap().1.contains("no finer than 0.500 s"));
    // Everything sent twice, one stamp in ten wrong, and a clock as fine as its rows.
    assert_eq!(reported(&|i| i / 2 * 200, &|i| i / 2), None);
    assert_eq!(reported(&|i| if i % 10 == 9 { i * 100 - 100 } else { i * 100 }, &|i| i), None);
    assert_eq!(reported(&|i| i * 100, &|i| i), None);
}

#[test]
fn a_clock_set_back_is_reported_with_amount() {
    let time = "measured = [{ field = \"t\", unit = \"ms\", clock = \"unix\" }]";
    for (back_ms, reported) in
        [(3_600_000, ", by 3600.000 s at most; the rows"), (340, ", by 0.340 s at most; the rows")]
    {
        let row = |i: i64| {
            let ms = 1_700_000_000_000 + 100 * i - if i < 100 { 0 } else { back_ms };
            format!("{ms},3,47.{i:04},8.5\n")
        };
        let text = (0..200).fold("t,fix,lat,lon\n".to_owned(), |text, i| text + &row(i));
        let loaded = read(&library(time, ""), &text).unwrap();
        let notice = loaded.flight.notices.iter().find(|n| n.code == "unreliable-stamps").unwrap();
        assert!(notice.text.contains(reported), "{back_ms}: {}", notice.text);
    }
}

#[test]
fn losing_a_tenth_of_the_rows_to_a_set_clock_is_a_loss_but_a_few_is_not() {
    let time = "measured = [{ field = \"t\", unit = \"s\", clock = \"unix\" }]";
    let day_off = |until: i64| {
        let row = |i: i64| format!("{},3,47.{i:04},8.5\n", 1_700_000_000 + i - if i < until { 432_000 } else { 0 });
        let text = (0..200).fold("t,fix,lat,lon\n".to_owned(), |text, i| text + &row(i));
        let loaded = read(&library(time, ""), &text).unwrap();
        (count_of(&loaded, "rejected-row"), lossy(&loaded))
    };
    assert_eq!([0, 5, 19, 20, 90].map(day_off), [(0, false), (5, false), (19, false), (20, true), (90, true)]);
}

#[test]
fn a_wrong_time_source_in_a_map_is_rejected_with_a_reason() {
    for (time, more, word) in [
        ("measured = [{ week = \"w\", field = \"s\" }]", "", "a week with a"),
        ("measured = [{ calendar = [\"y\"] }]", "", "a calendar is"),
        (
            BOOT,
            "[[utc]]\nstamp = { field = \"t\", unit = \"us\", clock = \"unix\" }\nutc = { field = \"u\", text = \"iso-8601\" }",
            "boot or elapsed",
        ),
    ] {
        let with_channel = format!(
            "schema = 1\nname = \"t\"\ntitle = \"t\"\n[time]\n{time}\n{more}\n[[channel]]\nname = \"a.b\"\n\
             quantity = \"scalar\"\ntimeline = \"measured\"\n[channel.fields]\nvalue = {{ field = \"v\", unit = \"1\" }}\n"
        );
        let error = ChannelMap::from_toml(Path::new("t.toml"), &with_channel).unwrap_err().to_string();
        assert!(error.contains(word), "{error}");
    }
}

#[test]
fn decimal_seconds_are_exact_even_if_every_field_is_wanted() {
    let time = "measured = [{ field = \"t\", unit = \"s\", clock = \"unix\" }]";
    let nanos = |i: i64| 1_700_000_000_123_456_789 + 100_000_001 * i;
    let row = |i: i64| format!("{}.{:09},3,47.{i:04},8.5\n", nanos(i) / S, nanos(i) % S);
    let text = (0..20).fold("t,fix,lat,lon\n".to_owned(), |text, i| text + &row(i));
    let truth: Vec<i64> = (0..20).map(nanos).collect();
    assert_eq!(stamps(&read(&library(time, ""), &text).unwrap()), truth);
    let (_folder, path) = file("t.csv", text.as_bytes());
    let log = in_context(|context| {
        ingest::read(&tables(&[path]), &|_: &ingest::TopicInfo| ingest::Selection::All, context).unwrap()
    });
    // The column itself stays one of numbers, and there is one of each name.
    assert_eq!(log.tables[0].columns.len(), 4);
    assert!(log.tables[0].columns.iter().all(|c| !matches!(c.data, ingest::ColumnData::Text(_))));
    let times = ingest::row_times(&log, &library(time, "")).unwrap().tables.remove(0).unwrap();
    assert_eq!(times.nanos, truth.into());
}
