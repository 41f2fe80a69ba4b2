//! Our readers of MAVLink, UBX and NMEA against the kept crates for them: the same bytes, the same values.
//!
//! Payloads and sentences are pseudo-random, so that every bit of every field that both know is compared.

use crate::stream::*;
use crate::wire::ubx_frame;
use ingest::{Column, Log};
use mavlink::dialects::dynamic::{
    DynamicDialect, DynamicField, DynamicMessage, DynamicMessageDefinition, DynamicValue,
};
use mavlink::error::{EncoderError, ParserError};
use mavlink::{Dialect, MAVLinkV1MessageRaw, MAVLinkV2MessageRaw, MavHeader, MavlinkReader, MavlinkVersion};
use nmea::ParseResult;
use serde_json::Value as Json;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Command;
use ublox::UbxPacket;
use ublox::proto23::{PacketRef, Proto23};

/// Numbers that are the same in every run (SplitMix64, Steele et al. 2014).
struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    fn below(&mut self, end: u64) -> u64 {
        self.bits() % end
    }

    fn bytes(&mut self, count: usize) -> Vec<u8> {
        (0..count).map(|_| self.bits() as u8).collect()
    }
}

// MAVLink.

/// Noon of 2026-11-21, µs of UTC.
const NOON_US: u64 = 1_795_262_400_000_000;

/// The definitions of all dialects that come with the crate, located through cargo.
fn dialect() -> DynamicDialect {
    let system = if cfg!(target_os = "macos") { "apple-darwin" } else { "unknown-linux-gnu" };
    let metadata = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version=1", "--offline", "--locked", "--filter-platform"])
        .arg(format!("{}-{system}", std::env::consts::ARCH))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert!(metadata.status.success(), "{}", text(&metadata.stderr));
    let metadata: Json = serde_json::from_slice(&metadata.stdout).unwrap();
    let packages = metadata["packages"].as_array().unwrap();
    let manifest = packages.iter().find(|p| p["name"] == "mavlink").unwrap()["manifest_path"].as_str().unwrap();
    let definitions = Path::new(manifest).with_file_name("mavlink/message_definitions/v1.0/all.xml");
    DynamicDialect::from_xml_file(definitions).unwrap()
}

/// A value of a field.
#[derive(Debug)]
enum Value {
    Whole(i128),
    Real(f64),
    Text(String),
}

impl Value {
    /// An element of a field as encoded in a payload.
    fn of(primitive: &str, bytes: &[u8]) -> Value {
        let mut eight = [0; 8];
        eight[..bytes.len()].copy_from_slice(bytes);
        let bits = u64::from_le_bytes(eight);
        match primitive {
            "int8_t" => Value::Whole((bits as i8).into()),
            "int16_t" => Value::Whole((bits as i16).into()),
            "int32_t" => Value::Whole((bits as i32).into()),
            "int64_t" => Value::Whole((bits as i64).into()),
            "float" => Value::Real(f32::from_bits(bits as u32).into()),
            "double" => Value::Real(f64::from_bits(bits)),
            _ => Value::Whole(bits.into()),
        }
    }

    /// Whether this row of a column has the value.
    fn is_at(&self, column: &Column, row: usize) -> bool {
        match self {
            Value::Whole(whole) => {
                let found = column.integer(row).map(i128::from).or(column.unsigned(row).map(i128::from));
                found == Some(*whole)
            }
            Value::Real(real) => column
                .number(row)
                .is_some_and(|found| found.to_bits() == real.to_bits() || found.is_nan() && real.is_nan()),
            Value::Text(text) => column.text(row) == Some(text),
        }
    }
}

fn element_size(field: &DynamicField) -> usize {
    match field.primitive_type() {
        "char" | "int8_t" | "uint8_t" => 1,
        "int16_t" | "uint16_t" => 2,
        "int32_t" | "uint32_t" | "float" => 4,
        _ => 8,
    }
}

/// The name of a field in the definitions; `type` is a Rust keyword.
fn name_of(field: &DynamicField) -> &str {
    if field.name() == "mavtype" { "type" } else { field.name() }
}

/// The values of a field according to the crate, with our column names.
fn values_of(message: &DynamicMessage, field: &DynamicField) -> Vec<(String, Value)> {
    let (name, bytes) = (name_of(field), message.field_bytes(field.name()).unwrap());
    if field.primitive_type() == "char" {
        let text = bytes.split(|b| *b == 0).next().unwrap();
        return vec![(name.to_owned(), Value::Text(String::from_utf8_lossy(text).into_owned()))];
    }
    let values = bytes.chunks(element_size(field)).map(|element| Value::of(field.primitive_type(), element));
    let path = |i| if bytes.len() > element_size(field) { format!("{name}[{i}]") } else { name.to_owned() };
    values.enumerate().map(|(i, value)| (path(i), value)).collect()
}

/// A message whose fields have any value that the crate allows: an enumeration takes only what it knows.
fn message_by_name(
    dialect: &DynamicDialect,
    version: MavlinkVersion,
    definition: &DynamicMessageDefinition,
    random: &mut Random,
) -> DynamicMessage {
    let write = |fields: Vec<(String, DynamicValue)>| dialect.message_from_fields(version, definition.name(), fields);
    let fields = definition.fields().iter().map(|field| {
        let element = |random: &mut Random| match field.primitive_type() {
            "uint16_t" => DynamicValue::U16(random.bits() as u16),
            "uint32_t" => DynamicValue::U32(random.bits() as u32),
            "uint64_t" => DynamicValue::U64(random.bits()),
            "int8_t" => DynamicValue::I8(random.bits() as i8),
            "int16_t" => DynamicValue::I16(random.bits() as i16),
            "int32_t" => DynamicValue::I32(random.bits() as i32),
            "int64_t" => DynamicValue::I64(random.bits() as i64),
            "float" => DynamicValue::F32(f32::from_bits(random.bits() as u32)),
            "double" => DynamicValue::F64(f64::from_bits(random.bits())),
            _ => DynamicValue::U8(random.bits() as u8),
        };
        let count = field.encoded_size() / element_size(field);
        let value = match (field.primitive_type(), count) {
            (_, 1) => element(random),
            ("char", _) => DynamicValue::String(
                (0..random.below(count as u64)).map(|_| (b'A' + random.below(26) as u8) as char).collect(),
            ),
            _ => DynamicValue::Array((0..count).map(|_| element(random)).collect()),
        };
        (field.name().to_owned(), value)
    });
    let allowed = fields.filter(|field| write(vec![field.clone()]).is_ok()).collect();
    write(allowed).unwrap()
}

/// The crate's frame of a message, after a timestamp; every third frame of MAVLink 2 is signed.
fn tlog_record<D: Dialect>(dialect: &D, version: MavlinkVersion, message: &D::Message, count: usize) -> Vec<u8> {
    let header = MavHeader { sequence: count as u8, system_id: 1, component_id: 1 };
    let frame = match version {
        MavlinkVersion::V1 => {
            let mut frame = MAVLinkV1MessageRaw::new();
            frame.serialize_message_with_dialect(header, dialect, message).unwrap();
            frame.raw_bytes().to_vec()
        }
        MavlinkVersion::V2 => {
            let mut frame = MAVLinkV2MessageRaw::new();
            if count.is_multiple_of(3) {
                frame.serialize_message_with_dialect_for_signing(header, dialect, message).unwrap();
                let mut signature = [0; 6];
                frame.calculate_signature(&[7; 32], &mut signature);
                frame.signature_value_mut().copy_from_slice(&signature);
            } else {
                frame.serialize_message_with_dialect(header, dialect, message).unwrap();
            }
            frame.raw_bytes().to_vec()
        }
    };
    [&(NOON_US + 100 * count as u64).to_be_bytes()[..], &frame].concat()
}

fn read_tlog(bytes: &[u8]) -> Log {
    read_bytes(ingest::LogKind::Tlog, bytes).unwrap()
}

/// Every message in both versions of the protocol: from named values, from any bits, and from fewer bytes, as MAVLink 2
/// does not send trailing zeros.
fn messages_of(dialect: &DynamicDialect, random: &mut Random) -> Vec<DynamicMessage> {
    let mut all = vec![];
    for definition in dialect.message_definitions() {
        for version in [MavlinkVersion::V1, MavlinkVersion::V2] {
            let [shortest, longest] = match version {
                MavlinkVersion::V1 if definition.id() > 255 => continue,
                MavlinkVersion::V1 => [definition.base_payload_len(); 2],
                MavlinkVersion::V2 => [1, definition.encoded_size()],
            };
            all.push(message_by_name(dialect, version, definition, random));
            for length in [longest, shortest + random.below((longest + 1 - shortest) as u64) as usize] {
                let payload = random.bytes(length);
                all.push(dialect.message_from_payload(version, definition.id(), payload).unwrap());
            }
        }
    }
    all
}

#[test]
fn every_mavlink_message_agrees_with_the_mavlink_crate() {
    let dialect = dialect();
    let sent = messages_of(&dialect, &mut Random(1));
    let bytes: Vec<u8> = sent.iter().enumerate().flat_map(|(i, m)| tlog_record(&dialect, m.version(), m, i)).collect();
    let mut reader = MavlinkReader::new(&bytes[..]);
    let read = std::iter::from_fn(|| reader.read_any_message_with_dialect(&dialect).ok());
    let read: Vec<DynamicMessage> = read.map(|(_, message)| message).collect();
    let log = read_tlog(&bytes);
    assert_eq!((log.health.messages, log.health.bytes.damaged, log.health.undecodable), (sent.len() as u64, 0, 0));
    assert_eq!(read.len(), sent.len());

    let (mut rows, mut compared) = (BTreeMap::<&str, usize>::new(), 0);
    for message in &read {
        let definition = message.definition();
        let table = log.tables.iter().find(|t| t.topic.name == definition.name());
        let table = table.unwrap_or_else(|| panic!("{} is not in the table of messages", definition.name()));
        let row = rows.entry(definition.name()).or_default();
        let mut columns = table.columns.len();
        for field in definition.fields() {
            let absent = message.version() == MavlinkVersion::V1 && field.is_extension();
            for (path, value) in values_of(message, field) {
                let column = table.column(&path).unwrap_or_else(|| panic!("{}.{path}", definition.name()));
                let agree =
                    if absent { column.valid.as_ref().is_some_and(|v| !v[*row]) } else { value.is_at(column, *row) };
                assert!(agree, "{}.{path}, row {row}: {value:?}", definition.name());
                (compared, columns) = (compared + 1, columns - 1);
            }
        }
        // `use_flags` of GPS_INPUT is derived from its `ignore_flags`.
        let derived = usize::from(definition.name() == "GPS_INPUT");
        assert_eq!(columns, derived, "{} has columns that the crate does not know", definition.name());
        *row += 1;
    }
    assert!(compared > 30_000, "{compared}");
}

/// Bytes changed, removed and inserted, a hundred of each.
fn damage(bytes: &mut Vec<u8>, random: &mut Random) {
    for _ in 0..100 {
        let mut place = || random.below(bytes.len() as u64 - 40) as usize;
        let [changed, cut, put] = [place(), place(), place()];
        bytes[changed] = random.bits() as u8;
        bytes.drain(cut..cut + random.below(40) as usize);
        let more = random.below(40) as usize;
        bytes.splice(put..put, random.bytes(more));
    }
}

/// Recognizes heartbeats in a frame.
struct Heartbeats;

impl Dialect for Heartbeats {
    type Message = Vec<u8>;
    type EncodeError = EncoderError;

    fn message_id(&self, _message: &Vec<u8>) -> u32 {
        0
    }

    fn extra_crc(&self, message_id: u32) -> Option<u8> {
        (message_id == 0).then_some(50)
    }

    fn decode(&self, _version: MavlinkVersion, _message_id: u32, payload: &[u8]) -> Result<Vec<u8>, ParserError> {
        Ok(payload.to_vec())
    }

    fn encode(&self, _: MavlinkVersion, message: &Vec<u8>, payload: &mut [u8]) -> Result<usize, EncoderError> {
        payload[..message.len()].copy_from_slice(message);
        Ok(message.len())
    }
}

#[test]
fn we_find_what_the_mavlink_crate_finds_in_a_damaged_log() {
    let mut random = Random(2);
    let record = |i: u32| {
        let heartbeat = [&i.to_le_bytes()[..], &[2, 3, 0, 4, 3]].concat();
        // Unsigned: no checksum covers a signature.
        tlog_record(&Heartbeats, MavlinkVersion::V2, &heartbeat, 3 * i as usize + 1)
    };
    let mut bytes: Vec<u8> = (0..3000).flat_map(record).collect();
    damage(&mut bytes, &mut random);
    let mut reader = MavlinkReader::new(&bytes[..]);
    let found = std::iter::from_fn(|| reader.read_any_message_with_dialect(&Heartbeats).ok());
    let theirs: BTreeSet<u32> = found.map(|(_, m)| u32::from_le_bytes(*m.first_chunk().unwrap())).collect();
    let ours = numbers_of(&read_tlog(&bytes), "HEARTBEAT", "custom_mode");
    let missing: Vec<&u32> = theirs.difference(&ours).collect();
    assert!(missing.iter().all(|i| memchr::memmem::find(&bytes, &record(**i)).is_none()), "{missing:?}");
    assert!((2500..3000).contains(&theirs.len()) && missing.len() < 50, "{} {missing:?}", theirs.len());
}

/// The values of an integer field that identifies the message.
fn numbers_of(log: &Log, topic: &str, field: &str) -> BTreeSet<u32> {
    numbers(log, topic, field).into_iter().map(|number| number as u32).collect()
}

// UBX.

/// The values of a packet of the crate with our names, unscaled.
fn values_of_packet(packet: &UbxPacket<'_>) -> Vec<(&'static str, f64)> {
    macro_rules! fields {
        ($packet:ident: $($name:literal $get:ident),*) => { vec![$(($name, f64::from($packet.$get()))),*] };
    }
    let UbxPacket::Proto23(packet) = packet;
    match packet {
        PacketRef::NavPosLlh(p) => fields!(p: "iTOW" itow, "lon" lon_degrees_raw, "lat" lat_degrees_raw,
            "height" height_meters_raw, "hMSL" height_msl_raw, "hAcc" h_ack_raw, "vAcc" v_acc_raw),
        PacketRef::NavStatus(p) => fields!(p: "iTOW" itow, "gpsFix" fix_type_raw, "flags" flags_raw,
            "fixStat" fix_stat_raw, "flags2" flags2_raw, "ttff" time_to_first_fix, "msss" uptime_ms),
        PacketRef::NavDop(p) => fields!(p: "iTOW" itow, "gDOP" geometric_dop_raw, "pDOP" position_dop_raw,
            "tDOP" time_dop_raw, "vDOP" vertical_dop_raw, "hDOP" horizontal_dop_raw, "nDOP" northing_dop_raw,
            "eDOP" easting_dop_raw),
        PacketRef::NavAtt(p) => fields!(p: "iTOW" itow, "version" version, "roll" vehicle_roll_raw,
            "pitch" vehicle_pitch_raw, "heading" vehicle_heading_raw, "accRoll" vehicle_roll_accuracy_raw,
            "accPitch" vehicle_pitch_accuracy_raw, "accHeading" vehicle_heading_accuracy_raw),
        PacketRef::NavSol(p) => fields!(p: "iTOW" itow, "fTOW" ftow_ns, "week" week, "gpsFix" fix_type_raw,
            "flags" flags_raw, "ecefX" ecef_x_raw, "ecefY" ecef_y_raw, "ecefZ" ecef_z_raw,
            "pAcc" position_accuracy_estimate_raw, "ecefVX" ecef_vx_raw, "ecefVY" ecef_vy_raw, "ecefVZ" ecef_vz_raw,
            "sAcc" speed_accuracy_estimate_raw, "pDOP" pdop_raw, "numSV" num_sv),
        PacketRef::NavPvt(p) => fields!(p: "iTOW" itow, "year" year, "month" month, "day" day, "hour" hour, "min" min,
            "sec" sec, "valid" valid_raw, "tAcc" time_accuracy, "nano" nanosec, "fixType" fix_type_raw,
            "flags" flags_raw, "flags2" flags2_raw, "numSV" num_satellites, "lon" longitude_raw, "lat" latitude_raw,
            "height" height_above_ellipsoid_raw, "hMSL" height_msl_raw, "hAcc" horizontal_accuracy_raw,
            "vAcc" vertical_accuracy_raw, "velN" vel_north_raw, "velE" vel_east_raw, "velD" vel_down_raw,
            "gSpeed" ground_speed_2d_raw, "headMot" heading_motion_raw, "sAcc" speed_accuracy_raw,
            "headAcc" heading_accuracy_raw, "pDOP" pdop_raw),
        PacketRef::NavVelNed(p) => fields!(p: "iTOW" itow, "velN" vel_north_raw, "velE" vel_east_raw,
            "velD" vel_down_raw, "speed" speed_3d_raw, "gSpeed" ground_speed_raw, "heading" heading_degrees_raw,
            "sAcc" speed_accuracy_estimate_raw, "cAcc" course_heading_accuracy_estimate_raw),
        PacketRef::NavHpPosLlh(p) => fields!(p: "version" version, "flags" flags_raw, "iTOW" itow,
            "lon" lon_degrees_raw, "lat" lat_degrees_raw, "height" height_meters_raw, "hMSL" height_msl_raw,
            "lonHp" lon_hp_degrees_raw, "latHp" lat_hp_degrees_raw, "heightHp" height_hp_meters_raw,
            "hMSLHp" height_hp_msl_raw, "hAcc" horizontal_accuracy_raw, "vAcc" vertical_accuracy_raw),
        PacketRef::NavTimeGps(p) => fields!(p: "iTOW" itow, "fTOW" ftow, "week" week, "leapS" leap_s,
            "valid" valid_raw, "tAcc" t_acc),
        PacketRef::NavTimeUTC(p) => fields!(p: "iTOW" itow, "tAcc" time_accuracy_estimate_ns, "nano" nanos,
            "year" year, "month" month, "day" day, "hour" hour, "min" min, "sec" sec, "valid" valid_raw),
        PacketRef::TimTp(p) => fields!(p: "towMS" tow_ms, "towSubMS" tow_sub_ms, "qErr" q_err, "week" week,
            "flags" flags_raw, "refInfo" ref_info_raw),
        PacketRef::TimTm2(p) => fields!(p: "ch" ch, "flags" flags_raw, "count" count, "wnR" wn_r, "wnF" wn_f,
            "towMsR" tow_ms_r, "towSubMsR" tow_sub_ms_r, "towMsF" tow_ms_f, "towSubMsF" tow_sub_ms_f, "accEst" acc_est),
        PacketRef::HnrPvt(p) => fields!(p: "iTOW" itow, "year" year, "month" month, "day" day, "hour" hour, "min" min,
            "sec" sec, "valid" valid_raw, "nano" nanosec, "gpsFix" fix_type_raw, "flags" flags_raw,
            "lon" longitude_raw, "lat" latitude_raw, "height" height_above_ellipsoid_raw, "hMSL" height_msl_raw,
            "gSpeed" ground_speed_2d_raw, "speed" speed_3d_raw, "headMot" heading_motion_raw,
            "headVeh" heading_vehicle_raw, "hAcc" horizontal_accuracy_raw, "vAcc" vertical_accuracy_raw,
            "sAcc" speed_accuracy_raw, "headAcc" heading_accuracy_raw),
        PacketRef::HnrAtt(p) => fields!(p: "iTOW" itow, "version" version, "roll" vehicle_roll_raw,
            "pitch" vehicle_pitch_raw, "heading" vehicle_heading_raw, "accRoll" vehicle_roll_accuracy_raw,
            "accPitch" vehicle_pitch_accuracy_raw, "accHeading" vehicle_heading_accuracy_raw),
        PacketRef::HnrIns(p) => fields!(p: "flags" bitfield_raw, "iTOW" itow, "xAngRate" x_angular_rate_raw,
            "yAngRate" y_angular_rate_raw, "zAngRate" z_angular_rate_raw, "xAccel" x_acceleration_raw,
            "yAccel" y_acceleration_raw, "zAccel" z_acceleration_raw),
        other => panic!("{other:?}"),
    }
}

/// Class, number, name and bytes of the payload.
const UBX: [(u8, u8, &str, usize); 15] = [
    (0x01, 0x02, "NAV-POSLLH", 28),
    (0x01, 0x03, "NAV-STATUS", 16),
    (0x01, 0x04, "NAV-DOP", 18),
    (0x01, 0x05, "NAV-ATT", 32),
    (0x01, 0x06, "NAV-SOL", 52),
    (0x01, 0x07, "NAV-PVT", 92),
    (0x01, 0x12, "NAV-VELNED", 36),
    (0x01, 0x14, "NAV-HPPOSLLH", 36),
    (0x01, 0x20, "NAV-TIMEGPS", 16),
    (0x01, 0x21, "NAV-TIMEUTC", 20),
    (0x0d, 0x01, "TIM-TP", 16),
    (0x0d, 0x03, "TIM-TM2", 28),
    (0x28, 0x00, "HNR-PVT", 72),
    (0x28, 0x01, "HNR-ATT", 32),
    (0x28, 0x02, "HNR-INS", 36),
];
fn read_ubx(bytes: &[u8]) -> Log {
    read_bytes(ingest::LogKind::Ubx, bytes).unwrap()
}

/// Columns that our reader puts before the fields of a message.
const DERIVED: [&str; 10] = [
    "gps_week",
    "gps_tow_ms",
    "fix_ok",
    "carrier",
    "latitude",
    "longitude",
    "ellipsoid_height",
    "at_x",
    "at_y",
    "at_z",
];

#[test]
fn every_ubx_message_that_we_read_agrees_with_the_ublox_crate() {
    const ROWS: usize = 20;
    let mut random = Random(3);
    let frames = UBX.map(|(class, number, name, length)| {
        let frame = || ubx_frame(class, number, &random.bytes(length));
        (name, std::iter::repeat_with(frame).take(ROWS).collect::<Vec<_>>())
    });
    let bytes: Vec<u8> = frames.iter().flat_map(|(_, frames)| frames.concat()).collect();
    let log = read_ubx(&bytes);
    assert_eq!((log.health.messages, log.health.bytes.decoded), ((UBX.len() * ROWS) as u64, bytes.len() as u64));
    let mut parser = ublox::ParserBuilder::new().with_protocol::<Proto23>().with_vec_buffer();
    for (name, frames) in &frames {
        for (row, frame) in frames.iter().enumerate() {
            let mut packets = parser.consume_ubx(frame);
            let values = values_of_packet(&packets.next().unwrap().unwrap());
            let ours = table(&log, name).columns.iter().filter(|column| !DERIVED.contains(&column.path.as_str()));
            let ours: BTreeMap<&str, f64> =
                ours.map(|column| (&column.path[..], column.number(row).unwrap())).collect();
            assert_eq!(ours, values.into_iter().collect(), "{name}");
        }
    }
}

#[test]
fn we_find_what_the_ublox_crate_finds_in_a_damaged_log() {
    let mut random = Random(6);
    let position = |i: u32| ubx_frame(0x01, 0x02, &[&i.to_le_bytes()[..], &[1; 24]].concat());
    let mut bytes: Vec<u8> = (0..3000).flat_map(position).collect();
    damage(&mut bytes, &mut random);
    let mut parser = ublox::ParserBuilder::new().with_protocol::<Proto23>().with_vec_buffer();
    let (mut packets, mut theirs) = (parser.consume_ubx(&bytes), BTreeSet::new());
    while let Some(packet) = packets.next() {
        if let Ok(UbxPacket::Proto23(PacketRef::NavPosLlh(position))) = packet {
            theirs.insert(position.itow());
        }
    }
    let ours = numbers_of(&read_ubx(&bytes), "NAV-POSLLH", "iTOW");
    assert!(theirs.is_subset(&ours), "{:?}", theirs.difference(&ours));
    assert!((2500..3000).contains(&theirs.len()), "{}", theirs.len());
}

// NMEA.

const DAY_NS: i64 = 86_400_000_000_000;

/// Sentences of all types that both read, with their checksums.
fn sentences(count: usize, random: &mut Random) -> Vec<Vec<u8>> {
    let mut digits = |below: u64, whole: usize, decimals: usize| {
        let (number, fraction) = (random.below(below), random.below(10_u64.pow(decimals as u32)));
        let point = if decimals == 0 { String::new() } else { format!(".{fraction:0decimals$}") };
        format!("{number:0whole$}{point}")
    };
    let sentence = |i: usize| {
        let time = format!("{}{}{}", digits(24, 2, 0), digits(60, 2, 0), digits(60, 2, i % 10));
        let [day, month, year] =
            [28, 12, 80].map(|below| digits(below, 2, 0)).map(|d| if d == "00" { "28".into() } else { d });
        let month = if month == "28" { "12" } else { &month };
        let decimals = 4 + i % 5;
        let latitude = format!("{}{},{}", digits(90, 2, 0), digits(60, 2, decimals), ["N", "S"][i / 8 % 2]);
        let longitude = format!("{}{},{}", digits(180, 3, 0), digits(60, 2, decimals), ["E", "W"][i / 16 % 2]);
        let place = format!("{latitude},{longitude}");
        let [speed, track, dop, other, high] = [300, 360, 20, 60, 4000].map(|below| digits(below, 1, 1 + i / 8 % 3));
        let (quality, satellites, valid) = (i / 8 % 9, i % 30, ["A", "V"][i / 8 % 2]);
        let body = match i % 8 {
            0 => format!("GNGGA,{time},{place},{quality},{satellites},{dop},{high},M,-{other},M,,"),
            1 => format!("GNRMC,{time},A,{place},{speed},{track},{day}{month}{year},,,A"),
            2 => format!("GNVTG,{track},T,,M,{speed},N,,K,A"),
            3 => format!("GNGLL,{place},{time},{valid},A"),
            4 => format!("GNZDA,{time},{day},{month},20{year},00,00"),
            5 => format!("GNHDT,{track},T"),
            6 => format!("GNGNS,{time},{place},AA,{satellites},{dop},{high},-{other},,,V"),
            _ => format!("GNGST,{time},{other},{dop},{dop},{track},{dop},{speed},{other}"),
        };
        format!("${body}*{:02X}", body.bytes().fold(0, |sum, byte| sum ^ byte)).into_bytes()
    };
    (0..count).map(sentence).collect()
}

/// The time of a sentence, ns.
enum Time {
    Unsaid,
    OfDay(i64),
    Utc(i64),
}

/// Topic, time and values of a sentence as the crate reads it; all but angles of position it rounds to single precision.
fn values_of_sentence(parsed: &ParseResult) -> (&'static str, Time, Vec<(&'static str, Option<f64>)>) {
    let of = |value: Option<f32>| value.map(f64::from);
    macro_rules! of_day {
        ($time:expr) => {
            Time::OfDay($time.unwrap().signed_duration_since(Default::default()).num_nanoseconds().unwrap())
        };
    }
    macro_rules! utc {
        ($moment:expr) => {
            Time::Utc($moment.and_utc().timestamp_nanos_opt().unwrap())
        };
    }
    match parsed {
        ParseResult::GGA(d) => (
            "GNGGA",
            of_day!(d.fix_time),
            vec![
                ("latitude", d.latitude),
                ("longitude", d.longitude),
                ("quality", d.fix_type.map(|fix| f64::from(fix as u8))),
                ("satellites", d.fix_satellites.map(f64::from)),
                ("hdop", of(d.hdop)),
                ("altitude", of(d.altitude)),
                ("separation", of(d.geoid_separation)),
            ],
        ),
        ParseResult::RMC(d) => (
            "GNRMC",
            utc!(d.fix_date.unwrap().and_time(d.fix_time.unwrap())),
            vec![
                ("latitude", d.lat),
                ("longitude", d.lon),
                ("speed", of(d.speed_over_ground)),
                ("track", of(d.true_course)),
            ],
        ),
        ParseResult::VTG(d) => {
            ("GNVTG", Time::Unsaid, vec![("track", of(d.true_course)), ("speed", of(d.speed_over_ground))])
        }
        ParseResult::GLL(d) => (
            "GNGLL",
            of_day!(d.fix_time),
            vec![("latitude", d.latitude), ("longitude", d.longitude), ("valid", Some(f64::from(u8::from(d.valid))))],
        ),
        ParseResult::ZDA(d) => (
            "GNZDA",
            utc!(d.utc_date_time().unwrap()),
            vec![("day", d.day.map(f64::from)), ("month", d.month.map(f64::from)), ("year", d.year.map(f64::from))],
        ),
        ParseResult::HDT(d) => ("GNHDT", Time::Unsaid, vec![("heading", of(d.heading))]),
        ParseResult::GNS(d) => (
            "GNGNS",
            of_day!(d.fix_time),
            vec![
                ("latitude", d.lat),
                ("longitude", d.lon),
                ("satellites", Some(d.nsattelites.into())),
                ("hdop", of(d.hdop)),
                ("altitude", of(d.alt)),
                ("separation", of(d.geoid_separation)),
            ],
        ),
        ParseResult::GST(d) => (
            "GNGST",
            of_day!(d.time),
            vec![("latitude_std", of(d.lat_sd)), ("longitude_std", of(d.long_sd)), ("altitude_std", of(d.alt_sd))],
        ),
        other => panic!("{other:?}"),
    }
}

fn read_nmea(lines: &[Vec<u8>]) -> Log {
    read_bytes(ingest::LogKind::Nmea, &lines.join(&b"\r\n"[..])).unwrap()
}

#[test]
fn every_sentence_that_both_read_agrees_with_the_nmea_crate() {
    let lines = sentences(800, &mut Random(4));
    let log = read_nmea(&lines);
    assert_eq!((log.health.messages, log.health.bytes.damaged), (lines.len() as u64, 0));
    let mut rows = BTreeMap::<&str, usize>::new();
    for line in &lines {
        let (topic, time, values) = values_of_sentence(&nmea::parse_bytes(line).unwrap());
        let (table, row) = (table(&log, topic), rows.entry(topic).or_default());
        let line = String::from_utf8_lossy(line);
        let utc_ns = || table.column("utc_ns").unwrap().integer(*row).unwrap();
        match time {
            Time::Unsaid => {}
            Time::OfDay(ns) => assert_eq!(utc_ns().rem_euclid(DAY_NS), ns, "{line}"),
            Time::Utc(ns) => assert_eq!(utc_ns(), ns, "{line}"),
        }
        for (field, theirs) in values {
            let ours = table.column(field).unwrap().number(*row);
            let precision = if ["latitude", "longitude"].contains(&field) { f64::EPSILON } else { f32::EPSILON.into() };
            let agree = ours.zip(theirs).is_some_and(|(ours, theirs)| (ours - theirs).abs() <= precision * ours.abs());
            assert!(agree, "{line}: {field} is {ours:?} and {theirs:?}");
        }
        *row += 1;
    }
    assert_eq!(rows.len(), 8);
}

#[test]
fn we_miss_a_flipped_bit_only_if_the_nmea_crate_misses_it() {
    let flip = |line: &Vec<u8>| -> Vec<Vec<u8>> {
        let flipped = |bit: usize| {
            let mut bytes = line.clone();
            bytes[bit / 8] ^= 1 << (bit % 8);
            bytes
        };
        (0..8 * line.len()).map(flipped).collect()
    };
    let damaged: Vec<Vec<u8>> = sentences(16, &mut Random(5)).iter().flat_map(flip).collect();
    let theirs: Vec<&[u8]> = damaged.iter().map(Vec::as_slice).filter(|line| nmea::parse_bytes(line).is_ok()).collect();
    // Digits of a checksum may be lower case.
    assert!(!theirs.is_empty() && theirs.iter().all(|line| line.last().is_some_and(u8::is_ascii_lowercase)));
    assert_eq!(read_nmea(&damaged).health.messages, theirs.len() as u64);
}
