//! The messages of a flight in the order of their log, and their three encodings.

use super::definition::{Definition, NAV_SAT_FIX, STRING, TWIST_STAMPED};
use crate::error::SimulateError;
use crate::simulated::{Samples, SimulatedFlight, topic};
use flight::{NANOS_PER_SECOND, Stamp};
use serde::Serialize;

/// The topics, in the order of their connections.
pub(crate) const TOPICS: [(&str, &Definition); 4] = [
    (topic::POSITION, &NAV_SAT_FIX),
    (topic::VELOCITY, &TWIST_STAMPED),
    (topic::REFERENCE, &NAV_SAT_FIX),
    (topic::NOTES, &STRING),
];
const POSITION: usize = 0;
const VELOCITY: usize = 1;
const REFERENCE: usize = 2;
const NOTES: usize = 3;

/// Variance that stands for "as good as exact" in a covariance, m².
const EXACT_M2: f64 = 1e-6;

/// A message before it is encoded.
#[derive(Debug, Clone)]
pub(crate) struct Message {
    /// Index into [`TOPICS`].
    pub(crate) topic: usize,
    /// Count of messages of this topic before it.
    pub(crate) sequence: u32,
    /// When the logger had it.
    pub(crate) logged: Stamp,
    body: Body,
}

#[derive(Debug, Clone, Serialize)]
#[serde(untagged)]
enum Body {
    Fix(NavSatFix),
    Velocity(TwistStamped),
    Note { data: String },
}

/// `sensor_msgs/NavSatFix`.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct NavSatFix {
    header: Header,
    status: NavSatStatus,
    latitude: f64,
    longitude: f64,
    altitude: f64,
    position_covariance: [f64; 9],
    position_covariance_type: u8,
}

#[derive(Debug, Clone, Serialize)]
struct NavSatStatus {
    status: i8,
    service: u16,
}

/// `geometry_msgs/TwistStamped`, with x east, y north, z up.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct TwistStamped {
    header: Header,
    twist: Twist,
}

#[derive(Debug, Clone, Serialize)]
struct Twist {
    linear: Vector3,
    angular: Vector3,
}

#[derive(Debug, Clone, Serialize)]
struct Vector3 {
    x: f64,
    y: f64,
    z: f64,
}

#[derive(Debug, Clone, Serialize)]
struct Header {
    #[serde(skip)]
    sequence: u32,
    stamp: Time,
    frame_id: &'static str,
}

#[derive(Debug, Clone, Serialize)]
struct Time {
    sec: i64,
    nanosec: i64,
}

/// All messages in the order in which they were logged.
pub(crate) fn messages(flight: &SimulatedFlight) -> Vec<Message> {
    let std = flight.settings.position.white_std;
    let mut all = fixes(&flight.position, POSITION, (std * std).max(EXACT_M2));
    all.extend(velocities(&flight.velocity));
    all.extend(fixes(&flight.reference, REFERENCE, EXACT_M2));
    all.extend(notes(flight));
    all.sort_by_key(|message| (message.logged, message.topic, message.sequence));
    all
}

fn fixes(samples: &Samples, topic: usize, variance_m2: f64) -> Vec<Message> {
    let fix = |row: usize, header: Header| {
        let [latitude, longitude, altitude] = samples.geodetic_deg[row];
        Body::Fix(NavSatFix {
            header,
            status: NavSatStatus { status: 0, service: 1 },
            latitude,
            longitude,
            altitude,
            position_covariance: [variance_m2, 0.0, 0.0, 0.0, variance_m2, 0.0, 0.0, 0.0, variance_m2],
            position_covariance_type: 2,
        })
    };
    stamped(samples, topic, "gps", fix)
}

fn velocities(samples: &Samples) -> Vec<Message> {
    let velocity = |row: usize, header: Header| {
        let [north, east, down] = samples.ned[row];
        let linear = Vector3 { x: east, y: north, z: -down };
        Body::Velocity(TwistStamped { header, twist: Twist { linear, angular: Vector3 { x: 0.0, y: 0.0, z: 0.0 } } })
    };
    stamped(samples, VELOCITY, "map", velocity)
}

fn stamped(
    samples: &Samples,
    topic: usize,
    frame_id: &'static str,
    body: impl Fn(usize, Header) -> Body,
) -> Vec<Message> {
    let message = |row: usize| {
        let stamp = Time::of(samples.measured[row]);
        let header = Header { sequence: row as u32, stamp, frame_id };
        Message { topic, sequence: row as u32, logged: samples.logged[row], body: body(row, header) }
    };
    (0..samples.len()).map(message).collect()
}

/// One a second: a topic that nobody asks for, so that readers have something to skip.
fn notes(flight: &SimulatedFlight) -> Vec<Message> {
    let note = |second: u32| Message {
        topic: NOTES,
        sequence: second,
        logged: flight.settings.start.plus_seconds(f64::from(second) + 0.0005),
        body: Body::Note { data: format!("second {second}: all well, \"nothing\" to see; 3 < 4 & so on") },
    };
    (0..flight.settings.duration_s as u32).map(note).collect()
}

impl Time {
    fn of(stamp: Stamp) -> Time {
        Time { sec: stamp.0.div_euclid(NANOS_PER_SECOND), nanosec: stamp.0.rem_euclid(NANOS_PER_SECOND) }
    }
}

/// The two 32-bit halves of a ROS time.
pub(crate) fn ros_time(stamp: Stamp) -> [u8; 8] {
    let time = Time::of(stamp);
    let mut bytes = [0; 8];
    bytes[..4].copy_from_slice(&(time.sec as u32).to_le_bytes());
    bytes[4..].copy_from_slice(&(time.nanosec as u32).to_le_bytes());
    bytes
}

impl Message {
    /// ROS 1 serialisation.
    pub(crate) fn ros1(&self) -> Vec<u8> {
        let mut wire = Wire { bytes: Vec::with_capacity(160), cdr: false };
        wire.body(&self.body);
        wire.bytes
    }

    /// CDR, little-endian, with its encapsulation header.
    pub(crate) fn cdr(&self) -> Vec<u8> {
        let mut wire = Wire { bytes: vec![0, 1, 0, 0], cdr: true };
        wire.body(&self.body);
        wire.bytes
    }

    /// JSON with the field names of ROS 2.
    pub(crate) fn json(&self) -> Result<Vec<u8>, SimulateError> {
        Ok(serde_json::to_vec(&self.body)?)
    }

    /// The cells of `rostopic echo -p`: log time first.
    pub(crate) fn csv_row(&self) -> String {
        let logged = self.logged.0;
        match &self.body {
            Body::Fix(fix) => {
                let covariance = fix.position_covariance.map(|value| value.to_string()).join(",");
                let NavSatStatus { status, service } = fix.status;
                let (header, kind) = (fix.header.csv_cells(), fix.position_covariance_type);
                let position = format!("{},{},{}", fix.latitude, fix.longitude, fix.altitude);
                format!("{logged},{header},{status},{service},{position},{covariance},{kind}\n")
            }
            Body::Velocity(velocity) => {
                let Twist { linear, angular } = &velocity.twist;
                format!("{logged},{},{},{}\n", velocity.header.csv_cells(), linear.csv_cells(), angular.csv_cells())
            }
            Body::Note { data } => format!("{logged},\"{}\"\n", data.replace('"', "\"\"")),
        }
    }
}

/// Names of the cells of [`Message::csv_row`].
pub(crate) fn csv_header(topic: usize) -> String {
    const STAMPED: &str = "%time,field.header.seq,field.header.stamp,field.header.frame_id";
    match topic {
        POSITION | REFERENCE => {
            let covariance = (0..9).map(|i| format!("field.position_covariance{i}")).collect::<Vec<_>>().join(",");
            format!(
                "{STAMPED},field.status.status,field.status.service,field.latitude,field.longitude,field.altitude,\
                 {covariance},field.position_covariance_type\n"
            )
        }
        VELOCITY => {
            let part = |name: &str| ["x", "y", "z"].map(|axis| format!("field.twist.{name}.{axis}")).join(",");
            format!("{STAMPED},{},{}\n", part("linear"), part("angular"))
        }
        _ => "%time,field.data\n".to_owned(),
    }
}

impl Header {
    fn csv_cells(&self) -> String {
        let stamp = self.stamp.sec * NANOS_PER_SECOND + self.stamp.nanosec;
        format!("{},{stamp},{}", self.sequence, self.frame_id)
    }
}

impl Vector3 {
    fn csv_cells(&self) -> String {
        format!("{},{},{}", self.x, self.y, self.z)
    }
}

/// Bytes of a message: as they come (ROS 1), or each aligned to its size (CDR).
struct Wire {
    bytes: Vec<u8>,
    cdr: bool,
}

impl Wire {
    fn body(&mut self, body: &Body) {
        match body {
            Body::Fix(fix) => self.fix(fix),
            Body::Velocity(velocity) => self.velocity(velocity),
            Body::Note { data } => self.text(data),
        }
    }

    fn fix(&mut self, fix: &NavSatFix) {
        self.header(&fix.header);
        self.put(fix.status.status.to_le_bytes());
        self.put(fix.status.service.to_le_bytes());
        [fix.latitude, fix.longitude, fix.altitude].iter().for_each(|v| self.put(v.to_le_bytes()));
        fix.position_covariance.iter().for_each(|v| self.put(v.to_le_bytes()));
        self.put([fix.position_covariance_type]);
    }

    fn velocity(&mut self, velocity: &TwistStamped) {
        self.header(&velocity.header);
        for vector in [&velocity.twist.linear, &velocity.twist.angular] {
            [vector.x, vector.y, vector.z].iter().for_each(|v| self.put(v.to_le_bytes()));
        }
    }

    fn header(&mut self, header: &Header) {
        if !self.cdr {
            self.put(header.sequence.to_le_bytes());
        }
        self.put((header.stamp.sec as u32).to_le_bytes());
        self.put((header.stamp.nanosec as u32).to_le_bytes());
        self.text(header.frame_id);
    }

    /// CDR counts and writes a closing zero, ROS 1 does not.
    fn text(&mut self, text: &str) {
        let zero: &[u8] = if self.cdr { &[0] } else { &[] };
        self.put(((text.len() + zero.len()) as u32).to_le_bytes());
        self.bytes.extend_from_slice(text.as_bytes());
        self.bytes.extend_from_slice(zero);
    }

    fn put<const N: usize>(&mut self, value: [u8; N]) {
        if self.cdr {
            // Alignment counts from the end of the four bytes of the encapsulation header.
            let padding = (self.bytes.len() - 4).next_multiple_of(N) + 4 - self.bytes.len();
            self.bytes.extend(std::iter::repeat_n(0, padding));
        }
        self.bytes.extend_from_slice(&value);
    }
}
