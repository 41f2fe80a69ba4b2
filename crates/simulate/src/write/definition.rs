//! Message definitions as stored by ROS 1 and ROS 2 recorders: the type's own text, then that of each nested type after
//! a line of `=`.

/// `sensor_msgs/NavSatFix`.
pub(crate) const NAV_SAT_FIX: Definition = Definition {
    package: "sensor_msgs",
    name: "NavSatFix",
    md5: "2d3a8cd499b9b4a0249fb98fd05cfa48",
    text: include_str!("msg/NavSatFix.msg"),
    parts: &[HEADER, ("sensor_msgs/NavSatStatus", include_str!("msg/NavSatStatus.msg"))],
};

/// `geometry_msgs/TwistStamped`.
pub(crate) const TWIST_STAMPED: Definition = Definition {
    package: "geometry_msgs",
    name: "TwistStamped",
    md5: "98d34b0043a2093cf9d9345ab6eef12e",
    text: include_str!("msg/TwistStamped.msg"),
    parts: &[
        HEADER,
        ("geometry_msgs/Twist", include_str!("msg/Twist.msg")),
        ("geometry_msgs/Vector3", include_str!("msg/Vector3.msg")),
    ],
};

/// `std_msgs/String`.
pub(crate) const STRING: Definition = Definition {
    package: "std_msgs",
    name: "String",
    md5: "992ce8a1687cec8c8bd883ec73ca41d1",
    text: "string data\n",
    parts: &[],
};

/// `geometry_msgs/Vector3Stamped`.
pub(crate) const VECTOR3_STAMPED: Definition = Definition {
    package: "geometry_msgs",
    name: "Vector3Stamped",
    md5: "7b324c7325e683bf02a9b14b01090ec7",
    text: "std_msgs/Header header\nVector3 vector\n",
    parts: &[HEADER, ("geometry_msgs/Vector3", include_str!("msg/Vector3.msg"))],
};

/// `geometry_msgs/PointStamped`.
pub(crate) const POINT_STAMPED: Definition = Definition {
    package: "geometry_msgs",
    name: "PointStamped",
    md5: "c63aecb41bfdfd6b7e1fac37c7cbe7bf",
    text: "std_msgs/Header header\nPoint point\n",
    parts: &[HEADER, ("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n")],
};

/// `geometry_msgs/QuaternionStamped`.
pub(crate) const QUATERNION_STAMPED: Definition = Definition {
    package: "geometry_msgs",
    name: "QuaternionStamped",
    md5: "e57f1e547e0e1fd13504588ffc8334e2",
    text: "std_msgs/Header header\nQuaternion quaternion\n",
    parts: &[HEADER, ("geometry_msgs/Quaternion", "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n")],
};

/// `sensor_msgs/MagneticField`.
pub(crate) const MAGNETIC_FIELD: Definition = Definition {
    package: "sensor_msgs",
    name: "MagneticField",
    md5: "2f3b0b43eed0c9501de0fa3ff89a45aa",
    text: "std_msgs/Header header\ngeometry_msgs/Vector3 magnetic_field\nfloat64[9] magnetic_field_covariance\n",
    parts: &[HEADER, ("geometry_msgs/Vector3", include_str!("msg/Vector3.msg"))],
};

/// `sensor_msgs/CompressedImage`.
pub(crate) const COMPRESSED_IMAGE: Definition = Definition {
    package: "sensor_msgs",
    name: "CompressedImage",
    md5: "8f7a12909da2c9d3332d540a0977563f",
    text: "std_msgs/Header header\nstring format\nuint8[] data\n",
    parts: &[HEADER],
};

/// `sensor_msgs/TimeReference`.
pub(crate) const TIME_REFERENCE: Definition = Definition {
    package: "sensor_msgs",
    name: "TimeReference",
    md5: "fded64a0265108ba86c3d38fb11c0c16",
    text: "std_msgs/Header header\nbuiltin_interfaces/Time time_ref\nstring source\n",
    parts: &[HEADER],
};

/// `sensor_msgs/JointState`.
pub(crate) const JOINT_STATE: Definition = Definition {
    package: "sensor_msgs",
    name: "JointState",
    md5: "3066dcd76a6cfaef579bd0f34173e9fd",
    text: "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n",
    parts: &[HEADER],
};

/// Counts of an encoder with a timestamp: there is no standard ROS message for them. The MD5 sum is that of its text.
pub(crate) const ENCODER_COUNT: Definition = Definition {
    package: "flightlag_msgs",
    name: "EncoderCount",
    md5: "631e76a69a767b4f88df6b5255a9f238",
    text: "std_msgs/Header header\nint64 count\n",
    parts: &[HEADER],
};

const HEADER: (&str, &str) = ("std_msgs/Header", "");
const HEADER_ROS1: &str = include_str!("msg/Header.ros1.msg");
const HEADER_ROS2: &str = include_str!("msg/Header.ros2.msg");
const TIME_ROS2: &str = include_str!("msg/Time.ros2.msg");

/// A message type.
#[derive(Debug)]
pub(crate) struct Definition {
    package: &'static str,
    name: &'static str,
    /// MD5 sum that identifies the type in ROS 1.
    pub(crate) md5: &'static str,
    text: &'static str,
    parts: &'static [(&'static str, &'static str)],
}

impl Definition {
    /// Name in ROS 1.
    pub(crate) fn ros1_name(&self) -> String {
        format!("{}/{}", self.package, self.name)
    }

    /// Name in ROS 2.
    pub(crate) fn ros2_name(&self) -> String {
        format!("{}/msg/{}", self.package, self.name)
    }

    /// Text in ROS 1, where `Header` needs no package and has a sequence number.
    pub(crate) fn ros1_text(&self) -> String {
        let parts = self.parts.iter().map(|&(name, text)| (name, if name == HEADER.0 { HEADER_ROS1 } else { text }));
        let text = self.text.replace("std_msgs/Header header", "Header header");
        concatenated(&text.replace("builtin_interfaces/Time ", "time "), parts)
    }

    /// Text in ROS 2, where a header's time is a message.
    pub(crate) fn ros2_text(&self) -> String {
        let parts = self.parts.iter().flat_map(|&(name, text)| {
            let with_time = (name == HEADER.0).then_some(("builtin_interfaces/Time", TIME_ROS2));
            [(name, if name == HEADER.0 { HEADER_ROS2 } else { text })].into_iter().chain(with_time)
        });
        concatenated(self.text, parts)
    }
}

fn concatenated<'a>(root: &str, parts: impl Iterator<Item = (&'a str, &'a str)>) -> String {
    let line = "=".repeat(80);
    parts.fold(root.to_owned(), |all, (name, text)| format!("{all}\n{line}\nMSG: {name}\n{text}"))
}
