//! The track as MCAP: fixes that ROS 2 tools and Foxglove display.

use super::{LINES, Place, Track};
use crate::error::ConvertError;
use mcap::records::{MessageHeader, Metadata};
use mcap::{Compression, McapError, McapResult, WriteOptions, Writer};
use serde_json::json;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

/// `sensor_msgs/msg/NavSatFix` with the types it depends on, concatenated as in ROS 2.
const NAV_SAT_FIX: &str = "std_msgs/Header header
NavSatStatus status
float64 latitude
float64 longitude
float64 altitude
float64[9] position_covariance
uint8 position_covariance_type
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: sensor_msgs/NavSatStatus
int8 status
uint16 service
";

/// Fields of `foxglove.LocationFix` as a JSON schema.
fn location_fix() -> String {
    let number = json!({ "type": "number" });
    let time = json!({ "type": "object", "title": "time", "properties": {
        "sec": { "type": "integer", "minimum": 0 }, "nsec": { "type": "integer", "minimum": 0, "maximum": 999_999_999 } } });
    let properties = json!({
        "timestamp": time, "frame_id": { "type": "string" }, "latitude": number, "longitude": number, "altitude": number,
        "position_covariance": { "type": "array", "items": number, "minItems": 9, "maxItems": 9 },
        "position_covariance_type": { "type": "integer" },
    });
    json!({ "title": "foxglove.LocationFix", "type": "object", "properties": properties }).to_string()
}

/// Topics `/raw/fix`, `/raw/location`, `/compensated/fix` and `/compensated/location`. Log times are UTC; if that is
/// unknown, seconds since the start of the track.
pub(super) fn write(track: &Track, out: &Path, file: File) -> Result<(), ConvertError> {
    let failed = |e: McapError| ConvertError::write(out, "write")(std::io::Error::other(e));
    let options = WriteOptions::new().library("flightlag").profile("ros2").compression(Some(Compression::Zstd));
    let mut writer = options.create(BufWriter::new(file)).map_err(failed)?;
    write_lines(track, &mut writer).map_err(failed)?;
    let about = BTreeMap::from([("flight".to_owned(), track.name.clone()), ("track".to_owned(), track.about.clone())]);
    writer.write_metadata(&Metadata { name: "flightlag-track".to_owned(), metadata: about }).map_err(failed)?;
    writer.finish().map(drop).map_err(failed)
}

fn write_lines(track: &Track, writer: &mut Writer<BufWriter<File>>) -> McapResult<()> {
    let fix = writer.add_schema("sensor_msgs/msg/NavSatFix", "ros2msg", NAV_SAT_FIX.as_bytes())?;
    let location = writer.add_schema("foxglove.LocationFix", "jsonschema", location_fix().as_bytes())?;
    let none = BTreeMap::new();
    let mut channels = vec![];
    for (name, ..) in LINES {
        let fixes = writer.add_channel(fix, &format!("/{name}/fix"), "cdr", &none)?;
        let places = writer.add_channel(location, &format!("/{name}/location"), "json", &none)?;
        channels.push((name, fixes, places));
    }
    let start = track.instants.first().map_or(0.0, |i| i.t_s);
    for (sequence, instant) in (0_u32..).zip(&track.instants) {
        let ns = instant.utc_ns.unwrap_or_else(|| ((instant.t_s - start) * 1e9).round() as i64);
        let Ok(log_time) = u64::try_from(ns) else { continue };
        for (line, (name, fixes, places)) in channels.iter().enumerate() {
            let Some(place) = instant.places[line] else { continue };
            let header = |channel_id| MessageHeader { channel_id, sequence, log_time, publish_time: log_time };
            writer.write_to_known_channel(&header(*fixes), &cdr(ns, name, place))?;
            writer.write_to_known_channel(&header(*places), &json_fix(ns, name, place))?;
        }
    }
    Ok(())
}

/// The message as plain CDR, little-endian: numbers are aligned to their size, counted from the end of the four-byte
/// encapsulation header.
fn cdr(ns: i64, frame: &str, place: Place) -> Vec<u8> {
    let mut body: Vec<u8> = vec![];
    let align = |body: &mut Vec<u8>, to: usize| body.resize(body.len().next_multiple_of(to), 0);
    body.extend((ns.div_euclid(1_000_000_000) as i32).to_le_bytes());
    body.extend((ns.rem_euclid(1_000_000_000) as u32).to_le_bytes());
    body.extend((frame.len() as u32 + 1).to_le_bytes());
    body.extend(frame.as_bytes());
    body.push(0);
    // Status: a fix; service: not stated.
    body.push(0);
    align(&mut body, 2);
    body.extend(0_u16.to_le_bytes());
    align(&mut body, 8);
    for value in [place.latitude_deg, place.longitude_deg, place.height_m] {
        body.extend(value.to_le_bytes());
    }
    // Covariance: unknown.
    body.extend([0; 72]);
    body.push(0);
    [&[0, 1, 0, 0], body.as_slice()].concat()
}

fn json_fix(ns: i64, frame: &str, place: Place) -> Vec<u8> {
    let time = json!({ "sec": ns.div_euclid(1_000_000_000), "nsec": ns.rem_euclid(1_000_000_000) });
    let Place { latitude_deg, longitude_deg, height_m } = place;
    let fix = json!({
        "timestamp": time, "frame_id": frame, "latitude": latitude_deg, "longitude": longitude_deg, "altitude": height_m,
        "position_covariance": [0, 0, 0, 0, 0, 0, 0, 0, 0], "position_covariance_type": 0,
    });
    fix.to_string().into_bytes()
}
