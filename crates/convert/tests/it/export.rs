//! Exported tables contain what the log contains.

use crate::flight::{in_context, library, read, unit, write};
use convert::{Cells, ExportOrder, ExportTo, ExportWhat, Exported, export, read_parquet};
use flight::{Channel, Clock, Quantity, Severity, Stamp};
use simulate::{Container, McapSettings};
use std::fs::File;
use std::path::Path;

fn exported(log: &Path, what: ExportWhat, to: ExportTo, out: &Path) -> Exported {
    let (unit, library) = (unit(log), library());
    let order = ExportOrder { unit: &unit, library, map: None, what, to, out, command: "flightlag export" };
    in_context(|context| export(&order, context)).unwrap()
}

fn mcap(folder: &Path) -> std::path::PathBuf {
    write(Container::Mcap(McapSettings::default()), folder)
}

#[test]
fn parquet_holds_the_channels_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let log = mcap(folder.path());
    let out = folder.path().join("tables");
    let report = exported(&log, ExportWhat::Channels, ExportTo::Parquet, &out);
    let channels = read(&log).flight.channels;
    assert_eq!(report.sheets.len(), channels.len());
    for sheet in &report.sheets {
        let channel: &Channel = &channels[&sheet.name];
        let table = read_parquet(File::open(out.join(&sheet.place)).unwrap()).unwrap().sheet;
        let timeline = channel.series.timeline();
        let stamps: Vec<Option<i64>> = timeline.stamps().iter().map(|s| Some(s.0)).collect();
        assert_eq!(table.cells(&format!("{}_ns", timeline.kind())), Some(&Cells::I64(stamps.into())));
        if channel.quantity == Quantity::VelocityNed {
            let north: Vec<Option<f64>> = channel.series.component(0).iter().copied().map(Some).collect();
            assert_eq!(table.cells("north_mps"), Some(&Cells::F64(north.into())));
        }
    }
}

#[test]
fn csv_holds_the_same_rows_with_positions_in_degrees() {
    let folder = tempfile::tempdir().unwrap();
    let log = mcap(folder.path());
    let out = folder.path().join("tables");
    exported(&log, ExportWhat::Channels, ExportTo::Csv, &out);
    let channel = read(&log).flight.channels["position.gps"].clone();
    let mut reader = csv::Reader::from_path(out.join("position.gps.csv")).unwrap();
    let headers = reader.headers().unwrap().clone();
    let latitude = headers.iter().position(|h| h == "latitude_deg").unwrap();
    let rows: Vec<f64> = reader.records().map(|r| r.unwrap()[latitude].parse().unwrap()).collect();
    let degrees: Vec<f64> = channel.series.component(0).iter().map(|x| x.to_degrees()).collect();
    assert_eq!(rows.len(), degrees.len());
    assert!(rows.iter().zip(&degrees).all(|(a, b)| (a - b).abs() < 1e-13), "{rows:?}");
}

/// Positions are written in degrees, so they return to within a rounding error.
#[test]
fn exported_csv_is_read_again_with_its_own_map() {
    let folder = tempfile::tempdir().unwrap();
    let log = mcap(folder.path());
    let out = folder.path().join("tables");
    exported(&log, ExportWhat::Channels, ExportTo::Csv, &out);
    let library = ingest::MapLibrary::shipped().unwrap().with_folder(&out).unwrap();
    let units = ingest::discover(&out, &library).unwrap().units;
    assert_eq!(units.len(), 1, "{units:?}");
    let again = in_context(|context| ingest::load(&units[0], &library, None, context)).unwrap();
    assert_eq!(again.binding.unwrap().map, "exported");
    let channels = read(&log).flight.channels;
    assert_eq!(again.flight.channels.keys().collect::<Vec<_>>(), channels.keys().collect::<Vec<_>>());
    for (name, channel) in &channels {
        let found = &again.flight.channels[name];
        assert_eq!(found.series.timeline(), channel.series.timeline(), "{name}");
        assert_eq!((&found.present, &found.other_stamps), (&channel.present, &channel.other_stamps), "{name}");
        for (found, logged) in found.series.components().iter().zip(channel.series.components()) {
            assert!(found.iter().zip(logged).all(|(a, b)| (a - b).abs() <= 1e-15 * b.abs()), "{name}");
        }
    }
}

#[test]
fn the_provenance_names_the_log_the_map_and_every_table() {
    let folder = tempfile::tempdir().unwrap();
    let log = mcap(folder.path());
    let out = folder.path().join("tables");
    let report = exported(&log, ExportWhat::Channels, ExportTo::Csv, &out);
    let text = std::fs::read_to_string(out.join("provenance.json")).unwrap();
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    let hash = blake3::hash(&std::fs::read(&log).unwrap());
    assert_eq!(json["inputs"][0]["blake3"], hash.to_hex().as_str());
    assert_eq!(json["map"]["name"], "flightlag-demo");
    assert_eq!(json["sheets"].as_array().unwrap().len(), report.sheets.len());
    for sheet in &report.sheets {
        assert!(out.join(&sheet.place).exists());
    }
}

#[test]
fn an_exported_mcap_holds_every_topic_with_its_values() {
    let folder = tempfile::tempdir().unwrap();
    let log = mcap(folder.path());
    let out = folder.path().join("out.mcap");
    let report = exported(&log, ExportWhat::Topics, ExportTo::Mcap, &out);
    let all = |path: &Path| {
        let unit = unit(path);
        in_context(|c| ingest::read(&unit, &|_: &ingest::TopicInfo| ingest::Selection::All, c)).unwrap()
    };
    let (before, after) = (all(&log), all(&out));
    assert_eq!(report.sheets.len(), before.tables.len());
    assert!(after.health.extras.iter().any(|e| e.contains("flightlag-export")), "{:?}", after.health.extras);
    for table in &before.tables {
        let twin = after.tables.iter().find(|t| t.topic.name == table.topic.name).unwrap();
        assert_eq!((twin.rows, &twin.logged_ns), (table.rows, &table.logged_ns));
        for column in &table.columns {
            let name: String = column.path.replace(['.', '[', ']'], "_").trim_matches('_').replace("__", "_");
            let other = twin.column(&name).unwrap_or_else(|| panic!("{name}"));
            for row in 0..table.rows {
                assert_eq!(column.number(row).map(f64::to_bits), other.number(row).map(f64::to_bits), "{name}");
                assert_eq!(column.text(row), other.text(row), "{name}");
            }
        }
    }
}

/// Topic names that lead outside the folder, start a formula, collide as file names, or are not valid file names.
fn hostile_names() -> Vec<String> {
    let long = "x".repeat(300);
    let names = [
        "..",
        ".",
        "/",
        "//",
        "../../outside",
        "/etc/passwd",
        "~/x",
        "C:\\x",
        "file:///x",
        "a\0b",
        "a\nb",
        "a/b",
        "a-b",
        "A/B",
        "CON",
        "nul.txt",
        "com1",
        "/GPS",
        "/gps",
        "=cmd|' /C calc'!A0",
        "+1",
        "-rf",
        "@x",
        "\tx",
        "＝1",
        ".hidden",
        "trailing.",
        "provenance.json",
        "höhe",
        "\u{202e}gpj",
        "a-b~2",
    ];
    let of_length = [format!("{long}1"), format!("{long}2")];
    names.into_iter().map(str::to_owned).chain(of_length).collect()
}

/// One JSON message per topic: its number, a text that starts a formula, and a field with the name of a timestamp.
fn hostile_log(path: &Path, names: &[String]) {
    let mut writer = mcap::Writer::new(File::create(path).unwrap()).unwrap();
    for (number, name) in names.iter().enumerate() {
        let channel = writer.add_channel(0, name, "json", &Default::default()).unwrap();
        let header = mcap::records::MessageHeader { channel_id: channel, sequence: 0, log_time: 5, publish_time: 6 };
        let text = serde_json::json!({ "n": number, "x": -1.5, "=text": "=1+1", "logged_ns": 7, "-a,\"b": "＋1\r\n" });
        writer.write_to_known_channel(&header, text.to_string().as_bytes()).unwrap();
    }
    writer.finish().unwrap();
}

/// All files below a folder.
fn files(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap());
    let mut names: Vec<String> = entries
        .map(|e| {
            assert!(e.file_type().unwrap().is_file(), "{e:?}");
            e.file_name().into_string().unwrap()
        })
        .collect();
    names.sort();
    names
}

#[test]
fn hostile_topic_names_stay_in_the_folder_and_overwrite_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let names = hostile_names();
    let log = folder.path().join("log.mcap");
    hostile_log(&log, &names);
    for to in [ExportTo::Csv, ExportTo::Parquet] {
        let out = folder.path().join(format!("{to:?}"));
        let report = exported(&log, ExportWhat::Topics, to, &out);
        assert_eq!(report.sheets.len(), names.len());
        let written = files(&out);
        assert_eq!(written.len(), names.len() + 1, "{written:?}");
        let lower: std::collections::BTreeSet<String> = written.iter().map(|w| w.to_lowercase()).collect();
        assert_eq!(lower.len(), written.len(), "names that differ only in case: {written:?}");
        for name in &written {
            assert!(
                name.len() < 150 && !name.starts_with(['.', '-', '=']) && !name.contains(['/', '\\', '\0']),
                "{name}"
            );
            let stem = name.split('.').next().unwrap().to_lowercase();
            assert!(!["con", "nul", "com1"].contains(&stem.as_str()), "{name}");
        }
    }
    // Nothing next to the log and the two folders.
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 3);
    let csv = folder.path().join("Csv");
    let report = exported(&log, ExportWhat::Topics, ExportTo::Csv, &csv);
    for sheet in &report.sheets {
        let mut reader = csv::Reader::from_path(csv.join(&sheet.place)).unwrap();
        let headers: Vec<String> = reader.headers().unwrap().iter().map(str::to_owned).collect();
        let row = reader.records().next().unwrap().unwrap();
        let cell =
            |header: &str| &row[headers.iter().position(|h| h == header).unwrap_or_else(|| panic!("{headers:?}"))];
        let number = names.iter().position(|name| *name == sheet.name).unwrap();
        assert_eq!(cell("n").parse::<f64>().unwrap(), number as f64);
        assert_eq!((cell("x"), cell("'=text"), cell("'-a,\"b")), ("-1.5", "'=1+1", "'＋1\r\n"));
        assert_eq!((cell("logged_ns"), cell("logged_ns~2").parse::<f64>().unwrap()), ("5", 7.0));
    }
}

#[test]
fn hostile_names_are_read_back_from_an_exported_mcap() {
    let folder = tempfile::tempdir().unwrap();
    let names = hostile_names();
    let (log, out) = (folder.path().join("log.mcap"), folder.path().join("out.mcap"));
    hostile_log(&log, &names);
    exported(&log, ExportWhat::Topics, ExportTo::Mcap, &out);
    let unit = unit(&out);
    let again = in_context(|c| ingest::read(&unit, &|_: &ingest::TopicInfo| ingest::Selection::All, c)).unwrap();
    let mut found: Vec<&str> = again.tables.iter().map(|t| t.topic.name.as_str()).collect();
    let mut expected: Vec<&str> = names.iter().map(String::as_str).collect();
    found.sort_unstable();
    expected.sort_unstable();
    assert_eq!(found, expected);
    let table = again.tables.iter().find(|t| t.topic.name == "..").unwrap();
    let text = table.columns.iter().find_map(|c| c.text(0).filter(|t| t.starts_with('='))).unwrap();
    assert_eq!(text, "=1+1");
}

#[test]
fn an_export_replaces_an_earlier_one_and_leaves_other_files_alone() {
    let folder = tempfile::tempdir().unwrap();
    let log = mcap(folder.path());
    let out = folder.path().join("tables");
    let earlier = exported(&log, ExportWhat::Topics, ExportTo::Csv, &out);
    std::fs::write(out.join("mine.csv"), "x\n").unwrap();
    let precious = folder.path().join("precious.csv");
    std::fs::write(&precious, "x\n").unwrap();
    // A tampered provenance removes nothing elsewhere.
    let provenance = out.join("provenance.json");
    let mut json: serde_json::Value = serde_json::from_slice(&std::fs::read(&provenance).unwrap()).unwrap();
    for place in ["../precious.csv", precious.to_str().unwrap(), "..", ".csv", "mine.txt"] {
        json["sheets"].as_array_mut().unwrap().push(serde_json::json!({ "place": place }));
    }
    std::fs::write(&provenance, json.to_string()).unwrap();
    let report = exported(&log, ExportWhat::Channels, ExportTo::Parquet, &out);
    let mut expected: Vec<String> = report.sheets.iter().map(|s| s.place.clone()).collect();
    expected.extend(["mine.csv".to_owned(), "provenance.json".to_owned()]);
    expected.sort();
    assert_eq!(files(&out), expected);
    assert!(precious.exists() && !earlier.sheets.is_empty());
}

/// A column of a CSV, as its cells.
fn csv_column(path: &Path, name: &str) -> Vec<String> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let headers = reader.headers().unwrap().clone();
    let at = headers.iter().position(|h| h == name).unwrap_or_else(|| panic!("{name} is not in {headers:?}"));
    reader.records().map(|row| row.unwrap()[at].to_owned()).collect()
}

fn numbers(cells: &[String]) -> Vec<i64> {
    cells.iter().map(|cell| cell.parse().unwrap()).collect()
}

fn provenance(folder: &Path) -> serde_json::Value {
    serde_json::from_slice(&std::fs::read(folder.join("provenance.json")).unwrap()).unwrap()
}

/// The tables of an MCAP.
fn tables(path: &Path) -> Vec<ingest::Table> {
    let unit = unit(path);
    in_context(|c| ingest::read(&unit, &|_: &ingest::TopicInfo| ingest::Selection::All, c)).unwrap().tables
}

#[test]
fn a_clock_without_a_date_gets_a_utc_column_and_its_tie_is_recorded() {
    for container in [Container::DataFlash, Container::Ubx] {
        let folder = tempfile::tempdir().unwrap();
        let log = write(container, folder.path());
        let flight = read(&log).flight;
        let out = folder.path().join("tables");
        let report = exported(&log, ExportWhat::Channels, ExportTo::Csv, &out);
        for sheet in &report.sheets {
            let timeline = flight.channels[&sheet.name].series.timeline().clone();
            assert!(matches!(timeline.clock(), Clock::Boot | Clock::Gps), "{container:?}");
            let own = numbers(&csv_column(&out.join(&sheet.place), &format!("{}_ns", timeline.kind())));
            assert_eq!(own, timeline.stamps().iter().map(|s| s.0).collect::<Vec<_>>());
            let utc = numbers(&csv_column(&out.join(&sheet.place), "utc_ns"));
            let unix = |s: &Stamp| flight.unix(timeline.clock(), *s).unwrap().0;
            assert_eq!(utc, timeline.stamps().iter().map(unix).collect::<Vec<_>>(), "{}", sheet.name);
        }
        let provenance = provenance(&out);
        match &flight.utc {
            Some(tie) => {
                assert_eq!(provenance["utc"]["offset_ns"], tie.offset_ns);
                assert_eq!(provenance["utc"]["source"], tie.source.as_str());
                assert_eq!(provenance["utc"]["uncertainty_s"], tie.spread_s.p99 - tie.spread_s.p01);
            }
            None => assert!(
                provenance["sheets"][0]["from"]["utc"].as_str().unwrap().contains("leap seconds"),
                "{provenance}"
            ),
        }
        // An MCAP uses it as the log time, and says so.
        let file = folder.path().join("out.mcap");
        exported(&log, ExportWhat::Channels, ExportTo::Mcap, &file);
        for table in tables(&file) {
            let timeline = flight.channels[&table.topic.name].series.timeline();
            let unix = |s: &Stamp| flight.unix(timeline.clock(), *s).unwrap().0;
            assert_eq!(table.logged_ns.unwrap(), timeline.stamps().iter().map(unix).collect::<Vec<_>>());
        }
        let bytes = std::fs::read(&file).unwrap();
        let channels = mcap::Summary::read(&bytes).unwrap().unwrap().channels;
        assert!(channels.values().all(|c| c.metadata["log_time"].starts_with("UTC: ")), "{channels:?}");
        // Parquet has it in its metadata.
        let out = folder.path().join("parquet");
        let report = exported(&log, ExportWhat::Channels, ExportTo::Parquet, &out);
        let table = read_parquet(File::open(out.join(&report.sheets[0].place)).unwrap()).unwrap();
        let provenance: serde_json::Value = serde_json::from_str(&table.about["flightlag-export"]).unwrap();
        assert_eq!(provenance["utc"]["offset_ns"].as_i64(), flight.utc.as_ref().map(|tie| tie.offset_ns));
        assert_eq!(provenance["sheet"]["place"], report.sheets[0].place.as_str());
    }
}

#[test]
fn equal_seconds_in_two_tables_are_the_same_instant() {
    let folder = tempfile::tempdir().unwrap();
    // The receiver has a velocity before it has a position.
    let row = |k: u32| {
        let place = if k < 7 { ",,".to_owned() } else { format!("37.6{k:05},126.86{k:05},{}", 100 + k) };
        format!("2024-01-01T10:00:{:02}.{}Z,{place},{k}.5,-{k}.25,0.0\n", k / 10, k % 10)
    };
    let log = folder.path().join("table.csv");
    let head = "time,lat,lon,hMSL,velN,velE,velD\n,(deg),(deg),(m),(m/s),(m/s),(m/s)\n".to_owned();
    std::fs::write(&log, (0..200).fold(head, |text, k| text + &row(k))).unwrap();
    let flight = read(&log).flight;
    let out = folder.path().join("tables");
    let report = exported(&log, ExportWhat::Channels, ExportTo::Csv, &out);
    let firsts: Vec<i64> = flight.channels.values().map(|c| c.series.timeline().first().unwrap().0).collect();
    let zero = *firsts.iter().min().unwrap();
    assert!(firsts.iter().any(|first| *first != zero), "channels with the same start prove nothing: {firsts:?}");
    for sheet in &report.sheets {
        let timeline = flight.channels[&sheet.name].series.timeline();
        let seconds = csv_column(&out.join(&sheet.place), "t_s");
        for (cell, stamp) in seconds.iter().zip(timeline.stamps()) {
            assert_eq!(cell.parse::<f64>().unwrap(), stamp.seconds_since(Stamp(zero)), "{}", sheet.name);
        }
    }
    let provenance = provenance(&out);
    for sheet in provenance["sheets"].as_array().unwrap() {
        let columns = sheet["columns"].as_array().unwrap();
        let column = columns.iter().find(|column| column["name"] == "t_s").unwrap();
        assert_eq!((&column["zero_ns"], &column["clock"]), (&zero.into(), &"unix".into()), "{column}");
    }
}

#[test]
fn topic_rows_use_the_time_in_their_fields_also_as_log_time() {
    for container in [Container::Ubx, Container::Nmea, Container::CsvWide, Container::Ulog, Container::DataFlash] {
        let folder = tempfile::tempdir().unwrap();
        let log = write(container, folder.path());
        let flight = read(&log).flight;
        let (topic, truth): (String, Vec<i64>) = {
            let channel = flight.channels.iter().find(|(name, _)| name.starts_with("position.")).unwrap().1;
            let timeline = channel.series.timeline();
            let unix = |s: &Stamp| flight.unix(timeline.clock(), *s).unwrap().0;
            (channel.source.topic.clone(), timeline.stamps().iter().map(unix).collect())
        };
        let out = folder.path().join("out.mcap");
        exported(&log, ExportWhat::Topics, ExportTo::Mcap, &out);
        let table = tables(&out).into_iter().find(|t| t.topic.name == topic).unwrap();
        let logged = table.logged_ns.unwrap();
        // The log timestamps of a ULog are those of the driver, some hundred milliseconds after the measurement.
        let off =
            logged.first().unwrap().abs_diff(truth[0]).max(logged.last().unwrap().abs_diff(truth[truth.len() - 1]));
        assert!(off < 1_000_000_000, "{container:?}: {off} ns");
        let out = folder.path().join("tables");
        let report = exported(&log, ExportWhat::Topics, ExportTo::Csv, &out);
        let place = &report.sheets.iter().find(|s| s.name == topic).unwrap().place;
        let utc = numbers(&csv_column(&out.join(place), "utc_ns"));
        assert_eq!(utc, logged, "{container:?}");
    }
}

/// A NAV-PVT frame with a 3D fix, a tenth of a second after the previous one.
fn nav_pvt(number: u32) -> Vec<u8> {
    let mut payload = [0; 92];
    let mut put = |at: usize, bytes: &[u8]| payload[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &(295_218_000 + 100 * number).to_le_bytes());
    // 2026-05-06 10:00:00 UTC, valid; 3D fix and OK; satellites; positions, accuracies, velocities.
    put(4, &2026_u16.to_le_bytes());
    put(6, &[5, 6, 10, 0, (number / 10) as u8, 3]);
    put(20, &[3, 1]);
    put(23, &[14]);
    put(24, &(-1_270_000_000 + number as i32).to_le_bytes());
    put(28, &(471_234_567 + number as i32).to_le_bytes());
    put(40, &(1500 + number).to_le_bytes());
    put(48, &(10_000 + 7 * number).to_le_bytes());
    let frame = [&[1, 7, 92, 0][..], &payload].concat();
    let (a, b) = frame.iter().fold((0_u8, 0_u8), |(a, b), byte| {
        let a = a.wrapping_add(*byte);
        (a, b.wrapping_add(a))
    });
    [&[0xb5, 0x62][..], &frame, &[a, b]].concat()
}

#[test]
fn a_scalar_name_ends_in_its_unit_and_provenance_has_both_units() {
    let folder = tempfile::tempdir().unwrap();
    let (log, out) = (folder.path().join("log.ubx"), folder.path().join("tables"));
    std::fs::write(&log, (0..20).flat_map(nav_pvt).collect::<Vec<u8>>()).unwrap();
    exported(&log, ExportWhat::Channels, ExportTo::Csv, &out);
    let values = csv_column(&out.join("horizontal-accuracy.gps.csv"), "value_m");
    assert_eq!(values[..2], ["1.5", "1.501"]);
    // Nor does a position logged with few digits gain any.
    assert_eq!(csv_column(&out.join("position.gps.csv"), "longitude_deg")[0], "-127.0");
    let provenance = provenance(&out);
    let sheets = provenance["sheets"].as_array().unwrap();
    let column = |sheet: &str, column: &str| {
        let sheet = sheets.iter().find(|s| s["name"] == sheet).unwrap();
        sheet["columns"].as_array().unwrap().iter().find(|c| c["name"] == column).cloned().unwrap()
    };
    let accuracy = column("horizontal-accuracy.gps", "value_m");
    assert_eq!((&accuracy["unit"], &accuracy["as_logged"]), (&"m".into(), &"hAcc [mm]".into()));
    assert_eq!(column("velocity.gps", "north_mps")["unit"], "m/s");
    assert_eq!(column("satellites.gps", "value")["unit"], "1");
}

#[test]
fn unconverted_topics_have_the_units_stated_in_the_log() {
    let format = |id: u8, length: u8, name: &[u8], codes: &[u8], names: &[u8]| {
        let padded = |text: &[u8], width: usize| [text, &vec![0; width - text.len()]].concat();
        let texts = [padded(name, 4), padded(codes, 16), padded(names, 64)].concat();
        [&[0xa3, 0x95, 128, id, length][..], &texts].concat()
    };
    let padded = |text: &[u8], width: usize| [text, &vec![0; width - text.len()]].concat();
    let unit = |id: u8, name: &[u8]| [&[0xa3, 0x95, 2][..], &[0; 8], &[id], &padded(name, 64)].concat();
    let multiplier = |id: u8, by: f64| [&[0xa3, 0x95, 3][..], &[0; 8], &[id], &by.to_le_bytes()].concat();
    let fields = [&[0xa3, 0x95, 4][..], &[0; 8], &[7], &padded(b"sAmd-", 16), &padded(b"F?B?-", 16)].concat();
    let head = [
        format(128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns"),
        format(2, 76, b"UNIT", b"QbZ", b"TimeUS,Id,Label"),
        format(3, 20, b"MULT", b"Qbd", b"TimeUS,Id,Mult"),
        format(4, 44, b"FMTU", b"QBNN", b"TimeUS,FmtType,UnitIds,MultIds"),
        format(7, 27, b"TST", b"Qhfff", b"TimeUS,Cur,Dst,Ang,Raw"),
        [unit(b's', b"s"), unit(b'A', b"A"), unit(b'm', b"m"), unit(b'd', b"deg")].concat(),
        [multiplier(b'F', 1e-6), multiplier(b'B', 1e-2), multiplier(b'?', 1.0)].concat(),
        fields,
    ];
    let row = |i: u64| [&[0xa3, 0x95, 7][..], &(i * 10_000).to_le_bytes(), &[5, 0], &[0; 12]].concat();
    let folder = tempfile::tempdir().unwrap();
    let (log, out) = (folder.path().join("log.bin"), folder.path().join("tables"));
    std::fs::write(&log, [head.concat(), (0..20).flat_map(row).collect()].concat()).unwrap();
    exported(&log, ExportWhat::Topics, ExportTo::Csv, &out);
    let provenance = provenance(&out);
    let sheet = provenance["sheets"].as_array().unwrap().iter().find(|s| s["name"] == "TST").unwrap();
    let unit_of = |name: &str| {
        let column = sheet["columns"].as_array().unwrap().iter().find(|c| c["name"] == name).unwrap();
        column["unit"].clone()
    };
    let expected = [("TimeUS", "1.000e-6 s"), ("Cur", "A"), ("Dst", "1.000e-2 m"), ("Ang", "deg")];
    for (name, unit) in expected {
        assert_eq!(unit_of(name), unit, "{provenance:#}");
    }
    assert!(unit_of("Raw").is_null());
}

#[test]
fn integers_of_the_log_stay_integers_in_csv() {
    let folder = tempfile::tempdir().unwrap();
    let log = write(Container::Ubx, folder.path());
    let out = folder.path().join("tables");
    exported(&log, ExportWhat::Topics, ExportTo::Csv, &out);
    for name in ["iTOW", "lon", "hAcc"] {
        let cells = csv_column(&out.join("NAV-POSLLH.csv"), name);
        assert!(!cells.is_empty() && cells.iter().all(|cell| cell.parse::<i64>().is_ok()), "{name}: {cells:?}");
    }
    // A column with a fraction has one throughout.
    let log = folder.path().join("t.csv");
    std::fs::write(&log, "time_s,a,b,c\n0.5,1,-127,-0.0\n1.5,2.25,3e9,1\n2.5,3,,2\n").unwrap();
    let out = folder.path().join("t");
    exported(&log, ExportWhat::Topics, ExportTo::Csv, &out);
    assert_eq!(csv_column(&out.join("t.csv"), "a"), ["1.0", "2.25", "3.0"]);
    assert_eq!(csv_column(&out.join("t.csv"), "b"), ["-127", "3000000000", ""]);
    assert_eq!(csv_column(&out.join("t.csv"), "c"), ["-0.0", "1.0", "2.0"]);
}

/// A variable-length scan, an array of structures, texts, and a hundred numbers; and a topic without messages.
fn log_of_arrays(path: &Path) {
    let text =
        "float64 x\nfloat32[] ranges\np/Point[] points\nstring[] names\nuint8[100] long\n===\nMSG: p/Point\nfloat64 x";
    let mut writer = mcap::Writer::new(File::create(path).unwrap()).unwrap();
    let schema = writer.add_schema("p/msg/Scan", "ros1msg", text.as_bytes()).unwrap();
    let channel = writer.add_channel(schema, "/scan", "ros1", &Default::default()).unwrap();
    let point = writer.add_schema("p/msg/Point", "ros1msg", b"float64 x").unwrap();
    writer.add_channel(point, "/empty", "ros1", &Default::default()).unwrap();
    let counts = [0_u32.to_le_bytes(); 3].concat();
    for log_time in [5, 6] {
        let payload = [&1.5_f64.to_le_bytes()[..], &counts, &[7; 100]].concat();
        let header =
            mcap::records::MessageHeader { channel_id: channel, sequence: 0, log_time, publish_time: log_time };
        writer.write_to_known_channel(&header, &payload).unwrap();
    }
    writer.finish().unwrap();
}

#[test]
fn fields_without_a_column_and_empty_topics_are_reported_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let (log, out) = (folder.path().join("log.mcap"), folder.path().join("tables"));
    log_of_arrays(&log);
    let report = exported(&log, ExportWhat::Topics, ExportTo::Csv, &out);
    let left_out: Vec<_> = report.notices.iter().filter(|n| n.code == "not-written").collect();
    assert_eq!(left_out.len(), 1, "{:?}", report.notices);
    assert_eq!(
        (left_out[0].severity, left_out[0].count, left_out[0].place.as_str()),
        (Severity::Warning, 4, "topic /scan")
    );
    assert!(left_out[0].text.ends_with("long[64..100], names[], points[], ranges[]"), "{}", left_out[0].text);
    let provenance = provenance(&out)["notices"].to_string();
    assert!(
        provenance.contains("ranges[]") && provenance.contains("without messages have no table: /empty"),
        "{provenance}"
    );
    // The header has the remaining fields.
    assert_eq!(report.sheets[0].columns, 2 + 1 + 64);
}

/// Exports until the first table is written, then stops.
fn stopped(log: &Path, out: &Path) -> convert::ConvertError {
    let (unit, library) = (unit(log), library());
    let cancel = std::sync::atomic::AtomicBool::new(false);
    let any_table = || {
        // Files being written are next to their final path, with a lock file.
        let is_begun = |e: std::fs::DirEntry| {
            let is_temporary = e.file_name().to_string_lossy().ends_with("flightlag-tmp");
            is_temporary && std::fs::read_dir(e.path()).is_ok_and(|inside| inside.count() > 1)
        };
        std::fs::read_dir(out.parent().unwrap()).is_ok_and(|entries| entries.flatten().any(is_begun))
    };
    let on_bytes = |_| cancel.store(any_table(), std::sync::atomic::Ordering::Relaxed);
    let context = ingest::ReadContext { limits: Default::default(), cancel: &cancel, on_bytes: &on_bytes };
    let order = ExportOrder {
        unit: &unit,
        library,
        map: None,
        what: ExportWhat::Topics,
        to: ExportTo::Csv,
        out,
        command: "flightlag export",
    };
    export(&order, &context).unwrap_err()
}

#[test]
fn an_aborted_export_leaves_nothing_and_keeps_the_earlier_one() {
    let folder = tempfile::tempdir().unwrap();
    let log = mcap(folder.path());
    let out = folder.path().join("tables");
    assert!(matches!(
        stopped(&log, &out),
        convert::ConvertError::Log(ingest::IngestError::Log(ingest::LogError::Read(ingest::ScanError::Cancelled)))
    ));
    assert!(!out.exists());
    exported(&log, ExportWhat::Channels, ExportTo::Csv, &out);
    let held = || files(&out).into_iter().map(|name| std::fs::read(out.join(name)).unwrap()).collect::<Vec<_>>();
    let (names, before) = (files(&out), held());
    stopped(&log, &out);
    assert_eq!((files(&out), held()), (names, before));
}

#[test]
fn a_stop_request_while_writing_rows_is_honoured_and_cleans_up() {
    use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("log.csv");
    let rows: String = (0..40_000).map(|i| format!("{i},{},{}\n", 47.0 + f64::from(i) * 1e-7, i % 17)).collect();
    std::fs::write(&log, format!("t,lat,x\n{rows}")).unwrap();
    let (unit, library, out) = (unit(&log), library(), folder.path().join("out"));
    let kinds = [Some(ExportTo::Csv), Some(ExportTo::Mcap), Some(ExportTo::Parquet), None];
    for kind in kinds {
        let (cancel, heard) = (AtomicBool::new(false), AtomicU32::new(0));
        // Bytes are read before and after the rows are written: progress is reported in between.
        let on_bytes = |bytes: u64| {
            let written = std::fs::read_dir(folder.path()).unwrap().count() > 1;
            let count = heard.fetch_add(u32::from(written && bytes == 0), Ordering::Relaxed);
            cancel.store(count > 2, Ordering::Relaxed);
        };
        let context = ingest::ReadContext { limits: Default::default(), cancel: &cancel, on_bytes: &on_bytes };
        let stopped = match kind {
            Some(to) => {
                let what = ExportWhat::Topics;
                let order =
                    ExportOrder { unit: &unit, library, map: None, what, to, out: &out, command: "flightlag export" };
                export(&order, &context).map(drop)
            }
            None => convert::recover(&unit, library, &out, &context).map(drop),
        };
        let stopped = stopped.expect_err("heard");
        assert!(
            matches!(
                stopped,
                convert::ConvertError::Log(ingest::IngestError::Log(ingest::LogError::Read(
                    ingest::ScanError::Cancelled
                )))
            ),
            "{kind:?}: {stopped}"
        );
        assert_eq!(files(folder.path()), ["log.csv"], "{kind:?}");
    }
}

#[test]
fn a_log_that_changes_while_being_read_gives_no_tables() {
    let folder = tempfile::tempdir().unwrap();
    for to in [ExportTo::Csv, ExportTo::Mcap] {
        let log = mcap(folder.path());
        let out = folder.path().join("tables");
        let (unit, library) = (unit(&log), library());
        let order = ExportOrder {
            unit: &unit,
            library,
            map: None,
            what: ExportWhat::Channels,
            to,
            out: &out,
            command: "flightlag export",
        };
        let bytes = std::fs::read(&log).unwrap();
        // As a logger that continues, or another log copied to this name.
        let on_bytes = |_| std::fs::write(&log, [bytes.as_slice(), b"more"].concat()).unwrap();
        let cancel = std::sync::atomic::AtomicBool::new(false);
        let context = ingest::ReadContext { limits: ingest::Limits::default(), cancel: &cancel, on_bytes: &on_bytes };
        let error = export(&order, &context).unwrap_err().to_string();
        assert!(error.contains("changed while it was read"), "{error}");
        assert!(!out.exists());
    }
}

/// Names in a folder, hidden ones too.
fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

#[test]
fn new_tables_replace_the_old_ones_atomically() {
    let folder = tempfile::tempdir().unwrap();
    let log = mcap(folder.path());
    let out = folder.path().join("tables");
    exported(&log, ExportWhat::Topics, ExportTo::Csv, &out);
    std::fs::write(out.join("notes.txt"), "mine").unwrap();
    let stop = std::sync::atomic::AtomicBool::new(false);
    std::thread::scope(|scope| {
        // At every moment there is a complete export: its provenance, and every table that it lists.
        let looker = scope.spawn(|| {
            let mut looks = 0;
            while !stop.load(std::sync::atomic::Ordering::Relaxed) || looks == 0 {
                let text = std::fs::read_to_string(out.join("provenance.json")).unwrap();
                let provenance: serde_json::Value = serde_json::from_str(&text).unwrap();
                assert!(!provenance["sheets"].as_array().unwrap().is_empty());
                looks += 1;
            }
        });
        for to in [ExportTo::Parquet, ExportTo::Csv, ExportTo::Parquet] {
            exported(&log, ExportWhat::Channels, to, &out);
        }
        stop.store(true, std::sync::atomic::Ordering::Relaxed);
        looker.join().unwrap();
    });
    let left = names(&out);
    assert!(left.contains(&"notes.txt".to_owned()) && left.contains(&"provenance.json".to_owned()), "{left:?}");
    assert!(left.iter().all(|name| !name.ends_with(".csv")), "{left:?}");
    assert_eq!(names(folder.path()), [log.file_name().unwrap().to_str().unwrap(), "tables"]);
}

#[test]
fn leftovers_of_killed_runs_are_removed_and_foreign_files_restored() {
    let folder = tempfile::tempdir().unwrap();
    let log = mcap(folder.path());
    let out = folder.path().join("tables");
    exported(&log, ExportWhat::Channels, ExportTo::Csv, &out);
    // One process was killed while writing, one after it had replaced the old folder.
    let half = folder.path().join(".tables.1-2-0.flightlag-tmp");
    std::fs::create_dir(&half).unwrap();
    std::fs::write(half.join(".lock"), "").unwrap();
    std::fs::write(half.join("position.gps.csv"), "half").unwrap();
    let old = folder.path().join(".tables.3-4-0.flightlag-tmp");
    std::fs::create_dir(&old).unwrap();
    std::fs::copy(out.join("provenance.json"), old.join("provenance.json")).unwrap();
    std::fs::write(old.join("position.gps.csv"), "old").unwrap();
    std::fs::write(old.join("notes.txt"), "mine").unwrap();
    // Another process is running.
    let live = folder.path().join(".tables.5-6-0.flightlag-tmp");
    std::fs::create_dir(&live).unwrap();
    let lock = File::create(live.join(".lock")).unwrap();
    lock.try_lock().unwrap();
    exported(&log, ExportWhat::Channels, ExportTo::Csv, &out);
    assert!(!half.exists() && !old.exists() && live.exists());
    assert_eq!(std::fs::read_to_string(out.join("notes.txt")).unwrap(), "mine");
    let half = folder.path().join(".other.mcap.1-2-0.flightlag-tmp");
    std::fs::write(&half, "half").unwrap();
    exported(&log, ExportWhat::Channels, ExportTo::Mcap, &folder.path().join("other.mcap"));
    assert!(!half.exists() && folder.path().join("other.mcap").exists());
}

#[test]
fn one_corrupt_cell_is_counted_and_the_column_stays_numeric() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("flight.csv");
    let rows: String = (0..50).map(|i| format!("{i},{},{}\n", if i == 20 { "1.5#" } else { "1.5" }, "word")).collect();
    std::fs::write(&log, format!("time,speed,mode\n{rows}")).unwrap();
    let out = folder.path().join("tables");
    let report = exported(&log, ExportWhat::Topics, ExportTo::Parquet, &out);
    let table = read_parquet(File::open(out.join(&report.sheets[0].place)).unwrap()).unwrap().sheet;
    let speed: Vec<Option<f64>> = (0..50).map(|row| (row != 20).then_some(1.5)).collect();
    assert_eq!(table.cells("speed"), Some(&Cells::F64(speed.into())));
    let Some(Cells::Text(modes)) = table.cells("mode") else { panic!("{table:?}") };
    assert_eq!(modes.iter().nth(20), Some(Some("word")));
    let notice = report.notices.iter().find(|n| n.code == "rejected-cell").unwrap();
    assert_eq!(notice.count, 1);
    assert!(notice.text.contains("speed") && notice.text.contains("1.5#"), "{}", notice.text);
}
