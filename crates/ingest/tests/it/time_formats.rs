//! One flight with its time in every notation of recorders and spreadsheets: the timestamps are the same, or
//! the day is unknown.

use crate::support::*;
use flight::{Clock, Stamp};
use ingest::{ChannelMap, Loaded, MapLibrary};
use std::path::Path;

const S: i64 = 1_000_000_000;
const MS: i64 = 1_000_000;
const DAY: i64 = 86_400 * S;
/// date -u -d '2024-05-10T17:27:44.3Z' +%s: the first row.
const BEGIN: i64 = 1_715_362_064_300_000_000;
/// The same since midnight; the day is the 131st.
const OF_DAY: i64 = ((17 * 60 + 27) * 60 + 44) * S + 300 * MS;
const ROWS: i64 = 120;
const STEP: i64 = 100 * MS;

fn load_by(time: &str, header: &str, rows: impl Iterator<Item = String>) -> Loaded {
    let text = format!(
        "schema = 1\nname = \"t\"\ntitle = \"t\"\n[time]\nmeasured = [{{ {time} }}]\n[[channel]]\nname = \"position.gps\"\n\
         quantity = \"position-geodetic\"\ntimeline = \"measured\"\n[channel.fields]\nlatitude = {{ field = \"lat\", unit = \"deg\" }}\n\
         longitude = {{ field = \"lon\", unit = \"deg\" }}\n"
    );
    let mut library = MapLibrary::default();
    library.add(ChannelMap::from_toml(Path::new("t.toml"), &text).unwrap());
    // A decimal comma applies to every column.
    let point = |row: &str| if row.contains(',') { ',' } else { '.' };
    let line = |(i, row): (usize, String)| format!("{row};47{0}{i:04};8{0}5\n", point(&row));
    let table: String = rows.enumerate().map(line).collect();
    let (_folder, path) = file("t.csv", format!("{header};lat;lon\n{table}").as_bytes());
    let loaded = load_mapped(&tables(&[path]), &library, Some("t")).unwrap();
    assert_ledger(&loaded);
    loaded
}

fn stamps(loaded: &Loaded) -> (Clock, Vec<i64>) {
    let channel = loaded.flight.channels.get("position.gps").unwrap_or_else(|| panic!("{:?}", loaded.binding));
    let timeline = channel.series.timeline();
    (timeline.clock(), timeline.stamps().iter().map(|s| s.0).collect())
}

fn codes(loaded: &Loaded) -> Vec<&str> {
    loaded.flight.notices.iter().map(|n| n.code.as_str()).filter(|code| *code != "assumption").collect()
}

fn truth(begin: i64) -> Vec<i64> {
    (0..ROWS).map(|i| begin + STEP * i).collect()
}

/// Nanoseconds as seconds with this many decimals.
fn decimal(ns: i64, decimals: usize) -> String {
    let text = format!("{}.{:09}", ns.div_euclid(S), ns.rem_euclid(S));
    text[..text.len() - 9 + decimals].trim_end_matches('.').to_owned()
}

/// hh, mm, ss.fff of nanoseconds since midnight.
fn clock_face(ns: i64) -> [String; 3] {
    let second = ns % DAY / S;
    [
        format!("{:02}", second / 3600),
        format!("{:02}", second / 60 % 60),
        format!("{:02}.{:03}", second % 60, ns % S / MS),
    ]
}

/// Days with the fraction of a day to 15 decimals, since this many half days before 1970.
fn days(ns: i64, days_before: i64, half: bool) -> String {
    let ns = ns + if half { DAY / 2 } else { 0 };
    let fraction = i128::from(ns % DAY) * 1_000_000_000_000_000 / i128::from(DAY);
    format!("{}.{fraction:015}", ns / DAY + days_before)
}

/// How a timestamp is written, from its time since 1970 and since the midnight before the first row.
type Write = fn(i64, i64) -> String;

#[test]
fn a_date_is_the_same_in_every_notation() {
    let formats: &[(&str, &str, Write)] = &[
        ("field = \"t\", unit = \"s\", clock = \"unix\"", "t", |ns, _| decimal(ns, 3)),
        ("field = \"t\", unit = \"ms\", clock = \"unix\"", "t", |ns, _| (ns / MS).to_string()),
        ("field = \"t\", unit = \"us\", clock = \"unix\"", "t", |ns, _| (ns / 1000).to_string()),
        ("field = \"t\", unit = \"ns\", clock = \"unix\"", "t", |ns, _| ns.to_string()),
        // 24107 days from 1904 to 1970.
        ("field = \"t\", unit = \"s\", clock = \"labview\"", "t", |ns, _| decimal(ns + 24_107 * DAY, 3)),
        ("field = \"t\", unit = \"d\", clock = \"excel\"", "t", |ns, _| days(ns, 25_569, false)),
        ("field = \"t\", unit = \"d\", clock = \"excel\"", "t", |ns, _| days(ns, 25_569, false).replace('.', ",")),
        ("field = \"t\", unit = \"d\", clock = \"matlab\"", "t", |ns, _| days(ns, 719_529, false)),
        ("field = \"t\", unit = \"d\", clock = \"modified-julian\"", "t", |ns, _| days(ns, 40_587, false)),
        ("field = \"t\", unit = \"d\", clock = \"julian\"", "t", |ns, _| days(ns, 2_440_587, true)),
        ("field = \"t\", text = \"day-of-year\", zone = \"Z\"", "t", |_, day| {
            format!("2024:131:{}", clock_face(day).join(":"))
        }),
        ("field = \"t\", text = \"day-of-year\"", "t", |_, day| {
            format!("2024:131:{}+02:00", clock_face(day + 7200 * S).join(":"))
        }),
        ("field = \"t\", text = \"day-of-year\", year = 2024", "t", |_, day| {
            format!("131:{} UTC", clock_face(day).join(":"))
        }),
        ("field = \"t\", text = \"day-of-year\", year = 2024, zone = \"-0500\"", "t", |_, day| {
            format!("131-{}", clock_face(day - 5 * 3600 * S).join(":"))
        }),
        ("field = \"t\", text = \"iso-8601\"", "t", |_, day| format!("2024-131T{}Z", clock_face(day).join(":"))),
        ("field = \"t\", text = \"iso-8601\"", "t", |_, day| format!("2024-W19-5T{}Z", clock_face(day).join(":"))),
        ("field = \"t\", text = \"iso-8601\"", "t", |_, day| {
            format!("2024-05-10T{}+02:00", clock_face(day + 7200 * S).join(":"))
        }),
        ("field = \"t\", text = \"iso-8601\", zone = \"+02:00\"", "t", |_, day| {
            format!("2024-05-10T{}", clock_face(day + 7200 * S).join(":"))
        }),
        ("date = \"d\", time = \"t\", zone = \"+0200\"", "d;t", |_, day| {
            format!("10.05.2024;{}", clock_face(day + 7200 * S).join(":"))
        }),
        ("date = \"d\", time = \"t\", zone = \"Z\"", "d;t", |_, day| format!("20240510;{}", clock_face(day).concat())),
        ("date = \"d\", time = \"t\", order = \"day-month-year\", zone = \"Z\"", "d;t", |_, day| {
            format!("100524;{}", clock_face(day).concat())
        }),
        ("date = \"d\", time = \"t\", order = \"month-day-year\", zone = \"Z\"", "d;t", |_, day| {
            format!("05102024;{}Z", clock_face(day).concat())
        }),
        ("date = \"d\", time = \"t\", zone = \"Z\"", "d;t", |_, day| format!("2024-131;{}", clock_face(day).join(":"))),
        ("calendar = [\"y\", \"m\", \"d\", \"h\", \"n\", \"s\"]", "y;m;d;h;n;s", |_, day| {
            format!("2024;5;10;{}", clock_face(day).join(";"))
        }),
        ("calendar = [\"y\", \"m\", \"d\", \"h\", \"n\", \"s\"], zone = \"+05:30\"", "y;m;d;h;n;s", |_, day| {
            format!("2024;5;10;{}", clock_face(day + 19_800 * S).join(";"))
        }),
    ];
    for (time, header, write) in formats {
        let loaded = load_by(time, header, (0..ROWS).map(|i| write(BEGIN + STEP * i, OF_DAY + STEP * i)));
        let (clock, found) = stamps(&loaded);
        let example = write(BEGIN, OF_DAY);
        assert_eq!((clock, found.len()), (Clock::Unix, ROWS as usize), "{example}: {:?}", codes(&loaded));
        let off = found.iter().zip(truth(BEGIN)).map(|(found, truth)| found.abs_diff(truth)).max();
        assert!(off <= Some(1), "{example}: {off:?} ns");
        assert!(codes(&loaded).is_empty(), "{example}: {:?}", loaded.flight.notices);
    }
}

#[test]
fn atomic_time_is_gps_time_and_nineteen_seconds() {
    // TAI is 37 s ahead of UTC in 2024.
    let rows = (0..ROWS).map(|i| (BEGIN + 37 * S + STEP * i).to_string());
    let loaded = load_by("field = \"t\", unit = \"ns\", clock = \"tai\"", "t", rows);
    let (clock, found) = stamps(&loaded);
    assert_eq!(clock, Clock::Gps);
    let unix: Vec<i64> = found.iter().map(|ns| loaded.flight.unix(clock, Stamp(*ns)).unwrap().0).collect();
    assert_eq!(unix, truth(BEGIN));
}

#[test]
fn a_time_without_a_day_continues_over_midnight_without_a_date() {
    const WRAP: &[&str] = &["stamp-wrap"];
    // The sixtieth row is the first of the next day; new year's day of the last two.
    let begin = DAY - 60 * STEP;
    let formats: &[(&str, i64, &[&str], Write)] = &[
        ("text = \"time-of-day\"", begin, WRAP, |_, ns| clock_face(ns).join(":")),
        ("text = \"time-of-day\"", begin, WRAP, |_, ns| clock_face(ns).concat()),
        // As a number, without leading zeros.
        ("text = \"time-of-day\"", begin, WRAP, |_, ns| {
            let text = clock_face(ns).concat();
            text.trim_start_matches('0').replacen('.', if text.starts_with("000000") { "0." } else { "." }, 1)
        }),
        ("unit = \"s\", clock = \"elapsed\"", begin, WRAP, |_, ns| decimal(ns % DAY, 1)),
        ("unit = \"min\", clock = \"elapsed\"", begin, WRAP, |_, ns| format!("{:.9}", (ns % DAY) as f64 / 60e9)),
        ("text = \"day-of-year\"", 130 * DAY + begin, &[], |_, ns| {
            format!("{:03}:{}", 131 + ns / DAY, clock_face(ns).join(":"))
        }),
        ("text = \"day-of-year\"", 364 * DAY + begin, WRAP, |_, ns| {
            format!("{:03}:{}", if ns < DAY { 365 } else { 1 }, clock_face(ns).join(":"))
        }),
        ("text = \"day-of-year\"", 365 * DAY + begin, WRAP, |_, ns| {
            format!("{:03}:{}", if ns < DAY { 366 } else { 1 }, clock_face(ns).join(":"))
        }),
    ];
    for (time, first, reported, write) in formats {
        let time = format!("field = \"t\", {time}");
        let loaded = load_by(&time, "t", (0..ROWS).map(|i| write(0, begin + STEP * i)));
        let (clock, found) = stamps(&loaded);
        let example = write(0, begin);
        assert_eq!((clock, loaded.flight.utc.is_none()), (Clock::Elapsed, true), "{example}");
        let off = found.iter().zip(truth(*first)).map(|(found, truth)| found.abs_diff(truth)).max();
        assert!(found.len() == ROWS as usize && off <= Some(50), "{example}: {off:?} ns, {:?}", codes(&loaded));
        assert_eq!(codes(&loaded), *reported, "{example}");
    }
}

#[test]
fn a_year_known_for_the_first_row_continues_over_new_year() {
    let begin = DAY - 60 * STEP;
    // date -u -d '2024-12-31' +%s and 2023: one is the 366th day.
    for (year, day, midnight) in [(2024, 366, 1_735_603_200), (2023, 365, 1_703_980_800)] {
        let time = format!("field = \"t\", text = \"day-of-year\", year = {year}, zone = \"Z\"");
        let face = |ns: i64| format!("{:03}:{}", if ns < DAY { day } else { 1 }, clock_face(ns).join(":"));
        let loaded = load_by(&time, "t", (0..ROWS).map(|i| face(begin + STEP * i)));
        assert_eq!(stamps(&loaded), (Clock::Unix, truth(midnight * S + begin)), "{year}");
        assert_eq!(codes(&loaded), ["stamp-wrap"]);
    }
}

#[test]
fn an_offset_after_a_day_of_the_year_overrides_the_zone_of_the_map() {
    let row = |i: i64, east_s: i64, offset: &str| {
        format!("131:{}{offset}", clock_face(OF_DAY + STEP * i + east_s * S).join(":"))
    };
    for (east_s, offset) in [(7200, "+02:00"), (-18_000, "-0500"), (0, "Z"), (0, " UTC"), (-3600, "")] {
        for (map, year) in [("", "2024:"), (", year = 2024", "")] {
            let time = format!("field = \"t\", text = \"day-of-year\"{map}, zone = \"-01:00\"");
            let loaded = load_by(&time, "t", (0..ROWS).map(|i| year.to_owned() + &row(i, east_s, offset)));
            assert_eq!((stamps(&loaded), codes(&loaded)), ((Clock::Unix, truth(BEGIN)), vec![]), "{year} {offset}");
        }
    }
    // A clock set to another zone, in an unknown year.
    let other = |i: i64| if i < 50 { row(i, 7200, "+02:00") } else { row(i, 3600, "+01:00") };
    let loaded = load_by("field = \"t\", text = \"day-of-year\"", "t", (0..ROWS).map(other));
    assert_eq!((stamps(&loaded), codes(&loaded)), ((Clock::Elapsed, truth(130 * DAY + OF_DAY)), vec![]));
    // New year's eve in a zone ahead of UTC.
    let new_year = |i: i64| format!("001:{}+02:00", clock_face(STEP * i).join(":"));
    let loaded = load_by("field = \"t\", text = \"day-of-year\"", "t", (0..ROWS).map(new_year));
    assert_eq!(stamps(&loaded), (Clock::Elapsed, truth(-7200 * S)));
}

#[test]
fn a_time_followed_by_an_invalid_offset_is_rejected() {
    for (text, date) in [("day-of-year", "2024:131:"), ("time-of-day", "")] {
        for rest in ["+garbage", " Garbage", "-", "+99:00"] {
            let row = |i: i64| format!("{date}{}{rest}", clock_face(OF_DAY + STEP * i).join(":"));
            let why = unbound(&format!("field = \"t\", text = \"{text}\""), "t", row);
            assert!(why.contains(&format!("this cannot be read: t: {}", row(0))), "{why}");
        }
    }
}

#[test]
fn instants_without_a_zone_are_utc_and_reported_once() {
    let face = |i: i64| clock_face(OF_DAY + STEP * i).join(":");
    for (time, header, date) in [
        ("field = \"t\", text = \"iso-8601\"", "t", "2024-05-10T"),
        ("date = \"d\", time = \"t\"", "d;t", "2024-05-10;"),
        ("field = \"t\", text = \"day-of-year\"", "t", "2024-131-"),
        ("field = \"t\", text = \"day-of-year\", year = 2024", "t", "131:"),
    ] {
        let loaded = load_by(time, header, (0..ROWS).map(|i| format!("{date}{}", face(i))));
        assert_eq!(stamps(&loaded), (Clock::Unix, truth(BEGIN)));
        assert_eq!(
            (codes(&loaded), count_of(&loaded, "date-inferred")),
            (vec!["date-inferred"], ROWS as u64),
            "{time}"
        );
    }
    let named =
        load_by("date = \"d (UTC)\", time = \"t\"", "d (UTC);t", (0..ROWS).map(|i| format!("2024-05-10;{}", face(i))));
    assert!(codes(&named).is_empty(), "{:?}", codes(&named));
}

#[test]
fn seconds_of_the_day_in_a_column_of_times_are_not_taken_for_hours_and_minutes() {
    let rows = (0..ROWS).map(|i| format!("2024-05-10;{}", decimal(OF_DAY + 600 * MS * i, 1)));
    let text = "schema = 1\nname = \"t\"\ntitle = \"t\"\n[time]\nmeasured = [{ date = \"d\", time = \"t\" }]\n[[channel]]\n\
                name = \"position.gps\"\nquantity = \"position-geodetic\"\ntimeline = \"measured\"\n[channel.fields]\n\
                latitude = { field = \"lat\", unit = \"deg\" }\nlongitude = { field = \"lon\", unit = \"deg\" }\n";
    let mut library = MapLibrary::default();
    library.add(ChannelMap::from_toml(Path::new("t.toml"), text).unwrap());
    let table: String = rows.enumerate().map(|(i, row)| format!("{row};47.{i:04};8.5\n")).collect();
    let (_folder, path) = file("t.csv", format!("d;t;lat;lon\n{table}").as_bytes());
    let loaded = load_mapped(&tables(&[path]), &library, Some("t")).unwrap();
    let why = loaded.binding.unwrap_err();
    assert!(why.contains("no timestamps (d, t); this cannot be read: d: 2024-05-10, t: 62864.3"), "{why}");
}

#[test]
fn a_sixteen_bit_counter_wraps_around_if_the_map_states_its_range() {
    let ms = |i: i64| 64_000 + 100 * i;
    let rows = || (0..ROWS).map(|i| (ms(i) & 0xffff).to_string());
    let loaded = load_by("field = \"t\", unit = \"ms\", clock = \"boot\", bits = 16", "t", rows());
    assert_eq!(stamps(&loaded), (Clock::Boot, (0..ROWS).map(|i| ms(i) * MS).collect()));
    assert_eq!(codes(&loaded), ["stamp-wrap"]);
    // Seconds as well.
    let loaded = load_by(
        "field = \"t\", unit = \"s\", clock = \"elapsed\", bits = 8",
        "t",
        (0..ROWS).map(|i| ((200 + i) & 255).to_string()),
    );
    assert_eq!(stamps(&loaded).1, (0..ROWS).map(|i| (200 + i) * S).collect::<Vec<_>>());
}

#[test]
fn invalid_timestamp_sources_are_rejected_with_a_reason() {
    for (time, word) in [
        ("field = \"t\", unit = \"s\", clock = \"boot\", zone = \"+02:00\"", "`zone` needs a date"),
        ("date = \"d\", time = \"t\", offset = \"o\", zone = \"+02:00\"", "without `offset`"),
        ("field = \"t\", text = \"iso-8601\", zone = \"Europe/Berlin\"", "`zone` is an offset from UTC"),
        ("field = \"t\", text = \"iso-8601\", zone = \"+14:30\"", "of at most 14 hours"),
        ("date = \"d\", time = \"t\", zone = \"-99:00\"", "of at most 14 hours"),
        ("field = \"t\", text = \"iso-8601\", year = 2024", "`year` needs text = \"day-of-year\""),
        ("field = \"t\", unit = \"ms\", clock = \"unix\", bits = 16", "`bits` needs a counter"),
        ("field = \"t\", unit = \"ms\", clock = \"boot\", bits = 64", "8 to 48 bits"),
        ("field = \"t\", text = \"time-of-day\", clock = \"unix\"", "a timestamp is one of"),
    ] {
        let text = format!(
            "schema = 1\nname = \"t\"\ntitle = \"t\"\n[time]\nmeasured = [{{ {time} }}]\n[[channel]]\nname = \"a.b\"\nquantity = \"scalar\"\n\
             timeline = \"measured\"\n[channel.fields]\nvalue = {{ field = \"v\", unit = \"1\" }}\n"
        );
        let error = ChannelMap::from_toml(Path::new("t.toml"), &text).unwrap_err().to_string();
        assert!(error.contains(word), "{time}: {error}");
    }
}

#[test]
fn one_day_without_its_year_among_many_costs_only_its_own_row() {
    let row = |i: i64| {
        let face = clock_face(OF_DAY + STEP * i).join(":");
        if i == 50 { format!("131:{face}") } else { format!("2024:131:{face}") }
    };
    let loaded = load_by("field = \"t\", text = \"day-of-year\"", "t", (0..ROWS).map(row));
    let mut expected = truth(BEGIN);
    expected.remove(50);
    assert_eq!(stamps(&loaded), (Clock::Unix, expected));
}

/// Why nothing was bound.
fn unbound(time: &str, header: &str, row: impl Fn(i64) -> String) -> String {
    load_by(time, header, (0..ROWS).map(row)).binding.unwrap_err()
}

#[test]
fn a_time_of_day_and_an_impossible_day_are_not_days_of_a_year() {
    let day_of_year = "field = \"t\", text = \"day-of-year\"";
    let face = |i: i64| clock_face(OF_DAY + STEP * i).join(":");
    let whole = |i: i64| format!("17:{:02}:{:02}", 5 + i / 60, i % 60);
    assert!(unbound(day_of_year, "t", whole).contains("this cannot be read: t: 17:05:00"));
    assert!(
        unbound(day_of_year, "t", |i| format!("2023:366:{}", face(i))).contains("this cannot be read: t: 2023:366")
    );
    // Beyond 2262-04-11 there are no nanoseconds since 1970 in 64 bits.
    assert!(
        unbound(day_of_year, "t", |i| format!("2262:200:{}", face(i))).contains("this cannot be read: t: 2262:200")
    );
    for (year, day) in [(2023, 366), (2262, 200)] {
        let time = format!("{day_of_year}, year = {year}");
        let why = unbound(&time, "t", |i| format!("{day}:{}", face(i)));
        assert!(why.contains(&format!("this cannot be read: t: {day}")), "{why}");
    }
}

#[test]
fn a_digit_date_without_its_leading_zero_follows_the_order_of_the_map() {
    let face = |i: i64| clock_face(OF_DAY + STEP * i).concat();
    for (order, date, days) in
        // 2024-05-10 is the day of the other tests; the 2062021 of a spreadsheet would be the 21st day of 2062 as well.
        [
            ("month-day-year", "5102024", 0),
            ("day-month-year", "2062021", -1073),
            ("day-month-year", "9052024", -1),
        ]
    {
        let time = format!("date = \"d\", time = \"t\", order = \"{order}\", zone = \"Z\"");
        let loaded = load_by(&time, "d;t", (0..ROWS).map(|i| format!("{date};{}", face(i))));
        assert_eq!(stamps(&loaded), (Clock::Unix, truth(BEGIN + days * DAY)), "{date}");
    }
    // Without an order it is the year and its day; with an impossible order it is not a date.
    let plain = "date = \"d\", time = \"t\", zone = \"Z\"";
    let loaded = load_by(plain, "d;t", (0..ROWS).map(|i| format!("2024131;{}", face(i))));
    assert_eq!(stamps(&loaded), (Clock::Unix, truth(BEGIN)));
    let why = unbound(&format!("{plain}, order = \"day-month-year\""), "d;t", |i| format!("1902021;{}", face(i)));
    assert!(why.contains("no timestamps"), "{why}");
}

#[test]
fn one_wrong_cell_in_a_hundred_does_not_cost_the_other_times_of_day() {
    let row = |i: i64| if i == 70 { "999999.9".to_owned() } else { clock_face(OF_DAY + STEP * i).concat() };
    let loaded = load_by("field = \"t\", text = \"time-of-day\"", "t", (0..ROWS).map(row));
    let mut expected = truth(OF_DAY);
    expected.remove(70);
    assert_eq!(stamps(&loaded), (Clock::Elapsed, expected));
    // Two are too many: then it may not be such a column at all.
    let why = unbound("field = \"t\", text = \"time-of-day\"", "t", |i| {
        if i % 60 == 10 { "999999.9".to_owned() } else { clock_face(OF_DAY + STEP * i).concat() }
    });
    assert!(why.contains("cannot be read") || why.contains("no timestamps"), "{why}");
}

#[test]
fn a_second_source_never_filled_in_replaces_no_row() {
    let time = "field = \"t\", unit = \"s\", clock = \"unix\" }, { field = \"u\", unit = \"s\", clock = \"unix\"";
    let load = |second: fn(i64) -> i64| {
        load_by(
            time,
            "t;u",
            (0..ROWS).map(move |i| {
                let now = BEGIN / S + i;
                if i % 3 == 2 { format!(";{}", second(now)) } else { format!("{now};") }
            }),
        )
    };
    let all: Vec<i64> = (0..ROWS).map(|i| (BEGIN / S + i) * S).collect();
    assert_eq!(stamps(&load(|now| now)).1, all);
    let own: Vec<i64> = (0..ROWS).filter(|i| i % 3 != 2).map(|i| (BEGIN / S + i) * S).collect();
    assert_eq!(stamps(&load(|_| 1_700_000_000)).1, own);
}
