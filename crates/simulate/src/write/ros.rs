//! The written ROS messages.

use super::message::{Fields, Header, Value};
use flight::Stamp;

/// Three numbers: `geometry_msgs/Vector3` or `Point`.
fn xyz([x, y, z]: [f64; 3]) -> Value {
    Value::Message(vec![("x", Value::F64(x)), ("y", Value::F64(y)), ("z", Value::F64(z))])
}

/// `sensor_msgs/NavSatFix` with the same variance, m², on all axes.
pub(crate) fn nav_sat_fix(header: Header, geodetic_deg: [f64; 3], variance_m2: f64) -> Fields {
    let status = vec![("status", Value::I8(0)), ("service", Value::U16(1))];
    let [latitude, longitude, altitude] = geodetic_deg;
    let v = variance_m2;
    vec![
        ("header", Value::Header(header)),
        ("status", Value::Message(status)),
        ("latitude", Value::F64(latitude)),
        ("longitude", Value::F64(longitude)),
        ("altitude", Value::F64(altitude)),
        ("position_covariance", Value::Fixed(vec![v, 0.0, 0.0, 0.0, v, 0.0, 0.0, 0.0, v])),
        ("position_covariance_type", Value::U8(2)),
    ]
}

/// `geometry_msgs/TwistStamped` of a velocity north, east, down: x east, y north, z up.
pub(crate) fn twist_stamped(header: Header, [north, east, down]: [f64; 3]) -> Fields {
    let twist = vec![("linear", xyz([east, north, -down])), ("angular", xyz([0.0; 3]))];
    vec![("header", Value::Header(header)), ("twist", Value::Message(twist))]
}

/// `geometry_msgs/Vector3Stamped`.
pub(crate) fn vector3_stamped(header: Header, vector: [f64; 3]) -> Fields {
    vec![("header", Value::Header(header)), ("vector", xyz(vector))]
}

/// `geometry_msgs/PointStamped`.
pub(crate) fn point_stamped(header: Header, point: [f64; 3]) -> Fields {
    vec![("header", Value::Header(header)), ("point", xyz(point))]
}

/// `geometry_msgs/QuaternionStamped` from w, x, y, z.
pub(crate) fn quaternion_stamped(header: Header, [w, x, y, z]: [f64; 4]) -> Fields {
    let quaternion = vec![("x", Value::F64(x)), ("y", Value::F64(y)), ("z", Value::F64(z)), ("w", Value::F64(w))];
    vec![("header", Value::Header(header)), ("quaternion", Value::Message(quaternion))]
}

/// `sensor_msgs/MagneticField`, T; its covariance is unknown.
pub(crate) fn magnetic_field(header: Header, field: [f64; 3]) -> Fields {
    let unknown = Value::Fixed(vec![0.0; 9]);
    vec![("header", Value::Header(header)), ("magnetic_field", xyz(field)), ("magnetic_field_covariance", unknown)]
}

/// `sensor_msgs/TimeReference`.
pub(crate) fn time_reference(header: Header, time: Stamp) -> Fields {
    let source = Value::Text("pps".to_owned());
    vec![("header", Value::Header(header)), ("time_ref", Value::Time(time)), ("source", source)]
}

/// `flightlag_msgs/EncoderCount`.
pub(crate) fn encoder_count(header: Header, count: i64) -> Fields {
    vec![("header", Value::Header(header)), ("count", Value::I64(count))]
}

/// `sensor_msgs/JointState` of one joint without speed and torque.
pub(crate) fn joint_state(header: Header, angle: f64) -> Fields {
    vec![
        ("header", Value::Header(header)),
        ("name", Value::Texts(vec!["bar"])),
        ("position", Value::Sequence(vec![angle])),
        ("velocity", Value::Sequence(vec![])),
        ("effort", Value::Sequence(vec![])),
    ]
}

/// `std_msgs/String`.
pub(crate) fn string(data: String) -> Fields {
    vec![("data", Value::Text(data))]
}
