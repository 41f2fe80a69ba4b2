//! PX4 ULog (<https://docs.px4.io/main/en/dev_log/ulog_file_format.html>): the samples in the corresponding topics,
//! fields and units of PX4.
//!
//! `timestamp` is the arrival at the logger, `timestamp_sample` the message's own timestamp; both count µs since the
//! autopilot was switched on, [`BEFORE_US`] before the second of the first timestamp.

use super::message::{Fields, Message, Value};
use super::{Logbook, Topic};
use flight::Stamp;
use std::collections::BTreeMap;

/// Time from switching on to the second of the first timestamp, µs.
const BEFORE_US: i64 = 10_000_000;
/// Samples between two sync messages.
const SYNC_EVERY: usize = 500;
const SYNC: [u8; 8] = [0x2f, 0x73, 0x13, 0x20, 0x25, 0x0c, 0xbb, 0x12];
/// Value of the delay parameter, ms.
const GPS_DELAY_MS: f32 = 110.0;

pub(super) fn write(log: &Logbook) -> Vec<u8> {
    let zero_us = zero_us(log);
    let outlets: Vec<Option<&Outlet>> = log.topics.iter().map(Outlet::of).collect();
    let mut file = Writer::begin();
    file.definitions(outlets.iter().flatten().copied());
    let numbers = file.subscriptions(outlets.iter().flatten().copied());
    let mut since_sync = 0;
    for message in &log.messages {
        let at_us = micros(message.logged) - zero_us;
        match outlets[message.topic] {
            Some(outlet) => file.message(b'D', &outlet.payload(numbers[outlet.topic], message, at_us, zero_us)),
            None => file.text(at_us, message),
        }
        since_sync += 1;
        if since_sync == SYNC_EVERY {
            since_sync = 0;
            file.message(b'S', &SYNC);
        }
    }
    file.bytes
}

/// Zero of the autopilot's clock, µs since 1970.
fn zero_us(log: &Logbook) -> i64 {
    let stamps = log.messages.iter().flat_map(|m| [Some(m.logged), stamp_of(&m.fields)]).flatten();
    stamps.min().map_or(0, |first| micros(first).div_euclid(1_000_000) * 1_000_000 - BEFORE_US)
}

fn micros(stamp: Stamp) -> i64 {
    stamp.0.div_euclid(1000)
}

fn stamp_of(fields: &Fields) -> Option<Stamp> {
    match fields.first() {
        Some((_, Value::Header(header))) => Some(header.stamp),
        _ => None,
    }
}

/// PX4 topic for the samples of a logbook topic.
struct Outlet {
    /// Definition and last part of the name of the topic in the logbook.
    source: (&'static str, &'static str),
    topic: &'static str,
    /// Fields after `timestamp` and `timestamp_sample`.
    fields: &'static str,
    /// Their bytes, without the trailing padding.
    values: fn(&Fields) -> Vec<u8>,
}

const FIX: &str = "double latitude_deg;double longitude_deg;double altitude_msl_m;double altitude_ellipsoid_m;\
    uint64_t time_utc_usec;float eph;uint8_t fix_type;uint8_t satellites_used;uint8_t[2] _padding0;";
const PLACE: &str = "double lat;double lon;double alt_ellipsoid;bool lat_lon_valid;uint8_t[7] _padding0;";
const VELOCITY: &str = "float vel_n_m_s;float vel_e_m_s;float vel_d_m_s;bool vel_ned_valid;uint8_t fix_type;\
    uint8_t[2] _padding0;";
const LOCAL: &str = "float vx;float vy;float vz;bool v_xy_valid;uint8_t[3] _padding0;";

const OUTLETS: &[Outlet] = &[
    Outlet { source: ("NavSatFix", "/gps/fix"), topic: "sensor_gps", fields: FIX, values: fix },
    Outlet {
        source: ("NavSatFix", "/truth/fix"),
        topic: "vehicle_global_position_groundtruth",
        fields: PLACE,
        values: place,
    },
    Outlet {
        source: ("NavSatFix", "/compensated/fix"),
        topic: "vehicle_global_position",
        fields: PLACE,
        values: place,
    },
    Outlet { source: ("NavSatFix", "/ins/fix"), topic: "vehicle_global_position", fields: PLACE, values: place },
    Outlet { source: ("TwistStamped", "/gps/vel"), topic: "vehicle_gps_position", fields: VELOCITY, values: velocity },
    Outlet { source: ("TwistStamped", "/ins/vel"), topic: "vehicle_local_position", fields: LOCAL, values: local },
    Outlet {
        source: ("QuaternionStamped", "/ins/quaternion"),
        topic: "vehicle_attitude",
        fields: "float[4] q;",
        // A half turn about the forward axis on both sides: forward, left, up to north, west, up.
        values: |fields| {
            let [w, x, y, z] = ["w", "x", "y", "z"].map(|axis| number(fields, &["quaternion", axis]));
            floats(&[w, x, -y, -z])
        },
    },
    Outlet {
        source: ("Vector3Stamped", "/imu/angular_velocity"),
        topic: "vehicle_angular_velocity",
        fields: "float[3] xyz;",
        values: |fields| floats(&frd(fields, "vector")),
    },
    Outlet {
        source: ("Vector3Stamped", "/imu/acceleration"),
        topic: "vehicle_acceleration",
        fields: "float[3] xyz;",
        values: |fields| floats(&frd(fields, "vector")),
    },
    Outlet {
        source: ("MagneticField", "/imu/mag"),
        topic: "vehicle_magnetometer",
        fields: "float[3] magnetometer_ga;",
        values: |fields| floats(&frd(fields, "magnetic_field").map(|tesla| tesla * 1e4)),
    },
    Outlet {
        source: ("PointStamped", "/baro/height"),
        topic: "vehicle_air_data",
        fields: "float baro_alt_meter;",
        values: |fields| floats(&[number(fields, &["point", "z"])]),
    },
    Outlet {
        source: ("EncoderCount", "/encoder"),
        topic: "wheel_encoders",
        fields: "int64_t encoder_position;",
        values: |fields| match value(fields, &["count"]) {
            Some(Value::I64(count)) => count.to_le_bytes().into(),
            _ => vec![0; 8],
        },
    },
    Outlet {
        source: ("JointState", "/joint_states"),
        topic: "wheel_encoders",
        fields: "float[2] wheel_angle;",
        values: |fields| match value(fields, &["position"]) {
            Some(Value::Sequence(angles)) => floats(&[angles.first().copied().unwrap_or(0.0), 0.0]),
            _ => vec![0; 8],
        },
    },
    Outlet {
        source: ("TimeReference", "/pps"),
        topic: "pps_capture",
        fields: "uint64_t rtc_timestamp;",
        values: |fields| match value(fields, &["time_ref"]) {
            Some(Value::Time(second)) => micros(*second).to_le_bytes().into(),
            _ => vec![0; 8],
        },
    },
];

impl Outlet {
    /// `None` for data without a PX4 topic.
    fn of(topic: &Topic) -> Option<&'static Outlet> {
        let name = topic.definition.ros1_name();
        OUTLETS.iter().find(|o| {
            let (definition, end) = o.source;
            name.ends_with(&format!("/{definition}")) && topic.name.ends_with(end)
        })
    }

    fn format(&self) -> String {
        format!("{}:uint64_t timestamp;uint64_t timestamp_sample;{}", self.topic, self.fields)
    }

    fn payload(&self, number: u16, message: &Message, at_us: i64, zero_us: i64) -> Vec<u8> {
        let sample_us = stamp_of(&message.fields).map_or(0, |stamp| micros(stamp) - zero_us);
        let mut payload = number.to_le_bytes().to_vec();
        payload.extend(at_us.to_le_bytes());
        payload.extend(sample_us.to_le_bytes());
        payload.extend((self.values)(&message.fields));
        payload
    }
}

fn value<'f>(fields: &'f Fields, path: &[&str]) -> Option<&'f Value> {
    let (first, rest) = path.split_first()?;
    let (_, value) = fields.iter().find(|(name, _)| name == first)?;
    match (rest, value) {
        ([], value) => Some(value),
        (rest, Value::Message(inner)) => self::value(inner, rest),
        _ => None,
    }
}

fn number(fields: &Fields, path: &[&str]) -> f64 {
    match value(fields, path) {
        Some(Value::F64(number)) => *number,
        _ => 0.0,
    }
}

fn doubles(values: &[f64]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn floats(values: &[f64]) -> Vec<u8> {
    values.iter().flat_map(|v| (*v as f32).to_le_bytes()).collect()
}

/// Forward, right, down of a vector written as forward, left, up.
fn frd(fields: &Fields, name: &'static str) -> [f64; 3] {
    [number(fields, &[name, "x"]), -number(fields, &[name, "y"]), -number(fields, &[name, "z"])]
}

/// North, east, down of a twist written as east, north, up.
fn ned(fields: &Fields) -> [f64; 3] {
    let [x, y, z] = ["x", "y", "z"].map(|axis| number(fields, &["twist", "linear", axis]));
    [y, x, -z]
}

fn fix(fields: &Fields) -> Vec<u8> {
    let [latitude, longitude, height] = ["latitude", "longitude", "altitude"].map(|axis| number(fields, &[axis]));
    let variance = match value(fields, &["position_covariance"]) {
        Some(Value::Fixed(covariance)) => covariance.first().copied().unwrap_or(0.0),
        _ => 0.0,
    };
    let mut bytes = doubles(&[latitude, longitude, height, height]);
    bytes.extend(stamp_of(fields).map_or(0, micros).to_le_bytes());
    bytes.extend(floats(&[variance.sqrt()]));
    // A 3D fix with twelve satellites.
    bytes.extend([3, 12]);
    bytes
}

fn place(fields: &Fields) -> Vec<u8> {
    let mut bytes = doubles(&["latitude", "longitude", "altitude"].map(|axis| number(fields, &[axis])));
    bytes.push(1);
    bytes
}

fn velocity(fields: &Fields) -> Vec<u8> {
    let mut bytes = floats(&ned(fields));
    bytes.extend([1, 3]);
    bytes
}

fn local(fields: &Fields) -> Vec<u8> {
    let mut bytes = floats(&ned(fields));
    bytes.push(1);
    bytes
}

struct Writer {
    bytes: Vec<u8>,
}

impl Writer {
    /// Header and flag bits.
    fn begin() -> Writer {
        let mut writer = Writer { bytes: b"ULog\x01\x12\x35\x01".to_vec() };
        writer.bytes.extend(BEFORE_US.to_le_bytes());
        writer.message(b'B', &[0; 40]);
        writer
    }

    fn message(&mut self, kind: u8, body: &[u8]) {
        self.bytes.extend((body.len() as u16).to_le_bytes());
        self.bytes.push(kind);
        self.bytes.extend(body);
    }

    fn entry(&mut self, kind: u8, key: &str, value: &[u8]) {
        self.message(kind, &[&[key.len() as u8][..], key.as_bytes(), value].concat());
    }

    fn definitions<'o>(&mut self, outlets: impl Iterator<Item = &'o Outlet>) {
        for (key, value) in [("sys_name", "PX4"), ("ver_hw", "SIMULATED"), ("ver_sw", "0123456789abcdef")] {
            self.entry(b'I', &format!("char[{}] {key}", value.len()), value.as_bytes());
        }
        self.entry(b'I', "uint32_t ver_sw_release", &0x0110_00ff_u32.to_le_bytes());
        for outlet in outlets {
            self.message(b'F', outlet.format().as_bytes());
        }
        self.entry(b'P', "float EKF2_GPS_DELAY", &GPS_DELAY_MS.to_le_bytes());
        self.entry(b'P', "int32_t SYS_AUTOSTART", &4001_i32.to_le_bytes());
    }

    /// Message numbers by topic.
    fn subscriptions<'o>(&mut self, outlets: impl Iterator<Item = &'o Outlet>) -> BTreeMap<&'static str, u16> {
        let mut numbers = BTreeMap::new();
        for (number, outlet) in (0_u16..).zip(outlets) {
            numbers.insert(outlet.topic, number);
            self.message(b'A', &[&[0][..], &number.to_le_bytes(), outlet.topic.as_bytes()].concat());
        }
        numbers
    }

    /// Data without a PX4 topic that has text becomes a logged message.
    fn text(&mut self, at_us: i64, message: &Message) {
        if let Some(Value::Text(text)) = value(&message.fields, &["data"]) {
            self.message(b'L', &[b"6", &at_us.to_le_bytes()[..], text.as_bytes()].concat());
        }
    }
}
