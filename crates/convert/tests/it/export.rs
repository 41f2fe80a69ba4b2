//! Tables hold what the log holds.

use crate::flight::{in_context, library, read, unit, write};
use convert::{ExportOrder, ExportTo, ExportWhat, Exported, export};
use flight::{Channel, Quantity};
use polars::prelude::{ParquetReader, SerReader};
use simulate::{Container, McapSettings};
use std::fs::File;
use std::path::Path;

fn exported(log: &Path, what: ExportWhat, to: ExportTo, out: &Path) -> Exported {
    let (unit, library) = (unit(log), library());
    let order = ExportOrder { unit: &unit, library: &library, map: None, what, to, out, command: "flightlag export" };
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
        let frame = ParquetReader::new(File::open(out.join(&sheet.place)).unwrap()).finish().unwrap();
        assert_eq!(frame.height(), channel.series.len());
        let stamps = frame.column(&format!("{}_ns", channel.series.timeline().kind())).unwrap().clone();
        let stamps: Vec<i64> = stamps.i64().unwrap().to_vec().into_iter().flatten().collect();
        assert_eq!(stamps, channel.series.timeline().stamps().iter().map(|s| s.0).collect::<Vec<_>>());
        if channel.quantity == Quantity::VelocityNed {
            let north = frame.column("north_mps").unwrap().clone();
            let north: Vec<f64> = north.f64().unwrap().to_vec().into_iter().flatten().collect();
            assert_eq!(north, channel.series.component(0));
        }
    }
}

#[test]
fn csv_holds_the_same_rows_and_places_in_degrees() {
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
        in_context(|c| ingest::open(&unit).read(&|_: &ingest::TopicInfo| ingest::Selection::All, c)).unwrap()
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

/// Names of topics that lead elsewhere, begin a formula, are the same once they are file names, or are no file names.
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

/// One JSON message for each topic: its number, a text that begins a formula, and a field named as a stamp.
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
fn hostile_names_of_topics_stay_in_the_folder_and_overwrite_nothing() {
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
        assert_eq!(lower.len(), written.len(), "names that differ in capitals alone: {written:?}");
        for name in &written {
            assert!(
                name.len() < 150 && !name.starts_with(['.', '-', '=']) && !name.contains(['/', '\\', '\0']),
                "{name}"
            );
            let stem = name.split('.').next().unwrap().to_lowercase();
            assert!(!["con", "nul", "com1"].contains(&stem.as_str()), "{name}");
        }
    }
    // Nothing beside the log and the two folders.
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
fn hostile_names_come_back_from_an_exported_mcap() {
    let folder = tempfile::tempdir().unwrap();
    let names = hostile_names();
    let (log, out) = (folder.path().join("log.mcap"), folder.path().join("out.mcap"));
    hostile_log(&log, &names);
    exported(&log, ExportWhat::Topics, ExportTo::Mcap, &out);
    let unit = unit(&out);
    let again = in_context(|c| ingest::open(&unit).read(&|_: &ingest::TopicInfo| ingest::Selection::All, c)).unwrap();
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
fn an_export_takes_the_place_of_an_earlier_one_and_leaves_other_files_alone() {
    let folder = tempfile::tempdir().unwrap();
    let log = mcap(folder.path());
    let out = folder.path().join("tables");
    let earlier = exported(&log, ExportWhat::Topics, ExportTo::Csv, &out);
    std::fs::write(out.join("mine.csv"), "x\n").unwrap();
    let precious = folder.path().join("precious.csv");
    std::fs::write(&precious, "x\n").unwrap();
    // A provenance that somebody has tampered with removes nothing elsewhere.
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
