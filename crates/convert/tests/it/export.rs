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
