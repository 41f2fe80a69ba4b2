//! The track of a flight in the formats of maps and players.

use convert::{Cells, Sheet, TrackOrder, TrackTo, export_track, write_track_table};
use std::fs::{self, File};
use std::path::Path;

/// 2026-05-04 12:00:00 UTC, ns.
const START_NS: i64 = 1_777_896_000_000_000_000;

/// Ten seconds at 10 Hz, north along the 8° east meridian; raw lags by 1e-4°. No compensated position at first, nor
/// from 5 s to 6 s.
pub fn write(path: &Path, has_utc: bool) {
    let t: Vec<f64> = (0..100).map(|n| f64::from(n) / 10.0).collect();
    let utc = t.iter().map(|t| has_utc.then_some(START_NS + (t * 1e9).round() as i64)).collect();
    let column = |of: &dyn Fn(f64) -> Option<f64>| Cells::F64(t.iter().map(|&t| of(t)).collect());
    let is_known = |t: f64| t >= 0.4 && !(5.0..6.0).contains(&t);
    let mut sheet = Sheet::default();
    sheet.push("utc_ns", Cells::I64(utc));
    sheet.push("t_s", column(&Some));
    sheet.push("height_m", column(&|_| Some(500.0)));
    sheet.push("raw_latitude_deg", column(&|t| Some(47.0 + 1e-3 * t - 1e-4)));
    sheet.push("raw_longitude_deg", column(&|_| Some(8.0)));
    sheet.push("exact_async_latitude_deg", column(&|t| is_known(t).then_some(47.0 + 1e-3 * t)));
    sheet.push("exact_async_longitude_deg", column(&|t| is_known(t).then_some(8.0)));
    write_track_table(&sheet, std::iter::empty(), r#"{"delay_removed_s":0.2}"#, File::create(path).unwrap()).unwrap();
}

fn exported(to: TrackTo, most_hz: Option<f64>, has_utc: bool) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let (track, out) = (folder.path().join("track.parquet"), folder.path().join("out"));
    write(&track, has_utc);
    let written = export_track(&TrackOrder { track: &track, name: "a <b> & c", to, most_hz, out: &out }).unwrap();
    assert_eq!((written.of, written.has_utc), (100, has_utc));
    fs::read(out).unwrap()
}

fn text(to: TrackTo, most_hz: Option<f64>, has_utc: bool) -> String {
    String::from_utf8(exported(to, most_hz, has_utc)).unwrap()
}

#[test]
fn geojson_has_longitude_first_and_splits_lines_at_gaps() {
    let json: serde_json::Value = serde_json::from_str(&text(TrackTo::GeoJson, None, true)).unwrap();
    let [raw, compensated] = [0, 1].map(|n| &json["features"][n]["geometry"]["coordinates"]);
    assert_eq!((raw.as_array().unwrap().len(), compensated.as_array().unwrap().len()), (1, 2));
    assert_eq!(compensated[0][0], serde_json::json!([8.0, 47.0004, 500.0]));
    assert_eq!(compensated[1][0], serde_json::json!([8.0, 47.006, 500.0]));
    let properties = &json["features"][1]["properties"];
    assert_eq!(properties["coordTimes"][1][0], "2026-05-04T12:00:06.000Z");
    assert_eq!(properties["flightlag"]["delay_removed_s"], 0.2);
}

#[test]
fn kml_has_a_time_per_position_or_plain_lines_without_utc() {
    let kml = text(TrackTo::Kml, None, true);
    assert!(kml.contains("<name>a &lt;b&gt; &amp; c</name>"), "{kml}");
    assert_eq!((kml.matches("<when>").count(), kml.matches("<gx:coord>").count()), (100 + 86, 100 + 86));
    assert!(kml.contains("<when>2026-05-04T12:00:00.400Z</when>\n<when>2026-05-04T12:00:00.500Z</when>"));
    assert!(kml.contains("<gx:coord>8.000000000 47.000400000 500.000</gx:coord>"));
    let plain = text(TrackTo::Kml, None, false);
    assert!(!plain.contains("<when>") && plain.matches("<LineString>").count() == 3);
}

#[test]
fn gpx_has_segments_and_the_requested_number_of_points() {
    let gpx = text(TrackTo::Gpx, Some(5.0), true);
    assert_eq!((gpx.matches("<trk>").count(), gpx.matches("<trkseg>").count()), (2, 3));
    // Every second row of 100 raw ones, and of the 86 compensated ones.
    assert_eq!(gpx.matches("<trkpt").count(), 50 + 43);
    assert!(gpx.contains(
        "<trkpt lat=\"47.000400000\" lon=\"8.000000000\"><ele>500.000</ele><time>2026-05-04T12:00:00.400Z</time></trkpt>"
    ));
}

#[test]
fn csv_has_one_row_per_instant() {
    let csv = text(TrackTo::Csv, None, true);
    let mut lines = csv.lines();
    let head =
        "utc_ns,t_s,raw_latitude_deg,raw_longitude_deg,compensated_latitude_deg,compensated_longitude_deg,height_m";
    assert_eq!(lines.next(), Some(head));
    assert_eq!(lines.next(), Some("1777896000000000000,0.0,46.9999,8.0,,,500.0"));
    assert_eq!(lines.count(), 99);
}

#[test]
fn mcap_reads_back_the_written_fixes() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("track.mcap");
    fs::write(&log, exported(TrackTo::Mcap, None, true)).unwrap();
    let bytes = fs::read(&log).unwrap();
    let mut counts = std::collections::BTreeMap::new();
    for message in mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap) {
        *counts.entry(message.channel.topic.clone()).or_insert(0) += 1;
        if message.channel.topic == "/compensated/fix" && message.log_time as i64 == START_NS + 6_000_000_000 {
            // The frame is `compensated`: 12 letters with the zero; the latitude starts 36 bytes after the header.
            let latitude = f64::from_le_bytes(message.data[4 + 32..4 + 40].try_into().unwrap());
            assert_eq!(latitude, 47.006);
        }
    }
    let counts: Vec<_> = counts.iter().map(|(topic, n)| (topic.as_str(), *n)).collect();
    let wanted = [("/compensated/fix", 86), ("/compensated/location", 86), ("/raw/fix", 100), ("/raw/location", 100)];
    assert_eq!(counts, wanted);
}

#[test]
fn a_track_without_positions_and_a_foreign_file_are_rejected() {
    let folder = tempfile::tempdir().unwrap();
    let (track, out) = (folder.path().join("track.parquet"), folder.path().join("out.kml"));
    let order = TrackOrder { track: &track, name: "n", to: TrackTo::Kml, most_hz: None, out: &out };
    fs::write(&track, "no table").unwrap();
    assert!(export_track(&order).unwrap_err().to_string().contains("no track"));
    let mut sheet = Sheet::default();
    sheet.push("t_s", Cells::F64(vec![0.0].into()));
    write_track_table(&sheet, std::iter::empty(), "{}", File::create(&track).unwrap()).unwrap();
    assert!(export_track(&order).unwrap_err().to_string().contains("no column height_m"));
    assert!(!out.exists());
}
